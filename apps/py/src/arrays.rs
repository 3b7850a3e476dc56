//! Conversion between numpy arrays and Rust vectors.

use crate::error::Fault;
use arlequin::core::nalgebra::Point3;
use numpy::{AllowTypeChange, PyArray1, PyArray2, PyArrayLikeDyn, PyArrayMethods};
use pyo3::prelude::*;

/// Any object that numpy converts to numbers.
pub(crate) type Numbers<'py> = PyArrayLikeDyn<'py, f64, AllowTypeChange>;

/// Returns a vector as an array.
pub(crate) fn array(py: Python<'_>, values: Vec<f64>) -> Bound<'_, PyArray1<f64>> {
    PyArray1::from_vec(py, values)
}

/// Returns an array with rows of `columns` numbers.
pub(crate) fn rows(py: Python<'_>, values: Vec<f64>, columns: usize) -> PyResult<Bound<'_, PyArray2<f64>>> {
    // Nodes without rotations have rows of no columns, by which nothing can be divided.
    let count = values.len() / columns.max(1);
    PyArray1::from_vec(py, values).reshape([count, columns])
}

/// Returns all numbers of an array, in the order of their indices.
pub(crate) fn flat(from: &Numbers<'_>) -> Vec<f64> {
    from.as_array().iter().copied().collect()
}

/// Reads points \[m\] from an array with three columns, or from coordinates along x.
pub(crate) fn points(what: &str, from: &Numbers<'_>) -> Result<Vec<Point3<f64>>, Fault> {
    let (numbers, shape) = (flat(from), from.as_array().shape().to_vec());
    match shape.as_slice() {
        [_] => Ok(numbers.into_iter().map(|x| Point3::new(x, 0.0, 0.0)).collect()),
        [_, 3] => Ok(numbers
            .as_chunks::<3>()
            .0
            .iter()
            .map(|p| Point3::from(*p))
            .collect()),
        _ => Err(Fault::new(
            "SizeMismatch",
            format!("{what} have the shape {shape:?}; give (n, 3), or (n,) for points along x [m]"),
        )),
    }
}

/// Reads one point \[m\].
pub(crate) fn point(what: &str, from: &Numbers<'_>) -> Result<Point3<f64>, Fault> {
    let numbers = flat(from);
    match *numbers.as_slice() {
        [x] => Ok(Point3::new(x, 0.0, 0.0)),
        [x, y, z] => Ok(Point3::new(x, y, z)),
        _ => Err(Fault::new(
            "SizeMismatch",
            format!(
                "{what} has {} numbers; give x, y and z, or x alone [m]",
                numbers.len()
            ),
        )),
    }
}

/// Returns an array with one row of coordinates per point.
pub(crate) fn coordinates<'py>(
    py: Python<'py>,
    points: &[Point3<f64>],
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    rows(py, points.iter().flat_map(|p| [p.x, p.y, p.z]).collect(), 3)
}
