//! Structured meshes: bars, boxes, cylinders, balls.
//!
//! Nodes are numbered layer by layer along x, which keeps the bandwidth of beams small. All generated solids
//! have groups for their faces; bars have groups for their ends, `x-min` and `x-max`.

mod ball;

pub use ball::ball;

use crate::element::ElementKind;
use crate::error::{Error, Result, parameter};
use crate::mesh::Mesh;
use arlequin_core::Real;
use nalgebra::Point3;
use std::ops::Range;

/// Makes a bar along x from `x0` to `x1` \[m\] with `n` equal elements and a cross-section \[m²\]. Groups:
/// `x-min`, `x-max`.
///
/// ```
/// let bar = fem_ref::generate::bar(0.0, 0.1, 20, 1e-4)?;
/// assert_eq!((bar.nodes().len(), bar.element_count()), (21, 20));
/// # Ok::<(), fem_ref::Error>(())
/// ```
///
/// # Errors
/// [`Error::Parameter`] for `n = 0`, ends that do not ascend, or a section that is not positive.
pub fn bar<T: Real>(x0: T, x1: T, n: usize, section: T) -> Result<Mesh<T>> {
    count("bar elements", n)?;
    ascending("bar end x1", x0, x1)?;
    bar_at(
        &(0..=n).map(|i| between(x0, x1, i, n)).collect::<Vec<_>>(),
        section,
    )
}

/// Makes a bar along x with nodes at the given ascending coordinates \[m\] and a cross-section \[m²\].
///
/// # Errors
/// [`Error::Parameter`] unless the coordinates ascend and the section is positive; otherwise the errors of
/// [`Mesh::new`].
pub fn bar_at<T: Real>(x: &[T], section: T) -> Result<Mesh<T>> {
    for w in x.windows(2) {
        ascending("bar coordinate", w[0], w[1])?;
    }
    let nodes = x.iter().map(|&x| Point3::new(x, T::zero(), T::zero())).collect();
    let last = x.len().saturating_sub(1) as u32;
    let connectivity = (0..last).flat_map(|k| [k, k + 1]).collect();
    let mesh = Mesh::new(ElementKind::Bar2, nodes, connectivity)?.with_section(section)?;
    // Compared exactly: the ends have these coordinates to the last bit.
    let (low, high) = (x[0], x[x.len() - 1]);
    mesh.with_surfaces(&[("x-min", &|p| p.x <= low), ("x-max", &|p| p.x >= high)])
}

/// Makes a box between two corners \[m\] with `counts` hexahedra along x, y and z, or with six tetrahedra in
/// place of each hexahedron (Kuhn's conforming cut). Groups: `x-min`, `x-max`, `y-min`, `y-max`, `z-min`,
/// `z-max`.
///
/// ```
/// use arlequin_core::nalgebra::Point3;
/// use fem_ref::{ElementKind, generate};
/// let mesh = generate::block(ElementKind::Tet4, Point3::origin(), Point3::new(2.0, 1.0, 1.0), [4, 2, 2])?;
/// assert_eq!(mesh.element_count(), 6 * 16);
/// assert!((mesh.surface("x-max")?.iter().map(|f| f.area()).sum::<f64>() - 1.0).abs() < 1e-14);
/// # Ok::<(), fem_ref::Error>(())
/// ```
///
/// # Errors
/// [`Error::Parameter`] for a zero count or corners that do not ascend; [`Error::Kind`] for bars.
pub fn block<T: Real>(
    kind: ElementKind,
    low: Point3<T>,
    high: Point3<T>,
    counts: [usize; 3],
) -> Result<Mesh<T>> {
    cuboid(kind, &sides(low, high, counts)?, counts, |_| true)
}

/// Makes the box of [`block`] without the hexahedra inside a second box, `hole`. This is the mesh of a coarse
/// model around the region of a fine one. The faces of the hole must lie on faces of hexahedra. The hole is
/// open where it reaches beyond the box.
///
/// ```
/// use arlequin_core::nalgebra::Point3;
/// use fem_ref::{ElementKind, generate};
/// let frame = [Point3::new(1.0, 1.0, -1.0), Point3::new(3.0, 3.0, 2.0)];
/// let high = Point3::new(4.0, 4.0, 1.0);
/// let mesh = generate::hollow_block(ElementKind::Hex8, Point3::origin(), high, [4, 4, 1], frame)?;
/// assert_eq!((mesh.element_count(), mesh.nodes().len()), (12, 2 * 24));
/// # Ok::<(), fem_ref::Error>(())
/// ```
///
/// # Errors
/// The errors of [`block`]; [`Error::Parameter`] if a face of the hole is off the faces of hexahedra by more
/// than 1e-6 of an element's edge, and for a hole that removes no hexahedron or all of them.
pub fn hollow_block<T: Real>(
    kind: ElementKind,
    low: Point3<T>,
    high: Point3<T>,
    counts: [usize; 3],
    hole: [Point3<T>; 2],
) -> Result<Mesh<T>> {
    let sides = sides(low, high, counts)?;
    let gap = gap(low, high, counts, hole)?;
    let inside = |cell: [usize; 3]| (0..3).all(|c| (gap[c][0]..gap[c][1]).contains(&cell[c]));
    cuboid(kind, &sides, counts, |cell| !inside(cell))
}

/// Range of the hexahedra of [`hollow_block`] that lie in the hole, along each axis: the first one, and the
/// first one behind the hole.
///
/// # Errors
/// The errors of [`hollow_block`] about the hole.
pub fn gap<T: Real>(
    low: Point3<T>,
    high: Point3<T>,
    counts: [usize; 3],
    hole: [Point3<T>; 2],
) -> Result<[[usize; 2]; 3]> {
    let mut gap = [[0; 2]; 3];
    for (c, gap) in gap.iter_mut().enumerate() {
        let name = ["hole corner x", "hole corner y", "hole corner z"][c];
        ascending(name, hole[0][c], hole[1][c])?;
        let n = T::of(counts[c] as f64);
        for (layer, corner) in gap.iter_mut().zip(&hole) {
            let place = (((corner[c] - low[c]) / (high[c] - low[c])) * n).clamp(T::zero(), n);
            let nearest = place.round();
            // Round-off of `place` grows with the number of elements.
            if (place - nearest).abs() > T::of(1e-6).max(T::epsilon() * n * T::of(8.0)) {
                let rule = "must lie on a face between elements [m]; move it, or choose another element size";
                return Err(parameter(name, corner[c], rule));
            }
            *layer = nearest.as_f64() as usize;
        }
    }
    if gap.iter().any(|[a, b]| a == b) {
        return Err(parameter(
            "hole corner x",
            hole[0].x,
            "must leave out an element at least: hole and box do not meet",
        ));
    }
    if (0..3).all(|c| gap[c] == [0, counts[c]]) {
        return Err(parameter(
            "hole corner x",
            hole[0].x,
            "must leave an element: the hole takes the whole box",
        ));
    }
    Ok(gap)
}

/// Checks corners and counts, and returns the sides of the box.
fn sides<T: Real>(low: Point3<T>, high: Point3<T>, counts: [usize; 3]) -> Result<[Range<T>; 3]> {
    for (c, name) in ["box corner x", "box corner y", "box corner z"]
        .into_iter()
        .enumerate()
    {
        ascending(name, low[c], high[c])?;
        count("box elements", counts[c])?;
    }
    let [nx, ny, nz] = counts;
    count("box elements", nx.saturating_mul(ny).saturating_mul(nz))?;
    Ok([0, 1, 2].map(|c| low[c]..high[c]))
}

/// Makes a box of elements with the hexahedra for which `keep` is true, given their number along each axis.
fn cuboid<T: Real>(
    kind: ElementKind,
    sides: &[Range<T>; 3],
    counts: [usize; 3],
    keep: impl Fn([usize; 3]) -> bool,
) -> Result<Mesh<T>> {
    let [nx, ny, nz] = counts;
    let node = |i: usize, j: usize, k: usize| ((i * (ny + 1) + j) * (nz + 1) + k) as u32;
    let mut connectivity = Vec::with_capacity(8 * nx * ny * nz);
    for i in 0..nx {
        for j in 0..ny {
            for k in (0..nz).filter(|&k| keep([i, j, k])) {
                let ring = |k| {
                    [
                        node(i, j, k),
                        node(i + 1, j, k),
                        node(i + 1, j + 1, k),
                        node(i, j + 1, k),
                    ]
                };
                connectivity.extend(ring(k));
                connectivity.extend(ring(k + 1));
            }
        }
    }
    // Nodes inside the hole belong to no element and are left out.
    let mut used = vec![false; (nx + 1) * (ny + 1) * (nz + 1)];
    for &v in &connectivity {
        used[v as usize] = true;
    }
    let mut nodes = Vec::with_capacity(used.len());
    let mut number = vec![0; used.len()];
    for (v, _) in used.iter().enumerate().filter(|(_, used)| **used) {
        number[v] = nodes.len() as u32;
        let station = [v / ((ny + 1) * (nz + 1)), v / (nz + 1) % (ny + 1), v % (nz + 1)];
        let x = [0, 1, 2].map(|c| between(sides[c].start, sides[c].end, station[c], counts[c]));
        nodes.push(Point3::from(x));
    }
    for v in &mut connectivity {
        *v = number[*v as usize];
    }
    let [low, high] = [0, 1].map(|end| [0, 1, 2].map(|c| [sides[c].start, sides[c].end][end]));
    // Exact comparisons: `between` gives the faces their coordinates to the last bit.
    Mesh::new(ElementKind::Hex8, nodes, connectivity)?
        .with_surfaces(&[
            ("x-min", &|p| p.x <= low[0]),
            ("x-max", &|p| p.x >= high[0]),
            ("y-min", &|p| p.y <= low[1]),
            ("y-max", &|p| p.y >= high[1]),
            ("z-min", &|p| p.z <= low[2]),
            ("z-max", &|p| p.z >= high[2]),
        ])?
        .into_kind(kind, "a box")
}

/// Position of the side nodes of a meshed cylinder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Rim {
    /// On a circle slightly larger than the cylinder, so that the polygon has the area of the circle. Mass,
    /// axial stiffness and end loads of a beam are then those of the true cylinder on every mesh. This is the
    /// default, because these errors would otherwise dominate (2.6 % with 16 sides).
    #[default]
    EqualArea,
    /// On the cylinder: the mesh lies inside of it.
    Inscribed,
}

/// A circular cylinder around the x axis, meshed with a square core inside rings (butterfly).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cylinder<T> {
    /// End coordinates along x \[m\], ascending.
    pub ends: [T; 2],
    /// Radius \[m\].
    pub radius: T,
    /// Elements along each side of the square core; the polygon has four times as many sides.
    pub core: usize,
    /// Rings of elements around the core; half of `core` gives elements of even size.
    pub rings: usize,
    /// Layers of elements along x.
    pub layers: usize,
    /// Position of the side nodes.
    pub rim: Rim,
}

impl<T: Real> Cylinder<T> {
    /// Makes a cylinder whose elements have about the given size \[m\] in all directions.
    ///
    /// # Errors
    /// [`Error::Parameter`] unless the size is positive and finite and the ends ascend.
    pub fn with_size(ends: [T; 2], radius: T, size: T) -> Result<Self> {
        if !(size.is_finite() && size > T::zero()) {
            return Err(parameter("element size", size, "must be positive and finite [m]"));
        }
        ascending("cylinder end x1", ends[0], ends[1])?;
        let whole = |x: T| (x.as_f64().round() as usize).max(1);
        let across = (radius + radius) / size;
        // Half of the diameter for the core, the other half for the rings on both sides.
        let core = whole(across * T::of(0.5));
        let rings = core.div_ceil(2);
        Ok(Self {
            ends,
            radius,
            core,
            rings,
            layers: whole((ends[1] - ends[0]) / size),
            rim: Rim::default(),
        })
    }
}

/// Meshes a cylinder with hexahedra, or with six tetrahedra in place of each. Groups: `x-min`, `x-max`,
/// `side`.
///
/// ```
/// use fem_ref::{ElementKind, generate::{self, Cylinder}};
/// let (ends, rim) = ([0.0, 20e-3], Default::default());
/// let shape = Cylinder { ends, radius: 1e-3, core: 2, rings: 1, layers: 20, rim };
/// let mesh = generate::cylinder(ElementKind::Hex8, &shape)?;
/// assert_eq!(mesh.element_count(), 20 * (4 + 8));
/// assert!((mesh.volume() / (std::f64::consts::PI * 20e-9) - 1.0).abs() < 1e-12);
/// # Ok::<(), fem_ref::Error>(())
/// ```
///
/// # Errors
/// [`Error::Parameter`] for a zero count, ends that do not ascend, or a radius that is not positive;
/// [`Error::Kind`] for bars.
pub fn cylinder<T: Real>(kind: ElementKind, shape: &Cylinder<T>) -> Result<Mesh<T>> {
    let [x0, x1] = shape.ends;
    ascending("cylinder end x1", x0, x1)?;
    if !(shape.radius.is_finite() && shape.radius > T::zero()) {
        return Err(parameter(
            "cylinder radius",
            shape.radius,
            "must be positive and finite [m]",
        ));
    }
    count("cylinder core", shape.core)?;
    count("cylinder rings", shape.rings)?;
    count("cylinder layers", shape.layers)?;
    let section = shape
        .core
        .saturating_mul(shape.core.saturating_add(4 * shape.rings));
    count("cylinder elements", section.saturating_mul(shape.layers))?;
    let (points, quads) = butterfly(shape);
    let per_layer = points.len() as u32;
    let mut nodes = Vec::with_capacity((shape.layers + 1) * points.len());
    for i in 0..=shape.layers {
        let x = between(x0, x1, i, shape.layers);
        nodes.extend(points.iter().map(|[y, z]| Point3::new(x, *y, *z)));
    }
    let mut connectivity = Vec::with_capacity(8 * quads.len() * shape.layers);
    for i in 0..shape.layers as u32 {
        for quad in &quads {
            connectivity.extend(quad.map(|k| k + i * per_layer));
            connectivity.extend(quad.map(|k| k + (i + 1) * per_layer));
        }
    }
    // The margin takes in round-off of the side nodes and leaves out the next ring.
    let inside = rim_radius(shape) * T::of(1.0 - 1e-4);
    Mesh::new(ElementKind::Hex8, nodes, connectivity)?
        .with_surfaces(&[
            ("x-min", &|p| p.x <= x0),
            ("x-max", &|p| p.x >= x1),
            ("side", &|p| p.yz().coords.norm() >= inside),
        ])?
        .into_kind(kind, "a cylinder")
}

fn rim_radius<T: Real>(shape: &Cylinder<T>) -> T {
    match shape.rim {
        Rim::Inscribed => shape.radius,
        Rim::EqualArea => {
            // The polygon with 4·core sides has the area of the circle if its radius is larger by this
            // factor.
            let sector = std::f64::consts::FRAC_PI_2 / shape.core as f64;
            shape.radius * T::of((sector / sector.sin()).sqrt())
        }
    }
}

/// Points `(y, z)` \[m\] and counter-clockwise quadrilaterals of the cross-section.
fn butterfly<T: Real>(shape: &Cylinder<T>) -> (Vec<[T; 2]>, Vec<[u32; 4]>) {
    let (n, rings) = (shape.core, shape.rings);
    let (rim, m) = (rim_radius(shape).as_f64(), n as f64);
    // Core and rings share the area in proportion to their numbers of elements.
    let core = rim * (m / (m + 4.0 * rings as f64)).sqrt();
    let mut points = Vec::new();
    let point = |i: usize, j: usize| (i * (n + 1) + j) as u32;
    for i in 0..=n {
        for j in 0..=n {
            let (u, v) = (2.0 * i as f64 / m - 1.0, 2.0 * j as f64 / m - 1.0);
            // A square bulged half-way towards a disc.
            let disc = [u * (1.0 - v * v / 2.0).sqrt(), v * (1.0 - u * u / 2.0).sqrt()];
            points.push([0.43 * u + 0.5 * disc[0], 0.43 * v + 0.5 * disc[1]].map(|c| c * core));
        }
    }
    let mut quads = Vec::new();
    for i in 0..n {
        for j in 0..n {
            quads.push([point(i, j), point(i + 1, j), point(i + 1, j + 1), point(i, j + 1)]);
        }
    }
    // Border of the core, counter-clockwise from its lowest corner.
    let sides = (0..n).map(|k| point(k, 0)).chain((0..n).map(|k| point(n, k)));
    let sides = sides
        .chain((0..n).map(|k| point(n - k, n)))
        .chain((0..n).map(|k| point(0, n - k)));
    let mut inner: Vec<u32> = sides.collect();
    let border: Vec<[f64; 2]> = inner.iter().map(|&k| points[k as usize]).collect();
    for ring in 1..=rings {
        let t = ring as f64 / rings as f64;
        let first = points.len() as u32;
        for (k, b) in border.iter().enumerate() {
            // Each point of the core's border goes to its angle on the rim, evenly spaced.
            let angle = std::f64::consts::FRAC_PI_2 * (k as f64 / m - 1.5);
            let out = [rim * angle.cos(), rim * angle.sin()];
            points.push([b[0] + t * (out[0] - b[0]), b[1] + t * (out[1] - b[1])]);
        }
        let outer: Vec<u32> = (first..points.len() as u32).collect();
        for k in 0..inner.len() {
            let next = (k + 1) % inner.len();
            quads.push([inner[k], outer[k], outer[next], inner[next]]);
        }
        inner = outer;
    }
    (points.into_iter().map(|p| p.map(T::of)).collect(), quads)
}

impl<T: Real> Mesh<T> {
    fn into_kind(self, kind: ElementKind, what: &'static str) -> Result<Self> {
        match kind {
            ElementKind::Hex8 => Ok(self),
            ElementKind::Tet4 => self.into_tetrahedra(),
            ElementKind::Bar2 => Err(Error::Kind {
                what,
                kind: kind.name(),
                remedy: "tet4 or hex8",
            }),
        }
    }
}

/// Coordinate `i` of `n` equal steps between two ends, exact at both.
fn between<T: Real>(low: T, high: T, i: usize, n: usize) -> T {
    if i == n {
        high
    } else {
        low + (high - low) * T::of(i as f64 / n as f64)
    }
}

fn count(name: &'static str, n: usize) -> Result<()> {
    match n {
        0 => Err(parameter(name, n, "must be at least 1")),
        _ if n > 1 << 24 => Err(parameter(name, n, "must be at most 16777216")),
        _ => Ok(()),
    }
}

fn ascending<T: Real>(name: &'static str, low: T, high: T) -> Result<()> {
    if low.is_finite() && high.is_finite() && high > low {
        Ok(())
    } else {
        Err(parameter(
            name,
            high,
            "must be finite and above its predecessor [m]",
        ))
    }
}
