//! Load of a bond, to be compared with its strength.

use crate::bond::{BeamMaterial, BeamRigidity, LinearBond, Twist};
use crate::error::Result;
use crate::finite::{Deformed, Pose};
use crate::kernel::lanes::{Lanes, Vec3, plain_dot, scale, sum};
use crate::particles::{BondedParticles, expect_len};
use nalgebra::Vector3;

/// Energy that bonds of [`BeamMaterial::SILICA`]'s radius ratio release per area of a crack in the body,
/// over their strength as an energy per section. Other beams have it in proportion to their section: a
/// crack breaks as many bonds. Measured on edge-cracked strips, the same for both energies:
/// docs/calibration.md has the table.
const RELEASED_SHARE: f64 = 0.78;
/// `κ` of a body's strength in tension `√(E G_c/(π κ d))`, where `d` is the mean diameter of the spheres:
/// half the length of the crack that has this strength in a plate, in diameters. From the strength of plain
/// bars: docs/calibration.md has the table.
const FLAW: f64 = 0.71;

/// Quantity that is compared with the strength of a bond; formulas in [`crate::fracture`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Criterion {
    /// Axial tension \[Pa\].
    Axial,
    /// Largest principal tension of the section \[Pa\].
    Rankine,
    /// Equivalent stress of von Mises in the section \[Pa\].
    Mises,
    /// Elastic energy per section \[J/m²\].
    Energy,
    /// Elastic energy per section \[J/m²\] of a beam in tension; in compression its energy of bending and
    /// torsion, as far as the section is in tension.
    TensileEnergy,
    /// Hydrostatic stress of a particle in tension \[Pa\]: all of its bonds break at once.
    Hydrostatic,
}

/// Strength in tension \[Pa\] that a plain body of Young's modulus `young` \[Pa\] and fracture energy `gc`
/// \[J/m²\] has if its spheres have the mean diameter `diameter` \[m\]: `√(E G_c/(π κ d))`. Energy criteria
/// only.
#[must_use]
pub fn tensile_strength(young: f64, gc: f64, diameter: f64) -> f64 {
    (young * gc / (std::f64::consts::PI * FLAW * diameter)).sqrt()
}

/// Mean diameter of the spheres \[m\] at which a body has both the strength in tension `strength` \[Pa\] and
/// the fracture energy `gc` \[J/m²\]; the inverse of [`tensile_strength`].
#[must_use]
pub fn diameter_of_both(young: f64, gc: f64, strength: f64) -> f64 {
    young * gc / (std::f64::consts::PI * FLAW * strength * strength)
}

/// Largest contribution to the load of a bond when it breaks, by the terms of its criterion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BreakMode {
    /// Tension along the bond.
    Tension,
    /// Compression along the bond.
    Compression,
    /// Bending.
    Bending,
    /// Shear by torsion.
    Torsion,
}

impl BreakMode {
    /// All modes, in the order of their numbers.
    pub(crate) const ALL: [Self; 4] = [Self::Tension, Self::Compression, Self::Bending, Self::Torsion];

    /// Name for tables and reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Tension => "tension",
            Self::Compression => "compression",
            Self::Bending => "bending",
            Self::Torsion => "torsion",
        }
    }
}

/// Section constants of the beams.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Section {
    pub(crate) radius: f64,
    pub(crate) area: f64,
    pub(crate) young: f64,
    pub(crate) shear: f64,
    pub(crate) rigidity: BeamRigidity,
}

impl Section {
    /// `r_b^2 = 4 I/S`.
    pub(crate) fn new(k: &BeamRigidity) -> Self {
        // `I = S r²/4` for a circle: the rigidities give the radius without a further input.
        let radius = 2.0 * (k.bending / k.axial).sqrt();
        let area = std::f64::consts::PI * radius * radius;
        Self {
            radius,
            area,
            young: k.axial / area,
            shear: k.torsion / (0.5 * area * radius * radius),
            rigidity: *k,
        }
    }
}

/// Deformation of one beam: axial strain, twist per length \[rad/m\], end rotations `a`, `b` against the
/// chord \[rad\].
#[derive(Debug, Clone, Copy)]
pub(crate) struct Strain {
    length: f64,
    /// Distance of the centres \[m\]: at rest under small rotations, else the present one.
    distance: f64,
    axial: f64,
    twist: f64,
    a: Vector3<f64>,
    b: Vector3<f64>,
}

impl Strain {
    /// Distance of the centres times the axial strain \[m\]: the trace of the virial over `E S`.
    #[inline]
    pub(crate) fn lever(&self) -> f64 {
        self.distance * self.axial
    }

    #[inline]
    pub(crate) fn linear(bond: &LinearBond, i: &Twist, j: &Twist) -> Self {
        let p = bond.axis;
        let q = p.dot(&p);
        let du = j.linear - i.linear;
        let chord = p.cross(&du);
        // Rotations count relative to the chord, so that a rigid rotation strains nothing.
        let across = |t: &Vector3<f64>| t - p * (p.dot(t) / q) - chord;
        let length = q.sqrt().recip();
        Self {
            length,
            distance: length,
            axial: p.dot(&du),
            twist: p.dot(&(j.angular - i.angular)),
            a: across(&i.angular),
            b: across(&j.angular),
        }
    }

    pub(crate) fn finite(bond: &LinearBond, i: &Pose, j: &Pose) -> Self {
        let Deformed {
            inverse,
            length,
            n,
            stretch,
            t: [ti, tj],
            relative,
        } = Deformed::new(bond, i, j);
        Self {
            length: 1.0 / inverse,
            distance: length,
            axial: stretch * inverse,
            twist: 2.0 * n.dot(&relative.imag()) * inverse,
            a: ti - n * n.dot(&ti),
            b: tj - n * n.dot(&tj),
        }
    }
}

/// Deformations of eight beams under small rotations; see [`Strain`].
pub(crate) struct Strains<L: Lanes> {
    pub(crate) length: L::V,
    pub(crate) axial: L::V,
    pub(crate) twist: L::V,
    pub(crate) a: Vec3<L>,
    pub(crate) b: Vec3<L>,
}

impl<L: Lanes> Strains<L> {
    /// Sum of squares and product of the end rotations.
    #[inline(always)]
    pub(crate) fn bend(&self, l: L) -> L::V {
        let product = l.add(plain_dot(l, self.a, self.a), plain_dot(l, self.a, self.b));
        l.add(product, plain_dot(l, self.b, self.b))
    }

    /// Returns the deformation of the beam in lane `k`.
    pub(crate) fn lane(&self, l: L, k: usize) -> Strain {
        let number = |v: L::V| l.store(v)[k];
        let length = number(self.length);
        Strain {
            length,
            distance: length,
            axial: number(self.axial),
            twist: number(self.twist),
            a: self.a.map(number).into(),
            b: self.b.map(number).into(),
        }
    }
}

impl Criterion {
    /// Returns whether loads and strengths are energies per section \[J/m²\]; otherwise they are stresses
    /// \[Pa\].
    #[must_use]
    pub fn is_energy(self) -> bool {
        matches!(self, Self::Energy | Self::TensileEnergy)
    }

    /// Returns whether loads and strengths belong to particles; otherwise they belong to bonds.
    #[must_use]
    pub fn is_of_particles(self) -> bool {
        self == Self::Hydrostatic
    }

    /// Name in scenes and reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Axial => "axial",
            Self::Rankine => "rankine",
            Self::Mises => "mises",
            Self::Energy => "energy",
            Self::TensileEnergy => "tensile-energy",
            Self::Hydrostatic => "hydrostatic",
        }
    }

    /// Returns the fracture energy of the body over the strength of its bonds \[–\] for beams of this radius
    /// over the mean particle radius, or `None` for stresses: under them the fracture energy depends on the
    /// size of the spheres.
    #[must_use]
    pub fn released_share(self, radius_ratio: f64) -> Option<f64> {
        self.is_energy()
            .then_some(RELEASED_SHARE * (radius_ratio / BeamMaterial::SILICA.radius_ratio).powi(2))
    }

    /// Load of every bond of a body \[Pa, or J/m² where [`Self::is_energy`]\], unweighted and including
    /// broken bonds. For a criterion of particles it is the axial stress.
    ///
    /// `q` is a state of the small-rotation law: `3 n` displacements \[m\], then `3 n` rotations \[rad\].
    ///
    /// # Errors
    /// [`crate::Error::LengthMismatch`] unless `q` has six numbers per particle.
    pub fn loads(self, body: &BondedParticles, q: &[f64]) -> Result<Vec<f64>> {
        expect_len("unknowns", q.len(), 6 * body.len())?;
        let section = Section::new(body.rigidity());
        let three = |first: usize| Vector3::new(q[first], q[first + 1], q[first + 2]);
        let twist = |i: u32| Twist {
            linear: three(3 * i as usize),
            angular: three(3 * (body.len() + i as usize)),
        };
        let load = |(bond, [i, j]): (LinearBond, &[u32; 2])| {
            self.value(&section, &Strain::linear(&bond, &twist(*i), &twist(*j)))
        };
        Ok(body.bonds().zip(body.pairs()).map(load).collect())
    }

    /// Returns the mode with the largest contribution to [`Self::value`].
    pub(crate) fn mode(self, s: &Section, e: &Strain) -> BreakMode {
        let normal = s.young * e.axial;
        let along = if normal < 0.0 {
            BreakMode::Compression
        } else {
            BreakMode::Tension
        };
        let parts = match self {
            // Only bonds in tension reach the strength of this criterion.
            Self::Axial => return BreakMode::Tension,
            // All bonds of a broken particle go, those in compression as well.
            Self::Hydrostatic => return along,
            Self::Energy | Self::TensileEnergy => {
                let k = &s.rigidity;
                let bend = e.a.dot(&e.a) + e.a.dot(&e.b) + e.b.dot(&e.b);
                // The energy of a compression is no part of this criterion.
                let axial = if self == Self::TensileEnergy {
                    e.axial.max(0.0)
                } else {
                    e.axial
                };
                [
                    0.5 * e.length * k.axial * axial * axial,
                    2.0 * k.bending / e.length * bend,
                    0.5 * e.length * k.torsion * e.twist * e.twist,
                ]
            }
            Self::Rankine | Self::Mises => {
                let [bending, shear] = [Self::bending(s, e), (s.shear * s.radius * e.twist).abs()];
                match self {
                    Self::Mises => [normal.abs(), bending, 3.0_f64.sqrt() * shear],
                    _ => [normal, bending, shear],
                }
            }
        };
        let [axial, bending, torsion] = parts;
        if axial >= bending && axial >= torsion {
            along
        } else if bending >= torsion {
            BreakMode::Bending
        } else {
            BreakMode::Torsion
        }
    }

    /// Largest bending stress at either end \[Pa\].
    #[inline]
    fn bending(s: &Section, e: &Strain) -> f64 {
        // End moments of a clamped beam, in units of `E I/l`.
        let (m, n) = (e.a * 4.0 + e.b * 2.0, e.b * 4.0 + e.a * 2.0);
        let moment = m.norm_squared().max(n.norm_squared()).sqrt();
        s.young * s.radius / e.length * moment
    }

    /// Load of a compressed beam under [`Self::TensileEnergy`] \[J/m²\]: its energy of bending and torsion,
    /// reduced by the square of the largest principal tension over that without the compression.
    fn compressed(s: &Section, e: &Strain) -> f64 {
        let bent = Strain { axial: 0.0, ..*e };
        let whole = Self::Rankine.value(s, &bent);
        // A beam without bending and torsion has no tension to lose; the ratio below would be 0/0.
        if whole <= 0.0 {
            return 0.0;
        }
        // Without tension the sum below may come out a last digit under zero.
        let tension = Self::Rankine.value(s, e).max(0.0);
        Self::Energy.value(s, &bent) * (tension / whole).powi(2)
    }

    /// Returns [`Self::value`] of eight bonds under small rotations, with the same bits; `None` for a
    /// criterion that treats compressed bonds apart.
    #[inline(always)]
    pub(crate) fn values<L: Lanes>(self, l: L, s: &Section, e: &Strains<L>) -> Option<L::V> {
        let times = |x: f64, v: L::V| l.mul(l.splat(x), v);
        let k = &s.rigidity;
        let normal = times(s.young, e.axial);
        match self {
            Self::Axial | Self::Hydrostatic => return Some(normal),
            Self::TensileEnergy => return None,
            Self::Energy => {
                let axial = l.mul(times(k.axial, e.axial), e.axial);
                let torsion = l.mul(times(k.torsion, e.twist), e.twist);
                let along = l.mul(times(0.5, e.length), l.add(axial, torsion));
                let bent = l.mul(l.div(l.splat(2.0 * k.bending), e.length), e.bend(l));
                return Some(l.div(l.add(along, bent), l.splat(s.area)));
            }
            Self::Rankine | Self::Mises => {}
        }
        let [four, two] = [l.splat(4.0), l.splat(2.0)];
        let m = sum(l, scale(l, e.a, four), scale(l, e.b, two));
        let n = sum(l, scale(l, e.b, four), scale(l, e.a, two));
        let moment = l.sqrt(l.max(plain_dot(l, m, m), plain_dot(l, n, n)));
        let bending = l.mul(l.div(l.splat(s.young * s.radius), e.length), moment);
        let shear = times(s.shear * s.radius, e.twist);
        let rim = |tension: L::V, share: f64| {
            l.sqrt(l.add(l.mul(tension, tension), l.mul(times(share, shear), shear)))
        };
        if self == Self::Mises {
            let size = l.max(normal, times(-1.0, normal));
            return Some(rim(l.add(size, bending), 3.0));
        }
        let tension = l.add(normal, bending);
        Some(times(0.5, l.add(tension, rim(tension, 4.0))))
    }

    /// Load to be compared with the strength of a bond \[Pa, or J/m²\]; for a criterion of particles, the
    /// stress that the bond contributes.
    #[inline]
    pub(crate) fn value(self, s: &Section, e: &Strain) -> f64 {
        let normal = s.young * e.axial;
        if matches!(self, Self::Axial | Self::Hydrostatic) {
            return normal;
        }
        let twist = e.twist;
        if self == Self::TensileEnergy && normal < 0.0 {
            return Self::compressed(s, e);
        }
        if self.is_energy() {
            let k = &s.rigidity;
            let bend = e.a.dot(&e.a) + e.a.dot(&e.b) + e.b.dot(&e.b);
            let energy = 0.5 * e.length * (k.axial * e.axial * e.axial + k.torsion * twist * twist)
                + 2.0 * k.bending / e.length * bend;
            return energy / s.area;
        }
        let bending = Self::bending(s, e);
        let shear = s.shear * s.radius * twist;
        if self == Self::Mises {
            let tension = normal.abs() + bending;
            // Normal stress and shear at the rim of the section, where both are largest.
            return (tension * tension + 3.0 * shear * shear).sqrt();
        }
        let tension = normal + bending;
        0.5 * (tension + (tension * tension + 4.0 * shear * shear).sqrt())
    }
}

#[cfg(test)]
mod tests;
