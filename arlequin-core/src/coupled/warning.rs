//! Warnings of a run: what a user should know and what does not end it.

use super::Coupled;
use super::observer::Observer;
use crate::Real;
use std::fmt;

/// Something that a user of a run should know. Each is kept once, with the largest figure so far.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum Warning {
    /// A solver that makes its own steps tells no energy ([`crate::Participant::invariant`]).
    EnergyUnknown {
        /// Name of the model.
        model: String,
    },
    /// The balance of energy is off by more than the laws of the models explain.
    EnergyDrift {
        /// Step number.
        step: usize,
        /// Time \[s\].
        time: f64,
        /// Unexplained energy \[J\]; negative where energy is missing.
        drift: f64,
        /// Its modulus relative to the largest energy so far.
        share: f64,
        /// The share that the laws explain; see [`Coupled::explained_drift`].
        limit: f64,
        /// Who may be at fault.
        suspect: Suspect,
    },
    /// An impulse changed the velocities of a solver by something else than impulse over inertia.
    ImpulseMissed {
        /// Name of the model.
        model: String,
        /// Momentum that is missing or too much, relative to the impulse.
        share: f64,
        /// Share that round-off explains.
        limit: f64,
    },
    /// A momentum changed that should stay as it is.
    MomentumChanged {
        /// Names of the models of the body.
        models: Vec<String>,
        /// Whether it is the angular momentum.
        angular: bool,
        /// Largest change relative to what is in play.
        share: f64,
        /// Share that is no more than round-off, or than small displacements explain.
        limit: f64,
        /// Why the angular momentum is kept for small displacements only, where that is so.
        because: Option<String>,
    },
    /// Velocities of the two sides of an interface differ after the multipliers were solved for.
    VelocityJump {
        /// Name of the interface.
        interface: String,
        /// Step number.
        step: usize,
        /// Iterations of the solution; zero where it was no iteration.
        iterations: usize,
        /// Largest jump of velocity relative to the largest velocity so far.
        share: f64,
        /// Accepted share.
        limit: f64,
    },
    /// Displacements of the two sides of an interface have drifted apart.
    DisplacementJump {
        /// Name of the interface.
        interface: String,
        /// Names of the coarse and the fine model.
        models: [String; 2],
        /// Their own steps in a step of the run.
        own_steps: [usize; 2],
        /// Largest jump \[m\].
        jump: f64,
        /// The jump relative to the deformation of the overlap.
        share: f64,
        /// Accepted share.
        limit: f64,
    },
}

/// Who may be at fault where energy is not kept.
#[derive(Debug, Clone, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Suspect {
    /// A solver that makes its own steps.
    Solver(String),
    /// A model with weights at its nodes.
    Nodal(String),
    /// Nobody in particular.
    Anybody,
}

impl fmt::Display for Suspect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Solver(name) => write!(
                f,
                "'{name}' makes its own steps: check that it takes impulses whole (conformance::participant); if its law is \
                 not linear, half its step must leave a quarter of this"
            ),
            Self::Nodal(name) => write!(
                f,
                "the nodal weights of '{name}' do not keep the energy; take weights of elements and bonds"
            ),
            Self::Anybody => write!(
                f,
                "check that the forces of each model are the slope of its energy (conformance::forces_derive_from_energy), or \
                 take a shorter step"
            ),
        }
    }
}

impl Warning {
    /// Whether both speak of the same fault of the same object.
    fn is_about(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::EnergyUnknown { model: a }, Self::EnergyUnknown { model: b })
            | (Self::ImpulseMissed { model: a, .. }, Self::ImpulseMissed { model: b, .. })
            | (Self::VelocityJump { interface: a, .. }, Self::VelocityJump { interface: b, .. })
            | (Self::DisplacementJump { interface: a, .. }, Self::DisplacementJump { interface: b, .. }) => {
                a == b
            }
            (Self::EnergyDrift { .. }, Self::EnergyDrift { .. }) => true,
            (
                Self::MomentumChanged {
                    models: a,
                    angular: k,
                    ..
                },
                Self::MomentumChanged {
                    models: b,
                    angular: l,
                    ..
                },
            ) => a == b && k == l,
            _ => false,
        }
    }

    /// The figure that is held against a limit.
    fn share(&self) -> f64 {
        match self {
            Self::EnergyUnknown { .. } => 0.0,
            Self::EnergyDrift { share, .. }
            | Self::ImpulseMissed { share, .. }
            | Self::MomentumChanged { share, .. }
            | Self::VelocityJump { share, .. }
            | Self::DisplacementJump { share, .. } => *share,
        }
    }
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::EnergyUnknown { model } => write!(
                f,
                "the energy of '{model}' is not known, since it tells no invariant: the balance counts what impulses brought \
                 to it and cannot see what became of that; its impulses and the momentum are checked instead"
            ),
            Self::EnergyDrift {
                step,
                time,
                drift,
                share,
                limit,
                suspect,
            } => {
                let what = if *drift < 0.0 {
                    "is missing that no effect took"
                } else {
                    "is there that no effect brought"
                };
                write!(
                    f,
                    "step {step} (t = {time:.3e} s): an energy of {:.3e} J {what}, {share:.1e} of the largest energy so far \
                     (the laws of the models explain {limit:.1e}): {suspect}",
                    drift.abs()
                )
            }
            Self::ImpulseMissed { model, share, limit } => write!(
                f,
                "model '{model}': an impulse changed its momentum by {share:.1e} of the impulse more or less than it should \
                 (round-off explains {limit:.1e}): its velocities must change by impulse over inertia"
            ),
            Self::MomentumChanged {
                models,
                angular,
                share,
                limit,
                because,
            } => {
                let which = if *angular { "angular" } else { "linear" };
                write!(
                    f,
                    "body '{}': its {which} momentum has changed by up to {share:.2e} of what is in play (limit {limit:.0e}); ",
                    models.join(" + ")
                )?;
                match because {
                    Some(why) => write!(f, "it is kept for small displacements only, since {why}"),
                    None => write!(
                        f,
                        "nothing acts from outside: a law without reaction, a solver with loads of its own, or numbers that \
                         ran out of digits"
                    ),
                }
            }
            Self::VelocityJump {
                interface,
                step,
                iterations,
                share,
                limit,
            } => {
                write!(
                    f,
                    "interface '{interface}', step {step}: velocities of the two models differ by {share:.1e} of the largest \
                     velocity (limit {limit:.0e})"
                )?;
                match iterations {
                    0 => write!(
                        f,
                        ": the multipliers are close to dependent; coarsen the mediator"
                    ),
                    n => write!(
                        f,
                        " after {n} iterations for the multipliers, which did not reach their tolerance: coarsen the mediator, \
                         whose multipliers are dependent or close to it, or allow more iterations"
                    ),
                }
            }
            Self::DisplacementJump {
                interface,
                models,
                own_steps,
                jump,
                share,
                limit,
            } => displacement_jump(f, interface, models, *own_steps, [*jump, *share, *limit]),
        }
    }
}

/// The text of [`Warning::DisplacementJump`]: `figures` are the jump \[m\], its share and the limit.
fn displacement_jump(
    f: &mut fmt::Formatter<'_>,
    interface: &str,
    [coarse, fine]: &[String; 2],
    own_steps: [usize; 2],
    [jump, share, limit]: [f64; 3],
) -> fmt::Result {
    let most = if own_steps[0] > own_steps[1] { coarse } else { fine };
    // With one own step each it is implicit ones that part them.
    let fewer = match own_steps.iter().max() {
        Some(1) | None => String::new(),
        _ => format!("give '{most}' fewer, or "),
    };
    write!(
        f,
        "interface '{interface}': displacements of '{coarse}' and '{fine}' have differed by up to {jump:.2e} m, \
         {:.1} % of the deformation of the overlap (limit {:.0} %), with {} and {} own steps in a step of the run: \
         {fewer}take shorter steps of the run (time.step.seconds); one explicit step each keeps the two together",
        100.0 * share,
        100.0 * limit,
        own_steps[0],
        own_steps[1]
    )
}

impl<T: Real> Coupled<T> {
    /// What a user should know so far, each fault of each object once, with its largest figure.
    pub fn warnings(&self) -> &[Warning] {
        &self.warnings
    }

    /// Keeps a warning; of one that is known already the larger figure.
    pub(super) fn warn(&mut self, warning: Warning) {
        match self.warnings.iter_mut().find(|w| w.is_about(&warning)) {
            Some(known) if known.share() < warning.share() => *known = warning,
            Some(_) => {}
            None => self.warnings.push(warning),
        }
    }

    /// Tells an observer the warnings that it has not heard yet.
    pub(super) fn tell_warnings(&mut self, observer: &mut dyn Observer<T>) {
        for warning in &self.warnings[self.told..] {
            observer.warning(warning);
        }
        self.told = self.warnings.len();
    }
}
