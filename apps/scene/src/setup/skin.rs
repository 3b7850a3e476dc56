//! The surface of a model of particles, which carries tractions and pressures.
//!
//! Spheres have no facets. The surface is that of the shape which they fill; each sphere that touches the
//! loaded part carries the traction of the nearest triangle on an area in proportion to its section. The
//! resultant is then corrected to that of the surface, in force and moment.

use super::faces::Faces;
use super::filling::Filling;
use super::select;
use crate::error::{Result, key, unknown};
use crate::setup::BodyShape;
use crate::spec::{Selection, Shape};
use arlequin::core::effect::SurfaceFacet;
use arlequin::core::geometry::bounds_of;
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::dem_beam::Surface;
use arlequin::dem_beam::packing::Container;
use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::TAU;

/// Number of sides of the polygon that stands for the circle of a cylinder; its area is that of the circle.
const SIDES: usize = 256;

type Triangle = [Point3<f64>; 3];

/// Triangles of a surface \[m\], which face outwards, and those of its named parts.
#[derive(Debug, Clone, Default)]
pub(super) struct Skin {
    groups: BTreeMap<String, Vec<Triangle>>,
    whole: Vec<Triangle>,
}

impl Skin {
    /// Returns the surface of a shape.
    pub(super) fn new(shape: &BodyShape, filling: &Filling) -> Self {
        let groups = match shape.in_scene() {
            Some(Shape::Box { low, high, .. }) => cuboid(*low, *high),
            Some(Shape::Cylinder { from, length, radius }) => {
                cylinder(&Point3::from(*from), *length, *radius)
            }
            _ => return Self::from_file(filling),
        };
        let mut out = Self {
            whole: groups.values().flatten().copied().collect(),
            groups,
        };
        // The side of a cylinder has no group, as for supports.
        out.groups.remove(SIDE);
        out
    }

    /// Returns the surface in a file, or that of a zone. Named triangles get the direction of the surface.
    fn from_file(filling: &Filling) -> Self {
        let whole = match &filling.container {
            Container::Surface(surface) => triangles(surface),
            Container::Around(around) => triangles(around.part()),
            _ => Vec::new(),
        };
        if whole.is_empty() {
            return Self::default();
        }
        let near = Faces::new(whole.clone());
        // Files may list the corners of a group the other way round, and a pressure needs outward normals.
        let turned = |t: &[Vector3<f64>; 3]| {
            let [a, b, c] = t.map(Point3::from);
            let beside = near.triangles()[near.nearest(&centre(&[a, b, c])).0];
            match area_vector(&[a, b, c]).dot(&area_vector(&beside)) < 0.0 {
                true => [a, c, b],
                false => [a, b, c],
            }
        };
        let named = filling.faces.iter();
        let groups = named.map(|(name, t)| (name.clone(), t.iter().map(turned).collect()));
        Self {
            groups: groups.collect(),
            whole,
        }
    }

    /// Returns the selected part of the surface of model `name`, with spheres of this mean diameter \[m\]. A
    /// box cuts triangles at its sides. It leaves out a face that it takes less than a diameter of, so that a
    /// box around one face does not load the rims of its neighbours.
    ///
    /// # Errors
    /// An unknown group; a selection without surface.
    pub(super) fn select(
        &self,
        path: &str,
        name: &str,
        selection: &Selection,
        diameter: f64,
    ) -> Result<Vec<Triangle>> {
        let selected = match selection {
            Selection::Group(group) => match self.groups.get(group) {
                Some(triangles) => triangles.clone(),
                None => {
                    return Err(unknown(
                        path,
                        group,
                        "surface of the model",
                        select::named(&self.groups),
                    ));
                }
            },
            Selection::Box(low, high) => {
                select::check_box(path, low, high)?;
                self.inside([*low, *high], diameter)
            }
        };
        // A box that only touches the surface in an edge cuts triangles without area.
        if selected.iter().any(|t| area_vector(t).norm() > 0.0) {
            return Ok(selected);
        }
        let rule = format!(
            "{selection} holds no surface of model '{name}'; choose a face or a larger box, or give a force [N]"
        );
        Err(key(path, rule))
    }

    /// Returns the triangles in a box.
    fn inside(&self, corners: [[f64; 3]; 2], diameter: f64) -> Vec<Triangle> {
        let [low, high] = bounds_of(self.whole.iter().flatten());
        let slack = select::slack(diameter);
        // Extent of the box in the body, and that of the body.
        let reach = [0, 1, 2].map(|c| corners[1][c].min(high[c]) - corners[0][c].max(low[c]));
        let full = high - low;
        let narrow = |t: &Triangle| {
            let normal = area_vector(t).normalize();
            // A body that is thin itself lies in the box with its full extent, and is no strip.
            let is_strip = |c: usize| reach[c] < diameter && reach[c] < full[c] - slack;
            // A face across the narrow direction of the box is the face that the box is meant for.
            (0..3).any(|c| is_strip(c) && normal[c].abs() < std::f64::consts::FRAC_1_SQRT_2)
        };
        // Triangles without area have no normal.
        let solid = self.whole.iter().filter(|t| area_vector(t).norm() > 0.0);
        let mut out = Vec::new();
        for t in solid.filter(|t| !narrow(t)) {
            let mut polygon = t.to_vec();
            for c in 0..3 {
                polygon = clip(polygon, &|x| corners[1][c] - x[c], slack);
                polygon = clip(polygon, &|x| x[c] - corners[0][c], slack);
            }
            // Nothing is left of a triangle outside of the box.
            let fan = polygon.get(1..).unwrap_or_default().windows(2);
            out.extend(fan.map(|w| [polygon[0], w[0], w[1]]));
        }
        out
    }
}

/// Returns the part of a convex polygon where the linear function `depth` is not negative; corners beyond it
/// by `slack` at most do not count as beyond if all of them are.
fn clip(polygon: Vec<Point3<f64>>, depth: &dyn Fn(&Point3<f64>) -> f64, slack: f64) -> Vec<Point3<f64>> {
    if polygon.iter().all(|x| depth(x) >= -slack) {
        return polygon;
    }
    let mut out = Vec::with_capacity(polygon.len() + 1);
    for (k, a) in polygon.iter().enumerate() {
        let b = &polygon[(k + 1) % polygon.len()];
        let (s, t) = (depth(a), depth(b));
        if s >= 0.0 {
            out.push(*a);
        }
        if (s >= 0.0) != (t >= 0.0) {
            out.push(a + (b - a) * (s / (s - t)));
        }
    }
    out
}

/// Returns the triangles with their longest edges halved until none is longer than `edge` \[m\].
pub(super) fn refined(triangles: Vec<Triangle>, edge: f64) -> Vec<Triangle> {
    let (mut coarse, mut out) = (triangles, Vec::new());
    while let Some([a, b, c]) = coarse.pop() {
        // The same cyclic order keeps the side that faces outwards.
        let turned = [[a, b, c], [b, c, a], [c, a, b]];
        let length = |t: &Triangle| (t[1] - t[0]).norm();
        let longest = turned.into_iter().max_by(|s, t| length(s).total_cmp(&length(t)));
        let [a, b, c] = longest.unwrap_or([a, b, c]);
        if (b - a).norm() <= edge {
            out.push([a, b, c]);
        } else {
            let middle = arlequin::core::nalgebra::center(&a, &b);
            coarse.extend([[a, middle, c], [middle, b, c]]);
        }
    }
    out
}

/// Returns the share of the triangles' area that has no sphere below it: no centre of `points` lies in its
/// cell of the size of a mean diameter \[m\], nor beside it.
pub(super) fn bare_share(triangles: Vec<Triangle>, points: &[Point3<f64>], diameter: f64) -> f64 {
    let cell = |x: &Point3<f64>| [x.x, x.y, x.z].map(|c| (c / diameter).floor() as i64);
    let filled: BTreeSet<[i64; 3]> = points.iter().map(cell).collect();
    let is_bare = |t: &Triangle| {
        let [i, j, k] = cell(&centre(t));
        let beside = |n: i64| [i + n / 9 - 1, j + n / 3 % 3 - 1, k + n % 3 - 1];
        !(0..27).any(|n| filled.contains(&beside(n)))
    };
    let (mut bare, mut whole) = (0.0, 0.0);
    for t in refined(triangles, diameter) {
        let area = area_vector(&t).norm();
        whole += area;
        bare += if is_bare(&t) { area } else { 0.0 };
    }
    bare / whole
}

/// Returns a triangle as a facet without nodes.
pub(super) fn facet(t: &Triangle) -> SurfaceFacet<f64> {
    let vector = area_vector(t);
    SurfaceFacet {
        nodes: Vec::new(),
        shares: vec![vector.norm()],
        centre: centre(t),
        // A triangle without area has no direction, and carries nothing.
        normal: vector.try_normalize(0.0).unwrap_or_default(),
    }
}

/// Area \[m²\] times outward normal.
fn area_vector([a, b, c]: &Triangle) -> Vector3<f64> {
    (b - a).cross(&(c - a)) * 0.5
}

fn centre([a, b, c]: &Triangle) -> Point3<f64> {
    Point3::from((a.coords + b.coords + c.coords) / 3.0)
}

fn triangles(surface: &Surface) -> Vec<Triangle> {
    let corner = |k: u32| Point3::from(surface.vertices()[k as usize]);
    surface.triangles().iter().map(|t| t.map(corner)).collect()
}

/// Name of the mantle of a cylinder.
const SIDE: &str = "side";

fn cuboid(low: [f64; 3], high: [f64; 3]) -> BTreeMap<String, Vec<Triangle>> {
    let ends = [low, high];
    let mut out = BTreeMap::new();
    for (c, axis) in ["x", "y", "z"].into_iter().enumerate() {
        for (end, name) in ["min", "max"].into_iter().enumerate() {
            // Corners counter-clockwise about the axis.
            let corner = |[u, v]: [usize; 2]| {
                let mut x = Point3::origin();
                (x[c], x[(c + 1) % 3], x[(c + 2) % 3]) =
                    (ends[end][c], ends[u][(c + 1) % 3], ends[v][(c + 2) % 3]);
                x
            };
            let [p, q, r, s] = [[0, 0], [1, 0], [1, 1], [0, 1]].map(corner);
            let outwards = |t: [Point3<f64>; 3]| if end == 1 { t } else { [t[0], t[2], t[1]] };
            out.insert(
                format!("{axis}-{name}"),
                vec![outwards([p, q, r]), outwards([p, r, s])],
            );
        }
    }
    out
}

fn cylinder(from: &Point3<f64>, length: f64, radius: f64) -> BTreeMap<String, Vec<Triangle>> {
    let angle = TAU / SIDES as f64;
    // The area of the polygon, `n r² sin(a)/2`, becomes that of the circle.
    let radius = radius * (angle / angle.sin()).sqrt();
    let rim = |k: usize, x: f64| {
        // The last side ends at the first corner with the same bits, so that the surface is closed.
        let a = angle * (k % SIDES) as f64;
        from + Vector3::new(x, radius * a.cos(), radius * a.sin())
    };
    let (low, high) = (*from, from + Vector3::x() * length);
    let fan = |k: usize| {
        let [a, b, c, d] = [rim(k, 0.0), rim(k + 1, 0.0), rim(k, length), rim(k + 1, length)];
        ([low, b, a], [high, c, d], [[a, b, c], [b, d, c]])
    };
    let mut out: BTreeMap<String, Vec<Triangle>> = BTreeMap::new();
    let mut add = |name: &str, t: &[Triangle]| out.entry(name.to_owned()).or_default().extend(t);
    for (first, last, side) in (0..SIDES).map(fan) {
        add("x-min", &[first]);
        add("x-max", &[last]);
        add(SIDE, &side);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::setup::spread::distribute;

    /// Spheres of three sizes at the mantle of a cylinder under a pressure: each is pushed towards the
    /// axis, in proportion to its section.
    #[test]
    fn a_pressure_on_a_mantle_pushes_each_sphere_along_its_own_normal() {
        let mantle = cylinder(&Point3::origin(), 4.0, 2.0)
            .remove(SIDE)
            .expect("a mantle");
        let facets: Vec<SurfaceFacet<f64>> = mantle.iter().map(facet).collect();
        let faces = Faces::new(mantle);
        let angles = [0.1, 1.3, 2.9, 4.0, 5.5];
        let radii: Vec<f64> = (0..5).map(|k| 0.2 + 0.1 * f64::from(k % 3)).collect();
        let place = |(a, r): (&f64, &f64)| {
            let out = 2.0 - r;
            Point3::new(1.0 + a / 3.0, out * a.cos(), out * a.sin())
        };
        let points: Vec<Point3<f64>> = angles.iter().zip(&radii).map(place).collect();
        let touching: Vec<(usize, usize)> = (0..5).map(|k| (k, faces.nearest(&points[k]).0)).collect();
        let pushed = distribute(&touching, (&points, &radii), &facets, &|f| f.normal * -3.0);
        let sections: f64 = radii.iter().map(|r| r * r).sum();
        for (k, carrier) in &pushed.0 {
            let share = TAU * 2.0 * 4.0 * radii[*k].powi(2) / sections;
            let inwards = -Vector3::new(0.0, angles[*k].cos(), angles[*k].sin());
            let error = (carrier.force - inwards * 3.0 * share).norm() / (3.0 * share);
            // Half a side of the polygon turns the normal by 1/80.
            assert!(error < 0.03, "{k}: {error}");
        }
    }

    /// Refined triangles keep area and direction; half of a face without spheres counts as half.
    #[test]
    fn a_face_without_spheres_is_bare() {
        let face = cuboid([0.0; 3], [8.0, 8.0, 1.0]).remove("z-max").expect("a face");
        let fine = refined(face.clone(), 0.3);
        let sum: Vector3<f64> = fine.iter().map(area_vector).sum();
        assert!((sum - Vector3::z() * 64.0).norm() < 1e-12, "{sum:?}");
        let edges = fine
            .iter()
            .flat_map(|t| [(0, 1), (1, 2), (2, 0)].map(|(a, b)| (t[b] - t[a]).norm()));
        assert!(edges.fold(0.0, f64::max) <= 0.3);
        let spheres = |rows: usize| -> Vec<Point3<f64>> {
            let place = |k: usize| Point3::new((k / 8) as f64 + 0.5, (k % 8) as f64 + 0.5, 0.5);
            (0..8 * rows).map(place).collect()
        };
        assert!(bare_share(face.clone(), &spheres(8), 1.0) <= 0.0);
        // The row beside the last spheres counts as covered.
        let bare = bare_share(face, &spheres(4), 1.0);
        assert!((bare - 3.0 / 8.0).abs() < 1e-9, "{bare}");
    }
}
