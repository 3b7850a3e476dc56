//! The surface of a continuum against a rigid body.
//!
//! Contact acts at points of the surface ([`super::points`]) by the law, with friction and the energy budgets
//! of particles. A point that overlaps the body at rest pushes only when it comes closer. Weights of the
//! model multiply the stiffness, as for particles, so that two models that share a body in an overlap share
//! its contact force as well.
//!
//! Forces are added point after point in an order that is reversed in every step, so results do not depend
//! on the number of threads. A step allocates nothing except where the list of near points grows.

use super::closed::{Active, Closed, Proposed};
use super::forces::{Push, StepForces};
use super::place::{Place, Triangle};
use super::points::{self, DEEPEST, Deepest, SurfacePoint};
use super::search::{farthest, three};
use super::{ContactLaw, Pair, RigidBody, SharedBody, Solid, Twist};
use crate::effect::{AnyEffect, Effect, EffectSpec, Host, Instant, RigidMotion, StepDemand};
use crate::error::invalid;
use crate::model::Model;
use crate::record::Record;
use crate::weight::Uniform;
use crate::{Error, Result};
use nalgebra::{Point3, Vector3};

/// Reach of the list of near points, in mean sizes of the facets.
const SKIN: f64 = 0.5;
/// Specification of a rigid body that the surface of a continuum touches, an effect on its subdomain.
#[derive(Debug)]
pub struct SurfaceObstacle(Contacts);

/// A surface in contact with a rigid body during a run.
#[derive(Debug)]
struct Contacts {
    /// Name of the body, and of the pair in errors.
    name: String,
    object: String,
    body: SharedBody,
    /// Number of the model among those that touch the body.
    share: usize,
    closed: Closed,
    points: Vec<SurfacePoint>,
    /// Gap at rest of each point that overlaps the body (negative), else zero \[m\].
    allowed: Vec<f64>,
    /// Weighted over unweighted mass, and inverse of the weighted mass \[1/kg\], of each point.
    weight: Vec<f64>,
    inverse_mass: Vec<f64>,
    forces: StepForces,
    near: Near,
    demand: StepDemand<f64>,
    checked: bool,
}

/// Points within reach of the body. The list holds until nodes and body together have moved by the skin.
#[derive(Debug)]
struct Near {
    skin: f64,
    points: Vec<u32>,
    /// Nodes of the surface, and their displacements when the list was built.
    nodes: Vec<u32>,
    built: Vec<Vector3<f64>>,
    moved: Vector3<f64>,
    is_built: bool,
}

/// A force on a point.
fn push(point: &SurfacePoint, force: Vector3<f64>) -> Push {
    Push {
        place: point.place,
        turning: None,
        force,
        torque: Vector3::zeros(),
    }
}

impl SurfaceObstacle {
    /// Contact of the surface of a model with a rigid body.
    ///
    /// # Errors
    /// [`Error::Unsupported`] for a model without a surface; [`Error::InvalidParameter`] for parameters of
    /// the law, for facets that are too large for the body, and for a surface that starts inside the body.
    pub fn new(model: &dyn Model<f64>, body: &SharedBody, law: ContactLaw) -> Result<Self> {
        law.check()?;
        let rigid = body.lock();
        let name = rigid.name().to_owned();
        let object = format!("model '{}' at obstacle '{name}'", model.name());
        let Some(surface) = model.views().surface else {
            return Err(Error::Unsupported {
                model: model.name().to_owned(),
                what: format!("touch obstacle '{name}', as it has no surface; name a solid or particles"),
            });
        };
        let triangles = Triangle::cut(&surface.faces(), model.nodes().len());
        let points = points::points(&object, &triangles, model.nodes(), 0.5 * rigid.shape().depth())?;
        let at_rest = |p: &SurfacePoint| rigid.shape().distance(&p.rest, &Vector3::zeros()).0.min(0.0);
        let mut nodes: Vec<u32> = triangles.iter().flat_map(|t| t.nodes).collect();
        nodes.sort_unstable();
        nodes.dedup();
        let mean = points.iter().map(|p| p.size).sum::<f64>() / points.len().max(1) as f64;
        let out = Self(Contacts {
            allowed: points.iter().map(at_rest).collect(),
            closed: Closed::new(law, points.len()),
            near: Near {
                skin: SKIN * mean,
                points: Vec::new(),
                built: vec![Vector3::zeros(); nodes.len()],
                nodes,
                moved: Vector3::zeros(),
                is_built: false,
            },
            weight: Vec::new(),
            inverse_mass: Vec::new(),
            forces: StepForces::default(),
            demand: StepDemand::none(),
            checked: false,
            share: 0,
            body: body.clone(),
            points,
            object,
            name,
        });
        let start = rigid.first_displacement();
        out.0.check_start(&rigid, &start, |p| p.rest)?;
        let corners = |t: &Triangle| t.places(|n| model.nodes()[n as usize].coords).map(Point3::from);
        // A surface that is open, such as that of a zone, encloses nothing.
        if let (Some(inner), Ok(solid)) = (
            rigid.shape().inner_point(),
            Solid::new(triangles.iter().map(corners).collect()),
        ) && solid.distance(&(inner + start)).0 < 0.0
        {
            let x = inner + start;
            let value = format!(
                "the obstacle starts inside, at ({:.3e}, {:.3e}, {:.3e}) m",
                x.x, x.y, x.z
            );
            return Err(invalid(
                &out.0.object,
                value,
                "must not lie in each other: move one of the two",
            ));
        }
        drop(rigid);
        Ok(out)
    }
}

impl Contacts {
    /// Returns an error if points lie deep inside the body: it would hold them there or throw them out.
    fn check_start(
        &self,
        rigid: &RigidBody,
        moved: &Vector3<f64>,
        place: impl Fn(&SurfacePoint) -> Point3<f64>,
    ) -> Result<()> {
        let mut deepest = Deepest::default();
        for p in &self.points {
            let x = place(p);
            let limit = DEEPEST * p.size.min(rigid.shape().depth());
            deepest.add(-rigid.shape().distance(&x, moved).0, limit, || x.coords);
        }
        deepest.refuse(&self.object, "start", |limit| {
            format!(
                "must be at most {limit} deep, half a facet or half of the obstacle's depth: move one of the two, or turn the normal of \
                 a plane towards the model"
            )
        })
    }

    /// Takes the weighted masses from the subdomain, and returns the masses without weights \[kg\].
    fn weigh(&mut self, host: &Host<'_, f64>) -> Result<Vec<f64>> {
        let mut mass = vec![0.0; host.model.layout().dofs()];
        host.model.lumped_inertia(&Uniform(1.0), &mut mass)?;
        self.forces = StepForces::new(host.inverse_inertia.to_vec());
        let weighted = |n: usize| host.inertia[3 * n];
        let weight = |p: &SurfacePoint| {
            // A node that sleeps would take its part of a force without moving.
            let sleeps = p.place.nodes().any(|(n, w)| w > 0.0 && weighted(n) <= 0.0);
            if sleeps {
                0.0
            } else {
                p.place.mean(|n| weighted(n) / mass[3 * n])
            }
        };
        self.weight = self.points.iter().map(weight).collect();
        let inverse = |p: &SurfacePoint| p.place.squared(|n| 1.0 / weighted(n));
        self.inverse_mass = self.points.iter().map(inverse).collect();
        Ok(mass)
    }

    /// Rebuilds the list of near points if it no longer holds.
    fn refresh(&mut self, rigid: &RigidBody, q: &[f64]) {
        let near = &mut self.near;
        let moved = rigid.moved();
        let displaced = |n: u32| three(q, n);
        // A margin of a thousandth for round-off.
        let slack = 0.999 * near.skin - (moved - near.moved).norm();
        let stays = |(n, then): (&u32, &Vector3<f64>)| (displaced(*n) - then).norm_squared() <= slack * slack;
        if near.is_built && slack >= 0.0 && near.nodes.iter().zip(&near.built).all(stays) {
            return;
        }
        for (n, then) in near.nodes.iter().zip(&mut near.built) {
            *then = displaced(*n);
        }
        (near.moved, near.is_built) = (moved, true);
        near.points.clear();
        for (k, p) in self.points.iter().enumerate() {
            if rigid.shape().distance(&p.position(q).into(), &moved).0 < near.skin {
                near.points.push(k as u32);
            } else {
                // A point off the list cannot touch: its contact starts anew when it returns.
                self.closed.open(k);
            }
        }
    }

    /// Computes all contacts and adds their forces to `f`.
    fn respond(&mut self, rigid: &mut RigidBody, instant: &Instant<'_, f64>, f: &mut [f64]) -> Result<()> {
        self.closed.begin(instant.dt);
        let mut deepest = Deepest::default();
        let held = DEEPEST * rigid.shape().depth();
        let count = self.near.points.len();
        for n in 0..count {
            let k = self.near.points[self.closed.turn(n, count)] as usize;
            if self.weight[k] <= 0.0 {
                // It sleeps where it last was, however deep that is by now.
                self.closed.open(k);
                continue;
            }
            let x = Point3::from(self.points[k].position(instant.q));
            let (distance, normal) = rigid.shape().distance(&x, &rigid.moved());
            deepest.add(-distance, held, || x.coords);
            let gap = self.allowed[k] - distance;
            if gap > 0.0 {
                self.closed.turned(self.points[k].turn(instant.q));
                self.propose(k, gap, (distance, normal), rigid, instant);
            } else {
                self.closed.open(k);
            }
        }
        deepest.refuse_sinking(&self.object)?;
        // Sequential: a contact works on the velocity that the contacts before it have left.
        for n in 0..self.closed.proposed.len() {
            self.decide(self.closed.proposed[n], rigid, instant, f);
        }
        self.closed.end(instant.dt);
        let (points, forces) = (&self.points, &self.forces);
        let obstacle = (instant.dt > 0.0).then(|| rigid.end(instant));
        self.closed.expect(|a| {
            let push = push(&points[a.point as usize], a.force);
            let driven = rigid.driven_power(&a.force, obstacle.as_ref());
            forces.end(&push, instant, f).power(&a.force, &a.torque) + driven
        });
        for a in &self.closed.active {
            let push = push(&self.points[a.point as usize], a.force);
            self.forces.deliver(&push, f);
        }
        Ok(())
    }

    fn propose(
        &mut self,
        k: usize,
        gap: f64,
        (distance, normal): (f64, Vector3<f64>),
        rigid: &RigidBody,
        instant: &Instant<'_, f64>,
    ) {
        let point = &self.points[k];
        let [linear, angular] = rigid.velocity();
        let turns = rigid.turning();
        let pair = Pair {
            normal,
            gap,
            stiffness: self.closed.law.law.modulus * point.stiffness,
            reduced_radius: 0.0,
            // The distance of the point from the centre of a ball: the torque is the moment of the force.
            arms: [turns.map_or(0.0, |(radius, _)| radius + distance), 0.0],
            share: self.weight[k],
            inverse_mass: self.inverse_mass[k] + rigid.inverse_inertia()[0],
            motion: [
                Twist { linear, angular },
                Twist {
                    linear: point.place.value(instant.v_half),
                    angular: Vector3::zeros(),
                },
            ],
        };
        let spring = &mut self.closed.springs[k];
        let proposal = self
            .closed
            .law
            .propose(&pair, turns.is_some(), instant.dt, spring);
        self.forces.propose(&push(point, proposal.response.force));
        self.closed.proposed.push(Proposed {
            point: k as u32,
            foot: Place::default(),
            proposal,
        });
    }

    fn decide(&mut self, p: Proposed, rigid: &mut RigidBody, instant: &Instant<'_, f64>, f: &[f64]) {
        let point = &self.points[p.point as usize];
        let proposed = push(point, p.proposal.response.force);
        self.forces.withdraw(&proposed);
        let ends = [rigid.end(instant), self.forces.end(&proposed, instant, f)];
        let r = self.closed.decide(&p, ends, instant.dt);
        self.forces.decide(&push(point, r.force));
        rigid.push(self.share, &-r.force, &r.torque[0]);
        self.closed.active.push(Active {
            point: p.point,
            foot: p.foot,
            force: r.force,
            torque: Vector3::zeros(),
            stored: r.stored,
            expected: 0.0,
        });
    }

    /// Computes the demand on the step from the masses without weights.
    ///
    /// The springs add at most `max_i Σ_p k_p w_pi/m_i` to `ω²`: a row of `M⁻¹ K`, whose weights sum to one.
    fn demanded(&self, rigid: &RigidBody, mass: &[f64]) -> StepDemand<f64> {
        let law = &self.closed.law.law;
        let zeta = self.closed.law.damping_ratio();
        let nodes = mass.len() / 3;
        let (mut rows, mut rates) = (vec![0.0; nodes], vec![0.0; nodes]);
        let (mut whole, mut hardest) = (0.0, 0.0_f64);
        for p in &self.points {
            let k = law.modulus * p.stiffness;
            let inverse = p.place.squared(|n| 1.0 / mass[3 * n]);
            for (n, w) in p.place.nodes() {
                rows[n] += k * w / mass[3 * n];
                rates[n] += 2.0 * zeta * (k / inverse).sqrt() * w / mass[3 * n];
            }
            whole += p.area;
            hardest = hardest.max(k / p.area);
        }
        let moves = |n: &usize| self.forces.moves(*n);
        let largest = |x: &[f64]| (0..nodes).filter(moves).fold(0.0, |m, n| x[n].max(m));
        let (mut square, mut rate) = (largest(&rows), largest(&rates));
        if let Some(mass) = rigid.mass() {
            // A ball touches over less than half of its radius.
            let part = if rigid.turning().is_some() { 0.25 } else { 1.0 };
            let stiffness = hardest * whole.min(part * rigid.shape().section());
            let slide = rigid.turning().map_or(0.0, |(r, inertia)| {
                if law.friction > 0.0 {
                    law.shear_ratio * (1.0 / mass + r * r / inertia)
                } else {
                    0.0
                }
            });
            // Both ends move: a mode's frequency is at most the sum of those of both.
            square = 2.0 * square.max(stiffness * slide.max(1.0 / mass) + rigid.spring_rate());
            rate *= 2.0;
        }
        if law.friction > 0.0 {
            square *= law.shear_ratio.max(1.0);
        }
        StepDemand {
            stiffness: square,
            damping: rate,
            ..StepDemand::none()
        }
    }
}

impl EffectSpec<f64> for SurfaceObstacle {
    fn attach(mut self: Box<Self>, host: &Host<'_, f64>) -> Result<Box<dyn Effect<f64>>> {
        let contacts = &mut self.0;
        if host.model.owned().is_part() {
            return Err(Error::Unsupported {
                model: host.model.name().to_owned(),
                what: format!(
                    "touch obstacle '{}' with elements on several ranks; leave it whole",
                    contacts.name
                ),
            });
        }
        let mass = contacts.weigh(host)?;
        let body = contacts.body.clone();
        contacts.share = body.join();
        contacts.demand = contacts.demanded(&body.lock(), &mass);
        Ok(Box::new(self.0))
    }
}

impl AnyEffect<f64> for Contacts {
    fn name(&self) -> &str {
        &self.name
    }

    fn stored(&self) -> f64 {
        self.closed.stored()
    }

    fn supplied(&self) -> Option<f64> {
        Some(self.closed.law.supplied + self.body.lock().supplied(self.share))
    }

    fn save(&self) -> Record<f64> {
        let mut out = Record::default();
        self.body.lock().save(self.share, &mut out);
        self.closed.save(&mut out);
        out
    }

    fn restore(&mut self, from: &Record<f64>) -> Result<()> {
        let motion = from.numbers.split_first_chunk::<{ RigidBody::NUMBERS }>();
        let fits = from
            .integers
            .split_first()
            .zip(motion)
            .and_then(|(states, motion)| {
                // Contacts with a rigid body have no foot.
                self.closed.restore(states.1, motion.1, |_| 1)?;
                self.body.lock().restore(self.share, *states.0, motion.0);
                Some(())
            });
        self.near.is_built = false;
        fits.ok_or_else(|| Error::SizeMismatch {
            what: format!("points in the record of {}", self.object),
            expected: self.points.len(),
            found: from.integers.len(),
        })
    }

    fn rigid(&self) -> Option<RigidMotion<f64>> {
        Some(self.body.lock().motion())
    }

    fn facts(&self) -> Vec<(String, f64)> {
        let mut out = self.body.lock().facts();
        out.extend(self.closed.facts());
        out
    }
}

impl Effect<f64> for Contacts {
    fn add_forces(&mut self, instant: &Instant<'_, f64>, f: &mut [f64]) -> Result<()> {
        let shared = self.body.clone();
        let mut rigid = shared.lock();
        rigid.begin(self.share, instant)?;
        let moved = rigid.way();
        let way = farthest(&self.near.nodes, |n, _| {
            three(instant.v_half, n) * instant.dt - moved
        });
        let limit = DEEPEST * rigid.shape().depth();
        if instant.dt > 0.0 && way > limit {
            let rule = format!(
                "must stay below {limit:e} m, half the depth of the obstacle, or they could jump through each other; shorten the time \
                 step or slow them down"
            );
            let what = format!("way of {} in a step", self.object);
            return Err(invalid(&what, format_args!("{way:e} m"), &rule));
        }
        if !std::mem::replace(&mut self.checked, true) {
            self.check_start(&rigid, &rigid.moved(), |p| p.position(instant.q).into())?;
        }
        // The motion of the body was known when contacts were computed, unless a relaxation holds it still.
        let points = &self.points;
        let power = |a: &Active| {
            let speed = points[a.point as usize].place.value(instant.v_half);
            a.force.dot(&speed) + rigid.driven_power(&a.force, None)
        };
        self.closed.settle(instant.dt, power);
        self.refresh(&rigid, instant.q);
        self.respond(&mut rigid, instant, f)?;
        rigid.finish(self.share, instant);
        Ok(())
    }

    fn power(&self, v: &[f64]) -> f64 {
        let power = |a: &Active| a.force.dot(&self.points[a.point as usize].place.value(v));
        self.closed.active.iter().map(power).sum()
    }

    fn add_contact(&self, f: &mut [f64]) -> bool {
        for a in &self.closed.active {
            self.points[a.point as usize].place.add(&a.force, f);
        }
        true
    }

    fn reweigh(&mut self, host: &Host<'_, f64>) -> Result<()> {
        let before = std::mem::take(&mut self.weight);
        self.weigh(host)?;
        let (body, weight) = (self.body.clone(), &self.weight);
        let mut rigid = body.lock();
        // Points push with their present weight in the second half of the step around this instant, since a
        // kept force would throw nodes that have become light; the body would be pushed as before in both.
        self.closed.weaken(|a| {
            let part = (weight[a.point as usize] / before[a.point as usize]).min(1.0);
            rigid.push(self.share, &(a.force * (0.5 * (1.0 - part))), &Vector3::zeros());
            part
        });
        Ok(())
    }

    fn step_demand(&self) -> StepDemand<f64> {
        self.demand
    }
}
