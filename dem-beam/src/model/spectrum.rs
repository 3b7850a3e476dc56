//! The highest frequency of a model by Lanczos iteration without stored vectors.

use crate::critical::top_ritz;
use crate::error::Result;

/// Most iterations; about sixty settle the top of the spectrum.
const LIMIT: usize = 300;

/// Relative residual at which the largest Ritz value is taken.
const SETTLED: f64 = 1e-4;

/// A fixed sequence in (-1, 1) without symmetry.
fn start(i: usize) -> f64 {
    let x = ((i as f64 + 1.0) * 0.618_033_988_749_894_9).fract();
    2.0 * (x * 7.31 + 0.137 * x * x).fract() - 0.9
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Upper estimate (largest Ritz value plus its residual) of the largest eigenvalue of
/// `R K R`, `R = diag(root)`, where `apply` adds `-K q`; zero if nothing moves.
pub(crate) fn largest(root: &[f64], apply: &mut dyn FnMut(&[f64], &mut [f64])) -> Result<f64> {
    let n = root.len();
    let mut v: Vec<f64> = (0..n)
        .map(|i| if root[i] > 0.0 { start(i) } else { 0.0 })
        .collect();
    let norm = dot(&v, &v).sqrt();
    if norm <= 0.0 {
        return Ok(0.0);
    }
    v.iter_mut().for_each(|v| *v /= norm);
    let (mut last, mut q, mut w) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    let (mut diagonal, mut off): (Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new());
    let mut beta = 0.0;
    let mut top = 0.0;
    for step in 1..=LIMIT.min(n) {
        q.iter_mut()
            .zip(root.iter().zip(&v))
            .for_each(|(q, (r, v))| *q = r * v);
        w.fill(0.0);
        apply(&q, &mut w);
        w.iter_mut().zip(root).for_each(|(w, r)| *w *= -r);
        let alpha = dot(&v, &w);
        for ((w, v), l) in w.iter_mut().zip(&v).zip(&last) {
            *w -= alpha * v + beta * l;
        }
        diagonal.push(alpha);
        beta = dot(&w, &w).sqrt();
        let invariant = beta <= 1e-14 * alpha.abs();
        if invariant || step % 10 == 0 || step == LIMIT.min(n) {
            let (value, end) = top_ritz(&diagonal, &off);
            let rest = if invariant { 0.0 } else { beta * end.abs() };
            top = value + rest;
            if rest <= SETTLED * value || invariant {
                break;
            }
        }
        off.push(beta);
        w.iter_mut().for_each(|w| *w /= beta);
        std::mem::swap(&mut last, &mut v);
        std::mem::swap(&mut v, &mut w);
    }
    Ok(top.max(0.0))
}
