//! `arlequin verify`: options and choice of cases.

use crate::error::{Result, unknown, write};
use crate::report::{self, Progress};
use crate::threads;
use arlequin_scene::output::mark;
use arlequin_studies::checks::{self, CASES, Case, Check, FRACTURE, Options};
use arlequin_studies::hard::{HardCase, Outcome, cases};
use std::path::PathBuf;
use std::process::ExitCode;

/// Compare with the literature.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Cases to run [default: all]
    cases: Vec<String>,
    /// Run the hard cases instead: results of naive code, and whether our promises hold.
    #[arg(long, conflicts_with_all = ["out", "docs", "resume"])]
    hard: bool,
    /// Run the benchmarks of fracture instead, which take minutes.
    #[arg(long, conflicts_with_all = ["hard", "docs", "resume"])]
    fracture: bool,
    /// Print the rows as JSON.
    #[arg(long)]
    json: bool,
    /// List the cases and exit.
    #[arg(long)]
    list: bool,
    /// Only cheap cases and cheap variants, in less than a minute.
    #[arg(long)]
    quick: bool,
    /// Write the plots and verify.json to this folder.
    #[arg(long, value_name = "DIR", conflicts_with = "docs")]
    out: Option<PathBuf>,
    /// Write validation.md and its plots to this documentation folder.
    #[arg(long, value_name = "DIR")]
    docs: Option<PathBuf>,
    /// Store the runs of the beams in this folder, and use those that are already stored there.
    #[arg(long, value_name = "DIR")]
    resume: Option<PathBuf>,
    /// Number of cases run at the same time, each on one thread [default: one per core]
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
}

/// Runs the command.
pub(crate) fn verify(args: &Args) -> Result<ExitCode> {
    let pool = threads::start(None)?;
    let threads = match args.threads {
        None => pool,
        wanted => threads::bounded(wanted)?,
    };
    let progress = Progress::default();
    if args.hard {
        return hard(args, threads, &progress);
    }
    let cases: &'static [Case] = if args.fracture { &FRACTURE } else { &CASES };
    if args.list {
        for case in cases {
            report::line(&format!("{:<14} {}", case.name, case.about));
        }
        return Ok(ExitCode::SUCCESS);
    }
    let chosen = checks::choose(cases, &args.cases)?;
    if let Some(folder) = &args.out {
        mark::claim("--out", folder)?;
    }
    if let Some(folder) = &args.docs {
        mark::generated("--docs", &folder.join("validation.md"), report::verify::HEAD)?;
    }
    let begin = std::time::Instant::now();
    let options = Options {
        quick: args.quick,
        threads,
        kept: args.resume.as_deref(),
    };
    let reports = checks::run(&chosen, &options, &progress.reporter())?;
    drop(progress);
    let mut rows: Vec<Check> = reports.iter().flat_map(|r| r.checks.clone()).collect();
    // Unlisted checks are shown only if they fail.
    rows.retain(|c| c.listed || !c.pass);
    report::result(&rows, args.json, |rows| {
        report::text(&report::verify::table(rows));
        report::line(&format!("{:.0} s", begin.elapsed().as_secs_f64()));
    })?;
    if let Some(folder) = &args.out {
        report::verify::pictures(folder, &reports)?;
        let path = folder.join("verify.json");
        std::fs::write(&path, report::pretty(&rows)?).map_err(write(&path))?;
    }
    if let Some(folder) = &args.docs {
        report::verify::page(folder, &chosen, &reports)?;
    }
    Ok(code(rows.iter().all(|r| r.pass)))
}

fn code(passed: bool) -> ExitCode {
    if passed {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    }
}

/// Runs the hard cases: the named ones, otherwise all, with `--quick` only the fast ones.
fn hard(args: &Args, threads: usize, progress: &Progress) -> Result<ExitCode> {
    let chosen = chosen_hard(args)?;
    if args.list {
        for case in &chosen {
            report::line(&format!("{}: {}", case.name, case.promise));
        }
        return Ok(ExitCode::SUCCESS);
    }
    let measured = checks::in_parallel(&chosen, threads, "hard cases", &progress.reporter(), |case| {
        Ok((case.run)().map_err(|e| e.to_string()))
    })?;
    progress.clear();
    let passed = measured
        .iter()
        .filter(|m| m.as_ref().is_ok_and(Outcome::pass))
        .count();
    let pairs = || chosen.iter().zip(&measured);
    if args.json {
        let pairs: Vec<_> = pairs().map(|(c, m)| report::hard::json(c, m)).collect();
        report::line(&report::pretty(&pairs)?);
    } else {
        pairs().for_each(|(c, m)| report::text(&report::hard::text(c, m)));
        report::line(&format!("{passed} of {} promises kept", chosen.len()));
    }
    Ok(code(passed == chosen.len()))
}

/// Returns the hard cases that the arguments select.
fn chosen_hard(args: &Args) -> Result<Vec<HardCase>> {
    let hard_cases = cases();
    for name in &args.cases {
        if hard_cases.iter().all(|c| c.name != name) {
            let known: Vec<String> = hard_cases.iter().map(|c| c.name.to_owned()).collect();
            return Err(unknown("verify --hard", name, "hard case", known.iter()));
        }
    }
    let wanted = |c: &HardCase| args.cases.is_empty() || args.cases.iter().any(|n| n == c.name);
    let cheap = |c: &HardCase| c.fast || !args.quick;
    Ok(hard_cases.into_iter().filter(|c| wanted(c) && cheap(c)).collect())
}
