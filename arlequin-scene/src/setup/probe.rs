//! Probes: a row of unknowns and factors, read each time.

use super::drive::model_index;
use super::kinds::Body;
use super::plausible::corners;
use super::select;
use crate::error::{Error, Result, core, key, value};
use crate::spec::{Probe, Quantity, SceneSpec};
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::core::{Arms, ShapeRow, Subdomain};

/// A probe, ready to be read.
#[derive(Debug, Clone)]
pub struct ProbeReader {
    /// Name.
    pub name: String,
    /// What it reads.
    pub quantity: Quantity,
    model: usize,
    row: Vec<(usize, f64)>,
    /// For rotations of a model that may turn far: displacements along the arms, as the row has them across.
    along: Option<Vec<(usize, f64)>>,
}

impl ProbeReader {
    /// Prepares `[probe.NAME]`.
    pub fn new(name: &str, probe: &Probe, scene: &SceneSpec, bodies: &[Body]) -> Result<Self> {
        let path = format!("probe.{name}");
        let model = model_index(&format!("{path}.model"), &probe.model, scene)?;
        let body = &bodies[model];
        let count = body.model.layout().components;
        let c = probe.component.index();
        if c >= count {
            let rule = format!("model '{}' moves along x only; use \"x\"", probe.model);
            return Err(key(format!("{path}.component"), rule));
        }
        check(&path, probe)?;
        let mut along = None;
        let row = match (&probe.at, &probe.over) {
            (None, Some(selection)) if probe.quantity == Quantity::Rotation => {
                let nodes = select::nodes(&format!("{path}.where"), body, selection)?;
                let [row, stretch] = rotation(&path, body, &nodes, c)?;
                along = (body.model.arms() == Arms::Current).then_some(stretch);
                row
            }
            (Some(at), None) => {
                let mut row = ShapeRow::default();
                let x = Point3::from(*at);
                let placed = body.field.shape_at(&x, false, &mut row);
                placed.map_err(|e| outside(&path, &probe.model, &x, body, e))?;
                row.nodes
                    .iter()
                    .zip(&row.values)
                    .map(|(n, v)| (n * count + c, *v))
                    .collect()
            }
            (None, Some(selection)) => {
                let nodes = select::nodes(&format!("{path}.where"), body, selection)?;
                let share = 1.0 / nodes.len() as f64;
                nodes.iter().map(|n| (n * count + c, share)).collect()
            }
            _ => return Err(key(path, "needs exactly one of at, where")),
        };
        Ok(Self {
            name: name.to_owned(),
            quantity: probe.quantity,
            model,
            row,
            along,
        })
    }

    /// Current value.
    pub fn read(&self, subdomains: &[Subdomain<f64>]) -> f64 {
        let state = subdomains[self.model].state();
        let values = match self.quantity {
            Quantity::Displacement | Quantity::Rotation => &state.q,
            Quantity::Velocity => &state.v,
        };
        let sum = |row: &[(usize, f64)]| row.iter().map(|(d, n)| n * values[*d]).sum::<f64>();
        match &self.along {
            Some(along) => sum(&self.row).atan2(1.0 + sum(along)),
            None => sum(&self.row),
        }
    }
}

/// Refuses a probe that says not one place.
pub(super) fn check(path: &str, probe: &Probe) -> Result<()> {
    match (&probe.at, &probe.over) {
        (Some(_), None) if probe.quantity == Quantity::Rotation => Err(key(
            format!("{path}.at"),
            "a rotation is that of a group of nodes; give where",
        )),
        (Some(_), None) | (None, Some(_)) => Ok(()),
        _ => Err(key(path, "needs exactly one of at, where")),
    }
}

/// Refuses a point outside the box around a model.
pub(super) fn inside(path: &str, model: &str, x: &Point3<f64>, [low, high]: [[f64; 3]; 2]) -> Result<()> {
    let size = low.iter().chain(&high).fold(0.0_f64, |s, c| s.max(c.abs()));
    let slack = 1e-9 * size;
    // A line has no width.
    let out = (0..3).any(|c| high[c] > low[c] && !(low[c] - slack..=high[c] + slack).contains(&x[c]));
    if out {
        Err(beyond(path, model, x, low, high))
    } else {
        Ok(())
    }
}

fn beyond(path: &str, model: &str, x: &Point3<f64>, low: [f64; 3], high: [f64; 3]) -> Error {
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

/// Says where the model is, to whoever put a probe beside it.
fn outside(path: &str, model: &str, x: &Point3<f64>, body: &Body, e: arlequin::core::Error) -> Error {
    if !matches!(e, arlequin::core::Error::OutsideDomain { .. }) {
        return core(format!("{path}.at"))(e);
    }
    let [low, high] = corners(body.model.nodes());
    beyond(path, model, x, low.into(), high.into())
}

/// Least-squares rotation of nodes about axis `c` through their centroid: the rows of `s = Σ e·(r × u) / Σ |e × r|²`, which is
/// the angle while it is small, and of `k = Σ r·(u − e e·u) / Σ |e × r|²`: any angle is `atan2(s, 1 + k)`.
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
    let of = |n: usize, factors: Vector3<f64>| (0..3).map(move |a| (3 * n + a, factors[a] / polar));
    let across = nodes.iter().flat_map(|&n| of(n, arm(n)));
    let along = nodes.iter().flat_map(|&n| of(n, arm(n).cross(&axis)));
    Ok([
        across.filter(|(_, f)| *f != 0.0).collect(),
        along.filter(|(_, f)| *f != 0.0).collect(),
    ])
}
