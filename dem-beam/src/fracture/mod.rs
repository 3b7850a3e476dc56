//! Breaking of bonds: criteria, strengths and the log of breaks.
//!
//! A bond breaks at the first instant at which its criterion reaches its strength; from then on it carries no
//! force. Masses stay: a particle that has lost all its bonds moves freely. A particle in an overlap remains
//! tied by the multipliers, with the weight it had in the reference configuration, and the model warns of
//! this ([`arlequin_core::Watching::watch`]).
//!
//! Bonds may soften instead: beyond their strength they lose stiffness until they fail
//! ([`Fracture::softening`]).
//!
//! A crack is a set of broken bonds each of which is near another: their middles are at most 1.1 bond lengths
//! apart. A crack has run into an overlap once [`CRACK`] of its bonds lie there. Fewer are stray bonds, which
//! break because strengths scatter ([`BreakLog::crack_in_overlap`]).
//!
//! The force kernel compares a bound of every bond's load with its strength and marks blocks of particles;
//! only the bonds in marked blocks are then compared with the exact criterion.
//!
//! Stresses refer to the beam's section (radius `r_b`, area `S`), unweighted:
//!
//! ```text
//! sigma_N = E e    sigma_M = M r_b/I, M the larger end moment    tau = T r_b/I_O
//! axial    sigma_N
//! rankine  1/2 (sigma_N + sigma_M + sqrt((sigma_N + sigma_M)^2 + 4 tau^2))    largest principal tension
//! mises    sqrt((|sigma_N| + sigma_M)^2 + 3 tau^2)                            breaks in compression as well
//! energy   U/S, elastic energy of the bond per section [J/m²]
//! tensile-energy    U/S for sigma_N >= 0, else (U_M + U_T)/S (s(sigma_N)/s(0))^2
//! hydrostatic       tr(sigma_i)/3 of a particle, all of whose bonds then break
//! ```
//!
//! `U_M` and `U_T` are the energies of bending and torsion, and `s(sigma_N)` is the tension of `rankine`.
//! Compression thus leaves the energy in proportion to the square of the tension that remains in the section;
//! a beam without tension in any direction never breaks.
//!
//! `rankine` is the usual criterion for cohesive beams of brittle materials (André et al. 2012, 2013). The
//! stress of a beam is not that of the packing: beams are stiffer than the packing, cover a part of the
//! section and are loaded unevenly. The strength of the beams is therefore several times that of the body: 4
//! times in tension for `axial`, 12 times for `rankine` and `mises`. [`crate::strength`] measures it;
//! docs/calibration.md has a table.

mod cracks;
pub(crate) mod criterion;
pub(crate) mod particles;
pub(crate) mod parts;
mod scatter;
mod search;
mod softening;
pub(crate) mod state;

pub use cracks::CRACK;
use cracks::Cracks;
pub use criterion::{BreakMode, Criterion, diameter_of_both, tensile_strength};
pub use scatter::Scatter;
use softening::Damage;

use crate::error::{Error, Result, positive};
use arlequin_core::snapshot::Record;
use nalgebra::Vector3;
use std::sync::{Arc, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};

/// Specification of when bonds break.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fracture {
    /// Quantity that is compared with the strength.
    pub criterion: Criterion,
    /// Strength \[Pa, or J/m² where [`Criterion::is_energy`]\]. With Weibull scatter it is the characteristic
    /// strength, at which 63.2 % of the bonds are broken; otherwise the mean.
    pub strength: f64,
    /// Energy per section \[J/m²\] that a bond takes until it fails, for a criterion of energies: beyond
    /// its strength its stiffness falls ([`Self::softening`]). `None` for bonds that break at their
    /// strength. Bonds whose scattered strength is larger break at their strength too.
    pub dissipated: Option<f64>,
    /// Scatter of the strengths between bonds.
    pub scatter: Scatter,
    /// Seed of the scatter.
    pub seed: u64,
    /// Steps between two checks. A check runs inside the force kernel and is cheap (decision 0011), so a
    /// value above 1 pays only if bonds may break some steps too late.
    pub every: usize,
    /// If true, bonds that lie wholly or partly in an overlap never break.
    ///
    /// This does not help against a crack that reaches the overlap: the unbreakable bonds and the other model
    /// then carry its load beyond the strength of the body.
    pub spare_overlap: bool,
}

impl Fracture {
    /// One strength for all bonds, checked in every step.
    #[must_use]
    pub fn new(criterion: Criterion, strength: f64) -> Self {
        Self {
            criterion,
            strength,
            dissipated: None,
            scatter: Scatter::None,
            seed: 1,
            every: 1,
            spare_overlap: false,
        }
    }

    /// One strength for all bonds, so that a crack takes `gc` \[J/m²\] per area that it opens in a body with
    /// beams of this radius over the mean particle radius.
    ///
    /// # Errors
    /// [`Error::StressCriterion`] for a criterion that compares stresses; [`Error::OutOfRange`] unless `gc`
    /// and the ratio are positive.
    pub fn from_fracture_energy(criterion: Criterion, gc: f64, radius_ratio: f64) -> Result<Self> {
        let criterion_name = criterion.name();
        let share = criterion
            .released_share(radius_ratio)
            .ok_or(Error::StressCriterion {
                criterion: criterion_name,
            })?;
        positive("fracture energy gc", gc)?;
        positive("beam radius ratio", radius_ratio)?;
        Ok(Self::new(criterion, gc / share))
    }

    /// Checks strength, scatter and interval. A model with this specification calls it itself.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for the first value out of its range.
    pub fn check(&self) -> Result<()> {
        positive("bond strength", self.strength)?;
        if let Some(dissipated) = self.dissipated {
            positive("energy per section until a bond fails", dissipated)?;
            if !self.criterion.is_energy() {
                let criterion = self.criterion.name();
                return Err(Error::StressCriterion { criterion });
            }
        }
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
    /// Time of the break \[s\].
    pub time: f64,
    /// Number of the bond in the model; in a partitioned model, its number in the whole model.
    pub bond: u32,
    /// Its two particles, numbered like `bond`.
    pub pair: [u32; 2],
    /// Energy that left the model with the bond, while it softened and when it broke \[J\].
    pub released: f64,
    /// Distance of the centres at the break \[m\].
    pub distance: f64,
    /// Middle of the bond in the reference configuration \[m\].
    pub place: Vector3<f64>,
    /// True if the bond lay wholly or partly in an overlap.
    pub overlap: bool,
    /// Largest contribution to its load.
    pub mode: BreakMode,
}

/// Log of all breaks so far, shared between a model, contact and output.
#[derive(Debug, Default)]
pub struct BreakLog {
    broken: Vec<bool>,
    /// Numbers in the whole model of the bonds of a rank's part; empty for a model that is not partitioned.
    numbers: Vec<u32>,
    events: Vec<Break>,
    released: f64,
    checks: usize,
    cracks: Cracks,
    into_overlap: Option<usize>,
    /// Damage of all bonds; empty if bonds do not soften.
    damages: Vec<Damage>,
    softened: usize,
}

impl BreakLog {
    /// Returns whether a bond is broken, by its number in the whole model. All bonds are whole at the start.
    #[must_use]
    pub fn is_broken(&self, bond: usize) -> bool {
        self.broken.get(bond).copied().unwrap_or(false)
    }

    /// Returns whether a bond is broken, by its number on this rank.
    pub(crate) fn is_broken_here(&self, bond: usize) -> bool {
        let bond = self.numbers.get(bond).map_or(bond, |b| *b as usize);
        self.is_broken(bond)
    }

    /// Breaks in the order in which they happened; for a partitioned model, the breaks of all ranks.
    #[must_use]
    pub fn events(&self) -> &[Break] {
        &self.events
    }

    /// The break with which a crack first had [`CRACK`] bonds in an overlap: the crack has then left the
    /// region that only particles model.
    #[must_use]
    pub fn crack_in_overlap(&self) -> Option<&Break> {
        self.events.get(self.into_overlap?)
    }

    /// Energy that left the model with broken bonds, and with the damage of others \[J\].
    #[must_use]
    pub fn released(&self) -> f64 {
        self.released
    }

    /// Number of checks of all bonds.
    #[must_use]
    pub fn checks(&self) -> usize {
        self.checks
    }

    /// Sets the numbers in the whole model of this rank's bonds.
    pub(crate) fn number(&mut self, numbers: &[u32]) {
        self.numbers = numbers.to_vec();
    }

    pub(crate) fn begin(&mut self, bonds: usize, softening: bool) {
        self.broken = vec![false; bonds];
        self.begin_damage(if softening { bonds } else { 0 });
    }

    /// Writes what a resumed run needs: three numbers and four integers per break, and the number of checks.
    pub(crate) fn save(&self, out: &mut Record<f64>) {
        out.integers.push(self.checks as u64);
        for e in &self.events {
            out.numbers.extend([e.time, e.released, e.distance]);
            out.integers
                .extend([e.bond, e.pair[0], e.pair[1], e.mode as u32].map(u64::from));
        }
    }

    /// Restores what [`Self::save`] wrote; returns `false` for a record of another model.
    ///
    /// `known` returns the middle of the bond between two particles, and whether it lies in an overlap.
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
            self.released += released;
            self.push(event);
        }
        numbers.len() * 3 == from.numbers.len()
            && broken.len() * 4 == integers.len()
            && numbers.len() == broken.len()
    }

    pub(crate) fn checked(&mut self) {
        self.checks += 1;
    }

    /// Adds a break whose energy is counted already.
    fn push(&mut self, event: Break) {
        if let Some(b) = self.broken.get_mut(event.bond as usize) {
            *b = true;
        }
        // All breaks join cracks; only bonds in overlaps count.
        let bonds = self.cracks.add(event.place, event.distance, event.overlap);
        if bonds >= CRACK && self.into_overlap.is_none() {
            self.into_overlap = Some(self.events.len());
        }
        self.events.push(event);
    }
}

/// A log with several owners.
pub type SharedLog = Arc<RwLock<BreakLog>>;

/// Locks the log for reading, even if another owner panicked. Steps wait for readers: do not hold the lock
/// during a step.
pub fn locked(log: &SharedLog) -> RwLockReadGuard<'_, BreakLog> {
    log.read().unwrap_or_else(PoisonError::into_inner)
}

/// Locks the log for writing.
pub(crate) fn writing(log: &SharedLog) -> RwLockWriteGuard<'_, BreakLog> {
    log.write().unwrap_or_else(PoisonError::into_inner)
}
