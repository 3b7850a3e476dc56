//! Cases of the literature: our numbers beside the published ones.

mod beam_a;
mod beam_b;
mod beams;
pub mod branching;
mod check;
mod choices;
pub mod circles;
mod claims;
pub mod cone;
pub mod dcb;
pub mod edge;
pub mod kalthoff;
mod solids;
mod strength;
pub mod strip;
mod theory;

use arlequin::core::Coupled;
use arlequin_scene::error::{Error, Result, unknown};
use arlequin_scene::{Observer, Progress, Results};
use beams::{Record, RunSpec};
pub use check::{Accept, Check, short};
pub use solids::cantilever_cell;
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// A curve of a picture: name, abscissae, ordinates.
pub type Series = (String, Vec<f64>, Vec<f64>);

/// A picture with its caption.
#[derive(Debug, Clone)]
pub struct Figure {
    /// File name without ending.
    pub file: &'static str,
    /// Title above the picture.
    pub title: &'static str,
    /// Quantity and unit of the horizontal and the vertical axis.
    pub axes: [[&'static str; 2]; 2],
    /// True if the horizontal and the vertical axis are logarithmic.
    pub log: [bool; 2],
    /// Curves.
    pub curves: Vec<Series>,
    /// Caption: statement of the literature, our result, explanation.
    pub says: String,
}

/// Results of a case.
#[derive(Debug, Clone, Default)]
pub struct Report {
    /// Rows of the table.
    pub checks: Vec<Check>,
    /// Pictures.
    pub figures: Vec<Figure>,
}

impl From<Vec<Check>> for Report {
    fn from(checks: Vec<Check>) -> Self {
        Self {
            checks,
            figures: Vec::new(),
        }
    }
}

/// Records of the scene runs by their keys, and the options of the evaluation.
#[derive(Debug)]
pub struct Runs {
    records: BTreeMap<String, Record>,
    /// True if only the cheap variants are wanted.
    pub quick: bool,
    /// True if pictures are wanted.
    pub figures: bool,
}

impl Runs {
    /// Returns the record of a run, if that run was made.
    pub fn get(&self, key: &str) -> Option<&Record> {
        self.records.get(key)
    }
}

/// A case: the scene runs it needs, and the function that evaluates them.
#[derive(Debug)]
pub struct Case {
    /// Name.
    pub name: &'static str,
    /// One line of description.
    pub about: &'static str,
    runs: fn(bool) -> Vec<RunSpec>,
    evaluate: fn(&Runs) -> Result<Report>,
}

fn none(_: bool) -> Vec<RunSpec> {
    Vec::new()
}

const fn cheap(name: &'static str, about: &'static str, evaluate: fn(&Runs) -> Result<Report>) -> Case {
    Case {
        name,
        about,
        runs: none,
        evaluate,
    }
}

/// All cases, in the order of the table.
pub static CASES: [Case; 18] = [
    cheap(
        "bauman",
        "static bar and springs, table of Bauman et al. 2008",
        solids::bauman,
    ),
    cheap(
        "transmission",
        "long pulse through constant weights in the overlap and everywhere",
        theory::transmission,
    ),
    cheap(
        "invariants",
        "random state: energy, velocity and displacement constraint",
        theory::invariants,
    ),
    cheap(
        "critical-step",
        "critical step for small weights, blow-up and boundedness beside it",
        theory::critical_step,
    ),
    cheap(
        "absorber",
        "waves above the cutoff with and without absorber",
        theory::absorber,
    ),
    cheap("patch", "uniform strain across the overlap", theory::patch),
    cheap(
        "reflection",
        "reflection and transmission below the cutoff",
        theory::reflection,
    ),
    cheap("rank", "mediator finer than the particles", theory::rank),
    cheap(
        "momenta",
        "momenta of a free body in space, non-coincident meshes",
        solids::momenta,
    ),
    cheap(
        "weighting",
        "nodal and energy weighting with constant weights",
        choices::weighting,
    ),
    cheap(
        "conditioning",
        "condition of the multiplier operator against l and epsilon",
        choices::conditioning,
    ),
    cheap("mediator", "best length of the mediator", choices::mediator),
    cheap(
        "locking",
        "overlap velocities of the two models, coarse and fine mediator",
        choices::locking,
    ),
    cheap(
        "claims",
        "two claims of the papers that do not hold here: reflection by direction, damping by a fine mediator",
        claims::claims,
    ),
    cheap(
        "cantilever",
        "energy of the Norma cantilever, published Schwarz drifts",
        solids::cantilever,
    ),
    cheap(
        "strength",
        "peak loads of direct tension, Brazilian disc and bending, from reactions",
        strength::strength,
    ),
    Case {
        name: "beam-a",
        about: "tension of the small silica beam: DEM, CNEM, FEM, coupled",
        runs: beam_a::runs,
        evaluate: beam_a::evaluate,
    },
    Case {
        name: "beam-b",
        about: "tension, bending, torsion, initial velocity of the large beam: DEM, CNEM, FEM, coupled",
        runs: beam_b::runs,
        evaluate: beam_b::evaluate,
    },
];

/// Benchmarks of fracture, which take minutes each: `arlequin verify --fracture`.
pub static FRACTURE: [Case; 7] = [
    cheap(
        "branching",
        "dynamic crack branching in soda-lime glass at 4 MPa, a straight crack at 2 MPa",
        branching::branching,
    ),
    cheap(
        "kalthoff",
        "plate struck between two notches: angle of the crack, whole struck edge",
        kalthoff::kalthoff,
    ),
    cheap(
        "strip",
        "released energy per area of an edge-cracked strip, for beams of several widths",
        strip::strip,
    ),
    cheap(
        "edge",
        "strength of edge-cracked bars at rest over the length of the crack",
        edge::edge,
    ),
    cheap(
        "dcb",
        "double cantilever at rest: energy by load, by opening and by the grips",
        dcb::dcb,
    ),
    cheap(
        "cone",
        "ring and cone under a blunt ball on silica, bonds or particles that break",
        cone::cone,
    ),
    cheap(
        "circles",
        "two of nine circles: strength surface, pure-shear test",
        circles::circles,
    ),
];

/// Options of a verification.
#[derive(Debug, Clone, Copy, Default)]
pub struct Options<'a> {
    /// Cheap cases and cheap variants only.
    pub quick: bool,
    /// Number of cases that run at the same time, each on one thread.
    pub threads: usize,
    /// Folder with records of the beam runs. Runs with a record there are not repeated.
    pub kept: Option<&'a Path>,
}

/// Returns the cases of a list with these names; all cases if no name is given.
///
/// # Errors
/// An unknown name.
pub fn choose(cases: &'static [Case], names: &[String]) -> Result<Vec<&'static Case>> {
    if names.is_empty() {
        return Ok(cases.iter().collect());
    }
    let known: Vec<String> = cases.iter().map(|c| c.name.to_owned()).collect();
    let find = |n: &String| {
        let case = cases.iter().find(|c| c.name == n);
        case.ok_or_else(|| unknown("verify", n, "case", known.iter()))
    };
    names.iter().map(find).collect()
}

/// Returns all checks of the quick variant of a case of [`CASES`] or [`FRACTURE`] that needs no scene runs,
/// without pictures.
///
/// # Errors
/// An unknown name; failed runs.
pub fn checks(name: &str) -> Result<Vec<Check>> {
    let runs = Runs {
        records: BTreeMap::new(),
        quick: true,
        figures: false,
    };
    let fracture = FRACTURE.iter().any(|c| c.name == name);
    let cases: &'static [Case] = if fracture { &FRACTURE } else { &CASES };
    let case = choose(cases, &[name.to_owned()])?;
    Ok((case[0].evaluate)(&runs)?.checks)
}

/// Runs cases and returns one report for each.
///
/// A check that does not hold is a row of the report, and so is a case that ends with an error: the others
/// took minutes.
///
/// # Errors
/// Failed runs that several cases share.
pub fn run(cases: &[&Case], options: &Options<'_>, progress: Progress<'_>) -> Result<Vec<Report>> {
    let done = run_scenes(cases, options, progress)?;
    in_parallel(cases, options.threads, "cases", progress, |case| {
        let mut report = (case.evaluate)(&done).unwrap_or_else(|e| {
            let row = Check::new("runs that end with an error", 1.0, Accept::AtMost(0.0));
            vec![row.note(e.to_string())].into()
        });
        report
            .checks
            .iter_mut()
            .for_each(|r| r.case = case.name.to_owned());
        Ok(report)
    })
}

/// Makes every run that the cases need once, the dearest first.
fn run_scenes(cases: &[&Case], options: &Options<'_>, progress: Progress<'_>) -> Result<Runs> {
    let mut specs: Vec<RunSpec> = Vec::new();
    for spec in cases.iter().flat_map(|c| (c.runs)(options.quick)) {
        // Cases share runs, and a run costs far more than this search.
        if specs.iter().all(|s| s.key != spec.key) {
            specs.push(spec);
        }
    }
    // A long run that starts last would leave the other threads idle.
    specs.sort_by_key(|s| std::cmp::Reverse(s.cost));
    let records = in_parallel(&specs, options.threads, "runs", progress, |s| {
        s.run_or_recall(options.kept)
    })?;
    let keys = specs.into_iter().map(|s| s.key);
    Ok(Runs {
        records: keys.zip(records).collect(),
        quick: options.quick,
        figures: true,
    })
}

/// Applies `work` to a list, each item on a single thread. Results have the order of the list.
///
/// # Errors
/// The first error of `work` in the order of the list.
pub fn in_parallel<T: Sync, R: Send>(
    items: &[T],
    threads: usize,
    what: &'static str,
    progress: Progress<'_>,
    work: impl Fn(&T) -> Result<R> + Sync,
) -> Result<Vec<R>> {
    // Threads take the next item when they are free, since items differ much in cost.
    let next = AtomicUsize::new(0);
    // One slot per item: results keep the order of the list, whichever thread is faster.
    let slots: Vec<Mutex<Option<Result<R>>>> = items.iter().map(|_| Mutex::new(None)).collect();
    let finished = AtomicUsize::new(0);
    progress(what, 0, items.len());
    std::thread::scope(|scope| {
        for _ in 0..threads.min(items.len()) {
            scope.spawn(|| {
                // A pool of one thread: two cases side by side use two cores better than one case with two
                // threads.
                let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
                loop {
                    let k = next.fetch_add(1, Ordering::Relaxed);
                    let Some(item) = items.get(k) else { break };
                    let result = match &pool {
                        Ok(pool) => pool.install(|| work(item)),
                        Err(e) => Err(Error::System {
                            what: "starting the threads",
                            message: e.to_string(),
                        }),
                    };
                    if let Ok(mut slot) = slots[k].lock() {
                        *slot = Some(result);
                    }
                    progress(what, finished.fetch_add(1, Ordering::Relaxed) + 1, items.len());
                }
            });
        }
    });
    let lost = || Error::System {
        what: "verify",
        message: "a worker ended without a result".into(),
    };
    let results = slots.into_iter().map(|s| s.into_inner().ok().flatten());
    results.map(|r| r.unwrap_or_else(|| Err(lost()))).collect()
}

/// Ends a run at rest as soon as its body is torn: its energy is then below a fifth of the highest.
#[derive(Debug, Default)]
struct UntilTorn {
    highest: f64,
}

impl Observer for UntilTorn {
    fn step(&mut self, run: &Coupled<f64>, _planned: usize) -> ControlFlow<()> {
        let energy = run.energy();
        self.highest = self.highest.max(energy);
        if energy < 0.2 * self.highest {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    }
}

/// Result of a test at rest; `None` if a load step found no equilibrium, as a nearly torn body may not.
fn at_rest<T>(result: Result<T>) -> Result<Option<T>> {
    match result {
        Err(Error::Core {
            source: arlequin::core::Error::NotSettled { .. },
            ..
        }) => Ok(None),
        other => other.map(Some),
    }
}

/// Row that counts the tests in which every load step found its equilibrium.
fn rests<T>(tests: &[Option<T>]) -> Check {
    Check::against(
        "tests in which every load step finds an equilibrium",
        tests.iter().flatten().count() as f64,
        tests.len() as f64,
        "our expectation",
        Accept::Absolute(0.0),
    )
}

/// Values of a probe of a run.
fn measured<'a>(results: &'a Results, name: &str) -> Result<&'a [f64]> {
    let missing = || Error::System {
        what: "verify",
        message: format!("the run has no probe '{name}'"),
    };
    results.probe(name).map(|p| p.1).ok_or_else(missing)
}

/// Last value of a probe of a run.
fn last(results: &Results, name: &str) -> Result<f64> {
    let values = measured(results, name)?;
    Ok(values.last().copied().unwrap_or(f64::NAN))
}

/// Wraps an error of the core with a description of the computation.
fn core_error(what: impl Into<String>) -> impl FnOnce(arlequin::core::Error) -> Error {
    arlequin_scene::error::core(what)
}
