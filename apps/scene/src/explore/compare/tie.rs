//! Constraints `G v = 0` and the multipliers that answer a jump.

use super::sparse::{add_product, congruence, product, transposed};
use crate::error::{Result, value};
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
    pub(super) back: CsMat<f64>,
    response: Response,
}

/// The matrix `R`.
#[derive(Debug, Clone)]
enum Response {
    /// Dense blocks of multipliers that act on each other.
    Blocks(Vec<(Vec<usize>, DMatrix<f64>)>),
    /// One number per multiplier.
    Diagonal(Vec<f64>),
}

impl Tie {
    /// Multipliers that meet the constraint: `R = S⁺` with `S = G W Gᵀ`.
    pub(super) fn exact(rows: CsMat<f64>, inverse: &[f64]) -> Result<Self> {
        let operator = congruence(&transposed(&rows), inverse);
        Self::responding(rows, &operator, &pseudo_inverse)
    }

    /// Multipliers by a function of the blocks of a symmetric operator in place of `S`.
    pub(super) fn responding(
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
            response: Response::Blocks(blocks.collect::<Result<_>>()?),
            rows,
        })
    }

    /// Multipliers by the row sums of `S`.
    pub(super) fn lumped(rows: CsMat<f64>, inverse: &[f64]) -> Self {
        let operator = congruence(&transposed(&rows), inverse);
        let sums = product(&operator, &vec![1.0; rows.rows()]);
        let response = sums.into_iter().map(|s| if s > 0.0 { 1.0 / s } else { 0.0 });
        Self {
            back: transposed(&rows),
            response: Response::Diagonal(response.collect()),
            rows,
        }
    }

    /// Returns `R b`.
    pub(super) fn solve(&self, b: &[f64]) -> Vec<f64> {
        match &self.response {
            Response::Diagonal(d) => b.iter().zip(d).map(|(b, d)| b * d).collect(),
            Response::Blocks(blocks) => {
                let mut out = vec![0.0; b.len()];
                for (members, r) in blocks {
                    let part = DVector::from_iterator(members.len(), members.iter().map(|i| b[*i]));
                    let answer = r * part;
                    members.iter().zip(answer.iter()).for_each(|(i, x)| out[*i] = *x);
                }
                out
            }
        }
    }

    /// Computes `W Gᵀ R G v`.
    pub(super) fn kick(&self, v: &[f64], inverse: &[f64]) -> Vec<f64> {
        let mu = self.solve(&product(&self.rows, v));
        self.push(&mu, inverse)
    }

    /// Computes `W Gᵀ μ`.
    pub(super) fn push(&self, mu: &[f64], inverse: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; inverse.len()];
        add_product(&self.back, mu, 1.0, 0..inverse.len(), &mut out);
        out.iter_mut().zip(inverse).for_each(|(x, w)| *x *= w);
        out
    }

    /// Subtracts `W Gᵀ R G v` from `v`.
    pub(super) fn project(&self, v: &mut [f64], inverse: &[f64]) {
        let change = self.kick(v, inverse);
        v.iter_mut().zip(&change).for_each(|(v, c)| *v -= c);
    }

    /// Subtracts from forces `r` those of the multipliers that balance them: `r ← r − Gᵀ R G W r`.
    pub(super) fn balance(&self, r: &mut [f64], inverse: &[f64]) {
        let moved: Vec<f64> = r.iter().zip(inverse).map(|(r, w)| r * w).collect();
        let mu = self.solve(&product(&self.rows, &moved));
        add_product(&self.back, &mu, -1.0, 0..r.len(), r);
    }

    /// Multiplications of one answer.
    pub(super) fn work(&self) -> f64 {
        let inner = match &self.response {
            Response::Diagonal(d) => d.len(),
            Response::Blocks(blocks) => blocks.iter().map(|b| b.0.len() * b.0.len()).sum(),
        };
        (2 * self.rows.nnz() + inner) as f64
    }
}

/// Groups of rows that share no entry with each other.
fn blocks(a: &CsMat<f64>) -> Vec<Vec<usize>> {
    let n = a.rows();
    let mut group = vec![usize::MAX; n];
    let mut out = Vec::new();
    for first in 0..n {
        if group[first] != usize::MAX {
            continue;
        }
        let (mut members, mut next) = (vec![first], 0);
        group[first] = out.len();
        while next < members.len() {
            let row = a.outer_view(members[next]);
            for (j, v) in row.iter().flat_map(|r| r.iter()) {
                // Products of unlike components leave zeros.
                if *v != 0.0 && group[j] == usize::MAX {
                    group[j] = out.len();
                    members.push(j);
                }
            }
            next += 1;
        }
        members.sort_unstable();
        out.push(members);
    }
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
    let values = eigen
        .eigenvalues
        .map(|s| if s > DEPENDENT * top { f(s, top) } else { 0.0 });
    let scaled = DMatrix::from_fn(values.len(), values.len(), |i, j| {
        eigen.eigenvectors[(i, j)] * values[j]
    });
    scaled * eigen.eigenvectors.transpose()
}
