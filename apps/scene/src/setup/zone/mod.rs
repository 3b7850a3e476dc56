//! One body, and zones of it in which another model takes its place.
//!
//! `[body]` and `[zone.NAME]` become the models and interfaces that a user could have written: the model
//! `body` of the elements outside of the zones, a model per zone of the elements in and around it, and an
//! interface between the two whose mediator is made of the elements that both have. Decision 0037.

mod around;
mod divide;
mod faces;
mod likeness;
mod lower;
mod place;
mod region;

pub(super) use faces::{Faces, corners_of};
pub use likeness::Likeness;
pub(super) use likeness::{Supports, Twin};
pub(crate) use lower::{lowered, written};

use super::kinds::{self, Body};
use super::mesh::{self, Request};
use super::{natural, select};
use crate::error::{Result, fem, key, value};
use crate::spec::{Interface, ModelKind, ModelTable, OverlapShape, SceneSpec, Shape, ZoneTable};
use arlequin::core::Overlap;
use arlequin::core::effect::SurfaceFacet;
use arlequin::core::nalgebra::Point3;
use arlequin::fem_ref::gmsh::{Triangles, triangles_of};
use arlequin::fem_ref::{Facet, FemField, Mesh};
use divide::Division;
use std::path::Path;
use std::sync::{Arc, OnceLock};

/// Name of the body's model.
pub(super) const BODY: &str = "body";

/// Models of what a scene names by one of them: where that is the body, its zones as well.
pub(super) fn parts(scene: &SceneSpec, m: usize) -> Vec<usize> {
    let place = |name: &String| scene.model.keys().position(|n| n == name);
    let whole = scene.body.is_some() && place(&BODY.to_owned()) == Some(m);
    let zones = scene.zone.keys().filter(|_| whole).filter_map(place);
    std::iter::once(m).chain(zones).collect()
}

/// The same of models of which a list names some: zones that another list names are not the body's in this
/// one.
pub(super) fn with_parts(
    scene: &SceneSpec,
    named: Vec<usize>,
    elsewhere: impl Fn(&str) -> bool,
) -> Vec<usize> {
    let name = |m: usize| scene.model.keys().nth(m).map_or("", String::as_str);
    let mut out = named.clone();
    for z in named.iter().flat_map(|m| parts(scene, *m)) {
        if !out.contains(&z) && !elsewhere(name(z)) {
            out.push(z);
        }
    }
    out
}

/// Most halvings of the body's elements in a zone.
const HALVINGS: f64 = 6.0;

/// How far the two borders of an overlap are apart.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Width {
    /// Mean over the border to the zone's own region \[m\].
    pub mean: f64,
    /// Smallest \[m\].
    pub least: f64,
    /// Mean length of the body's elements in it \[m\].
    pub spacing: f64,
}

/// How wide the overlap around a zone came out.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct ZoneLine {
    /// Name of the zone.
    pub name: String,
    /// Distance of its borders.
    pub width: Width,
    /// The mean of it in elements of the body.
    pub elements: f64,
    /// The mean of it in distances of the zone's nodes, or particles.
    pub fine: f64,
}

/// How wide the overlaps of a scene came out.
pub(super) fn lines(scene: &SceneSpec, bodies: &[Body]) -> Vec<ZoneLine> {
    let of = |(name, table): (&String, &Interface)| {
        let OverlapShape::Zone(piece) = &table.overlap else {
            return None;
        };
        let width = piece.width()?;
        let fine = bodies.iter().find(|b| b.model.name() == name)?;
        Some(ZoneLine {
            name: name.clone(),
            width,
            elements: width.mean / width.spacing,
            fine: width.mean / fine.spacing,
        })
    };
    scene.interface.iter().filter_map(of).collect()
}

/// What a piece of the body is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Use {
    /// The body's own model.
    Body,
    /// The model of a zone.
    Zone(usize),
    /// Mediator and overlap of a zone.
    Between(usize),
}

/// A piece of the body: some of its elements.
#[derive(Debug, Clone)]
pub struct Piece {
    cut: Arc<Cut>,
    of: Use,
}

/// A body and the zones in it; divided when the first piece is asked for.
#[derive(Debug)]
struct Cut {
    body: ModelTable,
    zones: Vec<(String, ZoneTable)>,
    /// Boxes in which loads and supports of the body act, whose surfaces become groups.
    marks: Vec<Mark>,
    made: OnceLock<Division>,
}

/// A closed box by the key that names it.
#[derive(Debug)]
struct Mark {
    key: String,
    low: [f64; 3],
    high: [f64; 3],
}

impl Cut {
    fn division(&self, folder: &Path) -> Result<&Division> {
        if let Some(made) = self.made.get() {
            return Ok(made);
        }
        let made = Division::of(self.mesh(folder)?, self, folder)?;
        Ok(self.made.get_or_init(|| made))
    }

    /// What the body asks for as a model that is alone.
    fn request<'a>(&'a self, folder: &'a Path) -> Result<Request<'a>> {
        match self.body.kind {
            ModelKind::Cnem => natural::request("body", &self.body, folder),
            _ => kinds::request("body", &self.body, folder),
        }
    }

    fn mesh(&self, folder: &Path) -> Result<Mesh<f64>> {
        let mut whole = self.request(folder)?.mesh()?;
        if self.body.kind == ModelKind::Cnem {
            whole = whole.into_tetrahedra().map_err(fem("body"))?;
        }
        let reach = select::slack(whole.spacing());
        for mark in &self.marks {
            let within = |x: &Point3<f64>| select::inside(&mark.low, &mark.high, x, reach);
            let nodes = whole.nodes();
            let corners = |f: Facet| {
                whole
                    .facet_nodes(f)
                    .into_iter()
                    .all(|k| within(&nodes[k as usize]))
            };
            if whole.boundary().into_iter().any(corners) {
                whole = whole.with_surface(&mark.key, within).map_err(fem("body"))?;
            }
        }
        Ok(whole)
    }
}

impl Piece {
    /// Refuses what can be seen to be wrong before anything is meshed.
    pub(super) fn check(&self, request: &Request<'_>) -> Result<()> {
        match self.of {
            Use::Body => {
                let whole = self.cut.request(request.folder)?;
                whole.check_body()
            }
            Use::Zone(_) => {
                if request.divisions.is_some() {
                    let rule = "a zone halves the body's elements; give spacing";
                    return Err(key(format!("{}.divisions", request.key), rule));
                }
                mesh::positive_spacing(request.key, request.spacing).map(|_| ())
            }
            Use::Between(_) => Ok(()),
        }
    }

    /// Whether the body comes from a file.
    pub(super) fn is_of_file(&self) -> bool {
        matches!(self.cut.body.shape, Shape::File(_))
    }

    /// Its mesh; that of a zone's model and its mediator are halved until their elements are no longer than
    /// asked for.
    pub(super) fn mesh(&self, request: &Request<'_>) -> Result<Mesh<f64>> {
        let mesh = self.elements(self.cut.division(request.folder)?)?;
        match (self.of, request.spacing) {
            (Use::Zone(z), Some(wanted)) => halved(
                mesh,
                wanted,
                1.0,
                &format!("zone.{}.spacing", self.cut.zones[z].0),
            ),
            (Use::Between(_), Some(wanted)) => halved(mesh, wanted, 0.0, &format!("{}.spacing", request.key)),
            _ => Ok(mesh),
        }
    }

    /// Its elements as they are in the body.
    fn elements(&self, division: &Division) -> Result<Mesh<f64>> {
        let mesh = division.field.mesh();
        let kept = |e: usize| match self.of {
            Use::Body => !matches!(division.of[e], divide::Owner::Zone(_)),
            Use::Zone(z) => {
                matches!(division.of[e], divide::Owner::Zone(k) | divide::Owner::Both(k) if k == z)
            }
            Use::Between(z) => division.of[e] == divide::Owner::Both(z),
        };
        mesh.part(kept).map_err(fem("body"))
    }

    /// Its surface, to be filled.
    pub(super) fn surface(&self, folder: &Path) -> Result<(Triangles, Mesh<f64>)> {
        let mesh = self.elements(self.cut.division(folder)?)?;
        Ok((triangles_of(&mesh), mesh))
    }

    /// The surface of a zone's elements and of those around them, as far as spheres may lie up to `margin`
    /// \[m\] beyond. And the faces between the two.
    pub(super) fn around(&self, folder: &Path, margin: f64) -> Result<(Triangles, Vec<[Point3<f64>; 3]>)> {
        let division = self.cut.division(folder)?;
        let (mesh, border) = around::around(division, self.number(), margin)?;
        Ok((triangles_of(&mesh), border))
    }

    /// The whole body with all its zones. Boxes in which loads and supports of the body act are groups by
    /// their key (`load[0]`), where these hold a part of the surface.
    pub(super) fn whole(&self, folder: &Path) -> Result<&Mesh<f64>> {
        Ok(self.cut.division(folder)?.field.mesh())
    }

    /// Facets of a group on its elements as they are in the body.
    pub(super) fn facets(&self, group: &str, folder: &Path) -> Result<Vec<SurfaceFacet<f64>>> {
        let mesh = self.elements(self.cut.division(folder)?)?;
        let there = mesh.groups().get(group).is_some_and(|g| !g.facets.is_empty());
        if there {
            return mesh.surface(group).map_err(fem("body"));
        }
        Ok(Vec::new())
    }

    /// Whether nodes of the whole body are of no element but those that this zone has for itself.
    pub(super) fn alone(&self, folder: &Path) -> Result<Vec<bool>> {
        let division = self.cut.division(folder)?;
        let mesh = division.field.mesh();
        let mut out = vec![true; mesh.nodes().len()];
        for (e, owner) in division.of.iter().enumerate() {
            if *owner != divide::Owner::Zone(self.number()) {
                mesh.element(e).iter().for_each(|k| out[*k as usize] = false);
            }
        }
        Ok(out)
    }

    /// Name of the zone of whose own elements a point is, if it is of any.
    pub(super) fn zone_at(&self, x: &Point3<f64>, folder: &Path) -> Result<Option<&str>> {
        let division = self.cut.division(folder)?;
        Ok(match division.field.element_at(x).map(|e| division.of[e]) {
            Some(divide::Owner::Zone(z)) => Some(&self.cut.zones[z].0),
            _ => None,
        })
    }

    /// Whether a point is of the elements that this zone has, alone or with the body's model.
    pub(super) fn holds(&self, x: &Point3<f64>, folder: &Path) -> Result<bool> {
        let division = self.cut.division(folder)?;
        let owner = division.field.element_at(x).map(|e| division.of[e]);
        let mine = |z: usize| z == self.number();
        Ok(owner.is_some_and(|o| matches!(o, divide::Owner::Zone(z) | divide::Owner::Both(z) if mine(z))))
    }

    /// Where points lie with respect to the overlap.
    pub(super) fn overlap(&self, folder: &Path) -> Result<Arc<dyn Overlap<f64>>> {
        let division = self.cut.division(folder)?;
        let zone = self.number();
        Ok(Arc::new(place::Layer::new(division, zone)))
    }

    /// Width of the overlap, once the body is divided.
    pub(crate) fn width(&self) -> Option<Width> {
        let division = self.cut.made.get()?;
        Some(division.zones[self.number()].width)
    }

    fn number(&self) -> usize {
        match self.of {
            Use::Zone(z) | Use::Between(z) => z,
            Use::Body => 0,
        }
    }
}

/// Elements halved until they are no longer than wanted \[m\], so many times at least.
fn halved(mesh: Mesh<f64>, wanted: f64, least: f64, key: &str) -> Result<Mesh<f64>> {
    let ratio = mesh.spacing() / wanted;
    let times = (ratio.log2() - 1e-6).ceil().max(least);
    if times > HALVINGS {
        let rule = format!(
            "is {ratio:.0} times finer than the body's elements there ({:.3e} m), {:.0} at most; refine the body's mesh",
            mesh.spacing(),
            HALVINGS.exp2()
        );
        return Err(value(key, wanted, &rule));
    }
    let halved = (0..times as usize).try_fold(mesh, |mesh, _| mesh.refined());
    halved.map_err(fem(key))
}

/// The body's elements as a field, which finds the element of a point.
type Whole = Arc<FemField<f64>>;
