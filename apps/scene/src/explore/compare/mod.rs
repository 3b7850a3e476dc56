//! The scoreboard: methods of the literature beside this one, on the models of one scene.
//!
//! Every method couples the same weighted stiffness and masses. Supports, loads and effects of the scene
//! take no part: the board measures the interface. Waves run along the axis of the overlap.

mod case;
mod measure;
mod method;
mod reflections;
mod sparse;
mod system;
mod tie;
mod union;

use crate::error::Result;
use crate::scene::Scene;
use crate::spec::Method;
use case::Case;
use measure::Waves;
use method::Coupling;
use serde::Serialize;
use std::time::Instant;

/// Options of a comparison.
#[derive(Debug, Clone)]
pub struct Options {
    /// Methods, in the order of the rows; the default comes first in any case. Empty: that of the
    /// interface, or all if it is the default.
    pub methods: Vec<Method>,
    /// Stiffness of the springs of `penalty` over the stiffness of the particle that they hold \[–\].
    pub penalty: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            methods: Vec::new(),
            penalty: 1.0,
        }
    }
}

/// Result of a comparison.
#[derive(Debug, Clone, Serialize)]
pub struct Board {
    /// Path of the scene.
    pub scene: String,
    /// Half width of the pulse, in coarse spacings \[–\].
    pub pulse: f64,
    /// Wavelength of the packet above the coarse cutoff, in coarse spacings \[–\]; none if the coarse model
    /// carries what the fine one can.
    pub packet: Option<f64>,
    /// Rows, the default first, the fine model everywhere last.
    pub rows: Vec<Row>,
    /// Methods that have no meaning in the scene, with the reason.
    pub refused: Vec<(String, String)>,
}

/// Figures of one method.
#[derive(Debug, Clone, Serialize)]
pub struct Row {
    /// Word of the method; `fine everywhere` for the reference.
    pub method: String,
    /// Energy of a pulse from the fine model that does not pass \[–\].
    pub down: f64,
    /// Energy of a pulse from the coarse model that comes back \[–\].
    pub up: f64,
    /// Energy of a packet above the coarse cutoff that is still in the fine model and the overlap \[–\].
    pub above: Option<f64>,
    /// Error of the pulse beyond the overlap against the fine model everywhere \[–\]; none for that model.
    pub pulse_error: Option<f64>,
    /// Largest deviation from uniform strain in the overlap, over strain times width \[–\]; none for a method
    /// without an equilibrium.
    pub patch: Option<f64>,
    /// Change of the momentum of a random state over the sum of its moduli \[–\].
    pub momentum: f64,
    /// Relative change of the energy of the pulse over ten passages \[–\].
    pub pulse_drift: f64,
    /// Relative change of the energy of a random state \[–\].
    pub drift: f64,
    /// Critical step of the finest model, over that of the default \[–\].
    pub critical: f64,
    /// Multiplications per simulated time, over those of the default \[–\].
    pub cost: f64,
    /// Wall time of the set-up of the coupling \[s\].
    pub setup: f64,
    /// Wall time of the steps per simulated time, over that of the default \[–\].
    pub time: f64,
}

/// Wall seconds of the set-up of a coupling, and the coupling.
type Built = (f64, Box<dyn Coupling>);

/// Couples the models of a scene by each method and measures them.
///
/// # Errors
/// Scenes in which a comparison has no meaning: other than one interface, a shell, models that are not
/// linear, not of one section in line or too short; a penalty that is not positive.
pub fn compare(
    scene: &Scene,
    options: &Options,
    announce: &mut dyn FnMut(&str, usize, usize),
) -> Result<Board> {
    let factor = options.penalty;
    if !(factor > 0.0 && factor.is_finite()) {
        let rule = "must be positive: the stiffness of the springs over that of a particle";
        return Err(crate::error::value("--penalty", factor, rule));
    }
    let mut case = Case::new(scene.spec(), scene.folder(), announce)?;
    let (setup, mut default) = built(&mut case, Method::Arlequin, options)?;
    let waves = Waves::new(&case, &*default)?;
    let mut reference = method::fine_everywhere(&mut case)?;
    announce("fine everywhere", 0, 0);
    let profile = measure::down(&mut *reference, &waves, None).profile;
    announce(Method::Arlequin.name(), 0, 0);
    let first = row(
        Method::Arlequin.name(),
        (setup, &mut *default),
        &waves,
        Some(&profile),
    )?;
    let mut rows = vec![first];
    let mut refused = Vec::new();
    let own: Vec<Method> = scene.spec().interface.values().map(|i| i.method).collect();
    let chosen: &[Method] = match (&*options.methods, &*own) {
        ([], [Method::Arlequin]) => &Method::ALL,
        ([], own) => own,
        (chosen, _) => chosen,
    };
    for m in chosen.iter().filter(|m| **m != Method::Arlequin) {
        announce(m.name(), 0, 0);
        let measured = built(&mut case, *m, options)
            .and_then(|(setup, mut coupling)| row(m.name(), (setup, &mut *coupling), &waves, Some(&profile)));
        match measured {
            Ok(row) => rows.push(row),
            Err(e) if e.is_input() => refused.push((m.name().to_owned(), e.to_string())),
            Err(e) => return Err(e),
        }
    }
    rows.push(row("fine everywhere", (0.0, &mut *reference), &waves, None)?);
    let [critical, cost, time] = [rows[0].critical, rows[0].cost, rows[0].time];
    for r in &mut rows {
        r.critical /= critical;
        r.cost /= cost;
        r.time /= time;
    }
    Ok(Board {
        scene: scene.source().path.display().to_string(),
        pulse: waves.half / case.spacing[0],
        packet: waves.wavelength.map(|l| l / case.spacing[0]),
        rows,
        refused,
    })
}

/// Couples the models by a method and takes the time.
fn built(case: &mut Case, m: Method, options: &Options) -> Result<Built> {
    let begin = Instant::now();
    let coupling = method::couple(case, m, options.penalty)?;
    Ok((begin.elapsed().as_secs_f64(), coupling))
}

/// Measures one method; ratios are not taken yet.
fn row(
    name: &str,
    (setup, m): (f64, &mut dyn Coupling),
    waves: &Waves,
    reference: Option<&measure::Profile>,
) -> Result<Row> {
    let down = measure::down(m, waves, reference);
    let up = measure::up(m, waves);
    let above = measure::above(m, waves);
    let noise = measure::noise(m, waves);
    let pace = m.pace();
    // After the runs: how often an alternation alternates is known by then.
    let cost = m.work() / pace.step;
    Ok(Row {
        method: name.to_owned(),
        down: down.reflected,
        pulse_error: down.error,
        pulse_drift: down.drift,
        patch: measure::patch(m, waves)?,
        momentum: noise.momentum,
        drift: noise.drift,
        critical: pace.critical,
        time: noise.seconds / pace.step,
        cost,
        setup,
        above,
        up,
    })
}

/// Returns the method with a word.
///
/// # Errors
/// An unknown word, with all that there are.
pub fn method(word: &str) -> Result<Method> {
    let known: Vec<String> = Method::ALL.iter().map(|m| m.name().to_owned()).collect();
    let found = Method::ALL.into_iter().find(|m| m.name() == word);
    found.ok_or_else(|| crate::error::unknown("--methods", word, "method", known.iter()))
}

#[cfg(test)]
mod tests;
