//! Rigid bodies that particles run into: planes, spheres, cylinders; at rest, driven, or free with a mass of their own.
//!
//! The contact law is that of [`crate::contact`] with the obstacle as a sphere of infinite radius, so a particle of
//! radius `r` has the stiffness `2 E r`. A particle that overlaps the obstacle at rest pushes only from there on.
//!
//! A free body is moved by the same velocity Verlet as everything else. A free ball turns as well: friction acts at its
//! surface, so that the angular momentum of particles and ball is kept. Planes and cylinders have no centre that could be
//! told from the shape, and do not turn. What an obstacle gives to the particles and their springs is its `supplied`
//! energy: the work of what drives it, or its own kinetic energy.

mod near;
mod shape;

pub use shape::{Motion, Shape};

use crate::bond::Twist;
use crate::contact::{ContactLaw, Pair, Spring, masses};
use crate::error::{Result, positive};
use crate::finite;
use crate::model::DemModel;
use arlequin_core::effect::{Demand, Effect, Instant, Site};
use arlequin_core::snapshot::Record;
use nalgebra::{Point3, Vector3};
use near::Near;

/// Where an obstacle pushed in the last step.
#[derive(Debug, Clone, Copy)]
struct Active {
    particle: u32,
    /// Force on the particle (N).
    force: Vector3<f64>,
    /// Generalised torque on it (N m).
    torque: Vector3<f64>,
    stored: f64,
}

/// A rigid obstacle, an effect on one cohesive-beam body.
#[derive(Debug)]
pub struct Obstacle {
    name: String,
    shape: Shape,
    motion: Motion,
    law: ContactLaw,
    damping_ratio: f64,
    finite: bool,
    rest: Vec<Point3<f64>>,
    radii: Vec<f64>,
    full: Vec<f64>,
    share: Vec<f64>,
    mass: Vec<f64>,
    /// Gap of each particle at rest where that is an overlap, zero otherwise.
    allowed: Vec<f64>,
    springs: Vec<Spring>,
    near: Near,
    active: Vec<Active>,
    started: bool,
    /// Radius and moment of inertia, if it turns.
    turning: Option<(f64, f64)>,
    /// Angular velocity half a step earlier (rad/s), torque of the particles on it (N m).
    spin: Vector3<f64>,
    torque: Vector3<f64>,
    /// Displacement, velocity half a step earlier, force of the particles on the obstacle.
    moved: Vector3<f64>,
    velocity: Vector3<f64>,
    reaction: Vector3<f64>,
    supplied: f64,
    /// Half of what the last instant supplied: the half step still to come.
    pending: f64,
    first_energy: f64,
    peak: f64,
    smallest: f64,
}

impl Obstacle {
    /// An obstacle for the particles of a model, with a name for reports.
    ///
    /// # Errors
    /// [`crate::DemError::OutOfRange`] for parameters that make no sense.
    pub fn new(name: &str, model: &DemModel, shape: Shape, motion: Motion, law: ContactLaw) -> Result<Self> {
        law.check()?;
        let shape = shape.checked()?;
        if let Motion::Free { mass, .. } = &motion {
            positive("mass of a free obstacle", *mass)?;
        }
        let turning = shape.turning(&motion)?;
        let body = model.body();
        let rest: Vec<Point3<f64>> = body.positions().iter().map(|x| Point3::from(*x)).collect();
        let radii = body.radii().to_vec();
        let allowed = rest
            .iter()
            .zip(&radii)
            .map(|(x, r)| (shape.distance(x, &Vector3::zeros()).0 - r).min(0.0))
            .collect();
        Ok(Self {
            name: name.to_owned(),
            finite: model.has_finite_rotations(),
            full: model.masses().to_vec(),
            share: Vec::new(),
            mass: Vec::new(),
            allowed,
            springs: vec![Spring::default(); rest.len()],
            near: Near::new(&radii),
            active: Vec::new(),
            started: false,
            turning,
            spin: Vector3::zeros(),
            torque: Vector3::zeros(),
            moved: Vector3::zeros(),
            velocity: motion.first_velocity(),
            reaction: Vector3::zeros(),
            supplied: 0.0,
            pending: 0.0,
            first_energy: 0.0,
            peak: 0.0,
            smallest: radii.iter().fold(f64::INFINITY, |m, r| m.min(*r)),
            shape,
            motion,
            damping_ratio: law.damping_ratio(),
            law,
            rest,
            radii,
        })
    }

    /// How often all particles were searched for those near it.
    #[must_use]
    pub fn searches(&self) -> usize {
        self.near.searches
    }

    /// Angular velocity of a free ball half a step ago (rad/s); zero for all others.
    #[must_use]
    pub fn spin(&self) -> Vector3<f64> {
        self.spin
    }

    /// Moves the obstacle to the new instant.
    fn advance(&mut self, at: &Instant<'_, f64>) -> arlequin_core::Result<()> {
        let before = self.moved;
        match &self.motion {
            Motion::Free { mass, .. } => {
                if at.dt > 0.0 {
                    let kick = if self.started { at.dt } else { 0.5 * at.dt };
                    self.velocity += self.reaction * (kick / mass);
                    if let Some((_, inertia)) = self.turning {
                        self.spin += self.torque * (kick / inertia);
                    }
                    if !self.started {
                        self.first_energy = self.kinetic(*mass, &self.velocity, &self.spin);
                    }
                    self.moved += self.velocity * at.dt;
                    self.started = true;
                }
            }
            driven => {
                self.moved = driven.displacement(at.time);
                if at.dt > 0.0 {
                    self.velocity = (self.moved - before) / at.dt;
                }
            }
        }
        let step = (self.moved - before).norm();
        if at.dt > 0.0 && step > self.smallest {
            return Err(arlequin_core::error::invalid(
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

    fn kinetic(&self, mass: f64, velocity: &Vector3<f64>, spin: &Vector3<f64>) -> f64 {
        let turning = self
            .turning
            .map_or(0.0, |(_, inertia)| inertia * spin.norm_squared());
        0.5 * (mass * velocity.norm_squared() + turning)
    }

    fn pair(&self, i: usize, [gap, distance]: [f64; 2], normal: Vector3<f64>, at: &Instant<'_, f64>) -> Pair {
        let turn = at.q.len() / 2;
        let three = |x: &[f64], k: usize| Vector3::new(x[k], x[k + 1], x[k + 2]);
        let rate = three(at.v_half, turn + 3 * i);
        let particle = Twist {
            linear: three(at.v_half, 3 * i),
            angular: if self.finite {
                finite::spin(&three(at.q, turn + 3 * i), &rate)
            } else {
                rate
            },
        };
        let heavy = match &self.motion {
            Motion::Free { mass, .. } => 1.0 / mass,
            _ => 0.0,
        };
        let r = self.radii[i];
        Pair {
            normal,
            gap,
            // A partner so large that it is flat.
            radii: [1e12 * r, r],
            // To the surface from either side, so that the two torques balance the moment of the force.
            arms: self
                .turning
                .map_or([0.0, r - gap], |(radius, _)| [radius, distance]),
            share: self.share[i],
            inverse_mass: 1.0 / self.mass[i] + heavy,
            motion: [
                Twist {
                    linear: self.velocity,
                    angular: self.spin,
                },
                particle,
            ],
        }
    }

    fn respond(&mut self, at: &Instant<'_, f64>, f: &mut [f64]) {
        let turn = f.len() / 2;
        self.active.clear();
        (self.reaction, self.torque) = (Vector3::zeros(), Vector3::zeros());
        let springs = &mut self.springs;
        let lost = |i: usize| {
            if springs[i].on {
                springs[i] = Spring::default();
            }
        };
        let rest = (&self.rest[..], &self.radii[..]);
        self.near
            .refresh(&self.shape, &self.moved, &at.q[..turn], rest, lost);
        for k in 0..self.near.particles.len() {
            let i = self.near.particles[k] as usize;
            let u = Vector3::new(at.q[3 * i], at.q[3 * i + 1], at.q[3 * i + 2]);
            let (distance, normal) = self.shape.distance(&(self.rest[i] + u), &self.moved);
            let gap = self.radii[i] + self.allowed[i] - distance;
            if gap <= 0.0 {
                if self.springs[i].on {
                    self.springs[i] = Spring::default();
                }
                continue;
            }
            let pair = self.pair(i, [gap, distance], normal, at);
            let r = self
                .law
                .respond(&pair, self.damping_ratio, at.dt, &mut self.springs[i]);
            let mut torque = r.torque[1];
            if self.finite {
                let o = turn + 3 * i;
                let th = Vector3::new(at.q[o], at.q[o + 1], at.q[o + 2]);
                torque = finite::generalised(&th, &torque);
            }
            for c in 0..3 {
                f[3 * i + c] += r.force[c];
                f[turn + 3 * i + c] += torque[c];
            }
            self.reaction -= r.force;
            self.torque += r.torque[0];
            self.active.push(Active {
                particle: i as u32,
                force: r.force,
                torque,
                stored: r.stored,
            });
        }
        self.peak = self.peak.max(self.reaction.norm());
    }

    /// Energy given to particles and springs so far, this instant included.
    fn settle(&mut self, at: &Instant<'_, f64>) {
        if at.dt <= 0.0 {
            return;
        }
        match &self.motion {
            Motion::Free { mass, .. } => {
                let next = self.velocity + self.reaction * (at.dt / mass);
                let spin = self.turning.map_or(self.spin, |(_, inertia)| {
                    self.spin + self.torque * (at.dt / inertia)
                });
                let after = self.kinetic(*mass, &next, &spin);
                self.supplied = self.first_energy - after;
                self.pending = 0.5 * (self.kinetic(*mass, &self.velocity, &self.spin) - after);
            }
            driven => {
                // The force of this instant works on the mean of the two velocities around it.
                let next = driven.displacement(at.time + at.dt) - self.moved;
                let mean = (self.velocity * at.dt + next) * 0.5;
                let work = -self.reaction.dot(&mean);
                self.supplied += work;
                self.pending = 0.5 * work;
            }
        }
    }
}

impl Effect<f64> for Obstacle {
    fn name(&self) -> &str {
        &self.name
    }

    fn attach(&mut self, site: &Site<'_, f64>) -> arlequin_core::Result<()> {
        (self.mass, self.share) = masses(site, &format!("obstacle '{}'", self.name), &self.full)?;
        Ok(())
    }

    fn add_forces(&mut self, at: &Instant<'_, f64>, f: &mut [f64]) -> arlequin_core::Result<()> {
        self.advance(at)?;
        self.respond(at, f);
        self.settle(at);
        Ok(())
    }

    /// Integers: whether it started, and the state of each contact. Numbers: its motion and balance, then the springs.
    fn save(&self) -> Record<f64> {
        let mut out = Record::default();
        out.integers.push(u64::from(self.started));
        for v in [self.moved, self.velocity, self.reaction, self.spin, self.torque] {
            out.numbers.extend(v.iter());
        }
        out.numbers
            .extend([self.supplied, self.pending, self.first_energy, self.peak]);
        for s in &self.springs {
            out.integers.push(u64::from(s.on));
            out.numbers.extend(s.numbers());
        }
        out
    }

    fn restore(&mut self, from: &Record<f64>) -> arlequin_core::Result<()> {
        let n = self.springs.len();
        from.expect(&format!("obstacle '{}'", self.name), 19 + 6 * n, 1 + n)?;
        let three = |k: usize| Vector3::new(from.numbers[k], from.numbers[k + 1], from.numbers[k + 2]);
        self.started = from.integers[0] == 1;
        [self.moved, self.velocity, self.reaction] = [three(0), three(3), three(6)];
        [self.spin, self.torque] = [three(9), three(12)];
        [self.supplied, self.pending, self.first_energy, self.peak] =
            [15, 16, 17, 18].map(|k: usize| from.numbers[k]);
        let (numbers, _) = from.numbers[19..].as_chunks::<6>();
        for ((s, on), x) in self.springs.iter_mut().zip(&from.integers[1..]).zip(numbers) {
            *s = Spring::from_numbers(*on == 1, *x);
        }
        self.active.clear();
        self.near.clear();
        Ok(())
    }

    fn power(&self, v: &[f64]) -> f64 {
        let turn = v.len() / 2;
        let three = |k: usize| Vector3::new(v[k], v[k + 1], v[k + 2]);
        let of = |a: &Active| {
            let o = 3 * a.particle as usize;
            a.force.dot(&three(o)) + a.torque.dot(&three(turn + o))
        };
        self.active.iter().map(of).sum()
    }

    fn demand(&self) -> Demand<f64> {
        let flat = |r: f64| self.law.stiffness([1e12 * r, r]);
        let masses = self.radii.iter().zip(&self.full);
        let mut top = masses.map(|(r, m)| flat(*r) / m).fold(0.0, f64::max);
        if let Motion::Free { mass, .. } = &self.motion {
            // A body lighter than the particles it meets is the softer end of the spring.
            let largest = self.radii.iter().fold(0.0_f64, |m, r| m.max(*r));
            // Sliding turns a ball of any inertia, the law's own allowance is for full ones.
            let slide = self
                .turning
                .map_or(0.0, |(r, inertia)| (1.0 / mass + r * r / inertia) / 3.5);
            top = top.max(flat(largest) * slide.max(1.0 / mass));
        }
        let [stiffness, damping] = self.law.demand(top);
        Demand {
            stiffness,
            damping,
            ..Demand::none()
        }
    }

    fn stored(&self) -> f64 {
        self.active.iter().map(|a| a.stored).sum()
    }

    fn supplied(&self) -> Option<f64> {
        Some(self.supplied - self.pending)
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
