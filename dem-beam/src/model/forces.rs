//! The block kernel in the numbering of a model: rows from the unknowns, forces into flat arrays.

use crate::bond::BeamRigidity;
use crate::kernel::engine::{Isa, Marks, Pass, Posed, Sink};
use crate::kernel::lanes::{CacheLine, LANES};
use crate::kernel::law::{Finite, Linear};
use crate::kernel::layout::Layout;
use crate::kernel::screen::Screened;
use crate::kernel::turn::{Turn, turned};
use crate::particles::BondedParticles;
use arlequin_core::adjacency::Adjacency;
use nalgebra::{Quaternion, UnitQuaternion};
use rayon::prelude::*;
use std::marker::PhantomData;

/// Particles above which a second thread pays for its wake-up.
const LARGE: usize = 4_000;

/// Particles per unit of parallel work.
const CHUNK: usize = 1_024;

impl Posed for Linear {
    #[inline]
    fn write_rows(_: Isa, rows: &mut [CacheLine], u: &[f64], th: &[f64], _: &mut [f64]) {
        let Some((last, rows)) = rows.split_last_mut() else {
            return;
        };
        // Four numbers at a time: the fourth lands in a free place of the row.
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

/// Orientations of the particles as they were reached last.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Reached<'a> {
    rows: &'a [CacheLine],
    th: &'a [f64],
}

impl Reached<'_> {
    /// Orientation of particle `i` with rotation unknowns `th`.
    #[inline]
    pub(crate) fn orientation(&self, i: usize, th: [f64; 3]) -> UnitQuaternion<f64> {
        let (row, from) = (&self.rows[i].0, &self.th[3 * i..3 * i + 3]);
        let d = [th[0] - from[0], th[1] - from[1], th[2] - from[2]];
        let q = turned([row[3], row[4], row[5], row[6]], d);
        UnitQuaternion::new_unchecked(Quaternion::new(q[0], q[1], q[2], q[3]))
    }
}

/// Forces of the bonds of a body under one of the two laws.
pub(crate) trait BondForces: std::fmt::Debug + Send + Sync {
    /// The same law for a body with other weights; nothing has turned yet.
    fn renewed(&self, body: &BondedParticles) -> Box<dyn BondForces>;
    /// Adds forces and torques at positions that become the reached ones; all in the layout of the model. With `marks` it
    /// looks at strengths on the way.
    fn advance(&mut self, q: &[f64], f: &mut [f64], marks: Option<Marks<'_>>);
    /// The same at any positions, without going there.
    fn add(&mut self, q: &[f64], f: &mut [f64], marks: Option<Marks<'_>>);
    /// What was reached last, under a law that turns.
    fn reached(&self) -> Option<Reached<'_>>;
    /// Quaternions (scalar first) and rotation unknowns of what was reached last: seven numbers per particle.
    fn save(&self) -> Vec<f64>;
    /// Undoes [`Self::save`]; `false` for numbers that are no orientations of as many particles.
    fn restore(&mut self, from: &[f64]) -> bool;
    /// Writes the forces of single blocks again, at the positions reached last.
    fn again(&self, blocks: &[usize], f: &mut [f64]);
    /// Leaves the bonds of blocks out that are not `whole`.
    fn refresh(
        &mut self,
        blocks: &[usize],
        body: &BondedParticles,
        adjacency: &Adjacency<[u32; 2]>,
        whole: &dyn Fn(usize) -> bool,
    );
    /// Instruction set in use.
    fn isa_name(&self) -> &'static str;
    /// Bytes of bond data.
    fn bond_bytes(&self) -> usize;
}

/// One body, one law.
#[derive(Debug)]
pub(crate) struct Gather<W: Posed> {
    layout: Layout,
    /// Particles at the positions reached last, and their rotation unknowns there.
    rows: Vec<CacheLine>,
    reached: Vec<f64>,
    /// The same for positions that are only tried; empty for a law whose rows follow from its unknowns alone.
    tried: Vec<CacheLine>,
    tried_at: Vec<f64>,
    rigidity: BeamRigidity,
    isa: Isa,
    law: PhantomData<W>,
}

impl<W: Screened> Gather<W> {
    /// `body` must be numbered for locality already. Nothing has turned yet.
    pub(crate) fn new(body: &BondedParticles) -> Self {
        let layout = Layout::new(body);
        let mut upright = CacheLine::default();
        let turns = if W::TURNS {
            upright.0[3] = 1.0;
            3 * body.len()
        } else {
            0
        };
        let rows = vec![upright; body.len().next_multiple_of(LANES)];
        Self {
            tried: if W::TURNS { rows.clone() } else { Vec::new() },
            tried_at: vec![0.0; turns],
            reached: vec![0.0; turns],
            layout,
            rows,
            rigidity: *body.rigidity(),
            isa: Isa::detect(),
            law: PhantomData,
        }
    }

    fn swap(&mut self) {
        std::mem::swap(&mut self.rows, &mut self.tried);
        std::mem::swap(&mut self.reached, &mut self.tried_at);
    }

    fn passes(&mut self, q: &[f64], f: &mut [f64], marks: Option<Marks<'_>>, parallel: bool) {
        let n = q.len() / 6;
        let (u, th) = q.split_at(3 * n);
        let (isa, rows) = (self.isa, &mut self.rows[..n]);
        if parallel {
            let sources = u.par_chunks(3 * CHUNK).zip(th.par_chunks(3 * CHUNK));
            let places = rows.par_chunks_mut(CHUNK).zip(sources);
            if W::TURNS {
                let reached = self.reached.par_chunks_mut(3 * CHUNK);
                places
                    .zip(reached)
                    .for_each(|((rows, (u, th)), reached)| W::write_rows(isa, rows, u, th, reached));
            } else {
                places.for_each(|(rows, (u, th))| W::write_rows(isa, rows, u, th, &mut []));
            }
        } else {
            W::write_rows(isa, rows, u, th, &mut self.reached);
        }
        let (linear, angular) = f.split_at_mut(3 * n);
        let sink = Sink { linear, angular };
        self.pass().add_forces(&self.rows, sink, marks, parallel);
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
    fn renewed(&self, body: &BondedParticles) -> Box<dyn BondForces> {
        Box::new(Self::new(body))
    }

    fn advance(&mut self, q: &[f64], f: &mut [f64], marks: Option<Marks<'_>>) {
        let n = q.len() / 6;
        let parallel = n > LARGE && rayon::current_num_threads() > 1;
        if parallel {
            // One entry into the pool for both passes.
            rayon::scope(|_| self.passes(q, f, marks, true));
        } else {
            self.passes(q, f, marks, false);
        }
    }

    fn add(&mut self, q: &[f64], f: &mut [f64], marks: Option<Marks<'_>>) {
        if W::TURNS {
            self.tried.copy_from_slice(&self.rows);
            self.tried_at.copy_from_slice(&self.reached);
            self.swap();
            self.advance(q, f, marks);
            self.swap();
        } else {
            self.advance(q, f, marks);
        }
    }

    fn reached(&self) -> Option<Reached<'_>> {
        W::TURNS.then_some(Reached {
            rows: &self.rows,
            th: &self.reached,
        })
    }

    fn save(&self) -> Vec<f64> {
        let rows = self.rows.iter().zip(self.reached.as_chunks::<3>().0);
        rows.flat_map(|(row, th)| row.0[3..7].iter().chain(th).copied())
            .collect()
    }

    fn restore(&mut self, from: &[f64]) -> bool {
        let (all, rest) = from.as_chunks::<7>();
        let unit = |x: &[f64; 7]| {
            let norm: f64 = x[..4].iter().map(|q| q * q).sum();
            (norm - 1.0).abs() < 1e-9 && x.iter().all(|x| x.is_finite())
        };
        if all.len() * 3 != self.reached.len() || !rest.is_empty() || !all.iter().all(unit) {
            return false;
        }
        let places = self.rows.iter_mut().zip(self.reached.as_chunks_mut::<3>().0);
        for ((row, th), x) in places.zip(all) {
            row.0[3..7].copy_from_slice(&x[..4]);
            th.copy_from_slice(&x[4..]);
        }
        true
    }

    fn again(&self, blocks: &[usize], f: &mut [f64]) {
        let n = f.len() / 6;
        let (linear, angular) = f.split_at_mut(3 * n);
        for &b in blocks {
            let particles = b * LANES..n.min((b + 1) * LANES);
            let range = 3 * particles.start..3 * particles.end;
            let (linear, angular) = (&mut linear[range.clone()], &mut angular[range]);
            linear.fill(0.0);
            angular.fill(0.0);
            let sink = Sink { linear, angular };
            self.pass().add_from(b, &self.rows, sink, None);
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

    fn isa_name(&self) -> &'static str {
        self.isa.name()
    }

    fn bond_bytes(&self) -> usize {
        self.layout.bond_bytes()
    }
}

#[cfg(test)]
mod tests {
    use super::{BondForces, Finite, Gather, Isa, Linear, Screened};
    use crate::bond::{BeamMaterial, Twist};
    use crate::packing::{Container, PackingSpec};
    use crate::particles::BondedParticles;
    use nalgebra::Vector3;

    fn worst<W: Screened + std::fmt::Debug + 'static>(
        body: &BondedParticles,
        x: &[Twist],
        portable: bool,
    ) -> f64 {
        let mut gather = Gather::<W>::new(body);
        if portable {
            gather.isa = Isa::Portable;
        }
        let flat = |x: &[Twist]| -> Vec<f64> {
            let linear = x.iter().flat_map(|t| t.linear.iter());
            linear
                .chain(x.iter().flat_map(|t| t.angular.iter()))
                .copied()
                .collect()
        };
        let mut plain = vec![Twist::zero(); x.len()];
        assert!(body.add_forces(x, &mut plain).is_ok());
        let mut fast = vec![0.0; 6 * x.len()];
        gather.add(&flat(x), &mut fast, None);
        let (plain, half) = (flat(&plain), fast.len() / 2);
        let part = |range: std::ops::Range<usize>| {
            let size = plain[range.clone()].iter().fold(0.0_f64, |a, f| a.max(f.abs()));
            let worst = range.map(|i| (fast[i] - plain[i]).abs()).fold(0.0, f64::max);
            worst / size
        };
        part(0..half).max(part(half..2 * half))
    }

    /// The instructions found and plain arrays; small motions, for which the finite law is the linear one to first order.
    #[test]
    fn kernel_equals_the_plain_loop() -> crate::error::Result<()> {
        let packing = PackingSpec::quench(Container::cylinder(6e-3, 1e-3)?, 1200, 3).build()?;
        let mut body = packing.bonded(BeamMaterial::SILICA, 2200.0)?;
        let noise = |i: usize, c: usize| (7.0 * i as f64 + 1.3 * c as f64).sin();
        let weights: Vec<f64> = (0..body.pairs().len()).map(|b| 0.5 + 0.5 * noise(b, 7)).collect();
        body.set_weights(&weights)?;
        let x = |linear: f64, angular: f64| -> Vec<Twist> {
            let twist = |i| Twist {
                linear: Vector3::new(noise(i, 0), noise(i, 1), noise(i, 2)) * linear,
                angular: Vector3::new(noise(i, 3), noise(i, 4), noise(i, 5)) * angular,
            };
            (0..body.len()).map(twist).collect()
        };
        for portable in [false, true] {
            let linear = worst::<Linear>(&body, &x(1e-7, 1e-3), portable);
            assert!(linear < 1e-13, "{linear}");
            let finite = worst::<Finite>(&body, &x(1e-11, 1e-7), portable);
            assert!(finite < 1e-5, "{finite}");
        }
        Ok(())
    }
}
