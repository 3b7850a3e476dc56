//! `arlequin calibrate`: results, refusals and messages.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use crate::common::{arlequin, number, scene, scratch, succeed, text};
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
    let scene = text(&scene);
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
    assert!(text.contains("spheres fill a box, a cylinder, a ball"), "{text}");
}

/// Returns the notes as one text, and the report of a calibration with one seed.
fn calibrated(arguments: &[&str]) -> (String, Value) {
    let few = ["--seeds", "1", "--json"];
    let report = json(&[&["calibrate"], arguments, &few].concat());
    let notes = report["notes"].as_array().unwrap().iter();
    let notes: Vec<&str> = notes.map(|n| n.as_str().unwrap()).collect();
    (notes.join("; "), report)
}

/// A zone, and a block that is as wide as it is long, get a bar of their own spheres and beams.
#[test]
fn a_shape_that_is_no_bar_is_replaced_by_one() {
    let zone = scene("struck-block.toml");
    let (notes, report) = calibrated(&[text(&zone), "--count", "2500"]);
    assert!(
        notes.contains("zone.struck.shape (a part of the body) is no bar")
            && notes.contains("the packing of a zone is then fitted"),
        "{notes}"
    );
    let young = number(&report, "/young/mean");
    assert!(
        (young / 72.5e9 - 1.0).abs() < 0.15,
        "the body's modulus, not {young:e}"
    );
    assert!(
        (number(&report, "/beams/radius_ratio") - 0.71).abs() > 1e-3,
        "fitted beams"
    );
    let fitted = report["beams"].clone();
    // The number changes the bar and not the spheres: 0.5 mm, 2500 of them.
    let sample = report["sample"].as_str().unwrap();
    assert!(sample.contains("box along x, length 1.37e-2 m"), "{sample}");
    let impact = scene("ball-impact.toml");
    let asked = [
        "--count",
        "1500",
        "--protocol",
        "quench",
        "--strength",
        "--criterion",
        "rankine",
    ];
    let (notes, report) = calibrated(&[&[text(&impact)], &asked[..]].concat());
    assert!(notes.starts_with("model.grains.shape (box) is no bar"), "{notes}");
    let ratio = number(&report, "/strength/rows/0/ratio/mean");
    assert!((8.0..15.0).contains(&ratio), "beams over bar: {ratio}");
    // Another shape may be chosen, with the spheres and the beams of the scene.
    let chosen = [
        "calibrate",
        text(&zone),
        "--box",
        "16e-3,5e-3,5e-3",
        "--seeds",
        "1",
        "--json",
    ];
    let chosen = json(&chosen);
    assert_eq!(
        chosen["sample"],
        "box along x, length 1.6e-2 m, section 2.5000e-5 m2"
    );
    assert_eq!(chosen["beams"], fitted);
}

/// The command of the tutorial works as written: for every template with particles, as plain models and as
/// zones, and for the scene whose packing holds four spheres that hang on each other alone.
#[test]
fn strength_of_every_template_and_of_a_plate_with_a_loose_piece() {
    let folder = scratch("calibrate-templates");
    let mut scenes = vec![scene("branching.toml")];
    for template in ["bend", "impact", "plate"] {
        let place = folder.join(template);
        succeed(&["new", text(&place), "--template", template]);
        let written = std::fs::read_dir(&place).unwrap().map(|e| e.unwrap().path());
        let has_spheres = |p: &std::path::PathBuf| {
            let is_scene = p.extension().is_some_and(|e| e == "toml");
            is_scene && std::fs::read_to_string(p).unwrap().contains("kind = \"dem\"")
        };
        let with_spheres: Vec<_> = written.filter(has_spheres).collect();
        assert_eq!(with_spheres.len(), 1, "{template}");
        scenes.extend(with_spheres);
    }
    for scene in &scenes {
        let asked = ["--strength", "--criterion", "axial"];
        let (notes, report) = calibrated(&[&[text(scene)], &asked[..]].concat());
        assert!(notes.contains("is no bar along x"), "{notes}");
        let ratio = number(&report, "/strength/rows/0/ratio/mean");
        // Thin beams, which a higher Poisson's ratio asks for, are stronger: 26 in the zone of the plate.
        assert!((3.0..40.0).contains(&ratio), "{}: {ratio}", scene.display());
    }
}

/// A short bar, whose middle is stiffer than the whole, has no modulus but a strength.
#[test]
fn a_bar_without_a_uniform_modulus_has_a_strength() {
    let scene = scene("direct-tension.toml");
    let asked = ["calibrate", text(&scene), "--seeds", "1", "--json"];
    assert_eq!(failure(&asked).1, Some(1));
    let report = json(&[&asked[..], &["--strength", "--criterion", "axial"]].concat());
    assert!(report["refused"].is_null());
    let warnings = report["warnings"].as_array().unwrap();
    assert!(
        warnings
            .iter()
            .any(|w| w.as_str().unwrap().contains("the gauge section has"))
    );
    assert!((3.0..6.0).contains(&number(&report, "/strength/rows/0/ratio/mean")));
}

/// Mistakes of a scene are refused before anything is packed: a million spheres would take minutes.
#[test]
fn a_scene_that_cannot_be_tested_is_refused_at_once() {
    let folder = scratch("calibrate-refused");
    let ball = folder.join("ball.toml");
    let spheres = "0,0,0,1e-4\n";
    std::fs::write(folder.join("spheres.csv"), spheres).unwrap();
    let file = SCENE.replace("count = 1500, protocol = \"quench\"", "file = \"spheres.csv\"");
    let shape = "shape.cylinder = { from = [1.0, 0.0, 0.0], length = 8e-3, radius = 1e-3 }";
    let centred = "shape.ball = { centre = [0.0, 0.0, 0.0], radius = 1e-2 }";
    std::fs::write(&ball, file.replace(shape, centred)).unwrap();
    let bar = folder.join("bar.toml");
    std::fs::write(&bar, SCENE.replace("1500", "1000000")).unwrap();
    let quickstart = scene("quickstart.toml");
    let cases: [(&[&str], &str); 5] = [
        (
            &[text(&quickstart)],
            "no model of the scene is of kind \"dem\", so it has no spheres",
        ),
        (&[text(&ball)], "model.bar.dem.file"),
        (
            &[text(&bar), "--strength", "--periodic"],
            "remove --periodic or --strength",
        ),
        (
            &[
                text(&bar),
                "--cylinder",
                "8e-3,1e-3",
                "--strength",
                "--sizes",
                "2e-3",
            ],
            "below 8",
        ),
        (
            &[
                text(&bar),
                "--box",
                "1e-4,1e-5,1e-5",
                "--count",
                "20",
                "--sizes",
                "2e-5",
            ],
            "--strength",
        ),
    ];
    for (arguments, wanted) in cases {
        let (text, code) = failure(&[&["calibrate"], arguments].concat());
        assert!(code == Some(2) && text.contains(wanted), "{arguments:?}: {text}");
    }
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

/// Three ways to the energy that a slow crack takes per area: J and strip theory within 5 %, the energy that
/// the strip lost within 25 % of both in one small strip. A scene gives its fracture.
#[test]
fn a_strip_shows_its_toughness_in_three_ways() {
    let flags = "--toughness --box 48e-3,16e-3,6e-3 --spacing 1e-3 --seeds 1 --json";
    let flags: Vec<&str> = flags.split(' ').collect();
    let report = json(&[&["calibrate", "--body-strength", "50e6"], &flags[..]].concat());
    let value = |name: &str| number(&report, &format!("/toughness/{name}"));
    let [j, lost, theory] = ["j/mean", "lost/mean", "theory/mean"].map(value);
    assert!((j / theory - 1.0).abs() < 0.05, "{j} {theory}");
    assert!((lost / j - 1.0).abs() < 0.25, "{lost} {j}");
    assert!((value("released/mean") / 8.0 - 1.0).abs() < 0.25);
    let spread = lost.max(j).max(theory) / lost.min(j).min(theory) - 1.0;
    assert!((value("difference") - spread).abs() < 1e-9);
    // Spheres of 1 mm and 50 MPa do not go together.
    let both = value("diameter_of_both") / value("diameter");
    let implied = value("tensile_strength") / 50e6;
    assert!((both - implied * implied).abs() < 1e-9, "{both} {implied}");
    let warnings = report["warnings"].to_string();
    assert!(warnings.contains("cannot have"), "{warnings}");
    // This crack, among few spheres, does not follow the clamps.
    let speed = number(&report, "/toughness/strips/0/speed");
    assert_eq!(warnings.contains("ran away"), speed > 0.2, "{speed}: {warnings}");
    // A scene has a fracture of its own.
    let strip = scene("strip.toml");
    let set = ["calibrate", text(&strip), "--set", "effect.0.fracture.gc=4.0"];
    let half = json(&[&set[..], &flags[..]].concat());
    let of_half = |name: &str| number(&half, &format!("/toughness/{name}"));
    assert!((of_half("gc") - 4.0).abs() < 1e-12);
    assert!((of_half("bond_strength") / value("bond_strength") - 0.5).abs() < 1e-12);
}

#[test]
fn what_shows_no_toughness_is_refused() {
    let cases: [(&str, &str); 5] = [
        ("--box 48e-3,24e-3,4e-3 --spacing 1e-3", "its length 2.9 heights"),
        ("--box 48e-3,8e-3,4e-3 --spacing 1e-3", "its height must be 1.2"),
        ("--box 48e-3,16e-3,2e-3 --spacing 1e-3", "its thickness 4.0"),
        (
            "--box 48e-3,16e-3,4e-3 --spacing 1e-3 --body-strength 0",
            "--body-strength = 0",
        ),
        ("--periodic", "--periodic"),
    ];
    for (flags, wanted) in cases {
        let flags: Vec<&str> = flags.split(' ').collect();
        let (error, code) = failure(&[&["calibrate", "--toughness"], &flags[..]].concat());
        // Messages are wrapped.
        let error = error.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(code == Some(2) && error.contains(wanted), "{flags:?}: {error}");
    }
}
