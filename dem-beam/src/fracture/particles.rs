//! Strength of particles: all bonds of a particle break at once (André, Jebahi et al. 2013).
//!
//! The load is the hydrostatic stress of the particle, in tension, from the stress of [`crate::model`]'s
//! recovery:
//!
//! ```text
//! tr σ_i / 3 = 1/(3 V_i) Σ_b r_i/(r_i + r_j) l_b N_b,     N_b = E S e_b
//! ```
//!
//! with the unweighted axial forces `N_b` of the unbroken bonds, the distance `l_b` of the centres (at rest
//! under small rotations) and the volume `V_i` that the particle stands for. Forces across a bond and moments
//! have no part in the trace.

use super::criterion::Strain;
use super::{Fracture, Scatter};
use crate::particles::BondedParticles;
use arlequin_core::adjacency::Adjacency;

/// Strengths of the particles of a body, or of the owned particles of a rank's part.
#[derive(Debug)]
pub(crate) struct ParticleStrengths {
    /// `3 V s/(E S)` of each particle of strength `s` \[m\]: the sum `Σ r_i/(r_i + r_j) l_b e_b` at which it
    /// breaks.
    limits: Vec<f64>,
}

impl ParticleStrengths {
    /// Returns the strengths of particles of these volumes \[m³\] if the criterion is one of particles.
    pub(crate) fn new(spec: &Fracture, body: &BondedParticles, volumes: &[f64]) -> Option<Self> {
        let limit = |(x, volume): (_, &f64)| {
            let strength = spec.strength * spec.scatter.factor(spec.seed, x, x);
            // All constants of the criterion go into the limit, so that the kernel adds up shares of levers
            // only.
            3.0 * volume * strength / body.rigidity().axial
        };
        spec.criterion.is_of_particles().then(|| Self {
            limits: body.positions().iter().zip(volumes).map(limit).collect(),
        })
    }

    /// Hydrostatic stress of particle `i` over its strength \[–\]; `strain` returns the strain of a bond.
    pub(crate) fn load(
        &self,
        i: usize,
        body: &BondedParticles,
        adjacency: &Adjacency<[u32; 2]>,
        strain: impl Fn(usize) -> Strain,
    ) -> f64 {
        let bonds = adjacency.row(i).iter().map(|e| e.map(|k| k as usize));
        // Bonds without weight have no part in the stress.
        let carrying = bonds.filter(|[_, b]| body.carries(*b));
        let sum: f64 = carrying.map(|[j, b]| share(body, i, j) * strain(b).lever()).sum();
        sum / self.limits[i]
    }

    /// Product of length and elongation \[m²\] at which the bond `b` to particle `j` alone breaks particle
    /// `i`; infinite for a bond that carries nothing.
    pub(crate) fn half_bond(&self, i: usize, [j, b]: [usize; 2], body: &BondedParticles) -> f64 {
        if body.carries(b) {
            self.limits[i] / (share(body, i, j) * body.bond(b).axis.norm())
        } else {
            // The ratio to an infinite limit is zero: the bond adds nothing to the sum.
            f64::INFINITY
        }
    }
}

/// Share of the bond to particle `j` that particle `i` has \[–\].
fn share(body: &BondedParticles, i: usize, j: usize) -> f64 {
    let radii = body.radii();
    radii[i] / (radii[i] + radii[j])
}

impl Fracture {
    /// Returns whether limits differ between the half-bonds of a body, from the start or by damage.
    pub(super) fn has_own_limits(&self) -> bool {
        let differ = self.scatter != Scatter::None || self.spare_overlap || self.dissipated.is_some();
        differ || self.criterion.is_of_particles()
    }
}
