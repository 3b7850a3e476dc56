//! `arlequin view`: writes one self-contained web page from the files of a run.

pub(crate) mod curves;
pub(crate) mod frames;
mod grid;
mod page;
mod part;
mod pieces;

use crate::error::{Result, write};
use crate::{figures, report};
use arlequin::dem_beam::vtu::{Array, Section};
use arlequin_scene::output::{Folder, mark};
use frames::{Frame, Series};
use part::Part;
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Arguments of `arlequin view`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Folder of results.
    folder: PathBuf,
    /// Page to write [default: view.html in the folder]
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
    /// Data to keep, before compression to about a half; more is thinned, and the page says how.
    #[arg(long, value_name = "N", default_value_t = 48)]
    megabytes: usize,
}

/// Frames that remain before particles are left out as well.
const FRAMES: usize = 20;
/// Largest number of cells of a mesh that is drawn whole; of larger meshes only the surface is drawn.
const CELLS: usize = 250_000;
/// Largest number of lines; beyond it only broken ones are drawn.
pub(super) const LINES: usize = 400_000;

/// Runs `arlequin view`: writes the page.
pub(crate) fn view(a: &Arguments) -> Result<()> {
    let (folder, mut notices) = present(&a.folder);
    let html = a.html.clone().unwrap_or_else(|| folder.join("view.html"));
    mark::generated("--html", &html, page::HEAD)?;
    let summary = std::fs::read_to_string(folder.join("summary.json")).unwrap_or_default();
    let summary: Value = serde_json::from_str(&summary).unwrap_or_default();
    if summary.is_null() {
        notices.push(
            "There is no summary.json: the run goes on or was killed. The page shows what was there.".into(),
        );
    }
    let plots = curves::read(&folder);
    let (times, parts) = match frames::index(&folder) {
        // Tables alone are worth a page.
        Err(_) if !plots.is_empty() => {
            notices.push("There are no frames.".into());
            (Vec::new(), Vec::new())
        }
        index => pictures(index?, a.megabytes, summary.is_null(), &mut notices)?,
    };
    for n in &notices {
        report::entry("notice", n);
    }
    let warnings = summary["warnings"].as_array().into_iter().flatten();
    notices.extend(warnings.filter_map(|w| Some(format!("Warning: {}", w.as_str()?))));
    let figures = figures::read(&folder, &summary);
    let name = a.folder.file_name().unwrap_or_default().to_string_lossy();
    let text = page::html(&page::Content {
        name: name.into_owned(),
        summary,
        times,
        parts,
        plots,
        figures,
        notices,
    })?;
    std::fs::write(&html, &text).map_err(write(&html))?;
    let size = text.len() as f64 / 1e6;
    report::line(&format!("written    {} ({size:.1} MB)", html.display()));
    Ok(())
}

/// Returns the folder that has the files: that of a run that goes on if there are no results yet, with a
/// notice of it.
fn present(target: &Path) -> (PathBuf, Vec<String>) {
    let folder = Folder::left_behind(target);
    if target.exists() || folder == target {
        return (target.to_owned(), Vec::new());
    }
    let notice = format!(
        "'{}' is not there yet; the page shows '{}'.",
        target.display(),
        folder.display()
    );
    (folder, vec![notice])
}

/// Reads the frames of all parts, at the times that fit into the page. Frames at the end that cannot be read
/// are left out if the run is `unfinished`.
fn pictures(
    mut all: Vec<Series>,
    megabytes: usize,
    unfinished: bool,
    notices: &mut Vec<String>,
) -> Result<(Vec<f64>, Vec<Part>)> {
    for s in all.iter_mut().filter(|_| unfinished) {
        while s.files.len() > 1 && s.files.last().is_some_and(|f| Frame::open(&f.1).is_err()) {
            s.files.pop();
        }
    }
    let plan = Plan::new(&all, megabytes.max(1) * 1_000_000)?;
    notices.extend(plan.notices.iter().cloned());
    let mut parts = Vec::new();
    for s in &all {
        if keeps_its_points(s, &plan.times)? {
            parts.push(Part::read(s, &plan, notices)?);
        } else {
            notices.push(format!(
                "'{}' is left out: its points are others in later frames, as the overlap of a zone that moves",
                s.name
            ));
        }
    }
    Ok((plan.times, parts))
}

/// Returns whether all frames of a series at these times have as many points and cells as its first one.
fn keeps_its_points(series: &Series, times: &[f64]) -> Result<bool> {
    let start = Frame::open(first(series))?;
    for path in times.iter().filter_map(|t| series.file_at(*t)) {
        let frame = Frame::open(path)?;
        if (frame.points, frame.cells) != (start.points, start.cells) {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Selection of the frames and particles of a run that the page shows.
#[derive(Debug)]
pub(super) struct Plan {
    /// Times of the frames \[s\].
    times: Vec<f64>,
    /// Share of the particles that remain, between 0 and 1.
    share: f64,
    notices: Vec<String>,
}

impl Plan {
    /// Selects what fits into `bytes`: leaves out frames first, down to [`FRAMES`], then particles.
    fn new(series: &[Series], bytes: usize) -> Result<Self> {
        let mut times: Vec<f64> = series.iter().flat_map(|s| s.files.iter().map(|f| f.0)).collect();
        times.sort_by(f64::total_cmp);
        times.dedup();
        let (mut grains, mut mesh_bytes, mut count) = (0, 0, 0);
        for s in series {
            let frame = Frame::open(first(s))?;
            // The page stores two bytes per value.
            let bytes_per_item = |section: Section| -> usize {
                let varying = frame.arrays.iter().filter(|a| a.section == section && varies(a));
                varying.map(|a| 2 * a.components).sum()
            };
            let (of_point, of_cell) = (
                bytes_per_item(Section::PointData),
                bytes_per_item(Section::CellData),
            );
            if frame.find(Section::PointData, "radius [m]").is_some() {
                grains += of_point * frame.points + of_cell * frame.cells;
                count += frame.points;
            } else if frame.cells > CELLS {
                // Estimated number of surface points: a cube of n points has about 6 n^(2/3) on its
                // surface.
                mesh_bytes += (of_point + of_cell) * 6 * (frame.points as f64).powf(2.0 / 3.0) as usize;
            } else {
                mesh_bytes += (of_point + of_cell) * frame.points;
            }
        }
        let mut notices = Vec::new();
        let total = times.len();
        // At least `FRAMES` frames, or all if there are fewer.
        let fits = (bytes / (grains + mesh_bytes).max(1))
            .max(FRAMES.min(total))
            .max(1);
        if fits < total {
            let last = total - 1;
            times = (0..fits).map(|k| times[k * last / (fits - 1).max(1)]).collect();
            notices.push(format!(
                "{fits} of {total} frames are shown; more with --megabytes"
            ));
        }
        let room = (bytes / times.len()).saturating_sub(mesh_bytes) as f64;
        // At least 0.2 % of the particles remain, however small the limit.
        let share = (room / grains.max(1) as f64).clamp(0.002, 1.0);
        if share < 1.0 {
            let shown = share * count as f64;
            notices.push(format!(
                "about {shown:.0} of {count} particles are shown, larger than they are, and all with broken bonds; more with \
                 --megabytes"
            ));
        }
        Ok(Self {
            times,
            share,
            notices,
        })
    }
}

fn first(series: &Series) -> &Path {
    &series.files[0].1
}

/// Returns whether an array may change over time.
fn varies(array: &Array) -> bool {
    const FIXED: [&str; 5] = ["alpha", "beta", "gamma", "radius [m]", "broken [-]"];
    !FIXED.contains(&array.name.as_str())
}
