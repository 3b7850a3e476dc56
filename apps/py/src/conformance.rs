//! Conformance checks of the core for any model or solver.

use crate::arrays::{Numbers, points};
use crate::border::outside;
use crate::error::Fault;
use crate::models::NativeModel;
use crate::plug;
use crate::shapes::field_of;
use crate::solver::PythonSolver;
use arlequin::core::{Model, Uniform, conformance};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Calls `call` on a model of the library, or on a Python model with weights of one.
fn with(
    object: &Bound<'_, PyAny>,
    call: impl FnOnce(&mut dyn Model<f64>) -> Result<f64, Fault> + Send,
) -> PyResult<f64> {
    if let Ok(native) = object.cast::<NativeModel>() {
        let native = native.get();
        return outside(object.py(), || native.with(call));
    }
    let (mut model, _, callbacks) = plug::model(object)?;
    let answer = outside(object.py(), move || {
        // Models in Python expect weights before anything else.
        model.set_internal_weight(&Uniform(1.0))?;
        call(&mut *model)
    });
    callbacks.raised().map_or(answer, Err)
}

/// Largest force under a rigid motion, relative to the force under a random motion of `amplitude` [m]. The
/// rigid rotation is small, or half a radian for a law whose moments vanish about present positions.
#[pyfunction]
#[pyo3(signature = (model, amplitude = 1e-3))]
pub(crate) fn rigid_forces(model: &Bound<'_, PyAny>, amplitude: f64) -> PyResult<f64> {
    with(model, |m| Ok(conformance::rigid_forces(m, amplitude)?))
}

/// Largest relative difference between forces and the negative slope of the energy, at displacements of
/// `amplitude` [m].
#[pyfunction]
#[pyo3(signature = (model, amplitude = 1e-3))]
pub(crate) fn forces_derive_from_energy(model: &Bound<'_, PyAny>, amplitude: f64) -> PyResult<f64> {
    with(model, |m| {
        Ok(conformance::forces_derive_from_energy(m, amplitude)?)
    })
}

/// Largest relative asymmetry of the forces or of their slopes, at displacements of `amplitude` [m].
#[pyfunction]
#[pyo3(signature = (model, amplitude = 1e-3))]
pub(crate) fn symmetric_forces(model: &Bound<'_, PyAny>, amplitude: f64) -> PyResult<f64> {
    with(model, |m| Ok(conformance::symmetric_forces(m, amplitude)?))
}

/// Relative difference between the mass and the expected mass [kg]; very large if a mass is not positive.
#[pyfunction]
pub(crate) fn mass(model: &Bound<'_, PyAny>, expected: f64) -> PyResult<f64> {
    with(model, |m| Ok(conformance::mass(m, expected)?))
}

/// Defects of shape functions over points [m]: of their sum, of linear fields, of gradients, and the most
/// negative value.
#[pyfunction]
#[pyo3(signature = (field, points, gradients = false))]
pub(crate) fn shapes<'py>(
    py: Python<'py>,
    field: &Bound<'py, PyAny>,
    points: Numbers<'py>,
    gradients: bool,
) -> PyResult<Bound<'py, PyDict>> {
    let (field, positions) = (field_of(field)?, self::points("points", &points)?);
    let defects = outside(py, || Ok(conformance::shapes(&*field, &positions, gradients)?))?;
    let out = PyDict::new(py);
    out.set_item("unity", defects.unity)?;
    out.set_item("linear", defects.linear)?;
    out.set_item("gradient", defects.gradient)?;
    out.set_item("negative", defects.negative)?;
    Ok(out)
}

/// Kicks a solver and lets it make `steps` steps of `step` [s]. Returns the defects of all properties that
/// the coupling relies on.
#[pyfunction]
#[pyo3(signature = (solver, step, steps = 100))]
pub(crate) fn participant<'py>(
    py: Python<'py>,
    solver: &Bound<'py, PyAny>,
    step: f64,
    steps: usize,
) -> PyResult<Bound<'py, PyDict>> {
    let (mut solver, _, callbacks) = PythonSolver::from_object(solver)?;
    let result = outside(py, move || {
        Ok(conformance::participant(&mut solver, step, steps)?)
    });
    let defects = callbacks.raised().map_or(result, Err)?;
    let out = PyDict::new(py);
    out.set_item("travelled", defects.travelled)?;
    out.set_item("gained", defects.gained)?;
    out.set_item("kick", defects.kick)?;
    out.set_item("moved", defects.moved)?;
    out.set_item("drift", defects.drift)?;
    out.set_item("work", defects.work)?;
    out.set_item("resumed", defects.resumed)?;
    Ok(out)
}
