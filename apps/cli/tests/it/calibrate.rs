//! `arlequin calibrate`: results, refusals and messages.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use crate::common::{arlequin, number, scratch, succeed};
use serde_json::Value;

fn json(arguments: &[&str]) -> Value {
    serde_json::from_str(&succeed(arguments)).unwrap()
}

/// Returns the error text and the exit code of a command that fails.
fn failure(arguments: &[&str]) -> (String, Option<i32>) {
    let out = arlequin(arguments);
    (
        String::from_utf8_lossy(&out.stderr).into_owned(),
        out.status.code(),
    )
}

#[test]
fn bulk_of_silica() {
    let flags = [
        "calibrate",
        "--periodic",
        "--count",
        "600",
        "--protocol",
        "quench",
        "--seeds",
        "2",
    ];
    let report = json(&[&flags[..], &["--json"]].concat());
    let young = number(&report, "/young/mean");
    assert!((young - 78e9).abs() < 6e9, "{young:e}");
    assert!((number(&report, "/poisson/mean") - 0.175).abs() < 0.01);
    assert!(number(&report, "/anisotropy/mean") < 0.06);
    assert!((number(&report, "/packings/1/coordination_all") - 6.2).abs() < 0.01);
    assert!(report.pointer("/packings/1/seed").and_then(Value::as_u64) == Some(2));
    // One thread gives the same results, printed as a table.
    let table = succeed(&[&flags[..], &["--threads", "1"]].concat());
    assert!(table.contains(&format!("E          {young:.4e} Pa ±")), "{table}");
}

#[test]
fn beams_for_a_target() {
    let report = json(&[
        "calibrate",
        "--cylinder",
        "8e-3,1e-3",
        "--count",
        "1500",
        "--protocol",
        "quench",
        "--seeds",
        "1",
        "--target-young",
        "72.5e9",
        "--target-poisson",
        "0.17",
        "--json",
    ]);
    assert!((number(&report, "/target/reached/young/mean") / 72.5e9 - 1.0).abs() < 1e-4);
    assert!((number(&report, "/target/reached/poisson/mean") - 0.17).abs() < 2e-4);
    assert!((number(&report, "/target/beams/radius_ratio") - 0.71).abs() < 0.15);
    let (text, code) = failure(&[
        "calibrate",
        "--periodic",
        "--count",
        "500",
        "--protocol",
        "quench",
        "--seeds",
        "1",
        "--target-young",
        "72.5e9",
        "--target-poisson",
        "0.45",
    ]);
    assert!(
        code == Some(2) && text.contains("wanted Poisson's ratio 0.45: beams of 0.2 to 1.5 mean radii give"),
        "{text}"
    );
}

const SCENE: &str = r#"
[model.bar]
kind = "dem"
shape.cylinder = { from = [1.0, 0.0, 0.0], length = 8e-3, radius = 1e-3 }
material = { young = 72.5e9, poisson = 0.17, density = 2200.0 }
dem = { count = 1500, protocol = "quench" }
[model.line]
kind = "chain"
shape.bar = { from = 0.0, to = 1.0, section = 1.0 }
divisions = [4]
material = { young = 1.0, density = 1.0 }
[time]
steps = 1
"#;

#[test]
fn a_scene_gives_what_its_flags_would() {
    let folder = scratch("calibrate-scene");
    let scene = folder.join("bar.toml");
    std::fs::write(&scene, SCENE).unwrap();
    let scene = crate::common::text(&scene);
    let report = json(&["calibrate", scene, "--young", "265e9", "--seeds", "1", "--json"]);
    let flags = [
        "--count",
        "1500",
        "--protocol",
        "quench",
        "--seeds",
        "1",
        "--json",
    ];
    let twin = json(&[&["calibrate", "--cylinder", "8e-3,1e-3"], &flags[..]].concat());
    assert_eq!(report.pointer("/packings"), twin.pointer("/packings"));
    let (text, code) = failure(&["calibrate", scene, "--model", "line"]);
    assert!(
        code == Some(2) && text.contains("only models of kind \"dem\" have beams"),
        "{text}"
    );
    let (text, _) = failure(&["calibrate", scene, "--model", "bra"]);
    assert!(text.contains("known: bar, line"), "{text}");
    let line = "model.bar.shape={ bar = { from = 0.0, to = 1.0, section = 1.0 } }";
    let (text, _) = failure(&["calibrate", scene, "--set", line]);
    assert!(
        text.contains("a tension test needs a straight bar along x"),
        "{text}"
    );
}

#[test]
fn an_axial_wave_is_refused() {
    // Five hundred spheres in a bar as long as it is wide: the middle is far stiffer than the ends.
    let out = arlequin(&[
        "calibrate",
        "--cylinder",
        "2e-3,1e-3",
        "--count",
        "500",
        "--seeds",
        "2",
        "--json",
    ]);
    assert_eq!(out.status.code(), Some(1));
    let report: Value = serde_json::from_slice(&out.stdout).unwrap();
    let reason = report.pointer("/refused").and_then(Value::as_str).unwrap();
    assert!(
        reason.contains("the packing has an axial density wave"),
        "{reason}"
    );
    assert!(number(&report, "/young_gauge/mean") / number(&report, "/young/mean") > 1.03);
}

#[test]
fn bad_input_is_named() {
    let cases: [(&[&str], &str); 7] = [
        (
            &[],
            "nothing to test; give a scene, --cylinder, --box or --periodic",
        ),
        (&["--cylinder", "1e-3"], "--cylinder = 1 numbers: needs 2 numbers"),
        (
            &["--box", "1,-1,1", "--count", "9"],
            "--box = -1: must be a positive number",
        ),
        (&["--periodic", "--seeds", "0"], "--seeds = 0: must be 1 to 1000"),
        (
            &["--periodic", "--poisson", "0.6"],
            "--poisson = 0.6: must lie above -1",
        ),
        (&["--cylinder", "2e-3,1e-3"], "spacing is missing"),
        (
            &[
                "--cylinder",
                "2e-3,1e-3",
                "--spacing",
                "4e-4",
                "--protocol",
                "quench",
                "--seeds",
                "1",
            ],
            "the bar is",
        ),
    ];
    for (flags, wanted) in cases {
        let (text, code) = failure(&[&["calibrate"], flags].concat());
        assert!(code == Some(2) && text.contains(wanted), "{flags:?}: {text}");
    }
}
