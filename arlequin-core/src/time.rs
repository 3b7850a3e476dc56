//! Time functions of loads and prescribed motions.

mod antiderivative;

use crate::error::invalid;
use crate::{Real, Result};
use std::sync::{Arc, Mutex};

/// A function of time given by a formula, with the text of the formula.
#[derive(Clone)]
pub struct Formula {
    text: Arc<str>,
    function: Arc<dyn Fn(f64) -> f64 + Send + Sync>,
    /// Integrals up to certain times, computed on request.
    sums: Arc<Mutex<Vec<f64>>>,
}

impl Formula {
    /// Formula with its text. The function must always return the same value at the same time.
    pub fn new(text: &str, function: impl Fn(f64) -> f64 + Send + Sync + 'static) -> Self {
        Self {
            text: text.into(),
            function: Arc::new(function),
            sums: Arc::default(),
        }
    }

    /// Value at time `t` \[s\]. Before time zero the formula goes on; where it is not finite there, its value
    /// at zero is taken.
    pub fn value(&self, t: f64) -> f64 {
        // Formulas such as `sqrt(t)` have no value before time zero, where integrals and differences may ask.
        let value = (self.function)(t);
        if t < 0.0 && !value.is_finite() {
            return (self.function)(0.0);
        }
        value
    }
}

impl std::fmt::Debug for Formula {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Formula {}", self.text)
    }
}

/// Equal if the texts are equal.
impl PartialEq for Formula {
    fn eq(&self, other: &Self) -> bool {
        self.text == other.text
    }
}

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
    /// Any formula.
    Formula(Formula),
    /// `∫_0^t` of another function \[s\], for a motion given by its speed. Exact except for formulas and
    /// integrals, whose intervals are halved until two rules of quadrature agree to round-off.
    Integral(Box<Self>),
}

impl<T: Real> TimeFunction<T> {
    /// Checks durations and tables.
    ///
    /// # Errors
    /// [`crate::Error::InvalidParameter`] for a duration that is not positive, or times that do not rise.
    pub fn validate(&self) -> Result<()> {
        match self {
            Self::Step => Ok(()),
            Self::Formula(f) if f.value(0.0).is_finite() => Ok(()),
            Self::Formula(f) => Err(invalid(
                "formula of the time function",
                &f.text,
                "must be finite at t = 0",
            )),
            Self::Integral(integrand) => integrand.validate(),
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
                // Strictly rising: two values at one time would have no difference quotient.
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

    /// Value at time `t` \[s\]; zero before time zero except for tables, formulas and their integrals.
    pub fn value(&self, t: T) -> T {
        T::of(self.at_wide(t.as_f64()))
    }

    /// Value in double precision: prescribed motions take differences over a step, which single precision
    /// would lose.
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
            Self::Formula(f) => f.value(t),
            Self::Integral(integrand) => integrand.integral(t),
            Self::Table(rows) => {
                // By bisection: tables may be long, and are read in every step.
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

impl<T: Real> TimeFunction<T> {
    /// `∫_0^t f dt` \[s\].
    fn integral(&self, t: f64) -> f64 {
        match self {
            Self::Step => t.max(0.0),
            Self::Ramp { duration } => {
                let (d, inside) = (duration.as_f64(), t.clamp(0.0, duration.as_f64()));
                0.5 * inside * inside / d + (t - d).max(0.0)
            }
            Self::SmoothPulse { duration } => {
                let d = duration.as_f64();
                let inside = t.clamp(0.0, d);
                let turn = 2.0 * std::f64::consts::PI / d;
                0.5 * inside - (turn * inside).sin() / (2.0 * turn)
            }
            Self::Table(rows) => {
                // Trapezia between the rows from zero to t.
                let mut between: Vec<f64> = rows.iter().map(|r| r.0.as_f64()).collect();
                let (low, high) = (t.min(0.0), t.max(0.0));
                between.retain(|x| (low..high).contains(x));
                between.extend([low, high]);
                between.sort_by(f64::total_cmp);
                let part = |w: &[f64]| 0.5 * (w[1] - w[0]) * (self.at_wide(w[0]) + self.at_wide(w[1]));
                // Before time zero the integral runs backwards.
                t.signum() * between.windows(2).map(part).sum::<f64>()
            }
            Self::Formula(f) => f.integral(t),
            Self::Integral(_) => antiderivative::integral_between(&|t| self.at_wide(t), 0.0, t),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integrals_are_those_of_the_functions() {
        let integral = |f: TimeFunction<f64>, t: f64| TimeFunction::Integral(Box::new(f)).value(t);
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-14, "{a} {b}");
        near(integral(TimeFunction::Step, 3.0), 3.0);
        near(integral(TimeFunction::Step, -3.0), 0.0);
        near(integral(TimeFunction::Ramp { duration: 2.0 }, 5.0), 4.0);
        near(integral(TimeFunction::Ramp { duration: 2.0 }, 1.0), 0.25);
        near(integral(TimeFunction::SmoothPulse { duration: 2.0 }, 9.0), 1.0);
        near(integral(TimeFunction::SmoothPulse { duration: 2.0 }, 1.0), 0.5);
        let table = TimeFunction::Table(vec![(0.0, 1.0), (1.0, 3.0), (2.0, 3.0)]);
        near(integral(table.clone(), 0.5), 0.75);
        near(integral(table.clone(), 4.0), 2.0 + 3.0 + 6.0);
        near(integral(table, -2.0), -2.0);
        let wave = TimeFunction::Formula(Formula::new("cos(t)", f64::cos));
        near(integral(wave, 2.0), 2.0_f64.sin());
    }

    #[test]
    fn formulas_say_what_they_are_and_must_be_finite_at_the_start() {
        let root = Formula::new("sqrt(t)", f64::sqrt);
        assert!(root == Formula::new("sqrt(t)", f64::sqrt) && root != Formula::new("t", |t| t));
        assert!(root.value(-1.0).abs() < 1e-300 && (root.value(4.0) - 2.0).abs() < 1e-15);
        assert_eq!(format!("{root:?}"), "Formula sqrt(t)");
        let pole = Formula::new("1/t", |t| 1.0 / t);
        let told = TimeFunction::<f64>::Formula(pole)
            .validate()
            .unwrap_err()
            .to_string();
        assert!(told.contains("1/t") && told.contains("finite at t = 0"), "{told}");
    }

    #[test]
    #[allow(clippy::float_cmp, reason = "these values are exact")]
    fn values() {
        let r = TimeFunction::Ramp { duration: 2.0 };
        assert_eq!([r.value(-1.0), r.value(1.0), r.value(9.0)], [0.0, 0.5, 1.0]);
        let p = TimeFunction::SmoothPulse { duration: 2.0 };
        assert!((p.value(1.0) - 1.0f64).abs() < 1e-15 && p.value(2.0) == 0.0);
        let t = TimeFunction::Table(vec![(0.0, 1.0), (1.0, 3.0)]);
        assert_eq!([t.value(-1.0), t.value(0.25), t.value(2.0)], [1.0, 1.5, 3.0]);
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
