//! `arlequin verify --hard`: the hard cases, what naive code does with them, whether we keep our promises.

use super::{Args, in_parallel};
use crate::error::{Error, Result, unknown};
use crate::report;
use arlequin_studies::hard::{Figure, HardCase, Outcome, cases};
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::process::ExitCode;

/// What a case measured, or why it could not.
type Measured = std::result::Result<Outcome, String>;

/// Runs the hard cases: those named, all, or with `--quick` the fast ones.
pub(super) fn run(args: &Args, threads: usize) -> Result<ExitCode> {
    let chosen = choose(args)?;
    if args.list {
        for case in &chosen {
            report::line(&format!("{}: {}", case.name, case.promise));
        }
        return Ok(ExitCode::SUCCESS);
    }
    let measured = in_parallel(&chosen, threads, "hard cases", |case| {
        Ok((case.run)().map_err(|e| e.to_string()))
    })?;
    let passed = |m: &Measured| m.as_ref().is_ok_and(Outcome::pass);
    if args.json {
        let all: Vec<Value> = chosen.iter().zip(&measured).map(|(c, m)| as_json(c, m)).collect();
        let text = serde_json::to_string_pretty(&all).map_err(|e| Error::System {
            what: "writing the hard cases",
            message: e.to_string(),
        })?;
        report::json(&text);
    } else {
        for (case, m) in chosen.iter().zip(&measured) {
            report::text(&as_text(case, m));
        }
        let kept = measured.iter().filter(|m| passed(m)).count();
        report::line(&format!("{kept} of {} promises kept", chosen.len()));
    }
    Ok(if measured.iter().all(passed) {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    })
}

fn choose(args: &Args) -> Result<Vec<HardCase>> {
    let all = cases();
    for name in &args.cases {
        if all.iter().all(|c| c.name != name) {
            let known: Vec<String> = all.iter().map(|c| c.name.to_owned()).collect();
            return Err(unknown("verify --hard", name, "hard case", known.iter()));
        }
    }
    let wanted = |c: &HardCase| args.cases.is_empty() || args.cases.iter().any(|n| n == c.name);
    let cheap = |c: &HardCase| c.fast || !args.quick;
    Ok(all.into_iter().filter(|c| wanted(c) && cheap(c)).collect())
}

fn as_text(case: &HardCase, measured: &Measured) -> String {
    let mut out = format!(
        "{}\n  hard: {}\n  promise: {}\n",
        case.name, case.why, case.promise
    );
    let outcome = match measured {
        Ok(o) => o,
        Err(e) => return out + &format!("  FAILED: {e}\n"),
    };
    let mut add = |title: &str, figures: &[Figure]| {
        let _ = writeln!(out, "  {title}");
        for f in figures {
            let mark = if f.holds() { "" } else { "  OUT OF RANGE" };
            let _ = writeln!(out, "    {:.3e}  {}{mark}", f.value, f.what);
        }
    };
    add(&format!("naive: {}", case.naive), &outcome.naive);
    add("ours:", &outcome.ours);
    out
}

fn as_json(case: &HardCase, measured: &Measured) -> Value {
    // JSON knows no infinity: such values are words.
    let number = |x: f64| {
        if x.is_finite() {
            json!(x)
        } else {
            json!(x.to_string())
        }
    };
    let figures = |all: &[Figure]| -> Vec<Value> {
        let one = |f: &Figure| json!({"what": f.what, "value": number(f.value), "range": f.range.map(number), "pass": f.holds()});
        all.iter().map(one).collect()
    };
    let mut out = json!({"name": case.name, "why": case.why, "naive": case.naive, "promise": case.promise});
    match measured {
        Ok(o) => {
            out["pass"] = json!(o.pass());
            out["naive_figures"] = json!(figures(&o.naive));
            out["our_figures"] = json!(figures(&o.ours));
        }
        Err(e) => {
            out["pass"] = json!(false);
            out["error"] = json!(e);
        }
    }
    out
}
