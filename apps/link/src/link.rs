//! A link as the run uses it: the values received last, and whether they are still valid.

use crate::channel::Channel;
use crate::child::Started;
use crate::error::{Error, Result};
use crate::message::{Description, Fields};
use crate::wire::{Header, Kind, SMALL};
use std::time::Duration;

/// Relative error of a result of few operations that is accepted. No solver says in what precision it
/// computes. Four roundings in single precision (of impulse, mass, quotient and sum) are allowed, and as much
/// again for solvers that convert units.
pub(crate) const ROUNDED: f64 = 8.0 * f32::EPSILON as f64;
/// An impulse tests the mass if round-off hides at most this share of the change of velocity.
const TELLING: f64 = 1e-3;

/// State of the link, which changes with every exchange.
#[derive(Debug)]
pub(crate) struct Link {
    pub(crate) channel: Channel,
    child: Option<Started>,
    pub(crate) offers: Fields,
    /// Fields that are known for the present state of the solver.
    pub(crate) known: Fields,
    pub(crate) v: Vec<f64>,
    pub(crate) q: Vec<f64>,
    pub(crate) a: Vec<f64>,
    pub(crate) invariant: f64,
    /// Inertia under the present weights \[kg, kg m²\].
    pub(crate) inertia: Vec<f64>,
    /// True once an impulse has changed velocities as the inertia predicts.
    pub(crate) trusted: bool,
    broken: Option<Error>,
}

impl Link {
    pub(crate) fn new(channel: Channel, child: Option<Started>) -> Self {
        Self {
            channel,
            child,
            offers: Fields::default(),
            known: Fields::default(),
            v: Vec::new(),
            q: Vec::new(),
            a: Vec::new(),
            invariant: 0.0,
            inertia: Vec::new(),
            trusted: false,
            broken: None,
        }
    }

    /// Stores the description of the solver.
    pub(crate) fn store_description(&mut self, description: &Description) {
        self.channel.peer_limit = description.limit;
        self.offers = description.offers;
        self.inertia.clone_from(&description.inertia);
        for x in [&mut self.v, &mut self.q, &mut self.a] {
            x.resize(description.layout.dofs(), 0.0);
        }
    }

    /// Runs an operation unless an earlier error has broken the link; an error breaks it.
    pub(crate) fn guarded<V>(&mut self, what: impl FnOnce(&mut Self) -> Result<V>) -> Result<V> {
        if let Some(earlier) = &self.broken {
            return Err(Error::Broken {
                peer: self.channel.peer.clone(),
                earlier: earlier.to_string(),
            });
        }
        // After any error the two sides may disagree on what comes next: nothing more is sent.
        what(self).map_err(|e| {
            let e = self.explained(e);
            self.broken = Some(e.clone());
            e
        })
    }

    /// Replaces the error that the connection is closed by the way in which the process ended, if the run
    /// started the process.
    fn explained(&mut self, e: Error) -> Error {
        let (Some(child), Error::Closed { expected, .. }) = (&mut self.child, &e) else {
            return e;
        };
        // The stream closes a moment before the process has ended.
        match child.ended(Duration::from_millis(200)) {
            // "the reading of …", or the message that was due.
            Some(how) => child.ended_early(&how, &format!("its {}", expected.trim_start_matches("the "))),
            None => e,
        }
    }

    /// Sends the message in the channel and receives its answer.
    pub(crate) fn exchange(&mut self, due: Kind, lengths: std::ops::RangeInclusive<u64>) -> Result<Header> {
        self.exchange_of(&[due], lengths)
    }

    pub(crate) fn exchange_of(
        &mut self,
        due: &[Kind],
        lengths: std::ops::RangeInclusive<u64>,
    ) -> Result<Header> {
        self.channel.send()?;
        self.channel.receive(due, lengths)
    }

    pub(crate) fn expect_done(&mut self) -> Result<()> {
        self.exchange(Kind::Done, 0..=0).map(|_| ())
    }

    /// Returns the length of a state with these fields \[bytes\].
    fn state_length(&self, fields: Fields) -> u64 {
        let arrays = [Fields::VELOCITIES, Fields::DISPLACEMENTS, Fields::ACCELERATIONS];
        let arrays = arrays.iter().filter(|f| fields.has(**f)).count();
        16 + 8 * (arrays * self.v.len()) as u64
    }

    /// Sends the request in the channel, receives the state and stores it.
    pub(crate) fn read_state(&mut self, wanted: Fields) -> Result<()> {
        let length = self.state_length(wanted);
        let header = self.exchange(Kind::State, length..=length)?;
        // Taken out, since the content borrows the channel.
        let [mut v, mut q, mut a] = [&mut self.v, &mut self.q, &mut self.a].map(std::mem::take);
        let mut content = self.channel.content(header);
        // In a closure, so that the arrays come back after an error too.
        let mut read = || {
            let fields = Fields(content.u32()?);
            if fields != wanted {
                let (a, b) = (fields.0, wanted.0);
                return Err(content.wrong(format!("the fields are {a:#b}, and {b:#b} were asked for")));
            }
            content.u32()?;
            let invariant = content.f64()?;
            let arrays = [
                (Fields::VELOCITIES, "velocities", &mut v),
                (Fields::DISPLACEMENTS, "displacements", &mut q),
                (Fields::ACCELERATIONS, "accelerations", &mut a),
            ];
            for (field, name, out) in arrays {
                if wanted.has(field) {
                    content.numbers(name, out)?;
                }
            }
            if wanted.has(Fields::INVARIANT) && !invariant.is_finite() {
                return Err(content.wrong(format!("the invariant is {invariant} J, not a finite number")));
            }
            Ok(invariant)
        };
        let read = read();
        (self.v, self.q, self.a) = (v, q, a);
        self.invariant = read?;
        // What was known stays known: the state is the same.
        self.known = self.known.and(wanted);
        Ok(())
    }

    /// Requests those of the fields that are not known yet.
    pub(crate) fn know(&mut self, fields: Fields) -> Result<()> {
        if self.known.has(fields) {
            return Ok(());
        }
        self.guarded(|link| {
            // Only what is missing is asked for: every exchange is a round trip.
            let wanted = Fields(fields.0 & !link.known.0);
            link.channel.out.begin(Kind::Tell).u32(wanted.0).u32(0);
            link.read_state(wanted)
        })
    }

    /// Returns the fields that are requested with every step.
    pub(crate) fn step_fields(&self) -> Fields {
        Fields::MOTION.and(Fields::INVARIANT.among(self.offers))
    }

    pub(crate) fn kick(&mut self, impulse: &[f64]) -> Result<()> {
        // Impulses are tested until one was strong enough to show that the solver moves the mass it has sent.
        let test = !self.trusted && impulse.iter().any(|p| *p != 0.0);
        let before = if test {
            self.know(Fields::VELOCITIES)?;
            self.v.clone()
        } else {
            Vec::new()
        };
        self.guarded(|link| {
            link.channel.out.begin(Kind::Impulse).numbers(impulse);
            link.expect_done()?;
            // An impulse changes neither positions nor, therefore, displacements.
            link.known = link.known.among(Fields::DISPLACEMENTS);
            Ok(())
        })?;
        if test {
            self.know(Fields::VELOCITIES)?;
            self.trusted = self.guarded(|link| link.check_kick(impulse, &before))?;
        }
        Ok(())
    }

    /// Returns an error if a velocity has changed by something other than impulse over inertia. Else returns
    /// whether the impulse was strong enough to test the mass.
    fn check_kick(&self, impulse: &[f64], before: &[f64]) -> Result<bool> {
        let expected = |i: usize| {
            let m = self.inertia[i];
            // Prescribed unknowns have no inertia, and an impulse does not move them.
            if m > 0.0 { impulse[i] / m } else { 0.0 }
        };
        let largest = |x: &mut dyn Iterator<Item = f64>| x.fold(0.0_f64, |m, x| m.max(x.abs()));
        let top = largest(&mut (0..impulse.len()).map(expected));
        let fast = largest(&mut before.iter().chain(&self.v).copied());
        // Round-off of a difference is relative to the velocities, not to their change.
        let allowed = ROUNDED * (top + fast);
        let is_off = |i: &usize| (self.v[*i] - before[*i] - expected(*i)).abs() > allowed;
        match (0..impulse.len()).find(is_off) {
            None => Ok(allowed < TELLING * top),
            Some(unknown) => Err(Error::Mass {
                peer: self.channel.peer.clone(),
                unknown,
                inertia: self.inertia[unknown],
                found: self.v[unknown] - before[unknown],
                wanted: expected(unknown),
            }),
        }
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        // A broken link cannot carry an orderly end.
        if self.broken.is_some() {
            return;
        }
        self.channel.out.begin(Kind::End);
        // No error here: a solver that does not leave by itself is ended.
        let confirmed = self.channel.send().is_ok() && self.channel.receive(&[Kind::Done], 0..=SMALL).is_ok();
        if let Some(child) = &mut self.child {
            child.confirmed = confirmed;
        }
    }
}
