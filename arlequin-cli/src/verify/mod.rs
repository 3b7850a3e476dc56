//! `arlequin verify`: the decks of the literature, our numbers beside theirs.

mod beam_a;
mod beam_b;
mod beams;
mod choices;
mod claims;
mod hard;
mod page;
mod row;
mod solids;
mod theory;

use crate::error::{Error, Result, unknown};
use crate::report::{self, Progress};
use arlequin_scene::output::mark;
use arlequin_scene::output::plots::{self, Curve, Plot};
use beams::{Record, RunSpec};
use row::Row;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Compare with the literature.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Cases to run [default: all]
    cases: Vec<String>,
    /// Run the hard cases instead: what naive code does with them, and whether our promises hold.
    #[arg(long, conflicts_with_all = ["out", "docs", "resume"])]
    hard: bool,
    /// Print the rows as JSON.
    #[arg(long)]
    json: bool,
    /// List the cases and stop.
    #[arg(long)]
    list: bool,
    /// Cheap cases and cheap variants only, under a minute.
    #[arg(long)]
    quick: bool,
    /// Write the plots and verify.json to this folder.
    #[arg(long, value_name = "DIR", conflicts_with = "docs")]
    out: Option<PathBuf>,
    /// Write validation.md and its plots to this documentation folder.
    #[arg(long, value_name = "DIR")]
    docs: Option<PathBuf>,
    /// Keep the runs of the beams in this folder, and take from it those that are there already.
    #[arg(long, value_name = "DIR")]
    resume: Option<PathBuf>,
    /// Cases at a time, each on one thread [default: one per core]
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
}

/// A curve of a picture: name, abscissae, ordinates.
pub(crate) type Series = (String, Vec<f64>, Vec<f64>);

/// A picture and what is to be said about it.
#[derive(Debug, Clone)]
pub(crate) struct Figure {
    /// File name without ending.
    pub(crate) file: &'static str,
    /// Headline.
    pub(crate) title: &'static str,
    /// Quantity and unit of the horizontal and the vertical axis.
    pub(crate) axes: [[&'static str; 2]; 2],
    /// Whether they are logarithmic.
    pub(crate) log: [bool; 2],
    /// Curves.
    pub(crate) curves: Vec<Series>,
    /// What the literature says, what we see, why.
    pub(crate) says: String,
}

impl Figure {
    fn draw(&self, path: &Path) -> Result<()> {
        let curves = self.curves.iter().map(|(name, x, y)| Curve {
            name: name.clone(),
            times: x,
            values: y.clone(),
        });
        let plot = Plot {
            title: self.title.to_owned(),
            across: self.axes[0],
            log: self.log,
            quantity: self.axes[1][0],
            unit: self.axes[1][1],
            curves: curves.collect(),
        };
        plots::draw(path, &plot)
    }
}

/// What a case found.
#[derive(Debug, Clone, Default)]
pub(crate) struct Report {
    /// Rows of the table.
    pub(crate) rows: Vec<Row>,
    /// Pictures.
    pub(crate) figures: Vec<Figure>,
}

/// What the runs of scenes gave, by their keys, and whether only the cheap ones were made.
#[derive(Debug)]
pub(crate) struct Done {
    records: BTreeMap<String, Record>,
    /// Whether only the cheap variants are wanted.
    pub(crate) quick: bool,
}

impl Done {
    /// The record of a run, if it was made.
    pub(crate) fn get(&self, key: &str) -> Option<&Record> {
        self.records.get(key)
    }
}

/// A case: runs of scenes it needs, and what it makes of them.
struct Case {
    name: &'static str,
    about: &'static str,
    runs: fn(bool) -> Vec<RunSpec>,
    evaluate: fn(&Done) -> Result<Report>,
}

fn none(_: bool) -> Vec<RunSpec> {
    Vec::new()
}

const fn cheap(name: &'static str, about: &'static str, evaluate: fn(&Done) -> Result<Report>) -> Case {
    Case {
        name,
        about,
        runs: none,
        evaluate,
    }
}

/// All cases, in the order of the table.
const CASES: [Case; 17] = [
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

/// Runs the command.
pub(crate) fn verify(args: &Args) -> Result<ExitCode> {
    let pool = crate::threads::start(None)?;
    let threads = match args.threads {
        None => pool,
        wanted => crate::threads::bounded(wanted)?,
    };
    if args.hard {
        return hard::run(args, threads);
    }
    if args.list {
        for case in &CASES {
            report::line(&format!("{:<14} {}", case.name, case.about));
        }
        return Ok(ExitCode::SUCCESS);
    }
    let chosen = choose(&args.cases)?;
    if let Some(folder) = &args.out {
        mark::claim("--out", folder)?;
    }
    if let Some(folder) = &args.docs {
        mark::generated("--docs", &folder.join("validation.md"), page::HEAD)?;
    }
    let begin = std::time::Instant::now();
    let done = run_scenes(&chosen, args.quick, threads, args.resume.as_deref())?;
    let reports = in_parallel(&chosen, threads, "cases", |case| {
        let mut report = (case.evaluate)(&done)?;
        report.rows.iter_mut().for_each(|r| r.case = case.name.to_owned());
        Ok(report)
    })?;
    let rows: Vec<Row> = reports.iter().flat_map(|r| r.rows.iter().cloned()).collect();
    let text = serde_json::to_string_pretty(&rows).map_err(|e| Error::System {
        what: "writing the rows",
        message: e.to_string(),
    })?;
    if args.json {
        report::json(&text);
    } else {
        report::text(&row::table(&rows));
        report::line(&format!("{:.0} s", begin.elapsed().as_secs_f64()));
    }
    if let Some(folder) = &args.out {
        page::pictures(folder, &reports)?;
        let path = folder.join("verify.json");
        std::fs::write(&path, &text).map_err(crate::error::write(&path))?;
    }
    if let Some(folder) = &args.docs {
        let named: Vec<_> = chosen.iter().map(|c| (c.name, c.about)).zip(&reports).collect();
        page::write(folder, &named)?;
    }
    let failed = rows.iter().any(|r| !r.pass);
    Ok(if failed {
        ExitCode::FAILURE
    } else {
        ExitCode::SUCCESS
    })
}

fn choose(names: &[String]) -> Result<Vec<&'static Case>> {
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

/// Makes every run the cases need once, the dearest first.
fn run_scenes(cases: &[&Case], quick: bool, threads: usize, kept: Option<&Path>) -> Result<Done> {
    let mut specs: Vec<RunSpec> = Vec::new();
    for spec in cases.iter().flat_map(|c| (c.runs)(quick)) {
        if specs.iter().all(|s| s.key != spec.key) {
            specs.push(spec);
        }
    }
    specs.sort_by_key(|s| std::cmp::Reverse(s.cost));
    let records = in_parallel(&specs, threads, "runs", |s| s.run_or_recall(kept))?;
    let keys = specs.into_iter().map(|s| s.key);
    Ok(Done {
        records: keys.zip(records).collect(),
        quick,
    })
}

/// Works through a list, each item on one thread of its own; results in the order of the list.
fn in_parallel<T: Sync, R: Send>(
    items: &[T],
    threads: usize,
    what: &'static str,
    work: impl Fn(&T) -> Result<R> + Sync,
) -> Result<Vec<R>> {
    let next = AtomicUsize::new(0);
    let slots: Vec<Mutex<Option<Result<R>>>> = items.iter().map(|_| Mutex::new(None)).collect();
    let progress = Progress::over(items.len(), what);
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
                    progress.advance();
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
    crate::error::core(what)
}
