//! The passes of a velocity Verlet step in the kernel. Unknowns move while rows are written, and particles
//! are accelerated in the same block pass that has just computed their forces.
//!
//! ```text
//! v' = v + h a   q += dt v'   rows(q)   |   f(rows)   a' = w f   v = v' + h a'
//! ```

use super::engine::{Cut, Finish, OnLanes, PER_BLOCK, With, cut_unknowns, prefetch_lines};
use super::lanes::{CacheLine, Job, LANES, Lanes, sum};
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

/// Rows and unknowns (displacements, rotations) of a range of blocks.
pub(crate) struct Moving<'a> {
    pub(crate) rows: &'a mut [CacheLine],
    /// Rotations of the previous rows; empty for a law without orientations.
    pub(crate) reached: &'a mut [f64],
    pub(crate) q: [&'a mut [f64]; 2],
    pub(crate) v: [&'a [f64]; 2],
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
        let first = Moving {
            rows,
            reached,
            // Chunks of whole blocks: a particle's unknowns and its row belong to one task.
            q: [q, th],
            v: self.v.map(|v| &v[..split]),
            a: self.a.map(|a| &a[..split]),
        };
        let second = Moving {
            rows: later,
            reached: later_reached,
            q: [x, y],
            v: self.v.map(|v| &v[split..]),
            a: self.a.map(|a| &a[split..]),
        };
        (first, second)
    }
}

/// Accelerates the particles of a range of blocks; the arrays are pairs of displacements and rotations.
pub(crate) struct Accelerate<'a> {
    /// `dt` and `dt/2` \[s\].
    pub(crate) step: [f64; 2],
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
        let first = Accelerate {
            step: self.step,
            v: [v, spin],
            a: [a, b],
            w,
            m,
            sum: 0.0,
        };
        let second = Accelerate {
            step: self.step,
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
    fn take<L: Lanes>(&mut self, l: L, b: usize, f: [L::V; 6]) {
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
            let old = l.load(&accelerations[i]);
            // The same operations as in the first pass, so the same bits.
            let kicked = l.add(l.load(&vs[i]), l.mul(half, old));
            let new = l.mul(f[i], l.load(&ws[i]));
            if let Some(m) = m.0.get(i) {
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
                let kicked = *v + h * *a;
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
