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
//! bond. Both are equal where no weight is below one. Bonds that sleep carry nothing: the places of their
//! particles are those of another time.

use super::DemModel;
use super::octets::Octets;
use super::poses::Reader;
use crate::finite;
use crate::fracture::criterion::Strain;
use crate::fracture::state::FractureState;
use crate::fracture::{BreakLog, locked};
use crate::kernel::engine::Isa;
use arlequin_core::{
    Interpolation, LinkSurvey, Links, Recovered, Recovery, Result, SymmetricTensor, check_size, invalid,
};
use rayon::prelude::*;

/// Bonds whose values wait at a time for their sums over particles.
const BATCH: usize = 1 << 14;

/// Bonds that a thread reads at a time.
const CHUNK: usize = 1 << 9;

/// Force, moment and energy that a bond carries without its weight, and its load over its strength.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Carried {
    /// Vector between the centres \[m\] ⊗ force on the first particle \[N\], symmetric part.
    pub(super) moment: SymmetricTensor<f64>,
    pub(super) axial: f64,
    pub(super) shear: f64,
    pub(super) energy: f64,
    /// Zero without a criterion of bonds.
    pub(super) utilisation: f64,
}

impl Carried {
    pub(super) const NOTHING: Self = Self {
        moment: SymmetricTensor([0.0; 6]),
        axial: 0.0,
        shear: 0.0,
        energy: 0.0,
        utilisation: 0.0,
    };
}

impl DemModel {
    /// Returns whether bond `b` is broken or sleeps.
    pub(super) fn is_idle(&self, broken: &BreakLog, b: usize) -> bool {
        broken.is_broken_here(b) || self.body.is_asleep(b)
    }

    /// Returns numerator and denominator of the scale of bond `b` without its weight.
    #[inline]
    pub(super) fn plain_scale(&self, b: usize) -> [f64; 2] {
        match self.body.weight(b) {
            // Divides the stiffness that the ledger counts, damage included, so that its rounding is the
            // same.
            weight if weight > 0.0 => [self.body.scale(b), weight],
            _ => [self.body.stiffness_share(b), self.body.bond(b).axis.norm()],
        }
    }

    /// Returns what bond `b` carries. Vectors between centres are deformed ones under finite rotations, those
    /// at rest under small ones. `strength` is that of a criterion of bonds.
    pub(super) fn carried(&self, b: usize, reader: &Reader<'_>, strength: Option<&FractureState>) -> Carried {
        let [i, j] = self.body.pairs()[b].map(|i| i as usize);
        let weighted = self.body.bond(b);
        let mut bond = weighted;
        let [above, below] = self.plain_scale(b);
        bond.scale = above / below;
        let rest_span = bond.span();
        let rigidity = &reader.rigidity;
        let utilisation = |strain: &dyn Fn() -> Strain| strength.map_or(0.0, |f| f.ratio_of(b, &strain()));
        let (span, force, energy, utilisation) = match reader.poses([i, j]) {
            Some([first, second]) => (
                rest_span + second.displacement - first.displacement,
                finite::wrenches(&bond, rigidity, &first, &second).0.linear,
                finite::energy(&bond, rigidity, &first, &second),
                utilisation(&|| Strain::finite(&weighted, &first, &second)),
            ),
            None => {
                let [first, second] = [reader.twist(i), reader.twist(j)];
                (
                    rest_span,
                    bond.wrenches(rigidity, &first, &second).0.linear,
                    bond.energy(rigidity, &first, &second),
                    utilisation(&|| Strain::linear(&weighted, &first, &second)),
                )
            }
        };
        let along = span.try_normalize(0.0).unwrap_or_default();
        let axial = along.dot(&force);
        Carried {
            moment: SymmetricTensor::from_matrix(&(span * force.transpose())),
            axial,
            shear: (force - along * axial).norm(),
            energy,
            utilisation,
        }
    }

    /// Writes what the bonds from `first` on carry; see [`Self::carried`].
    fn read_bonds(
        &self,
        first: usize,
        out: &mut [Carried],
        broken: &BreakLog,
        reader: &Reader<'_>,
        strength: Option<&FractureState>,
    ) {
        if reader.orientations.is_none() {
            return Isa::detect().run(Octets {
                model: self,
                reader,
                broken,
                strength,
                first,
                out,
            });
        }
        for (b, out) in (first..).zip(out) {
            *out = match self.is_idle(broken, b) {
                true => Carried::NOTHING,
                false => self.carried(b, reader, strength),
            };
        }
    }

    /// Returns the loads over strength of all particles, ghosts included, under a criterion of particles;
    /// nothing under one of bonds. Collective.
    fn particle_loads(&self, fracture: &FractureState, reader: &Reader<'_>) -> Vec<f64> {
        let load = |i| fracture.particle_load(&self.body, reader, i);
        let mut out: Vec<f64> = (0..self.centres().len()).map_while(load).collect();
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
        if let Some(k) = nodes.iter().find(|k| **k >= self.centres().len()) {
            let rule = format!("'{}' has {} particles", self.name, self.centres().len());
            return Err(invalid("number of a particle", k, &rule));
        }
        // The order of its rows is that of the bonds, so that the sums have the bits of those in frames.
        let (adjacency, radii, log) = (self.body.adjacency(), self.body.radii(), locked(&self.log));
        let volumes = self.field.samples().unwrap_or_default();
        let ghosts = self.receive_ghosts(q);
        let reader = Reader {
            ghosts: &ghosts,
            ..self.reader(q)
        };
        let broken: &BreakLog = &log;
        let recovered = |&i: &usize| {
            let mut sum = [0.0; 6];
            let bonds = adjacency.row(i).iter();
            for &[j, b] in bonds.filter(|e| !self.is_idle(broken, e[1] as usize)) {
                let carried = self.carried(b as usize, &reader, None);
                // Seen from the second particle, span and force both change sign, so their product holds for
                // either end.
                add_share(&mut sum, &carried, radii[i] / (radii[i] + radii[j as usize]));
            }
            let stress = SymmetricTensor(sum.map(|s| s / volumes[i].measure));
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

    /// Collective for a partitioned body; returns the values of this rank's owned particles, and of the bonds
    /// of its part, numbered as in [`Self::body`].
    fn survey(&self, q: &[f64]) -> Result<LinkSurvey<f64>> {
        check_size(self, "displacements", q.len())?;
        let (radii, log, ghosts) = (self.body.radii(), locked(&self.log), self.receive_ghosts(q));
        let reader = Reader {
            ghosts: &ghosts,
            ..self.reader(q)
        };
        let (pairs, owned) = (self.body.pairs(), self.centres().len());
        let strength = self.fracture.as_ref().or(self.watched.as_ref());
        let loads = strength.map_or_else(Vec::new, |f| self.particle_loads(f, &reader));
        let broken: &BreakLog = &log;
        let of_bonds = strength.filter(|_| loads.is_empty());
        let read = |first: usize, out: &mut [Carried]| {
            self.read_bonds(first, out, broken, &reader, of_bonds);
            if loads.is_empty() {
                return;
            }
            for (b, carried) in (first..).zip(out).filter(|e| !self.is_idle(broken, e.0)) {
                if let [Some(i), Some(j)] = pairs[b].map(|i| loads.get(i as usize)) {
                    // A bond breaks with the particle of the larger load.
                    carried.utilisation = i.max(*j);
                }
            }
        };
        let mut out = LinkSurvey {
            stresses: vec![SymmetricTensor::zero(); owned],
            densities: vec![0.0; owned],
            axial: Vec::with_capacity(pairs.len()),
            shear: Vec::with_capacity(pairs.len()),
            utilisation: strength.map(|_| Vec::with_capacity(pairs.len())),
        };
        let mut batch = vec![Carried::NOTHING; BATCH.min(pairs.len())];
        for first in (0..pairs.len()).step_by(BATCH) {
            let bonds = first..pairs.len().min(first + BATCH);
            let batch = &mut batch[..bonds.len()];
            let chunks = batch.par_chunks_mut(CHUNK).enumerate();
            chunks.for_each(|(k, out)| read(first + k * CHUNK, out));
            out.axial.extend(batch.iter().map(|c| c.axial));
            out.shear.extend(batch.iter().map(|c| c.shear));
            out.utilisation
                .iter_mut()
                .for_each(|u| u.extend(batch.iter().map(|c| c.utilisation)));
            // Bond after bond on one thread: the order of the sums is that of the bonds.
            for (values, pair) in batch.iter().zip(&pairs[bonds]) {
                let [i, j] = pair.map(|i| i as usize);
                for (k, other) in [(i, j), (j, i)].into_iter().filter(|e| e.0 < owned) {
                    let share = radii[k] / (radii[k] + radii[other]);
                    add_share(&mut out.stresses[k].0, values, share);
                    out.densities[k] += values.energy * share;
                }
            }
        }
        let volumes = self.field.samples().unwrap_or_default();
        for ((stress, density), volume) in out.stresses.iter_mut().zip(&mut out.densities).zip(volumes) {
            stress.0.iter_mut().for_each(|s| *s /= volume.measure);
            *density /= volume.measure;
        }
        Ok(out)
    }
}

/// Adds a particle's share of the moment of a bond.
fn add_share(sum: &mut [f64; 6], carried: &Carried, share: f64) {
    sum.iter_mut()
        .zip(carried.moment.0)
        .for_each(|(sum, m)| *sum += m * share);
}
