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
    let mut space = Space::new(layout.dofs());
    for (k, [i, j]) in PLACES.into_iter().enumerate() {
        let mut strain = Matrix3::zeros();
        strain[(i, j)] += 0.5 * SMALL;
        strain[(j, i)] += 0.5 * SMALL;
        // Rotations of the field are zero; the last strain left others here.
        space.p.fill(0.0);
        for (u, x) in space.p.chunks_exact_mut(3).zip(model.nodes()) {
            u.copy_from_slice((strain * x.coords).as_slice());
        }
        space.relax(model, (&mass, &inverse, rate * rate))?;
        let (moves, turns) = space.x.split_at(layout.translations());
        for (r, (u, th)) in out
            .iter_mut()
            .zip(moves.chunks_exact(3).zip(turns.chunks_exact(3)))
        {
            r.0[k] = [u, th].map(|v| Vector3::from_column_slice(v) / SMALL);
        }
    }
    Ok(out)
}

/// Vectors of the conjugate gradients. They are allocated once: new ones in every iteration would cost more
/// than the sums.
struct Space {
    /// Solution `χ`.
    x: Vec<f64>,
    /// Residual.
    r: Vec<f64>,
    /// At first the displacements `u`, then the direction of search.
    p: Vec<f64>,
    /// Forces `−K p`.
    f: Vec<f64>,
}

impl Space {
    fn new(dofs: usize) -> Self {
        let zero = || vec![0.0; dofs];
        Self {
            x: zero(),
            r: zero(),
            p: zero(),
            f: zero(),
        }
    }

    /// Solves `(K + s M) χ = −K u` by conjugate gradients with the masses as preconditioner.
    fn relax(&mut self, model: &mut dyn Model<f64>, (mass, inverse, s): (&[f64], &[f64], f64)) -> Result<()> {
        let Self { x, r, p, f } = self;
        // Internal forces are `−K u`.
        r.fill(0.0);
        model.add_internal_forces(p, r).map_err(core("zone"))?;
        x.fill(0.0);
        let by_mass = r.iter().zip(inverse).map(|(r, m)| r * m);
        p.iter_mut().zip(by_mass).for_each(|(p, z)| *p = z);
        let mut size = r.iter().zip(&*p).map(|(r, p)| r * p).sum::<f64>();
        let enough = size * TOLERANCE * TOLERANCE;
        for _ in 0..ITERATIONS {
            if size <= enough {
                break;
            }
            f.fill(0.0);
            model.add_internal_forces(p, f).map_err(core("zone"))?;
            let mut power = 0.0;
            for ((f, p), m) in f.iter_mut().zip(&*p).zip(mass) {
                // The product with the whole matrix takes the place of the forces.
                *f = s * m * p - *f;
                power += p * *f;
            }
            let step = size / power;
            let mut next = 0.0;
            for (((x, r), (p, f)), m) in x.iter_mut().zip(&mut *r).zip(p.iter().zip(&*f)).zip(inverse) {
                *x += step * p;
                *r -= step * f;
                next += *r * (*r * m);
            }
            let share = next / size;
            for ((p, r), m) in p.iter_mut().zip(&*r).zip(inverse) {
                *p = r * m + share * *p;
            }
            size = next;
        }
        Ok(())
    }
}
