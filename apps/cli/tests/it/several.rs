//! Scenes that differ from the shipped ones: one model alone, a fine zone between two coarse ones, cylinders.

use crate::common::{SMALL, number, scratch, succeed, summary, text};

fn run(name: &str, scene: &str) -> serde_json::Value {
    let folder = scratch(&format!("several-{name}"));
    let path = folder.join("scene.toml");
    std::fs::write(&path, scene).expect("scene");
    let out = folder.join("out");
    succeed(&["run", text(&path), "--out", text(&out)]);
    summary(&out)
}

/// A clamped bar has the axial frequencies `(2k + 1) c/(4 L)`, read from a probe.
#[test]
fn frequencies_of_a_bar() {
    let s = run(
        "bar",
        r#"
[model.bar]
kind = "fem"
shape.bar = { from = 0.0, to = 1.0, section = 1.0 }
spacing = 0.01
material = { young = 1.0, density = 1.0 }
[[support]]
model = "bar"
where = "x-min"
[[load]]
model = "bar"
where = "x-max"
force = [1.0, 0.0, 0.0]
time = "step"
[time]
end = 100.0
[probe.tip]
model = "bar"
at = [1.0, 0.0, 0.0]
component = "x"
"#,
    );
    for (k, expected) in [0.25, 0.75, 1.25].into_iter().enumerate().take(2) {
        let frequency = number(&s, &format!("/probes/tip/frequencies/{k}"));
        assert!(
            (frequency / expected - 1.0).abs() < 2e-3,
            "{frequency} for {expected}"
        );
    }
    // The static deflection is one; the bar oscillates between zero and two.
    assert!((number(&s, "/probes/tip/mean") - 1.0).abs() < 0.01);
    assert!(s["interface"].as_array().is_some_and(Vec::is_empty));
    assert_eq!(s["effects"][0], "bar/load-1");
}

/// A fine zone between two coarse sides: all models move at one velocity and stay together.
#[test]
fn fine_zone_between_coarse_sides() {
    let head = SMALL.split("[[support]]").next().expect("models");
    let scene = format!(
        r#"{head}
[model.end]
kind = "fem"
role = "coarse"
shape.box = {{ low = [8.0, 0.0, 0.0], high = [14.0, 1.0, 1.0] }}
spacing = 1.0
material = {{ young = 1.0, poisson = 0.25, density = 1.0 }}
[interface.second]
coarse = "end"
fine = "right"
overlap.slab = {{ fine = [8.0, 0.0, 0.0], coarse = [10.0, 0.0, 0.0] }}
[[initial]]
velocity.uniform = [1.0, 2.0, -1.0]
[time]
end = 10.0
[probe.left]
model = "left"
at = [0.0, 0.5, 0.5]
component = "y"
[probe.end]
model = "end"
at = [14.0, 0.5, 0.5]
component = "y"
"#
    );
    let s = run("middle", &scene);
    assert_eq!(s["interface"].as_array().map(Vec::len), Some(2));
    // Mass 14 at a speed of √6; the weights sum to one.
    assert!((number(&s, "/energy/initial") / 42.0 - 1.0).abs() < 1e-12);
    assert!((number(&s, "/energy/final") / 42.0 - 1.0).abs() < 1e-12);
    assert!(number(&s, "/energy/start_loss").abs() < 1e-12);
    for probe in ["left", "end"] {
        let moved = number(&s, &format!("/probes/{probe}/last"));
        assert!(
            (moved / (2.0 * number(&s, "/time")) - 1.0).abs() < 1e-12,
            "{probe}: {moved}"
        );
    }
}

/// A coarse model between two fine ones, with several drives and every optional key.
#[test]
fn coarse_model_between_fine_ones() {
    let scene = format!(
        r#"{SMALL}
[model.start]
kind = "fem"
role = "fine"
shape.box = {{ low = [-4.0, 0.0, 0.0], high = [2.0, 1.0, 1.0] }}
divisions = [12, 2, 2]
fem.element = "tet4"
material = {{ young = 1.0, poisson = 0.25, density = 1.0 }}
[interface.second]
coarse = "left"
fine = "start"
overlap.slab = {{ fine = [0.0, 0.0, 0.0], coarse = [2.0, 0.0, 0.0] }}
weight = {{ profile = "linear", gamma = {{ profile = "constant", value = 0.5 }} }}
mediator = {{ divisions = [2, 1, 1], element = "hex8" }}
junction = {{ kind = "h1-gradient", length = 0.5 }}
absorber = {{ rate = 0.1, spacing = 2.0 }}
[[effect]]
models = ["right"]
mass_damping.rate = 0.01
[[effect]]
body_force.acceleration = [0.0, 0.0, -1e-4]
"#
    )
    .replace("[[support]]\nmodel = \"left\"", "[[support]]\nmodel = \"start\"");
    let s = run("coarse", &scene);
    assert!(number(&s, "/energy/h_drift_max") < 1e-11);
    let works = s["energy"]["ledger"].as_object().expect("ledger");
    for line in [
        "right/mass-damping",
        "start/absorber",
        "left/body-force",
        "right/pull",
        "constraint",
    ] {
        assert!(works.contains_key(line), "{line} in {works:?}");
    }
    assert!(number(&s, "/energy/ledger/right~1mass-damping") < 0.0);
}

/// A twisted cylinder of meshes with different cross-sections keeps its balance with the patch-exact weight
/// and the strain junction.
#[test]
fn twisted_cylinder() {
    let s = run(
        "cylinder",
        r#"
[model.left]
kind = "fem"
role = "coarse"
shape.cylinder = { from = [0.0, 0.0, 0.0], length = 12.0, radius = 1.0 }
spacing = 0.5
material = { young = 1.0, poisson = 0.25, density = 1.0 }
[model.right]
kind = "fem"
role = "fine"
shape.cylinder = { from = [9.0, 0.0, 0.0], length = 11.0, radius = 1.0 }
spacing = 0.33
material = { young = 1.0, poisson = 0.25, density = 1.0 }
[interface.joint]
coarse = "left"
fine = "right"
overlap.slab = { coarse = [9.0, 0.0, 0.0], fine = [12.0, 0.0, 0.0] }
weight = { profile = "mediator-compatible", epsilon = 0.0 }
mediator = { spacing = 1.0 }
junction = { kind = "h1-strain" }
[[support]]
model = "left"
where = "x-min"
[[support]]
model = "right"
where = "x-max"
components = ["x"]
motion = { amplitude = 0.01, time = { ramp = { duration = 10.0 } } }
[[load]]
model = "right"
where = "x-max"
torque = [0.01, 0.0, 0.0]
time.table = [[0.0, 0.0], [10.0, 1.0]]
[time]
end = 20.0
[probe.rim]
model = "right"
at = [20.0, 0.9, 0.0]
component = "z"
[probe.end]
model = "right"
where = "x-max"
component = "x"
"#,
    );
    assert!(number(&s, "/energy/h_drift_max") < 1e-10);
    assert!(number(&s, "/probes/rim/last") > 0.0);
    assert!((number(&s, "/probes/end/last") - 0.01).abs() < 1e-12);
    assert!(s["energy"]["ledger"].get("supports").is_some());
}
