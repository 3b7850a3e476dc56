//! The overlap absorber: removes motion that the coarse model cannot carry.
//!
//! The constrained scheme filters nothing: everything above the coarse cutoff is reflected. The absorber
//! damps the unresolved part `v' = v − P v` of the fine velocities in the overlap, where `P` is the
//! projection onto a resolved space (the mediator's or a coarser one) that leaves the least power. With
//! `D = diag(m η)` and shape functions `N` it is `P = N (NᵀDN)⁻¹ NᵀD`, so that the force
//! `F = −(I − P)ᵀ D (I − P) v` is `−D (I − P) v`: one system to solve. Rigid motions are untouched, and
//! energy only leaves.
//!
//! Where own steps are short beside `1/η`, the force acts as impulses: `n` times as strong in one of `n`
//! steps. An impulse takes the velocities of the whole step,
//!
//! ```text
//! v = v₋ + Δt/2 M⁻¹ f,    v₊ = v − n Δt M⁻¹ D (I − P) v
//! ```
//!
//! with the velocities `v₋` half a step earlier and the other forces `f`. It contracts them by their masses,
//! so that no rhythm of impulses can feed a vibration (decision 0067). With a rate of 0.2 c/r (wave speed
//! `c`, distance `r` of the particles) they come at least once in 1.25 r/c, so that a wave of any length,
//! with up to 2 c/r, meets each of them at another phase.

use super::{AnyEffect, Effect, EffectSpec, Host, Instant, StepDemand};
use crate::error::invalid;
use crate::field::{Interpolation, ShapeRow};
use crate::interface::Rows;
use crate::linalg::SpdFactor;
use crate::model::{Arms, DofLayout};
use crate::owned::Cuts;
use crate::ranks::{Gather, Message};
use crate::scalar::dot;
use crate::{Error, Exact, Owned, Real, Result};
use nalgebra::Point3;
use sprs::{CsMat, TriMat};
use std::ops::Range;
use std::sync::Arc;

/// Largest share `n η Δt` of a velocity that an impulse takes.
const IMPULSE: f64 = 0.25;

/// Damping rate `η` \[1/s\] as a function of position.
pub type RateField<T> = Arc<dyn Fn(&Point3<T>) -> T + Send + Sync>;

/// The absorber of one overlap, acting on the fine model.
pub struct Absorber<T: Real> {
    resolved: Arc<dyn Interpolation<T>>,
    rate: RateField<T>,
}

/// An absorber that is attached to the nodes of a model.
///
/// With `D = diag(m η)` and shape functions `N` the force is `−D (v − N y)`, `y = (NᵀDN)⁻¹ NᵀD v`.
struct AttachedAbsorber<T: Real> {
    top_rate: T,
    components: usize,
    /// Damped nodes, ascending; for a partitioned model, places in the list of these nodes on all ranks.
    nodes: Vec<u32>,
    /// Place in `nodes` and local number of each of these nodes that this rank owns.
    local_nodes: Vec<[u32; 2]>,
    /// Where `local_nodes` passes from one unit of nodes to the next.
    cuts: Cuts,
    /// Exchange of velocities with other ranks.
    exchange: Option<VelocityExchange<T>>,
    /// Inverse masses of the nodes of `local_nodes`, components interleaved; zero where motion is prescribed.
    inverse_inertia: Vec<T>,
    /// Velocities of `nodes` at the whole step.
    velocity: Vec<T>,
    /// True if the last step had no impulse. The forces are then zero, and `force` holds older ones.
    rests: bool,
    /// `m η` of each node.
    damping: Vec<T>,
    /// `NᵀD` and `N`.
    gather: Rows<T>,
    scatter: Rows<T>,
    factor: Box<dyn SpdFactor<T>>,
    /// One vector per resolved node, components interleaved: `NᵀD v`, then `y`.
    resolved: Vec<T>,
    /// `resolved` component by component, as the factor takes it.
    columns: Vec<T>,
    force: Vec<T>,
}

/// Velocities of all nodes in the resolved space, gathered from all ranks.
struct VelocityExchange<T> {
    gather: Gather,
    messages: Vec<Message>,
    /// Velocities of all nodes of the model here; those of `local_nodes` are set.
    v: Vec<T>,
}

impl<T: Real> std::fmt::Debug for Absorber<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Absorber with {} resolved nodes", self.resolved.nodes().len())
    }
}

impl<T: Real> Absorber<T> {
    /// Absorber that keeps the motion that `resolved` can represent and damps the rest at the local rate
    /// \[1/s\].
    ///
    /// The rate should grow from 0 at the border to the fine model's own region; `0.2 c/r` is a good largest
    /// value (`c` wave speed, `r` particle spacing).
    pub fn new(resolved: Arc<dyn Interpolation<T>>, rate: RateField<T>) -> Self {
        Self { resolved, rate }
    }
}

impl<T: Real> AttachedAbsorber<T> {
    /// Absorber for shape functions `n` (a row per node), `m η` of the nodes and the largest `η`; `None` if
    /// `NᵀDN` is not positive definite.
    fn new(components: usize, n: &CsMat<T>, nodes: &[usize], damping: Vec<T>, top_rate: T) -> Option<Self> {
        let zeros = |count: usize| vec![T::zero(); count * components];
        let weighted = n.transpose_view().to_csr();
        let entries = weighted.iter().map(|(v, (j, i))| (j, i, *v * damping[i]));
        Some(Self {
            top_rate,
            components,
            gather: Rows::from_entries(n.cols(), entries),
            scatter: Rows::from_entries(n.rows(), n.iter().map(|(v, (i, j))| (i, j, *v))),
            factor: factor(n, &damping)?,
            resolved: zeros(n.cols()),
            columns: zeros(n.cols()),
            force: zeros(nodes.len()),
            velocity: zeros(nodes.len()),
            inverse_inertia: Vec::new(),
            rests: true,
            local_nodes: (0..).zip(nodes).map(|(place, k)| [place, *k as u32]).collect(),
            cuts: Cuts::at_units(Owned::whole(0), nodes.iter().copied()),
            exchange: None,
            nodes: nodes.iter().map(|k| *k as u32).collect(),
            damping,
        })
    }

    /// Replaces the sums `NᵀD v` in `resolved` by `y`.
    fn solve<const N: usize>(&mut self) {
        let count = self.factor.size();
        let resolved = self.resolved.as_chunks_mut::<N>().0;
        // The factor takes components one after the other, the products take them interleaved.
        for (j, x) in resolved.iter().enumerate() {
            (0..N).for_each(|c| self.columns[c * count + j] = x[c]);
        }
        self.factor.solve(&mut self.columns);
        for (j, x) in resolved.iter_mut().enumerate() {
            (0..N).for_each(|c| x[c] = self.columns[c * count + j]);
        }
    }

    /// Sets up the exchange of velocities with other ranks. `nodes` are numbers in the whole model.
    fn with_exchange(mut self, owned: &Owned, nodes: &[usize]) -> Self {
        let gather = Gather::new(owned, 1, nodes.iter().copied());
        self.local_nodes = gather.own().to_vec();
        let local = self.local_nodes.iter().map(|l| l[1] as usize);
        self.cuts = Cuts::at_units(Owned::whole(0), local);
        self.nodes = (0..nodes.len() as u32).collect();
        self.exchange = Some(VelocityExchange {
            messages: gather.messages(self.components),
            v: vec![T::zero(); owned.nodes() * self.components],
            gather,
        });
        self
    }

    /// Sets the inverse masses of this rank's damped nodes; `inverse_inertia` has those of all unknowns of
    /// the model.
    fn with_masses(mut self, inverse_inertia: &[T]) -> Self {
        let d = self.components;
        let nodes = self.local_nodes.iter().map(|l| l[1] as usize * d);
        self.inverse_inertia = nodes
            .flat_map(|first| &inverse_inertia[first..first + d])
            .copied()
            .collect();
        self
    }

    /// Number of own steps of which one has an impulse.
    fn interval(&self, dt: T) -> usize {
        let steps = T::of(IMPULSE) / (self.top_rate * dt);
        // Infinite if no node is damped: the conversion then gives the largest integer.
        (steps.as_f64() as usize).clamp(1, u32::MAX as usize)
    }

    /// Computes the forces of an instant and adds them to `f`, for `N` components.
    fn add_to<const N: usize>(&mut self, instant: &Instant<'_, T>, f: &mut [T]) {
        let interval = self.interval(instant.dt);
        self.rests = instant.number == 0 || !instant.number.is_multiple_of(interval);
        if self.rests {
            return;
        }
        let f = f.as_chunks_mut::<N>().0;
        self.load_velocities::<N>(instant, f);
        self.update_forces::<N>(T::of(interval as f64));
        let force = self.force.as_chunks::<N>().0;
        for [place, node] in &self.local_nodes {
            let (force, f) = (&force[*place as usize], &mut f[*node as usize]);
            (0..N).for_each(|c| f[c] += force[c]);
        }
    }

    /// Sets the velocities of all damped nodes at the whole step; `f` are the other forces.
    fn load_velocities<const N: usize>(&mut self, instant: &Instant<'_, T>, f: &[[T; N]]) {
        let half = T::of(0.5) * instant.dt;
        let v = instant.v_half.as_chunks::<N>().0;
        let whole = |node: usize, inverse: &[T; N]| -> [T; N] {
            std::array::from_fn(|c| v[node][c] + half * inverse[c] * f[node][c])
        };
        let nodes = self.local_nodes.iter().map(|l| l[1] as usize);
        let nodes = nodes.zip(self.inverse_inertia.as_chunks::<N>().0);
        match &mut self.exchange {
            None => {
                let velocity = self.velocity.as_chunks_mut::<N>().0;
                for (out, (node, inverse)) in velocity.iter_mut().zip(nodes) {
                    *out = whole(node, inverse);
                }
            }
            Some(exchange) => {
                let local = exchange.v.as_chunks_mut::<N>().0;
                nodes.for_each(|(node, inverse)| local[node] = whole(node, inverse));
                let VelocityExchange { gather, messages, v } = exchange;
                gather.gather(N, messages, v, &mut self.velocity);
            }
        }
    }

    /// Computes the forces on all damped nodes, `strength` times as large as those of the damping rates.
    fn update_forces<const N: usize>(&mut self, strength: T) {
        let v = self.velocity.as_chunks::<N>().0;
        let sums = self.resolved.as_chunks_mut::<N>().0;
        let gather = &self.gather;
        gather.fill_rows(0..sums.len(), sums, &|j| gather.times(j, |k| v[k]));
        self.solve::<N>();
        let (scatter, resolved) = (&self.scatter, self.resolved.as_chunks::<N>().0);
        let (v, force) = (
            self.velocity.as_chunks::<N>().0,
            self.force.as_chunks_mut::<N>().0,
        );
        scatter.fill_rows(0..force.len(), force, &|k| {
            let projected = scatter.times(k, |j| resolved[j]);
            let damping = strength * self.damping[k];
            std::array::from_fn(|c| damping * (projected[c] - v[k][c]))
        });
    }
}

impl<T: Real> EffectSpec<T> for Absorber<T> {
    fn attach(self: Box<Self>, host: &Host<'_, T>) -> Result<Box<dyn Effect<T>>> {
        let layout = host.model.layout();
        let mut row = ShapeRow::default();
        let mut shapes: Vec<Shaped<T>> = Vec::new();
        for place in self.candidates(host)? {
            match self.resolved.shape_at(&place.x, false, &mut row) {
                Ok(()) => {
                    let entries = row.nodes.iter().copied().zip(row.values.iter().copied());
                    shapes.push((place, entries.collect()));
                }
                Err(Error::OutsideDomain { .. }) => {}
                Err(e) => return Err(e),
            }
        }
        // A zone that sleeps has no mediator, and nothing to damp.
        if shapes.is_empty() && !self.resolved.nodes().is_empty() {
            return Err(invalid(
                "absorber",
                host.model.name(),
                "has no node of this model in its resolved space",
            ));
        }
        let rates: Vec<T> = shapes.iter().map(|s| (self.rate)(&s.0.x)).collect();
        // Not `r < 0`: a NaN must be refused, too. A negative rate would create energy.
        if let Some(bad) = rates.iter().find(|r| !(**r >= T::zero() && r.is_finite())) {
            return Err(invalid("absorber rate", bad, "must be finite and not negative"));
        }
        let (shapes, damping) = damped(shapes, &rates);
        let nodes: Vec<usize> = shapes.iter().map(|s| s.0.node).collect();
        let n = shape_matrix(&shapes);
        let top = rates.into_iter().fold(T::zero(), T::max);
        let absorber = AttachedAbsorber::new(layout.components, &n, &nodes, damping, top);
        let absorber = absorber.ok_or_else(|| {
            let counts = format!("{} resolved unknowns for {} nodes", n.cols(), n.rows());
            let rule = "the resolved space must be coarser than the model";
            invalid("absorber", counts, rule)
        })?;
        let owned = host.owned()?;
        let absorber = match owned.is_part() {
            true => absorber.with_exchange(&owned, &nodes),
            false => absorber,
        };
        Ok(Box::new(absorber.with_masses(host.inverse_inertia)))
    }
}

/// A node: its number in the whole model, its reference position and its mass.
#[derive(Clone, Copy)]
struct Place<T: Real> {
    node: usize,
    x: Point3<T>,
    mass: T,
}

/// A node and the shape functions there.
type Shaped<T> = (Place<T>, Vec<(usize, T)>);

impl<T: Real> Absorber<T> {
    /// Nodes of the model. For a partitioned model: all nodes of all ranks that lie in the resolved space.
    /// Collective.
    fn candidates(&self, host: &Host<'_, T>) -> Result<Vec<Place<T>>> {
        let d = host.model.layout().components;
        let nodes = host.model.nodes().iter().enumerate();
        let owned = host.owned()?;
        let nodes = nodes.map(|(k, x)| Place {
            node: owned.global(k),
            x: *x,
            mass: host.inertia[k * d],
        });
        if !owned.is_part() {
            return Ok(nodes.collect());
        }
        let mut row = ShapeRow::default();
        let mut rows = Vec::new();
        for p in nodes {
            let outside = self.resolved.shape_at(&p.x, false, &mut row);
            // Points with other errors go to all ranks, so that all of them report the error in `attach`.
            if !matches!(outside, Err(Error::OutsideDomain { .. })) {
                rows.push((p.node, [p.x.x, p.x.y, p.x.z, p.mass].map(T::as_f64)));
            }
        }
        // In the order of the model, so that the result does not depend on the partition.
        let rows = owned.all_gather_rows(rows)?.into_iter();
        let place = |(node, numbers): (usize, [f64; 4])| {
            let [x, y, z, mass] = numbers.map(T::of);
            let x = Point3::new(x, y, z);
            Place { node, x, mass }
        };
        Ok(rows.map(place).collect())
    }
}

/// Nodes that are damped, and `m η` of each. Others change nothing, and functions that touch no damped node
/// would be undetermined: a node that sleeps has no mass.
fn damped<T: Real>(shapes: Vec<Shaped<T>>, rates: &[T]) -> (Vec<Shaped<T>>, Vec<T>) {
    let nodes = shapes.into_iter().zip(rates);
    let damping = nodes.map(|(s, rate)| (s.0.mass * *rate, s));
    damping
        .filter(|(damping, _)| *damping > T::zero())
        .map(|(damping, s)| (s, damping))
        .unzip()
}

/// Shape functions at nodes, a row per node. Only functions that touch a node take part: others would make
/// `NᵀDN` singular.
fn shape_matrix<T: Real>(shapes: &[Shaped<T>]) -> CsMat<T> {
    let touching = |s: &'_ Shaped<T>| s.1.clone().into_iter().filter(|e| e.1 != T::zero());
    let mut used: Vec<usize> = shapes.iter().flat_map(touching).map(|e| e.0).collect();
    used.sort_unstable();
    used.dedup();
    let mut n = TriMat::new((shapes.len(), used.len()));
    for (i, shape) in shapes.iter().enumerate() {
        for (j, v) in touching(shape) {
            n.add_triplet(i, used.partition_point(|u| *u < j), v);
        }
    }
    n.to_csr()
}

/// Share of its diagonal by which `NᵀDN` grows if it is singular.
const RAISED: f64 = 1e-12;

/// `NᵀDN`, a column at a time. Sums run over the rows of `N` in their order; a list of all products, eight
/// times eight for each row, would have to be sorted.
fn normal_matrix<T: Real>(n: &CsMat<T>, damping: &[T]) -> CsMat<T> {
    let size = n.cols();
    let (mut starts, mut rows, mut values) = (vec![0], Vec::new(), Vec::new());
    let (mut sums, mut column_of) = (vec![T::zero(); size], vec![usize::MAX; size]);
    for (a, column) in n.transpose_view().to_csr().outer_iterator().enumerate() {
        let first = rows.len();
        for (r, x) in column.iter() {
            for (b, y) in n.outer_view(r).iter().flat_map(|row| row.iter()) {
                if column_of[b] != a {
                    (column_of[b], sums[b]) = (a, T::zero());
                    rows.push(b);
                }
                sums[b] += *x * *y * damping[r];
            }
        }
        rows[first..].sort_unstable();
        values.extend(rows[first..].iter().map(|b| sums[*b]));
        starts.push(rows.len());
    }
    CsMat::new_csc((size, size), starts, rows, values)
}

/// Factor of `NᵀDN`; `None` unless the resolved space is coarser than the model.
fn factor<T: Real>(n: &CsMat<T>, damping: &[T]) -> Option<Box<dyn SpdFactor<T>>> {
    let mut g = normal_matrix(n, damping);
    if let Ok(factor) = T::cholesky(&g, None) {
        return Some(factor);
    }
    if n.cols() >= n.rows() {
        return None;
    }
    // Few nodes in a corner of the space do not tell its functions there apart. All solutions are the same
    // motion of the nodes, and this chooses one of them.
    let raised = T::one() + T::of(RAISED).max(T::epsilon() * T::of(64.0));
    for (i, mut column) in g.outer_iterator_mut().enumerate() {
        if let Some(diagonal) = column.get_mut(i) {
            *diagonal *= raised;
        }
    }
    T::cholesky(&g, None).ok()
}

impl<T: Real> AttachedAbsorber<T> {
    /// Power of the last forces on the nodes of this rank, exactly added up over units of nodes.
    fn local_power(&self, v: &[T]) -> Exact {
        if self.rests {
            return Exact::zero();
        }
        let (d, force, places) = (self.components, &self.force, &self.local_nodes);
        let row = |k: u32| k as usize * d..(k as usize + 1) * d;
        let part = |list: Range<usize>| {
            let nodes = places[list].iter();
            let powers = nodes.map(|[place, node]| dot(&force[row(*place)], &v[row(*node)]));
            [powers.sum::<T>()]
        };
        let [power] = self.cuts.local_sums(2 * d, &part);
        power
    }
}

impl<T: Real> AnyEffect<T> for AttachedAbsorber<T> {
    fn name(&self) -> &str {
        "absorber"
    }

    /// The absorber leaves rigid motion alone.
    fn arms(&self) -> Option<Arms> {
        Some(Arms::Reference)
    }

    fn supplied(&self) -> Option<T> {
        Some(T::zero())
    }
}

impl<T: Real> Effect<T> for AttachedAbsorber<T> {
    fn add_forces(&mut self, instant: &Instant<'_, T>, f: &mut [T]) -> Result<()> {
        match self.components {
            1 => self.add_to::<1>(instant, f),
            2 => self.add_to::<2>(instant, f),
            _ => self.add_to::<3>(instant, f),
        }
        Ok(())
    }

    /// Power on the nodes of this rank.
    fn power(&self, v: &[T]) -> T {
        T::of(self.local_power(v).value())
    }

    fn add_power(&self, _: &DofLayout, v: &[T], sum: &mut Exact) -> bool {
        *sum += self.local_power(v);
        true
    }

    fn nodes(&self) -> Option<&[u32]> {
        self.exchange.is_none().then_some(&self.nodes)
    }

    fn step_demand(&self) -> StepDemand<T> {
        // More than impulses need, whose velocities are those of the whole step; of rates above `2/Δt` it is
        // what keeps them from turning velocities round.
        StepDemand::damping(self.top_rate)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;

    fn instant(v: &[f64], dt: f64, number: usize) -> Instant<'_, f64> {
        Instant {
            time: 0.0,
            q: &[],
            v_half: v,
            dt,
            number,
            internal: &[],
            internal_before: &[],
        }
    }

    /// Two hat functions with equal values at every node cannot be told apart. Their common motion is
    /// resolved all the same, and energy only leaves.
    #[test]
    fn functions_that_no_node_tells_apart_are_resolved_together() {
        let mut n = TriMat::new((4, 3));
        for (i, share) in [1.0, 0.6, 0.3, 0.0].into_iter().enumerate() {
            for (j, v) in [share, 0.5 * (1.0 - share), 0.5 * (1.0 - share)]
                .into_iter()
                .enumerate()
            {
                n.add_triplet(i, j, v);
            }
        }
        let (nodes, damping) = ([0, 1, 2, 3], vec![2.0, 3.0, 1.0, 4.0]);
        let mut absorber = AttachedAbsorber::new(1, &n.to_csr(), &nodes, damping.clone(), 4.0)
            .expect("a factor")
            .with_masses(&[1.0; 4]);
        let mut forces = |v: [f64; 4]| {
            let mut f = [0.0; 4];
            absorber.add_to::<1>(&instant(&v, 1.0, 1), &mut f);
            f
        };
        assert!(forces([2.0, 1.6, 1.3, 1.0]).iter().all(|f| f.abs() < 1e-9));
        let v = [1.0, -1.0, 0.5, 0.2];
        assert!(dot(&forces(v), &v) < -0.1);
        // As many functions as nodes, one of them zero everywhere: the space is not coarser.
        let mut square = TriMat::new((3, 3));
        for (i, share) in [1.0, 0.5, 0.25].into_iter().enumerate() {
            square.add_triplet(i, 0, share);
            square.add_triplet(i, 1, 1.0 - share);
        }
        let square = square.to_csr();
        assert!(AttachedAbsorber::new(1, &square, &nodes[..3], damping[..3].to_vec(), 4.0).is_none());
    }

    /// The third node sleeps and the first lies at the border; only they touch the last function.
    #[test]
    fn nodes_without_mass_or_rate_do_not_count() {
        let shaped = |node: usize, mass: f64, entries: &[(usize, f64)]| {
            let x = Point3::new(node as f64, 0.0, 0.0);
            (Place { node, x, mass }, entries.to_vec())
        };
        let shapes = vec![
            shaped(4, 2.0, &[(0, 0.5), (7, 0.5)]),
            shaped(5, 3.0, &[(0, 0.75), (3, 0.25)]),
            shaped(6, 0.0, &[(7, 1.0)]),
            shaped(8, 5.0, &[(0, 1.0)]),
        ];
        let (shapes, damping) = damped(shapes, &[0.0, 10.0, 20.0, 30.0]);
        let nodes: Vec<_> = shapes.iter().map(|s| s.0.node).collect();
        assert_eq!((nodes, &damping), (vec![5, 8], &vec![30.0, 150.0]));
        let n = shape_matrix(&shapes);
        assert_eq!((n.rows(), n.cols()), (2, 2));
        assert!(factor(&n, &damping).is_some());
    }

    /// The rearranged force is `−(I − P)ᵀ D (I − P) v` for any number of components; fields of the resolved
    /// space feel none.
    #[test]
    fn the_force_is_the_symmetric_product_of_its_definition() {
        let (count, used) = (40, 4);
        let wave = |k: usize| (k as f64 * 0.7).sin();
        // Hat functions over the places of the nodes.
        let hats = |i: usize| {
            let s = i as f64 / count as f64 * (used - 1) as f64;
            let j = s as usize;
            [(j, 1.0 - s + j as f64), (j + 1, s - j as f64)]
        };
        let mut n = TriMat::new((count, used));
        let mut dense = DMatrix::<f64>::zeros(count, used);
        for i in 0..count {
            for (j, v) in hats(i) {
                n.add_triplet(i, j, v);
                dense[(i, j)] = v;
            }
        }
        let nodes: Vec<usize> = (0..count).map(|i| 2 * i + 1).collect();
        let damping: Vec<f64> = (0..count).map(|i| (1.5 + wave(i)) * (0.1 + i as f64)).collect();
        let rates = DMatrix::from_fn(count, count, |i, j| if i == j { damping[i] } else { 0.0 });
        let gram = (dense.transpose() * &rates * &dense)
            .try_inverse()
            .expect("regular");
        let left = DMatrix::identity(count, count) - &dense * gram * dense.transpose() * &rates;
        let product = -left.transpose() * rates * left;
        for components in [1, 2, 3] {
            let made = AttachedAbsorber::new(components, &n.to_csr(), &nodes, damping.clone(), 4.0);
            let size = (2 * count + 1) * components;
            let made = made.expect("positive definite");
            let mut absorber = made.with_masses(&vec![1.0; size]);
            let forces = |absorber: &mut AttachedAbsorber<f64>, v: &[f64]| {
                let mut f = vec![0.0; size];
                let instant = instant(v, 1.0, 1);
                absorber.add_forces(&instant, &mut f).expect("forces");
                f
            };
            let v: Vec<f64> = (0..size).map(wave).collect();
            let found = forces(&mut absorber, &v);
            let mut expected = vec![0.0; size];
            for c in 0..components {
                let part = DMatrix::from_fn(count, 1, |i, _| v[nodes[i] * components + c]);
                for (i, f) in (&product * part).iter().enumerate() {
                    expected[nodes[i] * components + c] = *f;
                }
            }
            for (a, b) in found.iter().zip(&expected) {
                assert!((a - b).abs() < 1e-13, "{components}: {a} {b}");
            }
            assert!(dot(&found, &v) < -0.1);
            let mut smooth = vec![0.0; size];
            for (i, &k) in nodes.iter().enumerate() {
                (0..components).for_each(|c| smooth[k * components + c] = 2.0 + dense[(i, 1)]);
            }
            let none = forces(&mut absorber, &smooth);
            assert!(none.iter().all(|f| f.abs() < 1e-13), "{components}");
        }
    }

    /// Energy `½ v² + ½ ω² u² (1 − ω² Δt²/4)`, which Verlet's scheme conserves, of two masses that vibrate
    /// against each other with impulses of the rate `η`, after each step; relative to the start.
    fn energies_of_a_vibration(phase: f64, rate: f64, steps: usize) -> Vec<f64> {
        let n = TriMat::from_triplets((2, 1), vec![0, 1], vec![0, 0], vec![1.0, 1.0]).to_csr();
        let mut absorber = AttachedAbsorber::new(1, &n, &[0, 1], vec![rate; 2], rate)
            .expect("a factor")
            .with_masses(&[1.0; 2]);
        let stiffness = 0.5 * phase * phase;
        let (mut q, mut v) = ([1.0, -1.0], [0.0; 2]);
        let mut a = [-stiffness * (q[0] - q[1]), stiffness * (q[0] - q[1])];
        let mut out = Vec::new();
        for k in 0..=steps {
            let energy = v[0] * v[0] + phase * phase * q[0] * q[0] * (1.0 - 0.25 * phase * phase);
            out.push(energy);
            (0..2).for_each(|i| v[i] += 0.5 * a[i]);
            (0..2).for_each(|i| q[i] += v[i]);
            let spring = stiffness * (q[0] - q[1]);
            let mut f = [-spring, spring];
            absorber
                .add_forces(&instant(&v, 1.0, k + 1), &mut f)
                .expect("forces");
            (0..2).for_each(|i| v[i] += 0.5 * f[i]);
            a = f;
        }
        out.iter().map(|e| e / out[0]).collect()
    }

    /// Vibrations up to the limit of Verlet's scheme, `ω Δt = 2`, never grow, whatever their rhythm. Those of
    /// waves, which meet an impulse in each half of their period, are damped at the rate.
    #[test]
    fn impulses_damp_waves_at_the_rate_and_feed_no_vibration() {
        let (rate, steps, interval) = (0.05, 2000, 5.0);
        for k in 1..40 {
            let phase = 0.05 * f64::from(k);
            let energies = energies_of_a_vibration(phase, rate, steps);
            let grows = energies.windows(2).map(|e| e[1] / e[0]).fold(0.0, f64::max);
            let measured = -energies[steps].ln() / steps as f64;
            assert!(grows < 1.0 + 1e-12, "{phase}: {grows}");
            let is_wave = interval * phase < 2.6;
            assert!(
                !is_wave || (measured / rate - 1.0).abs() < 0.2,
                "{phase}: {measured}"
            );
        }
        // Halves of an impulse end one step and begin the next; three steps without any follow.
        let energies = energies_of_a_vibration(0.5, rate, 20);
        let rests = energies.windows(2).map(|e| e[1] > e[0] * (1.0 - 1e-9));
        let expected = (0..20).map(|k| k == 0 || (k + 1) % 5 > 1);
        assert!(rests.eq(expected), "{energies:?}");
    }
}
