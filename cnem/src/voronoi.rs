//! Voronoi cells of the nodes, cut off at the constrained faces.
//!
//! The cell of a node is the part of the domain that is closer to it than to any other node and connected to it without
//! crossing a constrained face. Cells far from the constraints are read off the circumcentres; the others are collected
//! tetrahedron by tetrahedron: clip it by the bisectors of the node, continue over the free faces of what is left.
//!
//! A part of the domain whose closest node is behind a constrained face belongs to no cell. That cannot happen where
//! the smallest spheres around the constrained faces are empty; it is found by comparing volumes, and is an error.
//! Measured with random nodes around a coarse cubic hole: 6 of 15 sets, 3e-8 to 6e-6 of the volume. The
//! blocks and cracks of the tests, with nodes on the faces as dense as inside, have none.

use crate::bins::{Bins, around};
use crate::clip::Polyhedron;
use crate::domain::Domain;
use crate::error::{Error, Result};
use crate::tet::INF;
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

/// Relative volume of the domain that may be left out before it is an error; round-off is below 1e-12.
const VOLUME_TOLERANCE: f64 = 1e-9;
/// Twice the area of a facet, relative to the squared distance of its nodes, below which it is round-off.
const TINY_FACET: f64 = 1e-13;

const NODE: u64 = 1 << 40;
const WALL: u64 = 2 << 40;
const FREE: u64 = 3 << 40;
const KIND: u64 = 3 << 40;

/// What is on the other side of a facet.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Side {
    /// The cell of another node.
    Node(usize),
    /// The constrained face with this index in [`Domain::constrained_faces`].
    Face(usize),
}

/// Facet of a cell: all of the common boundary with one neighbour or one constrained face.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Facet {
    /// What is on the other side.
    pub side: Side,
    /// Area times the unit normal out of the cell (m^2).
    pub area: Vector3<f64>,
    /// Centroid (m).
    pub centroid: Point3<f64>,
}

/// Voronoi cells of all nodes of a domain.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Voronoi {
    volumes: Vec<f64>,
    start: Vec<usize>,
    facets: Vec<Facet>,
}

/// How well the cells close and fill the domain, both relative.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Closure {
    /// `|sum V - V_domain| / V_domain`.
    pub volume: f64,
    /// Largest `|sum A| / sum |A|` over the cells.
    pub area: f64,
}

impl Voronoi {
    /// Number of cells, one per node.
    pub fn len(&self) -> usize {
        self.volumes.len()
    }

    /// True if there is no cell.
    pub fn is_empty(&self) -> bool {
        self.volumes.is_empty()
    }

    /// Volumes of the cells (m^3).
    pub fn volumes(&self) -> &[f64] {
        &self.volumes
    }

    /// Facets of the cell of a node: neighbours first, then constrained faces, each in ascending order.
    ///
    /// # Panics
    /// If there is no such node.
    pub fn facets(&self, node: usize) -> &[Facet] {
        &self.facets[self.start[node]..self.start[node + 1]]
    }

    /// Compares volumes with the domain and adds up the area vectors.
    pub fn closure(&self, domain: &Domain) -> Closure {
        let filled: f64 = self.volumes.iter().sum();
        let area = (0..self.len()).map(|i| {
            let sum: Vector3<f64> = self.facets(i).iter().map(|f| f.area).sum();
            let total: f64 = self.facets(i).iter().map(|f| f.area.norm()).sum();
            if total > 0.0 { sum.norm() / total } else { 0.0 }
        });
        Closure {
            volume: (filled / domain.volume() - 1.0).abs(),
            area: area.fold(0.0, f64::max),
        }
    }
}

impl Domain {
    /// Voronoi cells of all nodes, cut off at the constrained faces. The result does not depend on the thread count.
    ///
    /// # Errors
    /// `CellsDoNotFill` if a part of the domain is closest to a node behind a constrained face.
    pub fn voronoi(&self) -> Result<Voronoi> {
        let boxes = self
            .mesh
            .faces
            .iter()
            .map(|f| around(f.v.iter().map(|&v| &self.delaunay.points[v as usize]), 0.0));
        let walls = Bins::new(boxes.collect());
        let cells: Vec<(f64, Vec<Facet>)> = (0..self.nodes().len() as u32)
            .into_par_iter()
            .map_init(Work::default, |work, node| {
                work.cell(self, &walls, node);
                (work.volume, work.facets.clone())
            })
            .collect();
        let mut out = Voronoi {
            volumes: Vec::with_capacity(cells.len()),
            start: vec![0],
            facets: Vec::new(),
        };
        for (volume, facets) in cells {
            out.volumes.push(volume);
            out.facets.extend(facets);
            out.start.push(out.facets.len());
        }
        let closure = out.closure(self);
        if closure.volume > VOLUME_TOLERANCE {
            let filled = out.volumes.iter().sum();
            return Err(Error::CellsDoNotFill {
                filled,
                volume: self.volume(),
                tolerance: VOLUME_TOLERANCE,
            });
        }
        Ok(out)
    }
}

/// Sum over the pieces of one facet: area vector, and centroid times area, relative to the node.
#[derive(Debug, Clone, Copy)]
struct Piece {
    tag: u64,
    area: Vector3<f64>,
    moment: Vector3<f64>,
    weight: f64,
}

#[derive(Debug, Default)]
struct Work {
    star: Vec<u32>,
    queue: Vec<u32>,
    /// Neighbours with their position relative to the node, nearest first.
    near: Vec<(f64, u32, Vector3<f64>)>,
    pieces: Vec<Piece>,
    piece: Polyhedron,
    volume: f64,
    facets: Vec<Facet>,
}

impl Work {
    fn cell(&mut self, domain: &Domain, walls: &Bins, node: u32) {
        self.volume = 0.0;
        self.pieces.clear();
        self.facets.clear();
        domain.delaunay.star(node, &mut self.star);
        let seed = &domain.delaunay.points[node as usize];
        let within = self.star.iter().all(|&t| domain.inside[t as usize]);
        let reach = self
            .star
            .iter()
            .map(|&t| domain.centre[t as usize].norm_squared())
            .fold(0.0, f64::max)
            .sqrt();
        if within && !walls.any(&around([seed], reach * (1.0 + 1e-9))) {
            self.read_circumcentres(domain, node);
        } else {
            self.by_clipping(domain, node);
        }
        self.finish(seed);
    }

    fn add(&mut self, tag: u64, area: Vector3<f64>, moment: Vector3<f64>, weight: f64) {
        match self.pieces.iter_mut().find(|p| p.tag == tag) {
            Some(p) => {
                p.area += area;
                p.moment += moment;
                p.weight += weight;
            }
            None => self.pieces.push(Piece {
                tag,
                area,
                moment,
                weight,
            }),
        }
    }

    /// Every face at the node has a dual segment, which bounds the facets of its two other vertices.
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
                let Some(at) = face.iter().position(|&v| v == node) else {
                    continue;
                };
                if tet > n >> 2 {
                    continue;
                }
                let (p, q) = (centre(tet), centre(n >> 2));
                for (other, from, to) in [(face[(at + 1) % 3], &p, &q), (face[(at + 2) % 3], &q, &p)] {
                    let r = domain.delaunay.points[other as usize] - seed;
                    let m = r * 0.5;
                    let twice = (from - m).cross(&(to - m)).dot(&r);
                    let weight = 0.5 * twice / r.norm();
                    let area = r * (0.5 * twice / r.norm_squared());
                    self.volume += twice / 12.0;
                    self.add(
                        NODE | u64::from(other),
                        area,
                        (m + from + to) * (weight / 3.0),
                        weight,
                    );
                }
            }
        }
    }

    fn by_clipping(&mut self, domain: &Domain, node: u32) {
        let seed = domain.delaunay.points[node as usize];
        self.near.clear();
        for &t in &self.star {
            for &v in &domain.delaunay.tets[t as usize].v {
                if v != node && v != INF && !self.near.iter().any(|n| n.1 == v) {
                    let r = domain.delaunay.points[v as usize] - seed;
                    self.near.push((r.norm_squared(), v, r));
                }
            }
        }
        self.near.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        self.queue.clear();
        self.queue
            .extend(self.star.iter().filter(|&&t| domain.inside[t as usize]));
        let mut next = 0;
        while next < self.queue.len() {
            let tet = self.queue[next];
            next += 1;
            self.clip_one(domain, tet, &seed);
            let mut piece = std::mem::take(&mut self.piece);
            for (tag, face) in piece.faces() {
                let id = (tag & !KIND) as u32;
                if tag & KIND == FREE {
                    if !self.queue.contains(&id) {
                        self.queue.push(id);
                    }
                } else {
                    let weight = face.area.norm();
                    self.add(tag, face.area, face.centroid * weight, weight);
                }
            }
            self.volume += piece.volume();
            std::mem::swap(&mut self.piece, &mut piece);
        }
    }

    /// The part of one tetrahedron that is closest to the node.
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
            if *square > 4.0 * reach {
                break;
            }
            if self.piece.clip(r, 0.5 * square, NODE | u64::from(*v)) {
                if self.piece.is_empty() {
                    return;
                }
                reach = self.piece.reach();
            }
        }
    }

    fn finish(&mut self, seed: &Point3<f64>) {
        self.pieces.sort_unstable_by_key(|p| p.tag);
        let size = self.pieces.iter().map(|p| p.weight).fold(0.0, f64::max);
        for p in &self.pieces {
            if p.weight > TINY_FACET * size {
                let id = (p.tag & !KIND) as usize;
                let side = if p.tag & KIND == NODE {
                    Side::Node(id)
                } else {
                    Side::Face(id)
                };
                self.facets.push(Facet {
                    side,
                    area: p.area,
                    centroid: seed + p.moment / p.weight,
                });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::constraint::Surface;
    use crate::natural::tests::{blocks, grid, random};

    fn assert_closed(domain: &Domain) -> Voronoi {
        let cells = domain.voronoi().expect("cells fill the domain");
        let closure = cells.closure(domain);
        assert!(closure.volume < 1e-12 && closure.area < 1e-11, "{closure:?}");
        for i in 0..cells.len() {
            for f in cells.facets(i) {
                let Side::Node(j) = f.side else { continue };
                let back = cells.facets(j).iter().find(|g| g.side == Side::Node(i));
                let size = f.area.norm();
                match back {
                    Some(g) => {
                        assert!(
                            (f.area + g.area).norm() < 1e-10 * (size + 1e-3),
                            "{i} {j} {f:?} {g:?}"
                        );
                        assert!(
                            size < 1e-9 || (f.centroid - g.centroid).norm() < 1e-6,
                            "{i} {j} {f:?} {g:?}"
                        );
                    }
                    None => assert!(size < 1e-11, "{i} {j} {f:?}"),
                }
            }
        }
        cells
    }

    #[test]
    fn cells_fill_convex_domains() {
        for points in [
            random(300, 2),
            grid(5, 0.0, 1),
            grid(6, 0.3, 1),
            grid(5, 1e-14, 1),
            grid(5, 1e-7, 1),
        ] {
            assert_closed(&Domain::new(&points, &Surface::convex_hull()).expect("convex"));
        }
    }

    #[test]
    fn grid_cells_are_boxes() {
        let points = grid(5, 0.0, 1);
        let cells = assert_closed(&Domain::new(&points, &Surface::convex_hull()).expect("grid"));
        let middle = 62;
        assert!((cells.volumes()[middle] - 1.0 / 64.0).abs() < 1e-16);
        assert_eq!(cells.facets(middle).len(), 6);
        assert!((cells.volumes()[0] - 1.0 / 512.0).abs() < 1e-16);
    }

    #[test]
    fn cells_fill_a_re_entrant_block() {
        for jitter in [0.0, 0.3] {
            let (points, surface) = blocks(4, jitter, |i, j, _| i < 2 || j < 2);
            assert_closed(&Domain::new(&points, &surface).expect("L-shaped block"));
        }
    }

    #[test]
    fn cells_fill_a_cracked_cube() {
        let points = grid(5, 0.0, 0);
        let at = |i: usize, j: usize| i + 5 * (j + 10);
        let mut crack = Vec::new();
        for (i, j) in (0..8).map(|k| (k % 2, k / 2)) {
            crack.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            crack.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
        let domain = Domain::new(&points, &Surface::convex_hull().with_cracks(crack)).expect("cracked cube");
        let cells = assert_closed(&domain);
        let lips = |i: usize| {
            cells
                .facets(i)
                .iter()
                .filter(|f| matches!(f.side, Side::Face(_)))
                .count()
        };
        assert!(lips(at(1, 1)) > 0 && lips(at(3, 2)) == 0);
    }

    #[test]
    fn a_node_close_to_a_coarse_crack_is_an_error() {
        let mut points = grid(3, 0.0, 0);
        let corner = [[0.2, 0.2], [0.8, 0.2], [0.8, 0.8], [0.2, 0.8]];
        let first = points.len();
        points.extend(corner.map(|[x, y]| Point3::new(x, y, 0.3)));
        points.push(Point3::new(0.45, 0.4, 0.31));
        let crack = vec![[first, first + 1, first + 2], [first, first + 2, first + 3]];
        let domain = Domain::new(&points, &Surface::convex_hull().with_cracks(crack)).expect("cracked cube");
        assert!(matches!(domain.voronoi(), Err(Error::CellsDoNotFill { .. })));
    }
}
