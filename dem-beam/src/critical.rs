//! The critical time step `2/omega_max`.
//!
//! The fastest mode of a cohesive-beam packing is a rotation of the smallest spheres. Estimates, from cheap
//! to exact:
//!
//! - [`block_bound`]: `lambda_max <= 2 max_i lambda_max(M_i^-1 K_ii)` gives 0.7 to 0.8 of the critical step.
//!   It is always safe.
//! - [`lanczos`]: the largest Ritz value plus its residual, in memory of a few vectors.
//! - `min sqrt(m/k_n)` from the literature considers translations only. It gives 1.8 times the critical step
//!   and is not offered.

use crate::error::{Error, Result};
use crate::kernel::law::Linear;
use crate::model::forces::{BondForces, Gather};
use crate::particles::BondedParticles;
use arlequin_core::Owned;
use arlequin_core::{DofLayout, spectrum};
use nalgebra::Matrix6;
use rayon::prelude::*;

/// Particles per unit of parallel work.
const CHUNK: usize = 512;

/// Returns the diagonal 6 x 6 block of the stiffness of each particle.
pub(crate) fn diagonal_blocks(body: &BondedParticles) -> Vec<Matrix6<f64>> {
    let mut out = vec![Matrix6::zeros(); body.len()];
    for (bond, &[i, j]) in body.bonds().zip(body.pairs()) {
        out[i as usize] += bond.own_block(body.rigidity());
        out[j as usize] += bond.reversed().own_block(body.rigidity());
    }
    out
}

/// Returns a time step \[s\] that is stable with velocity Verlet for any packing.
///
/// # Errors
/// [`Error::OutOfRange`] if no particle has both mass and stiffness.
pub fn block_bound(body: &BondedParticles) -> Result<f64> {
    // The bound holds because a bond's energy is a nonnegative quadratic form. It obeys `U(x_i, x_j) <= 2
    // (U(x_i, 0) + U(0, x_j))`, and the sum over bonds is `K <= 2 diag(K_ii)`.
    let mut top = 0.0_f64;
    for (p, mut k) in diagonal_blocks(body).into_iter().enumerate() {
        let (m, i) = (body.mass()[p], body.inertia()[p]);
        // Particles of weight zero have no mass; the kernel does not move them.
        if m <= 0.0 || i <= 0.0 {
            continue;
        }
        // `M^-1/2 K M^-1/2` is symmetric and has the eigenvalues of `M^-1 K`.
        let scale: [f64; 6] = std::array::from_fn(|c| if c < 3 { m } else { i }.sqrt().recip());
        for r in 0..6 {
            for c in 0..6 {
                k[(r, c)] *= scale[r] * scale[c];
            }
        }
        top = top.max(k.symmetric_eigenvalues().max());
    }
    // The factor two of `K <= 2 diag(K_ii)`.
    step_from_eigenvalue(2.0 * top)
}

/// Margin of [`bound`] for the stiffnesses of the kernel, which are rounded to single precision.
const ROUNDED: f64 = 1e-6;

/// Returns an upper bound of the largest eigenvalue of `M⁻¹K` \[1/s²\] from the blocks of the first `owned`
/// particles. It is at most 12 % above twice the largest eigenvalue of a block, on which [`block_bound`]
/// rests.
pub(crate) fn bound(body: &BondedParticles, owned: usize, inverse_inertia: &[f64]) -> f64 {
    let adjacency = body.adjacency();
    let of_particle = |p: usize| {
        let mut block = Matrix6::zeros();
        for &[_, b] in adjacency.row(p) {
            let bond = body.bond(b as usize);
            let is_first = body.pairs()[b as usize][0] as usize == p;
            let bond = if is_first { bond } else { bond.reversed() };
            block += bond.own_block(body.rigidity());
        }
        let unknown = |c: usize| if c < 3 { 3 * p + c } else { 3 * (owned + p) + c - 3 };
        let root: [f64; 6] = std::array::from_fn(|c| inverse_inertia[unknown(c)].sqrt());
        top_of(&Matrix6::from_fn(|r, c| block[(r, c)] * root[r] * root[c]))
    };
    let top = (0..owned).into_par_iter().with_min_len(CHUNK).map(of_particle);
    // The largest of all does not depend on the order.
    2.0 * (1.0 + ROUNDED) * top.reduce(|| 0.0, f64::max)
}

/// Upper bound of the largest eigenvalue of a symmetric matrix without negative eigenvalues, at most 12 %
/// above it.
fn top_of(a: &Matrix6<f64>) -> f64 {
    // `tr(A¹⁶) = Σ λ¹⁶`; the powers of a matrix of trace one stay in range.
    let trace = a.trace();
    if trace <= 0.0 {
        return 0.0;
    }
    if !trace.is_finite() {
        return f64::INFINITY;
    }
    let mut power = a / trace;
    for _ in 0..3 {
        power *= power;
    }
    trace * power.norm_squared().powf(1.0 / 16.0)
}

/// Returns the critical step \[s\] by Lanczos iteration, at most 5e-5 (relative) above the exact value.
///
/// # Errors
/// [`Error::OutOfRange`] if no particle has both mass and stiffness.
pub fn lanczos(body: &BondedParticles) -> Result<f64> {
    let root = |m: &f64| if *m > 0.0 { m.sqrt().recip() } else { 0.0 };
    let layout = DofLayout {
        nodes: body.len(),
        components: 3,
        rotations: 3,
    };
    let inertia = body.mass().iter().chain(body.inertia());
    let root: Vec<f64> = inertia.flat_map(|m| [root(m); 3]).collect();
    let mut bonds = Gather::<Linear>::new(body);
    step_from_eigenvalue(largest((&root, layout, &Owned::whole(body.len())), &mut bonds)?)
}

/// Returns an upper estimate of the largest eigenvalue of `R K R`, with `R = diag(root)` and the stiffness
/// `K` of the bonds.
pub(crate) fn largest(
    (root, layout, owned): (&[f64], DofLayout, &Owned),
    bonds: &mut dyn BondForces,
) -> arlequin_core::Result<f64> {
    // Particles that are held in all six components take no forces.
    let (linear, angular) = root.split_at(layout.translations());
    let is_held = |part: &[f64], i: usize| part[3 * i..3 * i + 3].iter().all(|r| *r <= 0.0);
    bonds.leave_out(&|i| is_held(linear, i) && is_held(angular, i));
    let top = spectrum::largest_ritz(root, layout, owned, &mut |q, f| Ok(bonds.add(q, f, None)?));
    bonds.leave_out(&|_| false);
    top
}

fn step_from_eigenvalue(lambda: f64) -> Result<f64> {
    if lambda.is_finite() && lambda > 0.0 {
        // Central differences are stable for `Δt ω ≤ 2`.
        Ok(2.0 / lambda.sqrt())
    } else {
        Err(Error::out_of_range(
            "largest squared frequency",
            lambda,
            "finite values > 0: the body needs mass and stiffness",
        ))
    }
}
