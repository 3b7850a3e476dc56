//! The interface: coupling matrices, multiplier operator and correction, the same for any pair of models.
//!
//! With `B_m` the multiplier-by-unknown matrix of side `m` (`C_m = B_mᵀ`, stored once, so that the two are adjoint by
//! construction):
//!
//! ```text
//! constraint   B_C u̇ − B_D ḋ = 0
//! operator     S = B_C M_C⁻¹ B_Cᵀ + B_D M_D⁻¹ B_Dᵀ
//! projection   S μ = B_C u̇* − B_D ḋ*,   u̇ = u̇* − M_C⁻¹ B_Cᵀ μ,   ḋ = ḋ* + M_D⁻¹ B_Dᵀ μ,   λ = 2 μ/ΔT
//! ```
//!
//! Velocities at the instant are the projected ones; the change is added a second time at the start of the next step, which makes
//! the two a reflection. `S` does not depend on the step: it is factored once.

mod advice;
mod assembly;
mod gradients;
mod operator;
mod rank;
mod rows;
mod sums;
mod transfer;

pub use assembly::Sampling;
pub use operator::Solver;
pub use rank::NullMode;

use crate::field::Interpolation;
use crate::junction::{Components, Junction, Needs};
use crate::mediator::Mediator;
use crate::model::DofLayout;
use crate::scalar::dot;
use crate::weight::Weight;
use crate::{Error, Real, Result, parallel};
use nalgebra::Point3;
use operator::Operator;
use sprs::{CsMat, TriMat};
use std::sync::Arc;
use transfer::Transfer;
pub(crate) use transfer::{Rows, add_at};

/// What ties a coarse to a fine subdomain.
pub struct InterfaceSpec<T: Real> {
    /// Name for messages and reports.
    pub name: String,
    /// Index of the coarse subdomain.
    pub coarse: usize,
    /// Index of the fine subdomain.
    pub fine: usize,
    /// The multiplier space.
    pub mediator: Arc<dyn Mediator<T>>,
    /// The scalar product.
    pub junction: Box<dyn Junction<T>>,
    /// Choices with good defaults.
    pub options: InterfaceOptions<T>,
}

impl<T: Real> InterfaceSpec<T> {
    /// A tie between the subdomains of these numbers, with the default options.
    pub fn new(
        name: &str,
        coarse: usize,
        fine: usize,
        mediator: Arc<dyn Mediator<T>>,
        junction: impl Junction<T> + 'static,
    ) -> Self {
        Self {
            name: name.to_owned(),
            coarse,
            fine,
            mediator,
            junction: Box::new(junction),
            options: InterfaceOptions::default(),
        }
    }

    /// Of so many displacement components: how many share one scalar coupling matrix.
    fn shared(&self, components: usize) -> usize {
        match self.junction.components() {
            Components::Separate => components,
            Components::Mixed => 1,
        }
    }
}

impl<T: Real> std::fmt::Debug for InterfaceSpec<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("InterfaceSpec")
            .field("name", &self.name)
            .field("junction", &self.junction.name())
            .finish_non_exhaustive()
    }
}

/// Choices of an interface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InterfaceOptions<T: Real> {
    /// How the junction integrals are sampled.
    pub sampling: Sampling,
    /// How the multipliers are solved for.
    pub solver: Solver<T>,
    /// Lump the multiplier operator to its row sums (L2 only). The constraint then holds only in the mean.
    pub lumped: bool,
    /// Eigenvalues of the scaled operator below this share of the largest count as zero.
    pub rank_tolerance: T,
    /// Largest jump of the initial displacements that is projected away, relative to the largest of them; above it the
    /// run is refused. The default of 0.1: linear interpolation of a wave on eight elements errs by 7.7 % of its amplitude,
    /// so that two meshes of one smooth field differ by less.
    pub start_jump: T,
    /// Point at which the models are pinned together; needed by a seminorm. `None` takes the first mediator node.
    pub pin: Option<Point3<T>>,
}

impl<T: Real> Default for InterfaceOptions<T> {
    fn default() -> Self {
        // Below 1e-10 a multiplier moves the models by less than the round-off of the solve (f32: 1e-5).
        let rank_tolerance = T::of(1e-10).max(T::epsilon() * T::of(100.0));
        Self {
            sampling: Sampling::Intersection,
            solver: Solver::Auto,
            lumped: false,
            rank_tolerance,
            start_jump: T::of(0.1),
            pin: None,
        }
    }
}

/// One model as an interface sees it.
#[derive(Clone, Copy)]
pub struct Side<'a, T: Real> {
    /// Name of the model.
    pub name: &'a str,
    /// Field in the overlap.
    pub field: &'a dyn Interpolation<T>,
    /// Arrangement of the unknowns.
    pub layout: DofLayout,
    /// Inverse weighted inertia; zero where motion is prescribed.
    pub inverse_inertia: &'a [T],
    /// Weight `β` of the model, between zero and one in the overlap.
    pub weight: &'a dyn Weight<T>,
}

impl<T: Real> std::fmt::Debug for Side<'_, T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Side of {}", self.name)
    }
}

/// What the set-up of an interface found.
#[derive(Debug, Clone, PartialEq)]
pub struct InterfaceReport {
    /// Name.
    pub name: String,
    /// Junction.
    pub junction: &'static str,
    /// Multiplier unknowns.
    pub multipliers: usize,
    /// Independent ones; all of them where it is not known (a warning says so).
    pub rank: usize,
    /// How they are solved for: `factor`, `eigenvectors` (where multipliers are dependent), `conjugate gradients`, `lumped`.
    pub solver: &'static str,
    /// Condition number of `A` (by power iteration; of the retained modes where some were dropped).
    pub condition: f64,
    /// Measure of the overlap \[m³\].
    pub measure: f64,
    /// Nodes of the coarse and the fine model that the multipliers act on.
    pub coupled_nodes: [usize; 2],
    /// Relative difference of the mediator's zeroth and first moments as the two sides integrate them.
    pub momentum_defect: f64,
    /// Stored entries of coupling matrices and factor.
    pub nonzeros: usize,
    /// Modes that were dropped.
    pub null_modes: Vec<NullMode>,
    /// Degree up to which the junction integrals are exact on each piece; none where they are sums over particles.
    pub degree: Option<usize>,
    /// Share of the overlap that lies outside the mediator, at its surface.
    pub outside: f64,
    /// Shares of the coarse and the fine model's nodes in the overlap on which multipliers act: by their volumes for
    /// particles, by their number otherwise. What sticks out of the other model is not tied.
    pub tied: [f64; 2],
    /// Jump of the initial displacements that was projected away \[m\], as the multipliers see it.
    pub start_jump: f64,
    /// Largest change of an initial displacement by that \[m\].
    pub start_moved: f64,
    /// What a user should know.
    pub warnings: Vec<String>,
}

/// Coupling matrix of one side, multiplier rows by model columns.
#[derive(Debug, Clone)]
pub(crate) struct Coupling<T> {
    pub(crate) matrix: CsMat<T>,
    /// Vector components that share a scalar matrix; 1 if the matrix itself holds all components.
    pub(crate) shared: usize,
}

impl<T: Real> Coupling<T> {
    /// The matrix for all components, interleaved.
    fn expanded(&self) -> CsMat<T> {
        let d = self.shared;
        let size = (self.matrix.rows() * d, self.matrix.cols() * d);
        let mut all = TriMat::with_capacity(size, self.matrix.nnz() * d);
        for (v, (i, j)) in self.matrix.iter() {
            (0..d).for_each(|c| all.add_triplet(i * d + c, j * d + c, *v));
        }
        all.to_csr()
    }
}

/// A ready interface between a coarse and a fine subdomain.
#[derive(Debug)]
pub struct Interface<T: Real> {
    /// Subdomains: coarse, fine.
    pub(crate) sides: [usize; 2],
    /// Coupling matrices: coarse, fine.
    pub(crate) coupling: [Transfer<T>; 2],
    operator: Operator<T>,
    pub(crate) lambda: Vec<T>,
    /// `μ` of half a reflection.
    impulse: Vec<T>,
    /// `b = B_C v_C − B_D v_D` before the last kick.
    jump: Vec<T>,
    power: T,
    /// `λ = rate μ`.
    rate: T,
    pub(crate) report: InterfaceReport,
    pub(crate) start_jump: T,
    components: usize,
    nodes: Vec<Point3<T>>,
}

impl<T: Real> Interface<T> {
    /// Whether each component of a multiplier acts on that component alone.
    pub(crate) fn splits(&self) -> bool {
        self.components == 1 || self.coupling[0].shared() == self.components
    }

    /// Builds the coupling matrices of a mediator between two sides (coarse first) and factors the operator.
    ///
    /// # Errors
    /// Empty overlap, overhanging mediator, momentum leak, missing gradients, lumped H1, or no independent multiplier.
    pub fn new(spec: &InterfaceSpec<T>, sides: [Side<'_, T>; 2]) -> Result<Self> {
        Self::announced(spec, sides, &mut || ())
    }

    /// The same; `factoring` is called when the coupling matrices are there.
    pub(crate) fn announced(
        spec: &InterfaceSpec<T>,
        sides: [Side<'_, T>; 2],
        factoring: &mut dyn FnMut(),
    ) -> Result<Self> {
        let components = sides[0].layout.components;
        if sides[1].layout.components != components {
            return Err(Error::SizeMismatch {
                what: format!(
                    "interface '{}': displacement components of '{}'",
                    spec.name, sides[1].name
                ),
                expected: components,
                found: sides[1].layout.components,
            });
        }
        if spec.options.lumped && spec.junction.needs() != Needs::Values {
            return Err(crate::error::invalid_option(
                &spec.name,
                "lumped",
                spec.junction.name(),
                "only a junction of values (L2) may be lumped; lumping an H1 junction diverges",
            ));
        }
        spec.options.solver.check(&spec.name)?;
        let built = assembly::assemble(spec, &sides, components)?;
        factoring();
        let inverse = [sides[0].inverse_inertia, sides[1].inverse_inertia];
        let operator = Operator::new(spec, &built.coupling, inverse, components)?;
        let size = built.coupling[0].matrix.rows() * built.coupling[0].shared;
        let signs = [-T::one(), T::one()];
        let coupling = [0, 1].map(|m| Transfer::new(&built.coupling[m], signs[m], inverse[m]));
        let coupled_nodes = [0, 1].map(|m| coupled_nodes(&coupling[m], components).len());
        let mut report = InterfaceReport {
            name: spec.name.clone(),
            junction: spec.junction.name(),
            multipliers: size,
            rank: size - operator.dropped(),
            solver: operator.solver,
            condition: operator.condition.as_f64(),
            measure: built.measure.as_f64(),
            coupled_nodes,
            momentum_defect: built.momentum_defect.as_f64(),
            nonzeros: coupling.iter().map(Transfer::nonzeros).sum::<usize>() + operator.nonzeros(),
            null_modes: operator.null_modes.clone(),
            degree: built.degree,
            outside: 0.0,
            tied: [1.0; 2],
            start_jump: 0.0,
            start_moved: 0.0,
            warnings: built.warnings,
        };
        report
            .warnings
            .extend(advice::advice(&report, spec, &sides, operator.ranked));
        Ok(Self {
            sides: [spec.coarse, spec.fine],
            coupling,
            operator,
            lambda: vec![T::zero(); size],
            impulse: vec![T::zero(); size],
            jump: vec![T::zero(); size],
            power: T::zero(),
            rate: T::zero(),
            report,
            start_jump: spec.options.start_jump,
            components,
            nodes: spec.mediator.nodes().to_vec(),
        })
    }

    /// What the set-up found.
    pub fn report(&self) -> &InterfaceReport {
        &self.report
    }

    /// Index of the coarse and the fine subdomain.
    pub fn sides(&self) -> [usize; 2] {
        self.sides
    }

    /// Multipliers of the last correction, components interleaved \[N/m³ for L2\].
    pub fn multipliers(&self) -> &[T] {
        &self.lambda
    }

    /// `B_C` (side 0) or `B_D` (side 1): multiplier unknowns by displacement unknowns of that model, components
    /// interleaved \[m³ for L2\]. The constraint is `B_C u̇ − B_D ḋ = 0`. Expanded from the stored matrix at every call;
    /// `None` for a side above 1.
    pub fn coupling_matrix(&self, side: usize) -> Option<CsMat<T>> {
        self.coupling.get(side).map(|c| c.matrix().expanded())
    }

    /// `S = Σ_m B_m diag(inverse_m) B_mᵀ` for given inverse inertias.
    pub(crate) fn operator_matrix(&self, inverse: [&[T]; 2]) -> CsMat<T> {
        let coupling = self.coupling.each_ref().map(|c| Coupling {
            matrix: c.matrix().expanded(),
            shared: 1,
        });
        operator::operator(&coupling, &inverse.map(<[T]>::to_vec))
    }

    /// Iterations that the last solve took; zero with a factor.
    pub fn iterations(&self) -> usize {
        self.operator.iterations()
    }

    /// Mediator nodes \[m\].
    pub fn nodes(&self) -> &[Point3<T>] {
        &self.nodes
    }

    /// Vector components per multiplier node.
    pub fn components(&self) -> usize {
        self.components
    }

    /// Solves `S μ = B_C x_C − B_D x_D` and keeps `scale μ` with what it changes,
    /// `δ_C = −scale M_C⁻¹ B_Cᵀ μ`, `δ_D = scale M_D⁻¹ B_Dᵀ μ`.
    pub(crate) fn find(&mut self, x: [&[T]; 2], scale: T) {
        if parallel::pays(self.coupling.iter().map(Transfer::nonzeros).sum()) {
            // One entry into the pool for all passes: each would cost a wake-up otherwise.
            rayon::scope(|_| self.find_here(x, scale));
        } else {
            self.find_here(x, scale);
        }
    }

    fn find_here(&mut self, x: [&[T]; 2], scale: T) {
        self.coupling.iter_mut().zip(x).for_each(|(c, x)| c.load(x));
        transfer::local_jump(self.coupling.each_ref(), &mut self.impulse);
        self.jump.copy_from_slice(&self.impulse);
        self.operator.solve(&mut self.impulse, &mut self.coupling);
        self.impulse.iter_mut().for_each(|m| *m *= scale);
        self.spread();
        // μᵀ(b − S μ), as B v = b − S μ after the kick.
        let spent: T = self.coupling.iter().map(Transfer::twice_kinetic).sum();
        self.power = self.rate * (dot(&self.jump, &self.impulse) - spent);
    }

    /// `v += δ` on one side.
    pub(crate) fn kick_again(&self, side: usize, v: &mut [T]) {
        self.coupling[side].kick(v);
    }

    /// First half of the reflection `v ← (I − 2P) v`: finds what takes the jump out of the velocities, takes it out and
    /// keeps it for the second half, [`Self::kick_again`], with which the next step begins.
    pub(crate) fn reflect(&mut self, v: [&mut [T]; 2]) {
        let [coarse, fine] = v;
        self.find([coarse, fine], T::one());
        self.kick_again(0, coarse);
        self.kick_again(1, fine);
    }

    /// Impulses `μ` of half a reflection; `λ = 2 μ/ΔT`.
    pub(crate) fn impulse(&self) -> &[T] {
        &self.impulse
    }

    /// Goes back to the impulses of another instant, and to what they change.
    pub(crate) fn restore(&mut self, impulse: &[T]) {
        self.impulse.copy_from_slice(impulse);
        self.spread();
    }

    /// Takes multipliers that are known, those of an equilibrium.
    pub(crate) fn hold(&mut self, lambda: &[T]) {
        for (m, l) in self.impulse.iter_mut().zip(lambda) {
            *m = *l / self.rate;
        }
        self.spread();
    }

    /// `δ` of both sides and `λ` from the impulses.
    fn spread(&mut self) {
        for (l, m) in self.lambda.iter_mut().zip(&self.impulse) {
            *l = *m * self.rate;
        }
        self.coupling.iter_mut().for_each(|c| c.spread(&self.impulse));
    }

    /// Sets the length of the steps between reflections \[s\], to which multipliers refer.
    pub(crate) fn pace(&mut self, step: T) {
        self.rate = T::of(2.0) / step;
    }

    /// `λᵀ(B_C v_C − B_D v_D)` \[W\] with the velocities that the last [`Self::reflect`] left: zero but for round-off where
    /// the multipliers are solved for exactly or by Galerkin's condition.
    pub(crate) fn power(&self) -> T {
        self.power
    }

    /// Largest component of the jump `B_C x_C − B_D x_D` divided by the multiplier's own measure.
    pub(crate) fn jump(&self, x: [&[T]; 2], work: &mut Vec<T>) -> T {
        work.clear();
        work.resize(self.lambda.len(), T::zero());
        transfer::jump(self.coupling.each_ref(), x, work);
        let measured = work.iter().zip(&self.operator.row_measure);
        let measured = measured.filter(|(_, s)| **s > T::zero());
        measured.fold(T::zero(), |m, (r, s)| m.max((*r / *s).abs()))
    }
}

/// Nodes a coupling matrix touches, ascending.
pub(crate) fn coupled_nodes<T: Real>(coupling: &Transfer<T>, components: usize) -> Vec<usize> {
    let per_column = components / coupling.shared();
    let mut nodes: Vec<usize> = (coupling.coupled().iter().map(|j| *j as usize / per_column)).collect();
    nodes.dedup();
    nodes
}
