//! Probes: linear combinations of unknowns, forces, stresses and energy release rates.

use super::drive::model_index;
use super::exerted::{Exerted, Readings};
use super::interface::BuiltInterface;
use super::kinds::Body;
use super::plausible::corners;
use super::select;
use super::tensor::{self, TensorRow};
use super::{crack, weights, zone};
use crate::error::{Error, Result, core, key, value};
use crate::spec::{Axis, Probe, Quantity, SceneSpec, Selection};
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::core::ranks::Gather;
use arlequin::core::{Arms, Coupled, EnergyRelease, ShapeRow, Subdomain};

/// A probe that is ready to be read.
#[derive(Debug, Clone)]
pub struct ProbeReader {
    /// Name of the probe.
    pub name: String,
    /// Quantity that the probe reads.
    pub quantity: Quantity,
    source: Source,
}

/// Source of the value.
#[derive(Debug, Clone)]
enum Source {
    /// Linear combination of the unknowns of a model.
    Motion(Row),
    /// Component of a force on the models.
    Force(Exerted, usize),
    /// Component of a moment on the models.
    Moment(Exerted, usize),
    /// Stress or strain.
    Tensor(TensorRow),
    /// Number of the model, and the energy release rate of a crack in it.
    Released(usize, EnergyRelease<f64>),
}

/// Numbers of unknowns with their factors.
#[derive(Debug, Clone)]
struct Row {
    model: usize,
    /// True for velocities, false for displacements and rotations.
    is_velocity: bool,
    row: Vec<(usize, f64)>,
    /// For rotations of a model with finite rotations: displacements along the arms; `row` has those across.
    along_arms: Option<Vec<(usize, f64)>>,
    /// For a partitioned model: gathers the unknowns of both lists; these then hold places in the gathered
    /// vector.
    parts: Option<Gather>,
}

impl ProbeReader {
    /// Prepares `[probe.NAME]`.
    pub(super) fn new(
        name: &str,
        probe: &Probe,
        scene: &SceneSpec,
        bodies: &[Body],
        joints: &[BuiltInterface],
    ) -> Result<Self> {
        let path = format!("probe.{name}");
        let source = match &probe.of {
            Some(exerted_name) => {
                let what = Exerted::new(&path, exerted_name, probe, scene, bodies)?;
                let c = axis(&path, probe)?.index();
                match probe.quantity {
                    Quantity::Force => Source::Force(what, c),
                    Quantity::Moment => Source::Moment(what, c),
                    Quantity::Displacement
                    | Quantity::Velocity
                    | Quantity::Rotation
                    | Quantity::Stress
                    | Quantity::Strain
                    | Quantity::VonMises
                    | Quantity::PrincipalStress
                    | Quantity::EnergyRelease => return Err(no_reading(&path, probe)),
                }
            }
            None if probe.crack.is_some() || probe.quantity == Quantity::EnergyRelease => {
                let model_name = model(&path, probe)?;
                let m = model_index(&format!("{path}.model"), model_name, scene)?;
                let weights = weights::model_weights(m, joints)?;
                Source::Released(m, crack::release(&path, probe, &bodies[m], &weights)?)
            }
            None if probe.quantity.is_recovered() => Source::Tensor(tensor_row(&path, probe, scene, bodies)?),
            None => Source::Motion(Row::new(&path, probe, scene, bodies)?),
        };
        Ok(Self {
            name: name.to_owned(),
            quantity: probe.quantity,
            source,
        })
    }

    /// Warning about the values of the probe, if any.
    pub(super) fn warning(&self, bodies: &[Body]) -> Option<String> {
        match &self.source {
            Source::Tensor(row) => row.warning(&self.name, bodies),
            _ => None,
        }
    }

    /// Prepares the probe for a partitioned model: its unknowns are gathered from all ranks from now on.
    pub(crate) fn set_up_gather(&mut self, run: &Coupled<f64>) {
        let Source::Motion(row) = &mut self.source else {
            return;
        };
        let s = &run.subdomains()[row.model];
        let owned = s.owned();
        if !owned.is_part() || row.parts.is_some() {
            return;
        }
        let components = s.model().layout().components;
        let mut entries: Vec<&mut (usize, f64)> = row
            .row
            .iter_mut()
            .chain(row.along_arms.iter_mut().flatten())
            .collect();
        row.parts = Some(Gather::new(&owned, components, entries.iter().map(|r| r.0)));
        // From now on rows index the gathered vector.
        entries.iter_mut().enumerate().for_each(|(place, r)| r.0 = place);
    }

    /// Returns the current value. Collective for partitioned models.
    ///
    /// # Errors
    /// An evaluation of forces, stresses or the energy release rate that fails.
    pub fn read<'a>(&'a self, run: &mut Coupled<f64>, readings: &mut Readings<'a>) -> Result<f64> {
        match &self.source {
            Source::Motion(row) => Ok(row.read(run.subdomains())),
            Source::Tensor(row) => row.read(self.quantity, run.subdomains()),
            Source::Released(m, crack) => {
                let release = run.energy_release(*m, crack);
                release.map_err(core(format!("probe.{}", self.name)))
            }
            Source::Force(what, c) => Ok(readings.resultant(what, run)?.force[*c]),
            Source::Moment(what, c) => Ok(readings.resultant(what, run)?.moment[*c]),
        }
    }
}

impl Row {
    fn new(path: &str, probe: &Probe, scene: &SceneSpec, bodies: &[Body]) -> Result<Self> {
        let model_name = model(path, probe)?;
        let model = model_index(&format!("{path}.model"), model_name, scene)?;
        let body = &bodies[model];
        let count = body.model.layout().components;
        let c = axis(path, probe)?.index();
        if c >= count {
            let rule = format!("model '{model_name}' moves along x only; use \"x\"");
            return Err(key(format!("{path}.component"), rule));
        }
        check(path, probe)?;
        let is_velocity = match probe.quantity {
            Quantity::Velocity => true,
            Quantity::Displacement | Quantity::Rotation => false,
            Quantity::Force
            | Quantity::Moment
            | Quantity::Stress
            | Quantity::Strain
            | Quantity::VonMises
            | Quantity::PrincipalStress
            | Quantity::EnergyRelease => return Err(no_reading(path, probe)),
        };
        let mut along_arms = None;
        let row = match (&probe.at, &probe.over) {
            (None, Some(selection)) if probe.quantity == Quantity::Rotation => {
                let nodes = chosen(path, selection, model, scene, bodies)?;
                let [row, stretch] = rotation(path, body, &nodes, c)?;
                along_arms = (body.model.arms() == Arms::Current).then_some(stretch);
                row
            }
            (Some(at), None) => {
                let (nodes, values) = placed(path, model_name, at, body)?;
                let row = nodes.iter().zip(values);
                row.map(|(n, v)| (n * count + c, v)).collect()
            }
            (None, Some(selection)) => {
                let nodes = chosen(path, selection, model, scene, bodies)?;
                let share = 1.0 / nodes.len() as f64;
                nodes.iter().map(|n| (n * count + c, share)).collect()
            }
            _ => return Err(key(path, ONE_PLACE)),
        };
        Ok(Self {
            model,
            is_velocity,
            row,
            along_arms,
            parts: None,
        })
    }

    fn read(&self, subdomains: &[Subdomain<f64>]) -> f64 {
        let state = subdomains[self.model].state();
        let values = if self.is_velocity { &state.v } else { &state.q };
        let gathered = self.parts.as_ref().map(|g| g.gathered(1, values));
        let values = gathered.as_ref().unwrap_or(values);
        let sum = |row: &[(usize, f64)]| row.iter().map(|(d, n)| n * values[*d]).sum::<f64>();
        match &self.along_arms {
            Some(along_arms) => sum(&self.row).atan2(1.0 + sum(along_arms)),
            None => sum(&self.row),
        }
    }
}

/// Error of a quantity that the place of a probe does not have.
fn no_reading(path: &str, probe: &Probe) -> Error {
    let rule = format!("\"{}\" cannot be read here", probe.quantity.label());
    key(format!("{path}.quantity"), rule)
}

/// Nodes of a model that a probe selects.
///
/// # Errors
/// No nodes; the error names a zone of the body that has some.
pub(super) fn chosen(
    path: &str,
    selection: &Selection,
    model: usize,
    scene: &SceneSpec,
    bodies: &[Body],
) -> Result<Vec<usize>> {
    let path = format!("{path}.where");
    let nodes_on = |m: usize| select::nodes(&path, &bodies[m], selection);
    let nodes = nodes_on(model);
    let zones = || zone::parts(scene, model).into_iter().filter(|m| *m != model);
    match (nodes, zones().find(|m| nodes_on(*m).is_ok())) {
        (Err(_), Some(zone)) => {
            let name = bodies[zone].model.name();
            let rule = format!(
                "{selection} holds nodes of zone '{name}' only, and model '{}' is the body outside its zones; give model = \"{name}\"",
                bodies[model].model.name()
            );
            Err(key(path, rule))
        }
        (nodes, _) => nodes,
    }
}

/// Nodes and shape functions at a point.
///
/// # Errors
/// A point outside of the model; the error names the extent of the model.
pub(super) fn placed(
    path: &str,
    model_name: &str,
    point: &[f64; 3],
    body: &Body,
) -> Result<(Vec<usize>, Vec<f64>)> {
    let mut row = ShapeRow::default();
    let x = Point3::from(*point);
    let located = body.field.shape_at(&x, false, &mut row);
    located.map_err(|e| outside(path, model_name, &x, body, e))?;
    Ok((row.nodes, row.values))
}

fn tensor_row(path: &str, probe: &Probe, scene: &SceneSpec, bodies: &[Body]) -> Result<TensorRow> {
    let model_name = model(path, probe)?;
    let number = model_index(&format!("{path}.model"), model_name, scene)?;
    check(path, probe)?;
    let body = &bodies[number];
    let place = probe
        .at
        .as_ref()
        .map(|point| placed(path, model_name, point, body));
    TensorRow::new(path, probe, (number, scene, bodies), place.transpose()?)
}

/// Direction that a probe of a vector must name.
pub(super) fn axis(path: &str, probe: &Probe) -> Result<Axis> {
    let rule = "one of \"x\", \"y\", \"z\"";
    let key_path = format!("{path}.component");
    match probe.component {
        None => Err(key(key_path, format!("is needed: {rule}"))),
        Some(c) => c
            .axis()
            .ok_or_else(|| value(key_path, c.name(), &format!("is no direction; take {rule}"))),
    }
}

const ONE_PLACE: &str = "needs exactly one of at, where, of, crack";

/// Model that a probe of motion must name.
pub(super) fn model<'a>(path: &str, probe: &'a Probe) -> Result<&'a str> {
    let missing = || {
        let rule = "is needed: the name of the model that is looked at";
        key(format!("{path}.model"), rule)
    };
    probe.model.as_deref().ok_or_else(missing)
}

/// Refuses a probe that does not name exactly one place, or whose other keys do not fit its quantity.
pub(super) fn check(path: &str, probe: &Probe) -> Result<()> {
    if matches!(probe.quantity, Quantity::Force | Quantity::Moment) {
        let rule = "is what something exerts on the models; name it with of = \"…\" in place of at and where";
        return Err(key(format!("{path}.quantity"), rule));
    }
    crack::check_quantity(path, probe)?;
    tensor::check(path, probe.quantity, probe.component)?;
    if probe.about.is_some() {
        let rule = "is the point of a moment; remove it";
        return Err(key(format!("{path}.about"), rule));
    }
    match (&probe.at, &probe.over) {
        (None, None) if probe.crack.is_some() => Ok(()),
        (Some(_), None) if probe.crack.is_none() && probe.quantity == Quantity::Rotation => Err(key(
            format!("{path}.at"),
            "a rotation is that of a group of nodes; give where",
        )),
        (Some(_), None) | (None, Some(_)) if probe.crack.is_none() => Ok(()),
        _ => Err(key(path, ONE_PLACE)),
    }
}

/// Refuses a point outside of the bounding box of a model.
pub(super) fn inside(path: &str, model: &str, x: &Point3<f64>, [low, high]: [[f64; 3]; 2]) -> Result<()> {
    let size = low.iter().chain(&high).fold(0.0_f64, |s, c| s.max(c.abs()));
    let slack = 1e-9 * size;
    // A line has no width, so only directions with an extent are checked.
    let out = (0..3).any(|c| high[c] > low[c] && !(low[c] - slack..=high[c] + slack).contains(&x[c]));
    if out {
        Err(outside_box(path, model, x, low, high))
    } else {
        Ok(())
    }
}

fn outside_box(path: &str, model: &str, x: &Point3<f64>, low: [f64; 3], high: [f64; 3]) -> Error {
    let rule = format!(
        "lies outside model '{model}', which reaches from {low:?} to {high:?} m; move the probe into it, or name another \
         model"
    );
    value(
        format!("{path}.at"),
        format_args!("{:?} m", x.coords.as_slice()),
        &rule,
    )
}

/// Turns the error about a point outside of a model into one that names the extent of the model.
fn outside(path: &str, model: &str, x: &Point3<f64>, body: &Body, e: arlequin::core::Error) -> Error {
    if !matches!(e, arlequin::core::Error::OutsideDomain { .. }) {
        return core(format!("{path}.at"))(e);
    }
    let [low, high] = corners(body.model.nodes());
    outside_box(path, model, x, low.into(), high.into())
}

/// Rows of the least-squares rotation of nodes about axis `c` through their centroid:
/// `s = Σ e·(r × u) / Σ |e × r|²`, which is the angle if it is small, and `k = Σ r·(u − e e·u) / Σ |e × r|²`.
/// The angle of a finite rotation is `atan2(s, 1 + k)`.
fn rotation(path: &str, body: &Body, nodes: &[usize], c: usize) -> Result<[Vec<(usize, f64)>; 2]> {
    let count = body.model.layout().components;
    let points = body.model.nodes();
    let sum = nodes.iter().fold(Vector3::zeros(), |s, &n| s + points[n].coords);
    let centre = Point3::from(sum / nodes.len() as f64);
    let axis = Vector3::ith(c, 1.0);
    let arm = |n: usize| axis.cross(&(points[n] - centre));
    let polar: f64 = nodes.iter().map(|&n| arm(n).norm_squared()).sum();
    if polar <= 0.0 || count < 3 {
        return Err(key(
            path,
            "a rotation needs several nodes around its axis; choose a larger group",
        ));
    }
    let entries = |n: usize, factors: Vector3<f64>| (0..3).map(move |a| (3 * n + a, factors[a] / polar));
    let across_arms = nodes.iter().flat_map(|&n| entries(n, arm(n)));
    let along_arms = nodes.iter().flat_map(|&n| entries(n, arm(n).cross(&axis)));
    Ok([
        across_arms.filter(|(_, f)| *f != 0.0).collect(),
        along_arms.filter(|(_, f)| *f != 0.0).collect(),
    ])
}
