//! Internal forces element by element, without a matrix.

use super::{CHUNK, SERIAL};
use crate::element::{self, ElementKind};
use crate::mesh::Mesh;
use arlequin_core::Real;
use arlequin_core::adjacency::Adjacency;
use arlequin_core::material::Elastic;
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

/// Precomputed weights and shape gradients of every Gauss point; forces in two passes, elements then nodes.
#[derive(Debug, Clone)]
pub struct ElementLoop<T: Real> {
    kind: ElementKind,
    material: Elastic<T>,
    connectivity: Vec<u32>,
    incidence: Adjacency,
    /// `α_e` times weight times Jacobian \[m³\], per Gauss point.
    weights: Vec<T>,
    /// Gradients \[1/m\], per Gauss point and corner.
    gradients: Vec<Vector3<T>>,
    /// Forces of every corner of every element \[N\].
    forces: Vec<Vector3<T>>,
}

impl<T: Real> ElementLoop<T> {
    /// The kernel of a mesh with the weight `α_e` \[–\] of every element.
    pub fn new(mesh: &Mesh<T>, material: &Elastic<T>, weights: &[T]) -> Self {
        let n = mesh.kind().corners();
        let mut out = Self {
            kind: mesh.kind(),
            material: *material,
            connectivity: mesh.connectivity().to_vec(),
            incidence: Adjacency::of_slots(mesh.nodes().len(), mesh.connectivity()),
            weights: Vec::new(),
            gradients: Vec::new(),
            forces: vec![Vector3::zeros(); mesh.connectivity().len()],
        };
        for (e, alpha) in weights.iter().enumerate() {
            element::for_each_gauss(mesh.kind(), &mesh.corners(e), mesh.section(), &mut |g| {
                out.weights.push(g.weight * *alpha);
                out.gradients.extend_from_slice(&g.gradients[..n]);
            });
        }
        out
    }

    /// Subtracts `K q` from `f` \[N\]. Allocates nothing.
    pub fn subtract_product(&mut self, q: &[T], f: &mut [T]) {
        match self.kind {
            ElementKind::Bar2 => self.apply::<1, 2>(q, f),
            ElementKind::Tet4 => self.apply::<3, 4>(q, f),
            ElementKind::Hex8 => self.apply::<3, 8>(q, f),
        }
    }

    fn apply<const C: usize, const N: usize>(&mut self, q: &[T], f: &mut [T]) {
        let mut forces = std::mem::take(&mut self.forces);
        let this = &*self;
        let serial = f.len() / C < SERIAL;
        let elements = |chunk: usize, out: &mut [Vector3<T>]| {
            for (k, out) in out.as_chunks_mut::<N>().0.iter_mut().enumerate() {
                this.element_forces::<C, N>(chunk * CHUNK + k, q, out);
            }
        };
        let nodes = |forces: &[Vector3<T>], chunk: usize, f: &mut [T]| {
            for (k, f) in f.as_chunks_mut::<C>().0.iter_mut().enumerate() {
                for &slot in this.incidence.row(chunk * CHUNK + k) {
                    for (f, g) in f.iter_mut().zip(forces[slot as usize].as_slice()) {
                        *f -= *g;
                    }
                }
            }
        };
        if serial {
            forces
                .chunks_mut(CHUNK * N)
                .enumerate()
                .for_each(|(k, o)| elements(k, o));
            f.chunks_mut(CHUNK * C)
                .enumerate()
                .for_each(|(k, f)| nodes(&forces, k, f));
        } else {
            forces
                .par_chunks_mut(CHUNK * N)
                .enumerate()
                .for_each(|(k, o)| elements(k, o));
            f.par_chunks_mut(CHUNK * C)
                .enumerate()
                .for_each(|(k, f)| nodes(&forces, k, f));
        }
        self.forces = forces;
    }

    #[inline]
    fn element_forces<const C: usize, const N: usize>(&self, e: usize, q: &[T], out: &mut [Vector3<T>; N]) {
        let mut u = [Vector3::zeros(); N];
        for (u, &k) in u.iter_mut().zip(&self.connectivity[e * N..(e + 1) * N]) {
            u.as_mut_slice()[..C].copy_from_slice(&q[k as usize * C..(k as usize + 1) * C]);
        }
        *out = [Vector3::zeros(); N];
        let count = self.kind.gauss_count();
        for p in e * count..(e + 1) * count {
            let g = &self.gradients.as_chunks::<N>().0[p];
            let w = self.weights[p];
            if C == 1 {
                let strain = u.iter().zip(g).fold(T::zero(), |s, (u, g)| s + u.x * g.x);
                let stress = strain * self.material.young() * w;
                out.iter_mut().zip(g).for_each(|(o, g)| o.x += g.x * stress);
                continue;
            }
            let mut h = Matrix3::zeros();
            for (u, g) in u.iter().zip(g) {
                h += u * g.transpose();
            }
            let [lambda, mu] = self.material.lame();
            let mut stress = (h + h.transpose()) * (mu * w);
            let pressure = h.trace() * lambda * w;
            (0..3).for_each(|a| stress[(a, a)] += pressure);
            for (o, g) in out.iter_mut().zip(g) {
                *o += stress * g;
            }
        }
    }
}
