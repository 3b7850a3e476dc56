//! Cracks: separates elements along faces and gives every lip its own nodes.

use crate::error::{Error, Result};
use crate::mesh::{Facet, Mesh};
use crate::{check, slit};
use arlequin_core::Real;
use arlequin_core::adjacency::Adjacency;
use nalgebra::Point3;
use std::collections::{BTreeMap, BTreeSet, HashMap};

impl<T: Real> Mesh<T> {
    /// Number of nodes that lie at the place of another node, across a slit.
    pub fn doubled(&self) -> usize {
        self.doubled
    }

    /// For every node, the first node at its place: the node itself except across a slit.
    ///
    /// # Errors
    /// [`Error::CoincidentNodes`] for a mesh without extent.
    pub fn places(&self) -> Result<Vec<u32>> {
        let mut out: Vec<u32> = (0..self.nodes().len() as u32).collect();
        if self.doubled() > 0 {
            let pairs = check::coincident(self.nodes())?;
            for (node, place) in slit::places(&pairs) {
                out[node as usize] = place;
            }
        }
        Ok(out)
    }

    /// Inserts a crack along the faces between two elements whose nodes are all on the crack, given by
    /// `on_crack` of node number and position. The lips have their own nodes; the front is shared. Groups of
    /// facets stay with their elements; groups of nodes also get the copies of their nodes.
    ///
    /// ```
    /// use arlequin_core::nalgebra::Point3;
    /// use fem_ref::{ElementKind, generate};
    /// let high = Point3::new(4.0, 4.0, 1.0);
    /// let bar = generate::block(ElementKind::Hex8, Point3::origin(), high, [4, 4, 1])?;
    /// // From y = 0 to 2 across the middle: doubles the mouth and one edge behind, not the front.
    /// let cut = bar.with_crack(|_, x| x.x == 2.0 && x.y <= 2.0)?;
    /// assert_eq!(cut.nodes().len(), bar.nodes().len() + 4);
    /// # Ok::<(), fem_ref::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::EmptyGroup`] if no face between two elements is on the crack; [`Error::SeparatePieces`] if
    /// the crack cuts the mesh in two; the errors of [`Mesh::new`] for a crack around a single element.
    pub fn with_crack(&self, on_crack: impl Fn(usize, &Point3<T>) -> bool) -> Result<Self> {
        let on: Vec<bool> = self
            .nodes()
            .iter()
            .enumerate()
            .map(|(k, x)| on_crack(k, x))
            .collect();
        let inner = self.inner_faces(&on);
        // A face belongs to the crack if all of its corners do; then its two elements part.
        let walls: BTreeSet<[u32; 2]> = inner
            .iter()
            .filter(|(nodes, _)| nodes.iter().all(|k| on[*k as usize]))
            .map(|(_, pair)| *pair)
            .collect();
        if walls.is_empty() {
            return Err(Error::EmptyGroup {
                name: "crack".to_owned(),
                what: "face between two elements",
            });
        }
        let mut nodes = self.nodes().to_vec();
        let mut connectivity = self.connectivity().to_vec();
        // Ordered maps: copies get their numbers in the same order in every run.
        let mut copies: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
        let corners = self.kind().corners();
        let around = Adjacency::of_slots(nodes.len(), self.connectivity());
        let mut joined: HashMap<u32, Vec<[u32; 2]>> = HashMap::new();
        // Faces that the crack touches but does not contain keep their elements together.
        for (face, pair) in inner.iter().filter(|(_, pair)| !walls.contains(pair)) {
            for k in face.iter().filter(|k| on[**k as usize]) {
                joined.entry(*k).or_default().push(*pair);
            }
        }
        for k in (0..self.nodes().len() as u32).filter(|k| on[*k as usize]) {
            let slots = around.row(k as usize);
            let elements: Vec<u32> = slots.iter().map(|s| s / corners as u32).collect();
            let lips = lips(&elements, joined.get(&k).map_or(&[], Vec::as_slice));
            // Lip 0 keeps the node; every other lip gets a copy.
            for lip in 1..lips.iter().max().map_or(0, |n| n + 1) {
                let copy = nodes.len() as u32;
                nodes.push(self.nodes()[k as usize]);
                copies.entry(k).or_default().push(copy);
                for (slot, _) in slots
                    .iter()
                    .zip(&lips)
                    .filter(|(_, lip_number)| **lip_number == lip)
                {
                    connectivity[*slot as usize] = copy;
                }
            }
        }
        // Checked like any mesh: a crack around a single element cuts it off.
        let (volumes, regions) = (self.volumes().to_vec(), self.regions().to_vec());
        let mut out = Self::with_volumes(self.kind(), nodes, connectivity, volumes, regions)?
            .with_section(self.section())?;
        for (name, group) in self.groups() {
            let copies = group.nodes.iter().filter_map(|k| copies.get(k)).flatten();
            // Facets follow their elements, and their nodes with them.
            let nodes = match group.facets.is_empty() {
                true => group.nodes.iter().chain(copies).copied().collect(),
                false => Vec::new(),
            };
            out.set_group(name, nodes, group.facets.clone());
        }
        out.set_notices(self.notices().to_vec());
        Ok(out)
    }

    /// Faces with two elements and at least one node that is `on` the crack: their nodes and the two
    /// elements.
    fn inner_faces(&self, on: &[bool]) -> Vec<(Vec<u32>, [u32; 2])> {
        let mut faces: BTreeMap<Vec<u32>, Vec<u32>> = BTreeMap::new();
        for element in 0..self.element_count() as u32 {
            for face in 0..self.kind().faces().len() as u8 {
                let mut nodes = self.facet_nodes(Facet { element, face });
                if nodes.iter().any(|k| on[*k as usize]) {
                    nodes.sort_unstable();
                    faces.entry(nodes).or_default().push(element);
                }
            }
        }
        let two = |(nodes, elements): (Vec<u32>, Vec<u32>)| match elements[..] {
            // Faces with one element lie on the surface.
            [a, b] => Some((nodes, [a, b])),
            _ => None,
        };
        faces.into_iter().filter_map(two).collect()
    }
}

/// For each of the elements around a node, the number of its lip, from 0. `joined` are pairs of elements that
/// no crack face separates.
fn lips(elements: &[u32], joined: &[[u32; 2]]) -> Vec<u32> {
    let mut lip = vec![u32::MAX; elements.len()];
    let mut count = 0;
    for start in 0..elements.len() {
        if lip[start] != u32::MAX {
            continue;
        }
        let mut queue = vec![start];
        lip[start] = count;
        while let Some(next) = queue.pop() {
            let beside = |pair: &&[u32; 2]| pair.contains(&elements[next]);
            for other in joined.iter().filter(beside).flatten() {
                let place = elements.iter().position(|e| e == other);
                if let Some(place) = place.filter(|p| lip[*p] == u32::MAX) {
                    lip[place] = count;
                    queue.push(place);
                }
            }
        }
        count += 1;
    }
    lip
}
