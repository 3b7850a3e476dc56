//! Methods that couple the two models of a case, by their form.

mod blend;
mod bridging;
mod multipliers;
mod multistep;
mod particles;
mod quasicontinuum;
mod schwarz;

use super::case::{COARSE, COARSE_EVERYWHERE, Case, FINE, FINE_EVERYWHERE, with_complement};
use super::reflections::{MOST_OWN, Pace, Reflections};
use super::sparse::{add, congruence, constraint, diagonal, dot, follows, product, transposed};
use super::system::{Motion, System};
use super::tie::{Tie, of_eigenvalues, pseudo_inverse};
use crate::error::{Result, core, key};
use crate::spec::Method;
use multistep::Multistep;

/// System, pace and motion of a coupling.
#[derive(Debug)]
pub(super) struct State {
    /// Weighted system of all unknowns, those that follow others included.
    pub(super) whole: System,
    /// Steps of the run and of the models.
    pub(super) pace: Pace,
    pub(super) now: Motion,
}

impl State {
    pub(super) fn new(whole: System, pace: Pace) -> Self {
        let now = Motion::default();
        Self { whole, pace, now }
    }
}

/// Two models coupled by a method, as a comparison sees them. Unknowns are those of
/// [`State::whole`].
pub(super) trait Coupling {
    /// Starts from displacements and velocities, made consistent as the method does it.
    fn reset(&mut self, q: &[f64], v: &[f64]);

    /// Makes one step of the run.
    fn advance(&mut self);

    /// System, pace and motion.
    fn state(&self) -> &State;

    /// Energy of both models \[J\] from displacements and velocities at the same instant.
    fn whole_energy(&self) -> f64 {
        let State { whole, now, .. } = self.state();
        whole.energies(now).iter().sum()
    }

    /// Energy that an exact method would keep \[J\]; `½ vᵀMv + ½ qᵀKq` where no better one is known.
    fn energy(&self) -> f64 {
        self.whole_energy()
    }

    /// Multiplications of one step of the run.
    fn work(&self) -> f64;

    /// Equilibrium with some unknowns of `q` held; `None` if the forces of the method derive from no energy.
    fn equilibrium(&self, _q: &[f64], _held: &[bool]) -> Result<Option<Vec<f64>>> {
        Ok(None)
    }
}

/// Couples the models of a case; refuses a method that has no meaning in the scene by its name.
pub(super) fn couple(case: &mut Case, method: Method, penalty: f64) -> Result<Box<dyn Coupling>> {
    Ok(match method {
        Method::Arlequin => Box::new(multipliers::energy(case, &pseudo_inverse)?),
        Method::Nodal => Box::new(multipliers::nodal(case)?),
        Method::Lumped => Box::new(multipliers::lumped(case)?),
        Method::LumpedVelocities => Box::new(Reflections {
            once: true,
            ..multipliers::lumped(case)?
        }),
        Method::Augmented => Box::new(multipliers::augmented(case)?),
        Method::Edge => Box::new(particles::edge(case, true)?),
        Method::EdgeWeak => Box::new(particles::edge(case, false)?),
        Method::Penalty => Box::new(particles::penalty(case, penalty)?),
        Method::Blend => Box::new(blend::blend(case)?),
        Method::Oniom => Box::new(blend::oniom(case)?),
        Method::BridgingScale => Box::new(bridging::Bridging::new(case)?),
        Method::Gc => Box::new(Multistep::new(case, false)?),
        Method::Ph => Box::new(Multistep::new(case, true)?),
        Method::Schwarz => Box::new(schwarz::Schwarz::new(case)?),
        Method::Quasicontinuum => Box::new(quasicontinuum::quasicontinuum(case, false)?),
        Method::QuasicontinuumClusters => Box::new(quasicontinuum::quasicontinuum(case, true)?),
    })
}
