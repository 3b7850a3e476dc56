//! Numbering for locality by reverse Cuthill-McKee: neighbours in the mesh become neighbours in memory.

use crate::mesh::{Facet, Mesh};
use arlequin_core::Real;
use arlequin_core::adjacency::Adjacency;

impl<T: Real> Mesh<T> {
    /// Renumbers nodes in reverse Cuthill-McKee order and elements in the order of their lowest node; groups
    /// follow.
    ///
    /// Meant for imported meshes, whose numbers jump; generated meshes are in a good order already.
    #[must_use]
    pub fn renumbered(self) -> Self {
        let order = node_order(&self);
        let mut place = vec![0u32; order.len()];
        for (new, &old) in order.iter().enumerate() {
            place[old as usize] = new as u32;
        }
        let corners = self.kind().corners();
        let mut elements: Vec<(u32, u32)> = (0..self.element_count() as u32)
            .map(|e| {
                let nodes = self.element(e as usize).iter();
                // By their lowest node, elements run through memory as their nodes do.
                (nodes.map(|&k| place[k as usize]).min().unwrap_or(0), e)
            })
            .collect();
        elements.sort_unstable();
        let mut element_place = vec![0u32; elements.len()];
        let mut connectivity = Vec::with_capacity(elements.len() * corners);
        for (new, &(_, old)) in elements.iter().enumerate() {
            element_place[old as usize] = new as u32;
            connectivity.extend(self.element(old as usize).iter().map(|&k| place[k as usize]));
        }
        let nodes = order.iter().map(|&k| self.nodes()[k as usize]).collect();
        let old_regions = self.regions();
        let regions = elements
            .iter()
            .filter_map(|&(_, old)| old_regions.get(old as usize).copied());
        let (names, regions) = (self.volumes().to_vec(), regions.collect());
        let mut out = self.with_parts(nodes, connectivity);
        out.set_volumes(names, regions);
        out.map_groups(
            |k| place[k as usize],
            |f| Facet {
                element: element_place[f.element as usize],
                face: f.face,
            },
        );
        out
    }
}

/// Returns the old node numbers in their new order.
fn node_order<T: Real>(mesh: &Mesh<T>) -> Vec<u32> {
    let nodes = mesh.nodes().len();
    let incidence = Adjacency::of_slots(nodes, mesh.connectivity());
    let corners = mesh.kind().corners();
    let degree = |k: &u32| (incidence.row(*k as usize).len(), *k);
    let mut seen = vec![false; nodes];
    let mut order: Vec<u32> = Vec::with_capacity(nodes);
    let mut by_degree: Vec<u32> = (0..nodes as u32).collect();
    // Seeds by degree: a corner of the body is a good end to begin at.
    by_degree.sort_unstable_by_key(degree);
    for &seed in &by_degree {
        if seen[seed as usize] {
            continue;
        }
        // The last node of a first sweep lies at an end of the connected part, which gives a small bandwidth.
        let first = order.len();
        let mut start = seed;
        for sweep in 0..2 {
            order.truncate(first);
            order.push(start);
            seen[start as usize] = true;
            let mut head = first;
            while head < order.len() {
                let tail = order.len();
                for &slot in incidence.row(order[head] as usize) {
                    for &k in mesh.element(slot as usize / corners) {
                        if !std::mem::replace(&mut seen[k as usize], true) {
                            order.push(k);
                        }
                    }
                }
                // Nodes with few elements first; numbers decide between equals, so that the order is
                // reproducible.
                order[tail..].sort_unstable_by_key(degree);
                head += 1;
            }
            if sweep == 0 {
                start = order[order.len() - 1];
                order[first..].iter().for_each(|&k| seen[k as usize] = false);
            }
        }
    }
    // Reversed, the profile of a factor is smaller; the bandwidth stays.
    order.reverse();
    order
}
