//! Warnings about an interface.

use super::{InterfaceReport, InterfaceSpec, Side};
use crate::Real;

/// Smallest warp of hexahedra, relative to their lengths, that is warned about.
const WARP: f64 = 1e-6;

/// Returns warnings about the mediator and the models.
pub(super) fn side_warnings<T: Real>(
    report: &InterfaceReport,
    spec: &InterfaceSpec<T>,
    sides: &[Side<'_, T>; 2],
) -> Vec<String> {
    let components = sides[0].layout.components;
    let mut out = Vec::new();
    let nodes = report.multipliers / components;
    let [coarse, fine] = report.coupled_nodes;
    // Between the two models a finer mediator does no harm (hard-cases.md). One as fine as the finer model
    // forces jumps to zero that the coarser model cannot follow.
    let (coarser, finer) = (coarse.min(fine), coarse.max(fine));
    if nodes >= finer && nodes > coarser {
        out.push(format!(
            "the mediator ({nodes} nodes) is as fine as the finer model in the overlap ({coarse} coarse, {fine} fine nodes), or \
             finer: long waves will be reflected; use h_B ≥ {:.3e} m",
            // The number of nodes goes with the inverse spacing to the power of the dimension, which is the
            // number of components (a line has 1, a solid 3).
            spec.mediator.spacing().as_f64() * (nodes as f64 / coarser as f64).powf(1.0 / components as f64),
        ));
    }
    let warp = (sides.iter().map(|s| s.field.warp())).fold(spec.mediator.warp(), |m, w| m.max(w));
    if warp.as_f64() > WARP {
        out.push(format!(
            "faces of hexahedra leave their planes by up to {:.1} % of the element's length: uniform strain is \
             not exact across the overlap, displacements are off by up to {:.0e} of the largest, strains of single elements by {:.0e}; \
             a finer mediator lowers both, tetrahedra or planar faces avoid it",
            100.0 * warp.as_f64(),
            0.03 * warp.as_f64(),
            warp.as_f64()
        ));
    }
    out
}

/// Returns warnings about dependent multipliers. `ranked`: whether their number is known.
pub(super) fn rank_warnings(report: &InterfaceReport, ranked: bool) -> Vec<String> {
    let mut out = Vec::new();
    if !report.null_modes.is_empty() {
        out.push(format!(
            "{} of {} multiplier unknowns are dependent and were dropped (first at mediator node {})",
            report.null_modes.len(),
            report.multipliers,
            report.null_modes[0].node
        ));
    }
    if !ranked {
        out.push(format!(
            "{} multiplier unknowns are too many to tell whether some are dependent; that costs no energy, but a mediator \
             finer than one of the models reflects long waves",
            report.multipliers
        ));
    }
    out
}
