//! The part of a model, mediator or body that the page shows: grid, fields over time, broken bonds.

use super::frames::{Frame, Series};
use super::grid::Grid;
use super::{CELLS, LINES, Plan, first};
use crate::error::{Result, value};
use arlequin::dem_beam::vtu::{Array, Section};
use std::collections::BTreeSet;

/// Frame number of a line that never breaks.
pub(super) const WHOLE: u16 = u16::MAX;
/// Number of a point that was left out.
const GONE: u32 = u32::MAX;
/// Name of the field that moves the points.
pub(super) const MOVE: &str = "displacement [m]";

/// One model, mediator or body of the picture.
#[derive(Debug)]
pub(super) struct Part {
    pub(super) name: String,
    pub(super) grid: Grid,
    /// Radii of the spheres \[m\]; empty if the points are not spheres.
    pub(super) radii: Vec<f64>,
    /// Centres of the cells that faces refer to \[m\].
    pub(super) centres: Vec<f64>,
    /// Frame at which each line breaks; empty if no line can break.
    pub(super) broken: Vec<u16>,
    pub(super) fields: Vec<Field>,
}

/// Values over time. Each is stored in 16 bits, scaled between the lowest and the highest value of its
/// component.
#[derive(Debug)]
pub(super) struct Field {
    /// Name with the unit.
    pub(super) name: String,
    pub(super) on_lines: bool,
    pub(super) components: usize,
    /// Number of frames; one if the values never change.
    pub(super) frames: usize,
    pub(super) low: Vec<f64>,
    pub(super) high: Vec<f64>,
    /// Values in the order frame, component, point.
    pub(super) values: Vec<u16>,
}

/// Numbers in the file of the points and lines that remain.
struct Kept {
    points: Vec<u32>,
    lines: Vec<u32>,
}

impl Part {
    /// Reads from a series the frames and points that `plan` selects.
    pub(super) fn read(series: &Series, plan: &Plan, notices: &mut Vec<String>) -> Result<Self> {
        let path = first(series);
        let mut frame = Frame::open(path)?;
        let mut full = Grid::read_from(&mut frame, path)?;
        let mut notify = |text: String| notices.push(format!("'{}': {text}", series.name));
        if full.unknown > 0 {
            notify(format!(
                "{} cells of kinds that this page does not draw",
                full.unknown
            ));
        }
        let radii = match frame.find(Section::PointData, "radius [m]") {
            Some(a) => frame.numbers(&a)?,
            None => Vec::new(),
        };
        if full.ends.len() > CELLS && !full.faces.is_empty() {
            full.hollow();
            notify("its surface alone is shown, and what is within only where a cut opens no cells".into());
        }
        let broken = breaks(series, plan, full.ends.len())?;
        let (grid, centres, kept) = reduced(&full, !radii.is_empty(), plan.share, &broken);
        if kept.lines.len() < full.lines.len() && plan.share >= 1.0 {
            notify(format!(
                "{} of {} bonds are shown, all broken ones among them",
                kept.lines.len(),
                full.lines.len()
            ));
        }
        let fields = fields(series, plan, &full, &kept)?;
        let selected = |list: &[u32], all: &[u16]| list.iter().map(|k| all[*k as usize]).collect();
        Ok(Self {
            name: series.name.clone(),
            radii: drawn(&radii, &kept, plan.share),
            broken: if broken.is_empty() {
                broken
            } else {
                selected(&kept.lines, &broken)
            },
            grid,
            centres,
            fields,
        })
    }
}

/// Returns the radii of the remaining particles. If particles were left out, those drawn at random are
/// enlarged by `share^(-1/3)`, so that together they fill the same volume.
fn drawn(radii: &[f64], kept: &Kept, share: f64) -> Vec<f64> {
    let limit = (share * f64::from(u32::MAX)) as u32;
    let size = |k: &u32| {
        if share < 1.0 && scattered(*k) <= limit {
            share.cbrt().recip()
        } else {
            1.0
        }
    };
    let points = kept.points.iter().filter(|_| !radii.is_empty());
    points.map(|k| radii[*k as usize] * size(k)).collect()
}

/// Returns for each cell the first frame at which it is broken.
fn breaks(series: &Series, plan: &Plan, cells: usize) -> Result<Vec<u16>> {
    let mut out = Vec::new();
    for (k, path) in plan.times.iter().filter_map(|t| series.file_at(*t)).enumerate() {
        let mut frame = Frame::open(path)?;
        let Some(array) = frame.find(Section::CellData, "broken [-]") else {
            return Ok(out);
        };
        let now = frame.numbers(&array)?;
        out.resize(cells, WHOLE);
        for (first_broken, value) in out.iter_mut().zip(now) {
            // Lower values are the damage of beams that soften.
            if *first_broken == WHOLE && value >= 1.0 {
                *first_broken = k as u16;
            }
        }
    }
    Ok(out)
}

/// Reduces a grid to the points that remain. Returns the grid, the centres of its cells, and the numbers
/// of the remaining points and lines.
fn reduced(full: &Grid, grains: bool, share: f64, broken: &[u16]) -> (Grid, Vec<f64>, Kept) {
    let count = full.points.len() / 3;
    let mut wanted = vec![grains || full.faces.is_empty(); count];
    if grains && share < 1.0 {
        let limit = (share * f64::from(u32::MAX)) as u32;
        for (k, w) in wanted.iter_mut().enumerate() {
            *w = scattered(k as u32) <= limit;
        }
        // Particles at broken bonds remain too, unless they alone are more than the share.
        cracked(full, broken)
            .filter(|ends| ends.len() as f64 <= share * count as f64)
            .into_iter()
            .flatten()
            .for_each(|i| wanted[i as usize] = true);
    }
    full.faces
        .iter()
        .flat_map(|f| &f[..4])
        .for_each(|i| wanted[*i as usize] = true);
    let mut number = vec![GONE; count];
    let mut points = Vec::new();
    for k in (0..count).filter(|k| wanted[*k]) {
        number[k] = points.len() as u32;
        points.push(k as u32);
    }
    let stays = |l: &&[u32; 3]| l[..2].iter().all(|i| number[*i as usize] != GONE);
    let mut lines: Vec<[u32; 3]> = full.lines.iter().filter(stays).copied().collect();
    // Too many lines to draw: only broken ones remain.
    if lines.len() > LINES {
        lines.retain(|l| broken.get(l[2] as usize).is_some_and(|b| *b != WHOLE));
    }
    let (mut cells, mut centres) = (vec![GONE; full.ends.len()], Vec::new());
    let all_centres = full.centres();
    let mut faces = full.faces.clone();
    for face in &mut faces {
        face[..4].iter_mut().for_each(|i| *i = number[*i as usize]);
        for cell in face[4..].iter_mut().filter(|c| **c != super::grid::OUTSIDE) {
            let k = *cell as usize;
            if cells[k] == GONE {
                cells[k] = (centres.len() / 3) as u32;
                centres.extend(&all_centres[3 * k..3 * k + 3]);
            }
            *cell = cells[k];
        }
    }
    let grid = Grid {
        points: points
            .iter()
            .flat_map(|k| &full.points[3 * *k as usize..][..3])
            .copied()
            .collect(),
        faces,
        lines: lines
            .iter()
            .map(|l| [number[l[0] as usize], number[l[1] as usize], l[2]])
            .collect(),
        ..Grid::default()
    };
    let lines = lines.iter().map(|l| l[2]).collect();
    (grid, centres, Kept { points, lines })
}

/// Returns a hash of a particle number, so that a limit on it selects particles evenly in space.
fn scattered(k: u32) -> u32 {
    // The golden-ratio multiplier, then the multipliers of MurmurHash3's final mix.
    let h = k.wrapping_mul(0x9e37_79b1);
    let h = (h ^ (h >> 15)).wrapping_mul(0x85eb_ca6b);
    (h ^ (h >> 13)).wrapping_mul(0xc2b2_ae35)
}

/// Returns the particles with broken bonds, which show cracks; `None` if there are none.
fn cracked(full: &Grid, broken: &[u16]) -> Option<BTreeSet<u32>> {
    let is_broken = |l: &&[u32; 3]| broken.get(l[2] as usize).is_some_and(|b| *b != WHOLE);
    let ends: BTreeSet<u32> = full
        .lines
        .iter()
        .filter(is_broken)
        .flat_map(|l| [l[0], l[1]])
        .collect();
    (!ends.is_empty()).then_some(ends)
}

/// Reads all fields over the selected frames.
fn fields(series: &Series, plan: &Plan, full: &Grid, kept: &Kept) -> Result<Vec<Field>> {
    let frame = Frame::open(first(series))?;
    let is_value = |a: &&Array| matches!(a.section, Section::PointData | Section::CellData);
    let shown = |a: &&Array| is_value(a) && a.name != "radius [m]" && a.name != "broken [-]";
    let mut wanted: Vec<Array> = frame.arrays.iter().filter(shown).cloned().collect();
    let moves = wanted.iter().any(|a| a.name == MOVE);
    // Without displacements the motion is read from the positions of each frame.
    if !moves {
        wanted.extend(frame.positions());
    }
    let mut out = Vec::new();
    for array in &wanted {
        let on_lines = array.section == Section::CellData && full.faces.is_empty();
        if on_lines && kept.lines.is_empty() {
            continue;
        }
        let mut frames = Vec::new();
        for path in plan.times.iter().filter_map(|t| series.file_at(*t)) {
            let mut frame = Frame::open(path)?;
            let current = match array.section {
                Section::Points => frame.positions(),
                section => frame.find(section, &array.name),
            };
            let current = current
                .filter(|f| f.components == array.components)
                .ok_or_else(|| {
                    let rule = format!(
                        "has no array '{}' as the first frame; make the run again",
                        array.name
                    );
                    value("DIR", path.display(), &rule)
                })?;
            let mut values = frame.numbers(&current)?;
            if array.section == Section::Points {
                // The array holds positions; the page needs displacements.
                values.iter_mut().zip(&full.points).for_each(|(v, x)| *v -= x);
            } else if array.section == Section::CellData && !on_lines {
                values = full.at_points(&values, array.components);
            }
            let list = if on_lines { &kept.lines } else { &kept.points };
            frames.push(picked(&values, array.components, list));
        }
        let name = if array.section == Section::Points {
            MOVE
        } else {
            &array.name
        };
        let mean = array.section == Section::CellData && !on_lines;
        let name = if mean {
            format!("{name}, mean at nodes")
        } else {
            name.to_owned()
        };
        let field = quantised(name, on_lines, array.components, frames);
        // Points that do not move need no displacement field.
        if array.section != Section::Points || field.frames > 1 {
            out.push(field);
        }
    }
    Ok(out)
}

/// Selects the values of the points or lines in `list`, component after component.
fn picked(values: &[f64], components: usize, list: &[u32]) -> Vec<f32> {
    let component = |c: usize| {
        list.iter()
            .map(move |k| values[*k as usize * components + c] as f32)
    };
    (0..components).flat_map(component).collect()
}

/// Scales values over all frames to 16 bits, each component between its own lowest and highest value.
fn quantised(name: String, on_lines: bool, components: usize, mut frames: Vec<Vec<f32>>) -> Field {
    // A field that never changes is stored once.
    if frames.windows(2).all(|w| w[0] == w[1]) {
        frames.truncate(1);
    }
    let count = frames.first().map_or(0, |f| f.len() / components);
    let (mut low, mut high) = (vec![0.0; components], vec![0.0; components]);
    for c in 0..components {
        let finite_values = || {
            frames
                .iter()
                .flat_map(|f| &f[c * count..(c + 1) * count])
                .filter(|v| v.is_finite())
        };
        low[c] = f64::from(finite_values().copied().fold(f32::INFINITY, f32::min));
        high[c] = f64::from(finite_values().copied().fold(f32::NEG_INFINITY, f32::max));
        // No finite value: any range will do.
        if low[c] > high[c] {
            (low[c], high[c]) = (0.0, 0.0);
        }
    }
    let short = |v: f32, c: usize| {
        // A constant field has no width.
        let width = (high[c] - low[c]).max(f64::MIN_POSITIVE);
        ((f64::from(v) - low[c]) / width * f64::from(u16::MAX)).round() as u16
    };
    let of_frame = |f: &Vec<f32>| {
        f.iter()
            .enumerate()
            .map(|(k, v)| short(*v, k / count.max(1)))
            .collect::<Vec<u16>>()
    };
    Field {
        name,
        on_lines,
        components,
        frames: frames.len(),
        values: frames.iter().flat_map(of_frame).collect(),
        low,
        high,
    }
}
