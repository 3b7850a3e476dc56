//! Steps of velocity Verlet in the kernel, in one call or in two halves.

use super::{Gather, RankResult};
use crate::kernel::engine::{Marks, in_parts};
use crate::kernel::screen::Screened;
use crate::kernel::stride::{Accelerate, Drift, KickAndDrift, Moving, Speeds, Waiting};
use arlequin_core::{Drawn, Drift as CoreDrift, Kick, Stride};

impl<W: Screened> Gather<W> {
    /// Does both passes of a step: drift with the rows, then forces with the kick.
    pub(super) fn strides(&mut self, step: Stride<'_, f64>) -> RankResult<Option<Drawn<f64>>> {
        let Stride {
            dt,
            q,
            v,
            a,
            inverse_inertia,
            inertia,
        } = step;
        let (n, steps) = (q.len() / 2, [dt, dt * 0.5]);
        self.place_moved(steps, q, Speeds::Kept(v.split_at(n).into()), a);
        let accelerate = Accelerate {
            step: steps,
            kicked: false,
            waiting: None,
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

    /// Moves the particles and writes their rows.
    fn place_moved(&mut self, step: [f64; 2], q: &mut [f64], v: Speeds<'_>, a: &[f64]) {
        let (n, isa, parallel) = (q.len() / 2, self.isa, self.parallel());
        let moving = Moving {
            rows: &mut self.rows[..n / 3],
            reached: &mut self.reached,
            q: q.split_at_mut(n).into(),
            v,
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
            match v {
                Speeds::Kept(v) => {
                    for ((q, v), a) in q.iter_mut().zip(v).zip(a) {
                        isa.run(Drift { step, q, v, a });
                    }
                }
                Speeds::Kicked(v, before) => {
                    let before = before.map_or([None; 2], |q| q.map(Some));
                    for (((q, before), v), a) in q.iter_mut().zip(before).zip(v).zip(a) {
                        isa.run(KickAndDrift {
                            step,
                            before,
                            q,
                            v,
                            a,
                        });
                    }
                }
            }
            W::write_rows(isa, rows, q[0], q[1], reached);
        });
    }

    /// Moves the particles as [`super::BondForces::drift`].
    pub(super) fn drifts(&mut self, drift: CoreDrift<'_, f64>) {
        let CoreDrift {
            dt,
            q_before,
            q,
            v,
            a,
            prescribed,
        } = drift;
        let n = q.len() / 2;
        let before = q_before.map(|q| q.split_at(n).into());
        let v = Speeds::Kicked(v.split_at_mut(n).into(), before);
        self.place_moved([dt, dt * 0.5], q, v, a);
        for &(d, x) in prescribed {
            q[d] = x;
            // Rows begin with the displacements of their particle.
            self.rows[d / 3].0[d % 3] = x;
        }
    }

    /// Accelerates the particles as [`super::BondForces::kick`].
    pub(super) fn kicks(&mut self, kick: Kick<'_, f64>, marks: Option<Marks<'_>>) -> RankResult<()> {
        let Kick {
            dt,
            v,
            a,
            inverse_inertia,
            waiting,
            f,
        } = kick;
        let n = v.len() / 2;
        let accelerate = Accelerate {
            step: [dt, dt * 0.5],
            kicked: true,
            waiting: Some(Waiting {
                particles: waiting,
                f: f.split_at_mut(n).into(),
            }),
            v: v.split_at_mut(n).into(),
            a: a.split_at_mut(n).into(),
            w: inverse_inertia.split_at(n).into(),
            m: None,
            sum: 0.0,
        };
        self.gather(accelerate, marks, false)
    }
}
