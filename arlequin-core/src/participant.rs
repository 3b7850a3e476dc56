//! Whole solvers as participants: what one needs that brings its own stepping.

use crate::model::{DofLayout, Model};
use crate::record::Record;
use crate::weight::{Weight, Weights};
use crate::{Error, Real, Result};
use nalgebra::Point3;

/// A solver with a stepping of its own, as the coupling sees it: it advances, tells its velocities, accepts
/// an impulse and has a lumped mass.
///
/// Who only has forces implements [`crate::Model`] instead and leaves the stepping to the core. Between two
/// reflections nothing is asked of a participant but [`Self::advance`]; at a reflection it gets the whole
/// impulse `2 Bᵀμ` at once, of which velocities *at* the instant have half.
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

    /// Takes its weights and writes the lumped inertia of every unknown under them \[kg, kg m²\]: called
    /// before any step, first with weights of one and then with those it is to have. A solver that cannot
    /// weight itself takes weights of nearly one (`1 − 1e-6` in the overlap, the other model the rest) and
    /// writes what it has.
    ///
    /// # Errors
    /// Weights that the solver cannot have.
    fn weigh(&mut self, weights: &Weights<T>, inertia: &mut [T]) -> Result<()>;

    /// Goes on from time `from` \[s\] by `step` \[s\], in whatever steps of its own.
    ///
    /// # Errors
    /// Whatever keeps the solver from doing so.
    fn advance(&mut self, from: T, step: T) -> Result<()>;

    /// Writes the velocities of all unknowns now \[m/s, rad/s\].
    fn velocities(&self, out: &mut [T]);

    /// Writes the displacements of all unknowns now \[m, rad\]: for probes, pictures and the displacement
    /// jump.
    fn displacements(&self, out: &mut [T]);

    /// Changes the momentum of every unknown \[kg m/s\]: its velocity by impulse over inertia.
    ///
    /// # Errors
    /// Whatever keeps the solver from doing so.
    fn kick(&mut self, impulse: &[T]) -> Result<()>;

    /// Writes the accelerations of all unknowns now \[m/s²\], if the solver has them: with these the first
    /// reflection is as smooth as all others.
    fn accelerations(&self, out: &mut [T]) -> bool {
        let _ = out;
        false
    }

    /// Largest stable step \[s\] of [`Self::advance`]; `None` if it takes any.
    fn critical_step(&self) -> Option<T> {
        None
    }

    /// Energy \[J\] that its stepping keeps but for impulses, and less what loads of its own did: exactly
    /// for a linear law, to second order in the step for others. `None` if it knows none: the ledger then
    /// takes what impulses brought, the run warns that the energy is not known
    /// ([`crate::Warning::EnergyUnknown`]), and velocities are held against the impulses.
    fn invariant(&self) -> Option<T> {
        None
    }

    /// What it must remember to go on with the same bits.
    ///
    /// # Errors
    /// [`Error::Unsupported`] unless it can.
    fn save(&self) -> Result<Record<T>> {
        Err(Error::Unsupported {
            model: self.name().to_owned(),
            what: "be saved: its solver implements no Participant::save; run without checkpoints".into(),
        })
    }

    /// Goes back to what [`Self::save`] returned. What it tells afterwards is held against what it told
    /// then: inertia, centre of mass, displacements, velocities ([`Error::NotRestored`]).
    ///
    /// # Errors
    /// A record of another solver; [`Error::Unsupported`] unless it can.
    fn restore(&mut self, from: &Record<T>) -> Result<()> {
        let _ = from;
        Err(Error::Unsupported {
            model: self.name().to_owned(),
            what: "be restored: its solver implements no Participant::restore; start the run anew".into(),
        })
    }
}

/// What is known of a participant beside its motion: a body without forces of the core's.
#[derive(Debug, Clone)]
pub struct Outline<T: Real> {
    name: String,
    kind: String,
    layout: DofLayout,
    nodes: Vec<Point3<T>>,
    /// Unweighted.
    inertia: Vec<T>,
    critical: Option<T>,
}

impl<T: Real> Outline<T> {
    /// That of a participant with a lumped inertia without weights \[kg, kg m²\].
    pub fn of(solver: &dyn Participant<T>, inertia: Vec<T>) -> Self {
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
        Ok(self.critical.unwrap_or_else(|| T::of(f64::INFINITY)))
    }
}
