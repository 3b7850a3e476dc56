//! Settings that tests of strength and of toughness share. Both run from a static solution until a body
//! breaks.

use arlequin_core::Coupled;

/// Elongation at the start of the run, over that at the first broken bond.
pub(crate) const START: f64 = 0.9;
/// Elongation at which the run gives up, over that at the first broken bond.
pub(crate) const GIVEN_UP: f64 = 12.0;
/// Density \[kg/m³\]. Times scale with its root, and the ratios that the tests measure do not depend on it.
pub(crate) const DENSITY: f64 = 1000.0;
/// Largest residual and number of iterations of the static solution.
pub(crate) const SOLVE: (f64, usize) = (1e-6, 50_000);

/// Returns the work of the moved supports so far \[J\].
pub(crate) fn support_work(run: &Coupled<f64>) -> f64 {
    let works = run.works();
    works
        .iter()
        .find(|w| w.name == "supports")
        .map_or(0.0, |w| w.work)
}
