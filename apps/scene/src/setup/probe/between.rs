//! Shape functions at a point between particles, by natural neighbours.
//!
//! The natural neighbours of a point `x` follow from its Voronoi cell. A particle that cuts a cell of radius
//! `ρ` about `x` is no farther than `2 ρ` from `x`. The cell among all particles within this distance is
//! therefore the one among all particles of the body, whose tetrahedra would take half as much memory as the
//! model.

use arlequin::cnem::NaturalField;
use arlequin::cnem::natural::Interpolant;
use arlequin::core::geometry::{HalfSpace, Polyhedron};
use arlequin::core::nalgebra::{Point3, Vector3, center};
use arlequin::core::{Error, Interpolation, Result, ShapeRow};

/// First radius of the search for particles, in spacings: about 500 particles lie within it.
const FIRST: f64 = 5.0;

/// Shape functions of the particles at `nodes` at the point `x`; `spacing` is the particles' \[m\].
///
/// # Errors
/// [`Error::OutsideDomain`] for a point outside of the convex hull of the particles;
/// [`Error::InvalidParameter`] if they have none.
pub(super) fn shape_between(nodes: &[Point3<f64>], spacing: f64, x: &Point3<f64>) -> Result<ShapeRow<f64>> {
    // At a centre, the cell of the point would be open among any others.
    if let Some(k) = nodes.iter().position(|n| n == x) {
        let mut row = ShapeRow::default();
        row.push(k, 1.0);
        return Ok(row);
    }
    let mut reach = FIRST * spacing;
    loop {
        let within = (0..nodes.len()).filter(|k| (nodes[*k] - x).norm() <= reach);
        let particles: Vec<usize> = within.collect();
        let shape = shape_among(nodes, &particles, x);
        if particles.len() == nodes.len() {
            return shape;
        }
        // Among few particles, a point may lie outside or have an open cell.
        match shape {
            Ok(row) if 2.0 * cell_radius(nodes, &row, x, reach) <= reach => return Ok(row),
            _ => reach *= 2.0,
        }
    }
}

fn shape_among(nodes: &[Point3<f64>], among: &[usize], x: &Point3<f64>) -> Result<ShapeRow<f64>> {
    let points: Vec<_> = among.iter().map(|k| nodes[*k]).collect();
    let field = NaturalField::from_points(&points, Interpolant::Laplace);
    let field = field.map_err(|e| Error::InvalidParameter {
        name: "field between the particles".into(),
        value: format!("{} centres", points.len()),
        rule: e.to_string(),
    })?;
    let mut row = ShapeRow::default();
    field.shape_at(x, false, &mut row)?;
    row.nodes.iter_mut().for_each(|k| *k = among[*k]);
    Ok(row)
}

/// Radius of the Voronoi cell of `x`: the largest distance of its corners from `x` \[m\]. The cell is cut off
/// at the distance `reach` along each axis.
fn cell_radius(nodes: &[Point3<f64>], row: &ShapeRow<f64>, x: &Point3<f64>, reach: f64) -> f64 {
    let corners = [[-reach, -reach], [reach, -reach], [reach, reach], [-reach, reach]];
    let corner = |k: usize| {
        let ([a, b], up) = (corners[k % 4], if k < 4 { -reach } else { reach });
        x + Vector3::new(a, b, up)
    };
    let cube = Polyhedron::hexahedron(std::array::from_fn(corner));
    let nearer = |k: &usize| HalfSpace::new(&center(x, &nodes[*k]), nodes[*k] - x);
    let cell = cube.intersection(&row.nodes.iter().map(nearer).collect::<Vec<_>>());
    let distances = cell.faces.iter().flatten().map(|c| (c - x).norm());
    distances.fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Particles on a lattice, each moved by up to 0.3 of its spacing along each axis.
    fn particles(counts: [usize; 3]) -> Vec<Point3<f64>> {
        let mut state = 7_u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        let place = |k: usize| {
            let cell = [
                k % counts[0],
                k / counts[0] % counts[1],
                k / counts[0] / counts[1],
            ];
            Point3::from(cell.map(|c| c as f64 + 0.6 * random()))
        };
        (0..counts.iter().product()).map(place).collect()
    }

    /// Inside, beside surfaces and at a centre; in a thick body and in a thin one.
    #[test]
    fn a_point_has_the_neighbours_that_it_has_among_all_particles() {
        for (counts, points) in [
            (
                [30, 14, 14],
                [
                    [15.2, 7.1, 6.6],
                    [4.3, 1.2, 12.4],
                    [28.4, 7.0, 7.0],
                    [15.0, 0.4, 6.3],
                ],
            ),
            (
                [40, 40, 2],
                [
                    [20.3, 19.8, 0.5],
                    [3.0, 36.2, 0.6],
                    [38.4, 20.0, 0.4],
                    [10.2, 10.1, 0.7],
                ],
            ),
        ] {
            let nodes = particles(counts);
            let whole = NaturalField::from_points(&nodes, Interpolant::Laplace).expect("a field");
            for x in points.map(Point3::from).into_iter().chain([nodes[77]]) {
                let sorted = |row: ShapeRow<f64>| {
                    let mut entries: Vec<_> = row.nodes.into_iter().zip(row.values).collect();
                    entries.sort_by_key(|e| e.0);
                    entries
                };
                let mut row = ShapeRow::default();
                whole.shape_at(&x, false, &mut row).expect("inside");
                let (expected, found) = (
                    sorted(row),
                    sorted(shape_between(&nodes, 1.0, &x).expect("inside")),
                );
                assert_eq!(expected.len(), found.len(), "{x}");
                for (a, b) in expected.iter().zip(&found) {
                    assert!(a.0 == b.0 && (a.1 - b.1).abs() < 1e-12, "{x}: {a:?} {b:?}");
                }
            }
        }
    }

    /// Six particles in a hole bound the Voronoi cell of a point in its middle. The particles of the wall lie
    /// beyond the first radius of the search, and still cut the corners of the cell.
    #[test]
    fn particles_beyond_those_that_close_a_cell_cut_it() {
        let middle = Point3::new(10.0, 10.0, 10.0);
        let mut nodes = particles([21, 21, 21]);
        nodes.retain(|x| (x - middle).norm() > 6.0);
        for axis in 0..3 {
            for side in [-4.0, 4.0] {
                let mut x = middle;
                x[axis] += side;
                nodes.push(x);
            }
        }
        let x = middle + Vector3::new(0.1, -0.2, 0.15);
        let whole = NaturalField::from_points(&nodes, Interpolant::Laplace).expect("a field");
        let mut row = ShapeRow::default();
        whole.shape_at(&x, false, &mut row).expect("inside");
        let mut found = shape_between(&nodes, 1.0, &x).expect("inside").nodes;
        row.nodes.sort_unstable();
        found.sort_unstable();
        assert!(row.nodes.len() > 6, "{:?}", row.nodes);
        assert_eq!(row.nodes, found);
    }

    #[test]
    fn a_point_outside_is_refused() {
        let nodes = particles([9, 9, 9]);
        let refused = shape_between(&nodes, 1.0, &Point3::new(4.0, 4.0, 9.5));
        assert!(matches!(refused, Err(Error::OutsideDomain { .. })), "{refused:?}");
    }
}
