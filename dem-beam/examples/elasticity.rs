//! E and nu of jammed cylinders over seeds, with nothing fitted: `elasticity <count> <seeds> [z] [quench]`.
#![allow(clippy::print_stdout, reason = "an example talks to a person")]

use dem_beam::calibrate::{Bar, Spread, tension_test};
use dem_beam::{BeamMaterial, Container, Error, PackingSpec};
use std::time::Instant;

fn main() -> Result<(), Error> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let number = |k: usize, d: f64| args.get(k).and_then(|a| a.parse().ok()).unwrap_or(d);
    let (count, seeds, z) = (number(0, 5000.0) as usize, number(1, 5.0) as u64, number(2, 6.2));
    let bar = Bar {
        start: 0.0,
        length: 20e-3,
        area: std::f64::consts::PI * 1e-6,
    };
    let (mut e, mut g, mut nu) = (vec![], vec![], vec![]);
    for seed in 1..=seeds {
        let start = Instant::now();
        let container = Container::cylinder(20e-3, 1e-3)?;
        let quench = args.iter().any(|a| a == "quench");
        let mut spec = if quench {
            PackingSpec::quench(container, count, seed)
        } else {
            PackingSpec::new(container, count, seed)
        };
        spec.coordination = z;
        let packing = spec.build()?;
        let packed = start.elapsed().as_secs_f64();
        let body = packing.bonded(BeamMaterial::SILICA, 2200.0)?;
        let start = Instant::now();
        let moduli = tension_test(&body, &bar)?;
        let r = &packing.report;
        println!(
            "seed {seed}: E {:.2} gauge {:.2} GPa nu {:.4} | z {:.2} {:.3} {:.2} phi {:.4} overlap {:.1e} gap {:.4} dropped {} | {} its {:.1} s, packed {packed:.1} s",
            moduli.young / 1e9,
            moduli.young_gauge / 1e9,
            moduli.poisson,
            r.coordination_all,
            r.coordination_retained,
            r.coordination_interior,
            r.volume_fraction,
            r.mean_overlap,
            r.bond_tolerance,
            r.dropped,
            moduli.iterations,
            start.elapsed().as_secs_f64()
        );
        e.push(moduli.young / 1e9);
        g.push(moduli.young_gauge / 1e9);
        nu.push(moduli.poisson);
    }
    let show = |name: &str, x: &[f64]| {
        let s = Spread::from_samples(x);
        println!("{name} {:.4} +- {:.4}", s.mean, s.deviation);
    };
    show("E", &e);
    show("E gauge", &g);
    show("nu", &nu);
    Ok(())
}
