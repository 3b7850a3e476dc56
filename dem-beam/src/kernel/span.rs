//! Bonds in 128 bits, the same seen from either end.
//!
//! The kernel waits for memory, so the fewer bytes a bond has the better. Two numbers say all: the span `d`
//! between the centres and `s = w/l³`, `w` the weight; every coefficient of both laws is `s` times a
//! polynomial in `d` but for one division. Spans are three integers: [`Grid::snap`] moves centres to a grid
//! so fine that nothing notices (half a thousand-millionth of the longest bond) and so coarse that
//! differences of centres fit 32 bits. They are exact, so that a rigid motion strains nothing and moments
//! balance to round-off. Stiffnesses have 24 bits and are rounded before anything is made of them: matrix,
//! energy and forces are of one law.

use super::lanes::LANES;
use crate::bond::LinearBond;
use nalgebra::Vector3;

/// Steps of a grid in its unit.
const STEPS: f64 = (1_u64 << 30) as f64;

/// Where the centres of a body may be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Grid {
    /// A power of two \[m\] that no component of a bond exceeds.
    unit: f64,
}

impl Grid {
    /// The grid for bonds whose components are at most `longest` \[m\].
    pub(crate) fn for_bonds(longest: f64) -> Self {
        // The next power of two; what is not a length makes no bond.
        let exponent = longest.log2().ceil().clamp(-300.0, 300.0);
        let unit = if longest > 0.0 { exponent.exp2() } else { 1.0 };
        Self { unit }
    }

    /// Distance of neighbouring points \[m\].
    pub(crate) fn step(&self) -> f64 {
        self.unit / STEPS
    }

    /// `1/u³` \[1/m³\].
    pub(crate) fn per_volume(&self) -> f64 {
        (self.unit * self.unit * self.unit).recip()
    }

    /// The nearest point.
    pub(crate) fn snap(&self, x: &Vector3<f64>) -> Vector3<f64> {
        x.map(|c| (c / self.step()).round() * self.step())
    }

    /// `w/l³` of a bond, in units of the grid.
    fn stiffness(&self, bond: &LinearBond) -> f32 {
        let q = bond.axis.norm_squared() * self.unit * self.unit;
        (bond.scale / self.unit * q * q) as f32
    }

    /// The bond as the kernel will see it.
    pub(crate) fn rounded(&self, bond: &LinearBond) -> LinearBond {
        let q = bond.axis.norm_squared() * self.unit * self.unit;
        LinearBond {
            scale: f64::from(self.stiffness(bond)) / (q * q) * self.unit,
            ..*bond
        }
    }
}

/// Eight half-bonds; zero in empty lanes.
#[derive(Debug, Clone, Copy, Default)]
#[repr(C, align(64))]
pub(crate) struct Slot {
    /// From the own particle to the other, in steps of the grid.
    pub(super) span: [[i32; LANES]; 3],
    /// `w/l³`.
    pub(super) stiffness: [f32; LANES],
}

impl Slot {
    /// Writes a half-bond, seen from its own particle, into a lane.
    pub(crate) fn set(&mut self, lane: usize, bond: &LinearBond, grid: &Grid) {
        let d = bond.span() / grid.step();
        for (to, d) in self.span.iter_mut().zip(d.iter()) {
            to[lane] = d.round() as i32;
        }
        self.stiffness[lane] = grid.stiffness(bond);
    }
}
