//! Materials, weights, junctions, functions of time, effects.

use crate::arrays::{Numbers, array, flat, point, points};
use crate::border::Pending;
use crate::error::Fault;
use arlequin::core::effect::{BodyForce, EffectSpec, Load, LocalDamping, MassDamping, StiffnessDamping};
use arlequin::core::nalgebra::Vector3;
use arlequin::core::{Formula, JunctionKind, Overlap, Primitive, ProfileKind, Weighting};
use numpy::PyArray1;
use pyo3::exceptions::PyException;
use pyo3::prelude::*;
use std::sync::Arc;

/// A linear elastic isotropic material: Young's modulus [Pa], Poisson's ratio [-], density [kg/m3].
#[pyclass(frozen, module = "arlequin")]
#[derive(Debug, Clone, Copy)]
pub(crate) struct Elastic(pub(crate) arlequin::core::Elastic<f64>);

#[pymethods]
impl Elastic {
    #[new]
    fn new(young: f64, poisson: f64, density: f64) -> Result<Self, Fault> {
        Ok(Self(arlequin::core::Elastic::new(young, poisson, density)?))
    }
    /// Young's modulus [Pa].
    #[getter]
    fn young(&self) -> f64 {
        self.0.young()
    }
    /// Poisson's ratio [-].
    #[getter]
    fn poisson(&self) -> f64 {
        self.0.poisson()
    }
    /// Density [kg/m3].
    #[getter]
    fn density(&self) -> f64 {
        self.0.density()
    }
    /// Speed of dilatational waves [m/s].
    #[getter]
    fn p_wave_speed(&self) -> f64 {
        self.0.p_wave_speed()
    }
    /// Speed of long axial waves in a bar [m/s].
    #[getter]
    fn bar_speed(&self) -> f64 {
        self.0.bar_speed()
    }
    fn __repr__(&self) -> String {
        let m = &self.0;
        format!(
            "Elastic(young={:?}, poisson={:?}, density={:?})",
            m.young(),
            m.poisson(),
            m.density()
        )
    }
}

/// A flat overlap: the layer between the fine model's border through `fine` and the coarse model's border
/// through `coarse` [m].
#[pyclass(frozen, module = "arlequin")]
#[derive(Debug)]
pub(crate) struct Slab(Arc<dyn Overlap<f64>>);

#[pymethods]
impl Slab {
    #[new]
    fn new(fine: Numbers<'_>, coarse: Numbers<'_>) -> Result<Self, Fault> {
        let (fine, coarse) = (point("fine", &fine)?, point("coarse", &coarse)?);
        Ok(Self(Arc::new(arlequin::core::Slab::between(fine, coarse)?)))
    }
}

/// A ball or a box, created by `ball` and `block`.
#[pyclass(frozen, module = "arlequin")]
#[derive(Debug)]
pub(crate) struct Region(Primitive<f64>);

#[pymethods]
impl Region {
    /// A ball about a centre [m] with a radius [m].
    #[staticmethod]
    fn ball(centre: Numbers<'_>, radius: f64) -> Result<Self, Fault> {
        let centre = point("centre", &centre)?;
        Ok(Self(Primitive::Ball { centre, radius }))
    }

    /// A box along the axes from corner `low` to corner `high` [m].
    #[staticmethod]
    fn block(low: Numbers<'_>, high: Numbers<'_>) -> Result<Self, Fault> {
        let (low, high) = (point("low", &low)?, point("high", &high)?);
        Ok(Self(Primitive::Block { low, high }))
    }
}

/// An overlap around a region: inside `core` there is only the fine model, which fills `domain`.
#[pyclass(frozen, module = "arlequin")]
#[derive(Debug)]
pub(crate) struct Shell(Arc<dyn Overlap<f64>>);

#[pymethods]
impl Shell {
    #[new]
    fn new(core: &Region, domain: &Region) -> Self {
        Self(Arc::new(arlequin::core::Shell {
            fine_core: core.0,
            fine_domain: domain.0,
        }))
    }
}

fn overlap_of(from: &Bound<'_, PyAny>) -> PyResult<Arc<dyn Overlap<f64>>> {
    if let Ok(slab) = from.cast::<Slab>() {
        return Ok(slab.get().0.clone());
    }
    if let Ok(shell) = from.cast::<Shell>() {
        return Ok(shell.get().0.clone());
    }
    let rule = format!("{from} is no overlap: give an arlequin.Slab or an arlequin.Shell");
    Err(Fault::new("InvalidParameter", rule).into())
}

/// The weight of the coarse model across an overlap: 1 where only the coarse model is, 0 where only the
/// fine model is.
///
/// `profile` is "cubic", "linear", "quintic", "constant" (with `value`) or "mediator-compatible" (with the
/// positions of the mediator's nodes across the overlap, from 0 to 1, as `stations`); inside the overlap
/// the weight stays within `epsilon` and `1 - fine_epsilon`. Without them both floors are 1e-6, which suits
/// weights of elements and bonds; weights at nodes need about 0.05, a fine model whose bonds break 0.1.
#[pyclass(frozen, module = "arlequin")]
#[derive(Debug)]
pub(crate) struct Ramp(Arc<arlequin::core::Ramp<f64>>);

#[pymethods]
impl Ramp {
    #[new]
    #[pyo3(signature = (overlap, profile = "cubic", epsilon = None, *, fine_epsilon = None, value = None, stations = vec![]))]
    fn new(
        overlap: &Bound<'_, PyAny>,
        profile: &str,
        epsilon: Option<f64>,
        fine_epsilon: Option<f64>,
        value: Option<f64>,
        stations: Vec<f64>,
    ) -> PyResult<Self> {
        let kind: ProfileKind = profile.parse().map_err(Fault::from)?;
        let profile = kind.profile(value, &stations).map_err(Fault::from)?;
        let epsilon = epsilon.unwrap_or_else(|| Weighting::default().usual_floor(false));
        let ramp = arlequin::core::Ramp::new(overlap_of(overlap)?, profile, epsilon)
            .and_then(|r| r.with_fine_floor(fine_epsilon.unwrap_or(epsilon)));
        Ok(Self(Arc::new(ramp.map_err(Fault::from)?)))
    }

    /// Returns the weight at points [m].
    fn at<'py>(&self, py: Python<'py>, x: Numbers<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        use arlequin::core::Weight;
        let positions = points("points", &x)?;
        Ok(array(py, positions.iter().map(|x| self.0.value(x)).collect()))
    }
}

/// Shares of a model in internal energy, kinetic energy and external work.
#[pyclass(frozen, module = "arlequin")]
#[derive(Debug)]
pub(crate) struct Weights(pub(crate) arlequin::core::Weights<f64>);

#[pymethods]
impl Weights {
    /// Weights with one ramp for all three energies.
    #[staticmethod]
    fn same(ramp: &Ramp) -> Self {
        Self(arlequin::core::Weights::from_weight(ramp.0.clone()))
    }

    /// Weights of one, for a model that is not coupled.
    #[staticmethod]
    fn uncoupled() -> Self {
        Self(arlequin::core::Weights::uncoupled())
    }

    /// Weights of a fine model: the rest that the coarse models leave.
    #[staticmethod]
    #[pyo3(signature = (*coarse))]
    fn complement_of(coarse: Vec<PyRef<'_, Self>>) -> Self {
        let coarse_weights: Vec<_> = coarse.iter().map(|w| w.0.clone()).collect();
        Self(arlequin::core::Weights::complement_of(&coarse_weights))
    }

    /// Weights of a model in the share that coarser models leave, `left`.
    fn within(&self, left: &Self) -> Self {
        Self(self.0.clone().within(&left.0))
    }

    /// Returns the weights with means over elements and bonds ("energy") or with values at nodes ("nodal").
    fn with_weighting(&self, weighting: &str) -> Result<Self, Fault> {
        let weighting: Weighting = weighting.parse()?;
        Ok(Self(self.0.clone().with_weighting(weighting)))
    }

    /// Returns the shares of internal energy, kinetic energy and external work at points [m].
    fn at<'py>(&self, py: Python<'py>, x: Numbers<'py>) -> PyResult<[Bound<'py, PyArray1<f64>>; 3]> {
        let positions = points("points", &x)?;
        Ok([&self.0.internal, &self.0.kinetic, &self.0.external]
            .map(|w| array(py, positions.iter().map(|x| w.value(x)).collect())))
    }
}

/// The scalar product in which the velocities of two models agree. Created by `L2`, `H1Strain`,
/// `H1Gradient` and `H1Seminorm`.
#[pyclass(frozen, module = "arlequin")]
#[derive(Debug)]
pub(crate) struct Junction(JunctionKind, f64);

impl Junction {
    pub(crate) fn make(&self) -> Result<Box<dyn arlequin::core::Junction<f64>>, Fault> {
        Ok(self.0.junction(self.1)?)
    }

    pub(crate) fn l2() -> Self {
        Self(JunctionKind::L2, 1.0)
    }
}

#[pymethods]
impl Junction {
    #[new]
    #[pyo3(signature = (kind = "l2", length = 1.0))]
    fn new(kind: &str, length: f64) -> Result<Self, Fault> {
        let out = Self(kind.parse()?, length);
        // Refuses an invalid length here and not in a run.
        out.make()?;
        Ok(out)
    }

    fn __repr__(&self) -> String {
        format!("<Junction {}>", self.0)
    }
}

/// A function of time: `step`, `ramp`, `smooth_pulse`, `table`, or any Python function.
#[pyclass(frozen, module = "arlequin")]
#[derive(Debug)]
pub(crate) struct TimeFunction(arlequin::core::TimeFunction<f64>);

#[pymethods]
impl TimeFunction {
    /// One for all times from zero.
    #[staticmethod]
    fn step() -> Self {
        Self(arlequin::core::TimeFunction::Step)
    }

    /// Rises linearly from 0 to 1 within `duration` [s].
    #[staticmethod]
    fn ramp(duration: f64) -> Self {
        Self(arlequin::core::TimeFunction::Ramp { duration })
    }

    /// `sin(pi t/duration)**2` within `duration` [s], then zero.
    #[staticmethod]
    fn smooth_pulse(duration: f64) -> Self {
        Self(arlequin::core::TimeFunction::SmoothPulse { duration })
    }

    /// Interpolates linearly between times [s] and values; constant outside.
    #[staticmethod]
    fn table(times: Numbers<'_>, values: Numbers<'_>) -> Result<Self, Fault> {
        let (times, values) = (flat(&times), flat(&values));
        if times.len() != values.len() {
            let text = format!(
                "table of a time function: {} times and {} values",
                times.len(),
                values.len()
            );
            return Err(Fault::new("SizeMismatch", text));
        }
        let pairs = times.into_iter().zip(values).collect();
        Ok(Self(arlequin::core::TimeFunction::Table(pairs)))
    }

    /// Returns the value at time `t` [s].
    fn at(&self, t: f64) -> f64 {
        self.0.value(t)
    }
}

/// A function of time, and the slot for its exceptions if it is a Python function.
pub(crate) type OverTime = (arlequin::core::TimeFunction<f64>, Option<Pending>);

/// Reads a function of time: one of this module, any Python function, or a step at time zero for `None`.
pub(crate) fn time_function(from: Option<&Bound<'_, PyAny>>) -> PyResult<OverTime> {
    let Some(from) = from else {
        return Ok((arlequin::core::TimeFunction::Step, None));
    };
    if let Ok(f) = from.cast::<TimeFunction>() {
        return Ok((f.get().0.clone(), None));
    }
    if !from.is_callable() {
        let rule =
            format!("{from} is no function of time: give an arlequin.TimeFunction or a function of t [s]");
        return Err(Fault::new("InvalidParameter", rule).into());
    }
    // A failing function is refused here. If it fails later, its value is NaN and the exception waits until
    // the run stops.
    from.call1((0.0,))?.extract::<f64>()?;
    let (text, function) = (from.str()?.to_string(), from.clone().unbind());
    let pending = Pending::default();
    let slot = pending.clone();
    let evaluate = move |t: f64| {
        // A function that has failed is not called again: the run stops soon.
        if slot.waits() {
            return f64::NAN;
        }
        Python::attach(|py| {
            let value = function.call1(py, (t,)).and_then(|v| v.extract::<f64>(py));
            value.unwrap_or_else(|e| {
                // For negative times the core takes the value at zero if there is none, so the exception
                // may be ignored; Ctrl-C counts at any time.
                if t >= 0.0 || !e.is_instance_of::<PyException>(py) {
                    slot.keep(e);
                }
                f64::NAN
            })
        })
    };
    let formula = arlequin::core::TimeFunction::Formula(Formula::new(&text, evaluate));
    Ok((formula, Some(pending)))
}

type Made = Result<Box<dyn EffectSpec<f64>>, Fault>;

/// An effect on a model. Created by `Load`, `BodyForce`, `MassDamping`, `StiffnessDamping` and
/// `LocalDamping`.
#[pyclass(frozen, module = "arlequin")]
pub(crate) struct Effect {
    pub(crate) make: Box<dyn Fn() -> Made + Send + Sync>,
    /// Slot for exceptions of its function of time.
    pub(crate) pending: Option<Pending>,
}

impl Effect {
    fn checked<E: EffectSpec<f64> + 'static>(
        make: impl Fn() -> arlequin::core::Result<E> + Send + Sync + 'static,
        pending: Option<Pending>,
    ) -> Result<Self, Fault> {
        // Refuses invalid values where the effect is created, not only where it is used.
        make()?;
        // One effect may be added to several subdomains; each gets its own.
        let make = Box::new(move || -> Made { Ok(Box::new(make()?)) });
        Ok(Self { make, pending })
    }
}

/// Forces [N] (moments [N m]) on unknowns, multiplied by a function of time.
#[pyfunction]
#[pyo3(name = "Load", signature = (name, dofs, forces, time = None))]
pub(crate) fn load(
    name: String,
    dofs: Vec<usize>,
    forces: Numbers<'_>,
    time: Option<&Bound<'_, PyAny>>,
) -> PyResult<Effect> {
    let ((time, pending), mut forces) = (time_function(time)?, flat(&forces));
    if forces.len() == 1 {
        forces.resize(dofs.len(), forces[0]);
    }
    if forces.len() != dofs.len() {
        let text = format!(
            "load '{name}': {} forces on {} unknowns; give one or as many",
            forces.len(),
            dofs.len()
        );
        return Err(Fault::new("SizeMismatch", text).into());
    }
    let pairs: Vec<_> = dofs.into_iter().zip(forces).collect();
    let make = move || Load::on_dofs(&name, pairs.clone(), time.clone());
    Ok(Effect::checked(make, pending)?)
}

/// An acceleration of every point [m/s2], such as gravity, multiplied by a function of time.
#[pyfunction]
#[pyo3(name = "BodyForce", signature = (acceleration, time = None))]
pub(crate) fn body_force(acceleration: [f64; 3], time: Option<&Bound<'_, PyAny>>) -> PyResult<Effect> {
    let (time, pending) = time_function(time)?;
    let make = move || BodyForce::new(Vector3::from(acceleration))?.over_time(time.clone());
    Ok(Effect::checked(make, pending)?)
}

/// Damping proportional to velocity and mass, with a rate [1/s].
#[pyfunction]
#[pyo3(name = "MassDamping")]
pub(crate) fn mass_damping(rate: f64) -> Result<Effect, Fault> {
    Effect::checked(move || MassDamping::new(rate), None)
}

/// Damping proportional to the strain rate, with a time [s].
#[pyfunction]
#[pyo3(name = "StiffnessDamping")]
pub(crate) fn stiffness_damping(time: f64) -> Result<Effect, Fault> {
    Effect::checked(move || StiffnessDamping::new(time), None)
}

/// Damping by a share of the unbalanced force, usually 0.1 to 0.8. It is meant for approaching rest, not
/// for waves.
#[pyfunction]
#[pyo3(name = "LocalDamping")]
pub(crate) fn local_damping(share: f64) -> Result<Effect, Fault> {
    Effect::checked(move || LocalDamping::new(share), None)
}
