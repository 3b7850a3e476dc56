//! Advances orientations, eight particles at a time.
//!
//! The row of a particle keeps the unit quaternion `q` of its last state. The spin added up since then, `d =
//! th - reached`, rotates it: `q <- (cos |d|/2, sin |d|/2 d/|d|) q`.

use super::engine::OnLanes;
use super::lanes::{CacheLine, Job, LANES, Lanes, Vec3, cross, dot, eight, scale};

/// Series of `cos(a/2)` and `sin(a/2)/a` in `(a/2)^2`. Constants, because ten divisions per particle would
/// cost as much as a bond.
const COS: [f64; 6] = [
    1.0,
    -1.0 / 2.0,
    1.0 / 24.0,
    -1.0 / 720.0,
    1.0 / 40_320.0,
    -1.0 / 3_628_800.0,
];
const SIN: [f64; 6] = [
    0.5,
    -0.5 / 6.0,
    0.5 / 120.0,
    -0.5 / 5_040.0,
    0.5 / 362_880.0,
    -0.5 / 39_916_800.0,
];

/// Square of the angle below which the series are exact: `(a/2)^2 <= 1/16`, whose sixth power is below the
/// last bit.
const SMALL: f64 = 0.25;

/// Returns `cos(a/2)` and `sin(a/2)/a` for a rotation by the angle `a`, `x = a^2`.
#[inline(always)]
fn half_angle(x: f64) -> (f64, f64) {
    if x < SMALL {
        let y = 0.25 * x;
        let series = |k: &[f64; 6]| k[0] + y * (k[1] + y * (k[2] + y * (k[3] + y * (k[4] + y * k[5]))));
        return (series(&COS), series(&SIN));
    }
    // More than half a radian in one step is rare: speed does not matter here.
    let a = x.sqrt();
    let (s, c) = (0.5 * a).sin_cos();
    (c, s / a)
}

/// Rotates the unit quaternion `q` (scalar first) by the rotation vector `d`.
#[inline(always)]
pub(crate) fn turned(q: [f64; 4], d: [f64; 3]) -> [f64; 4] {
    // Spins of spheres are constant between two kicks. So this is the exact motion, and the scheme is the
    // variational one.
    let (c, s) = half_angle(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    let [x, y, z] = [s * d[0], s * d[1], s * d[2]];
    let p = [
        c * q[0] - x * q[1] - y * q[2] - z * q[3],
        c * q[1] + x * q[0] + y * q[3] - z * q[2],
        c * q[2] + y * q[0] + z * q[1] - x * q[3],
        c * q[3] + z * q[0] + x * q[2] - y * q[1],
    ];
    // Round-off of the norm would add up: one Newton step towards norm one.
    let k = 1.5 - 0.5 * (p[0] * p[0] + p[1] * p[1] + p[2] * p[2] + p[3] * p[3]);
    p.map(|p| k * p)
}

/// Job that moves rows to displacements `u` and rotations `th`; `reached` holds the previous rotations and
/// becomes `th`.
pub(crate) struct Turn<'a> {
    pub(crate) rows: &'a mut [CacheLine],
    pub(crate) u: &'a [f64],
    pub(crate) th: &'a [f64],
    pub(crate) reached: &'a mut [f64],
}

impl OnLanes for Turn<'_> {
    #[inline(always)]
    fn on<L: Lanes>(self, l: L) {
        l.run(With(l, self));
    }
}

struct With<'a, L>(L, Turn<'a>);

impl<L: Lanes> Job for With<'_, L> {
    #[inline(always)]
    fn call(self) {
        let Self(l, Turn { rows, u, th, reached }) = self;
        let (blocks, last_rows) = rows.as_chunks_mut::<LANES>();
        let (us, u) = u.as_chunks::<24>();
        let (ths, th) = th.as_chunks::<24>();
        let (reacheds, reached) = reached.as_chunks_mut::<24>();
        for (((rows, u), th), reached) in blocks.iter_mut().zip(us).zip(ths).zip(reacheds) {
            if !small_turn(l, rows, u, th, reached) {
                one_by_one(rows, u, th, reached);
            }
        }
        one_by_one(last_rows, u, th, reached);
    }
}

fn one_by_one(rows: &mut [CacheLine], u: &[f64], th: &[f64], reached: &mut [f64]) {
    let sources = u.as_chunks::<3>().0.iter().zip(th.as_chunks::<3>().0);
    let places = rows.iter_mut().zip(reached.as_chunks_mut::<3>().0);
    for ((row, reached), (u, th)) in places.zip(sources) {
        let d = [th[0] - reached[0], th[1] - reached[1], th[2] - reached[2]];
        *reached = *th;
        let q = turned([row.0[3], row.0[4], row.0[5], row.0[6]], d);
        *row = CacheLine([u[0], u[1], u[2], q[0], q[1], q[2], q[3], 0.0]);
    }
}

/// Advances eight particles at once. Returns `false`, with nothing changed, if one of them rotates too far
/// for the series.
#[inline(always)]
fn small_turn<L: Lanes>(
    l: L,
    rows: &mut [CacheLine; LANES],
    u: &[f64; 24],
    th: &[f64; 24],
    reached: &mut [f64; 24],
) -> bool {
    let mut way = [0.0; 24];
    for k in 0..24 {
        way[k] = th[k] - reached[k];
    }
    let d = apart(l, &way);
    // No branch per lane: one particle with a large rotation sends the whole block to the scalar code.
    let x = dot(l, d, d);
    let mut small = true;
    for x in l.store(x) {
        small &= x < SMALL;
    }
    if !small {
        return false;
    }
    *reached = *th;
    let y = l.mul(x, l.splat(0.25));
    let (c, h) = (series(l, y, &COS), scale(l, d, series(l, y, &SIN)));
    let columns = l.transpose(eight!(r => rows[r].0));
    let (s, q): (L::V, Vec3<L>) = (columns[3], [columns[4], columns[5], columns[6]]);
    // (c, h) (s, q) = (c s - h.q, c q + s h + h x q)
    let scalar = l.sub(l.mul(c, s), dot(l, h, q));
    let turn = cross(l, h, q);
    let vector = [
        l.madd(c, q[0], l.madd(s, h[0], turn[0])),
        l.madd(c, q[1], l.madd(s, h[1], turn[1])),
        l.madd(c, q[2], l.madd(s, h[2], turn[2])),
    ];
    let norm = l.madd(scalar, scalar, dot(l, vector, vector));
    let k = l.nmadd(l.splat(0.5), norm, l.splat(1.5));
    let [px, py, pz] = scale(l, vector, k);
    let [ux, uy, uz] = apart(l, u);
    let moved = l.untranspose([ux, uy, uz, l.mul(scalar, k), px, py, pz, l.splat(0.0)]);
    for (row, moved) in rows.iter_mut().zip(moved) {
        row.0 = moved;
    }
    true
}

/// Splits `x0 y0 z0 x1 ...` of eight particles into three vectors of components.
#[inline(always)]
fn apart<L: Lanes>(l: L, x: &[f64; 24]) -> Vec3<L> {
    [
        l.load(&eight!(k => x[3 * k])),
        l.load(&eight!(k => x[3 * k + 1])),
        l.load(&eight!(k => x[3 * k + 2])),
    ]
}

#[inline(always)]
fn series<L: Lanes>(l: L, y: L::V, k: &[f64; 6]) -> L::V {
    let mut sum = l.splat(k[5]);
    for j in [4, 3, 2, 1, 0] {
        sum = l.madd(sum, y, l.splat(k[j]));
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::super::engine::Isa;
    use super::{CacheLine, Turn, turned};
    use nalgebra::{Quaternion, UnitQuaternion, Vector3};

    /// Compares with nalgebra for rotations on both sides of the series' limit, on lanes and one by one.
    #[test]
    fn quaternions_turn_as_rotation_vectors_say() {
        for size in [1e-9, 1e-3, 0.28, 0.29, 0.3, 2.0, 40.0] {
            let n = 13;
            let d: Vec<f64> = (0..3 * n).map(|i| size * (1.7 * i as f64).sin()).collect();
            let start: Vec<UnitQuaternion<f64>> = (0..n)
                .map(|i| UnitQuaternion::from_scaled_axis(Vector3::new(i as f64, -0.3, 0.7)))
                .collect();
            let reached: Vec<f64> = (0..3 * n).map(|i| 5.0 * (0.9 * i as f64).cos()).collect();
            let th: Vec<f64> = d.iter().zip(&reached).map(|(d, r)| d + r).collect();
            let u: Vec<f64> = (0..3 * n).map(|i| i as f64).collect();
            for isa in [Isa::detect(), Isa::Portable] {
                let row = |q: &UnitQuaternion<f64>| CacheLine([0.0, 0.0, 0.0, q.w, q.i, q.j, q.k, 0.0]);
                let mut rows: Vec<CacheLine> = start.iter().map(row).collect();
                let mut from = reached.clone();
                let turn = Turn {
                    rows: &mut rows,
                    u: &u,
                    th: &th,
                    reached: &mut from,
                };
                isa.run(turn);
                assert_eq!(from, th);
                for (i, (row, q)) in rows.iter().zip(&start).enumerate() {
                    let way = Vector3::new(
                        th[3 * i] - reached[3 * i],
                        th[3 * i + 1] - reached[3 * i + 1],
                        th[3 * i + 2] - reached[3 * i + 2],
                    );
                    let wanted = UnitQuaternion::from_scaled_axis(way) * q;
                    let actual = Quaternion::new(row.0[3], row.0[4], row.0[5], row.0[6]);
                    assert!((actual - wanted.quaternion()).norm() < 4e-15, "{size} {i}");
                    assert_eq!(row.0[..3], u[3 * i..3 * i + 3]);
                    let single = turned([q.w, q.i, q.j, q.k], way.into());
                    let single = Quaternion::new(single[0], single[1], single[2], single[3]);
                    assert!((single - wanted.quaternion()).norm() < 4e-15, "{size} {i}");
                }
            }
        }
    }
}
