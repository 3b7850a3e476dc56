//! A rank's part of a body that no rank ever holds as a whole.
//!
//! A rank is given its owned particles and the ghosts that their bonds reach, in numbers of the whole body.
//! It makes the same part, bit for bit, as [`DemModel::partition_among`] of the whole body. The ranks compute
//! together what depends on the whole body: the longest bond, which determines the grid of centres, and the
//! numbers of the bonds.

use super::DemModel;
use super::lazy::Kernel;
use super::portion::bonds_of_units;
use crate::bond::BeamMaterial;
use crate::error::{Error, Result, positive};
use crate::fracture::SharedLog;
use crate::numbered::Numbered;
use crate::particles::{BondedParticles, Contents, Extents, check_spheres, expect_len, longest};
use arlequin_core::ranks::{self, Communicator, Division, Halo, Message, RankError, Reduction, UNIT};
use arlequin_core::{Exact, Owned, ParticleField};
use nalgebra::{Point3, Vector3};
use std::hash::{DefaultHasher, Hasher};
use std::sync::{Arc, OnceLock};

/// One rank's description of its part of a body: its owned particles, then the ghosts bonded with them.
///
/// Particles are numbered from zero over the whole body. [`UNIT`] consecutive particles should lie close
/// together, because the cost of forces and halo exchanges depends on it. [`crate::packing::Bricks`] makes
/// such a numbering for lattices.
#[derive(Debug, Clone)]
pub struct Piece {
    /// Numbers of the particles in the whole body: first the owned particles, ascending, all units of this
    /// rank; then the ghosts in any order.
    pub numbers: Vec<u32>,
    /// Centres \[m\], in the order of `numbers`.
    pub positions: Vec<Vector3<f64>>,
    /// Radii \[m\].
    pub radii: Vec<f64>,
    /// Volume that each particle stands for \[m³\].
    pub volumes: Vec<f64>,
    /// All bonds of the owned particles, in numbers of the whole body.
    pub pairs: Vec<[u32; 2]>,
    /// Mean radius of all particles of the body \[m\], the same on every rank.
    pub mean_radius: f64,
    /// Material of the beams.
    pub beam: BeamMaterial,
    /// Mass density \[kg/m³\].
    pub density: f64,
}

/// Numbers sent per particle: centre, radius and volume.
const SENT: usize = 5;

impl DemModel {
    /// Makes this rank's part of a partitioned body from `piece`, the description of that part alone. The
    /// result equals that of [`Self::partition_among`] of the whole body and obeys the same rules;
    /// interfaces need the whole body and are refused. Collective.
    ///
    /// # Errors
    /// Errors of [`BondedParticles::new`], with numbers of the whole body; [`Error::LengthMismatch`] and
    /// [`Error::OutOfRange`] for particles other than those of the division.
    /// [`arlequin_core::ranks::RankError`], as an error of the core, if ranks disagree about the body or
    /// about each other's particles and bonds, and for errors of the transport.
    pub fn of_piece(
        name: &str,
        piece: Piece,
        division: &Division,
        communicator: Arc<dyn Communicator>,
    ) -> Result<Self> {
        let rank_error = |e: RankError| Error::Core(arlequin_core::Error::Rank(e));
        let owned = Owned::divided(division.clone(), communicator.clone())?;
        let piece = piece.checked(&owned)?;
        let what = "the body of particles that they make parts of";
        ranks::agree(&*communicator, what, piece.digest(division)).map_err(rank_error)?;
        let halo = Halo::of_links(&owned, piece.pairs.iter().copied());
        agree_on_bonds(&halo, &*communicator, &piece.pairs).map_err(rank_error)?;
        let piece = piece.with_ghosts_like(&halo);
        agree_on_ghosts(&halo, &*communicator, &piece).map_err(rank_error)?;
        let bonds = number_bonds(&halo, division, &*communicator, &piece.pairs).map_err(rank_error)?;
        let model = Self::from_ordered(name, piece, &halo, bonds);
        // An error of a sum over ranks is the cause of all others.
        owned.check_communication()?;
        model
    }

    /// Makes the model from particles in the order of the part and bonds in the order of the body.
    fn from_ordered(name: &str, piece: Piece, halo: &Halo, numbered: Numbered) -> Result<Self> {
        let owned = halo.owned().nodes();
        let Piece {
            numbers,
            positions,
            radii,
            volumes,
            mut pairs,
            mean_radius,
            beam,
            density,
        } = piece;
        // A search in sorted numbers needs no array over the whole body.
        let mut places: Vec<(u32, u32)> = numbers.iter().copied().zip(0..).collect();
        places.sort_unstable();
        for end in pairs.iter_mut().flatten() {
            let place = places.binary_search_by_key(end, |p| p.0);
            *end = place.map_or(u32::MAX, |place| places[place].1);
        }
        drop(places);
        let in_body = |e: Error| in_numbers(e, &numbers, &numbered.bonds);
        let longest = halo
            .owned()
            .largest(longest(&positions, &radii, &pairs).map_err(in_body)?);
        let contents = Contents {
            volumes: &volumes,
            // Every ghost has a bond, and `checked` has refused owned particles without bonds.
            loose: true,
            period: None,
            rounded: true,
            whole: Some(Extents { mean_radius, longest }),
        };
        let body = BondedParticles::with_volumes(positions, radii, pairs, density, beam, &contents)
            .map_err(in_body)?;
        let body = body.in_order_of_pairs();
        let nodes: Vec<Point3<f64>> = body.positions()[..owned]
            .iter()
            .map(|x| Point3::from(*x))
            .collect();
        let mut volume = Exact::zero();
        volumes[..owned].iter().for_each(|v| volume.add(*v));
        let [volume] = halo.owned().total([volume]);
        let mut order = numbers;
        order.truncate(owned);
        order.shrink_to_fit();
        Ok(Self {
            name: name.to_owned(),
            field: Arc::new(ParticleField::new(nodes.clone(), &volumes[..owned])?),
            nodes,
            mass: body.mass()[..owned].to_vec(),
            inertia: body.inertia()[..owned].to_vec(),
            order,
            places: Vec::new(),
            volume,
            kernel: Kernel::new(false),
            packing: None,
            fracture: None,
            watched: None,
            log: SharedLog::default(),
            bonds_by_particle: OnceLock::new(),
            unit_bonds: bonds_of_units(body.pairs(), owned),
            halo: Some(halo.clone()),
            numbered: Some(numbered),
            body,
        })
    }
}

impl Piece {
    /// Checks the part and sorts its bonds in the order of the whole body, each with its smaller number
    /// first.
    fn checked(mut self, ownership: &Owned) -> Result<Self> {
        let count = self.numbers.len();
        let particles = ownership.nodes_of_whole();
        expect_len("centres of a part", self.positions.len(), count)?;
        expect_len("volumes of a part", self.volumes.len(), count)?;
        let owned = ownership.nodes();
        let is_owned = |k: usize| self.numbers.get(k).map(|n| *n as usize) == Some(ownership.global(k));
        if !(0..owned).all(is_owned) {
            let matching = (0..owned).take_while(|k| is_owned(*k)).count();
            return Err(Error::LengthMismatch {
                what: "own particles of a part, in the order of its units",
                found: matching,
                expected: owned,
            });
        }
        if count > 0 {
            let in_body = |e: Error| in_numbers(e, &self.numbers, &[]);
            check_spheres(&self.positions, &self.radii).map_err(in_body)?;
        }
        positive("mean radius of a body", self.mean_radius)?;
        let mut sorted = self.numbers.clone();
        sorted.sort_unstable();
        if let Some(twice) = sorted.windows(2).find(|k| k[0] == k[1]) {
            return Err(Error::out_of_range(
                "number of a particle of a part",
                f64::from(twice[0]),
                "once in a part",
            ));
        }
        if let Some(beyond) = sorted.last().filter(|k| **k as usize >= particles) {
            return Err(Error::out_of_range(
                "number of a particle of a part",
                f64::from(*beyond),
                "numbers of the division",
            ));
        }
        let mut bonded = vec![false; owned];
        for (bond, pair) in self.pairs.iter_mut().enumerate() {
            pair.sort_unstable();
            let unknown = pair.iter().find(|i| sorted.binary_search(i).is_err());
            if let Some(i) = unknown {
                return Err(Error::NoSuchParticle {
                    bond,
                    particle: *i as usize,
                    count,
                });
            }
            let ends = pair.map(|i| ownership.local(i as usize));
            if ends == [None, None] {
                return Err(Error::out_of_range(
                    "bond of a part",
                    bond as f64,
                    "bonds with a particle of this rank",
                ));
            }
            ends.into_iter().flatten().for_each(|k| bonded[k] = true);
        }
        self.pairs.sort_unstable();
        self.pairs.dedup();
        if let Some(k) = bonded.iter().position(|b| !b) {
            let isolated = bonded.iter().filter(|b| !**b).count();
            return Err(Error::IsolatedParticle {
                particle: ownership.global(k),
                isolated,
            });
        }
        Ok(self)
    }

    /// Sorts the ghosts in the order of `halo`, behind the owned particles.
    fn with_ghosts_like(mut self, halo: &Halo) -> Self {
        let owned = halo.owned().nodes();
        let mut places: Vec<(u32, usize)> = self.numbers[owned..].iter().copied().zip(owned..).collect();
        places.sort_unstable();
        let find = |g: &u32| {
            places
                .binary_search_by_key(g, |p| p.0)
                .map_or(owned, |k| places[k].1)
        };
        let sources: Vec<usize> = halo.ghosts().iter().map(find).collect();
        fn arrange<X: Copy>(x: &mut Vec<X>, owned: usize, sources: &[usize]) {
            let behind: Vec<X> = sources.iter().map(|k| x[*k]).collect();
            x.truncate(owned);
            x.extend(behind);
            x.shrink_to_fit();
        }
        arrange(&mut self.numbers, owned, &sources);
        arrange(&mut self.positions, owned, &sources);
        arrange(&mut self.radii, owned, &sources);
        arrange(&mut self.volumes, owned, &sources);
        self
    }

    /// Hash of the values that must be the same on all ranks.
    fn digest(&self, division: &Division) -> u64 {
        let BeamMaterial {
            young,
            poisson,
            radius_ratio,
        } = self.beam;
        let mut hasher = DefaultHasher::new();
        for x in [self.mean_radius, self.density, young, poisson, radius_ratio] {
            hasher.write_u64(x.to_bits());
        }
        hasher.write_usize(division.nodes());
        (0..division.nodes())
            .step_by(UNIT)
            .for_each(|i| hasher.write_usize(division.owner(i)));
        hasher.finish()
    }

    fn values_to_send(&self, k: usize) -> [f64; SENT] {
        let x = self.positions[k];
        [x.x, x.y, x.z, self.radii[k], self.volumes[k]]
    }
}

/// Returns the error with the particle and bond numbers of the whole body instead of the part's.
fn in_numbers(mut error: Error, particles: &[u32], bonds: &[u32]) -> Error {
    let name = |numbers: &[u32], k: &mut usize| *k = numbers.get(*k).map_or(*k, |n| *n as usize);
    match &mut error {
        Error::BadRadius { particle, .. } => name(particles, particle),
        Error::NotFinite { index, .. } => name(particles, index),
        Error::CoincidentParticles { first, second, .. } => {
            name(particles, first);
            name(particles, second);
        }
        Error::ZeroLengthBond {
            bond, first, second, ..
        } => {
            name(bonds, bond);
            name(particles, first);
            name(particles, second);
        }
        _ => (),
    }
    error
}

/// Checks that ranks agree about the bonds between them: one side adds a hash of each bond, the other
/// subtracts it.
fn agree_on_bonds(
    halo: &Halo,
    communicator: &dyn Communicator,
    pairs: &[[u32; 2]],
) -> std::result::Result<(), RankError> {
    let mut sums = [0_i64; 2];
    for pair in pairs {
        let is_owned = pair.map(|i| halo.owned().local(i as usize).is_some());
        if is_owned[0] != is_owned[1] {
            let mut hasher = DefaultHasher::new();
            pair.iter().for_each(|i| hasher.write_u32(*i));
            // Sums of half words stay far from the limits of a 64-bit integer.
            let words = hasher.finish();
            let sign = if is_owned[0] { 1 } else { -1 };
            sums[0] += sign * (words >> 32).cast_signed();
            sums[1] += sign * (words & u64::from(u32::MAX)).cast_signed();
        }
    }
    communicator.reduce(&mut sums, Reduction::Sum)?;
    match sums {
        [0, 0] => Ok(()),
        _ => Err(RankError::Differ {
            rank: communicator.rank(),
            what: "the bonds between particles of different ranks".to_owned(),
        }),
    }
}

/// Checks that the ghosts of each rank equal the particles of their owners.
fn agree_on_ghosts(
    halo: &Halo,
    communicator: &dyn Communicator,
    piece: &Piece,
) -> std::result::Result<(), RankError> {
    let owned = halo.owned().nodes();
    // Every rank finishes the exchange before it reports, so that no rank waits for a message.
    let mut differing = None;
    halo.exchange::<SENT>(
        &mut halo.messages(SENT),
        |k| piece.values_to_send(k),
        |g, x| {
            if piece.values_to_send(owned + g).map(f64::to_bits) != x.map(f64::to_bits) {
                differing.get_or_insert(halo.ghosts()[g]);
            }
        },
    )?;
    let mut words = [differing.map_or(0, |g| i64::from(g) + 1)];
    communicator.reduce(&mut words, Reduction::Largest)?;
    match words[0] {
        0 => Ok(()),
        g => Err(RankError::Differ {
            rank: communicator.rank(),
            what: format!("the centre, the radius or the volume of particle {}", g - 1),
        }),
    }
}

/// Returns the numbers of the bonds in the whole body, counted in the order of their first particles.
fn number_bonds(
    halo: &Halo,
    division: &Division,
    communicator: &dyn Communicator,
    pairs: &[[u32; 2]],
) -> std::result::Result<Numbered, RankError> {
    let is_owned = |i: u32| halo.owned().local(i as usize).is_some();
    // Counts the bonds of each unit by their first particle, then the bonds of all units before it.
    let mut before = vec![0_i64; division.nodes().div_ceil(UNIT)];
    let firsts = pairs.iter().map(|p| p[0]).filter(|i| is_owned(*i));
    firsts.for_each(|i| before[i as usize / UNIT] += 1);
    communicator.reduce(&mut before, Reduction::Sum)?;
    let mut total = 0;
    for count in &mut before {
        total += *count;
        *count = total - *count;
    }
    let mut numbers = vec![0_u32; pairs.len()];
    for (number, [first, _]) in numbers.iter_mut().zip(pairs).filter(|(_, p)| is_owned(p[0])) {
        let next = &mut before[*first as usize / UNIT];
        *number = *next as u32;
        *next += 1;
    }
    // The owner of its first particle numbers a bond. Both ranks of a bond list it in the same order, so that
    // numbers can be sent without keys.
    let mut shared: Vec<(usize, usize)> = Vec::new();
    for (b, pair) in pairs.iter().enumerate() {
        let foreign = pair.iter().find(|i| !is_owned(**i));
        shared.extend(foreign.map(|i| (division.owner(*i as usize), b)));
    }
    shared.sort_unstable();
    let mut messages: Vec<Message> = Vec::new();
    for group in shared.chunk_by(|a, b| a.0 == b.0) {
        let numbered_here = group.iter().filter(|(_, b)| is_owned(pairs[*b][0]));
        let out: Vec<f64> = numbered_here.map(|(_, b)| f64::from(numbers[*b])).collect();
        let into = vec![0.0; group.len() - out.len()];
        messages.push(Message {
            peer: group[0].0,
            out,
            into,
        });
    }
    communicator.exchange(&mut messages)?;
    for (group, message) in shared.chunk_by(|a, b| a.0 == b.0).zip(&messages) {
        let numbered_by_peer = group.iter().filter(|(_, b)| !is_owned(pairs[*b][0]));
        numbered_by_peer
            .zip(&message.into)
            .for_each(|((_, b), n)| numbers[*b] = *n as u32);
    }
    Ok(Numbered {
        bonds: numbers.into(),
        total: total as usize,
    })
}
