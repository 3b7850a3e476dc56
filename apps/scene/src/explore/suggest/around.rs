//! Overlaps that are no slabs: shells, and the layers around zones.
//!
//! Waves cross such an overlap along its normal. Lengths along the normal, and the volumes that decide the
//! cost, follow from the nodes of the models as they are built for the scene as given.

use super::mesher::{Frame, Mesher};
use super::scenario::{OverlapKind, Scenario, length_ratio};
use crate::error::{Result, core, key, value};
use crate::setup::{self, Built, LoweredInterface, LoweredModel, LoweredScene};
use crate::spec::{RegionShape, Shape};
use arlequin::core::nalgebra::Point3;
use arlequin::core::{Subdomain, Uniform};
use rayon::prelude::*;

/// Smallest weight of the fine model at nodes of its own region.
const OWN: f64 = 1.0 - 1e-7;
/// Largest relative difference of lengths that count as equal.
const EQUAL: f64 = 1e-6;

/// Sizes around an overlap.
#[derive(Debug, Clone)]
pub struct Around {
    /// Masses of the fine model in its own region and in the overlap as given \[kg\].
    fine: [f64; 2],
    /// Distance from the fine model's own region \[m\] and mass \[kg\] of each node of the coarse model.
    nodes: Vec<[f64; 2]>,
    /// Width of the overlap as given \[m\].
    width: f64,
    /// Coarse spacing as given \[m\].
    spacing: f64,
}

impl Around {
    /// Returns the mass of the fine model \[kg\] and the share of the overlap as given, for an overlap of
    /// `width` \[m\].
    pub(super) fn sizes(&self, width: f64) -> [f64; 2] {
        let share = self.layer(width) / self.layer(self.width).max(f64::MIN_POSITIVE);
        [self.fine[0] + self.fine[1] * share, share]
    }

    /// Mass of the coarse body within a distance of the fine model's own region \[kg\]. The mass of a node
    /// extends over one spacing.
    fn layer(&self, distance: f64) -> f64 {
        let share = |d: f64| ((distance - d) / self.spacing + 0.5).clamp(0.0, 1.0);
        self.nodes.iter().map(|[d, mass]| mass * share(*d)).sum()
    }
}

/// Completes the scenario of a zone, as far as the scene alone tells it.
pub(super) fn zone(base: Scenario, scene: &LoweredScene, fine: &LoweredModel) -> Result<Scenario> {
    let name = &base.names[0];
    let (Some(body), Some(zone)) = (&scene.body, scene.zone.get(name)) else {
        return Err(key(format!("zone.{name}"), "needs [body]"));
    };
    let (coarse, across) = sizes_of("body", body)?;
    let mesher = Mesher::of_shape(&body.shape, None);
    let coarse = made(&mesher, body, coarse);
    let mediator = zone.mediator.spacing.unwrap_or(coarse);
    let halved_to = fine.spacing.filter(|_| !setup::kind(zone.kind).has_spheres());
    Ok(Scenario {
        keys: ["body".to_owned(), format!("zone.{name}")],
        kind: OverlapKind::Zone,
        overlap: zone.overlap.width,
        movable: true,
        spacings: [coarse, fine.spacing.unwrap_or(coarse), mediator],
        mesher,
        halved_to,
        across: Some(across),
        length_ratio: zone.junction.length.map_or(0.25, |l| l / mediator),
        speed: shear_speed(&base, body),
        ..base
    })
}

/// Completes the scenario of a shell between the regions `core` and `domain`, as far as the scene alone tells
/// it.
pub(super) fn shell(
    base: Scenario,
    (table, [coarse, fine]): (&LoweredInterface, [&LoweredModel; 2]),
    [core, domain]: [&RegionShape; 2],
) -> Result<Scenario> {
    let path = format!("interface.{}", base.names[0]);
    if table.mediator.divisions.is_some() {
        let rule = "suggest needs a spacing around a shell; give mediator.spacing [m] instead";
        return Err(key(format!("{path}.mediator.divisions"), rule));
    }
    let widths = widths(core, domain);
    // The narrowest place decides what is reflected.
    let width = widths.iter().copied().fold(f64::INFINITY, f64::min);
    if !width.is_finite() {
        let rule = "suggest reads the width of a shell between two boxes, two balls or two cylinders, of which the \
                    domain is larger; write both alike";
        return Err(key(format!("{path}.overlap.shell"), rule));
    }
    let even = widths.iter().all(|w| w - width < EQUAL * width);
    let (h, across) = sizes_of(&base.keys[0], coarse)?;
    let h = made(&base.mesher, coarse, h);
    let mediator = table.mediator.spacing.unwrap_or(h);
    let free = table.mediator.shape.is_none() && fine.dem.count.is_none() && fine.divisions.is_none();
    Ok(Scenario {
        kind: OverlapKind::Shell,
        overlap: width,
        movable: even && free && fills(fine, core, domain),
        spacings: [h, fine.spacing.unwrap_or(h), mediator],
        frame: Frame::of_shell(table, [coarse, fine]),
        across: Some(across),
        length_ratio: length_ratio(table, mediator),
        speed: shear_speed(&base, coarse),
        ..base
    })
}

/// Returns the mean length of the elements that a body's spacing `h` gives \[m\].
fn made(mesher: &Mesher, model: &LoweredModel, h: f64) -> f64 {
    let elements = mesher.elements(h).filter(|_| model.divisions.is_none());
    elements.map_or(h, |e| e.h)
}

/// Returns the speed of shear waves \[m/s\]: they carry most of what spreads from a small region, and
/// lattices disperse them more than axial waves.
fn shear_speed(base: &Scenario, coarse: &LoweredModel) -> f64 {
    base.speed / (2.0 * (1.0 + coarse.material.and_then(|m| m.poisson).unwrap_or(0.0))).sqrt()
}

/// Returns the positive distances between the faces of two regions of one form \[m\].
fn widths(core: &RegionShape, domain: &RegionShape) -> Vec<f64> {
    let all = match (core, domain) {
        (
            RegionShape::Ball { radius: r, centre: a },
            RegionShape::Ball {
                radius: outer,
                centre: b,
            },
        ) => {
            vec![outer - r - (Point3::from(*a) - Point3::from(*b)).norm()]
        }
        (RegionShape::Cylinder { radius: r, .. }, RegionShape::Cylinder { radius: outer, .. }) => {
            vec![outer - r]
        }
        (RegionShape::Box { low: a, high: b }, RegionShape::Box { low, high }) => {
            (0..3).flat_map(|c| [a[c] - low[c], high[c] - b[c]]).collect()
        }
        _ => Vec::new(),
    };
    // Faces that both regions share, such as the surface of a plate, part nothing.
    all.into_iter().filter(|w| *w > 0.0).collect()
}

/// Returns whether a fine body ends where a domain does, on all faces that part the domain from the core.
fn fills(fine: &LoweredModel, core: &RegionShape, domain: &RegionShape) -> bool {
    match (fine.shape.in_scene(), core, domain) {
        (
            Some(Shape::Box { low, high, .. }),
            RegionShape::Box { low: a, high: b },
            RegionShape::Box { low: l, high: h },
        ) => {
            let equal = |x: f64, y: f64| (x - y).abs() < EQUAL * (h[0] - l[0]);
            (0..3).all(|c| (a[c] <= l[c] || equal(low[c], l[c])) && (h[c] <= b[c] || equal(high[c], h[c])))
        }
        (
            Some(Shape::Ball { radius, centre }),
            _,
            RegionShape::Ball {
                radius: outer,
                centre: middle,
            },
        ) => {
            (radius - outer).abs() < EQUAL * outer
                && (Point3::from(*centre) - Point3::from(*middle)).norm() < EQUAL * outer
        }
        _ => false,
    }
}

/// Returns the spacing of a coarse body and its smallest size \[m\].
fn sizes_of(path: &str, model: &LoweredModel) -> Result<(f64, f64)> {
    let edges = match model.shape.in_scene() {
        Some(Shape::Box { low, high, .. }) => [0, 1, 2].map(|c| high[c] - low[c]),
        Some(Shape::Cylinder { length, radius, .. }) => [*length, 2.0 * radius, 2.0 * radius],
        Some(Shape::Ball { radius, .. }) => [2.0 * radius; 3],
        _ => {
            let rule = "suggest changes the spacing of the coarse body, which only a box, a cylinder and a ball leave free; \
                        take one of these, or compare several meshes by arlequin sweep";
            return Err(value(format!("{path}.shape"), model.shape.name(), rule));
        }
    };
    let divided = model.divisions.as_ref().filter(|n| n.len() == 3);
    // The longest edge decides which waves a mesh resolves.
    let divided = divided.map(|n| (0..3).map(|c| edges[c] / n[c] as f64).fold(0.0, f64::max));
    let spacing = model.spacing.or(divided);
    let spacing = spacing.ok_or_else(|| key(path, "suggest needs its spacing [m]; give it"))?;
    Ok((spacing, edges.into_iter().fold(f64::INFINITY, f64::min)))
}

/// Distance from a point to the nearest of some points \[m\].
fn nearest(x: &Point3<f64>, points: &[Point3<f64>]) -> f64 {
    let squares = points.iter().map(|p| (p - x).norm_squared());
    squares.fold(f64::INFINITY, f64::min).sqrt()
}

/// Adds the sizes that only built models tell.
pub(super) fn with_models(mut s: Scenario, scene: &LoweredScene, built: &Built) -> Result<Scenario> {
    let models = built.run.subdomains();
    let index = |name: &String| models.iter().position(|d| d.model().name() == name);
    if let Some(c) = index(&s.names[1]) {
        let table = s.coarse_table(scene);
        let nominal = table.and_then(|m| s.mesher.elements(m.spacing?));
        s.stretch = nominal.map_or(1.0, |e| built.models[c].spacing / e.mean);
    }
    if s.kind == OverlapKind::Slab {
        return Ok(s);
    }
    if let Some(zone) = scene
        .zone
        .get(&s.names[0])
        .filter(|_| s.kind == OverlapKind::Zone)
    {
        let halved = |longest| s.halved(s.spacings[0], longest, 0.0);
        s.spacings[2] = zone.mediator.spacing.map_or(s.spacings[0], halved);
        s.length_ratio = zone.junction.length.map_or(0.25, |l| l / s.spacings[2]);
    }
    let (Some(c), Some(f)) = (index(&s.names[1]), index(&s.names[2])) else {
        return Err(key(
            s.keys[1].clone(),
            "couples models that the scene does not have",
        ));
    };
    let mass = |d: &Subdomain<f64>| -> Result<Vec<f64>> {
        let mut out = vec![0.0; d.model().layout().dofs()];
        d.model()
            .lumped_inertia(&Uniform(1.0), &mut out)
            .map_err(core("time"))?;
        // The three translations of a node have the same mass.
        Ok(out.into_iter().step_by(3).take(d.model().nodes().len()).collect())
    };
    let [coarse, fine] = [models[c].model().nodes(), models[f].model().nodes()];
    let weight = &models[f].weights().kinetic;
    let mut own = Vec::new();
    let mut parts = [0.0; 2];
    for (x, m) in fine.iter().zip(mass(&models[f])?) {
        // Weights reach one only up to round-off of the profile.
        let inside = weight.value(x) >= OWN;
        parts[usize::from(!inside)] += m;
        own.extend(inside.then_some(*x));
    }
    if own.is_empty() {
        let rule =
            "has no node of the fine model alone; make it larger, or the spacing of the fine model smaller";
        return Err(key(s.keys[1].clone(), rule));
    }
    if s.halved_to.is_none() {
        s.spacings[1] = built.models[f].spacing;
    }
    // Centres of spheres end half a diameter before the border.
    let rim = if s.particles { 0.5 * s.spacings[1] } else { 0.0 };
    let distances: Vec<f64> = coarse
        .par_iter()
        .map(|x| (nearest(x, &own) - rim).max(0.0))
        .collect();
    // A core has no length along one normal: the largest distance of its nodes from the coarse body stands
    // for it.
    let depth = own
        .par_iter()
        .map(|x| nearest(x, coarse))
        .reduce(|| 0.0, f64::max);
    s.lengths = [distances.iter().copied().fold(0.0, f64::max), depth];
    let seen = scene
        .probe
        .values()
        .filter(|p| p.model.as_ref() == Some(&s.names[2]));
    let seen = seen.filter_map(|p| Some(nearest(&Point3::from(p.at?), &own) - 2.0 * rim));
    s.needed = seen.fold(0.0, f64::max);
    let nodes = distances.into_iter().zip(mass(&models[c])?);
    s.around = Some(Around {
        fine: parts,
        nodes: nodes.map(|(d, m)| [d, m]).collect(),
        width: s.overlap,
        spacing: s.spacings[0],
    });
    Ok(s)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shell_is_as_wide_as_its_faces_are_apart() {
        let cuboid = |edge: f64, top: f64| RegionShape::Box {
            low: [-edge, -edge, -1.0],
            high: [edge, edge, top],
        };
        let ball = |radius: f64| RegionShape::Ball {
            centre: [0.0; 3],
            radius,
        };
        assert_eq!(
            widths(&cuboid(1.0, 1.0), &cuboid(3.0, 1.0)),
            [2.0; 4],
            "open above and below"
        );
        assert_eq!(widths(&ball(1.0), &ball(1.5)), [0.5]);
        assert!(
            widths(&ball(1.0), &cuboid(3.0, 1.0)).is_empty() && widths(&ball(1.0), &ball(1.0)).is_empty()
        );
    }

    /// Nodes on a line at distances of one spacing: the overlap as given is one, and the fine model grows
    /// with the mass of the coarse one that it covers.
    #[test]
    fn a_wider_overlap_has_the_mass_that_lies_in_it() {
        let around = Around {
            fine: [5.0, 8.0],
            nodes: (0..10).map(|k| [k as f64 + 0.5, 2.0]).collect(),
            width: 2.0,
            spacing: 1.0,
        };
        for (width, mass, share) in [(2.0, 13.0, 1.0), (4.0, 21.0, 2.0), (3.0, 17.0, 1.5)] {
            let found = around.sizes(width);
            assert!(
                (found[0] - mass).abs() < 1e-12 && (found[1] - share).abs() < 1e-12,
                "{found:?}"
            );
        }
    }
}
