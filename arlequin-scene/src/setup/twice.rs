//! Supports that have nodes in common, as those of two faces with an edge: which one holds a component there must be said.

use super::kinds::Body;
use super::{drive, select};
use crate::error::{Result, key};
use crate::spec::{Axis, SceneSpec};
use std::collections::BTreeMap;

/// Refuses a component of a node that two supports prescribe.
pub(super) fn check(scene: &SceneSpec, bodies: &[Body]) -> Result<()> {
    let mut held: BTreeMap<(usize, usize, usize), usize> = BTreeMap::new();
    for (k, s) in scene.support.iter().enumerate() {
        let path = format!("support[{k}]");
        let m = drive::model_index(&format!("{path}.model"), &s.model, scene)?;
        let body = &bodies[m];
        let count = body.model.layout().components;
        let all = [Axis::X, Axis::Y, Axis::Z];
        let axes = s.components.as_deref().unwrap_or(&all[..count]);
        let nodes = select::nodes(&format!("{path}.where"), body, &s.at)?;
        let (mut first, mut others) = (None, 0);
        for n in nodes {
            for axis in axes {
                match held.insert((m, n, axis.index()), k) {
                    None => {}
                    Some(by) if first.is_none() => first = Some((by, n, axis.index())),
                    Some(_) => others += 1,
                }
            }
        }
        if let Some((by, n, c)) = first {
            let (x, axis) = (&body.model.nodes()[n], ["x", "y", "z"][c]);
            let rule = format!(
                "holds {axis} of the node of '{}' at ({:.4e}, {:.4e}, {:.4e}) m, as support[{by}] does, and {others} more components of \
                 nodes likewise; leave \"{axis}\" out of the components of one of them, or choose its nodes with a box that leaves \
                 out what both have",
                s.model, x.x, x.y, x.z
            );
            return Err(key(format!("{path}.where"), rule));
        }
    }
    Ok(())
}
