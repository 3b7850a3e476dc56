//! Meshes and fields.

use crate::arrays::{Numbers, coordinates, point, points};
use crate::border::outside;
use crate::error::Fault;
use arlequin::cnem::NaturalField;
use arlequin::cnem::natural::Interpolant;
use arlequin::core::{Interpolation, Mediator, ParticleField, ShapeRow};
use arlequin::fem_ref::{ElementKind, FemField, generate};
use numpy::{AllowTypeChange, PyArray1, PyArray2, PyArrayLike2};
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::Arc;

/// Arrays of node numbers. They are read as floating-point numbers, so that 0.5 is refused and not cut to
/// 0.
pub(crate) type Connectivity<'py> = PyArrayLike2<'py, f64, AllowTypeChange>;

/// Node numbers and values.
type Row<'py> = (Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<f64>>);

/// A finite element mesh: bars along x, tetrahedra or hexahedra of corner nodes.
///
/// `kind` is "bar", "tet" or "hex", `points` are nodes [m], `cells` the corners of each element, `section`
/// the cross-section of bars [m2].
#[pyclass(frozen, module = "arlequin")]
#[derive(Debug)]
pub(crate) struct Mesh(pub(crate) Arc<FemField<f64>>);

fn kind_of(name: &str) -> Result<ElementKind, Fault> {
    match name {
        "bar" => Ok(ElementKind::Bar2),
        "tet" => Ok(ElementKind::Tet4),
        "hex" => Ok(ElementKind::Hex8),
        _ => Err(Fault::new(
            "InvalidParameter",
            format!("kind of elements = '{name}': must be bar, tet or hex"),
        )),
    }
}

impl Mesh {
    pub(crate) fn from_mesh(mesh: arlequin::fem_ref::Mesh<f64>) -> Self {
        Self(Arc::new(FemField::new(mesh)))
    }
}

/// Reads node numbers from rows of `columns` numbers.
pub(crate) fn node_numbers(what: &str, from: &Connectivity<'_>, columns: usize) -> Result<Vec<u32>, Fault> {
    let numbers = from.as_array();
    if numbers.ncols() != columns {
        let rule = format!(
            "{what}: node numbers have the shape {:?}; give (n, {columns})",
            numbers.shape()
        );
        return Err(Fault::new("SizeMismatch", rule));
    }
    let is_number = |k: &f64| k.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(k);
    if let Some(k) = numbers.iter().find(|k| !is_number(k)) {
        let rule = format!(
            "{what} has the node number {k}; they are whole, from 0 to {}",
            u32::MAX
        );
        return Err(Fault::new("InvalidParameter", rule));
    }
    Ok(numbers.iter().map(|k| *k as u32).collect())
}

#[pymethods]
impl Mesh {
    #[new]
    #[pyo3(signature = (kind, points, cells, section = 1.0))]
    fn new(kind: &str, points: Numbers<'_>, cells: Connectivity<'_>, section: f64) -> Result<Self, Fault> {
        let (kind, nodes) = (
            kind_of(kind)?,
            crate::arrays::points("points of the mesh", &points)?,
        );
        let cells = node_numbers("the mesh", &cells, kind.corners())?;
        let mesh = arlequin::fem_ref::Mesh::new(kind, nodes, cells)?;
        Ok(Self::from_mesh(if kind == ElementKind::Bar2 {
            mesh.with_section(section)?
        } else {
            mesh
        }))
    }

    /// `count` equal bars from `start` to `end` [m].
    #[staticmethod]
    #[pyo3(signature = (start, end, count, section = 1.0))]
    fn bar(start: f64, end: f64, count: usize, section: f64) -> Result<Self, Fault> {
        Ok(Self::from_mesh(generate::bar(start, end, count, section)?))
    }

    /// Bars between increasing coordinates along x [m].
    #[staticmethod]
    #[pyo3(signature = (x, section = 1.0))]
    fn line(x: Numbers<'_>, section: f64) -> Result<Self, Fault> {
        Ok(Self::from_mesh(generate::bar_at(
            &crate::arrays::flat(&x),
            section,
        )?))
    }

    /// A box from corner `low` to corner `high` [m] with `counts` elements along x, y and z. For "tet" each
    /// count is a box of six tetrahedra.
    #[staticmethod]
    fn block(kind: &str, low: Numbers<'_>, high: Numbers<'_>, counts: [usize; 3]) -> Result<Self, Fault> {
        let corners = [point("low", &low)?, point("high", &high)?];
        let [low, high] = corners;
        Ok(Self::from_mesh(generate::block(
            kind_of(kind)?,
            low,
            high,
            counts,
        )?))
    }

    /// Reads a mesh file of Gmsh.
    #[staticmethod]
    fn read(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        outside(py, || Ok(Self::from_mesh(arlequin::fem_ref::gmsh::load(&path)?)))
    }

    /// Nodes [m], (n, 3).
    #[getter]
    fn points<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        coordinates(py, self.0.nodes())
    }

    /// Corner nodes of each element.
    #[getter]
    fn cells<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let mesh = self.0.mesh();
        let corners: Vec<i64> = mesh.connectivity().iter().map(|k| i64::from(*k)).collect();
        PyArray1::from_vec(py, corners).call_method1("reshape", (-1, mesh.kind().corners()))
    }

    /// Kind of the elements: "bar", "tet" or "hex".
    #[getter]
    fn kind(&self) -> &'static str {
        match self.0.mesh().kind() {
            ElementKind::Bar2 => "bar",
            ElementKind::Tet4 => "tet",
            ElementKind::Hex8 => "hex",
        }
    }

    /// Volume [m3].
    #[getter]
    fn volume(&self) -> f64 {
        self.0.mesh().volume()
    }

    /// Field with the mesh's shape functions.
    #[getter]
    fn field(&self) -> Field {
        Field(self.0.clone())
    }

    fn __repr__(&self) -> String {
        let mesh = self.0.mesh();
        format!(
            "<Mesh: {} elements '{}', {} nodes>",
            mesh.element_count(),
            self.kind(),
            mesh.nodes().len()
        )
    }
}

/// Shape functions: interpolate nodal values at any point.
#[pyclass(frozen, module = "arlequin")]
pub(crate) struct Field(pub(crate) Arc<dyn Interpolation<f64>>);

#[pymethods]
impl Field {
    /// Shape functions of finite elements.
    #[staticmethod]
    fn of_mesh(mesh: &Mesh) -> Self {
        mesh.field()
    }

    /// Natural-neighbour shape functions of points [m] that span space, inside their convex hull.
    #[staticmethod]
    fn natural(py: Python<'_>, points: Numbers<'_>) -> PyResult<Self> {
        let nodes = crate::arrays::points("points", &points)?;
        outside(py, || {
            Ok(Self(Arc::new(NaturalField::from_points(
                &nodes,
                Interpolant::Laplace,
            )?)))
        })
    }

    /// Values at particles only; each particle represents a volume [m3]. `pairs` of neighbours add
    /// gradients, which H1 junctions need.
    #[staticmethod]
    #[pyo3(signature = (points, volumes, pairs = None))]
    fn particles(
        points: Numbers<'_>,
        volumes: Numbers<'_>,
        pairs: Option<Connectivity<'_>>,
    ) -> Result<Self, Fault> {
        let nodes = crate::arrays::points("points", &points)?;
        let mut field = ParticleField::new(nodes, &crate::arrays::flat(&volumes))?;
        if let Some(pairs) = pairs {
            let numbers = node_numbers("pairs", &pairs, 2)?;
            field = field.with_gradients(numbers.as_chunks::<2>().0)?;
        }
        Ok(Self(Arc::new(field)))
    }

    /// Nodes [m], (n, 3).
    #[getter]
    fn points<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        coordinates(py, self.0.nodes())
    }

    /// Nodes and shape functions at a point [m]: the field there is `values @ u[nodes]`.
    fn shape_at<'py>(&self, py: Python<'py>, x: Numbers<'py>) -> PyResult<Row<'py>> {
        let mut row = ShapeRow::default();
        let result = self.0.shape_at(&point("x", &x)?, false, &mut row);
        result.map_err(Fault::from)?;
        let nodes = row.nodes.iter().map(|k| *k as i64).collect();
        Ok((PyArray1::from_vec(py, nodes), PyArray1::from_vec(py, row.values)))
    }

    fn __repr__(&self) -> String {
        format!("<Field: {}, {} nodes>", self.0.kind(), self.0.nodes().len())
    }
}

/// Returns a field, or the field of a mesh.
pub(crate) fn field_of(from: &Bound<'_, PyAny>) -> PyResult<Arc<dyn Interpolation<f64>>> {
    if let Ok(mesh) = from.cast::<Mesh>() {
        return Ok(mesh.get().0.clone());
    }
    if let Ok(field) = from.cast::<Field>() {
        return Ok(field.get().0.clone());
    }
    let rule = format!("{from} is no field: give an arlequin.Mesh or an arlequin.Field");
    Err(Fault::new("InvalidParameter", rule).into())
}

/// Returns the multiplier space on a mesh, or on natural neighbours of points.
pub(crate) fn mediator_of(from: &Bound<'_, PyAny>) -> PyResult<Arc<dyn Mediator<f64>>> {
    if let Ok(mesh) = from.cast::<Mesh>() {
        return Ok(mesh.get().0.clone());
    }
    let nodes = points("nodes of the mediator", &from.extract::<Numbers<'_>>()?)?;
    outside(from.py(), || {
        let field = NaturalField::from_points(&nodes, Interpolant::Laplace)?.with_voronoi_cells()?;
        Ok(Arc::new(field) as Arc<dyn Mediator<f64>>)
    })
}
