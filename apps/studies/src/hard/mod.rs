//! Hard cases: each tells its difficulty, measures the results of naive code, and checks our promise.
//!
//! The promise is the same everywhere: a bounded invariant or a named error before the first step, never a
//! number that is not finite, and never silence. Fast cases run in the tests, all cases in `arlequin verify
//! --hard`.

mod breakage;
mod line;
mod material;
pub mod naive;
mod natural;
mod particles;
mod place;
mod resume;
mod strike;
mod time;
mod turning;
mod weights;
mod zones;

use crate::checks::{Accept, Check};
use arlequin::core::{Coupled, Error, Real, Result};
use std::ops::RangeInclusive;

/// Measured numbers of a case.
#[derive(Debug, Clone, Default)]
pub struct Outcome {
    /// Numbers of the naive variants, with the range in which they were when the case was written.
    pub naive: Vec<Check>,
    /// Numbers of the library, with the promised range.
    pub ours: Vec<Check>,
}

impl Outcome {
    /// Returns true if every number of the naive variants and of the library lies in its range, and there are
    /// numbers of both.
    #[must_use]
    pub fn pass(&self) -> bool {
        // Without entries, nothing has been measured.
        let all_pass = |f: &[Check]| !f.is_empty() && f.iter().all(|c| c.pass);
        all_pass(&self.naive) && all_pass(&self.ours)
    }

    fn add_naive(&mut self, what: impl Into<String>, value: f64, range: RangeInclusive<f64>) {
        self.naive.push(within(what, value, &range));
    }

    fn add(&mut self, what: impl Into<String>, value: f64, range: RangeInclusive<f64>) {
        self.ours.push(within(what, value, &range));
    }

    /// Adds a promised refusal: 1 if the set-up failed with the expected error, otherwise 0.
    fn add_refusal<T: Real>(&mut self, what: &str, result: Result<Coupled<T>>, expected: fn(&Error) -> bool) {
        let (text, value) = match result {
            Ok(_) => ("was accepted".to_owned(), 0.0),
            Err(e) => (e.to_string(), f64::from(u8::from(expected(&e)))),
        };
        self.ours
            .push(within(format!("{what} is refused: {text}"), value, &(1.0..=1.0)));
    }
}

fn within(what: impl Into<String>, value: f64, range: &RangeInclusive<f64>) -> Check {
    Check::new(what, value, Accept::Between(*range.start(), *range.end()))
}

/// One hard case.
#[derive(Debug, Clone, Copy)]
pub struct HardCase {
    /// Short name.
    pub name: &'static str,
    /// Difficulty of the case.
    pub why: &'static str,
    /// Behaviour of naive code.
    pub naive: &'static str,
    /// Our promise.
    pub promise: &'static str,
    /// True if the case takes at most a few seconds.
    pub fast: bool,
    /// Measures the case.
    pub run: fn() -> Result<Outcome>,
}

/// Returns all hard cases, in the order of `docs/hard-cases.md`.
#[must_use]
pub fn cases() -> Vec<HardCase> {
    [
        weights::CASES,
        line::CASES,
        place::CASES,
        material::CASES,
        natural::CASES,
        particles::CASES,
        time::CASES,
        resume::CASES,
        breakage::CASES,
        strike::CASES,
        turning::CASES,
        zones::CASES,
    ]
    .concat()
}

/// Returns the step at which the guard ends an unstable run; infinite if the run survives `steps`.
fn step_of_blow_up(run: &mut Coupled<f64>, steps: usize) -> Result<f64> {
    match run.run(steps, &mut arlequin::core::Silent) {
        Ok(_) => Ok(f64::INFINITY),
        Err(
            Error::EnergyGrowth { step, .. } | Error::EnergyLoss { step, .. } | Error::Diverged { step, .. },
        ) => Ok(step as f64),
        Err(e) => Err(e),
    }
}

/// Returns the smallest critical step of a run \[s\].
fn critical<T: Real>(run: &Coupled<T>) -> f64 {
    run.critical_steps()
        .iter()
        .fold(f64::INFINITY, |a, b| a.min(b.as_f64()))
}

/// Gives every model random velocities.
fn shaken<T: Real>(
    subdomains: impl IntoIterator<Item = arlequin::core::Subdomain<T>>,
    seed: u64,
) -> Result<Vec<arlequin::core::Subdomain<T>>> {
    let mut next = crate::noise(seed);
    let shake = |s: arlequin::core::Subdomain<T>| {
        let n = s.model().layout().dofs();
        let v = (0..n).map(|_| T::of(next())).collect();
        s.with_initial(vec![T::zero(); n], v)
    };
    subdomains.into_iter().map(shake).collect()
}
