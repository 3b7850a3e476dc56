//! Strips for toughness tests: their shape, and the fracture of their bonds.

use super::sample::{Sample, Test, cuboid, shape_from_options};
use super::{KEY, Wanted};
use crate::error::{Result, dem, key};
use crate::setup::filling::Filling;
use crate::setup::fracture::fracture;
use crate::setup::{BodyShape, LoweredModel, LoweredScene};
use crate::spec::{self, EffectKind, Shape};
use arlequin::dem_beam::toughness::SHORTEST;
use arlequin::dem_beam::{BeamMaterial, Criterion, Fracture};
use std::path::{Path, PathBuf};

/// Lengths of the standard strip in mean diameters.
const STANDARD: [f64; 3] = [64.0, 20.0, 8.0];
/// Smallest height and thickness of a strip in mean diameters: the crack must be long against the spheres.
const LEAST: [f64; 2] = [12.0, 4.0];
/// Fracture energy without a scene that has one \[J/m²\]: that of silica. Ratios do not depend on it.
const SILICA: f64 = 8.0;

/// Fracture that a scene means.
#[derive(Debug, Clone, Copy)]
pub(super) struct Meant {
    /// Fracture energy \[J/m²\], if one is given.
    pub gc: Option<f64>,
    /// Criterion and strength of the bonds.
    pub fracture: Fracture,
}

/// Place of an effect in the scene, and the fracture that it means.
pub(super) type Bonds = (usize, spec::Fracture);

/// Returns the fracture of a model of a scene.
pub(super) fn bonds(scene: &LoweredScene, name: &str) -> Option<Bonds> {
    scene.effect.iter().enumerate().find_map(|(k, e)| match &e.kind {
        EffectKind::Fracture(f) if e.models.as_ref().is_none_or(|m| m.iter().any(|m| m == name)) => {
            Some((k, *f))
        }
        _ => None,
    })
}

impl Meant {
    /// Returns the fracture of a model with spheres of a mean diameter \[m\]; without one, the fracture
    /// energy of silica.
    pub(super) fn new(
        bonds: Option<Bonds>,
        model_key: &str,
        (table, diameter): (&LoweredModel, Option<f64>),
        beam: BeamMaterial,
    ) -> Result<Self> {
        let Some((k, f)) = bonds else {
            let base = Fracture::from_fracture_energy(Criterion::TensileEnergy, SILICA, beam.radius_ratio);
            return Ok(Self {
                gc: Some(SILICA),
                fracture: base.map_err(dem(model_key))?,
            });
        };
        let path = format!("effect[{k}].fracture");
        let fracture = fracture(&path, &f, (model_key, table), diameter)?;
        Ok(Self {
            gc: f.gc,
            fracture: Fracture {
                // A strip has no overlap.
                spare_overlap: false,
                ..fracture
            },
        })
    }
}

/// Prepares strips: a box that the options or the scene give, if it is one, else the standard strip of the
/// spheres. `given` is the table of the scene, `table` the same with the options.
pub(super) fn sample(
    wanted: &Wanted,
    model_key: &str,
    (given, mut table): (&LoweredModel, LoweredModel),
    folder: &Path,
    (beam, meant): (BeamMaterial, Meant),
) -> Result<Sample> {
    if wanted.periodic || wanted.cylinder.is_some() {
        let rule = "toughness is that of a strip: remove --periodic and --cylinder, or give --box";
        return Err(key(KEY, rule));
    }
    let sized = wanted.spacing.is_some() || wanted.count.is_some();
    if given.dem.file.is_some() && !(wanted.cuboid.is_some() && sized) {
        let rule = "spheres of a file are no strip with a crack: give --box with --spacing";
        return Err(key(format!("{model_key}.dem.file"), rule));
    }
    // The spheres of a file fill another shape; those of the strip are made by the options.
    (table.dem.file, table.dem.radii) = (None, None);
    // The strip has a crack of its own.
    table.dem.notch.clear();
    let mut notes = Vec::new();
    if wanted.cuboid.is_some() {
        table.shape = shape_from_options(wanted);
    } else if let Some(d) = mean_size(wanted, model_key, given, folder)? {
        let own = lengths(&table.shape).is_some_and(|(_, size)| refusal(size, d).is_none());
        if !own {
            // Three digits suffice for a size that the user may copy.
            let edge = |n: f64| format!("{:.2e}", n * d).parse().unwrap_or(n * d);
            let size = STANDARD.map(edge);
            table.shape = cuboid(size);
            (table.dem.count, table.spacing) = (None, Some(d));
            notes.push(format!(
                "{model_key}.shape ({}) is no strip: one of {:e} by {:e} by {:e} m is tested in its place; --box takes another",
                given.shape.name(),
                size[0],
                size[1],
                size[2]
            ));
        }
    }
    let Some((low, size)) = lengths(&table.shape) else {
        let rule = "toughness is that of a strip: give --box with --spacing or --count";
        return Err(key(KEY, rule));
    };
    let mut sample = Sample::bar(wanted.seeds, model_key, table, PathBuf::from(folder), beam)?;
    if let Some(rule) = sample.diameter().and_then(|d| refusal(size, d)) {
        return Err(key(format!("{model_key}.shape"), rule));
    }
    if let Test::Tension(bar) = sample.test {
        sample.test = Test::Strip(bar, low, size);
    }
    sample.text = format!(
        "strip along x, {:e} by {:e} by {:e} m, with an edge crack in its middle plane",
        size[0], size[1], size[2]
    );
    sample.meant = Some(meant);
    sample.notes = notes;
    Ok(sample)
}

/// Returns the mean diameter of the spheres \[m\] that the options or the scene give.
pub(super) fn mean_size(
    wanted: &Wanted,
    model_key: &str,
    given: &LoweredModel,
    folder: &Path,
) -> Result<Option<f64>> {
    // The shape, which may be a file, is only read where the size follows from it.
    let own = match (given.spacing, given.dem.count) {
        (None, None | Some(0)) => None,
        (None, Some(_)) => Filling::from_table(model_key, given, folder)?.mean_diameter(given),
        (spacing, _) => spacing.filter(|s| *s > 0.0),
    };
    Ok(wanted.spacing.filter(|d| *d > 0.0).or(own))
}

/// Returns the lowest corner and the lengths of a box \[m\].
fn lengths(shape: &BodyShape) -> Option<([f64; 3], [f64; 3])> {
    match *shape {
        BodyShape::Given(Shape::Box {
            low,
            high,
            hole: None,
        }) => Some((low, [0, 1, 2].map(|c| high[c] - low[c]))),
        _ => None,
    }
}

/// Returns why a box is no strip for spheres of this mean diameter \[m\].
fn refusal([length, height, thickness]: [f64; 3], diameter: f64) -> Option<String> {
    let [high, thick] = LEAST.map(|n| n * diameter);
    (length < SHORTEST * height || height < high || thickness < thick).then(|| {
        format!(
            "a strip of {length:e} by {height:e} by {thickness:e} m does not show the toughness of spheres of {diameter:.3e} m: its \
             height must be {high:.2e} m or more, its thickness {thick:.2e} m, its length {SHORTEST:.1} heights"
        )
    })
}
