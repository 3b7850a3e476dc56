//! Strength check inside the force kernel.
//!
//! The force kernel already has what the fracture criteria need: strain, twist and end rotations of eight
//! bonds at a time. Each half-bond compares the moment at its own end, so that both ends of a bond are
//! checked. The comparison uses a limit that lies [`MARGIN`] below the strength, and it marks whole blocks.
//! The caller then checks the bonds of marked blocks with the exact criterion. No block with a breaking bond
//! is missed unless round-off reaches the margin, which [`Screen::new`] rules out.
//!
//! ```text
//! N = E e   B = E r_b/l |m|   m = 4 a + 2 b   tau = G r_b twist/l
//! axial     N >= s
//! rankine   s B >= s^2 - tau^2 - s N           (from N + B + sqrt((N + B)^2 + 4 tau^2) >= 2 s)
//! mises     |N| + B >= sqrt(s^2 - 3 tau^2)
//! energy    U >= s S
//! tensile-energy    U >= s S, with max(e, 0) in place of e
//! hydrostatic       Σ l (l - l0)/L >= 1 over the bonds of a particle
//! ```
//!
//! A particle breaks if one bond alone has `l (l - l0) = L`
//! ([`crate::fracture::particles::ParticleStrengths::half_bond`]).
//!
//! The line of `tensile-energy` is an upper bound of the exact load. The exact load is equal to it in
//! tension, and in compression is a share of the energy of bending and torsion.
//!
//! `x >= y` is tested as `x^2 >= y |y|` where `x` is a root. All terms are divided by the lowest strength
//! beforehand, and multiplied by a length where this saves a division.

use super::engine::{Marks, Posed};
use super::lanes::{CacheLine, LANES, Lanes, Vec3, axpy, cross, dot, load3, minus, scale, sum};
use super::law::{Finite, FiniteNear, FiniteReady, Linear, Rigidity, turned_axes};
use super::span::Slot;
use super::visit::Visitor;
use crate::fracture::Criterion;
use crate::fracture::criterion::Section;

/// Relative distance of the limits below the strengths.
const MARGIN: f64 = 1e-3;

/// Limit of [`Screen::turn`], in place of infinity: products with it stay finite.
const NEVER: f64 = 1e60;

/// Lowest strength, as a strain; round-off in the kernel stays below a thousandth of it.
const LEAST_STRAIN: f64 = 1e-8;

/// Limits against which half-bonds are checked.
#[derive(Debug, Clone)]
pub(crate) struct Screen {
    pub(crate) criterion: Criterion,
    section: Section,
    /// Lowest of all limits \[Pa or J/m²\].
    limit: f64,
    /// The lowest limit over the limit of each half-bond, if strengths differ.
    ratios: Option<Vec<CacheLine>>,
    /// Largest `|th|^2` of a particle for which the squares of the linear law are accurate enough.
    turn: f64,
}

impl Screen {
    /// Makes a screen from the `strengths` of all bonds or particles \[Pa or J/m²\] and the smallest and
    /// largest of the `lengths` of bonds \[m\]. Returns `None` if strengths are so low that round-off could
    /// hide a break.
    pub(crate) fn new(
        criterion: Criterion,
        section: Section,
        strengths: &[f64],
        lengths: [f64; 2],
    ) -> Option<Self> {
        let [shortest, longest] = lengths;
        // Ratios to the lowest limit let one test serve bonds of all strengths.
        let least = strengths.iter().copied().fold(f64::INFINITY, f64::min);
        // The stress at which the longest bond reaches the energy `w` in pure tension: `w = stress^2 l / (2
        // E)`.
        let stress = match criterion {
            c if c.is_energy() => section.young * (2.0 * least / (section.young * longest)).sqrt(),
            _ => least,
        };
        // In the linear law `|m|^2` comes from rotations that may cancel. Its error is below `1e-12 (E r_b/l
        // th)^2`, which must stay a thousandth below the square of the strength. At this rotation it is a
        // millionth of that square. Blocks with larger rotations are marked without a check.
        let turn = 1e3 * stress * shortest / (section.young * section.radius);
        (stress > LEAST_STRAIN * section.young).then(|| Self {
            criterion,
            section,
            // The margin exceeds the round-off of the kernel, so that no breaking bond is missed.
            limit: (1.0 - MARGIN) * least,
            ratios: None,
            turn: (turn * turn).min(NEVER),
        })
    }

    /// Allocates one limit per half-bond, `slots` rows of them; at first no half-bond can reach its limit.
    pub(crate) fn with_ratios(mut self, slots: usize) -> Self {
        // Zero is the ratio to an infinite limit.
        self.ratios = Some(vec![CacheLine([0.0; LANES]); slots]);
        self
    }

    /// Writes the strength of the half-bond in a lane of a slot, if limits differ; under a criterion of
    /// particles, its limit `L` \[m²\].
    pub(crate) fn set(&mut self, slot: usize, lane: usize, strength: f64) {
        if let Some(row) = self.ratios.as_mut().and_then(|e| e.get_mut(slot)) {
            row.0[lane] = self.limit / ((1.0 - MARGIN) * strength);
        }
    }
}

/// Constants of a [`Screen`] in all lanes, divided by its limit.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Test<L: Lanes> {
    criterion: Criterion,
    one: L::V,
    zero: L::V,
    two: L::V,
    three: L::V,
    /// Inverse of the limit.
    inverse: L::V,
    /// `E`, `(2 E r_b)^2` (half moments are compared), `(G r_b)^2`.
    young: L::V,
    bend: L::V,
    shear: L::V,
    /// Half of `E S` and of `G I_O`, and `2 E I` times 3/4 and 1/4, all over `S`.
    stretch: L::V,
    twist: L::V,
    sum: L::V,
    difference: L::V,
}

impl<L: Lanes> Test<L> {
    #[inline(always)]
    fn new(l: L, s: &Screen) -> Self {
        let Section {
            radius,
            area,
            young,
            shear,
            ..
        } = s.section;
        let k = &s.section.rigidity;
        let (stress, energy) = (1.0 / s.limit, 1.0 / (s.limit * area));
        let (bend, shear) = (2.0 * young * radius * stress, shear * radius * stress);
        Self {
            criterion: s.criterion,
            one: l.splat(1.0),
            zero: l.splat(0.0),
            two: l.splat(2.0),
            three: l.splat(3.0),
            inverse: l.splat(stress),
            young: l.splat(young * stress),
            bend: l.splat(bend * bend),
            shear: l.splat(shear * shear),
            stretch: l.splat(0.5 * k.axial * energy),
            twist: l.splat(0.5 * k.torsion * energy),
            // a.a + a.b + b.b = 3/4 |a + b|^2 + 1/4 |a - b|^2
            sum: l.splat(1.5 * k.bending * energy),
            difference: l.splat(0.5 * k.bending * energy),
        }
    }

    /// Returns values above zero where normal stress `n`, bending stress of square `b` and shear stress of
    /// square `t` reach 1.
    #[inline(always)]
    fn stress_excess(&self, l: L, n: L::V, b: L::V, t: L::V) -> L::V {
        if matches!(self.criterion, Criterion::Mises) {
            let remainder = l.nmadd(self.three, t, self.one);
            let clamped = l.max(remainder, self.zero);
            let room = l.sub(l.sqrt(clamped), self.size(l, n));
            // Shear stress beyond the limit leaves no room for bending: `clamped - remainder` is then
            // positive and marks the lane whatever the other stresses are.
            return l.add(l.nmadd(room, self.size(l, room), b), l.sub(clamped, remainder));
        }
        let room = l.sub(l.sub(self.one, t), n);
        // `room |room|` keeps the sign of a negative room, which marks the lane.
        l.nmadd(room, self.size(l, room), b)
    }

    /// Strain, or change of length, whose axial energy counts.
    #[inline(always)]
    fn stretched(&self, l: L, x: L::V) -> L::V {
        if matches!(self.criterion, Criterion::TensileEnergy) {
            return l.max(x, self.zero);
        }
        x
    }

    #[inline(always)]
    fn size(&self, l: L, x: L::V) -> L::V {
        l.max(x, l.sub(self.zero, x))
    }

    /// Multiplies a stress by the ratio of limits where limits differ, or a square by its square.
    #[inline(always)]
    fn scaled(&self, l: L, x: L::V, ratio: Option<L::V>) -> L::V {
        match ratio {
            Some(s) => l.mul(x, s),
            None => x,
        }
    }
}

/// A law whose bonds can be screened for strength.
pub(crate) trait Screened: Posed {
    /// Returns values above zero where a half-bond may have reached its limit; for a criterion of particles,
    /// the shares of the limits of the particles that the half-bonds take.
    fn excess<L: Lanes>(
        l: L,
        k: &Rigidity<L>,
        t: &Test<L>,
        slot: &Slot,
        particles: &Self::Ready<L>,
        near: &Self::Near<L>,
        ratio: Option<L::V>,
    ) -> L::V;

    /// Square of the rotations of the own particles if it limits the accuracy of the check, else zero.
    fn turn<L: Lanes>(l: L, particles: &Self::Ready<L>) -> L::V;
}

impl Screened for Linear {
    #[inline(always)]
    fn excess<L: Lanes>(
        l: L,
        k: &Rigidity<L>,
        t: &Test<L>,
        slot: &Slot,
        &[_, ti]: &[Vec3<L>; 2],
        &[du, tj]: &[Vec3<L>; 2],
        ratio: Option<L::V>,
    ) -> L::V {
        let d: Vec3<L> = load3(l, &slot.span);
        if matches!(t.criterion, Criterion::Hydrostatic) {
            // A term of a sum over the bonds of a particle: `begin` starts it at minus one and `visit` adds
            // up.
            let taken = l.mul(l.mul(t.inverse, k.step), dot(l, d, du));
            return t.scaled(l, taken, ratio);
        }
        // `n/l`, and zero in empty lanes.
        let per = l.mul(k.per_step, l.recip(l.max(dot(l, d, d), k.one)));
        let p = scale(l, d, per);
        let strain = dot(l, p, du);
        // The axial criterion needs only the strain: returning here skips the moments.
        if matches!(t.criterion, Criterion::Axial) {
            return l.sub(t.scaled(l, l.mul(t.young, strain), ratio), t.one);
        }
        let q = dot(l, p, p);
        let c = cross(l, p, du);
        let (pi, pj) = (dot(l, p, ti), dot(l, p, tj));
        let twist = l.sub(pj, pi);
        let rotation_sum = sum(l, ti, tj);
        if matches!(t.criterion, Criterion::Energy | Criterion::TensileEnergy) {
            let strain = t.stretched(l, strain);
            let a = minus(l, c, t.two, rotation_sum);
            let b = [l.sub(ti[0], tj[0]), l.sub(ti[1], tj[1]), l.sub(ti[2], tj[2])];
            let stretch = l.mul(t.stretch, l.mul(strain, strain));
            let held = l.madd(t.twist, l.mul(twist, twist), stretch);
            let held = l.madd(t.sum, across(l, q, a, l.add(pi, pj)), held);
            let held = l.madd(t.difference, across(l, q, b, twist), held);
            return l.sub(t.scaled(l, held, ratio), l.sqrt(q));
        }
        // `2 a + b`, half of the moment `m`; the factor two is in `t.bend`.
        let half = minus(l, c, t.three, sum(l, ti, rotation_sum));
        // Squares are compared: no root per bond.
        let square = squared(l, ratio);
        let bend = t.scaled(
            l,
            l.mul(t.bend, across(l, q, half, l.madd(t.two, pi, pj))),
            square,
        );
        let shear = t.scaled(l, l.mul(t.shear, l.mul(twist, twist)), square);
        t.stress_excess(l, t.scaled(l, l.mul(t.young, strain), ratio), bend, shear)
    }

    #[inline(always)]
    fn turn<L: Lanes>(l: L, &[_, th]: &[Vec3<L>; 2]) -> L::V {
        dot(l, th, th)
    }
}

impl Screened for Finite {
    #[inline(always)]
    fn excess<L: Lanes>(
        l: L,
        k: &Rigidity<L>,
        t: &Test<L>,
        slot: &Slot,
        particles: &FiniteReady<L>,
        near: &FiniteNear<L>,
        ratio: Option<L::V>,
    ) -> L::V {
        let rest_length = near.rest_length;
        let (n, stretch) = (near.n, near.stretch);
        if matches!(t.criterion, Criterion::Hydrostatic) {
            let length = l.add(rest_length, stretch);
            return t.scaled(l, l.mul(t.inverse, l.mul(length, stretch)), ratio);
        }
        if matches!(t.criterion, Criterion::Axial) {
            return l.sub(t.scaled(l, l.mul(t.young, stretch), ratio), rest_length);
        }
        let turned = turned_axes(l, t.two, slot, particles, near);
        let ([ti, tj], twist) = (turned.axes, turned.twist);
        let (ci, cj) = (dot(l, n, ti), dot(l, n, tj));
        // Squares of rotated spans, multiplied by this, are squares of rotated axes.
        let unit = l.recip(near.square(l, k));
        if matches!(t.criterion, Criterion::Energy | Criterion::TensileEnergy) {
            let stretch = t.stretched(l, stretch);
            let axis_sum = minus(l, n, l.add(ci, cj), sum(l, ti, tj));
            let axis_difference = [l.sub(ti[0], tj[0]), l.sub(ti[1], tj[1]), l.sub(ti[2], tj[2])];
            let axis_difference = minus(l, n, l.sub(ci, cj), axis_difference);
            let bent = l.madd(
                t.sum,
                dot(l, axis_sum, axis_sum),
                l.mul(t.difference, dot(l, axis_difference, axis_difference)),
            );
            let held = l.madd(
                t.twist,
                l.mul(twist, twist),
                l.mul(t.stretch, l.mul(stretch, stretch)),
            );
            let held = l.madd(bent, unit, held);
            return l.sub(t.scaled(l, held, ratio), rest_length);
        }
        let half = minus(l, n, l.madd(t.two, ci, cj), axpy(l, ti, t.two, tj));
        // Strains are length changes over the length at rest.
        let per = l.recip(rest_length);
        let per = t.scaled(l, per, ratio);
        let square = l.mul(per, per);
        let bent = l.mul(dot(l, half, half), unit);
        let bend = l.mul(l.mul(t.bend, bent), square);
        let shear = l.mul(l.mul(t.shear, l.mul(twist, twist)), square);
        t.stress_excess(l, l.mul(l.mul(t.young, stretch), per), bend, shear)
    }

    #[inline(always)]
    fn turn<L: Lanes>(l: L, _: &FiniteReady<L>) -> L::V {
        l.splat(0.0)
    }
}

/// `q |x_p|^2`, where `x_p` is the part of `x` across an axis `p`, `q = p.p` and `px = p.x`.
#[inline(always)]
fn across<L: Lanes>(l: L, q: L::V, x: Vec3<L>, px: L::V) -> L::V {
    l.nmadd(px, px, l.mul(q, dot(l, x, x)))
}

/// Square of an optional ratio.
#[allow(clippy::manual_map, reason = "a closure would not be compiled for the lanes")]
#[inline(always)]
fn squared<L: Lanes>(l: L, ratio: Option<L::V>) -> Option<L::V> {
    // Not `map`: closures are compiled without the instructions of the caller.
    match ratio {
        Some(s) => Some(l.mul(s, s)),
        None => None,
    }
}

/// Collects the largest excess in each block, or the sums of the shares of its particles less one, and marks
/// blocks in which it is positive.
pub(crate) struct StrengthCheck<'a, L: Lanes> {
    l: L,
    test: Test<L>,
    ratios: Option<&'a [CacheLine]>,
    turn: L::V,
    worst: L::V,
    /// Set for blocks in which a bond exceeded its limit.
    marks: &'a mut [bool],
}

impl<'a, L: Lanes> StrengthCheck<'a, L> {
    #[inline(always)]
    pub(crate) fn new(l: L, (screen, marks): Marks<'a>) -> Self {
        Self {
            l,
            test: Test::new(l, screen),
            ratios: screen.ratios.as_deref(),
            turn: l.splat(screen.turn),
            worst: l.splat(-1.0),
            marks,
        }
    }
}

impl<L: Lanes, W: Screened> Visitor<L, W> for StrengthCheck<'_, L> {
    #[inline(always)]
    fn begin(&mut self, particles: &W::Ready<L>) {
        self.worst = match self.test.criterion {
            Criterion::Hydrostatic => self.l.sub(self.test.zero, self.test.one),
            // Positive for particles with rotations too large for the squares: their block is always marked.
            _ => self.l.sub(W::turn(self.l, particles), self.turn),
        };
    }

    #[inline(always)]
    fn visit(
        &mut self,
        k: &Rigidity<L>,
        index: usize,
        slot: &Slot,
        particles: &W::Ready<L>,
        near: &W::Near<L>,
    ) {
        let l = self.l;
        #[allow(clippy::manual_map, reason = "as in `squared`")]
        let ratio = match self.ratios {
            Some(rows) => Some(l.load(&rows[index].0)),
            None => None,
        };
        let excess = W::excess(l, k, &self.test, slot, particles, near, ratio);
        self.worst = match self.test.criterion {
            Criterion::Hydrostatic => l.add(self.worst, excess),
            // The worst bond of each lane decides; the exact criterion then finds the bond in marked blocks.
            _ => l.max(excess, self.worst),
        };
    }

    #[inline(always)]
    fn end(&mut self, b: usize) {
        // Strictly above zero, because empty lanes give exactly zero.
        self.marks[b] = self.l.store(self.worst).iter().any(|x| *x > 0.0);
    }
}
