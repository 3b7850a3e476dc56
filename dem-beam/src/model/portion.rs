//! A body partitioned among several ranks.
//!
//! A rank owns whole units of particles in their order, and all bonds of these particles, so that forces on
//! its particles are summed in the order of the whole body. The kernel rows of ghosts are received from their
//! owners once per force evaluation. Every rank computes the states of its owned particles only.

use super::DemModel;
use super::poses::Reader;
use crate::contact::RestSpheres;
use crate::error::{Error, Result};
use crate::kernel::layout::work;
use crate::numbered::Numbered;
use arlequin_core::ranks::{self, Communicator, Division, Halo, UNIT, Unit};
use arlequin_core::{Interpolation, Model, Owned, ParticleField};
use nalgebra::Vector3;
use std::hash::{DefaultHasher, Hasher};
use std::ops::Range;
use std::sync::Arc;

/// Work of coupling a particle of an overlap once per macro step, in half-bonds: 25 ns, against 38 ns for all
/// else (decision 0046). A half-bond is a bond as the kernel stores it with one of its ends.
const COUPLING: usize = 7;

impl DemModel {
    /// Returns the units of the body for [`Division::bisect`]: their centres \[m\] and their work in
    /// half-bonds. The work includes empty lanes, the motion of particles and the coupling of particles in an
    /// overlap.
    #[must_use]
    pub fn units(&self) -> Vec<Unit> {
        let bonds = self.bond_counts();
        let mut coupled = vec![false; self.body.len()];
        for (b, pair) in self.body.pairs().iter().enumerate() {
            let is_coupled = self.in_overlap(b);
            pair.iter().for_each(|i| coupled[*i as usize] |= is_coupled);
        }
        Unit::from_nodes(self.centres(), |particles| {
            let coupled = particles.clone().filter(|i| coupled[*i]).count();
            (work(&bonds[particles]) + coupled * COUPLING) as f64
        })
    }

    /// Returns the number of bonds of each particle. It counts, because a list of the bonds would stay in
    /// memory.
    pub(super) fn bond_counts(&self) -> Vec<usize> {
        let mut out = vec![0; self.body.len()];
        let ends = self.body.pairs().iter().flatten();
        ends.for_each(|i| out[*i as usize] += 1);
        out
    }

    /// Returns this rank's part of the body: its units of `division`, with all their bonds. Collective: all
    /// ranks must have made the same body and make the same calls of the part.
    ///
    /// Supports, initial states and weights refer to the part ([`Owned::local`] finds a particle of the
    /// whole body). Requests that need the whole body are refused with an error that names them. Energies and
    /// the critical step are those of the whole body.
    ///
    /// # Errors
    /// [`Error::InParts`] for a body that is a part already. [`arlequin_core::ranks::RankError`], as an error
    /// of the core, for bodies that differ, a division of another body or for another number of ranks, and
    /// errors of the transport.
    pub fn partition_among(
        mut self,
        division: &Division,
        communicator: Arc<dyn Communicator>,
    ) -> Result<Self> {
        self.keep_part(division, communicator)?;
        Ok(self)
    }

    /// Partitions the body by the work of its units and keeps this rank's part.
    pub(super) fn bisect(
        &mut self,
        communicator: &Arc<dyn Communicator>,
    ) -> Result<Arc<dyn Interpolation<f64>>> {
        let division = Division::bisect(self.centres().len(), &self.units(), communicator.ranks());
        let division = division.map_err(arlequin_core::Error::from)?;
        self.keep_part(&division, communicator.clone())?;
        Ok(self.field.clone())
    }

    fn keep_part(&mut self, division: &Division, communicator: Arc<dyn Communicator>) -> Result<()> {
        self.require_whole("sharing out")?;
        let what = "the bodies of particles that they have made";
        ranks::agree(&*communicator, what, self.digest()).map_err(arlequin_core::Error::from)?;
        let ownership = Owned::divided(division.clone(), communicator)?;
        if division.nodes() != self.centres().len() {
            return Err(Error::LengthMismatch {
                what: "particles of the division",
                found: division.nodes(),
                expected: self.centres().len(),
            });
        }
        let owned: Vec<usize> = (0..ownership.nodes()).map(|i| ownership.global(i)).collect();
        let halo = Halo::of_links(&ownership, self.body.pairs().iter().copied());
        let numbers: Vec<u32> = owned.iter().map(|i| *i as u32).collect();
        let bonds = self.body.pairs().len();
        let (body, bond_numbers) = self.body.part(&numbers, halo.ghosts());
        let nodes = owned.iter().map(|i| self.centres()[*i]).collect();
        self.mass = Arc::new(owned.iter().map(|i| self.mass[*i]).collect());
        self.inertia = owned.iter().map(|i| self.inertia[*i]).collect();
        self.order = owned.iter().map(|i| self.order[*i]).collect();
        self.places = Vec::new();
        let samples = self.volumes();
        let volumes: Vec<f64> = owned.iter().map(|i| samples[*i]).collect();
        self.field = Arc::new(ParticleField::new(nodes, &volumes)?);
        self.spheres = RestSpheres::new(self.field.clone(), body.shared_radii());
        self.kernel.renew();
        self.unit_bonds = bonds_of_units(body.pairs(), owned.len());
        self.body = body;
        let numbered = Numbered {
            bonds: bond_numbers.into(),
            total: bonds,
        };
        self.halo = Some(halo);
        self.numbered = Some(numbered);
        self.break_apart();
        Ok(())
    }

    /// Returns the volume that each owned particle stands for \[m³\].
    pub(super) fn volumes(&self) -> Vec<f64> {
        let samples = self.field.samples().unwrap_or_default();
        samples.iter().map(|s| s.measure).collect()
    }

    /// Returns the halo of this rank: ghosts that it receives, owned particles that it sends, and the ranks
    /// on the other side. `None` for a whole body.
    #[must_use]
    pub fn halo(&self) -> Option<&Halo> {
        self.halo.as_ref()
    }

    /// Refuses `what` unless this is a whole body.
    pub(super) fn require_whole(&self, what: &'static str) -> Result<()> {
        match self.halo {
            Some(_) => Err(Error::InParts { what }),
            None => Ok(()),
        }
    }

    /// Returns a hash of the body, for checking that all ranks hold the same.
    fn digest(&self) -> u64 {
        let mut hasher = DefaultHasher::new();
        let body = &self.body;
        let vectors = body.positions().iter().flat_map(Vector3::iter);
        let numbers = vectors.chain(body.radii()).chain(body.mass());
        numbers.for_each(|x| hasher.write_u64(x.to_bits()));
        (0..body.pairs().len()).for_each(|b| hasher.write_u64(body.weight(b).to_bits()));
        body.pairs().iter().flatten().for_each(|i| hasher.write_u32(*i));
        hasher.write_u8(u8::from(self.has_finite_rotations()));
        if let Some(f) = &self.fracture {
            hasher.write(format!("{:?}", f.spec).as_bytes());
        }
        hasher.finish()
    }

    /// Returns the weighted energy of all bonds \[J\], on all ranks. A bond counts in the unit of its first
    /// particle.
    pub(super) fn energy(&self, q: &[f64]) -> f64 {
        let ghosts = self.receive_ghosts(q);
        let reader = Reader {
            ghosts: &ghosts,
            ..self.reader(q)
        };
        let part = |particles: Range<usize>| {
            let bonds = self.unit_bonds[particles.start / UNIT].clone();
            [bonds.map(|b| reader.energy(&self.body, b)).sum()]
        };
        // Sums of units do not depend on the partition, so the energy has the same bits on any number of
        // ranks.
        let [sum] = self.owned().sum(&part);
        sum
    }

    /// Receives the states of the ghosts from their owners, see [`Reader::state_to_send`].
    /// [`Owned::check_communication`] keeps an error of the exchange, after which the states are NaN.
    pub(super) fn receive_ghosts(&self, q: &[f64]) -> Vec<[f64; 7]> {
        let Some(halo) = &self.halo else {
            return Vec::new();
        };
        let reader = self.reader(q);
        let mut out = vec![[0.0; 7]; halo.ghosts().len()];
        let exchanged = halo.exchange(
            &mut halo.messages(7),
            |i| reader.state_to_send(i),
            |g, x| out[g] = x,
        );
        if exchanged.is_err() {
            out.fill([f64::NAN; 7]);
        }
        out
    }
}

/// Returns, for each unit of the first `owned` particles, the range of the bonds whose first particle lies in
/// it. Bonds must be in the order of their first particles.
pub(super) fn bonds_of_units(pairs: &[[u32; 2]], owned: usize) -> Vec<Range<usize>> {
    let mut out = vec![0..0; owned.div_ceil(UNIT)];
    for (b, first) in pairs.iter().map(|p| p[0] as usize).enumerate() {
        if first < owned {
            let range: &mut Range<usize> = &mut out[first / UNIT];
            let start = if range.end == 0 { b } else { range.start };
            *range = start..b + 1;
        }
    }
    out
}
