//! Reactions, loads and inertia balance to round-off, step by step, for every kind of model and across
//! overlaps.
//!
//! The reference is independent of the computation of reactions: the momentum of all models, whose change in
//! a step of velocity Verlet is the trapezoidal sum of all outer forces,
//! `P_{n+1} − P_n = Δt/2 (F_n + F_{n+1})`.
#![allow(clippy::print_stdout, reason = "a test shows what it measured")]

use arlequin::core::nalgebra::Vector3;
use arlequin_scene::{Error, Results, Scene, Silent};

/// Keys of a body that fills [0, 8] × [0, 3] × [0, 3] m alone.
const BOX: &str = "shape.box = { low = [0.0, 0.0, 0.0], high = [8.0, 3.0, 3.0] }";
const SOLID: &str = "material = { young = 3.0, poisson = 0.2, density = 1.5 }";

fn alone(kind: &str, keys: &str) -> String {
    format!("[model.body]\nkind = \"{kind}\"\n{BOX}\n{SOLID}\n{keys}\n")
}

/// Returns two models with an overlap from x = 3 m to 5 m.
fn coupled(left: &str, right: &str) -> String {
    format!(
        "[model.left]\nrole = \"coarse\"\nshape.box = {{ low = [0.0, 0.0, 0.0], high = [5.0, 3.0, 3.0] }}\n{SOLID}\n{left}\n\
         [model.right]\nrole = \"fine\"\nshape.box = {{ low = [3.0, 0.0, 0.0], high = [8.0, 3.0, 3.0] }}\n{SOLID}\n{right}\n\
         [interface.joint]\ncoarse = \"left\"\nfine = \"right\"\n\
         overlap.slab = {{ coarse = [3.0, 0.0, 0.0], fine = [5.0, 0.0, 0.0] }}\nmediator.spacing = 1.0\n"
    )
}

/// Returns supports and loads: z-min is held (overlap included), x-max is moved, and gravity, a pulse and a
/// torque act.
fn acts(models: &[&str], last: &str) -> String {
    let mut out = String::new();
    for m in models {
        out += &format!("[[support]]\nname = \"bed\"\nmodel = \"{m}\"\nwhere = \"z-min\"\n");
        out += &format!(
            "[[load]]\nname = \"blow\"\nmodel = \"{m}\"\nwhere = \"z-max\"\nforce = [0.3, -0.2, 0.1]\n\
             time.pulse = {{ duration = 4.0 }}\n"
        );
    }
    out += &format!(
        "[[support]]\nname = \"pull\"\nmodel = \"{last}\"\nwhere = {{ box = {{ low = [7.0, 0.0, 1.2], high = [9.0, 3.0, 9.0] }} }}\n\
         components = [\"x\"]\nmotion = {{ amplitude = 0.02, time.ramp = {{ duration = 5.0 }} }}\n\
         [[effect]]\nbody_force.acceleration = [0.1, 0.0, -0.4]\n\
         [[effect]]\nmass_damping.rate = 0.05\n"
    );
    out
}

const NAMES: [&str; 5] = ["bed", "pull", "blow", "body-force", "mass-damping"];
const AXES: [&str; 3] = ["x", "y", "z"];

/// Returns probes of force and moment about the origin of the named supports and loads.
fn probes(names: &[&str]) -> String {
    let mut out = String::new();
    for name in names {
        for axis in AXES {
            out += &format!(
                "[probe.{name}-f-{axis}]\nof = \"{name}\"\nquantity = \"force\"\ncomponent = \"{axis}\"\n\
                 [probe.{name}-m-{axis}]\nof = \"{name}\"\nquantity = \"moment\"\nabout = [0.0, 0.0, 0.0]\n\
                 component = \"{axis}\"\n"
            );
        }
    }
    out
}

fn run(models: &str, acts: &str, names: &[&str], keys: &str) -> Results {
    let text = format!(
        "{models}{acts}{}[time]\nsteps = 40\n{keys}[output]\nenergy_every = 1\n",
        probes(names)
    );
    let scene = Scene::from_text(text).expect("a scene");
    scene
        .prepare()
        .expect("it is built")
        .run(&mut Silent)
        .expect("it runs")
}

/// Returns the largest defects of `P_{n+1} − P_n = Δt/2 (F_n + F_{n+1})`, linear and angular, over the change
/// by the largest force in a step.
fn defects(results: &Results, names: &[&str]) -> [f64; 2] {
    let energy = &results.recorded.energy;
    let body = &results.summary().momentum[0];
    let name = body.models.join(" + ");
    let dt = results.summary().dt;
    let values = |kind: &str, n: usize| -> Vec<Vector3<f64>> {
        let probe_value =
            |name: &&str, a: &str| results.probe(&format!("{name}-{kind}-{a}")).expect("probe").1[n];
        let vector = |name: &&str| Vector3::from(AXES.map(|a| probe_value(name, a)));
        names.iter().map(vector).collect()
    };
    let column = |axis: &str, what: &str, unit: &str| {
        let momentum_column = energy.column(&format!("{name} {what} {axis} [{unit}]"));
        momentum_column.expect("momentum").to_vec()
    };
    let linear = AXES.map(|a| column(a, "momentum", "kg m/s"));
    // The ledger takes angular momentum about a point of its own, the probes take moments about the origin.
    let angular = AXES.map(|a| column(a, "angular momentum", "kg m2/s"));
    let centre = Vector3::from(body.about);
    let (mut defect, mut scale) = ([0.0_f64; 2], [0.0_f64; 2]);
    // Rows of the energy begin after the first step.
    for n in 1..linear[0].len() {
        let totals = |n: usize| {
            let (f, m) = (values("f", n), values("m", n));
            let about = f.iter().zip(&m).map(|(f, m)| m - centre.cross(f));
            [f.clone(), about.collect()]
        };
        let (now, next) = (totals(n), totals(n + 1));
        for (k, p) in [&linear, &angular].into_iter().enumerate() {
            let change = Vector3::from([0, 1, 2].map(|c: usize| p[c][n] - p[c][n - 1]));
            let sum = |parts: &[Vec<Vector3<f64>>; 2]| parts[k].iter().sum::<Vector3<f64>>();
            let defect_now = change - (sum(&now) + sum(&next)) * (0.5 * dt);
            defect[k] = defect[k].max(defect_now.norm());
            scale[k] = now[k].iter().fold(scale[k], |s, f| s.max(dt * f.norm()));
        }
    }
    // Models on a line have no moments.
    [0, 1].map(|k: usize| defect[k] / scale[k].max(f64::MIN_POSITIVE))
}

#[track_caller]
fn balanced(what: &str, models: &str, actors: &[&str], keys: &str) -> Results {
    let last = actors[actors.len() - 1];
    let results = run(models, &acts(actors, last), &NAMES, keys);
    let [force, moment] = defects(&results, &NAMES);
    println!("{what}: force {force:e}, moment {moment:e}");
    assert!(force < 1e-10 && moment < 1e-10, "{what}: {force:e}, {moment:e}");
    results
}

#[test]
fn forces_and_moments_balance_inertia_for_every_kind_of_solid() {
    balanced("hexahedra", &alone("fem", "spacing = 1.0"), &["body"], "");
    let tets = alone("fem", "spacing = 1.0\nfem.element = \"tet4\"");
    balanced("tetrahedra", &tets, &["body"], "");
    let natural = alone("cnem", "spacing = 1.0\ncnem.inertia = \"centroids\"");
    balanced("natural elements", &natural, &["body"], "");
}

#[test]
fn forces_and_moments_balance_inertia_for_particles_that_turn() {
    let grains = alone("dem", "spacing = 0.6\ndem.protocol = \"quench\"");
    let results = balanced("particles", &grains, &["body"], "");
    // Clamps hold rotations too, so that the moment of the bed includes their torque.
    let bed = &results.run.subdomains()[0].supports()[0];
    assert!(
        bed.dofs
            .iter()
            .any(|d| *d >= results.run.subdomains()[0].model().layout().translations())
    );
}

#[test]
fn forces_and_moments_balance_inertia_across_an_overlap_that_is_held_and_loaded() {
    let coarse = "kind = \"fem\"\nspacing = 1.0";
    let fine = "kind = \"cnem\"\nspacing = 0.6";
    balanced("fem | cnem", &coupled(coarse, fine), &["left", "right"], "");
    let grains = "kind = \"dem\"\nspacing = 0.55\ndem.protocol = \"quench\"";
    balanced("fem | dem", &coupled(coarse, grains), &["left", "right"], "");
}

/// With own steps and the implicit scheme, the reaction is the force at the instant; that of the multipliers
/// is their mean over the macro step.
#[test]
fn reactions_balance_at_the_instant_whatever_the_steps_of_the_models() {
    let coarse = "kind = \"fem\"\nspacing = 1.0";
    let fine = "kind = \"fem\"\nspacing = 0.5\nstep.ratio = 3";
    let implicit = "kind = \"fem\"\nspacing = 1.0\nstep.scheme = \"implicit\"";
    for (name, left) in [("own steps", coarse), ("implicit", implicit)] {
        let mut text =
            acts(&["left", "right"], "right").replace("[[effect]]\nmass_damping.rate = 0.05\n", "");
        text = text.replace("time.pulse = { duration = 4.0 }", "time = \"step\"");
        let mut results = run(&coupled(left, fine), &text, &NAMES[..4], "");
        let last = |p: &str| *results.probe(p).expect("probe").1.last().expect("a value");
        let outer: Vec<f64> = AXES
            .iter()
            .map(|a| NAMES[..4].iter().map(|n| last(&format!("{n}-f-{a}"))).sum())
            .collect();
        let size = NAMES[..4]
            .iter()
            .flat_map(|n| AXES.map(|a| last(&format!("{n}-f-{a}")).abs()))
            .fold(0.0, f64::max);
        // The reaction includes the inertia M a of each model, and the acceleration by multipliers where
        // nodes are free.
        let interface = &results.run.interfaces()[0];
        let mut inertia = [0.0; 3];
        for (m, sign) in [(0, -1.0), (1, 1.0)] {
            let s = &results.run.subdomains()[m];
            let b = interface.coupling_matrix(m).expect("two sides");
            for (v, (i, j)) in b.iter() {
                if s.inverse_inertia()[j] > 0.0 {
                    inertia[j % 3] += sign * v * interface.multipliers()[i];
                }
            }
            for (d, a) in s.state().a.iter().enumerate() {
                inertia[d % 3] += s.inertia()[d] * a;
            }
        }
        for c in 0..3 {
            let defect = (inertia[c] - outer[c]).abs() / size;
            assert!(defect < 1e-10, "{name}, {c}: {defect:e}");
        }
        assert!(results.run.reactions(2).is_err());
    }
}

#[test]
fn lines_balance_too_a_bar_tied_to_a_chain() {
    let text = "[model.chain]\nkind = \"chain\"\nrole = \"fine\"\nshape.bar = { from = 0.0, to = 6.0, section = 1.0 }\n\
                spacing = 0.1\nmaterial = { young = 1.0, density = 1.0 }\n\
                [model.bar]\nkind = \"fem\"\nrole = \"coarse\"\nshape.bar = { from = 4.0, to = 10.0, section = 1.0 }\n\
                spacing = 0.5\nmaterial = { young = 1.0, density = 1.0 }\n\
                [interface.joint]\ncoarse = \"bar\"\nfine = \"chain\"\n\
                overlap.slab = { fine = [4.0, 0.0, 0.0], coarse = [6.0, 0.0, 0.0] }\n";
    let acts = "[[support]]\nname = \"bed\"\nmodel = \"chain\"\nwhere = \"x-min\"\n\
                [[load]]\nname = \"blow\"\nmodel = \"bar\"\nwhere = \"x-max\"\nforce = [1.0, 0.0, 0.0]\ntime = \"step\"\n\
                [[effect]]\nbody_force.acceleration = [0.3, 0.0, 0.0]\n";
    let names = ["bed", "blow", "body-force"];
    let results = run(text, acts, &names, "");
    let [force, moment] = defects(&results, &names);
    assert!(force < 1e-10 && moment.abs() < 1e-10, "{force:e}, {moment:e}");
}

#[test]
fn a_rigid_ball_gives_what_the_particles_receive_and_reading_it_changes_no_bit() {
    let grains = alone("dem", "spacing = 0.6\ndem.protocol = \"quench\"");
    let ball = "[[effect]]\nobstacle = { name = \"ball\", shape.sphere = { centre = [4.0, 1.5, 4.3], radius = 1.3 }, \
                velocity = [0.0, 0.01, -0.05], mass = 2.0, contact = { friction = 0.3 } }\n";
    let keys = "step.seconds = 0.05\n";
    let results = run(&grains, ball, &["ball"], keys);
    let [force, moment] = defects(&results, &["ball"]);
    assert!(force < 1e-10 && moment < 1e-10, "{force:e}, {moment:e}");
    let felt = results.probe("ball-f-z").expect("probe").1;
    assert!(felt.iter().any(|f| *f < 0.0), "it pushes downwards");
    let silent = run(&grains, ball, &[], keys);
    assert_eq!(
        silent.run.subdomains()[0].state(),
        results.run.subdomains()[0].state()
    );
}

#[test]
fn contact_of_two_bodies_pushes_them_apart_with_opposite_forces_and_moments() {
    let body = |name: &str, low: f64, high: f64| {
        format!(
            "[model.{name}]\nkind = \"dem\"\nshape.box = {{ low = [{low:?}, 0.0, 0.0], high = [{high:?}, 2.0, 2.0] }}\n\
             spacing = 0.5\ndem.protocol = \"quench\"\n{SOLID}\n"
        )
    };
    let models = body("a", 0.0, 2.0) + &body("b", 2.02, 4.02);
    let acts = "[[effect]]\nbetween = [\"a\", \"b\"]\ncontact = { friction = 0.2 }\n\
                [[initial]]\nmodels = [\"b\"]\nvelocity.uniform = [-0.1, 0.02, 0.0]\n";
    let probe = |m: &str, q: &str| {
        format!(
            "[probe.{m}-{q}]\nof = \"contact a-b\"\nmodel = \"{m}\"\nquantity = \"{q}\"\nabout = [1.0, 2.0, 3.0]\n\
             component = \"x\"\n"
        )
    };
    let probes: String = ["a", "b"]
        .iter()
        .flat_map(|m| ["force", "moment"].map(|q| probe(m, q)))
        .collect();
    let results = run(&models, &(acts.to_owned() + &probes), &[], "");
    for q in ["force", "moment"] {
        let [a, b] = ["a", "b"].map(|m| results.probe(&format!("{m}-{q}")).expect("probe").1);
        let top = a.iter().fold(0.0_f64, |s, x| s.max(x.abs()));
        let gap = a.iter().zip(b).fold(0.0_f64, |s, (a, b)| s.max((a + b).abs()));
        assert!(top > 0.0 && gap < 1e-10 * top, "{q}: {gap:e} of {top:e}");
    }
}

#[test]
fn probes_and_curves_of_forces_refuse_what_makes_no_sense() {
    let models = alone("fem", "spacing = 1.0");
    let base = |addition: &str| {
        let acts = acts(&["body"], "body");
        Scene::from_text(format!("{models}{acts}[time]\nsteps = 1\n{addition}"))
    };
    let probe = "[probe.p]\nof = \"bed\"\nquantity = \"force\"\ncomponent = \"x\"\n";
    let says = |addition: &str, key: &str, words: &str| {
        let error = match base(addition).and_then(|s| s.prepare()) {
            Ok(_) => panic!("taken: {addition}"),
            Err(e) => e,
        };
        assert_eq!(error.place().0, Some(key), "{error}");
        assert!(error.to_string().contains(words), "{error}");
        assert!(error.is_input() && !matches!(error, Error::System { .. }));
    };
    says(
        &probe.replace("bed", "bad"),
        "probe.p.of",
        "known: bed, blow, body-force, mass-damping, pull",
    );
    says(
        &probe.replace("force", "velocity"),
        "probe.p.of",
        "\"force\" or \"moment\"",
    );
    says(
        &(probe.to_owned() + "at = [1.0, 1.0, 1.0]\n"),
        "probe.p",
        "remove at, where and crack",
    );
    says(
        &(probe.to_owned() + "model = \"x\"\n"),
        "probe.p.model",
        "there is no model",
    );
    says(
        &probe.replace("of = \"bed\"", "model = \"body\"\nwhere = \"x-max\""),
        "probe.p.quantity",
        "name it with of",
    );
    let gravity = probe.replace("bed", "body-force");
    says(
        &gravity.replace("\"force\"", "\"moment\""),
        "probe.p.about",
        "has no centre of its own",
    );
    says(
        "[probe.p]\ncomponent = \"x\"\nat = [1.0, 1.0, 1.0]\n",
        "probe.p.model",
        "is needed",
    );
    let curve = format!("{probe}[curve.c]\nx = \"p\"\ny = \"q\"\n");
    says(&curve, "curve.c.y", "there is no probe of this name; known: p");
    let supports =
        "[[support]]\nname = \"blow\"\nmodel = \"body\"\nwhere = \"y-min\"\ncomponents = [\"y\"]\n";
    says(
        &(supports.to_owned() + &probe.replace("bed", "blow")),
        "probe.p.of",
        "give them different names",
    );
}

/// A force on two half loads of a face partly in the overlap has another sum than requested, since each half
/// is spread over another surface, and the scene warns of it. On a face that lies wholly in the overlap or
/// wholly outside of it in both models, the force is the requested one and there is no warning.
#[test]
fn total_forces_that_an_overlap_changes_are_told() {
    let solid = "material = { young = 3.0, poisson = 0.2, density = 1.5 }";
    let bodies = |right: &str| {
        format!(
            "[model.left]\nkind = \"fem\"\nspacing = 1.0\nrole = \"coarse\"\n{solid}\n\
             shape.box = {{ low = [0.0, 0.0, 0.0], high = [6.0, 2.0, 2.0] }}\n\
             [model.right]\n{right}\nrole = \"fine\"\n{solid}\n\
             shape.box = {{ low = [3.0, 0.0, 0.0], high = [7.0, 2.0, 2.0] }}\n\
             [interface.joint]\ncoarse = \"left\"\nfine = \"right\"\nmediator.spacing = 1.0\n\
             overlap.slab = {{ coarse = [3.0, 0.0, 0.0], fine = [6.0, 0.0, 0.0] }}\n[time]\nsteps = 1\n"
        )
    };
    let load = |model: &str, face: &str, name: &str| {
        format!(
            "[[load]]\nmodel = \"{model}\"\nwhere = \"{face}\"\n{name}\nforce = [0.0, 0.0, -2.0]\ntime = \"step\"\n"
        )
    };
    let warned = |right: &str, loads: &str| {
        let scene = Scene::from_text(bodies(right) + loads).expect("a scene");
        let warnings = arlequin_scene::setup::build(scene.spec(), scene.folder())
            .expect("built")
            .warnings;
        warnings
            .into_iter()
            .filter(|w| w.contains("lies in an overlap"))
            .collect::<Vec<_>>()
    };
    for right in [
        "kind = \"fem\"\nspacing = 0.5",
        "kind = \"dem\"\nspacing = 0.4\ndem.protocol = \"quench\"",
    ] {
        for name in ["", "name = \"p\""] {
            let two_loads = load("left", "z-max", name) + &load("right", "z-max", name);
            let texts = warned(right, &two_loads);
            assert_eq!(texts.len(), 1, "{texts:?}");
            // Half of the half weight of the overlap: (3 + 1.5)/6 on one side and (1 + 1.5)/4 on the other.
            let wanted = 2.0 * (4.5 / 6.0 + 2.5 / 4.0);
            let stated: f64 = texts[0]
                .split("' ")
                .nth(1)
                .and_then(|w| w.split(' ').next())
                .expect("a number")
                .parse()
                .expect("one");
            assert!((stated / wanted - 1.0).abs() < 0.03, "{texts:?}");
        }
        // A load on one model alone is warned of; loads outside of the overlap are not.
        assert_eq!(warned(right, &load("left", "z-max", "")).len(), 1);
        assert!(warned(right, &(load("left", "x-min", "") + &load("right", "x-max", ""))).is_empty());
    }
    // Both patches lie wholly in the overlap: the weights sum to one.
    let patch = |model: &str| {
        load(model, "z-max", "").replace(
            "where = \"z-max\"",
            "where.box = { low = [4.0, 0.0, 2.0], high = [5.0, 2.0, 2.0] }",
        )
    };
    assert!(
        warned(
            "kind = \"fem\"\nspacing = 0.5",
            &(patch("left") + &patch("right"))
        )
        .is_empty()
    );
}
