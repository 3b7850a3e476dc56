//! Paths of a signal from its source to the probes: the distance in each model and the number of passages
//! through the overlap.

use super::scenario::Scenario;
use crate::setup::LoweredScene;
use crate::spec::{Quantity, Selection};

/// Largest number of arrivals that are followed. A run with more is judged as if its probes were everywhere.
const MOST: usize = 64;

/// Source of a signal on the overlap's axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Origin {
    /// Distance from the fine border, positive into the coarse model \[m\].
    pub place: f64,
    /// True if the signal runs towards the coarse model, and away from it.
    pub towards: [bool; 2],
    /// Distance of the signal's front ahead of `place` \[m\].
    pub ahead: f64,
}

/// One arrival of the signal at a probe.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Arrival {
    /// Distance that the front travels \[m\].
    pub way: f64,
    /// Part of this distance in the coarse model \[m\].
    pub coarse: f64,
    /// Number of passages through the overlap.
    pub passages: f64,
}

/// A fine and a coarse part on a line, mirrored at both ends again and again, so that the path of a reflected
/// wave is straight.
#[derive(Debug, Clone, Copy)]
struct Line {
    length: f64,
    border: f64,
}

impl Line {
    /// Returns the coarse length between zero and a place of the mirrored line \[m\].
    fn coarse(&self, y: f64) -> f64 {
        let coarse_within = |r: f64| (r - self.border).max(0.0);
        self.unfolded(y, coarse_within(self.length), coarse_within)
    }

    /// Returns the number of overlaps between zero and a place of the mirrored line.
    fn passages(&self, y: f64) -> f64 {
        self.unfolded(y, 1.0, |r| if r > self.border { 1.0 } else { 0.0 })
    }

    fn unfolded(&self, y: f64, whole: f64, within: impl Fn(f64) -> f64) -> f64 {
        let n = (y / self.length).floor();
        let r = y - n * self.length;
        // Every second copy of the line is mirrored.
        let forwards = n.rem_euclid(2.0) < 0.5;
        n * whole
            + if forwards {
                within(r)
            } else {
                whole - within(self.length - r)
            }
    }
}

/// Returns the arrivals within the distance `way` \[m\] at displacement probes and at velocity probes. `None`
/// if the scene has no probes along the axis or too many arrivals.
pub(super) fn arrivals(s: &Scenario, origin: &Origin, overlap: f64, way: f64) -> Option<[Vec<Arrival>; 2]> {
    // Half of the overlap counts as fine, half as coarse.
    let line = Line {
        length: s.lengths[0] + s.lengths[1],
        border: s.lengths[1] + 0.5 * overlap,
    };
    let start = origin.place + s.lengths[1];
    let mut out = [Vec::new(), Vec::new()];
    let mirrors = (way / line.length).ceil() + 1.0;
    if mirrors > MOST as f64 {
        return None;
    }
    for (kind, distance) in &s.probes {
        let probe = distance + s.lengths[1];
        let images = (-(mirrors as i64)..=mirrors as i64)
            .flat_map(|k| [1.0, -1.0].map(|sign| 2.0 * k as f64 * line.length + sign * probe));
        for y in images {
            let ahead = y >= start;
            let front = (y - start).abs() - origin.ahead;
            if !origin.towards[usize::from(!ahead)] || front >= way {
                continue;
            }
            out[*kind].push(Arrival {
                way: front.max(0.0),
                coarse: (line.coarse(y) - line.coarse(start)).abs(),
                passages: (line.passages(y) - line.passages(start)).abs(),
            });
        }
    }
    if out.iter().map(Vec::len).sum::<usize>() > MOST {
        return None;
    }
    // Without probes of one kind, the arrivals of the other kind stand in.
    for k in [0, 1] {
        if out[k].is_empty() {
            out[k] = out[1 - k].clone();
        }
    }
    (!out[0].is_empty()).then_some(out)
}

/// Returns the probes of motion along the axis: kind (0 displacement, 1 velocity) and distance from the fine
/// border \[m\].
pub(super) fn probes(scene: &LoweredScene, axis: usize, border: f64, inward: f64) -> Vec<(usize, f64)> {
    let place = |p: &crate::spec::Probe| match (&p.at, &p.over) {
        (Some(x), _) => Some(x[axis]),
        // The middle stands in for the mean over a box.
        (_, Some(Selection::Box(low, high))) => Some(0.5 * (low[axis] + high[axis])),
        (_, Some(Selection::Group(name))) => end_coordinate(scene, p.model.as_ref()?, name, axis),
        _ => None,
    };
    let along = scene.probe.values().filter(|p| {
        p.component
            .and_then(|c| c.axis())
            .is_some_and(|c| c.index() == axis)
    });
    let known = along.filter_map(|p| {
        let kind = match p.quantity {
            Quantity::Displacement => 0,
            Quantity::Velocity => 1,
            _ => return None,
        };
        Some((kind, (place(p)? - border) * inward))
    });
    known.collect()
}

/// Returns the coordinate of a load's selection on the axis \[m\]; `None` for a group that is not an end
/// face.
pub(super) fn place(scene: &LoweredScene, model: &str, selection: &Selection, axis: usize) -> Option<f64> {
    match selection {
        Selection::Group(name) => end_coordinate(scene, model, name, axis),
        Selection::Box(low, high) => {
            let [a, b] = super::scenario::extent(model, scene.model.get(model)?, axis).ok()?;
            // A box may reach beyond the body; the load acts within it.
            Some(0.5 * (low[axis].max(a) + high[axis].min(b)))
        }
    }
}

/// Returns the coordinate of the end face of a model that a group names.
fn end_coordinate(scene: &LoweredScene, model: &str, group: &str, axis: usize) -> Option<f64> {
    let [a, b] = super::scenario::extent(model, scene.model.get(model)?, axis).ok()?;
    let name = ["x", "y", "z"][axis];
    match group.split_once('-') {
        Some((n, "min")) if n == name => Some(a),
        Some((n, "max")) if n == name => Some(b),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mirrored_ways_count_what_a_wave_meets() {
        // Fine on [0, 1], coarse on [1, 4].
        let line = Line {
            length: 4.0,
            border: 1.0,
        };
        for (y, coarse, passages) in [
            (0.5, 0.0, 0.0),
            (3.0, 2.0, 1.0),
            // Back from the far end to 3 and to 0.5, then from the near end to 3 again.
            (5.0, 4.0, 1.0),
            (7.5, 6.0, 2.0),
            (11.0, 8.0, 3.0),
            (-0.5, 0.0, 0.0),
            (-3.0, -2.0, -1.0),
        ] {
            assert!((line.coarse(y) - coarse).abs() < 1e-12, "{y}: {}", line.coarse(y));
            assert!(
                (line.passages(y) - passages).abs() < 1e-12,
                "{y}: {}",
                line.passages(y)
            );
        }
    }
}
