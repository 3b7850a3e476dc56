//! The chain as a solver that steps itself: how to couple an existing program instead of a [`Model`].

use crate::Chain;
use arlequin::core::Participant;
use arlequin::core::snapshot::Record;
use arlequin::prelude::*;

/// [`Chain`] with its own velocity Verlet scheme.
#[derive(Debug, Clone)]
pub struct ChainSolver {
    chain: Chain,
    inertia: Vec<f64>,
    q: Vec<f64>,
    v: Vec<f64>,
    force: Vec<f64>,
    /// Duration of the last step \[s\].
    step: f64,
}

impl ChainSolver {
    /// Makes a solver from a chain with displacements \[m\] and velocities \[m/s\].
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] unless both have one number per particle.
    pub fn new(chain: Chain, q: Vec<f64>, v: Vec<f64>) -> Result<Self> {
        let n = chain.layout().dofs();
        for (what, found) in [
            ("displacements of the chain", q.len()),
            ("velocities of the chain", v.len()),
        ] {
            if found != n {
                return Err(Error::SizeMismatch {
                    what: what.into(),
                    expected: n,
                    found,
                });
            }
        }
        let (inertia, force) = (vec![0.0; n], vec![0.0; n]);
        Ok(Self {
            chain,
            inertia,
            q,
            v,
            force,
            step: 0.0,
        })
    }

    fn find_forces(&mut self) -> Result<()> {
        self.force.fill(0.0);
        self.chain.add_internal_forces(&self.q, &mut self.force)
    }

    fn half_kick(&mut self, step: f64) {
        for ((v, f), m) in self.v.iter_mut().zip(&self.force).zip(&self.inertia) {
            *v += 0.5 * step * f / m;
        }
    }
}

impl Participant<f64> for ChainSolver {
    fn name(&self) -> &str {
        self.chain.name()
    }
    fn kind(&self) -> &str {
        "chain-solver"
    }
    fn layout(&self) -> DofLayout {
        self.chain.layout()
    }
    fn nodes(&self) -> &[Point3<f64>] {
        self.chain.nodes()
    }

    fn weigh(&mut self, weights: &Weights<f64>, inertia: &mut [f64]) -> Result<()> {
        self.chain.set_internal_weight(&*weights.internal)?;
        self.chain.lumped_inertia(&*weights.kinetic, inertia)?;
        self.inertia.copy_from_slice(inertia);
        self.find_forces()
    }

    fn advance(&mut self, _from: f64, step: f64) -> Result<()> {
        self.half_kick(step);
        self.q.iter_mut().zip(&self.v).for_each(|(q, v)| *q += step * v);
        self.find_forces()?;
        self.half_kick(step);
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
        let nodes = self.force.iter().zip(&self.inertia);
        out.iter_mut().zip(nodes).for_each(|(a, (f, m))| *a = f / m);
        true
    }

    fn kick(&mut self, impulse: &[f64]) -> Result<()> {
        let nodes = impulse.iter().zip(&self.inertia);
        self.v.iter_mut().zip(nodes).for_each(|(v, (p, m))| *v += p / m);
        Ok(())
    }

    fn critical_step(&self) -> Option<f64> {
        let inverse: Vec<f64> = self.inertia.iter().map(|m| 1.0 / m).collect();
        self.chain.clone().critical_step(&inverse).ok()
    }

    /// Returns `½vᵀMv + ½qᵀKq − ⅛Δt² fᵀM⁻¹f`, which velocity Verlet keeps constant at whole steps.
    fn invariant(&self) -> Option<f64> {
        let unknowns = self.v.iter().zip(&self.force).zip(&self.inertia);
        let unknowns: f64 = unknowns
            .map(|((v, f), m)| 0.5 * m * v * v - 0.125 * self.step.powi(2) * f * f / m)
            .sum();
        Some(unknowns + self.chain.internal_energy(&self.q))
    }

    fn save(&self) -> Result<Record<f64>> {
        let vectors = [&self.q, &self.v, &self.force].into_iter().flatten();
        Ok(Record {
            numbers: vectors.chain([&self.step]).copied().collect(),
            integers: Vec::new(),
        })
    }

    fn restore(&mut self, from: &Record<f64>) -> Result<()> {
        let n = self.q.len();
        from.expect(self.chain.name(), 3 * n + 1, 0)?;
        let (q, tail) = from.numbers.split_at(n);
        let (v, tail) = tail.split_at(n);
        self.q.copy_from_slice(q);
        self.v.copy_from_slice(v);
        self.force.copy_from_slice(&tail[..n]);
        self.step = tail[n];
        Ok(())
    }
}
