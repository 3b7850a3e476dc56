//! Regions of zones, as signed distances from what the scene names.

use super::{Cut, Zone};
use crate::error::{Result, dem, key, unknown, value};
use crate::setup::cloud;
use crate::setup::faces::{Faces, corners_of};
use crate::setup::files::{self, bytes};
use crate::setup::shapes::region;
use crate::spec::ZoneShape;
use arlequin::core::nalgebra::Point3;
use arlequin::core::{Primitive, Region};
use arlequin::dem_beam::Surface;
use arlequin::dem_beam::packing::read_facets;
use arlequin::fem_ref::Mesh;
use std::path::Path;

/// A region with a signed distance.
#[derive(Debug)]
pub(super) enum Place {
    Simple(Primitive<f64>),
    /// All points within a distance \[m\] of triangles.
    Near(Faces, f64),
    /// Inside a closed surface.
    Inside(Faces, Box<Surface>),
    /// In any of some regions.
    Union(Vec<Self>),
}

impl Place {
    /// Builds the region of a zone; `None` if it begins empty.
    pub(super) fn new(cut: &Cut, zone: usize, mesh: &Mesh<f64>, folder: &Path) -> Result<Option<Self>> {
        let Zone { name, table, .. } = &cut.zones[zone];
        let scale = table.scale.unwrap_or(cut.body.scale);
        let place = |shape| Self::from_shape((&format!("zone.{name}.shape"), shape), scale, mesh, folder);
        table.shape.as_ref().map(place).transpose()
    }

    /// Builds the region of a shape with its key in the scene; a unit of its files is `scale` \[m\].
    pub(super) fn from_shape(
        (path, shape): (&str, &ZoneShape),
        scale: f64,
        mesh: &Mesh<f64>,
        folder: &Path,
    ) -> Result<Self> {
        Ok(match shape {
            ZoneShape::Near {
                group,
                file,
                distance,
            } => {
                let key_path = format!("{path}.near");
                let faces = match (group, file) {
                    (Some(g), None) => of_group(&format!("{key_path}.group"), g, mesh)?,
                    (None, Some(f)) => of_file(&format!("{key_path}.file"), &folder.join(f), scale)?,
                    _ => return Err(key(key_path, "needs exactly one of group, file")),
                };
                Self::Near(faces, *distance)
            }
            ZoneShape::File(file) => {
                let key_path = format!("{path}.file");
                let surface = files::surface(&key_path, &folder.join(file), scale)?;
                Self::Inside(Faces::new(cloud::corners(&surface)), Box::new(surface))
            }
            ZoneShape::Union(shapes) => {
                let part = |(k, shape)| {
                    Self::from_shape((&format!("{path}.union[{k}]"), shape), scale, mesh, folder)
                };
                Self::Union(shapes.iter().enumerate().map(part).collect::<Result<_>>()?)
            }
            shape => Self::Simple(simple(path, shape)?),
        })
    }

    /// Signed distance \[m\], negative inside. Inside a union it is a bound: that of the part whose border
    /// is farthest.
    pub(super) fn distance(&self, x: &Point3<f64>) -> f64 {
        match self {
            Self::Simple(p) => p.distance(x),
            Self::Near(faces, reach) => faces.distance(x) - reach,
            Self::Inside(faces, surface) => {
                let d = faces.distance(x);
                if surface.contains(&x.coords) { -d } else { d }
            }
            Self::Union(places) => places.iter().fold(f64::INFINITY, |d, p| d.min(p.distance(x))),
        }
    }
}

/// Refuses sizes that are not positive, and missing or excess keys.
pub(in crate::setup) fn check_region(path: &str, shape: &ZoneShape) -> Result<()> {
    match shape {
        ZoneShape::Near { distance, .. } if *distance <= 0.0 => Err(value(
            format!("{path}.near.distance"),
            *distance,
            "must be positive [m]",
        )),
        ZoneShape::Near { group, file, .. } if group.is_some() == file.is_some() => {
            Err(key(format!("{path}.near"), "needs exactly one of group, file"))
        }
        ZoneShape::Near { .. } | ZoneShape::File(_) => Ok(()),
        ZoneShape::Union(shapes) if shapes.is_empty() => {
            Err(key(format!("{path}.union"), "has no region; give one or more"))
        }
        ZoneShape::Union(shapes) => {
            let mut numbered = shapes.iter().enumerate();
            numbered.try_for_each(|(k, shape)| check_region(&format!("{path}.union[{k}]"), shape))
        }
        shape => simple(path, shape).map(|_| ()),
    }
}

fn simple(path: &str, shape: &ZoneShape) -> Result<Primitive<f64>> {
    match shape.simple() {
        Some(shape) => region(path, &shape),
        None => Err(key(path, "is no simple region")),
    }
}

/// Facets of a group, or its nodes if it has no facets.
fn of_group(path: &str, name: &str, mesh: &Mesh<f64>) -> Result<Faces> {
    let Some(group) = mesh.groups().get(name) else {
        return Err(unknown(path, name, "group of the body", mesh.groups().keys()));
    };
    let triangles = corners_of(mesh, &group.facets);
    Ok(Faces::new(if triangles.is_empty() {
        let nodes = group.nodes.iter();
        nodes.map(|k| [mesh.nodes()[*k as usize]; 3]).collect()
    } else {
        triangles
    }))
}

/// Triangles of an STL file, in units of `scale` metres.
fn of_file(path: &str, file: &Path, scale: f64) -> Result<Faces> {
    let facets = read_facets(&bytes(file)?).map_err(dem(path))?;
    let facets = facets.iter().map(|t| t.map(|x| Point3::from(x * scale)));
    Ok(Faces::new(facets.collect()))
}
