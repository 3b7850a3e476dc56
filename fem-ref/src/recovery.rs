//! Stress and strain at the nodes, by patch recovery from the element means.

use crate::element::ElementKind;
use crate::mesh::Mesh;
use crate::model::FemModel;
use arlequin_core::adjacency::Adjacency;
use arlequin_core::{
    GradientPoint, Gradients, Model, Patches, Real, Recovered, Recovery, Result, SymmetricTensor, check_size,
};
use nalgebra::{Matrix3, Point3, Vector3};

/// Centroid and mean shape gradients of an element: displacement gradients of linear elements are most
/// accurate there.
struct Centre<T: Real> {
    position: Point3<T>,
    gradients: [Vector3<T>; 8],
}

fn centre<T: Real>(mesh: &Mesh<T>, e: usize) -> Centre<T> {
    let corners = mesh.element(e);
    let (mut position, mut gradients, mut volume) = (Vector3::zeros(), [Vector3::zeros(); 8], T::zero());
    mesh.for_each_gauss_point(e, |g| {
        volume += g.weight;
        // Weighted by the shape functions: the centroid of the volume, not the mean of the corners.
        for (k, node) in corners.iter().enumerate() {
            position += mesh.nodes()[*node as usize].coords * (g.values[k] * g.weight);
            gradients[k] += g.gradients[k] * g.weight;
        }
    });
    Centre {
        position: Point3::from(position / volume),
        gradients: gradients.map(|g| g / volume),
    }
}

/// Makes the patches of all nodes, from the elements that are awake: displacements of others are those of
/// when they fell asleep. Nodes without any have those of all elements around them.
pub(crate) fn patches<T: Real>(mesh: &Mesh<T>, is_awake: &dyn Fn(usize) -> bool) -> Patches<T> {
    let corners = mesh.kind().corners();
    let samples: Vec<Point3<T>> = (0..mesh.element_count())
        .map(|e| centre(mesh, e).position)
        .collect();
    let [mut has_awake, mut outer] = [vec![false; mesh.nodes().len()], vec![false; mesh.nodes().len()]];
    for (slot, node) in mesh.connectivity().iter().enumerate() {
        has_awake[*node as usize] |= is_awake(slot / corners);
    }
    let slots = mesh.connectivity().iter().enumerate();
    let slots = slots.map(|(slot, node)| (*node, slot / corners));
    let around = Adjacency::new(
        mesh.nodes().len(),
        slots
            .clone()
            .filter(|(node, e)| is_awake(*e) || !has_awake[*node as usize])
            .map(|(node, e)| (node, e as u32)),
    );
    // Nodes of the surface, and those beside elements that sleep, have patches on one side only, which would
    // extrapolate.
    for f in mesh.boundary() {
        mesh.facet_nodes(f).iter().for_each(|k| outer[*k as usize] = true);
    }
    slots.for_each(|(node, e)| outer[node as usize] |= !is_awake(e) && has_awake[node as usize]);
    Patches::new(mesh.nodes(), &samples, |node, out| {
        // An inner node has the elements around it.
        if !outer[node] {
            out.push(around.row(node).to_vec());
            return;
        }
        let mut near: Vec<u32> = around
            .row(node)
            .iter()
            .flat_map(|e| mesh.element(*e as usize))
            .copied()
            .collect();
        near.sort_unstable();
        near.dedup();
        let x = mesh.nodes()[node];
        let inner = || near.iter().filter(|k| !outer[**k as usize]);
        let distance = |k: &u32| (mesh.nodes()[*k as usize] - x).norm();
        let least = inner()
            .map(distance)
            .fold(None, |m: Option<T>, d| Some(m.map_or(d, |m| m.min(d))));
        match least {
            // A surface node uses the patches of the nearest inner nodes that share an element with it. If
            // there are none, its patch holds the elements around it and their neighbours.
            Some(least) => {
                // Nodes at the same distance up to round-off count alike: regular meshes have several nearest
                // ones.
                let reach = least * T::of(1.0 + 1e-6);
                let close = inner().filter(|k| distance(k) <= reach);
                out.extend(close.map(|k| around.row(*k as usize).to_vec()));
            }
            // A body of one element in thickness has no inner node.
            None => {
                let mut grown: Vec<u32> = near
                    .iter()
                    .flat_map(|k| around.row(*k as usize))
                    .copied()
                    .collect();
                grown.sort_unstable();
                grown.dedup();
                out.push(grown);
            }
        }
    })
}

impl<T: Real> FemModel<T> {
    /// Strain \[–\] and stress \[Pa\] of one element.
    fn strain_and_stress(&self, e: usize, q: &[T]) -> [SymmetricTensor<T>; 2] {
        let mesh = self.mesh();
        let c = mesh.kind().components();
        let centre = centre(mesh, e);
        let mut h = Matrix3::zeros();
        for (node, g) in mesh.element(e).iter().zip(&centre.gradients) {
            for a in 0..c {
                (0..3).for_each(|b| h[(a, b)] += q[*node as usize * c + a] * g[b]);
            }
        }
        let strain = SymmetricTensor::from_matrix(&h);
        let material = self.materials().at(e);
        // A bar has axial stress alone, whatever Poisson's ratio.
        let stress = if mesh.kind() == ElementKind::Bar2 {
            let mut pull = SymmetricTensor::zero();
            pull.0[0] = material.young() * strain.0[0];
            pull
        } else {
            material.stress(&strain)
        };
        [strain, stress]
    }
}

impl<T: Real> Recovery<T> for FemModel<T> {
    fn method(&self) -> &'static str {
        "patch recovery: a linear polynomial fitted to the element means around the node"
    }

    fn has_strain(&self) -> bool {
        true
    }

    /// Collective on a partitioned body.
    fn recover(&self, q: &[T], nodes: &[usize], out: &mut Vec<Recovered<T>>) -> Result<()> {
        check_size(self, "displacements", q.len())?;
        let elements = self.mesh().element_count();
        let Some(part) = &self.part else {
            let strain_and_stress = |k: usize| self.strain_and_stress(k, q);
            return self
                .patches()
                .recover(self.name(), nodes, elements, strain_and_stress, out);
        };
        let x = part.receive_for_patches(self.mesh(), q)?;
        let strain_and_stress = |k: usize| self.strain_and_stress(k, &x);
        let places = part.places(self.name(), nodes)?;
        self.patches()
            .recover(self.name(), &places, elements, strain_and_stress, out)
    }
}

impl<T: Real> Gradients<T> for FemModel<T> {
    fn count(&self) -> usize {
        self.mesh().element_count()
    }

    fn for_each_point(&self, cell: usize, visit: &mut dyn FnMut(&GradientPoint<'_, T>)) {
        let nodes = self.mesh().element(cell);
        self.mesh().for_each_gauss_point(cell, |g| {
            visit(&GradientPoint {
                nodes,
                gradients: &g.gradients[..nodes.len()],
                volume: g.weight,
                material: self.materials().at(cell),
            });
        });
    }
}
