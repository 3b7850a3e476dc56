//! Checkpoints: a run that was killed, interrupted or damaged goes on with the same bits, or the error says
//! why it cannot.

use crate::common::{SMALL, arlequin, scratch, succeed, summary, text};
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::time::Duration;

/// Steps of the runs that are killed: about two seconds of work.
const STEPS: &str = "time.steps=180000";

fn small(folder: &Path) -> PathBuf {
    let path = folder.join("small.toml");
    let output = "\n[output]\ncheckpoint_every = 200\nevery = 1000\nplots = false\n";
    let body = SMALL.split("\n[output]").next().expect("scene");
    std::fs::write(&path, format!("{body}{output}")).expect("scene");
    path
}

fn start(scene: &Path, out: &Path, extra: &[&str]) -> Child {
    let fixed = ["run", text(scene), "--out", text(out), "--set", STEPS];
    crate::common::command(&[&fixed, extra].concat())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("starts")
}

fn start_resume(out: &Path) -> Child {
    crate::common::command(&["resume", text(out)])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("starts")
}

/// Returns all computed files of a run: tables, frames and their index.
fn results(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut files: Vec<PathBuf> = ["probes.csv", "energy.csv", "results.pvd"]
        .map(|n| folder.join(n))
        .into();
    let frames = std::fs::read_dir(folder.join("vtu")).expect("frames");
    files.extend(frames.map(|e| e.expect("entry").path()));
    files.sort();
    files
        .into_iter()
        .map(|p| {
            let name = p.strip_prefix(folder).expect("inside").display().to_string();
            (name, std::fs::read(&p).expect("file"))
        })
        .collect()
}

fn assert_same(a: &Path, b: &Path) {
    let (a, b) = (results(a), results(b));
    let names = |r: &[(String, Vec<u8>)]| r.iter().map(|f| f.0.clone()).collect::<Vec<_>>();
    assert_eq!(names(&a), names(&b));
    for (x, y) in a.iter().zip(&b) {
        assert!(x.1 == y.1, "{} differs", x.0);
    }
}

/// Runs the whole scene without any checkpoint and returns its folder.
fn reference(folder: &Path, scene: &Path) -> PathBuf {
    let out = folder.join("whole");
    succeed(&["run", text(scene), "--out", text(&out), "--set", STEPS]);
    assert!(
        !out.join("checkpoint.bin").exists(),
        "a complete run keeps no checkpoint"
    );
    out
}

/// Kills a run at random moments, at most `most` times, and resumes it until it is complete; returns the
/// number of kills. `state` is the generator of random numbers, which successive runs share.
fn kill_until_done(
    out: &Path,
    pause: u64,
    max_kills: usize,
    state: &mut u64,
    start: impl Fn() -> Child,
) -> usize {
    let unfinished = out.with_extension("unfinished");
    let mut child = start();
    let mut kills = 0;
    loop {
        *state ^= *state << 13;
        *state ^= *state >> 7;
        *state ^= *state << 17;
        std::thread::sleep(Duration::from_millis(pause + *state % (3 * pause)));
        if kills == max_kills || child.try_wait().expect("waits").is_some() {
            break;
        }
        child.kill().expect("kill");
        child.wait().expect("ends");
        kills += 1;
        if !unfinished.exists() && out.join("summary.json").exists() {
            // The run was killed after its last write, before it could report its end.
            assert_eq!(summary(out)["status"], "complete");
            return kills;
        }
        let resumable = unfinished.join("checkpoint.bin").exists();
        child = if resumable { start_resume(out) } else { start() };
    }
    assert!(child.wait().expect("ends").success());
    assert_eq!(summary(out)["status"], "complete");
    assert!(!unfinished.exists());
    kills
}

/// Seed of the moments at which runs are killed.
const MOMENTS: u64 = 0x2545_f491_4f6c_dd1d;

#[test]
fn killed_fifty_times_at_random_it_goes_on_with_the_same_bits() {
    let folder = scratch("killed");
    let scene = small(&folder);
    let whole = reference(&folder, &scene);
    let out = folder.join("killed-run");
    let (mut kills, mut state, mut rounds) = (0, MOMENTS, 0);
    // A fast machine completes a run before enough kills: then another run starts.
    while kills < 50 {
        let _ = std::fs::remove_dir_all(&out);
        let begin = || start(&scene, &out, &[]);
        kills += kill_until_done(&out, 20, 50 - kills, &mut state, begin);
        assert_same(&whole, &out);
        rounds += 1;
        assert!(rounds <= 25, "only {kills} kills in {rounds} runs");
    }
    assert_eq!(kills, 50);
}

#[test]
fn own_steps_and_the_implicit_scheme_go_on_with_the_same_bits() {
    let folder = scratch("killed-own-steps");
    let scene = small(&folder);
    let sets = [
        "time.steps=12000",
        "model.left.step.scheme=implicit",
        "model.right.step.ratio=4",
    ];
    let sets: Vec<&str> = sets.into_iter().flat_map(|s| ["--set", s]).collect();
    let [whole, out] = ["whole", "killed-run"].map(|n| folder.join(n));
    succeed(&[&["run", text(&scene), "--out", text(&whole)], &sets[..]].concat());
    let line = &summary(&whole)["models"];
    assert_eq!(
        (&line[0]["scheme"], &line[1]["own_steps"]),
        (&"implicit".into(), &4.into()),
        "{line}"
    );
    assert!(
        summary(&whole)["energy"]["h_drift_max"]
            .as_f64()
            .is_some_and(|d| d < 1e-11)
    );
    let kills = kill_until_done(&out, 20, 10, &mut MOMENTS.clone(), || start(&scene, &out, &sets));
    assert!(kills >= 1, "killed only {kills} times");
    assert_same(&whole, &out);
}

#[test]
fn broken_bonds_and_contacts_go_on_with_the_same_bits() {
    let folder = scratch("killed-breaking");
    let scene = crate::common::scene("notched-bar.toml");
    let sets = [
        "model.bar.spacing=0.7e-3",
        "model.bar.dem.protocol=quench",
        "effect.0.fracture.strength=60e6",
        "output.plots=false",
    ];
    let sets: Vec<&str> = sets.into_iter().flat_map(|s| ["--set", s]).collect();
    let [whole, out] = ["whole", "killed-run"].map(|n| folder.join(n));
    let fixed = ["run", text(&scene), "--out"];
    succeed(&[&fixed[..], &[text(&whole)], &sets].concat());
    let interval = ["--set", "output.checkpoint_every=20"];
    let arguments = [&fixed[..], &[text(&out)], &sets, &interval].concat();
    let begin = || {
        let mut c = crate::common::command(&arguments);
        c.stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("starts")
    };
    let kills = kill_until_done(&out, 10, 50, &mut MOMENTS.clone(), begin);
    assert!(kills >= 1, "killed only {kills} times");
    assert_same(&whole, &out);
    let breaks = std::fs::read_to_string(out.join("fracture-bar.csv")).expect("breaks");
    assert!(breaks.lines().count() > 10, "{breaks}");
}

#[test]
fn interrupted_it_goes_on_with_the_same_bits() {
    let folder = scratch("interrupted");
    let scene = small(&folder);
    let whole = reference(&folder, &scene);
    let out = folder.join("stopped");
    // No checkpoints by step count: only the interruption writes one.
    let body = std::fs::read_to_string(&scene).expect("scene");
    std::fs::write(&scene, body.replace("checkpoint_every = 200\n", "")).expect("scene");
    let mut child = start(&scene, &out, &[]);
    std::thread::sleep(Duration::from_millis(300));
    let signal = ["-TERM", &child.id().to_string()];
    assert!(
        std::process::Command::new("kill")
            .args(signal)
            .status()
            .expect("kill")
            .success()
    );
    assert_eq!(child.wait().expect("ends").code(), Some(130));
    let s = summary(&out);
    assert_eq!(s["status"], "interrupted");
    succeed(&["resume", text(&out), "--threads", "1"]);
    let t = summary(&out);
    assert_eq!(
        (&t["status"], &t["resumed_at_step"]),
        (&"complete".into(), &s["steps"])
    );
    assert_same(&whole, &out);
    assert!(!out.join("checkpoint.bin").exists());
    let message = refusal(&["resume", text(&out)]);
    assert!(message.contains("has a run that has ended"), "{message}");
}

/// Kills a run after its first checkpoint; returns the output folder and the path of the checkpoint.
fn torn(folder: &Path) -> (PathBuf, PathBuf) {
    let scene = small(folder);
    let out = folder.join("out");
    let mut child = start(&scene, &out, &["--set", "time.steps=100000000"]);
    let checkpoint = folder.join("out.unfinished/checkpoint.bin");
    for _ in 0..200 {
        std::thread::sleep(Duration::from_millis(50));
        if checkpoint.exists() {
            break;
        }
    }
    child.kill().expect("kill");
    child.wait().expect("ends");
    (out, checkpoint)
}

fn refusal(arguments: &[&str]) -> String {
    let out = arlequin(arguments);
    assert_eq!(out.status.code(), Some(2), "{arguments:?}");
    String::from_utf8_lossy(&out.stderr)
        .replace(['\n', '│'], " ")
        .split_whitespace()
        .collect::<Vec<_>>()
        .join(" ")
}

#[test]
fn checkpoints_that_do_not_fit_are_refused() {
    let folder = scratch("torn");
    let (out, checkpoint) = torn(&folder);
    let whole = std::fs::read(&checkpoint).expect("checkpoint");
    // A resumed run that would replace a folder is refused before its first step.
    std::fs::create_dir(&out).expect("folder");
    let message = refusal(&["resume", text(&out)]);
    assert!(message.contains("move that away"), "{message}");
    std::fs::remove_dir(&out).expect("folder");
    // A new run must not destroy a run that can be resumed.
    let message = refusal(&["run", text(&folder.join("small.toml")), "--out", text(&out)]);
    assert!(
        message.contains("holds an unfinished run; go on with 'arlequin resume"),
        "{message}"
    );

    std::fs::write(&checkpoint, &whole[..whole.len() / 2]).expect("write");
    let message = refusal(&["resume", text(&out)]);
    assert!(message.contains("is truncated at"), "{message}");

    let mut damaged = whole.clone();
    damaged[whole.len() / 2] ^= 1;
    std::fs::write(&checkpoint, damaged).expect("write");
    let message = refusal(&["resume", text(&out)]);
    assert!(
        message.contains("is damaged: its check sum does not fit"),
        "{message}"
    );

    std::fs::write(&checkpoint, b"a spreadsheet").expect("write");
    let message = refusal(&["resume", text(&out)]);
    assert!(message.contains("is no checkpoint of this program"), "{message}");

    std::fs::remove_file(&checkpoint).expect("remove");
    let message = refusal(&["resume", text(&out)]);
    assert!(message.contains("checkpoint.bin"), "{message}");
    let message = refusal(&["resume", text(&folder.join("nowhere"))]);
    assert!(message.contains("nowhere"), "{message}");
}
