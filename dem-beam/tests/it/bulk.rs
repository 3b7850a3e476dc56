//! Periodic packings and the elasticity of the bulk.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use approx::{assert_abs_diff_eq, assert_relative_eq};
use dem_beam::homogenise::{BulkStatistics, bulk};
use dem_beam::packing::{Lattice, lattice};
use dem_beam::{BeamMaterial, Container, DemModel, Error, Packing, PackingSpec};
use nalgebra::Vector3;

fn sample(count: usize, seed: u64) -> Packing {
    let cube = Container::periodic(1e-3).unwrap();
    PackingSpec::new(cube, count, seed).build().unwrap()
}

/// A simple cubic lattice has `C11 = E S/l^2`, `C12 = 0`, `C44 = 6 E I/l^4` with `l = 2 r`; its beams do not
/// turn.
#[test]
fn cubic_lattice_has_its_textbook_stiffness() {
    let (r, n) = (1e-3, 4_u32);
    let mut cube = lattice(Lattice::Cubic, [n as usize; 3], r).unwrap();
    cube.period = Some([2.0 * r * f64::from(n); 3]);
    for a in 0..n {
        for b in 0..n {
            let last = n - 1;
            let index = |i: u32, j: u32, k: u32| (i * n + j) * n + k;
            cube.pairs.push([index(0, a, b), index(last, a, b)]);
            cube.pairs.push([index(a, 0, b), index(a, last, b)]);
            cube.pairs.push([index(a, b, 0), index(a, b, last)]);
        }
    }
    let moduli = bulk(&cube, BeamMaterial::SILICA).unwrap();
    let k = BeamMaterial::SILICA.rigidity(r).unwrap();
    let l = 2.0 * r;
    let (c11, c44) = (k.axial / (l * l), 6.0 * k.bending / l.powi(4));
    for i in 0..6 {
        for j in 0..6 {
            let wanted = match (i == j, i < 3) {
                (true, true) => c11,
                (true, false) => c44,
                _ => 0.0,
            };
            assert_abs_diff_eq!(moduli.stiffness[(i, j)], wanted, epsilon = 1e-9 * c11);
        }
    }
    assert!(moduli.young_axes.iter().all(|e| (e / c11 - 1.0).abs() < 1e-9));
    // Isotropic part and remainder by hand: C11 = 1, C44 = s.
    let s = c44 / c11;
    let (bulk_modulus, shear) = (1.0 / 3.0, (1.0 + 3.0 * s) / 5.0);
    let young = 9.0 * bulk_modulus * shear / (3.0 * bulk_modulus + shear);
    assert_relative_eq!(moduli.young / c11, young, epsilon = 0.0, max_relative = 1e-9);
    // C11, C12 and C44 without their isotropic part; shear entries count four times.
    let part = [
        bulk_modulus + 4.0 / 3.0 * shear,
        bulk_modulus - 2.0 / 3.0 * shear,
        shear,
    ];
    let norm = |c: [f64; 3]| (3.0 * c[0] * c[0] + 6.0 * c[1] * c[1] + 12.0 * c[2] * c[2]).sqrt();
    let anisotropy = norm([1.0 - part[0], -part[1], s - part[2]]) / norm(part);
    assert_relative_eq!(moduli.anisotropy, anisotropy, epsilon = 0.0, max_relative = 1e-9);
}

#[test]
fn bulk_of_silica_by_itself() {
    let samples: Vec<_> = [1, 2]
        .map(|seed| bulk(&sample(2000, seed), BeamMaterial::SILICA).unwrap())
        .to_vec();
    let s = BulkStatistics::from_samples(&samples);
    // The prototype's 72.8 GPa and 0.174 at 8000 spheres, with the scatter of smaller samples.
    assert_abs_diff_eq!(s.young.mean, 72.8e9, epsilon = 1.0e9);
    assert_abs_diff_eq!(s.poisson.mean, 0.174, epsilon = 0.004);
    assert!(s.anisotropy.mean < 0.03, "{s:?}");
}

#[test]
fn same_bits_for_any_number_of_threads() {
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| {
            let packing = sample(600, 7);
            let moduli = bulk(&packing, BeamMaterial::SILICA).unwrap();
            (packing, moduli)
        })
    };
    let serial = run(1);
    assert!(run(2) == serial && run(3) == serial);
}

#[test]
fn the_place_of_the_box_does_not_matter() {
    let mut packing = sample(600, 3);
    let before = bulk(&packing, BeamMaterial::SILICA).unwrap();
    let edge = packing.period.unwrap()[0];
    let shift = Vector3::new(0.31, 0.62, 0.93) * edge;
    for x in &mut packing.positions {
        *x = (*x + shift).map(|c| c.rem_euclid(edge));
    }
    let after = bulk(&packing, BeamMaterial::SILICA).unwrap();
    let change = (after.stiffness - before.stiffness).norm() / before.stiffness.norm();
    assert!(change < 1e-9, "{change:e}");
}

#[test]
fn misuse_has_names() {
    let periodic = sample(600, 1);
    let refused = DemModel::new("bulk", &periodic, BeamMaterial::SILICA, 2200.0);
    assert!(matches!(refused, Err(Error::Periodic { .. })));
    let refused = periodic.bonded(BeamMaterial::SILICA, 2200.0);
    assert!(matches!(refused, Err(Error::Periodic { .. })));
    let walls = PackingSpec::quench(Container::cylinder(4e-3, 1e-3).unwrap(), 500, 1);
    let refused = bulk(&walls.build().unwrap(), BeamMaterial::SILICA);
    assert!(matches!(refused, Err(Error::NotPeriodic)));
    let few = PackingSpec::new(Container::periodic(1e-3).unwrap(), 50, 1).build();
    assert!(matches!(few, Err(Error::PeriodTooShort { .. })), "{few:?}");
    assert!(matches!(Container::periodic(0.0), Err(Error::OutOfRange { .. })));
}

#[test]
fn periodic_packings_come_back_from_the_cache() {
    let cube = Container::periodic(1e-3).unwrap();
    let spec = PackingSpec::quench(cube, 400, 2);
    let folder = std::env::temp_dir().join(format!("dem-beam-bulk-{}", std::process::id()));
    let first = spec.build_cached(&folder).unwrap();
    assert!(spec.build_cached(&folder).unwrap() == first && first.period == Some([1e-3; 3]));
    std::fs::remove_dir_all(&folder).unwrap();
    let inside = |x: &Vector3<f64>| x.iter().all(|c| *c > -1e-4 && *c < 1.1e-3);
    assert!(first.positions.iter().all(inside));
}

/// The table of beams gives the requested modulus and Poisson's ratio also for packings that it was not made
/// from: another seed and fewer spheres.
#[test]
fn beams_of_bulk_packings_give_the_modulus_and_the_ratio_that_were_asked_for() {
    let packing = sample(1500, 7);
    let [low, high] = BeamMaterial::BULK_POISSON;
    for poisson in [0.05, 0.1, 0.22, 0.3, 0.35] {
        let beam = BeamMaterial::from_bulk(70e9, poisson).unwrap();
        let moduli = bulk(&packing, beam).unwrap();
        eprintln!("{poisson}: {:e} {}", moduli.young, moduli.poisson);
        assert_relative_eq!(moduli.young, 70e9, max_relative = 0.03);
        assert_abs_diff_eq!(moduli.poisson, poisson, epsilon = 0.01);
        let [young, ratio] = beam.bulk();
        assert_relative_eq!(young, 70e9, max_relative = 1e-12);
        assert_abs_diff_eq!(ratio, poisson, epsilon = 1e-12);
    }
    for (young, poisson) in [(70e9, low - 0.01), (70e9, high + 0.01), (-1.0, 0.2)] {
        assert!(BeamMaterial::from_bulk(young, poisson).is_err());
    }
}
