//! Quasicontinuum: particles everywhere, of which those of the coarse region follow the coarse mesh.

use super::{COARSE, Case, FINE, FINE_EVERYWHERE, Method, Reflections, Result};
use arlequin::core::{Uniform, Weight};
use std::sync::Arc;

/// Half of the width of a cluster around a layer of nodes, in spacings of the particles. Middles of bonds lie
/// half a spacing and one and a half from a node, so that round-off does not decide which of them count.
const CLUSTER: f64 = 2.0;

/// Least number of bonds for which one of a cluster stands.
const LEAST_FACTOR: f64 = 1.2;

/// Lets the particles up to the middle of the overlap follow the coarse mesh. All bonds are summed, or
/// those of clusters around the layers of nodes.
pub(super) fn quasicontinuum(case: &mut Case, by_clusters: bool) -> Result<Reflections> {
    let weight = if by_clusters {
        clusters(case)?
    } else {
        Arc::new(Uniform(1.0))
    };
    let system = case.slaved(COARSE, &*weight)?;
    let region = [f64::NEG_INFINITY, 0.5 * case.width];
    let followers = case.followers([COARSE, FINE_EVERYWHERE], region, &|_| true);
    Reflections::following(system, &followers)
}

/// Weight of the bonds near the layers of coarse nodes, as many times as large as they are rare. A bond
/// belongs to a cluster by its middle. One factor serves all clusters.
///
/// Bonds of one element of a chain are strained equally, so that the sums are those over all bonds. On a
/// packing, where a cluster stands for bonds unlike its own, they are not (Luskin and Ortner 2009).
fn clusters(case: &Case) -> Result<Arc<dyn Weight<f64>>> {
    let half = CLUSTER * case.spacing[FINE];
    let mut layers: Vec<f64> = case.parts[COARSE].places.iter().map(|p| p.x).collect();
    layers.sort_by(f64::total_cmp);
    layers.dedup_by(|next, last| *next - *last < half);
    let end = 0.5 * case.width;
    let first = layers.first().copied().unwrap_or(0.0);
    let is_near = move |s: f64| layers.iter().any(|l| (s - l).abs() <= half);
    // As many bonds as the clusters leave out are added to those that they hold.
    let count = 20_000_u32;
    let step = (end - first) / f64::from(count);
    let places = (0..count).map(|k| first + (f64::from(k) + 0.5) * step);
    let inside = places.filter(|s| is_near(*s)).count();
    let factor = f64::from(count) / inside.max(1) as f64;
    if factor < LEAST_FACTOR {
        let rule =
            "has clusters that meet, so that all bonds are summed; take a coarser mesh or quasicontinuum";
        return Err(case.refusal(Method::QuasicontinuumClusters, rule));
    }
    Ok(case.weight(move |[a, b]| match 0.5 * (a + b) {
        s if s >= end => 1.0,
        s if is_near(s) => factor,
        _ => 0.0,
    }))
}
