//! Measures again the figures that the section "Four scenes" of docs/effects.md states.

use crate::common::{number, scene, scratch, succeed, summary, text};
use serde_json::Value;
use std::path::{Path, PathBuf};

fn run(name: &str, out: &Path, sets: &[&str]) -> (PathBuf, Value) {
    let mut arguments = vec!["run", "--set", "output.plots=false"];
    sets.iter().for_each(|s| arguments.extend(["--set", s]));
    let scene = scene(&format!("{name}.toml"));
    let folder = out.join(format!("{name}-{}", sets.len()));
    succeed(&[&arguments[..], &[text(&scene), "--out", text(&folder)]].concat());
    let results = summary(&folder);
    (folder, results)
}

/// Returns the page with all white space reduced to single blanks.
fn page() -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/effects.md");
    let page_text = std::fs::read_to_string(path).expect("the page");
    let from = page_text.split("## Four scenes").nth(1).expect("the section");
    from.split_whitespace().collect::<Vec<_>>().join(" ")
}

fn assert_page_says(page: &str, words: &str) {
    assert!(page.contains(words), "docs/effects.md should say '{words}'");
}

/// Returns the first column of a table whose head contains a word.
fn column(folder: &Path, table: &str, head: &str) -> Vec<f64> {
    let table_text = std::fs::read_to_string(folder.join(table)).expect("a table");
    let mut lines = table_text.lines();
    let heads = lines.next().expect("heads").split(',');
    let k = heads.clone().position(|h| h.contains(head)).expect(head);
    let cell = |l: &str| l.split(',').nth(k).and_then(|c| c.parse().ok());
    lines.filter_map(cell).collect()
}

fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |m, v| v.abs().max(m))
}

/// Returns a figure of an effect on one model or between two.
fn fact(s: &Value, name: &str, key: &str) -> f64 {
    let effects = s["effect_ledger"].as_array().expect("effects");
    let effect = effects.iter().find(|e| e["name"] == name);
    let effect = effect.unwrap_or_else(|| panic!("no {name}"));
    let value = effect["facts"][key].as_f64().or_else(|| effect[key].as_f64());
    value.unwrap_or_else(|| panic!("no {key} of {name}"))
}

fn drift(s: &Value) -> f64 {
    number(s, "/energy/h_drift_max").abs()
}

#[test]
fn notched_bar() {
    let (folder, s) = run("notched-bar", &scratch("four-bar"), &[]);
    let mut times = column(&folder, "fracture-bar.csv", "time");
    times.sort_unstable_by(f64::total_cmp);
    let late = times[9 * times.len() / 10];
    assert_page_says(&page(), "`notched-bar.toml`, 4 946 spheres");
    assert!((number(&s, "/models/0/nodes") - 4946.0).abs() < 0.5);
    let words = format!(
        "of the {} bonds that break, nine tenths do so from {:.2} to {:.2} microseconds",
        times.len(),
        1e6 * times[0],
        1e6 * late
    );
    assert_page_says(&page(), &words);
    assert!(drift(&s) < 2e-14, "{:e}", drift(&s));
}

#[test]
fn ball_on_silica() {
    let out = scratch("four-ball");
    let (folder, s) = run("ball-impact", &out, &[]);
    let inside = column(&folder, "fracture-grains.csv", "in an overlap");
    let times = column(&folder, "fracture-grains.csv", "time");
    let times_inside = times.iter().zip(&inside).filter(|(_, i)| **i > 0.0);
    let first = times_inside
        .clone()
        .map(|(t, _)| *t)
        .fold(f64::INFINITY, f64::min);
    let words = format!(
        "{} bonds break, {} of them in the overlap, the first of these after {:.2} microseconds",
        times.len(),
        times_inside.count(),
        1e6 * first
    );
    assert_page_says(&page(), &words);
    let spin = ["x", "y", "z"].map(|c| fact(&s, "grains/ball", &format!("spin {c} [rad/s]")));
    let spin = spin.iter().map(|x| x * x).sum::<f64>().sqrt();
    assert_page_says(&page(), &format!("the ball leaves with {spin:.0} rad/s"));
    assert!(drift(&s) < 2e-14, "{:e}", drift(&s));
}

#[test]
fn ball_of_spheres() {
    let (_, s) = run("two-bodies", &scratch("four-two"), &[]);
    let lost = |name: &str| 1e3 * fact(&s, name, "dissipated");
    let words = format!(
        "Of the {:.1} mJ it brings, {:.1} go into contacts of its own fragments, {:.1} into those of the block, {:.1} into the contact \
         between the two and {:.1} into {} broken bonds of the ball and {} of the block; its middle still comes down at {:.1} m/s",
        1e3 * number(&s, "/energy/initial"),
        lost("ball/contact"),
        lost("grains/contact"),
        lost("contact ball-grains"),
        lost("ball/fracture") + lost("grains/fracture"),
        fact(&s, "ball/fracture", "broken bonds"),
        fact(&s, "grains/fracture", "broken bonds"),
        -number(&s, "/probes/ball/last"),
    );
    assert_page_says(&page(), &words);
    assert_page_says(&page(), &format!("(drift of H {:.0e})", drift(&s)));
}

#[test]
fn brazilian_disc() {
    let out = scratch("four-disc");
    let force = |folder: &Path, platen: &str| {
        largest(&column(
            folder,
            "effects.csv",
            &format!("disc/{platen} force on it z"),
        ))
    };
    let (folder, s) = run("brazilian-disc", &out, &[]);
    let above = force(&folder, "top");
    // D = 8 mm, t = 2 mm.
    let area = 0.5 * std::f64::consts::PI * 8e-3 * 2e-3;
    let (bar, _) = run("direct-tension", &out, &[]);
    let tension = largest(&column(&bar, "probes.csv", "load")) / 9e-6;
    let words = format!(
        "the peak above is {above:.0} N, below {:.0} N, and {above:.0} N means an indirect strength `2 P/(π D t)` of {:.1} MPa",
        force(&folder, "bottom"),
        1e-6 * above / area
    );
    assert_page_says(&page(), &words);
    let words = format!(
        "breaks at {:.1} MPa, so theory has the disc break at 1 {:03.0} N; it does {:.0} % below",
        1e-6 * tension,
        tension * area - 1000.0,
        100.0 * (1.0 - above / (tension * area))
    );
    assert_page_says(&page(), &words);
    assert!(drift(&s) < 2e-14, "{:e}", drift(&s));
    let (folder, turned) = run("brazilian-disc", &out, &["model.disc.dem.finite_rotations=true"]);
    let words = format!(
        "the platens peak at {:.0} and {:.0} N, the drift of `H` is {:.0e} in place of {:.0e}",
        force(&folder, "top"),
        force(&folder, "bottom"),
        drift(&turned),
        drift(&s)
    );
    assert_page_says(&page(), &words);
}
