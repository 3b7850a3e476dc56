//! Report of the hard cases: results of naive code, and whether our promises hold.

use super::split;
use arlequin_studies::checks::{Accept, Check};
use arlequin_studies::hard::{HardCase, Outcome};
use serde_json::{Value, json};
use std::fmt::Write as _;

/// Figures of a case, or the error that ended it.
pub(crate) type Measured = Result<Outcome, String>;

/// Returns the report on a case as text.
pub(crate) fn text(case: &HardCase, measured: &Measured) -> String {
    let wrapped = |text: &str| split(text, 110).join("\n    ");
    let (why, promise) = (wrapped(case.why), wrapped(case.promise));
    let mut out = format!("{}\n  hard: {why}\n  promise: {promise}\n", case.name);
    let outcome = match measured {
        Ok(o) => o,
        Err(e) => return out + &format!("  FAILED: {e}\n"),
    };
    let mut add = |title: &str, figures: &[Check]| {
        let _ = writeln!(out, "  {title}");
        for f in figures {
            let mark = if f.pass { "" } else { "  OUT OF RANGE" };
            let _ = writeln!(out, "    {:.3e}  {}{mark}", f.ours, f.quantity);
        }
    };
    add(&format!("naive: {}", wrapped(case.naive)), &outcome.naive);
    add("ours:", &outcome.ours);
    out
}

/// Returns the report on a case as JSON.
pub(crate) fn json(case: &HardCase, measured: &Measured) -> Value {
    // JSON has no infinity, so such values are written as text.
    let number = |x: f64| {
        if x.is_finite() {
            json!(x)
        } else {
            json!(x.to_string())
        }
    };
    let figures = |checks: &[Check]| -> Vec<Value> {
        let figure = |f: &Check| json!({"what": f.quantity, "value": number(f.ours), "range": range(f.accept).map(number), "pass": f.pass});
        checks.iter().map(figure).collect()
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

/// Returns the smallest and the largest accepted value.
fn range(accept: Accept) -> [f64; 2] {
    match accept {
        Accept::Between(low, high) => [low, high],
        Accept::AtLeast(low) => [low, f64::INFINITY],
        Accept::AtMost(high) => [-high, high],
        Accept::Absolute(_) | Accept::Relative(_) => [f64::NAN; 2],
    }
}
