//! Work of ranks while messages are on their way: forces that need no node of another rank.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use crate::support::{WAIT, global};
use arlequin_core::nalgebra::Point3;
use arlequin_core::ranks::{Communicator, Message, RankError, Reduction, UNIT};
use arlequin_core::{Elastic, Error, Model};
use arlequin_mpi::threads;
use dem_beam::packing::{Lattice, lattice};
use dem_beam::{BeamMaterial, DemModel};
use fem_ref::{ElementKind, FemModel, generate};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering::SeqCst};
use std::time::{Duration, Instant};

/// Treatment of messages.
#[derive(Debug, Default)]
struct Way {
    /// If true, messages get lost once the work that can be done meanwhile is done.
    lost: AtomicBool,
    /// If true, the messages of all ranks but the first leave only after that one has done its work for the
    /// exchange.
    late: AtomicBool,
    done: AtomicUsize,
}

/// Transport that treats messages like that.
#[derive(Debug)]
struct Slow {
    inner: Arc<dyn Communicator>,
    way: Arc<Way>,
    exchanges: AtomicUsize,
}

impl Slow {
    fn new(inner: Arc<dyn Communicator>, way: &Arc<Way>) -> Arc<Self> {
        let (way, exchanges) = (way.clone(), AtomicUsize::new(0));
        Arc::new(Self {
            inner,
            way,
            exchanges,
        })
    }

    fn failed(&self) -> RankError {
        let rank = self.rank();
        RankError::Lost { rank, peer: 1 - rank }
    }

    /// Waits until the first rank has done its work for an exchange.
    fn dawdle(&self, exchange: usize) -> Result<(), RankError> {
        let until = Instant::now() + Duration::from_secs(10);
        while self.way.done.load(SeqCst) <= exchange {
            if Instant::now() > until {
                return Err(self.failed());
            }
            std::thread::yield_now();
        }
        Ok(())
    }
}

impl Communicator for Slow {
    fn rank(&self) -> usize {
        self.inner.rank()
    }
    fn ranks(&self) -> usize {
        self.inner.ranks()
    }
    fn exchange(
        &self,
        messages: &mut [Message],
        meanwhile: &mut dyn FnMut() -> bool,
    ) -> Result<(), RankError> {
        if self.way.lost.load(SeqCst) {
            while meanwhile() {}
            return Err(self.failed());
        }
        if !self.way.late.load(SeqCst) {
            return self.inner.exchange(messages, meanwhile);
        }
        let exchange = self.exchanges.fetch_add(1, SeqCst);
        if self.rank() > 0 {
            self.dawdle(exchange)?;
            return self.inner.exchange(messages, meanwhile);
        }
        self.inner.exchange(messages, &mut || {
            let more = meanwhile();
            if !more {
                self.way.done.fetch_max(exchange + 1, SeqCst);
            }
            more
        })
    }
    fn reduce(&self, words: &mut [i64], how: Reduction) -> Result<(), RankError> {
        self.inner.reduce(words, how)
    }
    fn abandon(&self, why: &str) {
        self.inner.abandon(why);
    }
}

/// Returns a displacement for every unknown, by its place in the whole body.
fn displacements(model: &dyn Model<f64>) -> Vec<f64> {
    let n = model.layout().nodes;
    let displacement = |k: usize| {
        let (sort, i, c) = (k / (3 * n), k / 3 % n, k % 3);
        1e-7 * (1.7 * (6 * global(model, i) + 3 * sort + c) as f64).sin()
    };
    (0..model.layout().dofs()).map(displacement).collect()
}

/// Returns the bits of the forces on a node, and of the torques if it turns.
fn on_node(model: &dyn Model<f64>, f: &[f64], node: usize) -> Vec<u64> {
    let n = model.layout().nodes;
    let sorts = f.len() / (3 * n);
    let components = |sort: usize| &f[3 * (sort * n + node)..][..3];
    (0..sorts).flat_map(components).map(|x| x.to_bits()).collect()
}

fn forces(model: &mut dyn Model<f64>) -> (Result<(), Error>, Vec<f64>) {
    let q = displacements(model);
    let mut f = vec![0.0; q.len()];
    (model.add_internal_forces(&q, &mut f), f)
}

/// Returns the name of a whole body and the forces on each of its nodes.
fn of_one_rank(mut model: Box<dyn Model<f64>>) -> (String, Vec<Vec<u64>>) {
    let (outcome, f) = forces(&mut *model);
    outcome.unwrap();
    let nodes = 0..model.layout().nodes;
    let bits_of_nodes = nodes.map(|i| on_node(&*model, &f, i)).collect();
    (model.name().to_owned(), bits_of_nodes)
}

/// Asserts that forces on this rank's nodes are those of the whole body.
fn assert_forces(model: &mut dyn Model<f64>, expected: &[Vec<u64>], what: &str) {
    let (outcome, f) = forces(model);
    outcome.unwrap();
    for i in 0..model.layout().nodes {
        let bits = &expected[global(model, i)];
        assert_eq!(&on_node(model, &f, i), bits, "{i} of {}, {what}", model.name());
    }
}

/// Function that makes a body.
type Body = Box<dyn Fn() -> Box<dyn Model<f64>> + Sync>;

/// Returns a lattice of `cells` under both laws and a column of `layers` of elements.
fn bodies(layers: usize, cells: [usize; 3]) -> [Body; 3] {
    let elements = move || {
        let far = Point3::new(1e-3, 1e-3, 0.25e-3 * layers as f64);
        let mesh = generate::block(ElementKind::Hex8, Point3::origin(), far, [4, 4, layers]).unwrap();
        let body = FemModel::new("block", mesh, Elastic::new(75e9, 0.17, 2200.0).unwrap());
        Box::new(body.unwrap()) as Box<dyn Model<f64>>
    };
    let particles = move || {
        let long = lattice(Lattice::BodyCentred, cells, 1e-4).unwrap();
        DemModel::new("long", &long, BeamMaterial::SILICA, 2200.0).unwrap()
    };
    [
        Box::new(move || Box::new(particles())),
        Box::new(move || Box::new(particles().with_finite_rotations())),
        Box::new(elements),
    ]
}

/// Returns bodies in which, on two ranks, some units read nodes of the other rank.
fn small_bodies() -> [Body; 3] {
    bodies(60, [60, 5, 5])
}

/// Returns bodies of which each of two ranks has more than one piece of work.
fn large_bodies() -> [Body; 3] {
    bodies(100, [70, 8, 8])
}

/// If messages get lost, forces of units within a rank are complete, with the bits of the whole body. Those
/// of units at the border are not begun, and the loss is reported.
#[test]
fn forces_within_a_rank_are_final_before_messages_come() {
    for body in small_bodies() {
        let (name, expected) = of_one_rank(body());
        let way = Arc::new(Way::default());
        let barrier = std::sync::Barrier::new(2);
        let counts = threads::run(2, 1, WAIT, |c| {
            let mut model = body();
            model
                .partition_among(&(Slow::new(c, &way) as Arc<dyn Communicator>))
                .unwrap();
            barrier.wait();
            way.lost.store(true, SeqCst);
            let (outcome, f) = forces(&mut *model);
            assert!(
                matches!(outcome, Err(Error::Rank(RankError::Lost { .. }))),
                "{outcome:?}"
            );
            let n = model.layout().nodes;
            let mut counts = [0, 0];
            for unit in 0..n.div_ceil(UNIT) {
                let nodes = unit * UNIT..n.min((unit + 1) * UNIT);
                let all_nodes = |is: &dyn Fn(usize) -> bool| nodes.clone().all(is);
                let is = |i: usize| on_node(&*model, &f, i) == expected[global(&*model, i)];
                let begun = |i: usize| on_node(&*model, &f, i).iter().any(|x| *x != 0);
                if all_nodes(&is) {
                    counts[0] += 1;
                } else {
                    assert!(all_nodes(&|i| !begun(i)), "unit {unit} of {}", model.name());
                    counts[1] += 1;
                }
            }
            counts
        });
        for c in counts {
            let [within, border] = c.unwrap();
            assert!(within > 0 && border > 0, "{within} {border} of {}", name);
        }
    }
}

/// Messages that leave late delay only the work that needs them.
#[test]
fn a_late_rank_does_not_delay_work_within_others() {
    for body in small_bodies() {
        let (name, expected) = of_one_rank(body());
        let way = Arc::new(Way::default());
        let barrier = std::sync::Barrier::new(2);
        let parts = threads::run(2, 1, WAIT, |c| {
            let mut model = body();
            model
                .partition_among(&(Slow::new(c, &way) as Arc<dyn Communicator>))
                .unwrap();
            barrier.wait();
            way.late.store(true, SeqCst);
            for _ in 0..3 {
                assert_forces(&mut *model, &expected, "late");
            }
        });
        parts.into_iter().for_each(|p| p.unwrap());
        assert_eq!(way.done.load(SeqCst), 3, "{}", name);
    }
}

/// Transport that asks for a fixed number of pieces of work, whatever the answer, and leaves the rest undone.
#[derive(Debug)]
struct Asking {
    inner: Arc<dyn Communicator>,
    pieces: usize,
    /// Number of pieces after which there was more to do.
    more: AtomicUsize,
}

impl Communicator for Asking {
    fn rank(&self) -> usize {
        self.inner.rank()
    }
    fn ranks(&self) -> usize {
        self.inner.ranks()
    }
    fn exchange(
        &self,
        messages: &mut [Message],
        meanwhile: &mut dyn FnMut() -> bool,
    ) -> Result<(), RankError> {
        let more = (0..self.pieces).filter(|_| meanwhile()).count();
        self.more.fetch_add(more, SeqCst);
        self.inner.exchange(messages, &mut || false)
    }
    fn reduce(&self, words: &mut [i64], how: Reduction) -> Result<(), RankError> {
        self.inner.reduce(words, how)
    }
    fn abandon(&self, why: &str) {
        self.inner.abandon(why);
    }
}

/// Transports may find time for no work, for a part of it, or for more than all.
#[test]
fn work_in_pieces_is_done_once_however_often_a_transport_asks_for_it() {
    for body in large_bodies() {
        let (name, expected) = of_one_rank(body());
        for pieces in [0, 1, 40] {
            let more = threads::run(2, 1, WAIT, |c| {
                let asking = Arc::new(Asking {
                    inner: c,
                    pieces,
                    more: AtomicUsize::new(0),
                });
                let mut model = body();
                model
                    .partition_among(&(asking.clone() as Arc<dyn Communicator>))
                    .unwrap();
                asking.more.store(0, SeqCst);
                assert_forces(&mut *model, &expected, &format!("{pieces} pieces"));
                asking.more.load(SeqCst)
            });
            for more in more {
                assert_eq!(more.unwrap() > 0, pieces > 0, "{name}, {pieces}");
            }
        }
    }
}
