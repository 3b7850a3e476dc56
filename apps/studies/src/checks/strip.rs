//! Energy that the bonds of an edge-cracked strip release per area of the crack, over their strength, for
//! beams of several widths: the factor that `fracture.gc` divides by.

use super::check::{Accept, Check};
use super::{Report, Runs};
use crate::crack::{broken, released_beside};
use arlequin::dem_beam::{BeamMaterial, Criterion};
use arlequin_scene::{Result, Scene, Silent, Source};

const TEXT: &str = include_str!("../../scenes/strip.toml");
/// Young's modulus of the scene \[Pa\], and fracture energy that all strips are meant to have \[J/m²\].
const SILICA: [f64; 2] = [72.5e9, 8.0];
/// Tip of the notch and end of the strip \[m\]; 2 mm at both are not measured.
const ENDS: [f64; 2] = [14e-3, 28e-3];
const THICKNESS: f64 = 4e-3;
/// Mean diameters \[m\], and beam radii over mean particle radii that are measured with them.
const SWEEP: [(f64, &[f64]); 2] = [
    (0.7e-3, &[0.2, 0.3, 0.4, 0.5, 0.6, 0.71, 0.9, 1.2]),
    (0.5e-3, &[0.3, 0.5, 0.71, 1.2]),
];
const SEEDS: [u64; 3] = [1, 2, 3];

/// Returns the released energy per area over the strength of the bonds, for spheres of this mean diameter
/// \[m\] and beams of this radius over the mean radius. All strips have the same modulus.
///
/// # Errors
/// Values that the scene cannot take.
pub fn released_share(criterion: Criterion, diameter: f64, ratio: f64, seed: u64) -> Result<f64> {
    let unit = BeamMaterial {
        young: 1.0,
        radius_ratio: ratio,
        ..BeamMaterial::SILICA
    };
    let [young, gc] = SILICA;
    let strength = gc / criterion.released_share(ratio).unwrap_or(1.0);
    let fracture = format!(
        "{{ criterion = \"{}\", strength = {strength:e} }}",
        criterion.name()
    );
    let scene = Scene::from_source(Source::new("strip.toml", TEXT))?
        .set("model.strip.spacing", format!("{diameter:e}"))?
        .set("model.strip.dem.seed", seed)?
        .set("model.strip.dem.young", format!("{:e}", young / unit.bulk()[0]))?
        .set("model.strip.dem.radius_ratio", format!("{ratio:?}"))?
        .set("effect.0.fracture", fracture)?;
    let results = scene.prepare()?.run(&mut Silent)?;
    let broken = broken(&results);
    let area = (ENDS[1] - ENDS[0]) * THICKNESS;
    Ok(released_beside(&broken, ENDS, diameter) / area / strength)
}

/// Share of the program's factor below which a crack has not parted the strip.
const PARTED: f64 = 0.5;

/// Mean and sample deviation of numbers.
fn scatter(values: &[f64]) -> [f64; 2] {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let square: f64 = values.iter().map(|x| (x - mean).powi(2)).sum();
    [mean, (square / (n - 1.0).max(1.0)).sqrt()]
}

/// Compares the factor with that of the program, for several widths of beams and two sizes of spheres.
pub(super) fn strip(done: &Runs) -> Result<Report> {
    let criterion = Criterion::TensileEnergy;
    let (sweep, seeds) = if done.quick {
        (&SWEEP[..1], &SEEDS[..1])
    } else {
        (&SWEEP[..], &SEEDS[..])
    };
    let mut checks = Vec::new();
    for (diameter, ratios) in sweep {
        for ratio in *ratios {
            let wanted = criterion.released_share(*ratio).unwrap_or_default();
            let shares = seeds
                .iter()
                .map(|seed| released_share(criterion, *diameter, *ratio, *seed));
            let mut shares = shares.collect::<Result<Vec<f64>>>()?;
            shares.retain(|share| *share > PARTED * wanted);
            let [mean, deviation] = scatter(&shares);
            let check = Check::against(
                format!(
                    "beams of {ratio} radii, {:.1} mm: released energy per area over strength",
                    1e3 * diameter
                ),
                mean,
                wanted,
                "factor of the program",
                Accept::Relative(0.15),
            );
            checks.push(check.note(format!(
                "± {deviation:.3}; {} of {} strips parted",
                shares.len(),
                seeds.len()
            )));
        }
    }
    Ok(checks.into())
}
