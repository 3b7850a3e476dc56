//! Handshake: the weighted energies of both models in one field, without a constraint. Particles of the
//! overlap follow the coarse model.

use crate::error::Result;
use crate::explore::compare::case::Case;
use crate::explore::compare::reflections::Reflections;
use crate::explore::compare::system::{Lift, System};
use arlequin::core::ShapeRow;
use arlequin::core::sprs::TriMat;

/// Couples by a common field.
pub(super) fn blend(case: &mut Case) -> Result<Reflections> {
    let system = case.system(&case.weights())?;
    let followers = case.followers(false, [f64::NEG_INFINITY, case.width]);
    let (d, split) = (case.components(), case.places.split);
    Reflections::of_free(lift(system, &followers, d, split, |node, c| node * d + c))
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
