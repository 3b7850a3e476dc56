use super::*;
use approx::assert_abs_diff_eq;
use proptest::prelude::*;

fn cube(low: f64, side: f64) -> Polyhedron<f64> {
    let p = |i: f64, j: f64, k: f64| Point3::new(low + i * side, low + j * side, low + k * side);
    let (o, l) = (0.0, 1.0);
    Polyhedron::hexahedron([
        p(o, o, o),
        p(l, o, o),
        p(l, l, o),
        p(o, l, o),
        p(o, o, l),
        p(l, o, l),
        p(l, l, l),
        p(o, l, l),
    ])
}

#[test]
fn cube_intersections_have_the_exact_volume() {
    for shift in [-1.0, -0.4, 0.0, 0.3, 0.999, 1.0, 2.0] {
        let other = Cell::Polyhedron(cube(shift, 1.0));
        let v = Cell::Polyhedron(cube(0.0, 1.0))
            .intersection(&other)
            .map_or(0.0, |c| c.measure());
        let side = f64::max(0.0, 1.0 - f64::abs(shift));
        assert!((v - side.powi(3)).abs() < 1e-14, "{shift}: {v}");
    }
}

#[test]
fn quintic_rule_is_exact_on_a_tetrahedron() {
    let p = Point3::new;
    let t = Cell::Polyhedron(Polyhedron::tetrahedron([
        p(0., 0., 0.),
        p(1., 0., 0.),
        p(0., 1., 0.),
        p(0., 0., 1.),
    ]));
    let fact = |n: u32| (1..=n).map(f64::from).product::<f64>();
    for (degree, max) in [(1, 1), (2, 2), (5, 5)] {
        let mut q: Vec<Sample<f64>> = Vec::new();
        t.quadrature(degree, &mut q);
        for a in 0..=max {
            for b in 0..=max - a {
                for c in 0..=max - a - b {
                    let s: f64 = q
                        .iter()
                        .map(|s| s.measure * s.point.x.powi(a) * s.point.y.powi(b) * s.point.z.powi(c))
                        .sum();
                    let exact =
                        fact(a as u32) * fact(b as u32) * fact(c as u32) / fact((a + b + c + 3) as u32);
                    assert_abs_diff_eq!(s, exact, epsilon = 1e-15);
                }
            }
        }
    }
}

#[test]
fn four_samples_integrate_quadratics_over_a_polyhedron() {
    let plane = HalfSpace {
        normal: Vector3::new(1.0, 0.7, 0.4),
        offset: 1.8,
    };
    let body = cube(0.0, 1.0).clip(&plane);
    let mut whole: Vec<Sample<f64>> = Vec::new();
    Cell::Polyhedron(body.clone()).quadrature(2, &mut whole);
    assert_eq!(whole.len(), 4);
    let mut parts: Vec<Sample<f64>> = Vec::new();
    body.for_each_tetrahedron(|t| tetrahedron_quadrature(&t, 2, &mut parts));
    for (a, b, c) in [
        (0, 0, 0),
        (1, 0, 0),
        (0, 0, 1),
        (2, 0, 0),
        (0, 2, 0),
        (1, 1, 0),
        (0, 1, 1),
    ] {
        let sum = |q: &[Sample<f64>]| {
            q.iter()
                .map(|s| s.measure * s.point.x.powi(a) * s.point.y.powi(b) * s.point.z.powi(c))
                .sum::<f64>()
        };
        assert_abs_diff_eq!(sum(&whole), sum(&parts), epsilon = 1e-14);
    }
}

#[test]
fn the_lean_rule_integrates_quintics_with_two_thirds_of_the_samples() {
    let plane = |n: [f64; 3], d: f64| HalfSpace {
        normal: Vector3::from(n),
        offset: d,
    };
    let body = cube(0.0, 1.0).intersection(&[
        plane([1.0, 0.7, 0.4], 1.3),
        plane([-0.3, 1.0, -0.8], 0.5),
        plane([0.2, -0.9, 1.0], 0.8),
    ]);
    let cell = Cell::Polyhedron(body);
    let (mut full, mut lean) = (Vec::new(), Vec::new());
    cell.quadrature(5, &mut full);
    cell.lean_quadrature(5, &mut lean);
    assert!(
        3 * lean.len() <= 2 * full.len(),
        "{} of {}",
        lean.len(),
        full.len()
    );
    for (a, b, c) in [(0, 0, 0), (5, 0, 0), (1, 3, 1), (0, 2, 3), (2, 2, 1)] {
        let sum = |samples: &[Sample<f64>]| -> f64 {
            let value = |s: &Sample<f64>| s.point.x.powi(a) * s.point.y.powi(b) * s.point.z.powi(c);
            samples.iter().map(|s| s.measure * value(s)).sum()
        };
        let (whole, half) = (sum(&full), sum(&lean));
        assert!((whole - half).abs() < 1e-14, "{a} {b} {c}: {whole} {half}");
    }
}

#[test]
fn mean_over_a_segment_with_a_kink() {
    let ends = [Point3::new(-1.0, 0.0, 0.0), Point3::new(1.0, 0.0, 0.0)];
    let cell = Cell::Segment { ends, section: 2.0 };
    assert_abs_diff_eq!(mean(&cell, 1, &|x: &Point3<f64>| x.x.abs()), 0.5, epsilon = 1e-15);
}

#[test]
fn a_plane_through_a_face_cuts_nothing_or_everything() {
    let plane = HalfSpace {
        normal: Vector3::z(),
        offset: 1.0,
    };
    assert_abs_diff_eq!(cube(0.0, 1.0).clip(&plane).volume(), 1.0, epsilon = 1e-15);
    assert_eq!(cube(0.0, 1.0).clip(&plane.flipped()).faces.len(), 0);
}

proptest! {
    #![proptest_config(reader_fuzz::property_config(256))]
    #[test]
    fn a_cut_conserves_volume(n in prop::array::uniform3(-1.0..1.0f64), d in -1.0..1.0f64) {
        prop_assume!(n.iter().map(|x| x * x).sum::<f64>() > 1e-3);
        let plane = HalfSpace { normal: Vector3::from(n), offset: d };
        let body = cube(-0.5, 1.0);
        let sum = body.clip(&plane).volume() + body.clip(&plane.flipped()).volume();
        prop_assert!((sum - 1.0).abs() < 1e-12);
    }
}

/// The six tetrahedra of a cube along its diagonal, or of any image of it.
fn kuhn(corner: impl Fn([usize; 3]) -> Point3<f64>) -> Vec<Polyhedron<f64>> {
    let orders = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
    let tet = |order: [usize; 3]| {
        let mut at = [0; 3];
        let mut p = [corner(at); 4];
        for (k, axis) in order.into_iter().enumerate() {
            at[axis] = 1;
            p[k + 1] = corner(at);
        }
        Polyhedron::tetrahedron(p)
    };
    orders.map(tet).into()
}

/// The unit cube in `n³` boxes of six tetrahedra each, or in boxes.
fn mesh(n: usize, tets: bool, map: &dyn Fn(Point3<f64>) -> Point3<f64>) -> Vec<Polyhedron<f64>> {
    let at = |k: usize| k as f64 / n as f64;
    let mut out = Vec::new();
    for c in 0..n * n * n {
        let c = [c % n, c / n % n, c / n / n];
        let corner = |d: [usize; 3]| map(Point3::new(at(c[0] + d[0]), at(c[1] + d[1]), at(c[2] + d[2])));
        if tets {
            out.extend(kuhn(corner));
        } else {
            let k = |i, j, k| corner([i, j, k]);
            let bottom = [k(0, 0, 0), k(1, 0, 0), k(1, 1, 0), k(0, 1, 0)];
            let top = [k(0, 0, 1), k(1, 0, 1), k(1, 1, 1), k(0, 1, 1)];
            out.push(Polyhedron::hexahedron(std::array::from_fn(|m| {
                if m < 4 { bottom[m] } else { top[m - 4] }
            })));
        }
    }
    out
}

/// The unit cube in the Voronoi cells of points, as the intersection of half-spaces.
fn voronoi(seeds: &[Point3<f64>], map: &dyn Fn(Point3<f64>) -> Point3<f64>) -> Vec<Polyhedron<f64>> {
    let cell = |s: &Point3<f64>| {
        let planes: Vec<_> = seeds
            .iter()
            .filter(|t| *t != s)
            .map(|t| HalfSpace::new(&nalgebra::center(s, t), t - s))
            .collect();
        let mut body = cube(0.0, 1.0).intersection(&planes);
        body.faces.iter_mut().flatten().for_each(|x| *x = map(*x));
        body
    };
    seeds.iter().map(cell).collect()
}

fn common(a: &Polyhedron<f64>, b: &Polyhedron<f64>) -> f64 {
    let [a, b] = [a, b].map(|p| Cell::Polyhedron(p.clone()));
    a.intersection(&b).map_or(0.0, |c| c.measure())
}

#[test]
fn tetrahedra_whose_faces_coincide_to_round_off_have_the_same_intersection_both_ways() {
    let (third, two) = (1.0 / 3.0, 2.0 / 3.0);
    let p = Point3::new;
    let a = Polyhedron::tetrahedron([
        p(0.0, 0.0, two),
        p(0.5, 0.0, two),
        p(0.5, third, two),
        p(0.5, third, 1.0),
    ]);
    let b = Polyhedron::tetrahedron([
        p(third, 0.0, two),
        p(third, third, two),
        p(third, third, 1.0),
        p(two, third, 1.0),
    ]);
    // Exact: the part of A with x between 1/3 and 1/2 that lies in B; both ways, and 3.17 instead of 3.52
    // thousandths.
    let (ab, ba) = (common(&a, &b), common(&b, &a));
    assert_abs_diff_eq!(ab, ba, epsilon = 1e-16);
    assert_abs_diff_eq!(ab, 3.1722e-3, epsilon = 1e-7);
}

/// Rotation and shift, and a shake of round-off size.
fn motion(turn: [f64; 3], shift: [f64; 3], noise: f64) -> impl Fn(Point3<f64>) -> Point3<f64> {
    let turn = nalgebra::Rotation3::new(Vector3::from(turn));
    let count = std::cell::Cell::new(0u32);
    move |x| {
        count.set(count.get().wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
        let r = |k: u32| f64::from(count.get().rotate_left(k) % 1024) / 512.0 - 1.0;
        turn * x + Vector3::from(shift) + Vector3::new(r(0), r(9), r(17)) * noise
    }
}

proptest! {
    #![proptest_config(reader_fuzz::property_config(64))]

    #[test]
    fn intersections_are_symmetric_and_add_up_to_the_whole(
        turn in prop::array::uniform3(-2.0..2.0f64), turned: bool, kinds in prop::array::uniform2(0..3usize),
        n in prop::array::uniform2(1..4usize), shift in prop::array::uniform3(-1.0..1.0f64), shifted: bool,
        seeds in prop::collection::vec(prop::array::uniform3(0.05..0.95f64), 4..9),
        // Data that agree exactly, to round-off, to a thousand times that, to seven digits, or not at all.
        noise in prop::sample::select(vec![0.0, 1e-16, 1e-13, 1e-7, 1e-2]),
    ) {
        let turn = if turned { turn } else { [0.0; 3] };
        let shift = if shifted { shift } else { [0.0; 3] };
        let seeds: Vec<_> = seeds.into_iter().map(Point3::from).collect();
        // One partition of the turned cube; another of the same cube up to noise, blown up a little so that
        // it covers.
        let exact = motion(turn, shift, 0.0);
        let fill = |kind: usize, n: usize, map: &dyn Fn(Point3<f64>) -> Point3<f64>| match kind {
            0 => mesh(n, true, map),
            1 => mesh(n, false, map),
            _ => voronoi(&seeds, map),
        };
        let first = fill(kinds[0], n[0], &exact);
        let stretched = |x: Point3<f64>| exact(x + (x - Point3::new(0.5, 0.5, 0.5)) * noise);
        let second = fill(kinds[1], n[1], &stretched);
        for a in &first {
            let whole = a.volume();
            let (mut one, mut other) = (0.0, 0.0);
            for b in &second {
                one += common(a, b);
                other += common(b, a);
                let gap = (common(a, b) - common(b, a)).abs();
                prop_assert!(gap <= 1e-13 * whole.min(b.volume()).max(1e-3), "{gap:e}");
            }
            prop_assert!((one - whole).abs() < 1e-13 && (other - whole).abs() < 1e-13,
                "{one} {other} {whole}: {:e} {:e}", one - whole, other - whole);
        }
    }

    #[test]
    fn nearly_coincident_cells_are_never_counted_twice(
        turn in prop::array::uniform3(-2.0..2.0f64), size in prop::sample::select(vec![1e-16, 3e-16, 1e-15, 1e-14, 1e-12, 1e-9]),
        which in prop::array::uniform2(0..24usize), far in 0.0..3.0f64,
    ) {
        // The same structured tetrahedra twice, corners apart by `size`: |A∩B| differs from that of the
        // exact ones by no more than surface times distance.
        let shift = [far, -far, 0.5 * far];
        let (exact, shaken) = (motion(turn, shift, 0.0), motion(turn, shift, size));
        let plain = motion([0.0; 3], [0.0; 3], 0.0);
        let [sharp, first, second] = [&plain as &dyn Fn(Point3<f64>) -> Point3<f64>, &exact, &shaken].map(|m| mesh(2, true, m));
        let [i, j] = which.map(|k| 2 * k % 48);
        let truth = common(&sharp[i], &sharp[j]);
        let (ab, ba) = (common(&first[i], &second[j]), common(&second[j], &first[i]));
        let bound = 4.0 * size + 1e-14;
        prop_assert!((ab - truth).abs() < bound && (ba - truth).abs() < bound, "{ab} {ba} {truth}");
    }
}

#[test]
fn corners_that_differ_by_round_off_are_one_and_a_face_in_the_plane_counts_once() {
    let plane = |normal, at: f64| HalfSpace::new(&Point3::new(at, at, at), normal);
    let mut apart = cube(0.5, 0.5);
    for (k, face) in apart.faces.iter_mut().enumerate() {
        let shift = Vector3::repeat(k as f64 * f64::EPSILON);
        face.iter_mut().for_each(|p| *p += shift);
    }
    let half = apart.clip(&plane(Vector3::x(), 0.75));
    assert_eq!(half.faces.iter().map(Vec::len).collect::<Vec<_>>(), [4; 6]);
    assert!((half.volume() - 0.0625).abs() < 1e-14, "{}", half.volume());

    // A roof whose lower half lies in the plane and whose upper half lies beyond it, by round-off.
    let z = [-14.0, 14.0, 20.0].map(|k| 1.0 + k * f64::EPSILON);
    let gable = |y: f64| {
        [[0.0, 0.0], [1.0, 0.0], [1.0, z[2]], [0.5, z[1]], [0.0, z[0]]].map(|[x, z]| Point3::new(x, y, z))
    };
    let (a, b) = (gable(0.0), gable(1.0));
    let mut faces = vec![a.to_vec(), b.to_vec()];
    faces.extend((0..5).map(|k| vec![a[k], a[(k + 1) % 5], b[(k + 1) % 5], b[k]]));
    let cut = Polyhedron { faces }.clip(&plane(Vector3::z(), 1.0));
    assert_eq!(cut.faces.len(), 7);
    assert!((cut.volume() - 1.0).abs() < 1e-13, "{}", cut.volume());
}
