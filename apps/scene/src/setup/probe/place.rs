//! Places of probes: points of models.

use super::between::shape_between;
use crate::error::{Error, Result, core, value};
use crate::setup::body::Body;
use crate::setup::shapes::corners;
use arlequin::core::Error::OutsideDomain;
use arlequin::core::ShapeRow;
use arlequin::core::nalgebra::Point3;
use std::sync::atomic::Ordering::Relaxed;

/// Number of probes of a model up to which each one looks for the particles around its point. More probes
/// share the tetrahedra of all particles.
const FEW: usize = 32;
/// Distance to the nearest particle, in its diameters or in spacings, from which on a point lies in a notch
/// or a hole. Between packed spheres it is less than one; across a gap, a mean of both sides would be no
/// motion of either.
const VOID: f64 = 1.5;

/// Nodes and shape functions at a point.
///
/// # Errors
/// A point outside of the model; the error names the extent of the model.
pub(in crate::setup) fn placed(
    path: &str,
    model_name: &str,
    point: &[f64; 3],
    body: &Body,
) -> Result<(Vec<usize>, Vec<f64>)> {
    let x = Point3::from(*point);
    // Particles have values at their centres alone. For many points, tetrahedra of all of them pay.
    let particles = body.grains.as_ref().filter(|_| body.field.samples().is_some());
    let nodes = body.model.nodes();
    let located = if particles.is_some_and(|g| g.points.fetch_add(1, Relaxed) < FEW) {
        shape_between(nodes, body.spacing, &x)
    } else {
        let mut row = ShapeRow::default();
        body.field.shape_at(&x, false, &mut row).map(|()| row)
    };
    // The nearest particle is a natural neighbour.
    let far = |k: &usize| {
        let diameter = 2.0 * body.grid.radii.get(*k).copied().unwrap_or_default();
        (nodes[*k] - x).norm() > VOID * body.spacing.max(diameter)
    };
    let in_void = |row: &ShapeRow<f64>| particles.is_some() && row.nodes.iter().all(far);
    match located {
        Ok(row) if !in_void(&row) => Ok((row.nodes, row.values)),
        Ok(_) | Err(OutsideDomain { .. }) => Err(outside(path, model_name, &x, body)),
        Err(e) => Err(core(format!("{path}.at"))(e)),
    }
}

/// Refuses a point outside of the bounding box of a model.
pub(in crate::setup) fn inside(
    path: &str,
    model: &str,
    x: &Point3<f64>,
    [low, high]: [[f64; 3]; 2],
) -> Result<()> {
    let size = low.iter().chain(&high).fold(0.0_f64, |s, c| s.max(c.abs()));
    // Coordinates in scenes are rounded: a point on a face must count as inside.
    let slack = 1e-9 * size;
    // A line has no width, so only directions with an extent are checked.
    let out = (0..3).any(|c| high[c] > low[c] && !(low[c] - slack..=high[c] + slack).contains(&x[c]));
    if out {
        Err(outside_box(path, model, x, [low, high], None))
    } else {
        Ok(())
    }
}

/// Refuses a point; `nearest` is the node of the model next to it, if the model is built.
fn outside_box(
    path: &str,
    model: &str,
    x: &Point3<f64>,
    [low, high]: [[f64; 3]; 2],
    nearest: Option<&Point3<f64>>,
) -> Error {
    let within = (0..3).all(|c| (low[c]..=high[c]).contains(&x[c]));
    let rule = match (within, nearest) {
        // Such as a point in a hole, or on a circle whose chords are the model's faces.
        (true, Some(n)) => format!(
            "lies in no part of model '{model}'; its nearest node is {:.2e} m away, at [{:.5e}, {:.5e}, {:.5e}] m: move the probe \
             into the model, or name another",
            (n - x).norm(),
            n.x,
            n.y,
            n.z
        ),
        (true, None) => {
            format!("lies in no part of model '{model}'; move the probe into it, or name another model")
        }
        (false, _) => format!(
            "lies outside model '{model}', which reaches from {low:?} to {high:?} m; move the probe into it, or name another \
             model"
        ),
    };
    value(
        format!("{path}.at"),
        format_args!("{:?} m", x.coords.as_slice()),
        &rule,
    )
}

/// Refuses a point outside of a model that is built; the error names the extent of the model.
fn outside(path: &str, model: &str, x: &Point3<f64>, body: &Body) -> Error {
    let [low, high] = corners(body.model.nodes());
    let distance = |n: &Point3<f64>| (n - x).norm_squared();
    let nearest = body.model.nodes().iter();
    let nearest = nearest.min_by(|a, b| distance(a).total_cmp(&distance(b)));
    outside_box(path, model, x, [low.into(), high.into()], nearest)
}
