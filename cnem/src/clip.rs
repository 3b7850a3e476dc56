//! Clipping of convex polyhedra by half spaces.

use nalgebra::Vector3;

/// Convex polyhedron: faces with a tag each, corners counter-clockwise from outside.
#[derive(Debug, Clone, Default)]
pub(crate) struct Polyhedron {
    points: Vec<Vector3<f64>>,
    /// End of each face in `points`, and its tag.
    faces: Vec<(usize, u64)>,
    spare: Vec<Vector3<f64>>,
    spare_faces: Vec<(usize, u64)>,
    cap: Vec<Vector3<f64>>,
    angles: Vec<(f64, Vector3<f64>)>,
}

/// Area vector and centroid of one face.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct FaceSum {
    pub(crate) area: Vector3<f64>,
    pub(crate) centroid: Vector3<f64>,
}

impl Polyhedron {
    /// Resets to a tetrahedron of positive volume, with faces tagged in the order of [`crate::tet::FACES`].
    pub(crate) fn set_tetrahedron(&mut self, corners: [Vector3<f64>; 4], tags: [u64; 4]) {
        self.points.clear();
        self.faces.clear();
        for (face, tag) in crate::tet::FACES.iter().zip(tags) {
            self.points.extend(face.map(|k| corners[k]));
            self.faces.push((self.points.len(), tag));
        }
    }

    /// Resets to a cube about the origin.
    pub(crate) fn set_cube(&mut self, half: f64, tag: u64) {
        self.points.clear();
        self.faces.clear();
        for axis in 0..3 {
            for sign in [1.0, -1.0] {
                for (u, v) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
                    let mut p = Vector3::zeros();
                    p[axis] = half * sign;
                    p[(axis + 1) % 3] = half * u * sign;
                    p[(axis + 2) % 3] = half * v;
                    self.points.push(p);
                }
                self.faces.push((self.points.len(), tag));
            }
        }
    }

    /// Returns whether nothing is left.
    pub(crate) fn is_empty(&self) -> bool {
        self.faces.is_empty()
    }

    /// Returns the largest squared distance of a corner from the origin.
    pub(crate) fn reach(&self) -> f64 {
        self.points.iter().map(Vector3::norm_squared).fold(0.0, f64::max)
    }

    /// Returns the largest distance of a corner beyond a plane.
    pub(crate) fn excess(&self, normal: &Vector3<f64>, offset: f64) -> f64 {
        let distances = self.points.iter().map(|p| normal.dot(p) - offset);
        distances.fold(f64::NEG_INFINITY, f64::max)
    }

    /// Keeps the part with `normal . y <= offset`; the cut gets `tag`. Returns whether anything was cut off.
    pub(crate) fn clip(&mut self, normal: &Vector3<f64>, offset: f64, tag: u64) -> bool {
        self.clip_near(normal, offset, tag, 0.0, |_| false)
    }

    /// Like `clip`; corners with `|normal . y - offset| <= snap` count as lying on the plane. A face all of
    /// whose corners lie on the plane gets `tag` if `free` accepts the face's tag.
    pub(crate) fn clip_near(
        &mut self,
        normal: &Vector3<f64>,
        offset: f64,
        tag: u64,
        snap: f64,
        free: impl Fn(u64) -> bool,
    ) -> bool {
        let place = |p: &Vector3<f64>| {
            let s = normal.dot(p) - offset;
            // Distances within `snap` become exactly zero, so that every later comparison with zero takes the
            // same side.
            if s.abs() <= snap { 0.0 } else { s }
        };
        let (mut before, mut on_plane, mut behind) = (false, false, false);
        for p in &self.points {
            let s = place(p);
            before |= s < 0.0;
            behind |= s > 0.0;
            on_plane |= s == 0.0;
        }
        // Nothing lies in front of the plane: faces that only touch it bound no volume.
        if !before {
            self.points.clear();
            self.faces.clear();
            return true;
        }
        // A face in the plane coincides with the cut. Round-off, which puts it before or behind the plane,
        // must not decide about its area.
        if on_plane {
            let mut start = 0;
            for (end, face_tag) in &mut self.faces {
                let polygon = &self.points[start..*end];
                start = *end;
                if free(*face_tag) && polygon.iter().all(|p| place(p) == 0.0) {
                    *face_tag = tag;
                }
            }
        }
        if behind {
            self.cut(normal, place, tag);
        }
        behind
    }

    /// Removes the part behind the plane.
    fn cut(&mut self, normal: &Vector3<f64>, place: impl Fn(&Vector3<f64>) -> f64, tag: u64) {
        self.spare.clear();
        self.spare_faces.clear();
        self.cap.clear();
        let mut start = 0;
        for &(end, face_tag) in &self.faces {
            let polygon = &self.points[start..end];
            start = end;
            let first = self.spare.len();
            for (i, p) in polygon.iter().enumerate() {
                let q = &polygon[(i + 1) % polygon.len()];
                // The signs are taken anew from the same function for each face: both faces at an edge see
                // the same bits.
                let (sp, sq) = (place(p), place(q));
                if sp <= 0.0 {
                    // A corner on the plane belongs to the face that stays and to the cap.
                    self.spare.push(*p);
                    if sp >= 0.0 {
                        self.cap.push(*p);
                    }
                }
                if sp < 0.0 && sq > 0.0 || sp > 0.0 && sq < 0.0 {
                    let cut = crossing(p, q, sp, sq);
                    self.spare.push(cut);
                    self.cap.push(cut);
                }
            }
            // A face that only touches the plane keeps an edge or a corner: it has no area and would be no
            // polygon.
            if self.spare.len() >= first + 3 {
                self.spare_faces.push((self.spare.len(), face_tag));
            } else {
                self.spare.truncate(first);
            }
        }
        self.push_cap(normal, tag);
        std::mem::swap(&mut self.points, &mut self.spare);
        std::mem::swap(&mut self.faces, &mut self.spare_faces);
        // Fewer than four faces bound no volume.
        if self.faces.len() < 4 {
            self.points.clear();
            self.faces.clear();
        }
    }

    /// Orders the points of the cut around their mean and adds the polygon as a face.
    fn push_cap(&mut self, normal: &Vector3<f64>, tag: u64) {
        if self.cap.len() < 3 {
            return;
        }
        let middle = self.cap.iter().sum::<Vector3<f64>>() / self.cap.len() as f64;
        let farthest = self
            .cap
            .iter()
            .map(|p| p - middle)
            .fold(Vector3::zeros(), |a: Vector3<f64>, b| {
                if b.norm_squared() > a.norm_squared() { b } else { a }
            });
        // The axis to the farthest point is the best conditioned: a nearer one could be round-off in length.
        let v = normal.cross(&farthest);
        let u = v.cross(normal);
        let (u, v) = (u / u.norm(), v / v.norm());
        self.angles.clear();
        // Angles order the points whatever order the faces contributed them in; the section is convex.
        self.angles.extend(self.cap.iter().map(|p| {
            let d = p - middle;
            (d.dot(&v).atan2(d.dot(&u)), *p)
        }));
        self.angles.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let first = self.spare.len();
        for (_, p) in &self.angles {
            // Two faces meet at each corner of the cut and contribute it with the same bits; it counts once.
            if self.spare.len() == first || self.spare.last() != Some(p) {
                self.spare.push(*p);
            }
        }
        if self.spare.len() >= first + 3 {
            self.spare_faces.push((self.spare.len(), tag));
        } else {
            self.spare.truncate(first);
        }
    }

    /// Returns the corners of every face.
    pub(crate) fn loops(&self) -> impl Iterator<Item = &[Vector3<f64>]> {
        let mut start = 0;
        self.faces.iter().map(move |&(end, _)| {
            let polygon = &self.points[start..end];
            start = end;
            polygon
        })
    }

    /// Returns tag, area vector and centroid of every face.
    pub(crate) fn faces(&self) -> impl Iterator<Item = (u64, FaceSum)> + '_ {
        let mut start = 0;
        self.faces.iter().map(move |&(end, tag)| {
            let polygon = &self.points[start..end];
            start = end;
            (tag, face_sum(polygon))
        })
    }

    /// Returns the volume.
    pub(crate) fn volume(&self) -> f64 {
        // From a corner of the polyhedron: about a far origin the pyramids would cancel.
        let o = self.points.first().copied().unwrap_or_default();
        self.faces()
            .map(|(_, f)| f.area.dot(&(f.centroid - o)))
            .sum::<f64>()
            / 3.0
    }
}

/// Returns the point where an edge meets the plane.
fn crossing(p: &Vector3<f64>, q: &Vector3<f64>, sp: f64, sq: f64) -> Vector3<f64> {
    // Both faces at the edge get the same bits: the computation always starts from the end in front of the
    // plane.
    if sp < 0.0 {
        p + (q - p) * (sp / (sp - sq))
    } else {
        q + (p - q) * (sq / (sq - sp))
    }
}

fn face_sum(polygon: &[Vector3<f64>]) -> FaceSum {
    let o = polygon[0];
    let mut area = Vector3::zeros();
    // A fan from the first corner: differences are small, so the area of a small face far away keeps its
    // digits.
    for pair in polygon.windows(2) {
        area += (pair[0] - o).cross(&(pair[1] - o)) * 0.5;
    }
    // The projection on the total area weights the fan's triangles with their sign.
    let square = area.norm_squared();
    let mut centroid = o;
    if square > 0.0 {
        for pair in polygon.windows(2) {
            let part = (pair[0] - o).cross(&(pair[1] - o)).dot(&area) * 0.5 / square;
            centroid += (pair[0] + pair[1] - o * 2.0) * (part / 3.0);
        }
    }
    FaceSum { area, centroid }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clipped_cube() {
        let mut cube = Polyhedron::default();
        cube.set_cube(1.0, 7);
        assert!((cube.volume() - 8.0).abs() < 1e-14 && (cube.reach() - 3.0).abs() < 1e-15);
        assert!(cube.clip(&Vector3::new(1.0, 1.0, 1.0), 2.0, 9));
        // The corner cut off is a tetrahedron with three edges of length 1.
        assert!((cube.volume() - (8.0 - 1.0 / 6.0)).abs() < 1e-14);
        let total: Vector3<f64> = cube.faces().map(|f| f.1.area).sum();
        assert!(total.norm() < 1e-14);
        assert!(!cube.clip(&Vector3::new(1.0, 0.0, 0.0), 1.0, 9));
        cube.clip(&Vector3::new(1.0, 0.0, 0.0), -1.5, 9);
        assert!(cube.is_empty());
    }
}
