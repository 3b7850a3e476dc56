//! What ranks send, hold and take, as processes that speak MPI: one command makes the whole table and starts all ranks itself.
//!
//! ```text
//! cargo run --release -p arlequin-mpi --features mpi --example ranks -- 47 3
//! ```
//!
//! Cells of a body-centred lattice along each edge, and rounds: runs take turns, and the least of their times counts.
#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "a table is all it makes"
)]

use arlequin_core::ranks::{self, Communicator, Message, RankError, Reduction};
use arlequin_core::{Coupled, Guard, Model, Partition, Silent, Subdomain, TimeStep, Uniform, Weights};
use arlequin_core::{DofLayout, parallel};
use arlequin_mpi::processes::{self, Ending};
use dem_beam::packing::{Lattice, lattice};
use dem_beam::{BeamMaterial, DemModel};
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::{Duration, Instant};

/// Tells a started process how many cells its body has along each edge.
const CELLS: &str = "ARLEQUIN_RANKS_CELLS";

/// Batches of steps of which the fastest counts, and steps in each: as many as between two drawings of the ledger.
const BATCHES: usize = 8;
const STEPS: usize = 10;

/// What a rank tells: nanoseconds per step, kB in use and at most, particles, messages, bytes, reductions and their words in all
/// steps, imbalance in parts of a million.
type Told = [i64; 9];

type Failure = Box<dyn std::error::Error + Send + Sync>;

fn main() -> Result<(), Failure> {
    if let Ok(cells) = std::env::var(CELLS) {
        let ending = Ending {
            wait: Duration::from_secs(120),
            code: 3,
            report: |why| eprintln!("{why}"),
            echo: false,
        };
        let cells = cells.parse()?;
        processes::run(ending, |c| one_rank(cells, c))?;
        return Ok(());
    }
    let argument = |k: usize, default: usize| std::env::args().nth(k).map_or(Ok(default), |a| a.parse());
    let (cells, rounds) = (argument(1, 47)?, argument(2, 3)?);
    sums(cells)?;
    println!(
        "ranks x threads | ms per step | particles | kB in use | kB at most | messages per step | kB per step | reductions per step | \
         words each | imbalance %"
    );
    let mut timed = vec![(1, 1), (1, 2), (2, 1)];
    let mut best: Vec<Option<Told>> = vec![None; timed.len()];
    for _ in 0..rounds {
        for (of, best) in timed.iter().zip(&mut best) {
            let now = started(cells, *of)?;
            *best = Some(best.filter(|b| b[0] <= now[0]).unwrap_or(now));
        }
    }
    for of in [(4, 1), (8, 1)] {
        timed.push(of);
        best.push(Some(started(cells, of)?));
    }
    let all = BATCHES * STEPS + STEPS;
    for ((ranks, threads), told) in timed.iter().zip(best.iter().flatten()) {
        let [
            ns,
            now,
            most,
            particles,
            messages,
            bytes,
            reductions,
            words,
            imbalance,
        ] = told.map(|x| x as f64);
        let per = |x: f64| x / all as f64;
        println!(
            "{ranks} x {threads} | {:.3} | {particles} | {now} | {most} | {:.2} | {:.1} | {:.2} | {:.0} | {:.2}",
            1e-6 * ns,
            per(messages),
            1e-3 * per(bytes),
            per(reductions),
            words / reductions.max(1.0),
            1e-4 * imbalance
        );
    }
    let ms = |k: usize| best[k].map_or(f64::NAN, |t| t[0] as f64);
    println!(
        "2 ranks are {:.2} times as fast as 1 rank with 1 thread, {:.2} times as 1 rank with 2 threads",
        ms(0) / ms(2),
        ms(1) / ms(2)
    );
    Ok(())
}

/// Starts so many ranks with so many threads each, and hears the largest of what they tell.
fn started(cells: usize, (ranks, threads): (usize, usize)) -> Result<Told, Failure> {
    let mut run = Command::new("mpirun");
    run.args([
        "--oversubscribe",
        "--bind-to",
        "none",
        "--mca",
        "mpi_yield_when_idle",
        "1",
    ]);
    run.args(["-n", &ranks.to_string()]).arg(std::env::current_exe()?);
    run.env(CELLS, cells.to_string());
    run.env("RAYON_NUM_THREADS", threads.to_string());
    for key in ["OMPI_ALLOW_RUN_AS_ROOT", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM"] {
        run.env(key, "1");
    }
    // Containers forbid it, and say so in many lines.
    run.env("OMPI_MCA_btl_vader_single_copy_mechanism", "none");
    let run = run.output()?;
    let text = String::from_utf8_lossy(&run.stdout).into_owned();
    let line = text.lines().find_map(|l| l.strip_prefix("told "));
    let line = line.ok_or_else(|| format!("{ranks} ranks: {}", String::from_utf8_lossy(&run.stderr)))?;
    let numbers: Vec<i64> = line.split(' ').map(str::parse).collect::<Result<_, _>>()?;
    Ok(numbers.try_into().map_err(|_| "not nine numbers")?)
}

/// A transport that counts what goes through it.
#[derive(Debug)]
struct Counted {
    inner: Arc<dyn Communicator>,
    /// Messages, bytes, reductions, their words.
    counts: [AtomicU64; 4],
}

impl Communicator for Counted {
    fn rank(&self) -> usize {
        self.inner.rank()
    }
    fn ranks(&self) -> usize {
        self.inner.ranks()
    }
    fn exchange(&self, messages: &mut [Message], meanwhile: &mut dyn FnMut()) -> Result<(), RankError> {
        let numbers: usize = messages.iter().map(|m| m.out.len()).sum();
        self.counts[0].fetch_add(messages.len() as u64, Relaxed);
        self.counts[1].fetch_add(8 * numbers as u64, Relaxed);
        self.inner.exchange(messages, meanwhile)
    }
    fn reduce(&self, words: &mut [i64], how: Reduction) -> Result<(), RankError> {
        self.counts[2].fetch_add(1, Relaxed);
        self.counts[3].fetch_add(words.len() as u64, Relaxed);
        self.inner.reduce(words, how)
    }
    fn abandon(&self, why: &str) {
        self.inner.abandon(why);
    }
}

/// One rank of a run, all of whose particles move.
fn one_rank(cells: usize, inner: Arc<dyn Communicator>) -> Result<(), Failure> {
    let counted = Arc::new(Counted {
        inner: inner.clone(),
        counts: Default::default(),
    });
    let mut run = body(cells, Some(counted.clone()))?;
    counted.counts.iter().for_each(|c| c.store(0, Relaxed));
    run.run(STEPS, &mut Silent)?;
    let mut best = Duration::MAX;
    for _ in 0..BATCHES {
        let begun = Instant::now();
        run.run(STEPS, &mut Silent)?;
        best = best.min(begun.elapsed());
    }
    let s = &run.subdomains()[0];
    let imbalance = s.portion().map_or(0.0, |p| p.division().imbalance());
    let [messages, bytes, reductions, words] =
        [0, 1, 2, 3].map(|k: usize| counted.counts[k].load(Relaxed) as i64);
    let mut told: Told = [
        (best.as_nanos() / STEPS as u128) as i64,
        memory("VmRSS"),
        memory("VmHWM"),
        s.model().nodes().len() as i64,
        messages,
        bytes,
        reductions,
        words,
        (1e6 * imbalance) as i64,
    ];
    inner.reduce(&mut told, Reduction::Largest)?;
    if inner.rank() == 0 {
        println!("told {}", told.map(|t| t.to_string()).join(" "));
    }
    Ok(())
}

fn body(cells: usize, ranks: Option<Arc<dyn Communicator>>) -> Result<Coupled<f64>, Failure> {
    let cube = lattice(Lattice::BodyCentred, [cells; 3], 1e-4)?;
    let model = DemModel::new("cube", &cube, BeamMaterial::SILICA, 2200.0)?;
    drop(cube);
    let n = model.layout().dofs();
    let v = (0..n)
        .map(|k| if k < n / 2 { (0.37 * k as f64).sin() } else { 0.0 })
        .collect();
    let side = Subdomain::fine(model, Weights::same(Arc::new(Uniform(1.0))))
        .with_partition(Partition::Unchecked)
        .with_initial(vec![0.0; n], v)?;
    let side = match ranks {
        Some(c) => side.shared(c),
        None => side,
    };
    let guard = Guard {
        interval: STEPS,
        growth: 0.05,
    };
    Ok(Coupled::new(
        vec![side],
        Vec::new(),
        TimeStep::Fraction(0.5),
        Some(guard),
    )?)
}

/// kB, where the system tells.
fn memory(what: &str) -> i64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|l| l.starts_with(what));
    let number = line.and_then(|l| l.split_whitespace().nth(1)?.parse().ok());
    number.unwrap_or(0)
}

/// What exact sums cost beside sums over fixed cuts, as a kinetic energy of as many particles: once per drawing of the ledger.
fn sums(cells: usize) -> Result<(), Failure> {
    let nodes = 2 * cells * cells * cells;
    let layout = DofLayout {
        nodes,
        components: 3,
        rotations: 3,
    };
    let x: Vec<f64> = (0..layout.dofs()).map(|k| (0.1 * k as f64).sin()).collect();
    let least = |work: &dyn Fn() -> f64| {
        let timed = (0..20).map(|_| {
            let begun = Instant::now();
            std::hint::black_box(work());
            begun.elapsed()
        });
        timed.min().unwrap_or_default().as_secs_f64() / nodes as f64
    };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    let [plain, exact] = pool.install(|| {
        let plain = least(&|| parallel::sum(x.len(), &|r| x[r].iter().map(|x| x * x).sum()));
        let exact = least(&|| {
            let mut sum = ranks::Exact::zero();
            ranks::add_products(&layout, &x, &x, &mut sum);
            sum.value()
        });
        [plain, exact]
    });
    println!(
        "a sum over the unknowns of {nodes} particles on one thread: {:.2} ns per particle over fixed cuts, {:.2} ns exactly over units",
        1e9 * plain,
        1e9 * exact
    );
    Ok(())
}
