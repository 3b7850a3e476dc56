//! Parts of the domain whose closest node is behind a constrained face, and who gets them.

use super::cell::Work;
use crate::delaunay::volume;
use crate::domain::Domain;
use rayon::prelude::*;
use std::collections::HashMap;

/// Share of a tetrahedron's volume that may be uncovered, or covered twice, before it is divided anew;
/// dividing without need is harmless.
const UNCOVERED: f64 = 1e-10;

/// What was handed over to other nodes because its closest node is behind a constrained face.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Gaps {
    /// Tetrahedra divided anew.
    pub tetrahedra: usize,
    /// Connected regions they form.
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

/// Where one cell is before anything is handed over.
struct Reached {
    /// Its volume in every tetrahedron \[m³\].
    parts: Vec<(u32, f64)>,
    /// Tetrahedra it borders on, where another copy of its node rules.
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

    /// Clips all cells and looks for tetrahedra that are not filled.
    pub(super) fn find(domain: &Domain) -> Self {
        let reached: Vec<Reached> = (0..domain.nodes().len() as u32)
            .into_par_iter()
            .map_init(Work::default, |work, node| {
                work.clipped(domain, &Self::default(), node);
                Reached {
                    parts: work.parts.clone(),
                    beside: work.beside.clone(),
                }
            })
            .collect();
        let mut filled = vec![0.0; domain.delaunay.tets.len()];
        for &(tet, v) in reached.iter().flat_map(|r| &r.parts) {
            filled[tet as usize] += v;
        }
        let mut out = Self::default();
        for (tet, t) in domain.delaunay.tets.iter().enumerate() {
            if !domain.inside[tet] {
                continue;
            }
            let whole = volume(domain.delaunay.corners(t));
            if (filled[tet] - whole).abs() > whole * UNCOVERED {
                out.of_tet.insert(tet as u32, u32::MAX);
                out.gaps.volume += (whole - filled[tet]).abs();
            }
        }
        out.connect(domain);
        out.share(domain, &reached);
        out.gaps.tetrahedra = out.of_tet.len();
        out.gaps.regions = out.regions.len();
        out
    }

    /// Joins tetrahedra over free faces.
    fn connect(&mut self, domain: &Domain) {
        let mut all: Vec<u32> = self.of_tet.keys().copied().collect();
        all.sort_unstable();
        for start in all {
            if self.of_tet[&start] != u32::MAX {
                continue;
            }
            let id = self.regions.len() as u32;
            let mut tets = vec![start];
            let mut beyond = Vec::new();
            self.of_tet.insert(start, id);
            let mut next = 0;
            while next < tets.len() {
                let tet = tets[next];
                next += 1;
                for slot in 0..4 {
                    let other = domain.delaunay.tets[tet as usize].n[slot] >> 2;
                    if domain.walls[tet as usize] >> slot & 1 == 1 {
                        continue;
                    }
                    domain.beyond(other, &mut beyond);
                    for &other in &beyond {
                        if self.of_tet.get(&other) == Some(&u32::MAX) {
                            self.of_tet.insert(other, id);
                            tets.push(other);
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

    /// Nodes whose cells reach a region or border on it, and the corners of its tetrahedra. Without those
    /// that border on it the region's side of that border would go to others, and the facets there would not
    /// match.
    fn share(&mut self, domain: &Domain, reached: &[Reached]) {
        for (node, reached) in reached.iter().enumerate() {
            let tets = reached
                .parts
                .iter()
                .map(|p| p.0)
                .chain(reached.beside.iter().copied());
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
            // Which copy of a node gets its part is a matter of the tetrahedron.
            for i in 0..region.nodes.len() {
                let original = domain.copies.original(region.nodes[i]);
                region.nodes.extend(domain.copies.of(original));
            }
            region.nodes.sort_unstable();
            region.nodes.dedup();
            for &v in &region.nodes {
                self.of_node.entry(v).or_default().push(id as u32);
            }
        }
    }
}
