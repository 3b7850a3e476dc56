//! Measurements of a coupling: waves across the overlap, uniform strain, a random state.

use super::Row;
use super::case::Case;
use super::method::{Coupling, State};
use super::sparse::add;
use super::system::{Place, System};
use crate::error::Result;
use std::collections::BTreeMap;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Half width of the pulse, in coarse spacings, where the models are long enough.
const PULSE: f64 = 10.0;
/// Share of a model's own region that a pulse may fill with each half.
const FILLED: f64 = 0.45;
/// Passages of the pulse over which its energy is watched.
const PASSAGES: f64 = 10.0;
/// Multiplications of the run from a random state, and its least and most steps.
const RANDOM_WORK: f64 = 1.5e9;
const RANDOM_STEPS: [f64; 2] = [500.0, 20_000.0];

/// Waves that all methods of a board meet.
#[derive(Debug, Clone, Copy)]
pub(super) struct Waves {
    /// Pulse from the fine model, which passes.
    pub(super) down: Wave,
    /// Pulse from the coarse model.
    up: Wave,
    /// Packet above the coarse cutoff from the fine model, which meets the overlap and leaves it; `None` if
    /// the fine model cannot carry one.
    pub(super) packet: Option<Wave>,
    width: f64,
    spacing: [f64; 2],
    /// Duration of the run from a random state \[s\].
    random: f64,
}

impl Waves {
    /// Chooses waves for a case; `default` is the method whose steps decide the length of the random run.
    pub(super) fn new(case: &Case, default: &dyn Coupling) -> Result<Self> {
        let [coarse, fine] = case.own_lengths()?;
        let ([h, d], width, speed) = (case.spacing, case.width, case.speed);
        let half = (PULSE * h).min(FILLED * coarse).min(FILLED * fine);
        let pulse = |centre: f64, way: f64, velocity: f64| Wave {
            centre,
            half,
            length: f64::INFINITY,
            velocity,
            time: (way + 1.2 * half) / speed,
        };
        let steps = (RANDOM_WORK / default.work()).clamp(RANDOM_STEPS[0], RANDOM_STEPS[1]);
        Ok(Self {
            down: pulse(width + half + d, width + half + d, -speed),
            up: pulse(-half - h, width + half + h, speed),
            packet: packet(case, fine),
            random: steps.round() * default.state().pace.step,
            spacing: case.spacing,
            width,
        })
    }
}

/// Elements carry nothing shorter than two spacings, particles hardly anything below four.
fn packet(case: &Case, room: f64) -> Option<Wave> {
    let ([h, d], width) = (case.spacing, case.width);
    let length = (0.8 * h).max(4.0 * d);
    let half = (6.0 * length).min(FILLED * room);
    let phase = PI * d / length;
    let wave = Wave {
        centre: width + half + d,
        half,
        length,
        velocity: -case.speed * phase.sin() / phase,
        time: (2.0 * half + 2.5 * width) / (case.speed * phase.cos()),
    };
    (length < 1.6 * h).then_some(wave)
}

/// Plane wave `cos⁴(πy/2) cos(k(x − x0))`, `y = (x − x0)/W`, that travels one way.
#[derive(Debug, Clone, Copy)]
pub(super) struct Wave {
    centre: f64,
    /// Half width \[m\].
    pub(super) half: f64,
    /// Wavelength \[m\]; infinite for a pulse.
    pub(super) length: f64,
    velocity: f64,
    /// Duration of its run \[s\].
    pub(super) time: f64,
}

impl Wave {
    /// Displacement and velocity at a place.
    fn value(&self, x: f64) -> [f64; 2] {
        let y = (x - self.centre) / self.half;
        if y.abs() >= 1.0 {
            return [0.0; 2];
        }
        let (c, s) = ((FRAC_PI_2 * y).cos(), (FRAC_PI_2 * y).sin());
        let wavenumber = TAU / self.length;
        let phase = wavenumber * (x - self.centre);
        let slope = -2.0 * PI * c.powi(3) * s / self.half * phase.cos();
        let slope = slope - wavenumber * c.powi(4) * phase.sin();
        [c.powi(4) * phase.cos(), -self.velocity * slope]
    }

    /// Displacements and velocities of all unknowns: along the axis those of the wave, across it the
    /// contraction `−ν u'` that leaves the sides free of stress.
    fn state(&self, places: &[Place]) -> [Vec<f64>; 2] {
        let delta = 1e-3 * self.half;
        let unknown = |k: usize, p: &Place| {
            let [low, value, high] = [p.x - delta, p.x, p.x + delta].map(|x| self.value(x)[k]);
            p.axial * value - p.across / (2.0 * delta) * (high - low)
        };
        [0, 1].map(|k| places.iter().map(|p| unknown(k, p)).collect())
    }
}

/// Starts a wave and lets it run; returns the energy \[J\] at the begin, and at the end beyond the overlap
/// and in all.
fn run(method: &mut dyn Coupling, wave: &Wave) -> [f64; 3] {
    start(method, wave);
    let before = method.whole_energy();
    advance(method, wave.time);
    [before, beyond(method), method.whole_energy()]
}

fn start(method: &mut dyn Coupling, wave: &Wave) {
    let [q, v] = wave.state(&method.state().whole.places);
    method.reset(&q, &v);
}

/// Makes the steps nearest to a time, one at least.
fn advance(method: &mut dyn Coupling, time: f64) {
    let steps = (time / method.state().pace.step).round().max(1.0);
    (0..steps as usize).for_each(|_| method.advance());
}

/// Makes the steps of a time and returns the relative change of the energy.
fn change(method: &mut dyn Coupling, time: f64) -> f64 {
    let before = method.energy();
    advance(method, time);
    method.energy() / before - 1.0
}

/// Energy in the coarse model's own region \[J\].
fn beyond(method: &dyn Coupling) -> f64 {
    let State { whole, now, .. } = method.state();
    let parts = whole.energies(now).into_iter().zip(&*whole.places);
    parts.filter(|(_, p)| p.x < 0.0).map(|(e, _)| e).sum()
}

/// Place and displacement of the layers of a system along the axis, in means by mass: a node that hardly has
/// weight hardly counts.
fn layers(system: &System, q: &[f64], thickness: f64) -> Vec<[f64; 2]> {
    let mut sums = BTreeMap::<i64, [f64; 3]>::new();
    for i in system.axial() {
        let Place { x, axial, .. } = system.places[i];
        let sum = sums.entry((x / thickness).round() as i64).or_default();
        let m = system.mass[i] * axial.powi(2);
        sum[0] += m;
        sum[1] += m * x;
        sum[2] += m * q[i] / axial;
    }
    sums.into_values().map(|[m, x, u]| [x / m, u / m]).collect()
}

/// Linear interpolation between layers.
fn interpolated(layers: &[[f64; 2]], x: f64) -> f64 {
    let next = layers.partition_point(|l| l[0] < x).clamp(1, layers.len() - 1);
    let [[x0, u0], [x1, u1]] = [layers[next - 1], layers[next]];
    u0 + (x.clamp(layers[0][0], layers[layers.len() - 1][0]) - x0) / (x1 - x0) * (u1 - u0)
}

/// Measures one method; critical step and cost are no ratios yet. `reference` are the displacements of the
/// fine model everywhere behind the pulse, by layers; returns also those of the method.
pub(super) fn row(
    name: &str,
    (setup, m): (f64, &mut dyn Coupling),
    waves: &Waves,
    reference: Option<&[[f64; 2]]>,
) -> Result<(Row, Vec<[f64; 2]>)> {
    let [before, coarse, after] = run(m, &waves.down);
    let (pulse_error, profile) = arrival(m, waves, reference);
    start(m, &waves.down);
    let pulse_drift = change(m, PASSAGES * waves.down.time);
    let [start, back, _] = run(m, &waves.up);
    let above = waves.packet.map(|wave| above(m, &wave));
    let [drift, momentum] = noise(m, waves);
    let pace = m.state().pace;
    let row = Row {
        method: name.to_owned(),
        // What has left the method altogether was not reflected.
        down: (after - coarse) / before,
        patch: patch(m, waves)?,
        critical: pace.critical,
        // After the runs: how often an alternation alternates is known by then.
        cost: m.work() / pace.step,
        pulse_error,
        pulse_drift,
        up: back / start,
        above,
        momentum,
        drift,
        setup,
    };
    Ok((row, profile))
}

/// Error of the displacements beyond the overlap against the fine model everywhere after the pulse, and the
/// displacements by layers.
fn arrival(m: &dyn Coupling, waves: &Waves, reference: Option<&[[f64; 2]]>) -> (Option<f64>, Vec<[f64; 2]>) {
    let State { whole, pace, now } = m.state();
    // All methods are compared at one instant, whatever their steps.
    let left = waves.down.time - (waves.down.time / pace.step).round() * pace.step;
    let mut q = now.q.clone();
    add(&mut q, left, &now.v);
    let error = reference.map(|layers| {
        let mut sums = [0.0; 2];
        for i in whole.axial().filter(|i| whole.places[*i].x < 0.0) {
            let wanted = interpolated(layers, whole.places[i].x) * whole.places[i].axial;
            sums[0] += whole.mass[i] * (q[i] - wanted).powi(2);
            sums[1] += whole.mass[i] * wanted * wanted;
        }
        (sums[0] / sums[1]).sqrt()
    });
    (error, layers(whole, &q, waves.spacing[1]))
}

/// Share of the energy of the packet above the coarse cutoff that stays out of the coarse region.
fn above(method: &mut dyn Coupling, wave: &Wave) -> f64 {
    start(method, wave);
    // At whole steps the energies of short waves oscillate; the invariant does not.
    let before = method.energy();
    advance(method, wave.time);
    let share = beyond(method) / method.whole_energy();
    (1.0 - share) * method.energy() / before
}

/// Runs from random velocities of all displacements. Returns the relative change of the energy, and the
/// change of the momentum over the sum of its moduli.
fn noise(method: &mut dyn Coupling, waves: &Waves) -> [f64; 2] {
    let mut next = random();
    let places = method.state().whole.places.iter();
    let v: Vec<f64> = places.map(|p| if p.moves { next() } else { 0.0 }).collect();
    method.reset(&vec![0.0; v.len()], &v);
    let momentum = |m: &dyn Coupling| m.state().whole.momentum(&m.state().now.v);
    let [before, size] = momentum(method);
    let drift = change(method, waves.random);
    [drift, (momentum(method)[0] - before).abs() / size]
}

/// Largest deviation from uniform strain in the overlap, over the strain times the width; `None` if the
/// method has no equilibrium.
fn patch(method: &dyn Coupling, waves: &Waves) -> Result<Option<f64>> {
    let system = &method.state().whole;
    let layer = 0.6 * waves.spacing[1];
    let x = system.places.iter().map(|p| p.x);
    let (low, high) = (
        x.clone().fold(0.0, f64::min) + layer,
        x.fold(0.0, f64::max) - layer,
    );
    let at_end = |p: &Place| p.axial != 0.0 && (p.x <= low || p.x >= high);
    let held: Vec<bool> = system.places.iter().map(at_end).collect();
    let q: Vec<f64> = system.places.iter().map(|p| p.x * p.axial).collect();
    let q = method.equilibrium(&q, &held)?;
    Ok(q.map(|q| deviation(system, &q, waves)))
}

/// Distance of the layers of the overlap from the lines that the models follow outside of it. Where the
/// moduli of the models differ, so do the lines, and what lies between them is no deviation.
fn deviation(system: &System, q: &[f64], waves: &Waves) -> f64 {
    let layers = layers(system, q, waves.spacing[1]);
    let (margin, width) = (waves.spacing[0], waves.width);
    let (low, high) = (
        fit(&layers, |x| x < -margin),
        fit(&layers, |x| x > width + margin),
    );
    let inside = layers.iter().filter(|l| l[0] >= 0.0 && l[0] <= width);
    let off = |[x, u]: &[f64; 2]| {
        let ends = [low[0] + low[1] * x, high[0] + high[1] * x];
        let (a, b) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
        (a - u).max(u - b).max(0.0)
    };
    inside.map(off).fold(0.0, f64::max) / width
}

/// Line of least squares through some layers: value at zero and slope.
fn fit(layers: &[[f64; 2]], keep: impl Fn(f64) -> bool) -> [f64; 2] {
    let points: Vec<_> = layers.iter().filter(|l| keep(l[0])).collect();
    let sum = |f: &dyn Fn(&[f64; 2]) -> f64| points.iter().map(|p| f(p)).sum::<f64>();
    let n = points.len().max(1) as f64;
    let (x, u) = (sum(&|p| p[0]) / n, sum(&|p| p[1]) / n);
    let square = sum(&|p| (p[0] - x).powi(2)).max(f64::MIN_POSITIVE);
    let slope = sum(&|p| (p[0] - x) * (p[1] - u)) / square;
    [u - slope * x, slope]
}

/// Numbers from −1 to 1 that look random: the xorshift generator.
fn random() -> impl FnMut() -> f64 {
    let mut s = 0x9e37_79b9_7f4a_7c15_u64;
    move || {
        s ^= s << 13;
        s ^= s >> 7;
        s ^= s << 17;
        (s >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }
}
