//! How far the two models of an overlap are apart, and what that is held against: the motion there that
//! deforms.
//!
//! Of the displacements `u` of all nodes that multipliers act on, with masses `m` and places `y` from their
//! common centre, the nearest rigid motion is taken off:
//!
//! ```text
//! amplitude = max |u − ū − W y|,    ū = Σ m u / Σ m
//! W = ω ×      (tr G − G) ω = Σ m y × u,  G = Σ m y yᵀ     small turns, which laws of small displacements do not resist
//! W = R − 1    R: greatest eigenvector of Horn's matrix    turns of any size
//! ```
//!
//! whichever of the two leaves less. A body that flies or turns as a whole has none; nothing depends on how
//! axes lie.

use super::ledger::DisplacementJump;
use crate::Real;
use crate::interface::{Interface, coupled_nodes};
use crate::ranks::{self, Cuts, Exact, Portion};
use crate::subdomain::Subdomain;
use nalgebra::{Matrix3, Matrix4, Quaternion, SymmetricEigen, UnitQuaternion, Vector3};
use std::ops::Range;
use std::sync::Arc;

/// Last digits by which displacements differ that are the same but for round-off, per own step.
const DIGITS: f64 = 16.0;

/// Looks without a doubled amplitude after which a jump is judged.
const LOOKS: usize = 10;

/// Sweeps after which the search for a rotation is given up; it takes three or four.
const SWEEPS: usize = 100;

/// The nodes of an overlap that multipliers act on.
#[derive(Debug)]
pub(super) struct Overlap<T: Real> {
    /// Of the coarse and of the fine side.
    nodes: [Vec<Node<T>>; 2],
    components: usize,
    mass: T,
    /// `Σ m y yᵀ`.
    spread: Matrix3<T>,
    /// Inverse of `tr G − G`; zero about axes on which all nodes lie.
    inverse: Matrix3<T>,
    /// Where the nodes of a side pass from unit to unit.
    cuts: [Cuts; 2],
    /// Of a side in parts: what this rank holds.
    portions: [Option<Arc<Portion>>; 2],
    /// Whether there is a first node of the coarse side, from which displacements are counted, and whether
    /// it is here.
    first: Option<bool>,
    /// An amplitude that has not doubled since, and looks since then.
    steady: (T, usize),
}

#[derive(Debug)]
struct Node<T: Real> {
    index: usize,
    mass: T,
    /// Place from the common centre \[m\].
    arm: Vector3<T>,
}

/// A rigid motion: `base + turn · y`.
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
            let of = |index: usize| {
                // Only directions in which nodes move are there to turn in.
                let mut arm = s.model().nodes()[index].coords;
                (components..3).for_each(|c| arm[c] = T::zero());
                let mass = s.inertia()[index * components];
                Node { index, mass, arm }
            };
            let nodes = coupled_nodes(&interface.coupling[m], components);
            nodes.into_iter().map(of).collect::<Vec<_>>()
        };
        Self::of([0, 1].map(side), components)
    }

    /// Of nodes whose arms are from any point.
    fn of(mut nodes: [Vec<Node<T>>; 2], components: usize) -> Self {
        let all = || nodes.iter().flatten();
        let mass: T = all().map(|n| n.mass).sum();
        let centre = all().fold(Vector3::zeros(), |c, n| c + n.arm * (n.mass / mass));
        nodes.iter_mut().flatten().for_each(|n| n.arm -= centre);
        let all = nodes.iter().flatten();
        let spread = all.fold(Matrix3::zeros(), |g, n| g + n.arm * n.arm.transpose() * n.mass);
        let inertia = Matrix3::from_diagonal_element(spread.trace()) - spread;
        let first = nodes[0].first().map(|_| true);
        let least = spread.trace() * T::epsilon() * T::of(DIGITS);
        Self {
            inverse: inertia.pseudo_inverse(least).unwrap_or_else(|_| Matrix3::zeros()),
            cuts: nodes.each_ref().map(|n| cuts(n)),
            nodes,
            components,
            mass,
            spread,
            portions: [None, None],
            first,
            steady: (T::zero(), 0),
        }
    }

    /// From now on models are in parts, of which it keeps the nodes here.
    pub(super) fn share_out(&mut self, portions: [Option<&Arc<Portion>>; 2]) {
        for (m, portion) in portions.into_iter().enumerate() {
            let Some(portion) = portion else { continue };
            let nodes = &mut self.nodes[m];
            if m == 0 {
                self.first = nodes.first().map(|n| portion.local(n.index).is_some());
            }
            nodes.retain(|n| portion.local(n.index).is_some());
            (nodes.iter_mut()).for_each(|n| n.index = portion.local(n.index).unwrap_or_default());
            self.cuts[m] = cuts(nodes);
            self.portions[m] = Some(portion.clone());
        }
    }

    /// Jump, amplitude and digits of the present state join those so far; `steps`: own steps so far of the
    /// side that makes most.
    pub(super) fn look(
        &mut self,
        sides: [&Subdomain<T>; 2],
        jump: T,
        steps: usize,
        so_far: &mut DisplacementJump<T>,
    ) {
        let q = sides.map(|s| &*s.state().q);
        let of = |m: usize, n: &Node<T>| self.displacement(q[m], n);
        let none = Rigid {
            base: Vector3::zeros(),
            turn: Matrix3::zeros(),
        };
        let digits = T::epsilon() * T::of(DIGITS) * T::of(steps as f64) * self.farthest(&of, &none);
        so_far.largest = so_far.largest.max(jump);
        so_far.amplitude = so_far.amplitude.max(self.amplitude(&of));
        so_far.digits = so_far.digits.max(digits);
        let (amplitude, looks) = self.steady;
        self.steady = if so_far.amplitude > amplitude * T::of(2.0) {
            (so_far.amplitude, 0)
        } else {
            (amplitude, looks + 1)
        };
    }

    /// Whether the amplitude has not doubled for some looks: of the first beginnings of a wave, which are
    /// short, the jump is a large share that says nothing of the wave.
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

    /// Largest displacement \[m\] from the nearest rigid motion; `of`: displacement of a node of a side.
    fn amplitude(&self, of: &(impl Fn(usize, &Node<T>) -> Vector3<T> + Sync)) -> T {
        // From the displacement of one of them: digits of a common motion are lost once only.
        let Some(first) = self.first(of) else {
            return T::zero();
        };
        let (mut mean, mut tilt) = (Vector3::zeros(), Matrix3::zeros());
        for (m, nodes) in self.nodes.iter().enumerate() {
            let part = |range: Range<usize>| {
                let (mut mean, mut tilt) = (Vector3::zeros(), Matrix3::zeros());
                for n in &nodes[range] {
                    let u = (of(m, n) - first) * n.mass;
                    mean += u;
                    tilt += u * n.arm.transpose();
                }
                std::array::from_fn::<T, 12, _>(|k| if k < 3 { mean[k] } else { tilt[k - 3] })
            };
            let sums = self.cuts[m].sum(self.portions[m].as_deref(), 12, &part);
            mean += Vector3::from_column_slice(&sums[..3]);
            tilt += Matrix3::from_column_slice(&sums[3..]);
        }
        let base = first + mean / self.mass;
        let axial = Vector3::new(
            tilt[(2, 1)] - tilt[(1, 2)],
            tilt[(0, 2)] - tilt[(2, 0)],
            tilt[(1, 0)] - tilt[(0, 1)],
        );
        let turn = (self.inverse * axial).cross_matrix();
        let small = self.farthest(of, &Rigid { base, turn });
        let turned = rotation(&(self.spread + tilt)).filter(|_| self.components > 1);
        turned.map_or(small, |r| {
            let turn = r - Matrix3::identity();
            small.min(self.farthest(of, &Rigid { base, turn }))
        })
    }

    /// Largest distance from a rigid motion.
    fn farthest(&self, of: &impl Fn(usize, &Node<T>) -> Vector3<T>, from: &Rigid<T>) -> T {
        let mut top = T::zero();
        for (m, nodes) in self.nodes.iter().enumerate() {
            for n in nodes {
                let left = of(m, n) - from.base - from.turn * n.arm;
                top = top.max(left.norm_squared());
            }
        }
        let all = self.portions.iter().flatten().next();
        ranks::largest(all.map(|p| &**p), top).sqrt()
    }

    /// Displacement of the first node of the coarse side, on all ranks.
    fn first(&self, of: &(impl Fn(usize, &Node<T>) -> Vector3<T> + Sync)) -> Option<Vector3<T>> {
        let here = self.first?;
        let own = (self.nodes[0].first().filter(|_| here)).map_or_else(Vector3::zeros, |n| of(0, n));
        let Some(portion) = &self.portions[0] else {
            return Some(own);
        };
        let sums = [0, 1, 2].map(|c| {
            let mut sum = Exact::zero();
            sum.add(own[c].as_f64());
            sum
        });
        Some(Vector3::from(portion.total(sums).map(T::of)))
    }
}

/// Where nodes pass from unit to unit.
fn cuts<T: Real>(nodes: &[Node<T>]) -> Cuts {
    Cuts::at_units(nodes.iter().map(|n| n.index))
}

/// The rotation `R` for which `R y` is nearest to `x`, of `Σ m x yᵀ` (Horn 1987).
fn rotation<T: Real>(moment: &Matrix3<T>) -> Option<Matrix3<T>> {
    let m = |x: usize, y: usize| moment[(x, y)];
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

    /// Places on both sides, heavier here than there, and small displacements that no rigid motion makes.
    fn places(flat: Vector3<f64>) -> [Vec<(Vector3<f64>, Vector3<f64>)>; 2] {
        let at = |k: usize, side: usize| {
            let t = (7 * k + 3 * side) as f64;
            let x = Vector3::new(t.sin(), (1.7 * t).cos(), (0.6 * t).sin() + 0.3).component_mul(&flat);
            (
                x,
                1e-3 * Vector3::new((3.1 * t).sin(), x.x * x.y, (2.2 * t).cos()),
            )
        };
        [(20, 0), (50, 1)].map(|(n, side)| (0..n).map(|k| at(k, side)).collect())
    }

    /// The amplitude of displacements `u(x, bent)`.
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
        Overlap::of(nodes, 3).amplitude(&|m, n| {
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
                // The two fits differ by the square of what bends, 1e-3.
                assert!((turned / still - 1.0).abs() < 3e-3, "{flat}, {angle}: {turned:e}");
                // Axes that lie otherwise.
                let seen = [0, 1].map(|m| places[m].iter().map(|(x, u)| (r * x, r * u)).collect());
                let seen = amplitude(&seen, |_, bent| *bent);
                assert!((seen / still - 1.0).abs() < 1e-10, "{flat}, {angle}: {seen:e}");
            }
            // What models of small displacements take for a turn.
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
            let found = amplitude(&places, |_, u| *u);
            // It is a 211th of all masses, and takes little of the others along.
            assert!((9e-4..1e-3).contains(&found), "{side}: {found:e}");
        }
    }

    #[test]
    fn rigid_motions_have_no_amplitude_and_a_stretch_has_its_own() {
        let places = places(Vector3::repeat(1.0));
        let r = Rotation3::new(Vector3::new(2.0, -1.0, 0.4));
        let rigid = amplitude(&places, |x, _| r * x - x + Vector3::new(5.0, 0.0, 1.0));
        assert!(rigid < 1e-14, "{rigid:e}");
        // Along x, from the common centre.
        let all = || places.iter().flat_map(|side| side.iter().enumerate());
        let mass: f64 = all().map(|(k, _)| 1.0 + 0.1 * k as f64).sum();
        let centre = all().map(|(k, (x, _))| (1.0 + 0.1 * k as f64) * x.x).sum::<f64>() / mass;
        let farthest = all().fold(0.0_f64, |m, (_, (x, _))| m.max((x.x - centre).abs()));
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
