//! Voronoi cell of one node: read off the circumcentres, or clipped tetrahedron by tetrahedron.

use super::gaps::Regions;
use super::{Facet, Side};
use crate::bins::{Bins, around};
use crate::clip::Polyhedron;
use crate::domain::Domain;
use crate::tet::{INF, NONE};
use nalgebra::{Point3, Vector3};

/// Area of a facet, relative to the largest facet of the cell, below which it is round-off and left out.
const TINY_FACET: f64 = 1e-13;

/// Distance from the bisector of two nodes, relative to their distance, up to which a corner lies on the
/// bisector. A facet may coincide with a tetrahedron face, always where nodes are cospherical; round-off must
/// not decide which side owns this face.
const SNAP: f64 = 1e-12;

/// Tags of faces: their kind in bits 40 and 41, an index below.
const NODE: u64 = 1 << 40;
const WALL: u64 = 2 << 40;
const FREE: u64 = 3 << 40;
const KIND: u64 = 3 << 40;
/// Marks the side of a constrained face that its normal points to: a cell at a crack may have facets on both
/// sides.
const LIP: u64 = 1 << 39;

/// Sums over the parts of one facet: area vector, and centroid times area, relative to the node.
#[derive(Debug, Clone, Copy)]
struct Piece {
    tag: u64,
    /// Zero, or the face between two tetrahedra that this part lies on, for the border with another copy of
    /// the node. Several such faces are not plane, and only a plane facet integrates linear fields with one
    /// point.
    face: u64,
    area: Vector3<f64>,
    moment: Vector3<f64>,
    weight: f64,
    /// Tetrahedron that holds the largest part.
    tet: u32,
    /// Area of the largest part \[m²\].
    largest: f64,
}

/// Working buffers and result of one cell.
#[derive(Debug, Default)]
pub(super) struct Work {
    star: Vec<u32>,
    queue: Vec<u32>,
    behind: Vec<u32>,
    /// Neighbours with their position relative to the node, nearest first.
    near: Vec<(f64, u32, Vector3<f64>)>,
    pieces: Vec<Piece>,
    piece: Polyhedron,
    /// Volume in every tetrahedron \[m³\], if the cell was clipped.
    pub(super) parts: Vec<(u32, f64)>,
    /// Tetrahedra that border on the cell and belong to another copy of the node.
    pub(super) beside: Vec<u32>,
    /// The convex pieces relative to the node, if they are to be kept.
    pub(super) keep: Option<Vec<Polyhedron>>,
    pub(super) volume: f64,
    pub(super) facets: Vec<Facet>,
    /// For each facet the tetrahedron that holds its largest part; `NONE` where no constrained face is near.
    pub(super) tets: Vec<u32>,
    visited: Vec<u32>,
}

impl Work {
    fn start(&mut self, domain: &Domain, node: u32) {
        self.volume = 0.0;
        self.tets.clear();
        self.pieces.clear();
        self.parts.clear();
        self.beside.clear();
        self.facets.clear();
        domain.delaunay.star(node, &mut self.star);
    }

    /// Computes the cell, by the quicker way where no constrained face is near.
    pub(super) fn cell(&mut self, domain: &Domain, walls: &Bins, node: u32) {
        self.start(domain, node);
        let seed = &domain.delaunay.points[node as usize];
        let is_inside = self
            .star
            .iter()
            .all(|&t| domain.inside[t as usize] || domain.glued[t as usize]);
        let reach = self
            .star
            .iter()
            .map(|&t| domain.centre[t as usize].norm_squared())
            .fold(0.0, f64::max)
            .sqrt();
        // After faces were recovered by division a sphere is sure to be empty only if no constrained face
        // reaches into it: the search covers the whole spheres, not only their centres.
        let reach = if domain.delaunay.before.is_some() {
            2.0 * reach
        } else {
            reach
        };
        // The margin covers the round-off of the centres.
        if is_inside && !walls.overlaps_any(&around([seed], reach * (1.0 + 1e-9))) {
            self.read_circumcentres(domain, node);
        } else {
            self.by_clipping(domain, &Regions::default(), node);
        }
        self.finish(seed);
    }

    /// Computes the cell by clipping, with its share of the `regions` that are divided again.
    pub(super) fn clipped(&mut self, domain: &Domain, regions: &Regions, node: u32) {
        self.start(domain, node);
        self.by_clipping(domain, regions, node);
        let original = domain.copies.original(node);
        for region in regions.of_node(node) {
            self.near.clear();
            let seed = domain.delaunay.points[node as usize];
            // In a region any of its nodes may be the closest, not only neighbours in the complex.
            for &v in &region.nodes {
                self.add_near(domain, node, v);
            }
            self.near.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
            for &tet in &region.tets {
                if domain.copy_at(tet, original, &mut self.visited) == node {
                    self.clip_one(domain, tet, &seed);
                    self.take_piece(domain, tet, node);
                }
            }
        }
        self.finish(&domain.delaunay.points[node as usize]);
    }

    fn add(&mut self, part: Piece) {
        match self
            .pieces
            .iter_mut()
            .find(|p| (p.tag, p.face) == (part.tag, part.face))
        {
            Some(p) => {
                p.area += part.area;
                p.moment += part.moment;
                p.weight += part.weight;
                if part.largest > p.largest {
                    (p.tet, p.largest) = (part.tet, part.largest);
                }
            }
            None => self.pieces.push(part),
        }
    }

    /// Lists the neighbours in the Delaunay complex, hidden ones included: the cell ends where another node
    /// is closer, visible or not, so that cells never overlap.
    fn list_near(&mut self, domain: &Domain, node: u32) {
        let original = domain.copies.original(node);
        if let Some(neighbours) = domain.delaunay.before.as_ref() {
            for &v in neighbours.row(original as usize) {
                self.add_near(domain, node, v);
            }
            return;
        }
        let copies = domain.copies.unknowns_of(original);
        let copies = if copies.is_empty() { &[original] } else { copies };
        for &copy in copies {
            domain.delaunay.star(copy, &mut self.visited);
            for i in 0..self.visited.len() {
                let t = self.visited[i];
                for v in domain.delaunay.tets[t as usize]
                    .v
                    .into_iter()
                    .filter(|v| *v != INF)
                {
                    self.add_near(domain, node, v);
                }
            }
        }
    }

    /// Adds a neighbour to the list, once for all of its copies.
    fn add_near(&mut self, domain: &Domain, node: u32, v: u32) {
        let v = domain.copies.original(v);
        // Copies have one position and one bisector: a second one would cut nothing.
        if v != domain.copies.original(node) && !self.near.iter().any(|n| n.1 == v) {
            let seed = &domain.delaunay.points[node as usize];
            let r = domain.delaunay.points[v as usize] - seed;
            self.near.push((r.norm_squared(), v, r));
        }
    }

    /// Sums the facets from circumcentres.
    fn read_circumcentres(&mut self, domain: &Domain, node: u32) {
        let seed = domain.delaunay.points[node as usize];
        let centre = |t: u32| {
            let base = domain.delaunay.tets[t as usize].v[0];
            (domain.delaunay.points[base as usize] - seed) + domain.centre[t as usize]
        };
        for i in 0..self.star.len() {
            let tet = self.star[i];
            let t = &domain.delaunay.tets[tet as usize];
            for (slot, &n) in t.n.iter().enumerate() {
                let face = t.face(slot);
                let Some(position) = face.iter().position(|&v| v == node) else {
                    continue;
                };
                // Each face belongs to two tetrahedra; the one with the smaller index counts it.
                if tet > n >> 2 {
                    continue;
                }
                // Each tetrahedron face at the node has a dual segment, which bounds the facets towards the
                // two other vertices of the face.
                let (p, q) = (centre(tet), centre(n >> 2));
                for (neighbour, start, end) in [
                    (face[(position + 1) % 3], &p, &q),
                    (face[(position + 2) % 3], &q, &p),
                ] {
                    let r = domain.delaunay.points[neighbour as usize] - seed;
                    let m = r * 0.5;
                    let twice = (start - m).cross(&(end - m)).dot(&r);
                    let weight = 0.5 * twice / r.norm();
                    let area = r * (0.5 * twice / r.norm_squared());
                    // The pyramid from the node over this triangle: its height is half of `r`.
                    self.volume += twice / 12.0;
                    self.add(Piece {
                        tag: NODE | u64::from(neighbour),
                        face: 0,
                        area,
                        moment: (m + start + end) * (weight / 3.0),
                        weight,
                        tet: NONE,
                        largest: 0.0,
                    });
                }
            }
        }
    }

    fn by_clipping(&mut self, domain: &Domain, regions: &Regions, node: u32) {
        let seed = domain.delaunay.points[node as usize];
        self.near.clear();
        self.list_near(domain, node);
        self.near.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        // Flat tetrahedra have no volume to clip; cells pass through them by `behind_flat`.
        self.queue.clear();
        self.queue
            .extend(self.star.iter().filter(|&&t| domain.inside[t as usize]));
        let original = domain.copies.original(node);
        let mut next = 0;
        while next < self.queue.len() {
            let tet = self.queue[next];
            next += 1;
            self.clip_one(domain, tet, &seed);
            // The cell goes on wherever a piece still has a face inside the domain.
            for (tag, _) in self.piece.faces() {
                if tag & KIND == FREE {
                    domain.behind_flat((tag & !KIND) as u32, &mut self.behind);
                    for &id in &self.behind {
                        if self.queue.contains(&id) {
                            continue;
                        }
                        if domain.copy_at(id, original, &mut self.visited) == node {
                            self.queue.push(id);
                        } else {
                            self.beside.push(id);
                        }
                    }
                }
            }
            // Tetrahedra of a region are divided among all of its nodes, in `clipped`.
            if !regions.holds(tet) {
                self.take_piece(domain, tet, node);
            }
        }
    }

    /// Adds the piece of a tetrahedron to the cell. A face towards a tetrahedron of another copy of the node
    /// becomes a facet between the two copies.
    fn take_piece(&mut self, domain: &Domain, tet: u32, node: u32) {
        let piece = std::mem::take(&mut self.piece);
        for (tag, face) in piece.faces() {
            let id = tag & !KIND;
            let mut between = 0;
            let tag = match tag & KIND {
                WALL if along(domain, id, &face.area) => tag | LIP,
                NODE => NODE | u64::from(domain.copy_at(tet, id as u32, &mut self.visited)),
                FREE => {
                    let original = domain.copies.original(node);
                    let copy = domain.copy_at(id as u32, original, &mut self.visited);
                    if copy == node {
                        continue;
                    }
                    let tet = u64::from(tet);
                    between = tet.min(id) << 32 | tet.max(id);
                    NODE | u64::from(copy)
                }
                _ => tag,
            };
            let weight = face.area.norm();
            self.add(Piece {
                // Summed with its area as the weight; the centroid follows at the end.
                tag,
                face: between,
                area: face.area,
                moment: face.centroid * weight,
                weight,
                tet,
                largest: weight,
            });
        }
        if !piece.is_empty() {
            let volume = piece.volume();
            self.volume += volume;
            // Volumes by tetrahedron show later which parts of the domain no cell covers.
            self.parts.push((tet, volume));
            if let Some(keep) = &mut self.keep {
                keep.push(piece.clone());
            }
        }
        self.piece = piece;
    }

    /// Clips one tetrahedron to the part that is closest to the node.
    fn clip_one(&mut self, domain: &Domain, tet: u32, seed: &Point3<f64>) {
        let t = &domain.delaunay.tets[tet as usize];
        let walls = domain.walls[tet as usize];
        let tags = [0, 1, 2, 3].map(|slot: usize| {
            let wall = (walls >> slot & 1 == 1)
                .then(|| domain.face_at.get(&(tet << 2 | slot as u32)))
                .flatten();
            match wall {
                Some(&face) => WALL | u64::from(face),
                None => FREE | u64::from(t.n[slot] >> 2),
            }
        });
        self.piece
            .set_tetrahedron(domain.delaunay.corners(t).map(|p| p - seed), tags);
        let mut reach = self.piece.reach();
        for (square, v, r) in &self.near {
            // Neighbours are sorted by distance. Beyond twice the farthest corner no bisector meets the
            // piece.
            // The piece shrinks as it is cut, and with it the distance from which neighbours still count.
            if *square > 4.0 * reach {
                break;
            }
            let free = |tag| tag & KIND == FREE;
            if self
                .piece
                .clip_near(r, 0.5 * square, NODE | u64::from(*v), SNAP * square, free)
            {
                if self.piece.is_empty() {
                    return;
                }
                reach = self.piece.reach();
            }
        }
    }

    fn finish(&mut self, seed: &Point3<f64>) {
        // Tags put neighbours before constrained faces, both in ascending order.
        self.pieces.sort_unstable_by_key(|p| (p.tag, p.face));
        let size = self.pieces.iter().map(|p| p.weight).fold(0.0, f64::max);
        for p in &self.pieces {
            // Relative to the largest facet: a facet of round-off size has no reliable normal.
            if p.weight > TINY_FACET * size {
                let id = (p.tag & !(KIND | LIP)) as usize;
                let side = if p.tag & KIND == NODE {
                    Side::Node(id)
                } else {
                    Side::Face(id)
                };
                self.tets.push(p.tet);
                self.facets.push(Facet {
                    side,
                    area: p.area,
                    centroid: seed + p.moment / p.weight,
                });
            }
        }
    }
}

/// Returns whether an area vector points along the normal of a constrained face.
fn along(domain: &Domain, face: u64, area: &Vector3<f64>) -> bool {
    let v = domain.mesh.faces[face as usize].v;
    let [a, b, c] = v.map(|v| &domain.delaunay.points[v as usize]);
    (b - a).cross(&(c - a)).dot(area) > 0.0
}
