//! Relaxation of soft spheres: linear repulsion, walls as springs, FIRE (Bitzek et al. 2006).
//!
//! Stiffness and mass are one: `F = overlap`, in m. Every particle gathers its own forces from a Verlet list
//! that stores both directions of a pair, and sums are taken in chunks of fixed size and order. The path is
//! therefore bit-identical for any number of threads.

use super::cells::{self, CHUNK, CellList, ListChunk, Sphere, image, verlet_list};
use super::contacts::{Contacts, Overlaps};
use super::container::Container;
use super::near::WallList;
use crate::error::Result;
use arlequin_core::interrupt;
use rayon::prelude::*;

/// Largest FIRE step: half the stability limit of a sphere with a dozen contacts.
const STEP_MAX: f64 = 0.55;
/// First FIRE step.
const STEP_FIRST: f64 = 0.1;
/// Number of steps between reports of progress.
const WATCHED_STEPS: usize = 32;
/// Mixing factor of FIRE at the start and after each restart (Bitzek et al.).
const MIX: f64 = 0.1;

/// Sums over all spheres of one force evaluation, and the largest squared displacement since the list was
/// made.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Sums {
    power: f64,
    speed2: f64,
    force2: f64,
    overlap: f64,
    contacts: u64,
    moved2: f64,
}

impl Sums {
    fn add(self, o: Self) -> Self {
        Self {
            power: self.power + o.power,
            speed2: self.speed2 + o.speed2,
            force2: self.force2 + o.force2,
            overlap: self.overlap + o.overlap,
            contacts: self.contacts + o.contacts,
            moved2: self.moved2.max(o.moved2),
        }
    }
}

/// Outcome of a relaxation.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Relaxed {
    /// Mean overlap of touching pairs over the mean diameter.
    pub(crate) overlap: f64,
    /// Number of steps done.
    pub(crate) steps: usize,
}

/// Factors by which a step turns velocities towards the forces: `v <- keep v + pull F`.
#[derive(Debug, Clone, Copy, Default)]
struct Steer {
    keep: f64,
    pull: f64,
}

/// Soft spheres in a container.
pub(crate) struct SoftSpheres<'a> {
    container: &'a Container,
    pub(crate) spheres: Vec<Sphere>,
    listed: Vec<Sphere>,
    velocity: Vec<[f64; 4]>,
    force: Vec<[f64; 4]>,
    list: Vec<ListChunk>,
    walls: WallList,
    cells: CellList,
    sums: Vec<Sums>,
    mean_radius: f64,
    skin: f64,
    slack: f64,
    /// True once the user has asked to stop.
    interrupted: bool,
    /// Number of relaxation steps so far.
    steps: usize,
    /// Called with this number now and then.
    watch: &'a mut dyn FnMut(usize),
}

impl<'a> SoftSpheres<'a> {
    pub(crate) fn new(
        container: &'a Container,
        spheres: Vec<Sphere>,
        watch: &'a mut dyn FnMut(usize),
    ) -> Self {
        let n = spheres.len();
        let mean_radius = cells::mean_radius(&spheres);
        Self {
            container,
            listed: spheres.clone(),
            velocity: vec![[0.0; 4]; n],
            force: vec![[0.0; 4]; n],
            list: Vec::new(),
            walls: WallList::new(n),
            cells: CellList::new(container.period()),
            sums: vec![Sums::default(); n.div_ceil(CHUNK)],
            mean_radius,
            skin: 0.0,
            slack: 0.0,
            interrupted: false,
            steps: 0,
            watch,
            spheres,
        }
    }

    /// Refuses to continue after the user has interrupted a relaxation.
    ///
    /// # Errors
    /// [`arlequin_core::Error::Interrupted`].
    pub(crate) fn check_interrupt(&self) -> Result<()> {
        if !self.interrupted {
            return Ok(());
        }
        let during = format!("the packing of {} spheres", self.spheres.len());
        Err(arlequin_core::Error::Interrupted { during }.into())
    }

    /// Multiplies all radii by `factor`.
    pub(crate) fn scale_radii(&mut self, factor: f64) {
        self.walls.grow(&self.spheres, factor);
        self.spheres.iter_mut().for_each(|s| s[3] *= factor);
        self.mean_radius *= factor;
        // The list was made for smaller spheres, so its slack shrinks by the growth of two radii.
        let largest = self.spheres.iter().fold(0.0_f64, |m, s| m.max(s[3]));
        self.slack -= 2.0 * largest * (1.0 - 1.0 / factor).max(0.0);
    }

    fn renew_list(&mut self, skin: f64) {
        self.skin = skin;
        self.slack = skin;
        // Positions are wrapped only here: `advance` compares them with those of the list.
        if let Some(period) = self.container.period() {
            for s in &mut self.spheres {
                for a in 0..3 {
                    s[a] = s[a].rem_euclid(period[a]);
                }
            }
        }
        verlet_list(&mut self.cells, &self.spheres, skin, &mut self.list);
        // Two spheres that approach each other use up the skin together.
        let travel = 0.5 * skin * (1.0 + 1e-9);
        self.walls
            .renew(self.container, &self.spheres, &self.listed, travel);
        self.listed.clone_from(&self.spheres);
    }

    /// Relaxes from rest until forces balance to `balance` of the mean contact force, until overlaps stay
    /// below `loose` of the diameter (not jammed), until `max_steps` is reached, or until the user
    /// interrupts.
    pub(crate) fn relax(&mut self, max_steps: usize, loose: f64, balance: f64) -> Relaxed {
        let (mut dt, mut mix, mut downhill) = (STEP_FIRST, MIX, 0);
        self.velocity.iter_mut().for_each(|v| *v = [0.0; 4]);
        let mut skin = 0.4 * self.mean_radius;
        self.renew_list(skin);
        let mut since_list = 0;
        let mut overlap = 0.0;
        for step in 0..max_steps {
            self.interrupted = self.interrupted || interrupt::is_requested();
            if self.interrupted {
                return Relaxed { overlap, steps: step };
            }
            let s = self.forces();
            let contact = s.overlap / s.contacts.max(1) as f64;
            overlap = contact / (2.0 * self.mean_radius);
            let rms = (s.force2 / self.spheres.len() as f64).sqrt();
            if overlap < loose && rms < loose * self.mean_radius || rms <= balance * contact {
                return Relaxed { overlap, steps: step };
            }
            let steer = if s.power > 0.0 {
                downhill += 1;
                // FIRE: accelerate only after some steps downhill, and start anew as soon as the motion goes
                // uphill.
                if downhill > 5 {
                    dt = (dt * 1.1).min(STEP_MAX);
                    mix *= 0.99;
                }
                Steer {
                    keep: 1.0 - mix,
                    pull: mix * (s.speed2 / s.force2.max(f64::MIN_POSITIVE)).sqrt(),
                }
            } else {
                downhill = 0;
                dt *= 0.5;
                mix = MIX;
                Steer::default()
            };
            let moved = self.advance(dt, steer);
            self.steps += 1;
            if self.steps.is_multiple_of(WATCHED_STEPS) {
                (self.watch)(self.steps);
            }
            since_list += 1;
            // Both spheres of a pair may have moved by `moved` towards each other.
            if 2.0 * moved > self.slack {
                // A calm packing moves little between lists. A thinner skin then has fewer pairs to test.
                if since_list > 40 {
                    skin = (0.7 * skin).max(0.05 * self.mean_radius);
                } else if since_list < 16 {
                    skin = (1.4 * skin).min(1.2 * self.mean_radius);
                }
                since_list = 0;
                self.renew_list(skin);
            }
        }
        Relaxed {
            overlap,
            steps: max_steps,
        }
    }

    /// Computes the forces on all particles and returns their sums.
    fn forces(&mut self) -> Sums {
        let (spheres, container) = (&self.spheres, self.container);
        let period = container.period();
        let work = self.force.par_chunks_mut(CHUNK).zip(&self.list);
        let work = work.zip(&self.walls.chunks).zip(&mut self.sums);
        let velocity = &self.velocity;
        let arch = pulp::Arch::new();
        work.enumerate().for_each(|(c, (((force, list), walls), sums))| {
            let first = c * CHUNK;
            let mut overlaps = Overlaps::default();
            match &period {
                None => arch.dispatch(Contacts {
                    spheres,
                    first,
                    list,
                    image: |d| d,
                    force: &mut *force,
                    overlaps: &mut overlaps,
                }),
                Some(p) => arch.dispatch(Contacts {
                    spheres,
                    first,
                    list,
                    image: |[x, y, z, r]: [f64; 4]| {
                        let [x, y, z] = image([x, y, z], p);
                        [x, y, z, r]
                    },
                    force: &mut *force,
                    overlaps: &mut overlaps,
                }),
            }
            walls.add_forces(container, &spheres[first..first + force.len()], force);
            let mut total = Sums {
                overlap: overlaps.sum,
                contacts: overlaps.count,
                ..Sums::default()
            };
            for (f, v) in force.iter().zip(&velocity[first..]) {
                total.power += f[0] * v[0] + f[1] * v[1] + f[2] * v[2];
                total.speed2 += v[0] * v[0] + v[1] * v[1] + v[2] * v[2];
                total.force2 += f[0] * f[0] + f[1] * f[1] + f[2] * f[2];
            }
            *sums = total;
        });
        self.sums.iter().fold(Sums::default(), |a, b| a.add(*b))
    }

    /// Does `v <- keep v + pull F + dt F`, `x <- x + dt v`; returns the largest distance moved since the list
    /// was made.
    fn advance(&mut self, dt: f64, steer: Steer) -> f64 {
        let push = steer.pull + dt;
        let cap = 0.1 * self.mean_radius;
        let work = self
            .spheres
            .par_chunks_mut(CHUNK)
            .zip(self.velocity.par_chunks_mut(CHUNK))
            .zip(self.force.par_chunks(CHUNK))
            .zip(self.listed.par_chunks(CHUNK))
            .zip(&mut self.sums);
        let arch = pulp::Arch::new();
        work.for_each(|((((x, v), f), listed), sums)| {
            let mut largest = 0.0;
            arch.dispatch(Advance {
                dt,
                keep: steer.keep,
                push,
                cap,
                x,
                v,
                f,
                listed,
                moved2: &mut largest,
            });
            sums.moved2 = largest;
        });
        self.sums.iter().fold(0.0_f64, |m, s| m.max(s.moved2)).sqrt()
    }
}

/// Job that moves the spheres of a chunk. Entry 3 of velocity and force is zero, so that the radius stays and
/// a sphere fills four lanes.
struct Advance<'a> {
    dt: f64,
    /// Fraction of the velocity that stays.
    keep: f64,
    /// Factor of the force that is added.
    push: f64,
    /// Largest displacement per step and axis \[m\].
    cap: f64,
    x: &'a mut [Sphere],
    v: &'a mut [[f64; 4]],
    f: &'a [[f64; 4]],
    listed: &'a [Sphere],
    moved2: &'a mut f64,
}

impl pulp::NullaryFnOnce for Advance<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self {
            dt, keep, push, cap, ..
        } = self;
        let mut largest = 0.0;
        let spheres = self.x.iter_mut().zip(self.v).zip(self.f).zip(self.listed);
        for (((x, v), f), listed) in spheres {
            let mut d = [0.0; 4];
            for a in 0..4 {
                v[a] = keep * v[a] + push * f[a];
                let step = dt * v[a];
                // Without the cap, large overlaps of the random start would shoot particles through each
                // other.
                let step = if step < cap { step } else { cap };
                let step = if step > -cap { step } else { -cap };
                x[a] += step;
                d[a] = x[a] - listed[a];
            }
            let moved = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
            largest = if moved > largest { moved } else { largest };
        }
        *self.moved2 = largest;
    }
}
