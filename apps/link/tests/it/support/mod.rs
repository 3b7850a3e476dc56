//! Helpers for tests of the link: this test program as the external solver, and a bar tied to a chain.

#![allow(
    dead_code,
    clippy::unwrap_used,
    reason = "each test uses some of it; a failed set-up is a failed test"
)]

use arlequin::core::{L2, OwnStep, Participant, Uniform};
use arlequin::fem_ref::{Elastic, FemField, FemModel, generate};
use arlequin::prelude::*;
use arlequin_link::wire::Message;
use arlequin_link::{Address, Description, Element, Fields, Options, Remote, Shape};
use spring_chain::Chain;
#[cfg(unix)]
use std::os::unix::net::UnixStream;
use std::time::Duration;

pub(crate) const BONDS: usize = 60;

/// Options with more patience than a busy machine needs to start a program.
pub(crate) fn patient() -> Options {
    Options {
        start: Duration::from_secs(120),
        timeout: Duration::from_secs(120),
        ..Options::default()
    }
}

/// Returns the command that runs one test of this program, which serves a model.
pub(crate) fn other_side(test: &str) -> Vec<String> {
    let program = std::env::current_exe().unwrap().display().to_string();
    [&program, test, "--exact", "--ignored", "--nocapture"]
        .map(String::from)
        .into()
}

pub(crate) fn start(test: &str, options: Options) -> arlequin_link::Result<Remote> {
    Remote::start("fine", &other_side(test), "".as_ref(), options)
}

pub(crate) fn chain() -> Chain {
    Chain::new("chain", -20.0, 1.0, BONDS, 1.0, 1.0).unwrap()
}

/// Velocities of the chain at the start.
pub(crate) fn moving() -> Vec<f64> {
    (0..=BONDS)
        .map(|k| (0.3 * k as f64).sin() + 0.2 * (1.9 * k as f64).cos())
        .collect()
}

pub(crate) fn chain_shape() -> Shape {
    Shape::Mesh {
        element: Element::Line,
        connectivity: (0..BONDS as u32).flat_map(|k| [k, k + 1]).collect(),
        section: 1.0,
    }
}

/// Couples a bar from −100 to 0 with a chain in motion from −20 on: a model in this process, or the given
/// solver.
pub(crate) fn coupled(
    solver: Option<Box<dyn Participant<f64>>>,
    own_step: OwnStep<f64>,
) -> Result<Coupled<f64>> {
    coupled_in(solver, own_step, chain().fine_field(), moving())
}

/// Like [`coupled`], with a given field, and with given velocities of the chain in this process.
pub(crate) fn coupled_in(
    solver: Option<Box<dyn Participant<f64>>>,
    own_step: OwnStep<f64>,
    field: Arc<dyn Interpolation<f64>>,
    v: Vec<f64>,
) -> Result<Coupled<f64>> {
    let place = |x: f64| Point3::new(x, 0.0, 0.0);
    let slab = Arc::new(Slab::between(place(0.0), place(-20.0))?);
    let left: Weights<f64> = Weights::from_weight(Arc::new(Ramp::new(slab, Profile::Cubic, 1e-6)?));
    let right = Weights::complement_of(std::slice::from_ref(&left));
    let mesh = generate::bar(-100.0, 0.0, 10, 1.0)?;
    let bar = FemModel::new("bar", mesh, Elastic::new(1.0, 0.0, 1.0)?)?;
    let fine = match solver {
        Some(solver) => Subdomain::participant(solver, field, right)?,
        None => Subdomain::fine(chain(), right).with_initial(vec![0.0; BONDS + 1], v)?,
    };
    let mediator = Arc::new(FemField::new(generate::bar(-20.0, 0.0, 2, 1.0)?));
    let tie = InterfaceSpec::new("overlap", 0, 1, mediator, L2);
    let n = bar.layout().dofs();
    let running = (0..n).map(|k| 1e-2 * (0.4 * k as f64).cos()).collect();
    let bar = Subdomain::coarse(bar, left).with_initial(vec![0.0; n], running)?;
    let bodies = vec![bar, fine.with_step(own_step)];
    Coupled::new(
        bodies,
        vec![tie],
        TimeStep::Seconds(0.8 * own_steps(own_step)),
        None,
    )
}

fn own_steps(own_step: OwnStep<f64>) -> f64 {
    match own_step {
        OwnStep::Ratio(m) => m as f64,
        _ => 1.0,
    }
}

pub(crate) fn states(c: &Coupled<f64>) -> Vec<f64> {
    let subdomain_states = c.subdomains().iter().map(|s| s.state());
    subdomain_states
        .flat_map(|s| s.q.iter().chain(&s.v))
        .copied()
        .collect()
}

/// Returns the largest difference of two states, relative to the largest entry.
pub(crate) fn gap(a: &Coupled<f64>, b: &Coupled<f64>) -> f64 {
    let (a, b) = (states(a), states(b));
    let top = a.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    assert!(top > 0.0, "nothing moves");
    a.iter().zip(&b).fold(0.0_f64, |m, (x, y)| m.max((x - y).abs())) / top
}

/// Options with little patience, for solvers that do not answer.
pub(crate) fn hasty() -> Options {
    Options {
        start: Duration::from_millis(700),
        timeout: Duration::from_millis(700),
        ..Options::default()
    }
}

/// Description that a solver with a chain sends.
pub(crate) fn description() -> Description {
    let (mut inertia, nodes) = (vec![0.0; BONDS + 1], chain().nodes().to_vec());
    chain().lumped_inertia(&Uniform(1.0), &mut inertia).unwrap();
    Description {
        limit: 1 << 20,
        offers: Fields::MOTION,
        name: "chain".into(),
        kind: "stranger".into(),
        layout: chain().layout(),
        nodes,
        shape: chain_shape(),
        inertia,
        critical_step: 1.0,
    }
}

pub(crate) fn bytes_of(d: &Description) -> Vec<u8> {
    let mut message = Message::default();
    d.write(&mut message);
    message.finish().to_vec()
}

#[cfg(unix)]
pub(crate) fn connect(address: &Address) -> UnixStream {
    match address {
        Address::Unix(path) => UnixStream::connect(path).unwrap(),
        Address::Tcp(_) => unreachable!("private listeners are files here"),
    }
}
