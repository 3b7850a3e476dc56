//! Surfaces of rigid bodies for output.

use super::body::Body;
use super::mesh::Grid;
use super::names::effect_models;
use super::shapes::corners;
use crate::error::{Result, key};
use crate::setup::{LoweredScene, obstacle_parts};
use crate::spec::{EffectKind, Obstacle, ObstacleShape};
use arlequin::core::contact::RigidShape;
use arlequin::core::nalgebra::{Point3, Rotation3, Unit, Vector3};
use std::f64::consts::PI;

/// Number of cells along a quarter of a circle.
const QUARTER: usize = 6;

/// A rigid body for output.
#[derive(Debug, Clone)]
pub struct RigidPicture {
    /// Name of the rigid body in the ledger.
    pub name: String,
    /// Number of the model that it acts on.
    pub model: usize,
    /// Surface in the initial position; planes and cylinders are cut to the size of the model.
    pub grid: Grid,
    /// Centre of rotation \[m\].
    pub centre: Point3<f64>,
}

/// Rigid bodies of a scene, one for each model that they act on.
pub(super) fn pictures(scene: &LoweredScene, bodies: &[Body]) -> Result<Vec<RigidPicture>> {
    let mut out = Vec::new();
    for (k, e) in scene.effect.iter().enumerate().filter(|(_, e)| e.enabled) {
        let EffectKind::Obstacle(o) = &e.kind else {
            continue;
        };
        for m in effect_models(k, e, scene)? {
            let [low, high] = corners(bodies[m].model.nodes());
            let (grid, centre) = surface(k, o, &Point3::from((low + high) * 0.5), (high - low).norm())?;
            out.push(RigidPicture {
                name: o.ledger_name(k),
                model: m,
                grid,
                centre,
            });
        }
    }
    Ok(out)
}

/// Surface of an obstacle, near a body of extent `size` \[m\] around `middle`; and the centre of rotation.
fn surface(k: usize, o: &Obstacle, middle: &Point3<f64>, size: f64) -> Result<(Grid, Point3<f64>)> {
    Ok(match o.shape {
        ObstacleShape::Plane { point, normal } => {
            let (point, normal) = (Point3::from(point), Vector3::from(normal).normalize());
            let centre = middle - normal * normal.dot(&(middle - point));
            // An endless plane is drawn somewhat larger than the model.
            let [a, b] = across(&normal).map(|v| v * (0.75 * size));
            let points = vec![centre - a - b, centre + a - b, centre + a + b, centre - a + b];
            (grid(points, vec![0, 1, 2, 3]), centre)
        }
        ObstacleShape::Cylinder { point, axis, radius } => {
            let (point, axis) = (Point3::from(point), Vector3::from(axis).normalize());
            let centre = point + axis * axis.dot(&(middle - point));
            let [a, b] = across(&axis);
            let ring = |k: usize, along: f64| {
                let angle = 0.5 * PI * k as f64 / QUARTER as f64;
                centre + (a * angle.cos() + b * angle.sin()) * radius + axis * along
            };
            let count = 4 * QUARTER;
            let ends = [-0.75 * size, 0.75 * size];
            let points = ends.iter().flat_map(|s| (0..count).map(move |k| (k, *s)));
            let points = points.map(|(k, s)| ring(k, s)).collect();
            (grid(points, bands(1, count)), centre)
        }
        ObstacleShape::Cone {
            tip,
            axis,
            height,
            radius,
        } => {
            let (tip, axis) = (Point3::from(tip), Vector3::from(axis).normalize());
            let [a, b] = across(&axis);
            let count = 4 * QUARTER;
            // From the tip along the flank, and to the middle of the base.
            let rings = [[0.0, 0.0], [height, radius], [height, 0.0]];
            let ring = |[along, out]: [f64; 2], k: usize| {
                let angle = 0.5 * PI * k as f64 / QUARTER as f64;
                tip + axis * along + (a * angle.cos() + b * angle.sin()) * out
            };
            let points = rings.iter().flat_map(|r| (0..count).map(move |k| (*r, k)));
            let points = points.map(|(r, k)| ring(r, k)).collect();
            (grid(points, bands(2, count)), tip + axis * (0.75 * height))
        }
        ObstacleShape::Box { centre, size, turn } => {
            let centre = Point3::from(centre);
            let turn = Rotation3::new(turn.map(Vector3::from).unwrap_or_default());
            let corner = |k: usize| {
                let end = |c: usize| size[c] * (((k >> c) & 1) as f64 - 0.5);
                centre + turn * Vector3::new(end(0), end(1), end(2))
            };
            let faces = [
                [0, 2, 3, 1],
                [4, 5, 7, 6],
                [0, 1, 5, 4],
                [2, 6, 7, 3],
                [0, 4, 6, 2],
                [1, 3, 7, 5],
            ];
            (grid((0..8).map(corner).collect(), faces.concat()), centre)
        }
        ObstacleShape::Sphere { centre, radius } => {
            let centre = Point3::from(centre);
            let rows = 2 * QUARTER;
            let point = |row: usize, k: usize| {
                let (polar, angle) = (
                    PI * row as f64 / rows as f64,
                    0.5 * PI * k as f64 / QUARTER as f64,
                );
                let flat = Vector3::new(angle.cos(), angle.sin(), 0.0) * polar.sin();
                centre + (flat + Vector3::z() * polar.cos()) * radius
            };
            let points = (0..=rows).flat_map(|row| (0..4 * QUARTER).map(move |k| (row, k)));
            let points = points.map(|(row, k)| point(row, k)).collect();
            (grid(points, bands(rows, 4 * QUARTER)), centre)
        }
        ObstacleShape::Solid { .. } => {
            let shape = obstacle_parts(k, o)?.0;
            let RigidShape::Solid(solid) = &shape else {
                return Err(key(format!("effect[{k}].obstacle.shape"), "is no solid"));
            };
            let points: Vec<Point3<f64>> = solid.triangles().iter().flatten().copied().collect();
            let connectivity = (0..points.len() as u32).collect();
            let grid = Grid {
                corners: 3,
                // VTK cell type of a triangle.
                cell_type: 5,
                ..grid(points, connectivity)
            };
            (grid, shape.middle())
        }
    })
}

/// Connectivity of the quadrilaterals between rings of points.
fn bands(rows: usize, count: usize) -> Vec<u32> {
    let cell = |(row, k): (usize, usize)| {
        let (a, b) = (row * count, (row + 1) * count);
        let next = (k + 1) % count;
        [a + k, a + next, b + next, b + k].map(|i| i as u32)
    };
    let cells = (0..rows).flat_map(|row| (0..count).map(move |k| (row, k)));
    cells.flat_map(cell).collect()
}

fn grid(points: Vec<Point3<f64>>, connectivity: Vec<u32>) -> Grid {
    Grid {
        points,
        connectivity,
        corners: 4,
        // VTK cell type of a quadrilateral.
        cell_type: 9,
        radii: Vec::new(),
    }
}

/// Two orthogonal unit vectors perpendicular to a unit vector.
fn across(v: &Vector3<f64>) -> [Vector3<f64>; 2] {
    // The axis with the smallest component of `v` is far from parallel to it.
    let a = v.cross(&Vector3::ith(v.iamin(), 1.0));
    let a = Unit::new_normalize(a).into_inner();
    [a, v.cross(&a)]
}
