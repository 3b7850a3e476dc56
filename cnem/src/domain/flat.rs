//! Flat tetrahedra: tetrahedra that exist only because of the round-off of coordinates.
//!
//! Nodes that ought to lie in one plane or on one circle do so only up to the round-off of their coordinates.
//! The complex is exact for the coordinates as they are, and so contains tetrahedra without thickness: on
//! oblique planar faces, between the triangles of the face and those of its exact hull; along straight edges;
//! and inside, between two pairs of triangles over the same four cocircular nodes. Their orientation,
//! circumcentre and volume are meaningless. A tetrahedron is flat if its lowest height is at most
//! [`Domain::tolerance`], the distance below which a point cannot be told from the boundary either.
//!
//! - Flat tetrahedra next to constrained faces leave the domain, one after the other from outside. The faces
//!   behind them become the constrained ones: a planar patch remains a patch, made of faces of tetrahedra
//!   with a thickness.
//! - Flat tetrahedra inside belong to no cell, have no volume and are no elements. They remain as connections
//!   ([`Domain::glued`]) through which searches pass. All empty spheres through their four nodes belong to
//!   the same Voronoi edge, so that a flat tetrahedron takes the centre of a neighbour.

use super::Domain;
use crate::circumcentre::six_volumes;
use crate::constraint::Face;
use crate::error::{Error, Result};
use crate::tet::FACES;
use nalgebra::{Point3, Vector3};

/// Ratio of lowest height to longest edge below which a tetrahedron's own linear functions are not used:
/// their error is `1e-16 / ratio²`, while functions extrapolated from a thick tetrahedron next to it have an
/// error of `1e-16`.
const THIN: f64 = 1e-6;

/// Returns whether the lowest height of a tetrahedron is at most `limit` \[m\].
pub(crate) fn is_flat(corners: [&Point3<f64>; 4], limit: f64) -> bool {
    let (widest, longest) = sizes(corners);
    // Four nodes on a line have neither height nor area.
    // The lowest height is six volumes over twice the largest area. Multiplied out: a flat face has no area
    // to divide by.
    widest <= limit * longest || six_volumes(corners).abs() <= limit * widest
}

/// Returns twice the largest face area, and the longest edge.
fn sizes(corners: [&Point3<f64>; 4]) -> (f64, f64) {
    let (mut widest, mut longest) = (0.0_f64, 0.0_f64);
    for f in FACES {
        let [a, b, c] = f.map(|k| corners[k]);
        let (u, v) = (b - a, c - a);
        widest = widest.max(u.cross(&v).norm_squared());
        longest = longest.max(u.norm_squared()).max(v.norm_squared());
    }
    (widest.sqrt(), longest.sqrt())
}

impl Domain {
    /// Returns an error if two nodes are within the tolerance of each other.
    fn check_distances(&self) -> Result<()> {
        // Every tetrahedron that joins two such nodes is flat.
        let flat = self.flat.iter().zip(&self.delaunay.tets).filter(|t| *t.0);
        for (_, t) in flat {
            for (i, j) in [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)] {
                let [a, b] = [t.v[i], t.v[j]].map(|v| v as usize);
                let distance = (self.nodes()[a] - self.nodes()[b]).norm();
                if distance <= self.tolerance {
                    return Err(Error::NodesTooClose {
                        first: a.min(b),
                        second: a.max(b),
                        distance,
                        tolerance: self.tolerance,
                    });
                }
            }
        }
        Ok(())
    }

    /// Marks the flat tetrahedra and takes those next to constrained faces out of the domain.
    pub(super) fn level(&mut self) -> Result<()> {
        let delaunay = &self.delaunay;
        let flat = |t: &crate::tet::Tet| !t.is_ghost() && is_flat(delaunay.corners(t), self.tolerance);
        self.flat = delaunay.tets.iter().map(flat).collect();
        self.check_distances()?;
        self.glued = self
            .flat
            .iter()
            .zip(&self.inside)
            .map(|(f, i)| *f && *i)
            .collect();
        for (inside, flat) in self.inside.iter_mut().zip(&self.flat) {
            *inside &= !flat;
        }
        // A tetrahedron that gets a wall later is queued again by `take_out`.
        let mut queue: Vec<u32> = (0..self.glued.len() as u32)
            .filter(|&t| self.glued[t as usize])
            .collect();
        let mut dropped = Vec::new();
        while let Some(t) = queue.pop() {
            // The flag may have gone since it was queued, and without a wall it stays as a connection inside.
            if self.glued[t as usize] && self.walls[t as usize] != 0 {
                self.take_out(t, &mut dropped, &mut queue)?;
            }
        }
        if !dropped.is_empty() {
            self.renumber_faces(&dropped);
        }
        Ok(())
    }

    /// Takes one flat tetrahedron out of the domain: its free faces become constrained in place of its
    /// constrained ones.
    fn take_out(&mut self, tet: u32, dropped: &mut Vec<u32>, queue: &mut Vec<u32>) -> Result<()> {
        self.glued[tet as usize] = false;
        let t = self.delaunay.tets[tet as usize];
        let walls = self.walls[tet as usize];
        let mut free = Vec::with_capacity(4);
        let mut template: Option<Face> = None;
        for (slot, &opposite) in t.n.iter().enumerate() {
            let side = tet << 2 | slot as u32;
            if walls >> slot & 1 == 0 {
                continue;
            }
            let Some(&id) = self.face_at.get(&side) else {
                continue;
            };
            let face = self.mesh.faces[id as usize];
            // Boundary before crack: the new faces bound the domain.
            if template.is_none_or(|f| f.crack) {
                template = Some(face);
            }
            // A crack face stays: it still bounds the tetrahedra on its other side.
            if !face.crack {
                for side in [side, opposite] {
                    self.face_at.remove(&side);
                    self.walls[(side >> 2) as usize] &= !(1 << (side & 3));
                }
                free.push(id);
            }
        }
        let Some(template) = template else { return Ok(()) };
        for (slot, &opposite) in t.n.iter().enumerate().filter(|s| walls >> s.0 & 1 == 0) {
            let v = t.face(slot);
            // Freed faces are reused: a replaced face keeps the input face that it comes from.
            let id = match free.pop() {
                Some(id) => {
                    self.mesh.replace(id, v);
                    id
                }
                None => {
                    self.mesh.push(Face { v, ..template });
                    self.mesh.faces.len() as u32 - 1
                }
            };
            for side in [tet << 2 | slot as u32, opposite] {
                self.face_at.insert(side, id);
                self.walls[(side >> 2) as usize] |= 1 << (side & 3);
            }
            queue.push(opposite >> 2);
        }
        dropped.append(&mut free);
        Ok(())
    }

    /// Removes the `dropped` faces and renumbers the others.
    fn renumber_faces(&mut self, dropped: &[u32]) {
        let mut place = vec![u32::MAX; self.mesh.faces.len()];
        let mut mesh = crate::constraint::FaceMesh::default();
        // Faces refer to each other by index in the map of edges: the mesh is built anew without the dropped
        // ones.
        for (i, face) in self.mesh.faces.iter().enumerate() {
            if !dropped.contains(&(i as u32)) {
                place[i] = mesh.faces.len() as u32;
                mesh.push(*face);
            }
        }
        self.mesh = mesh;
        self.face_at.values_mut().for_each(|f| *f = place[*f as usize]);
    }

    /// Gives every flat tetrahedron inside the centre of the nearest tetrahedron that has a reliable one.
    pub(super) fn share_centres(&mut self) {
        let mut queue: Vec<u32> = Vec::new();
        for (tet, glued) in self.glued.iter().enumerate() {
            let next_to = |t: &crate::tet::Tet| t.n.iter().any(|n| self.glued[(n >> 2) as usize]);
            // Breadth first from thick tetrahedra: the first centre that arrives is the nearest.
            if !glued && self.inside[tet] && next_to(&self.delaunay.tets[tet]) {
                queue.push(tet as u32);
            }
        }
        let mut done = vec![false; self.glued.len()];
        let mut next = 0;
        while next < queue.len() {
            let source = queue[next];
            next += 1;
            let t = self.delaunay.tets[source as usize];
            for neighbour in t.n.map(|n| (n >> 2) as usize) {
                if !self.glued[neighbour] || done[neighbour] {
                    continue;
                }
                done[neighbour] = true;
                // Centres are stored relative to the first vertex, which differs between the two.
                let [p, q] =
                    [t.v[0], self.delaunay.tets[neighbour].v[0]].map(|v| &self.delaunay.points[v as usize]);
                let moved: Vector3<f64> = p - q;
                self.centre[neighbour] = moved + self.centre[source as usize];
                queue.push(neighbour as u32);
            }
        }
    }

    /// Returns the tetrahedra of the domain that are reached from `tet` through flat tetrahedra; `tet` itself
    /// if it is not flat.
    pub(crate) fn behind_flat(&self, tet: u32, out: &mut Vec<u32>) {
        out.clear();
        out.push(tet);
        let mut next = 0;
        while next < out.len() {
            let current = out[next];
            next += 1;
            if !self.glued[current as usize] {
                continue;
            }
            for n in self.delaunay.tets[current as usize].n.map(|n| n >> 2) {
                if (self.inside[n as usize] || self.glued[n as usize]) && !out.contains(&n) {
                    out.push(n);
                }
            }
        }
        out.retain(|&t| !self.glued[t as usize]);
    }

    /// Returns the tetrahedron itself unless it is too thin for linear functions. Else returns the nearest
    /// thick tetrahedron that is reached without crossing a constrained face.
    pub(crate) fn thick(&self, tet: u32, x: &Point3<f64>) -> u32 {
        let corners = |t: u32| self.delaunay.corners(&self.delaunay.tets[t as usize]);
        let thin = |t: u32| is_flat(corners(t), THIN * sizes(corners(t)).1);
        if !thin(tet) {
            return tet;
        }
        let mut visited = vec![tet];
        let mut best = (f64::INFINITY, tet);
        let mut next = 0;
        // Bounded: a body that is thin throughout must not be searched as a whole for each point.
        while next < visited.len() && next < 256 {
            let current = visited[next];
            next += 1;
            if self.inside[current as usize] && !thin(current) {
                let distance = self.plane_distances(current, x).into_iter().fold(0.0, f64::max);
                if distance < best.0 {
                    best = (distance, current);
                }
                continue;
            }
            let t = &self.delaunay.tets[current as usize];
            for (slot, neighbour) in t.n.iter().map(|n| n >> 2).enumerate() {
                // A function continued through a wall would see the material on the other side of a crack.
                let wall = self.walls[current as usize] >> slot & 1 == 1;
                if !wall && !visited.contains(&neighbour) {
                    visited.push(neighbour);
                }
            }
        }
        best.1
    }

    /// Returns an error unless every node belongs to a tetrahedron of the domain.
    pub(super) fn check_nodes(&self) -> Result<()> {
        let mut used = vec![false; self.nodes().len()];
        self.elements().flatten().for_each(|v| used[v] = true);
        let mut outside = (0..used.len()).filter(|&v| !used[v]);
        match outside.next() {
            None => Ok(()),
            Some(node) => Err(Error::NodeOutside {
                node,
                point: self.nodes()[node].into(),
                count: 1 + outside.count(),
            }),
        }
    }
}
