//! Reactions of a subdomain: balance of its prescribed unknowns, and resultants of forces on it.

use super::{Stepper, Subdomain, average};
use crate::Exact;
use crate::effect::Effect;
use crate::model::Arms;
use crate::{Error, Real, Result};
use nalgebra::{Point3, Vector3};

/// Force and moment of forces on a model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Resultant<T: Real> {
    /// Force on the model \[N\].
    pub force: Vector3<T>,
    /// Moment on the model about the given point, torques on rotations included \[N m\]. Arms are those that
    /// the effect names ([`AnyEffect::arms`]), otherwise those of the model: present positions if its forces
    /// turn with it ([`Arms::Current`]), positions at rest otherwise.
    ///
    /// [`AnyEffect::arms`]: crate::effect::AnyEffect::arms
    pub moment: Vector3<T>,
}

impl<T: Real> Resultant<T> {
    /// Zero force and moment.
    pub fn zero() -> Self {
        Self {
            force: Vector3::zeros(),
            moment: Vector3::zeros(),
        }
    }
}

impl<T: Real> std::ops::AddAssign for Resultant<T> {
    fn add_assign(&mut self, other: Self) {
        self.force += other.force;
        self.moment += other.moment;
    }
}

impl<T: Real> Subdomain<T> {
    /// Updates the forces of all effects to the present instant.
    ///
    /// # Errors
    /// Errors of the effects; [`Error::Unsupported`] between a restored state and its first step.
    pub(crate) fn refresh(&mut self, time: T) -> Result<()> {
        if !self.forces.known() {
            return Err(Error::Unsupported {
                model: self.model.name().to_owned(),
                what: "tell its reactions: forces of a restored state are known after the next step".into(),
            });
        }
        // The implicit scheme evaluated its loads in the middle of the step.
        if let Stepper::Average(average) = &mut self.stepper {
            let instant = average::instant(time, self.pace.dt, &self.state, self.forces.internal());
            average.load(&mut self.effects, &instant)?;
        }
        Ok(())
    }

    /// Writes the sum of internal and external forces, weighted, at the present instant.
    ///
    /// # Errors
    /// Errors of the model and of [`Self::refresh`].
    pub(crate) fn write_forces(&mut self, time: T, out: &mut [T]) -> Result<()> {
        self.refresh(time)?;
        match &self.stepper {
            Stepper::External(_) => out.fill(T::zero()),
            Stepper::Average(average) => {
                let terms = self.forces.internal().iter().zip(average.loads());
                out.iter_mut().zip(terms).for_each(|(o, (f, g))| *o = *f + *g);
            }
            // A model that makes its steps itself has no other forces.
            Stepper::Verlet if self.forces.are_released() => {
                out.fill(T::zero());
                self.model.add_internal_forces(&self.state.q, out)?;
            }
            Stepper::Verlet => self.forces.write_total(out),
        }
        Ok(())
    }

    /// Replaces all forces `F` but those of the supports by the reactions `R = M q̈ − F` of the prescribed
    /// unknowns, zero elsewhere.
    pub(crate) fn replace_by_reactions(&self, forces: &mut [T]) {
        let mut reactions = vec![T::zero(); forces.len()];
        for &d in self.supports.iter().flat_map(|m| &m.dofs) {
            reactions[d] = self.inertia[d] * self.state.a[d] - forces[d];
        }
        forces.copy_from_slice(&reactions);
    }

    /// Returns force and moment about a point of the forces on some unknowns, over all ranks.
    pub(crate) fn resultant(
        &self,
        forces: &[T],
        unknowns: impl Iterator<Item = usize>,
        about: &Point3<T>,
    ) -> Resultant<T> {
        let (layout, arms) = (self.model.layout(), self.model.views().arms);
        // Exact sums have the same bits on any number of ranks.
        let mut sums = [Exact::zero(); 6];
        let mut add = |k: usize, x: T| sums[k].add(x.as_f64());
        for d in unknowns {
            match d.checked_sub(layout.translations()) {
                // Behind the translations are rotations, whose forces are torques.
                Some(rotation) => add(3 + rotation % 3, forces[d]),
                None => {
                    let mut force = Vector3::zeros();
                    force[d % layout.components] = forces[d];
                    add(d % layout.components, forces[d]);
                    let arm = self.arm(d / layout.components, about, arms);
                    let moment = arm.cross(&force);
                    (0..3).for_each(|c| add(3 + c, moment[c]));
                }
            }
        }
        self.resultant_of(sums)
    }

    /// Adds up the sums of all ranks: force, then moment.
    fn resultant_of(&self, sums: [Exact; 6]) -> Resultant<T> {
        let [a, b, c, x, y, z] = self.owned().total(sums).map(T::of);
        Resultant {
            force: Vector3::new(a, b, c),
            moment: Vector3::new(x, y, z),
        }
    }

    /// Returns force and moment about a point of the last forces of an effect.
    pub(crate) fn resultant_of_effect(&self, about: &Point3<T>, effect: &dyn Effect<T>) -> Resultant<T> {
        let layout = self.model.layout();
        self.resultant_by_power(about, effect.arms(), &|v, sum| {
            if !effect.add_power(&layout, v, sum) {
                sum.add(effect.power(v).as_f64());
            }
        })
    }

    /// Returns force and moment about a point of the last forces of an effect, from their power in unit rigid
    /// motions.
    ///
    /// `power` adds the power of an effect or of one side of a pair effect. `arms` are those that the effect
    /// names, if any.
    pub(crate) fn resultant_by_power(
        &self,
        about: &Point3<T>,
        arms: Option<Arms>,
        power: &dyn Fn(&[T], &mut Exact),
    ) -> Resultant<T> {
        let layout = self.model.layout();
        let arms = arms.unwrap_or_else(|| self.model.views().arms);
        let mut motion = vec![T::zero(); layout.dofs()];
        let mut sums = [Exact::zero(); 6];
        for c in 0..3 {
            // A component of force is the power in a unit translation, one of moment that in a unit turn.
            let axis = Vector3::ith(c, T::one());
            if c < layout.components {
                motion.fill(T::zero());
                let translations = motion[..layout.translations()].chunks_exact_mut(layout.components);
                translations.for_each(|v| v[c] = T::one());
                power(&motion, &mut sums[c]);
            }
            motion.fill(T::zero());
            for node in 0..layout.nodes {
                let v = axis.cross(&self.arm(node, about, arms));
                (0..layout.components).for_each(|k| motion[node * layout.components + k] = v[k]);
                if layout.turns() {
                    motion[layout.translations() + 3 * node + c] = T::one();
                }
            }
            power(&motion, &mut sums[3 + c]);
        }
        self.resultant_of(sums)
    }

    /// Returns the vector from a point to a node, where its forces act.
    fn arm(&self, node: usize, about: &Point3<T>, arms: Arms) -> Vector3<T> {
        let layout = self.model.layout();
        let mut arm = self.model.nodes()[node] - about;
        if arms == Arms::Current {
            (0..layout.components).for_each(|c| arm[c] += self.state.q[node * layout.components + c]);
        }
        arm
    }
}
