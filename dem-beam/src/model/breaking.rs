//! Bonds that break: fracture of a model, its saved state and its results.

use super::DemModel;
use super::poses::Reader;
use crate::error::{Error, Result};
use crate::fracture::parts::Parts;
use crate::fracture::state::FractureState;
use crate::fracture::{Fracture, SharedLog, locked};
use crate::kernel::lanes::LANES;
use arlequin_core::snapshot::Record;
use arlequin_core::{Evolution, Model};
use rayon::prelude::*;

impl DemModel {
    /// Lets the bonds of the body break.
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] for a strength, scatter or interval that makes no sense;
    /// [`crate::Error::Graded`].
    pub fn with_fracture(mut self, spec: Fracture) -> Result<Self> {
        spec.check()?;
        self.require_one_material("a strength of bonds")?;
        self.fracture = Some(self.breaking(spec, self.log.clone()));
        Ok(self)
    }

    /// Compares bonds with their strengths when [`arlequin_core::Watching::watch`] is called; nothing breaks.
    ///
    /// # Errors
    /// Errors of [`Self::with_fracture`].
    pub fn with_watched_strength(mut self, spec: Fracture) -> Result<Self> {
        spec.check()?;
        self.require_one_material("a strength of bonds")?;
        self.watched = Some(self.breaking(spec, SharedLog::default()));
        Ok(self)
    }

    /// Returns the fracture state of the body, or of a rank's part of it, with all bonds unbroken.
    fn breaking(&self, spec: Fracture, log: SharedLog) -> FractureState {
        let volumes = self.volumes();
        match self.halo.as_ref().zip(self.numbered.as_ref()) {
            Some(part) => FractureState::new_in_part(spec, (&self.body, &volumes), log, part),
            None => FractureState::new(spec, &self.body, &volumes, log),
        }
    }

    /// Refuses `what` if the bonds are of several materials.
    fn require_one_material(&self, what: &'static str) -> Result<()> {
        match self.body.is_graded() {
            true => Err(Error::Graded { what }),
            false => Ok(()),
        }
    }

    /// Returns the largest ratio of criterion to strength among the bonds in the state `q`; zero without
    /// fracture.
    pub(crate) fn load(&self, q: &[f64]) -> f64 {
        let peak = |f: &FractureState| f.peak(&self.body, &self.reader(q)).0;
        self.fracture.as_ref().map_or(0.0, peak)
    }

    /// Makes the bonds of an overlap unbreakable if the fracture model asks for it. To be called when weights
    /// change.
    pub(super) fn spare_overlap(&mut self) {
        // Taken out while the closure reads `self`.
        let (mut fracture, mut watched) = (self.fracture.take(), self.watched.take());
        for f in [&mut fracture, &mut watched].into_iter().flatten() {
            f.spare(&self.body, |b| self.in_overlap(b));
        }
        (self.fracture, self.watched) = (fracture, watched);
    }

    /// Lets bonds without weight sleep: the kernel leaves them out, and they do not break. Returns whether
    /// the strengths are those of bonds; particles have the stress of all their bonds.
    pub(super) fn let_bonds_sleep(&mut self) -> bool {
        if self
            .fracture
            .iter()
            .chain(&self.watched)
            .any(|f| f.particles.is_some())
        {
            return false;
        }
        // Once: a new kernel forgets orientations.
        if self.body.has_sleep() {
            return true;
        }
        self.body.sleep();
        self.spare_overlap();
        self.kernel.renew();
        true
    }

    /// See [`arlequin_core::Breakable::utilisations`].
    pub(super) fn utilisations_of(&self, q: &[f64], bonds: &[u32]) -> Vec<f64> {
        let Some(fracture) = &self.fracture else {
            return vec![0.0; bonds.len()];
        };
        let (log, reader) = (locked(&self.log), self.reader(q));
        let of_bond = |b: &u32| match log.is_broken_here(*b as usize) {
            true => 0.0,
            false => fracture.utilisation(&self.body, &reader, *b as usize),
        };
        bonds.par_iter().map(of_bond).collect()
    }

    /// Compares bonds with their strengths one by one instead of in the force kernel: the slower reference
    /// for tests, with the same breaks.
    #[must_use]
    pub fn with_plain_checks(mut self) -> Self {
        if let Some(f) = &mut self.fracture {
            f.check_plainly();
        }
        self
    }

    /// Number of bonds that were to soften but break at once, as their scattered peak holds at least the
    /// energy that a bond takes to fail; they release the energy of their peak, which is more.
    #[must_use]
    pub fn snapping_bonds(&self) -> usize {
        self.fracture.as_ref().map_or(0, |f| f.snapping(&self.body))
    }

    /// Returns the log of broken bonds, which stays up to date during a run.
    #[must_use]
    pub fn break_log(&self) -> SharedLog {
        self.log.clone()
    }

    pub(super) fn break_bonds(&mut self, mut step: Evolution<'_, f64>) -> arlequin_core::Result<f64> {
        let Some(mut fracture) = self.fracture.take() else {
            return Ok(0.0);
        };
        let mut parts = fracture.parts.take();
        let released = self.release_broken(&mut fracture, parts.as_mut(), &mut step);
        fracture.parts = parts;
        let softened = fracture.softening.as_ref().is_some_and(|s| !s.now.is_empty());
        if softened || !fracture.now.is_empty() {
            self.sever(&mut fracture);
            let kernel = self.kernel.get_or_build(&self.body, self.halo.as_ref());
            // The forces of this step still contain what the bonds lost in it.
            kernel.recompute(&fracture.changed, step.f);
        }
        self.fracture = Some(fracture);
        released
    }

    /// Finds the bonds that break now and returns the energy released on all ranks. `parts` is that of a
    /// partitioned body. Collective.
    fn release_broken(
        &self,
        fracture: &mut FractureState,
        mut parts: Option<&mut Parts>,
        step: &mut Evolution<'_, f64>,
    ) -> arlequin_core::Result<f64> {
        let mut ghosts = Vec::new();
        if let Some(parts) = &mut parts {
            ghosts = std::mem::take(&mut parts.ghosts);
            self.kernel.ghosts(&mut ghosts);
        }
        let now = Reader {
            ghosts: &ghosts,
            ..self.reader(step.q)
        };
        let readers = [&self.reader(step.q_before), &now];
        let released = match fracture.find_everywhere(&self.body, &now, parts.as_deref()) {
            Ok(true) => {
                let inside = |b: usize| self.in_overlap(b);
                fracture.release(&self.body, step, readers, parts.as_deref_mut(), inside)
            }
            Ok(false) => Ok(0.0),
            Err(e) => Err(e),
        };
        if let Some(parts) = parts {
            // The buffer stays with the parts, so that a step does not allocate.
            parts.ghosts = ghosts;
        }
        released
    }

    /// Restricts the fracture state to a rank's part of the body and removes the bonds already broken.
    pub(super) fn break_apart(&mut self) {
        let Some(place) = self.halo.as_ref().zip(self.numbered.as_ref()) else {
            return;
        };
        let volumes = self.volumes();
        let part = |state: FractureState| state.part((&self.body, &volumes), place);
        self.watched = self.watched.take().map(part);
        self.fracture = self.fracture.take().map(part);
        self.spare_overlap();
        if let Some(mut fracture) = self.fracture.take() {
            self.sever(&mut fracture);
            self.fracture = Some(fracture);
        }
    }

    /// Removes the bonds that break now, and the stiffness that others lose now, from body and kernel.
    /// [`FractureState::changed`] then lists the blocks that hold them, ascending.
    fn sever(&mut self, fracture: &mut FractureState) {
        // Taken out while other parts of the state are read; the buffer stays, so that a step does not
        // allocate.
        let mut blocks = std::mem::take(&mut fracture.changed);
        blocks.clear();
        let mut change = |bond: usize| {
            let owned = self.body.pairs()[bond].into_iter().map(|i| i as usize);
            let owned = owned.filter(|i| *i < self.centres().len());
            blocks.extend(owned.map(|i| i / LANES));
        };
        fracture.now.iter().for_each(|b| change(*b as usize));
        let softened = || fracture.softening.iter().flat_map(|s| &s.now);
        softened().for_each(|(b, _)| change(*b as usize));
        fracture.now.iter().for_each(|b| self.body.sever(*b as usize));
        softened().for_each(|(b, left)| self.body.soften(*b as usize, *left));
        // Two bonds often share a block, which is rebuilt once.
        blocks.sort_unstable();
        blocks.dedup();
        let log = locked(&self.log);
        let (body, is_unbroken) = (&self.body, |b: usize| !log.is_broken_here(b));
        let kernel = self.kernel.get_or_build(body, self.halo.as_ref());
        kernel.refresh(&blocks, body, &fracture.adjacency, &is_unbroken);
        fracture.follow(&blocks, body, &is_unbroken);
        fracture.changed = blocks;
    }

    /// Returns the record of broken bonds, then the orientations under finite rotations.
    pub(super) fn remember(&self) -> Record<f64> {
        let mut out = self
            .fracture
            .as_ref()
            .map(FractureState::save)
            .unwrap_or_default();
        if self.has_finite_rotations() {
            let turns = self.kernel.save(self.centres().len());
            // Rank 0 saves the orientations of the whole body. The run reports an error between ranks.
            let turns = self.owned().gather(7, &turns).ok().flatten();
            out.numbers.extend(turns.iter().flat_map(|t| t.iter()));
        }
        out
    }

    /// Restores the state that [`Self::remember`] returned.
    pub(super) fn recall(&mut self, mut record: Record<f64>) -> arlequin_core::Result<()> {
        if self.has_finite_rotations() {
            let owned = self.owned();
            let particles = owned.nodes_of_whole();
            // Orientations are the last numbers of the record, seven per particle of the whole body.
            let breaks = record.numbers.len().saturating_sub(7 * particles);
            let mut turns = record.numbers.split_off(breaks);
            if turns.len() == 7 * particles {
                let numbers = (0..owned.nodes()).map(|i| owned.global(i));
                turns = numbers.flat_map(|i| turns[7 * i..7 * i + 7].to_vec()).collect();
            }
            let kernel = self.kernel.get_or_build(&self.body, self.halo.as_ref());
            if !kernel.restore(&turns) {
                return Err(self.foreign("the record of orientations"));
            }
        }
        self.restore_breaks(record)
    }

    fn foreign(&self, what: &'static str) -> arlequin_core::Error {
        arlequin_core::Error::of_model(&self.name, Error::ForeignRecord { what })
    }

    fn restore_breaks(&mut self, record: Record<f64>) -> arlequin_core::Result<()> {
        let Some(mut fracture) = self.fracture.take() else {
            return record.expect(&self.name, 0, 0);
        };
        let fits = fracture.restore(record, &self.body, |b| self.in_overlap(b));
        if fits {
            self.sever(&mut fracture);
        }
        self.fracture = Some(fracture);
        if fits {
            return Ok(());
        }
        Err(self.foreign("the record of broken bonds"))
    }

    pub(super) fn fracture_facts(&self) -> Vec<(String, f64)> {
        let Some(fracture) = &self.fracture else {
            return Vec::new();
        };
        let local = self.body.pairs().len();
        let bonds = fracture.parts.as_ref().map_or(local, |p| p.bonds);
        let log = locked(&self.log);
        let mut out = vec![
            ("broken bonds".into(), log.events().len() as f64),
            ("bonds".into(), bonds as f64),
            ("released energy [J]".into(), log.released()),
            ("checks of all bonds".into(), log.checks() as f64),
            (
                "first break [s]".into(),
                log.events().first().map_or(-1.0, |e| e.time),
            ),
        ];
        if fracture.softening.is_some() {
            out.push(("softened bonds".into(), log.softened() as f64));
        }
        out
    }
}
