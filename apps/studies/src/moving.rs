//! Zones that move along a line: a chain of particles (spacing, mass and mean compliance 1) under a bar with
//! elements of length 10. Both cover everything; the chain is awake in a zone and in the ramps beside it.

use crate::line::pulse;
use crate::noise;
use arlequin::core::effect::{Absorber, EffectSpec};
use arlequin::core::nalgebra::Point3;
use arlequin::core::{
    Coupled, Guard, InterfaceSpec, L2, Mediator, NoMediator, OwnStep, Profile, Ramp, Result, Rezoned,
    Rezoning, Silent, Slab, Subdomain, TimeStep, Weights,
};
use arlequin::fem_ref::{Elastic, FemField, FemModel, generate};
use spring_chain::Chain;
use std::sync::Arc;

/// Length of an element of the bar.
pub const H: f64 = 10.0;
/// Length of a ramp.
pub const RAMP: f64 = 4.0 * H;
/// Zone without a place: the chain sleeps everywhere.
pub const NOWHERE: [f64; 2] = [f64::INFINITY, f64::NEG_INFINITY];
/// Index of the bar.
pub const BAR: usize = 0;
/// Index of the chain.
pub const CHAIN: usize = 1;

/// Parameters of a line with a moving zone.
#[derive(Debug, Clone, PartialEq)]
pub struct Moving {
    /// Number of elements of the bar.
    pub cells: usize,
    /// Begin and end of the zone without the bar at the start; the ramps lie beside it.
    pub zone: [f64; 2],
    /// Compliances lie between `1 − scatter` and `1 + scatter`, with this seed.
    pub scatter: f64,
    /// Seed of compliances and of random states.
    pub seed: u64,
    /// Own step of the chain.
    pub step: f64,
    /// Own steps of the chain in a macro step.
    pub own: usize,
    /// Largest rate of absorbers in the ramps; zero for none.
    pub absorber: f64,
}

impl Default for Moving {
    fn default() -> Self {
        Self {
            cells: 160,
            zone: [240.0, 360.0],
            scatter: 0.0,
            seed: 1,
            step: 0.5,
            own: 1,
            absorber: 0.0,
        }
    }
}

/// Initial displacements and velocities of bar and chain.
pub type State = [[Vec<f64>; 2]; 2];

/// Sums over the changes of weights of a run, relative to its initial energy.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Account {
    /// Invariant at the start.
    pub start: f64,
    /// Sum of the moduli of all works.
    pub moduli: f64,
    /// Sum of the positive works.
    pub gains: f64,
    /// Largest invariant after a change.
    pub top: f64,
    /// Invariant after the last change.
    pub end: f64,
    /// Largest change of the momentum by the transfer, relative to the momentum at the start or, if that is
    /// less, to `√(2 E M)`, before the rigid motion restores it.
    pub restored: f64,
    /// Number of changes.
    pub count: usize,
}

fn point(x: f64) -> Point3<f64> {
    Point3::new(x, 0.0, 0.0)
}

impl Moving {
    fn ends([a, b]: [f64; 2]) -> [[f64; 2]; 2] {
        [[a, a - RAMP], [b, b + RAMP]]
    }

    /// Returns the weights of bar and chain for a zone.
    ///
    /// # Errors
    /// Errors of the core.
    pub fn weights(zone: [f64; 2]) -> Result<[Weights<f64>; 2]> {
        Self::profiled(zone, &Profile::Cubic)
    }

    /// Returns the weights of bar and chain for a zone, with a profile of the ramps.
    ///
    /// # Errors
    /// Errors of the core.
    pub fn profiled(zone: [f64; 2], profile: &Profile<f64>) -> Result<[Weights<f64>; 2]> {
        if zone == NOWHERE {
            let bar = Weights::uncoupled();
            return Ok([bar.clone(), Weights::complement_of(&[bar])]);
        }
        let mut ramps = Vec::new();
        for [fine, coarse] in Self::ends(zone) {
            let slab = Arc::new(Slab::between(point(fine), point(coarse))?);
            ramps.push(Weights::from_weight(Arc::new(Ramp::new(
                slab,
                profile.clone(),
                0.0,
            )?)));
        }
        let chain = Weights::complement_of(&ramps);
        Ok([Weights::complement_of(std::slice::from_ref(&chain)), chain])
    }

    fn mediators(zone: [f64; 2]) -> Result<Vec<Arc<dyn Mediator<f64>>>> {
        let mediator = |[fine, coarse]: [f64; 2]| -> Result<Arc<dyn Mediator<f64>>> {
            if zone == NOWHERE {
                return Ok(Arc::new(NoMediator));
            }
            let mesh = generate::bar(fine.min(coarse), fine.max(coarse), (RAMP / H) as usize, 1.0)?;
            Ok(Arc::new(FemField::new(mesh)))
        };
        Self::ends(zone).into_iter().map(mediator).collect()
    }

    /// Returns the interfaces for a zone.
    ///
    /// # Errors
    /// Errors of the core.
    pub fn interfaces(zone: [f64; 2]) -> Result<Vec<InterfaceSpec<f64>>> {
        let mediators = Self::mediators(zone)?.into_iter().zip(["left", "right"]);
        Ok(mediators
            .map(|(m, name)| {
                let mut spec = InterfaceSpec::new(name, BAR, CHAIN, m, L2);
                // States of the naive twin contradict themselves.
                spec.options.start_jump = f64::INFINITY;
                spec
            })
            .collect())
    }

    fn effects(&self, zone: [f64; 2]) -> Result<Vec<Box<dyn EffectSpec<f64>>>> {
        if self.absorber <= 0.0 {
            return Ok(Vec::new());
        }
        let mut out: Vec<Box<dyn EffectSpec<f64>>> = Vec::new();
        for (mediator, [fine, _]) in Self::mediators(zone)?.into_iter().zip(Self::ends(zone)) {
            let top = self.absorber;
            let rate = move |x: &Point3<f64>| top * ((x.x - fine).abs() / RAMP).min(1.0);
            out.push(Box::new(Absorber::new(mediator, Arc::new(rate))));
        }
        Ok(out)
    }

    /// Compliances of the springs; their mean is one.
    #[must_use]
    pub fn compliances(&self) -> Vec<f64> {
        let mut next = noise(self.seed);
        let bonds = self.cells * H as usize;
        let raw: Vec<f64> = (0..bonds).map(|_| 1.0 + self.scatter * next()).collect();
        let mean = raw.iter().sum::<f64>() / bonds as f64;
        // The bar has compliance one, so that chains of all seeds are equally long under a load.
        raw.iter().map(|c| c / mean).collect()
    }

    /// Returns bar and chain.
    ///
    /// # Errors
    /// Errors of the models.
    pub fn models(&self) -> Result<(FemModel<f64>, Chain)> {
        let mesh = generate::bar(0.0, H * self.cells as f64, self.cells, 1.0)?;
        let bar = FemModel::new("bar", mesh, Elastic::new(1.0, 0.0, 1.0)?)?;
        let compliances = self.compliances();
        let chain = Chain::new("chain", 0.0, 1.0, compliances.len(), 1.0, 1.0)?;
        Ok((bar, chain.with_stiffness(|b| 1.0 / compliances[b])))
    }

    /// Builds bar and chain with the zone of the start.
    ///
    /// # Errors
    /// Errors of the core and of the models.
    pub fn build(&self, state: &State) -> Result<Coupled<f64>> {
        let [coarse, fine] = Self::weights(self.zone)?;
        let (bar, chain) = self.models()?;
        let [[bar_q, bar_v], [chain_q, chain_v]] = state.clone();
        let bar = Subdomain::coarse(bar, coarse)
            .with_sleep()
            .with_initial(bar_q, bar_v)?;
        let mut chain = Subdomain::fine(chain, fine)
            .with_sleep()
            .with_step(OwnStep::Ratio(self.own))
            .with_initial(chain_q, chain_v)?;
        for e in self.effects(self.zone)? {
            chain = chain.with_effect(e);
        }
        // A check of the step at each change would take most of the time.
        let step = TimeStep::Unchecked(self.step * self.own as f64);
        let guard = Guard {
            interval: 1,
            growth: 0.05,
        };
        let interfaces = Self::interfaces(self.zone)?;
        Coupled::new(vec![bar, chain], interfaces, step, Some(guard))
    }

    /// Moves the zone of a run.
    ///
    /// # Errors
    /// Errors of the change.
    pub fn rezone(&self, run: &mut Coupled<f64>, zone: [f64; 2]) -> Result<Rezoned<f64>> {
        let [coarse, fine] = Self::weights(zone)?;
        let change = Rezoning::new(Self::interfaces(zone)?)
            .with_weights(BAR, coarse)
            .with_weights(CHAIN, fine);
        let effects = self.effects(zone)?.into_iter();
        run.rezone(effects.fold(change, |c, e| c.with_effect(CHAIN, e)))
    }

    /// Moves the zone as a first attempt would: what lives keeps its state, what is born takes that of the
    /// other model. The run is built anew in that state.
    ///
    /// # Errors
    /// Errors of the set-up.
    pub fn naively_moved(&self, run: &Coupled<f64>, zone: [f64; 2]) -> Result<Coupled<f64>> {
        let [bar, chain] = [BAR, CHAIN].map(|k| &run.subdomains()[k]);
        let mut state = [bar, chain].map(|s| [s.state().q.clone(), s.state().v.clone()]);
        for (k, other) in [(BAR, chain), (CHAIN, bar)] {
            let own = &run.subdomains()[k];
            for (i, x) in own
                .model()
                .nodes()
                .iter()
                .enumerate()
                // Only nodes that were asleep are born; the others keep their state.
                .filter(|(i, _)| own.is_asleep(*i))
            {
                let values = other.sample(x)?;
                (0..2).for_each(|what| state[k][what][i] = values[what].x);
            }
        }
        let moved = Self { zone, ..self.clone() };
        moved.build(&state)
    }

    /// State with displacement and velocity given at each place.
    pub fn state(&self, wave: impl Fn(f64) -> (f64, f64)) -> State {
        let on = |spacing: f64, count: usize| {
            let (q, v) = (0..=count).map(|k| wave(spacing * k as f64)).unzip();
            [q, v]
        };
        [on(H, self.cells), on(1.0, self.cells * H as usize)]
    }

    /// State of a pulse of the given total width in the middle of the zone, that travels to the right.
    #[must_use]
    pub fn pulse(&self, width: f64) -> State {
        let middle = 0.5 * (self.zone[0] + self.zone[1]);
        self.state(pulse(middle, 0.5 * width, 0.0, 1.0))
    }

    /// State of random velocities.
    #[must_use]
    pub fn random(&self) -> State {
        // Another sequence than that of the compliances.
        let mut next = noise(1000 + self.seed);
        let mut random = |count: usize| [vec![0.0; count], (0..count).map(|_| next()).collect()];
        [random(self.cells + 1), random(self.cells * H as usize + 1)]
    }

    /// Moves the zone `count` times by `shift`, each time after it could have gone there at `speed`; observes
    /// every change by `watch`.
    ///
    /// # Errors
    /// Errors of the steps and of the changes.
    pub fn carry(
        &self,
        run: &mut Coupled<f64>,
        (count, shift, speed): (usize, f64, f64),
        watch: &mut dyn FnMut(&Coupled<f64>, &Rezoned<f64>),
    ) -> Result<Account> {
        let mut account = Account::default();
        let mut steps = 0;
        for n in 1..=count {
            // From the start and not from the change before, so that rounding does not add up.
            let due = (n as f64 * shift.abs() / speed / run.dt()).round() as usize;
            run.run(due - steps, &mut Silent)?;
            steps = due;
            // From the first zone on, for the same reason.
            let zone = self.zone.map(|x| x + n as f64 * shift);
            let change = self.rezone(run, zone)?;
            account.add(run, &change);
            watch(run, &change);
        }
        Ok(account)
    }
}

impl Account {
    /// Adds a change that followed a step with the balance drawn.
    pub fn add(&mut self, run: &Coupled<f64>, change: &Rezoned<f64>) {
        let invariant = run.last_energy().map_or(f64::NAN, |e| e.invariant);
        if self.count == 0 {
            self.start = invariant;
        }
        let mass: f64 = run.subdomains().iter().flat_map(Subdomain::inertia).sum();
        let momentum = change
            .motions
            .iter()
            .map(|m| m[0].norm() * mass)
            .fold(0.0, f64::max);
        self.restored = self.restored.max(momentum / (2.0 * self.start * mass).sqrt());
        self.moduli += change.work.abs() / self.start;
        self.gains += change.work.max(0.0) / self.start;
        self.end = (invariant + change.work) / self.start;
        self.top = self.top.max(self.end);
        self.count += 1;
    }
}
