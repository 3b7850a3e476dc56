//! Probes: a row of unknowns and factors, read each time.

use super::drive::model_index;
use super::kinds::Body;
use super::select;
use crate::error::{Result, core, key};
use crate::scene::{Probe, Quantity, Scene};
use arlequin::core::Subdomain;
use arlequin::core::field::ShapeRow;
use arlequin::core::nalgebra::Point3;

/// A probe, ready to be read.
#[derive(Debug, Clone)]
pub(crate) struct Reader {
    /// Name.
    pub(crate) name: String,
    /// What it reads.
    pub(crate) quantity: Quantity,
    model: usize,
    row: Vec<(usize, f64)>,
}

impl Reader {
    /// Prepares `[probe.NAME]`.
    pub(crate) fn new(name: &str, probe: &Probe, scene: &Scene, bodies: &[Body]) -> Result<Self> {
        let path = format!("probe.{name}");
        let model = model_index(&format!("{path}.model"), &probe.model, scene)?;
        let body = &bodies[model];
        let count = body.model.layout().components;
        let c = probe.component.index();
        if c >= count {
            let rule = format!("model '{}' moves along x only; use \"x\"", probe.model);
            return Err(key(format!("{path}.component"), rule));
        }
        let row = match (&probe.at, &probe.over) {
            (Some(at), None) => {
                let mut row = ShapeRow::default();
                body.field
                    .shape_at(&Point3::from(*at), false, &mut row)
                    .map_err(core(format!("{path}.at")))?;
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
        })
    }

    /// Current value.
    pub(crate) fn read(&self, subdomains: &[Subdomain<f64>]) -> f64 {
        let state = subdomains[self.model].state();
        let values = match self.quantity {
            Quantity::Displacement => &state.q,
            Quantity::Velocity => &state.v,
        };
        self.row.iter().map(|(d, n)| n * values[*d]).sum()
    }
}
