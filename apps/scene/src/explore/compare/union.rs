//! The place of both models of a scene as one shape.

use crate::error::{Result, key};
use crate::setup::LoweredScene;
use crate::spec::Shape;
use arlequin::core::nalgebra::Vector3;

/// Returns the shape over the place of both models; `names` are the model that goes and the one that stays.
pub(super) fn united(scene: &LoweredScene, [gone, kept]: [&String; 2], axis: Vector3<f64>) -> Result<Shape> {
    let shapes = [gone, kept].map(|n| scene.model[n].shape.in_scene());
    let along = axis.iamax();
    let united = match shapes {
        [Some(a), Some(b)] if axis[along].abs() > 1.0 - 1e-12 => union(a, b, along),
        _ => None,
    };
    united.ok_or_else(|| {
        let rule = "and that of the other model must be two boxes, cylinders or bars of one section, in line across the overlap; \
                    the comparison needs one model in the place of both";
        key(format!("model.{kept}.shape"), rule)
    })
}

/// Shape that covers two shapes of one kind and section in line along a coordinate.
fn union(a: &Shape, b: &Shape, along: usize) -> Option<Shape> {
    let (([from, to], section, size), ([f, t], other, _)) = (extent(a, along)?, extent(b, along)?);
    let (from, to) = (from.min(f), to.max(t));
    let alike = a.name() == b.name()
        && section
            .iter()
            .zip(&other)
            .all(|(x, y)| (x - y).abs() <= 1e-9 * size);
    let mut out = a.clone();
    match &mut out {
        Shape::Bar { from: f, to: t, .. } => (*f, *t) = (from, to),
        Shape::Cylinder { from: f, length, .. } => (f[0], *length) = (from, to - from),
        Shape::Box { low, high, .. } => (low[along], high[along]) = (from, to),
        _ => return None,
    }
    alike.then_some(out)
}

/// Ends of a shape along a coordinate, what describes its section, and the size of the section.
fn extent(shape: &Shape, along: usize) -> Option<([f64; 2], Vec<f64>, f64)> {
    match shape {
        Shape::Bar { from, to, section } if along == 0 => Some(([*from, *to], vec![*section], *section)),
        Shape::Cylinder { from, length, radius } if along == 0 => {
            let section = vec![from[1], from[2], *radius];
            Some(([from[0], from[0] + length], section, *radius))
        }
        Shape::Box {
            low,
            high,
            hole: None,
        } => {
            let across: Vec<usize> = (0..3).filter(|c| *c != along).collect();
            let section = across.iter().flat_map(|c| [low[*c], high[*c]]).collect();
            let sizes = across.iter().map(|c| high[*c] - low[*c]);
            Some((
                [low[along], high[along]],
                section,
                sizes.fold(f64::INFINITY, f64::min),
            ))
        }
        _ => None,
    }
}
