//! `arlequin suggest`: options.

use crate::error::{Result, key, value};
use crate::report;
use arlequin_scene::Scene;
use arlequin_scene::suggest::{Goal, suggest as propose};
use std::path::PathBuf;

/// Goal of a proposal.
#[derive(Debug, clap::Args)]
pub(crate) struct Wish {
    /// Largest relative error against the fine model everywhere, such as 2%
    #[arg(long, value_name = "SHARE", conflicts_with = "time")]
    error: Option<String>,
    /// Longest time of set-up and steps, such as 30s or 5min
    #[arg(long, value_name = "TIME")]
    time: Option<String>,
    /// Highest frequency of interest [Hz], if the loads do not determine it
    #[arg(long, value_name = "HZ")]
    frequency: Option<f64>,
    /// Write the scene with the proposed values
    #[arg(long, value_name = "OUT.toml")]
    apply: Option<PathBuf>,
}

/// Proposes settings, and writes a scene with them if `--apply` is given.
pub(crate) fn suggest(scene: &Scene, wish: &Wish, json: bool) -> Result<()> {
    let proposal = propose(scene, goal(wish)?, wish.frequency)?;
    if let Some(out) = &wish.apply {
        proposal.write(scene, out)?;
    }
    report::result(&proposal, json, |p| report::proposal(p, wish.apply.as_deref()))
}

/// Parses a positive number with one of several units.
fn number(name: &str, text: &str, units: &[(&str, f64)], rule: &str) -> Result<f64> {
    let text = text.trim();
    let (digits, factor) = units
        .iter()
        .find_map(|(u, f)| Some((text.strip_suffix(u)?, *f)))
        .unwrap_or((text, 1.0));
    match digits.trim().parse::<f64>() {
        Ok(x) if x > 0.0 && x.is_finite() => Ok(x * factor),
        _ => Err(value(name, text, rule)),
    }
}

fn goal(wish: &Wish) -> Result<Goal> {
    match (&wish.error, &wish.time) {
        (Some(e), None) => {
            let rule = "must be a positive share, such as 2% or 0.02";
            number("--error", e, &[("%", 0.01)], rule).map(Goal::Error)
        }
        (None, Some(t)) => {
            let rule = "must be a positive time, such as 30s, 500ms or 5min";
            let units = [("min", 60.0), ("ms", 1e-3), ("s", 1.0)];
            number("--time", t, &units, rule).map(Goal::Time)
        }
        _ => Err(key("suggest", "needs --error or --time, such as --error 2%")),
    }
}
