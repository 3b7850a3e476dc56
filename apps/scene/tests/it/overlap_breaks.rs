//! Number of bonds that break in an overlap against a run of particles alone, over seeds: the figures of
//! docs/hard-cases.md, docs/effects.md and decision 22. Takes minutes:
//!
//! `cargo test --release -p arlequin-scene --test it -- overlap_breaks --ignored --nocapture`
#![allow(clippy::print_stdout, reason = "it prints a table")]

use arlequin::dem_beam::fracture::locked;
use arlequin_scene::{Scene, Silent};
use std::path::Path;

/// Number of seeds, each for a packing and its strengths.
const SEEDS: u64 = 8;

/// Returns the scene with another mass of the ball \[kg\] and another seed.
fn seeded(mass: f64, seed: u64) -> Scene {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/scenes/ball-on-block.toml");
    let text = std::fs::read_to_string(path).expect("a shipped scene");
    let text = text
        .replace("mass = 2.6e-4", &format!("mass = {mass:e}"))
        .replace("strength = 500e6,", &format!("strength = 500e6, seed = {seed},"));
    let text = text.replace(
        "kind = \"dem\"\n",
        &format!("kind = \"dem\"\ndem.seed = {seed}\n"),
    );
    assert_eq!(text.matches("seed = ").count(), 2);
    Scene::from_text(&text).expect("a scene")
}

/// Like [`seeded`], with particles in place of the elements.
fn alone(mass: f64, seed: u64) -> Scene {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/scenes/ball-on-block.toml");
    let text = std::fs::read_to_string(path).expect("a shipped scene");
    let (head, tail) = (text.find("[model.block]"), text.find("[[support]]"));
    let text = [
        &text[..head.expect("elements")],
        &text[tail.expect("a support")..],
    ]
    .concat();
    let text = text
        .replace("role = \"fine\"\n", &format!("dem.seed = {seed}\n"))
        .replace("low = [-4e-3, -4e-3, -4e-3]", "low = [-4e-3, -4e-3, -8e-3]")
        .replace("model = \"block\"", "model = \"grains\"")
        .replace("mass = 2.6e-4", &format!("mass = {mass:e}"))
        .replace("strength = 500e6,", &format!("strength = 500e6, seed = {seed},"));
    Scene::from_text(&text).expect("a scene")
}

/// Returns the number of broken bonds in the place of the shipped scene's overlap, 2 to 4 mm below the
/// surface.
fn broken(scene: &Scene) -> f64 {
    let results = scene.prepare().expect("built").run(&mut Silent).expect("runs");
    let logs = results.breaks.iter().flatten();
    let count = |z: f64| (-4e-3..=-2e-3).contains(&z);
    logs.map(|log| locked(log).events().iter().filter(|e| count(e.place.z)).count() as f64)
        .sum()
}

/// Returns mean, standard deviation of a run, and standard error of the mean.
fn statistics(counts: &[f64]) -> [f64; 3] {
    let n = counts.len() as f64;
    let mean = counts.iter().sum::<f64>() / n;
    let deviation = (counts.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
    [mean, deviation, deviation / n.sqrt()]
}

#[test]
#[ignore = "minutes: a measurement over seeds"]
fn broken_bonds_in_the_overlap_against_particles_alone() {
    for mass in [2.6e-4, 5.2e-4] {
        let runs = |make: fn(f64, u64) -> Scene| -> Vec<f64> {
            (1..=SEEDS).map(|seed| broken(&make(mass, seed))).collect()
        };
        let [coupled, reference] = [runs(seeded), runs(alone)];
        let [with_overlap, without_overlap] = [statistics(&coupled), statistics(&reference)];
        let error = with_overlap[2].hypot(without_overlap[2]);
        println!(
            "ball of {mass:e} kg, {SEEDS} seeds: coupled {coupled:?}\n  alone {reference:?}\n  {:.0} (deviation {:.0}) against {:.0} \
             (deviation {:.0}): {:+.0} % with a standard error of {:.0} %, {:.1} standard errors",
            with_overlap[0],
            with_overlap[1],
            without_overlap[0],
            without_overlap[1],
            100.0 * (with_overlap[0] / without_overlap[0] - 1.0),
            100.0 * error / without_overlap[0],
            (with_overlap[0] - without_overlap[0]) / error
        );
        // The documents claim the same order of magnitude, no more.
        let ratio = with_overlap[0] / without_overlap[0];
        assert!((0.5..2.0).contains(&ratio), "{ratio}");
    }
}
