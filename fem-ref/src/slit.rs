//! Slits: pairs of nodes at one place, one on each lip of a crack.

use crate::check;
use crate::element::ElementKind;
use crate::error::Result;
use crate::mesh::Mesh;
use crate::pieces::{find, node_parts};
use arlequin_core::Real;
use nalgebra::Vector3;
use std::collections::{BTreeMap, BTreeSet, HashMap};

/// Returns the mesh if its coincident nodes, given by `pairs`, are the lips of slits.
pub(crate) fn checked<T: Real>(mesh: Mesh<T>, pairs: &[[u32; 2]]) -> Result<Mesh<T>> {
    lips(&mesh, pairs).map(|()| mesh)
}

/// Returns an error for coincident nodes that are not the lips of a slit.
fn lips<T: Real>(mesh: &Mesh<T>, pairs: &[[u32; 2]]) -> Result<()> {
    let Some(first) = pairs.first() else { return Ok(()) };
    let refuse = |pair: &[u32; 2]| {
        Err(check::coincident_error(
            mesh.nodes(),
            pair[0] as usize,
            pair[1] as usize,
        ))
    };
    // A bar has no faces that could face each other.
    if mesh.kind() == ElementKind::Bar2 {
        return refuse(first);
    }
    // Across a slit, the body must be connected around it: otherwise these are two bodies that touch.
    let parts = node_parts(mesh);
    if let Some([a, b]) = pairs
        .iter()
        .find(|[a, b]| parts[*a as usize] != parts[*b as usize])
    {
        return Err(mesh.separate_pieces_error(*a, *b));
    }
    let place = places(pairs);
    let facing = Facing::from_mesh(mesh, &place);
    let mut opposed: HashMap<u32, bool> = HashMap::new();
    for (n, good) in facing
        .0
        .iter()
        .flat_map(|f| f.nodes.iter().map(|n| (*n, f.opposed)))
    {
        *opposed.entry(n).or_insert(true) &= good;
    }
    let lip = |n: &u32| opposed.get(n).copied().unwrap_or(false);
    // Every node of a lip lies on surface facets that face another facet at the same place, and never on two
    // at one place that look the same way.
    let pocket = facing.pocket(&place);
    // No lip wraps around a single element or a single node.
    let in_pocket = |n: &u32| pocket.is_some_and(|p| *n == p);
    let bad = |pair: &&[u32; 2]| !pair.iter().all(lip) || pair.iter().any(in_pocket);
    pairs.iter().find(bad).map_or(Ok(()), refuse)
}

/// For every node that shares its place with another: the first node at this place.
pub(crate) fn places(pairs: &[[u32; 2]]) -> HashMap<u32, u32> {
    let mut place: HashMap<u32, u32> = HashMap::new();
    for pair in pairs {
        // The first node stands for the place, also where three nodes meet.
        let first = place.get(&pair[0]).copied().unwrap_or(pair[0]);
        place.insert(pair[0], first);
        place.insert(pair[1], first);
    }
    place
}

/// Bound of a lip's flatness: the length of the sum of its area vectors over its area. Below this bound, a
/// lip with one node of its own is bent too much for a crack.
///
/// A plane has 1, a right angle 0.71, the corner of a cube 0.58, the corner of a tetrahedron 0.33.
const BENT: f64 = 0.7;

/// A surface facet that has another facet at its place.
struct LipFacet {
    element: u32,
    nodes: Vec<u32>,
    /// Normal with the length of the facet's area, times a factor that is the same for all facets of a mesh.
    area: Vector3<f64>,
    /// Number of the place; facets at the same place have the same number.
    place: usize,
    /// True if exactly two facets lie at the place and face each other.
    opposed: bool,
}

/// All facets of all lips.
struct Facing(Vec<LipFacet>);

impl Facing {
    fn from_mesh<T: Real>(mesh: &Mesh<T>, place: &HashMap<u32, u32>) -> Self {
        let mut facets: BTreeMap<Vec<u32>, Vec<(u32, Vec<u32>)>> = BTreeMap::new();
        for facet in mesh.boundary() {
            // Only facets with a doubled node can be lips.
            let nodes = mesh.facet_nodes(facet);
            if nodes.iter().any(|n| place.contains_key(n)) {
                let place_of = |n: &u32| place.get(n).copied().unwrap_or(*n);
                let mut key: Vec<u32> = nodes.iter().map(place_of).collect();
                key.sort_unstable();
                facets.entry(key).or_default().push((facet.element, nodes));
            }
        }
        let area = |nodes: &[u32]| {
            let x = |k: usize| mesh.nodes()[nodes[k] as usize].coords.map(T::as_f64);
            (x(1) - x(0)).cross(&(x(2) - x(0)))
        };
        let mut out = Vec::new();
        for (place, facing) in facets.into_values().filter(|f| f.len() > 1).enumerate() {
            let sum = facing.iter().fold(Vector3::zeros(), |s, f| s + area(&f.1));
            // The area vectors of facing facets cancel; those of facets that look the same way add up.
            let opposed = facing.len() == 2 && sum.norm() < area(&facing[0].1).norm();
            out.extend(facing.into_iter().map(|(element, nodes)| LipFacet {
                element,
                area: area(&nodes),
                nodes,
                place,
                opposed,
            }));
        }
        Self(out)
    }

    /// Returns a node of a lip that faces one other lip and wraps around a single element, or around the few
    /// elements at a single node.
    fn pocket(&self, place: &HashMap<u32, u32>) -> Option<u32> {
        // Facets that share a doubled node belong to the same lip.
        let doubled = |f: &LipFacet| -> Vec<u32> {
            let doubled_nodes = f.nodes.iter().filter(|n| place.contains_key(n));
            doubled_nodes.copied().collect()
        };
        let last = self.0.iter().flat_map(|f| &f.nodes).max()?;
        let mut root: Vec<u32> = (0..=*last).collect();
        for f in &self.0 {
            let nodes = doubled(f);
            for n in &nodes {
                let (a, b) = (find(&mut root, nodes[0]), find(&mut root, *n));
                root[a.max(b) as usize] = a.min(b);
            }
        }
        let mut lips: BTreeMap<u32, Vec<&LipFacet>> = BTreeMap::new();
        let mut at_place: HashMap<usize, Vec<u32>> = HashMap::new();
        for f in &self.0 {
            let lip = find(&mut root, doubled(f)[0]);
            lips.entry(lip).or_default().push(f);
            at_place.entry(f.place).or_default().push(lip);
        }
        // A mesh with a missing connection looks like this; the faces of a crack bend less.
        let wrapped = |(lip, facets): &(&u32, &Vec<&LipFacet>)| {
            let opposite_lips = facets.iter().flat_map(|f| &at_place[&f.place]);
            let opposite_lips: BTreeSet<u32> = opposite_lips.copied().filter(|o| o != *lip).collect();
            let of_one = facets.iter().all(|f| f.element == facets[0].element);
            let alone = facets.iter().all(|f| doubled(f).len() == 1);
            let sum: Vector3<f64> = facets.iter().map(|f| f.area).sum();
            let bent = sum.norm() < BENT * facets.iter().map(|f| f.area.norm()).sum::<f64>();
            facets.len() > 1 && opposite_lips.len() == 1 && (of_one || alone && bent)
        };
        lips.iter().find(wrapped).map(|(lip, _)| *lip)
    }
}
