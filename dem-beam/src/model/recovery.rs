//! Stress of the particles and forces of the bonds.
//!
//! The stress of particle `i` is the average over its volume of the stress that its bonds carry (Love 1927,
//! Weber 1966; Bagi 1996):
//!
//! ```text
//! σ_i = sym 1/V_i Σ_b (x_b − x_i) ⊗ f_b,     x_b − x_i = r_i/(r_i + r_j) (x_j − x_i)
//! ```
//!
//! with the forces `f_b` of its bonds on it and the volume `V_i` that it stands for. The sum of volumes times
//! stresses over the volume of the body is its mean stress `Σ_b l_b ⊗ f_b / V`, which in equilibrium is the
//! mean stress of its boundary forces. Contact forces are not included.
//!
//! The strain energy density of particle `i` shares the energies `e_b` of the bonds in the same way:
//!
//! ```text
//! w_i = 1/V_i Σ_b r_i/(r_i + r_j) e_b,     Σ_i V_i w_i = Σ_b e_b
//! ```
//!
//! These energies are unweighted. The ledger counts `Σ_b α_b e_b`, with the mean `α_b` of the weight over the
//! bond. Both are equal where no weight is below one.

use super::DemModel;
use super::poses::Reader;
use crate::finite;
use crate::fracture::state::FractureState;
use crate::fracture::{BreakLog, locked};
use arlequin_core::adjacency::Adjacency;
use arlequin_core::{
    Interpolation, LinkForce, Links, Recovered, Recovery, Result, SymmetricTensor, check_size, invalid,
};
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

impl DemModel {
    /// Returns the unweighted force of bond `b` on its first particle and, before it, the vector between the
    /// centres: deformed under finite rotations, at rest under small ones.
    fn carried(&self, b: usize, reader: &Reader<'_>) -> [Vector3<f64>; 2] {
        let [i, j] = self.body.pairs()[b].map(|i| i as usize);
        let mut bond = self.body.bond(b);
        bond.scale = 1.0 / bond.axis.norm();
        let span = bond.span();
        // The force is without weight, not without damage.
        bond.scale *= self.body.left(b);
        match reader.poses([i, j]) {
            Some([first, second]) => {
                let force = finite::wrenches(&bond, &reader.rigidity, &first, &second)
                    .0
                    .linear;
                [span + second.displacement - first.displacement, force]
            }
            None => {
                let ends = [reader.twist(i), reader.twist(j)];
                [span, bond.wrenches(&reader.rigidity, &ends[0], &ends[1]).0.linear]
            }
        }
    }

    /// Returns the energy of bond `b` without its weight \[J\].
    fn unweighted_energy(&self, b: usize, reader: &Reader<'_>) -> f64 {
        match self.body.weights()[b] {
            // Divides the energy that the ledger counts, so that both numbers are equal where the weight is
            // one.
            weight if weight > 0.0 => reader.energy(&self.body, b) / weight,
            _ => 0.0,
        }
    }

    /// Returns the loads over strength of all particles, ghosts included, under a criterion of particles;
    /// nothing under one of bonds. Collective.
    fn particle_loads(&self, fracture: &FractureState, reader: &Reader<'_>) -> Vec<f64> {
        let load = |i| fracture.particle_load(&self.body, reader, i);
        let mut out: Vec<f64> = (0..self.nodes.len()).map_while(load).collect();
        if let Some(halo) = self
            .halo
            .as_ref()
            .filter(|_| fracture.spec.criterion.is_of_particles())
        {
            let mut ghosts = vec![f64::NAN; halo.ghosts().len()];
            // The run reports an error between ranks ([`arlequin_core::Owned::check_communication`]).
            let _ = halo.exchange(&mut halo.messages(1), |i| [out[i]], |g, [x]| ghosts[g] = x);
            out.append(&mut ghosts);
        }
        out
    }

    /// Returns the bonds of every particle, broken ones included.
    fn bonds_of_particles(&self) -> &Adjacency<[u32; 2]> {
        self.bonds_by_particle
            .get_or_init(|| Adjacency::of_pairs(self.body.len(), self.body.pairs()))
    }
}

impl Recovery<f64> for DemModel {
    fn method(&self) -> &'static str {
        "mean over the volume of a particle of what its bonds carry (Bagi 1996)"
    }

    fn has_strain(&self) -> bool {
        false
    }

    /// Collective for a partitioned body; `nodes` are numbers of this rank's part.
    fn recover(&self, q: &[f64], nodes: &[usize], out: &mut Vec<Recovered<f64>>) -> Result<()> {
        check_size(self, "displacements", q.len())?;
        if let Some(k) = nodes.iter().find(|k| **k >= self.nodes.len()) {
            let rule = format!("'{}' has {} particles", self.name, self.nodes.len());
            return Err(invalid("number of a particle", k, &rule));
        }
        let (adjacency, radii, log) = (self.bonds_of_particles(), self.body.radii(), locked(&self.log));
        let volumes = self.field.samples().unwrap_or_default();
        let ghosts = self.receive_ghosts(q);
        let reader = Reader {
            ghosts: &ghosts,
            ..self.reader(q)
        };
        let broken: &BreakLog = &log;
        let recovered = |&i: &usize| {
            let mut sum = Matrix3::zeros();
            let bonds = adjacency.row(i).iter();
            for &[j, b] in bonds.filter(|e| !broken.is_broken_here(e[1] as usize)) {
                let [span, force] = self.carried(b as usize, &reader);
                // Seen from the second particle, span and force both change sign, so their product holds for
                // either end.
                sum += span * force.transpose() * (radii[i] / (radii[i] + radii[j as usize]));
            }
            let stress = SymmetricTensor::from_matrix(&(sum / volumes[i].measure));
            Recovered { strain: None, stress }
        };
        out.par_extend(nodes.par_iter().map(recovered));
        Ok(())
    }
}

impl Links<f64> for DemModel {
    fn pairs(&self) -> &[[u32; 2]] {
        self.body.pairs()
    }

    /// Collective for a partitioned body; returns the bonds of this rank's part, numbered as in
    /// [`Self::body`].
    fn forces(&self, q: &[f64], out: &mut Vec<LinkForce<f64>>) -> Result<()> {
        check_size(self, "displacements", q.len())?;
        let (log, ghosts) = (locked(&self.log), self.receive_ghosts(q));
        let reader = Reader {
            ghosts: &ghosts,
            ..self.reader(q)
        };
        let strength = self.fracture.as_ref().or(self.watched.as_ref());
        let loads = strength.map_or_else(Vec::new, |f| self.particle_loads(f, &reader));
        let broken: &BreakLog = &log;
        let link_force = |b: usize| {
            let gone = broken.is_broken_here(b);
            // A bond breaks with the particle of the larger load.
            let of_ends = || self.body.pairs()[b].map(|i| loads.get(i as usize).copied());
            let utilisation = strength.map(|f| match (gone, of_ends()) {
                (true, _) => 0.0,
                (_, [Some(i), Some(j)]) => i.max(j),
                _ => f.ratio(&self.body, &reader, b),
            });
            let [span, force] = if gone {
                [Vector3::zeros(); 2]
            } else {
                self.carried(b, &reader)
            };
            let along = span.try_normalize(0.0).unwrap_or_default();
            let axial = along.dot(&force);
            LinkForce {
                axial,
                shear: (force - along * axial).norm(),
                utilisation,
            }
        };
        out.par_extend((0..self.body.pairs().len()).into_par_iter().map(link_force));
        Ok(())
    }

    /// Collective for a partitioned body; returns the densities of this rank's owned particles.
    fn energy_densities(&self, q: &[f64], out: &mut Vec<f64>) -> Result<()> {
        check_size(self, "displacements", q.len())?;
        let (adjacency, radii, log) = (self.bonds_of_particles(), self.body.radii(), locked(&self.log));
        let volumes = self.field.samples().unwrap_or_default();
        let ghosts = self.receive_ghosts(q);
        let reader = Reader {
            ghosts: &ghosts,
            ..self.reader(q)
        };
        let broken: &BreakLog = &log;
        let density = |i: usize| {
            let bonds = adjacency.row(i).iter().map(|e| e.map(|k| k as usize));
            let unbroken = bonds.filter(|[_, b]| !broken.is_broken_here(*b));
            let share =
                unbroken.map(|[j, b]| self.unweighted_energy(b, &reader) * radii[i] / (radii[i] + radii[j]));
            share.sum::<f64>() / volumes[i].measure
        };
        out.par_extend((0..self.nodes.len()).into_par_iter().map(density));
        Ok(())
    }
}
