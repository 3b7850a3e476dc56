//! Implements the core's `Model` for models written in Python.

use crate::arrays::{Numbers, array};
use crate::border::{Callbacks, Claim, Pending, Shared};
use crate::error::{Fault, raised};
use crate::matrix::MatrixModel;
use crate::shapes::{Connectivity, Mesh, field_of, node_numbers};
use arlequin::core::geometry::Cell;
use arlequin::core::nalgebra::Point3;
use arlequin::core::snapshot::Record;
use arlequin::core::{Arms, DofLayout, Error, Interpolation, Model, Result, Views, Weight};
use numpy::{PyArray1, PyArrayMethods};
use pyo3::intern;
use pyo3::prelude::*;
use std::sync::Arc;

/// Entities for which a Python object receives weights.
enum Places {
    /// Elements of the mesh; each has one or more cells.
    Elements(Vec<Vec<Cell<f64>>>),
    /// Straight bonds between nodes.
    Bonds(Vec<Cell<f64>>),
    /// Nodes.
    Nodes,
}

/// Attributes of a Python object: name, unknowns, nodes, field, weights.
pub(crate) struct Described {
    pub(crate) name: String,
    pub(crate) kind: String,
    pub(crate) layout: DofLayout,
    pub(crate) nodes: Vec<Point3<f64>>,
    pub(crate) field: Arc<dyn Interpolation<f64>>,
    arms: Arms,
    places: Places,
    pub(crate) object: Shared,
    pub(crate) pending: Pending,
}

/// Returns an attribute, or `None` if it is missing or None.
pub(crate) fn optional<'py>(object: &Bound<'py, PyAny>, name: &str) -> PyResult<Option<Bound<'py, PyAny>>> {
    Ok(object.getattr_opt(name)?.filter(|x| !x.is_none()))
}

impl Described {
    pub(crate) fn from_object(object: &Bound<'_, PyAny>) -> PyResult<Self> {
        let text = |what: &str| -> PyResult<Option<String>> {
            let Some(value) = optional(object, what)? else {
                return Ok(None);
            };
            value.extract().map(Some).or_else(|_| {
                let rule = format!("{what} = {}: that of a model or solver is a text", value.repr()?);
                Err(Fault::new("InvalidParameter", rule).into())
            })
        };
        let name = text("name")?.unwrap_or_else(|| "python".into());
        let mesh = optional(object, "mesh")?;
        let Some(field) = optional(object, "field")?.or_else(|| mesh.clone()) else {
            let rule = format!(
                "'{name}' says nothing of its shape functions: set self.mesh = arlequin.Mesh(…), or self.field = \
                 arlequin.Field.natural(…) or .particles(…)"
            );
            return Err(Fault::new("InvalidParameter", rule).into());
        };
        let field = field_of(&field)?;
        let nodes = field.nodes().to_vec();
        let mesh = mesh.map(|m| Ok::<_, PyErr>(m.cast_into::<Mesh>()?)).transpose()?;
        let number = |what, default, allowed: &[usize]| {
            let Some(x) = optional(object, what)? else {
                return Ok::<_, PyErr>(default);
            };
            let count = x.extract::<usize>().ok().filter(|n| allowed.contains(n));
            count.ok_or_else(|| {
                let rule = format!("{what} of '{name}' = {x}: a node has one of {allowed:?}");
                Fault::new("InvalidParameter", rule).into()
            })
        };
        let plain = mesh.as_ref().map_or(3, |m| m.get().0.mesh().kind().components());
        let layout = DofLayout {
            nodes: nodes.len(),
            components: number("components", plain, &[1, 2, 3])?,
            rotations: number("rotations", 0, &[0, 3])?,
        };
        let arms = match text("arms")?.as_deref() {
            None | Some("rest") => Arms::Reference,
            Some("present") => Arms::Current,
            Some(other) => {
                let rule = format!(
                    "arms of '{name}' = \"{other}\": moments vanish about positions at \"rest\" or \"present\" ones"
                );
                return Err(Fault::new("InvalidParameter", rule).into());
            }
        };
        // A mesh beside bonds is there for the field only.
        let places = match (optional(object, "bonds")?, mesh) {
            (Some(bonds), _) => Places::Bonds(bonds_of(&name, &bonds, &nodes)?),
            (None, Some(mesh)) => {
                let cells_of = |e| {
                    let mut out = Vec::new();
                    mesh.get().0.cells_of(e, &mut out);
                    out
                };
                Places::Elements((0..mesh.get().0.mesh().element_count()).map(cells_of).collect())
            }
            (None, None) => Places::Nodes,
        };
        Ok(Self {
            kind: text("kind")?.unwrap_or_else(|| "python".into()),
            name,
            layout,
            nodes,
            field,
            arms,
            places,
            object: Arc::new(object.clone().unbind()),
            pending: Pending::default(),
        })
    }

    /// Returns the means of a weight over elements or bonds, or its values at nodes.
    pub(crate) fn shares(&self, weight: &dyn Weight<f64>) -> Vec<f64> {
        let over = |cells: &Vec<Cell<f64>>| match cells.as_slice() {
            [cell] => weight.mean(cell),
            // The mean over an element weights its cells by their measures.
            several => {
                let parts = several
                    .iter()
                    .map(|c| [weight.mean(c) * c.measure(), c.measure()]);
                let [sum, total] = parts.fold([0.0; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
                sum / total
            }
        };
        match &self.places {
            Places::Elements(elements) => elements.iter().map(over).collect(),
            Places::Bonds(bonds) => bonds.iter().map(|c| weight.mean(c)).collect(),
            Places::Nodes => self.nodes.iter().map(|x| weight.value(x)).collect(),
        }
    }

    /// Refuses an object that lacks one of these methods.
    pub(crate) fn needs(&self, py: Python<'_>, methods: &[&str]) -> PyResult<()> {
        let missing = |name: &&&str| self.object.getattr(py, **name).is_err();
        let Some(name) = methods.iter().find(missing) else {
            return Ok(());
        };
        let rule = format!(
            "'{}' has no method {name}; docs/plug-in.md lists what is needed",
            self.name
        );
        Err(Fault::new("Unsupported", rule).into())
    }

    /// Returns the object and its slot for exceptions, for the subdomain or run that uses it.
    pub(crate) fn callbacks(&self) -> Callbacks {
        Callbacks::new(Some(self.object.clone()), self.pending.clone())
    }

    /// Wraps an exception of the object in an error of the core.
    pub(crate) fn raised(&self, e: PyErr) -> Error {
        raised(&self.name, e)
    }

    /// Reads an answer with one number for each unknown and passes each number to `take`.
    pub(crate) fn read(
        &self,
        what: &str,
        answer: &Bound<'_, PyAny>,
        out: &mut [f64],
        take: impl Fn(&mut f64, f64),
    ) -> PyResult<()> {
        let finite = |bad: Option<usize>| match bad {
            None => Ok(()),
            Some(index) => Err(PyErr::from(Fault::from(Error::NotFinite {
                what: format!("{what} of '{}'", self.name),
                index,
            }))),
        };
        // The fast way, since this is read in every step: a plain vector.
        if let Ok(plain) = answer.cast::<PyArray1<f64>>() {
            let plain = plain.readonly();
            if let (Ok(values), true) = (plain.as_slice(), plain.len()? == out.len()) {
                out.iter_mut().zip(values).for_each(|(o, x)| take(o, *x));
                return finite(values.iter().position(|x| !x.is_finite()));
            }
        }
        let any = answer.extract::<Numbers<'_>>()?;
        let any = any.as_array();
        if any.len() == out.len() {
            out.iter_mut().zip(any.iter()).for_each(|(o, x)| take(o, *x));
            return finite(any.iter().position(|x| !x.is_finite()));
        }
        Err(Fault::new(
            "SizeMismatch",
            format!(
                "{what} of '{}': expected {} numbers, found {}",
                self.name,
                out.len(),
                any.len()
            ),
        )
        .into())
    }

    /// Reads the lumped inertia that the object returns, per unknown or per node.
    pub(crate) fn read_inertia(&self, answer: &Bound<'_, PyAny>, out: &mut [f64]) -> PyResult<()> {
        let any = answer.extract::<Numbers<'_>>()?;
        let any = any.as_array();
        let DofLayout {
            nodes,
            components,
            rotations,
        } = self.layout;
        // One mass per node counts for all of its components.
        if any.len() == nodes && rotations == 0 && components > 1 {
            for (mass, of_node) in any.iter().zip(out.chunks_exact_mut(components)) {
                of_node.fill(*mass);
            }
            return Ok(());
        }
        self.read("inertia", answer, out, |o, x| *o = x)
    }
}

fn bonds_of(name: &str, bonds: &Bound<'_, PyAny>, nodes: &[Point3<f64>]) -> PyResult<Vec<Cell<f64>>> {
    let what = format!("bonds of '{name}'");
    let numbers = bonds.extract::<Connectivity<'_>>().map_err(|_| {
        let rule = format!("{what} are no pairs of node numbers; give an array of whole numbers, (n, 2)");
        Fault::new("SizeMismatch", rule)
    })?;
    let numbers = node_numbers(&what, &numbers, 2)?;
    let segment = |pair: &[u32; 2]| {
        let [a, b] = pair.map(|k| nodes.get(k as usize).copied());
        let ends = [a?, b?];
        // Means do not depend on the section.
        Some(Cell::Segment { ends, section: 1.0 })
    };
    let segments: Option<Vec<_>> = numbers.as_chunks::<2>().0.iter().map(segment).collect();
    segments.ok_or_else(|| {
        let rule = format!("bonds of '{name}' name nodes beyond its {}", nodes.len());
        Fault::new("InvalidParameter", rule).into()
    })
}

/// Implements the methods of a core trait that return attributes of the object.
macro_rules! as_described {
    () => {
        fn name(&self) -> &str {
            &self.about.name
        }
        fn kind(&self) -> &str {
            &self.about.kind
        }
        fn layout(&self) -> DofLayout {
            self.about.layout
        }
        fn nodes(&self) -> &[Point3<f64>] {
            &self.about.nodes
        }
    };
}
pub(crate) use as_described;

/// A model whose forces are computed in Python.
pub(crate) struct PythonModel {
    _claim: Claim,
    about: Described,
    /// True if the object has these optional methods.
    advances: bool,
    knows_its_step: bool,
}

impl PythonModel {
    pub(crate) fn new(about: Described, py: Python<'_>) -> PyResult<Self> {
        about.needs(py, &["set_internal_weight", "internal_forces", "internal_energy"])?;
        let has = |name| Ok::<_, PyErr>(optional(about.object.bind(py), name)?.is_some());
        Ok(Self {
            _claim: Claim::new(&about.name, &about.object)?,
            advances: has("advance")?,
            knows_its_step: has("critical_step")?,
            about,
        })
    }

    /// Calls `advance` or `internal_forces` and adds the answer to `f`.
    fn ask(&self, advances: bool, q: &[f64], f: &mut [f64]) -> Result<()> {
        Python::attach(|py| {
            let method = if advances {
                intern!(py, "advance")
            } else {
                intern!(py, "internal_forces")
            };
            let answer = self
                .about
                .object
                .call_method1(py, method, (PyArray1::from_slice(py, q),))?;
            self.about
                .read("internal_forces", answer.bind(py), f, |f, x| *f += x)
        })
        .map_err(|e| self.about.raised(e))
    }
}

/// Sends the means of the weight to the object and reads the inertia it returns.
pub(crate) fn inertia(about: &Described, weight: &dyn Weight<f64>, out: &mut [f64]) -> Result<()> {
    let shares = about.shares(weight);
    Python::attach(|py| {
        let answer = about.object.call_method1(py, "inertia", (array(py, shares),))?;
        about.read_inertia(answer.bind(py), out)
    })
    .map_err(|e| about.raised(e))
}

impl Model<f64> for PythonModel {
    as_described!();

    fn views(&self) -> Views<'_, f64> {
        let mut views = Views::default();
        views.arms = self.about.arms;
        views
    }

    fn lumped_inertia(&self, weight: &dyn Weight<f64>, out: &mut [f64]) -> Result<()> {
        inertia(&self.about, weight, out)
    }

    fn set_internal_weight(&mut self, alpha: &dyn Weight<f64>) -> Result<()> {
        let shares = self.about.shares(alpha);
        let result = Python::attach(|py| {
            let shares = array(py, shares);
            self.about
                .object
                .call_method1(py, "set_internal_weight", (shares,))
        });
        result.map(drop).map_err(|e| self.about.raised(e))
    }

    fn add_internal_forces(&mut self, q: &[f64], f: &mut [f64]) -> Result<()> {
        self.ask(false, q, f)
    }

    fn advance(&mut self, q: &[f64], f: &mut [f64]) -> Result<()> {
        self.ask(self.advances, q, f)
    }

    fn internal_energy(&self, q: &[f64]) -> f64 {
        let energy = Python::attach(|py| {
            let q = (PyArray1::from_slice(py, q),);
            let answer = self
                .about
                .object
                .call_method1(py, intern!(py, "internal_energy"), q)?;
            answer.extract::<f64>(py)
        });
        // The method cannot return an error, so the exception waits until the run stops.
        energy.unwrap_or_else(|e| {
            self.about.pending.keep(e);
            f64::NAN
        })
    }

    fn critical_step(&mut self, inverse_inertia: &[f64]) -> Result<f64> {
        // The estimate from forces holds for laws that are linear about rest.
        if !self.knows_its_step {
            let forces = &mut |q: &[f64], f: &mut [f64]| self.ask(false, q, f);
            return arlequin::core::spectrum::critical_step(inverse_inertia, forces);
        }
        let step = Python::attach(|py| {
            let inverse = (PyArray1::from_slice(py, inverse_inertia),);
            self.about
                .object
                .call_method1(py, "critical_step", inverse)?
                .extract::<f64>(py)
        });
        let step = step.map_err(|e| self.about.raised(e))?;
        // The comparison refuses NaN too.
        if step > 0.0 {
            return Ok(step);
        }
        let name = format!("critical_step of '{}'", self.about.name);
        let rule = "must be positive [s], or infinite for a model that takes any step";
        Err(arlequin::core::invalid(&name, step, rule))
    }

    fn save(&self) -> Record<f64> {
        let record = Python::attach(|py| saved(&self.about, py));
        record
            .unwrap_or_else(|e| {
                self.about.pending.keep(e);
                None
            })
            .unwrap_or_default()
    }

    fn restore(&mut self, from: &Record<f64>) -> Result<()> {
        Python::attach(|py| restored(&self.about, py, from)).map_err(|e| self.about.raised(e))
    }
}

/// Returns the numbers that the object's `save` gives; `None` without such a method.
pub(crate) fn saved(about: &Described, py: Python<'_>) -> PyResult<Option<Record<f64>>> {
    let Some(save) = optional(about.object.bind(py), "save")? else {
        return Ok(None);
    };
    let answer = save.call0()?;
    // A forgotten `return` would lose the state in silence.
    if answer.is_none() {
        let rule = format!(
            "save of '{}' answers None; give numbers, or have no save",
            about.name
        );
        return Err(Fault::new("InvalidParameter", rule).into());
    }
    let numbers = answer.extract::<Numbers<'_>>()?;
    Ok(Some(Record {
        numbers: crate::arrays::flat(&numbers),
        integers: Vec::new(),
    }))
}

/// Passes saved numbers to the object's `restore`, if there is one.
pub(crate) fn restored(about: &Described, py: Python<'_>, from: &Record<f64>) -> PyResult<()> {
    let Some(restore) = optional(about.object.bind(py), "restore")? else {
        return Ok(());
    };
    restore.call1((array(py, from.numbers.clone()),)).map(drop)
}

/// A model of the core, its field, and its Python objects.
pub(crate) type Made = (Box<dyn Model<f64>>, Arc<dyn Interpolation<f64>>, Callbacks);

/// Returns the model for an object written in Python: with a stiffness matrix or with forces.
pub(crate) fn model(object: &Bound<'_, PyAny>) -> PyResult<Made> {
    let about = Described::from_object(object)?;
    let (field, callbacks) = (about.field.clone(), about.callbacks());
    about.needs(object.py(), &["inertia"])?;
    let model: Box<dyn Model<f64>> = if optional(object, "stiffness")?.is_some() {
        Box::new(MatrixModel::new(about))
    } else {
        Box::new(PythonModel::new(about, object.py())?)
    };
    Ok((model, field, callbacks))
}
