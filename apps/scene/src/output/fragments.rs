//! Fragments into which bodies with bonds have broken, over time.

use super::{mark, put};
use crate::error::{Result, core};
use crate::setup::{Grid, ModelInfo};
use arlequin::core::adjacency::lowest_connected;
use arlequin::core::{Coupled, Subdomain, Uniform};
use arlequin::dem_beam::fracture::{SharedLog, locked};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::fmt::Write as _;
use std::path::Path;
use std::sync::Arc;

/// Largest number of fragments of one model that are listed at one instant; the heaviest are.
const MOST: usize = 1_000;

/// A fragment at one instant; number 0 stands for all particles without a bond.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Piece {
    /// Time \[s\].
    pub time: f64,
    /// Name of the model.
    pub model: String,
    /// Number, from 1 for the heaviest.
    pub number: usize,
    /// Number of particles.
    pub particles: usize,
    /// Unweighted mass \[kg\].
    pub mass: f64,
    /// Present centre of mass \[m\], of the particles that are awake.
    pub centre: [f64; 3],
    /// Velocity of that centre \[m/s\].
    pub velocity: [f64; 3],
}

/// A model whose bonds can break.
#[derive(Debug)]
struct Body {
    number: usize,
    breaks: SharedLog,
    /// Particles and bonds at rest.
    grid: Arc<Grid>,
    /// Masses of all particles \[kg\]; for a partitioned model on rank 0 only, which finds the fragments.
    masses: Vec<f64>,
    fragments: Groups,
}

/// Particles that whole bonds join, which change by breaks alone.
#[derive(Debug, Default)]
struct Groups {
    /// Number of breaks at which they were read; `None` before the first time.
    breaks: Option<usize>,
    /// Group of each particle; groups have the order of their lowest particles.
    numbers: Vec<u32>,
    count: usize,
}

impl Groups {
    /// Reads the groups anew if bonds have broken since the last time.
    fn update(
        &mut self,
        particles: usize,
        pairs: &[[u32; 2]],
        breaks: usize,
        is_broken: impl Fn(usize) -> bool,
    ) {
        if self.breaks == Some(breaks) {
            return;
        }
        let whole = pairs.iter().enumerate().filter(|(k, _)| !is_broken(*k));
        self.numbers = lowest_connected(particles, whole.map(|(_, p)| *p));
        self.count = 0;
        for i in 0..particles {
            // The lowest particle comes first, so that its entry is a number already.
            let lowest = self.numbers[i] as usize;
            self.numbers[i] = match lowest == i {
                true => self.count as u32,
                false => self.numbers[lowest],
            };
            self.count += usize::from(lowest == i);
        }
        self.breaks = Some(breaks);
    }
}

/// Gathers `x`, with `components` numbers per particle of this rank, for all particles: on rank 0 if the
/// model is partitioned (`None` elsewhere). Collective.
fn gather_on_first<'a>(
    s: &Subdomain<f64>,
    components: usize,
    x: &'a [f64],
) -> Result<Option<Cow<'a, [f64]>>> {
    s.owned().gather(components, x).map_err(core("ranks"))
}

/// The fragments of all models whose bonds can break.
#[derive(Debug, Default)]
pub struct Fragments {
    bodies: Vec<Body>,
    /// Fragments found so far.
    pub rows: Vec<Piece>,
}

/// Sums over the particles of a fragment.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    particles: usize,
    mass: f64,
    /// Mass that is awake, and its first moment and momentum: what sleeps does not move with the body.
    awake: f64,
    place: [f64; 3],
    momentum: [f64; 3],
}

impl Sums {
    fn add(&mut self, other: &Self) {
        self.particles += other.particles;
        self.mass += other.mass;
        self.awake += other.awake;
        for c in 0..3 {
            self.place[c] += other.place[c];
            self.momentum[c] += other.momentum[c];
        }
    }

    fn piece(&self, time: f64, model: &str, number: usize) -> Piece {
        Piece {
            time,
            model: model.to_owned(),
            number,
            particles: self.particles,
            mass: self.mass,
            centre: self.place.map(|x| x / self.awake),
            velocity: self.momentum.map(|p| p / self.awake),
        }
    }
}

impl Fragments {
    /// Prepares the models whose bonds can break. Collective.
    pub(crate) fn new(run: &Coupled<f64>, models: &[ModelInfo]) -> Result<Self> {
        let mut bodies = Vec::new();
        for (number, (s, info)) in run.subdomains().iter().zip(models).enumerate() {
            let model = s.model();
            let Some(breaks) = info.breaks.clone().filter(|_| model.views().links.is_some()) else {
                continue;
            };
            let mut inertia = vec![0.0; model.layout().dofs()];
            let weighed = model.lumped_inertia(&Uniform(1.0), &mut inertia);
            weighed.map_err(core(format!("model.{}", model.name())))?;
            let d = model.layout().components;
            let masses = inertia[..model.layout().translations()].iter().step_by(d);
            let masses: Vec<f64> = masses.copied().collect();
            bodies.push(Body {
                number,
                breaks,
                grid: info.grid.clone(),
                masses: gather_on_first(s, 1, &masses)?.unwrap_or_default().into_owned(),
                fragments: Groups::default(),
            });
        }
        Ok(Self {
            bodies,
            rows: Vec::new(),
        })
    }

    /// Finds the fragments at the present time and appends them to `rows`. Collective.
    pub(crate) fn look(&mut self, run: &Coupled<f64>) -> Result<()> {
        // A run that goes on from its last instant finds them there a second time.
        self.rows.retain(|r| r.time < run.time());
        for b in &mut self.bodies {
            let s = &run.subdomains()[b.number];
            let moving = s.model().layout().translations();
            let q = gather_on_first(s, 3, &s.state().q[..moving])?;
            let v = gather_on_first(s, 3, &s.state().v[..moving])?;
            let (Some(q), Some(v)) = (q, v) else { continue };
            let pairs = b.grid.connectivity.as_chunks().0;
            let log = locked(&b.breaks);
            let is_broken = |k: usize| log.is_broken(k);
            b.fragments
                .update(b.masses.len(), pairs, log.events().len(), is_broken);
            // Only models that are whole on one rank can sleep.
            let can_sleep = s.has_sleep();
            let sleeps = |i: usize| can_sleep && s.is_asleep(i);
            let mut sums = vec![Sums::default(); b.fragments.count];
            for (i, x) in b.grid.points.iter().enumerate() {
                let m = if sleeps(i) { 0.0 } else { b.masses[i] };
                sums[b.fragments.numbers[i] as usize].add(&Sums {
                    particles: 1,
                    mass: b.masses[i],
                    awake: m,
                    place: [0, 1, 2].map(|c| m * (x[c] + q[3 * i + c])),
                    momentum: [0, 1, 2].map(|c| m * v[3 * i + c]),
                });
            }
            let (mut pieces, mut dust) = (Vec::new(), Sums::default());
            for s in sums.iter().filter(|s| s.awake > 0.0) {
                if s.particles == 1 {
                    dust.add(s);
                } else {
                    pieces.push(*s);
                }
            }
            pieces.sort_by(|a, b| b.mass.total_cmp(&a.mass));
            let (time, name) = (run.time(), s.model().name());
            let listed = pieces.iter().take(MOST).enumerate();
            self.rows.extend(listed.map(|(k, s)| s.piece(time, name, k + 1)));
            if dust.particles > 0 {
                self.rows.push(dust.piece(time, name, 0));
            }
        }
        Ok(())
    }
}

/// Returns the number of particles, the model and the centre \[m\] of the largest fragment that no support
/// holds and no overlap ties.
pub(crate) fn loose(run: &Coupled<f64>, breaks: &[Option<SharedLog>]) -> Option<(usize, String, [f64; 3])> {
    let mut largest = None;
    for (s, log) in run.subdomains().iter().zip(breaks) {
        let (Some(links), Some(log)) = (s.model().views().links, log) else {
            continue;
        };
        let (log, layout, nodes) = (locked(log), s.model().layout(), s.model().nodes());
        let whole = links
            .pairs()
            .iter()
            .enumerate()
            .filter(|(k, _)| !log.is_broken(*k));
        let piece = lowest_connected(nodes.len(), whole.map(|(_, p)| *p));
        let mut sums = vec![(0, [0.0; 3]); nodes.len()];
        for (i, x) in nodes.iter().enumerate() {
            let (count, sum) = &mut sums[piece[i] as usize];
            *count += 1;
            (0..3).for_each(|c| sum[c] += x[c] + s.state().q[3 * i + c]);
        }
        let held = s
            .supports()
            .iter()
            .flat_map(|m| &m.dofs)
            .map(|d| layout.node_of(*d));
        let weight = &s.weights().internal;
        let tied = (0..nodes.len()).filter(|i| weight.value(&nodes[*i]) < 1.0);
        // A count of zero takes fragments out that are held or tied.
        held.chain(tied).for_each(|i| sums[piece[i] as usize].0 = 0);
        let most = sums.into_iter().max_by_key(|s| s.0)?;
        if most.0 > largest.as_ref().map_or(0, |l: &(usize, _, _)| l.0) {
            let middle = most.1.map(|x| x / most.0 as f64);
            largest = Some((most.0, s.model().name().to_owned(), middle));
        }
    }
    largest
}

/// Writes the table of fragments if a model can break.
pub(crate) fn write(folder: &Path, fragments: &Fragments) -> Result<()> {
    if fragments.bodies.is_empty() {
        return Ok(());
    }
    let mut text = "time [s],model,fragment [-],particles [-],mass [kg],x [m],y [m],z [m],velocity x [m/s],velocity y [m/s],\
                    velocity z [m/s]\n"
        .to_owned();
    for p in &fragments.rows {
        let _ = write!(
            text,
            "{:e},{},{},{},{:e}",
            p.time, p.model, p.number, p.particles, p.mass
        );
        for x in p.centre.iter().chain(&p.velocity) {
            let _ = write!(text, ",{x:e}");
        }
        text.push('\n');
    }
    put(&folder.join(mark::FRAGMENTS), &[text.as_bytes()])
}

#[cfg(test)]
mod tests {
    use super::Groups;

    #[test]
    fn groups_have_the_order_of_their_lowest_particles_and_change_with_the_number_of_breaks() {
        let (pairs, mut groups) = ([[4, 0], [2, 1], [3, 2], [0, 5]], Groups::default());
        let numbers = |groups: &Groups| (groups.numbers.clone(), groups.count);
        groups.update(6, &pairs, 0, |_| false);
        let whole = (vec![0, 1, 1, 1, 0, 0], 2);
        assert_eq!(numbers(&groups), whole);
        groups.update(6, &pairs, 0, |k| k == 1);
        assert_eq!(numbers(&groups), whole, "nothing broke");
        groups.update(6, &pairs, 1, |k| k == 1);
        assert_eq!(numbers(&groups), (vec![0, 1, 2, 2, 0, 0], 3));
    }
}
