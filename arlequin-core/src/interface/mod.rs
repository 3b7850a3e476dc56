//! The interface: coupling matrices, multiplier operator and correction, the same for any pair of models.
//!
//! With `B_m` the multiplier-by-unknown matrix of side `m` (`C_m = B_mᵀ`, stored once, so that the two are
//! adjoint by construction):
//!
//! ```text
//! constraint   B_C u̇ − B_D ḋ = 0
//! operator     S = B_C M_C⁻¹ B_Cᵀ + B_D M_D⁻¹ B_Dᵀ
//! projection   S μ = B_C u̇* − B_D ḋ*,   u̇ = u̇* − M_C⁻¹ B_Cᵀ μ,   ḋ = ḋ* + M_D⁻¹ B_Dᵀ μ,   λ = 2 μ/ΔT
//! ```
//!
//! Velocities at the instant are the projected ones; the change is added a second time at the start of the
//! next step, which makes the two a reflection. `S` does not depend on the step: it is factored once.

mod advice;
mod assembly;
mod chebyshev;
mod cost;
mod coupling;
mod dots;
mod gradients;
mod iterated;
pub(crate) mod joint;
mod operator;
mod parts;
mod rank;
mod report;
mod rows;
mod sides;
mod solver;
mod sums;
mod system;
mod transfer;

pub use assembly::Sampling;
pub use cost::SolutionTime;
pub(crate) use coupling::Coupling;
pub use rank::NullMode;
pub use report::{Damped, InterfaceReport};
pub use solver::Solver;

use crate::field::Interpolation;
use crate::junction::{Components, Junction, Needs};
use crate::mediator::Mediator;
use crate::model::DofLayout;
use crate::ranks::Portion;
use crate::weight::Weight;
use crate::{Error, Real, Result};
use cost::Work;
use nalgebra::Point3;
use operator::{Operator, Wanted};
pub(crate) use sides::Sides;
use sprs::CsMat;
use std::ops::Range;
use std::sync::Arc;
use system::System;
pub(crate) use transfer::Transfer;
pub(crate) use transfer::{Rows, add_at, coupled_nodes};

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
    /// Largest jump of the initial displacements that is projected away, relative to the largest of them;
    /// above it the run is refused. The default of 0.1: linear interpolation of a wave on eight elements
    /// errs by 7.7 % of its amplitude, so that two meshes of one smooth field differ by less.
    pub start_jump: T,
    /// Point at which the models are pinned together; needed by a seminorm. `None` takes the first mediator
    /// node.
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

/// A ready interface between a coarse and a fine subdomain.
#[derive(Debug)]
pub struct Interface<T: Real> {
    /// Subdomains: coarse, fine.
    pub(crate) sides: [usize; 2],
    /// Coupling matrices: coarse, fine.
    pub(crate) coupling: Sides<T>,
    /// None where its multipliers are solved for together with others: [`joint::Joint`].
    system: Option<System<T>>,
    iterations: usize,
    lambda: Vec<T>,
    /// `μ` of half a reflection.
    impulse: Vec<T>,
    /// `λ = rate μ`.
    rate: T,
    /// Per multiplier node, of the coarse side: turns a constraint residual into a velocity.
    measures: Vec<T>,
    pub(crate) report: InterfaceReport,
    pub(crate) start_jump: T,
    /// Whether its iterations were given limits of their own.
    cut_short: bool,
    components: usize,
    nodes: Vec<Point3<T>>,
    /// What solvers have to do; of interfaces that are solved for together the first has it.
    work: Option<Work>,
}

/// An interface whose multipliers nobody solves for yet.
#[derive(Debug)]
pub(crate) struct Draft<T: Real> {
    pub(crate) interface: Interface<T>,
    /// Coupling matrices: coarse, fine.
    coupling: Vec<Coupling<T>>,
}

impl<T: Real> Draft<T> {
    /// The coupling matrices of a mediator between two sides, coarse first.
    pub(crate) fn new(spec: &InterfaceSpec<T>, sides: [Side<'_, T>; 2]) -> Result<Self> {
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
        spec.options.solver.check(&spec.name, spec.options.lumped)?;
        let built = assembly::assemble(spec, &sides, components)?;
        let shared = built.coupling[0].shared;
        let size = built.coupling[0].matrix.rows() * shared;
        let signs = [-T::one(), T::one()];
        let coupling =
            [0, 1].map(|m| Transfer::new(&built.coupling[m], components, signs[m], sides[m].inverse_inertia));
        let mut report = InterfaceReport {
            name: spec.name.clone(),
            junction: spec.junction.name(),
            multipliers: size,
            rank: size,
            solver: "",
            damped: None,
            condition: 1.0,
            condition_at_least: false,
            measure: built.measure.as_f64(),
            coupled_nodes: [0, 1].map(|m| coupled_nodes(&coupling[m], components).len()),
            momentum_defect: built.momentum_defect.as_f64(),
            nonzeros: coupling.iter().map(Transfer::nonzeros).sum(),
            null_modes: Vec::new(),
            degree: built.degree,
            outside: 0.0,
            tied: [1.0; 2],
            start_jump: 0.0,
            start_moved: 0.0,
            together: Vec::new(),
            warnings: built.warnings,
        };
        report.warnings.extend(advice::of_sides(&report, spec, &sides));
        let zeros = || vec![T::zero(); size];
        let interface = Interface {
            sides: [spec.coarse, spec.fine],
            coupling: Sides::new(coupling.into()),
            system: None,
            iterations: 0,
            lambda: zeros(),
            impulse: zeros(),
            rate: T::zero(),
            measures: (0..size / components)
                .map(|i| built.coupling[0].measure(i, components))
                .collect(),
            report,
            start_jump: spec.options.start_jump,
            cut_short: spec.options.solver.is_cut_short(),
            components,
            nodes: spec.mediator.nodes().to_vec(),
            work: None,
        };
        Ok(Self {
            interface,
            coupling: built.coupling.into(),
        })
    }

    /// The interface, solved for on its own; `inverse`: inverse inertias of the two sides.
    pub(crate) fn alone(self, spec: &InterfaceSpec<T>, inverse: [&[T]; 2]) -> Result<Interface<T>> {
        let mut out = self.interface;
        let wanted = Wanted {
            name: &spec.name,
            options: &spec.options,
        };
        let system = System::new(wanted, &self.coupling, &inverse, out.components)?;
        out.found(&system.operator, 0..out.lambda.len(), Vec::new());
        out.system = Some(system);
        Ok(out)
    }
}

impl<T: Real> Interface<T> {
    /// Whether each component of a multiplier acts on that component alone.
    pub(crate) fn splits(&self) -> bool {
        self.components == 1 || self.coupling[0].shared() == self.components
    }

    /// From now on models are in parts, of which it keeps the nodes here.
    pub(crate) fn share_out(&mut self, portions: [Option<&Arc<Portion>>; 2]) {
        self.coupling.share_out(&portions);
        if let (Some(system), Some(parts)) = (&mut self.system, self.coupling.parts()) {
            system.share_out(parts);
        }
    }

    /// Whether its multipliers are solved for without others.
    pub(crate) fn is_alone(&self) -> bool {
        self.system.is_some()
    }

    /// Builds the coupling matrices of a mediator between two sides (coarse first) and factors the operator.
    ///
    /// # Errors
    /// Empty overlap, overhanging mediator, momentum leak, missing gradients, lumped H1, or no independent
    /// multiplier.
    pub fn new(spec: &InterfaceSpec<T>, sides: [Side<'_, T>; 2]) -> Result<Self> {
        Draft::new(spec, sides)?.alone(spec, sides.map(|s| s.inverse_inertia))
    }

    /// Reports what an operator tells, of whose multipliers `own` are those of this interface; `together`:
    /// names of the interfaces that the others are of.
    fn found(&mut self, operator: &Operator<T>, own: Range<usize>, together: Vec<String>) {
        let nodes = own.start / self.components..own.end / self.components;
        let mine = operator.null_modes.iter().filter(|n| nodes.contains(&n.node));
        let report = &mut self.report;
        report.null_modes = mine
            .map(|n| NullMode {
                node: n.node - nodes.start,
                ..n.clone()
            })
            .collect();
        report.rank = report.multipliers - report.null_modes.len();
        report.solver = operator.solver;
        report.damped = operator.chebyshev().map(|of| Damped {
            eigenvalues: of.bounds,
            iterations: of.iterations,
        });
        report.condition = operator.condition.as_f64();
        report.condition_at_least = operator.at_least;
        if own.start == 0 {
            report.nonzeros += operator.nonzeros();
            self.work = (operator.solver != "lumped").then_some(operator.work);
        }
        report.together = together;
        let told = advice::of_rank(report, operator.ranked);
        report
            .warnings
            .extend(operator.chebyshev().and_then(|of| advice::of_iterations(&of)));
        report.warnings.extend(told);
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

    /// `B_C` (side 0) or `B_D` (side 1): multiplier unknowns by displacement unknowns of that model,
    /// components interleaved \[m³ for L2\]. The constraint is `B_C u̇ − B_D ḋ = 0`. Expanded from the
    /// stored matrix at every call; `None` for a side above 1; of a model in parts only the columns of the
    /// nodes here, by their numbers here.
    pub fn coupling_matrix(&self, side: usize) -> Option<CsMat<T>> {
        self.coupling.get(side).map(|c| c.matrix().expanded())
    }

    /// `S = Σ_m B_m diag(inverse_m) B_mᵀ` for given inverse inertias.
    pub(crate) fn operator_matrix(&self, inverse: [&[T]; 2]) -> CsMat<T> {
        let coupling = [0, 1].map(|m| Coupling {
            matrix: self.coupling[m].matrix().expanded(),
            shared: 1,
        });
        coupling::operator(&coupling, &inverse.map(<[T]>::to_vec))
    }

    /// Iterations that the last solve took; zero with a factor.
    pub fn iterations(&self) -> usize {
        self.iterations
    }

    /// What one solution for the multipliers is expected to take on so many ranks, by each solver that can
    /// be asked for; nothing of a lumped operator, and of interfaces that are solved for together but the
    /// first.
    pub fn solution_times(&self, ranks: usize) -> Vec<SolutionTime> {
        self.work.map_or_else(Vec::new, |w| w.on(ranks))
    }

    /// Mediator nodes \[m\].
    pub fn nodes(&self) -> &[Point3<T>] {
        &self.nodes
    }

    /// Vector components per multiplier node.
    pub fn components(&self) -> usize {
        self.components
    }

    /// Solves `S μ = B_C x_C − B_D x_D` and keeps `scale μ` with what it changes, `δ_C = −scale M_C⁻¹ B_Cᵀ
    /// μ`, `δ_D = scale M_D⁻¹ B_Dᵀ μ`. Nothing where others are solved for together with it.
    pub(crate) fn find(&mut self, x: [&[T]; 2], scale: T) {
        let Some(system) = &mut self.system else { return };
        let load = |sides: &mut [Transfer<T>]| sides.iter_mut().zip(x).for_each(|(c, x)| c.load(x));
        system.find(&mut self.coupling, &load, scale, &mut self.impulse);
        self.iterations = system.operator.iterations();
        self.tell();
    }

    /// Whether the last solve went wrong.
    ///
    /// # Errors
    /// [`Error::EigenvaluesBeyond`].
    pub(crate) fn check(&self) -> Result<()> {
        let system = self.system.as_ref();
        system.map_or(Ok(()), |s| s.operator.check(&self.report.name))
    }

    /// Whether the last solve was an iteration that ended before its tolerance; of those solved for
    /// together their joint knows.
    pub(crate) fn is_unsolved(&self) -> bool {
        self.system.as_ref().is_some_and(|s| s.operator.is_unsolved())
    }

    /// Whether a user gave its iterations limits that are not the usual ones: jumps of velocities are then
    /// what was asked for.
    pub(crate) fn is_cut_short(&self) -> bool {
        self.cut_short
    }

    /// Takes the impulses that were found together with others.
    fn take(&mut self, impulse: &[T], iterations: usize) {
        self.impulse.copy_from_slice(impulse);
        self.iterations = iterations;
        self.tell();
    }

    /// `λ` from the impulses.
    fn tell(&mut self) {
        for (l, m) in self.lambda.iter_mut().zip(&self.impulse) {
            *l = *m * self.rate;
        }
    }

    /// First half of the reflection `v ← (I − 2P) v`: finds what takes the jump out of the velocities,
    /// takes it out and keeps it for the second half, with which the next step begins.
    pub(crate) fn reflect(&mut self, v: [&mut [T]; 2]) {
        let [coarse, fine] = v;
        self.find([coarse, fine], T::one());
        self.coupling[0].kick(coarse);
        self.coupling[1].kick(fine);
    }

    /// Impulses `μ` of half a reflection; `λ = 2 μ/ΔT`.
    pub(crate) fn impulse(&self) -> &[T] {
        &self.impulse
    }

    /// Goes back to the impulses of another instant, and to what they change.
    pub(crate) fn restore(&mut self, impulse: &[T]) {
        self.take(impulse, 0);
        self.coupling.spread(impulse);
    }

    /// Takes multipliers that are known, those of an equilibrium.
    pub(crate) fn hold(&mut self, lambda: &[T]) {
        for (m, l) in self.impulse.iter_mut().zip(lambda) {
            *m = *l / self.rate;
        }
        self.lambda.copy_from_slice(lambda);
        self.coupling.spread(&self.impulse);
    }

    /// Sets the length of the steps between reflections \[s\], to which multipliers refer.
    pub(crate) fn pace(&mut self, step: T) {
        self.rate = T::of(2.0) / step;
    }

    /// `λᵀ(B_C v_C − B_D v_D)` \[W\] with the velocities that the last [`Self::reflect`] left: zero but for
    /// round-off where the multipliers are solved for exactly or by Galerkin's condition.
    pub(crate) fn power(&self) -> T {
        let left = self.system.as_ref().map_or_else(T::zero, System::left);
        self.rate * left
    }

    /// Largest of the jumps `B_C x_C − B_D x_D` at the multipliers, as vectors divided by the multiplier's
    /// own measure.
    pub(crate) fn jump(&mut self, x: [&[T]; 2], work: &mut Vec<T>) -> T {
        work.clear();
        work.resize(self.lambda.len(), T::zero());
        self.coupling.jump(Some(&x), work);
        let measured = work.chunks_exact(self.components).zip(&self.measures);
        let measured = measured.filter(|(_, s)| **s > T::zero());
        let size = |r: &[T]| r.iter().fold(T::zero(), |sum, r| sum + *r * *r).sqrt();
        measured.fold(T::zero(), |m, (r, s)| m.max(size(r) / *s))
    }
}
