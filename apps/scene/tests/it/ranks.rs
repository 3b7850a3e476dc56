//! Scenes on several ranks, as threads: the files of one rank, errors that all ranks agree on, and
//! checkpoints for any number of ranks.

use crate::shipped::SHIPPED;
use arlequin::core::Coupled;
use arlequin::core::ranks::Communicator;
use arlequin_mpi::threads;
use arlequin_scene::{End, Error, Observer, Result, Results, RunFolder, Scene, Silent, resume_on};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

const WAIT: Duration = Duration::from_secs(60);

/// A pulse that runs from elements into some 1 400 spheres, which have a support in the overlap.
const PULSE: &str = r#"
[model.left]
kind = "fem"
role = "coarse"
shape.box = { low = [0.0, 0.0, 0.0], high = [6e-3, 2e-3, 2e-3] }
spacing = 0.5e-3
material = { young = 75e9, poisson = 0.17, density = 2200.0 }
[model.right]
kind = "dem"
role = "fine"
shape.box = { low = [4e-3, 0.0, 0.0], high = [12e-3, 2e-3, 2e-3] }
spacing = 0.3e-3
dem.protocol = "quench"
material = { young = 75e9, poisson = 0.17, density = 2200.0 }
[interface.middle]
coarse = "left"
fine = "right"
overlap.slab = { coarse = [4e-3, 0.0, 0.0], fine = [6e-3, 0.0, 0.0] }
weight = { profile = "cubic" }
mediator = { spacing = 1e-3 }
[[support]]
model = "right"
where.box = { low = [5e-3, -1e-3, -1e-3], high = [6e-3, 3e-3, 0.2e-3] }
components = ["z"]
[[support]]
model = "left"
where.box = { low = [5e-3, -1e-3, -1e-3], high = [6e-3, 3e-3, 0.1e-3] }
components = ["z"]
[[support]]
model = "right"
where = "x-max"
components = ["y"]
motion = { amplitude = 1e-7, time.ramp = { duration = 1e-6 } }
[[effect]]
mass_damping = { rate = 1e4 }
[[load]]
model = "right"
where = "x-max"
force = [0.0, 0.0, 1.0]
time.pulse = { duration = 1e-6 }
[[load]]
model = "left"
where = "x-min"
force = [100.0, 0.0, 0.0]
time.pulse = { duration = 1e-6 }
[time]
end = 2.5e-6
[probe.near]
model = "left"
where = "x-max"
quantity = "velocity"
component = "x"
[probe.far]
model = "right"
where.box = { low = [8e-3, -1e-3, -1e-3], high = [9e-3, 3e-3, 3e-3] }
quantity = "velocity"
component = "x"
[probe.twist]
model = "right"
where.box = { low = [8e-3, -1e-3, -1e-3], high = [9e-3, 3e-3, 3e-3] }
quantity = "rotation"
component = "x"
[probe.held]
of = "support-1"
quantity = "force"
component = "z"
[probe.pressed]
model = "left"
where.box = { low = [1e-3, -1e-3, -1e-3], high = [4e-3, 3e-3, 1e-3] }
quantity = "strain"
component = "xx"
[probe.mises]
model = "right"
at = [9e-3, 1e-3, 1e-3]
quantity = "von-mises"
[output]
interval = 0.5e-6
energy_every = 5
fields = ["displacement", "velocity", "weights", "energy-density", "multipliers", "stress", "von-mises", "bond-forces"]
"#;

/// A notched bar of some 1 500 spheres that is stretched until it parts.
const BREAKING: &str = r#"
[model.bar]
kind = "dem"
shape.box = { low = [0.0, 0.0, 0.0], high = [8e-3, 2e-3, 2e-3] }
spacing = 0.3e-3
dem.protocol = "quench"
material = { young = 75e9, poisson = 0.17, density = 2200.0 }
dem.notch = [{ low = [4e-3, -1e-3, -1e-3], high = [4e-3, 3e-3, 1.2e-3] }]
[[effect]]
fracture = { criterion = "rankine", strength = 100e6, weibull = 10.0 }
[[initial]]
velocity.polynomial = { component = "x", along = "x", coefficients = [-3.0, 2000.0] }
[time]
end = 4e-6
[probe.end]
model = "bar"
where = "x-max"
quantity = "velocity"
component = "x"
[output]
interval = 0.5e-6
energy_every = 5
fields = ["displacement", "velocity", "bond-forces", "stress"]
"#;

/// Returns [`BREAKING`], stretched less and pushed back together so that pieces touch; a free ball strikes
/// one end, a driven wall the other, and elements absorb short waves.
fn touching() -> String {
    let additions = r#"
[model.grip]
kind = "fem"
role = "coarse"
shape.box = { low = [-4e-3, 0.0, 0.0], high = [1.5e-3, 2e-3, 2e-3] }
spacing = 0.5e-3
material = { young = 75e9, poisson = 0.17, density = 2200.0 }
[interface.rim]
coarse = "grip"
fine = "bar"
overlap.slab = { coarse = [0.0, 0.0, 0.0], fine = [1.5e-3, 0.0, 0.0] }
mediator = { spacing = 0.75e-3 }
absorber = { rate_factor = 0.2 }
[[effect]]
models = ["bar"]
contact = { friction = 0.3, rolling = 0.1 }
[[effect]]
models = ["bar"]
[effect.obstacle]
name = "ball"
shape.sphere = { centre = [6e-3, 1e-3, 3.002e-3], radius = 1e-3 }
mass = 2e-5
velocity = [2.0, 0.0, -40.0]
spin = [0.0, 3e4, 0.0]
contact = { friction = 0.3 }
[[effect]]
models = ["bar"]
[effect.obstacle]
name = "wall"
shape.plane = { point = [8.02e-3, 0.0, 0.0], normal = [-1.0, 0.0, 0.0] }
velocity = [-60.0, 0.0, 0.0]
contact = { restitution = 1.0 }
[probe.ball]
of = "ball"
quantity = "force"
component = "z"
[probe.wall]
of = "wall"
quantity = "moment"
about = [8e-3, 1e-3, 1e-3]
component = "y"
"#;
    let bar = BREAKING
        .replace("kind = \"dem\"\n", "kind = \"dem\"\nrole = \"fine\"\n")
        .replace("[[initial]]", "[[initial]]\nmodels = [\"bar\"]")
        .replace("coefficients = [-3.0, 2000.0]", "coefficients = [0.0, 0.0, 0.0]")
        .replace("strength = 100e6", "strength = 200e6")
        .replace("\"stress\"]", "\"contact-forces\"]");
    format!("{bar}{additions}")
}

fn scratch(name: &str) -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("ranks-{name}"));
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).expect("a folder");
    folder
}

fn scene(text: &str) -> Scene {
    Scene::from_text(text).expect("a scene")
}

/// Runs a scene into a folder, also as one of several ranks.
fn run(scene: &Scene, folder: &Path, observer: &mut dyn Observer) -> Result<Results> {
    let run_folder = RunFolder::new(scene, Some(folder), true)?;
    scene.prepare()?.run_into(run_folder, observer)
}

/// Runs a scene into a folder on every rank and returns the result of each.
fn on_ranks(ranks: usize, scene: &Scene, folder: &Path) -> Vec<Result<Results>> {
    let run_on_rank = |c: Arc<dyn Communicator>| run(&scene.clone().on_ranks(c)?, folder, &mut Silent);
    let per_rank = threads::run(ranks, 1, WAIT, run_on_rank).into_iter();
    per_rank.map(|r| r.expect("no rank is lost")).collect()
}

/// Returns the files below a folder with their bytes, without times and memory.
fn files(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut out = Vec::new();
    let mut open = vec![folder.to_owned()];
    while let Some(directory) = open.pop() {
        for entry in std::fs::read_dir(&directory).expect("a folder").flatten() {
            let path = entry.path();
            let name = path.strip_prefix(folder).expect("inside").to_owned();
            if path.is_dir() {
                open.push(path);
            } else if name != Path::new("summary.json") && name != Path::new(".arlequin-results") {
                out.push((name, std::fs::read(&path).expect("a file")));
            }
        }
    }
    out.sort();
    out
}

fn assert_same_files(single: &Path, parallel: &Path, what: &str) {
    let (a, b) = (files(single), files(parallel));
    let names = |f: &[(PathBuf, Vec<u8>)]| f.iter().map(|f| f.0.clone()).collect::<Vec<_>>();
    assert_eq!(names(&a), names(&b), "{what}");
    assert!(a.len() > 5, "{what}");
    for ((name, a), (_, b)) in a.iter().zip(&b) {
        assert!(a == b, "{what}: {}", name.display());
    }
}

/// Returns the computed numbers of a summary as text.
fn report_text(r: &Results) -> String {
    let s = r.summary();
    let text = format!(
        "{:?} {:?} {:?} {:?} {:?} {:?}",
        s.models, s.energy, s.momentum, s.interface, s.probes, s.warnings
    );
    text
}

#[test]
fn files_and_summaries_are_those_of_one_rank() {
    let folder = scratch("files");
    let scene = scene(PULSE);
    let single = run(&scene, &folder.join("one"), &mut Silent).expect("runs");
    assert!(single.summary().ranks.is_empty());
    for ranks in [1, 2, 3, 4] {
        let place = folder.join(format!("on-{ranks}"));
        for (rank, r) in on_ranks(ranks, &scene, &place).into_iter().enumerate() {
            let r = r.expect("runs");
            assert_eq!(report_text(&r), report_text(&single), "rank {rank} of {ranks}");
            assert_eq!(r.folder.is_some(), rank == 0);
            let parts: Vec<bool> = r.summary().ranks.iter().map(|l| l.parts).collect();
            let wanted: &[bool] = match ranks {
                1 => &[],
                // The elements have two units.
                2 => &[true, true],
                _ => &[false, true],
            };
            assert_eq!(parts, wanted);
        }
        assert_same_files(&folder.join("one"), &place, &format!("{ranks} ranks"));
    }
}

#[test]
fn shipped_scenes_have_the_probes_of_one_rank() {
    for (name, changes) in SHIPPED {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../examples/scenes/{name}.toml"));
        let changes: Vec<String> = changes.iter().map(|c| (*c).to_owned()).collect();
        let scene = Scene::read(path)
            .and_then(|s| s.assign(&changes))
            .expect("a scene");
        let single = scene.prepare().expect("built").run(&mut Silent).expect("runs");
        assert!(single.recorded.probes.times.len() > 10, "{name}");
        let on_ranks = threads::run(3, 1, WAIT, |c| {
            scene.clone().on_ranks(c)?.prepare()?.run(&mut Silent)
        });
        for r in on_ranks {
            let r = r.expect("there").expect("runs");
            assert!(
                r.summary().ranks.iter().any(|l| l.parts),
                "{name}: {:?}",
                r.summary().ranks
            );
            let tables = [&r, &single].map(|r| (&r.recorded.probes, &r.recorded.energy, &r.recorded.effects));
            assert!(tables[0] == tables[1], "{name}: {:?}", r.recorded.probes);
        }
    }
}

/// Observer that ends the run at a step if its flag is set, which one rank does.
struct Stop(usize, bool);

impl Observer for Stop {
    fn step(&mut self, run: &Coupled<f64>, _: usize) -> ControlFlow<()> {
        if self.1 && run.steps() >= self.0 {
            return ControlFlow::Break(());
        }
        ControlFlow::Continue(())
    }
}

/// Stops a run on some ranks when the last of them asks for it after `steps` steps, resumes it on another
/// number of ranks, and asserts that the files are those of one rank; `stopped` checks the results of each
/// stop.
fn goes_on_elsewhere(scene: &Scene, whole: &Path, steps: usize, stopped: impl Fn(&Results, usize) + Sync) {
    for (first, then) in [(3, 2), (2, 1), (1, 4)] {
        let name = whole.file_name().expect("a name").to_string_lossy();
        let place = whole.with_file_name(format!("{name}-{first}-{then}"));
        let ends = threads::run(first, 1, WAIT, |c| {
            let mut stop = Stop(steps, c.rank() + 1 == first);
            let done = run(&scene.clone().on_ranks(c)?, &place, &mut stop);
            done.inspect(|r| stopped(r, first)).map(|r| r.end)
        });
        for end in ends {
            assert_eq!(end.expect("there").expect("stops"), End::Interrupted);
        }
        let gone_on = threads::run(then, 1, WAIT, |c| {
            resume_on(&place, Some(c))?.run(&mut Silent).map(|r| r.end)
        });
        for end in gone_on {
            assert_eq!(end.expect("there").expect("goes on"), End::Complete);
        }
        assert_same_files(whole, &place, &format!("{first} ranks, then {then}"));
    }
}

#[test]
fn a_run_that_one_rank_stops_goes_on_with_another_number_of_ranks() {
    let folder = scratch("resumed");
    for finite in ["false", "true"] {
        let text = PULSE.replace(
            "dem.protocol",
            &format!("dem.finite_rotations = {finite}\ndem.protocol"),
        );
        let scene = scene(&text);
        let whole = folder.join(format!("whole-{finite}"));
        run(&scene, &whole, &mut Silent).expect("runs");
        goes_on_elsewhere(&scene, &whole, 7, |r, ranks| {
            // The ledger is drawn every fifth step.
            assert_eq!(r.run.steps(), if ranks == 1 { 7 } else { 10 });
        });
    }
}

#[test]
fn what_breaks_and_falls_to_pieces_is_written_as_by_one_rank() {
    let folder = scratch("breaking");
    for finite in ["false", "true"] {
        let changed = format!("dem.finite_rotations = {finite}\ndem.protocol");
        let scene = scene(&BREAKING.replace("dem.protocol", &changed));
        let whole = folder.join(format!("one-{finite}"));
        let single = run(&scene, &whole, &mut Silent).expect("runs");
        let lines = |name: &str| {
            std::fs::read_to_string(whole.join(name))
                .expect("a table")
                .lines()
                .count()
        };
        let frames = single.summary().frames;
        assert!(
            lines("breaks.csv") > 50,
            "{} bonds broke",
            lines("breaks.csv") - 1
        );
        // One piece at the start, then more and more.
        assert!(
            lines("fragments.csv") > 2 * frames,
            "{} pieces in {frames} frames",
            lines("fragments.csv")
        );
        let warned = format!("{:?}", single.summary().warnings);
        assert!(warned.contains("switch contact on"), "{warned}");
        for ranks in [2, 3, 4] {
            let place = folder.join(format!("on-{ranks}-{finite}"));
            for r in on_ranks(ranks, &scene, &place) {
                let r = r.expect("runs");
                assert!(r.summary().ranks[0].parts, "{:?}", r.summary().ranks);
                assert_eq!(report_text(&r), report_text(&single), "{ranks} ranks");
            }
            assert_same_files(&whole, &place, &format!("{ranks} ranks, finite {finite}"));
        }
    }
}

#[test]
fn bonds_that_broke_on_some_ranks_are_broken_on_any_number_of_others() {
    let folder = scratch("broken");
    let scene = scene(BREAKING);
    let whole = folder.join("whole");
    let single = run(&scene, &whole, &mut Silent).expect("runs");
    goes_on_elsewhere(&scene, &whole, single.planned / 2, |r, _| {
        let broken = r.summary().effect_ledger[0].facts["broken bonds"];
        assert!(broken > 10.0, "stopped after {broken} breaks");
    });
}

#[test]
fn what_touches_across_ranks_is_written_as_by_one_rank() {
    let folder = scratch("touching");
    let scene = scene(&touching());
    let whole = folder.join("one");
    let single = run(&scene, &whole, &mut Silent).expect("runs");
    let fact = |effect: &str, fact: &str| {
        let mut ledger = single.summary().effect_ledger.iter();
        let line = ledger.find(|e| e.name.ends_with(effect)).expect("an effect");
        line.facts[fact]
    };
    // Pieces touch, both obstacles push, and pairs are searched for again on the way.
    assert!(fact("/fracture", "broken bonds") > 50.0);
    assert!(
        fact("/contact", "most contacts") > 20.0,
        "{:?}",
        single.summary().effect_ledger
    );
    assert!(fact("/contact", "neighbour searches") > 1.0);
    assert!(fact("/ball", "largest force [N]") > 1.0 && fact("/wall", "largest force [N]") > 1.0);
    for ranks in [2, 3, 4] {
        let place = folder.join(format!("on-{ranks}"));
        for r in on_ranks(ranks, &scene, &place) {
            let r = r.expect("runs");
            let bar = r
                .summary()
                .ranks
                .iter()
                .find(|l| l.model == "bar")
                .expect("a line");
            assert!(bar.parts, "{bar:?}");
            assert_eq!(report_text(&r), report_text(&single), "{ranks} ranks");
        }
        assert_same_files(&whole, &place, &format!("{ranks} ranks"));
    }
    goes_on_elsewhere(&scene, &whole, single.planned / 2, |_, _| ());
}

/// Strengths that no effect enforces are compared at the end over the bonds of all ranks.
#[test]
fn ranks_find_together_what_a_state_would_need() {
    let unenforced = BREAKING.replace("weibull = 10.0 }", "weibull = 10.0 }\nenabled = false");
    let scene = scene(&unenforced).set("time.end", "1.5e-6").expect("a scene");
    let single = scene.prepare().expect("built").run(&mut Silent).expect("runs");
    let warned = format!("{:?}", single.summary().warnings);
    assert!(
        warned.contains("bonds are loaded above their strength"),
        "{warned}"
    );
    let per_rank = threads::run(3, 1, WAIT, |c| {
        scene.clone().on_ranks(c)?.prepare()?.run(&mut Silent)
    });
    for r in per_rank {
        let r = r.expect("there").expect("runs");
        assert!(r.summary().ranks[0].parts, "{:?}", r.summary().ranks);
        assert_eq!(report_text(&r), report_text(&single));
    }
}

/// Returns the error of every rank: the original one, and on the other ranks the one that reports it.
fn errors(per_rank: Vec<Result<Results>>) -> Vec<Error> {
    per_rank
        .into_iter()
        .map(|r| r.map(|_| ()).expect_err("fails"))
        .collect()
}

#[test]
fn errors_are_those_of_one_rank_and_the_others_know() {
    let folder = scratch("errors");
    // The scene is wrong from the start.
    let wrong = scene(&PULSE.replace("where = \"x-max\"\nquantity", "where = \"nowhere\"\nquantity"));
    let failures = errors(on_ranks(3, &wrong, &folder.join("wrong")));
    assert!(
        failures[0].to_string().contains("nowhere") && failures[0].is_input(),
        "{}",
        failures[0]
    );
    assert_eq!(failures[0].place().0, Some("probe.near.where"));
    for e in &failures[1..] {
        assert!(matches!(e, Error::Elsewhere { rank: 0, input: true }), "{e}");
    }
    // Only the first rank sees a folder that must not be replaced.
    let taken = folder.join("taken");
    std::fs::create_dir(&taken).expect("a folder");
    std::fs::write(taken.join("letter.txt"), "dear").expect("a file");
    let failures = errors(on_ranks(2, &scene(PULSE), &taken));
    assert!(
        failures[0].to_string().contains("mark of results"),
        "{}",
        failures[0]
    );
    assert!(
        matches!(failures[1], Error::Elsewhere { rank: 0, .. }),
        "{}",
        failures[1]
    );
    // Numbers overflow on every rank, and the results up to then are kept.
    let text = PULSE.replace("force = [100.0,", "force = [1e200,");
    let place = folder.join("exploding");
    let failures = errors(on_ranks(2, &scene(&text), &place));
    assert!(matches!(&failures[0], Error::Kept { .. }), "{}", failures[0]);
    for e in &failures {
        assert!(e.is_everywhere() && !e.is_input(), "{e}");
    }
    assert!(place.join("probes.csv").exists());
}

#[test]
fn ranks_with_different_scenes_are_refused_on_every_rank() {
    let folder = scratch("different");
    let per_rank = threads::run(3, 1, WAIT, |c| {
        let end = if c.rank() == 2 { "3e-6" } else { "2.5e-6" };
        let scene = scene(PULSE).set("time.end", end)?;
        run(&scene.on_ranks(c)?, &folder.join("out"), &mut Silent)
    });
    for (rank, r) in per_rank.into_iter().enumerate() {
        let e = r.expect("there").map(|_| ()).expect_err("refused");
        let text = e.to_string();
        assert!(
            text.contains(&format!("rank {rank}: ranks differ in the scene")),
            "{text}"
        );
        assert!(e.is_everywhere(), "{text}");
    }
    assert!(!folder.join("out").exists());
}

#[test]
fn what_a_scene_asks_of_particles_decides_whether_they_go_in_parts() {
    let line = |text: &str, ranks: usize| {
        let built = scene(text).for_ranks(ranks).prepare().expect("built");
        let mut holdings = built.built().holdings.clone();
        let holding = holdings.iter().find(|l| l.model == "left").expect("a line");
        let nodes = if ranks > 2 {
            "fewer than ranks"
        } else {
            "2 units of 256 nodes"
        };
        assert!(holding.words.contains(nodes), "{}", holding.words);
        holdings.remove(holdings.iter().position(|l| l.model == "right").expect("a line"))
    };
    let parts = line(PULSE, 3);
    assert!(
        parts.parts && parts.words.ends_with(" units of 256 particles"),
        "{}",
        parts.words
    );
    let whole = |addition: &str, ranks: usize, reason: &str| {
        let l = line(&format!("{PULSE}\n{addition}"), ranks);
        assert!(!l.parts && l.words.contains(reason), "{addition}: {}", l.words);
    };
    whole("", 40, "fewer than ranks");
    let two_bodies = r#"
[model.ball]
kind = "dem"
shape.box = { low = [13e-3, 0.0, 0.0], high = [15e-3, 2e-3, 2e-3] }
spacing = 0.4e-3
dem.protocol = "quench"
material = { young = 75e9, poisson = 0.17, density = 2200.0 }
[[effect]]
between = ["right", "ball"]
contact = {}
"#;
    whole(two_bodies, 2, "effect[1].contact");
    let elements = |addition: &str| {
        let text = format!("{PULSE}\n{addition}");
        let built = scene(&text).for_ranks(2).prepare().expect("built");
        let holding = built.built().holdings[0].clone();
        assert!(!holding.parts, "{addition}");
        holding.words
    };
    let viscous = elements("[[effect]]\nmodels = [\"left\"]\nbulk_viscosity = {}");
    assert_eq!(viscous, "effect[1].bulk_viscosity does not go in parts");
}
