//! `time.precision = "single"`: the same scenes in 32-bit numbers.

mod common;

use common::{arlequin, number, scene, scratch, succeed, summary, text};
use std::path::Path;

fn run(name: &str, out: &Path, set: &[&str]) {
    let path = scene(name);
    let mut arguments = vec!["run", text(&path), "--out", text(out)];
    set.iter().for_each(|s| arguments.extend(["--set", s]));
    succeed(&arguments);
}

/// Values of a probe over time.
fn probe(out: &Path, column: usize) -> Vec<f64> {
    let table = std::fs::read_to_string(out.join("probes.csv")).expect("probes");
    let value = |l: &str| {
        l.split(',')
            .nth(column)
            .and_then(|c| c.parse().ok())
            .expect("number")
    };
    table.lines().skip(1).map(value).collect()
}

/// Largest difference of two signals relative to the largest value of the first.
fn apart(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    let top = a.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    a.iter().zip(b).fold(0.0_f64, |m, (x, y)| m.max((x - y).abs())) / top
}

const SINGLE: &str = "time.precision=single";

#[test]
fn scenes_of_every_linear_kind_come_out_the_same_to_five_digits() {
    for (name, extra) in [
        ("quickstart.toml", &["time.end=1e-5"][..]),
        ("bar-1d.toml", &[]),
        ("beam-cnem.toml", &["time.end=2e-6"]),
        ("dem-fem-beam.toml", &["time.end=2e-6"]),
    ] {
        let folder = scratch(&format!("single-{name}"));
        let [wide, narrow] = ["double", "single"].map(|n| folder.join(n));
        run(name, &wide, extra);
        run(name, &narrow, &[extra, &[SINGLE]].concat());
        let s = summary(&narrow);
        assert_eq!(s["precision"], "single");
        assert_eq!(summary(&wide)["precision"], "double");
        let (a, b) = (probe(&wide, 1), probe(&narrow, 1));
        let d = apart(&a, &b);
        assert!(d > 0.0 && d < 1e-4, "{name}: {d:e}");
        let drift = number(&s, "/energy/h_drift_max");
        assert!(drift > 0.0 && drift < 1e-4, "{name}: drift {drift:e}");
    }
}

#[test]
fn a_single_run_resumes_with_the_same_bits() {
    let folder = scratch("single-resume");
    let (whole, cut) = (folder.join("whole"), folder.join("cut"));
    let common = [SINGLE, "output.plots=false"];
    run("bar-1d.toml", &whole, &common);
    let path = scene("bar-1d.toml");
    let mut arguments = vec!["run", text(&path), "--out", text(&cut)];
    let kept = [&common[..], &["output.checkpoint_every=1"]].concat();
    kept.iter().for_each(|s| arguments.extend(["--set", s]));
    let mut child = common::command(&arguments)
        .stderr(std::process::Stdio::null())
        .stdout(std::process::Stdio::null())
        .spawn()
        .expect("starts");
    // Wherever it is by the time its first checkpoint stands.
    let partial = folder.join("cut.unfinished");
    for _ in 0..2000 {
        if cut.exists() || partial.join("checkpoint.bin").exists() {
            break;
        }
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    let _ = child.kill();
    child.wait().expect("ends");
    if !cut.join("summary.json").exists() {
        succeed(&["resume", text(&cut)]);
    }
    for file in ["probes.csv", "energy.csv"] {
        let read = |d: &Path| std::fs::read(d.join(file)).expect("table");
        assert!(read(&whole) == read(&cut), "{file}");
    }
}

#[test]
fn what_has_no_single_form_is_named() {
    for (name, words) in [
        (
            "notched-bar.toml",
            [
                "time.precision",
                "cannot step in 32-bit numbers",
                "double precision",
            ],
        ),
        (
            "waking-bar.toml",
            ["time.precision", "double precision", "[wake]"],
        ),
    ] {
        let path = scene(name);
        let out = arlequin(&["check", text(&path), "--set", SINGLE]);
        let error = String::from_utf8_lossy(&out.stderr);
        assert_eq!(out.status.code(), Some(2), "{error}");
        for word in words {
            assert!(error.contains(word), "{name}: {error}");
        }
    }
}
