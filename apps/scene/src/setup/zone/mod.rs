//! A body with zones in which another model replaces it.
//!
//! `[body]` and `[zone.NAME]` become models and interfaces that a user could have written: the model `body`
//! of the elements outside of the zones, a model for each zone of its elements including the overlap, and an
//! interface between both whose mediator consists of the elements in the overlap. Decision 0037.

mod around;
mod divide;
mod held;
mod likeness;
mod moving;
mod place;
mod probes;
mod region;
mod response;
mod uncut;

pub use super::packing::Likeness;
pub use held::Bar;
pub(super) use held::{check_anchors, first_overlap};
pub(super) use likeness::{Supports, Twin};
pub use moving::{Moving, Share};
pub(super) use moving::{check, check_ranks};
pub(super) use probes::with_probes_in_zones;
pub(super) use region::check_region;
pub(super) use uncut::closed_notches;

use super::body::Body;
use super::faces::Faces;
use super::mesh::{self, Elements, Request};
use super::select;
use crate::error::{Result, fem, key, value};
use crate::setup::{LoweredInterface, LoweredModel, LoweredScene, OverlapSource};
use crate::spec::ZoneTable;
use arlequin::core::Overlap;
use arlequin::core::effect::SurfaceFacet;
use arlequin::core::nalgebra::Point3;
use arlequin::fem_ref::gmsh::{Triangles, triangles_of};
use arlequin::fem_ref::{Facet, FemField, Mesh};
use divide::Division;
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::{Arc, OnceLock};

/// Largest number of times that the body's elements are halved in a zone.
const HALVINGS: f64 = 6.0;

/// Distance between the two borders of an overlap.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Width {
    /// Mean over the border of the zone's own region \[m\].
    pub mean: f64,
    /// Smallest distance \[m\].
    pub least: f64,
    /// Mean length of the body's elements in the overlap \[m\].
    pub spacing: f64,
}

/// Width of the overlap around a zone.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct ZoneLine {
    /// Name of the zone.
    pub name: String,
    /// Distance between the borders of the overlap.
    pub width: Width,
    /// Mean width in elements of the body.
    pub elements: f64,
    /// Mean width in spacings of the zone's nodes or particles.
    pub fine: f64,
}

/// Widths of the overlaps around the zones of a scene.
pub(super) fn lines(scene: &LoweredScene, bodies: &[Body]) -> Vec<ZoneLine> {
    let line = |(name, table): (&String, &LoweredInterface)| {
        let OverlapSource::Zone(piece) = &table.overlap else {
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
    scene.interface.iter().filter_map(line).collect()
}

/// Purpose of a piece of the body.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Use {
    /// The body's own model.
    Body,
    /// The model of a zone.
    Zone(usize),
    /// Mediator and overlap of a zone.
    Between(usize),
    /// The spheres among which a zone that follows goes.
    Reservoir,
}

/// A piece of the body: a part of its elements.
#[derive(Debug, Clone)]
pub struct Piece {
    cut: Arc<Cut>,
    purpose: Use,
}

/// A body and its zones; divided at the first request for a piece.
#[derive(Debug)]
pub(super) struct Cut {
    body: LoweredModel,
    elements: Elements,
    zones: Vec<Zone>,
    /// Boxes in which loads and supports act on the body; the surfaces inside become groups.
    marks: Vec<Mark>,
    division: OnceLock<Division>,
}

/// A zone of a body.
#[derive(Debug, Clone)]
pub(super) struct Zone {
    pub name: String,
    pub table: ZoneTable,
    /// True if spheres fill the zone.
    pub has_spheres: bool,
}

/// A closed box, and the key that names it.
#[derive(Debug)]
pub(super) struct Mark {
    pub key: String,
    pub low: [f64; 3],
    pub high: [f64; 3],
}

impl Cut {
    pub(super) fn new(body: LoweredModel, elements: Elements, zones: Vec<Zone>, marks: Vec<Mark>) -> Self {
        Self {
            body,
            elements,
            zones,
            marks,
            division: OnceLock::new(),
        }
    }

    fn division(&self, folder: &Path) -> Result<&Division> {
        // Every piece asks for the division, and dividing a body takes a search over all of its elements.
        if let Some(division) = self.division.get() {
            return Ok(division);
        }
        let division = Division::new(self.mesh(folder)?, self, folder)?;
        // The cell has no fallible initialisation; a second division of the same body would be equal.
        Ok(self.division.get_or_init(|| division))
    }

    /// Request for the mesh of the body as a single model.
    fn request<'a>(&'a self, folder: &'a Path) -> Result<Request<'a>> {
        Request::of_model("body", &self.body, self.elements, folder)
    }

    fn mesh(&self, folder: &Path) -> Result<Mesh<f64>> {
        let mut whole = self.request(folder)?.mesh()?;
        if self.elements == Elements::Tetrahedra {
            whole = whole.into_tetrahedra().map_err(fem("body"))?;
        }
        let reach = select::slack(whole.spacing());
        for mark in &self.marks {
            let inside = |x: &Point3<f64>| select::inside(&mark.low, &mark.high, x, reach);
            let nodes = whole.nodes();
            let corners = |f: Facet| {
                whole
                    .facet_nodes(f)
                    .into_iter()
                    .all(|k| inside(&nodes[k as usize]))
            };
            // A box that holds no facet may still select nodes, which need no surface.
            if whole.boundary().into_iter().any(corners) {
                whole = whole.with_surface(&mark.key, inside).map_err(fem("body"))?;
            }
        }
        Ok(whole)
    }
}

impl Piece {
    /// Piece of a divided body.
    pub(super) fn new(cut: Arc<Cut>, purpose: Use) -> Self {
        Self { cut, purpose }
    }

    /// Returns this piece of the body after the zone has moved to the elements of `core`; see
    /// [`Division::moved`].
    fn moved(&self, core: &[bool], barred: &[Option<Bar>], folder: &Path) -> Result<Self> {
        let division = self.cut.division(folder)?;
        let cut = Cut {
            body: self.cut.body.clone(),
            elements: self.cut.elements,
            zones: self.cut.zones.clone(),
            marks: Vec::new(),
            division: OnceLock::from(division.moved(&self.cut, self.number(), core, barred)?),
        };
        Ok(Self::new(Arc::new(cut), self.purpose))
    }

    /// Checks what can be checked before anything is meshed.
    pub(super) fn check(&self, request: &Request<'_>) -> Result<()> {
        match self.purpose {
            Use::Body => {
                let whole = self.cut.request(request.folder)?;
                whole.check_body()
            }
            Use::Zone(_) | Use::Reservoir => {
                if request.divisions.is_some() {
                    let rule = "a zone halves the body's elements; give spacing";
                    return Err(key(format!("{}.divisions", request.key), rule));
                }
                mesh::positive_spacing(request.key, request.spacing).map(|_| ())
            }
            Use::Between(_) => match request.spacing {
                None => Ok(()),
                Some(wanted) => {
                    let mesh = self.elements(self.cut.division(request.folder)?)?;
                    halvings(&mesh, wanted, 0.0, &format!("{}.spacing", request.key)).map(|_| ())
                }
            },
        }
    }

    /// Returns whether the body comes from a file.
    pub(super) fn is_of_file(&self) -> bool {
        self.cut.body.shape.is_file()
    }

    /// Mesh of the piece. Elements of a zone or a mediator are halved until they are no longer than
    /// requested.
    pub(super) fn mesh(&self, request: &Request<'_>) -> Result<Mesh<f64>> {
        let mesh = self.elements(self.cut.division(request.folder)?)?;
        match (self.purpose, request.spacing) {
            (Use::Zone(z), Some(wanted)) => halved(
                mesh,
                wanted,
                1.0,
                &format!("zone.{}.spacing", self.cut.zones[z].name),
            ),
            (Use::Between(_), Some(wanted)) => halved(mesh, wanted, 0.0, &format!("{}.spacing", request.key)),
            _ => Ok(mesh),
        }
    }

    /// Returns whether an element of the body belongs to the piece.
    fn keeps(&self, division: &Division, e: usize) -> bool {
        match self.purpose {
            Use::Body => !matches!(division.owners[e], divide::Owner::Zone(_)),
            Use::Zone(z) => {
                matches!(division.owners[e], divide::Owner::Zone(k) | divide::Owner::Both(k) if k == z)
            }
            Use::Between(z) => division.owners[e] == divide::Owner::Both(z),
            Use::Reservoir => division.reservoir.get(e).copied().unwrap_or(true),
        }
    }

    /// Elements of the piece as they are in the body.
    fn elements(&self, division: &Division) -> Result<Mesh<f64>> {
        let mesh = division.field.mesh();
        mesh.part(|e| self.keeps(division, e)).map_err(fem("body"))
    }

    /// Surface of the piece, to be filled with spheres, and its elements.
    pub(super) fn surface(&self, folder: &Path) -> Result<(Triangles, Mesh<f64>)> {
        let mesh = self.elements(self.cut.division(folder)?)?;
        Ok((triangles_of(&mesh), mesh))
    }

    /// Surface of the elements of a zone or reservoir together with those around them, far enough for spheres
    /// up to `margin` \[m\] beyond the border; and the faces between both.
    pub(super) fn extended_surface(
        &self,
        folder: &Path,
        margin: f64,
    ) -> Result<(Triangles, Vec<[Point3<f64>; 3]>)> {
        let division = self.cut.division(folder)?;
        let whole = division.field.mesh();
        let in_piece: Vec<bool> = (0..whole.element_count())
            .map(|e| self.keeps(division, e))
            .collect();
        let (mesh, border) = around::extended_zone(whole, &in_piece, margin)?;
        Ok((triangles_of(&mesh), border))
    }

    /// Mesh of the whole body with its zones. Boxes in which loads and supports act are groups named by their
    /// key (`load[0]`), if they contain a part of the surface.
    pub(super) fn whole(&self, folder: &Path) -> Result<&Mesh<f64>> {
        Ok(self.cut.division(folder)?.field.mesh())
    }

    /// Facets of a group on the elements of the piece as they are in the body.
    pub(super) fn facets(&self, group: &str, folder: &Path) -> Result<Vec<SurfaceFacet<f64>>> {
        let mesh = self.elements(self.cut.division(folder)?)?;
        let has_facets = mesh.groups().get(group).is_some_and(|g| !g.facets.is_empty());
        if has_facets {
            return mesh.surface(group).map_err(fem("body"));
        }
        Ok(Vec::new())
    }

    /// For each element of the body: true if it belongs to this zone alone.
    fn elements_alone(&self, folder: &Path) -> Result<Vec<bool>> {
        let owners = self.cut.division(folder)?.owners.iter();
        Ok(owners.map(|o| *o == divide::Owner::Zone(self.number())).collect())
    }

    /// For each node of the body: true if all of its elements belong to this zone alone.
    pub(super) fn alone(&self, folder: &Path) -> Result<Vec<bool>> {
        let division = self.cut.division(folder)?;
        let mesh = division.field.mesh();
        // One element of another owner is enough to rule a node out.
        let mut out = vec![true; mesh.nodes().len()];
        for (e, owner) in division.owners.iter().enumerate() {
            if *owner != divide::Owner::Zone(self.number()) {
                mesh.element(e).iter().for_each(|k| out[*k as usize] = false);
            }
        }
        Ok(out)
    }

    /// Returns whether a point lies in an element of this piece.
    pub(super) fn holds(&self, x: &Point3<f64>, folder: &Path) -> Result<bool> {
        let division = self.cut.division(folder)?;
        Ok(division
            .field
            .element_at(x)
            .is_some_and(|e| self.keeps(division, e)))
    }

    /// Faces between the reservoir of a zone that follows and the rest of the body, and the number of the
    /// body's nodes in the reservoir.
    fn reservoir(&self, folder: &Path) -> Result<(Faces, usize)> {
        let division = self.cut.division(folder)?;
        let mesh = division.field.mesh();
        if division.reservoir.is_empty() {
            return Ok((Faces::new(Vec::new()), mesh.nodes().len()));
        }
        let inside = (0..mesh.element_count()).filter(|e| division.reservoir[*e]);
        let nodes: BTreeSet<u32> = inside.flat_map(|e| mesh.element(e).iter().copied()).collect();
        let (_, border) = around::neighbours(mesh, &division.reservoir);
        Ok((Faces::new(border), nodes.len()))
    }

    /// Positions of points with respect to the overlap.
    pub(super) fn overlap(&self, folder: &Path) -> Result<Arc<dyn Overlap<f64>>> {
        let division = self.cut.division(folder)?;
        let zone = self.number();
        Ok(Arc::new(place::Layer::new(division, zone)))
    }

    /// Width of the overlap; `None` before the body is divided, and for a zone without elements.
    pub(crate) fn width(&self) -> Option<Width> {
        let division = self.cut.division.get()?;
        division.zones[self.number()].width
    }

    /// Returns whether no element of the body belongs to the piece: the zone is empty.
    pub(super) fn is_empty(&self, folder: &Path) -> Result<bool> {
        let division = self.cut.division(folder)?;
        Ok(!(0..division.owners.len()).any(|e| self.keeps(division, e)))
    }

    fn number(&self) -> usize {
        match self.purpose {
            Use::Zone(z) | Use::Between(z) => z,
            // A zone that follows is the only one.
            Use::Body | Use::Reservoir => 0,
        }
    }
}

/// Halves elements at least `least` times and until they are no longer than `target` \[m\].
fn halved(mesh: Mesh<f64>, target: f64, least: f64, key: &str) -> Result<Mesh<f64>> {
    let times = halvings(&mesh, target, least, key)?;
    let halved = (0..times).try_fold(mesh, |mesh, _| mesh.refined());
    halved.map_err(fem(key))
}

/// Number of halvings of [`halved`].
fn halvings(mesh: &Mesh<f64>, target: f64, least: f64, key: &str) -> Result<usize> {
    let ratio = mesh.spacing() / target;
    // A length that fits up to round-off needs no further halving.
    let times = (ratio.log2() - 1e-6).ceil().max(least);
    if times > HALVINGS {
        let rule = format!(
            "is {ratio:.0} times finer than the body's elements there ({:.3e} m), {:.0} at most; refine the body's mesh",
            mesh.spacing(),
            HALVINGS.exp2()
        );
        return Err(value(key, target, &rule));
    }
    Ok(times as usize)
}

/// The body's elements as a field that finds the element at a point.
type Whole = Arc<FemField<f64>>;
