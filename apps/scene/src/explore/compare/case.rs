//! The models of a scene, and each of them in the place of both, as linear systems for any weights.

use super::system::{Place, System};
use super::union::united;
use crate::error::{Error, Result, core, key, value};
use crate::setup::{self, Body, BodyShape, BuiltInterface, LoweredScene, OverlapSource};
use crate::spec::{Method, OverlapShape, Shape};
use arlequin::core::geometry::Cell;
use arlequin::core::nalgebra::{Point3, Vector3, center};
use arlequin::core::sprs::{CsMat, TriMat, hstack};
use arlequin::core::{Interface, ShapeRow, Side, Uniform, Weight, Weighting, Weights};
use std::path::Path;
use std::sync::Arc;

/// Least length of a model's own region, in coarse spacings.
const ROOM: f64 = 5.0;

/// Numbers of both models among the parts of a case.
pub(super) const COARSE: usize = 0;
pub(super) const FINE: usize = 1;
/// The fine model in the place of both.
pub(super) const FINE_EVERYWHERE: usize = 2;
/// The coarse model in the place of both; on a line only.
pub(super) const COARSE_EVERYWHERE: usize = 3;

/// Two models and their interface before they are coupled.
pub(super) struct Case {
    name: String,
    interface: BuiltInterface,
    pub(super) parts: Vec<Part>,
    /// Weights of the scene, and those that it would have with weights at nodes.
    pub(super) weights: Pair,
    pub(super) nodal: Pair,
    /// Width of the overlap, spacing of the coarse and of the fine model \[m\].
    pub(super) width: f64,
    pub(super) spacing: [f64; 2],
    /// Speed of waves in a bar of the fine model's material \[m/s\].
    pub(super) speed: f64,
    pub(super) frame: Frame,
}

/// A model on its own.
pub(super) struct Part {
    body: Body,
    pub(super) places: Vec<Place>,
    /// Masses without weights.
    pub(super) full: Vec<f64>,
}

impl Part {
    fn new(body: Body, frame: Frame) -> Result<Self> {
        let (places, full) = (places(&body, frame), masses(&body, &Uniform(1.0))?);
        Ok(Self { body, places, full })
    }
}

/// A point of the coarse border, and the unit vector from the coarse to the fine model.
type Frame = (Point3<f64>, Vector3<f64>);

/// Weights of the coarse and the fine model.
pub(super) type Pair = [Weights<f64>; 2];

/// Weights of the stiffness and of the masses of a model, if it has any.
type Weighted<'a> = Option<[&'a dyn Weight<f64>; 2]>;

impl Case {
    /// Builds the models of a scene with a single interface between two planes; refuses scenes in which the
    /// comparison has no meaning by their keys.
    pub(super) fn new(
        scene: &LoweredScene,
        folder: &Path,
        announce: &mut dyn FnMut(&str, usize, usize),
    ) -> Result<Self> {
        let scene = bare(scene);
        let (name, table) = match scene.interface.iter().collect::<Vec<_>>().as_slice() {
            [(name, table)] if scene.model.len() == 2 => ((*name).clone(), *table),
            more => {
                let rule = "must be one, between the only two models; take the others out";
                return Err(value("interface", format!("{} interfaces", more.len()), rule));
            }
        };
        let OverlapSource::Given(OverlapShape::Slab { fine, coarse }) = &table.overlap else {
            let rule = "must be a slab: the comparison sends waves across it";
            return Err(key(format!("interface.{name}.overlap"), rule));
        };
        let [coarse, fine] = [coarse, fine].map(|x| Point3::from(*x));
        let frame = (coarse, (fine - coarse).normalize());
        let names = [&table.coarse, &table.fine];
        let shape = united(&scene, names, frame.1)?;
        let (mut bodies, interface) = setup::parts(&scene, folder, announce)?;
        let interface = single(interface)?;
        let sides = [interface.spec.coarse, interface.spec.fine];
        for side in sides {
            stiffness(&bodies[side])?;
        }
        let mut nodal = scene.clone();
        let tables = nodal.interface.values_mut();
        tables.for_each(|i| i.weight.weighting = Weighting::Nodal);
        let nodal = single(setup::interfaces_of(&nodal, folder, &bodies)?)?;
        if sides[COARSE] > sides[FINE] {
            bodies.reverse();
        }
        bodies.push(everywhere((&scene, folder), names, &shape, announce)?);
        if bodies[COARSE].model.layout().components == 1 {
            let reversed = [names[1], names[0]];
            bodies.push(everywhere((&scene, folder), reversed, &shape, &mut |_, _, _| ())?);
        }
        let material = bodies[FINE].material.as_ref();
        let no_material = || key(format!("model.{}", table.fine), "has no material to compare");
        let part = |body| Part::new(body, frame);
        Ok(Self {
            speed: material.ok_or_else(no_material)?.bar_speed(),
            width: (fine - coarse).norm(),
            spacing: [COARSE, FINE].map(|k| bodies[k].spacing),
            weights: with_complement(interface.weights.clone()),
            nodal: with_complement(nodal.weights),
            parts: bodies.into_iter().map(part).collect::<Result<_>>()?,
            frame,
            name,
            interface,
        })
    }

    /// Systems of one or two models as one, each with weights of stiffness and masses, without coupling. A
    /// model without weights lends its shape functions only.
    pub(super) fn assemble(&mut self, models: &[(usize, Weighted<'_>)]) -> Result<System> {
        let (mut places, mut mass, mut full, mut split) = (Vec::new(), Vec::new(), Vec::new(), 0);
        let size = models.iter().map(|(k, _)| self.parts[*k].full.len()).sum();
        let mut entries = TriMat::new((size, size));
        for (k, weights) in models {
            let part = &mut self.parts[*k];
            split = places.len();
            places.extend(&part.places);
            full.extend(&part.full);
            let Some([internal, kinetic]) = weights else {
                mass.resize(places.len(), 0.0);
                continue;
            };
            mass.extend(masses(&part.body, *kinetic)?);
            let weighted = part.body.model.set_internal_weight(*internal);
            weighted.map_err(core(format!("model.{}", part.body.model.name())))?;
            let block = stiffness(&part.body)?;
            let block = block.iter().map(|(v, (i, j))| (split + i, split + j, *v));
            block.for_each(|(i, j, v)| entries.add_triplet(i, j, v));
        }
        Ok(System::new((places.into(), split), mass, &full, entries.to_csr()))
    }

    /// Weighted systems of both models as one, without coupling.
    pub(super) fn system(&mut self, [coarse, fine]: &Pair) -> Result<System> {
        self.assemble(&[
            (COARSE, Some([&*coarse.internal, &*coarse.kinetic])),
            (FINE, Some([&*fine.internal, &*fine.kinetic])),
        ])
    }

    /// Fine model in the place of both after a mesh without a law of its own.
    pub(super) fn slaved(&mut self, mesh: usize, weight: &dyn Weight<f64>) -> Result<System> {
        self.assemble(&[(mesh, None), (FINE_EVERYWHERE, Some([weight, &Uniform(1.0)]))])
    }

    /// Values of a pair of weights at the node of every unknown of both models. A node on a border counts
    /// as in the overlap, so that round-off does not decide whether it has a weight.
    pub(super) fn nodal_values(&self, weights: [&dyn Weight<f64>; 2]) -> Vec<f64> {
        let (mut out, rounded) = (Vec::new(), 1e-9 * self.width);
        for (part, w) in self.parts.iter().zip(weights) {
            let (layout, nodes) = (part.body.model.layout(), part.body.model.nodes());
            out.extend(part.places.iter().enumerate().map(|(d, p)| {
                let shift = p.x.clamp(rounded, self.width - rounded) - p.x;
                let shift = if shift.abs() < 2.0 * rounded { shift } else { 0.0 };
                w.value(&(nodes[layout.node_of(d)] + self.frame.1 * shift))
            }));
        }
        out
    }

    /// Weight by the distances of the nearest and the farthest corner of a cell from the coarse border.
    pub(super) fn weight(
        &self,
        value: impl Fn([f64; 2]) -> f64 + Send + Sync + 'static,
    ) -> Arc<dyn Weight<f64>> {
        let frame = self.frame;
        Arc::new(Along { frame, value })
    }

    /// Rows `[B_C, −B_D]` of the scene's interface.
    pub(super) fn coupling(&self, system: &System) -> Result<CsMat<f64>> {
        let side = |k: usize| {
            let body = &self.parts[k].body;
            Side {
                name: body.model.name(),
                field: &*body.field,
                layout: body.model.layout(),
                inverse_inertia: &system.inverse[system.sides()[k].clone()],
                sleeping: None,
                weight: &*self.weights[k].kinetic,
            }
        };
        let path = format!("interface.{}", self.name);
        let built = Interface::new(&self.interface.spec, [side(COARSE), side(FINE)]).map_err(core(&*path))?;
        let [Some(coarse), Some(fine)] = [COARSE, FINE].map(|k| built.coupling_matrix(k)) else {
            return Err(key(path, "has no coupling matrices"));
        };
        // Rotations of particles, the last unknowns, are not coupled.
        let rotations = CsMat::zero((coarse.rows(), system.size() - coarse.cols() - fine.cols()));
        Ok(hstack(&[coarse.view(), fine.map(|x| -x).view(), rotations.view()]).to_csr())
    }

    /// Returns `N` of displacements `q_i = Σ N_ij q_j` that follow the field of another model: those of
    /// nodes in a range of distances that `choose` takes, by their first unknown. Nodes outside of the
    /// field are left out. Unknowns of the coarse model come first, and those of a mesh that the fine model
    /// everywhere follows.
    pub(super) fn followers(
        &self,
        [field, points]: [usize; 2],
        range: [f64; 2],
        choose: &dyn Fn(usize) -> bool,
    ) -> CsMat<f64> {
        let sizes = [field, points].map(|k| self.parts[k].full.len());
        let [shift, first] = if points == COARSE {
            [sizes[1], 0]
        } else {
            [0, sizes[0]]
        };
        let (rounded, part) = (1e-9 * self.width, &self.parts[points]);
        let d = part.body.model.layout().components;
        let is_within = |x: f64| x >= range[0] - rounded && x <= range[1] + rounded;
        let mut out = TriMat::new((sizes[0] + sizes[1], sizes[0] + sizes[1]));
        for (k, x) in part.body.model.nodes().iter().enumerate() {
            let (i, mut row) = (first + k * d, ShapeRow::default());
            let is_chosen = is_within(part.places[k * d].x) && choose(i);
            if !is_chosen || self.parts[field].body.field.shape_at(x, false, &mut row).is_err() {
                continue;
            }
            for (node, value) in row.nodes.iter().zip(&row.values) {
                (0..d).for_each(|c| out.add_triplet(i + c, shift + node * d + c, *value));
            }
        }
        out.to_csr()
    }

    /// Refuses a method by its name, with the reason and the remedy.
    pub(super) fn refusal(&self, method: Method, rule: &str) -> Error {
        value(format!("interface.{}.method", self.name), method.name(), rule)
    }

    /// Lengths of the models' own regions \[m\], the coarse one first, if a pulse that the coarse model
    /// carries has room in both.
    pub(super) fn own_lengths(&self) -> Result<[f64; 2]> {
        let x = |k: usize| self.parts[k].places.iter().map(|p| p.x);
        let lengths = [
            -x(COARSE).fold(0.0, f64::min),
            x(FINE).fold(0.0, f64::max) - self.width,
        ];
        for (k, length) in lengths.into_iter().enumerate() {
            let spacings = length / self.spacing[COARSE];
            if spacings < ROOM {
                let rule = format!(
                    "coarse spacings beside the overlap must be at least {ROOM}, so that a pulse has room; lengthen the model, narrow \
                     the overlap or take a finer coarse mesh"
                );
                let path = format!("model.{}.shape", self.parts[k].body.model.name());
                return Err(value(path, format!("{spacings:.1}"), &rule));
            }
        }
        Ok(lengths)
    }
}

/// Weight by the distances of the nearest and the farthest corner of a cell.
struct Along<F> {
    frame: Frame,
    value: F,
}

impl<F: Fn([f64; 2]) -> f64 + Send + Sync> Weight<f64> for Along<F> {
    fn value(&self, x: &Point3<f64>) -> f64 {
        (self.value)([(x - self.frame.0).dot(&self.frame.1); 2])
    }

    fn mean(&self, cell: &Cell<f64>) -> f64 {
        let [low, high] = cell.bounds();
        let (origin, axis) = &self.frame;
        let (middle, half) = (center(&low, &high) - origin, 0.5 * (high - low).dot(&axis.abs()));
        (self.value)([middle.dot(axis) - half, middle.dot(axis) + half])
    }
}

/// Pairs the coarse weights with the fine ones that complete them to one.
pub(super) fn with_complement(coarse: Weights<f64>) -> Pair {
    let fine = Weights::complement_of(std::slice::from_ref(&coarse));
    [coarse, fine]
}

/// A scene without all that acts on its models, and with the default method.
fn bare(scene: &LoweredScene) -> LoweredScene {
    let mut out = scene.clone();
    out.support.clear();
    out.load.clear();
    out.effect.clear();
    out.initial.clear();
    out.probe.clear();
    out.curve.clear();
    for table in out.interface.values_mut() {
        table.method = Method::Arlequin;
        table.weight.weighting = Weighting::Energy;
        table.lumped = false;
    }
    out
}

/// The only interface or body of a scene.
fn single<T>(mut built: Vec<T>) -> Result<T> {
    built.pop().ok_or_else(|| key("interface", "is missing"))
}

/// Builds one model over the place of both, from the model that goes and the one that stays.
fn everywhere(
    (scene, folder): (&LoweredScene, &Path),
    [gone, kept]: [&String; 2],
    shape: &Shape,
    announce: &mut dyn FnMut(&str, usize, usize),
) -> Result<Body> {
    let mut whole = scene.clone();
    whole.interface.clear();
    whole.model.remove(gone);
    if let Some(model) = whole.model.get_mut(kept) {
        if model.spacing.is_none() {
            let rule = "is missing: the comparison builds the model in the place of both; give spacing";
            return Err(key(format!("model.{kept}.spacing"), rule));
        }
        model.shape = BodyShape::Given(shape.clone());
        model.role = None;
    }
    single(setup::parts(&whole, folder, announce)?.0)
}

/// Stiffness of a model with its present weights, if it is linear.
fn stiffness(body: &Body) -> Result<CsMat<f64>> {
    let linear = body.model.views().linear.map(|l| l.stiffness().to_csr());
    linear.ok_or_else(|| {
        let rule = "is not linear, so that the methods cannot be compared on its stiffness; take out dem.finite_rotations or \
                    the link";
        value("model", body.model.name(), rule)
    })
}

fn masses(body: &Body, weight: &dyn Weight<f64>) -> Result<Vec<f64>> {
    let mut out = vec![0.0; body.model.layout().dofs()];
    let path = format!("model.{}", body.model.name());
    body.model.lumped_inertia(weight, &mut out).map_err(core(path))?;
    Ok(out)
}

/// Places of the unknowns of a model.
fn places(body: &Body, (origin, axis): Frame) -> Vec<Place> {
    let (layout, nodes) = (body.model.layout(), body.model.nodes());
    let ends = [f64::INFINITY, f64::NEG_INFINITY].map(|x| Point3::from([x; 3]));
    let ends = nodes.iter().fold(ends, |[a, b], x| [a.inf(x), b.sup(x)]);
    // Nothing moves across a line.
    let poisson = body.material.as_ref().filter(|_| layout.components == 3);
    let poisson = poisson.map_or(0.0, |m| m.poisson());
    let place = |d: usize| {
        let (node, c) = (&nodes[layout.node_of(d)], d % layout.components);
        let offset = node - center(&ends[0], &ends[1]);
        let across = poisson * (offset - axis * offset.dot(&axis));
        let moves = d < layout.translations();
        Place {
            x: (node - origin).dot(&axis),
            axial: if moves { axis[c] } else { 0.0 },
            across: if moves { across[c] } else { 0.0 },
            moves,
        }
    };
    (0..layout.dofs()).map(place).collect()
}
