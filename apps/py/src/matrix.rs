//! Models written in Python as a stiffness matrix.

use crate::arrays::{Numbers, array};
use crate::error::Fault;
use crate::plug::{Described, as_described, inertia};
use arlequin::core::nalgebra::Point3;
use arlequin::core::sprs::CsMat;
use arlequin::core::{DofLayout, Error, LinearModel, Model, Result, Views, Weight, parallel};
use pyo3::prelude::*;

/// A model whose stiffness matrix comes from Python. Its forces `f = −K q` are computed in Rust.
pub(crate) struct MatrixModel {
    about: Described,
    stiffness: CsMat<f64>,
}

impl MatrixModel {
    pub(crate) fn new(about: Described) -> Self {
        let n = about.layout.dofs();
        // The matrix depends on the weights, which come later.
        let stiffness = CsMat::zero((n, n));
        Self { about, stiffness }
    }

    /// Returns row `i` of `K q`.
    fn row(&self, i: usize, q: &[f64]) -> f64 {
        let row = self.stiffness.outer_view(i);
        row.map_or(0.0, |r| r.iter().map(|(j, k)| k * q[j]).sum())
    }

    /// Asks the Python object for the stiffness matrix with the weights of its elements, bonds or nodes.
    fn matrix(&self, py: Python<'_>, shares: Vec<f64>) -> PyResult<CsMat<f64>> {
        let answer = self
            .about
            .object
            .call_method1(py, "stiffness", (array(py, shares),))?;
        let rows = py
            .import("arlequin.plug")?
            .getattr("_rows")?
            .call1((answer, &self.about.name))?;
        let (size, begin, columns, values): (usize, Vec<usize>, Vec<usize>, Numbers<'_>) = rows.extract()?;
        let (name, n) = (&self.about.name, self.about.layout.dofs());
        if size != n {
            let text = format!("stiffness of '{name}': expected {n} rows, found {size}");
            return Err(Fault::new("SizeMismatch", text).into());
        }
        let values = crate::arrays::flat(&values);
        CsMat::try_new((n, n), begin, columns, values).map_err(|(.., e)| {
            Fault::new(
                "InvalidParameter",
                format!("stiffness of '{name}': {e}; give a matrix in rows"),
            )
            .into()
        })
    }
}

/// Returns the largest `|K − Kᵀ|` over the largest `|K|`.
fn asymmetry(k: &CsMat<f64>) -> f64 {
    let top = |m: &CsMat<f64>| m.data().iter().fold(0.0_f64, |a, x| a.max(x.abs()));
    // Only matrices stored in the same order can be subtracted.
    let transposed = &k.transpose_view().to_csr();
    let apart = top(&(k - transposed));
    apart / top(k).max(f64::MIN_POSITIVE)
}

impl Model<f64> for MatrixModel {
    as_described!();

    fn lumped_inertia(&self, weight: &dyn Weight<f64>, out: &mut [f64]) -> Result<()> {
        inertia(&self.about, weight, out)
    }

    fn set_internal_weight(&mut self, alpha: &dyn Weight<f64>) -> Result<()> {
        let shares = self.about.shares(alpha);
        let stiffness = Python::attach(|py| self.matrix(py, shares));
        self.stiffness = stiffness.map_err(|e| self.about.raised(e))?;
        // Comparisons with NaN would pass below.
        if let Some(index) = self.stiffness.data().iter().position(|x| !x.is_finite()) {
            let what = format!("stiffness of '{}'", self.about.name);
            return Err(Error::NotFinite { what, index });
        }
        let apart = asymmetry(&self.stiffness);
        // Entries that a program sums in another order differ by round-off.
        if apart > 1e-9 {
            let name = format!("asymmetry of the stiffness of '{}'", self.about.name);
            let rule = "must be below 1e-9: forces without an energy gain or lose some; give (K + K.T)/2";
            return Err(arlequin::core::invalid(&name, format_args!("{apart:.1e}"), rule));
        }
        Ok(())
    }

    fn add_internal_forces(&mut self, q: &[f64], f: &mut [f64]) -> Result<()> {
        use rayon::prelude::*;
        // Every row is summed by one thread, so that the bits do not depend on their number.
        if parallel::pays(q.len()) {
            f.par_iter_mut()
                .enumerate()
                .with_min_len(1024)
                .for_each(|(i, f)| *f -= self.row(i, q));
        } else {
            f.iter_mut().enumerate().for_each(|(i, f)| *f -= self.row(i, q));
        }
        Ok(())
    }

    fn internal_energy(&self, q: &[f64]) -> f64 {
        let part = |range: std::ops::Range<usize>| range.map(|i| q[i] * self.row(i, q)).sum::<f64>();
        0.5 * parallel::sum(q.len(), &part)
    }

    fn views(&self) -> Views<'_, f64> {
        let mut views = Views::default();
        views.linear = Some(self);
        views
    }
}

impl LinearModel<f64> for MatrixModel {
    fn stiffness(&self) -> CsMat<f64> {
        self.stiffness.clone()
    }
}
