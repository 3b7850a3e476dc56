//! The cavity of a point: the tetrahedra in reach whose circumsphere holds the point, and their common
//! border.

use crate::circumcentre::{accurate, quick};
use crate::domain::Domain;
use crate::predicates::insphere;
use crate::tet::{EdgeTable, FACES};
use nalgebra::{Point3, Vector3};
use std::cmp::Ordering;

/// Relative width of the shell around a cached circumsphere inside which the exact predicate decides.
const SHELL: f64 = 1e-10;
/// Depth of a node in a sphere, relative to the sizes of both, that counts as round-off.
const EMPTY: f64 = 1e-10;

/// A tetrahedron of the cavity.
#[derive(Debug, Clone, Copy)]
pub(super) struct Member {
    tet: u32,
    local: [u32; 4],
    /// Circumcentre relative to the point \[m\].
    pub(super) centre: Vector3<f64>,
}

/// Face of the cavity's border, counter-clockwise from outside, with the sphere through the face and the
/// point.
#[derive(Debug, Clone, Copy)]
pub(super) struct Border {
    pub(super) local: [u32; 3],
    pub(super) member: u32,
    /// Centre of the sphere, relative to the point \[m\].
    pub(super) centre: Vector3<f64>,
    /// Six times the volume of the tetrahedron of face and point.
    pub(super) det: f64,
    pub(super) wall: bool,
}

/// Face between two members, counter-clockwise from the second.
#[derive(Debug, Clone, Copy)]
pub(super) struct Inner {
    pub(super) local: [u32; 3],
    pub(super) members: [u32; 2],
}

/// Edge of the border, directed as in its first face, and its two faces.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ridge {
    pub(super) ends: [u32; 2],
    pub(super) faces: [u32; 2],
}

/// Working buffers of the cavity.
#[derive(Debug, Clone, Default)]
pub(super) struct Cavity {
    mark: Vec<u32>,
    stamp: u32,
    /// Index of the member for each marked tetrahedron.
    index: Vec<u32>,
    table: EdgeTable,
    pub(super) members: Vec<Member>,
    pub(super) border: Vec<Border>,
    pub(super) inner: Vec<Inner>,
    pub(super) ridges: Vec<Ridge>,
    /// Nodes of the cavity, by local number.
    pub(super) nodes: Vec<u32>,
    /// Positions of these nodes relative to the point \[m\].
    pub(super) rel: Vec<Vector3<f64>>,
}

impl Cavity {
    /// Grows the buffers to the size of a domain.
    pub(super) fn fit(&mut self, domain: &Domain) {
        let tets = domain.delaunay.tets.len();
        if self.mark.len() < tets {
            self.mark.resize(tets, 0);
            self.index.resize(tets, 0);
        }
        self.table.reserve(domain.nodes().len());
    }

    /// Finds the cavity of `x`, which lies in the tetrahedron `start`. Returns whether the star of `x` in the
    /// cavity is the star of `x` in the Delaunay complex of the cavity's nodes.
    pub(super) fn find(&mut self, domain: &Domain, x: &Point3<f64>, start: u32) -> bool {
        self.reach(domain, x, start);
        // Beside walls the reach may go round an edge, which only the spheres show; elsewhere the star
        // suffices.
        self.build_border(domain, x) && (!self.border.iter().any(|b| b.wall) || self.is_delaunay())
    }

    /// Returns the constrained faces on the border, by their vertices.
    pub(super) fn walls(&self) -> impl Iterator<Item = [u32; 3]> + '_ {
        let walls = self.border.iter().filter(|b| b.wall);
        walls.map(|b| b.local.map(|l| self.nodes[l as usize]))
    }

    /// Returns whether the sphere over every border face holds no node of the adjacent border faces.
    fn is_delaunay(&self) -> bool {
        // Then the facets of the point's cell are convex where they meet, and the cell is the one that its
        // neighbours bound.
        self.ridges.iter().all(|ridge| {
            let [f, g] = ridge.faces.map(|f| &self.border[f as usize]);
            let apex = g.local.iter().find(|l| !ridge.ends.contains(l));
            apex.is_none_or(|&l| {
                let (v, c) = (&self.rel[l as usize], &f.centre);
                let size = v.norm();
                // `|v|² − 2 c·v` is the power of the node with respect to the sphere through the origin about
                // `c`.
                size * size - 2.0 * c.dot(v) >= -EMPTY * (size + c.norm()) * size
            })
        })
    }

    fn next_stamp(&mut self) -> u32 {
        if self.stamp >= (u32::MAX >> 1) - 1 {
            self.mark.fill(0);
            self.stamp = 0;
        }
        self.stamp += 1;
        self.stamp
    }

    fn add_member(&mut self, domain: &Domain, x: &Point3<f64>, tet: u32) {
        let t = &domain.delaunay.tets[tet as usize];
        let local = t.v.map(|v| {
            let local = self.table.local(v);
            if local as usize == self.nodes.len() {
                self.nodes.push(v);
                self.rel.push(domain.delaunay.points[v as usize] - x);
            }
            local
        });
        // Centres are relative to a vertex, so that no difference of large coordinates is taken here.
        let centre = self.rel[local[0] as usize] + domain.centre[tet as usize];
        self.index[tet as usize] = self.members.len() as u32;
        self.members.push(Member { tet, local, centre });
    }

    /// Collects the tetrahedra in reach of `x`.
    fn reach(&mut self, domain: &Domain, x: &Point3<f64>, start: u32) {
        let stamp = self.next_stamp();
        // Marks of earlier points are smaller than `out`: they need not be cleared.
        let (out, inside) = (2 * stamp, 2 * stamp + 1);
        self.table.reset(true);
        self.members.clear();
        self.border.clear();
        self.inner.clear();
        self.nodes.clear();
        self.rel.clear();
        self.mark[start as usize] = inside;
        self.add_member(domain, x, start);
        let mut next = 0;
        while next < self.members.len() {
            let Member { tet, local, .. } = self.members[next];
            // A wall stops the reach before any sphere is asked: what lies behind it is not visible.
            let t = &domain.delaunay.tets[tet as usize];
            let walls = domain.walls[tet as usize];
            for (slot, &n) in t.n.iter().enumerate() {
                let neighbour = n >> 2;
                let mut mark = self.mark[neighbour as usize];
                let wall = walls >> slot & 1 == 1;
                // Each neighbour is tested once, however many members it touches.
                if !wall && mark < out {
                    let holds = holds(domain, neighbour, x);
                    mark = if holds { inside } else { out };
                    self.mark[neighbour as usize] = mark;
                    if holds {
                        self.add_member(domain, x, neighbour);
                    }
                }
                let face = FACES[slot].map(|k| local[k]);
                if wall || mark == out {
                    let member = next as u32;
                    self.border.push(Border {
                        local: face,
                        member,
                        wall,
                        centre: Vector3::zeros(),
                        det: 0.0,
                    });
                } else if tet < neighbour {
                    // A face between two members is met from both sides: the smaller number records it.
                    let members = [next as u32, self.index[neighbour as usize]];
                    self.inner.push(Inner { local: face, members });
                }
            }
            next += 1;
        }
    }

    /// Computes spheres and ridges of the border. Returns false if a face turns away from `x`.
    fn build_border(&mut self, domain: &Domain, x: &Point3<f64>) -> bool {
        let mut star = true;
        self.ridges.clear();
        for i in 0..self.border.len() {
            let Border { local, .. } = self.border[i];
            let [a, b, c] = local.map(|l| &self.rel[l as usize]);
            let (centre, det) = quick(a, b, c).unwrap_or_else(|| {
                let [a, b, c] = local.map(|l| &domain.delaunay.points[self.nodes[l as usize] as usize]);
                accurate([x, a, b, c])
            });
            // A face seen edge-on or from behind: the point does not see the whole border, so this is no
            // star.
            if det.is_nan() || det <= 0.0 {
                star = false;
            }
            let entry = &mut self.border[i];
            entry.centre = centre;
            entry.det = det;
            for k in 0..3 {
                let (p, q) = (local[k], local[(k + 1) % 3]);
                // The second face at an edge completes the ridge; the table keeps one entry per edge until
                // then.
                if let Some(other) = self.table.pair(p, q, i as u32) {
                    self.ridges.push(Ridge {
                        ends: [p, q],
                        faces: [i as u32, other],
                    });
                }
            }
        }
        star
    }
}

/// Returns whether the circumsphere of a tetrahedron strictly holds `x`.
#[inline]
fn holds(domain: &Domain, tet: u32, x: &Point3<f64>) -> bool {
    let t = &domain.delaunay.tets[tet as usize];
    let offset = &domain.centre[tet as usize];
    let centre = (domain.delaunay.points[t.v[0] as usize] - x) + offset;
    let radius = offset.norm_squared();
    let gap = radius - centre.norm_squared();
    let margin = SHELL * radius;
    // The cached sphere decides nearly always. Inside the shell its round-off could decide either way.
    if gap > margin {
        return true;
    }
    if gap < -margin {
        return false;
    }
    // Strict: for a point on the sphere, the cavity with and without this tetrahedron gives the same cell.
    insphere(domain.delaunay.corners(t), x) == Ordering::Greater
}
