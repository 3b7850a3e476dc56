//! Curves of one probe over another, `[curve.NAME]`.

use super::csv;
use crate::error::Result;
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

/// Writes one table per curve.
pub(crate) fn write(folder: &Path, curves: &[CurveLine]) -> Result<()> {
    curves.iter().try_for_each(|c| {
        let names = ["time [s]".to_owned(), c.x.title(), c.y.title()];
        let path = folder.join(format!("curve-{}.csv", c.name));
        csv(&path, &names, &[&c.times, &c.x.values, &c.y.values])
    })
}
