//! Contents of a Gmsh file, independent of its format.

use super::fault;
use crate::error::Result;
use mshio::mshfile::{Element, ElementType};
use nalgebra::Point3;
use std::collections::{BTreeMap, HashMap, HashSet};

/// Node index of every node tag.
pub(super) type NodeIndex = HashMap<u64, u32>;

/// Elements of one type on one entity of the geometry.
#[derive(Debug)]
pub(super) struct Block {
    pub dimension: i32,
    pub entity: i32,
    /// Physical groups of the entity; negative if the entity is reversed in the group.
    pub physical: Vec<i32>,
    pub element_type: ElementType,
    pub elements: Vec<Element<u64>>,
}

/// Nodes, elements and names of a file.
#[derive(Debug, Default)]
pub(super) struct Contents {
    pub nodes: Vec<Point3<f64>>,
    pub index: NodeIndex,
    pub blocks: Vec<Block>,
    /// Names of the physical groups by dimension and tag.
    pub names: BTreeMap<(i32, i32), String>,
    /// Messages on what was read differently from how the file holds it.
    pub notices: Vec<String>,
}

impl Contents {
    /// Returns the index of the node with a tag.
    pub(super) fn lookup(&self, tag: u64, element: u64) -> Result<u32> {
        self.index.get(&tag).copied().ok_or_else(|| {
            fault(format!(
                "element {element} refers to node {tag}, which is not in $Nodes"
            ))
        })
    }

    /// Returns the node indices of an element's corners.
    pub(super) fn corners(&self, element: &Element<u64>) -> Result<Vec<u32>> {
        let tags = element.nodes.iter();
        tags.map(|t| self.lookup(*t, element.element_tag)).collect()
    }

    /// Makes elements of second order linear by keeping only the corners, which come first. Drops nodes that
    /// are no element's corner.
    pub(super) fn linearise(&mut self) {
        // Collected over all elements before any node goes: edges are shared.
        let mut middles = HashSet::new();
        let mut count = 0;
        for block in &mut self.blocks {
            let Some((first, corners)) = first_order(block.element_type) else {
                continue;
            };
            block.element_type = first;
            if block.dimension == 3 {
                count += block.elements.len();
            }
            for element in &mut block.elements {
                middles.extend(element.nodes.drain(corners.min(element.nodes.len())..));
            }
        }
        if middles.is_empty() {
            return;
        }
        // A middle of one element that is a corner of another stays.
        for tag in self
            .blocks
            .iter()
            .flat_map(|b| &b.elements)
            .flat_map(|e| &e.nodes)
        {
            middles.remove(tag);
        }
        self.drop_nodes(&middles);
        if count > 0 {
            self.notices.push(format!(
                "{count} elements of second order are read as linear ones, without the {} nodes in the middle of their edges \
                 and faces: they are stiffer, above all in bending; take a finer mesh",
                middles.len()
            ));
        }
    }

    fn drop_nodes(&mut self, tags: &HashSet<u64>) {
        let mut is_kept = vec![true; self.nodes.len()];
        for tag in tags {
            if let Some(k) = self.index.remove(tag) {
                is_kept[k as usize] = false;
            }
        }
        let mut place = Vec::with_capacity(is_kept.len());
        let mut next = 0;
        for keep in &is_kept {
            place.push(next);
            next += u32::from(*keep);
        }
        self.index.values_mut().for_each(|k| *k = place[*k as usize]);
        let mut keep = is_kept.iter();
        self.nodes.retain(|_| keep.next().copied().unwrap_or(true));
    }
}

/// Linear element with the corners of a second-order element, and the number of corners.
fn first_order(element: ElementType) -> Option<(ElementType, usize)> {
    use ElementType as E;
    Some(match element {
        E::Lin3 => (E::Lin2, 2),
        E::Tri6 => (E::Tri3, 3),
        E::Qua8 | E::Qua9 => (E::Qua4, 4),
        E::Tet10 => (E::Tet4, 4),
        E::Hex20 | E::Hex27 => (E::Hex8, 8),
        _ => return None,
    })
}
