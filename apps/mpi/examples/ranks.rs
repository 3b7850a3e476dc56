//! Prints what ranks send, hold and take, as processes that speak MPI. One command starts all ranks and makes
//! the whole table.
//!
//! ```text
//! cargo run --release -p arlequin-mpi --features mpi --example ranks -- 47 3
//! ```
//!
//! Arguments: cells of a body-centred lattice along each edge, and rounds. Runs take turns, and the least
//! of their times counts. Two more numbers tie the first cells to elements: cells along an element (4, if 4
//! divides the cells; the overlap has two elements across), and the solver for the multipliers: chosen by
//! the core (0) or conjugate gradients (1).
#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "a table is all it makes"
)]

use arlequin_core::nalgebra::Point3;
use arlequin_core::ranks::{Communicator, Message, RankError, Reduction};
use arlequin_core::{
    Coupled, Guard, InterfaceSpec, L2, Model, Partition, Profile, Ramp, Sampling, Silent, Slab, Solver,
    Subdomain, TimeStep, Uniform, Weights,
};
use arlequin_core::{DofLayout, parallel};
use arlequin_mpi::processes::{self, Ending};
use dem_beam::packing::{Lattice, lattice};
use dem_beam::{BeamMaterial, DemModel};
use fem_ref::{Elastic, ElementKind, FemField, FemModel, generate};
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::{Duration, Instant};

/// Variable with the task of a started process.
const DECK: &str = "ARLEQUIN_RANKS_DECK";

/// Cube of particles, and its tie to elements.
#[derive(Debug, Clone, Copy)]
struct Deck {
    /// Number of cells along each edge.
    cells: usize,
    /// Number of cells along an element; 0 without an interface.
    element: usize,
    /// Solver for the multipliers: 0 or 1 as in the arguments.
    solver: usize,
}

impl Deck {
    fn from_numbers(
        number: impl Fn(usize) -> Result<usize, std::num::ParseIntError>,
    ) -> Result<Self, Failure> {
        Ok(Self {
            cells: number(0)?,
            element: number(1)?,
            solver: number(2)?,
        })
    }
}

/// Number of batches of steps, of which the fastest counts, and steps in each: as many as between two entries
/// of the ledger.
const BATCHES: usize = 8;
const STEPS: usize = 10;

/// Results of a rank: nanoseconds per step; kB in use before the set-up, now and at most; particles with
/// ghosts and owned ones; messages, bytes, reductions and their words in all steps; imbalance in parts per
/// million.
type Results = [i64; 11];

type Failure = Box<dyn std::error::Error + Send + Sync>;

fn main() -> Result<(), Failure> {
    if let Ok(deck) = std::env::var(DECK) {
        let ending = Ending {
            wait: Duration::from_secs(120),
            code: 3,
            report: |why| eprintln!("{why}"),
            echo: false,
        };
        let deck = Deck::from_numbers(|k| deck.split(' ').nth(k).unwrap_or_default().parse())?;
        processes::run(ending, |c| one_rank(deck, c))?;
        return Ok(());
    }
    let argument = |k: usize, default: usize| std::env::args().nth(k).map_or(Ok(default), |a| a.parse());
    let rounds = argument(2, 3)?;
    let deck = Deck::from_numbers(|k| argument([1, 3, 4][k], [47, 0, 0][k]))?;
    sums(deck.cells)?;
    println!(
        "ranks x threads | ms per step | particles | with ghosts | kB before | kB in use | kB at most | messages per step | kB per step | reductions per step | \
         words each | imbalance %"
    );
    let mut timed = vec![(1, 1, deck), (1, 2, deck), (2, 1, deck)];
    let mut best: Vec<Option<Results>> = vec![None; timed.len()];
    for _ in 0..rounds {
        for (setting, best) in timed.iter().zip(&mut best) {
            let now = started(*setting)?;
            *best = Some(best.filter(|b| b[0] <= now[0]).unwrap_or(now));
        }
    }
    for setting in [(4, 1, deck), (8, 1, deck)] {
        timed.push(setting);
        best.push(Some(started(setting)?));
    }
    let steps = BATCHES * STEPS + STEPS;
    for ((ranks, threads, _), results) in timed.iter().zip(best.iter().flatten()) {
        let [
            ns,
            before,
            now,
            most,
            held,
            particles,
            messages,
            bytes,
            reductions,
            words,
            imbalance,
        ] = results.map(|x| x as f64);
        let per = |x: f64| x / steps as f64;
        println!(
            "{ranks} x {threads} | {:.3} | {particles} | {held} | {before} | {now} | {most} | {:.2} | {:.1} | {:.2} | {:.0} | {:.2}",
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

/// Starts `ranks` ranks with `threads` threads each and returns the largest of their results.
fn started((ranks, threads, deck): (usize, usize, Deck)) -> Result<Results, Failure> {
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
    let Deck {
        cells,
        element,
        solver,
    } = deck;
    run.env(DECK, format!("{cells} {element} {solver}"));
    run.env("RAYON_NUM_THREADS", threads.to_string());
    for key in ["OMPI_ALLOW_RUN_AS_ROOT", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM"] {
        run.env(key, "1");
    }
    // Containers forbid it, with many lines of messages.
    run.env("OMPI_MCA_btl_vader_single_copy_mechanism", "none");
    let run = run.output()?;
    let text = String::from_utf8_lossy(&run.stdout).into_owned();
    let notes = text.lines().filter(|l| l.starts_with('#'));
    notes.for_each(|l| println!("{ranks} ranks {l}"));
    let line = text.lines().find_map(|l| l.strip_prefix("told "));
    let line = line.ok_or_else(|| format!("{ranks} ranks: {}", String::from_utf8_lossy(&run.stderr)))?;
    let numbers: Vec<i64> = line.split(' ').map(str::parse).collect::<Result<_, _>>()?;
    Ok(numbers.try_into().map_err(|_| "not eleven numbers")?)
}

/// Transport that counts what goes through it.
#[derive(Debug)]
struct Counted {
    inner: Arc<dyn Communicator>,
    /// Numbers of messages, bytes, reductions, and words in reductions.
    counts: [AtomicU64; 4],
}

impl Communicator for Counted {
    fn rank(&self) -> usize {
        self.inner.rank()
    }
    fn ranks(&self) -> usize {
        self.inner.ranks()
    }
    fn exchange(&self, messages: &mut [Message]) -> Result<(), RankError> {
        let numbers: usize = messages.iter().map(|m| m.out.len()).sum();
        self.counts[0].fetch_add(messages.len() as u64, Relaxed);
        self.counts[1].fetch_add(8 * numbers as u64, Relaxed);
        self.inner.exchange(messages)
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

/// Runs one rank. All particles move.
fn one_rank(deck: Deck, inner: Arc<dyn Communicator>) -> Result<(), Failure> {
    let counted = Arc::new(Counted {
        inner: inner.clone(),
        counts: Default::default(),
    });
    let before = memory("VmRSS");
    let mut run = tied(deck, counted.clone())?;
    counted.counts.iter().for_each(|c| c.store(0, Relaxed));
    run.run(STEPS, &mut Silent)?;
    let mut best = Duration::MAX;
    for _ in 0..BATCHES {
        let begun = Instant::now();
        run.run(STEPS, &mut Silent)?;
        best = best.min(begun.elapsed());
    }
    for i in run.interfaces().iter().filter(|_| inner.rank() == 0) {
        let r = i.report();
        println!(
            "# {} multipliers, {} coupled particles, {}, {} iterations",
            r.multipliers,
            r.coupled_nodes[1],
            r.solver,
            i.iterations()
        );
    }
    let s = &run.subdomains()[0];
    let imbalance = s.owned().portion().map_or(0.0, |p| p.division().imbalance());
    let held = match s.model().views().links {
        // Bonds of owned particles name owned particles and ghosts.
        Some(links) => links
            .pairs()
            .iter()
            .flatten()
            .max()
            .map_or(0, |last| *last as usize + 1),
        None => 0,
    };
    let [messages, bytes, reductions, words] =
        [0, 1, 2, 3].map(|k: usize| counted.counts[k].load(Relaxed) as i64);
    let mut results: Results = [
        (best.as_nanos() / STEPS as u128) as i64,
        before,
        memory("VmRSS"),
        memory("VmHWM"),
        held as i64,
        s.model().nodes().len() as i64,
        messages,
        bytes,
        reductions,
        words,
        (1e6 * imbalance) as i64,
    ];
    inner.reduce(&mut results, Reduction::Largest)?;
    if inner.rank() == 0 {
        println!("told {}", results.map(|t| t.to_string()).join(" "));
    }
    Ok(())
}

/// Returns the cube and the edge of its cells \[m\].
fn cube(cells: usize) -> Result<(DemModel, f64), Failure> {
    let packing = lattice(Lattice::BodyCentred, [cells; 3], 1e-4)?;
    let model = DemModel::new("cube", &packing, BeamMaterial::SILICA, 2200.0)?;
    Ok((model, packing.volume.cbrt() / cells as f64))
}

/// Couples the cube with elements that share its first cells.
fn tied(deck: Deck, ranks: Arc<dyn Communicator>) -> Result<Coupled<f64>, Failure> {
    let cells = deck.cells;
    let (model, cell) = cube(cells)?;
    let mut bodies = Vec::new();
    let mut interfaces = Vec::new();
    let mut weights = Weights::from_weight(Arc::new(Uniform(1.0)));
    if let Some(across) = cells.checked_div(deck.element) {
        let border = 2.0 * deck.element as f64 * cell;
        let edge = cells as f64 * cell;
        let block = |start: f64, along: usize| {
            let corners = [Point3::new(start, 0.0, 0.0), Point3::new(border, edge, edge)];
            generate::block(ElementKind::Hex8, corners[0], corners[1], [along, across, across])
        };
        let elements = FemModel::new("elements", block(-border, 4)?, Elastic::new(72e9, 0.17, 2200.0)?)?;
        let slab = Slab::between(Point3::new(border, 0.0, 0.0), Point3::origin())?;
        let ramp = Weights::from_weight(Arc::new(Ramp::new(Arc::new(slab), Profile::Cubic, 0.05)?));
        weights = Weights::complement_of(std::slice::from_ref(&ramp));
        bodies.push(Subdomain::coarse(elements, ramp).with_partition(Partition::Unchecked));
        let mut spec = InterfaceSpec::new("tie", 1, 0, Arc::new(FemField::new(block(0.0, 2)?)), L2);
        spec.options.sampling = Sampling::Particles;
        spec.options.solver = match deck.solver {
            0 => Solver::Auto,
            _ => Solver::conjugate_gradients(),
        };
        interfaces.push(spec);
    }
    let n = model.layout().dofs();
    let speed = |k: usize| (0.37 * k as f64).sin();
    let v = (0..n).map(|k| if k < n / 2 { speed(k) } else { 0.0 }).collect();
    let side = Subdomain::fine(model, weights)
        .with_partition(Partition::Unchecked)
        .with_initial(vec![0.0; n], v)?;
    bodies.insert(0, side.shared(ranks));
    let guard = Guard {
        interval: STEPS,
        growth: 0.05,
    };
    Ok(Coupled::new(
        bodies,
        interfaces,
        TimeStep::Fraction(0.5),
        Some(guard),
    )?)
}

/// Returns an entry of the process status \[kB\]; 0 if the system has none.
fn memory(what: &str) -> i64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|l| l.starts_with(what));
    let number = line.and_then(|l| l.split_whitespace().nth(1)?.parse().ok());
    number.unwrap_or(0)
}

/// Prints the cost of an exact sum beside a sum over fixed cuts, for a kinetic energy of as many particles; a
/// ledger entry needs one.
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
            let mut sum = arlequin_core::Exact::zero();
            arlequin_core::add_products(&layout, &x, &x, &mut sum);
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
