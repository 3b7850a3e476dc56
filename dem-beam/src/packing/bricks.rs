//! Lattices for partitioned models, numbered such that a rank can make its owned particles without the rest.
//!
//! The cells are grouped in bricks of one unit (256 particles). Bricks are ordered along a Morton curve.
//! Particles in a brick are ordered by their number of bonds, so that the blocks of the kernel are full. A
//! rank holds the list of bricks and its owned particles.
//!
//! A place is counted in halves of a cell, so that corners, faces and middles of cells are whole numbers from
//! zero to twice the cells, exclusive.

use super::lattice::Lattice;
use crate::bond::BeamMaterial;
use crate::error::{Error, Result, positive};
use crate::kernel::layout::work;
use crate::kernel::order::morton_key;
use crate::model::Piece;
use arlequin_core::ranks::{Division, UNIT, Unit};
use nalgebra::{Point3, Vector3};
use std::collections::HashMap;

/// Place of a particle in halves of a cell.
type Place = [i32; 3];

/// A lattice of touching spheres in bricks: the body of [`super::lattice()`] with another numbering.
///
/// ```
/// use arlequin_core::ranks::Division;
/// use dem_beam::BeamMaterial;
/// use dem_beam::packing::{Bricks, Lattice};
/// let bricks = Bricks::new(Lattice::BodyCentred, [12, 8, 8], 1e-3)?;
/// let division = Division::bisect(bricks.particles(), &bricks.units(), 2).unwrap();
/// let piece = bricks.piece(&division, 0, BeamMaterial::SILICA, 2200.0)?;
/// let others = piece.numbers.iter().filter(|i| division.owner(**i as usize) != 0).count();
/// assert_eq!((bricks.particles(), piece.numbers.len() - others), (1536, 768));
/// assert!(others > 0 && others < 256);
/// # Ok::<(), dem_beam::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Bricks {
    kind: Lattice,
    cells: [i32; 3],
    radius: f64,
    /// Number of bricks along each axis.
    grid: [i32; 3],
    /// Bricks in their order, and the first particle number of each; `first` has one more entry, the number
    /// of particles.
    order: Vec<[i32; 3]>,
    first: Vec<u32>,
    /// Position in `order` of each brick of the grid.
    order_index: Vec<u32>,
}

impl Bricks {
    /// Makes a lattice of touching spheres of radius `radius` \[m\], with `cells` cells along each axis,
    /// bonded to their nearest neighbours.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for no cells, a radius that is not positive, or more particles than 32 bits can
    /// number.
    pub fn new(kind: Lattice, cells: [usize; 3], radius: f64) -> Result<Self> {
        positive("sphere radius", radius)?;
        let per_cell = kind.basis().len();
        let count = cells.iter().fold(per_cell as f64, |n, c| n * *c as f64);
        if !(count >= 1.0 && count < f64::from(u32::MAX)) {
            return Err(Error::out_of_range(
                "particles of a lattice",
                count,
                "1 to 4294967294",
            ));
        }
        let cells = cells.map(|c| c as i32);
        let edges = Self::edges(kind);
        let grid: [i32; 3] = std::array::from_fn(|a| (cells[a] + edges[a] - 1) / edges[a]);
        let along = |a: usize| 0..grid[a];
        let mut order: Vec<[i32; 3]> = along(0)
            .flat_map(|i| along(1).flat_map(move |j| (0..grid[2]).map(move |k| [i, j, k])))
            .collect();
        let extent = Vector3::from(grid.map(|g| f64::from(g * edges.iter().max().unwrap_or(&1))));
        let middle = |b: &[i32; 3]| Vector3::from_fn(|a, _| (f64::from(b[a]) + 0.5) * f64::from(edges[a]));
        order.sort_by_cached_key(|b| morton_key(&middle(b), &Vector3::zeros(), &extent));
        let mut out = Self {
            kind,
            cells,
            radius,
            grid,
            order,
            first: vec![0],
            order_index: Vec::new(),
        };
        out.order_index = vec![0; out.order.len()];
        let mut next = 0;
        for (k, brick) in out.order.iter().enumerate() {
            let [low, high] = out.corners(brick);
            next += (0..3).map(|a| (high[a] - low[a]) as u32 / 2).product::<u32>() * per_cell as u32;
            out.first.push(next);
            let cell = out.index(brick);
            out.order_index[cell] = k as u32;
        }
        Ok(out)
    }

    /// Returns the cells along the edges of a brick of 256 particles.
    fn edges(kind: Lattice) -> [i32; 3] {
        match kind {
            Lattice::Cubic => [8, 8, 4],
            Lattice::BodyCentred => [8, 4, 4],
            Lattice::FaceCentred => [4, 4, 4],
        }
    }

    /// Number of particles of the whole body.
    #[must_use]
    pub fn particles(&self) -> usize {
        self.first.last().map_or(0, |n| *n as usize)
    }

    /// Returns the edge of a cell \[m\].
    fn edge(&self) -> f64 {
        2.0 * self.radius / self.kind.spacing()
    }

    /// Volume of the whole body, the box of the cells \[m³\].
    #[must_use]
    pub fn volume(&self) -> f64 {
        self.cells.iter().map(|c| f64::from(*c) * self.edge()).product()
    }

    /// Returns the centre of a particle \[m\].
    fn centre(&self, place: &Place) -> Vector3<f64> {
        Vector3::from(place.map(|c| self.edge() * (0.5 * f64::from(c))))
    }

    /// Units of the whole body, for a [`Division`].
    #[must_use]
    pub fn units(&self) -> Vec<Unit> {
        let mut out = Vec::with_capacity(self.particles().div_ceil(UNIT));
        let mut pending: Vec<Place> = Vec::new();
        for brick in &self.order {
            pending.extend(self.places(brick));
            // Bricks at the far faces may be incomplete, so that units can span several bricks.
            let complete = pending.len() / UNIT * UNIT;
            out.extend(
                pending
                    .drain(..complete)
                    .as_slice()
                    .chunks(UNIT)
                    .map(|u| self.unit(u)),
            );
        }
        out.extend(pending.chunks(UNIT).map(|u| self.unit(u)));
        out
    }

    fn unit(&self, places: &[Place]) -> Unit {
        let sum: Vector3<f64> = places.iter().map(|p| self.centre(p)).sum();
        let bonds: Vec<usize> = places.iter().map(|p| self.neighbours(p).count()).collect();
        Unit {
            centre: Point3::from(sum / places.len() as f64),
            work: work(&bonds) as f64,
        }
    }

    /// Returns the description of a rank's part of the body for [`crate::DemModel::of_piece`].
    ///
    /// # Errors
    /// [`Error::LengthMismatch`] for a division of another body; [`Error::OutOfRange`] for a density that
    /// is not positive.
    pub fn piece(&self, division: &Division, rank: usize, beam: BeamMaterial, density: f64) -> Result<Piece> {
        positive("density", density)?;
        if division.nodes() != self.particles() {
            return Err(Error::LengthMismatch {
                what: "particles of the division",
                found: division.nodes(),
                expected: self.particles(),
            });
        }
        let is_owned = |i: u32| division.owner(i as usize) == rank;
        let (mut numbers, mut positions, mut ghosts) = (Vec::new(), Vec::new(), Vec::new());
        let (mut pairs, mut numbering) = (Vec::new(), Numbering::new(self));
        for unit in division.units_of(rank) {
            let first = unit * UNIT as u32;
            let last = (first + UNIT as u32).min(self.particles() as u32);
            for i in first..last {
                let place = numbering.place(i);
                numbers.push(i);
                positions.push(self.centre(&place));
                for neighbour in self.neighbours(&place) {
                    let j = numbering.number(&neighbour);
                    // A bond between two owned particles is listed once, by the smaller number.
                    if !is_owned(j) {
                        ghosts.push((j, neighbour));
                    } else if j < i {
                        continue;
                    }
                    pairs.push([i.min(j), i.max(j)]);
                }
            }
        }
        ghosts.sort_unstable();
        ghosts.dedup();
        for (j, place) in &ghosts {
            numbers.push(*j);
            positions.push(self.centre(place));
        }
        let volume = self.volume() / self.particles() as f64;
        Ok(Piece {
            radii: vec![self.radius; numbers.len()],
            volumes: vec![volume; numbers.len()],
            numbers,
            positions,
            pairs,
            mean_radius: self.radius,
            beam,
            density,
        })
    }

    /// Returns the lowest place of a brick, and the place behind its last one along each axis.
    fn corners(&self, brick: &[i32; 3]) -> [Place; 2] {
        let edges = Self::edges(self.kind);
        let low = std::array::from_fn(|a| 2 * brick[a] * edges[a]);
        let high = std::array::from_fn(|a| 2 * self.cells[a].min((brick[a] + 1) * edges[a]));
        [low, high]
    }

    fn index(&self, [i, j, k]: &[i32; 3]) -> usize {
        ((i * self.grid[1] + j) * self.grid[2] + k) as usize
    }

    fn is_particle(&self, [x, y, z]: &Place) -> bool {
        match self.kind {
            Lattice::Cubic => (x | y | z) & 1 == 0,
            Lattice::BodyCentred => (x ^ y) & 1 == 0 && (y ^ z) & 1 == 0,
            Lattice::FaceCentred => (x + y + z) & 1 == 0,
        }
    }

    /// Returns the particles bonded with the particle at `place`.
    fn neighbours(&self, place: &Place) -> impl Iterator<Item = Place> {
        let (cells, [x, y, z]) = (self.cells, *place);
        let shifts = match self.kind {
            Lattice::Cubic => &CUBIC[..],
            Lattice::BodyCentred => &BODY_CENTRED[..],
            Lattice::FaceCentred => &FACE_CENTRED[..],
        };
        let neighbours = shifts.iter().map(move |[i, j, k]| [x + i, y + j, z + k]);
        neighbours.filter(move |p| (0..3).all(|a| (0..2 * cells[a]).contains(&p[a])))
    }

    /// Returns the particles of a brick in their order: by number of bonds, then along a Morton curve.
    fn places(&self, brick: &[i32; 3]) -> Vec<Place> {
        let [low, high] = self.corners(brick);
        let along = |a: usize| low[a]..high[a];
        let candidates =
            along(0).flat_map(|x| along(1).flat_map(move |y| (low[2]..high[2]).map(move |z| [x, y, z])));
        let mut out: Vec<Place> = candidates.filter(|p| self.is_particle(p)).collect();
        let key = |p: &Place| {
            let x = Vector3::from(p.map(f64::from));
            let [lowest, highest] = [low, high].map(|c| Vector3::from(c.map(f64::from)));
            (self.neighbours(p).count(), morton_key(&x, &lowest, &highest))
        };
        out.sort_by_cached_key(key);
        out
    }
}

const CUBIC: [Place; 6] = [
    [-2, 0, 0],
    [2, 0, 0],
    [0, -2, 0],
    [0, 2, 0],
    [0, 0, -2],
    [0, 0, 2],
];

const BODY_CENTRED: [Place; 8] = [
    [-1, -1, -1],
    [-1, -1, 1],
    [-1, 1, -1],
    [-1, 1, 1],
    [1, -1, -1],
    [1, -1, 1],
    [1, 1, -1],
    [1, 1, 1],
];

const FACE_CENTRED: [Place; 12] = [
    [-1, -1, 0],
    [-1, 1, 0],
    [1, -1, 0],
    [1, 1, 0],
    [-1, 0, -1],
    [-1, 0, 1],
    [1, 0, -1],
    [1, 0, 1],
    [0, -1, -1],
    [0, -1, 1],
    [0, 1, -1],
    [0, 1, 1],
];

/// Numbers and places of particles; a brick is worked out when it is first asked for.
struct Numbering<'a> {
    lattice: &'a Bricks,
    bricks: HashMap<u32, Ordered>,
}

/// The particles of a brick in their order, and the position in this order of each place in the box of the
/// brick.
struct Ordered {
    places: Vec<Place>,
    ranks: Vec<u16>,
}

impl<'a> Numbering<'a> {
    fn new(lattice: &'a Bricks) -> Self {
        Self {
            lattice,
            bricks: HashMap::new(),
        }
    }

    fn brick(&mut self, k: u32) -> &Ordered {
        let lattice = self.lattice;
        self.bricks.entry(k).or_insert_with(|| {
            let corners = lattice.corners(&lattice.order[k as usize]);
            let places = lattice.places(&lattice.order[k as usize]);
            let volume: i32 = (0..3).map(|a| corners[1][a] - corners[0][a]).product();
            let mut ranks = vec![0; volume as usize];
            (0..)
                .zip(&places)
                .for_each(|(rank, p)| ranks[index_in_box(&corners, p)] = rank);
            Ordered { places, ranks }
        })
    }

    fn place(&mut self, number: u32) -> Place {
        let k = self.lattice.first.partition_point(|first| *first <= number) - 1;
        let first = self.lattice.first[k];
        self.brick(k as u32).places[(number - first) as usize]
    }

    fn number(&mut self, place: &Place) -> u32 {
        let edges = Bricks::edges(self.lattice.kind);
        let brick = std::array::from_fn(|a| place[a] / (2 * edges[a]));
        let k = self.lattice.order_index[self.lattice.index(&brick)];
        let corners = self.lattice.corners(&brick);
        self.lattice.first[k as usize] + u32::from(self.brick(k).ranks[index_in_box(&corners, place)])
    }
}

/// Returns the index of a place in the box of its brick.
fn index_in_box([low, high]: &[Place; 2], p: &Place) -> usize {
    let d = |a: usize| high[a] - low[a];
    (((p[0] - low[0]) * d(1) + p[1] - low[1]) * d(2) + p[2] - low[2]) as usize
}
