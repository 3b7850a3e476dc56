//! Energies of both models in one field, without a constraint: weighted in the overlap (handshake), or the
//! coarse energy of a zone replaced by that of its particles (ONIOM). Particles that follow the coarse
//! model join them.

use super::{COARSE, Case, FINE, Method, Reflections, Result};
use arlequin::core::Weights;

/// Weights both energies; the particles of the overlap follow the coarse model.
pub(super) fn blend(case: &mut Case) -> Result<Reflections> {
    let system = case.system(&case.weights.clone())?;
    let followers = case.followers([COARSE, FINE], [f64::NEG_INFINITY, case.width], &|_| true);
    Reflections::following(system, &followers)
}

/// Replaces the coarse energy beyond the layer of coarse nodes next to the middle of the overlap: a model of
/// weight −1 takes it from the coarse model, so that each element counts whole or not at all, by its centre.
/// Bonds count whole that touch the zone; their ends outside, the link particles, have no mass and follow
/// the coarse model.
pub(super) fn oniom(case: &mut Case) -> Result<Reflections> {
    let Some(border) = border(case) else {
        let rule = "needs coarse nodes in the overlap; widen it to one coarse spacing";
        return Err(case.refusal(Method::Oniom, rule));
    };
    // A particle on the border belongs to the zone.
    let start = border - 1e-9 * case.width;
    let zone = move |s: f64| f64::from(u8::from(s >= start));
    let coarse = Weights::from_weight(case.weight(move |[a, b]| 1.0 - zone(0.5 * (a + b))));
    let mut fine = Weights::from_weight(case.weight(move |[nearest, _]| zone(nearest)));
    fine.internal = case.weight(move |[_, farthest]| zone(farthest));
    let system = case.system(&[coarse, fine])?;
    let links = |i: usize| system.inverse[i] == 0.0;
    let followers = case.followers([COARSE, FINE], [f64::NEG_INFINITY, border], &links);
    let out = Reflections::following(system, &followers)?;
    if out.system.is_anchored() {
        let rule = "leaves nodes or particles without mass that hold others; take an overlap whose middle lies between elements, \
                    and particles within the coarse mesh";
        return Err(case.refusal(Method::Oniom, rule));
    }
    Ok(out)
}

/// Returns the distance of the layer of coarse nodes next to the middle of the overlap; of two as near, that
/// on the side of the fine model. Particles must reach beyond it.
fn border(case: &Case) -> Option<f64> {
    let rounded = 1e-6 * case.width;
    let layers = case.parts[COARSE].places.iter().map(|p| p.x);
    let layers = layers.filter(|x| *x > rounded && *x <= case.width + rounded);
    let off = |x: &f64| (x - 0.5 * case.width).abs();
    let least = layers.clone().map(|x| off(&x)).fold(f64::INFINITY, f64::min);
    layers
        .filter(|x| off(x) <= least + rounded)
        .max_by(f64::total_cmp)
}
