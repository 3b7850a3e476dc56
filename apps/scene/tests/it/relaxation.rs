//! Relaxation of bodies that are nearly torn, and of pieces that came loose.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]
#![allow(clippy::print_stdout, reason = "a test shows what it measured")]

use arlequin_scene::setup::build;
use arlequin_scene::{Results, Scene, Silent};

/// A plane that no particle touches; with it, no load step is solved directly.
const FAR_PLANE: &str =
    "[[effect]]\nobstacle = { shape.plane = { point = [-1.0, 0.0, 0.0], normal = [1.0, 0.0, 0.0] } }\n";
/// Place of the notch along the cantilever \[m\].
const NOTCH: f64 = 3e-3;

fn run(text: &str) -> Results {
    let scene = Scene::from_text(text).unwrap();
    scene.prepare().unwrap().run(&mut Silent).unwrap()
}

/// Returns a cantilever of 30 by 4 by 4 spheres, with these notches a quarter along.
fn cantilever(notches: &str) -> String {
    format!(
        "[model.arm]\nkind = \"dem\"\nspacing = 0.4e-3\ndem.protocol = \"quench\"\n\
         shape.box = {{ low = [0.0, 0.0, 0.0], high = [12e-3, 1.6e-3, 1.6e-3] }}\n\
         material = {{ young = 75e9, poisson = 0.17, density = 2200.0 }}\n{notches}\
         [[support]]\nmodel = \"arm\"\nwhere = \"x-min\"\n\
         [[load]]\nmodel = \"arm\"\nwhere = \"x-max\"\nforce = [0.0, 0.0, 1e-3]\ntime = \"step\"\n\
         [probe.tip]\nmodel = \"arm\"\nwhere = \"x-max\"\ncomponent = \"z\"\n[static]\nsteps = 1\n"
    )
}

/// Returns notches that leave a corner of 0.45 mm.
fn all_but_a_corner() -> String {
    let plane = |low: &str| {
        format!(
            "{{ plane = {{ point = [{NOTCH:e}, 0.0, 0.0], normal = [1.0, 0.0, 0.0], \
             within = {{ low = {low}, high = [12e-3, 1.6e-3, 1.6e-3] }} }} }}"
        )
    };
    let [beside, above] = ["[0.0, 0.45e-3, 0.0]", "[0.0, 0.0, 0.45e-3]"].map(plane);
    format!("dem.notch = [{beside}, {above}]\n")
}

/// Number of bonds across the plane of the notch.
fn bonds_left(text: &str) -> usize {
    let scene = Scene::from_text(text).unwrap();
    let built = build(scene.spec(), scene.folder()).unwrap();
    let model = built.run.subdomains()[0].model();
    let beyond = |i: u32| model.nodes()[i as usize].x > NOTCH;
    let across = |[i, j]: &&[u32; 2]| beyond(*i) != beyond(*j);
    model.views().links.unwrap().pairs().iter().filter(across).count()
}

/// An arm that hangs on one bond swings over tens of thousands of steps; under critical damping it takes
/// about four periods to a residual of 1e-6.
#[test]
fn an_arm_that_hangs_on_one_bond_reaches_the_equilibrium_of_the_direct_solution() {
    let text = cantilever(&all_but_a_corner());
    assert_eq!(bonds_left(&text), 1);
    let direct = run(&text);
    assert_eq!(direct.summary().load_steps[0].method, "direct");
    let relaxed = run(&format!("{text}{FAR_PLANE}"));
    let step = &relaxed.summary().load_steps[0];
    let tip = |r: &Results| r.probe("tip").unwrap().1[0];
    let [a, b] = [&direct, &relaxed].map(tip);
    println!(
        "{} steps to {:e}; the tip moves by {a:e} and {b:e} m",
        step.iterations, step.residual
    );
    assert!(step.method == "relaxed" && step.residual <= 1e-6 && step.iterations <= 130_000);
    assert!((b / a - 1.0).abs() < 1e-4, "{a:e}, {b:e}");
    // The bond bends more than the whole arm does.
    let whole = tip(&run(&cantilever("")));
    assert!(a > 30.0 * whole, "{a:e}, {whole:e}");
}

/// A block that is torn along three axes at once sends pieces away. With velocities set to zero at each peak
/// of kinetic energy, the first load step after the break took 150 000 steps.
#[test]
fn pieces_that_drift_come_to_rest() {
    let mut text = "[model.block]\nkind = \"dem\"\nspacing = 0.4e-3\ndem.protocol = \"quench\"\n\
         shape.box = { low = [0.0, 0.0, 0.0], high = [2.4e-3, 2.4e-3, 2.4e-3] }\n\
         material = { young = 75e9, poisson = 0.17, density = 2200.0 }\n\
         [[effect]]\nfracture = { gc = 8.0 }\n[static]\nsteps = 10\ntolerance = 1e-5\n"
        .to_owned();
    for axis in ["x", "y", "z"] {
        text += &format!(
            "[[support]]\nmodel = \"block\"\nwhere = \"{axis}-min\"\ncomponents = [\"{axis}\"]\n\
             [[support]]\nmodel = \"block\"\nwhere = \"{axis}-max\"\ncomponents = [\"{axis}\"]\n\
             motion = {{ amplitude = 2e-6, time.table = [[0.0, 0.0], [1.0, 1.0]] }}\n"
        );
    }
    let results = run(&text);
    let steps = &results.summary().load_steps;
    let iterations: Vec<usize> = steps.iter().map(|s| s.iterations).collect();
    let facts = &results.summary().effect_ledger[0].facts;
    println!("steps {iterations:?}, {facts:?}");
    assert!(steps.len() == 10 && steps.iter().all(|s| s.residual <= 1e-5));
    assert!(iterations.iter().all(|n| *n <= 2000));
    assert!(facts["broken bonds"] >= 50.0);
}

/// A ball that is pressed into a block bears what the bed below the block bears, with and without bonds that
/// break under it.
#[test]
fn an_obstacle_presses_a_block_at_rest_with_the_force_of_its_bed() {
    let text = |fracture: &str| {
        format!(
            "[model.block]\nkind = \"dem\"\nspacing = 0.5e-3\ndem.protocol = \"quench\"\n\
             shape.box = {{ low = [-2e-3, -2e-3, -2e-3], high = [2e-3, 2e-3, 0.0] }}\n\
             material = {{ young = 72.5e9, poisson = 0.17, density = 2200.0 }}\n\
             [[support]]\nname = \"bed\"\nmodel = \"block\"\nwhere = \"z-min\"\n{fracture}\
             [[effect]]\nmodels = [\"block\"]\ncontact = {{}}\n\
             [[effect]]\nobstacle = {{ name = \"ball\", shape.sphere = {{ centre = [0.0, 0.0, 6e-3], radius = 6e-3 }}, \
             displacement = {{ amplitude = [0.0, 0.0, -30e-6], time.table = [[0.0, 0.0], [1.0, 1.0]] }}, contact = {{}} }}\n\
             [probe.ball]\nof = \"ball\"\nquantity = \"force\"\ncomponent = \"z\"\n\
             [probe.bed]\nof = \"bed\"\nquantity = \"force\"\ncomponent = \"z\"\n\
             [static]\nsteps = 3\ntolerance = 1e-5\n"
        )
    };
    for fracture in ["", "[[effect]]\nfracture = { gc = 8.0 }\n"] {
        let results = run(&text(fracture));
        let [ball, bed] = ["ball", "bed"].map(|name| results.probe(name).unwrap().1);
        let steps = &results.summary().load_steps;
        println!("{ball:?} N, {bed:?} N, {steps:?}");
        assert!(steps.iter().all(|s| s.method == "relaxed" && s.residual <= 1e-5));
        let top = ball.iter().fold(0.0_f64, |m, f| m.max(f.abs()));
        assert!(top > 1.0 && ball.iter().zip(bed).all(|(a, b)| (a + b).abs() < 1e-3 * top));
    }
}

/// Two arms that are drawn apart after their root has cracked: the body swings slowly about the grips, with
/// small forces on each particle. At a tolerance of 1e-3 of the largest force in a bond, the two grips
/// differed by a factor of six.
#[test]
fn grips_of_a_cracked_body_balance_each_other() {
    let mut text = "[model.arm]\nkind = \"dem\"\nspacing = 0.4e-3\ndem.protocol = \"quench\"\n\
         shape.box = { low = [0.0, -2e-3, 0.0], high = [14e-3, 2e-3, 1.6e-3] }\n\
         material = { young = 75e9, poisson = 0.17, density = 2200.0 }\n\
         dem.notch = [{ plane = { point = [0.0, 0.0, 0.0], normal = [0.0, 1.0, 0.0], \
         within = { low = [0.0, -2e-3, 0.0], high = [6e-3, 2e-3, 1.6e-3] } } }]\n\
         [[support]]\nmodel = \"arm\"\nwhere = \"x-max\"\ncomponents = [\"x\", \"z\"]\n\
         [[effect]]\nfracture = { gc = 8.0 }\n[static]\nsteps = 10\ntolerance = 1e-3\n"
        .to_owned();
    for (name, low, high, sign) in [("upper", "0.0", "2e-3", ""), ("lower", "-2e-3", "0.0", "-")] {
        text += &format!(
            "[[support]]\nname = \"{name}\"\nmodel = \"arm\"\ncomponents = [\"y\"]\n\
             where.box = {{ low = [0.0, {low}, 0.0], high = [0.6e-3, {high}, 1.6e-3] }}\n\
             motion = {{ amplitude = {sign}15e-6, time.table = [[0.0, 0.0], [1.0, 1.0]] }}\n\
             [probe.{name}]\nof = \"{name}\"\nquantity = \"force\"\ncomponent = \"y\"\n"
        );
    }
    let results = run(&text);
    let [upper, lower] = ["upper", "lower"].map(|name| results.probe(name).unwrap().1);
    let steps = &results.summary().load_steps;
    println!("{upper:?} N, {lower:?} N, {steps:?}");
    assert!(steps.iter().filter(|s| s.method == "relaxed").count() >= 4);
    // Ten times the tolerance, of both grips.
    let balanced = |(u, l): (&f64, &f64)| (u + l).abs() <= 1.01e-2 * (u.abs() + l.abs());
    assert!(upper.iter().zip(lower).all(balanced));
}
