//! Phases of a step and of a set-up.

/// Phase of a step; announced so that an observer with a clock can measure where time goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Phase {
    /// Prediction and internal forces of a subdomain.
    Predict(usize),
    /// Change of a model by itself (subdomain); only where there is one.
    Evolve(usize),
    /// Forces of an effect (subdomain, effect); only where there is one.
    Effect(usize, usize),
    /// Forces of an effect between two subdomains (its number); only where there is one.
    Pair(usize),
    /// Multiplier solve and correction.
    Interface,
    /// Equilibrium of a load step, see [`crate::Coupled::settle`]; announced by the caller.
    Equilibrium,
    /// Change of weights, see [`crate::Coupled::rezone`], and what decides on it; announced by the caller.
    Rezone,
    /// Energy ledger.
    Ledger,
    /// Observers.
    Observe,
}

/// Phase of the set-up of a run; announced so that a caller with a clock can measure where time goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum SetupPhase {
    /// Weighted inertia and stiffness, effects of a subdomain.
    Weights(usize),
    /// Check that the weights sum to one wherever a model is.
    Partition,
    /// Coupling matrices of an interface.
    Junction(usize),
    /// Operator of an interface, and its factor.
    Operator(usize),
    /// Effects between two subdomains: the number of the pair.
    Pair(usize),
    /// Critical steps, and the time step chosen from them.
    Step,
    /// Initial state: consistent displacements, velocities and accelerations.
    Start,
}
