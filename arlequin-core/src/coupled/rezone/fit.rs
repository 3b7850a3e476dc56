//! Least-squares fit of a linear function to the states of fine nodes, and its value at a coarse node.

use crate::field::{Interpolation, ShapeRow};
use crate::geometry::BoxTree;
use crate::reach::Reach;
use crate::{Error, Real, Result};
use nalgebra::{Matrix3, Point3, Vector3};
use std::collections::BTreeSet;

/// Least variance of the positions of fine nodes along an axis, over their mean square distance from the
/// coarse node, for which a slope along the axis is fitted. With less, it would be noise over a small length.
const FLAT: f64 = 0.02;

/// Weighted sums over the fine nodes around a coarse node, with positions from it.
#[derive(Clone)]
pub(super) struct Sums<T: Real> {
    pub(super) weight: T,
    /// Sum of squares of the weights.
    weight_squares: T,
    arm: Vector3<T>,
    square: Matrix3<T>,
    /// Displacement and velocity of the first node, from which the others count: a common motion costs no
    /// digits.
    first: [Vector3<T>; 2],
    value: [Vector3<T>; 2],
    slope: [Matrix3<T>; 2],
    /// Weighted sums of rotations and spins.
    turn: [Vector3<T>; 2],
}

impl<T: Real> Sums<T> {
    pub(super) fn new() -> Self {
        Self {
            weight: T::zero(),
            weight_squares: T::zero(),
            arm: Vector3::zeros(),
            square: Matrix3::zeros(),
            first: [Vector3::zeros(); 2],
            value: [Vector3::zeros(); 2],
            slope: [Matrix3::zeros(); 2],
            turn: [Vector3::zeros(); 2],
        }
    }

    /// Adds a fine node of this weight with its displacement and velocity, its rotation and spin.
    pub(super) fn add(&mut self, weight: T, arm: &Vector3<T>, [x, turn]: [[Vector3<T>; 2]; 2]) {
        if self.weight <= T::zero() {
            self.first = x;
        }
        self.weight += weight;
        self.weight_squares += weight * weight;
        self.arm += arm * weight;
        self.square += arm * arm.transpose() * weight;
        for (k, x) in x.iter().enumerate() {
            let x = (x - self.first[k]) * weight;
            self.value[k] += x;
            self.slope[k] += x * arm.transpose();
            self.turn[k] += turn[k] * weight;
        }
    }

    /// Value at the node of the linear function that fits best; `None` without fine nodes.
    pub(super) fn fit(&self) -> Option<[Vector3<T>; 2]> {
        let lever = self.lever()?;
        Some([0, 1].map(|k| {
            let mean = self.value[k] / self.weight;
            let cross = self.slope[k] / self.weight - mean * lever.middle.transpose();
            // The value at the coarse node, where the arm is zero; coefficients of the fit are not needed.
            let turn = self.turn[k] / self.weight;
            self.first[k] + mean - cross * lever.along - turn.cross(&lever.across)
        }))
    }

    /// Standard deviation of the fitted value if every fine node has an independent error of one: with the
    /// middle `c` of the nodes and their variance `λ` along each axis, `√((1 + Σ c²/λ) Σ w² / (Σ w)²)`. This
    /// is exact for equal weights `w`, and an estimate for others. Infinite without fine nodes.
    pub(super) fn noise(&self) -> T {
        match self.lever() {
            Some(lever) => ((T::one() + lever.extrapolation) * self.weight_squares).sqrt() / self.weight,
            None => T::of(f64::INFINITY),
        }
    }

    fn lever(&self) -> Option<Lever<T>> {
        if self.weight <= T::zero() {
            return None;
        }
        let middle = self.arm / self.weight;
        let spread = self.square / self.weight - middle * middle.transpose();
        let eigen = spread.symmetric_eigen();
        let least = self.square.trace() / self.weight * T::of(FLAT);
        let mut lever = Lever {
            middle,
            along: Vector3::zeros(),
            across: middle,
            extrapolation: T::zero(),
        };
        for (value, axis) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
            let along = axis.dot(&middle);
            if *value > least {
                lever.along += axis * (along / *value);
                lever.across -= axis * along;
            }
            // Rotations of the nodes are no surer than a slope across `least`.
            let variance = value.max(least);
            if variance > T::zero() {
                lever.extrapolation += along * along / variance;
            }
        }
        Some(lever)
    }
}

/// How the value at a coarse node follows from the mean over the fine nodes around it.
struct Lever<T: Real> {
    /// Mean position of the fine nodes, from the coarse node.
    middle: Vector3<T>,
    /// Where fitted slopes act: the middle over the variance, along axes in which the nodes spread.
    along: Vector3<T>,
    /// The rest of the middle, which turns with the nodes, or a body that spins would be strained.
    across: Vector3<T>,
    /// Sum over the axes of the squared middle over the variance.
    extrapolation: T,
}

/// Cones `1 − d / R` at the distance `d` that stand for the hats of coarse nodes. A cone does not cross a gap
/// or a crack: it takes fine nodes in elements that share a node with an element of its coarse node.
pub(super) struct Cones<T: Real> {
    /// Numbers of the coarse nodes, ascending.
    coarse: Vec<usize>,
    centres: Vec<Point3<T>>,
    radii: Vec<T>,
    tree: BoxTree<T>,
    /// Nodes of the elements around each of them.
    rings: Vec<BTreeSet<usize>>,
}

/// Share of the way to another node at which a point lies in an element of the coarse node.
const BESIDE: f64 = 1e-2;

impl<T: Real> Cones<T> {
    /// Builds the cones of the nodes `coarse` of a field (ascending). The radius `R` of a cone is twice the
    /// distance from its node to the nearest other node.
    ///
    /// # Errors
    /// Errors of the field but for points outside of it.
    pub(super) fn new(field: &dyn Interpolation<T>, coarse: &[usize]) -> Result<Self> {
        let (reach, nodes) = (Reach::new(field), field.nodes());
        let centres: Vec<_> = coarse.iter().map(|j| nodes[*j]).collect();
        let (mut radii, mut rings) = (Vec::new(), Vec::new());
        let mut row = ShapeRow::default();
        for (j, x) in coarse.iter().zip(&centres) {
            let arms = reach.nearest(x).into_iter().map(|k| nodes[k] - x);
            // Two nodes may lie at one place, on both sides of a crack.
            let arms: Vec<_> = arms.filter(|arm| arm.norm() > T::zero()).collect();
            let least = arms.iter().map(Vector3::norm).reduce(T::min);
            radii.push(least.unwrap_or_else(T::zero) * T::of(2.0));
            let mut ring = BTreeSet::from([*j]);
            for arm in &arms {
                match field.shape_at(&(x + arm * T::of(BESIDE)), false, &mut row) {
                    Ok(()) if row.nodes.contains(j) => ring.extend(&row.nodes),
                    Ok(()) | Err(Error::OutsideDomain { .. }) => {}
                    Err(e) => return Err(e),
                }
            }
            rings.push(ring);
        }
        let bounds = |(x, r): (&Point3<T>, &T)| [x - Vector3::repeat(*r), x + Vector3::repeat(*r)];
        Ok(Self {
            coarse: coarse.to_vec(),
            tree: BoxTree::new(centres.iter().zip(&radii).map(bounds).collect()),
            centres,
            radii,
            rings,
        })
    }

    /// Adds the nodes of an element to the ring of each of them that has a cone.
    pub(super) fn add_element(&mut self, nodes: &[usize]) {
        for j in nodes {
            if let Ok(k) = self.coarse.binary_search(j) {
                self.rings[k].extend(nodes);
            }
        }
    }

    /// Visits the cones in which a fine node lies, given the nodes of its element, with their number, their
    /// value at the node, and the arm from their centre.
    pub(super) fn visit(&self, x: &Point3<T>, element: &[usize], mut each: impl FnMut(usize, T, Vector3<T>)) {
        self.tree.any(&[*x, *x], &mut |k| {
            let arm = x - self.centres[k];
            let value = T::one() - arm.norm() / self.radii[k];
            if value > T::zero() && element.iter().any(|n| self.rings[k].contains(n)) {
                each(k, value, arm);
            }
            false
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::ParticleField;

    /// Sums over fine nodes at the positions `arms` from the coarse node. Each has the displacement `x(arm)`
    /// and the rotation `turn`; velocities and spins are twice as large.
    fn sums(
        arms: &[Vector3<f64>],
        x: impl Fn(&Vector3<f64>) -> Vector3<f64>,
        turn: Vector3<f64>,
    ) -> Sums<f64> {
        let mut sums = Sums::new();
        for (k, arm) in arms.iter().enumerate() {
            sums.add(1.0 + 0.3 * k as f64, arm, [x(arm), turn].map(|x| [x, 2.0 * x]));
        }
        sums
    }

    /// Displacement of the coarse node by these sums.
    fn fit(
        arms: &[Vector3<f64>],
        x: impl Fn(&Vector3<f64>) -> Vector3<f64>,
        turn: Vector3<f64>,
    ) -> Vector3<f64> {
        let [u, v] = sums(arms, x, turn).fit().expect("nodes");
        assert_eq!(v, 2.0 * u);
        u
    }

    /// One sphere, two, three, four of which a plane has nearly all, and eight.
    fn clouds() -> Vec<Vec<Vector3<f64>>> {
        let x = |a, b, c| Vector3::new(a, b, c);
        let single = vec![x(-0.41, -0.39, 0.58)];
        let two = vec![x(0.3, 0.2, 0.1), x(0.5, 0.7, 0.3)];
        let three = vec![x(0.1, 0.2, 0.4), x(0.6, 0.1, 0.5), x(0.2, 0.7, 0.3)];
        let mut flat = three.clone();
        flat.push(x(0.5, 0.6, 0.41));
        let grid = |k: usize| {
            x(
                0.2 + 0.5 * (k % 2) as f64,
                0.3 + 0.4 * (k / 2 % 2) as f64,
                0.1 + 0.6 * (k / 4) as f64,
            )
        };
        vec![single, two, three, flat, (0..8).map(grid).collect()]
    }

    /// However few nodes are around a coarse node, and however they lie.
    #[test]
    fn a_rigid_motion_is_handed_over_as_it_is() {
        let (flight, turn) = (Vector3::new(3.0, -1.0, 2.0), Vector3::new(0.2, -0.5, 0.7));
        for arms in clouds() {
            let error = fit(&arms, |arm| flight + turn.cross(arm), turn) - flight;
            assert!(error.norm() < 1e-14, "{} nodes: {error}", arms.len());
        }
    }

    /// Eight nodes give the value of a linear field. Noise of the nodes is not enlarged by much, as it would
    /// be if slopes across four nodes nearly in a plane were fitted.
    #[test]
    fn linear_fields_are_fitted_and_noise_is_not_enlarged() {
        let slope = Matrix3::new(0.1, 0.4, -0.2, 0.3, -0.6, 0.5, 0.7, 0.2, -0.3);
        let value = Vector3::new(1.0, 2.0, 3.0);
        let clouds = clouds();
        let error = fit(&clouds[4], |arm| value + slope * arm, Vector3::zeros()) - value;
        assert!(error.norm() < 1e-14, "{error}");
        for arms in clouds {
            for (k, disturbed) in arms.iter().enumerate() {
                let noise = |arm: &Vector3<f64>| {
                    if arm == disturbed {
                        Vector3::x()
                    } else {
                        Vector3::zeros()
                    }
                };
                let gain = fit(&arms, noise, Vector3::zeros()).norm();
                assert!(gain < 2.5, "{} nodes, node {k}: {gain}", arms.len());
            }
        }
    }

    /// The noise is that of a fit in which one node after the other is disturbed.
    #[test]
    fn noise_of_the_value_adds_up_over_the_nodes() {
        let arms = clouds().remove(4);
        let alike = |x: &dyn Fn(&Vector3<f64>) -> Vector3<f64>| {
            let mut sums = Sums::new();
            arms.iter()
                .for_each(|arm| sums.add(2.0, arm, [[x(arm); 2], [Vector3::zeros(); 2]]));
            sums
        };
        let disturbed = |k: usize| {
            let x = |arm: &Vector3<f64>| {
                if *arm == arms[k] {
                    Vector3::x()
                } else {
                    Vector3::zeros()
                }
            };
            alike(&x).fit().expect("nodes")[0].norm_squared()
        };
        let expected = (0..arms.len()).map(disturbed).sum::<f64>().sqrt();
        let noise = alike(&|_| Vector3::zeros()).noise();
        assert!((noise - expected).abs() < 1e-14, "{noise} {expected}");
        // A single node beside the coarse one leaves the slope to its rotation.
        for arms in &clouds()[..3] {
            let noise = sums(arms, |_| Vector3::zeros(), Vector3::zeros()).noise();
            assert!(noise > 1.2, "{} nodes: {noise}", arms.len());
        }
        let alone = sums(&[Vector3::zeros()], |_| Vector3::zeros(), Vector3::zeros());
        assert!((alone.noise() - 1.0).abs() < 1e-15, "{}", alone.noise());
        assert!(Sums::<f64>::new().noise() > f64::MAX);
    }

    #[test]
    fn cones_reach_twice_as_far_as_the_next_coarse_node() {
        let x = |a: f64, b: f64| Point3::new(a, b, 0.0);
        let nodes = vec![x(0.0, 0.0), x(3.0, 0.0), x(-1.0, 0.0), x(0.0, 5.0)];
        let field = ParticleField::new(nodes, &[1.0; 4]).expect("field");
        let mut cones = Cones::new(&field, &[0, 3]).expect("cones");
        let visited = |cones: &Cones<f64>, point: Point3<f64>, element: &[usize]| {
            let mut found = Vec::new();
            cones.visit(&point, element, |k, value, arm| {
                found.push((k, value, arm.x, arm.y));
            });
            found
        };
        for (point, value) in [(x(0.5, 0.0), 0.75), (x(-1.5, 0.0), 0.25), (x(0.0, 1.0), 0.5)] {
            let expected = vec![(0, value, point.x, point.y)];
            assert_eq!(visited(&cones, point, &[0, 1]), expected);
        }
        assert!(visited(&cones, x(2.5, 0.0), &[0, 1]).is_empty());
        // The last one's radius is 10 m, twice the distance to the first.
        let [(k, value, ..)] = visited(&cones, x(0.0, 1.0), &[3])[..] else {
            panic!("not in the cone of node 3");
        };
        assert!(k == 1 && (value - 0.6).abs() < 1e-15, "{k} {value}");
        // Across a gap, an element has no node in common with one of the coarse node, before it has.
        assert!(visited(&cones, x(0.5, 0.0), &[1, 2]).is_empty());
        cones.add_element(&[0, 2]);
        assert_eq!(visited(&cones, x(0.5, 0.0), &[1, 2]).len(), 1);
        assert!(visited(&cones, x(0.5, 0.0), &[1]).is_empty());
    }
}
