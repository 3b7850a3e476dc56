//! Text output of a sweep, and the files it writes.

use super::{sweep_page, work_precision};
use crate::error::{Result, write};
use arlequin_scene::sweep::conclude::{percent, seconds};
use arlequin_scene::sweep::{Mark, PHASES, Sweep, SweepFile};
use std::path::Path;

/// Prints a finished or interrupted sweep.
pub(crate) fn finished(s: &Sweep, out: &Path) {
    print_line!("sweep      {}", s.title);
    for r in &s.runs {
        let time = |x: Option<f64>| x.map_or_else(|| "-".into(), seconds);
        let error = |x: Option<f64>| x.map_or_else(|| "-".into(), percent);
        let mark = if r.pareto { "*" } else { " " };
        match r.status {
            "complete" => print_line!(
                "{mark} {:<44} {:>8} unknowns, total {:>8}, steps {:>8}, error u {:>8}, v {:>8}",
                r.label,
                r.unknowns.unwrap_or_default(),
                time(r.seconds.total),
                time(r.seconds.stepping),
                error(r.errors.displacement),
                error(r.errors.velocity),
            ),
            status => print_line!(
                "{mark} {:<44} {status} {}",
                r.label,
                r.error.as_deref().unwrap_or("")
            ),
        }
    }
    let reused = s.runs.iter().filter(|r| r.reused).count();
    let fresh = s
        .runs
        .iter()
        .filter(|r| r.status == "complete" && !r.reused)
        .count();
    print_line!("runs       {fresh} made, {reused} taken from before, * on the Pareto front");
    for line in &s.conclusion {
        print_line!("           {line}");
    }
    if s.status == "interrupted" {
        print_line!("interrupted: the same command goes on with what is missing");
    }
    print_line!("results    {}", out.join("report.html").display());
}

/// Writes `sweep.json`, `sweep.csv`, the pictures and the report. Returns the text of `sweep.json`.
pub(crate) fn write_all(out: &Path, file: &SweepFile, sweep: &Sweep) -> Result<String> {
    let put = |name: &str, text: &str| {
        let path = out.join(name);
        std::fs::write(&path, text).map_err(write(&path))
    };
    let json = sweep.write(out)?;
    csv(&out.join("sweep.csv"), sweep)?;
    let plots = work_precision::pictures(file, sweep, work_precision::Screen::Wide)?;
    let narrow = work_precision::pictures(file, sweep, work_precision::Screen::Narrow)?;
    let folder = out.join("plots");
    std::fs::create_dir_all(&folder).map_err(write(&folder))?;
    for (name, svg) in &plots {
        put(&format!("plots/{name}.svg"), svg)?;
    }
    put("report.html", &sweep_page::page(sweep, &plots, &narrow))?;
    Ok(json)
}

/// Writes `sweep.csv`, one row per run.
fn csv(path: &Path, s: &Sweep) -> Result<()> {
    let mut parameters: Vec<&String> = s.runs.iter().flat_map(|r| r.parameters.keys()).collect();
    parameters.sort();
    parameters.dedup();
    let back: Vec<&String> = s
        .runs
        .iter()
        .find(|r| !r.reflected_energy.is_empty())
        .map(|r| r.reflected_energy.keys().collect())
        .unwrap_or_default();
    let mut head: Vec<String> = ["label", "mark", "status"].map(str::to_owned).into();
    head.extend(parameters.iter().map(|p| format!("parameter {p}")));
    let fixed = [
        "unknowns",
        "steps",
        "dt [s]",
        "total [s]",
        "set-up [s]",
        "stepping [s]",
        "output [s]",
    ];
    head.extend(fixed.map(str::to_owned));
    head.extend(PHASES.map(|p| format!("{p} per step [s]")));
    let fixed = ["peak [bytes]", "displacement error [-]", "velocity error [-]"];
    head.extend(fixed.map(str::to_owned));
    head.extend(back.iter().map(|b| format!("reflected energy {b} [-]")));
    let scalars: Vec<&String> = s
        .runs
        .first()
        .map_or_else(Vec::new, |r| r.measures.keys().collect());
    let units = |m: &&String| s.units.get(*m).map_or("-", String::as_str);
    head.extend(scalars.iter().map(|m| format!("{m} [{}]", units(m))));
    let predicted = s.runs.iter().any(|r| r.predicted.is_some());
    let fixed = [
        "predicted displacement error [-]",
        "predicted velocity error [-]",
        "predicted time [s]",
    ];
    head.extend(fixed.iter().filter(|_| predicted).map(|f| (*f).to_owned()));
    head.extend(["H drift [-]", "condition [-]", "pareto"].map(str::to_owned));
    let number = |x: Option<f64>| x.map(|x| format!("{x:e}")).unwrap_or_default();
    let count = |x: Option<u64>| x.map(|x| x.to_string()).unwrap_or_default();
    let mut text = head.join(",") + "\n";
    for r in &s.runs {
        let mark = match r.mark {
            Some(Mark::AllFine) => "all-fine",
            Some(Mark::AllCoarse) => "all-coarse",
            None => "",
        };
        let mut row = vec![quoted(&r.label), mark.into(), r.status.into()];
        let cell = |p: &&String| quoted(r.parameters.get(*p).map_or("", String::as_str));
        row.extend(parameters.iter().map(cell));
        row.extend([count(r.unknowns), count(r.steps), number(r.dt)]);
        let w = &r.seconds;
        row.extend([w.total, w.setup, w.stepping, w.output].map(number));
        row.extend(PHASES.map(|p| number(r.seconds.per_step.get(p).copied())));
        row.extend([
            count(r.peak_bytes),
            number(r.errors.displacement),
            number(r.errors.velocity),
        ]);
        row.extend(back.iter().map(|b| number(r.reflected_energy.get(*b).copied())));
        let scalar = |m: &&String| number(r.measures.get(*m).and_then(|m| m.value));
        row.extend(scalars.iter().map(scalar));
        if predicted {
            let p = r.predicted;
            row.extend(
                [
                    p.map(|p| p.displacement),
                    p.map(|p| p.velocity),
                    p.map(|p| p.seconds),
                ]
                .map(number),
            );
        }
        row.extend([number(r.h_drift), number(r.condition), r.pareto.to_string()]);
        text += &(row.join(",") + "\n");
    }
    std::fs::write(path, text).map_err(write(path))
}

/// Quotes a cell of a CSV file if it contains commas or quotes.
fn quoted(text: &str) -> String {
    if text.contains([',', '"']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
    }
}
