//! Particles tied one by one to the coarse field: by multipliers in one layer, or by springs.

use super::{
    COARSE, Case, FINE, Method, Pace, Reflections, Result, System, Tie, congruence, constraint, core,
    transposed, with_complement,
};
use arlequin::core::{Profile, Ramp, Slab, Weights};
use std::sync::Arc;

/// Edge to edge: models that meet in the layer of particles in the middle of the overlap, each tied to the
/// coarse field there. `strong`: every component of every particle; otherwise the mean over the layer with
/// each shape function of the coarse model.
pub(super) fn edge(case: &mut Case, strong: bool) -> Result<Reflections> {
    let (middle, half) = (0.5 * case.width, 0.5 * case.spacing[FINE]);
    let range = [middle - half, middle + half];
    let (origin, axis) = case.frame;
    let [coarse, fine] = range.map(|s| origin + axis * s);
    let slab = Slab::between(fine, coarse).map_err(core("compare"))?;
    let ramp = Ramp::new(Arc::new(slab), Profile::Linear, 0.0).map_err(core("compare"))?;
    let system = case.system(&with_complement(Weights::from_weight(Arc::new(ramp))))?;
    // Only particles that have weight can be tied.
    let layer = case.followers([COARSE, FINE], range, &|i| system.inverse[i] > 0.0);
    let method = if strong { Method::Edge } else { Method::EdgeWeak };
    if system.is_anchored() {
        let rule =
            "leaves nodes or particles without mass that hold others; take a coarse model of finite elements";
        return Err(case.refusal(method, rule));
    }
    if layer.nnz() == 0 {
        let rule = "finds no particle in the middle layer of the overlap; take a finer model";
        return Err(case.refusal(method, rule));
    }
    let mut rows = constraint(&layer);
    if !strong {
        rows = &transposed(&layer) * &rows;
    }
    let tie = Tie::exact(rows, &system.inverse)?;
    // Between own steps a single layer would leave the node that it is tied to.
    let pace = Pace::common(&system)?;
    Ok(Reflections::new(system, tie, pace))
}

/// Springs `½ κ_i |N(x_i) u − d_i|²` in the whole overlap, with `κ_i` a multiple of the particle's own
/// stiffness and of the smaller weight, so that the springs vanish with the model that they act on.
pub(super) fn penalty(case: &mut Case, factor: f64) -> Result<Reflections> {
    let system = case.system(&case.weights.clone())?;
    let [alpha, beta] = [COARSE, FINE].map(|k| &*case.weights[k].internal);
    let (own, others) = (case.nodal_values([alpha, beta]), case.nodal_values([beta, alpha]));
    let shapes = case.followers([COARSE, FINE], [0.0, case.width], &|_| true);
    let spring = |i: usize| {
        // The weighted stiffness times the smaller weight over its own.
        let share = (others[i] / own[i].max(f64::MIN_POSITIVE)).min(1.0);
        factor * system.own_stiffness(i) * share
    };
    let springs: Vec<f64> = (0..system.size()).map(spring).collect();
    let stiffness = &system.stiffness + &congruence(&constraint(&shapes), &springs);
    let system = System { stiffness, ..system };
    Reflections::free(system)
}
