//! Checks of spheres and bonds.

use super::{COINCIDENT, MAX_RADIUS_RATIO};
use crate::bond::LinearBond;
use crate::error::{Error, Result, finite};
use crate::packing::cells::image;
use nalgebra::Vector3;

/// Refuses an array of the wrong length.
pub(crate) fn expect_len(what: &'static str, found: usize, expected: usize) -> Result<()> {
    if found == expected {
        Ok(())
    } else {
        Err(Error::LengthMismatch {
            what,
            found,
            expected,
        })
    }
}

/// Refuses centres that are not finite, radii that are not positive, a ratio of radii above
/// [`MAX_RADIUS_RATIO`], and an empty list.
pub(crate) fn check_spheres(positions: &[Vector3<f64>], radii: &[f64]) -> Result<()> {
    expect_len("radii", radii.len(), positions.len())?;
    if positions.is_empty() {
        return Err(Error::out_of_range("number of particles", 0.0, "values >= 1"));
    }
    for (i, p) in positions.iter().enumerate() {
        for c in p.iter() {
            finite("coordinate", "particle", i, *c)?;
        }
    }
    let (mut low, mut high) = (f64::INFINITY, 0.0_f64);
    for (particle, &radius) in radii.iter().enumerate() {
        if !(radius.is_finite() && radius > 0.0) {
            return Err(Error::BadRadius { particle, radius });
        }
        low = low.min(radius);
        high = high.max(radius);
    }
    // One part in 1e9 more, so that a ratio of exactly the limit passes in spite of round-off.
    if high > low * MAX_RADIUS_RATIO * (1.0 + 1e-9) {
        return Err(Error::RadiusRatio {
            smallest: low,
            largest: high,
            ratio: high / low,
            limit: MAX_RADIUS_RATIO,
        });
    }
    Ok(())
}

/// Returns the bond of a pair, with weight 1.
pub(super) fn make_bond(
    bond: usize,
    [i, j]: [u32; 2],
    positions: &[Vector3<f64>],
    radii: &[f64],
    period: Option<[f64; 3]>,
) -> Result<LinearBond> {
    let (first, second) = (i as usize, j as usize);
    let particle = first.max(second);
    if particle >= positions.len() {
        return Err(Error::NoSuchParticle {
            bond,
            particle,
            count: positions.len(),
        });
    }
    let d: [f64; 3] = (positions[second] - positions[first]).into();
    let d = Vector3::from(period.map_or(d, |p| image(d, &p)));
    let length = d.norm();
    // Relative to the radii: the limit must not depend on the unit of length.
    let limit = COINCIDENT * (radii[first] + radii[second]);
    if first == second {
        return Err(Error::ZeroLengthBond {
            bond,
            first,
            second,
            length,
            limit,
        });
    }
    if length <= limit {
        return Err(Error::CoincidentParticles {
            first: first.min(second),
            second: particle,
            distance: length,
            limit,
        });
    }
    LinearBond::new(Vector3::zeros(), d, 1.0)
}
