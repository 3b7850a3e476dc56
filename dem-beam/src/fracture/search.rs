//! Search for the bonds that break in a step.

use super::parts::Parts;
use super::state::FractureState;
use super::writing;
use crate::kernel::lanes::LANES;
use crate::model::poses::Reader;
use crate::particles::BondedParticles;
use rayon::prelude::*;

/// Bonds or particles per unit of parallel work.
pub(super) const CHUNK: usize = 1_024;

/// Number of bonds or particles above which a second thread pays for its wake-up.
const LARGE: usize = 4 * CHUNK;

impl FractureState {
    /// Load of a particle over its strength \[–\]; `None` for a criterion of bonds and for ghosts.
    pub(crate) fn particle_load(&self, body: &BondedParticles, reader: &Reader<'_>, i: usize) -> Option<f64> {
        let particles = self.particles.as_ref().filter(|_| i < self.owned)?;
        Some(particles.load(i, body, &self.adjacency, |b| Self::strain(body, reader, b)))
    }

    /// Number of bonds or owned particles whose loads are compared with strengths.
    fn candidates(&self, body: &BondedParticles) -> usize {
        match self.particles {
            Some(_) => self.owned,
            None => body.pairs().len(),
        }
    }

    /// Load over strength \[–\] of a bond, or of an owned particle under a criterion of particles.
    fn load(&self, body: &BondedParticles, reader: &Reader<'_>, candidate: usize) -> f64 {
        let of_particle = self.particle_load(body, reader, candidate);
        of_particle.unwrap_or_else(|| self.ratio(body, reader, candidate))
    }

    /// Largest load over strength of all whole bonds or particles, and the number at or above one. In a
    /// partitioned body, counts the particles that this rank owns, and the bonds of whose ends it owns the
    /// first.
    pub(crate) fn peak(&self, body: &BondedParticles, reader: &Reader<'_>) -> (f64, usize) {
        // Two ranks have a bond between them; the owner of its first particle counts it.
        let is_counted = |k: &usize| self.particles.is_some() || (body.pairs()[*k][0] as usize) < self.owned;
        let counted = (0..self.candidates(body)).filter(is_counted);
        counted.fold((0.0, 0), |(top, count), k| {
            let r = self.load(body, reader, k);
            (f64::max(top, r), count + usize::from(r >= 1.0))
        })
    }

    /// Fills [`Self::now`] with the bonds that break or soften, in ascending order. Returns whether loads
    /// were compared with strengths in this step.
    ///
    /// If the force kernel has screened the current positions, only the bonds of marked blocks are compared.
    pub(crate) fn find(&mut self, body: &BondedParticles, reader: &Reader<'_>) -> bool {
        self.now.clear();
        if let Some(softening) = &mut self.softening {
            softening.now.clear();
        }
        self.wait += 1;
        if self.wait < self.spec.every {
            return false;
        }
        self.wait = 0;
        writing(&self.log).checked();
        let mut suspects = std::mem::take(&mut self.suspects);
        // Marks serve one check: the next step moves the particles.
        if std::mem::take(&mut self.fresh) {
            self.suspect(&mut suspects);
            self.compare(body, reader, suspects.len(), |k| suspects[k] as usize);
        } else {
            self.compare(body, reader, self.candidates(body), |k| k);
        }
        if self.particles.is_some() {
            self.take_bonds(&mut suspects);
        }
        self.suspects = suspects;
        true
    }

    /// Replaces the breaking particles in [`Self::now`] by their breakable bonds. `particles` is a buffer.
    fn take_bonds(&mut self, particles: &mut Vec<u32>) {
        particles.clear();
        particles.append(&mut self.now);
        for &i in &*particles {
            let bonds = self.adjacency.row(i as usize).iter().map(|e| e[1]);
            self.now
                // Broken and spared bonds have infinite strengths; they stay as they are.
                .extend(bonds.filter(|b| self.strength[*b as usize].is_finite()));
        }
        // A bond between two breaking particles breaks once.
        self.now.sort_unstable();
        self.now.dedup();
    }

    /// Lists the bonds of marked blocks, each once, or the particles of these blocks, in ascending order.
    fn suspect(&self, suspects: &mut Vec<u32>) {
        suspects.clear();
        for block in (0..self.marks.len()).filter(|b| self.marks[*b]) {
            let particles = block * LANES..((block + 1) * LANES).min(self.owned);
            if self.particles.is_some() {
                suspects.extend(particles.map(|i| i as u32));
                continue;
            }
            for i in particles {
                for &[neighbour, bond] in self.adjacency.row(i) {
                    let neighbour = neighbour as usize;
                    // A bond between two marked blocks is taken from its first end. Ghosts are in no block
                    // here.
                    if neighbour > i || !self.marks[neighbour / LANES] {
                        suspects.push(bond);
                    }
                }
            }
        }
        suspects.sort_unstable();
    }

    /// Fills [`Self::now`] with those of `count` candidates that reach their strength; the `k`-th candidate
    /// is `candidate(k)`.
    fn compare(
        &mut self,
        body: &BondedParticles,
        reader: &Reader<'_>,
        count: usize,
        candidate: impl Fn(usize) -> usize + Sync,
    ) {
        let (mut flags, mut now) = (std::mem::take(&mut self.flags), std::mem::take(&mut self.now));
        let range = |c: usize| c * CHUNK..((c + 1) * CHUNK).min(count);
        let breaks = |k: &usize| self.load(body, reader, candidate(*k)) >= 1.0;
        let look = |(c, flag): (usize, &mut bool)| *flag = range(c).any(|k| breaks(&k));
        let chunks = &mut flags[..count.div_ceil(CHUNK)];
        // Threads only flag chunks: the list of breaks is then filled in one order, whatever their number.
        if count > LARGE && rayon::current_num_threads() > 1 {
            chunks.par_iter_mut().enumerate().for_each(look);
        } else {
            chunks.iter_mut().enumerate().for_each(look);
        }
        for c in (0..count.div_ceil(CHUNK)).filter(|c| flags[*c]) {
            now.extend(range(c).filter(breaks).map(|k| candidate(k) as u32));
        }
        (self.now, self.flags) = (now, flags);
    }

    /// Returns whether any bond of the whole body breaks now. [`Self::now`] then lists the breaking bonds of
    /// this rank. `parts` is that of a partitioned body. Collective.
    pub(crate) fn find_everywhere(
        &mut self,
        body: &BondedParticles,
        reader: &Reader<'_>,
        parts: Option<&Parts>,
    ) -> arlequin_core::Result<bool> {
        // The interval of checks is the same on all ranks: all of them check, or none.
        if !self.find(body, reader) {
            return Ok(false);
        }
        let Some(parts) = parts else {
            return Ok(!self.now.is_empty());
        };
        // Most steps end here, after one word per rank: the bonds between ranks are not compared.
        if !parts.any_breaks(&self.now)? {
            return Ok(false);
        }
        if self.particles.is_some() {
            // Only the owner of a particle knows all of its bonds.
            parts.share_breaks(&mut self.now)?;
        } else {
            // A bond may break by the moment at an end that another rank owns and screened.
            let cross = parts.cross().iter().copied();
            let missed = cross.filter(|b| self.ratio(body, reader, *b as usize) >= 1.0);
            let missed: Vec<u32> = missed.collect();
            self.now.extend(missed);
        }
        self.now.sort_unstable();
        self.now.dedup();
        Ok(true)
    }
}
