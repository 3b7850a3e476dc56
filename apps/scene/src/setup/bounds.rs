//! Bounds of a plausible motion, checked before the first step and during the run.

use super::shapes::corners;
use crate::setup::BodyShape;
use crate::spec::Shape;
use arlequin::core::nalgebra::Point3;
use arlequin::core::{Coupled, Elastic, Owned};

/// Bounds of a plausible motion of each model, checked before the first step and during the run.
#[derive(Debug, Clone, Default)]
pub struct Bounds(pub(super) Vec<Bound>);

#[derive(Debug, Clone)]
pub(super) struct Bound {
    /// Speed of pressure waves \[m/s\].
    pub wave: f64,
    /// Largest extent of the bounding box \[m\].
    pub extent: f64,
    /// Area of the section across the longest extent \[m²\].
    pub section: f64,
    /// True if displacements are small, so that the body cannot turn and no part of it can leave.
    pub small: bool,
}

impl Bounds {
    /// Adds a model.
    pub(super) fn add(
        &mut self,
        nodes: &[Point3<f64>],
        shape: &BodyShape,
        material: Option<&Elastic<f64>>,
        small: bool,
    ) {
        let [low, high] = corners(nodes);
        let size = high - low;
        self.0.push(Bound {
            // Without a known material, any speed is plausible.
            wave: material.map_or(f64::INFINITY, Elastic::p_wave_speed),
            extent: size.max(),
            section: match shape.in_scene() {
                Some(Shape::Bar { section, .. }) => *section,
                _ => size.product() / size.max(),
            },
            small,
        });
    }

    /// Warns about displacements beyond the body and velocities beyond the wave speed in the present state,
    /// one line per model and kind. Collective for partitioned models.
    pub fn watch(&self, run: &Coupled<f64>) -> Vec<String> {
        let mut out = Vec::new();
        for (s, b) in run.subdomains().iter().zip(&self.0) {
            let (name, layout) = (s.model().name(), s.model().layout());
            let moving = 0..layout.translations();
            let top = |m: f64, x: &f64| m.max(x.abs());
            let local_top = s.state().v[moving.clone()].iter().fold(0.0, top);
            let speed = s.owned().largest(local_top);
            if speed > b.wave {
                out.push(format!(
                    "model '{name}': moves at {speed:.3e} m/s at t = {:.3e} s, above its wave speed of {:.3e} m/s; check \
                     loads, velocities and their units",
                    run.time(),
                    b.wave
                ));
            }
            let stretch = stretch(&s.owned(), &s.state().q[moving], layout.components);
            if b.small && stretch > b.extent {
                out.push(format!(
                    "model '{name}': its displacements differ by {stretch:.3e} m at t = {:.3e} s, more than its size of \
                     {:.3e} m, where strains are no longer small; check loads, displacements and their units",
                    run.time(),
                    b.extent
                ));
            }
        }
        out
    }
}

/// Largest difference of one displacement component between two nodes \[m\]. Collective.
fn stretch(owned: &Owned, q: &[f64], components: usize) -> f64 {
    let span = |c: usize| {
        let values = q.iter().skip(c).step_by(components).copied();
        let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| {
            (a.min(x), b.max(x))
        });
        // Both as maxima, for which ranks have an all-reduce.
        owned.highest(high) + owned.highest(-low)
    };
    (0..components).map(span).fold(0.0, f64::max)
}
