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

use super::lanes::{Lanes, Vec3, axpy, cross, diff, dot, load3, minus, scale, sum};
use crate::bond::{BeamRigidity, LinearBond};

/// A force law on rows of eight numbers per particle.
pub(crate) trait Law: Copy + Send + Sync {
    /// Little arithmetic per byte: worth fetching constants ahead even out of the second-level cache.
    const LIGHT: bool;
    /// Constants of one bond in the eight lanes.
    type Slot: Copy + Send + Sync + Default + std::fmt::Debug;
    /// What the loop over bonds needs of the eight particles.
    type Ready<L: Lanes>: Copy;
    /// What it needs of eight neighbours.
    type Near<L: Lanes>: Copy;

    /// Writes a half-bond, seen from its own particle, into lane `lane`.
    fn fill(slot: &mut Self::Slot, lane: usize, bond: &LinearBond);

    /// From the rows of the eight particles.
    fn ready<L: Lanes>(l: L, own: &[L::V; 8]) -> Self::Ready<L>;

    /// First stage of a slot, from the rows of the eight neighbours. It runs while the second stage of the slot
    /// before is under way: the processor's own look-ahead is too short to hide loads, shuffles and roots.
    fn near<L: Lanes>(l: L, slot: &Self::Slot, own: &Self::Ready<L>, other: &[L::V; 8]) -> Self::Near<L>;

    /// Second stage: adds forces and torques on the eight own particles.
    fn add<L: Lanes>(
        l: L,
        k: &Rigidity<L>,
        slot: &Self::Slot,
        own: &Self::Ready<L>,
        near: &Self::Near<L>,
        acc: &mut [L::V; 6],
    );
}

/// Section rigidities in all lanes, with the multiples the laws use.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rigidity<L: Lanes> {
    axial: L::V,
    torsion: L::V,
    bending2: L::V,
    minus_bending12: L::V,
    along: L::V,
    across: L::V,
    two: L::V,
    three: L::V,
}

impl<L: Lanes> Rigidity<L> {
    #[inline(always)]
    pub(crate) fn new(l: L, k: &BeamRigidity) -> Self {
        macro_rules! s {
            ($x:expr) => {
                l.splat($x)
            };
        }
        Self {
            axial: s!(k.axial),
            torsion: s!(k.torsion),
            bending2: s!(2.0 * k.bending),
            minus_bending12: s!(-12.0 * k.bending),
            along: s!(k.torsion + 2.0 * k.bending),
            across: s!(k.torsion - 4.0 * k.bending),
            two: s!(2.0),
            three: s!(3.0),
        }
    }
}

/// Small rotations: rows are `u (3), -, th (3), -`; the free places may hold anything.
///
/// With `b = 2 EI s q`, `s = w l`, `p = n/l`, `q = p.p`, a half-bond adds
///
/// ```text
/// f += 3 b (2 q Du + p x (th_i + th_j)) + (ES - 12 EI q) s (p.Du) p
/// c += 3 b p x Du - b (2 th_i + th_j) + s [(GI_O + 2 EI) p.th_j - (GI_O - 4 EI) p.th_i] p
/// ```
///
/// What multiplies the own rotation could be summed over the bonds at set-up: ten operations fewer, but 72 bytes more
/// per particle, and the law waits for memory. Translations are differences, so a moved body feels no force at all.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Linear;

/// `n/l` and `w l` of eight half-bonds; zero in empty lanes.
#[derive(Debug, Clone, Copy, Default)]
#[repr(C, align(64))]
pub(crate) struct LinearSlot {
    pub(super) axis: [[f64; 8]; 3],
    scale: [f64; 8],
}

impl Law for Linear {
    const LIGHT: bool = true;
    type Slot = LinearSlot;
    /// `u_i` and `th_i`.
    type Ready<L: Lanes> = [Vec3<L>; 2];
    /// `u_j - u_i` and `th_j`.
    type Near<L: Lanes> = [Vec3<L>; 2];

    fn fill(slot: &mut LinearSlot, lane: usize, bond: &LinearBond) {
        for a in 0..3 {
            slot.axis[a][lane] = bond.axis[a];
        }
        slot.scale[lane] = bond.scale;
    }

    #[inline(always)]
    fn ready<L: Lanes>(_l: L, own: &[L::V; 8]) -> [Vec3<L>; 2] {
        [[own[0], own[1], own[2]], [own[4], own[5], own[6]]]
    }

    #[inline(always)]
    fn near<L: Lanes>(l: L, _slot: &LinearSlot, &[u, _]: &[Vec3<L>; 2], other: &[L::V; 8]) -> [Vec3<L>; 2] {
        let du = diff(l, [other[0], other[1], other[2]], u);
        [du, [other[4], other[5], other[6]]]
    }

    #[inline(always)]
    fn add<L: Lanes>(
        l: L,
        k: &Rigidity<L>,
        slot: &LinearSlot,
        &[_, ti]: &[Vec3<L>; 2],
        &[du, tj]: &[Vec3<L>; 2],
        acc: &mut [L::V; 6],
    ) {
        let p: Vec3<L> = load3(l, &slot.axis);
        let s = l.load(&slot.scale);
        let q = dot(l, p, p);
        let b = l.mul(l.mul(k.bending2, s), q);
        let b3 = l.mul(b, k.three);
        // `th_i + th_j` serves force and torque: two additions instead of a second pass over the rotations.
        let both = sum(l, ti, tj);
        let lever = axpy(l, du, l.mul(k.two, q), cross(l, p, both));
        let stretch = l.mul(l.mul(l.madd(k.minus_bending12, q, k.axial), s), dot(l, p, du));
        let f = axpy(l, p, stretch, axpy(l, lever, b3, [acc[0], acc[1], acc[2]]));
        let along = l.nmadd(k.across, dot(l, p, ti), l.mul(k.along, dot(l, p, tj)));
        let c = axpy(l, cross(l, p, du), b3, [acc[3], acc[4], acc[5]]);
        let most = sum(l, ti, both);
        let c = axpy(l, p, l.mul(along, s), minus(l, most, b, c));
        *acc = [f[0], f[1], f[2], c[0], c[1], c[2]];
    }
}

/// Finite rotations: rows are `u (3), q (scalar, vector), -`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Finite;

/// `n0`, `l0` and `w/l0` of eight half-bonds; in empty lanes a unit axis without stiffness.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub(crate) struct FiniteSlot {
    axis: [[f64; 8]; 3],
    pub(super) rest: [f64; 8],
    scale: [f64; 8],
}

impl Default for FiniteSlot {
    fn default() -> Self {
        let zero = [0.0; 8];
        let one = [1.0; 8];
        Self {
            axis: [one, zero, zero],
            rest: one,
            scale: zero,
        }
    }
}

/// Displacement, quaternion and rotation matrix (rows) of the own particles.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FiniteReady<L: Lanes> {
    u: Vec3<L>,
    s: L::V,
    q: Vec3<L>,
    turn: [Vec3<L>; 3],
}

/// Direction and length change of eight bonds, quaternions of the neighbours.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FiniteNear<L: Lanes> {
    pub(super) n: Vec3<L>,
    /// `1/l`.
    shrink: L::V,
    /// `l - l0`.
    pub(super) stretch: L::V,
    s: L::V,
    q: Vec3<L>,
}

impl Law for Finite {
    const LIGHT: bool = false;
    type Slot = FiniteSlot;
    type Ready<L: Lanes> = FiniteReady<L>;
    type Near<L: Lanes> = FiniteNear<L>;

    fn fill(slot: &mut FiniteSlot, lane: usize, bond: &LinearBond) {
        let inverse = bond.axis.norm();
        for a in 0..3 {
            slot.axis[a][lane] = bond.axis[a] / inverse;
        }
        slot.rest[lane] = 1.0 / inverse;
        slot.scale[lane] = bond.scale * inverse * inverse;
    }

    #[inline(always)]
    fn ready<L: Lanes>(l: L, own: &[L::V; 8]) -> FiniteReady<L> {
        let (s, q): (L::V, Vec3<L>) = (own[3], [own[4], own[5], own[6]]);
        let (one, zero) = (l.splat(1.0), l.splat(0.0));
        let two = l.splat(2.0);
        let (x, y, z) = ([one, zero, zero], [zero, one, zero], [zero, zero, one]);
        let (a, b, c) = (
            turned(l, two, s, q, x),
            turned(l, two, s, q, y),
            turned(l, two, s, q, z),
        );
        let turn = [[a[0], b[0], c[0]], [a[1], b[1], c[1]], [a[2], b[2], c[2]]];
        FiniteReady {
            u: [own[0], own[1], own[2]],
            s,
            q,
            turn,
        }
    }

    #[inline(always)]
    fn near<L: Lanes>(l: L, slot: &FiniteSlot, own: &FiniteReady<L>, other: &[L::V; 8]) -> FiniteNear<L> {
        let n0: Vec3<L> = load3(l, &slot.axis);
        let rest = l.load(&slot.rest);
        let du = diff(l, [other[0], other[1], other[2]], own.u);
        let d = axpy(l, n0, rest, du);
        // l^2 - l0^2 = (d + d0).du, without cancellation for small strains.
        let gain = dot(l, axpy(l, n0, rest, d), du);
        let length = l.sqrt(l.madd(rest, rest, gain));
        let sum = l.add(length, rest);
        // One division for both 1/l and 1/(l + l0).
        let both = l.recip(l.mul(length, sum));
        let shrink = l.mul(both, sum);
        FiniteNear {
            n: scale(l, d, shrink),
            shrink,
            stretch: l.mul(gain, l.mul(both, length)),
            s: other[3],
            q: [other[4], other[5], other[6]],
        }
    }

    #[inline(always)]
    fn add<L: Lanes>(
        l: L,
        k: &Rigidity<L>,
        slot: &FiniteSlot,
        own: &FiniteReady<L>,
        near: &FiniteNear<L>,
        acc: &mut [L::V; 6],
    ) {
        let s = l.load(&slot.scale);
        let FiniteNear {
            n, shrink, stretch, ..
        } = *near;
        let Turned {
            axes: [ti, tj],
            relative: r,
            twist,
        } = turned_axes(l, k.two, slot, own, near);
        let r0 = l.madd(own.s, near.s, dot(l, own.q, near.q));
        let kt = l.mul(l.mul(k.torsion, s), twist);
        let kb = l.mul(k.bending2, s);
        let (ci, cj) = (dot(l, n, ti), dot(l, n, tj));
        let (a, b) = (l.madd(k.two, ci, cj), l.madd(k.two, cj, ci));
        // Transverse part: k_t s (2 r - s n) + kb [(a c_i + b c_j) n - a t_i - b t_j], over l.
        let kbs = l.mul(kb, shrink);
        let (ka, kbb) = (l.mul(kbs, a), l.mul(kbs, b));
        let kts = l.mul(kt, shrink);
        let along = l.madd(ka, ci, l.nmadd(kts, twist, l.mul(kbb, cj)));
        let pull = l.madd(l.mul(k.axial, s), stretch, along);
        let twice = l.mul(kts, k.two);
        let f = axpy(l, n, pull, axpy(l, r, twice, [acc[0], acc[1], acc[2]]));
        let m = axpy(
            l,
            n,
            l.mul(kt, r0),
            axpy(l, cross(l, n, r), kt, [acc[3], acc[4], acc[5]]),
        );
        let bend = cross(l, ti, minus(l, n, a, tj));
        let f = minus(l, ti, ka, minus(l, tj, kbb, f));
        let m = minus(l, bend, kb, m);
        *acc = [f[0], f[1], f[2], m[0], m[1], m[2]];
    }
}

/// The axes at rest turned with either end, `vec(q_j q_i*)`, and the twist `s`.
pub(super) struct Turned<L: Lanes> {
    pub(super) axes: [Vec3<L>; 2],
    relative: Vec3<L>,
    pub(super) twist: L::V,
}

#[inline(always)]
pub(super) fn turned_axes<L: Lanes>(
    l: L,
    two: L::V,
    slot: &FiniteSlot,
    own: &FiniteReady<L>,
    near: &FiniteNear<L>,
) -> Turned<L> {
    let n0: Vec3<L> = load3(l, &slot.axis);
    let (qi, qj, sj): (Vec3<L>, Vec3<L>, L::V) = (own.q, near.q, near.s);
    let ti: Vec3<L> = [
        dot(l, own.turn[0], n0),
        dot(l, own.turn[1], n0),
        dot(l, own.turn[2], n0),
    ];
    let tj = turned(l, two, sj, qj, n0);
    // r = vec(q_j q_i*) = s_i q_j - s_j q_i + q_i x q_j.
    let r = axpy(l, qj, own.s, cross(l, qi, qj));
    let r = minus(l, qi, sj, r);
    Turned {
        axes: [ti, tj],
        relative: r,
        twist: l.mul(two, dot(l, near.n, r)),
    }
}

/// `R n`, by `n + 2 s (q x n) + 2 q x (q x n)`.
#[inline(always)]
fn turned<L: Lanes>(l: L, two: L::V, s: L::V, q: Vec3<L>, n: Vec3<L>) -> Vec3<L> {
    let c = scale(l, cross(l, q, n), two);
    let t = axpy(l, c, s, n);
    [
        l.nmadd(q[2], c[1], l.madd(q[1], c[2], t[0])),
        l.nmadd(q[0], c[2], l.madd(q[2], c[0], t[1])),
        l.nmadd(q[1], c[0], l.madd(q[0], c[1], t[2])),
    ]
}
