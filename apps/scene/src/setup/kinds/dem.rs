//! `kind = "dem"`: a random packing of spheres, joined by cohesive beams, that fills the shape.

use crate::error::{Error, Result, cnem, dem};
use crate::setup::body::Body;
use crate::setup::clock::SetupClock;
use crate::setup::files::is;
use crate::setup::filling::{Filling, Recipe, beam, beyond_the_table, unlike_its_material, unlike_the_body};
use crate::setup::kind::{Feature, Kind, Order};
use crate::setup::mesh::{self, Grid};
use crate::setup::packing::{Likeness, PackingLine, Toughness};
use crate::setup::skin::Skin;
use crate::setup::zone::Twin;
use crate::setup::{BodyShape, LoweredModel, LoweredScene, fracture, grains, materials, notch};
use crate::spec::{ParticleFieldKind, Shape};
use arlequin::cnem::NaturalField;
use arlequin::cnem::natural::Interpolant;
use arlequin::core::geometry::Sample;
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::core::{Error as Core, Interpolation, Model, ParticleField, ShapeRow};
use arlequin::dem_beam::{BeamMaterial, DemModel, Error as DemError, Packing};
use arlequin::fem_ref::FemField;
use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock};

/// Displacement field of particles. Interfaces integrate over the particles themselves, which have gradients
/// too; between the centres, for probes and for integration points of another model, natural neighbours
/// interpolate.
struct ParticlePoints {
    /// Built at the first request for a point between the particles: its tetrahedra take more memory than the
    /// model, and most runs never need it.
    natural: OnceLock<Result<NaturalField, String>>,
    particles: Arc<ParticleField<f64>>,
}

impl ParticlePoints {
    fn natural(&self) -> arlequin::core::Result<&NaturalField> {
        let field = self.natural.get_or_init(|| {
            NaturalField::from_points(self.particles.nodes(), Interpolant::Laplace).map_err(|e| e.to_string())
        });
        field.as_ref().map_err(|rule| Core::InvalidParameter {
            name: "field between the particles".into(),
            value: format!("{} centres", self.particles.nodes().len()),
            rule: rule.clone(),
        })
    }
}

impl Interpolation<f64> for ParticlePoints {
    fn nodes(&self) -> &[Point3<f64>] {
        self.particles.nodes()
    }
    fn shape_at(
        &self,
        x: &Point3<f64>,
        gradient: bool,
        row: &mut ShapeRow<f64>,
    ) -> arlequin::core::Result<()> {
        // Integration points of another model lie between the particles, where natural neighbours have
        // gradients too.
        match self.particles.shape_at(x, gradient, row) {
            Err(Core::OutsideDomain { .. }) => self.natural()?.shape_at(x, gradient, row),
            found => found,
        }
    }
    fn samples(&self) -> Option<&[Sample<f64>]> {
        self.particles.samples()
    }
    fn kind(&self) -> &'static str {
        "particle"
    }
}

/// Refuses keys that a packing does not use.
fn unread(key: &str, table: &LoweredModel) -> Result<()> {
    let filed = table.shape.is_file();
    let of_vtu = table.dem.file.as_ref();
    let of_vtu = of_vtu.is_some_and(|f| is(f, "vtu") || is(f, "pvtu"));
    let keys = [
        (
            "divisions",
            table.divisions.is_some(),
            "is of elements; give spacing, the mean diameter of the spheres",
        ),
        (
            "scale",
            !filed && (table.scale - 1.0).abs() > 0.0,
            "is of a file; remove it",
        ),
        (
            "volume",
            !filed && table.volume.is_some(),
            "is of a mesh file; remove it",
        ),
        (
            "dem.radii",
            !of_vtu && table.dem.radii.is_some(),
            "names an array of a .vtu file in dem.file; remove it",
        ),
    ];
    match keys.iter().find(|k| k.1) {
        None => Ok(()),
        Some((name, _, rule)) => Err(crate::error::key(format!("{key}.{name}"), *rule)),
    }
}

/// Places an error about spheres too large for their body at the key that determines their size.
fn too_large(key: &str, table: &LoweredModel, e: Error) -> Error {
    match &e {
        Error::Dem {
            source: DemError::ContainerTooSmall { .. } | DemError::TooFewAcross { .. },
            ..
        } => {
            let name = table.spacing.map_or("dem.count", |_| "spacing");
            e.at_key(|_| Some(format!("{key}.{name}")))
        }
        _ => e,
    }
}

/// A packing of spheres.
pub(super) struct Dem;

impl Kind for Dem {
    fn name(&self) -> &'static str {
        "dem"
    }

    fn meaning(&self) -> &'static str {
        "A random packing of spheres joined by cohesive beams; shapes `box`, `cylinder`, `file`."
    }

    fn has_spheres(&self) -> bool {
        true
    }

    fn refusal(&self, feature: Feature) -> Option<&'static str> {
        match feature {
            Feature::Crack => Some("particles are cut by dem.notch; write it there"),
            Feature::Volumes | Feature::CoarseSide | Feature::Zone | Feature::Partition | Feature::Sleep => {
                None
            }
        }
    }

    /// Spheres have groups at the plane faces of a shape only.
    fn groups(&self, shape: &BodyShape) -> Option<&'static [&'static str]> {
        match shape {
            BodyShape::Given(Shape::Ball { .. }) => Some(&[]),
            BodyShape::Given(Shape::Cylinder { .. }) => Some(&["x-min", "x-max"]),
            shape => mesh::groups(shape),
        }
    }

    fn check(&self, order: &Order<'_>) -> Result<()> {
        let Order {
            key, table, folder, ..
        } = *order;
        unread(key, table)?;
        let filling = Filling::from_table(key, table, folder)?;
        Recipe::check(key, table, folder, &filling)?;
        notch::check(&notch::knives(key, &table.dem.notch, folder)?, filling.ends())?;
        beam(key, table).map(|_| ())
    }

    fn check_in(&self, _: &LoweredScene, order: &Order<'_>) -> Result<()> {
        grains::check_loose(order.key, order.table, order.effects)?;
        let diameter = Filling::from_table(order.key, order.table, order.folder)?.mean_diameter(order.table);
        fracture::check_size((order.key, order.table), order.effects, diameter)?;
        grains::check_single(order.name, order.effects)
    }

    fn build(&self, order: &Order<'_>, clock: &mut SetupClock<'_>) -> Result<Body> {
        let Order {
            name,
            key,
            table,
            folder,
            effects,
            ..
        } = *order;
        clock.begin(format!("packing of '{name}'"));
        grains::check_loose(key, table, effects)?;
        let main = table.known_material(key)?;
        let filling = Filling::from_table(key, table, folder)?;
        let recipe = Recipe::from_table(key, table, folder, &filling)?;
        let built = recipe.packing(key, &mut |share| clock.progress(share));
        let mut packing = built.map_err(|e| too_large(key, table, e))?;
        clock.begin(format!("model of '{name}'"));
        packing.positions.iter_mut().for_each(|x| *x += filling.shift);
        let make = |packing: &Packing, beam| {
            let model = DemModel::new(name, packing, beam, main.density).map_err(dem(key))?;
            graded(key, table, &filling, model)
        };
        let (beam, likeness) = fitted(order, &filling, &|beam| make(&packing, beam))?;
        // The body's elements have no notch, so the packing is measured before it gets one.
        let knives = notch::knives(key, &table.dem.notch, folder)?;
        notch::cut(&knives, &Vector3::zeros(), &mut packing)?;
        let line = PackingLine::from_packing(&packing, main.density, likeness);
        let mut warnings = line.warnings();
        warnings.extend(unlike_the_body(table, &beam, likeness.as_ref()));
        warnings.extend(unlike_its_material(table, &beam));
        warnings.extend(beyond_the_table(table, &beam));
        let model = make(&packing, beam)?;
        // Lowers the peak of memory: effects and fields are built below.
        drop(packing);
        let model = if table.dem.finite_rotations {
            model.with_finite_rotations()
        } else {
            model
        };
        let (model, grains) = grains::build(
            model,
            (key, table),
            effects,
            order.rigid,
            line,
            Skin::new(&table.shape, &filling),
        )?;
        warnings.extend(grains.packing.toughness.as_ref().and_then(Toughness::warning));
        let field: Arc<dyn Interpolation<f64>> = match table.dem.field {
            ParticleFieldKind::Natural => {
                let natural = NaturalField::from_points(model.nodes(), Interpolant::Laplace);
                Arc::new(natural.map_err(cnem(key))?)
            }
            ParticleFieldKind::Particles => Arc::new(ParticlePoints {
                natural: OnceLock::new(),
                particles: model.particle_field(),
            }),
        };
        let grid = Grid::of_spheres(&model);
        let radii = model.body().radii();
        let spacing = 2.0 * radii.iter().sum::<f64>() / radii.len() as f64;
        let material = materials::elastic(key, main)?;
        Ok(Body {
            groups: groups(&model, &table.shape, &filling),
            field,
            grid: Arc::new(grid),
            surfaces: BTreeMap::new(),
            boundary: Vec::new(),
            spacing,
            material: Some(material),
            materials: Some(material.into()),
            shape: table.shape.clone(),
            grains: Some(grains),
            warnings,
            model: Box::new(model),
            solver: None,
        })
    }
}

/// Beams of a packing, in a zone fitted to the body's elements there, and what was measured of them.
fn fitted(
    order: &Order<'_>,
    filling: &Filling,
    make: &dyn Fn(BeamMaterial) -> Result<DemModel>,
) -> Result<(BeamMaterial, Option<Likeness>)> {
    let Order { key, table, .. } = *order;
    let mut beam = beam(key, table)?;
    let (BodyShape::Piece(piece), Some(mesh)) = (&table.shape, &filling.mesh) else {
        return Ok((beam, None));
    };
    let Some(twin) = Twin::new(key, table, mesh, (piece, order.supports, order.folder))? else {
        return Ok((beam, None));
    };
    // Beams that the scene gives are measured but not changed.
    let chosen = table.dem.young.is_none() && table.dem.poisson.is_none();
    let group = |model: &DemModel, name: &str| groups(model, &table.shape, filling).remove(name);
    let likeness = twin.likeness(make(beam)?, chosen, &group)?;
    beam.young *= likeness.map_or(1.0, |l| l.beams);
    Ok((beam, likeness))
}

/// Gives each particle the material of the volume it lies in, if the table has materials for volumes.
fn graded(key: &str, table: &LoweredModel, filling: &Filling, model: DemModel) -> Result<DemModel> {
    let Some(mesh) = filling.mesh.as_ref().filter(|_| !table.materials.is_empty()) else {
        return Ok(model);
    };
    let materials = materials::element_materials(key, table, mesh)?;
    let field = FemField::new(mesh.clone());
    let main = table.known_material(key)?;
    let grades = |x: &Point3<f64>| match field.element_at(x).map(|e| materials.at(e)) {
        // The centre lies outside the mesh: packing has pushed it through a facet.
        None => [1.0; 2],
        Some(m) => [m.young() / main.young, m.density() / main.density],
    };
    model.with_grades(grades).map_err(dem(format!("{key}.materials")))
}

/// Named groups: layers of particles that touch the plane faces of a shape, or the named faces of a mesh
/// file.
fn groups(model: &DemModel, shape: &BodyShape, filling: &Filling) -> BTreeMap<String, Vec<usize>> {
    let mut out = BTreeMap::new();
    let mut layer = |name: &str, point: Point3<f64>, normal: Vector3<f64>| {
        out.insert(name.to_owned(), model.clamp_layer(&point, &normal));
    };
    match *shape {
        BodyShape::Given(Shape::Box { low, high, .. }) => {
            let axes = [("x", Vector3::x()), ("y", Vector3::y()), ("z", Vector3::z())];
            for (name, axis) in axes {
                layer(&format!("{name}-min"), Point3::from(low), -axis);
                layer(&format!("{name}-max"), Point3::from(high), axis);
            }
        }
        BodyShape::Given(Shape::Cylinder { from, length, .. }) => {
            layer("x-min", Point3::from(from), -Vector3::x());
            layer("x-max", Point3::from(from) + Vector3::x() * length, Vector3::x());
        }
        BodyShape::Given(Shape::Bar { .. } | Shape::Ball { .. }) | BodyShape::Remote => {}
        BodyShape::Given(Shape::File(_)) | BodyShape::Piece(_) | BodyShape::Reservoir(_) => {
            let faces = filling.faces.iter();
            out.extend(faces.map(|(name, face)| (name.clone(), model.touching(face))));
        }
    }
    out
}
