//! The hard cases: what naive code does with them, whether we keep our promises.

use arlequin_studies::hard::{Figure, HardCase, Outcome};
use serde_json::{Value, json};
use std::fmt::Write as _;

/// What a case measured, or why it could not.
pub(crate) type Measured = Result<Outcome, String>;

/// A case in words.
pub(crate) fn text(case: &HardCase, measured: &Measured) -> String {
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

/// The same as JSON.
pub(crate) fn json(case: &HardCase, measured: &Measured) -> Value {
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
