//! The decks of the literature, our numbers beside theirs.

mod beam_a;
mod beam_b;
mod beams;
mod check;
mod choices;
mod claims;
mod solids;
mod strength;
mod theory;

use arlequin_scene::Progress;
use arlequin_scene::error::{Error, Result, unknown};
use beams::{Record, RunSpec};
pub use check::{Accept, Check, short};
pub use solids::cantilever_cell;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// A curve of a picture: name, abscissae, ordinates.
pub type Series = (String, Vec<f64>, Vec<f64>);

/// A picture and what is to be said about it.
#[derive(Debug, Clone)]
pub struct Figure {
    /// File name without ending.
    pub file: &'static str,
    /// Headline.
    pub title: &'static str,
    /// Quantity and unit of the horizontal and the vertical axis.
    pub axes: [[&'static str; 2]; 2],
    /// Whether they are logarithmic.
    pub log: [bool; 2],
    /// Curves.
    pub curves: Vec<Series>,
    /// What the literature says, what we see, why.
    pub says: String,
}

/// What a case found.
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

/// What the runs of scenes gave, by their keys, and whether only the cheap ones were made.
#[derive(Debug)]
pub struct Runs {
    records: BTreeMap<String, Record>,
    /// Whether only the cheap variants are wanted.
    pub quick: bool,
    /// Whether pictures are wanted.
    pub figures: bool,
}

impl Runs {
    /// The record of a run, if it was made.
    pub fn get(&self, key: &str) -> Option<&Record> {
        self.records.get(key)
    }
}

/// A case: runs of scenes it needs, and what it makes of them.
#[derive(Debug)]
pub struct Case {
    /// Name.
    pub name: &'static str,
    /// One line about it.
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

/// How cases are run.
#[derive(Debug, Clone, Copy, Default)]
pub struct Options<'a> {
    /// Cheap cases and cheap variants only.
    pub quick: bool,
    /// Cases at a time, each on one thread.
    pub threads: usize,
    /// Folder that keeps the runs of the beams; those there already are taken from it.
    pub kept: Option<&'a Path>,
}

/// The cases of these names; all if there is none.
///
/// # Errors
/// An unknown name.
pub fn choose(names: &[String]) -> Result<Vec<&'static Case>> {
    if names.is_empty() {
        return Ok(CASES.iter().collect());
    }
    let known: Vec<String> = CASES.iter().map(|c| c.name.to_owned()).collect();
    let find = |n: &String| {
        let found = CASES.iter().find(|c| c.name == n);
        found.ok_or_else(|| unknown("verify", n, "case", known.iter()))
    };
    names.iter().map(find).collect()
}

/// All checks of a case that needs no runs of scenes, without its pictures.
///
/// # Errors
/// An unknown name; failed runs.
pub fn checks(name: &str) -> Result<Vec<Check>> {
    let runs = Runs {
        records: BTreeMap::new(),
        quick: true,
        figures: false,
    };
    let case = choose(&[name.to_owned()])?;
    Ok((case[0].evaluate)(&runs)?.checks)
}

/// Runs cases; one report each.
///
/// # Errors
/// Failed runs; a promise that does not hold is a row.
pub fn run(cases: &[&Case], options: &Options<'_>, progress: Progress<'_>) -> Result<Vec<Report>> {
    let done = run_scenes(cases, options, progress)?;
    in_parallel(cases, options.threads, "cases", progress, |case| {
        let mut report = (case.evaluate)(&done)?;
        report
            .checks
            .iter_mut()
            .for_each(|r| r.case = case.name.to_owned());
        Ok(report)
    })
}

/// Makes every run the cases need once, the dearest first.
fn run_scenes(cases: &[&Case], options: &Options<'_>, progress: Progress<'_>) -> Result<Runs> {
    let mut specs: Vec<RunSpec> = Vec::new();
    for spec in cases.iter().flat_map(|c| (c.runs)(options.quick)) {
        if specs.iter().all(|s| s.key != spec.key) {
            specs.push(spec);
        }
    }
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

/// Works through a list, each item on one thread of its own; results in the order of the list.
///
/// # Errors
/// The first of `work`.
pub fn in_parallel<T: Sync, R: Send>(
    items: &[T],
    threads: usize,
    what: &'static str,
    progress: Progress<'_>,
    work: impl Fn(&T) -> Result<R> + Sync,
) -> Result<Vec<R>> {
    let next = AtomicUsize::new(0);
    let slots: Vec<Mutex<Option<Result<R>>>> = items.iter().map(|_| Mutex::new(None)).collect();
    let finished = AtomicUsize::new(0);
    progress(what, 0, items.len());
    std::thread::scope(|scope| {
        for _ in 0..threads.min(items.len()) {
            scope.spawn(|| {
                // One thread each: two cases at a time use two cores better than one case does.
                let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
                loop {
                    let k = next.fetch_add(1, Ordering::Relaxed);
                    let Some(item) = items.get(k) else { break };
                    let made = match &pool {
                        Ok(pool) => pool.install(|| work(item)),
                        Err(e) => Err(Error::System {
                            what: "starting the threads",
                            message: e.to_string(),
                        }),
                    };
                    if let Ok(mut slot) = slots[k].lock() {
                        *slot = Some(made);
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
    let found = slots.into_iter().map(|s| s.into_inner().ok().flatten());
    found.map(|r| r.unwrap_or_else(|| Err(lost()))).collect()
}

/// An error of the core, named after what was computed.
fn at(what: impl Into<String>) -> impl FnOnce(arlequin::core::Error) -> Error {
    arlequin_scene::error::core(what)
}
