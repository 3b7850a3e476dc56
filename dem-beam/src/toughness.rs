//! Toughness of a packing: a crack runs slowly through a strip.
//!
//! The strip lies along x, with an edge crack of no width in its middle plane. The spheres that touch its two
//! long faces (along y) are clamped and drawn apart. Once the crack is longer than the height `H`, the energy
//! that it releases per area does not depend on its length (Rivlin and Thomas 1953):
//!
//! ```text
//! G = E u²/(2 (1 − ν²) H) = σ² h (1 − ν²)/E,   σ = E u/((1 − ν²) H),   h = H/2   (free sides, plane stress)
//! ```
//!
//! The spheres at a clamp move as one, so that `H` is the distance between the two layers of their centres:
//! about a diameter less than the height of the box.
//!
//! A crack that starts at a given elongation `u` therefore runs through at this `G`, however much less it
//! needs. The test follows the crack instead, as a testing machine under control of the crack's opening does:
//! the clamps open while the crack lies behind a place that moves at [`SPEED`] wave speeds, and close while
//! it lies ahead. The energy that the strip loses while the crack passes a length is exact, by the ledger;
//! the elongation is averaged over the bonds that break there.

use crate::bond::{BeamMaterial, Twist};
use crate::error::{Error, Result, positive};
use crate::fracture::{Break, Fracture, locked};
use crate::model::DemModel;
use crate::packing::Packing;
use crate::specimen::{DENSITY, GIVEN_UP, SOLVE, START, support_work};
use crate::statics::StaticProblem;
use arlequin_core::effect::StiffnessDamping;
use arlequin_core::{Coupled, Formula, PrescribedMotion, Silent, Subdomain, TimeFunction, TimeStep, Weights};
use nalgebra::{Point3, Vector3};
use std::sync::{Arc, Mutex, PoisonError};

/// Length of the crack at the start, in heights: longer ones release the same energy per area.
const CRACK: f64 = 0.9;
/// Distance of the measured length from the start of the crack and from the far end, in heights.
const APART: [f64; 2] = [0.2, 0.8];
/// Shortest strip, in heights: the measured length is then one height.
pub const SHORTEST: f64 = CRACK + APART[0] + APART[1] + 1.0;
/// Speed of the crack over that of waves.
pub const SPEED: f64 = 0.02;
/// Time of the stiffness damping, in wave transits across a mean diameter.
pub const DAMPING: f64 = 0.1;
/// Relative growth of the elongation in a wave transit across the strip, up to the first broken bond.
const GROWTH: f64 = 0.02;
/// Change of the elongation by the distance of the crack from its wanted place in heights: at once, and in a
/// wave transit across the strip. Weaker ones let the crack run away, stronger ones send waves that take more
/// than a tenth of the energy.
const CONTROL: [f64; 2] = [0.25, 0.03];
/// Time at which the run gives up, over the time in which the crack should pass the strip.
const LATEST: f64 = 3.0;
/// Wave transits across the strip between two changes of the elongation.
const WINDOW: f64 = 0.5;
/// Bonds along the measured length that show that the crack has passed it, over those across the plane of the
/// crack. A crack breaks about as many.
const PARTED: f64 = 0.65;
/// Bonds beyond the measured length that show that the crack has passed it, over those across the plane of
/// the crack in a height.
const PASSED: f64 = 0.1;

/// A strip: a box with its length along x and its clamps at the two ends of y.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Strip {
    /// Lowest corner \[m\].
    pub low: [f64; 3],
    /// Lengths along x, y and z \[m\].
    pub size: [f64; 3],
    /// Young's modulus of the packing \[Pa\], which sets the times of the test.
    pub young: f64,
}

impl Strip {
    /// Place of the tip of the crack at the start \[m\].
    #[must_use]
    pub fn tip(&self) -> f64 {
        self.low[0] + CRACK * self.size[1]
    }

    /// Ends of the length over which the crack is measured \[m\].
    #[must_use]
    pub fn measured(&self) -> [f64; 2] {
        let [length, height, _] = self.size;
        [
            self.tip() + APART[0] * height,
            self.low[0] + length - APART[1] * height,
        ]
    }

    /// Place of the crack's plane \[m\].
    fn middle(&self) -> f64 {
        self.low[1] + 0.5 * self.size[1]
    }

    fn check(&self) -> Result<()> {
        for (name, x) in ["strip length", "strip height", "strip thickness"]
            .iter()
            .zip(self.size)
        {
            positive(name, x)?;
        }
        positive("Young's modulus of the strip", self.young)?;
        if self.size[0] < SHORTEST * self.size[1] {
            let rule = "at least 2.9: the crack must be about as long as the strip is high and stay as far from its end";
            return Err(Error::out_of_range(
                "strip length over height",
                self.size[0] / self.size[1],
                rule,
            ));
        }
        Ok(())
    }
}

/// Result of a toughness test. Energies are per area of the crack in its plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Toughness {
    /// Height that stretches \[m\]: the distance between the centres of the two clamped layers, in the mean.
    pub height: f64,
    /// Elongation, root of the mean square over the bonds that broke \[m\].
    pub elongation: f64,
    /// Elongation at which the first bond broke \[m\].
    pub first: f64,
    /// Energy that the strip lost \[J/m²\]: work of the clamps less the gain in elastic and kinetic energy.
    pub lost: f64,
    /// Part of `lost` that left with bonds, broken or softened \[J/m²\]; the rest left as waves, which the
    /// damping took.
    pub released: f64,
    /// Bonds that broke, per area \[1/m²\].
    pub broken: f64,
    /// Speed of the crack over that of waves.
    pub speed: f64,
}

/// Lets a crack run through a strip.
///
/// # Errors
/// [`Error::SeveralParts`]; [`Error::OutOfRange`] for the strip or no sphere at a clamp; errors of
/// [`DemModel::new`], of the static solution and of the run; [`Error::NotBroken`] if the crack does not pass.
pub fn toughness_test(
    packing: &Packing,
    beam: BeamMaterial,
    strip: &Strip,
    fracture: Fracture,
) -> Result<Toughness> {
    strip.check()?;
    let (middle, tip) = (strip.middle(), strip.tip());
    let mut packing = packing.clone();
    // A segment crosses the plane ahead of or behind the tip.
    let crossing = |a: &Vector3<f64>, b: &Vector3<f64>| {
        let (from, to) = (a.y - middle, b.y - middle);
        (from * to < 0.0).then(|| a.x + (b.x - a.x) * from / (from - to))
    };
    let ahead = packing.pairs.iter().filter(|p| {
        let [a, b] = p.map(|i| &packing.positions[i as usize]);
        crossing(a, b).is_some_and(|x| x > tip)
    });
    // Counted before the cut: the number of broken bonds over this density is the length that the crack has
    // run.
    let density = ahead.count() as f64 / (strip.low[0] + strip.size[0] - tip);
    // A cut takes bonds and no spheres, so that the crack has no width.
    packing.cut(|a, b| crossing(a, b).is_some_and(|x| x <= tip));
    // A loose piece would make the static system singular.
    packing.connected("a toughness test")?;
    let model = DemModel::new("strip", &packing, beam, DENSITY)?.with_fracture(fracture)?;
    let opened = Opened::new(&model, strip)?;
    let load = model.load(&opened.q);
    if !(load.is_finite() && load > 0.0) {
        return Err(Error::out_of_range(
            "load of the bonds of the strip",
            load,
            "finite values > 0: the strip must carry tension",
        ));
    }
    // Energies per section grow with the square of the elongation.
    let first = opened.elongation
        / if fracture.criterion.is_energy() {
            load.sqrt()
        } else {
            load
        };
    Servo {
        strip,
        first,
        density,
        wave: (strip.young / DENSITY).sqrt(),
        damping: DAMPING * 2.0 * model.body().mean_radius() / (strip.young / DENSITY).sqrt(),
    }
    .run(model, &opened)
}

/// Static equilibrium of the strip under a small elongation.
struct Opened {
    /// Distance between the centres of the two clamped layers, in the mean \[m\].
    height: f64,
    /// Unknowns of the model: displacements \[m\], then rotations \[rad\].
    q: Vec<f64>,
    /// Particles at the two clamps.
    clamps: [Vec<usize>; 2],
    elongation: f64,
}

impl Opened {
    fn new(model: &DemModel, strip: &Strip) -> Result<Self> {
        let body = model.body();
        let height = strip.size[1];
        let clamp = |y: f64| model.clamp_layer(&Point3::new(0.0, y, 0.0), &Vector3::y());
        let clamps = [strip.low[1], strip.low[1] + height].map(clamp);
        if clamps.iter().any(Vec::is_empty) {
            return Err(Error::out_of_range("particles at a clamp", 0.0, "values >= 1"));
        }
        // Statics is linear, and the run scales the solution: any small value will do.
        let elongation = 1e-4 * height;
        let centre = |clamp: &Vec<usize>| {
            clamp.iter().map(|&i| body.positions()[i].y).sum::<f64>() / clamp.len() as f64
        };
        let between = centre(&clamps[1]) - centre(&clamps[0]);
        let mut problem = StaticProblem::free(body.len());
        for (start, x) in problem.start.iter_mut().zip(body.positions()) {
            // Uniform strain as the first guess is near the solution and saves iterations.
            start.linear.y = elongation * ((x.y - strip.low[1]) / height - 0.5);
        }
        for (clamp, side) in clamps.iter().zip([-0.5, 0.5]) {
            for &i in clamp {
                // Held along all axes: the formulas above are those of clamps that keep the strip from
                // narrowing.
                problem.held[i].linear = [true; 3];
                problem.start[i].linear.y = side * elongation;
            }
        }
        let solution = problem.solve(body, SOLVE.0, SOLVE.1)?;
        let linear = |t: &Twist| [t.linear.x, t.linear.y, t.linear.z];
        let angular = |t: &Twist| [t.angular.x, t.angular.y, t.angular.z];
        let u = &solution.displacements;
        let q = u.iter().flat_map(linear).chain(u.iter().flat_map(angular));
        Ok(Self {
            height: between,
            q: q.collect(),
            clamps,
            elongation,
        })
    }
}

/// Elongation over time, linear between knots that are added as the run goes on.
#[derive(Debug, Clone, Default)]
struct Opening(Arc<Mutex<Vec<[f64; 2]>>>);

impl Opening {
    fn push(&self, time: f64, value: f64) {
        let mut knots = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        knots.push([time, value]);
    }

    /// Value at a time; beyond the knots the last two go on, as knots that are still to come will have it.
    fn value(&self, time: f64) -> f64 {
        let knots = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let next = knots.partition_point(|k| k[0] < time).clamp(1, knots.len() - 1);
        let [[t, x], [s, y]] = [knots[next - 1], knots[next]];
        x + (y - x) * (time - t) / (s - t)
    }
}

/// State of the strip between two changes of the elongation.
#[derive(Debug, Clone, Copy)]
struct Sample {
    time: f64,
    elongation: f64,
    /// Elastic and kinetic energy less the work of the clamps \[J\].
    left: f64,
    /// Number of broken bonds.
    broken: usize,
    /// Energy that left with bonds, broken or softened \[J\].
    released: f64,
}

/// A test under control of the crack's place.
struct Servo<'a> {
    strip: &'a Strip,
    /// Elongation at which the first bond breaks \[m\].
    first: f64,
    /// Bonds across the plane of the crack, per length along it \[1/m\].
    density: f64,
    /// Speed of waves \[m/s\].
    wave: f64,
    /// Time of the stiffness damping \[s\].
    damping: f64,
}

impl Servo<'_> {
    fn run(&self, model: DemModel, opened: &Opened) -> Result<Toughness> {
        let height = self.strip.size[1];
        let transit = height / self.wave;
        let log = model.break_log();
        let begin = START * self.first;
        let rate = GROWTH * begin / transit;
        let opening = Opening::default();
        // Two knots, so that the motion has a slope from the first instant on.
        for time in [-transit, 0.0] {
            opening.push(time, begin + rate * time);
        }
        let mut run = self.start(model, opened, &opening, [begin, rate])?;
        let (dt, every) = (run.dt(), ((WINDOW * transit / run.dt()) as usize).max(4));
        let window = every as f64 * dt;
        // The motion is asked for one step ahead, so that knots lie two steps behind the windows.
        opening.push(window + 2.0 * dt, begin + rate * (window + 2.0 * dt));
        let mut control = Control {
            base: begin + rate * window,
            started: None,
        };
        let ligament = self.strip.low[0] + self.strip.size[0] - self.strip.tip();
        let latest = LATEST * ligament / height / SPEED;
        let ends = self.strip.measured();
        // The crack has passed when bonds are broken all along the measured length and beyond it. Others may
        // break far ahead before.
        let along = PARTED * self.density * (ends[1] - ends[0]);
        let wanted = [along, (PASSED * self.density * height).max(4.0)];
        let mut samples = Vec::new();
        loop {
            run.run(every, &mut Silent)?;
            let now = run.time();
            let (broken, released, passed) = {
                let log = locked(&log);
                let places = || log.events().iter().map(|e| e.place.x);
                let counts = [
                    places().filter(|x| (ends[0]..ends[1]).contains(x)).count(),
                    places().filter(|x| *x >= ends[1]).count(),
                ];
                let passed = counts.iter().zip(wanted).all(|(n, least)| *n as f64 > least);
                (log.events().len(), log.released(), passed)
            };
            samples.push(Sample {
                time: now,
                elongation: opening.value(now),
                // This sum falls only by what leaves the strip: energy of broken bonds and of damped waves.
                left: run.energy() - support_work(&run),
                broken,
                released,
            });
            if passed {
                return Ok(self.evaluate(&samples, locked(&log).events(), opened.height));
            }
            let place = broken as f64 / self.density / height;
            let value = control.next(now / transit, place, window / transit);
            // A crack that stands still ends the test by the time, clamps that open without effect end it by
            // the elongation.
            let late = control.started.is_some_and(|s| now / transit - s > latest);
            if late || value > GIVEN_UP * self.first {
                return Err(Error::NotBroken {
                    strain: value / height,
                    stress: self.strip.young * value / height,
                });
            }
            opening.push(now + window + 2.0 * dt, value);
        }
    }

    /// Returns the run at rest in the opened strip, with clamps that follow `opening` from the elongation
    /// `begin` on at `rate`.
    fn start(
        &self,
        model: DemModel,
        opened: &Opened,
        opening: &Opening,
        [begin, rate]: [f64; 2],
    ) -> Result<Coupled<f64>> {
        let mut supports = Vec::new();
        for (clamp, side) in opened.clamps.iter().zip([-0.5, 0.5]) {
            let motion = opening.clone();
            let formula = Formula::new("elongation of the strip", move |t| motion.value(t));
            supports.push(PrescribedMotion::fixed(
                model.translations(clamp, [true, false, true]),
            ));
            supports.push(PrescribedMotion {
                dofs: model.translations(clamp, [false, true, false]),
                amplitude: side,
                time: TimeFunction::Formula(formula),
            });
        }
        let scaled = |x: f64| {
            let q = opened.q.iter().map(|q| q * x / opened.elongation);
            q.collect::<Vec<f64>>()
        };
        let mut subdomain = Subdomain::fine(model, Weights::uncoupled())
            .with_effect(Box::new(StiffnessDamping::new(self.damping)?))
            // Velocities of the same shape as the displacements: the strip goes on opening without a wave.
            .with_initial(scaled(begin), scaled(rate))?;
        for s in supports {
            subdomain = subdomain.with_support(s);
        }
        let run = Coupled::new(vec![subdomain], Vec::new(), TimeStep::Fraction(0.8), None)?;
        Ok(run)
    }

    /// Evaluates the passage of the crack along the measured length. The crack has passed a place when as
    /// many bonds are broken as break behind the place in the whole test.
    fn evaluate(&self, samples: &[Sample], events: &[Break], height: f64) -> Toughness {
        let ends = self.strip.measured();
        let counts = ends.map(|x| events.iter().filter(|e| e.place.x < x).count());
        let at = counts.map(|n| samples.partition_point(|s| s.broken < n).min(samples.len() - 1));
        let [first, last] = at.map(|k| samples[k]);
        let (mut square, mut broken) = (0.0, 0.0);
        for pair in samples[at[0]..=at[1]].windows(2) {
            let new = (pair[1].broken - pair[0].broken) as f64;
            // Energies grow with the square of the elongation. Each elongation counts by the bonds that broke
            // at it.
            square += new * pair[1].elongation.powi(2);
            broken += new;
        }
        let length = ends[1] - ends[0];
        let area = length * self.strip.size[2];
        Toughness {
            height,
            elongation: (square / broken).sqrt(),
            first: self.first,
            lost: (first.left - last.left) / area,
            released: (last.released - first.released) / area,
            broken: broken / area,
            speed: length / (last.time - first.time) / self.wave,
        }
    }
}

/// Controller of the elongation. Times are in wave transits across the strip, lengths in its heights.
struct Control {
    /// Elongation without the immediate answer \[m\].
    base: f64,
    /// Time of the first break.
    started: Option<f64>,
}

impl Control {
    /// Returns the next elongation \[m\], for a crack that has run over `place` up to the time `now`.
    fn next(&mut self, now: f64, place: f64, window: f64) -> f64 {
        // Nothing shows the place of the crack before the first break: the clamps open steadily.
        if place <= 0.0 {
            self.base *= 1.0 + GROWTH * window;
            return self.base;
        }
        let started = *self.started.get_or_insert(now);
        // A crack that jumps thus changes the elongation by a quarter at once, and not by more.
        let behind = (SPEED * (now - started) - place).clamp(-1.0, 1.0);
        self.base *= 1.0 + CONTROL[1] * behind * window;
        self.base * (1.0 + CONTROL[0] * behind)
    }
}
