//! Weights at the nodes, as in the literature; kept for comparison, for any linear model.

use crate::Owned;
use crate::model::{DofLayout, Model, Views};
use crate::parallel;
use crate::record::Record;
use crate::scalar::check_finite;
use crate::weight::{Uniform, Weight};
use crate::{Error, Real, Result};
use nalgebra::Point3;
use sprs::CsMat;

/// A linear model whose assembled forces and lumped inertia are multiplied by the weight at their node:
/// `β(x_i) M_i q̈_i = −α(x_i) (K q)_i`, [`crate::Weighting::Nodal`].
///
/// `D K` with the diagonal `D` of weights is not symmetric: the forces derive from no energy. The model is
/// therefore not offered as a linear one, so that the static twin and the harmonic analysis refuse it. Its
/// internal energy is `½ qᵀ D K q` \[J\].
pub struct NodallyWeighted<T: Real> {
    model: Box<dyn Model<T>>,
    /// `α(x_i)` per unknown.
    factors: Vec<T>,
    /// `K`, unweighted.
    stiffness: CsMat<T>,
    /// Forces of the model before they are weighted.
    forces: Vec<T>,
}

impl<T: Real> std::fmt::Debug for NodallyWeighted<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("NodallyWeighted")
            .field("model", &self.model.name())
            .finish_non_exhaustive()
    }
}

impl<T: Real> NodallyWeighted<T> {
    /// Wraps a model, with weights of one.
    pub fn new(model: Box<dyn Model<T>>) -> Self {
        let n = model.layout().dofs();
        Self {
            factors: vec![T::one(); n],
            stiffness: CsMat::zero((n, n)),
            forces: vec![T::zero(); n],
            model,
        }
    }

    /// Weight at the node of every unknown.
    fn at_nodes(&self, weight: &dyn Weight<T>) -> Result<Vec<T>> {
        let (layout, nodes) = (self.model.layout(), self.model.nodes());
        let repeated = |nodes: &[Point3<T>], count: usize| -> Vec<T> {
            let values = nodes.iter().map(|x| weight.value(x));
            values.flat_map(|w| std::iter::repeat_n(w, count)).collect()
        };
        let mut out = repeated(nodes, layout.components);
        out.extend(repeated(nodes, layout.rotations));
        check_finite("nodal weights", &out)?;
        Ok(out)
    }

    /// Adds to `f` the forces that `find` computes, times the weights.
    fn weigh(
        &mut self,
        f: &mut [T],
        find: impl FnOnce(&mut dyn Model<T>, &mut [T]) -> Result<()>,
    ) -> Result<()> {
        // Weighted apart from `f`, which holds forces of others.
        self.forces.fill(T::zero());
        find(&mut *self.model, &mut self.forces)?;
        let weighted = self.forces.iter().zip(&self.factors);
        f.iter_mut().zip(weighted).for_each(|(f, (g, w))| *f += *g * *w);
        Ok(())
    }
}

impl<T: Real> Model<T> for NodallyWeighted<T> {
    fn name(&self) -> &str {
        self.model.name()
    }
    fn kind(&self) -> &str {
        self.model.kind()
    }
    fn layout(&self) -> DofLayout {
        self.model.layout()
    }
    fn nodes(&self) -> &[Point3<T>] {
        self.model.nodes()
    }
    fn views(&self) -> Views<'_, T> {
        Views {
            linear: None,
            step_bound: None,
            // The wrapped model keeps a weight of one.
            means: None,
            ..self.model.views()
        }
    }

    fn lumped_inertia(&self, weight: &dyn Weight<T>, out: &mut [T]) -> Result<()> {
        self.model.lumped_inertia(&Uniform(T::one()), out)?;
        let weights = self.at_nodes(weight)?;
        out.iter_mut().zip(&weights).for_each(|(m, w)| *m *= *w);
        Ok(())
    }

    /// # Errors
    /// [`Error::Unsupported`] for a model that is not linear, or that changes itself.
    fn set_internal_weight(&mut self, alpha: &dyn Weight<T>) -> Result<()> {
        // The wrapped model stays unweighted: weights act on its forces.
        self.model.set_internal_weight(&Uniform(T::one()))?;
        self.factors = self.at_nodes(alpha)?;
        // A stiffness that changes would leave the stored one, and the energy with it, behind.
        let changes = self.model.evolving().is_some();
        let Some(linear) = self.model.views().linear.filter(|_| !changes) else {
            return Err(Error::Unsupported {
                model: self.model.name().to_owned(),
                what: "be weighted at its nodes: it is not linear, or its bonds can break; take energy weighting"
                    .into(),
            });
        };
        self.stiffness = linear.stiffness().to_csr();
        Ok(())
    }

    fn add_internal_forces(&mut self, q: &[T], f: &mut [T]) -> Result<()> {
        self.weigh(f, |model, g| model.add_internal_forces(q, g))
    }

    fn advance(&mut self, q: &[T], f: &mut [T]) -> Result<()> {
        self.weigh(f, |model, g| model.advance(q, g))
    }

    fn internal_energy(&self, q: &[T]) -> T {
        let (factors, stiffness) = (&self.factors, &self.stiffness);
        let product = |i: usize| -> T {
            let row = stiffness.outer_view(i);
            row.map_or_else(T::zero, |r| r.iter().map(|(j, k)| *k * q[j]).sum())
        };
        let sum = |range: std::ops::Range<usize>| range.map(|i| factors[i] * q[i] * product(i)).sum();
        T::of(0.5) * parallel::sum(q.len(), &sum)
    }

    // The default of the trait computes the critical step from the weighted forces. It takes the quadratic
    // form of `M⁻¹ D K` in the metric of the weighted masses, which also bounds the model under constraints.
    // The spectrum of the model alone does not: equal weights of force and mass cancel in it.

    fn owned(&self) -> Owned {
        self.model.owned()
    }
    fn save(&self) -> Record<T> {
        self.model.save()
    }
    fn restore(&mut self, from: &Record<T>) -> Result<()> {
        self.model.restore(from)
    }
}
