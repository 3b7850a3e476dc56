//! Saved state of an obstacle. In a partitioned body every rank writes the same record, that of the whole
//! body.

use super::{Active, Body, allowed};
use crate::contact::{Sparse, Spring};
use arlequin_core::contact::RigidBody;
use arlequin_core::snapshot::Record;
use nalgebra::Vector3;

/// Number of values in a record that precede springs and closed contacts.
const BALANCE: usize = RigidBody::NUMBERS + 1;
/// Number of integers that precede the states of the contacts.
const FLAGS: usize = 5;
/// Number of values of a closed contact.
const PUSH: usize = 8;
/// Number of values of a spring.
const SPRING: usize = Spring::NUMBERS;

impl Body {
    /// Writes the state. Integers: flags (started, a step was made, order of the next step reversed), the
    /// numbers of particles whose allowed gap is renewed and of those that have gained weight, the state of
    /// each contact, these particles, the particle of each closed contact. Numbers: motion and energy
    /// balance, the springs, the renewed gaps, the closed contacts.
    pub(super) fn recorded(&self) -> Record<f64> {
        let mut out = Record::default();
        self.body.lock().save(self.share, &mut out);
        out.integers
            .extend([self.law.begun, self.backwards].map(u64::from));
        out.numbers.push(self.law.supplied);
        out.integers
            .extend([self.renewed.len(), self.gained.len()].map(|n| n as u64));
        let springs = self.all_springs();
        for s in (0..self.owned().0.nodes_of_whole()).map(|i| springs.get(i)) {
            out.integers.push(u64::from(s.closed));
            out.numbers.extend(s.numbers());
        }
        out.integers
            .extend(self.renewed.iter().chain(&self.gained).map(|i| u64::from(*i)));
        out.numbers
            .extend(self.renewed.iter().map(|i| self.allowed[*i as usize]));
        for a in &self.active {
            let gathered = self.partition.as_ref().map(|c| &c.gathered);
            let particle = gathered.map_or(a.particle, |c| c.ids[a.particle as usize]);
            out.integers.push(u64::from(particle));
            let vectors = [a.force, a.torque];
            out.numbers.extend(vectors.iter().flat_map(|v| v.iter()));
            out.numbers.extend([a.stored, a.expected]);
        }
        out
    }

    /// Restores what [`Self::recorded`] wrote.
    pub(super) fn recall(&mut self, from: &Record<f64>) -> arlequin_core::Result<()> {
        let n = self.owned().0.nodes_of_whole();
        let count = |k: usize| from.integers.get(k).map_or(0, |count| *count as usize);
        let [renewed, gained] = [3, 4].map(|k| count(k).min(n));
        let lists = FLAGS + n + renewed + gained;
        let pushes = from.integers.len().saturating_sub(lists);
        from.expect(
            &format!("obstacle '{}'", self.name),
            BALANCE + SPRING * n + renewed + PUSH * pushes,
            lists + pushes,
        )?;
        if let Some(motion) = from.numbers.first_chunk() {
            self.body.lock().restore(self.share, from.integers[0], motion);
        }
        [self.law.begun, self.backwards] = [1, 2].map(|k: usize| from.integers[k] == 1);
        self.law.supplied = from.numbers[RigidBody::NUMBERS];
        let (springs, numbers) = from.numbers[BALANCE..].split_at(SPRING * n);
        let (gaps, pushed) = numbers.split_at(renewed);
        let (closed, particles) = from.integers[FLAGS..].split_at(n);
        let (changed, particles) = particles.split_at(renewed + gained);
        let known = |i: &u64| u32::try_from(*i).ok().filter(|i| (*i as usize) < n);
        let changed: Vec<u32> = changed.iter().filter_map(known).collect();
        let (lifted, gaining) = changed.split_at(renewed.min(changed.len()));
        (self.renewed, self.gained) = (lifted.iter().copied().collect(), gaining.to_vec());
        // Gaps that a later state had renewed are those at rest again.
        self.allowed = allowed(self.body.lock().shape(), &self.grains.rest_spheres);
        for (i, gap) in lifted.iter().zip(gaps) {
            if let Some(allowed) = self.allowed.get_mut(*i as usize) {
                *allowed = *gap;
            }
        }
        let saved = closed.iter().zip(springs.as_chunks::<SPRING>().0);
        self.springs = Sparse::new(n);
        for (i, (_, x)) in saved.enumerate().filter(|(_, (closed, _))| **closed == 1) {
            *self.springs.get_mut(i) = Spring::from_numbers(true, *x);
        }
        self.active.clear();
        for (particle, x) in particles.iter().zip(pushed.as_chunks::<PUSH>().0) {
            if *particle >= n as u64 {
                return from.expect(
                    &format!("obstacle '{}'", self.name),
                    BALANCE + SPRING * n,
                    FLAGS + n,
                );
            }
            self.active.push(Active {
                particle: *particle as u32,
                force: Vector3::new(x[0], x[1], x[2]),
                torque: Vector3::new(x[3], x[4], x[5]),
                stored: x[6],
                expected: x[7],
            });
        }
        self.near.clear();
        self.restore_gathered();
        Ok(())
    }
}
