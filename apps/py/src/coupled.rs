//! Coupled runs.

use crate::arrays::{Numbers, array, points, rows};
use crate::border::{Callbacks, Pulse, outside};
use crate::error::Fault;
use crate::subdomain::{Interface, Subdomain, Which};
use arlequin::core::snapshot::Snapshot as State;
use arlequin::core::{self, Guard, Observer, Parts, Phase, StepReport, TimeStep, Weighting};
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use pyo3::{PyTraverseError, PyVisit};
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError, TryLockError};

type Inner = core::Coupled<f64>;

/// Columns of the table of energies.
const COLUMNS: [&str; 9] = [
    "time [s]",
    "kinetic [J]",
    "internal [J]",
    "invariant [J]",
    "work [J]",
    "drift [J]",
    "relative drift [-]",
    "momentum drift [-]",
    "constraint residual [-]",
];

/// A coupled run: `Coupled(subdomains, interfaces, fraction=0.9)`.
///
/// The step of the run is the longest step with every own step at most `fraction` of its model's critical
/// step. With `chosen` instead of `fraction`, models also take as many own steps as they need. `seconds`
/// sets the step itself [s]. The energy balance is computed every `energy_every` steps. A run ends if its
/// energy changes by more than `growth` of the energy in play without an effect that explains it.
#[pyclass(frozen, subclass, module = "arlequin")]
pub(crate) struct Coupled {
    run: Mutex<Inner>,
    names: Vec<String>,
    interfaces: Vec<String>,
    callbacks: Callbacks,
    drawn: Mutex<Vec<[f64; 9]>>,
    /// True if an exception ended the run, perhaps within a step: models may then be at different times.
    torn: AtomicBool,
}

/// The state of a run, which can be restored.
#[pyclass(frozen, module = "arlequin")]
#[derive(Debug)]
pub(crate) struct Snapshot(State<f64>);

#[pymethods]
impl Snapshot {
    /// Number of steps made.
    #[getter]
    fn steps(&self) -> usize {
        self.0.step
    }
}

/// Records energies and checks for Ctrl-C.
struct Watch<'a> {
    drawn: &'a Mutex<Vec<[f64; 9]>>,
    callbacks: &'a Callbacks,
    pulse: Pulse,
    stop: Option<PyErr>,
    warned: Vec<String>,
}

impl Observer<f64> for Watch<'_> {
    fn phase(&mut self, _: Phase) {}

    fn warning(&mut self, warning: &core::Warning) {
        self.warned.push(warning.to_string());
    }

    fn observe(&mut self, _: &Inner, report: &StepReport<f64>) -> core::Result<ControlFlow<()>> {
        if let Some(s) = &report.energy {
            let row = [
                s.time,
                s.kinetic,
                s.internal,
                s.invariant,
                s.work,
                s.drift,
                s.relative_drift,
                s.momentum_drift[0],
                s.constraint_residual,
            ];
            self.drawn
                .lock()
                .unwrap_or_else(PoisonError::into_inner)
                .push(row);
        }
        // The step is complete, so that the next call can continue.
        if let Err(e) = self.pulse.beat(|_| Ok(())) {
            self.stop = Some(e);
            return Ok(ControlFlow::Break(()));
        }
        // The values of a model whose exception waits are NaN; the run must not go on with them.
        Ok(match self.callbacks.waits() {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        })
    }
}

/// Issues the warnings of a run as Python warnings.
fn warn(py: Python<'_>, messages: &[String]) -> PyResult<()> {
    if messages.is_empty() {
        return Ok(());
    }
    let kind = py.import("arlequin.errors")?.getattr("Warning")?;
    let warnings = py.import("warnings")?;
    messages
        .iter()
        .try_for_each(|text| warnings.call_method1("warn", (text, &kind)).map(drop))
}

fn step_of(fraction: Option<f64>, seconds: Option<f64>, chosen: Option<f64>) -> Result<TimeStep<f64>, Fault> {
    match (fraction, seconds, chosen) {
        (f, None, None) => Ok(TimeStep::Fraction(f.unwrap_or(0.9))),
        (None, Some(s), None) => Ok(TimeStep::Seconds(s)),
        (None, None, Some(f)) => Ok(TimeStep::Chosen(f)),
        _ => {
            let rule = "step of the run: give one of fraction, seconds and chosen";
            Err(Fault::new("InvalidParameter", rule))
        }
    }
}

impl Coupled {
    fn lock(&self) -> Result<MutexGuard<'_, Inner>, Fault> {
        // Waiting could block for ever: this thread may be computing around the model that asks.
        match self.run.try_lock() {
            Ok(run) => Ok(run),
            Err(TryLockError::Poisoned(p)) => Ok(p.into_inner()),
            Err(TryLockError::WouldBlock) => Err(Fault::new(
                "Busy",
                "this run computes already, in another thread or around the model that asks; wait until it has ended",
            )),
        }
    }

    /// Refuses to continue from a state whose models may be at different times.
    fn whole(&self) -> Result<(), Fault> {
        if !self.torn.load(Ordering::Relaxed) {
            return Ok(());
        }
        let rule = "an exception ended this run, perhaps within a step, and its models may be at different instants: go back \
                    with restore(snapshot), or build it anew";
        Err(Fault::new("Unsupported", rule))
    }

    /// Runs `work` on the run. If an exception of a Python model waits, it is raised instead of the error
    /// that it caused.
    fn compute<V: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut Inner) -> Result<V, Fault> + Send,
    ) -> PyResult<V> {
        let result = outside(py, || work(&mut *self.lock()?));
        self.callbacks.raised().map_or(result, Err)
    }

    /// Returns the displacements of a model's nodes, (nodes, components), or their rotations.
    fn values<'py>(
        &self,
        py: Python<'py>,
        which: &Which,
        rotations: bool,
        pick: impl Fn(&core::State<f64>) -> &Vec<f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let k = which.among(&self.names, "subdomain")?;
        let run = self.lock()?;
        let (layout, unknowns) = (
            run.subdomains()[k].model().layout(),
            pick(run.subdomains()[k].state()),
        );
        let (moves, turns) = unknowns.split_at(layout.translations());
        match rotations {
            false => rows(py, moves.to_vec(), layout.components),
            true => rows(py, turns.to_vec(), layout.rotations),
        }
    }
}

#[pymethods]
impl Coupled {
    #[new]
    #[pyo3(signature = (subdomains, interfaces = vec![], *, fraction = None, seconds = None, chosen = None, start = 0.0, energy_every = 10, growth = None))]
    #[allow(clippy::too_many_arguments, reason = "names of Python")]
    fn new(
        py: Python<'_>,
        subdomains: Vec<PyRef<'_, Subdomain>>,
        interfaces: Vec<PyRef<'_, Interface>>,
        fraction: Option<f64>,
        seconds: Option<f64>,
        chosen: Option<f64>,
        start: f64,
        energy_every: usize,
        growth: Option<f64>,
    ) -> PyResult<Self> {
        let step = step_of(fraction, seconds, chosen)?;
        let names: Vec<String> = subdomains.iter().map(|s| s.name.clone()).collect();
        let specs = interfaces
            .iter()
            .map(|i| i.spec(&names))
            .collect::<Result<Vec<_>, Fault>>()?;
        let mut callbacks = Callbacks::default();
        let bodies = subdomains
            .iter()
            .map(|s| s.give(&mut callbacks))
            .collect::<Result<Vec<_>, Fault>>()?;
        let nodal = bodies.iter().any(|s| s.weights().weighting == Weighting::Nodal);
        // Nodal weighting does not conserve energy, so its guard allows far larger growth.
        let mut guard = Guard::for_weighting(if nodal {
            Weighting::Nodal
        } else {
            Weighting::Energy
        });
        guard.interval = energy_every.max(1);
        guard.growth = growth.unwrap_or(guard.growth);
        let parts = Parts {
            start,
            end: None,
            subdomains: bodies,
            interfaces: specs,
            pairs: Vec::new(),
        };
        let result = outside(py, || Ok(Inner::from_parts(parts, step, Some(guard))?));
        Ok(Self {
            run: Mutex::new(callbacks.raised().map_or(result, Err)?),
            names,
            interfaces: interfaces.iter().map(|i| i.name.clone()).collect(),
            callbacks,
            drawn: Mutex::new(Vec::new()),
            torn: AtomicBool::new(false),
        })
    }

    /// Makes `steps` steps and returns how many were made. `observer(run)` is called every `every` steps
    /// and ends the run by returning False. Ctrl-C ends the run between two steps, and the next call
    /// continues. Within a model written in Python, Ctrl-C is an exception like others: the run then
    /// continues only from a snapshot.
    #[pyo3(signature = (steps, observer = None, every = 1))]
    fn run(
        slf: &Bound<'_, Self>,
        steps: usize,
        observer: Option<&Bound<'_, PyAny>>,
        every: usize,
    ) -> PyResult<usize> {
        let (this, py) = (slf.get(), slf.py());
        let mut steps_made = 0;
        while steps_made < steps {
            // Without an observer all steps are one computation.
            let ahead = match observer {
                Some(_) => every.max(1).min(steps - steps_made),
                None => steps - steps_made,
            };
            let (done, stop, warned) = this.compute(py, |run| {
                this.whole()?;
                // Stays set if an exception leaves the models within a step.
                this.torn.store(true, Ordering::Relaxed);
                let mut watch = Watch {
                    drawn: &this.drawn,
                    callbacks: &this.callbacks,
                    pulse: Pulse::new(),
                    stop: None,
                    warned: Vec::new(),
                };
                let done = run.run(ahead, &mut watch)?;
                // Ctrl-C between two steps tears nothing; an exception of a model may.
                this.torn.store(this.callbacks.waits(), Ordering::Relaxed);
                Ok((done, watch.stop, watch.warned))
            })?;
            steps_made += done;
            // A filter of the user may turn a warning into an exception.
            warn(py, &warned)?;
            stop.map_or(Ok(()), Err)?;
            // The observer runs with the interpreter's lock, between two computations.
            if let Some(observer) = observer
                && observer.call1((slf,))?.extract::<bool>().is_ok_and(|go| !go)
            {
                break;
            }
        }
        Ok(steps_made)
    }

    /// Names of the models.
    #[getter]
    fn names(&self) -> Vec<String> {
        self.names.clone()
    }

    /// Step of the run [s].
    #[getter]
    fn dt(&self) -> Result<f64, Fault> {
        Ok(self.lock()?.dt())
    }

    /// Present time [s].
    #[getter]
    fn time(&self) -> Result<f64, Fault> {
        Ok(self.lock()?.time())
    }

    /// Number of steps made.
    #[getter]
    fn steps(&self) -> Result<usize, Fault> {
        Ok(self.lock()?.steps())
    }

    /// Critical step of each subdomain [s].
    #[getter]
    fn critical_steps(&self) -> Result<Vec<f64>, Fault> {
        Ok(self.lock()?.critical_steps().to_vec())
    }

    /// Number of own steps of each subdomain in a step of the run.
    #[getter]
    fn own_steps(&self) -> Result<Vec<usize>, Fault> {
        Ok(self.lock()?.plan().own_steps)
    }

    /// Largest relative drift of the energy balance so far.
    #[getter]
    fn drift(&self) -> Result<f64, Fault> {
        Ok(self.lock()?.drift())
    }

    /// Warnings so far: each fault of each object once, with its largest value.
    #[getter]
    fn warnings(&self) -> Result<Vec<String>, Fault> {
        Ok(self.lock()?.warnings().iter().map(ToString::to_string).collect())
    }

    /// Drift of the energy balance that the models' laws and round-off explain so far.
    #[getter]
    fn explained_drift(&self) -> Result<f64, Fault> {
        Ok(self.lock()?.explained_drift())
    }

    /// Largest relative velocity jump across interfaces so far.
    #[getter]
    fn constraint_residual(&self) -> Result<f64, Fault> {
        Ok(self.lock()?.constraint_residual())
    }

    /// Kinetic plus internal energy [J].
    #[getter]
    fn energy(&self, py: Python<'_>) -> PyResult<f64> {
        // A model in Python is asked for its energy and may raise.
        self.compute(py, |run| Ok(run.energy()))
    }

    /// Linear and angular momentum about the origin [kg m/s, kg m2/s].
    #[getter]
    fn momentum(&self, py: Python<'_>) -> PyResult<[[f64; 3]; 2]> {
        self.compute(py, |run| Ok(run.momentum().map(Into::into)))
    }

    /// Displacements of a model [m], (nodes, components).
    fn displacement<'py>(&self, py: Python<'py>, model: Which) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.values(py, &model, false, |s| &s.q)
    }

    /// Velocities of a model [m/s], (nodes, components).
    fn velocity<'py>(&self, py: Python<'py>, model: Which) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.values(py, &model, false, |s| &s.v)
    }

    /// Rotations of a model [rad], (nodes, 3); empty if its nodes have no rotations.
    fn rotation<'py>(&self, py: Python<'py>, model: Which) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.values(py, &model, true, |s| &s.q)
    }

    /// Lumped inertia of every unknown with the weights of the model [kg, kg m2].
    fn inertia<'py>(&self, py: Python<'py>, model: Which) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let k = model.among(&self.names, "subdomain")?;
        Ok(array(py, self.lock()?.subdomains()[k].inertia().to_vec()))
    }

    /// Displacement [m] and velocity [m/s] of a model's field at points [m], each (n, 3).
    fn sample<'py>(
        &self,
        py: Python<'py>,
        model: Which,
        x: Numbers<'py>,
    ) -> PyResult<[Bound<'py, PyArray2<f64>>; 2]> {
        let k = model.among(&self.names, "subdomain")?;
        let (positions, run) = (points("points", &x)?, self.lock()?);
        let mut out = [
            Vec::with_capacity(3 * positions.len()),
            Vec::with_capacity(3 * positions.len()),
        ];
        for x in &positions {
            let sample = run.subdomains()[k].sample(x).map_err(Fault::from)?;
            out.iter_mut().zip(sample).for_each(|(o, v)| o.extend(v.iter()));
        }
        let [u, v] = out;
        Ok([rows(py, u, 3)?, rows(py, v, 3)?])
    }

    /// Multipliers of an interface, (nodes of the mediator, components).
    fn multipliers<'py>(&self, py: Python<'py>, interface: Which) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let k = interface.among(&self.interfaces, "interface")?;
        let run = self.lock()?;
        let tie = &run.interfaces()[k];
        rows(py, tie.multipliers().to_vec(), tie.components())
    }

    /// Energies over time, one row for each time the energy balance was computed.
    fn _energies<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let drawn = self.drawn.lock().unwrap_or_else(PoisonError::into_inner);
        let out = PyDict::new(py);
        for (k, name) in COLUMNS.iter().enumerate() {
            out.set_item(name, array(py, drawn.iter().map(|row| row[k]).collect()))?;
        }
        Ok(out)
    }

    /// Displacements of every model in static equilibrium under the loads and supports at time `t` [s]. All
    /// models must be linear.
    #[pyo3(signature = (t = 0.0))]
    fn equilibrium<'py>(&self, py: Python<'py>, t: f64) -> PyResult<Vec<Bound<'py, PyArray1<f64>>>> {
        let equilibrium = self.compute(py, |run| Ok(run.equilibrium(t)?))?;
        Ok(equilibrium
            .displacements
            .into_iter()
            .map(|q| array(py, q))
            .collect())
    }

    /// Returns the present state.
    fn snapshot(&self, py: Python<'_>) -> PyResult<Snapshot> {
        self.compute(py, |run| {
            self.whole()?;
            Ok(Snapshot(run.snapshot()?))
        })
    }

    /// Restores a state of this run, or of a run that was built in the same way.
    fn restore(&self, py: Python<'_>, snapshot: &Snapshot) -> PyResult<()> {
        self.compute(py, |run| {
            // An exception in the middle leaves some models restored and others not.
            self.torn.store(true, Ordering::Relaxed);
            run.restore(&snapshot.0)?;
            self.torn.store(false, Ordering::Relaxed);
            Ok(())
        })
    }

    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        self.callbacks.show(&visit)
    }

    /// Sum of the forces and of the moments that multipliers exert on both sides, relative to the force on
    /// one side.
    fn _interface_momentum(&self) -> Result<[f64; 2], Fault> {
        Ok(core::conformance::interface_momentum(&*self.lock()?))
    }
}
