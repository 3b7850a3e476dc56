//! Parts of a model: nodes and surface facets by group or box.

use super::kinds::Body;
use crate::error::{Result, key, unknown};
use crate::spec::Selection;
use arlequin::core::effect::SurfaceFacet;
use arlequin::core::nalgebra::Point3;

/// Whether a point lies in the closed box, up to round-off of its own size.
pub(super) fn inside(low: &[f64; 3], high: &[f64; 3], x: &Point3<f64>) -> bool {
    let largest = low.iter().chain(high).fold(0.0f64, |s, c| s.max(c.abs()));
    let slack = 1e-9 * largest;
    (0..3).all(|c| x[c] >= low[c] - slack && x[c] <= high[c] + slack)
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

/// Nodes of a selection, at least one.
pub(super) fn nodes(path: &str, body: &Body, selection: &Selection) -> Result<Vec<usize>> {
    match selection {
        Selection::Group(name) => match body.groups.get(name) {
            Some(nodes) => Ok(nodes.clone()),
            None => Err(unknown(path, name, "group of the model", body.groups.keys())),
        },
        Selection::Box(low, high) => {
            check_box(path, low, high)?;
            let all = body.model.nodes().iter().enumerate();
            let found: Vec<usize> = all
                .filter(|(_, x)| inside(low, high, x))
                .map(|(k, _)| k)
                .collect();
            if found.is_empty() {
                let name = body.model.name();
                let remedy = "enlarge it or check the units (m)";
                return Err(key(
                    path,
                    format!("{selection} holds no node of model '{name}'; {remedy}"),
                ));
            }
            Ok(found)
        }
    }
}

/// Surface facets of a selection; `None` if the model has no surface at all.
pub(super) fn facets(
    path: &str,
    body: &Body,
    selection: &Selection,
) -> Result<Option<Vec<SurfaceFacet<f64>>>> {
    if body.boundary.is_empty() {
        return Ok(None);
    }
    let found: Vec<_> = match selection {
        Selection::Group(name) => match (body.surfaces.get(name), body.groups.get(name)) {
            (Some(facets), _) => facets.clone(),
            (None, Some(_)) => Vec::new(),
            (None, None) => return Err(unknown(path, name, "surface of the model", body.surfaces.keys())),
        },
        Selection::Box(low, high) => {
            check_box(path, low, high)?;
            let points = body.model.nodes();
            let whole = |f: &&SurfaceFacet<f64>| f.nodes.iter().all(|&k| inside(low, high, &points[k]));
            body.boundary.iter().filter(whole).cloned().collect()
        }
    };
    if found.is_empty() {
        let name = body.model.name();
        let remedy = "choose a surface or a larger box";
        return Err(key(
            path,
            format!("{selection} holds no surface facet of model '{name}'; {remedy}"),
        ));
    }
    Ok(Some(found))
}
