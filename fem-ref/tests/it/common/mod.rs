//! Helpers shared by the test targets.

use arlequin_core::Real;
use arlequin_core::nalgebra::{Point3, Vector3};
use arlequin_core::sprs::{CsMat, TriMat};
use fem_ref::{Elastic, ElementKind, Mesh, generate};

/// Returns a repeatable sequence in (−1, 1).
pub(crate) fn noise(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

/// Returns a box of 4 × 3 × 3 cells whose nodes, also those of the border, are moved by up to `amount` cells.
pub(crate) fn jittered(kind: ElementKind, amount: f64, seed: u64) -> Mesh<f64> {
    let size = Point3::new(4.0, 3.0, 3.0);
    let mesh = generate::block(kind, Point3::origin(), size, [4, 3, 3]).unwrap();
    let mut next = noise(seed);
    let moves: Vec<Vector3<f64>> = mesh
        .nodes()
        .iter()
        .map(|_| Vector3::new(next(), next(), next()) * amount)
        .collect();
    let index = |p: &Point3<f64>| mesh.nodes().iter().position(|q| q == p).unwrap();
    mesh.clone().mapped(|p| p + moves[index(p)]).unwrap()
}

pub(crate) fn silica<T: Real>() -> Elastic<T> {
    Elastic::new(T::of(72.5e9), T::of(0.17), T::of(2200.0)).unwrap()
}

/// Returns `K` without the rows and columns of prescribed unknowns, and the map from free to all unknowns.
pub(crate) fn free_part(k: &CsMat<f64>, fixed: &[bool]) -> (CsMat<f64>, Vec<usize>) {
    let free: Vec<usize> = (0..fixed.len()).filter(|&i| !fixed[i]).collect();
    let mut place = vec![usize::MAX; fixed.len()];
    free.iter().enumerate().for_each(|(a, &i)| place[i] = a);
    let mut t = TriMat::new((free.len(), free.len()));
    for (v, (i, j)) in k.iter() {
        if !fixed[i] && !fixed[j] {
            t.add_triplet(place[i], place[j], *v);
        }
    }
    (t.to_csr(), free)
}

/// Solves `K u = f` for the free unknowns; the others keep their values in `u`.
pub(crate) fn solve(k: &CsMat<f64>, fixed: &[bool], f: &[f64], u: &mut [f64]) {
    let (kff, free) = free_part(k, fixed);
    let mut b: Vec<f64> = free.iter().map(|&i| f[i]).collect();
    for (a, &i) in free.iter().enumerate() {
        let row = k.outer_view(i).unwrap();
        b[a] -= row
            .iter()
            .filter(|(j, _)| fixed[*j])
            .map(|(j, v)| v * u[j])
            .sum::<f64>();
    }
    f64::cholesky(&kff, None).unwrap().solve(&mut b);
    free.iter().zip(b).for_each(|(&i, x)| u[i] = x);
}

pub(crate) fn largest(v: &[f64]) -> f64 {
    v.iter().fold(0.0, |m, x| f64::max(m, x.abs()))
}
