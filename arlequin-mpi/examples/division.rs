//! What ranks hold, send and wait for: `cargo run --release -p arlequin-mpi --example division -- 47`, the cells of a cubic lattice
//! along each edge.
#![allow(clippy::print_stdout, reason = "a table is all it makes")]

use arlequin_core::Model;
use arlequin_core::ranks::{Division, UNIT};
use arlequin_mpi::threads;
use dem_beam::packing::{Lattice, lattice};
use dem_beam::{BeamMaterial, DemModel};
use std::time::Duration;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let cells = std::env::args().nth(1).map_or(Ok(24), |a| a.parse())?;
    let cube = lattice(Lattice::BodyCentred, [cells; 3], 1e-4)?;
    let model = || DemModel::new("cube", &cube, BeamMaterial::SILICA, 2200.0);
    let whole = model()?;
    let (n, units) = (whole.nodes().len(), whole.units());
    println!(
        "{n} particles, {} bonds, {} units of {UNIT}",
        whole.body().pairs().len(),
        units.len()
    );
    println!("ranks | particles | ghosts | messages | kB sent per step | held over N/P | imbalance %");
    for ranks in [1, 2, 4, 8] {
        let division = Division::bisect(n, &units, ranks)?;
        let of_rank = |c| {
            let part = model()?.share_out(&division, c)?;
            let halo = part
                .halo()
                .map_or([0; 3], |h| [h.ghosts().len(), h.sent(), h.peers()]);
            Ok::<_, dem_beam::Error>((part.nodes().len(), halo))
        };
        let (mut held, mut most) = (0, [0; 3]);
        for of in threads::run(ranks, 1, Duration::from_secs(60), of_rank) {
            let (own, halo) = of??;
            held = held.max(own);
            (0..3).for_each(|k| most[k] = most[k].max(halo[k]));
        }
        let [ghosts, sent, peers] = most;
        println!(
            "{ranks} | {held} | {ghosts} | {peers} | {:.0} | {:.2} | {:.1}",
            56e-3 * sent as f64,
            (held + ghosts) as f64 * ranks as f64 / n as f64,
            100.0 * division.imbalance()
        );
    }
    Ok(())
}
