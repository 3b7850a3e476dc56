//! Work-precision pictures as SVG: error over time on logarithmic axes.

use super::plot::undrawn;
use crate::error::Result;
use arlequin_scene::sweep::{Hook, HookRow, Mark, Run, Sweep, SweepFile, hook_rows};
use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use plotters::prelude::*;
use std::ops::Range;

const BLUE: RGBColor = RGBColor(0, 114, 178);
const ORANGE: RGBColor = RGBColor(213, 94, 0);
const GREEN: RGBColor = RGBColor(0, 158, 115);
const GREY: RGBColor = RGBColor(120, 120, 120);
/// Room for the legend \[px\]: its width beside the curves, its height below them.
const LEGEND: (i32, i32) = (250, 210);

/// Kind of screen a picture is made for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Screen {
    /// Desktop or paper: parts side by side.
    Wide,
    /// Phone: parts one below the other.
    Narrow,
}

impl Screen {
    /// Returns width and height \[px\] of a picture with `parts` parts.
    fn size(self, parts: u32) -> (u32, u32) {
        match self {
            Self::Wide => (1060, 560),
            Self::Narrow => (430, 400 * parts + 210 * (2 - parts)),
        }
    }
}

/// A logarithmic axis with ticks at 1, 2, 5 times powers of ten.
#[derive(Debug, Clone)]
struct Decades(f64, f64);

impl Decades {
    /// Returns an axis that covers all positive values with a margin; `None` without positive values.
    fn over(values: impl Iterator<Item = f64>) -> Option<Self> {
        let (low, high) = values
            .filter(|v| *v > 0.0 && v.is_finite())
            .fold((f64::INFINITY, 0.0f64), |(a, b), v| (a.min(v), b.max(v)));
        // The axis spans at least a third of a decade, so that nearly equal values do not look different.
        let margin = 1.25f64.max(2.0 / (high / low).max(1.0)).min(1.6);
        (high > 0.0).then(|| Self(low / margin, high * margin))
    }
}

impl Ranged for Decades {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, v: &f64, limit: (i32, i32)) -> i32 {
        // Keeps zero off the logarithm.
        let s = (v.max(1e-300) / self.0).ln() / (self.1 / self.0).ln();
        limit.0 + (s * f64::from(limit.1 - limit.0)).round() as i32
    }

    fn key_points<H: KeyPointHint>(&self, _: H) -> Vec<f64> {
        let decades = (self.1 / self.0).log10();
        // Short axes need ticks between the powers of ten.
        let steps: &[f64] = if decades < 2.5 { &[1.0, 2.0, 5.0] } else { &[1.0] };
        let powers = self.0.log10().floor() as i32..=self.1.log10().ceil() as i32;
        powers
            .flat_map(|p| steps.iter().map(move |s| s * 10f64.powi(p)))
            .filter(|v| (self.0..=self.1).contains(v))
            .collect()
    }

    fn range(&self) -> Range<f64> {
        self.0..self.1
    }
}

impl ValueFormatter<f64> for Decades {
    fn format_ext(&self, v: &f64) -> String {
        if (1e-3..1e4).contains(v) {
            let digits = (-v.log10().floor()).max(0.0) as usize;
            format!("{v:.digits$}")
        } else {
            format!("{v:.0e}")
        }
    }
}

/// Error that a picture shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Shown {
    /// Error of displacements.
    Displacement,
    /// Error of velocities.
    Velocity,
}

impl Shown {
    /// Returns the name of the quantity.
    fn name(self) -> &'static str {
        match self {
            Self::Displacement => "displacement",
            Self::Velocity => "velocity",
        }
    }

    /// Returns the error of a run if it is positive, as a logarithmic axis needs.
    fn error_of(self, r: &Run) -> Option<f64> {
        let e = match self {
            Self::Displacement => r.errors.displacement,
            Self::Velocity => r.errors.velocity,
        };
        e.filter(|e| *e > 0.0)
    }
}

type Area<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;

/// Draws legend entries one below the other: a symbol and its words.
struct Legend<'a, 'b> {
    area: &'b Area<'a>,
    top: i32,
    row: i32,
}

impl Legend<'_, '_> {
    fn entry(&mut self, mark: Symbol, words: &str) -> std::result::Result<(), String> {
        let y = self.top + 26 * self.row;
        self.row += 1;
        let text = |e: &dyn std::fmt::Display| e.to_string();
        match mark {
            Symbol::Line(c) => self
                .area
                .draw(&PathElement::new([(0, y), (24, y)], c.stroke_width(2)))
                .map_err(|e| text(&e))?,
            Symbol::Dashes(c) => [0, 9, 18].iter().try_for_each(|x| {
                let dash = PathElement::new([(*x, y), (x + 6, y)], c.stroke_width(2));
                self.area.draw(&dash).map_err(|e| text(&e))
            })?,
            Symbol::Circle(c) => self
                .area
                .draw(&Circle::new((12, y), 5, c.stroke_width(2)))
                .map_err(|e| text(&e))?,
            Symbol::Disc(c) => self
                .area
                .draw(&Circle::new((12, y), 6, c.filled()))
                .map_err(|e| text(&e))?,
            Symbol::Triangle(c) => self
                .area
                .draw(&TriangleMarker::new((12, y), 7, c.filled()))
                .map_err(|e| text(&e))?,
            Symbol::Square(c) => self
                .area
                .draw(&Rectangle::new([(7, y - 5), (17, y + 5)], c.filled()))
                .map_err(|e| text(&e))?,
        }
        self.area
            .draw(&Text::new(words.to_owned(), (34, y - 8), ("sans-serif", 14)))
            .map_err(|e| text(&e))
    }
}

#[derive(Debug, Clone, Copy)]
enum Symbol {
    Line(RGBColor),
    Dashes(RGBColor),
    Circle(RGBColor),
    Disc(RGBColor),
    Triangle(RGBColor),
    Square(RGBColor),
}

/// Draws all pictures of a sweep. Returns their names and SVG texts.
pub(crate) fn pictures(file: &SweepFile, sweep: &Sweep, screen: Screen) -> Result<Vec<(String, String)>> {
    let mut out = Vec::new();
    for shown in [Shown::Displacement, Shown::Velocity] {
        if let Some(svg) = work_precision(sweep, shown, screen)? {
            out.push((format!("work-precision-{}", shown.name()), svg));
        }
    }
    if let Some(h) = &file.hook
        && let Some(svg) = hook(sweep, h, screen)?
    {
        out.push(("hook".to_owned(), svg));
    }
    Ok(out)
}

/// Draws the error over the time of all runs; `None` if no run has both.
fn work_precision(s: &Sweep, shown: Shown, screen: Screen) -> Result<Option<String>> {
    let name = format!("work-precision-{}", shown.name());
    let point = |r: &Run| Some((r.cost?, shown.error_of(r)?));
    let points: Vec<(&Run, (f64, f64))> = s.runs.iter().filter_map(|r| Some((r, point(r)?))).collect();
    // The reference has no error of its own, so its time is drawn as a line.
    let exact: Vec<f64> = s
        .runs
        .iter()
        .filter(|r| r.mark == Some(Mark::AllFine) && r.error_judged == Some(0.0))
        .filter_map(|r| r.cost)
        .collect();
    let times = points
        .iter()
        .map(|p| p.1.0)
        .chain(exact.iter().copied())
        .chain(s.floor_seconds);
    let (Some(x), Some(y)) = (Decades::over(times), Decades::over(points.iter().map(|p| p.1.1))) else {
        return Ok(None);
    };
    let mut svg = String::new();
    draw_work(&mut svg, (s, screen), shown, [x, y], &points, &exact).map_err(|e| undrawn(&name, &e))?;
    Ok(Some(svg))
}

fn draw_work(
    svg: &mut String,
    (s, screen): (&Sweep, Screen),
    shown: Shown,
    [x, y]: [Decades; 2],
    points: &[(&Run, (f64, f64))],
    exact: &[f64],
) -> std::result::Result<(), String> {
    let text = |e: &dyn std::fmt::Display| e.to_string();
    let (low, high) = (y.0, y.1);
    let (width, height) = screen.size(1);
    let root = SVGBackend::with_string(svg, (width, height)).into_drawing_area();
    root.fill(&WHITE).map_err(|e| text(&e))?;
    let (left, right) = match screen {
        Screen::Wide => root.split_horizontally(width as i32 - LEGEND.0),
        Screen::Narrow => root.split_vertically(height as i32 - LEGEND.1),
    };
    let (right, top) = match screen {
        Screen::Wide => (right, 60),
        Screen::Narrow => (right.margin(0, 0, 40, 0), 20),
    };
    let mut chart = ChartBuilder::on(&left)
        .caption(
            format!("Error of {} against time", shown.name()),
            ("sans-serif", 20),
        )
        .margin(14)
        .x_label_area_size(46)
        .y_label_area_size(84)
        .build_cartesian_2d(x, y)
        .map_err(|e| text(&e))?;
    chart
        .configure_mesh()
        .x_desc(format!("time of {} [s]", s.cost))
        .y_desc("relative error [-]")
        .label_style(("sans-serif", 14))
        .axis_desc_style(("sans-serif", 16))
        .light_line_style(TRANSPARENT)
        .bold_line_style(BLACK.mix(0.12))
        .draw()
        .map_err(|e| text(&e))?;
    let mut legend = Legend {
        area: &right,
        top,
        row: 0,
    };
    let coordinates: Points = points.iter().map(|p| p.1).collect();
    let overall = front(&coordinates);
    chart
        .draw_series(LineSeries::new(overall.iter().copied(), GREY.stroke_width(1)))
        .map_err(|e| text(&e))?;
    let coupled = points.iter().filter(|p| p.0.mark.is_none());
    let coupled_front = front(&coupled.map(|p| p.1).collect::<Points>());
    chart
        .draw_series(LineSeries::new(
            coupled_front.iter().copied(),
            BLUE.stroke_width(2),
        ))
        .map_err(|e| text(&e))?;
    for (value, colour, words) in exact
        .iter()
        .map(|v| (*v, GREEN, "all-fine reference"))
        .chain(s.floor_seconds.map(|v| (v, GREY, "fine region + overlap alone")))
    {
        let line = [(value, low), (value, high)];
        chart
            .draw_series(DashedLineSeries::new(line, 7, 5, colour.stroke_width(2)))
            .map_err(|e| text(&e))?;
        legend.entry(Symbol::Dashes(colour), words)?;
    }
    let seen = draw_points(&mut chart, points, &coupled_front)?;
    name_points(&mut legend, seen)?;
    if coupled_front.len() > 1 {
        legend.entry(Symbol::Line(BLUE), "front of the coupled runs")?;
    }
    if overall.len() > 1 {
        legend.entry(Symbol::Line(GREY), "front of all runs")?;
    }
    root.present().map_err(|e| text(&e))
}

/// Draws a mark for every run. Returns which of the four kinds of [`name_points`] were drawn.
fn draw_points(
    chart: &mut ChartContext<'_, SVGBackend<'_>, Cartesian2d<Decades, Decades>>,
    points: &[(&Run, (f64, f64))],
    coupled_front: &Points,
) -> std::result::Result<[bool; 4], String> {
    // The legend names only marks that occur.
    let mut seen = [false; 4];
    for (r, p) in points {
        let on_front = coupled_front.contains(p);
        let kind = match r.mark {
            Some(Mark::AllFine) => {
                chart
                    .draw_series([TriangleMarker::new(*p, 7, GREEN.filled())])
                    .map_err(|e| e.to_string())?;
                0
            }
            Some(Mark::AllCoarse) => {
                let square = EmptyElement::at(*p) + Rectangle::new([(-5, -5), (5, 5)], ORANGE.filled());
                chart.draw_series([square]).map_err(|e| e.to_string())?;
                1
            }
            None if on_front => {
                chart
                    .draw_series([Circle::new(*p, 6, BLUE.filled())])
                    .map_err(|e| e.to_string())?;
                2
            }
            None => {
                chart
                    .draw_series([Circle::new(*p, 5, BLUE.stroke_width(2))])
                    .map_err(|e| e.to_string())?;
                3
            }
        };
        seen[kind] = true;
    }
    Ok(seen)
}

fn name_points(legend: &mut Legend<'_, '_>, seen: [bool; 4]) -> std::result::Result<(), String> {
    let kinds = [
        (Symbol::Triangle(GREEN), "all-fine"),
        (Symbol::Square(ORANGE), "all-coarse"),
        (Symbol::Disc(BLUE), "coupled, best of them"),
        (Symbol::Circle(BLUE), "coupled"),
    ];
    for ((mark, words), _) in kinds.into_iter().zip(seen).filter(|(_, seen)| *seen) {
        legend.entry(mark, words)?;
    }
    Ok(())
}

/// Returns the Pareto front by rising time: points with a smaller error than all faster ones.
fn front(points: &[(f64, f64)]) -> Points {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let mut best = f64::INFINITY;
    // In ascending order of time, a run is on the front if it beats all runs before it.
    sorted.retain(|p| {
        let better = p.1 < best;
        best = best.min(p.1);
        better
    });
    sorted
}

/// Draws error and time over the values of an axis, side by side; `None` for fewer than two rows.
fn hook(s: &Sweep, hook: &Hook, screen: Screen) -> Result<Option<String>> {
    let rows = hook_rows(&s.runs, hook);
    if rows.len() < 2 {
        return Ok(None);
    }
    let mut svg = String::new();
    draw_hook(&mut svg, &rows, hook, s.cost, screen).map_err(|e| undrawn("hook", &e))?;
    Ok(Some(svg))
}

type Points = Vec<(f64, f64)>;

fn draw_hook(
    svg: &mut String,
    rows: &[HookRow],
    hook: &Hook,
    cost: &str,
    screen: Screen,
) -> std::result::Result<(), String> {
    let text = |e: &dyn std::fmt::Display| e.to_string();
    let (width, height) = screen.size(2);
    let root = SVGBackend::with_string(svg, (width, height)).into_drawing_area();
    root.fill(&WHITE).map_err(|e| text(&e))?;
    let (left, right) = match screen {
        Screen::Wide => root.split_horizontally(width as i32 / 2),
        Screen::Narrow => root.split_vertically(height as i32 / 2),
    };
    let name = hook.name.as_deref().unwrap_or(&hook.axis);
    let collect = |f: &dyn Fn(&HookRow) -> Option<f64>| -> Points {
        rows.iter()
            .filter_map(|r| Some((r.value, f(r).filter(|v| *v > 0.0)?)))
            .collect()
    };
    let mut errors = vec![
        ("displacement", BLUE, collect(&|r| r.displacement)),
        ("velocity", ORANGE, collect(&|r| r.velocity)),
    ];
    errors.retain(|e| !e.2.is_empty());
    // Guide line of slope 2 through the first point of the first curve.
    let guide: Points = errors.first().map_or_else(Vec::new, |e| {
        let (x, y) = e.2[0];
        let top = e.2.iter().map(|p| p.1).fold(0.0, f64::max);
        // The line ends where it would leave the picture, above the largest error or right of the last value.
        let end = e.2[e.2.len() - 1].0.min(x * (top / y).sqrt());
        vec![(x, y), (end, y * (end / x).powi(2))]
    });
    if !errors.is_empty() {
        panel(
            &left,
            [name, "relative error [-]"],
            &errors,
            Some(("slope 2", &guide)),
            None,
        )?;
    }
    let mut times = vec![("all", BLUE, collect(&|r| Some(r.cost)))];
    times.push(("fine region + overlap", GREY, collect(&|r| r.fine)));
    times.retain(|t| !t.2.is_empty());
    let label = format!("time of {cost} [s]");
    panel(&right, [name, &label], &times, None, hook.expected)?;
    root.present().map_err(|e| text(&e))
}

fn panel(
    area: &Area<'_>,
    [x_name, y_name]: [&str; 2],
    curves: &[(&str, RGBColor, Points)],
    guide: Option<(&str, &Points)>,
    expected: Option<f64>,
) -> std::result::Result<(), String> {
    let text = |e: &dyn std::fmt::Display| e.to_string();
    let all_points = || curves.iter().flat_map(|c| c.2.iter().copied());
    let (Some(x), Some(y)) = (
        Decades::over(all_points().map(|p| p.0)),
        Decades::over(all_points().map(|p| p.1)),
    ) else {
        return Ok(());
    };
    let (low, high) = (y.0, y.1);
    let mut chart = ChartBuilder::on(area)
        .margin(14)
        .margin_top(108)
        .x_label_area_size(46)
        .y_label_area_size(78)
        .build_cartesian_2d(x, y)
        .map_err(|e| text(&e))?;
    chart
        .configure_mesh()
        .x_desc(x_name)
        .y_desc(y_name)
        .label_style(("sans-serif", 14))
        .axis_desc_style(("sans-serif", 16))
        .light_line_style(TRANSPARENT)
        .bold_line_style(BLACK.mix(0.12))
        .draw()
        .map_err(|e| text(&e))?;
    // The legend stands above the curves, in the top margin.
    let strip = area.margin(0, 0, 92, 0);
    let mut legend = Legend {
        area: &strip,
        top: 24,
        row: 0,
    };
    for (name, colour, points) in curves {
        chart
            .draw_series(LineSeries::new(points.iter().copied(), colour.stroke_width(2)))
            .map_err(|e| text(&e))?;
        chart
            .draw_series(points.iter().map(|p| Circle::new(*p, 4, colour.filled())))
            .map_err(|e| text(&e))?;
        legend.entry(Symbol::Line(*colour), name)?;
    }
    if let Some((name, points)) = guide.filter(|g| g.1.len() == 2) {
        let line = DashedLineSeries::new(points.iter().copied(), 7, 5, GREY.stroke_width(2));
        chart.draw_series(line).map_err(|e| text(&e))?;
        legend.entry(Symbol::Dashes(GREY), name)?;
    }
    if let Some(v) = expected {
        let line = DashedLineSeries::new([(v, low), (v, high)], 7, 5, GREEN.stroke_width(2));
        chart.draw_series(line).map_err(|e| text(&e))?;
        legend.entry(Symbol::Dashes(GREEN), "least time expected")?;
    }
    Ok(())
}

/// Prepares a picture for a page: without its namespace the page contains no address at all.
pub(crate) fn inline(svg: &str) -> String {
    svg.replacen(" xmlns=\"http://www.w3.org/2000/svg\"", " role=\"img\"", 1)
}
