//! Static equilibrium of the linear law by preconditioned conjugate gradients.
//!
//! Solves `K x = f` with components held at given values; the preconditioner inverts the 6 x 6 block of each
//! particle. Each particle gathers its own forces, and dot products are summed in chunks of fixed order, so
//! that the result is bit-identical for any number of threads. The supports may leave rigid motions free as
//! long as the loads do no work on them.

use crate::bond::{LinearBond, Twist};
use crate::critical::diagonal_blocks;
use crate::error::{Error, Result};
use crate::particles::{BondedParticles, expect_len};
use arlequin_core::adjacency::Adjacency;
use nalgebra::{Matrix6, Vector3, Vector6};
use rayon::prelude::*;

/// Particles per parallel task and per partial sum. It is fixed, not chosen from the number of threads, so
/// that sums keep their order.
const CHUNK: usize = 512;

type Six = Vector6<f64>;

/// Solution of a static problem.
#[derive(Debug, Clone)]
pub struct Equilibrium {
    /// Displacements \[m\] and rotations \[rad\].
    pub displacements: Vec<Twist>,
    /// Forces \[N\] and torques \[N m\] of the supports on the particles; zero where free.
    pub reactions: Vec<Twist>,
    /// Iterations of the solver.
    pub iterations: usize,
    /// Residual over the first residual, in the norm of the preconditioner.
    pub residual: f64,
}

/// Components of a particle's motion that are held.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Held {
    /// Translations along x, y, z.
    pub linear: [bool; 3],
    /// Rotations about x, y, z.
    pub angular: [bool; 3],
}

impl Held {
    /// Holds all six components.
    pub const ALL: Self = Self {
        linear: [true; 3],
        angular: [true; 3],
    };
}

/// Supports and loads of a static problem, one entry per particle.
#[derive(Debug, Clone)]
pub struct StaticProblem {
    /// Held components.
    pub held: Vec<Held>,
    /// Value of the held components, and start of the iteration for the others.
    pub start: Vec<Twist>,
    /// External forces and torques.
    pub loads: Vec<Twist>,
}

impl StaticProblem {
    /// Returns a problem of `count` particles without supports and loads.
    #[must_use]
    pub fn free(count: usize) -> Self {
        Self {
            held: vec![Held::default(); count],
            start: vec![Twist::zero(); count],
            loads: vec![Twist::zero(); count],
        }
    }

    /// Solves to a relative residual of `tolerance`, in at most `limit` iterations.
    ///
    /// # Errors
    /// [`Error::LengthMismatch`], [`Error::NoConvergence`].
    pub fn solve(&self, body: &BondedParticles, tolerance: f64, limit: usize) -> Result<Equilibrium> {
        expect_len("supports", self.held.len(), body.len())?;
        expect_len("start", self.start.len(), body.len())?;
        expect_len("loads", self.loads.len(), body.len())?;
        let system = System::new(body, &self.held);
        let loads: Vec<Six> = self.loads.iter().map(join).collect();
        let mut x: Vec<Six> = self.start.iter().map(join).collect();
        let (iterations, residual) = system.conjugate_gradients(&loads, &mut x, tolerance, limit);
        // A NaN residual is no convergence: hence the comparison this way round.
        let converged = residual <= tolerance;
        if !converged {
            return Err(Error::NoConvergence {
                what: "static solve",
                iterations,
                residual,
                tolerance,
            });
        }
        let mut pull = vec![Six::zeros(); x.len()];
        // Reactions are what is left of the balance at held components.
        system.stiffness(&x, &mut pull);
        let reactions = pull
            .iter()
            .zip(&loads)
            .zip(&system.free)
            .map(|((k, f), free)| split(&(k - f).component_mul(&free.map(|f| 1.0 - f))))
            .collect();
        let displacements = x.iter().map(split).collect();
        Ok(Equilibrium {
            displacements,
            reactions,
            iterations,
            residual,
        })
    }
}

fn join(t: &Twist) -> Six {
    Six::new(
        t.linear.x,
        t.linear.y,
        t.linear.z,
        t.angular.x,
        t.angular.y,
        t.angular.z,
    )
}

fn split(x: &Six) -> Twist {
    Twist {
        linear: Vector3::new(x[0], x[1], x[2]),
        angular: Vector3::new(x[3], x[4], x[5]),
    }
}

struct System<'a> {
    body: &'a BondedParticles,
    /// For each particle, the other end and the bond as seen from the particle.
    bonds: Adjacency<(u32, LinearBond)>,
    free: Vec<Six>,
    inverse: Vec<Matrix6<f64>>,
}

impl<'a> System<'a> {
    fn new(body: &'a BondedParticles, held: &[Held]) -> Self {
        // Each bond from both ends: particles gather, and no two tasks write the same force.
        let ends = |(bond, &[i, j]): (LinearBond, &[u32; 2])| [(i, (j, bond)), (j, (i, bond.reversed()))];
        let bonds = body.bonds().zip(body.pairs()).flat_map(ends);
        let bonds = Adjacency::new(body.len(), bonds);
        let factor = |h: bool| if h { 0.0 } else { 1.0 };
        let free: Vec<Six> = held
            .iter()
            .map(|h| {
                let (l, a) = (h.linear.map(factor), h.angular.map(factor));
                Six::new(l[0], l[1], l[2], a[0], a[1], a[2])
            })
            .collect();
        let inverse = diagonal_blocks(body)
            .into_iter()
            .zip(&free)
            .map(|(k, free)| {
                // Held rows and columns get a multiple of the unit matrix, so that the block can be inverted.
                let mask = free * free.transpose();
                let held_diagonal = Matrix6::from_diagonal(&free.map(|f| 1.0 - f));
                // Of the size of the stiffness: the inverse of the block stays well scaled.
                let k = k.component_mul(&mask) + held_diagonal * k.diagonal().max();
                // A block without stiffness cannot be inverted; the unit matrix does.
                k.try_inverse()
                    .unwrap_or_else(Matrix6::identity)
                    // Masked again: held components take no part in any direction.
                    .component_mul(&mask)
            })
            .collect();
        Self {
            body,
            bonds,
            free,
            inverse,
        }
    }

    /// Computes `out = K x` for all components, held ones included.
    fn stiffness(&self, x: &[Six], out: &mut [Six]) {
        let k = self.body.rigidity();
        out.par_chunks_mut(CHUNK).enumerate().for_each(|(c, out)| {
            for (r, out) in out.iter_mut().enumerate() {
                let p = c * CHUNK + r;
                let twist = split(&x[p]);
                let mut f = Twist::zero();
                for (neighbour, bond) in self.bonds.row(p) {
                    let (g, _) = bond.wrenches(k, &twist, &split(&x[*neighbour as usize]));
                    f.linear += g.linear;
                    f.angular += g.angular;
                }
                *out = -join(&f);
            }
        });
    }

    /// Solves for the free components of `x` in place; returns the iterations and the relative residual.
    fn conjugate_gradients(
        &self,
        loads: &[Six],
        x: &mut [Six],
        tolerance: f64,
        limit: usize,
    ) -> (usize, f64) {
        let n = x.len();
        let mut q = vec![Six::zeros(); n];
        self.stiffness(x, &mut q);
        let mut r: Vec<Six> = (0..n)
            .map(|i| (loads[i] - q[i]).component_mul(&self.free[i]))
            .collect();
        // Held components have no residual, so that iterations never change them.
        let mut z: Vec<Six> = r.iter().zip(&self.inverse).map(|(r, k)| k * r).collect();
        let mut p = z.clone();
        let mut rho = ordered_dot(&r, &z);
        let first = rho;
        // The start is the solution.
        if first <= 0.0 {
            return (0, 0.0);
        }
        for step in 0..limit {
            let residual = (rho / first).sqrt();
            if residual <= tolerance {
                return (step, residual);
            }
            self.stiffness(&p, &mut q);
            // Directions must leave held components alone, and `K p` does not.
            q.iter_mut()
                .zip(&self.free)
                .for_each(|(q, f)| q.component_mul_assign(f));
            let alpha = rho / ordered_dot(&p, &q);
            let update = x.par_chunks_mut(CHUNK).zip(r.par_chunks_mut(CHUNK));
            let update = update.zip(z.par_chunks_mut(CHUNK)).zip(p.par_chunks(CHUNK));
            let update = update
                .zip(q.par_chunks(CHUNK))
                .zip(self.inverse.par_chunks(CHUNK));
            update.for_each(|(((((x, r), z), p), q), inverse)| {
                for i in 0..x.len() {
                    x[i] += p[i] * alpha;
                    r[i] -= q[i] * alpha;
                    z[i] = inverse[i] * r[i];
                }
            });
            let next = ordered_dot(&r, &z);
            let beta = next / rho;
            rho = next;
            p.par_chunks_mut(CHUNK)
                .zip(z.par_chunks(CHUNK))
                .for_each(|(p, z)| p.iter_mut().zip(z).for_each(|(p, z)| *p = z + *p * beta));
        }
        (limit, (rho / first).sqrt())
    }
}

/// Returns the dot product, summed in an order that does not depend on the threads.
fn ordered_dot(a: &[Six], b: &[Six]) -> f64 {
    let parts: Vec<f64> = a
        .par_chunks(CHUNK)
        .zip(b.par_chunks(CHUNK))
        .map(|(a, b)| a.iter().zip(b).map(|(a, b)| a.dot(b)).sum())
        .collect();
    parts.iter().sum()
}
