//! Contact between the surface of a model and another model: spheres on facets, or facets on facets.
//!
//! Contact acts at points: the centres of spheres, or points of a surface (module `points`). Each looks for
//! its foot on the facets of the other model (module `facet`). Of two surfaces, the points of both act, with
//! half of the stiffness. The law, friction and energy budgets are those of particles. A force on a point
//! has its reaction at the foot, on the nodes of the facet with their weights. The budget counts the work on
//! these nodes, so it holds while the foot slides.
//!
//! - Nodes that an interface between the two models ties touch nothing.
//! - A point that overlaps the other model at rest pushes only when it comes closer.
//! - What sleeps in a zone that moves touches nothing; contacts of what gains weight begin anew.
//! - A contact carries the product of the mass shares of its two ends. The contacts of all parts of two
//!   bodies in overlaps then sum to one contact.
//!
//! A normal force acts along the line from foot to point and has no moment, and friction on a sphere acts at
//! the foot. Friction between two surfaces has a moment: that of a force times the depth of the point.
//!
//! Feet are found on all threads. Forces are added point after point in an order that is reversed in every
//! step, so results do not depend on the number of threads. A step allocates only where points are listed
//! anew.

use super::closed::{Active, Closed, Proposed};
use super::exterior::{Exterior, Side};
use super::facet::{Facet, Foot};
use super::forces::Push;
use super::place::Place;
use super::points::{DEEPEST, Deepest};
use super::search::Near;
use super::{ContactLaw, End, Pair, Solid, Twist};
use crate::effect::{AnyEffect, HostPair, Instant, PairEffect, PairEffectSpec, StepDemand};
use crate::error::invalid;
use crate::model::Arms;
use crate::record::Record;
use crate::{Error, Result};
use nalgebra::{Point3, Vector3};
use std::collections::BTreeSet;

/// Specification of contact between two models of which one has a surface at least, a pair effect on their
/// subdomains in the order of the models.
#[derive(Debug)]
pub struct SurfaceContact(Contacts);

/// Two models in contact during a run.
#[derive(Debug)]
struct Contacts {
    name: String,
    sides: [Side; 2],
    near: Near,
    closed: Closed,
    /// Distance below which each point pushes \[m\]: its radius, or its distance at rest if it overlaps then.
    allowed: Vec<f64>,
    /// Points whose allowed distance is that at a change of weights.
    renewed: BTreeSet<u32>,
    /// Longest way that a point can sink in a step without losing its foot \[m\].
    thinnest: f64,
    demand: StepDemand<f64>,
    checked: bool,
    /// True if an interface ties the two models.
    is_tied: bool,
    most: usize,
}

impl SurfaceContact {
    /// Contact between two models; its name is `contact A-B`.
    ///
    /// # Errors
    /// [`Error::InvalidParameter`] for parameters of the law, for two models without facets, and for a
    /// surface whose facets do not all look outwards.
    pub fn new(first: &Exterior, second: &Exterior, law: ContactLaw) -> Result<Self> {
        law.check()?;
        let name = format!("contact {}-{}", first.name, second.name);
        if law.rolling > 0.0 {
            let rule = "must be zero: a facet takes no moment";
            return Err(invalid(
                &format!("rolling resistance of '{name}'"),
                law.rolling,
                rule,
            ));
        }
        if !first.has_facets() && !second.has_facets() {
            let rule = "must have facets, or take the contact of particles";
            return Err(invalid(&format!("models of '{name}'"), "spheres", rule));
        }
        first.check()?;
        second.check()?;
        Ok(Self(Contacts {
            sides: [Side::new(first, second)?, Side::new(second, first)?],
            near: Near::new(law.skin * first.size().min(second.size())),
            closed: Closed::new(law, 0),
            allowed: Vec::new(),
            renewed: BTreeSet::new(),
            thinnest: f64::INFINITY,
            demand: StepDemand::none(),
            checked: false,
            is_tied: false,
            most: 0,
            name,
        }))
    }
}

/// Returns the side of a point, and the number of the point there.
pub(super) fn locate(sides: &[Side; 2], point: u32) -> (usize, usize) {
    let first = sides[0].points.len();
    let k = point as usize;
    if k < first { (0, k) } else { (1, k - first) }
}

/// Share of a contact: the product of those of its ends.
fn share(sides: &[Side; 2], point: u32, foot: &Place) -> f64 {
    let (s, k) = locate(sides, point);
    sides[s].weight(&sides[s].points[k].place) * sides[1 - s].weight(foot)
}

/// Power of a contact on the velocities `v` \[W\].
fn power(sides: &[Side; 2], a: &Active, v: [&[f64]; 2]) -> f64 {
    let (s, k) = locate(sides, a.point);
    let place = &sides[s].points[k].place;
    let speed = place.value(v[s]) - a.foot.value(v[1 - s]);
    a.force.dot(&speed) + a.torque.dot(&sides[s].spin(place, v[s]))
}

/// Returns what a contact with this force and torque on a point does: side and push of the foot, then of the
/// point.
fn pushes(
    sides: &[Side; 2],
    point: u32,
    foot: &Place,
    force: Vector3<f64>,
    torque: Vector3<f64>,
) -> [(usize, Push); 2] {
    let (s, k) = locate(sides, point);
    let place = &sides[s].points[k].place;
    [
        (1 - s, sides[1 - s].push(foot, -force, Vector3::zeros())),
        (s, sides[s].push(place, force, torque)),
    ]
}

/// Motion of the foot and of the point of a contact during the step.
fn ends(
    sides: &[Side; 2],
    pushes: &[(usize, Push); 2],
    instants: [&Instant<'_, f64>; 2],
    f: &[&mut [f64]; 2],
) -> [End; 2] {
    [0, 1].map(|k: usize| {
        let (s, push) = &pushes[k];
        sides[*s].forces.end(push, instants[*s], f[*s])
    })
}

impl Contacts {
    /// Returns an error if points lie deep inside the other model: it would hold them there or throw them
    /// out.
    fn check_start(&self, q: [&[f64]; 2]) -> Result<()> {
        let mut deepest = Deepest::default();
        for (point, foot) in self.near.feet() {
            let (s, k) = locate(&self.sides, point);
            let (side, p) = (&self.sides[s], &self.sides[s].points[k]);
            let limit = if side.turns {
                p.size
            } else {
                DEEPEST * p.size.min(foot.depth)
            };
            deepest.add(side.radius(k) - foot.distance, limit, || p.position(q[s]));
        }
        deepest.refuse(&format!("models of '{}'", self.name), "start", |limit| {
            format!("must overlap by {limit} at most, half a facet or a radius: move one of the two")
        })
    }

    /// Returns an error if points lie inside the other model, too deep for its facets to see them. Bodies
    /// that an interface ties overlap by intention.
    fn check_enclosed(&self, q: [&[f64]; 2]) -> Result<()> {
        if self.is_tied {
            return Ok(());
        }
        let mut deepest = Deepest::default();
        for (s, o) in [(0, 1), (1, 0)] {
            let (side, other) = (&self.sides[s], &self.sides[o]);
            let corners = |f: &Facet| f.triangle.places(|n| other.position(n, q[o])).map(Point3::from);
            // Facets of a zone are open where it lies in its body.
            let Ok(solid) = Solid::new(other.facets.iter().map(corners).collect()) else {
                continue;
            };
            let [low, high] = solid.bounds();
            for p in side.points.iter().filter(|p| side.weight(&p.place) > 0.0) {
                let x = Point3::from(p.position(q[s]));
                if (0..3).all(|c| low[c] < x[c] && x[c] < high[c]) {
                    deepest.add(-solid.distance(&x).0, DEEPEST * p.size, || x.coords);
                }
            }
        }
        deepest.refuse(&format!("models of '{}'", self.name), "start", |_| {
            "must not lie in each other: move one of the two".into()
        })
    }

    /// Returns an error if points sink so deep that they may pass through the facets that hold them.
    fn check_depth(&self, q: [&[f64]; 2]) -> Result<()> {
        let mut deepest = Deepest::default();
        for (point, foot) in self.near.feet() {
            let (s, k) = locate(&self.sides, point);
            let place = || self.sides[s].points[k].position(q[s]);
            deepest.add(-foot.distance, DEEPEST * foot.depth, place);
        }
        deepest.refuse_sinking(&format!("models of '{}'", self.name))
    }

    /// Finds the feet of all points that may touch; points off the list open.
    fn find(&mut self, q: [&[f64]; 2]) {
        if self.near.refresh(&self.sides, q) {
            for n in 0..self.closed.active.len() {
                let point = self.closed.active[n].point;
                if !self.near.lists(point) {
                    self.closed.open(point as usize);
                }
            }
        }
        self.near.measure(&self.sides, q);
    }

    /// Lets contacts of nodes that have gained weight begin anew, without a force: the place at which a node
    /// wakes, and the stiffness that it gains, must not load a spring that took in no work.
    fn begin_anew(&mut self) {
        if self.sides.iter().all(|s| s.gained.is_empty()) {
            return;
        }
        for (point, foot) in self.near.feet() {
            let (s, k) = locate(&self.sides, point);
            let [point_side, foot_side] = [&self.sides[s], &self.sides[1 - s]];
            if point_side.has_gained(&point_side.points[k].place) || foot_side.has_gained(&foot.place) {
                let allowed = &mut self.allowed[point as usize];
                if foot.distance < *allowed {
                    *allowed = foot.distance;
                    self.renewed.insert(point);
                }
                self.closed.finish(point as usize);
            }
        }
        self.sides.iter_mut().for_each(|s| s.gained.clear());
    }

    /// Restores what [`AnyEffect::save`] wrote; `None` for a record of other points.
    fn recall(&mut self, from: &Record<f64>) -> Option<()> {
        let (counts, integers) = from.integers.split_first_chunk::<4>()?;
        let [most, renewed, first, second] = counts.map(|n| usize::try_from(n).ok());
        let (renewed, integers) = integers.split_at_checked(renewed?)?;
        let (first, integers) = integers.split_at_checked(first?)?;
        let (second, integers) = integers.split_at_checked(second?)?;
        let (distances, numbers) = from.numbers.split_at_checked(renewed.len())?;
        for (point, distance) in renewed.iter().zip(distances) {
            *self.allowed.get_mut(usize::try_from(*point).ok()?)? = *distance;
        }
        let points = |x: &[u64]| x.iter().map(|k| *k as u32).collect::<Vec<u32>>();
        self.most = most?;
        self.renewed = points(renewed).into_iter().collect();
        (self.sides[0].gained, self.sides[1].gained) = (points(first), points(second));
        let sides = &self.sides;
        let nodes = |point: u32| sides[1 - locate(sides, point).0].rest.len();
        self.closed.restore(integers, numbers, nodes)
    }

    /// Computes all contacts and adds their forces to `f`.
    fn respond(&mut self, instants: [&Instant<'_, f64>; 2], f: &mut [&mut [f64]; 2]) {
        let dt = instants[0].dt;
        self.closed.begin(dt);
        let count = self.near.len();
        for n in 0..count {
            let (point, foot) = self.near.foot(self.closed.turn(n, count));
            if self.allowed[point as usize] - foot.distance > 0.0 {
                self.propose(point, &foot, instants);
            } else {
                self.closed.open(point as usize);
            }
        }
        // Sequential: a contact works on the velocity that the contacts before it have left.
        for n in 0..self.closed.proposed.len() {
            self.decide(self.closed.proposed[n], instants, f);
        }
        self.closed.end(dt);
        self.most = self.most.max(self.closed.active.len());
        let sides = &self.sides;
        self.closed.expect(|a| {
            let pushes = pushes(sides, a.point, &a.foot, a.force, a.torque);
            let [foot, point] = ends(sides, &pushes, instants, f);
            point.power(&a.force, &a.torque) - foot.power(&a.force, &Vector3::zeros())
        });
        for n in 0..self.closed.active.len() {
            let a = self.closed.active[n];
            for (s, push) in pushes(&self.sides, a.point, &a.foot, a.force, a.torque) {
                self.sides[s].forces.deliver(&push, f[s]);
            }
        }
    }

    fn propose(&mut self, point: u32, foot: &Foot, instants: [&Instant<'_, f64>; 2]) {
        let (s, k) = locate(&self.sides, point);
        self.closed.turned(foot.turn);
        let (own, other) = (&self.sides[s], &self.sides[1 - s]);
        let p = &own.points[k];
        let [stiffness, mass] = own.constants(k, other, foot);
        let twist = |side: &Side, place: &Place, v: &[f64]| Twist {
            linear: place.value(v),
            angular: side.spin(place, v),
        };
        let pair = Pair {
            normal: foot.normal,
            gap: self.allowed[point as usize] - foot.distance,
            stiffness: self.closed.law.law.modulus * stiffness,
            reduced_radius: 0.0,
            // The force acts at the foot.
            arms: [0.0, if own.turns { foot.distance } else { 0.0 }],
            share: share(&self.sides, point, &foot.place),
            inverse_mass: 1.0 / mass,
            motion: [
                twist(other, &foot.place, instants[1 - s].v_half),
                twist(own, &p.place, instants[s].v_half),
            ],
        };
        let spring = &mut self.closed.springs[point as usize];
        let proposal = self.closed.law.propose(&pair, false, instants[0].dt, spring);
        let r = &proposal.response;
        for (s, push) in pushes(&self.sides, point, &foot.place, r.force, r.torque[1]) {
            self.sides[s].forces.propose(&push);
        }
        self.closed.proposed.push(Proposed {
            point,
            foot: foot.place,
            proposal,
        });
    }

    fn decide(&mut self, p: Proposed, instants: [&Instant<'_, f64>; 2], f: &[&mut [f64]; 2]) {
        let r = &p.proposal.response;
        let proposed = pushes(&self.sides, p.point, &p.foot, r.force, r.torque[1]);
        for (s, push) in &proposed {
            self.sides[*s].forces.withdraw(push);
        }
        let ends = ends(&self.sides, &proposed, instants, f);
        let r = self.closed.decide(&p, ends, instants[0].dt);
        for (s, push) in pushes(&self.sides, p.point, &p.foot, r.force, r.torque[1]) {
            self.sides[s].forces.decide(&push);
        }
        self.closed.active.push(Active {
            point: p.point,
            foot: p.foot,
            force: r.force,
            torque: r.torque[1],
            stored: r.stored,
            expected: 0.0,
        });
    }

    /// Computes the demand on the step: each contact moves two ends, so its `ω²` is at most twice the larger
    /// row of both.
    fn demanded(&self) -> StepDemand<f64> {
        let law = &self.closed.law.law;
        let [a, b] = [0, 1].map(|s: usize| self.sides[s].rows(&self.sides[1 - s], law));
        StepDemand {
            stiffness: 2.0 * a[0].max(b[0]),
            damping: 2.0 * a[1].max(b[1]),
            ..StepDemand::none()
        }
    }
}

impl PairEffectSpec<f64> for SurfaceContact {
    fn name(&self) -> &str {
        &self.0.name
    }

    fn attach(mut self: Box<Self>, hosts: &HostPair<'_, f64>) -> Result<Box<dyn PairEffect<f64>>> {
        let contacts = &mut self.0;
        let name = format!("'{}'", contacts.name);
        for (s, side) in contacts.sides.iter_mut().enumerate() {
            side.attach(&hosts.sides[s], &hosts.tied[s], &name)?;
        }
        let points = contacts.sides.iter().map(|s| s.points.len()).sum();
        contacts.closed = Closed::new(contacts.closed.law.law, points);
        let radii = contacts
            .sides
            .iter()
            .flat_map(|s| (0..s.points.len()).map(|k| s.radius(k)));
        contacts.allowed = radii.collect();
        let undeformed = [0, 1].map(|s: usize| vec![0.0; 3 * contacts.sides[s].rest.len()]);
        let undeformed = undeformed.each_ref().map(Vec::as_slice);
        contacts.find(undeformed);
        contacts.check_start(undeformed)?;
        contacts.is_tied = hosts.tied.iter().flatten().any(|tied| *tied);
        contacts.check_enclosed(undeformed)?;
        for (point, foot) in contacts.near.feet() {
            let allowed = &mut contacts.allowed[point as usize];
            *allowed = allowed.min(foot.distance);
        }
        let depths = contacts
            .sides
            .iter()
            .flat_map(|s| s.facets.iter().map(|f| f.depth));
        let radii = contacts
            .sides
            .iter()
            .filter(|s| s.turns)
            .flat_map(|s| s.points.iter().map(|p| p.size));
        contacts.thinnest = DEEPEST * depths.chain(radii).fold(f64::INFINITY, f64::min);
        for (side, host) in contacts.sides.iter_mut().zip(&hosts.sides) {
            side.weigh(host)?;
            if side.sleeps() {
                contacts.near.forget();
            }
        }
        contacts.demand = contacts.demanded();
        Ok(Box::new(self.0))
    }
}

impl AnyEffect<f64> for Contacts {
    fn name(&self) -> &str {
        &self.name
    }

    fn arms(&self) -> Option<Arms> {
        let two_surfaces = self.sides.iter().all(|s| !s.turns);
        let has_moment = two_surfaces && self.closed.law.law.friction > 0.0;
        (!has_moment).then_some(Arms::Current)
    }

    fn stored(&self) -> f64 {
        self.closed.stored()
    }

    fn supplied(&self) -> Option<f64> {
        Some(self.closed.law.supplied)
    }

    fn save(&self) -> Record<f64> {
        let mut out = Record::default();
        let gained = self.sides.each_ref().map(|s| &s.gained);
        let counts = [self.most, self.renewed.len(), gained[0].len(), gained[1].len()];
        out.integers.extend(counts.map(|n| n as u64));
        let listed = self.renewed.iter().chain(gained.into_iter().flatten());
        out.integers.extend(listed.map(|k| u64::from(*k)));
        out.numbers
            .extend(self.renewed.iter().map(|k| self.allowed[*k as usize]));
        self.closed.save(&mut out);
        out
    }

    fn restore(&mut self, from: &Record<f64>) -> Result<()> {
        self.near.forget();
        let fits = self.recall(from);
        fits.ok_or_else(|| Error::SizeMismatch {
            what: format!("points in the record of '{}'", self.name),
            expected: self.allowed.len(),
            found: from.integers.len(),
        })
    }

    fn facts(&self) -> Vec<(String, f64)> {
        let [contacts, turn, lost] = self.closed.facts();
        vec![
            contacts,
            turn,
            lost,
            ("most contacts".into(), self.most as f64),
            ("neighbour searches".into(), self.near.searches as f64),
            ("listed points".into(), self.near.len() as f64),
        ]
    }
}

impl PairEffect<f64> for Contacts {
    fn add_forces(&mut self, instants: [&Instant<'_, f64>; 2], mut f: [&mut [f64]; 2]) -> Result<()> {
        let q = instants.map(|i| i.q);
        let way = self.near.way(&self.sides, instants);
        let limit = self.near.reach().min(self.thinnest);
        if way > limit {
            let rule = format!(
                "must stay below {limit:e} m, or one would jump through the surface of the other; shorten the time step or slow \
                 them down"
            );
            let what = format!("way of the models of '{}' in a step", self.name);
            return Err(invalid(&what, format_args!("{way:e} m"), &rule));
        }
        let v = instants.map(|i| i.v_half);
        let sides = &self.sides;
        self.closed.settle(instants[0].dt, |a| power(sides, a, v));
        self.find(q);
        self.begin_anew();
        let is_displaced = || q.iter().any(|q| q.iter().any(|x| *x != 0.0));
        if !std::mem::replace(&mut self.checked, true) && is_displaced() {
            self.check_start(q)?;
            self.check_enclosed(q)?;
        }
        self.check_depth(q)?;
        self.respond(instants, &mut f);
        Ok(())
    }

    fn power(&self, v: [&[f64]; 2]) -> f64 {
        self.closed.active.iter().map(|a| power(&self.sides, a, v)).sum()
    }

    fn add_contact(&self, side: usize, f: &mut [f64]) -> bool {
        for a in &self.closed.active {
            let pushes = pushes(&self.sides, a.point, &a.foot, a.force, a.torque);
            let own = pushes.iter().filter(|p| p.0 == side);
            own.for_each(|p| p.1.add(f));
        }
        true
    }

    fn reweigh(&mut self, hosts: &HostPair<'_, f64>) -> Result<()> {
        let active = self.closed.active.iter();
        let before: Vec<f64> = active.map(|a| share(&self.sides, a.point, &a.foot)).collect();
        for (side, host) in self.sides.iter_mut().zip(&hosts.sides) {
            side.reweigh(host)?;
        }
        self.near.forget();
        let (sides, mut before) = (&self.sides, before.into_iter());
        // As at an obstacle, on both sides.
        self.closed.weaken(|a| {
            let before = before.next().unwrap_or(1.0);
            (share(sides, a.point, &a.foot) / before).min(1.0)
        });
        Ok(())
    }

    fn step_demand(&self) -> [StepDemand<f64>; 2] {
        [self.demand; 2]
    }
}
