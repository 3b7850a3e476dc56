//! Subdomains whose model is partitioned among ranks during the set-up.

use super::Subdomain;
use super::step::Forces;
use crate::model::{DofLayout, Shared};
use crate::ranks::{Communicator, Portion};
use crate::{Real, Result};
use std::sync::Arc;

impl<T: Real> Subdomain<T> {
    /// Lets the run partition the model among ranks once interfaces are built. Until then the model is whole
    /// and the same on every rank: supports, effects and initial states name nodes and unknowns of the whole
    /// model. Every rank must make the same subdomain.
    #[must_use]
    pub fn shared(mut self, communicator: Arc<dyn Communicator>) -> Self {
        self.ranks = Some(communicator);
        self
    }

    /// Number of ranks among which the model will be partitioned; `None` if it will not be.
    pub(crate) fn ranks(&self) -> Option<usize> {
        self.ranks.as_ref().map(|c| c.ranks())
    }

    pub(crate) fn is_to_be_partitioned(&self) -> bool {
        self.ranks.is_some()
    }

    /// Returns whether a saved state was given to the model.
    pub(crate) fn has_memory(&self) -> bool {
        self.memory.is_some()
    }

    /// This rank's part of a model that the run partitioned.
    pub fn shared_portion(&self) -> Option<&Arc<Portion>> {
        self.portion.as_ref()
    }

    /// Gathers `x`, one value per unknown of this rank, on rank 0 (`Some` there, `None` elsewhere). A model
    /// that is not partitioned returns `x` on every rank. Collective.
    ///
    /// # Errors
    /// Errors of the transport.
    pub fn in_all(&self, x: &[T]) -> Result<Option<Vec<T>>> {
        let Some(portion) = self.portion() else {
            return Ok(Some(x.to_vec()));
        };
        let layout = self.model.layout();
        let (first, rotations) = x.split_at(layout.translations().min(x.len()));
        // Translations and rotations are gathered apart, since each block is in the order of nodes.
        let mut out = portion.collect(layout.components, first)?;
        if layout.rotations > 0 {
            let turns = portion.collect(layout.rotations, rotations)?;
            out = out.zip(turns).map(|(a, b)| [a, b].concat());
        }
        Ok(out)
    }

    /// Restricts values of all unknowns of the whole model to the unknowns of this rank.
    pub(crate) fn restrict(&self, x: &[T]) -> Vec<T> {
        let Some(portion) = self.portion() else {
            return x.to_vec();
        };
        let layout = self.model.layout();
        let whole = DofLayout {
            nodes: portion.division().nodes(),
            ..layout
        };
        part_of(portion, &whole, x)
    }

    /// Number of nodes of the whole model, over all ranks.
    pub fn nodes_in_all(&self) -> usize {
        let local = self.model.layout().nodes;
        self.portion().map_or(local, |p| p.division().nodes())
    }

    /// Partitions the model if it is marked for that, keeps this rank's part and attaches the effects to it.
    ///
    /// # Errors
    /// Errors of [`crate::Model::partition_among`] and of the effects.
    pub(crate) fn partition_model(&mut self) -> Result<Option<Arc<Portion>>> {
        let Some(communicator) = self.ranks.take() else {
            return Ok(None);
        };
        let whole = self.model.layout();
        let Shared { portion, field } = self.model.partition_among(&communicator)?;
        self.field = field;
        let state = &mut self.state;
        for x in [
            &mut state.q,
            &mut state.v,
            &mut state.a,
            &mut self.inertia,
            &mut self.inverse_inertia,
        ] {
            *x = part_of(&portion, &whole, x);
        }
        for motion in &mut self.supports {
            motion.dofs = motion
                .dofs
                .iter()
                .filter_map(|d| local(&portion, &whole, *d))
                .collect();
        }
        self.forces = Forces::zero(self.inertia.len());
        self.portion = Some(portion.clone());
        // No pair effect acts on a partitioned model: the set-up refuses it.
        self.attach(false)?;
        Ok(Some(portion))
    }
}

/// Restricts values of all unknowns of the whole model to the unknowns of a rank.
pub(crate) fn part_of<T: Real>(portion: &Portion, whole: &DofLayout, x: &[T]) -> Vec<T> {
    let (first, rotations) = x.split_at(whole.translations());
    let blocks = [(first, whole.components), (rotations, whole.rotations)];
    let restricted = |(x, count): (&[T], usize)| -> Vec<T> {
        let nodes = 0..portion.nodes();
        nodes
            .flat_map(|k| x[portion.global(k) * count..][..count].to_vec())
            .collect()
    };
    blocks.map(restricted).concat()
}

/// Returns the number on this rank of an unknown of the whole model, if the rank has it.
pub(crate) fn local(portion: &Portion, whole: &DofLayout, unknown: usize) -> Option<usize> {
    let (first, count, start) = match unknown.checked_sub(whole.translations()) {
        None => (unknown, whole.components, 0),
        Some(rotation) => (rotation, whole.rotations, portion.nodes() * whole.components),
    };
    Some(start + portion.local(first / count)? * count + first % count)
}
