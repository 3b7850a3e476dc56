//! Elements of the body around a zone, in which spheres are packed and then cut off at the border of the
//! zone.

use super::divide::{Division, Owner, crowded_edges, faces_of};
use super::faces::{Faces, corners_of};
use crate::error::{Result, fem};
use arlequin::core::nalgebra::Point3;
use arlequin::fem_ref::{Facet, Mesh};
use std::collections::{BTreeMap, BTreeSet};

/// Reach of these elements over that of the spheres: their outer faces must not act as walls.
const REACH: f64 = 1.5;

/// Returns the elements of a zone together with those around it, far enough for spheres up to `margin` \[m\]
/// beyond the border; and the faces between both.
pub(super) fn around(division: &Division, zone: usize, margin: f64) -> Result<(Mesh<f64>, Triangles)> {
    let mesh = division.field.mesh();
    let mine: Vec<bool> = division
        .of
        .iter()
        .map(|o| matches!(o, Owner::Zone(z) | Owner::Both(z) if *z == zone))
        .collect();
    let mut kept = mine.clone();
    let (beside, border) = neighbours(mesh, &mine);
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
        let mut open: Vec<usize> = (0..mine.len()).filter(|e| mine[*e]).collect();
        let mut seen = mine.clone();
        while let Some(e) = open.pop() {
            for &n in beside.get(&e).into_iter().flatten() {
                if !std::mem::replace(&mut seen[n], true) && near(n) {
                    kept[n] = true;
                    open.push(n);
                }
            }
        }
    }
    // A closed surface has two faces at every edge.
    loop {
        let crowded = crowded_edges(mesh, |e| kept[e]);
        let meets = |e: usize| {
            let corners = mesh.element(e);
            crowded
                .iter()
                .any(|edge| edge.iter().all(|k| corners.contains(k)))
        };
        let off: Vec<usize> = (0..mine.len())
            .filter(|&e| kept[e] && !mine[e] && meets(e))
            .collect();
        if off.is_empty() {
            return Ok((mesh.part(|e| kept[e]).map_err(fem("body"))?, border));
        }
        off.into_iter().for_each(|e| kept[e] = false);
    }
}

/// Corners of triangles \[m\].
pub(super) type Triangles = Vec<[Point3<f64>; 3]>;
type Beside = BTreeMap<usize, BTreeSet<usize>>;

/// Pairs of elements that share a face, and the triangles between the elements marked in `mine` and the
/// others.
fn neighbours(mesh: &Mesh<f64>, mine: &[bool]) -> (Beside, Triangles) {
    let mut open: BTreeMap<[u32; 4], Facet> = BTreeMap::new();
    let (mut beside, mut border) = (Beside::new(), Vec::new());
    for (facet, key) in faces_of(mesh, |_| true) {
        let Some(other) = open.insert(key, facet) else {
            continue;
        };
        let pair = [facet, other].map(|f| f.element as usize);
        for (a, b) in [(pair[0], pair[1]), (pair[1], pair[0])] {
            beside.entry(a).or_default().insert(b);
        }
        if mine[pair[0]] != mine[pair[1]] {
            // Taken from the zone's element, so that the triangles face outwards.
            border.extend(corners_of(mesh, &[if mine[pair[0]] { facet } else { other }]));
        }
    }
    (beside, border)
}
