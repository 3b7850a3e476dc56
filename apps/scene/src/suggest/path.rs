//! Which ways a signal makes from its source to the probes, through which model and how often through the
//! overlap.

use super::scenario::Scenario;
use crate::spec::{Quantity, SceneSpec, Selection};

/// Most arrivals that are followed; a run with more is judged as if its probes were everywhere.
const MOST: usize = 64;

/// Where a signal starts, along the overlap's axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Origin {
    /// Distance from the fine border, positive into the coarse model \[m\].
    pub at: f64,
    /// Towards the coarse model, away from it.
    pub towards: [bool; 2],
    /// By how much its front is ahead of the place \[m\].
    pub ahead: f64,
}

/// One arrival of the signal at a probe.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Arrival {
    /// Whole way of the front \[m\].
    pub way: f64,
    /// Share of it in the coarse model \[m\].
    pub coarse: f64,
    /// How often it passed the overlap.
    pub passages: f64,
}

/// A line of a fine part and a coarse part, mirrored at both ends for ever: a reflection is a straight way
/// there.
#[derive(Debug, Clone, Copy)]
struct Line {
    length: f64,
    border: f64,
}

impl Line {
    /// Coarse length between zero and a place of the mirrored line \[m\].
    fn coarse(&self, y: f64) -> f64 {
        let own = |r: f64| (r - self.border).max(0.0);
        self.unfolded(y, own(self.length), own)
    }

    /// Overlaps between zero and a place.
    fn passages(&self, y: f64) -> f64 {
        self.unfolded(y, 1.0, |r| if r > self.border { 1.0 } else { 0.0 })
    }

    fn unfolded(&self, y: f64, whole: f64, within: impl Fn(f64) -> f64) -> f64 {
        let n = (y / self.length).floor();
        let r = y - n * self.length;
        let forwards = n.rem_euclid(2.0) < 0.5;
        n * whole
            + if forwards {
                within(r)
            } else {
                whole - within(self.length - r)
            }
    }
}

/// Arrivals until `way` \[m\] at displacement and at velocity probes; none if the scene has no probes along
/// the axis or too many arrivals.
pub(super) fn arrivals(s: &Scenario, origin: &Origin, overlap: f64, way: f64) -> Option<[Vec<Arrival>; 2]> {
    let line = Line {
        length: s.lengths[0] + s.lengths[1],
        border: s.lengths[1] + 0.5 * overlap,
    };
    let start = origin.at + s.lengths[1];
    let mut out = [Vec::new(), Vec::new()];
    let mirrors = (way / line.length).ceil() + 1.0;
    if mirrors > MOST as f64 {
        return None;
    }
    for (kind, at) in &s.probes {
        let probe = at + s.lengths[1];
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
    // What one kind of probe does not show is taken from the other.
    for k in [0, 1] {
        if out[k].is_empty() {
            out[k] = out[1 - k].clone();
        }
    }
    (!out[0].is_empty()).then_some(out)
}

/// Kind (0 displacement, 1 velocity) and distance from the fine border of the probes of motion along the
/// axis \[m\].
pub(super) fn probes(scene: &SceneSpec, axis: usize, border: f64, inward: f64) -> Vec<(usize, f64)> {
    let place = |p: &crate::spec::Probe| match (&p.at, &p.over) {
        (Some(x), _) => Some(x[axis]),
        (_, Some(Selection::Box(low, high))) => Some(0.5 * (low[axis] + high[axis])),
        (_, Some(Selection::Group(name))) => end(scene, p.model.as_ref()?, name, axis),
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

/// Where a selection of a load lies along the axis \[m\]; none if it is not at one place.
pub(super) fn place(scene: &SceneSpec, model: &str, at: &Selection, axis: usize) -> Option<f64> {
    match at {
        Selection::Group(name) => end(scene, model, name, axis),
        Selection::Box(low, high) => {
            let [a, b] = super::scenario::extent(model, scene.model.get(model)?, axis).ok()?;
            Some(0.5 * (low[axis].max(a) + high[axis].min(b)))
        }
    }
}

/// Coordinate of the end face of a model that a group names.
fn end(scene: &SceneSpec, model: &str, group: &str, axis: usize) -> Option<f64> {
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
