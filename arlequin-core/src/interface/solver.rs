//! How the multipliers are solved for: what a user chooses.

use crate::{Real, Result};

/// Iterations after which conjugate gradients and the Chebyshev iteration end where nobody has chosen.
const MOST_ITERATIONS: [usize; 2] = [1000, 2000];

/// How the multipliers are solved for.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Solver<T> {
    /// By a factor, unless conjugate gradients are expected to take less time or the factor takes too much
    /// memory.
    #[default]
    Auto,
    /// By a Cholesky factor, exactly; where multipliers are dependent by the eigenvectors that act on
    /// something, and beyond 2 000 of them per component by conjugate gradients.
    Factor,
    /// By conjugate gradients from zero, whose result costs no energy wherever they end; the velocity jump
    /// is then only as small as the tolerance.
    ConjugateGradients {
        /// Residual, relative to the jump before, in the norm of the inverse diagonal of `S`.
        tolerance: T,
        /// Iterations at which they end anyway.
        max_iterations: usize,
    },
    /// By a Chebyshev iteration from zero, whose number of iterations follows from bounds of the
    /// eigenvalues that the set-up finds. Its result is scaled so that it costs no energy. It takes more
    /// iterations than conjugate gradients, but no sum over all multipliers within them: on many ranks,
    /// only messages between neighbours.
    Chebyshev {
        /// As that of conjugate gradients.
        tolerance: T,
        /// Iterations at which it ends anyway: with fewer than the tolerance asks for, the modes of the
        /// smallest eigenvalues are left behind first. With a tolerance of zero as many are made.
        max_iterations: usize,
    },
}

impl<T: Real> Solver<T> {
    /// Conjugate gradients to 1e-12 (single precision: 32 of its last digits), in 1000 iterations at most.
    pub fn conjugate_gradients() -> Self {
        Self::ConjugateGradients {
            tolerance: default_tolerance(),
            max_iterations: MOST_ITERATIONS[0],
        }
    }

    /// A Chebyshev iteration to 1e-12 (single precision: 32 of its last digits), in 2000 iterations at most.
    pub fn chebyshev() -> Self {
        Self::Chebyshev {
            tolerance: default_tolerance(),
            max_iterations: MOST_ITERATIONS[1],
        }
    }

    /// Tolerance and number of iterations.
    pub(super) fn limits(self) -> (T, usize) {
        match self {
            Self::ConjugateGradients {
                tolerance,
                max_iterations,
            }
            | Self::Chebyshev {
                tolerance,
                max_iterations,
            } => (tolerance, max_iterations),
            Self::Auto | Self::Factor => Self::conjugate_gradients().limits(),
        }
    }

    /// Whether an iteration was asked for.
    pub(super) fn iterates(self) -> bool {
        matches!(self, Self::ConjugateGradients { .. } | Self::Chebyshev { .. })
    }

    /// Whether it is an iteration with other limits than the usual ones.
    pub(super) fn is_cut_short(self) -> bool {
        self.iterates() && self != Self::conjugate_gradients() && self != Self::chebyshev()
    }

    /// What does for both: iterations where either asks for them, to the tighter tolerance.
    pub(super) fn with(self, other: Self) -> Self {
        let (tolerance, max_iterations) = match (self.iterates(), other.iterates()) {
            (true, true) => {
                let ((a, m), (b, n)) = (self.limits(), other.limits());
                (a.min(b), m.max(n))
            }
            (true, false) => self.limits(),
            (false, true) => other.limits(),
            (false, false) if self == other => return self,
            (false, false) => return Self::Factor,
        };
        let chebyshev = [self, other].iter().any(|s| matches!(s, Self::Chebyshev { .. }));
        if chebyshev {
            Self::Chebyshev {
                tolerance,
                max_iterations,
            }
        } else {
            Self::ConjugateGradients {
                tolerance,
                max_iterations,
            }
        }
    }

    /// Refuses limits that make no sense, and iterations where the operator is lumped to its diagonal.
    pub(super) fn check(self, interface: &str, lumped: bool) -> Result<()> {
        let (tolerance, most) = self.limits();
        let invalid = |value: &str, rule| Err(crate::error::invalid_option(interface, "solver", value, rule));
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
        if lumped && matches!(self, Self::Chebyshev { .. }) {
            return invalid(
                "chebyshev",
                "has nothing to do where the operator is lumped, whose row sums are divided by; leave out one of the two",
            );
        }
        Ok(())
    }
}

fn default_tolerance<T: Real>() -> T {
    T::of(1e-12).max(T::epsilon() * T::of(32.0))
}

#[cfg(test)]
mod tests {
    use super::Solver::{self, Auto, Chebyshev, ConjugateGradients, Factor};

    #[test]
    fn interfaces_that_are_solved_for_together_get_the_tighter_of_their_iterations() {
        let gradients = |tolerance, max_iterations| ConjugateGradients {
            tolerance,
            max_iterations,
        };
        let chebyshev = |tolerance, max_iterations| Chebyshev {
            tolerance,
            max_iterations,
        };
        let cases: [(Solver<f64>, Solver<f64>, Solver<f64>); 7] = [
            (Auto, Auto, Auto),
            (Auto, Factor, Factor),
            (Factor, gradients(1e-3, 5), gradients(1e-3, 5)),
            (gradients(1e-3, 5), gradients(1e-6, 4), gradients(1e-6, 5)),
            (Auto, chebyshev(1e-3, 5), chebyshev(1e-3, 5)),
            (gradients(1e-6, 5), chebyshev(1e-3, 7), chebyshev(1e-6, 7)),
            (chebyshev(1e-3, 5), chebyshev(1e-2, 7), chebyshev(1e-3, 7)),
        ];
        for (a, b, both) in cases {
            assert_eq!((a.with(b), b.with(a)), (both, both));
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
            let of = Chebyshev {
                tolerance,
                max_iterations,
            };
            let e = of.check("tie", false).map_err(|e| e.to_string());
            assert!(
                e.as_ref().is_err_and(|e| e.contains(said) && e.contains("tie")),
                "{e:?}"
            );
        }
        assert!(Solver::<f64>::chebyshev().check("tie", true).is_err());
        assert!(Solver::<f64>::chebyshev().check("tie", false).is_ok());
    }
}
