//! Key `dem.notch`: boxes, planes, discs and closed surfaces that cut the bonds which cross them.

use super::faces::Faces;
use super::files::surface;
use crate::error::{Result, key, value};
use crate::spec::Notch;
use arlequin::core::geometry::bounds_of;
use arlequin::core::nalgebra::{Point3, Unit, Vector3};
use arlequin::dem_beam::Surface;
use arlequin::dem_beam::packing::Packing;
use std::path::Path;

const ALL_BONDS: &str = "takes every bond of the body; make it a thin notch that crosses a part of the body";
const BESIDE: &str =
    "crosses no bond: it lies beside the shape, or its plane beside its box; move it or check the units (m)";

/// The form of a notch \[m\].
#[derive(Debug, Clone)]
enum Form {
    /// Lowest and highest corner; infinite along directions without a limit.
    Box([Vector3<f64>; 2]),
    /// A plane of half this thickness, in a box.
    Plane(Slab, [Vector3<f64>; 2]),
    /// A disc of this radius.
    Disc(Slab, f64),
    /// The inside of a closed surface, and its triangles.
    Solid(Box<(Surface, Faces)>),
}

/// The points within half a thickness of a plane.
#[derive(Debug, Clone)]
struct Slab {
    point: Vector3<f64>,
    normal: Unit<Vector3<f64>>,
    half: f64,
}

/// A notch of a scene. Bonds that cross it are cut.
#[derive(Debug, Clone)]
pub struct Knife {
    /// Key of the notch.
    path: String,
    form: Form,
}

/// Reads the notches of a table; file names are relative to `folder`.
///
/// # Errors
/// Keys that are missing or exclude each other, sizes out of range, surfaces that are not closed.
pub fn knives(path: &str, notches: &[Notch], folder: &Path) -> Result<Vec<Knife>> {
    let knife = |(k, notch): (usize, &Notch)| {
        let path = format!("{path}.dem.notch[{k}]");
        form(&path, notch, folder).map(|form| Knife { path, form })
    };
    notches.iter().enumerate().map(knife).collect()
}

fn form(path: &str, notch: &Notch, folder: &Path) -> Result<Form> {
    if notch.scale.is_some() && notch.file.is_none() {
        return Err(key(format!("{path}.scale"), "is of a file; remove it"));
    }
    match (notch.low, notch.high, &notch.plane, &notch.disc, &notch.file) {
        (Some(low), Some(high), None, None, None) => Ok(Form::Box(corners(path, low, high)?)),
        (None, None, Some(p), None, None) => {
            let path = format!("{path}.plane");
            let everywhere = [-f64::INFINITY, f64::INFINITY].map(Vector3::repeat);
            let part = p.within.map_or(Ok(everywhere), |b| {
                corners(&format!("{path}.within"), b.low, b.high)
            })?;
            Ok(Form::Plane(slab(&path, p.point, p.normal, p.thickness)?, part))
        }
        (None, None, None, Some(d), None) => {
            let path = format!("{path}.disc");
            if !(d.radius > 0.0 && d.radius.is_finite()) {
                return Err(value(format!("{path}.radius"), d.radius, "must be positive [m]"));
            }
            Ok(Form::Disc(
                slab(&path, d.centre, d.normal, d.thickness)?,
                d.radius,
            ))
        }
        (None, None, None, None, Some(file)) => {
            let (path, scale) = (format!("{path}.file"), notch.scale.unwrap_or(1.0));
            let solid = surface(&path, &folder.join(file), scale)?;
            let corner = |k: u32| Point3::from(solid.vertices()[k as usize]);
            let triangles = solid.triangles().iter().map(|t| t.map(corner)).collect();
            Ok(Form::Solid(Box::new((solid, Faces::new(triangles)))))
        }
        _ => Err(key(
            path,
            "needs exactly one of low with high (a box), plane, disc, file (a closed surface)",
        )),
    }
}

fn slab(path: &str, point: [f64; 3], normal: [f64; 3], thickness: Option<f64>) -> Result<Slab> {
    let normal = Unit::try_new(Vector3::from(normal), 0.0)
        // An infinite component makes a direction of NaN.
        .filter(|n| n.iter().all(|c| c.is_finite()))
        .ok_or_else(|| key(format!("{path}.normal"), "has no direction; take [0, 1, 0]"))?;
    match thickness.unwrap_or(0.0) {
        t if t >= 0.0 && t.is_finite() => Ok(Slab {
            point: Vector3::from(point),
            normal,
            half: 0.5 * t,
        }),
        t => Err(value(format!("{path}.thickness"), t, "must not be negative [m]")),
    }
}

fn corners(path: &str, low: [f64; 3], high: [f64; 3]) -> Result<[Vector3<f64>; 2]> {
    match (0..3).find(|&c| high[c] < low[c]) {
        Some(c) => Err(value(
            format!("{path}.high[{c}]"),
            high[c],
            &format!("must not be below low[{c}] = {} m", low[c]),
        )),
        None => Ok([Vector3::from(low), Vector3::from(high)]),
    }
}

/// The part of a segment `a + s d` between two values of `s`.
#[derive(Clone, Copy)]
struct Span(f64, f64);

impl Span {
    const WHOLE: Self = Self(0.0, 1.0);

    /// Restricts the span to where `a + s d` lies between two limits.
    fn between(self, a: f64, d: f64, low: f64, high: f64) -> Option<Self> {
        // The segment is parallel to the limits: it lies between them or misses them.
        if d.abs() < f64::MIN_POSITIVE {
            return (a >= low && a <= high).then_some(self);
        }
        // `d` may be negative: the segment then enters by the upper limit.
        let (s, t) = ((low - a) / d, (high - a) / d);
        let out = Self(self.0.max(s.min(t)), self.1.min(s.max(t)));
        (out.0 <= out.1).then_some(out)
    }

    fn in_box(
        self,
        from: &Vector3<f64>,
        along: &Vector3<f64>,
        [low, high]: &[Vector3<f64>; 2],
    ) -> Option<Self> {
        (0..3).try_fold(self, |span, c| span.between(from[c], along[c], low[c], high[c]))
    }

    fn in_slab(self, from: &Vector3<f64>, along: &Vector3<f64>, slab: &Slab) -> Option<Self> {
        let (a, d) = (slab.normal.dot(&(from - slab.point)), slab.normal.dot(along));
        self.between(a, d, -slab.half, slab.half)
    }

    /// Restricts the span to a cylinder about the normal of a slab.
    fn in_cylinder(
        self,
        from: &Vector3<f64>,
        along: &Vector3<f64>,
        slab: &Slab,
        radius: f64,
    ) -> Option<Self> {
        let across = |v: Vector3<f64>| v - slab.normal.into_inner() * slab.normal.dot(&v);
        let (a, d) = (across(from - slab.point), across(*along));
        let (square, half, rest) = (d.norm_squared(), a.dot(&d), a.norm_squared() - radius * radius);
        // Parallel to the axis: its distance from the axis is the same all along.
        if square < f64::MIN_POSITIVE {
            return (rest <= 0.0).then_some(self);
        }
        // `half` is half of the linear coefficient, so that no factor of four appears.
        let root = half * half - square * rest;
        if root < 0.0 {
            return None;
        }
        let out = Self(
            self.0.max((-half - root.sqrt()) / square),
            self.1.min((-half + root.sqrt()) / square),
        );
        (out.0 <= out.1).then_some(out)
    }
}

impl Knife {
    /// Key of the notch in the scene.
    pub(super) fn path(&self) -> &str {
        &self.path
    }

    /// Returns whether the notch lies beside a box with these corners.
    pub(super) fn is_beside(&self, ends: &[Vector3<f64>; 2]) -> bool {
        self.covers(ends).0
    }

    /// Returns whether a bond between two centres crosses the notch.
    pub(super) fn crosses(&self, from: &Vector3<f64>, to: &Vector3<f64>) -> bool {
        let along = to - from;
        let span = match &self.form {
            Form::Box(ends) => Span::WHOLE.in_box(from, &along, ends),
            Form::Plane(slab, ends) => {
                let span = Span::WHOLE.in_slab(from, &along, slab);
                span.and_then(|s| s.in_box(from, &along, ends))
            }
            Form::Disc(slab, radius) => {
                let span = Span::WHOLE.in_slab(from, &along, slab);
                span.and_then(|s| s.in_cylinder(from, &along, slab, *radius))
            }
            Form::Solid(solid) => {
                let (surface, faces) = &**solid;
                let ends = [Point3::from(*from), Point3::from(*to)];
                // Last, since a segment with an end inside needs no test of triangles. A segment that crosses
                // a thin solid has both ends outside.
                let meets = || faces.any_near(&bounds_of(ends.iter()), &|t| pierces(from, &along, t));
                return surface.contains(from) || surface.contains(to) || meets();
            }
        };
        span.is_some()
    }

    /// Returns whether the notch lies beside a shape between two corners, and whether it covers all of it.
    fn covers(&self, ends: &[Vector3<f64>; 2]) -> (bool, bool) {
        let [from, to] = ends;
        let beside = |[low, high]: &[Vector3<f64>; 2]| (0..3).any(|c| low[c] > to[c] || high[c] < from[c]);
        let beyond = |slab: &Slab, ends: &[Vector3<f64>; 2]| {
            let corner = |k: usize| Vector3::from_fn(|c, _| ends[k >> c & 1][c]);
            // A linear function takes its extreme values at corners of the box.
            let heights = (0..8).map(|k| slab.normal.dot(&(corner(k) - slab.point)));
            let (low, high) = heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), h| {
                (a.min(h), b.max(h))
            });
            (
                low > slab.half || high < -slab.half,
                low >= -slab.half && high <= slab.half,
            )
        };
        match &self.form {
            Form::Box(sides) => {
                let [low, high] = sides;
                let over = (0..3).all(|c| low[c] <= from[c] && high[c] >= to[c]);
                (beside(sides), over)
            }
            Form::Plane(slab, part) => {
                let [low, high] = part;
                // The part of the body in the box of the plane: the plane may cross the body beside it.
                let (off, over) = beyond(slab, &[from.sup(low), to.inf(high)]);
                let whole = (0..3).all(|c| low[c] <= from[c] && high[c] >= to[c]);
                (off || beside(part), over && whole)
            }
            Form::Disc(slab, radius) => {
                // The bounding box of a disc reaches `R √(1 − n_c²)` along axis `c`.
                let reach = slab
                    .normal
                    .map(|n| radius * (1.0 - n * n).max(0.0).sqrt() + slab.half * n.abs());
                (
                    beyond(slab, ends).0 || beside(&[slab.point - reach, slab.point + reach]),
                    false,
                )
            }
            Form::Solid(solid) => {
                let (low, high) = solid.0.bounds();
                (beside(&[low, high]), false)
            }
        }
    }
}

/// Returns whether the segment `from + s along` meets a triangle (Möller and Trumbore).
fn pierces(from: &Vector3<f64>, along: &Vector3<f64>, triangle: &[Point3<f64>; 3]) -> bool {
    // Möller and Trumbore: barycentric coordinates from triple products, without the plane of the triangle.
    let [a, b, c] = triangle.map(|p| p.coords);
    let (u, v) = (b - a, c - a);
    let p = along.cross(&v);
    let volume = u.dot(&p);
    // The segment is parallel to the triangle, or the triangle has no area.
    if volume.abs() < f64::MIN_POSITIVE {
        return false;
    }
    let t = from - a;
    let first = t.dot(&p) / volume;
    let q = t.cross(&u);
    let second = along.dot(&q) / volume;
    let place = v.dot(&q) / volume;
    first >= 0.0 && second >= 0.0 && first + second <= 1.0 && (0.0..=1.0).contains(&place)
}

/// Refuses notches that cannot leave a cut body: beside a shape between the corners `ends`, or over all of
/// it.
pub(super) fn check(knives: &[Knife], ends: [Vector3<f64>; 2]) -> Result<()> {
    for knife in knives {
        let rule = match knife.covers(&ends) {
            (true, _) => BESIDE,
            (_, true) => ALL_BONDS,
            _ => continue,
        };
        let [from, to] = &ends;
        let place = format!(
            "{rule}; the shape reaches from {:?} to {:?} m",
            from.as_slice(),
            to.as_slice()
        );
        return Err(key(&*knife.path, place));
    }
    Ok(())
}

/// Removes the bonds that cross a notch, and the spheres that lose their connection. The packing lies at
/// `shift` in the frame of the notches \[m\].
///
/// # Errors
/// A notch that crosses no bond, or every bond.
pub fn cut(knives: &[Knife], shift: &Vector3<f64>, packing: &mut Packing) -> Result<()> {
    for (k, knife) in knives.iter().enumerate() {
        let crosses = |from: &Vector3<f64>, to: &Vector3<f64>| knife.crosses(&(from + shift), &(to + shift));
        if packing.cut(crosses).bonds == 0 {
            let rule = match k {
                0 => "crosses no bond; enlarge it or check the units (m)",
                _ => {
                    "crosses no bond that the notches before it have left; remove it if it lies in one of them, else enlarge it \
                     or check the units (m)"
                }
            };
            return Err(key(&*knife.path, rule));
        }
        if packing.pairs.is_empty() {
            return Err(key(&*knife.path, ALL_BONDS));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spec::{NotchBox, NotchDisc, NotchPlane};
    use arlequin::dem_beam::packing::{Lattice, lattice};

    fn knife(notch: Notch) -> Knife {
        let mut read = knives("model.rock", &[notch], Path::new(".")).expect("a notch");
        read.remove(0)
    }

    fn crosses(knife: &Knife, from: [f64; 3], to: [f64; 3]) -> bool {
        let [from, to] = [from, to].map(Vector3::from);
        let one_way = knife.crosses(&from, &to);
        assert_eq!(one_way, knife.crosses(&to, &from));
        one_way
    }

    #[test]
    fn a_plane_cuts_what_passes_through_it_within_its_box() {
        let plane = |thickness, within| {
            knife(Notch {
                plane: Some(NotchPlane {
                    point: [0.0; 3],
                    normal: [2.0, 2.0, 0.0],
                    thickness,
                    within,
                }),
                ..Notch::default()
            })
        };
        let whole = plane(None, None);
        assert!(crosses(&whole, [1.0, 0.0, 5.0], [0.0, -1.0, 5.0]));
        assert!(!crosses(&whole, [1.0, 0.0, 5.0], [2.0, -1.0, 5.0]));
        // Both ends lie within the thickness.
        let thick = plane(Some(1.0), None);
        assert!(crosses(&thick, [0.3, 0.0, 0.0], [0.0, 0.3, 0.0]));
        assert!(!crosses(&thick, [0.8, 0.0, 0.0], [0.0, 0.8, 0.0]));
        let (low, high) = ([-1.0; 3], [1.0; 3]);
        let part = plane(None, Some(NotchBox { low, high }));
        assert!(crosses(&part, [1.0, 0.0, 0.5], [0.0, -1.0, 0.5]));
        assert!(!crosses(&part, [1.0, 0.0, 5.0], [0.0, -1.0, 5.0]));
    }

    #[test]
    fn a_disc_cuts_up_to_its_radius() {
        let disc = knife(Notch {
            disc: Some(NotchDisc {
                centre: [1.0, 1.0, 1.0],
                normal: [0.0, 0.0, 1.0],
                radius: 0.5,
                thickness: None,
            }),
            ..Notch::default()
        });
        assert!(crosses(&disc, [1.4, 1.0, 0.9], [1.4, 1.0, 1.1]));
        assert!(!crosses(&disc, [1.6, 1.0, 0.9], [1.6, 1.0, 1.1]));
        assert!(crosses(&disc, [1.0, 1.499, 0.9], [1.0, 1.499, 1.1]));
        assert!(!crosses(&disc, [1.0, 1.501, 0.9], [1.0, 1.501, 1.1]));
        // The segment enters the cylinder of the disc, but crosses its plane outside.
        assert!(!crosses(&disc, [1.6, 1.0, 0.98], [1.3, 1.0, 1.7]));
        assert!(crosses(&disc, [1.3, 1.3, 0.0], [1.3, 1.3, 2.0]));
        assert!(!crosses(&disc, [1.4, 1.4, 0.0], [1.4, 1.4, 2.0]));
    }

    #[test]
    fn a_plane_that_misses_its_box_or_the_shape_is_refused_before_packing() {
        let plane = |height: f64, low: f64| {
            let within = Some(NotchBox {
                low: [0.0, low, 0.0],
                high: [6.0, low + 6.0, 2.0],
            });
            knife(Notch {
                plane: Some(NotchPlane {
                    point: [0.0, height, 0.0],
                    normal: [0.0, 1.0, 0.0],
                    thickness: None,
                    within,
                }),
                ..Notch::default()
            })
        };
        let ends = [Vector3::zeros(), Vector3::new(12.0, 6.0, 2.0)];
        assert!(check(&[plane(3.0, 0.0)], ends).is_ok());
        // Its plane crosses the shape, and its box too, but not at the same place.
        for missed in [plane(3.0, 4.0), plane(9.0, 0.0), plane(3.0, 7.0)] {
            let refused = check(&[missed], ends).expect_err("beside").to_string();
            assert!(
                refused.contains("model.rock.dem.notch[0]") && refused.contains("beside"),
                "{refused}"
            );
        }
    }

    #[test]
    fn a_thickness_lies_half_on_each_side_and_a_thin_solid_is_pierced() {
        let slab = knife(Notch {
            plane: Some(NotchPlane {
                point: [0.0; 3],
                normal: [0.0, 0.0, 3.0],
                thickness: Some(1.0),
                within: None,
            }),
            ..Notch::default()
        });
        assert!(crosses(&slab, [0.0, 0.0, 0.49], [1.0, 0.0, 0.6]));
        assert!(!crosses(&slab, [0.0, 0.0, 0.51], [1.0, 0.0, 0.6]));
        let triangle = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]].map(|[x, y]| Point3::new(x, y, 0.5));
        let through = |x: f64, y: f64, from: f64, to: f64| {
            pierces(
                &Vector3::new(x, y, from),
                &Vector3::new(0.0, 0.0, to - from),
                &triangle,
            )
        };
        assert!(through(0.3, 0.3, 0.0, 1.0) && through(0.3, 0.3, 1.0, 0.0));
        // It ends before the triangle, begins behind it, or passes beside it.
        assert!(!through(0.3, 0.3, 0.0, 0.4) && !through(0.3, 0.3, 0.6, 1.0) && !through(0.6, 0.6, 0.0, 1.0));
    }

    /// The inside of a box as a notch.
    fn solid(low: [f64; 3], high: [f64; 3]) -> Knife {
        let corner = |k: usize| Vector3::from_fn(|c, _| [low[c], high[c]][k >> c & 1]);
        let sides = [
            [0, 2, 3, 1],
            [4, 5, 7, 6],
            [0, 1, 5, 4],
            [2, 6, 7, 3],
            [0, 4, 6, 2],
            [1, 3, 7, 5],
        ];
        let halves = sides.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]);
        let surface = Surface::oriented((0..8).map(corner).collect(), halves.collect()).expect("closed");
        let at = |k: u32| Point3::from(surface.vertices()[k as usize]);
        let faces = Faces::new(surface.triangles().iter().map(|t| t.map(at)).collect());
        Knife {
            path: "model.rock.dem.notch[0]".to_owned(),
            form: Form::Solid(Box::new((surface, faces))),
        }
    }

    #[test]
    fn a_closed_surface_takes_what_lies_in_it_enters_it_or_passes_through_it() {
        let notch = solid([0.0; 3], [4.0, 4.0, 0.2]);
        // Both ends inside: no face is met.
        assert!(crosses(&notch, [1.0, 1.0, 0.1], [2.0, 1.5, 0.15]));
        assert!(crosses(&notch, [1.0, 1.1, 0.1], [1.0, 1.1, 1.0]));
        // Both ends outside.
        assert!(crosses(&notch, [1.0, 1.1, -1.0], [1.3, 1.2, 1.0]));
        assert!(!crosses(&notch, [1.0, 1.1, 0.3], [1.3, 1.2, 1.0]));
        assert!(!crosses(&notch, [4.3, 1.1, -1.0], [4.1, 1.2, 1.0]));
    }

    /// The frame of a cylinder begins at its axis, that of its notches is the scene.
    #[test]
    fn a_packing_is_cut_where_the_notch_lies_in_the_scene() {
        let shift = Vector3::new(100.0, -7.0, 3.0);
        let plane = knife(Notch {
            plane: Some(NotchPlane {
                point: [104.3, 0.0, 0.0],
                normal: [1.0, 0.0, 0.0],
                thickness: None,
                within: None,
            }),
            ..Notch::default()
        });
        let mut packing = lattice(Lattice::Cubic, [8, 2, 2], 0.5).expect("a lattice");
        let along = |p: &[u32; 2]| p.map(|i| packing.positions[i as usize].x + shift.x);
        let expected = packing.pairs.iter().filter(|p| {
            let [a, b] = along(p);
            a.min(b) < 104.3 && a.max(b) > 104.3
        });
        let (expected, before) = (expected.count(), packing.pairs.len());
        assert_eq!(expected, 4);
        cut(std::slice::from_ref(&plane), &shift, &mut packing).expect("a cut");
        assert_eq!(packing.pairs.len(), before - expected);
        let beside = cut(&[plane], &Vector3::zeros(), &mut packing).expect_err("beside");
        assert!(beside.to_string().contains("crosses no bond"), "{beside}");
    }
}
