//! Interface between two models: coupling matrices, multiplier operator and velocity correction, for any
//! pair.
//!
//! `B_m` is the multiplier-by-unknown matrix of side `m`. Only `B_m` is stored and `C_m = B_mᵀ`, so that the
//! two are adjoint by construction:
//!
//! ```text
//! constraint   B_C u̇ − B_D ḋ = 0
//! operator     S = B_C M_C⁻¹ B_Cᵀ + B_D M_D⁻¹ B_Dᵀ
//! projection   S μ = B_C u̇* − B_D ḋ*,   u̇ = u̇* − M_C⁻¹ B_Cᵀ μ,   ḋ = ḋ* + M_D⁻¹ B_Dᵀ μ,   λ = 2 μ/ΔT
//! ```
//!
//! Velocities at the end of a macro step are the projected ones. The next step begins by adding the same
//! change a second time, which makes the two a reflection. `S` does not depend on the step: it is factored
//! once.

mod advice;
mod assembly;
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
mod selected;
mod selection;
mod sides;
mod solver;
mod sums;
mod system;
mod transfer;

pub use assembly::Sampling;
pub use cost::SolutionTime;
pub(crate) use coupling::Coupling;
pub use rank::NullMode;
pub use report::InterfaceReport;
pub use solver::Solver;

use crate::Owned;
use crate::field::Interpolation;
use crate::junction::{Components, Junction, Needs};
use crate::mediator::Mediator;
use crate::model::DofLayout;
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
pub(crate) use transfer::{Rows, coupled_nodes};

/// Tie between a coarse and a fine subdomain.
pub struct InterfaceSpec<T: Real> {
    /// Name for messages and reports.
    pub name: String,
    /// Index of the coarse subdomain.
    pub coarse: usize,
    /// Index of the fine subdomain.
    pub fine: usize,
    /// Multiplier space.
    pub mediator: Arc<dyn Mediator<T>>,
    /// Scalar product in which the jump vanishes.
    pub junction: Box<dyn Junction<T>>,
    /// Sampling, solver and tolerances.
    pub options: InterfaceOptions<T>,
}

impl<T: Real> InterfaceSpec<T> {
    /// Returns a tie between the subdomains with these indices, with the default options.
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

    /// Returns how many displacement components share one scalar coupling matrix: all or 1.
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

/// Options of an interface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InterfaceOptions<T: Real> {
    /// Sampling of the junction integrals.
    pub sampling: Sampling,
    /// Solver for the multipliers.
    pub solver: Solver<T>,
    /// If true, the multiplier operator is lumped to its row sums (L2 only). The constraint then holds only
    /// in the mean.
    pub lumped: bool,
    /// Eigenvalues of the scaled operator below this share of the largest count as zero.
    pub rank_tolerance: T,
    /// Largest jump of the initial displacements that is projected away, relative to the largest initial
    /// displacement. Above it the run is refused. Default 0.1: linear interpolation of a wave on eight
    /// elements errs by 7.7 % of its amplitude, so two meshes of one smooth field differ by less.
    pub start_jump: T,
    /// Point at which the models are pinned together, used by a seminorm only. `None` takes the first
    /// mediator node.
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

/// Data of one model that an interface reads.
#[derive(Clone, Copy)]
pub struct Side<'a, T: Real> {
    /// Name of the model.
    pub name: &'a str,
    /// Displacement field of the model in the overlap.
    pub field: &'a dyn Interpolation<T>,
    /// Arrangement of the unknowns.
    pub layout: DofLayout,
    /// Inverse weighted inertia of each unknown; zero where motion is prescribed.
    pub inverse_inertia: &'a [T],
    /// Weighted inertia of each unknown, zero where a node sleeps; `None` if no node of the model may sleep.
    pub sleeping: Option<&'a [T]>,
    /// Weight `β` of the model, between zero and one in the overlap.
    pub weight: &'a dyn Weight<T>,
}

impl<T: Real> std::fmt::Debug for Side<'_, T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Side of {}", self.name)
    }
}

/// Interface between a coarse and a fine subdomain, with its operator ready to be solved with.
#[derive(Debug)]
pub struct Interface<T: Real> {
    /// Indices of the coarse and the fine subdomain.
    pub(crate) sides: [usize; 2],
    /// Coupling matrices of the coarse and the fine side.
    pub(crate) coupling: Sides<T>,
    /// `None` if the multipliers are solved for together with those of other interfaces ([`joint::Joint`]).
    system: Option<System<T>>,
    iterations: usize,
    lambda: Vec<T>,
    /// `μ` of half a reflection.
    impulse: Vec<T>,
    /// `λ = rate μ`.
    rate: T,
    /// Measure of each multiplier node, from the coarse side: a constraint residual over it is a velocity.
    measures: Vec<T>,
    pub(crate) report: InterfaceReport,
    pub(crate) start_jump: T,
    /// True if the user limited the iterations to other than the default tolerance and number.
    cut_short: bool,
    components: usize,
    nodes: Vec<Point3<T>>,
    /// Cost of a solve, for predictions. Of jointly solved interfaces only the first has it; `None` if
    /// lumped.
    work: Option<Work>,
}

/// Interface with coupling matrices but without a solver.
#[derive(Debug)]
pub(crate) struct Draft<T: Real> {
    pub(crate) interface: Interface<T>,
    /// Coupling matrices of the coarse and the fine side.
    coupling: Vec<Coupling<T>>,
}

impl<T: Real> Draft<T> {
    /// Assembles the coupling matrices of a mediator between two sides, coarse first.
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
        spec.options.solver.check(&spec.name)?;
        let built = assembly::assemble(spec, &sides, components)?;
        let shared = built.coupling[0].shared;
        let size = built.coupling[0].matrix.rows() * shared;
        // A positive multiplier slows the coarse model down and speeds the fine one up.
        let signs = [-T::one(), T::one()];
        let coupling =
            [0, 1].map(|m| Transfer::new(&built.coupling[m], components, signs[m], sides[m].inverse_inertia));
        let mut report = InterfaceReport {
            name: spec.name.clone(),
            junction: spec.junction.name(),
            multipliers: size,
            rank: size,
            solver: "",
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
        report
            .warnings
            .extend(advice::side_warnings(&report, spec, &sides));
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

    /// Makes an interface that is solved for on its own. `inverse`: inverse inertias of the two sides.
    pub(crate) fn alone(self, spec: &InterfaceSpec<T>, inverse: [&[T]; 2]) -> Result<Interface<T>> {
        let mut out = self.interface;
        let wanted = Wanted {
            name: &spec.name,
            options: &spec.options,
        };
        let system = System::new(wanted, &self.coupling, &inverse, out.components)?;
        out.report_operator(&system.operator, 0..out.lambda.len(), Vec::new());
        out.system = Some(system);
        Ok(out)
    }
}

impl<T: Real> Interface<T> {
    /// Returns whether each component of a multiplier acts on the same component of displacements only.
    pub(crate) fn splits(&self) -> bool {
        self.components == 1 || self.coupling[0].shared() == self.components
    }

    /// Restricts the coupling matrices to this rank's part of each partitioned model.
    pub(crate) fn restrict(&mut self, owned: [&Owned; 2]) {
        self.coupling.restrict(&owned);
        if let (Some(system), Some(parts)) = (&mut self.system, self.coupling.parts()) {
            system.partition_among(parts);
        }
    }

    /// Returns whether the multipliers are solved for without those of other interfaces.
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

    /// Copies rank, solver, condition and warnings of an operator into the report. `multipliers`: range of
    /// this interface among the operator's multipliers. `together`: names of the other interfaces that the
    /// operator solves for.
    fn report_operator(&mut self, operator: &Operator<T>, multipliers: Range<usize>, together: Vec<String>) {
        let nodes = multipliers.start / self.components..multipliers.end / self.components;
        let own_modes = operator.null_modes.iter().filter(|n| nodes.contains(&n.node));
        let report = &mut self.report;
        report.null_modes = own_modes
            .map(|n| NullMode {
                node: n.node - nodes.start,
                ..n.clone()
            })
            .collect();
        report.rank = report.multipliers - report.null_modes.len();
        report.solver = operator.solver;
        report.condition = operator.condition.as_f64();
        report.condition_at_least = operator.at_least;
        // Joint interfaces share one factor: only the first of them counts it.
        if multipliers.start == 0 {
            report.nonzeros += operator.nonzeros();
            let solves = report.multipliers > 0 && operator.solver != "lumped";
            self.work = solves.then_some(operator.work);
        }
        report.together = together;
        let dependence = advice::rank_warnings(report, operator.ranked);
        report.warnings.extend(dependence);
    }

    /// Returns what the set-up found: sizes, rank, solver, condition and warnings.
    pub fn report(&self) -> &InterfaceReport {
        &self.report
    }

    /// Returns the indices of the coarse and the fine subdomain.
    pub fn sides(&self) -> [usize; 2] {
        self.sides
    }

    /// Returns the multipliers of the last correction, components interleaved \[N/m³ for L2\].
    pub fn multipliers(&self) -> &[T] {
        &self.lambda
    }

    /// Returns `B_C` (side 0) or `B_D` (side 1): multiplier unknowns by displacement unknowns of that model,
    /// components interleaved \[m³ for L2\]; `None` for a side above 1. The constraint is
    /// `B_C u̇ − B_D ḋ = 0`. Every call expands the stored matrix. Of a partitioned model there are only the
    /// columns of the nodes that this rank owns, by their local numbers.
    pub fn coupling_matrix(&self, side: usize) -> Option<CsMat<T>> {
        self.coupling.get(side).map(|c| c.matrix().expanded())
    }

    /// Returns `S = Σ_m B_m diag(inverse_m) B_mᵀ` for given inverse inertias.
    pub(crate) fn operator_matrix(&self, inverse: [&[T]; 2]) -> CsMat<T> {
        let coupling = [0, 1].map(|m| Coupling {
            matrix: self.coupling[m].matrix().expanded(),
            shared: 1,
        });
        coupling::operator(&coupling, &inverse.map(<[T]>::to_vec))
    }

    /// Returns the number of iterations of the last solve; zero with a factor.
    pub fn iterations(&self) -> usize {
        self.iterations
    }

    /// Returns the expected duration of one multiplier solve on `ranks` ranks for each solver that a user can
    /// choose. Empty for a lumped operator and for all but the first of jointly solved interfaces.
    pub fn solution_times(&self, ranks: usize) -> Vec<SolutionTime> {
        self.work.map_or_else(Vec::new, |w| w.on(ranks))
    }

    /// Returns the mediator nodes \[m\].
    pub fn nodes(&self) -> &[Point3<T>] {
        &self.nodes
    }

    /// Returns the number of vector components per multiplier node.
    pub fn components(&self) -> usize {
        self.components
    }

    /// Solves `S μ = B_C x_C − B_D x_D`. Keeps `scale μ` and the changes `δ_C = −scale M_C⁻¹ B_Cᵀ μ` and
    /// `δ_D = scale M_D⁻¹ B_Dᵀ μ`. Does nothing if the interface belongs to a [`joint::Joint`].
    pub(crate) fn find(&mut self, x: [&[T]; 2], scale: T) {
        let Some(system) = &mut self.system else { return };
        let load = |sides: &mut [Transfer<T>]| sides.iter_mut().zip(x).for_each(|(c, x)| c.load(x));
        system.find(&mut self.coupling, &load, scale, &mut self.impulse);
        self.iterations = system.operator.iterations();
        self.update_multipliers();
    }

    /// Returns whether the last solve was an iteration that ended above its tolerance. Always false for a
    /// member of a [`joint::Joint`], which answers itself.
    pub(crate) fn is_unsolved(&self) -> bool {
        self.system.as_ref().is_some_and(|s| s.operator.is_unsolved())
    }

    /// Returns whether the user limited the iterations, so that velocity jumps are expected and not warned
    /// about.
    pub(crate) fn is_cut_short(&self) -> bool {
        self.cut_short
    }

    /// Keeps the impulses that a joint solve found.
    fn take(&mut self, impulse: &[T], iterations: usize) {
        self.impulse.copy_from_slice(impulse);
        self.iterations = iterations;
        self.update_multipliers();
    }

    /// Sets `λ` from the impulses.
    fn update_multipliers(&mut self) {
        for (l, m) in self.lambda.iter_mut().zip(&self.impulse) {
            *l = *m * self.rate;
        }
    }

    /// First half of the reflection `v ← (I − 2P) v`: computes the change that removes the velocity jump,
    /// adds it to `v` and keeps it. The second half, at the start of the next step, adds it again.
    pub(crate) fn reflect(&mut self, v: [&mut [T]; 2]) {
        let [coarse, fine] = v;
        self.find([coarse, fine], T::one());
        self.coupling[0].kick(coarse);
        self.coupling[1].kick(fine);
    }

    /// Returns the impulses `μ` of half a reflection; `λ = 2 μ/ΔT`.
    pub(crate) fn impulse(&self) -> &[T] {
        &self.impulse
    }

    /// Restores the impulses of another instant and the velocity changes that follow from them.
    pub(crate) fn restore(&mut self, impulse: &[T]) {
        self.take(impulse, 0);
        self.coupling.spread(impulse);
    }

    /// Sets the multipliers to known values, such as those of a static equilibrium.
    pub(crate) fn hold(&mut self, lambda: &[T]) {
        for (m, l) in self.impulse.iter_mut().zip(lambda) {
            *m = *l / self.rate;
        }
        self.lambda.copy_from_slice(lambda);
        self.coupling.spread(&self.impulse);
    }

    /// Sets the duration of the macro steps \[s\], which relates multipliers to impulses.
    pub(crate) fn pace(&mut self, step: T) {
        self.rate = T::of(2.0) / step;
    }

    /// Returns the power `λᵀ(B_C v_C − B_D v_D)` \[W\] with the velocities after the last [`Self::reflect`].
    /// It is zero but for round-off if the multipliers are solved for exactly or fulfil Galerkin's condition.
    pub(crate) fn power(&self) -> T {
        let work = self.system.as_ref().map_or_else(T::zero, System::residual_work);
        self.rate * work
    }

    /// Returns the largest jump `B_C x_C − B_D x_D`: the norm over the components of a multiplier node,
    /// divided by the measure of that node.
    pub(crate) fn jump(&mut self, x: [&[T]; 2], work: &mut Vec<T>) -> T {
        work.clear();
        work.resize(self.lambda.len(), T::zero());
        self.coupling.jump(Some(&x), work);
        let measured = work.chunks_exact(self.components).zip(&self.measures);
        // A multiplier node without coupled coarse nodes has no measure.
        let measured = measured.filter(|(_, s)| **s > T::zero());
        let size = |r: &[T]| r.iter().fold(T::zero(), |sum, r| sum + *r * *r).sqrt();
        measured.fold(T::zero(), |m, (r, s)| m.max(size(r) / *s))
    }
}
