//! Headline figures of a folder of results, finished or not: peaks of probes, the largest stress, broken
//! bonds, fragments.

use crate::view::curves::{self, Table};
use crate::view::frames::{self, Frame};
use arlequin::dem_beam::vtu::Section;
use serde_json::{Map, Value};
use std::collections::BTreeMap;
use std::path::Path;

/// Name and words of a figure.
pub(crate) type Figure = [String; 2];

/// Array of the frames whose largest value is reported.
const STRESS: &str = "von Mises stress [Pa]";

/// Reads the figures of a folder. `summary` is the content of `summary.json`, null if the run goes on. Files
/// that are missing or damaged contribute nothing.
pub(crate) fn read(folder: &Path, summary: &Value) -> Vec<Figure> {
    let mut out = Vec::new();
    out.extend(curves::table(&folder.join("probes.csv")).iter().flat_map(peaks));
    out.extend(stress(folder));
    out.extend(facts(folder, summary).iter().filter_map(broken));
    out.extend(fragments(folder));
    out
}

fn figure(name: &str, words: String) -> Figure {
    [name.to_owned(), words]
}

/// Returns the largest magnitude of each column, its time, and the last value; forces first.
fn peaks(table: &Table) -> Vec<Figure> {
    let peak = |k: usize| {
        let (words, unit) = curves::split_unit(&table.names[k]);
        let magnitude = |r: &&Vec<f64>| r[k].abs();
        let top = table
            .rows
            .iter()
            .max_by(|a, b| magnitude(a).total_cmp(&magnitude(b)))?;
        let last = table.rows.last()?;
        let end = if last[0] > top[0] {
            format!(", {} at the end", si(last[k], unit))
        } else {
            String::new()
        };
        Some(figure(
            "peak",
            format!("{words} {} at {}{end}", si(top[k], unit), si(top[0], "s")),
        ))
    };
    let mut columns: Vec<usize> = (1..table.names.len()).collect();
    columns.sort_by_key(|k| !table.names[*k].ends_with(" [N]"));
    columns.into_iter().filter_map(peak).collect()
}

/// Returns the largest stress in the frames, with its time and its place at rest.
fn stress(folder: &Path) -> Option<Figure> {
    let mut top = (f64::NEG_INFINITY, None);
    let all = frames::index(folder).ok()?;
    for series in &all {
        for (time, path) in &series.files {
            let Ok(mut frame) = Frame::open(path) else {
                continue;
            };
            let Some(array) = frame.find(Section::PointData, STRESS) else {
                break;
            };
            let values = frame.numbers(&array).unwrap_or_default();
            let largest = values.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1));
            if let Some((k, value)) = largest.filter(|l| *l.1 > top.0) {
                top = (*value, Some((&series.name, *time, path, k)));
            }
        }
    }
    let (name, time, path, k) = top.1?;
    let mut frame = Frame::open(path).ok()?;
    let points = frame.positions().and_then(|a| frame.numbers(&a).ok())?;
    let place: Vec<String> = points
        .get(3 * k..3 * k + 3)?
        .iter()
        .map(|x| si(*x, "m"))
        .collect();
    Some(figure(
        "stress",
        format!(
            "von Mises {} in '{name}' at ({}), {}",
            si(top.0, "Pa"),
            place.join(", "),
            si(time, "s")
        ),
    ))
}

/// Returns the figures that each effect reports: those of the summary, else the last row of `effects.csv`.
fn facts(folder: &Path, summary: &Value) -> Vec<(String, Map<String, Value>)> {
    if let Some(lines) = summary["effect_ledger"].as_array() {
        let line = |e: &Value| Some((e["name"].as_str()?.to_owned(), e["facts"].as_object()?.clone()));
        return lines.iter().filter_map(line).collect();
    }
    let mut out = BTreeMap::<String, Map<String, Value>>::new();
    if let Some(table) = curves::table(&folder.join("effects.csv")) {
        let last = table.rows.last().into_iter().flatten();
        for (name, value) in table.names.iter().zip(last) {
            if let Some((effect, quantity)) = name.split_once(' ') {
                let facts = out.entry(effect.to_owned()).or_default();
                facts.insert(quantity.to_owned(), (*value).into());
            }
        }
    }
    out.into_iter().collect()
}

/// Describes the broken bonds of an effect that can break bonds.
fn broken((name, facts): &(String, Map<String, Value>)) -> Option<Figure> {
    let value = |key: &str| facts.get(key).and_then(Value::as_f64);
    let (count, total) = (value("broken bonds")?, value("bonds")?);
    let model = name.split('/').next().unwrap_or(name);
    let mut words = format!("{count:.0} of {total:.0} bonds of '{model}'");
    // Without a broken bond the time of the first one is negative.
    if let Some(time) = value("first break [s]").filter(|t| *t >= 0.0 && count > 0.0) {
        words += &format!(", the first at {}", si(time, "s"));
    }
    if let Some(energy) = value("released energy [J]").filter(|e| *e > 0.0) {
        words += &format!("; {} released", si(energy, "J"));
    }
    Some(figure("broken", words))
}

/// Describes the fragments of each model at the last instant of `fragments.csv`.
fn fragments(folder: &Path) -> Vec<Figure> {
    let text = std::fs::read_to_string(folder.join("fragments.csv")).unwrap_or_default();
    let rows: Vec<Vec<&str>> = text.lines().skip(1).map(|l| l.split(',').collect()).collect();
    let Some(last) = rows.last().map(|r| r[0]) else {
        return Vec::new();
    };
    // Masses and numbers of particles by the number of the fragment.
    let mut models = BTreeMap::<&str, BTreeMap<usize, (f64, f64)>>::new();
    for row in rows.iter().filter(|r| r[0] == last && r.len() > 4) {
        let (Ok(number), Ok(particles), Ok(mass)) = (row[2].parse(), row[3].parse(), row[4].parse()) else {
            continue;
        };
        models
            .entry(row[1])
            .or_default()
            .insert(number, (mass, particles));
    }
    let line = |(model, pieces): (&str, BTreeMap<usize, (f64, f64)>)| {
        let total: f64 = pieces.values().map(|p| p.0).sum();
        let heaviest = pieces.get(&1).map_or(0.0, |p| p.0);
        // Number 0 stands for all particles without a bond.
        let alone = pieces.get(&0).map_or(0.0, |p| p.1);
        let count = pieces.keys().filter(|n| **n > 0).count();
        (count > 1 || alone > 0.0).then(|| {
            figure(
                "fragments",
                format!(
                    "'{model}' is in {count} {}, the heaviest with {:.1} % of the mass; {alone:.0} particles without a bond",
                    if count == 1 { "piece" } else { "pieces" },
                    100.0 * heaviest / total.max(f64::MIN_POSITIVE)
                ),
            )
        })
    };
    models.into_iter().filter_map(line).collect()
}

/// Returns a value with four digits and a prefix of its unit, such as "-41.98 N" or "14.68 µs".
pub(crate) fn si(x: f64, unit: &str) -> String {
    const PREFIXES: [&str; 10] = ["f", "p", "n", "µ", "m", "", "k", "M", "G", "T"];
    // Powers of a unit and masses take no prefix.
    let plain = unit.is_empty()
        || ["m2", "m3", "m²", "m³", "kg", "rad", "1/"]
            .iter()
            .any(|p| unit.starts_with(p));
    let exponent = if x == 0.0 { 0.0 } else { x.abs().log10() };
    let power = if plain {
        0.0
    } else {
        ((exponent + 1e-9) / 3.0).floor().clamp(-5.0, 4.0)
    };
    let value = x / 1000_f64.powf(power);
    let text = match value.abs() {
        v if v != 0.0 && !(1e-3..1e5).contains(&v) => format!("{value:.3e}"),
        v => {
            let decimals = if v == 0.0 {
                0
            } else {
                (3 - v.log10().floor() as i32).max(0) as usize
            };
            let text = format!("{value:.decimals$}");
            if text.contains('.') {
                text.trim_end_matches('0').trim_end_matches('.').to_owned()
            } else {
                text
            }
        }
    };
    format!("{text} {}{unit}", PREFIXES[(power + 5.0) as usize])
        .trim_end()
        .to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_have_four_digits_and_a_prefix() {
        assert_eq!(si(-41.998, "N"), "-42 N");
        assert_eq!(si(1.468e-5, "s"), "14.68 µs");
        assert_eq!(si(0.0, "m"), "0 m");
        assert_eq!(si(1e6, "Pa"), "1 MPa");
        assert_eq!(si(2.5e-7, "m³"), "2.500e-7 m³");
        assert_eq!(si(0.25, ""), "0.25");
    }
}
