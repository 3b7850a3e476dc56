//! The displacement field of a mesh: point location, shape functions, integration cells. A mediator on finite
//! elements is a field of this kind.
//!
//! A point is located through a box tree in `O(log n)`. An element holds the point if its local coordinates
//! leave the element by at most 1e-9 (more in single precision). Of several such elements the one of lowest
//! number is chosen, so that the choice on a common face is reproducible. Within the tolerance the element's
//! own polynomial is evaluated, which keeps partition of unity and linear completeness exact.

use crate::element::{self, ElementKind};
use crate::error::Result;
use crate::mesh::Mesh;
use arlequin_core::geometry::{BoxTree, Cell, bounds_of};
use arlequin_core::{Interpolation, Mediator, Real, ShapeRow, outside};
use nalgebra::{Matrix3, Point3, Vector3};
use std::sync::Arc;

/// A point that no element holds belongs to a hexahedron whose local coordinates it leaves by up to this many
/// times the warp of the faces.
const NEAR: f64 = 2.0;

/// Data that give the local coordinates of a hexahedron, and the distance of its faces from planes.
#[derive(Debug, Clone)]
struct HexShape<T: Real> {
    centre: Point3<T>,
    /// Inverse Jacobian at the centre; `None` if it does not exist.
    inverse: Option<Matrix3<T>>,
    map: HexMap<T>,
    /// Largest distance of a face's corners from a plane, relative to the element's size.
    warp: T,
}

/// Kind of the map from local coordinates to places in a hexahedron.
#[derive(Debug, Clone, Copy)]
enum HexMap<T> {
    /// Affine to round-off (a parallelepiped).
    Affine,
    /// Nearly affine: one correction with the inverse at the centre leaves only round-off.
    Nearly,
    /// Any other, with the largest coordinate that the affine map of the centre gives to points of the
    /// element or near it.
    Bent(T),
}

/// The finite element field of a mesh.
#[derive(Debug, Clone)]
pub struct FemField<T: Real> {
    mesh: Arc<Mesh<T>>,
    tree: BoxTree<T>,
    hexes: Vec<HexShape<T>>,
    /// Gradients of the shape functions of corners 1 to 3 of every tetrahedron, which give the local
    /// coordinates.
    tets: Vec<[Vector3<T>; 3]>,
    tolerance: T,
    /// True if a hexahedron has warped faces and is cut into several cells.
    warped: bool,
}

/// Local coordinates of a point in one element.
struct Located<T: Real> {
    element: usize,
    /// Barycentric coordinates (bars, tetrahedra) or `ξ` (hexahedra).
    local: [T; 4],
    /// Distance by which the local coordinates leave the element; zero or below inside.
    violation: T,
}

impl<T: Real> FemField<T> {
    /// Makes the field of a mesh.
    ///
    /// ```
    /// use arlequin_core::{Interpolation, ShapeRow, nalgebra::Point3};
    /// use fem_ref::{ElementKind, FemField, generate};
    /// let high = Point3::new(2.0, 1.0, 1.0);
    /// let mesh = generate::block(ElementKind::Hex8, Point3::origin(), high, [4, 2, 2])?;
    /// let field = FemField::new(mesh);
    /// let mut row = ShapeRow::default();
    /// field.shape_at(&Point3::new(0.3, 0.4, 0.1), true, &mut row)?;
    /// assert!((row.values.iter().sum::<f64>() - 1.0).abs() < 1e-15);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn new(mesh: impl Into<Arc<Mesh<T>>>) -> Self {
        let mesh = mesh.into();
        // In single precision 1e-9 is below round-off: there, 32 units of it.
        let tolerance = T::of(1e-9).max(T::epsilon() * T::of(32.0));
        let hexes: Vec<_> = match mesh.kind() {
            ElementKind::Hex8 => (0..mesh.element_count())
                .map(|e| hex_shape(&mesh.corners(e)))
                .collect(),
            _ => Vec::new(),
        };
        let tets: Vec<_> = match mesh.kind() {
            ElementKind::Tet4 => (0..mesh.element_count())
                .map(|e| {
                    let [_, a, b, c] = element::tet_gradients(&mesh.corners(e)).0;
                    [a, b, c]
                })
                .collect(),
            _ => Vec::new(),
        };
        let boxes = (0..mesh.element_count()).map(|e| {
            let p = mesh.corners(e);
            let [low, high] = bounds_of(p[..mesh.kind().corners()].iter());
            // A warped face bulges out of the box of its corners.
            let slack = hexes.get(e).map_or(T::zero(), |h: &HexShape<T>| h.warp);
            // Wide enough for all points that `locate` accepts.
            let margin = Vector3::repeat((high - low).norm() * (tolerance + slack) * T::of(2.0));
            [low - margin, high + margin]
        });
        Self {
            tree: BoxTree::new(boxes.collect()),
            mesh: mesh.clone(),
            warped: hexes.iter().any(|h| h.warp > tolerance),
            hexes,
            tets,
            tolerance,
        }
    }

    /// Makes a piecewise linear field on points along a line \[m\], for example the particles of a chain,
    /// with cells of the given cross-section \[m²\]. The points may come in any order; the field keeps their
    /// numbers.
    ///
    /// ```
    /// use arlequin_core::{Interpolation, nalgebra::Point3};
    /// let chain: Vec<_> = (0..5).map(|i| Point3::new(f64::from(i), 0.0, 0.0)).collect();
    /// let field = fem_ref::FemField::on_line(chain, 1e-6)?;
    /// assert_eq!((field.nodes().len(), field.cells().len()), (5, 4));
    /// # Ok::<(), fem_ref::Error>(())
    /// ```
    ///
    /// # Errors
    /// The errors of [`Mesh::new`] (fewer than two points, coincident points, coordinates that are not
    /// finite) and of [`Mesh::with_section`].
    pub fn on_line(points: Vec<Point3<T>>, section: T) -> Result<Self> {
        // Along the line from the first point to the farthest one, in whatever order points come.
        let origin = points.first().copied().unwrap_or_else(Point3::origin);
        let far = |p: &Point3<T>| (p - origin).norm_squared();
        let axis = points.iter().fold(Vector3::zeros(), |a, p| {
            if far(p) > a.norm_squared() { p - origin } else { a }
        });
        let mut order: Vec<u32> = (0..points.len() as u32).collect();
        let station = |k: &u32| axis.dot(&(points[*k as usize] - origin)).as_f64();
        order.sort_by(|a, b| station(a).total_cmp(&station(b)));
        let connectivity = order.windows(2).flatten().copied().collect();
        let mesh = Mesh::new(ElementKind::Bar2, points, connectivity)?.with_section(section)?;
        Ok(Self::new(mesh))
    }

    /// The mesh.
    pub fn mesh(&self) -> &Mesh<T> {
        &self.mesh
    }

    /// Adds the integration cells of element `e`: one cell, or several if its faces are not planar.
    pub fn cells_of(&self, e: usize, out: &mut Vec<Cell<T>>) {
        let planar = self.hexes.get(e).is_none_or(|h| h.warp <= self.tolerance);
        self.mesh.cells_of(e, planar, out);
    }

    /// Local coordinates of `x` in hexahedron `e`; `None` far outside of a hexahedron that is not affine.
    fn hex_local(&self, e: usize, x: &Point3<T>) -> Option<Vector3<T>> {
        let shape = &self.hexes[e];
        let inverse = shape.inverse.as_ref()?;
        let xi = inverse * (x - shape.centre);
        match shape.map {
            HexMap::Affine => Some(xi),
            HexMap::Nearly => Some(xi + inverse * (x - element::hex_map(&self.mesh.corners(e), &xi))),
            // Most elements that are asked lie beside the point, and Newton's method costs more.
            HexMap::Bent(reach) if xi.amax() > reach => None,
            HexMap::Bent(_) => element::hex_inverse(&self.mesh.corners(e), x, xi),
        }
    }

    /// Local coordinates of `x` in element `e`, with the distance by which they leave it.
    fn local(&self, e: usize, x: &Point3<T>) -> Option<Located<T>> {
        let (zero, one) = (T::zero(), T::one());
        let (local, violation) = match self.mesh.kind() {
            ElementKind::Bar2 => {
                let p = self.mesh.corners(e);
                let d = p[1] - p[0];
                let s = d.dot(&(x - p[0])) / d.norm_squared();
                // Off the line counts like beyond the ends.
                let off = (x - (p[0] + d * s)).norm() / d.norm();
                ([one - s, s, zero, zero], (-s).max(s - one).max(off))
            }
            ElementKind::Tet4 => {
                let first = self.mesh.nodes()[self.mesh.element(e)[0] as usize];
                let b = self.tets[e].map(|g| g.dot(&(x - first)));
                let local = [one - b[0] - b[1] - b[2], b[0], b[1], b[2]];
                (local, local.into_iter().fold(-one, |v, l| v.max(-l)))
            }
            ElementKind::Hex8 => {
                let xi = self.hex_local(e, x)?;
                // A point that is off a face by round-off is moved onto it, so that nodes not on the face get
                // no weight.
                let xi = xi.map(|c: T| {
                    if (c.abs() - one).abs() < T::epsilon() * T::of(128.0) {
                        one.copysign(c)
                    } else {
                        c
                    }
                });
                // Half, since the reference cube has edges of length two.
                ([xi.x, xi.y, xi.z, zero], (xi.amax() - one) * T::of(0.5))
            }
        };
        Some(Located {
            element: e,
            local,
            violation,
        })
    }

    /// Returns the element that holds `x`. If there is none, returns a warped hexahedron near `x`, because
    /// its integration cells may extend beyond its curved face.
    fn locate(&self, x: &Point3<T>) -> Option<Located<T>> {
        let mut best: Option<Located<T>> = None;
        let mut near: Option<Located<T>> = None;
        self.tree.any(&[*x, *x], &mut |e| {
            // A lower number has been found: a higher one could not be chosen.
            if best.as_ref().is_some_and(|b| b.element < e) {
                return false;
            }
            let Some(located) = self.local(e, x) else {
                return false;
            };
            if located.violation <= self.tolerance {
                best = Some(located);
            } else if self
                .hexes
                .get(e)
                .is_some_and(|h| located.violation <= h.warp * T::of(NEAR))
            {
                let closer = near.as_ref().is_none_or(|n| {
                    located.violation < n.violation
                        || (located.violation <= n.violation && located.element < n.element)
                });
                if closer {
                    near = Some(located);
                }
            }
            false
        });
        best.or(near)
    }

    /// Element that holds a point; of several, the one of lowest number.
    pub fn element_at(&self, x: &Point3<T>) -> Option<usize> {
        self.locate(x).map(|located| located.element)
    }

    /// Element that holds a point, and the value at the point of a field given by its nodal `values`.
    ///
    /// # Panics
    /// If there are fewer values than nodes.
    pub fn value_at(&self, x: &Point3<T>, values: &[T]) -> Option<(usize, T)> {
        let located = self.locate(x)?;
        let mut shape = [T::zero(); 8];
        match self.mesh.kind() {
            ElementKind::Hex8 => {
                shape = element::hex_values(&Vector3::new(
                    located.local[0],
                    located.local[1],
                    located.local[2],
                ));
            }
            ElementKind::Tet4 | ElementKind::Bar2 => shape[..4].copy_from_slice(&located.local),
        }
        let nodes = self.mesh.element(located.element).iter();
        let sum = nodes.zip(shape).map(|(k, n)| values[*k as usize] * n).sum();
        Some((located.element, sum))
    }

    /// Evaluates the shape functions at a located point.
    fn evaluate(
        &self,
        located: &Located<T>,
        x: &Point3<T>,
        gradient: bool,
        row: &mut ShapeRow<T>,
    ) -> arlequin_core::Result<()> {
        row.clear();
        let nodes = self.mesh.element(located.element);
        let mut values = [T::zero(); 8];
        let mut gradients = [Vector3::zeros(); 8];
        match self.mesh.kind() {
            ElementKind::Hex8 => {
                let xi = Vector3::new(located.local[0], located.local[1], located.local[2]);
                values = element::hex_values(&xi);
                if gradient {
                    let local = element::hex_gradients(&xi);
                    let shape = &self.hexes[located.element];
                    let inverse = match &shape.inverse {
                        Some(inverse) if matches!(shape.map, HexMap::Affine) => Some(*inverse),
                        _ => element::hex_jacobian(&self.mesh.corners(located.element), &local).try_inverse(),
                    };
                    let Some(inverse) = inverse else {
                        return Err(outside(x, self.kind()));
                    };
                    gradients = local.map(|g| inverse.tr_mul(&g));
                }
            }
            ElementKind::Tet4 => {
                values[..4].copy_from_slice(&located.local);
                if gradient {
                    let p = self.mesh.corners(located.element);
                    gradients[..4].copy_from_slice(&element::tet_gradients(&p).0);
                }
            }
            ElementKind::Bar2 => {
                values[..2].copy_from_slice(&located.local[..2]);
                let p = self.mesh.corners(located.element);
                let d = p[1] - p[0];
                gradients[1] = d / d.norm_squared();
                gradients[0] = -gradients[1];
            }
        }
        // A value of a few units of round-off belongs to a point on a face: the node gets no weight.
        let nothing = T::epsilon() * T::of(4.0);
        for (k, &node) in nodes.iter().enumerate() {
            if gradient {
                row.push_with_gradient(node as usize, values[k], gradients[k]);
            } else if values[k].abs() > nothing {
                row.push(node as usize, values[k]);
            }
        }
        Ok(())
    }
}

fn hex_shape<T: Real>(p: &[Point3<T>; 8]) -> HexShape<T> {
    let j = element::hex_jacobian(p, &element::hex_gradients(&Vector3::zeros()));
    // Relative to the size of the Jacobian, which is that of the element.
    let size = j.norm();
    let centre = element::hex_map(p, &Vector3::zeros());
    // How far the corners are from those of the affine map at the centre.
    let corners = p.iter().zip(element::HEX_CORNERS);
    let bends = corners.map(|(x, c)| x - centre - j * Vector3::from(c.map(T::of)));
    let bent = bends.clone().map(|b| b.norm()).fold(T::zero(), T::max);
    let warp = ElementKind::Hex8.faces().iter().map(|f| {
        let d = [1, 2, 3].map(|k: usize| p[f[k]] - p[f[0]]);
        let normal = d[0].cross(&d[2]) + (p[f[3]] - p[f[2]]).cross(&(p[f[1]] - p[f[2]]));
        d[1].dot(&d[0].cross(&d[2])).abs() / (normal.norm() * size)
    });
    let warp = warp.fold(T::zero(), |a, b| a.max(b));
    let inverse = j.try_inverse();
    let map = if bent <= size * T::epsilon() * T::of(16.0) {
        HexMap::Affine
    } else if bent <= size * T::epsilon().sqrt() {
        HexMap::Nearly
    } else {
        // A point in the element deviates from the affine map by a mean of the corners' deviations, one at
        // the distance `s` from it by at most (1 + s)³ of the largest.
        let local = bends.map(|b| inverse.map_or(T::zero(), |i| (i * b).amax()));
        let out = T::one() + warp * T::of(NEAR * 2.0) + T::of(0.01);
        HexMap::Bent(out + out.powi(3) * local.fold(T::zero(), T::max))
    };
    HexShape {
        centre,
        inverse,
        map,
        warp,
    }
}

impl<T: Real> Interpolation<T> for FemField<T> {
    fn nodes(&self) -> &[Point3<T>] {
        self.mesh.nodes()
    }

    fn shape_at(&self, x: &Point3<T>, gradient: bool, row: &mut ShapeRow<T>) -> arlequin_core::Result<()> {
        match self.locate(x) {
            Some(located) => self.evaluate(&located, x, gradient, row),
            None => Err(outside(x, self.kind())),
        }
    }

    fn shape_in(
        &self,
        cell: usize,
        x: &Point3<T>,
        gradient: bool,
        row: &mut ShapeRow<T>,
    ) -> arlequin_core::Result<()> {
        // Warped hexahedra are cut into several cells, so that numbers of cells and elements differ.
        if self.warped {
            return self.shape_at(x, gradient, row);
        }
        match self.local(cell, x) {
            Some(located) => self.evaluate(&located, x, gradient, row),
            None => Err(outside(x, self.kind())),
        }
    }

    fn cells(&self) -> Vec<Cell<T>> {
        let mut out = Vec::with_capacity(self.mesh.element_count());
        for e in 0..self.mesh.element_count() {
            self.cells_of(e, &mut out);
        }
        out
    }

    fn cells_within(&self, bounds: &[Point3<T>; 2]) -> Option<Vec<(usize, Cell<T>)>> {
        if self.warped {
            // Numbers of cells and elements differ.
            return Some(self.cells().into_iter().enumerate().collect());
        }
        let mut near = Vec::new();
        self.tree.any(bounds, &mut |e| {
            near.push(e);
            false
        });
        near.sort_unstable();
        let mut cells = Vec::with_capacity(1);
        let cell = |e: usize| {
            self.cells_of(e, &mut cells);
            cells.pop().map(|c| (e, c))
        };
        Some(near.into_iter().filter_map(cell).collect())
    }

    fn degree(&self) -> usize {
        match self.mesh.kind() {
            ElementKind::Bar2 | ElementKind::Tet4 => 1,
            ElementKind::Hex8 => 3,
        }
    }

    fn warp(&self) -> T {
        self.hexes.iter().fold(T::zero(), |m, h| m.max(h.warp))
    }

    fn kind(&self) -> &'static str {
        "finite-element"
    }
}

/// A multiplier space on a mesh that fills the overlap; its spacing `h_B` is the mean edge length.
impl<T: Real> Mediator<T> for FemField<T> {
    fn spacing(&self) -> T {
        self.mesh.spacing()
    }
}
