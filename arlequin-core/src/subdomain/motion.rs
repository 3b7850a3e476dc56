//! Prescribed motion of unknowns: supports.

use crate::Real;
use crate::time::TimeFunction;

/// Prescribed motion of some unknowns: `q = amplitude · f(t)`.
#[derive(Debug, Clone)]
pub struct PrescribedMotion<T> {
    /// Unknowns.
    pub dofs: Vec<usize>,
    /// Amplitude \[m, rad\]; zero fixes them.
    pub amplitude: T,
    /// Time function.
    pub time: TimeFunction<T>,
}

impl<T: Real> PrescribedMotion<T> {
    /// Fixed unknowns.
    pub fn fixed(dofs: Vec<usize>) -> Self {
        Self {
            dofs,
            amplitude: T::zero(),
            time: TimeFunction::Step,
        }
    }

    /// Position at time `t` \[s\].
    pub(crate) fn position(&self, t: T) -> T {
        if self.amplitude == T::zero() {
            T::zero()
        } else {
            self.amplitude * self.time.value(t)
        }
    }

    /// Returns position \[m\], velocity \[m/s\] and acceleration \[m/s²\] at time `t` \[s\]. The latter two
    /// are central differences over `dt` \[s\], so that velocity Verlet follows the motion exactly. With `dt`
    /// zero time stands still, and they are zero.
    pub fn kinematics(&self, t: T, dt: T) -> (T, T, T) {
        // Always in double precision: the differences are many digits below the values.
        let amplitude = self.amplitude.as_f64();
        if amplitude == 0.0 {
            return (T::zero(), T::zero(), T::zero());
        }
        let (t, dt) = (t.as_f64(), dt.as_f64());
        if dt <= 0.0 {
            return (self.position(T::of(t)), T::zero(), T::zero());
        }
        let position = |t: f64| amplitude * self.time.at_wide(t);
        let (before, now, after) = (position(t - dt), position(t), position(t + dt));
        (
            T::of(now),
            T::of((after - before) / (dt + dt)),
            T::of((after - now - now + before) / (dt * dt)),
        )
    }
}
