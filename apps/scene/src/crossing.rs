//! Cracks that run into an overlap: said when it happens, kept for the summary, and a reason to end where
//! wanted.

use crate::setup;
use crate::spec::{Effect, EffectKind, SceneSpec};
use arlequin::core::Coupled;
use arlequin::dem_beam::fracture::{CRACK, SharedLog, locked};
use serde::Serialize;

/// A crack that ran into an overlap.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct OverlapBreak {
    /// The model.
    pub model: String,
    /// Time of the break with which it was one \[s\], see [`CRACK`].
    pub time: f64,
    /// Place of that bond \[m\].
    pub place: [f64; 3],
    /// Bonds of overlaps that are broken by now.
    pub bonds: usize,
}

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

/// Models of which it was said.
#[derive(Debug)]
pub(crate) struct Crossing(Vec<bool>);

impl Crossing {
    /// What has happened so far needs no word.
    pub(crate) fn since(breaks: &[Option<SharedLog>]) -> Self {
        Self(breaks.iter().map(|b| has_left(b.as_ref())).collect())
    }

    /// What there is to say of the step just made, and whether the scene ends there.
    pub(crate) fn watch(
        &mut self,
        scene: &SceneSpec,
        run: &Coupled<f64>,
        breaks: &[Option<SharedLog>],
    ) -> (Vec<String>, bool) {
        let (mut said, mut ends) = (Vec::new(), false);
        for (m, told) in self.0.iter_mut().enumerate() {
            if *told || !has_left(breaks[m].as_ref()) {
                continue;
            }
            *told = true;
            said.extend(of_model(run, m, breaks[m].as_ref()).map(|line| line.to_string()));
            ends |= stops(scene, m);
        }
        (said, ends)
    }
}

/// First cracks that ran into overlaps, one per model.
pub(crate) fn found(run: &Coupled<f64>, breaks: &[Option<SharedLog>]) -> Vec<OverlapBreak> {
    let all = breaks.iter().enumerate();
    all.filter_map(|(m, b)| of_model(run, m, b.as_ref())).collect()
}

/// Whether a crack has run into an overlap.
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

/// Whether an effect of the scene ends the run when a crack of model `m` runs into an overlap.
fn stops(scene: &SceneSpec, m: usize) -> bool {
    let of = |(k, e): (usize, &Effect)| {
        let stops = e.enabled && matches!(&e.kind, EffectKind::Fracture(f) if f.stop_at_overlap);
        stops && setup::effect_models(k, e, scene).is_ok_and(|models| models.contains(&m))
    };
    scene.effect.iter().enumerate().any(of)
}
