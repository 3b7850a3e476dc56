//! Elements of the body around a zone, in which spheres are packed and then cut off at the border of the
//! zone.

use super::divide::{faces_of, part_at_edges};
use crate::error::{Result, fem};
use crate::setup::faces::{Faces, corners_of};
use arlequin::core::nalgebra::Point3;
use arlequin::fem_ref::{Facet, Mesh};
use std::collections::{BTreeMap, BTreeSet};

/// Reach of these elements over that of the spheres: their outer faces must not act as walls.
const REACH: f64 = 1.5;

/// Returns the elements of a zone together with those around it, far enough for spheres up to `margin` \[m\]
/// beyond the border; and the faces between both.
pub(super) fn extended_zone(
    mesh: &Mesh<f64>,
    in_zone: &[bool],
    margin: f64,
) -> Result<(Mesh<f64>, Triangles)> {
    let mut keep = in_zone.to_vec();
    let (neighbours_of, border) = neighbours(mesh, in_zone);
    let faces = Faces::new(border.clone());
    if !faces.is_empty() {
        let near = |e: usize| {
            let corners = || mesh.element(e).iter().map(|&k| mesh.nodes()[k as usize]);
            let longest = corners()
                .flat_map(|a| corners().map(move |b| (a - b).norm()))
                .fold(0.0, f64::max);
            // An element may reach closer to the border than its corners, by at most its longest edge.
            corners().any(|x| faces.distance(&x) < REACH * margin + longest)
        };
        // Only elements connected to the zone: another part of the body may come close to it across a gap.
        let mut open: Vec<usize> = (0..in_zone.len()).filter(|e| in_zone[*e]).collect();
        let mut visited = in_zone.to_vec();
        while let Some(e) = open.pop() {
            for &n in neighbours_of.get(&e).into_iter().flatten() {
                if !std::mem::replace(&mut visited[n], true) && near(n) {
                    keep[n] = true;
                    open.push(n);
                }
            }
        }
    }
    while part_at_edges(mesh, &mut keep, |e| !in_zone[e]) {}
    Ok((mesh.part(|e| keep[e]).map_err(fem("body"))?, border))
}

/// Corners of triangles \[m\].
pub(super) type Triangles = Vec<[Point3<f64>; 3]>;
type Beside = BTreeMap<usize, BTreeSet<usize>>;

/// Pairs of elements that share a face, and the triangles between the elements marked in `in_zone` and the
/// others.
pub(super) fn neighbours(mesh: &Mesh<f64>, in_zone: &[bool]) -> (Beside, Triangles) {
    let mut open: BTreeMap<[u32; 4], Facet> = BTreeMap::new();
    let (mut neighbours_of, mut border) = (Beside::new(), Vec::new());
    for (facet, key) in faces_of(mesh, |_| true) {
        let Some(other_facet) = open.insert(key, facet) else {
            continue;
        };
        let pair = [facet, other_facet].map(|f| f.element as usize);
        for (a, b) in [(pair[0], pair[1]), (pair[1], pair[0])] {
            neighbours_of.entry(a).or_default().insert(b);
        }
        if in_zone[pair[0]] != in_zone[pair[1]] {
            // Taken from the zone's element, so that the triangles face outwards.
            border.extend(corners_of(
                mesh,
                &[if in_zone[pair[0]] { facet } else { other_facet }],
            ));
        }
    }
    (neighbours_of, border)
}
