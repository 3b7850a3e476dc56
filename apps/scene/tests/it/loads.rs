//! Loads and supports on a body with zones: what acts is what is asked for, whatever fills the zones.

use arlequin_scene::{Error, Results, Scene, Silent};

const SOLID: &str = "material = { young = 3.0, poisson = 0.2, density = 1.5 }";

/// A bar from 0 to 6 m, 5 m wide, with a zone in the middle of the end face that the overlap parts from its
/// edges.
fn bar(body: &str, zone: &str, rest: &str) -> String {
    format!(
        "[body]\n{body}\nspacing = 1.0\n{SOLID}\nshape.box = {{ low = [0.0, 0.0, 0.0], high = [6.0, 5.0, 5.0] }}\n\
         [zone.tip]\n{zone}\nshape.box = {{ low = [5.1, 2.1, 2.1], high = [99.0, 2.9, 2.9] }}\noverlap.width = 0.95\n{rest}"
    )
}

const FEM: &str = "kind = \"fem\"";
const ZONES: [&str; 3] = [
    "kind = \"fem\"\nspacing = 0.5",
    "kind = \"cnem\"\nspacing = 0.5",
    "kind = \"dem\"\nspacing = 0.5\ndem.protocol = \"quench\"",
];

fn probes(of: &str) -> String {
    let mut out = String::new();
    for (kind, axis) in [("force", "x"), ("moment", "x")]
        .iter()
        .flat_map(|(k, _)| ["x", "y", "z"].map(|a| (*k, a)))
    {
        out += &format!(
            "[probe.{of}-{kind}-{axis}]\nof = \"{of}\"\nquantity = \"{kind}\"\ncomponent = \"{axis}\"\nabout = [0.0, 0.0, 0.0]\n"
        );
    }
    out
}

/// Force and moment about the origin of what bears a name, at a load step.
fn exerted(results: &Results, of: &str, step: usize) -> [f64; 6] {
    let one =
        |kind: &str, axis: &str| results.probe(&format!("{of}-{kind}-{axis}")).expect("a probe").1[step];
    let [x, y, z] = ["x", "y", "z"].map(|a| [one("force", a), one("moment", a)]);
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

/// Force `f` at a point and a moment, about the origin.
fn wrench(at: [f64; 3], f: [f64; 3], moment: [f64; 3]) -> [f64; 6] {
    let [x, y, z] = at;
    let arm = [y * f[2] - z * f[1], z * f[0] - x * f[2], x * f[1] - y * f[0]];
    let m = [0, 1, 2].map(|c| arm[c] + moment[c]);
    [f[0], f[1], f[2], m[0], m[1], m[2]]
}

/// Keys of a load, a point \[m\], and the force \[N\] and moment \[N m\] about it that are asked for.
type Asked = (&'static str, [f64; 3], [f64; 3], [f64; 3]);

/// What loads on the end face say, and force and moment they then have: on all of it, and on a box that
/// cuts through zone and overlap.
const LOADS: [Asked; 5] = [
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
];

/// Every load of [`LOADS`] in a load step of its own.
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
            for (k, (words, at, force, moment)) in LOADS.iter().enumerate() {
                let asked = wrench(*at, *force, *moment);
                let size = asked.iter().fold(0.0_f64, |s, x| s.max(x.abs()));
                let [acts, held] = ["push", "bed"].map(|of| exerted(&results, of, k));
                for c in 0..6 {
                    let off = (acts[c] - asked[c]).abs().max((held[c] + asked[c]).abs()) / size;
                    worst = worst.max(off);
                    assert!(
                        off < 1e-10,
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
        let rest = "[[support]]\nname = \"bed\"\nmodel = \"body\"\nwhere = \"x-max\"\n\
                    [[effect]]\nmodels = [\"body\"]\nbody_force.acceleration = [0.01, 0.02, -0.03]\n";
        let rest = rest.to_owned() + &probes("bed") + &probes("body-force") + "[static]\nsteps = 1\n";
        let text = bar(FEM, zone, &rest);
        let results = run(&text);
        // Spheres share their mass by number, not by place: some more or less of it is in the overlap.
        let (mass, near) = (1.5 * 6.0 * 25.0, if zone == ZONES[2] { 0.02 } else { 1e-10 });
        let [held, pulled] = ["bed", "body-force"].map(|of| exerted(&results, of, 0));
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
    let rest = "[[support]]\nmodel = \"tip\"\nwhere = \"x-max\"\nmotion = { amplitude = 1e-3, time.ramp = { duration = 0.5 } }\n\
                [[support]]\nmodel = \"body\"\nwhere = \"x-max\"\nmotion = { amplitude = 1e-3, time.ramp = { duration = 0.5 } }\n\
                [[support]]\nmodel = \"body\"\nwhere = \"x-min\"\n[static]\nsteps = 1\n";
    let text = bar(FEM, ZONES[0], rest);
    let own = "[[support]]\nmodel = \"tip\"\nwhere = \"x-max\"\nmotion = { amplitude = 1e-3, time.ramp = { duration = 0.5 } }\n";
    let probe = "[probe.end]\nmodel = \"tip\"\nwhere = \"x-max\"\ncomponent = \"x\"\n";
    for text in [text.clone(), text.replace(own, "")] {
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

/// In the explicit form a load is of one model; what an overlap takes of it is told.
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
    let told = |loads: &str| {
        let scene = Scene::from_text(format!("{models}{loads}")).expect("a scene");
        let built = arlequin_scene::setup::build(scene.spec(), scene.folder()).expect("built");
        let said = built.warnings.into_iter().filter(|w| w.starts_with("load["));
        said.collect::<Vec<_>>()
    };
    let load = |model: &str, what: &str| {
        format!("[[load]]\nmodel = \"{model}\"\nwhere = \"z-max\"\n{what}\ntime = \"step\"\n")
    };
    // A quarter of the surface of `left` is lost: half of it lies in the overlap, where the weight is a
    // half in the mean.
    for what in ["traction = [0.0, 0.0, 1e-3]", "pressure = 1e-3"] {
        let said = told(&load("left", what));
        assert!(said.len() == 1 && said[0].contains("25.0 % is lost"), "{said:?}");
        assert_eq!(
            told(&(load("left", what) + &load("right", what))),
            Vec::<String>::new()
        );
    }
    // A moment acts by the squares of levers: along x, an eighth more is lost than the mean of the weights
    // on half of the face.
    let said = told(&load("left", "torque = [0.0, 1.0, 0.0]"));
    assert!(said.len() == 1 && said[0].contains("N m act"), "{said:?}");
}
