//! Positions and radii of spheres from VTU files.

use crate::error::{Error, Result};
use crate::particles::check_spheres;
use crate::vtu::{Array, GHOSTS, Piece, Section, Vtu, bad};
use nalgebra::Vector3;
use std::io::Cursor;

/// Names under which radii are searched, in this order.
const NAMES: [&str; 6] = ["radius [m]", "radius", "Radius", "radii", "Radii", "r"];
/// Arrays of a run's frame that hold the displacements of its points and mark its broken bonds.
const STATE: [&str; 2] = ["displacement [m]", "broken [-]"];

/// Reads the points of all pieces as centres \[m\] and a point array as radii \[m\]: the array `radius`, or
/// without a name the first of `radius [m]`, `radius`, `Radius`, `radii`, `Radii` and `r`. It ignores cells,
/// and points that `vtkGhostType` assigns to another piece. A frame of a run has its spheres at rest and
/// their displacements beside them. It is refused if a sphere has moved or a bond is broken, because it would
/// be read as an unbroken body at rest.
///
/// # Errors
/// [`Error::BadFile`] if it is not VTU, [`Error::MissingArray`], [`Error::LengthMismatch`],
/// [`Error::NotAtRest`]; for bad spheres [`Error::NotFinite`], [`Error::BadRadius`], [`Error::RadiusRatio`].
pub fn read_vtu(bytes: &[u8], radius: Option<&str>) -> Result<(Vec<Vector3<f64>>, Vec<f64>)> {
    let (spheres, state) = spheres(bytes, radius)?;
    state.check()?;
    checked(&spheres)
}

/// Works like [`read_vtu`] on the contents of all pieces of a PVTU file. If all pieces have global numbers
/// (`GlobalIds`), the spheres are sorted by them, as a single file would have them.
///
/// # Errors
/// Errors of [`read_vtu`].
pub fn read_pieces<P: AsRef<[u8]>>(
    pieces: &[P],
    radius: Option<&str>,
) -> Result<(Vec<Vector3<f64>>, Vec<f64>)> {
    let (mut collected, mut state) = (Vec::new(), State::default());
    for piece in pieces {
        let (spheres, piece_state) = spheres(piece.as_ref(), radius)?;
        collected.extend(spheres);
        state.add(piece_state);
    }
    state.check()?;
    if collected.iter().all(|s| s.number.is_some()) {
        collected.sort_by_key(|s| s.number);
    }
    checked(&collected)
}

/// A sphere read from a point.
struct Sphere {
    /// Global number, if the file has it.
    number: Option<u64>,
    centre: Vector3<f64>,
    radius: f64,
}

/// Displacements and broken bonds of a frame.
#[derive(Debug, Clone, Copy, Default)]
struct State {
    /// Largest displacement \[m\].
    farthest: f64,
    broken: usize,
}

impl State {
    fn add(&mut self, other: Self) {
        self.farthest = self.farthest.max(other.farthest);
        self.broken += other.broken;
    }

    fn check(self) -> Result<()> {
        if self.farthest > 0.0 || self.broken > 0 {
            return Err(Error::NotAtRest {
                farthest: self.farthest,
                broken: self.broken,
            });
        }
        Ok(())
    }
}

fn checked(spheres: &[Sphere]) -> Result<(Vec<Vector3<f64>>, Vec<f64>)> {
    let (positions, radii): (Vec<_>, Vec<_>) = spheres.iter().map(|s| (s.centre, s.radius)).unzip();
    check_spheres(&positions, &radii)?;
    Ok((positions, radii))
}

fn spheres(bytes: &[u8], radius: Option<&str>) -> Result<(Vec<Sphere>, State)> {
    let mut file = Vtu::open(Cursor::new(bytes))?;
    let (mut out, mut state) = (Vec::new(), State::default());
    for piece in std::mem::take(&mut file.pieces) {
        let array = piece.section(Section::Points).next();
        let points = file.numbers(array.ok_or_else(|| bad("a piece has no points"))?)?;
        let radii = file.numbers(radius_array(&piece, radius)?)?;
        let mut read = |section: Section, name: &str| {
            let array = piece.find(section, name);
            array.map(|a| file.numbers(a)).transpose()
        };
        let moved = read(Section::PointData, STATE[0])?.unwrap_or_default();
        let broken = read(Section::CellData, STATE[1])?.unwrap_or_default();
        let ghosts = read(Section::PointData, GHOSTS)?;
        let numbers = piece.point_numbers.as_ref().map(|n| read(Section::PointData, n));
        let numbers = numbers.transpose()?.flatten();
        let count = points.len() / 3;
        for (what, found) in [
            ("radii", Some(radii.len())),
            ("ghost types", ghosts.as_ref().map(Vec::len)),
            ("global numbers", numbers.as_ref().map(Vec::len)),
        ] {
            if let Some(found) = found.filter(|n| *n != count || points.len() != 3 * count) {
                return Err(Error::LengthMismatch {
                    what,
                    found,
                    expected: count,
                });
            }
        }
        state.add(State {
            farthest: moved.iter().fold(0.0, |m, x| x.abs().max(m)),
            broken: broken.iter().filter(|b| **b > 0.0).count(),
        });
        for (k, (centre, radius)) in points.chunks_exact(3).zip(radii).enumerate() {
            if ghosts.as_ref().is_some_and(|g| g[k] as u8 & 1 == 1) {
                continue;
            }
            out.push(Sphere {
                number: numbers.as_ref().map(|n| n[k] as u64),
                centre: Vector3::from_column_slice(centre),
                radius,
            });
        }
    }
    Ok((out, state))
}

fn radius_array<'a>(piece: &'a Piece, wanted: Option<&str>) -> Result<&'a Array> {
    let arrays = || piece.section(Section::PointData);
    let named = |name: &str| arrays().find(|a| a.name == name && a.components == 1);
    let array = match wanted {
        Some(name) => named(name),
        None => NAMES.iter().find_map(|n| named(n)),
    };
    array.ok_or_else(|| {
        let names: Vec<&str> = arrays()
            .map(|a| a.name.as_str())
            .filter(|n| !n.is_empty())
            .collect();
        Error::MissingArray {
            wanted: wanted.map_or_else(|| NAMES.join(", "), ToOwned::to_owned),
            found: if names.is_empty() {
                "none".into()
            } else {
                names.join(", ")
            },
        }
    })
}
