//! Warnings of what is possible and yet hardly meant. Each names the number that is odd; nothing here refuses.

use super::Built;
use crate::scene::{Material, Scene};
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::core::{Coupled, Real};

/// Steps above which a run is hardly meant: months at a microsecond each.
const MANY_STEPS: f64 = 1e9;

/// What is odd about a scene that has been built.
pub(super) fn warnings(_scene: &Scene, built: &Built) -> Vec<String> {
    let mut out = Vec::new();
    out.extend(steps(built));
    out.extend(built.bounds.watch(&built.run));
    out
}

fn steps(built: &Built) -> Option<String> {
    let (n, dt) = (built.steps as f64, built.run.dt());
    (n > MANY_STEPS).then(|| {
        format!(
            "time: {n:.2e} steps of {dt:.2e} s are more than {MANY_STEPS:e}; choose an earlier end, or coarser models"
        )
    })
}

/// What the motion of each model is held against, before the first step and while it runs.
#[derive(Debug, Clone, Default)]
pub(crate) struct Bounds(Vec<Bound>);

#[derive(Debug, Clone)]
struct Bound {
    /// Speed of pressure waves \[m/s\].
    wave: f64,
    /// Largest extent \[m\].
    extent: f64,
    /// Whether displacements are taken as small, so that a body cannot turn and no part of it can leave.
    small: bool,
}

impl Bounds {
    /// Adds a model: its nodes, what it is made of, whether its displacements are taken as small.
    pub(super) fn add(&mut self, nodes: &[Point3<f64>], material: &Material, small: bool) {
        let [low, high] = corners(nodes);
        self.0.push(Bound {
            wave: wave_speed(material),
            extent: (high - low).max(),
            small,
        });
    }

    /// Displacements beyond the body and speeds beyond the wave speed of the present state, one line per model and kind.
    pub(crate) fn watch<T: Real>(&self, run: &Coupled<T>) -> Vec<String> {
        let mut out = Vec::new();
        for (s, b) in run.subdomains().iter().zip(&self.0) {
            let (name, layout) = (s.model().name(), s.model().layout());
            let moving = 0..layout.translations();
            let top = |m: f64, x: &T| m.max(x.as_f64().abs());
            let speed = s.state().v[moving.clone()].iter().fold(0.0, top);
            if speed > b.wave {
                out.push(format!(
                    "model '{name}': moves at {speed:.3e} m/s at t = {:.3e} s, above its wave speed of {:.3e} m/s; check \
                     loads, velocities and their units",
                    run.time().as_f64(),
                    b.wave
                ));
            }
            let stretch = stretch(&s.state().q[moving], layout.components);
            if b.small && stretch > b.extent {
                out.push(format!(
                    "model '{name}': its displacements differ by {stretch:.3e} m at t = {:.3e} s, more than its size of \
                     {:.3e} m, where strains are no longer small; check loads, displacements and their units",
                    run.time().as_f64(),
                    b.extent
                ));
            }
        }
        out
    }
}

/// Largest difference of one component of displacement between two nodes.
fn stretch<T: Real>(q: &[T], components: usize) -> f64 {
    let span = |c: usize| {
        let values = q.iter().skip(c).step_by(components).map(|x| x.as_f64());
        let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| {
            (a.min(x), b.max(x))
        });
        high - low
    };
    (0..components).map(span).fold(0.0, f64::max)
}

/// Lowest and highest coordinates.
pub(super) fn corners(nodes: &[Point3<f64>]) -> [Vector3<f64>; 2] {
    let ends = [f64::INFINITY, f64::NEG_INFINITY].map(Vector3::repeat);
    nodes
        .iter()
        .fold(ends, |[a, b], x| [a.inf(&x.coords), b.sup(&x.coords)])
}

/// `√((λ + 2 μ)/ρ)` \[m/s\].
fn wave_speed(m: &Material) -> f64 {
    let nu = m.poisson.unwrap_or(0.0);
    (m.young * (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu)) / m.density).sqrt()
}
