//! Bodies that are few spheres wide, and their expected elasticity.
//!
//! A packing has the elasticity of the bulk if it is many spheres wide. Spheres at a wall have fewer
//! neighbours, while the number of bonds per sphere is prescribed, so that the inside gets more bonds. Narrow
//! bodies are stiffer in tension, and their Poisson's ratio is larger and scatters. They are soft in bending
//! and torsion, which the surface layer carries. [`expected`] interpolates our measurements.

use super::cells::{Sphere, centre, mean_radius};
use super::container::Container;
use crate::error::Error;
use nalgebra::Vector3;

/// Width in mean diameters below which a warning is given: the body is a tenth too soft in bending and
/// torsion.
pub const NARROW: f64 = 8.0;

/// Width in mean diameters below which there are, as a rule, too few neighbours for 6.2 bonds per sphere.
const BLAMED: f64 = 3.2;

/// Number of centres whose distance from the walls is measured for the width of a surface.
const PROBED: usize = 400;
/// Width in mean diameters up to which the width of a surface is measured.
const WIDE: f64 = 16.0;

/// Elasticity of a narrow round bar with silica's beams; decision 0020 has the spread.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Narrow {
    /// Young's modulus in tension over that of a wide bar.
    pub young: f64,
    /// Poisson's ratio, 0.174 in a wide bar.
    pub poisson: f64,
    /// Standard deviation of Poisson's ratio from packing to packing.
    pub poisson_spread: f64,
    /// Bending stiffness over E I, with the bar's own E.
    pub bending: f64,
    /// Torsional stiffness over G J, with the bar's own moduli.
    pub torsion: f64,
}

/// Spheres across, then the fields of [`Narrow`]: means of four packings each (two from 8 spheres across on),
/// onset protocol, 6.2 bonds per sphere.
const TABLE: [[f64; 6]; 7] = [
    [3.1, 1.07, 0.185, 0.041, 0.77, 0.78],
    [4.1, 1.07, 0.210, 0.023, 0.85, 0.86],
    [5.1, 1.06, 0.186, 0.007, 0.89, 0.88],
    [6.1, 1.03, 0.175, 0.004, 0.90, 0.90],
    [8.1, 1.02, 0.179, 0.001, 0.92, 0.91],
    [10.0, 1.01, 0.177, 0.001, 0.92, 0.92],
    [13.0, 1.00, 0.174, 0.001, 0.95, 0.94],
];

/// Returns the expected elasticity of a body that is `across` mean diameters wide, by linear interpolation of
/// our measurements. Beyond the measured widths it returns the values at their ends.
#[must_use]
pub fn expected(across: f64) -> Narrow {
    let k = TABLE
        .partition_point(|row| row[0] <= across)
        .clamp(1, TABLE.len() - 1);
    let (a, b) = (TABLE[k - 1], TABLE[k]);
    let t = ((across - a[0]) / (b[0] - a[0])).clamp(0.0, 1.0);
    let [_, young, poisson, poisson_spread, bending, torsion] =
        std::array::from_fn(|c| a[c] + t * (b[c] - a[c]));
    Narrow {
        young,
        poisson,
        poisson_spread,
        bending,
        torsion,
    }
}

/// Returns the narrowest width of a body \[m\]; `None` without walls. For surfaces it is twice the largest
/// distance of a point from the wall, measured up to some sixteen mean diameters.
fn width(body: &Container, spheres: &[Sphere], diameter: f64) -> Option<f64> {
    match body {
        Container::Box { min, max } => Some((max - min).min()),
        Container::Cylinder { length, radius } => Some(length.min(2.0 * radius)),
        Container::Periodic { .. } => None,
        Container::Surface(_) | Container::Around(_) => {
            let reach = 0.5 * WIDE * diameter;
            let mut body = body.clone();
            body.prepare(reach);
            // The deepest of some centres is a good start for the search of the deepest point.
            let probed = spheres.iter().step_by(spheres.len().div_ceil(PROBED));
            let gap = |x: &Vector3<f64>| body.gap(x, reach);
            let deepest = deepest(probed.map(centre), gap);
            deepest.map(|(x, _)| 2.0 * climb(x, 0.5 * diameter, gap))
        }
    }
}

/// Returns the point with the largest distance from the wall (the last of several), and this distance \[m\].
fn deepest(
    points: impl Iterator<Item = Vector3<f64>>,
    gap: impl Fn(&Vector3<f64>) -> f64,
) -> Option<(Vector3<f64>, f64)> {
    points.map(|x| (x, gap(&x))).max_by(|a, b| a.1.total_cmp(&b.1))
}

/// Returns the largest distance from the wall near `x` \[m\], by steps that shrink from `step` \[m\]. The
/// search is needed because sphere centres need not lie in the middle of a body.
fn climb(mut x: Vector3<f64>, mut step: f64, gap: impl Fn(&Vector3<f64>) -> f64) -> f64 {
    let mut best = gap(&x);
    for _ in 0..6 {
        // A step is repeated as long as it leads deeper; the bound limits the search to some diameters.
        for _ in 0..16 {
            let candidates = (0..27).map(|k| {
                x + Vector3::new(f64::from(k % 3), f64::from(k / 3 % 3), f64::from(k / 9)).add_scalar(-1.0)
                    * step
            });
            let Some((next, depth)) = deepest(candidates, &gap) else {
                break;
            };
            // Gains in the last digits would let the search wander along a ridge.
            if depth <= best * (1.0 + 1e-9) {
                break;
            }
            (x, best) = (next, depth);
        }
        step *= 0.5;
    }
    best
}

/// Returns the width of the narrowest body in mean diameters of its spheres.
pub(crate) fn across(bodies: &[Container], spheres: &[Sphere], home: &[u32]) -> Option<f64> {
    let relative_width = |(k, body): (usize, &Container)| {
        let members = spheres.iter().zip(home).filter(|(_, b)| **b as usize == k);
        let members: Vec<Sphere> = members.map(|(s, _)| *s).collect();
        let diameter = 2.0 * mean_radius(&members);
        Some(width(body, &members, diameter)? / diameter)
    };
    let widths = bodies.iter().enumerate().map(relative_width);
    widths.reduce(|a, b| Some(a?.min(b?))).flatten()
}

/// Replaces the error of too few neighbours by one that names the width of the body, if the body is too
/// narrow.
pub(crate) fn name_width(error: Error, body: &Container, spheres: &[Sphere]) -> Error {
    let diameter = 2.0 * mean_radius(spheres);
    match (&error, width(body, spheres, diameter)) {
        (Error::TooFewPairs { .. }, Some(width)) if width < BLAMED * diameter => Error::TooFewAcross {
            count: spheres.len(),
            diameter,
            width,
            across: width / diameter,
        },
        _ => error,
    }
}
