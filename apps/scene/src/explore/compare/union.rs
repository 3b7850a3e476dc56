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

/// Shape that covers two shapes of one section in line along a coordinate.
fn union(a: &Shape, b: &Shape, along: usize) -> Option<Shape> {
    let close = |x: f64, y: f64, size: f64| (x - y).abs() <= 1e-9 * size;
    match (a, b) {
        (
            Shape::Bar { from, to, section },
            Shape::Bar {
                from: f,
                to: t,
                section: s,
            },
        ) if along == 0 && close(*section, *s, *s) => Some(Shape::Bar {
            from: from.min(*f),
            to: to.max(*t),
            section: *section,
        }),
        (
            Shape::Cylinder { from, length, radius },
            Shape::Cylinder {
                from: f,
                length: l,
                radius: r,
            },
        ) if along == 0 && close(*radius, *r, *r) && [1, 2].iter().all(|c| close(from[*c], f[*c], *r)) => {
            let start = from[0].min(f[0]);
            Some(Shape::Cylinder {
                from: [start, from[1], from[2]],
                length: (from[0] + length).max(f[0] + l) - start,
                radius: *radius,
            })
        }
        (
            Shape::Box {
                low,
                high,
                hole: None,
            },
            Shape::Box {
                low: l,
                high: h,
                hole: None,
            },
        ) if (0..3).filter(|c| *c != along).all(|c| {
            let size = h[c] - l[c];
            close(low[c], l[c], size) && close(high[c], h[c], size)
        }) =>
        {
            Some(Shape::Box {
                low: [0, 1, 2].map(|c| low[c].min(l[c])),
                high: [0, 1, 2].map(|c| high[c].max(h[c])),
                hole: None,
            })
        }
        _ => None,
    }
}
