//! Weights of models that belong to several interfaces.

use super::interface::BuiltInterface;
use crate::error::{Result, key};
use arlequin::core::Weights;

/// Share that coarser models leave to model `m`: `1 − Σ f` over its coarse partners with weights `f`. For a
/// partner that is itself fine in an interface, `1 − f` is multiplied by the share left to that partner.
/// `None` if `m` is nowhere the fine model; `depth` detects rings of interfaces.
fn left_to(m: usize, joints: &[BuiltInterface], depth: usize) -> Result<Option<Weights<f64>>> {
    let mine = || joints.iter().filter(|j| j.spec.fine == m);
    let Some(first) = mine().next() else {
        return Ok(None);
    };
    if depth > joints.len() {
        let rule = "the models are finer than one another in a ring; let one of them be coarse only";
        return Err(key(format!("interface.{}", first.spec.name), rule));
    }
    let (mut nested, mut shares) = (false, Vec::new());
    for j in mine() {
        let left = left_to(j.spec.coarse, joints, depth + 1)?;
        nested |= left.is_some();
        shares.push((j.weights.clone(), left));
    }
    if !nested {
        let all: Vec<_> = shares.into_iter().map(|s| s.0).collect();
        return Ok(Some(Weights::complement_of(&all)));
    }
    let taken = |(w, left): (Weights<f64>, Option<Weights<f64>>)| {
        let rest = Weights::complement_of(&[w]);
        let rest = left.iter().fold(rest, Weights::within);
        Weights::complement_of(&[rest])
    };
    let all: Vec<_> = shares.into_iter().map(taken).collect();
    Ok(Some(Weights::complement_of(&all)))
}

/// Weights of a model for all its interfaces.
pub(super) fn of(m: usize, joints: &[BuiltInterface]) -> Result<Weights<f64>> {
    let coarse = joints.iter().filter(|j| j.spec.coarse == m);
    let coarse: Vec<_> = coarse.map(|j| j.weights.clone()).collect();
    let own = match coarse.as_slice() {
        [] => None,
        [one] => Some(one.clone()),
        // With several fine partners: `1 − Σ (1 − f_i)`, which is one outside of all overlaps.
        all => {
            let shares: Vec<_> = all
                .iter()
                .map(|w| Weights::complement_of(std::slice::from_ref(w)))
                .collect();
            Some(Weights::complement_of(&shares))
        }
    };
    Ok(match (own, left_to(m, joints, 0)?) {
        (None, None) => Weights::uncoupled(),
        (Some(own), None) => own,
        (None, Some(left)) => left,
        (Some(own), Some(left)) => own.within(&left),
    })
}
