//! Proposes settings of a coupling for a given error or time.
//!
//! Errors come from the dispersion of the coarse lattice and the harmonic analysis of the overlap. Times come
//! from trial steps on this machine, which are repeated with each proposal until prediction and measurement
//! agree.

mod apply;
mod around;
mod choose;
mod measure;
mod mesher;
mod path;
mod predict;
mod scenario;
mod settle;

use crate::error::{Result, key};
use crate::scene::Scene;
use crate::setup::LoweredScene;
use apply::Change;
pub use choose::Goal;
use choose::{CostModel, Prospect, Search};
use measure::measure;
pub use predict::Errors;
use scenario::{OverlapKind, Scenario};
use serde::Serialize;
use settle::{Settled, settle};
use std::path::Path;

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
pub fn readable(scene: &LoweredScene) -> Result<Scenario> {
    scene.refuse_following("suggest")?;
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
    let (m, end, s, _) = measure(scene, &[])?;
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
    let (first, end, s, warnings) = measure(scene, &[])?;
    let spectrum = scenario::spectrum(scene.spec(), &s, end, frequency)?;
    let search = Search::new(&s, &spectrum, end)?;
    let fraction = s
        .fraction
        .unwrap_or(first.dt / first.critical[0].min(first.critical[1]));
    let as_given = CostModel::new(search.given, first, &s, fraction);
    let current = search.predict(&search.given, &as_given, first.dt);
    // The scene as given keeps its step; proposals choose theirs.
    let costs = CostModel::new(search.given, first, &s, FRACTION);
    let found = settle(scene, &search, goal, costs, &warnings);
    let better = match found {
        Ok(found) if found.improves(&current, goal) => Some(found),
        Ok(_) => None,
        Err(_) if goal.is_met(&current) => None,
        Err(e) => return Err(e),
    };
    let given = || forecast(&search, &s, &current, fraction, s.absorber);
    let mut notes = Vec::new();
    if better.is_none() {
        notes.push(match goal {
            Goal::Error(_) => {
                "the scene as given stays: it meets the goal, and nothing faster was found".to_owned()
            }
            Goal::Time(_) => {
                "the scene as given stays: it meets the goal, and nothing more accurate was found".to_owned()
            }
        });
    }
    let proposed = better.as_ref().map_or_else(given, |b| {
        let absorber =
            s.absorber || (apply::needs_absorber(&b.prospect) && apply::absorber_works(&s, &b.prospect));
        forecast(&search, &s, &b.prospect, FRACTION, absorber)
    });
    let chosen = better.as_ref().map_or(current, |b| b.prospect);
    notes.extend(remarks(&s, &chosen, better.as_ref()));
    let changes = better.map_or_else(Vec::new, |b| b.changes);
    Ok(Proposal {
        scene: scene.source().path.display().to_string(),
        goal: match goal {
            Goal::Error(e) => format!("least time within an error of {e}"),
            Goal::Time(t) => format!("least error within {t} s"),
        },
        signal: spectrum.source.clone(),
        given: given(),
        proposed,
        set: changes.iter().map(Change::assignment).collect(),
        notes,
        changes,
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

/// Returns notes on a prospect; `new` is `None` if it is the scene as given.
fn remarks(s: &Scenario, p: &Prospect, new: Option<&Settled>) -> Vec<String> {
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
        let energy = format!(
            "{:.1e} of the signal's energy is above what the coarse model carries",
            p.errors.above_cutoff
        );
        let [width, ratio] = apply::proportions(s, p);
        out.push(if s.absorber || (new.is_some() && apply::absorber_works(s, p)) {
            format!("{energy}: the absorber takes it out")
        } else {
            format!(
                "{energy}, and comes back from the overlap: an absorber takes it out of an overlap of 4 coarse elements or more \
                 with 4 fine spacings in each (here {width:.1} and {ratio:.1})"
            )
        });
    }
    let warn = |w: &String| format!("check warns of the proposal, and did not of the scene as given: {w}");
    out.extend(new.into_iter().flat_map(|n| &n.warnings).map(warn));
    out
}
