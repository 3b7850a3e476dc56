//! Samples to test: bars from a scene or from the options, or periodic samples.

use super::{KEY, Wanted};
use crate::error::{Result, key, unknown, value};
use crate::scene::{Scene, Source};
use crate::setup::filling::{Filling, Recipe, beam, dem, spec};
use crate::setup::{self, cut};
use crate::spec::{DemTable, LooseKind, Material, ModelKind, ModelTable, NotchBox, Shape};
use arlequin::dem_beam::calibrate::Bar;
use arlequin::dem_beam::packing::Container;
use arlequin::dem_beam::packing::size::{JAMMED_PERIODIC, mean_sphere_volume};
use arlequin::dem_beam::{BeamMaterial, Packing};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Number of spheres of a periodic sample, which is then isotropic to a per cent.
const PERIODIC: usize = 8000;
/// Shortest bar in mean diameters: in shorter ones the ends influence the middle.
const SHORTEST: f64 = 8.0;

/// Kind of test.
#[derive(Debug, Clone, Copy)]
pub(super) enum Test {
    /// A bar along x is pulled.
    Tension(Bar),
    /// A periodic sample is strained.
    Bulk,
}

/// Packings to make, and the test of each.
#[derive(Debug, Clone)]
pub(super) struct Sample {
    /// Key of the model in errors.
    pub key: String,
    /// Description in words.
    pub text: String,
    /// Recipe of each packing, with its seed if it has one.
    pub recipes: Vec<(Option<u64>, Recipe)>,
    /// Beams.
    pub beam: BeamMaterial,
    /// Test.
    pub test: Test,
    /// Notches of the scene in the frame of the container; only strength tests cut them.
    notches: Vec<NotchBox>,
}

impl Sample {
    /// Combines the options with the scene.
    pub(super) fn from_options(wanted: &Wanted, source: Option<&Source>) -> Result<Self> {
        let (model_key, mut table, folder) = match source {
            Some(source) => table_from_scene(wanted, source)?,
            None if wanted.cylinder.is_none() && wanted.cuboid.is_none() && !wanted.periodic => {
                let rule = "nothing to test; give a scene, --cylinder, --box or --periodic";
                return Err(key(KEY, rule));
            }
            None => (KEY.to_owned(), table_from_options(wanted), PathBuf::new()),
        };
        apply_options(wanted, &mut table);
        if wanted.periodic {
            return periodic(wanted, model_key, &table);
        }
        let bar = bar(&model_key, &table.shape)?;
        let filling = Filling::from_table(&model_key, &table, &folder)?;
        let recipes = recipes(wanted.seeds, &model_key, &table, &folder, &filling)?;
        let (from, form) = match table.shape {
            Shape::Cylinder { radius, .. } => ("cylinder", format!("radius {radius:e} m")),
            _ => ("box", format!("section {:.4e} m2", bar.area)),
        };
        Ok(Self {
            text: format!("{from} along x, length {:e} m, {form}", bar.length),
            beam: beam(&model_key, &table)?,
            key: model_key,
            recipes,
            test: Test::Tension(bar),
            notches: notches(&table, &filling),
        })
    }

    /// Cuts the notches of the scene.
    pub(super) fn cut(&self, packing: &mut Packing) -> Result<()> {
        cut(&self.key, &self.notches, packing)
    }

    /// Refuses bars too short for their spheres.
    pub(super) fn check(&self, packings: &[Packing]) -> Result<()> {
        let Test::Tension(bar) = self.test else {
            return Ok(());
        };
        let diameter = packings
            .iter()
            .map(|p| 2.0 * p.report.mean_radius)
            .fold(0.0, f64::max);
        if bar.length < SHORTEST * diameter {
            let rule = format!(
                "the bar is {:.1} mean diameters of {diameter:.3e} m long, below {SHORTEST}: take smaller spheres or a \
                 longer bar, or --periodic",
                bar.length / diameter
            );
            return Err(key(format!("{}.shape", self.key), rule));
        }
        Ok(())
    }
}

/// Returns the notches of a table in the frame of the container.
fn notches(table: &ModelTable, filling: &Filling) -> Vec<NotchBox> {
    let shift = filling.shift;
    let moved = |x: [f64; 3]| [x[0] - shift.x, x[1] - shift.y, x[2] - shift.z];
    let boxes = table.dem.notch.iter();
    boxes
        .map(|b| NotchBox {
            low: moved(b.low),
            high: moved(b.high),
        })
        .collect()
}

/// Returns the key and the table of the chosen model, and the folder of the scene.
fn table_from_scene(wanted: &Wanted, source: &Source) -> Result<(String, ModelTable, PathBuf)> {
    let scene = Scene::from_source(source.clone())?.assign(&wanted.set)?;
    let scene = scene.spec();
    let name = match &wanted.model {
        Some(name) => name.clone(),
        None => {
            let mut particles = scene
                .model
                .iter()
                .filter(|(_, t)| setup::kind(t.kind).has_spheres());
            match (particles.next(), particles.next()) {
                (Some((name, _)), None) => name.clone(),
                (None, _) => {
                    let rule =
                        "no model of the scene is of kind \"dem\"; calibration is of packings of spheres";
                    return Err(key("model", rule));
                }
                _ => {
                    return Err(key(
                        "model",
                        "several models are of kind \"dem\"; choose one by --model",
                    ));
                }
            }
        }
    };
    let Some(table) = scene.model.get(&name) else {
        return Err(unknown("--model", &name, "model", scene.model.keys()));
    };
    let model_key = format!("model.{name}");
    if !setup::kind(table.kind).has_spheres() {
        let rule = "only models of kind \"dem\" have beams to calibrate; choose another by --model";
        return Err(key(format!("{model_key}.kind"), rule));
    }
    Ok((model_key, table.clone(), source.folder.clone()))
}

/// Returns the table that a scene with these options would have.
fn table_from_options(wanted: &Wanted) -> ModelTable {
    let from = [0.0; 3];
    let shape = match (wanted.cylinder, wanted.cuboid) {
        (Some([length, radius]), _) => Shape::Cylinder { from, length, radius },
        (_, Some([x, y, z])) => Shape::Box {
            low: from,
            high: [x, y, z],
            hole: None,
        },
        // A periodic sample has no shape; this one only fills the field.
        _ => Shape::Box {
            low: from,
            high: [1.0; 3],
            hole: None,
        },
    };
    ModelTable {
        scale: 1.0,
        volume: None,
        crack: Vec::new(),
        materials: BTreeMap::new(),
        kind: ModelKind::spheres(),
        role: None,
        shape,
        spacing: None,
        divisions: None,
        // Not used: the beams have constants of their own, and statics needs no density.
        material: Material {
            young: 1.0,
            poisson: None,
            density: 1.0,
        },
        step: None,
        fem: Default::default(),
        cnem: Default::default(),
        dem: DemTable {
            young: Some(BeamMaterial::SILICA.young),
            ..DemTable::default()
        },
        command: None,
        address: None,
        timeout: None,
        start_timeout: None,
    }
}

/// Overrides the table by the options that are given.
fn apply_options(wanted: &Wanted, table: &mut ModelTable) {
    // Number and diameter exclude each other: one that is given clears the other.
    if wanted.count.is_some() || wanted.spacing.is_some() {
        (table.dem.count, table.spacing) = (wanted.count, wanted.spacing);
    }
    let t = &mut table.dem;
    t.coordination = wanted.coordination.or(t.coordination);
    // Loose grains carry no load in these tests.
    t.loose = LooseKind::Drop;
    t.protocol = wanted.protocol.or(t.protocol);
    if wanted.radius_ratio.is_some() && wanted.young.is_none() && t.young.is_none() {
        t.young = Some(BeamMaterial::SILICA.young);
    }
    t.young = wanted.young.or(t.young);
    t.poisson = wanted.poisson.or(t.poisson);
    t.radius_ratio = wanted.radius_ratio.or(t.radius_ratio);
}

/// Returns the bar of a shape, in the frame of its container.
fn bar(model_key: &str, shape: &Shape) -> Result<Bar> {
    match *shape {
        Shape::Cylinder { length, radius, .. } => Ok(Bar {
            start: 0.0,
            length,
            area: std::f64::consts::PI * radius * radius,
        }),
        Shape::Box { low, high, .. } => Ok(Bar {
            start: low[0],
            length: high[0] - low[0],
            area: (high[1] - low[1]) * (high[2] - low[2]),
        }),
        Shape::Bar { .. } | Shape::Ball { .. } | Shape::File(_) | Shape::Piece(_) | Shape::Linked => {
            let rule = "a tension test needs a straight bar along x: a box or a cylinder; or give --periodic";
            Err(value(format!("{model_key}.shape"), shape.name(), rule))
        }
    }
}

fn recipes(
    seeds: u64,
    model_key: &str,
    table: &ModelTable,
    folder: &Path,
    filling: &Filling,
) -> Result<Vec<(Option<u64>, Recipe)>> {
    if table.dem.file.is_some() {
        // Spheres from a file do not depend on a seed.
        return Ok(vec![(
            None,
            Recipe::from_table(model_key, table, folder, filling)?,
        )]);
    }
    let first = table.dem.seed.unwrap_or(1);
    let mut table = table.clone();
    let seeded = (first..).take(seeds as usize).map(|seed| {
        table.dem.seed = Some(seed);
        Ok((
            Some(seed),
            Recipe::from_table(model_key, &table, folder, filling)?,
        ))
    });
    seeded.collect()
}

fn periodic(wanted: &Wanted, model_key: String, table: &ModelTable) -> Result<Sample> {
    if table.dem.file.is_some() {
        let rule = "spheres from a file are not periodic; remove --periodic";
        return Err(key(format!("{model_key}.dem.file"), rule));
    }
    let count = wanted.count.unwrap_or(PERIODIC);
    // Moduli do not depend on the size of the spheres, so any diameter will do.
    let diameter = table.spacing.unwrap_or(1e-3);
    let edge = (count as f64 * mean_sphere_volume(diameter) / JAMMED_PERIODIC).cbrt();
    let container = Container::periodic(edge).map_err(dem(&model_key))?;
    let first = table.dem.seed.unwrap_or(1);
    let recipes = (first..).take(wanted.seeds as usize).map(|seed| {
        let mut spec = spec(table, container.clone(), count);
        spec.seed = seed;
        (Some(seed), Recipe::Made(Box::new(spec)))
    });
    Ok(Sample {
        text: format!("periodic cube of edge {edge:.4e} m"),
        beam: beam(&model_key, table)?,
        recipes: recipes.collect(),
        key: model_key,
        test: Test::Bulk,
        notches: Vec::new(),
    })
}
