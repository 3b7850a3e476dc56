//! Time functions of loads and prescribed motions.

use crate::error::invalid;
use crate::{Real, Result};

/// A dimensionless function of time.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum TimeFunction<T> {
    /// One from time zero on.
    Step,
    /// Rises linearly from 0 to 1 within `duration` \[s\], then stays.
    Ramp {
        /// Rise time \[s\].
        duration: T,
    },
    /// `sin²(π t/duration)` within `duration` \[s\], then zero.
    SmoothPulse {
        /// Length of the pulse \[s\].
        duration: T,
    },
    /// Linear between `(time, value)` pairs, constant outside.
    Table(Vec<(T, T)>),
}

impl<T: Real> TimeFunction<T> {
    /// Checks durations and tables.
    ///
    /// # Errors
    /// [`crate::Error::InvalidParameter`] for a duration that is not positive, or times that do not rise.
    pub fn validate(&self) -> Result<()> {
        match self {
            Self::Step => Ok(()),
            Self::Ramp { duration } | Self::SmoothPulse { duration } => {
                if *duration > T::zero() && duration.is_finite() {
                    Ok(())
                } else {
                    Err(invalid(
                        "duration of the time function",
                        duration,
                        "must be positive; use a step for an instant load",
                    ))
                }
            }
            Self::Table(rows) => {
                let finite = rows.iter().all(|(t, v)| t.is_finite() && v.is_finite());
                if !rows.is_empty() && finite && rows.windows(2).all(|w| w[0].0 < w[1].0) {
                    Ok(())
                } else {
                    Err(invalid(
                        "table of the time function",
                        format_args!("{} rows", rows.len()),
                        "needs at least one row, finite values and strictly rising times",
                    ))
                }
            }
        }
    }

    /// Value at time `t` \[s\]; zero before time zero except for tables.
    pub fn at(&self, t: T) -> T {
        T::of(self.at_wide(t.as_f64()))
    }

    /// The same in double precision: prescribed motions take differences over a step, of which single precision would
    /// leave nothing.
    pub(crate) fn at_wide(&self, t: f64) -> f64 {
        match self {
            Self::Step => f64::from(u8::from(t >= 0.0)),
            Self::Ramp { duration } => (t / duration.as_f64()).clamp(0.0, 1.0),
            Self::SmoothPulse { duration } => {
                let duration = duration.as_f64();
                if t <= 0.0 || t >= duration {
                    0.0
                } else {
                    let s = (std::f64::consts::PI * t / duration).sin();
                    s * s
                }
            }
            Self::Table(rows) => {
                let k = rows.partition_point(|r| r.0.as_f64() <= t);
                if k == 0 {
                    rows[0].1.as_f64()
                } else if k == rows.len() {
                    rows[k - 1].1.as_f64()
                } else {
                    let [(t0, v0), (t1, v1)] = [rows[k - 1], rows[k]].map(|(t, v)| (t.as_f64(), v.as_f64()));
                    v0 + (v1 - v0) * (t - t0) / (t1 - t0)
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[allow(clippy::float_cmp, reason = "these values are exact")]
    fn values() {
        let r = TimeFunction::Ramp { duration: 2.0 };
        assert_eq!([r.at(-1.0), r.at(1.0), r.at(9.0)], [0.0, 0.5, 1.0]);
        let p = TimeFunction::SmoothPulse { duration: 2.0 };
        assert!((p.at(1.0) - 1.0f64).abs() < 1e-15 && p.at(2.0) == 0.0);
        let t = TimeFunction::Table(vec![(0.0, 1.0), (1.0, 3.0)]);
        assert_eq!([t.at(-1.0), t.at(0.25), t.at(2.0)], [1.0, 1.5, 3.0]);
    }

    #[test]
    fn zero_length_and_unsorted_are_refused() {
        assert!(TimeFunction::SmoothPulse { duration: 0.0f64 }.validate().is_err());
        assert!(
            TimeFunction::Table(vec![(1.0f64, 0.0), (1.0, 1.0)])
                .validate()
                .is_err()
        );
        assert!(TimeFunction::<f64>::Table(vec![]).validate().is_err());
    }
}
