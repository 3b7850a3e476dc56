//! A run that fails after its first step keeps its results up to the failure.
#![cfg(unix)]

use crate::common::{SMALL, arlequin, command, number, scratch, succeed, summary, text};
use std::path::{Path, PathBuf};
use std::process::Output;

/// A scene whose load is moderate until t = 30 and then overflows all numbers.
fn overloaded(folder: &Path) -> PathBuf {
    let path = folder.join("scene.toml");
    let pull = "force = [1e305, 0.0, 0.0]\ntime.table = [[0.0, 0.0], [30.0, 0.0], [30.001, 1.0]]";
    let scene = SMALL
        .replace("force = [1e-3, 0.0, 0.0]\ntime.pulse = { duration = 2.0 }", pull)
        .replace("steps = 50", "steps = 500");
    let start =
        "\n[[initial]]\nmodels = [\"right\"]\nvelocity.uniform = [1e-3, 0.0, 0.0]\n[output]\nevery = 5\n";
    std::fs::write(&path, scene + start).expect("scene");
    path
}

fn stderr_of(out: &Output) -> String {
    String::from_utf8_lossy(&out.stderr)
        .replace(['\n', '│'], " ")
        .split_whitespace()
        .collect::<Vec<_>>()
        .join(" ")
}

fn names(folder: &Path) -> Vec<String> {
    let mut out: Vec<String> = std::fs::read_dir(folder)
        .expect("folder")
        .map(|e| e.expect("entry").file_name().to_string_lossy().into_owned())
        .collect();
    out.sort();
    out
}

/// Number of rows of a table without its head.
fn rows(table: &Path) -> usize {
    std::fs::read_to_string(table).expect("table").lines().count() - 1
}

#[test]
fn a_run_that_diverges_keeps_everything_up_to_then() {
    let folder = scratch("diverges");
    let scene = overloaded(&folder);
    let out = folder.join("out");
    let run = arlequin(&["run", text(&scene), "--out", text(&out)]);
    let words = stderr_of(&run);
    assert_eq!(run.status.code(), Some(1), "{words}");
    assert!(
        words.contains("no longer finite") && !words.contains("NaN"),
        "{words}"
    );
    let s = summary(&out);
    let steps = number(&s, "/steps") as usize;
    assert!(
        words.contains(&format!("the {steps} steps before are kept in '")),
        "{words}"
    );
    assert_eq!(s["status"], "failed");
    assert!(
        s["error"]
            .as_str()
            .is_some_and(|e| e.contains("no longer finite")),
        "{s}"
    );
    // The load is moderate until t = 30.
    assert!(steps > 20 && steps < 400, "{steps}");
    assert!(rows(&out.join("probes.csv")) + 1 >= steps, "{steps}");
    assert!(rows(&out.join("energy.csv")) >= steps / 10 - 1);
    let index = std::fs::read_to_string(out.join("results.pvd")).expect("index");
    let listed: Vec<&str> = index
        .split("file=\"")
        .skip(1)
        .filter_map(|f| f.split('"').next())
        .collect();
    assert!(listed.len() >= 6, "{index}");
    assert!(listed.iter().all(|f| out.join(f).exists()));
    assert_eq!(names(&folder), ["out", "scene.toml"]);
}

#[test]
fn a_run_that_fails_does_not_replace_earlier_results() {
    let folder = scratch("fails-beside");
    let scene = overloaded(&folder);
    let out = folder.join("out");
    let run =
        |sets: &[&str]| arlequin(&[&["run", text(&scene), "--out", text(&out), "--force"], sets].concat());
    assert!(run(&["--set", "time.steps=5"]).status.success());
    for _ in 0..2 {
        assert_eq!(run(&[]).status.code(), Some(1));
        assert_eq!(summary(&out)["status"], "complete");
        assert_eq!(summary(&folder.join("out.failed"))["status"], "failed");
        assert_eq!(names(&folder), ["out", "out.failed", "scene.toml"]);
    }
}

/// Runs the program in a shell that limits files to `blocks` blocks of 512 bytes, as on a full disk.
fn limited(blocks: u32, arguments: &[&str]) -> Output {
    let program = command(arguments);
    let mut shell = std::process::Command::new("sh");
    shell
        .args([
            "-c",
            &format!("trap '' 25; ulimit -f {blocks}; exec \"$0\" \"$@\""),
        ])
        .arg(program.get_program())
        .args(arguments);
    shell.output().expect("a shell")
}

#[test]
fn a_full_disk_keeps_everything_that_fits() {
    let folder = scratch("disk");
    let scene = folder.join("scene.toml");
    std::fs::write(&scene, SMALL).expect("scene");
    let out = folder.join("out");
    // The checkpoint grows with the tables it holds; all other files stay below the limit.
    let sets = [
        "time.steps=2000",
        "output.every=100",
        "output.checkpoint_every=10",
        "output.plots=false",
    ];
    let sets: Vec<&str> = sets.into_iter().flat_map(|s| ["--set", s]).collect();
    let arguments = [&["run", text(&scene), "--out", text(&out)], &sets[..]].concat();
    let run = limited(72, &arguments);
    let words = stderr_of(&run);
    assert_eq!(run.status.code(), Some(1), "{words}");
    assert!(
        words.contains("cannot write") && words.contains("steps before are kept in"),
        "{words}"
    );
    let s = summary(&out);
    assert_eq!(s["status"], "failed");
    let steps = number(&s, "/steps") as usize;
    assert!((100..1000).contains(&steps), "{steps}");
    assert_eq!(rows(&out.join("probes.csv")), steps + 1);
    // Rows of the first step and of every tenth step.
    assert_eq!(rows(&out.join("energy.csv")), steps / 10 + 1);
    assert!(out.join("results.pvd").exists());
    // Without the limit the run goes on from the last complete checkpoint.
    succeed(&["resume", text(&out)]);
    assert_eq!(summary(&out)["steps"], 2000);
    assert_eq!(summary(&out)["status"], "complete");
    assert_eq!(names(&folder), ["out", "scene.toml"]);
}

#[test]
fn where_nothing_fits_no_folder_is_left() {
    let folder = scratch("disk-none");
    let scene = folder.join("scene.toml");
    std::fs::write(&scene, SMALL).expect("scene");
    let out = folder.join("out");
    let run = limited(4, &["run", text(&scene), "--out", text(&out)]);
    assert_eq!(run.status.code(), Some(1), "{}", stderr_of(&run));
    assert_eq!(names(&folder), ["scene.toml"]);
}

#[test]
fn threads_are_bounded_by_the_machine() {
    let folder = scratch("threads-bound");
    let scene = folder.join("scene.toml");
    std::fs::write(&scene, SMALL).expect("scene");
    let limit = 4 * std::thread::available_parallelism().expect("cores").get();
    for (flag, variable) in [
        (Some("100000"), None),
        (None, Some("100000")),
        (Some("100000"), Some("3")),
    ] {
        let out = folder.join("out");
        let mut arguments = vec!["run", text(&scene), "--out", text(&out), "--force"];
        arguments.extend(flag.iter().flat_map(|n| ["--threads", n]));
        let mut run = command(&arguments);
        run.envs(variable.map(|v| ("RAYON_NUM_THREADS", v)));
        let run = run.output().expect("runs");
        let words = stderr_of(&run);
        assert!(run.status.success(), "{words}");
        assert!(words.contains(&format!("= 100000: {limit} are used")), "{words}");
        assert_eq!(summary(&out)["threads"].as_u64(), Some(limit as u64));
    }
}

/// A program without MPI refuses to start as one of several ranks, since four copies would write the same
/// files.
#[test]
#[cfg(not(feature = "mpi"))]
fn a_program_without_mpi_refuses_to_be_one_of_several_ranks() {
    let folder = scratch("failures-launched");
    let path = folder.join("scene.toml");
    std::fs::write(&path, SMALL).expect("scene");
    let out = folder.join("out");
    let launched = |rank: &str, ranks: &str| {
        let mut run = command(&["run", text(&path), "--out", text(&out)]);
        run.env("OMPI_COMM_WORLD_RANK", rank)
            .env("OMPI_COMM_WORLD_SIZE", ranks);
        run.output().expect("runs")
    };
    let first = launched("0", "4");
    assert_eq!(first.status.code(), Some(2));
    assert!(
        stderr_of(&first).contains("ranks = 4: this program was built without MPI"),
        "{}",
        stderr_of(&first)
    );
    let last_rank = launched("3", "4");
    assert_eq!(
        (last_rank.status.code(), stderr_of(&last_rank).as_str()),
        (Some(2), "")
    );
    assert!(!out.exists());
    // One rank is accepted.
    assert!(launched("0", "1").status.success());
    let mut odd = command(&["run", text(&path), "--out", text(&out), "--wait", "0"]);
    let odd = odd.output().expect("runs");
    assert_eq!(odd.status.code(), Some(2));
    assert!(
        stderr_of(&odd).contains("--wait = 0: must be above 0"),
        "{}",
        stderr_of(&odd)
    );
}
