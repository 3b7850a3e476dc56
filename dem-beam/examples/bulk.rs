//! Elasticity of periodic bulk samples over seeds, with nothing fitted: `bulk <count> <seeds> [z]`.
#![allow(clippy::print_stdout, reason = "an example talks to a person")]

use dem_beam::homogenise::{BulkStatistics, bulk};
use dem_beam::{BeamMaterial, Container, Error, PackingSpec};

fn main() -> Result<(), Error> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let number = |k: usize, d: f64| args.get(k).and_then(|a| a.parse().ok()).unwrap_or(d);
    let (count, seeds, z) = (number(0, 8000.0) as usize, number(1, 5.0) as u64, number(2, 6.2));
    let mut samples = Vec::new();
    for seed in 1..=seeds {
        let mut spec = PackingSpec::new(Container::periodic(1e-3)?, count, seed);
        spec.coordination = z;
        let packing = spec.build()?;
        let moduli = bulk(&packing, BeamMaterial::SILICA)?;
        let r = &packing.report;
        println!(
            "seed {seed}: E {:.2} GPa nu {:.4} anisotropy {:.4} axes {:.2?} | z {:.2} {:.3} phi {:.4} overlap {:.1e} fabric {:.4} dropped {} | {} its",
            moduli.young / 1e9,
            moduli.poisson,
            moduli.anisotropy,
            moduli.young_axes.map(|e| e / 1e9),
            r.coordination_all,
            r.coordination_retained,
            r.volume_fraction,
            r.mean_overlap,
            r.fabric_anisotropy,
            r.dropped,
            moduli.iterations
        );
        samples.push(moduli);
    }
    let s = BulkStatistics::from_samples(&samples);
    println!(
        "E {:.3} +- {:.3} GPa, nu {:.4} +- {:.4}, anisotropy {:.4} +- {:.4}",
        s.young.mean / 1e9,
        s.young.deviation / 1e9,
        s.poisson.mean,
        s.poisson.deviation,
        s.anisotropy.mean,
        s.anisotropy.deviation
    );
    Ok(())
}
