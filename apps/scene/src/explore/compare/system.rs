//! Linear unknowns of one or two weighted models along an axis, and their equilibrium.

use super::sparse::{add_product, product, transposed};
use super::tie::Tie;
use crate::error::{Result, key};
use arlequin::core::spectrum::critical_step;
use arlequin::core::sprs::CsMat;
use std::ops::Range;
use std::sync::Arc;

/// Places of the unknowns.
#[derive(Debug, Clone, Default)]
pub(super) struct Places {
    /// Distance of each unknown from the coarse border of the overlap, towards the fine model \[m\].
    pub(super) x: Vec<f64>,
    /// Cosine between the unknown's direction and the axis; zero for rotations.
    pub(super) axial: Vec<f64>,
    /// Distance from the axis in the unknown's direction, times Poisson's ratio \[m\]; zero for rotations.
    pub(super) across: Vec<f64>,
    /// True for displacements.
    pub(super) moves: Vec<bool>,
    /// Number of unknowns of the coarse model, which come first.
    pub(super) split: usize,
}

impl Places {
    /// Places of some unknowns, in increasing order.
    pub(super) fn selected(&self, unknowns: &[usize]) -> Self {
        let pick = |x: &[f64]| unknowns.iter().map(|k| x[*k]).collect::<Vec<f64>>();
        Self {
            x: pick(&self.x),
            axial: pick(&self.axial),
            across: pick(&self.across),
            moves: unknowns.iter().map(|k| self.moves[*k]).collect(),
            split: unknowns.iter().filter(|k| **k < self.split).count(),
        }
    }
}

/// Displacements, velocities and accelerations of all unknowns.
#[derive(Debug, Clone, Default)]
pub(super) struct Motion {
    pub(super) q: Vec<f64>,
    pub(super) v: Vec<f64>,
    pub(super) a: Vec<f64>,
}

impl Motion {
    /// Copies displacements and velocities.
    pub(super) fn pair(&self) -> [Vec<f64>; 2] {
        [self.q.clone(), self.v.clone()]
    }
}

/// Weighted masses and stiffness.
#[derive(Debug, Clone)]
pub(super) struct System {
    pub(super) places: Arc<Places>,
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
    /// Makes a system; `full` are the masses without weights.
    pub(super) fn new(places: Arc<Places>, mass: Vec<f64>, full: &[f64], stiffness: CsMat<f64>) -> Self {
        let inverse = mass.iter().zip(full);
        let inverse = inverse.map(|(m, f)| if *m > NO_WEIGHT * f { 1.0 / m } else { 0.0 });
        Self {
            inverse: inverse.collect(),
            places,
            mass,
            stiffness,
        }
    }

    /// Number of unknowns.
    pub(super) fn size(&self) -> usize {
        self.mass.len()
    }

    /// Critical step of a range of unknowns \[s\].
    pub(super) fn critical(&self, range: Range<usize>) -> Result<f64> {
        let inverse: Vec<f64> = (0..self.size())
            .map(|i| if range.contains(&i) { self.inverse[i] } else { 0.0 })
            .collect();
        let mut forces = |q: &[f64], f: &mut [f64]| {
            add_product(&self.stiffness, q, -1.0, 0..q.len(), f);
            Ok(())
        };
        critical_step(&inverse, &mut forces).map_err(crate::error::core("compare"))
    }

    /// Computes the accelerations `−W K q` of a range of unknowns.
    pub(super) fn accelerate(&self, m: &mut Motion, range: Range<usize>) {
        m.a[range.clone()].fill(0.0);
        add_product(&self.stiffness, &m.q, -1.0, range.clone(), &mut m.a);
        range.for_each(|i| m.a[i] *= self.inverse[i]);
    }

    /// First part of a step of velocity Verlet: `v ← v + ½Δt a`, `q ← q + Δt v`.
    pub(super) fn drift(m: &mut Motion, range: Range<usize>, dt: f64) {
        for i in range {
            m.v[i] += 0.5 * dt * m.a[i];
            m.q[i] += dt * m.v[i];
        }
    }

    /// Second part: the accelerations, and `v ← v + ½Δt a`.
    pub(super) fn kick(&self, m: &mut Motion, range: Range<usize>, dt: f64) {
        self.accelerate(m, range.clone());
        range.for_each(|i| m.v[i] += 0.5 * dt * m.a[i]);
    }

    /// Multiplications of one step of the coarse model and of `own` steps of the fine one.
    pub(super) fn work(&self, own: usize) -> f64 {
        let start = self.stiffness.indptr();
        let (coarse, all) = (start.index(self.places.split), start.index(self.size()));
        (coarse + own * (all - coarse)) as f64
    }

    /// Returns `[½ mv² + ½ q (K q)]` of each unknown \[J\].
    pub(super) fn energies(&self, q: &[f64], v: &[f64]) -> Vec<f64> {
        let force = product(&self.stiffness, q);
        let all = (0..self.size()).filter(|i| self.inverse[*i] > 0.0);
        let mut out = vec![0.0; self.size()];
        all.for_each(|i| out[i] = 0.5 * (self.mass[i] * v[i] * v[i] + q[i] * force[i]));
        out
    }

    /// Returns whether a displacement without mass has stiffness: forces on it would be lost.
    pub(super) fn is_anchored(&self) -> bool {
        let own = |i: usize| self.stiffness.get(i, i).copied().unwrap_or(0.0);
        let top = (0..self.size()).map(own).fold(0.0, f64::max);
        (0..self.size()).any(|i| self.places.moves[i] && self.inverse[i] == 0.0 && own(i) > 1e-9 * top)
    }

    /// Momentum along the axis \[kg m/s\], and the sum of its moduli.
    pub(super) fn momentum(&self, v: &[f64]) -> [f64; 2] {
        let parts = (0..self.size()).filter(|i| self.inverse[*i] > 0.0);
        let parts = parts.map(|i| self.mass[i] * v[i] * self.places.axial[i]);
        parts.fold([0.0; 2], |[p, s], x| [p + x, s + x.abs()])
    }

    /// Finds the equilibrium `K q + Gᵀ λ = 0`, `G q = 0` with the held unknowns of `q`, by conjugate
    /// gradients in the space of the constraint.
    pub(super) fn equilibrium(
        &self,
        mut q: Vec<f64>,
        held: &[bool],
        rows: Option<&CsMat<f64>>,
    ) -> Result<Vec<f64>> {
        let mut diagonal = vec![0.0; self.size()];
        self.stiffness
            .iter()
            .filter(|(_, (i, j))| i == j)
            .for_each(|(v, (i, _))| diagonal[i] += *v);
        let free = |i: usize| !held[i] && self.inverse[i] > 0.0 && diagonal[i] > 0.0;
        let scale: Vec<f64> = (0..self.size())
            .map(|i| if free(i) { 1.0 / diagonal[i] } else { 0.0 })
            .collect();
        let tie = rows.map(|g| Tie::exact(g.clone(), &scale)).transpose()?;
        if let Some(t) = &tie {
            t.project(&mut q, &scale);
        }
        let mut r = vec![0.0; self.size()];
        let residual = |q: &[f64], r: &mut Vec<f64>| {
            r.fill(0.0);
            add_product(&self.stiffness, q, -1.0, 0..q.len(), r);
        };
        residual(&q, &mut r);
        let start = -0.5 * dot(&q, &r);
        let mut p: Vec<f64> = Vec::new();
        let mut before = 0.0;
        for _ in 0..MOST_ITERATIONS {
            // Multipliers balance most of the residual. Left in, they would drown the rest, and round-off
            // would lead the iteration out of the constraint.
            if let Some(t) = &tie {
                t.balance(&mut r, &scale);
            }
            let mut z: Vec<f64> = r.iter().zip(&scale).map(|(r, s)| r * s).collect();
            if let Some(t) = &tie {
                t.project(&mut z, &scale);
            }
            let now = dot(&r, &z);
            if now <= SETTLED * start {
                return Ok(q);
            }
            let beta = now / before;
            if p.is_empty() {
                p = z;
            } else {
                p.iter_mut().zip(&z).for_each(|(p, z)| *p = z + beta * *p);
            }
            before = now;
            let mut kp = vec![0.0; self.size()];
            add_product(&self.stiffness, &p, 1.0, 0..p.len(), &mut kp);
            let curvature = dot(&p, &kp);
            // No stiffness in this direction: what is left is a motion that costs nothing.
            if curvature <= 0.0 {
                return Ok(q);
            }
            let alpha = now / curvature;
            q.iter_mut().zip(&p).for_each(|(q, p)| *q += alpha * p);
            r.iter_mut().zip(&kp).for_each(|(r, k)| *r -= alpha * k);
        }
        Err(key(
            "compare",
            format!("no equilibrium after {MOST_ITERATIONS} iterations; take a smaller scene"),
        ))
    }
}

/// Unknowns of which others follow: `q = T p`.
#[derive(Debug, Clone)]
pub(super) struct Lift {
    /// `T`.
    pub(super) rows: CsMat<f64>,
    /// Unknown of the whole that each free unknown is.
    pub(super) kept: Vec<usize>,
    /// System of the whole.
    pub(super) whole: System,
}

impl Lift {
    /// Returns `Tᵀ K T` with masses `Tᵀ m`.
    pub(super) fn reduced(&self) -> System {
        let back = transposed(&self.rows);
        let stiffness = &(&back * &self.whole.stiffness) * &self.rows;
        let mass = product(&back, &self.whole.mass);
        let places = self.whole.places.selected(&self.kept);
        let top = mass.iter().fold(0.0_f64, |a, b| a.max(*b));
        // A node that nothing follows has neither mass nor stiffness.
        let full: Vec<f64> = mass
            .iter()
            .map(|m| if *m > 1e-12 * top { *m } else { top })
            .collect();
        System::new(Arc::new(places), mass, &full, stiffness)
    }

    /// Returns the free unknowns of the whole.
    pub(super) fn free(&self, x: &[f64]) -> Vec<f64> {
        self.kept.iter().map(|k| x[*k]).collect()
    }
}

/// Returns `x · y`.
pub(super) fn dot(x: &[f64], y: &[f64]) -> f64 {
    x.iter().zip(y).map(|(a, b)| a * b).sum()
}
