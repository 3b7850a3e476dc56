//! Breaks and fragments: modes, energies, pieces with their masses and velocities.
#![allow(clippy::float_cmp, reason = "instants in a table are the same bits")]

use arlequin_scene::output::{Frames, Pictures};
use arlequin_scene::spec::OutputField;
use arlequin_scene::{RunFolder, Scene, Silent};
use std::path::PathBuf;

/// A notched bar that is stretched until it parts.
const BAR: &str = r#"
[model.bar]
kind = "dem"
shape.box = { low = [0.0, 0.0, 0.0], high = [8e-3, 2e-3, 2e-3] }
spacing = 0.4e-3
dem.protocol = "quench"
material = { young = 75e9, poisson = 0.17, density = 2200.0 }
dem.notch = [{ low = [4e-3, -1e-3, -1e-3], high = [4e-3, 3e-3, 1.2e-3] }]
[[effect]]
fracture = { criterion = "rankine", strength = 100e6, weibull = 10.0 }
[[initial]]
velocity.polynomial = { component = "x", along = "x", coefficients = [-3.0, 2000.0] }
[time]
end = 8e-6
[output]
interval = 2e-6
energy_every = 5
"#;

fn table(text: &str) -> Vec<Vec<String>> {
    let rows = text.lines().skip(1);
    rows.map(|l| l.split(',').map(str::to_owned).collect()).collect()
}

fn number(row: &[String], column: usize) -> f64 {
    row[column].parse().expect("a number")
}

#[test]
fn breaks_tell_their_mode_and_pieces_keep_mass_and_momentum() {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("fragments");
    let _ = std::fs::remove_dir_all(&folder);
    let scene = Scene::from_text(BAR).expect("a scene");
    let run_folder = RunFolder::new(&scene, Some(&folder), true).expect("a folder");
    let results = scene
        .prepare()
        .expect("built")
        .run_into(run_folder, &mut Silent)
        .expect("runs");
    let read = |name: &str| std::fs::read_to_string(folder.join(name)).expect("a table");

    let text = read("breaks.csv");
    assert!(text.starts_with("time [s],model,x [m],y [m],z [m],mode,released [J],in an overlap [-]\n"));
    let breaks = table(&text);
    assert!(breaks.len() >= 5, "{} bonds broke", breaks.len());
    let modes: Vec<&str> = breaks.iter().map(|b| b[5].as_str()).collect();
    assert!(
        modes
            .iter()
            .all(|m| ["tension", "bending", "torsion"].contains(m)),
        "rankine breaks in tension"
    );
    assert!(
        breaks.windows(2).all(|w| number(&w[0], 0) <= number(&w[1], 0)),
        "in the order of time"
    );
    let released: f64 = breaks.iter().map(|b| number(b, 6)).sum();
    let facts = &results.summary().effect_ledger[0].facts;
    assert!((released / facts["released energy [J]"] - 1.0).abs() < 1e-10);

    let text = read("fragments.csv");
    let pieces = table(&text);
    let line = results.summary();
    let mass = line.models[0].packing.as_ref().expect("a packing").mass;
    let start: Vec<f64> = [5, 6, 7].map(|c| mass * number(&pieces[0], c)).into();
    let mut times: Vec<f64> = pieces.iter().map(|p| number(p, 0)).collect();
    times.dedup();
    assert_eq!(times.len(), line.frames, "at the instants of the frames");
    for t in &times {
        let now = || pieces.iter().filter(|p| number(p, 0) == *t);
        let sum = |column: usize| now().map(|p| number(p, 4) * number(p, column)).sum::<f64>();
        let total: f64 = now().map(|p| number(p, 4)).sum();
        assert!((total / mass - 1.0).abs() < 1e-10, "{total:e} of {mass:e} kg");
        let particles: f64 = now().map(|p| number(p, 3)).sum();
        assert_eq!(
            particles as usize,
            results.run.subdomains()[0].model().nodes().len()
        );
        // No force acts from outside.
        let first = pieces[0..1]
            .iter()
            .map(|p| number(p, 4) * number(p, 8))
            .sum::<f64>();
        let size: f64 = 8.0 * mass;
        assert!(
            (sum(8) - first).abs() < 1e-10 * size && (sum(9)).abs() < 1e-10 * size,
            "{t:e}"
        );
        // Places are those of the instant: the centre of all pieces moves on uniformly.
        for (c, start) in start.iter().enumerate() {
            let shift = sum(5 + c) - start;
            let wanted = if c == 0 { first * t } else { 0.0 };
            assert!(
                (shift - wanted).abs() < 1e-12 * 8e-3 * mass,
                "{c} at {t:e}: {shift:e}, not {wanted:e}"
            );
        }
        // All particles without bonds are one row, not a piece each.
        assert!(now().all(|p| number(p, 2) == 0.0 || number(p, 3) >= 2.0));
        assert!(now().filter(|p| number(p, 2) == 0.0).count() <= 1);
    }
    let last = *times.last().expect("instants");
    let last_pieces: Vec<&Vec<String>> = pieces.iter().filter(|p| number(p, 0) == last).collect();
    let first: Vec<&Vec<String>> = pieces.iter().filter(|p| number(p, 0) == 0.0).collect();
    assert_eq!(first.len(), 1, "one body at the start");
    let heavy: Vec<_> = last_pieces.iter().filter(|p| number(p, 2) > 0.0).collect();
    assert!(heavy.len() >= 2, "{last_pieces:?}");
    assert!(
        heavy.windows(2).all(|w| number(w[0], 4) >= number(w[1], 4)),
        "heaviest first"
    );
    assert_eq!(results.recorded.fragments.len(), pieces.len());
}

/// A run that is stopped and resumed has the same tables as an uninterrupted one.
#[test]
fn modes_and_pieces_survive_a_checkpoint() {
    struct Half;
    impl arlequin_scene::Observer for Half {
        fn step(&mut self, run: &arlequin::core::Coupled<f64>, planned: usize) -> std::ops::ControlFlow<()> {
            if run.steps() == planned / 2 {
                return std::ops::ControlFlow::Break(());
            }
            std::ops::ControlFlow::Continue(())
        }
    }
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("fragments-resumed");
    let _ = std::fs::remove_dir_all(&folder);
    let tables = |place: &std::path::Path| {
        [
            "breaks.csv",
            "fragments.csv",
            "probes.csv",
            "energy.csv",
            "results.pvd",
        ]
        .map(|n| std::fs::read_to_string(place.join(n)).expect("a table"))
    };
    let begin = |name: &str, observer: &mut dyn arlequin_scene::Observer| {
        let scene = Scene::from_text(BAR).expect("a scene");
        let run_folder = RunFolder::new(&scene, Some(&folder.join(name)), true).expect("a folder");
        scene
            .prepare()
            .expect("built")
            .run_into(run_folder, observer)
            .expect("runs");
    };
    begin("whole", &mut Silent);
    begin("halves", &mut Half);
    let resumed = arlequin_scene::resume(&folder.join("halves")).expect("a checkpoint");
    resumed.run(&mut Silent).expect("goes on");
    assert!(
        tables(&folder.join("whole")) == tables(&folder.join("halves")),
        "the same tables"
    );
}

/// The energy densities of particles in the frames sum to the internal energy of the ledger, under both laws,
/// after bonds broke.
#[test]
fn energy_densities_in_frames_sum_to_the_internal_energy_of_the_ledger() {
    for law in ["false", "true"] {
        let scene = Scene::from_text(BAR).expect("a scene");
        let scene = scene.set("model.bar.dem.finite_rotations", law).expect("a key");
        let scene = scene.set("output.energy_every", "1").expect("a key");
        let built = arlequin_scene::setup::build(scene.spec(), scene.folder()).expect("built");
        let pictures = Pictures {
            models: built.models,
            mediators: built.mediators,
            rigid: built.rigid,
        };
        let results = scene.prepare().expect("built").run(&mut Silent).expect("runs");
        let frames = Frames::new(None, &[OutputField::EnergyDensity], &results.run, pictures);
        let picture = frames
            .picture(&results.run, 0)
            .expect("a picture")
            .expect("a model");
        assert!(
            picture.cells.iter().all(|a| !a.name.starts_with("energy")),
            "no gradients"
        );
        let array = picture.points.iter().find(|a| a.name == "energy density [J/m3]");
        let volumes = results.run.subdomains()[0]
            .model()
            .views()
            .particles
            .expect("particles");
        let densities = &array.expect("an array").values;
        let sum: f64 = densities.iter().zip(volumes).map(|(w, v)| w * v.measure).sum();
        let ledger = results.recorded.energy.column("internal [J]").expect("a column");
        let internal = *ledger.last().expect("a sample");
        assert!(
            (sum / internal - 1.0).abs() < 1e-12,
            "{law}: {sum:e} for {internal:e} J"
        );
        assert!(results.summary().effect_ledger[0].facts["broken bonds"] >= 5.0);
    }
}
