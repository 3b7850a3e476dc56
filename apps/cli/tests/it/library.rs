//! The library's results of a scene against those of the command line.

use crate::common::{SMALL, scene, scratch, succeed, text};
use arlequin::core::Coupled;
use arlequin_scene::suggest::predict_as_given;
use arlequin_scene::{End, Observer, RunFolder, Scene, Silent, resume};
use std::ops::ControlFlow;

/// Returns the numbers of a table as their bits.
fn bits(csv: &str) -> Vec<Vec<u64>> {
    let row = |l: &str| {
        l.split(',')
            .map(|x| x.parse::<f64>().expect(x).to_bits())
            .collect()
    };
    csv.lines().skip(1).map(row).collect()
}

#[test]
fn the_library_returns_the_probes_that_the_command_line_writes() {
    let folder = scratch("library-quickstart");
    let (file, out) = (scene("quickstart.toml"), folder.join("out"));
    succeed(&[
        "run",
        text(&file),
        "--set",
        "time.end=3e-5",
        "--set",
        "output.plots=false",
        "--out",
        text(&out),
    ]);
    let read = Scene::read(&file)
        .expect("reads")
        .set("time.end", "3e-5")
        .expect("sets");
    let results = read.prepare().expect("builds").run(&mut Silent).expect("runs");
    assert_eq!(results.end, End::Complete);
    assert!(results.folder.is_none() && results.summary().frames == 0);
    for (name, table) in [
        ("probes.csv", &results.recorded.probes),
        ("energy.csv", &results.recorded.energy),
    ] {
        let csv = std::fs::read_to_string(out.join(name)).expect(name);
        let header = csv.lines().next().expect("a header");
        assert_eq!(header, format!("time [s],{}", table.names.join(",")));
        let row = |k: usize| {
            std::iter::once(&table.times)
                .chain(&table.columns)
                .map(|c| c[k].to_bits())
                .collect()
        };
        let rows: Vec<Vec<u64>> = (0..table.times.len()).map(row).collect();
        assert_eq!(rows, bits(&csv), "{name}");
    }
    let (_, values) = results.probe("struck-end").expect("the scene has it");
    assert_eq!(values.last(), Some(&results.summary().probes["struck-end"].last));
    let state = results.model("right").expect("a model").state();
    assert!(state.v.iter().any(|v| *v != 0.0));
}

/// Observer that ends a run after this number of steps.
struct Until(usize);

impl Observer for Until {
    fn step(&mut self, run: &Coupled<f64>, planned: usize) -> ControlFlow<()> {
        assert_eq!(planned, 50);
        if run.steps() < self.0 {
            ControlFlow::Continue(())
        } else {
            ControlFlow::Break(())
        }
    }
}

#[test]
fn a_run_that_its_observer_ends_goes_on_from_its_folder() {
    let target = scratch("library-resume").join("out");
    let scene = Scene::from_text(SMALL).expect("a scene");
    let whole = scene.prepare().expect("builds").run(&mut Silent).expect("runs");
    let file = scratch("library-resume-scene").join("small.toml");
    std::fs::write(&file, SMALL).expect("writes");
    let scene = Scene::read(&file).expect("reads");
    let folder = RunFolder::new(&scene, Some(&target), false).expect("a new folder");
    let first = scene
        .prepare()
        .expect("builds")
        .run_into(folder, &mut Until(20))
        .expect("runs");
    assert_eq!((first.end, first.summary().steps), (End::Interrupted, 20));
    let resumed = resume(&target)
        .expect("a checkpoint")
        .run(&mut Silent)
        .expect("runs");
    assert_eq!((resumed.end, resumed.summary().steps), (End::Complete, 50));
    assert_eq!(resumed.recorded.probes, whole.recorded.probes);
    assert_eq!(resumed.folder.as_deref(), Some(target.as_path()));
}

#[test]
fn a_run_that_its_observer_ends_goes_on_in_memory() {
    let scene = Scene::from_text(SMALL).expect("a scene");
    let whole = scene.prepare().expect("builds").run(&mut Silent).expect("runs");
    let mut part = scene
        .prepare()
        .expect("builds")
        .run(&mut Until(20))
        .expect("runs");
    for steps in [35, 50] {
        assert_eq!(part.end, End::Interrupted);
        part = part
            .resume()
            .expect("steps are left")
            .run(&mut Until(steps))
            .expect("runs");
        assert_eq!((part.summary().steps, part.folder.as_deref()), (steps, None));
    }
    assert_eq!(part.end, End::Complete);
    assert_eq!(part.recorded.probes, whole.recorded.probes);
    assert_eq!(part.recorded.energy, whole.recorded.energy);
    let message = part.resume().expect_err("all steps are made").to_string();
    assert!(
        message.contains("all steps are made; prepare the scene with a later end"),
        "{message}"
    );
}

#[test]
fn changes_add_up_in_their_order() {
    let scene = Scene::from_text(SMALL).expect("a scene");
    let set = scene.set("output.energy_every", 3).expect("sets");
    let set = set.set("model.left.spacing", 0.5).expect("sets");
    let set = set.set("output.energy_every", 7).expect("sets");
    let spec = set.spec();
    assert_eq!(spec.output.energy_every, 7);
    assert_eq!(spec.model["left"].spacing, Some(0.5));
    let expected = [
        "output.energy_every=3",
        "model.left.spacing=0.5",
        "output.energy_every=7",
    ];
    assert_eq!(set.changes(), expected);
}

/// A prediction analyses the overlap with the profile and the junction of the scene.
#[test]
fn a_prediction_is_of_the_overlap_that_the_scene_has() {
    let bar = || Scene::read(scene("bar-1d.toml")).expect("reads");
    let error = |changes: &[&str]| {
        let changes: Vec<String> = changes.iter().map(|c| (*c).to_owned()).collect();
        let set = bar().assign(&changes).expect("sets");
        predict_as_given(&set).expect("predicts").displacement
    };
    let profile = |name: &str| error(&[&format!("interface.joint.weight.profile={name}")]);
    let profiles = ["linear", "cubic", "quintic"].map(profile);
    let differ = |a: f64, b: f64| (a / b - 1.0).abs() > 1e-6;
    assert!(
        differ(profiles[0], profiles[1])
            && differ(profiles[1], profiles[2])
            && differ(profiles[2], profiles[0]),
        "{profiles:?}"
    );
    // Without a length, an H1 junction uses a quarter of the mediator's spacing of 5 mm.
    let kind = "interface.joint.junction.kind=h1-gradient";
    let lengths = [1.25e-3, 5e-3].map(|l| error(&[kind, &format!("interface.joint.junction.length={l}")]));
    let usual = error(&[kind]);
    assert!(
        !differ(usual, lengths[0]) && differ(usual, lengths[1]),
        "{usual} {lengths:?}"
    );
}
