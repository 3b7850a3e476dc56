//! One pass over all blocks: forces, velocities, new rows.

use super::lanes::{Job, LANES, Lanes, Portable, Row, Scalar, add_interleaved, eight};
use super::law::{Law, Rigidity};
use super::layout::Layout;
use super::screen::{Blind, Look, Screen, Screened, Watcher};
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

/// Six numbers of eight particles.
pub(crate) type Six<T> = [Row<T>; 6];

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
}

/// What runs on a set of lanes.
pub(crate) trait OnLanes<T: Scalar> {
    fn on<L: Lanes<T = T>>(self, l: L);
}

/// Chooses the lanes of a scalar type.
pub(crate) trait Dispatch: Scalar {
    fn dispatch<J: OnLanes<Self>>(isa: Isa, job: J);
}

impl Dispatch for f64 {
    #[inline]
    fn dispatch<J: OnLanes<Self>>(isa: Isa, job: J) {
        match isa {
            #[cfg(target_arch = "x86_64")]
            Isa::V4(s) => job.on(super::lanes::Wide512(s)),
            #[cfg(target_arch = "x86_64")]
            Isa::V3(s) => job.on(super::lanes::Wide256::<Self>(s, PhantomData)),
            Isa::Portable => job.on(Portable::<Self>(PhantomData)),
        }
    }
}

impl Dispatch for f32 {
    #[inline]
    fn dispatch<J: OnLanes<Self>>(isa: Isa, job: J) {
        match isa {
            // Eight lanes of f32 fill a 256-bit register: AVX-512 has nothing to add.
            #[cfg(target_arch = "x86_64")]
            Isa::V4(s) => job.on(super::lanes::Wide256::<Self>(*s, PhantomData)),
            #[cfg(target_arch = "x86_64")]
            Isa::V3(s) => job.on(super::lanes::Wide256::<Self>(s, PhantomData)),
            Isa::Portable => job.on(Portable::<Self>(PhantomData)),
        }
    }
}

/// What a pass reads besides the particles.
#[derive(Debug)]
pub(crate) struct Pass<'a, T: Scalar, W: Law<T>> {
    pub(crate) layout: &'a Layout<T, W>,
    pub(crate) rigidity: BeamRigidity,
    pub(crate) isa: Isa,
    /// External forces and torques, if any.
    pub(crate) loads: Option<&'a [Six<T>]>,
    /// 1 for free, 0 for held components, if any is held.
    pub(crate) free: Option<&'a [Six<T>]>,
}

impl<T: Dispatch, W: Law<T>> Pass<'_, T, W> {
    /// `v += kick a(rows)`, `out = rows moved by drift v`.
    pub(crate) fn step(
        &self,
        rows: &[Row<T>],
        out: &mut [Row<T>],
        velocity: &mut [Six<T>],
        [kick, drift]: [f64; 2],
    ) {
        out.par_chunks_mut(CHUNK * LANES)
            .zip(velocity.par_chunks_mut(CHUNK))
            .enumerate()
            .for_each(|(c, (out, velocity))| {
                let (kick, drift) = (T::of(kick), T::of(drift));
                let first = c * CHUNK;
                T::dispatch(
                    self.isa,
                    Step {
                        pass: self,
                        first,
                        rows,
                        out,
                        velocity,
                        kick,
                        drift,
                    },
                );
            });
    }

    /// Internal forces and torques on the particles.
    pub(crate) fn forces(&self, rows: &[Row<T>], out: &mut [Six<T>]) {
        out.par_chunks_mut(CHUNK).enumerate().for_each(|(c, out)| {
            T::dispatch(
                self.isa,
                Forces {
                    pass: self,
                    first: c * CHUNK,
                    rows,
                    out,
                },
            );
        });
    }
}

/// How the rows of a law follow from the unknowns of a coupled model.
pub(crate) trait Posed: Law<f64> {
    /// Whether rows hold orientations, which go on from those reached before.
    const TURNS: bool = false;
    /// Moves rows to displacements `u` (m) and rotations `th` (rad), from where they were with rotations `reached`, which
    /// become `th`; empty for a law that does not turn.
    fn write_rows(isa: Isa, rows: &mut [Row<f64>], u: &[f64], th: &[f64], reached: &mut [f64]);
}

/// Where a model wants its forces: `x0 y0 z0 x1 ...` and torques in the same order.
#[derive(Debug)]
pub(crate) struct Sink<'a> {
    pub(crate) linear: &'a mut [f64],
    pub(crate) angular: &'a mut [f64],
}

/// Strengths to look at on the way, and a mark per block with a bond that may have reached its own.
pub(crate) type Marks<'a> = (&'a Screen, &'a mut [bool]);

impl<W: Screened> Pass<'_, f64, W> {
    /// Adds forces and torques to flat arrays; places must be particle numbers.
    pub(crate) fn add_forces(
        &self,
        rows: &[Row<f64>],
        sink: Sink<'_>,
        marks: Option<Marks<'_>>,
        parallel: bool,
    ) {
        if !parallel {
            return self.add_from(0, rows, sink, marks);
        }
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
    pub(crate) fn add_from(&self, first: usize, rows: &[Row<f64>], sink: Sink<'_>, marks: Option<Marks<'_>>) {
        let forces = AddForces {
            pass: self,
            first,
            rows,
            sink,
        };
        match marks {
            None => f64::dispatch(self.isa, forces),
            Some((screen, marks)) => f64::dispatch(
                self.isa,
                AddAndLook {
                    forces,
                    screen,
                    marks,
                },
            ),
        }
    }
}

struct AddAndLook<'a, 'b, W: Law<f64>> {
    forces: AddForces<'a, 'b, W>,
    screen: &'a Screen,
    marks: &'a mut [bool],
}

struct AddForces<'a, 'b, W: Law<f64>> {
    pass: &'a Pass<'b, f64, W>,
    first: usize,
    rows: &'a [Row<f64>],
    sink: Sink<'a>,
}

struct Step<'a, 'b, T: Scalar, W: Law<T>> {
    pass: &'a Pass<'b, T, W>,
    first: usize,
    rows: &'a [Row<T>],
    out: &'a mut [Row<T>],
    velocity: &'a mut [Six<T>],
    kick: T,
    drift: T,
}

struct Forces<'a, 'b, T: Scalar, W: Law<T>> {
    pass: &'a Pass<'b, T, W>,
    first: usize,
    rows: &'a [Row<T>],
    out: &'a mut [Six<T>],
}

/// A job with its lanes; `FETCH` switches fetching ahead on.
struct With<L, J, const FETCH: bool>(L, J);

impl<T: Scalar, W: Law<T>> OnLanes<T> for Step<'_, '_, T, W> {
    #[inline(always)]
    fn on<L: Lanes<T = T>>(self, l: L) {
        if self.rows.len() > FAR {
            l.run(With::<L, Self, true>(l, self));
        } else {
            l.run(With::<L, Self, false>(l, self));
        }
    }
}

impl<T: Scalar, W: Law<T>> OnLanes<T> for Forces<'_, '_, T, W> {
    #[inline(always)]
    fn on<L: Lanes<T = T>>(self, l: L) {
        if self.rows.len() > FAR {
            l.run(With::<L, Self, true>(l, self));
        } else {
            l.run(With::<L, Self, false>(l, self));
        }
    }
}

impl<W: Posed> OnLanes<f64> for AddForces<'_, '_, W> {
    #[inline(always)]
    fn on<L: Lanes<T = f64>>(self, l: L) {
        if self.rows.len() > FAR {
            l.run(With::<L, Self, true>(l, self));
        } else {
            l.run(With::<L, Self, false>(l, self));
        }
    }
}

impl<W: Screened> OnLanes<f64> for AddAndLook<'_, '_, W> {
    #[inline(always)]
    fn on<L: Lanes<T = f64>>(self, l: L) {
        if self.forces.rows.len() > FAR {
            l.run(With::<L, Self, true>(l, self));
        } else {
            l.run(With::<L, Self, false>(l, self));
        }
    }
}

/// Fetches `count` values into the nearest cache; any address will do.
#[inline(always)]
fn prefetch_lines<L: Lanes, X>(l: L, at: *const X, count: usize) {
    let lines = count * size_of::<X>() / size_of::<Row<L::T>>();
    for i in 0..lines {
        l.prefetch(at.cast::<Row<L::T>>().wrapping_add(i));
    }
}

/// First stage of slot `s`.
#[inline(always)]
fn fetch<L: Lanes, W: Law<L::T>, const FETCH: bool>(
    l: L,
    layout: &Layout<L::T, W>,
    rows: &[Row<L::T>],
    s: usize,
    slot: &W::Slot,
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
    W::near(l, slot, ready, &other)
}

/// Forces on the eight particles of a block; also returns their rows. `look` sees every slot.
#[inline(always)]
fn gather<L: Lanes, W: Law<L::T>, K: Look<L, W>, const FETCH: bool>(
    l: L,
    pass: &Pass<'_, L::T, W>,
    k: &Rigidity<L>,
    rows: &[Row<L::T>],
    block: usize,
    look: &mut K,
) -> ([L::V; 8], [L::V; 6]) {
    let layout = pass.layout;
    let mine = &rows[block * LANES..(block + 1) * LANES];
    let own = l.transpose(eight!(r => mine[r].0));
    let ready = W::ready(l, &own);
    look.begin(&ready);
    let mut acc = [l.splat(L::T::default()); 6];
    let range = layout.start[block] as usize..layout.start[block + 1] as usize;
    let mut before: Option<(usize, &W::Slot, W::Near<L>)> = None;
    for (slot, ahead) in layout.slots[range.clone()].iter().zip(range) {
        let near = fetch::<L, W, FETCH>(l, layout, rows, ahead, slot, &ready);
        if let Some((index, slot, near)) = before.replace((ahead, slot, near)) {
            W::add(l, k, slot, &ready, &near, &mut acc);
            look.see(index, slot, &ready, &near);
        }
    }
    if let Some((index, slot, near)) = before {
        W::add(l, k, slot, &ready, &near, &mut acc);
        look.see(index, slot, &ready, &near);
    }
    (own, acc)
}

impl<L: Lanes, W: Law<L::T>, const FETCH: bool> Job for With<L, Step<'_, '_, L::T, W>, FETCH> {
    #[inline(always)]
    fn call(self) {
        let (l, j) = (self.0, self.1);
        let k = Rigidity::new(l, &j.pass.rigidity);
        let (kick, drift) = (l.splat(j.kick), l.splat(j.drift));
        for (b, (out, velocity)) in j.out.chunks_exact_mut(LANES).zip(j.velocity).enumerate() {
            let block = j.first + b;
            if FETCH || W::LIGHT {
                let layout = j.pass.layout;
                prefetch_lines(l, std::ptr::from_ref(velocity).wrapping_add(1), 1);
                prefetch_lines(l, layout.inverse_mass.as_ptr().wrapping_add(block + 1), 1);
                prefetch_lines(l, out.as_ptr().wrapping_add(LANES), LANES);
            }
            let (own, mut f) = gather::<L, W, Blind, FETCH>(l, j.pass, &k, j.rows, block, &mut Blind);
            if let Some(loads) = j.pass.loads {
                for (f, load) in f.iter_mut().zip(&loads[block]) {
                    *f = l.add(*f, l.load(&load.0));
                }
            }
            if let Some(free) = j.pass.free {
                for (f, free) in f.iter_mut().zip(&free[block]) {
                    *f = l.mul(*f, l.load(&free.0));
                }
            }
            let m = &j.pass.layout.inverse_mass[block];
            let (m, i) = (l.mul(kick, l.load(&m[0].0)), l.mul(kick, l.load(&m[1].0)));
            let mut v = f;
            for c in 0..6 {
                v[c] = l.madd(if c < 3 { m } else { i }, f[c], l.load(&velocity[c].0));
            }
            for (store, v) in velocity.iter_mut().zip(v) {
                store.0 = l.store(v);
            }
            let moved = l.untranspose(W::advance(l, drift, &own, &v));
            for (out, row) in out.iter_mut().zip(moved) {
                out.0 = row;
            }
        }
    }
}

impl<L: Lanes, W: Law<L::T>, const FETCH: bool> Job for With<L, Forces<'_, '_, L::T, W>, FETCH> {
    #[inline(always)]
    fn call(self) {
        let (l, j) = (self.0, self.1);
        let k = Rigidity::new(l, &j.pass.rigidity);
        for (b, out) in j.out.iter_mut().enumerate() {
            let (_, f) = gather::<L, W, Blind, FETCH>(l, j.pass, &k, j.rows, j.first + b, &mut Blind);
            for (out, f) in out.iter_mut().zip(f) {
                out.0 = l.store(f);
            }
        }
    }
}

impl<L: Lanes<T = f64>, W: Posed, const FETCH: bool> Job for With<L, AddForces<'_, '_, W>, FETCH> {
    #[inline(always)]
    fn call(self) {
        let (l, mut j) = (self.0, self.1);
        let k = Rigidity::new(l, &j.pass.rigidity);
        for b in 0..j.blocks() {
            j.add_block::<L, Blind, FETCH>(l, &k, b, &mut Blind);
        }
    }
}

impl<L: Lanes<T = f64>, W: Screened, const FETCH: bool> Job for With<L, AddAndLook<'_, '_, W>, FETCH> {
    #[inline(always)]
    fn call(self) {
        let (l, mut j) = (self.0, self.1);
        let k = Rigidity::new(l, &j.forces.pass.rigidity);
        let mut watcher = Watcher::new(l, j.screen);
        for (b, mark) in j.marks.iter_mut().enumerate() {
            j.forces
                .add_block::<L, Watcher<'_, L>, FETCH>(l, &k, b, &mut watcher);
            *mark = watcher.found();
        }
    }
}

impl<W: Posed> AddForces<'_, '_, W> {
    #[inline(always)]
    fn blocks(&self) -> usize {
        self.sink.linear.len().div_ceil(3 * LANES)
    }

    /// Adds the forces of block `b` of this part.
    #[inline(always)]
    fn add_block<L: Lanes<T = f64>, K: Look<L, W>, const FETCH: bool>(
        &mut self,
        l: L,
        k: &Rigidity<L>,
        b: usize,
        look: &mut K,
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
        let (_, f) = gather::<L, W, K, FETCH>(l, self.pass, k, self.rows, block, look);
        add_interleaved(l, [f[0], f[1], f[2]], linear);
        add_interleaved(l, [f[3], f[4], f[5]], angular);
    }
}
