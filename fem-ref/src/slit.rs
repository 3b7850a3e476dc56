//! Slits: two nodes at one place, one on each lip of a crack.

use crate::check;
use crate::element::ElementKind;
use crate::error::Result;
use crate::mesh::Mesh;
use arlequin_core::Real;
use nalgebra::Vector3;
use std::collections::HashMap;

impl<T: Real> Mesh<T> {
    /// Number of nodes that lie at the place of another one, across a slit.
    pub fn doubled(&self) -> usize {
        self.doubled
    }
}

/// A mesh whose nodes coincide as `pairs` say, if it may have them.
pub(crate) fn checked<T: Real>(mesh: Mesh<T>, pairs: &[[u32; 2]]) -> Result<Mesh<T>> {
    lips(&mesh, pairs).map(|()| mesh)
}

/// Refuses nodes that coincide unless they are the lips of a slit: every one of them lies on facets of the surface that face another
/// facet at the same place, none lies on two that look the same way, and the body hangs together around the slit.
fn lips<T: Real>(mesh: &Mesh<T>, pairs: &[[u32; 2]]) -> Result<()> {
    let Some(first) = pairs.first() else { return Ok(()) };
    let same = |pair: &[u32; 2]| {
        Err(check::same_place(
            mesh.nodes(),
            pair[0] as usize,
            pair[1] as usize,
        ))
    };
    if mesh.kind() == ElementKind::Bar2 {
        return same(first);
    }
    let parts = parts(mesh);
    let mut place: HashMap<u32, u32> = HashMap::new();
    for pair in pairs {
        if parts[pair[0] as usize] != parts[pair[1] as usize] {
            return same(pair);
        }
        let at = place.get(&pair[0]).copied().unwrap_or(pair[0]);
        place.insert(pair[0], at);
        place.insert(pair[1], at);
    }
    // Facets of the surface by the places of their nodes.
    let mut facets: HashMap<Vec<u32>, Vec<Vec<u32>>> = HashMap::new();
    for nodes in mesh.boundary().into_iter().map(|f| mesh.facet_nodes(f)) {
        if nodes.iter().any(|n| place.contains_key(n)) {
            let mut key: Vec<u32> = nodes
                .iter()
                .map(|n| place.get(n).copied().unwrap_or(*n))
                .collect();
            key.sort_unstable();
            facets.entry(key).or_default().push(nodes);
        }
    }
    let normal = |nodes: &[u32]| {
        let x = |k: usize| mesh.nodes()[nodes[k] as usize];
        (x(1) - x(0)).cross(&(x(2) - x(0)))
    };
    let mut facing: HashMap<u32, bool> = HashMap::new();
    for both in facets.values().filter(|f| f.len() > 1) {
        let sum = both.iter().fold(Vector3::zeros(), |s, f| s + normal(f));
        let opposed = both.len() == 2 && sum.norm() < normal(&both[0]).norm();
        for n in both.iter().flatten() {
            *facing.entry(*n).or_insert(true) &= opposed;
        }
    }
    let lip = |n: &u32| facing.get(n).copied().unwrap_or(false);
    match pairs.iter().find(|pair| !pair.iter().all(lip)) {
        Some(pair) => same(pair),
        None => Ok(()),
    }
}

/// A number for every node, the same for all that elements join.
fn parts<T: Real>(mesh: &Mesh<T>) -> Vec<u32> {
    let mut root: Vec<u32> = (0..mesh.nodes().len() as u32).collect();
    for corners in mesh.connectivity().chunks_exact(mesh.kind().corners()) {
        let first = find(&mut root, corners[0]);
        for n in &corners[1..] {
            let other = find(&mut root, *n);
            root[other as usize] = first;
        }
    }
    (0..root.len() as u32).map(|k| find(&mut root, k)).collect()
}

/// The node that stands for all that were joined to this one.
fn find(root: &mut [u32], mut k: u32) -> u32 {
    while root[k as usize] != k {
        root[k as usize] = root[root[k as usize] as usize];
        k = root[k as usize];
    }
    k
}
