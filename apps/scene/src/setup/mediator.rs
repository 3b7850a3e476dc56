//! Meshes of mediators, given in the scene or derived from overlap and bodies.

use super::body::Body;
use super::mesh::Request;
use crate::error::{Result, key};
use crate::setup::{BodyShape, LoweredInterface, OverlapSource};
use crate::spec::{Hole, OverlapShape, RegionShape, Shape};
use arlequin::core::ShapeRow;
use arlequin::fem_ref::generate::Rim;
use std::path::Path;

/// Shape of the mediator: as given, or derived from overlap and models.
pub(super) fn mediator_shape(
    path: &str,
    table: &LoweredInterface,
    models: [&BodyShape; 2],
) -> Result<BodyShape> {
    match (&table.mediator.shape, &table.overlap) {
        (Some(s), _) => Ok(BodyShape::Given(s.clone())),
        (None, OverlapSource::Zone(piece)) => Ok(BodyShape::Piece(piece.clone())),
        (None, OverlapSource::Given(overlap)) => derived_shape(path, overlap, models).map(BodyShape::Given),
    }
}

/// Request for the mediator's mesh; by default its elements are as long as those of the coarse model,
/// `coarse` \[m\].
pub(super) fn mediator<'a>(
    key: &'a str,
    table: &'a LoweredInterface,
    shape: &'a BodyShape,
    coarse: f64,
    folder: &'a Path,
) -> Request<'a> {
    let t = &table.mediator;
    // Files and pieces of a body bring their own elements.
    let brings_elements = shape.is_file() || matches!(shape, BodyShape::Piece(_));
    let free = t.divisions.is_none() && !brings_elements;
    Request {
        key,
        shape,
        spacing: t.spacing.or(free.then_some(coarse)),
        divisions: t.divisions.as_deref(),
        element: t.element,
        // Models and mediator approximate a cylinder by polygons with different numbers of sides. An
        // inscribed mediator does not stick out of the models.
        rim: Rim::Inscribed,
        scale: t.scale.unwrap_or(1.0),
        volume: None,
        cloud: false,
        folder,
    }
}

/// Returns whether the field of a body ends at the hull of its particle centres, about a radius inside the
/// body.
pub(super) fn is_hull(body: &Body) -> bool {
    body.grains.is_some() && body.field.samples().is_none()
}

/// Moves the shape of the mediator inwards, in steps of a tenth of the particle spacing, until its mesh lies
/// within the hull of the particle centres. Only faces on the surface of the particle body move. The hull is
/// convex, so it suffices to test the nodes.
///
/// # Errors
/// A shape that does not fit within 30 steps.
pub(super) fn within_hull(request: Request<'_>, grains: &Body) -> Result<BodyShape> {
    let mut row = ShapeRow::default();
    for step in 1..=30 {
        // Fine steps keep the mediator as large as possible: what it leaves out is untied.
        let inset = 0.1 * f64::from(step) * grains.spacing;
        let shapes = request.shape.in_scene().zip(grains.shape.in_scene());
        let Some(shape) = shapes.and_then(|(shape, body)| moved_inwards(shape, body, inset)) else {
            break;
        };
        let shape = BodyShape::Given(shape);
        let mesh = Request {
            shape: &shape,
            ..request
        }
        .mesh()?;
        let mut nodes = mesh.nodes().iter();
        if nodes.all(|x| grains.field.shape_at(x, false, &mut row).is_ok()) {
            return Ok(shape);
        }
    }
    let rule =
        "no mediator fits into the hull of the particles; give mediator.shape, or dem.field = \"particles\"";
    Err(key(request.key, rule))
}

/// Moves faces on the surface of `body` inwards by `inset` \[m\]; `None` if nothing is left, or unless both
/// shapes are cylinders or both are boxes.
fn moved_inwards(shape: &Shape, body: &Shape, inset: f64) -> Option<Shape> {
    let coincide = |a: f64, b: f64| (a - b).abs() < inset;
    let ends = |low: f64, high: f64, first: f64, last: f64| {
        let low = if coincide(low, first) { first + inset } else { low };
        let high = if coincide(high, last) { last - inset } else { high };
        (high > low).then_some([low, high])
    };
    match (shape, body) {
        (
            Shape::Cylinder { from, length, radius },
            Shape::Cylinder {
                from: first,
                length: whole,
                ..
            },
        ) => {
            let [low, high] = ends(from[0], from[0] + length, first[0], first[0] + whole)?;
            let radius = radius - inset;
            (radius > 0.0).then_some(Shape::Cylinder {
                from: [low, from[1], from[2]],
                length: high - low,
                radius,
            })
        }
        (
            Shape::Box { low, high, hole },
            Shape::Box {
                low: first,
                high: last,
                ..
            },
        ) => {
            let mut corners = [[0.0; 3]; 2];
            for c in 0..3 {
                let [a, b] = ends(low[c], high[c], first[c], last[c])?;
                corners[0][c] = a;
                corners[1][c] = b;
            }
            Some(Shape::Box {
                low: corners[0],
                high: corners[1],
                hole: *hole,
            })
        }
        _ => None,
    }
}

/// Derives the shape of the mediator: the part of the overlap that both models fill.
fn derived_shape(path: &str, overlap: &OverlapShape, shapes: [&BodyShape; 2]) -> Result<Shape> {
    let derived = match (overlap, shapes.map(BodyShape::in_scene)) {
        (OverlapShape::Slab { fine, coarse }, [Some(a), Some(b)]) => layer(fine, coarse, [a, b]),
        (OverlapShape::Shell { core, domain }, [Some(a), Some(b)]) => frame(core, domain, [a, b]),
        (_, [None, _] | [_, None]) => None,
    };
    derived.ok_or_else(|| {
        key(
            path,
            "the mediator cannot be derived from this overlap and these shapes; give mediator.shape",
        )
    })
}

/// Lowest and highest corner of the box that two boxes share.
fn shared([a, b]: [&[f64; 3]; 2], [c, d]: [&[f64; 3]; 2]) -> [[f64; 3]; 2] {
    [
        [0, 1, 2].map(|k| a[k].max(c[k])),
        [0, 1, 2].map(|k| b[k].min(d[k])),
    ]
}

/// Part of a shell of boxes that two boxes share: the outer box with the inner one as a hole.
fn frame(core: &RegionShape, domain: &RegionShape, shapes: [&Shape; 2]) -> Option<Shape> {
    match (core, domain, shapes) {
        (
            RegionShape::Box { low: c0, high: c1 },
            RegionShape::Box { low: d0, high: d1 },
            [
                Shape::Box { low: a, high: b, .. },
                Shape::Box {
                    low: c,
                    high: d,
                    hole: None,
                },
            ],
        ) => {
            let common = shared([a, b], [c, d]);
            let [low, high] = shared([&common[0], &common[1]], [d0, d1]);
            let hole = Some(Hole { low: *c0, high: *c1 });
            Some(Shape::Box { low, high, hole })
        }
        _ => None,
    }
}

/// Layer between two points that two bodies share; `None` unless the points differ along one axis only.
fn layer(fine: &[f64; 3], coarse: &[f64; 3], shapes: [&Shape; 2]) -> Option<Shape> {
    let apart: Vec<usize> = (0..3).filter(|&c| (fine[c] - coarse[c]).abs() > 0.0).collect();
    let &[axis] = apart.as_slice() else {
        return None;
    };
    let (from, to) = (fine[axis].min(coarse[axis]), fine[axis].max(coarse[axis]));
    match shapes {
        [Shape::Bar { section, .. }, Shape::Bar { .. }] if axis == 0 => Some(Shape::Bar {
            from,
            to,
            section: *section,
        }),
        [
            Shape::Cylinder {
                from: a, radius: r, ..
            },
            Shape::Cylinder {
                from: b, radius: s, ..
            },
            // Radii that are meant to be equal may differ in the last digits.
        ] if axis == 0 && a[1..] == b[1..] && (r - s).abs() <= 1e-9 * r => Some(Shape::Cylinder {
            from: [from, a[1], a[2]],
            length: to - from,
            radius: *r,
        }),
        [
            Shape::Box {
                low: a,
                high: b,
                hole: None,
            },
            Shape::Box {
                low: c,
                high: d,
                hole: None,
            },
        ] => {
            let [mut low, mut high] = shared([a, b], [c, d]);
            (low[axis], high[axis]) = (from, to);
            Some(Shape::Box {
                low,
                high,
                hole: None,
            })
        }
        _ => None,
    }
}
