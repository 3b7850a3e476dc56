//! Bridging scale (Wagner and Liu 2003): the coarse model everywhere, particles in a zone, and at the end
//! of the zone the force of the particles that are not there.
//!
//! The slope of the coarse field beside the end is that of the middle of an element, which sends back a
//! little of a wave that both models carry (Tang, Hou and Liu 2006).

use super::Coupling;
use super::quasicontinuum::massless;
use crate::error::Result;
use crate::explore::compare::case::Case;
use crate::explore::compare::reflections::Pace;
use crate::explore::compare::sparse::{product, transposed};
use crate::explore::compare::system::{Motion, System, dot};
use crate::spec::Method;
use arlequin::core::Uniform;
use arlequin::core::sprs::{CsMat, TriMat};
use std::ops::Range;

/// Steps of the past that act at the end of the zone. The kernel falls with the power −3/2 of time and
/// changes its sign, so that what is left out is 1e-5 of it.
const MEMORY: usize = 1000;
/// Largest difference between the bonds, and between the masses, of equal neighbours.
const EQUAL: f64 = 1e-9;

/// Coarse and fine scales of a chain.
#[derive(Debug)]
pub(super) struct Bridging {
    /// Coarse nodes without mass, then all particles.
    whole: System,
    /// All particles.
    chain: System,
    /// Shape functions of the coarse model at all particles, and their transpose.
    shapes: CsMat<f64>,
    back: CsMat<f64>,
    /// `1 / Nᵀ m`.
    inverse: Vec<f64>,
    zone: Range<usize>,
    /// Last particle of the zone, and its neighbour outside.
    end: [usize; 2],
    /// Stiffness of the bond between them \[N/m\].
    bond: f64,
    /// Coarse node of the last particle.
    node: usize,
    pace: Pace,
    coarse: Motion,
    /// Motion of all particles: those outside of the zone follow the coarse model.
    fine: Motion,
    /// Displacement of the neighbour for a unit displacement of the last particle, by steps since then.
    kernel: Vec<f64>,
    /// Fine scale `q − N d` of the last particle, the newest last.
    past: Vec<f64>,
}

impl Bridging {
    /// Couples a chain of equal neighbours, whose zone ends in the middle of the overlap.
    pub(super) fn new(case: &mut Case) -> Result<Self> {
        let chain = case.fine_system(&Uniform(1.0))?;
        let n = chain.size();
        let mesh = case.coarse_everywhere()?;
        let followers = case.all_followers(&mesh);
        if case.components() != 1 || followers.len() != n || !equal_neighbours(&chain) {
            let rule = "needs the memory of the particles that are left out, which is known for a chain of equal neighbours only";
            return Err(case.refusal(Method::BridgingScale, rule));
        }
        let mut shapes = TriMat::new((n, mesh.places.x.len()));
        for (k, row) in &followers {
            let values = row.nodes.iter().zip(&row.values);
            values.for_each(|(node, value)| shapes.add_triplet(*k, *node, *value));
        }
        let shapes: CsMat<f64> = shapes.to_csr();
        let Some((end, node)) = end_of_zone(case, &chain, &mesh.places.x) else {
            let rule = "needs a particle on a coarse node inside of the overlap; take a mesh of a multiple of the spacing";
            return Err(case.refusal(Method::BridgingScale, rule));
        };
        let zone = if end[1] > end[0] { 0..end[1] } else { end[0]..n };
        let bond = -chain.stiffness.get(end[0], end[1]).copied().unwrap_or(0.0);
        let back = transposed(&shapes);
        let pace = Pace::common(&chain)?;
        Ok(Self {
            inverse: product(&back, &chain.mass).iter().map(|m| 1.0 / m).collect(),
            kernel: kernel(chain.inverse[end[0]] * bond * pace.step.powi(2)),
            node,
            bond,
            back,
            whole: massless(&mesh.places, chain.clone()),
            coarse: Motion::default(),
            fine: Motion::default(),
            past: Vec::new(),
            chain,
            shapes,
            zone,
            end,
            pace,
        })
    }

    /// Returns `Nᵀ M x / Nᵀ m`.
    fn project(&self, x: &[f64]) -> Vec<f64> {
        let weighted: Vec<f64> = x.iter().zip(&self.chain.mass).map(|(x, m)| x * m).collect();
        let sums = product(&self.back, &weighted).into_iter();
        sums.zip(&self.inverse).map(|(s, w)| s * w).collect()
    }

    /// Lets the particles outside of the zone follow the coarse model.
    fn follow(&mut self) {
        let [q, v] = [&self.coarse.q, &self.coarse.v].map(|x| product(&self.shapes, x));
        for i in (0..q.len()).filter(|i| !self.zone.contains(i)) {
            (self.fine.q[i], self.fine.v[i]) = (q[i], v[i]);
        }
    }

    /// Computes the accelerations of the particles and `d̈ = Nᵀ f / Nᵀ m`. At the end of the zone the
    /// neighbour is at `N d + Σ θ_k (q − N d)(t − k Δt)`, and both models take the force of the bond to it.
    fn accelerate(&mut self) {
        self.follow();
        let [last, neighbour] = self.end;
        let memory = self.past.iter().rev().zip(&self.kernel);
        let force = self.bond * memory.map(|(w, k)| w * k).sum::<f64>();
        self.past.push(self.fine.q[last] - self.coarse.q[self.node]);
        self.chain.accelerate(&mut self.fine, 0..self.chain.size());
        self.fine.a[last] += self.chain.inverse[last] * force;
        self.fine.a[neighbour] -= self.chain.inverse[neighbour] * force;
        self.coarse.a = self.project(&self.fine.a);
    }
}

impl Coupling for Bridging {
    fn reset(&mut self, q: &[f64], v: &[f64]) {
        let n = self.shapes.cols();
        let motion = |q: Vec<f64>, v: Vec<f64>| Motion {
            a: vec![0.0; q.len()],
            q,
            v,
        };
        self.coarse = motion(self.project(&q[n..]), self.project(&v[n..]));
        self.fine = motion(q[n..].to_vec(), v[n..].to_vec());
        self.past.clear();
        self.accelerate();
    }

    fn advance(&mut self) {
        let (zone, nodes, dt) = (self.zone.clone(), 0..self.shapes.cols(), self.pace.step);
        System::drift(&mut self.fine, zone.clone(), dt);
        System::drift(&mut self.coarse, nodes.clone(), dt);
        self.accelerate();
        for (m, range) in [(&mut self.fine, zone), (&mut self.coarse, nodes)] {
            range.for_each(|i| m.v[i] += 0.5 * dt * m.a[i]);
        }
        self.follow();
    }

    fn pace(&self) -> Pace {
        self.pace
    }

    fn whole(&self) -> &System {
        &self.whole
    }

    fn motion(&self) -> [Vec<f64>; 2] {
        [
            [&*self.coarse.q, &self.fine.q].concat(),
            [&*self.coarse.v, &self.fine.v].concat(),
        ]
    }

    /// Counts three entries in a row of the chain and two shape functions for each particle of the zone,
    /// three entries in a row for each coarse node, and the memory.
    fn work(&self) -> f64 {
        (5 * self.zone.len() + 3 * self.shapes.cols() + self.kernel.len()) as f64
    }
}

/// Finds the last particle of the zone, which lies on a coarse node near the middle of the overlap, its
/// neighbour outside, and the node.
fn end_of_zone(case: &Case, chain: &System, nodes: &[f64]) -> Option<([usize; 2], usize)> {
    let off = |k: &usize| (nodes[*k] - 0.5 * case.width).abs();
    let node = (0..nodes.len()).min_by(|a, b| off(a).total_cmp(&off(b)))?;
    let on_node = |x: &f64| (x - nodes[node]).abs() <= 1e-6 * case.spacing[1];
    let x = &chain.places.x;
    let last = x
        .iter()
        .position(on_node)
        .filter(|_| off(&node) < 0.5 * case.width)?;
    let neighbours = [last.checked_sub(1)?, last + 1]
        .into_iter()
        .filter(|i| *i < x.len());
    let neighbour = neighbours.min_by(|a, b| x[*a].total_cmp(&x[*b]))?;
    Some(([last, neighbour], node))
}

/// True for bonds of one stiffness between neighbours and particles of one mass, free ends excepted.
fn equal_neighbours(chain: &System) -> bool {
    let bond = |i: usize| chain.stiffness.get(i, i + 1).copied().unwrap_or(0.0);
    let close = |a: f64, b: f64| (a - b).abs() <= EQUAL * b.abs();
    let n = chain.size();
    let inner = (1..n.saturating_sub(1))
        .all(|i| close(bond(i - 1), bond(0)) && close(chain.mass[i], chain.mass[1]) && bond(0) < 0.0);
    inner && n > 2 && chain.stiffness.nnz() == 3 * n - 2
}

/// Returns `θ_1, θ_2, …` with `r = Δt² k/m`. A chain of neighbours under velocity Verlet answers to the
/// motion of its end by `Θ(w)` with `(1/w − 2 + w)/r + 2 = Θ + 1/Θ`, `w` the shift by a step; the series of
/// `Θ` follows from `θ_n = (2 − 2r) θ_{n−1} − θ_{n−2} + r (δ_{n1} + Σ θ_k θ_{n−1−k})`.
pub(in crate::explore::compare) fn kernel(r: f64) -> Vec<f64> {
    let mut out = vec![0.0, r];
    for n in 2..=MEMORY {
        let reversed: Vec<f64> = out[..n].iter().rev().copied().collect();
        out.push((2.0 - 2.0 * r) * out[n - 1] - out[n - 2] + r * dot(&out[..n], &reversed));
    }
    out.split_off(1)
}
