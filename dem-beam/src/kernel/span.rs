//! Half-bonds in 128 bits, with the same values seen from either end.
//!
//! The kernel waits for memory, so the fewer bytes a bond has the better. Two numbers describe a bond: the
//! span `d` between the centres and `s = w/l³`, `w` the weight. Every coefficient of both laws is `s` times a
//! polynomial in `d`, except for one division.
//!
//! The span is stored as three integers, in steps of a grid to which [`Grid::snap`] moves the centres.

use super::lanes::LANES;
use crate::bond::LinearBond;
use nalgebra::Vector3;

/// Steps of the grid in one unit: spans of up to one unit fit into 32 bits with the sign.
const STEPS: f64 = (1_u64 << 30) as f64;

/// Grid of points on which the centres of a body may lie.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Grid {
    /// A power of two \[m\] that no component of a bond exceeds.
    unit: f64,
}

impl Grid {
    /// Returns the grid for bonds whose components are at most `longest` \[m\].
    pub(crate) fn for_bonds(longest: f64) -> Self {
        // The next power of two: dividing by it is exact. A length that is not positive belongs to no bond.
        // Clamped, so that the cube of the unit neither overflows nor vanishes.
        let exponent = longest.log2().ceil().clamp(-300.0, 300.0);
        let unit = if longest > 0.0 { exponent.exp2() } else { 1.0 };
        Self { unit }
    }

    /// Distance between neighbouring grid points \[m\].
    pub(crate) fn step(&self) -> f64 {
        self.unit / STEPS
    }

    /// `1/u³` of the unit `u` \[1/m³\].
    pub(crate) fn per_volume(&self) -> f64 {
        (self.unit * self.unit * self.unit).recip()
    }

    /// Returns the grid point nearest to `x` \[m\].
    pub(crate) fn snap(&self, x: &Vector3<f64>) -> Vector3<f64> {
        // The grid is so fine that results do not change noticeably (by at most 5e-10 of the longest bond),
        // and so coarse that differences of centres fit into 32 bits. These are exact, so a rigid motion
        // causes no strain and moments balance to round-off. The step is a power of two: only the rounding to
        // an integer changes anything.
        x.map(|c| (c / self.step()).round() * self.step())
    }

    /// `w/l³` of a bond in units of the grid, rounded to single precision.
    fn stiffness(&self, bond: &LinearBond) -> f32 {
        // `scale = w l`: times `(1/l²)²` this is `w/l³`.
        let q = bond.axis.norm_squared() * self.unit * self.unit;
        (bond.scale / self.unit * q * q) as f32
    }

    /// Returns the bond with its stiffness rounded as the kernel stores it.
    pub(crate) fn rounded(&self, bond: &LinearBond) -> LinearBond {
        let q = bond.axis.norm_squared() * self.unit * self.unit;
        // Rounded before anything is computed from it, and back through the same operations: tests and
        // matrices use the stored number, so that matrix, energy and forces belong to one law.
        LinearBond {
            scale: f64::from(self.stiffness(bond)) / (q * q) * self.unit,
            ..*bond
        }
    }
}

/// Eight half-bonds; all zero in empty lanes.
#[derive(Debug, Clone, Copy, Default)]
// Two cache lines, so that no slot shares a line with its neighbour.
#[repr(C, align(64))]
pub(crate) struct Slot {
    /// Span from the lane's own particle to the other end, in steps of the grid.
    pub(super) span: [[i32; LANES]; 3],
    /// `w/l³` of the bond, with weight `w` and length `l`, in units of the grid.
    pub(super) stiffness: [f32; LANES],
}

impl Slot {
    /// Writes a half-bond, seen from the lane's own particle, into a lane.
    pub(crate) fn set(&mut self, lane: usize, bond: &LinearBond, grid: &Grid) {
        let d = bond.span() / grid.step();
        for (row, d) in self.span.iter_mut().zip(d.iter()) {
            // An integer already, up to round-off of the axis and its inverse.
            row[lane] = d.round() as i32;
        }
        self.stiffness[lane] = grid.stiffness(bond);
    }
}
