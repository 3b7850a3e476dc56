//! Reads tables over time and groups their columns into plots by quantity and unit.

use std::path::Path;

/// Largest number of rows of a plot; a screen cannot show more.
const ROWS: usize = 1200;

/// Curves of one quantity over time, or of one quantity over another.
#[derive(Debug)]
pub(super) struct Plot {
    pub(super) title: String,
    pub(super) unit: String,
    pub(super) names: Vec<String>,
    pub(super) times: Vec<f64>,
    /// One column per curve; if `over` is given, the horizontal values come first.
    pub(super) columns: Vec<Vec<f64>>,
    /// Title and unit of the horizontal axis if it is not time.
    pub(super) over: Option<[String; 2]>,
}

/// Parts of a column name.
#[derive(Debug)]
pub(crate) struct Header {
    pub(crate) curve: String,
    pub(crate) quantity: String,
    pub(crate) unit: String,
}

/// Table over time: the first column holds the times \[s\].
#[derive(Debug)]
pub(crate) struct Table {
    pub(crate) names: Vec<String>,
    pub(crate) rows: Vec<Vec<f64>>,
}

/// Reads a table without its incomplete rows; a run that goes on may be writing the last one. Returns `None`
/// if there is no table or no complete row.
pub(crate) fn table(path: &Path) -> Option<Table> {
    let text = std::fs::read_to_string(path).ok()?;
    let mut lines = text.lines();
    let names: Vec<String> = lines.next()?.split(',').map(str::to_owned).collect();
    let row = |l: &str| l.split(',').map(str::parse).collect::<Result<Vec<f64>, _>>().ok();
    let rows: Vec<Vec<f64>> = lines.filter_map(row).filter(|r| r.len() == names.len()).collect();
    (!rows.is_empty()).then_some(Table { names, rows })
}

impl Table {
    fn column(&self, k: usize) -> Vec<f64> {
        self.rows.iter().map(|r| r[k]).collect()
    }
}

/// Reads the tables of a folder that have a time column, and the curves of one probe over another. Missing
/// tables and tables with fewer than two complete rows are skipped. No two plots have the same title and
/// unit.
pub(super) fn read(folder: &Path) -> Vec<Plot> {
    let mut out = one_over_another(folder);
    for file in ["probes.csv", "energy.csv", "effects.csv"] {
        let Some(table) = table(&folder.join(file)).filter(|t| t.rows.len() > 1) else {
            continue;
        };
        for mut plot in over_time(file, &table) {
            if out.iter().any(|p| p.title == plot.title && p.unit == plot.unit) {
                plot.title += &format!(" ({})", file.trim_end_matches(".csv"));
            }
            out.push(plot);
        }
    }
    out.into_iter().map(thinned).collect()
}

/// Groups the columns of a table by quantity and unit.
fn over_time(file: &str, table: &Table) -> Vec<Plot> {
    let mut plots: Vec<Plot> = Vec::new();
    for (k, name) in table.names.iter().enumerate().skip(1) {
        let Some(h) = header(file, name) else { continue };
        let existing = plots
            .iter_mut()
            .find(|p| p.title == h.quantity && p.unit == h.unit);
        match existing {
            Some(p) => {
                p.names.push(h.curve);
                p.columns.push(table.column(k));
            }
            None => plots.push(Plot {
                title: h.quantity,
                unit: h.unit,
                names: vec![h.curve],
                times: table.column(0),
                columns: vec![table.column(k)],
                over: None,
            }),
        }
    }
    plots
}

/// Reads the tables `curve-NAME.csv` in the order of their names.
fn one_over_another(folder: &Path) -> Vec<Plot> {
    let files = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut names: Vec<String> = files
        .filter_map(|f| f.file_name().into_string().ok())
        .filter(|n| n.starts_with("curve-") && n.ends_with(".csv"))
        .collect();
    names.sort();
    let plot = |file: String| {
        let table = table(&folder.join(&file)).filter(|t| t.names.len() == 3 && t.rows.len() > 1)?;
        let axis = |k: usize| {
            let (words, unit) = split_unit(&table.names[k]);
            // The usual factor only turns the direction of a support or a load.
            let words = words
                .strip_prefix("-1 ")
                .map_or(words.to_owned(), |w| format!("−{w}"));
            [words, unit.to_owned()]
        };
        let [title, unit] = axis(2);
        Some(Plot {
            title,
            unit,
            names: vec![
                file.trim_start_matches("curve-")
                    .trim_end_matches(".csv")
                    .to_owned(),
            ],
            times: table.column(0),
            columns: vec![table.column(1), table.column(2)],
            over: Some(axis(1)),
        })
    };
    names.into_iter().filter_map(plot).collect()
}

/// Splits a column name into words and unit; the unit may be empty.
pub(crate) fn split_unit(name: &str) -> (&str, &str) {
    let parts = name.strip_suffix(']').and_then(|n| n.rsplit_once(" ["));
    parts.unwrap_or((name, ""))
}

/// Splits a column name into curve, quantity and unit; `None` if the column is not plotted.
pub(crate) fn header(file: &str, name: &str) -> Option<Header> {
    let (words, unit) = split_unit(name);
    let some_header = |curve: &str, quantity: &str| {
        Some(Header {
            curve: curve.to_owned(),
            quantity: quantity.to_owned(),
            unit: unit.to_owned(),
        })
    };
    match file {
        "energy.csv" if unit == "J" => match words.strip_prefix("work ") {
            Some(object) => some_header(object, "work"),
            None if words == "drift" || words == "work" => None,
            None => some_header(words, "energy"),
        },
        "energy.csv" => None,
        _ => {
            let (object, quantity) = words.split_once(' ')?;
            // Components of one vector share a plot.
            match quantity.rsplit_once(' ') {
                Some((q, axis @ ("x" | "y" | "z"))) => some_header(&format!("{object} {axis}"), q),
                _ if file == "effects.csv" && unit.is_empty() && quantity != "broken bonds" => None,
                _ if file == "effects.csv" && unit == "s" => None,
                _ => some_header(object, quantity),
            }
        }
    }
}

/// Reduces the rows of a plot: of every group of rows keeps those with the lowest and the highest value of
/// each curve, so that peaks remain.
fn thinned(plot: Plot) -> Plot {
    let rows = plot.times.len();
    if rows <= ROWS {
        return plot;
    }
    // Every bucket keeps up to two rows per curve.
    let buckets = (ROWS / (2 * plot.columns.len())).max(50);
    let size = rows.div_ceil(buckets);
    // Both ends of the time axis remain.
    let mut kept_rows = vec![0, rows - 1];
    for start in (0..rows).step_by(size) {
        let range = start..(start + size).min(rows);
        for column in &plot.columns {
            let order = |a: &usize, b: &usize| column[*a].total_cmp(&column[*b]);
            kept_rows.extend(range.clone().min_by(order));
            kept_rows.extend(range.clone().max_by(order));
        }
    }
    kept_rows.sort_unstable();
    kept_rows.dedup();
    let pick = |values: &[f64]| kept_rows.iter().map(|k| values[*k]).collect::<Vec<f64>>();
    Plot {
        times: pick(&plot.times),
        columns: plot.columns.iter().map(|c| pick(c)).collect(),
        ..plot
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_become_curves() {
        let parts = |file: &str, name: &str| header(file, name).map(|h| [h.curve, h.quantity, h.unit]);
        let some = |a: [&str; 3]| Some(a.map(str::to_owned));
        assert_eq!(
            parts("probes.csv", "tip displacement [m]"),
            some(["tip", "displacement", "m"])
        );
        assert_eq!(
            parts("energy.csv", "kinetic [J]"),
            some(["kinetic", "energy", "J"])
        );
        assert_eq!(
            parts("energy.csv", "work a/blow [J]"),
            some(["a/blow", "work", "J"])
        );
        assert_eq!(parts("energy.csv", "relative drift [-]"), None);
        assert_eq!(
            parts("effects.csv", "a/ball force on it z [N]"),
            some(["a/ball z", "force on it", "N"])
        );
        assert_eq!(
            parts("effects.csv", "a/fracture broken bonds"),
            some(["a/fracture", "broken bonds", ""])
        );
        assert_eq!(parts("effects.csv", "a/contact calls"), None);
    }

    #[test]
    fn thinning_keeps_peaks() {
        let times: Vec<f64> = (0..100_000).map(f64::from).collect();
        let mut curve = vec![0.0; times.len()];
        curve[77_777] = 5.0;
        let plot = thinned(Plot {
            title: String::new(),
            unit: String::new(),
            names: vec![String::new()],
            times,
            columns: vec![curve],
            over: None,
        });
        assert!(plot.times.len() <= ROWS + 2);
        let peak = plot.columns[0]
            .iter()
            .position(|v| (*v - 5.0).abs() < 1e-12)
            .expect("the peak");
        assert!((plot.times[peak] - 77_777.0).abs() < 1e-12);
    }
}
