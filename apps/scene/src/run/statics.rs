//! Scenes at rest: successive load steps.

use super::results::{End, Observer};
use super::session::Session;
use crate::error::{Result, core};
use crate::output::fragments;
use crate::output::summary::LoadStep;
use crate::setup::LoadSteps;
use arlequin::core::{Error as Failure, Phase, Settled};

impl LoadStep {
    fn new(time: f64, s: &Settled<f64>) -> Self {
        Self {
            time,
            method: s.method.to_owned(),
            residual: s.residual,
            iterations: s.iterations,
            energy: s.energy,
        }
    }
}

impl Session<'_> {
    /// Adds to an error of a load step the largest fragment that came loose, if there is one.
    fn with_loose_fragment(&self, mut e: Failure) -> Failure {
        if let Failure::NotSettled { free, .. } = &mut e
            && let Some((particles, model, [x, y, z])) = fragments::loose(&self.run, &self.breaks)
        {
            *free = format!(
                "; a piece of {particles} particles of '{model}' around ({x:.4e}, {y:.4e}, {z:.4e}) m has come loose and is held by \
                 nothing: move supports in place of loads, so that what tears stays held, or end before"
            );
        }
        e
    }

    /// Makes the remaining load steps until the observer ends them.
    pub(super) fn settle(&mut self, steps: &LoadSteps, observer: &mut dyn Observer) -> Result<End> {
        self.recorder.warnings.iter().for_each(|w| observer.warning(w));
        let every = self.scene.spec().output.checkpoint_every;
        let mut end = End::Complete;
        self.intrusions.skip(&self.recorder.warnings);
        for made in self.run.steps()..steps.times.len() {
            let from = made.checked_sub(1).map_or(0.0, |k| steps.times[k]);
            let time = steps.times[made];
            self.clock.enter(Some(Phase::Equilibrium));
            let settled = self.run.settle(from, time, &steps.relaxation);
            self.clock.enter(Some(Phase::Observe));
            let settled = settled.map_err(|e| core("static")(self.with_loose_fragment(e)))?;
            self.recorder.load_steps.push(LoadStep::new(time, &settled));
            self.recorder.observe(&mut self.run, None)?;
            self.flush()?;
            self.warn_of_intrusions(true, observer)?;
            let flow = observer.step(&self.run, self.steps);
            if made + 1 == steps.times.len() {
                break;
            }
            if every.is_some_and(|n| (made + 1).is_multiple_of(n)) {
                self.save()?;
            }
            if flow.is_break() {
                end = End::Interrupted;
                break;
            }
        }
        observer.stepped();
        self.clock.enter(None);
        Ok(end)
    }
}
