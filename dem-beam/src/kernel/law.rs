//! The two force laws, eight half-bonds at a time.
//!
//! Linear: as in [`crate::bond`]. Finite rotations: the exact gradient of
//!
//! ```text
//! U = w [ k_n (l-l0)^2/2 + k_t s^2/2 + 2 k_b ((1-c_i^2) + (t_i.t_j - c_i c_j) + (1-c_j^2)) ]
//! k_n = ES/l0   k_t = G I_O/l0   k_b = EI/l0   d = x_j - x_i   l = |d|   n = d/l
//! t_i = R_i n_0   t_j = R_j n_0   c_i = n.t_i   c_j = n.t_j   s = 2 n.vec(q_j q_i*)
//! ```
//!
//! with `q` the unit quaternions of the particles (identity at the start) and `n_0` the axis at
//! rest. `s = 2 sin(phi/2)` for a twist `phi`. U depends on relative quantities only, so forces
//! and torques balance and a rigid motion of any size costs nothing. With `r = vec(q_j q_i*)` and
//! `r_0` its scalar part:
//!
//! ```text
//! f_i = k_n (l-l0) n + [k_t s (2 r - s n) + g - (g.n) n] / l
//! g   = -2 k_b [(2 c_i + c_j) t_i + (c_i + 2 c_j) t_j]
//! m_i = k_t s (r_0 n + n x r) - 2 k_b t_i x (t_j - (2 c_i + c_j) n)
//! ```

use super::lanes::{Lanes, Scalar, Vec3, axpy, cross, diff, dot, scale, sum};
use crate::bond::{BeamRigidity, LinearBond};

/// A force law on rows of eight numbers per particle.
pub(crate) trait Law<T: Scalar>: Copy + Send + Sync {
    /// Constants of one bond in the eight lanes.
    type Slot: Copy + Send + Sync + Default + std::fmt::Debug;

    /// Writes a half-bond, seen from its own particle, into lane `lane`.
    fn fill(slot: &mut Self::Slot, lane: usize, bond: &LinearBond);

    /// Adds forces and torques on the eight own particles.
    fn add<L: Lanes<T = T>>(
        l: L,
        k: &Rigidity<L>,
        slot: &Self::Slot,
        own: &[L::V; 8],
        other: &[L::V; 8],
        acc: &mut [L::V; 6],
    );

    /// New rows after moving for a step `dt` at velocities `v`.
    fn advance<L: Lanes<T = T>>(l: L, dt: L::V, own: &[L::V; 8], v: &[L::V; 6]) -> [L::V; 8];
}

/// Section rigidities in all lanes, with the multiples the laws use.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rigidity<L: Lanes> {
    axial: L::V,
    torsion: L::V,
    bending2: L::V,
    minus_bending12: L::V,
    two: L::V,
    three: L::V,
    one: L::V,
}

impl<L: Lanes> Rigidity<L> {
    #[inline(always)]
    pub(crate) fn new(l: L, k: &BeamRigidity) -> Self {
        macro_rules! s {
            ($x:expr) => {
                l.splat(L::T::of($x))
            };
        }
        Self {
            axial: s!(k.axial),
            torsion: s!(k.torsion),
            bending2: s!(2.0 * k.bending),
            minus_bending12: s!(-12.0 * k.bending),
            two: s!(2.0),
            three: s!(3.0),
            one: s!(1.0),
        }
    }
}

/// Small rotations: rows are `u (3), th (3), -, -`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Linear;

/// `n/l` and `w l` of eight half-bonds; zero in empty lanes.
#[derive(Debug, Clone, Copy, Default)]
#[repr(C, align(64))]
pub(crate) struct LinearSlot<T> {
    axis: [[T; 8]; 3],
    scale: [T; 8],
}

impl<T: Scalar> Law<T> for Linear {
    type Slot = LinearSlot<T>;

    fn fill(slot: &mut LinearSlot<T>, lane: usize, bond: &LinearBond) {
        for a in 0..3 {
            slot.axis[a][lane] = T::of(bond.axis[a]);
        }
        slot.scale[lane] = T::of(bond.scale);
    }

    #[inline(always)]
    fn add<L: Lanes<T = T>>(
        l: L,
        k: &Rigidity<L>,
        slot: &LinearSlot<T>,
        own: &[L::V; 8],
        other: &[L::V; 8],
        acc: &mut [L::V; 6],
    ) {
        let p: Vec3<L> = [
            l.load(&slot.axis[0]),
            l.load(&slot.axis[1]),
            l.load(&slot.axis[2]),
        ];
        let s = l.load(&slot.scale);
        let q = dot(l, p, p);
        let bs = l.mul(k.bending2, s);
        let b = l.mul(bs, q);
        let b3 = l.mul(b, k.three);
        let du = diff(l, [other[0], other[1], other[2]], [own[0], own[1], own[2]]);
        let (ti, tj): (Vec3<L>, Vec3<L>) = ([own[3], own[4], own[5]], [other[3], other[4], other[5]]);
        let total = sum(l, ti, tj);
        // f = 3 b (2 q Du + p x (th_i + th_j)) + (ES - 12 EI q) s (p.Du) p
        let q2 = l.mul(k.two, q);
        let lever = axpy(l, du, q2, cross(l, p, total));
        let stretch = l.mul(l.mul(l.madd(k.minus_bending12, q, k.axial), s), dot(l, p, du));
        let f = [acc[0], acc[1], acc[2]];
        let f = axpy(l, p, stretch, axpy(l, lever, b3, f));
        // c = 3 b p x Du - b (2 th_i + th_j) + s [GI (p.th_j - p.th_i) + 2 EI (2 p.th_i + p.th_j)] p
        let bend = sum(l, total, ti);
        let (pi, pj) = (dot(l, p, ti), dot(l, p, tj));
        let along = l.madd(
            l.mul(k.torsion, s),
            l.sub(pj, pi),
            l.mul(bs, l.madd(k.two, pi, pj)),
        );
        let c = axpy(l, cross(l, p, du), b3, [acc[3], acc[4], acc[5]]);
        let c = [
            l.nmadd(b, bend[0], c[0]),
            l.nmadd(b, bend[1], c[1]),
            l.nmadd(b, bend[2], c[2]),
        ];
        let c = axpy(l, p, along, c);
        *acc = [f[0], f[1], f[2], c[0], c[1], c[2]];
    }

    #[inline(always)]
    fn advance<L: Lanes<T = T>>(l: L, dt: L::V, own: &[L::V; 8], v: &[L::V; 6]) -> [L::V; 8] {
        let mut out = *own;
        for k in 0..6 {
            out[k] = l.madd(dt, v[k], own[k]);
        }
        out
    }
}

/// Finite rotations: rows are `u (3), q (scalar, vector), -`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Finite;

/// `d0`, `1/l0` and `w/l0` of eight half-bonds; in empty lanes a unit axis without stiffness.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub(crate) struct FiniteSlot<T> {
    rest: [[T; 8]; 3],
    inverse: [T; 8],
    scale: [T; 8],
}

impl<T: Scalar> Default for FiniteSlot<T> {
    fn default() -> Self {
        let zero = [T::default(); 8];
        let one = [T::of(1.0); 8];
        Self {
            rest: [one, zero, zero],
            inverse: one,
            scale: zero,
        }
    }
}

impl<T: Scalar> Law<T> for Finite {
    type Slot = FiniteSlot<T>;

    fn fill(slot: &mut FiniteSlot<T>, lane: usize, bond: &LinearBond) {
        let inverse = bond.axis.norm();
        for a in 0..3 {
            slot.rest[a][lane] = T::of(bond.axis[a] / (inverse * inverse));
        }
        slot.inverse[lane] = T::of(inverse);
        slot.scale[lane] = T::of(bond.scale * inverse * inverse);
    }

    #[inline(always)]
    fn add<L: Lanes<T = T>>(
        l: L,
        k: &Rigidity<L>,
        slot: &FiniteSlot<T>,
        own: &[L::V; 8],
        other: &[L::V; 8],
        acc: &mut [L::V; 6],
    ) {
        let d0: Vec3<L> = [
            l.load(&slot.rest[0]),
            l.load(&slot.rest[1]),
            l.load(&slot.rest[2]),
        ];
        let inverse = l.load(&slot.inverse);
        let s = l.load(&slot.scale);
        let du = diff(l, [other[0], other[1], other[2]], [own[0], own[1], own[2]]);
        let d = sum(l, d0, du);
        let dd = dot(l, d, d);
        let length = l.sqrt(dd);
        let shrink = l.div(k.one, length);
        let n = scale(l, d, shrink);
        let n0 = scale(l, d0, inverse);
        // l - l0 = (2 d0.du + du.du)/(l + l0), without cancellation for small strains.
        let rest = dot(l, d0, n0);
        let gain = dot(l, sum(l, d, d0), du);
        let stretch = l.div(gain, l.add(length, rest));
        let (qi, qj): (Vec3<L>, Vec3<L>) = ([own[4], own[5], own[6]], [other[4], other[5], other[6]]);
        let ti = turned(l, k, own[3], qi, n0);
        let tj = turned(l, k, other[3], qj, n0);
        // vec(q_j q_i*) and its scalar part.
        let r = diff(l, scale(l, qj, own[3]), axpy(l, qi, other[3], cross(l, qj, qi)));
        let r0 = l.madd(own[3], other[3], dot(l, qi, qj));
        let twist = l.mul(k.two, dot(l, n, r));
        let kt = l.mul(l.mul(k.torsion, s), twist);
        let kb = l.mul(k.bending2, s);
        let (ci, cj) = (dot(l, n, ti), dot(l, n, tj));
        let (a, b) = (l.madd(k.two, ci, cj), l.madd(k.two, cj, ci));
        // Transverse part: k_t s (2 r - s n) + kb [(a c_i + b c_j) n - a t_i - b t_j], over l.
        let (ka, kbb) = (l.mul(kb, a), l.mul(kb, b));
        let along = l.madd(ka, ci, l.nmadd(kt, twist, l.mul(kbb, cj)));
        let twice = l.mul(kt, k.two);
        let pull = l.mul(l.mul(k.axial, s), stretch);
        let mut f = [acc[0], acc[1], acc[2]];
        for x in 0..3 {
            let t = l.nmadd(ka, ti[x], l.nmadd(kbb, tj[x], l.mul(twice, r[x])));
            let t = l.madd(along, n[x], t);
            f[x] = l.madd(t, shrink, l.madd(pull, n[x], f[x]));
        }
        let ktr = l.mul(kt, r0);
        let m = axpy(l, n, ktr, axpy(l, cross(l, n, r), kt, [acc[3], acc[4], acc[5]]));
        let arm = [
            l.nmadd(a, n[0], tj[0]),
            l.nmadd(a, n[1], tj[1]),
            l.nmadd(a, n[2], tj[2]),
        ];
        let bend = cross(l, ti, arm);
        *acc = [
            f[0],
            f[1],
            f[2],
            l.nmadd(kb, bend[0], m[0]),
            l.nmadd(kb, bend[1], m[1]),
            l.nmadd(kb, bend[2], m[2]),
        ];
    }

    /// Rotation by the Cayley map of `dt w/2`: second order, reversible, keeps the norm.
    #[inline(always)]
    fn advance<L: Lanes<T = T>>(l: L, dt: L::V, own: &[L::V; 8], v: &[L::V; 6]) -> [L::V; 8] {
        let half = l.mul(dt, l.splat(T::of(0.5)));
        let h = scale(l, [v[3], v[4], v[5]], half);
        let one = l.splat(T::of(1.0));
        let norm = l.div(one, l.sqrt(l.add(one, dot(l, h, h))));
        let (s, q): (L::V, Vec3<L>) = (own[3], [own[4], own[5], own[6]]);
        // (1, h) (s, q) = (s - h.q, q + s h + h x q)
        let s_new = l.mul(norm, l.sub(s, dot(l, h, q)));
        let q_new = scale(l, axpy(l, h, s, sum(l, q, cross(l, h, q))), norm);
        let u = axpy(l, [v[0], v[1], v[2]], dt, [own[0], own[1], own[2]]);
        [u[0], u[1], u[2], s_new, q_new[0], q_new[1], q_new[2], own[7]]
    }
}

/// `R n`, by `n + 2 s (q x n) + 2 q x (q x n)`.
#[inline(always)]
fn turned<L: Lanes>(l: L, k: &Rigidity<L>, s: L::V, q: Vec3<L>, n: Vec3<L>) -> Vec3<L> {
    let c = scale(l, cross(l, q, n), k.two);
    sum(l, axpy(l, c, s, n), cross(l, q, c))
}
