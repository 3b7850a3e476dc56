//! Key `crack` of a model: separates a mesh along faces of its elements.

use super::select;
use crate::error::{Result, fem, key, unknown};
use crate::setup::LoweredModel;
use crate::spec::Selection;
use arlequin::core::nalgebra::Point3;
use arlequin::fem_ref::Mesh;

/// Refuses cracks in a model without element faces; `refusal` is the reason that its kind gives.
pub(super) fn check(key_of_model: &str, table: &LoweredModel, refusal: Option<&str>) -> Result<()> {
    let path = format!("{key_of_model}.crack");
    for (k, place) in table.crack.iter().enumerate() {
        if let Selection::Box(low, high) = place {
            select::check_box(&format!("{path}[{k}]"), low, high)?;
        }
    }
    let rule = match (refusal, table.shape.is_line()) {
        _ if table.crack.is_empty() => return Ok(()),
        (Some(rule), _) => rule,
        (None, true) => "a bar that is cut is two bars; write two models",
        (None, false) => return Ok(()),
    };
    Err(key(path, rule))
}

/// Returns the mesh with the cracks of a table.
pub(super) fn cut(key_of_model: &str, table: &LoweredModel, mut mesh: Mesh<f64>) -> Result<Mesh<f64>> {
    for (k, place) in table.crack.iter().enumerate() {
        let path = format!("{key_of_model}.crack[{k}]");
        let slack = select::slack(mesh.spacing());
        let cut = match place {
            Selection::Box(low, high) => {
                mesh.with_crack(|_, x: &Point3<f64>| select::inside(low, high, x, slack))
            }
            Selection::Group(name) => {
                let group = mesh.groups().get(name);
                let group =
                    group.ok_or_else(|| unknown(&path, name, "group of the mesh", mesh.groups().keys()))?;
                let nodes = &group.nodes;
                mesh.with_crack(|node, _| nodes.binary_search(&(node as u32)).is_ok())
            }
        };
        mesh = cut.map_err(fem(&path))?;
    }
    Ok(mesh)
}
