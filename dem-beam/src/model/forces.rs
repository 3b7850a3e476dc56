//! Applies the block kernel to a model: writes its unknowns into kernel rows, and bond forces into flat
//! arrays in the model's numbering.

use crate::bond::BeamRigidity;
use crate::kernel::engine::{
    CHUNK, Cut, Discard, Finish, Isa, Marks, Part, Pass, Posed, Sink, Sums, cut_unknowns, in_parts,
};
use crate::kernel::lanes::{CacheLine, LANES};
use crate::kernel::law::{Finite, Linear};
use crate::kernel::layout::Layout;
use crate::kernel::screen::Screened;
use crate::kernel::stride::{Accelerate, Drift, Moving};
use crate::kernel::turn::{Turn, turned};
use crate::particles::BondedParticles;
use arlequin_core::Exact;
use arlequin_core::adjacency::Adjacency;
use arlequin_core::ranks::{Halo, Message, RankError, UNIT};
use arlequin_core::{Drawn, Stride};
use nalgebra::{Quaternion, UnitQuaternion};
use std::marker::PhantomData;

/// Row of a particle that has neither moved nor turned: the quaternion is (1, 0, 0, 0).
const UPRIGHT: CacheLine = CacheLine([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0]);

/// Number of particles above which a second thread gains more than its wake-up costs.
const LARGE: usize = 4_000;

impl Posed for Linear {
    #[inline]
    fn write_rows(_: Isa, rows: &mut [CacheLine], u: &[f64], th: &[f64], _: &mut [f64]) {
        let Some((last, rows)) = rows.split_last_mut() else {
            return;
        };
        // Four numbers are copied at a time; the fourth lands in an unused place of the row. The last
        // particle has no fourth number to read, so three are copied.
        let sources = u.windows(4).step_by(3).zip(th.windows(4).step_by(3));
        for (row, (u, th)) in rows.iter_mut().zip(sources) {
            row.0[..4].copy_from_slice(u);
            row.0[4..].copy_from_slice(th);
        }
        last.0[..3].copy_from_slice(&u[u.len() - 3..]);
        last.0[4..7].copy_from_slice(&th[th.len() - 3..]);
    }
}

impl Posed for Finite {
    const TURNS: bool = true;

    #[inline]
    fn write_rows(isa: Isa, rows: &mut [CacheLine], u: &[f64], th: &[f64], reached: &mut [f64]) {
        isa.run(Turn { rows, u, th, reached });
    }
}

/// Orientations of the particles at the state reached last.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Orientations<'a> {
    rows: &'a [CacheLine],
    th: &'a [f64],
}

impl Orientations<'_> {
    /// Orientations at rest, for any number of particles.
    pub(crate) fn upright() -> Self {
        Self { rows: &[], th: &[] }
    }

    /// Returns the orientation of particle `i` with rotation unknowns `th`.
    #[inline]
    pub(crate) fn orientation(&self, i: usize, th: [f64; 3]) -> UnitQuaternion<f64> {
        let (row, start) = match self.rows.get(i) {
            Some(row) => (row.0, &self.th[3 * i..3 * i + 3]),
            None => (UPRIGHT.0, &[0.0; 3][..]),
        };
        let d = [th[0] - start[0], th[1] - start[1], th[2] - start[2]];
        let q = turned([row[3], row[4], row[5], row[6]], d);
        UnitQuaternion::new_unchecked(Quaternion::new(q[0], q[1], q[2], q[3]))
    }
}

/// Result of an operation that needs other ranks. It never fails on a single rank.
pub(crate) type RankResult<R> = Result<R, RankError>;

/// Ghosts, whose rows are received from their owners, and the buffers of the messages.
#[derive(Debug)]
struct Ghosts {
    halo: Halo,
    messages: Vec<Message>,
}

impl Ghosts {
    /// Numbers sent per row.
    const SENT: usize = 7;

    fn new(halo: Halo) -> Self {
        Self {
            messages: halo.messages(Self::SENT),
            halo,
        }
    }
}

/// Forces of the bonds of a body under one of the two laws, in the layout of the model.
pub(crate) trait BondForces: std::fmt::Debug + Send + Sync {
    /// Adds forces and torques at `q` and makes `q` the reached state. With `marks` it also compares bonds
    /// with their strengths. Returns the elastic energy \[J\] if `energy` is set, else zero.
    fn advance(
        &mut self,
        q: &[f64],
        f: &mut [f64],
        marks: Option<Marks<'_>>,
        energy: bool,
    ) -> RankResult<f64>;
    /// Adds forces and torques at `q` and keeps the reached state.
    fn add(&mut self, q: &[f64], f: &mut [f64], marks: Option<Marks<'_>>) -> RankResult<()>;
    /// Returns the elastic energy at `q` \[J\] and keeps the reached state.
    fn energy(&mut self, q: &[f64]) -> RankResult<f64>;
    /// Does one step of velocity Verlet.
    fn stride(&mut self, step: Stride<'_, f64>) -> RankResult<Option<Drawn<f64>>>;
    /// Returns the orientations reached last under the finite-rotation law, `None` under the small one.
    fn orientations(&self) -> Option<Orientations<'_>>;
    /// Writes the states of the ghosts at the positions reached last, as a [`super::poses::Reader`] takes
    /// them.
    fn ghosts(&self, out: &mut Vec<[f64; 7]>);
    /// Returns quaternions (scalar first) and rotation unknowns reached last: seven numbers per particle.
    fn save(&self) -> Vec<f64>;
    /// Restores the state that [`Self::save`] returned. Returns `false` for another number of particles or
    /// for quaternions that are not of unit length.
    fn restore(&mut self, from: &[f64]) -> bool;
    /// Leaves units of work out of the forces in which `still` holds for all particles, until the next call.
    fn leave_out(&mut self, still: &dyn Fn(usize) -> bool);
    /// Computes the forces of `blocks` again at the positions reached last, and overwrites them in `f`.
    fn recompute(&self, blocks: &[usize], f: &mut [f64]);
    /// Rebuilds `blocks` without their broken bonds; `whole` returns whether a bond is unbroken.
    fn refresh(
        &mut self,
        blocks: &[usize],
        body: &BondedParticles,
        adjacency: &Adjacency<[u32; 2]>,
        whole: &dyn Fn(usize) -> bool,
    );
}

/// Data that is needed to write the rows of a range of blocks.
struct Placing<'a> {
    /// First block.
    first: usize,
    rows: &'a mut [CacheLine],
    reached: &'a mut [f64],
    q: [&'a [f64]; 2],
}

impl Cut for Placing<'_> {
    fn blocks(&self) -> usize {
        self.rows.len().div_ceil(LANES)
    }

    fn cut(self, blocks: usize) -> (Self, Self) {
        let (rows, later) = self.rows.split_at_mut(LANES * blocks);
        let (reached, reached_later) = cut_unknowns(self.reached, blocks);
        let q = self.q.map(|q| q.split_at(3 * LANES * blocks));
        let first = Placing {
            first: self.first,
            rows,
            reached,
            q: q.map(|q| q.0),
        };
        let second = Placing {
            first: self.first + blocks,
            rows: later,
            reached: reached_later,
            q: q.map(|q| q.1),
        };
        (first, second)
    }
}

/// Kernel of one body under one law. Each particle gathers the forces of its own bonds.
#[derive(Debug)]
pub(crate) struct Gather<W: Posed> {
    layout: Layout,
    /// Rows of the particles in the state reached last.
    rows: Vec<CacheLine>,
    /// Rotation unknowns in the state reached last.
    reached: Vec<f64>,
    /// Rows for trial positions, at which forces are computed without advancing the orientations. Empty for a
    /// law whose rows depend on the unknowns alone.
    tried: Vec<CacheLine>,
    /// Rotation unknowns at the trial positions.
    tried_at: Vec<f64>,
    /// Energy sums of the parts of a pass.
    sums: Vec<Sums>,
    ghosts: Option<Ghosts>,
    rigidity: BeamRigidity,
    isa: Isa,
    law: PhantomData<W>,
}

/// Parts of a pass are units, so that sums do not depend on the partition.
const _: () = assert!(CHUNK * LANES == UNIT);

impl<W: Screened> Gather<W> {
    /// Builds the kernel of a whole body, with orientations at rest. The particles should be numbered for
    /// locality.
    pub(crate) fn new(body: &BondedParticles) -> Self {
        Self::with_halo(body, None)
    }

    /// Builds the kernel; with `halo`, that of a rank's part of a partitioned body, whose last particles are
    /// ghosts.
    pub(crate) fn with_halo(body: &BondedParticles, halo: Option<Halo>) -> Self {
        let foreign = halo.as_ref().map_or(0, |h| h.ghosts().len());
        let owned = body.len() - foreign;
        let layout = Layout::new(body, owned, W::LENGTHS);
        let (upright, turns) = match W::TURNS {
            true => (UPRIGHT, 3 * owned),
            false => (CacheLine::default(), 0),
        };
        // Ghost rows begin behind the last block, so that no block mixes owned particles and ghosts.
        let rows = vec![upright; owned.next_multiple_of(LANES) + foreign];
        Self {
            tried: if W::TURNS { rows.clone() } else { Vec::new() },
            tried_at: vec![0.0; turns],
            reached: vec![0.0; turns],
            sums: vec![[0.0; 2]; owned.div_ceil(CHUNK * LANES)],
            ghosts: halo.map(Ghosts::new),
            layout,
            rows,
            rigidity: *body.rigidity(),
            isa: Isa::detect(),
            law: PhantomData,
        }
    }

    /// Evaluates something and keeps the reached state, on which orientations depend.
    fn try_out<R>(&mut self, evaluate: impl FnOnce(&mut Self) -> R) -> R {
        if !W::TURNS {
            return evaluate(self);
        }
        self.tried.copy_from_slice(&self.rows);
        self.tried_at.copy_from_slice(&self.reached);
        // Evaluates on the copy, then swaps the reached state back.
        self.swap();
        let result = evaluate(self);
        self.swap();
        result
    }

    fn swap(&mut self) {
        std::mem::swap(&mut self.rows, &mut self.tried);
        std::mem::swap(&mut self.reached, &mut self.tried_at);
    }

    /// Writes the rows for `q`, then computes the forces there.
    fn passes<F: Finish>(
        &mut self,
        q: &[f64],
        finish: F,
        marks: Option<Marks<'_>>,
        energy: bool,
    ) -> RankResult<()> {
        let (isa, parallel) = (self.isa, self.parallel());
        // `q` has three displacements and three rotations per owned particle; ghost rows come behind them.
        let placing = Placing {
            first: 0,
            rows: &mut self.rows[..q.len() / 6],
            reached: &mut self.reached,
            q: q.split_at(q.len() / 2).into(),
        };
        let layout = &self.layout;
        in_parts(placing, parallel, &|p| {
            // Nobody reads the rows of particles that sleep.
            if !layout.is_asleep(p.first) {
                W::write_rows(isa, p.rows, p.q[0], p.q[1], p.reached);
            }
        });
        self.gather(finish, marks, energy)
    }

    /// Receives the rows of the ghosts and computes the forces at all rows, and energy sums if `sums` is set.
    fn gather<F: Finish>(&mut self, finish: F, marks: Option<Marks<'_>>, sums: bool) -> RankResult<()> {
        self.receive_ghosts()?;
        let parallel = self.parallel();
        // Taken out of `self`, which the pass reads.
        let mut totals = std::mem::take(&mut self.sums);
        let part = Part {
            first: 0,
            finish,
            marks,
            sums: sums.then_some(&mut totals[..]),
        };
        self.pass().run(&self.rows, part, parallel);
        self.sums = totals;
        Ok(())
    }

    /// Receives the rows of the ghosts from their owners; does nothing in a whole body.
    fn receive_ghosts(&mut self) -> RankResult<()> {
        let Some(Ghosts { halo, messages }) = &mut self.ghosts else {
            return Ok(());
        };
        let first = self.layout.particles().next_multiple_of(LANES);
        let (owned, ghosts) = self.rows.split_at_mut(first);
        halo.exchange::<{ Ghosts::SENT }>(
            messages,
            |i| std::array::from_fn(|k| owned[i].0[k]),
            |g, x| ghosts[g].0[..Ghosts::SENT].copy_from_slice(&x),
        )
    }

    /// Returns the energy sums over all parts, on all ranks.
    fn total(&self) -> Sums {
        // Exact sums do not depend on order, threads or ranks.
        let mut sums = [Exact::zero(); 2];
        for part in &self.sums {
            sums.iter_mut().zip(part).for_each(|(sum, x)| sum.add(*x));
        }
        match &self.ghosts {
            Some(g) => g.halo.owned().total(sums),
            None => sums.map(Exact::value),
        }
    }

    /// Returns whether several threads are faster than one.
    fn parallel(&self) -> bool {
        self.rows.len() > LARGE && rayon::current_num_threads() > 1
    }

    /// Does both passes of a step: drift with the rows, then forces with the kick.
    fn strides(&mut self, step: Stride<'_, f64>) -> RankResult<Option<Drawn<f64>>> {
        let Stride {
            dt,
            q,
            v,
            a,
            inverse_inertia,
            inertia,
        } = step;
        let (n, isa, parallel) = (q.len() / 2, self.isa, self.parallel());
        let steps = [dt, dt * 0.5];
        let moving = Moving {
            rows: &mut self.rows[..n / 3],
            reached: &mut self.reached,
            q: q.split_at_mut(n).into(),
            v: v.split_at(n).into(),
            a: a.split_at(n).into(),
        };
        in_parts(moving, parallel, &|p| {
            let Moving {
                rows,
                reached,
                mut q,
                v,
                a,
            } = p;
            for ((q, v), a) in q.iter_mut().zip(v).zip(a) {
                isa.run(Drift { step: steps, q, v, a });
            }
            W::write_rows(isa, rows, q[0], q[1], reached);
        });
        let accelerate = Accelerate {
            step: steps,
            v: v.split_at_mut(n).into(),
            a: a.split_at_mut(n).into(),
            w: inverse_inertia.split_at(n).into(),
            m: inertia.map(|m| m.split_at(n).into()),
            sum: 0.0,
        };
        self.gather(accelerate, None, inertia.is_some())?;
        Ok(inertia.map(|_| {
            let [internal, moving] = self.total();
            Drawn { internal, moving }
        }))
    }

    fn pass(&self) -> Pass<'_, W> {
        Pass {
            layout: &self.layout,
            rigidity: self.rigidity,
            isa: self.isa,
            law: PhantomData,
        }
    }
}

impl<W: Screened + std::fmt::Debug + 'static> BondForces for Gather<W> {
    fn advance(
        &mut self,
        q: &[f64],
        f: &mut [f64],
        marks: Option<Marks<'_>>,
        energy: bool,
    ) -> RankResult<f64> {
        let (linear, angular) = f.split_at_mut(q.len() / 2);
        let sink = Sink { linear, angular };
        if self.parallel() {
            // One entry into the pool for both passes.
            rayon::scope(|_| self.passes(q, sink, marks, energy))?;
        } else {
            self.passes(q, sink, marks, energy)?;
        }
        Ok(if energy { self.total()[0] } else { 0.0 })
    }

    fn add(&mut self, q: &[f64], f: &mut [f64], marks: Option<Marks<'_>>) -> RankResult<()> {
        self.try_out(|kernel| kernel.advance(q, f, marks, false).map(|_| ()))
    }

    fn energy(&mut self, q: &[f64]) -> RankResult<f64> {
        let blocks = Discard(self.layout.particles().div_ceil(LANES));
        self.try_out(|kernel| {
            if kernel.parallel() {
                rayon::scope(|_| kernel.passes(q, blocks, None, true))?;
            } else {
                kernel.passes(q, blocks, None, true)?;
            }
            Ok(kernel.total()[0])
        })
    }

    fn stride(&mut self, step: Stride<'_, f64>) -> RankResult<Option<Drawn<f64>>> {
        if self.parallel() {
            rayon::scope(|_| self.strides(step))
        } else {
            self.strides(step)
        }
    }

    fn leave_out(&mut self, still: &dyn Fn(usize) -> bool) {
        self.layout.leave_out(still);
    }

    fn orientations(&self) -> Option<Orientations<'_>> {
        W::TURNS.then_some(Orientations {
            rows: &self.rows,
            th: &self.reached,
        })
    }

    fn ghosts(&self, out: &mut Vec<[f64; 7]>) {
        out.clear();
        let first = self.layout.particles().next_multiple_of(LANES);
        let foreign = self.rows[first.min(self.rows.len())..].iter();
        out.extend(foreign.map(|CacheLine([x, y, z, a, b, c, d, _])| {
            // The layout of [`super::poses::Reader::state_to_send`].
            let [e, f, g, h] = match W::TURNS {
                // A turn by zero, so that the quaternion has the same bits as [`Orientations::orientation`]
                // gives on its owner.
                true => turned([*a, *b, *c, *d], [0.0; 3]),
                false => [*b, *c, *d, 0.0],
            };
            [*x, *y, *z, e, f, g, h]
        }));
    }

    fn save(&self) -> Vec<f64> {
        let rows = self.rows.iter().zip(self.reached.as_chunks::<3>().0);
        rows.flat_map(|(row, th)| row.0[3..7].iter().chain(th).copied())
            .collect()
    }

    fn restore(&mut self, saved: &[f64]) -> bool {
        let (states, remainder) = saved.as_chunks::<7>();
        let unit = |x: &[f64; 7]| {
            let norm: f64 = x[..4].iter().map(|q| q * q).sum();
            (norm - 1.0).abs() < 1e-9 && x.iter().all(|x| x.is_finite())
        };
        if states.len() * 3 != self.reached.len() || !remainder.is_empty() || !states.iter().all(unit) {
            return false;
        }
        let places = self.rows.iter_mut().zip(self.reached.as_chunks_mut::<3>().0);
        for ((row, th), x) in places.zip(states) {
            row.0[3..7].copy_from_slice(&x[..4]);
            th.copy_from_slice(&x[4..]);
        }
        true
    }

    fn recompute(&self, blocks: &[usize], f: &mut [f64]) {
        let n = f.len() / 6;
        let (linear, angular) = f.split_at_mut(3 * n);
        for &b in blocks {
            let particles = b * LANES..n.min((b + 1) * LANES);
            let range = 3 * particles.start..3 * particles.end;
            let (linear, angular) = (&mut linear[range.clone()], &mut angular[range]);
            linear.fill(0.0);
            angular.fill(0.0);
            let part = Part {
                first: b,
                finish: Sink { linear, angular },
                marks: None,
                sums: None,
            };
            self.pass().run(&self.rows, part, false);
        }
    }

    fn refresh(
        &mut self,
        blocks: &[usize],
        body: &BondedParticles,
        adjacency: &Adjacency<[u32; 2]>,
        whole: &dyn Fn(usize) -> bool,
    ) {
        for &b in blocks {
            self.layout.refresh(b, body, adjacency, whole);
        }
    }
}

#[cfg(test)]
mod tests;
