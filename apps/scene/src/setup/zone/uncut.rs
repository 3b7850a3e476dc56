//! Notches of zones that also cross elements of the body: these have no notch and close it there.

use super::around;
use super::divide::{Owner, centroid};
use crate::error::Result;
use crate::setup::notch::{Knife, knives};
use crate::setup::{LoweredScene, OverlapSource};
use arlequin::core::geometry::bounds_of;
use arlequin::core::nalgebra::Vector3;
use arlequin::fem_ref::Mesh;
use std::path::Path;

/// Share of an element that counts as its inside: a notch may end at its faces.
const INSIDE: f64 = 1.0 - 1e-6;

/// Returns warnings about notches that reach beyond the elements of their zone.
///
/// # Errors
/// A body that cannot be meshed or divided; notches that cannot be read.
pub(in crate::setup) fn closed_notches(scene: &LoweredScene, folder: &Path) -> Result<Vec<String>> {
    let mut out = Vec::new();
    for table in scene.interface.values() {
        let OverlapSource::Zone(piece) = &table.overlap else {
            continue;
        };
        let zone = &piece.cut.zones[piece.number()];
        let notches = knives(&format!("zone.{}", zone.name), &zone.table.dem.notch, folder)?;
        if notches.is_empty() {
            continue;
        }
        let division = piece.cut.division(folder)?;
        let mesh = division.field.mesh();
        let alone = piece.elements_alone(folder)?;
        // What another zone has alone may have a notch of its own.
        let of_body = |e: &usize| !matches!(division.owners[*e], Owner::Zone(_));
        let (beside, _) = around::neighbours(mesh, &alone);
        for notch in &notches {
            let crossed = |e: &usize| crosses_inside(notch, mesh, *e);
            // A notch between two elements crosses neither: it counts for the first of them.
            let parted = |e: &usize| {
                let mut others = beside
                    .get(e)
                    .into_iter()
                    .flatten()
                    .filter(|n| *n > e && of_body(n));
                others.any(|n| passes_between(notch, mesh, [*e, *n]) && !crossed(n))
            };
            let mut elements = (0..mesh.element_count())
                .filter(of_body)
                .filter(|e| crossed(e) || parted(e));
            let Some(first) = elements.next() else {
                continue;
            };
            let [x, y, z]: [f64; 3] = centroid(mesh, first).coords.into();
            out.push(format!(
                "{} also crosses {} elements that zone '{}' does not have alone, one at ({x:.3e}, {y:.3e}, {z:.3e}) m: elements have \
                 no notch and close it there; enlarge the shape of the zone beyond the notch, or shorten the notch",
                notch.path(),
                1 + elements.count(),
                zone.name
            ));
        }
    }
    Ok(out)
}

/// Returns whether a notch lies between two corners of an element, inside of it.
fn crosses_inside(notch: &Knife, mesh: &Mesh<f64>, e: usize) -> bool {
    let centre = centroid(mesh, e).coords;
    let inside = |k: &u32| centre + (mesh.nodes()[*k as usize].coords - centre) * INSIDE;
    let corners: Vec<Vector3<f64>> = mesh.element(e).iter().map(inside).collect();
    let ends = bounds_of(mesh.element(e).iter().map(|k| &mesh.nodes()[*k as usize]));
    if notch.is_beside(&ends.map(|x| x.coords)) {
        return false;
    }
    (0..corners.len()).any(|i| corners[..i].iter().any(|x| notch.crosses(&corners[i], x)))
}

/// Returns whether a notch lies between the centres of two elements.
fn passes_between(notch: &Knife, mesh: &Mesh<f64>, pair: [usize; 2]) -> bool {
    let [a, b] = pair.map(|e| centroid(mesh, e).coords);
    notch.crosses(&a, &b)
}
