//! A mesh of one element kind with named groups of nodes and surface facets.

use crate::check;
use crate::element::{self, ElementKind, GaussPoint};
use crate::error::{Error, Result, parameter};
use crate::slit;
use arlequin_core::Real;
use arlequin_core::effect::SurfaceFacet;
use arlequin_core::geometry::{Cell, Polyhedron};
use nalgebra::{Point3, Vector3};
use std::collections::BTreeMap;

/// A face of an element, given by the element and the local face number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Facet {
    /// Element index.
    pub element: u32,
    /// Index into [`ElementKind::faces`].
    pub face: u8,
}

/// A named part of a mesh: its nodes, and its facets if the part is a surface.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Group {
    /// Node indices, ascending.
    pub nodes: Vec<u32>,
    /// Facets, ascending; empty for groups of points, lines or volumes.
    pub facets: Vec<Facet>,
}

/// A condition on a position.
pub(crate) type Condition<'a, T> = dyn Fn(&Point3<T>) -> bool + 'a;

/// A mesh of one element kind in the reference configuration, valid by construction.
#[derive(Debug, Clone)]
pub struct Mesh<T: Real> {
    kind: ElementKind,
    nodes: Vec<Point3<T>>,
    connectivity: Vec<u32>,
    groups: BTreeMap<String, Group>,
    volumes: Vec<String>,
    /// For every element, the number of its volume; empty if the mesh does not distinguish volumes.
    regions: Vec<u32>,
    notices: Vec<String>,
    section: T,
    pub(crate) doubled: usize,
}

impl<T: Real> Mesh<T> {
    /// Makes a mesh from node positions \[m\] and the corners of all elements, one element after the other.
    /// Bars get a section of 1 m², which gives results per unit section; see [`Mesh::with_section`].
    ///
    /// ```
    /// use fem_ref::{ElementKind, Mesh};
    /// use arlequin_core::nalgebra::Point3;
    /// let p = Point3::new;
    /// let nodes = vec![p(0.0, 0.0, 0.0), p(1.0, 0.0, 0.0), p(0.0, 1.0, 0.0), p(0.0, 0.0, 1.0)];
    /// let mesh = Mesh::new(ElementKind::Tet4, nodes.clone(), vec![0, 1, 2, 3])?;
    /// assert!((mesh.volume() - 1.0 / 6.0f64).abs() < 1e-15);
    /// let e = Mesh::new(ElementKind::Tet4, nodes, vec![0, 2, 1, 3]).unwrap_err();
    /// assert!(e.to_string().contains("inverted"));
    /// # Ok::<(), fem_ref::Error>(())
    /// ```
    ///
    /// # Errors
    /// A typed error for an empty mesh, coordinates that are not finite, indices out of range, inverted or
    /// flat elements (hexahedra: Jacobian at all corners), elements with the same nodes, unreferenced nodes,
    /// and coincident nodes that are not lips of a slit.
    pub fn new(kind: ElementKind, nodes: Vec<Point3<T>>, connectivity: Vec<u32>) -> Result<Self> {
        Self::with_volumes(kind, nodes, connectivity, Vec::new(), Vec::new())
    }

    /// Like [`Mesh::new`], with the names of volumes and, for every element, the number of its volume.
    pub(crate) fn with_volumes(
        kind: ElementKind,
        nodes: Vec<Point3<T>>,
        connectivity: Vec<u32>,
        volumes: Vec<String>,
        regions: Vec<u32>,
    ) -> Result<Self> {
        let pairs = check::mesh(kind, &nodes, &connectivity)?;
        let mut mesh = Self::unchecked(kind, T::one(), nodes, connectivity);
        mesh.set_volumes(volumes, regions);
        mesh.doubled = pairs.len();
        slit::checked(mesh, &pairs)
    }

    /// Makes a mesh without groups or slits, without checks.
    pub(crate) fn unchecked(
        kind: ElementKind,
        section: T,
        nodes: Vec<Point3<T>>,
        connectivity: Vec<u32>,
    ) -> Self {
        Self {
            kind,
            nodes,
            connectivity,
            groups: BTreeMap::new(),
            volumes: Vec::new(),
            regions: Vec::new(),
            notices: Vec::new(),
            section,
            doubled: 0,
        }
    }

    /// Sets the cross-section of the bars \[m²\].
    ///
    /// # Errors
    /// [`Error::Parameter`] unless the section is positive and finite.
    pub fn with_section(mut self, section: T) -> Result<Self> {
        if !(section.is_finite() && section > T::zero()) {
            return Err(parameter("section", section, "must be positive and finite [m2]"));
        }
        self.section = section;
        Ok(self)
    }

    /// Moves every node to `map(x)`; elements and groups stay.
    ///
    /// # Errors
    /// The errors of [`Mesh::new`], if the moved mesh is not valid.
    pub fn mapped(mut self, map: impl Fn(&Point3<T>) -> Point3<T>) -> Result<Self> {
        self.nodes.iter_mut().for_each(|x| *x = map(x));
        // A map may invert elements or bring nodes together.
        let pairs = check::mesh(self.kind, &self.nodes, &self.connectivity)?;
        slit::checked(self, &pairs)
    }

    /// Element kind.
    pub fn kind(&self) -> ElementKind {
        self.kind
    }

    /// Node positions \[m\].
    pub fn nodes(&self) -> &[Point3<T>] {
        &self.nodes
    }

    /// Cross-section of bars \[m²\].
    pub fn section(&self) -> T {
        self.section
    }

    /// Number of elements.
    pub fn element_count(&self) -> usize {
        self.connectivity.len() / self.kind.corners()
    }

    /// Corners of all elements, one element after the other.
    pub fn connectivity(&self) -> &[u32] {
        &self.connectivity
    }

    /// Corners of element `e`.
    pub fn element(&self, e: usize) -> &[u32] {
        let n = self.kind.corners();
        &self.connectivity[e * n..(e + 1) * n]
    }

    /// Positions of the corners of element `e` \[m\]; unused entries are the origin.
    pub(crate) fn corners(&self, e: usize) -> [Point3<T>; 8] {
        let mut p = [Point3::origin(); 8];
        for (p, &k) in p.iter_mut().zip(self.element(e)) {
            *p = self.nodes[k as usize];
        }
        p
    }

    /// Mean edge length \[m\] over all edges of all elements.
    pub fn spacing(&self) -> T {
        let (mut sum, mut count) = (T::zero(), 0usize);
        for e in 0..self.element_count() {
            let p = self.corners(e);
            for [a, b] in self.kind.edges() {
                sum += (p[*b] - p[*a]).norm();
                count += 1;
            }
        }
        sum / T::of(count as f64)
    }

    /// Calls `visit` for each integration point of the stiffness of element `e`.
    pub fn for_each_gauss_point(&self, e: usize, visit: impl FnMut(&GaussPoint<T>)) {
        element::for_each_gauss(self.kind, &self.corners(e), self.section, visit);
    }

    /// Volume \[m³\]; for bars, length times section.
    pub fn volume(&self) -> T {
        (0..self.element_count())
            .flat_map(|e| element::nodal_volumes(self.kind, &self.corners(e), self.section))
            .sum()
    }

    /// Adds the integration cells of element `e`: a segment, a tetrahedron, or a hexahedron if all its faces
    /// are `planar`. Otherwise a hexahedron is cut into six tetrahedra, whose faces match those of its
    /// neighbours.
    pub(crate) fn cells_of(&self, e: usize, planar: bool, out: &mut Vec<Cell<T>>) {
        let p = self.corners(e);
        match self.kind {
            ElementKind::Bar2 => out.push(Cell::Segment {
                ends: [p[0], p[1]],
                section: self.section,
            }),
            ElementKind::Tet4 => out.push(Cell::Polyhedron(Polyhedron::tetrahedron([
                p[0], p[1], p[2], p[3],
            ]))),
            ElementKind::Hex8 if planar => out.push(Cell::Polyhedron(Polyhedron::hexahedron(p))),
            ElementKind::Hex8 => {
                // By number: neighbours cut their common face along the same diagonal.
                let tets = element::split_hexahedron(self.element(e), |k| k);
                out.extend(
                    tets.map(|t| {
                        Cell::Polyhedron(Polyhedron::tetrahedron(t.map(|k| self.nodes[k as usize])))
                    }),
                );
            }
        }
    }

    /// Cuts hexahedra into six tetrahedra each; the mesh stays conforming, and nodes and groups stay. The
    /// structured box becomes a Kuhn triangulation. A mesh of tetrahedra is returned unchanged.
    ///
    /// # Errors
    /// [`Error::Kind`] for bars; the errors of [`Mesh::new`] if a warped hexahedron has no valid cut.
    pub fn into_tetrahedra(self) -> Result<Self> {
        match self.kind {
            ElementKind::Tet4 => return Ok(self),
            ElementKind::Hex8 => {}
            ElementKind::Bar2 => {
                return Err(Error::Kind {
                    what: "tetrahedra",
                    kind: self.kind.name(),
                    remedy: "a mesh of hex8 elements",
                });
            }
        }
        let mut connectivity = Vec::with_capacity(self.element_count() * 24);
        // Ranked by place, the two lips of a slit are cut alike.
        let places = self.places()?;
        for e in 0..self.element_count() {
            let tets = element::split_hexahedron(self.element(e), |k| places[k as usize]);
            connectivity.extend(tets.as_flattened());
        }
        let mut mesh = Self::new(ElementKind::Tet4, self.nodes.clone(), connectivity)?;
        for (name, group) in &self.groups {
            let mut facets = Vec::with_capacity(2 * group.facets.len());
            for hex_facet in &group.facets {
                let quad = self.facet_nodes(*hex_facet);
                // Hexahedron e is cut into the tetrahedra 6 e to 6 e + 5.
                let first = 6 * hex_facet.element;
                let faces =
                    (first..first + 6).flat_map(|element| (0..4).map(move |face| Facet { element, face }));
                // Of the faces of six tetrahedra, those within the quadrilateral.
                facets.extend(faces.filter(|f| mesh.facet_nodes(*f).iter().all(|k| quad.contains(k))));
            }
            mesh.set_group(name, group.nodes.clone(), facets);
        }
        let sixfold = |r: &u32| std::iter::repeat_n(*r, 6);
        mesh.regions = self.regions.iter().flat_map(sixfold).collect();
        mesh.volumes = self.volumes;
        mesh.notices = self.notices;
        Ok(mesh)
    }

    /// Names of the volumes that the mesh file distinguishes, in the file's order: physical groups, or
    /// entities without one. Empty for meshes from other sources.
    pub fn volumes(&self) -> &[String] {
        &self.volumes
    }

    /// For every element, the number of its volume in [`Mesh::volumes`]; empty if the mesh does not
    /// distinguish volumes.
    pub fn regions(&self) -> &[u32] {
        &self.regions
    }

    /// Sets the names of volumes and, for every element, the number of its volume.
    pub(crate) fn set_volumes(&mut self, names: Vec<String>, regions: Vec<u32>) {
        self.volumes = names;
        self.regions = regions;
    }

    /// Messages on what was read differently from how the mesh file holds it.
    pub fn notices(&self) -> &[String] {
        &self.notices
    }

    pub(crate) fn set_notices(&mut self, notices: Vec<String>) {
        self.notices = notices;
    }

    /// Groups by name.
    pub fn groups(&self) -> &BTreeMap<String, Group> {
        &self.groups
    }

    /// Group with the given name.
    ///
    /// # Errors
    /// [`Error::UnknownGroup`] with the known names.
    pub fn group(&self, name: &str) -> Result<&Group> {
        self.groups.get(name).ok_or_else(|| Error::UnknownGroup {
            name: name.to_owned(),
            known: if self.groups.is_empty() {
                "none".to_owned()
            } else {
                self.groups.keys().cloned().collect::<Vec<_>>().join(", ")
            },
        })
    }

    /// Nodes of a group, ascending.
    ///
    /// # Errors
    /// [`Error::UnknownGroup`] with the known names.
    pub fn group_nodes(&self, name: &str) -> Result<Vec<usize>> {
        Ok(self.group(name)?.nodes.iter().map(|&k| k as usize).collect())
    }

    /// Nodes whose positions satisfy the condition, ascending.
    pub fn nodes_where(&self, condition: impl Fn(&Point3<T>) -> bool) -> Vec<usize> {
        (0..self.nodes.len())
            .filter(|&k| condition(&self.nodes[k]))
            .collect()
    }

    /// Facets that belong to exactly one element, ascending.
    pub fn boundary(&self) -> Vec<Facet> {
        let mut keyed: Vec<([u32; 4], Facet)> = Vec::new();
        for e in 0..self.element_count() {
            for face in 0..self.kind.faces().len() {
                let facet = Facet {
                    element: e as u32,
                    face: face as u8,
                };
                let mut key = [u32::MAX; 4];
                let corners = self.element(e);
                // Unused places hold the largest number, so that triangles and quadrilaterals can be
                // compared.
                for (k, local) in key.iter_mut().zip(self.kind.faces()[face]) {
                    *k = corners[*local];
                }
                key.sort_unstable();
                keyed.push((key, facet));
            }
        }
        // A face between two elements appears twice, with the same sorted nodes.
        keyed.sort_unstable();
        let same_face = |i: usize, j: usize| keyed.get(j).is_some_and(|k| k.0 == keyed[i].0);
        let mut out: Vec<Facet> = (0..keyed.len())
            .filter(|&i| !same_face(i, i + 1) && (i == 0 || !same_face(i, i - 1)))
            .map(|i| keyed[i].1)
            .collect();
        out.sort_unstable();
        out
    }

    /// Nodes of a facet in outward order.
    pub fn facet_nodes(&self, facet: Facet) -> Vec<u32> {
        let corners = self.element(facet.element as usize);
        self.kind.faces()[usize::from(facet.face)]
            .iter()
            .map(|&k| corners[k])
            .collect()
    }

    /// Facets of a group in the form that loads use: shares `∫ N_i dA` \[m²\] and outward unit normals.
    ///
    /// # Errors
    /// [`Error::UnknownGroup`], or [`Error::NotASurface`] if the group has no facets.
    pub fn surface(&self, name: &str) -> Result<Vec<SurfaceFacet<T>>> {
        let group = self.group(name)?;
        if group.facets.is_empty() {
            return Err(Error::NotASurface {
                name: name.to_owned(),
                nodes: group.nodes.len(),
            });
        }
        Ok(group.facets.iter().map(|&f| self.surface_facet(f)).collect())
    }

    /// Boundary facets whose centre satisfies the condition.
    pub fn surface_where(&self, condition: impl Fn(&Point3<T>) -> bool) -> Vec<SurfaceFacet<T>> {
        let facets = self.boundary().into_iter().map(|f| self.surface_facet(f));
        facets.filter(|f| condition(&f.centre)).collect()
    }

    /// Adds a group of the nodes that satisfy a condition.
    ///
    /// # Errors
    /// [`Error::EmptyGroup`] if there are none.
    pub fn with_nodes(mut self, name: &str, condition: impl Fn(&Point3<T>) -> bool) -> Result<Self> {
        let nodes: Vec<u32> = self
            .nodes_where(condition)
            .into_iter()
            .map(|k| k as u32)
            .collect();
        if nodes.is_empty() {
            return Err(empty(name, "node"));
        }
        let facets = Vec::new();
        self.groups.insert(name.to_owned(), Group { nodes, facets });
        Ok(self)
    }

    /// Adds a group of the boundary facets whose corners all satisfy a condition, with their nodes.
    ///
    /// # Errors
    /// [`Error::EmptyGroup`] if there are none.
    pub fn with_surface(self, name: &str, condition: impl Fn(&Point3<T>) -> bool) -> Result<Self> {
        self.with_surfaces(&[(name, &condition)])
    }

    /// Like [`Mesh::with_surface`] for several names at once: the boundary is determined only once.
    pub(crate) fn with_surfaces(mut self, named: &[(&str, &Condition<'_, T>)]) -> Result<Self> {
        let boundary = self.boundary();
        for (name, condition) in named {
            let good = |f: &Facet| {
                self.facet_nodes(*f)
                    .iter()
                    .all(|&k| condition(&self.nodes[k as usize]))
            };
            let facets: Vec<Facet> = boundary.iter().copied().filter(good).collect();
            if facets.is_empty() {
                return Err(empty(name, "boundary facet"));
            }
            self.set_group(name, Vec::new(), facets);
        }
        Ok(self)
    }

    /// Stores a group, with the nodes of its facets added to its nodes.
    pub(crate) fn set_group(&mut self, name: &str, mut nodes: Vec<u32>, mut facets: Vec<Facet>) {
        nodes.extend(facets.iter().flat_map(|f| self.facet_nodes(*f)));
        nodes.sort_unstable();
        nodes.dedup();
        facets.sort_unstable();
        facets.dedup();
        self.groups.insert(name.to_owned(), Group { nodes, facets });
    }

    /// Replaces nodes and elements by a renumbering; kind, section and groups stay.
    pub(crate) fn with_parts(mut self, nodes: Vec<Point3<T>>, connectivity: Vec<u32>) -> Self {
        self.nodes = nodes;
        self.connectivity = connectivity;
        self
    }

    /// Renumbers the nodes and facets of all groups.
    pub(crate) fn map_groups(&mut self, node: impl Fn(u32) -> u32, facet: impl Fn(Facet) -> Facet) {
        for group in self.groups.values_mut() {
            group.nodes.iter_mut().for_each(|k| *k = node(*k));
            group.facets.iter_mut().for_each(|f| *f = facet(*f));
            group.nodes.sort_unstable();
            group.facets.sort_unstable();
        }
    }

    fn surface_facet(&self, facet: Facet) -> SurfaceFacet<T> {
        let nodes: Vec<usize> = self.facet_nodes(facet).iter().map(|&k| k as usize).collect();
        let p: Vec<Point3<T>> = nodes.iter().map(|&k| self.nodes[k]).collect();
        let sum = p.iter().fold(Vector3::zeros(), |s, x| s + x.coords);
        let centre = Point3::from(sum / T::of(p.len() as f64));
        let (normal, shares) = match p.as_slice() {
            [a, b, c] => {
                // Area times outward normal of a flat triangle.
                let n = (b - a).cross(&(c - a)) * T::of(0.5);
                // A triangle gives each corner a third of its area.
                (n, vec![n.norm() / T::of(3.0); 3])
            }
            [a, b, c, d] => {
                // The product of the diagonals gives the mean normal, of warped facets as well.
                let n = (c - a).cross(&(d - b));
                (n, quadrilateral_shares([*a, *b, *c, *d]).to_vec())
            }
            _ => {
                let [a, b, ..] = self.corners(facet.element as usize);
                // The end of a bar faces away from its other end.
                let axis = if facet.face == 0 { a - b } else { b - a };
                (axis, vec![self.section])
            }
        };
        SurfaceFacet {
            nodes,
            shares,
            centre,
            normal: normal.normalize(),
        }
    }
}

fn empty(name: &str, what: &'static str) -> Error {
    Error::EmptyGroup {
        name: name.to_owned(),
        what,
    }
}

/// `∫ N_i dA` of a bilinear quadrilateral \[m²\], with 2 × 2 Gauss points.
fn quadrilateral_shares<T: Real>(p: [Point3<T>; 4]) -> [T; 4] {
    let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|c| c.map(T::of));
    let (quarter, gauss) = (T::of(0.25), T::of(1.0 / 3f64.sqrt()));
    let mut shares = [T::zero(); 4];
    for [s, t] in corners.map(|c| c.map(|x| x * gauss)) {
        let (mut du, mut dv) = (Vector3::zeros(), Vector3::zeros());
        for (x, [a, b]) in p.iter().zip(corners) {
            du += x.coords * (a * (T::one() + b * t) * quarter);
            dv += x.coords * (b * (T::one() + a * s) * quarter);
        }
        let area = du.cross(&dv).norm();
        for (share, [a, b]) in shares.iter_mut().zip(corners) {
            *share += area * (T::one() + a * s) * (T::one() + b * t) * quarter;
        }
    }
    shares
}
