//! What a mechanics model must offer to be coupled, and the two roles it can play.

use crate::energy_release::Gradients;
use crate::error::invalid;
use crate::field::Interpolation;
use crate::geometry::Sample;
use crate::ranks::{Communicator, Portion};
use crate::record::Record;
use crate::recovery::{Links, Recovery};
use crate::weight::Weight;
use crate::{Error, Real, Result};
use nalgebra::Point3;
use sprs::CsMat;
use std::sync::Arc;

/// What a model became that was shared out among ranks.
#[derive(Clone)]
pub struct Shared<T: Real> {
    /// What this rank holds of it.
    pub portion: Arc<Portion>,
    /// Its field there.
    pub field: Arc<dyn Interpolation<T>>,
}

impl<T: Real> std::fmt::Debug for Shared<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Shared")
            .field("portion", &self.portion)
            .finish_non_exhaustive()
    }
}

/// How the degrees of freedom are arranged: `components` displacements per node (`x0 y0 z0 x1 …`), then
/// `rotations` per node in the same order, which the coupling never touches.
///
/// The velocity of a rotation is the spin about fixed axes, its acceleration the torque over the inertia,
/// and the unknown itself the spin added up over time: the rotation vector for small rotations and for
/// those about one axis, and no orientation otherwise. Orientations belong to the model, see
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
    /// Whether every node has three rotations.
    pub fn turns(&self) -> bool {
        self.rotations == 3
    }
    /// The node of an unknown.
    pub fn node_of(&self, dof: usize) -> usize {
        match dof.checked_sub(self.translations()) {
            None => dof / self.components,
            Some(behind) => behind / self.rotations.max(1),
        }
    }
    /// Refuses an arrangement that nothing here knows.
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

/// Positions about which the moments of forces vanish.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arms {
    /// Those at rest: linear laws.
    Reference,
    /// The present ones: laws that turn with their body, contact.
    Current,
}

/// Displacements \[m\] (and rotations \[rad\]), velocities (and spins) and accelerations of one model.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct State<T> {
    /// Displacements, rotations.
    pub q: Vec<T>,
    /// Velocities.
    pub v: Vec<T>,
    /// Accelerations.
    pub a: Vec<T>,
}

impl<T: Real> State<T> {
    /// At rest in the reference configuration.
    pub fn zero(dofs: usize) -> Self {
        Self {
            q: vec![T::zero(); dofs],
            v: vec![T::zero(); dofs],
            a: vec![T::zero(); dofs],
        }
    }
}

/// The step in which a model may change itself.
///
/// A part of the model that disappears (a bond that breaks) with energy `e` and forces `g = −de/dq` takes
///
/// ```text
/// ½ (e(q_n) + e(q_{n+1})) + ¼ (q_{n+1} − q_n)·(g(q_{n+1}) − g(q_n))
/// ```
///
/// out of the discrete invariant (`½ q_nᵀ k q_{n+1}` for a linear one), and its forces must be taken out of
/// `f_before` and `f`: then the energy balance closes to round-off in spite of the break.
#[derive(Debug)]
pub struct Evolution<'a, T> {
    /// Time of the new positions \[s\].
    pub time: T,
    /// Displacements one step earlier.
    pub q_before: &'a [T],
    /// Displacements now.
    pub q: &'a [T],
    /// Weighted internal forces at `q_before`, to be corrected for what disappears.
    pub f_before: &'a mut [T],
    /// The same at `q`, as [`Model::advance`] has just left them in zeros.
    pub f: &'a mut [T],
}

/// A mechanics model as the coupling sees it: `M_β q̈ = F_ext,γ − F_int,α`, without loads and coupling
/// forces.
///
/// A model never meets another model, the multipliers or the time integrator.
pub trait Model<T: Real>: Send {
    /// Name for messages and reports.
    fn name(&self) -> &str;

    /// Kind of the model: "fem", "cnem", "dem" ...
    fn kind(&self) -> &str;

    /// Arrangement of the unknowns.
    fn layout(&self) -> DofLayout;

    /// Reference positions of the nodes \[m\].
    fn nodes(&self) -> &[Point3<T>];

    /// Writes the lumped inertia of every unknown \[kg, kg m²\]: each integration cell (element, bond)
    /// contributes its mass times the **mean** of the weight over the cell.
    ///
    /// # Errors
    /// Whatever keeps the model from doing so.
    fn lumped_inertia(&self, weight: &dyn Weight<T>, out: &mut [T]) -> Result<()>;

    /// Stores the weight `α` of the internal energy, by its means over the cells like
    /// [`Model::lumped_inertia`].
    ///
    /// # Errors
    /// Whatever keeps the model from doing so.
    fn set_internal_weight(&mut self, alpha: &dyn Weight<T>) -> Result<()>;

    /// Adds the weighted internal forces `−F_int,α(q)` \[N, N m\] to `f`; torques are those on spins, about
    /// fixed axes. Must not allocate.
    ///
    /// # Errors
    /// Failure of the constitutive law (an inverted element, a broken bond that cannot be).
    fn add_internal_forces(&mut self, q: &[T], f: &mut [T]) -> Result<()>;

    /// [`Model::add_internal_forces`] at displacements that the run has reached: called once per step, and
    /// once before the first, in its place. What is not a vector (an orientation) goes on from here: with
    /// `θ` the rotations reached last, those of any `q` mean `R(q) = exp(q − θ) R(θ)`. A model that wraps
    /// another one must pass the call on.
    ///
    /// # Errors
    /// Those of [`Model::add_internal_forces`].
    fn advance(&mut self, q: &[T], f: &mut [T]) -> Result<()> {
        self.add_internal_forces(q, f)
    }

    /// [`Model::advance`], and [`Model::internal_energy`] there \[J\], for a model that finds it on the way.
    ///
    /// # Errors
    /// Those of [`Model::advance`].
    fn advance_with_energy(&mut self, q: &[T], f: &mut [T]) -> Result<T> {
        self.advance(q, f)?;
        Ok(self.internal_energy(q))
    }

    /// The model as one that makes whole steps itself, if it can: the core lets it where nothing but the
    /// model acts on the unknowns within a step (no effects, no moving support, no evolution).
    fn stepping(&mut self) -> Option<&mut dyn Stepping<T>> {
        None
    }

    /// Positions about which the moments of the internal forces vanish.
    fn arms(&self) -> Arms {
        Arms::Reference
    }

    /// Weighted internal energy \[J\]; minus its gradient are the internal forces, that with
    /// respect to rotations at those reached last.
    fn internal_energy(&self, q: &[T]) -> T;

    /// Largest stable step of velocity Verlet \[s\] for the given inverse inertia (0 = prescribed). The
    /// default computes `2/ω_max` by Lanczos iterations on the forces of a linear law; a nonlinear model
    /// overrides it.
    ///
    /// # Errors
    /// Those of the internal forces.
    fn critical_step(&mut self, inverse_inertia: &[T]) -> Result<T> {
        crate::spectrum::critical_step(inverse_inertia, &mut |q, f| self.add_internal_forces(q, f))
    }

    /// The model as one that changes itself as it moves (bonds that break), if it does. Only then the state
    /// before the step is kept.
    fn evolving(&mut self) -> Option<&mut dyn Evolving<T>> {
        None
    }

    /// The model as one that can tell which effects a state would need, if it can.
    fn watching(&self) -> Option<&dyn Watching<T>> {
        None
    }

    /// Particles with the volumes they stand for \[m³\], for a model that consists of them: where it is,
    /// whatever field interpolates between them. None for a model that fills the cells of its field.
    fn particles(&self) -> Option<&[Sample<T>]> {
        None
    }

    /// The model as one that knows stresses at its nodes, if it does: for output and probes.
    fn recovery(&self) -> Option<&dyn Recovery<T>> {
        None
    }

    /// The model as a continuum with gradients at points, if it is one: for the energy that cracks release.
    fn gradients(&self) -> Option<&dyn Gradients<T>> {
        None
    }

    /// The model as one whose nodes are joined by bonds, if they are: for output.
    fn links(&self) -> Option<&dyn Links<T>> {
        None
    }

    /// Becomes the part of the model that the rank of `communicator` holds, before it has gone anywhere:
    /// weights are set, all of the model is the same on every rank.
    ///
    /// # Errors
    /// [`Error::Unsupported`] for a model that cannot be in parts, as most cannot; what the transport says.
    fn share_out(&mut self, communicator: &Arc<dyn Communicator>) -> Result<Shared<T>> {
        let ranks = communicator.ranks();
        Err(Error::Unsupported {
            model: self.name().to_owned(),
            what: format!(
                "be in parts on {ranks} ranks; leave it whole, which is then the same on every rank"
            ),
        })
    }

    /// What this rank holds of the model, if it is a part of one: nodes, unknowns, weights and forces are
    /// then those of the part, energies and the critical step those of all of it, and every call that all
    /// ranks must make together says so.
    fn portion(&self) -> Option<&Portion> {
        None
    }

    /// Effects that live in the model itself, by the names they have in reports: "fracture",
    /// "finite-rotations".
    fn effects(&self) -> &[&'static str] {
        &[]
    }

    /// Figures of the effects in the model, for reports: names (with units) and values.
    fn facts(&self) -> Vec<(String, f64)> {
        Vec::new()
    }

    /// What the model must remember to go on with the same bits: bonds that broke, orientations. Nothing
    /// for most.
    fn save(&self) -> Record<T> {
        Record::default()
    }

    /// Goes back to what [`Model::save`] returned.
    ///
    /// # Errors
    /// A record of another model.
    fn restore(&mut self, from: &Record<T>) -> Result<()> {
        from.expect(self.name(), 0, 0)
    }

    /// The model as a linear one, if it is: needed by the static twin and the harmonic analysis.
    fn as_linear(&self) -> Option<&dyn LinearModel<T>> {
        None
    }
}

/// A step of velocity Verlet under internal forces alone, one number per unknown in every slice.
#[derive(Debug)]
pub struct Stride<'a, T> {
    /// Length of the step \[s\].
    pub dt: T,
    /// Displacements.
    pub q: &'a mut [T],
    /// Velocities.
    pub v: &'a mut [T],
    /// Accelerations, those of the internal forces.
    pub a: &'a mut [T],
    /// Inverse inertia, zero where unknowns are held at rest.
    pub inverse_inertia: &'a [T],
    /// Inertia, where the energies of the step are wanted.
    pub inertia: Option<&'a [T]>,
}

/// Energies of a step \[J\]; `v₊ = (q_{n+1} − q_n)/Δt`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drawn<T> {
    /// Internal energy at its end.
    pub internal: T,
    /// `½ v₊ᵀMv₊ + ¼ (q_{n+1} − q_n)·(f_{n+1} − f_n)`.
    pub moving: T,
}

/// A model that makes whole steps itself: one that is fast enough for passes over its unknowns to count,
/// and accelerates nodes in the pass that finds their forces, while they are in the cache.
pub trait Stepping<T: Real> {
    /// Makes the step
    ///
    /// ```text
    /// v₊ = v + Δt/2 a    q += Δt v₊    a = w f(q)    v = v₊ + Δt/2 a
    /// ```
    ///
    /// with the bits of the core: every product and every sum is rounded. Replaces [`Model::advance`], and
    /// like it must not allocate. The energies are those of the step if [`Stride::inertia`] is there.
    ///
    /// # Errors
    /// Those of [`Model::advance`].
    fn stride(&mut self, step: Stride<'_, T>) -> Result<Option<Drawn<T>>>;
}

/// A model that changes itself as it moves.
pub trait Evolving<T: Real> {
    /// Name of the effect that takes the energy, one of [`Model::effects`].
    fn effect(&self) -> &'static str;

    /// Lets the model change itself: called once per step, right after [`Model::advance`] to the new
    /// positions, so that one pass can serve both. Returns the energy that left the model \[J\], by the
    /// rule of [`Evolution`].
    ///
    /// # Errors
    /// Whatever keeps the model from doing so.
    fn evolve(&mut self, step: Evolution<'_, T>) -> Result<T>;
}

/// Something a model would need an effect for that is not on.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// Name of the effect to switch on.
    pub effect: &'static str,
    /// What was found, with value and limit.
    pub message: String,
}

/// A model that can tell which effects a state would need.
pub trait Watching<T: Real> {
    /// What this state would need effects for that may not be on. May take as long as a few steps; never
    /// called during a step.
    fn watch(&self, state: &State<T>) -> Vec<Finding>;
}

/// A model whose internal forces are `−K q`.
pub trait LinearModel<T: Real> {
    /// The weighted stiffness matrix \[N/m\], symmetric, both triangles stored.
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
