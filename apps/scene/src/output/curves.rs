//! Curves of one probe over another, `[curve.NAME]`.

use super::csv;
use crate::error::Result;
use crate::recorder::Recorder;
use crate::spec::{Curve, SceneSpec};
use std::path::Path;

/// An axis of a curve.
#[derive(Debug, Clone, PartialEq)]
pub struct CurveAxis {
    /// Name of the probe, its quantity and its factor, if any.
    pub label: String,
    /// SI unit.
    pub unit: String,
    /// Values.
    pub values: Vec<f64>,
}

impl CurveAxis {
    fn for_probe(probe: &str, factor: f64, r: &Recorder) -> Option<Self> {
        let k = r.readers.iter().position(|p| p.name == probe)?;
        let label = r.readers[k].quantity.label();
        let (quantity, unit) = label.strip_suffix(']')?.split_once(" [")?;
        let factor = (
            factor,
            if factor.to_bits() == 1.0_f64.to_bits() {
                String::new()
            } else {
                format!("{factor} ")
            },
        );
        Some(Self {
            label: format!("{}{probe} {quantity}", factor.1),
            unit: unit.to_owned(),
            values: r.probes.columns[k].iter().map(|v| factor.0 * v).collect(),
        })
    }

    fn title(&self) -> String {
        format!("{} [{}]", self.label, self.unit)
    }
}

/// A curve, ready to be written and drawn.
#[derive(Debug, Clone, PartialEq)]
pub struct CurveLine {
    /// Name in the scene.
    pub name: String,
    /// Times \[s\].
    pub times: Vec<f64>,
    /// Horizontal axis.
    pub x: CurveAxis,
    /// Vertical axis.
    pub y: CurveAxis,
}

/// Returns the curves of a scene. A curve whose probe has no reader is left out.
pub(crate) fn of(scene: &SceneSpec, r: &Recorder) -> Vec<CurveLine> {
    let line = |(name, c): (&String, &Curve)| {
        Some(CurveLine {
            name: name.clone(),
            times: r.probes.times.clone(),
            x: CurveAxis::for_probe(&c.x, c.x_factor, r)?,
            y: CurveAxis::for_probe(&c.y, c.y_factor, r)?,
        })
    };
    scene.curve.iter().filter_map(line).collect()
}

/// Writes one table per curve.
pub(crate) fn write(folder: &Path, curves: &[CurveLine]) -> Result<()> {
    curves.iter().try_for_each(|c| {
        let names = ["time [s]".to_owned(), c.x.title(), c.y.title()];
        let path = folder.join(format!("curve-{}.csv", c.name));
        csv(&path, &names, &[&c.times, &c.x.values, &c.y.values])
    })
}
