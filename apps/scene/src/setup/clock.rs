//! Wall times of the set-up.

use arlequin::core::SetupPhase;
use serde::Serialize;
use std::time::Instant;

/// A phase of the set-up.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PhaseTime {
    /// Description, such as "packing of 'right'".
    pub phase: String,
    /// Wall time \[s\].
    pub seconds: f64,
}

/// Times the phases of the set-up and announces each as it begins, and how much of it is done. A phase ends
/// where the next begins.
pub(crate) struct SetupClock<'a> {
    announce: &'a mut dyn FnMut(&str, usize, usize),
    now: Option<(String, Instant)>,
    finished: Vec<PhaseTime>,
}

impl<'a> SetupClock<'a> {
    pub(crate) fn new(announce: &'a mut dyn FnMut(&str, usize, usize)) -> Self {
        Self {
            announce,
            now: None,
            finished: Vec::new(),
        }
    }

    /// Begins a phase and ends the previous one.
    pub(crate) fn begin(&mut self, phase: String) {
        self.stop();
        (self.announce)(&phase, 0, 0);
        self.now = Some((phase, Instant::now()));
    }

    /// Announces the share of the current phase that is done, from 0 to 1.
    pub(crate) fn progress(&mut self, share: f64) {
        if let Some((phase, _)) = &self.now {
            (self.announce)(phase, (100.0 * share) as usize, 100);
        }
    }

    fn stop(&mut self) {
        if let Some((phase, since)) = self.now.take() {
            let seconds = since.elapsed().as_secs_f64();
            self.finished.push(PhaseTime { phase, seconds });
        }
    }

    /// Ends the last phase and returns all phases.
    pub(crate) fn finish(mut self) -> Vec<PhaseTime> {
        self.stop();
        self.finished
    }
}

/// Description of a phase of the core; `models` and `interfaces` are the names in the scene.
pub(super) fn name(phase: SetupPhase, [models, interfaces]: &[Vec<String>; 2]) -> String {
    let name_of = |names: &[String], k: usize| names.get(k).cloned().unwrap_or_default();
    match phase {
        SetupPhase::Weights(m) => format!("weights of '{}'", name_of(models, m)),
        SetupPhase::Partition => "partition of unity".to_owned(),
        SetupPhase::Junction(k) => format!("junction integrals of '{}'", name_of(interfaces, k)),
        SetupPhase::Operator(k) => format!("operator and factor of '{}'", name_of(interfaces, k)),
        SetupPhase::Pair(_) => "contact between models".to_owned(),
        SetupPhase::Step => "critical steps".to_owned(),
        SetupPhase::Start => "initial state".to_owned(),
        _ => "the rest".to_owned(),
    }
}
