//! `check` refuses every scene that `run` refuses, with the same words and before anything is packed.

use crate::common::{SMALL, arlequin, scratch, text};
use arlequin_scene::{Scene, Source};

/// A block of spheres beside the end of a block of elements.
const BESIDE: &str = r#"
[model.grains]
kind = "dem"
shape.box = { low = [0.0, 0.0, 0.0], high = [4e-3, 2e-3, 2e-3] }
spacing = 0.4e-3
material = { young = 75e9, poisson = 0.17, density = 2200.0 }

[model.tail]
kind = "fem"
shape.cylinder = { from = [10e-3, 0.0, 0.0], length = 4e-3, radius = 1e-3 }
spacing = 0.5e-3
material = { young = 75e9, poisson = 0.17, density = 2200.0 }

[time]
end = 1e-7
"#;

/// Asserts that `check` and `run` give the same error at `key`, and that no packing has begun.
fn assert_refused(name: &str, scene: &str, key: &str, words: &str) {
    let folder = scratch(&format!("places-{name}"));
    let path = folder.join("scene.toml");
    std::fs::write(&path, scene).expect("scene");
    let mut phases = Vec::new();
    let source = Source::new(&path, scene);
    let prepared =
        Scene::from_source(source).and_then(|s| s.prepare_with(&mut |p, _, _| phases.push(p.to_owned())));
    let error = prepared.map(|_| ()).expect_err("refused");
    let (place, message) = (error.place().0.unwrap_or_default().to_owned(), error.to_string());
    assert!(
        place == key && message.contains(words),
        "{name}: {place}: {message}"
    );
    let packed = phases.iter().find(|p| p.starts_with("packing"));
    assert_eq!(packed, None, "{name}: {message}");
    let [check, run] = ["check", "run"].map(|command| {
        let mut arguments = vec![command, text(&path)];
        let out = folder.join("out");
        if command == "run" {
            arguments.extend(["--out", text(&out)]);
        }
        let done = arlequin(&arguments);
        assert_eq!(done.status.code(), Some(2), "{name}: {command}");
        assert!(!out.exists(), "{name}: {command} left a folder");
        String::from_utf8_lossy(&done.stderr).into_owned()
    });
    assert_eq!(check, run, "{name}");
}

#[test]
fn places_in_no_model_are_refused_before_spheres_are_packed() {
    let extended = |addition: &str| format!("{BESIDE}{addition}");
    let probe = |model: &str, position: &str| {
        extended(&format!(
            "[probe.here]\nmodel = \"{model}\"\nat = {position}\ncomponent = \"x\"\n"
        ))
    };
    let outside = "lies outside model 'grains'";
    assert_refused(
        "beyond",
        &probe("grains", "[5e-3, 1e-3, 1e-3]"),
        "probe.here.at",
        outside,
    );
    let skin = probe("grains", "[4e-3, 1e-3, 1e-3]");
    assert_refused("skin", &skin, "probe.here.at", "move the probe in by a diameter");
    // A corner of the box around the cylinder that lies outside of the cylinder.
    let corner = probe("tail", "[12e-3, 0.95e-3, 0.95e-3]");
    assert_refused(
        "corner",
        &corner,
        "probe.here.at",
        "lies in no part of model 'tail'",
    );
    let box_of = "where.box = { low = [1.0, 1.0, 1.0], high = [2.0, 2.0, 2.0] }";
    let support = extended(&format!("[[support]]\nmodel = \"tail\"\n{box_of}\n"));
    assert_refused(
        "support",
        &support,
        "support[0].where",
        "holds no node of model 'tail'",
    );
    let load = extended(&format!(
        "[[load]]\nmodel = \"tail\"\n{box_of}\nforce = [1.0, 0.0, 0.0]\ntime = \"step\"\n"
    ));
    assert_refused(
        "load",
        &load,
        "load[0].where",
        "holds no surface facet of model 'tail'",
    );
}

#[test]
fn tractions_beside_the_surface_of_spheres_are_refused_before_they_are_packed() {
    for what in ["traction = [1e6, 0.0, 0.0]", "pressure = 1e6"] {
        let place = "where.box = { low = [1.5e-3, 0.9e-3, 0.9e-3], high = [2.5e-3, 1.1e-3, 1.1e-3] }";
        let load = format!("{BESIDE}[[load]]\nmodel = \"grains\"\n{place}\n{what}\ntime = \"step\"\n");
        let words = "holds no surface of model 'grains'";
        assert_refused("traction", &load, "load[0].where", words);
    }
}

#[test]
fn beams_and_keys_that_make_no_sense_are_refused_before_packing() {
    let dem = |keys: &str| BESIDE.replacen("spacing = 0.4e-3", &format!("spacing = 0.4e-3\n{keys}"), 1);
    for (keys, key, words) in [
        (
            "dem = { young = 265e9, radius_ratio = 5.0 }",
            "model.grains.dem.radius_ratio",
            "must lie between 0.2 and 1.5",
        ),
        (
            "dem = { young = 265e9, radius_ratio = 0.1 }",
            "model.grains.dem.radius_ratio",
            "must lie between 0.2 and 1.5",
        ),
        ("dem.young = -1.0", "model.grains.dem", "beam Young's modulus"),
        ("dem.poisson = 0.6", "model.grains.dem", "beam Poisson's ratio"),
        (
            "divisions = [4, 2, 2]",
            "model.grains.divisions",
            "is of elements",
        ),
        ("scale = 1e-3", "model.grains.scale", "is of a file"),
        ("volume = \"a\"", "model.grains.volume", "is of a mesh file"),
        ("dem.radii = \"r\"", "model.grains.dem.radii", "in dem.file"),
    ] {
        assert_refused("beams", &dem(keys), key, words);
    }
}

/// Issue 26, D.5: Poisson's ratios next to -1 and 0.5 are refused; elements lock there at any refinement.
#[test]
fn ratios_of_poisson_next_to_their_ends_are_refused() {
    for (nu, taken) in [
        ("0.4999999999", false),
        ("-0.9999999999", false),
        ("0.4999", true),
        ("-0.999", true),
    ] {
        let scene = SMALL.replace("poisson = 0.25", &format!("poisson = {nu}"));
        if taken {
            let path = scratch("poisson").join("scene.toml");
            std::fs::write(&path, scene).expect("scene");
            crate::common::succeed(&["check", text(&path)]);
        } else {
            let words = "must lie between -1 + 1e-4 and 0.5 - 5e-5";
            assert_refused("poisson", &scene, "model.left.material", words);
        }
    }
}

/// Issue 26, D.8: a scene at rest whose body can move freely is refused by `check` as by `run`.
#[test]
fn scenes_at_rest_that_can_move_are_refused_by_check() {
    let bar = "[model.bar]\nkind = \"fem\"\ndivisions = [8, 2, 2]\n\
               shape.box = { low = [0.0, 0.0, 0.0], high = [0.1, 0.01, 0.01] }\n\
               material = { young = 70e9, poisson = 0.3, density = 2000.0 }\n\
               [[support]]\nmodel = \"bar\"\nwhere = \"x-min\"\ncomponents = [\"x\"]\n\
               [[load]]\nmodel = \"bar\"\nwhere = \"x-max\"\nforce = [1.0, 0.0, 0.0]\ntime = \"step\"\n\
               [static]\nsteps = 1\n";
    let words = "'bar' can move along y and z and turn about x: no support holds it";
    assert_refused("rest", bar, "static", words);
}

/// Issue 26, D.8: an error names a key that the scene has or could have.
#[test]
fn errors_stand_under_keys_of_the_scene() {
    // The macro step is too long, given by `time.step.seconds`.
    let long = SMALL.replace("steps = 50", "steps = 50\nstep.seconds = 10.0");
    assert_refused("seconds", &long, "time.step.seconds", "exceeds the critical step");
    let ratio = SMALL
        .replace("steps = 50", "steps = 50\nstep.seconds = 1.0")
        .replacen("spacing = 1.0", "spacing = 1.0\nstep.ratio = 4", 1)
        .replacen("spacing = 0.5", "spacing = 0.5\nstep.ratio = 2", 1);
    assert_refused("ratio", &ratio, "model.right.step", "exceeds the critical step");
    let alone = "[model.bar]\nkind = \"fem\"\ndivisions = [4, 1, 1]\n\
                 shape.box = { low = [0.0, 0.0, 0.0], high = [4.0, 1.0, 1.0] }\n\
                 material = { young = 1.0, poisson = 0.3, density = 1.0 }\n\
                 [[initial]]\nvelocity.uniform = [1e308, 0.0, 0.0]\n[[initial]]\nvelocity.uniform = [1e308, 0.0, 0.0]\n\
                 [time]\nsteps = 1\n";
    assert_refused("infinite", alone, "initial", "is not a finite number");
}
