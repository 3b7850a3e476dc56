//! Interfaces: overlap, weights, mediator, junction, absorber.

use super::body::Body;
use super::kinds::kind;
use super::mediator::{is_hull, mediator, mediator_shape, within_hull};
use super::mesh::Grid;
use super::names::sides_of;
use super::partners::Partners;
use super::shapes::{region, region_box, shape_corners};
use crate::error::{Result, core, key, value};
use crate::setup::{LoweredInterface, LoweredScene, OverlapSource};
use crate::spec::{Method, OverlapShape, ProfileKind, WeightTable};
use arlequin::core::advice::{self, Advice};
use arlequin::core::effect::Absorber;
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::core::{
    InterfaceOptions, InterfaceSpec, Junction, Overlap, Partition, Place, Ramp, Sampling, Shell, Slab,
    Weight, Weights,
};
use std::path::Path;
use std::sync::Arc;

/// An interface before it is passed to the core.
pub(crate) struct BuiltInterface {
    /// Description of the interface for the core.
    pub spec: InterfaceSpec<f64>,
    /// Weights of the coarse model in this overlap.
    pub weights: Weights<f64>,
    /// Check of the partition of unity of the weights.
    pub partition: Partition,
    /// Mesh of the mediator, for output.
    pub grid: Grid,
    /// Damping on the fine model of waves that the coarse model cannot carry.
    pub absorber: Option<Absorber<f64>>,
    /// Known weaknesses of the interface.
    pub advice: Vec<Advice>,
    /// Data of the two models, with which the interface can be built anew for another overlap.
    pub partners: Partners,
}

/// The models of an interface: number and body, coarse model first.
pub(super) type Sides<'a> = [(usize, &'a Body); 2];

/// `[interface.NAME]` after its checks; the models that it couples are not built yet.
pub(crate) struct Plan<'a> {
    name: &'a str,
    table: &'a LoweredInterface,
    folder: &'a Path,
    /// Numbers of the coarse and the fine model.
    models: [usize; 2],
    overlap: Arc<dyn Overlap<f64>>,
}

impl<'a> Plan<'a> {
    /// Checks a table together with those of its models.
    ///
    /// # Errors
    /// The key, its value, the limit and the remedy.
    pub(super) fn new(
        name: &'a str,
        table: &'a LoweredInterface,
        scene: &'a LoweredScene,
        folder: &'a Path,
    ) -> Result<Self> {
        let models = sides_of(name, table, scene)?;
        let tables = [&scene.model[&table.coarse], &scene.model[&table.fine]];
        let path = format!("interface.{name}");
        if !matches!(table.method, Method::Arlequin | Method::Nodal | Method::Lumped) {
            let rule = "is measured by `arlequin compare` only; for a run take \"arlequin\", \"nodal\" or \"lumped\"";
            return Err(value(format!("{path}.method"), table.method.name(), rule));
        }
        let overlap = overlap(&format!("{path}.overlap"), &table.overlap, folder)?;
        if let [Some(coarse), Some(fine)] = tables.map(|t| shape_corners(&t.shape)) {
            check_place(&path, table, &*overlap, [&coarse, &fine])?;
            check_ends(&path, table, tables.map(|t| t.spacing), [&coarse, &fine])?;
        }
        // Built for their errors only; the nodes of the mediator are not known yet, and any positive spacing
        // will do.
        weights(&path, &table.weight, &overlap, None, [false; 2])?;
        junction(&path, table, 1.0)?;
        if let Some(a) = &table.absorber
            && a.rate.is_some() == a.rate_factor.is_some()
        {
            let rule = "needs exactly one of rate [1/s], rate_factor [-]";
            return Err(key(format!("{path}.absorber"), rule));
        }
        if let Some(a) = &table.absorber {
            let rates = [("rate", a.rate), ("rate_factor", a.rate_factor)];
            if let Some((name, Some(rate))) = rates.iter().find(|(_, r)| r.is_some_and(|r| r < 0.0)) {
                let rule =
                    "must not be negative: it would feed waves; take 0.2 as rate_factor, or remove absorber";
                return Err(value(format!("{path}.absorber.{name}"), rate, rule));
            }
        }
        // The shape of a link is known only after it has connected.
        if table.mediator.shape.is_some() || !tables.iter().any(|t| kind(t.kind).is_remote()) {
            let key_path = format!("{path}.mediator");
            let shape = mediator_shape(&key_path, table, tables.map(|t| &t.shape))?;
            mediator(&key_path, table, &shape, 1.0, folder).check()?;
        }
        Ok(Self {
            name,
            table,
            folder,
            models,
            overlap,
        })
    }

    /// Builds the interface between two of the bodies.
    pub(super) fn build(&self, bodies: &[Body]) -> Result<BuiltInterface> {
        let Self { table, folder, .. } = *self;
        let sides = self.models.map(|m| (m, &bodies[m]));
        let overlap = self.overlap.clone();
        let path = format!("interface.{}", self.name);
        check_place(&path, table, &*overlap, sides.map(|s| s.1.model.nodes()))?;
        let mediator_path = format!("{path}.mediator");
        let mut shape = mediator_shape(&mediator_path, table, sides.map(|s| &s.1.shape))?;
        // A derived mediator must lie where the field of the particles exists.
        let hulls = sides
            .iter()
            .filter(|s| table.mediator.shape.is_none() && is_hull(s.1));
        for (_, body) in hulls {
            shape = within_hull(
                mediator(&mediator_path, table, &shape, sides[0].1.spacing, folder),
                body,
            )?;
        }
        let partners = Partners::new(&path, table, sides)?;
        let mut built = partners.tie(self.name, (table, folder), (&overlap, &shape))?;
        let spacing = built.spec.mediator.spacing();
        built.advice = advise(table, sides, &*overlap, spacing, built.absorber.is_some());
        Ok(built)
    }
}

/// Returns known weaknesses of the interface.
fn advise(
    table: &LoweredInterface,
    [coarse, fine]: Sides<'_>,
    overlap: &dyn Overlap<f64>,
    spacing: f64,
    absorbs: bool,
) -> Vec<Advice> {
    let width = overlap.linear_position().map(|(g, _)| 1.0 / g.norm());
    let brittle = [coarse, fine].map(|s| s.1.grains.as_ref().is_some_and(|g| g.brittle));
    let mut out = Vec::new();
    if brittle[1] {
        out = advice::breakage(width, spacing, floors(&table.weight, brittle)[1], absorbs);
    }
    if absorbs && table.absorber.is_some() {
        let jump = match table.weight.kind() {
            ProfileKind::Constant => table.weight.value.map_or(0.0, |v| v.max(1.0 - v)),
            _ => 0.0,
        };
        out.extend(advice::absorber(width, jump, coarse.1.spacing, fine.1.spacing));
    }
    out
}

/// Smallest and largest position of points across a slab, where `from` has position 0 and `to` position 1.
fn positions_across(from: &[f64; 3], to: &[f64; 3], points: &[Point3<f64>]) -> [f64; 2] {
    let (from, direction) = (Vector3::from(*from), Vector3::from(*to) - Vector3::from(*from));
    let places = points
        .iter()
        .map(|x| direction.dot(&(x.coords - from)) / direction.norm_squared());
    places.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], s| {
        [a.min(s), b.max(s)]
    })
}

/// Lowest and highest corner of the bounding box of points.
fn around(points: &[Point3<f64>]) -> [Point3<f64>; 2] {
    let ends = [f64::INFINITY, f64::NEG_INFINITY].map(|x| Point3::from([x; 3]));
    points
        .iter()
        .fold(ends, |[low, high], x| [low.inf(x), high.sup(x)])
}

/// Refuses an overlap that does not reach into both models: the weights would leave one of them without mass.
fn check_place(
    path: &str,
    table: &LoweredInterface,
    overlap: &dyn Overlap<f64>,
    points: [&[Point3<f64>]; 2],
) -> Result<()> {
    let (shape, names) = (&table.overlap, [&table.coarse, &table.fine]);
    let boxes = points.map(around);
    let (reaches, place) = match shape {
        OverlapSource::Given(OverlapShape::Slab { fine, coarse }) => {
            let reaches = points.map(|p| {
                let [first, last] = positions_across(fine, coarse, p);
                // A face on a border of the slab touches it up to round-off, and does not reach into it.
                first < 1.0 - 1e-6 && last > 1e-6
            });
            (
                reaches,
                format!("between the planes through {fine:?} and {coarse:?} m"),
            )
        }
        // Both models are cut from one body and fit each other.
        OverlapSource::Zone(_) => return Ok(()),
        OverlapSource::Given(OverlapShape::Shell { domain, .. }) => {
            let [low, high] = region_box(domain);
            let alone = |x: Point3<f64>| overlap.place(&x) == Place::Fine;
            let reaches = boxes.map(|[a, b]| {
                let apart = (0..3).any(|c| a[c] >= high[c] || b[c] <= low[c]);
                let corner = |k: usize| {
                    let end = |c: usize| if k >> c & 1 == 0 { a[c] } else { b[c] };
                    Point3::new(end(0), end(1), end(2))
                };
                // The regions are convex: a box lies inside one if all of its corners do.
                !apart && !(0..8).map(corner).all(alone)
            });
            (reaches, format!("from {low:?} to {high:?} m at most"))
        }
    };
    let missed = match reaches {
        [true, true] => return check_sense(path, shape, names, points),
        [false, false] => format!("the models '{}' and '{}'", names[0], names[1]),
        [coarse, _] => format!("model '{}'", names[usize::from(coarse)]),
    };
    let lies = |k: usize| {
        let [low, high] = &boxes[k];
        let name = names[k];
        format!(
            "'{name}' from {:?} to {:?} m",
            low.coords.as_slice(),
            high.coords.as_slice()
        )
    };
    let rule = format!(
        "the overlap, {place}, does not lie in {missed}: {} and {}; place it where both models are",
        lies(0),
        lies(1)
    );
    Err(key(format!("{path}.overlap"), rule))
}

/// Refuses a slab whose two points are exchanged: the weights would then leave both models without mass.
fn check_sense(
    path: &str,
    overlap: &OverlapSource,
    [coarse, fine]: [&String; 2],
    [coarse_points, fine_points]: [&[Point3<f64>]; 2],
) -> Result<()> {
    let OverlapSource::Given(OverlapShape::Slab {
        fine: from,
        coarse: to,
    }) = overlap
    else {
        return Ok(());
    };
    let range = |points: &[Point3<f64>]| positions_across(from, to, points);
    let ([c0, c1], [f0, f1]) = (range(coarse_points), range(fine_points));
    let outside = |s: f64| !(-1e-6..=1.0 + 1e-6).contains(&s);
    if f0 > -1e-6 && outside(f1) && c1 < 1.0 + 1e-6 && outside(c0) {
        let rule = format!(
            "the slab is reversed: fine = {:?} must lie on the border to the region of '{fine}' alone, which is beyond \
             coarse = {to:?}, as that of '{coarse}' is beyond fine; exchange the two points",
            from
        );
        return Err(key(format!("{path}.overlap.slab"), rule));
    }
    Ok(())
}

/// Refuses a model that goes on beyond the slab, where it has no weight and its nodes would have no mass.
fn check_ends(
    path: &str,
    table: &LoweredInterface,
    spacings: [Option<f64>; 2],
    points: [&[Point3<f64>]; 2],
) -> Result<()> {
    let OverlapSource::Given(OverlapShape::Slab { fine, coarse }) = &table.overlap else {
        return Ok(());
    };
    let width = (Point3::from(*coarse) - Point3::from(*fine)).norm();
    let beyond = [
        (
            &table.coarse,
            "fine",
            fine,
            -positions_across(fine, coarse, points[0])[0],
        ),
        (
            &table.fine,
            "coarse",
            coarse,
            positions_across(fine, coarse, points[1])[1] - 1.0,
        ),
    ];
    for ((name, plane, point, reach), spacing) in beyond.into_iter().zip(spacings) {
        let reach = reach * width;
        // Nodes or spheres surely lie in a layer of two spacings.
        if spacing.is_some_and(|h| reach > 2.0 * h) {
            let rule = format!(
                "model '{name}' goes on {reach:.3e} m beyond the plane through {plane} = {point:?} m, where it has no weight; end the \
                 model there, or move the plane to its end"
            );
            return Err(key(format!("{path}.overlap.slab.{plane}"), rule));
        }
    }
    Ok(())
}

pub(super) fn options(table: &LoweredInterface, sides: Sides<'_>) -> InterfaceOptions<f64> {
    InterfaceOptions {
        sampling: match table.sampling {
            Some(chosen) => chosen,
            None if sides.iter().any(|s| s.1.field.samples().is_some()) => Sampling::Particles,
            None => Sampling::Intersection,
        },
        solver: table.solver.into(),
        lumped: table.lumped,
        pin: table.pin.map(Point3::from),
        ..InterfaceOptions::default()
    }
}

fn overlap(path: &str, shape: &OverlapSource, folder: &Path) -> Result<Arc<dyn Overlap<f64>>> {
    let shape = match shape {
        OverlapSource::Zone(piece) => return piece.overlap(folder),
        OverlapSource::Given(shape) => shape,
    };
    Ok(match shape {
        OverlapShape::Slab { fine, coarse } => Arc::new(
            Slab::between(Point3::from(*fine), Point3::from(*coarse))
                .map_err(core(format!("{path}.slab")))?,
        ),
        OverlapShape::Shell { core, domain } => Arc::new(Shell {
            fine_core: region(&format!("{path}.shell.core"), core)?,
            fine_domain: region(&format!("{path}.shell.domain"), domain)?,
        }),
    })
}

/// Weights of the coarse model; without the nodes of the mediator, the cubic profile stands for the one that
/// they decide.
pub(super) fn weights(
    path: &str,
    table: &WeightTable,
    overlap: &Arc<dyn Overlap<f64>>,
    mediator: Option<&[Point3<f64>]>,
    brittle: [bool; 2],
) -> Result<Weights<f64>> {
    let weight = |key: &str, kind: ProfileKind, constant: Option<f64>, epsilon: Option<f64>| {
        let kind = match (kind, mediator) {
            (ProfileKind::MediatorCompatible, None) => ProfileKind::Cubic,
            (kind, _) => kind,
        };
        let path = format!("{path}.weight{key}");
        match (kind == ProfileKind::Constant, constant) {
            (true, None) => {
                return Err(crate::error::key(
                    path,
                    "the constant profile needs value [-], such as value = 0.5",
                ));
            }
            (false, Some(v)) => {
                let rule = "belongs to the constant profile; remove it or choose profile = \"constant\"";
                return Err(value(format!("{path}.value"), v, rule));
            }
            _ => {}
        }
        let profile = kind
            .profile(constant, &stations(&**overlap, mediator.unwrap_or_default()))
            .map_err(core(format!("{path}.profile")))?;
        let [coarse, fine] = match epsilon {
            None => floors(table, brittle),
            Some(e) => [e, table.fine_epsilon.unwrap_or(e)],
        };
        let ramp = Ramp::new(overlap.clone(), profile, coarse)
            .map_err(core(format!("{path}.epsilon")))?
            .with_fine_floor(fine)
            .map_err(core(format!("{path}.fine_epsilon")))?;
        Ok(Arc::new(ramp) as Arc<dyn Weight<f64>>)
    };
    let common = weight("", table.kind(), table.value, table.epsilon)?;
    let specific = |key: &str, t: &Option<crate::spec::ProfileTable>| match t {
        None => Ok(common.clone()),
        Some(t) => weight(key, t.profile, t.value, t.epsilon),
    };
    Ok(Weights {
        internal: specific(".alpha", &table.alpha)?,
        kinetic: specific(".beta", &table.beta)?,
        external: specific(".gamma", &table.gamma)?,
        weighting: table.weighting,
    })
}

/// Floors of the weight of the coarse and the fine model.
fn floors(table: &WeightTable, brittle: [bool; 2]) -> [f64; 2] {
    let [coarse, fine] = brittle.map(|b| table.epsilon.unwrap_or(table.weighting.usual_floor(b)));
    [coarse, table.fine_epsilon.unwrap_or(fine)]
}

/// Positions `s` of the mediator's node layers across the overlap, ascending: 0 at the fine border, 1 at the
/// coarse one.
pub(crate) fn stations(overlap: &dyn Overlap<f64>, mediator: &[Point3<f64>]) -> Vec<f64> {
    let position = |x: &Point3<f64>| match overlap.place(x) {
        Place::Fine => 0.0,
        Place::Coarse => 1.0,
        Place::Overlap(s) => s,
    };
    let mut s: Vec<f64> = mediator.iter().map(position).collect();
    s.sort_by(f64::total_cmp);
    // Positions of nodes in one layer differ by round-off.
    s.dedup_by(|next, last| *next - *last < 1e-6);
    s
}

pub(in crate::setup) fn junction(
    path: &str,
    table: &LoweredInterface,
    spacing: f64,
) -> Result<Box<dyn Junction<f64>>> {
    let key_path = format!("{path}.junction.length");
    // Measured in one and three dimensions: 0.1 to 0.4 mediator spacings are best; with a full spacing the
    // conditioning is twenty times worse.
    let length = table.junction.length.unwrap_or(0.25 * spacing);
    if let (false, Some(l)) = (table.junction.kind.has_length(), table.junction.length) {
        let rule = format!(
            "the {} junction has no length; remove it or choose an h1 kind",
            table.junction.kind
        );
        return Err(value(key_path, l, &rule));
    }
    table.junction.kind.junction(length).map_err(core(key_path))
}
