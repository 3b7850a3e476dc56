//! Bridging scale (Wagner and Liu 2003): the coarse model everywhere, particles in a zone, and at the end
//! of the zone the force of the particles that are not there.
//!
//! The slope of the coarse field beside the end is that of the middle of an element, which sends back a
//! little of a wave that both models carry (Tang, Hou and Liu 2006). The force of the end works on what
//! passes: a wave that travels through loses energy; a standing wave between free ends gains without bound
//! or loses, by its phase at the end, whatever the memory. Figures hold for waves that pass a few times.

use super::{
    COARSE_EVERYWHERE, Case, Coupling, FINE, FINE_EVERYWHERE, Method, Motion, Pace, Result, State, System,
    dot, follows, product, transposed,
};
use arlequin::core::Uniform;
use arlequin::core::sprs::CsMat;
use std::ops::Range;

/// Steps of the past that act at the end of the zone. The kernel falls with the power −3/2 of time and
/// changes its sign, so that what is left out is 1e-5 of it.
const MEMORY: usize = 1000;
/// Largest difference between the bonds, and between the masses, of equal neighbours.
const EQUAL: f64 = 1e-9;

/// Coarse and fine scales of a chain.
#[derive(Debug)]
pub(super) struct Bridging {
    /// Coarse nodes without mass, then all particles; those outside of the zone follow the nodes.
    state: State,
    /// `N`, by which particles follow the coarse nodes, and `Nᵀ`.
    shapes: [CsMat<f64>; 2],
    /// Masses `Nᵀ m` of the coarse nodes.
    mass: Vec<f64>,
    zone: Range<usize>,
    /// Last particle of the zone, and its neighbour outside.
    end: [usize; 2],
    /// Stiffness of the bond between them \[N/m\].
    bond: f64,
    /// Coarse node of the last particle.
    node: usize,
    /// Displacement of the neighbour for a unit displacement of the last particle, by steps since then.
    kernel: Vec<f64>,
    /// Fine scale `q − N d` of the last particle, the newest last.
    past: Vec<f64>,
}

impl Bridging {
    /// Couples a chain of equal neighbours, whose zone ends in the middle of the overlap.
    pub(super) fn new(case: &mut Case) -> Result<Self> {
        let rule = "needs the memory of the particles that are left out, which is known for a chain of equal neighbours only";
        let refusal = |case: &Case, rule| Err(case.refusal(Method::BridgingScale, rule));
        if case.parts.len() <= COARSE_EVERYWHERE {
            return refusal(case, rule);
        }
        let whole = case.slaved(COARSE_EVERYWHERE, &Uniform(1.0))?;
        let everywhere = [f64::NEG_INFINITY, f64::INFINITY];
        let shapes = case.followers([COARSE_EVERYWHERE, FINE_EVERYWHERE], everywhere, &|_| true);
        let [nodes, particles] = whole.sides();
        if !particles.clone().all(|i| follows(&shapes, i)) || !equal_neighbours(&whole) {
            return refusal(case, rule);
        }
        let Some((end, node)) = end_of_zone(case, &whole) else {
            let rule = "needs a particle on a coarse node inside of the overlap; take a mesh of a multiple of the spacing";
            return refusal(case, rule);
        };
        let zone = if end[1] > end[0] {
            particles.start..end[1]
        } else {
            end[0]..particles.end
        };
        let bond = -whole.stiffness.get(end[0], end[1]).copied().unwrap_or(0.0);
        let back = transposed(&shapes);
        let pace = Pace::common(&whole)?;
        Ok(Self {
            mass: product(&back, &whole.mass)[nodes].to_vec(),
            kernel: kernel(whole.inverse[end[0]] * bond * pace.step.powi(2)),
            state: State::new(whole, pace),
            past: Vec::new(),
            shapes: [shapes, back],
            zone,
            end,
            bond,
            node,
        })
    }

    /// Returns `Nᵀ M x / Nᵀ m` at the coarse nodes.
    fn project(&self, x: &[f64]) -> Vec<f64> {
        let weighted: Vec<f64> = x.iter().zip(&self.state.whole.mass).map(|(x, m)| x * m).collect();
        let sums = product(&self.shapes[1], &weighted).into_iter();
        sums.zip(&self.mass).map(|(s, m)| s / m).collect()
    }

    /// Lets the particles outside of the zone follow the coarse model.
    fn follow(&mut self) {
        let State { whole, now, .. } = &mut self.state;
        let [q, v] = [&now.q, &now.v].map(|x| product(&self.shapes[0], x));
        let [_, particles] = whole.sides();
        for i in particles.filter(|i| !self.zone.contains(i)) {
            (now.q[i], now.v[i]) = (q[i], v[i]);
        }
    }

    /// Computes the accelerations of the particles and `d̈ = Nᵀ f / Nᵀ m`. At the end of the zone the
    /// neighbour is at `N d + Σ θ_k (q − N d)(t − k Δt)`, and both models take the force of the bond to it.
    fn accelerate(&mut self) {
        self.follow();
        let [last, neighbour] = self.end;
        let memory = self.past.iter().rev().zip(&self.kernel);
        let force = self.bond * memory.map(|(w, k)| w * k).sum::<f64>();
        let State { whole, now, .. } = &mut self.state;
        self.past.push(now.q[last] - now.q[self.node]);
        let [nodes, particles] = whole.sides();
        whole.accelerate(now, particles);
        now.a[last] += whole.inverse[last] * force;
        now.a[neighbour] -= whole.inverse[neighbour] * force;
        let coarse = self.project(&self.state.now.a);
        self.state.now.a[nodes].copy_from_slice(&coarse);
    }
}

impl Coupling for Bridging {
    fn reset(&mut self, q: &[f64], v: &[f64]) {
        let [nodes, _] = self.state.whole.sides();
        let [q, v] = [q, v].map(|x| [&*self.project(x), &x[nodes.end..]].concat());
        self.state.now = Motion::new(q, v);
        self.past.clear();
        self.accelerate();
    }

    fn advance(&mut self) {
        let ([nodes, _], zone, dt) = (self.state.whole.sides(), self.zone.clone(), self.state.pace.step);
        let ranges = [zone, nodes];
        ranges.iter().for_each(|r| self.state.now.drift(r.clone(), dt));
        self.accelerate();
        ranges.iter().for_each(|r| self.state.now.kick(r.clone(), dt));
        self.follow();
    }

    fn state(&self) -> &State {
        &self.state
    }

    /// Counts three entries in a row of the chain and two shape functions for each particle of the zone,
    /// three entries in a row for each coarse node, and the memory.
    fn work(&self) -> f64 {
        (5 * self.zone.len() + 3 * self.mass.len() + self.kernel.len()) as f64
    }
}

/// Finds the last particle of the zone, which lies on a coarse node near the middle of the overlap, its
/// neighbour outside, and the node.
fn end_of_zone(case: &Case, whole: &System) -> Option<([usize; 2], usize)> {
    let x = |i: usize| whole.places[i].x;
    let [nodes, particles] = whole.sides();
    let off = |k: &usize| (x(*k) - 0.5 * case.width).abs();
    let node = nodes.min_by(|a, b| off(a).total_cmp(&off(b)))?;
    let on_node = |i: &usize| (x(*i) - x(node)).abs() <= 1e-6 * case.spacing[FINE];
    let last = particles
        .clone()
        .find(on_node)
        .filter(|_| off(&node) < 0.5 * case.width)?;
    let neighbours = [last - 1, last + 1].into_iter().filter(|i| particles.contains(i));
    let neighbour = neighbours.min_by(|a, b| x(*a).total_cmp(&x(*b)))?;
    Some(([last, neighbour], node))
}

/// True for bonds of one stiffness between neighbours and particles of one mass, free ends excepted.
fn equal_neighbours(whole: &System) -> bool {
    let [_, Range { start, end }] = whole.sides();
    let bond = |i: usize| whole.stiffness.get(i, i + 1).copied().unwrap_or(0.0);
    let close = |a: f64, b: f64| (a - b).abs() <= EQUAL * b.abs();
    let like_first = |i: usize| close(bond(i), bond(start)) && close(whole.mass[i], whole.mass[start + 1]);
    let inner = (start + 1..end.saturating_sub(1)).all(like_first) && bond(start) < 0.0;
    inner && end - start > 2 && whole.stiffness.nnz() == 3 * (end - start) - 2
}

/// Returns `θ_1, θ_2, …` with `r = Δt² k/m`. A chain of neighbours under velocity Verlet answers to the
/// motion of its end by `Θ(w)` with `(1/w − 2 + w)/r + 2 = Θ + 1/Θ`, `w` the shift by a step; the series of
/// `Θ` follows from `θ_n = (2 − 2r) θ_{n−1} − θ_{n−2} + r (δ_{n1} + Σ θ_k θ_{n−1−k})`.
fn kernel(r: f64) -> Vec<f64> {
    let mut out = vec![0.0, r];
    for n in 2..=MEMORY {
        let reversed: Vec<f64> = out[..n].iter().rev().copied().collect();
        out.push((2.0 - 2.0 * r) * out[n - 1] - out[n - 2] + r * dot(&out[..n], &reversed));
    }
    out.split_off(1)
}
