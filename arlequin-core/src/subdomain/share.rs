//! Subdomains whose model is partitioned among ranks during the set-up.

use super::Subdomain;
use super::step::Forces;
use crate::ranks::Communicator;
use crate::{Real, Result};
use std::borrow::Cow;
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

    /// Gathers `x`, one value per unknown of this rank, on rank 0 (`Some` there, `None` elsewhere). A model
    /// that is not partitioned returns `x` on every rank. Collective.
    ///
    /// # Errors
    /// Errors of the transport.
    pub fn gather<'a>(&self, x: &'a [T]) -> Result<Option<Cow<'a, [T]>>> {
        self.owned().gather_unknowns(&self.model.layout(), x)
    }

    /// Partitions the model if it is marked for that, keeps this rank's part and attaches the effects to it.
    ///
    /// # Errors
    /// Errors of [`crate::Model::partition_among`] and of the effects.
    pub(crate) fn partition_model(&mut self) -> Result<()> {
        let Some(communicator) = self.ranks.take() else {
            return Ok(());
        };
        self.field = self.model.partition_among(&communicator)?;
        let (owned, layout) = (self.owned(), self.model.layout());
        let state = &mut self.state;
        for x in [
            &mut state.q,
            &mut state.v,
            &mut state.a,
            &mut self.inertia,
            &mut self.inverse_inertia,
        ] {
            *x = owned.restrict(&layout, x);
        }
        for motion in &mut self.supports {
            let dofs = motion.dofs.iter();
            motion.dofs = dofs.filter_map(|d| owned.local_unknown(&layout, *d)).collect();
        }
        self.forces = Forces::zero(self.inertia.len());
        self.is_partitioned = true;
        // No pair effect acts on a partitioned model: the set-up refuses it.
        self.attach(false)
    }
}
