//! Clipping of convex bodies that stays closed whatever the round-off.
//!
//! Corners are stored once, and each is classified once per plane: inside, on the plane or outside. The part
//! of every face that remains follows from this classification alone.

use super::{HalfSpace, Polyhedron};
use crate::Real;
use nalgebra::{Point3, Vector3};

/// Round-off of the evaluation of a plane at a point, in units of epsilon times the size of its terms.
const PLANE: f64 = 8.0;
/// Distance below which two corners are one, in units of epsilon times the largest coordinate.
const WELD: f64 = 32.0;

/// Position of a corner relative to a plane.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Side {
    Inside,
    On,
    Outside,
}

/// A convex body whose faces share their corners.
#[derive(Debug, Clone)]
pub(crate) struct Body<T: Real> {
    points: Vec<Point3<T>>,
    faces: Vec<Vec<u32>>,
    /// Largest coordinate \[m\].
    reach: T,
}

impl<T: Real> Body<T> {
    /// Welds the corners of a polyhedron's faces.
    pub(crate) fn new(polyhedron: &Polyhedron<T>) -> Self {
        // Bodies have some ten corners: comparing all pairs is cheaper than a search structure.
        let all_corners = || polyhedron.faces.iter().flatten();
        let reach = all_corners().fold(T::zero(), |m, p| m.max(p.coords.amax()));
        let mut out = Self {
            points: Vec::with_capacity(2 * polyhedron.faces.len()),
            faces: Vec::with_capacity(polyhedron.faces.len()),
            reach,
        };
        for face in &polyhedron.faces {
            let mut corners = Vec::with_capacity(face.len());
            for p in face {
                let known = (0..out.points.len()).find(|k| out.coincide(&out.points[*k], p));
                let k = known.unwrap_or_else(|| {
                    out.points.push(*p);
                    out.points.len() - 1
                });
                push_corner(&mut corners, k as u32);
            }
            out.add_face(corners);
        }
        out
    }

    fn coincide(&self, a: &Point3<T>, b: &Point3<T>) -> bool {
        (a - b).amax() <= self.reach * T::epsilon() * T::of(WELD)
    }

    /// Adds a face unless it has shrunk to an edge.
    fn add_face(&mut self, mut corners: Vec<u32>) {
        // Welding may have made neighbouring corners one; a loop closes by itself.
        while corners.len() > 1 && corners.first() == corners.last() {
            corners.pop();
        }
        if corners.len() >= 3 {
            self.faces.push(corners);
        }
    }

    fn side(&self, plane: &HalfSpace<T>, x: &Point3<T>) -> (Side, T) {
        // The terms of the excess may cancel: their size bounds its round-off.
        let terms = plane.normal.amax() * self.reach + plane.offset.abs();
        let bound = terms * T::epsilon() * T::of(PLANE);
        let excess = plane.excess(x);
        let side = if excess > bound {
            Side::Outside
        } else if excess < -bound {
            Side::Inside
        } else {
            Side::On
        };
        (side, excess)
    }

    /// Part of the body within all half-spaces; `None` if no positive volume is left.
    pub(crate) fn within(&self, planes: &[HalfSpace<T>]) -> Option<Polyhedron<T>> {
        // Most pairs of cells whose boxes meet are separated by one face: look for it before copying the
        // body.
        let parted = |plane: &HalfSpace<T>| {
            let inside = |x: &Point3<T>| self.side(plane, x).0 == Side::Inside;
            !self.points.iter().any(inside)
        };
        if planes.iter().any(parted) {
            return None;
        }
        let mut body = self.clone();
        for plane in planes {
            if !body.clip(plane) {
                return None;
            }
        }
        Some(body.polyhedron())
    }

    /// Cuts off the part beyond a plane; returns `false` if nothing is left.
    fn clip(&mut self, plane: &HalfSpace<T>) -> bool {
        // Before anything is cut, so that all faces at a corner see the same side.
        let mut sides: Vec<(Side, T)> = self.points.iter().map(|x| self.side(plane, x)).collect();
        // Cuts of earlier planes leave corners that no face uses any more.
        let used = |s: Side| {
            let mut corners = self.faces.iter().flatten();
            corners.any(|k| sides[*k as usize].0 == s)
        };
        let (inside, outside) = (used(Side::Inside), used(Side::Outside));
        // No corner beyond the plane, or none within: everything stays or goes.
        if !inside || !outside {
            return inside;
        }
        let mut cuts: Vec<([u32; 2], u32)> = Vec::new();
        let mut rim: Vec<[u32; 2]> = Vec::new();
        for face in std::mem::take(&mut self.faces) {
            let mut piece = Vec::with_capacity(face.len() + 1);
            for (k, &a) in face.iter().enumerate() {
                let b = face[(k + 1) % face.len()];
                let [(sa, _), (sb, _)] = [a, b].map(|c| sides[c as usize]);
                if sa != Side::Outside {
                    push_corner(&mut piece, a);
                }
                if matches!(
                    (sa, sb),
                    (Side::Inside, Side::Outside) | (Side::Outside, Side::Inside)
                ) {
                    // Always from the inner to the outer end: the other face at the edge finds the same cut.
                    let edge = if sa == Side::Inside { [a, b] } else { [b, a] };
                    let cut = self.cut(edge, &mut sides, &mut cuts);
                    push_corner(&mut piece, cut);
                }
            }
            let before = self.faces.len();
            self.add_face(piece);
            if let Some(remaining) = self.faces[before..].first() {
                for (k, &a) in remaining.iter().enumerate() {
                    let edge = [a, remaining[(k + 1) % remaining.len()]];
                    // Edges in the plane bound the cap, unless both faces at the edge remain.
                    if edge.iter().all(|c| sides[*c as usize].0 == Side::On) {
                        toggle_edge(&mut rim, edge);
                    }
                }
            }
        }
        // The cap is bounded by the edges in the plane that belong to only one remaining face. A face that
        // nearly lies in the plane is therefore kept, or replaced by the cap, or shares its area with the
        // cap. It is never counted twice, and the parts on the two sides of a plane add up to the whole.
        self.cap(rim, &plane.normal);
        // Fewer faces enclose no volume.
        self.faces.len() >= 4
    }

    /// Number of the corner at which an edge, from its inner to its outer end, meets the plane. Both faces of
    /// the edge get the same corner.
    fn cut(&mut self, edge: [u32; 2], sides: &mut Vec<(Side, T)>, cuts: &mut Vec<([u32; 2], u32)>) -> u32 {
        // Computed once per edge: two computations could differ in the last digit and open the body.
        if let Some((_, k)) = cuts.iter().find(|(e, _)| *e == edge) {
            return *k;
        }
        let [(p, ep), (q, eq)] = edge.map(|c| (self.points[c as usize], sides[c as usize].1));
        let x = p + (q - p) * (ep / (ep - eq));
        // A cut at a corner on the plane is that corner: two corners so close would leave a sliver.
        let on = |k: &usize| sides[*k].0 == Side::On && self.coincide(&self.points[*k], &x);
        let k = (0..self.points.len()).find(on).unwrap_or_else(|| {
            self.points.push(x);
            sides.push((Side::On, T::zero()));
            self.points.len() - 1
        }) as u32;
        cuts.push((edge, k));
        k
    }

    /// Closes the body with the loops that its free edges form.
    fn cap(&mut self, mut rim: Vec<[u32; 2]>, normal: &Vector3<T>) {
        // More than one loop is possible if a face nearly lies in the plane.
        while let Some([first, mut last]) = rim.pop() {
            let mut corners = vec![first, last];
            while last != first {
                let Some(k) = rim.iter().position(|e| e.contains(&last)) else {
                    break;
                };
                let [a, b] = rim.swap_remove(k);
                last = if a == last { b } else { a };
                if last != first {
                    corners.push(last);
                }
            }
            if last != first {
                // The faces given did not share their corners. The cap of a convex body is convex, so order
                // its corners.
                corners.extend(rim.drain(..).flatten());
                corners = self.sorted_by_angle(corners, normal);
            }
            self.add_face(corners);
        }
    }

    /// Corners of a plane section in the order of their angles about its centre.
    fn sorted_by_angle(&self, mut corners: Vec<u32>, normal: &Vector3<T>) -> Vec<u32> {
        corners.sort_unstable();
        corners.dedup();
        let point = |k: &u32| self.points[*k as usize];
        let sum = corners.iter().fold(Vector3::zeros(), |s, k| s + point(k).coords);
        let centre = Point3::from(sum / T::of(corners.len() as f64));
        let n = normal.normalize();
        // An axis that is not close to the normal.
        let e = if n.x.abs() < T::of(0.7) {
            Vector3::x()
        } else {
            Vector3::y()
        };
        let u = n.cross(&e).normalize();
        let v = n.cross(&u);
        let angle = |k: &u32| {
            let d = point(k) - centre;
            d.dot(&v).atan2(d.dot(&u)).as_f64()
        };
        corners.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
        corners
    }

    fn polyhedron(&self) -> Polyhedron<T> {
        let face = |f: &Vec<u32>| f.iter().map(|k| self.points[*k as usize]).collect();
        Polyhedron {
            faces: self.faces.iter().map(face).collect(),
        }
    }
}

/// Appends a corner unless it is the last one already.
fn push_corner(corners: &mut Vec<u32>, k: u32) {
    if corners.last() != Some(&k) {
        corners.push(k);
    }
}

/// Adds an edge, or removes it if it is there: the edges that remain belong to one face only.
fn toggle_edge(rim: &mut Vec<[u32; 2]>, edge: [u32; 2]) {
    let [a, b] = edge;
    match rim.iter().position(|e| *e == [a, b] || *e == [b, a]) {
        Some(k) => {
            rim.swap_remove(k);
        }
        None => rim.push(edge),
    }
}
