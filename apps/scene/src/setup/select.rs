//! Selections of nodes and surface facets, by group or box.

use super::body::Body;
use crate::error::{Result, key, unknown};
use crate::spec::Selection;
use arlequin::core::effect::SurfaceFacet;
use arlequin::core::nalgebra::Point3;
use std::collections::BTreeMap;

/// Distance \[m\] by which a node outside of a box still counts as inside, for a body with this spacing
/// \[m\]. It exceeds the rounding of coordinates in files and is negligible beside an element, independent of
/// the position of the body and the size of the box.
pub(super) fn slack(spacing: f64) -> f64 {
    1e-6 * spacing
}

/// Returns whether a point lies in a closed box, with a tolerance `slack` \[m\] and the round-off of the
/// point's coordinates.
pub(super) fn inside(low: &[f64; 3], high: &[f64; 3], x: &Point3<f64>, slack: f64) -> bool {
    (0..3).all(|c| {
        let slack = slack + 4.0 * f64::EPSILON * x[c].abs();
        x[c] >= low[c] - slack && x[c] <= high[c] + slack
    })
}

/// Names of groups that a user gave; group names with a bracket are generated for boxes.
pub(super) fn named<'a, T: 'a>(groups: &'a BTreeMap<String, T>) -> impl Iterator<Item = &'a String> {
    groups.keys().filter(|n| !n.contains('['))
}

/// Nodes of a body in a box; can be empty.
pub(super) fn nodes_in_box(body: &Body, low: &[f64; 3], high: &[f64; 3]) -> Vec<usize> {
    let slack = slack(body.spacing);
    let nodes = body.model.nodes().iter().enumerate();
    let inside_box = nodes.filter(|(_, x)| inside(low, high, x, slack));
    inside_box.map(|(k, _)| k).collect()
}

pub(super) fn check_box(path: &str, low: &[f64; 3], high: &[f64; 3]) -> Result<()> {
    match (0..3).find(|&c| high[c] < low[c]) {
        Some(c) => Err(crate::error::value(
            format!("{path}.box.high[{c}]"),
            high[c],
            &format!("must not be below low[{c}] = {} m", low[c]),
        )),
        None => Ok(()),
    }
}

/// Nodes of a selection.
///
/// # Errors
/// An unknown group, or a box without nodes.
pub(super) fn nodes(path: &str, body: &Body, selection: &Selection) -> Result<Vec<usize>> {
    match selection {
        Selection::Group(name) => match body.groups.get(name) {
            Some(nodes) => Ok(nodes.clone()),
            None => Err(unknown(path, name, "group of the model", named(&body.groups))),
        },
        Selection::Box(low, high) => {
            check_box(path, low, high)?;
            let nodes = nodes_in_box(body, low, high);
            if nodes.is_empty() {
                let name = body.model.name();
                let remedy = "enlarge it or check the units (m)";
                return Err(key(
                    path,
                    format!("{selection} holds no node of model '{name}'; {remedy}"),
                ));
            }
            Ok(nodes)
        }
    }
}

/// Surface facets of a selection; `None` if the model has no surface.
///
/// # Errors
/// An unknown group, or a selection without facets.
pub(super) fn facets(
    path: &str,
    body: &Body,
    selection: &Selection,
) -> Result<Option<Vec<SurfaceFacet<f64>>>> {
    if body.boundary.is_empty() {
        return Ok(None);
    }
    let facets: Vec<_> = match selection {
        Selection::Group(name) => match (body.surfaces.get(name), body.groups.get(name)) {
            (Some(facets), _) => facets.clone(),
            (None, Some(_)) => Vec::new(),
            (None, None) => {
                return Err(unknown(path, name, "surface of the model", named(&body.surfaces)));
            }
        },
        Selection::Box(low, high) => {
            check_box(path, low, high)?;
            let (points, slack) = (body.model.nodes(), slack(body.spacing));
            let whole =
                |f: &&SurfaceFacet<f64>| f.nodes.iter().all(|&k| inside(low, high, &points[k], slack));
            body.boundary.iter().filter(whole).cloned().collect()
        }
    };
    if facets.is_empty() {
        let name = body.model.name();
        let remedy = "choose a surface or a larger box";
        return Err(key(
            path,
            format!("{selection} holds no surface facet of model '{name}'; {remedy}"),
        ));
    }
    Ok(Some(facets))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_holds_its_own_nodes_wherever_the_body_lies_and_no_others() {
        // Size of a body, and its position.
        for (size, position) in [(1.0, 0.0), (1.0, 1e7), (1e-9, 0.0), (1e-9, 1.0), (1e9, -3.0)] {
            let (h, x): (f64, f64) = (size / 10.0, position);
            let node = |k: usize| Point3::new(x + h * k as f64, x, x);
            // The face at the lower end, in a box that is huge perpendicular to the face normal.
            let (low, high) = ([x - 0.1 * h, -1e12, -1e12], [x, 1e12, 1e12]);
            let selected: Vec<usize> = (0..=10)
                .filter(|k| inside(&low, &high, &node(*k), slack(h)))
                .collect();
            assert_eq!(selected, [0], "size {size}, place {position}");
            let rounded = Point3::new(x + 1e-7 * h, x, x);
            assert!(
                inside(&low, &high, &rounded, slack(h)),
                "size {size}, place {position}"
            );
        }
    }
}
