//! The energy criterion with a tension split, on one beam.

use super::*;
use crate::bond::BeamMaterial;

/// Section of a beam of silica between spheres of 0.5 mm.
fn section() -> Section {
    let rigidity = BeamMaterial::SILICA.rigidity(0.5e-3);
    #[allow(clippy::unwrap_used, reason = "a test may")]
    Section::new(&rigidity.unwrap())
}

/// A beam of 1 mm under an axial strain, a twist per length, and rotations of its ends.
fn strain(axial: f64, twist: f64, [a, b]: [f64; 2]) -> Strain {
    Strain {
        length: 1e-3,
        distance: 1e-3,
        axial,
        twist,
        a: Vector3::new(0.0, a, 0.3 * a),
        b: Vector3::new(0.0, b, -0.2 * b),
    }
}

/// Bending and torsion in many proportions.
fn shapes() -> impl Iterator<Item = (f64, [f64; 2])> {
    let turns = [[1e-3, -1e-3], [1e-3, 1e-3], [2e-3, 0.0], [0.0, 0.0]];
    [0.0, 0.3, -1.0, 5.0]
        .into_iter()
        .flat_map(move |twist| turns.map(|turn| (twist, turn)))
}

fn loads(axial: f64, twist: f64, turn: [f64; 2]) -> [f64; 2] {
    let (s, e) = (section(), strain(axial, twist, turn));
    [Criterion::TensileEnergy, Criterion::Energy].map(|c| c.value(&s, &e))
}

#[test]
fn in_tension_the_load_is_the_whole_energy() {
    for (twist, turn) in shapes() {
        for axial in [0.0, 1e-6, 1e-3] {
            let [split, whole] = loads(axial, twist, turn);
            assert_eq!(split.to_bits(), whole.to_bits(), "{axial} {twist} {turn:?}");
        }
    }
}

#[test]
fn a_beam_without_tension_has_no_load() {
    let s = section();
    for turn in [[0.0, 0.0], [1e-3, -1e-3], [2e-3, 0.0]] {
        let bending = Criterion::bending(&s, &strain(0.0, 0.0, turn)) / s.young;
        for axial in [-1.000_001 * bending - 1e-12, -2.0 * bending - 1e-4] {
            let [split, whole] = loads(axial, 0.0, turn);
            assert!(split.abs() < 1e-20 * whole, "{axial} {turn:?}: {split:e}");
        }
    }
}

#[test]
fn the_load_is_continuous_and_falls_with_compression() {
    for (twist, turn) in shapes() {
        let [at_rest, _] = loads(0.0, twist, turn);
        let [near, _] = loads(-1e-12, twist, turn);
        assert!((near - at_rest).abs() <= 1e-6 * at_rest, "{twist} {turn:?}");
        let mut last = at_rest;
        for step in 1..2000 {
            let [load, whole] = loads(-2e-6 * f64::from(step), twist, turn);
            // A last digit may go astray where torsion alone is left.
            assert!(
                load >= 0.0 && load <= last * (1.0 + 1e-12),
                "{twist} {turn:?} {step}"
            );
            assert!(load <= whole);
            last = load;
        }
        assert!(last <= 0.5 * at_rest);
    }
}

/// A bent beam with the largest bending stress `m` under a compression of `m/2`: half of the tension remains,
/// and a quarter of the energy of bending is the load.
#[test]
fn the_load_of_a_compressed_beam_goes_as_the_square_of_the_tension_that_remains() {
    let s = section();
    for turn in [[1e-3, -1e-3], [1e-3, 1e-3], [2e-3, 0.0]] {
        let bending = Criterion::bending(&s, &strain(0.0, 0.0, turn)) / s.young;
        let [at_rest, _] = loads(0.0, 0.0, turn);
        for share in [0.25, 0.5, 0.9] {
            let [load, _] = loads(-share * bending, 0.0, turn);
            let wanted = (1.0 - share).powi(2) * at_rest;
            assert!(
                (load / wanted - 1.0).abs() < 1e-9,
                "{share} {turn:?}: {load:e} {wanted:e}"
            );
        }
    }
}
