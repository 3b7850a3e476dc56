//! The critical time step `2/omega_max`.
//!
//! The fastest mode of a cohesive-beam packing is a rotation of the smallest spheres. Three
//! estimates, from cheap to exact:
//!
//! - [`block_bound`]: `lambda_max <= 2 max_i lambda_max(M_i^-1 K_ii)`, always safe, 0.7 to 0.8 of
//!   the critical step. The default.
//! - [`lanczos`]: the largest Ritz value plus its residual, in memory of a few vectors.
//! - `min sqrt(m/k_n)`, found in the literature, looks at translations only: 1.8 times the critical
//!   step, hence not offered.
//!
//! Why the block bound holds: a bond's energy obeys `U(x_i, x_j) <= 2 (U(x_i, 0) + U(0, x_j))`
//! because it is a nonnegative quadratic form; summed over bonds, `K <= 2 diag(K_ii)`.

use crate::error::{Error, Result};
use crate::kernel::law::Linear;
use crate::model::forces::Gather;
use crate::particles::BondedParticles;
use nalgebra::Matrix6;

/// Diagonal blocks of the stiffness.
pub(crate) fn diagonal_blocks(body: &BondedParticles) -> Vec<Matrix6<f64>> {
    let mut out = vec![Matrix6::zeros(); body.len()];
    for (bond, &[i, j]) in body.bonds().iter().zip(body.pairs()) {
        out[i as usize] += bond.own_block(body.rigidity());
        out[j as usize] += bond.reversed().own_block(body.rigidity());
    }
    out
}

/// A step \[s\] that is safe for velocity Verlet, whatever the packing.
///
/// # Errors
/// [`Error::OutOfRange`] if no particle has both mass and stiffness.
pub fn block_bound(body: &BondedParticles) -> Result<f64> {
    let mut top = 0.0_f64;
    for (p, mut k) in diagonal_blocks(body).into_iter().enumerate() {
        let (m, i) = (body.mass()[p], body.inertia()[p]);
        // Weighted out of existence: the kernel holds such a particle still.
        if m <= 0.0 || i <= 0.0 {
            continue;
        }
        let scale: [f64; 6] = std::array::from_fn(|c| if c < 3 { m } else { i }.sqrt().recip());
        for r in 0..6 {
            for c in 0..6 {
                k[(r, c)] *= scale[r] * scale[c];
            }
        }
        top = top.max(k.symmetric_eigenvalues().max());
    }
    step_of(2.0 * top)
}

/// The critical step \[s\] by Lanczos iteration: never above it by more than 5e-5 of it.
///
/// # Errors
/// [`Error::OutOfRange`] if no particle has both mass and stiffness.
pub fn lanczos(body: &BondedParticles) -> Result<f64> {
    let root = |m: &f64| if *m > 0.0 { m.sqrt().recip() } else { 0.0 };
    let inertia = body.mass().iter().chain(body.inertia());
    let root: Vec<f64> = inertia.flat_map(|m| [root(m); 3]).collect();
    let mut bonds = Gather::<Linear>::new(body);
    step_of(largest(&root, &mut |q, f| bonds.add(q, f, None)))
}

/// Most iterations; about sixty settle the top of the spectrum.
const LIMIT: usize = 300;

/// Relative residual at which the largest Ritz value is taken.
const SETTLED: f64 = 1e-4;

/// A fixed sequence in (-1, 1) without symmetry.
fn start(i: usize) -> f64 {
    let x = ((i as f64 + 1.0) * 0.618_033_988_749_894_9).fract();
    2.0 * (x * 7.31 + 0.137 * x * x).fract() - 0.9
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Upper estimate (largest Ritz value plus its residual) of the largest eigenvalue of
/// `R K R`, `R = diag(root)`, where `apply` adds `-K q`; zero if nothing moves.
pub(crate) fn largest(root: &[f64], apply: &mut dyn FnMut(&[f64], &mut [f64])) -> f64 {
    let n = root.len();
    let mut v: Vec<f64> = (0..n)
        .map(|i| if root[i] > 0.0 { start(i) } else { 0.0 })
        .collect();
    let norm = dot(&v, &v).sqrt();
    if norm <= 0.0 {
        return 0.0;
    }
    v.iter_mut().for_each(|v| *v /= norm);
    let (mut last, mut q, mut w) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    let (mut diagonal, mut off): (Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new());
    let mut beta = 0.0;
    let mut top = 0.0;
    for step in 1..=LIMIT.min(n) {
        q.iter_mut()
            .zip(root.iter().zip(&v))
            .for_each(|(q, (r, v))| *q = r * v);
        w.fill(0.0);
        apply(&q, &mut w);
        w.iter_mut().zip(root).for_each(|(w, r)| *w *= -r);
        let alpha = dot(&v, &w);
        for ((w, v), l) in w.iter_mut().zip(&v).zip(&last) {
            *w -= alpha * v + beta * l;
        }
        diagonal.push(alpha);
        beta = dot(&w, &w).sqrt();
        let invariant = beta <= 1e-14 * alpha.abs();
        if invariant || step % 10 == 0 || step == LIMIT.min(n) {
            let (value, end) = top_ritz(&diagonal, &off);
            let rest = if invariant { 0.0 } else { beta * end.abs() };
            top = value + rest;
            if rest <= SETTLED * value || invariant {
                break;
            }
        }
        off.push(beta);
        w.iter_mut().for_each(|w| *w /= beta);
        std::mem::swap(&mut last, &mut v);
        std::mem::swap(&mut v, &mut w);
    }
    top.max(0.0)
}

/// Largest eigenvalue of a symmetric tridiagonal matrix and the last entry of its unit vector.
fn top_ritz(diagonal: &[f64], off: &[f64]) -> (f64, f64) {
    let m = diagonal.len();
    let matrix = nalgebra::DMatrix::from_fn(m, m, |r, c| match r.abs_diff(c) {
        0 => diagonal[r],
        1 => off[r.min(c)],
        _ => 0.0,
    });
    let eigen = matrix.symmetric_eigen();
    let k = eigen.eigenvalues.imax();
    (eigen.eigenvalues[k], eigen.eigenvectors[(m - 1, k)])
}

fn step_of(lambda: f64) -> Result<f64> {
    if lambda.is_finite() && lambda > 0.0 {
        Ok(2.0 / lambda.sqrt())
    } else {
        Err(Error::out_of_range(
            "largest squared frequency",
            lambda,
            "finite values > 0: the body needs mass and stiffness",
        ))
    }
}
