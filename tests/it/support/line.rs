//! Bar and chain of the acceptance checks.

use arlequin::core::Profile;
use arlequin_studies::line::Line;

/// Returns a short bar and chain.
pub(crate) fn short() -> Line {
    Line {
        coarse_elements: 20,
        fine_bonds: 120,
        overlap: 40.0,
        profile: Profile::Cubic,
        epsilon: 1e-6,
        ..Line::default()
    }
}
