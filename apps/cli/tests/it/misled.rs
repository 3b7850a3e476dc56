//! Messages that name the cause of a mistake, before anything is set up.

use crate::common::{SMALL, arlequin, number, scratch, succeed, summary, text};
use std::path::Path;
use std::time::{Duration, Instant};

fn messages_of(folder: &Path, scene: &str) -> String {
    let path = folder.join("scene.toml");
    std::fs::write(&path, scene).expect("scene");
    let out = arlequin(&["check", text(&path)]);
    assert_eq!(out.status.code(), Some(2), "{scene}");
    String::from_utf8_lossy(&out.stderr)
        .replace(['\n', '│'], " ")
        .split_whitespace()
        .collect::<Vec<_>>()
        .join(" ")
}

fn assert_message(folder: &Path, scene: &str, words: &[&str], not: &str) {
    let message = messages_of(folder, scene);
    for w in words {
        assert!(message.contains(w), "'{w}' is missing in: {message}");
    }
    assert!(!message.contains(not), "misleads: {message}");
}

fn swapped(from: &str, to: &str) -> String {
    assert!(SMALL.contains(from), "{from}");
    SMALL.replacen(from, to, 1)
}

#[test]
fn a_reversed_slab_is_called_reversed() {
    let folder = scratch("reversed");
    let scene = swapped(
        "{ coarse = [4.0, 0.0, 0.0], fine = [6.0, 0.0, 0.0] }",
        "{ fine = [4.0, 0.0, 0.0], coarse = [6.0, 0.0, 0.0] }",
    );
    assert_message(
        &folder,
        &scene,
        &["the slab is reversed", "exchange the two points"],
        "epsilon",
    );
}

#[test]
fn a_probe_outside_is_told_where_its_model_is() {
    let folder = scratch("probe-outside");
    let scene = swapped("where = \"x-max\"\ncomponent", "at = [1.0, 0.5, 0.5]\ncomponent");
    let words = [
        "probe.tip.at = [1.0, 0.5, 0.5] m: lies outside model 'right'",
        "from [4.0, 0.0, 0.0] to [10.0, 1.0, 1.0] m",
    ];
    assert_message(&folder, &scene, &words, "mediator");
    // A corner of the box around a cylinder that lies outside of the cylinder.
    let round = r#"
[model.rod]
kind = "fem"
shape.cylinder = { from = [0.0, 0.0, 0.0], length = 4.0, radius = 1.0 }
spacing = 0.5
material = { young = 1.0, poisson = 0.25, density = 1.0 }
[time]
steps = 1
[probe.corner]
model = "rod"
at = [2.0, 0.95, 0.95]
component = "x"
"#;
    assert_message(
        &folder,
        round,
        &[
            "probe.corner.at",
            "lies in no part of model 'rod'; its nearest node is ",
            "m away, at [2.00000e0, ",
        ],
        "mediator",
    );
}

/// Words of `two-bodies.toml`, their replacement with a mistake, and words of the error.
const MISTAKES: [(&str, &str, &str); 16] = [
    (
        "where = \"z-min\"",
        "where = \"bottom\"",
        "there is no group of the model of this name",
    ),
    ("strength = 800e6", "strength = -800e6", "bond strength"),
    (
        "contact = { friction = 0.3 }",
        "contact = { friction = -0.3 }",
        "friction coefficient",
    ),
    (
        "stiffness_damping = { time = 1e-9 }",
        "stiffness_damping = { time = -1e-9 }",
        "effect[3]",
    ),
    (
        "between = [\"ball\", \"grains\"]",
        "between = [\"ball\", \"grain\"]",
        "effect[2].between[1] = 'grain'",
    ),
    (
        "mediator = { spacing = 0.75e-3 }",
        "mediator = { spacing = -0.75e-3 }",
        "interface.layer.mediator.spacing",
    ),
    (
        "mediator = { spacing = 0.75e-3 }",
        "weight = { epsilon = 0.7 }",
        "epsilon = 0.7",
    ),
    (
        "mediator = { spacing = 0.75e-3 }",
        "junction = { kind = \"l2\", length = 1.0 }",
        "the l2 junction has no length",
    ),
    (
        "mediator = { spacing = 0.75e-3 }",
        "absorber = { spacing = 1.0 }",
        "needs exactly one of rate",
    ),
    (
        "coarse = [0.0, 0.0, -3e-3]",
        "coarse = [0.0, 0.0, -1.5e-3]",
        "overlap width = 0",
    ),
    (
        "at = [0.0, 0.0, -4e-3]",
        "at = [0.0, 0.0, -4.0]",
        "probe.below.at",
    ),
    (
        "at = [0.0, 0.0, -4e-3]",
        "where = \"z-min\"\nat = [0.0, 0.0, -4e-3]",
        "probe.below: needs exactly one of",
    ),
    (
        "models = [\"ball\"]\nvelocity",
        "models = [\"bal\"]\nvelocity",
        "initial[0].models[0] = 'bal'",
    ),
    (
        "velocity.uniform = [0.0, 0.0, -25.0]",
        "",
        "initial[0]: needs displacement, velocity, spin or wave",
    ),
    (
        "spacing = 0.5e-3",
        "spacing = -0.5e-3",
        "model.block.spacing = -0.0005",
    ),
    (
        "shape.file = \"ball.stl\"",
        "shape.file = \"bal.stl\"",
        "model.ball.shape.file: mesh file",
    ),
];

/// Each mistake in a table that is read late is found before the packing, which would take seconds.
#[test]
fn mistakes_in_the_file_are_found_before_any_set_up() {
    let folder = scratch("early");
    let scene = std::fs::read_to_string(crate::common::scene("two-bodies.toml")).expect("scene");
    std::fs::copy(crate::common::scene("ball.stl"), folder.join("ball.stl")).expect("copy");
    // A packing of 40 times the spheres makes a late error slow.
    let scene = scene.replace("spacing = 0.35e-3", "spacing = 0.1e-3");
    for (from, to, words) in MISTAKES {
        assert!(scene.contains(from), "{from}");
        let begin = Instant::now();
        let message = messages_of(&folder, &scene.replacen(from, to, 1));
        assert!(message.contains(words), "'{to}' should say '{words}': {message}");
        assert!(
            begin.elapsed() < Duration::from_secs(2),
            "'{to}' took {:?}",
            begin.elapsed()
        );
    }
}

#[test]
fn errors_of_particles_name_their_model() {
    let folder = scratch("names");
    let scene = r#"
[model.pebbles]
kind = "dem"
shape.box = { low = [0.0, 0.0, 0.0], high = [1e-3, 1e-3, 1e-3] }
dem = { count = 1, protocol = "quench" }
material = { young = 75e9, poisson = 0.17, density = 2200.0 }
[time]
steps = 1
"#;
    assert_message(&folder, scene, &["model.pebbles"], "'dem'");
}

/// A body at rest that is displaced rigidly stays at rest and raises no alarm.
#[test]
fn a_body_displaced_rigidly_is_no_false_alarm() {
    let folder = scratch("rigid");
    let bodies = SMALL.split("[[support]]").next().expect("models");
    let motion = "[[initial]]\ndisplacement.uniform = [1e-3, -2e-3, 1e-3]\n[time]\nsteps = 300\n";
    let glass = bodies
        .replace("young = 1.0", "young = 72.5e9")
        .replace("density = 1.0", "density = 2200.0");
    for (k, scene) in [bodies, &glass].into_iter().enumerate() {
        let path = folder.join("scene.toml");
        std::fs::write(&path, format!("{scene}{motion}")).expect("scene");
        let out = folder.join(format!("{k}"));
        succeed(&["run", text(&path), "--out", text(&out)]);
        let s = summary(&out);
        assert_eq!(s["status"], "complete");
        // Round-off of the energy of displacements of this size, E V (q/h)².
        let young = if k == 0 { 1.0 } else { 72.5e9 };
        let bound = 16.0 * f64::EPSILON * young * 10.0 * (1e-3_f64 / 0.5).powi(2);
        let energy = number(&s, "/energy/final");
        assert!(energy.abs() < bound, "{energy:e} J, bound {bound:e} J");
    }
}

#[test]
fn opposed_motions_in_an_overlap_are_named() {
    let folder = scratch("opposed");
    let two_motions = |second: &str| {
        let side = "where.box = { low = [4.0, 0.0, 0.0], high = [6.0, 0.0, 1.0] }\ncomponents = [\"y\"]\n";
        let motion = "motion = { amplitude = 1e-3, time.ramp = { duration = 5.0 } }\n";
        format!(
            "{SMALL}\n[[support]]\nmodel = \"left\"\n{side}{motion}[[support]]\nmodel = \"right\"\n{side}{second}"
        )
    };
    let words = [
        "interface 'joint'",
        "are moved along y by prescribed motions that differ by 2.000e-3 m at t = 5.000e0 s",
    ];
    assert_message(
        &folder,
        &two_motions("motion = { amplitude = -1e-3, time.ramp = { duration = 5.0 } }\n"),
        &words,
        "epsilon",
    );
    let words = ["that differ by 1.000e-3 m"];
    assert_message(&folder, &two_motions(""), &words, "epsilon");
    // Equal motions on both models are right for an overlap with a support.
    let path = folder.join("same.toml");
    std::fs::write(
        &path,
        two_motions("motion = { amplitude = 1e-3, time.ramp = { duration = 5.0 } }\n"),
    )
    .expect("scene");
    succeed(&["check", text(&path)]);
}

/// Issue 26, D.4: equal motions by formulas that grow without end are not reported as opposed.
#[test]
fn equal_motions_by_formulas_are_not_opposed() {
    let folder = scratch("equal-formulas");
    let path = folder.join("scene.toml");
    let side = "where.box = { low = [4.0, 0.0, 0.0], high = [6.0, 0.0, 1.0] }\ncomponents = [\"y\"]\n";
    let motion = |size: &str, formula: &str| {
        format!("{side}motion = {{ amplitude = {size}, time.expression = \"{formula}\" }}\n")
    };
    let two_motions = |time: &str, first: &str, second: &str| {
        let scene = SMALL.replace("steps = 50", time);
        format!("{scene}\n[[support]]\nmodel = \"left\"\n{first}[[support]]\nmodel = \"right\"\n{second}")
    };
    let square = motion("1e-3", "(t/30e-1)^2");
    for time in ["steps = 50", "end = 5.0"] {
        std::fs::write(&path, two_motions(time, &square, &square)).expect("scene");
        succeed(&["check", text(&path)]);
        let opposed = two_motions(time, &square, &motion("-1e-3", "(t/30e-1)^2"));
        assert_message(
            &folder,
            &opposed,
            &["interface 'joint'", "are moved along y"],
            "epsilon",
        );
    }
    // Two motions that differ only after the end of the run.
    let later = motion("1e-3", "(t/30e-1)^2 + max(0, t - 6)");
    std::fs::write(&path, two_motions("end = 5.0", &square, &later)).expect("scene");
    succeed(&["check", text(&path)]);
    let within = two_motions("end = 7.0", &square, &later);
    assert_message(&folder, &within, &["are moved along y"], "epsilon");
}

/// The advised spacing makes as many mediator nodes as the coarser model has, in one dimension and in three.
#[test]
fn the_advised_mediator_spacing_knows_the_dimension() {
    let folder = scratch("advice");
    let path = folder.join("scene.toml");
    let advised = |scene: &str| -> Option<f64> {
        std::fs::write(&path, scene).expect("scene");
        let plan = succeed(&["check", "--json", text(&path)]);
        let start = plan.find("use h_B ≥ ")? + "use h_B ≥ ".len();
        plan[start..].split(' ').next()?.parse().ok()
    };
    let block = SMALL
        .replace("high = [6.0, 1.0, 1.0]", "high = [6.0, 4.0, 4.0]")
        .replace("high = [10.0, 1.0, 1.0]", "high = [10.0, 4.0, 4.0]");
    let scene_with = |h: f64| {
        block.replace(
            "weight = { profile = \"cubic\" }",
            &format!("mediator = {{ spacing = {h:?} }}"),
        )
    };
    // 9³ nodes over 4 x 4 x 2 m at 0.5 m of both against 3 x 5 x 5 coarse ones at 1 m: the advice takes the
    // cube root, not the ratio.
    let h = advised(&scene_with(0.5)).expect("an advice");
    assert!((h / (0.5 * (405.0_f64 / 75.0).cbrt()) - 1.0).abs() < 1e-3, "{h}");
    assert_eq!(advised(&scene_with(1.0)), None);
}
