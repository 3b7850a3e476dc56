//! `kind = "cnem"`: natural elements on the nodes of a mesh.

use crate::error::{Result, cnem as natural, fem, value};
use crate::setup::body::Body;
use crate::setup::clock::SetupClock;
use crate::setup::kind::{Feature, Kind, Order};
use crate::setup::mesh::{Elements, Grid, Request};
use crate::setup::{LoweredModel, materials, slit};
use crate::spec::{CnemTable, Functions, Masses};
use arlequin::cnem::constraint::Surface;
use arlequin::cnem::domain::Domain;
use arlequin::cnem::natural::Interpolant;
use arlequin::cnem::{CnemModel, Inertia, Options, Stabilisation};
use arlequin::core::CoarseModel;
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::fem_ref::Mesh;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// Constrained natural elements.
pub(super) struct Cnem;

impl Kind for Cnem {
    fn name(&self) -> &'static str {
        "cnem"
    }

    fn meaning(&self) -> &'static str {
        "Constrained natural elements on the nodes of the same mesh."
    }

    fn elements(&self) -> Option<Elements> {
        Some(Elements::Tetrahedra)
    }

    fn refusal(&self, feature: Feature) -> Option<&'static str> {
        match feature {
            Feature::Volumes => Some(
                "the cell of a natural element lies on both sides of a border between two materials; take kind = \"fem\", or a \
                 model of each part with volume",
            ),
            Feature::Sleep => Some(
                "no scene changes the weights of natural elements; take body.kind = \"fem\", or remove follow",
            ),
            Feature::Crack | Feature::CoarseSide | Feature::Zone | Feature::Partition => None,
        }
    }

    /// Natural elements smooth their strains over cells, which reach over two spacings; their stabilisation
    /// adds element-wise strains.
    fn element_share(&self, table: &LoweredModel) -> f64 {
        match (table.cnem.stabilisation, Stabilisation::default()) {
            (Some(share), _) | (None, Stabilisation::SubCells(share)) => share,
            (None, Stabilisation::None) => 0.0,
        }
    }

    fn check(&self, order: &Order<'_>) -> Result<()> {
        request(order)?.check_body()
    }

    /// Builds natural elements on the nodes of the mesh that finite elements would have for the same table.
    fn build(&self, order: &Order<'_>, clock: &mut SetupClock<'_>) -> Result<Body> {
        let Order { name, key, table, .. } = *order;
        let mesh = request(order)?.mesh()?.into_tetrahedra().map_err(fem(key))?;
        let mesh = slit::cut(key, table, mesh)?;
        let material = materials::elastic(key, table.known_material(key)?)?;
        clock.begin(format!("tetrahedra of '{name}'"));
        let joined = Joined::from_mesh(&mesh).map_err(fem(key))?;
        let domain = Domain::new(&joined.nodes, &joined.surface()).map_err(natural(key))?;
        clock.begin(format!("cells and natural neighbours of '{name}'"));
        let model = CnemModel::new(name, domain, material, options(&table.cnem)).map_err(natural(key))?;
        let mut warnings = model.warnings();
        warnings.extend(materials::warnings(table, &mesh));
        let numbers = joined.numbers(model.domain());
        let groups = groups(&mesh, &model, &joined, &numbers);
        let surfaces = surfaces(&mesh, &model, &groups, &numbers);
        let boundary = model.surface(|_| true).map_err(natural(key))?;
        let grid = Grid {
            points: model.domain().nodes().to_vec(),
            connectivity: model.domain().elements().flatten().map(|v| v as u32).collect(),
            corners: 4,
            cell_type: 10,
            radii: Vec::new(),
        };
        Ok(Body {
            field: model.coarse_field(),
            model: Box::new(model),
            solver: None,
            grid: Arc::new(grid),
            groups,
            surfaces,
            boundary,
            spacing: mesh.spacing(),
            material: Some(material),
            materials: Some(material.into()),
            shape: table.shape.clone(),
            grains: None,
            warnings,
        })
    }
}

/// Request for the mesh whose nodes the model uses.
fn request<'a>(order: &Order<'a>) -> Result<Request<'a>> {
    let Order { key, table, .. } = *order;
    if table.shape.is_line() {
        let rule =
            "natural elements fill solids; use a box, a cylinder or a file, or kind = \"fem\" for a bar";
        return Err(value(format!("{key}.shape"), table.shape.name(), rule));
    }
    Request::of_model(key, table, Elements::Tetrahedra, order.folder)
}

fn options(table: &CnemTable) -> Options {
    let default = Options::default();
    Options {
        kind: match table.functions {
            None => default.kind,
            Some(Functions::Sibson) => Interpolant::Sibson,
            Some(Functions::Laplace) => Interpolant::Laplace,
        },
        stabilisation: match table.stabilisation {
            None => default.stabilisation,
            Some(0.0) => Stabilisation::None,
            Some(a) => Stabilisation::SubCells(a),
        },
        inertia: match table.inertia {
            None => default.inertia,
            Some(Masses::Cells) => Inertia::Cells,
            Some(Masses::Centroids) => Inertia::Centroids,
        },
    }
}

/// A mesh whose slits are closed: both lips share their nodes, and the faces between them become cracks.
struct Joined<'a> {
    mesh: &'a Mesh<f64>,
    /// Nodes without duplicates \[m\].
    nodes: Vec<Point3<f64>>,
    /// For each node of the mesh, its index in `nodes`.
    place: Vec<usize>,
}

impl<'a> Joined<'a> {
    fn from_mesh(mesh: &'a Mesh<f64>) -> arlequin::fem_ref::Result<Self> {
        let first = mesh.places()?;
        let (mut nodes, mut place) = (Vec::new(), vec![0; first.len()]);
        for (k, x) in mesh.nodes().iter().enumerate() {
            // The first node at a place precedes its duplicates.
            place[k] = match first[k] as usize {
                first_node if first_node == k => {
                    nodes.push(*x);
                    nodes.len() - 1
                }
                first_node => place[first_node],
            };
        }
        Ok(Self { mesh, nodes, place })
    }

    fn corners(&self, e: usize) -> [usize; 4] {
        [0, 1, 2, 3].map(|k: usize| self.place[self.mesh.element(e)[k] as usize])
    }

    /// Boundary of the mesh; facets of which two lie at the same place become cracks.
    fn surface(&self) -> Surface {
        let corners: Vec<[usize; 4]> = (0..self.mesh.element_count()).map(|e| self.corners(e)).collect();
        let surface = Surface::of_elements(&corners);
        if self.mesh.doubled() == 0 {
            return surface;
        }
        let mut facets: BTreeMap<[usize; 3], Vec<[usize; 3]>> = BTreeMap::new();
        for f in self.mesh.boundary() {
            let nodes = self.mesh.facet_nodes(f);
            let face = [0, 1, 2].map(|k: usize| self.place[nodes[k] as usize]);
            let mut sorted = face;
            sorted.sort_unstable();
            facets.entry(sorted).or_default().push(face);
        }
        let lips = facets.into_values().filter(|f| f.len() == 2);
        surface.with_cracks(lips.map(|f| f[0]).collect())
    }

    /// For each node of the mesh, its number in the domain. A node on a crack has copies in the domain; the
    /// copy on the side of the node's elements is taken.
    fn numbers(&self, domain: &Domain) -> Vec<usize> {
        let mut out = self.place.clone();
        let copied: BTreeSet<usize> = domain.copies().map(|c| c.original).collect();
        if copied.is_empty() {
            return out;
        }
        let mut tets_around: BTreeMap<usize, Vec<[usize; 4]>> = BTreeMap::new();
        for tet in domain.elements() {
            for v in tet
                .map(|v| domain.original(v))
                .into_iter()
                .filter(|v| copied.contains(v))
            {
                tets_around.entry(v).or_default().push(tet);
            }
        }
        for e in 0..self.mesh.element_count() {
            let points = [0, 1, 2, 3].map(|k: usize| self.mesh.nodes()[self.mesh.element(e)[k] as usize]);
            let centre = points.iter().fold(Vector3::zeros(), |s, p| s + p.coords) / 4.0;
            for (k, p) in self.mesh.element(e).iter().zip(points) {
                let place = self.place[*k as usize];
                let Some(tets) = tets_around.get(&place) else {
                    continue;
                };
                // A point just inside the element, next to the node: the tetrahedron that contains it is on
                // the same side of the crack.
                let inside = p + (Point3::from(centre) - p) * 0.1;
                let depth = |tet: &&[usize; 4]| depth(tet.map(|v| &domain.nodes()[v]), &inside);
                let deepest = tets.iter().max_by(|a, b| depth(a).total_cmp(&depth(b)));
                let copy = deepest.and_then(|t| t.iter().find(|v| domain.original(**v) == place));
                out[*k as usize] = copy.copied().unwrap_or(place);
            }
        }
        out
    }
}

/// Smallest barycentric coordinate of a point in a tetrahedron; negative outside.
fn depth([a, b, c, d]: [&Point3<f64>; 4], x: &Point3<f64>) -> f64 {
    let six = |a: &Point3<f64>, b: &Point3<f64>, c: &Point3<f64>, d: &Point3<f64>| {
        (b - a).cross(&(c - a)).dot(&(d - a))
    };
    let parts = [six(x, b, c, d), six(a, x, c, d), six(a, b, x, d), six(a, b, c, x)];
    parts.iter().fold(f64::INFINITY, |m, p| m.min(*p)) / six(a, b, c, d)
}

/// Corners of each boundary triangle, and whether the triangle belongs to a crack.
fn faces(model: &CnemModel) -> Vec<([usize; 3], bool)> {
    model.domain().constrained_faces().map(|f| (f.0, f.1)).collect()
}

/// Named sets of nodes: those of the mesh, and nodes that were inserted on faces of the set.
fn groups(
    mesh: &Mesh<f64>,
    model: &CnemModel,
    joined: &Joined<'_>,
    numbers: &[usize],
) -> BTreeMap<String, Vec<usize>> {
    let faces = faces(model);
    let given_nodes = joined.nodes.len();
    // Order of the nodes in the domain: given ones, those inserted on faces, copies at cracks.
    let first_copy = model.domain().nodes().len() - model.domain().copies().count();
    let named = mesh.groups().iter().map(|(name, group)| {
        let mut nodes: BTreeSet<usize> = group.nodes.iter().map(|&k| numbers[k as usize]).collect();
        let inserted: Vec<usize> = (given_nodes..first_copy)
            .filter(|n| {
                let faces_around = faces.iter().map(|f| f.0).filter(|f| f.contains(n));
                faces_around.clone().flatten().any(|k| nodes.contains(&k))
                    && faces_around
                        .clone()
                        .any(|f| f.iter().all(|k| *k >= given_nodes || nodes.contains(k)))
            })
            .collect();
        nodes.extend(inserted);
        (name.clone(), nodes.into_iter().collect())
    });
    named.collect()
}

/// Named surfaces: boundary facets whose triangles have all corners in the group. Of the two lips of a crack,
/// only the one with the same outward direction as the facets of the group belongs to the surface.
fn surfaces(
    mesh: &Mesh<f64>,
    model: &CnemModel,
    groups: &BTreeMap<String, Vec<usize>>,
    numbers: &[usize],
) -> BTreeMap<String, Vec<arlequin::core::effect::SurfaceFacet<f64>>> {
    let faces = faces(model);
    let domain = model.domain();
    let named = mesh.groups().iter().filter(|(_, g)| !g.facets.is_empty());
    named
        .filter_map(|(name, group)| {
            let places: BTreeSet<usize> = groups[name].iter().map(|k| domain.original(*k)).collect();
            let mut outward: BTreeMap<usize, Vector3<f64>> = BTreeMap::new();
            for facet in &group.facets {
                let nodes = mesh.facet_nodes(*facet);
                let x = |k: usize| mesh.nodes()[nodes[k] as usize];
                let area = (x(1) - x(0)).cross(&(x(2) - x(0)));
                for k in &nodes {
                    *outward.entry(numbers[*k as usize]).or_insert_with(Vector3::zeros) += area;
                }
            }
            let whole = model.surface(|f| {
                let (corners, crack) = &faces[f.face];
                let looks = || outward.get(&f.cell).is_some_and(|n| n.dot(&f.area) > 0.0);
                corners.iter().all(|k| places.contains(&domain.original(*k))) && (!crack || looks())
            });
            whole.ok().map(|s| (name.clone(), s))
        })
        .collect()
}
