//! Transfer of state: mass that changes hands carries the state of the model that gives it.
//!
//! `T` is the coarse field at a fine node; for rotations and spins half the curl of it. `Π` fits, at a coarse
//! node `J`, a linear function to the fine nodes `i` with the weights `m_i N_J(x_i)`, and takes its value at
//! the node. This reproduces linear fields, as rigid motions need it, and is local. Where the fine nodes lie
//! in the middle of the hat it is the mean by the hats, which creates no kinetic energy. Across nodes that
//! lie nearly in a plane, the slope is that of their mean rotation. A coarse node that sleeps beside a
//! gaining fine node counts with `Π`, since what it had when it fell asleep says nothing. Where no fine node
//! is in the hat of a node that wakes, those near it give the value.

use super::Response;
use crate::field::{Interpolation, ShapeRow, outside};
use crate::interface::InterfaceSpec;
use crate::reach::Reach;
use crate::weight::Weight;
use crate::{Error, Real, Result, Subdomain};
use nalgebra::{Matrix3, Point3, Vector3};
use rayon::prelude::*;
use std::sync::Arc;

/// Gains of mass up to this number of units of round-off are none.
const DIGITS: f64 = 16.0;
/// Square of the spread of fine nodes along an axis, over their mean square distance from the coarse node,
/// below which a slope along it is not fitted: it would be their noise over a small length.
const FLAT: f64 = 0.02;

/// Number of a subdomain, and the responses of its nodes.
type Responses = (usize, Arc<Vec<Response>>);

/// Masses and state of a subdomain before the change.
pub(super) struct Giver<T: Real> {
    pub(super) inertia: Vec<T>,
    /// Displacements and velocities.
    state: [Vec<T>; 2],
    /// Share of the model before the change.
    weight: Arc<dyn Weight<T>>,
    components: usize,
    translations: usize,
    turns: bool,
}

/// Number of nodes with mass, from the inertia of all unknowns of a model.
pub(super) fn awake<T: Real>(s: &Subdomain<T>, inertia: &[T]) -> usize {
    let layout = s.model().layout();
    let masses = inertia[..layout.translations()].iter().step_by(layout.components);
    masses.filter(|m| **m > T::zero()).count()
}

impl<T: Real> Giver<T> {
    pub(super) fn new(s: &Subdomain<T>) -> Self {
        let (layout, state) = (s.model().layout(), s.state());
        Self {
            inertia: s.inertia().to_vec(),
            state: [state.q.clone(), state.v.clone()],
            weight: s.weights().kinetic.clone(),
            components: layout.components,
            translations: layout.translations(),
            turns: layout.turns(),
        }
    }

    fn mass(&self, node: usize) -> T {
        self.inertia[node * self.components]
    }

    /// Displacement (0) or velocity (1) of a node.
    fn vector(&self, what: usize, node: usize) -> Vector3<T> {
        let d = self.components;
        let mut out = Vector3::zeros();
        (0..d).for_each(|c| out[c] = self.state[what][node * d + c]);
        out
    }

    /// Rotation (0) or spin (1) of a node; zero if nodes of the model do not turn.
    fn turn(&self, what: usize, node: usize) -> Vector3<T> {
        let first = self.translations + 3 * node;
        match self.turns {
            true => Vector3::from_column_slice(&self.state[what][first..first + 3]),
            false => Vector3::zeros(),
        }
    }

    /// Displacement and velocity of a node, its rotation and spin.
    fn motion(&self, node: usize) -> [[Vector3<T>; 2]; 2] {
        [
            [0, 1].map(|what| self.vector(what, node)),
            [0, 1].map(|what| self.turn(what, node)),
        ]
    }

    /// Mass that a node has gained; zero if that is round-off.
    fn gain(&self, s: &Subdomain<T>, node: usize) -> T {
        let (new, old) = (s.inertia()[node * self.components], self.mass(node));
        // Smaller differences are round-off of the weights; as gains they could ask for a giver where there
        // is none.
        if new - old > new * T::epsilon() * T::of(DIGITS) {
            new - old
        } else {
            T::zero()
        }
    }

    fn gains(&self, s: &Subdomain<T>) -> Vec<bool> {
        let nodes = 0..self.translations / self.components;
        nodes.map(|k| self.gain(s, k) > T::zero()).collect()
    }
}

/// Hands the state of givers over to all nodes that have gained mass.
pub(super) fn hand_over<T: Real>(
    subdomains: &mut [Subdomain<T>],
    givers: &[Giver<T>],
    (ties, responses): (&[InterfaceSpec<T>], &[Responses]),
) -> Result<()> {
    let gains: Vec<_> = givers.iter().zip(&*subdomains).map(|(g, s)| g.gains(s)).collect();
    // The states of all models are found before one is written: an error leaves all of them as they were.
    let mut received = Vec::new();
    for (k, gains) in gains.iter().enumerate() {
        let partners = |of: &dyn Fn(&InterfaceSpec<T>) -> [usize; 2]| {
            let mut out: Vec<usize> = ties.iter().map(of).filter(|p| p[0] == k).map(|p| p[1]).collect();
            // A partner counts once, however many interfaces tie it.
            out.sort_unstable();
            out.dedup();
            out
        };
        let (fine, coarse) = (
            partners(&|t| [t.coarse, t.fine]),
            partners(&|t| [t.fine, t.coarse]),
        );
        // A model that only gives keeps its state, and needs no partner that could give.
        if !gains.contains(&true) {
            continue;
        }
        let turns = subdomains[k].model().layout().turns();
        let why = match (fine.is_empty(), coarse.is_empty()) {
            (true, true) => "no interface ties it to a model that could give it a state",
            (false, false) => "it is the coarse model of one interface and the fine one of another",
            (false, true) if turns => {
                "it is a coarse model whose nodes turn, and nothing gives them rotations"
            }
            _ => "",
        };
        if !why.is_empty() {
            return Err(unsupported(&subdomains[k], format!("gain weight: {why}")));
        }
        let states = if fine.is_empty() {
            let own = responses.iter().find(|r| r.0 == k).map(|r| r.1.as_slice());
            from_coarse((k, own), gains, subdomains, givers, (&coarse, ties))?
        } else {
            Means::new(k, gains, subdomains, givers, &fine)?.states(&subdomains[k], &givers[k], gains)?
        };
        received.push((k, states));
    }
    for (k, states) in received {
        mix(&mut subdomains[k], &givers[k], &states);
    }
    Ok(())
}

fn unsupported<T: Real>(s: &Subdomain<T>, what: String) -> Error {
    Error::Unsupported {
        model: s.model().name().to_owned(),
        what,
    }
}

/// Displacement and velocity, rotation and spin that a node receives.
struct Received<T: Real> {
    node: usize,
    vectors: [Vector3<T>; 2],
    turns: [Vector3<T>; 2],
}

/// Mixes what nodes receive with what they have, by mass.
fn mix<T: Real>(s: &mut Subdomain<T>, giver: &Giver<T>, received: &[Received<T>]) {
    let layout = s.model().layout();
    let (d, first) = (layout.components, layout.translations());
    for r in received {
        let entries = (0..d).map(|c| (r.node * d + c, [0, 1].map(|w| r.vectors[w][c])));
        let turns = (0..layout.rotations).map(|c| {
            let k = first + layout.rotations * r.node + c;
            (k, [0, 1].map(|w| r.turns[w][c]))
        });
        for (k, given) in entries.chain(turns) {
            let (old, new) = (giver.inertia[k], s.inertia()[k]);
            // Prescribed unknowns follow their supports.
            if s.inverse_inertia()[k] <= T::zero() {
                continue;
            }
            let share = (new - old) / new;
            let mixed = |own: T, given: T| {
                if old > T::zero() {
                    // In this form a state that both share stays as it is to the last bit: rigid flight costs
                    // nothing.
                    own + share * (given - own)
                } else {
                    // A node that wakes has no state of its own: its displacement is that of when it fell
                    // asleep.
                    given
                }
            };
            let [q, v] = [0, 1].map(|w| mixed(giver.state[w][k], given[w]));
            s.displacements()[k] = q;
            s.velocities()[k] = v;
        }
    }
}

/// Returns the nodes of another model of which `wanted` is true and at which a field exists, ascending, with
/// the field's shape functions there; continued beyond the surface of the field.
fn rows<T: Real>(
    field: &dyn Interpolation<T>,
    of: &Subdomain<T>,
    wanted: &(dyn Fn(usize) -> bool + Sync),
    gradient: bool,
) -> Result<Vec<(usize, ShapeRow<T>)>> {
    let nodes = of.model().nodes();
    let row = |node: usize| -> Result<(usize, Option<ShapeRow<T>>)> {
        let mut row = ShapeRow::default();
        match field.shape_at(&nodes[node], gradient, &mut row) {
            Ok(()) => Ok((node, Some(row))),
            // Nodes beyond the surface of the field get their rows below, by its continuation.
            Err(Error::OutsideDomain { .. }) => Ok((node, None)),
            Err(e) => Err(e),
        }
    };
    let wanted = (0..nodes.len()).into_par_iter().filter(|k| wanted(*k));
    let evaluated: Vec<_> = wanted.map(row).collect::<Result<_>>()?;
    let mut out = Vec::with_capacity(evaluated.len());
    let mut reach = None;
    let mut work = [ShapeRow::default(), ShapeRow::default()];
    for (node, row) in evaluated {
        if let Some(row) = row {
            out.push((node, row));
            continue;
        }
        // Few nodes lie outside, and most fields have none.
        let reach = reach.get_or_insert_with(|| Reach::new(field));
        let mut row = ShapeRow::default();
        match reach.shape_at(&nodes[node], gradient, &mut row, &mut work) {
            Ok(()) => out.push((node, row)),
            // Too far from this field. The caller knows if another model holds the node, and refuses it if
            // none does.
            Err(Error::OutsideDomain { .. }) => {}
            Err(e) => return Err(e),
        }
    }
    Ok(out)
}

/// Weighted sums over the fine nodes around a coarse node, with positions from it.
#[derive(Clone)]
struct Sums<T: Real> {
    weight: T,
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
    fn new() -> Self {
        Self {
            weight: T::zero(),
            arm: Vector3::zeros(),
            square: Matrix3::zeros(),
            first: [Vector3::zeros(); 2],
            value: [Vector3::zeros(); 2],
            slope: [Matrix3::zeros(); 2],
            turn: [Vector3::zeros(); 2],
        }
    }

    /// Adds a fine node of this weight with its displacement and velocity, its rotation and spin.
    fn add(&mut self, weight: T, arm: &Vector3<T>, [x, turn]: [[Vector3<T>; 2]; 2]) {
        if self.weight <= T::zero() {
            self.first = x;
        }
        self.weight += weight;
        self.arm += arm * weight;
        self.square += arm * arm.transpose() * weight;
        for (k, x) in x.iter().enumerate() {
            let x = (x - self.first[k]) * weight;
            self.value[k] += x;
            self.slope[k] += x * arm.transpose();
            self.turn[k] += turn[k] * weight;
        }
    }

    /// Adds the fine `nodes` around a coarse node at `x` with a cone as hat, `1 − d / R` at the distance `d`.
    /// `node` returns the mass of a fine node and its motion.
    fn add_cone(
        &mut self,
        x: &Point3<T>,
        radius: T,
        nodes: &[Point3<T>],
        node: impl Fn(usize) -> (T, [[Vector3<T>; 2]; 2]),
    ) {
        for (i, y) in nodes.iter().enumerate() {
            let arm = y - x;
            let distance = arm.norm();
            if distance < radius {
                let (mass, motion) = node(i);
                if mass > T::zero() {
                    self.add(mass * (T::one() - distance / radius), &arm, motion);
                }
            }
        }
    }

    /// Value at the node of the linear function that fits best; `None` without fine nodes.
    fn fit(&self) -> Option<[Vector3<T>; 2]> {
        if self.weight <= T::zero() {
            return None;
        }
        let middle = self.arm / self.weight;
        let spread = self.square / self.weight - middle * middle.transpose();
        let eigen = spread.symmetric_eigen();
        let least = self.square.trace() / self.weight * T::of(FLAT);
        // Where the slopes act: the middle, without parts along axes in which the nodes do not spread. What
        // is left of it turns with the nodes, or a body that spins would be strained.
        let (mut lever, mut across) = (Vector3::zeros(), middle);
        for (value, axis) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
            if *value > least {
                let along = axis.dot(&middle);
                lever += axis * (along / *value);
                across -= axis * along;
            }
        }
        Some([0, 1].map(|k| {
            let mean = self.value[k] / self.weight;
            let cross = self.slope[k] / self.weight - mean * middle.transpose();
            // The value at the coarse node, where the arm is zero; coefficients of the fit are not needed.
            let turn = self.turn[k] / self.weight;
            self.first[k] + mean - cross * lever - turn.cross(&across)
        }))
    }
}

/// Linear means of fine fields at the nodes of a coarse model.
struct Means<T: Real>(Vec<Sums<T>>);

impl<T: Real> Means<T> {
    /// Sums over the fine nodes with mass of all `partners`, for coarse nodes with `wanted`.
    fn new(
        coarse: usize,
        wanted: &[bool],
        subdomains: &[Subdomain<T>],
        givers: &[Giver<T>],
        partners: &[usize],
    ) -> Result<Self> {
        let (field, nodes) = (subdomains[coarse].field(), subdomains[coarse].model().nodes());
        let mut sums = vec![Sums::new(); nodes.len()];
        for &p in partners {
            let giver = &givers[p];
            let has_mass = |node: usize| giver.mass(node) > T::zero();
            let rows = rows(&**field, &subdomains[p], &has_mass, false)?;
            let points = subdomains[p].model().nodes();
            // One after the other, so that the bits do not depend on the number of threads.
            for (i, row) in rows {
                for (&j, &n) in row.nodes.iter().zip(&row.values) {
                    // The linear continuation of a shape function may be negative, and a mean needs positive
                    // weights.
                    if wanted[j] && n > T::zero() {
                        let motion = giver.motion(i);
                        sums[j].add(giver.mass(i) * n, &(points[i] - nodes[j]), motion);
                    }
                }
            }
        }
        // The corner of a body may have one tetrahedron alone, and no fine node in it.
        for (j, sum) in sums.iter_mut().enumerate() {
            if wanted[j] && sum.weight <= T::zero() && givers[coarse].mass(j) <= T::zero() {
                let radius = cone_radius(j, nodes);
                for &p in partners {
                    let node = |i: usize| (givers[p].mass(i), givers[p].motion(i));
                    sum.add_cone(&nodes[j], radius, subdomains[p].model().nodes(), node);
                }
            }
        }
        Ok(Self(sums))
    }

    /// States that gaining nodes receive. A node with mass and without fine nodes around it keeps its own.
    fn states(&self, s: &Subdomain<T>, giver: &Giver<T>, gains: &[bool]) -> Result<Vec<Received<T>>> {
        let mut out = Vec::new();
        for node in (0..gains.len()).filter(|k| gains[*k]) {
            match self.0[node].fit() {
                Some(vectors) => out.push(Received {
                    node,
                    vectors,
                    turns: [Vector3::zeros(); 2],
                }),
                None if giver.mass(node) > T::zero() => {}
                None => return Err(orphan(s, node)),
            }
        }
        Ok(out)
    }
}

/// Radius of the cone that stands for the hat of the coarse node `j`: twice the distance to the nearest other
/// coarse node.
fn cone_radius<T: Real>(j: usize, nodes: &[Point3<T>]) -> T {
    let others = nodes.iter().enumerate().filter(|(k, _)| *k != j);
    let distances = others.map(|(_, y)| (y - nodes[j]).norm());
    distances.reduce(T::min).unwrap_or_else(T::zero) * T::of(2.0)
}

fn orphan<T: Real>(s: &Subdomain<T>, node: usize) -> Error {
    let [x, y, z] = super::partition::numbers(&s.model().nodes()[node]);
    let what = format!(
        "gain weight at node {node} at ({x:.6e}, {y:.6e}, {z:.6e}) m: no node of a tied model beside it had weight; let weights \
         change only where both models are"
    );
    unsupported(s, what)
}

/// Displacements and velocities of the nodes of a coarse model that rows use; zero elsewhere. A node that
/// sleeps has its linear mean.
fn coarse_state<T: Real>(
    coarse: usize,
    rows: &[(usize, ShapeRow<T>)],
    subdomains: &[Subdomain<T>],
    givers: &[Giver<T>],
    ties: &[InterfaceSpec<T>],
) -> Result<Vec<[Vector3<T>; 2]>> {
    let giver = &givers[coarse];
    let mut out = vec![[Vector3::zeros(); 2]; subdomains[coarse].model().nodes().len()];
    let mut asleep = vec![false; out.len()];
    for &j in rows.iter().flat_map(|r| &r.1.nodes) {
        asleep[j] = giver.mass(j) <= T::zero();
        out[j] = [0, 1].map(|what| giver.vector(what, j));
    }
    if asleep.contains(&true) {
        let fine: Vec<_> = ties
            .iter()
            .filter(|t| t.coarse == coarse)
            .map(|t| t.fine)
            .collect();
        for r in Means::new(coarse, &asleep, subdomains, givers, &fine)?.states(
            &subdomains[coarse],
            giver,
            &asleep,
        )? {
            out[r.node] = r.vectors;
        }
    }
    Ok(out)
}

/// Returns the states that the gaining nodes of a fine model receive from coarse fields.
fn from_coarse<T: Real>(
    (fine, responses): (usize, Option<&[Response]>),
    gains: &[bool],
    subdomains: &[Subdomain<T>],
    givers: &[Giver<T>],
    (partners, ties): (&[usize], &[InterfaceSpec<T>]),
) -> Result<Vec<Received<T>>> {
    let s = &subdomains[fine];
    let turns = s.model().layout().turns();
    // Sums of shares, and of shares times displacement, velocity, rotation, spin.
    let mut sums = vec![(T::zero(), [Vector3::zeros(); 4]); gains.len()];
    let gradient = turns || responses.is_some();
    for &p in partners {
        let rows = rows(&**subdomains[p].field(), s, &|node| gains[node], gradient)?;
        let vectors = coarse_state(p, &rows, subdomains, givers, ties)?;
        for (i, row) in rows {
            // With several givers each counts by its weight there. A weight of zero at the node itself,
            // beside a mean that is not, must not lose the only giver.
            let share = givers[p].weight.value(&s.model().nodes()[i]).max(T::epsilon());
            let (total, sum) = &mut sums[i];
            *total += share;
            let mut slopes = [Matrix3::zeros(); 2];
            for (k, (&j, &n)) in row.nodes.iter().zip(&row.values).enumerate() {
                for (what, u) in vectors[j].iter().enumerate() {
                    sum[what] += u * (n * share);
                    if turns {
                        // Half the curl: ½ ∇N × u.
                        sum[2 + what] += row.gradients[k].cross(u) * (share * T::of(0.5));
                    }
                    if gradient {
                        slopes[what] += u * row.gradients[k].transpose() * share;
                    }
                }
            }
            if let Some(responses) = responses {
                for (what, slope) in slopes.iter().enumerate() {
                    let [u, turn] = responses[i].in_gradient(slope);
                    sum[what] += u;
                    if turns {
                        sum[2 + what] += turn;
                    }
                }
            }
        }
    }
    let mut out = Vec::new();
    for node in (0..gains.len()).filter(|k| gains[*k]) {
        let (share, sum) = &sums[node];
        if *share <= T::zero() {
            let x = &s.model().nodes()[node];
            // No coarse model holds the node: the mean below would be 0/0.
            return Err(outside(x, "coarse model of a change of weights"));
        }
        let [q, v, turn, spin] = sum.map(|x| x / *share);
        out.push(Received {
            node,
            vectors: [q, v],
            turns: [turn, spin],
        });
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Value at the coarse node of the fit to nodes at `arms` that have the displacement `x`, and turn by
    /// `turn`; velocities are twice as large.
    fn fit(
        arms: &[Vector3<f64>],
        x: impl Fn(&Vector3<f64>) -> Vector3<f64>,
        turn: Vector3<f64>,
    ) -> Vector3<f64> {
        let mut sums = Sums::new();
        for (k, arm) in arms.iter().enumerate() {
            sums.add(1.0 + 0.3 * k as f64, arm, [x(arm), turn].map(|x| [x, 2.0 * x]));
        }
        let [u, v] = sums.fit().expect("nodes");
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

    /// A corner of the body without a fine node in its elements.
    #[test]
    fn a_cone_takes_nodes_within_twice_the_distance_of_the_next_coarse_node() {
        let x = |a: f64| Point3::new(a, 0.0, 0.0);
        let radius = cone_radius(0, &[x(0.0), x(3.0), x(-1.0)]);
        assert!((radius - 2.0).abs() < 1e-15, "{radius}");
        let masses = [1.0, 2.0, 4.0, 0.0];
        let mut sums = Sums::new();
        let fine = [x(0.5), x(1.5), x(2.5), x(0.1)];
        sums.add_cone(&x(0.0), radius, &fine, |i| {
            (masses[i], [[Vector3::zeros(); 2]; 2])
        });
        let expected = 1.0 * 0.75 + 2.0 * 0.25;
        assert!((sums.weight - expected).abs() < 1e-15, "{}", sums.weight);
        // One node off the axes has a rigid motion with its rotation.
        let (flight, turn) = (Vector3::new(3.0, -1.0, 2.0), Vector3::new(0.2, -0.5, 0.7));
        let arm = Vector3::new(0.3, 0.5, -0.4);
        let mut sums = Sums::new();
        let moved = flight + turn.cross(&arm);
        sums.add_cone(&x(0.0), radius, &[arm.into()], |_| (1.0, [[moved; 2], [turn; 2]]));
        let [u, _] = sums.fit().expect("a node");
        assert!((u - flight).norm() < 1e-14, "{u}");
    }
}
