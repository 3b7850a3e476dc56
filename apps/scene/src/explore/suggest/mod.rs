//! Proposes settings of a coupling for a given error or time.
//!
//! Errors come from the dispersion of the coarse lattice and the harmonic analysis of the overlap. Times come
//! from trial steps on this machine, which are repeated with each proposal until prediction and measurement
//! agree.

mod apply;
mod around;
mod choose;
mod measure;
mod path;
mod predict;
mod scenario;

use crate::error::{Result, key, value};
use crate::scene::Scene;
use crate::spec::SceneSpec;
use apply::Change;
pub use choose::Goal;
use choose::{CostModel, Prospect, Search};
use measure::measure;
pub use predict::Errors;
use scenario::{OverlapKind, Scenario};
use serde::Serialize;
use std::path::Path;

/// Largest number of proposals that are built and measured.
const ROUNDS: usize = 4;
/// Largest relative difference of predicted and measured time.
const AGREED: f64 = 0.15;
/// Proposed step over critical step.
const FRACTION: f64 = 0.9;

/// A proposal of settings.
#[derive(Debug, Serialize)]
pub struct Proposal {
    /// Path of the scene.
    pub scene: String,
    /// Target of the proposal in words.
    pub goal: String,
    /// Source of the spectrum.
    pub signal: String,
    /// Settings and prediction of the scene as given.
    pub given: Forecast,
    /// Settings and prediction of the proposal.
    pub proposed: Forecast,
    /// Changed values, as assignments.
    pub set: Vec<String>,
    /// Notes for the user.
    pub notes: Vec<String>,
    #[serde(skip)]
    changes: Vec<Change>,
}

impl Proposal {
    /// Writes the scene with the proposed values, comments kept.
    ///
    /// # Errors
    /// A file that exists; values that do not fit the scene.
    pub fn write(&self, scene: &Scene, out: &Path) -> Result<()> {
        apply::write(scene, &self.changes, out)
    }
}

/// Settings with their predicted error and time.
#[derive(Debug, Serialize)]
pub struct Forecast {
    /// Settings by name.
    pub settings: Vec<(String, String)>,
    /// Errors.
    pub errors: Errors,
    /// Largest amplitude reflected by the overlap for wavelengths above 4.2 coarse spacings \[–\].
    pub top_reflection: f64,
    /// Time of set-up and steps \[s\].
    pub seconds: f64,
}

/// Prediction for a scene as given.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, serde::Deserialize)]
pub struct Prediction {
    /// Relative error of displacements against the fine model everywhere \[–\].
    pub displacement: f64,
    /// Relative error of velocities against the fine model everywhere \[–\].
    pub velocity: f64,
    /// Time of set-up and steps \[s\].
    pub seconds: f64,
}

/// Reads a scene, and refuses one for which nothing can be predicted.
pub fn readable(scene: &SceneSpec) -> Result<Scenario> {
    scene.refuse_wake("suggest")?;
    let s = scenario::scenario(scene)?;
    if scene.interface.values().any(|i| i.lumped) {
        let rule = "suggest cannot analyse a lumped interface; remove it";
        return Err(key(format!("{}.lumped", s.keys[1]), rule));
    }
    Ok(s)
}

/// Predicts error and time of a scene as given, from trial steps on this machine and the analysis of its
/// overlap.
pub fn predict_as_given(scene: &Scene) -> Result<Prediction> {
    readable(scene.spec())?;
    let (m, end, s) = measure(scene, &[])?;
    let spectrum = scenario::spectrum(scene.spec(), &s, end, None)?;
    let (candidate, form) = choose::as_given(&s);
    let tables = predict::tables(&[form])?;
    let errors = predict::errors(&candidate, &tables, &s, &spectrum, end, m.dt);
    let fraction = s
        .fraction
        .unwrap_or_else(|| m.dt / m.critical[0].min(m.critical[1]));
    Ok(Prediction {
        displacement: errors.displacement,
        velocity: errors.velocity,
        seconds: CostModel::new(candidate, m, &s, fraction).seconds(&candidate, &s, end),
    })
}

/// Proposes settings. `frequency` is the highest frequency of interest \[Hz\], for scenes whose loads do not
/// give one.
///
/// # Errors
/// Scenes for which nothing can be predicted, goals out of reach, failed trial steps.
pub fn suggest(scene: &Scene, goal: Goal, frequency: Option<f64>) -> Result<Proposal> {
    // Refused before anything is built.
    scenario::signal(scene.spec(), &readable(scene.spec())?, frequency)?;
    let (first, end, s) = measure(scene, &[])?;
    let spectrum = scenario::spectrum(scene.spec(), &s, end, frequency)?;
    let search = Search::new(&s, &spectrum, end)?;
    let fraction = s
        .fraction
        .unwrap_or(first.dt / first.critical[0].min(first.critical[1]));
    let as_given = CostModel::new(search.given, first, &s, fraction);
    let current = search.predict(&search.given, &as_given, first.dt);
    // The scene as given keeps its step; proposals choose theirs.
    let costs = CostModel::new(search.given, first, &s, FRACTION);
    let (chosen, changes) = settle(scene, &search, goal, costs)?;
    let absorber = s.absorber || apply::needs_absorber(&chosen);
    Ok(Proposal {
        scene: scene.source().path.display().to_string(),
        goal: match goal {
            Goal::Error(e) => format!("least time within an error of {e}"),
            Goal::Time(t) => format!("least error within {t} s"),
        },
        signal: spectrum.source.clone(),
        given: forecast(&search, &s, &current, fraction, s.absorber),
        proposed: forecast(&search, &s, &chosen, FRACTION, absorber),
        set: changes.iter().filter_map(Change::assignment).collect(),
        notes: notes(&s, &chosen),
        changes,
    })
}

/// Picks a candidate, measures it, and picks again with the measured cost until prediction and measurement
/// agree.
fn settle(
    scene: &Scene,
    search: &Search<'_>,
    goal: Goal,
    mut costs: CostModel,
) -> Result<(Prospect, Vec<Change>)> {
    let s = search.scenario;
    let mut proposal = pick(search, goal, &costs)?;
    for round in 1..=ROUNDS {
        let changes = apply::changes(scene.spec(), s, &proposal, FRACTION);
        let (m, ..) = measure(scene, &changes)?;
        // The measured candidate becomes the base, where scaling costs no accuracy.
        costs = CostModel::new(proposal.candidate, m, s, FRACTION);
        let measured = costs.seconds(&proposal.candidate, s, search.end);
        let agreed = (proposal.seconds / measured - 1.0).abs() < AGREED;
        proposal.seconds = measured;
        let goal_met = match goal {
            Goal::Error(_) => true,
            Goal::Time(t) => measured <= t,
        };
        let next = pick(search, goal, &costs)?;
        // A candidate that is picked again would only be measured again.
        if round == ROUNDS || (agreed && goal_met) || next.candidate == proposal.candidate {
            return Ok((proposal, changes));
        }
        proposal = next;
    }
    // Not reached: the last round returns.
    pick(search, goal, &costs).map(|p| (p, Vec::new()))
}

fn pick(search: &Search<'_>, goal: Goal, costs: &CostModel) -> Result<Prospect> {
    search.best(goal, costs).map_err(|nearest| {
        let closest = |p: Prospect| {
            format!(
                "the closest is an error of {:.2e} in {:.2e} s with a coarse spacing of {:.2e} m",
                p.errors.worst(),
                p.seconds,
                p.candidate.h
            )
        };
        let none = || "no coarse spacing fits between the fine spacing and the body".to_owned();
        let nearest = nearest.map_or_else(none, closest);
        match goal {
            Goal::Error(e) => value(
                "--error",
                e,
                &format!("is out of reach: {nearest}; ask for a larger error"),
            ),
            Goal::Time(t) => value(
                "--time",
                t,
                &format!("is out of reach: {nearest}; ask for a longer time [s]"),
            ),
        }
    })
}

fn forecast(search: &Search<'_>, s: &Scenario, p: &Prospect, fraction: f64, absorber: bool) -> Forecast {
    let c = &p.candidate;
    let mut settings = vec![
        ("h_C [m]".to_owned(), format!("{:.4e}", c.h)),
        ("h_B [m]".to_owned(), format!("{:.4e}", c.h_b)),
        ("L_O [m]".to_owned(), format!("{:.4e}", c.overlap)),
        ("weight".to_owned(), c.profile.to_string()),
        ("junction".to_owned(), s.junction.to_string()),
        ("step / critical".to_owned(), format!("{fraction:.3}")),
    ];
    if let Some(l) = c.length_ratio {
        settings.push(("l [m]".to_owned(), format!("{:.4e}", l * c.h_b)));
    }
    settings.push((
        "absorber".to_owned(),
        if absorber { "on" } else { "off" }.to_owned(),
    ));
    Forecast {
        settings,
        errors: p.errors,
        top_reflection: search.tables[c.table].top_reflection,
        seconds: p.seconds,
    }
}

fn notes(s: &Scenario, p: &Prospect) -> Vec<String> {
    let mut out = Vec::new();
    if !s.movable {
        out.push(
            "the width of the overlap stays: bodies do not end at its borders, the mediator has a shape of its own, or the \
             fine model is given by a count"
                .into(),
        );
    }
    if s.movable && s.needed > 0.0 {
        out.push(format!(
            "the overlap is kept wider than {:.4e} m: a probe looks at '{}' there",
            s.needed, s.names[2]
        ));
    }
    if s.kind != OverlapKind::Slab {
        out.push(
            "errors are those of a wave along the normal of the overlap; corners and bends of its borders, for which the \
             weight stays as it is, are not in them, nor is the spreading of waves"
                .into(),
        );
    } else if s.across.is_some() {
        out.push(
            "errors are those of waves along the overlap; what happens across the body is not in them".into(),
        );
    }
    if s.particles {
        out.push(
            "a random packing differs from the material it stands for; that is not in the prediction".into(),
        );
    }
    if apply::needs_absorber(p) {
        out.push(format!(
            "{:.1e} of the signal's energy is above what the coarse model carries: the absorber takes it out",
            p.errors.above_cutoff
        ));
    }
    out
}
