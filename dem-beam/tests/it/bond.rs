//! The linear beam law against textbook results.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use dem_beam::{BeamMaterial, BeamRigidity, BondedParticles, LinearBond, Matter, Twist};
use nalgebra::{DMatrix, DVector, Matrix3, Rotation3, SMatrix, SVector, Unit, Vector3};
use proptest::prelude::*;

type M12 = SMatrix<f64, 12, 12>;

/// Returns the textbook stiffness (Przemieniecki, 1968, ch. 5) in the beam frame x = axis, `(u, th) x 2`.
fn textbook(k: &BeamRigidity, l: f64) -> M12 {
    let (a, t) = (k.axial / l, k.torsion / l);
    let (b3, b2, b1) = (
        12.0 * k.bending / l.powi(3),
        6.0 * k.bending / l.powi(2),
        2.0 * k.bending / l,
    );
    let mut m = M12::zeros();
    let mut put = |i: usize, j: usize, v: f64| {
        m[(i, j)] = v;
        m[(j, i)] = v;
    };
    for (o, s) in [(0, a), (3, t)] {
        put(o, o, s);
        put(o + 6, o + 6, s);
        put(o, o + 6, -s);
    }
    // Plane xy: v with th_z; plane xz: w with th_y, the other sign.
    for (v, r, s) in [(1, 5, 1.0), (2, 4, -1.0)] {
        put(v, v, b3);
        put(v + 6, v + 6, b3);
        put(v, v + 6, -b3);
        put(v, r, s * b2);
        put(v, r + 6, s * b2);
        put(v + 6, r, -s * b2);
        put(v + 6, r + 6, -s * b2);
        put(r, r, 2.0 * b1);
        put(r + 6, r + 6, 2.0 * b1);
        put(r, r + 6, b1);
    }
    m
}

fn frame(n: &Vector3<f64>) -> Matrix3<f64> {
    let helper = if n.x.abs() < 0.7 {
        Vector3::x()
    } else {
        Vector3::y()
    };
    let y = n.cross(&helper).normalize();
    Matrix3::from_columns(&[*n, y, n.cross(&y)])
}

fn rigidity() -> BeamRigidity {
    BeamMaterial::SILICA.rigidity(0.0757e-3).unwrap()
}

fn twist(v: &[f64]) -> Twist {
    Twist {
        linear: Vector3::new(v[0], v[1], v[2]),
        angular: Vector3::new(v[3], v[4], v[5]),
    }
}

prop_compose! {
    fn bond_ends()(a in prop::array::uniform3(-1.0..1.0_f64), d in prop::array::uniform3(-1.0..1.0_f64),
        l in 0.8..1.4_f64) -> (Vector3<f64>, Vector3<f64>) {
        let (a, mut d) = (Vector3::from(a), Vector3::from(d));
        if d.norm() < 1e-2 { d = Vector3::new(0.3, -0.4, 0.2); }
        let r = 0.1514e-3;
        (a * 1e-3, a * 1e-3 + d.normalize() * l * r)
    }
}

proptest! {
    #![proptest_config(reader_fuzz::property_config(200))]

    #[test]
    fn stiffness_is_the_textbook_matrix((a, b) in bond_ends(), w in 0.01..1.0_f64) {
        let k = rigidity();
        let bond = LinearBond::new(a, b, w).unwrap();
        let (d, l) = (b - a, (b - a).norm());
        let q = frame(&(d / l));
        let mut turn = M12::zeros();
        for o in [0, 3, 6, 9] {
            turn.fixed_view_mut::<3, 3>(o, o).copy_from(&q);
        }
        let expected = turn * textbook(&k, l) * turn.transpose() * w;
        let full = bond.stiffness(&k);
        // Compare block by block: u and th have different units.
        for r in 0..4 { for c in 0..4 {
            let e = expected.fixed_view::<3, 3>(3 * r, 3 * c);
            let f = full.fixed_view::<3, 3>(3 * r, 3 * c);
            // Scale of the block's units: the root of the two diagonal blocks, as in an energy.
            let s = |o: usize| expected.fixed_view::<3, 3>(3 * o, 3 * o).norm();
            prop_assert!((e - f).norm() <= 1e-12 * (s(r) * s(c)).sqrt());
        }}
        let difference = bond.own_block(&k) - full.fixed_view::<6, 6>(0, 0);
        prop_assert!(difference.norm() <= 1e-12 * full.norm());
        let reversed_difference = bond.reversed().own_block(&k) - full.fixed_view::<6, 6>(6, 6);
        prop_assert!(reversed_difference.norm() <= 1e-12 * full.norm());
    }

    #[test]
    fn rigid_motion_strains_nothing((a, b) in bond_ends(),
        t in prop::array::uniform3(-1.0..1.0_f64), w in prop::array::uniform3(-1.0..1.0_f64)) {
        let k = rigidity();
        let bond = LinearBond::new(a, b, 1.0).unwrap();
        let (t, w) = (Vector3::from(t) * 1e-6, Vector3::from(w) * 1e-2);
        let motion_at = |x: Vector3<f64>| Twist { linear: t + w.cross(&x), angular: w };
        let (i, j) = (motion_at(a), motion_at(b));
        let (fi, fj) = bond.wrenches(&k, &i, &j);
        let l = (b - a).norm();
        let scale = k.axial / l * (t.norm() + w.norm() * l.max(a.norm()));
        prop_assert!(fi.linear.norm() <= 1e-12 * scale && fj.linear.norm() <= 1e-12 * scale);
        prop_assert!(fi.angular.norm() <= 1e-12 * scale * l && fj.angular.norm() <= 1e-12 * scale * l);
        prop_assert!(bond.energy(&k, &i, &j) <= 1e-24 * scale * scale / k.axial * l);
    }

    #[test]
    fn momenta_balance_and_force_is_minus_gradient((a, b) in bond_ends(),
        v in prop::array::uniform12(-1.0..1.0_f64)) {
        let k = rigidity();
        let bond = LinearBond::new(a, b, 1.0).unwrap();
        let l = (b - a).norm();
        let mut x: Vec<f64> = v.to_vec();
        for c in [0, 1, 2, 6, 7, 8] { x[c] *= l; }
        let (fi, fj) = bond.wrenches(&k, &twist(&x[..6]), &twist(&x[6..]));
        let scale = k.axial;
        prop_assert!((fi.linear + fj.linear).norm() <= 1e-14 * scale);
        let moment = fi.angular + fj.angular + (b - a).cross(&fj.linear);
        prop_assert!(moment.norm() <= 1e-13 * scale * l);
        // The energy is quadratic, so that a central difference of any width is exact.
        let f = [fi.linear, fi.angular, fj.linear, fj.angular];
        for c in 0..12 {
            let h = if c % 6 < 3 { l } else { 1.0 };
            let mut y = x.clone();
            y[c] += h;
            let energy_above = bond.energy(&k, &twist(&y[..6]), &twist(&y[6..]));
            y[c] -= 2.0 * h;
            let energy_below = bond.energy(&k, &twist(&y[..6]), &twist(&y[6..]));
            let grad = (energy_above - energy_below) / (2.0 * h);
            prop_assert!((f[c / 3][c % 3] + grad).abs() <= 1e-12 * scale * l / h);
        }
    }
}

/// GOAL: n beams in line are one Euler-Bernoulli cantilever for any n and direction. EXPECTED: `F l/ES`,
/// `F l^3/3EI` with slope `F l^2/2EI`, `T l/GI_O`, to 1e-9.
#[test]
fn cantilever_chain() {
    for n in [1_usize, 7, 40] {
        let r = 0.05e-3;
        let turn = Rotation3::from_axis_angle(&Unit::new_normalize(Vector3::new(1.0, 2.0, -0.5)), 0.9);
        let axis = turn * Vector3::x();
        let positions: Vec<_> = (0..=n).map(|i| axis * (2.0 * r * i as f64)).collect();
        let pairs = (0..n as u32).map(|i| [i, i + 1]).collect();
        let matter = Matter {
            beam: BeamMaterial::SILICA,
            density: 2200.0,
            volume: 1e-9,
        };
        let body = BondedParticles::new(positions, vec![r; n + 1], pairs, &matter).unwrap();
        let k = *body.rigidity();
        let size = 6 * n;
        let mut full = DMatrix::<f64>::zeros(6 * (n + 1), 6 * (n + 1));
        for (bond, &[i, j]) in body.bonds().zip(body.pairs()) {
            let s = bond.stiffness(&k);
            for (p, a) in [i, j].into_iter().enumerate() {
                for (q, b) in [i, j].into_iter().enumerate() {
                    let mut v = full.fixed_view_mut::<6, 6>(6 * a as usize, 6 * b as usize);
                    v += s.fixed_view::<6, 6>(6 * p, 6 * q);
                }
            }
        }
        // Rotations times r have the units of displacements, so that the factorisation keeps its digits.
        let unit = |c: usize| if c % 6 < 3 { 1.0 } else { 1.0 / r };
        let free = DMatrix::from_fn(size, size, |a, b| full[(a + 6, b + 6)] * unit(a) * unit(b));
        let chol = free.cholesky().unwrap();
        let l = 2.0 * r * n as f64;
        let solve = |load: SVector<f64, 6>| {
            let mut b = DVector::zeros(size);
            for c in 0..6 {
                b[size - 6 + c] = load[c] * unit(c);
            }
            let x = chol.solve(&b);
            let end: Vec<f64> = (0..6).map(|c| x[size - 6 + c] * unit(c)).collect();
            (
                turn.inverse() * Vector3::new(end[0], end[1], end[2]),
                turn.inverse() * Vector3::new(end[3], end[4], end[5]),
            )
        };
        let load = |f: Vector3<f64>, c: Vector3<f64>| {
            let (f, c) = (turn * f, turn * c);
            SVector::from([f.x, f.y, f.z, c.x, c.y, c.z])
        };
        let close = |a: f64, b: f64| assert!((a / b - 1.0).abs() < 1e-9, "n {n}: {a} {b}");
        close(solve(load(Vector3::x(), Vector3::zeros())).0.x, l / k.axial);
        let (u, t) = solve(load(Vector3::y(), Vector3::zeros()));
        close(u.y, l.powi(3) / (3.0 * k.bending));
        close(t.z, l.powi(2) / (2.0 * k.bending));
        let (u, t) = solve(load(Vector3::z(), Vector3::zeros()));
        close(u.z, l.powi(3) / (3.0 * k.bending));
        close(t.y, -l.powi(2) / (2.0 * k.bending));
        close(solve(load(Vector3::zeros(), Vector3::x())).1.x, l / k.torsion);
    }
}
