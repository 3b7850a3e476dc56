//! The report of a sweep: one HTML page without scripts and without references to other files.

use super::work_precision as picture;
use arlequin_scene::sweep::conclude::{self, percent, seconds, signed};
use arlequin_scene::sweep::{Measured, PHASES, Run, Sweep};
use maud::{DOCTYPE, Markup, PreEscaped, html};

const STYLE: &str = "body{font:16px/1.5 sans-serif;max-width:1120px;margin:2em auto;padding:0 1em;color:#222}\
h1{font-size:1.6em;line-height:1.25}h2{font-size:1.2em;margin-top:2em}figure{margin:1.5em 0}\
figcaption{color:#555;font-size:14px}svg{display:block;width:100%;max-width:1060px;height:auto}\
.wide{overflow-x:auto}table{border-collapse:collapse;font-size:13px}th{white-space:normal;vertical-align:bottom;min-width:4.5em}\
th,td{padding:.3em .6em;border-bottom:1px solid #ddd;text-align:right}td{white-space:nowrap}\
th:first-child,td:first-child{text-align:left;position:sticky;left:0;background:#fff}\
tr.front td,tr.front td:first-child{background:#e8f2fa}tr.failed td,tr.failed td:first-child{background:#fbe9e0}\
td.words{text-align:left;white-space:normal;min-width:30em}ul{padding-left:1.4em}li{margin:.4em 0}\
.note{color:#555;font-size:14px}.narrow{display:none}\
@media(max-width:700px){body{margin:1em auto}.narrow{display:block}.broad,.more{display:none}th,td{padding:.3em .35em}\
th{min-width:0}td.words{min-width:0}td:first-child,#knobs td,th{white-space:normal;overflow-wrap:anywhere}}";

/// Elements of the head that maud would leave unclosed. The width is for phones, which otherwise show the
/// page at the width of a desktop; the empty icon keeps browsers from requesting one from the server.
const META: &str = "<meta charset=\"utf-8\"/>\n<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n\
<link rel=\"icon\" href=\"data:,\"/>\n";

/// Number of columns in the table of runs that a phone has room for: name, errors, times.
const SHOWN: usize = 6;

/// Returns the whole page. `pictures` and `narrow` hold the same pictures by name, for wide and for narrow
/// screens.
pub(crate) fn page(s: &Sweep, pictures: &[(String, String)], narrow: &[(String, String)]) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head { (PreEscaped(META)) title { (s.title) } style { (PreEscaped(STYLE)) } }
            body {
                h1 { (s.title) }
                h2 { "Conclusion" }
                ul { @for line in &s.conclusion { li { (line) } } }
                p.note {
                    "What decides: the " (s.judge) ", relative L2 over the time of all probes, against "
                    (s.reference.as_deref().unwrap_or("nothing")) "; the time of " (s.cost) ", the least of " (s.repeat)
                    " runs, one after another on the same machine. Times of another machine differ, ratios less so."
                }
                @if !pictures.is_empty() { h2 { "Error against time" } }
                @for ((name, svg), (_, small)) in pictures.iter().zip(narrow) {
                    figure {
                        div.broad { (PreEscaped(picture::inline(svg))) }
                        div.narrow { (PreEscaped(picture::inline(small))) }
                        figcaption { (caption(name, s)) }
                    }
                }
                (knob_table(s))
                (run_table(s))
            }
        }
    };
    page.into_string()
}

/// Returns the caption of a picture.
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

/// Returns the name of a scalar with its unit.
pub(crate) fn with_unit(name: &str, s: &Sweep) -> String {
    s.units
        .get(name)
        .map_or_else(|| name.to_owned(), |u| format!("{name} [{u}]"))
}

/// Formats a scalar with its deviation from the reference.
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

fn knob_table(s: &Sweep) -> Markup {
    let knobs = conclude::knobs(&s.runs);
    html! {
        @if !knobs.is_empty() {
            h2 { "Which knobs matter" }
            div.wide {
                table #knobs {
                    tr { @for h in ["axis", "error, largest/smallest", "time, largest/smallest", "smallest error at"] { th { (h) } } }
                    @for k in knobs {
                        tr {
                            td { (k.axis) }
                            td { (format!("{:.2}", k.error_ratio)) }
                            td { (format!("{:.2}", k.cost_ratio)) }
                            td { (k.best) }
                        }
                    }
                }
            }
        }
    }
}

fn run_table(s: &Sweep) -> Markup {
    let phases: Vec<&str> = PHASES
        .into_iter()
        .filter(|p| s.runs.iter().any(|r| r.seconds.per_step.contains_key(*p)))
        .collect();
    let mut back: Vec<&String> = s.runs.iter().flat_map(|r| r.reflected_energy.keys()).collect();
    back.sort();
    back.dedup();
    let mut heads = vec![
        "run".to_owned(),
        "total".to_owned(),
        "error, displace\u{ad}ment".to_owned(),
    ];
    heads.extend(["error, velocity", "set-up", "stepping", "unknowns", "steps"].map(str::to_owned));
    heads.extend(phases.iter().map(|p| format!("{p} per step")));
    heads.push("peak memory".to_owned());
    heads.extend(back.iter().map(|b| format!("comes back: {b}")));
    let scalars = s.runs.first().into_iter().flat_map(|r| r.measures.keys());
    heads.extend(scalars.map(|m| with_unit(m, s)));
    heads.extend(["H drift", "cond(A)"].map(str::to_owned));
    html! {
        h2 { "Runs" }
        p.note {
            "Blue rows: no other run is both faster and more accurate."
            span.narrow { "What each step took, memory and more are shown on a wider screen." }
        }
        div.wide {
            table #runs {
                tr { @for (k, h) in heads.iter().enumerate() { th class=[(k >= SHOWN).then_some("more")] { (h) } } }
                @for r in &s.runs {
                    @if r.status == "complete" {
                        tr class=[r.pareto.then_some("front")] {
                            td { (r.label) }
                            @for (k, c) in (1..).zip(cells(r, &phases, &back)) { td class=[(k >= SHOWN).then_some("more")] { (c) } }
                        }
                    } @else {
                        tr.failed {
                            td { (r.label) }
                            td.words colspan=(heads.len() - 1) { (r.status) " " (r.error.as_deref().unwrap_or("")) }
                        }
                    }
                }
            }
        }
    }
}

/// Returns the cells of a run after its name.
fn cells(r: &Run, phases: &[&str], back: &[&String]) -> Vec<String> {
    let dash = || "–".to_owned();
    let time = |x: Option<f64>| x.map_or_else(dash, seconds);
    let share = |x: Option<f64>| x.map_or_else(dash, percent);
    let small = |x: Option<f64>| x.map_or_else(dash, |x| format!("{x:.1e}"));
    let count = |x: Option<u64>| x.map_or_else(dash, |x| x.to_string());
    let memory = |b: u64| format!("{:.0} MB", b as f64 / 1e6);
    let mut out = vec![time(r.seconds.total)];
    out.extend([r.errors.displacement, r.errors.velocity].map(share));
    out.extend([r.seconds.setup, r.seconds.stepping].map(time));
    out.extend([r.unknowns, r.steps].map(count));
    out.extend(phases.iter().map(|p| time(r.seconds.per_step.get(*p).copied())));
    out.push(r.peak_bytes.map_or_else(dash, memory));
    out.extend(back.iter().map(|b| share(r.reflected_energy.get(*b).copied())));
    out.extend(r.measures.values().map(|m| scalar(*m)));
    out.extend([r.h_drift, r.condition].map(small));
    out
}
