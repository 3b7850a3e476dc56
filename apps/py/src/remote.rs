//! Solvers in other processes as participants.

use crate::error::Fault;
use arlequin::core::{Interpolation, ParticleField};
use arlequin::fem_ref::{ElementKind, FemField, Mesh};
use arlequin_link::{Address, Description, Element, Options, Remote, Shape};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// How a solver is reached.
pub(crate) enum Place {
    /// By starting this command.
    Command(Vec<String>),
    /// By waiting at this address for a solver that somebody else starts.
    Address(String),
}

impl Place {
    /// Returns the place from the one argument that is given.
    pub(crate) fn from_arguments(
        command: Option<Vec<String>>,
        address: Option<String>,
    ) -> Result<Self, Fault> {
        match (command, address) {
            (Some(c), None) if !c.is_empty() => Ok(Self::Command(c)),
            (None, Some(a)) => Ok(Self::Address(a)),
            _ => {
                let rule = "a solver elsewhere needs either command=[\"python3\", \"solver.py\"] or address=\"unix:PATH\"";
                Err(Fault::new("Key", rule))
            }
        }
    }
}

/// Connects to a solver and returns it with its field. The solver must connect within `start` [s], by
/// default 30 s or `timeout` if that is longer, and answer within `timeout` [s].
pub(crate) fn meet(
    name: &str,
    place: &Place,
    timeout: f64,
    start: Option<f64>,
) -> Result<(Remote, Arc<dyn Interpolation<f64>>), Fault> {
    let time = |what: &str, seconds: f64| {
        Duration::try_from_secs_f64(seconds).map_err(|e| {
            let rule = format!("{what} = {seconds} s: {e}; give a positive time, such as 4.0");
            Fault::new("InvalidParameter", rule)
        })
    };
    let (timeout, usual) = (time("timeout", timeout)?, Options::default());
    let options = Options {
        start: start.map_or(Ok(usual.start.max(timeout)), |s| time("start_timeout", s))?,
        timeout,
        ..usual
    };
    let solver = match place {
        // Commands are found from the current folder, as in a shell.
        Place::Command(command) => Remote::start(name, command, Path::new("."), options)?,
        Place::Address(address) => Remote::await_at(name, &address.parse::<Address>()?, options)?,
    };
    let field = field_of(solver.description())?;
    Ok((solver, field))
}

/// Returns the field that a solver describes: particles or a mesh.
fn field_of(d: &Description) -> Result<Arc<dyn Interpolation<f64>>, Fault> {
    match &d.shape {
        Shape::Particles { volumes, pairs } => {
            let field = ParticleField::new(d.nodes.clone(), volumes)?;
            let field = if pairs.is_empty() {
                field
            } else {
                field.with_gradients(pairs)?
            };
            Ok(Arc::new(field))
        }
        Shape::Mesh {
            element,
            connectivity,
            section,
        } => {
            let kind = match element {
                Element::Line => ElementKind::Bar2,
                Element::Tetrahedron => ElementKind::Tet4,
                Element::Hexahedron => ElementKind::Hex8,
            };
            let mesh = Mesh::new(kind, d.nodes.clone(), connectivity.clone())?;
            let lines = kind == ElementKind::Bar2;
            let mesh = if lines { mesh.with_section(*section)? } else { mesh };
            Ok(Arc::new(FemField::new(mesh)))
        }
    }
}
