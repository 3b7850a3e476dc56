//! Elements into which the mesher divides a body: whole ones along each edge, with the faces of a hole
//! between them.

use super::scenario::Scenario;
use crate::setup::{BodyShape, LoweredInterface, LoweredModel, OverlapSource};
use crate::spec::{OverlapShape, RegionShape, Shape};
use std::f64::consts::PI;

/// Distance of a hole from the faces between elements that the mesher accepts, in elements.
const OFF_FACE: f64 = 1e-6;
/// Largest number of divisions of one edge that are tried.
const MOST: usize = 10_000;

/// Edges of a body and the faces of a hole in it.
#[derive(Debug, Clone, Default)]
pub(super) struct Mesher {
    /// Lengths of the edges, or of the lines that are divided in their place \[m\].
    edges: Vec<f64>,
    /// Places of the two faces of a hole along each edge, as shares of the edge; empty without a hole.
    hole: Vec<[f64; 2]>,
    /// Edge along which waves run; `None` if they run in all directions.
    along: Option<usize>,
}

/// Elements that a spacing gives.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Elements {
    /// Numbers along the edges.
    pub counts: Vec<usize>,
    /// Length along which waves run \[m\]: that along the axis, or the mean of all edges.
    pub h: f64,
    /// Mean length of all edges \[m\].
    pub mean: f64,
}

impl Mesher {
    /// Reads a body; waves run along the edge `along`.
    pub(super) fn of_shape(shape: &BodyShape, along: Option<usize>) -> Self {
        let mut out = match shape.in_scene() {
            Some(Shape::Box { low, high, hole }) => {
                Self::of_box([low, high], hole.as_ref().map(|h| [&h.low, &h.high]))
            }
            // As the generators of these shapes count: layers and core, core and rings.
            Some(Shape::Cylinder { length, radius, .. }) => Self::of_edges(vec![*length, *radius, *radius]),
            Some(Shape::Ball { radius, .. }) => Self::of_edges(vec![0.5 * PI * radius, 0.5 * radius]),
            Some(Shape::Bar { from, to, .. }) => Self::of_edges(vec![to - from]),
            _ => Self::default(),
        };
        out.along = along.filter(|a| *a < out.edges.len());
        out
    }

    fn of_edges(edges: Vec<f64>) -> Self {
        Self {
            edges,
            ..Self::default()
        }
    }

    fn of_box([low, high]: [&[f64; 3]; 2], hole: Option<[&[f64; 3]; 2]>) -> Self {
        let share = |c: usize, x: f64| ((x - low[c]) / (high[c] - low[c])).clamp(0.0, 1.0);
        let faces = |h: [&[f64; 3]; 2]| (0..3).map(|c| h.map(|x| share(c, x[c]))).collect();
        Self {
            edges: (0..3).map(|c| high[c] - low[c]).collect(),
            hole: hole.map_or_else(Vec::new, faces),
            along: None,
        }
    }

    /// Returns the elements of a spacing \[m\]; `None` if a face of the hole would cut them.
    pub(super) fn elements(&self, spacing: f64) -> Option<Elements> {
        let counts = self.edges.iter().map(|l| ((l / spacing).round() as usize).max(1));
        let counts: Vec<usize> = counts.collect();
        let between = |(faces, n): (&[f64; 2], &usize)| {
            let off = faces.map(|f| (f * *n as f64 - (f * *n as f64).round()).abs());
            off[0].max(off[1]) <= OFF_FACE
        };
        if !self.hole.iter().zip(&counts).all(between) {
            return None;
        }
        let lengths = self.edges.iter().zip(&counts).map(|(l, n)| l / *n as f64);
        let lengths: Vec<f64> = lengths.collect();
        let mean = match lengths.len() {
            0 => spacing,
            n => lengths.iter().sum::<f64>() / n as f64,
        };
        let h = self.along.map_or(mean, |a| lengths[a]);
        Some(Elements { counts, h, mean })
    }

    /// Returns spacings between `most` and `least` \[m\] with their elements, from long to short: each
    /// shorter by the factor `step` at least, and written with `digits`.
    pub(super) fn spacings(
        &self,
        [most, least]: [f64; 2],
        step: f64,
        digits: impl Fn(f64) -> f64,
    ) -> Vec<(f64, Elements)> {
        // A spacing that divides the edge exactly must not need one more element by round-off.
        let most = most * (1.0 + 1e-9);
        let divided = |l: &f64| {
            let (l, first) = (*l, ((l / most).ceil() as usize).max(1));
            let last = ((l / least * (1.0 + 1e-9)) as usize).min(first.saturating_add(MOST));
            (first..=last).map(move |n| l / n as f64)
        };
        let mut all: Vec<f64> = self.edges.iter().flat_map(divided).collect();
        all.sort_by(|a, b| b.total_cmp(a));
        let mut out: Vec<(f64, Elements)> = Vec::new();
        for spacing in all.into_iter().map(digits) {
            let Some(elements) = self.elements(spacing) else {
                continue;
            };
            let finer = out
                .last()
                .is_none_or(|(_, e)| elements.h * step <= e.h * (1.0 + 1e-3));
            if finer && elements.h >= least * (1.0 - 1e-6) {
                out.push((spacing, elements));
            }
        }
        out
    }
}

impl Scenario {
    /// Returns the spacing of the fine model beside a coarse spacing `h` \[m\].
    pub(super) fn fine_spacing(&self, h: f64) -> f64 {
        self.halved_to
            .map_or(self.spacings[1], |longest| self.halved(h, longest, 1.0))
    }

    /// Returns the length of the body's elements `h` \[m\] after they were halved, at least `least` times,
    /// until their mean edge is no longer than `longest` \[m\].
    pub(super) fn halved(&self, h: f64, longest: f64, least: f64) -> f64 {
        // As for the zone itself, a length that fits up to round-off needs no further halving.
        h / ((h * self.stretch / longest).log2() - 1e-6)
            .ceil()
            .max(least)
            .exp2()
    }
}

/// Mediator of a shell of two boxes: a box around the hole that is the shell's core.
#[derive(Debug, Clone)]
pub(super) struct Frame {
    core: [[f64; 3]; 2],
    /// Box that both bodies and the domain share.
    common: [[f64; 3]; 2],
    /// Coarse body, beyond which the mediator does not reach.
    coarse: [[f64; 3]; 2],
}

impl Frame {
    /// Reads the mediator of a shell; `None` if it is not derived from boxes.
    pub(super) fn of_shell(table: &LoweredInterface, [coarse, fine]: [&LoweredModel; 2]) -> Option<Self> {
        let (None, OverlapSource::Given(OverlapShape::Shell { core, domain })) =
            (&table.mediator.shape, &table.overlap)
        else {
            return None;
        };
        let (RegionShape::Box { low: a, high: b }, RegionShape::Box { low: l, high: h }) = (core, domain)
        else {
            return None;
        };
        let (
            Shape::Box {
                low: c0, high: c1, ..
            },
            Shape::Box {
                low: f0, high: f1, ..
            },
        ) = (coarse.shape.in_scene()?, fine.shape.in_scene()?)
        else {
            return None;
        };
        Some(Self {
            core: [*a, *b],
            common: [
                [0, 1, 2].map(|c| l[c].max(c0[c]).max(f0[c])),
                [0, 1, 2].map(|c| h[c].min(c1[c]).min(f1[c])),
            ],
            coarse: [*c0, *c1],
        })
    }

    /// Returns whether a mediator of a spacing \[m\] leaves the core out by whole elements. `width`: new
    /// width of the shell \[m\], if it changes.
    pub(super) fn fits(&self, width: Option<f64>, spacing: f64) -> bool {
        let [a, b] = self.core;
        let [mut low, mut high] = self.common;
        for c in 0..3 {
            // Faces at which the shell is open stay.
            if let Some(w) = width.filter(|_| low[c] < a[c]) {
                low[c] = (a[c] - w).max(self.coarse[0][c]);
            }
            if let Some(w) = width.filter(|_| high[c] > b[c]) {
                high[c] = (b[c] + w).min(self.coarse[1][c]);
            }
        }
        Mesher::of_box([&low, &high], Some([&a, &b]))
            .elements(spacing)
            .is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spec::Hole;

    fn cuboid(high: [f64; 3], hole: Option<Hole>) -> Mesher {
        let low = [0.0; 3];
        Mesher::of_shape(&BodyShape::Given(Shape::Box { low, high, hole }), None)
    }

    /// A box of 20 by 20 by 10 mm has 14 elements of 1.4286 mm for a spacing of 1.388 mm.
    #[test]
    fn edges_are_divided_into_whole_elements() {
        let body = cuboid([20e-3, 20e-3, 10e-3], None);
        let found = body.elements(1.388e-3).expect("no hole");
        assert_eq!(found.counts, [14, 14, 7]);
        assert!((found.h - 20e-3 / 14.0).abs() < 1e-12, "{found:?}");
        let four = |x: f64| format!("{x:.3e}").parse::<f64>().unwrap_or(x);
        let all = body.spacings([5e-3, 1e-3], 1.12, four);
        assert_eq!(all[0].1.counts, [4, 4, 2]);
        assert!(all.windows(2).all(|w| w[1].1.h * 1.11 < w[0].1.h), "{all:?}");
        assert!(all.iter().all(|(s, e)| body.elements(*s).as_ref() == Some(e)));
    }

    #[test]
    fn a_hole_lies_between_elements() {
        let hole = Hole {
            low: [7.0; 3],
            high: [13.0; 3],
        };
        let body = cuboid([20.0; 3], Some(hole));
        let counts = |r: f64| {
            let all = body.spacings([5.0, r], 1.12, |x| x);
            all.iter().map(|(_, e)| e.counts[0]).collect::<Vec<_>>()
        };
        assert_eq!(counts(0.5), [20, 40]);
        assert!(body.elements(1.4).is_none());
    }

    #[test]
    fn the_mediator_of_a_shell_leaves_its_core_out() {
        let frame = Frame {
            core: [[-3.0; 3], [3.0; 3]],
            common: [[-6.0; 3], [6.0; 3]],
            coarse: [[-10.0; 3], [10.0; 3]],
        };
        assert!(frame.fits(None, 1.0) && !frame.fits(None, 0.8));
        assert!(frame.fits(Some(4.0), 1.0) && !frame.fits(Some(4.5), 1.0));
        // Wider than the coarse body, the mediator ends with it.
        assert!(frame.fits(Some(9.0), 1.0));
    }
}
