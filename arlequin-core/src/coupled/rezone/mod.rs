//! Zones that move: a change of the weights in the middle of a run.
//!
//! At a macro instant, in the middle of a reflection, the weights go from `α` to `α'`. What changes hands
//! carries the state `x = q, v` of the giver:
//!
//! ```text
//! m_i' x_i' = m_i x_i + Δm_i (T x_C)_i      fine nodes that gain mass;  T: coarse field at the node
//! M_j' x_j' = M_j x_j + ΔM_j (Π x_D)_j      coarse nodes that gain mass; Π: linear mean of the fine nodes
//! x' = x                                    nodes that give
//! ```
//!
//! A node is born with `m = 0` and dies with `m' = 0`. Then the start is made consistent with the new
//! multipliers, as at set-up, and one rigid motion restores linear and angular momentum. The change `W` of
//! the invariant is a work of its own in the ledger, so that the balance closes to round-off; its parts tell
//! where it comes from. `docs/design/moving-zones.md` has the reasons and the measured sizes.

mod fit;
mod rigid;
mod transfer;

use super::apart::Overlap;
use super::own_steps::Held;
use super::start::Jumps;
use super::{Coupled, motions, one_sided, pairs, partition, portions, setup};
use crate::effect::EffectSpec;
use crate::error::invalid;
use crate::interface::InterfaceSpec;
use crate::subdomain::{NewEffect, OwnStep, Subdomain};
use crate::weight::{Changed, Weights};
use crate::{Error, Real, Result};
use nalgebra::{Matrix3, Vector3};
use std::sync::Arc;
use transfer::Giver;

/// Displacement \[m\] and rotation \[rad\] of a fine node beside those of the coarse field, in each of the
/// unit strains of [`Response::STRAINS`]. A body that is not homogeneous carries no field of uniform strain
/// in equilibrium: a random packing shares a load unevenly.
///
/// Single precision: responses are known to a few per mille, and a run keeps twelve vectors for each node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Response(pub [[Vector3<f32>; 2]; 6]);

impl Response {
    /// Places in a gradient of the strains `xx yy zz yz zx xy` (shears as `γ = 2ε`).
    pub const STRAINS: [[usize; 2]; 6] = [[0, 0], [1, 1], [2, 2], [1, 2], [2, 0], [0, 1]];

    /// Symmetric gradients of the strains of [`Self::STRAINS`], each of size `size` \[–\].
    pub fn gradients<T: Real>(size: T) -> [Matrix3<T>; 6] {
        let half = size * T::of(0.5);
        Self::STRAINS.map(|[i, j]| {
            let mut out = Matrix3::zeros();
            out[(i, j)] += half;
            out[(j, i)] += half;
            out
        })
    }

    /// Strains \[–\] of a field with the gradient `∂u_i/∂x_j`, in the order of [`Self::STRAINS`].
    pub fn strains<T: Real>(gradient: &Matrix3<T>) -> [T; 6] {
        Self::STRAINS.map(|[i, j]| match i == j {
            true => gradient[(i, i)],
            false => gradient[(i, j)] + gradient[(j, i)],
        })
    }

    /// Displacement and rotation in a field with the gradient `∂u_i/∂x_j` \[–\].
    pub fn in_gradient<T: Real>(&self, gradient: &Matrix3<T>) -> [Vector3<T>; 2] {
        let mut out = [Vector3::zeros(); 2];
        for (e, units) in Self::strains(gradient).iter().zip(&self.0) {
            (0..2).for_each(|w| out[w] += units[w].map(|x| T::of(f64::from(x))) * *e);
        }
        out
    }
}

/// New weights of a run, and what must be made anew with them ([`Coupled::rezone`]).
///
/// Interfaces are given as at set-up: all of the run, in the same order and under the same names, each with
/// the mediator of its new overlap. A subdomain that gets new weights gets all of its effects again, too.
pub struct Rezoning<T: Real> {
    weights: Vec<(usize, Weights<T>)>,
    /// Effects by subdomain.
    effects: Vec<(usize, NewEffect<T>)>,
    interfaces: Vec<InterfaceSpec<T>>,
    responses: Vec<(usize, Arc<Vec<Response>>)>,
    changed: Option<Arc<Changed<T>>>,
}

impl<T: Real> std::fmt::Debug for Rezoning<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Rezoning")
            .field("weights", &self.weights)
            .field("interfaces", &self.interfaces)
            .finish_non_exhaustive()
    }
}

impl<T: Real> Rezoning<T> {
    /// Makes a change of the overlaps to those of `interfaces`; weights follow by [`Self::with_weights`].
    #[must_use]
    pub fn new(interfaces: Vec<InterfaceSpec<T>>) -> Self {
        Self {
            weights: Vec::new(),
            effects: Vec::new(),
            interfaces,
            responses: Vec::new(),
            changed: None,
        }
    }

    /// Tells where the new weights differ from those of before. Elsewhere cells keep their means, and sums of
    /// weights are not checked again: a change then costs what it changes.
    #[must_use]
    pub fn with_changes(mut self, changed: Arc<Changed<T>>) -> Self {
        self.changed = Some(changed);
        self
    }

    /// Adds the responses of all nodes of a fine subdomain to strains of its coarse partners: what its nodes
    /// receive is then nearer to equilibrium than the coarse field alone.
    #[must_use]
    pub fn with_responses(mut self, subdomain: usize, responses: Arc<Vec<Response>>) -> Self {
        self.responses.push((subdomain, responses));
        self
    }

    /// Adds the new weights of a subdomain.
    #[must_use]
    pub fn with_weights(mut self, subdomain: usize, weights: Weights<T>) -> Self {
        self.weights.push((subdomain, weights));
        self
    }

    /// Adds an effect of a subdomain with new weights, made for these weights. Effects come in the order in
    /// which the subdomain got them; each keeps its work and what it remembers.
    #[must_use]
    pub fn with_effect(mut self, subdomain: usize, effect: Box<dyn EffectSpec<T>>) -> Self {
        self.effects.push((subdomain, Some(effect)));
        self
    }

    /// Keeps an effect of a subdomain with new weights, in its place among the calls of
    /// [`Self::with_effect`]. The effect adapts itself to the weights ([`crate::effect::Effect::reweigh`]).
    #[must_use]
    pub fn with_kept_effect(mut self, subdomain: usize) -> Self {
        self.effects.push((subdomain, None));
        self
    }
}

/// Result of a change of weights. Energies are changes of the run's energy \[J\].
#[derive(Debug, Clone, PartialEq)]
pub struct Rezoned<T: Real> {
    /// Change `W` of the invariant: the sum of the four parts.
    pub work: T,
    /// Part by the internal energy, from the transfer of displacements.
    pub potential: T,
    /// Part by the kinetic energy, from the transfer of velocities.
    pub kinetic: T,
    /// Part by the rigid motions that restore the momenta.
    pub rigid: T,
    /// Remaining part: the consistent start.
    pub start: T,
    /// Share of the start: change of the internal energy as jumps between the displacements are closed in the
    /// metric of the masses. Measured changes have been positive.
    pub closing: T,
    /// Velocity \[m/s\] and spin \[rad/s\] of the rigid motion of each group of subdomains that interfaces
    /// join, about the centre of its body of [`Coupled::bodies`].
    pub motions: Vec<[Vector3<T>; 2]>,
    /// Number of nodes of each model that were awake before and that are awake now.
    pub awake: Vec<[usize; 2]>,
}

/// Account of the changes of weights so far.
#[derive(Debug, Clone)]
pub(super) struct Conversions<T> {
    pub(super) count: usize,
    /// Works \[J\]: potential, kinetic, rigid, start.
    pub(super) parts: [T; 4],
}

impl<T: Real> Conversions<T> {
    pub(super) fn none() -> Self {
        Self {
            count: 0,
            parts: [T::zero(); 4],
        }
    }

    /// Work since the start \[J\]; `None` if weights never changed.
    pub(super) fn work(&self) -> Option<T> {
        (self.count > 0).then(|| self.parts.iter().copied().sum())
    }
}

impl<T: Real> Coupled<T> {
    /// Changes the weights of models between two macro steps, so that a fine zone can move. Masses that
    /// change hands carry the displacements and velocities of the model that gives them; momenta are kept.
    /// The work of the change is the line "rezoning" of [`Coupled::works`], with four parts.
    ///
    /// A model makes more own steps from then on if the present ones are too long for its new weights.
    /// Nodes whose weight becomes zero sleep; their models must allow it ([`Subdomain::with_sleep`]). Between
    /// two changes a run computes what it computes without them.
    ///
    /// ```
    /// # use arlequin_core::{Coupled, Rezoning, InterfaceSpec, Weights, Result};
    /// /// Moves the zone of a run of body (0) and particles (1) to where `body` now is below one.
    /// fn follow(run: &mut Coupled<f64>, body: Weights<f64>, overlap: InterfaceSpec<f64>) -> Result<f64> {
    ///     let particles = Weights::complement_of(std::slice::from_ref(&body));
    ///     let change = Rezoning::new(vec![overlap])
    ///         .with_weights(0, body)
    ///         .with_weights(1, particles);
    ///     Ok(run.rezone(change)?.work)
    /// }
    /// ```
    ///
    /// # Errors
    /// [`Error::Unsupported`] for external solvers, models in parts on several ranks, weights at nodes,
    /// models that change themselves and cannot [sleep](crate::Evolving::sleep), effects between two models
    /// that an interface ties or that cannot take new weights ([`crate::effect::PairEffect::reweigh`]), and a
    /// node that would wake without a giver.
    /// [`Error::InvalidParameter`] for interfaces or effects that are not those of the run. Errors of the
    /// set-up for weights and interfaces; [`Error::UnstableStep`] if the new weights need more own steps
    /// than a model was asked to make ([`OwnStep::Ratio`]). The run is unusable after an error of the
    /// set-up.
    pub fn rezone(&mut self, change: Rezoning<T>) -> Result<Rezoned<T>> {
        self.check_rezoning(&change)?;
        let Rezoning {
            weights,
            mut effects,
            interfaces,
            responses,
            changed,
        } = change;
        let changed = changed.as_deref();
        // The invariant that the next step would have found. Nothing is changed before, so an error up to
        // here leaves the run usable.
        let (ahead, mut energies) = (self.invariant_ahead()?, vec![self.energies()]);
        // Momenta and givers are those before the change: a model that gives mass has other values after it.
        let groups = self.joined_groups();
        let momenta = self.momenta_of_groups(&groups);
        let givers: Vec<_> = self.subdomains.iter().map(Giver::new).collect();
        let changing: Vec<usize> = weights.iter().map(|w| w.0).collect();
        for (k, weights) in weights {
            let own_effects = effects.extract_if(.., |e| e.0 == k).map(|e| e.1).collect();
            self.subdomains[k].reweigh(weights, own_effects, changed)?;
        }
        // All weights are new by now, so that a gain is the difference between both masses of a node, in
        // whatever order the subdomains came.
        transfer::hand_over(&mut self.subdomains, &givers, (&interfaces, &responses))?;
        // Taken before displacement jumps are removed: the parts "potential" and "kinetic" are those of the
        // transfer alone.
        energies.push(self.energies());
        // After the transfer and before the start: the operators of the interfaces hold the new masses.
        self.tie_anew(&interfaces, changed)?;
        self.reweigh_pairs(&changing)?;
        self.check_steps(&givers)?;
        // Jumps of any size are removed. At set-up a large jump is a fault of the input; a jump here comes
        // from the transfer.
        self.start_positions(Jumps::Removed)?;
        let closing = self.energies()[0] - energies[1][0];
        let [potential, kinetic] = [0, 1].map(|k| energies[1][k] - energies[0][k]);
        let before = self.kinetic_energy();
        // The statements below keep the momenta, so one rigid motion restores them for good.
        let motions = self.restore_momenta(&groups, &momenta);
        let rigid = self.kinetic_energy() - before;
        self.start_forces()?;
        self.reflect_start()?;
        self.check_start()?;
        // The same formula as before the change. The balance of the next step therefore still tests the step.
        let work = self.invariant_ahead()? - ahead;
        // The remainder, so that the four parts add up to the work that is booked.
        let start = work - potential - kinetic - rigid;
        let parts = [potential, kinetic, rigid, start];
        (0..4).for_each(|k| self.conversions.parts[k] += parts[k]);
        self.conversions.count += 1;
        if !work.is_finite() {
            return Err(self.diverged("energy"));
        }
        let awake = givers.iter().zip(&self.subdomains);
        Ok(Rezoned {
            work,
            potential,
            kinetic,
            rigid,
            start,
            closing,
            motions,
            awake: awake
                .map(|(g, s)| [&*g.inertia, s.inertia()].map(|m| transfer::awake(s, m)))
                .collect(),
        })
    }

    /// Number of changes of weights so far.
    pub fn conversions(&self) -> usize {
        self.conversions.count
    }

    /// Works of all changes of weights so far \[J\]: potential, kinetic, rigid motion and consistent start,
    /// as in [`Rezoned`].
    pub fn rezoning_works(&self) -> [T; 4] {
        self.conversions.parts
    }

    /// Fingerprint of the present weights: of the inertias of all models.
    pub(super) fn weights_fingerprint(&self) -> u64 {
        // FNV-1a: the same number from any compiler, since snapshots outlive programs.
        let inertias = self.subdomains.iter().flat_map(Subdomain::inertia);
        inertias.fold(0xcbf2_9ce4_8422_2325, |hash, m| {
            (hash ^ m.as_f64().to_bits()).wrapping_mul(0x0100_0000_01b3)
        })
    }

    /// Refuses a change that this run cannot make, before anything is changed.
    fn check_rezoning(&mut self, change: &Rezoning<T>) -> Result<()> {
        portions::require_whole(&self.subdomains, "change its weights")?;
        // Even if its weights stay: the consistent start would have to change its state.
        if let Some(s) = self.subdomains.iter().find(|s| s.is_external()) {
            return Err(Error::Unsupported {
                model: s.model().name().to_owned(),
                what:
                    "be in a run whose weights change: it is a solver of its own, which keeps its state to \
                       itself"
                        .to_owned(),
            });
        }
        let count = self.subdomains.len();
        let subdomains = change.weights.iter().map(|w| w.0);
        for (n, k) in subdomains.clone().enumerate() {
            if k >= count || subdomains.clone().take(n).any(|other| other == k) {
                let rule = format!("must be one of {count}, each once");
                return Err(invalid("subdomain of new weights", k, &rule));
            }
            self.subdomains[k].check_rezoning(&change.weights[n].1)?;
        }
        self.check_pairs(&subdomains.clone().collect::<Vec<_>>())?;
        for (k, responses) in &change.responses {
            let nodes = self.subdomains.get(*k).map_or(0, |s| s.model().layout().nodes);
            if responses.len() != nodes {
                let rule = format!("must be {nodes}, one for each node of subdomain {k}");
                return Err(invalid("number of responses", responses.len(), &rule));
            }
        }
        // Only subdomains with new weights take effects: others would lose theirs without a word.
        if let Some((k, _)) = change
            .effects
            .iter()
            .find(|e| !subdomains.clone().any(|k| k == e.0))
        {
            return Err(invalid(
                "subdomain of a new effect",
                k,
                "must get new weights as well",
            ));
        }
        let known: Vec<_> = self
            .interfaces
            .iter()
            .map(|i| (&i.report.name, i.sides))
            .collect();
        let given: Vec<_> = change
            .interfaces
            .iter()
            .map(|i| (&i.name, [i.coarse, i.fine]))
            .collect();
        if known != given {
            let rule = format!("must be those of the run, {known:?}, each with its new mediator");
            return Err(invalid(
                "interfaces of new weights",
                format_args!("{given:?}"),
                &rule,
            ));
        }
        Ok(())
    }

    /// Invariant \[J\] of all subdomains, as the ledger will find it after the next step.
    fn invariant_ahead(&mut self) -> Result<T> {
        // The invariant belongs to the velocities after the second half of the reflection. This half is
        // applied for the energies only, and taken back below.
        let velocities: Vec<_> = self.subdomains.iter().map(|s| s.state().v.clone()).collect();
        self.apply_second_half();
        let energies: Result<Vec<T>> = self
            .subdomains
            .iter_mut()
            .map(Subdomain::invariant_ahead)
            .collect();
        for (s, v) in self.subdomains.iter_mut().zip(&velocities) {
            s.velocities().copy_from_slice(v);
        }
        Ok(energies?.into_iter().sum())
    }

    fn kinetic_energy(&self) -> T {
        self.subdomains.iter().map(Subdomain::kinetic_energy).sum()
    }

    /// Internal and kinetic energy \[J\].
    fn energies(&self) -> [T; 2] {
        let internal = self.subdomains.iter().map(Subdomain::internal_energy).sum();
        [internal, self.kinetic_energy()]
    }

    /// Builds the interfaces anew for the present weights, with all checks of the set-up.
    fn tie_anew(&mut self, specs: &[InterfaceSpec<T>], changed: Option<&Changed<T>>) -> Result<()> {
        let findings = if let Some(changed) = changed {
            partition::check_changes(&self.subdomains, specs, changed)?;
            specs
                .iter()
                .map(|_| Ok(partition::TieFindings::default()))
                .collect()
        } else {
            let (partition, findings) = partition::check(&self.subdomains, specs)?;
            self.partition = partition;
            findings
        };
        let (mut built, joints) = setup::interfaces_of(specs, findings, &self.subdomains, &mut |_| ())?;
        // Supports are compared from this instant on: what they did before is past.
        let span = motions::Span {
            start: self.time.as_f64(),
            end: None,
        };
        for i in &mut built {
            motions::check(i, &self.subdomains, span)?;
            let more = motions::one_sided(i, &self.subdomains);
            i.report.warnings.extend(more);
            i.report.warnings.extend(one_sided::warnings(i, &self.subdomains));
        }
        self.overlaps = built.iter().map(|i| Overlap::new(i, &self.subdomains)).collect();
        self.held = built.iter().map(|i| Held::new(i, &self.subdomains)).collect();
        (self.interfaces, self.joints) = (built, joints);
        // The factor of the static twin is that of the old weights.
        self.factored = None;
        Ok(())
    }

    /// Makes more own steps where the present ones are too long for the new weights; refuses them if their
    /// number was asked for.
    fn check_steps(&mut self, givers: &[Giver<T>]) -> Result<()> {
        if !self.is_checked {
            return Ok(());
        }
        for (k, giver) in givers.iter().enumerate() {
            let s = &mut self.subdomains[k];
            // The average acceleration is stable at any step. Equal masses mean equal weights, hence the
            // critical step of before.
            if s.step_choice() == OwnStep::Implicit || giver.inertia == s.inertia() {
                continue;
            }
            let (dt, steps) = (s.own_dt(), s.own_steps());
            let (critical, bounded) = s.critical_step(&pairs::demands(&self.pairs, k), Some(dt))?;
            (self.critical[k], self.bounded[k]) = (critical, bounded);
            // Own steps are quotients: an excess in their last digits is round-off.
            if dt <= critical * (T::one() + T::epsilon() * T::of(8.0)) {
                continue;
            }
            let needed = (self.dt / critical).as_f64().ceil() as usize;
            // Models with effects between them make the same own steps.
            let group = self.lockstep.iter().find(|g| g.members.contains(&k));
            for m in group.map_or_else(Vec::new, |g| g.members.clone()) {
                let s = &mut self.subdomains[m];
                if let OwnStep::Ratio(_) = s.step_choice() {
                    return Err(Error::UnstableStep {
                        dt: dt.as_f64(),
                        critical: critical.as_f64(),
                        model: s.model().name().to_owned(),
                        steps,
                        longest: (critical * T::of(steps as f64)).as_f64(),
                        needed,
                    });
                }
                s.set_pace(self.dt, needed)?;
            }
        }
        Ok(())
    }
}
