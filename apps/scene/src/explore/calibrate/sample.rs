//! Samples to test: bars from a scene or from the options, or periodic samples.

use super::strip::{self, Bonds, Meant, mean_size};
use super::{KEY, Wanted};
use crate::error::{Result, key, unknown};
use crate::scene::{Scene, Source};
use crate::setup::filling::{Filling, Recipe, beam, dem, spec};
use crate::setup::{self, BodyShape, Knife, LoweredModel, LoweredScene, cut, knives};
use crate::spec::{DemTable, LooseKind, Material, ModelKind, Shape};
use arlequin::core::nalgebra::Vector3;
use arlequin::dem_beam::calibrate::Bar;
use arlequin::dem_beam::packing::Container;
use arlequin::dem_beam::packing::size::{JAMMED_PERIODIC, mean_diameter, mean_sphere_volume, sphere_count};
use arlequin::dem_beam::{BeamMaterial, Packing};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Number of spheres of a periodic sample, which is then isotropic to a per cent.
const PERIODIC: usize = 8000;
/// Shortest bar in mean diameters: in shorter ones the ends influence the middle.
const SHORTEST: f64 = 8.0;
/// Length and width of the standard bar in mean diameters. The moduli of its middle and of the whole differ
/// by 0.7 % (onset) and 1.3 % (quench) in the mean over six seeds.
const STANDARD: [f64; 2] = [36.0, 12.0];
/// Length over mean diameter, and over width, from which on the shape of a scene is tested itself. At 17
/// diameters the middle is 4 % stiffer than the whole.
const STRAIGHT: [f64; 2] = [25.0, 2.0];

/// Largest number of spheres of the shape of a scene that is tested itself, three times that of the standard
/// bar. A test of a large plate would take an hour and tell the same.
const MANY: f64 = 2e4;

/// Kind of test.
#[derive(Debug, Clone, Copy)]
pub(super) enum Test {
    /// A bar along x is pulled.
    Tension(Bar),
    /// A bar is pulled, which is a strip of this lowest corner and these lengths \[m\] for a crack.
    Strip(Bar, [f64; 3], [f64; 3]),
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
    /// Remarks on what is tested in place of the scene's own shape and beams.
    pub notes: Vec<String>,
    /// Recipe of each packing, with its seed if it has one.
    pub recipes: Vec<(Option<u64>, Recipe)>,
    /// Beams.
    pub beam: BeamMaterial,
    /// Test.
    pub test: Test,
    /// Fracture of a strip.
    pub meant: Option<Meant>,
    table: LoweredModel,
    folder: PathBuf,
    /// Notches of the scene, and place of the container in the scene \[m\]; only strength tests cut them.
    notches: (Vec<Knife>, Vector3<f64>),
}

impl Sample {
    /// Combines the options with the scene.
    pub(super) fn from_options(wanted: &Wanted, source: Option<&Source>) -> Result<Self> {
        let has_shape = wanted.cylinder.is_some() || wanted.cuboid.is_some();
        let (model_key, mut table, folder, bonds) = match source {
            Some(source) => table_from_scene(wanted, source)?,
            None if !has_shape && !wanted.periodic => {
                let rule = "nothing to test; give a scene, --cylinder, --box or --periodic";
                return Err(key(KEY, rule));
            }
            None => (KEY.to_owned(), table_from_options(), PathBuf::new(), None),
        };
        let given = table.clone();
        apply_options(wanted, &mut table);
        // A zone has beams of its own rule, so they are read before another shape replaces it.
        let beam = beam(&model_key, &table)?;
        if wanted.toughness.is_some() {
            let diameter = mean_size(wanted, &model_key, &given, &folder)?;
            let meant = Meant::new(bonds, &model_key, (&table, diameter), beam)?;
            return strip::sample(wanted, &model_key, (&given, table), &folder, (beam, meant));
        }
        if wanted.periodic {
            if wanted.strength.is_some() {
                let rule = "strength is that of a bar; remove --periodic or --strength";
                return Err(key(KEY, rule));
            }
            return periodic(wanted, model_key, table, beam);
        }
        let mut notes = Vec::new();
        if has_shape {
            table.shape = shape_from_options(wanted);
            table.dem.notch.clear();
            if table.spacing.is_some() || table.dem.count.is_some() {
                (table.dem.file, table.dem.radii) = (None, None);
            }
        } else {
            notes.extend(replace_shape(wanted, &model_key, (&given, &mut table), &folder)?);
        }
        let fitted = table.dem.young.is_none() && table.dem.poisson.is_none();
        if fitted && matches!(given.shape, BodyShape::Piece(_)) {
            let rule = "the beams are those of a bulk packing as stiff as the body; the packing of a zone is then fitted in \
                        its place, by the factor that arlequin check prints";
            notes.push(rule.to_owned());
        }
        let mut sample = Self::bar(wanted.seeds, &model_key, table, folder, beam)?;
        sample.notes = notes;
        Ok(sample)
    }

    /// Prepares the bar of a table.
    pub(super) fn bar(
        seeds: u64,
        model_key: &str,
        table: LoweredModel,
        folder: PathBuf,
        beam: BeamMaterial,
    ) -> Result<Self> {
        let filling = Filling::from_table(model_key, &table, &folder)?;
        let recipes = recipes(seeds, model_key, &table, &folder, &filling)?;
        let Some((bar, _)) = bar(&table.shape) else {
            let rule = "spheres of a file are tested in their own shape, and a tension test needs a bar along x: give \
                        --box or --cylinder with --spacing";
            return Err(key(format!("{model_key}.dem.file"), rule));
        };
        let (from, form) = match table.shape.in_scene() {
            Some(Shape::Cylinder { radius, .. }) => ("cylinder", format!("radius {radius:e} m")),
            _ => ("box", format!("section {:.4e} m2", bar.area)),
        };
        let sample = Self {
            text: format!("{from} along x, length {:e} m, {form}", bar.length),
            notes: Vec::new(),
            beam,
            key: model_key.to_owned(),
            recipes,
            test: Test::Tension(bar),
            meant: None,
            notches: (knives(model_key, &table.dem.notch, &folder)?, filling.shift),
            table,
            folder,
        };
        sample.check()?;
        Ok(sample)
    }

    /// Returns the same bar of spheres of another mean diameter \[m\].
    pub(super) fn with_spacing(&self, spacing: f64) -> Result<Self> {
        let mut table = self.table.clone();
        // Number and diameter exclude each other.
        (table.dem.count, table.spacing) = (None, Some(spacing));
        let seeds = self.recipes.len() as u64;
        Self::bar(seeds, &self.key, table, self.folder.clone(), self.beam)
    }

    /// Cuts the notches of the scene.
    pub(super) fn cut(&self, packing: &mut Packing) -> Result<()> {
        cut(&self.notches.0, &self.notches.1, packing)
    }

    /// Mean diameter of the spheres \[m\].
    pub(super) fn diameter(&self) -> Option<f64> {
        self.recipes.first().map(|(_, recipe)| match recipe {
            Recipe::Read(packing) => 2.0 * packing.report.mean_radius,
            Recipe::Made(spec) => mean_diameter(spec.container.volume(), spec.count as f64),
        })
    }

    /// Refuses bars too short for their spheres.
    fn check(&self) -> Result<()> {
        let (Test::Tension(bar), Some(diameter)) = (self.test, self.diameter()) else {
            return Ok(());
        };
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

/// Replaces the shape of a scene by the standard bar if it is no straight bar along x. `given` is the table
/// of the scene, `table` the same with the options. Returns a remark for the user.
fn replace_shape(
    wanted: &Wanted,
    model_key: &str,
    (given, table): (&LoweredModel, &mut LoweredModel),
    folder: &Path,
) -> Result<Option<String>> {
    // Bar refuses shapes that spheres cannot fill, and spheres of a file, which have a size of their own.
    if given.dem.file.is_some() || given.shape.is_line() {
        return Ok(None);
    }
    let Some(wanted_size) = mean_size(wanted, model_key, given, folder)? else {
        // Missing and impossible sizes are refused with the recipes.
        return Ok(None);
    };
    let sizes = wanted.strength.as_ref().and_then(|s| s.sizes.as_ref());
    let largest = |first: f64| sizes.into_iter().flatten().copied().fold(first, f64::max);
    let [long, slender] = STRAIGHT;
    if let Some((bar, width)) = bar(&given.shape) {
        // In the scene's own shape, a number of spheres decides their size.
        let counted = wanted.count.filter(|n| *n > 0);
        let size = counted.map_or(wanted_size, |n| mean_diameter(bar.length * bar.area, n as f64));
        let few = sphere_count(bar.length * bar.area, size) <= MANY;
        if few && bar.length >= slender * width && bar.length >= long * largest(size) {
            return Ok(None);
        }
    }
    let largest = largest(wanted_size);
    let [length, width] = STANDARD;
    // With a number of spheres, their size stays and the bar changes.
    let unit = wanted.count.filter(|n| *n > 0).map_or(largest, |n| {
        largest / mean_diameter(length * width * width, n as f64)
    });
    // Three digits suffice for a size that the user may copy.
    let edge = |diameters: f64| {
        format!("{:.2e}", diameters * unit)
            .parse()
            .unwrap_or(diameters * unit)
    };
    let [x, y]: [f64; 2] = [edge(length), edge(width)];
    table.shape = cuboid([x, y, y]);
    table.dem.notch.clear();
    // A number that the scene gives is that of its own shape; in the bar, the size of the spheres stays.
    if wanted.count.is_none() {
        (table.dem.count, table.spacing) = (None, Some(wanted_size));
    }
    Ok(Some(format!(
        "{model_key}.shape ({}) is no bar along x of {long} mean diameters (of {largest:.2e} m), twice its width and of at most {MANY:e} \
         spheres: a bar of {x:e} by {y:e} by {y:e} m of such spheres is tested in its place; --box, --cylinder or --periodic take another",
        given.shape.name()
    )))
}

/// Returns the key and the table of the chosen model, the folder of the scene, and the fracture of its bonds.
fn table_from_scene(
    wanted: &Wanted,
    source: &Source,
) -> Result<(String, LoweredModel, PathBuf, Option<Bonds>)> {
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
                    let rule = "no model of the scene is of kind \"dem\", so it has no spheres; give --periodic, --box or \
                                --cylinder instead of the scene";
                    return Err(key("model", rule));
                }
                _ => {
                    let rule = "several models are of kind \"dem\"; choose one by --model";
                    return Err(key("model", rule));
                }
            }
        }
    };
    let Some(table) = scene.model.get(&name) else {
        return Err(unknown("--model", &name, "model", scene.model.keys()));
    };
    let model_key = key_in(scene, &name);
    if !setup::kind(table.kind).has_spheres() {
        let rule = "only models of kind \"dem\" have beams to calibrate; choose another by --model";
        return Err(key(format!("{model_key}.kind"), rule));
    }
    let bonds = strip::bonds(scene, &name);
    Ok((model_key, table.clone(), source.folder.clone(), bonds))
}

/// Returns the key under which a model stands in the file.
fn key_in(scene: &LoweredScene, name: &str) -> String {
    match scene.body {
        Some(_) if scene.zone.contains_key(name) => format!("zone.{name}"),
        Some(_) if name == "body" => name.to_owned(),
        _ => format!("model.{name}"),
    }
}

/// Returns a box along x with a corner at the origin.
pub(super) fn cuboid(high: [f64; 3]) -> BodyShape {
    BodyShape::Given(Shape::Box {
        low: [0.0; 3],
        high,
        hole: None,
    })
}

/// Returns the shape that the options give.
pub(super) fn shape_from_options(wanted: &Wanted) -> BodyShape {
    let from = [0.0; 3];
    match wanted.cylinder {
        Some([length, radius]) => BodyShape::Given(Shape::Cylinder { from, length, radius }),
        None => cuboid(wanted.cuboid.unwrap_or([1.0; 3])),
    }
}

/// Returns the table of a sample without a scene. Its shape only fills the field.
fn table_from_options() -> LoweredModel {
    LoweredModel {
        scale: 1.0,
        volume: None,
        crack: Vec::new(),
        materials: BTreeMap::new(),
        kind: ModelKind::spheres(),
        role: None,
        shape: cuboid([1.0; 3]),
        spacing: None,
        divisions: None,
        // Not used: the beams have constants of their own, and statics needs no density.
        material: Some(Material {
            young: 1.0,
            poisson: None,
            density: 1.0,
        }),
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
fn apply_options(wanted: &Wanted, table: &mut LoweredModel) {
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

/// Returns the bar of a shape in the frame of its container, and its width \[m\]; `None` for shapes that are
/// no bars along x.
fn bar(shape: &BodyShape) -> Option<(Bar, f64)> {
    match *shape.in_scene()? {
        Shape::Cylinder { length, radius, .. } => {
            let bar = Bar {
                start: 0.0,
                length,
                area: std::f64::consts::PI * radius * radius,
            };
            Some((bar, 2.0 * radius))
        }
        Shape::Box { low, high, .. } => {
            let edges = [0, 1, 2].map(|c| high[c] - low[c]);
            let bar = Bar {
                start: low[0],
                length: edges[0],
                area: edges[1] * edges[2],
            };
            Some((bar, edges[1].max(edges[2])))
        }
        Shape::Bar { .. } | Shape::Ball { .. } | Shape::File(_) => None,
    }
}

fn recipes(
    seeds: u64,
    model_key: &str,
    table: &LoweredModel,
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
    // From the seed of the scene on, so that the first packing is made like that of the scene.
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

fn periodic(wanted: &Wanted, model_key: String, table: LoweredModel, beam: BeamMaterial) -> Result<Sample> {
    if table.dem.file.is_some() {
        let rule = "spheres from a file are not periodic; remove --periodic";
        return Err(key(format!("{model_key}.dem.file"), rule));
    }
    let count = wanted.count.unwrap_or(PERIODIC);
    // Moduli do not depend on the size of the spheres, so any diameter will do.
    let diameter = table.spacing.unwrap_or(1e-3);
    // The cube has the volume fraction of a jammed periodic packing, so that the spheres fill it.
    let edge = (count as f64 * mean_sphere_volume(diameter) / JAMMED_PERIODIC).cbrt();
    let container = Container::periodic(edge).map_err(dem(&model_key))?;
    let first = table.dem.seed.unwrap_or(1);
    let recipes = (first..).take(wanted.seeds as usize).map(|seed| {
        let mut spec = spec(&table, container.clone(), count);
        spec.seed = seed;
        (Some(seed), Recipe::Made(Box::new(spec)))
    });
    Ok(Sample {
        text: format!("periodic cube of edge {edge:.4e} m"),
        notes: Vec::new(),
        beam,
        recipes: recipes.collect(),
        key: model_key,
        test: Test::Bulk,
        meant: None,
        table,
        folder: PathBuf::new(),
        notches: (Vec::new(), Vector3::zeros()),
    })
}

#[cfg(test)]
mod tests {
    use super::super::StrengthTest;
    use super::*;

    /// Returns whether the shape of a scene, a bar of 10 mm with 25 spheres of 0.4 mm along it, is tested
    /// itself.
    fn is_tested(wanted: &Wanted) -> bool {
        let text = "[model.bar]\nkind = \"dem\"\nspacing = 0.4e-3\n\
             shape.cylinder = { from = [0, 0, 0], length = 10.1e-3, radius = 1e-3 }\n\
             material = { young = 1e9, poisson = 0.2, density = 1000 }\n[time]\nsteps = 1\n";
        let wanted = Wanted {
            seeds: 1,
            ..wanted.clone()
        };
        let sample = Sample::from_options(&wanted, Some(&Source::new("bar.toml", text))).expect("a sample");
        assert_eq!(
            sample.notes.is_empty(),
            sample.text.starts_with("cylinder"),
            "{:?}",
            sample.notes
        );
        sample.notes.is_empty()
    }

    #[test]
    fn the_spheres_that_are_tested_decide_whether_a_shape_is_a_bar() {
        let spheres = |spacing: Option<f64>, count: Option<usize>| Wanted {
            spacing,
            count,
            ..Wanted::default()
        };
        assert!(is_tested(&Wanted::default()));
        assert!(is_tested(&spheres(Some(0.3e-3), None)));
        assert!(!is_tested(&spheres(Some(0.8e-3), None)), "12 diameters");
        // 600 spheres in the bar are of 0.4 mm, 100 of 0.73 mm.
        assert!(is_tested(&spheres(None, Some(700))));
        assert!(!is_tested(&spheres(None, Some(100))));
        let sized = |sizes: &[f64]| Wanted {
            strength: Some(StrengthTest {
                sizes: Some(sizes.to_vec()),
                ..StrengthTest::default()
            }),
            ..Wanted::default()
        };
        assert!(is_tested(&sized(&[0.3e-3, 0.4e-3])));
        assert!(!is_tested(&sized(&[0.3e-3, 0.5e-3])));
    }
}
