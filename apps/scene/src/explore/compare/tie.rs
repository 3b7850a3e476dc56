//! Constraints `G v = 0` and the multipliers that answer a jump.

use super::sparse::{add, congruence, product, transposed};
use crate::error::{Result, value};
use arlequin::core::adjacency::lowest_connected;
use arlequin::core::nalgebra::{DMatrix, DVector};
use arlequin::core::sprs::CsMat;

/// Largest dense block of the operator.
const MOST_MULTIPLIERS: usize = 1500;
/// Eigenvalues of `S` below this share of the largest count as zero.
const DEPENDENT: f64 = 1e-10;

/// Constraint with the multipliers `μ = R G v`.
#[derive(Debug, Clone)]
pub(super) struct Tie {
    /// `G`: one row per multiplier.
    pub(super) rows: CsMat<f64>,
    /// `Gᵀ`.
    back: CsMat<f64>,
    /// `R`, in dense blocks of multipliers that act on each other.
    blocks: Vec<(Vec<usize>, DMatrix<f64>)>,
}

impl Tie {
    /// Multipliers that meet the constraint: `R = S⁺` with `S = G W Gᵀ`.
    pub(super) fn exact(rows: CsMat<f64>, inverse: &[f64]) -> Result<Self> {
        let operator = congruence(&transposed(&rows), inverse);
        Self::by(rows, &operator, &pseudo_inverse)
    }

    /// Multipliers by a function of the blocks of `S`, or of a symmetric operator in its place.
    pub(super) fn by(
        rows: CsMat<f64>,
        operator: &CsMat<f64>,
        function: &dyn Fn(DMatrix<f64>) -> DMatrix<f64>,
    ) -> Result<Self> {
        let blocks = blocks(operator).into_iter().map(|members| {
            let n = members.len();
            if n > MOST_MULTIPLIERS {
                let rule = format!(
                    "exceeds {MOST_MULTIPLIERS}, beyond which the comparison, which solves densely, takes too long; take a \
                     coarser mediator or a smaller scene"
                );
                return Err(value("multipliers of a component", n, &rule));
            }
            let dense = DMatrix::from_fn(n, n, |a, b| {
                let entry = |i: usize, j: usize| operator.get(i, j).copied().unwrap_or(0.0);
                0.5 * (entry(members[a], members[b]) + entry(members[b], members[a]))
            });
            Ok((members, function(dense)))
        });
        Ok(Self {
            back: transposed(&rows),
            blocks: blocks.collect::<Result<_>>()?,
            rows,
        })
    }

    /// Returns the multipliers `R G v`.
    pub(super) fn answer(&self, v: &[f64]) -> Vec<f64> {
        let jump = product(&self.rows, v);
        let mut out = vec![0.0; jump.len()];
        for (members, r) in &self.blocks {
            let answer = r * DVector::from_iterator(members.len(), members.iter().map(|i| jump[*i]));
            members.iter().zip(answer.iter()).for_each(|(i, x)| out[*i] = *x);
        }
        out
    }

    /// Computes `W Gᵀ μ`.
    pub(super) fn push(&self, mu: &[f64], inverse: &[f64]) -> Vec<f64> {
        let mut out = product(&self.back, mu);
        out.iter_mut().zip(inverse).for_each(|(x, w)| *x *= w);
        out
    }

    /// Computes `W Gᵀ R G v`.
    pub(super) fn kick(&self, v: &[f64], inverse: &[f64]) -> Vec<f64> {
        self.push(&self.answer(v), inverse)
    }

    /// Subtracts `W Gᵀ R G v` from `v`.
    pub(super) fn project(&self, v: &mut [f64], inverse: &[f64]) {
        let change = self.kick(v, inverse);
        add(v, -1.0, &change);
    }

    /// Subtracts from forces `r` those of the multipliers that balance them: `r ← r − Gᵀ R G W r`.
    pub(super) fn balance(&self, r: &mut [f64], inverse: &[f64]) {
        let moved: Vec<f64> = r.iter().zip(inverse).map(|(r, w)| r * w).collect();
        add(r, -1.0, &product(&self.back, &self.answer(&moved)));
    }

    /// Multiplications of one answer.
    pub(super) fn work(&self) -> f64 {
        let entries = self.blocks.iter().flat_map(|(_, r)| r.iter());
        (2 * self.rows.nnz() + entries.filter(|x| **x != 0.0).count()) as f64
    }
}

/// Groups of rows that share no entry with each other; rows of zeros are in none.
fn blocks(a: &CsMat<f64>) -> Vec<Vec<usize>> {
    // Products of unlike components leave zeros.
    let entries = a.iter().filter(|(v, _)| **v != 0.0);
    let pairs = entries.map(|(_, (i, j))| [i as u32, j as u32]);
    let mut out = vec![Vec::new(); a.rows()];
    let lowest = lowest_connected(a.rows(), pairs).into_iter().enumerate();
    lowest.for_each(|(i, first)| out[first as usize].push(i));
    out.retain(|members| members.iter().any(|i| a.get(*i, *i).is_some_and(|s| *s != 0.0)));
    out
}

/// Inverse of a matrix; of dependent rows, the inverse of the eigenvalues that are not zero.
pub(super) fn pseudo_inverse(a: DMatrix<f64>) -> DMatrix<f64> {
    if let Some(factor) = a.clone().cholesky() {
        let pivots = factor.l_dirty().diagonal();
        if pivots.min().powi(2) > DEPENDENT.sqrt() * pivots.max().powi(2) {
            return factor.inverse();
        }
    }
    of_eigenvalues(a, &|s, _| 1.0 / s)
}

/// Applies a function of an eigenvalue and the largest one to the eigenvalues that are not zero.
pub(super) fn of_eigenvalues(a: DMatrix<f64>, f: &dyn Fn(f64, f64) -> f64) -> DMatrix<f64> {
    let eigen = a.symmetric_eigen();
    let top = eigen.eigenvalues.max();
    let function = |s: f64| if s > DEPENDENT * top { f(s, top) } else { 0.0 };
    let values = DMatrix::from_diagonal(&eigen.eigenvalues.map(function));
    &eigen.eigenvectors * values * eigen.eigenvectors.transpose()
}
