//! Linear unknowns of one or two weighted models along an axis, and their equilibrium.

use super::sparse::{add, dot, product, products};
use super::tie::Tie;
use crate::error::{Result, core, key};
use arlequin::core::spectrum::critical_step;
use arlequin::core::sprs::CsMat;
use std::ops::Range;
use std::sync::Arc;

/// Place of an unknown.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    /// Distance from the coarse border of the overlap, towards the fine model \[m\].
    pub(super) x: f64,
    /// Cosine between the direction of the unknown and the axis; zero for rotations.
    pub(super) axial: f64,
    /// Distance from the axis in the unknown's direction, times Poisson's ratio \[m\]; zero for rotations.
    pub(super) across: f64,
    /// True for displacements.
    pub(super) moves: bool,
}

/// Displacements, velocities and accelerations of all unknowns.
#[derive(Debug, Clone, Default)]
pub(super) struct Motion {
    pub(super) q: Vec<f64>,
    pub(super) v: Vec<f64>,
    pub(super) a: Vec<f64>,
}

impl Motion {
    /// Motion without accelerations.
    pub(super) fn new(q: Vec<f64>, v: Vec<f64>) -> Self {
        let a = vec![0.0; q.len()];
        Self { q, v, a }
    }

    /// First part of a step of velocity Verlet: `v ← v + ½Δt a`, `q ← q + Δt v`.
    pub(super) fn drift(&mut self, range: Range<usize>, dt: f64) {
        self.kick(range.clone(), dt);
        add(&mut self.q[range.clone()], dt, &self.v[range]);
    }

    /// Second part, with the new accelerations: `v ← v + ½Δt a`.
    pub(super) fn kick(&mut self, range: Range<usize>, dt: f64) {
        add(&mut self.v[range.clone()], 0.5 * dt, &self.a[range]);
    }

    /// Subtracts a share of an acceleration, and its half step from the velocities.
    pub(super) fn brake(&mut self, range: Range<usize>, push: &[f64], share: f64, dt: f64) {
        add(&mut self.a[range.clone()], -share, &push[range.clone()]);
        add(&mut self.v[range.clone()], -0.5 * dt * share, &push[range]);
    }
}

/// Weighted masses and stiffness.
#[derive(Debug, Clone)]
pub(super) struct System {
    pub(super) places: Arc<[Place]>,
    /// Number of unknowns of the coarse model, which come first.
    pub(super) split: usize,
    /// Lumped inertia \[kg, kg m²\].
    pub(super) mass: Vec<f64>,
    /// Its inverse; zero for unknowns without weight.
    pub(super) inverse: Vec<f64>,
    /// Stiffness, by rows.
    pub(super) stiffness: CsMat<f64>,
}

/// Share of its own mass below which an unknown has no weight.
const NO_WEIGHT: f64 = 1e-9;
/// Change of the energy, relative to that of the uniform strain, at which an equilibrium is found.
const SETTLED: f64 = 1e-22;
/// Most iterations for an equilibrium.
const MOST_ITERATIONS: usize = 30_000;

impl System {
    /// Makes a system of unknowns at places; `full` are the masses without weights.
    pub(super) fn new(
        (places, split): (Arc<[Place]>, usize),
        mass: Vec<f64>,
        full: &[f64],
        stiffness: CsMat<f64>,
    ) -> Self {
        let inverse = mass.iter().zip(full);
        let inverse = inverse.map(|(m, f)| if *m > NO_WEIGHT * f { 1.0 / m } else { 0.0 });
        Self {
            inverse: inverse.collect(),
            places,
            split,
            mass,
            stiffness,
        }
    }

    /// Number of unknowns.
    pub(super) fn size(&self) -> usize {
        self.mass.len()
    }

    /// Unknowns of the coarse and of the fine model.
    pub(super) fn sides(&self) -> [Range<usize>; 2] {
        [0..self.split, self.split..self.size()]
    }

    /// Unknowns with weight.
    pub(super) fn weighted(&self) -> impl Iterator<Item = usize> {
        (0..self.size()).filter(|i| self.inverse[*i] > 0.0)
    }

    /// Unknowns with mass that move along the axis.
    pub(super) fn axial(&self) -> impl Iterator<Item = usize> {
        (0..self.size()).filter(|i| self.places[*i].axial != 0.0 && self.mass[*i] > 0.0)
    }

    /// Diagonal entry of the stiffness.
    pub(super) fn own_stiffness(&self, i: usize) -> f64 {
        self.stiffness.get(i, i).copied().unwrap_or(0.0)
    }

    /// Critical step of a range of unknowns \[s\].
    pub(super) fn critical(&self, range: Range<usize>) -> Result<f64> {
        let mut inverse = vec![0.0; self.size()];
        inverse[range.clone()].copy_from_slice(&self.inverse[range]);
        let mut forces = |q: &[f64], f: &mut [f64]| {
            add(f, -1.0, &product(&self.stiffness, q));
            Ok(())
        };
        critical_step(&inverse, &mut forces).map_err(core("compare"))
    }

    /// Computes the accelerations `−W K q` of a range of unknowns.
    pub(super) fn accelerate(&self, Motion { q, a, .. }: &mut Motion, range: Range<usize>) {
        let pulls = products(&self.stiffness, q, range.clone()).zip(&self.inverse[range.clone()]);
        a[range].iter_mut().zip(pulls).for_each(|(a, (f, w))| *a = -f * w);
    }

    /// Makes a step of velocity Verlet for a range of unknowns.
    pub(super) fn step(&self, m: &mut Motion, range: Range<usize>, dt: f64) {
        m.drift(range.clone(), dt);
        self.accelerate(m, range.clone());
        m.kick(range, dt);
    }

    /// Multiplications of one step of the coarse model and of `own` steps of the fine one.
    pub(super) fn work(&self, own: usize) -> f64 {
        let start = self.stiffness.indptr();
        let (coarse, all) = (start.index(self.split), start.index(self.size()));
        (coarse + own * (all - coarse)) as f64
    }

    /// Returns `[½ mv² + ½ q (K q)]` of each unknown \[J\].
    pub(super) fn energies(&self, Motion { q, v, .. }: &Motion) -> Vec<f64> {
        let force = product(&self.stiffness, q);
        let mut out = vec![0.0; self.size()];
        self.weighted()
            .for_each(|i| out[i] = 0.5 * (self.mass[i] * v[i] * v[i] + q[i] * force[i]));
        out
    }

    /// Momentum along the axis \[kg m/s\], and the sum of its moduli.
    pub(super) fn momentum(&self, v: &[f64]) -> [f64; 2] {
        let part = |i: usize| self.mass[i] * v[i] * self.places[i].axial;
        let parts = self.weighted().map(part);
        parts.fold([0.0; 2], |[p, s], x| [p + x, s + x.abs()])
    }

    /// Returns whether a displacement without mass has stiffness: forces on it would be lost.
    pub(super) fn is_anchored(&self) -> bool {
        let stiffness = (0..self.size()).map(|i| self.own_stiffness(i));
        let top = stiffness.fold(0.0, f64::max);
        let stiff = |i: usize| self.own_stiffness(i) > 1e-9 * top;
        (0..self.size()).any(|i| self.places[i].moves && self.inverse[i] == 0.0 && stiff(i))
    }

    /// Finds the equilibrium `K q + Gᵀ λ = 0`, `G q = 0` with the held unknowns of `q`, by conjugate
    /// gradients in the space of the constraint.
    pub(super) fn equilibrium(&self, mut q: Vec<f64>, held: &[bool], rows: &CsMat<f64>) -> Result<Vec<f64>> {
        let scale = |i: usize| {
            let own = self.own_stiffness(i);
            let is_free = !held[i] && self.inverse[i] > 0.0 && own > 0.0;
            if is_free { 1.0 / own } else { 0.0 }
        };
        let scale: Vec<f64> = (0..self.size()).map(scale).collect();
        let tie = Tie::exact(rows.clone(), &scale)?;
        tie.project(&mut q, &scale);
        let mut r: Vec<f64> = product(&self.stiffness, &q).iter().map(|f| -f).collect();
        let start = -0.5 * dot(&q, &r);
        let mut p = vec![0.0; self.size()];
        let mut before = f64::INFINITY;
        for _ in 0..MOST_ITERATIONS {
            // Multipliers balance most of the residual. Left in, they would drown the rest, and round-off
            // would lead the iteration out of the constraint.
            tie.balance(&mut r, &scale);
            let mut z: Vec<f64> = r.iter().zip(&scale).map(|(r, s)| r * s).collect();
            tie.project(&mut z, &scale);
            let now = dot(&r, &z);
            if now <= SETTLED * start {
                return Ok(q);
            }
            let beta = now / before;
            p.iter_mut().zip(&z).for_each(|(p, z)| *p = z + beta * *p);
            before = now;
            let kp = product(&self.stiffness, &p);
            let curvature = dot(&p, &kp);
            // No stiffness in this direction: what is left is a motion that costs nothing.
            if curvature <= 0.0 {
                return Ok(q);
            }
            let alpha = now / curvature;
            add(&mut q, alpha, &p);
            add(&mut r, -alpha, &kp);
        }
        let rule = format!("no equilibrium after {MOST_ITERATIONS} iterations; take a smaller scene");
        Err(key("compare", rule))
    }
}
