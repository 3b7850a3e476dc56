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
use arlequin::core::nalgebra::Vector3;
use arlequin::core::{Model, Response, Uniform};
use rayon::prelude::*;

/// Residual of the equilibria, in the norm by inverse mass; the error of the energy is of the order of its
/// square.
const TOLERANCE: f64 = 1e-2;
/// Largest number of iterations. The condition is that of `(ω_max/ω)²`, a few hundred.
const ITERATIONS: usize = 1000;
/// Size of the strains \[–\], so that laws with finite rotations stay linear.
const SMALL: f64 = 1e-6;
/// Finds the responses of all nodes of `model`, which must have its whole weight; `rate` is `ω` \[1/s\], and
/// supports hold the unknowns `held`.
pub(super) fn responses(model: &mut dyn Model<f64>, rate: f64, held: &[usize]) -> Result<Vec<Response>> {
    let layout = model.layout();
    let mut out = vec![Response([[Vector3::zeros(); 2]; 6]); layout.nodes];
    let mut space = Space::new(model, rate * rate)?;
    for (k, strain) in Response::gradients(SMALL).into_iter().enumerate() {
        // Rotations of the field are zero; the last strain left others here.
        space.p.fill(0.0);
        for (u, x) in space.p.chunks_exact_mut(3).zip(model.nodes()) {
            u.copy_from_slice((strain * x.coords).as_slice());
        }
        space.relax(model, held)?;
        let (moves, turns) = space.x.split_at(layout.translations());
        for (r, (u, th)) in out
            .iter_mut()
            .zip(moves.chunks_exact(3).zip(turns.chunks_exact(3)))
        {
            r.0[k] = [u, th].map(|v| Vector3::from_iterator(v.iter().map(|x| (x / SMALL) as f32)));
        }
    }
    Ok(out)
}

/// Numbers per task, whole nodes.
const CHUNK: usize = 3 << 12;

/// Vectors of the conjugate gradients. They are allocated once: new ones in every iteration would cost more
/// than the sums. Passes are few and on all threads, since the time goes into memory.
struct Space {
    /// Solution `χ`.
    x: Vec<f64>,
    /// Residual.
    r: Vec<f64>,
    /// At first the displacements `u`, then the direction of search.
    p: Vec<f64>,
    /// Forces `−K p`.
    f: Vec<f64>,
    /// Masses of all nodes \[kg\], then their moments of inertia \[kg m²\].
    mass: Vec<f64>,
    /// Square `s` of the rate.
    square: f64,
    /// Factor of the masses as preconditioner, a power of two near `s`. Directions of search then have the
    /// size of the solution, in which laws with finite rotations are linear; the bits of the solution do not
    /// depend on it.
    scale: f64,
}

impl Space {
    fn new(model: &dyn Model<f64>, square: f64) -> Result<Self> {
        let dofs = model.layout().dofs();
        let zero = || vec![0.0; dofs];
        let mut mass = zero();
        model
            .lumped_inertia(&Uniform(1.0), &mut mass)
            .map_err(core("zone"))?;
        Ok(Self {
            x: zero(),
            r: zero(),
            p: zero(),
            f: zero(),
            mass: mass.into_iter().step_by(3).collect(),
            square,
            scale: square.log2().round().exp2(),
        })
    }

    /// Solves `(K + s M) χ = −K u` by conjugate gradients with the masses as preconditioner. Unknowns that
    /// are `held` do not move.
    fn relax(&mut self, model: &mut dyn Model<f64>, held: &[usize]) -> Result<()> {
        // Internal forces are `−K u`.
        self.r.fill(0.0);
        model
            .add_internal_forces(&self.p, &mut self.r)
            .map_err(core("zone"))?;
        held.iter().for_each(|k| self.r[*k] = 0.0);
        self.x.fill(0.0);
        let mut size = self.descend(0.0);
        let enough = size * TOLERANCE * TOLERANCE;
        self.search([0.0, 0.0]);
        for _ in 0..ITERATIONS {
            if size <= enough {
                break;
            }
            self.f.fill(0.0);
            model
                .add_internal_forces(&self.p, &mut self.f)
                .map_err(core("zone"))?;
            held.iter().for_each(|k| self.f[*k] = 0.0);
            let step = size / self.power();
            let next = self.descend(step);
            self.search([step, next / size]);
            size = next;
        }
        Ok(())
    }

    /// Replaces the forces `−K p` by `(K + s M) p`, and returns `pᵀ (K + s M) p`.
    fn power(&mut self) -> f64 {
        let s = self.square;
        let of_nodes = |((f, p), mass): ((&mut [f64], &[f64]), &[f64])| -> f64 {
            let nodes = f.as_chunks_mut::<3>().0.iter_mut().zip(p.as_chunks::<3>().0);
            let product = |((f, p), m): ((&mut [f64; 3], &[f64; 3]), &f64)| -> f64 {
                *f = std::array::from_fn(|c| s * m * p[c] - f[c]);
                f[0] * p[0] + f[1] * p[1] + f[2] * p[2]
            };
            nodes.zip(mass).map(product).sum()
        };
        let chunks = self.f.par_chunks_mut(CHUNK).zip(self.p.par_chunks(CHUNK));
        let chunks = chunks.zip(self.mass.par_chunks(CHUNK / 3));
        total(chunks.map(of_nodes).collect())
    }

    /// Subtracts `step · f` from the residual `r`, and returns `rᵀ M⁻¹ r` over the scale.
    fn descend(&mut self, step: f64) -> f64 {
        let scale = self.scale;
        let of_nodes = |((r, f), mass): ((&mut [f64], &[f64]), &[f64])| -> f64 {
            let nodes = r.as_chunks_mut::<3>().0.iter_mut().zip(f.as_chunks::<3>().0);
            let square = |((r, f), m): ((&mut [f64; 3], &[f64; 3]), &f64)| -> f64 {
                (0..3).for_each(|c| r[c] -= step * f[c]);
                (r[0] * r[0] + r[1] * r[1] + r[2] * r[2]) / (scale * m)
            };
            nodes.zip(mass).map(square).sum()
        };
        let chunks = self.r.par_chunks_mut(CHUNK).zip(self.f.par_chunks(CHUNK));
        let chunks = chunks.zip(self.mass.par_chunks(CHUNK / 3));
        total(chunks.map(of_nodes).collect())
    }

    /// Adds `step · p` to the solution, and sets the next direction `p = M⁻¹ r + share · p`, with `M⁻¹` over
    /// the scale.
    fn search(&mut self, [step, share]: [f64; 2]) {
        let scale = self.scale;
        let targets = self.x.par_chunks_mut(CHUNK).zip(self.p.par_chunks_mut(CHUNK));
        let sources = self.r.par_chunks(CHUNK).zip(self.mass.par_chunks(CHUNK / 3));
        targets.zip(sources).for_each(|((x, p), (r, mass))| {
            let directions = x.as_chunks_mut::<3>().0.iter_mut().zip(p.as_chunks_mut::<3>().0);
            for (((x, p), r), m) in directions.zip(r.as_chunks::<3>().0).zip(mass) {
                let inverse = 1.0 / (scale * m);
                for c in 0..3 {
                    x[c] += step * p[c];
                    p[c] = r[c] * inverse + share * p[c];
                }
            }
        });
    }
}

/// Sum in the order of the tasks, whatever thread had them.
fn total(parts: Vec<f64>) -> f64 {
    parts.into_iter().sum()
}
