//! Single precision: a run that is set up in 64-bit numbers and steps in 32-bit ones.
//!
//! Meshes, intersections, weights, lumped masses, coupling matrices and the factor of the multiplier operator are
//! computed in double precision and rounded once; states, forces and corrections are then single. Linear models step
//! with their weighted stiffness matrix in blocks, whatever kernel they have in double precision.

use crate::blocks::BlockMatrix;
use crate::coupled::Coupled;
use crate::effect::{Effect, Pair};
use crate::field::{Interpolation, ShapeRow};
use crate::geometry::{Cell, Polyhedron, Sample};
use crate::model::{DofLayout, Model, State, check_size};
use crate::weight::{Weight, Weighting, Weights};
use crate::{Error, Real, Result};
use nalgebra::{Point3, Vector3};
use sprs::CsMat;
use std::sync::Arc;

/// A number of another precision.
pub(crate) fn to<S: Real, T: Real>(x: S) -> T {
    T::of(x.as_f64())
}

pub(crate) fn all<S: Real, T: Real>(x: &[S]) -> Vec<T> {
    x.iter().map(|x| to(*x)).collect()
}

pub(crate) fn point<S: Real, T: Real>(x: &Point3<S>) -> Point3<T> {
    x.map(to)
}

pub(crate) fn matrix<S: Real, T: Real>(x: &CsMat<S>) -> CsMat<T> {
    x.map(|v| to(*v))
}

fn sample<S: Real, T: Real>(s: &Sample<S>) -> Sample<T> {
    Sample {
        point: point(&s.point),
        measure: to(s.measure),
    }
}

fn cell<S: Real, T: Real>(c: &Cell<S>) -> Cell<T> {
    match c {
        Cell::Segment { ends, section } => Cell::Segment {
            ends: ends.each_ref().map(point),
            section: to(*section),
        },
        Cell::Polyhedron(p) => Cell::Polyhedron(Polyhedron {
            faces: p.faces.iter().map(|f| f.iter().map(point).collect()).collect(),
        }),
    }
}

/// A field that is evaluated in another precision and rounded.
pub(crate) struct RoundedField<S: Real> {
    field: Arc<dyn Interpolation<S>>,
    nodes: Vec<Point3<f32>>,
    samples: Option<Vec<Sample<f32>>>,
}

impl<S: Real> RoundedField<S> {
    pub(crate) fn new(field: Arc<dyn Interpolation<S>>) -> Self {
        Self {
            nodes: field.nodes().iter().map(point).collect(),
            samples: field.samples().map(|s| s.iter().map(sample).collect()),
            field,
        }
    }
}

impl<S: Real> Interpolation<f32> for RoundedField<S> {
    fn nodes(&self) -> &[Point3<f32>] {
        &self.nodes
    }
    fn shape_at(&self, x: &Point3<f32>, gradient: bool, row: &mut ShapeRow<f32>) -> Result<()> {
        let mut wide = ShapeRow::default();
        self.field.shape_at(&point(x), gradient, &mut wide)?;
        row.clear();
        row.nodes.extend(&wide.nodes);
        row.values.extend(wide.values.iter().map(|v| to::<S, f32>(*v)));
        row.gradients
            .extend(wide.gradients.iter().map(|g| -> Vector3<f32> { g.map(to) }));
        Ok(())
    }
    fn cells(&self) -> Vec<Cell<f32>> {
        self.field.cells().iter().map(cell).collect()
    }
    fn degree(&self) -> usize {
        self.field.degree()
    }
    fn samples(&self) -> Option<&[Sample<f32>]> {
        self.samples.as_deref()
    }
    fn kind(&self) -> &'static str {
        self.field.kind()
    }
}

/// A weight likewise.
struct RoundedWeight(Arc<dyn Weight<f64>>);

impl Weight<f32> for RoundedWeight {
    fn at(&self, x: &Point3<f32>) -> f32 {
        to(self.0.at(&point(x)))
    }
    fn mean(&self, c: &Cell<f32>) -> f32 {
        to(self.0.mean(&cell(c)))
    }
}

pub(crate) fn weights(w: &Weights<f64>) -> Weights<f32> {
    let one = |w: &Arc<dyn Weight<f64>>| -> Arc<dyn Weight<f32>> { Arc::new(RoundedWeight(w.clone())) };
    Weights {
        internal: one(&w.internal),
        kinetic: one(&w.kinetic),
        external: one(&w.external),
        weighting: w.weighting,
    }
}

/// A weighted linear model as what is left of it: `f = −K q`.
#[derive(Debug)]
pub(crate) struct StiffnessModel {
    name: String,
    kind: String,
    layout: DofLayout,
    nodes: Vec<Point3<f32>>,
    stiffness: BlockMatrix<f32>,
    inertia: Vec<f32>,
    critical: f32,
}

impl StiffnessModel {
    /// The model as it is weighted now, with its weighted inertia and critical step \[s\].
    ///
    /// # Errors
    /// [`Error::DoubleOnly`] for a model that is not linear.
    pub(crate) fn of(model: &dyn Model<f64>, inertia: &[f64], critical: f64) -> Result<Self> {
        let linear = match model.as_linear() {
            Some(l) if !model.evolves() => l,
            _ => {
                return Err(Error::DoubleOnly {
                    what: format!("model '{}' ({})", model.name(), model.kind()),
                    why: "its forces are not a stiffness matrix times displacements",
                });
            }
        };
        Ok(Self {
            name: model.name().to_owned(),
            kind: model.kind().to_owned(),
            layout: model.layout(),
            nodes: model.nodes().iter().map(point).collect(),
            stiffness: BlockMatrix::of_csr(&linear.stiffness()),
            inertia: all(inertia),
            critical: to(critical),
        })
    }

    fn fixed(&self) -> Error {
        Error::DoubleOnly {
            what: format!("weights of model '{}'", self.name),
            why: "they are part of its stiffness matrix by now",
        }
    }
}

impl Model<f32> for StiffnessModel {
    fn name(&self) -> &str {
        &self.name
    }
    fn kind(&self) -> &str {
        &self.kind
    }
    fn layout(&self) -> DofLayout {
        self.layout
    }
    fn nodes(&self) -> &[Point3<f32>] {
        &self.nodes
    }
    /// The inertia with the weights the model had; others are refused.
    fn lumped_inertia(&self, _: &dyn Weight<f32>, _: Weighting, out: &mut [f32]) -> Result<()> {
        check_size(self, "inertia", out.len())?;
        out.copy_from_slice(&self.inertia);
        Ok(())
    }
    fn set_internal_weight(&mut self, _: &dyn Weight<f32>, _: Weighting) -> Result<()> {
        Err(self.fixed())
    }
    fn add_internal_forces(&mut self, q: &[f32], f: &mut [f32]) -> Result<()> {
        self.stiffness.subtract_product(q, None, f);
        Ok(())
    }
    fn internal_energy(&self, q: &[f32]) -> f32 {
        self.stiffness.energy(q, None)
    }
    fn critical_step(&mut self, _: &[f32]) -> Result<f32> {
        Ok(self.critical)
    }
}

/// A model that goes on watching a state of lower precision.
pub(crate) struct Watcher(Box<dyn Model<f64>>);

impl Watcher {
    /// Keeps a model if it watches anything.
    pub(crate) fn of(model: Box<dyn Model<f64>>) -> Option<Self> {
        model.watches().then_some(Self(model))
    }

    pub(crate) fn watch<T: Real>(&self, state: &State<T>) -> Vec<crate::effect::Finding> {
        self.0.watch(&State {
            q: all(&state.q),
            v: all(&state.v),
            a: all(&state.a),
        })
    }
}

/// The effect in single precision, or the error that names it.
pub(crate) fn effect(e: &dyn Effect<f64>, model: &str) -> Result<Box<dyn Effect<f32>>> {
    e.narrowed().ok_or_else(|| Error::DoubleOnly {
        what: format!("effect '{}' of model '{model}'", e.name()),
        why: "it has no form in 32-bit numbers",
    })
}

/// The effect between two models likewise.
fn pair(p: &Pair<f64>) -> Result<Pair<f32>> {
    let effect = p.effect.narrowed().ok_or_else(|| Error::DoubleOnly {
        what: format!("effect '{}'", p.effect.name()),
        why: "it has no form in 32-bit numbers",
    })?;
    Ok(Pair {
        sides: p.sides,
        effect,
        work: to(p.work),
        last_work: to(p.last_work),
    })
}

impl Coupled<f64> {
    /// The same run, as far as it has come, in 32-bit numbers from here on.
    ///
    /// States have seven digits: the drift of `H` is of the order of 1e-6 in place of 1e-13, and a free body that moves
    /// far loses the digits of its strains. Dependent multipliers must have been dropped with the rank tolerance of
    /// 32-bit numbers, [`crate::InterfaceOptions::single`].
    ///
    /// # Errors
    /// [`Error::DoubleOnly`] for models that are not linear and effects without such a form;
    /// [`Error::InvalidParameter`] for an interface whose multipliers are too close to dependent.
    pub fn narrowed(self) -> Result<Coupled<f32>> {
        let critical = self.critical.clone();
        let subdomains = self
            .subdomains
            .into_iter()
            .zip(&critical)
            .map(|(s, c)| s.narrowed(*c))
            .collect::<Result<_>>()?;
        let interfaces = self
            .interfaces
            .iter()
            .map(|i| i.narrowed())
            .collect::<Result<_>>()?;
        let pairs = self.pairs.iter().map(pair).collect::<Result<_>>()?;
        Ok(Coupled {
            subdomains,
            interfaces,
            pairs,
            critical: all(&critical),
            dt: to(self.dt),
            time: to(self.time),
            start_time: to(self.start_time),
            step: self.step,
            guard: crate::Guard {
                interval: self.guard.interval,
                growth: to(self.guard.growth),
            },
            ledger: self.ledger.narrowed(),
            start_loss: to(self.start_loss),
            displaced: to(self.displaced),
            partition: self.partition,
            work: all(&self.work),
        })
    }
}
