//! Scenes: reading, checking and running them.

use crate::arrays::array;
use crate::border::{Pulse, outside};
use crate::error::Fault;
use crate::frames::{self, KeptFrames};
use arlequin::core::Coupled;
use arlequin_scene::output::json;
use arlequin_scene::suggest::{Goal, suggest};
use arlequin_scene::{End, Observer, Recorded, RunFolder, Source, Table};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::ops::ControlFlow;
use std::path::PathBuf;

/// Assignments: key paths with their values as TOML.
type Changes = Vec<(String, String)>;

/// A scene file and the changes made to it.
#[pyclass(frozen, module = "arlequin._native")]
#[derive(Debug)]
pub(crate) struct Scene(arlequin_scene::Scene);

impl Scene {
    fn from_source(source: Source, changes: Changes) -> Result<Self, Fault> {
        let read = arlequin_scene::Scene::from_source(source.clone());
        let scene = changes.iter().try_fold(
            read.map_err(|e| Fault::of_scene(e, &source))?,
            |s, (path, value)| s.set(path, value),
        );
        scene.map(Self).map_err(|e| Fault::of_scene(e, &source))
    }

    fn fault(&self) -> impl Fn(arlequin_scene::Error) -> Fault + '_ {
        |e| Fault::of_scene(e, self.0.source())
    }
}

#[pymethods]
impl Scene {
    /// Reads a file.
    #[staticmethod]
    fn read(path: PathBuf, changes: Changes) -> PyResult<Self> {
        let source = Source::read(&path).map_err(Fault::from)?;
        Ok(Self::from_source(source, changes)?)
    }

    /// Reads a text; paths in it are relative to the current folder.
    #[staticmethod]
    fn from_text(text: String, changes: Changes) -> PyResult<Self> {
        Ok(Self::from_source(Source::new("scene", text), changes)?)
    }

    /// Returns the scene with further changes.
    fn with_changes(&self, changes: Changes) -> PyResult<Self> {
        let scene = changes
            .iter()
            .try_fold(self.0.clone(), |s, (path, value)| s.set(path, value));
        Ok(scene.map(Self).map_err(self.fault())?)
    }

    #[getter]
    fn path(&self) -> PathBuf {
        self.0.source().path.clone()
    }

    #[getter]
    fn text(&self) -> &str {
        &self.0.source().text
    }

    #[getter]
    fn title(&self) -> Option<&str> {
        self.0.spec().title.as_deref()
    }

    #[getter]
    fn changes(&self) -> Vec<String> {
        self.0.changes().to_vec()
    }

    /// Returns the plan of the run as JSON.
    fn check(&self, py: Python<'_>) -> PyResult<String> {
        let plan = outside(py, || {
            let prepared = self.0.prepare().map_err(self.fault())?;
            Ok(json("writing the plan", &prepared.preview())?)
        });
        py.check_signals()?;
        plan
    }

    /// Proposes settings for an error or a time and returns them as JSON; writes the scene with them to
    /// `apply`.
    fn suggest(
        &self,
        py: Python<'_>,
        error: Option<f64>,
        time: Option<f64>,
        frequency: Option<f64>,
        apply: Option<PathBuf>,
    ) -> PyResult<String> {
        let goal = match (error, time) {
            (Some(e), None) => Goal::Error(e),
            (None, Some(t)) => Goal::Time(t),
            _ => {
                let rule = "suggest needs either error or time, such as error=0.02 or time=30.0 [s]";
                return Err(Fault::new("Key", rule).into());
            }
        };
        let written = outside(py, || {
            let proposal = suggest(&self.0, goal, frequency).map_err(self.fault())?;
            if let Some(file) = &apply {
                proposal.write(&self.0, file).map_err(self.fault())?;
            }
            Ok(json("writing the proposal", &proposal)?)
        });
        py.check_signals()?;
        written
    }

    /// Makes all steps and writes results to a folder if one is given. Returns the results with the
    /// exception that ended the run early, if there was one.
    fn run(
        &self,
        py: Python<'_>,
        frames: Option<usize>,
        out: Option<PathBuf>,
        force: bool,
        listener: Option<Py<PyAny>>,
    ) -> PyResult<(Results, Option<PyErr>)> {
        outside(py, || {
            let folder = out.map(|f| RunFolder::new(&self.0, Some(&f), force));
            let folder = folder.transpose().map_err(self.fault())?;
            let prepared = self.0.prepare().map_err(self.fault())?;
            // Preparing takes long; Ctrl-C that came meanwhile counts before the first step.
            Python::attach(|py| py.check_signals())?;
            let kept_frames = KeptFrames::new(&prepared, frames).map_err(self.fault())?;
            let mut watch = Watch::new(Some(kept_frames), listener);
            let done = match folder {
                Some(folder) => prepared.run_into(folder, &mut watch),
                None => prepared.run(&mut watch),
            };
            watch.conclude(done.map_err(self.fault())?)
        })
    }
}

/// Continues the run of a folder from its last checkpoint.
#[pyfunction]
pub(crate) fn resume(
    py: Python<'_>,
    folder: PathBuf,
    listener: Option<Py<PyAny>>,
) -> PyResult<(Results, Option<PyErr>)> {
    outside(py, || {
        let resumed = arlequin_scene::resume(&folder)?;
        let mut watch = Watch::new(None, listener);
        let done = resumed.run(&mut watch)?;
        watch.conclude(done)
    })
}

/// Observer of a run for Python: keeps frames, calls the listener, checks for Ctrl-C.
pub(crate) struct Watch {
    kept: Option<KeptFrames>,
    listener: Option<Py<PyAny>>,
    pulse: Pulse,
    /// Reason for which the run was stopped.
    pub(crate) stop: Option<Fault>,
}

impl Watch {
    pub(crate) fn new(kept: Option<KeptFrames>, listener: Option<Py<PyAny>>) -> Self {
        Self {
            kept,
            listener,
            pulse: Pulse::new(),
            stop: None,
        }
    }

    fn conclude(self, done: arlequin_scene::Results) -> Result<(Results, Option<PyErr>), Fault> {
        let results = Results {
            recorded: done.recorded,
            end: done.end,
            folder: done.folder,
            kept: self.kept,
        };
        Ok((results, self.stop.map(PyErr::from)))
    }
}

impl Observer for Watch {
    fn warning(&mut self, text: &str) {
        let Some(listener) = &self.listener else { return };
        let reported = Python::attach(|py| listener.call_method1(py, "warning", (text,)).map(drop));
        // The first exception is the cause of later ones.
        if let (Err(e), None) = (reported, &self.stop) {
            self.stop = Some(e.into());
        }
    }

    fn step(&mut self, run: &Coupled<f64>, planned: usize) -> ControlFlow<()> {
        let frame_result = self.kept.as_mut().map_or(Ok(()), |k| k.look(run, planned));
        let reported = self.pulse.beat(|py| match &self.listener {
            Some(listener) => listener
                .call_method1(py, "step", (run.steps(), planned))
                .map(drop),
            None => Ok(()),
        });
        let outcome = frame_result
            .map_err(Fault::from)
            .and(reported.map_err(Fault::from));
        if let (Err(e), None) = (outcome, &self.stop) {
            self.stop = Some(e);
        }
        if self.stop.is_some() {
            return ControlFlow::Break(());
        }
        ControlFlow::Continue(())
    }
}

/// Results of a run.
#[pyclass(frozen, module = "arlequin._native")]
pub(crate) struct Results {
    recorded: Recorded,
    end: End,
    folder: Option<PathBuf>,
    kept: Option<KeptFrames>,
}

/// Returns a table as `{name: column}`, times included.
fn columns<'py>(py: Python<'py>, table: &Table) -> PyResult<Bound<'py, PyDict>> {
    let out = PyDict::new(py);
    out.set_item("time [s]", array(py, table.times.clone()))?;
    for (name, column) in table.names.iter().zip(&table.columns) {
        out.set_item(name, array(py, column.clone()))?;
    }
    Ok(out)
}

#[pymethods]
impl Results {
    #[getter]
    fn folder(&self) -> Option<PathBuf> {
        self.folder.clone()
    }

    #[getter]
    fn interrupted(&self) -> bool {
        self.end == End::Interrupted
    }

    fn summary(&self) -> PyResult<String> {
        Ok(json("writing the summary", &self.recorded.summary).map_err(Fault::from)?)
    }

    /// Returns the probes over time as `{name: column}`, times included.
    fn probes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        columns(py, &self.recorded.probes)
    }

    fn energy<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        columns(py, &self.recorded.energy)
    }

    fn effects<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        columns(py, &self.recorded.effects)
    }

    /// Returns the curves as `{name: {"time [s]", label of x, label of y}}`.
    fn curves<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let out = PyDict::new(py);
        for c in &self.recorded.curves {
            let entry = PyDict::new(py);
            entry.set_item("time [s]", array(py, c.times.clone()))?;
            for axis in [&c.x, &c.y] {
                let label = format!("{} [{}]", axis.label, axis.unit);
                entry.set_item(label, array(py, axis.values.clone()))?;
            }
            out.set_item(&c.name, entry)?;
        }
        Ok(out)
    }

    /// Fragments at the times of the frames: `[(time, model, number, particles, mass, centre, velocity)]`.
    #[allow(clippy::type_complexity, reason = "a row of the table of pieces")]
    fn fragments(&self) -> Vec<(f64, String, usize, usize, f64, [f64; 3], [f64; 3])> {
        let fragments = self.recorded.fragments.iter();
        fragments
            .map(|p| {
                (
                    p.time,
                    p.model.clone(),
                    p.number,
                    p.particles,
                    p.mass,
                    p.centre,
                    p.velocity,
                )
            })
            .collect()
    }

    fn times<'py>(&self, py: Python<'py>) -> Bound<'py, PyAny> {
        let times = self.kept.as_ref().map(|k| k.times.clone());
        array(py, times.unwrap_or_default()).into_any()
    }

    fn fields<'py>(&self, py: Python<'py>, frame: usize) -> PyResult<Bound<'py, PyDict>> {
        match &self.kept {
            Some(kept) => frames::fields(py, kept, frame),
            None => Ok(PyDict::new(py)),
        }
    }

    fn grids<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        match &self.kept {
            Some(kept) => frames::grids(py, kept),
            None => Ok(PyDict::new(py)),
        }
    }
}
