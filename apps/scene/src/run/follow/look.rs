//! A look at the bonds, which finds the elements that the zone should have.

use super::Follow;
use super::places::middle;
use crate::error::{Result, core};
use crate::run::quiet::Strain;
use crate::setup::{Bar, Share};
use arlequin::core::geometry::bounds_of;
use arlequin::core::nalgebra::{Matrix3, Vector3};
use arlequin::core::{Breakable, Coupled, Interpolation, ShapeRow, Subdomain};
use arlequin::dem_beam::fracture::locked;
use rayon::prelude::*;

/// Utilisation above which a bond needs elements of the zone around it.
const HOT: f64 = 0.8;
/// Elements beyond the margin that join in a change that is due.
pub(super) const AHEAD: usize = 3;
/// Least number of elements that join in a change, as a share of those that the zone has: the cost of a
/// change hardly depends on their number.
const JOIN: f64 = 0.1;
/// Share of the zone's elements that leave together at least.
const LEAVE: f64 = 0.05;
/// Share of `wake` above which elements join in a change that is due.
const SOON: f64 = 0.9;

/// Bonds with their utilisations \[–\].
type Loads = (Vec<u32>, Vec<f64>);

/// Findings of a look: the elements that the zone should have, the worst bond that slept, the most loaded
/// element that has no spheres, and what keeps the zone from where bonds are loaded.
pub(super) struct Look {
    pub(super) core: Vec<bool>,
    pub(super) late: Option<(Vector3<f64>, f64)>,
    pub(super) outside: Option<(usize, f64)>,
    pub(super) barred: Vec<Bar>,
}

impl Follow {
    /// Marks the elements in which a bond broke since the last look.
    fn mark_breaks(&mut self, hot: &mut [bool]) {
        let log = locked(&self.log);
        let events = log.events();
        debug_assert!(events.len() >= self.state.seen);
        for e in &events[self.state.seen.min(events.len())..] {
            hot[self.homes[1][e.bond as usize] as usize] = true;
        }
        self.state.seen = events.len();
    }

    /// Finds the most loaded element that has no spheres, if it is loaded like spheres at their strength.
    fn loaded_outside(&self, strains: &[Strain], loud: &[bool]) -> Option<(usize, f64)> {
        let mut out: Option<(usize, f64)> = None;
        for e in (0..loud.len()).filter(|e| !self.filled[*e]) {
            let u = self.quiet.typical(&strains[e]);
            if u >= 1.0 && out.is_none_or(|o| u > o.1) {
                out = Some((e, u));
            }
        }
        out
    }

    /// Utilisations of bonds of the zone, near to elements that these can bring along, in their own state;
    /// and of bonds that sleep in elements marked in `loud`, in the body's field. Each list has its bonds.
    fn utilisations(
        &self,
        run: &Coupled<f64>,
        bonds: &dyn Breakable<f64>,
        loud: &[bool],
    ) -> Result<[Loads; 2]> {
        let [body, spheres] = self.moving.models().map(|m| &run.subdomains()[m]);
        let in_zone = |b: u32| self.zone_bonds[b as usize];
        let releases = self.moving.limits.release.is_some();
        let (mut awake, mut asleep) = (Vec::new(), Vec::new());
        for (e, loud) in loud.iter().enumerate() {
            let in_element = || self.bonds_in.row(e).iter().copied();
            if releases || self.rim[e] {
                let of_body = self.shares[e] == Share::Body;
                awake.extend(in_element().filter(|b| !of_body || in_zone(*b)));
            }
            if *loud {
                asleep.extend(in_element().filter(|b| !in_zone(*b)));
            }
        }
        let mut wanted = vec![false; self.homes[0].len()];
        for b in &asleep {
            bonds.parts()[*b as usize]
                .iter()
                .for_each(|i| wanted[*i as usize] = true);
        }
        let in_field = bonds.utilisations(&self.field_at_spheres(&wanted, body, spheres)?, &asleep);
        let loads = bonds.utilisations(&spheres.state().q, &awake);
        Ok([(awake, loads), (asleep, in_field)])
    }

    /// Finds the elements that the zone should have.
    pub(super) fn wanted(&mut self, run: &Coupled<f64>) -> Result<Look> {
        let [body, spheres] = self.moving.models().map(|m| &run.subdomains()[m]);
        let mut hot = vec![false; self.shares.len()];
        self.mark_breaks(&mut hot);
        let mut out = Look {
            core: self.state.core.clone(),
            late: None,
            outside: None,
            barred: Vec::new(),
        };
        let Some(bonds) = spheres.model().views().breakable else {
            return Ok(out);
        };
        let limits = &self.moving.limits;
        let strains = self.quiet.strains(&body.state().q);
        let soon_at = SOON * limits.wake;
        let loud = self.quiet.may_reach(soon_at, &strains, &self.state.last);
        out.outside = self.loaded_outside(&strains, &loud);
        let [awake, asleep] = self.utilisations(run, bonds, &loud)?;
        let element = |b: u32| self.homes[1][b as usize] as usize;
        let (mut soon, mut late) = (vec![false; hot.len()], None::<(u32, f64)>);
        let mut largest = vec![0.0_f64; hot.len()];
        for (b, u) in asleep.0.into_iter().zip(asleep.1) {
            let e = element(b);
            largest[e] = largest[e].max(u);
            out.core[e] |= u >= limits.wake;
            soon[e] |= u >= soon_at;
            if self.shares[e] == Share::Body && u >= 1.0 && late.is_none_or(|l| u > l.1) {
                late = Some((b, u));
            }
        }
        out.late = late.map(|(b, u)| (middle(spheres.model().nodes(), &bonds.parts()[b as usize]), u));
        for e in (0..loud.len()).filter(|e| loud[*e]) {
            self.state.last[e] = (strains[e], largest[e]);
        }
        let mut busy = self.first.clone();
        for (b, u) in awake.0.into_iter().zip(awake.1) {
            let e = element(b);
            hot[e] |= u >= HOT;
            busy[e] |= limits.release.is_some_and(|release| u >= release);
        }
        if limits.release.is_some() {
            let near = self.around(busy, AHEAD);
            for e in (0..near.len()).filter(|e| near[*e] || !self.state.core[*e]) {
                self.state.loaded[e] = run.steps();
            }
            self.let_go(run.steps(), &mut out.core);
        }
        self.join(self.around(hot, limits.margin), &soon, &mut out);
        Ok(out)
    }

    /// Adds the elements `hot` to those that a look wants, without those that the zone must leave to the
    /// body. If the zone changes, elements around and those of `soon` join as well.
    fn join(&self, hot: Vec<bool>, soon: &[bool], look: &mut Look) {
        let add = |core: &mut [bool], new: &[bool]| core.iter_mut().zip(new).for_each(|(c, n)| *c |= n);
        add(&mut look.core, &hot);
        for (core, bar) in look.core.iter_mut().zip(&self.barred).filter(|(c, _)| **c) {
            *core = bar.is_none();
            look.barred.extend(bar.filter(|b| !look.barred.contains(b)));
        }
        if look.core != self.state.core {
            add(&mut look.core, &self.around(hot, AHEAD));
            add(&mut look.core, soon);
            let free = self.barred.iter().map(Option::is_none);
            look.core.iter_mut().zip(free).for_each(|(c, free)| *c &= free);
            self.join_together(&mut look.core);
        }
    }

    /// Adds layers of elements around those that join, until enough of them join to pay for a change.
    fn join_together(&self, core: &mut [bool]) {
        let is_new = |(new, old): (&bool, &bool)| *new && !old;
        let size = self.state.core.iter().filter(|c| **c).count();
        loop {
            let joins: Vec<bool> = core.iter().zip(&self.state.core).map(is_new).collect();
            if joins.iter().filter(|j| **j).count() as f64 >= JOIN * size as f64 {
                return;
            }
            let around = self.around(joins, 1);
            let joins_too = |e: &usize| around[*e] && !core[*e] && self.barred[*e].is_none();
            let more: Vec<usize> = (0..core.len()).filter(joins_too).collect();
            if more.is_empty() {
                return;
            }
            more.iter().for_each(|e| core[*e] = true);
        }
    }

    /// Takes elements from the zone that have long been without load and are not near to a break, if they are
    /// enough to pay for a change.
    fn let_go(&self, step: usize, core: &mut [bool]) {
        let mut broken = vec![false; core.len()];
        let log = locked(&self.log);
        let events = log.events().iter();
        events.for_each(|e| broken[self.homes[1][e.bond as usize] as usize] = true);
        let near_break = self.around(broken, self.moving.limits.margin);
        let zone = || (0..core.len()).filter(|e| self.state.core[*e]);
        let [low, high] = bounds_of(zone().map(|e| &self.centres[e]));
        // The middle of a zone that goes along with a pulse is without load for less.
        let pause = 0.5 * (high - low).max() * self.slowness;
        let has_rested = |e: &usize| (step - self.state.loaded[*e]) as f64 >= pause;
        let leave: Vec<usize> = zone().filter(|e| has_rested(e) && !near_break[*e]).collect();
        if leave.len() as f64 >= LEAVE * zone().count() as f64 {
            leave.iter().for_each(|e| core[*e] = false);
        }
    }

    /// Elements within `layers` elements of some.
    pub(super) fn around(&self, mut some: Vec<bool>, layers: usize) -> Vec<bool> {
        for _ in 0..layers {
            let grown = |e: usize| some[e] || self.neighbours[e].iter().any(|k| some[*k as usize]);
            some = (0..some.len()).map(grown).collect();
        }
        some
    }

    /// Displacements and rotations of the `wanted` spheres in the body's field; zero for the others.
    fn field_at_spheres(
        &self,
        wanted: &[bool],
        body: &Subdomain<f64>,
        spheres: &Subdomain<f64>,
    ) -> Result<Vec<f64>> {
        let (q, field, nodes) = (&body.state().q, self.moving.field()?, spheres.model().nodes());
        let mut out = vec![0.0; spheres.state().q.len()];
        let (linear, angular) = out.split_at_mut(spheres.model().layout().translations());
        let chunks = linear
            .par_chunks_exact_mut(3)
            .zip(angular.par_chunks_exact_mut(3));
        let read = |row: &mut ShapeRow<f64>, ((u, th), i): ((&mut [f64], &mut [f64]), usize)| {
            if !wanted[i] {
                return Ok(());
            }
            let (x, place) = (&nodes[i], self.places[i]);
            let way = place.way(x, &self.centres[self.homes[0][i] as usize]);
            field.shape_in(place.element as usize, &(x - way), true, row)?;
            let (mut value, mut turn) = (Vector3::zeros(), Vector3::zeros());
            let mut slope = Matrix3::zeros();
            for (k, &node) in row.nodes.iter().enumerate() {
                let d = Vector3::from_column_slice(&q[3 * node..3 * node + 3]);
                value += d * row.values[k];
                turn += row.gradients[k].cross(&d) * 0.5;
                slope += d * row.gradients[k].transpose();
            }
            // Outside, the field goes on linearly.
            let relaxation = self.moving.responses[i].in_gradient(&slope);
            u.copy_from_slice((value + slope * way + relaxation[0]).as_slice());
            th.copy_from_slice((turn + relaxation[1]).as_slice());
            Ok(())
        };
        let read_all = chunks
            .zip(0..nodes.len())
            .try_for_each_init(ShapeRow::default, read);
        read_all.map_err(core("body"))?;
        Ok(out)
    }
}
