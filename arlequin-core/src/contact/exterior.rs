//! The exterior of a model, which touches that of another: the facets of a surface, or spheres.

use super::ContactLaw;
use super::facet::{self, Facet, Foot};
use super::forces::{Push, StepForces};
use super::place::{Place, Triangle};
use super::points::{self, SurfacePoint};
use crate::effect::Host;
use crate::error::invalid;
use crate::model::Model;
use crate::weight::Uniform;
use crate::{Error, Result};
use nalgebra::{Point3, Vector3};

/// Spacing of the points on a facet over the size of the smaller facets: a uniform pressure then errs by less
/// than one per cent at any node of two unlike meshes (0.5: 1.4 per cent at half the cost).
const SPACING: f64 = 0.34;
/// Least spacing of the points over the longest edge of a surface.
const FINEST: f64 = 1.0 / 16.0;
/// Part of the stiffness that each of two surfaces contributes, as the points of both act.
const BOTH: f64 = 0.5;

/// Sum of the area vectors of a closed surface over its area, at most.
const CLOSED: f64 = 1e-6;

/// The exterior of a model at rest: remains available when the model has moved into a run.
#[derive(Debug, Clone)]
pub struct Exterior {
    pub(super) name: String,
    nodes: Vec<Point3<f64>>,
    kind: Kind,
}

#[derive(Debug, Clone)]
enum Kind {
    /// Triangles of a surface.
    Facets(Vec<Triangle>),
    /// Radii of spheres \[m\], one at each node.
    Spheres(Vec<f64>),
}

impl Exterior {
    /// Surface of a model; `None` if it has none.
    #[must_use]
    pub fn surface(model: &dyn Model<f64>) -> Option<Self> {
        Some(Self {
            name: model.name().to_owned(),
            nodes: model.nodes().to_vec(),
            kind: Kind::Facets(Triangle::cut(
                &model.views().surface?.faces(),
                model.nodes().len(),
            )),
        })
    }

    /// Spheres of a model whose nodes they are; each has a centre and a radius \[m\].
    #[must_use]
    pub fn spheres(name: &str, spheres: &[[f64; 4]]) -> Self {
        Self {
            name: name.to_owned(),
            nodes: spheres.iter().map(|s| Point3::new(s[0], s[1], s[2])).collect(),
            kind: Kind::Spheres(spheres.iter().map(|s| s[3]).collect()),
        }
    }

    /// Name of the model.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns whether the exterior has facets.
    #[must_use]
    pub fn has_facets(&self) -> bool {
        matches!(self.kind, Kind::Facets(_))
    }

    /// Refuses a surface whose facets do not all look outwards: points would pass through those that do not.
    /// The area vectors of a closed surface sum to zero, and the volume inside is positive.
    pub(super) fn check(&self) -> Result<()> {
        let Kind::Facets(triangles) = &self.kind else {
            return Ok(());
        };
        let (mut sum, mut area, mut volume) = (Vector3::zeros(), 0.0, 0.0);
        for t in triangles {
            let [a, b, c] = self.corners(t);
            let doubled = (b - a).cross(&(c - a));
            sum += doubled;
            area += doubled.norm();
            volume += (a - self.nodes[triangles[0].nodes[0] as usize].coords).dot(&doubled);
        }
        if sum.norm() <= CLOSED * area && volume > 0.0 {
            return Ok(());
        }
        Err(invalid(
            &format!("surface of '{}' in contact", self.name),
            format_args!("{} facets", triangles.len()),
            "must be closed with all facets outwards, which they are not; take kind = \"fem\" for this body",
        ))
    }

    /// Mean size of the facets, or mean radius of the spheres \[m\].
    pub(super) fn size(&self) -> f64 {
        let size = |t: &Triangle| {
            let [a, b, c] = self.corners(t);
            t.size(0.5 * (b - a).cross(&(c - a)).norm())
        };
        let (sum, count) = match &self.kind {
            Kind::Facets(triangles) => (triangles.iter().map(size).sum::<f64>(), triangles.len()),
            Kind::Spheres(radii) => (radii.iter().sum(), radii.len()),
        };
        sum / count.max(1) as f64
    }

    fn corners(&self, t: &Triangle) -> [Vector3<f64>; 3] {
        t.places(|n| self.nodes[n as usize].coords)
    }

    /// Points that touch facets of `other`: the spheres, or points of the facets.
    fn points(&self, other: &Self) -> Result<Vec<SurfacePoint>> {
        match &self.kind {
            Kind::Spheres(radii) => {
                let sphere = |(k, r): (usize, &f64)| SurfacePoint {
                    place: Place::node(k as u32),
                    rest: self.nodes[k],
                    // Area of a sphere among its neighbours in a dense layer.
                    area: 2.0 * 3_f64.sqrt() * r * r,
                    // Against a flat, as for obstacles.
                    stiffness: 2.0 * r,
                    size: *r,
                    normal: Vector3::zeros(),
                    facet: None,
                };
                Ok(radii.iter().enumerate().map(sphere).collect())
            }
            Kind::Facets(triangles) => {
                let edge = |t: &Triangle| {
                    let [a, b, c] = self.corners(t);
                    (b - a).norm().max((c - b).norm()).max((a - c).norm())
                };
                let longest = triangles.iter().map(edge).fold(0.0, f64::max);
                let spacing = (SPACING * self.size().min(other.size())).max(FINEST * longest);
                let object = format!("the surface of '{}'", self.name);
                let mut points = points::points(&object, triangles, &self.nodes, spacing)?;
                points.iter_mut().for_each(|p| p.stiffness *= BOTH);
                Ok(points)
            }
        }
    }
}

/// Area of each node on some facets \[m²\]: the length of the sum of their projections on the axes.
fn areas(nodes: usize, facets: &[Facet]) -> Vec<f64> {
    let mut sums = vec![Vector3::zeros(); nodes];
    for f in facets {
        let area = f.doubled.abs() * 0.5;
        let whole = f.triangle.place([1.0 / 3.0; 3]);
        whole.nodes().for_each(|(n, w)| sums[n] += area * w);
    }
    sums.iter().map(Vector3::norm).collect()
}

/// One of two models that touch each other, in a run.
#[derive(Debug)]
pub(super) struct Side {
    pub(super) rest: Vec<Point3<f64>>,
    /// Points that touch facets of the other side.
    pub(super) points: Vec<SurfacePoint>,
    /// True if the points are spheres, which turn.
    pub(super) turns: bool,
    pub(super) facets: Vec<Facet>,
    /// Nodes that points or facets move with, and those of them that do not sleep.
    surface: Vec<u32>,
    pub(super) nodes: Vec<u32>,
    /// Nodes that have gained weight since the last step, ascending.
    pub(super) gained: Vec<u32>,
    /// Weighted over unweighted mass, weighted and unweighted mass \[kg\] of each node. A node that sleeps
    /// has no weight.
    share: Vec<f64>,
    mass: Vec<f64>,
    unweighted: Vec<f64>,
    /// Area of each node on the facets \[m²\].
    area: Vec<f64>,
    pub(super) forces: StepForces,
}

impl Side {
    /// One of two exteriors, before it is attached.
    pub(super) fn new(own: &Exterior, other: &Exterior) -> Result<Self> {
        let points = if other.has_facets() {
            own.points(other)?
        } else {
            Vec::new()
        };
        let facets = match &own.kind {
            Kind::Facets(triangles) => facet::facets(triangles, &own.nodes),
            Kind::Spheres(_) => Vec::new(),
        };
        let of_points = points.iter().flat_map(|p| p.place.nodes().map(|n| n.0 as u32));
        let mut nodes: Vec<u32> = of_points
            .chain(facets.iter().flat_map(|f| f.triangle.nodes))
            .collect();
        nodes.sort_unstable();
        nodes.dedup();
        Ok(Self {
            turns: !own.has_facets(),
            rest: own.nodes.clone(),
            points,
            area: areas(own.nodes.len(), &facets),
            facets,
            share: vec![1.0; own.nodes.len()],
            nodes: nodes.clone(),
            surface: nodes,
            gained: Vec::new(),
            mass: Vec::new(),
            unweighted: Vec::new(),
            forces: StepForces::default(),
        })
    }

    /// Leaves out what the mask `tied` names. [`Self::weigh`] must follow: until then, no node sleeps.
    pub(super) fn attach(&mut self, host: &Host<'_, f64>, tied: &[bool], effect: &str) -> Result<()> {
        let layout = host.model.layout();
        if host.model.owned().is_part() {
            return Err(Error::Unsupported {
                model: host.model.name().to_owned(),
                what: format!("have {effect} while it is in parts on several ranks; leave it whole"),
            });
        }
        if layout.nodes != self.rest.len() {
            return Err(Error::SizeMismatch {
                what: format!("nodes of model '{}' with {effect}", host.model.name()),
                expected: self.rest.len(),
                found: layout.nodes,
            });
        }
        let is_tied = |n: usize| tied.get(n).copied().unwrap_or(false);
        self.points.retain(|p| !p.place.nodes().any(|(n, _)| is_tied(n)));
        self.facets
            .retain(|f| !f.triangle.nodes.iter().any(|n| is_tied(*n as usize)));
        Ok(())
    }

    /// Takes the masses from the subdomain.
    pub(super) fn weigh(&mut self, host: &Host<'_, f64>) -> Result<()> {
        let layout = host.model.layout();
        let mut whole = vec![0.0; layout.dofs()];
        host.model.lumped_inertia(&Uniform(1.0), &mut whole)?;
        let masses = |x: &[f64]| (0..layout.nodes).map(|n| x[3 * n]).collect::<Vec<f64>>();
        (self.mass, self.unweighted) = (masses(host.inertia), masses(&whole));
        let shares = self.mass.iter().zip(&self.unweighted).map(|(m, w)| m / w);
        self.share = shares.collect();
        self.forces = StepForces::new(host.inverse_inertia.to_vec());
        let awake = self.surface.iter().filter(|n| self.share[**n as usize] > 0.0);
        self.nodes = awake.copied().collect();
        Ok(())
    }

    /// Takes the masses after a change of weights, and notes which nodes have gained weight.
    pub(super) fn reweigh(&mut self, host: &Host<'_, f64>) -> Result<()> {
        let before = std::mem::take(&mut self.share);
        self.weigh(host)?;
        let gains = |n: &u32| self.share[*n as usize] > before[*n as usize];
        self.gained.extend(self.surface.iter().copied().filter(gains));
        self.gained.sort_unstable();
        self.gained.dedup();
        Ok(())
    }

    /// Returns whether nodes of the surface sleep.
    pub(super) fn sleeps(&self) -> bool {
        self.nodes.len() < self.surface.len()
    }

    /// Weighted over unweighted mass at a place; zero where a node sleeps, which would take its part of a
    /// force without moving.
    pub(super) fn weight(&self, place: &Place) -> f64 {
        match place.nodes().any(|(n, _)| self.share[n] <= 0.0) {
            true => 0.0,
            false => place.mean(|n| self.share[n]),
        }
    }

    /// Returns whether no node of a facet sleeps.
    pub(super) fn is_awake(&self, facet: &Facet) -> bool {
        facet.triangle.nodes.iter().all(|n| self.share[*n as usize] > 0.0)
    }

    /// Returns whether a node of a place has gained weight since the last step.
    pub(super) fn has_gained(&self, place: &Place) -> bool {
        place
            .nodes()
            .any(|(n, _)| self.gained.binary_search(&(n as u32)).is_ok())
    }

    /// Radius of a point \[m\].
    pub(super) fn radius(&self, k: usize) -> f64 {
        if self.turns { self.points[k].size } else { 0.0 }
    }

    /// Returns the present position of a node \[m\].
    pub(super) fn position(&self, n: u32, q: &[f64]) -> Vector3<f64> {
        let (n, o) = (n as usize, 3 * n as usize);
        self.rest[n].coords + Vector3::new(q[o], q[o + 1], q[o + 2])
    }

    /// Angular velocity at a place \[rad/s\]; zero where nothing turns.
    pub(super) fn spin(&self, place: &Place, v: &[f64]) -> Vector3<f64> {
        self.turning(place)
            .map_or_else(Vector3::zeros, |o| Vector3::new(v[o], v[o + 1], v[o + 2]))
    }

    /// First rotational unknown of the sphere at a place; none where nothing turns.
    fn turning(&self, place: &Place) -> Option<usize> {
        self.turns
            .then(|| 3 * (self.rest.len() + place.nodes[0] as usize))
    }

    /// A force and a torque at a place.
    pub(super) fn push(&self, place: &Place, force: Vector3<f64>, torque: Vector3<f64>) -> Push {
        Push {
            place: *place,
            turning: self.turning(place),
            force,
            torque,
        }
    }

    /// Stiffness over the modulus \[m\] and mass \[kg\] for the dashpot of point `k` with a foot on `other`.
    ///
    /// A point of a surface stands for its area as the facet under it sees it: at the edge of a block, not
    /// for its area on the side. Its mass is that of the surface under this area, `a Σ w_n m_n/A_n`. With the
    /// masses of whole nodes, points would be damped the more the finer they are.
    pub(super) fn constants(&self, k: usize, other: &Self, foot: &Foot) -> [f64; 2] {
        let p = &self.points[k];
        if self.turns {
            let inverse = |side: &Self, place: &Place| place.squared(|n| 1.0 / side.mass[n]);
            return [
                p.stiffness,
                1.0 / (inverse(self, &p.place) + inverse(other, &foot.place)),
            ];
        }
        let area = p.normal.dot(&foot.normal).abs();
        let inverse = |side: &Self, place: &Place| 1.0 / place.mean(|n| side.mass[n] / side.area[n]);
        let mass = area / (inverse(self, &p.place) + inverse(other, &foot.place));
        [p.stiffness * (area / p.area), mass]
    }

    /// Largest row of `M⁻¹K` \[1/s²\] and largest damping rate \[1/s\] of the contacts with `other`, from the
    /// masses without weights.
    ///
    /// Points of the side itself have their weights. Points of the other side may stand anywhere: over the
    /// area of a node they have the stiffness per area of their surface, and one more stands at the node.
    pub(super) fn rows(&self, other: &Self, law: &ContactLaw) -> [f64; 2] {
        let mut stiffness = vec![0.0; self.rest.len()];
        let mut damping = stiffness.clone();
        let slide = |ratio: f64| {
            if law.friction > 0.0 {
                (law.shear_ratio * ratio).max(1.0)
            } else {
                1.0
            }
        };
        // Sliding turns a sphere as well: `1/m + r²/I = 3.5/m`.
        let sliding = slide(if self.turns { 3.5 } else { 1.0 });
        for p in &self.points {
            let [k, c, _] = self.largest(p, law);
            for (n, w) in p.place.nodes() {
                stiffness[n] += sliding * k * w / self.unweighted[n];
                damping[n] += c * w / self.unweighted[n];
            }
        }
        let mut top = [0.0_f64; 4];
        for p in &other.points {
            let [k, c, area] = other.largest(p, law);
            let largest = [k, c, k / area, c / area];
            top.iter_mut().zip(largest).for_each(|(top, x)| *top = top.max(x));
        }
        let [k, c, k_area, c_area] = top;
        let mut out = [0.0_f64; 2];
        // What sleeps may wake.
        let moves = |n: &usize| self.forces.moves(*n) || self.share[*n] <= 0.0;
        for n in (0..self.rest.len()).filter(moves) {
            let (area, mut rows) = (self.area[n], [stiffness[n], damping[n]]);
            if area > 0.0 {
                rows[0] += slide(1.0) * (k_area * area + k) / self.unweighted[n];
                rows[1] += (c_area * area + c) / self.unweighted[n];
            }
            out.iter_mut().zip(rows).for_each(|(top, x)| *top = top.max(x));
        }
        out
    }

    /// Largest stiffness \[N/m\] and damping constant \[kg/s\] of a point without weights, and its area
    /// \[m²\].
    fn largest(&self, p: &SurfacePoint, law: &ContactLaw) -> [f64; 3] {
        let area = if self.turns { p.area } else { p.normal.norm() };
        let k = law.modulus * p.stiffness * (area / p.area);
        let mass = if self.turns {
            self.unweighted[p.place.nodes[0] as usize]
        } else {
            area * p.place.mean(|n| self.unweighted[n] / self.area[n])
        };
        [k, 2.0 * law.damping_ratio() * (k * mass).sqrt(), area]
    }
}
