//! `arlequin sweep`: what accuracy costs in time.

mod conclude;
mod curve;
mod document;
mod page;
mod picture;
mod plan;
mod result;
mod runner;
mod say;
mod spec;

pub(crate) use document::{Arguments as DocumentArguments, document};

use crate::error::{Error, Result, key, write};
use crate::suggest::Foretold;
use arlequin_scene::output::mark;
use arlequin_scene::{Scene, Source};
use curve::Curve;
use plan::Member;
use result::{Run, Sweep};
use runner::{Outcome, Runner};
use spec::{Reference, SweepFile};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};

/// Exit code of a sweep that the user ended (128 + SIGINT).
const INTERRUPTED: u8 = 130;

/// What the command line says.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Sweep file.
    sweep: PathBuf,
    /// Output folder; finished runs in it are taken again [default: results/ and the name of the sweep]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Make all runs again.
    #[arg(long)]
    fresh: bool,
    /// Print sweep.json.
    #[arg(long)]
    json: bool,
}

/// A sweep file and its text, for error messages.
fn open(path: &Path) -> Result<(Source, SweepFile)> {
    let source = Source::read(path)?;
    let file = toml::from_str(&source.text).map_err(|e: toml::de::Error| Error::Syntax {
        message: e.message().to_owned(),
        span: e.span(),
    });
    match file {
        Ok(f) => Ok((source, f)),
        Err(e) => Err(located(&source, &e)),
    }
}

/// An error with the place in the sweep file it speaks of, in text.
fn located(source: &Source, error: &Error) -> Error {
    Error::Sweep {
        text: crate::error::render(error, Some(source)),
        input: error.is_input(),
    }
}

/// Makes a sweep.
pub(crate) fn sweep(arguments: &Arguments) -> Result<ExitCode> {
    let (source, file) = open(&arguments.sweep)?;
    let stem = arguments.sweep.file_stem().unwrap_or_default();
    let out = arguments.out.clone();
    let out = out.unwrap_or_else(|| Path::new("results").join(stem));
    let made = prepare(&source, &file).and_then(|(members, curves)| {
        mark::claim("--out", &out)?;
        let stop = crate::run::watch_interrupt()?;
        make(&file, &members, curves, &out, arguments.fresh, &stop)
    });
    let (sweep, status) = made.map_err(|e| located(&source, &e))?;
    write_all(&out, &file, &sweep)?;
    if arguments.json {
        let text = std::fs::read_to_string(out.join("sweep.json")).unwrap_or_default();
        crate::report::json(&text);
    } else {
        say::finished(&sweep, &out);
    }
    Ok(status)
}

/// Members and reference curves that are known before any run; all mistakes of the input show here.
fn prepare(source: &Source, file: &SweepFile) -> Result<(Vec<Member>, BTreeMap<String, Curve>)> {
    let members = plan::members(file, &source.folder)?;
    for m in members.iter().filter(|m| file.suggest && m.swept) {
        crate::suggest::readable(Scene::read(&m.scene)?.assign(&m.set)?.spec())
            .map_err(|e| key("suggest", format!("cannot speak of run '{}': {e}", m.label)))?;
    }
    let mut curves = BTreeMap::new();
    if let Some(Reference::Curves(tables)) = &file.reference {
        for (name, table) in tables {
            let place = format!("reference.curves.{name}");
            curves.insert(name.clone(), Curve::new(&place, table, &source.folder)?);
        }
    }
    Ok((members, curves))
}

fn make(
    file: &SweepFile,
    members: &[Member],
    mut curves: BTreeMap<String, Curve>,
    out: &Path,
    fresh: bool,
    stop: &AtomicBool,
) -> Result<(Sweep, ExitCode)> {
    let folder = out.join("runs");
    let runner = Runner::new(folder.clone(), file.repeat, file.threads, stop)?;
    let progress = say::Bar::new(members.len());
    let mut runs: Vec<Run> = members.iter().map(Run::planned).collect();
    for (k, (m, r)) in members.iter().zip(&mut runs).enumerate() {
        if stop.load(Ordering::Relaxed) {
            break;
        }
        progress.at(k, &m.label);
        let known = if fresh { None } else { runner.finished(m) };
        r.reused = known.is_some();
        let outcome = match known {
            Some(summary) => Outcome::Complete(summary),
            None => runner.run(m)?,
        };
        match outcome {
            Outcome::Complete(summary) => {
                r.take(&summary, m, file);
                if file.suggest && m.swept {
                    r.predicted = Some(foretold(&folder.join(&m.label), m, r.reused)?);
                }
            }
            Outcome::Failed(words) => {
                r.status = "failed";
                r.error = Some(words);
            }
            Outcome::Interrupted => break,
        }
    }
    drop(progress);
    if let Some(Reference::Run(_)) = &file.reference {
        // It was put first, and is missing only if it failed or was not reached.
        if runs[0].status == "complete" {
            let probes = curve::probes(&folder.join(&members[0].label).join("probes.csv"))?;
            curves = probes.into_iter().map(|(n, s)| (n, Curve::Samples(s))).collect();
            result::compare_measures(&mut runs);
        }
    }
    for r in runs.iter_mut().filter(|r| r.status == "complete") {
        let probes = curve::probes(&folder.join(&r.label).join("probes.csv"))?;
        r.compare(&probes, &curves, file);
    }
    result::mark_pareto(&mut runs);
    let interrupted = stop.load(Ordering::Relaxed);
    let failed = runs.iter().any(|r| r.status == "failed");
    let (status, code) = match (interrupted, failed) {
        (true, _) => ("interrupted", ExitCode::from(INTERRUPTED)),
        (_, true) => ("failed", ExitCode::FAILURE),
        _ => ("complete", ExitCode::SUCCESS),
    };
    Ok((gather(file, runs, status), code))
}

/// What `suggest` says of a finished run, kept beside its results: its times are those of this machine at that hour.
fn foretold(folder: &Path, m: &Member, reused: bool) -> Result<Foretold> {
    let path = folder.join("predicted.json");
    let kept = std::fs::read_to_string(&path)
        .ok()
        .filter(|_| reused)
        .and_then(|text| serde_json::from_str(&text).ok());
    if let Some(known) = kept {
        return Ok(known);
    }
    let foretold = crate::suggest::foretell(&Scene::read(&m.scene)?.assign(&m.set)?)?;
    let text = serde_json::to_string_pretty(&foretold).map_err(|e| Error::System {
        what: "writing predicted.json",
        message: e.to_string(),
    })?;
    std::fs::write(&path, text).map_err(write(&path))?;
    Ok(foretold)
}

fn gather(file: &SweepFile, runs: Vec<Run>, status: &'static str) -> Sweep {
    let reference = file.reference.as_ref().map(|r| match r {
        Reference::Run(name) => format!("run {name}"),
        Reference::Curves(c) => {
            let names: Vec<&str> = c.keys().map(String::as_str).collect();
            format!("curves of {}", names.join(", "))
        }
    });
    Sweep {
        title: file
            .title
            .clone()
            .unwrap_or_else(|| "Accuracy against time".into()),
        status,
        version: env!("CARGO_PKG_VERSION"),
        judge: file.judge.words(),
        cost: file.cost.words(),
        reference,
        repeat: file.repeat,
        axes: file.axis.keys().cloned().collect(),
        units: file
            .measure
            .iter()
            .filter(|(_, m)| !m.unit.is_empty())
            .map(|(n, m)| (n.clone(), m.unit.clone()))
            .collect(),
        floor_seconds: result::floor(&runs),
        conclusion: conclude::words(&runs, file),
        runs,
    }
}

/// Writes `sweep.json`, `sweep.csv`, the pictures and the report.
fn write_all(out: &Path, file: &SweepFile, sweep: &Sweep) -> Result<()> {
    let text = serde_json::to_string_pretty(sweep).map_err(|e| Error::System {
        what: "writing sweep.json",
        message: e.to_string(),
    })?;
    let path = out.join("sweep.json");
    std::fs::write(&path, text).map_err(write(&path))?;
    result::csv(&out.join("sweep.csv"), sweep)?;
    let plots = pictures(file, sweep)?;
    let folder = out.join("plots");
    std::fs::create_dir_all(&folder).map_err(write(&folder))?;
    for (name, svg) in &plots {
        let path = folder.join(format!("{name}.svg"));
        std::fs::write(&path, svg).map_err(write(&path))?;
    }
    let page = page::page(sweep, &plots);
    let path = out.join("report.html");
    std::fs::write(&path, page).map_err(write(&path))
}

/// Pictures by name.
fn pictures(file: &SweepFile, sweep: &Sweep) -> Result<Vec<(String, String)>> {
    let mut out = Vec::new();
    for shown in [picture::Shown::Displacement, picture::Shown::Velocity] {
        if let Some(svg) = picture::work_precision(sweep, shown)? {
            out.push((format!("work-precision-{}", shown.name()), svg));
        }
    }
    if let Some(h) = &file.hook
        && let Some(svg) = picture::hook(sweep, h)?
    {
        out.push(("hook".to_owned(), svg));
    }
    Ok(out)
}

/// Reads a finished sweep again, without running anything.
fn reopen(path: &Path, out: &Path) -> Result<(SweepFile, Sweep)> {
    let (source, file) = open(path)?;
    let (members, curves) = prepare(&source, &file).map_err(|e| located(&source, &e))?;
    let never = AtomicBool::new(false);
    let folder = out.join("runs");
    let runner = Runner::new(folder, file.repeat, file.threads, &never)?;
    if let Some(m) = members.iter().find(|m| runner.finished(m).is_none()) {
        let rule = format!(
            "run '{}' is not finished; run 'arlequin sweep {} --out {}' first",
            m.label,
            path.display(),
            out.display()
        );
        return Err(key(out.display().to_string(), rule));
    }
    let (sweep, _) = make(&file, &members, curves, out, false, &never)?;
    Ok((file, sweep))
}
