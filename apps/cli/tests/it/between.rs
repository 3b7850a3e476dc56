//! Contact between two models of a scene: ledger, comparison, watchdog, restart, refusals.

use crate::common::{
    arlequin, command, number, scene, scratch, succeed, summary, text, unwrapped, wait_while_running,
};
use std::path::Path;
use std::process::Stdio;

/// A cube of spheres that falls on another one, and a solid beside them.
const TWO: &str = r#"
[model.above]
kind = "dem"
shape.box = { low = [0.0, 0.0, 2.05e-3], high = [2e-3, 2e-3, 4.05e-3] }
dem = { count = 200, protocol = "quench", seed = 3 }
material = { young = 75e9, poisson = 0.17, density = 2200.0 }

[model.below]
kind = "dem"
shape.box = { low = [0.0, 0.0, 0.0], high = [2e-3, 2e-3, 2e-3] }
dem = { count = 200, protocol = "quench" }
material = { young = 75e9, poisson = 0.17, density = 2200.0 }

[model.beside]
kind = "fem"
shape.box = { low = [5e-3, 0.0, 0.0], high = [6e-3, 1e-3, 1e-3] }
spacing = 0.5e-3
material = { young = 75e9, poisson = 0.17, density = 2200.0 }

[[initial]]
models = ["above"]
velocity.uniform = [0.0, 0.0, -50.0]

[time]
end = 6e-6

[output]
energy_every = 1
plots = false

[probe.hit]
model = "below"
at = [1e-3, 1e-3, 1e-3]
component = "z"
quantity = "velocity"
"#;

const TOUCH: &str = "\n[[effect]]\nbetween = [\"above\", \"below\"]\ncontact = { friction = 0.2 }\n";

/// Presses the upper cube on the lower one: from step 320 on they never part.
const PRESS: &str = r#"
[[effect]]
models = ["above"]
body_force.acceleration = [0.0, 0.0, -2e8]

[[support]]
model = "below"
where = "z-min"
"#;

fn written(folder: &Path, scene: &str) -> std::path::PathBuf {
    let path = folder.join("scene.toml");
    std::fs::write(&path, scene).expect("scene");
    path
}

/// The upper cube asks for two own steps, but contact makes it follow the shorter own steps of the lower
/// cube: the plan says so. Without that conflict there is no warning.
#[test]
fn a_number_of_own_steps_that_contact_overrides_is_warned_of() {
    let folder = scratch("between-ratio");
    let plan_with = |steps: &str| {
        let path = written(&folder, &format!("{TWO}{TOUCH}{steps}"));
        let plan = succeed(&["check", "--json", text(&path)]);
        let plan: serde_json::Value = serde_json::from_str(&plan).expect("JSON");
        (plan["models"].clone(), plan["warnings"].to_string())
    };
    let (models, warnings) = plan_with("[model.above.step]\nratio = 2\n[model.below.step]\nfraction = 0.2\n");
    let count = models[0]["own_steps"].as_u64().expect("a count");
    assert!(count > 2 && models[1]["own_steps"] == count, "{models}");
    let wanted = format!(
        "model 'above': makes {count} own steps in a step of the run, not step.ratio = 2: an effect between it and 'below'"
    );
    assert!(warnings.contains(&wanted), "{warnings}");
    let (_, warnings) = plan_with("[model.above.step]\nratio = 2\n");
    assert!(!warnings.contains("step.ratio"), "{warnings}");
}

#[test]
fn bodies_that_touch_have_a_line_of_their_own() {
    let folder = scratch("between-run");
    let path = written(&folder, &format!("{TWO}{TOUCH}"));
    let plan = unwrapped(&succeed(&["check", text(&path)]));
    assert!(plan.contains("contact above-below"), "{plan}");
    let out = folder.join("out");
    succeed(&["run", text(&path), "--out", text(&out)]);
    let s = summary(&out);
    assert!(number(&s, "/energy/h_drift_max") < 1e-11);
    assert!(
        !s["warnings"].to_string().contains("overlap"),
        "{}",
        s["warnings"]
    );
    let ledger = s["effect_ledger"].as_array().expect("ledger");
    assert_eq!(ledger.len(), 1);
    assert_eq!(ledger[0]["name"], "contact above-below");
    let start = number(&s, "/energy/initial");
    let dissipated = number(&ledger[0], "/dissipated");
    assert!(
        dissipated > 0.05 * start && dissipated < start,
        "{dissipated} of {start}"
    );
    assert!(number(&ledger[0], "/share") > 0.0 && number(&ledger[0], "/facts/most contacts") > 3.0);
    assert!(number(&s, "/energy/ledger/contact above-below") < 0.0);
    let csv = std::fs::read_to_string(out.join("effects.csv")).expect("table");
    let head = csv.lines().next().expect("header");
    assert!(head.contains("contact above-below"), "{head}");
}

#[test]
fn the_comparison_and_the_watch_know_contact_between_models() {
    let folder = scratch("between-effects");
    let path = written(&folder, &format!("{TWO}{TOUCH}"));
    let json = succeed(&["effects", text(&path), "--json"]);
    let c: serde_json::Value = serde_json::from_str(&json).expect("JSON");
    assert_eq!(c["effects"][0]["effect"], "effect[0].contact");
    assert!(number(&c, "/effects/0/probes/hit") > 0.9, "{c}");
    assert!(c["missing"].as_array().is_some_and(Vec::is_empty), "{c}");
    let missing = c["effects"][0]["missing"].to_string();
    assert!(
        missing.contains("those of 'below' overlap") && missing.contains("between = "),
        "{missing}"
    );
    let out = folder.join("out");
    let disabled = "effect.0.enabled=false";
    succeed(&["run", text(&path), "--out", text(&out), "--set", disabled]);
    let s = summary(&out);
    assert!(s["effect_ledger"].as_array().is_some_and(Vec::is_empty));
    assert!(
        s["warnings"].to_string().contains("those of 'below' overlap"),
        "{}",
        s["warnings"]
    );
}

#[test]
fn a_run_killed_in_mid_contact_resumes_with_the_same_bits() {
    let folder = scratch("between-resume");
    let path = written(&folder, &format!("{TWO}{TOUCH}{PRESS}"));
    let read = |out: &Path, name: &str| std::fs::read(out.join(name)).expect("table");
    let whole = folder.join("whole");
    let steps = "time.end=30e-6";
    succeed(&["run", text(&path), "--out", text(&whole), "--set", steps]);
    let torn = folder.join("torn");
    let settings = ["--set", steps, "--set", "output.checkpoint_every=400"];
    let arguments = [&["run", text(&path), "--out", text(&torn)][..], &settings].concat();
    let mut child = command(&arguments)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("starts");
    let place = torn.with_extension("unfinished").join("checkpoint.bin");
    assert!(
        wait_while_running(&mut child, || place.exists()),
        "ended by itself"
    );
    child.kill().expect("killed");
    child.wait().expect("ended");
    succeed(&["resume", text(&torn)]);
    let resumed = summary(&torn)["resumed_at_step"].as_u64().expect("resumed") as usize;
    let figures = String::from_utf8(read(&whole, "effects.csv")).expect("text");
    let column = figures
        .split(',')
        .position(|n| n.ends_with("above-below contacts"));
    let row = figures.lines().nth(resumed).expect("row");
    let contacts = row.split(',').nth(column.expect("column")).expect("cell");
    assert!(contacts != "0", "no contact at step {resumed}");
    for name in ["probes.csv", "energy.csv", "effects.csv"] {
        assert!(read(&whole, name) == read(&torn, name), "{name} differs");
    }
}

#[test]
fn contact_between_models_is_refused_where_it_makes_no_sense() {
    let folder = scratch("between-bad");
    let cases = [
        (
            "between = [\"above\", \"above\"]\ncontact = {}",
            "names 'above' twice; contact within one model is models = [\"above\"]",
        ),
        (
            "between = [\"above\", \"line\"]\ncontact = {}\n[model.line]\nkind = \"fem\"\nspacing = 1e-3\n\
             shape.bar = { from = 0.0, to = 1e-2, section = 1e-6 }\nmaterial = { young = 75e9, density = 2200.0 }",
            "effect[0].between[1]: contact needs kind = \"dem\", or a solid of kind = \"fem\" or \"cnem\", which model 'line' is not",
        ),
        (
            "between = [\"above\", \"beside\"]\ncontact = { rolling = 0.1 }",
            "effect[0].contact.rolling: is between particles only, as a facet takes no moment",
        ),
        ("between = [\"above\", \"belov\"]\ncontact = {}", "belov"),
        ("between = [\"above\"]\ncontact = {}", "names 1 models; name two"),
        (
            "between = [\"above\", \"below\"]\nmodels = [\"above\"]\ncontact = {}",
            "excludes models",
        ),
        (
            "between = [\"above\", \"below\"]\nmass_damping = { rate = 1.0 }",
            "is for contact; mass_damping acts on single models",
        ),
        (
            "between = [\"above\", \"below\"]\ncontact = { friction = -0.1 }",
            "friction coefficient = -0.1",
        ),
        (
            "between = [\"above\", \"below\"]\ncontact = {}\n[[effect]]\nbetween = [\"below\", \"above\"]\ncontact = {}",
            "effect[1].between: names a pair of models that has contact already",
        ),
    ];
    for (effect, expected) in cases {
        let path = written(&folder, &format!("{TWO}\n[[effect]]\n{effect}\n"));
        let out = arlequin(&["check", text(&path)]);
        let error = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(2), "{effect}: {error}");
        assert!(
            error.contains(expected),
            "'{effect}' should say '{expected}':\n{error}"
        );
    }
}

/// The scene of `docs/effects.md`, shortened: the ball hits the block and gives momentum to it.
#[test]
fn a_ball_of_spheres_hits_the_particles_of_a_coupled_block() {
    let out = scratch("between-ball").join("out");
    let path = scene("two-bodies.toml");
    let quick = [
        "--set",
        "time.end=4e-6",
        "--set",
        "model.grains.dem.protocol=quench",
        "--set",
        "model.ball.dem.protocol=quench",
    ];
    succeed(&[&["run", text(&path), "--out", text(&out)][..], &quick].concat());
    let s = summary(&out);
    // The ball turns by finite rotations, whose energy balance is of second order in the step.
    assert!(number(&s, "/energy/h_drift_max") < 1e-6, "{}", s["energy"]);
    assert!(number(&s, "/interface/0/max_constraint_residual") < 1e-12);
    let ledger = s["effect_ledger"].as_array().expect("ledger");
    let start = number(&s, "/energy/initial");
    for e in ledger.iter().filter(|e| e["dissipated"].is_number()) {
        assert!(number(e, "/dissipated") > -1e-6 * start, "{e}");
    }
    let between = ledger.iter().find(|e| e["name"] == "contact ball-grains");
    let between = between.expect("contact");
    assert!(number(between, "/facts/most contacts") > 2.0, "{between}");
    assert!(number(between, "/work") < 0.0 && number(between, "/dissipated") > 0.0);
}
