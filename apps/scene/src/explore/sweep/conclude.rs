//! Conclusions of a sweep: in plain sentences, and as a table of how much each axis matters.

use super::result::Run;
use crate::spec::sweep::{Mark, SweepFile};
use std::collections::BTreeMap;

/// Effect of one axis on error and cost while all others stay.
#[derive(Debug, Clone, PartialEq)]
pub struct Knob {
    /// Name of the axis.
    pub axis: String,
    /// Largest over smallest error; geometric mean over all groups of runs that differ in this axis only.
    pub error_ratio: f64,
    /// Largest over smallest time; mean as for the error.
    pub cost_ratio: f64,
    /// Value with the smallest error in most groups.
    pub best: String,
}

/// Returns the effect of each axis, the one with the largest effect on the error first.
pub fn knobs(runs: &[Run]) -> Vec<Knob> {
    let swept: Vec<&Run> = runs.iter().filter(|r| r.swept && r.point().is_some()).collect();
    let mut axes: Vec<&String> = swept.iter().flat_map(|r| r.parameters.keys()).collect();
    axes.sort();
    axes.dedup();
    let mut out: Vec<Knob> = axes.into_iter().filter_map(|a| knob(a, &swept)).collect();
    out.sort_by(|a, b| b.error_ratio.total_cmp(&a.error_ratio));
    out
}

fn knob(axis: &str, runs: &[&Run]) -> Option<Knob> {
    let mut groups: BTreeMap<Vec<(&String, &String)>, Vec<&Run>> = BTreeMap::new();
    for r in runs {
        let other_values = r.parameters.iter().filter(|(n, _)| *n != axis).collect();
        groups.entry(other_values).or_default().push(r);
    }
    let (mut sums, mut count) = ([0.0; 2], 0.0);
    let mut wins: BTreeMap<&String, usize> = BTreeMap::new();
    for g in groups.values().filter(|g| g.len() > 1) {
        let spread = |k: usize| {
            let v = || g.iter().filter_map(|r| r.point()).map(|p| p[k]);
            (v().fold(0.0, f64::max) / v().fold(f64::INFINITY, f64::min)).ln()
        };
        // An error of zero, such as that of the reference, has no ratio.
        if !(spread(0).is_finite() && spread(1).is_finite()) {
            continue;
        }
        // Sums of logarithms give geometric means. A point is [cost, error], the sums are [error, cost].
        sums = [sums[0] + spread(1), sums[1] + spread(0)];
        count += 1.0;
        let best = g.iter().min_by(|a, b| error(a).total_cmp(&error(b)));
        if let Some(v) = best.and_then(|r| r.parameters.get(axis)) {
            *wins.entry(v).or_default() += 1;
        }
    }
    let best = wins.iter().max_by_key(|w| w.1)?.0;
    Some(Knob {
        axis: axis.to_owned(),
        error_ratio: (sums[0] / count).exp(),
        cost_ratio: (sums[1] / count).exp(),
        best: (*best).clone(),
    })
}

fn error(r: &Run) -> f64 {
    r.error_judged.unwrap_or(f64::INFINITY)
}

fn cost(r: &Run) -> f64 {
    r.cost.unwrap_or(f64::INFINITY)
}

fn coupled(r: &&Run) -> bool {
    r.mark.is_none() && r.point().is_some()
}

/// Returns the cheapest of some runs whose error is at most `target`.
fn cheapest<'a>(runs: impl Iterator<Item = &'a Run>, target: f64) -> Option<&'a Run> {
    runs.filter(|r| error(r) <= target)
        .min_by(|a, b| cost(a).total_cmp(&cost(b)))
}

/// Returns the conclusion in plain sentences, one or two per target.
pub fn words(runs: &[Run], file: &SweepFile) -> Vec<String> {
    let mut out = Vec::new();
    let failed = runs.iter().filter(|r| r.status == "failed").count();
    let missing = runs.iter().filter(|r| r.status == "missing").count();
    if failed > 0 {
        out.push(format!("{failed} of {} runs failed; see the table.", runs.len()));
    }
    if missing > 0 {
        out.push(format!(
            "{missing} of {} runs are still to be made; run the sweep again.",
            runs.len()
        ));
    }
    out.extend(where_coupling_pays(runs));
    if runs.iter().filter(coupled).count() == 0 {
        let why = if file.reference.is_none() {
            "No errors: the sweep file names no [reference]."
        } else {
            "No errors: no varied run could be compared with the reference."
        };
        out.push(why.into());
        return out;
    }
    let mut targets = file.targets.clone();
    targets.sort_by(|a, b| b.total_cmp(a));
    for (k, t) in targets.iter().enumerate() {
        out.push(target(runs, *t, targets.get(k + 1).copied()));
    }
    out.extend(scatter(runs));
    out.extend(file.measure.keys().map(|m| scalar(runs, m)));
    out
}

/// States for which errors a coupled run is cheaper than either model alone; `None` if no model was run
/// alone.
fn where_coupling_pays(runs: &[Run]) -> Option<String> {
    let alone = |mark: Mark| {
        runs.iter()
            .filter(move |r| r.mark == Some(mark) && r.cost.is_some())
    };
    let fine = |e: f64| cheapest(alone(Mark::AllFine), e).map_or(f64::INFINITY, cost);
    let coarse = |e: f64| cheapest(alone(Mark::AllCoarse), e).map_or(f64::INFINITY, cost);
    let coupled_at = |e: f64| cheapest(runs.iter().filter(coupled), e).map_or(f64::INFINITY, cost);
    alone(Mark::AllFine).chain(alone(Mark::AllCoarse)).next()?;
    // Which run is cheapest can change only at an error that some run has.
    let mut errors: Vec<f64> = runs.iter().filter(|r| r.point().is_some()).map(error).collect();
    errors.sort_by(f64::total_cmp);
    let wins = |e: &f64| coupled_at(*e) < fine(*e).min(coarse(*e));
    let Some(first) = errors.iter().position(wins) else {
        return Some(
            "Coupling pays nowhere in this sweep: for every error, one model alone is cheaper. It pays where the fine model is \
             wanted for what it does beyond these errors, such as fracture."
                .into(),
        );
    };
    let ends = errors[first..]
        .iter()
        .position(|e| !wins(e))
        .map(|k| errors[first + k]);
    let won: Vec<f64> = errors[first..].iter().take_while(|e| wins(e)).copied().collect();
    let gain = won.iter().map(|e| fine(*e) / coupled_at(*e)).fold(0.0, f64::max);
    let from = percent(errors[first]);
    let span = ends.map_or_else(
        || format!("of {from} and more"),
        |e| format!("from {from} to {}", percent(e)),
    );
    let gain = match gain {
        g if g.is_finite() && g > 1.0 => format!(", up to {g:.1} times cheaper than the fine model alone"),
        _ => String::new(),
    };
    let beyond = ends.map_or("", |_| "; beyond, one model alone is cheaper");
    Some(format!("Coupling pays for errors {span}{gain}{beyond}."))
}

/// States how much all-fine runs differ from the reference, if there are any besides it.
fn scatter(runs: &[Run]) -> Option<String> {
    let fine_runs: Vec<&Run> = runs.iter().filter(|r| other_fine(r)).collect();
    let range = range(fine_runs.iter().filter_map(|r| r.error_judged), percent)?;
    let labels: Vec<&str> = fine_runs.iter().map(|r| r.label.as_str()).collect();
    Some(format!(
        "All-fine runs differ among themselves: {} from the reference ({}). What a coupled run has less than that is not owed to its coupling.",
        range,
        labels.join(", ")
    ))
}

/// Returns whether this is an all-fine run other than the reference.
fn other_fine(r: &Run) -> bool {
    // The reference has no error against itself.
    r.mark == Some(Mark::AllFine) && r.error_judged.is_some_and(|e| e > 0.0)
}

/// Returns smallest and largest value in words; `None` without values.
fn range(values: impl Iterator<Item = f64>, words: impl Fn(f64) -> String) -> Option<String> {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| {
        (a.min(x), b.max(x))
    });
    let (a, b) = (words(low), words(high));
    (low <= high).then(|| if a == b { a } else { format!("{a} to {b}") })
}

/// Formats a deviation with its sign.
pub fn signed(x: f64) -> String {
    let sign = if x < 0.0 { "−" } else { "+" };
    format!("{sign}{}", percent(x.abs()))
}

/// States the deviations of a scalar in coupled, all-fine and all-coarse runs from the reference.
fn scalar(runs: &[Run], name: &str) -> String {
    let deviations = |keep: &dyn Fn(&Run) -> bool| {
        let complete = || runs.iter().filter(|r| r.status == "complete" && keep(r));
        let values = complete().filter_map(|r| r.measures.get(name)?.deviation);
        let (some, span) = (complete().next().is_some(), range(values, signed));
        span.or(some.then(|| "none at all".to_owned()))
    };
    let groups = [
        ("coupled runs", deviations(&|r| r.mark.is_none())),
        ("other all-fine runs", deviations(&other_fine)),
        (
            "all-coarse runs",
            deviations(&|r| r.mark == Some(Mark::AllCoarse)),
        ),
    ];
    let parts: Vec<String> = groups
        .into_iter()
        .filter_map(|(who, what)| Some(format!("{who} {}", what?)))
        .collect();
    format!("{name}, against the reference: {}.", parts.join("; "))
}

fn target(runs: &[Run], target: f64, next: Option<f64>) -> String {
    let percent = percent(target);
    let marked = |m: Mark| runs.iter().filter(move |r| r.mark == Some(m));
    let Some(best) = cheapest(runs.iter().filter(coupled), target) else {
        let nearest = runs
            .iter()
            .filter(coupled)
            .min_by(|a, b| error(a).total_cmp(&error(b)));
        return nearest.map_or_else(String::new, |r| {
            format!(
                "Within {percent}: no coupled run; the most accurate is {} with {} in {}.",
                r.label,
                self::percent(error(r)),
                seconds(cost(r))
            )
        });
    };
    let mut text = format!(
        "Within {percent}: {} ({}), {}",
        best.label,
        self::percent(error(best)),
        seconds(cost(best))
    );
    match cheapest(marked(Mark::AllFine), target) {
        Some(f) => {
            text += &format!(
                ", {} than all-fine at that error ({}, {})",
                times(cost(f) / cost(best)),
                f.label,
                seconds(cost(f))
            );
        }
        None if marked(Mark::AllFine).next().is_some() => {
            text += ", an error no all-fine run of this sweep stays within";
        }
        None => {}
    }
    if let Some(n) = next {
        match cheapest(runs.iter().filter(coupled), n) {
            // Costs within half a per cent count as equal.
            Some(r) if cost(r) > 1.005 * cost(best) => {
                text += &format!(
                    "; going to {} costs {:.2} times more",
                    self::percent(n),
                    cost(r) / cost(best)
                );
            }
            Some(_) => text += &format!("; it stays within {} too", self::percent(n)),
            None => text += &format!("; no coupled run goes to {}", self::percent(n)),
        }
    }
    text.push('.');
    match cheapest(marked(Mark::AllCoarse), target) {
        Some(c) if cost(c) < cost(best) => {
            text += &format!(
                " The coarse model alone is that accurate in {} ({}), {}: here coupling pays only if the fine model \
                 is wanted for what it does beyond linear elasticity.",
                seconds(cost(c)),
                c.label,
                times(cost(best) / cost(c)),
            );
        }
        Some(c) => {
            text += &format!(
                " The coarse model alone needs {} for it ({}).",
                seconds(cost(c)),
                c.label
            );
        }
        None if marked(Mark::AllCoarse).next().is_some() => {
            text += " The coarse model alone does not come that close in this sweep.";
        }
        None => {}
    }
    text
}

/// Formats a ratio of costs as a comparison.
fn times(ratio: f64) -> String {
    if ratio >= 1.0 {
        format!("{ratio:.1} times cheaper")
    } else {
        format!("{:.1} times dearer", 1.0 / ratio)
    }
}

/// Formats an error with two digits.
pub fn percent(x: f64) -> String {
    let p = 100.0 * x;
    match p {
        p if p <= 0.0 => "0 %".into(),
        p if p < 1e-3 => format!("{p:.1e} %"),
        p => {
            let digits = (1 - p.log10().floor() as i32).clamp(0, 6) as usize;
            format!("{p:.digits$} %")
        }
    }
}

/// Formats a time with three digits.
pub fn seconds(x: f64) -> String {
    let (factor, unit) = match x {
        x if x >= 0.1 => (1.0, "s"),
        x if x >= 1e-4 => (1e3, "ms"),
        _ => (1e6, "µs"),
    };
    let v = x * factor;
    let digits = if v > 0.0 {
        (2 - v.log10().floor() as i32).clamp(0, 3) as usize
    } else {
        0
    };
    format!("{v:.digits$} {unit}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(label: &str, mark: Option<Mark>, cost: f64, error: f64) -> Run {
        let (axis, value) = label.split_once('=').unwrap_or(("run", label));
        Run {
            label: label.into(),
            mark,
            swept: mark.is_none(),
            status: "complete",
            parameters: [(axis.to_owned(), value.to_owned())].into(),
            cost: Some(cost),
            error_judged: Some(error),
            ..Run::default()
        }
    }

    #[test]
    fn the_conclusion_names_setting_time_and_ratios() {
        let mut runs = vec![
            run("all-fine", Some(Mark::AllFine), 12.0, 0.0),
            run("all-coarse", Some(Mark::AllCoarse), 0.5, 0.015),
            run("h=1", None, 3.0, 0.005),
            run("h=2", None, 1.5, 0.018),
            run("h=4", None, 2.0, 0.08),
        ];
        let file: SweepFile =
            toml::from_str("scene = 's.toml'\ntargets = [0.01, 0.02]").unwrap_or_else(|e| panic!("{e}"));
        let text = words(&runs, &file);
        // From the coupled run of 0.5 % to the coarse one of 1.5 %.
        assert_eq!(
            text[0],
            "Coupling pays for errors from 0.50 % to 1.5 %, up to 4.0 times cheaper than the fine model alone; beyond, one model \
             alone is cheaper."
        );
        assert_eq!(
            text[1],
            "Within 2.0 %: h=2 (1.8 %), 1.50 s, 8.0 times cheaper than all-fine at that error (all-fine, 12.0 s); going to \
             1.0 % costs 2.00 times more. The coarse model alone is that accurate in 0.500 s (all-coarse), 3.0 times \
             cheaper: here coupling pays only if the fine model is wanted for what it does beyond linear elasticity."
        );
        assert!(
            text[2].ends_with("does not come that close in this sweep."),
            "{}",
            text[2]
        );
        let dear = [
            run("all-fine", Some(Mark::AllFine), 1.0, 0.001),
            run("h=1", None, 2.0, 0.01),
        ];
        assert!(words(&dear, &file)[0].starts_with("Coupling pays nowhere in this sweep"));
        super::super::result::mark_pareto(&mut runs);
        let front: Vec<&str> = runs
            .iter()
            .filter(|r| r.pareto)
            .map(|r| r.label.as_str())
            .collect();
        // The reference has no error of its own; h = 4 is beaten by h = 2.
        assert_eq!(front, ["all-coarse", "h=1"]);
        let k = knobs(&runs);
        assert_eq!((k.len(), k[0].best.as_str()), (1, "1"));
        assert!((k[0].error_ratio - 16.0).abs() < 1e-9 && (k[0].cost_ratio - 2.0).abs() < 1e-9);
    }

    #[test]
    fn numbers_keep_their_digits() {
        assert_eq!(
            [percent(0.0234), percent(0.5), percent(1.2e-4)],
            ["2.3 %", "50 %", "0.012 %"]
        );
        assert_eq!(
            [seconds(12.345), seconds(0.0123), seconds(2e-5)],
            ["12.3 s", "12.3 ms", "20.0 µs"]
        );
    }
}
