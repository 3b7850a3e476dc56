//! One pass over all blocks: forces of the bonds, and the look at their strengths.

use super::lanes::{CacheLine, Job, LANES, Lanes, Portable, add_interleaved, eight};
use super::law::{Law, Rigidity};
use super::layout::Layout;
use super::screen::{NoVisitor, Screen, Screened, StrengthCheck, Visitor};
use super::span::Slot;
use crate::bond::BeamRigidity;
use rayon::prelude::*;
use std::marker::PhantomData;

/// Blocks per unit of parallel work: 256 particles, about 30 microseconds.
const CHUNK: usize = 32;

/// Half-bonds ahead of the current slot whose rows are fetched: DRAM latency over slot time.
const AHEAD: usize = 6;

/// Slots ahead whose constants are fetched, and blocks ahead for what a block streams: the processor's own
/// prefetching stops at the second-level cache and at page ends.
const SLOTS_AHEAD: usize = 8;

/// Particles above which rows no longer stay in the second-level cache and fetching ahead pays.
const FAR: usize = 8_000;

/// The instruction set found at run time.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Isa {
    #[cfg(target_arch = "x86_64")]
    V4(pulp::x86::V4),
    #[cfg(target_arch = "x86_64")]
    V3(pulp::x86::V3),
    Portable,
}

impl Isa {
    pub(crate) fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        {
            if let Some(s) = pulp::x86::V4::try_new() {
                return Self::V4(s);
            }
            if let Some(s) = pulp::x86::V3::try_new() {
                return Self::V3(s);
            }
        }
        Self::Portable
    }

    pub(crate) fn name(self) -> &'static str {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::V4(_) => "AVX-512",
            #[cfg(target_arch = "x86_64")]
            Self::V3(_) => "AVX2 + FMA",
            Self::Portable => "portable",
        }
    }

    /// Runs a job on its lanes.
    #[inline]
    pub(crate) fn run<J: OnLanes>(self, job: J) {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::V4(s) => job.on(super::lanes::Wide512(s)),
            #[cfg(target_arch = "x86_64")]
            Self::V3(s) => job.on(super::lanes::Wide256(s)),
            Self::Portable => job.on(Portable),
        }
    }
}

/// What runs on a set of lanes.
pub(crate) trait OnLanes {
    fn on<L: Lanes>(self, l: L);
}

/// What a pass reads besides the particles.
#[derive(Debug)]
pub(crate) struct Pass<'a, W: Law> {
    pub(crate) layout: &'a Layout,
    pub(crate) rigidity: BeamRigidity,
    pub(crate) isa: Isa,
    pub(crate) law: PhantomData<W>,
}

/// How the rows of a law follow from the unknowns of a coupled model.
pub(crate) trait Posed: Law {
    /// Whether rows hold orientations, which go on from those reached before.
    const TURNS: bool = false;
    /// Moves rows to displacements `u` \[m\] and rotations `th` \[rad\], from where they were with rotations `reached`, which
    /// become `th`; empty for a law that does not turn.
    fn write_rows(isa: Isa, rows: &mut [CacheLine], u: &[f64], th: &[f64], reached: &mut [f64]);
}

/// Where a model wants its forces: `x0 y0 z0 x1 ...` and torques in the same order.
#[derive(Debug)]
pub(crate) struct Sink<'a> {
    pub(crate) linear: &'a mut [f64],
    pub(crate) angular: &'a mut [f64],
}

/// Strengths to look at on the way, and a mark per block with a bond that may have reached its own.
pub(crate) type Marks<'a> = (&'a Screen, &'a mut [bool]);

impl<W: Screened> Pass<'_, W> {
    /// Adds forces and torques to flat arrays; places must be particle numbers.
    pub(crate) fn add_forces(
        &self,
        rows: &[CacheLine],
        sink: Sink<'_>,
        marks: Option<Marks<'_>>,
        parallel: bool,
    ) {
        if !parallel {
            return self.add_from(0, rows, sink, marks);
        }
        // Chunks are whole blocks: no two threads write the forces of one particle.
        const SIZE: usize = CHUNK * LANES;
        let parts = sink
            .linear
            .par_chunks_mut(3 * SIZE)
            .zip(sink.angular.par_chunks_mut(3 * SIZE));
        let part = |c: usize, (linear, angular), marks: Option<Marks<'_>>| {
            self.add_from(c * CHUNK, rows, Sink { linear, angular }, marks);
        };
        match marks {
            None => parts.enumerate().for_each(|(c, to)| part(c, to, None)),
            Some((screen, marks)) => parts
                .zip(marks.par_chunks_mut(CHUNK))
                .enumerate()
                .for_each(|(c, (to, marks))| part(c, to, Some((screen, marks)))),
        }
    }

    /// The blocks from `first` on that `sink` holds.
    pub(crate) fn add_from(
        &self,
        first: usize,
        rows: &[CacheLine],
        sink: Sink<'_>,
        marks: Option<Marks<'_>>,
    ) {
        self.isa.run(AddForces {
            pass: self,
            first,
            rows,
            sink,
            marks,
        });
    }
}

struct AddForces<'a, 'b, W: Law> {
    pass: &'a Pass<'b, W>,
    first: usize,
    rows: &'a [CacheLine],
    sink: Sink<'a>,
    marks: Option<Marks<'a>>,
}

/// A job with its lanes; `FETCH` switches fetching ahead on.
struct With<L, J, const FETCH: bool>(L, J);

impl<W: Screened> OnLanes for AddForces<'_, '_, W> {
    #[inline(always)]
    fn on<L: Lanes>(self, l: L) {
        if self.rows.len() > FAR {
            l.run(With::<L, Self, true>(l, self));
        } else {
            l.run(With::<L, Self, false>(l, self));
        }
    }
}

/// Fetches `count` values into the nearest cache; any address will do.
#[inline(always)]
fn prefetch_lines<L: Lanes, X>(l: L, at: *const X, count: usize) {
    let lines = count * size_of::<X>() / size_of::<CacheLine>();
    for i in 0..lines {
        l.prefetch(at.cast::<CacheLine>().wrapping_add(i));
    }
}

/// First stage of slot `s`.
#[inline(always)]
fn fetch<L: Lanes, W: Law, const FETCH: bool>(
    l: L,
    layout: &Layout,
    rows: &[CacheLine],
    k: &Rigidity<L>,
    s: usize,
    slot: &Slot,
    ready: &W::Ready<L>,
) -> W::Near<L> {
    if FETCH && s + AHEAD < layout.neighbours.len() {
        for &p in &layout.neighbours[s + AHEAD] {
            l.prefetch(rows.as_ptr().wrapping_add(p as usize));
        }
    }
    if FETCH || W::LIGHT {
        prefetch_lines(l, layout.slots.as_ptr().wrapping_add(s + SLOTS_AHEAD), 1);
    }
    let near = &layout.neighbours[s];
    let other = l.transpose(eight!(r => rows[near[r] as usize].0));
    W::near(l, k, slot, ready, &other)
}

/// Forces on the eight particles of a block. `visitor` sees every slot.
#[inline(always)]
fn gather<L: Lanes, W: Law, K: Visitor<L, W>, const FETCH: bool>(
    l: L,
    pass: &Pass<'_, W>,
    k: &Rigidity<L>,
    rows: &[CacheLine],
    block: usize,
    visitor: &mut K,
) -> [L::V; 6] {
    let layout = pass.layout;
    let mine = &rows[block * LANES..(block + 1) * LANES];
    let own = l.transpose(eight!(r => mine[r].0));
    let ready = W::ready(l, &own);
    visitor.begin(&ready);
    // Sums run slot after slot, in the order of storage: the same bits for any number of threads.
    let mut acc = [l.splat(0.0); 6];
    let range = layout.start[block] as usize..layout.start[block + 1] as usize;
    let mut before: Option<(usize, &Slot, W::Near<L>)> = None;
    for (slot, ahead) in layout.slots[range.clone()].iter().zip(range) {
        let near = fetch::<L, W, FETCH>(l, layout, rows, k, ahead, slot, &ready);
        if let Some((index, slot, near)) = before.replace((ahead, slot, near)) {
            W::add(l, k, slot, &ready, &near, &mut acc);
            visitor.visit(k, index, slot, &ready, &near);
        }
    }
    if let Some((index, slot, near)) = before {
        W::add(l, k, slot, &ready, &near, &mut acc);
        visitor.visit(k, index, slot, &ready, &near);
    }
    acc
}

impl<L: Lanes, W: Screened, const FETCH: bool> Job for With<L, AddForces<'_, '_, W>, FETCH> {
    #[inline(always)]
    fn call(self) {
        let (l, mut j) = (self.0, self.1);
        let k = Rigidity::new(l, &j.pass.rigidity, &j.pass.layout.grid);
        let Some((screen, marks)) = j.marks.take() else {
            for b in 0..j.sink.linear.len().div_ceil(3 * LANES) {
                j.add_block::<L, NoVisitor, FETCH>(l, &k, b, &mut NoVisitor);
            }
            return;
        };
        let mut check = StrengthCheck::new(l, screen);
        for (b, mark) in marks.iter_mut().enumerate() {
            j.add_block::<L, StrengthCheck<'_, L>, FETCH>(l, &k, b, &mut check);
            *mark = check.found();
        }
    }
}

impl<W: Screened> AddForces<'_, '_, W> {
    /// Adds the forces of block `b` of this part.
    #[inline(always)]
    fn add_block<L: Lanes, K: Visitor<L, W>, const FETCH: bool>(
        &mut self,
        l: L,
        k: &Rigidity<L>,
        b: usize,
        visitor: &mut K,
    ) {
        let block = self.first + b;
        let range = 3 * LANES * b..self.sink.linear.len().min(3 * LANES * (b + 1));
        let linear = &mut self.sink.linear[range.clone()];
        let angular = &mut self.sink.angular[range];
        if FETCH || W::LIGHT {
            for to in [&*linear, &*angular] {
                prefetch_lines(l, to.as_ptr().wrapping_add(3 * LANES), 3 * LANES);
            }
        }
        let f = gather::<L, W, K, FETCH>(l, self.pass, k, self.rows, block, visitor);
        add_interleaved(l, [f[0], f[1], f[2]], linear);
        add_interleaved(l, [f[3], f[4], f[5]], angular);
    }
}
