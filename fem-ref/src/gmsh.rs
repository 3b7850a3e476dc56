//! Import of Gmsh meshes, formats 4.1 and 2.2, ascii or binary.
//!
//! One element kind fills the domain: hexahedra, tetrahedra, or lines if there are no solids. Elements of
//! second order are read as linear ones without their mid-edge nodes; [`Mesh::notices`] then says so.
//!
//! Physical groups become named groups of nodes; groups of surfaces also get facets if they lie on the
//! boundary. A group without a name in the file is called `point-1`, `curve-2`, `surface-3` or `volume-4`
//! after its dimension and tag. An element that one entity lists twice is read once, whatever the order of
//! its nodes. Listed on two entities it is an error, because two volumes at one place may have different
//! materials. Nodes are renumbered for locality; Gmsh's own tags are not kept.

mod assemble;
mod contents;
mod surface;
mod v2;
mod v4;

pub use surface::{Triangles, facets_of, load_surface, triangles_of};

use crate::error::{Error, Result};
use crate::mesh::Mesh;
use arlequin_core::Real;
use contents::Contents;
use std::path::Path;

/// Reads a `.msh` file.
///
/// # Errors
/// [`Error::File`] if the file cannot be read, otherwise the errors of [`parse`].
pub fn load<T: Real>(path: impl AsRef<Path>) -> Result<Mesh<T>> {
    let path = path.as_ref();
    let bytes = std::fs::read(path).map_err(|e| Error::File {
        path: path.display().to_string(),
        message: e.to_string(),
    })?;
    parse(&bytes)
}

/// Parses the content of a `.msh` file. Bars get a section of 1 m²; see [`Mesh::with_section`].
///
/// ```
/// let text = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n\
///     $Nodes\n1 4 1 4\n3 1 0 4\n1\n2\n3\n4\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n$EndNodes\n\
///     $Elements\n1 1 1 1\n3 1 4 1\n1 1 2 3 4\n$EndElements\n";
/// let mesh = fem_ref::gmsh::parse::<f64>(text.as_bytes())?;
/// assert_eq!((mesh.kind().name(), mesh.nodes().len()), ("tet4", 4));
/// # Ok::<(), fem_ref::Error>(())
/// ```
///
/// # Errors
/// [`Error::Gmsh`] for another version, a broken section, mixed or unsupported elements, or unknown or
/// repeated node tags; the errors of [`Mesh::new`] for meshes that are not valid.
pub fn parse<T: Real>(bytes: &[u8]) -> Result<Mesh<T>> {
    assemble::mesh(&contents(bytes)?)
}

/// Reads nodes, elements and names of a file.
fn contents(bytes: &[u8]) -> Result<Contents> {
    let header = v4::header(bytes)?;
    let mut file = match header.version.as_str() {
        "4.1" => v4::read(bytes, &header)?,
        "2" | "2.0" | "2.1" | "2.2" => v2::read(bytes, &header)?,
        other => {
            return Err(fault(format!(
                "format {other} is not supported; save in 4.1 (Mesh.MshFileVersion = 4.1)"
            )));
        }
    };
    // All formats write names alike.
    file.names = v4::physical_names(bytes)?;
    // Before elements are counted: second order has names of its own.
    file.linearise();
    Ok(file)
}

fn fault(message: impl Into<String>) -> Error {
    Error::Gmsh {
        message: message.into(),
    }
}
