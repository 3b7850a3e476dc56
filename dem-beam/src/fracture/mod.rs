//! Bonds that break: criteria, strengths and the record of what broke.
//!
//! A bond breaks at the first instant at which its criterion reaches its strength; it then carries nothing,
//! for ever. Masses stay: a particle that has lost all bonds moves freely, and one in an overlap stays tied
//! by the multipliers, with the weight it had in the reference configuration. The model warns of it
//! ([`arlequin_core::Watching::watch`]).
//!
//! A crack is a set of broken bonds each of which is near another: their middles are at most 1.1 lengths of
//! a bond apart. It has run into an overlap once [`CRACK`] of its bonds lie there; fewer are stray bonds,
//! which break by the scatter of strengths ([`BreakLog::crack_in_overlap`]).
//!
//! The force kernel compares a bound of every bond's load with its strength on the way and marks blocks of
//! particles; the criterion itself decides, bond by bond, in marked blocks only.
//!
//! Stresses are those of the beam's section (radius `r_b`, area `S`), unweighted:
//!
//! ```text
//! sigma_N = E e    sigma_M = M r_b/I, M the larger end moment    tau = T r_b/I_O
//! axial    sigma_N
//! rankine  1/2 (sigma_N + sigma_M + sqrt((sigma_N + sigma_M)^2 + 4 tau^2))    largest principal tension
//! mises    sqrt((|sigma_N| + sigma_M)^2 + 3 tau^2)                            breaks in compression as well
//! energy   U/S, elastic energy of the bond per section \[J/m²\]
//! ```
//!
//! `rankine` is the usual one for cohesive beams of brittle materials (André et al. 2012, 2013). The stress
//! of the beam is not that of the packing: beams are stiffer than the packing, carry a part of the section
//! and are loaded unevenly, so the strength of the beams is several times that of the body: 4 times in
//! tension for `axial`, 12 times for `rankine` and `mises`. [`crate::strength`] measures it,
//! docs/calibration.md has a table.

mod cracks;
pub(crate) mod criterion;
pub(crate) mod parts;
mod scatter;
pub(crate) mod state;

pub use cracks::CRACK;
use cracks::Cracks;
pub use criterion::{BreakMode, Criterion};
pub use scatter::Scatter;

use crate::error::{Error, Result, positive};
use arlequin_core::snapshot::Record;
use nalgebra::Vector3;
use std::sync::{Arc, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};

/// When bonds break.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fracture {
    /// What is compared.
    pub criterion: Criterion,
    /// Strength: Pa, or J/m^2 for [`Criterion::Energy`]. Characteristic (63.2 % broken) with Weibull
    /// scatter, mean otherwise.
    pub strength: f64,
    /// Scatter of the strengths between bonds.
    pub scatter: Scatter,
    /// Seed of the scatter.
    pub seed: u64,
    /// Steps between two checks. A check rides in the force kernel and is cheap (decision 0011): more than
    /// one pays only where strengths may be passed for some steps.
    pub every: usize,
    /// Whether bonds that lie in an overlap, wholly or in part, never break. No cure for a crack that
    /// reaches the overlap: bonds that cannot break and the other model carry its load past the strength of
    /// the body.
    pub spare_overlap: bool,
}

impl Fracture {
    /// One strength for all bonds, checked in every step.
    #[must_use]
    pub fn new(criterion: Criterion, strength: f64) -> Self {
        Self {
            criterion,
            strength,
            scatter: Scatter::None,
            seed: 1,
            every: 1,
            spare_overlap: false,
        }
    }

    /// Checks strength, scatter and interval, as a model that takes it does.
    ///
    /// # Errors
    /// [`Error::OutOfRange`].
    pub fn check(&self) -> Result<()> {
        positive("bond strength", self.strength)?;
        self.scatter.check()?;
        if self.every == 0 {
            return Err(Error::out_of_range(
                "steps between checks of the bonds",
                0.0,
                "values >= 1",
            ));
        }
        Ok(())
    }
}

/// A bond that broke.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Break {
    /// When \[s\].
    pub time: f64,
    /// Number of the bond in the model; in the whole one where it is in parts, as those of particles.
    pub bond: u32,
    /// Its particles, in the model's numbers.
    pub pair: [u32; 2],
    /// Energy it took out of the model \[J\].
    pub released: f64,
    /// Distance of the centres then \[m\].
    pub distance: f64,
    /// Middle of the bond in the reference configuration \[m\].
    pub place: Vector3<f64>,
    /// Whether it lay in an overlap, wholly or in part.
    pub overlap: bool,
    /// What loaded it most.
    pub mode: BreakMode,
}

/// What broke so far. Shared between a model, contact and output.
#[derive(Debug, Default)]
pub struct BreakLog {
    broken: Vec<bool>,
    /// Numbers in the whole model of the bonds of a part; empty for a whole one.
    numbers: Vec<u32>,
    events: Vec<Break>,
    released: f64,
    checks: usize,
    cracks: Cracks,
    into_overlap: Option<usize>,
}

impl BreakLog {
    /// Whether a bond is broken, by its number in the whole model; all are whole at the start.
    #[must_use]
    pub fn is_broken(&self, bond: usize) -> bool {
        self.broken.get(bond).copied().unwrap_or(false)
    }

    /// The same by the number of a bond on this rank.
    pub(crate) fn is_broken_here(&self, bond: usize) -> bool {
        let bond = self.numbers.get(bond).map_or(bond, |b| *b as usize);
        self.is_broken(bond)
    }

    /// Breaks in the order in which they happened, of a model in parts those on all ranks.
    #[must_use]
    pub fn events(&self) -> &[Break] {
        &self.events
    }

    /// The break with which a crack first had [`CRACK`] bonds in an overlap: it has left the particles' own
    /// region.
    #[must_use]
    pub fn crack_in_overlap(&self) -> Option<&Break> {
        self.events.get(self.into_overlap?)
    }

    /// Energy that left with broken bonds \[J\].
    #[must_use]
    pub fn released(&self) -> f64 {
        self.released
    }

    /// How often all bonds were checked.
    #[must_use]
    pub fn checks(&self) -> usize {
        self.checks
    }

    /// From now on bonds here have these numbers in the whole model.
    pub(crate) fn number(&mut self, numbers: &[u32]) {
        self.numbers = numbers.to_vec();
    }

    pub(crate) fn begin(&mut self, bonds: usize) {
        self.broken = vec![false; bonds];
    }

    /// What a resumed run must know: three numbers and four integers per break, and the number of checks.
    pub(crate) fn save(&self, out: &mut Record<f64>) {
        out.integers.push(self.checks as u64);
        for e in &self.events {
            out.numbers.extend([e.time, e.released, e.distance]);
            out.integers
                .extend([e.bond, e.pair[0], e.pair[1], e.mode as u32].map(u64::from));
        }
    }

    /// Undoes [`Self::save`]; `false` for a record that is not of this model. `known` is what is known of a
    /// bond between two particles: its middle, and whether it lies in an overlap.
    pub(crate) fn restore(
        &mut self,
        from: &Record<f64>,
        known: &dyn Fn(u64, [u64; 2]) -> Option<(Vector3<f64>, bool)>,
    ) -> bool {
        let Some((checks, integers)) = from.integers.split_first() else {
            return false;
        };
        let (numbers, _) = from.numbers.as_chunks::<3>();
        let (broken, _) = integers.as_chunks::<4>();
        self.broken = vec![false; self.broken.len()];
        self.events.clear();
        self.cracks = Cracks::default();
        self.into_overlap = None;
        self.released = 0.0;
        self.checks = *checks as usize;
        for (&[time, released, distance], &[bond, i, j, mode]) in numbers.iter().zip(broken) {
            let known = known(bond, [i, j]).filter(|_| !self.is_broken(bond as usize));
            let (Some((place, overlap)), Some(&mode)) = (known, BreakMode::ALL.get(mode as usize)) else {
                return false;
            };
            let event = Break {
                time,
                bond: bond as u32,
                pair: [i as u32, j as u32],
                released,
                distance,
                place,
                overlap,
                mode,
            };
            self.push(event);
        }
        numbers.len() * 3 == from.numbers.len()
            && broken.len() * 4 == integers.len()
            && numbers.len() == broken.len()
    }

    pub(crate) fn checked(&mut self) {
        self.checks += 1;
    }

    pub(crate) fn push(&mut self, event: Break) {
        if let Some(b) = self.broken.get_mut(event.bond as usize) {
            *b = true;
        }
        self.released += event.released;
        // All breaks join cracks, those in overlaps count.
        let bonds = self.cracks.add(event.place, event.distance, event.overlap);
        if bonds >= CRACK && self.into_overlap.is_none() {
            self.into_overlap = Some(self.events.len());
        }
        self.events.push(event);
    }
}

/// A log in several hands.
pub type SharedLog = Arc<RwLock<BreakLog>>;

/// The log to read, whatever happened to its other holders. Steps wait for readers: do not hold it during
/// one.
pub fn locked(log: &SharedLog) -> RwLockReadGuard<'_, BreakLog> {
    log.read().unwrap_or_else(PoisonError::into_inner)
}

/// The log to write.
pub(crate) fn writing(log: &SharedLog) -> RwLockWriteGuard<'_, BreakLog> {
    log.write().unwrap_or_else(PoisonError::into_inner)
}
