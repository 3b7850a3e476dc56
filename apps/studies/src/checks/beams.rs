//! Runs of the beam scenes, their stored records, and beam theory.

use super::check::{Accept, Check};
use crate::solid::momentum_scale;
use arlequin::core::Silent;
use arlequin_scene::error::{Error, Result, core, write};
use arlequin_scene::setup::{self, Built, Readings};
use arlequin_scene::spectrum;
use arlequin_scene::{Scene, Source};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::hash::{Hash, Hasher};
use std::path::Path;

/// Scenes of the beams that ship with this crate.
#[derive(Debug, Clone, Copy)]
pub(super) enum Deck {
    /// Beam A, two models.
    A,
    /// Beam A, one model.
    AAlone,
    /// Beam B, two models.
    B,
    /// Beam B, one model.
    BAlone,
}

impl Deck {
    fn text(self) -> (&'static str, &'static str) {
        match self {
            Self::A => ("beam-a.toml", include_str!("../../scenes/beam-a.toml")),
            Self::AAlone => (
                "beam-a-alone.toml",
                include_str!("../../scenes/beam-a-alone.toml"),
            ),
            Self::B => ("beam-b.toml", include_str!("../../scenes/beam-b.toml")),
            Self::BAlone => (
                "beam-b-alone.toml",
                include_str!("../../scenes/beam-b-alone.toml"),
            ),
        }
    }
}

/// A run of a scene with changed values.
#[derive(Debug, Clone)]
pub(super) struct RunSpec {
    /// Name of the run's record.
    pub key: String,
    /// Scene that is run.
    pub deck: Deck,
    /// Assignments, as for `--set` of `arlequin run`.
    pub set: Vec<String>,
    /// Rough duration \[s\]; dear runs start first.
    pub cost: u32,
}

impl RunSpec {
    /// Returns a run of a scene with assignments.
    pub(super) fn new(key: &str, deck: Deck, cost: u32, set: &[&str]) -> Self {
        Self {
            key: key.to_owned(),
            deck,
            set: set.iter().map(|s| (*s).to_owned()).collect(),
            cost,
        }
    }

    /// Adds further assignments.
    #[must_use]
    pub(super) fn with(mut self, set: &[String]) -> Self {
        self.set.extend_from_slice(set);
        self
    }

    /// Builds and runs the scene, or reads the record that an earlier run of the same version, scene and
    /// assignments stored in the folder.
    pub(super) fn run_or_recall(&self, kept: Option<&Path>) -> Result<Record> {
        let Some(folder) = kept else {
            return self.run();
        };
        let mut hash = std::hash::DefaultHasher::new();
        // The record of another version, scene or assignment must not be found.
        (env!("CARGO_PKG_VERSION"), self.deck.text(), &self.set).hash(&mut hash);
        let name = self.key.replace(['/', ' '], "-");
        let path = folder.join(format!("{name}-{:016x}.json", hash.finish()));
        // Broken or unreadable records are made again.
        let known = std::fs::read(&path).ok();
        if let Some(record) = known.and_then(|text| serde_json::from_slice(&text).ok()) {
            return Ok(record);
        }
        let record = self.run()?;
        let text = serde_json::to_vec(&record).map_err(|e| Error::System {
            what: "keeping a run",
            message: e.to_string(),
        })?;
        std::fs::create_dir_all(folder).map_err(write(folder))?;
        std::fs::write(&path, text).map_err(write(&path))?;
        Ok(record)
    }

    fn run(&self) -> Result<Record> {
        self.attempt().map_err(|e| Error::Key {
            key: format!("run {}", self.key),
            rule: e.to_string(),
        })
    }

    fn attempt(&self) -> Result<Record> {
        let (name, text) = self.deck.text();
        let scene = Scene::from_source(Source::new(name, text))?.assign(&self.set)?;
        let Built {
            mut run,
            probes,
            steps,
            ..
        } = setup::build(scene.spec(), Path::new("."))?;
        // Equal intervals, as the spectrum needs them.
        let every = steps.div_ceil(SAMPLES).max(1);
        let mut out = Record {
            step: every as f64 * run.dt(),
            ..Record::default()
        };
        let read = |out: &mut Record, run: &mut arlequin::core::Coupled<f64>| {
            out.times.push(run.time());
            let mut readings = Readings::default();
            for p in &probes {
                let value = p.read(run, &mut readings)?;
                out.probes.entry(p.name.clone()).or_default().push(value);
            }
            Ok::<_, Error>(())
        };
        let energy = run.energy();
        let before = run.momentum();
        read(&mut out, &mut run)?;
        let mut scale = momentum_scale(&run);
        for made in 1..=steps {
            run.advance(&mut Silent).map_err(core("time"))?;
            if made.is_multiple_of(every) {
                read(&mut out, &mut run)?;
                let now = momentum_scale(&run);
                // A body may start from rest, so the scale is the largest over the run.
                // Momenta are relative to what moves, not to what cancels.
                (0..2).for_each(|k| scale[k] = scale[k].max(now[k]));
            }
        }
        let after = run.momentum();
        out.momentum = (0..2)
            .map(|k| (after[k] - before[k]).norm() / scale[k].max(f64::MIN_POSITIVE))
            .fold(0.0, f64::max);
        out.drift = run.drift();
        out.residual = run.constraint_residual();
        out.particles = run.subdomains().iter().map(|s| s.model().nodes().len()).collect();
        if let Some(i) = run.interfaces().first() {
            let report = i.report();
            out.condition = Some(report.condition);
            out.multipliers = [report.multipliers, report.rank];
        }
        let total = |s: &arlequin::core::Subdomain<f64>| s.kinetic_energy() + s.internal_energy();
        out.energies = run
            .subdomains()
            .iter()
            .map(|s| total(s) / energy.max(f64::MIN_POSITIVE))
            .collect();
        Ok(out)
    }
}

/// Largest number of samples that a record keeps of a probe.
const SAMPLES: usize = 3000;

/// Record of a run.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Record {
    /// Time between two samples \[s\].
    pub step: f64,
    /// Times \[s\].
    pub times: Vec<f64>,
    /// Probes by name.
    pub probes: BTreeMap<String, Vec<f64>>,
    /// Largest relative drift of the invariant, which the ledger does not explain.
    pub drift: f64,
    /// Largest relative velocity jump.
    pub residual: f64,
    /// Largest change of linear or angular momentum, relative to the sum of the nodal moduli. Meaningful
    /// for a free body only.
    pub momentum: f64,
    /// Condition number of the interface operator.
    pub condition: Option<f64>,
    /// Number of multipliers, and number of independent ones.
    pub multipliers: [usize; 2],
    /// Number of nodes or particles of each model.
    pub particles: Vec<usize>,
    /// Energy of each model at the end, relative to the total at the start.
    pub energies: Vec<f64>,
}

impl Record {
    /// Returns the samples of a probe; empty if no probe has this name.
    pub fn probe(&self, name: &str) -> &[f64] {
        self.probes.get(name).map_or(&[], Vec::as_slice)
    }

    /// Returns the mean of an oscillation.
    pub fn mean(&self, probe: &str) -> f64 {
        spectrum::windowed_mean(self.probe(probe))
    }

    /// Returns the frequency near a guess \[Hz\].
    pub fn frequency(&self, probe: &str, guess: f64) -> f64 {
        spectrum::peak_near(self.probe(probe), self.step, guess)
    }

    /// Returns the checks of ledger, constraint and condition.
    pub fn health(&self, key: &str) -> Vec<Check> {
        let mut checks = vec![Check::new(
            format!("{key}: drift of H, ledger closed"),
            self.drift,
            Accept::AtMost(1e-9),
        )];
        if let Some(condition) = self.condition {
            let name = format!("{key}: constraint residual");
            checks.push(Check::new(name, self.residual, Accept::AtMost(1e-9)));
            let [all, rank] = self.multipliers;
            checks.push(
                Check::new(format!("{key}: cond(A)"), condition, Accept::AtMost(1e6))
                    .note(format!("{all} multipliers, {rank} independent")),
            );
        }
        checks
    }

    /// Returns a probe over time as a curve for a figure.
    pub fn curve(&self, name: &str, probe: &str) -> (String, Vec<f64>, Vec<f64>) {
        (name.to_owned(), self.times.clone(), self.probe(probe).to_vec())
    }
}

/// A round silica bar, clamped at one end.
#[derive(Debug, Clone, Copy)]
pub(super) struct Theory {
    /// Length \[m\].
    pub length: f64,
    /// Radius \[m\].
    pub radius: f64,
}

/// Young's modulus that yields the printed frequencies of theory \[Pa\].
const YOUNG: f64 = 72.5e9;
const POISSON: f64 = 0.17;
const DENSITY: f64 = 2200.0;
/// Axial or transverse force \[N\], and moment \[N m\], inferred from the printed deflections.
const FORCE: f64 = 1000.0;
const MOMENT: f64 = 10.0;

impl Theory {
    fn section(self) -> f64 {
        PI * self.radius.powi(2)
    }

    fn inertia(self) -> f64 {
        PI * self.radius.powi(4) / 4.0
    }

    /// Shear stiffness \[N\] with the shear correction factor of a round section.
    fn shear(self) -> f64 {
        let factor = 6.0 * (1.0 + POISSON) / (7.0 + 6.0 * POISSON);
        factor * YOUNG / (2.0 * (1.0 + POISSON)) * self.section()
    }

    /// Returns the elongation under the axial force \[m\].
    pub(super) fn elongation(self) -> f64 {
        FORCE * self.length / (YOUNG * self.section())
    }

    /// Returns the axial frequency number `k` \[Hz\], counted from zero.
    pub(super) fn axial(self, k: u32) -> f64 {
        f64::from(2 * k + 1) * (YOUNG / DENSITY).sqrt() / (4.0 * self.length)
    }

    /// Returns the deflection under the transverse force with shear \[m\].
    pub(super) fn deflection(self) -> f64 {
        FORCE * self.length.powi(3) / (3.0 * YOUNG * self.inertia()) + FORCE * self.length / self.shear()
    }

    /// Returns the deflection by Euler and Bernoulli \[m\], as the papers print it.
    pub(super) fn thin_deflection(self) -> f64 {
        FORCE * self.length.powi(3) / (3.0 * YOUNG * self.inertia())
    }

    /// Returns the first bending frequency by Euler and Bernoulli \[Hz\].
    pub(super) fn thin_bending(self) -> f64 {
        let stiffness = (YOUNG * self.inertia() / (DENSITY * self.section())).sqrt();
        1.875_104_1f64.powi(2) / (2.0 * PI * self.length.powi(2)) * stiffness
    }

    /// Returns the first bending frequency by Timoshenko \[Hz\]: the root of the clamped-free determinant.
    pub(super) fn bending(self) -> f64 {
        let l2 = self.length.powi(2);
        let r2 = self.inertia() / (self.section() * l2);
        let s2 = YOUNG * self.inertia() / (self.shear() * l2);
        let determinant = |f: f64| {
            let omega = 2.0 * PI * f;
            // The frequency equation of a clamped-free Timoshenko beam: rotary inertia `r²`, shear `s²`.
            let b2 = DENSITY * self.section() * l2 * l2 * omega.powi(2) / (YOUNG * self.inertia());
            let root = ((r2 - s2).powi(2) + 4.0 / b2).sqrt();
            let half = |sign: f64| b2.sqrt() * (0.5 * (root + sign * (r2 + s2))).sqrt();
            let (a, b) = (half(-1.0), half(1.0));
            2.0 + (b2 * (r2 - s2).powi(2) + 2.0) * a.cosh() * b.cos()
                - b2.sqrt() * (r2 + s2) / (1.0 - b2 * r2 * s2).sqrt() * a.sinh() * b.sin()
        };
        // Shear and rotary inertia lower the frequency, so the root lies below that of the thin beam.
        let (mut low, mut high) = (0.5 * self.thin_bending(), 1.02 * self.thin_bending());
        // Sixty halvings exhaust double precision.
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            // The sign change keeps the root between both ends.
            if determinant(low) * determinant(middle) <= 0.0 {
                high = middle;
            } else {
                low = middle;
            }
        }
        0.5 * (low + high)
    }

    /// Returns the twist under the moment \[rad\].
    pub(super) fn twist(self) -> f64 {
        MOMENT * self.length * 2.0 * (1.0 + POISSON) / (YOUNG * 2.0 * self.inertia())
    }

    /// Returns the first torsional frequency \[Hz\].
    pub(super) fn torsion(self) -> f64 {
        (YOUNG / (2.0 * (1.0 + POISSON)) / DENSITY).sqrt() / (4.0 * self.length)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn beam_theory_beside_the_printed_values_and_a_converged_solid() {
        let b = Theory {
            length: 0.1,
            radius: 0.01,
        };
        let near = |ours: f64, reference: f64, most: f64| {
            assert!((ours / reference - 1.0).abs() < most, "{ours} {reference}");
        };
        near(b.axial(0), 14_351.0, 1e-4);
        near(b.thin_bending(), 1606.0, 1e-3);
        near(b.torsion(), 9382.0, 1e-4);
        near(b.elongation(), 4.40e-6, 3e-3);
        near(b.thin_deflection(), 5.85e-4, 2e-3);
        near(b.twist(), 2.05e-3, 3e-3);
        // Converged three-dimensional solid: 1577.0 Hz, 0.5950 mm.
        near(b.bending(), 1577.0, 3e-3);
        near(b.deflection(), 5.950e-4, 5e-3);
    }
}
