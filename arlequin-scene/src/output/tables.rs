//! Tables and plots of what was recorded.

use super::csv;
use super::plots::{self, Curve, Plot};
use crate::error::Result;
use crate::recorder::{ENERGY_COLUMNS, Recorder, Table};
use crate::spec::Quantity;
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

/// Draws the same into a folder.
pub fn plot(path: &Path, r: &Recorder, title: &str) -> Result<()> {
    for (quantity, file, name, unit) in [
        (Quantity::Displacement, "displacement.svg", "displacement", "m"),
        (Quantity::Velocity, "velocity.svg", "velocity", "m/s"),
        (Quantity::Rotation, "rotation.svg", "rotation", "rad"),
    ] {
        let mine = r.readers.iter().zip(&r.probes.columns);
        let curves = mine
            .filter(|(p, _)| p.quantity == quantity)
            .map(|(p, c)| Curve {
                name: p.name.clone(),
                times: &r.probes.times,
                values: c.clone(),
            })
            .collect();
        let title = headline(title, name);
        let plot = Plot::over_time(title, name, unit, curves);
        plots::draw(&path.join(file), &plot)?;
    }
    let curve = |name: &str, k: usize| Curve {
        name: name.to_owned(),
        times: &r.energy.times,
        values: r.energy.columns.get(k).cloned().unwrap_or_default(),
    };
    let curves = vec![curve("kinetic", 0), curve("internal", 1), curve("invariant H", 3)];
    let plot = Plot::over_time(headline(title, "energy"), "energy", "J", curves);
    plots::draw(&path.join("energy.svg"), &plot)?;
    let mut curves: Vec<_> = r
        .works
        .iter()
        .enumerate()
        .map(|(k, w)| curve(w, ENERGY_COLUMNS.len() + k))
        .collect();
    curves.push(curve("unexplained drift of H", 5));
    let plot = Plot::over_time(
        headline(title, "energy ledger"),
        "work since the start",
        "J",
        curves,
    );
    plots::draw(&path.join("ledger.svg"), &plot)
}

fn headline(title: &str, what: &str) -> String {
    if title.is_empty() {
        what.to_owned()
    } else {
        format!("{title}: {what}")
    }
}
