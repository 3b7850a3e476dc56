//! Methods that couple the two models of a case, one file each.

mod arlequin;
mod augmented;
mod blend;
mod edge;
mod multistep;
mod penalty;
mod quasicontinuum;
mod schwarz;

use super::case::Case;
use super::reflections::Pace;
use super::system::System;
use crate::error::Result;
use crate::spec::Method;

/// Two models coupled by a method, as a comparison sees them. Unknowns are those of [`Coupling::whole`].
pub(super) trait Coupling {
    /// Starts from displacements and velocities, made consistent as the method does it.
    fn reset(&mut self, q: &[f64], v: &[f64]);

    /// Makes one step of the run.
    fn advance(&mut self);

    /// Steps of the run and of the models.
    fn pace(&self) -> Pace;

    /// Weighted system of all unknowns, those that follow others included.
    fn whole(&self) -> &System;

    /// Displacements and velocities of all unknowns.
    fn motion(&self) -> [Vec<f64>; 2];

    /// Energy that an exact method would keep \[J\].
    fn energy(&self) -> f64;

    /// Momentum along the axis \[kg m/s\], and the sum of its moduli.
    fn momentum(&self) -> [f64; 2];

    /// Multiplications of one step of the run.
    fn work(&self) -> f64;

    /// Equilibrium with some unknowns of `q` held; `None` if the forces of the method derive from no energy.
    ///
    /// # Errors
    /// An iteration that does not end.
    fn equilibrium(&self, q: &[f64], held: &[bool]) -> Result<Option<Vec<f64>>>;
}

/// Couples the models of a case.
///
/// # Errors
/// A method that has no meaning in the scene, by name.
pub(super) fn couple(case: &mut Case, method: Method, penalty: f64) -> Result<Box<dyn Coupling>> {
    Ok(match method {
        Method::Arlequin => Box::new(arlequin::energy(case)?),
        Method::Nodal => Box::new(arlequin::nodal(case)?),
        Method::Lumped => Box::new(arlequin::lumped(case)?),
        Method::LumpedVelocities => Box::new(arlequin::lumped(case)?.once()),
        Method::Edge => Box::new(edge::edge(case, true)?),
        Method::EdgeWeak => Box::new(edge::edge(case, false)?),
        Method::Penalty => Box::new(penalty::penalty(case, penalty)?),
        Method::Augmented => Box::new(augmented::augmented(case)?),
        Method::Blend => Box::new(blend::blend(case)?),
        Method::Gc => Box::new(multistep::Multistep::gravouil_combescure(case)?),
        Method::Ph => Box::new(multistep::Multistep::prakash_hjelmstad(case)?),
        Method::Schwarz => Box::new(schwarz::Schwarz::new(case)?),
        Method::Quasicontinuum => Box::new(quasicontinuum::quasicontinuum(case, None)?),
        Method::QuasicontinuumClusters => Box::new(quasicontinuum::quasicontinuum(
            case,
            Some(quasicontinuum::CLUSTER),
        )?),
    })
}

/// The fine model in the place of both, as reference.
///
/// # Errors
/// Errors of the model.
pub(super) fn fine_everywhere(case: &mut Case) -> Result<Box<dyn Coupling>> {
    Ok(Box::new(quasicontinuum::fine(case)?))
}
