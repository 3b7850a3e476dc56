//! How the time of a set-up grows with the number of unknowns, and into which phases it goes.
//!
//! Two blocks of 30 × 10 × 10 mm that share a third of their length, a mediator of twice the coarse spacing
//! between them; the kinds of the coarse and of the fine model and the unknowns of a side are chosen:
//!
//! ```text
//! cargo bench -p arlequin-scene --bench setup -- fem-fem 1e4 1e5 1e6
//! cargo bench -p arlequin-scene --bench setup -- cnem-cnem 1e4
//! cargo bench -p arlequin-scene --bench setup -- fem-dem 1e4 1e5
//! ```
//!
//! Packings come from the cache where they were made before: `ARLEQUIN_CACHE=FOLDER` names an empty one.
//! Every line is one run: other work on the machine adds to it.
#![allow(clippy::print_stdout, reason = "a benchmark shows its figures")]

use arlequin_scene::{Result, Scene};
use std::time::Instant;

/// Edge of the section \[m\]; the blocks are three times as long.
const EDGE: f64 = 10e-3;

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args()
        .skip(1)
        .filter(|a| !a.starts_with("--"))
        .collect();
    let mut kinds = ["fem", "fem"];
    for word in &arguments {
        match (word.split_once('-'), word.parse::<f64>()) {
            (_, Ok(unknowns)) => measure(kinds, unknowns)?,
            (Some((coarse, fine)), _) => kinds = [coarse, fine],
            _ => println!("'{word}' is neither a pair of models, such as cnem-fem, nor a number of unknowns"),
        }
    }
    Ok(())
}

fn measure(kinds: [&str; 2], unknowns: f64) -> Result<()> {
    let scene = Scene::from_text(text(kinds, unknowns))?;
    let begin = Instant::now();
    let prepared = scene.prepare_with(&mut |_, _, _| ())?;
    let seconds = begin.elapsed().as_secs_f64();
    let plan = prepared.coupled().plan();
    let all: usize = plan.models.iter().map(|m| m.3).sum();
    println!(
        "{} | {}: {all} unknowns, {seconds:.2} s, {:.1} µs per unknown, {} threads",
        kinds[0],
        kinds[1],
        1e6 * seconds / all as f64,
        rayon::current_num_threads()
    );
    for p in prepared.preview().setup_phases {
        if p.seconds > 0.02 * seconds {
            println!("    {:<44} {:9.2} s", p.phase, p.seconds);
        }
    }
    Ok(())
}

/// The scene; the spacings differ a little, so that no node of one model lies on a node of the other.
fn text(kinds: [&str; 2], unknowns: f64) -> String {
    let spacing = |kind: &str| {
        let volume = 3.0 * EDGE.powi(3);
        match kind {
            // Six unknowns a sphere, at a volume fraction of 0.62.
            "dem" => (volume * 0.62 / (unknowns / 6.0) * 6.0 / std::f64::consts::PI).cbrt(),
            _ => (volume / (unknowns / 3.0)).cbrt(),
        }
    };
    let model = |name: &str, kind: &str, role: &str, from: f64, spacing: f64| {
        let beam = if kind == "dem" { "dem.young = 265e9\n" } else { "" };
        let to = from + 3.0 * EDGE;
        format!(
            "[model.{name}]\nkind = \"{kind}\"\nrole = \"{role}\"\nspacing = {spacing:e}\n\
             shape.box = {{ low = [{from:e}, 0.0, 0.0], high = [{to:e}, {EDGE:e}, {EDGE:e}] }}\n\
             material = {{ young = 72.5e9, poisson = 0.17, density = 2200.0 }}\n{beam}"
        )
    };
    let h = spacing(kinds[0]);
    let junction = match kinds {
        [_, "dem"] | ["dem", _] => format!("junction = {{ kind = \"h1-gradient\", length = {h:e} }}\n"),
        _ => String::new(),
    };
    [
        model("left", kinds[0], "coarse", 0.0, h),
        model("right", kinds[1], "fine", 2.0 * EDGE, 0.97 * spacing(kinds[1])),
        format!(
            "[interface.middle]\ncoarse = \"left\"\nfine = \"right\"\nweight = {{ profile = \"cubic\" }}\n\
             overlap.slab = {{ coarse = [{:e}, 0.0, 0.0], fine = [{:e}, 0.0, 0.0] }}\n\
             mediator = {{ spacing = {:e} }}\n{junction}",
            2.0 * EDGE,
            3.0 * EDGE,
            2.0 * h
        ),
        "[time]\nsteps = 1\n".to_owned(),
    ]
    .concat()
}
