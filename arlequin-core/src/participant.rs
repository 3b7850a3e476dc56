//! External solvers as participants: what a solver with its own time stepping must offer.

use crate::model::{DofLayout, Model};
use crate::record::Record;
use crate::weight::{Weight, Weights};
use crate::{Error, Real, Result};
use nalgebra::Point3;

/// An external solver with its own time stepping: it advances, reports velocities, accepts impulses and has a
/// lumped mass.
///
/// A solver that only computes forces implements [`crate::Model`] instead and leaves the stepping to the
/// core. Between two reflections the run calls [`Self::advance`] only. At a reflection the solver receives
/// the whole impulse `2 Bᵀμ` at once; velocities *at* the instant of the reflection contain half of it.
/// [`crate::conformance::participant`] checks an implementation.
pub trait Participant<T: Real>: Send {
    /// Name for messages and reports.
    fn name(&self) -> &str;

    /// Kind of the solver, for reports.
    fn kind(&self) -> &str {
        "participant"
    }

    /// Arrangement of the unknowns.
    fn layout(&self) -> DofLayout;

    /// Reference positions of the nodes \[m\].
    fn nodes(&self) -> &[Point3<T>];

    /// Takes the weights and writes the lumped inertia of every unknown under them \[kg, kg m²\]. The run
    /// calls it before any step, first with weights of one and then with the final ones. A solver that cannot
    /// weight itself accepts weights of nearly one only (`1 − 1e-6` in the overlap, the rest for the other
    /// model) and writes the inertia it has.
    ///
    /// # Errors
    /// Weights that the solver does not support.
    fn weigh(&mut self, weights: &Weights<T>, inertia: &mut [T]) -> Result<()>;

    /// Advances from time `from` \[s\] by `step` \[s\], in any number of own steps.
    ///
    /// # Errors
    /// Any error of the solver.
    fn advance(&mut self, from: T, step: T) -> Result<()>;

    /// Writes the current velocities of all unknowns \[m/s, rad/s\].
    fn velocities(&self, out: &mut [T]);

    /// Writes the current displacements of all unknowns \[m, rad\]: for probes, pictures and the displacement
    /// jump.
    fn displacements(&self, out: &mut [T]);

    /// Adds an impulse to every unknown \[kg m/s\]: its velocity changes by impulse over inertia.
    ///
    /// # Errors
    /// Any error of the solver.
    fn kick(&mut self, impulse: &[T]) -> Result<()>;

    /// Writes the current accelerations of all unknowns \[m/s²\] and returns `true`, if the solver has them.
    /// The first reflection is then as smooth as all others.
    fn accelerations(&self, out: &mut [T]) -> bool {
        let _ = out;
        false
    }

    /// Largest stable step \[s\] of [`Self::advance`]; `None` if every step is stable.
    fn critical_step(&self) -> Option<T> {
        None
    }

    /// Energy \[J\] that the stepping conserves between impulses, minus the work of the solver's own loads. A
    /// linear law must conserve it exactly, others to second order in the step. `None` if the solver knows no
    /// energy: the ledger then takes the work of the impulses, the run warns that the energy is not known
    /// ([`crate::Warning::EnergyUnknown`]), and velocities are checked against the impulses.
    fn invariant(&self) -> Option<T> {
        None
    }

    /// Returns what the solver must remember to resume with the same bits.
    ///
    /// # Errors
    /// [`Error::Unsupported`] for a solver that cannot be saved, which is the default.
    fn save(&self) -> Result<Record<T>> {
        Err(Error::Unsupported {
            model: self.name().to_owned(),
            what: "be saved: its solver implements no Participant::save; run without checkpoints".into(),
        })
    }

    /// Restores the state that [`Self::save`] returned. The run then compares inertia, centre of mass,
    /// displacements and velocities with those at the time of saving ([`Error::NotRestored`]).
    ///
    /// # Errors
    /// A record of another solver; [`Error::Unsupported`] for a solver that cannot be restored.
    fn restore(&mut self, from: &Record<T>) -> Result<()> {
        let _ = from;
        Err(Error::Unsupported {
            model: self.name().to_owned(),
            what: "be restored: its solver implements no Participant::restore; start the run anew".into(),
        })
    }
}

/// Data of an external solver apart from its motion, in the form of a model without internal forces.
#[derive(Debug, Clone)]
pub struct Outline<T: Real> {
    name: String,
    kind: String,
    layout: DofLayout,
    nodes: Vec<Point3<T>>,
    /// Unweighted inertia.
    inertia: Vec<T>,
    critical: Option<T>,
}

impl<T: Real> Outline<T> {
    /// Outline of `solver`; `inertia` is its lumped inertia without weights \[kg, kg m²\].
    pub fn new(solver: &dyn Participant<T>, inertia: Vec<T>) -> Self {
        Self {
            name: solver.name().to_owned(),
            kind: solver.kind().to_owned(),
            layout: solver.layout(),
            nodes: solver.nodes().to_vec(),
            inertia,
            critical: solver.critical_step(),
        }
    }
}

impl<T: Real> Model<T> for Outline<T> {
    fn name(&self) -> &str {
        &self.name
    }
    fn kind(&self) -> &str {
        &self.kind
    }
    fn layout(&self) -> DofLayout {
        self.layout
    }
    fn nodes(&self) -> &[Point3<T>] {
        &self.nodes
    }
    fn lumped_inertia(&self, _: &dyn Weight<T>, out: &mut [T]) -> Result<()> {
        out.copy_from_slice(&self.inertia);
        Ok(())
    }
    fn set_internal_weight(&mut self, _: &dyn Weight<T>) -> Result<()> {
        Ok(())
    }
    fn add_internal_forces(&mut self, _: &[T], _: &mut [T]) -> Result<()> {
        Ok(())
    }
    fn internal_energy(&self, _: &[T]) -> T {
        T::zero()
    }
    fn critical_step(&mut self, _: &[T]) -> Result<T> {
        // A solver that is stable at every step sets no limit.
        Ok(self.critical.unwrap_or_else(|| T::of(f64::INFINITY)))
    }
}
