use super::*;
use crate::Error;
use proptest::prelude::*;

/// Returns deterministic numbers in [0, 1).
pub(crate) fn noise(seed: u64) -> impl FnMut() -> f64 {
    let mut s = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    move || {
        s ^= s << 13;
        s ^= s >> 7;
        s ^= s << 17;
        (s >> 11) as f64 / (1_u64 << 53) as f64
    }
}

fn random(n: usize, seed: u64) -> Vec<Point3<f64>> {
    let mut r = noise(seed);
    (0..n).map(|_| Point3::new(r(), r(), r())).collect()
}

fn grid(n: usize) -> Vec<Point3<f64>> {
    (0..n * n * n)
        .map(|i| Point3::new((i % n) as f64, (i / n % n) as f64, (i / n / n) as f64))
        .collect()
}

fn cylinder(around: usize, along: usize) -> Vec<Point3<f64>> {
    let angle = |i: usize| 2.0 * std::f64::consts::PI * i as f64 / around as f64;
    (0..around * along)
        .map(|i| {
            Point3::new(
                angle(i % around).cos(),
                angle(i % around).sin(),
                (i / around) as f64 * 0.3,
            )
        })
        .collect()
}

fn two_planes(n: usize, seed: u64) -> Vec<Point3<f64>> {
    let mut r = noise(seed);
    (0..n).map(|i| Point3::new(r(), r(), (i % 2) as f64)).collect()
}

/// Returns the integer points at squared distance 1105 = 5 * 13 * 17 from the origin: exactly cospherical.
fn cospherical() -> Vec<Point3<f64>> {
    let mut out = Vec::new();
    for x in -33_i32..=33 {
        for y in -33_i32..=33 {
            for z in -33_i32..=33 {
                if x * x + y * y + z * z == 1105 {
                    out.push(Point3::new(f64::from(x), f64::from(y), f64::from(z)));
                }
            }
        }
    }
    out
}

fn jittered(points: &[Point3<f64>], size: f64, seed: u64) -> Vec<Point3<f64>> {
    let mut r = noise(seed);
    points
        .iter()
        .map(|p| p + Vector3::new(r() - 0.5, r() - 0.5, r() - 0.5) * size)
        .collect()
}

/// Checks structure, empty spheres (exact) and the hull's volume.
fn assert_delaunay(points: &[Point3<f64>]) -> Delaunay {
    let d = Delaunay::merging_duplicates(points).expect("valid points");
    assert_eq!(d.violations(), 0);
    let tets: f64 = d.tetrahedra().map(|t| volume(t.map(|v| &points[v]))).sum();
    let o = &points[d.tetrahedra().next().expect("a tetrahedron")[0]];
    let hull: f64 = d
        .hull()
        .map(|[a, b, c]| volume([o, &points[a], &points[b], &points[c]]))
        .sum();
    assert!((tets - hull).abs() <= 1e-12 * hull, "{tets} against {hull}");
    assert!(d.at_vertex.iter().filter(|&&t| t == crate::tet::NONE).count() == d.duplicates().len());
    d
}

/// Checks the definition: no point is strictly inside any circumsphere.
fn assert_empty_spheres(points: &[Point3<f64>]) {
    let d = assert_delaunay(points);
    for t in d.tetrahedra() {
        for q in points {
            assert_ne!(
                crate::predicates::insphere(t.map(|v| &points[v]), q),
                std::cmp::Ordering::Greater
            );
        }
    }
}

#[test]
fn degenerate_families_are_exact() {
    assert_delaunay(&random(3000, 1));
    assert_delaunay(&grid(10));
    assert_delaunay(&cylinder(24, 20));
    assert_delaunay(&two_planes(600, 3));
    assert_delaunay(&cospherical());
    assert_empty_spheres(&grid(5));
    assert_empty_spheres(&cylinder(12, 5));
    assert_empty_spheres(&cospherical());
}

#[test]
fn jitter_from_round_off_to_large_is_exact() {
    for exponent in [-15, -13, -10, -7, -4, -1] {
        let size = 10_f64.powi(exponent);
        assert_delaunay(&jittered(&grid(6), size, 7));
        assert_delaunay(&jittered(&cylinder(16, 8), size, 8));
        assert_delaunay(&jittered(&cospherical(), size, 9));
        assert_delaunay(&jittered(&two_planes(200, 5), size, 9));
    }
}

#[test]
fn four_nodes_make_one_tetrahedron() {
    let points = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]].map(Point3::from);
    let d = Delaunay::new(&points).expect("a tetrahedron");
    assert_eq!(d.tetrahedron_count(), 1);
    assert_eq!(d.hull().count(), 4);
}

#[test]
fn spacing_ratio_of_a_thousand() {
    let mut points = random(400, 11);
    points.extend(random(400, 12).iter().map(|p| Point3::from(p.coords * 1e-3)));
    assert_empty_spheres(&points);
}

#[test]
fn flat_and_small_sets_are_named() {
    let line: Vec<_> = (0..9)
        .map(|i| Point3::new(f64::from(i), 2.0 * f64::from(i), 0.0))
        .collect();
    assert_eq!(Delaunay::new(&line).err(), Some(Error::AllCollinear { nodes: 9 }));
    let plane: Vec<_> = (0..9)
        .map(|i| Point3::new(f64::from(i % 3), f64::from(i / 3), 1.0))
        .collect();
    assert_eq!(Delaunay::new(&plane).err(), Some(Error::AllCoplanar { nodes: 9 }));
    assert_eq!(Delaunay::new(&[]).err(), Some(Error::TooFewNodes { found: 0 }));
    assert_eq!(
        Delaunay::new(&plane[..2]).err(),
        Some(Error::TooFewNodes { found: 2 })
    );
    assert_eq!(
        Delaunay::new(&[plane[0]; 5]).err(),
        Some(Error::TooFewNodes { found: 1 })
    );
    let nan = [Point3::new(0.0, f64::NAN, 0.0)];
    assert!(matches!(
        Delaunay::new(&nan),
        Err(Error::NonFinite { node: 0, .. })
    ));
}

#[test]
fn duplicates_are_named_or_mapped() {
    let mut points = grid(3);
    points.push(points[5]);
    points.push(points[20]);
    let error = Delaunay::new(&points).err();
    assert!(matches!(error, Some(Error::DuplicateNodes { count: 2, .. })));
    let d = assert_delaunay(&points);
    let mut pairs: Vec<_> = d
        .duplicates()
        .iter()
        .map(|&(a, b)| (a.min(b), a.max(b)))
        .collect();
    pairs.sort_unstable();
    assert_eq!(pairs, [(5, 27), (20, 28)]);
}

#[test]
fn insertion_order_does_not_matter() {
    let points = grid(5);
    let d = Delaunay::new(&points).expect("grid");
    let mut later = Delaunay::new(&points[..60]).expect("part of the grid");
    for p in &points[60..] {
        later.insert(*p, 0);
    }
    later.compact();
    let sorted = |d: &Delaunay| {
        let mut tets: Vec<_> = d
            .tetrahedra()
            .map(|mut t| {
                t.sort_unstable();
                t
            })
            .collect();
        tets.sort_unstable();
        tets
    };
    assert_eq!(sorted(&d), sorted(&later));
}

#[test]
fn location_is_exact_on_faces_and_nodes() {
    let points = grid(4);
    let d = Delaunay::new(&points).expect("grid");
    let mut hint = 0;
    for i in 0..343 {
        let p = Point3::new((i % 7) as f64, (i / 7 % 7) as f64, (i / 49) as f64) * 0.5;
        match d.locate(&p, hint) {
            Location::Inside { nodes, hint: h } => {
                hint = h;
                let t = nodes.map(|v| &points[v]);
                for slot in 0..4 {
                    let mut s = t;
                    s[slot] = &p;
                    assert!(volume(s) >= 0.0);
                }
            }
            Location::Outside { .. } => panic!("{p} is in the grid"),
        }
    }
    for h in 0..d.tets.len() {
        assert!(matches!(
            d.locate(&Point3::new(1.0, 1.0, 3.0 + 1e-15), h),
            Location::Outside { .. }
        ));
        assert!(matches!(
            d.locate(&Point3::new(1.0, 1.0, 3.0), h),
            Location::Inside { .. }
        ));
    }
}

proptest! {
    #![proptest_config(reader_fuzz::property_config(48))]

    /// Small integer coordinates produce every kind of degeneracy, duplicates included.
    #[test]
    fn small_integer_sets_are_delaunay(raw in prop::collection::vec((0_u8..4, 0_u8..4, 0_u8..4), 5..40)) {
        let points: Vec<_> = raw.iter().map(|&(x, y, z)| Point3::new(x.into(), y.into(), z.into())).collect();
        match Delaunay::merging_duplicates(&points) {
            Ok(_) => assert_empty_spheres(&points),
            Err(Error::AllCollinear { .. } | Error::AllCoplanar { .. } | Error::TooFewNodes { .. }) => {}
            Err(other) => prop_assert!(false, "{}", other),
        }
    }

    #[test]
    fn jittered_sets_are_delaunay(seed in 1_u64..1000, exponent in -15_i32..0) {
        let size = 10_f64.powi(exponent);
        assert_empty_spheres(&jittered(&grid(4), size, seed));
        assert_empty_spheres(&jittered(&cylinder(9, 4), size, seed));
    }

    #[test]
    fn random_sets_are_delaunay(seed in 1_u64..1000, n in 4_usize..120) {
        assert_empty_spheres(&random(n, seed));
        assert_empty_spheres(&two_planes(n + 4, seed));
    }
}
