//! Choice of the solver for the multipliers.

use crate::{Real, Result};

/// Default limit of the iterations.
const MOST_ITERATIONS: usize = 1000;

/// Solver for the multipliers.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Solver<T> {
    /// Cholesky factor, or conjugate gradients if they are expected to take less time or if the factor takes
    /// too much memory.
    #[default]
    Auto,
    /// Cholesky factor, exact. If multipliers are dependent: eigenvectors of the non-zero modes or, beyond
    /// 400 multipliers per component, a factor of independent ones, the others being zero.
    Factor,
    /// Conjugate gradients from zero. The result costs no energy at any number of iterations; the velocity
    /// jump is only as small as the tolerance.
    ConjugateGradients {
        /// Residual at which the iteration ends, relative to the initial jump, in the norm of the inverse
        /// diagonal of `S`.
        tolerance: T,
        /// Largest number of iterations.
        max_iterations: usize,
    },
}

impl<T: Real> Solver<T> {
    /// Returns conjugate gradients to 1e-12 (single precision: 32 ε) in at most 1000 iterations.
    pub fn conjugate_gradients() -> Self {
        Self::ConjugateGradients {
            tolerance: default_tolerance(),
            max_iterations: MOST_ITERATIONS,
        }
    }

    /// Returns the tolerance and the largest number of iterations.
    pub(super) fn limits(self) -> (T, usize) {
        match self {
            Self::ConjugateGradients {
                tolerance,
                max_iterations,
            } => (tolerance, max_iterations),
            Self::Auto | Self::Factor => Self::conjugate_gradients().limits(),
        }
    }

    /// Returns whether the user chose an iterative solver.
    pub(super) fn iterates(self) -> bool {
        matches!(self, Self::ConjugateGradients { .. })
    }

    /// Returns whether this is an iteration with other than the default limits.
    pub(super) fn is_cut_short(self) -> bool {
        self.iterates() && self != Self::conjugate_gradients()
    }

    /// Returns the solver that serves both interfaces: iterations if either asks for them, to the tighter
    /// tolerance.
    pub(super) fn with(self, other: Self) -> Self {
        let (tolerance, max_iterations) = match (self.iterates(), other.iterates()) {
            (true, true) => {
                // The tighter tolerance and the larger limit: neither interface gets less than it asked for.
                let ((a, m), (b, n)) = (self.limits(), other.limits());
                (a.min(b), m.max(n))
            }
            (true, false) => self.limits(),
            (false, true) => other.limits(),
            (false, false) if self == other => return self,
            // `Auto` and `Factor`: a factor serves both.
            (false, false) => return Self::Factor,
        };
        Self::ConjugateGradients {
            tolerance,
            max_iterations,
        }
    }

    /// Refuses limits that make no sense.
    pub(super) fn check(self, interface: &str) -> Result<()> {
        let (tolerance, most) = self.limits();
        let invalid = |value: &str, rule| Err(crate::error::invalid_option(interface, "solver", value, rule));
        // Not `tolerance < 0`: a NaN must be refused, too.
        if !(tolerance >= T::zero() && tolerance < T::one()) {
            let value = format!("tolerance {tolerance}");
            return invalid(&value, "must be at least 0 and below 1, such as 1e-12");
        }
        if most == 0 {
            return invalid(
                "max_iterations 0",
                "must be at least 1: without any the models are not coupled",
            );
        }
        Ok(())
    }
}

// In single precision 1e-12 would never be reached.
fn default_tolerance<T: Real>() -> T {
    T::of(1e-12).max(T::epsilon() * T::of(32.0))
}

#[cfg(test)]
mod tests {
    use super::Solver::{self, Auto, ConjugateGradients, Factor};

    #[test]
    fn interfaces_that_are_solved_for_together_get_the_tighter_of_their_iterations() {
        let gradients = |tolerance, max_iterations| ConjugateGradients {
            tolerance,
            max_iterations,
        };
        let cases: [(Solver<f64>, Solver<f64>, Solver<f64>); 4] = [
            (Auto, Auto, Auto),
            (Auto, Factor, Factor),
            (Factor, gradients(1e-3, 5), gradients(1e-3, 5)),
            (gradients(1e-3, 5), gradients(1e-6, 4), gradients(1e-6, 5)),
        ];
        for (a, b, joint) in cases {
            assert_eq!((a.with(b), b.with(a)), (joint, joint));
        }
    }

    #[test]
    fn limits_that_make_no_sense_are_refused() {
        for (tolerance, max_iterations, said) in [
            (1.0, 5, "tolerance 1"),
            (-1e-3, 5, "tolerance -0.001"),
            (f64::NAN, 5, "tolerance NaN"),
            (1e-3, 0, "max_iterations 0"),
        ] {
            let solver = ConjugateGradients {
                tolerance,
                max_iterations,
            };
            let e = solver.check("tie").map_err(|e| e.to_string());
            assert!(
                e.as_ref().is_err_and(|e| e.contains(said) && e.contains("tie")),
                "{e:?}"
            );
        }
        assert!(Solver::<f64>::conjugate_gradients().check("tie").is_ok());
    }
}
