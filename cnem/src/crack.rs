//! Cracks that open: each lip has its own copies of the nodes on it.
//!
//! At a node of a crack face the tetrahedra of the domain fall into groups, each joined over faces without a
//! wall. Each group has its own unknowns: the first group keeps the node, every other group gets a copy at
//! the same position. Around a node of the crack front the tetrahedra are one group, so the front is shared.
//! A crack that cuts the whole body leaves no common unknown. The tetrahedra themselves refer to the copies,
//! so that shape functions, cells, gradients, masses and loads need no special rule.

use crate::delaunay::Delaunay;
use crate::domain::Domain;
use crate::tet::NONE;
use nalgebra::Vector3;
use std::collections::HashMap;

/// Largest number of tetrahedra visited in the search for a node's copy near a tetrahedron.
const MAX_REACHED: usize = 4096;

/// Node of a crack lip that has its own unknowns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CrackCopy {
    /// Index of the copy among the nodes of the domain.
    pub node: usize,
    /// Index of the node that was copied, at the same position.
    pub original: usize,
}

/// Triangle of a crack, with the nodes of its two lips.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Lips {
    /// Index of the triangle in [`Domain::constrained_faces`].
    pub face: usize,
    /// Nodes of the lip that the triangle's normal points away from, in the order of the triangle. `None`
    /// where the domain has only flat tetrahedra on this side; their other triangles are listed instead.
    pub below: Option<[usize; 3]>,
    /// Nodes of the lip on the side of the normal, in the same order; `None` as for `below`.
    pub above: Option<[usize; 3]>,
}

/// Copies of nodes, and the tetrahedra on both sides of every constrained face.
#[derive(Debug, Clone, Default)]
pub(crate) struct Copies {
    /// Number of nodes before the first copy.
    first: u32,
    /// Original node of each copy.
    originals: Vec<u32>,
    /// For each node that has copies: the node itself, then its copies.
    unknowns: HashMap<u32, Vec<u32>>,
    /// `tetrahedron << 2 | slot` below and above every constrained face.
    pub(crate) sides: Vec<[u32; 2]>,
}

impl Copies {
    pub(crate) fn new(nodes: usize, sides: Vec<[u32; 2]>) -> Self {
        Self {
            first: nodes as u32,
            sides,
            ..Self::default()
        }
    }

    /// Returns the node that a vertex is a copy of; the vertex itself if it is no copy.
    #[inline]
    pub(crate) fn original(&self, v: u32) -> u32 {
        // Ghost vertices have the largest number but are no copies.
        if v < self.first || v == crate::tet::INF {
            v
        } else {
            self.originals[(v - self.first) as usize]
        }
    }

    /// Returns a node and its copies; empty if there are no copies.
    #[inline]
    pub(crate) fn unknowns_of(&self, original: u32) -> &[u32] {
        // Most domains have no crack: they must not pay for a look into the map.
        if self.originals.is_empty() {
            &[]
        } else {
            self.unknowns.get(&original).map_or(&[], Vec::as_slice)
        }
    }

    fn add(&mut self, original: u32, copy: u32) {
        self.originals.push(original);
        self.unknowns
            .entry(original)
            .or_insert_with(|| vec![original])
            .push(copy);
    }
}

impl Domain {
    /// Returns the nodes that were copied because a crack separates the tetrahedra around them. Copies come
    /// in order of their indices, which follow those of all other nodes. A node has several copies where
    /// cracks cross.
    pub fn copies(&self) -> impl Iterator<Item = CrackCopy> + '_ {
        let first = self.copies.first as usize;
        let copy = move |(k, &v): (usize, &u32)| CrackCopy {
            node: first + k,
            original: v as usize,
        };
        self.copies.originals.iter().enumerate().map(copy)
    }

    /// Returns the node of which `node` is a copy, or `node` itself if it is no copy.
    pub fn original(&self, node: usize) -> usize {
        match node.checked_sub(self.copies.first as usize) {
            Some(k) => self.copies.originals.get(k).map_or(node, |&v| v as usize),
            None => node,
        }
    }

    /// Returns the crack triangles with the nodes of both lips; on the front the two agree.
    pub fn lips(&self) -> impl Iterator<Item = Lips> + '_ {
        let cracks = self.mesh.faces.iter().enumerate().filter(|f| f.1.crack);
        cracks.map(|(face, _)| {
            let [below, above] = [0, 1].map(|side: usize| {
                // The low two bits are the slot of the face in the tetrahedron.
                let tet = self.copies.sides[face][side] >> 2;
                let v = self.face_on_side(face as u32, side).map(|v| v as usize);
                // Shape functions live on tetrahedra that are not flat: only these lips carry unknowns.
                self.inside[tet as usize].then_some(v)
            });
            Lips { face, below, above }
        })
    }

    /// Returns the vertices of a constrained face as the tetrahedron below (0) or above (1) the face has
    /// them.
    pub(crate) fn face_on_side(&self, face: u32, side: usize) -> [u32; 3] {
        let tet = self.copies.sides[face as usize][side] >> 2;
        let corners = self.delaunay.tets[tet as usize].v;
        self.mesh.faces[face as usize].v.map(|v| {
            // The tetrahedron may have the copy of a corner: corners are compared by their originals.
            let twin = corners.iter().find(|&&w| self.copies.original(w) == v);
            twin.copied().unwrap_or(v)
        })
    }

    /// Returns the side of a constrained face, below (0) or above (1), to which a direction from the face
    /// leads.
    pub(crate) fn side_towards(&self, face: u32, direction: &Vector3<f64>) -> usize {
        let [a, b, c] = self.mesh.faces[face as usize]
            .v
            .map(|v| &self.delaunay.points[v as usize]);
        usize::from((b - a).cross(&(c - a)).dot(direction) > 0.0)
    }

    /// Returns the copy of a node that counts in and around a tetrahedron. It is the copy that is reached
    /// over the fewest faces without crossing a wall; the smallest index breaks ties.
    pub(crate) fn copy_at(&self, tet: u32, original: u32, visited: &mut Vec<u32>) -> u32 {
        let unknowns = self.copies.unknowns_of(original);
        let Some(&itself) = unknowns.first() else {
            return original;
        };
        visited.clear();
        visited.push(tet);
        let (mut next, mut level) = (0, 1);
        let mut nearest = None;
        // Bounded: in a domain that cracks divide, the walk could visit a whole part without finding the
        // node.
        while next < visited.len() && next < MAX_REACHED {
            let tet = visited[next];
            let t = &self.delaunay.tets[tet as usize];
            let corner = t.v.into_iter().find(|v| unknowns.contains(v));
            // The smallest index among equals: the copy does not depend on the order in which neighbours are
            // visited.
            nearest = corner.map_or(nearest, |v| Some(nearest.map_or(v, |f: u32| f.min(v))));
            for (slot, &n) in t.n.iter().enumerate() {
                if self.walls[tet as usize] >> slot & 1 == 0 && !visited.contains(&(n >> 2)) {
                    visited.push(n >> 2);
                }
            }
            next += 1;
            // All tetrahedra at one distance are seen before the choice, so that their order does not matter.
            if next == level {
                if let Some(copy) = nearest {
                    return copy;
                }
                level = visited.len();
            }
        }
        nearest.unwrap_or(itself)
    }

    /// Gives every group of tetrahedra around a crack node its own vertex.
    pub(crate) fn open_cracks(&mut self) {
        // The sides are taken before vertices are replaced: faces are looked up by the original nodes.
        self.copies = Copies::new(self.delaunay.points.len(), self.sides());
        let mut nodes: Vec<(u32, u32)> = Vec::new();
        for (i, f) in self.mesh.faces.iter().enumerate().filter(|f| f.1.crack) {
            nodes.extend(f.v.map(|v| (v, self.copies.sides[i][0] >> 2)));
        }
        // The first crack face at a node decides which lip keeps the node.
        nodes.sort_by_key(|n| n.0);
        nodes.dedup_by_key(|n| n.0);
        let (mut star, mut group) = (Vec::new(), Vec::new());
        for (node, below) in nodes {
            self.delaunay.star(node, &mut star);
            // Glued tetrahedra are flat but join groups: without them a node inside the body would fall
            // apart.
            star.retain(|&t| self.inside[t as usize] || self.glued[t as usize]);
            // If the triangle lies outside the domain, any group may keep the node.
            let keeps = star.iter().copied().find(|&t| t == below);
            let Some(start) = keeps.or(star.first().copied()) else {
                continue;
            };
            self.take_group(node, start, &mut star, &mut group);
            // Stars of the node start in the group that keeps it.
            self.delaunay.at_vertex[node as usize] = start;
            while let Some(&start) = star.first() {
                self.take_group(node, start, &mut star, &mut group);
                let copy = self.delaunay.copy_vertex(node, &group);
                self.copies.add(node, copy);
            }
        }
        self.delaunay.rank_copies(&self.copies.originals);
    }

    /// Moves the tetrahedra around a node that are joined to `start` from `star` to `group`.
    fn take_group(&self, node: u32, start: u32, star: &mut Vec<u32>, group: &mut Vec<u32>) {
        group.clear();
        group.push(start);
        star.retain(|&t| t != start);
        let mut next = 0;
        while next < group.len() {
            let tet = group[next];
            next += 1;
            let t = &self.delaunay.tets[tet as usize];
            for slot in 0..4 {
                let neighbour = t.n[slot] >> 2;
                // Only faces that contain the node join tetrahedra around it.
                let free = self.walls[tet as usize] >> slot & 1 == 0;
                if free && t.v[slot] != node && star.contains(&neighbour) {
                    star.retain(|&t| t != neighbour);
                    group.push(neighbour);
                }
            }
        }
    }

    /// Returns the tetrahedra below and above every constrained face.
    fn sides(&self) -> Vec<[u32; 2]> {
        let mut out = vec![[NONE; 2]; self.mesh.faces.len()];
        for (&side, &face) in &self.face_at {
            let outward = self.delaunay.tets[(side >> 2) as usize].face((side & 3) as usize);
            let v = self.mesh.faces[face as usize].v;
            let turned = outward.iter().position(|&w| w == v[0]);
            // If the vertices run counter-clockwise as seen from outside a tetrahedron, it is below the face.
            let below = turned.is_some_and(|k| outward[(k + 1) % 3] == v[1]);
            out[face as usize][usize::from(!below)] = side;
        }
        out
    }
}

impl Delaunay {
    /// Breaks ties between spheres as if copies were their originals.
    fn rank_copies(&mut self, originals: &[u32]) {
        if !originals.is_empty() {
            let uncopied = 0..(self.points.len() - originals.len()) as u32;
            self.rank = uncopied.chain(originals.iter().copied()).collect();
        }
    }

    /// Adds a vertex at the position of `v` for some of the tetrahedra around it.
    fn copy_vertex(&mut self, v: u32, tets: &[u32]) -> u32 {
        let copy = self.points.len() as u32;
        self.points.push(self.points[v as usize]);
        self.at_vertex.push(tets.first().copied().unwrap_or(NONE));
        for &t in tets {
            let corners = &mut self.tets[t as usize].v;
            *corners = corners.map(|w| if w == v { copy } else { w });
        }
        copy
    }
}
