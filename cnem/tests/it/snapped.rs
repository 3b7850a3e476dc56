//! GOAL: lattices whose nodes are off their lines, planes and circles by 1e-9, as particle centres on the
//! grid of their bonds are, are accepted like any other body: cells tile, functions are linear to round-off.
//! MODEL: a bar of 12 by 3 by 3 cells with regular or scattered inner nodes, rotated, sheared, shifted, of 3
//! m, 3e-6 m and 3e6 m, whose nodes are moved to a grid of 2⁻³⁰ of the longest bond.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::common::bodies::Map;
use arlequin_core::geometry::{Cell, Polyhedron};
use arlequin_core::{Interpolation, ShapeRow};
use cnem::NaturalField;
use cnem::natural::Interpolant;
use nalgebra::{Matrix3, Point3, Vector3};

/// Distance to the surface of the points next to it: the distance of mediators that must lie within a model.
const HAIR: f64 = 1e-6;

struct Case {
    size: f64,
    map: Map,
    points: Vec<Point3<f64>>,
}

impl Case {
    fn new(seed: u64) -> Self {
        let size = [1.0, 1e-6, 1e6][(seed / 3 % 3) as usize];
        let map = match seed % 3 {
            0 => Map::turn(seed),
            1 => Map::shear(seed, 0.3),
            _ => Map::turn(seed).moved([7.0 * size, -3.0 * size, 4.0 * size]),
        };
        let map = map.scaled(size);
        let jitter = if seed.is_multiple_of(2) { 0.2 } else { 0.0 };
        let (low, high) = (Point3::origin(), Point3::new(3.0, 1.0, 1.0));
        let lattice = cnem::generate::block(low, high, [12, 3, 3], jitter, seed).unwrap();
        let step = (0.5 * size).log2().ceil().exp2() / f64::from(1_u32 << 30);
        let snap = |p: &Point3<f64>| Self::placed(&map, p).map(|c| (c / step).round() * step);
        Self {
            size,
            map,
            points: lattice.iter().map(snap).collect(),
        }
    }

    fn placed(map: &Map, p: &Point3<f64>) -> Point3<f64> {
        Point3::from(map.matrix * p.coords + map.shift)
    }

    /// Returns the largest errors of unity and linear functions, and of their gradients, at points inside and
    /// at faces, edges, lines and ends of the lattice. Round-off may put the latter outside.
    fn linear_errors(&self, field: &NaturalField, next: &mut impl FnMut() -> f64) -> [f64; 2] {
        let mut row = ShapeRow::default();
        let mut worst = [0.0_f64; 2];
        for k in 0..600 {
            let mut x = Point3::new(3.0 * next().abs(), next().abs(), next().abs());
            let layer = |c: f64| (3.0 * c).round() / 3.0;
            match k % 6 {
                0 => x.y = 0.0,
                1 => (x.y, x.z) = (0.0, 1.0),
                2 => x.x = 3.0,
                3 => (x.y, x.z) = (layer(x.y), layer(x.z)),
                _ => {}
            }
            let hair = [HAIR, 0.0, 2e-10][k / 6 % 3];
            for (c, top) in x.iter_mut().zip([3.0, 1.0, 1.0]) {
                *c = c.clamp(hair, top - hair);
            }
            let x = Self::placed(&self.map, &x);
            let evaluated = field.shape_at(&x, true, &mut row);
            assert!(evaluated.is_ok() || hair < HAIR, "{x} is inside");
            if evaluated.is_err() {
                continue;
            }
            let entries = || row.nodes.iter().zip(&row.values).zip(&row.gradients);
            let moment: Vector3<f64> = entries().map(|((v, w), _)| (self.points[*v] - x) * *w).sum();
            let slope: Matrix3<f64> = entries()
                .map(|((v, _), g)| (self.points[*v] - x) * g.transpose())
                .sum();
            let sum: Vector3<f64> = row.gradients.iter().sum();
            let unity = (row.values.iter().sum::<f64>() - 1.0).abs();
            worst[0] = worst[0].max(unity).max(moment.norm() / self.size);
            let flat = (slope - Matrix3::identity()).norm().max(sum.norm() * self.size);
            worst[1] = worst[1].max(flat);
        }
        worst
    }

    /// Returns the share of a hexahedron within the bar that the cells cover, less one.
    fn covered(&self, cells: &[Cell<f64>], next: &mut impl FnMut() -> f64) -> f64 {
        let low = Point3::new(2.0 * next().abs(), 0.5 * next(), 0.5 * next());
        let corner = |k: usize| {
            let p = [0, 1, 2].map(|c| low[c] + (k >> c & 1) as f64);
            let [x, y, z] = [p[0], p[1], p[2]];
            let inside = |c: f64, top: f64| c.clamp(HAIR, top - HAIR);
            Self::placed(
                &self.map,
                &Point3::new(inside(x, 3.0), inside(y, 1.0), inside(z, 1.0)),
            )
        };
        let body = Polyhedron::hexahedron([0, 1, 3, 2, 4, 5, 7, 6].map(corner));
        let covered_volume = |c: &Cell<f64>| match c {
            Cell::Polyhedron(p) => body.intersection(&p.half_spaces()).volume(),
            Cell::Segment { .. } => 0.0,
        };
        cells.iter().map(covered_volume).sum::<f64>() / body.volume() - 1.0
    }
}

#[test]
fn cells_tile_and_functions_are_linear() {
    for seed in 0..18 {
        let case = Case::new(seed);
        let mut next = crate::common::noise(seed + 5);
        for kind in [Interpolant::Laplace, Interpolant::Sibson] {
            let field = NaturalField::from_points(&case.points, kind).unwrap();
            let [error, slope] = case.linear_errors(&field, &mut next);
            assert!(error < 1e-12, "case {seed}, {kind:?}: {error:e}");
            assert!(slope < 1e-11, "case {seed}, {kind:?}: gradients {slope:e}");
        }
        let field = NaturalField::from_points(&case.points, Interpolant::Laplace).unwrap();
        let cells = field.cells();
        for _ in 0..4 {
            let excess = case.covered(&cells, &mut next);
            assert!(excess.abs() < 1e-9, "case {seed}: {excess:e} of a body too much");
        }
    }
}
