//! What a step is doing.

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
