//! Whole solvers written in Python as participants.

use crate::arrays::array;
use crate::border::{Callbacks, Claim};
use crate::error::Fault;
use crate::plug::{Described, as_described, optional, restored, saved};
use arlequin::core::nalgebra::Point3;
use arlequin::core::snapshot::Record;
use arlequin::core::{DofLayout, Error, Interpolation, Participant, Result, Weights};
use numpy::PyArray1;
use pyo3::prelude::*;
use std::sync::Arc;

/// Weights of a solver: means over the elements of its mesh or over its bonds, or values at its nodes.
#[pyclass(frozen, get_all, module = "arlequin")]
#[derive(Debug)]
pub(crate) struct Shares {
    /// Weights of internal energy.
    internal: Py<PyArray1<f64>>,
    /// Weights of kinetic energy.
    kinetic: Py<PyArray1<f64>>,
    /// Weights of external work.
    external: Py<PyArray1<f64>>,
}

/// A solver whose methods are written in Python.
pub(crate) struct PythonSolver {
    _claim: Claim,
    about: Described,
}

impl PythonSolver {
    /// Returns a solver, its field, and its Python objects.
    pub(crate) fn from_object(
        object: &Bound<'_, PyAny>,
    ) -> PyResult<(Self, Arc<dyn Interpolation<f64>>, Callbacks)> {
        let about = Described::from_object(object)?;
        let needed = ["weigh", "advance", "velocities", "displacements", "kick"];
        about.needs(object.py(), &needed)?;
        let (field, callbacks) = (about.field.clone(), about.callbacks());
        let solver = Self {
            _claim: Claim::new(&about.name, &about.object)?,
            about,
        };
        Ok((solver, field, callbacks))
    }

    /// Reads the answer of a method without arguments. If the method fails, its exception waits and all
    /// values are NaN.
    fn read_answer(&self, method: &str, out: &mut [f64]) {
        let result = Python::attach(|py| {
            let answer = self.about.object.call_method0(py, method)?;
            self.about.read(method, answer.bind(py), out, |o, x| *o = x)
        });
        if let Err(e) = result {
            self.about.pending.keep(e);
            out.fill(f64::NAN);
        }
    }

    /// Reads the answer of an optional method.
    fn number(&self, name: &str) -> Option<f64> {
        let result = Python::attach(|py| {
            let Some(method) = optional(self.about.object.bind(py), name)? else {
                return Ok(None);
            };
            let value = method.call0()?.extract::<Option<f64>>()?;
            // A critical step must be positive; an invariant may have any sign.
            let sound = |x: &f64| *x > 0.0 || (name != "critical_step" && !x.is_nan());
            match value.filter(|x| !sound(x)) {
                None => Ok(value),
                Some(x) => {
                    let rule = format!(
                        "{name} of '{}' = {x}: no number that it may answer",
                        self.about.name
                    );
                    Err(Fault::new("InvalidParameter", rule).into())
                }
            }
        });
        result.unwrap_or_else(|e: PyErr| {
            // NaN stops the run, which then raises the exception.
            self.about.pending.keep(e);
            Some(f64::NAN)
        })
    }

    fn unsupported(&self, verb: &str, way: &str) -> Error {
        Error::Unsupported {
            model: self.about.name.clone(),
            what: format!("be {verb}: it has no save and restore; {way}"),
        }
    }
}

impl Participant<f64> for PythonSolver {
    as_described!();

    fn weigh(&mut self, weights: &Weights<f64>, inertia: &mut [f64]) -> Result<()> {
        let shares =
            [&weights.internal, &weights.kinetic, &weights.external].map(|w| self.about.shares(&**w));
        Python::attach(|py| {
            let [internal, kinetic, external] = shares.map(|s| array(py, s).unbind());
            let passed = Shares {
                internal,
                kinetic,
                external,
            };
            let answer = self.about.object.call_method1(py, "weigh", (passed,))?;
            self.about.read_inertia(answer.bind(py), inertia)
        })
        .map_err(|e| self.about.raised(e))
    }

    fn advance(&mut self, from: f64, step: f64) -> Result<()> {
        let result = Python::attach(|py| {
            self.about
                .object
                .call_method1(py, "advance", (from, step))
                .map(drop)
        });
        result.map_err(|e| self.about.raised(e))
    }

    fn velocities(&self, out: &mut [f64]) {
        self.read_answer("velocities", out);
    }

    fn displacements(&self, out: &mut [f64]) {
        self.read_answer("displacements", out);
    }

    fn kick(&mut self, impulse: &[f64]) -> Result<()> {
        let result = Python::attach(|py| {
            let impulse = (PyArray1::from_slice(py, impulse),);
            self.about.object.call_method1(py, "kick", impulse).map(drop)
        });
        result.map_err(|e| self.about.raised(e))
    }

    fn accelerations(&self, out: &mut [f64]) -> bool {
        let lookup =
            Python::attach(|py| optional(self.about.object.bind(py), "accelerations").map(|m| m.is_some()));
        let has = lookup.unwrap_or_else(|e| {
            self.about.pending.keep(e);
            false
        });
        if has {
            self.read_answer("accelerations", out);
        }
        has
    }

    fn critical_step(&self) -> Option<f64> {
        self.number("critical_step")
    }

    fn invariant(&self) -> Option<f64> {
        self.number("invariant")
    }

    fn save(&self) -> Result<Record<f64>> {
        let record = Python::attach(|py| saved(&self.about, py)).map_err(|e| self.about.raised(e))?;
        record.ok_or_else(|| self.unsupported("saved", "run without snapshots"))
    }

    fn restore(&mut self, from: &Record<f64>) -> Result<()> {
        let able = Python::attach(|py| optional(self.about.object.bind(py), "restore").map(|m| m.is_some()));
        if !able.map_err(|e| self.about.raised(e))? {
            return Err(self.unsupported("restored", "start the run anew"));
        }
        Python::attach(|py| restored(&self.about, py, from)).map_err(|e| self.about.raised(e))
    }
}

/// Returns the error for an object that is used twice.
pub(crate) fn used(what: &str) -> Fault {
    Fault::new(
        "Unsupported",
        format!("this {what} is part of a run already; make another one"),
    )
}
