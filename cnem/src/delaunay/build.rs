//! Construction of the complex from a set of points.

use super::Delaunay;
use super::insert::Inserted;
use crate::error::{Error, Result};
use crate::hilbert::insertion_order;
use crate::predicates::{collinear, orient3d};
use crate::tet::{INF, NONE, Tet};
use nalgebra::Point3;
use std::cmp::Ordering;

/// Tetrahedra are numbered with 30 bits (two bits are for the slot), and there may be about eight per node.
const MAX_NODES: usize = 100_000_000;

pub(super) fn build(points: &[Point3<f64>]) -> Result<Delaunay> {
    check(points)?;
    let order = insertion_order(points);
    let sorted: Vec<Point3<f64>> = order.iter().map(|&i| points[i as usize]).collect();
    let first = first_simplex(&sorted)?;
    // The rank is the caller's index: ties do not depend on the order of insertion.
    let mut delaunay = Delaunay::empty(sorted, order);
    delaunay.start(first);
    // The last tetrahedron is near the next point: consecutive points are close along the curve.
    let mut hint = 0;
    for v in 0..points.len() as u32 {
        if first.contains(&v) {
            continue;
        }
        match delaunay.insert_vertex(v, hint) {
            Inserted::At(tet) => hint = tet,
            Inserted::Duplicate(kept) => {
                let pair = [v, kept].map(|i| delaunay.rank[i as usize] as usize);
                delaunay.duplicates.push((pair[0], pair[1]));
            }
        }
    }
    delaunay.finish(points);
    Ok(delaunay)
}

fn check(points: &[Point3<f64>]) -> Result<()> {
    if points.len() > MAX_NODES {
        return Err(Error::TooManyNodes {
            nodes: points.len(),
            limit: MAX_NODES,
        });
    }
    match points.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
        Some(node) => Err(Error::NonFinite {
            node,
            point: points[node].into(),
        }),
        None => Ok(()),
    }
}

/// Returns four affinely independent points, positively oriented.
fn first_simplex(points: &[Point3<f64>]) -> Result<[u32; 4]> {
    let nodes = points.len();
    let a = points.first().ok_or(Error::TooFewNodes { found: 0 })?;
    let find = |test: &dyn Fn(&Point3<f64>) -> bool| points.iter().position(test);
    let b = find(&|p| p != a).ok_or(Error::TooFewNodes { found: 1 })?;
    let c = find(&|p| !collinear(a, &points[b], p))
        .ok_or_else(|| few_or(points, Error::AllCollinear { nodes }))?;
    let d = find(&|p| orient3d(a, &points[b], &points[c], p) != Ordering::Equal)
        .ok_or_else(|| few_or(points, Error::AllCoplanar { nodes }))?;
    let [b, c, d] = [b, c, d].map(|i| i as u32);
    let positive =
        orient3d(a, &points[b as usize], &points[c as usize], &points[d as usize]) == Ordering::Greater;
    Ok(if positive { [0, b, c, d] } else { [0, c, b, d] })
}

/// Returns the given error, or `TooFewNodes` if fewer than four points are distinct.
fn few_or(points: &[Point3<f64>], error: Error) -> Error {
    let mut distinct: Vec<Point3<f64>> = Vec::with_capacity(4);
    for p in points {
        if !distinct.contains(p) {
            distinct.push(*p);
        }
        if distinct.len() == 4 {
            return error;
        }
    }
    Error::TooFewNodes {
        found: distinct.len(),
    }
}

impl Delaunay {
    /// Creates one finite tetrahedron and its four ghosts.
    fn start(&mut self, v: [u32; 4]) {
        // Infinity stands in slot 3, where `Tet::is_ghost` looks for it.
        let mut tets = vec![Tet { v, n: [NONE; 4] }];
        for slot in 0..4 {
            let [a, b, c] = tets[0].face(slot);
            tets.push(Tet {
                v: [a, b, c, INF],
                n: [NONE; 4],
            });
        }
        for i in 0..tets.len() {
            for slot in 0..4 {
                let face = tets[i].face(slot);
                for (j, candidate) in tets.iter().enumerate() {
                    if let (true, Some(back)) = (j != i, candidate.slot_opposite(face)) {
                        tets[i].n[slot] = (j << 2 | back) as u32;
                        break;
                    }
                }
            }
        }
        self.tets = tets;
        self.tets.reserve(self.points.len() * 7);
        self.work.grow_marks(self.tets.len());
    }

    /// Returns to the caller's numbering; drops unused slots.
    fn finish(&mut self, points: &[Point3<f64>]) {
        self.compact();
        // Until here the rank was the way back to the caller's numbers. From now on index and rank are the
        // same.
        let order = std::mem::take(&mut self.rank);
        for t in &mut self.tets {
            for v in &mut t.v {
                if *v != INF {
                    *v = order[*v as usize];
                }
            }
        }
        self.points.clear();
        self.points.extend_from_slice(points);
        // The walk finds duplicates in the order of insertion; sorted, the first pair does not depend on it.
        self.duplicates.sort_unstable();
        self.at_vertex = vec![NONE; points.len()];
        self.refresh_at_vertex(0);
    }

    /// Records one tetrahedron for each vertex of the tetrahedra from `first` on.
    pub(super) fn refresh_at_vertex(&mut self, first: usize) {
        for (i, t) in self.tets.iter().enumerate().skip(first) {
            for &v in &t.v {
                if v != INF {
                    self.at_vertex[v as usize] = i as u32;
                }
            }
        }
    }
}
