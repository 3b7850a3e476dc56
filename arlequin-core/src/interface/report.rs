//! What is known of an interface before the first step.

use super::NullMode;

/// What a Chebyshev iteration for multipliers damps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Damped {
    /// Lowest and highest eigenvalue of the operator, scaled to a diagonal of ones: all but zeros lie
    /// between them. Lower ones are only left out where the tolerance would take more iterations than are
    /// allowed.
    pub eigenvalues: [f64; 2],
    /// Iterations per solution; more are made where the lowest was too high.
    pub iterations: usize,
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
    /// How they are solved for: `factor`, `eigenvectors` (where multipliers are dependent), `conjugate
    /// gradients`, `chebyshev`, `lumped`.
    pub solver: &'static str,
    /// What a Chebyshev iteration damps; none of another solver.
    pub damped: Option<Damped>,
    /// Condition number of `A` (by power iteration; of the retained modes where some were dropped).
    pub condition: f64,
    /// Whether the condition is at least that: of more than 2 000 dependent multipliers per component the
    /// smallest eigenvalue is found from above only.
    pub condition_at_least: bool,
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
    /// Degree up to which the junction integrals are exact on each piece; none where they are sums over
    /// particles.
    pub degree: Option<usize>,
    /// Share of the overlap that lies outside the mediator, at its surface.
    pub outside: f64,
    /// Shares of the coarse and the fine model's nodes in the overlap on which multipliers act: by their
    /// volumes for particles, by their number otherwise. What sticks out of the other model is not tied.
    pub tied: [f64; 2],
    /// Jump of the initial displacements that was projected away \[m\], as the multipliers see it.
    pub start_jump: f64,
    /// Largest change of an initial displacement by that \[m\].
    pub start_moved: f64,
    /// Interfaces that act on nodes of this one and are solved for together with it.
    pub together: Vec<String>,
    /// What a user should know.
    pub warnings: Vec<String>,
}
