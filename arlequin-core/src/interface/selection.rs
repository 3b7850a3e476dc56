//! Choice of independent multipliers by Cholesky's method with complete pivoting.
//!
//! In every step the multiplier enters whose row of `B` is farthest from those chosen before, in the norm of
//! `M⁻¹`: its remaining pivot is the square of that distance. When the largest remaining pivot is round-off,
//! all other rows are combinations of the chosen ones. An order without pivoting cannot tell: pivots just
//! above any limit divide round-off, which then grows from row to row (decision 0030).

use crate::Real;
use sprs::CsMat;

/// Largest number of rows of which a dense matrix is made: 128 MB, a second.
const DENSE: usize = 4096;
/// Largest number of multiplications of a selection from more rows: some twenty seconds.
const MOST_WORK: usize = 10_000_000_000;

/// Independent multipliers and those that depend on them.
#[derive(Debug)]
pub(super) struct Selection<T> {
    /// Rows, ascending.
    pub(super) kept: Vec<usize>,
    /// Rows, ascending, each with its remaining pivot.
    pub(super) dropped: Vec<(usize, T)>,
}

/// Selects rows of a positive semidefinite matrix with a diagonal of ones until all remaining pivots are at
/// or below `limit`. `None` if that takes too long.
pub(super) fn select<T: Real>(scaled: &CsMat<T>, limit: T) -> Option<Selection<T>> {
    match scaled.rows() <= DENSE {
        true => select_dense(scaled, limit),
        false => select_sparse(scaled, limit),
    }
}

/// Selects by a dense factor. Factors fill up, and dense blocks take a twentieth of the time of single
/// entries.
fn select_dense<T: Real>(scaled: &CsMat<T>, limit: T) -> Option<Selection<T>> {
    let n = scaled.rows();
    let mut factor = vec![T::zero(); n * n];
    scaled.iter().for_each(|(v, (i, j))| factor[j * n + i] = *v);
    let diagonal: Vec<T> = (0..n).map(|i| factor[i * n + i]).collect();
    let (order, rank) = T::pivoted_cholesky(n, &mut factor)?;
    // Pivots fall from column to column.
    let count = (0..rank).find(|k| factor[k * n + k] * factor[k * n + k] <= limit);
    let (chosen, others) = order.split_at(count.unwrap_or(rank));
    let mut selection = Selection {
        kept: chosen.to_vec(),
        dropped: others.iter().map(|i| (*i, diagonal[*i])).collect(),
    };
    for column in factor.chunks_exact(n).take(chosen.len()) {
        let entries = &column[chosen.len()..];
        let pivots = selection.dropped.iter_mut().zip(entries);
        pivots.for_each(|((_, pivot), v)| *pivot -= *v * *v);
    }
    selection.kept.sort_unstable();
    selection.dropped.sort_unstable_by_key(|d| d.0);
    Some(selection)
}

/// Selects by a sparse factor, for more rows than a dense matrix should have.
fn select_sparse<T: Real>(scaled: &CsMat<T>, limit: T) -> Option<Selection<T>> {
    let n = scaled.rows();
    let mut pivot: Vec<T> = (0..n)
        .map(|i| scaled.get(i, i).copied().unwrap_or_else(T::zero))
        .collect();
    let mut open = vec![true; n];
    // The factor by columns, and where each row's entries stand in them.
    let mut columns: Vec<Vec<(u32, T)>> = Vec::new();
    let mut entries: Vec<Vec<(u32, T)>> = vec![Vec::new(); n];
    let (mut column, mut work) = (vec![T::zero(); n], 0);
    while let Some(p) = largest(&pivot, &open).filter(|p| pivot[*p] > limit) {
        let row = scaled.outer_view(p)?;
        row.iter().for_each(|(i, v)| column[i] = *v);
        for (k, factor) in std::mem::take(&mut entries[p]) {
            let known = &mut columns[k as usize];
            // Rows that were chosen since are of no use any more.
            known.retain(|(i, _)| open[*i as usize]);
            known.iter().for_each(|(i, v)| column[*i as usize] -= factor * *v);
            work += known.len();
        }
        // Never ended by Ctrl-C: a change of weights would then solve in another way, and the run that goes
        // on from its checkpoint would have other last digits.
        if work > MOST_WORK {
            return None;
        }
        open[p] = false;
        let root = pivot[p].sqrt();
        let mut fresh = Vec::new();
        for (i, v) in column.iter_mut().enumerate() {
            let value = std::mem::replace(v, T::zero()) / root;
            if open[i] && value.abs() > T::zero() {
                pivot[i] -= value * value;
                entries[i].push((columns.len() as u32, value));
                fresh.push((i as u32, value));
            }
        }
        columns.push(fresh);
    }
    let kept = (0..n).filter(|i| !open[*i]).collect();
    let dropped = (0..n).filter(|i| open[*i]).map(|i| (i, pivot[i])).collect();
    Some(Selection { kept, dropped })
}

/// Returns the open row with the largest pivot, the first of equals.
fn largest<T: Real>(pivot: &[T], open: &[bool]) -> Option<usize> {
    let rows = (0..pivot.len()).filter(|i| open[*i]);
    rows.reduce(|best, i| if pivot[i] > pivot[best] { i } else { best })
}

#[cfg(test)]
mod tests {
    use super::*;
    use sprs::TriMat;

    /// Returns `B Bᵀ` scaled to a unit diagonal, where `B` has hat functions on `columns` nodes.
    fn operator(rows: usize, columns: usize) -> CsMat<f64> {
        let entry = |i: usize, j: usize| {
            let x = (i as f64 + 0.5) / rows as f64 * (columns - 1) as f64;
            (1.0 - (x - j as f64).abs()).max(0.0)
        };
        let product = |i: usize, k: usize| (0..columns).map(|j| entry(i, j) * entry(k, j)).sum::<f64>();
        let mut t = TriMat::new((rows, rows));
        for (i, k) in (0..rows).flat_map(|i| (0..rows).map(move |k| (i, k))) {
            let value = product(i, k);
            if value > 0.0 {
                t.add_triplet(i, k, value / (product(i, i) * product(k, k)).sqrt());
            }
        }
        t.to_csc()
    }

    #[test]
    fn as_many_rows_are_kept_as_are_independent_and_they_are_well_conditioned() {
        for (rows, columns) in [(30, 60), (60, 20), (400, 50), (1000, 200)] {
            let s = operator(rows, columns);
            for choose in [select_dense, select_sparse] {
                let Selection { kept, dropped } = choose(&s, 1e-8).unwrap();
                assert_eq!(kept.len(), rows.min(columns), "{rows} rows of {columns}");
                assert_eq!(kept.len() + dropped.len(), rows);
                assert!(dropped.iter().all(|d| d.1.abs() <= 1e-8), "{dropped:?}");
                let n = kept.len();
                let mut dense = vec![0.0; n * n];
                for (a, i) in kept.iter().enumerate() {
                    for (b, k) in kept.iter().enumerate() {
                        dense[a * n + b] = s.get(*i, *k).copied().unwrap_or(0.0);
                    }
                }
                let values = f64::symmetric_eigen(n, &dense).unwrap().values;
                let [low, high] = [values[0], values[n - 1]];
                assert!(high < 1e5 * low, "{low:e} to {high:e}");
            }
        }
    }

    /// Ctrl-C may come in the middle of a change of weights, whose result is in the checkpoint.
    #[test]
    fn a_request_to_end_the_run_changes_no_selection() {
        let s = operator(60, 20);
        crate::interrupt::listen(|| true);
        assert!(crate::interrupt::is_requested());
        assert_eq!(select(&s, 1e-8).map(|s| s.kept.len()), Some(20));
    }

    #[test]
    fn rows_without_entries_are_dropped() {
        let mut t = TriMat::new((4, 4));
        for i in [0, 2, 3] {
            t.add_triplet(i, i, 1.0);
        }
        t.add_triplet(2, 3, 1.0);
        t.add_triplet(3, 2, 1.0);
        for choose in [select_dense, select_sparse] {
            let Selection { kept, dropped } = choose(&t.to_csc::<usize>(), 1e-8).unwrap();
            assert_eq!(kept, [0, 2]);
            assert_eq!(dropped, [(1, 0.0), (3, 0.0)]);
        }
    }
}
