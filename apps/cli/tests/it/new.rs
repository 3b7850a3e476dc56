//! `arlequin new`: every template runs as written, and no file is replaced.

use crate::common::{arlequin, number, schemas::verdict, scratch, succeed, summary, text};
use std::path::{Path, PathBuf};

/// Writes a template into its own folder, runs it and returns the folder of the results.
fn run(name: &str) -> PathBuf {
    let place = scratch(&format!("new-{name}")).join("case");
    succeed(&["new", "--template", name, text(&place)]);
    let scene = place.join("scene.toml");
    let words = std::fs::read_to_string(&scene).expect("scene");
    assert_eq!(verdict("scene", &words), Some(true), "{name}");
    let comments = words.lines().filter(|l| l.starts_with('#')).count();
    assert!(comments >= 6, "{name}: {comments} lines of comment");
    let out = place.join("results");
    succeed(&["run", text(&scene), "--out", text(&out)]);
    assert_eq!(summary(&out)["status"], "complete");
    // Scenes at rest have no drift.
    if name != "plate" {
        assert!(number(&summary(&out), "/energy/h_drift_max") < 1e-9);
    }
    out
}

#[test]
fn the_beam_conserves_energy_and_moves() {
    let s = summary(&run("beam"));
    // The blow moves the end of a bar by ∫F dt/(ρ c A), with a mean of half the peak over 8 µs, until the
    // reflection from the clamp arrives.
    let bar = 1000.0 * 4e-6 / ((72.5e9_f64 * 2200.0).sqrt() * 1e-4);
    let largest = number(&s, "/probes/struck-end/min").abs();
    assert!((0.9..1.2).contains(&(largest / bar)), "{largest} {bar}");
}

#[test]
fn the_notched_beam_cracks() {
    let out = run("bend");
    assert!(broken(&out) > 20.0);
    let curve = std::fs::read_to_string(out.join("curve-load.csv")).expect("the load curve");
    let loads = curve
        .lines()
        .skip(1)
        .filter_map(|l| l.rsplit(',').next()?.parse::<f64>().ok());
    let peak = loads.fold(0.0, f64::max);
    assert!((30.0..60.0).contains(&peak), "{peak} N");
}

#[test]
fn the_ball_breaks_bonds() {
    assert!(broken(&run("impact")) > 20.0);
}

#[test]
fn the_plate_has_the_stress_of_howland_at_its_hole() {
    let s = summary(&run("plate"));
    let last = |probe: &str| number(&s, &format!("/probes/{probe}/last"));
    // Howland's solution: 3.14 for a width of five diameters.
    assert!(
        (last("hole") / 100e6 / (2.512 / 0.8) - 1.0).abs() < 0.01,
        "{}",
        last("hole")
    );
    assert!((last("held") / -2500.0 - 1.0).abs() < 1e-10, "{}", last("held"));
    assert!((last("far") / 100e6 - 1.0).abs() < 1e-3, "{}", last("far"));
    // The equilibrium is the work of this run, so that its time belongs to the steps.
    let seconds = |key: &str| s["wall_seconds"][key].as_f64().expect("seconds");
    let [total, setup, stepping] = ["total", "setup", "stepping"].map(seconds);
    assert!(stepping > 0.0, "{stepping}");
    assert!(total >= setup + stepping, "{total} s, {setup} s + {stepping} s");
}

fn broken(out: &Path) -> f64 {
    let s = summary(out);
    let effects = s["effect_ledger"].as_array().expect("effects");
    effects
        .iter()
        .filter_map(|e| e["facts"]["broken bonds"].as_f64())
        .sum()
}

#[test]
fn nothing_is_replaced_and_a_file_may_be_named() {
    let folder = scratch("new-places");
    let scene = folder.join("mine.toml");
    succeed(&["new", text(&scene)]);
    let before = std::fs::read(&scene).expect("scene");
    let repeated = arlequin(&["new", "--template", "bend", text(&scene)]);
    assert_eq!(repeated.status.code(), Some(2));
    let error = String::from_utf8_lossy(&repeated.stderr).into_owned();
    assert!(
        error.contains("is there already") && error.contains("mine.toml"),
        "{error}"
    );
    assert_eq!(std::fs::read(&scene).expect("scene"), before);
    // An existing mesh file also keeps the scene beside it from being written.
    std::fs::write(folder.join("plate.msh"), "mine").expect("writes");
    assert_eq!(
        arlequin(&["new", "--template", "plate", text(&folder)])
            .status
            .code(),
        Some(2)
    );
    assert!(!folder.join("scene.toml").exists());
}
