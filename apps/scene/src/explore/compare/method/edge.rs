//! Edge to edge: models that meet in one layer of particles, each tied to the coarse field there.

use crate::error::Result;
use crate::explore::compare::case::{Case, with_complement};
use crate::explore::compare::reflections::{Pace, Reflections};
use crate::explore::compare::tie::Tie;
use crate::spec::Method;
use arlequin::core::sprs::{CsMat, TriMat};
use arlequin::core::{Profile, Ramp, ShapeRow, Weights};
use std::sync::Arc;

/// Ties the layer of particles in the middle of the overlap. `strong`: every component of every particle;
/// otherwise the mean over the layer with each shape function of the coarse model.
pub(super) fn edge(case: &mut Case, strong: bool) -> Result<Reflections> {
    let (middle, half) = (0.5 * case.width, 0.5 * case.spacing[1]);
    let slab = case.slab(middle - half, middle + half)?;
    let ramp = Ramp::new(Arc::new(slab), Profile::Linear, 0.0).map_err(crate::error::core("compare"))?;
    let system = case.system(&with_complement(Weights::from_weight(Arc::new(ramp))))?;
    let layer = case.followers(false, [middle - half, middle + half]);
    // Only particles that have weight can be tied.
    let split = case.places.split;
    let d = case.components();
    let layer: Vec<_> = layer
        .into_iter()
        .filter(|(k, _)| system.inverse[split + k * d] > 0.0)
        .collect();
    let method = if strong { Method::Edge } else { Method::EdgeWeak };
    if system.is_anchored() {
        let rule =
            "leaves nodes or particles without mass that hold others; take a coarse model of finite elements";
        return Err(case.refusal(method, rule));
    }
    if layer.is_empty() {
        let rule = "finds no particle in the middle layer of the overlap; take a finer model";
        return Err(case.refusal(method, rule));
    }
    let mut rows = tied(&layer, d, split, system.size());
    if !strong {
        rows = &averages(&layer, d, split) * &rows;
    }
    let tie = Tie::exact(rows, &system.inverse)?;
    // Between own steps a single layer would leave the node that it is tied to.
    let pace = Pace::common(&system)?;
    Ok(Reflections::new(system, Some(tie), pace))
}

/// Rows `N(x_i) u − d_i` of each component.
pub(super) fn tied(layer: &[(usize, ShapeRow<f64>)], d: usize, split: usize, size: usize) -> CsMat<f64> {
    let mut out = TriMat::new((layer.len() * d, size));
    for (n, (k, row)) in layer.iter().enumerate() {
        for c in 0..d {
            for (node, value) in row.nodes.iter().zip(&row.values) {
                out.add_triplet(n * d + c, node * d + c, *value);
            }
            out.add_triplet(n * d + c, split + k * d + c, -1.0);
        }
    }
    out.to_csr()
}

/// Shape functions of the coarse model at the particles of a layer, by coarse unknowns that are not zero.
fn averages(layer: &[(usize, ShapeRow<f64>)], d: usize, split: usize) -> CsMat<f64> {
    let mut used = vec![usize::MAX; split.div_ceil(d)];
    let mut count = 0;
    let mut out = Vec::new();
    for (n, (_, row)) in layer.iter().enumerate() {
        for (node, value) in row.nodes.iter().zip(&row.values) {
            if used[*node] == usize::MAX {
                used[*node] = count;
                count += 1;
            }
            out.extend((0..d).map(|c| (used[*node] * d + c, n * d + c, *value)));
        }
    }
    let mut rows = TriMat::new((count * d, layer.len() * d));
    out.into_iter().for_each(|(i, j, v)| rows.add_triplet(i, j, v));
    rows.to_csr()
}
