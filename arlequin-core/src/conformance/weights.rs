//! Checks that models and weights share mass and energy as the coupling relies on.

use super::fixed_noise;
use crate::geometry::{self, Cell};
use crate::model::Model;
use crate::weight::{Complement, Uniform, Weight};
use crate::{Real, Result};
use nalgebra::Point3;
use std::sync::Arc;

/// Deviations of a model from its weights; all zero up to round-off for a correct model.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct WeightDefect<T> {
    /// Largest deviation of twice the inertia with the weight ½ from the unweighted inertia, relative to the
    /// largest inertia.
    pub half_inertia: T,
    /// Largest deviation of the sum of the inertias with the weights `w` and `1 − w` from the unweighted
    /// inertia, relative to the largest inertia.
    pub inertia: T,
    /// Deviation of twice the internal energy with the weight ½ from the unweighted energy, relative to the
    /// latter.
    pub half_energy: T,
    /// Deviation of the sum of the energies with `w` and `1 − w` from the unweighted energy, relative to the
    /// latter.
    pub energy: T,
    /// Largest deviation of the sum of the internal forces with `w` and `1 − w` from the unweighted forces,
    /// relative to the largest force.
    pub forces: T,
}

/// Checks that inertia, internal energy and internal forces of a model are linear in its weight `w`, at
/// displacements of the given amplitude \[m\]. Leaves the model with a weight of one.
///
/// # Errors
/// Errors of the model.
pub fn weights<T: Real>(
    model: &mut dyn Model<T>,
    w: &Arc<dyn Weight<T>>,
    amplitude: T,
) -> Result<WeightDefect<T>> {
    let n = model.layout().dofs();
    // Any displacements will do: linearity in the weight holds at each of them.
    let q: Vec<T> = (0..n).map(|i| fixed_noise::<T>(i) * amplitude).collect();
    let mut under = |weight: &dyn Weight<T>| -> Result<(Vec<T>, Vec<T>, T)> {
        let (mut inertia, mut forces) = (vec![T::zero(); n], vec![T::zero(); n]);
        model.lumped_inertia(weight, &mut inertia)?;
        model.set_internal_weight(weight)?;
        model.add_internal_forces(&q, &mut forces)?;
        Ok((inertia, forces, model.internal_energy(&q)))
    };
    let (half, weighted) = (under(&Uniform(T::of(0.5)))?, under(&**w)?);
    let (complement, whole) = (under(&Complement(vec![w.clone()]))?, under(&Uniform(T::one()))?);
    let sum = |a: &[T], b: &[T]| -> Vec<T> { a.iter().zip(b).map(|(a, b)| *a + *b).collect() };
    let relative_gap = |a: &[T], b: &[T]| {
        let top = b.iter().fold(T::zero(), |m, x| m.max(x.abs()));
        let apart = a.iter().zip(b).map(|(a, b)| (*a - *b).abs());
        apart.fold(T::zero(), |m, x| m.max(x)) / top
    };
    Ok(WeightDefect {
        half_inertia: relative_gap(&sum(&half.0, &half.0), &whole.0),
        inertia: relative_gap(&sum(&weighted.0, &complement.0), &whole.0),
        half_energy: relative_gap(&[half.2 + half.2], &[whole.2]),
        energy: relative_gap(&[weighted.2 + complement.2], &[whole.2]),
        forces: relative_gap(&sum(&weighted.1, &complement.1), &whole.1),
    })
}

/// A weight up to a place along x and its complement beyond. A cell that reaches beyond has the mean of the
/// complement.
struct Switched<T: Real> {
    below: Arc<dyn Weight<T>>,
    beyond: Complement<T>,
    border: T,
}

impl<T: Real> Weight<T> for Switched<T> {
    fn value(&self, x: &Point3<T>) -> T {
        let beyond = x.x > self.border;
        if beyond {
            self.beyond.value(x)
        } else {
            self.below.value(x)
        }
    }

    fn mean(&self, cell: &Cell<T>) -> T {
        let beyond = geometry::inner_bounds(cell)[1].x > self.border;
        if beyond {
            self.beyond.mean(cell)
        } else {
            self.below.mean(cell)
        }
    }
}

/// Checks that the weights of a model may change in the middle of a run ([`crate::Coupled::rezone`]), at
/// displacements of the given amplitude \[m\]: after a change to `1 − w` and back, forces under `w` are what
/// they were; a change of one half of the model by [`Model::change_internal_weight`] gives the forces of the
/// whole weight; and nodes where `w` leaves no mass get no force. Returns the largest deviation relative to
/// the largest force; zero for a correct model. `w` should be zero in a part of the model.
///
/// # Errors
/// Errors of the model.
pub fn reweighing<T: Real>(model: &mut dyn Model<T>, w: &Arc<dyn Weight<T>>, amplitude: T) -> Result<T> {
    let layout = model.layout();
    let n = layout.dofs();
    let q: Vec<T> = (0..n).map(|i| fixed_noise::<T>(i) * amplitude).collect();
    let [low, high] = geometry::bounds_of(model.nodes().iter());
    let border = (low.x + high.x) * T::of(0.5);
    let beyond = Complement(vec![w.clone()]);
    let switched = Switched {
        below: w.clone(),
        beyond: beyond.clone(),
        border,
    };
    let forces = |model: &mut dyn Model<T>| -> Result<Vec<T>> {
        let mut f = vec![T::zero(); n];
        model.add_internal_forces(&q, &mut f)?;
        Ok(f)
    };
    model.set_internal_weight(&**w)?;
    let first = forces(model)?;
    // A run saves what a model remembers, such as orientations, and restores it.
    let memory = model.save();
    model.set_internal_weight(&beyond)?;
    model.set_internal_weight(&**w)?;
    model.restore(&memory)?;
    let back = forces(model)?;
    model.change_internal_weight(&switched, &move |b| b[1].x > border)?;
    model.restore(&memory)?;
    let half = forces(model)?;
    model.set_internal_weight(&switched)?;
    model.restore(&memory)?;
    let whole = forces(model)?;
    let mut inertia = vec![T::zero(); n];
    model.lumped_inertia(&**w, &mut inertia)?;
    let largest = |x: &mut dyn Iterator<Item = T>| x.fold(T::zero(), |m, x| m.max(x.abs()));
    let top_mass = largest(&mut inertia[..layout.translations()].iter().copied());
    let no_mass = top_mass * T::epsilon() * T::of(4.0);
    let apart = |a: &[T], b: &[T]| largest(&mut a.iter().zip(b).map(|(a, b)| *a - *b));
    let changed = apart(&first, &back).max(apart(&half, &whole));
    let asleep = (0..n).filter(|i| inertia[layout.node_of(*i) * layout.components] <= no_mass);
    let pushed = largest(&mut asleep.map(|i| first[i]));
    Ok(changed.max(pushed) / largest(&mut first.iter().copied()))
}

/// Largest difference between the mean of a weight over a cell and the mean of its values by quadrature on 64
/// parts of the cell (four of a line). Zero up to round-off for a weight that is a polynomial of at most
/// fifth degree on each part.
pub fn weight_means<T: Real>(weight: &dyn Weight<T>, cells: &[Cell<T>]) -> T {
    let gap = |c: &Cell<T>| (weight.mean(c) - geometry::mean(c, 2, &|x| weight.value(x))).abs();
    cells.iter().map(gap).fold(T::zero(), |m, x| m.max(x))
}
