//! Errors of the core: each names the object, the value, the limit and a way out.

mod model;

pub use crate::share::Share;
pub use model::ModelError;

use crate::ranks::RankError;

/// Errors of the core.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The user ended work that takes long, by Ctrl-C or SIGTERM.
    #[error("interrupted during {during}")]
    Interrupted {
        /// The work that was ended.
        during: String,
    },
    /// No equilibrium was reached.
    #[error(
        "no equilibrium at t = {time:e} s: after {steps} steps of relaxation the residual is {residual:.1e}, above {tolerance:.1e}; \
         allow more steps or a larger residual, take smaller load steps, or hold what can move freely{free}"
    )]
    NotSettled {
        /// Time of the loads \[s\].
        time: f64,
        /// Largest unbalanced force over the largest internal force.
        residual: f64,
        /// Limit.
        tolerance: f64,
        /// Steps made.
        steps: usize,
        /// Rigid motions that nothing holds, in words after a semicolon; empty if not known.
        free: String,
    },
    /// Communication between ranks failed.
    #[error(transparent)]
    Rank(#[from] RankError),
    /// A field was evaluated at a point outside of it.
    #[error("point ({:.6e}, {:.6e}, {:.6e}) m is outside the {role} field; trim the mediator to the overlap or extend the model", point[0], point[1], point[2])]
    OutsideDomain {
        /// The point \[m\].
        point: [f64; 3],
        /// Name of the field.
        role: String,
    },
    /// A field has no gradient, but the junction needs one.
    #[error(
        "the {role} field has no gradients, which the {junction} junction needs; use the L2 junction, projection sampling or another field"
    )]
    NoGradient {
        /// Name of the field.
        role: String,
        /// Name of the junction.
        junction: String,
    },
    /// A parameter has an invalid value.
    #[error("{name} = {value}: {rule}")]
    InvalidParameter {
        /// Name of the parameter.
        name: String,
        /// Value of the parameter.
        value: String,
        /// Rule that the value must satisfy.
        rule: String,
    },
    /// An option of an interface has an invalid value.
    #[error("interface '{interface}': {name} = {value}: {rule}")]
    InvalidOption {
        /// Name of the interface.
        interface: String,
        /// Name of the option.
        name: &'static str,
        /// Value of the option.
        value: String,
        /// Rule that the value must satisfy.
        rule: String,
    },
    /// A number is NaN or infinite.
    #[error("{what}: entry {index} is not a finite number; check the input that feeds it")]
    NotFinite {
        /// Name of the quantity.
        what: String,
        /// Index of the first entry that is not finite.
        index: usize,
    },
    /// A matrix that should be positive definite is not.
    #[error("matrix of size {size} is not positive definite at pivot {pivot}")]
    NotPositiveDefinite {
        /// Pivot at which the factorisation stopped.
        pivot: usize,
        /// Size of the matrix.
        size: usize,
    },
    /// A linear system has no accurate solution.
    #[error(
        "linear system of {size} unknowns is singular or too ill-conditioned (relative residual {residual:.1e}){free}; fix rigid motions, or coarsen the mediator"
    )]
    SingularSystem {
        /// Number of unknowns.
        size: usize,
        /// Relative residual reached, NaN where the factorisation failed.
        residual: f64,
        /// Rigid motions that no support holds, in words after a colon; empty if not known.
        free: String,
    },
    /// The mediator and a model share no volume.
    #[error(
        "interface '{interface}': the overlap of the mediator with model '{model}' is empty; place the mediator where both models are"
    )]
    EmptyOverlap {
        /// Name of the interface.
        interface: String,
        /// Name of the model.
        model: String,
    },
    /// The mediator sticks out of a model.
    #[error(
        "interface '{interface}': {outside:.3e} of the mediator's measure {total:.3e} lies outside model '{model}', which would leak momentum; shrink the mediator to the overlap"
    )]
    OverhangingMediator {
        /// Name of the interface.
        interface: String,
        /// Name of the model.
        model: String,
        /// Measure outside the model \[m³, or m for lines times section\].
        outside: f64,
        /// Measure of the mediator.
        total: f64,
    },
    /// Weights do not sum to one at a point.
    #[error(
        "model '{model}', at ({:.6e}, {:.6e}, {:.6e}) m: the weights of the {kind} of the models there sum to {sum:.6} ({present}), not to 1 within 1e-6; let both models fill the whole overlap, give the fine one the complement of the coarse one's weights, or, for a deliberate study, choose an unchecked partition", point[0], point[1], point[2]
    )]
    PartitionOfUnity {
        /// Model the point belongs to.
        model: String,
        /// The point \[m\].
        point: [f64; 3],
        /// Kind of the weights.
        kind: Share,
        /// Models at the point, with their weights.
        present: String,
        /// Sum of the weights.
        sum: f64,
    },
    /// Weights do not sum to one over too large a part of the overlap.
    #[error(
        "models '{models}': the weights of the {kind} are {:+.3} % off the overlap's measure in sum (limit {:.0} %), most of it at ({:.6e}, {:.6e}, {:.6e}) m; let the models fill the same space in the overlap and share it once, or, for a deliberate study, choose an unchecked partition", 100.0 * amount, 100.0 * limit, point[0], point[1], point[2]
    )]
    PartitionMeasure {
        /// Names of the models.
        models: String,
        /// Kind of the weights.
        kind: Share,
        /// Share of the overlap that is counted more than once, or (negative) not at all.
        amount: f64,
        /// Largest accepted share.
        limit: f64,
        /// Point of the largest deviation \[m\].
        point: [f64; 3],
    },
    /// One model fills more of the overlap than the other.
    #[error(
        "interface '{interface}': model '{larger}' fills {:.2} % of the overlap's measure more than model '{smaller}' (limit {:.0} %), which leaves weights unmatched there; let both end at the same borders, or, for a deliberate study, choose an unchecked partition", 100.0 * amount, 100.0 * limit
    )]
    UnequalShapes {
        /// Name of the interface.
        interface: String,
        /// The model that fills more.
        larger: String,
        /// The model that fills less.
        smaller: String,
        /// Difference relative to the overlap.
        amount: f64,
        /// Accepted difference.
        limit: f64,
    },
    /// A packing fills a part of the overlap more, or less, than the other model does.
    #[error(
        "interface '{interface}': around ({:.6e}, {:.6e}, {:.6e}) m, in a cube of {size:.3e} m, model '{larger}' fills {:.1} % more than model '{smaller}' (limit {:.0} %); let both fill the same space in the overlap, pack it evenly, or, for a deliberate study, choose an unchecked partition", point[0], point[1], point[2], 100.0 * amount, 100.0 * limit
    )]
    UnevenFilling {
        /// Name of the interface.
        interface: String,
        /// The model that fills more.
        larger: String,
        /// The model that fills less.
        smaller: String,
        /// Difference relative to what `larger` fills in the cube.
        amount: f64,
        /// Accepted difference.
        limit: f64,
        /// Centre of the cube \[m\].
        point: Box<[f64; 3]>,
        /// Edge of the cube \[m\].
        size: f64,
    },
    /// The mean of a weight over a cell is not the mean of the weight's values there.
    #[error(
        "model '{model}': the mean of its weight of the {kind} over the cell around ({:.6e}, {:.6e}, {:.6e}) m is {mean:.6}, but its values there have the mean {values:.6} (limit {limit:.1e} apart); mend Weight::mean, or leave it to its default", point[0], point[1], point[2]
    )]
    WeightMean {
        /// Model that the weight belongs to.
        model: String,
        /// Kind of the weight.
        kind: Share,
        /// Middle of the cell \[m\].
        point: Box<[f64; 3]>,
        /// Mean over the cell, as the weight returns it.
        mean: f64,
        /// Mean of the weight's values in the cell.
        values: f64,
        /// Accepted difference.
        limit: f64,
    },
    /// The internal energy of a model does not follow its weight.
    #[error(
        "model '{model}': with a weight of one half its internal energy is {ratio:.6} of that with a weight of one, not 0.5 within {limit:.0e}; let set_internal_weight multiply the stiffness of every cell by the mean of the weight over it"
    )]
    UnweightedEnergy {
        /// Name of the model.
        model: String,
        /// Energy with a weight of one half over that with one.
        ratio: f64,
        /// Accepted deviation from one half.
        limit: f64,
    },
    /// The weighted masses of all models do not add up to the mass of the body.
    #[error(
        "models '{models}': their weighted masses stand for {measure:.6e} m³ {:+.3} % of the overlap (limit {:.0} %); weigh mass by the means of the weights over cells and bonds, or, for a deliberate study, choose an unchecked partition", 100.0 * amount, 100.0 * limit
    )]
    PartitionMass {
        /// Names of the models.
        models: String,
        /// Deviation relative to the overlap's measure.
        amount: f64,
        /// Measure that the models fill together.
        measure: f64,
        /// Accepted deviation.
        limit: f64,
    },
    /// The mediator leaves a part of the overlap untied.
    #[error(
        "interface '{interface}': {:.1} % of the overlap lies outside the mediator, such as ({:.6e}, {:.6e}, {:.6e}) m, more than half an element beyond it for more than {:.0} %; both models share their energy there but nothing ties them: let the mediator fill the overlap", 100.0 * outside, point[0], point[1], point[2], 100.0 * limit
    )]
    UncoveredOverlap {
        /// Name of the interface.
        interface: String,
        /// Share of the overlap outside of the mediator.
        outside: f64,
        /// A point of the overlap outside of the mediator \[m\].
        point: [f64; 3],
        /// Accepted share that lies more than half a mediator element away.
        limit: f64,
    },
    /// The initial displacements of two models differ.
    #[error(
        "interface '{interface}': the initial displacements differ by {jump:.3e} m across the overlap, {:.1} % of the largest one ({largest:.3e} m, limit {:.0} %); give both models the same initial displacement there", 100.0 * jump / largest, 100.0 * limit
    )]
    InitialJump {
        /// Name of the interface.
        interface: String,
        /// Largest difference, as the multipliers see it \[m\].
        jump: f64,
        /// Largest initial displacement of the two models \[m\].
        largest: f64,
        /// Accepted jump relative to `largest`.
        limit: f64,
    },
    /// The cells of a field cover the mediator more than once.
    #[error(
        "interface '{interface}': the cells of model '{model}' cover {covered:.6e} of the mediator's measure {total:.6e}: they overlap each other; mend the mesh"
    )]
    CoveredTwice {
        /// Name of the interface.
        interface: String,
        /// Name of the model.
        model: String,
        /// Measure covered.
        covered: f64,
        /// Measure of the mediator.
        total: f64,
    },
    /// The two sides sample the mediator differently, so that action and reaction differ.
    #[error(
        "interface '{interface}': the two sides integrate the mediator functions differently (relative defect {defect:.2e} > {limit:.0e}), which leaks momentum; use intersection or projection sampling on both sides"
    )]
    MomentumLeak {
        /// Name of the interface.
        interface: String,
        /// Largest relative difference of zeroth and first moments.
        defect: f64,
        /// Accepted difference.
        limit: f64,
    },
    /// The multiplier operator cannot be factored even after null modes are dropped.
    #[error(
        "interface '{interface}': no multiplier of {size} is independent; the overlap holds no free unknown"
    )]
    SingularInterface {
        /// Name of the interface.
        interface: String,
        /// Number of multiplier unknowns.
        size: usize,
    },
    /// Prescribed motions move two tied models differently at one place.
    #[error(
        "interface '{interface}': at ({:.6e}, {:.6e}, {:.6e}) m models {models} are moved along {component} by prescribed motions that differ by {gap:.3e} m at t = {time:.3e} s; give both the same motion, or move one of them by its own region only", point[0], point[1], point[2]
    )]
    OpposedMotions {
        /// Name of the interface.
        interface: String,
        /// The two models, as "'a' and 'b'".
        models: String,
        /// Position \[m\].
        point: Box<[f64; 3]>,
        /// Component of the motion.
        component: char,
        /// Largest difference \[m\].
        gap: f64,
        /// Time \[s\].
        time: f64,
    },
    /// A node has no weighted mass.
    #[error("model '{model}': node {node} at ({:.6e}, {:.6e}, {:.6e}) m has weighted mass {mass:e} kg; the weights leave it nothing: trim the model to its subdomain, choose epsilon > 0, or remove an overlap that is listed twice", point[0], point[1], point[2])]
    ZeroMass {
        /// Name of the model.
        model: String,
        /// Node index.
        node: usize,
        /// Position of the node \[m\].
        point: [f64; 3],
        /// Weighted mass of the node \[kg\].
        mass: f64,
    },
    /// The time step is not stable.
    #[error(
        "time step {dt:e} s exceeds the critical step {critical:e} s of model '{model}', which makes {steps} own steps in a step of \
         the run; reduce it to at most {critical:e} s: by a step of the run of at most {longest:e} s, or by at least {needed} own steps"
    )]
    UnstableStep {
        /// Step of the model \[s\].
        dt: f64,
        /// Critical step of the model \[s\].
        critical: f64,
        /// The model that exceeds its critical step most.
        model: String,
        /// Own steps of the model in a step of the run.
        steps: usize,
        /// Longest stable step of the run with this number of own steps \[s\].
        longest: f64,
        /// Least number of own steps that is stable.
        needed: usize,
    },
    /// The run diverged.
    #[error(
        "step {step} (t = {time:e} s): {what} of model '{model}' is no longer finite; reduce the step or check loads and supports"
    )]
    Diverged {
        /// Step number.
        step: usize,
        /// Time \[s\].
        time: f64,
        /// Quantity that is not finite.
        what: &'static str,
        /// Name of the model.
        model: String,
    },
    /// The balance shows energy that nothing supplied.
    #[error(
        "step {step} (t = {time:e} s): the energy balance is off by {excess:.3e} J, more than {bound:.3e} J ({percent:.1} % of the energy in play); reduce the step, or use energy-consistent weighting"
    )]
    EnergyGrowth {
        /// Step number.
        step: usize,
        /// Time \[s\].
        time: f64,
        /// Unexplained energy \[J\].
        excess: f64,
        /// Accepted bound \[J\].
        bound: f64,
        /// The bound in per cent of the energy in play.
        percent: f64,
    },
    /// The balance lacks energy that no effect took.
    #[error(
        "step {step} (t = {time:e} s): {missing:.3e} J are missing from the energy balance that no effect took, more than {bound:.3e} J \
         ({percent:.1} % of the largest energy so far); {suspect}"
    )]
    EnergyLoss {
        /// Step number.
        step: usize,
        /// Time \[s\].
        time: f64,
        /// Missing energy \[J\].
        missing: f64,
        /// Accepted bound \[J\].
        bound: f64,
        /// The bound in per cent of the largest energy so far.
        percent: f64,
        /// Possible cause and remedy, in words.
        suspect: String,
    },
    /// The velocities of a solver do not follow the impulses it is given.
    #[error(
        "step {step}: model '{model}' was given impulses, and its velocities then differ from what they should be by {:.1} % of them \
         (limit {:.0} %); let kick change velocities by impulse over the inertia that it told", 100.0 * share, 100.0 * limit
    )]
    ImpulseMissed {
        /// Name of the model.
        model: String,
        /// Step number.
        step: usize,
        /// Missing or excess momentum, relative to the impulses.
        share: f64,
        /// Largest accepted share.
        limit: f64,
    },
    /// The iteration for the multipliers misses its tolerance, and the models are hardly coupled.
    #[error(
        "interface '{interface}', step {step}: after {iterations} iterations for the multipliers velocities of the two models still \
         differ by {:.1} % of the largest velocity (limit {:.0} %): its multipliers are dependent or close to it; coarsen the \
         mediator until it is no finer than the models", 100.0 * share, 100.0 * limit
    )]
    MultipliersUnsolved {
        /// Name of the interface.
        interface: String,
        /// Step number; zero for the start.
        step: usize,
        /// Number of iterations.
        iterations: usize,
        /// Largest jump of velocity relative to the largest velocity so far.
        share: f64,
        /// Largest accepted share.
        limit: f64,
    },
    /// A solver is not the one of the checkpoint, or its restore does not bring back what its save returned.
    #[error(
        "model '{model}': its {what} {place} is {found:e} and was {saved:e} when the checkpoint was written: it is another solver, or \
         its restore does not bring back what its save returned; resume with the solver that was saved, or start the run anew"
    )]
    NotRestored {
        /// Name of the model.
        model: String,
        /// Quantity, in words that a number follows.
        what: &'static str,
        /// Number of the unknown or of the axis, which follows the words.
        place: usize,
        /// Value that the solver reports.
        found: f64,
        /// Value that the solver reported when it was saved.
        saved: f64,
    },
    /// A model cannot do what is asked.
    #[error("model '{model}' cannot {what}")]
    Unsupported {
        /// Name of the model.
        model: String,
        /// The missing ability, in words after "cannot".
        what: String,
    },
    /// Two sizes that must agree do not.
    #[error("{what}: expected {expected}, found {found}")]
    SizeMismatch {
        /// Compared quantity.
        what: String,
        /// Expected size.
        expected: usize,
        /// Actual size.
        found: usize,
    },
    /// An error of a model implemented outside the core.
    #[error("model '{model}': {source}")]
    Model {
        /// Name of the model.
        model: String,
        /// The model's own error.
        source: ModelError,
    },
}

/// Result of the core's operations.
pub type Result<V, E = Error> = std::result::Result<V, E>;

/// Shorthand for [`Error::InvalidParameter`].
pub fn invalid(name: &str, value: impl std::fmt::Display, rule: &str) -> Error {
    Error::InvalidParameter {
        name: name.to_owned(),
        value: value.to_string(),
        rule: rule.to_owned(),
    }
}

/// Shorthand for [`Error::InvalidOption`].
pub(crate) fn invalid_option(interface: &str, name: &'static str, value: &str, rule: &str) -> Error {
    Error::InvalidOption {
        interface: interface.to_owned(),
        name,
        value: value.to_owned(),
        rule: rule.to_owned(),
    }
}

/// Returns the value if it is finite and not below zero.
///
/// # Errors
/// [`Error::InvalidParameter`] otherwise.
pub fn not_negative<T: crate::Real>(name: &str, value: T) -> Result<T> {
    if value.is_finite() && value >= T::zero() {
        return Ok(value);
    }
    Err(invalid(name, value, "must be finite and not negative"))
}
