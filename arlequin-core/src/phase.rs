//! What a step or a set-up is doing.

/// What a step is doing; announced so that an observer with a clock can tell where time goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Phase {
    /// Prediction and internal forces of a subdomain.
    Predict(usize),
    /// A model changes itself (subdomain); only where one does.
    Evolve(usize),
    /// Forces of an effect (subdomain, effect); only where there is one.
    Effect(usize, usize),
    /// Forces of an effect between two subdomains (its number); only where there is one.
    Pair(usize),
    /// Multiplier solve and correction.
    Interface,
    /// Energy ledger.
    Ledger,
    /// Observers.
    Observe,
}

/// What the set-up of a run is doing; announced so that a caller with a clock can tell where time goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum SetupPhase {
    /// Weighted inertia and stiffness, effects of a subdomain.
    Weights(usize),
    /// Whether the weights sum to one wherever a model is.
    Partition,
    /// Coupling matrices of an interface.
    Junction(usize),
    /// Its operator and the factor.
    Operator(usize),
    /// Critical steps, and the step that follows.
    Step,
    /// Initial state: displacements, velocities and accelerations that fit together.
    Start,
}
