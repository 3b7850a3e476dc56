//! Probes: linear combinations of unknowns, forces, stresses and energy release rates.

mod between;
mod crack;
mod exerted;
mod place;
mod rules;
mod tensor;

pub(super) use crack::check as check_crack;
pub use exerted::Readings;
pub(super) use exerted::check as check_exerted;
pub(super) use place::{inside, placed};
pub(super) use rules::{axis, check, model};

use super::body::Body;
use super::interface::BuiltInterface;
use super::names::model_index;
use super::{select, weights};
use crate::error::{Result, core, key};
use crate::setup::LoweredScene;
use crate::spec::{Probe, Quantity, Reading};
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::core::ranks::Gather;
use arlequin::core::{Arms, Coupled, EnergyRelease, Subdomain};
use exerted::Exerted;
use rules::ONE_PLACE;
use tensor::TensorRow;

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
        scene: &LoweredScene,
        bodies: &[Body],
        joints: &[BuiltInterface],
    ) -> Result<Self> {
        let path = format!("probe.{name}");
        let exerted = |name: &str| {
            let what = Exerted::new(&path, name, probe, scene, bodies)?;
            Ok((what, axis(&path, probe)?.index()))
        };
        let numbered = || {
            let m = model_index(&format!("{path}.model"), model(&path, probe)?, scene)?;
            Ok((m, &bodies[m]))
        };
        let source = match (&probe.of, probe.quantity.reading()) {
            (Some(name), Reading::Moment) => {
                let (what, c) = exerted(name)?;
                Source::Moment(what, c)
            }
            // Quantities other than a force are refused here.
            (
                Some(name),
                Reading::Force
                | Reading::Displacements
                | Reading::Velocities
                | Reading::Tensor
                | Reading::Release,
            ) => {
                let (what, c) = exerted(name)?;
                Source::Force(what, c)
            }
            (None, Reading::Release) => {
                let (m, body) = numbered()?;
                let weights = weights::model_weights(m, joints)?;
                Source::Released(m, crack::release(&path, probe, body, &weights)?)
            }
            (None, Reading::Tensor) => Source::Tensor(tensor_row(&path, probe, numbered()?)?),
            (None, Reading::Displacements | Reading::Velocities | Reading::Force | Reading::Moment) => {
                Source::Motion(Row::new(&path, probe, numbered()?)?)
            }
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
        // A second call would number places of the gathered vector once more.
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
    fn new(path: &str, probe: &Probe, (model, body): (usize, &Body)) -> Result<Self> {
        let model_name = body.model.name();
        let count = body.model.layout().components;
        let c = axis(path, probe)?.index();
        if c >= count {
            let rule = format!("model '{model_name}' moves along x only; use \"x\"");
            return Err(key(format!("{path}.component"), rule));
        }
        check(path, probe)?;
        let is_velocity = match probe.quantity.reading() {
            Reading::Velocities => true,
            Reading::Displacements => false,
            Reading::Force | Reading::Moment | Reading::Tensor | Reading::Release => {
                let rule = format!("\"{}\" cannot be read here", probe.quantity.label());
                return Err(key(format!("{path}.quantity"), rule));
            }
        };
        let mut along_arms = None;
        let row = match (&probe.at, &probe.over) {
            (None, Some(selection)) if probe.quantity == Quantity::Rotation => {
                let nodes = select::nodes(&format!("{path}.where"), body, selection)?;
                let [row, stretch] = rotation(path, body, &nodes, c)?;
                along_arms = (body.model.views().arms == Arms::Current).then_some(stretch);
                row
            }
            (Some(at), None) => {
                let (nodes, values) = placed(path, model_name, at, body)?;
                let row = nodes.iter().zip(values);
                row.map(|(n, v)| (n * count + c, v)).collect()
            }
            (None, Some(selection)) => {
                let nodes = select::nodes(&format!("{path}.where"), body, selection)?;
                // The plain mean over the nodes, whatever their masses.
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
            // The ratio of both sums is the tangent of the angle, at any size of the rotation.
            Some(along_arms) => sum(&self.row).atan2(1.0 + sum(along_arms)),
            None => sum(&self.row),
        }
    }
}

/// Refuses a probe of motion, stress or strain that model number `m` of a scene cannot have.
pub(super) fn check_built(path: &str, probe: &Probe, (m, body): (usize, &Body)) -> Result<()> {
    match (&probe.of, probe.quantity.reading()) {
        (Some(_), _) | (None, Reading::Release) => Ok(()),
        (None, Reading::Tensor) => tensor_row(path, probe, (m, body)).map(|_| ()),
        (None, _) => Row::new(path, probe, (m, body)).map(|_| ()),
    }
}

fn tensor_row(path: &str, probe: &Probe, (number, body): (usize, &Body)) -> Result<TensorRow> {
    check(path, probe)?;
    let place = probe
        .at
        .as_ref()
        .map(|point| placed(path, body.model.name(), point, body));
    TensorRow::new(path, probe, (number, body), place.transpose()?)
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
    // Nodes on the axis have no arms: the least-squares rotation would be 0/0.
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
        // Zero factors would be read in every step, and on several ranks sent.
        across_arms.filter(|(_, f)| *f != 0.0).collect(),
        along_arms.filter(|(_, f)| *f != 0.0).collect(),
    ])
}
