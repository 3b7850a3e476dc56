//! Rigid bodies with which particles collide: planes, spheres and cylinders, at rest, driven, or free with a
//! mass.
//!
//! The contact law is that of [`crate::contact`] with the obstacle as a sphere of infinite radius, so a
//! particle of radius `r` has the stiffness `2 E r`. A particle that overlaps the obstacle at rest pushes
//! only when it comes closer; a particle whose centre lies inside is an error (`start.rs`).
//!
//! A free body moves by velocity Verlet like all particles. A free ball also rotates: friction acts at its
//! surface, so that the angular momentum of particles and ball is conserved. Planes and cylinders do not
//! rotate, because their shape defines no centre of mass. Fields of acceleration act on a free body as on its
//! particles.
//!
//! A particle that wakes in a change of weights, or gains weight, begins its contact anew: without a force,
//! and pushing when it comes closer.
//!
//! The energy that an obstacle gives to particles and their springs is its `supplied` energy: the work of its
//! drive, or a part of its own kinetic energy. No contact gives back more energy than it took in
//! ([`crate::contact`]).

mod near;
mod parts;
mod record;
mod start;

pub use arlequin_core::contact::{Motion, RigidShape};

use crate::contact::{self, ContactBody, ContactLaw, Grains, Sparse};
use crate::error::Result;
use crate::model::DemModel;
use crate::packing::cells::Sphere;
use arlequin_core::Exact;
use arlequin_core::contact::{BudgetedLaw, End, Pair, RigidBody, SharedBody, Spring, Twist};
use arlequin_core::effect::{AnyEffect, Effect, EffectSpec, Host, Instant, RigidMotion, StepDemand};
use arlequin_core::snapshot::Record;
use arlequin_core::{DofLayout, Model, TimeFunction};
use nalgebra::{Point3, Vector3};
use near::Near;
use parts::PartitionState;
use std::collections::BTreeSet;

/// A closed contact of the obstacle and its response in the last step.
#[derive(Debug, Clone, Copy)]
struct Active {
    particle: u32,
    /// Force on the particle \[N\].
    force: Vector3<f64>,
    /// Generalised torque on the particle \[N m\].
    torque: Vector3<f64>,
    stored: f64,
    /// Power on the velocity of the particle after the step, from the forces that were known \[W\].
    expected: f64,
}

/// Specification of a rigid obstacle, an effect on one cohesive-beam body.
#[derive(Debug)]
pub struct Obstacle(Body);

/// An obstacle at work in a run.
#[derive(Debug)]
struct Body {
    name: String,
    /// Name of the model on which it acts.
    host: String,
    body: SharedBody,
    /// Number of the model among those that touch the body.
    share: usize,
    law: BudgetedLaw,
    grains: Grains,
    /// Gap of each particle at rest if it overlaps the obstacle (negative), else zero \[m\].
    allowed: Vec<f64>,
    /// Particles that gained weight since the last step, and those whose allowed gap is that of such a step.
    gained: Vec<u32>,
    renewed: BTreeSet<u32>,
    springs: Sparse<Spring>,
    near: Near,
    active: Vec<Active>,
    /// True once the state before the first step has been checked.
    checked: bool,
    /// True if the next step takes the particles in reverse order; see [`crate::contact`].
    backwards: bool,
    /// Smallest and largest radius of the whole body \[m\].
    smallest: f64,
    largest: f64,
    /// Gathered particles of all ranks, in a partitioned body; `grains` and `springs` are then those of the
    /// touching particles.
    partition: Option<PartitionState>,
}

impl Obstacle {
    /// Makes an obstacle for the particles of a model. The name appears in reports and errors.
    ///
    /// # Errors
    /// Errors of [`RigidBody::new`] and [`Self::of_body`].
    pub fn new(
        name: &str,
        model: &DemModel,
        shape: RigidShape,
        motion: Motion,
        law: ContactLaw,
    ) -> Result<Self> {
        let body = RigidBody::new(name, shape, motion)?;
        Self::of_body(model, &SharedBody::new(body), law)
    }

    /// Makes an obstacle for the particles of a model from a rigid body that other models may touch as well.
    ///
    /// # Errors
    /// [`arlequin_core::Error::InvalidParameter`] for parameters of the law; [`crate::Error::StartsInside`]
    /// if centres of particles lie inside the shape.
    pub fn of_body(model: &DemModel, body: &SharedBody, law: ContactLaw) -> Result<Self> {
        law.check()?;
        let mut grains = Grains::new(ContactBody::from_model(model));
        // Places are found from displacements, only of the particles near the obstacle.
        grains.now = Vec::new();
        let rigid = body.lock();
        let name = rigid.name().to_owned();
        start::check(
            &name,
            rigid.shape(),
            &rigid.first_displacement(),
            &grains.rest_spheres,
        )?;
        let allowed = allowed(rigid.shape(), &grains.rest_spheres);
        drop(rigid);
        Ok(Self(Body {
            name,
            host: model.name().to_owned(),
            body: body.clone(),
            share: 0,
            allowed,
            gained: Vec::new(),
            renewed: BTreeSet::new(),
            partition: None,
            springs: Sparse::new(grains.len()),
            near: Near::new(&grains.rest_spheres),
            active: Vec::new(),
            checked: false,
            backwards: false,
            largest: grains.largest(),
            smallest: grains.rest_spheres.iter().fold(f64::INFINITY, |m, s| m.min(s[3])),
            law: BudgetedLaw::new(law),
            grains,
        }))
    }

    /// Sets the angular velocity at time zero \[rad/s\].
    ///
    /// # Errors
    /// Errors of [`RigidBody::set_spin`].
    pub fn with_spin(self, spin: Vector3<f64>) -> Result<Self> {
        self.0.body.lock().set_spin(spin)?;
        Ok(self)
    }

    /// Adds a field of acceleration `field time(t)` \[m/s²\], for example gravity, in which a free body
    /// falls. Driven obstacles ignore it.
    #[must_use]
    pub fn with_acceleration(self, field: Vector3<f64>, time: TimeFunction<f64>) -> Self {
        self.0.body.lock().add_acceleration(field, time);
        self
    }
}

impl Body {
    /// Returns an error if the obstacle has moved by more than the smallest radius in the last step.
    fn check_way(&self, rigid: &RigidBody, instant: &Instant<'_, f64>) -> arlequin_core::Result<()> {
        let step = rigid.way().norm();
        if instant.dt > 0.0 && step > self.smallest {
            return Err(arlequin_core::invalid(
                &format!("step of obstacle '{}'", self.name),
                format_args!("{step:e} m"),
                &format!(
                    "must stay below the smallest particle radius {:e} m, or it would jump over particles; shorten the \
                     time step or slow it down",
                    self.smallest
                ),
            ));
        }
        Ok(())
    }

    /// Returns an error if the centre of a particle has sunk by half of the obstacle's depth.
    fn check_depth(&self, x: &Point3<f64>, depth: f64, rigid: &RigidBody) -> arlequin_core::Result<()> {
        let limit = 0.5 * rigid.shape().depth();
        if depth <= limit {
            return Ok(());
        }
        Err(arlequin_core::invalid(
            &format!(
                "depth of a particle at ({:.3e}, {:.3e}, {:.3e}) m in obstacle '{}'",
                x.x, x.y, x.z, self.name
            ),
            format_args!("{depth:.3e} m"),
            &format!(
                "must stay below {limit:.3e} m, half the depth of the obstacle, or it may pass through: enlarge the modulus of the \
                 contact"
            ),
        ))
    }

    /// Corrects the budgets for the work of forces in the last step that were unknown when contacts were
    /// computed, and of a driven obstacle that a relaxation holds still.
    fn settle_budgets(&mut self, rigid: &RigidBody, instant: &Instant<'_, f64>) {
        for a in &self.active {
            let i = a.particle as usize;
            let power = contact::power(instant.v_half, i, &a.force, &a.torque);
            let excess = power + rigid.driven_power(&a.force, None) - a.expected;
            if rigid.is_shared() && self.law.begun {
                self.springs.get_mut(i).settle(instant.dt, excess, a.force.norm());
            } else {
                self.springs.get_mut(i).budget -= 0.5 * instant.dt * excess;
            }
        }
    }

    fn pair(
        &self,
        rigid: &RigidBody,
        i: usize,
        gap: f64,
        distance: f64,
        normal: Vector3<f64>,
        instant: &Instant<'_, f64>,
    ) -> Pair {
        let r = self.grains.rest_spheres[i][3];
        let [wide, narrow] = flat(r);
        let [linear, angular] = rigid.velocity();
        Pair {
            normal,
            gap,
            stiffness: self.law.law.stiffness(flat(r)),
            reduced_radius: wide * narrow / (wide + narrow),
            // Distances to the surface from both centres, so that the two torques balance the moment of the
            // force.
            arms: rigid
                .turning()
                .map_or([0.0, r - gap], |(radius, _)| [radius, distance]),
            share: self.grains.share(i),
            inverse_mass: self.grains.inverse_mass(i) + rigid.inverse_inertia()[0],
            motion: [Twist { linear, angular }, self.grains.motion(instant, i)],
        }
    }

    /// Lets contacts of particles that have gained weight begin anew, without a force: the place at which a
    /// particle wakes, and the stiffness that it gains, must not load a spring that took in no work.
    fn begin_anew(&mut self, rigid: &RigidBody, u: &[f64]) {
        for i in std::mem::take(&mut self.gained) {
            let (k, sphere) = (i as usize, self.grains.rest_spheres[i as usize]);
            let (distance, _) = rigid
                .shape()
                .distance(&near::place(&sphere, u, k), &rigid.moved());
            if distance - sphere[3] < self.allowed[k] {
                self.allowed[k] = distance - sphere[3];
                self.renewed.insert(i);
            }
            self.springs.take(k);
        }
    }

    /// Computes the contacts with the listed near particles.
    fn respond(
        &mut self,
        rigid: &mut RigidBody,
        instant: &Instant<'_, f64>,
        f: &mut [f64],
    ) -> arlequin_core::Result<()> {
        let u = &instant.q[..3 * self.grains.len()];
        self.begin_anew(rigid, u);
        // A particle off the list cannot touch: its contact starts anew when it returns.
        let lost = |i: usize| {
            self.springs.take(i);
        };
        let rest_spheres = &self.grains.rest_spheres;
        self.near
            .refresh(rigid.shape(), &rigid.moved(), u, rest_spheres, lost);
        let near = std::mem::take(&mut self.near.particles);
        let done = self.act_on(&near, rigid, instant, f);
        self.near.particles = near;
        done
    }

    /// Computes the contacts with the given particles, which must include all that touch the obstacle.
    fn act_on(
        &mut self,
        particles: &[u32],
        rigid: &mut RigidBody,
        instant: &Instant<'_, f64>,
        f: &mut [f64],
    ) -> arlequin_core::Result<()> {
        self.active.clear();
        self.law.begin(instant.dt);
        let u = &instant.q[..3 * self.grains.len()];
        let count = particles.len();
        for n in 0..count {
            let n = if self.backwards { count - 1 - n } else { n };
            let i = particles[n] as usize;
            let sphere = self.grains.rest_spheres[i];
            let centre = near::place(&sphere, u, i);
            let (distance, normal) = rigid.shape().distance(&centre, &rigid.moved());
            let gap = sphere[3] + self.allowed[i] - distance;
            if gap > 0.0 && self.grains.is_awake(i as u32) {
                self.check_depth(&centre, -distance, rigid)?;
                let pair = self.pair(rigid, i, gap, distance, normal, instant);
                self.close(i, &pair, rigid, instant, f);
            } else {
                self.springs.take(i);
            }
        }
        self.law.end(instant.dt);
        self.backwards = !self.backwards;
        if instant.dt > 0.0 {
            let obstacle = rigid.end(instant);
            for a in &mut self.active {
                let particle = self.grains.end(instant, f, a.particle as usize);
                let driven = rigid.driven_power(&a.force, Some(&obstacle));
                a.expected = particle.power(&a.force, &a.torque) + driven;
            }
        }
        for a in &self.active {
            self.grains.deliver(a.particle as usize, f);
        }
        Ok(())
    }

    fn close(&mut self, i: usize, pair: &Pair, rigid: &mut RigidBody, instant: &Instant<'_, f64>, f: &[f64]) {
        let obstacle: Option<End> = (instant.dt > 0.0).then(|| rigid.end(instant));
        let grains = &self.grains;
        let ends = || [obstacle.unwrap_or_default(), grains.end(instant, f, i)];
        let turns = rigid.turning().is_some();
        let r = self
            .law
            .respond(pair, turns, ends, instant.dt, self.springs.get_mut(i));
        self.grains.push(i, &r.force, &r.torque[1]);
        rigid.push(self.share, &-r.force, &r.torque[0]);
        self.active.push(Active {
            particle: i as u32,
            force: r.force,
            torque: r.torque[1],
            stored: r.stored,
            expected: 0.0,
        });
    }
}

impl EffectSpec<f64> for Obstacle {
    fn attach(mut self: Box<Self>, host: &Host<'_, f64>) -> arlequin_core::Result<Box<dyn Effect<f64>>> {
        let effect = format!("obstacle '{}'", self.0.name);
        let owned = host.owned()?;
        self.0.share = self.0.body.join();
        if owned.is_part() {
            self.0.restrict(owned, host, &effect)?;
            return Ok(Box::new(self.0));
        }
        self.0.grains.attach(host, &effect)?;
        Ok(Box::new(self.0))
    }
}

impl AnyEffect<f64> for Body {
    fn name(&self) -> &str {
        &self.name
    }

    fn stored(&self) -> f64 {
        self.active.iter().fold(0.0, |sum, a| sum + a.stored)
    }

    fn supplied(&self) -> Option<f64> {
        Some(self.law.supplied + self.body.lock().supplied(self.share))
    }

    fn saves_whole(&self) -> bool {
        true
    }

    fn save(&self) -> Record<f64> {
        self.recorded()
    }

    fn restore(&mut self, from: &Record<f64>) -> arlequin_core::Result<()> {
        self.recall(from)
    }

    fn rigid(&self) -> Option<RigidMotion<f64>> {
        Some(self.body.lock().motion())
    }

    fn facts(&self) -> Vec<(String, f64)> {
        let mut out = self.body.lock().facts();
        out.push(("contacts".into(), self.active.len() as f64));
        out
    }
}

impl Effect<f64> for Body {
    fn add_forces(&mut self, instant: &Instant<'_, f64>, f: &mut [f64]) -> arlequin_core::Result<()> {
        let shared = self.body.clone();
        let mut rigid = shared.lock();
        rigid.begin(self.share, instant)?;
        self.check_way(&rigid, instant)?;
        self.check_start(&rigid, instant.q)?;
        match self.partition.take() {
            Some(mut partition) => {
                let done = self.respond_partitioned(&mut partition, &mut rigid, instant, f);
                self.partition = Some(partition);
                done?;
            }
            None => {
                self.settle_budgets(&rigid, instant);
                self.respond(&mut rigid, instant, f)?;
            }
        }
        rigid.finish(self.share, instant);
        Ok(())
    }

    /// Power on the particles; in a partitioned body, on the owned particles \[W\].
    fn power(&self, v: &[f64]) -> f64 {
        let contacts = self.pushed();
        contacts
            .map(|(i, a)| contact::power(v, i, &a.force, &a.torque))
            .sum()
    }

    fn add_power(&self, _: &DofLayout, v: &[f64], sum: &mut Exact) -> bool {
        let contacts = self.pushed();
        contacts.for_each(|(i, a)| sum.add(contact::power(v, i, &a.force, &a.torque)));
        true
    }

    fn add_contact(&self, f: &mut [f64]) -> bool {
        let contacts = self.pushed();
        contacts.for_each(|(i, a)| contact::add(f, i, &a.force, &a.torque));
        true
    }

    fn reweigh(&mut self, host: &Host<'_, f64>) -> arlequin_core::Result<()> {
        let effect = format!("obstacle '{}'", self.name);
        let before = self.grains.shares();
        self.grains.attach(host, &effect)?;
        self.gained.extend(self.grains.gained(&before));
        let body = self.body.clone();
        let mut rigid = body.lock();
        // As at a surface: what has become light would be thrown by a kept force.
        self.active.retain_mut(|a| {
            let i = a.particle as usize;
            let part = (self.grains.share(i) / before[i]).min(1.0);
            rigid.push(self.share, &(a.force * (0.5 * (1.0 - part))), &Vector3::zeros());
            (a.force, a.torque, a.stored) = (a.force * part, a.torque * part, a.stored * part);
            part > 0.0
        });
        Ok(())
    }

    fn step_demand(&self) -> StepDemand<f64> {
        let against_flat = |r: f64| self.law.law.stiffness(flat(r));
        let mut top = self.owned().1.top(against_flat);
        let rigid = self.body.lock();
        if let Some(mass) = rigid.mass() {
            // A body lighter than the particles is the softer end of the spring. Sliding also rotates a ball
            // of any inertia, while the factor 3.5 in the law's demand is for a full ball.
            let slide = rigid
                .turning()
                .map_or(0.0, |(r, inertia)| (1.0 / mass + r * r / inertia) / 3.5);
            top = top.max(against_flat(self.largest) * slide.max(1.0 / mass));
        }
        let [stiffness, damping] = self.law.law.demand(top);
        StepDemand {
            stiffness: stiffness + 2.0 * rigid.spring_rate(),
            damping,
            ..StepDemand::none()
        }
    }
}

/// Gap of each particle at rest if it overlaps the shape (negative), else zero \[m\].
fn allowed(shape: &RigidShape, spheres: &[Sphere]) -> Vec<f64> {
    let gap = |s: &Sphere| (shape.distance(&centre(s), &Vector3::zeros()).0 - s[3]).min(0.0);
    spheres.iter().map(gap).collect()
}

/// Radii of a particle and of a partner so large that its surface is flat.
fn flat(r: f64) -> [f64; 2] {
    [1e12 * r, r]
}

fn centre(s: &Sphere) -> Point3<f64> {
    Point3::new(s[0], s[1], s[2])
}
