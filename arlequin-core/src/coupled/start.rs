//! A consistent start: displacements, velocities and accelerations on the constraint.

use super::{Coupled, pair};
use crate::interface::Interface;
use crate::subdomain::{Reached, Subdomain};
use crate::{Error, Real, Result};

impl<T: Real> Coupled<T> {
    /// Projects `u_0`, `v_0` and `a_0` on the constraint once, all weighted by the inertia. A displacement jump would stay
    /// for ever, as the constraint is on velocities; one of the acceleration would flip its sign every step for ever.
    pub(super) fn start(&mut self) -> Result<()> {
        for s in &mut self.subdomains {
            s.hold(self.time, self.dt);
        }
        for i in &mut self.interfaces {
            self.work
                .resize(self.work.len().max(i.multipliers().len()), T::zero());
            let [coarse, fine] = i.sides;
            close(i, pair(&mut self.subdomains, coarse, fine), &mut self.work)?;
        }
        let start = Reached {
            time: self.time,
            since: T::zero(),
            dt: self.dt,
        };
        for s in &mut self.subdomains {
            s.start(start)?;
        }
        if !self.pairs.is_empty() {
            self.add_pair_forces(start, &mut |_| {})?;
        }
        let before: T = self.subdomains.iter().map(Subdomain::kinetic_energy).sum();
        for i in &mut self.interfaces {
            let [coarse, fine] = i.sides;
            let [(c, _), (d, _)] = pair(&mut self.subdomains, coarse, fine).map(Subdomain::correctable);
            i.pace(self.dt);
            i.reflect([&mut c.v, &mut d.v]);
            i.reflect([&mut c.a, &mut d.a]);
        }
        self.start_loss = before - self.subdomains.iter().map(Subdomain::kinetic_energy).sum();
        self.find_bodies();
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
    let (_, jump) = i.jump([&c.state().q, &d.state().q], work);
    let largest = [&*c, &*d].map(|s| {
        let q = &s.state().q[..s.model().layout().translations()];
        q.iter().fold(T::zero(), |m, x| m.max(x.abs()))
    });
    let largest = largest[0].max(largest[1]);
    i.report.start_jump = jump.as_f64();
    if jump <= T::zero() {
        return Ok(());
    }
    if jump > largest * i.start_jump {
        return Err(Error::InitialJump {
            interface: i.report.name.clone(),
            jump: jump.as_f64(),
            largest: largest.as_f64(),
            limit: i.start_jump.as_f64(),
        });
    }
    let [(c, _), (d, _)] = [c, d].map(Subdomain::correctable);
    let before = [c.q.clone(), d.q.clone()];
    i.reflect([&mut c.q, &mut d.q]);
    let moved = |now: &[T], before: &[T]| {
        let all = now.iter().zip(before);
        all.fold(T::zero(), |m, (a, b)| m.max((*a - *b).abs()))
    };
    let moved = moved(&c.q, &before[0]).max(moved(&d.q, &before[1]));
    i.report.start_moved = moved.as_f64();
    Ok(())
}
