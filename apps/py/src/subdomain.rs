//! Models with their weights, and interfaces between them.

use crate::arrays::{Numbers, flat};
use crate::border::{Callbacks, outside};
use crate::choices::{Effect, Junction, Weights, time_function};
use crate::error::Fault;
use crate::models::NativeModel;
use crate::plug;
use crate::remote::{Place, meet};
use crate::shapes::{field_of, mediator_of};
use crate::solver::{PythonSolver, used};
use arlequin::core::{self, InterfaceOptions, Mediator, OwnStep, Partition, PrescribedMotion};
use pyo3::prelude::*;
use pyo3::{PyTraverseError, PyVisit};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

type Inner = core::Subdomain<f64>;

/// A model with its weights, supports, effects and initial state. Created by `coarse`, `fine` or
/// `participant`.
///
/// Each `with_…` method changes the subdomain and returns it.
#[pyclass(frozen, module = "arlequin")]
#[derive(Debug)]
pub(crate) struct Subdomain {
    /// Name of the model.
    #[pyo3(get)]
    pub(crate) name: String,
    inner: Mutex<Option<Inner>>,
    callbacks: Mutex<Callbacks>,
}

impl Subdomain {
    fn from_parts(name: String, inner: Inner, callbacks: Callbacks) -> Self {
        Self {
            name,
            inner: Mutex::new(Some(inner)),
            callbacks: Mutex::new(callbacks),
        }
    }

    fn callbacks(&self) -> MutexGuard<'_, Callbacks> {
        self.callbacks.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn take(&self) -> Result<Inner, Fault> {
        let mut inner = self.inner.lock().unwrap_or_else(PoisonError::into_inner);
        inner.take().ok_or_else(|| used("subdomain"))
    }

    /// Takes the subdomain for a run. Its Python objects and pending exceptions pass to `callbacks`.
    pub(crate) fn give(&self, callbacks: &mut Callbacks) -> Result<Inner, Fault> {
        let inner = self.take()?;
        callbacks.take(std::mem::take(&mut *self.callbacks()));
        Ok(inner)
    }

    fn change(&self, how: impl FnOnce(Inner) -> Result<Inner, Fault>) -> Result<(), Fault> {
        // The core takes the subdomain over: after a failed change there is none.
        let changed = how(self.take()?)?;
        *self.inner.lock().unwrap_or_else(PoisonError::into_inner) = Some(changed);
        Ok(())
    }

    fn with_role(
        model: &Bound<'_, PyAny>,
        weights: Option<&Weights>,
        field: Option<&Bound<'_, PyAny>>,
        role: &str,
    ) -> PyResult<Self> {
        let (built, default_field, callbacks) = match model.cast::<NativeModel>() {
            Ok(native) => {
                let native = native.get();
                let field = native.field()?;
                (native.give()?, field, Callbacks::default())
            }
            Err(_) => plug::model(model)?,
        };
        let field = field.map_or(Ok(default_field), field_of)?;
        let name = built.name().to_owned();
        // The mediator lies in the coarse field and needs values between its nodes.
        if role == "coarse" && field.samples().is_some() {
            let rule = format!(
                "model '{name}' cannot be the coarse one: its field exists at particles only; give it a field, such as \
                 arlequin.Field.natural(points), or the fine role"
            );
            return Err(Fault::new("Unsupported", rule).into());
        }
        let weights = weights.map_or_else(core::Weights::uncoupled, |w| w.0.clone());
        Ok(Self::from_parts(
            name,
            Inner::new(built, field, weights),
            callbacks,
        ))
    }
}

#[pymethods]
impl Subdomain {
    /// A model in the coarse role, which needs a continuous field. `field` replaces the model's own.
    #[staticmethod]
    #[pyo3(signature = (model, weights = None, *, field = None))]
    fn coarse(
        model: &Bound<'_, PyAny>,
        weights: Option<&Weights>,
        field: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        Self::with_role(model, weights, field, "coarse")
    }

    /// A model in the fine role. `field` replaces the model's own.
    #[staticmethod]
    #[pyo3(signature = (model, weights = None, *, field = None))]
    fn fine(
        model: &Bound<'_, PyAny>,
        weights: Option<&Weights>,
        field: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        Self::with_role(model, weights, field, "fine")
    }

    /// A whole solver, which makes its own steps and has its own state, supports and loads.
    #[staticmethod]
    #[pyo3(signature = (solver, weights = None, *, field = None))]
    fn participant(
        solver: &Bound<'_, PyAny>,
        weights: Option<&Weights>,
        field: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let (built, default_field, callbacks) = PythonSolver::from_object(solver)?;
        let field = field.map_or(Ok(default_field), field_of)?;
        let weights = weights.map_or_else(core::Weights::uncoupled, |w| w.0.clone());
        let name = core::Participant::name(&built).to_owned();
        let inner = Inner::participant(Box::new(built), field, weights).map_err(Fault::from);
        // An exception of the solver is raised instead of the error that it caused.
        let inner = callbacks.raised().map_or(inner, |e| Err(e.into()))?;
        Ok(Self::from_parts(name, inner, callbacks))
    }

    /// A whole solver named `name` in another process. It is started by a `command`, such as `["python3",
    /// "solver.py"]`, or awaited at an `address`, such as `unix:solver.sock`. It must connect within
    /// `start_timeout` [s], by default 30 s or `timeout` if that is longer, and answer within `timeout`
    /// [s]. Ctrl-C ends the wait.
    #[staticmethod]
    #[pyo3(signature = (name, command = None, weights = None, *, address = None, timeout = 4.0, start_timeout = None))]
    #[allow(clippy::too_many_arguments, reason = "names of Python")]
    fn remote(
        py: Python<'_>,
        name: String,
        command: Option<Vec<String>>,
        weights: Option<&Weights>,
        address: Option<String>,
        timeout: f64,
        start_timeout: Option<f64>,
    ) -> PyResult<Self> {
        let place = Place::from_arguments(command, address)?;
        let weights = weights.map_or_else(core::Weights::uncoupled, |w| w.0.clone());
        let inner = outside(py, || {
            let (solver, field) = meet(&name, &place, timeout, start_timeout)?;
            Ok(Inner::participant(Box::new(solver), field, weights)?)
        })?;
        Ok(Self::from_parts(name, inner, Callbacks::default()))
    }

    /// Sets the initial displacements [m] and velocities [m/s] of all unknowns.
    fn with_initial<'py>(
        slf: PyRef<'py, Self>,
        q: Numbers<'py>,
        v: Numbers<'py>,
    ) -> Result<PyRef<'py, Self>, Fault> {
        let (q, v) = (flat(&q), flat(&v));
        slf.change(|s| Ok(s.with_initial(q, v)?))?;
        Ok(slf)
    }

    /// Fixes unknowns, or moves them by `amplitude` [m] times a function of time.
    #[pyo3(signature = (dofs, amplitude = 0.0, time = None))]
    fn with_support<'py>(
        slf: PyRef<'py, Self>,
        dofs: Vec<usize>,
        amplitude: f64,
        time: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<PyRef<'py, Self>> {
        let (time, pending) = time_function(time)?;
        let motion = PrescribedMotion {
            dofs,
            amplitude,
            time,
        };
        slf.change(|s| Ok(s.with_support(motion)))?;
        slf.callbacks().add_pending(pending.as_ref());
        Ok(slf)
    }

    /// Adds an effect, such as `BodyForce` or `Load`.
    fn with_effect<'py>(slf: PyRef<'py, Self>, effect: &Effect) -> Result<PyRef<'py, Self>, Fault> {
        let built = (effect.make)()?;
        slf.change(|s| Ok(s.with_effect(built)))?;
        slf.callbacks().add_pending(effect.pending.as_ref());
        Ok(slf)
    }

    /// Sets the own steps between two reflections: `ratio` steps, or the fewest steps that stay below
    /// `fraction` of the critical step, or one `implicit` step.
    #[pyo3(signature = (*, ratio = None, fraction = None, implicit = false))]
    fn with_step(
        slf: PyRef<'_, Self>,
        ratio: Option<usize>,
        fraction: Option<f64>,
        implicit: bool,
    ) -> Result<PyRef<'_, Self>, Fault> {
        let own_step = match (ratio, fraction, implicit) {
            (Some(n), None, false) => OwnStep::Ratio(n),
            (None, Some(f), false) => OwnStep::Fraction(f),
            (None, None, true) => OwnStep::Implicit,
            (None, None, false) => OwnStep::Same,
            _ => {
                let rule = "own step: give one of ratio, fraction and implicit";
                return Err(Fault::new("InvalidParameter", rule));
            }
        };
        slf.change(|s| Ok(s.with_step(own_step)))?;
        Ok(slf)
    }

    /// "checked" or "unchecked": whether its weights and those of the models coupled to it must sum to one.
    fn with_partition<'py>(slf: PyRef<'py, Self>, partition: &str) -> Result<PyRef<'py, Self>, Fault> {
        let partition: Partition = partition.parse()?;
        slf.change(|s| Ok(s.with_partition(partition)))?;
        Ok(slf)
    }

    fn __repr__(&self) -> String {
        format!("<Subdomain '{}'>", self.name)
    }

    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        self.callbacks().show(&visit)
    }
}

/// A subdomain by its number or by the name of its model.
#[derive(Debug, Clone, FromPyObject)]
pub(crate) enum Which {
    Number(i64),
    Name(String),
}

impl Which {
    /// Returns the number among `names`.
    pub(crate) fn among(&self, names: &[String], what: &str) -> Result<usize, Fault> {
        let number = match self {
            Self::Number(k) => usize::try_from(*k).ok().filter(|k| *k < names.len()),
            Self::Name(n) => {
                let mut of_name = (0..names.len()).filter(|k| names[*k] == *n);
                let first = of_name.next();
                if of_name.next().is_some() {
                    let rule =
                        format!("several are named '{n}'; set other names, or give the number of the {what}");
                    return Err(Fault::new("UnknownName", rule));
                }
                first
            }
        };
        number.ok_or_else(|| {
            let requested = match self {
                Self::Number(k) => k.to_string(),
                Self::Name(n) => format!("'{n}'"),
            };
            let known = names.join(", ");
            Fault::new(
                "UnknownName",
                format!("there is no {what} {requested}; there are: {known}"),
            )
        })
    }
}

/// Couples a coarse and a fine subdomain, both given by number or name. `mediator` is a mesh whose nodes
/// carry the multipliers, or points for natural neighbours. `junction` is `L2()` by default. `sampling` is
/// "intersection", "projection" or "particles".
#[pyclass(frozen, module = "arlequin")]
pub(crate) struct Interface {
    #[pyo3(get)]
    pub(crate) name: String,
    sides: [Which; 2],
    mediator: Arc<dyn Mediator<f64>>,
    junction: Py<Junction>,
    options: InterfaceOptions<f64>,
}

#[pymethods]
impl Interface {
    #[new]
    #[pyo3(signature = (name, coarse, fine, mediator, junction = None, *, sampling = "intersection", lumped = false, start_jump = None))]
    #[allow(clippy::too_many_arguments, reason = "names of Python")]
    fn new(
        py: Python<'_>,
        name: String,
        coarse: Which,
        fine: Which,
        mediator: &Bound<'_, PyAny>,
        junction: Option<Py<Junction>>,
        sampling: &str,
        lumped: bool,
        start_jump: Option<f64>,
    ) -> PyResult<Self> {
        let mut options = InterfaceOptions::default();
        options.sampling = sampling.parse().map_err(Fault::from)?;
        options.lumped = lumped;
        options.start_jump = start_jump.unwrap_or(options.start_jump);
        Ok(Self {
            name,
            sides: [coarse, fine],
            mediator: mediator_of(mediator)?,
            junction: junction.map_or_else(|| Py::new(py, Junction::l2()), Ok)?,
            options,
        })
    }

    fn __repr__(&self) -> String {
        format!("<Interface '{}'>", self.name)
    }
}

impl Interface {
    pub(crate) fn spec(&self, names: &[String]) -> Result<core::InterfaceSpec<f64>, Fault> {
        let [coarse, fine] = &self.sides;
        Ok(core::InterfaceSpec {
            name: self.name.clone(),
            coarse: coarse.among(names, "subdomain")?,
            fine: fine.among(names, "subdomain")?,
            mediator: self.mediator.clone(),
            junction: self.junction.get().make()?,
            options: self.options,
        })
    }
}
