//! An obstacle on a whole body: a ball that misses the zone, or strikes its border, rebounds.

use arlequin_scene::{Results, Scene, Silent};
use std::path::Path;

/// Runs a scene.
fn run(text: &str) -> Results {
    let scene = Scene::from_text(text).unwrap_or_else(|e| panic!("{e}"));
    let prepared = scene.prepare().unwrap_or_else(|e| panic!("{e}"));
    prepared.run(&mut Silent).unwrap_or_else(|e| panic!("{e}"))
}

/// Runs the shipped scene with the ball above `x` \[m\] and with other replacements.
fn struck(x: f64, changes: &[(&str, &str)]) -> Results {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/scenes/ball-beside-zone.toml");
    let mut text = std::fs::read_to_string(path).expect("scene");
    let centre = format!("centre = [{x:e}, 0.3e-3, 2.01e-3]");
    for (from, to) in [&[("centre = [3e-3, 0.3e-3, 2.01e-3]", &*centre)], changes].concat() {
        assert!(text.contains(from), "{from}");
        text = text.replace(from, to);
    }
    run(&text)
}

/// Largest force \[N\] and impulse \[N s\] on the body.
fn blow(results: &Results) -> [f64; 2] {
    let (times, forces) = results.probe("ball").expect("probe");
    let peak = forces.iter().fold(0.0_f64, |m, f| m.max(-f));
    let steps = times.windows(2).zip(forces.windows(2));
    [
        peak,
        steps.map(|(t, f)| -0.5 * (t[1] - t[0]) * (f[0] + f[1])).sum(),
    ]
}

/// The ball bounces off elements, particles and the border between them: the elastic blow takes between one
/// and two times its momentum, and the rebound is alike.
#[test]
fn a_ball_rebounds_beside_a_zone_on_it_and_on_its_border() {
    let momentum = 8e-5 * 10.0;
    let blows = [3e-3, -3e-3, -1e-3].map(|x| {
        let results = struck(x, &[]);
        let inside = results
            .summary()
            .warnings
            .iter()
            .find(|w| w.contains("is inside the"));
        assert!(inside.is_none(), "{inside:?}");
        let blow = blow(&results);
        assert!(
            blow[1] > 1.3 * momentum && blow[1] < 2.0 * momentum,
            "{x}: {blow:?}"
        );
        blow
    });
    // On the border, the particles, the elements and the multipliers all act on one ball.
    let created = struck(-1e-3, &[]).summary().energy.created_max;
    assert!(created < 1e-12, "{created:e}");
    for blow in &blows[1..] {
        assert!((blow[1] / blows[0][1] - 1.0).abs() < 0.1, "{blows:?}");
    }
}

/// By default an obstacle acts on particles alone, and the run says that the ball enters the elements.
#[test]
fn an_obstacle_that_names_no_elements_does_not_touch_them() {
    let results = struck(
        3e-3,
        &[("models = [\"body\"]\n", ""), ("end = 40e-6", "end = 10e-6")],
    );
    assert!(blow(&results)[0] <= 0.0);
    let warnings = &results.summary().warnings;
    let inside = warnings
        .iter()
        .find(|w| w.contains("is inside the elements of model 'body'"));
    assert!(
        inside
            .expect("a warning")
            .contains("name 'body' in the models of effect[0]")
    );
}

/// Text of an STL file of some triangles.
fn stl(triangles: &[[[f64; 3]; 3]]) -> String {
    let corner = |[x, y, z]: &[f64; 3]| format!("vertex {x:e} {y:e} {z:e}\n");
    let facet = |t: &[[f64; 3]; 3]| {
        let corners: String = t.iter().map(corner).collect();
        format!("facet normal 0 0 0\nouter loop\n{corners}endloop\nendfacet\n")
    };
    let facets: String = triangles.iter().map(facet).collect();
    format!("solid tool\n{facets}endsolid tool\n")
}

/// Triangles of a cube with corners at ±1, clockwise from outside.
fn inverted_cube() -> Vec<[[f64; 3]; 3]> {
    let mut out = Vec::new();
    for c in 0..3 {
        for side in [-1.0, 1.0] {
            let corner = |u: f64, v: f64| {
                let mut x = [0.0; 3];
                (x[c], x[(c + 1) % 3], x[(c + 2) % 3]) = (side, side * u, v);
                x
            };
            let [p, q, r, s] =
                [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[u, v]| corner(u, v));
            out.extend([[p, r, q], [p, s, r]]);
        }
    }
    out
}

/// Triangles of a ball of radius one: the cube's, divided and pushed out.
fn ball(divisions: usize) -> Vec<[[f64; 3]; 3]> {
    let mut triangles = inverted_cube();
    for _ in 0..divisions {
        let middle = |a: [f64; 3], b: [f64; 3]| [0, 1, 2].map(|c: usize| 0.5 * (a[c] + b[c]));
        let quarters = |[a, b, c]: [[f64; 3]; 3]| {
            let [d, e, f] = [middle(a, b), middle(b, c), middle(c, a)];
            [[a, d, f], [d, b, e], [f, e, c], [d, e, f]]
        };
        triangles = triangles.into_iter().flat_map(quarters).collect();
    }
    let out = |x: [f64; 3]| {
        let size = (x[0] * x[0] + x[1] * x[1] + x[2] * x[2]).sqrt();
        x.map(|c| c / size)
    };
    triangles.into_iter().map(|t| t.map(out)).collect()
}

/// Runs the ball of the shipped scene with another shape, in a folder that has `tool.stl`. Returns the blow.
fn struck_by(shape: &str, triangles: &[[[f64; 3]; 3]]) -> Result<[f64; 2], String> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("stl");
    std::fs::create_dir_all(&folder).expect("folder");
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/scenes/ball-beside-zone.toml");
    let text = std::fs::read_to_string(path).expect("scene");
    // The body alone, and a ball that does not turn, as other shapes do not.
    let zone = text.find("[zone.struck]").expect("zone")..text.find("[[support]]").expect("support");
    let text = text.replace(&text[zone], "");
    let given = "shape.sphere = { centre = [3e-3, 0.3e-3, 2.01e-3], radius = 2e-3 }";
    assert!(text.contains(given));
    let text = text.replace(given, shape).replace("friction = 0.2, ", "");
    std::fs::write(folder.join("tool.stl"), stl(triangles)).expect("STL");
    let file = folder.join("scene.toml");
    std::fs::write(&file, text).expect("scene");
    let scene = Scene::read(&file).map_err(|e| e.to_string())?;
    let prepared = scene.prepare().map_err(|e| e.to_string())?;
    let results = prepared.run(&mut Silent).map_err(|e| e.to_string())?;
    Ok(blow(&results))
}

/// A closed STL file is a rigid body: a box of triangles strikes as the exact box, a ball of 3 072 triangles
/// as the exact ball within their flatness. Triangles that look inwards are turned; an open surface is
/// refused.
#[test]
fn a_closed_surface_strikes_as_the_exact_shape() {
    let solid = "shape.solid = { file = \"tool.stl\", scale = 2e-3, shift = [3e-3, 0.3e-3, 2.01e-3] }";
    for (exact, triangles, tolerance) in [
        (
            "shape.box = { centre = [3e-3, 0.3e-3, 2.01e-3], size = [4e-3, 4e-3, 4e-3] }",
            inverted_cube(),
            1e-5,
        ),
        (
            "shape.sphere = { centre = [3e-3, 0.3e-3, 2.01e-3], radius = 2e-3 }",
            ball(4),
            0.02,
        ),
    ] {
        let expected = struck_by(exact, &triangles).expect("exact");
        let found = struck_by(solid, &triangles).expect("triangles");
        for (a, b) in expected.iter().zip(found) {
            assert!((b / a - 1.0).abs() < tolerance, "{exact}: {expected:?} {found:?}");
        }
    }
    let open = struck_by(solid, &inverted_cube()[1..]).expect_err("open");
    assert!(open.contains("effect[0].obstacle.shape.solid.file"), "{open}");
}

/// A ball of radius 60 mm pressed into a block of elements by 0.27 mm, with a zone of spheres or without one.
/// Its centre is above `x` \[m\].
fn pressed(x: f64, with_zone: bool) -> f64 {
    let zone = "[zone.struck]
kind = \"dem\"
spacing = 0.6e-3
shape.ball = { centre = [0.0, 0.0, 0.0], radius = 6e-3 }
overlap.width = 3.55e-3
dem.protocol = \"quench\"
";
    let text = format!(
        "[body]
kind = \"fem\"
shape.box = {{ low = [-14e-3, -14e-3, -14e-3], high = [14e-3, 14e-3, 0.0] }}
spacing = 1e-3
material = {{ young = 72.5e9, poisson = 0.174, density = 2200.0 }}
{}
[[support]]
model = \"body\"
where = \"z-min\"

[[effect]]
mass_damping = {{ rate = 4e5 }}

[[effect]]
models = [\"body\"]
[effect.obstacle]
name = \"ball\"
shape.sphere = {{ centre = [{x:e}, 0.0, 60e-3], radius = 60e-3 }}
displacement = {{ amplitude = [0.0, 0.0, -0.267e-3], time.ramp = {{ duration = 25e-6 }} }}
contact = {{ modulus = 725e9 }}

[time]
end = 45e-6

[output]
interval = 45e-6

[probe.ball]
of = \"ball\"
quantity = \"force\"
component = \"z\"
",
        if with_zone { zone } else { "" }
    );
    let results = run(&text);
    let (_, forces) = results.probe("ball").expect("probe");
    *forces.last().expect("force")
}

/// The force of a ball, which is that of Hertz on elements, is the same on particles and on the border
/// between them and the elements.
#[test]
#[ignore = "two minutes"]
fn a_ball_feels_the_same_force_on_elements_particles_and_the_border_between_them() {
    for x in [0.0, 6e-3] {
        let [elements, zone] = [false, true].map(|with_zone| pressed(x, with_zone));
        assert!(
            (zone / elements - 1.0).abs() < 0.02,
            "{x}: {zone} N, {elements} N"
        );
    }
}

/// A cube of 4 mm falls on a floor, corner first, at 20 m/s: a body with a zone at that corner, or particles
/// alone. The floor gives it nearly twice its momentum, and no energy is created.
#[test]
fn a_body_with_a_zone_and_a_packing_fall_on_a_floor_corner_first() {
    let shape = "shape.box = { low = [0.0, 0.0, 0.0], high = [4e-3, 4e-3, 4e-3] }
material = { young = 72.5e9, poisson = 0.17, density = 2200.0 }
";
    let zone = "[zone.corner]
kind = \"dem\"
spacing = 0.5e-3
shape.ball = { centre = [0.0, 0.0, 0.0], radius = 1.2e-3 }
overlap.width = 1.8e-3
dem.protocol = \"quench\"
";
    let with_zone = format!("[body]\nkind = \"fem\"\nspacing = 0.8e-3\n{shape}{zone}");
    let particles = format!("[model.body]\nkind = \"dem\"\nspacing = 0.5e-3\n{shape}");
    let effects = "
[[initial]]
velocity.uniform = [-11.5, -11.5, -11.5]

[[effect]]
models = [\"body\"]
[effect.obstacle]
name = \"floor\"
shape.plane = { point = [-1e-5, -1e-5, -1e-5], normal = [1.0, 1.0, 1.0] }
contact = { restitution = 1.0 }

[time]
end = 40e-6

[probe.floor]
of = \"floor\"
quantity = \"force\"
component = \"x\"
";
    let momentum = 11.5 * 2200.0 * 4e-3_f64.powi(3);
    for (name, models) in [("zone", with_zone), ("particles", particles)] {
        let results = run(&format!("{models}{effects}"));
        let (times, forces) = results.probe("floor").expect("floor");
        let steps = times.windows(2).zip(forces.windows(2));
        let impulse: f64 = steps.map(|(t, f)| 0.5 * (t[1] - t[0]) * (f[0] + f[1])).sum();
        let (ratio, created) = (impulse / momentum, results.summary().energy.created_max);
        // The mass of spheres at the surface is that of the shape within a per cent.
        assert!(ratio > 1.8 && ratio < 2.02, "{name}: {ratio}");
        assert!(created < 1e-12, "{name}: {created:e}");
        let warnings = &results.summary().warnings;
        let inside = warnings.iter().find(|w| w.contains("is inside the"));
        assert!(inside.is_none(), "{name}: {inside:?}");
    }
}

/// A body with a zone of finer elements falls flat on a floor, without losses in the law: contacts of both
/// models open and close at once over the overlap, and the multipliers between them act on each contact one
/// step late. What this creates, contacts repay before they give anything back.
#[test]
fn a_body_with_a_zone_of_elements_that_falls_flat_creates_no_energy() {
    for spacing in ["0.3e-3", "0.25e-3"] {
        let results = run(&format!(
            "[body]
kind = \"fem\"
shape.box = {{ low = [-3e-3, -3e-3, -3e-3], high = [3e-3, 3e-3, 0.0] }}
spacing = 0.6e-3
material = {{ young = 72.5e9, poisson = 0.17, density = 2200.0 }}
[zone.z]
kind = \"fem\"
spacing = {spacing}
shape.ball = {{ centre = [0.0, 0.0, 0.0], radius = 0.6e-3 }}
overlap.width = 1.8e-3
[[effect]]
models = [\"body\"]
obstacle = {{ name = \"floor\", shape.plane = {{ point = [0.0, 0.0, 5e-6], normal = [0.0, 0.0, -1.0] }}, contact.restitution = 1.0 }}
[[initial]]
velocity.uniform = [0.0, 0.0, 10.0]
[time]
end = 8e-6
"
        ));
        let energy = &results.summary().energy;
        assert!(energy.created_max < 1e-12, "{spacing}: {:e}", energy.created_max);
        assert!(
            energy.last > 0.99 * energy.initial,
            "{spacing}: {} J",
            energy.last
        );
    }
}

/// Errors of contact between two models name the effect.
#[test]
fn bodies_that_start_in_each_other_are_refused_at_the_effect() {
    let block = |name: &str, low: f64, high: f64| {
        format!(
            "[model.{name}]
kind = \"fem\"
shape.box = {{ low = [{low}, {low}, {low}], high = [{high}, {high}, {high}] }}
spacing = {}
material = {{ young = 72.5e9, poisson = 0.17, density = 2200.0 }}
",
            (high - low) / 4.0
        )
    };
    let text = format!(
        "{}{}[[effect]]\nbetween = [\"outer\", \"inner\"]\ncontact = {{}}\n[time]\nend = 1e-7\n",
        block("outer", -2e-3, 2e-3),
        block("inner", -0.5e-3, 0.5e-3)
    );
    let refused = Scene::from_text(&text).and_then(|s| s.prepare());
    let Err(e) = refused else {
        panic!("the scene is taken");
    };
    assert_eq!(e.place().0, Some("effect[0].between"), "{e}");
    assert!(e.to_string().contains("must not lie in each other"), "{e}");
}

/// A flat elastic fall of two blocks on each other: a contact as stiff as the material gives back what it
/// took in, a contact a thousand times softer does not, and the run says so.
#[test]
fn a_run_says_when_elastic_contacts_keep_energy() {
    for (modulus, says) in [("72.5e9", false), ("1e8", true)] {
        let results = run(&format!(
            "[model.upper]
kind = \"fem\"
shape.box = {{ low = [-0.45e-3, -0.47e-3, 1.005e-3], high = [0.45e-3, 0.43e-3, 1.905e-3] }}
spacing = 0.225e-3
material = {{ young = 72.5e9, poisson = 0.17, density = 2200.0 }}
[model.lower]
kind = \"fem\"
shape.box = {{ low = [-1e-3, -1e-3, 0.0], high = [1e-3, 1e-3, 1e-3] }}
spacing = 0.25e-3
material = {{ young = 72.5e9, poisson = 0.17, density = 2200.0 }}
[[initial]]
models = [\"upper\"]
velocity.uniform = [0.0, 0.0, -60.0]
[[effect]]
between = [\"lower\", \"upper\"]
contact = {{ restitution = 1.0, friction = 0.0, modulus = {modulus} }}
[time]
end = {}
",
            if says { "45e-6" } else { "2e-6" }
        ));
        let energy = &results.summary().energy;
        let lost = 1.0 - energy.last / energy.initial;
        assert_eq!(lost > 0.05, says, "modulus {modulus}: {lost}");
        let warnings = &results.summary().warnings;
        let found = warnings.iter().any(|w| w.contains("elastic contacts lost"));
        assert_eq!(found, says, "{warnings:?}");
    }
}
