//! Tables of what was recorded.

use super::csv;
use crate::error::Result;
use crate::recorder::{Recorder, Table};
use arlequin::core::Coupled;
use arlequin::dem_beam::fracture::{Break, SharedLog, locked};
use std::path::Path;

/// Writes what probes, ledger and effects recorded.
pub fn write(folder: &Path, r: &Recorder) -> Result<()> {
    for (name, table) in [("probes.csv", &r.probes), ("energy.csv", &r.energy)] {
        table_csv(&folder.join(name), table)?;
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

/// One table of broken bonds per model whose bonds can break.
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
