//! Weights of models that belong to several interfaces.

use super::interface::BuiltInterface;
use crate::error::{Result, key};
use arlequin::core::Weights;

/// Share that coarser models leave to model `m`: `1 − Σ f` over its coarse partners with weights `f`. For a
/// partner that is itself fine in an interface, `1 − f` is multiplied by the share left to that partner.
/// `None` if `m` is nowhere the fine model; `depth` detects rings of interfaces.
fn share_left_to(m: usize, joints: &[BuiltInterface], depth: usize) -> Result<Option<Weights<f64>>> {
    let interfaces = || joints.iter().filter(|j| j.spec.fine == m);
    let Some(first) = interfaces().next() else {
        return Ok(None);
    };
    if depth > joints.len() {
        let rule = "the models are finer than one another in a ring; let one of them be coarse only";
        return Err(key(format!("interface.{}", first.spec.name), rule));
    }
    let (mut nested, mut shares) = (false, Vec::new());
    for j in interfaces() {
        let left_to_coarse = share_left_to(j.spec.coarse, joints, depth + 1)?;
        nested |= left_to_coarse.is_some();
        shares.push((j.weights.clone(), left_to_coarse));
    }
    if !nested {
        let weights: Vec<_> = shares.into_iter().map(|s| s.0).collect();
        return Ok(Some(Weights::complement_of(&weights)));
    }
    let complement = |(w, left_to_coarse): (Weights<f64>, Option<Weights<f64>>)| {
        let share = Weights::complement_of(&[w]);
        let share = left_to_coarse.iter().fold(share, Weights::within);
        Weights::complement_of(&[share])
    };
    let weights: Vec<_> = shares.into_iter().map(complement).collect();
    Ok(Some(Weights::complement_of(&weights)))
}

/// Weights of a model for all its interfaces.
pub(super) fn model_weights(m: usize, joints: &[BuiltInterface]) -> Result<Weights<f64>> {
    let coarse = joints.iter().filter(|j| j.spec.coarse == m);
    let coarse: Vec<_> = coarse.map(|j| j.weights.clone()).collect();
    let as_coarse = match coarse.as_slice() {
        [] => None,
        [one] => Some(one.clone()),
        // With several fine partners: `1 − Σ (1 − f_i)`, which is one outside of all overlaps.
        several => {
            let shares: Vec<_> = several
                .iter()
                .map(|w| Weights::complement_of(std::slice::from_ref(w)))
                .collect();
            Some(Weights::complement_of(&shares))
        }
    };
    Ok(match (as_coarse, share_left_to(m, joints, 0)?) {
        (None, None) => Weights::uncoupled(),
        (Some(as_coarse), None) => as_coarse,
        (None, Some(left)) => left,
        (Some(as_coarse), Some(left)) => as_coarse.within(&left),
    })
}
