//! Processes that speak MPI: the bits of one rank, and failures with names. Each test starts this program
//! again under `mpirun`.
#![cfg(feature = "mpi")]
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]
#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "started programs tell their results"
)]

use arlequin_core::ranks::{Communicator, Division, Reduction};
use arlequin_core::{Coupled, Model, Partition, Silent, Subdomain, TimeStep, Uniform, Weights};
use arlequin_mpi::processes::{self, Ending};
use dem_beam::packing::{Lattice, lattice};
use dem_beam::{BeamMaterial, DemModel};
use std::process::{Command, Output};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Variable with the task of a started process.
const WORK: &str = "ARLEQUIN_TEST_WORK";

/// Returns 1 715 particles of a body-centred lattice: seven units.
fn cube(finite: bool) -> DemModel {
    let cube = lattice(Lattice::BodyCentred, [9; 3], 1e-4).unwrap();
    let m = DemModel::new("cube", &cube, BeamMaterial::SILICA, 2200.0).unwrap();
    if finite { m.with_finite_rotations() } else { m }
}

/// Returns the sum of a hash of every particle's bits and place, small enough that no sum overflows.
fn digest(model: &dyn Model<f64>, vectors: &[&[f64]]) -> i64 {
    let n = model.layout().nodes;
    let hash = |i: usize| {
        let place = model.owned().global(i) as u64;
        let six = |x: &&[f64]| [&x[3 * i..3 * i + 3], &x[3 * (n + i)..3 * (n + i) + 3]].concat();
        let numbers = vectors.iter().flat_map(six);
        let mixed = numbers.fold(place, |h, x| {
            (h ^ x.to_bits())
                .wrapping_mul(0x9e37_79b9_7f4a_7c15)
                .rotate_left(29)
        });
        (mixed >> 16) as i64
    };
    (0..n).map(hash).sum()
}

/// Makes steps with everything in motion and returns the bits of the state and of the ledger.
fn steps(model: DemModel) -> arlequin_core::Result<(i64, Vec<u64>)> {
    let n = model.layout().nodes;
    let place = |i: usize| model.owned().global(i);
    let velocity = |k: usize| [1.0, 2e3][k / (3 * n)] * (1.7 * (6 * place(k / 3 % n) + k % 3) as f64).sin();
    let v = (0..6 * n).map(velocity).collect();
    let side = Subdomain::fine(model, Weights::from_weight(Arc::new(Uniform(1.0))))
        .with_partition(Partition::Unchecked)
        .with_initial(vec![0.0; 6 * n], v)?;
    let mut run = Coupled::new(vec![side], Vec::new(), TimeStep::Fraction(0.5), None)?;
    run.run(40, &mut Silent)?;
    let e = run.last_energy().map_or([0.0; 2], |e| [e.invariant, e.kinetic]);
    let sums = [run.dt(), run.energy(), e[0], e[1]].map(f64::to_bits);
    let s = &run.subdomains()[0];
    Ok((digest(s.model(), &[&s.state().q, &s.state().v]), sums.to_vec()))
}

/// Does the task of a started process.
fn worker(work: &str, c: Arc<dyn Communicator>) -> arlequin_core::Result<()> {
    match (work, c.rank()) {
        ("fails", 1) => return Err(arlequin_core::invalid("disk", "full", "must have room")),
        ("panics", 1) => panic!("on purpose"),
        ("hangs", 1) => std::thread::sleep(Duration::from_secs(30)),
        ("dies", 1) => std::process::exit(7),
        ("odd", rank) => {
            let m = cube(rank == 1);
            let division = Division::bisect(m.nodes().len(), &m.units(), c.ranks())?;
            m.partition_among(&division, c)?;
            return Ok(());
        }
        _ => {}
    }
    for finite in [false, true] {
        let m = cube(finite);
        let division = Division::bisect(m.nodes().len(), &m.units(), c.ranks())?;
        let (digest, sums) = steps(m.partition_among(&division, c.clone())?)?;
        let mut digests = [digest];
        c.reduce(&mut digests, Reduction::Sum)?;
        if c.rank() == 0 {
            println!("result {} {sums:?}", digests[0]);
        }
    }
    Ok(())
}

#[test]
fn worker_of_the_other_tests() {
    let Ok(work) = std::env::var(WORK) else {
        return;
    };
    let ending = Ending {
        wait: Duration::from_secs(if work == "hangs" { 2 } else { 60 }),
        code: 3,
        report: |why| eprintln!("told: {why}"),
        echo: true,
    };
    processes::run(ending, |c| worker(&work, c)).unwrap();
}

/// Starts this program on several ranks, if need be more than there are cores.
fn start(ranks: usize, work: &str) -> Output {
    let program = std::env::current_exe().unwrap();
    let mut run = Command::new("mpirun");
    run.args([
        "--oversubscribe",
        "--mca",
        "mpi_yield_when_idle",
        "1",
        "-n",
        &ranks.to_string(),
    ])
    .arg(program)
    .args([
        "--exact",
        "worker_of_the_other_tests",
        "--nocapture",
        "--test-threads=1",
    ])
    .env(WORK, work)
    .env("RAYON_NUM_THREADS", "1");
    for (key, value) in [
        ("OMPI_ALLOW_RUN_AS_ROOT", "1"),
        ("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1"),
        // Containers forbid it, with many lines of messages.
        ("OMPI_MCA_btl_vader_single_copy_mechanism", "none"),
    ] {
        run.env(key, value);
    }
    run.output().unwrap()
}

fn results(output: &Output) -> Vec<String> {
    let text = String::from_utf8_lossy(&output.stdout);
    let results = text
        .lines()
        .filter_map(|l| l.split_once("result ").map(|r| r.1.to_owned()));
    results.collect()
}

#[test]
fn processes_have_the_bits_of_one_rank() {
    let whole = [false, true].map(|finite| {
        let (digest, sums) = steps(cube(finite)).unwrap();
        format!("{digest} {sums:?}")
    });
    for ranks in [1, 2, 3, 4] {
        let run = start(ranks, "steps");
        let said = String::from_utf8_lossy(&run.stderr).into_owned();
        assert!(run.status.success(), "{ranks} ranks: {said}");
        assert_eq!(results(&run), whole, "{ranks} ranks: {said}");
    }
}

#[test]
fn a_rank_that_fails_panics_hangs_or_dies_ends_the_job_by_name() {
    let cases = [
        (
            "fails",
            "rank 0 stops because rank 1 gave up: disk = full: must have room",
            Some(3),
        ),
        (
            "panics",
            "rank 0 stops because rank 1 gave up: rank 1: the program panicked",
            Some(3),
        ),
        (
            "odd",
            "ranks differ in the bodies of particles that they have made",
            Some(3),
        ),
        ("hangs", "has waited 2 s for", Some(3)),
        // MPI itself ends the job.
        ("dies", "", None),
    ];
    for (work, wanted, code) in cases {
        let begun = Instant::now();
        let run = start(3, work);
        let said = String::from_utf8_lossy(&run.stderr).into_owned();
        assert!(
            begun.elapsed() < Duration::from_secs(20),
            "{work}: {:?}",
            begun.elapsed()
        );
        assert!(
            !run.status.success() && code.is_none_or(|c| run.status.code() == Some(c)),
            "{work}: {said}"
        );
        assert!(said.contains(wanted), "{work}: {said}");
    }
}
