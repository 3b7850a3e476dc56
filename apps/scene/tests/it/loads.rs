//! Loads and supports on a body with zones: the acting force is the requested one for any kind of zone.

use arlequin_scene::{Error, Results, Scene, Silent};

const SOLID: &str = "material = { young = 3.0, poisson = 0.2, density = 1.5 }";

/// Returns a bar from 0 to 6 m, 5 m wide, with a zone in the middle of the end face; the overlap separates
/// the zone from the edges.
fn bar(body: &str, zone: &str, tail: &str) -> String {
    format!(
        "[body]\n{body}\nspacing = 1.0\n{SOLID}\nshape.box = {{ low = [0.0, 0.0, 0.0], high = [6.0, 5.0, 5.0] }}\n\
         [zone.tip]\n{zone}\nshape.box = {{ low = [5.1, 2.1, 2.1], high = [99.0, 2.9, 2.9] }}\noverlap.width = 0.95\n{tail}"
    )
}

const FEM: &str = "kind = \"fem\"";
const ZONES: [&str; 3] = [
    "kind = \"fem\"\nspacing = 0.5",
    "kind = \"cnem\"\nspacing = 0.5",
    "kind = \"dem\"\nspacing = 0.5\ndem.protocol = \"quench\"",
];

fn probes(subject: &str) -> String {
    let mut out = String::new();
    for (kind, axis) in [("force", "x"), ("moment", "x")]
        .iter()
        .flat_map(|(k, _)| ["x", "y", "z"].map(|a| (*k, a)))
    {
        out += &format!(
            "[probe.{subject}-{kind}-{axis}]\nof = \"{subject}\"\nquantity = \"{kind}\"\ncomponent = \"{axis}\"\nabout = [0.0, 0.0, 0.0]\n"
        );
    }
    out
}

/// Returns force and moment about the origin of the named load or support at a load step.
fn exerted(results: &Results, subject: &str, step: usize) -> [f64; 6] {
    let value = |kind: &str, axis: &str| {
        results
            .probe(&format!("{subject}-{kind}-{axis}"))
            .expect("a probe")
            .1[step]
    };
    let [x, y, z] = ["x", "y", "z"].map(|a| [value("force", a), value("moment", a)]);
    [x[0], y[0], z[0], x[1], y[1], z[1]]
}

fn run(text: &str) -> Results {
    let built = Scene::from_text(text).and_then(|s| s.prepare());
    let prepared = built.unwrap_or_else(|e| panic!("{e}\n{text}"));
    prepared
        .run(&mut Silent)
        .unwrap_or_else(|e| panic!("{e}\n{text}"))
}

fn refused(text: &str) -> Error {
    let built = Scene::from_text(text).and_then(|s| s.prepare());
    built.err().unwrap_or_else(|| panic!("taken: {text}"))
}

/// Returns the force `f` at a point and a moment, both about the origin.
fn wrench(place: [f64; 3], f: [f64; 3], moment: [f64; 3]) -> [f64; 6] {
    let [x, y, z] = place;
    let arm = [y * f[2] - z * f[1], z * f[0] - x * f[2], x * f[1] - y * f[0]];
    let m = [0, 1, 2].map(|c| arm[c] + moment[c]);
    [f[0], f[1], f[2], m[0], m[1], m[2]]
}

/// Keys of a load, a point \[m\], and the requested force \[N\] and moment \[N m\] about the point.
type Asked = (&'static str, [f64; 3], [f64; 3], [f64; 3]);

/// Loads on the end face with their force and moment: on the whole face, and on a box that cuts through zone
/// and overlap.
const LOADS: [Asked; 7] = [
    (
        "where = \"x-max\"\nforce = [0.02, 0.01, -0.03]",
        [6.0, 2.5, 2.5],
        [0.02, 0.01, -0.03],
        [0.0; 3],
    ),
    (
        "where = \"x-max\"\ntraction = [1e-3, 2e-3, -1e-3]",
        [6.0, 2.5, 2.5],
        [0.025, 0.05, -0.025],
        [0.0; 3],
    ),
    (
        "where = \"x-max\"\npressure = 1e-3",
        [6.0, 2.5, 2.5],
        [-0.025, 0.0, 0.0],
        [0.0; 3],
    ),
    (
        "where = \"x-max\"\ntorque = [0.02, -0.01, 0.03]",
        [6.0, 2.5, 2.5],
        [0.0; 3],
        [0.02, -0.01, 0.03],
    ),
    (
        "where.box = { low = [5.5, 1.0, 2.0], high = [6.5, 5.0, 4.0] }\ntraction = [1e-3, 2e-3, -1e-3]",
        [6.0, 3.0, 3.0],
        [8e-3, 16e-3, -8e-3],
        [0.0; 3],
    ),
    // `∫ y dA` = 62.5 over the face of 5 by 5, about its centre of pressure.
    (
        "where = \"x-max\"\npressure = 1e-3\nprofile = \"y\"",
        [6.0, 10.0 / 3.0, 2.5],
        [-0.0625, 0.0, 0.0],
        [0.0; 3],
    ),
    // The last load acts at t = 1.
    (
        "where = \"x-max\"\npressure = 2e-3\nprofile = \"t/2\"\nprofile_samples = { end = 2.0, count = 4 }",
        [6.0, 2.5, 2.5],
        [-0.025, 0.0, 0.0],
        [0.0; 3],
    ),
];

/// Returns every load of [`LOADS`], each in its own load step.
fn loads() -> String {
    let mut out = String::from("[[support]]\nname = \"bed\"\nmodel = \"body\"\nwhere = \"x-min\"\n");
    for (k, (words, ..)) in LOADS.iter().enumerate() {
        let rows: Vec<String> = (0..=LOADS.len())
            .map(|n| format!("[{}, {}]", n as f64 / LOADS.len() as f64, u8::from(n == k + 1)))
            .collect();
        out += &format!(
            "[[load]]\nmodel = \"body\"\nname = \"push\"\n{words}\ntime = {{ table = [{}] }}\n",
            rows.join(", ")
        );
    }
    out + &probes("bed") + &probes("push") + &format!("[static]\nsteps = {}\n", LOADS.len())
}

#[test]
fn loads_on_a_body_are_what_is_asked_for_whatever_its_zones_are() {
    for body in [FEM, "kind = \"fem\"\nfem.element = \"tet4\"", "kind = \"cnem\""] {
        for zone in ZONES {
            if body != FEM && zone != ZONES[0] {
                continue;
            }
            let results = run(&bar(body, zone, &loads()));
            let mut worst: f64 = 0.0;
            for (k, (words, place, force, moment)) in LOADS.iter().enumerate() {
                let asked = wrench(*place, *force, *moment);
                let size = asked.iter().fold(0.0_f64, |s, x| s.max(x.abs()));
                let [acts, held] = ["push", "bed"].map(|subject| exerted(&results, subject, k));
                for c in 0..6 {
                    let error = (acts[c] - asked[c]).abs().max((held[c] + asked[c]).abs()) / size;
                    worst = worst.max(error);
                    assert!(
                        error < 1e-10,
                        "{body}, {zone}, {words}: {acts:?} and {held:?} for {asked:?}"
                    );
                }
            }
            eprintln!("{body} with {zone}: {worst:e}");
        }
    }
}

#[test]
fn a_support_on_a_body_holds_its_zones_and_gravity_pulls_them() {
    for zone in ZONES {
        let tail = "[[support]]\nname = \"bed\"\nmodel = \"body\"\nwhere = \"x-max\"\n\
                    [[effect]]\nmodels = [\"body\"]\nbody_force.acceleration = [0.01, 0.02, -0.03]\n";
        let tail = tail.to_owned() + &probes("bed") + &probes("body-force") + "[static]\nsteps = 1\n";
        let text = bar(FEM, zone, &tail);
        let results = run(&text);
        // Spheres share their mass by number, not by place, so that the mass in the overlap varies a little.
        let (mass, near) = (1.5 * 6.0 * 25.0, if zone == ZONES[2] { 0.02 } else { 1e-10 });
        let [held, pulled] = ["bed", "body-force"].map(|subject| exerted(&results, subject, 0));
        for (c, g) in [0.01, 0.02, -0.03].into_iter().enumerate() {
            assert!((pulled[c] / (mass * g) - 1.0).abs() < near, "{zone}: {pulled:?}");
            assert!((held[c] / pulled[c] + 1.0).abs() < 1e-10, "{zone}: {held:?}");
        }
        let boxed = text.replace(
            "where = \"x-max\"",
            "where.box = { low = [5.9, -1.0, -1.0], high = [6.1, 6.0, 6.0] }",
        );
        assert_eq!(
            exerted(&run(&boxed), "bed", 0).map(f64::to_bits),
            held.map(f64::to_bits),
            "{zone}"
        );
        let bare = text.replace("models = [\"body\"]\n", "");
        assert_eq!(
            exerted(&run(&bare), "bed", 0).map(f64::to_bits),
            held.map(f64::to_bits),
            "{zone}"
        );
    }
}

#[test]
fn a_zone_has_a_support_of_its_own_where_it_is_given_one() {
    let tail = "[[support]]\nmodel = \"tip\"\nwhere = \"x-max\"\ncomponents = [\"x\", \"y\", \"z\"]\n\
                motion = { amplitude = 1e-3, time.ramp = { duration = 0.5 } }\n\
                [[support]]\nmodel = \"body\"\nwhere = \"x-max\"\ncomponents = [\"x\", \"y\", \"z\"]\n\
                motion = { amplitude = 1e-3, time.ramp = { duration = 0.5 } }\n\
                [[support]]\nmodel = \"body\"\nwhere = \"x-min\"\n[static]\nsteps = 1\n";
    let text = bar(FEM, ZONES[0], tail);
    let zone_support = "[[support]]\nmodel = \"tip\"\nwhere = \"x-max\"\ncomponents = [\"x\", \"y\", \"z\"]\n\
                motion = { amplitude = 1e-3, time.ramp = { duration = 0.5 } }\n";
    let probe = "[probe.end]\nmodel = \"tip\"\nwhere = \"x-max\"\ncomponent = \"x\"\n";
    for text in [text.clone(), text.replace(zone_support, "")] {
        let end = run(&(text + probe)).probe("end").expect("a probe").1[0];
        assert!((end - 1e-3).abs() < 1e-15, "{end:e}");
    }
}

#[test]
fn what_would_act_twice_or_not_at_all_is_refused() {
    let load = "[[load]]\nmodel = \"body\"\nwhere = \"x-max\"\npressure = 1.0\ntime = \"step\"\n";
    let time = "[time]\nsteps = 1\n";
    let twice = format!("{load}{}{time}", load.replace("body", "tip"));
    let e = refused(&bar(FEM, ZONES[0], &twice)).to_string();
    assert!(
        e.starts_with("load[1].model: is on 'tip' where load[0] on 'body' acts already")
            && e.contains("remove this one"),
        "{e}"
    );
    let nowhere = format!("{}{time}", load.replace("x-max", "top"));
    let e = refused(&bar(FEM, ZONES[0], &nowhere)).to_string();
    assert!(
        e.starts_with("load[0].where = 'top': there is no surface of the body") && e.contains("x-max"),
        "{e}"
    );
}

/// A load of the explicit form acts on one model; a warning states the share that is lost in the overlap.
#[test]
fn what_an_overlap_takes_of_a_load_on_one_model_is_told() {
    let models = format!(
        "[model.left]\nkind = \"fem\"\nrole = \"coarse\"\nspacing = 1.0\n{SOLID}\n\
         shape.box = {{ low = [0.0, 0.0, 0.0], high = [6.0, 2.0, 2.0] }}\n\
         [model.right]\nkind = \"fem\"\nrole = \"fine\"\nspacing = 0.5\n{SOLID}\n\
         shape.box = {{ low = [3.0, 0.0, 0.0], high = [8.0, 2.0, 2.0] }}\n\
         [interface.joint]\ncoarse = \"left\"\nfine = \"right\"\nweight.profile = \"linear\"\n\
         overlap.slab = {{ coarse = [3.0, 0.0, 0.0], fine = [6.0, 0.0, 0.0] }}\n[time]\nsteps = 1\n"
    );
    let load_warnings = |loads: &str| {
        let scene = Scene::from_text(format!("{models}{loads}")).expect("a scene");
        let built = arlequin_scene::setup::build(scene.spec(), scene.folder()).expect("built");
        let texts = built.warnings.into_iter().filter(|w| w.starts_with("load["));
        texts.collect::<Vec<_>>()
    };
    let load = |model: &str, what: &str| {
        format!("[[load]]\nmodel = \"{model}\"\nwhere = \"z-max\"\n{what}\ntime = \"step\"\n")
    };
    // A quarter of the load on `left` is lost: half of the surface lies in the overlap, where the mean weight
    // is a half.
    for what in ["traction = [0.0, 0.0, 1e-3]", "pressure = 1e-3"] {
        let texts = load_warnings(&load("left", what));
        assert!(
            texts.len() == 1 && texts[0].contains("25.0 % is lost"),
            "{texts:?}"
        );
        assert_eq!(
            load_warnings(&(load("left", what) + &load("right", what))),
            Vec::<String>::new()
        );
    }
    // A moment acts by the squares of the lever arms: along x an eighth more is lost than by the mean weights
    // on half of the face.
    let texts = load_warnings(&load("left", "torque = [0.0, 1.0, 0.0]"));
    assert!(texts.len() == 1 && texts[0].contains("N m act"), "{texts:?}");
}
