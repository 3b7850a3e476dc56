//! Recovery of constrained faces in the Delaunay complex.

use super::mesh::{ON_FACE, in_circle, key};
use super::{FaceMesh, InsertedPoint, Recovery, Surface};
use crate::bins::{Bins, around};
use crate::delaunay::{Delaunay, joined};
use crate::domain::{ON_BOUNDARY, largest_coordinate};
use crate::error::{Error, Result};
use nalgebra::Point3;

/// Makes every constrained face a face of the complex. Returns the faces and a record of the steps taken. At
/// most `limit` points are inserted.
pub(crate) fn recover(
    delaunay: &mut Delaunay,
    surface: &Surface,
    limit: usize,
) -> Result<(FaceMesh, Recovery)> {
    let mut work = Work {
        mesh: FaceMesh::new(surface),
        record: Recovery::default(),
        star: Vec::new(),
        limit,
        delaunay,
    };
    // The usual case: a mesh whose faces its own nodes recover.
    if work.missing_faces().is_empty() {
        return Ok((work.mesh, work.record));
    }
    // Checked only if a face is missing: if all faces are in the complex, none can cross another.
    surface.check_intersections(&work.delaunay.points)?;
    work.swap_diagonals();
    work.split_at_nodes();
    loop {
        work.swap_diagonals();
        if work.missing_faces().is_empty() {
            return Ok((work.mesh, work.record));
        }
        // Edges before faces: a region can be divided only if all of its edges are in the complex.
        if work.insert_on_edges()? {
            // New points change the complex: swaps may recover more faces before further points are spent.
            continue;
        }
        let unrecovered = work.divide();
        if unrecovered.is_empty() {
            return Ok((work.mesh, work.record));
        }
        work.insert_on_faces(&unrecovered)?;
    }
}

struct Work<'a> {
    delaunay: &'a mut Delaunay,
    mesh: FaceMesh,
    record: Recovery,
    star: Vec<u32>,
    limit: usize,
}

impl Work<'_> {
    fn has_face(&mut self, v: [u32; 3]) -> bool {
        self.delaunay.face(v, &mut self.star).is_some()
    }

    fn has_edge(&mut self, (a, b): (u32, u32)) -> bool {
        self.delaunay.star(a, &mut self.star);
        self.star
            .iter()
            .any(|&t| self.delaunay.tets[t as usize].slot_of(b).is_some())
    }

    fn missing_faces(&mut self) -> Vec<u32> {
        (0..self.mesh.faces.len() as u32)
            .filter(|&f| !self.has_face(self.mesh.faces[f as usize].v))
            .collect()
    }

    /// Returns the edges of `faces` that are not in the complex, sorted (so that results do not depend on
    /// hashing).
    fn missing_edges(&mut self, faces: &[u32]) -> Vec<(u32, u32)> {
        let mut edges: Vec<_> = faces
            .iter()
            .flat_map(|&f| {
                let v = self.mesh.faces[f as usize].v;
                [key(v[0], v[1]), key(v[1], v[2]), key(v[2], v[0])]
            })
            .collect();
        edges.sort_unstable();
        edges.dedup();
        edges.retain(|&e| !self.has_edge(e));
        edges
    }

    /// Swaps diagonals (Lawson) in the flat patches around missing faces.
    fn swap_diagonals(&mut self) {
        // The perturbed circle test is the restriction of the sphere test to the plane. A flat patch
        // therefore ends in the triangulation that the complex has on it, if there is one.
        let missing = self.missing_faces();
        self.record.swapped += super::patch::adopt(self.delaunay, &mut self.mesh, &missing);
        let mut queue: Vec<(u32, u32)> = Vec::new();
        for f in self.missing_faces() {
            let v = self.mesh.faces[f as usize].v;
            queue.extend([key(v[0], v[1]), key(v[1], v[2]), key(v[2], v[0])]);
        }
        // Bounded: on patches that are flat up to round-off only, swaps need not come to an end.
        let mut allowed = 100 * (queue.len() + 10);
        while let Some(edge) = queue.pop() {
            let Some(pair) = self.mesh.flat_pair(&self.delaunay.points, edge) else {
                continue;
            };
            let [_, _, c, d] = pair;
            if allowed == 0 || !self.mesh.swappable(&self.delaunay.points, edge, c, d) {
                continue;
            }
            let (a, b) = edge;
            let present = |w: &mut Self, x: [u32; 3], y: [u32; 3]| {
                usize::from(w.has_face(x)) + usize::from(w.has_face(y))
            };
            // A swap counts by the faces that it recovers; where these are equal in number the circle
            // decides, as in the complex.
            let before = present(self, [a, b, c], [b, a, d]);
            let after = present(self, [c, d, a], [d, c, b]);
            let illegal = in_circle(&self.delaunay.points, [a, b, c, d]);
            if after > before || (after == before && before < 2 && illegal) {
                allowed -= 1;
                self.mesh.swap(edge, pair);
                self.record.swapped += 1;
                queue.extend([key(a, c), key(c, b), key(b, d), key(d, a)]);
            }
        }
    }

    /// Splits faces and edges at given nodes that lie on them, missing ones first.
    fn split_at_nodes(&mut self) {
        // Round-off of the coordinates may put nodes of a face's plane behind it, and the face into the
        // complex. It is split as well: a flat patch can adopt the triangles of the complex only if it has
        // all nodes of that plane.
        let round_off = ON_BOUNDARY * largest_coordinate(&self.delaunay.points);
        let boxes = self.delaunay.points.iter().map(|p| [*p, *p]).collect();
        let bins = Bins::new(boxes);
        let mut near = Vec::new();
        let missing = self.missing_faces();
        let mut queue: Vec<u32> = (0..self.mesh.faces.len() as u32).collect();
        // Missing faces are put last, so that they are popped first.
        queue.retain(|f| missing.binary_search(f).is_err());
        queue.extend(missing);
        while let Some(f) = queue.pop() {
            let v = self.mesh.faces[f as usize].v;
            let corners = v.map(|v| self.delaunay.points[v as usize]);
            let size = (0..3)
                .map(|k| (corners[k] - corners[(k + 1) % 3]).norm())
                .fold(0.0, f64::max);
            let tolerance = if self.has_face(v) {
                // A face that is in the complex needs no wider tolerance: only nodes of its own plane concern
                // it.
                round_off
            } else {
                ON_FACE * size
            };
            bins.overlapping(&around(corners.iter(), tolerance), &mut near);
            let hit = near
                .iter()
                // A duplicate is a corner of no tetrahedron and cannot become a corner of a face.
                .filter(|&&m| !v.contains(&m) && self.delaunay.at_vertex[m as usize] != crate::tet::NONE);
            let locate = |m: u32| on_face(&corners, &self.delaunay.points[m as usize], tolerance);
            // The node nearest to the middle gives well-shaped pieces.
            let middle = Point3::from((corners[0].coords + corners[1].coords + corners[2].coords) / 3.0);
            let off_middle = |m: u32| (self.delaunay.points[m as usize] - middle).norm_squared();
            let best = hit
                .filter_map(|&m| locate(m).map(|place| (m, place)))
                .min_by(|x, y| off_middle(x.0).total_cmp(&off_middle(y.0)));
            let Some((m, place)) = best else { continue };
            let before = self.mesh.faces.len() as u32;
            match place {
                Place::Face => self.mesh.split_face(f, m),
                Place::Edge(k) => {
                    let edge = key(v[k], v[(k + 1) % 3]);
                    // All faces at the edge are split with it: their pieces may hold further nodes.
                    queue.extend(self.mesh.edges.get(&edge).into_iter().flatten().copied());
                    self.mesh.split_edge(edge, m);
                }
            }
            self.record.split_at_nodes += 1;
            queue.push(f);
            queue.extend(before..self.mesh.faces.len() as u32);
        }
    }

    /// Inserts points on missing edges that no swap can recover. Returns false if there are no such edges.
    fn insert_on_edges(&mut self) -> Result<bool> {
        let faces = self.missing_faces();
        let mut has_inserted = false;
        for edge in self.missing_edges(&faces) {
            // Looked at again: an earlier insertion may have split or recovered this edge.
            if self.mesh.edges.contains_key(&edge)
                && !self.has_edge(edge)
                && self.mesh.flat_pair(&self.delaunay.points, edge).is_none()
            {
                self.insert_on_edge(edge)?;
                has_inserted = true;
            }
        }
        Ok(has_inserted)
    }

    /// Splits an edge at its middle, or near it if one of its ends is a given node.
    fn insert_on_edge(&mut self, edge: (u32, u32)) -> Result<()> {
        let [a, b] = [edge.0, edge.1].map(|v| self.delaunay.points[v as usize]);
        let first_new = self.record.inserted.first().map_or(usize::MAX, |i| i.node);
        // Shells are for given nodes: an edge between two of them, or between two inserted points, is halved.
        let old = [edge.0, edge.1].map(|v| (v as usize) < first_new);
        let length = (b - a).norm();
        // Next to one given node the distance is a power of two. Edges that meet there at a small angle are
        // then cut at equal distances and stop encroaching on each other.
        let shell = (0.5 * length).log2().round().exp2() / length;
        let fraction = match old {
            [true, false] => shell,
            [false, true] => 1.0 - shell,
            _ => 0.5,
        };
        let origin = self
            .mesh
            .edges
            .get(&edge)
            .and_then(|l| l.first())
            .map_or(0, |&f| self.mesh.faces[f as usize].origin);
        let m = self.insert(a + (b - a) * fraction, origin, edge.0)?;
        // On an edge as short as round-off the point coincides with an end.
        if m != edge.0 && m != edge.1 {
            self.mesh.split_edge(edge, m);
        }
        Ok(())
    }

    /// Divides the tetrahedra that missing faces cut. Returns the faces that could not be recovered; the
    /// complex is then as before.
    fn divide(&mut self) -> Vec<u32> {
        let missing = self.missing_faces();
        let undivided = self.delaunay.clone();
        let mut unrecovered = super::carve::carve(self.delaunay, &self.mesh, &missing);
        if unrecovered.is_empty() {
            // Carving one region may have destroyed a face that was present before.
            unrecovered = self.missing_faces();
        }
        if unrecovered.is_empty() {
            self.record.divided = missing.len();
            self.delaunay.before = Some(joined(&undivided));
        } else {
            // Later points can only be inserted in a Delaunay complex.
            *self.delaunay = undivided;
        }
        unrecovered
    }

    /// Inserts a point on each of some missing faces: the circumcentre if it is well inside, else a point on
    /// the longest edge.
    fn insert_on_faces(&mut self, faces: &[u32]) -> Result<()> {
        for &f in faces {
            let face = self.mesh.faces[f as usize];
            if self.has_face(face.v) {
                continue;
            }
            let p = face.v.map(|v| self.delaunay.points[v as usize]);
            // A face may have been recovered by the points inserted for the faces before it.
            let square = |k: usize| (p[(k + 1) % 3] - p[k]).norm_squared();
            let longest = (0..3)
                .max_by(|&i, &j| square(i).total_cmp(&square(j)))
                .unwrap_or(0);
            // Barycentric coordinates of the circumcentre, times a common factor.
            // For an obtuse triangle one of them is negative: the circumcentre is outside.
            let l = [square(1), square(2), square(0)];
            let w = [0, 1, 2].map(|k: usize| l[k] * (l[(k + 1) % 3] + l[(k + 2) % 3] - l[k]));
            let sum = w[0] + w[1] + w[2];
            // Closer to an edge than this the three pieces would be slivers.
            if w.iter().all(|x| *x > 0.1 * sum) {
                let centre = (p[0].coords * w[0] + p[1].coords * w[1] + p[2].coords * w[2]) / sum;
                let m = self.insert(centre.into(), face.origin, face.v[0])?;
                if !face.v.contains(&m) {
                    self.mesh.split_face(f, m);
                }
            } else {
                self.insert_on_edge(key(face.v[longest], face.v[(longest + 1) % 3]))?;
            }
        }
        Ok(())
    }

    fn insert(&mut self, p: Point3<f64>, origin: u32, start_node: u32) -> Result<u32> {
        if self.record.inserted.len() >= self.limit {
            return Err(self.give_up());
        }
        let count = self.delaunay.points.len();
        let v = self
            .delaunay
            .insert(p, self.delaunay.at_vertex[start_node as usize])
            .0;
        // The point may be a node that exists already: only new ones are reported.
        if v as usize == count {
            self.record.inserted.push(InsertedPoint {
                node: count,
                face: origin as usize,
            });
        }
        Ok(v)
    }

    fn give_up(&mut self) -> Error {
        let missing = self.missing_faces();
        let mut faces: Vec<usize> = missing
            .iter()
            .map(|&f| self.mesh.faces[f as usize].origin as usize)
            .collect();
        faces.sort_unstable();
        faces.dedup();
        let count = faces.len();
        // The message names a few faces; the count tells the rest.
        faces.truncate(16);
        Error::FacesNotRecovered {
            faces,
            count,
            inserted: self.record.inserted.len(),
            limit: self.limit,
        }
    }
}

enum Place {
    Face,
    Edge(usize),
}

/// Returns where a point lies on a face (its interior or edge `k`), within a distance; `None` off the face or
/// at a corner.
fn on_face(corners: &[Point3<f64>; 3], p: &Point3<f64>, tolerance: f64) -> Option<Place> {
    let [a, b, c] = corners;
    let n = (b - a).cross(&(c - a));
    let area = n.norm();
    // Height times area on both sides: no division by the area of a sliver.
    if n.dot(&(p - a)).abs() > tolerance * area {
        return None;
    }
    let mut edge = None;
    for k in 0..3 {
        let (s, e) = (&corners[k], &corners[(k + 1) % 3]);
        // A node at a corner is no new node of the face: it would make a face without area.
        if (p - s).norm() <= tolerance {
            return None;
        }
        // Distance from the edge, positive inside: all three decide between the interior and an edge.
        let inward = (e - s).cross(&(p - s)).dot(&n) / (area * (e - s).norm());
        if inward < -tolerance {
            return None;
        }
        if inward <= tolerance {
            edge = Some(Place::Edge(k));
        }
    }
    Some(edge.unwrap_or(Place::Face))
}
