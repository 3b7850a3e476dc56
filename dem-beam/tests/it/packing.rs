//! Packings: reproducible, complete, with the right elasticity; hard cases have names.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use approx::{assert_abs_diff_eq, assert_relative_eq};
use dem_beam::calibrate::{Bar, inverse, measure, tension_test};
use dem_beam::packing::{Lattice, lattice, read_csv, write_csv};
use dem_beam::{BeamMaterial, BondedParticles, Container, Error, Matter, Packing, PackingSpec, Surface};
use nalgebra::Vector3;

fn bar_of(length: f64) -> (Container, Bar) {
    let area = std::f64::consts::PI * 1e-6;
    (
        Container::cylinder(length, 1e-3).unwrap(),
        Bar {
            start: 0.0,
            length,
            area,
        },
    )
}

/// GOAL: E and nu follow without any fit. 5 000 spheres, L 20, D 2 mm, full protocol. EXPECTED: (77 +- 2.5)e9
/// Pa, 0.176 +- 0.008.
#[test]
fn cylinder_of_5000_has_the_elasticity_of_silica() {
    let (container, bar) = bar_of(20e-3);
    let packings: Vec<Packing> = [1, 2]
        .map(|seed| PackingSpec::new(container.clone(), 5000, seed).build().unwrap())
        .to_vec();
    let moduli = measure(&packings, BeamMaterial::SILICA, &bar).unwrap();
    assert_abs_diff_eq!(moduli.young.mean, 77e9, epsilon = 2.5e9);
    assert_abs_diff_eq!(moduli.poisson.mean, 0.176, epsilon = 0.008);
    assert!(
        (moduli.young_gauge.mean / moduli.young.mean - 1.0).abs() < 0.03,
        "{moduli:?}"
    );
    for p in &packings {
        let r = &p.report;
        assert_abs_diff_eq!(r.coordination_all, 6.2, epsilon = 1e-3);
        assert!(
            r.coordination_interior > 6.5 && r.coordination_interior < 7.2,
            "{r:?}"
        );
        assert!(r.mean_overlap > 3.9e-4 && r.mean_overlap < 6.5e-4, "{r:?}");
        assert!(
            r.dropped < 50 && r.volume_fraction > 0.58 && r.volume_fraction < 0.64,
            "{r:?}"
        );
        let body = p.bonded(BeamMaterial::SILICA, 2200.0).unwrap();
        let mass: f64 = body.mass().iter().sum();
        assert!((mass / (2200.0 * std::f64::consts::PI * 2e-8) - 1.0).abs() < 1e-12);
    }
}

#[test]
fn inverse_calibration_reaches_its_target() {
    let (container, bar) = bar_of(8e-3);
    let packing = PackingSpec::quench(container, 1500, 4).build().unwrap();
    let calibrated = inverse(&[packing], &bar, 72.5e9, 0.17, 0.3).unwrap();
    assert!(
        (calibrated.reached.young.mean / 72.5e9 - 1.0).abs() < 1e-6,
        "{calibrated:?}"
    );
    assert_abs_diff_eq!(calibrated.reached.poisson.mean, 0.17, epsilon = 1e-4);
    assert_abs_diff_eq!(calibrated.beam.radius_ratio, 0.71, epsilon = 0.15);
}

/// A packing fills a cube of triangles and stays inside.
#[test]
fn closed_surface_is_filled() {
    let a = 2e-3;
    let v: Vec<_> = (0..8)
        .map(|i| Vector3::new((i & 1) as f64, (i >> 1 & 1) as f64, (i >> 2 & 1) as f64) * a)
        .collect();
    let quads = [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ];
    let t: Vec<[u32; 3]> = quads
        .iter()
        .flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]])
        .collect();
    let surface = Surface::new(v.clone(), t.clone()).unwrap();
    assert_relative_eq!(surface.volume(), a * a * a, epsilon = 0.0, max_relative = 1e-12);
    assert!(surface.contains(&Vector3::repeat(1e-3)) && !surface.contains(&Vector3::new(1e-3, 1e-3, 2.1e-3)));
    let (gap, n) = surface.nearest(&Vector3::new(1e-3, 1e-4, 1e-3), 1e-3).unwrap();
    assert!((gap - 1e-4).abs() < 1e-15 && (n - Vector3::y()).norm() < 1e-12);
    let packing = PackingSpec::quench(Container::Surface(surface), 800, 5)
        .build()
        .unwrap();
    let mean = packing.report.mean_radius;
    for (x, r) in packing.positions.iter().zip(&packing.radii) {
        let out = x.iter().map(|c| (r - c).max(c + r - a)).fold(0.0, f64::max);
        // 800 spheres jam below the quench fraction: they are pressed into the walls, as in the box.
        assert!(out < 0.35 * mean, "{out:e} of {mean:e}");
    }
    let boxed = Container::cuboid(Vector3::zeros(), Vector3::repeat(a)).unwrap();
    let twin = PackingSpec::quench(boxed, 800, 5).build().unwrap();
    assert_relative_eq!(
        packing.report.mean_radius,
        twin.report.mean_radius,
        epsilon = 0.0,
        max_relative = 1e-2
    );
    let (n, m) = (
        packing.report.coordination_retained,
        twin.report.coordination_retained,
    );
    assert_relative_eq!(n, m, epsilon = 0.0, max_relative = 0.02);
    let open = Surface::new(v.clone(), t[1..].to_vec());
    assert!(matches!(open, Err(Error::OpenSurface { count: 1, .. })));
    let inward: Vec<[u32; 3]> = t.iter().map(|t| [t[0], t[2], t[1]]).collect();
    assert!(matches!(Surface::new(v, inward), Err(Error::NoVolume { .. })));
}

#[test]
fn reproducible_cached_and_through_csv() {
    let spec = PackingSpec::quench(bar_of(4e-3).0, 600, 11);
    let built = spec.build().unwrap();
    let dir = std::env::temp_dir().join(format!("dem-beam-cache-{}", std::process::id()));
    let first = spec.build_cached(&dir).unwrap();
    let file = dir.join(format!("packing-{}.bin", spec.content_hash()));
    assert!(file.exists() && first == built);
    assert!(spec.build_cached(&dir).unwrap() == built);
    // A damaged cache file is replaced.
    let mut bytes = std::fs::read(&file).unwrap();
    let last = bytes.len() - 9;
    bytes[last] ^= 1;
    std::fs::write(&file, bytes).unwrap();
    assert!(spec.build_cached(&dir).unwrap() == built);
    // Where no file can be written, the packing is computed each time.
    assert!(spec.build_cached(&file.join("below")).unwrap() == built);
    std::fs::remove_dir_all(&dir).unwrap();
    let reseeded = PackingSpec {
        seed: 12,
        ..spec.clone()
    };
    assert!(reseeded.content_hash() != spec.content_hash() && reseeded.build().unwrap() != built);
    let mut text = Vec::new();
    write_csv(&mut text, &built.positions, &built.radii).unwrap();
    let (x, r) = read_csv(&mut text.as_slice()).unwrap();
    assert!(x == built.positions && r == built.radii);
    let rebuilt = Packing::from_spheres(&spec.container, &x, &r, built.report.coordination_retained).unwrap();
    assert!(rebuilt.pairs == built.pairs);
    let bad = read_csv(&mut "x,y,z,r\n1,2,3\n".as_bytes());
    assert!(matches!(bad, Err(Error::Parse { line: 2, .. })));
    let mixed = "x [m] y z r\n# words\n\n 1, 2;3\t4\n\n\n0,0,0,one\n";
    let bad = read_csv(&mut mixed.as_bytes());
    assert!(matches!(bad, Err(Error::Parse { line: 7, .. })), "{bad:?}");
    let nan = read_csv(&mut "0,0,0,1\n1,NaN,3,1\n".as_bytes());
    assert!(matches!(nan, Err(Error::NotFinite { index: 1, .. })));
}

/// The share that is done grows from body to body and step to step, and no body counts twice.
#[test]
fn progress_grows_to_the_end() {
    let mut shares = Vec::new();
    let spec = PackingSpec::new(bar_of(4e-3).0, 300, 1);
    let watched = spec.build_with(&mut |share| shares.push(share)).unwrap();
    assert!(watched == spec.build().unwrap());
    assert!(shares.len() > 10 && shares.is_sorted(), "{shares:?}");
    assert!(shares[0] > 0.0 && shares[shares.len() - 1] < 1.0, "{shares:?}");
}

/// A simple cubic lattice in tension has `E = E_mu pi r_b^2/(2r)^2` away from the ends, and nu = 0.
#[test]
fn cubic_lattice_has_its_textbook_modulus() {
    let r = 1e-3;
    let cube = lattice(Lattice::Cubic, [12, 4, 4], r).unwrap();
    let body = cube.bonded(BeamMaterial::SILICA, 2200.0).unwrap();
    let bar = Bar {
        start: -r,
        length: 24.0 * r,
        area: 64.0 * r * r,
    };
    let moduli = tension_test(&body, &bar).unwrap();
    let expected = 265e9 * std::f64::consts::PI * 0.71 * 0.71 / 4.0;
    assert_relative_eq!(moduli.young_gauge, expected, epsilon = 0.0, max_relative = 1e-5);
    assert!(moduli.poisson.abs() < 1e-5);
    assert_eq!(
        lattice(Lattice::FaceCentred, [3, 3, 3], r).unwrap().radii.len(),
        108
    );
    let bcc = lattice(Lattice::BodyCentred, [6, 6, 6], r).unwrap();
    assert!(bcc.report.coordination_interior > 7.99);
}

fn matter() -> Matter {
    Matter {
        beam: BeamMaterial::SILICA,
        density: 2200.0,
        volume: 1e-9,
    }
}

fn pair_of_spheres(x: f64, r: f64) -> Result<BondedParticles, Error> {
    let p = vec![Vector3::zeros(), Vector3::new(x, 0.0, 0.0)];
    BondedParticles::new(p, vec![1e-3, r], vec![[0, 1]], &matter())
}

#[test]
fn bad_spheres_have_names() {
    assert!(pair_of_spheres(2e-3, 1e-3).is_ok());
    let coincident = pair_of_spheres(0.0, 1e-3);
    assert!(matches!(
        coincident,
        Err(Error::CoincidentParticles {
            first: 0,
            second: 1,
            ..
        })
    ));
    let flat = pair_of_spheres(2e-3, 0.0);
    assert!(matches!(flat, Err(Error::BadRadius { particle: 1, .. })));
    let nowhere = pair_of_spheres(f64::NAN, 1e-3);
    assert!(matches!(nowhere, Err(Error::NotFinite { index: 1, .. })));
    assert!(pair_of_spheres(1.05e-3, 0.05e-3).is_ok());
    assert!(matches!(
        pair_of_spheres(1.04e-3, 0.04e-3),
        Err(Error::RadiusRatio { .. })
    ));
}

fn line() -> Vec<Vector3<f64>> {
    (0..3).map(|i| Vector3::x() * 2e-3 * f64::from(i)).collect()
}

#[test]
fn bad_bonds_have_names() {
    let bonded = |pairs: Vec<[u32; 2]>| BondedParticles::new(line(), vec![1e-3; 3], pairs, &matter());
    let alone = bonded(vec![[0, 1]]);
    assert!(matches!(
        alone,
        Err(Error::IsolatedParticle {
            particle: 2,
            isolated: 1
        })
    ));
    let short = bonded(vec![[0, 1], [1, 1]]);
    assert!(matches!(short, Err(Error::ZeroLengthBond { bond: 1, .. })));
    let unknown = bonded(vec![[0, 1], [1, 9]]);
    assert!(matches!(unknown, Err(Error::NoSuchParticle { particle: 9, .. })));
}

#[test]
fn spheres_that_do_not_fit_have_names() {
    let wide = Container::cuboid(Vector3::zeros(), Vector3::new(1.0, 1.0, 1e-2)).unwrap();
    let few = PackingSpec::quench(wide.clone(), 20, 1).build();
    assert!(matches!(few, Err(Error::ContainerTooSmall { count: 20, .. })));
    let moved: Vec<_> = line().iter().map(|p| p + Vector3::x()).collect();
    let out = Packing::from_spheres(&wide, &moved, &[1e-3; 3], 1.0);
    assert!(matches!(out, Err(Error::OutsideContainer { .. })), "{out:?}");
    let twice = Packing::from_spheres(&wide, &[Vector3::repeat(5e-3); 2], &[1e-3; 2], 1.0);
    assert!(matches!(twice, Err(Error::CoincidentParticles { .. })));
    let nested = [Vector3::repeat(5e-3), Vector3::new(5.9e-3, 5e-3, 5e-3)];
    let nested = Packing::from_spheres(&wide, &nested, &[1e-3; 2], 1.0);
    assert!(matches!(
        nested,
        Err(Error::Overlapping {
            first: 0,
            second: 1,
            ..
        })
    ));
}

#[test]
fn bad_packing_parameters_have_names() {
    let good = || PackingSpec::quench(bar_of(4e-3).0, 500, 1);
    let with_z = |coordination: f64| {
        PackingSpec {
            coordination,
            ..good()
        }
        .build()
    };
    assert!(matches!(with_z(30.0), Err(Error::TooFewPairs { .. })));
    assert!(matches!(with_z(f64::NAN), Err(Error::OutOfRange { .. })));
    let wide = PackingSpec {
        spread: 0.95,
        ..good()
    }
    .build();
    assert!(matches!(wide, Err(Error::RadiusRatio { .. })));
}

/// Spheres with a size ratio of 1:20 can be packed.
#[test]
fn radii_of_one_to_twenty() {
    let spec = PackingSpec {
        spread: 19.0 / 21.0,
        ..PackingSpec::quench(bar_of(4e-3).0, 500, 1)
    };
    let packing = spec.build().unwrap();
    let [low, high] = packing.report.radius_range;
    assert!(high / low > 15.0 && packing.radii.len() + packing.report.dropped == 500);
    assert!(packing.bonded(BeamMaterial::SILICA, 2200.0).is_ok());
}

#[test]
fn density_waves_and_targets_out_of_reach_have_names() {
    let (container, bar) = bar_of(2e-3);
    let short = PackingSpec::new(container, 500, 3).build().unwrap();
    let moduli = tension_test(&short.bonded(BeamMaterial::SILICA, 1.0).unwrap(), &bar).unwrap();
    let refused = moduli.check_uniform();
    assert!(
        matches!(refused, Err(Error::AxialWave { difference, .. }) if difference > 0.03),
        "{moduli:?}"
    );
    let refused = inverse(&[short], &bar, 72.5e9, 0.45, 0.3);
    assert!(
        matches!(refused, Err(Error::PoissonOutOfReach { .. })),
        "{refused:?}"
    );
}

/// Two arms of 50 mm by 1 mm by 3 mm, whose bounding box is fifty times as wide as they are: both are filled,
/// although no point of a coarse grid over the box lies in the arm along its edge.
#[test]
fn thin_arms_of_an_angle_are_filled_alike() {
    let (long, thin, deep) = (50e-3, 1e-3, 3e-3);
    let outline = [
        [0.0, 0.0],
        [long, 0.0],
        [long, thin],
        [thin, thin],
        [thin, long],
        [0.0, long],
    ];
    let points = [0.0, deep].into_iter();
    let points: Vec<_> = points
        .flat_map(|z| outline.map(|[x, y]| Vector3::new(x, y, z)))
        .collect();
    let mut triangles = Vec::new();
    for [a, b, c, d] in [[0, 1, 2, 3], [0, 3, 4, 5]] {
        triangles.extend([[a, c, b], [a, d, c]]);
        triangles.extend([[a + 6, b + 6, c + 6], [a + 6, c + 6, d + 6]]);
    }
    for k in 0..6 {
        let l = (k + 1) % 6;
        triangles.extend([[k, l, l + 6], [k, l + 6, k + 6]]);
    }
    // A turned body has its arms along other axes.
    for turn in [0, 1] {
        let turned = points.iter().map(|x| match turn {
            0 => *x,
            _ => Vector3::new(x.z, x.x, x.y),
        });
        let surface = Surface::new(turned.collect(), triangles.clone()).unwrap();
        let packing = PackingSpec::quench(Container::Surface(surface), 3500, 7)
            .build()
            .unwrap();
        let along = |x: &Vector3<f64>| match turn {
            0 => [x.x, x.y],
            _ => [x.y, x.z],
        };
        let beyond = |k: usize| packing.positions.iter().filter(move |x| along(x)[k] > 0.1 * long);
        let arms = [0, 1].map(|k| beyond(k).count() as f64);
        assert!((arms[0] / arms[1] - 1.0).abs() < 0.05, "{arms:?}");
        for k in [0, 1] {
            let count = |t: u32| {
                let low = 0.1 * long * f64::from(t);
                let within = |x: &&Vector3<f64>| along(x)[k] > low && along(x)[k] <= low + 0.1 * long;
                packing.positions.iter().filter(within).count() as f64
            };
            let tenths: Vec<f64> = (1..10).map(count).collect();
            let mean = tenths.iter().sum::<f64>() / 9.0;
            assert!(tenths.iter().all(|n| (n / mean - 1.0).abs() < 0.1), "{tenths:?}");
        }
    }
}
