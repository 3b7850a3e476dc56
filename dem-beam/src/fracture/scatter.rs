//! Strengths that differ from bond to bond.

use crate::error::{Error, Result};
use nalgebra::Vector3;

/// Scatter of strengths. The strength of a bond depends on the seed and on the positions of its two
/// particles, not on the numbering of particles or bonds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Scatter {
    /// All bonds have the same strength.
    None,
    /// Weibull distribution; the given strength is the characteristic one.
    Weibull {
        /// Modulus, above zero: 5 to 20 for glass, larger for less scatter.
        modulus: f64,
    },
    /// Normal distribution, cut off at three deviations; the given strength is the mean.
    Normal {
        /// Standard deviation over mean, below 1/3.
        deviation: f64,
    },
}

impl Scatter {
    pub(crate) fn check(self) -> Result<()> {
        let bad = |name, value, range| Err(Error::out_of_range(name, value, range));
        match self {
            Self::Weibull { modulus } if !(modulus > 0.0 && modulus.is_finite()) => {
                bad("Weibull modulus", modulus, "finite values > 0")
            }
            Self::Normal { deviation } if !(0.0..1.0 / 3.0).contains(&deviation) => {
                bad("relative deviation of the strength", deviation, "[0, 1/3)")
            }
            _ => Ok(()),
        }
    }

    /// Factor on the strength of the bond between two centres \[–\].
    pub(crate) fn factor(self, seed: u64, first: &Vector3<f64>, second: &Vector3<f64>) -> f64 {
        // A sum, so that the order of the two ends does not matter.
        let identity = mix(seed ^ place(first).wrapping_add(place(second)));
        let u = uniform(identity);
        match self {
            Self::None => 1.0,
            // The inverse of the distribution `1 − exp(−s^m)`.
            Self::Weibull { modulus } => (-(1.0 - u).ln()).powf(1.0 / modulus),
            Self::Normal { deviation } => {
                let angle = std::f64::consts::TAU * uniform(mix(identity));
                // Box and Muller: two uniform numbers make a normal one.
                let z = (-2.0 * (1.0 - u).ln()).sqrt() * angle.cos();
                // With deviations below 1/3 the cut at three keeps strengths positive.
                1.0 + deviation * z.clamp(-3.0, 3.0)
            }
        }
    }
}

/// Maps bits to (0, 1): the middle of one of 2^52 equal parts, so that logarithms stay finite.
fn uniform(bits: u64) -> f64 {
    ((bits >> 12) as f64 + 0.5) / (1_u64 << 52) as f64
}

fn place(x: &Vector3<f64>) -> u64 {
    x.iter().fold(0x9e37_79b9_7f4a_7c15, |h, c| mix(h ^ c.to_bits()))
}

/// The finalizer of splitmix64.
fn mix(x: u64) -> u64 {
    let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}
