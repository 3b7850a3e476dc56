//! Connected pieces of a mesh: elements joined by common nodes.

use crate::error::Error;
use crate::mesh::Mesh;
use arlequin_core::Real;
use arlequin_core::geometry::bounds_of;
use nalgebra::Point3;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

/// Largest number of pieces in a message.
const LISTED: usize = 4;

/// Connected elements of a mesh, which share no node with other pieces.
#[derive(Debug, Clone, PartialEq)]
pub struct MeshPiece {
    /// Number of elements.
    pub elements: usize,
    /// Lowest corner of the bounding box \[m\].
    pub low: [f64; 3],
    /// Highest corner of the bounding box \[m\].
    pub high: [f64; 3],
    /// Names of the volumes of its elements; see [`Mesh::volumes`].
    pub volumes: BTreeSet<String>,
}

impl fmt::Display for MeshPiece {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let place = |p: &[f64; 3]| format!("({:.4e}, {:.4e}, {:.4e})", p[0], p[1], p[2]);
        let plural = if self.elements == 1 { "" } else { "s" };
        let (low, high) = (place(&self.low), place(&self.high));
        write!(f, "{} element{plural} from {low} to {high} m", self.elements)?;
        let names: Vec<String> = self.volumes.iter().map(|n| format!("'{n}'")).collect();
        match names.is_empty() {
            true => Ok(()),
            false => write!(f, " of {}", names.join(" and ")),
        }
    }
}

/// Describes the first four pieces in words, and counts the rest.
pub fn list_pieces(pieces: &[MeshPiece]) -> String {
    let mut words: Vec<String> = pieces.iter().take(LISTED).map(MeshPiece::to_string).collect();
    if pieces.len() > LISTED {
        words.push(format!("and {} more", pieces.len() - LISTED));
    }
    words.join("; ")
}

impl<T: Real> Mesh<T> {
    /// Connected pieces of the mesh, the largest first; one piece if the mesh is connected.
    ///
    /// ```
    /// use fem_ref::generate;
    /// let bar = generate::bar(0.0, 3.0, 3, 1.0)?;
    /// assert_eq!(bar.pieces().len(), 1);
    /// let ends = bar.part(|e| e != 1)?.pieces();
    /// let text = "1 element from (2.0000e0, 0.0000e0, 0.0000e0) to (3.0000e0, 0.0000e0, 0.0000e0) m";
    /// assert_eq!(ends[1].to_string(), text);
    /// # Ok::<(), fem_ref::Error>(())
    /// ```
    pub fn pieces(&self) -> Vec<MeshPiece> {
        let part = node_parts(self);
        let mut elements: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
        for e in 0..self.element_count() {
            // All nodes of an element are in one part: the first tells which.
            elements
                .entry(part[self.element(e)[0] as usize])
                .or_default()
                .push(e);
        }
        let mut lists: Vec<Vec<usize>> = elements.into_values().collect();
        // The largest first, ties by number.
        lists.sort_by_key(|list| (std::cmp::Reverse(list.len()), list[0]));
        lists.iter().map(|list| self.piece(list)).collect()
    }

    fn piece(&self, elements: &[usize]) -> MeshPiece {
        let corners = elements.iter().flat_map(|&e| self.element(e));
        let ends = bounds_of(corners.map(|&k| &self.nodes()[k as usize]));
        let name = |e: &usize| {
            let region = self.regions().get(*e)?;
            self.volumes().get(*region as usize).cloned()
        };
        let [low, high] = ends.map(|p: Point3<T>| [p.x.as_f64(), p.y.as_f64(), p.z.as_f64()]);
        MeshPiece {
            elements: elements.len(),
            low,
            high,
            volumes: elements.iter().filter_map(name).collect(),
        }
    }

    /// Error for two nodes at one place that belong to different pieces.
    pub(crate) fn separate_pieces_error(&self, first: u32, second: u32) -> Error {
        let (pieces, x) = (self.pieces(), &self.nodes()[first as usize]);
        Error::SeparatePieces {
            count: pieces.len(),
            pieces: list_pieces(&pieces),
            first: first as usize,
            second: second as usize,
            point: [x.x.as_f64(), x.y.as_f64(), x.z.as_f64()],
        }
    }
}

/// Returns a number for every node, the same for all nodes of one connected piece.
pub(crate) fn node_parts<T: Real>(mesh: &Mesh<T>) -> Vec<u32> {
    let mut root: Vec<u32> = (0..mesh.nodes().len() as u32).collect();
    for corners in mesh.connectivity().chunks_exact(mesh.kind().corners()) {
        let first = find(&mut root, corners[0]);
        for n in &corners[1..] {
            let corner_root = find(&mut root, *n);
            root[corner_root as usize] = first;
        }
    }
    (0..root.len() as u32).map(|k| find(&mut root, k)).collect()
}

/// Returns the node that represents all nodes joined with `k`, and shortens the path to it.
pub(crate) fn find(root: &mut [u32], mut k: u32) -> u32 {
    while root[k as usize] != k {
        // Path halving keeps later searches short.
        root[k as usize] = root[root[k as usize] as usize];
        k = root[k as usize];
    }
    k
}
