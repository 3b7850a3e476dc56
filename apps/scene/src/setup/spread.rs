//! Forces on nodes or spheres that have a prescribed resultant.

use crate::error::{Result, key};
use arlequin::core::effect::SurfaceFacet;
use arlequin::core::nalgebra::{Matrix3, Point3, Vector3};
use std::collections::BTreeMap;

/// Traction \[Pa\] on a facet.
pub(super) type Traction = Box<dyn Fn(&SurfaceFacet<f64>) -> Vector3<f64>>;

/// Largest relative error of a distributed load.
const LEFT: f64 = 1e-9;

/// A force \[N\] and a moment \[N m\] about a point.
#[derive(Debug, Clone, Copy)]
pub(super) struct Wrench {
    pub(super) about: Point3<f64>,
    pub(super) force: Vector3<f64>,
    pub(super) moment: Vector3<f64>,
}

impl Wrench {
    pub(super) fn zero(about: Point3<f64>) -> Self {
        let [force, moment] = [Vector3::zeros(); 2];
        Self { about, force, moment }
    }

    pub(super) fn add(&mut self, point: &Point3<f64>, force: &Vector3<f64>) {
        self.force += force;
        self.moment += (point - self.about).cross(force);
    }

    pub(super) fn minus(mut self, other: &Self) -> Self {
        self.force -= other.force;
        self.moment -= other.moment;
        self
    }
}

/// A node or sphere that carries a part of a load.
#[derive(Debug, Clone, Copy)]
pub(super) struct Carrier {
    /// Position \[m\].
    pub(super) point: Point3<f64>,
    /// Share of the loaded area \[m²\].
    pub(super) area: f64,
    /// Force \[N\].
    pub(super) force: Vector3<f64>,
}

/// Carriers of one model by the number of the node.
#[derive(Debug, Default)]
pub(super) struct Carriers(pub(super) BTreeMap<usize, Carrier>);

impl Carriers {
    pub(super) fn add(&mut self, node: usize, point: Point3<f64>, area: f64, force: Vector3<f64>) {
        let fresh = Carrier {
            point,
            area: 0.0,
            force: Vector3::zeros(),
        };
        let c = self.0.entry(node).or_insert(fresh);
        c.area += area;
        c.force += force;
    }

    pub(super) fn exert(&self, about: Point3<f64>) -> Wrench {
        let mut out = Wrench::zero(about);
        self.0.values().for_each(|c| out.add(&c.point, &c.force));
        out
    }
}

/// Prescribed sum of the forces and moments of carriers, and the sizes of its terms, with which round-off is
/// compared.
#[derive(Debug, Clone, Copy)]
pub(super) struct Resultant {
    pub(super) wrench: Wrench,
    /// Sum of the magnitudes of the forces \[N\]; and sum of these times lever plus facet length \[N m\].
    sizes: [f64; 2],
}

impl Resultant {
    /// Starts without a load; moments are taken about a point.
    fn zero(about: Point3<f64>) -> Self {
        Self {
            wrench: Wrench::zero(about),
            sizes: [0.0; 2],
        }
    }

    /// Sums up tractions on facets \[Pa\], with moments about the centre of their area.
    pub(super) fn of_facets(facets: &[SurfaceFacet<f64>], field: &Traction) -> Self {
        let area: f64 = facets.iter().map(SurfaceFacet::area).sum();
        let sum = |s: Vector3<f64>, f: &SurfaceFacet<f64>| s + f.centre.coords * f.area();
        let middle = Point3::from(facets.iter().fold(Vector3::zeros(), sum) / area);
        let mut out = Self::zero(middle);
        for f in facets {
            out.add(&f.centre, f.area(), &(field(f) * f.area()));
        }
        out
    }

    /// Adds a force on a facet with this centre and area \[m²\].
    fn add(&mut self, centre: &Point3<f64>, area: f64, force: &Vector3<f64>) {
        self.wrench.add(centre, force);
        self.sizes[0] += force.norm();
        self.sizes[1] += force.norm() * ((centre - self.wrench.about).norm() + area.sqrt());
    }

    /// Refuses a remainder that the carriers cannot carry: `who` names them.
    pub(super) fn enough(&self, path: &str, who: &str, remainder: &Wrench) -> Result<()> {
        let [force, moment] = self.sizes;
        if remainder.force.norm() <= LEFT * force && remainder.moment.norm() <= LEFT * moment {
            return Ok(());
        }
        let rule = format!(
            "{:.3e} N and {:.3e} N m of it would be lost: {who}",
            remainder.force.norm(),
            remainder.moment.norm()
        );
        Err(key(format!("{path}.where"), rule))
    }
}

/// Adds forces `a (α + θ × (x − c))` on the carriers with weights `a`, the smallest ones with the missing
/// resultant. The weights are areas, or forces for `profiled` loads, which act in places only. Returns what
/// is still missing: all of it without carriers, and a moment about a line on which all carriers lie.
pub(super) fn make_up(carriers: &mut [&mut Carrier], profiled: bool, missing: Wrench) -> Wrench {
    let weights = carriers
        .iter()
        .map(|c| if profiled { c.force.norm() } else { c.area });
    let weights: Vec<f64> = weights.collect();
    let sum: f64 = weights.iter().sum();
    if sum <= 0.0 {
        return missing;
    }
    let places = carriers.iter().zip(&weights).map(|(c, a)| (c.point, *a));
    let (middle, polar) = polar(places);
    let moment = missing.moment - (middle - missing.about).cross(&missing.force);
    let (along, turn) = (missing.force / sum, turn(&polar, &moment));
    let mut remainder = missing;
    for (c, weight) in carriers.iter_mut().zip(weights) {
        let more = (along + turn.cross(&(c.point - middle))) * weight;
        c.force += more;
        let mut added = Wrench::zero(remainder.about);
        added.add(&c.point, &more);
        remainder = remainder.minus(&added);
    }
    remainder
}

/// Returns the weighted centre `c` of points `x` with weights `a`, and `J = Σ a (|r|² 1 − r rᵀ)` with
/// `r = x − c`. Forces `a θ × r` have the moment `J θ` and no resultant.
pub(super) fn polar(places: impl Iterator<Item = (Point3<f64>, f64)> + Clone) -> (Point3<f64>, Matrix3<f64>) {
    let (sum, total) = places.clone().fold((Vector3::zeros(), 0.0), |(s, t), (x, a)| {
        (s + x.coords * a, t + a)
    });
    let centre = Point3::from(sum / total);
    let mut polar = Matrix3::zeros();
    for (x, a) in places {
        let r = x - centre;
        polar += (Matrix3::identity() * r.norm_squared() - r * r.transpose()) * a;
    }
    (centre, polar)
}

/// Returns `θ` with `J θ = m` in the least-squares sense: points on a line cannot carry a moment about that
/// line.
pub(super) fn turn(polar: &Matrix3<f64>, moment: &Vector3<f64>) -> Vector3<f64> {
    // Relative cut-off for a singular `J`.
    let inverse = polar.pseudo_inverse(1e-12 * polar.norm());
    inverse.map_or(Vector3::zeros(), |p| p * moment)
}

/// Gives each sphere the traction of its facet on an area in proportion to its section. `touching` has the
/// numbers of spheres and of their facets.
pub(super) fn distribute(
    touching: &[(usize, usize)],
    (points, radii): (&[Point3<f64>], &[f64]),
    facets: &[SurfaceFacet<f64>],
    field: &dyn Fn(&SurfaceFacet<f64>) -> Vector3<f64>,
) -> Carriers {
    let area: f64 = facets.iter().map(SurfaceFacet::area).sum();
    let sections: f64 = touching.iter().map(|(k, _)| radii[*k].powi(2)).sum();
    let mut out = Carriers::default();
    for &(k, triangle) in touching {
        let share = area * radii[k].powi(2) / sections;
        out.add(k, points[k], share, field(&facets[triangle]) * share);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a profiled load lacks is added where it acts; other loads lack it everywhere.
    #[test]
    fn a_profiled_load_is_made_up_where_it_acts() {
        let carriers = || {
            [0.0, 1.0, 2.0, 3.0, 4.0].map(|x| Carrier {
                point: Point3::new(x, x * x, 0.3 * x),
                area: 1.0,
                force: if x < 3.0 { Vector3::z() } else { Vector3::zeros() },
            })
        };
        let about = Point3::new(1.0, 0.5, 0.0);
        for profiled in [true, false] {
            let (mut changed, before) = (carriers(), carriers());
            let [force, moment] = [Vector3::new(0.2, -0.1, 0.3), Vector3::new(0.1, 0.2, -0.3)];
            let missing = Wrench { about, force, moment };
            let remainder = make_up(&mut changed.iter_mut().collect::<Vec<_>>(), profiled, missing);
            assert!(
                remainder.force.norm() + remainder.moment.norm() < 1e-12,
                "{remainder:?}"
            );
            let mut added = Wrench::zero(about);
            for (a, b) in changed.iter().zip(&before) {
                added.add(&a.point, &(a.force - b.force));
            }
            assert!((added.force - force).norm() < 1e-12 && (added.moment - moment).norm() < 1e-12);
            let idle = changed[3..].iter().map(|c| c.force.norm()).sum::<f64>();
            assert_eq!(idle > 0.0, !profiled, "{idle}");
        }
    }
}
