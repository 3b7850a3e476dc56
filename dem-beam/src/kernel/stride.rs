//! The passes of a velocity Verlet step in the kernel. Unknowns move while rows are written, and particles
//! are accelerated in the same block pass that has just computed their forces.
//!
//! ```text
//! v' = v + h a   q += dt v'   rows(q)   |   f(rows)   a' = w f   v = v' + h a'
//! ```
//!
//! Where other forces may act, `v'` is stored between the passes, and the second pass leaves out the blocks on
//! which they act: it writes their forces instead.

use super::engine::{Cut, Finish, OnLanes, PER_BLOCK, With, cut_unknowns, prefetch_lines};
use super::lanes::{CacheLine, Job, LANES, Lanes, add_interleaved, sum};
use std::ops::Range;

/// Job that moves unknowns of one kind by a step: displacements `q`, velocities `v`, accelerations `a`.
pub(crate) struct Drift<'a> {
    /// `dt` and `dt/2` \[s\].
    pub(crate) step: [f64; 2],
    pub(crate) q: &'a mut [f64],
    pub(crate) v: &'a [f64],
    pub(crate) a: &'a [f64],
}

impl OnLanes for Drift<'_> {
    #[inline(always)]
    fn on<L: Lanes>(self, l: L) {
        l.run(With(l, self));
    }
}

impl<L: Lanes> Job for With<L, Drift<'_>> {
    #[inline(always)]
    fn call(self) {
        let Self(
            l,
            Drift {
                step: [dt, h],
                q,
                v,
                a,
            },
        ) = self;
        let (wide, half) = (l.splat(dt), l.splat(h));
        let (qs, q) = q.as_chunks_mut::<LANES>();
        let (vs, v) = v.as_chunks::<LANES>();
        let (accelerations, a) = a.as_chunks::<LANES>();
        for (q, (v, a)) in qs.iter_mut().zip(vs.iter().zip(accelerations)) {
            // The half-step velocity is computed twice instead of stored. `mul` and `add` and no fused
            // multiply-add: it would round once where the core rounds twice.
            let v = l.add(l.load(v), l.mul(half, l.load(a)));
            *q = l.store(l.add(l.load(q), l.mul(wide, v)));
        }
        // The remainder in the order of operations of the vectors, so that the bits are those of the core.
        for (q, (v, a)) in q.iter_mut().zip(v.iter().zip(a)) {
            *q += dt * (v + h * a);
        }
    }
}

/// Job that kicks and moves unknowns of one kind: `v` becomes the half-step velocity.
pub(crate) struct KickAndDrift<'a> {
    /// `dt` and `dt/2` \[s\].
    pub(crate) step: [f64; 2],
    /// Displacements before the step, if they are in another array than `q`.
    pub(crate) before: Option<&'a [f64]>,
    pub(crate) q: &'a mut [f64],
    pub(crate) v: &'a mut [f64],
    pub(crate) a: &'a [f64],
}

impl OnLanes for KickAndDrift<'_> {
    #[inline(always)]
    fn on<L: Lanes>(self, l: L) {
        l.run(With(l, self));
    }
}

impl<L: Lanes> Job for With<L, KickAndDrift<'_>> {
    #[inline(always)]
    fn call(self) {
        let Self(
            _,
            KickAndDrift {
                step,
                before,
                q,
                v,
                a,
            },
        ) = self;
        let [dt, h] = step;
        // Plain loops, which the compiler turns into vectors without fused multiply-adds.
        match before {
            // `before` keeps the old displacements, from which the energy of a break is computed.
            Some(before) => {
                for ((q, before), (v, a)) in q.iter_mut().zip(before).zip(v.iter_mut().zip(a)) {
                    *v += h * *a;
                    *q = *before + dt * *v;
                }
            }
            None => {
                for (q, (v, a)) in q.iter_mut().zip(v.iter_mut().zip(a)) {
                    *v += h * *a;
                    *q += dt * *v;
                }
            }
        }
    }
}

/// Velocities of a first pass: displacements, rotations.
pub(crate) enum Speeds<'a> {
    /// Velocities that the pass reads and does not change.
    Kept([&'a [f64]; 2]),
    /// Velocities that become those of the half step, and the displacements before the step if they are kept.
    Kicked([&'a mut [f64]; 2], Option<[&'a [f64]; 2]>),
}

impl Speeds<'_> {
    fn cut(self, split: usize) -> (Self, Self) {
        match self {
            Self::Kept(v) => {
                let (first, second) = cut_both(v, split);
                (Self::Kept(first), Self::Kept(second))
            }
            Self::Kicked([v, spin], before) => {
                let ((v, x), (spin, y)) = (v.split_at_mut(split), spin.split_at_mut(split));
                let (first, second) = match before.map(|q| cut_both(q, split)) {
                    Some((first, second)) => (Some(first), Some(second)),
                    None => (None, None),
                };
                (Self::Kicked([v, spin], first), Self::Kicked([x, y], second))
            }
        }
    }
}

/// Rows and unknowns (displacements, rotations) of a range of blocks.
pub(crate) struct Moving<'a> {
    pub(crate) rows: &'a mut [CacheLine],
    /// Rotations of the previous rows; empty for a law without orientations.
    pub(crate) reached: &'a mut [f64],
    pub(crate) q: [&'a mut [f64]; 2],
    pub(crate) v: Speeds<'a>,
    pub(crate) a: [&'a [f64]; 2],
}

impl Cut for Moving<'_> {
    fn blocks(&self) -> usize {
        self.rows.len().div_ceil(LANES)
    }

    fn cut(self, blocks: usize) -> (Self, Self) {
        let (rows, later) = self.rows.split_at_mut(LANES * blocks);
        let (reached, later_reached) = cut_unknowns(self.reached, blocks);
        let [(q, x), (th, y)] = self.q.map(|q| cut_unknowns(q, blocks));
        let split = PER_BLOCK * blocks;
        let (v, later_v) = self.v.cut(split);
        let (a, later_a) = cut_both(self.a, split);
        let first = Moving {
            rows,
            reached,
            // Chunks of whole blocks: a particle's unknowns and its row belong to one task.
            q: [q, th],
            v,
            a,
        };
        let second = Moving {
            rows: later,
            reached: later_reached,
            q: [x, y],
            v: later_v,
            a: later_a,
        };
        (first, second)
    }
}

/// Particles that the pass does not accelerate, and the forces that it writes for them.
pub(crate) struct Waiting<'a> {
    /// True for particles on which other forces act; the pass adds those of their blocks and of marked blocks.
    pub(crate) particles: &'a mut [bool],
    pub(crate) f: [&'a mut [f64]; 2],
}

impl Waiting<'_> {
    /// Writes the forces of block `b` if it waits, and returns whether it does.
    #[inline(always)]
    fn take<L: Lanes>(&mut self, l: L, b: usize, f: [L::V; 6], marked: bool) -> bool {
        let particles = LANES * b..self.particles.len().min(LANES * (b + 1));
        let particles = &mut self.particles[particles];
        // A bond that may break changes the forces on both of its blocks, so marked blocks wait as well.
        if !marked && !particles.contains(&true) {
            return false;
        }
        // The whole block: a vector accelerates eight particles at once.
        particles.fill(true);
        for (k, target) in self.f.iter_mut().enumerate() {
            let range = PER_BLOCK * b..target.len().min(PER_BLOCK * (b + 1));
            let target = &mut target[range];
            // Added to zeros, as the core adds them, so that a zero has the same sign.
            target.fill(0.0);
            add_interleaved(l, [f[3 * k], f[3 * k + 1], f[3 * k + 2]], target);
        }
        true
    }

    fn cut(self, blocks: usize) -> (Self, Self) {
        let split = self.particles.len().min(LANES * blocks);
        let (particles, later) = self.particles.split_at_mut(split);
        let [(f, x), (t, y)] = self.f.map(|f| cut_unknowns(f, blocks));
        let first = Waiting { particles, f: [f, t] };
        let second = Waiting {
            particles: later,
            f: [x, y],
        };
        (first, second)
    }
}

/// Accelerates the particles of a range of blocks; the arrays are pairs of displacements and rotations.
pub(crate) struct Accelerate<'a> {
    /// `dt` and `dt/2` \[s\].
    pub(crate) step: [f64; 2],
    /// True if `v` holds the velocities of the half step already.
    pub(crate) kicked: bool,
    pub(crate) waiting: Option<Waiting<'a>>,
    pub(crate) v: [&'a mut [f64]; 2],
    pub(crate) a: [&'a mut [f64]; 2],
    /// Inverse inertia.
    pub(crate) w: [&'a [f64]; 2],
    /// Inertia, if the ledger needs the sum.
    pub(crate) m: Option<[&'a [f64]; 2]>,
    /// `Σ ½ m v'² + ¼ dt v' (f' - f)` over this part \[J\].
    pub(crate) sum: f64,
}

impl Cut for Accelerate<'_> {
    fn blocks(&self) -> usize {
        self.v[0].len().div_ceil(PER_BLOCK)
    }

    fn cut(self, blocks: usize) -> (Self, Self) {
        let split = PER_BLOCK * blocks;
        let [(v, x), (spin, y)] = self.v.map(|v| cut_unknowns(v, blocks));
        let [(a, p), (b, q)] = self.a.map(|a| cut_unknowns(a, blocks));
        let (w, r) = cut_both(self.w, split);
        let (m, n) = match self.m.map(|m| cut_both(m, split)) {
            Some((m, n)) => (Some(m), Some(n)),
            None => (None, None),
        };
        let (waiting, later) = match self.waiting.map(|w| w.cut(blocks)) {
            Some((first, second)) => (Some(first), Some(second)),
            None => (None, None),
        };
        let first = Accelerate {
            step: self.step,
            kicked: self.kicked,
            waiting,
            v: [v, spin],
            a: [a, b],
            w,
            m,
            sum: 0.0,
        };
        let second = Accelerate {
            step: self.step,
            kicked: self.kicked,
            waiting: later,
            v: [x, y],
            a: [p, q],
            w: r,
            m: n,
            sum: 0.0,
        };
        (first, second)
    }
}

fn cut_both(x: [&[f64]; 2], split: usize) -> ([&[f64]; 2], [&[f64]; 2]) {
    (x.map(|x| &x[..split]), x.map(|x| &x[split..]))
}

impl Finish for Accelerate<'_> {
    #[inline(always)]
    fn fetch<L: Lanes>(&self, l: L, b: usize) {
        for k in 0..2 {
            for of in [&*self.v[k], &*self.a[k], self.w[k]] {
                prefetch_lines(l, of.as_ptr().wrapping_add(PER_BLOCK * b), PER_BLOCK);
            }
        }
    }

    #[inline(always)]
    fn take<L: Lanes>(&mut self, l: L, b: usize, f: [L::V; 6], marked: bool) {
        if let Some(waiting) = &mut self.waiting
            && waiting.take(l, b, f, marked)
        {
            return;
        }
        // The last block may be short.
        let range = PER_BLOCK * b..self.v[0].len().min(PER_BLOCK * (b + 1));
        let linear = l.interleave([f[0], f[1], f[2]]);
        let angular = l.interleave([f[3], f[4], f[5]]);
        self.kick(l, 0, range.clone(), linear);
        self.kick(l, 1, range, angular);
    }

    fn sum(&self) -> f64 {
        self.sum
    }
}

impl Accelerate<'_> {
    /// Kicks the displacements (`sort` 0) or rotations (1) of up to eight particles by forces in the order of
    /// the unknowns.
    #[inline(always)]
    fn kick<L: Lanes>(&mut self, l: L, sort: usize, range: Range<usize>, f: [L::V; 3]) {
        let [dt, h] = self.step;
        let half = l.splat(h);
        let (vs, v) = self.v[sort][range.clone()].as_chunks_mut::<LANES>();
        let (accelerations, a) = self.a[sort][range.clone()].as_chunks_mut::<LANES>();
        let (ws, w) = self.w[sort][range.clone()].as_chunks::<LANES>();
        // A whole block has three vectors of unknowns, the last block may have fewer.
        let whole = vs.len().min(3);
        // As if added to zeros, so that a zero has the same sign as in the core.
        let f = sum(l, f, [l.splat(0.0); 3]);
        let m = match self.m {
            Some(m) => m[sort][range].as_chunks::<LANES>(),
            None => (&[][..], &[][..]),
        };
        let mut work = l.splat(0.0);
        for i in 0..whole {
            let mut kicked = l.load(&vs[i]);
            if !self.kicked {
                // The same operations as in the first pass, so the same bits.
                kicked = l.add(kicked, l.mul(half, l.load(&accelerations[i])));
            }
            let new = l.mul(f[i], l.load(&ws[i]));
            if let Some(m) = m.0.get(i) {
                let old = l.load(&accelerations[i]);
                // v' (½ m v' + ¼ dt (f' - m a))
                let m = l.load(m);
                // `m a` is the force before: the old forces are not stored.
                let pull = l.mul(l.splat(0.25 * dt), l.nmadd(m, old, f[i]));
                work = l.madd(kicked, l.madd(l.mul(l.splat(0.5), m), kicked, pull), work);
            }
            accelerations[i] = l.store(new);
            vs[i] = l.store(l.add(kicked, l.mul(half, new)));
        }
        if !v.is_empty() {
            // Particles behind the last whole vector, with the rounding of the vector code.
            let f = l.store(f[whole.min(2)]);
            for (i, (((v, a), w), f)) in v.iter_mut().zip(a).zip(w).zip(f).enumerate() {
                let kicked = if self.kicked { *v } else { *v + h * *a };
                if let Some(m) = m.1.get(i) {
                    self.sum += kicked * (0.5 * m * kicked + 0.25 * dt * (f - m * *a));
                }
                *a = f * w;
                *v = kicked + h * *a;
            }
        }
        if self.m.is_some() {
            // One sum per call, in a fixed order of lanes.
            self.sum += l.store(work).iter().sum::<f64>();
        }
    }
}
