//! Curves as SVG: over time, or over another quantity on linear or logarithmic axes.

use crate::error::{Error, Result};
use crate::view::curves;
use arlequin_scene::Table;
use arlequin_scene::output::curves::CurveLine;
use plotters::prelude::*;
use std::collections::BTreeSet;
use std::path::Path;

/// A curve of a plot.
#[derive(Debug, Clone)]
pub(crate) struct Curve<'a> {
    /// Name in the legend.
    pub(crate) name: String,
    /// Times \[s\], or values of the quantity on the horizontal axis.
    pub(crate) times: &'a [f64],
    /// Values in the plot's unit.
    pub(crate) values: Vec<f64>,
}

/// A plot of curves.
#[derive(Debug, Clone)]
pub(crate) struct Plot<'a> {
    /// Title above the plot.
    pub(crate) title: String,
    /// Quantity on the horizontal axis and its SI unit.
    pub(crate) across: [&'a str; 2],
    /// True if the horizontal and the vertical axis are logarithmic.
    pub(crate) log: [bool; 2],
    /// Quantity on the vertical axis.
    pub(crate) quantity: &'a str,
    /// SI unit of the vertical axis.
    pub(crate) unit: &'a str,
    /// Curves of the plot.
    pub(crate) curves: Vec<Curve<'a>>,
}

impl<'a> Plot<'a> {
    /// Returns a plot over time with linear axes.
    pub(crate) fn over_time(title: String, quantity: &'a str, unit: &'a str, curves: Vec<Curve<'a>>) -> Self {
        Self {
            title,
            across: ["time", "s"],
            log: [false; 2],
            quantity,
            unit,
            curves,
        }
    }
}

/// Columns of `energy.csv` that are plotted, and their names in the legend.
const ENERGIES: [(&str, &str); 3] = [
    ("kinetic [J]", "kinetic"),
    ("internal [J]", "internal"),
    ("invariant [J]", "invariant H"),
];

/// Plots the tables of a run into a folder, one picture per quantity.
pub(crate) fn run(folder: &Path, title: &str, [probes, energy, effects]: [&Table; 3]) -> Result<()> {
    for (file, name, unit) in [
        ("displacement.svg", "displacement", "m"),
        ("velocity.svg", "velocity", "m/s"),
        ("rotation.svg", "rotation", "rad"),
        ("force.svg", "force", "N"),
        ("moment.svg", "moment", "N m"),
    ] {
        let label = format!(" {name} [{unit}]");
        let curves = columns(probes, |n| n.strip_suffix(&label).map(str::to_owned));
        let plot = Plot::over_time(headline(title, name), name, unit, curves);
        draw(&folder.join(file), &plot)?;
    }
    let named = |n: &str| ENERGIES.iter().find(|e| e.0 == n).map(|e| e.1.to_owned());
    let curves = columns(energy, named);
    let plot = Plot::over_time(headline(title, "energy"), "energy", "J", curves);
    draw(&folder.join("energy.svg"), &plot)?;
    let work = |n: &str| Some(n.strip_prefix("work ")?.strip_suffix(" [J]")?.to_owned());
    let mut curves = columns(energy, work);
    curves.extend(columns(energy, |n| {
        (n == "drift [J]").then(|| "unexplained drift of H".to_owned())
    }));
    let plot = Plot::over_time(
        headline(title, "energy ledger"),
        "work since the start",
        "J",
        curves,
    );
    draw(&folder.join("ledger.svg"), &plot)?;
    of_effects(folder, title, effects)
}

/// Plots `effects.csv`, one picture for each quantity: forces on obstacles, broken bonds.
fn of_effects(folder: &Path, title: &str, table: &Table) -> Result<()> {
    let header = |name: &str| curves::header("effects.csv", name);
    let mut seen = BTreeSet::new();
    for shown in table.names.iter().filter_map(|n| header(n)) {
        if !seen.insert((shown.quantity.clone(), shown.unit.clone())) {
            continue;
        }
        let curve_name = |n: &str| {
            let h = header(n).filter(|h| h.quantity == shown.quantity && h.unit == shown.unit)?;
            Some(h.curve)
        };
        let headline = headline(title, &shown.quantity);
        let plot = Plot::over_time(headline, &shown.quantity, &shown.unit, columns(table, curve_name));
        let file = format!("effect-{}.svg", shown.quantity.replace(' ', "-"));
        draw(&folder.join(file), &plot)?;
    }
    Ok(())
}

/// Plots one probe over another.
pub(crate) fn one_over_another(folder: &Path, title: &str, curve: &CurveLine) -> Result<()> {
    let plot = Plot {
        title: headline(title, &curve.name),
        across: [&curve.x.label, &curve.x.unit],
        log: [false; 2],
        quantity: &curve.y.label,
        unit: &curve.y.unit,
        curves: vec![Curve {
            name: curve.name.clone(),
            times: &curve.x.values,
            values: curve.y.values.clone(),
        }],
    };
    draw(&folder.join(format!("curve-{}.svg", curve.name)), &plot)
}

/// Returns the columns for which `name` returns a name.
fn columns(table: &Table, name: impl Fn(&str) -> Option<String>) -> Vec<Curve<'_>> {
    let curve = |(n, values): (&String, &Vec<f64>)| {
        Some(Curve {
            name: name(n)?,
            times: &table.times,
            values: values.clone(),
        })
    };
    table.names.iter().zip(&table.columns).filter_map(curve).collect()
}

fn headline(title: &str, what: &str) -> String {
    if title.is_empty() {
        what.to_owned()
    } else {
        format!("{title}: {what}")
    }
}

/// Colours that colour-blind people can tell apart (Okabe and Ito), darkest first.
const COLOURS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(230, 159, 0),
    RGBColor(80, 80, 80),
];
/// Width of a plot \[px\].
const WIDTH: u32 = 1060;
/// Height of a plot \[px\].
const HEIGHT: u32 = 520;
/// Largest number of points of a curve; a plot of this size cannot show more.
const MOST_POINTS: usize = 1500;

/// Returns the prefixed unit for values up to `top`, and the factor to it from the SI unit.
fn prefixed(top: f64, unit: &str) -> (f64, String) {
    const PREFIXES: [(f64, &str); 9] = [
        (1e9, "G"),
        (1e6, "M"),
        (1e3, "k"),
        (1.0, ""),
        (1e-3, "m"),
        (1e-6, "µ"),
        (1e-9, "n"),
        (1e-12, "p"),
        (1e-15, "f"),
    ];
    let fits = PREFIXES.iter().find(|p| top >= p.0);
    match fits {
        Some((size, prefix)) if !unit.is_empty() && top < 1e12 => (1.0 / size, format!("{prefix}{unit}")),
        _ => (1.0, unit.to_owned()),
    }
}

fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(0.0, |a, b| a.max(b.abs()))
}

/// Returns the lowest and the highest value of every few points, in the order of time, so that peaks
/// remain.
fn thinned(times: &[f64], values: &[f64]) -> Vec<(f64, f64)> {
    let n = times.len().min(values.len());
    if n <= MOST_POINTS {
        return times.iter().copied().zip(values.iter().copied()).collect();
    }
    let size = (2 * n).div_ceil(MOST_POINTS);
    let mut out = Vec::with_capacity(MOST_POINTS + 2);
    for start in (0..n).step_by(size) {
        // Two points per group.
        let range = start..(start + size).min(n);
        let order = |a: &usize, b: &usize| values[*a].total_cmp(&values[*b]);
        let ends = [range.clone().min_by(order), range.max_by(order)];
        let mut ends: Vec<usize> = ends.into_iter().flatten().collect();
        ends.sort_unstable();
        ends.dedup();
        out.extend(ends.into_iter().map(|k| (times[k], values[k])));
    }
    out
}

/// Returns the error for a plot that cannot be drawn.
pub(super) fn undrawn(name: &str, why: &dyn std::fmt::Display) -> Error {
    Error::Observer(format!("cannot draw '{name}': {why}").into())
}

/// Draws a plot unless all of its curves have fewer than two points.
pub(crate) fn draw(path: &Path, plot: &Plot<'_>) -> Result<()> {
    if plot.curves.iter().all(|c| c.times.len() < 2) {
        return Ok(());
    }
    draw_svg(path, plot).map_err(|e| undrawn(&path.display().to_string(), &e))
}

/// Returns the range of the vertical axis with a margin of 6 %.
fn range(plot: &Plot<'_>, factor: f64) -> (f64, f64) {
    let values = || plot.curves.iter().flat_map(|c| c.values.iter());
    let (low, high) = extremes(values().map(|v| scaled(*v, factor, plot.log[1])));
    let margin = if high > low {
        0.06 * (high - low)
    } else {
        1.0f64.max(high.abs())
    };
    (low - margin, high + margin)
}

/// Returns the range of the horizontal axis. A linear axis includes zero.
fn span(plot: &Plot<'_>, factor: f64) -> (f64, f64) {
    let abscissae = plot.curves.iter().flat_map(|c| c.times.iter());
    let (first, last) = extremes(abscissae.map(|t| scaled(*t, factor, plot.log[0])));
    if plot.log[0] {
        (first, last)
    } else {
        (first.min(0.0), last)
    }
}

fn extremes(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| {
        (low.min(v), high.max(v))
    })
}

/// Returns the coordinate of a value on an axis.
fn scaled(value: f64, factor: f64, log: bool) -> f64 {
    if log {
        // Keeps zero off the logarithm.
        (value * factor).max(f64::MIN_POSITIVE).log10()
    } else {
        value * factor
    }
}

/// Returns the label at a coordinate of an axis.
fn mark(place: f64, log: bool) -> String {
    if !log {
        return tick(place);
    }
    // Grid lines between decades have uneven values; two digits are enough to read them.
    let value = 10f64.powf(place);
    let unit = 10f64.powf(place.floor() - 1.0);
    tick((value / unit).round() * unit)
}

/// Units of the picture per pixel: coordinates are whole numbers, and lines need finer ones.
const FINE: i32 = 10;

/// Converts pixels to units of the picture.
fn px(n: i32) -> i32 {
    FINE * n
}

fn draw_svg(path: &Path, plot: &Plot<'_>) -> std::result::Result<(), String> {
    let mut svg = String::new();
    let size = (WIDTH * FINE as u32, HEIGHT * FINE as u32);
    {
        let root = SVGBackend::with_string(&mut svg, size).into_drawing_area();
        draw_chart(&root, plot)?;
        root.present().map_err(|e| e.to_string())?;
    }
    // Shows the picture at its size in pixels, with coordinates ten times as fine.
    let shown = format!("width=\"{WIDTH}\" height=\"{HEIGHT}\" viewBox");
    let drawn = format!("width=\"{}\" height=\"{}\" viewBox", size.0, size.1);
    let svg = svg.replacen(&drawn, &shown, 1);
    arlequin_scene::output::put(path, &[svg.as_bytes()]).map_err(|e| e.to_string())
}

type Area<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;

fn draw_chart(root: &Area<'_>, plot: &Plot<'_>) -> std::result::Result<(), String> {
    let text = |e: &dyn std::fmt::Display| e.to_string();
    let end = largest(plot.curves.iter().flat_map(|c| c.times.iter().copied()));
    let top = largest(plot.curves.iter().flat_map(|c| c.values.iter().copied()));
    let (ft, tu) = prefixed(end, plot.across[1]);
    let (fv, vu) = prefixed(top, plot.unit);
    let (low, high) = range(plot, fv);
    let [log_x, log_y] = plot.log;
    let (first, last) = span(plot, ft);
    root.fill(&WHITE).map_err(|e| text(&e))?;
    // The legend stands beside the curves, so that it never covers them.
    let longest = plot
        .curves
        .iter()
        .map(|c| c.name.chars().count())
        .max()
        .unwrap_or(0) as i32;
    // About eight pixels per letter.
    let (left, right) = root.split_horizontally(px(WIDTH as i32 - (longest * 8 + 50).min(WIDTH as i32 / 2)));
    let mut chart = ChartBuilder::on(&left)
        .caption(&plot.title, ("sans-serif", px(20)))
        .margin(px(14))
        .x_label_area_size(px(46))
        .y_label_area_size(px(84))
        .build_cartesian_2d(first..last, low..high)
        .map_err(|e| text(&e))?;
    let unit = |u: &str| match u {
        "" => String::new(),
        u => format!(" [{u}]"),
    };
    chart
        .configure_mesh()
        .x_desc(format!("{}{}", plot.across[0], unit(&tu)))
        .y_desc(format!("{}{}", plot.quantity, unit(&vu)))
        .label_style(("sans-serif", px(14)))
        .axis_desc_style(("sans-serif", px(16)))
        .light_line_style(TRANSPARENT)
        .bold_line_style(BLACK.mix(0.12).stroke_width(FINE as u32))
        .axis_style(BLACK.stroke_width(FINE as u32))
        .set_all_tick_mark_size(px(5))
        .x_label_formatter(&|v| mark(*v, log_x))
        .y_label_formatter(&|v| mark(*v, log_y))
        .draw()
        .map_err(|e| text(&e))?;
    for (k, c) in plot.curves.iter().enumerate() {
        let colour = COLOURS[k % COLOURS.len()];
        let points = thinned(c.times, &c.values)
            .into_iter()
            .map(|(t, v)| (scaled(t, ft, log_x), scaled(v, fv, log_y)));
        chart
            .draw_series(LineSeries::new(points, colour.stroke_width(2 * FINE as u32)))
            .map_err(|e| text(&e))?;
        let y = px(54 + 22 * k as i32);
        right
            .draw(&PathElement::new(
                [(0, y), (px(22), y)],
                colour.stroke_width(2 * FINE as u32),
            ))
            .map_err(|e| text(&e))?;
        right
            .draw(&Text::new(
                c.name.clone(),
                (px(30), y - px(8)),
                ("sans-serif", px(14)),
            ))
            .map_err(|e| text(&e))?;
    }
    Ok(())
}

/// Formats a number with up to six digits, without trailing zeros.
fn tick(v: f64) -> String {
    if v == 0.0 || v.abs() < 1e-12 {
        return "0".into();
    }
    if !(1e-3..1e6).contains(&v.abs()) {
        return format!("{v:.1e}");
    }
    let digits = (5 - v.abs().log10().floor() as i32).clamp(0, 6) as usize;
    let text = format!("{v:.digits$}");
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_keep_places_between_pixels() {
        let times: Vec<f64> = (0..1000).map(f64::from).collect();
        let curves = vec![Curve {
            name: "a".into(),
            times: &times,
            values: times.clone(),
        }];
        let path = std::env::temp_dir().join(format!("arlequin-plot-{}.svg", std::process::id()));
        let plot = Plot::over_time("t".into(), "q", "m", curves);
        draw(&path, &plot).unwrap_or_else(|e| panic!("{e}"));
        let svg = std::fs::read_to_string(&path).unwrap_or_default();
        let _ = std::fs::remove_file(&path);
        assert!(svg.contains("width=\"1060\" height=\"520\" viewBox=\"0 0 10600 5200\""));
        let line = svg
            .split("points=\"")
            .filter(|p| p.len() > 5000)
            .last()
            .unwrap_or_default();
        let points = line.split('"').next().unwrap_or_default().split_whitespace();
        let mut heights: Vec<&str> = points.filter_map(|p| p.split(',').nth(1)).collect();
        heights.sort_unstable();
        heights.dedup();
        // A thousand rising values on some 400 pixels.
        assert!(heights.len() > 990, "{}", heights.len());
    }
}
