//! Speed of scenes as ratios: effects against the bare kernel, coupled runs against particles everywhere,
//! fine mediators against their parts, frames, memory and packings.
//!
//! ```text
//! cargo bench --bench scenes                      all of it
//! cargo bench --bench scenes -- effects output    some of effects, coupling, mediator, output and packing
//! ```
//!
//! Runs that are compared are made in turns on one thread, and the least of many times is taken: on a shared
//! machine only such ratios repeat. Forces of natural elements against tetrahedra: `cargo bench --bench
//! forces`. LAMMPS needs an export and an input of its own: `dem-beam/benches/README.md`.
#![allow(clippy::print_stdout, reason = "a benchmark shows its figures")]

use arlequin::core::{Coupled, Phase};
use arlequin_scene::setup::{self, Built};
use arlequin_scene::{PhaseClock, RunFolder, Scene, Silent, Source};
use std::collections::BTreeMap;
use std::time::Instant;

type Outcome<T> = Result<T, Box<dyn std::error::Error>>;

/// Rounds over all runs that are compared.
const ROUNDS: usize = 12;

/// Shortest time of a run in a round \[s\].
const TURN: f64 = 0.03;

const EXAMPLES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples");

fn read(file: &str, changes: &[&str]) -> Outcome<Scene> {
    let changes: Vec<String> = changes.iter().map(|c| (*c).to_owned()).collect();
    Ok(Scene::read(format!("{EXAMPLES}/{file}"))?.assign(&changes)?)
}

fn build(scene: &Scene) -> Outcome<Built> {
    Ok(setup::build(scene.spec(), scene.folder())?)
}

/// Least times of a step \[s\]: the whole step, its interfaces, and each effect by name.
struct Least {
    step: f64,
    interfaces: f64,
    effects: BTreeMap<String, f64>,
}

/// Measures runs in turns.
fn least(runs: &mut [&mut Coupled<f64>]) -> Outcome<Vec<Least>> {
    let mut steps = Vec::new();
    for run in &mut *runs {
        run.run(2, &mut PhaseClock::new())?;
        let start = Instant::now();
        run.run(2, &mut PhaseClock::new())?;
        steps.push((2.0 * TURN / start.elapsed().as_secs_f64()).ceil() as usize);
    }
    let fresh = || Least {
        step: f64::INFINITY,
        interfaces: f64::INFINITY,
        effects: BTreeMap::new(),
    };
    let mut out: Vec<Least> = runs.iter().map(|_| fresh()).collect();
    for _ in 0..ROUNDS {
        for ((run, best), steps) in runs.iter_mut().zip(&mut out).zip(&steps) {
            let (mut clock, start) = (PhaseClock::new(), Instant::now());
            run.run(*steps, &mut clock)?;
            let per_step = |seconds: f64| seconds / *steps as f64;
            best.step = best.step.min(per_step(start.elapsed().as_secs_f64()));
            best.interfaces = best.interfaces.min(per_step(clock.seconds(Phase::Interface)));
            let phases = clock.phases(run).into_iter();
            for (name, seconds) in phases.filter(|p| p.0.starts_with("effect/")) {
                let least = best.effects.entry(name).or_insert(f64::INFINITY);
                *least = least.min(per_step(seconds));
            }
        }
    }
    Ok(out)
}

/// Number of bonds of all models.
fn bonds(run: &Coupled<f64>) -> f64 {
    let links = run.subdomains().iter().filter_map(|s| s.model().views().links);
    links.map(|l| l.pairs().len()).sum::<usize>() as f64
}

/// Number of spheres of all models.
fn spheres(run: &Coupled<f64>) -> f64 {
    let particles = run
        .subdomains()
        .iter()
        .filter_map(|s| s.model().views().particles);
    particles.map(<[_]>::len).sum::<usize>() as f64
}

/// Plate of spheres of 0.5 mm under a ball that touches it at once, with some of its effects.
fn plate(effects: &[&str]) -> Outcome<Built> {
    let ball = "[effect.obstacle]\nname = \"ball\"\nshape.sphere = { centre = [0.0, 0.0, 8e-3], radius = 8e-3 }\nmass = \
                2.6e-4\nvelocity = [0.0, 0.0, -20.0]\ncontact = { friction = 0.2 }";
    let table = |name: &&str| {
        let value = match *name {
            "fracture" => "fracture = { criterion = \"rankine\", strength = 1.2e9, weibull = 8.0 }",
            "contact" => "contact = { friction = 0.3 }",
            _ => ball,
        };
        format!("[[effect]]\n{value}\n")
    };
    let effects: String = effects.iter().map(table).collect();
    let text = format!(
        "[model.grains]\nkind = \"dem\"\nspacing = 0.5e-3\nshape.box = {{ low = [-16e-3, -16e-3, -4e-3], high = [16e-3, \
         16e-3, 0.0] }}\nmaterial = {{ young = 72.5e9, poisson = 0.17, density = 2200.0 }}\n{effects}[time]\nend = \
         1e-3\n[output]\nenergy_every = 10\n"
    );
    build(&Scene::from_text(text)?)
}

/// Prints what effects add to the step of particles.
fn effects() -> Outcome<()> {
    let cases: [&[&str]; 5] = [
        &[],
        &["fracture"],
        &["contact"],
        &["ball"],
        &["fracture", "contact", "ball"],
    ];
    let mut built = cases.iter().map(|c| plate(c)).collect::<Outcome<Vec<Built>>>()?;
    let count = bonds(&built[0].run);
    let mut runs: Vec<_> = built.iter_mut().map(|b| &mut b.run).collect();
    let times = least(&mut runs)?;
    println!("effects: plate of spheres of 0.5 mm, {count} bonds, ledger in every tenth step");
    for (case, t) in cases.iter().zip(&times) {
        let name = if case.is_empty() {
            "bare".to_owned()
        } else {
            case.join(" + ")
        };
        println!(
            "  {name:<28} {:6.2} ns/bond {:6.2} of the bare step",
            t.step * 1e9 / count,
            t.step / times[0].step
        );
        for (effect, seconds) in &t.effects {
            println!("    {effect:<26} {:6.2} ns/bond", seconds * 1e9 / count);
        }
    }
    Ok(())
}

/// Prints how many times cheaper the steps of coupled runs are than those of particles everywhere.
fn coupling() -> Outcome<()> {
    let half = "model.grains.spacing=0.5e-3";
    let deep = [
        "model.block=",
        "interface.layer=",
        "support.0.model=grains",
        "probe.below=",
        "model.grains.shape.box.low=[-3e-3,-3e-3,-6e-3]",
    ];
    let cases = [
        (
            "beam A",
            read("sweeps/scenes/beam-a.toml", &[])?,
            read("sweeps/scenes/beam-a-fine.toml", &[])?,
        ),
        (
            "notched bar",
            read("sweeps/scenes/notched-bar.toml", &[])?,
            read("sweeps/scenes/notched-bar-fine.toml", &[])?,
        ),
        (
            "ball impact",
            read("scenes/ball-impact.toml", &[])?,
            read("scenes/ball-impact.toml", &deep)?,
        ),
        (
            "plate, spheres of 0.5 mm",
            read("scenes/plate-impact.toml", &[half])?,
            read("sweeps/scenes/plate-impact-fine.toml", &[half])?,
        ),
    ];
    println!("coupling: time of steps per time that is simulated, against particles everywhere");
    for (name, coupled, fine) in cases {
        let [mut coupled, mut fine] = [build(&coupled)?, build(&fine)?];
        let lengths = [coupled.run.dt(), fine.run.dt()];
        let times = least(&mut [&mut coupled.run, &mut fine.run])?;
        let [a, b] = [0, 1].map(|k| times[k].step / lengths[k]);
        println!(
            "  {name:<28} {:6.2} times cheaper, interfaces {:4.1} % of a coupled step, everywhere {:6.2} ns/bond",
            b / a,
            100.0 * times[0].interfaces / times[0].step,
            times[1].step * 1e9 / bonds(&fine.run)
        );
        for (effect, seconds) in &times[0].effects {
            let coupled_bonds = bonds(&coupled.run);
            println!(
                "    {effect:<26} {:6.2} ns/bond, coupled",
                seconds * 1e9 / coupled_bonds
            );
        }
    }
    Ok(())
}

/// Prints how many times longer a step takes than its parts where mediators are fine.
fn mediator() -> Outcome<()> {
    println!("mediator: beam A with elements, whole step against its parts");
    for spacing in [0.47e-3, 0.3e-3, 0.2e-3, 0.16e-3] {
        let scene = read("scenes/beam-a.toml", &["model.left.kind=fem"])?;
        let mut built = build(&scene.set("interface.middle.mediator.spacing", spacing)?)?;
        let times = least(&mut [&mut built.run])?;
        let report = built.run.interfaces()[0].report();
        println!(
            "  {:>6} multipliers of rank {:>6} {:6.2}",
            report.multipliers,
            report.rank,
            times[0].step / (times[0].step - times[0].interfaces)
        );
    }
    Ok(())
}

/// Prints peak memory and the share of frames of runs with the default fields, each in a process of its own.
fn output(file: &str, changes: &[&str]) -> Outcome<()> {
    let place = std::env::temp_dir().join(format!("arlequin-bench-{}", std::process::id()));
    let scene = read(file, changes)?;
    let folder = RunFolder::new(&scene, Some(&place), true)?;
    let results = scene.prepare()?.run_into(folder, &mut Silent)?;
    let (summary, count) = (results.summary(), spheres(&results.run));
    let wall = &summary.wall_seconds;
    println!(
        "output: {file}, {count} spheres: peak {:5.2} kB per sphere; {} frames take {:4.1} % of {} steps with frames",
        summary.peak_bytes.unwrap_or_default() as f64 / count * 1e-3,
        summary.frames,
        100.0 * wall.output / (wall.output + wall.stepping),
        summary.steps
    );
    std::fs::remove_dir_all(&place)?;
    Ok(())
}

/// Prints the time of packings that are not in the cache.
fn packing() -> Outcome<()> {
    for (name, shape) in [
        (
            "box",
            "shape.box = { low = [0.0, 0.0, 0.0], high = [2.4e-3, 2.4e-3, 2.4e-3] }",
        ),
        ("surface", "shape.file = \"ball.stl\""),
    ] {
        let text = format!(
            "[model.body]\nkind = \"dem\"\nspacing = 0.12e-3\n{shape}\nmaterial = {{ young = 75e9, poisson = 0.17, density = \
             2200.0 }}\n[time]\nend = 1e-6\n"
        );
        let source = Source::new(format!("{EXAMPLES}/scenes/bench.toml"), text);
        let built = build(&Scene::from_source(source)?)?;
        let packed = built.phases.iter().filter(|p| p.phase.contains("pack"));
        let seconds: f64 = packed.map(|p| p.seconds).sum();
        let count = spheres(&built.run);
        println!(
            "packing: {name:<10} {count:6} spheres, {:.3} ms per sphere",
            seconds / count * 1e3
        );
    }
    Ok(())
}

/// Runs a part in a process of its own, because peaks of memory are those of processes; with an empty cache
/// of packings where `fresh` is set.
fn apart(part: &str, fresh: bool) -> Outcome<()> {
    let mut command = std::process::Command::new(std::env::current_exe()?);
    command.arg(format!("only-{part}"));
    let place = std::env::temp_dir().join(format!("arlequin-bench-cache-{}", std::process::id()));
    if fresh {
        command.env("ARLEQUIN_CACHE", &place);
    }
    let status = command.status()?;
    if fresh && place.exists() {
        std::fs::remove_dir_all(&place)?;
    }
    match status.success() {
        true => Ok(()),
        false => Err(format!("the process that measures {part} failed").into()),
    }
}

/// A part of the bench.
type Part = (&'static str, fn() -> Outcome<()>);

const PARTS: [Part; 7] = [
    ("effects", effects),
    ("coupling", coupling),
    ("mediator", mediator),
    ("output-bar", || {
        output("sweeps/scenes/notched-bar-fine.toml", &[])
    }),
    ("output-plate", || {
        let half = "model.grains.spacing=0.5e-3";
        output("sweeps/scenes/plate-impact-fine.toml", &[half, "time.end=3e-6"])
    }),
    ("output-beam", || output("scenes/beam-a.toml", &[])),
    ("packing", packing),
];

fn main() -> Outcome<()> {
    // `cargo bench` adds flags, which are skipped; started as a test or to be listed, the program shows
    // nothing.
    let [flags, words] = [true, false].map(|flag| {
        let arguments = std::env::args().skip(1);
        arguments
            .filter(|a| a.starts_with("--") == flag)
            .collect::<Vec<String>>()
    });
    if let Some(only) = words.first().and_then(|w| w.strip_prefix("only-")) {
        let part = PARTS.iter().find(|p| p.0 == only).ok_or("no such part")?;
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
        return Ok(pool.install(|| part.1().map_err(|e| e.to_string()))?);
    }
    let wanted = |name: &str| words.is_empty() || words.iter().any(|w| name.starts_with(w.as_str()));
    if let Some(word) = words
        .iter()
        .find(|w| PARTS.iter().all(|p| !p.0.starts_with(w.as_str())))
    {
        let names = PARTS.map(|p| p.0).join(", ");
        return Err(format!("'{word}' begins none of {names}").into());
    }
    for (name, _) in PARTS {
        if flags.iter().any(|f| f == "--bench") && wanted(name) {
            apart(name, name == "packing")?;
        }
    }
    Ok(())
}
