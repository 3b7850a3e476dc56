//! Contact between particles that no bond joins: after a bond broke, and between particles that never had one.
//!
//! Particles are taken where they are, `x + u`. Pairs closer than their radii and a skin are listed by a cell search
//! that is repeated only when a particle has moved by half the skin; bonds that break join the list as they break.
//! A pair pushes from `min(r_i + r_j, distance at rest, distance when its bond broke)` on, so that no contact begins
//! with a force: packings have overlaps at rest, and bonds break while compressed.
//!
//! In an overlap of models stiffness and dashpot carry the smaller mass share of the two particles, which keeps the
//! critical step of the unweighted contact.
//!
//! Gaps are computed in parallel; forces are added pair after pair in a fixed order, so results do not depend on the
//! number of threads. A step allocates only where the lists grow.
//!
//! The step must resolve contacts that do not exist yet: an allowance of [`STIFF_CONTACTS`] stiff and
//! [`DAMPED_CONTACTS`] damped contacts per particle beside its bonds enters the critical step. A run in which contact
//! creates energy in spite of it is stopped by the core.

mod law;
pub(crate) mod neighbours;

pub use law::ContactLaw;
pub(crate) use law::{Pair, Spring};

use crate::bond::Twist;
use crate::error::Result;
use crate::finite;
use crate::fracture::{SharedLog, locked};
use crate::model::DemModel;
use crate::packing::cells::Sphere;
use arlequin_core::effect::{Demand, Effect, Instant, Site};
use arlequin_core::snapshot::Record;
use nalgebra::Vector3;
use neighbours::PairList;
use rayon::prelude::*;

/// Contacts with their full stiffness that a particle may have beside its bonds.
pub const STIFF_CONTACTS: f64 = 4.0;

/// Contacts that may be damped at a time.
pub const DAMPED_CONTACTS: f64 = 2.0;

/// Particles or pairs per unit of parallel work.
const CHUNK: usize = 2_048;

/// Where a contact acts and what it did in the last step.
#[derive(Debug, Clone, Copy)]
struct Active {
    ends: [u32; 2],
    /// Force on the second particle (N), the first feels its opposite.
    force: Vector3<f64>,
    /// Generalised torques on both (N m).
    torque: [Vector3<f64>; 2],
    stored: f64,
}

/// Contact within one cohesive-beam body, an effect on its subdomain.
#[derive(Debug)]
pub struct Contact {
    law: ContactLaw,
    damping_ratio: f64,
    finite: bool,
    rest: Vec<Sphere>,
    /// Unweighted masses.
    full: Vec<f64>,
    log: SharedLog,
    seen: usize,
    list: PairList,
    /// Mass share of each particle.
    share: Vec<f64>,
    mass: Vec<f64>,
    now: Vec<Sphere>,
    gaps: Vec<f64>,
    active: Vec<Active>,
    calls: usize,
    top_contacts: usize,
}

impl Contact {
    /// Contact between the particles of a model. Make it after the choice of rotations and fracture.
    ///
    /// # Errors
    /// [`crate::DemError::OutOfRange`] for parameters of the law.
    pub fn new(model: &DemModel, law: ContactLaw) -> Result<Self> {
        law.check()?;
        let body = model.body();
        let rest: Vec<Sphere> = body
            .positions()
            .iter()
            .zip(body.radii())
            .map(|(x, r)| [x.x, x.y, x.z, *r])
            .collect();
        let mean = body.radii().iter().sum::<f64>() / rest.len() as f64;
        Ok(Self {
            finite: model.has_finite_rotations(),
            full: model.masses().to_vec(),
            log: model.break_log(),
            seen: 0,
            list: PairList::new(body, law.skin * mean),
            share: Vec::new(),
            mass: Vec::new(),
            now: rest.clone(),
            gaps: Vec::new(),
            active: Vec::new(),
            calls: 0,
            top_contacts: 0,
            rest,
            damping_ratio: law.damping_ratio(),
            law,
        })
    }

    /// Searches made so far.
    #[must_use]
    pub fn searches(&self) -> usize {
        self.list.searches
    }

    /// Contacts that push now.
    #[must_use]
    pub fn count(&self) -> usize {
        self.active.len()
    }

    fn place(&mut self, q: &[f64]) {
        let n = self.now.len();
        let u = &q[..3 * n];
        let put = |(now, (rest, u)): (&mut Sphere, (&Sphere, &[f64; 3]))| {
            (0..3).for_each(|c| now[c] = rest[c] + u[c]);
        };
        let moves = self.rest.par_iter().zip(u.as_chunks::<3>().0);
        if n > 2 * CHUNK && rayon::current_num_threads() > 1 {
            self.now
                .par_iter_mut()
                .zip(moves)
                .with_min_len(CHUNK)
                .for_each(put);
        } else {
            let moves = self.rest.iter().zip(u.as_chunks::<3>().0);
            self.now.iter_mut().zip(moves).for_each(put);
        }
    }

    /// Overlaps (m) of all listed pairs.
    fn measure(&mut self) {
        let pairs = &self.list.pairs;
        self.gaps.resize(pairs.len(), 0.0);
        let now = &self.now;
        let gap = |(g, p): (&mut f64, &neighbours::Candidate)| {
            let (a, b) = (&now[p.ends[0] as usize], &now[p.ends[1] as usize]);
            let d = [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
            *g = p.rest - (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
        };
        if pairs.len() > 2 * CHUNK && rayon::current_num_threads() > 1 {
            self.gaps
                .par_iter_mut()
                .zip(pairs)
                .with_min_len(CHUNK)
                .for_each(gap);
        } else {
            self.gaps.iter_mut().zip(pairs).for_each(gap);
        }
    }

    fn pair(&self, ends: [u32; 2], gap: f64, at: &Instant<'_, f64>) -> Pair {
        let [i, j] = ends.map(|e| e as usize);
        let turn = at.q.len() / 2;
        let three = |x: &[f64], k: usize| Vector3::new(x[k], x[k + 1], x[k + 2]);
        let motion = |i: usize| {
            let rate = three(at.v_half, turn + 3 * i);
            Twist {
                linear: three(at.v_half, 3 * i),
                angular: if self.finite {
                    finite::spin(&three(at.q, turn + 3 * i), &rate)
                } else {
                    rate
                },
            }
        };
        let (a, b) = (&self.now[i], &self.now[j]);
        let d = Vector3::new(b[0] - a[0], b[1] - a[1], b[2] - a[2]);
        let distance = d.norm();
        Pair {
            normal: if distance > 0.0 {
                d / distance
            } else {
                Vector3::x()
            },
            gap,
            radii: [a[3], b[3]],
            arms: [a[3], b[3]].map(|r| distance * r / (a[3] + b[3])),
            share: self.share[i].min(self.share[j]),
            inverse_mass: 1.0 / self.mass[i] + 1.0 / self.mass[j],
            motion: [motion(i), motion(j)],
        }
    }

    fn respond(&mut self, at: &Instant<'_, f64>, f: &mut [f64]) {
        let turn = f.len() / 2;
        self.active.clear();
        for k in 0..self.gaps.len() {
            if self.gaps[k] <= 0.0 {
                if self.list.springs[k].on {
                    self.list.springs[k] = Spring::default();
                }
                continue;
            }
            let ends = self.list.pairs[k].ends;
            let pair = self.pair(ends, self.gaps[k], at);
            let mut r = self
                .law
                .respond(&pair, self.damping_ratio, at.dt, &mut self.list.springs[k]);
            if self.finite {
                for (t, e) in r.torque.iter_mut().zip(ends) {
                    let o = turn + 3 * e as usize;
                    let th = Vector3::new(at.q[o], at.q[o + 1], at.q[o + 2]);
                    *t = finite::generalised(&th, t);
                }
            }
            for (e, sign) in [(0, -1.0), (1, 1.0)] {
                let o = 3 * ends[e] as usize;
                for c in 0..3 {
                    f[o + c] += sign * r.force[c];
                    f[turn + o + c] += r.torque[e][c];
                }
            }
            self.active.push(Active {
                ends,
                force: r.force,
                torque: r.torque,
                stored: r.stored,
            });
        }
        self.top_contacts = self.top_contacts.max(self.active.len());
    }
}

/// Weighted mass of every particle (kg) and its share of the whole mass `full`.
pub(crate) fn masses(
    site: &Site<'_, f64>,
    of: &str,
    full: &[f64],
) -> arlequin_core::Result<(Vec<f64>, Vec<f64>)> {
    let found = site.model.layout().nodes;
    if found != full.len() {
        return Err(arlequin_core::Error::SizeMismatch {
            what: format!("particles of {of}"),
            expected: full.len(),
            found,
        });
    }
    let mass: Vec<f64> = (0..found).map(|i| site.inertia[3 * i]).collect();
    let share = mass.iter().zip(full).map(|(m, f)| m / f).collect();
    Ok((mass, share))
}

impl Effect<f64> for Contact {
    fn name(&self) -> &str {
        "contact"
    }

    fn attach(&mut self, site: &Site<'_, f64>) -> arlequin_core::Result<()> {
        (self.mass, self.share) = masses(site, &format!("contact on '{}'", site.model.name()), &self.full)?;
        Ok(())
    }

    fn add_forces(&mut self, at: &Instant<'_, f64>, f: &mut [f64]) -> arlequin_core::Result<()> {
        self.calls += 1;
        self.place(at.q);
        let log = self.log.clone();
        let log = locked(&log);
        for event in &log.events()[self.seen..] {
            self.list.add_broken(event, &self.rest);
        }
        self.seen = log.events().len();
        self.list.refresh(&self.now, &self.rest, &log);
        drop(log);
        self.measure();
        self.respond(at, f);
        Ok(())
    }

    fn save(&self) -> Record<f64> {
        let mut out = Record::default();
        let counts = [self.calls, self.top_contacts, self.seen];
        out.integers.extend(counts.map(|c| c as u64));
        self.list.save(&mut out);
        out
    }

    fn restore(&mut self, from: &Record<f64>) -> arlequin_core::Result<()> {
        let list = &mut self.list;
        let fits = from.integers.split_first_chunk::<3>().and_then(|(head, rest)| {
            [self.calls, self.top_contacts, self.seen] = head.map(|c| c as usize);
            list.restore(self.rest.len(), rest, &from.numbers)
        });
        self.active.clear();
        fits.ok_or_else(|| arlequin_core::Error::SizeMismatch {
            what: "particles in the record of contacts".into(),
            expected: self.rest.len(),
            found: from.numbers.len() / 4,
        })
    }

    fn power(&self, v: &[f64]) -> f64 {
        let turn = v.len() / 2;
        let three = |k: usize| Vector3::new(v[k], v[k + 1], v[k + 2]);
        let of = |a: &Active| {
            let [i, j] = a.ends.map(|e| 3 * e as usize);
            a.force.dot(&(three(j) - three(i)))
                + a.torque[0].dot(&three(turn + i))
                + a.torque[1].dot(&three(turn + j))
        };
        self.active.iter().map(of).sum()
    }

    fn demand(&self) -> Demand<f64> {
        let largest = self.rest.iter().fold(0.0_f64, |m, s| m.max(s[3]));
        let top = self
            .rest
            .iter()
            .zip(&self.full)
            .map(|(s, m)| self.law.stiffness([s[3], largest]) / m)
            .fold(0.0, f64::max);
        let [stiffness, damping] = self.law.demand(top);
        Demand {
            stiffness: STIFF_CONTACTS * stiffness,
            damping: DAMPED_CONTACTS * damping,
            ..Demand::none()
        }
    }

    fn stored(&self) -> f64 {
        self.active.iter().map(|a| a.stored).sum()
    }

    fn supplied(&self) -> Option<f64> {
        Some(0.0)
    }

    fn facts(&self) -> Vec<(String, f64)> {
        vec![
            ("contacts".into(), self.active.len() as f64),
            ("most contacts".into(), self.top_contacts as f64),
            ("neighbour searches".into(), self.list.searches as f64),
            ("listed pairs".into(), self.list.pairs.len() as f64),
            ("calls".into(), self.calls as f64),
        ]
    }
}
