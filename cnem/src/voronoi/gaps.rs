//! Parts of the domain whose closest node is behind a constrained face, and the nodes that receive them.

use super::cell::Work;
use crate::delaunay::volume;
use crate::domain::Domain;
use rayon::prelude::*;
use std::collections::HashMap;

/// Share of a tetrahedron's volume that may be uncovered, or covered twice, before the tetrahedron is divided
/// again; dividing without need is harmless.
const UNCOVERED: f64 = 1e-10;

/// Volume that was reassigned because its closest node is behind a constrained face.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Gaps {
    /// Tetrahedra that were divided again.
    pub tetrahedra: usize,
    /// Connected regions that these tetrahedra form.
    pub regions: usize,
    /// Volume whose closest node is hidden \[m³\].
    pub volume: f64,
}

/// Tetrahedra that are divided among the same nodes.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Region {
    pub(crate) tets: Vec<u32>,
    pub(crate) nodes: Vec<u32>,
}

/// Extent of one cell before any volume is reassigned.
struct Extent {
    /// Volume of the cell in every tetrahedron \[m³\].
    parts: Vec<(u32, f64)>,
    /// Tetrahedra that border on the cell and belong to another copy of its node.
    beside: Vec<u32>,
}

/// All regions of a domain.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Regions {
    regions: Vec<Region>,
    of_tet: HashMap<u32, u32>,
    of_node: HashMap<u32, Vec<u32>>,
    pub(crate) gaps: Gaps,
}

impl Regions {
    pub(crate) fn holds(&self, tet: u32) -> bool {
        self.of_tet.contains_key(&tet)
    }

    pub(crate) fn of_node(&self, node: u32) -> impl Iterator<Item = &Region> {
        let list = self.of_node.get(&node).map_or(&[][..], Vec::as_slice);
        list.iter().map(|&r| &self.regions[r as usize])
    }

    /// Clips all cells and finds the tetrahedra that they do not fill exactly once.
    pub(super) fn find(domain: &Domain) -> Self {
        let extents: Vec<Extent> = (0..domain.nodes().len() as u32)
            .into_par_iter()
            .map_init(Work::default, |work, node| {
                work.clipped(domain, &Self::default(), node);
                Extent {
                    parts: work.parts.clone(),
                    beside: work.beside.clone(),
                }
            })
            .collect();
        // There are no gaps where the smallest spheres around the constrained faces are empty, as in blocks
        // and cracks whose nodes on the faces are as dense as inside. A V-notch has some if nodes are closer
        // to its flanks than the nodes on the flanks are to each other. A comparison of volumes finds them.
        let mut filled = vec![0.0; domain.delaunay.tets.len()];
        for &(tet, v) in extents.iter().flat_map(|e| &e.parts) {
            filled[tet as usize] += v;
        }
        let mut out = Self::default();
        for (tet, t) in domain.delaunay.tets.iter().enumerate() {
            // Flat tetrahedra have no volume to cover.
            if !domain.inside[tet] {
                continue;
            }
            let full = volume(domain.delaunay.corners(t));
            // Too little is a gap, too much is covered twice: both are divided again.
            if (filled[tet] - full).abs() > full * UNCOVERED {
                out.of_tet.insert(tet as u32, u32::MAX);
                out.gaps.volume += (full - filled[tet]).abs();
            }
        }
        out.connect(domain);
        out.share(domain, &extents);
        out.gaps.tetrahedra = out.of_tet.len();
        out.gaps.regions = out.regions.len();
        out
    }

    /// Joins the tetrahedra into regions over free faces.
    fn connect(&mut self, domain: &Domain) {
        // Sorted, so that the numbers of the regions do not depend on hashing.
        let mut candidates: Vec<u32> = self.of_tet.keys().copied().collect();
        candidates.sort_unstable();
        for start in candidates {
            if self.of_tet[&start] != u32::MAX {
                continue;
            }
            let id = self.regions.len() as u32;
            let mut tets = vec![start];
            let mut behind = Vec::new();
            self.of_tet.insert(start, id);
            let mut next = 0;
            while next < tets.len() {
                let tet = tets[next];
                next += 1;
                for slot in 0..4 {
                    let neighbour = domain.delaunay.tets[tet as usize].n[slot] >> 2;
                    // Walls bound regions: what lies behind has its own nodes.
                    if domain.walls[tet as usize] >> slot & 1 == 1 {
                        continue;
                    }
                    // Flat tetrahedra connect, but belong to no region themselves.
                    domain.behind_flat(neighbour, &mut behind);
                    for &neighbour in &behind {
                        if self.of_tet.get(&neighbour) == Some(&u32::MAX) {
                            self.of_tet.insert(neighbour, id);
                            tets.push(neighbour);
                        }
                    }
                }
            }
            tets.sort_unstable();
            self.regions.push(Region {
                tets,
                nodes: Vec::new(),
            });
        }
    }

    /// Gives each region its nodes: those whose cells reach the region or border on it, and the corners of
    /// its tetrahedra.
    fn share(&mut self, domain: &Domain, extents: &[Extent]) {
        for (node, extent) in extents.iter().enumerate() {
            let tets = extent
                .parts
                .iter()
                .map(|p| p.0)
                .chain(extent.beside.iter().copied());
            // Without the nodes of bordering cells, the strip inside the region that is closest to them would
            // go to other nodes, and the facets on the border would not match.
            for tet in tets {
                if let Some(&r) = self.of_tet.get(&tet) {
                    self.regions[r as usize].nodes.push(node as u32);
                }
            }
        }
        for (id, region) in self.regions.iter_mut().enumerate() {
            for &t in &region.tets {
                region.nodes.extend(domain.delaunay.tets[t as usize].v);
            }
            // The tetrahedron decides later which copy of a node gets the volume.
            for i in 0..region.nodes.len() {
                let original = domain.copies.original(region.nodes[i]);
                region.nodes.extend(domain.copies.unknowns_of(original));
            }
            // Sorted lists: regions and cells have the same bits in every run.
            region.nodes.sort_unstable();
            region.nodes.dedup();
            for &v in &region.nodes {
                self.of_node.entry(v).or_default().push(id as u32);
            }
        }
    }
}
