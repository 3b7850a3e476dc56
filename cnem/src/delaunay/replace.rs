//! Replacement of tetrahedra by others that fill the same space.

use super::Delaunay;
use crate::tet::{INF, NONE, Tet};
use arlequin_core::adjacency::Adjacency;
use std::collections::HashMap;

/// Returns the key of a face, independent of the order of its vertices.
pub(crate) fn face_key(mut v: [u32; 3]) -> [u32; 3] {
    v.sort_unstable();
    v
}

/// Returns the nodes that an edge joins to each node, ascending.
pub(crate) fn joined(delaunay: &Delaunay) -> Adjacency {
    // Slots that insertions have left unused are in no star.
    let mut star = Vec::new();
    Adjacency::from_rows((0..delaunay.points.len() as u32).map(|node| {
        delaunay.star(node, &mut star);
        let ends = star.iter().flat_map(|&t| delaunay.tets[t as usize].v);
        let mut list: Vec<u32> = ends.filter(|&v| v != INF && v != node).collect();
        list.sort_unstable();
        list.dedup();
        list
    }))
}

impl Delaunay {
    /// Replaces tetrahedra by others. Both sets must have the same border, and the new tetrahedra positive
    /// volumes. Returns false, with nothing changed, if faces do not match.
    pub(crate) fn replace(&mut self, old: &[u32], new: &[[u32; 4]]) -> bool {
        let mut open: HashMap<[u32; 3], u32> = HashMap::new();
        for &t in old {
            for (slot, &n) in self.tets[t as usize].n.iter().enumerate() {
                // Faces between two old tetrahedra vanish with them; the others must find a new owner.
                if !old.contains(&(n >> 2)) {
                    open.insert(face_key(self.tets[t as usize].face(slot)), n);
                }
            }
        }
        // The new tetrahedra take the ids of the old ones, then further ids.
        let id = |k: usize| {
            old.get(k)
                .copied()
                .unwrap_or((self.tets.len() + k) as u32 - old.len() as u32)
        };
        let mut links = vec![[NONE; 4]; new.len()];
        let mut inner: HashMap<[u32; 3], (usize, usize)> = HashMap::new();
        let mut outer = Vec::new();
        for (k, &v) in new.iter().enumerate() {
            let t = Tet { v, n: [NONE; 4] };
            for slot in 0..4 {
                let face = face_key(t.face(slot));
                // A face is met twice: by the two new tetrahedra that share it, or by a new one and the
                // border.
                if let Some((j, back)) = inner.remove(&face) {
                    links[k][slot] = id(j) << 2 | back as u32;
                    links[j][back] = id(k) << 2 | slot as u32;
                } else if let Some(behind) = open.remove(&face) {
                    links[k][slot] = behind;
                    outer.push((behind, id(k) << 2 | slot as u32));
                } else {
                    inner.insert(face, (k, slot));
                }
            }
        }
        // Checked before anything is written: a failed replacement leaves the complex as it was.
        if !open.is_empty() || !inner.is_empty() {
            return false;
        }
        for (k, (&v, &n)) in new.iter().zip(&links).enumerate() {
            let tet = Tet { v, n };
            let index = old.get(k).copied().unwrap_or(self.tets.len() as u32);
            match self.tets.get_mut(index as usize) {
                Some(t) => *t = tet,
                None => self.tets.push(tet),
            }
            v.into_iter()
                .filter(|v| *v != INF)
                .for_each(|v| self.at_vertex[v as usize] = index);
        }
        // Only now do the neighbours outside point to the new tetrahedra.
        for (behind, link) in outer {
            self.tets[(behind >> 2) as usize].n[(behind & 3) as usize] = link;
        }
        self.release(old.get(new.len()..).unwrap_or_default());
        true
    }
}
