//! Recording of a run: probes, energy, frames and wall times.

use crate::error::{Error, Result, core};
use crate::output::curves::{CurveAxis, CurveLine};
use crate::output::fragments::{Fragments, Piece};
use crate::output::mark::FileList;
use crate::output::summary::LoadStep;
use crate::output::tables::Table;
use crate::output::{Entry, Frames};
use crate::setup::{Grid, LoweredScene, ProbeReader, Readings};
use crate::spec::Curve;
use arlequin::core::{Coupled, EnergySample, Observer, Phase, StepReport};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::time::Instant;

/// Clock that measures the wall time of each phase of a step.
#[derive(Debug)]
pub struct PhaseClock {
    since: Instant,
    current: Option<Phase>,
    seconds: Vec<(Phase, f64)>,
}

impl Default for PhaseClock {
    fn default() -> Self {
        Self::new()
    }
}

impl PhaseClock {
    /// Creates a clock that starts now.
    pub fn new() -> Self {
        Self {
            since: Instant::now(),
            current: None,
            seconds: Vec::new(),
        }
    }

    /// Begins a phase and ends the previous one.
    pub fn enter(&mut self, phase: Option<Phase>) {
        // One reading ends a phase and begins the next, so that no time is lost between them.
        let now = Instant::now();
        if let Some(p) = self.current {
            let passed = (now - self.since).as_secs_f64();
            match self.seconds.iter_mut().find(|s| s.0 == p) {
                Some(s) => s.1 += passed,
                None => self.seconds.push((p, passed)),
            }
        }
        self.since = now;
        self.current = phase;
    }

    /// Wall time of each phase \[s\]; phases of models carry the model's name.
    pub fn phases(&self, run: &Coupled<f64>) -> BTreeMap<String, f64> {
        let name = |p: Phase| match p {
            Phase::Predict(k) => format!("predict/{}", run.subdomains()[k].model().name()),
            Phase::Evolve(k) => format!("evolve/{}", run.subdomains()[k].model().name()),
            Phase::Effect(k, e) => {
                let s = &run.subdomains()[k];
                let effect = s.effects().nth(e).map_or("?", |e| e.name());
                format!("effect/{}/{effect}", s.model().name())
            }
            Phase::Pair(k) => {
                let lines = run.effects();
                let line = lines.iter().find(|e| e.phase == Some(Phase::Pair(k)));
                format!("effect/{}", line.map_or("?", |e| &e.name))
            }
            Phase::Interface => "interface".to_owned(),
            Phase::Equilibrium => "equilibrium".to_owned(),
            Phase::Rezone => "changes of weights".to_owned(),
            Phase::Ledger => "ledger".to_owned(),
            Phase::Observe => "observe".to_owned(),
            _ => "other".to_owned(),
        };
        self.seconds.iter().map(|(p, s)| (name(*p), *s)).collect()
    }

    /// Wall time of one phase \[s\].
    pub fn seconds(&self, phase: Phase) -> f64 {
        self.seconds.iter().find(|s| s.0 == phase).map_or(0.0, |s| s.1)
    }

    /// Wall times of the steps and of the observation \[s\].
    pub fn split(&self) -> [f64; 2] {
        self.seconds.iter().fold([0.0; 2], |mut sum, (p, s)| {
            sum[usize::from(*p == Phase::Observe)] += s;
            sum
        })
    }
}

impl Observer<f64> for PhaseClock {
    fn phase(&mut self, phase: Phase) {
        self.enter(Some(phase));
    }

    fn observe(&mut self, _: &Coupled<f64>, _: &StepReport<f64>) -> arlequin::core::Result<ControlFlow<()>> {
        Ok(ControlFlow::Continue(()))
    }
}

/// First columns of [`Recorder::energy`]; the works follow.
pub(super) const ENERGY_COLUMNS: [&str; 10] = [
    "kinetic [J]",
    "internal [J]",
    "total [J]",
    "invariant [J]",
    "work [J]",
    "drift [J]",
    "relative drift [-]",
    "constraint residual [-]",
    "momentum drift [-]",
    "angular momentum drift [-]",
];

/// Columns of each body in [`Recorder::energy`], after the works.
pub(super) const MOMENTUM_COLUMNS: [&str; 6] = [
    "momentum x [kg m/s]",
    "momentum y [kg m/s]",
    "momentum z [kg m/s]",
    "angular momentum x [kg m2/s]",
    "angular momentum y [kg m2/s]",
    "angular momentum z [kg m2/s]",
];

/// Records that a checkpoint holds for a resumed run.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Records {
    probes: Table,
    energy: Table,
    effects: Table,
    residuals: Vec<f64>,
    top_speed: f64,
    warnings: Vec<String>,
    frames: Vec<Entry>,
    fragments: Vec<Piece>,
    load_steps: Vec<LoadStep>,
    /// Energy before the first step \[J\].
    pub initial_energy: f64,
}

/// Recorder of a run.
#[derive(Debug)]
pub(super) struct Recorder {
    /// Readers of the probes.
    pub readers: Vec<ProbeReader>,
    /// Values of the probes.
    pub probes: Table,
    /// Energies: [`ENERGY_COLUMNS`], then one column per work, then [`MOMENTUM_COLUMNS`] per body.
    pub energy: Table,
    /// Figures that the effects report, at the times of `energy`.
    pub effects: Table,
    /// Writer of frames; `None` if the run writes no files.
    pub frames: Option<Frames>,
    /// Fragments at the times of the frames; for partitioned bodies on rank 0 only.
    pub fragments: Fragments,
    /// Load steps of a `[static]` scene.
    pub load_steps: Vec<LoadStep>,
    /// Largest relative velocity jump of each interface \[–\].
    pub residuals: Vec<f64>,
    /// Warnings for the user, each once: those of the set-up, then those of the steps.
    pub warnings: Vec<String>,
    top_speed: f64,
    /// Energy before the first step \[J\].
    pub initial_energy: f64,
    probe_every: usize,
    frame_every: usize,
}

impl Recorder {
    /// Creates a recorder and records the state before the first step, unless that state is `known`: a
    /// resumed run has recorded it before, and the start of a `[static]` scene is no equilibrium.
    pub(super) fn new(
        run: &mut Coupled<f64>,
        mut readers: Vec<ProbeReader>,
        mut frames: Option<Frames>,
        mut fragments: Fragments,
        [probe_every, frame_every]: [usize; 2],
        warnings: Vec<String>,
        known: bool,
    ) -> Result<Self> {
        if !known {
            if let Some(frames) = &mut frames {
                frames.write(run)?;
            }
            fragments.look(run)?;
        }
        for r in &mut readers {
            r.set_up_gather(run);
        }
        let works: Vec<String> = run.works().into_iter().map(|w| w.name).collect();
        let bodies: Vec<String> = run.bodies().iter().map(|b| b.models.join(" + ")).collect();
        let momenta = |b: &String| MOMENTUM_COLUMNS.map(|c| format!("{b} {c}"));
        let energy = ENERGY_COLUMNS.map(str::to_owned).into_iter();
        let energy = energy.chain(works.iter().map(|w| format!("work {w} [J]")));
        let mut out = Self {
            probes: Table::new(
                readers
                    .iter()
                    .map(|p| format!("{} {}", p.name, p.quantity.label())),
            ),
            energy: Table::new(energy.chain(bodies.iter().flat_map(momenta))),
            effects: Table::new(facts(run).map(|f| f.0)),
            readers,
            frames,
            fragments,
            load_steps: Vec::new(),
            residuals: Vec::new(),
            warnings,
            top_speed: 0.0,
            initial_energy: run.energy(),
            probe_every,
            frame_every,
        };
        if !known {
            out.read_probes(run)?;
        }
        Ok(out)
    }

    /// Continues with what was recorded before.
    pub(super) fn resume(&mut self, from: Records) -> Result<()> {
        self.probes.resume(from.probes);
        self.energy.resume(from.energy);
        self.effects.resume(from.effects);
        self.residuals = from.residuals;
        self.top_speed = from.top_speed;
        // One by one: a warning that the set-up has given again must not stand twice.
        for w in from.warnings {
            self.warn(w);
        }
        self.initial_energy = from.initial_energy;
        self.fragments.rows = from.fragments;
        self.load_steps = from.load_steps;
        match &mut self.frames {
            Some(frames) => frames.resume(from.frames),
            None => Ok(()),
        }
    }

    /// Shows another mediator in frames, if there is one, with the number of its interface.
    pub(super) fn show_mediator(&mut self, new: Option<(usize, Grid)>) {
        if let (Some((number, grid)), Some(frames)) = (new, &mut self.frames) {
            frames.set_mediator(number, grid);
        }
    }

    /// Adds a warning; returns whether it is new.
    pub(super) fn warn(&mut self, text: String) -> bool {
        let new = !self.warnings.contains(&text);
        if new {
            self.warnings.push(text);
        }
        new
    }

    /// Returns the records that a resumed run needs.
    pub(super) fn records(&self) -> Records {
        Records {
            probes: self.probes.clone(),
            energy: self.energy.clone(),
            effects: self.effects.clone(),
            residuals: self.residuals.clone(),
            top_speed: self.top_speed,
            warnings: self.warnings.clone(),
            frames: self
                .frames
                .as_ref()
                .map_or_else(Vec::new, |f| f.entries().to_vec()),
            fragments: self.fragments.rows.clone(),
            load_steps: self.load_steps.clone(),
            initial_energy: self.initial_energy,
        }
    }

    /// Records the step just made.
    pub(super) fn observe(
        &mut self,
        run: &mut Coupled<f64>,
        energy: Option<EnergySample<f64>>,
    ) -> Result<()> {
        if run.steps().is_multiple_of(self.probe_every) {
            self.read_probes(run)?;
        }
        if let Some(sample) = energy {
            self.record_energy(run, &sample);
        }
        self.write_frame(run, run.steps().is_multiple_of(self.frame_every))
    }

    /// Writes the last state, unless a frame of it exists already.
    pub(super) fn finish(&mut self, run: &Coupled<f64>) -> Result<()> {
        // If the last step was due, its frame exists.
        self.write_frame(run, !run.steps().is_multiple_of(self.frame_every))
    }

    fn write_frame(&mut self, run: &Coupled<f64>, due: bool) -> Result<()> {
        if due {
            self.fragments.look(run)?;
        }
        match &mut self.frames {
            Some(frames) if due => frames.write(run),
            _ => Ok(()),
        }
    }

    /// Files of frames that this process has written, by their paths in the folder of the results.
    pub(super) fn files(&self) -> FileList {
        self.frames
            .as_ref()
            .map_or_else(FileList::new, |f| f.written().clone())
    }

    /// Returns whether the step just made writes a frame.
    pub(super) fn framed(&self, run: &Coupled<f64>) -> bool {
        run.steps().is_multiple_of(self.frame_every)
    }

    /// Tables of probes, energy and effects.
    pub(super) fn tables(&self) -> [&Table; 3] {
        [&self.probes, &self.energy, &self.effects]
    }

    /// Returns the curves of a scene. A curve whose probe has no reader is left out.
    pub(super) fn curves(&self, scene: &LoweredScene) -> Vec<CurveLine> {
        let line = |(name, c): (&String, &Curve)| {
            Some(CurveLine {
                name: name.clone(),
                times: self.probes.times.clone(),
                x: self.curve_axis(&c.x, c.x_factor)?,
                y: self.curve_axis(&c.y, c.y_factor)?,
            })
        };
        scene.curve.iter().filter_map(line).collect()
    }

    fn curve_axis(&self, probe: &str, factor: f64) -> Option<CurveAxis> {
        let k = self.readers.iter().position(|p| p.name == probe)?;
        let label = self.readers[k].quantity.label();
        let (quantity, unit) = label.strip_suffix(']')?.split_once(" [")?;
        // Only the exact factor one changes nothing: comparison by bits.
        let prefix = match factor.to_bits() == 1.0_f64.to_bits() {
            true => String::new(),
            false => format!("{factor} "),
        };
        Some(CurveAxis {
            label: format!("{prefix}{probe} {quantity}"),
            unit: unit.to_owned(),
            values: self.probes.columns[k].iter().map(|v| factor * v).collect(),
        })
    }

    fn read_probes(&mut self, run: &mut Coupled<f64>) -> Result<()> {
        let mut readings = Readings::default();
        let values = self.readers.iter().map(|r| r.read(run, &mut readings));
        let values = values.collect::<Result<Vec<f64>>>()?;
        // After a failed exchange the values mean nothing, so that failure is reported first.
        let subdomains = run.subdomains().iter();
        let checked = subdomains.map(|s| s.owned().check_communication());
        checked
            .collect::<std::result::Result<(), _>>()
            .map_err(core("ranks"))?;
        // Refused here, since a table with NaN would be read as a result.
        if let Some(k) = values.iter().position(|v| !v.is_finite()) {
            return Err(Error::NotFinite {
                what: format!("probe '{}'", self.readers[k].name),
                time: run.time(),
            });
        }
        self.probes.push(run.time(), values.into_iter());
        Ok(())
    }

    fn record_energy(&mut self, run: &mut Coupled<f64>, s: &EnergySample<f64>) {
        let fixed = [
            s.kinetic,
            s.internal,
            s.total(),
            s.invariant,
            s.work,
            s.drift,
            s.relative_drift,
            s.constraint_residual,
            s.momentum_drift[0],
            s.momentum_drift[1],
        ];
        let works = run.works().into_iter().map(|w| w.work);
        let bodies = run.bodies();
        let momenta = bodies
            .iter()
            .flat_map(|b| b.linear.iter().chain(&b.angular).copied());
        let row = fixed.into_iter().chain(works).chain(momenta);
        self.energy.push(s.time, row);
        if !self.effects.names.is_empty() {
            self.effects.push(s.time, facts(run).map(|f| f.1));
        }
        for d in run.subdomains() {
            let moving = &d.state().v[..d.model().layout().translations()];
            let largest = moving.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
            // All ranks take part in the maximum, so that all of them compare with the same speed.
            let top = d.owned().largest(largest);
            self.top_speed = self.top_speed.max(top);
        }
        self.residuals.resize(run.interfaces().len(), 0.0);
        for k in 0..run.interfaces().len() {
            let jump = run.jumps(k)[0];
            // Before anything moves, the jump is zero over zero.
            if self.top_speed > 0.0 {
                self.residuals[k] = self.residuals[k].max(jump / self.top_speed);
            }
        }
    }
}

/// Figures of all effects: `effect figure` and value.
fn facts(run: &Coupled<f64>) -> impl Iterator<Item = (String, f64)> {
    run.effects().into_iter().flat_map(|e| {
        let name = e.name;
        e.facts
            .into_iter()
            .map(move |(fact, x)| (format!("{name} {fact}"), x))
    })
}

/// Makes one step and measures its phases.
pub(super) fn step(run: &mut Coupled<f64>, clock: &mut PhaseClock) -> Result<Option<EnergySample<f64>>> {
    let report = run.advance(clock).map_err(core("time"))?;
    clock.enter(Some(Phase::Observe));
    Ok(report.energy)
}
