//! Tables of recorded values: probes, energy and effects over time, load steps and broken bonds.

use super::mark::{self, TABLES};
use super::summary::{Conversion, LoadStep};
use super::{csv, put};
use crate::error::{Result, write};
use arlequin::core::Coupled;
use arlequin::dem_beam::fracture::{Break, SharedLog, locked};
use serde::{Deserialize, Serialize};
use std::fmt::Write as _;
use std::fs::File;
use std::io::Write as _;
use std::path::Path;
use std::time::{Duration, Instant};

/// Columns of values over time.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Table {
    /// Names of the columns, with units.
    #[serde(skip)]
    pub names: Vec<String>,
    /// Times \[s\].
    pub times: Vec<f64>,
    /// Columns.
    pub columns: Vec<Vec<f64>>,
}

impl Table {
    pub(crate) fn new(names: impl IntoIterator<Item = String>) -> Self {
        let names: Vec<String> = names.into_iter().collect();
        Self {
            columns: vec![Vec::new(); names.len()],
            names,
            times: Vec::new(),
        }
    }

    pub(crate) fn push(&mut self, time: f64, row: impl Iterator<Item = f64>) {
        self.times.push(time);
        self.columns.iter_mut().zip(row).for_each(|(c, x)| c.push(x));
    }

    /// Continues with the rows recorded before, if any.
    pub(crate) fn resume(&mut self, from: Self) {
        if !from.times.is_empty() {
            (self.times, self.columns) = (from.times, from.columns);
        }
    }

    /// Returns a column by its name.
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        let k = self.names.iter().position(|n| n == name)?;
        Some(&self.columns[k])
    }

    /// Rows from number `first` on, as comma-separated values, with the headings before row 0.
    fn text(&self, first: usize) -> String {
        let mut text = String::new();
        if first == 0 {
            text += "time [s]";
            self.names.iter().for_each(|n| {
                text.push(',');
                text += n;
            });
            text.push('\n');
        }
        for k in first..self.times.len() {
            let _ = write!(text, "{:e}", self.times[k]);
            for c in &self.columns {
                let _ = write!(text, ",{:e}", c[k]);
            }
            text.push('\n');
        }
        text
    }
}

/// Writes the tables of probes, energy and effects; without effects, the last one has no file.
pub(crate) fn write_all(folder: &Path, tables: [&Table; 3]) -> Result<()> {
    for (name, table) in TABLES.into_iter().zip(tables) {
        if name != TABLES[2] || !table.names.is_empty() {
            put(&folder.join(name), &[table.text(0).as_bytes()])?;
        }
    }
    Ok(())
}

/// Longest time between rows being recorded and written.
const WAIT: Duration = Duration::from_secs(1);

/// Counts the rows written during a run, so that they can be read before it ends.
#[derive(Debug)]
pub(crate) struct Live {
    last: Instant,
    rows: [usize; 3],
}

impl Live {
    /// Starts with no row written. The rows of an earlier part of a resumed run are written again.
    pub(crate) fn new() -> Self {
        Self {
            last: Instant::now(),
            rows: [0; 3],
        }
    }

    /// Appends the new rows if the last write is [`WAIT`] ago or a frame was written.
    pub(crate) fn flush(&mut self, folder: &Path, tables: [&Table; 3], framed: bool) -> Result<()> {
        // With every frame, so that tables and pictures that are read during a run go together.
        if !framed && self.last.elapsed() < WAIT {
            return Ok(());
        }
        for ((name, table), rows) in TABLES.into_iter().zip(tables).zip(&mut self.rows) {
            if table.names.is_empty() {
                continue;
            }
            let mut options = File::options();
            // The first write replaces the table of an earlier run.
            if *rows == 0 {
                options.create(true).write(true).truncate(true);
            } else {
                options.append(true);
            }
            let path = folder.join(name);
            let mut file = options.open(&path).map_err(write(&path))?;
            file.write_all(table.text(*rows).as_bytes())
                .map_err(write(&path))?;
            *rows = table.times.len();
        }
        // After the writes: a slow disk then does not take all of the time.
        self.last = Instant::now();
        Ok(())
    }
}

/// Writes method, residual and iterations of the load steps, if there are any.
pub(crate) fn load_steps(folder: &Path, steps: &[LoadStep]) -> Result<()> {
    if steps.is_empty() {
        return Ok(());
    }
    let mut text = "time [s],method,residual [-],iterations [-],internal [J]\n".to_owned();
    for s in steps {
        let _ = writeln!(
            text,
            "{:e},{},{:e},{},{:e}",
            s.time, s.method, s.residual, s.iterations, s.energy
        );
    }
    put(&folder.join(mark::LOAD_STEPS), &[text.as_bytes()])
}

/// Writes the changes of a zone that follows, if there are any.
pub(crate) fn conversions(folder: &Path, changes: &[Conversion]) -> Result<()> {
    if changes.is_empty() {
        return Ok(());
    }
    let mut text = "time [s],step,elements before,elements,spheres before,spheres,work [J],potential [J],kinetic [J],rigid motion [J],\
                    start [J],closing jumps [J],cost [s]\n"
        .to_owned();
    for c in changes {
        let ([a, b], [m, n], [potential, kinetic, rigid, start]) = (c.cells, c.spheres, c.parts);
        let _ = writeln!(
            text,
            "{:e},{},{a},{b},{m},{n},{:e},{potential:e},{kinetic:e},{rigid:e},{start:e},{:e},{:e}",
            c.time, c.step, c.work, c.closing, c.seconds
        );
    }
    put(&folder.join(mark::ZONES), &[text.as_bytes()])
}

/// Writes all broken bonds of all models in the order of time. [`breaks`] has more columns, per model.
pub fn all_breaks(folder: &Path, run: &Coupled<f64>, breaks: &[Option<SharedLog>]) -> Result<()> {
    let mut rows: Vec<(usize, Break)> = Vec::new();
    for (k, log) in breaks.iter().enumerate() {
        let events = log.iter().flat_map(|log| locked(log).events().to_vec());
        rows.extend(events.map(|e| (k, e)));
    }
    if breaks.iter().all(Option::is_none) {
        return Ok(());
    }
    // A stable sort: breaks at one time keep the order of models and of their logs.
    rows.sort_by(|a, b| a.1.time.total_cmp(&b.1.time));
    let mut text = "time [s],model,x [m],y [m],z [m],mode,released [J],in an overlap [-]\n".to_owned();
    for (k, e) in &rows {
        let model = run.subdomains()[*k].model().name();
        let (p, mode) = (&e.place, e.mode.name());
        let overlap = u8::from(e.overlap);
        let _ = writeln!(
            text,
            "{:e},{model},{:e},{:e},{:e},{mode},{:e},{overlap}",
            e.time, p.x, p.y, p.z, e.released
        );
    }
    put(&folder.join(mark::BREAKS), &[text.as_bytes()])
}

/// Writes one table of broken bonds per model whose bonds can break.
pub fn breaks(folder: &Path, run: &Coupled<f64>, breaks: &[Option<SharedLog>]) -> Result<()> {
    let names = [
        "time [s]",
        "bond [-]",
        "first particle [-]",
        "second particle [-]",
        "released [J]",
        "distance [m]",
        "x [m]",
        "y [m]",
        "z [m]",
        "in an overlap [-]",
    ];
    for (s, log) in run.subdomains().iter().zip(breaks) {
        let Some(log) = log else { continue };
        let log = locked(log);
        let column = |f: fn(&Break) -> f64| log.events().iter().map(f).collect::<Vec<f64>>();
        let table = [
            column(|e| e.time),
            column(|e| f64::from(e.bond)),
            column(|e| f64::from(e.pair[0])),
            column(|e| f64::from(e.pair[1])),
            column(|e| e.released),
            column(|e| e.distance),
            column(|e| e.place.x),
            column(|e| e.place.y),
            column(|e| e.place.z),
            column(|e| f64::from(u8::from(e.overlap))),
        ];
        let path = folder.join(format!("fracture-{}.csv", s.model().name()));
        let columns: Vec<&[f64]> = table.iter().map(Vec::as_slice).collect();
        csv(&path, &names.map(str::to_owned), &columns)?;
    }
    Ok(())
}
