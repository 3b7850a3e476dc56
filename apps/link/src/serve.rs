//! The solver's end of a link.

use crate::address::{Address, Stream};
use crate::channel::Channel;
use crate::error::{Error, Result};
use crate::message::{Ask, Description, Fields, Shape, read_record, write_record};
use crate::wire::{Header, Kind, LIMIT, NAME, SMALL};
use arlequin_core::geometry::Cell;
use arlequin_core::nalgebra::Point3;
use arlequin_core::{Participant, Share, Weight, Weighting, Weights};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Time to look for a run that does not listen yet.
const LOOK: Duration = Duration::from_secs(5);
/// Pause between two attempts.
const GLANCE: Duration = Duration::from_millis(20);

type Shared = Arc<Mutex<Talk>>;

/// The channel, and the error of a call that cannot return one.
#[derive(Debug)]
struct Talk {
    channel: Channel,
    failed: Option<Error>,
}

fn lock(talk: &Shared) -> MutexGuard<'_, Talk> {
    talk.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A weight that the run evaluates: each point or cell is one request over the link.
struct Asked {
    talk: Shared,
    share: Share,
}

impl Asked {
    /// Sends a request and returns the answer; NaN if there is none, with the error kept in [`Talk::failed`].
    fn ask(&self, write: impl FnOnce(&mut Channel)) -> f64 {
        let mut talk = lock(&self.talk);
        // After a failure no further request is sent: the run would not expect it.
        if talk.failed.is_some() {
            return f64::NAN;
        }
        write(&mut talk.channel);
        let mut answer = || {
            talk.channel.send()?;
            let header = talk.channel.receive(&[Kind::Shares], 8..=8)?;
            talk.channel.content(header).finite("a weight")
        };
        answer().unwrap_or_else(|e| {
            talk.failed = Some(e);
            f64::NAN
        })
    }
}

impl Weight<f64> for Asked {
    fn value(&self, x: &Point3<f64>) -> f64 {
        self.ask(|c| Ask::write_point(&mut c.out, self.share, x))
    }
    fn mean(&self, cell: &Cell<f64>) -> f64 {
        self.ask(|c| Ask::write_cell(&mut c.out, self.share, cell))
    }
}

/// Serves a solver to the run that waits at an address, until the run ends. `shape` is the geometry that
/// interfaces use.
///
/// # Errors
/// [`Error::System`] if nobody listens within 5 s; [`Error::Closed`] if the run is gone before it has
/// announced its end; any error in what the run sends. Errors of the solver are sent to the run and not
/// returned here.
pub fn serve(address: &Address, solver: &mut dyn Participant<f64>, shape: &Shape) -> Result<()> {
    let until = Instant::now() + LOOK;
    let stream = loop {
        match Stream::connect(address) {
            // The run may be started after the solver.
            Err(_) if Instant::now() < until => std::thread::sleep(GLANCE),
            other => break other?,
        }
    };
    // No limit: the run may think for as long as it likes between two steps.
    let channel = Channel::new(stream, format!("the run at {address}"), None, LIMIT);
    let talk = Arc::new(Mutex::new(Talk {
        channel,
        failed: None,
    }));
    let n = solver.layout().dofs();
    let mut server = Server {
        solver,
        talk,
        numbers: vec![0.0; n],
    };
    server.greet(shape)?;
    while server.answer()? {}
    Ok(())
}

struct Server<'a> {
    solver: &'a mut dyn Participant<f64>,
    talk: Shared,
    /// One number per unknown.
    numbers: Vec<f64>,
}

/// `Ok`: the answer is written and can be sent. `Err`: the solver's error, which is sent instead.
type Answer = std::result::Result<(), arlequin_core::Error>;

impl Server<'_> {
    fn greet(&mut self, shape: &Shape) -> Result<()> {
        let talk = self.talk.clone();
        let mut talk = lock(&talk);
        let header = match talk.channel.receive(&[Kind::Hello], 12..=SMALL) {
            // The header of this answer shows the run which version this side has.
            Err(e @ Error::Version { .. }) => {
                fail(&mut talk.channel, &e.to_string())?;
                return Err(e);
            }
            other => other?,
        };
        let mut content = talk.channel.content(header);
        let limit = content.u64()?;
        content.text("the name", NAME)?;
        content.end()?;
        talk.channel.peer_limit = limit;
        match self.describe(shape) {
            Ok(d) => {
                d.write(&mut talk.channel.out);
                talk.channel.send()
            }
            Err(e) => {
                fail(&mut talk.channel, &e.to_string())?;
                Err(Error::Failed {
                    peer: self.solver.name().to_owned(),
                    text: e.to_string(),
                })
            }
        }
    }

    fn describe(&mut self, shape: &Shape) -> arlequin_core::Result<Description> {
        let mut inertia = vec![0.0; self.numbers.len()];
        self.solver.weigh(&Weights::uncoupled(), &mut inertia)?;
        let mut offers = Fields::MOTION;
        let optional = [
            // Tried once at the start: the run never asks for what was not offered.
            (
                self.solver.accelerations(&mut self.numbers),
                Fields::ACCELERATIONS,
            ),
            (self.solver.invariant().is_some(), Fields::INVARIANT),
            (self.solver.save().is_ok(), Fields::MEMORY),
        ];
        for (_, field) in optional.into_iter().filter(|h| h.0) {
            offers = offers.and(field);
        }
        Ok(Description {
            limit: LIMIT,
            offers,
            name: self.solver.name().to_owned(),
            kind: self.solver.kind().to_owned(),
            layout: self.solver.layout(),
            nodes: self.solver.nodes().to_vec(),
            shape: shape.clone(),
            inertia,
            critical_step: self.solver.critical_step().unwrap_or(f64::INFINITY),
        })
    }

    /// Answers one request. Returns false after the last one.
    fn answer(&mut self) -> Result<bool> {
        const DUE: [Kind; 7] = [
            Kind::Advance,
            Kind::Impulse,
            Kind::Tell,
            Kind::Weigh,
            Kind::Save,
            Kind::Restore,
            Kind::End,
        ];
        let shared = self.talk.clone();
        // Locked for the whole request: weights are asked for through the same channel, one at a time.
        let mut talk = lock(&shared);
        let header = talk.channel.receive(&DUE, 0..=u64::MAX)?;
        let outcome = match header.kind {
            Kind::Weigh => {
                let mut content = talk.channel.content(header);
                let nodal = content.u64()? == 1;
                content.end()?;
                // The solver's requests for weights need the channel.
                drop(talk);
                let outcome = self.weigh(nodal);
                talk = lock(&shared);
                if let Some(e) = talk.failed.take() {
                    return Err(e);
                }
                if outcome.is_ok() {
                    self.write_inertia(&mut talk.channel);
                }
                outcome
            }
            _ => self.act(header, &mut talk.channel)?,
        };
        match outcome {
            Ok(()) => talk.channel.send()?,
            Err(e) => fail(&mut talk.channel, &e.to_string())?,
        }
        Ok(header.kind != Kind::End)
    }

    /// Carries out a request and writes the answer.
    fn act(&mut self, header: Header, channel: &mut Channel) -> Result<Answer> {
        let mut content = channel.content(header);
        Ok(match header.kind {
            Kind::Advance => {
                let (time, step) = (content.finite("the time")?, content.finite("the step")?);
                let wanted = Fields(content.u32()?);
                content.u32()?;
                content.end()?;
                self.solver
                    .advance(time, step)
                    .map(|()| self.write_state(wanted, channel))
            }
            Kind::Tell => {
                let wanted = Fields(content.u32()?);
                content.u32()?;
                content.end()?;
                self.write_state(wanted, channel);
                Ok(())
            }
            Kind::Impulse => {
                content.numbers("the impulse", &mut self.numbers)?;
                content.end()?;
                channel.out.begin(Kind::Done);
                self.solver.kick(&self.numbers)
            }
            Kind::Save => {
                content.end()?;
                let record = self.solver.save();
                record.map(|r| write_record(&mut channel.out, Kind::Record, &r))
            }
            Kind::Restore => {
                let record = read_record(content)?;
                channel.out.begin(Kind::Done);
                self.solver.restore(&record)
            }
            _ => {
                content.end()?;
                channel.out.begin(Kind::Done);
                Ok(())
            }
        })
    }

    fn weigh(&mut self, nodal: bool) -> Answer {
        let weight = |share| -> Arc<dyn Weight<f64>> {
            Arc::new(Asked {
                talk: self.talk.clone(),
                share,
            })
        };
        let weights = Weights {
            internal: weight(Share::Internal),
            kinetic: weight(Share::Kinetic),
            external: weight(Share::External),
            weighting: if nodal {
                Weighting::Nodal
            } else {
                Weighting::Energy
            },
        };
        self.solver.weigh(&weights, &mut self.numbers)
    }

    fn write_inertia(&mut self, channel: &mut Channel) {
        let step = self.solver.critical_step().unwrap_or(f64::INFINITY);
        channel.out.begin(Kind::Inertia).f64(step).numbers(&self.numbers);
    }

    fn write_state(&mut self, wanted: Fields, channel: &mut Channel) {
        let invariant = wanted.has(Fields::INVARIANT).then(|| self.solver.invariant());
        let out = channel.out.begin(Kind::State).u32(wanted.0).u32(0);
        out.f64(invariant.flatten().unwrap_or_default());
        if wanted.has(Fields::VELOCITIES) {
            self.solver.velocities(&mut self.numbers);
            out.numbers(&self.numbers);
        }
        if wanted.has(Fields::DISPLACEMENTS) {
            self.solver.displacements(&mut self.numbers);
            out.numbers(&self.numbers);
        }
        if wanted.has(Fields::ACCELERATIONS) {
            self.solver.accelerations(&mut self.numbers);
            out.numbers(&self.numbers);
        }
    }
}

fn fail(channel: &mut Channel, text: &str) -> Result<()> {
    channel.out.begin(Kind::Failed).text(text, SMALL as usize);
    channel.send()
}
