//! Runs that are killed half way and resumed: the report covers the whole run, and changed input is noticed.

use crate::common::{SMALL, arlequin, number, succeed, summary, text, wait_while_running, written};
use std::path::{Path, PathBuf};
use std::process::Stdio;

/// Runs a scene that writes one checkpoint about half way, kills it there, and returns the folder to resume.
fn killed_half_way(scene: &Path) -> PathBuf {
    let out = scene.with_file_name("killed");
    let checkpoint = out.with_extension("unfinished").join("checkpoint.bin");
    for _ in 0..5 {
        let _ = std::fs::remove_dir_all(&out);
        let mut child = crate::common::command(&["run", text(scene), "--out", text(&out)])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("starts");
        wait_while_running(&mut child, || checkpoint.exists());
        let _ = child.kill();
        child.wait().expect("ends");
        if checkpoint.exists() {
            return out;
        }
    }
    panic!("always done before it could be killed");
}

/// Returns the summaries of an uninterrupted run and of one that was killed half way and resumed.
fn whole_and_resumed(scene: &Path) -> [serde_json::Value; 2] {
    let whole = scene.with_file_name("whole");
    succeed(&["run", text(scene), "--out", text(&whole)]);
    let killed = killed_half_way(scene);
    // By the name that the folder has now; the results get the name that was asked for.
    succeed(&["resume", text(&killed.with_extension("unfinished"))]);
    let summaries = [whole, killed].map(|f| summary(&f));
    assert!(number(&summaries[1], "/resumed_at_step") > 0.0 && summaries[0].get("resumed_at_step").is_none());
    summaries
}

/// A resumed run reports the energy and the largest velocity jump of the start, which precede its checkpoint.
/// The waves die out, and the lumped constraint leaves jumps, so that both are largest at the start.
#[test]
fn a_resumed_run_knows_the_energy_and_the_largest_jump_of_its_start() {
    let head = SMALL.split("[[support]]").next().expect("models");
    let head = head.replace("weight =", "lumped = true\nweight =");
    let motion = "\n[[initial]]\nvelocity.polynomial = { component = \"x\", along = \"x\", coefficients = [1.0, 0.3] }\n\
        [[effect]]\nmass_damping = { rate = 0.002 }\n\
        [time]\nsteps = 20000\n[output]\ncheckpoint_every = 10000\nplots = false\nevery = 20000\n";
    let [whole, resumed] = whole_and_resumed(&written("half-way", &format!("{head}{motion}")));
    for figure in [
        "/energy/initial",
        "/energy/final",
        "/energy/start_loss",
        "/energy/h_drift_max",
        "/interface/0/max_constraint_residual",
    ] {
        let [a, b] = [&whole, &resumed].map(|s| number(s, figure));
        assert!(
            a.to_bits() == b.to_bits(),
            "{figure}: {a:e} of the whole run, {b:e} resumed"
        );
    }
    assert_eq!(whole["energy"]["ledger"], resumed["energy"]["ledger"]);
    // The figures stem from the start: energy has fallen to less than a hundredth.
    assert!(number(&whole, "/energy/initial") > 100.0 * number(&whole, "/energy/final"));
    assert!(number(&whole, "/interface/0/max_constraint_residual") > 1e-6);
}

/// One tetrahedron.
const MESH: &str = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n\
    $Nodes\n1 4 1 4\n3 1 0 4\n1\n2\n3\n4\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n$EndNodes\n\
    $Elements\n1 1 1 1\n3 1 4 1\n1 1 2 3 4\n$EndElements\n";

#[test]
fn a_file_that_changed_since_the_checkpoint_is_noticed() {
    let scene = written(
        "half-changed",
        "[model.body]\nkind = \"fem\"\nrole = \"coarse\"\nshape.file = \"body.msh\"\n\
         material = { young = 1.0, poisson = 0.25, density = 1.0 }\n\
         [[initial]]\nvelocity.polynomial = { component = \"x\", along = \"x\", coefficients = [1.0, 0.3] }\n\
         [time]\nsteps = 400000\n[output]\ncheckpoint_every = 50000\nevery = 400000\nplots = false\n",
    );
    let mesh = scene.with_file_name("body.msh");
    std::fs::write(&mesh, MESH).expect("mesh");
    let killed = killed_half_way(&scene);
    let refused = |changed: &str| {
        std::fs::write(&mesh, changed).expect("mesh");
        let out = arlequin(&["resume", text(&killed)]);
        assert_eq!(out.status.code(), Some(2), "{changed}");
        let stderr = String::from_utf8_lossy(&out.stderr).replace(['\n', '│'], " ");
        let stderr = stderr.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(
            stderr.contains("body.msh") && stderr.contains("has changed since the checkpoint was written"),
            "{stderr}"
        );
    };
    // A changed node with the same file length, and an added blank.
    refused(&MESH.replace("1 0 0", "2 0 0"));
    refused(&format!("{MESH} "));
    std::fs::write(&mesh, MESH).expect("mesh");
    succeed(&["resume", text(&killed)]);
    assert_eq!(summary(&killed)["status"], "complete");
}
