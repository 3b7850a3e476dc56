//! The energy ledger: where energy is, where it came from, and what is left unexplained.

use super::momentum::{Body, RECORDED};
use crate::Real;

/// One line of the ledger: an effect and the work it has done since the start \[J\].
#[derive(Debug, Clone, PartialEq)]
pub struct WorkLine<T> {
    /// Subdomain or interface, and effect.
    pub name: String,
    /// Work on the models since the start \[J\]; negative where energy was dissipated.
    pub work: T,
}

/// Energy balance at one step.
///
/// The invariant `H = ½ v_{n+½}ᵀMv_{n+½} + ½ q_nᵀKq_{n+1}` changes exactly by the work `Δt F_n·v_n` of
/// loads, damping, supports and constraint; what remains is [`EnergySample::drift`].
#[derive(Debug, Clone, PartialEq)]
pub struct EnergySample<T> {
    /// Step number.
    pub step: usize,
    /// Time \[s\].
    pub time: T,
    /// Kinetic energy at the whole step \[J\].
    pub kinetic: T,
    /// Internal energy at the whole step \[J\].
    pub internal: T,
    /// Discrete invariant `H` half a step earlier \[J\].
    pub invariant: T,
    /// Sum of all works since the start \[J\].
    pub work: T,
    /// `H − H_0 − work` \[J\].
    pub drift: T,
    /// Drift relative to the largest energy so far.
    pub relative_drift: T,
    /// Largest change of linear and of angular momentum over all bodies that should keep it, each relative to
    /// its sum of moduli; see [`crate::BodyMomentum`].
    pub momentum_drift: [T; 2],
    /// Largest velocity jump between the models, relative to the largest velocity so far.
    pub constraint_residual: T,
}

impl<T: Real> EnergySample<T> {
    /// Kinetic plus internal energy \[J\].
    pub fn total(&self) -> T {
        self.kinetic + self.internal
    }
}

/// Number of sums and extremes in a record of the ledger.
const SUMS: usize = 10;

/// Running sums and extremes from which samples are made.
#[derive(Debug, Clone)]
pub(crate) struct Ledger<T: Real> {
    pub(crate) supports: T,
    pub(crate) constraint: T,
    pub(crate) start: Option<T>,
    /// Largest energy so far \[J\]: the scale of relative figures.
    pub(crate) scale: T,
    pub(crate) top_drift: T,
    pub(crate) top_residual: T,
    pub(crate) top_velocity: T,
    /// Largest energy created by effects, relative to the energy in play.
    pub(crate) top_created: T,
    /// Sum `Σ |ΔU + ½ Δq·(f_n + f_{n+1})|` \[J\]: change of the invariant that nonlinear laws explain.
    pub(crate) curvature: T,
    pub(crate) last: Option<EnergySample<T>>,
    pub(crate) bodies: Vec<Body<T>>,
    /// Displacement jump of each interface.
    pub(crate) jumps: Vec<DisplacementJump<T>>,
}

/// Displacement jump between the two models of an interface. It is round-off if both models make one explicit
/// step in a macro step, and grows with the number of own steps.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct DisplacementJump<T> {
    /// Largest jump so far \[m\] at a multiplier.
    pub largest: T,
    /// Deformation of the overlap \[m\]: largest displacement so far of a node that multipliers act on, from
    /// the nearest rigid motion of all these nodes. A common rigid motion neither deforms nor parts the
    /// models.
    pub amplitude: T,
    /// Jump that round-off of the displacements may have made so far \[m\].
    pub digits: T,
}

impl<T: Real> DisplacementJump<T> {
    fn record(&self) -> [T; 3] {
        [self.largest, self.amplitude, self.digits]
    }
}

impl<T: Real> DisplacementJump<T> {
    /// Returns jump over amplitude, or zero if the jump is round-off.
    pub fn share(&self) -> T {
        if self.largest > self.digits && self.amplitude > T::zero() {
            self.largest / self.amplitude
        } else {
            T::zero()
        }
    }
}

impl<T: Real> Ledger<T> {
    pub(crate) fn new() -> Self {
        let z = T::zero();
        Self {
            supports: z,
            constraint: z,
            start: None,
            scale: z,
            top_drift: z,
            top_residual: z,
            top_velocity: z,
            top_created: z,
            curvature: z,
            last: None,
            bodies: Vec::new(),
            jumps: Vec::new(),
        }
    }

    /// Returns all numbers but the last sample, for [`Self::restore`].
    pub(crate) fn record(&self) -> Vec<T> {
        // An option takes two numbers.
        let started = if self.start.is_some() { T::one() } else { T::zero() };
        let start = self.start.unwrap_or_else(T::zero);
        let tops = [
            self.top_drift,
            self.top_residual,
            self.top_velocity,
            self.top_created,
            self.curvature,
        ];
        [self.supports, self.constraint, started, start, self.scale]
            .into_iter()
            .chain(tops)
            .chain(self.jumps.iter().flat_map(DisplacementJump::record))
            .chain(self.bodies.iter().flat_map(Body::record))
            .collect()
    }

    /// Restores the numbers of [`Self::record`].
    pub(crate) fn restore(&mut self, from: &[T]) -> crate::Result<()> {
        crate::scalar::check_finite("ledger of the snapshot", from)?;
        let wrong = || crate::Error::SizeMismatch {
            what: "ledger of the snapshot".into(),
            expected: SUMS + 3 * self.jumps.len() + RECORDED * self.bodies.len(),
            found: from.len(),
        };
        let (sums, bodies) = from.split_at_checked(SUMS).ok_or_else(wrong)?;
        let (jumps, bodies) = bodies.split_at_checked(3 * self.jumps.len()).ok_or_else(wrong)?;
        let (bodies, surplus) = bodies.as_chunks::<RECORDED>();
        let &[
            supports,
            constraint,
            started,
            start,
            scale,
            drift,
            residual,
            velocity,
            created,
            curvature,
        ] = sums
        else {
            return Err(wrong());
        };
        if bodies.len() != self.bodies.len() || !surplus.is_empty() {
            return Err(wrong());
        }
        for (jump, f) in self.jumps.iter_mut().zip(jumps.chunks_exact(3)) {
            (jump.largest, jump.amplitude, jump.digits) = (f[0], f[1], f[2]);
        }
        self.bodies.iter_mut().zip(bodies).for_each(|(b, f)| b.restore(f));
        *self = Self {
            supports,
            constraint,
            start: (started != T::zero()).then_some(start),
            scale,
            top_drift: drift,
            top_residual: residual,
            top_velocity: velocity,
            top_created: created,
            curvature,
            last: None,
            bodies: std::mem::take(&mut self.bodies),
            jumps: std::mem::take(&mut self.jumps),
        };
        Ok(())
    }
}
