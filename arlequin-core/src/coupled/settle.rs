//! Statics as a run: a sequence of equilibria, one for each instant.
//!
//! Linear models under forces that depend on time alone are solved directly ([`Coupled::equilibrium`]), and
//! so are models that change themselves (bonds that break) until their first change. All others (contact,
//! large rotations) are relaxed by a damped motion while time stands still (`relax`). From one instant to
//! the next, supports and loads change over [`Relaxation::ramp`] steps.

use super::statics::Equilibrium;
use super::{Coupled, portions};
use crate::error::invalid;
use crate::subdomain::Subdomain;
use crate::{Error, Real, Result};

/// Parameters of a relaxation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Relaxation<T> {
    /// Residual that counts as equilibrium: the largest unbalanced force on a free displacement, relative to
    /// the largest internal force since the instant before, or a tenth of the sum of these forces in a
    /// model, relative to its external forces and reactions, if that is larger.
    pub tolerance: T,
    /// Largest number of steps.
    pub most: usize,
    /// Steps over which supports and loads change.
    pub ramp: usize,
}

impl<T: Real> Default for Relaxation<T> {
    /// Tolerance 1e-6, at most 200 000 steps, 500 of them for the change of loads.
    fn default() -> Self {
        Self {
            tolerance: T::of(1e-6),
            most: 200_000,
            ramp: 500,
        }
    }
}

/// An equilibrium that was reached.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settled<T> {
    /// Method that found the equilibrium: `direct` or `relaxed`.
    pub method: &'static str,
    /// Relative residual of the linear system, or the residual of [`Relaxation::tolerance`].
    pub residual: T,
    /// Steps of the relaxation; zero for a direct solution.
    pub iterations: usize,
    /// Weighted internal energy \[J\].
    pub energy: T,
}

/// Halvings of a load step in which a model changes itself: the relaxation begins within 1/64 of the load
/// step before the change.
const BISECTIONS: usize = 6;

impl<T: Real> Coupled<T> {
    /// Returns `Ok` if every equilibrium can be solved directly, otherwise the reason why not.
    pub fn solves_directly(&mut self) -> std::result::Result<(), String> {
        // A force between two models depends on their positions, which one linear system cannot know.
        if let Some(p) = self.pairs.first() {
            return Err(format!("'{}' acts between two models", p.line.effect.name()));
        }
        for s in &mut self.subdomains {
            if let Some(why) = s.not_direct() {
                return Err(format!("'{}': {why}", s.model().name()));
            }
        }
        Ok(())
    }

    /// Returns whether the run is solved directly until one of its models changes itself; none has yet.
    pub fn solves_until_change(&mut self) -> bool {
        let linear = |s: &mut Subdomain<T>| !s.has_changed() && s.not_linear().is_none();
        // A free rigid motion makes the system singular; relaxed runs resist it by inertia.
        self.pairs.is_empty()
            && !self.relaxes
            && self.subdomains.iter_mut().all(linear)
            && self.free_motions().is_empty()
    }

    /// Moves the run to the equilibrium under the loads and prescribed displacements of `time` \[s\]. The
    /// present state is that of the loads at `from` \[s\]. Velocities are zero afterwards, and the step
    /// counts as one. Works are not recorded.
    ///
    /// # Errors
    /// Errors of [`Coupled::equilibrium`]; [`Error::NotSettled`] if relaxation does not reach its tolerance;
    /// [`Error::Unsupported`] for an external solver and for a partitioned model.
    pub fn settle(&mut self, from: T, time: T, how: &Relaxation<T>) -> Result<Settled<T>> {
        if how.tolerance <= T::zero() || how.most == 0 {
            let settings = format_args!("tolerance {}, {} steps", how.tolerance, how.most);
            return Err(invalid(
                "relaxation",
                settings,
                "needs a positive tolerance and at least one step",
            ));
        }
        self.check_settling()?;
        let settled = match self.solves_directly() {
            // Not a fallback after a failure: models that cannot be solved directly are never tried.
            Ok(()) => {
                let equilibrium = self.equilibrium(time)?;
                self.rest_in(&equilibrium, time)?
            }
            Err(_) if self.solves_until_change() => self.settle_until_change(from, time, how)?,
            Err(_) => self.relax(from, time, how)?,
        };
        self.time = time;
        self.step += 1;
        Ok(settled)
    }

    /// Refuses a run that [`Self::settle`] cannot bring to rest, before its first load step.
    ///
    /// # Errors
    /// [`Error::Unsupported`] for an external solver and for a partitioned model; [`Error::SingularSystem`]
    /// if models that are solved directly have a free rigid motion.
    pub fn check_rest(&mut self) -> Result<()> {
        self.check_settling()?;
        if self.solves_directly().is_err() {
            return Ok(());
        }
        let free = self.free_motions();
        // A free rigid motion makes the system singular; relaxed runs resist it by inertia.
        if free.is_empty() {
            return Ok(());
        }
        Err(Error::SingularSystem {
            size: self.subdomains.iter().map(|s| s.model().layout().dofs()).sum(),
            residual: f64::NAN,
            free: format!(": {free}"),
        })
    }

    fn check_settling(&self) -> Result<()> {
        portions::require_whole(&self.subdomains, "be brought to rest")?;
        match self.subdomains.iter().find(|s| s.is_external()) {
            None => Ok(()),
            Some(s) => Err(Error::Unsupported {
                model: s.model().name().to_owned(),
                what: "be brought to rest: it is a solver of its own".into(),
            }),
        }
    }

    /// Solves directly if the models stay as they are; otherwise relaxes from shortly before their change.
    fn settle_until_change(&mut self, from: T, time: T, how: &Relaxation<T>) -> Result<Settled<T>> {
        match self.equilibrium(time) {
            Ok(equilibrium) if self.stays_in(&equilibrium) => self.rest_in(&equilibrium, time),
            Ok(_) => {
                let start = self.approach_change(from, time)?;
                self.relax(start, time, how)
            }
            // Parts of a model that nothing holds, such as loose grains, are known by the factor alone.
            Err(Error::SingularSystem { .. }) => {
                self.relaxes = true;
                self.relax(from, time, how)
            }
            Err(e) => Err(e),
        }
    }

    /// Moves the run to an equilibrium shortly before a model changes itself on the way from one instant to
    /// another, by bisection; returns its time.
    fn approach_change(&mut self, from: T, time: T) -> Result<T> {
        let [mut low, mut high] = [from, time];
        let mut last = None;
        for _ in 0..BISECTIONS {
            let middle = (low + high) * T::of(0.5);
            let equilibrium = self.equilibrium(middle)?;
            if self.stays_in(&equilibrium) {
                (low, last) = (middle, Some(equilibrium));
            } else {
                high = middle;
            }
        }
        if let Some(equilibrium) = last {
            self.rest_in(&equilibrium, low)?;
        }
        Ok(low)
    }

    /// Returns whether all models stay as they are in an equilibrium.
    fn stays_in(&mut self, equilibrium: &Equilibrium<T>) -> bool {
        let mut states = self.subdomains.iter_mut().zip(&equilibrium.displacements);
        states.all(|(s, q)| s.stays(q))
    }

    /// Sets the run at rest in an equilibrium of the loads at `time` \[s\].
    fn rest_in(&mut self, equilibrium: &Equilibrium<T>, time: T) -> Result<Settled<T>> {
        for (s, q) in self.subdomains.iter_mut().zip(&equilibrium.displacements) {
            s.set_at_rest(q, time)?;
        }
        for (i, lambda) in self.interfaces.iter_mut().zip(&equilibrium.multipliers) {
            i.hold(lambda);
        }
        for j in &mut self.joints {
            j.restore(&self.interfaces);
        }
        Ok(Settled {
            // Partial pivoting takes several times as long, after a factor without it was given up.
            method: if equilibrium.pivoted {
                "direct, with pivoting"
            } else {
                "direct"
            },
            residual: equilibrium.residual,
            iterations: 0,
            energy: equilibrium.energy,
        })
    }
}
