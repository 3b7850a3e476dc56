//! Scenes under `mpirun`: the same files for any number of ranks, and errors that all ranks agree on.
#![cfg(feature = "mpi")]

#[path = "it/common/mod.rs"]
mod common;
#[path = "../../scene/tests/it/shipped/mod.rs"]
mod shipped;

use common::{command, scene, scratch, text};
use shipped::SHIPPED;
use std::collections::{BTreeMap, BTreeSet};
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::{Duration, Instant};

/// Returns the command that starts a program on several ranks, more than there are cores if needed.
fn mpirun(ranks: usize, program: &str, arguments: &[&str]) -> Command {
    let mut run = Command::new("mpirun");
    run.args(["--oversubscribe", "--mca", "mpi_yield_when_idle", "1", "-n"]);
    run.arg(ranks.to_string()).arg(program).args(arguments);
    for (key, value) in [
        ("OMPI_ALLOW_RUN_AS_ROOT", "1"),
        ("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1"),
        // Containers forbid this mechanism, which prints many lines.
        ("OMPI_MCA_btl_vader_single_copy_mechanism", "none"),
        ("RAYON_NUM_THREADS", "1"),
    ] {
        run.env(key, value);
    }
    run.env(
        "ARLEQUIN_CACHE",
        Path::new(env!("CARGO_TARGET_TMPDIR")).join("packings"),
    );
    run
}

fn on_ranks(ranks: usize, arguments: &[&str]) -> Output {
    let mut run = mpirun(ranks, env!("CARGO_BIN_EXE_arlequin"), arguments);
    run.output().expect("mpirun is there")
}

fn printed_by(output: &Output) -> String {
    let out = [&output.stdout[..], &output.stderr[..]].concat();
    String::from_utf8_lossy(&out).into_owned()
}

/// A shipped scene, shorter and coarser: a pulse that runs from a bar of elements into spheres.
fn pulse(end: &str) -> Vec<String> {
    let path = scene("dem-fem-beam.toml");
    let changes = [
        "model.right.spacing=0.25e-3",
        "model.left.spacing=0.5e-3",
        "model.right.dem.protocol=quench",
        end,
    ];
    let changes = changes
        .into_iter()
        .flat_map(|c| ["--set".to_owned(), c.to_owned()]);
    [text(&path).to_owned()].into_iter().chain(changes).collect()
}

fn run<'a>(scene: &'a [String], extra: &[&'a str]) -> Vec<&'a str> {
    let scene = scene.iter().map(String::as_str);
    ["run"]
        .into_iter()
        .chain(scene)
        .chain(extra.iter().copied())
        .collect()
}

fn bytes(folder: &Path, file: &str) -> Vec<u8> {
    std::fs::read(folder.join(file)).expect(file)
}

#[test]
fn processes_write_the_files_of_one_rank_and_speak_once() {
    let folder = scratch("ranks-same");
    let place = |name: String| folder.join(name);
    let scene = pulse("time.end=1.5e-6");
    let single = place("one".into());
    let alone = command(&run(&scene, &["--out", text(&single)]))
        .output()
        .expect("runs");
    assert!(alone.status.success(), "{}", printed_by(&alone));
    for ranks in [1, 2, 3, 4] {
        let out = place(format!("on-{ranks}"));
        let done = on_ranks(ranks, &run(&scene, &["--out", text(&out)]));
        assert!(done.status.success(), "{ranks} ranks: {}", printed_by(&done));
        for file in [
            "probes.csv",
            "energy.csv",
            "results.pvd",
            "vtu/right_00000000.vtu",
        ] {
            assert!(
                bytes(&single, file) == bytes(&out, file),
                "{file} on {ranks} ranks"
            );
        }
        let words = printed_by(&done);
        assert_eq!(words.matches("results    ").count(), 1, "{words}");
        let held = words.lines().filter(|l| l.starts_with("ranks"));
        let parts = held.filter(|l| l.contains("right ") && l.contains("in parts: "));
        assert_eq!(parts.count(), usize::from(ranks > 1), "{words}");
    }
}

#[test]
fn shipped_scenes_have_the_probes_of_one_rank() {
    let folder = scratch("ranks-shipped");
    for (name, changes) in SHIPPED {
        let file = scene(&format!("{name}.toml"));
        let mut arguments = vec!["run", text(&file)];
        changes.iter().for_each(|c| arguments.extend(["--set", c]));
        let single = folder.join(format!("{name}-one"));
        let alone = command(&[&arguments[..], &["--out", text(&single)]].concat())
            .output()
            .expect("runs");
        assert!(alone.status.success(), "{name}: {}", printed_by(&alone));
        for ranks in 1..=4 {
            let out = folder.join(format!("{name}-{ranks}"));
            let done = on_ranks(ranks, &[&arguments[..], &["--out", text(&out)]].concat());
            let words = printed_by(&done);
            assert!(done.status.success(), "{name} on {ranks} ranks: {words}");
            assert_eq!(
                words.contains("in parts: "),
                ranks > 1,
                "{name} on {ranks} ranks: {words}"
            );
            assert!(
                bytes(&single, "probes.csv") == bytes(&out, "probes.csv"),
                "{name} on {ranks} ranks"
            );
        }
    }
}

#[test]
fn errors_are_said_once_with_the_code_of_one_rank() {
    let folder = scratch("ranks-errors");
    let out = folder.join("out");
    let scene = pulse("time.end=1.5e-6");
    let cases: [(Vec<&str>, &str); 3] = [
        (
            run(&scene, &["--out", text(&out), "--set", "time.end=-1"]),
            "time.end = -1",
        ),
        (
            run(&scene, &["--oout", text(&out)]),
            "unexpected argument '--oout'",
        ),
        (vec!["check", &scene[0]], "'check' on one: call it without mpirun"),
    ];
    for (arguments, wanted) in cases {
        let done = on_ranks(3, &arguments);
        let words = printed_by(&done);
        assert_eq!(words.matches(wanted).count(), 1, "{words}");
        assert_eq!(words.matches("error: ").count(), 1, "{words}");
        assert_eq!(done.status.code(), Some(2), "{words}");
    }
    assert!(!out.exists());
}

/// Writes a launcher script that runs `begin` first on one rank, and returns its path.
fn write_launcher(folder: &Path, rank: usize, begin: &str, arguments: &str) -> PathBuf {
    let path = folder.join("odd.sh");
    let program = env!("CARGO_BIN_EXE_arlequin");
    let text = format!(
        "#!/bin/sh\nmore=\n[ \"$OMPI_COMM_WORLD_RANK\" = {rank} ] && {{\n{begin}\n}}\nexec {program} {arguments} $more\n"
    );
    std::fs::write(&path, text).expect("a script");
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).expect("executable");
    path
}

#[test]
fn ranks_that_differ_hang_or_die_end_the_job_by_name() {
    let folder = scratch("ranks-odd");
    let scene = pulse("time.end=1");
    let cases = [
        ("more='--set time.end=2'", "ranks differ in the scene", Some(2)),
        // In a halo exchange the error names the rank that hangs; in a sum over all ranks no rank knows which
        // it is.
        ("(sleep 4; kill -STOP $$) &", "has waited 5 s for ", Some(1)),
        // The launcher itself ends the job.
        ("(sleep 4; kill -KILL $$) &", "", None),
    ];
    for (k, (begin, wanted, code)) in cases.into_iter().enumerate() {
        let out = folder.join(format!("out-{k}"));
        let arguments = run(&scene, &["--out", text(&out), "--wait", "5"]);
        let quoted: Vec<String> = arguments.iter().map(|a| format!("'{a}'")).collect();
        let program = write_launcher(&folder, 1, begin, &quoted.join(" "));
        let begun = Instant::now();
        let done = mpirun(3, text(&program), &[]).output().expect("mpirun is there");
        let words = printed_by(&done);
        assert!(begun.elapsed() < Duration::from_secs(60), "{words}");
        assert!(!done.status.success(), "{words}");
        assert!(code.is_none_or(|c| done.status.code() == Some(c)), "{words}");
        assert!(words.contains(wanted), "{words}");
    }
}

#[test]
fn a_run_that_was_killed_goes_on_with_another_number_of_ranks() {
    let folder = scratch("ranks-resumed");
    let scene = pulse("time.end=3e-6");
    let whole = folder.join("whole");
    let alone = command(&run(&scene, &["--out", text(&whole)]))
        .output()
        .expect("runs");
    assert!(alone.status.success(), "{}", printed_by(&alone));
    let out = folder.join("out");
    let arguments = run(
        &scene,
        &["--out", text(&out), "--set", "output.checkpoint_every=5"],
    );
    let saved = folder.join("out.unfinished/checkpoint.bin");
    let begin = format!(
        "(while [ ! -e '{}' ]; do sleep 0.05; done; kill -KILL $$) &",
        saved.display()
    );
    let quoted: Vec<String> = arguments.iter().map(|a| format!("'{a}'")).collect();
    let program = write_launcher(&folder, 1, &begin, &quoted.join(" "));
    let killed = mpirun(3, text(&program), &[]).output().expect("mpirun is there");
    assert!(
        !killed.status.success() && saved.exists(),
        "{}",
        printed_by(&killed)
    );
    let done = on_ranks(2, &["resume", text(&out)]);
    assert!(done.status.success(), "{}", printed_by(&done));
    for file in ["probes.csv", "energy.csv"] {
        assert!(bytes(&whole, file) == bytes(&out, file), "{file}");
    }
}

#[test]
fn a_page_shows_frames_in_pieces_as_those_of_one_rank() {
    let folder = scratch("ranks-pieces");
    let scene = pulse("time.end=1.5e-6");
    let single = folder.join("one");
    let alone = command(&run(&scene, &["--out", text(&single)]))
        .output()
        .expect("runs");
    assert!(alone.status.success(), "{}", printed_by(&alone));
    let out = folder.join("out");
    let settings = ["--out", text(&out), "--set", "output.pieces=true"];
    let done = on_ranks(3, &run(&scene, &settings));
    assert!(done.status.success(), "{}", printed_by(&done));
    let index = String::from_utf8(bytes(&out, "results.pvd")).expect("text");
    assert!(index.contains("vtu/right_00000000.pvtu"), "{index}");
    assert_eq!(
        index.replace(".pvtu", ".vtu").as_bytes(),
        bytes(&single, "results.pvd")
    );
    // The summary differs in any case: times, memory, ranks.
    std::fs::copy(single.join("summary.json"), out.join("summary.json")).expect("copied");
    let view = |results: &Path| command(&["view", text(results)]).output().expect("runs");
    for results in [&single, &out] {
        let done = view(results);
        assert!(done.status.success(), "{}", printed_by(&done));
    }
    assert!(bytes(&single, "view.html") == bytes(&out, "view.html"));
    // A piece of another time, a truncated piece, a missing piece.
    let piece = out.join("vtu/right_00000000_1.vtu");
    let whole = bytes(&out, "vtu/right_00000000_1.vtu");
    let refused = |wanted: &str| {
        let done = view(&out);
        let words = printed_by(&done);
        assert!(done.status.code() == Some(2) && words.contains(wanted), "{words}");
    };
    std::fs::write(&piece, bytes(&out, "vtu/right_00000000_0.vtu")).expect("written");
    refused(
        "right_00000000.pvtu: is no frame that 'arlequin run' wrote, or a damaged one (its pieces do not make a whole)",
    );
    std::fs::write(&piece, &whole[..whole.len() / 2]).expect("written");
    refused("right_00000000_1.vtu");
    std::fs::remove_file(&piece).expect("removed");
    refused("right_00000000_1.vtu");
}

/// Started by `mpirun` of another MPI library, each process sees a world of one rank, but the environment
/// names more: the run is refused by name.
#[test]
fn a_launcher_of_another_mpi_library_is_refused_by_name() {
    let out = scratch("ranks-launcher").join("out");
    let scene = pulse("time.end=1.5e-6");
    let arguments = run(&scene, &["--out", text(&out)]);
    for rank in ["0", "1"] {
        let mut process = command(&arguments);
        process.env("PMI_RANK", rank).env("PMI_SIZE", "3");
        let ended = process.output().expect("starts");
        let error = printed_by(&ended);
        assert!(!ended.status.success() && !out.exists(), "{error}");
        // One process prints the error for all.
        let words = [
            "the launcher started 3 processes, and MPI sees 1",
            "linked with",
            "which mpirun",
        ];
        assert!(
            words.iter().all(|w| error.contains(w) == (rank == "0")),
            "rank {rank}: {error}"
        );
    }
    // MPICH's launcher, if the Python environment of the gate has it.
    let python = std::env::var_os("ARLEQUIN_PYTHON").map(PathBuf::from);
    let hydra = python.map(|p| p.with_file_name("mpiexec")).filter(|p| p.exists());
    if let Some(hydra) = hydra {
        let mut hydra_run = Command::new(hydra);
        hydra_run
            .args(["-n", "3", env!("CARGO_BIN_EXE_arlequin")])
            .args(&arguments);
        let ended = hydra_run.output().expect("starts");
        let error = printed_by(&ended);
        assert!(!ended.status.success() && !out.exists(), "{error}");
        assert_eq!(
            error.matches("the launcher started 3 processes").count(),
            1,
            "{error}"
        );
    }
}

/// Returns the feature sets with which a build compiles each package outside of the workspace.
fn features(build: &[&str]) -> BTreeMap<String, BTreeSet<String>> {
    let mut tree = Command::new(env!("CARGO"));
    tree.args([
        "tree",
        "--prefix",
        "none",
        "--edges",
        "normal,build",
        "--format",
        "{p}\t{f}",
    ]);
    tree.args(build)
        .current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("../.."));
    let output = tree.output().expect("cargo is there");
    assert!(output.status.success(), "{}", printed_by(&output));
    let mut packages = BTreeMap::<_, BTreeSet<_>>::new();
    for line in String::from_utf8_lossy(&output.stdout).lines() {
        let (package, features) = line.split_once('\t').unwrap_or((line, ""));
        // Workspace members are printed with their folder; repeated packages end with a star.
        if !package.contains('/') {
            let features = features.trim_end_matches([' ', '(', '*', ')']);
            packages
                .entry(package.to_owned())
                .or_default()
                .insert(features.to_owned());
        }
    }
    packages
}

/// The builds with MPI and of the wheel use the same features of every package as a release build: another
/// feature would compile the package and all its dependents again (with `syn` these were faer and the core).
#[test]
fn mpi_and_the_wheel_take_what_a_release_build_has_compiled() {
    let release = features(&[]);
    assert!(release.keys().any(|p| p.starts_with("faer ")), "{release:?}");
    for build in [
        &["-p", "arlequin-cli", "--features", "mpi"][..],
        &["-p", "arlequin-py"],
    ] {
        for (package, sets) in features(build) {
            // A feature set that the release build lacks is that of a build script; all others must be those
            // of the release build.
            if let Some(compiled) = release.get(&package) {
                assert!(
                    !compiled.is_disjoint(&sets),
                    "{package}: {compiled:?} in a release build, {sets:?} with {build:?}"
                );
            }
        }
    }
}
