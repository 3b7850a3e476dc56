//! Tractions and pressures on the surface of particles have the prescribed force and moment.

use arlequin_scene::{Error, Results, Scene, Silent};
use std::f64::consts::PI;

/// A model of spheres without supports, with these keys of its shape.
fn grains(shape: &str, loads: &str) -> String {
    let mut out = format!(
        "[model.rock]\nkind = \"dem\"\nshape.{shape}\nspacing = 0.5\ndem.protocol = \"quench\"\n\
         material = {{ young = 3.0, poisson = 0.17, density = 1.5 }}\n{loads}[time]\nsteps = 1\n"
    );
    for (kind, axis) in ["force", "moment"]
        .iter()
        .flat_map(|k| ["x", "y", "z"].map(|a| (*k, a)))
    {
        out += &format!(
            "[probe.{kind}-{axis}]\nof = \"push\"\nquantity = \"{kind}\"\ncomponent = \"{axis}\"\nabout = [0.0, 0.0, 0.0]\n"
        );
    }
    out
}

fn load(place: &str, what: &str) -> String {
    format!("[[load]]\nname = \"push\"\nmodel = \"rock\"\nwhere{place}\n{what}\ntime = \"step\"\n")
}

fn prepared(text: &str) -> Result<arlequin_scene::Prepared, Error> {
    Scene::from_text(text).and_then(|s| s.prepare())
}

/// Returns force and moment about the origin of the load named `push`.
fn exerted(text: &str) -> [f64; 6] {
    let results: Results = prepared(text)
        .and_then(|p| p.run(&mut Silent))
        .unwrap_or_else(|e| panic!("{e}\n{text}"));
    let value = |kind: &str, axis: &str| results.probe(&format!("{kind}-{axis}")).expect("a probe").1[0];
    let [x, y, z] = ["x", "y", "z"].map(|a| [value("force", a), value("moment", a)]);
    [x[0], y[0], z[0], x[1], y[1], z[1]]
}

fn refused(text: &str) -> String {
    prepared(text)
        .err()
        .unwrap_or_else(|| panic!("taken: {text}"))
        .to_string()
}

/// Returns a force at a point as force and moment about the origin.
fn wrench([x, y, z]: [f64; 3], f: [f64; 3]) -> [f64; 6] {
    let arm = [y * f[2] - z * f[1], z * f[0] - x * f[2], x * f[1] - y * f[0]];
    [f[0], f[1], f[2], arm[0], arm[1], arm[2]]
}

fn assert_same(text: &str, asked: [f64; 6], tolerance: f64) {
    let acts = exerted(text);
    let size = asked.iter().fold(0.0_f64, |s, x| s.max(x.abs()));
    for c in 0..6 {
        assert!(
            (acts[c] - asked[c]).abs() < tolerance * size,
            "{acts:?} for {asked:?}\n{text}"
        );
    }
}

const BLOCK: &str = "box = { low = [0.0, 0.0, 0.0], high = [4.0, 3.0, 2.0] }";

#[test]
fn a_face_of_spheres_carries_the_traction_that_is_asked_for() {
    let traction = |place: &str| grains(BLOCK, &load(place, "traction = [1e-3, 2e-3, -1e-3]"));
    let pressure = |place: &str| grains(BLOCK, &load(place, "pressure = 1e-3"));
    let part = ".box = { low = [3.0, 0.5, -1.0], high = [4.5, 2.0, 1.5] }";
    let middle = ".box = { low = [3.9, -1.0, -1.0], high = [4.1, 9.0, 9.0] }";
    for (text, point, force) in [
        (traction(" = \"x-max\""), [4.0, 1.5, 1.0], [6e-3, 12e-3, -6e-3]),
        (pressure(" = \"x-max\""), [4.0, 1.5, 1.0], [-6e-3, 0.0, 0.0]),
        (pressure(" = \"y-min\""), [2.0, 0.0, 1.0], [0.0, 8e-3, 0.0]),
        // A box cuts a part out of the face, and leaves the rims of the others alone.
        (traction(middle), [4.0, 1.5, 1.0], [6e-3, 12e-3, -6e-3]),
    ] {
        assert_same(&text, wrench(point, force), 1e-10);
    }
    // A box two spheres deep loads the part of each face that it holds: here x-max and
    // z-min.
    let x = wrench([4.0, 1.25, 0.75], [2.25e-3, 4.5e-3, -2.25e-3]);
    let z = wrench([3.5, 1.25, 0.0], [1.5e-3, 3e-3, -1.5e-3]);
    let sum: Vec<f64> = x.iter().zip(&z).map(|(a, b)| a + b).collect();
    assert_same(&traction(part), [0, 1, 2, 3, 4, 5].map(|c| sum[c]), 1e-10);
}

/// The spheres near the load carry it, not those of the rest of the body.
#[test]
fn a_pressure_bends_no_more_than_its_own_face() {
    let held = "[[support]]\nmodel = \"rock\"\nwhere = \"x-min\"\n[static]\nsteps = 1\n\
                [probe.end]\nmodel = \"rock\"\nwhere = \"x-max\"\ncomponent = \"x\"\n\
                [probe.side]\nmodel = \"rock\"\nwhere = \"y-max\"\ncomponent = \"y\"\n";
    let bar = |what: &str| {
        grains(
            "box = { low = [0.0, 0.0, 0.0], high = [8.0, 3.0, 3.0] }",
            &load(" = \"x-max\"", what),
        )
        .replace("[time]\nsteps = 1\n", held)
    };
    let results = prepared(&bar("pressure = -3e-3"))
        .and_then(|p| p.run(&mut Silent))
        .expect("at rest");
    let end = |results: &Results| results.probe("end").expect("a probe").1[0];
    // Strain of the whole length over stress. Supports hold the layer of spheres that touches a face, so that
    // the length which strains is a diameter shorter; packings of the quench protocol are stiffer.
    let strain = end(&results) / 8.0 / 1e-3;
    assert!((0.75..1.1).contains(&strain), "{strain}");
    let by_mass = prepared(&bar("force = [27e-3, 0.0, 0.0]"))
        .and_then(|p| p.run(&mut Silent))
        .expect("at rest");
    assert!((end(&by_mass) / end(&results) - 1.0).abs() < 0.1);
}

#[test]
fn round_and_read_surfaces_carry_pressures_too() {
    let bar = "cylinder = { from = [1.0, 2.0, 0.0], length = 4.0, radius = 1.5 }";
    let end = grains(bar, &load(" = \"x-max\"", "pressure = 1e-3"));
    assert_same(
        &end,
        wrench([5.0, 2.0, 0.0], [-1e-3 * PI * 2.25, 0.0, 0.0]),
        1e-10,
    );
    // The upper half of the mantle has the pressure of its projection.
    let half = grains(
        bar,
        &load(
            ".box = { low = [0.0, 0.0, 0.0], high = [9.0, 9.0, 9.0] }",
            "pressure = 1e-3",
        ),
    );
    let asked = wrench([3.0, 2.0, 0.0], [0.0, 0.0, -1e-3 * 4.0 * 3.0]);
    assert_same(&half, asked, 1e-3);
    let ball = "ball = { centre = [0.0, 0.0, 0.0], radius = 2.0 }";
    let cap = grains(
        ball,
        &load(
            ".box = { low = [-9.0, -9.0, 0.0], high = [9.0, 9.0, 9.0] }",
            "pressure = 1e-3",
        ),
    );
    let acts = exerted(&cap);
    assert!((acts[2] / (-1e-3 * PI * 4.0) - 1.0).abs() < 0.02, "{acts:?}");
}

#[test]
fn surfaces_without_spheres_are_refused_by_name() {
    let inner = load(
        ".box = { low = [1.5, 1.2, 0.8], high = [2.5, 1.8, 1.2] }",
        "pressure = 1.0",
    );
    let e = refused(&grains(BLOCK, &inner));
    assert!(
        e.starts_with("load[0].where: box") && e.contains("holds no surface of model 'rock'"),
        "{e}"
    );
    let e = refused(&grains(BLOCK, &load(" = \"top\"", "pressure = 1.0")));
    assert!(
        e.starts_with("load[0].where = 'top'") && e.contains("x-max"),
        "{e}"
    );
    // Spheres of a file fill a part of the shape only.
    let folder = std::path::PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("surface-loads");
    std::fs::create_dir_all(&folder).expect("a folder");
    let mut rows = String::new();
    for k in 0..64 {
        let place = |n: i32| 0.3 + 0.52 * f64::from(n);
        rows += &format!(
            "{:?},{:?},{:?},0.26\n",
            place(k % 4),
            place(k / 4 % 4),
            place(k / 16)
        );
    }
    let path = folder.join("spheres.csv");
    std::fs::write(&path, &rows).expect("spheres");
    let text = grains(BLOCK, &load(" = \"x-max\"", "pressure = 1.0"));
    let text = text.replace(
        "spacing = 0.5\ndem.protocol = \"quench\"",
        &format!(
            "dem.file = {:?}\ndem.coordination = 4.0",
            path.display().to_string()
        ),
    );
    let e = refused(&text);
    assert!(e.contains("no sphere of model 'rock' touches 'x-max'"), "{e}");
    // One sphere carries no moment.
    for x in [2.38, 2.9, 3.42, 3.735] {
        rows += &format!("{x:?},0.3,0.3,0.26\n");
    }
    std::fs::write(&path, rows).expect("spheres");
    let e = refused(&text.replace("coordination = 4.0", "coordination = 4.35"));
    assert!(e.contains("too few spheres of model 'rock' touch 'x-max'"), "{e}");
}

/// The force of a load needs no centre of a sphere in its box, which holds the surface alone.
#[test]
fn the_force_on_a_thin_box_is_read() {
    let face = ".box = { low = [3.9, 0.5, -1.0], high = [4.1, 2.5, 3.0] }";
    let text = grains(BLOCK, &load(face, "pressure = 1e-3")).replace("about = [0.0, 0.0, 0.0]\n", "");
    let moments = text.find("[probe.moment-x]").expect("probes of moments");
    let ready = prepared(&text[..moments]).unwrap_or_else(|e| panic!("{e}"));
    let results = ready.run(&mut Silent).expect("a run");
    let force = results.probe("force-x").expect("a probe").1[0];
    assert!((force / -4e-3 - 1.0).abs() < 1e-9, "{force}");
}

/// A pressure with a profile has the force and moment of its integral over the face, and acts where the
/// profile says.
#[test]
fn a_pressure_may_have_a_profile() {
    let spot = |profile: &str| {
        grains(
            BLOCK,
            &load(
                " = \"x-max\"",
                &format!("pressure = 1e-3\nprofile = \"{profile}\""),
            ),
        )
    };
    // `∫ y dA` = 9, `∫ y² dA` = 18 and `∫ y z dA` = 9 over the face of 3 by 2.
    let linear = spot("y");
    assert_same(&linear, [-9e-3, 0.0, 0.0, 0.0, -9e-3, 18e-3], 1e-2);
    // On elements, two across, the moment is that of the profile, too.
    let solid = |kind: &str| {
        let text = linear
            .replace("\"dem\"", kind)
            .replace("spacing = 0.5", "spacing = 1.5");
        text.replace("dem.protocol = \"quench\"\n", "")
    };
    assert_same(&solid("\"fem\""), [-9e-3, 0.0, 0.0, 0.0, -9e-3, 18e-3], 1e-9);
    let tetrahedra = solid("\"fem\"\nfem.element = \"tet4\"");
    assert_same(&tetrahedra, [-9e-3, 0.0, 0.0, 0.0, -9e-3, 18e-3], 1e-9);
    // A strip a quarter as high: pressure on `y < 0.75`.
    let strip = spot("step(0.75 - y)");
    assert_same(&strip, [-1.5e-3, 0.0, 0.0, 0.0, -1.5e-3, 0.5625e-3], 5e-2);
    let body = spot("y").replace("pressure = 1e-3", "force = [1.0, 0.0, 0.0]");
    assert!(refused(&body).contains("load[0].profile: is that of a traction or a pressure"));
    for (profile, words) in [
        ("u", "knows no 'u'; it knows x, y and z, the place in m, and t"),
        ("t", "load[0].profile_samples: is missing"),
        ("step(y - 9)", "is zero on the whole surface"),
        (
            "exp(-((y - 1.31)^2 + (z - 0.93)^2)/0.03^2)",
            "changes too much within the facets",
        ),
        // Two spots whose errors cancel, and a wave that the facets read at its crests.
        (
            "exp(-((y - 0.81)^2 + (z - 0.93)^2)/0.03^2) - exp(-((y - 2.21)^2 + (z - 0.93)^2)/0.03^2)",
            "changes too much within the facets",
        ),
        ("1 + cos(16*pi*y/0.25)", "changes too much within the facets"),
        ("1/(x - 4)", "load[0].profile"),
        ("y +", "ends where"),
    ] {
        let message = refused(&spot(profile));
        assert!(
            message.contains(words) && message.contains("load[0].profile"),
            "{message}"
        );
    }
}

/// A spot that runs along the face has the same force at all times, and its centre runs with it, on spheres
/// and on finite elements.
#[test]
fn a_profile_may_change_with_time() {
    let spot = |kind: &str, samples: &str| {
        let keys =
            format!("pressure = 1e-3\nprofile = \"exp(-(y - 1.0 - 2*t)^2/0.1)*(1 + 0*tan(t))\"\n{samples}");
        let text = grains(BLOCK, &load(" = \"x-max\"", &keys)).replace("steps = 1", "end = 0.5");
        match kind {
            "fem" => text
                .replace("\"dem\"", "\"fem\"")
                .replace("spacing = 0.5", "spacing = 0.25")
                .replace("dem.protocol = \"quench\"\n", ""),
            _ => text,
        }
    };
    for kind in ["dem", "fem"] {
        let text = spot(kind, "profile_samples = { end = 0.8, count = 33 }");
        let ready = prepared(&text).unwrap_or_else(|e| panic!("{e}\n{text}"));
        let results = ready.run(&mut Silent).expect("a run");
        let column = |name: &str| results.probe(name).expect("a probe");
        let (times, force) = column("force-x");
        let (_, moment) = column("moment-z");
        // `∫ exp(−s²/0.1) ds` over the face of height 2.
        let wanted = -1e-3 * 2.0 * (0.1 * PI).sqrt();
        assert!(times.len() > 2, "{kind}: {times:?}");
        for ((t, f), m) in times.iter().zip(force).zip(moment) {
            assert!((f / wanted - 1.0).abs() < 0.03, "{kind}: {f} for {wanted} at {t}");
            let centre = -m / f;
            assert!((centre - 1.0 - 2.0 * t).abs() < 0.03, "{kind}: {centre} at {t}");
        }
    }
    for (samples, words) in [
        (
            "profile_samples = { end = 0.5, count = 1 }",
            "profile_samples.count",
        ),
        (
            "profile_samples = { end = 0.0, count = 5 }",
            "profile_samples.end",
        ),
        (
            "profile_samples = { end = 0.5, count = 3 }",
            "is too small: straight lines",
        ),
    ] {
        let message = refused(&spot("fem", samples));
        assert!(message.contains(words), "{message}");
    }
    let still = spot("fem", "profile_samples = { end = 0.8, count = 33 }")
        .replace("2*t", "2")
        .replace("tan(t)", "1");
    assert!(refused(&still).contains("is for a profile with t"));
}

/// Where a notch has taken half of a face, a traction on the whole face loads the other half with all of it.
#[test]
fn a_face_that_a_notch_has_taken_is_told() {
    let pressed = |notch: &str| {
        let text = grains(BLOCK, &load(" = \"x-max\"", "pressure = 1e-3"));
        let text = text.replace("spacing = 0.5", &format!("spacing = 0.25{notch}"));
        prepared(&text).expect("a scene").warnings().to_vec()
    };
    let told = |warnings: &[String]| {
        warnings
            .iter()
            .any(|w| w.contains("load[0]: ") && w.contains("has no sphere"))
    };
    assert!(!told(&pressed("")));
    let half = pressed("\ndem.notch = [{ low = [3.0, -1.0, -1.0], high = [5.0, 1.5, 3.0] }]");
    assert!(told(&half), "{half:?}");
}
