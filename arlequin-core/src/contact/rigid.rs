//! A rigid body that models touch: at rest, driven, or free with a mass.
//!
//! A free body moves by velocity Verlet like the nodes of all models. A free ball also turns, by the moment
//! of friction about its centre. Several models may touch one free body ([`SharedBody`]): it moves under the
//! sum of their forces, so they must make steps of the same length. A spring may hold it to its place.
//!
//! The energy that the body gives to a model and the springs of its contacts is its `supplied` energy: the
//! work of its drive, or a part of its own kinetic energy. The models take the body one after the other: the
//! forces `F_1, F_2, ...` of an instant give it `dt F_k.(v_- + dt/m (W + F_1 + ... + F_(k-1) + F_k/2))`, with
//! the fields `W`. These works sum to the change of its kinetic energy, and each is known when its model is
//! computed, so the budgets of no model need the forces of those that come later.

use super::{End, Motion, RigidShape, positive};
use crate::effect::{Instant, RigidMotion};
use crate::error::invalid;
use crate::record::Record;
use crate::{Result, TimeFunction};
use nalgebra::Vector3;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Force and energy between the body and one model that touches it.
#[derive(Debug, Clone, Copy, Default)]
struct Share {
    /// True once the model has been computed at the present instant.
    called: bool,
    /// Force \[N\] and torque \[N m\] of the model on the body at this instant.
    force: Vector3<f64>,
    torque: Vector3<f64>,
    /// Energy given to the model \[J\]; the half that belongs to the half step still to come.
    supplied: f64,
    pending: f64,
}

/// A rigid body with its motion.
#[derive(Debug)]
pub struct RigidBody {
    name: String,
    shape: RigidShape,
    motion: Motion,
    /// Radius \[m\] and moment of inertia \[kg m²\] if the body rotates.
    turning: Option<(f64, f64)>,
    /// Fields of acceleration \[m/s²\] with their time functions.
    fields: Vec<(Vector3<f64>, TimeFunction<f64>)>,
    started: bool,
    /// Displacement \[m\]; velocity \[m/s\] and angular velocity \[rad/s\] half a step earlier.
    moved: Vector3<f64>,
    velocity: Vector3<f64>,
    spin: Vector3<f64>,
    /// Stiffness of the spring that holds a free body to its place \[N/m\].
    spring: f64,
    /// Force \[N\] and torque \[N m\] of the models so far on the body, and the force of fields and spring
    /// \[N\].
    reaction: Vector3<f64>,
    torque: Vector3<f64>,
    weight: Vector3<f64>,
    /// Largest force \[N\].
    peak: f64,
    /// Displacement in the last step \[m\].
    way: Vector3<f64>,
    shares: Vec<Share>,
}

/// A rigid body that one or several models touch.
#[derive(Debug, Clone)]
pub struct SharedBody(Arc<Mutex<RigidBody>>);

impl SharedBody {
    /// Makes a body that models can join.
    #[must_use]
    pub fn new(body: RigidBody) -> Self {
        Self(Arc::new(Mutex::new(body)))
    }

    /// Returns the body, for as long as the guard lives.
    pub fn lock(&self) -> MutexGuard<'_, RigidBody> {
        // A panic elsewhere ends the run; until then the state is whole, as no method stops halfway.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds a model that touches the body and returns its number.
    #[must_use]
    pub fn join(&self) -> usize {
        let mut body = self.lock();
        // As if computed, so that the first call of any model begins the first instant.
        body.shares.push(Share {
            called: true,
            ..Share::default()
        });
        body.shares.len() - 1
    }
}

impl RigidBody {
    /// Count of numbers that [`Self::save`] writes.
    pub const NUMBERS: usize = 27;

    /// Makes a body. The name appears in reports and errors.
    ///
    /// # Errors
    /// [`crate::Error::InvalidParameter`] for parameters out of their range.
    pub fn new(name: &str, shape: RigidShape, motion: Motion) -> Result<Self> {
        let shape = shape.checked()?;
        if let Motion::Free { mass, .. } = &motion {
            positive("mass of a free obstacle", *mass)?;
        }
        Ok(Self {
            name: name.to_owned(),
            turning: shape.turning(&motion)?,
            velocity: motion.first_velocity(),
            shape,
            motion,
            fields: Vec::new(),
            started: false,
            moved: Vector3::zeros(),
            spin: Vector3::zeros(),
            reaction: Vector3::zeros(),
            torque: Vector3::zeros(),
            weight: Vector3::zeros(),
            spring: 0.0,
            peak: 0.0,
            way: Vector3::zeros(),
            shares: Vec::new(),
        })
    }

    /// Sets the angular velocity at time zero \[rad/s\].
    ///
    /// # Errors
    /// [`crate::Error::InvalidParameter`] for a body other than a free ball, as no other rotates.
    pub fn set_spin(&mut self, spin: Vector3<f64>) -> Result<()> {
        if self.turning.is_none() && spin.norm() > 0.0 {
            let rule = "must be left out, or make the obstacle a sphere with a mass";
            return Err(invalid(
                "spin of an obstacle that does not turn",
                spin.norm(),
                rule,
            ));
        }
        self.spin = spin;
        Ok(())
    }

    /// Holds a free body to its initial position by a spring of this stiffness \[N/m\] in all directions.
    ///
    /// # Errors
    /// [`crate::Error::InvalidParameter`] for a body that is not free, and for a stiffness that is not
    /// positive.
    pub fn set_spring(&mut self, stiffness: f64) -> Result<()> {
        positive("spring of an obstacle", stiffness)?;
        if self.mass().is_none() {
            let rule = "must be left out, or give the obstacle a mass";
            return Err(invalid("spring of an obstacle without a mass", stiffness, rule));
        }
        self.spring = stiffness;
        Ok(())
    }

    /// Returns the square of the frequency of a free body on its spring \[1/s²\]; zero without a spring.
    #[must_use]
    pub fn spring_rate(&self) -> f64 {
        self.mass().map_or(0.0, |mass| self.spring / mass)
    }

    /// Power \[W\] of a force on a model that a driven body touches, on the velocity of that body: at
    /// present, or after the step with `end`. A relaxation holds the body still, which its motion in time
    /// does not say. Zero for a free body, whose kinetic energy has it.
    #[must_use]
    pub fn driven_power(&self, force: &Vector3<f64>, end: Option<&End>) -> f64 {
        if self.mass().is_some() {
            return 0.0;
        }
        let velocity = end.map_or(self.velocity, |e| {
            Vector3::new(e.after[0], e.after[1], e.after[2])
        });
        -force.dot(&velocity)
    }

    /// Returns whether several models touch the body.
    #[must_use]
    pub fn is_shared(&self) -> bool {
        self.shares.len() > 1
    }

    /// Adds a field of acceleration `field time(t)` \[m/s²\], for example gravity, in which a free body
    /// falls. Driven bodies ignore it.
    pub fn add_acceleration(&mut self, field: Vector3<f64>, time: TimeFunction<f64>) {
        self.fields.push((field, time));
    }

    /// Name in reports.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Shape in the initial position.
    #[must_use]
    pub fn shape(&self) -> &RigidShape {
        &self.shape
    }

    /// Displacement since the start \[m\].
    #[must_use]
    pub fn moved(&self) -> Vector3<f64> {
        self.moved
    }

    /// Displacement at time zero \[m\].
    #[must_use]
    pub fn first_displacement(&self) -> Vector3<f64> {
        self.motion.displacement(0.0)
    }

    /// Velocity and angular velocity half a step earlier.
    #[must_use]
    pub fn velocity(&self) -> [Vector3<f64>; 2] {
        [self.velocity, self.spin]
    }

    /// Displacement in the last step \[m\].
    #[must_use]
    pub fn way(&self) -> Vector3<f64> {
        self.way
    }

    /// Radius \[m\] and moment of inertia \[kg m²\] if the body rotates.
    #[must_use]
    pub fn turning(&self) -> Option<(f64, f64)> {
        self.turning
    }

    /// Mass of a free body \[kg\].
    #[must_use]
    pub fn mass(&self) -> Option<f64> {
        match &self.motion {
            Motion::Free { mass, .. } => Some(*mass),
            _ => None,
        }
    }

    /// Position and motion.
    #[must_use]
    pub fn motion(&self) -> RigidMotion<f64> {
        RigidMotion {
            displacement: self.moved,
            velocity: self.velocity,
            spin: self.spin,
        }
    }

    /// Begins the forces of model `share` at an instant. The first model at an instant moves the body there.
    ///
    /// # Errors
    /// [`crate::Error::InvalidParameter`] if the models of a free body make steps of different lengths.
    pub fn begin(&mut self, share: usize, instant: &Instant<'_, f64>) -> Result<()> {
        if self.shares[share].called {
            let missing = self.shares.iter().any(|s| !s.called);
            if missing && instant.dt > 0.0 {
                let what = format!(
                    "steps of the models that the free obstacle '{}' touches",
                    self.name
                );
                let rule =
                    "must be equal, as it moves under the forces of all of them; set their step.ratio to 1";
                return Err(invalid(&what, "of different lengths", rule));
            }
            self.advance(instant);
        }
        let share = &mut self.shares[share];
        share.called = true;
        (share.force, share.torque) = (Vector3::zeros(), Vector3::zeros());
        Ok(())
    }

    /// Moves the body to a new instant.
    fn advance(&mut self, instant: &Instant<'_, f64>) {
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
        self.way = self.moved - before;
        self.shares.iter_mut().for_each(|s| s.called = false);
        (self.reaction, self.torque) = (Vector3::zeros(), Vector3::zeros());
        self.weight = self.weight_at(instant.time) - self.moved * self.spring;
    }

    /// Adds a force \[N\] and a torque \[N m\] of model `share` on the body.
    pub fn push(&mut self, share: usize, force: &Vector3<f64>, torque: &Vector3<f64>) {
        self.reaction += force;
        self.torque += torque;
        self.shares[share].force += force;
        self.shares[share].torque += torque;
    }

    /// Completes the forces of model `share` at an instant: updates the energy supplied.
    pub fn finish(&mut self, share: usize, instant: &Instant<'_, f64>) {
        if self.shares.iter().all(|s| s.called) {
            self.peak = self.peak.max(self.reaction.norm());
        }
        if instant.dt <= 0.0 {
            return;
        }
        let Share { force, torque, .. } = self.shares[share];
        let [way, turn] = match &self.motion {
            Motion::Free { .. } => {
                // Mean of the velocities before and after the forces of this model.
                let [inverse_mass, inverse_moment] = self.inverse_inertia();
                let [velocity, spin] = self.next(instant.dt);
                let half = 0.5 * instant.dt;
                [
                    (velocity - force * (half * inverse_mass)) * instant.dt,
                    (spin - torque * (half * inverse_moment)) * instant.dt,
                ]
            }
            driven => {
                // The force of this instant works on the mean of the two velocities around it.
                let next = driven.displacement(instant.time + instant.dt) - self.moved;
                [(self.velocity * instant.dt + next) * 0.5, Vector3::zeros()]
            }
        };
        let work = -(force.dot(&way) + torque.dot(&turn));
        self.shares[share].supplied += work;
        self.shares[share].pending = 0.5 * work;
    }

    /// Energy \[J\] given to model `share` and its contacts up to this instant.
    #[must_use]
    pub fn supplied(&self, share: usize) -> f64 {
        self.shares[share].supplied - self.shares[share].pending
    }

    /// Inverse mass (zero for a driven body) and inverse moment of inertia (zero if it does not rotate).
    #[must_use]
    pub fn inverse_inertia(&self) -> [f64; 2] {
        [
            self.mass().map_or(0.0, |mass| 1.0 / mass),
            self.turning.map_or(0.0, |(_, inertia)| 1.0 / inertia),
        ]
    }

    /// Force of the fields on a free body at time `t` \[N\].
    fn weight_at(&self, t: f64) -> Vector3<f64> {
        let Some(mass) = self.mass() else {
            return Vector3::zeros();
        };
        let sum = self.fields.iter().map(|(field, time)| field * time.value(t));
        sum.sum::<Vector3<f64>>() * mass
    }

    /// Velocity and angular velocity of a free body half a step from now, under the contacts computed so far.
    fn next(&self, dt: f64) -> [Vector3<f64>; 2] {
        let [inverse_mass, inverse_moment] = self.inverse_inertia();
        [
            self.velocity + (self.reaction + self.weight) * (dt * inverse_mass),
            self.spin + self.torque * (dt * inverse_moment),
        ]
    }

    /// Velocities of the body during the step, under the contacts computed so far.
    #[must_use]
    pub fn end(&self, instant: &Instant<'_, f64>) -> End {
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
            ..End::default()
        }
    }

    /// Figures for reports: names (with units) and values.
    #[must_use]
    pub fn facts(&self) -> Vec<(String, f64)> {
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
        out
    }

    /// Writes one flag to the integers and [`Self::NUMBERS`] numbers: motion, forces and energies, those of
    /// model `share` included.
    pub fn save(&self, share: usize, out: &mut Record<f64>) {
        let own = &self.shares[share];
        out.integers.push(u64::from(self.started));
        let vectors = [
            self.moved,
            self.velocity,
            self.reaction,
            self.spin,
            self.torque,
            self.weight,
            own.force,
            own.torque,
        ];
        out.numbers.extend(vectors.iter().flat_map(|v| v.iter()));
        out.numbers.extend([own.supplied, own.pending, self.peak]);
    }

    /// Restores what [`Self::save`] wrote.
    pub fn restore(&mut self, share: usize, started: u64, numbers: &[f64; Self::NUMBERS]) {
        let three = |k: usize| Vector3::new(numbers[k], numbers[k + 1], numbers[k + 2]);
        self.started = started == 1;
        [self.moved, self.velocity, self.reaction] = [three(0), three(3), three(6)];
        [self.spin, self.torque, self.weight] = [three(9), three(12), three(15)];
        let own = &mut self.shares[share];
        (own.called, own.force, own.torque) = (true, three(18), three(21));
        (own.supplied, own.pending) = (numbers[24], numbers[25]);
        self.peak = numbers[26];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_abs_diff_eq;
    use nalgebra::Point3;

    /// A free body has its energy itself and may hang on a spring; a driven one gives energy by its speed.
    #[test]
    fn a_driven_body_has_the_power_that_a_free_one_keeps() {
        let ball = RigidShape::Sphere {
            centre: Point3::origin(),
            radius: 1.0,
        };
        let speed = Vector3::new(2.0, 0.0, 0.0);
        let free = Motion::Free {
            mass: 4.0,
            velocity: speed,
            inertia: None,
        };
        let mut free = RigidBody::new("free", ball.clone(), free).unwrap();
        let mut driven = RigidBody::new("driven", ball, Motion::Velocity(speed)).unwrap();
        let force = Vector3::new(3.0, 7.0, 0.0);
        assert_abs_diff_eq!(free.driven_power(&force, None), 0.0);
        assert_abs_diff_eq!(driven.driven_power(&force, None), -6.0);
        let mut end = End::default();
        end.after[1] = 1.0;
        assert_abs_diff_eq!(driven.driven_power(&force, Some(&end)), -7.0);
        assert_abs_diff_eq!(free.spring_rate(), 0.0);
        free.set_spring(100.0).unwrap();
        assert_abs_diff_eq!(free.spring_rate(), 25.0);
        assert!(
            driven
                .set_spring(100.0)
                .unwrap_err()
                .to_string()
                .contains("give the obstacle a mass")
        );
    }
}
