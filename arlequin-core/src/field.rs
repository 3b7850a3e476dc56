//! Fields: how nodal values of a model or a mediator become a value at any point of its domain.

use crate::geometry::{Cell, Sample};
use crate::{Error, Real, Result};
use nalgebra::{Point3, Vector3};
use std::collections::HashMap;

/// One evaluation of shape functions: `u(x) = Σ_k values[k] u[nodes[k]]`. Owned and reused by the caller.
#[derive(Debug, Clone, Default)]
pub struct ShapeRow<T: Real> {
    /// Nodes with a non-zero shape function.
    pub nodes: Vec<usize>,
    /// Values \[–\], one per node.
    pub values: Vec<T>,
    /// Gradients \[1/m\], one per node if they were asked for.
    pub gradients: Vec<Vector3<T>>,
}

impl<T: Real> ShapeRow<T> {
    /// Empties the row and keeps its memory.
    pub fn clear(&mut self) {
        self.nodes.clear();
        self.values.clear();
        self.gradients.clear();
    }
    /// Adds a node without gradient.
    pub fn push(&mut self, node: usize, value: T) {
        self.nodes.push(node);
        self.values.push(value);
    }
    /// Adds a node with its gradient.
    pub fn push_with_gradient(&mut self, node: usize, value: T, gradient: Vector3<T>) {
        self.push(node, value);
        self.gradients.push(gradient);
    }
}

/// A continuous field on nodes or particles: finite elements, natural neighbours, moving least squares ...
///
/// The coupling conserves momenta only with shape functions that sum to one and reproduce linear fields at every
/// point (checked by [`crate::conformance`]).
pub trait Interpolation<T: Real>: Send + Sync {
    /// Reference positions of the nodes \[m\].
    fn nodes(&self) -> &[Point3<T>];

    /// Shape functions at `x`, with gradients where `gradient` is set.
    ///
    /// # Errors
    /// [`Error::OutsideDomain`] outside the closed domain; [`Error::NoGradient`] if the field has none.
    fn shape_at(&self, x: &Point3<T>, gradient: bool, row: &mut ShapeRow<T>) -> Result<()>;

    /// Shape functions at a point known to lie in cell `cell` of [`Interpolation::cells`]; a field that can skip its
    /// point location does so.
    ///
    /// # Errors
    /// As [`Interpolation::shape_at`].
    fn shape_in(&self, cell: usize, x: &Point3<T>, gradient: bool, row: &mut ShapeRow<T>) -> Result<()> {
        let _ = cell;
        self.shape_at(x, gradient, row)
    }

    /// Cells on which the shape functions are smooth and which fill the domain; empty if the field has no such thing.
    fn cells(&self) -> Vec<Cell<T>> {
        Vec::new()
    }

    /// Polynomial degree of the shape functions on a cell; chooses the quadrature.
    fn degree(&self) -> usize {
        1
    }

    /// The field's own integration points, for fields that exist only there (particle quadrature).
    fn samples(&self) -> Option<&[Sample<T>]> {
        None
    }

    /// What the field is, for messages: "finite-element", "particle" ...
    fn kind(&self) -> &'static str {
        "interpolated"
    }
}

/// Particle quadrature `∫ λ·ḋ ≈ Σ_i V_i λ(x_i)·ḋ_i`: the field exists at the particle centres only.
///
/// Both sides of an interface are then sampled at the particles, which keeps both momenta exact.
#[derive(Debug, Clone)]
pub struct ParticleField<T: Real> {
    centres: Vec<Point3<T>>,
    samples: Vec<Sample<T>>,
    index: HashMap<[u64; 3], usize>,
}

impl<T: Real> ParticleField<T> {
    /// Field on particle centres \[m\] with the volume each stands for \[m³\].
    ///
    /// # Errors
    /// [`Error::SizeMismatch`], [`Error::NotFinite`], or [`Error::InvalidParameter`] for coincident particles and
    /// volumes that are not positive.
    pub fn new(centres: Vec<Point3<T>>, volumes: &[T]) -> Result<Self> {
        if centres.len() != volumes.len() {
            return Err(Error::SizeMismatch {
                what: "particle volumes".into(),
                expected: centres.len(),
                found: volumes.len(),
            });
        }
        let mut index = HashMap::with_capacity(centres.len());
        let mut samples = Vec::with_capacity(centres.len());
        for (k, (p, v)) in centres.iter().zip(volumes).enumerate() {
            crate::scalar::check_finite("particle centres", p.coords.as_slice())?;
            if !v.is_finite() || *v <= T::zero() {
                return Err(crate::error::invalid(
                    &format!("volume of particle {k}"),
                    v,
                    "must be positive",
                ));
            }
            if let Some(other) = index.insert(Self::key(p), k) {
                return Err(crate::error::invalid(
                    &format!("position of particle {k}"),
                    p,
                    &format!("coincides with particle {other}; remove one"),
                ));
            }
            samples.push(Sample {
                point: *p,
                measure: *v,
            });
        }
        Ok(Self {
            centres,
            samples,
            index,
        })
    }

    fn key(p: &Point3<T>) -> [u64; 3] {
        [p.x, p.y, p.z].map(|c| (c + T::zero()).as_f64().to_bits())
    }
}

impl<T: Real> Interpolation<T> for ParticleField<T> {
    fn nodes(&self) -> &[Point3<T>] {
        &self.centres
    }

    fn shape_at(&self, x: &Point3<T>, gradient: bool, row: &mut ShapeRow<T>) -> Result<()> {
        if gradient {
            return Err(Error::NoGradient {
                role: self.kind().into(),
                junction: "H1".into(),
            });
        }
        row.clear();
        match self.index.get(&Self::key(x)) {
            Some(&k) => {
                row.push(k, T::one());
                Ok(())
            }
            None => Err(outside(x, self.kind())),
        }
    }

    fn samples(&self) -> Option<&[Sample<T>]> {
        Some(&self.samples)
    }

    fn kind(&self) -> &'static str {
        "particle"
    }
}

/// Shorthand for [`Error::OutsideDomain`].
pub fn outside<T: Real>(x: &Point3<T>, role: &str) -> Error {
    Error::OutsideDomain {
        point: [x.x.as_f64(), x.y.as_f64(), x.z.as_f64()],
        role: role.to_owned(),
    }
}
