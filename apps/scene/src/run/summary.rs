//! The summary of a run.

use super::End;
use super::session::Session;
use crate::crossing;
use crate::output::summary::{self, Energy, Summary, WallSeconds};

/// How a run ended.
pub(super) enum Status {
    /// By plan, by its user, or by a crack in an overlap.
    Ended(End),
    /// By an error with this message.
    Failed(String),
}

impl Status {
    fn name(&self) -> &'static str {
        match self {
            Self::Ended(End::Complete) => "complete",
            Self::Ended(End::Interrupted) => "interrupted",
            Self::Ended(End::Woken) => "woken",
            Self::Ended(End::IntoOverlap) => "stopped-at-overlap",
            Self::Failed(_) => "failed",
        }
    }
}

impl Session<'_> {
    /// Builds the summary; `writing` is the time spent on the result files \[s\].
    pub(super) fn summary(&self, status: Status, writing: f64) -> Summary {
        let (run, r) = (&self.run, &self.recorder);
        let [stepping, observing] = self.clock.split();
        let plan = run.plan();
        Summary {
            scene: self.scene.source().path.display().to_string(),
            title: self.scene.spec().title.clone(),
            load_steps: r.load_steps.clone(),
            status: status.name(),
            error: match status {
                Status::Failed(words) => Some(words),
                Status::Ended(_) => None,
            },
            version: env!("CARGO_PKG_VERSION"),
            resumed_at_step: self.resumed_at,
            wake: None,
            into_overlap: crossing::first_cracks(run, &self.breaks),
            set: self.scene.changes().to_vec(),
            ranks: self.holdings.clone(),
            threads: rayon::current_num_threads(),
            models: summary::models(run, &self.packings),
            dt: plan.dt,
            critical_dt: plan.critical_dt,
            steps: run.steps(),
            time: run.time(),
            frames: r.frames.as_ref().map_or(0, |f| f.count()),
            wall_seconds: WallSeconds {
                setup: self.setup,
                setup_phases: self.phases.clone(),
                stepping,
                output: observing + writing,
                phases: self.clock.phases(run),
            },
            peak_bytes: summary::process_bytes("VmHWM:"),
            energy: Energy {
                initial: r.initial_energy,
                last: run.energy(),
                h_drift_max: run.drift(),
                h_drift_explained: run.explained_drift(),
                unknown: run.unknown_energies(),
                created_max: run.top_created(),
                start_loss: run.start_loss(),
                ledger: run.works().into_iter().map(|w| (w.name, w.work)).collect(),
            },
            momentum: summary::momentum(run),
            interface: summary::interfaces(run, &r.residuals),
            effects: plan.effects,
            effect_ledger: summary::effects(run, &self.clock),
            probes: summary::probes(r),
            warnings: r.warnings.clone(),
        }
    }
}
