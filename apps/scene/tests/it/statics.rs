//! Scenes at rest: direct and relaxed equilibria, their reactions, load steps from a file.
#![allow(
    clippy::print_stdout,
    clippy::float_cmp,
    reason = "a test shows what it measured and compares times that are the same bits"
)]

use arlequin_scene::{Results, Scene, Silent};
use std::path::PathBuf;

const SOLID: &str = "material = { young = 3.0, poisson = 0.2, density = 1.5 }";

fn coupled(right: &str) -> String {
    format!(
        "[model.left]\nkind = \"fem\"\nspacing = 1.0\nrole = \"coarse\"\n{SOLID}\n\
         shape.box = {{ low = [0.0, 0.0, 0.0], high = [5.0, 3.0, 3.0] }}\n\
         [model.right]\n{right}\nrole = \"fine\"\n{SOLID}\n\
         shape.box = {{ low = [3.0, 0.0, 0.0], high = [8.0, 3.0, 3.0] }}\n\
         [interface.joint]\ncoarse = \"left\"\nfine = \"right\"\n\
         overlap.slab = {{ coarse = [3.0, 0.0, 0.0], fine = [5.0, 0.0, 0.0] }}\nmediator.spacing = 1.0\n"
    )
}

/// Supports on z-min of both models; pull and torque on x-max; gravity.
const ACTS: &str = r#"
[[support]]
name = "bed"
model = "left"
where = "z-min"
[[support]]
name = "bed"
model = "right"
where = "z-min"
[[load]]
name = "pull"
model = "right"
where = "x-max"
force = [0.02, 0.01, 0.03]
time.ramp = { duration = 1.0 }
[[effect]]
body_force = { acceleration = [0.0, 0.0, -0.01], time = { expression = "min(1, 2*t)" } }
"#;

fn probes(names: &[&str]) -> String {
    let mut out = String::new();
    for name in names {
        for axis in ["x", "y", "z"] {
            for (q, quantity) in [("f", "force"), ("m", "moment")] {
                out += &format!(
                    "[probe.{name}-{q}-{axis}]\nof = \"{name}\"\nquantity = \"{quantity}\"\ncomponent = \"{axis}\"\n\
                     about = [0.0, 0.0, 0.0]\n"
                );
            }
        }
    }
    out
}

fn run(text: &str) -> Results {
    let scene = Scene::from_text(text).expect("a scene");
    scene.prepare().expect("built").run(&mut Silent).expect("runs")
}

/// Returns the largest sum of forces (or moments) over the largest of them, at any load step.
fn imbalance(results: &Results, names: &[&str], kind: &str) -> f64 {
    let count = results.recorded.probes.times.len();
    let (mut residual, mut size) = (0.0_f64, 0.0_f64);
    for k in 0..count {
        for axis in ["x", "y", "z"] {
            let values = names
                .iter()
                .map(|n| results.probe(&format!("{n}-{kind}-{axis}")).expect("probe").1[k]);
            let values: Vec<f64> = values.collect();
            residual = residual.max(values.iter().sum::<f64>().abs());
            size = values.iter().fold(size, |s, v| s.max(v.abs()));
        }
    }
    residual / size
}

#[test]
fn reactions_balance_loads_at_rest_for_every_pair_of_models() {
    let names = ["bed", "pull", "body-force"];
    for right in [
        "kind = \"fem\"\nspacing = 0.5",
        "kind = \"cnem\"\nspacing = 0.75",
        "kind = \"dem\"\nspacing = 0.6\ndem.protocol = \"quench\"",
    ] {
        let text = coupled(right) + ACTS + &probes(&names) + "[static]\nsteps = 2\n";
        let results = run(&text);
        let imbalances = ["f", "m"].map(|k| imbalance(&results, &names, k));
        println!("{right:?}: force {:e}, moment {:e}", imbalances[0], imbalances[1]);
        assert!(
            imbalances[0] < 1e-10 && imbalances[1] < 1e-10,
            "{right}: {imbalances:?}"
        );
        let steps = &results.summary().load_steps;
        assert_eq!(steps.len(), 2);
        assert!(
            steps
                .iter()
                .all(|s| s.method == "direct" && s.iterations == 0 && s.residual < 1e-10)
        );
        // Loads belong to their load step: the energy of a linear body under twice the pull, with half of
        // gravity.
        assert_eq!(results.recorded.probes.times, [0.5, 1.0]);
    }
}

/// A clamped bar under its own weight and a pull at its end has `u = F L/(E A) + ρ g L²/(2 E)`.
#[test]
fn a_bar_at_rest_has_the_displacement_of_the_textbook() {
    let bar = "[model.bar]\nkind = \"fem\"\nshape.bar = { from = 0.0, to = 2.0, section = 1e-4 }\nspacing = 0.1\n\
               material = { young = 200e9, density = 7800.0 }\n\
               [[support]]\nmodel = \"bar\"\nwhere = \"x-min\"\n\
               [[load]]\nmodel = \"bar\"\nwhere = \"x-max\"\nforce = [1e3, 0.0, 0.0]\ntime = \"step\"\n\
               [[effect]]\nbody_force.acceleration = [9.81, 0.0, 0.0]\n\
               [probe.tip]\nmodel = \"bar\"\nwhere = \"x-max\"\ncomponent = \"x\"\n[static]\nsteps = 1\n";
    let results = run(bar);
    let tip = results.probe("tip").expect("probe").1[0];
    let exact = 1e3 * 2.0 / (200e9 * 1e-4) + 7800.0 * 9.81 * 4.0 / (2.0 * 200e9);
    assert!((tip / exact - 1.0).abs() < 1e-10, "{tip:e}, {exact:e}");
}

/// A relaxed equilibrium is that of the direct solution, also with the law of finite rotations if the body
/// turns little.
#[test]
fn relaxed_equilibria_are_those_of_the_direct_solution() {
    let body = |finite: bool| {
        format!(
            "[model.body]\nkind = \"dem\"\n{SOLID}\nshape.box = {{ low = [0.0, 0.0, 0.0], high = [5.0, 3.0, 3.0] }}\n\
             spacing = 0.7\ndem.protocol = \"quench\"\ndem.finite_rotations = {finite}\n\
             [[support]]\nname = \"bed\"\nmodel = \"body\"\nwhere = \"x-min\"\n\
             [[load]]\nname = \"pull\"\nmodel = \"body\"\nwhere = \"x-max\"\nforce = [1e-4, 1e-5, 0.0]\ntime = \"step\"\n\
             [probe.tip]\nmodel = \"body\"\nwhere = \"x-max\"\ncomponent = \"x\"\n\
             [probe.side]\nmodel = \"body\"\nwhere = \"x-max\"\ncomponent = \"y\"\n{}\
             [static]\nsteps = 1\ntolerance = 1e-7\n",
            probes(&["bed", "pull"])
        )
    };
    let [small, large] = [false, true].map(|f| run(&body(f)));
    let step = &large.summary().load_steps[0];
    println!("{} steps of relaxation to {:e}", step.iterations, step.residual);
    assert!(step.method == "relaxed" && step.residual <= 1e-7 && step.iterations > 500);
    for p in ["tip", "side"] {
        let [a, b] = [&small, &large].map(|r| r.probe(p).expect("probe").1[0]);
        assert!((a / b - 1.0).abs() < 2e-4, "{p}: {a:e}, {b:e}");
    }
    let residual = imbalance(&large, &["bed", "pull"], "f");
    assert!(residual < 1e-5, "{residual:e}");
}

#[test]
fn load_steps_come_from_a_file_and_the_motion_of_a_support_too() {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("statics-file");
    std::fs::create_dir_all(&folder).expect("a folder");
    std::fs::write(folder.join("steps.csv"), "time [s]\n0.1\n0.25\n1.0\n").expect("written");
    std::fs::write(
        folder.join("pull.csv"),
        "# time, displacement\n0.0, 0.0\n1.0, 2e-3\n",
    )
    .expect("written");
    let text = "[model.bar]\nkind = \"fem\"\nshape.bar = { from = 0.0, to = 2.0, section = 1e-4 }\nspacing = 0.5\n\
                material = { young = 200e9, density = 7800.0 }\n\
                [[support]]\nmodel = \"bar\"\nwhere = \"x-min\"\n\
                [[support]]\nname = \"grip\"\nmodel = \"bar\"\nwhere = \"x-max\"\n\
                motion = { amplitude = 1.0, time = { file = \"pull.csv\" } }\n\
                [probe.grip]\nof = \"grip\"\nquantity = \"force\"\ncomponent = \"x\"\n\
                [probe.tip]\nmodel = \"bar\"\nwhere = \"x-max\"\ncomponent = \"x\"\n\
                [curve.pull]\nx = \"tip\"\ny = \"grip\"\nx_factor = 1e3\n\
                [static]\nfile = \"steps.csv\"\n";
    let path = folder.join("scene.toml");
    std::fs::write(&path, text).expect("written");
    let scene = Scene::read(&path).expect("a scene");
    assert_eq!(scene.files().len(), 2);
    let run_folder =
        arlequin_scene::RunFolder::new(&scene, Some(&folder.join("out")), true).expect("a folder");
    let results = scene
        .prepare()
        .expect("built")
        .run_into(run_folder, &mut Silent)
        .expect("runs");
    assert_eq!(results.recorded.probes.times, [0.1, 0.25, 1.0]);
    let force = results.probe("grip").expect("probe").1;
    for (t, f) in results.recorded.probes.times.iter().zip(force) {
        let exact = 200e9 * 1e-4 * 2e-3 * t / 2.0;
        assert!((f - exact).abs() < 1e-10 * 2e4, "{t}: {f:e}, {exact:e}");
    }
    let curve = std::fs::read_to_string(folder.join("out/curve-pull.csv")).expect("a curve");
    let mut lines = curve.lines();
    assert_eq!(
        lines.next(),
        Some("time [s],1000 tip displacement [m],grip force [N]")
    );
    let last: Vec<f64> = lines
        .last()
        .expect("rows")
        .split(',')
        .map(|c| c.parse().expect("number"))
        .collect();
    assert!(
        (last[1] - 2.0).abs() < 1e-12 && (last[2] - 2e4).abs() < 1e-5,
        "{last:?}"
    );
    let table = std::fs::read_to_string(folder.join("out/static.csv")).expect("a table");
    assert_eq!(table.lines().count(), 4);
    assert!(table.starts_with("time [s],method,residual [-],iterations [-],internal [J]\n1e-1,direct,"));
}

#[test]
fn static_scenes_refuse_what_needs_time() {
    let base = coupled("kind = \"fem\"\nspacing = 0.5") + ACTS;
    let refused = |addition: &str, key: &str, words: &str| {
        let error = match Scene::from_text(format!("{base}{addition}")).and_then(|s| s.prepare()) {
            Ok(_) => panic!("taken: {addition}"),
            Err(e) => e,
        };
        assert_eq!(error.place().0, Some(key), "{error}");
        assert!(error.to_string().contains(words), "{error}");
    };
    refused("[static]\n", "static", "exactly one of times [s], file, steps");
    refused("[static]\nsteps = 2\ntimes = [1.0]\n", "static", "exactly one of");
    refused("[static]\nsteps = 0\n", "static.steps", "at least 1");
    refused(
        "[static]\ntimes = [1.0, 0.5]\n",
        "static.times",
        "above the one before",
    );
    refused("[static]\ntimes = []\n", "static.times", "at least one");
    refused("[static]\nsteps = 1\nend = -1.0\n", "static.end", "positive");
    refused(
        "[static]\nsteps = 1\ntolerance = 2.0\n",
        "static.tolerance",
        "below 1",
    );
    refused(
        "[static]\nsteps = 1\niterations = 3\n",
        "static.iterations",
        "static.ramp",
    );
    refused(
        "[static]\nsteps = 1\n[time]\nend = 1.0\n",
        "time",
        "is replaced by [static]",
    );
    refused("", "time", "[static] in its place");
    refused(
        "[static]\nsteps = 1\n[[initial]]\nvelocity.uniform = [1.0, 0.0, 0.0]\n",
        "initial[0]",
        "moves a scene that is at rest",
    );
    refused(
        "[static]\nsteps = 1\n[[effect]]\nprestress = {}\n",
        "effect[1].prestress",
        "remove it or [static]",
    );
    // A body that can move freely has no equilibrium.
    let free = base.replace(
        "[[support]]\nname = \"bed\"\nmodel = \"left\"\nwhere = \"z-min\"",
        "",
    );
    let free = free.replace(
        "[[support]]\nname = \"bed\"\nmodel = \"right\"\nwhere = \"z-min\"",
        "",
    );
    let scene = Scene::from_text(free + "[static]\nsteps = 1\n").expect("a scene");
    let error = scene.prepare().expect_err("no equilibrium");
    assert_eq!(error.place().0, Some("static"), "{error}");
    assert!(
        error
            .to_string()
            .contains("'left' and 'right' can move along x and y and z and turn about x and y and z"),
        "{error}"
    );
}

/// A body free to move along y and z and to turn about x is refused: round-off over round-off is no
/// displacement, whatever the residual.
#[test]
fn bodies_that_can_move_freely_have_no_equilibrium() {
    for kind in ["fem", "cnem"] {
        for load in [
            "force = [1.0, 0.5, 0.0]",
            "torque = [1.0, 0.0, 0.0]",
            "force = [1.0, 0.0, 0.0]",
        ] {
            let text = |components: &str| {
                format!(
                    "[model.bar]\nkind = \"{kind}\"\ndivisions = [8, 2, 2]\n\
                     shape.box = {{ low = [0.0, 0.0, 0.0], high = [0.1, 0.01, 0.01] }}\n\
                     material = {{ young = 70e9, poisson = 0.3, density = 2000.0 }}\n\
                     [[support]]\nmodel = \"bar\"\nwhere = \"x-min\"\n{components}\n\
                     [[load]]\nmodel = \"bar\"\nwhere = \"x-max\"\n{load}\ntime = \"step\"\n[static]\nsteps = 1\n"
                )
            };
            let run = |components: &str| {
                let scene = Scene::from_text(text(components)).expect("a scene");
                scene.prepare()?.run(&mut Silent)
            };
            assert!(run("").is_ok(), "{kind}, {load}");
            let message = run("components = [\"x\"]").expect_err("free to move").to_string();
            assert!(
                message.contains("'bar' can move along y and z and turn about x: no support holds it"),
                "{message}"
            );
        }
    }
}

/// `check` prints the plan of a scene at rest: load steps, the method of solution, and a frame for each.
#[test]
fn the_plan_of_a_scene_at_rest_tells_of_load_steps() {
    let text = "[model.bar]\nkind = \"dem\"\nspacing = 0.5\ndem.protocol = \"quench\"\n\
                shape.box = { low = [0.0, 0.0, 0.0], high = [4.0, 2.0, 2.0] }\n\
                material = { young = 70e9, poisson = 0.3, density = 2000.0 }\n\
                [[support]]\nmodel = \"bar\"\nwhere = \"x-min\"\n\
                [static]\ntimes = [0.5, 2.0, 3.0]\n[output]\nevery = 1\n";
    let plan = |keys: &str| {
        let scene = Scene::from_text(format!("{text}{keys}")).expect("a scene");
        scene.prepare().expect("built").preview()
    };
    let direct = plan("");
    assert_eq!((direct.steps, direct.frames, direct.end), (3, 3, 3.0));
    assert_eq!(direct.resting.as_deref(), Some("directly"));
    let breaking = plan("[[effect]]\nfracture = { gc = 8.0 }\n").resting;
    assert!(breaking.is_some_and(|how| how.starts_with("directly until the first break")));
    let relaxed = plan("[[effect]]\ncontact = {}\n").resting.expect("at rest");
    assert!(
        relaxed.starts_with("by relaxation, as 'bar': effect 'contact'"),
        "{relaxed}"
    );
}

/// Returns a bar of spheres that is stretched until it parts, by its grip or by a load on it.
fn torn(pull: &str, keys: &str) -> String {
    format!(
        "[model.bar]\nkind = \"dem\"\nspacing = 0.4e-3\ndem.protocol = \"quench\"\n\
         shape.box = {{ low = [0.0, 0.0, 0.0], high = [4e-3, 1.2e-3, 1.2e-3] }}\n\
         material = {{ young = 75e9, poisson = 0.17, density = 2200.0 }}\n\
         [[effect]]\nfracture = {{ criterion = \"rankine\", strength = 100e6, weibull = 10.0 }}\n\
         [[support]]\nmodel = \"bar\"\nwhere = \"x-min\"\n{pull}\n\
         [probe.end]\nmodel = \"bar\"\nwhere = \"x-max\"\ncomponent = \"x\"\n[static]\nsteps = 6\n{keys}"
    )
}

#[test]
fn a_piece_that_came_loose_under_a_load_is_named() {
    let load = "[[load]]\nmodel = \"bar\"\nwhere = \"x-max\"\nforce = [400.0, 0.0, 0.0]\ntime.ramp = { duration = 1.0 }";
    let scene = Scene::from_text(torn(load, "iterations = 3000\n")).expect("a scene");
    let error = scene
        .prepare()
        .expect("built")
        .run(&mut Silent)
        .expect_err("torn");
    let message = error.to_string();
    assert!(
        message.contains("no equilibrium")
            && message.contains("particles of 'bar' around")
            && message.contains("held by nothing"),
        "{message}"
    );
}

/// A load step of a linear model has the same result with other load steps as alone: all use one matrix and
/// one factor, so that ten cost little more than one.
#[test]
fn load_steps_of_a_linear_model_are_those_of_runs_of_their_own() {
    let text = |times: &str| {
        coupled("kind = \"fem\"\nspacing = 0.5")
            + ACTS
            + &probes(&["bed"])
            + &format!("[static]\ntimes = {times}\n")
    };
    let together = run(&text("[0.5, 1.0]"));
    let last = run(&text("[1.0]"));
    for axis in ["x", "y", "z"] {
        let name = format!("bed-f-{axis}");
        let [both_steps, alone] =
            [&together, &last].map(|r| *r.probe(&name).expect("probe").1.last().expect("a row"));
        assert_eq!(both_steps, alone, "{name}");
    }
}

/// Without `about` the moment of a clamp is taken about the middle of its held nodes, far from the origin.
#[test]
fn the_moment_of_a_clamp_is_about_its_own_middle() {
    let text = format!(
        "[model.beam]\nkind = \"fem\"\nspacing = 1.0\n{SOLID}\nshape.box = {{ low = [40.0, 20.0, 30.0], high = [46.0, 22.0, 32.0] }}\n\
         [[support]]\nname = \"clamp\"\nmodel = \"beam\"\nwhere = \"x-min\"\n\
         [[load]]\nmodel = \"beam\"\nwhere = \"x-max\"\nforce = [0.0, 0.0, -1e-3]\ntime = \"step\"\n\
         [probe.m]\nof = \"clamp\"\nquantity = \"moment\"\ncomponent = \"y\"\n[static]\nsteps = 1\n"
    );
    let moment = run(&text).probe("m").expect("probe").1[0];
    assert!((moment / (-6.0 * 1e-3) - 1.0).abs() < 1e-9, "{moment:e}");
}

/// Plane that no particle of the bars below touches; with it, no load step is solved directly.
const FAR_PLANE: &str =
    "[[effect]]\nobstacle = { shape.plane = { point = [-1.0, 0.0, 0.0], normal = [1.0, 0.0, 0.0] } }\n";

/// A load applied over 500 steps of relaxation breaks no bond that bears the equilibrium; at once, it sets
/// off a wave that does.
#[test]
fn loads_that_come_slowly_break_nothing_that_equilibrium_bears() {
    let pull = "[[support]]\nmodel = \"bar\"\nwhere = \"x-max\"\ncomponents = [\"x\"]\nmotion = { amplitude = 4e-7, time.ramp = { duration = 1.0 } }";
    let breaks = |ramp: usize| {
        let text = torn(pull, &format!("ramp = {ramp}\n{FAR_PLANE}"))
            .replace("steps = 6", "steps = 1")
            .replace(", weibull = 10.0", "");
        let results = run(&text);
        results.summary().effect_ledger[0].facts["broken bonds"]
    };
    assert_eq!(breaks(500), 0.0);
    assert!(breaks(1) > 0.0);
}

/// Load steps before the first break are solved directly, with the forces and up to the load step of the
/// relaxation; the first bond breaks within a tenth of a load step of where it breaks there.
#[test]
fn load_steps_up_to_the_first_break_are_solved_directly() {
    let grip = "[[support]]\nname = \"grip\"\nmodel = \"bar\"\nwhere = \"x-max\"\n\
                components = [\"x\", \"y\", \"z\"]\nmotion = { amplitude = 8e-7, time.ramp = { duration = 1.0 } }\n\
                [probe.grip]\nof = \"grip\"\nquantity = \"force\"\ncomponent = \"x\"";
    let [direct, relaxed] = ["", FAR_PLANE].map(|keys| {
        let text = torn(grip, &format!("tolerance = 1e-7\n{keys}"));
        run(&text
            .replace("steps = 6", "steps = 8")
            .replace(", weibull = 10.0", ""))
    });
    let first = |r: &Results| r.summary().effect_ledger[0].facts["first break [s]"];
    let [by_solution, by_relaxation] = [&direct, &relaxed].map(first);
    println!("first break at {by_solution} and {by_relaxation}");
    // In the same load step of 1/8, and not in the first or the last one.
    let step = (8.0 * by_solution).ceil() as usize;
    assert!((2..8).contains(&step) && step == (8.0 * by_relaxation).ceil() as usize);
    assert!((by_solution - by_relaxation).abs() < 0.1 / 8.0);
    let methods = direct.summary().load_steps.iter().map(|s| s.method == "direct");
    assert!(
        methods
            .enumerate()
            .all(|(k, is_direct)| is_direct == (k + 1 < step))
    );
    assert!(relaxed.summary().load_steps.iter().all(|s| s.method == "relaxed"));
    let [a, b] = [&direct, &relaxed].map(|r| r.probe("grip").expect("probe").1);
    for k in 0..step - 1 {
        assert!((a[k] / b[k] - 1.0).abs() < 1e-6, "{k}: {} {}", a[k], b[k]);
    }
}

/// A scene with ties to particles relaxes to the direct solution, from which contact with a plane far away
/// keeps it. The particles take several own steps.
#[test]
fn ties_relax_to_the_direct_solution() {
    for left in ["kind = \"fem\"", "kind = \"cnem\""] {
        let right = "kind = \"dem\"\nspacing = 0.6\ndem.protocol = \"quench\"";
        let final_values = |addition: &str| {
            let ends = [("left", "x-max"), ("right", "x-max"), ("right", "z-min")];
            let watched = ends.map(|(m, place)| {
                ["x", "z"].map(|c| {
                    format!(
                        "[probe.{m}-{place}-{c}]\nmodel = \"{m}\"\nwhere = \"{place}\"\ncomponent = \"{c}\"\n"
                    )
                })
            });
            let text = coupled(right).replace("kind = \"fem\"", left)
                + ACTS
                + &watched.concat().concat()
                + &probes(&["bed", "pull", "body-force"]);
            run(&(text + addition + "[static]\nsteps = 1\ntolerance = 1e-9\n"))
        };
        let far = "[[effect]]\nmodels = [\"right\"]\n\
                   obstacle = { shape.plane = { point = [0.0, 0.0, -50.0], normal = [0.0, 0.0, 1.0] } }\n";
        let [direct, relaxed] = ["", far].map(final_values);
        let [a, b] = [&direct, &relaxed].map(|r| r.summary().load_steps[0].clone());
        assert!(a.method == "direct" && b.method == "relaxed");
        let names = direct.recorded.probes.names.clone();
        let size = |unit: &str| {
            let gaps = names
                .iter()
                .zip(&direct.recorded.probes.columns)
                .filter(|c| c.0.contains(unit));
            gaps.fold(0.0_f64, |m, c| m.max(c.1[0].abs()))
        };
        let mut deviation = 0.0_f64;
        for (k, name) in names.iter().enumerate() {
            let unit = ["[m]", "[N]", "[N m]"]
                .into_iter()
                .find(|u| name.contains(u))
                .expect("a unit");
            let [x, y] = [&direct, &relaxed].map(|r| r.recorded.probes.columns[k][0]);
            deviation = deviation.max((x - y).abs() / size(unit));
        }
        println!(
            "{left}: {} steps to {:e}, off by {deviation:e}",
            b.iterations, b.residual
        );
        assert!(deviation < 1e-6, "{left}: {deviation:e}");
    }
}

/// A body torn into parts bears no load any more, and each of its load steps still is an equilibrium.
#[test]
fn bodies_torn_apart_come_to_rest() {
    let grip = |far: f64| {
        format!(
            "[[support]]\nname = \"grip\"\nmodel = \"bar\"\nwhere = \"x-max\"\n\
             components = [\"x\", \"y\", \"z\"]\nmotion = {{ amplitude = {far:e}, time.table = [[0.0, 0.0], [0.7, 1.0], [1.0, 1.0]] }}\n\
             [probe.grip]\nof = \"grip\"\nquantity = \"force\"\ncomponent = \"x\""
        )
    };
    let results = run(&torn(&grip(1e-6), FAR_PLANE));
    let force = results.probe("grip").expect("probe").1;
    let steps = &results.summary().load_steps;
    let iterations: Vec<usize> = steps.iter().map(|s| s.iterations).collect();
    println!("forces {force:?} N, steps {iterations:?}");
    assert!(steps.len() == 6 && steps.iter().all(|s| s.method == "relaxed" && s.residual <= 1e-6));
    // The bar bears the first load step, and nothing at the end.
    assert!(force[0] > 1.0 && force[5].abs() < 1e-4 * force[0], "{force:?}");
}
