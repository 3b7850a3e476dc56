//! Where the time of a set-up goes.

use arlequin::core::SetupPhase;
use serde::Serialize;
use std::time::Instant;

/// A phase of a set-up.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PhaseTime {
    /// What was done, such as "packing of 'right'".
    pub phase: String,
    /// How long it took \[s\].
    pub seconds: f64,
}

/// Times the phases of a set-up, each of which ends where the next begins, and tells of them as they begin.
pub(crate) struct SetupClock<'a> {
    tell: &'a mut dyn FnMut(&str),
    now: Option<(String, Instant)>,
    done: Vec<PhaseTime>,
}

impl<'a> SetupClock<'a> {
    pub(crate) fn new(tell: &'a mut dyn FnMut(&str)) -> Self {
        Self {
            tell,
            now: None,
            done: Vec::new(),
        }
    }

    /// The phase of this name begins.
    pub(crate) fn begin(&mut self, phase: String) {
        self.stop();
        (self.tell)(&phase);
        self.now = Some((phase, Instant::now()));
    }

    fn stop(&mut self) {
        if let Some((phase, since)) = self.now.take() {
            let seconds = since.elapsed().as_secs_f64();
            self.done.push(PhaseTime { phase, seconds });
        }
    }

    /// The last phase is over.
    pub(crate) fn finish(mut self) -> Vec<PhaseTime> {
        self.stop();
        self.done
    }
}

/// A phase of the core in words; `names` are those of the models and of the interfaces.
pub(super) fn name(phase: SetupPhase, [models, interfaces]: &[Vec<String>; 2]) -> String {
    let of = |names: &[String], k: usize| names.get(k).cloned().unwrap_or_default();
    match phase {
        SetupPhase::Weights(m) => format!("weights of '{}'", of(models, m)),
        SetupPhase::Partition => "partition of unity".to_owned(),
        SetupPhase::Junction(k) => format!("junction integrals of '{}'", of(interfaces, k)),
        SetupPhase::Operator(k) => format!("operator and factor of '{}'", of(interfaces, k)),
        SetupPhase::Step => "critical steps".to_owned(),
        SetupPhase::Start => "initial state".to_owned(),
        _ => "the rest".to_owned(),
    }
}
