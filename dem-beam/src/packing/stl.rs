//! Closed surfaces from STL files.

use super::surface::Surface;
use crate::error::{Error, Result, finite};
use nalgebra::Vector3;

/// Bytes before the triangles of a binary file: a comment and the number of triangles.
const HEAD: usize = 84;
/// Bytes per triangle of a binary file.
const TRIANGLE: usize = 50;

/// Reads the triangles of an STL file \[m\], text or binary. They need not be closed.
///
/// # Errors
/// [`Error::BadFile`] if it is not STL or has no triangle; [`Error::NotFinite`] coordinates.
pub fn read_facets(bytes: &[u8]) -> Result<Vec<[Vector3<f64>; 3]>> {
    let mesh = read(bytes)?;
    for (i, v) in mesh.vertices.iter().enumerate() {
        for k in 0..3 {
            finite("coordinate", "vertex", i, f64::from(v[k]))?;
        }
    }
    let corner = |i: usize| Vector3::from([0, 1, 2].map(|k| f64::from(mesh.vertices[i][k])));
    Ok(mesh.faces.iter().map(|f| f.vertices.map(corner)).collect())
}

fn read(bytes: &[u8]) -> Result<stl_io::IndexedMesh> {
    let bad = |reason: String| Error::BadFile {
        format: "STL",
        reason,
    };
    let mut bytes = bytes.to_vec();
    // Some programs begin the comment of a binary file with "solid", which marks a text file. If the length
    // fits a binary file, the first letter is overwritten.
    if let Some(number) = bytes.get(HEAD - 4..HEAD) {
        let count = u32::from_le_bytes([number[0], number[1], number[2], number[3]]);
        if bytes.len() as u64 == HEAD as u64 + TRIANGLE as u64 * u64::from(count) {
            bytes[0] = b' ';
        }
    }
    let mesh = stl_io::read_stl(&mut std::io::Cursor::new(bytes)).map_err(|e| bad(e.to_string()))?;
    if mesh.faces.is_empty() {
        return Err(bad("it has no triangle".into()));
    }
    Ok(mesh)
}

impl Surface {
    /// Reads STL, text or binary. The format has no unit: coordinates are taken in m. Corners are joined if
    /// they agree in every bit. Triangles are turned as in [`Self::oriented`]; normals in the file are
    /// ignored.
    ///
    /// # Errors
    /// [`Error::BadFile`] if it is not STL or has no triangle; errors of [`Self::oriented`].
    pub fn from_stl(bytes: &[u8]) -> Result<Self> {
        let mesh = read(bytes)?;
        // Adding zero turns -0.0 into 0.0: both are one place, but their bits differ.
        let mut places = std::collections::BTreeMap::new();
        let mut vertices = Vec::new();
        let place: Vec<u32> = mesh
            .vertices
            .iter()
            .map(|v| {
                let x = [v[0], v[1], v[2]].map(|c| c + 0.0);
                *places.entry(x.map(f32::to_bits)).or_insert_with(|| {
                    vertices.push(Vector3::from(x.map(f64::from)));
                    vertices.len() as u32 - 1
                })
            })
            .collect();
        let triangles = mesh.faces.iter().map(|f| f.vertices.map(|i| place[i]));
        Self::oriented(vertices, triangles.collect())
    }
}
