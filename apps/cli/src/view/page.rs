//! The page: skeleton, style and script from `web/`, libraries from `web/vendor/`, and the compressed data.

use super::curves::Plot;
use super::part::{Field, Part};
use crate::error::Result;
use crate::figures::Figure;
use crate::report;
use base64::Engine;
use serde::Serialize;
use serde_json::{Value, json};

/// First line of the page; a file that begins with it may be overwritten.
pub(super) const HEAD: &str = "<!DOCTYPE html><!-- Results of arlequin, by 'arlequin view' -->\n";

const SKELETON: &str = include_str!("../../web/view.html");
/// Marks in the skeleton and the texts that replace them.
const PIECES: [(&str, &str); 8] = [
    (
        "/* uplot.css */",
        include_str!("../../web/vendor/uplot/uPlot.min.css"),
    ),
    ("/* view.css */", include_str!("../../web/view.css")),
    (
        "/* three.js */",
        include_str!("../../web/vendor/three/three.min.js"),
    ),
    (
        "/* uplot.js */",
        include_str!("../../web/vendor/uplot/uPlot.iife.min.js"),
    ),
    ("/* body.js */", include_str!("../../web/body.js")),
    ("/* plots.js */", include_str!("../../web/plots.js")),
    ("/* stage.js */", include_str!("../../web/stage.js")),
    ("/* view.js */", include_str!("../../web/view.js")),
];

/// Binary numbers in a row; the script reads each array from its offset.
#[derive(Debug, Default)]
struct Store(Vec<u8>);

/// Offset of an array \[bytes\], and its number of values.
#[derive(Debug, Serialize)]
struct Stored(usize, usize);

impl Store {
    fn put<const N: usize>(&mut self, numbers: impl Iterator<Item = [u8; N]>) -> Stored {
        // Typed arrays in JavaScript must begin at a multiple of their number's size.
        self.0.resize(self.0.len().next_multiple_of(4), 0);
        let offset = self.0.len();
        self.0.extend(numbers.flatten());
        Stored(offset, (self.0.len() - offset) / N)
    }

    fn floats(&mut self, numbers: impl Iterator<Item = f64>) -> Stored {
        self.put(numbers.map(|x| (x as f32).to_le_bytes()))
    }
}

/// Content of a page.
#[derive(Debug)]
pub(super) struct Content {
    /// Name of the folder, the title of a run without a summary.
    pub(super) name: String,
    /// Content of `summary.json`; null if the run goes on.
    pub(super) summary: Value,
    /// Times of the frames \[s\].
    pub(super) times: Vec<f64>,
    pub(super) parts: Vec<Part>,
    pub(super) plots: Vec<Plot>,
    pub(super) figures: Vec<Figure>,
    /// Warnings of the run, and what the page leaves out.
    pub(super) notices: Vec<String>,
}

/// Returns the whole page.
pub(super) fn html(content: &Content) -> Result<String> {
    let mut store = Store::default();
    let summary = &content.summary;
    let (centre, size) = extent(&content.parts, summary);
    let parts: Vec<Value> = content
        .parts
        .iter()
        .map(|p| part(&mut store, p, summary, (centre, size)))
        .collect();
    let plots: Vec<Value> = content.plots.iter().map(|p| plot(&mut store, p)).collect();
    let title = ["title", "scene"]
        .iter()
        .find_map(|k| summary[*k].as_str())
        .unwrap_or(&content.name);
    let about = json!({
        "title": title,
        "facts": facts(summary),
        "size": size,
        "times": content.times,
        "parts": parts,
        "plots": plots,
        "figures": content.figures,
        "notices": content.notices,
    });
    // A `<` in the data could end the script element that holds them.
    let about = report::pretty(&about)?.replace('<', "\\u003c");
    let packed = miniz_oxide::deflate::compress_to_vec_zlib(&store.0, 5);
    let packed = base64::engine::general_purpose::STANDARD.encode(packed);
    let name = title.replace('&', "&amp;").replace('<', "&lt;");
    let mut pieces = PIECES.map(|(mark, piece)| (mark, piece.trim_end())).to_vec();
    pieces.extend([
        ("<!-- title -->", &*name),
        ("/* about */", &about),
        ("/* data */", &packed),
    ]);
    Ok(HEAD.to_owned() + &filled(SKELETON, &pieces))
}

/// Returns the skeleton with every mark replaced by its piece. Pieces are not searched for marks, since the
/// texts of a user may contain them.
fn filled(skeleton: &str, pieces: &[(&str, &str)]) -> String {
    let mut page = String::new();
    let mut rest = skeleton;
    let first = |rest: &str| {
        let found = pieces
            .iter()
            .filter_map(|(mark, piece)| Some((rest.find(mark)?, mark.len(), *piece)));
        found.min_by_key(|(place, ..)| *place)
    };
    while let Some((place, length, piece)) = first(rest) {
        page += &rest[..place];
        page += piece;
        rest = &rest[place + length..];
    }
    page + rest
}

/// Finds a model by its name in the summary of a run.
fn model<'a>(summary: &'a Value, name: &str) -> Option<&'a Value> {
    summary["models"].as_array()?.iter().find(|m| m["name"] == name)
}

/// Returns the kind of a model, null for mediators and rigid bodies. Without a summary the name of a part
/// tells whether it is a model.
fn kind(summary: &Value, part: &Part) -> Value {
    if summary["models"].is_array() {
        return model(summary, &part.name).map_or(Value::Null, |m| m["kind"].clone());
    }
    match (&part.name, part.radii.is_empty()) {
        (name, _) if ["mediator-", "rigid-"].iter().any(|p| name.starts_with(p)) => Value::Null,
        (_, true) => "mesh".into(),
        (_, false) => "particles".into(),
    }
}

/// Returns centre and diagonal \[m\] of the box around the models' reference positions. Rigid bodies are
/// left out, since they may be far larger.
fn extent(parts: &[Part], summary: &Value) -> ([f64; 3], f64) {
    let mut low = [f64::INFINITY; 3];
    let mut high = [f64::NEG_INFINITY; 3];
    let models = parts.iter().filter(|p| !kind(summary, p).is_null());
    for (k, x) in models.flat_map(|p| p.grid.points.iter().enumerate()) {
        low[k % 3] = low[k % 3].min(*x);
        high[k % 3] = high[k % 3].max(*x);
    }
    let centre = std::array::from_fn(|c| 0.5 * (low[c] + high[c]));
    let size = (0..3).map(|c| (high[c] - low[c]).powi(2)).sum::<f64>().sqrt();
    (centre, size.max(f64::MIN_POSITIVE))
}

fn part(store: &mut Store, p: &Part, summary: &Value, (centre, size): ([f64; 3], f64)) -> Value {
    let place = |(k, x): (usize, &f64)| (x - centre[k % 3]) / size;
    let whole = |k: &u32| k.to_le_bytes();
    let fields: Vec<Value> = p.fields.iter().map(|f| field(store, f)).collect();
    json!({
        "name": p.name,
        "kind": kind(summary, p),
        "mediator": p.name.starts_with("mediator-"),
        "places": store.floats(p.grid.points.iter().enumerate().map(place)),
        "radii": store.floats(p.radii.iter().map(|r| r / size)),
        "faces": store.put(p.grid.faces.iter().flatten().map(whole)),
        "centres": store.floats(p.centres.iter().enumerate().map(place)),
        "lines": store.put(p.grid.lines.iter().flat_map(|l| &l[..2]).map(whole)),
        "broken": store.put(p.broken.iter().map(|b| b.to_le_bytes())),
        "fields": fields,
    })
}

fn field(store: &mut Store, f: &Field) -> Value {
    let (name, unit) = match f.name.split_once(" [") {
        Some((name, rest)) => {
            let (unit, more) = rest.split_once(']').unwrap_or((rest, ""));
            (format!("{name}{more}"), if unit == "-" { "" } else { unit })
        }
        None => (f.name.clone(), ""),
    };
    json!({
        "name": name,
        "unit": unit.replace("m3", "m³").replace("m2", "m²"),
        "onLines": f.on_lines,
        "components": f.components,
        "frames": f.frames,
        "low": f.low,
        "high": f.high,
        "values": store.put(f.values.iter().map(|v| v.to_le_bytes())),
    })
}

fn plot(store: &mut Store, p: &Plot) -> Value {
    json!({
        "title": p.title,
        "unit": p.unit,
        "names": p.names,
        "over": p.over.as_ref().map(|[title, unit]| json!({ "title": title, "unit": unit })),
        "times": store.floats(p.times.iter().copied()),
        "columns": p.columns.iter().map(|c| store.floats(c.iter().copied())).collect::<Vec<_>>(),
    })
}

/// Returns a few lines about the run.
fn facts(s: &Value) -> Vec<String> {
    let mut out = Vec::new();
    for m in s["models"].as_array().into_iter().flatten() {
        if let (Some(name), Some(kind), Some(n)) =
            (m["name"].as_str(), m["kind"].as_str(), m["nodes"].as_u64())
        {
            let what = if kind == "dem" { "particles" } else { "nodes" };
            out.push(format!("{name}: {kind}, {n} {what}"));
        }
    }
    if let Some(load_steps) = s["load_steps"].as_array().filter(|l| !l.is_empty()) {
        out.push(format!("{} load steps at rest", load_steps.len()));
    } else {
        if let (Some(steps), Some(dt)) = (s["steps"].as_u64(), s["dt"].as_f64()) {
            out.push(format!("{steps} steps of {dt:.3e} s"));
        }
        if let Some(drift) = s["energy"]["h_drift_max"].as_f64() {
            out.push(format!("unexplained drift of H {drift:.1e}"));
        }
    }
    match s["status"].as_str() {
        None | Some("complete") => {}
        Some(other) => out.push(format!("status: {other}")),
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Marks of the page in the texts of a user stay as they are.
    #[test]
    fn pieces_are_not_searched_for_marks() {
        let pieces = [("<a>", "1 <b> <a>"), ("<b>", "2 <a>")];
        assert_eq!(filled("x <b> y <a> <b>", &pieces), "x 2 <a> y 1 <b> <a> 2 <a>");
    }
}
