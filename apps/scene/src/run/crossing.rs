//! Cracks that run into an overlap: warned about once per model, listed in the summary, and a reason to end
//! the run if the scene asks for it.

use crate::output::summary::OverlapBreak;
use crate::setup::{self, LoweredScene};
use arlequin::core::Coupled;
use arlequin::dem_beam::fracture::{CRACK, SharedLog, locked};

impl std::fmt::Display for OverlapBreak {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [x, y, z] = self.place;
        write!(
            f,
            "model '{}': a crack ran into an overlap at t = {:.4e} s, where {CRACK} of its bonds are broken by now, the last at \
             ({x:.3e}, {y:.3e}, {z:.3e}) m: breakage has left the particles' own region, where results are those of particles \
             alone; from here on the other model carries load past the crack. Enlarge the region of particles, or end the run \
             there (fracture.stop_at_overlap = true)",
            self.model, self.time
        )
    }
}

/// For each model: true if its crack was reported already.
#[derive(Debug)]
pub(crate) struct Crossing(Vec<bool>);

impl Crossing {
    /// Marks all cracks that exist already as reported.
    pub(crate) fn since(breaks: &[Option<SharedLog>]) -> Self {
        Self(breaks.iter().map(|b| has_left(b.as_ref())).collect())
    }

    /// Returns the messages about the step just made, and whether the scene ends the run there.
    pub(crate) fn watch(
        &mut self,
        scene: &LoweredScene,
        run: &Coupled<f64>,
        breaks: &[Option<SharedLog>],
    ) -> (Vec<String>, bool) {
        let (mut messages, mut ends) = (Vec::new(), false);
        for (m, reported) in self.0.iter_mut().enumerate() {
            if *reported || !has_left(breaks[m].as_ref()) {
                continue;
            }
            *reported = true;
            messages.extend(of_model(run, m, breaks[m].as_ref()).map(|line| line.to_string()));
            ends |= setup::stops_at_overlap(scene, m);
        }
        (messages, ends)
    }
}

/// First crack of each model that ran into an overlap.
pub(crate) fn first_cracks(run: &Coupled<f64>, breaks: &[Option<SharedLog>]) -> Vec<OverlapBreak> {
    let logs = breaks.iter().enumerate();
    logs.filter_map(|(m, b)| of_model(run, m, b.as_ref())).collect()
}

/// Returns whether a crack has run into an overlap.
fn has_left(breaks: Option<&SharedLog>) -> bool {
    breaks.is_some_and(|b| locked(b).crack_in_overlap().is_some())
}

fn of_model(run: &Coupled<f64>, m: usize, breaks: Option<&SharedLog>) -> Option<OverlapBreak> {
    let log = locked(breaks?);
    let first = log.crack_in_overlap()?;
    Some(OverlapBreak {
        model: run.subdomains().get(m)?.model().name().to_owned(),
        time: first.time,
        place: first.place.into(),
        bonds: log.events().iter().filter(|e| e.overlap).count(),
    })
}
