//! Decides where a zone goes that follows (`zone.NAME.follow`), and moves it.
//!
//! At every look, each bond has a utilisation: its load over its strength, as a number that grows in
//! proportion to the displacements. Bonds with an end in the zone alone have that of their own state, the
//! others that of the body's field at their ends, with half its curl as rotations. Then
//!
//! ```text
//! an element joins the zone if a bond in it outside of the zone has        u ≥ wake
//! all elements join within `margin` elements of a bond that broke or has   u ≥ 0.8
//! an element woke too late if a bond in it slept at                        u ≥ 1
//! an element leaves if all bonds in it and around it have                  u < release
//! ```
//!
//! Bonds outside of the zone have the body's field with the responses of the packing to its strains: the
//! field alone would load them all alike. A change costs as much as several steps. When one is due, elements
//! join as well that are near to it ([`AHEAD`], [`SOON`]). Elements near a support or a load, and beyond
//! `follow.within`, stay with the body.

use super::quiet::{PLACES, Quiet, Seen, Strain};
use crate::error::{Error, Result, core, key};
use crate::output::summary::Conversion;
use crate::setup::{BODY, Bar, Built, Grid, Moving, Share};
use arlequin::core::nalgebra::{Matrix3, Point3, Vector3};
use arlequin::core::{Breakable, Coupled, Interpolation, ShapeRow, Subdomain};
use arlequin::dem_beam::fracture::{SharedLog, locked};
use arlequin::fem_ref::FemField;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::time::Instant;

/// Utilisation above which a bond needs elements of the zone around it.
const HOT: f64 = 0.8;
/// Elements beyond the margin that join in a change that is due.
const AHEAD: usize = 3;
/// Share of the zone's elements that leave together at least.
const LEAVE: f64 = 0.05;
/// Share of `wake` above which elements join in a change that is due.
const SOON: f64 = 0.9;

/// State of a zone that follows, for checkpoints.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Followed {
    /// For each element of the body: true if the zone has it alone.
    core: Vec<bool>,
    /// Changes of weights so far.
    pub(super) conversions: Vec<Conversion>,
    /// Number of breaks at the last look.
    seen: usize,
    /// True if an element has woken too late.
    late: bool,
    /// True once the body was loaded like spheres that break, outside of `follow.within`.
    outside: bool,
    /// Probes whose model sleeps at their place, or slept there: the user knows of them.
    asleep: Vec<String>,
    /// Last looks at the elements.
    last: Vec<Seen>,
}

/// A zone that follows.
#[derive(Debug)]
pub(crate) struct Follow {
    moving: Moving,
    /// Mediator after a change, until it is shown.
    pub(super) mediator: Option<Grid>,
    pub(super) state: Followed,
    every: usize,
    log: SharedLog,
    shares: Vec<Share>,
    /// Element of each sphere, and that of the middle of each bond.
    homes: [Vec<u32>; 2],
    /// Where the body's field is read for each sphere.
    places: Vec<Place>,
    /// Centres of the elements \[m\].
    centres: Vec<Point3<f64>>,
    /// Elements that share a node with each element.
    neighbours: Vec<Vec<u32>>,
    /// Elements so near to others outside of the zone that bonds in them can bring these along.
    rim: Vec<bool>,
    quiet: Quiet,
    middles: Vec<Vector3<f64>>,
    /// Elements that the zone began with: notches may cut them.
    first: Vec<bool>,
    /// For each element: true if spheres fill it.
    filled: Vec<bool>,
    /// For each element: the reason for which it stays with the body.
    barred: Vec<Option<Bar>>,
}

/// Place in the body at which its field is read for a sphere: the sphere's own, or if that lies outside of
/// all elements, the first tenth of the way to the centre of the nearest one that does not.
#[derive(Debug, Clone, Copy)]
struct Place {
    element: u32,
    tenths: u8,
}

impl Place {
    fn new(field: &FemField<f64>, x: &Point3<f64>, centre: &Point3<f64>) -> Result<Self> {
        let place = |tenths: u8| {
            let way = Self { element: 0, tenths }.way(x, centre);
            let element = field.element_at(&(x - way))? as u32;
            Some(Self { element, tenths })
        };
        let first = (0..=10).find_map(place);
        first.ok_or_else(|| key("body", "has no element at the centre of one"))
    }

    /// Way to a sphere at `x` \[m\].
    fn way(self, x: &Point3<f64>, centre: &Point3<f64>) -> Vector3<f64> {
        (x - centre) * (0.1 * f64::from(self.tenths))
    }
}

/// Findings of a look: the elements that the zone should have, the worst bond that slept, the most loaded
/// element that has no spheres, and what keeps the zone from where bonds are loaded.
struct Look {
    core: Vec<bool>,
    late: Option<(usize, f64)>,
    outside: Option<(usize, f64)>,
    barred: Option<Bar>,
}

impl Follow {
    /// Prepares the watch of a run's zone, if it has one that follows.
    pub(super) fn new(built: &Built) -> Result<Option<Self>> {
        let Some(moving) = built.moving.clone() else {
            return Ok(None);
        };
        let [body, spheres] = moving.models().map(|m| &built.run.subdomains()[m]);
        let [body_info, info] = moving.models().map(|m| &built.models[m]);
        let (Some(log), Some(bonds)) = (info.breaks.clone(), spheres.model().views().breakable) else {
            return Err(key(
                format!("zone.{}.follow", moving.name),
                "needs an effect fracture on the zone",
            ));
        };
        let nodes = spheres.model().nodes();
        let middle = |pair: &[u32; 2]| {
            let [a, b] = pair.map(|i| nodes[i as usize].coords);
            (a + b) * 0.5
        };
        let middles: Vec<Vector3<f64>> = bonds.parts().iter().map(middle).collect();
        let of_spheres = homes(&moving, nodes.iter().map(|x| x.coords))?;
        let of_bonds = homes(&moving, middles.iter().copied())?;
        let field = &*body_info.field;
        let centres = moving.centres()?;
        let whole = moving.field()?;
        let places = nodes.par_iter().zip(&of_spheres);
        let places = places.map(|(x, e)| Place::new(whole, x, &centres[*e as usize]));
        let places = places.collect::<Result<_>>()?;
        let shares = moving.shares()?;
        let speed = body_info.material.as_ref().map_or(0.0, |m| m.p_wave_speed());
        let crossing = body_info.spacing / (speed * built.run.dt());
        let every = moving.limits.every.unwrap_or(1.max(crossing.floor() as usize));
        debug_assert_eq!(body.model().nodes().len(), moving.mesh()?.nodes().len());
        let of_elements = in_unit_strains((bonds, &of_bonds), nodes, &moving, centres.len());
        let first: Vec<bool> = shares.iter().map(|s| *s == Share::Zone).collect();
        let quiet = Quiet::new(field, &centres, of_elements)?;
        let mut out = Self {
            rim: Vec::new(),
            state: Followed {
                core: first.clone(),
                conversions: Vec::new(),
                seen: 0,
                late: false,
                outside: false,
                asleep: Vec::new(),
                last: quiet.unseen(),
            },
            quiet,
            neighbours: neighbours(&moving)?,
            filled: moving.filled()?,
            barred: moving.barred()?,
            places,
            centres,
            homes: [of_spheres, of_bonds],
            moving,
            mediator: None,
            every,
            log,
            shares,
            middles,
            first,
        };
        out.rim = out.rim();
        Ok(Some(out))
    }

    /// Returns a warning for each probe whose model sleeps at its place, the first time that it does.
    pub(super) fn probes_asleep(&mut self, time: f64) -> Result<Vec<String>> {
        let (zone, mut out) = (&self.moving.name, Vec::new());
        for (name, model) in self.moving.probes_asleep()? {
            if self.state.asleep.iter().any(|s| s == name) {
                continue;
            }
            self.state.asleep.push(name.to_owned());
            out.push(match model == *zone {
                true => format!(
                    "probe '{name}': spheres of zone '{zone}' sleep there at t = {time:.4e} s and do not move until the zone reaches \
                     them; for the time before, give it model = \"{BODY}\""
                ),
                false => format!(
                    "probe '{name}' of '{BODY}' lies in zone '{zone}' since t = {time:.4e} s: the body's elements sleep there and no \
                     longer change; give it model = \"{zone}\""
                ),
            });
        }
        Ok(out)
    }

    fn rim(&self) -> Vec<bool> {
        let outside = self.state.core.iter().map(|core| !core).collect();
        self.around(outside, self.moving.limits.margin + AHEAD)
    }

    /// Returns a warning, or the error that it is with `follow.strict`.
    fn warning_or_end(&self, text: String) -> Result<String> {
        match self.moving.limits.strict {
            true => Err(key(format!("zone.{}.follow.strict", self.moving.name), text)),
            false => Ok(text),
        }
    }

    /// Looks at the bonds if a look is due, and moves the zone if it must. Returns warnings.
    pub(super) fn look(&mut self, run: &mut Coupled<f64>) -> Result<Vec<String>> {
        if !run.steps().is_multiple_of(self.every) {
            return Ok(Vec::new());
        }
        let since = Instant::now();
        let look = self.wanted(run)?;
        let mut warnings = Vec::new();
        let time = format!("t = {:.4e} s", run.time());
        if let Some((bond, u)) = look.late.filter(|_| !self.state.late) {
            self.state.late = true;
            let [x, y, z]: [f64; 3] = self.middles[bond].into();
            warnings.push(self.warning_or_end(format!(
                "zone '{}' woke too late: at {time} the body's field loads a bond that slept at ({x:.3e}, {y:.3e}, {z:.3e}) m to \
                 {u:.2} of its strength; take a lower wake, a smaller every, or a larger shape",
                self.moving.name
            ))?);
        }
        if let Some((e, u)) = look.outside.filter(|_| !self.state.outside) {
            self.state.outside = true;
            let [x, y, z]: [f64; 3] = self.centres[e].coords.into();
            warnings.push(self.warning_or_end(format!(
                "at {time} the body is loaded at ({x:.3e}, {y:.3e}, {z:.3e}) m, outside of zone.{}.follow.within, like spheres at \
                 {u:.2} of their strength: what would break there stays whole; take a larger region",
                self.moving.name
            ))?);
        }
        warnings.extend(look.barred.map(|bar| self.moving.warning(bar)));
        if look.core != self.state.core {
            match self.moving.moved(&look.core) {
                Ok(moved) => {
                    self.change(moved, run, since)?;
                    warnings.extend(self.probes_asleep(run.time())?);
                }
                Err(e) => {
                    warnings.push(format!(
                        "zone '{}' cannot grow to where bonds are loaded: {}",
                        self.moving.name,
                        self.moving.place_of(e)
                    ));
                }
            }
        }
        Ok(warnings)
    }

    /// Brings a run to the zone of a checkpoint, whose state is restored next.
    pub(super) fn restore(&mut self, saved: Followed, run: &mut Coupled<f64>) -> Result<()> {
        if saved.core.len() != self.state.core.len() {
            return Err(key("body", "has another number of elements than the checkpoint"));
        }
        if !saved.conversions.is_empty() {
            let moved = self.moving.moved(&saved.core)?;
            let (change, mediator) = moved.rezoning(&self.moving)?;
            run.rezone(change).map_err(core("zone"))?;
            self.mediator = Some(mediator);
            self.shares = moved.shares()?;
            self.moving = moved;
        }
        self.state = saved;
        self.rim = self.rim();
        Ok(())
    }

    /// Changes the weights of the run.
    fn change(&mut self, moved: Moving, run: &mut Coupled<f64>, since: Instant) -> Result<()> {
        let shares = moved.shares()?;
        let cells = |shares: &[Share]| shares.iter().filter(|s| **s == Share::Zone).count();
        let before = cells(&self.shares);
        let (change, mediator) = moved.rezoning(&self.moving)?;
        let done = run.rezone(change).map_err(core("time"))?;
        self.mediator = Some(mediator);
        // The overlap may take elements of its own accord: what the zone has is what the division says.
        self.state.core = shares.iter().map(|s| *s == Share::Zone).collect();
        let spheres = done.awake[moved.models()[1]];
        self.state.conversions.push(Conversion {
            time: run.time(),
            step: run.steps(),
            cells: [before, cells(&shares)],
            spheres,
            work: done.work,
            parts: [done.potential, done.kinetic, done.rigid, done.start],
            closing: done.closing,
            seconds: since.elapsed().as_secs_f64(),
        });
        (self.moving, self.shares) = (moved, shares);
        self.rim = self.rim();
        Ok(())
    }

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

    /// Utilisations of the bonds that are awake, and of those that sleep in elements marked in `loud`; zero
    /// for the others.
    fn utilisations(
        &self,
        run: &Coupled<f64>,
        bonds: &dyn Breakable<f64>,
        loud: &[bool],
    ) -> Result<[Vec<f64>; 2]> {
        let [body, spheres] = self.moving.models().map(|m| &run.subdomains()[m]);
        let [of_spheres, of_bonds] = &self.homes;
        let pairs = bonds.parts();
        let in_zone = |b: usize| {
            let ends = pairs[b].map(|i| self.shares[of_spheres[i as usize] as usize]);
            ends.contains(&Share::Zone)
        };
        let awake = |b: usize| self.shares[of_bonds[b] as usize] != Share::Body || in_zone(b);
        let releases = self.moving.limits.release.is_some();
        let watched = |b: usize| (releases || self.rim[of_bonds[b] as usize]) && awake(b);
        let looked_at = |b: usize| loud[of_bonds[b] as usize] && !in_zone(b);
        let mut wanted = vec![false; of_spheres.len()];
        for b in (0..pairs.len()).filter(|b| looked_at(*b)) {
            pairs[b].iter().for_each(|i| wanted[*i as usize] = true);
        }
        let in_field = self.field_at_spheres(&wanted, body, spheres)?;
        Ok([
            bonds.utilisations(&spheres.state().q, &watched),
            bonds.utilisations(&in_field, &looked_at),
        ])
    }

    /// Finds the elements that the zone should have.
    fn wanted(&mut self, run: &Coupled<f64>) -> Result<Look> {
        let [body, spheres] = self.moving.models().map(|m| &run.subdomains()[m]);
        let mut hot = vec![false; self.shares.len()];
        self.mark_breaks(&mut hot);
        let mut out = Look {
            core: self.state.core.clone(),
            late: None,
            outside: None,
            barred: None,
        };
        let Some(bonds) = spheres.model().views().breakable else {
            return Ok(out);
        };
        let limits = &self.moving.limits;
        let strains = self.quiet.strains(&body.state().q);
        let soon_at = SOON * limits.wake;
        let loud = self.quiet.may_reach(soon_at, &strains, &self.state.last);
        out.outside = self.loaded_outside(&strains, &loud);
        let [loads, in_field] = self.utilisations(run, bonds, &loud)?;
        let mut soon = vec![false; hot.len()];
        let mut largest = vec![0.0_f64; hot.len()];
        for (b, e) in self.homes[1].iter().enumerate() {
            let (e, u) = (*e as usize, in_field[b]);
            largest[e] = largest[e].max(u);
            hot[e] |= loads[b] >= HOT;
            out.core[e] |= u >= limits.wake;
            soon[e] |= u >= soon_at;
            if self.shares[e] == Share::Body && u >= 1.0 && out.late.is_none_or(|l| u > l.1) {
                out.late = Some((b, u));
            }
        }
        for e in (0..loud.len()).filter(|e| loud[*e]) {
            self.state.last[e] = (strains[e], largest[e]);
        }
        if let Some(release) = limits.release {
            let of_zone = loads.iter().zip(&self.homes[1]).filter(|(u, _)| **u >= release);
            let mut busy = self.first.clone();
            of_zone.for_each(|(_, e)| busy[*e as usize] = true);
            self.let_go(busy, &mut out.core);
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
            look.barred = look.barred.or(*bar);
        }
        if look.core != self.state.core {
            add(&mut look.core, &self.around(hot, AHEAD));
            add(&mut look.core, soon);
            let free = self.barred.iter().map(Option::is_none);
            look.core.iter_mut().zip(free).for_each(|(c, free)| *c &= free);
        }
    }

    /// Takes elements from the zone that are neither busy nor near to a break, if they are enough to pay
    /// for a change.
    fn let_go(&self, busy: Vec<bool>, core: &mut [bool]) {
        let mut broken = vec![false; core.len()];
        let log = locked(&self.log);
        let events = log.events().iter();
        events.for_each(|e| broken[self.homes[1][e.bond as usize] as usize] = true);
        let stay = [
            self.around(busy, AHEAD),
            self.around(broken, self.moving.limits.margin),
        ];
        let may_leave = |e: &usize| self.state.core[*e] && !stay[0][*e] && !stay[1][*e];
        let leave: Vec<usize> = (0..core.len()).filter(may_leave).collect();
        let size = self.state.core.iter().filter(|c| **c).count();
        if leave.len() as f64 >= LEAVE * size as f64 {
            leave.iter().for_each(|e| core[*e] = false);
        }
    }

    /// Elements within `layers` elements of some.
    fn around(&self, mut some: Vec<bool>, layers: usize) -> Vec<bool> {
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

/// Largest utilisations of the bonds of each element in unit strains of either sign \[–\].
fn in_unit_strains(
    (bonds, of_bonds): (&dyn Breakable<f64>, &[u32]),
    nodes: &[Point3<f64>],
    moving: &Moving,
    elements: usize,
) -> Vec<Strain> {
    // So small that laws with finite rotations stay linear.
    const SMALL: f64 = 1e-6;
    let mut out = vec![[0.0_f64; 6]; elements];
    for (k, [i, j]) in PLACES.into_iter().enumerate() {
        let mut strain = Matrix3::zeros();
        strain[(i, j)] += 0.5 * SMALL;
        strain[(j, i)] += 0.5 * SMALL;
        for sign in [1.0, -1.0] {
            let h: Matrix3<f64> = strain * sign;
            let mut q = vec![0.0; 6 * nodes.len()];
            let (linear, angular) = q.split_at_mut(3 * nodes.len());
            let chunks = linear
                .par_chunks_exact_mut(3)
                .zip(angular.par_chunks_exact_mut(3));
            let places = nodes.par_iter().zip(&*moving.responses);
            chunks.zip(places).for_each(|((u, th), (x, response))| {
                let relaxation = response.in_gradient(&h);
                u.copy_from_slice((h * x.coords + relaxation[0]).as_slice());
                th.copy_from_slice(relaxation[1].as_slice());
            });
            let loads = bonds.utilisations(&q, &|_| true);
            for (u, e) in loads.iter().zip(of_bonds) {
                let most = &mut out[*e as usize][k];
                *most = most.max(u / SMALL);
            }
        }
    }
    out
}

/// Element of the body at each of some places.
fn homes(moving: &Moving, places: impl Iterator<Item = Vector3<f64>>) -> Result<Vec<u32>> {
    places
        .map(|x| Ok(moving.element_at(&x.into())? as u32))
        .collect::<Result<_, Error>>()
}

fn neighbours(moving: &Moving) -> Result<Vec<Vec<u32>>> {
    let mesh = moving.mesh()?;
    let mut around = vec![Vec::new(); mesh.nodes().len()];
    for e in 0..mesh.element_count() {
        mesh.element(e)
            .iter()
            .for_each(|k| around[*k as usize].push(e as u32));
    }
    let of_element = |e: usize| {
        let nodes = mesh.element(e).iter();
        let mut out: Vec<u32> = nodes.flat_map(|k| around[*k as usize].iter().copied()).collect();
        out.sort_unstable();
        out.dedup();
        out
    };
    Ok((0..mesh.element_count()).map(of_element).collect())
}
