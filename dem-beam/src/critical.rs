//! The critical time step `2/omega_max`.
//!
//! The fastest mode of a cohesive-beam packing is a rotation of the smallest spheres. Three
//! estimates, from cheap to exact:
//!
//! - [`block_bound`]: `lambda_max <= 2 max_i lambda_max(M_i^-1 K_ii)`, always safe, 0.7 to 0.8 of
//!   the critical step. The default.
//! - [`lanczos`]: the largest Ritz value plus its residual, good to 1e-5 after 60 steps.
//! - `min sqrt(m/k_n)`, found in the literature, looks at translations only: 1.8 times the critical
//!   step, hence not offered.
//!
//! Why the block bound holds: a bond's energy obeys `U(x_i, x_j) <= 2 (U(x_i, 0) + U(0, x_j))`
//! because it is a nonnegative quadratic form; summed over bonds, `K <= 2 diag(K_ii)`.

use crate::bond::Twist;
use crate::error::{Error, Result};
use crate::particles::BondedParticles;
use nalgebra::{Matrix6, Vector3};

/// Diagonal blocks of the stiffness.
pub(crate) fn diagonal_blocks(body: &BondedParticles) -> Vec<Matrix6<f64>> {
    let mut out = vec![Matrix6::zeros(); body.len()];
    for (bond, &[i, j]) in body.bonds().iter().zip(body.pairs()) {
        out[i as usize] += bond.own_block(body.rigidity());
        out[j as usize] += bond.reversed().own_block(body.rigidity());
    }
    out
}

/// A step (s) that is safe for velocity Verlet, whatever the packing.
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

/// The critical step (s) by `steps` Lanczos steps from a fixed start; 60 are enough.
///
/// # Errors
/// [`Error::OutOfRange`] for zero steps, or if no particle has both mass and stiffness.
pub fn lanczos(body: &BondedParticles, steps: usize) -> Result<f64> {
    if steps == 0 {
        return Err(Error::OutOfRange {
            name: "Lanczos steps",
            value: 0.0,
            range: "values >= 1",
        });
    }
    let n = body.len();
    let root = |m: f64| if m > 0.0 { m.sqrt().recip() } else { 0.0 };
    let scale: Vec<[f64; 2]> = body
        .mass()
        .iter()
        .zip(body.inertia())
        .map(|(&m, &i)| [root(m), root(i)])
        .collect();
    let weigh = |x: &[Twist]| -> Vec<Twist> {
        x.iter()
            .zip(&scale)
            .map(|(x, s)| Twist {
                linear: x.linear * s[0],
                angular: x.angular * s[1],
            })
            .collect()
    };
    let dot = |a: &[Twist], b: &[Twist]| -> f64 {
        a.iter()
            .zip(b)
            .map(|(a, b)| a.linear.dot(&b.linear) + a.angular.dot(&b.angular))
            .sum()
    };
    // A start without symmetry, the same every time.
    let noise = |p: usize, c: usize| ((p * 6 + c) as f64 * 12.9898).sin() + 0.1;
    let mut v: Vec<Twist> = (0..n)
        .map(|p| Twist {
            linear: Vector3::new(noise(p, 0), noise(p, 1), noise(p, 2)) * f64::from(scale[p][0] > 0.0),
            angular: Vector3::new(noise(p, 3), noise(p, 4), noise(p, 5)) * f64::from(scale[p][1] > 0.0),
        })
        .collect();
    let norm = dot(&v, &v).sqrt();
    v.iter_mut().for_each(|x| {
        *x = Twist {
            linear: x.linear / norm,
            angular: x.angular / norm,
        }
    });
    let mut last = vec![Twist::zero(); n];
    let (mut diagonal, mut off): (Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new());
    let mut beta = 0.0;
    for _ in 0..steps {
        let mut force = vec![Twist::zero(); n];
        body.add_forces(&weigh(&v), &mut force)?;
        let mut w = weigh(&force);
        let alpha = -dot(&v, &w);
        for ((w, v), l) in w.iter_mut().zip(&v).zip(&last) {
            w.linear = -w.linear - v.linear * alpha - l.linear * beta;
            w.angular = -w.angular - v.angular * alpha - l.angular * beta;
        }
        diagonal.push(alpha);
        beta = dot(&w, &w).sqrt();
        // An invariant subspace: the Ritz values are exact.
        if beta <= 1e-14 * alpha.abs() {
            beta = 0.0;
            break;
        }
        off.push(beta);
        w.iter_mut().for_each(|x| {
            *x = Twist {
                linear: x.linear / beta,
                angular: x.angular / beta,
            }
        });
        last = std::mem::replace(&mut v, w);
    }
    off.truncate(diagonal.len() - 1);
    let (value, end) = top_ritz(&diagonal, &off);
    step_of(value + beta * end.abs())
}

/// Largest eigenvalue of a symmetric tridiagonal matrix and the last entry of its unit vector.
pub(crate) fn top_ritz(diagonal: &[f64], off: &[f64]) -> (f64, f64) {
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
        Err(Error::OutOfRange {
            name: "largest squared frequency",
            value: lambda,
            range: "finite values > 0: the body needs mass and stiffness",
        })
    }
}

/// Refuses a step above the critical one.
///
/// # Errors
/// [`Error::StepTooLarge`].
pub fn check_step(step: f64, critical: f64) -> Result<()> {
    if step <= critical {
        Ok(())
    } else {
        Err(Error::StepTooLarge { step, critical })
    }
}
