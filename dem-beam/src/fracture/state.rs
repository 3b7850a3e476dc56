//! Breaking of the bonds of one model.

use super::criterion::{Section, Strain, Strains};
use super::particles::ParticleStrengths;
use super::parts::{GhostStates, Parts};
use super::search::CHUNK;
use super::softening::{Loss, Softening};
use super::{Break, Fracture, SharedLog, locked, writing};
use crate::bond::Twist;
use crate::kernel::engine::Marks;
use crate::kernel::lanes::{LANES, Lanes};
use crate::kernel::screen::Screen;
use crate::model::poses::Reader;
use crate::particles::BondedParticles;
use arlequin_core::Evolution;
use arlequin_core::adjacency::Adjacency;
use arlequin_core::snapshot::Record;
use nalgebra::Vector3;
use std::sync::Arc;

/// Strengths and working buffers of a model whose bonds can break.
#[derive(Debug)]
pub(crate) struct FractureState {
    pub(crate) spec: Fracture,
    pub(crate) log: SharedLog,
    /// Bonds of every particle.
    pub(crate) adjacency: Arc<Adjacency<[u32; 2]>>,
    section: Section,
    /// Strength of each bond; infinite for broken and spared bonds. Under a criterion of particles, only
    /// whether it is finite counts.
    pub(super) strength: Vec<f64>,
    /// Bonds that soften; the strength of a damaged bond is its largest load so far.
    pub(crate) softening: Option<Softening>,
    /// Strengths of the particles under a criterion of particles.
    pub(crate) particles: Option<ParticleStrengths>,
    pub(super) flags: Vec<bool>,
    /// Bonds that break in this step; see [`Self::find`].
    pub(crate) now: Vec<u32>,
    /// Losses of this step.
    losses: Vec<Loss>,
    /// Blocks with bonds that broke or softened in this step.
    pub(crate) changed: Vec<usize>,
    pub(super) wait: usize,
    /// Screen inside the force kernel; `None` if bonds must be compared one by one.
    screen: Option<Screen>,
    plainly: bool,
    /// First slot of each block in the kernel.
    first_slots: Vec<u32>,
    /// Marks of blocks in which a bond may have reached its strength.
    pub(super) marks: Vec<bool>,
    /// True if the marks belong to the current positions.
    pub(super) fresh: bool,
    /// Bonds, or particles, of marked blocks.
    pub(super) suspects: Vec<u32>,
    /// Number of owned particles; the others are ghosts.
    pub(super) owned: usize,
    /// Data about the whole body, if it is partitioned.
    pub(crate) parts: Option<Parts>,
}

impl FractureState {
    /// Returns the state of a body of particles of these volumes \[m³\].
    pub(crate) fn new(spec: Fracture, body: &BondedParticles, volumes: &[f64], log: SharedLog) -> Self {
        writing(&log).begin(body.pairs().len(), spec.dissipated.is_some());
        Self::with_owned(spec, body, volumes, log)
    }

    /// Like [`Self::new`]; only the particles that `volumes` has are owned.
    pub(super) fn with_owned(
        spec: Fracture,
        body: &BondedParticles,
        volumes: &[f64],
        log: SharedLog,
    ) -> Self {
        let (bonds, owned) = (body.pairs().len(), volumes.len());
        let blocks = owned.div_ceil(LANES);
        let mut out = Self {
            spec,
            log,
            adjacency: body.adjacency(),
            section: Section::new(body.rigidity()),
            strength: (0..bonds).map(|b| strength_of(&spec, body, b)).collect(),
            softening: Softening::new(&spec),
            particles: ParticleStrengths::new(&spec, body, volumes),
            flags: vec![false; bonds.max(owned).div_ceil(CHUNK)],
            // Room for the breaks of a usual step, since a step should not allocate.
            now: Vec::with_capacity(64),
            losses: Vec::with_capacity(64),
            changed: Vec::with_capacity(128),
            wait: 0,
            screen: None,
            plainly: false,
            first_slots: vec![0; blocks],
            marks: vec![false; blocks],
            fresh: false,
            // A bond is suspected once at most, so the list never grows in a step.
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
        // Infinite strengths of spared bonds are no limits of particles.
        let of_particles = [self.spec.strength];
        let strengths = match self.particles {
            Some(_) => &of_particles[..],
            None => &self.strength,
        };
        self.screen = Screen::new(self.spec.criterion, self.section, strengths, [least, most]);
        // Numbers slots as the kernel does: a block has as many as its particle with most bonds.
        let mut slots = 0;
        for (b, first) in self.first_slots.iter_mut().enumerate() {
            *first = slots;
            let particles = b * LANES..self.owned.min((b + 1) * LANES);
            slots += particles.map(|i| self.adjacency.row(i).len()).max().unwrap_or(0) as u32;
        }
        // One limit for all needs no memory traffic.
        if self.spec.has_own_limits() {
            self.screen = self.screen.take().map(|s| s.with_ratios(slots as usize));
            let blocks: Vec<usize> = (0..self.first_slots.len()).collect();
            self.follow(&blocks, body, &|_| true);
        }
    }

    /// Compares bond by bond from now on, without a screen.
    pub(crate) fn check_plainly(&mut self) {
        self.plainly = true;
        self.screen = None;
    }

    /// Writes the limits of the bonds of `blocks` in the order in which the kernel stores them. Bonds for
    /// which `whole` is false are left out.
    pub(crate) fn follow(&mut self, blocks: &[usize], body: &BondedParticles, whole: &dyn Fn(usize) -> bool) {
        let Some(screen) = &mut self.screen else { return };
        for &block in blocks {
            let first = self.first_slots[block] as usize;
            let particles = block * LANES..((block + 1) * LANES).min(self.owned);
            for (lane, i) in particles.enumerate() {
                let bonds = self.adjacency.row(i);
                let whole_bonds = bonds.iter().map(|e| e.map(|k| k as usize));
                let limit = |e: [usize; 2]| match &self.particles {
                    Some(particles) => particles.half_bond(i, e, body),
                    None => self.strength[e[1]],
                };
                let strengths = whole_bonds
                    .filter(|e| whole(e[1]))
                    .map(limit)
                    // Slots of bonds that are left out are empty in the kernel: an infinite limit is never
                    // reached.
                    .chain(std::iter::repeat(f64::INFINITY));
                for (slot, strength) in strengths.take(bonds.len()).enumerate() {
                    screen.set(first + slot, lane, strength);
                }
            }
        }
    }

    /// Load of a bond over its strength \[–\], also if it sleeps or is spared: see
    /// [`arlequin_core::Breakable`].
    pub(crate) fn utilisation(&self, body: &BondedParticles, reader: &Reader<'_>, b: usize) -> f64 {
        let strain = Self::strain(body, reader, b);
        let load = self.spec.criterion.value(&self.section, &strain);
        let ratio = load / strength_of(&self.spec, body, b);
        // Energies grow with the square of the displacements.
        if self.spec.criterion.is_energy() {
            ratio.max(0.0).sqrt()
        } else {
            ratio
        }
    }

    /// Returns the screen and the marks for the force kernel if bonds are checked in this step.
    pub(crate) fn marks(&mut self) -> Option<Marks<'_>> {
        // `wait` counts the steps since the last check and is raised in `find`, after the forces.
        self.fresh = self.screen.is_some() && self.wait + 1 >= self.spec.every;
        let screen = self.screen.as_ref().filter(|_| self.fresh)?;
        Some((screen, &mut self.marks))
    }

    /// Follows new weights: makes whole bonds for which `inside` is true unbreakable and the others
    /// breakable, if the specification spares overlaps.
    pub(crate) fn spare(&mut self, body: &BondedParticles, inside: impl Fn(usize) -> bool) {
        let awake = body.awake();
        let sleeps = !Arc::ptr_eq(&awake, &body.adjacency());
        if self.spec.spare_overlap || sleeps {
            let inside = |b: usize| self.spec.spare_overlap && inside(b) || body.is_asleep(b);
            let log = locked(&self.log);
            for (b, strength) in self.strength.iter_mut().enumerate() {
                // Broken bonds keep their infinite strength.
                if !log.is_broken_here(b) {
                    let damaged = log.damage_here(b).map(|d| d.load);
                    *strength = if inside(b) {
                        f64::INFINITY
                    } else {
                        damaged.unwrap_or_else(|| strength_of(&self.spec, body, b))
                    };
                }
            }
        }
        // Bonds without weight have no part in the stress of a particle.
        if self.spec.spare_overlap || self.particles.is_some() || sleeps {
            // The kernel has the same rows, and the screen follows its slots.
            self.adjacency = awake;
            self.set_up_screen(body);
        }
    }

    /// Writes the steps since the last check as first integer, then damage and log.
    pub(crate) fn save(&self) -> Record<f64> {
        let mut out = Record::default();
        out.integers.push(self.wait as u64);
        let log = locked(&self.log);
        log.save_damages(&mut out);
        log.save(&mut out);
        out
    }

    /// Restores what [`Self::save`] wrote; returns `false` for a record of another model. [`Self::now`] then
    /// lists the broken bonds, which the caller must remove, and [`Softening::now`] the damaged ones.
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
        let Some(damages) = locked(&self.log).read_damages(&mut from) else {
            return false;
        };
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
        writing(&self.log).restore_damages(damages);
        let log = locked(&self.log);
        let broken = (0..body.pairs().len()).filter(|b| log.is_broken_here(*b));
        let broken: Vec<u32> = broken.map(|b| b as u32).collect();
        drop(log);
        self.make_unbreakable(&broken);
        self.now = broken;
        self.follow_damage();
        true
    }

    pub(super) fn strain(body: &BondedParticles, reader: &Reader<'_>, b: usize) -> Strain {
        let [i, j] = body.pairs()[b].map(|i| i as usize);
        let bond = body.bond(b);
        match reader.poses([i, j]) {
            Some([a, b]) => Strain::finite(&bond, &a, &b),
            None => Strain::linear(&bond, &reader.twist(i), &reader.twist(j)),
        }
    }

    /// Load of a bond over its strength \[–\] under a criterion of bonds.
    #[inline]
    pub(crate) fn ratio(&self, body: &BondedParticles, reader: &Reader<'_>, b: usize) -> f64 {
        self.ratio_of(b, &Self::strain(body, reader, b))
    }

    /// Load over strength of a bond in a state of strain \[–\], like [`Self::ratio`].
    #[inline]
    pub(crate) fn ratio_of(&self, b: usize, strain: &Strain) -> f64 {
        self.spec.criterion.value(&self.section, strain) / self.strength[b]
    }

    /// Loads over strength of up to eight consecutive bonds from `first` on, with the bits of
    /// [`Self::ratio_of`].
    #[inline(always)]
    pub(crate) fn ratios<L: Lanes>(&self, l: L, first: usize, strains: &Strains<L>) -> [f64; LANES] {
        let mut strengths = [1.0; LANES];
        let known = self.strength[first..].iter().zip(&mut strengths);
        known.for_each(|(strength, to)| *to = *strength);
        match self.spec.criterion.values(l, &self.section, strains) {
            Some(loads) => l.store(l.div(loads, l.load(&strengths))),
            None => std::array::from_fn(|k| {
                self.spec.criterion.value(&self.section, &strains.lane(l, k)) / strengths[k]
            }),
        }
    }

    /// Local number of a bond of the whole body, if this rank has it.
    pub(crate) fn local_bond(&self, bond: u32) -> Option<usize> {
        let parts = self.parts.as_ref();
        parts.map_or(Some(bond as usize), |p| p.local_bond(bond))
    }

    /// Removes what the bonds of [`Self::now`] lose from the balance of the owned particles and logs the
    /// losses of the whole body; only broken bonds then stay in the list. Returns the energy of all losses
    /// \[J\]. `parts` is that of a partitioned body. Collective.
    pub(crate) fn release(
        &mut self,
        body: &BondedParticles,
        step: &mut Evolution<'_, f64>,
        readers: [&Reader<'_>; 2],
        mut parts: Option<&mut Parts>,
        inside: impl Fn(usize) -> bool,
    ) -> arlequin_core::Result<f64> {
        // The energy of a bond needs both ends at both instants, and one end may be a ghost.
        let (ghosts, changes) = match &mut parts {
            Some(parts) => parts.receive_ghosts(readers[0], step)?,
            None => GhostStates::default(),
        };
        let before = Reader {
            ghosts: &ghosts,
            ..*readers[0]
        };
        let mut losses = std::mem::take(&mut self.losses);
        losses.clear();
        for k in 0..self.now.len() {
            let b = self.now[k] as usize;
            let change_of = |i: usize| match i.checked_sub(self.owned) {
                None => change(step, i),
                Some(ghost) => changes[ghost],
            };
            let (event, held) = self.break_of(body, b, [&before, readers[1]], &change_of);
            let load = match self.softening {
                Some(_) => self.ratio(body, readers[1], b) * self.strength[b],
                None => 0.0,
            };
            let Some((lost, damage)) = self.weaken(body, b, load) else {
                continue;
            };
            self.subtract(body, b, &held, lost, step);
            // The rank that owns the first particle reports the loss, so that it is logged once.
            if (event.pair[0] as usize) < self.owned {
                let (time, overlap, released) = (step.time, inside(b), lost * event.released);
                let event = Break {
                    time,
                    overlap,
                    released,
                    ..event
                };
                losses.push(Loss { event, damage });
            }
        }
        let strength = &self.strength;
        self.now.retain(|b| strength[*b as usize].is_infinite());
        if let Some(parts) = parts {
            losses = parts.gather_losses(&losses, step.time)?;
        }
        let mut log = writing(&self.log);
        let mut total = 0.0;
        for loss in &losses {
            total += loss.event.released;
            log.lose(*loss);
        }
        drop(log);
        self.losses = losses;
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

    /// Removes a share of the forces that a bond had one step before from the balance of the owned particles.
    fn subtract(
        &self,
        body: &BondedParticles,
        bond: usize,
        held: &[Twist; 2],
        share: f64,
        step: &mut Evolution<'_, f64>,
    ) {
        let half = step.q.len() / 2;
        for (i, held) in body.pairs()[bond].into_iter().zip(held) {
            let i = i as usize;
            for c in (0..3).filter(|_| i < self.owned) {
                step.f_before[3 * i + c] -= share * held.linear[c];
                step.f_before[half + 3 * i + c] -= share * held.angular[c];
            }
        }
    }

    /// Strength of a bond without damage.
    pub(super) fn first_strength(&self, body: &BondedParticles, bond: usize) -> f64 {
        strength_of(&self.spec, body, bond)
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
    let factor = spec.scatter.factor(spec.seed, i, j);
    // The scatter of beams that soften is that of their stress at the peak, and energies are squares of
    // stresses.
    spec.strength
        * match spec.dissipated {
            Some(_) => factor * factor,
            None => factor,
        }
}
