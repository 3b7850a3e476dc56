//! Tetrahedra with adjacency, and the edge table that joins the new tetrahedra of a cavity.

use std::collections::HashMap;

/// The vertex at infinity. Ghost tetrahedra have it in slot 3 and a face of the convex hull in the others.
pub(crate) const INF: u32 = u32::MAX;
/// Unset index.
pub(crate) const NONE: u32 = u32::MAX;

/// Slots of the face opposite to each slot, ordered so that the normal points out of a positive tetrahedron.
pub(crate) const FACES: [[usize; 3]; 4] = [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]];

/// A tetrahedron of positive volume: its vertices and, opposite to each, its neighbour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Tet {
    /// Vertices.
    pub(crate) v: [u32; 4],
    /// `tetrahedron << 2 | slot` of the neighbour over the face opposite to each vertex.
    pub(crate) n: [u32; 4],
}

impl Tet {
    /// Returns whether this is a ghost, which stands on a hull face.
    #[inline]
    pub(crate) fn is_ghost(&self) -> bool {
        self.v[3] == INF
    }

    /// Returns the vertices of the face opposite to `slot`, normal outward.
    #[inline]
    pub(crate) fn face(&self, slot: usize) -> [u32; 3] {
        FACES[slot].map(|k| self.v[k])
    }

    /// Returns the slot of a vertex.
    #[inline]
    pub(crate) fn slot_of(&self, vertex: u32) -> Option<usize> {
        self.v.iter().position(|&v| v == vertex)
    }

    /// Returns the slot opposite to the face with the given vertices.
    pub(crate) fn slot_opposite(&self, face: [u32; 3]) -> Option<usize> {
        let outside = |s: &usize| !face.contains(&self.v[*s]);
        let hits = face.iter().filter(|f| self.v.contains(f)).count();
        // All three must be corners: with two in common, the slot opposite would not be unique.
        if hits == 3 { (0..4).find(outside) } else { None }
    }
}

/// Side of the square table of [`EdgeTable`]; cavities with more vertices spill into a hash map.
const SIDE: usize = 128;

/// Matches the two halves of every edge of a closed triangulated surface. The table is empty again when all
/// halves are matched.
#[derive(Debug, Clone, Default)]
pub(crate) struct EdgeTable {
    local: Vec<u32>,
    touched: Vec<u32>,
    square: Vec<u32>,
    spill: HashMap<(u32, u32), u32>,
}

impl EdgeTable {
    /// Makes room for vertices `0..vertices` and the vertex at infinity.
    pub(crate) fn reserve(&mut self, vertices: usize) {
        self.square.resize(SIDE * SIDE, NONE);
        if self.local.len() < vertices + 1 {
            self.local.resize(vertices + 1, NONE);
        }
    }

    /// Forgets the vertex numbering of the last cavity. With `clean = false` also removes unmatched edges of
    /// a surface that was not closed.
    pub(crate) fn reset(&mut self, clean: bool) {
        if !clean {
            self.square.fill(NONE);
        }
        self.spill.clear();
        for t in self.touched.drain(..) {
            self.local[t as usize] = NONE;
        }
    }

    /// Returns the number of the vertex within the cavity, in order of first use.
    #[inline]
    pub(crate) fn local(&mut self, vertex: u32) -> u32 {
        // Infinity is `u32::MAX`: shifted by one it takes slot 0.
        let key = vertex.wrapping_add(1);
        let slot = &mut self.local[key as usize];
        if *slot == NONE {
            *slot = self.touched.len() as u32;
            self.touched.push(key);
        }
        *slot
    }

    /// Stores `payload` for the edge between two local vertices. If the other half of the edge is already
    /// stored, returns the payload of that half instead.
    #[inline]
    pub(crate) fn pair(&mut self, a: u32, b: u32, payload: u32) -> Option<u32> {
        let (low, high) = if a < b { (a, b) } else { (b, a) };
        // Nearly all cavities fit: a table of fixed size needs no hash.
        if (high as usize) < SIDE {
            let entry = &mut self.square[low as usize * SIDE + high as usize];
            if *entry == NONE {
                *entry = payload;
                return None;
            }
            // Emptied as it is read: a closed surface leaves the table clean for the next cavity.
            return Some(std::mem::replace(entry, NONE));
        }
        match self.spill.remove(&(low, high)) {
            Some(twin) => Some(twin),
            None => {
                self.spill.insert((low, high), payload);
                None
            }
        }
    }
}
