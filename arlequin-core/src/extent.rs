//! Extent of a model or a mediator: whether a point lies inside, near the surface, or outside.

use crate::Real;
use crate::field::{Interpolation, ShapeRow};
use crate::geometry::{BoxTree, Cell, HalfSpace, Sample, bounds_of};
use crate::weight::Changed;
use nalgebra::{Point3, Vector3};

/// Largest distance between the surfaces of two meshes of one body, relative to the sum of their element
/// lengths. A square and a regular polygon of equal area differ by 0.12 of it, polygons of more sides by
/// less.
const FACETS: f64 = 0.15;
/// Distance from a particle centre up to which a point lies in a hole of the packing, in radii of a ball with
/// the volume of the largest particle. Balls of these volumes overlap, and a hole is at most one more radius
/// deep.
const HOLE: f64 = 2.0;
/// Distance from a particle centre up to which a point lies in the roughness of walls, edges and corners, in
/// unit of [`HOLE`].
const ROUGH: f64 = 3.0;

/// Position of a point relative to an extent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Cover {
    /// The model is absent at the point.
    Outside,
    /// Near the surface, within its accuracy: the model may count as present or as absent.
    Surface,
    /// Between particles of the model.
    Hole,
    /// The model is present at the point.
    Inside,
}

enum Shape<'a, T: Real> {
    /// Cells with their half-spaces (none for segments) and lengths.
    Cells {
        cells: Vec<Cell<T>>,
        planes: Vec<Vec<HalfSpace<T>>>,
        lengths: Vec<T>,
    },
    /// Particles, the radii of balls of their volumes, and the largest radius.
    Points {
        samples: Vec<Sample<T>>,
        radii: Vec<T>,
        top: T,
    },
    /// Nodes of a field that can only say whether it exists at a point.
    Field {
        field: &'a dyn Interpolation<T>,
        centres: Vec<Point3<T>>,
        spacing: T,
    },
}

/// Region that a field fills.
pub(crate) struct Extent<'a, T: Real> {
    shape: Shape<'a, T>,
    tree: BoxTree<T>,
    bounds: [Point3<T>; 2],
    /// Mean section of lines \[m²\]; `None` for a solid.
    section: Option<T>,
}

impl<'a, T: Real> Extent<'a, T> {
    /// Extent of `particles` if given, else of the field's samples if it has any, else of its cells. With
    /// `near`, its part around the places of which that is true, so that it is exact at these places.
    pub(crate) fn new(
        field: &'a dyn Interpolation<T>,
        particles: Option<&[Sample<T>]>,
        near: Option<&Changed<T>>,
    ) -> Self {
        match particles.or_else(|| field.samples()) {
            Some(samples) => Self::of_particles(samples, near),
            None => Self::of_cells(field, near),
        }
    }

    /// Extent of the cells of a field, or of its nodes if it has no cells.
    pub(crate) fn of_cells(field: &'a dyn Interpolation<T>, near: Option<&Changed<T>>) -> Self {
        let field_cells = field.cells();
        let section = mean_section(&field_cells);
        if field_cells.is_empty() {
            return Self::of_field(field);
        }
        let is_near = |c: &Cell<T>| {
            // Farther than the accuracy of both surfaces together.
            let reach = Vector3::repeat(length(c));
            let [low, high] = c.bounds();
            near.is_none_or(|near| near(&[low - reach, high + reach]))
        };
        let cells: Vec<_> = field_cells
            .into_iter()
            .map(with_unit_section)
            .filter(is_near)
            .collect();
        let planes = cells.iter().map(Cell::half_spaces).collect();
        let lengths: Vec<T> = cells.iter().map(length).collect();
        let boxes = cells.iter().zip(&lengths).map(|(c, h)| {
            // Boxes reach as far as the accuracy of the surface, so that near misses are found.
            let reach = Vector3::repeat(surface_accuracy(c, *h));
            let [low, high] = c.bounds();
            [low - reach, high + reach]
        });
        let shape = |boxes: &Vec<_>| (BoxTree::new(boxes.clone()), bounds_of(boxes.iter().flatten()));
        let (tree, bounds) = shape(&boxes.collect());
        Self {
            shape: Shape::Cells {
                cells,
                planes,
                lengths,
            },
            tree,
            bounds,
            section,
        }
    }

    fn of_particles(samples: &[Sample<T>], near: Option<&Changed<T>>) -> Self {
        // The radius of the ball of this volume: `r³ = ¾ V/π`.
        let third = T::of(0.75 / std::f64::consts::PI);
        let radius = |s: &Sample<T>| (s.measure * third).cbrt();
        let top = samples.iter().map(radius).fold(T::zero(), |m, r| m.max(r));
        // The largest distance at which a particle counts.
        let reach = top * T::of(ROUGH);
        let around = |s: &&Sample<T>| {
            let reach = Vector3::repeat(reach);
            near.is_none_or(|near| near(&[s.point - reach, s.point + reach]))
        };
        let samples: Vec<_> = samples.iter().filter(around).copied().collect();
        let radii: Vec<T> = samples.iter().map(radius).collect();
        let centres: Vec<_> = samples.iter().map(|s| s.point).collect();
        let (tree, bounds) = boxes_around(&centres, &vec![reach; centres.len()]);
        Self {
            shape: Shape::Points { samples, radii, top },
            tree,
            bounds,
            section: None,
        }
    }

    fn of_field(field: &'a dyn Interpolation<T>) -> Self {
        let centres = field.nodes().to_vec();
        let [low, high] = bounds_of(centres.iter());
        let sides = high - low;
        let wide = sides.iter().copied().filter(|s| *s > T::zero());
        let (volume, dimension) = wide.fold((T::one(), 0.0), |(v, d), s| (v * s, d + 1.0));
        let per_node = volume / T::of(centres.len().max(1) as f64);
        // Mean spacing, as if the nodes filled their box evenly.
        let spacing = per_node.powf(T::of(1.0 / f64::max(dimension, 1.0)));
        let (tree, bounds) = boxes_around(&centres, &vec![spacing; centres.len()]);
        Self {
            shape: Shape::Field {
                field,
                centres,
                spacing,
            },
            tree,
            bounds,
            section: None,
        }
    }

    /// Cells; lines have unit section. Empty for an extent without cells.
    pub(crate) fn cells(&self) -> &[Cell<T>] {
        match &self.shape {
            Shape::Cells { cells, .. } => cells,
            _ => &[],
        }
    }

    /// Mean section of the cells \[m²\], if they are lines.
    pub(crate) fn section(&self) -> Option<T> {
        self.section
    }

    /// Measure of the intersection of `cell` with all cells of the extent.
    pub(crate) fn common(&self, cell: &Cell<T>) -> T {
        let mut sum = T::zero();
        self.tree.any(&cell.bounds(), &mut |k| {
            sum += cell
                .intersection(&self.cells()[k])
                .map_or_else(T::zero, |c| c.measure());
            false
        });
        sum
    }

    /// Particles, if the extent consists of particles.
    pub(crate) fn particles(&self) -> Option<&[Sample<T>]> {
        match &self.shape {
            Shape::Points { samples, .. } => Some(samples),
            _ => None,
        }
    }

    /// Returns whether the extent consists of particles.
    pub(crate) fn is_particles(&self) -> bool {
        matches!(self.shape, Shape::Points { .. })
    }

    /// Returns whether a box meets the bounding box of the extent.
    pub(crate) fn meets(&self, [low, high]: &[Point3<T>; 2]) -> bool {
        (0..3).all(|k| self.bounds[0][k] <= high[k] && low[k] <= self.bounds[1][k])
    }

    /// Returns whether a point lies within a distance \[m\] of the cells.
    pub(crate) fn is_within(&self, x: &Point3<T>, distance: T) -> bool {
        let Shape::Cells { cells, planes, .. } = &self.shape else {
            return self.cover(x, T::zero()) != Cover::Outside;
        };
        let reach = Vector3::repeat(distance);
        self.tree.any(&[x - reach, x + reach], &mut |k| {
            distance_to_cell(&cells[k], &planes[k], x) <= distance
        })
    }

    /// Position of a point that belongs to an element of length `own_length` \[m\]; zero for a mere point.
    pub(crate) fn cover(&self, x: &Point3<T>, own_length: T) -> Cover {
        // Faceted surfaces differ by a share of both element lengths.
        let reach = Vector3::repeat(own_length * T::of(FACETS));
        let query = [x - reach, x + reach];
        if !self.meets(&query) {
            return Cover::Outside;
        }
        let mut best = Cover::Outside;
        match &self.shape {
            Shape::Cells {
                cells,
                planes,
                lengths,
            } => {
                self.tree.any(&query, &mut |k| {
                    best = best.max(cover_by_cell(&cells[k], &planes[k], x, [lengths[k], own_length]));
                    // Inside is the best answer: end the search.
                    best == Cover::Inside
                });
            }
            Shape::Points { samples, radii, top } => {
                self.tree.any(&query, &mut |k| {
                    let distance = (x - samples[k].point).norm();
                    best = best.max(if distance <= radii[k] {
                        Cover::Inside
                    } else if distance <= *top * T::of(HOLE) {
                        Cover::Hole
                    } else if distance <= *top * T::of(ROUGH) {
                        Cover::Surface
                    } else {
                        Cover::Outside
                    });
                    best == Cover::Inside
                });
            }
            Shape::Field {
                // A field that knows where it exists is asked itself; its nodes only tell how near it is.
                field,
                centres,
                spacing,
            } => {
                if field.shape_at(x, false, &mut ShapeRow::default()).is_ok() {
                    return Cover::Inside;
                }
                self.tree.any(&query, &mut |k| {
                    if (x - centres[k]).norm() <= *spacing {
                        best = Cover::Surface;
                    }
                    best == Cover::Surface
                });
            }
        }
        best
    }
}

fn boxes_around<T: Real>(centres: &[Point3<T>], radii: &[T]) -> (BoxTree<T>, [Point3<T>; 2]) {
    let boxes: Vec<_> = centres
        .iter()
        .zip(radii)
        .map(|(x, r)| [x - Vector3::repeat(*r), x + Vector3::repeat(*r)])
        .collect();
    let bounds = bounds_of(boxes.iter().flatten());
    (BoxTree::new(boxes), bounds)
}

/// Mean section of lines; `None` unless all cells are lines.
fn mean_section<T: Real>(cells: &[Cell<T>]) -> Option<T> {
    let (mut volume, mut length) = (T::zero(), T::zero());
    for cell in cells {
        let Cell::Segment { section, .. } = cell else {
            return None;
        };
        volume += cell.measure();
        length += cell.measure() / *section;
    }
    (length > T::zero()).then(|| volume / length)
}

/// Gives a line the section one, so that its measure is a length whatever sections the models have.
fn with_unit_section<T: Real>(cell: Cell<T>) -> Cell<T> {
    match cell {
        Cell::Segment { ends, .. } => Cell::Segment {
            ends,
            section: T::one(),
        },
        solid => solid,
    }
}

/// Longest side of a cell's box \[m\].
pub(crate) fn length<T: Real>(cell: &Cell<T>) -> T {
    let [low, high] = cell.bounds();
    (high - low).amax()
}

/// Accuracy of the surface of a cell of length `h` \[m\]; the ends of a line are exact up to round-off.
fn surface_accuracy<T: Real>(cell: &Cell<T>, h: T) -> T {
    match cell {
        Cell::Segment { .. } => h * T::of(1e-9).max(T::epsilon() * T::of(32.0)),
        Cell::Polyhedron(_) => h * T::of(FACETS),
    }
}

/// Distance of a point from a cell \[m\]; a lower bound beside its edges, and not positive inside.
fn distance_to_cell<T: Real>(cell: &Cell<T>, planes: &[HalfSpace<T>], x: &Point3<T>) -> T {
    match cell {
        Cell::Segment { ends: [a, b], .. } => {
            let d = b - a;
            let s = (d.dot(&(x - a)) / d.norm_squared()).clamp(T::zero(), T::one());
            (x - (a + d * s)).norm()
        }
        Cell::Polyhedron(_) => {
            let top = planes.iter().map(|p| p.excess(x));
            top.fold(-T::of(f64::from(f32::MAX)), |m, e| m.max(e))
        }
    }
}

/// Position of a point relative to one cell; `lengths` are those of the cell and of the point's element.
fn cover_by_cell<T: Real>(cell: &Cell<T>, planes: &[HalfSpace<T>], x: &Point3<T>, lengths: [T; 2]) -> Cover {
    // Round-off of coordinates far from the origin counts as well.
    let relative = lengths[0] * T::of(1e-9).max(T::epsilon() * T::of(32.0));
    let exact = relative.max(x.coords.amax() * T::epsilon() * T::of(32.0));
    let reach = match cell {
        Cell::Segment { .. } => exact,
        Cell::Polyhedron(_) => exact.max((lengths[0] + lengths[1]) * T::of(FACETS)),
    };
    let distance = distance_to_cell(cell, planes, x);
    if distance <= exact {
        Cover::Inside
    } else if distance <= reach {
        Cover::Surface
    } else {
        Cover::Outside
    }
}
