//! Models that sleep: the moment of waking, the state that is handed over, and refusals.
#![allow(clippy::unwrap_used, reason = "a test fails where it cannot go on")]

use crate::common::{WAKING, arlequin, number, scene, scratch, succeed, summary, text, written};
use std::path::{Path, PathBuf};

fn run(path: &Path, extra: &[&str]) -> (PathBuf, String) {
    let out = path.with_file_name("out");
    let mut arguments = vec!["run", text(path), "--out", text(&out), "--force"];
    arguments.extend(extra);
    let printed = succeed(&arguments);
    (out, crate::common::unwrapped(&printed))
}

fn vector(value: &serde_json::Value, pointer: &str) -> [f64; 3] {
    [0, 1, 2].map(|k| number(value, &format!("{pointer}/{k}")))
}

/// Returns `|after − before| / |before|` of the linear momentum.
fn momentum_gap(s: &serde_json::Value) -> f64 {
    let [before, after] = ["before", "after"].map(|w| vector(s, &format!("/wake/momentum_{w}/linear")));
    let size = before.iter().map(|x| x * x).sum::<f64>().sqrt();
    let gap = (0..3).map(|k| (after[k] - before[k]).powi(2)).sum::<f64>().sqrt();
    assert!(size > 0.0);
    gap / size
}

/// Returns the time at which `share` of the height of a pulse `sin²(π t/d)` passes `x` at speed `c`.
fn arrival(x: f64, c: f64, share: f64, d: f64) -> f64 {
    assert!(share > 0.0 && share < 1.0);
    x / c + d / std::f64::consts::PI * share.sqrt().asin()
}

/// The zone wakes when theory has the pulse arrive, and the pulse goes on behind it with its height.
#[test]
fn wakes_as_the_pulse_arrives() {
    let path = written("wake-arrival", WAKING);
    let (out, printed) = run(&path, &[]);
    let s = summary(&out);
    assert!(printed.contains("'right' woke at t ="), "{printed}");
    let [time, x] = [number(&s, "/wake/time"), number(&s, "/wake/place/0")];
    let value = number(&s, "/wake/value");
    assert!((5e-4..7e-4).contains(&value), "{value}");
    let expected = arrival(x, 1.0, value / 1e-3, 10.0);
    assert!(
        (time / expected - 1.0).abs() < 0.02,
        "woke at {time}, theory {expected}"
    );
    assert!(momentum_gap(&s) < 1e-10);
    let jump = number(&s, "/wake/jump") / number(&s, "/wake/energy_before");
    assert!(jump.abs() < 0.01, "energy jumps by {jump}");
    assert!((number(&s, "/energy/initial") / number(&s, "/wake/energy_after") - 1.0).abs() < 1e-12);
    assert!(number(&s, "/energy/h_drift_max") < 1e-11);
    assert!(number(&s, "/time") >= 26.0 && number(&s, "/time") < 26.0 + number(&s, "/dt"));
    // The height is 1e-3, the traction over the impedance 1, and the maximum comes at the expected time.
    assert!((number(&s, "/probes/behind/min") / -1e-3 - 1.0).abs() < 0.05);
    let asleep = summary(&out.join("asleep"));
    assert_eq!(asleep["status"], "woken");
    assert_eq!(asleep["steps"], s["wake"]["step"]);
    assert_eq!(asleep["models"].as_array().map(Vec::len), Some(1));
    assert!((number(&asleep, "/energy/final") / number(&s, "/wake/energy_before") - 1.0).abs() < 1e-12);
    let first = std::fs::read_to_string(out.join("probes.csv")).unwrap();
    let first: f64 = first
        .lines()
        .nth(1)
        .unwrap()
        .split(',')
        .next()
        .unwrap()
        .parse()
        .unwrap();
    assert!((first / time - 1.0).abs() < 1e-12, "time goes on from {first}");
}

/// Loads after the waking use the time of the run: a run that wakes early agrees with one that never sleeps.
#[test]
fn waking_early_changes_little() {
    let path = written("wake-early", WAKING);
    let early = [
        "--set",
        "wake.near.box.low=[0.0, 0.0, 0.0]",
        "--set",
        "wake.criterion.strain=1e-4",
    ];
    let (out, _) = run(&path, &early);
    let woken = summary(&out);
    assert!(number(&woken, "/wake/time") < 3.0);
    let awake =
        WAKING.split("[wake]").next().unwrap().to_owned() + &WAKING[WAKING.find("[[load]]").unwrap()..];
    let (out, _) = run(&written("wake-never-slept", &awake), &[]);
    let never = summary(&out);
    assert!(never.get("wake").is_none(), "off unless asked for");
    for probe in ["/probes/behind/min", "/energy/final"] {
        let [a, b] = [number(&woken, probe), number(&never, probe)];
        assert!((a / b - 1.0).abs() < 0.01, "{probe}: {a} against {b}");
    }
}

#[test]
fn stress_is_a_criterion_too() {
    let path = written("wake-stress", &WAKING.replace("strain = 5e-4", "stress = 5e-4"));
    let (out, _) = run(&path, &[]);
    let s = summary(&out);
    let [time, x] = [number(&s, "/wake/time"), number(&s, "/wake/place/0")];
    let expected = arrival(x, 1.0, number(&s, "/wake/value") / 1e-3, 10.0);
    assert!(
        (time / expected - 1.0).abs() < 0.02,
        "woke at {time}, theory {expected}"
    );
    assert_eq!(s["wake"]["criterion"], "stress [Pa]");
}

#[test]
fn sleeps_to_the_end() {
    let path = written("wake-never", WAKING);
    let (out, printed) = run(&path, &["--set", "wake.criterion.strain=1.0"]);
    let s = summary(&out);
    assert!(printed.contains("was asleep to the end"), "{printed}");
    assert_eq!(s["status"], "complete");
    assert_eq!(s["wake"]["woken"], false);
    assert!(s["wake"]["time"].is_null());
    assert!((number(&s, "/wake/value") / 1e-3 - 1.0).abs() < 0.05);
    assert!(number(&s, "/time") >= 26.0 && !out.join("asleep").exists());
}

/// The shipped scene: spheres wake, take over momentum and most of the energy, and break at the clamp, with
/// the same bits for any number of threads.
#[test]
fn spheres_wake() {
    let path = scene("waking-bar.toml");
    let mut tables = Vec::new();
    for threads in ["1", "2"] {
        let out = scratch(&format!("wake-spheres-{threads}")).join("out");
        succeed(&["run", text(&path), "--out", text(&out), "--threads", threads]);
        let s = summary(&out);
        assert_eq!(s["models"][1]["kind"], "dem");
        let share = number(&s, "/wake/value") / (20e6 / 75e9);
        let c = (75e9_f64 / 2200.0).sqrt();
        let expected = arrival(number(&s, "/wake/place/0"), c, share, 3e-6);
        let time = number(&s, "/wake/time");
        assert!(
            (time / expected - 1.0).abs() < 0.02,
            "woke at {time}, theory {expected}"
        );
        assert!(momentum_gap(&s) < 1e-10);
        let jump = number(&s, "/wake/jump") / number(&s, "/wake/energy_before");
        assert!(jump.abs() < 0.1 && jump != 0.0, "energy jumps by {jump}");
        assert!(number(&s, "/energy/h_drift_max") < 1e-11);
        let breaks = std::fs::read_to_string(out.join("fracture-grains.csv")).unwrap();
        let times = breaks
            .lines()
            .skip(1)
            .map(|l| l.split(',').next().unwrap().parse::<f64>().unwrap());
        assert!(breaks.lines().count() > 10 && times.fold(f64::INFINITY, f64::min) > time);
        tables.push([
            breaks,
            std::fs::read_to_string(out.join("probes.csv")).unwrap(),
            std::fs::read_to_string(out.join("asleep/energy.csv")).unwrap(),
        ]);
    }
    assert!(tables[0] == tables[1], "threads change the results");
}

/// Natural elements carry the sleeping zone as finite elements do.
#[test]
fn natural_elements_carry_too() {
    let scene = WAKING
        .replacen("kind = \"fem\"", "kind = \"cnem\"", 1)
        .replace("end = 26.0", "end = 16.0")
        .replace("poisson = 0.0", "poisson = 0.1");
    let (out, printed) = run(&written("wake-cnem", &scene), &[]);
    let s = summary(&out);
    assert!(printed.contains("'right' woke at t ="), "{printed}");
    assert_eq!(s["models"][0]["kind"], "cnem");
    let value = number(&s, "/wake/value");
    let expected = arrival(number(&s, "/wake/place/0"), 1.0, value / 1e-3, 10.0);
    let time = number(&s, "/wake/time");
    assert!(
        (time / expected - 1.0).abs() < 0.05,
        "woke at {time}, theory {expected}"
    );
    assert!(momentum_gap(&s) < 1e-10);
    let jump = number(&s, "/wake/jump") / number(&s, "/wake/energy_before");
    assert!(jump.abs() < 0.01, "energy jumps by {jump}");
    assert!(number(&s, "/energy/h_drift_max") < 1e-11);
}

#[test]
fn check_shows_both_parts() {
    let path = written("wake-check", WAKING);
    let plan: serde_json::Value = serde_json::from_str(&succeed(&["check", text(&path), "--json"])).unwrap();
    assert_eq!(plan["models"].as_array().map(Vec::len), Some(2));
    assert_eq!(plan["asleep"]["models"].as_array().map(Vec::len), Some(1));
    assert!(number(&plan, "/asleep/dt") > number(&plan, "/dt"));
}

/// Each mistake is refused before the first step, at its key, with the remedy.
#[test]
fn bad_input_is_named() {
    let cases: [(&str, &str, &str); 15] = [
        (
            "model = \"right\"\nby",
            "model = \"wrong\"\nby",
            "wake.model = 'wrong'",
        ),
        ("by = \"left\"", "by = \"lift\"", "wake.by = 'lift'"),
        ("by = \"left\"", "by = \"right\"", "cannot carry itself"),
        ("criterion.strain = 5e-4", "", "missing field `criterion`"),
        (
            "criterion.strain = 5e-4",
            "criterion = {}",
            "exactly one of strain",
        ),
        (
            "strain = 5e-4",
            "strain = -5e-4",
            "wake.criterion.strain = -0.0005",
        ),
        ("every = 1", "every = 0", "wake.every = 0"),
        ("low = [11.9", "low = [13.9", "wake.near.box.high[0] = 12.6"),
        ("high = [12.6", "high = [12.0", "holds no element centre"),
        ("[\"model.left", "[\"model.lift", "wake.asleep[0]"),
        (
            "[\"model.left",
            "[\"model.right",
            "changes nothing while the model sleeps",
        ),
        (
            "high=[30.0",
            "high=[25.0",
            "outside of what is there while 'left' stands alone",
        ),
        (
            "[[load]]\nmodel = \"left\"",
            "[[load]]\nmodel = \"right\"",
            "load.0.model=left",
        ),
        ("end = 26.0", "steps = 100", "time.end"),
        (
            "[wake]",
            "[model.left.step]\nscheme = \"implicit\"\n[wake]",
            "leaves nothing to choose a step by while 'right' sleeps",
        ),
    ];
    for (k, (from, to, expected)) in cases.iter().enumerate() {
        assert!(WAKING.contains(from), "{from}");
        let path = written(&format!("wake-bad-{k}"), &WAKING.replacen(from, to, 1));
        let out = arlequin(&["check", text(&path)]);
        let error = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(2), "{to}: {error}");
        assert!(
            error.contains(expected),
            "'{to}' should say '{expected}':\n{error}"
        );
    }
}

#[test]
fn effects_that_cannot_be_handed_over() {
    let shipped = std::fs::read_to_string(scene("waking-bar.toml")).unwrap();
    let cases = [
        ("prestress = {}", "holds the shape at the start"),
        (
            "obstacle = { shape.sphere = { centre = [25e-3, 2e-3, 9e-3], radius = 1e-3 } }",
            "would touch nothing while the model sleeps",
        ),
        (
            "models = [\"grains\"]\nbody_force = { acceleration = [0.0, 0.0, -9.81] }",
            "effect.2.models=['block']",
        ),
    ];
    for (k, (effect, expected)) in cases.iter().enumerate() {
        let path = written(
            &format!("wake-effect-{k}"),
            &format!("{shipped}\n[[effect]]\n{effect}\n"),
        );
        let out = arlequin(&["check", text(&path)]);
        let error = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(2), "{effect}: {error}");
        assert!(
            error.contains(expected),
            "'{effect}' should say '{expected}':\n{error}"
        );
    }
    let clamp = shipped.replace(", \"support.0.model=block\"", "");
    let path = written("wake-clamp", &clamp);
    let error = String::from_utf8_lossy(&arlequin(&["check", text(&path)]).stderr).into_owned();
    assert!(error.contains("support.0.model=block"), "{error}");
}

/// Returns all computed files of a run, asleep and awake.
fn results(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut files = Vec::new();
    for part in ["", "asleep"] {
        let part = folder.join(part);
        files.extend(["probes.csv", "energy.csv", "results.pvd"].map(|n| part.join(n)));
        files.extend(
            std::fs::read_dir(part.join("vtu"))
                .unwrap()
                .map(|e| e.unwrap().path()),
        );
    }
    files.sort();
    let read = |p: PathBuf| {
        (
            p.strip_prefix(folder).unwrap().to_owned(),
            std::fs::read(&p).unwrap(),
        )
    };
    files.into_iter().map(read).collect()
}

#[test]
fn killed_asleep_and_awake_it_goes_on_with_the_same_bits() {
    let slow = WAKING.replace("end = 26.0", "end = 26.0\nstep.fraction = 0.02");
    let path = written("wake-killed", &slow);
    let (whole, _) = run(&path, &[]);
    let expected = results(&whole);
    let killed = path.with_file_name("killed");
    let unfinished = path.with_file_name("killed.unfinished");
    let begin = ["run", text(&path), "--out", text(&killed)];
    let interval = ["--set", "output.checkpoint_every=40"];
    let start = |arguments: &[&str]| {
        let mut c = crate::common::command(arguments);
        let c = c.stdout(std::process::Stdio::null());
        c.spawn().unwrap()
    };
    // The run is resumed once while it sleeps and once while it is awake.
    let (mut seen, mut state) = ([0; 2], 88_172_645_463_325_252_u64);
    let mut child = start(&[&begin[..], &interval].concat());
    let checkpoint = unfinished.join("checkpoint.bin");
    let written = || std::fs::metadata(&checkpoint).and_then(|m| m.modified()).ok();
    for _ in 0..25 {
        // Some steps after the next checkpoint.
        let before = written();
        while written() == before && child.try_wait().unwrap().is_none() {
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        std::thread::sleep(std::time::Duration::from_millis(state % 120));
        if child.try_wait().unwrap().is_some() {
            break;
        }
        child.kill().unwrap();
        child.wait().unwrap();
        if !unfinished.exists() {
            // The run was killed after its last write.
            break;
        }
        seen[usize::from(unfinished.join("asleep").exists())] += 1;
        child = start(&["resume", text(&killed)]);
    }
    child.wait().unwrap();
    assert!(
        seen[0] > 0 && seen[1] > 0,
        "resumed {seen:?} times asleep and awake"
    );
    assert!(results(&killed) == expected);
    let [a, b] = [&whole, &killed].map(|f| summary(f)["wake"].clone());
    assert_eq!(a, b);
    assert_eq!(a["woken"], true);
}
