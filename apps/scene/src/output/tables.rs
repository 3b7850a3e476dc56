//! Tables of recorded values.

use super::{csv, fragments, put};
use crate::error::Result;
use crate::recorder::{Recorder, Table};
use crate::run::LoadStep;
use arlequin::core::Coupled;
use arlequin::dem_beam::fracture::{Break, SharedLog, locked};
use std::fmt::Write as _;
use std::path::Path;

/// Writes the tables of probes, energy, load steps, fragments and effects.
pub fn write(folder: &Path, r: &Recorder) -> Result<()> {
    for (name, table) in [("probes.csv", &r.probes), ("energy.csv", &r.energy)] {
        table_csv(&folder.join(name), table)?;
    }
    load_steps(folder, &r.load_steps)?;
    if !r.fragments.is_empty() {
        fragments::write(&folder.join("fragments.csv"), &r.fragments.rows)?;
    }
    if r.effects.names.is_empty() {
        return Ok(());
    }
    table_csv(&folder.join("effects.csv"), &r.effects)
}

fn table_csv(path: &Path, table: &Table) -> Result<()> {
    let times = std::iter::once(table.times.as_slice());
    let columns: Vec<&[f64]> = times.chain(table.columns.iter().map(Vec::as_slice)).collect();
    let names: Vec<String> = std::iter::once("time [s]".to_owned())
        .chain(table.names.iter().cloned())
        .collect();
    csv(path, &names, &columns)
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
    put(&folder.join("static.csv"), &[text.as_bytes()])
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
    put(&folder.join("breaks.csv"), &[text.as_bytes()])
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
