//! Beams that soften: their stiffness falls along a line after the peak.
//!
//! The load of a beam is its elastic energy per section `w` without damage. With the energy `w_1` at the peak
//! (the strength) and the energy `G` per section that the beam takes to fail, the overload `r = √(w/w_1)` is
//! proportional to the strain, and the stiffness left is
//!
//! ```text
//! 1 − D = 1                               r <= 1
//!       = (r_f − r)/(r (r_f − 1))         1 <= r <= r_f,  r the largest so far
//!       = 0                               r >= r_f = G/w_1
//! ```
//!
//! Along a straight path of strains, the stress `(1 − D) r` then falls along a line from its peak at `r = 1`
//! to zero at `r_f`, and the beam takes `w_1 r_f = G`. Unloading is elastic with the stiffness left.
//!
//! Damage is updated at the end of a step. A change of stiffness at given displacements removes a part of the
//! beam, whose energy leaves by the rule of [`arlequin_core::Evolution`]: exactly, under the linear law.

use super::state::FractureState;
use super::{Break, BreakLog, Criterion, Fracture, locked};
use crate::bond::BeamMaterial;
use crate::error::{Error, Result, positive};
use crate::particles::BondedParticles;
use arlequin_core::snapshot::Record;

/// Bonds that soften.
#[derive(Debug)]
pub(crate) struct Softening {
    /// Energy per section that a bond takes to fail \[J/m²\].
    dissipated: f64,
    /// Bonds that lost a part of their stiffness in this step, with the share of it that is left.
    pub(crate) now: Vec<(u32, f64)>,
}

/// Damage of one bond.
#[derive(Debug, Clone, Copy)]
pub(super) struct Damage {
    /// Largest load so far beyond the strength \[J/m²\].
    pub(super) load: f64,
    /// Share of the stiffness that is left: zero for a broken bond.
    pub(super) left: f64,
    /// Energy that left with the stiffness \[J\].
    pub(super) released: f64,
}

impl Damage {
    const NONE: Self = Self {
        load: 0.0,
        left: 1.0,
        released: 0.0,
    };

    fn is_partial(&self) -> bool {
        self.left > 0.0 && self.left < 1.0
    }
}

/// Loss of a bond in a step: all of its stiffness, or a part.
#[derive(Debug, Clone, Copy)]
pub(super) struct Loss {
    /// The break; for a bond that stays, the same facts without a break. Its energy is that of this step
    /// alone.
    pub(super) event: Break,
    /// Damage after the step, without energy.
    pub(super) damage: Damage,
}

/// Damaged bonds of a record, and all energy that had left the model \[J\].
pub(super) type Damages = (f64, Vec<(usize, Damage)>);

impl Softening {
    /// Returns the state of undamaged bonds if they soften.
    pub(super) fn new(spec: &Fracture) -> Option<Self> {
        spec.dissipated.map(|dissipated| Self {
            dissipated,
            // Room for a usual step, since a step should not allocate.
            now: Vec::with_capacity(64),
        })
    }

    /// Share of the stiffness left at a load over the first strength.
    fn stiffness_share(&self, load: f64, first: f64) -> f64 {
        let (r, last) = ((load / first).sqrt(), self.dissipated / first);
        if r <= 1.0 {
            1.0
        } else if r < last {
            (last - r) / (r * (last - 1.0))
        } else {
            0.0
        }
    }
}

impl Fracture {
    /// Mean diameter \[m\] that spheres must stay below so that beams soften from the axial stress `strength`
    /// \[Pa\] on: `2 E_b gc/(F σ²)`.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] unless all are positive.
    pub fn largest_diameter(gc: f64, strength: f64, beam: &BeamMaterial) -> Result<f64> {
        let brittle = Self::from_fracture_energy(Criterion::TensileEnergy, gc, beam.radius_ratio)?;
        positive("bond strength", strength)?;
        Ok(brittle.strength / (strength * strength / (2.0 * beam.young)))
    }

    /// Beams that soften, so that a body of spheres of the mean diameter `diameter` \[m\] takes `gc` \[J/m²\]
    /// per area of a crack and its beams bear the axial stress `strength` \[Pa\].
    ///
    /// # Errors
    /// [`Error::SnapBack`] if the beams hold more energy at `strength` than the crack may take;
    /// [`Error::OutOfRange`] unless all are positive.
    pub fn softening(gc: f64, strength: f64, beam: &BeamMaterial, diameter: f64) -> Result<Self> {
        let brittle = Self::from_fracture_energy(Criterion::TensileEnergy, gc, beam.radius_ratio)?;
        let largest = Self::largest_diameter(gc, strength, beam)?;
        positive("mean diameter", diameter)?;
        let dissipated = brittle.strength;
        if diameter >= largest {
            return Err(Error::SnapBack {
                gc,
                strength,
                diameter,
                largest,
            });
        }
        Ok(Self {
            strength: strength * strength / (2.0 * beam.young) * diameter,
            dissipated: Some(dissipated),
            ..brittle
        })
    }
}

impl FractureState {
    /// Returns the number of bonds whose scattered peak lies at `G` or beyond: they break at once and release
    /// the energy of their peak.
    pub(crate) fn snapping(&self, body: &BondedParticles) -> usize {
        let bonds = 0..body.pairs().len();
        self.softening.as_ref().map_or(0, |s| {
            bonds
                .filter(|b| self.first_strength(body, *b) >= s.dissipated)
                .count()
        })
    }

    /// Weakens a bond under a load beyond its present strength. Returns the share of its present stiffness
    /// that it loses and its damage; `None` if too little is lost to be stored.
    pub(super) fn weaken(&mut self, body: &BondedParticles, bond: usize, load: f64) -> Option<(f64, Damage)> {
        let left = match &self.softening {
            Some(softening) => softening.stiffness_share(load, self.first_strength(body, bond)),
            None => 0.0,
        };
        let damage = Damage {
            load,
            left,
            ..Damage::NONE
        };
        let Some(softening) = self.softening.as_mut().filter(|_| left > 0.0) else {
            // An infinite strength is never reached, so the bond cannot break again.
            self.strength[bond] = f64::INFINITY;
            return Some((1.0, damage));
        };
        let [before, after] = [body.scale(bond), body.softened(bond, left)];
        // A bond without weight softens without energy.
        let lost = if before > 0.0 {
            (before - after) / before
        } else {
            0.0
        };
        // Stored stiffnesses have few digits. The strength stays as well, so that losses add up.
        if before > 0.0 && lost <= 0.0 {
            return None;
        }
        softening.now.push((bond as u32, left));
        self.strength[bond] = load;
        Some((lost, damage))
    }

    /// Takes strengths and stiffnesses of damaged bonds from the log; [`Softening::now`] then lists them, for
    /// the caller to follow.
    pub(super) fn follow_damage(&mut self) {
        let Some(softening) = &mut self.softening else {
            return;
        };
        softening.now.clear();
        let log = locked(&self.log);
        for (b, strength) in self.strength.iter_mut().enumerate() {
            if let Some(damage) = log.damage_here(b) {
                // A bond that sleeps or is spared keeps its infinite strength.
                if strength.is_finite() {
                    *strength = damage.load;
                }
                softening.now.push((b as u32, damage.left));
            }
        }
    }
}

impl BreakLog {
    /// Share of the stiffness that a bond has lost \[–\], by its number in the whole model: 1 for a broken
    /// bond.
    #[must_use]
    pub fn damage(&self, bond: usize) -> f64 {
        let soft = self.damages.get(bond).map_or(0.0, |d| 1.0 - d.left);
        if self.is_broken(bond) { 1.0 } else { soft }
    }

    /// Number of bonds that have softened, broken ones included; zero if bonds break at once.
    #[must_use]
    pub fn softened(&self) -> usize {
        self.softened
    }

    /// Damage of a bond that has softened and is not broken, by its number on this rank.
    pub(super) fn damage_here(&self, bond: usize) -> Option<&Damage> {
        let bond = self.numbers.get(bond).map_or(bond, |b| *b as usize);
        self.damages.get(bond).filter(|d| d.is_partial())
    }

    /// Starts the damage of this number of bonds that soften.
    pub(super) fn begin_damage(&mut self, bonds: usize) {
        self.damages = vec![Damage::NONE; bonds];
        self.softened = 0;
    }

    /// Adds what a bond lost in a step.
    pub(super) fn lose(&mut self, loss: Loss) {
        let mut event = loss.event;
        self.released += event.released;
        if let Some(damage) = self.damages.get_mut(event.bond as usize) {
            self.softened += usize::from(damage.left >= 1.0);
            event.released += damage.released;
            *damage = Damage {
                released: event.released,
                ..loss.damage
            };
        }
        if loss.damage.left <= 0.0 {
            self.push(event);
        }
    }

    /// Writes all energy so far and the damaged bonds, if bonds soften: one integer and three numbers each.
    pub(super) fn save_damages(&self, out: &mut Record<f64>) {
        if self.damages.is_empty() {
            return;
        }
        out.numbers.push(self.released);
        let partial = self.damages.iter().enumerate().filter(|(_, d)| d.is_partial());
        out.integers.push(partial.clone().count() as u64);
        for (b, d) in partial {
            out.integers.push(b as u64);
            out.numbers.extend([d.load, d.left, d.released]);
        }
    }

    /// Takes what [`Self::save_damages`] wrote off the front of a record; `None` for a record of another
    /// model.
    pub(super) fn read_damages(&self, from: &mut Record<f64>) -> Option<Damages> {
        if self.damages.is_empty() {
            return Some((0.0, Vec::new()));
        }
        let count = usize::try_from(*from.integers.first()?).ok()?;
        let fits = count < from.integers.len() && count <= from.numbers.len().checked_sub(1)? / 3;
        if !fits {
            return None;
        }
        let total = from.numbers.remove(0);
        let bonds: Vec<u64> = from.integers.drain(..=count).skip(1).collect();
        let numbers: Vec<f64> = from.numbers.drain(..3 * count).collect();
        let damages = bonds.into_iter().zip(numbers.as_chunks::<3>().0);
        let damages = damages.map(|(b, &[load, left, released])| {
            let damage = Damage { load, left, released };
            let bond = usize::try_from(b).ok().filter(|b| *b < self.damages.len())?;
            (damage.is_partial() && load > 0.0).then_some((bond, damage))
        });
        Some((total, damages.collect::<Option<_>>()?))
    }

    /// Restores the damage of a record after its breaks.
    pub(super) fn restore_damages(&mut self, (total, damages): Damages) {
        if self.damages.is_empty() {
            return;
        }
        self.damages.fill(Damage::NONE);
        for event in &self.events {
            if let Some(damage) = self.damages.get_mut(event.bond as usize) {
                *damage = Damage {
                    left: 0.0,
                    released: event.released,
                    ..Damage::NONE
                };
            }
        }
        self.softened = self.events.len() + damages.len();
        for (bond, damage) in damages {
            self.damages[bond] = damage;
        }
        // Not the sum over the bonds: their order differs from that of the steps, and so would the digits.
        self.released = total;
    }
}
