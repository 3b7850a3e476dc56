//! Total forces on surfaces that lie in an overlap: each model spreads them over its own surface and counts them with its weight, so
//! that what acts may be another force than the one that is asked for.

use super::kinds::Body;
use super::{drive, select};
use crate::error::{Result, core};
use crate::spec::SceneSpec;
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::core::{Coupled, Uniform};

/// Share of the force by which it may be another one.
const SAME: f64 = 0.01;

/// Where a total force acts: places with their parts of it, which sum to one.
#[derive(Debug)]
pub(super) struct Total {
    load: usize,
    model: usize,
    parts: Vec<(Point3<f64>, f64)>,
}

/// The total forces of a scene.
pub(super) fn of(scene: &SceneSpec, bodies: &[Body]) -> Result<Vec<Total>> {
    let mut out = Vec::new();
    for (load, l) in scene.load.iter().enumerate().filter(|(_, l)| l.force.is_some()) {
        let path = format!("load[{load}]");
        let model = drive::model_index(&format!("{path}.model"), &l.model, scene)?;
        let body = &bodies[model];
        let at = format!("{path}.where");
        let mut parts: Vec<_> = match select::facets(&at, body, &l.at)? {
            Some(facets) => facets.iter().map(|f| (f.centre, f.area())).collect(),
            None => {
                let layout = body.model.layout();
                let mut masses = vec![0.0; layout.dofs()];
                let weighed = body.model.lumped_inertia(&Uniform(1.0), &mut masses);
                weighed.map_err(core(path))?;
                let nodes = select::nodes(&at, body, &l.at)?;
                let part = |n: &usize| (body.model.nodes()[*n], masses[n * layout.components]);
                nodes.iter().map(part).collect()
            }
        };
        let sum: f64 = parts.iter().map(|p| p.1).sum();
        parts.iter_mut().for_each(|p| p.1 /= sum);
        out.push(Total { load, model, parts });
    }
    Ok(out)
}

/// Loads of one name, or without a name and of one force, are halves of one load: a line for each that is not what it says.
pub(super) fn warnings(scene: &SceneSpec, totals: &[Total], run: &Coupled<f64>) -> Vec<String> {
    let key = |t: &Total| {
        let l = &scene.load[t.load];
        (l.name.clone(), l.force.unwrap_or_default().map(f64::to_bits))
    };
    let mut out = Vec::new();
    for (k, first) in totals.iter().enumerate() {
        let halves = totals[k..].iter().filter(|t| key(t) == key(first));
        if totals[..k].iter().any(|t| key(t) == key(first)) {
            continue;
        }
        let share = |t: &Total| {
            let weight = &run.subdomains()[t.model].weights().external;
            t.parts.iter().map(|(x, part)| part * weight.at(x)).sum::<f64>()
        };
        let shares: Vec<f64> = halves.map(share).collect();
        let acts: f64 = shares.iter().sum();
        // Without an overlap every load is whole, several of one name included.
        if (acts - 1.0).abs() <= SAME || shares.iter().all(|s| (s - 1.0).abs() <= SAME) {
            continue;
        }
        let l = &scene.load[first.load];
        let force = Vector3::from(l.force.unwrap_or_default()).norm();
        out.push(format!(
            "load[{}]: of the {force:.4e} N of '{}' {:.4e} N act: its surface lies in an overlap, wholly or in part, where every \
             model spreads the force over its own surface and counts it with its weight; give a traction [Pa] in all models that are \
             there, or a surface that has no part in the overlap",
            first.load,
            drive::load_name(first.load, l),
            acts * force,
        ));
    }
    out
}
