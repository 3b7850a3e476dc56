//! Construction of a coupled run: checks, operators, consistent start.

use super::apart::Overlap;
use super::own_steps::{Held, Lockstep};
use super::{Coupled, Ledger, motions, one_sided, pace, pairs, partition, portions, rezone, tie};
use crate::effect::PairSpec;
use crate::error::invalid;
use crate::interface::joint::{self, Joint};
use crate::interface::{Draft, Interface, InterfaceReport, InterfaceSpec, Side};
use crate::phase::SetupPhase;
use crate::subdomain::Subdomain;
use crate::weight::Weighting;
#[cfg(doc)]
use crate::{Error, OwnStep};
use crate::{Real, Result};

/// How the macro step (step of the run) is chosen: the time between two reflections, in which each
/// participant makes its own steps ([`OwnStep`]).
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TimeStep<T> {
    /// Macro step \[s\]; refused if an own step exceeds the critical step of its participant.
    Seconds(T),
    /// Longest macro step for which every own step is at most this share, below one, of its participant's
    /// critical step.
    Fraction(T),
    /// Puts the finest participant at this share, below one, of its critical step. The macro step is one to
    /// four such steps: as many as fit into half of the largest critical step, or into this share of it if
    /// that is less. Participants with [`OwnStep::Same`] make as many own steps as they need.
    Chosen(T),
    /// Macro step \[s\] without a check against critical steps, for studies of stability.
    Unchecked(T),
}

/// Models, interfaces and effects from which a run is built.
#[derive(Debug)]
pub struct Parts<T: Real> {
    /// Time of the initial state \[s\].
    pub start: T,
    /// Time at which the run is to end \[s\], if known: prescribed motions are compared until then.
    pub end: Option<T>,
    /// Models with their weights, supports, effects and initial states.
    pub subdomains: Vec<Subdomain<T>>,
    /// Interfaces between the models.
    pub interfaces: Vec<InterfaceSpec<T>>,
    /// Effects between two models.
    pub pairs: Vec<PairSpec<T>>,
}

/// Limits at which a run is stopped.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Guard<T> {
    /// Macro steps between two evaluations of the energy ledger.
    pub interval: usize,
    /// Unexplained energy that ends the run: an excess relative to initial energy and work put in, or a loss
    /// relative to the largest energy so far.
    pub growth: T,
}

impl<T: Real> Guard<T> {
    /// Returns the guard for a weighting: growth of at most 5 % for energy-consistent weights, tenfold for
    /// nodal weights.
    ///
    /// Energy-consistent weighting drifts by round-off for linear laws and at second order for others
    /// ([`Coupled::explained_drift`]); any more is a fault or an instability. Nodal weighting changes the
    /// energy by up to its own size by construction.
    pub fn for_weighting(weighting: Weighting) -> Self {
        let growth = if weighting == Weighting::Energy {
            0.05
        } else {
            10.0
        };
        Self {
            interval: 10,
            growth: T::of(growth),
        }
    }
}

/// Summary of a run, for reports before it starts.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Name, kind, nodes, unknowns and critical step \[s\] of every model.
    pub models: Vec<(String, String, usize, usize, f64)>,
    /// For every model: true if its critical step is a lower bound, which was enough for a given step.
    pub bounded: Vec<bool>,
    /// Own steps of every model in a macro step.
    pub own_steps: Vec<usize>,
    /// Macro step \[s\].
    pub dt: f64,
    /// Smallest critical step of a model \[s\].
    pub critical_dt: f64,
    /// Interfaces.
    pub interfaces: Vec<InterfaceReport>,
    /// Names of the effects that are on: `model/effect`, or the effect's own name if it acts between two
    /// models.
    pub effects: Vec<String>,
}

impl<T: Real> Coupled<T> {
    /// Builds a run: weights the models, checks and factors the interfaces, chooses or checks the macro step,
    /// and makes initial displacements, velocities and accelerations consistent with the constraint.
    ///
    /// # Errors
    /// Errors of every set-up check of models, effects and interfaces; [`Error::UnstableStep`].
    pub fn new(
        subdomains: Vec<Subdomain<T>>,
        interfaces: Vec<InterfaceSpec<T>>,
        step: TimeStep<T>,
        guard: Option<Guard<T>>,
    ) -> Result<Self> {
        Self::starting_at(T::zero(), subdomains, interfaces, step, guard)
    }

    /// Builds a run whose initial state is that of time `start` \[s\]. Loads and prescribed motions use that
    /// time from the first evaluation on, and time is counted from there.
    ///
    /// # Errors
    /// Errors of [`Self::new`]; [`Error::InvalidParameter`] for a start that is not finite.
    pub fn starting_at(
        start: T,
        subdomains: Vec<Subdomain<T>>,
        interfaces: Vec<InterfaceSpec<T>>,
        step: TimeStep<T>,
        guard: Option<Guard<T>>,
    ) -> Result<Self> {
        let parts = Parts {
            start,
            end: None,
            subdomains,
            interfaces,
            pairs: Vec::new(),
        };
        Self::from_parts(parts, step, guard)
    }

    /// Builds a run from all its parts, effects between two subdomains included.
    ///
    /// # Errors
    /// Errors of [`Self::starting_at`] and of the effects; [`Error::InvalidParameter`] for an effect between
    /// a subdomain and itself.
    pub fn from_parts(parts: Parts<T>, step: TimeStep<T>, guard: Option<Guard<T>>) -> Result<Self> {
        Self::announced(parts, step, guard, &mut |_| ())
    }

    /// Builds a run like [`Self::from_parts`] and calls `announce` before each phase of the set-up.
    ///
    /// # Errors
    /// Errors of [`Self::from_parts`].
    pub fn announced(
        parts: Parts<T>,
        step: TimeStep<T>,
        guard: Option<Guard<T>>,
        announce: &mut dyn FnMut(SetupPhase),
    ) -> Result<Self> {
        let Parts {
            start,
            end,
            mut subdomains,
            interfaces,
            pairs,
        } = parts;
        let paired = paired_subdomains(start, subdomains.len(), &pairs)?;
        portions::check(&subdomains, &interfaces, &pairs)?;
        for (k, (s, paired)) in subdomains.iter_mut().zip(paired).enumerate() {
            // Weights come first: the partition check and the interfaces read weighted inertia.
            announce(SetupPhase::Weights(k));
            s.prepare(paired)?;
        }
        announce(SetupPhase::Partition);
        let (partition, findings) = partition::check(&subdomains, &interfaces)?;
        let (mut built, mut joints) = interfaces_of(&interfaces, findings, &subdomains, announce)?;
        announce(SetupPhase::Step);
        check_motions(&mut built, &subdomains, (start, end))?;
        let mut overlaps: Vec<_> = built.iter().map(|i| Overlap::new(i, &subdomains)).collect();
        let mut held: Vec<_> = built.iter().map(|i| Held::new(i, &subdomains)).collect();
        // Interfaces and overlaps are built from whole models; from here on each rank keeps its parts.
        portions::partition_models(&mut subdomains, &mut built, &mut joints, &mut overlaps, &mut held)?;
        for i in &mut built {
            let warnings = one_sided::warnings(i, &subdomains);
            i.report.warnings.extend(warnings);
        }
        // Pair effects must know which nodes the interfaces tie.
        let pairs = pairs::attach(pairs, &subdomains, &built, announce)?;
        if !pairs.is_empty() {
            announce(SetupPhase::Step);
        }
        // Effects are attached by now: they shorten critical steps.
        let steps = subdomains.iter_mut().enumerate().map(|(k, s)| {
            let asked = pace::asked(step, s.step_choice());
            s.critical_step(&pairs::demands(&pairs, k), asked)
        });
        let steps: Vec<(T, bool)> = steps.collect::<Result<_>>()?;
        let (critical, bounded): (Vec<T>, Vec<bool>) = steps.into_iter().unzip();
        let between: Vec<_> = pairs.iter().map(|p| p.sides).collect();
        let lockstep = Lockstep::groups(subdomains.len(), &between);
        let pace = pace::choose(step, &critical, &subdomains, &lockstep)?;
        for (s, steps) in subdomains.iter_mut().zip(pace.steps) {
            s.set_pace(pace.dt, steps)?;
        }
        let guard = checked_guard(guard, &subdomains)?;
        let mut run = Self {
            subdomains,
            interfaces: built,
            joints,
            held,
            overlaps,
            lockstep,
            pairs,
            critical,
            bounded,
            dt: pace.dt,
            time: start,
            start_time: start,
            step: 0,
            guard,
            ledger: Ledger::new(),
            start_loss: T::zero(),
            rounded: T::zero(),
            partition,
            work: Vec::new(),
            is_checked: !matches!(step, TimeStep::Unchecked(_)),
            conversions: rezone::Conversions::none(),
            warnings: Vec::new(),
            warnings_sent: 0,
            factored: None,
            relaxes: false,
        };
        announce(SetupPhase::Start);
        run.start()?;
        portions::check_communication(&run.subdomains)?;
        run.warn_of_unknown_energy();
        Ok(run)
    }

    /// Returns the summary of this run.
    pub fn plan(&self) -> Plan {
        let models = self.subdomains.iter().zip(&self.critical).map(|(s, c)| {
            let layout = s.model().layout();
            (
                s.model().name().to_owned(),
                s.model().kind().to_owned(),
                // Counts are those of whole models on every rank.
                s.owned().nodes_of_whole(),
                s.owned().whole_layout(&layout).dofs(),
                c.as_f64(),
            )
        });
        let effects = self.effects().into_iter().map(|e| e.name).collect();
        Plan {
            models: models.collect(),
            bounded: self.bounded.clone(),
            own_steps: self.subdomains.iter().map(Subdomain::own_steps).collect(),
            dt: self.dt.as_f64(),
            critical_dt: self.critical.iter().fold(f64::INFINITY, |a, b| a.min(b.as_f64())),
            interfaces: self.interfaces.iter().map(|i| i.report().clone()).collect(),
            effects,
        }
    }
}

/// Returns for each of `count` subdomains whether a pair effect acts on it; refuses a start time that is not
/// finite, a run without models and pair effects between subdomains that do not exist.
fn paired_subdomains<T: Real>(start: T, count: usize, pairs: &[PairSpec<T>]) -> Result<Vec<bool>> {
    if !start.is_finite() {
        return Err(invalid("start time", start, "must be finite [s]"));
    }
    if count == 0 {
        return Err(invalid("subdomains", 0, "a run needs at least one model"));
    }
    let mut paired = vec![false; count];
    for p in pairs {
        pairs::check(p, count)?;
        p.sides.iter().for_each(|&s| paired[s] = true);
    }
    Ok(paired)
}

/// Refuses prescribed motions that tear tied models apart between two times \[s\], and warns about motions of
/// one side only.
fn check_motions<T: Real>(
    built: &mut [Interface<T>],
    subdomains: &[Subdomain<T>],
    (start, end): (T, Option<T>),
) -> Result<()> {
    let span = motions::Span {
        start: start.as_f64(),
        end: end.map(|t| t.as_f64()),
    };
    for i in built {
        motions::check(i, subdomains, span)?;
        let warning = motions::one_sided(i, subdomains);
        i.report.warnings.extend(warning);
    }
    Ok(())
}

/// Interfaces, and the joints that solve several of them as one system.
pub(super) type Tied<T> = (Vec<Interface<T>>, Vec<Joint<T>>);

/// Builds the interfaces, each with the findings of the partition check, and joins interfaces that share
/// nodes.
pub(super) fn interfaces_of<T: Real>(
    specs: &[InterfaceSpec<T>],
    findings: Vec<Result<partition::TieFindings>>,
    subdomains: &[Subdomain<T>],
    announce: &mut dyn FnMut(SetupPhase),
) -> Result<Tied<T>> {
    let mut drafts = Vec::with_capacity(specs.len());
    for (k, (spec, findings)) in specs.iter().zip(findings).enumerate() {
        let sides = [
            side(subdomains, spec, spec.coarse)?,
            side(subdomains, spec, spec.fine)?,
        ];
        announce(SetupPhase::Junction(k));
        let mut draft = Draft::new(spec, sides)?;
        tie::refuse_asleep(&draft, subdomains)?;
        // Errors of the interface itself come before those of its overlap.
        let findings = findings?;
        draft.interface.report.outside = findings.outside;
        draft.interface.report.warnings.extend(findings.warnings);
        draft.interface.report.tied = tie::tied_shares(&draft.interface, subdomains);
        drafts.push(draft);
    }
    let nodes: Vec<_> = subdomains.iter().map(|s| s.model().layout().nodes).collect();
    let inverse: Vec<_> = subdomains.iter().map(Subdomain::inverse_inertia).collect();
    let (mut joints, mut alone) = (Vec::new(), vec![true; specs.len()]);
    for members in joint::groups(&drafts, &nodes).into_iter().filter(|m| m.len() > 1) {
        announce(SetupPhase::Operator(members[0]));
        members.iter().for_each(|k| alone[*k] = false);
        joints.push(Joint::new(members, specs, &mut drafts, &inverse)?);
    }
    // Interfaces in a joint have no operator of their own: the joint holds that of all of them.
    let mut built = Vec::with_capacity(specs.len());
    for (k, (draft, spec)) in drafts.into_iter().zip(specs).enumerate() {
        if alone[k] {
            announce(SetupPhase::Operator(k));
            let inverse = draft.interface.sides.map(|s| inverse[s]);
            built.push(draft.alone(spec, inverse)?);
        } else {
            built.push(draft.interface);
        }
    }
    Ok((built, joints))
}

fn side<'a, T: Real>(
    subdomains: &'a [Subdomain<T>],
    spec: &InterfaceSpec<T>,
    k: usize,
) -> Result<Side<'a, T>> {
    if k >= subdomains.len() || spec.coarse == spec.fine {
        let what = format!("subdomain of interface '{}'", spec.name);
        return Err(invalid(
            &what,
            k,
            &format!("must be two different ones of {}", subdomains.len()),
        ));
    }
    Ok(Side {
        name: subdomains[k].model().name(),
        field: &**subdomains[k].field(),
        layout: subdomains[k].model().layout(),
        inverse_inertia: subdomains[k].inverse_inertia(),
        sleeping: subdomains[k].has_sleep().then(|| subdomains[k].inertia()),
        weight: &*subdomains[k].weights().kinetic,
    })
}

/// Returns the given guard, or else that of the weighting; refuses limits that are not positive.
fn checked_guard<T: Real>(requested: Option<Guard<T>>, subdomains: &[Subdomain<T>]) -> Result<Guard<T>> {
    // One nodal model is enough: its energy is part of that of the run.
    let nodal = subdomains
        .iter()
        .any(|s| s.weights().weighting == Weighting::Nodal);
    let weighting = if nodal {
        Weighting::Nodal
    } else {
        Weighting::Energy
    };
    let guard = requested.unwrap_or_else(|| Guard::for_weighting(weighting));
    if guard.interval == 0 || !guard.growth.is_finite() || guard.growth <= T::zero() {
        return Err(invalid(
            "guard",
            format_args!("{guard:?}"),
            "interval and growth must be positive",
        ));
    }
    Ok(guard)
}
