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
//! The energy that an obstacle gives to particles and their springs is its `supplied` energy: the work of its
//! drive, or a part of its own kinetic energy. No contact gives back more energy than it took in
//! ([`crate::contact`]).

mod near;
mod parts;
mod record;
mod shape;
mod start;

pub use shape::{Motion, RigidShape};

use crate::bond::Twist;
use crate::contact::budget::{BudgetedLaw, End};
use crate::contact::{self, ContactBody, ContactLaw, Grains, Pair, Spring};
use crate::error::{Error, Result, positive};
use crate::model::DemModel;
use crate::packing::cells::Sphere;
use arlequin_core::Exact;
use arlequin_core::effect::{AnyEffect, Effect, EffectSpec, Host, Instant, RigidMotion, StepDemand};
use arlequin_core::snapshot::Record;
use arlequin_core::{DofLayout, Model, TimeFunction};
use nalgebra::{Point3, Vector3};
use near::Near;
use parts::PartitionState;

/// A closed contact of the obstacle and its response in the last step.
#[derive(Debug, Clone, Copy)]
struct Active {
    particle: u32,
    /// Force on the particle \[N\].
    force: Vector3<f64>,
    /// Generalised torque on the particle \[N m\].
    torque: Vector3<f64>,
    /// Torque on the obstacle if it rotates \[N m\].
    back: Vector3<f64>,
    stored: f64,
    /// Power on the velocities of particle and obstacle after the step, from the forces that were known
    /// \[W\].
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
    shape: RigidShape,
    motion: Motion,
    law: BudgetedLaw,
    grains: Grains,
    /// Gap of each particle at rest if it overlaps the obstacle (negative), else zero \[m\].
    allowed: Vec<f64>,
    springs: Vec<Spring>,
    near: Near,
    active: Vec<Active>,
    started: bool,
    /// Radius \[m\] and moment of inertia \[kg m²\] if the obstacle rotates.
    turning: Option<(f64, f64)>,
    /// Angular velocity half a step earlier \[rad/s\] and torque of the particles on the obstacle \[N m\].
    spin: Vector3<f64>,
    torque: Vector3<f64>,
    /// Fields of acceleration \[m/s²\] with their time functions, the force they exert now \[N\], and their
    /// work since the first step \[J\].
    fields: Vec<(Vector3<f64>, TimeFunction<f64>)>,
    weight: Vector3<f64>,
    fallen: f64,
    /// Displacement, velocity half a step earlier, and force of the particles on the obstacle.
    moved: Vector3<f64>,
    velocity: Vector3<f64>,
    reaction: Vector3<f64>,
    supplied: f64,
    /// True once the state before the first step has been checked.
    checked: bool,
    /// True if the next step takes the particles in reverse order; see [`crate::contact`].
    backwards: bool,
    /// Half of the energy supplied at the last instant, which belongs to the half step still to come \[J\].
    pending: f64,
    first_energy: f64,
    peak: f64,
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
    /// [`crate::Error::OutOfRange`] for parameters out of their range; [`crate::Error::StartsInside`] if
    /// centres of particles lie inside the shape.
    pub fn new(
        name: &str,
        model: &DemModel,
        shape: RigidShape,
        motion: Motion,
        law: ContactLaw,
    ) -> Result<Self> {
        law.check()?;
        let shape = shape.checked()?;
        if let Motion::Free { mass, .. } = &motion {
            positive("mass of a free obstacle", *mass)?;
        }
        let turning = shape.turning(&motion)?;
        let grains = Grains::new(ContactBody::from_model(model));
        start::check(name, &shape, &motion.displacement(0.0), &grains.rest_spheres)?;
        let allowed = allowed(&shape, &grains.rest_spheres);
        Ok(Self(Body {
            name: name.to_owned(),
            host: model.name().to_owned(),
            allowed,
            partition: None,
            springs: vec![Spring::default(); grains.len()],
            near: Near::new(&grains.rest_spheres),
            active: Vec::new(),
            started: false,
            turning,
            spin: Vector3::zeros(),
            torque: Vector3::zeros(),
            fields: Vec::new(),
            weight: Vector3::zeros(),
            fallen: 0.0,
            moved: Vector3::zeros(),
            velocity: motion.first_velocity(),
            reaction: Vector3::zeros(),
            supplied: 0.0,
            checked: false,
            backwards: false,
            pending: 0.0,
            first_energy: 0.0,
            peak: 0.0,
            largest: grains.largest(),
            smallest: grains.rest_spheres.iter().fold(f64::INFINITY, |m, s| m.min(s[3])),
            shape,
            motion,
            law: BudgetedLaw::new(law),
            grains,
        }))
    }

    /// Sets the angular velocity at time zero \[rad/s\].
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] for an obstacle other than a free ball, as no other rotates.
    pub fn with_spin(mut self, spin: Vector3<f64>) -> Result<Self> {
        if self.0.turning.is_none() && spin.norm() > 0.0 {
            return Err(Error::out_of_range(
                "spin of an obstacle that does not turn",
                spin.norm(),
                "none: leave it out, or make the obstacle a sphere with a mass",
            ));
        }
        self.0.spin = spin;
        Ok(self)
    }

    /// Adds a field of acceleration `field time(t)` \[m/s²\], for example gravity, in which a free body
    /// falls. Driven obstacles ignore it.
    #[must_use]
    pub fn with_acceleration(mut self, field: Vector3<f64>, time: TimeFunction<f64>) -> Self {
        self.0.fields.push((field, time));
        self
    }
}

impl Body {
    /// Moves the obstacle to the new instant. Returns an error if it moves by more than the smallest radius.
    fn advance(&mut self, instant: &Instant<'_, f64>) -> arlequin_core::Result<()> {
        let before = self.moved;
        match &self.motion {
            Motion::Free { mass, .. } => {
                if instant.dt > 0.0 {
                    // The first velocity is given at an instant, the later ones half a step earlier: the
                    // first kick is half.
                    let kick = if self.started {
                        instant.dt
                    } else {
                        0.5 * instant.dt
                    };
                    self.velocity += (self.reaction + self.weight) * (kick / mass);
                    self.spin += self.torque * (kick * self.inverse_inertia()[1]);
                    if !self.started {
                        self.first_energy = self.kinetic(*mass, &self.velocity, &self.spin);
                    }
                    self.moved += self.velocity * instant.dt;
                    self.started = true;
                }
            }
            driven => {
                self.moved = driven.displacement(instant.time);
                if instant.dt > 0.0 {
                    // The mean over the last step, because stored velocities are those of half a step ago.
                    self.velocity = (self.moved - before) / instant.dt;
                }
            }
        }
        let step = (self.moved - before).norm();
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

    /// Corrects the budgets for the work of forces and motions in the last step that were unknown when
    /// contacts were computed.
    fn settle_budgets(&mut self, instant: &Instant<'_, f64>) {
        for a in &self.active {
            let i = a.particle as usize;
            let obstacle_power = a.back.dot(&self.spin) - a.force.dot(&self.velocity);
            let power = contact::power(instant.v_half, i, &a.force, &a.torque) + obstacle_power;
            self.springs[i].budget -= 0.5 * instant.dt * (power - a.expected);
        }
    }

    fn kinetic(&self, mass: f64, velocity: &Vector3<f64>, spin: &Vector3<f64>) -> f64 {
        let turning = self
            .turning
            .map_or(0.0, |(_, inertia)| inertia * spin.norm_squared());
        0.5 * (mass * velocity.norm_squared() + turning)
    }

    fn pair(
        &self,
        i: usize,
        gap: f64,
        distance: f64,
        normal: Vector3<f64>,
        instant: &Instant<'_, f64>,
    ) -> Pair {
        let r = self.grains.rest_spheres[i][3];
        Pair {
            normal,
            gap,
            // A partner so large that its surface is flat.
            radii: [1e12 * r, r],
            // Distances to the surface from both centres, so that the two torques balance the moment of the
            // force.
            arms: self
                .turning
                .map_or([0.0, r - gap], |(radius, _)| [radius, distance]),
            share: self.grains.share[i],
            inverse_mass: self.grains.inverse_mass(i) + self.inverse_inertia()[0],
            motion: [
                Twist {
                    linear: self.velocity,
                    angular: self.spin,
                },
                self.grains.motion(instant, i),
            ],
        }
    }

    /// Inverse mass (zero for a driven obstacle) and inverse moment of inertia (zero if it does not rotate).
    fn inverse_inertia(&self) -> [f64; 2] {
        let inverse_mass = match &self.motion {
            Motion::Free { mass, .. } => 1.0 / mass,
            _ => 0.0,
        };
        [
            inverse_mass,
            self.turning.map_or(0.0, |(_, inertia)| 1.0 / inertia),
        ]
    }

    /// Force of the fields on a free body at time `t` \[N\].
    fn weight_at(&self, t: f64) -> Vector3<f64> {
        let Motion::Free { mass, .. } = &self.motion else {
            return Vector3::zeros();
        };
        let sum = self.fields.iter().map(|(field, time)| field * time.value(t));
        sum.sum::<Vector3<f64>>() * *mass
    }

    /// Velocity and angular velocity half a step from now, under the contacts computed so far.
    fn next(&self, dt: f64) -> [Vector3<f64>; 2] {
        let [inverse_mass, inverse_moment] = self.inverse_inertia();
        [
            self.velocity + (self.reaction + self.weight) * (dt * inverse_mass),
            self.spin + self.torque * (dt * inverse_moment),
        ]
    }

    /// Velocities of the obstacle during the step, under the contacts computed so far.
    fn end(&self, instant: &Instant<'_, f64>) -> End {
        let (middle, after, spin) = match &self.motion {
            Motion::Free { .. } => {
                let [v, spin] = self.next(instant.dt);
                (v, v, spin)
            }
            driven => {
                // The motion of the next step is known, so that the contact can work on the mean of both
                // velocities.
                let next = (driven.displacement(instant.time + instant.dt) - self.moved) / instant.dt;
                ((self.velocity + next) * 0.5, next, Vector3::zeros())
            }
        };
        let six = |v: Vector3<f64>, w: Vector3<f64>| [v.x, v.y, v.z, w.x, w.y, w.z];
        let [inverse_mass, inverse_moment] = self.inverse_inertia();
        End {
            middle: six(middle, spin),
            after: six(after, spin),
            inverse_inertia: six(Vector3::repeat(inverse_mass), Vector3::repeat(inverse_moment)),
        }
    }

    /// Computes the contacts with the listed near particles.
    fn respond(&mut self, instant: &Instant<'_, f64>, f: &mut [f64]) {
        let springs = &mut self.springs;
        // A particle off the list cannot touch: its contact starts anew when it returns.
        let lost = |i: usize| {
            if springs[i].closed {
                springs[i] = Spring::default();
            }
        };
        let u = &instant.q[..3 * self.grains.len()];
        self.near
            .refresh(&self.shape, &self.moved, u, &self.grains.rest_spheres, lost);
        let near = std::mem::take(&mut self.near.particles);
        self.act_on(&near, instant, f);
        self.near.particles = near;
    }

    /// Computes the contacts with the given particles, which must include all that touch the obstacle.
    fn act_on(&mut self, particles: &[u32], instant: &Instant<'_, f64>, f: &mut [f64]) {
        self.active.clear();
        (self.reaction, self.torque) = (Vector3::zeros(), Vector3::zeros());
        self.weight = self.weight_at(instant.time);
        self.law.begin(instant.dt);
        let u = &instant.q[..3 * self.grains.len()];
        let count = particles.len();
        for n in 0..count {
            let n = if self.backwards { count - 1 - n } else { n };
            let i = particles[n] as usize;
            let sphere = self.grains.rest_spheres[i];
            let (distance, normal) = self.shape.distance(&near::place(&sphere, u, i), &self.moved);
            let gap = sphere[3] + self.allowed[i] - distance;
            if gap > 0.0 {
                self.close(i, gap, distance, normal, instant, f);
            } else if self.springs[i].closed {
                self.springs[i] = Spring::default();
            }
        }
        self.law.end(instant.dt);
        self.backwards = !self.backwards;
        if instant.dt > 0.0 {
            let obstacle = self.end(instant).after;
            for a in &mut self.active {
                let after = self.grains.end(instant, f, a.particle as usize).after;
                let rate = Vector3::new(after[3], after[4], after[5]);
                let approach = [0, 1, 2].map(|c| after[c] - obstacle[c]);
                let spin = Vector3::new(obstacle[3], obstacle[4], obstacle[5]);
                a.expected = a.force.dot(&Vector3::from(approach)) + a.torque.dot(&rate) + a.back.dot(&spin);
            }
        }
        for a in &self.active {
            self.grains.deliver(a.particle as usize, f);
        }
        self.peak = self.peak.max(self.reaction.norm());
    }

    fn close(
        &mut self,
        i: usize,
        gap: f64,
        distance: f64,
        normal: Vector3<f64>,
        instant: &Instant<'_, f64>,
        f: &[f64],
    ) {
        let pair = self.pair(i, gap, distance, normal, instant);
        let obstacle = (instant.dt > 0.0).then(|| self.end(instant));
        let grains = &self.grains;
        let ends = || [obstacle.unwrap_or_default(), grains.end(instant, f, i)];
        let turns = self.turning.is_some();
        let r = self
            .law
            .respond(&pair, turns, ends, instant.dt, &mut self.springs[i]);
        self.grains.push(i, &r.force, &r.torque[1]);
        self.reaction -= r.force;
        self.torque += r.torque[0];
        self.active.push(Active {
            particle: i as u32,
            force: r.force,
            torque: r.torque[1],
            back: r.torque[0],
            stored: r.stored,
            expected: 0.0,
        });
    }

    /// Updates the energy supplied to particles and springs, including this instant.
    fn settle(&mut self, instant: &Instant<'_, f64>) {
        if instant.dt <= 0.0 {
            return;
        }
        match &self.motion {
            Motion::Free { mass, .. } => {
                let [next, spin] = self.next(instant.dt);
                let after = self.kinetic(*mass, &next, &spin);
                // Energy that the fields gave to the body was not lost to the particles.
                let fallen = 0.5 * instant.dt * self.weight.dot(&(self.velocity + next));
                self.fallen += fallen;
                self.supplied = self.first_energy + self.fallen - after;
                let before = self.kinetic(*mass, &self.velocity, &self.spin);
                self.pending = 0.5 * (before + fallen - after);
            }
            driven => {
                // The force of this instant works on the mean of the two velocities around it.
                let next = driven.displacement(instant.time + instant.dt) - self.moved;
                let mean = (self.velocity * instant.dt + next) * 0.5;
                let work = -self.reaction.dot(&mean);
                self.supplied += work;
                self.pending = 0.5 * work;
            }
        }
    }
}

impl EffectSpec<f64> for Obstacle {
    fn attach(mut self: Box<Self>, host: &Host<'_, f64>) -> arlequin_core::Result<Box<dyn Effect<f64>>> {
        let effect = format!("obstacle '{}'", self.0.name);
        let owned = host.owned()?;
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
        Some(self.law.supplied + self.supplied - self.pending)
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
        Some(RigidMotion {
            displacement: self.moved,
            velocity: self.velocity,
            spin: self.spin,
        })
    }

    fn facts(&self) -> Vec<(String, f64)> {
        let mut out = Vec::new();
        for (c, axis) in ["x", "y", "z"].iter().enumerate() {
            out.push((format!("displacement {axis} [m]"), self.moved[c]));
            out.push((format!("velocity {axis} [m/s]"), self.velocity[c]));
            out.push((format!("force on it {axis} [N]"), self.reaction[c]));
        }
        if self.turning.is_some() {
            for (c, axis) in ["x", "y", "z"].iter().enumerate() {
                out.push((format!("spin {axis} [rad/s]"), self.spin[c]));
            }
        }
        out.push(("largest force [N]".into(), self.peak));
        out.push(("contacts".into(), self.active.len() as f64));
        out
    }
}

impl Effect<f64> for Body {
    fn add_forces(&mut self, instant: &Instant<'_, f64>, f: &mut [f64]) -> arlequin_core::Result<()> {
        self.advance(instant)?;
        self.check_start(instant.q)?;
        match self.partition.take() {
            Some(mut partition) => {
                let done = self.respond_partitioned(&mut partition, instant, f);
                self.partition = Some(partition);
                done?;
            }
            None => {
                self.settle_budgets(instant);
                self.respond(instant, f);
            }
        }
        self.settle(instant);
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

    fn step_demand(&self) -> StepDemand<f64> {
        let flat = |r: f64| self.law.law.stiffness([1e12 * r, r]);
        let mut top = self.owned().1.top(flat);
        if let Motion::Free { mass, .. } = &self.motion {
            // A body lighter than the particles is the softer end of the spring. Sliding also rotates a ball
            // of any inertia, while the factor 3.5 in the law's demand is for a full ball.
            let slide = self
                .turning
                .map_or(0.0, |(r, inertia)| (1.0 / mass + r * r / inertia) / 3.5);
            top = top.max(flat(self.largest) * slide.max(1.0 / mass));
        }
        let [stiffness, damping] = self.law.law.demand(top);
        StepDemand {
            stiffness,
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

fn centre(s: &Sphere) -> Point3<f64> {
    Point3::new(s[0], s[1], s[2])
}
