//! Warnings of a run: faults that a user should know and that do not end the run.

use super::Coupled;
use super::observer::Observer;
use crate::Real;
use std::fmt;

/// Warning to the user of a run. Each is kept once, with its largest figure so far.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum Warning {
    /// An external solver reports no energy ([`crate::Participant::invariant`]).
    EnergyUnknown {
        /// Name of the model.
        model: String,
    },
    /// The energy balance drifts by more than the laws of the models explain.
    EnergyDrift {
        /// Step number.
        step: usize,
        /// Time \[s\].
        time: f64,
        /// Unexplained energy \[J\]; negative where energy is missing.
        drift: f64,
        /// Modulus of the drift relative to the largest energy so far.
        share: f64,
        /// Share that the laws explain; see [`Coupled::explained_drift`].
        limit: f64,
        /// Most likely cause.
        suspect: Suspect,
    },
    /// An impulse changed the velocities of an external solver by something else than impulse over inertia.
    ImpulseMissed {
        /// Name of the model.
        model: String,
        /// Momentum that is missing or too much, relative to the impulse.
        share: f64,
        /// Share that round-off explains.
        limit: f64,
    },
    /// A momentum that should be kept has changed.
    MomentumChanged {
        /// Names of the models of the body.
        models: Vec<String>,
        /// True for the angular momentum, false for the linear one.
        angular: bool,
        /// Largest change relative to the sum of moduli.
        share: f64,
        /// Largest share that round-off explains; for an angular momentum without a claim, that small
        /// displacements explain.
        limit: f64,
        /// Reason why the angular momentum is kept for small displacements only, if so.
        because: Option<String>,
    },
    /// Velocities of the two sides of an interface differ after the multipliers were solved for.
    VelocityJump {
        /// Name of the interface.
        interface: String,
        /// Step number.
        step: usize,
        /// Iterations of the solution; zero for a direct solution.
        iterations: usize,
        /// Largest velocity jump relative to the largest velocity so far.
        share: f64,
        /// Accepted share.
        limit: f64,
    },
    /// Displacements of the two sides of an interface have parted.
    DisplacementJump {
        /// Name of the interface.
        interface: String,
        /// Names of the coarse and the fine model.
        models: [String; 2],
        /// Own steps of both models in a macro step.
        own_steps: [usize; 2],
        /// Largest jump \[m\].
        jump: f64,
        /// Jump relative to the deformation of the overlap.
        share: f64,
        /// Accepted share.
        limit: f64,
    },
}

/// Most likely cause of an energy error.
#[derive(Debug, Clone, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Suspect {
    /// An external solver, which makes its own steps.
    Solver(String),
    /// A model with nodal weights.
    Nodal(String),
    /// No model in particular.
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
    /// Returns whether both warnings are about the same fault of the same object.
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

    /// Returns the figure that is compared with the limit.
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

/// Writes the text of [`Warning::DisplacementJump`]; the last argument holds the jump \[m\], its share and
/// the limit.
fn displacement_jump(
    f: &mut fmt::Formatter<'_>,
    interface: &str,
    [coarse, fine]: &[String; 2],
    own_steps: [usize; 2],
    [jump, share, limit]: [f64; 3],
) -> fmt::Result {
    let most = if own_steps[0] > own_steps[1] { coarse } else { fine };
    // With one own step each the cause is an implicit step, and fewer steps are no cure.
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
    /// Warnings so far: each fault of each object once, with its largest figure.
    pub fn warnings(&self) -> &[Warning] {
        &self.warnings
    }

    /// Keeps a warning; replaces a known warning if the new figure is larger.
    pub(super) fn warn(&mut self, warning: Warning) {
        match self.warnings.iter_mut().find(|w| w.is_about(&warning)) {
            Some(known) if known.share() < warning.share() => *known = warning,
            Some(_) => {}
            None => self.warnings.push(warning),
        }
    }

    /// Sends the warnings that are new to an observer.
    pub(super) fn send_warnings(&mut self, observer: &mut dyn Observer<T>) {
        for warning in &self.warnings[self.warnings_sent..] {
            observer.warning(warning);
        }
        self.warnings_sent = self.warnings.len();
    }
}
