//! Steps that the particle model makes itself.

use super::DemModel;
use crate::fracture::state::FractureState;
use arlequin_core::{Drawn, Drift, Kick, Stepping, Stride};

impl Stepping<f64> for DemModel {
    fn stride(&mut self, step: Stride<'_, f64>) -> arlequin_core::Result<Option<Drawn<f64>>> {
        let kernel = self.kernel.get_or_build(&self.body, self.halo.as_ref());
        Ok(kernel.stride(step)?)
    }

    fn drift(&mut self, drift: Drift<'_, f64>) -> arlequin_core::Result<()> {
        let kernel = self.kernel.get_or_build(&self.body, self.halo.as_ref());
        kernel.drift(drift);
        Ok(())
    }

    fn kick(&mut self, kick: Kick<'_, f64>) -> arlequin_core::Result<()> {
        let marks = self.fracture.as_mut().and_then(FractureState::marks);
        let kernel = self.kernel.get_or_build(&self.body, self.halo.as_ref());
        Ok(kernel.kick(kick, marks)?)
    }
}
