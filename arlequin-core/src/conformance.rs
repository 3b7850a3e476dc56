//! Checks that any implementer of the traits can call in its own tests.
//!
//! Each returns a defect, relative to the natural scale of the quantity; the caller states the tolerance.

mod weights;

pub use weights::{WeightDefect, reweighing, weight_means, weights};

use crate::coupled::Coupled;
use crate::effect::{Instant, PairEffect};
use crate::field::{Interpolation, ShapeRow};
use crate::model::{Arms, DofLayout, Model};
use crate::participant::Participant;
use crate::weight::{Uniform, Weight};
use crate::{Real, Result};
use nalgebra::{Point3, Rotation3, Vector3};
use std::sync::Arc;

/// Defects of shape functions over a set of points.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ShapeDefect<T> {
    /// Largest `|Σ N − 1|`.
    pub unity: T,
    /// Largest `|Σ N x_k − x|`, relative to the extent of the nodes.
    pub linear: T,
    /// Largest `|Σ ∇N|` times the extent of the nodes, and largest `|Σ ∇N x_k − 1|`; zero if gradients were
    /// not asked for.
    pub gradient: T,
    /// Most negative value of a shape function; zero if there is none.
    pub negative: T,
}

fn extent<T: Real>(nodes: &[Point3<T>]) -> T {
    let [low, high] = crate::geometry::bounds_of(nodes.iter());
    (high - low).norm().max(T::epsilon())
}

/// Checks the partition of unity and the linear completeness of a field at the given points.
///
/// # Errors
/// Errors of the field.
pub fn shapes<T: Real>(
    field: &dyn Interpolation<T>,
    points: &[Point3<T>],
    gradients: bool,
) -> Result<ShapeDefect<T>> {
    let mut worst: ShapeDefect<T> = ShapeDefect::default();
    let size = extent(field.nodes());
    let mut row = ShapeRow::default();
    for x in points {
        field.shape_at(x, gradients, &mut row)?;
        let (mut unity, mut position) = (-T::one(), -x.coords);
        // Errors are summed, not values: sums start at minus the exact result.
        let (mut slope, mut jacobian) = (Vector3::zeros(), nalgebra::Matrix3::zeros());
        for (k, (&node, &n)) in row.nodes.iter().zip(&row.values).enumerate() {
            unity += n;
            position += field.nodes()[node].coords * n;
            worst.negative = worst.negative.min(n);
            if gradients {
                slope += row.gradients[k];
                jacobian += row.gradients[k] * (field.nodes()[node] - x).transpose();
            }
        }
        worst.unity = worst.unity.max(unity.abs());
        worst.linear = worst.linear.max(position.norm() / size);
        if gradients {
            // A line has gradients along itself only: compare the action on its own extent.
            let mut missing = T::zero();
            for d in row
                .nodes
                .iter()
                .skip(1)
                .map(|&k| field.nodes()[k] - field.nodes()[row.nodes[0]])
            {
                missing = missing.max((jacobian.transpose() * d - d).norm() / d.norm());
            }
            worst.gradient = worst.gradient.max(slope.norm() * size).max(missing);
        }
    }
    Ok(worst)
}

/// Checks that an effect between two subdomains creates no momentum. Returns `|Σ F|` over all nodes of both
/// sides relative to `Σ |F|`, or zero without forces. `layouts` are those of the two models.
///
/// # Errors
/// Errors of the effect.
pub fn reaction<T: Real>(
    effect: &mut dyn PairEffect<T>,
    instants: [&Instant<'_, T>; 2],
    layouts: [DofLayout; 2],
) -> Result<T> {
    let mut forces = layouts.map(|l| vec![T::zero(); l.dofs()]);
    let [f, g] = &mut forces;
    effect.add_forces(instants, [f, g])?;
    let (mut sum, mut size) = (Vector3::zeros(), T::zero());
    for (f, l) in forces.iter().zip(layouts) {
        for node in f[..l.translations()].chunks_exact(l.components) {
            let mut force = Vector3::zeros();
            force.iter_mut().zip(node).for_each(|(a, b)| *a = *b);
            sum += force;
            size += force.norm();
        }
    }
    Ok(if size > T::zero() { sum.norm() / size } else { size })
}

/// Largest `|Σ_m w_m(x) − 1|` over the points, for the weights of one kind of all models.
pub fn partition_of_unity<T: Real>(weights: &[Arc<dyn Weight<T>>], points: &[Point3<T>]) -> T {
    points
        .iter()
        .map(|x| (weights.iter().map(|w| w.value(x)).sum::<T>() - T::one()).abs())
        .fold(T::zero(), |a, b| a.max(b))
}

/// Rigid translation `t` and small rotation `r` as displacements of a model; rotational unknowns turn by `r`.
pub fn rigid_motion<T: Real>(model: &dyn Model<T>, t: Vector3<T>, r: Vector3<T>) -> Vec<T> {
    let layout = model.layout();
    let mut q = Vec::with_capacity(layout.dofs());
    for x in model.nodes() {
        // A small turn: its displacement is linear in the position.
        let u = t + r.cross(&x.coords);
        q.extend_from_slice(&u.as_slice()[..layout.components]);
    }
    (0..layout.nodes * layout.rotations).for_each(|i| q.push(r[i % 3]));
    q
}

/// Largest force under a rigid motion, relative to the largest force under random displacements of the given
/// amplitude \[m\]. The motion is a translation and a small turn of that amplitude. For a law that balances
/// about current positions ([`Arms::Current`]) it is a translation and a turn by half a radian.
///
/// # Errors
/// Errors of the model.
pub fn rigid_forces<T: Real>(model: &mut dyn Model<T>, amplitude: T) -> Result<T> {
    let layout = model.layout();
    let shift = Vector3::new(T::of(0.3), T::of(-0.2), T::of(0.5)) * amplitude;
    let mut turn = Vector3::new(T::of(0.1), T::of(0.4), T::of(-0.3));
    // Bars do not turn, and plane models turn about z only.
    match layout.components {
        1 => turn.fill(T::zero()),
        2 => (turn.x, turn.y) = (T::zero(), T::zero()),
        _ => {}
    }
    let q = if model.views().arms == Arms::Current {
        finite_motion(model, shift, turn)
    } else {
        // Scaled so that the border of the body moves by about the amplitude.
        let size = extent(model.nodes());
        rigid_motion(model, shift, turn * (amplitude / size))
    };
    let rigid = largest_force(model, &q)?;
    let random: Vec<T> = (0..layout.dofs())
        .map(|i| fixed_noise::<T>(i) * amplitude)
        .collect();
    Ok(rigid / largest_force(model, &random)?)
}

/// Translation by `shift` and rotation by the vector `turn` about the mean position of the nodes, as
/// displacements of a model; rotational unknowns are `turn`.
fn finite_motion<T: Real>(model: &dyn Model<T>, shift: Vector3<T>, turn: Vector3<T>) -> Vec<T> {
    let (layout, nodes) = (model.layout(), model.nodes());
    let sum: Vector3<T> = nodes
        .iter()
        .map(|x| x.coords)
        .fold(Vector3::zeros(), |a, b| a + b);
    let centre = sum / T::of(nodes.len().max(1) as f64);
    let rotation = Rotation3::new(turn);
    let mut q = Vec::with_capacity(layout.dofs());
    for x in nodes {
        let arm = x.coords - centre;
        let u = shift + rotation * arm - arm;
        q.extend_from_slice(&u.as_slice()[..layout.components]);
    }
    (0..layout.nodes * layout.rotations).for_each(|i| q.push(turn[i % 3]));
    q
}

/// Largest force at the displacements `q`. The model then goes back to its state before.
fn largest_force<T: Real>(model: &mut dyn Model<T>, q: &[T]) -> Result<T> {
    let mut f = vec![T::zero(); q.len()];
    let memory = model.save();
    model.advance(q, &mut f)?;
    model.restore(&memory)?;
    Ok(f.iter().fold(T::zero(), |a, b| a.max(b.abs())))
}

/// A fixed sequence in (−1, 1).
pub(crate) fn fixed_noise<T: Real>(i: usize) -> T {
    let x = ((i as f64 + 0.5) * 0.569_840_290_998_053_3).fract() * 91.7;
    T::of(2.0 * x.fract() - 1.0)
}

/// Largest relative difference between `−∇U` (central differences) and the internal forces, at displacements
/// of the given amplitude \[m\]. Rotations vary about those of the last [`Model::advance`]. Nodal weighting
/// gives a difference of order one, since its forces have no potential.
///
/// # Errors
/// Errors of the model.
pub fn forces_derive_from_energy<T: Real>(model: &mut dyn Model<T>, amplitude: T) -> Result<T> {
    let n = model.layout().dofs();
    let mut q: Vec<T> = (0..n).map(|i| fixed_noise::<T>(i) * amplitude).collect();
    let mut f = vec![T::zero(); n];
    let memory = model.save();
    model.advance(&q, &mut f)?;
    let scale = f.iter().fold(T::epsilon(), |a, b| a.max(b.abs()));
    // Balances the error of central differences, of order `h²`, against round-off, of order `ε/h`.
    let h = amplitude * T::epsilon().cbrt();
    let mut worst = T::zero();
    // Some fifty unknowns spread over the model, from its first to its last.
    for i in (0..n).step_by((n / 50).max(1)) {
        let keep = q[i];
        q[i] = keep + h;
        let up = model.internal_energy(&q);
        q[i] = keep - h;
        let down = model.internal_energy(&q);
        q[i] = keep;
        worst = worst.max(((up - down) / (h + h) + f[i]).abs() / scale);
    }
    model.restore(&memory)?;
    Ok(worst)
}

/// Relative difference between the unweighted translational mass per component and `expected` \[kg\];
/// `f32::MAX` if a mass is not positive.
///
/// # Errors
/// Errors of the model.
pub fn mass<T: Real>(model: &dyn Model<T>, expected: T) -> Result<T> {
    let layout = model.layout();
    let mut m = vec![T::zero(); layout.dofs()];
    model.lumped_inertia(&Uniform(T::one()), &mut m)?;
    // An answer that no tolerance accepts.
    if m.iter().any(|m| !m.is_finite() || *m <= T::zero()) {
        return Ok(T::of(f64::from(f32::MAX)));
    }
    let total: T = m[..layout.translations()].iter().copied().sum();
    Ok((total / T::of(layout.components as f64) / expected - T::one()).abs())
}

/// Checks that work does not depend on the path, at displacements of the given amplitude \[m\]. Returns the
/// smaller of two relative asymmetries. That of the secant, `|f(a)·b − f(b)·a|`, is round-off for a linear
/// law. That of the tangent, `|aᵀK b − bᵀK a|` at random displacements by central differences, is 1e-8 or
/// less for any law that has an energy.
///
/// # Errors
/// Errors of the model.
pub fn symmetric_forces<T: Real>(model: &mut dyn Model<T>, amplitude: T) -> Result<T> {
    let layout = model.layout();
    // Torques are slopes of the energy at the rotations reached: with finite rotations their tangent is not
    // symmetric.
    let turning = if model.views().arms == Arms::Current {
        T::zero()
    } else {
        amplitude
    };
    let direction = |from: usize| -> Vec<T> {
        let size = |i: usize| {
            if i < layout.translations() {
                amplitude
            } else {
                turning
            }
        };
        (0..layout.dofs())
            .map(|i| fixed_noise::<T>(i + from) * size(i))
            .collect()
    };
    let (a, b) = (direction(0), direction(7919));
    let asymmetry = |fa: &[T], fb: &[T]| {
        let dot = crate::scalar::dot::<T>;
        // Relative to the products, whose round-off is all that is left for a symmetric law.
        (dot(fa, &b) - dot(fb, &a)).abs() / (dot(fa, &a).abs() + dot(fb, &b).abs())
    };
    let force = |model: &mut dyn Model<T>, q: &[T]| -> Result<Vec<T>> {
        let mut f = vec![T::zero(); q.len()];
        model.add_internal_forces(q, &mut f)?;
        Ok(f)
    };
    let secant = asymmetry(&force(model, &a)?, &force(model, &b)?);
    let place = direction(104_729);
    let step = T::epsilon().cbrt();
    let mut slope = |along: &[T]| -> Result<Vec<T>> {
        let mut side = |step: T| {
            let q: Vec<T> = place.iter().zip(along).map(|(q, d)| *q + step * *d).collect();
            force(model, &q)
        };
        let (up, down) = (side(step)?, side(-step)?);
        Ok(up.iter().zip(&down).map(|(u, d)| *u - *d).collect())
    };
    let tangent = asymmetry(&slope(&a)?, &slope(&b)?);
    Ok(if secant < tangent { secant } else { tangent })
}

/// Defects of a [`Participant`]. All but [`Self::travelled`] and [`Self::gained`] are zero up to round-off if
/// it keeps what the coupling relies on.
///
/// Some faults cannot be seen from outside: forces that are not those of the material, a stiffness that is
/// not weighted like the inertia, wrong loads of the solver's own.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ParticipantDefect<T> {
    /// Distance that nodes travel in a step over the step times the mean of their velocities before and
    /// after, minus one, without sign: 1 if they stand still or make two steps, ½ after half a step. Measured
    /// with an additional uniform velocity four times as fast as the motion; then below 0.04 for velocity
    /// Verlet up to its critical step.
    pub travelled: T,
    /// Gain of velocity in a step over the step times the mean of the accelerations before and after, minus
    /// one, without sign: 1 if no force acts, zero for velocity Verlet, `tan(x)/x − 1` with half the phase
    /// `x` of a step for a scheme without error. Zero if the participant reports no accelerations.
    pub gained: T,
    /// Largest difference between the velocities after an impulse `p` and `v + p/M`, relative to the largest
    /// velocity.
    pub kick: T,
    /// Largest displacement that an impulse causes at once, relative to the extent of the nodes.
    pub moved: T,
    /// Largest change of the invariant over the steps, relative to its value; zero if the participant has
    /// none.
    pub drift: T,
    /// Change of the invariant by an impulse minus the work `p·(v + p/2M)` of the impulse, relative to that
    /// work; zero without invariant.
    pub work: T,
    /// Largest difference of velocities when the same steps are repeated from a saved state, relative to the
    /// largest velocity; zero if the participant cannot be saved.
    pub resumed: T,
}

/// Checks a participant: kicks it, advances it by `steps` steps of `step` \[s\], then restores it and
/// advances it again. The participant gets weights of one and should be in motion. The step should be that of
/// the run: the check says nothing about other steps.
///
/// # Errors
/// Errors of the participant.
pub fn participant<T: Real>(
    solver: &mut dyn Participant<T>,
    step: T,
    steps: usize,
) -> Result<ParticipantDefect<T>> {
    let n = solver.layout().dofs();
    let mut inertia = vec![T::zero(); n];
    solver.weigh(&crate::Weights::uncoupled(), &mut inertia)?;
    solver.advance(T::zero(), step)?;
    let state = |solver: &dyn Participant<T>| {
        let (mut q, mut v) = (vec![T::zero(); n], vec![T::zero(); n]);
        solver.displacements(&mut q);
        solver.velocities(&mut v);
        [q, v]
    };
    let largest = |x: &[T]| x.iter().fold(T::epsilon(), |m, x| m.max(x.abs()));
    let largest_difference = |a: &[T], b: &[T]| {
        a.iter()
            .zip(b)
            .fold(T::zero(), |m, (a, b)| m.max((*a - *b).abs()))
    };
    let scale = largest(&state(solver)[1]);
    let [travelled, gained] = travel_and_gain(solver, &inertia, T::of(4.0) * scale, step)?;
    let ([q, v], before) = (state(solver), solver.invariant());
    let impulse: Vec<T> = inertia
        .iter()
        .enumerate()
        .map(|(i, m)| *m * scale * fixed_noise(i))
        .collect();
    solver.kick(&impulse)?;
    let ([moved, kicked], after) = (state(solver), solver.invariant());
    let wanted: Vec<T> = (0..n).map(|i| v[i] + impulse[i] / inertia[i]).collect();
    let half = T::of(0.5);
    let work: T = (0..n)
        .map(|i| impulse[i] * (v[i] + half * impulse[i] / inertia[i]))
        .sum();
    let brought = before
        .zip(after)
        .map_or(T::zero(), |(b, a)| (a - b - work).abs() / work.abs());
    // A participant need not be able to save itself.
    let saved = solver.save().ok();
    let advance_steps = |solver: &mut dyn Participant<T>| -> Result<T> {
        let mut worst = T::zero();
        for k in 0..steps {
            solver.advance(T::of((k + 2) as f64) * step, step)?;
            let drift = after
                .zip(solver.invariant())
                .map(|(a, now)| (now - a).abs() / a.abs());
            worst = worst.max(drift.unwrap_or_default());
        }
        Ok(worst)
    };
    let drift = advance_steps(solver)?;
    let [_, first] = state(solver);
    let mut resumed = T::zero();
    if let Some(saved) = saved {
        solver.restore(&saved)?;
        advance_steps(solver)?;
        resumed = largest_difference(&first, &state(solver)[1]) / largest(&first);
    }
    Ok(ParticipantDefect {
        travelled,
        gained,
        kick: largest_difference(&kicked, &wanted) / scale,
        moved: largest_difference(&moved, &q) / extent(solver.nodes()),
        drift,
        work: brought,
        resumed,
    })
}

/// Errors of travel and of velocity gain in a step while the participant has an additional uniform `speed`:
/// `|Σ Δq·w/Σ w² − 1|` with `w = ½Δt(v₀ + v₁)`, and the corresponding number of velocities and accelerations.
fn travel_and_gain<T: Real>(
    solver: &mut dyn Participant<T>,
    inertia: &[T],
    speed: T,
    step: T,
) -> Result<[T; 2]> {
    let layout = solver.layout();
    let mut impulse: Vec<T> = inertia.iter().map(|m| *m * speed).collect();
    // Rotations stay: only translations are uniform.
    impulse[layout.translations()..].fill(T::zero());
    let state = |solver: &dyn Participant<T>| {
        let mut out = [0; 3].map(|_| vec![T::zero(); layout.dofs()]);
        let [q, v, a] = &mut out;
        solver.displacements(q);
        solver.velocities(v);
        let known = solver.accelerations(a);
        (out, known)
    };
    // The uniform velocity causes no forces, so that any scheme keeps it. The rest of the motion adds the
    // error of the trapezium rule, `(ωΔt)²/4` of its share.
    solver.kick(&impulse)?;
    let (before, _) = state(solver);
    solver.advance(step, step)?;
    let (after, known) = state(solver);
    // Take the uniform velocity away again.
    impulse.iter_mut().for_each(|p| *p = -*p);
    solver.kick(&impulse)?;
    let share = |quantity: usize| {
        let (mut along, mut whole) = (T::zero(), T::zero());
        for i in 0..layout.dofs() {
            let wanted = T::of(0.5) * step * (before[quantity + 1][i] + after[quantity + 1][i]);
            along += (after[quantity][i] - before[quantity][i]) * wanted;
            whole += wanted * wanted;
        }
        if whole > T::zero() {
            (along / whole - T::one()).abs()
        } else {
            T::zero()
        }
    };
    Ok([share(0), if known { share(1) } else { T::zero() }])
}

/// Largest relative violation of `λᵀ(B v) = (Bᵀλ)ᵀv` over the interfaces of a run: checks that the two
/// operators are each other's transpose.
pub fn adjointness<T: Real>(run: &Coupled<T>) -> T {
    let mut worst = T::zero();
    for i in &run.interfaces {
        for c in i.coupling.iter() {
            let lambda: Vec<T> = (0..i.multipliers().len()).map(fixed_noise).collect();
            let v: Vec<T> = (0..c.size()).map(|k| fixed_noise(k + 31)).collect();
            let (mut jump, mut force) = (vec![T::zero(); lambda.len()], vec![T::zero(); v.len()]);
            c.times(&v, &mut jump);
            c.add_force(T::one(), &lambda, &mut force);
            let (a, b) = (crate::scalar::dot(&lambda, &jump), crate::scalar::dot(&force, &v));
            worst = worst.max((a - b).abs() / (a.abs() + b.abs()).max(T::epsilon()));
        }
    }
    worst
}

/// Checks that interfaces conserve linear and angular momentum. Returns the largest force and moment that a
/// random multiplier exerts on both sides together, relative to the sum of the nodal forces' magnitudes
/// (times the longest arm for the moment).
pub fn interface_momentum<T: Real>(run: &Coupled<T>) -> [T; 2] {
    let mut worst = [T::zero(); 2];
    for i in &run.interfaces {
        let lambda: Vec<T> = (0..i.multipliers().len()).map(fixed_noise).collect();
        let (mut force, mut moment) = (Vector3::zeros(), Vector3::zeros());
        let (mut scale, mut reach) = (T::epsilon(), T::epsilon());
        for (m, c) in i.coupling.iter().enumerate() {
            let model = run.subdomains[i.sides[m]].model();
            let d = model.layout().components;
            let mut f = vec![T::zero(); model.layout().dofs()];
            let sign = if m == 0 { -T::one() } else { T::one() };
            c.add_force(sign, &lambda, &mut f);
            for (k, x) in model.nodes().iter().enumerate() {
                let mut g = Vector3::zeros();
                (0..d).for_each(|a| g[a] = f[k * d + a]);
                // About a node of the coarse model: arms keep their digits far from the origin.
                let arm = x - run.subdomains[i.sides[0]].model().nodes()[0];
                force += g;
                moment += arm.cross(&g);
                scale += g.norm();
                reach = reach.max(arm.norm());
            }
        }
        worst[0] = worst[0].max(force.norm() / scale);
        worst[1] = worst[1].max(moment.norm() / (scale * reach));
    }
    worst
}
