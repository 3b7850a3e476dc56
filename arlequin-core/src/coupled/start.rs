//! A consistent start: displacements, velocities and accelerations on the constraint.

use super::ledger::DisplacementJump;
use super::{Coupled, pair};
use crate::interface::Interface;
use crate::subdomain::Subdomain;
use crate::{Error, Real, Result};

/// Largest jump of the initial displacements beside a solver whose displacements are its own, relative to the largest.
const GUEST_JUMP: f64 = 1e-6;

impl<T: Real> Coupled<T> {
    /// Projects `u_0` and `v_0` on the constraint once, weighted by the inertia, and starts with the half reflection that a
    /// constant acceleration needs, `δ_0 = −ΔT/2 P a_0`. A displacement jump would stay for ever, as the constraint is on
    /// velocities; without `δ_0` multipliers would flip their sign every step for ever.
    pub(super) fn start(&mut self) -> Result<()> {
        for s in &mut self.subdomains {
            s.hold(self.time);
        }
        for i in &mut self.interfaces {
            i.pace(self.dt);
            self.work
                .resize(self.work.len().max(i.multipliers().len()), T::zero());
            let [coarse, fine] = i.sides;
            close(i, pair(&mut self.subdomains, coarse, fine), &mut self.work)?;
        }
        let time = self.time;
        for s in &mut self.subdomains {
            s.start(time)?;
        }
        for g in 0..self.lockstep.len() {
            self.add_pair_forces(g, |s| s.at_start(time), &mut |_| {})?;
        }
        let before: T = self.subdomains.iter().map(Subdomain::kinetic_energy).sum();
        let half = self.dt * T::of(0.5);
        for i in &mut self.interfaces {
            let [coarse, fine] = i.sides;
            let [c, d] = pair(&mut self.subdomains, coarse, fine);
            i.reflect([&mut *c, &mut *d].map(Subdomain::velocities));
            i.find([&c.state().a, &d.state().a], half);
        }
        for (k, s) in self.subdomains.iter_mut().enumerate() {
            let mine = |i: &Interface<T>| i.sides.iter().position(|s| *s == k);
            let touching = self.interfaces.iter().filter_map(|i| Some((i, mine(i)?)));
            s.hand_over_start(&touching.collect::<Vec<_>>())?;
        }
        self.start_loss = before - self.subdomains.iter().map(Subdomain::kinetic_energy).sum();
        self.find_bodies();
        self.ledger.jumps = vec![DisplacementJump::default(); self.interfaces.len()];
        self.displaced = self.largest_strain_energy();
        Ok(())
    }

    /// Most strain energy that displacements of the present size can hold, `½ ω² Σ m q²` with the highest frequency.
    fn largest_strain_energy(&self) -> T {
        let all = self.subdomains.iter().zip(&self.critical);
        all.map(|(s, critical)| {
            let moving = 0..s.model().layout().translations();
            let terms = s.inertia()[moving.clone()].iter().zip(&s.state().q[moving]);
            let sum: T = terms.map(|(m, q)| *m * *q * *q).sum();
            // ω = 2/Δt_c
            sum * T::of(2.0) / (*critical * *critical)
        })
        .sum()
    }
}

/// Removes the jump of the initial displacements and reports it.
fn close<T: Real>(i: &mut Interface<T>, [c, d]: [&mut Subdomain<T>; 2], work: &mut Vec<T>) -> Result<()> {
    let jump = i.jump([&c.state().q, &d.state().q], work);
    let largest = [&*c, &*d].map(|s| {
        let q = &s.state().q[..s.model().layout().translations()];
        q.iter().fold(T::zero(), |m, x| m.max(x.abs()))
    });
    let largest = largest[0].max(largest[1]);
    i.report.start_jump = jump.as_f64();
    if jump <= T::zero() {
        return Ok(());
    }
    // What the core cannot move must agree from the start.
    let movable = !(c.is_guest() || d.is_guest());
    let limit = if movable {
        i.start_jump
    } else {
        i.start_jump.min(T::of(GUEST_JUMP))
    };
    if jump > largest * limit {
        return Err(Error::InitialJump {
            interface: i.report.name.clone(),
            jump: jump.as_f64(),
            largest: largest.as_f64(),
            limit: limit.as_f64(),
        });
    }
    if !movable {
        return Ok(());
    }
    let [c, d] = [c, d].map(Subdomain::displacements);
    let before = [c.to_vec(), d.to_vec()];
    i.reflect([&mut *c, &mut *d]);
    let moved = |now: &[T], before: &[T]| {
        let all = now.iter().zip(before);
        all.fold(T::zero(), |m, (a, b)| m.max((*a - *b).abs()))
    };
    let moved = moved(c, &before[0]).max(moved(d, &before[1]));
    i.report.start_moved = moved.as_f64();
    Ok(())
}
