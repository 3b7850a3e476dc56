//! The overlap absorber: removes what the coarse model cannot carry.
//!
//! The constrained scheme filters nothing: above the coarse cutoff everything is reflected. The absorber damps the
//! unresolved part `v' = v − P v` of the fine velocities in the overlap, `P` being the mass-weighted projection onto a
//! resolved space (the mediator's or a coarser one), in the symmetric form
//! `F = −(I − P)ᵀ diag(m η) (I − P) v`: rigid motions are untouched, energy only leaves.

use super::{AnyEffect, Effect, EffectSpec, Host, Instant, StepDemand};
use crate::error::invalid;
use crate::field::{Interpolation, ShapeRow};
use crate::linalg::SpdFactor;
use crate::model::Arms;
use crate::scalar::dot;
use crate::{Error, Real, Result};
use sprs::{CsMat, TriMat};
use std::sync::Arc;

/// Damping rate `η` \[1/s\] as a function of position.
pub type RateField<T> = Arc<dyn Fn(&nalgebra::Point3<T>) -> T + Send + Sync>;

/// The absorber of one overlap, acting on the fine model.
pub struct Absorber<T: Real> {
    resolved: Arc<dyn Interpolation<T>>,
    rate: RateField<T>,
}

/// The same on the nodes of a model.
struct AttachedAbsorber<T: Real> {
    top_rate: T,
    components: usize,
    nodes: Vec<usize>,
    shapes: CsMat<T>,
    factor: Box<dyn SpdFactor<T>>,
    mass: Vec<T>,
    damping: Vec<T>,
    coarse: Vec<T>,
    work: Vec<T>,
    force: Vec<T>,
}

impl<T: Real> std::fmt::Debug for Absorber<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Absorber with {} resolved nodes", self.resolved.nodes().len())
    }
}

impl<T: Real> Absorber<T> {
    /// Absorber that keeps what `resolved` can represent and damps the rest at the local rate \[1/s\].
    ///
    /// The rate should grow from 0 at the border to the fine model's own region; `0.2 c/r` at its largest is
    /// a good value (`c` wave speed, `r` particle spacing).
    pub fn new(resolved: Arc<dyn Interpolation<T>>, rate: RateField<T>) -> Self {
        Self { resolved, rate }
    }
}

impl<T: Real> AttachedAbsorber<T> {
    /// `w ← w − N (NᵀMN)⁻¹ NᵀM w`, or its transpose `w ← w − M N (NᵀMN)⁻¹ Nᵀ w`.
    fn remove_resolved(&mut self, transposed: bool) {
        let shapes = &self.shapes;
        let mass = |i: usize, on: bool| if on { self.mass[i] } else { T::one() };
        self.coarse.fill(T::zero());
        for (i, row) in shapes.outer_iterator().enumerate() {
            let w = self.work[i] * mass(i, !transposed);
            row.iter().for_each(|(j, n)| self.coarse[j] += *n * w);
        }
        self.factor.solve(&mut self.coarse);
        for (i, row) in shapes.outer_iterator().enumerate() {
            let p: T = row.iter().map(|(j, n)| *n * self.coarse[j]).sum();
            self.work[i] -= p * mass(i, transposed);
        }
    }
}

impl<T: Real> EffectSpec<T> for Absorber<T> {
    fn attach(self: Box<Self>, to: &Host<'_, T>) -> Result<Box<dyn Effect<T>>> {
        let layout = to.model.layout();
        let mut row = ShapeRow::default();
        let mut shapes: Vec<(usize, Vec<(usize, T)>)> = Vec::new();
        for (node, x) in to.model.nodes().iter().enumerate() {
            match self.resolved.shape_at(x, false, &mut row) {
                Ok(()) => shapes.push((
                    node,
                    row.nodes
                        .iter()
                        .copied()
                        .zip(row.values.iter().copied())
                        .collect(),
                )),
                Err(Error::OutsideDomain { .. }) => {}
                Err(e) => return Err(e),
            }
        }
        if shapes.is_empty() {
            return Err(invalid(
                "absorber",
                to.model.name(),
                "has no node of this model in its resolved space",
            ));
        }
        let nodes: Vec<usize> = shapes.iter().map(|s| s.0).collect();
        // Only shape functions that touch a node take part.
        let mut used: Vec<usize> = shapes
            .iter()
            .flat_map(|s| s.1.iter().filter(|e| e.1 != T::zero()).map(|e| e.0))
            .collect();
        used.sort_unstable();
        used.dedup();
        let mut n = TriMat::new((shapes.len(), used.len()));
        for (i, (_, entries)) in shapes.iter().enumerate() {
            for (j, v) in entries.iter().filter(|e| e.1 != T::zero()) {
                n.add_triplet(i, used.partition_point(|u| u < j), *v);
            }
        }
        let mass: Vec<T> = nodes.iter().map(|k| to.inertia[k * layout.components]).collect();
        let mut gram = TriMat::new((used.len(), used.len()));
        let n: CsMat<T> = n.to_csr();
        for (i, r) in n.outer_iterator().enumerate() {
            for (a, x) in r.iter() {
                r.iter()
                    .for_each(|(b, y)| gram.add_triplet(a, b, *x * *y * mass[i]));
            }
        }
        let factor = T::cholesky(&gram.to_csc()).map_err(|_| {
            let counts = format!("{} resolved unknowns for {} nodes", used.len(), nodes.len());
            invalid(
                "absorber",
                counts,
                "the resolved space must be coarser than the model",
            )
        })?;
        let rates: Vec<T> = nodes.iter().map(|&k| (self.rate)(&to.model.nodes()[k])).collect();
        if let Some(bad) = rates.iter().find(|r| !(**r >= T::zero() && r.is_finite())) {
            return Err(invalid("absorber rate", bad, "must be finite and not negative"));
        }
        Ok(Box::new(AttachedAbsorber {
            top_rate: rates.iter().fold(T::zero(), |a, b| a.max(*b)),
            components: layout.components,
            damping: rates.iter().zip(&mass).map(|(r, m)| *r * *m).collect(),
            coarse: vec![T::zero(); used.len()],
            work: vec![T::zero(); nodes.len()],
            force: vec![T::zero(); nodes.len() * layout.components],
            nodes,
            shapes: n,
            factor,
            mass,
        }))
    }
}

impl<T: Real> AnyEffect<T> for AttachedAbsorber<T> {
    fn name(&self) -> &str {
        "absorber"
    }

    /// It leaves rigid motion alone.
    fn arms(&self) -> Option<Arms> {
        Some(Arms::Reference)
    }

    fn supplied(&self) -> Option<T> {
        Some(T::zero())
    }
}

impl<T: Real> Effect<T> for AttachedAbsorber<T> {
    fn add_forces(&mut self, at: &Instant<'_, T>, f: &mut [T]) -> Result<()> {
        let d = self.components;
        for c in 0..d {
            (0..self.nodes.len()).for_each(|i| self.work[i] = at.v_half[self.nodes[i] * d + c]);
            self.remove_resolved(false);
            self.work
                .iter_mut()
                .zip(&self.damping)
                .for_each(|(w, k)| *w *= -*k);
            self.remove_resolved(true);
            for (i, &node) in self.nodes.iter().enumerate() {
                f[node * d + c] += self.work[i];
                self.force[i * d + c] = self.work[i];
            }
        }
        Ok(())
    }

    fn power(&self, v: &[T]) -> T {
        let d = self.components;
        let node = |(i, &k): (usize, &usize)| dot(&self.force[i * d..(i + 1) * d], &v[k * d..(k + 1) * d]);
        self.nodes.iter().enumerate().map(node).sum()
    }

    fn step_demand(&self) -> StepDemand<T> {
        StepDemand::damping(self.top_rate)
    }
}
