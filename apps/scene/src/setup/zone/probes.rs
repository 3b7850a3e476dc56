//! Probes of the body that lie in a zone: they read the zone's model.

use super::divide::{Division, Owner};
use super::{Piece, select};
use crate::error::{Result, fem};
use crate::setup::lower::following;
use crate::setup::names::BODY;
use crate::setup::{BodyShape, LoweredScene, OverlapSource};
use crate::spec::{Probe, Selection};
use arlequin::core::nalgebra::{Point3, center};
use arlequin::fem_ref::FemField;
use std::path::Path;

/// Gives each probe of the body that lies in a zone, where the body's own model has ended, the zone's model.
/// Returns the scene, and warnings about probes that lie in both.
///
/// # Errors
/// A body that cannot be meshed or divided.
pub(in crate::setup) fn with_probes_in_zones(
    scene: &LoweredScene,
    folder: &Path,
) -> Result<(LoweredScene, Vec<String>)> {
    let (mut out, mut warnings) = (scene.clone(), Vec::new());
    // A zone that follows keeps the elements that it begins with, though the body's model has all of them.
    let of_interface = following(scene).map(|(name, ..)| &scene.interface[name].overlap);
    let body = match (scene.model.get(BODY).map(|m| &m.shape), of_interface) {
        (Some(BodyShape::Piece(body)), _) | (_, Some(OverlapSource::Zone(body))) => body,
        _ => return Ok((out, warnings)),
    };
    for (name, probe) in &mut out.probe {
        if probe.model.as_deref() != Some(BODY) {
            continue;
        }
        let [zone, left_out] = body.zones_of_probe(probe, folder)?;
        if let Some(zone) = left_out {
            warnings.push(format!(
                "probe '{name}': its mean is over the nodes of 'body' alone, and zone '{zone}' holds a part of where; give \
                 that part a probe of its own (model = \"{zone}\")"
            ));
        }
        if let Some(zone) = zone {
            probe.model = Some(zone.to_owned());
        }
    }
    Ok((out, warnings))
}

impl Piece {
    /// Returns two names of zones: that of the zone whose model a probe of the body reads, and that of a zone
    /// that holds a part of the probe's place while the body's own model holds the other part.
    pub(super) fn zones_of_probe(&self, probe: &Probe, folder: &Path) -> Result<[Option<&str>; 2]> {
        let division = self.cut.division(folder)?;
        let zone_at = |x: Point3<f64>| Ok([self.zone_beyond_body(&x, division)?, None]);
        if let Some(x) = probe.at {
            return zone_at(Point3::from(x));
        }
        if let Some(crack) = &probe.crack {
            let [from, to] = crack.front.map(Point3::from);
            return zone_at(center(&from, &to));
        }
        let Some(selection) = &probe.over else {
            return Ok([None, None]);
        };
        let nodes = nodes_of(selection, division);
        if let (true, Selection::Box(low, high)) = (nodes.is_empty(), selection) {
            return zone_at(center(&Point3::from(*low), &Point3::from(*high)));
        }
        let zones = zones_alone(division, &nodes);
        let first = zones.iter().flatten().next();
        let name = first.map(|z| &*self.cut.zones[*z].name);
        Ok(match zones.iter().all(|z| z.as_ref() == first) {
            true => [name, None],
            false => [None, name],
        })
    }

    /// Returns whether a probe of the zone reads spheres in elements that the body has alone.
    pub(super) fn is_beyond(&self, probe: &Probe, folder: &Path) -> Result<bool> {
        let division = self.cut.division(folder)?;
        let of_body = |e: usize| division.owners[e] == Owner::Body;
        if let Some(x) = probe.at {
            return Ok(division.field.element_at(&Point3::from(x)).is_some_and(of_body));
        }
        let Some(selection) = &probe.over else {
            return Ok(false);
        };
        let mesh = division.field.mesh();
        let mut selected = vec![false; mesh.nodes().len()];
        nodes_of(selection, division)
            .into_iter()
            .for_each(|k| selected[k] = true);
        let mut elements = (0..mesh.element_count()).filter(|e| of_body(*e));
        Ok(elements.any(|e| mesh.element(e).iter().any(|k| selected[*k as usize])))
    }

    /// Name of the zone that alone owns the place of a point.
    fn zone_beyond_body(&self, x: &Point3<f64>, division: &Division) -> Result<Option<&str>> {
        let Some(Owner::Zone(z)) = division.field.element_at(x).map(|e| division.owners[e]) else {
            return Ok(None);
        };
        // A point on the border belongs to elements of both.
        let keep = |e: usize| !matches!(division.owners[e], Owner::Zone(_));
        if !(0..division.owners.len()).any(keep) {
            return Ok(Some(&self.cut.zones[z].name));
        }
        let body = FemField::new(division.field.mesh().part(keep).map_err(fem("body"))?);
        Ok(body.element_at(x).is_none().then_some(&self.cut.zones[z].name))
    }
}

/// Nodes of the whole body that a selection holds.
fn nodes_of(selection: &Selection, division: &Division) -> Vec<usize> {
    let mesh = division.field.mesh();
    match selection {
        Selection::Group(name) => {
            let group = mesh.groups().get(name);
            group.map_or_else(Vec::new, |g| g.nodes.iter().map(|k| *k as usize).collect())
        }
        Selection::Box(low, high) => {
            let slack = select::slack(mesh.spacing());
            let nodes = mesh.nodes().iter().enumerate();
            let inside = nodes.filter(|(_, x)| select::inside(low, high, x, slack));
            inside.map(|(k, _)| k).collect()
        }
    }
}

/// For each of these nodes: the zone that alone owns all of its elements; `None` if the body has it.
fn zones_alone(division: &Division, nodes: &[usize]) -> Vec<Option<usize>> {
    let mesh = division.field.mesh();
    let mut zone_of = vec![None; mesh.nodes().len()];
    let mut of_body = vec![false; mesh.nodes().len()];
    for (e, owner) in division.owners.iter().enumerate() {
        for k in mesh.element(e) {
            match owner {
                Owner::Zone(z) => zone_of[*k as usize] = Some(*z),
                Owner::Body | Owner::Both(_) => of_body[*k as usize] = true,
            }
        }
    }
    nodes
        .iter()
        .map(|n| zone_of[*n].filter(|_| !of_body[*n]))
        .collect()
}
