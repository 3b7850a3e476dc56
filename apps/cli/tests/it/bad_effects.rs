//! Wrong settings of effects are refused before the first step, at their key.

use crate::common::{SMALL, arlequin, scratch, text};

/// A few spheres without effects.
const GRAINS: &str = r#"
[model.grains]
kind = "dem"
shape.box = { low = [0.0, 0.0, 0.0], high = [2e-3, 2e-3, 2e-3] }
dem = { count = 200, protocol = "quench" }
material = { young = 75e9, poisson = 0.17, density = 2200.0 }

[time]
steps = 3
"#;

fn assert_refused(folder: &std::path::Path, scene: &str, effect: &str, expected: &str) {
    let path = folder.join("scene.toml");
    std::fs::write(&path, format!("{scene}\n[[effect]]\n{effect}\n")).expect("scene");
    let out = arlequin(&["check", text(&path)]);
    let error = String::from_utf8_lossy(&out.stderr).into_owned();
    assert_eq!(out.status.code(), Some(2), "{effect}: {error}");
    assert!(
        error.contains(expected),
        "'{effect}' should say '{expected}':\n{error}"
    );
    // `run` gives the same error as `check` and packs nothing first.
    let run = arlequin(&["-v", "run", text(&path), "--out", text(&folder.join("never"))]);
    let stderr = String::from_utf8_lossy(&run.stderr).into_owned();
    assert!(!stderr.contains("packing of"), "'{effect}' packs first: {stderr}");
    assert!(
        stderr.ends_with(&error),
        "{effect}: {error}, and by a run: {stderr}"
    );
}

#[test]
fn effects_of_particles() {
    let folder = scratch("bad-effects-grains");
    let sphere = "shape.sphere = { centre = [0.0, 0.0, 5e-3], radius = 1e-3 }";
    let cases = [
        (
            "fracture = { criterion = \"rankine\", strength = -1.0 }",
            "bond strength = -1",
        ),
        (
            "fracture = { criterion = \"tresca\", strength = 1.0 }",
            "unknown variant `tresca`",
        ),
        ("fracture = { strength = 1.0 }", "strength needs criterion"),
        (
            "fracture = { criterion = \"energy\" }",
            "needs gc, the fracture energy of the body",
        ),
        ("fracture = { gc = 0.0 }", "fracture energy gc = 0"),
        ("fracture = { gc = -8.0 }", "fracture energy gc = -8"),
        (
            "fracture = { criterion = \"rankine\", gc = 8.0 }",
            "criterion 'rankine' compares stresses, and takes no fracture energy",
        ),
        (
            "fracture = { criterion = \"energy\", gc = 8.0, strength = 10.0 }",
            "gc implies a strength of ",
        ),
        (
            "fracture = { criterion = \"axial\", gc = 8.0, strength = 200e6 }",
            "a strength of 5.00e7 Pa with spheres of ",
        ),
        (
            "fracture = { gc = 8.0, strength = 50e6 }",
            "a strength of 5.00e7 Pa with spheres of ",
        ),
        (
            "fracture = { gc = 8.0, strength = 5e9, softening = true }",
            "J/m2 and strength = 5e9 Pa exclude each other with spheres of mean diameter ",
        ),
        (
            "fracture = { gc = 8.0, softening = true }",
            "softening needs gc, the fracture energy of the body [J/m2], and strength",
        ),
        (
            "fracture = { criterion = \"energy\", gc = 8.0, strength = 1e7, softening = true }",
            "beams that soften have a criterion of their own",
        ),
        (
            "fracture = { criterion = \"axial\", strength = 1.0, weibull = 0.0 }",
            "Weibull modulus = 0",
        ),
        (
            "fracture = { criterion = \"axial\", strength = 1.0, weibull = 5.0, deviation = 0.1 }",
            "weibull and deviation exclude each other",
        ),
        (
            "fracture = { criterion = \"axial\", strength = 1.0, every = 0 }",
            "steps between checks of the bonds = 0",
        ),
        ("contact = { friction = -0.1 }", "friction coefficient = -0.1"),
        (
            "contact = { restitution = 0.01 }",
            "coefficient of restitution = 0.01: must lie in [0.15, 1]",
        ),
        ("contact = { skin = 0.0 }", "skin of the neighbour list = 0"),
        (
            "contact = {}\n[[effect]]\ncontact = {}",
            "model 'grains' has two; keep one",
        ),
        ("obstacle = {}", "missing field `shape`"),
        (
            "obstacle.shape.sphere = { centre = [0.0, 0.0, 0.0], radius = 0.0 }",
            "radius of an obstacle = 0",
        ),
        (
            "bulk_viscosity = {}",
            "no model of the scene can have bulk_viscosity",
        ),
        ("local_damping = { share = 1.0 }", "local damping share = 1"),
        (
            "stiffness_damping = { time = -1.0 }",
            "stiffness damping time = -1",
        ),
        (
            "contact = {}\nfracture = { criterion = \"axial\", strength = 1.0 }",
            "needs exactly one of body_force",
        ),
    ];
    for (effect, expected) in cases {
        assert_refused(&folder, GRAINS, effect, expected);
    }
    let mut moved = format!("obstacle.mass = 1.0\nobstacle.{sphere}");
    moved.push_str("\nobstacle.displacement = { amplitude = [0.0, 0.0, 1.0], time = \"step\" }");
    assert_refused(&folder, GRAINS, &moved, "displacement excludes velocity and mass");
    let driven = format!("obstacle.{sphere}\nobstacle.spin = [0.0, 1.0, 0.0]");
    assert_refused(&folder, GRAINS, &driven, "only a free sphere turns");
    let skin = format!("obstacle.{sphere}\nobstacle.contact.skin = 1.0");
    assert_refused(&folder, GRAINS, &skin, "an obstacle knows no skin");
    let notch = "dem = { count = 200, protocol = \"quench\", notch = [{ low = [9.0, 9.0, 9.0], high = [9.0, 9.0, 9.0] }] }";
    let scene = GRAINS.replace("dem = { count = 200, protocol = \"quench\" }", notch);
    assert_refused(&folder, &scene, "contact = {}", "crosses no bond");
}

#[test]
fn effects_of_solids() {
    let folder = scratch("bad-effects-solids");
    let cases = [
        ("contact = {}", "no model of the scene can have contact"),
        (
            "models = [\"left\"]\nfracture = { criterion = \"axial\", strength = 1.0 }",
            "fracture needs kind = \"dem\", which model 'left' is not",
        ),
        (
            "bulk_viscosity = { coefficient = -1.0 }",
            "bulk viscosity coefficient = -1",
        ),
    ];
    for (effect, expected) in cases {
        assert_refused(&folder, SMALL, effect, expected);
    }
}

/// The plan says which strength a fracture energy implies: with the modulus of the packing where the scene
/// gives its beams, as the largest diameter where they soften; and how many bonds cannot soften.
#[test]
fn what_a_fracture_energy_implies_is_said() {
    let folder = scratch("implied-strength");
    let plan = |dem: &str, fracture: &str| {
        let path = folder.join("scene.toml");
        let scene = GRAINS.replace("protocol = \"quench\"", &format!("protocol = \"quench\"{dem}"));
        std::fs::write(
            &path,
            format!("{scene}\n[[effect]]\nfracture = {{ {fracture} }}\n"),
        )
        .expect("scene");
        let out = arlequin(&["check", text(&path)]);
        let words = String::from_utf8_lossy(&out.stdout)
            .split_whitespace()
            .collect::<Vec<_>>()
            .join(" ");
        words + &String::from_utf8_lossy(&out.stderr)
    };
    let number = |plan: &str, before: &str| -> f64 {
        let behind = plan
            .split(before)
            .nth(1)
            .unwrap_or_else(|| panic!("'{before}' in {plan}"));
        behind
            .split_whitespace()
            .next()
            .and_then(|w| w.parse().ok())
            .expect("a number")
    };
    for dem in ["", ", young = 200e9, radius_ratio = 0.3"] {
        let plan = plan(dem, "gc = 8.0");
        let young = if dem.is_empty() {
            75e9
        } else {
            number(&plan, "a packing of about E =")
        };
        let diameter = number(&plan, "J/m2 with spheres of");
        let strength = number(&plan, "a strength in tension of about");
        let wanted = (young * 8.0 / (std::f64::consts::PI * 0.71 * diameter)).sqrt();
        // Two digits are printed.
        assert!(
            (strength / wanted - 1.0).abs() < 0.06,
            "{strength:e} {wanted:e}: {plan}"
        );
    }
    // `2 E_b gc/(F σ²)`: beams of 3.56 times the modulus of the body.
    let soft = plan("", "gc = 8.0, strength = 60e6, softening = true");
    let largest = number(&soft, "as with any below");
    assert!(
        (largest / (2.0 * 3.56 * 75e9 * 8.0 / (0.78 * 60e6_f64.powi(2))) - 1.0).abs() < 0.01,
        "{soft}"
    );
    assert!(!soft.contains("cannot soften"));
    let scattered = plan("", "gc = 8.0, strength = 60e6, softening = true, weibull = 1.0");
    assert!(number(&scattered, "by their scatter") > 1.0, "{scattered}");
    // The strength of particles over that of the body is measured too.
    let both = plan("", "gc = 8.0, strength = 15e6, criterion = \"hydrostatic\"");
    assert!(
        both.contains("the strength of particles by 'hydrostatic' means about 1.72e7 Pa"),
        "{both}"
    );
    // An impossible strength is named before what it would imply.
    let negative = plan("", "gc = 8.0, strength = -5.0");
    assert!(
        negative.contains("fracture.strength: is -5e0, must be"),
        "{negative}"
    );
}
