//! Checks of a set of nodes before any expensive computation.

use super::{Domain, ON_BOUNDARY, largest_coordinate};
use crate::circumcentre::circumcentre;
use crate::error::{Error, Result};
use crate::natural::{Interpolant, Scratch};
use nalgebra::{Point3, Vector3};

/// Distance from a sphere, relative to its radius, up to which a node counts as lying on it.
const ON_SPHERE: f64 = 1e-12;
/// Number of sample points at which natural neighbours are counted.
const SAMPLES: usize = 32;
/// Mean number of natural neighbours above which a domain or its cells are refused.
const MOST_NEIGHBOURS: f64 = 1000.0;
/// Largest product of the number of nodes and the mean number of natural neighbours. Time and memory grow
/// with this product: 4e6 takes about 20 s and 1 GB.
const MOST_PAIRS: f64 = 4e6;
/// Mean number of natural neighbours above which a model warns. Random nodes have 16, grids 8 to 27.
const MANY_NEIGHBOURS: f64 = 100.0;

/// Number of natural neighbours that the points of a domain have.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Neighbours {
    /// Mean over sample points inside \[–\].
    pub mean: f64,
    /// Number of nodes on constrained faces.
    pub on_surface: usize,
    /// Number of all nodes.
    pub nodes: usize,
}

impl Neighbours {
    /// Returns a warning if points have more than 100 natural neighbours on average, else `None`. Nodes on
    /// the surface with hardly any inside are neighbours of one another right across the body.
    pub fn warning(&self) -> Option<String> {
        (self.mean > MANY_NEIGHBOURS).then(|| {
            format!(
                "a point inside has {:.0} natural neighbours on average (16 in scattered nodes): {} of {} nodes lie on \
                 the surface; the stiffness is nearly full and the field inside coarse: add nodes inside, as dense as on \
                 the surface",
                self.mean, self.on_surface, self.nodes
            )
        })
    }
}

/// Returns an error for nodes that span no volume (on a line or in a plane, exactly or up to the round-off of
/// their coordinates) and for more than 1000 nodes that all lie on one sphere.
pub(super) fn check_span(points: &[Point3<f64>]) -> Result<()> {
    let nodes = points.len();
    let limit = ON_BOUNDARY * largest_coordinate(points);
    let Some(a) = points.first() else { return Ok(()) };
    // `Delaunay::new` reports these cases.
    if nodes < 4 || !limit.is_finite() {
        return Ok(());
    }
    // Each time the farthest point, so that line and plane are as well determined as possible.
    let farthest = |distance: &dyn Fn(&Point3<f64>) -> f64| {
        let candidates = points.iter().map(|p| (distance(p), p));
        candidates.fold((0.0, a), |x, y| if y.0 > x.0 { y } else { x })
    };
    let (length, b) = farthest(&|p| (p - a).norm());
    if length == 0.0 {
        return Ok(());
    }
    let u: Vector3<f64> = (b - a) / length;
    let (width, c) = farthest(&|p| u.cross(&(p - a)).norm());
    if width <= limit {
        return Err(Error::AllCollinear { nodes });
    }
    let n = u.cross(&(c - a)) / width;
    let (height, d) = farthest(&|p| n.dot(&(p - a)).abs());
    // Below the tolerance every tetrahedron of these nodes would be flat.
    if height <= limit {
        return Err(Error::AllCoplanar { nodes });
    }
    let (to_centre, _) = circumcentre([a, b, c, d]);
    check_sphere(points, &(a + to_centre), to_centre.norm())
}

/// Returns an error if more than 1000 nodes all lie on one sphere.
fn check_sphere(points: &[Point3<f64>], centre: &Point3<f64>, radius: f64) -> Result<()> {
    // Checked before the complex is built: the sphere through any four of the nodes holds all points inside,
    // which would be neighbours of every node.
    let is_off = |p: &Point3<f64>| ((p - centre).norm() - radius).abs() > ON_SPHERE * radius;
    let nodes = points.len();
    if nodes as f64 <= MOST_NEIGHBOURS || points.iter().any(is_off) {
        return Ok(());
    }
    Err(Error::TooManyNeighbours {
        mean: nodes as f64,
        limit: MOST_NEIGHBOURS,
        on_surface: nodes,
        nodes,
    })
}

impl Domain {
    /// Counts the natural neighbours at sample points inside.
    pub fn neighbours(&self) -> Neighbours {
        // Evenly spaced elements: the same samples in every run, and a fixed cost for any size.
        let elements: Vec<[usize; 4]> = self.elements().collect();
        let step = elements.len().div_ceil(SAMPLES).max(1);
        let (mut scratch, mut sum, mut count) = (Scratch::new(), 0, 0);
        for t in elements.iter().step_by(step) {
            let middle = t.iter().map(|&v| self.nodes()[v].coords).sum::<Vector3<f64>>() * 0.25;
            // Samples outside by round-off do not count; Laplace functions are the cheaper kind.
            if let Ok(row) = self.shape(Interpolant::Laplace, &middle.into(), &mut scratch) {
                sum += row.nodes.len();
                count += 1;
            }
        }
        let mut on_surface = vec![false; self.nodes().len()];
        self.mesh
            .faces
            .iter()
            .flat_map(|f| f.v)
            .for_each(|v| on_surface[v as usize] = true);
        Neighbours {
            mean: f64::from(sum as u32) / f64::from(count.max(1)),
            on_surface: on_surface.iter().filter(|s| **s).count(),
            nodes: self.nodes().len(),
        }
    }

    /// Returns an error if points have too many natural neighbours on average: more than 1000 for small sets
    /// of nodes, fewer the more nodes there are, but never fewer than 100.
    pub(crate) fn check_neighbours(&self) -> Result<()> {
        let neighbours = self.neighbours();
        // Few nodes may have many neighbours each; many nodes must have few, since the product is the cost.
        let limit = (MOST_PAIRS / neighbours.nodes as f64).clamp(MANY_NEIGHBOURS, MOST_NEIGHBOURS);
        if neighbours.mean > limit {
            return Err(Error::TooManyNeighbours {
                mean: neighbours.mean,
                limit,
                on_surface: neighbours.on_surface,
                nodes: neighbours.nodes,
            });
        }
        Ok(())
    }
}
