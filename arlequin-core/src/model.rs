//! Traits of a mechanics model that can be coupled, and of the coarse and the fine role.

use crate::energy_release::Gradients;
use crate::error::invalid;
use crate::field::Interpolation;
use crate::geometry::Sample;
use crate::ranks::Communicator;
use crate::record::Record;
use crate::recovery::{Links, Recovery};
use crate::weight::{Changed, Weight};
use crate::{Error, Owned, Real, Result};
use nalgebra::Point3;
use sprs::CsMat;
use std::sync::Arc;

/// Arrangement of the unknowns: `components` displacements of every node (`x0 y0 z0 x1 …`), then `rotations`
/// of every node in the same order. The coupling never touches rotations.
///
/// The velocity of a rotation is the spin about fixed axes, its acceleration the torque divided by the
/// inertia. The unknown itself is the spin added up over time. It is the rotation vector while rotations are
/// small or about one axis; in general it is no orientation. Models keep orientations themselves, see
/// [`Model::advance`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DofLayout {
    /// Number of nodes (or particles).
    pub nodes: usize,
    /// Displacement components per node: 3 in space, 1 for bars and chains along x.
    pub components: usize,
    /// Rotations per node, stored behind all displacements: 3 for particles that turn (about x, y and z),
    /// otherwise 0.
    pub rotations: usize,
}

impl DofLayout {
    /// Number of displacement unknowns.
    pub fn translations(&self) -> usize {
        self.nodes * self.components
    }
    /// Number of all unknowns.
    pub fn dofs(&self) -> usize {
        self.nodes * (self.components + self.rotations)
    }
    /// Returns whether every node has three rotations.
    pub fn turns(&self) -> bool {
        self.rotations == 3
    }
    /// Node of an unknown.
    pub fn node_of(&self, dof: usize) -> usize {
        match dof.checked_sub(self.translations()) {
            None => dof / self.components,
            Some(behind) => behind / self.rotations.max(1),
        }
    }
    /// Returns an error unless there are 1 to 3 displacements and 0 or 3 rotations per node.
    pub(crate) fn check(&self, model: &str) -> Result<()> {
        if matches!(self.components, 1..=3) && matches!(self.rotations, 0 | 3) {
            return Ok(());
        }
        Err(invalid(
            &format!("layout of model '{model}'"),
            format_args!(
                "{} displacements and {} rotations per node",
                self.components, self.rotations
            ),
            "must be 1 to 3 displacements, and 3 rotations or none",
        ))
    }
}

/// Positions about which the total moment of a model's forces vanishes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arms {
    /// Reference positions: linear laws.
    Reference,
    /// Current positions: laws that turn with their body, contact.
    Current,
}

/// Displacements \[m\] (and rotations \[rad\]), velocities (and spins) and accelerations of one model.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct State<T> {
    /// Displacements \[m\], rotations \[rad\].
    pub q: Vec<T>,
    /// Velocities.
    pub v: Vec<T>,
    /// Accelerations.
    pub a: Vec<T>,
}

impl<T: Real> State<T> {
    /// State at rest in the reference configuration.
    pub fn zero(dofs: usize) -> Self {
        Self {
            q: vec![T::zero(); dofs],
            v: vec![T::zero(); dofs],
            a: vec![T::zero(); dofs],
        }
    }
}

/// A completed step, given to a model that may change itself ([`Evolving`]).
///
/// When a part of the model disappears (a bond breaks) that has the energy `e` and the forces `g = −de/dq`,
/// the discrete invariant loses
///
/// ```text
/// ½ (e(q_n) + e(q_{n+1})) + ¼ (q_{n+1} − q_n)·(g(q_{n+1}) − g(q_n))
/// ```
///
/// (for a linear part `½ q_nᵀ k q_{n+1}`). The model must subtract the forces of this part from `f_before`
/// and `f`. The energy balance then closes to round-off in spite of the break.
#[derive(Debug)]
pub struct Evolution<'a, T> {
    /// Time of the new positions \[s\].
    pub time: T,
    /// Displacements one step earlier.
    pub q_before: &'a [T],
    /// Displacements now.
    pub q: &'a [T],
    /// Weighted internal forces at `q_before`; the forces of what disappears are to be subtracted.
    pub f_before: &'a mut [T],
    /// Weighted internal forces at `q`, as [`Model::advance`] has just computed them; to be corrected
    /// likewise.
    pub f: &'a mut [T],
}

/// A mechanics model as the coupling sees it: the weighted inertia `M_β` and the weighted internal forces
/// `F_int,α` of `M_β q̈ = F_ext,γ − F_int,α`. The core adds loads and coupling forces.
///
/// A model knows no other model, no multipliers and no time integrator.
pub trait Model<T: Real>: Send {
    /// Name for messages and reports.
    fn name(&self) -> &str;

    /// Kind of the model: "fem", "cnem", "dem" ...
    fn kind(&self) -> &str;

    /// Arrangement of the unknowns.
    fn layout(&self) -> DofLayout;

    /// Reference positions of the nodes \[m\].
    fn nodes(&self) -> &[Point3<T>];

    /// Writes the lumped inertia of every unknown \[kg, kg m²\]. Each integration cell (element, bond)
    /// contributes its mass times the **mean** of the weight over the cell.
    ///
    /// # Errors
    /// Any error of the model.
    fn lumped_inertia(&self, weight: &dyn Weight<T>, out: &mut [T]) -> Result<()>;

    /// Stores the weight `α` of the internal energy. Each cell takes the mean of `α` over the cell, as in
    /// [`Model::lumped_inertia`].
    ///
    /// # Errors
    /// Any error of the model.
    fn set_internal_weight(&mut self, alpha: &dyn Weight<T>) -> Result<()>;

    /// Does the work of [`Model::set_internal_weight`] for a weight that differs from the last one only where
    /// `changed` returns true: a cell keeps its mean if its box has no such place. The default finds the mean
    /// of every cell again.
    ///
    /// # Errors
    /// Errors of [`Model::set_internal_weight`].
    fn change_internal_weight(&mut self, alpha: &dyn Weight<T>, changed: &Changed<T>) -> Result<()> {
        let _ = changed;
        self.set_internal_weight(alpha)
    }

    /// Adds the weighted internal forces `−F_int,α(q)` \[N, N m\] to `f`. Torques are conjugate to spins
    /// about fixed axes. Must not allocate.
    ///
    /// # Errors
    /// Failure of the constitutive law, such as an inverted element.
    fn add_internal_forces(&mut self, q: &[T], f: &mut [T]) -> Result<()>;

    /// Does the work of [`Model::add_internal_forces`] at displacements that the run has reached. The run
    /// calls it once per step and once before the first step. A model updates orientations here: with `θ` the
    /// rotations of the last call, rotations `q` mean the orientation `R(q) = exp(q − θ) R(θ)`. A model that
    /// wraps another one must pass the call on.
    ///
    /// # Errors
    /// Errors of [`Model::add_internal_forces`].
    fn advance(&mut self, q: &[T], f: &mut [T]) -> Result<()> {
        self.add_internal_forces(q, f)
    }

    /// Calls [`Model::advance`] and returns [`Model::internal_energy`] at `q` \[J\]. A model that finds the
    /// energy along with the forces overrides it.
    ///
    /// # Errors
    /// Errors of [`Model::advance`].
    fn advance_with_energy(&mut self, q: &[T], f: &mut [T]) -> Result<T> {
        self.advance(q, f)?;
        Ok(self.internal_energy(q))
    }

    /// Whole steps made by the model itself, if it can make them. The core uses them where nothing but the
    /// model acts on the unknowns within a step: no effect, no moving support, no evolution.
    fn stepping(&mut self) -> Option<&mut dyn Stepping<T>> {
        None
    }

    /// Weighted internal energy \[J\]. Internal forces are minus its gradient; the gradient with respect to
    /// rotations is taken at the rotations of the last [`Model::advance`].
    fn internal_energy(&self, q: &[T]) -> T;

    /// Returns [`Model::internal_energy`] up to round-off, and keeps the reached state. A model whose forces
    /// are computed faster than its energy overrides it: the ledger calls it at every draw.
    fn energy_from_forces(&mut self, q: &[T]) -> T {
        self.internal_energy(q)
    }

    /// Largest stable step of velocity Verlet \[s\] for the given inverse inertia (0 for prescribed
    /// unknowns). The default computes `2/ω_max` by Lanczos iterations and holds for a linear law; a
    /// nonlinear model overrides it.
    ///
    /// # Errors
    /// Errors of the internal forces.
    fn critical_step(&mut self, inverse_inertia: &[T]) -> Result<T> {
        crate::spectrum::critical_step(inverse_inertia, &mut |q, f| self.add_internal_forces(q, f))
    }

    /// Changes of the model by itself (breaking bonds), if it makes any. The run keeps the state before each
    /// step only if this is `Some`.
    fn evolving(&mut self) -> Option<&mut dyn Evolving<T>> {
        None
    }

    /// Returns the views that the model offers besides forces. The default offers nothing.
    fn views(&self) -> Views<'_, T> {
        Views::default()
    }

    /// Restricts the model to the part that the rank of `communicator` owns, and returns the displacement
    /// field on the nodes of the part. The run calls it before the first step and after the weights are
    /// set; until then the model is the same on every rank. Collective.
    ///
    /// # Errors
    /// [`Error::Unsupported`] for a model that cannot be partitioned, which is the default; errors of the
    /// transport.
    fn partition_among(&mut self, communicator: &Arc<dyn Communicator>) -> Result<Arc<dyn Interpolation<T>>> {
        let ranks = communicator.ranks();
        Err(Error::Unsupported {
            model: self.name().to_owned(),
            what: format!(
                "be in parts on {ranks} ranks; leave it whole, which is then the same on every rank"
            ),
        })
    }

    /// Nodes of the model that this rank owns. In a partitioned model they are a part of all nodes: nodes,
    /// unknowns, weights and forces are then those of the part; energies and the critical step are those of
    /// the whole model. Methods that every rank must call together say so.
    fn owned(&self) -> Owned {
        Owned::whole(self.layout().nodes)
    }

    /// Returns what the model must remember to resume with the same bits: broken bonds, orientations. Empty
    /// for most models.
    fn save(&self) -> Record<T> {
        Record::default()
    }

    /// Restores the state that [`Model::save`] returned.
    ///
    /// # Errors
    /// A record of another model.
    fn restore(&mut self, from: &Record<T>) -> Result<()> {
        from.expect(self.name(), 0, 0)
    }
}

/// Views that a model offers besides forces ([`Model::views`]), for probes, output and methods for linear
/// models. Every field is optional.
#[derive(Clone, Copy)]
#[non_exhaustive]
pub struct Views<'a, T: Real> {
    /// Names of the effects that live in the model itself, as in reports: "fracture", "finite-rotations".
    pub effects: &'a [&'static str],
    /// Positions about which the moments of the internal forces balance. Default: those at rest.
    pub arms: Arms,
    /// Stiffness matrix of a linear model; the static twin and the harmonic analysis need it.
    pub linear: Option<&'a dyn LinearModel<T>>,
    /// Particles and the volumes they stand for \[m³\], if the model consists of particles. They say where
    /// the model is, whatever field interpolates between them. `None` for a model that fills the cells of its
    /// field.
    pub particles: Option<&'a [Sample<T>]>,
    /// Stresses at the nodes, for output and probes.
    pub recovery: Option<&'a dyn Recovery<T>>,
    /// Gradients at points of a continuum, for the energy that cracks release.
    pub gradients: Option<&'a dyn Gradients<T>>,
    /// Facets of the surface of a continuum, for contact.
    pub surface: Option<&'a dyn Boundary>,
    /// Bonds between the nodes, for output.
    pub links: Option<&'a dyn Links<T>>,
    /// Report of the effects that a state would need.
    pub watching: Option<&'a dyn Watching<T>>,
    /// Cheap bound of the critical step.
    pub step_bound: Option<&'a dyn StepBound<T>>,
    /// Parts that break, with their loads.
    pub breakable: Option<&'a dyn Breakable<T>>,
    /// Figures of the effects in the model.
    pub facts: Option<&'a dyn Facts>,
    /// Means of the internal weight over the cells.
    pub means: Option<&'a dyn KeptMeans<T>>,
}

impl<T: Real> Default for Views<'_, T> {
    fn default() -> Self {
        Self {
            effects: &[],
            arms: Arms::Reference,
            linear: None,
            particles: None,
            recovery: None,
            gradients: None,
            surface: None,
            links: None,
            watching: None,
            step_bound: None,
            breakable: None,
            facts: None,
            means: None,
        }
    }
}

impl<T: Real> std::fmt::Debug for Views<'_, T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Views")
            .field("effects", &self.effects)
            .finish_non_exhaustive()
    }
}

/// A model with a surface of flat facets.
pub trait Boundary {
    /// Nodes of the faces of the surface, counter-clockwise from outside, with the numbers of
    /// [`Model::nodes`]. A triangle repeats its last node.
    fn faces(&self) -> Vec<[u32; 4]>;

    /// Nodes of the triangles of the surface; quadrilaterals are cut into two.
    fn triangles(&self) -> Vec<[u32; 3]> {
        let cut = |[a, b, c, d]: [u32; 4]| [Some([a, b, c]), (c != d).then_some([a, c, d])];
        self.faces().into_iter().flat_map(cut).flatten().collect()
    }
}

/// One step of velocity Verlet under internal forces alone. Every slice holds one number per unknown.
#[derive(Debug)]
pub struct Stride<'a, T> {
    /// Length of the step \[s\].
    pub dt: T,
    /// Displacements.
    pub q: &'a mut [T],
    /// Velocities.
    pub v: &'a mut [T],
    /// Accelerations by the internal forces.
    pub a: &'a mut [T],
    /// Inverse inertia; zero for unknowns held at rest.
    pub inverse_inertia: &'a [T],
    /// Inertia; given if the energies of the step are wanted.
    pub inertia: Option<&'a [T]>,
}

/// Energies of a step \[J\], with `v₊ = (q_{n+1} − q_n)/Δt`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drawn<T> {
    /// Internal energy at the end of the step.
    pub internal: T,
    /// Kinetic part of the discrete invariant, `½ v₊ᵀMv₊ + ¼ (q_{n+1} − q_n)·(f_{n+1} − f_n)`.
    pub moving: T,
}

/// A model with figures of its own effects.
pub trait Facts {
    /// Figures of the effects in the model, for reports: names (with units) and values.
    fn facts(&self) -> Vec<(String, f64)>;
}

/// A model that keeps the means of the internal weight over its cells, and need not find them again for an
/// inertia with the same weight.
pub trait KeptMeans<T: Real> {
    /// Does the work of [`Model::lumped_inertia`] for the weight that the internal energy has now, which the
    /// caller passes as `alpha`.
    ///
    /// # Errors
    /// Errors of [`Model::lumped_inertia`].
    fn inertia_by_internal_weight(&self, alpha: &dyn Weight<T>, out: &mut [T]) -> Result<()>;
}

/// A model that bounds its critical step at the cost of about one evaluation of its forces. A run whose step
/// is given in seconds, below this bound, is stable without a look at the spectrum.
pub trait StepBound<T: Real> {
    /// Lower bound of [`Model::critical_step`] \[s\]. Collective.
    fn step_bound(&self, inverse_inertia: &[T]) -> T;
}

/// A model that makes whole steps itself. This pays for a model so fast that passes over its unknowns count:
/// it accelerates nodes in the pass that computes their forces, while they are in the cache.
pub trait Stepping<T: Real> {
    /// Makes the step
    ///
    /// ```text
    /// v₊ = v + Δt/2 a    q += Δt v₊    a = w f(q)    v = v₊ + Δt/2 a
    /// ```
    ///
    /// with the same bits as the core: every product and every sum is rounded. The call replaces
    /// [`Model::advance`] and must not allocate. Returns the energies of the step if [`Stride::inertia`] is
    /// given.
    ///
    /// # Errors
    /// Errors of [`Model::advance`].
    fn stride(&mut self, step: Stride<'_, T>) -> Result<Option<Drawn<T>>>;
}

/// A model that changes itself as it moves.
pub trait Evolving<T: Real> {
    /// Name of the effect that takes the energy, one of [`Views::effects`].
    fn effect(&self) -> &'static str;

    /// Lets the model change itself and returns the energy that left it \[J\], by the rule of [`Evolution`].
    /// The run calls it once per step, right after [`Model::advance`] to the new positions, so that one pass
    /// over the model can serve both.
    ///
    /// # Errors
    /// Any error of the model.
    fn evolve(&mut self, step: Evolution<'_, T>) -> Result<T>;

    /// Returns whether the model would stay as it is at rest in the displacements `q`. As long as it does, a
    /// linear model has equilibria that one system gives ([`crate::Coupled::settle`]). A model that cannot
    /// tell returns `false`, as by default; all of its equilibria are relaxed.
    fn stays(&self, _q: &[T]) -> bool {
        false
    }

    /// From now on, leaves every part as it is while its weight is zero: its nodes sleep, and their
    /// displacements are those of when they fell asleep. Returns whether the model can do so; it cannot by
    /// default, and then its weights must not change in a run ([`crate::Coupled::rezone`]).
    fn sleep(&mut self) -> bool {
        false
    }
}

/// An effect that a model would need but that is not switched on.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// Name of the effect to switch on.
    pub effect: &'static str,
    /// Reason, with value and limit.
    pub message: String,
}

/// A model that can report which effects a state would need.
pub trait Watching<T: Real> {
    /// Returns the effects that `state` would need and that may not be switched on. May take as long as a few
    /// steps; never called during a step.
    fn watch(&self, state: &State<T>) -> Vec<Finding>;
}

/// A model with parts (bonds) that break when their load reaches their strength, whatever their weight.
pub trait Breakable<T: Real>: Sync {
    /// Nodes at the ends of each part.
    fn parts(&self) -> &[[u32; 2]];

    /// Returns the load of each of these parts in the displacements `q` over its strength \[–\], as a number
    /// that grows in proportion to the displacements; zero for broken parts.
    fn utilisations(&self, q: &[T], parts: &[u32]) -> Vec<T>;
}

/// A model whose internal forces are `−K q`.
pub trait LinearModel<T: Real> {
    /// Weighted stiffness matrix \[N/m\]: symmetric, both triangles stored.
    fn stiffness(&self) -> CsMat<T>;
}

/// The coarse role: the model receives the weight `f` and must have a continuous field in the overlap.
pub trait CoarseModel<T: Real>: Model<T> {
    /// The continuous displacement field on the model's nodes.
    fn coarse_field(&self) -> Arc<dyn Interpolation<T>>;
}

/// The fine role: the model receives `1 − f`. A discrete model has no field of its own and chooses one here
/// (natural neighbours, or particle quadrature [`crate::field::ParticleField`]).
pub trait FineModel<T: Real>: Model<T> {
    /// The displacement field that the junction sees in the overlap.
    fn fine_field(&self) -> Arc<dyn Interpolation<T>>;
}

/// Returns the place of the node of every unknown \[m\].
pub(crate) fn unknown_places<T: Real>(model: &dyn Model<T>) -> Vec<Point3<T>> {
    let (layout, nodes) = (model.layout(), model.nodes());
    (0..layout.dofs()).map(|d| nodes[layout.node_of(d)]).collect()
}

/// Checks that a slice holds one value per unknown of a model; for implementers of [`Model`].
///
/// # Errors
/// [`Error::SizeMismatch`], naming `what` and the model.
pub fn check_size<T: Real>(model: &dyn Model<T>, what: &str, found: usize) -> Result<()> {
    let expected = model.layout().dofs();
    if found == expected {
        return Ok(());
    }
    Err(Error::SizeMismatch {
        what: format!("{what} of model '{}'", model.name()),
        expected,
        found,
    })
}
