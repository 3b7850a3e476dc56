//! Writes a packing as a LAMMPS data file (`atom_style bpm/sphere`), for the side-by-side timing described in
//! `benches/README.md`: `lammps_export [particles] [file]`; default 20 000 and `beam.data`.
//!
//! The packing is that of the kernel bench, in the kernel's numbering, so that both codes start with the same
//! locality. The printed `-var` options for LAMMPS are the stiffnesses of a bond of mean length.
#![allow(clippy::print_stdout, reason = "an example talks to a person")]

use dem_beam::kernel::order::block_order;
use dem_beam::{BeamMaterial, Container, PackingSpec};
use std::error::Error;
use std::f64::consts::PI;
use std::fs::File;
use std::io::{BufWriter, Write};

const DENSITY: f64 = 2200.0;

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1);
    let count = args.next().map_or(Ok(20_000), |a| a.parse())?;
    let path = args.next().unwrap_or_else(|| "beam.data".into());
    let packing = PackingSpec::quench(Container::cylinder(20e-3, 1e-3)?, count, 1).build()?;
    let body = packing.bonded(BeamMaterial::SILICA, DENSITY)?;
    let (x, n) = (body.positions(), body.len());
    let order = block_order(x, body.pairs());
    let mut place = vec![0; n];
    order.iter().enumerate().for_each(|(k, &i)| place[i as usize] = k);

    let mut out = BufWriter::new(File::create(&path)?);
    writeln!(
        out,
        "Spheres joined by beams\n\n{n} atoms\n{} bonds",
        body.pairs().len()
    )?;
    writeln!(
        out,
        "1 atom types\n1 bond types\n16 extra bond per atom\n32 extra special per atom"
    )?;
    let top = body.radii().iter().fold(0.0_f64, |a, r| a.max(*r));
    for (c, name) in ["x", "y", "z"].iter().enumerate() {
        let ends = x
            .iter()
            .map(|x| x[c])
            .fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], x| {
                [a.min(x), b.max(x)]
            });
        writeln!(
            out,
            "{:e} {:e} {name}lo {name}hi",
            ends[0] - 2.0 * top,
            ends[1] + 2.0 * top
        )?;
    }
    // Id, molecule, type, diameter, density, position. The density gives the particle its mass in our model.
    writeln!(out, "\nAtoms # bpm/sphere\n")?;
    for (k, &i) in order.iter().enumerate() {
        let (i, r) = (i as usize, body.radii()[i as usize]);
        let density = body.mass()[i] / (4.0 / 3.0 * PI * r.powi(3));
        let x = x[i];
        writeln!(
            out,
            "{} 1 1 {:e} {density:e} {:e} {:e} {:e}",
            k + 1,
            2.0 * r,
            x.x,
            x.y,
            x.z
        )?;
    }
    writeln!(out, "\nBonds\n")?;
    for (b, &[i, j]) in body.pairs().iter().enumerate() {
        writeln!(
            out,
            "{} 1 {} {}",
            b + 1,
            place[i as usize] + 1,
            place[j as usize] + 1
        )?;
    }
    out.flush()?;

    let length = body.bonds().map(|b| b.axis.norm().recip()).sum::<f64>() / body.bonds().len() as f64;
    let k = body.rigidity();
    println!(
        "{n} particles, {} bonds, mean length {length:e} m: {path}",
        body.pairs().len()
    );
    println!(
        "-var kr {:e} -var ks {:e} -var kt {:e} -var kb {:e}",
        k.axial / length,
        12.0 * k.bending / length.powi(3),
        k.torsion / length,
        k.bending / length
    );
    Ok(())
}
