//! Displacement jump of an overlap, and the deformation of the overlap with which the jump is compared.
//!
//! The deformation is what remains of the displacements `u` after the nearest rigid motion is subtracted. It
//! is taken over all nodes that multipliers act on, with masses `m` and positions `y` from their common
//! centre:
//!
//! ```text
//! amplitude = max |u − ū − W y|,    ū = Σ m u / Σ m
//! W = ω ×      (tr G − G) ω = Σ m y × u,  G = Σ m y yᵀ     small turns
//! W = R − 1    R: greatest eigenvector of Horn's matrix    turns of any size
//! ```
//!
//! The rotation that leaves the smaller amplitude is taken. A body that flies or turns as a whole has no
//! amplitude, and the directions of the axes do not matter.

use super::ledger::DisplacementJump;
use crate::interface::{Interface, coupled_nodes};
use crate::owned::{Cuts, Owned};
use crate::subdomain::Subdomain;
use crate::{Exact, Real};
use nalgebra::{Matrix3, Matrix4, Quaternion, SymmetricEigen, UnitQuaternion, Vector3};
use std::ops::Range;

/// Units of round-off by which equal displacements may differ, per own step.
const DIGITS: f64 = 16.0;

/// Evaluations without a doubling of the amplitude after which a jump is judged.
const LOOKS: usize = 10;

/// Largest number of iterations in the search for a rotation; three or four are usual.
const SWEEPS: usize = 100;

/// Nodes of an overlap that multipliers act on.
#[derive(Debug)]
pub(super) struct Overlap<T: Real> {
    /// Nodes of the coarse and of the fine side.
    nodes: [Vec<Node<T>>; 2],
    components: usize,
    mass: T,
    /// `Σ m y yᵀ`.
    spread: Matrix3<T>,
    /// Pseudo-inverse of `tr G − G`; zero about an axis on which all nodes lie.
    inverse: Matrix3<T>,
    /// Boundaries between units of summation in the nodes of each side.
    cuts: [Cuts; 2],
    /// Reference node, from whose displacement others are counted: the first node of the coarse side. `None`
    /// if there is none, otherwise whether this rank has it.
    reference_is_local: Option<bool>,
    /// Amplitude at its last doubling, and number of evaluations since then.
    steady: (T, usize),
}

#[derive(Debug)]
struct Node<T: Real> {
    index: usize,
    mass: T,
    /// Position from the common centre \[m\].
    arm: Vector3<T>,
}

/// Rigid motion `base + turn · y`.
#[derive(Debug, Clone, Copy)]
struct Rigid<T: Real> {
    base: Vector3<T>,
    turn: Matrix3<T>,
}

impl<T: Real> Overlap<T> {
    pub(super) fn new(interface: &Interface<T>, subdomains: &[Subdomain<T>]) -> Self {
        let components = interface.components();
        let side = |m: usize| {
            let s = &subdomains[interface.sides()[m]];
            let node = |index: usize| {
                // Nodes can turn only within the directions in which they move.
                let mut arm = s.model().nodes()[index].coords;
                (components..3).for_each(|c| arm[c] = T::zero());
                let mass = s.inertia()[index * components];
                Node { index, mass, arm }
            };
            let nodes = coupled_nodes(&interface.coupling[m], components);
            nodes.into_iter().map(node).collect::<Vec<_>>()
        };
        Self::from_nodes([0, 1].map(side), components)
    }

    /// Builds the overlap from nodes whose arms start at any common point.
    fn from_nodes(mut nodes: [Vec<Node<T>>; 2], components: usize) -> Self {
        let all_nodes = || nodes.iter().flatten();
        let mass: T = all_nodes().map(|n| n.mass).sum();
        let centre = all_nodes().fold(Vector3::zeros(), |c, n| c + n.arm * (n.mass / mass));
        nodes.iter_mut().flatten().for_each(|n| n.arm -= centre);
        let all_nodes = nodes.iter().flatten();
        let spread = all_nodes.fold(Matrix3::zeros(), |g, n| g + n.arm * n.arm.transpose() * n.mass);
        let inertia = Matrix3::from_diagonal_element(spread.trace()) - spread;
        let reference_is_local = nodes[0].first().map(|_| true);
        // Moments of inertia below round-off belong to axes on which all nodes lie.
        let least = spread.trace() * T::epsilon() * T::of(DIGITS);
        Self {
            inverse: inertia.pseudo_inverse(least).unwrap_or_else(|_| Matrix3::zeros()),
            cuts: nodes.each_ref().map(|n| cuts(&Owned::whole(n.len()), n)),
            nodes,
            components,
            mass,
            spread,
            reference_is_local,
            steady: (T::zero(), 0),
        }
    }

    /// Keeps this rank's nodes of partitioned models.
    pub(super) fn restrict(&mut self, owned: [&Owned; 2]) {
        for (m, owned) in owned.into_iter().enumerate() {
            let nodes = &mut self.nodes[m];
            // Before `retain`: the reference node may be on another rank.
            if m == 0 {
                self.reference_is_local = nodes.first().map(|n| owned.local(n.index).is_some());
            }
            nodes.retain(|n| owned.local(n.index).is_some());
            (nodes.iter_mut()).for_each(|n| n.index = owned.local(n.index).unwrap_or_default());
            self.cuts[m] = cuts(owned, nodes);
        }
    }

    /// Updates `so_far` with jump, amplitude and round-off of the present state; `steps` is the number of own
    /// steps so far of the side that makes most.
    pub(super) fn update(
        &mut self,
        sides: [&Subdomain<T>; 2],
        jump: T,
        steps: usize,
        so_far: &mut DisplacementJump<T>,
    ) {
        let q = sides.map(|s| &*s.state().q);
        let displacement = |m: usize, n: &Node<T>| self.displacement(q[m], n);
        // Round-off is that of the displacements themselves, the distance from no motion at all.
        let no_motion = Rigid {
            base: Vector3::zeros(),
            turn: Matrix3::zeros(),
        };
        let digits =
            T::epsilon() * T::of(DIGITS) * T::of(steps as f64) * self.farthest(&displacement, &no_motion);
        so_far.largest = so_far.largest.max(jump);
        so_far.amplitude = so_far.amplitude.max(self.amplitude(&displacement));
        so_far.digits = so_far.digits.max(digits);
        let (amplitude, looks) = self.steady;
        self.steady = if so_far.amplitude > amplitude * T::of(2.0) {
            (so_far.amplitude, 0)
        } else {
            (amplitude, looks + 1)
        };
    }

    /// Returns whether the amplitude has not doubled for some evaluations. While a wave only begins to
    /// arrive, the jump is a large share of the amplitude and says nothing about the wave.
    pub(super) fn has_settled(&self) -> bool {
        self.steady.1 >= LOOKS
    }

    fn displacement(&self, q: &[T], n: &Node<T>) -> Vector3<T> {
        let d = self.components;
        let mut u = Vector3::zeros();
        let q = &q[n.index * d..(n.index + 1) * d];
        (0..d).for_each(|c| u[c] = q[c]);
        u
    }

    /// Returns the largest displacement \[m\] from the nearest rigid motion; `displacement` gives that of a
    /// node of a side.
    fn amplitude(&self, displacement: &(impl Fn(usize, &Node<T>) -> Vector3<T> + Sync)) -> T {
        // Displacements are counted from that of one node, so that a large common motion costs digits only
        // once.
        let Some(first) = self.reference_displacement(displacement) else {
            return T::zero();
        };
        let (mut mean, mut tilt) = (Vector3::zeros(), Matrix3::zeros());
        for (m, nodes) in self.nodes.iter().enumerate() {
            // Mean and tilt go through one sum, whose bits do not depend on the number of ranks.
            let part = |range: Range<usize>| {
                let (mut mean, mut tilt) = (Vector3::zeros(), Matrix3::zeros());
                for n in &nodes[range] {
                    let u = (displacement(m, n) - first) * n.mass;
                    mean += u;
                    tilt += u * n.arm.transpose();
                }
                std::array::from_fn::<T, 12, _>(|k| if k < 3 { mean[k] } else { tilt[k - 3] })
            };
            let sums = self.cuts[m].sum(12, &part);
            mean += Vector3::from_column_slice(&sums[..3]);
            tilt += Matrix3::from_column_slice(&sums[3..]);
        }
        let base = first + mean / self.mass;
        // `Σ m y × u` from the antisymmetric part of `Σ m u yᵀ`.
        let axial = Vector3::new(
            tilt[(2, 1)] - tilt[(1, 2)],
            tilt[(0, 2)] - tilt[(2, 0)],
            tilt[(1, 0)] - tilt[(0, 1)],
        );
        let turn = (self.inverse * axial).cross_matrix();
        // Laws of small displacements do not resist `ω × y`, other laws do not resist a rotation: the better
        // fit counts.
        let small = self.farthest(displacement, &Rigid { base, turn });
        // Nothing turns along a line.
        let turned = rotation(&(self.spread + tilt)).filter(|_| self.components > 1);
        turned.map_or(small, |r| {
            let turn = r - Matrix3::identity();
            small.min(self.farthest(displacement, &Rigid { base, turn }))
        })
    }

    /// Returns the largest distance \[m\] of displacements from a rigid motion, over all ranks.
    fn farthest(&self, displacement: &impl Fn(usize, &Node<T>) -> Vector3<T>, from: &Rigid<T>) -> T {
        let mut top = T::zero();
        for (m, nodes) in self.nodes.iter().enumerate() {
            for n in nodes {
                let remainder = displacement(m, n) - from.base - from.turn * n.arm;
                top = top.max(remainder.norm_squared());
            }
        }
        // Either partitioned side has the communicator of both.
        let owned = self.cuts.each_ref().map(Cuts::owned);
        let owned = if owned[0].is_part() { owned[0] } else { owned[1] };
        owned.largest(top).sqrt()
    }

    /// Returns the displacement of the reference node on all ranks; `None` if the coarse side has no node.
    fn reference_displacement(
        &self,
        displacement: &(impl Fn(usize, &Node<T>) -> Vector3<T> + Sync),
    ) -> Option<Vector3<T>> {
        let is_local = self.reference_is_local?;
        let local =
            (self.nodes[0].first().filter(|_| is_local)).map_or_else(Vector3::zeros, |n| displacement(0, n));
        let owned = self.cuts[0].owned();
        if !owned.is_part() {
            return Some(local);
        }
        // One rank has the node, the others add zero: the all-reduce is a broadcast.
        let sums = [0, 1, 2].map(|c| {
            let mut sum = Exact::zero();
            sum.add(local[c].as_f64());
            sum
        });
        Some(Vector3::from(owned.total(sums).map(T::of)))
    }
}

/// Returns the boundaries between units of summation in a list of nodes.
fn cuts<T: Real>(owned: &Owned, nodes: &[Node<T>]) -> Cuts {
    Cuts::at_units(owned.clone(), nodes.iter().map(|n| n.index))
}

/// Returns the rotation `R` for which `R y` is nearest to `x`, from the moment `Σ m x yᵀ` (Horn 1987).
fn rotation<T: Real>(moment: &Matrix3<T>) -> Option<Matrix3<T>> {
    let m = |x: usize, y: usize| moment[(x, y)];
    // The eigenvector of the greatest eigenvalue of Horn's matrix is the quaternion of the rotation.
    let [a, b, c] = [m(2, 1) - m(1, 2), m(0, 2) - m(2, 0), m(1, 0) - m(0, 1)];
    let [d, e, f] = [m(1, 0) + m(0, 1), m(0, 2) + m(2, 0), m(2, 1) + m(1, 2)];
    let [x, y, z] = [m(0, 0), m(1, 1), m(2, 2)];
    #[rustfmt::skip]
    let horn = Matrix4::new(
        x + y + z, a, b, c,
        a, x - y - z, d, e,
        b, d, y - x - z, f,
        c, e, f, z - x - y,
    );
    // A run that diverges has no rotation.
    if !horn.iter().all(|h| h.is_finite()) {
        return None;
    }
    let eigen = SymmetricEigen::try_new(horn, T::epsilon(), SWEEPS)?;
    let q = eigen.eigenvectors.column(eigen.eigenvalues.imax());
    let turn = UnitQuaternion::from_quaternion(Quaternion::new(q[0], q[1], q[2], q[3]));
    Some(*turn.to_rotation_matrix().matrix())
}

#[cfg(test)]
mod tests {
    use super::{Node, Overlap};
    use nalgebra::{Rotation3, Vector3};

    /// Positions on both sides and small displacements that are no rigid motion; `flat` scales the axes.
    fn places(flat: Vector3<f64>) -> [Vec<(Vector3<f64>, Vector3<f64>)>; 2] {
        let point = |k: usize, side: usize| {
            let t = (7 * k + 3 * side) as f64;
            let x = Vector3::new(t.sin(), (1.7 * t).cos(), (0.6 * t).sin() + 0.3).component_mul(&flat);
            (
                x,
                1e-3 * Vector3::new((3.1 * t).sin(), x.x * x.y, (2.2 * t).cos()),
            )
        };
        [(20, 0), (50, 1)].map(|(n, side)| (0..n).map(|k| point(k, side)).collect())
    }

    /// Amplitude of the displacements `u(x, bent)`.
    fn amplitude(
        places: &[Vec<(Vector3<f64>, Vector3<f64>)>; 2],
        u: impl Fn(&Vector3<f64>, &Vector3<f64>) -> Vector3<f64> + Sync,
    ) -> f64 {
        let node = |(index, (arm, _)): (usize, &(Vector3<f64>, Vector3<f64>))| Node {
            index,
            mass: 1.0 + 0.1 * index as f64,
            arm: *arm,
        };
        let nodes = places
            .each_ref()
            .map(|side| side.iter().enumerate().map(node).collect());
        Overlap::from_nodes(nodes, 3).amplitude(&|m, n| {
            let (x, bent) = &places[m][n.index];
            u(x, bent)
        })
    }

    #[test]
    fn flights_and_turns_of_any_size_leave_the_amplitude_as_it_is() {
        // A body, a sheet, a line of nodes.
        for flat in [[1.0, 1.0, 1.0], [1.0, 1.0, 0.0], [1.0, 0.0, 0.0]].map(Vector3::from) {
            let places = places(flat);
            let still = amplitude(&places, |_, bent| *bent);
            assert!((2e-4..2e-3).contains(&still), "{flat}: {still:e}");
            for drift in [1.0, 1e6] {
                let far = Vector3::new(1.0, -2.0, 0.5) * drift;
                let flown = amplitude(&places, |_, bent| bent + far);
                assert!(
                    (flown / still - 1.0).abs() < 1e-12 * drift,
                    "{flat}, {drift}: {flown:e}"
                );
            }
            for angle in [1e-4, 0.5, 2.0, 3.1] {
                let r = Rotation3::new(Vector3::new(1.0, 2.0, -0.7).normalize() * angle);
                let turned = amplitude(&places, |x, bent| r * (x + bent) - x);
                // The two fits differ by the square of the deformation, 1e-3.
                assert!((turned / still - 1.0).abs() < 3e-3, "{flat}, {angle}: {turned:e}");
                // Rotated axes.
                let seen = [0, 1].map(|m| places[m].iter().map(|(x, u)| (r * x, r * u)).collect());
                let seen = amplitude(&seen, |_, bent| *bent);
                assert!((seen / still - 1.0).abs() < 1e-10, "{flat}, {angle}: {seen:e}");
            }
            // Rotation of a model with small displacements.
            let spin = Vector3::new(0.3, 0.1, -0.2);
            let sheared = amplitude(&places, |x, bent| bent + spin.cross(x));
            assert!((sheared / still - 1.0).abs() < 3e-3, "{flat}: {sheared:e}");
        }
    }

    #[test]
    fn a_node_that_moves_alone_is_seen_on_either_side() {
        for side in [0, 1] {
            let mut places = places(Vector3::repeat(1.0));
            places
                .iter_mut()
                .flatten()
                .for_each(|(_, u)| *u = Vector3::zeros());
            places[side][0].1 = Vector3::new(0.0, 1e-3, 0.0);
            let largest = amplitude(&places, |_, u| *u);
            // The node has 1/211 of all mass, so that the nearest rigid motion hardly follows it.
            assert!((9e-4..1e-3).contains(&largest), "{side}: {largest:e}");
        }
    }

    #[test]
    fn rigid_motions_have_no_amplitude_and_a_stretch_has_its_own() {
        let places = places(Vector3::repeat(1.0));
        let r = Rotation3::new(Vector3::new(2.0, -1.0, 0.4));
        let rigid = amplitude(&places, |x, _| r * x - x + Vector3::new(5.0, 0.0, 1.0));
        assert!(rigid < 1e-14, "{rigid:e}");
        // Along x, from the common centre.
        let all_nodes = || places.iter().flat_map(|side| side.iter().enumerate());
        let mass: f64 = all_nodes().map(|(k, _)| 1.0 + 0.1 * k as f64).sum();
        let centre = all_nodes()
            .map(|(k, (x, _))| (1.0 + 0.1 * k as f64) * x.x)
            .sum::<f64>()
            / mass;
        let farthest = all_nodes().fold(0.0_f64, |m, (_, (x, _))| m.max((x.x - centre).abs()));
        let line = places.each_ref().map(|side| {
            let on_x = side.iter().map(|(x, u)| (Vector3::new(x.x, 0.0, 0.0), *u));
            on_x.collect()
        });
        let stretched = amplitude(&line, |x, _| 0.01 * x);
        assert!(
            (stretched / (0.01 * farthest) - 1.0).abs() < 1e-12,
            "{stretched:e}"
        );
    }
}
