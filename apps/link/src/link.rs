//! A link as the run has it: what was said last, and whether it is still to be believed.

use crate::channel::Channel;
use crate::child::Started;
use crate::error::{Error, Result};
use crate::message::{Description, Fields};
use crate::wire::{Header, Kind, SMALL};
use std::time::Duration;

/// Relative error of a result of few operations that is let pass. No solver says in what precision it
/// computes: four roundings, of impulse, mass, quotient and sum, to single precision and as much again for
/// those that convert units.
pub(crate) const ROUNDED: f64 = 8.0 * f32::EPSILON as f64;
/// An impulse tells of the mass if round-off hides no more than this share of what it does.
const TELLING: f64 = 1e-3;

/// What changes when the other side is asked.
#[derive(Debug)]
pub(crate) struct Link {
    pub(crate) channel: Channel,
    child: Option<Started>,
    pub(crate) offers: Fields,
    /// What is known of the state that the other side is in.
    pub(crate) known: Fields,
    pub(crate) v: Vec<f64>,
    pub(crate) q: Vec<f64>,
    pub(crate) a: Vec<f64>,
    pub(crate) invariant: f64,
    /// Under the weights it has.
    pub(crate) inertia: Vec<f64>,
    /// Whether an impulse was seen to do what it must.
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

    /// Takes what the other side said of itself.
    pub(crate) fn know_of(&mut self, it: &Description) {
        self.channel.peer_limit = it.limit;
        self.offers = it.offers;
        self.inertia.clone_from(&it.inertia);
        for x in [&mut self.v, &mut self.q, &mut self.a] {
            x.resize(it.layout.dofs(), 0.0);
        }
    }

    /// Does something, unless an earlier error broke the link; an error breaks it.
    pub(crate) fn guarded<V>(&mut self, what: impl FnOnce(&mut Self) -> Result<V>) -> Result<V> {
        if let Some(earlier) = &self.broken {
            return Err(Error::Broken {
                peer: self.channel.peer.clone(),
                earlier: earlier.to_string(),
            });
        }
        what(self).map_err(|e| {
            let e = self.explained(e);
            self.broken = Some(e.clone());
            e
        })
    }

    /// A link that was closed because its process ended: how it did so.
    fn explained(&mut self, e: Error) -> Error {
        let (Some(child), Error::Closed { expected, .. }) = (&mut self.child, &e) else {
            return e;
        };
        // The stream closes a moment before the process is gone.
        match child.ended(Duration::from_millis(200)) {
            // "the reading of …", or the message that was due.
            Some(how) => child.early(&how, &format!("its {}", expected.trim_start_matches("the "))),
            None => e,
        }
    }

    /// Sends the message that was written and receives its answer.
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

    pub(crate) fn done(&mut self) -> Result<()> {
        self.exchange(Kind::Done, 0..=0).map(|_| ())
    }

    /// Bytes of a state with these fields.
    fn state_length(&self, fields: Fields) -> u64 {
        let arrays = [Fields::VELOCITIES, Fields::DISPLACEMENTS, Fields::ACCELERATIONS];
        let arrays = arrays.iter().filter(|f| fields.has(**f)).count();
        16 + 8 * (arrays * self.v.len()) as u64
    }

    /// Sends the request that was written, receives the state and keeps it.
    pub(crate) fn read_state(&mut self, wanted: Fields) -> Result<()> {
        let length = self.state_length(wanted);
        let header = self.exchange(Kind::State, length..=length)?;
        // Taken out while the content borrows the channel.
        let [mut v, mut q, mut a] = [&mut self.v, &mut self.q, &mut self.a].map(std::mem::take);
        let mut content = self.channel.content(header);
        let mut read = || {
            let has = Fields(content.u32()?);
            if has != wanted {
                let (a, b) = (has.0, wanted.0);
                return Err(content.wrong(format!("the fields are {a:#b}, and {b:#b} were asked for")));
            }
            content.u32()?;
            let invariant = content.f64()?;
            let all = [
                (Fields::VELOCITIES, "velocities", &mut v),
                (Fields::DISPLACEMENTS, "displacements", &mut q),
                (Fields::ACCELERATIONS, "accelerations", &mut a),
            ];
            for (field, name, out) in all {
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
        self.known = self.known.and(wanted);
        Ok(())
    }

    /// Asks for what is not known of these fields.
    pub(crate) fn know(&mut self, fields: Fields) -> Result<()> {
        if self.known.has(fields) {
            return Ok(());
        }
        self.guarded(|link| {
            let wanted = Fields(fields.0 & !link.known.0);
            link.channel.out.begin(Kind::Tell).u32(wanted.0).u32(0);
            link.read_state(wanted)
        })
    }

    /// What a step tells.
    pub(crate) fn of_step(&self) -> Fields {
        Fields::MOTION.and(Fields::INVARIANT.among(self.offers))
    }

    pub(crate) fn kick(&mut self, impulse: &[f64]) -> Result<()> {
        // Impulses show whether the mass that was told is the one that moves, from the first that is strong
        // enough on.
        let test = !self.trusted && impulse.iter().any(|p| *p != 0.0);
        let before = if test {
            self.know(Fields::VELOCITIES)?;
            self.v.clone()
        } else {
            Vec::new()
        };
        self.guarded(|link| {
            link.channel.out.begin(Kind::Impulse).numbers(impulse);
            link.done()?;
            // Positions stay where they are.
            link.known = link.known.among(Fields::DISPLACEMENTS);
            Ok(())
        })?;
        if test {
            self.know(Fields::VELOCITIES)?;
            self.trusted = self.guarded(|link| link.check_kick(impulse, &before))?;
        }
        Ok(())
    }

    /// Refuses changes of velocity by something else than impulse over inertia; whether the impulse was
    /// strong enough to tell.
    fn check_kick(&self, impulse: &[f64], before: &[f64]) -> Result<bool> {
        let wanted = |i: usize| {
            let m = self.inertia[i];
            if m > 0.0 { impulse[i] / m } else { 0.0 }
        };
        let largest = |x: &mut dyn Iterator<Item = f64>| x.fold(0.0_f64, |m, x| m.max(x.abs()));
        let top = largest(&mut (0..impulse.len()).map(wanted));
        let fast = largest(&mut before.iter().chain(&self.v).copied());
        let allowed = ROUNDED * (top + fast);
        let off = |i: &usize| (self.v[*i] - before[*i] - wanted(*i)).abs() > allowed;
        match (0..impulse.len()).find(off) {
            None => Ok(allowed < TELLING * top),
            Some(unknown) => Err(Error::Mass {
                peer: self.channel.peer.clone(),
                unknown,
                inertia: self.inertia[unknown],
                found: self.v[unknown] - before[unknown],
                wanted: wanted(unknown),
            }),
        }
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        if self.broken.is_some() {
            return;
        }
        self.channel.out.begin(Kind::End);
        // An answer is not waited for: who does not leave by itself is ended.
        let told = self.channel.send().is_ok() && self.channel.receive(&[Kind::Done], 0..=SMALL).is_ok();
        if let Some(child) = &mut self.child {
            child.told = told;
        }
    }
}
