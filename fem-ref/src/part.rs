//! Meshes derived from a mesh: a part of its elements, or a refinement.

use crate::element::ElementKind;
use crate::error::{Error, Result};
use crate::mesh::{Facet, Mesh};
use arlequin_core::Real;
use nalgebra::{Point3, Vector3};
use std::collections::HashMap;

/// Nodes whose mean position a new node has, ascending; unused entries hold the largest number.
type Parents = [u32; 8];

/// Corners of the unit cube in the node order of hexahedra. Sums of two corners are places on the lattice of
/// half edges.
const CORNERS: [[usize; 3]; 8] = [
    [0, 0, 0],
    [1, 0, 0],
    [1, 1, 0],
    [0, 1, 0],
    [0, 0, 1],
    [1, 0, 1],
    [1, 1, 1],
    [0, 1, 1],
];

impl<T: Real> Mesh<T> {
    /// Restricts the mesh to the elements for which `keep` is true, with their nodes, in the same order.
    /// Groups and volumes are restricted as well; groups without nodes are dropped.
    ///
    /// ```
    /// use arlequin_core::nalgebra::Point3;
    /// use fem_ref::{ElementKind, generate};
    /// let high = Point3::new(4.0, 1.0, 1.0);
    /// let bar = generate::block(ElementKind::Hex8, Point3::origin(), high, [4, 1, 1])?;
    /// let half = bar.part(|e| e < 2)?;
    /// assert_eq!((half.element_count(), half.nodes().len()), (2, 12));
    /// assert!(half.groups().contains_key("x-min") && !half.groups().contains_key("x-max"));
    /// # Ok::<(), fem_ref::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::EmptyMesh`] if no element is kept.
    pub fn part(&self, keep: impl Fn(usize) -> bool) -> Result<Self> {
        let kept_elements: Vec<usize> = (0..self.element_count()).filter(|&e| keep(e)).collect();
        let mut used = vec![false; self.nodes().len()];
        for &k in kept_elements.iter().flat_map(|&e| self.element(e)) {
            used[k as usize] = true;
        }
        let mut place = vec![u32::MAX; used.len()];
        let mut nodes = Vec::new();
        for (k, _) in used.iter().enumerate().filter(|(_, used)| **used) {
            place[k] = nodes.len() as u32;
            nodes.push(self.nodes()[k]);
        }
        let corners = kept_elements.iter().flat_map(|&e| self.element(e));
        let connectivity = corners.map(|&k| place[k as usize]).collect();
        let mut out = Self::new(self.kind(), nodes, connectivity)?.with_section(self.section())?;
        let mut number = vec![u32::MAX; self.element_count()];
        for (new, &old) in kept_elements.iter().enumerate() {
            number[old] = new as u32;
        }
        for (name, group) in self.groups() {
            let nodes = group.nodes.iter().map(|&k| place[k as usize]);
            let nodes: Vec<u32> = nodes.filter(|&k| k != u32::MAX).collect();
            let facets = group.facets.iter().map(|f| Facet {
                element: number[f.element as usize],
                face: f.face,
            });
            let facets = facets.filter(|f| f.element != u32::MAX).collect();
            if !nodes.is_empty() {
                out.set_group(name, nodes, facets);
            }
        }
        let regions = kept_elements
            .iter()
            .filter_map(|&e| self.regions().get(e).copied());
        let (names, regions) = (self.volumes().to_vec(), regions.collect());
        out.set_volumes(names, regions);
        out.set_notices(self.notices().to_vec());
        Ok(out)
    }

    /// Divides every element into eight, with new nodes in the middle of edges, faces and hexahedra. Groups
    /// and volumes are refined as well. The shape stays: polygons do not become rounder.
    ///
    /// ```
    /// use arlequin_core::nalgebra::Point3;
    /// use fem_ref::{ElementKind, generate};
    /// let high = Point3::new(1.0, 1.0, 1.0);
    /// let cube = generate::block(ElementKind::Tet4, Point3::origin(), high, [2, 2, 2])?;
    /// let fine = cube.refined()?;
    /// assert_eq!(fine.element_count(), 8 * cube.element_count());
    /// assert!((fine.volume() - 1.0f64).abs() < 1e-12);
    /// assert_eq!(fine.surface("x-max")?.len(), 4 * cube.surface("x-max")?.len());
    /// # Ok::<(), fem_ref::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Kind`] for bars; the errors of [`Mesh::new`] if parts of warped hexahedra are inverted.
    pub fn refined(&self) -> Result<Self> {
        let mut halves = Halves::new(self);
        let mut connectivity = Vec::with_capacity(8 * self.connectivity().len());
        for e in 0..self.element_count() {
            match self.kind() {
                ElementKind::Tet4 => halves.tetrahedron(self.element(e), &mut connectivity),
                ElementKind::Hex8 => halves.hexahedron(self.element(e), &mut connectivity),
                ElementKind::Bar2 => {
                    return Err(Error::Kind {
                        what: "a refined mesh",
                        kind: self.kind().name(),
                        remedy: "tet4 or hex8",
                    });
                }
            }
        }
        let Halves { nodes, parents, .. } = halves;
        let mut out = Self::new(self.kind(), nodes, connectivity)?;
        let within = |k: u32, allowed: &[u32]| {
            let mut of_node = parents[k as usize].iter().take_while(|p| **p != u32::MAX);
            of_node.all(|p| allowed.binary_search(p).is_ok())
        };
        for (name, group) in self.groups() {
            // New nodes of a surface come from its facets only: an edge between two of its nodes may lead
            // through the body.
            let new = if group.facets.is_empty() {
                parents.len()
            } else {
                self.nodes().len()
            };
            let nodes = (0..new as u32).filter(|&k| within(k, &group.nodes));
            let mut facets = Vec::with_capacity(4 * group.facets.len());
            for f in &group.facets {
                let mut corners = self.facet_nodes(*f);
                corners.sort_unstable();
                let parts = 8 * f.element..8 * f.element + 8;
                let faces = 0..self.kind().faces().len() as u8;
                let candidates =
                    parts.flat_map(|element| faces.clone().map(move |face| Facet { element, face }));
                facets
                    .extend(candidates.filter(|f| out.facet_nodes(*f).iter().all(|&k| within(k, &corners))));
            }
            out.set_group(name, nodes.collect(), facets);
        }
        let eightfold = |r: &u32| std::iter::repeat_n(*r, 8);
        let regions = self.regions().iter().flat_map(eightfold).collect();
        out.set_volumes(self.volumes().to_vec(), regions);
        out.set_notices(self.notices().to_vec());
        Ok(out)
    }
}

/// Nodes of a mesh and the new nodes between them.
struct Halves<T: Real> {
    nodes: Vec<Point3<T>>,
    parents: Vec<Parents>,
    known: HashMap<Parents, u32>,
}

impl<T: Real> Halves<T> {
    fn new(mesh: &Mesh<T>) -> Self {
        let single_parent = |k: u32| {
            let mut parents = [u32::MAX; 8];
            parents[0] = k;
            parents
        };
        Self {
            nodes: mesh.nodes().to_vec(),
            parents: (0..mesh.nodes().len() as u32).map(single_parent).collect(),
            known: HashMap::new(),
        }
    }

    /// Returns the node in the middle of the given ones, new or known; a single node is its own middle.
    fn middle(&mut self, nodes: &[u32]) -> u32 {
        if let [node] = nodes {
            return *node;
        }
        let mut key = [u32::MAX; 8];
        key[..nodes.len()].copy_from_slice(nodes);
        key.sort_unstable();
        if let Some(&k) = self.known.get(&key) {
            return k;
        }
        // Summed in ascending order, so that all neighbours get the same bits.
        let sum = key[..nodes.len()]
            .iter()
            .fold(Vector3::zeros(), |s, &k| s + self.nodes[k as usize].coords);
        let k = self.nodes.len() as u32;
        self.nodes.push(Point3::from(sum / T::of(nodes.len() as f64)));
        self.parents.push(key);
        self.known.insert(key, k);
        k
    }

    /// Cuts off the four corners and divides the octahedron between them around its shortest diagonal.
    fn tetrahedron(&mut self, v: &[u32], out: &mut Vec<u32>) {
        let mut m = |i: usize, j: usize| self.middle(&[v[i], v[j]]);
        let [a, b, c, d, e, f] = [m(0, 1), m(0, 2), m(0, 3), m(1, 2), m(1, 3), m(2, 3)];
        for t in [[v[0], a, b, c], [a, v[1], d, e], [b, d, v[2], f], [c, e, f, v[3]]] {
            out.extend(t);
        }
        // The shortest diagonal distorts the parts least; ties go to the first.
        let length = |[i, j]: [u32; 2]| (self.nodes[i as usize] - self.nodes[j as usize]).norm_squared();
        let axes = [
            ([a, f], [b, c, e, d]),
            ([b, e], [a, d, f, c]),
            ([c, d], [a, b, f, e]),
        ];
        let mut shortest = axes[0];
        for axis in &axes[1..] {
            if length(axis.0) < length(shortest.0) {
                shortest = *axis;
            }
        }
        let ([top, bottom], ring) = shortest;
        for k in 0..4 {
            let t = [top, bottom, ring[k], ring[(k + 1) % 4]];
            let p = t.map(|k| self.nodes[k as usize]);
            let volume = (p[1] - p[0]).cross(&(p[2] - p[0])).dot(&(p[3] - p[0]));
            // The sense of the ring depends on the diagonal.
            let turned = [t[0], t[1], t[3], t[2]];
            out.extend(if volume > T::zero() { t } else { turned });
        }
    }

    /// Divides a hexahedron into eight on the lattice of half edges.
    fn hexahedron(&mut self, v: &[u32], out: &mut Vec<u32>) {
        let lattice_node = |halves: &mut Self, place: [usize; 3]| {
            // A place on the lattice of half edges: between the corners that agree with it in every even
            // direction.
            let near = |corner: &[usize; 3]| (0..3).all(|c| place[c] == 1 || place[c] == 2 * corner[c]);
            let mut nodes = [0; 8];
            let mut n = 0;
            for (k, _) in CORNERS.iter().enumerate().filter(|(_, corner)| near(corner)) {
                nodes[n] = v[k];
                n += 1;
            }
            halves.middle(&nodes[..n])
        };
        for first in CORNERS {
            for corner in CORNERS {
                let place = [0, 1, 2].map(|c| first[c] + corner[c]);
                out.push(lattice_node(self, place));
            }
        }
    }
}
