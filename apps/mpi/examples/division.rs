//! Prints what ranks hold and send: `cargo run --release -p arlequin-mpi --example division -- 47`.
//!
//! The argument is the number of cells along each edge, of a lattice of particles and of blocks of finite
//! elements, or the name of a Gmsh mesh.
#![allow(clippy::print_stdout, reason = "a table is all it makes")]

use arlequin_core::nalgebra::Point3;
use arlequin_core::ranks::{Division, Halo, UNIT, Unit};
use arlequin_core::{Elastic, Model};
use arlequin_mpi::threads;
use dem_beam::packing::{Lattice, lattice};
use dem_beam::{BeamMaterial, DemModel};
use fem_ref::{ElementKind, FemModel, Mesh, generate, gmsh};
use std::error::Error;
use std::time::Duration;

type Done<R> = Result<R, Box<dyn Error>>;

/// Numbers of nodes, ghosts, sent nodes and peers.
fn counts(nodes: usize, halo: Option<&Halo>) -> [usize; 4] {
    halo.map_or([nodes, 0, 0, 0], |h| {
        [nodes, h.ghosts().len(), h.sent(), h.peers()]
    })
}

fn table(
    what: &str,
    units: &[Unit],
    nodes: usize,
    bytes: usize,
    of_rank: impl Fn(usize) -> Done<Vec<[usize; 4]>>,
) -> Done<()> {
    println!("{what}: {nodes} nodes, {} units of {UNIT}", units.len());
    println!("ranks | nodes | ghosts | messages | kB sent per step | held over N/P | imbalance %");
    for ranks in [2, 4, 8] {
        let counts = of_rank(ranks)?;
        let most = |k: usize| counts.iter().map(|c| c[k]).max().unwrap_or(0);
        let held = counts.iter().map(|c| c[0] + c[1]).max().unwrap_or(0);
        println!(
            "{ranks} | {} | {} | {} | {:.0} | {:.2} | {:.1}",
            most(0),
            most(1),
            most(3),
            (bytes * most(2)) as f64 / 1e3,
            (held * ranks) as f64 / nodes as f64,
            100.0 * Division::bisect(nodes, units, ranks)?.imbalance()
        );
    }
    Ok(())
}

fn elements(what: &str, mesh: &Mesh<f64>) -> Done<()> {
    let whole = FemModel::new(what, mesh.clone(), Elastic::new(75e9, 0.17, 2200.0)?)?;
    table(what, &whole.units(), whole.nodes().len(), 24, |ranks| {
        let part = |c| {
            let mut model = whole.clone();
            model.partition_among(&c)?;
            Ok::<_, arlequin_core::Error>(counts(model.nodes().len(), model.halo()))
        };
        let results = threads::run(ranks, 1, Duration::from_secs(60), part).into_iter();
        results.map(|result| Ok(result??)).collect()
    })?;
    times(mesh)
}

/// Number of timed force evaluations.
const TIMED: u32 = 20;

/// Returns the processor time of this thread \[s\] as Linux reports it.
fn busy() -> f64 {
    let schedule = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    let first = schedule.split(' ').next().and_then(|ns| ns.parse().ok());
    first.map_or(f64::NAN, |ns: f64| 1e-9 * ns)
}

/// Prints the processor time of a force evaluation on the busiest rank, without its waits: the least of three
/// rounds in turns.
fn times(mesh: &Mesh<f64>) -> Done<()> {
    let whole = FemModel::new("timed", mesh.clone(), Elastic::new(75e9, 0.17, 2200.0)?)?;
    let mut least = [f64::INFINITY; 3];
    for _ in 0..3 {
        for (least, ranks) in least.iter_mut().zip([1, 2, 4]) {
            let part = |c| {
                let mut model = whole.clone();
                model.partition_among(&c)?;
                let q = vec![1e-6; model.layout().dofs()];
                let mut f = vec![0.0; q.len()];
                let start = busy();
                (0..TIMED).try_for_each(|_| model.add_internal_forces(&q, &mut f))?;
                Ok::<_, arlequin_core::Error>((busy() - start) / f64::from(TIMED))
            };
            let mut most: f64 = 0.0;
            for result in threads::run(ranks, 1, Duration::from_secs(60), part) {
                most = most.max(result??);
            }
            *least = least.min(most);
        }
    }
    let [single, two, four] = least.map(|t| 1e3 * t);
    println!("ms of processor time per evaluation of forces, 1, 2, 4 ranks: {single:.2} {two:.2} {four:.2}");
    Ok(())
}

fn particles(cells: usize) -> Done<()> {
    let cube = lattice(Lattice::BodyCentred, [cells; 3], 1e-4)?;
    let model = || DemModel::new("cube", &cube, BeamMaterial::SILICA, 2200.0);
    let whole = model()?;
    let (n, units) = (whole.nodes().len(), whole.units());
    table("particles", &units, n, 56, |ranks| {
        let division = Division::bisect(n, &units, ranks)?;
        let part = |c| {
            let part = model()?.partition_among(&division, c)?;
            Ok::<_, dem_beam::Error>(counts(part.nodes().len(), part.halo()))
        };
        let results = threads::run(ranks, 1, Duration::from_secs(60), part).into_iter();
        results.map(|result| Ok(result??)).collect()
    })
}

fn main() -> Done<()> {
    let asked = std::env::args().nth(1).unwrap_or_else(|| "24".into());
    if asked.ends_with(".msh") {
        return elements("elements of Gmsh", &gmsh::load(asked)?);
    }
    let cells = asked.parse()?;
    particles(cells)?;
    let far = Point3::new(1.0, 1.0, 1.0);
    for (what, kind) in [
        ("hexahedra", ElementKind::Hex8),
        ("tetrahedra", ElementKind::Tet4),
    ] {
        elements(what, &generate::block(kind, Point3::origin(), far, [cells; 3])?)?;
    }
    Ok(())
}
