//! The particles of one model with the data that contacts need.

use super::body::ContactBody;
use super::gathered::{self, ContactData};
use super::sparse::Sparse;
use crate::packing::cells::Sphere;
use arlequin_core::Owned;
use arlequin_core::contact::{End, Twist};
use arlequin_core::effect::{Host, Instant};
use nalgebra::Vector3;
use rayon::prelude::*;
use std::sync::Arc;

/// Particles per unit of parallel work.
const CHUNK: usize = 2_048;

/// Particles with their positions, masses, and the forces of one effect on them.
#[derive(Debug)]
pub(crate) struct Grains {
    pub(crate) rest_spheres: Arc<Vec<Sphere>>,
    pub(crate) now: Vec<Sphere>,
    /// Unweighted masses \[kg\].
    unweighted_mass: Arc<Vec<f64>>,
    mass: Vec<f64>,
    /// Inverse rotational inertia of particles that may turn \[1/(kg m²)\].
    inverse_moment: Vec<f64>,
    /// A bit for each unknown of a particle that does not move: its inverse inertia is zero.
    held: Vec<u8>,
    /// Forces of the effect so far in this step, on particles that it has pushed.
    forces: Sparse<[f64; 6]>,
}

impl Grains {
    /// Particles of a model at rest.
    pub(crate) fn new(body: ContactBody) -> Self {
        let rest_spheres = body.spheres.get();
        Self {
            now: rest_spheres.to_vec(),
            rest_spheres,
            unweighted_mass: body.mass,
            mass: Vec::new(),
            inverse_moment: Vec::new(),
            held: Vec::new(),
            forces: Sparse::default(),
        }
    }

    pub(crate) fn len(&self) -> usize {
        self.rest_spheres.len()
    }

    /// Keeps the particles of this rank's part of a partitioned body. [`Self::attach`] must then be given the
    /// part.
    ///
    /// # Errors
    /// A partition with another number of particles; `effect` is the effect's name in errors.
    pub(crate) fn restrict(&mut self, owned: &Owned, effect: &str) -> arlequin_core::Result<()> {
        let count = owned.nodes_of_whole();
        if count != self.len() {
            return Err(arlequin_core::Error::SizeMismatch {
                what: format!("particles of {effect}"),
                expected: self.len(),
                found: count,
            });
        }
        let numbers = || (0..owned.nodes()).map(|i| owned.global(i));
        self.rest_spheres = Arc::new(numbers().map(|i| self.rest_spheres[i]).collect());
        self.unweighted_mass = Arc::new(numbers().map(|i| self.unweighted_mass[i]).collect());
        // The part begins at rest, as the whole body did.
        self.now.clone_from(&self.rest_spheres);
        Ok(())
    }

    /// Contact data of particle `i` that is sent to other ranks.
    pub(super) fn contact_data(&self, i: usize) -> ContactData {
        let [x, y, z, r] = self.rest_spheres[i];
        let [a, b, c, d, e, f] = self.inverse_inertia(i);
        [
            x,
            y,
            z,
            r,
            self.unweighted_mass[i],
            self.mass[i],
            a,
            b,
            c,
            d,
            e,
            f,
        ]
    }

    /// Makes particles from received contact data.
    pub(crate) fn from_contact_data(data: &[ContactData]) -> Self {
        let (inverse_moment, held) =
            compressed(data.iter().map(|x| [6, 7, 8, 9, 10, 11].map(|k: usize| x[k])));
        Self {
            rest_spheres: Arc::new(data.iter().map(gathered::sphere).collect()),
            now: data.iter().map(gathered::sphere).collect(),
            unweighted_mass: Arc::new(data.iter().map(|x| x[4]).collect()),
            mass: data.iter().map(|x| x[5]).collect(),
            inverse_moment,
            held,
            forces: Sparse::new(data.len()),
        }
    }

    /// Inverse inertia of the unknowns of particle `i`; zero for those that do not move.
    fn inverse_inertia(&self, i: usize) -> [f64; 6] {
        let inverse = [self.inverse_mass(i), self.inverse_moment[i]];
        [0, 1, 2, 3, 4, 5].map(|c: usize| match self.held[i] >> c & 1 {
            1 => 0.0,
            _ => inverse[c / 3],
        })
    }

    /// Takes the weighted masses from the subdomain; `effect` is the effect's name in errors.
    pub(crate) fn attach(&mut self, host: &Host<'_, f64>, effect: &str) -> arlequin_core::Result<()> {
        let count = host.model.layout().nodes;
        if count != self.unweighted_mass.len() {
            return Err(arlequin_core::Error::SizeMismatch {
                what: format!("particles of {effect}"),
                expected: self.unweighted_mass.len(),
                found: count,
            });
        }
        self.mass = (0..count).map(|i| host.inertia[3 * i]).collect();
        let unknowns = (0..count).map(|i| self.unknowns(i));
        (self.inverse_moment, self.held) = compressed(unknowns.map(|o| o.map(|o| host.inverse_inertia[o])));
        self.forces = Sparse::new(count);
        Ok(())
    }

    /// Weighted over unweighted masses, to be compared after a change of weights.
    pub(crate) fn shares(&self) -> Vec<f64> {
        (0..self.len()).map(|i| self.share(i)).collect()
    }

    /// Particles whose share is larger than `before`, ascending.
    pub(crate) fn gained(&self, before: &[f64]) -> Vec<u32> {
        let gains = |i: &u32| self.share(*i as usize) > before[*i as usize];
        (0..before.len() as u32).filter(gains).collect()
    }

    /// Updates the current positions from the displacements in `q` \[m\].
    pub(crate) fn place(&mut self, q: &[f64]) {
        let n = self.now.len();
        let u = &q[..3 * n];
        let put = |(now, (rest_sphere, u)): (&mut Sphere, (&Sphere, &[f64; 3]))| {
            (0..3).for_each(|c| now[c] = rest_sphere[c] + u[c]);
        };
        // Two parts at least, or a second thread has nothing to do.
        if n > 2 * CHUNK && rayon::current_num_threads() > 1 {
            let moves = self.rest_spheres.par_iter().zip(u.as_chunks::<3>().0);
            self.now
                .par_iter_mut()
                .zip(moves)
                .with_min_len(CHUNK)
                .for_each(put);
        } else {
            let moves = self.rest_spheres.iter().zip(u.as_chunks::<3>().0);
            self.now.iter_mut().zip(moves).for_each(put);
        }
    }

    /// Updates the current position of particle `i` from the displacements in `q` \[m\].
    pub(crate) fn place_one(&mut self, i: usize, q: &[f64]) {
        let rest_sphere = &self.rest_spheres[i];
        (0..3).for_each(|c| self.now[i][c] = rest_sphere[c] + q[3 * i + c]);
    }

    /// Velocity and spin of particle `i` half a step ago.
    pub(crate) fn motion(&self, instant: &Instant<'_, f64>, i: usize) -> Twist {
        Twist {
            linear: three(instant.v_half, 3 * i),
            angular: three(instant.v_half, 3 * (self.len() + i)),
        }
    }

    /// Returns whether a particle has a weight; else it sleeps.
    pub(crate) fn is_awake(&self, i: u32) -> bool {
        self.mass[i as usize] > 0.0
    }

    /// Weighted over unweighted mass of particle `i`.
    pub(crate) fn share(&self, i: usize) -> f64 {
        self.mass[i] / self.unweighted_mass[i]
    }

    pub(crate) fn inverse_mass(&self, i: usize) -> f64 {
        1.0 / self.mass[i]
    }

    /// Velocities of particle `i` during the step, under the forces `f` of others and those of this effect so
    /// far.
    pub(crate) fn end(&self, instant: &Instant<'_, f64>, f: &[f64], i: usize) -> End {
        let place = self.unknowns(i);
        let (inverse_inertia, own) = (self.inverse_inertia(i), self.forces.get(i));
        // `v_half` is half a step back: half of the kick leads to the instant itself, all of it to half a
        // step later.
        let kick = |c: usize, others: f64| {
            let o = place[c];
            instant.v_half[o] + instant.dt * inverse_inertia[c] * (others * f[o] + own[c])
        };
        End {
            middle: [0, 1, 2, 3, 4, 5].map(|c| kick(c, 0.5)),
            after: [0, 1, 2, 3, 4, 5].map(|c| kick(c, 1.0)),
            inverse_inertia,
            ..End::default()
        }
    }

    pub(crate) fn unknowns(&self, i: usize) -> [usize; 6] {
        let (o, turn) = (3 * i, 3 * (self.len() + i));
        [o, o + 1, o + 2, turn, turn + 1, turn + 2]
    }

    /// Adds a force and a torque of this effect on particle `i`.
    pub(crate) fn push(&mut self, i: usize, force: &Vector3<f64>, torque: &Vector3<f64>) {
        let parts = force.iter().chain(torque.iter());
        let sum = self.forces.get_mut(i).iter_mut();
        sum.zip(parts).for_each(|(sum, x)| *sum += x);
    }

    /// Moves this effect's forces on particle `i` to `f`. A second call for the same particle adds nothing.
    pub(crate) fn deliver(&mut self, i: usize, f: &mut [f64]) {
        // Taken, so that a particle with several contacts gets the forces once.
        let force = self.forces.take(i);
        self.unknowns(i)
            .into_iter()
            .zip(force)
            .for_each(|(o, x)| f[o] += x);
    }

    /// Largest `stiffness(r_i)/m_i` over all particles \[1/s²\], with unweighted masses.
    pub(crate) fn top(&self, stiffness: impl Fn(f64) -> f64) -> f64 {
        // Unweighted: a contact carries the smaller share of its two ends, so weights only lower the ratio.
        let ratios = self
            .rest_spheres
            .iter()
            .zip(self.unweighted_mass.iter())
            .map(|(s, m)| stiffness(s[3]) / m);
        ratios.fold(0.0, f64::max)
    }

    /// Largest radius \[m\].
    pub(crate) fn largest(&self) -> f64 {
        self.rest_spheres.iter().fold(0.0, |m, s| m.max(s[3]))
    }
}

/// Returns the inverse moment of every particle and a bit for each of its unknowns that is held, from the
/// inverse inertia of its unknowns: 9 bytes in place of 48, because a sphere has one mass and one moment.
fn compressed(inverse_inertia: impl Iterator<Item = [f64; 6]>) -> (Vec<f64>, Vec<u8>) {
    let held = |w: &[f64; 6]| (0..6).fold(0, |bits, c| bits | u8::from(w[c] <= 0.0) << c);
    inverse_inertia
        .map(|w| (w[3].max(w[4]).max(w[5]), held(&w)))
        .unzip()
}

/// Power \[W\] of a force and a torque on particle `i`.
pub(crate) fn power(v: &[f64], i: usize, force: &Vector3<f64>, torque: &Vector3<f64>) -> f64 {
    force.dot(&three(v, 3 * i)) + torque.dot(&three(v, v.len() / 2 + 3 * i))
}

/// Adds a force and a torque on particle `i` to the force array `f`.
pub(crate) fn add(f: &mut [f64], i: usize, force: &Vector3<f64>, torque: &Vector3<f64>) {
    let half = f.len() / 2;
    for c in 0..3 {
        f[3 * i + c] += force[c];
        f[half + 3 * i + c] += torque[c];
    }
}

pub(crate) fn three(x: &[f64], k: usize) -> Vector3<f64> {
    Vector3::new(x[k], x[k + 1], x[k + 2])
}
