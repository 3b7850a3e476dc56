//! A body in parts on several ranks.
//!
//! A rank has whole units of particles in their order, and whole rows of bonds: forces on its particles are
//! summed as in the whole body. Rows of the kernel that belong to particles of other ranks come from there,
//! once per evaluation, so that no rank finds the state of a particle that is not its own.

use super::DemModel;
use super::piece::Numbered;
use super::poses::Reader;
use crate::error::{Error, Result};
use crate::kernel::layout::work;
use arlequin_core::ranks::{self, Communicator, Division, Halo, Portion, UNIT, Unit};
use arlequin_core::{ParticleField, Shared};
use nalgebra::Vector3;
use std::hash::{DefaultHasher, Hasher};
use std::ops::Range;
use std::sync::Arc;

/// Half-bonds that take as long as coupling a particle of an overlap, once per step of a run: 25 ns beside
/// 38 ns for all else (decision 0046).
const COUPLING: usize = 7;

impl DemModel {
    /// The units of the body: middle \[m\], and half-bonds that the kernel passes over, empty lanes, the
    /// motion of particles and what couples those of an overlap included.
    #[must_use]
    pub fn units(&self) -> Vec<Unit> {
        let bonds = self.bonds_at();
        let mut coupled = vec![false; self.body.len()];
        for (b, pair) in self.body.pairs().iter().enumerate() {
            let inside = self.in_overlap(b);
            pair.iter().for_each(|i| coupled[*i as usize] |= inside);
        }
        Unit::all(&self.nodes, |particles| {
            let coupled = particles.clone().filter(|i| coupled[*i]).count();
            (work(&bonds[particles]) + coupled * COUPLING) as f64
        })
    }

    /// How many bonds every particle has; counted, as a list of them would stay in memory.
    pub(super) fn bonds_at(&self) -> Vec<usize> {
        let mut out = vec![0; self.body.len()];
        let ends = self.body.pairs().iter().flatten();
        ends.for_each(|i| out[*i as usize] += 1);
        out
    }

    /// The part of the body that the rank of `communicator` holds: its units of `division`, with all their
    /// bonds. All ranks must have made the same body, and make the same calls of the part.
    ///
    /// Supports, initial states and weights are those of the part ([`Portion::local`] finds a particle of
    /// the whole body); what needs the whole body is refused by name. Sums of a part are those of the body:
    /// energies, the critical step.
    ///
    /// # Errors
    /// [`Error::InParts`] for a body that is a part already; [`arlequin_core::ranks::RankError`], as an
    /// error of the core, for bodies that differ, a division of another body or for another number of
    /// ranks, and what the transport says.
    pub fn share_out(mut self, division: &Division, communicator: Arc<dyn Communicator>) -> Result<Self> {
        self.keep_part(division, communicator)?;
        Ok(self)
    }

    /// Becomes the part of the rank of `communicator`, of a division by the work of units.
    pub(super) fn bisect(&mut self, communicator: &Arc<dyn Communicator>) -> Result<Shared<f64>> {
        let division = Division::bisect(self.nodes.len(), &self.units(), communicator.ranks());
        let division = division.map_err(|e| Error::Core(arlequin_core::Error::Rank(e)))?;
        let portion = self.keep_part(&division, communicator.clone())?;
        let field = self.field.clone();
        Ok(Shared { portion, field })
    }

    fn keep_part(
        &mut self,
        division: &Division,
        communicator: Arc<dyn Communicator>,
    ) -> Result<Arc<Portion>> {
        self.whole("sharing out")?;
        let heard = |e| Error::Core(arlequin_core::Error::Rank(e));
        ranks::agree(
            &*communicator,
            "the bodies of particles that they have made",
            self.digest(),
        )
        .map_err(heard)?;
        let portion = Portion::new(division.clone(), communicator).map_err(heard)?;
        if division.nodes() != self.nodes.len() {
            return Err(Error::LengthMismatch {
                what: "particles of the division",
                found: division.nodes(),
                expected: self.nodes.len(),
            });
        }
        let portion = Arc::new(portion);
        let own: Vec<usize> = (0..portion.nodes()).map(|i| portion.global(i)).collect();
        let halo = Halo::of_links(portion.clone(), self.body.pairs().iter().copied());
        let numbers: Vec<u32> = own.iter().map(|i| *i as u32).collect();
        let bonds = self.body.pairs().len();
        let (body, here) = self.body.part(&numbers, halo.ghosts());
        self.nodes = own.iter().map(|i| self.nodes[*i]).collect();
        self.mass = own.iter().map(|i| self.mass[*i]).collect();
        self.inertia = own.iter().map(|i| self.inertia[*i]).collect();
        self.order = own.iter().map(|i| self.order[*i]).collect();
        self.places = Vec::new();
        let samples = self.field_samples();
        let volumes: Vec<f64> = own.iter().map(|i| samples[*i]).collect();
        self.field = Arc::new(ParticleField::new(self.nodes.clone(), &volumes)?);
        self.kernel.renew();
        self.of_units = bonds_of_units(body.pairs(), own.len());
        self.body = body;
        let numbered = Numbered {
            bonds: here.into(),
            of: bonds,
        };
        self.halo = Some(halo);
        self.numbered = Some(numbered);
        self.break_apart();
        Ok(portion)
    }

    /// Volumes that the particles stand for \[m³\].
    fn field_samples(&self) -> Vec<f64> {
        use arlequin_core::Interpolation;
        let samples = self.field.samples().unwrap_or_default();
        samples.iter().map(|s| s.measure).collect()
    }

    /// What a rank exchanges: particles of others that it hears of, own ones that it tells of, and ranks on
    /// the other side. None for a whole body.
    #[must_use]
    pub fn halo(&self) -> Option<&Halo> {
        self.halo.as_ref()
    }

    /// Refuses what needs the whole body.
    pub(super) fn whole(&self, what: &'static str) -> Result<()> {
        match self.halo {
            Some(_) => Err(Error::InParts { what }),
            None => Ok(()),
        }
    }

    /// A number that tells bodies apart.
    fn digest(&self) -> u64 {
        let mut hasher = DefaultHasher::new();
        let body = &self.body;
        let vectors = body.positions().iter().flat_map(Vector3::iter);
        let numbers = vectors
            .chain(body.radii())
            .chain(body.mass())
            .chain(body.weights());
        numbers.for_each(|x| hasher.write_u64(x.to_bits()));
        body.pairs().iter().flatten().for_each(|i| hasher.write_u32(*i));
        hasher.write_u8(u8::from(self.has_finite_rotations()));
        if let Some(f) = &self.fracture {
            hasher.write(format!("{:?}", f.spec).as_bytes());
        }
        hasher.finish()
    }

    /// Weighted energy of all bonds \[J\], on all ranks: each bond with the unit of its first particle.
    pub(super) fn energy(&self, q: &[f64]) -> f64 {
        let ghosts = self.heard(q);
        let reader = Reader {
            ghosts: &ghosts,
            ..self.reader(q)
        };
        let part = |particles: Range<usize>| {
            let bonds = self.of_units[particles.start / UNIT].clone();
            [bonds.map(|b| reader.energy(&self.body, b)).sum()]
        };
        let portion = self.halo.as_ref().map(|h| &**h.portion());
        let [sum] = ranks::sum(self.nodes.len(), portion, &part);
        sum
    }

    /// What other ranks tell of their particles; a failure is kept for [`Portion::failure`], and no energy
    /// is then a number.
    pub(super) fn heard(&self, q: &[f64]) -> Vec<[f64; 7]> {
        let Some(halo) = &self.halo else {
            return Vec::new();
        };
        let reader = self.reader(q);
        let mut out = vec![[0.0; 7]; halo.ghosts().len()];
        let told = halo.exchange(&mut halo.messages(7), |i| reader.told(i), |g, x| out[g] = x);
        if told.is_err() {
            out.fill([f64::NAN; 7]);
        }
        out
    }
}

/// Bonds whose first particle is in a unit of `own` particles: bonds are in the order of these.
pub(super) fn bonds_of_units(pairs: &[[u32; 2]], own: usize) -> Vec<Range<usize>> {
    let mut out = vec![0..0; own.div_ceil(UNIT)];
    for (b, first) in pairs.iter().map(|p| p[0] as usize).enumerate() {
        if first < own {
            let range: &mut Range<usize> = &mut out[first / UNIT];
            let start = if range.end == 0 { b } else { range.start };
            *range = start..b + 1;
        }
    }
    out
}
