//! Regions and extents of the shapes of a scene.

use crate::error::{Result, key, value};
use crate::setup::BodyShape;
use crate::spec::{RegionShape, Shape};
use arlequin::core::Primitive;
use arlequin::core::nalgebra::{Point3, Unit, Vector3};

/// Builds a simple region; refuses sizes that are not positive.
pub(super) fn region(path: &str, shape: &RegionShape) -> Result<Primitive<f64>> {
    let positive = |key: &str, r: f64| match r > 0.0 {
        true => Ok(r),
        false => Err(value(format!("{path}.{key}.radius"), r, "must be positive [m]")),
    };
    Ok(match shape {
        RegionShape::Ball { centre, radius } => Primitive::Ball {
            centre: Point3::from(*centre),
            radius: positive("ball", *radius)?,
        },
        RegionShape::Box { low, high } => {
            if let Some(c) = (0..3).find(|&c| high[c] <= low[c]) {
                let rule = format!("must be above low[{c}] = {} m", low[c]);
                return Err(value(format!("{path}.box.high[{c}]"), high[c], &rule));
            }
            Primitive::Block {
                low: Point3::from(*low),
                high: Point3::from(*high),
            }
        }
        RegionShape::Cylinder { point, axis, radius } => Primitive::Cylinder {
            point: Point3::from(*point),
            axis: Unit::try_new(Vector3::from(*axis), 0.0)
                .ok_or_else(|| key(format!("{path}.cylinder.axis"), "has no length; take [1, 0, 0]"))?,
            radius: positive("cylinder", *radius)?,
        },
    })
}

/// Lowest and highest corner of the bounding box of a region; infinite along a cylinder.
pub(super) fn region_box(shape: &RegionShape) -> [[f64; 3]; 2] {
    match shape {
        RegionShape::Ball { centre, radius } => [centre.map(|x| x - radius), centre.map(|x| x + radius)],
        RegionShape::Box { low, high } => [*low, *high],
        RegionShape::Cylinder { point, axis, radius } => {
            let length = Vector3::from(*axis).norm();
            // Only directions perpendicular to the axis are bounded.
            let reach = |c: usize| match axis[c] / length {
                0.0 => *radius,
                _ => f64::INFINITY,
            };
            [-1.0, 1.0].map(|sign| [0, 1, 2].map(|c| point[c] + sign * reach(c)))
        }
    }
}

/// Lowest and highest corner of a shape; `None` if a file, a zone or a link determines them.
pub(super) fn ends(shape: &BodyShape) -> Option<[[f64; 3]; 2]> {
    Some(match *shape.in_scene()? {
        Shape::Box { low, high, .. } => [low, high],
        Shape::Cylinder { from, length, radius } => {
            let [x, y, z] = from;
            [[x, y - radius, z - radius], [x + length, y + radius, z + radius]]
        }
        Shape::Bar { from, to, .. } => [[from, 0.0, 0.0], [to, 0.0, 0.0]],
        Shape::Ball { centre, radius } => [centre.map(|c| c - radius), centre.map(|c| c + radius)],
        Shape::File(_) => return None,
    })
}

/// Corners of the bounding box of a shape.
pub(super) fn shape_corners(shape: &BodyShape) -> Option<Vec<Point3<f64>>> {
    let ends = ends(shape)?;
    let corner = |k: usize| Point3::new(ends[k & 1][0], ends[(k >> 1) & 1][1], ends[(k >> 2) & 1][2]);
    Some((0..8).map(corner).collect())
}

/// Lowest and highest corner of the bounding box of nodes.
pub(super) fn corners(nodes: &[Point3<f64>]) -> [Vector3<f64>; 2] {
    let ends = [f64::INFINITY, f64::NEG_INFINITY].map(Vector3::repeat);
    nodes
        .iter()
        .fold(ends, |[a, b], x| [a.inf(&x.coords), b.sup(&x.coords)])
}
