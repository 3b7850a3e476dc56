//! The report: one page that needs nothing else, neither scripts nor addresses.

use super::work_precision as picture;
use arlequin_scene::sweep::conclude::{self, percent, seconds, signed};
use arlequin_scene::sweep::{Measured, PHASES, Run, Sweep};
use std::fmt::Write as _;

const STYLE: &str = "body{font:16px/1.5 sans-serif;max-width:1120px;margin:2em auto;padding:0 1em;color:#222}\
h1{font-size:1.6em;line-height:1.25}h2{font-size:1.2em;margin-top:2em}figure{margin:1.5em 0}\
figcaption{color:#555;font-size:14px}svg{display:block;width:100%;min-width:640px;max-width:1060px;height:auto}\
.wide{overflow-x:auto}table{border-collapse:collapse;font-size:13px}th{white-space:normal;vertical-align:bottom;min-width:4.5em}\
th,td{padding:.3em .6em;border-bottom:1px solid #ddd;text-align:right}td{white-space:nowrap}\
th:first-child,td:first-child{text-align:left;position:sticky;left:0;background:#fff}\
tr.front td,tr.front td:first-child{background:#e8f2fa}tr.failed td,tr.failed td:first-child{background:#fbe9e0}\
td.words{text-align:left;white-space:normal;min-width:30em}ul{padding-left:1.4em}li{margin:.4em 0}\
.note{color:#555;font-size:14px}";

/// Text of an element.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
}

/// The whole page; pictures by name.
pub(crate) fn page(s: &Sweep, pictures: &[(String, String)]) -> String {
    let mut out = String::new();
    let title = escaped(&s.title);
    out += "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n";
    // Without it a phone shows the page as wide as a desktop's, in letters too small to read.
    out += "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n";
    // An empty icon keeps browsers from asking the server for one.
    out += "<link rel=\"icon\" href=\"data:,\"/>\n";
    let _ = writeln!(
        out,
        "<title>{title}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<h1>{title}</h1>"
    );
    out += "<h2>Conclusion</h2>\n<ul>\n";
    for line in &s.conclusion {
        let _ = writeln!(out, "<li>{}</li>", escaped(line));
    }
    out += "</ul>\n";
    let _ = writeln!(
        out,
        "<p class=\"note\">What decides: the {}, relative L2 over the time of all probes, against {}; the time of {}, \
         the least of {} runs, one after another on the same machine. Times of another machine differ, ratios less so.</p>",
        s.judge,
        escaped(s.reference.as_deref().unwrap_or("nothing")),
        s.cost,
        s.repeat
    );
    if !pictures.is_empty() {
        out += "<h2>Error against time</h2>\n";
    }
    for (name, svg) in pictures {
        let _ = writeln!(
            out,
            "<figure><div class=\"wide\">{}</div>\n<figcaption>{}</figcaption></figure>",
            picture::inline(svg),
            caption(name, s)
        );
    }
    knob_table(&mut out, s);
    run_table(&mut out, s);
    out += "</body>\n</html>\n";
    out
}

/// What a picture shows, in words.
fn caption(name: &str, s: &Sweep) -> String {
    match name.strip_prefix("work-precision-") {
        Some(what) => {
            let floor = s.floor_seconds.map_or_else(String::new, |f| {
                format!(
                    " The dashed grey line is the least time of the fine model alone, {}: no choice on the coarse side goes \
                     below.",
                    seconds(f)
                )
            });
            format!("Error of the {what} of every run over its time: down and to the left is better.{floor}")
        }
        None => "Error (left) and time (right) over the setting that was varied, all others as they are."
            .to_owned(),
    }
}

/// Name of a scalar with its unit.
pub(crate) fn with_unit(name: &str, s: &Sweep) -> String {
    s.units
        .get(name)
        .map_or_else(|| name.to_owned(), |u| format!("{name} [{u}]"))
}

/// A scalar with its deviation from the reference.
pub(crate) fn scalar(m: Measured) -> String {
    let Some(x) = m.value else {
        return "–".to_owned();
    };
    let value = if x.abs() > 0.0 && !(1e-2..1e5).contains(&x.abs()) {
        format!("{x:.2e}")
    } else {
        let digits = (2.0 - x.abs().max(1.0).log10().floor()).max(0.0) as usize;
        format!("{x:.digits$}")
    };
    match m.deviation {
        Some(d) if d.abs() > 0.0 => format!("{value} ({})", signed(d)),
        _ => value,
    }
}

fn knob_table(out: &mut String, s: &Sweep) {
    let knobs = conclude::knobs(&s.runs);
    if knobs.is_empty() {
        return;
    }
    *out += "<h2>Which knobs matter</h2>\n<div class=\"wide\"><table id=\"knobs\">\n<tr><th>axis</th><th>error, largest/smallest</th>\
             <th>time, largest/smallest</th><th>smallest error at</th></tr>\n";
    for k in knobs {
        let _ = writeln!(
            out,
            "<tr><td>{}</td><td>{:.2}</td><td>{:.2}</td><td>{}</td></tr>",
            escaped(&k.axis),
            k.error_ratio,
            k.cost_ratio,
            escaped(&k.best)
        );
    }
    *out += "</table></div>\n";
}

fn run_table(out: &mut String, s: &Sweep) {
    let phases: Vec<&str> = PHASES
        .into_iter()
        .filter(|p| s.runs.iter().any(|r| r.seconds.per_step.contains_key(*p)))
        .collect();
    let mut back: Vec<&String> = s.runs.iter().flat_map(|r| r.reflected_energy.keys()).collect();
    back.sort();
    back.dedup();
    *out += "<h2>Runs</h2>\n<p class=\"note\">Blue rows: no other run is both faster and more accurate.</p>\n\
             <div class=\"wide\"><table id=\"runs\">\n<tr><th>run</th><th>error, displace&shy;ment</th><th>error, velocity</th>\
             <th>set-up</th><th>stepping</th><th>unknowns</th><th>steps</th>";
    for p in &phases {
        let _ = write!(out, "<th>{p} per step</th>");
    }
    *out += "<th>peak memory</th>";
    for b in &back {
        let _ = write!(out, "<th>comes back: {}</th>", escaped(b));
    }
    let scalars: Vec<&String> = s
        .runs
        .first()
        .map_or_else(Vec::new, |r| r.measures.keys().collect());
    for m in &scalars {
        let _ = write!(out, "<th>{}</th>", escaped(&with_unit(m, s)));
    }
    *out += "<th>H drift</th><th>cond(A)</th></tr>\n";
    let columns = 9 + phases.len() + back.len() + scalars.len();
    for r in &s.runs {
        row(out, r, &phases, &back, columns);
    }
    *out += "</table></div>\n";
}

fn row(out: &mut String, r: &Run, phases: &[&str], back: &[&String], columns: usize) {
    let label = escaped(&r.label);
    if r.status != "complete" {
        let _ = writeln!(
            out,
            "<tr class=\"failed\"><td>{label}</td><td class=\"words\" colspan=\"{columns}\">{} {}</td></tr>",
            r.status,
            escaped(r.error.as_deref().unwrap_or(""))
        );
        return;
    }
    let class = if r.pareto { " class=\"front\"" } else { "" };
    let _ = write!(out, "<tr{class}><td>{label}</td>");
    let dash = || "–".to_owned();
    let time = |x: Option<f64>| x.map_or_else(dash, seconds);
    let share = |x: Option<f64>| x.map_or_else(dash, percent);
    let small = |x: Option<f64>| x.map_or_else(dash, |x| format!("{x:.1e}"));
    let count = |x: Option<u64>| x.map_or_else(dash, |x| x.to_string());
    let mut cell = |text: String| {
        let _ = write!(out, "<td>{text}</td>");
    };
    cell(share(r.errors.displacement));
    cell(share(r.errors.velocity));
    cell(time(r.seconds.setup));
    cell(time(r.seconds.stepping));
    cell(count(r.unknowns));
    cell(count(r.steps));
    for p in phases {
        cell(time(r.seconds.per_step.get(*p).copied()));
    }
    cell(
        r.peak_bytes
            .map_or_else(dash, |b| format!("{:.0} MB", b as f64 / 1e6)),
    );
    for b in back {
        cell(share(r.reflected_energy.get(*b).copied()));
    }
    for m in r.measures.values() {
        cell(scalar(*m));
    }
    cell(small(r.h_drift));
    cell(small(r.condition));
    *out += "</tr>\n";
}
