//! Position of closed shells with respect to each other.

use super::surface::winding;
use arlequin_core::geometry::closest_on_triangle;
use nalgebra::Vector3;

/// Largest number of points of a shell that are tested. A few are enough: of shells that do not cross, all
/// points of one lie on the same side of the other.
const TESTED_POINTS: usize = 64;
/// Points up to this distance from a shell, relative to its extent, lie on it and are skipped: round-off
/// decides their winding number. Bodies may touch.
const ON_SHELL: f64 = 1e-9;

/// Position of a shell with respect to another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Place {
    /// Inside of the other; the two may touch.
    Inside,
    /// Beside or around the other; the two may touch, or coincide.
    Outside,
    /// On both sides of the other; with a point inside \[m\].
    Crossing(Vector3<f64>),
}

/// Returns where the shell `tested` lies with respect to `shell`, whose triangles face outwards.
pub(crate) fn place(tested: &[[Vector3<f64>; 3]], shell: &[[Vector3<f64>; 3]]) -> Place {
    let corners = || shell.iter().flatten();
    let low = corners().fold(Vector3::repeat(f64::INFINITY), |a, x| a.inf(x));
    let high = corners().fold(Vector3::repeat(f64::NEG_INFINITY), |a, x| a.sup(x));
    let reach = ON_SHELL * (high - low).max();
    let (mut inner_point, mut has_outer_point) = (None, false);
    let points = tested
        .iter()
        .flat_map(|[a, b, c]| [*a, (a + b + c) / 3.0])
        .step_by((2 * tested.len()).div_ceil(TESTED_POINTS).max(1));
    for x in points {
        if (0..3).any(|k| x[k] < low[k] - reach || x[k] > high[k] + reach) {
            has_outer_point = true;
            continue;
        }
        let is_on_shell = |t: &[Vector3<f64>; 3]| (closest_on_triangle(&x, t) - x).norm() <= reach;
        if shell.iter().any(is_on_shell) {
            continue;
        }
        if winding(&x, shell.iter().copied()) > 0.5 {
            inner_point = Some(x);
        } else {
            has_outer_point = true;
        }
    }
    match (inner_point, has_outer_point) {
        (Some(x), true) => Place::Crossing(x),
        (Some(_), false) => Place::Inside,
        (None, _) => Place::Outside,
    }
}
