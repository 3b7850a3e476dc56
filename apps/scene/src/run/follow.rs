//! Decides where a zone goes that follows (`zone.NAME.follow`), and moves it.
//!
//! At every look, each bond has a utilisation: its load over its strength, as a number that grows in
//! proportion to the displacements. Bonds of the zone and its overlap have that of their own state. Bonds
//! without an end in the zone alone have that of the body's field at their ends, with half its curl as
//! rotations; those of the overlap have both. Then
//!
//! ```text
//! an element joins the zone if a bond in it outside of the zone has        u ≥ wake
//! all elements join within `margin` elements of a bond that broke or has   u ≥ 0.8
//! an element woke too late if a bond in it slept at                        u ≥ 1
//! an element leaves if all bonds in it and around it have had              u < release
//! ```
//!
//! for as long as a wave needs to cross half of the zone: in a body that vibrates, all bonds are without load
//! twice in every period.
//!
//! Bonds outside of the zone have the body's field with the responses of the packing to its strains: the
//! field alone would load them all alike. A change costs as much as several steps. When one is due, elements
//! join as well that are near to it (`AHEAD`, `SOON`, `JOIN`). Elements near a support or a load, and
//! beyond `follow.within`, stay with the body. If nothing else of the body is left beyond an overlap, the
//! zone takes this too, up to the whole body.

mod look;
mod places;

use super::quiet::{Quiet, Seen};
use crate::error::{Result, core, key, value};
use crate::output::summary::Conversion;
use crate::setup::{BODY, Bar, Built, Grid, Moving, Share};
use arlequin::core::Coupled;
use arlequin::core::adjacency::Adjacency;
use arlequin::core::nalgebra::Point3;
use arlequin::dem_beam::fracture::SharedLog;
use look::AHEAD;
use places::{Place, homes, in_unit_strains, middle, neighbours};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::time::Instant;

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
    /// For each element: step of the last look that found it outside of the zone, or a bond near it loaded to
    /// `release` or more.
    loaded: Vec<usize>,
}

/// A zone that follows.
#[derive(Debug)]
pub(crate) struct Follow {
    moving: Moving,
    /// Number of the interface and its mediator after a change, until it is shown.
    pub(super) mediator: Option<(usize, Grid)>,
    pub(super) state: Followed,
    every: usize,
    /// Steps in which a wave runs a metre \[1/m\].
    slowness: f64,
    log: SharedLog,
    shares: Vec<Share>,
    /// Element of each sphere, and that of the middle of each bond.
    homes: [Vec<u32>; 2],
    /// Bonds in each element.
    bonds_in: Adjacency,
    /// For each bond: true if an end of it lies in the zone.
    zone_bonds: Vec<bool>,
    /// Where the body's field is read for each sphere.
    places: Vec<Place>,
    /// Centres of the elements \[m\].
    centres: Vec<Point3<f64>>,
    /// Elements that share a node with each element.
    neighbours: Vec<Vec<u32>>,
    /// Elements so near to others outside of the zone that bonds in them can bring these along.
    rim: Vec<bool>,
    quiet: Quiet,
    /// Elements that the zone began with: notches may cut them.
    first: Vec<bool>,
    /// For each element: true if spheres fill it.
    filled: Vec<bool>,
    /// For each element: the reason for which it stays with the body.
    barred: Vec<Option<Bar>>,
}

impl Follow {
    /// Prepares the watch of a zone that follows, if the run has one, and warns of probes whose model sleeps.
    pub(super) fn new(built: &mut Built) -> Result<Option<Self>> {
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
        let of_spheres = homes(&moving, nodes.iter().map(|x| x.coords))?;
        let of_bonds = homes(&moving, bonds.parts().iter().map(|ends| middle(nodes, ends)))?;
        let field = &*body_info.field;
        let centres = moving.centres()?;
        let whole = moving.field()?;
        let places = nodes.par_iter().zip(&of_spheres);
        let places = places.map(|(x, e)| Place::new(whole, x, &centres[*e as usize]));
        let places = places.collect::<Result<_>>()?;
        let shares = moving.shares()?;
        let speed = body_info.material.as_ref().map_or(0.0, |m| m.p_wave_speed());
        let slowness = 1.0 / (speed * built.run.dt());
        let crossing = body_info.spacing * slowness;
        let every = moving.limits.every.unwrap_or(1.max(crossing.floor() as usize));
        if moving.limits.every.is_some_and(|n| n > built.steps) {
            let rule = format!(
                "is more than the {} steps of the run: the zone would never look",
                built.steps
            );
            return Err(value(format!("zone.{}.follow.every", moving.name), every, &rule));
        }
        debug_assert_eq!(body.model().nodes().len(), moving.mesh()?.nodes().len());
        let of_elements = in_unit_strains((bonds, &of_bonds), nodes, &moving, centres.len());
        let first: Vec<bool> = shares.iter().map(|s| *s == Share::Zone).collect();
        let quiet = Quiet::new(field, &centres, of_elements)?;
        let bonds_in = Adjacency::of_slots(centres.len(), &of_bonds);
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
                loaded: vec![0; centres.len()],
            },
            quiet,
            neighbours: neighbours(&moving)?,
            filled: moving.filled()?,
            barred: moving.barred()?,
            places,
            centres,
            homes: [of_spheres, of_bonds],
            bonds_in,
            zone_bonds: Vec::new(),
            moving,
            mediator: None,
            every,
            slowness,
            log,
            shares,
            first,
        };
        out.mark_zone(&built.run);
        let asleep = out.probes_asleep(built.run.time())?;
        built.warnings.extend(asleep);
        Ok(Some(out))
    }

    /// Returns a warning for each probe whose model sleeps at its place, the first time that it does.
    fn probes_asleep(&mut self, time: f64) -> Result<Vec<String>> {
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

    /// Marks the rim and the bonds of the present zone.
    fn mark_zone(&mut self, run: &Coupled<f64>) {
        let outside = self.state.core.iter().map(|core| !core).collect();
        self.rim = self.around(outside, self.moving.limits.margin + AHEAD);
        let spheres = run.subdomains()[self.moving.models()[1]].model();
        let pairs = spheres.views().breakable.map_or(&[][..], |b| b.parts());
        let in_zone = |i: u32| self.shares[self.homes[0][i as usize] as usize] == Share::Zone;
        self.zone_bonds = pairs.iter().map(|&[i, j]| in_zone(i) || in_zone(j)).collect();
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
        if let Some((place, u)) = look.late.filter(|_| !self.state.late) {
            self.state.late = true;
            let [x, y, z]: [f64; 3] = place.into();
            warnings.push(self.warning_or_end(format!(
                "zone '{}' woke too late: at {time} the body's field loads a bond that slept at ({x:.3e}, {y:.3e}, {z:.3e}) m to \
                 {u:.2} of its strength; take a lower wake, a smaller every, or a zone that begins there",
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
        warnings.extend(look.barred.iter().map(|bar| self.moving.warning(*bar)));
        if look.core != self.state.core {
            let moved = self.moving.moved(&look.core, &self.barred);
            match moved.and_then(|moved| Ok((moved.shares()?, moved))) {
                // Elements that would leave are islands, and stay.
                Ok((shares, _)) if shares == self.shares => {}
                Ok(moved) => {
                    self.change(moved, run, since)?;
                    warnings.extend(self.probes_asleep(run.time())?);
                    if self.state.core.iter().all(|core| *core) {
                        // Without a time, so that it is said once.
                        warnings.push(format!(
                            "zone '{}' took the whole body (zones.csv has the time): spheres everywhere, without a zone, are cheaper",
                            self.moving.name
                        ));
                    }
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
            let moved = self.moving.moved(&saved.core, &self.barred)?;
            let (change, mediator) = moved.rezoning(&self.moving)?;
            run.rezone(change).map_err(core(self.key()))?;
            self.mediator = Some(mediator);
            self.shares = moved.shares()?;
            self.moving = moved;
        }
        self.state = saved;
        self.mark_zone(run);
        Ok(())
    }

    /// Key of the scene that asks for changes of weights.
    fn key(&self) -> String {
        format!("zone.{}.follow", self.moving.name)
    }

    /// Changes the weights of the run to those of a moved zone, which has these shares of the elements.
    fn change(
        &mut self,
        (shares, moved): (Vec<Share>, Moving),
        run: &mut Coupled<f64>,
        since: Instant,
    ) -> Result<()> {
        let cells = |shares: &[Share]| shares.iter().filter(|s| **s == Share::Zone).count();
        let before = cells(&self.shares);
        let (change, mediator) = moved.rezoning(&self.moving)?;
        let done = run.rezone(change).map_err(core(self.key()))?;
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
        self.mark_zone(run);
        Ok(())
    }
}
