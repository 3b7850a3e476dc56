//! The models of a scene, and of its fine model everywhere, as linear systems for any weights.

use super::sparse::{block_diagonal, difference};
use super::system::{Places, System};
use super::union::united;
use crate::error::{Result, core, key, value};
use crate::setup::{self, Body, BodyShape, BuiltInterface, LoweredScene, OverlapSource};
use crate::spec::{Method, OverlapShape, Shape};
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::core::sprs::CsMat;
use arlequin::core::{Elastic, Interface, ShapeRow, Side, Slab, Uniform, Weight, Weighting, Weights};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Least length of a model's own region, in coarse spacings.
const ROOM: f64 = 5.0;

/// Two models and their interface before they are coupled.
pub(super) struct Case {
    scene: LoweredScene,
    folder: PathBuf,
    name: String,
    bodies: Vec<Body>,
    interface: BuiltInterface,
    /// Places of the unknowns of both models.
    pub(super) places: Arc<Places>,
    /// Masses of both models without weights.
    pub(super) full: Vec<f64>,
    /// Width of the overlap, spacing of the coarse and of the fine model \[m\].
    pub(super) width: f64,
    pub(super) spacing: [f64; 2],
    /// Speed of waves in a bar of the fine model's material \[m/s\].
    pub(super) speed: f64,
    /// Unit vector from the coarse to the fine model, and a point of the coarse border.
    axis: Vector3<f64>,
    origin: Point3<f64>,
    /// The fine model in the place of both.
    pub(super) fine: Everywhere,
}

/// One of the models in the place of both.
pub(super) struct Everywhere {
    body: Body,
    pub(super) places: Arc<Places>,
    /// Masses without weights.
    full: Vec<f64>,
}

/// Weights of the coarse and the fine model.
pub(super) type Pair = [Weights<f64>; 2];

impl Case {
    /// Builds the models of a scene with a single interface between two planes.
    ///
    /// # Errors
    /// Mistakes in the scene, and scenes in which the comparison has no meaning, by their keys.
    pub(super) fn new(
        scene: &LoweredScene,
        folder: &Path,
        announce: &mut dyn FnMut(&str, usize, usize),
    ) -> Result<Self> {
        let scene = bare(scene);
        let (name, table) = match scene.interface.iter().collect::<Vec<_>>().as_slice() {
            [(name, table)] if scene.model.len() == 2 => ((*name).clone(), (*table).clone()),
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
        let (axis, width) = ((fine - coarse).normalize(), (fine - coarse).norm());
        let names = [&table.coarse, &table.fine];
        let whole = united(&scene, names, axis)?;
        let (bodies, interfaces) = setup::parts(&scene, folder, announce)?;
        let Some(interface) = interfaces.into_iter().next() else {
            return Err(key("interface", "is missing"));
        };
        let sides = [interface.spec.coarse, interface.spec.fine];
        for side in sides {
            linear(&bodies[side])?;
        }
        let frame = (coarse, axis);
        let places = places(&sides.map(|s| &bodies[s]), frame);
        let fine = everywhere((&scene, folder), whole, names, frame, announce)?;
        let mut full = Vec::new();
        for s in sides {
            full.extend(masses(&bodies[s], &Uniform(1.0))?);
        }
        let material = bodies[sides[1]].material.as_ref().map(Elastic::bar_speed);
        Ok(Self {
            speed: material
                .ok_or_else(|| key(format!("model.{}", table.fine), "has no material to compare"))?,
            width,
            spacing: sides.map(|s| bodies[s].spacing),
            places: Arc::new(places),
            folder: folder.to_owned(),
            origin: coarse,
            axis,
            full,
            fine,
            name,
            scene,
            bodies,
            interface,
        })
    }

    fn sides(&self) -> [usize; 2] {
        [self.interface.spec.coarse, self.interface.spec.fine]
    }

    /// Weights of the scene.
    pub(super) fn weights(&self) -> Pair {
        with_complement(self.interface.weights.clone())
    }

    /// Weights that the scene would have with weights at nodes.
    pub(super) fn nodal_weights(&self) -> Result<Pair> {
        let mut scene = self.scene.clone();
        if let Some(i) = scene.interface.get_mut(&self.name) {
            i.weight.weighting = Weighting::Nodal;
        }
        let built = setup::interfaces_of(&scene, &self.folder, &self.bodies)?;
        let coarse = built.into_iter().next().map(|b| b.weights);
        Ok(with_complement(
            coarse.ok_or_else(|| key("interface", "is missing"))?,
        ))
    }

    /// Overlap between two distances from the coarse border.
    pub(super) fn slab(&self, from: f64, to: f64) -> Result<Slab<f64>> {
        let at = |x: f64| self.origin + self.axis * x;
        Slab::between(at(to), at(from)).map_err(core("compare"))
    }

    /// Systems of both models as one, without weights and coupling.
    pub(super) fn plain_system(&mut self) -> Result<System> {
        let unit = || Weights::from_weight(Arc::new(Uniform(1.0)));
        self.system(&[unit(), unit()])
    }

    /// The coarse model in the place of both.
    pub(super) fn coarse_everywhere(&self) -> Result<Everywhere> {
        let table = &self.scene.interface[&self.name];
        let (frame, names) = (self.frame(), [&table.fine, &table.coarse]);
        let whole = united(&self.scene, names, frame.1)?;
        everywhere(
            (&self.scene, &self.folder),
            whole,
            names,
            frame,
            &mut |_, _, _| (),
        )
    }

    /// Weighted systems of both models as one, without coupling.
    pub(super) fn system(&mut self, weights: &Pair) -> Result<System> {
        let (mut mass, mut stiffness) = (Vec::new(), Vec::new());
        for (side, w) in self.sides().into_iter().zip(weights) {
            let body = &mut self.bodies[side];
            stiffness.push(weighted(body, &*w.internal)?);
            mass.extend(masses(body, &*w.kinetic)?);
        }
        let stiffness = block_diagonal(&stiffness[0], &stiffness[1]);
        Ok(System::new(self.places.clone(), mass, &self.full, stiffness))
    }

    /// Values of a pair of weights at the node of every unknown.
    pub(super) fn nodal_values(&self, weights: [&dyn Weight<f64>; 2]) -> Vec<f64> {
        let mut out = Vec::new();
        for (side, w) in self.sides().into_iter().zip(weights) {
            let model = &self.bodies[side].model;
            let (layout, nodes) = (model.layout(), model.nodes());
            out.extend((0..layout.dofs()).map(|d| w.value(&nodes[layout.node_of(d)])));
        }
        out
    }

    /// Fine model in the place of both, weighted.
    pub(super) fn fine_system(&mut self, weight: &dyn Weight<f64>) -> Result<System> {
        let stiffness = weighted(&mut self.fine.body, weight)?;
        let fine = &self.fine;
        Ok(System::new(
            fine.places.clone(),
            fine.full.clone(),
            &fine.full,
            stiffness,
        ))
    }

    /// Rows `[B_C, −B_D]` of the scene's interface.
    pub(super) fn coupling(&self, system: &System) -> Result<CsMat<f64>> {
        let split = self.places.split;
        let inverse = [&system.inverse[..split], &system.inverse[split..]];
        let weights = self.weights();
        let side = |k: usize| {
            let body = &self.bodies[self.sides()[k]];
            Side {
                name: body.model.name(),
                field: &*body.field,
                layout: body.model.layout(),
                inverse_inertia: inverse[k],
                weight: &*weights[k].kinetic,
            }
        };
        let path = format!("interface.{}", self.name);
        let built = Interface::new(&self.interface.spec, [side(0), side(1)]).map_err(core(&*path))?;
        let [coarse, fine] = [0, 1].map(|k| built.coupling_matrix(k));
        let (Some(coarse), Some(fine)) = (coarse, fine) else {
            return Err(key(path, "has no coupling matrices"));
        };
        Ok(difference(&coarse, &fine, system.size()))
    }

    /// Number of displacement components.
    pub(super) fn components(&self) -> usize {
        self.bodies[self.sides()[0]].model.layout().components
    }

    /// Particles of the fine model, or of the fine model everywhere, in a range of distances from the coarse
    /// border, with their shape functions of the coarse model. Particles outside of the coarse mesh are left
    /// out.
    pub(super) fn followers(&self, everywhere: bool, range: [f64; 2]) -> Vec<(usize, ShapeRow<f64>)> {
        let [coarse, fine] = self.sides().map(|s| &self.bodies[s]);
        let fine = if everywhere { &self.fine.body } else { fine };
        self.covered(fine, coarse, range)
    }

    /// All particles of the fine model everywhere, with their shape functions of the coarse one.
    pub(super) fn all_followers(&self, coarse: &Everywhere) -> Vec<(usize, ShapeRow<f64>)> {
        self.covered(&self.fine.body, &coarse.body, [f64::NEG_INFINITY, f64::INFINITY])
    }

    /// Nodes of a model in a range of distances that lie in another one, with its shape functions there.
    fn covered(&self, points: &Body, field: &Body, range: [f64; 2]) -> Vec<(usize, ShapeRow<f64>)> {
        let shapes = self.shapes(points, field, range);
        shapes.filter_map(|(k, row)| Some((k, row.ok()?))).collect()
    }

    /// Nodes of the coarse model in a range of distances, with the shape functions of the fine model.
    ///
    /// # Errors
    /// A fine model whose field exists at its particles only.
    pub(super) fn border_nodes(&self, range: [f64; 2]) -> Result<Vec<(usize, ShapeRow<f64>)>> {
        let [coarse, fine] = self.sides().map(|s| &self.bodies[s]);
        let row = |(k, row): (usize, arlequin::core::Result<_>)| {
            let name = fine.model.name();
            let row = row.map_err(|e| {
                let rule = format!(
                    "needs the displacement of model '{name}' at the border nodes of the coarse mesh ({e}); take a fine model of finite \
                     elements"
                );
                self.refusal(Method::Schwarz, &rule)
            });
            Ok((k, row?))
        };
        self.shapes(coarse, fine, range).map(row).collect()
    }

    /// Nodes of a model in a range of distances, with the shape functions of another one.
    fn shapes<'a>(
        &'a self,
        points: &'a Body,
        field: &'a Body,
        range: [f64; 2],
    ) -> impl Iterator<Item = (usize, arlequin::core::Result<ShapeRow<f64>>)> + 'a {
        let rounded = 1e-9 * self.width;
        let nodes = points.model.nodes().iter().enumerate();
        let nodes = nodes.filter(move |(_, x)| {
            let distance = self.distance(x);
            distance >= range[0] - rounded && distance <= range[1] + rounded
        });
        nodes.map(|(k, x)| {
            let mut row = ShapeRow::default();
            (k, field.field.shape_at(x, false, &mut row).map(|()| row))
        })
    }

    /// Refuses a method by its name, with the reason and the remedy.
    pub(super) fn refusal(&self, method: Method, rule: &str) -> crate::error::Error {
        value(format!("interface.{}.method", self.name), method.name(), rule)
    }

    /// Distance of a point from the coarse border.
    pub(super) fn distance(&self, x: &Point3<f64>) -> f64 {
        (x - self.origin).dot(&self.axis)
    }

    /// Lengths of the models' own regions \[m\], the coarse one first.
    ///
    /// # Errors
    /// A region without room for a pulse that the coarse model carries.
    pub(super) fn own_lengths(&self) -> Result<[f64; 2]> {
        let (coarse, fine) = self.places.x.split_at(self.places.split);
        let lengths = [
            -coarse.iter().copied().fold(0.0, f64::min),
            fine.iter().copied().fold(0.0, f64::max) - self.width,
        ];
        for (side, length) in self.sides().into_iter().zip(lengths) {
            let spacings = length / self.spacing[0];
            if spacings.is_nan() || spacings < ROOM {
                let rule = format!(
                    "coarse spacings beside the overlap must be at least {ROOM}, so that a pulse has room; lengthen the model, narrow \
                     the overlap or take a finer coarse mesh"
                );
                let name = self.bodies[side].model.name();
                return Err(value(
                    format!("model.{name}.shape"),
                    format!("{spacings:.1}"),
                    &rule,
                ));
            }
        }
        Ok(lengths)
    }

    /// Nodes of the coarse model.
    pub(super) fn coarse_nodes(&self) -> &[Point3<f64>] {
        self.bodies[self.sides()[0]].model.nodes()
    }

    /// A point of the coarse border and the axis.
    pub(super) fn frame(&self) -> (Point3<f64>, Vector3<f64>) {
        (self.origin, self.axis)
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
    out.wake = None;
    for table in out.interface.values_mut() {
        table.method = Method::Arlequin;
        table.weight.weighting = Weighting::Energy;
        table.lumped = false;
    }
    out
}

/// Builds one model over the place of both; `names` are the model that goes and the one that stays.
fn everywhere(
    (scene, folder): (&LoweredScene, &Path),
    shape: Shape,
    [gone, kept]: [&String; 2],
    frame: (Point3<f64>, Vector3<f64>),
    announce: &mut dyn FnMut(&str, usize, usize),
) -> Result<Everywhere> {
    let mut whole = scene.clone();
    whole.interface.clear();
    whole.model.remove(gone);
    let path = |what: &str| format!("model.{kept}.{what}");
    if let Some(model) = whole.model.get_mut(kept) {
        if model.spacing.is_none() {
            let rule = "is missing: the comparison builds the model in the place of both; give spacing";
            return Err(key(path("spacing"), rule));
        }
        model.shape = BodyShape::Given(shape);
        model.role = None;
    }
    let (bodies, _) = setup::parts(&whole, folder, announce)?;
    let body = bodies
        .into_iter()
        .next()
        .ok_or_else(|| key(path("shape"), "makes no body"))?;
    Ok(Everywhere {
        full: masses(&body, &Uniform(1.0))?,
        places: Arc::new(places(&[&body], frame)),
        body,
    })
}

/// Refuses a model without a stiffness matrix.
fn linear(body: &Body) -> Result<()> {
    if body.model.views().linear.is_some() {
        return Ok(());
    }
    let rule = "is not linear, so that the methods cannot be compared on its stiffness; take out dem.finite_rotations or the link";
    Err(value("model", body.model.name(), rule))
}

fn masses(body: &Body, weight: &dyn Weight<f64>) -> Result<Vec<f64>> {
    let mut out = vec![0.0; body.model.layout().dofs()];
    let path = format!("model.{}", body.model.name());
    body.model.lumped_inertia(weight, &mut out).map_err(core(path))?;
    Ok(out)
}

fn weighted(body: &mut Body, weight: &dyn Weight<f64>) -> Result<CsMat<f64>> {
    let path = format!("model.{}", body.model.name());
    body.model.set_internal_weight(weight).map_err(core(&*path))?;
    let stiffness = body.model.views().linear.map(|l| l.stiffness().to_csr());
    stiffness.ok_or_else(|| key(path, "is not linear"))
}

/// Places of the unknowns of one or two models.
fn places(bodies: &[&Body], (origin, axis): (Point3<f64>, Vector3<f64>)) -> Places {
    let mut out = Places {
        split: if bodies.len() == 2 {
            bodies[0].model.layout().dofs()
        } else {
            0
        },
        ..Places::default()
    };
    let middle = middle(bodies);
    for body in bodies {
        let (layout, nodes) = (body.model.layout(), body.model.nodes());
        let poisson = body.material.as_ref().map_or(0.0, |m| m.poisson());
        for d in 0..layout.dofs() {
            let (node, c) = (&nodes[layout.node_of(d)], d % layout.components);
            let offset = node - middle;
            let across = poisson * (offset - axis * offset.dot(&axis));
            let moves = d < layout.translations();
            let factor = f64::from(u8::from(moves));
            out.x.push((node - origin).dot(&axis));
            out.axial.push(factor * axis[c]);
            // Nothing moves across a line.
            out.across.push(if layout.components == 3 {
                factor * across[c]
            } else {
                0.0
            });
            out.moves.push(moves);
        }
    }
    out
}

/// Middle of the box around all nodes.
fn middle(bodies: &[&Body]) -> Point3<f64> {
    let ends = [f64::INFINITY, f64::NEG_INFINITY].map(|x| Point3::from([x; 3]));
    let nodes = bodies.iter().flat_map(|b| b.model.nodes());
    let [low, high] = nodes.fold(ends, |[low, high], x| [low.inf(x), high.sup(x)]);
    arlequin::core::nalgebra::center(&low, &high)
}
