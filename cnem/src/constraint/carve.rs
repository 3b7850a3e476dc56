//! Recovery of faces without inserted points: the tetrahedra that a missing face cuts are replaced by others
//! that have the face.
//!
//! A constrained Delaunay complex contains the constrained faces, and the sphere of every tetrahedron is
//! empty of nodes that are visible from its inside. The constrained faces need not have empty spheres: nodes
//! close behind a face, as on the other flank of a notch, do not count. Where all edges of a flat region of
//! missing faces are in the complex, the tetrahedra that the region cuts form a cavity with two halves. Each
//! half is filled with tetrahedra of the Delaunay complex of its own nodes, if that complex has all faces of
//! the half. If not, the cavity grows by the tetrahedron behind each absent face. Faces that cannot be
//! recovered in this way are left to inserted points.

use super::FaceMesh;
use super::mesh::{ON_FACE, key};
use crate::delaunay::{Delaunay, face_key, volume};
use crate::predicates::orient3d;
use crate::tet::{INF, Tet};
use nalgebra::Point3;
use std::cmp::Ordering;
use std::collections::{BTreeMap, BTreeSet, HashSet};

/// Largest number of times that a cavity may grow.
const MAX_GROWTH: usize = 64;
/// Largest relative difference between the volumes of a cavity and of its new tetrahedra; larger differences
/// are no round-off.
const SAME_VOLUME: f64 = 1e-9;

/// A connected flat region of missing faces.
struct Region {
    triangles: Vec<[u32; 3]>,
    nodes: BTreeSet<u32>,
    /// A triangle of the region; its plane separates above from below.
    plane: [u32; 3],
}

/// Recovers every missing region it can. Returns the faces that are still missing.
pub(super) fn carve(delaunay: &mut Delaunay, mesh: &FaceMesh, missing: &[u32]) -> Vec<u32> {
    // Faces in the complex, which no cavity may swallow; a recovered face becomes one of them.
    let mut walls: HashSet<[u32; 3]> = mesh.faces.iter().map(|f| face_key(f.v)).collect();
    missing.iter().for_each(|&f| {
        walls.remove(&face_key(mesh.faces[f as usize].v));
    });
    let mut unrecovered = Vec::new();
    // Ordered sets: the regions, and with them the complex, do not depend on hashing.
    let mut todo: BTreeSet<u32> = missing.iter().copied().collect();
    let mut star = Vec::new();
    while let Some(first) = todo.pop_first() {
        // An earlier cavity may have recovered a face of this region by chance: such faces take no part.
        let faces = connected(delaunay, mesh, first, &mut todo);
        let present =
            |f: &&u32, star: &mut Vec<u32>| delaunay.face(mesh.faces[**f as usize].v, star).is_some();
        let faces: Vec<u32> = faces.iter().filter(|f| !present(f, &mut star)).copied().collect();
        if faces.is_empty() {
            continue;
        }
        let region = Region::new(mesh, &faces);
        // The complex changes only if both halves can be filled and fit: a failed attempt leaves no trace.
        match region.fill(delaunay, &walls) {
            Some((old, new)) if delaunay.replace(&old, &new) => {
                walls.extend(region.triangles.iter().map(|v| face_key(*v)));
            }
            _ => unrecovered.extend(faces),
        }
    }
    // A later cavity may have destroyed an earlier face if that was not yet a wall: check again.
    unrecovered.retain(|&f| delaunay.face(mesh.faces[f as usize].v, &mut star).is_none());
    unrecovered
}

/// Returns the missing faces that are connected to the first one over edges inside a flat patch, and removes
/// them from `todo`.
fn connected(delaunay: &Delaunay, mesh: &FaceMesh, first: u32, todo: &mut BTreeSet<u32>) -> Vec<u32> {
    let mut out = vec![first];
    let mut next = 0;
    while next < out.len() {
        let v = mesh.faces[out[next] as usize].v;
        next += 1;
        for k in 0..3 {
            let edge = key(v[k], v[(k + 1) % 3]);
            // Only flat pairs: one plane must separate the two halves of the cavity.
            let pair = mesh.flat_pair(&delaunay.points, edge);
            for f in pair.into_iter().flat_map(|[f, g, ..]| [f, g]) {
                if todo.remove(&f) {
                    out.push(f);
                }
            }
        }
    }
    out
}

/// One half of a cavity, bounded by faces as seen from outside.
struct Half {
    faces: Vec<[u32; 3]>,
    /// Tetrahedron behind each face; `None` for faces of the region.
    behind: Vec<Option<u32>>,
    nodes: BTreeSet<u32>,
}

impl Region {
    fn new(mesh: &FaceMesh, faces: &[u32]) -> Self {
        let triangles: Vec<[u32; 3]> = faces.iter().map(|&f| mesh.faces[f as usize].v).collect();
        Self {
            nodes: triangles.iter().flatten().copied().collect(),
            plane: triangles[0],
            triangles,
        }
    }

    /// Returns the cavity and the tetrahedra that fill it; `None` if it cannot be filled.
    fn fill(&self, delaunay: &Delaunay, walls: &HashSet<[u32; 3]>) -> Option<(Vec<u32>, Vec<[u32; 4]>)> {
        let mut cavity = self.cut(delaunay)?;
        // Growth has an end: a cavity that keeps growing would take in the whole complex.
        for _ in 0..MAX_GROWTH {
            let mut new = Vec::new();
            let mut grown = Vec::new();
            // A half that cannot be closed, or that would grow through a wall or out of the hull, ends the
            // attempt.
            for side in [Ordering::Greater, Ordering::Less] {
                let half = self.half(delaunay, &cavity, side)?;
                match half.tetrahedra(delaunay)? {
                    Filled::All(tets) => new.extend(tets),
                    Filled::Without(faces) => {
                        for f in faces {
                            // A face of the region itself has nothing behind it to grow by: the attempt
                            // fails.
                            let behind = half.behind[f]?;
                            let face = face_key(half.faces[f]);
                            if walls.contains(&face) || delaunay.tets[behind as usize].is_ghost() {
                                return None;
                            }
                            grown.push(behind);
                        }
                    }
                }
            }
            if grown.is_empty() {
                // The exact predicates decide the topology; the volumes tell whether old and new fill the
                // same space.
                let size = |v: &[u32; 4]| volume(v.map(|v| &delaunay.points[v as usize]));
                let old_volume: f64 = cavity.iter().map(|&t| size(&delaunay.tets[t as usize].v)).sum();
                let new_volume: f64 = new.iter().map(size).sum();
                return ((new_volume - old_volume).abs() <= SAME_VOLUME * old_volume)
                    .then(|| (cavity.into_iter().collect(), new));
            }
            cavity.extend(grown);
        }
        None
    }

    /// Returns whether a node is above or below the region; `Equal` for nodes of the region and nodes within
    /// round-off of its plane.
    fn place(&self, delaunay: &Delaunay, v: u32) -> Ordering {
        // Nodes of the region are on its plane by definition, also where round-off says otherwise.
        if self.nodes.contains(&v) {
            return Ordering::Equal;
        }
        let p = &delaunay.points[v as usize];
        let [a, b, c] = self.plane.map(|v| &delaunay.points[v as usize]);
        let n = (b - a).cross(&(c - a));
        // Nodes within round-off of the plane would otherwise be dealt out to the halves at random.
        if n.dot(&(p - a)).abs() <= ON_FACE * n.norm() * (p - a).norm() {
            return Ordering::Equal;
        }
        orient3d(a, b, c, p)
    }

    /// Returns the tetrahedra with an edge that passes through the region; `None` if there are none or if
    /// they reach the outside.
    fn cut(&self, delaunay: &Delaunay) -> Option<BTreeSet<u32>> {
        let (mut out, mut queue) = (BTreeSet::new(), Vec::new());
        let mut star = Vec::new();
        // Tetrahedra that the region cuts are reached from the stars of its nodes, over neighbours that are
        // cut too.
        for &v in &self.nodes {
            delaunay.star(v, &mut star);
            queue.extend(star.iter().copied());
        }
        let mut visited: BTreeSet<u32> = queue.iter().copied().collect();
        while let Some(t) = queue.pop() {
            let tet = &delaunay.tets[t as usize];
            let mut is_cut = false;
            for i in 0..4 {
                for j in 0..i {
                    is_cut |= self.pierced(delaunay, tet.v[i], tet.v[j]);
                }
            }
            if !is_cut {
                continue;
            }
            // An edge of the hull pierces the region: no cavity can fill what lies outside.
            if tet.is_ghost() {
                return None;
            }
            out.insert(t);
            queue.extend(tet.n.iter().map(|n| n >> 2).filter(|n| visited.insert(*n)));
        }
        (!out.is_empty()).then_some(out)
    }

    /// Returns whether an edge passes through a triangle of the region or through an edge between two of
    /// them.
    fn pierced(&self, delaunay: &Delaunay, p: u32, q: u32) -> bool {
        if p == INF || q == INF || self.nodes.contains(&p) || self.nodes.contains(&q) {
            return false;
        }
        let point = |v: u32| &delaunay.points[v as usize];
        let [p, q] = [p, q].map(point);
        self.triangles.iter().any(|t| {
            let [a, b, c] = t.map(point);
            let sides = [orient3d(a, b, c, p), orient3d(a, b, c, q)];
            // Edges with an end in the plane touch the region but do not cross it.
            if sides.contains(&Ordering::Equal) || sides[0] == sides[1] {
                return false;
            }
            let turns = [orient3d(p, q, a, b), orient3d(p, q, b, c), orient3d(p, q, c, a)];
            // Not strict: an edge that passes exactly through an edge between two triangles counts as well.
            !(turns.contains(&Ordering::Greater) && turns.contains(&Ordering::Less))
        })
    }

    /// Returns the half of a cavity on one side of the region; `None` if a face of the cavity crosses the
    /// plane or the border is not closed.
    fn half(&self, delaunay: &Delaunay, cavity: &BTreeSet<u32>, side: Ordering) -> Option<Half> {
        let mut out = Half {
            faces: Vec::new(),
            behind: Vec::new(),
            nodes: self.nodes.clone(),
        };
        for &t in cavity {
            let tet = &delaunay.tets[t as usize];
            // Also nodes that growth has moved from the border into the cavity.
            let on_side = tet.v.into_iter().filter(|&v| self.place(delaunay, v) == side);
            out.nodes.extend(on_side);
            for (slot, &n) in tet.n.iter().enumerate() {
                if cavity.contains(&(n >> 2)) {
                    continue;
                }
                let face = tet.face(slot);
                let places = face.map(|v| self.place(delaunay, v));
                let apex = self.place(delaunay, tet.v[slot]);
                let (up, down) = (places.contains(&side), places.contains(&side.reverse()));
                // A face on both sides of the plane belongs to neither half.
                if up && down {
                    return None;
                }
                // A face in the plane belongs to the half that its tetrahedron lies in.
                if up || (!down && apex == side) {
                    out.faces.push(face);
                    out.behind.push(Some(n >> 2));
                    out.nodes.extend(face);
                }
            }
        }
        for v in &self.triangles {
            let turned = seen_from_outside(delaunay, v, &out, self, side)?;
            out.faces.push(turned);
            out.behind.push(None);
        }
        out.is_closed().then_some(out)
    }
}

/// Orders a triangle of the region as seen from outside the half on one side of it.
fn seen_from_outside(
    delaunay: &Delaunay,
    v: &[u32; 3],
    half: &Half,
    region: &Region,
    side: Ordering,
) -> Option<[u32; 3]> {
    let apex = half
        .nodes
        .iter()
        .find(|&&n| !region.nodes.contains(&n) && region.place(delaunay, n) == side)?;
    let [a, b, c] = v.map(|v| &delaunay.points[v as usize]);
    match orient3d(a, b, c, &delaunay.points[*apex as usize]) {
        Ordering::Greater => Some([v[0], v[2], v[1]]),
        Ordering::Less => Some(*v),
        Ordering::Equal => None,
    }
}

/// Result of filling a half with tetrahedra of its own Delaunay complex.
enum Filled {
    /// The complex has all faces of the half: the tetrahedra inside.
    All(Vec<[u32; 4]>),
    /// Indices of the faces that the complex does not have.
    Without(Vec<usize>),
}

impl Half {
    // Closed: every edge is run through as often in one direction as in the other.
    fn is_closed(&self) -> bool {
        let mut edges: BTreeMap<(u32, u32), i32> = BTreeMap::new();
        for f in &self.faces {
            for k in 0..3 {
                let (a, b) = (f[k], f[(k + 1) % 3]);
                *edges.entry(key(a, b)).or_insert(0) += if a < b { 1 } else { -1 };
            }
        }
        edges.values().all(|n| *n == 0)
    }

    /// Builds the Delaunay complex of the half's nodes and returns its tetrahedra inside the half.
    fn tetrahedra(&self, delaunay: &Delaunay) -> Option<Filled> {
        // The nodes keep their order, so that ties are broken as in the large complex.
        let nodes: Vec<u32> = self.nodes.iter().copied().collect();
        let points: Vec<Point3<f64>> = nodes.iter().map(|&v| delaunay.points[v as usize]).collect();
        let complex = Delaunay::new(&points).ok()?;
        let local = |v: u32| nodes.binary_search(&v).map(|k| k as u32).ok();
        let mut star = Vec::new();
        let (mut border, mut missing, mut queue) = (HashSet::new(), Vec::new(), Vec::new());
        // Start the flood on the inner side of each face: the complex of the nodes is convex, the half need
        // not be.
        for (k, f) in self.faces.iter().enumerate() {
            let v = [local(f[0])?, local(f[1])?, local(f[2])?];
            match complex.face(v, &mut star) {
                Some((tet, slot)) => {
                    border.insert(face_key(v));
                    let same_orientation = same_turn(complex.tets[tet as usize].face(slot), v);
                    queue.push(if same_orientation {
                        tet
                    } else {
                        complex.tets[tet as usize].n[slot] >> 2
                    });
                }
                None => missing.push(k),
            }
        }
        if !missing.is_empty() {
            return Some(Filled::Without(missing));
        }
        let mut inside: BTreeSet<u32> = queue.iter().copied().collect();
        while let Some(t) = queue.pop() {
            let tet: &Tet = &complex.tets[t as usize];
            // The flood reached the outside: the faces of the half do not enclose it in this complex.
            if tet.is_ghost() {
                return None;
            }
            for (slot, &n) in tet.n.iter().enumerate() {
                if !border.contains(&face_key(tet.face(slot))) && inside.insert(n >> 2) {
                    queue.push(n >> 2);
                }
            }
        }
        let global = |t: &u32| complex.tets[*t as usize].v.map(|v| nodes[v as usize]);
        Some(Filled::All(inside.iter().map(global).collect()))
    }
}

/// Returns whether two orderings of the same three vertices have the same orientation.
fn same_turn(a: [u32; 3], b: [u32; 3]) -> bool {
    (0..3).any(|k| (0..3).all(|i| a[i] == b[(i + k) % 3]))
}
