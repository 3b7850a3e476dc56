//! Models of the library.

use crate::arrays::{Numbers, array, coordinates, flat, point, points};
use crate::border::outside;
use crate::choices::{Elastic, Weights};
use crate::error::Fault;
use crate::shapes::{Connectivity, Field, Mesh, node_numbers};
use crate::threads::with_threads;
use arlequin::cnem::{CnemModel as Cnem, Domain, Options, Surface};
use arlequin::core::nalgebra::Vector3;
use arlequin::core::{Interpolation, Model};
use arlequin::dem_beam::{BeamMaterial, Container, DemModel as Dem, Matter, Packing, PackingSpec};
use arlequin::fem_ref::FemModel as Fem;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use spring_chain::Chain;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A model of the library.
#[derive(Debug)]
enum Kind {
    Fem(Box<Fem<f64>>),
    Cnem(Box<Cnem>),
    /// A run takes a particle model away instead of copying it, since it may be very large.
    Dem(Option<Box<Dem>>),
    Chain(Chain),
}

/// Common base of the library's models. Arrays over unknowns have the order `x0 y0 z0 x1 …`, then
/// rotations.
#[pyclass(frozen, subclass, module = "arlequin")]
#[derive(Debug)]
pub(crate) struct NativeModel {
    #[pyo3(get)]
    name: String,
    held: Mutex<Kind>,
}

/// A sparse matrix by rows: values, columns, starts of the rows.
type Csr<'py> = (
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<i64>>,
);

impl NativeModel {
    fn initializer(name: &str, kind: Kind) -> PyClassInitializer<Self> {
        PyClassInitializer::from(Self {
            name: name.to_owned(),
            held: Mutex::new(kind),
        })
    }

    fn lock(&self) -> MutexGuard<'_, Kind> {
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn already_used(&self) -> Fault {
        let rule = format!("model '{}' is part of a run already; make another one", self.name);
        Fault::new("Unsupported", rule)
    }

    /// Calls `call` with the model.
    pub(crate) fn with<V: Send>(
        &self,
        call: impl FnOnce(&mut dyn Model<f64>) -> Result<V, Fault> + Send,
    ) -> Result<V, Fault> {
        with_threads(|| match &mut *self.lock() {
            Kind::Fem(m) => call(&mut **m),
            Kind::Cnem(m) => call(&mut **m),
            Kind::Chain(m) => call(m),
            Kind::Dem(Some(m)) => call(&mut **m),
            Kind::Dem(None) => Err(self.already_used()),
        })?
    }

    /// Returns the model's default field.
    pub(crate) fn field(&self) -> Result<Arc<dyn Interpolation<f64>>, Fault> {
        use arlequin::core::FineModel;
        match &*self.lock() {
            Kind::Fem(m) => Ok(m.field()),
            Kind::Cnem(m) => Ok(m.field()),
            Kind::Chain(m) => Ok(m.fine_field()),
            Kind::Dem(Some(m)) => Ok(m.particle_field()),
            Kind::Dem(None) => Err(self.already_used()),
        }
    }

    /// Returns the model for a run: a copy, or the model itself if it consists of particles.
    pub(crate) fn give(&self) -> Result<Box<dyn Model<f64>>, Fault> {
        match &mut *self.lock() {
            Kind::Fem(m) => Ok(m.clone()),
            Kind::Cnem(m) => Ok(m.clone()),
            Kind::Chain(m) => Ok(Box::new(m.clone())),
            // A second copy of millions of particles might not fit into the memory.
            Kind::Dem(m) => Ok(m.take().ok_or_else(|| self.already_used())?),
        }
    }

    /// Calls `call` on the model with weights, then sets its weights back to one.
    fn weighted<V: Send>(
        &self,
        weights: Option<&Weights>,
        call: impl FnOnce(&mut dyn Model<f64>, &arlequin::core::Weights<f64>) -> Result<V, Fault> + Send,
    ) -> Result<V, Fault> {
        let whole = arlequin::core::Weights::uncoupled();
        let weights = weights.map_or(&whole, |w| &w.0);
        self.with(|m| {
            m.set_internal_weight(&*weights.internal)?;
            let answer = call(m, weights);
            // Also after an error: other calls expect the whole model.
            m.set_internal_weight(&*whole.internal)?;
            answer
        })
    }
}

#[pymethods]
impl NativeModel {
    /// Kind of the model: "fem", "cnem", "dem" or "chain".
    #[getter]
    fn kind(&self) -> Result<String, Fault> {
        self.with(|m| Ok(m.kind().to_owned()))
    }

    /// Nodes [m], (n, 3).
    #[getter]
    fn nodes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let nodes = self.with(|m| Ok(m.nodes().to_vec()))?;
        coordinates(py, &nodes)
    }

    /// Displacements per node: 3, or 1 for bars and chains.
    #[getter]
    fn components(&self) -> Result<usize, Fault> {
        self.with(|m| Ok(m.layout().components))
    }

    /// Rotations per node: 3 for particles, otherwise 0.
    #[getter]
    fn rotations(&self) -> Result<usize, Fault> {
        self.with(|m| Ok(m.layout().rotations))
    }

    /// The field that interfaces use.
    #[getter(field)]
    fn its_field(&self) -> Result<Field, Fault> {
        Ok(Field(self.field()?))
    }

    /// Lumped inertia of every unknown [kg, kg m2], weighted by `weights`.
    #[pyo3(signature = (weights = None))]
    fn lumped_inertia<'py>(
        &self,
        py: Python<'py>,
        weights: Option<&Weights>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let inertia = self.weighted(weights, |m, w| {
            let mut out = vec![0.0; m.layout().dofs()];
            m.lumped_inertia(&*w.kinetic, &mut out)?;
            Ok(out)
        });
        Ok(array(py, inertia?))
    }

    /// Internal forces on every unknown at displacements `q` [m], weighted [N, N m].
    #[pyo3(signature = (q, weights = None))]
    fn internal_forces<'py>(
        &self,
        py: Python<'py>,
        q: Numbers<'py>,
        weights: Option<&Weights>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let q = flat(&q);
        let forces = self.weighted(weights, |m, _| {
            arlequin::core::check_size(m, "displacements", q.len())?;
            let mut out = vec![0.0; q.len()];
            m.add_internal_forces(&q, &mut out)?;
            Ok(out)
        });
        Ok(array(py, forces?))
    }

    /// Internal energy at displacements `q` [m], weighted [J].
    #[pyo3(signature = (q, weights = None))]
    fn internal_energy(&self, q: Numbers<'_>, weights: Option<&Weights>) -> Result<f64, Fault> {
        let q = flat(&q);
        self.weighted(weights, |m, _| {
            arlequin::core::check_size(m, "displacements", q.len())?;
            Ok(m.internal_energy(&q))
        })
    }

    /// Critical step of velocity Verlet without coupling and supports [s].
    #[getter]
    fn critical_step(&self) -> Result<f64, Fault> {
        self.weighted(None, |m, w| {
            let mut inertia = vec![0.0; m.layout().dofs()];
            m.lumped_inertia(&*w.kinetic, &mut inertia)?;
            inertia.iter_mut().for_each(|m| *m = 1.0 / *m);
            Ok(m.critical_step(&inertia)?)
        })
    }

    /// Weighted stiffness as `(data, indices, indptr)` of its rows [N/m].
    #[pyo3(signature = (weights = None))]
    fn _stiffness<'py>(&self, py: Python<'py>, weights: Option<&Weights>) -> PyResult<Csr<'py>> {
        let stiffness = self.weighted(weights, |m, _| {
            let Some(linear) = m.views().linear else {
                let rule = format!("model '{}' cannot tell a stiffness: it is not linear", self.name);
                return Err(Fault::new("Unsupported", rule));
            };
            Ok(linear.stiffness().to_csr())
        });
        // The raw arrays have the form that `scipy.sparse.csr_matrix` takes.
        let (begin, columns, values) = stiffness?.into_raw_storage();
        let numbers = |integers: Vec<usize>| PyArray1::from_iter(py, integers.into_iter().map(|k| k as i64));
        Ok((array(py, values), numbers(columns), numbers(begin)))
    }

    fn __repr__(&self) -> String {
        let summary = self.with(|m| Ok(format!("{} '{}', {} nodes", m.kind(), m.name(), m.nodes().len())));
        // A particle model that a run has taken away still has its name.
        format!("<Model {}>", summary.unwrap_or_else(|_| self.name.clone()))
    }
}

/// Linear finite elements: `FemModel(name, mesh, material)`.
#[pyclass(frozen, extends = NativeModel, module = "arlequin")]
#[derive(Debug)]
pub(crate) struct FemModel;

#[pymethods]
impl FemModel {
    #[new]
    fn new(name: &str, mesh: &Mesh, material: &Elastic) -> Result<PyClassInitializer<Self>, Fault> {
        let model = with_threads(|| Fem::new(name, mesh.0.mesh().clone(), material.0))??;
        Ok(NativeModel::initializer(name, Kind::Fem(Box::new(model))).add_subclass(Self))
    }
}

/// Natural elements on points [m] that fill their convex hull: `CnemModel(name, points, material)`. For
/// other bodies, `surface` gives the closed boundary as triangles of points.
#[pyclass(frozen, extends = NativeModel, module = "arlequin")]
#[derive(Debug)]
pub(crate) struct CnemModel;

#[pymethods]
impl CnemModel {
    #[new]
    #[pyo3(signature = (name, points, material, surface = None))]
    fn new(
        py: Python<'_>,
        name: &str,
        points: Numbers<'_>,
        material: &Elastic,
        surface: Option<Connectivity<'_>>,
    ) -> PyResult<PyClassInitializer<Self>> {
        let nodes = crate::arrays::points("points", &points)?;
        let surface = match surface {
            None => Surface::convex_hull(),
            Some(s) => {
                let corners: Vec<usize> = node_numbers("the surface", &s, 3)?
                    .into_iter()
                    .map(|k| k as usize)
                    .collect();
                Surface::boundary(corners.as_chunks::<3>().0.to_vec())
            }
        };
        let model = outside(py, || {
            let domain = Domain::new(&nodes, &surface)?;
            Ok(Cnem::new(name, domain, material.0, Options::default())?)
        })?;
        Ok(NativeModel::initializer(name, Kind::Cnem(Box::new(model))).add_subclass(Self))
    }
}

/// A packing of spheres with the pairs that are joined by beams. Created by `cylinder` and `block`.
#[pyclass(frozen, name = "Packing", module = "arlequin")]
#[derive(Debug)]
pub(crate) struct Spheres(Arc<Packing>);

impl Spheres {
    fn fill(py: Python<'_>, container: Container, count: usize, seed: u64, quench: bool) -> PyResult<Self> {
        outside(py, || {
            let spec = if quench {
                PackingSpec::quench(container, count, seed)
            } else {
                PackingSpec::new(container, count, seed)
            };
            Ok(Self(Arc::new(spec.build()?)))
        })
    }
}

#[pymethods]
impl Spheres {
    /// Packs about `count` spheres into a cylinder of `radius` along x from 0 to `length` [m]. `quench` is
    /// faster and gives a less even packing.
    #[staticmethod]
    #[pyo3(signature = (length, radius, count, seed = 1, quench = false))]
    fn cylinder(
        py: Python<'_>,
        length: f64,
        radius: f64,
        count: usize,
        seed: u64,
        quench: bool,
    ) -> PyResult<Self> {
        let container = Container::cylinder(length, radius).map_err(Fault::from)?;
        Self::fill(py, container, count, seed, quench)
    }

    /// Packs about `count` spheres into a box from corner `low` to corner `high` [m].
    #[staticmethod]
    #[pyo3(signature = (low, high, count, seed = 1, quench = false))]
    fn block(
        py: Python<'_>,
        low: Numbers<'_>,
        high: Numbers<'_>,
        count: usize,
        seed: u64,
        quench: bool,
    ) -> PyResult<Self> {
        let (low, high) = (point("low", &low)?.coords, point("high", &high)?.coords);
        let container = Container::cuboid(low, high).map_err(Fault::from)?;
        Self::fill(py, container, count, seed, quench)
    }

    /// Centres [m], (n, 3).
    #[getter]
    fn points<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let centres = self.0.positions.iter().flat_map(|x| [x.x, x.y, x.z]);
        crate::arrays::rows(py, centres.collect(), 3)
    }

    /// Radii [m].
    #[getter]
    fn radii<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array(py, self.0.radii.clone())
    }

    /// Numbers of the bonded spheres, (n, 2).
    #[getter]
    fn pairs<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let numbers = self.0.pairs.iter().flatten().map(|k| i64::from(*k));
        PyArray1::from_iter(py, numbers).call_method1("reshape", (-1, 2))
    }

    fn __repr__(&self) -> String {
        format!(
            "<Packing: {} spheres, {} bonds>",
            self.0.radii.len(),
            self.0.pairs.len()
        )
    }
}

/// Spheres joined by beams: `DemModel(name, packing, density, young=…, poisson=…, radius_ratio=…)`.
/// `packing` is a `Packing`, or `(points, radii, pairs, volume)` [m, m, numbers, m3]. `young` [Pa] and
/// `poisson` describe the beams, by default silica. `order` has the packing's number of every particle.
#[pyclass(frozen, extends = NativeModel, module = "arlequin")]
#[derive(Debug)]
pub(crate) struct DemModel {
    order: Vec<u32>,
}

/// A packing of the library, or spheres from the user.
#[derive(FromPyObject)]
enum Particles<'py> {
    Packing(Bound<'py, Spheres>),
    Given(Numbers<'py>, Numbers<'py>, Connectivity<'py>, f64),
}

#[pymethods]
impl DemModel {
    #[new]
    #[pyo3(signature = (name, packing, density, *, young = BeamMaterial::SILICA.young, poisson = BeamMaterial::SILICA.poisson, radius_ratio = BeamMaterial::SILICA.radius_ratio))]
    fn new(
        name: &str,
        packing: Particles<'_>,
        density: f64,
        young: f64,
        poisson: f64,
        radius_ratio: f64,
    ) -> PyResult<PyClassInitializer<Self>> {
        let beam = BeamMaterial {
            young,
            poisson,
            radius_ratio,
        };
        let model = match packing {
            Particles::Packing(p) => {
                let packing = p.get().0.clone();
                with_threads(|| Dem::new(name, &packing, beam, density))?
            }
            Particles::Given(centres, radii, pairs, volume) => {
                let centres: Vec<Vector3<f64>> =
                    points("points", &centres)?.iter().map(|p| p.coords).collect();
                let (radii, pairs) = (flat(&radii), node_numbers("pairs", &pairs, 2)?);
                let matter = Matter {
                    beam,
                    density,
                    volume,
                };
                let pairs = pairs.as_chunks::<2>().0;
                with_threads(|| Dem::from_spheres(name, &centres, &radii, pairs, &matter))?
            }
        };
        let model = model.map_err(Fault::from)?;
        // Kept here, because a run takes the model away.
        let order = model.order().to_vec();
        let base = NativeModel::initializer(name, Kind::Dem(Some(Box::new(model))));
        Ok(base.add_subclass(Self { order }))
    }

    /// The packing's number of every particle of the model.
    #[getter]
    fn order<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        PyArray1::from_iter(py, self.order.iter().map(|k| i64::from(*k)))
    }
}

/// Equal masses [kg] (half at the ends) joined by equal springs [N/m] along x from `start` with `spacing`
/// [m]: `ChainModel(name, start, spacing, bonds, mass, stiffness)`.
#[pyclass(frozen, extends = NativeModel, module = "arlequin")]
#[derive(Debug)]
pub(crate) struct ChainModel;

#[pymethods]
impl ChainModel {
    #[new]
    fn new(
        name: &str,
        start: f64,
        spacing: f64,
        bonds: usize,
        mass: f64,
        stiffness: f64,
    ) -> Result<PyClassInitializer<Self>, Fault> {
        let model = Chain::new(name, start, spacing, bonds, mass, stiffness)?;
        Ok(NativeModel::initializer(name, Kind::Chain(model)).add_subclass(Self))
    }
}
