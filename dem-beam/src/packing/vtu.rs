//! Positions and radii from VTU files (VTK's XML format for unstructured grids).

use crate::error::{DemError, Result};
use crate::particles::check_spheres;
use nalgebra::Vector3;
use vtkio::model::{Attribute, DataSet, IOBuffer, Piece, UnstructuredGridPiece};

/// Names under which radii are looked for, in this order.
const NAMES: [&str; 6] = ["radius [m]", "radius", "Radius", "radii", "Radii", "r"];

/// Reads the points of all pieces as centres (m) and a point array as radii (m): the one named
/// `radius`, or without a name the first of `radius [m]`, `radius`, `Radius`, `radii`, `Radii`
/// and `r`. Cells are not read. Text, base64 and raw data are understood, zlib as well.
///
/// # Errors
/// [`DemError::BadFile`] if it is no such file, [`DemError::MissingArray`], and those of bad
/// spheres: [`DemError::NotFinite`], [`DemError::BadRadius`], [`DemError::RadiusRatio`].
pub fn read_vtu(bytes: &[u8], radius: Option<&str>) -> Result<(Vec<Vector3<f64>>, Vec<f64>)> {
    let bad = |reason: String| DemError::BadFile {
        format: "VTU",
        reason,
    };
    let file = vtkio::Vtk::parse_xml(bytes).map_err(|e| bad(e.to_string()))?;
    let DataSet::UnstructuredGrid { pieces, .. } = file.data else {
        return Err(bad("it is not an unstructured grid".into()));
    };
    let (mut positions, mut radii) = (Vec::new(), Vec::new());
    for piece in pieces {
        let Piece::Inline(piece) = piece else {
            return Err(bad("its points are in other files; give one of those".into()));
        };
        let points = numbers(&piece.points).ok_or_else(|| bad("its points are not numbers".into()))?;
        let found = radius_array(&piece, radius)?;
        if points.len() != 3 * found.len() {
            return Err(DemError::LengthMismatch {
                what: "radii",
                found: found.len(),
                expected: points.len() / 3,
            });
        }
        positions.extend(points.chunks_exact(3).map(Vector3::from_column_slice));
        radii.extend(found);
    }
    check_spheres(&positions, &radii)?;
    Ok((positions, radii))
}

fn radius_array(piece: &UnstructuredGridPiece, wanted: Option<&str>) -> Result<Vec<f64>> {
    let array = |name: &str| {
        piece.data.point.iter().find_map(|a| match a {
            Attribute::DataArray(a) if a.name == name && a.num_comp() == 1 => numbers(&a.data),
            _ => None,
        })
    };
    let found = match wanted {
        Some(name) => array(name),
        None => NAMES.iter().find_map(|n| array(n)),
    };
    found.ok_or_else(|| {
        let have: Vec<&str> = piece.data.point.iter().map(Attribute::name).collect();
        DemError::MissingArray {
            wanted: wanted.map_or_else(|| NAMES.join(", "), ToOwned::to_owned),
            found: if have.is_empty() {
                "none".into()
            } else {
                have.join(", ")
            },
        }
    })
}

/// Any kind of number as f64.
fn numbers(buffer: &IOBuffer) -> Option<Vec<f64>> {
    match buffer {
        // Kept as they are: the general way goes through a checked conversion per number.
        IOBuffer::F64(x) => Some(x.clone()),
        other => other.cast_into::<f64>(),
    }
}
