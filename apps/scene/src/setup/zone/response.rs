//! Responses of a packing to strains of the body: displacements `χ` of its spheres beside the field `u = ε x`
//! of a unit strain.
//!
//! ```text
//! (K + ω² M) χ = −K u,   ω = c/h
//! ```
//!
//! Fluctuations shorter than an element `h` of the body relax; longer ones belong to the field of the body
//! itself. A field alone stores more energy in a random packing than its equilibrium does (Voigt's bound).
//! Unknowns that supports hold have the field.

use crate::error::{Result, core};
use arlequin::core::nalgebra::{Matrix3, Vector3};
use arlequin::core::{Model, Response, Uniform};

/// Residual of the equilibria, in the norm by inverse mass; the error of the energy is of the order of its
/// square.
const TOLERANCE: f64 = 1e-2;
/// Largest number of iterations. The condition is that of `(ω_max/ω)²`, a few hundred.
const ITERATIONS: usize = 1000;
/// Size of the strains \[–\], so that laws with finite rotations stay linear.
const SMALL: f64 = 1e-6;
/// Places of the strains in a gradient, in the order `xx yy zz yz zx xy`.
const PLACES: [[usize; 2]; 6] = [[0, 0], [1, 1], [2, 2], [1, 2], [2, 0], [0, 1]];

/// Finds the responses of all nodes of `model`, which must have its whole weight; `rate` is `ω` \[1/s\], and
/// supports hold the unknowns `held`.
pub(super) fn responses(model: &mut dyn Model<f64>, rate: f64, held: &[usize]) -> Result<Vec<Response<f64>>> {
    let layout = model.layout();
    let mut mass = vec![0.0; layout.dofs()];
    model
        .lumped_inertia(&Uniform(1.0), &mut mass)
        .map_err(core("zone"))?;
    // What is held does not move.
    let mut inverse: Vec<f64> = mass.iter().map(|m| 1.0 / m).collect();
    held.iter().for_each(|k| inverse[*k] = 0.0);
    let mut out = vec![Response([[Vector3::zeros(); 2]; 6]); layout.nodes];
    for (k, [i, j]) in PLACES.into_iter().enumerate() {
        let mut strain = Matrix3::zeros();
        strain[(i, j)] += 0.5 * SMALL;
        strain[(j, i)] += 0.5 * SMALL;
        let mut u = vec![0.0; layout.dofs()];
        for (u, x) in u.chunks_exact_mut(3).zip(model.nodes()) {
            u.copy_from_slice((strain * x.coords).as_slice());
        }
        let chi = relaxed(model, &u, (&mass, &inverse, rate * rate))?;
        let (moves, turns) = chi.split_at(layout.translations());
        for (r, (u, th)) in out
            .iter_mut()
            .zip(moves.chunks_exact(3).zip(turns.chunks_exact(3)))
        {
            r.0[k] = [u, th].map(|v| Vector3::from_column_slice(v) / SMALL);
        }
    }
    Ok(out)
}

/// Solves `(K + s M) χ = −K u` by conjugate gradients with the masses as preconditioner.
fn relaxed(
    model: &mut dyn Model<f64>,
    u: &[f64],
    (mass, inverse, s): (&[f64], &[f64], f64),
) -> Result<Vec<f64>> {
    // Internal forces are `−K u`.
    let mut forces = |q: &[f64]| {
        let mut f = vec![0.0; q.len()];
        model.add_internal_forces(q, &mut f).map_err(core("zone"))?;
        Ok(f)
    };
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let by_mass = |r: &[f64]| r.iter().zip(inverse).map(|(r, m)| r * m).collect::<Vec<f64>>();
    let mut r = forces(u)?;
    let mut x = vec![0.0; u.len()];
    let mut p = by_mass(&r);
    let mut size = dot(&r, &p);
    let enough = size * TOLERANCE * TOLERANCE;
    for _ in 0..ITERATIONS {
        if size <= enough {
            break;
        }
        let f = forces(&p)?;
        let product: Vec<f64> = (0..p.len()).map(|i| s * mass[i] * p[i] - f[i]).collect();
        let step = size / dot(&p, &product);
        for i in 0..p.len() {
            x[i] += step * p[i];
            r[i] -= step * product[i];
        }
        let z = by_mass(&r);
        let next = dot(&r, &z);
        let share = next / size;
        p.iter_mut().zip(&z).for_each(|(p, z)| *p = z + share * *p);
        size = next;
    }
    Ok(x)
}
