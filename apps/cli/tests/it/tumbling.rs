//! Bodies that turn: angular momentum in the ledger of a scene, probes of large angles, and the hand-over of
//! orientations.
#![allow(clippy::unwrap_used, reason = "a test fails where it cannot go on")]

use crate::common::{number, succeed, summary, text, written};
use serde_json::Value;
use std::path::PathBuf;

/// A free box of 120 spheres that spins about no principal axis; waves run at a speed of about 1.
const BOX: &str = r#"
[model.box]
kind = "dem"
shape.box = { low = [0.0, 0.0, 0.0], high = [4.0, 5.0, 6.0] }
dem = { count = 120, protocol = "quench", finite_rotations = true }
material = { young = 1.0, poisson = 0.17, density = 1.0 }

[[initial]]
spin = { rate = [0.012, 0.02, -0.008], centre = [2.0, 2.5, 3.0] }

[time]
end = 700.0

[output]
plots = false
"#;

/// Two overlapping boxes of elements; the text in place of `{}` acts on them.
const PAIR: &str = r#"
[model.left]
kind = "fem"
role = "coarse"
shape.box = { low = [0.0, 0.0, 0.0], high = [6.0, 2.0, 2.0] }
spacing = 1.0
material = { young = 1.0, poisson = 0.25, density = 1.0 }

[model.right]
kind = "fem"
role = "fine"
shape.box = { low = [4.0, 0.0, 0.0], high = [10.0, 2.0, 2.0] }
spacing = 0.5
material = { young = 1.0, poisson = 0.25, density = 1.0 }

[interface.joint]
coarse = "left"
fine = "right"
overlap.slab = { coarse = [4.0, 1.0, 1.0], fine = [6.0, 1.0, 1.0] }

[[initial]]
velocity.polynomial = { component = "y", along = "x", coefficients = [0.0, 1e-4, 3e-5] }

[time]
end = 40.0

[output]
plots = false
"#;

fn run(name: &str, scene: &str, extra: &[&str]) -> (PathBuf, String, Value) {
    let path = written(name, scene);
    let out = path.with_file_name("out");
    let mut arguments = vec!["run", "--verbose", text(&path), "--out", text(&out)];
    arguments.extend(extra);
    let printed = succeed(&arguments);
    let s = summary(&out);
    (out, crate::common::unwrapped(&printed), s)
}

#[test]
fn a_scene_turns_by_any_angle_and_its_summary_shows_the_angular_momentum() {
    let (out, printed, s) = run("tumbling", BOX, &[]);
    // Two and a half turns: more than a rotation vector can hold.
    assert!(0.025 * number(&s, "/time") > 5.0 * std::f64::consts::PI);
    let m = &s["momentum"][0];
    let line = |m: &Value| ["models", "arms", "keeps", "because"].map(|k| m[k].clone());
    let wanted = serde_json::json!([["box"], "present", "both", null]);
    assert_eq!(Value::from(line(m).to_vec()), wanted);
    for drift in ["linear_drift", "angular_drift"] {
        assert!(number(m, &format!("/{drift}")) < 1e-10, "{m}");
    }
    assert!(number(&s, "/energy/h_drift_max") < 1e-4);
    // L = M (b² + c²)/12 w for a brick; spheres of a packing come close to it.
    let [lx, ly] = [0, 1].map(|c| number(m, &format!("/angular/{c}")));
    let about = |w: f64, b: f64, c: f64| 120.0 * (b * b + c * c) / 12.0 * w;
    assert!((lx / about(0.012, 5.0, 6.0) - 1.0).abs() < 0.15, "{lx}");
    assert!((ly / about(0.02, 4.0, 6.0) - 1.0).abs() < 0.15, "{ly}");
    assert!(printed.contains("momentum box"), "{printed}");
    let table = std::fs::read_to_string(out.join("energy.csv")).unwrap();
    let mut lines = table.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let column = |name: &str| names.iter().position(|n| n.trim_matches('"') == name).unwrap();
    let last: Vec<f64> = lines
        .last()
        .unwrap()
        .split(',')
        .map(|x| x.parse().unwrap())
        .collect();
    let shown = last[column("box angular momentum x [kg m2/s]")];
    assert!((shown / lx - 1.0).abs() < 1e-9, "{shown} {lx}");
    assert!(last[column("angular momentum drift [-]")] < 1e-10);
    assert!(
        s["warnings"]
            .as_array()
            .unwrap()
            .iter()
            .all(|w| !w.to_string().contains("momentum"))
    );
}

/// A probe of rotation reads 2 rad about z, where a displacement across the arm would read sin 2 = 0.91.
#[test]
fn a_probe_reads_the_angle_of_a_body_that_turns_far() {
    let scene = BOX
        .replace("rate = [0.012, 0.02, -0.008]", "rate = [0.0, 0.0, 0.02]")
        .replace("end = 700.0", "end = 100.0");
    let probe = "[probe.turn]\nmodel = \"box\"\nwhere.box = { low = [0.0, 0.0, 0.0], high = [4.0, 5.0, 6.0] }\nquantity = \"rotation\"\ncomponent = \"z\"\n";
    let (_, _, s) = run("turning-probe", &format!("{scene}{probe}"), &[]);
    let (turn, time) = (number(&s, "/probes/turn/last"), number(&s, "/time"));
    assert!((turn / (0.02 * time) - 1.0).abs() < 0.02, "{turn} after {time}");
}

/// The ledger names which momenta the laws conserve exactly, and for the others the reason.
#[test]
fn the_ledger_names_what_keeps_a_body_from_keeping_its_momentum() {
    let (_, _, s) = run("momentum-free", PAIR, &[]);
    let m = &s["momentum"][0];
    assert_eq!((&m["arms"], &m["keeps"]), (&"rest".into(), &"both".into()));
    assert_eq!(m["models"], serde_json::json!(["left", "right"]));
    let drifts = ["/linear_drift", "/angular_drift"].map(|p| number(m, p));
    assert!(drifts.iter().all(|d| *d < 1e-12), "{drifts:?}");
    let held = format!("{PAIR}\n[[support]]\nmodel = \"left\"\nwhere = \"x-min\"\n");
    let (_, printed, s) = run("momentum-held", &held, &[]);
    let m = &s["momentum"][0];
    assert_eq!(m["keeps"], "neither");
    assert_eq!(m["because"], "supports of 'left'");
    assert!(m["linear_drift"].is_null() && printed.contains("no claim about either: supports of 'left'"));
    // Elements have no rotations and these spheres have: angular momentum is not conserved exactly, and the
    // run warns of its change.
    let mixed = PAIR
        .replace(
            "role = \"fine\"\n",
            "role = \"fine\"\ndem = { count = 600, protocol = \"quench\", finite_rotations = true }\n",
        )
        .replacen("kind = \"fem\"", "kind = \"FEM\"", 1)
        .replace("kind = \"fem\"", "kind = \"dem\"")
        .replace("kind = \"FEM\"", "kind = \"fem\"")
        .replace("spacing = 0.5\n", "")
        .replace("[1e-4, 3e-5]", "")
        .replace("end = 40.0", "end = 60.0");
    let turning = mixed.replace(
        "velocity.polynomial = { component = \"y\", along = \"x\", coefficients = [0.0, 1e-4, 3e-5] }",
        "spin = { rate = [0.0, 0.0, 0.01], centre = [5.0, 1.0, 1.0] }",
    );
    for (scene, name, turns) in [
        (&mixed, "momentum-mixed", false),
        (&turning, "momentum-turning", true),
    ] {
        let (_, _, s) = run(name, scene, &[]);
        let m = &s["momentum"][0];
        assert_eq!((&m["arms"], &m["keeps"]), (&"present".into(), &"linear".into()));
        let reason = m["because"].as_str().unwrap();
        assert!(
            reason.contains("the law of 'left' balances about the positions at rest, the law of 'right'"),
            "{reason}"
        );
        let [p, l] = ["/linear_drift", "/angular_drift"].map(|p| number(m, p));
        assert!(p < 1e-11 && (l > 1e-2) == turns, "{p:e} {l:e}");
        let warned = s["warnings"].to_string().contains("angular momentum has changed");
        assert_eq!(warned, turns, "{}", s["warnings"]);
    }
}

/// Two models that turn keep their common angular momentum across an interface, although multipliers act at
/// the reference positions, because the tied displacements have no jump. A junction of strains does not keep
/// it, and the report says so.
#[test]
fn two_models_that_turn_keep_their_angular_momentum_across_an_interface() {
    let grains = "dem = { count = 400, protocol = \"quench\", finite_rotations = true }\n";
    let scene = PAIR
        .replace("kind = \"fem\"\n", &format!("kind = \"dem\"\n{grains}"))
        .replace("spacing = 1.0\n", "")
        .replace("spacing = 0.5\n", "")
        .replace(
            "velocity.polynomial = { component = \"y\", along = \"x\", coefficients = [0.0, 1e-4, 3e-5] }",
            "spin = { rate = [0.002, 0.0, 0.01], centre = [5.0, 1.0, 1.0] }",
        )
        .replace(
            "[interface.joint]\n",
            "[interface.joint]\nmediator = { spacing = 1.0 }\n",
        );
    let (_, _, s) = run("turning-pair", &scene, &[]);
    let m = &s["momentum"][0];
    assert_eq!(
        (&m["arms"], &m["keeps"]),
        (&"present".into(), &"both".into()),
        "{m}"
    );
    assert!(
        number(m, "/angular_drift") < 1e-10 && number(m, "/linear_drift") < 1e-11,
        "{m}"
    );
    assert!(number(&s, "/time") * 0.01 > 0.39, "they turn by 0.4 rad");
    let strains = ["--set", "interface.joint.junction.kind=h1-strain"];
    let (_, _, s) = run("turning-strains", &scene, &strains);
    let m = &s["momentum"][0];
    assert_eq!(m["keeps"], "linear");
    assert_eq!(
        m["because"],
        "the junction of interface 'joint' balances about the positions at rest"
    );
    assert!(number(m, "/angular_drift") > 1e-9, "{m}");
}
