//! Direct solvers behind small object-safe traits: sparse Cholesky, sparse LU, dense symmetric eigenvalues.

mod panels;

use crate::{Error, Real, Result, dissection};
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt_pivoting;
use faer::linalg::solvers::{LltError, Solve};
use faer::perm::PermRef;
use faer::sparse::linalg::cholesky::{
    self, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering, supernodal::SupernodalLdltRef,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::traits::RealField;
use faer::{MatMut, MatRef, Par, Side};
use nalgebra::Point3;
use panels::{Diagonal, Factor};
use sprs::{CsMat, TriMat};

/// A factor of a symmetric positive definite matrix that solves in place without allocating.
pub trait SpdFactor<T>: Send + std::fmt::Debug {
    /// Overwrites right-hand sides, stored one after another in `b`, with the solutions. Three of them take
    /// hardly longer than one.
    fn solve(&mut self, b: &mut [T]);
    /// Number of rows.
    fn size(&self) -> usize;
    /// Stored entries of the factor.
    fn nonzeros(&self) -> usize;
}

/// A factor of a general square matrix.
pub trait SquareFactor<T>: Send + std::fmt::Debug {
    /// Overwrites the right-hand side `b` with the solution; may allocate.
    fn solve(&self, b: &mut [T]);
}

/// Spectrum of a dense symmetric matrix.
#[derive(Debug, Clone)]
pub struct DenseEigen<T> {
    /// Eigenvalues, ascending.
    pub values: Vec<T>,
    /// Eigenvectors, column major: vector `k` is `vectors[k * n..(k + 1) * n]`.
    pub vectors: Vec<T>,
}

/// Converts a matrix to compressed columns unless it has this storage already.
fn columns<T: Clone + Default>(matrix: &CsMat<T>) -> CsMat<T> {
    if matrix.is_csc() {
        matrix.clone()
    } else {
        matrix.to_csc()
    }
}

fn view<'a, T>(matrix: &'a CsMat<T>, starts: &'a [usize]) -> SparseColMatRef<'a, usize, T> {
    let symbolic =
        SymbolicSparseColMatRef::new_checked(matrix.rows(), matrix.cols(), starts, None, matrix.indices());
    SparseColMatRef::new(symbolic, matrix.data())
}

/// Number of entries that the Cholesky factor of a symmetric matrix will have; `usize::MAX` if that cannot be
/// computed.
pub(crate) fn cholesky_entries<T: Real>(matrix: &CsMat<T>) -> usize {
    let matrix = columns(matrix);
    let starts = matrix.indptr().to_proper().to_vec();
    symbolic(&view(&matrix, &starts), None).map_or(usize::MAX, |s| s.len_val())
}

/// Symbolic factor in an order of elimination, by default that of approximate minimum degree.
fn symbolic<T>(
    a: &SparseColMatRef<'_, usize, T>,
    order: Option<&[usize]>,
) -> Option<SymbolicCholesky<usize>> {
    let mut place = vec![0; order.map_or(0, <[usize]>::len)];
    let order = order.map_or(SymmetricOrdering::Amd, |order| {
        order.iter().enumerate().for_each(|(k, i)| place[*i] = k);
        SymmetricOrdering::Custom(PermRef::new_checked(order, &place, order.len()))
    });
    cholesky::factorize_symbolic_cholesky(a.symbolic(), Side::Lower, order, Default::default()).ok()
}

pub(crate) fn cholesky<T: Real + RealField>(
    matrix: &CsMat<T>,
    places: Option<&[Point3<T>]>,
) -> Result<Box<dyn SpdFactor<T>>> {
    let size = matrix.rows();
    let broken = |pivot| Error::NotPositiveDefinite { pivot, size };
    let finite = |v| nalgebra::ComplexField::is_finite(v);
    // A NaN passes through a factorisation without an error: it is refused by its own check.
    if !matrix.data().iter().all(finite) {
        return Err(broken(0));
    }
    let matrix = columns(matrix);
    let starts = matrix.indptr().to_proper().to_vec();
    let a = view(&matrix, &starts);
    let places = places.filter(|p| p.len() == size);
    let order = places.map(|p| dissection::order(&matrix, p));
    let symbolic = symbolic(&a, order.as_deref()).ok_or_else(|| broken(size))?;
    let mut values = vec![T::default(); symbolic.len_val()];
    let (side, par) = (Side::Lower, Par::Seq);
    let scratch = symbolic.factorize_numeric_llt_scratch::<T>(par, Default::default());
    let (mut memory, params) = (MemBuffer::new(scratch), Default::default());
    let stack = MemStack::new(&mut memory);
    symbolic
        .factorize_numeric_llt(&mut values, a, side, Default::default(), par, stack, params)
        .map_err(|LltError::NonPositivePivot { index }| broken(index))?;
    Ok(Box::new(Factor::new(&symbolic, values, Diagonal::Roots)))
}

pub(crate) fn quasi_definite<T: Real + RealField>(
    matrix: &CsMat<T>,
    places: &[Point3<T>],
    positive: usize,
    least: T,
) -> Option<Box<dyn SpdFactor<T>>> {
    // A NaN passes through a factorisation without an error.
    let finite = |v| nalgebra::ComplexField::is_finite(v);
    if places.len() != matrix.rows() || !matrix.data().iter().all(finite) {
        return None;
    }
    let matrix = columns(matrix);
    let starts = matrix.indptr().to_proper().to_vec();
    let a = view(&matrix, &starts);
    let symbolic = symbolic(&a, Some(&dissection::order(&matrix, places)))?;
    let values = ldlt(&symbolic, &a)?;
    let pivots = pivots(&symbolic, &values);
    let count = pivots.iter().filter(|d| **d >= least).count();
    let negative = pivots.iter().filter(|d| **d < T::zero()).count();
    if count != positive || negative != pivots.len() - positive {
        return None;
    }
    Some(Box::new(Factor::new(&symbolic, values, Diagonal::Pivots)))
}

/// Values of a factor `L D Lᵀ`; `None` if a pivot vanishes.
fn ldlt<T: Real + RealField>(
    symbolic: &SymbolicCholesky<usize>,
    a: &SparseColMatRef<'_, usize, T>,
) -> Option<Vec<T>> {
    let mut values = vec![T::default(); symbolic.len_val()];
    let (side, par) = (Side::Lower, Par::Seq);
    let mut memory = MemBuffer::new(symbolic.factorize_numeric_ldlt_scratch::<T>(par, Default::default()));
    let (stack, params) = (MemStack::new(&mut memory), Default::default());
    symbolic
        .factorize_numeric_ldlt(&mut values, *a, side, Default::default(), par, stack, params)
        .ok()?;
    Some(values)
}

/// Diagonal of `D`, in the order of elimination.
fn pivots<T: Real + RealField>(symbolic: &SymbolicCholesky<usize>, values: &[T]) -> Vec<T> {
    // Both layouts of the factor store `D` on the diagonal of `L`.
    match symbolic.raw() {
        SymbolicCholeskyRaw::Simplicial(s) => {
            let starts = &s.col_ptr()[..symbolic.nrows()];
            starts.iter().map(|k| values[*k]).collect()
        }
        SymbolicCholeskyRaw::Supernodal(s) => {
            let factor = SupernodalLdltRef::new(s, values);
            let blocks = (0..s.n_supernodes()).map(|k| factor.supernode(k).val());
            blocks
                .flat_map(|b| (0..b.ncols()).map(move |i| b[(i, i)]))
                .collect()
        }
    }
}

/// Rows whose pivots are negative in a factorisation `L D Lᵀ` of `A − shift · I`; `None` if the factorisation
/// breaks down.
pub(crate) fn negative_pivots<T: Real + RealField>(matrix: &CsMat<T>, shift: T) -> Option<Vec<usize>> {
    let n = matrix.rows();
    // An empty row has no diagonal entry to subtract the shift from: add one to every row.
    let mut moved = TriMat::with_capacity((n, n), matrix.nnz() + n);
    matrix.iter().for_each(|(v, (i, j))| moved.add_triplet(i, j, *v));
    (0..n).for_each(|i| moved.add_triplet(i, i, -shift));
    let moved: CsMat<T> = moved.to_csc();
    if !moved.data().iter().all(|v| nalgebra::ComplexField::is_finite(v)) {
        return None;
    }
    let starts = moved.indptr().to_proper().to_vec();
    let a = view(&moved, &starts);
    // By Sylvester's law of inertia, there are as many negative pivots as eigenvalues of `A` below `shift`.
    let symbolic = symbolic(&a, None)?;
    let pivots = pivots(&symbolic, &ldlt(&symbolic, &a)?);
    // Pivots come in the order of elimination: map them back to rows.
    let order = symbolic.perm().map(|p| p.arrays().0.to_vec());
    let row = |k: usize| order.as_ref().map_or(k, |o| o[k]);
    // Signs only: values of small pivots are round-off, their number is Sylvester's.
    let negative = pivots.iter().enumerate().filter(|(_, d)| **d < T::zero());
    Some(negative.map(|(k, _)| row(k)).collect())
}

struct Lu<T>(faer::sparse::linalg::solvers::Lu<usize, T>);

impl<T> std::fmt::Debug for Lu<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Lu")
    }
}

impl<T: RealField + Send + Sync> SquareFactor<T> for Lu<T> {
    fn solve(&self, b: &mut [T]) {
        let n = b.len();
        self.0
            .solve_in_place(MatMut::from_column_major_slice_mut(b, n, 1));
    }
}

pub(crate) fn lu<T: Real + RealField>(matrix: &CsMat<T>) -> Result<Box<dyn SquareFactor<T>>> {
    let matrix = columns(matrix);
    let starts = matrix.indptr().to_proper().to_vec();
    let a = view(&matrix, &starts);
    let factor = a.sp_lu().map_err(|_| Error::SingularSystem {
        size: a.nrows(),
        residual: f64::NAN,
        free: String::new(),
    })?;
    Ok(Box::new(Lu(factor)))
}

pub(crate) fn pivoted_cholesky<T: Real + RealField>(
    n: usize,
    column_major: &mut [T],
) -> Option<(Vec<usize>, usize)> {
    let (mut order, mut places) = (vec![0; n], vec![0; n]);
    // On one thread: the bits of a run must not depend on the number of threads.
    let scratch =
        llt_pivoting::factor::cholesky_in_place_scratch::<usize, T>(n, Par::Seq, Default::default());
    let (info, _) = llt_pivoting::factor::cholesky_in_place(
        MatMut::from_column_major_slice_mut(column_major, n, n),
        &mut order,
        &mut places,
        Par::Seq,
        MemStack::new(&mut MemBuffer::new(scratch)),
        Default::default(),
    )
    .ok()?;
    Some((order, info.rank))
}

pub(crate) fn symmetric_eigen<T: Real + RealField>(n: usize, column_major: &[T]) -> Result<DenseEigen<T>> {
    let singular = || Error::SingularSystem {
        size: n,
        residual: f64::NAN,
        free: String::new(),
    };
    if column_major.iter().any(|v| !nalgebra::ComplexField::is_finite(v)) {
        return Err(singular());
    }
    let a = MatRef::from_column_major_slice(column_major, n, n);
    let eigen = a.self_adjoint_eigen(Side::Lower).map_err(|_| singular())?;
    let (s, u) = (eigen.S(), eigen.U());
    Ok(DenseEigen {
        values: (0..n).map(|k| s[k]).collect(),
        vectors: (0..n).flat_map(|k| (0..n).map(move |i| u[(i, k)])).collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_abs_diff_eq;

    fn laplacian(n: usize) -> CsMat<f64> {
        let mut t = TriMat::new((n, n));
        for i in 0..n {
            t.add_triplet(i, i, 2.0);
            if i > 0 {
                t.add_triplet(i, i - 1, -1.0);
                t.add_triplet(i - 1, i, -1.0);
            }
        }
        t.to_csr()
    }

    #[test]
    fn cholesky_and_lu_solve_the_laplacian() {
        let a = laplacian(50);
        let x: Vec<f64> = (0..50).map(|i| f64::from(i).sin()).collect();
        let b = &a * &sprs::CsVec::new(50, (0..50).collect(), x.clone());
        let mut b1 = vec![0.0; 50];
        b.iter().for_each(|(i, v)| b1[i] = *v);
        let mut b2 = b1.clone();
        f64::cholesky(&a, None).unwrap().solve(&mut b1);
        f64::lu(&a).unwrap().solve(&mut b2);
        for i in 0..50 {
            assert!((b1[i] - x[i]).abs() < 1e-12 && (b2[i] - x[i]).abs() < 1e-12);
        }
    }

    #[test]
    fn indefinite_matrix_is_refused_with_its_pivot() {
        let mut t = TriMat::new((2, 2));
        t.add_triplet(0, 0, 1.0);
        t.add_triplet(1, 1, -1.0);
        let e = f64::cholesky(&t.to_csr(), None).unwrap_err();
        assert!(matches!(e, Error::NotPositiveDefinite { size: 2, .. }), "{e}");
    }

    /// Cube of nodes with `unknowns` each, every one tied to those of all 26 neighbours, as in hexahedra.
    fn solid(across: usize, unknowns: usize) -> (CsMat<f64>, Vec<Point3<f64>>) {
        let nodes = across.pow(3);
        let cell = |k: usize| [k % across, k / across % across, k / across / across];
        let mut t = TriMat::new((nodes * unknowns, nodes * unknowns));
        for i in 0..nodes {
            let near = |c: usize| cell(i)[c].saturating_sub(1)..(cell(i)[c] + 2).min(across);
            for (x, y, z) in near(0).flat_map(|x| near(1).flat_map(move |y| near(2).map(move |z| (x, y, z))))
            {
                let j = x + across * (y + across * z);
                for (a, b) in (0..unknowns).flat_map(|a| (0..unknowns).map(move |b| (a, b))) {
                    let value = if i == j && a == b { 100.0 } else { -1.0 };
                    t.add_triplet(i * unknowns + a, j * unknowns + b, value);
                }
            }
        }
        let place = |k: usize| Point3::from(cell(k / unknowns).map(|x| x as f64));
        (t.to_csc(), (0..nodes * unknowns).map(place).collect())
    }

    #[test]
    fn nested_dissection_fills_less_than_minimum_degree_in_a_solid() {
        for (across, unknowns) in [(21, 3), (24, 1)] {
            let (matrix, places) = solid(across, unknowns);
            let starts = matrix.indptr().to_proper().to_vec();
            let order = dissection::order(&matrix, &places);
            let dissected = symbolic(&view(&matrix, &starts), Some(&order)).unwrap().len_val();
            let degree = cholesky_entries(&matrix);
            println!("{across}, {unknowns}: {:.3}", dissected as f64 / degree as f64);
            assert!(10 * dissected < 9 * degree, "{dissected} against {degree}");
        }
    }

    #[test]
    fn a_factor_in_an_order_of_places_solves_and_places_of_another_number_are_ignored() {
        let (matrix, places) = solid(6, 3);
        let x: Vec<f64> = (0..matrix.rows()).map(|i| (i as f64).sin()).collect();
        let mut b = vec![0.0; x.len()];
        matrix.iter().for_each(|(v, (i, j))| b[i] += v * x[j]);
        for places in [Some(&places[..]), Some(&places[1..]), None] {
            let mut solved = b.clone();
            f64::cholesky(&matrix, places).unwrap().solve(&mut solved);
            let apart = solved
                .iter()
                .zip(&x)
                .fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()));
            assert!(apart < 1e-12, "{apart:e}");
        }
    }

    #[test]
    fn a_quasi_definite_factor_is_given_only_with_the_pivots_that_are_expected() {
        // Two springs to the ground, tied by one multiplier.
        let system = |k: f64, compliance: f64| -> CsMat<f64> {
            let mut t = TriMat::new((3, 3));
            let entries = [
                (0, 0, k),
                (1, 1, 2.0),
                (2, 2, -compliance),
                (0, 2, 1.0),
                (1, 2, -1.0),
            ];
            for (i, j, v) in entries {
                t.add_triplet(i, j, v);
                if i != j {
                    t.add_triplet(j, i, v);
                }
            }
            t.to_csr()
        };
        let places: Vec<_> = (0..3).map(|k| Point3::new(f64::from(k), 0.0, 0.0)).collect();
        let factor = |k, c, positive| f64::quasi_definite(&system(k, c), &places, positive, 1e-6);
        let mut b = [1.0, 0.0, 0.0];
        factor(1.0, 1e-14, 2).unwrap().solve(&mut b);
        let third = 1.0 / 3.0;
        assert!(
            (b[0] - third).abs() < 1e-12 && (b[1] - third).abs() < 1e-12,
            "{b:?}"
        );
        assert!((b[2] - 2.0 * third).abs() < 1e-12, "{b:?}");
        assert!(factor(1.0, 1e-14, 3).is_none(), "two pivots are positive");
        assert!(factor(1e-7, 1e-14, 2).is_none(), "a small pivot");
        assert!(factor(-3.0, 1e-14, 2).is_none(), "an indefinite block");
        assert!(factor(0.0, 0.0, 2).is_none(), "no pivot");
        assert!(f64::quasi_definite(&system(1.0, 1.0), &places[1..], 2, 1e-6).is_none());
    }

    #[test]
    fn negative_pivots_count_the_eigenvalues_below_a_shift() {
        // Few rows are factored one by one, many in dense blocks.
        for n in [12, 400] {
            let a = laplacian(n);
            let value = |k: usize| 2.0 - 2.0 * (k as f64 * std::f64::consts::PI / (n + 1) as f64).cos();
            for below in [0, 1, 5, n / 2, n] {
                // Between two of them, and not in the middle: there a diagonal would vanish.
                let shift = 0.4 * value(below) + 0.6 * value(below + 1);
                let rows = f64::negative_pivots(&a, shift).unwrap();
                assert_eq!(rows.len(), below, "{n} rows, shift {shift}");
            }
        }
        // B Bᵀ of 300 rows and rank 90: dense, as an operator of multipliers often is.
        let b = |i: usize, j: usize| ((i * 37 + j * 101) as f64).sin() + if i % 90 == j { 3.0 } else { 0.0 };
        let mut t = TriMat::new((300, 300));
        for (i, j) in (0..300).flat_map(|i| (0..300).map(move |j| (i, j))) {
            t.add_triplet(i, j, (0..90).map(|k| b(i, k) * b(j, k)).sum());
        }
        let rows = f64::negative_pivots(&t.to_csc(), 1e-8).unwrap();
        assert_eq!(rows.len(), 210);
        assert!(rows.iter().all(|r| *r < 300));
    }

    #[test]
    fn eigenvalues_of_the_laplacian() {
        let n = 12;
        let dense: Vec<f64> = laplacian(n).to_dense().iter().copied().collect();
        let e = f64::symmetric_eigen(n, &dense).unwrap();
        for (k, v) in e.values.iter().enumerate() {
            let exact = 2.0 - 2.0 * ((k + 1) as f64 * std::f64::consts::PI / (n + 1) as f64).cos();
            assert_abs_diff_eq!(*v, exact, epsilon = 1e-13);
        }
    }
}
