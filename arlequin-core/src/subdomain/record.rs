//! State that a subdomain saves to continue with the same bits.

use super::Subdomain;
use super::account::Energies;
use crate::effect::{Attached, Effect};
use crate::record::{Record, check_length};
use crate::scalar::check_finite;
use crate::{Real, Result};
use std::borrow::Cow;

/// Saved state of a subdomain.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SubdomainSnapshot<T> {
    /// Displacements \[m\], rotations \[rad\].
    pub q: Vec<T>,
    /// Velocities.
    pub v: Vec<T>,
    /// Accelerations.
    pub a: Vec<T>,
    /// Internal forces at `q`; empty if the model makes its steps itself.
    pub internal: Vec<T>,
    /// Internal energy at `q` \[J\], if the ledger knows it.
    pub energy: Option<T>,
    /// Works of the effects since the start \[J\].
    pub works: Vec<T>,
    /// Work since the start \[J\] of the model's changes to itself, negative; `None` if it makes none.
    pub evolved: Option<T>,
    /// State that the model saves.
    pub model: Record<T>,
    /// States that the effects save.
    pub effects: Vec<Record<T>>,
}

impl<T: Real> Subdomain<T> {
    pub(crate) fn snapshot(&self) -> Result<SubdomainSnapshot<T>> {
        Ok(SubdomainSnapshot {
            q: self.recorded(&self.state.q)?,
            v: self.recorded(&self.state.v)?,
            a: self.recorded(&self.state.a)?,
            internal: if self.forces.are_released() {
                Vec::new()
            } else {
                self.recorded(self.forces.internal())?
            },
            energy: self.energies.now,
            works: self.effects.iter().map(|e| e.work()).collect(),
            evolved: self.evolved.map(|e| e.work),
            model: self.save_model()?,
            effects: (self.effects.iter().map(|e| self.recorded_effect(&*e.effect)))
                .collect::<Result<_>>()?,
        })
    }

    /// Returns the state that an effect saves. In a partitioned model it has one number per unknown, or none,
    /// and is gathered on rank 0.
    fn recorded_effect(&self, effect: &dyn Effect<T>) -> Result<Record<T>> {
        let record = effect.save();
        let owned = self.owned();
        let is_local = owned.is_part() && !effect.saves_whole();
        if !is_local || !owned.any(!record.numbers.is_empty())? {
            return Ok(record);
        }
        let name = self.model().name();
        check_length(
            &format!("memory of an effect on '{name}'"),
            self.inertia.len(),
            record.numbers.len(),
        )?;
        let numbers = self.recorded(&record.numbers)?;
        Ok(Record { numbers, ..record })
    }

    /// Gathers `x` on rank 0; empty on the other ranks.
    fn recorded(&self, x: &[T]) -> Result<Vec<T>> {
        Ok(self.gather(x)?.map(Cow::into_owned).unwrap_or_default())
    }

    pub(crate) fn restore(&mut self, from: &SubdomainSnapshot<T>) -> Result<()> {
        let layout = self.model.layout();
        let owned = self.owned();
        let dofs = owned.whole_layout(&layout).dofs();
        let name = self.model().name().to_owned();
        let parts = [
            ("displacements", &from.q),
            ("velocities", &from.v),
            ("accelerations", &from.a),
        ];
        let forces = ("internal forces", &from.internal);
        let parts = parts
            .into_iter()
            .chain((!from.internal.is_empty()).then_some(forces));
        for (what, x) in parts {
            let what = format!("{what} of '{name}' in the snapshot");
            check_length(&what, dofs, x.len())?;
            check_finite(&what, x)?;
        }
        check_length(
            &format!("works of '{name}' in the snapshot"),
            self.effects.len(),
            from.works.len(),
        )?;
        check_length(
            &format!("effects of '{name}' in the snapshot"),
            self.effects.len(),
            from.effects.len(),
        )?;
        self.state.q = owned.restrict(&layout, &from.q);
        self.state.v = owned.restrict(&layout, &from.v);
        self.state.a = owned.restrict(&layout, &from.a);
        if from.internal.is_empty() {
            self.forces.restore(&[]);
        } else {
            let internal = owned.restrict(&layout, &from.internal);
            self.forces.restore(&internal);
        }
        // The next step needs no other energies.
        self.energies = Energies {
            now: from.energy,
            ..Energies::unknown()
        };
        if let (Some(line), Some(work)) = (&mut self.evolved, from.evolved) {
            line.work = work;
        }
        self.restore_model(&from.model)?;
        let local_record = |(e, record): (&Attached<T, dyn Effect<T>>, &Record<T>)| {
            if record.numbers.len() != dofs || e.effect.saves_whole() {
                return record.clone();
            }
            Record {
                numbers: owned.restrict(&layout, &record.numbers),
                integers: record.integers.clone(),
            }
        };
        let records: Vec<_> = self.effects.iter().zip(&from.effects).map(local_record).collect();
        for (e, (work, record)) in self.effects.iter_mut().zip(from.works.iter().zip(&records)) {
            e.restore(*work, record)?;
        }
        Ok(())
    }
}
