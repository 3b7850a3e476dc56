//! Weights of models that are in several interfaces.

use super::interface::BuiltInterface;
use crate::error::{Result, key};
use arlequin::core::Weights;

/// What models that are coarse beside `m`, and those beside these, leave to it: `1 − Σ f`, of each times
/// what is left to that model. None where there are none; `depth` bounds the way up.
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

/// The weights of a model beside all its partners.
pub(super) fn of(m: usize, joints: &[BuiltInterface]) -> Result<Weights<f64>> {
    let coarse = joints.iter().filter(|j| j.spec.coarse == m);
    let coarse: Vec<_> = coarse.map(|j| j.weights.clone()).collect();
    let own = match coarse.as_slice() {
        [] => None,
        [one] => Some(one.clone()),
        // Beside several fine partners: 1 − Σ (1 − f_i), one where none of them is.
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
