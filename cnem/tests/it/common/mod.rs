//! Helpers shared by the test targets.
#![allow(dead_code, reason = "every target uses its own part")]
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

pub(crate) mod beam;
pub(crate) mod bodies;

use arlequin_core::sprs::{CsMat, TriMat};
use arlequin_core::{Model, Real, Uniform, Weight};
use cnem::constraint::Surface;
use cnem::domain::Domain;
use cnem::{CnemModel, Elastic, Options};
use nalgebra::{Point3, Vector3};

/// Returns a repeatable sequence in (−1, 1).
pub(crate) fn noise(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

pub(crate) fn silica() -> Elastic<f64> {
    Elastic::new(72.5e9, 0.17, 2200.0).unwrap()
}

/// Returns the domain of [`block_mesh`].
pub(crate) fn block(
    counts: [usize; 3],
    h: f64,
    amount: f64,
    seed: u64,
    keep: impl Fn(usize, usize, usize) -> bool,
) -> Domain {
    let (points, faces) = block_mesh(counts, h, amount, seed, keep);
    Domain::new(&points, &Surface::boundary(faces)).unwrap()
}

/// Returns the nodes of the grid cells that `keep` selects, and the border. Cells have size `h`; nodes off
/// the border are moved by up to `amount` spacings.
pub(crate) fn block_mesh(
    counts: [usize; 3],
    h: f64,
    amount: f64,
    seed: u64,
    keep: impl Fn(usize, usize, usize) -> bool,
) -> (Vec<Point3<f64>>, Vec<[usize; 3]>) {
    let n = counts.map(|c| c + 1);
    let id = |i: usize, j: usize, k: usize| i + n[0] * (j + n[1] * k);
    let mut used = vec![0; n[0] * n[1] * n[2]];
    let mut quads = Vec::new();
    let is_kept = |i: isize, j: isize, k: isize| {
        let inside = [i, j, k]
            .iter()
            .zip(counts)
            .all(|(&a, c)| a >= 0 && (a as usize) < c);
        inside && keep(i as usize, j as usize, k as usize)
    };
    for k in 0..counts[2] {
        for j in 0..counts[1] {
            for i in 0..counts[0] {
                if !keep(i, j, k) {
                    continue;
                }
                for c in 0..8 {
                    used[id(i + (c & 1), j + (c >> 1 & 1), k + (c >> 2))] += 1;
                }
                for axis in 0..3 {
                    for side in 0..2 {
                        let mut o = [i as isize, j as isize, k as isize];
                        o[axis] += 2 * side as isize - 1;
                        if is_kept(o[0], o[1], o[2]) {
                            continue;
                        }
                        let corner = |u: usize, v: usize| {
                            let mut c = [i, j, k];
                            c[axis] += side;
                            c[(axis + 1) % 3] += u;
                            c[(axis + 2) % 3] += v;
                            id(c[0], c[1], c[2])
                        };
                        quads.push([corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)]);
                    }
                }
            }
        }
    }
    let mut new = vec![usize::MAX; used.len()];
    let mut next = noise(seed);
    let mut points = Vec::new();
    for (old, &u) in used.iter().enumerate() {
        if u == 0 {
            continue;
        }
        new[old] = points.len();
        let p = Vector3::new(old % n[0], old / n[0] % n[1], old / (n[0] * n[1])).map(|c| c as f64);
        let shift = Vector3::new(next(), next(), next()) * if u == 8 { amount } else { 0.0 };
        points.push(Point3::from((p + shift) * h));
    }
    let faces = quads
        .iter()
        .map(|q| q.map(|v| new[v]))
        .flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]);
    (points, faces.collect())
}

/// Returns `K` without the rows and columns of prescribed unknowns, and the map from free to all unknowns.
pub(crate) fn free_part(k: &CsMat<f64>, fixed: &[bool]) -> (CsMat<f64>, Vec<usize>) {
    let free: Vec<usize> = (0..fixed.len()).filter(|&i| !fixed[i]).collect();
    let mut place = vec![usize::MAX; fixed.len()];
    free.iter().enumerate().for_each(|(a, &i)| place[i] = a);
    let mut t = TriMat::new((free.len(), free.len()));
    for (v, (i, j)) in k.iter() {
        if !fixed[i] && !fixed[j] {
            t.add_triplet(place[i], place[j], *v);
        }
    }
    (t.to_csr(), free)
}

/// Solves `K u = f` for the free unknowns; the others keep their values in `u`.
pub(crate) fn solve(k: &CsMat<f64>, fixed: &[bool], f: &[f64], u: &mut [f64]) {
    let (kff, free) = free_part(k, fixed);
    let mut b: Vec<f64> = free.iter().map(|&i| f[i]).collect();
    for (a, &i) in free.iter().enumerate() {
        let row = k.outer_view(i).unwrap();
        b[a] -= row
            .iter()
            .filter(|(j, _)| fixed[*j])
            .map(|(j, v)| v * u[j])
            .sum::<f64>();
    }
    f64::cholesky(&kff, None).unwrap().solve(&mut b);
    free.iter().zip(b).for_each(|(&i, x)| u[i] = x);
}

/// Returns the lowest `count` eigenvalues `ω²` and vectors of `K x = ω² M x` on the free unknowns, by inverse
/// iteration on a block.
pub(crate) fn lowest(k: &CsMat<f64>, mass: &[f64], fixed: &[bool], count: usize) -> Vec<(f64, Vec<f64>)> {
    let (kff, free) = free_part(k, fixed);
    let m: Vec<f64> = free.iter().map(|&i| mass[i]).collect();
    let n = free.len();
    let mut factor = f64::cholesky(&kff, None).unwrap();
    let mut next = noise(5);
    let size = count + 8;
    let mut x: Vec<Vec<f64>> = (0..size).map(|_| (0..n).map(|_| next()).collect()).collect();
    let mut values = vec![0.0; size];
    for _ in 0..30 {
        let old: Vec<Vec<f64>> = x
            .iter()
            .map(|v| v.iter().zip(&m).map(|(v, m)| v * m).collect())
            .collect();
        x = old.clone();
        x.iter_mut().for_each(|v| factor.solve(v));
        // Rayleigh-Ritz: A = Xᵀ K X = Xᵀ M X_old, B = Xᵀ M X.
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let mx: Vec<Vec<f64>> = x
            .iter()
            .map(|v| v.iter().zip(&m).map(|(v, m)| v * m).collect())
            .collect();
        let a = nalgebra::DMatrix::from_fn(size, size, |i, j| {
            0.5 * (dot(&x[i], &old[j]) + dot(&x[j], &old[i]))
        });
        let b = nalgebra::DMatrix::from_fn(size, size, |i, j| dot(&x[i], &mx[j]));
        let l = b.cholesky().unwrap().l();
        let li = l.clone().try_inverse().unwrap();
        let e = (&li * a * li.transpose()).symmetric_eigen();
        let y = li.transpose() * &e.eigenvectors;
        let mut order: Vec<usize> = (0..size).collect();
        order.sort_by(|&i, &j| e.eigenvalues[i].total_cmp(&e.eigenvalues[j]));
        x = order
            .iter()
            .map(|&c| {
                (0..n)
                    .map(|r| (0..size).map(|s| x[s][r] * y[(s, c)]).sum())
                    .collect()
            })
            .collect();
        values = order.iter().map(|&c| e.eigenvalues[c]).collect();
    }
    let full = |v: &Vec<f64>| {
        let mut out = vec![0.0; fixed.len()];
        free.iter().zip(v).for_each(|(&i, x)| out[i] = *x);
        out
    };
    values
        .iter()
        .copied()
        .zip(x.iter().map(full))
        .take(count)
        .collect()
}

/// Returns `u_a(x) = sin(k_a·x + φ_a)`, its gradient, and the sines.
fn manufactured(x: &Point3<f64>) -> (Vector3<f64>, nalgebra::Matrix3<f64>, [f64; 3]) {
    let (k, phase) = waves();
    let sines = [0, 1, 2].map(|a: usize| (k[a].dot(&x.coords) + phase[a]).sin_cos());
    let u = Vector3::new(sines[0].0, sines[1].0, sines[2].0);
    let g = nalgebra::Matrix3::from_fn(|a, b| sines[a].1 * k[a][b]);
    (u, g, sines.map(|s| s.0))
}

fn waves() -> ([Vector3<f64>; 3], [f64; 3]) {
    let k = [[3.0, 1.0, -2.0], [1.0, 2.5, 2.0], [-2.0, 1.0, 3.0]].map(Vector3::from);
    (k, [0.3, 1.1, 2.0])
}

/// Returns the relative errors of a manufactured solution in `L2` and in the gradient, with displacements
/// prescribed on the whole border.
pub(crate) fn mms(domain: Domain, options: Options) -> [f64; 2] {
    use arlequin_core::{Interpolation, LinearModel, ShapeRow};
    let mut fixed = vec![false; 3 * domain.nodes().len()];
    for v in domain.constrained_faces().flat_map(|f| f.0) {
        fixed[3 * v..3 * v + 3].fill(true);
    }
    let material = Elastic::new(1.0, 0.25, 1.0).unwrap();
    let [lambda, mu] = material.lame();
    let model = CnemModel::new("mms", domain, material, options).unwrap();
    let (k, _) = waves();
    let (mut u, mut f) = (Vec::new(), Vec::new());
    let mut mass = vec![0.0; model.layout().dofs()];
    // The density is one, so that loads are distributed as the masses, like those of a body force.
    let unit = Uniform(1.0);
    model.lumped_inertia(&unit, &mut mass).unwrap();
    for (x, v) in model.nodes().iter().zip(mass.iter().step_by(3)) {
        let (exact, _, s) = manufactured(x);
        u.extend(exact.iter());
        // b = −(λ + μ) grad div u − μ Δu, with second derivatives −k k sin.
        for a in 0..3 {
            let grad_div: f64 = (0..3).map(|c| k[c][a] * k[c][c] * s[c]).sum();
            f.push(v * ((lambda + mu) * grad_div + mu * k[a].norm_squared() * s[a]));
        }
    }
    solve(&model.stiffness(), &fixed, &f, &mut u);
    let field = model.field();
    let (mut sums, mut samples, mut row) = ([0.0; 4], Vec::new(), ShapeRow::default());
    for (c, cell) in field.cells().iter().enumerate() {
        samples.clear();
        cell.quadrature(2, &mut samples);
        for s in &samples {
            field.shape_in(c, &s.point, true, &mut row).unwrap();
            let (exact, gradient, _) = manufactured(&s.point);
            let (mut e, mut g) = (-exact, -gradient);
            for ((&n, &w), d) in row.nodes.iter().zip(&row.values).zip(&row.gradients) {
                let q = Vector3::new(u[3 * n], u[3 * n + 1], u[3 * n + 2]);
                e += q * w;
                g += q * d.transpose();
            }
            for (sum, v) in sums.iter_mut().zip([
                e.norm_squared(),
                exact.norm_squared(),
                g.norm_squared(),
                gradient.norm_squared(),
            ]) {
                *sum += v * s.measure;
            }
        }
    }
    [(sums[0] / sums[1]).sqrt(), (sums[2] / sums[3]).sqrt()]
}

pub(crate) fn largest(v: &[f64]) -> f64 {
    v.iter().fold(0.0, |m, x| f64::max(m, x.abs()))
}

/// Returns the critical steps of a block whose weight falls over four spacings from one to 0.05, 0.005 and
/// 0.0005, over the step of the unweighted block.
pub(crate) fn steps_under_falling_weights(options: Options) -> [f64; 3] {
    struct Fall(f64);
    impl Weight<f64> for Fall {
        fn value(&self, x: &Point3<f64>) -> f64 {
            self.0 + (1.0 - self.0) * ((0.75 - x.x) / 0.5).clamp(0.0, 1.0)
        }
    }
    let domain = block([8, 4, 4], 0.125, 0.2, 1, |_, _, _| true);
    let mut model = CnemModel::new("bar", domain, silica(), options).unwrap();
    let mut mass = vec![0.0; model.layout().dofs()];
    let mut step = |weight: &dyn Weight<f64>| {
        model.set_internal_weight(weight).unwrap();
        model.lumped_inertia(weight, &mut mass).unwrap();
        let inverse: Vec<f64> = mass.iter().map(|m| 1.0 / m).collect();
        model.critical_step(&inverse).unwrap()
    };
    let free = step(&Uniform(1.0));
    [0.05, 0.005, 0.0005].map(|e| step(&Fall(e)) / free)
}
