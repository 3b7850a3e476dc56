//! Natural-neighbour fields and multiplier spaces: the interpolation that a coupling evaluates.
//!
//! Shape functions sum to one and reproduce linear fields at every point of the closed domain, on any set of
//! nodes: the centres of particles are enough, without a mesh or connectivity.

use crate::constraint::Surface;
use crate::delaunay::linear_gradients;
use crate::domain::Domain;
use crate::error::{Result, parameter};
use crate::natural::{Interpolant, Scratch};
use arlequin_core::geometry::{Cell, Polyhedron};
use arlequin_core::{Interpolation, Mediator, ShapeRow, outside};
use nalgebra::Point3;
use std::sync::{Mutex, PoisonError};

/// Distance outside the domain, relative to the largest coordinate, up to which the linear functions of the
/// nearest tetrahedron are used. Intersections of cells and points moved to a surface are off by 1e-12 or so.
const NEAR: f64 = 1e-9;

/// Ratio of volume to the cube of the longest edge below which a tetrahedron is left out of the integration
/// cells. The faces of such a needle have no reliable normals: the half-spaces of one with a ratio of 1e-20
/// would contain the bodies beside it.
const NEEDLE: f64 = 64.0 * f64::EPSILON;

/// A natural-neighbour field on nodes or particle centres.
#[derive(Debug)]
pub struct NaturalField {
    domain: Domain,
    kind: Interpolant,
    /// Tetrahedron of every integration cell, without needles; empty if Voronoi cells are used.
    elements: Vec<u32>,
    /// Voronoi cells of the nodes, if they are used for integration.
    bodies: Option<Vec<Cell<f64>>>,
    /// Working buffers that no thread is using.
    pool: Mutex<Vec<Scratch>>,
}

impl Clone for NaturalField {
    fn clone(&self) -> Self {
        Self {
            domain: self.domain.clone(),
            kind: self.kind,
            elements: self.elements.clone(),
            bodies: self.bodies.clone(),
            pool: Mutex::default(),
        }
    }
}

impl NaturalField {
    /// Creates the field on the nodes of a domain.
    pub fn new(domain: Domain, kind: Interpolant) -> Self {
        let mut elements = domain.element_ids();
        elements.retain(|t| {
            let p = domain.corners_of(*t).map(|v| domain.nodes()[v]);
            let [a, b, c] = [1, 2, 3].map(|k| p[k] - p[0]);
            let edges = [a, b, c, b - a, c - a, c - b];
            let longest = edges.iter().fold(0.0, |m: f64, e| m.max(e.norm()));
            a.cross(&b).dot(&c).abs() > 6.0 * NEEDLE * longest * longest * longest
        });
        Self {
            elements,
            bodies: None,
            domain,
            kind,
            pool: Mutex::default(),
        }
    }

    /// Creates a field on points alone, such as the centres of particles. Its domain is their convex hull.
    ///
    /// ```
    /// use arlequin_core::{Interpolation, ShapeRow};
    /// use cnem::{NaturalField, natural::Interpolant};
    /// use nalgebra::Point3;
    /// let corner = |i: u32| Point3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2));
    /// let field = NaturalField::from_points(&(0..8).map(corner).collect::<Vec<_>>(), Interpolant::Laplace)?;
    /// let mut row = ShapeRow::default();
    /// field.shape_at(&Point3::new(0.25, 0.5, 0.5), false, &mut row)?;
    /// assert!((row.values.iter().sum::<f64>() - 1.0).abs() < 1e-14);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// The errors of [`Domain::new`].
    pub fn from_points(points: &[Point3<f64>], kind: Interpolant) -> Result<Self> {
        Ok(Self::new(Domain::new(points, &Surface::convex_hull())?, kind))
    }

    /// Creates a field on points within a surface. The nodes are exactly the given points: no point is
    /// inserted.
    ///
    /// # Errors
    /// The errors of [`Domain::with_limit`]; [`crate::Error::FacesNotRecovered`] where recovery would need
    /// inserted points; [`crate::Error::Parameter`] where cracks would split nodes.
    pub fn within(points: &[Point3<f64>], surface: &Surface, kind: Interpolant) -> Result<Self> {
        let domain = Domain::with_limit(points, surface, 0)?;
        // A copy of a node would be an unknown that no particle has.
        match domain.copies().count() {
            0 => Ok(Self::new(domain, kind)),
            split => Err(parameter(
                "crack faces",
                format_args!("{split} nodes split"),
                "must not split nodes of a field on given points: leave the cracks out or end them at nodes that are shared",
            )),
        }
    }

    /// The domain.
    pub fn domain(&self) -> &Domain {
        &self.domain
    }

    /// Returns the kind of shape functions.
    pub fn interpolant(&self) -> Interpolant {
        self.kind
    }

    /// Returns the field with the Voronoi cells of its nodes as integration cells, in place of the
    /// tetrahedra.
    ///
    /// # Errors
    /// The errors of [`Domain::voronoi`].
    pub fn with_voronoi_cells(mut self) -> Result<Self> {
        let cells = self.domain.voronoi()?;
        let mut work = crate::voronoi::CellBodies::default();
        let bodies = (0..cells.len()).flat_map(|i| self.domain.cell_bodies(&cells, i, &mut work));
        self.bodies = Some(bodies.collect());
        self.elements.clear();
        Ok(self)
    }

    /// Corners of the tetrahedra that serve as integration cells.
    fn tetrahedra(&self) -> impl Iterator<Item = [Point3<f64>; 4]> {
        let corners = |t: &u32| self.domain.corners_of(*t).map(|v| self.domain.nodes()[v]);
        self.elements.iter().map(corners)
    }

    fn evaluate(
        &self,
        tet: Option<u32>,
        x: &Point3<f64>,
        gradient: bool,
        row: &mut ShapeRow<f64>,
    ) -> arlequin_core::Result<()> {
        // The trait passes no scratch: each evaluation borrows one from the pool, so threads do not share it.
        let free = || self.pool.lock().unwrap_or_else(PoisonError::into_inner);
        let popped = free().pop();
        let mut scratch = popped.unwrap_or_default();
        row.clear();
        let shape = match tet {
            // Functions within a known tetrahedron need no search, and no choice on a face between two.
            Some(tet) => Ok(self
                .domain
                .shape_within(self.kind, x, tet, &mut scratch, gradient)),
            None if gradient => self.domain.shape_with_gradients(self.kind, x, &mut scratch),
            None => self.domain.shape(self.kind, x, &mut scratch),
        };
        let outcome = match shape {
            Ok(shape) => {
                for (k, (&node, &value)) in shape.nodes.iter().zip(&shape.values).enumerate() {
                    // A node with the value zero counts only for its gradient, which need not vanish.
                    if gradient {
                        row.push_with_gradient(node, value, shape.gradients[k]);
                    } else if value != 0.0 {
                        row.push(node, value);
                    }
                }
                Ok(())
            }
            // Points at the surface may lie outside by round-off of their own; farther ones stay an error.
            Err(_) => self.extrapolate(x, gradient, row),
        };
        free().push(scratch);
        outcome
    }

    /// Uses the linear functions of the nearest tetrahedron, for points that are outside by round-off.
    fn extrapolate(
        &self,
        x: &Point3<f64>,
        gradient: bool,
        row: &mut ShapeRow<f64>,
    ) -> arlequin_core::Result<()> {
        let Some(tet) = self.domain.locate_near(x, NEAR) else {
            return Err(outside(x, self.kind()));
        };
        // A flat nearest tetrahedron has no gradients: a neighbour with a thickness continues the field.
        let nodes = self.domain.corners_of(self.domain.thick(tet, x));
        let p = nodes.map(|v| self.domain.nodes()[v]);
        let gradients = linear_gradients(&p).0;
        let values = crate::delaunay::linear_values(&p, &gradients, x);
        for k in 0..4 {
            if gradient {
                row.push_with_gradient(nodes[k], values[k], gradients[k]);
            } else {
                row.push(nodes[k], values[k]);
            }
        }
        Ok(())
    }
}

impl Interpolation<f64> for NaturalField {
    fn nodes(&self) -> &[Point3<f64>] {
        self.domain.nodes()
    }

    fn shape_at(
        &self,
        x: &Point3<f64>,
        gradient: bool,
        row: &mut ShapeRow<f64>,
    ) -> arlequin_core::Result<()> {
        self.evaluate(None, x, gradient, row)
    }

    fn shape_in(
        &self,
        cell: usize,
        x: &Point3<f64>,
        gradient: bool,
        row: &mut ShapeRow<f64>,
    ) -> arlequin_core::Result<()> {
        self.evaluate(self.elements.get(cell).copied(), x, gradient, row)
    }

    /// Returns the tetrahedra of the domain, or the Voronoi cells after [`NaturalField::with_voronoi_cells`].
    fn cells(&self) -> Vec<Cell<f64>> {
        if let Some(bodies) = &self.bodies {
            return bodies.clone();
        }
        self.tetrahedra()
            .map(|p| Cell::Polyhedron(Polyhedron::tetrahedron(p)))
            .collect()
    }

    fn cells_within(&self, [low, high]: &[Point3<f64>; 2]) -> Option<Vec<(usize, Cell<f64>)>> {
        if let Some(bodies) = &self.bodies {
            return Some(bodies.iter().cloned().enumerate().collect());
        }
        let meets = |p: &[Point3<f64>; 4]| {
            let end = |pick: fn(f64, f64) -> f64, k: usize| p[1..].iter().fold(p[0][k], |m, x| pick(m, x[k]));
            (0..3).all(|k| end(f64::min, k) <= high[k] && low[k] <= end(f64::max, k))
        };
        let hits = self.tetrahedra().enumerate().filter(|(_, p)| meets(p));
        Some(
            hits.map(|(k, p)| (k, Cell::Polyhedron(Polyhedron::tetrahedron(p))))
                .collect(),
        )
    }

    /// Natural-neighbour functions are no polynomials; on a tetrahedron linear functions fit them best.
    fn degree(&self) -> usize {
        1
    }

    fn kind(&self) -> &'static str {
        "natural-neighbour"
    }
}

/// A multiplier space on its own nodes, which need no mesh: `h_B` is the mean edge length of the tetrahedra.
impl Mediator<f64> for NaturalField {
    fn spacing(&self) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0);
        for t in self.domain.elements() {
            let p = t.map(|v| self.domain.nodes()[v]);
            for (i, j) in [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)] {
                sum += (p[i] - p[j]).norm();
                count += 1.0;
            }
        }
        sum / count
    }
}
