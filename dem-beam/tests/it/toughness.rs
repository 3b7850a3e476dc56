//! Toughness of strips: the energy that a slow crack takes, against strip theory, and strips that are
//! refused.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use dem_beam::calibrate::{Bar, tension_test};
use dem_beam::toughness::{SPEED, Strip, Toughness, toughness_test};
use dem_beam::{BeamMaterial, Container, Criterion, Error, Fracture, Packing, PackingSpec};
use nalgebra::Vector3;

/// Lengths \[m\] of a strip with 16 spheres of about 1 mm across.
const SIZE: [f64; 3] = [52e-3, 16e-3, 5e-3];
const GC: f64 = 8.0;
/// Constants of a bulk packing with these beams.
const YOUNG: f64 = 72.5e9;
const NU: f64 = 0.174;

fn strip(size: [f64; 3]) -> Strip {
    Strip {
        low: [0.0; 3],
        size,
        young: YOUNG,
    }
}

fn packing(seed: u64) -> Packing {
    let container = Container::cuboid(Vector3::zeros(), Vector3::from(SIZE)).unwrap();
    PackingSpec::new(container, 4600, seed).build().unwrap()
}

fn test(packing: &Packing, strip: &Strip, gc: f64) -> Result<Toughness, Error> {
    let beam = BeamMaterial::SILICA;
    let fracture = Fracture::from_fracture_energy(Criterion::TensileEnergy, gc, beam.radius_ratio)?;
    toughness_test(packing, beam, strip, fracture)
}

/// The strip loses what strip theory says at the elongation at which the crack runs, within 15 %: in one
/// small strip, and with the waves of its clamps. The bonds release their fracture energy, within 20 %.
#[test]
fn a_slow_crack_takes_the_energy_of_strip_theory() {
    let packing = packing(1);
    let body = packing.bonded(BeamMaterial::SILICA, 1.0).unwrap();
    let bar = Bar {
        start: 0.0,
        length: SIZE[0],
        area: SIZE[1] * SIZE[2],
    };
    let young = tension_test(&body, &bar).unwrap().young;
    let strip = Strip { young, ..strip(SIZE) };
    let t = test(&packing, &strip, GC).unwrap();
    // The clamped layers lie half a sphere inside of the box.
    assert!(
        (SIZE[1] - t.height - 2.0 * packing.report.mean_radius).abs() < 0.2e-3,
        "{t:?}"
    );
    let theory = young * t.elongation.powi(2) / (2.0 * t.height * (1.0 - NU * NU));
    assert!((t.lost / theory - 1.0).abs() < 0.15, "{theory}: {t:?}");
    assert!((t.released / GC - 1.0).abs() < 0.2, "{t:?}");
    // Waves leave with the rest, and the clamps follow the crack.
    assert!(t.lost > 1.3 * t.released, "{t:?}");
    assert!((0.4..3.0).contains(&(t.speed / SPEED)), "{t:?}");
    // Everything is linear in the root of the fracture energy: four times as much doubles each displacement.
    let doubled = test(&packing, &strip, 4.0 * GC).unwrap();
    assert!((doubled.first / t.first - 2.0).abs() < 1e-9);
    assert!((doubled.lost / t.lost - 4.0).abs() < 1e-6, "{doubled:?}");
}

#[test]
fn strips_that_show_no_toughness_are_refused() {
    let packing = packing(1);
    let [length, height, thickness] = SIZE;
    for size in [
        [2.5 * height, height, thickness],
        [length, -height, thickness],
        [length, height, 0.0],
    ] {
        let refused = test(&packing, &strip(size), GC);
        assert!(matches!(refused, Err(Error::OutOfRange { .. })), "{refused:?}");
    }
    // No sphere touches a clamp that lies beside the packing.
    let beside = Strip {
        low: [0.0, 1.0, 0.0],
        ..strip(SIZE)
    };
    assert!(matches!(
        test(&packing, &beside, GC),
        Err(Error::OutOfRange { .. })
    ));
}
