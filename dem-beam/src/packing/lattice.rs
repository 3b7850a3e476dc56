//! Regular lattices of equal spheres, for tests and patch problems.

use super::assemble::{Filled, Packing};
use super::bonding::Bonding;
use super::container::Container;
use crate::error::{Error, Result, positive};
use nalgebra::Vector3;

/// Kind of lattice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Lattice {
    /// Simple cubic, 6 neighbours.
    Cubic,
    /// Body-centred cubic, 8 neighbours.
    BodyCentred,
    /// Face-centred cubic, 12 neighbours.
    FaceCentred,
}

impl Lattice {
    pub(super) fn basis(self) -> &'static [[f64; 3]] {
        match self {
            Self::Cubic => &[[0.0, 0.0, 0.0]],
            Self::BodyCentred => &[[0.0, 0.0, 0.0], [0.5, 0.5, 0.5]],
            Self::FaceCentred => &[[0.0, 0.0, 0.0], [0.5, 0.5, 0.0], [0.5, 0.0, 0.5], [0.0, 0.5, 0.5]],
        }
    }

    /// Returns the distance of neighbours over the edge of a cell.
    pub(super) fn spacing(self) -> f64 {
        match self {
            Self::Cubic => 1.0,
            Self::BodyCentred => 0.75_f64.sqrt(),
            Self::FaceCentred => 0.5_f64.sqrt(),
        }
    }
}

/// Makes a lattice of touching spheres of radius `radius` \[m\], with `cells` cells along each axis, bonded
/// to their nearest neighbours. It starts at the origin; the body is the box of the cells.
///
/// # Errors
/// [`Error::OutOfRange`] for no cells or a radius that is not positive.
///
/// ```
/// use dem_beam::packing::{Lattice, lattice};
/// let cube = lattice(Lattice::Cubic, [4, 4, 4], 1e-3)?;
/// assert_eq!((cube.radii.len(), cube.pairs.len()), (64, 3 * 4 * 4 * 3));
/// # Ok::<(), dem_beam::Error>(())
/// ```
pub fn lattice(kind: Lattice, cells: [usize; 3], radius: f64) -> Result<Packing> {
    positive("sphere radius", radius)?;
    if let Some(&none) = cells.iter().find(|&&c| c == 0) {
        return Err(Error::out_of_range("lattice cells", none as f64, "values >= 1"));
    }
    let edge = 2.0 * radius / kind.spacing();
    let mut spheres = Vec::new();
    for i in 0..cells[0] {
        for j in 0..cells[1] {
            for k in 0..cells[2] {
                for b in kind.basis() {
                    let cell = [i, j, k].map(|c| c as f64);
                    let x = [0, 1, 2].map(|a| edge * (cell[a] + b[a]));
                    spheres.push([x[0], x[1], x[2], radius]);
                }
            }
        }
    }
    let pairs = super::bonding::near_pairs(&spheres, 0.01, None);
    let mut pairs: Vec<[u32; 2]> = pairs.into_iter().map(|p| p.1).collect();
    pairs.sort_unstable();
    let size = Vector3::from(cells.map(|c| c as f64)) * edge;
    let container = Container::cuboid(Vector3::zeros(), size)?;
    let coordination = 2.0 * pairs.len() as f64 / spheres.len() as f64;
    let bonding = Bonding {
        retained: (0..spheres.len() as u32).collect(),
        pairs,
        tolerance: 0.0,
        coordination_all: coordination,
    };
    let filled = Filled {
        numbers: Vec::new(),
        bonding,
        overlap: 0.0,
        steps: 0,
        spheres,
    };
    let count = filled.spheres.len();
    Packing::assemble(
        &container,
        std::slice::from_ref(&container),
        &[filled],
        count,
        false,
    )
}
