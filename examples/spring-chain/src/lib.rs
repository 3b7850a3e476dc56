//! Harmonic chain written against the traits as any third party would: masses, springs, nothing else.
//!
//! `U = Σ_bonds ᾱ_b C/2 (q_{k+1} − q_k)²`. Each bond carries half of a particle's mass at either end. Energy
//! and mass of a bond are weighted by the mean of the weight over the bond. To write a model of your own,
//! copy this crate and change the law; `tests/conformance.rs` checks what the coupling relies on.

mod solver;

pub use solver::ChainSolver;

use arlequin::core::geometry::Cell;
use arlequin::core::invalid;
use arlequin::core::sprs::{CsMat, TriMat};
use arlequin::prelude::*;

/// Largest number of springs.
const MOST_BONDS: usize = 1 << 24;

/// Chain of equal masses and springs along x.
#[derive(Debug, Clone)]
pub struct Chain {
    name: String,
    nodes: Vec<Point3<f64>>,
    mass: f64,
    stiffness: Vec<f64>,
    bond_weight: Vec<f64>,
    field: Arc<FemField<f64>>,
}

impl Chain {
    /// Makes a chain of `bonds` springs of stiffness `stiffness` \[N/m\] from `x0` \[m\] with spacing `r`
    /// \[m\]. `mass`: mass of a particle \[kg\]; the two end particles have half of it.
    ///
    /// # Errors
    /// [`Error::InvalidParameter`] for a value that is not positive and finite, or too many bonds.
    pub fn new(name: &str, x0: f64, r: f64, bonds: usize, mass: f64, stiffness: f64) -> Result<Self> {
        for (what, value) in [
            ("chain spacing", r),
            ("chain mass", mass),
            ("chain stiffness", stiffness),
        ] {
            if !value.is_finite() || value <= 0.0 {
                return Err(invalid(what, value, "must be positive and finite"));
            }
        }
        // More would not fit into memory, and a mistyped spacing easily asks for them.
        if bonds == 0 || bonds > MOST_BONDS {
            let rule = format!("must be between 1 and {MOST_BONDS}");
            return Err(invalid("chain bonds", bonds, &rule));
        }
        let nodes: Vec<_> = (0..=bonds)
            .map(|k| Point3::new(x0 + r * k as f64, 0.0, 0.0))
            .collect();
        // The field is linear between two masses, as natural neighbours on a line would make it.
        let field = Arc::new(FemField::on_line(nodes.clone(), 1.0)?);
        let (stiffness, bond_weight) = (vec![stiffness; bonds], vec![1.0; bonds]);
        Ok(Self {
            name: name.to_owned(),
            nodes,
            mass,
            stiffness,
            bond_weight,
            field,
        })
    }

    /// Sets the cross-section of the chain as a bar \[m²\]; 1 m² by default. A bar coupled with it must have
    /// the same section or the same mass per length.
    ///
    /// # Errors
    /// [`Error::Model`] for a section that is not positive and finite.
    pub fn with_section(mut self, section: f64) -> Result<Self> {
        self.field = Arc::new(FemField::on_line(self.nodes.clone(), section)?);
        Ok(self)
    }

    /// Sets the stiffness of each bond \[N/m\].
    #[must_use]
    pub fn with_stiffness(mut self, of_bond: impl Fn(usize) -> f64) -> Self {
        self.stiffness = (0..self.stiffness.len()).map(of_bond).collect();
        self
    }

    fn bond(&self, b: usize) -> Cell<f64> {
        Cell::Segment {
            ends: [self.nodes[b], self.nodes[b + 1]],
            section: 1.0,
        }
    }

    /// Returns the weighted stiffness of each bond \[N/m\].
    fn bonds(&self) -> impl Iterator<Item = f64> + '_ {
        self.bond_weight.iter().zip(&self.stiffness).map(|(w, k)| w * k)
    }
}

impl Model<f64> for Chain {
    fn name(&self) -> &str {
        &self.name
    }
    fn kind(&self) -> &str {
        "chain"
    }
    fn layout(&self) -> DofLayout {
        DofLayout {
            nodes: self.nodes.len(),
            components: 1,
            rotations: 0,
        }
    }
    fn nodes(&self) -> &[Point3<f64>] {
        &self.nodes
    }

    fn lumped_inertia(&self, weight: &dyn Weight<f64>, out: &mut [f64]) -> Result<()> {
        out.fill(0.0);
        for b in 0..self.bond_weight.len() {
            let mean = weight.mean(&self.bond(b));
            for k in [b, b + 1] {
                out[k] += 0.5 * self.mass * mean;
            }
        }
        Ok(())
    }

    fn set_internal_weight(&mut self, alpha: &dyn Weight<f64>) -> Result<()> {
        self.bond_weight = (0..self.bond_weight.len())
            .map(|b| alpha.mean(&self.bond(b)))
            .collect();
        Ok(())
    }

    fn add_internal_forces(&mut self, q: &[f64], f: &mut [f64]) -> Result<()> {
        for (b, k) in self.bonds().enumerate() {
            let tension = k * (q[b + 1] - q[b]);
            f[b] += tension;
            f[b + 1] -= tension;
        }
        Ok(())
    }

    fn internal_energy(&self, q: &[f64]) -> f64 {
        let bonds = self.bonds().zip(q.windows(2));
        bonds.map(|(k, q)| 0.5 * k * (q[1] - q[0]).powi(2)).sum()
    }

    fn views(&self) -> Views<'_, f64> {
        let mut views = Views::default();
        views.linear = Some(self);
        views
    }
}

impl LinearModel<f64> for Chain {
    fn stiffness(&self) -> CsMat<f64> {
        let n = self.nodes.len();
        let mut t = TriMat::new((n, n));
        for (b, k) in self.bonds().enumerate() {
            for (i, j, v) in [(b, b, k), (b, b + 1, -k), (b + 1, b, -k), (b + 1, b + 1, k)] {
                t.add_triplet(i, j, v);
            }
        }
        t.to_csr()
    }
}

impl FineModel<f64> for Chain {
    fn fine_field(&self) -> Arc<dyn Interpolation<f64>> {
        self.field.clone()
    }
}
