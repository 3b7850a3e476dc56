//! One pass over all blocks: computes bond forces and optionally checks bond strengths.

use super::lanes::{CacheLine, Job, LANES, Lanes, Portable, add_interleaved, eight};
use super::law::{Law, Rigidity};
use super::layout::Layout;
use super::screen::{Screen, Screened, StrengthCheck};
use super::span::Slot;
use super::visit::{Energy, Visitor};
use crate::bond::BeamRigidity;
use std::marker::PhantomData;

/// Blocks per unit of parallel work: 256 particles, about 30 microseconds.
pub(crate) const CHUNK: usize = 32;

/// Slots ahead whose neighbour rows are prefetched: DRAM latency over the time of a slot. Between 3 and 16
/// the time of a step is the same (decision 0009).
const AHEAD: usize = 6;

/// Slots ahead whose constants are prefetched. The processor's own prefetching stops at the second-level
/// cache and at page ends.
const SLOTS_AHEAD: usize = 8;

/// Number of rows above which they no longer stay in the second-level cache and prefetching them pays.
const FAR: usize = 8_000;

/// The SIMD instruction set, chosen at run time.
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
            // Widest first: 256-bit vectors took 41 to 86 % longer (decision 0009).
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

    /// Runs a job on the lanes of this instruction set.
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

/// A job that runs on any set of lanes.
pub(crate) trait OnLanes {
    fn on<L: Lanes>(self, l: L);
}

/// Inputs of a pass other than the particles.
#[derive(Debug)]
pub(crate) struct Pass<'a, W: Law> {
    pub(crate) layout: &'a Layout,
    pub(crate) rigidity: BeamRigidity,
    pub(crate) isa: Isa,
    pub(crate) law: PhantomData<W>,
}

/// Writes the rows of a law from the unknowns of a coupled model.
pub(crate) trait Posed: Law {
    /// True if rows hold orientations, which are rotated on from their previous values.
    const TURNS: bool = false;
    /// Writes rows for displacements `u` \[m\] and rotations `th` \[rad\].
    ///
    /// `reached` holds the rotations of the previous call and is set to `th`; it is empty for a law without
    /// orientations.
    fn write_rows(isa: Isa, rows: &mut [CacheLine], u: &[f64], th: &[f64], reached: &mut [f64]);
}

/// The screen of strengths, and one mark per block that is set if a bond may have reached its strength.
pub(crate) type Marks<'a> = (&'a Screen, &'a mut [bool]);

/// Sums over a part of the body: elastic energy of its half-bonds \[J\], and the sum that [`Accelerate`] adds
/// up.
pub(crate) type Sums = [f64; 2];

/// Work on a range of blocks that can be split in two.
pub(crate) trait Cut: Sized + Send {
    /// Number of blocks in this range.
    fn blocks(&self) -> usize;
    /// Splits into the first `blocks` blocks and the rest.
    fn cut(self, blocks: usize) -> (Self, Self);
}

/// Does work in parts of [`CHUNK`] blocks, on one thread or on all threads.
pub(crate) fn in_parts<P: Cut>(job: P, parallel: bool, work: &(impl Fn(P) + Sync)) {
    let blocks = job.blocks();
    if blocks <= CHUNK {
        return work(job);
    }
    // Cuts at a multiple of CHUNK near the middle. The parts are the same on one thread and on many, so that
    // sums over them have the same bits. They are whole blocks, so that no two threads write the unknowns of
    // one particle.
    let (a, b) = job.cut(blocks.div_ceil(CHUNK) / 2 * CHUNK);
    if parallel {
        rayon::join(|| in_parts(a, true, work), || in_parts(b, true, work));
    } else {
        in_parts(a, false, work);
        in_parts(b, false, work);
    }
}

/// Unknowns per block, either displacements or rotations.
pub(crate) const PER_BLOCK: usize = 3 * LANES;

/// Splits an array of unknowns after the first `blocks` blocks.
pub(crate) fn cut_unknowns(x: &mut [f64], blocks: usize) -> (&mut [f64], &mut [f64]) {
    // The last block may be short: unknowns end with the particles, blocks are counted in full.
    let split = x.len().min(PER_BLOCK * blocks);
    x.split_at_mut(split)
}

/// A pass over a range of blocks: the consumer of the forces, and the optional checks and sums.
pub(crate) struct Part<'a, F> {
    /// First block.
    pub(crate) first: usize,
    pub(crate) finish: F,
    pub(crate) marks: Option<Marks<'a>>,
    /// One entry per [`CHUNK`] of blocks.
    pub(crate) sums: Option<&'a mut [Sums]>,
}

impl<F> Part<'_, F> {
    /// Leaves out a part in which nothing moves.
    fn skip(self) {
        if let Some(sum) = self.sums.and_then(|s| s.first_mut()) {
            *sum = [0.0; 2];
        }
        if let Some((_, marks)) = self.marks {
            marks.fill(false);
        }
    }
}

impl<F: Cut> Cut for Part<'_, F> {
    fn blocks(&self) -> usize {
        self.finish.blocks()
    }

    fn cut(self, blocks: usize) -> (Self, Self) {
        let (a, b) = self.finish.cut(blocks);
        let (marks, later) = match self.marks {
            Some((screen, marks)) => {
                let (x, y) = marks.split_at_mut(blocks);
                (Some((screen, x)), Some((screen, y)))
            }
            None => (None, None),
        };
        // Cuts lie at multiples of CHUNK, so that each sum belongs to one half.
        let (sums, later_sums) = match self.sums.map(|s| s.split_at_mut(blocks / CHUNK)) {
            Some((x, y)) => (Some(x), Some(y)),
            None => (None, None),
        };
        let first = Self {
            first: self.first,
            finish: a,
            marks,
            sums,
        };
        let second = Self {
            first: self.first + blocks,
            finish: b,
            marks: later,
            sums: later_sums,
        };
        (first, second)
    }
}

/// Consumes the forces of blocks.
pub(crate) trait Finish: Cut {
    /// Prefetches the data that [`Finish::take`] needs for block `b` of this part.
    fn fetch<L: Lanes>(&self, l: L, b: usize);
    /// Takes forces and torques on the particles of block `b`.
    fn take<L: Lanes>(&mut self, l: L, b: usize, f: [L::V; 6]);
    /// Returns the sum over all blocks taken so far.
    fn sum(&self) -> f64 {
        0.0
    }
}

/// Adds forces to the arrays of a model: `x0 y0 z0 x1 ...`, and torques in the same order.
#[derive(Debug)]
pub(crate) struct Sink<'a> {
    pub(crate) linear: &'a mut [f64],
    pub(crate) angular: &'a mut [f64],
}

impl Cut for Sink<'_> {
    fn blocks(&self) -> usize {
        self.linear.len().div_ceil(PER_BLOCK)
    }

    fn cut(self, blocks: usize) -> (Self, Self) {
        let (linear, a) = cut_unknowns(self.linear, blocks);
        let (angular, b) = cut_unknowns(self.angular, blocks);
        (
            Self { linear, angular },
            Sink {
                linear: a,
                angular: b,
            },
        )
    }
}

impl Finish for Sink<'_> {
    #[inline(always)]
    fn fetch<L: Lanes>(&self, l: L, b: usize) {
        for to in [&*self.linear, &*self.angular] {
            prefetch_lines(l, to.as_ptr().wrapping_add(PER_BLOCK * b), PER_BLOCK);
        }
    }

    #[inline(always)]
    fn take<L: Lanes>(&mut self, l: L, b: usize, f: [L::V; 6]) {
        let range = PER_BLOCK * b..self.linear.len().min(PER_BLOCK * (b + 1));
        add_interleaved(l, [f[0], f[1], f[2]], &mut self.linear[range.clone()]);
        add_interleaved(l, [f[3], f[4], f[5]], &mut self.angular[range]);
    }
}

/// Takes the forces of a number of blocks and drops them, for a pass that wants their energy alone.
#[derive(Debug)]
pub(crate) struct Discard(pub(crate) usize);

impl Cut for Discard {
    fn blocks(&self) -> usize {
        self.0
    }

    fn cut(self, blocks: usize) -> (Self, Self) {
        (Self(blocks), Self(self.0 - blocks))
    }
}

impl Finish for Discard {
    #[inline(always)]
    fn fetch<L: Lanes>(&self, _: L, _: usize) {}

    #[inline(always)]
    fn take<L: Lanes>(&mut self, _: L, _: usize, _: [L::V; 6]) {}
}

impl<W: Screened> Pass<'_, W> {
    /// Computes the forces of a part in units of [`CHUNK`] blocks.
    ///
    /// Places in the blocks must be particle numbers.
    pub(crate) fn run<F: Finish>(&self, rows: &[CacheLine], part: Part<'_, F>, parallel: bool) {
        in_parts(part, parallel, &|part| {
            if self.layout.is_left_out(part.first) {
                part.skip();
            } else if part.blocks() > 0 {
                self.isa.run(Gathering {
                    pass: self,
                    rows,
                    part,
                });
            }
        });
    }
}

struct Gathering<'a, 'b, 'c, W: Law, F> {
    pass: &'a Pass<'b, W>,
    rows: &'a [CacheLine],
    part: Part<'c, F>,
}

/// A job together with the lanes on which it runs.
pub(crate) struct With<L, J>(pub(crate) L, pub(crate) J);

impl<W: Screened, F: Finish> OnLanes for Gathering<'_, '_, '_, W, F> {
    #[inline(always)]
    fn on<L: Lanes>(self, l: L) {
        l.run(With(l, self));
    }
}

/// Prefetches `count` values into the nearest cache. The address need not be valid.
#[inline(always)]
pub(crate) fn prefetch_lines<L: Lanes, X>(l: L, address: *const X, count: usize) {
    let lines = count * size_of::<X>() / size_of::<CacheLine>();
    for i in 0..lines {
        l.prefetch(address.cast::<CacheLine>().wrapping_add(i));
    }
}

/// Runs the first stage of slot `s` and prefetches data of later slots.
#[inline(always)]
fn fetch<L: Lanes, W: Law>(
    l: L,
    (layout, rows, far): (&Layout, &[CacheLine], bool),
    k: &Rigidity<L>,
    s: usize,
    slot: &Slot,
    ready: &W::Ready<L>,
) -> W::Near<L> {
    // Neighbours are scattered, and the processor cannot foresee their rows; in the near cache they need no
    // help.
    if far && s + AHEAD < layout.neighbours.len() {
        for &p in &layout.neighbours[s + AHEAD] {
            l.prefetch(rows.as_ptr().wrapping_add(p as usize));
        }
    }
    // The linear law computes so little per byte that streams pay even where rows stay in the cache.
    if far || W::LIGHT {
        prefetch_lines(l, layout.slots.as_ptr().wrapping_add(s + SLOTS_AHEAD), 1);
    }
    let near = &layout.neighbours[s];
    let neighbour_rows = l.transpose(eight!(r => rows[near[r] as usize].0));
    let rest_lengths = if W::LENGTHS {
        &layout.rests[s].0
    } else {
        &[0.0; LANES]
    };
    W::near(l, k, (slot, rest_lengths), ready, &neighbour_rows)
}

/// Computes the forces on the eight particles of a block; `visitor` receives every slot.
#[inline(always)]
fn gather<L: Lanes, W: Law, K: Visitor<L, W>>(
    l: L,
    (layout, rows, far): (&Layout, &[CacheLine], bool),
    k: &Rigidity<L>,
    block: usize,
    visitor: &mut K,
) -> [L::V; 6] {
    // Eight rows at once, turned into vectors in registers: faster than gather instructions.
    let block_rows = &rows[block * LANES..(block + 1) * LANES];
    let columns = l.transpose(eight!(r => block_rows[r].0));
    let ready = W::ready(l, &columns);
    visitor.begin(&ready);
    // Sums run slot after slot in the order of storage: the bits do not depend on the number of threads.
    let mut acc = [l.splat(0.0); 6];
    let range = layout.start[block] as usize..layout.start[block + 1] as usize;
    let mut before: Option<(usize, &Slot, W::Near<L>)> = None;
    for (slot, ahead) in layout.slots[range.clone()].iter().zip(range) {
        // The first stage of this slot runs before the second stage of the previous one (`before`): the loads
        // and roots of one overlap with the arithmetic of the other (-3 % of time).
        let near = fetch::<L, W>(l, (layout, rows, far), k, ahead, slot, &ready);
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

impl<L: Lanes, W: Screened, F: Finish> Job for With<L, Gathering<'_, '_, '_, W, F>> {
    #[inline(always)]
    fn call(self) {
        let Self(l, Gathering { pass, rows, part }) = self;
        let Part {
            first,
            mut finish,
            marks,
            sums,
        } = part;
        let k = Rigidity::new(l, &pass.rigidity, &pass.layout.grid);
        let mut blocks = Blocks {
            pass,
            k,
            rows,
            first,
            finish: &mut finish,
        };
        let mut energy = Energy::new(l);
        let sum = sums.and_then(|s| s.first_mut());
        // One instance per combination of visitors, so that a pass without checks pays nothing for them.
        match (marks, &sum) {
            (None, None) => blocks.visit_blocks(l, &mut ()),
            (None, Some(_)) => blocks.visit_blocks(l, &mut energy),
            (Some(marks), None) => blocks.visit_blocks(l, &mut StrengthCheck::new(l, marks)),
            (Some(marks), Some(_)) => {
                let mut visitors = (StrengthCheck::new(l, marks), energy);
                blocks.visit_blocks(l, &mut visitors);
                energy = visitors.1;
            }
        }
        if let Some(sum) = sum {
            *sum = [energy.total(), finish.sum()];
        }
    }
}

/// The blocks of a part.
struct Blocks<'a, 'b, L: Lanes, W: Law, F> {
    pass: &'a Pass<'b, W>,
    k: Rigidity<L>,
    rows: &'a [CacheLine],
    first: usize,
    finish: &'a mut F,
}

impl<L: Lanes, W: Screened, F: Finish> Blocks<'_, '_, L, W, F> {
    #[inline(always)]
    fn visit_blocks<K: Visitor<L, W>>(&mut self, l: L, visitor: &mut K) {
        let far = self.rows.len() > FAR;
        for b in 0..self.finish.blocks() {
            // One block ahead; with the constants above this saves 5 % of the linear law's time at 20 000
            // particles, 20 % at a million.
            if far || W::LIGHT {
                self.finish.fetch(l, b + 1);
            }
            let inputs = (self.pass.layout, self.rows, far);
            let f = gather::<L, W, K>(l, inputs, &self.k, self.first + b, visitor);
            self.finish.take(l, b, f);
            visitor.end(b);
        }
    }
}
