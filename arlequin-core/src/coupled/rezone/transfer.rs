//! Transfer of state: mass that changes hands carries the state of the model that gives it.
//!
//! `T` is the coarse field at a fine node; for rotations and spins half the curl of it. `Π` fits, at a coarse
//! node `J`, a linear function to the fine nodes `i` with the weights `m_i N_J(x_i)`, and takes its value at
//! the node. This reproduces linear fields, as rigid motions need it, and is local. Where the fine nodes lie
//! in the middle of the hat it is the mean by the hats, which creates no kinetic energy. Across nodes that
//! lie nearly in a plane, the slope is that of their mean rotation. A coarse node that sleeps beside a
//! gaining fine node counts with `Π`, since what it had when it fell asleep says nothing. Where the hat of a
//! node has few fine nodes, on one side of it, a cone wider than the hat takes its place.

use super::Response;
use super::fit::{Cones, Sums};
use crate::field::{Interpolation, ShapeRow, outside};
use crate::interface::InterfaceSpec;
use crate::reach::Reach;
use crate::weight::Weight;
use crate::{Error, Real, Result, Subdomain};
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;
use std::sync::Arc;

/// Gains of mass up to this number of units of round-off are none.
const DIGITS: f64 = 16.0;
/// Noise of a value at a coarse node over that of the fine nodes, above which the hat has too few of them:
/// what the fit enlarges strains coarse elements, and its energy breaks bonds that wake later. Ten nodes in a
/// row beside the coarse one, in an overlap, have 1.13; a wider cone would only bend what they resolve.
const NOISE: f64 = 1.2;

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
        let mut placed = Vec::with_capacity(partners.len());
        for &p in partners {
            let giver = &givers[p];
            let has_mass = |node: usize| giver.mass(node) > T::zero();
            let rows = rows(&**field, &subdomains[p], &has_mass, false)?;
            let points = subdomains[p].model().nodes();
            // One after the other, so that the bits do not depend on the number of threads.
            for &(i, ref row) in &rows {
                for (&j, &n) in row.nodes.iter().zip(&row.values) {
                    // The linear continuation of a shape function may be negative, and a mean needs positive
                    // weights.
                    if wanted[j] && n > T::zero() {
                        let motion = giver.motion(i);
                        sums[j].add(giver.mass(i) * n, &(points[i] - nodes[j]), motion);
                    }
                }
            }
            placed.push((p, rows));
        }
        // A corner of a body may have one tetrahedron alone, with hardly a fine node in it. A coarse node
        // with mass, and no fine node in its hat, keeps its state.
        let poor = |j: &usize| {
            let sum = &sums[*j];
            let counts = sum.weight > T::zero() || givers[coarse].mass(*j) <= T::zero();
            wanted[*j] && counts && sum.noise() > T::of(NOISE)
        };
        let poor: Vec<_> = (0..nodes.len()).filter(poor).collect();
        if !poor.is_empty() {
            let mut cones = Cones::new(&**field, &poor)?;
            placed
                .iter()
                .flat_map(|p| &p.1)
                .for_each(|(_, row)| cones.add_element(&row.nodes));
            let mut wide = vec![Sums::new(); poor.len()];
            for (p, rows) in &placed {
                let (points, giver) = (subdomains[*p].model().nodes(), &givers[*p]);
                for (i, row) in rows {
                    cones.visit(&points[*i], &row.nodes, |k, value, arm| {
                        wide[k].add(giver.mass(*i) * value, &arm, giver.motion(*i));
                    });
                }
            }
            for (j, wide) in poor.into_iter().zip(wide) {
                if wide.noise() < sums[j].noise() {
                    sums[j] = wide;
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
