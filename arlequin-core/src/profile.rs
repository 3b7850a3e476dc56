//! Profiles: how a weight grows across an overlap, `p(s)` with `s` from 0 at the fine border to 1 at the
//! coarse one.

use crate::error::invalid;
use crate::named::named;
use crate::{Real, Result};
use std::sync::Arc;

/// Shape of the transition.
#[derive(Debug, Clone, PartialEq)]
pub enum Profile<T> {
    /// A constant in the whole overlap.
    Constant(T),
    /// `p = s` (C0).
    Linear,
    /// `p = 3s² − 2s³` (C1).
    Cubic,
    /// `p = 10s³ − 15s⁴ + 6s⁵` (C2).
    Quintic,
    /// A C1 profile whose derivative is piecewise linear between stations of `s`, the positions of the
    /// mediator nodes. Then `grad f` lies in the mediator space and the patch test is exact. Built by
    /// [`Profile::mediator_compatible`].
    Compatible(CompatibleProfile<T>),
    /// A user-defined function. Built by [`Profile::custom`].
    Custom(CustomProfile<T>),
}

/// A profile given as a function, see [`Profile::custom`].
#[derive(Clone)]
pub struct CustomProfile<T>(Arc<dyn Fn(T) -> T + Send + Sync>);

impl<T> std::fmt::Debug for CustomProfile<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("CustomProfile")
    }
}

/// Equal only to copies of itself.
impl<T> PartialEq for CustomProfile<T> {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

/// Piecewise quadratic profile, see [`Profile::Compatible`].
#[derive(Debug, Clone, PartialEq)]
pub struct CompatibleProfile<T> {
    stations: Vec<T>,
    slope: Vec<T>,
    value: Vec<T>,
}

impl<T: Real> Profile<T> {
    /// C1 profile whose slope interpolates the slope of the cubic linearly between the given stations.
    ///
    /// # Errors
    /// [`crate::Error::InvalidParameter`] unless the stations rise from 0 to 1 with at least one in between.
    pub fn mediator_compatible(stations: &[T]) -> Result<Self> {
        let n = stations.len();
        // Stations are computed positions of nodes: they miss 0 and 1 by round-off.
        let tolerance = T::epsilon().sqrt();
        let rising = stations.windows(2).all(|w| w[1] - w[0] > tolerance);
        let spans = n >= 3 && stations[0].abs() < tolerance && (stations[n - 1] - T::one()).abs() < tolerance;
        if !rising || !spans {
            return Err(invalid(
                "stations of the mediator-compatible weight",
                format_args!("{n} values"),
                "must rise from 0 to 1 with at least one in between; use two or more mediator layers across the overlap",
            ));
        }
        // Slope of the cubic up to a factor, which the division by `total` supplies.
        let mut slope: Vec<T> = stations.iter().map(|&s| s * (T::one() - s)).collect();
        // Exactly zero at the ends, also where the stations there miss 0 or 1 by round-off.
        slope[0] = T::zero();
        slope[n - 1] = T::zero();
        let mut value = vec![T::zero(); n];
        // The slope is linear between stations, so the trapezium rule integrates it exactly.
        for k in 1..n {
            value[k] =
                value[k - 1] + (slope[k] + slope[k - 1]) * (stations[k] - stations[k - 1]) * T::of(0.5);
        }
        let total = value[n - 1];
        // Makes the profile end at exactly one.
        slope.iter_mut().chain(&mut value).for_each(|v| *v /= total);
        Ok(Self::Compatible(CompatibleProfile {
            stations: stations.to_vec(),
            slope,
            value,
        }))
    }

    /// A user-defined profile: a function that rises from `p(0) = 0` to `p(1) = 1` and never falls. Means
    /// over cells are exact if it is a polynomial of at most degree five on every eighth of the overlap, and
    /// nearly exact if it is smooth.
    ///
    /// ```
    /// use arlequin_core::Profile;
    /// let sine = Profile::custom(|s: f64| 0.5 - 0.5 * (std::f64::consts::PI * s).cos())?;
    /// assert!((sine.value(0.25) - 0.146_446_609).abs() < 1e-9);
    /// assert!(Profile::custom(|s: f64| 1.0 - s).is_err());
    /// # Ok::<(), arlequin_core::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`crate::Error::InvalidParameter`] for end values other than 0 and 1, and for a function that falls or
    /// is not finite at one of 1025 places.
    pub fn custom(p: impl Fn(T) -> T + Send + Sync + 'static) -> Result<Self> {
        let refuse = |s: T, p: T, rule: &str| {
            let value = format_args!("{p} at s = {s}");
            Err(invalid("custom weight profile", value, rule))
        };
        // Ends may miss 0 and 1 by round-off, and a plateau may fall by it.
        let tolerance = T::epsilon() * T::of(64.0);
        for (s, end) in [(T::zero(), p(T::zero())), (T::one(), p(T::one()))] {
            if !end.is_finite() || (end - s).abs() > tolerance {
                return refuse(
                    s,
                    end,
                    "must be 0 at the fine border (s = 0) and 1 at the coarse one (s = 1)",
                );
            }
        }
        let mut before = p(T::zero());
        for k in 1..=1024 {
            let s = T::of(f64::from(k) / 1024.0);
            let now = p(s);
            if !now.is_finite() || now < before - tolerance {
                return refuse(s, now, "must be finite and never fall from s = 0 to s = 1");
            }
            before = now;
        }
        Ok(Self::Custom(CustomProfile(Arc::new(p))))
    }

    /// `p(s)` for `s` in `[0, 1]`.
    pub fn value(&self, s: T) -> T {
        let k = T::of;
        match self {
            Self::Constant(c) => *c,
            Self::Linear => s,
            Self::Cubic => s * s * (k(3.0) - k(2.0) * s),
            Self::Quintic => s * s * s * (k(10.0) + s * (k(6.0) * s - k(15.0))),
            Self::Custom(c) => (c.0)(s),
            Self::Compatible(c) => {
                // At the right end `s` equals the last station and stays in the last interval.
                let j = c
                    .stations
                    .partition_point(|&x| x <= s)
                    .clamp(1, c.stations.len() - 1)
                    - 1;
                let (h, t) = (c.stations[j + 1] - c.stations[j], s - c.stations[j]);
                // Integral of the linear slope from station `j` on.
                c.value[j] + t * (c.slope[j] + (c.slope[j + 1] - c.slope[j]) * t / (h + h))
            }
        }
    }

    /// Values of `s` between which the profile is one polynomial, or smooth if user-defined.
    pub(crate) fn breaks(&self) -> Vec<T> {
        match self {
            Self::Compatible(c) => c.stations.clone(),
            // A function of the user's own may bend anywhere: means are taken over eighths of the overlap.
            Self::Custom(_) => (0..=8).map(|k| T::of(f64::from(k) / 8.0)).collect(),
            _ => vec![T::zero(), T::one()],
        }
    }
}

/// Profiles that have a name in scenes and reports.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum ProfileKind {
    /// [`Profile::Constant`].
    Constant,
    /// [`Profile::Linear`].
    Linear,
    /// [`Profile::Cubic`]: reflects least for its width, hence the default.
    #[default]
    Cubic,
    /// [`Profile::Quintic`].
    Quintic,
    /// [`Profile::Compatible`].
    MediatorCompatible,
}

impl ProfileKind {
    /// Creates the profile of this kind. A constant profile takes `value` (default one half); the
    /// mediator-compatible profile takes the positions of the mediator nodes as `stations`.
    ///
    /// # Errors
    /// Errors of [`Profile::mediator_compatible`].
    pub fn profile<T: Real>(self, value: Option<T>, stations: &[T]) -> Result<Profile<T>> {
        Ok(match self {
            Self::Constant => Profile::Constant(value.unwrap_or_else(|| T::of(0.5))),
            Self::Linear => Profile::Linear,
            Self::Cubic => Profile::Cubic,
            Self::Quintic => Profile::Quintic,
            Self::MediatorCompatible => Profile::mediator_compatible(stations)?,
        })
    }
}

named!(ProfileKind, "weight profile":
    Constant = "constant",
    Linear = "linear",
    Cubic = "cubic",
    Quintic = "quintic",
    MediatorCompatible = "mediator-compatible",
);

#[cfg(test)]
mod tests {
    use super::{Profile, ProfileKind};
    use crate::geometry::Cell;
    use crate::overlap::Slab;
    use crate::weight::{Ramp, Weight};
    use nalgebra::Point3;
    use std::sync::Arc;

    #[test]
    fn a_custom_profile_must_rise_from_zero_to_one() {
        for (p, said) in [
            (
                Box::new(|s: f64| s + 0.1) as Box<dyn Fn(f64) -> f64 + Send + Sync>,
                "1 at the coarse one",
            ),
            (Box::new(|s| 0.9 * s), "1 at the coarse one"),
            (
                Box::new(|s| s + 0.3 * (9.0 * std::f64::consts::PI * s).sin() * (1.0 - s)),
                "never fall",
            ),
            (
                Box::new(|s| if s > 0.4 && s < 0.6 { f64::NAN } else { s }),
                "never fall",
            ),
        ] {
            let error = Profile::custom(p).unwrap_err().to_string();
            assert!(error.contains(said), "{error}");
        }
    }

    #[test]
    fn a_custom_profile_weighs_as_the_one_of_the_same_formula() {
        let at = |x: f64| Point3::new(x, 0.0, 0.0);
        let weight =
            |profile| Ramp::new(Arc::new(Slab::between(at(0.0), at(1.0)).unwrap()), profile, 0.05).unwrap();
        let own = weight(Profile::custom(|s: f64| s * s * (3.0 - 2.0 * s)).unwrap());
        let cubic = weight(Profile::Cubic);
        for ends in [[-0.3, 0.2], [0.1, 0.9], [0.7, 1.8], [-1.0, 2.0]] {
            let cell = Cell::Segment {
                ends: ends.map(at),
                section: 1.0,
            };
            assert!((own.mean(&cell) - cubic.mean(&cell)).abs() < 1e-14, "{ends:?}");
        }
    }

    #[test]
    fn names_of_profiles_are_read_as_they_are_written() {
        for &kind in ProfileKind::ALL {
            assert_eq!(kind.to_string().parse::<ProfileKind>().unwrap(), kind);
        }
        let error = "kubic".parse::<ProfileKind>().unwrap_err().to_string();
        assert!(error.contains("'kubic'") && error.contains("quintic"), "{error}");
    }
}
