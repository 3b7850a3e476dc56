//! The two force laws, for eight half-bonds at a time.
//!
//! The linear law is described in [`crate::bond`]. The law for finite rotations is the exact gradient of
//!
//! ```text
//! U = w [ k_n (l-l0)^2/2 + k_t s^2/2 + 2 k_b ((1-c_i^2) + (t_i.t_j - c_i c_j) + (1-c_j^2)) ]
//! k_n = ES/l0   k_t = G I_O/l0   k_b = EI/l0   d = x_j - x_i   l = |d|   n = d/l
//! t_i = R_i n_0   t_j = R_j n_0   c_i = n.t_i   c_j = n.t_j   s = 2 n.vec(q_j q_i*)
//! ```
//!
//! where `q` are the unit quaternions of the particles (identity at the start) and `n_0` is the axis at rest.
//! `s = 2 sin(phi/2)` for a twist `phi`. U depends on relative quantities only, so forces and torques balance
//! and a rigid motion of any size costs no energy. With `r = vec(q_j q_i*)` and its scalar part `r_0`:
//!
//! ```text
//! f_i = k_n (l-l0) n + [k_t s (2 r - s n) - 2 k_b ((2 c_i + c_j) e_i + (c_i + 2 c_j) e_j)] / l
//! m_i = k_t s (r_0 n + n x r) - 2 k_b t_i x (2 e_i + e_j)
//! e_i = t_i - c_i n   e_j = t_j - c_j n
//! ```
//!
//! All factors are strains. With `t` in place of `e` the sums would be differences of numbers of the size of
//! `k_b`, whose round-off would push a body at rest in the same direction at every step.

use super::lanes::{Lanes, Vec3, axpy, cross, diff, dot, load3, minus, scale, sum};
use super::span::{Grid, Slot};
use crate::bond::BeamRigidity;

/// A force law on rows of eight numbers per particle.
pub(crate) trait Law: Copy + Send + Sync {
    /// True if the law does little arithmetic per byte, so that prefetching constants pays even from the
    /// second-level cache.
    const LIGHT: bool;
    /// True if the law needs the lengths of bonds at rest: computing roots costs more than loading eight
    /// bytes.
    const LENGTHS: bool;
    /// Values of the eight particles that the loop over their bonds uses.
    type Ready<L: Lanes>: Copy;
    /// Values of eight neighbours that the second stage uses.
    type Near<L: Lanes>: Copy;

    /// Prepares the eight particles from their rows.
    fn ready<L: Lanes>(l: L, rows: &[L::V; 8]) -> Self::Ready<L>;

    /// First stage of a slot: from the half-bonds with their lengths and the rows of the eight neighbours.
    ///
    /// It runs while the second stage of the previous slot is under way, because the processor's own
    /// look-ahead is too short to hide loads, shuffles and roots.
    fn near<L: Lanes>(
        l: L,
        k: &Rigidity<L>,
        bonds: (&Slot, &[f64; 8]),
        particles: &Self::Ready<L>,
        neighbour_rows: &[L::V; 8],
    ) -> Self::Near<L>;

    /// Second stage of a slot: adds forces and torques on the eight own particles to `acc`.
    fn add<L: Lanes>(
        l: L,
        k: &Rigidity<L>,
        slot: &Slot,
        particles: &Self::Ready<L>,
        near: &Self::Near<L>,
        acc: &mut [L::V; 6],
    );

    /// Elastic energy of the eight bonds, including their weights.
    fn energy<L: Lanes>(
        l: L,
        k: &Rigidity<L>,
        slot: &Slot,
        particles: &Self::Ready<L>,
        near: &Self::Near<L>,
    ) -> L::V;
}

/// Section rigidities in all lanes, with the multiples that the laws use, in units of a [`Grid`]: `e = 1/u³`,
/// and `g` is the grid step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rigidity<L: Lanes> {
    /// `ES e g²`, `GI_O e g²`, `2 EI e g²`.
    axial: L::V,
    torsion: L::V,
    bending2: L::V,
    /// `12 EI e`, `6 EI e g`.
    side: L::V,
    lever: L::V,
    /// `EI e g²`, `(GI_O - EI) e g²`.
    bending: L::V,
    along: L::V,
    /// `g`, `g/2`, `1/g`.
    pub(super) step: L::V,
    half_step: L::V,
    pub(super) per_step: L::V,
    pub(super) one: L::V,
    pub(super) two: L::V,
    three: L::V,
    quarter: L::V,
    half: L::V,
}

impl<L: Lanes> Rigidity<L> {
    #[inline(always)]
    pub(crate) fn new(l: L, k: &BeamRigidity, grid: &Grid) -> Self {
        macro_rules! s {
            ($x:expr) => {
                l.splat($x)
            };
        }
        let g = grid.step();
        // Rigidities in units of the grid: the kernel then works on the stored integers without scaling them.
        let e = grid.per_volume();
        let square = e * g * g;
        Self {
            axial: s!(k.axial * square),
            torsion: s!(k.torsion * square),
            bending2: s!(2.0 * k.bending * square),
            side: s!(12.0 * k.bending * e),
            lever: s!(6.0 * k.bending * e * g),
            bending: s!(k.bending * square),
            // Torsion less bending: the axial part of the bending term is taken back where torsion is added.
            along: s!((k.torsion - k.bending) * square),
            step: s!(g),
            half_step: s!(0.5 * g),
            per_step: s!(1.0 / g),
            one: s!(1.0),
            two: s!(2.0),
            three: s!(3.0),
            quarter: s!(0.25),
            half: s!(0.5),
        }
    }
}

/// Law for small rotations. A row holds `u (3), -, th (3), -`; the places marked `-` may hold anything.
///
/// With `s = w/l³`, the span `d` and the shear `w = Du + d x (th_i + th_j) / 2`, a half-bond adds
///
/// ```text
/// f += 12 EI s w + (ES - 12 EI/l²) s (d.Du) d
/// c += 6 EI s d x w + EI s l² (th_j - th_i) + (GI_O - EI) s (d.(th_j - th_i)) d
/// ```
///
/// `w` and `th_j - th_i` vanish where the body rotates as a whole, and all terms but `6 EI s d x w` change
/// sign when seen from the other end. Rounding of products therefore unbalances only the moments of strains,
/// not moments of a common rotation, which would add up over a run. Translations enter as differences, so a
/// translated body feels no force at all.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Linear;

impl Law for Linear {
    const LIGHT: bool = true;
    const LENGTHS: bool = false;
    /// `u_i` and `th_i`.
    type Ready<L: Lanes> = [Vec3<L>; 2];
    /// `u_j - u_i` and `th_j`.
    type Near<L: Lanes> = [Vec3<L>; 2];

    #[inline(always)]
    fn ready<L: Lanes>(_l: L, rows: &[L::V; 8]) -> [Vec3<L>; 2] {
        [[rows[0], rows[1], rows[2]], [rows[4], rows[5], rows[6]]]
    }

    #[inline(always)]
    fn near<L: Lanes>(
        l: L,
        _: &Rigidity<L>,
        _: (&Slot, &[f64; 8]),
        &[u, _]: &[Vec3<L>; 2],
        neighbour_rows: &[L::V; 8],
    ) -> [Vec3<L>; 2] {
        let du = diff(l, [neighbour_rows[0], neighbour_rows[1], neighbour_rows[2]], u);
        [du, [neighbour_rows[4], neighbour_rows[5], neighbour_rows[6]]]
    }

    #[inline(always)]
    fn add<L: Lanes>(
        l: L,
        k: &Rigidity<L>,
        slot: &Slot,
        &[_, ti]: &[Vec3<L>; 2],
        &[du, tj]: &[Vec3<L>; 2],
        acc: &mut [L::V; 6],
    ) {
        let d: Vec3<L> = load3(l, &slot.span);
        // Coefficients are computed rather than stored: memory is the limit, and two stored constants per
        // half-bond cost more time than the ten operations that they save (decision 0009).
        let s = l.load_f32(&slot.stiffness);
        // Empty lanes have a span of zero: at least one step keeps `1/q` finite, and their stiffness is zero.
        let q = l.max(dot(l, d, d), k.one);
        // The only division of the law: `1/l²` in the axial coefficient.
        let stiff = l.mul(l.nmadd(k.side, l.recip(q), k.axial), s);
        let lever = l.mul(k.lever, s);
        let (rotation_sum, rotation_difference) = (sum(l, ti, tj), diff(l, tj, ti));
        // The mean of the two rotations times the span in metres.
        let shear = axpy(l, cross(l, d, rotation_sum), k.half_step, du);
        let f = axpy(l, shear, l.mul(k.side, s), [acc[0], acc[1], acc[2]]);
        let f = axpy(l, d, l.mul(stiff, dot(l, d, du)), f);
        let c = axpy(l, cross(l, d, shear), lever, [acc[3], acc[4], acc[5]]);
        let c = axpy(l, rotation_difference, l.mul(l.mul(k.bending, s), q), c);
        let c = axpy(l, d, l.mul(l.mul(k.along, s), dot(l, d, rotation_difference)), c);
        *acc = [f[0], f[1], f[2], c[0], c[1], c[2]];
    }

    #[inline(always)]
    fn energy<L: Lanes>(
        l: L,
        k: &Rigidity<L>,
        slot: &Slot,
        &[_, ti]: &[Vec3<L>; 2],
        &[du, tj]: &[Vec3<L>; 2],
    ) -> L::V {
        let d: Vec3<L> = load3(l, &slot.span);
        let s = l.load_f32(&slot.stiffness);
        let q = l.max(dot(l, d, d), k.one);
        let (rotation_sum, rotation_difference) = (sum(l, ti, tj), diff(l, tj, ti));
        let (stretch, twist) = (dot(l, d, du), dot(l, d, rotation_difference));
        // End rotations against the chord: a.a + a.b + b.b = 3/4 |a + b|^2 + 1/4 |a - b|^2.
        let chord = l.mul(l.mul(k.two, k.per_step), l.recip(q));
        // Strains of every bond and not forces times displacements, which would lose the digits of rotations
        // common to all.
        let y = minus(l, cross(l, d, du), chord, rotation_sum);
        let along = dot(l, d, rotation_sum);
        let sums = l.nmadd(along, along, l.mul(q, dot(l, y, y)));
        let twist2 = l.mul(twist, twist);
        let differences = l.sub(l.mul(q, dot(l, rotation_difference, rotation_difference)), twist2);
        let bend = l.mul(l.mul(k.quarter, k.bending2), l.madd(k.three, sums, differences));
        let held = l.madd(k.axial, l.mul(stretch, stretch), l.mul(k.torsion, twist2));
        l.mul(s, l.madd(k.half, held, bend))
    }
}

/// Law for finite rotations. A row holds `u (3), q (scalar, vector), -`.
///
/// With spans `d` in place of unit axes, `D_i = R_i d` and `C_i = n.D_i`, all rigidities take the factor `s =
/// w/l0³`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Finite;

/// Displacement, quaternion and rotation matrix (rows) of the own particles.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FiniteReady<L: Lanes> {
    u: Vec3<L>,
    s: L::V,
    q: Vec3<L>,
    turn: [Vec3<L>; 3],
}

/// Direction and length change of eight bonds, and quaternions of their neighbours.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FiniteNear<L: Lanes> {
    pub(super) n: Vec3<L>,
    /// `1/l`.
    shrink: L::V,
    /// `l - l0`.
    pub(super) stretch: L::V,
    /// `l0`.
    pub(super) rest_length: L::V,
    s: L::V,
    q: Vec3<L>,
}

impl<L: Lanes> FiniteNear<L> {
    /// `(l0/g)²`.
    #[inline(always)]
    pub(super) fn square(&self, l: L, k: &Rigidity<L>) -> L::V {
        let steps = l.mul(self.rest_length, k.per_step);
        l.mul(steps, steps)
    }
}

impl Law for Finite {
    const LIGHT: bool = false;
    const LENGTHS: bool = true;
    type Ready<L: Lanes> = FiniteReady<L>;
    type Near<L: Lanes> = FiniteNear<L>;

    #[inline(always)]
    fn ready<L: Lanes>(l: L, rows: &[L::V; 8]) -> FiniteReady<L> {
        let (s, q): (L::V, Vec3<L>) = (rows[3], [rows[4], rows[5], rows[6]]);
        let (one, zero) = (l.splat(1.0), l.splat(0.0));
        let two = l.splat(2.0);
        // One matrix per particle: a rotated span then costs nine products per bond.
        let (x, y, z) = ([one, zero, zero], [zero, one, zero], [zero, zero, one]);
        let (a, b, c) = (
            turned(l, two, s, q, x),
            turned(l, two, s, q, y),
            turned(l, two, s, q, z),
        );
        let turn = [[a[0], b[0], c[0]], [a[1], b[1], c[1]], [a[2], b[2], c[2]]];
        FiniteReady {
            u: [rows[0], rows[1], rows[2]],
            s,
            q,
            turn,
        }
    }

    #[inline(always)]
    fn near<L: Lanes>(
        l: L,
        k: &Rigidity<L>,
        (slot, rest_length): (&Slot, &[f64; 8]),
        particles: &FiniteReady<L>,
        neighbour_rows: &[L::V; 8],
    ) -> FiniteNear<L> {
        let d0: Vec3<L> = load3(l, &slot.span);
        let rest_length = l.load(rest_length);
        let du = diff(
            l,
            [neighbour_rows[0], neighbour_rows[1], neighbour_rows[2]],
            particles.u,
        );
        let d = axpy(l, d0, k.step, du);
        // l^2 - l0^2 = (d + d0).du, without cancellation for small strains.
        let gain = dot(l, axpy(l, d0, k.step, d), du);
        let length = l.sqrt(l.madd(rest_length, rest_length, gain));
        let sum = l.add(length, rest_length);
        // One division for both 1/l and 1/(l + l0).
        let inverse_product = l.recip(l.mul(length, sum));
        // `1/l = (l + l0)/(l (l + l0))`, and the stretch is the gain over `l + l0`.
        let shrink = l.mul(inverse_product, sum);
        FiniteNear {
            n: scale(l, d, shrink),
            shrink,
            stretch: l.mul(gain, l.mul(inverse_product, length)),
            rest_length,
            s: neighbour_rows[3],
            q: [neighbour_rows[4], neighbour_rows[5], neighbour_rows[6]],
        }
    }

    #[inline(always)]
    fn add<L: Lanes>(
        l: L,
        k: &Rigidity<L>,
        slot: &Slot,
        particles: &FiniteReady<L>,
        near: &FiniteNear<L>,
        acc: &mut [L::V; 6],
    ) {
        let s = l.load_f32(&slot.stiffness);
        let FiniteNear {
            n, shrink, stretch, ..
        } = *near;
        let Turned {
            axes: [ti, tj],
            relative: r,
            twist,
        } = turned_axes(l, k.two, slot, particles, near);
        let r0 = l.madd(particles.s, near.s, dot(l, particles.q, near.q));
        let whole = l.mul(s, near.square(l, k));
        let kt = l.mul(l.mul(k.torsion, whole), twist);
        let kb = l.mul(k.bending2, s);
        let (ci, cj) = (dot(l, n, ti), dot(l, n, tj));
        let (a, b) = (l.madd(k.two, ci, cj), l.madd(k.two, cj, ci));
        let (ei, ej) = (minus(l, n, ci, ti), minus(l, n, cj, tj));
        // Transverse part: k_t s (2 r - s n) - kb (a e_i + b e_j), over l.
        let kbs = l.mul(kb, shrink);
        let (ka, kbb) = (l.mul(kbs, a), l.mul(kbs, b));
        let kts = l.mul(kt, shrink);
        let pull = l.nmadd(kts, twist, l.mul(l.mul(k.axial, whole), stretch));
        let twice = l.mul(kts, k.two);
        let f = axpy(l, n, pull, axpy(l, r, twice, [acc[0], acc[1], acc[2]]));
        let m = axpy(
            l,
            n,
            l.mul(kt, r0),
            axpy(l, cross(l, n, r), kt, [acc[3], acc[4], acc[5]]),
        );
        let bend = cross(l, ti, axpy(l, ei, k.two, ej));
        let f = minus(l, ei, ka, minus(l, ej, kbb, f));
        let m = minus(l, bend, kb, m);
        *acc = [f[0], f[1], f[2], m[0], m[1], m[2]];
    }

    #[inline(always)]
    fn energy<L: Lanes>(
        l: L,
        k: &Rigidity<L>,
        slot: &Slot,
        particles: &FiniteReady<L>,
        near: &FiniteNear<L>,
    ) -> L::V {
        let s = l.load_f32(&slot.stiffness);
        let Turned {
            axes: [ti, tj],
            twist,
            ..
        } = turned_axes(l, k.two, slot, particles, near);
        let n = near.n;
        // Transverse parts: 1 - c^2 = |e|^2 and t_i.t_j - c_i c_j = e_i.e_j, without cancellation.
        let (ei, ej) = (minus(l, n, dot(l, n, ti), ti), minus(l, n, dot(l, n, tj), tj));
        let bend = l.add(dot(l, ei, sum(l, ei, ej)), dot(l, ej, ej));
        let held = l.mul(k.axial, l.mul(near.stretch, near.stretch));
        let held = l.mul(l.madd(k.torsion, l.mul(twist, twist), held), near.square(l, k));
        l.mul(s, l.madd(k.half, held, l.mul(k.bending2, bend)))
    }
}

/// Spans at rest rotated with either end (`axes`), `vec(q_j q_i*)` (`relative`) and the twist `s`.
pub(super) struct Turned<L: Lanes> {
    pub(super) axes: [Vec3<L>; 2],
    relative: Vec3<L>,
    pub(super) twist: L::V,
}

#[inline(always)]
pub(super) fn turned_axes<L: Lanes>(
    l: L,
    two: L::V,
    slot: &Slot,
    particles: &FiniteReady<L>,
    near: &FiniteNear<L>,
) -> Turned<L> {
    let n0: Vec3<L> = load3(l, &slot.span);
    let (qi, qj, sj): (Vec3<L>, Vec3<L>, L::V) = (particles.q, near.q, near.s);
    let ti: Vec3<L> = [
        dot(l, particles.turn[0], n0),
        dot(l, particles.turn[1], n0),
        dot(l, particles.turn[2], n0),
    ];
    // No matrix for the neighbour: it would serve one bond only.
    let tj = turned(l, two, sj, qj, n0);
    // r = vec(q_j q_i*) = s_i q_j - s_j q_i + q_i x q_j.
    let r = axpy(l, qj, particles.s, cross(l, qi, qj));
    let r = minus(l, qi, sj, r);
    Turned {
        axes: [ti, tj],
        relative: r,
        twist: l.mul(two, dot(l, near.n, r)),
    }
}

/// Rotates `n` by the quaternion `(s, q)`: `n + 2 s (q x n) + 2 q x (q x n)`.
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
