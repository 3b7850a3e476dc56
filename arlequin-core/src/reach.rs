//! Continuation of a field beyond its surface, where particles of the other model stick out.
//!
//! The shape functions at a point `x` outside follow from those at a point `a` of the surface and at a point
//! `b`, as far behind the surface as `x` is before it:
//!
//! ```text
//! N(x) = 2 N(a) − N(b),   x = 2 a − b
//! ```
//!
//! They still sum to one and reproduce linear fields, gradients included, so that momenta stay exact.

use crate::field::{Interpolation, ShapeRow, outside};
use crate::geometry::{BoxTree, bounds_of};
use crate::{Error, Real, Result};
use nalgebra::{Point3, Vector3};

/// Number of nearest nodes; their mean position gives the direction into the body.
const NODES: usize = 8;
/// Number of halvings of the distance to the surface, enough to come down to round-off.
const HALVINGS: usize = 50;

/// A field with its linear continuation.
pub(crate) struct Reach<'a, T: Real, F: Interpolation<T> + ?Sized> {
    field: &'a F,
    tree: BoxTree<T>,
    /// Distance at which the search for nodes begins \[m\].
    start: T,
}

impl<'a, T: Real, F: Interpolation<T> + ?Sized> Reach<'a, T, F> {
    pub(crate) fn new(field: &'a F) -> Self {
        let nodes = field.nodes();
        let [low, high] = bounds_of(nodes.iter());
        let count = T::of((nodes.len().max(1)) as f64);
        Self {
            field,
            tree: BoxTree::new(nodes.iter().map(|x| [*x, *x]).collect()),
            start: (high - low).norm() / count.cbrt(),
        }
    }

    /// Shape functions at a point outside of the field. The point must be no farther from the surface than
    /// the mean of the nearest nodes is behind it. `work` holds working buffers.
    ///
    /// # Errors
    /// [`Error::OutsideDomain`] for a point farther away; errors of the field.
    pub(crate) fn shape_at(
        &self,
        x: &Point3<T>,
        gradient: bool,
        row: &mut ShapeRow<T>,
        work: &mut [ShapeRow<T>; 2],
    ) -> Result<()> {
        let nearest = self.nearest(x);
        let count = T::of(nearest.len().max(1) as f64);
        let arms = nearest
            .iter()
            .fold(Vector3::zeros(), |s, k| s + (self.field.nodes()[*k] - x));
        let (way, mut far, mut near) = (arms / count, T::one(), T::zero());
        // The mean of the nearest nodes must be inside, or there is no surface to find on the way.
        if !self.inside(&(x + way), false, &mut work[0])? {
            return Err(outside(x, self.field.kind()));
        }
        // Bisection for the surface between the point (`near`) and the mean of the nodes (`far`).
        for _ in 0..HALVINGS {
            let middle = (far + near) * T::of(0.5);
            if self.inside(&(x + way * middle), false, &mut work[0])? {
                far = middle;
            } else {
                near = middle;
            }
        }
        // As far behind the surface as the point is before it.
        let behind = far + far;
        if behind > T::one()
            || !self.inside(&(x + way * behind), gradient, &mut work[1])?
            || !self.inside(&(x + way * far), gradient, &mut work[0])?
        {
            return Err(outside(x, self.field.kind()));
        }
        row.clear();
        for (k, factor) in [(0, T::of(2.0)), (1, -T::one())] {
            let from = &work[k];
            for (n, &node) in from.nodes.iter().enumerate() {
                let value = from.values[n] * factor;
                let slope = gradient.then(|| from.gradients[n] * factor);
                // Both points may see the same node: add up what it has in either.
                match row.nodes.iter().position(|m| *m == node) {
                    Some(m) => {
                        row.values[m] += value;
                        if let Some(g) = slope {
                            row.gradients[m] += g;
                        }
                    }
                    None => match slope {
                        Some(g) => row.push_with_gradient(node, value, g),
                        None => row.push(node, value),
                    },
                }
            }
        }
        Ok(())
    }

    fn inside(&self, x: &Point3<T>, gradient: bool, row: &mut ShapeRow<T>) -> Result<bool> {
        match self.field.shape_at(x, gradient, row) {
            Ok(()) => Ok(true),
            Err(Error::OutsideDomain { .. }) => Ok(false),
            Err(e) => Err(e),
        }
    }

    /// Up to eight nodes of the field nearest to a point, the nearest first.
    pub(crate) fn nearest(&self, x: &Point3<T>) -> Vec<usize> {
        let nodes = self.field.nodes();
        let wanted = NODES.min(nodes.len());
        let mut nodes_around = Vec::new();
        // Positive unless the point is the only node.
        let apart = nodes.first().map_or(T::zero(), |n| (n - x).norm());
        let mut radius = self.start.max(apart * T::of(1e-3));
        while nodes_around.len() < wanted {
            nodes_around.clear();
            let reach = Vector3::repeat(radius);
            self.tree.any(&[x - reach, x + reach], &mut |k| {
                // Only nodes in the ball: the corners of the box reach farther than its faces, beyond which
                // nearer nodes may lie.
                if (nodes[k] - x).norm() <= radius {
                    nodes_around.push(k);
                }
                false
            });
            radius += radius;
        }
        let distance = |k: &usize| (nodes[*k] - x).norm_squared().as_f64();
        // Equal distances by number, so that the choice is unique.
        nodes_around.sort_by(|a, b| distance(a).total_cmp(&distance(b)).then(a.cmp(b)));
        nodes_around.truncate(wanted);
        nodes_around
    }
}
