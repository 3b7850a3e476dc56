//! The run's end of a link: a solver in another process as a [`Participant`].

use crate::address::{Address, Listener};
use crate::channel::Channel;
use crate::child::{Started, shown};
use crate::error::{Error, Result};
use crate::link::{Link, ROUNDED};
use crate::message::{Ask, Description, Fields, Shape, check_inertia, check_step, read_record, write_record};
use crate::wire::{Kind, LIMIT};
use arlequin_core::nalgebra::Point3;
use arlequin_core::snapshot::Record;
use arlequin_core::{DofLayout, Participant, Weighting, Weights, interrupt};
use std::cell::RefCell;
use std::path::Path;
use std::time::{Duration, Instant};

/// Relative excess of weighted over unweighted inertia that is round-off, also for a solver in single
/// precision.
const WEIGHED: f64 = ROUNDED;
/// Number of requests for weights that a solver may send before its answer, in addition to
/// [`QUESTIONS_PER_NODE`] for each node: a solver that asks for ever must not hold the run.
const QUESTIONS: usize = 10_000;
/// Number of requests per node: elements and bonds, for each of three weights.
const QUESTIONS_PER_NODE: usize = 200;

/// Limits that a run sets for the other side.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Options {
    /// Time to start and to connect: an interpreter with its packages takes seconds on a busy machine.
    pub start: Duration,
    /// Time to answer once it is connected; a solver that needs longer sends [`Kind::Working`] meanwhile.
    pub timeout: Duration,
    /// Longest message accepted \[bytes\].
    pub limit: u64,
}

impl Default for Options {
    /// Returns 30 s to start, 4 s to answer and 1 GiB. A command that ends before it connects is noticed at
    /// once.
    fn default() -> Self {
        Self {
            start: Duration::from_secs(30),
            timeout: Duration::from_secs(4),
            limit: LIMIT,
        }
    }
}

/// A solver in another process, as a run uses it. Dropping it ends the process if the run started it.
///
/// ```no_run
/// use arlequin_link::{Options, Remote};
/// let command = ["python3", "chain.py"].map(String::from);
/// let solver = Remote::start("fine", &command, ".".as_ref(), Options::default())?;
/// println!("{} nodes", solver.description().nodes.len());
/// # Ok::<(), arlequin_link::Error>(())
/// ```
#[derive(Debug)]
pub struct Remote {
    name: String,
    description: Description,
    link: RefCell<Link>,
    critical_step: f64,
}

impl Remote {
    /// Starts a command in a folder and waits for it to connect. The command finds the address in the
    /// environment variable [`crate::VARIABLE`]. `name` is the model's name in the run.
    ///
    /// # Errors
    /// [`Error::Command`], [`Error::Silent`], [`Error::Interrupted`], and any error in the description that
    /// the solver sends.
    pub fn start(name: &str, command: &[String], folder: &Path, options: Options) -> Result<Self> {
        let listener = Listener::private()?;
        let child = Started::new(command, folder, listener.address())?;
        // The command as typed, so that the user can try it by hand.
        let peer = format!("'{name}' ({})", shown(command));
        Self::meet(name, peer, &listener, Some(child), options)
    }

    /// Waits at an address for a solver that is started by somebody else.
    ///
    /// # Errors
    /// [`Error::System`] for an address that is in use; else those of [`Self::start`].
    pub fn await_at(name: &str, address: &Address, options: Options) -> Result<Self> {
        Self::accept(name, &Listener::bind(address)?, options)
    }

    /// Waits for a solver at a listener that is already open.
    ///
    /// # Errors
    /// The errors of [`Self::await_at`].
    pub fn accept(name: &str, listener: &Listener, options: Options) -> Result<Self> {
        let peer = format!("'{name}' ({})", listener.address());
        Self::meet(name, peer, listener, None, options)
    }

    fn meet(
        name: &str,
        peer: String,
        listener: &Listener,
        mut child: Option<Started>,
        options: Options,
    ) -> Result<Self> {
        let waited = || format!("a connection to {}", listener.address());
        let mut watch = || {
            if interrupt::is_requested() {
                let (peer, waited) = (peer.clone(), waited());
                return Err(Error::Interrupted { peer, waited });
            }
            // A solver that ends before it connects is noticed at once, not at the end of the wait.
            match &mut child {
                None => Ok(()),
                Some(c) => c
                    .ended(Duration::ZERO)
                    .map_or(Ok(()), |how| Err(c.ended_early(&how, "it connected"))),
            }
        };
        let accepted = listener.accept(Instant::now() + options.start, &mut watch)?;
        let Some(stream) = accepted else {
            return Err(Error::Silent {
                peer,
                waited: waited(),
                limit: options.start,
            });
        };
        let channel = Channel::new(stream, peer, Some(options.timeout), options.limit);
        let mut link = Link::new(channel, child);
        let greet = |link: &mut Link| {
            let message = link.channel.out.begin(Kind::Hello);
            message.u64(options.limit).text(name, crate::wire::NAME);
            let header = link.exchange(Kind::Description, 0..=u64::MAX)?;
            Description::read(link.channel.content(header))
        };
        let description = link.guarded(greet)?;
        link.store_description(&description);
        Ok(Self {
            name: name.to_owned(),
            critical_step: description.critical_step,
            description,
            link: RefCell::new(link),
        })
    }

    /// Returns the description that the solver has sent.
    pub fn description(&self) -> &Description {
        &self.description
    }

    /// Returns the solver's geometry, from which the junction is built.
    pub fn shape(&self) -> &Shape {
        &self.description.shape
    }

    fn with_name<V>(&self, result: Result<V>) -> arlequin_core::Result<V> {
        result.map_err(|e| arlequin_core::Error::of_model(&self.name, e))
    }

    fn weigh_all(&self, weights: &Weights<f64>, inertia: &mut [f64]) -> Result<f64> {
        let unweighted = &self.description.inertia;
        let nodes = self.description.nodes.len();
        self.link.borrow_mut().guarded(|link| {
            let nodal = u64::from(weights.weighting == Weighting::Nodal);
            link.channel.out.begin(Kind::Weigh).u64(nodal);
            let due = [Kind::Inertia, Kind::Ask];
            let mut header = link.exchange_of(&due, 0..=u64::MAX)?;
            let mut questions = QUESTIONS + QUESTIONS_PER_NODE * nodes;
            while header.kind == Kind::Ask {
                // Solvers ask for weights at places of their own choosing; the run alone knows the overlap.
                let ask = Ask::read(link.channel.content(header))?;
                questions = questions.checked_sub(1).ok_or_else(|| {
                    let limit = QUESTIONS + QUESTIONS_PER_NODE * nodes;
                    let rule = format!("nothing new is asked: {limit} questions for {nodes} nodes; ask for many places at once");
                    link.channel.content(header).wrong(rule)
                })?;
                ask.answer(weights, &mut link.channel.out);
                header = link.exchange_of(&due, 0..=u64::MAX)?;
            }
            let mut content = link.channel.content(header);
            let critical = content.f64()?;
            check_step(&content, critical)?;
            // Everything is read and checked before anything of it is used.
            content.numbers("inertia", inertia)?;
            check_inertia(&content, inertia)?;
            content.end()?;
            // Weights are at most one, so weighted inertia is at most the unweighted one.
            let heavier = |(m, w): (&f64, &f64)| *m > *w * (1.0 + WEIGHED);
            if let Some(unknown) = inertia.iter().zip(unweighted).position(heavier) {
                return Err(Error::Heavier {
                    peer: link.channel.peer.clone(),
                    unknown,
                    found: inertia[unknown],
                    whole: unweighted[unknown],
                });
            }
            // The new inertia must prove itself by an impulse, too.
            link.inertia.copy_from_slice(inertia);
            link.known = Fields::default();
            link.trusted = false;
            Ok(critical)
        })
    }
}

impl Participant<f64> for Remote {
    fn name(&self) -> &str {
        &self.name
    }
    fn kind(&self) -> &str {
        &self.description.kind
    }
    fn layout(&self) -> DofLayout {
        self.description.layout
    }
    fn nodes(&self) -> &[Point3<f64>] {
        &self.description.nodes
    }

    fn weigh(&mut self, weights: &Weights<f64>, inertia: &mut [f64]) -> arlequin_core::Result<()> {
        let critical = self.weigh_all(weights, inertia);
        self.critical_step = self.with_name(critical)?;
        Ok(())
    }

    fn advance(&mut self, time: f64, step: f64) -> arlequin_core::Result<()> {
        let outcome = self.link.borrow_mut().guarded(|link| {
            let wanted = link.step_fields();
            // Unknown from here on, also if the step fails.
            link.known = Fields::default();
            link.channel
                .out
                .begin(Kind::Advance)
                .f64(time)
                .f64(step)
                .u32(wanted.0)
                .u32(0);
            link.read_state(wanted)
        });
        self.with_name(outcome)
    }

    /// Writes NaN if the other side does not answer; the next step returns the error.
    fn velocities(&self, out: &mut [f64]) {
        let mut link = self.link.borrow_mut();
        match link.know(Fields::VELOCITIES) {
            Ok(()) => out.copy_from_slice(&link.v),
            Err(_) => out.fill(f64::NAN),
        }
    }

    /// Writes NaN if the other side does not answer, like [`Self::velocities`].
    fn displacements(&self, out: &mut [f64]) {
        let mut link = self.link.borrow_mut();
        match link.know(Fields::DISPLACEMENTS) {
            Ok(()) => out.copy_from_slice(&link.q),
            Err(_) => out.fill(f64::NAN),
        }
    }

    fn kick(&mut self, impulse: &[f64]) -> arlequin_core::Result<()> {
        let outcome = self.link.borrow_mut().kick(impulse);
        self.with_name(outcome)
    }

    fn accelerations(&self, out: &mut [f64]) -> bool {
        let mut link = self.link.borrow_mut();
        // Not offered is not asked for: a solver may not know the field.
        let is_known = link.offers.has(Fields::ACCELERATIONS) && link.know(Fields::ACCELERATIONS).is_ok();
        if is_known {
            out.copy_from_slice(&link.a);
        }
        is_known
    }

    fn critical_step(&self) -> Option<f64> {
        self.critical_step.is_finite().then_some(self.critical_step)
    }

    fn invariant(&self) -> Option<f64> {
        let mut link = self.link.borrow_mut();
        let is_known = link.offers.has(Fields::INVARIANT) && link.know(Fields::INVARIANT).is_ok();
        is_known.then_some(link.invariant)
    }

    fn save(&self) -> arlequin_core::Result<Record<f64>> {
        let mut link = self.link.borrow_mut();
        if !link.offers.has(Fields::MEMORY) {
            return Err(arlequin_core::Error::Unsupported {
                model: self.name.clone(),
                what: "be saved: the solver behind the link does not offer it; run without checkpoints"
                    .into(),
            });
        }
        let record = link.guarded(|link| {
            link.channel.out.begin(Kind::Save);
            let header = link.exchange(Kind::Record, 16..=u64::MAX)?;
            read_record(link.channel.content(header))
        });
        self.with_name(record)
    }

    fn restore(&mut self, record: &Record<f64>) -> arlequin_core::Result<()> {
        let mut link = self.link.borrow_mut();
        if !link.offers.has(Fields::MEMORY) {
            return Err(arlequin_core::Error::Unsupported {
                model: self.name.clone(),
                what: "be restored: the solver behind the link does not offer it; start the run anew".into(),
            });
        }
        let outcome = link.guarded(|link| {
            write_record(&mut link.channel.out, Kind::Restore, record);
            link.known = Fields::default();
            link.expect_done()
        });
        drop(link);
        self.with_name(outcome)
    }
}
