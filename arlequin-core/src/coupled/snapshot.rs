//! Snapshots: all data that a run needs to continue with the same bits.
//!
//! A snapshot holds the state, not the models: build the same run before restoring into it. Half of the last
//! reflection is still to come; it is computed again from the impulses, with the same bits.

use super::Coupled;
use super::rezone::Conversions;
use super::warning::Warning;
use crate::record::check_length;
use crate::scalar::check_finite;
use crate::{Real, Result, Subdomain};

pub use crate::record::Record;
pub use crate::subdomain::SubdomainSnapshot;

/// Saved state of an effect between two subdomains.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct PairSnapshot<T> {
    /// Work since the start \[J\].
    pub work: T,
    /// State that the effect saves.
    pub effect: Record<T>,
}

/// Saved state of a run.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Snapshot<T> {
    /// Macro steps made so far.
    pub step: usize,
    /// Macro step \[s\]; must be that of the run into which the snapshot is restored.
    pub dt: T,
    /// Kinetic energy removed by the consistent start \[J\].
    pub start_loss: T,
    /// Sums and extremes of the ledger.
    pub ledger: Vec<T>,
    /// Subdomains.
    pub subdomains: Vec<SubdomainSnapshot<T>>,
    /// Own steps of every subdomain in a macro step; must be those of the run into which the snapshot is
    /// restored.
    pub own_steps: Vec<usize>,
    /// Impulses of the last reflection of every interface; half of each is still to be applied.
    pub impulses: Vec<Vec<T>>,
    /// Effects between two subdomains.
    pub pairs: Vec<PairSnapshot<T>>,
    /// Warnings so far.
    pub warnings: Vec<Warning>,
    /// Changes of weights so far; `None` if there were none.
    pub rezoning: Option<RezoningSnapshot<T>>,
}

/// Saved account of changes of weights. The weights themselves are not saved: a snapshot is restored into a
/// run that was built with the weights and interfaces of the last change.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct RezoningSnapshot<T> {
    /// Number of changes.
    pub count: usize,
    /// Works \[J\]: potential, kinetic, rigid motion, consistent start.
    pub works: [T; 4],
    /// Fingerprint of the weighted inertias, by which other weights are recognised.
    pub weights: u64,
}

impl<T: Real> Coupled<T> {
    /// Returns the present state. For partitioned models it is the state of the whole models, on rank 0 only,
    /// and may be restored on any number of ranks. Collective.
    ///
    /// # Errors
    /// [`crate::Error::Unsupported`] for a participant that cannot be saved; errors of the communication
    /// between ranks.
    pub fn snapshot(&self) -> Result<Snapshot<T>> {
        Ok(Snapshot {
            step: self.step,
            dt: self.dt,
            start_loss: self.start_loss,
            ledger: self.ledger.record(),
            subdomains: self
                .subdomains
                .iter()
                .map(Subdomain::snapshot)
                .collect::<Result<_>>()?,
            own_steps: self.subdomains.iter().map(Subdomain::own_steps).collect(),
            impulses: self.interfaces.iter().map(|i| i.impulse().to_vec()).collect(),
            pairs: self
                .pairs
                .iter()
                .map(|p| PairSnapshot {
                    work: p.line.work(),
                    effect: p.line.effect.save(),
                })
                .collect(),
            warnings: self.warnings.clone(),
            rezoning: (self.conversions.count > 0).then(|| RezoningSnapshot {
                count: self.conversions.count,
                works: self.conversions.parts,
                weights: self.weights_fingerprint(),
            }),
        })
    }

    /// Restores a state that the same run had: from here on the run makes the same steps, bit by bit.
    /// Partitioned models take their parts from the same snapshot on every rank.
    ///
    /// # Errors
    /// [`crate::Error::SizeMismatch`] or [`crate::Error::InvalidParameter`] if the snapshot does not fit,
    /// [`crate::Error::NotFinite`]. The run is unusable after an error.
    pub fn restore(&mut self, from: &Snapshot<T>) -> Result<()> {
        if from.dt != self.dt {
            let rule = format!("the run has {}; restore into the run that was saved", self.dt);
            return Err(crate::error::invalid("time step of the snapshot", from.dt, &rule));
        }
        let own_steps: Vec<usize> = self.subdomains.iter().map(Subdomain::own_steps).collect();
        // Changes of the weights may have needed more own steps than this run makes.
        let is_finer = |(saved, own): (&usize, &usize)| saved >= own;
        let grown = from.rezoning.is_some()
            && from.own_steps.len() == own_steps.len()
            && from.own_steps.iter().zip(&own_steps).all(is_finer);
        if from.own_steps != own_steps && !grown {
            let rule = format!("the run has {own_steps:?}; restore into the run that was saved");
            let saved = format_args!("{:?}", from.own_steps);
            return Err(crate::error::invalid("own steps of the snapshot", saved, &rule));
        }
        self.restore_rezoning(from.rezoning.as_ref())?;
        for (k, steps) in from
            .own_steps
            .iter()
            .enumerate()
            .filter(|(k, n)| own_steps[*k] != **n)
        {
            self.subdomains[k].set_pace(self.dt, *steps)?;
        }
        check_length(
            "subdomains of the snapshot",
            self.subdomains.len(),
            from.subdomains.len(),
        )?;
        check_length(
            "interfaces of the snapshot",
            self.interfaces.len(),
            from.impulses.len(),
        )?;
        check_length(
            "effects between two models in the snapshot",
            self.pairs.len(),
            from.pairs.len(),
        )?;
        for (p, f) in self.pairs.iter_mut().zip(&from.pairs) {
            p.line.restore(f.work, &f.effect)?;
        }
        for (s, f) in self.subdomains.iter_mut().zip(&from.subdomains) {
            s.restore(f)?;
        }
        for (i, f) in self.interfaces.iter_mut().zip(&from.impulses) {
            check_length("impulses of the snapshot", i.impulse().len(), f.len())?;
            check_finite("impulses of the snapshot", f)?;
            i.restore(f);
        }
        // Joints take their impulses from the interfaces, which come first.
        self.joints.iter_mut().for_each(|j| j.restore(&self.interfaces));
        self.ledger.restore(&from.ledger)?;
        self.step = from.step;
        // A product as in the run, so that times have the same bits.
        self.time = self.start_time + T::of(from.step as f64) * self.dt;
        self.start_loss = from.start_loss;
        self.warnings.clone_from(&from.warnings);
        self.warnings_sent = self.warnings.len();
        Ok(())
    }

    /// Takes over the account of changes of weights; refuses a snapshot of other weights.
    fn restore_rezoning(&mut self, from: Option<&RezoningSnapshot<T>>) -> Result<()> {
        let fits = match from {
            Some(r) => r.weights == self.weights_fingerprint(),
            None => self.conversions.count == 0,
        };
        if !fits {
            let count = from.map_or(0, |r| r.count);
            let rule =
                "the weights were others; build the run with the weights and interfaces of the last change";
            return Err(crate::error::invalid(
                "changes of weights in the snapshot",
                count,
                rule,
            ));
        }
        self.conversions = Conversions {
            count: from.map_or(0, |r| r.count),
            parts: from.map_or([T::zero(); 4], |r| r.works),
        };
        Ok(())
    }
}
