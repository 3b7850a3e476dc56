//! Energies of both models in one field, without a constraint: weighted in the overlap (handshake), or the
//! coarse energy of a zone replaced by that of its particles (ONIOM). Particles that follow the coarse
//! model join them.

use crate::error::Result;
use crate::explore::compare::case::Case;
use crate::explore::compare::reflections::Reflections;
use crate::explore::compare::system::{Lift, System};
use crate::spec::Method;
use arlequin::core::geometry::Cell;
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::core::sprs::TriMat;
use arlequin::core::{ShapeRow, Weight, Weights};
use std::sync::Arc;

/// Weights both energies; the particles of the overlap follow the coarse model.
pub(super) fn blend(case: &mut Case) -> Result<Reflections> {
    let system = case.system(&case.weights())?;
    let followers = case.followers(false, [f64::NEG_INFINITY, case.width]);
    let (d, split) = (case.components(), case.places.split);
    Reflections::of_free(lift(system, &followers, d, split, |node, c| node * d + c))
}

/// Replaces the coarse energy beyond the layer of coarse nodes next to the middle of the overlap: a model of
/// weight −1 takes it from the coarse model, so that each element counts whole or not at all. Bonds count
/// whole that touch the zone; their ends outside, the link particles, have no mass and follow the coarse
/// model.
pub(super) fn oniom(case: &mut Case) -> Result<Reflections> {
    let Some(border) = border(case) else {
        let rule = "needs coarse nodes in the overlap; widen it to one coarse spacing";
        return Err(case.refusal(Method::Oniom, rule));
    };
    let (origin, axis) = case.frame();
    let rounded = 1e-9 * case.width;
    let origin = origin + axis * (border - rounded);
    let zone = |part| -> Arc<dyn Weight<f64>> { Arc::new(Zone { origin, axis, part }) };
    let coarse = Weights::from_weight(zone(Part::Outside));
    let mut fine = Weights::from_weight(zone(Part::Inside));
    fine.internal = zone(Part::Touching);
    let system = case.system(&[coarse, fine])?;
    let followers = case.followers(false, [f64::NEG_INFINITY, border]);
    let (d, split) = (case.components(), case.places.split);
    let followers: Vec<_> = followers
        .into_iter()
        .filter(|(k, _)| system.inverse[split + k * d] == 0.0)
        .collect();
    let lift = lift(system, &followers, d, split, |node, c| node * d + c);
    if lift.reduced().is_anchored() {
        let rule = "leaves nodes or particles without mass that hold others; take an overlap whose middle lies between elements, \
                    and particles within the coarse mesh";
        return Err(case.refusal(Method::Oniom, rule));
    }
    Reflections::of_free(lift)
}

/// Returns the distance of the layer of coarse nodes next to the middle of the overlap; of two as near, that
/// on the side of the fine model. Particles must reach beyond it.
fn border(case: &Case) -> Option<f64> {
    let rounded = 1e-6 * case.width;
    let layers = case.coarse_nodes().iter().map(|x| case.distance(x));
    let layers = layers.filter(|x| *x > rounded && *x <= case.width + rounded);
    let off = |x: &f64| (x - 0.5 * case.width).abs();
    let least = layers.clone().map(|x| off(&x)).fold(f64::INFINITY, f64::min);
    layers
        .filter(|x| off(x) <= least + rounded)
        .max_by(f64::total_cmp)
}

/// Cells that count.
#[derive(Clone, Copy, PartialEq)]
enum Part {
    /// Elements whose centres are outside of the zone.
    Outside,
    /// Particles in the zone, and bonds between them.
    Inside,
    /// Bonds with an end in the zone.
    Touching,
}

/// One for cells that count and zero for others.
struct Zone {
    /// A point of the border, less round-off: a particle on it belongs to the zone.
    origin: Point3<f64>,
    axis: Vector3<f64>,
    part: Part,
}

impl Weight<f64> for Zone {
    fn value(&self, x: &Point3<f64>) -> f64 {
        let inside = (x - self.origin).dot(&self.axis) >= 0.0;
        f64::from(u8::from(inside != (self.part == Part::Outside)))
    }

    fn mean(&self, cell: &Cell<f64>) -> f64 {
        let [low, high] = cell.bounds();
        // The corner of the box around a bond that lies farthest along the axis, or that which lies nearest.
        let corner = |farthest: bool| {
            let choose = |l: f64, h: f64, a: f64| if (a > 0.0) == farthest { h } else { l };
            Point3::from(low.coords.zip_zip_map(&high.coords, &self.axis, choose))
        };
        self.value(&match self.part {
            Part::Outside => arlequin::core::nalgebra::center(&low, &high),
            Part::Inside => corner(false),
            Part::Touching => corner(true),
        })
    }
}

/// Lets the displacements of some particles, whose unknowns begin at `first`, follow coarse nodes. Rotations
/// stay free.
pub(super) fn lift(
    whole: System,
    followers: &[(usize, ShapeRow<f64>)],
    d: usize,
    first: usize,
    coarse: impl Fn(usize, usize) -> usize,
) -> Lift {
    let n = whole.size();
    let mut place = vec![Some(0); n];
    for (k, _) in followers {
        (0..d).for_each(|c| place[first + k * d + c] = None);
    }
    let kept: Vec<usize> = (0..n).filter(|i| place[*i].is_some()).collect();
    kept.iter().enumerate().for_each(|(j, i)| place[*i] = Some(j));
    let mut rows = TriMat::new((n, kept.len()));
    kept.iter()
        .enumerate()
        .for_each(|(j, i)| rows.add_triplet(*i, j, 1.0));
    for (k, row) in followers {
        for c in 0..d {
            for (node, value) in row.nodes.iter().zip(&row.values) {
                if let Some(j) = place[coarse(*node, c)] {
                    rows.add_triplet(first + k * d + c, j, *value);
                }
            }
        }
    }
    Lift {
        rows: rows.to_csr(),
        kept,
        whole,
    }
}
