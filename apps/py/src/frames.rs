//! The states of all models at some times of a run, with the arrays that frames in a results folder have.

use crate::arrays::{array, coordinates, rows};
use arlequin::core::Coupled;
use arlequin_scene::Prepared;
use arlequin_scene::output::{Array, Frames, Pictures};
use arlequin_scene::setup::Grid;
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::Arc;

/// A model at one time: arrays over its points, arrays over its cells.
type State = [Vec<Array<'static>>; 2];

/// Frames of a run that are kept in memory.
pub(crate) struct KeptFrames {
    painter: Frames,
    names: Vec<String>,
    every: usize,
    /// Grids of the models in their reference positions.
    pub(crate) grids: Vec<(String, Arc<Grid>)>,
    /// Times \[s\].
    pub(crate) times: Vec<f64>,
    /// States of all models at these times.
    pub(crate) states: Vec<Vec<State>>,
}

impl KeptFrames {
    /// Prepares about `count` frames, or as many as the scene asks for. The first frame is the state before
    /// the first step.
    pub(crate) fn new(prepared: &Prepared, count: Option<usize>) -> arlequin_scene::Result<Self> {
        let (built, scene) = (prepared.built(), prepared.scene());
        let pictures = Pictures {
            models: built.models.clone(),
            mediators: Vec::new(),
            rigid: Vec::new(),
        };
        // No files are written, so the folder may be an empty name.
        let painter = Frames::new(
            Default::default(),
            &scene.spec().output.fields,
            &built.run,
            pictures,
        );
        let names = built.run.subdomains().iter().map(|s| s.model().name().to_owned());
        let names: Vec<String> = names.collect();
        let every = match count {
            None => built.frame_every,
            // Never due.
            Some(0) => usize::MAX,
            Some(n) => built.steps.div_ceil(n).max(1),
        };
        let grids = names
            .iter()
            .cloned()
            .zip(built.models.iter().map(|m| m.grid.clone()));
        let mut out = Self {
            grids: grids.collect(),
            painter,
            names,
            every,
            times: Vec::new(),
            states: Vec::new(),
        };
        if count != Some(0) && built.load_steps.is_none() {
            out.take(&built.run)?;
        }
        Ok(out)
    }

    /// Takes a frame if one is due after this step, and after the last step.
    pub(crate) fn look(&mut self, run: &Coupled<f64>, planned: usize) -> arlequin_scene::Result<()> {
        let due =
            run.steps().is_multiple_of(self.every) || (run.steps() == planned && self.every < usize::MAX);
        // While a model sleeps, the run has other models than these frames.
        let same_models = || {
            let now = run.subdomains().iter().map(|s| s.model().name());
            now.eq(self.names.iter().map(String::as_str))
        };
        if due && same_models() {
            self.take(run)
        } else {
            Ok(())
        }
    }

    fn take(&mut self, run: &Coupled<f64>) -> arlequin_scene::Result<()> {
        let mut state = Vec::with_capacity(self.names.len());
        while let Some(p) = self.painter.picture(run, state.len())? {
            let own = |list: Vec<Array<'_>>| list.into_iter().map(Array::into_owned).collect();
            state.push([own(p.points), own(p.cells)]);
        }
        self.times.push(run.time());
        self.states.push(state);
        Ok(())
    }
}

/// Returns one frame as `{model: {"points": {name: array}, "cells": {name: array}}}`.
pub(crate) fn fields<'py>(py: Python<'py>, kept: &KeptFrames, frame: usize) -> PyResult<Bound<'py, PyDict>> {
    let out = PyDict::new(py);
    let Some(states) = kept.states.get(frame) else {
        return Ok(out);
    };
    for (name, state) in kept.names.iter().zip(states) {
        let model = PyDict::new(py);
        for (part, arrays) in ["points", "cells"].into_iter().zip(state) {
            let by_name = PyDict::new(py);
            for a in arrays {
                match a.components {
                    1 => by_name.set_item(&a.name, array(py, a.values.to_vec()))?,
                    n => by_name.set_item(&a.name, rows(py, a.values.to_vec(), n)?)?,
                }
            }
            model.set_item(part, by_name)?;
        }
        out.set_item(name, model)?;
    }
    Ok(out)
}

/// Returns the grids as `{model: {"points", "cells", "cell_type", "radii"}}`.
pub(crate) fn grids<'py>(py: Python<'py>, kept: &KeptFrames) -> PyResult<Bound<'py, PyDict>> {
    let out = PyDict::new(py);
    for (name, grid) in &kept.grids {
        let entry = PyDict::new(py);
        entry.set_item("points", coordinates(py, &grid.points)?)?;
        let cells: Vec<i64> = grid.connectivity.iter().map(|k| i64::from(*k)).collect();
        let cells = PyArray1::from_vec(py, cells).call_method1("reshape", (-1, grid.corners))?;
        entry.set_item("cells", cells)?;
        entry.set_item("cell_type", grid.cell_type)?;
        entry.set_item("radii", array(py, grid.radii.clone()))?;
        out.set_item(name, entry)?;
    }
    Ok(out)
}
