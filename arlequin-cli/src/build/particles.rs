//! `kind = "dem"`: a random packing of spheres joined by cohesive beams fills the shape.

use super::grains::{self, Grains};
use super::kinds::Body;
use super::mesh::View;
use crate::error::{Result, core, key, value};
use crate::scene::{DemTable, Effect, ModelTable, ParticleFieldKind, Protocol, Shape};
use arlequin::cnem::NaturalField;
use arlequin::cnem::natural::Kind as Neighbours;
use arlequin::core::Model;
use arlequin::core::field::{Interpolation, ShapeRow};
use arlequin::core::geometry::Sample;
use arlequin::core::model::FineModel;
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::dem_beam::packing::{Container, Packing, PackingSpec};
use arlequin::dem_beam::{BeamMaterial, DemError, DemModel};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

/// Young's modulus of the beams over that of the packing, for beams of 0.71 mean radii and 6.2 bonds per particle:
/// beams of 265e9 Pa gave 74.4e9 ± 0.3e9 Pa with 20 000 spheres.
const YOUNG_RATIO: f64 = 265.0 / 74.4;
/// Volume fraction at which polydisperse spheres jam.
const JAMMED: f64 = 0.615;

pub(super) fn dem(key: &str) -> impl Fn(DemError) -> crate::error::Error + '_ {
    move |e| core(key)(e.into())
}

/// The particle field of a scene: natural neighbours between the centres, for probes, and the particles themselves as
/// integration points of interfaces.
struct ParticlePoints {
    natural: NaturalField,
    samples: Vec<Sample<f64>>,
}

impl Interpolation<f64> for ParticlePoints {
    fn nodes(&self) -> &[Point3<f64>] {
        self.natural.nodes()
    }
    fn shape_at(
        &self,
        x: &Point3<f64>,
        gradient: bool,
        row: &mut ShapeRow<f64>,
    ) -> arlequin::core::Result<()> {
        if gradient {
            let (role, junction) = (self.kind().into(), "H1".into());
            return Err(arlequin::core::Error::NoGradient { role, junction });
        }
        self.natural.shape_at(x, false, row)
    }
    fn samples(&self) -> Option<&[Sample<f64>]> {
        Some(&self.samples)
    }
    fn kind(&self) -> &'static str {
        "particle"
    }
}

/// Builds a bonded packing that fills the shape.
pub(super) fn body(name: &str, key: &str, table: &ModelTable, effects: &[(usize, &Effect)]) -> Result<Body> {
    let (container, shift) = container(key, &table.shape)?;
    let packing = packing(key, table, container)?;
    let mut packing = packing;
    packing.positions.iter_mut().for_each(|x| *x += shift);
    grains::cut(key, &table.dem.notch, &mut packing)?;
    let beam = beam(key, table)?;
    let model = DemModel::new(name, &packing, beam, table.material.density).map_err(dem(key))?;
    let model = if table.dem.finite_rotations {
        model.with_finite_rotations()
    } else {
        model
    };
    let (model, grains) = Grains::of(model, table, effects)?;
    let natural =
        NaturalField::from_points(model.nodes(), Neighbours::Laplace).map_err(|e| core(key)(e.into()))?;
    let field: Arc<dyn Interpolation<f64>> = match table.dem.field {
        ParticleFieldKind::Natural => Arc::new(natural),
        ParticleFieldKind::Particles => {
            let samples = model
                .fine_field()
                .samples()
                .map(<[_]>::to_vec)
                .unwrap_or_default();
            Arc::new(ParticlePoints { natural, samples })
        }
    };
    let bonds = model.body().pairs();
    let view = View {
        points: model.nodes().to_vec(),
        connectivity: bonds.iter().flatten().copied().collect(),
        corners: 2,
        cell_type: 3,
    };
    let radii = model.body().radii();
    let spacing = 2.0 * radii.iter().sum::<f64>() / radii.len() as f64;
    Ok(Body {
        groups: groups(&model, &table.shape),
        field,
        view,
        surfaces: BTreeMap::new(),
        boundary: Vec::new(),
        spacing,
        material: table.material,
        shape: table.shape.clone(),
        grains: Some(grains),
        model: Box::new(model),
    })
}

/// The container and by how much its packing is moved.
fn container(key: &str, shape: &Shape) -> Result<(Container, Vector3<f64>)> {
    let none = Vector3::zeros();
    match *shape {
        Shape::Box { low, high } => {
            let made = Container::cuboid(Vector3::from(low), Vector3::from(high));
            Ok((made.map_err(dem(&format!("{key}.shape.box")))?, none))
        }
        Shape::Cylinder { from, length, radius } => {
            let made = Container::cylinder(length, radius).map_err(dem(&format!("{key}.shape.cylinder")))?;
            Ok((made, Vector3::from(from)))
        }
        Shape::Bar { .. } | Shape::File(_) => {
            let rule = "spheres fill a box or a cylinder; choose one, or another kind of model";
            Err(value(format!("{key}.shape"), shape.name(), rule))
        }
    }
}

fn packing(path: &str, table: &ModelTable, container: Container) -> Result<Packing> {
    let DemTable {
        count,
        seed,
        protocol,
        coordination,
        ..
    } = table.dem;
    let count = match (count, table.spacing) {
        (Some(n), None) => n,
        (None, Some(h)) if h > 0.0 => {
            // Mean volume of spheres with radii uniform within a quarter of the mean.
            let sphere = std::f64::consts::PI / 6.0 * h.powi(3) * (1.0 + 0.25f64.powi(2));
            (JAMMED * container.volume() / sphere).round().min(1e9) as usize
        }
        (None, Some(h)) => return Err(value(format!("{path}.spacing"), h, "must be positive [m]")),
        (Some(_), Some(_)) => return Err(key(path, "spacing and dem.count exclude each other; remove one")),
        (None, None) => {
            return Err(key(
                path,
                "spacing is missing: the mean diameter of the spheres [m]; or give dem.count",
            ));
        }
    };
    let mut spec = match protocol {
        Protocol::Onset => PackingSpec::new(container, count, seed),
        Protocol::Quench => PackingSpec::quench(container, count, seed),
    };
    if let Some(z) = coordination {
        spec.coordination = z;
    }
    let built = match cache() {
        Some(folder) => spec.build_cached(&folder),
        None => spec.build(),
    };
    built.map_err(dem(path))
}

/// Where packings are kept between runs: `ARLEQUIN_CACHE`, or the user's cache folder.
fn cache() -> Option<PathBuf> {
    let folder = |name: &str| {
        std::env::var_os(name)
            .filter(|v| !v.is_empty())
            .map(PathBuf::from)
    };
    folder("ARLEQUIN_CACHE")
        .or_else(|| folder("XDG_CACHE_HOME").map(|p| p.join("arlequin")))
        .or_else(|| folder("HOME").map(|p| p.join(".cache/arlequin")))
}

fn beam(path: &str, table: &ModelTable) -> Result<BeamMaterial> {
    let DemTable {
        young,
        poisson,
        radius_ratio,
        ..
    } = table.dem;
    if radius_ratio.is_some() && young.is_none() {
        let rule = "decides the stiffness together with dem.young; give both";
        return Err(key(format!("{path}.dem.radius_ratio"), rule));
    }
    Ok(BeamMaterial {
        young: young.unwrap_or(YOUNG_RATIO * table.material.young),
        poisson: poisson.unwrap_or(BeamMaterial::SILICA.poisson),
        radius_ratio: radius_ratio.unwrap_or(BeamMaterial::SILICA.radius_ratio),
    })
}

/// The layers of particles that touch the plane faces, and for cylinders the side.
fn groups(model: &DemModel, shape: &Shape) -> BTreeMap<String, Vec<usize>> {
    let mut out = BTreeMap::new();
    let mut layer = |name: &str, at: Point3<f64>, normal: Vector3<f64>| {
        out.insert(name.to_owned(), model.clamp_layer(&at, &normal));
    };
    match *shape {
        Shape::Box { low, high } => {
            let axes = [("x", Vector3::x()), ("y", Vector3::y()), ("z", Vector3::z())];
            for (name, axis) in axes {
                layer(&format!("{name}-min"), Point3::from(low), -axis);
                layer(&format!("{name}-max"), Point3::from(high), axis);
            }
        }
        Shape::Cylinder { from, length, .. } => {
            layer("x-min", Point3::from(from), -Vector3::x());
            layer("x-max", Point3::from(from) + Vector3::x() * length, Vector3::x());
        }
        Shape::Bar { .. } | Shape::File(_) => {}
    }
    out
}
