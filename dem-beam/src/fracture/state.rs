//! Breaking of the bonds of one model.

use super::criterion::{Section, Strain};
use super::parts::{GhostStates, Parts};
use super::{Break, Fracture, Scatter, SharedLog, locked, writing};
use crate::bond::Twist;
use crate::kernel::engine::Marks;
use crate::kernel::lanes::LANES;
use crate::kernel::screen::Screen;
use crate::model::poses::Reader;
use crate::particles::BondedParticles;
use arlequin_core::Evolution;
use arlequin_core::adjacency::Adjacency;
use arlequin_core::snapshot::Record;
use nalgebra::Vector3;
use rayon::prelude::*;
use std::sync::Arc;

/// Bonds per unit of parallel work.
const CHUNK: usize = 1_024;

/// Number of bonds above which a second thread pays for its wake-up.
const LARGE: usize = 4 * CHUNK;

/// Strengths and working buffers of a model whose bonds can break.
#[derive(Debug)]
pub(crate) struct FractureState {
    pub(crate) spec: Fracture,
    pub(crate) log: SharedLog,
    /// Bonds of every particle.
    pub(crate) adjacency: Arc<Adjacency<[u32; 2]>>,
    section: Section,
    /// Strength of each bond; infinite for broken and spared bonds.
    strength: Vec<f64>,
    flags: Vec<bool>,
    /// Bonds that break in this step; see [`Self::find`].
    pub(crate) now: Vec<u32>,
    wait: usize,
    /// Screen inside the force kernel; `None` if bonds must be compared one by one.
    screen: Option<Screen>,
    plainly: bool,
    /// First slot of each block in the kernel.
    first_slots: Vec<u32>,
    /// Marks of blocks in which a bond may have reached its strength, and whether they belong to the current
    /// positions.
    marks: Vec<bool>,
    fresh: bool,
    /// Bonds of marked blocks.
    suspects: Vec<u32>,
    /// Number of owned particles; the others are ghosts.
    pub(super) owned: usize,
    /// Data about the whole body, if it is partitioned.
    pub(crate) parts: Option<Parts>,
}

impl FractureState {
    pub(crate) fn new(spec: Fracture, body: &BondedParticles, log: SharedLog) -> Self {
        writing(&log).begin(body.pairs().len());
        Self::with_owned(spec, body, body.len(), log)
    }

    /// Like [`Self::new`], with only the first `owned` particles owned.
    pub(super) fn with_owned(spec: Fracture, body: &BondedParticles, owned: usize, log: SharedLog) -> Self {
        let bonds = body.pairs().len();
        let blocks = owned.div_ceil(LANES);
        let mut out = Self {
            spec,
            log,
            adjacency: body.adjacency(),
            section: Section::new(body.rigidity()),
            strength: (0..bonds).map(|b| strength_of(&spec, body, b)).collect(),
            flags: vec![false; bonds.div_ceil(CHUNK)],
            now: Vec::with_capacity(64),
            wait: 0,
            screen: None,
            plainly: false,
            first_slots: vec![0; blocks],
            marks: vec![false; blocks],
            fresh: false,
            suspects: Vec::with_capacity(bonds),
            owned,
            parts: None,
        };
        out.set_up_screen(body);
        out
    }

    fn set_up_screen(&mut self, body: &BondedParticles) {
        if self.plainly {
            return;
        }
        let length = |b: crate::bond::LinearBond| 1.0 / b.axis.norm();
        let lengths = body.bonds().map(length);
        let (least, most) = lengths.fold((f64::INFINITY, 0.0_f64), |(a, b), l| (a.min(l), b.max(l)));
        self.screen = Screen::new(self.spec.criterion, self.section, &self.strength, [least, most]);
        // Numbers slots as the kernel does: a block has as many as its particle with most bonds.
        let mut slots = 0;
        for (b, first) in self.first_slots.iter_mut().enumerate() {
            *first = slots;
            let particles = b * LANES..self.owned.min((b + 1) * LANES);
            slots += particles.map(|i| self.adjacency.row(i).len()).max().unwrap_or(0) as u32;
        }
        // Only then do strengths differ between bonds; one limit for all needs no memory traffic.
        if self.spec.scatter != Scatter::None || self.spec.spare_overlap {
            self.screen = self.screen.take().map(|s| s.with_ratios(slots as usize));
            let blocks: Vec<usize> = (0..self.first_slots.len()).collect();
            self.follow(&blocks, &|_| true);
        }
    }

    /// Compares bond by bond from now on, without a screen.
    pub(crate) fn check_plainly(&mut self) {
        self.plainly = true;
        self.screen = None;
    }

    /// Writes the limits of the bonds of `blocks` in the order in which the kernel stores them. Bonds for
    /// which `whole` is false are left out.
    pub(crate) fn follow(&mut self, blocks: &[usize], whole: &dyn Fn(usize) -> bool) {
        let Some(screen) = &mut self.screen else { return };
        for &block in blocks {
            let first = self.first_slots[block] as usize;
            let particles = block * LANES..((block + 1) * LANES).min(self.owned);
            for (lane, i) in particles.enumerate() {
                let bonds = self.adjacency.row(i);
                let whole_bonds = bonds.iter().map(|e| e[1] as usize).filter(|b| whole(*b));
                let strengths = whole_bonds
                    .map(|b| self.strength[b])
                    .chain(std::iter::repeat(f64::INFINITY));
                for (slot, strength) in strengths.take(bonds.len()).enumerate() {
                    screen.set(first + slot, lane, strength);
                }
            }
        }
    }

    /// Returns the screen and the marks for the force kernel if bonds are checked in this step.
    pub(crate) fn marks(&mut self) -> Option<Marks<'_>> {
        // `wait` counts the steps since the last check and is raised in `find`, after the forces.
        self.fresh = self.screen.is_some() && self.wait + 1 >= self.spec.every;
        let screen = self.screen.as_ref().filter(|_| self.fresh)?;
        Some((screen, &mut self.marks))
    }

    /// Returns whether the force kernel marks the blocks of all bonds that break, and of both of their ends.
    pub(crate) fn is_screened(&self) -> bool {
        // Blocks of other ranks are marked there.
        self.screen.is_some() && self.parts.is_none()
    }

    /// Makes whole bonds for which `inside` is true unbreakable and the others breakable, if the
    /// specification spares overlaps.
    pub(crate) fn spare(&mut self, body: &BondedParticles, inside: impl Fn(usize) -> bool) {
        if !self.spec.spare_overlap {
            return;
        }
        let log = locked(&self.log);
        for (b, strength) in self.strength.iter_mut().enumerate() {
            if !log.is_broken_here(b) {
                *strength = if inside(b) {
                    f64::INFINITY
                } else {
                    strength_of(&self.spec, body, b)
                };
            }
        }
        drop(log);
        self.set_up_screen(body);
    }

    /// Writes the steps since the last check as first integer, then the log.
    pub(crate) fn save(&self) -> Record<f64> {
        let mut out = Record::default();
        out.integers.push(self.wait as u64);
        locked(&self.log).save(&mut out);
        out
    }

    /// Restores what [`Self::save`] wrote; returns `false` for a record of another model. [`Self::now`] then
    /// lists the broken bonds, which the caller must remove.
    pub(crate) fn restore(
        &mut self,
        mut from: Record<f64>,
        body: &BondedParticles,
        inside: impl Fn(usize) -> bool,
    ) -> bool {
        if from.integers.is_empty() {
            return false;
        }
        self.wait = from.integers.remove(0) as usize;
        let parts = self.parts.take();
        let restored = match &parts {
            Some(parts) => parts.restore(&self.log, &from, body, inside),
            None => writing(&self.log).restore(&from, &|bond, ends| {
                let b = bond as usize;
                let known = body.pairs().get(b)?.map(u64::from) == ends;
                known.then(|| (middle(body, b), inside(b)))
            }),
        };
        self.parts = parts;
        if !restored {
            return false;
        }
        let log = locked(&self.log);
        let broken = (0..body.pairs().len()).filter(|b| log.is_broken_here(*b));
        let broken: Vec<u32> = broken.map(|b| b as u32).collect();
        drop(log);
        self.make_unbreakable(&broken);
        self.now = broken;
        true
    }

    fn strain(body: &BondedParticles, reader: &Reader<'_>, b: usize) -> Strain {
        let [i, j] = body.pairs()[b].map(|i| i as usize);
        let bond = body.bond(b);
        match reader.poses([i, j]) {
            Some([a, b]) => Strain::finite(&bond, &a, &b),
            None => Strain::linear(&bond, &reader.twist(i), &reader.twist(j)),
        }
    }

    /// Load of a bond over its strength \[–\].
    #[inline]
    pub(crate) fn ratio(&self, body: &BondedParticles, reader: &Reader<'_>, b: usize) -> f64 {
        let strain = Self::strain(body, reader, b);
        self.spec.criterion.value(&self.section, &strain) / self.strength[b]
    }

    /// Local number of a bond of the whole body, if this rank has it.
    pub(crate) fn local_bond(&self, bond: u32) -> Option<usize> {
        let parts = self.parts.as_ref();
        parts.map_or(Some(bond as usize), |p| p.local_bond(bond))
    }

    /// Largest load over strength of all whole bonds, and the number of bonds at or above one. In a
    /// partitioned body, counts the bonds whose first particle this rank owns.
    pub(crate) fn peak(&self, body: &BondedParticles, reader: &Reader<'_>) -> (f64, usize) {
        let is_owned = |b: &usize| (body.pairs()[*b][0] as usize) < self.owned;
        let bonds = (0..body.pairs().len()).filter(is_owned);
        bonds.fold((0.0, 0), |(top, count), b| {
            let r = self.ratio(body, reader, b);
            (f64::max(top, r), count + usize::from(r >= 1.0))
        })
    }

    /// Fills [`Self::now`] with the bonds that reach their strength, in ascending order. Returns whether
    /// bonds were checked in this step.
    ///
    /// If the force kernel has screened the current positions, only the bonds of marked blocks are compared.
    pub(crate) fn find(&mut self, body: &BondedParticles, reader: &Reader<'_>) -> bool {
        self.now.clear();
        self.wait += 1;
        if self.wait < self.spec.every {
            return false;
        }
        self.wait = 0;
        writing(&self.log).checked();
        let mut suspects = std::mem::take(&mut self.suspects);
        if std::mem::take(&mut self.fresh) {
            self.suspect(&mut suspects);
            self.compare(body, reader, suspects.len(), |k| suspects[k] as usize);
        } else {
            self.compare(body, reader, body.pairs().len(), |k| k);
        }
        self.suspects = suspects;
        true
    }

    /// Lists the bonds of marked blocks, each once, in ascending order.
    fn suspect(&self, suspects: &mut Vec<u32>) {
        suspects.clear();
        for block in (0..self.marks.len()).filter(|b| self.marks[*b]) {
            for i in block * LANES..((block + 1) * LANES).min(self.owned) {
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

    /// Compares `count` bonds; the `k`-th of them is `bond(k)`.
    fn compare(
        &mut self,
        body: &BondedParticles,
        reader: &Reader<'_>,
        count: usize,
        bond: impl Fn(usize) -> usize + Sync,
    ) {
        let (mut flags, mut now) = (std::mem::take(&mut self.flags), std::mem::take(&mut self.now));
        let range = |c: usize| c * CHUNK..((c + 1) * CHUNK).min(count);
        let breaks = |k: &usize| self.ratio(body, reader, bond(*k)) >= 1.0;
        let look = |(c, flag): (usize, &mut bool)| *flag = range(c).any(|k| breaks(&k));
        let chunks = &mut flags[..count.div_ceil(CHUNK)];
        // Threads only flag chunks: the list of breaks is then filled in one order, whatever their number.
        if count > LARGE && rayon::current_num_threads() > 1 {
            chunks.par_iter_mut().enumerate().for_each(look);
        } else {
            chunks.iter_mut().enumerate().for_each(look);
        }
        for c in (0..count.div_ceil(CHUNK)).filter(|c| flags[*c]) {
            now.extend(range(c).filter(breaks).map(|k| bond(k) as u32));
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
        if !parts.any_breaks(&self.now)? {
            return Ok(false);
        }
        // A bond may break by the moment at an end that another rank owns and screened.
        let cross = parts.cross().iter().copied();
        let missed = cross.filter(|b| self.ratio(body, reader, *b as usize) >= 1.0);
        let missed: Vec<u32> = missed.collect();
        self.now.extend(missed);
        self.now.sort_unstable();
        self.now.dedup();
        Ok(true)
    }

    /// Removes the bonds of [`Self::now`] from the balance of the owned particles and logs the breaks of the
    /// whole body. Returns the energy of all breaks \[J\]. `parts` is that of a partitioned body. Collective.
    pub(crate) fn release(
        &mut self,
        body: &BondedParticles,
        step: &mut Evolution<'_, f64>,
        readers: [&Reader<'_>; 2],
        mut parts: Option<&mut Parts>,
        inside: impl Fn(usize) -> bool,
    ) -> arlequin_core::Result<f64> {
        let (ghosts, changes) = match &mut parts {
            Some(parts) => parts.receive_ghosts(readers[0], step)?,
            None => GhostStates::default(),
        };
        let before = Reader {
            ghosts: &ghosts,
            ..*readers[0]
        };
        let mut breaks = Vec::new();
        for k in 0..self.now.len() {
            let b = self.now[k] as usize;
            let change_of = |i: usize| match i.checked_sub(self.owned) {
                None => change(step, i),
                Some(ghost) => changes[ghost],
            };
            let (event, held) = self.break_of(body, b, [&before, readers[1]], &change_of);
            // The rank that owns the first particle reports the break, so that it is logged once.
            if (event.pair[0] as usize) < self.owned {
                let (time, overlap) = (step.time, inside(b));
                breaks.push(Break {
                    time,
                    overlap,
                    ..event
                });
            }
            self.remove_bond(body, b, &held, step);
        }
        if let Some(parts) = parts {
            breaks = parts.gather_breaks(&breaks, step.time)?;
        }
        let mut log = writing(&self.log);
        let mut total = 0.0;
        for event in breaks {
            total += event.released;
            log.push(event);
        }
        Ok(total)
    }

    /// Returns the record of a break, without time and overlap, and the forces of the bond one step before.
    /// `change` returns the change of a particle's unknowns over the step.
    pub(super) fn break_of(
        &self,
        body: &BondedParticles,
        bond: usize,
        readers: [&Reader<'_>; 2],
        change: &dyn Fn(usize) -> [f64; 6],
    ) -> (Break, [Twist; 2]) {
        let pair = body.pairs()[bond];
        let ends = pair.map(|i| i as usize);
        let [(e0, g0), (e1, g1)] = readers.map(|r| r.bond(body, bond));
        let mut work = 0.0;
        for (end, i) in ends.into_iter().enumerate() {
            let difference = Twist {
                linear: g1[end].linear - g0[end].linear,
                angular: g1[end].angular - g0[end].angular,
            };
            let dq = change(i);
            for c in 0..3 {
                work += dq[c] * difference.linear[c] + dq[3 + c] * difference.angular[c];
            }
        }
        let now = |i: usize| body.positions()[i] + readers[1].twist(i).linear;
        let event = Break {
            time: 0.0,
            bond: bond as u32,
            pair,
            // The bond's share of the conserved energy: mean of both instants and work of the force
            // difference.
            released: 0.5 * (e0 + e1) + 0.25 * work,
            distance: (now(ends[1]) - now(ends[0])).norm(),
            place: middle(body, bond),
            overlap: false,
            mode: self
                .spec
                .criterion
                .mode(&self.section, &Self::strain(body, readers[1], bond)),
        };
        (event, g0)
    }

    /// Removes a bond and its forces one step before from the balance of the owned particles.
    pub(super) fn remove_bond(
        &mut self,
        body: &BondedParticles,
        bond: usize,
        held: &[Twist; 2],
        step: &mut Evolution<'_, f64>,
    ) {
        let half = step.q.len() / 2;
        for (i, held) in body.pairs()[bond].into_iter().zip(held) {
            let i = i as usize;
            for c in (0..3).filter(|_| i < self.owned) {
                step.f_before[3 * i + c] -= held.linear[c];
                step.f_before[half + 3 * i + c] -= held.angular[c];
            }
        }
        self.strength[bond] = f64::INFINITY;
    }

    /// Makes bonds unbreakable because they are broken already.
    pub(super) fn make_unbreakable(&mut self, bonds: &[u32]) {
        bonds
            .iter()
            .for_each(|b| self.strength[*b as usize] = f64::INFINITY);
    }

    pub(super) fn is_plain(&self) -> bool {
        self.plainly
    }
}

/// Change over the step of the unknowns of an owned particle.
pub(super) fn change(step: &Evolution<'_, f64>, i: usize) -> [f64; 6] {
    let half = step.q.len() / 2;
    let index = |c: usize| if c < 3 { 3 * i + c } else { half + 3 * i + c - 3 };
    std::array::from_fn(|c| step.q[index(c)] - step.q_before[index(c)])
}

/// Middle of a bond in the reference configuration \[m\].
pub(super) fn middle(body: &BondedParticles, b: usize) -> Vector3<f64> {
    let [i, j] = body.pairs()[b].map(|i| body.positions()[i as usize]);
    (i + j) * 0.5
}

fn strength_of(spec: &Fracture, body: &BondedParticles, b: usize) -> f64 {
    let [i, j] = body.pairs()[b].map(|i| &body.positions()[i as usize]);
    spec.strength * spec.scatter.factor(spec.seed, i, j)
}
