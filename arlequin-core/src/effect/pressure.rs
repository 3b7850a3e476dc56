//! A pressure that turns with the surface on which it acts.
//!
//! ```text
//! F = -p(t) sum_k a_k(x)      a_k the area vectors of the triangles of the surface in their present places
//! ```
//!
//! A quadrilateral is four triangles around its centre. The force of a triangle goes to its nodes with the
//! weights of its centroid, so force and moment are those of the pressure on the present surface. On a closed
//! surface they are zero. The work is that of a gas only where the whole surface is loaded or its edge is
//! held; elsewhere it depends on the way, as it does in nature.

use super::{AnyEffect, Effect, EffectSpec, Host, Instant};
use crate::contact::{Triangle, largest_turn};
use crate::error::invalid;
use crate::record::Record;
use crate::time::TimeFunction;
use crate::{Error, Result};
use nalgebra::{Point3, Vector3};

/// Specification of a pressure on faces of a surface, an effect on their model.
#[derive(Debug, Clone)]
pub struct FollowingPressure {
    name: String,
    faces: Vec<[u32; 4]>,
    pressure: f64,
    time: TimeFunction<f64>,
}

/// A pressure on faces during a run.
struct Pressed {
    name: String,
    /// Triangles with the weight of the model at their centres.
    triangles: Vec<(Triangle, f64)>,
    rest: Vec<Point3<f64>>,
    pressure: f64,
    time: TimeFunction<f64>,
    /// Forces of the last instant \[N\], for each unknown.
    forces: Vec<f64>,
    /// Smallest cosine of the angle by which a triangle has turned since rest.
    turn: f64,
}

impl FollowingPressure {
    /// Pressure `pressure time(t)` \[Pa\] against the outward normals of some faces, given as in
    /// [`crate::model::Boundary::faces`]. The name is that of the ledger line.
    ///
    /// # Errors
    /// [`Error::InvalidParameter`] without faces, for a pressure that is not finite, and for an invalid time
    /// function.
    pub fn new(name: &str, faces: Vec<[u32; 4]>, pressure: f64, time: TimeFunction<f64>) -> Result<Self> {
        time.validate()?;
        if faces.is_empty() {
            let rule = "must be faces of the surface, one at least; check the selection";
            return Err(invalid(&format!("faces of pressure '{name}'"), "none", rule));
        }
        if !pressure.is_finite() {
            return Err(invalid(&format!("pressure '{name}'"), pressure, "must be finite"));
        }
        Ok(Self {
            name: name.to_owned(),
            faces,
            pressure,
            time,
        })
    }
}

impl EffectSpec<f64> for FollowingPressure {
    fn attach(self: Box<Self>, host: &Host<'_, f64>) -> Result<Box<dyn Effect<f64>>> {
        let (layout, rest) = (host.model.layout(), host.model.nodes());
        if layout.components != 3 || host.model.owned().is_part() {
            return Err(Error::Unsupported {
                model: host.model.name().to_owned(),
                what: format!(
                    "carry pressure '{}', which follows the surface, unless it is a solid and whole on each rank; leave it whole",
                    self.name
                ),
            });
        }
        if let Some(n) = self.faces.iter().flatten().find(|n| **n as usize >= rest.len()) {
            return Err(Error::SizeMismatch {
                what: format!("nodes of '{}' under pressure '{}'", host.model.name(), self.name),
                expected: rest.len(),
                found: *n as usize + 1,
            });
        }
        let weighted = |t: Triangle| {
            let centre = t.places(|n| rest[n as usize].coords).iter().sum::<Vector3<f64>>() / 3.0;
            (t, host.weights.external.value(&centre.into()))
        };
        let triangles = Triangle::cut(&self.faces, rest.len()).into_iter().map(weighted);
        Ok(Box::new(Pressed {
            triangles: triangles.filter(|(_, w)| *w != 0.0).collect(),
            rest: rest.to_vec(),
            forces: vec![0.0; layout.dofs()],
            turn: 1.0,
            name: self.name,
            pressure: self.pressure,
            time: self.time,
        }))
    }
}

impl AnyEffect<f64> for Pressed {
    fn name(&self) -> &str {
        &self.name
    }

    fn save(&self) -> Record<f64> {
        Record {
            numbers: vec![self.turn],
            ..Record::default()
        }
    }

    fn restore(&mut self, from: &Record<f64>) -> Result<()> {
        let [turn] = from.numbers[..] else {
            return Err(Error::SizeMismatch {
                what: format!("record of pressure '{}'", self.name),
                expected: 1,
                found: from.numbers.len(),
            });
        };
        self.turn = turn;
        Ok(())
    }

    fn facts(&self) -> Vec<(String, f64)> {
        vec![largest_turn(self.turn)]
    }
}

impl Effect<f64> for Pressed {
    fn add_forces(&mut self, instant: &Instant<'_, f64>, f: &mut [f64]) -> Result<()> {
        let pressure = self.pressure * self.time.value(instant.time);
        self.forces.fill(0.0);
        if pressure == 0.0 {
            return Ok(());
        }
        let rest = &self.rest;
        let then = |n: u32| rest[n as usize].coords;
        let now = |n: u32| {
            let o = 3 * n as usize;
            then(n) + Vector3::new(instant.q[o], instant.q[o + 1], instant.q[o + 2])
        };
        for (triangle, weight) in &self.triangles {
            self.turn = self.turn.min(triangle.turn(then, now));
            let [a, b, c] = triangle.places(now);
            let force = (b - a).cross(&(c - a)) * (-0.5 * pressure * weight);
            triangle.place([1.0 / 3.0; 3]).add(&force, &mut self.forces);
        }
        f.iter_mut().zip(&self.forces).for_each(|(f, own)| *f += own);
        Ok(())
    }

    fn power(&self, v: &[f64]) -> f64 {
        self.forces.iter().zip(v).map(|(f, v)| f * v).sum()
    }
}
