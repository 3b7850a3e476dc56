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
use arlequin::core::Uniform;
use case::{Case, FINE_EVERYWHERE};
use measure::Waves;
use reflections::Reflections;
use serde::Serialize;
use std::time::Instant;

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
}

/// Couples the models of a scene by the default and by other methods, and measures them. Without a method:
/// that of the interface, or all if it is the default. `penalty` is the stiffness of the springs of `penalty`
/// over the stiffness of the particle that they hold \[–\].
///
/// # Errors
/// Scenes in which a comparison has no meaning: other than one interface, a shell, models that are not
/// linear, not of one section in line or too short; a penalty that is not positive.
pub fn compare(
    scene: &Scene,
    methods: &[Method],
    penalty: f64,
    announce: &mut dyn FnMut(&str, usize, usize),
) -> Result<Board> {
    if !(penalty > 0.0 && penalty.is_finite()) {
        let rule = "must be positive: the stiffness of the springs over that of a particle";
        return Err(crate::error::value("--penalty", penalty, rule));
    }
    let mut case = Case::new(scene.spec(), scene.folder(), announce)?;
    let default = method::couple(&mut case, Method::Arlequin, penalty)?;
    announce("fine everywhere", 0, 0);
    let mut reference = Reflections::free(case.assemble(&[(FINE_EVERYWHERE, Some([&Uniform(1.0); 2]))])?)?;
    let waves = Waves::new(&case, &*default)?;
    let (last, profile) = measure::row("fine everywhere", (0.0, &mut reference), &waves, None)?;
    let (mut rows, mut refused) = (Vec::new(), Vec::new());
    for m in chosen(scene, methods) {
        announce(m.name(), 0, 0);
        let begin = Instant::now();
        let measured = method::couple(&mut case, m, penalty).and_then(|mut coupling| {
            let setup = begin.elapsed().as_secs_f64();
            measure::row(m.name(), (setup, &mut *coupling), &waves, Some(&profile))
        });
        match measured {
            Ok((row, _)) => rows.push(row),
            Err(e) if e.is_input() && m != Method::Arlequin => {
                refused.push((m.name().to_owned(), e.to_string()));
            }
            Err(e) => return Err(e),
        }
    }
    rows.push(last);
    let [critical, cost] = [rows[0].critical, rows[0].cost];
    for r in &mut rows {
        r.critical /= critical;
        r.cost /= cost;
    }
    Ok(Board {
        scene: scene.source().path.display().to_string(),
        pulse: waves.down.half / case.spacing[0],
        packet: waves.packet.map(|wave| wave.length / case.spacing[0]),
        rows,
        refused,
    })
}

/// Methods of the rows, each once, the default first.
fn chosen(scene: &Scene, methods: &[Method]) -> Vec<Method> {
    let word = scene.spec().interface.values().map(|i| i.method);
    let word: Vec<_> = word.filter(|m| *m != Method::Arlequin).collect();
    let chosen = if methods.is_empty() { &word } else { methods };
    let is_chosen = |m: &Method| *m == Method::Arlequin || chosen.is_empty() || chosen.contains(m);
    Method::ALL.into_iter().filter(is_chosen).collect()
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
