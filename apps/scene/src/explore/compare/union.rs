//! The place of both models of a scene as one shape.

use crate::error::{Result, key};
use crate::setup::LoweredScene;
use crate::spec::Shape;
use arlequin::core::nalgebra::Vector3;

/// Returns the shape over the place of both models; `names` are the model that goes and the one that stays.
pub(super) fn united(scene: &LoweredScene, [gone, kept]: [&String; 2], axis: Vector3<f64>) -> Result<Shape> {
    let [a, b] = [gone, kept].map(|n| scene.model[n].shape.in_scene());
    let along = axis.iamax();
    let shapes = a.zip(b).filter(|_| axis[along].abs() > 1.0 - 1e-12);
    shapes.and_then(|(a, b)| union(a, b, along)).ok_or_else(|| {
        let rule = "and that of the other model must be two boxes, cylinders or bars of one section, in line across the overlap; \
                    the comparison needs one model in the place of both";
        key(format!("model.{kept}.shape"), rule)
    })
}

/// Shape that covers two shapes of one kind and section in line along a coordinate.
fn union(a: &Shape, b: &Shape, along: usize) -> Option<Shape> {
    let ([low, high], [l, h]) = (extent(a, along)?, extent(b, along)?);
    let (from, to) = (low[along].min(l[along]), high[along].max(h[along]));
    let mut out = a.clone();
    match &mut out {
        Shape::Bar { from: f, to: t, .. } => (*f, *t) = (from, to),
        Shape::Cylinder { from: f, length, .. } => (f[0], *length) = (from, to - from),
        Shape::Box { low, high, .. } => (low[along], high[along]) = (from, to),
        _ => return None,
    }
    let close = |x: f64, y: f64| (x - y).abs() <= 1e-9 * x.abs().max(y.abs());
    let mut across = (0..3).filter(|c| *c != along);
    let alike = a.name() == b.name() && across.all(|c| close(low[c], l[c]) && close(high[c], h[c]));
    alike.then_some(out)
}

/// Lowest and highest corner of a shape; across a cylinder or bar, the numbers of its section.
fn extent(shape: &Shape, along: usize) -> Option<[[f64; 3]; 2]> {
    match shape {
        Shape::Bar { from, to, section } if along == 0 => Some([[*from, 0.0, 0.0], [*to, *section, 0.0]]),
        Shape::Cylinder { from, length, radius } if along == 0 => {
            Some([*from, [from[0] + length, *radius, 0.0]])
        }
        Shape::Box {
            low,
            high,
            hole: None,
        } => Some([*low, *high]),
        _ => None,
    }
}
