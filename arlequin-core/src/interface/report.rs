//! Report of an interface's set-up.

use super::NullMode;

/// Results of an interface's set-up.
#[derive(Debug, Clone, PartialEq)]
pub struct InterfaceReport {
    /// Name of the interface.
    pub name: String,
    /// Name of the junction.
    pub junction: &'static str,
    /// Number of multiplier unknowns.
    pub multipliers: usize,
    /// Number of independent multipliers; all of them if the rank is not known (a warning says so).
    pub rank: usize,
    /// Solver in use: `factor`, `eigenvectors` or `pivoted factor` (dependent multipliers), `conjugate
    /// gradients` or `lumped`.
    pub solver: &'static str,
    /// Condition number of the operator, by power iteration. Without a factor: that of the non-zero modes of
    /// the operator scaled to a unit diagonal.
    pub condition: f64,
    /// True if `condition` is a lower bound: where iterations solve for more than 2 000 dependent multipliers
    /// per component, the smallest eigenvalue is only known from above.
    pub condition_at_least: bool,
    /// Measure of the overlap \[m³\].
    pub measure: f64,
    /// Numbers of nodes of the coarse and the fine model that multipliers act on.
    pub coupled_nodes: [usize; 2],
    /// Relative difference between the sides in the zeroth and first moments of the mediator.
    pub momentum_defect: f64,
    /// Number of stored entries of coupling matrices and solver.
    pub nonzeros: usize,
    /// Dropped combinations of multipliers.
    pub null_modes: Vec<NullMode>,
    /// Degree up to which the junction integrals are exact on each cell intersection; `None` for sums over
    /// particles.
    pub degree: Option<usize>,
    /// Share of the overlap that lies outside of the mediator, at its surface.
    pub outside: f64,
    /// Shares of the coarse and the fine model's overlap nodes on which multipliers act, by volume for
    /// particles and by number otherwise. Nodes that stick out of the other model are not tied.
    pub tied: [f64; 2],
    /// Largest jump of the initial displacements at a multiplier node that was projected away \[m\].
    pub start_jump: f64,
    /// Largest change of an initial displacement by that projection \[m\].
    pub start_moved: f64,
    /// Names of interfaces that share nodes with this one and are solved together with it.
    pub together: Vec<String>,
    /// Warnings for the user.
    pub warnings: Vec<String>,
}
