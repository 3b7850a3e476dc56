//! Velocity Verlet for any model: makes it a solver that a link can serve.

use arlequin_core::nalgebra::Point3;
use arlequin_core::snapshot::Record;
use arlequin_core::{DofLayout, Error, Model, Participant, Result, Weighting, Weights};

/// A [`Model`] that steps itself by velocity Verlet, without supports and loads.
pub struct Verlet {
    model: Box<dyn Model<f64>>,
    inertia: Vec<f64>,
    inverse: Vec<f64>,
    q: Vec<f64>,
    v: Vec<f64>,
    force: Vec<f64>,
    /// Length of the last step \[s\], for the invariant.
    step: f64,
    critical: Option<f64>,
}

impl std::fmt::Debug for Verlet {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Verlet of {}", self.model.name())
    }
}

impl Verlet {
    /// Creates the solver in a given state: displacements \[m, rad\] and velocities \[m/s, rad/s\].
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] unless there is one of each per unknown; [`Error::Unsupported`] for a model
    /// that changes as it moves, such as one whose bonds break.
    pub fn new(mut model: Box<dyn Model<f64>>, q: Vec<f64>, v: Vec<f64>) -> Result<Self> {
        arlequin_core::check_size(&*model, "displacements", q.len())?;
        arlequin_core::check_size(&*model, "velocities", v.len())?;
        // The run's ledger has no line for energy that leaves within another process.
        if model.evolving().is_some() {
            return Err(Error::Unsupported {
                model: model.name().to_owned(),
                what: "step itself: it changes as it moves, and the energy that leaves it has no place in a link".into(),
            });
        }
        let n = q.len();
        Ok(Self {
            model,
            inertia: vec![0.0; n],
            inverse: vec![0.0; n],
            force: vec![0.0; n],
            q,
            v,
            step: 0.0,
            critical: None,
        })
    }

    fn half_kick(&mut self, step: f64) {
        for ((v, f), w) in self.v.iter_mut().zip(&self.force).zip(&self.inverse) {
            *v += 0.5 * step * (w * f);
        }
    }

    fn compute_forces(&mut self) -> Result<()> {
        self.force.fill(0.0);
        self.model.advance(&self.q, &mut self.force)
    }
}

impl Participant<f64> for Verlet {
    fn name(&self) -> &str {
        self.model.name()
    }
    fn kind(&self) -> &str {
        self.model.kind()
    }
    fn layout(&self) -> DofLayout {
        self.model.layout()
    }
    fn nodes(&self) -> &[Point3<f64>] {
        self.model.nodes()
    }

    /// # Errors
    /// [`Error::Unsupported`] for nodal weighting; [`Error::InvalidParameter`] for an unknown without
    /// inertia.
    fn weigh(&mut self, weights: &Weights<f64>, inertia: &mut [f64]) -> Result<()> {
        if weights.weighting == Weighting::Nodal {
            return Err(Error::Unsupported {
                model: self.model.name().to_owned(),
                what:
                    "be weighted at its nodes: as a solver of its own it takes means over elements and bonds"
                        .into(),
            });
        }
        self.model.set_internal_weight(&*weights.internal)?;
        self.model.lumped_inertia(&*weights.kinetic, inertia)?;
        for (i, (m, w)) in inertia.iter().zip(&mut self.inverse).enumerate() {
            if !m.is_finite() || *m <= 0.0 {
                let what = format!("inertia of unknown {i} of '{}'", self.model.name());
                let rule = "must be positive; trim the model to where its weight is, or choose epsilon > 0";
                return Err(arlequin_core::invalid(&what, m, rule));
            }
            *w = 1.0 / m;
        }
        self.inertia.copy_from_slice(inertia);
        self.critical = Some(self.model.critical_step(&self.inverse)?);
        // The first half step needs the forces under the new weights.
        self.compute_forces()
    }

    fn advance(&mut self, _from: f64, step: f64) -> Result<()> {
        self.half_kick(step);
        self.q.iter_mut().zip(&self.v).for_each(|(q, v)| *q += step * v);
        self.compute_forces()?;
        self.half_kick(step);
        // For the invariant, which contains the step.
        self.step = step;
        Ok(())
    }

    fn velocities(&self, out: &mut [f64]) {
        out.copy_from_slice(&self.v);
    }
    fn displacements(&self, out: &mut [f64]) {
        out.copy_from_slice(&self.q);
    }

    fn accelerations(&self, out: &mut [f64]) -> bool {
        let unknowns = self.force.iter().zip(&self.inverse);
        out.iter_mut().zip(unknowns).for_each(|(a, (f, w))| *a = f * w);
        true
    }

    fn kick(&mut self, impulse: &[f64]) -> Result<()> {
        let unknowns = impulse.iter().zip(&self.inverse);
        self.v
            .iter_mut()
            .zip(unknowns)
            .for_each(|(v, (p, w))| *v += p * w);
        Ok(())
    }

    fn critical_step(&self) -> Option<f64> {
        self.critical
    }

    /// Returns `½vᵀMv + U(q) − ⅛Δt² fᵀM⁻¹f` \[J\]: velocity Verlet conserves this energy of a linear model at
    /// whole steps.
    fn invariant(&self) -> Option<f64> {
        let unknowns = self
            .v
            .iter()
            .zip(&self.force)
            .zip(&self.inertia)
            .zip(&self.inverse);
        let nodes: f64 = unknowns
            .map(|(((v, f), m), w)| 0.5 * m * v * v - 0.125 * self.step.powi(2) * f * f * w)
            .sum();
        Some(nodes + self.model.internal_energy(&self.q))
    }

    fn save(&self) -> Result<Record<f64>> {
        let mut record = self.model.save();
        let state = [&self.q, &self.v, &self.force].into_iter().flatten();
        record.numbers.extend(state.chain([&self.step]));
        Ok(record)
    }

    fn restore(&mut self, record: &Record<f64>) -> Result<()> {
        let n = self.q.len();
        // A record of another model is shorter than this state: say so and change nothing.
        let Some(split) = record.numbers.len().checked_sub(3 * n + 1) else {
            return record.expect(self.model.name(), 3 * n + 1, record.integers.len());
        };
        let (of_model, state) = record.numbers.split_at(split);
        self.model.restore(&Record {
            numbers: of_model.to_vec(),
            integers: record.integers.clone(),
        })?;
        let (q, tail) = state.split_at(n);
        let (v, tail) = tail.split_at(n);
        let (force, step) = tail.split_at(n);
        self.q.copy_from_slice(q);
        self.v.copy_from_slice(v);
        self.force.copy_from_slice(force);
        self.step = step[0];
        Ok(())
    }
}
