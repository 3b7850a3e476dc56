//! Errors of the core: each names the object, the value, the limit and a way out.

/// What can go wrong in the core.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A point at which a field was asked for lies outside of it.
    #[error("point ({:.6e}, {:.6e}, {:.6e}) m is outside the {role} field; trim the mediator to the overlap or extend the model", point[0], point[1], point[2])]
    OutsideDomain {
        /// The point \[m\].
        point: [f64; 3],
        /// Which field.
        role: String,
    },
    /// A field has no gradient, but the junction needs one.
    #[error(
        "the {role} field has no gradients, which the {junction} junction needs; use the L2 junction, projection sampling or another field"
    )]
    NoGradient {
        /// Which field.
        role: String,
        /// Name of the junction.
        junction: String,
    },
    /// Something exists in 64-bit numbers only.
    #[error("{what} cannot step in 32-bit numbers: {why}; run in double precision, or leave it out")]
    DoubleOnly {
        /// What it is.
        what: String,
        /// Why not.
        why: &'static str,
    },
    /// A parameter has a value that makes no sense.
    #[error("{name} = {value}: {rule}")]
    InvalidParameter {
        /// Name of the parameter.
        name: String,
        /// Its value.
        value: String,
        /// What it must satisfy.
        rule: String,
    },
    /// A number is NaN or infinite.
    #[error("{what}: entry {index} is not a finite number; check the input that feeds it")]
    NotFinite {
        /// Which quantity.
        what: String,
        /// Index of the first such entry.
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
        "linear system of {size} unknowns is singular or too ill-conditioned (relative residual {residual:.1e}); fix rigid motions, or coarsen the mediator"
    )]
    SingularSystem {
        /// Number of unknowns.
        size: usize,
        /// Relative residual reached, NaN where the factorisation failed.
        residual: f64,
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
    /// The rank-revealing fallback is too large to be run densely.
    #[error(
        "interface '{interface}': {size} dependent multiplier unknowns are too many for the rank-revealing factorisation (limit {limit}); coarsen the mediator"
    )]
    RankTooLarge {
        /// Name of the interface.
        interface: String,
        /// Number of multiplier unknowns.
        size: usize,
        /// Largest size accepted.
        limit: usize,
    },
    /// Two interfaces act on one node.
    #[error(
        "interfaces '{first}' and '{second}' share node {node} of model '{model}'; move them apart or join them into one mediator"
    )]
    SharedNode {
        /// First interface.
        first: String,
        /// Second interface.
        second: String,
        /// Model that owns the node.
        model: String,
        /// Node index.
        node: usize,
    },
    /// Two models that are tied are moved in different ways at one place.
    #[error(
        "interface '{interface}': at ({:.6e}, {:.6e}, {:.6e}) m models {models} are moved along {component} by prescribed motions that differ by {gap:.3e} m at t = {time:.3e} s; give both the same motion, or move one of them by its own region only", point[0], point[1], point[2]
    )]
    OpposedMotions {
        /// Name of the interface.
        interface: String,
        /// The models, as "'a' and 'b'".
        models: String,
        /// Where \[m\].
        point: Box<[f64; 3]>,
        /// Which component.
        component: char,
        /// Largest difference \[m\].
        gap: f64,
        /// When \[s\].
        time: f64,
    },
    /// A node has no weighted mass.
    #[error("model '{model}': node {node} at ({:.6e}, {:.6e}, {:.6e}) m has weighted mass {mass:e} kg; the weights leave it nothing: trim the model to its subdomain, choose epsilon > 0, or remove an overlap that is listed twice", point[0], point[1], point[2])]
    ZeroMass {
        /// Name of the model.
        model: String,
        /// Node index.
        node: usize,
        /// Its position \[m\].
        point: [f64; 3],
        /// Its mass \[kg\].
        mass: f64,
    },
    /// The time step is not stable.
    #[error(
        "time step {dt:e} s exceeds the critical step {critical:e} s of model '{model}'; reduce it to at most {critical:e} s"
    )]
    UnstableStep {
        /// Chosen step \[s\].
        dt: f64,
        /// Largest stable step \[s\].
        critical: f64,
        /// Model with the smallest critical step.
        model: String,
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
        /// Quantity.
        what: &'static str,
        /// Model.
        model: String,
    },
    /// Energy appears from nowhere.
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
    /// A model cannot do what is asked.
    #[error("model '{model}' cannot {what}")]
    Unsupported {
        /// Name of the model.
        model: String,
        /// The missing ability.
        what: String,
    },
    /// Sizes of two objects that must agree do not.
    #[error("{what}: expected {expected}, found {found}")]
    SizeMismatch {
        /// What was compared.
        what: String,
        /// Expected size.
        expected: usize,
        /// Actual size.
        found: usize,
    },
    /// An error of a model implemented outside the core.
    #[error("model '{model}': {message}")]
    Model {
        /// Name of the model.
        model: String,
        /// Its own message.
        message: String,
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
