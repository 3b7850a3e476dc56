//! The three elements: shape functions, Gauss points, inverse mapping.
//!
//! The node order is that of Gmsh and VTK. Corner 3 of a tetrahedron lies on the side of `(1 − 0) × (2 − 0)`;
//! a hexahedron lists its bottom loop and then its top loop. The hexahedron is integrated with 2 × 2 × 2
//! Gauss points, bars and tetrahedra with one.

use arlequin_core::Real;
use nalgebra::{Matrix3, Point3, Vector3};

/// Kind of all elements of a mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ElementKind {
    /// Two-node bar with a cross-section; has axial displacements only.
    Bar2,
    /// Four-node tetrahedron, linear.
    Tet4,
    /// Eight-node hexahedron, trilinear.
    Hex8,
}

/// Largest number of corners of any element kind.
pub(crate) const MAX_CORNERS: usize = 8;

impl ElementKind {
    /// Number of corners.
    pub const fn corners(self) -> usize {
        match self {
            Self::Bar2 => 2,
            Self::Tet4 => 4,
            Self::Hex8 => 8,
        }
    }

    /// Displacement components per node: 1 for bars, 3 for solids.
    pub const fn components(self) -> usize {
        match self {
            Self::Bar2 => 1,
            Self::Tet4 | Self::Hex8 => 3,
        }
    }

    /// Name for messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Bar2 => "bar2",
            Self::Tet4 => "tet4",
            Self::Hex8 => "hex8",
        }
    }

    /// Local corners of every face, in the order that makes the normal of the loop point outwards. The faces
    /// of a bar are its ends.
    pub const fn faces(self) -> &'static [&'static [usize]] {
        match self {
            Self::Bar2 => &[&[0], &[1]],
            Self::Tet4 => &[&[0, 2, 1], &[0, 1, 3], &[1, 2, 3], &[0, 3, 2]],
            Self::Hex8 => &[
                &[0, 3, 2, 1],
                &[4, 5, 6, 7],
                &[0, 1, 5, 4],
                &[1, 2, 6, 5],
                &[2, 3, 7, 6],
                &[3, 0, 4, 7],
            ],
        }
    }

    /// Local end points of every edge.
    pub const fn edges(self) -> &'static [[usize; 2]] {
        match self {
            Self::Bar2 => &[[0, 1]],
            Self::Tet4 => &[[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]],
            Self::Hex8 => &[
                [0, 1],
                [1, 2],
                [2, 3],
                [3, 0],
                [4, 5],
                [5, 6],
                [6, 7],
                [7, 4],
                [0, 4],
                [1, 5],
                [2, 6],
                [3, 7],
            ],
        }
    }
}

/// Corners of the reference cube `[−1, 1]³`.
pub(crate) const HEX_CORNERS: [[f64; 3]; 8] = [
    [-1.0, -1.0, -1.0],
    [1.0, -1.0, -1.0],
    [1.0, 1.0, -1.0],
    [-1.0, 1.0, -1.0],
    [-1.0, -1.0, 1.0],
    [1.0, -1.0, 1.0],
    [1.0, 1.0, 1.0],
    [-1.0, 1.0, 1.0],
];

/// Shape functions `N_i(ξ) = Π_a (1 + ξ_ia ξ_a) / 8` of the hexahedron \[–\].
pub(crate) fn hex_values<T: Real>(xi: &Vector3<T>) -> [T; 8] {
    let eighth = T::of(0.125);
    HEX_CORNERS.map(|c| {
        // At corners every factor is exactly zero or two, so that values there are exact.
        (0..3).fold(eighth, |n, a| {
            if c[a] > 0.0 {
                n * (T::one() + xi[a])
            } else {
                n * (T::one() - xi[a])
            }
        })
    })
}

/// Gradients of [`hex_values`] with respect to `ξ` \[–\].
pub(crate) fn hex_gradients<T: Real>(xi: &Vector3<T>) -> [Vector3<T>; 8] {
    let eighth = T::of(0.125);
    HEX_CORNERS.map(|c| {
        let s = c.map(T::of);
        let f = |a: usize| T::one() + s[a] * xi[a];
        Vector3::new(s[0] * f(1) * f(2), s[1] * f(0) * f(2), s[2] * f(0) * f(1)) * eighth
    })
}

/// Jacobian `∂x/∂ξ` of a hexahedron \[m\], from its local gradients.
pub(crate) fn hex_jacobian<T: Real>(p: &[Point3<T>; 8], gradients: &[Vector3<T>; 8]) -> Matrix3<T> {
    let mut j = Matrix3::zeros();
    for (x, g) in p.iter().zip(gradients) {
        j += x.coords * g.transpose();
    }
    j
}

/// Position of the local coordinates `xi` in a hexahedron \[m\].
pub(crate) fn hex_map<T: Real>(p: &[Point3<T>; 8], xi: &Vector3<T>) -> Point3<T> {
    let values = hex_values(xi);
    let sum = p
        .iter()
        .zip(values)
        .fold(Vector3::zeros(), |s, (x, n)| s + x.coords * n);
    Point3::from(sum)
}

/// One integration point of an element; entries beyond the element's corners are undefined.
#[derive(Debug, Clone)]
pub struct GaussPoint<T: Real> {
    /// Weight times Jacobian \[m³\].
    pub weight: T,
    /// Shape function values \[–\].
    pub values: [T; MAX_CORNERS],
    /// Shape function gradients \[1/m\].
    pub gradients: [Vector3<T>; MAX_CORNERS],
}

/// Gradients of the barycentric coordinates of a tetrahedron \[1/m\], and six times its volume \[m³\].
pub(crate) fn tet_gradients<T: Real>(p: &[Point3<T>; 8]) -> ([Vector3<T>; 4], T) {
    let (a, b, c) = (p[1] - p[0], p[2] - p[0], p[3] - p[0]);
    let six = a.cross(&b).dot(&c);
    // Normals of faces over six volumes; the fourth follows from the sum of one.
    let g = [b.cross(&c) / six, c.cross(&a) / six, a.cross(&b) / six];
    ([-(g[0] + g[1] + g[2]), g[0], g[1], g[2]], six)
}

/// Calls `visit` for each Gauss point of an element. Entries of `p` beyond the element's corners are ignored.
pub(crate) fn for_each_gauss<T: Real>(
    kind: ElementKind,
    p: &[Point3<T>; 8],
    section: T,
    mut visit: impl FnMut(&GaussPoint<T>),
) {
    let mut point = GaussPoint {
        weight: T::zero(),
        values: [T::zero(); 8],
        gradients: [Vector3::zeros(); 8],
    };
    match kind {
        ElementKind::Bar2 => {
            let d = p[1] - p[0];
            let g = d / d.norm_squared();
            point.weight = d.norm() * section;
            // One point is exact for linear functions: the middle, where both are one half.
            point.values[..2].fill(T::of(0.5));
            point.gradients[0] = -g;
            point.gradients[1] = g;
            visit(&point);
        }
        ElementKind::Tet4 => {
            let (g, six) = tet_gradients(p);
            point.weight = six / T::of(6.0);
            point.values[..4].fill(T::of(0.25));
            point.gradients[..4].copy_from_slice(&g);
            visit(&point);
        }
        ElementKind::Hex8 => {
            // Two points per direction integrate the stiffness of a parallelepiped exactly.
            let a = T::of(1.0 / 3f64.sqrt());
            for c in HEX_CORNERS {
                let xi = Vector3::from(c.map(T::of)) * a;
                let local = hex_gradients(&xi);
                let j = hex_jacobian(p, &local);
                point.weight = j.determinant();
                point.values = hex_values(&xi);
                // The Jacobian of a valid mesh is invertible; zero gradients mark the impossible case.
                let inverse = j.try_inverse().unwrap_or_else(Matrix3::zeros).transpose();
                point.gradients = local.map(|g| inverse * g);
                visit(&point);
            }
        }
    }
}

/// `∫ N_i dV` of every corner \[m³\]: row sums of the consistent mass, divided by the density.
pub(crate) fn nodal_volumes<T: Real>(kind: ElementKind, p: &[Point3<T>; 8], section: T) -> [T; 8] {
    let mut out = [T::zero(); 8];
    for_each_gauss(kind, p, section, |g| {
        for (o, n) in out.iter_mut().zip(&g.values) {
            *o += g.weight * *n;
        }
    });
    out
}

/// Coefficients of the map of a hexahedron, `x(ξ) = Σ_m a_m m(ξ)` \[m\] with the monomials
/// `m = 1, ξ, η, ζ, ξη, ηζ, ζξ, ξηζ`.
struct Trilinear<T: Real>([Vector3<T>; 8]);

impl<T: Real> Trilinear<T> {
    fn new(p: &[Point3<T>; 8]) -> Self {
        // Sums and differences along one axis after the other.
        let halves = |a: &Vector3<T>, b: &Vector3<T>| [(a + b) * T::of(0.5), (b - a) * T::of(0.5)];
        let edge = |a: usize, b: usize| halves(&p[a].coords, &p[b].coords);
        let face = |low: [Vector3<T>; 2], high: [Vector3<T>; 2]| {
            let [a, b] = halves(&low[0], &high[0]);
            let [c, d] = halves(&low[1], &high[1]);
            [a, b, c, d]
        };
        let (low, high) = (face(edge(0, 1), edge(3, 2)), face(edge(4, 5), edge(7, 6)));
        let [constant, z] = halves(&low[0], &high[0]);
        let [y, yz] = halves(&low[1], &high[1]);
        let [x, zx] = halves(&low[2], &high[2]);
        let [xy, xyz] = halves(&low[3], &high[3]);
        Self([constant, x, y, z, xy, yz, zx, xyz])
    }

    /// Position at `ξ` \[m\] and Jacobian `∂x/∂ξ` there \[m\].
    fn position_and_jacobian(&self, xi: &Vector3<T>) -> (Vector3<T>, Matrix3<T>) {
        let [constant, x, y, z, xy, yz, zx, xyz] = &self.0;
        // x(ξ) = c + ξ p + η (y + ζ yz) + ζ z, with p = ∂x/∂ξ.
        let bend = yz + xyz * xi.x;
        let along_x = x + xy * xi.y + (zx + xyz * xi.y) * xi.z;
        let along_y = y + xy * xi.x + bend * xi.z;
        let along_z = z + zx * xi.x + bend * xi.y;
        let position = constant + along_x * xi.x + (y + yz * xi.z) * xi.y + z * xi.z;
        (position, Matrix3::from_columns(&[along_x, along_y, along_z]))
    }
}

/// Local coordinates of `x` in a hexahedron by Newton's method from `start`; `None` if the iteration does not
/// converge near the element.
pub(crate) fn hex_inverse<T: Real>(
    p: &[Point3<T>; 8],
    x: &Point3<T>,
    start: Vector3<T>,
) -> Option<Vector3<T>> {
    // Clamped within this distance: far outside, the map may fold over and Newton's method wander.
    let reach = T::of(3.0);
    let settled = T::epsilon() * T::of(16.0);
    let map = Trilinear::new(p);
    let mut xi = start;
    let mut step = T::of(f64::from(f32::MAX));
    for _ in 0..50 {
        let (position, jacobian) = map.position_and_jacobian(&xi);
        let d = jacobian.try_inverse()? * (x.coords - position);
        let size = d.amax();
        if !size.is_finite() {
            return None;
        }
        // Near the solution, steps shrink until round-off stops them.
        let stalled = size >= step && size < T::epsilon().sqrt();
        xi = (xi + d).map(|c| c.clamp(-reach, reach));
        step = size;
        // A stalled iteration is as good as a settled one: round-off allows no more.
        if size <= settled || stalled {
            return (xi.amax() < reach).then_some(xi);
        }
    }
    None
}

/// Cuts a hexahedron into six tetrahedra, in the same way for all hexahedra at a face if `rank` is the same.
pub(crate) fn split_hexahedron(corners: &[u32], rank: impl Fn(u32) -> u32) -> [[u32; 4]; 6] {
    // The corner of lowest rank is the apex. Each of the three faces without the apex is cut along the
    // diagonal from its own lowest corner and joined to the apex. Neighbours therefore cut their common face
    // alike; so do the two lips of a slit if ranks are the same for nodes at the same place.
    let apex = (0..8).min_by_key(|&k| rank(corners[k])).unwrap_or(0);
    let mut out = [[0; 4]; 6];
    let far = ElementKind::Hex8.faces().iter().filter(|f| !f.contains(&apex));
    for (slot, face) in out.chunks_exact_mut(2).zip(far) {
        let low = (0..4).min_by_key(|&k| rank(corners[face[k]])).unwrap_or(0);
        let corner = |k: usize| corners[face[(low + k) % 4]];
        slot[0] = [corners[apex], corner(0), corner(1), corner(2)];
        slot[1] = [corners[apex], corner(0), corner(2), corner(3)];
    }
    out
}
