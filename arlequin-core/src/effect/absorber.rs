//! The overlap absorber: removes motion that the coarse model cannot carry.
//!
//! The constrained scheme filters nothing: everything above the coarse cutoff is reflected. The absorber
//! damps the unresolved part `v' = v − P v` of the fine velocities in the overlap, where `P` is the
//! mass-weighted projection onto a resolved space (the mediator's or a coarser one). Its force has the
//! symmetric form `F = −(I − P)ᵀ diag(m η) (I − P) v`: rigid motions are untouched, and energy only leaves.

use super::{AnyEffect, Effect, EffectSpec, Host, Instant, StepDemand};
use crate::error::invalid;
use crate::field::{Interpolation, ShapeRow};
use crate::interface::{Rows, add_at};
use crate::linalg::SpdFactor;
use crate::model::{Arms, DofLayout};
use crate::ranks::{Gather, Message};
use crate::scalar::dot;
use crate::{Error, Exact, Owned, Real, Result, parallel};
use nalgebra::Point3;
use rayon::prelude::*;
use sprs::{CsMat, TriMat};
use std::sync::Arc;

/// Damping rate `η` \[1/s\] as a function of position.
pub type RateField<T> = Arc<dyn Fn(&Point3<T>) -> T + Send + Sync>;

/// The absorber of one overlap, acting on the fine model.
pub struct Absorber<T: Real> {
    resolved: Arc<dyn Interpolation<T>>,
    rate: RateField<T>,
}

/// An absorber that is attached to the nodes of a model.
///
/// With `D = diag(m η)`, shape functions `N`, `G = NᵀMN`, `y = G⁻¹NᵀM v` and `z = G⁻¹(NᵀD v − NᵀDN y)` the
/// force is `−D (v − N y) + M N z`. In this form `Nᵀ` and `N` are each applied once.
struct AttachedAbsorber<T: Real> {
    top_rate: T,
    components: usize,
    /// Nodes in the resolved space, ascending; for a partitioned model, places in the list of these nodes on
    /// all ranks.
    nodes: Vec<u32>,
    /// Place in `nodes` and local number of each of these nodes that this rank owns.
    local_nodes: Vec<[u32; 2]>,
    /// Exchange of velocities with other ranks.
    exchange: Option<VelocityExchange<T>>,
    /// `m` and `m η` of each node.
    mass: Vec<[T; 2]>,
    /// `Nᵀ`, `N` and `NᵀDN`.
    gather: Rows<T>,
    scatter: Rows<T>,
    damped: Rows<T>,
    factor: Box<dyn SpdFactor<T>>,
    /// Two vectors per node: `m v` and `m η v`.
    local: Vec<T>,
    /// Two vectors per resolved node: the sums `NᵀM v` and `NᵀD v`, later `y` and `z`.
    coarse: Vec<T>,
    /// One vector per resolved node, components interleaved.
    resolved: Vec<T>,
    /// The same numbers component by component, as the factor takes them.
    columns: Vec<T>,
    force: Vec<T>,
}

/// Velocities of all nodes in the resolved space, gathered from all ranks.
struct VelocityExchange<T> {
    gather: Gather,
    messages: Vec<Message>,
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

/// Nodes per parallel task.
const GRAIN: usize = 1_024;

impl<T: Real> AttachedAbsorber<T> {
    /// Absorber for shape functions `n` (a row per node), `[m, m η]` of the nodes and the largest `η`; `None`
    /// if `G` is not positive definite.
    fn new(components: usize, n: &CsMat<T>, nodes: &[usize], mass: Vec<[T; 2]>, top_rate: T) -> Option<Self> {
        let zeros = |count: usize| vec![T::zero(); count * components];
        Some(Self {
            top_rate,
            components,
            gather: rows(&n.transpose_view().to_csr()),
            damped: rows(&gram(n, |i| mass[i][1])),
            scatter: rows(n),
            factor: factor(n, &mass)?,
            local: zeros(2 * nodes.len()),
            coarse: zeros(2 * n.cols()),
            resolved: zeros(n.cols()),
            columns: zeros(n.cols()),
            force: zeros(nodes.len()),
            local_nodes: (0..).zip(nodes).map(|(place, k)| [place, *k as u32]).collect(),
            exchange: None,
            nodes: nodes.iter().map(|k| *k as u32).collect(),
            mass,
        })
    }

    /// Applies `G⁻¹` to `resolved` and copies the result to the first or second half of `coarse`.
    fn solve<const N: usize, const W: usize>(&mut self, half: usize) {
        let count = self.factor.size();
        let (resolved, coarse) = (
            self.resolved.as_chunks_mut::<N>().0,
            self.coarse.as_chunks_mut::<W>().0,
        );
        // The factor takes components one after the other, the products take them interleaved.
        for (j, x) in resolved.iter().enumerate() {
            (0..N).for_each(|c| self.columns[c * count + j] = x[c]);
        }
        self.factor.solve(&mut self.columns);
        for (j, (x, pair)) in resolved.iter_mut().zip(coarse).enumerate() {
            for c in 0..N {
                x[c] = self.columns[c * count + j];
                pair[half * N + c] = x[c];
            }
        }
    }

    /// Sets up the exchange of velocities with other ranks. `nodes` are numbers in the whole model.
    fn with_exchange(mut self, owned: &Owned, nodes: &[usize]) -> Self {
        let gather = Gather::new(owned, 1, nodes.iter().copied());
        self.local_nodes = gather.own().to_vec();
        self.nodes = (0..nodes.len() as u32).collect();
        self.exchange = Some(VelocityExchange {
            messages: gather.messages(self.components),
            v: vec![T::zero(); nodes.len() * self.components],
            gather,
        });
        self
    }

    /// Adds the force to `f`, for `N` components and `W = 2 N`.
    fn add_to<const N: usize, const W: usize>(&mut self, v: &[T], f: &mut [T]) {
        // Taken out for the call, as `update_forces` borrows all of `self`.
        if let Some(mut exchange) = self.exchange.take() {
            exchange
                .gather
                .gather(N, &mut exchange.messages, v, &mut exchange.v);
            self.update_forces::<N, W>(&exchange.v);
            self.exchange = Some(exchange);
        } else {
            self.update_forces::<N, W>(v);
            return add_at(
                &self.nodes,
                self.force.as_chunks::<N>().0,
                0,
                f.as_chunks_mut::<N>().0,
            );
        }
        let (force, f) = (self.force.as_chunks::<N>().0, f.as_chunks_mut::<N>().0);
        for [place, node] in &self.local_nodes {
            let (force, f) = (&force[*place as usize], &mut f[*node as usize]);
            (0..N).for_each(|c| f[c] += force[c]);
        }
    }

    /// Computes the forces on all nodes of the resolved space.
    fn update_forces<const N: usize, const W: usize>(&mut self, v: &[T]) {
        let v = v.as_chunks::<N>().0;
        let load = |nodes: &[u32], mass: &[[T; 2]], local: &mut [[T; W]]| {
            // Both products at once: velocities are read once.
            for ((node, mass), local) in nodes.iter().zip(mass).zip(local) {
                let v = &v[*node as usize];
                (0..W).for_each(|c| local[c] = mass[c / N] * v[c % N]);
            }
        };
        let local = self.local.as_chunks_mut::<W>().0;
        if parallel::pays(W * local.len()) {
            let parts = self.nodes.par_chunks(GRAIN).zip(self.mass.par_chunks(GRAIN));
            let parts = parts.zip(local.par_chunks_mut(GRAIN));
            parts.for_each(|((nodes, mass), local)| load(nodes, mass, local));
        } else {
            load(&self.nodes, &self.mass, local);
        }
        // `NᵀM v` and `NᵀD v` in one pass.
        self.gather.product::<W>(&self.local, &mut self.coarse);
        for (x, pair) in self
            .resolved
            .as_chunks_mut::<N>()
            .0
            .iter_mut()
            .zip(self.coarse.as_chunks::<W>().0)
        {
            x.copy_from_slice(&pair[..N]);
        }
        self.solve::<N, W>(0);
        // `columns` is free between the two solves.
        self.damped.product::<N>(&self.resolved, &mut self.columns);
        let parts = self
            .columns
            .as_chunks::<N>()
            .0
            .iter()
            .zip(self.coarse.as_chunks::<W>().0);
        // `NᵀD v − NᵀDN y`, the right-hand side of the second solve.
        for (x, (seen, pair)) in self.resolved.as_chunks_mut::<N>().0.iter_mut().zip(parts) {
            (0..N).for_each(|c| x[c] = pair[N + c] - seen[c]);
        }
        self.solve::<N, W>(1);
        let (scatter, coarse) = (&self.scatter, self.coarse.as_chunks::<W>().0);
        let force = self.force.as_chunks_mut::<N>().0;
        scatter.fill_rows(0..force.len(), force, &|k| {
            let (projected, v, [mass, damping]) = (
                scatter.times(k, |j| coarse[j]),
                &v[self.nodes[k] as usize],
                self.mass[k],
            );
            std::array::from_fn(|c| mass * projected[N + c] - damping * (v[c] - projected[c]))
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
        if shapes.is_empty() {
            return Err(invalid(
                "absorber",
                host.model.name(),
                "has no node of this model in its resolved space",
            ));
        }
        let nodes: Vec<usize> = shapes.iter().map(|s| s.0.node).collect();
        // Only shape functions that touch a node take part: others would make `G` singular.
        let mut used: Vec<usize> = shapes
            .iter()
            .flat_map(|s| s.1.iter().filter(|e| e.1 != T::zero()).map(|e| e.0))
            .collect();
        used.sort_unstable();
        used.dedup();
        let mut n = TriMat::new((shapes.len(), used.len()));
        for (i, (_, entries)) in shapes.iter().enumerate() {
            for (j, v) in entries.iter().filter(|e| e.1 != T::zero()) {
                n.add_triplet(i, used.partition_point(|u| u < j), *v);
            }
        }
        let n: CsMat<T> = n.to_csr();
        let rates: Vec<T> = shapes.iter().map(|s| (self.rate)(&s.0.x)).collect();
        // Not `r < 0`: a NaN must be refused, too. A negative rate would create energy.
        if let Some(bad) = rates.iter().find(|r| !(**r >= T::zero() && r.is_finite())) {
            return Err(invalid("absorber rate", bad, "must be finite and not negative"));
        }
        let masses = shapes.iter().map(|s| s.0.mass);
        let mass: Vec<[T; 2]> = masses.zip(&rates).map(|(m, r)| [m, m * *r]).collect();
        let top = rates.iter().fold(T::zero(), |a, b| a.max(*b));
        let counts = format!("{} resolved unknowns for {} nodes", used.len(), nodes.len());
        let absorber = AttachedAbsorber::new(layout.components, &n, &nodes, mass, top);
        let absorber = absorber.ok_or_else(|| {
            let rule = "the resolved space must be coarser than the model";
            invalid("absorber", counts, rule)
        })?;
        let owned = host.owned()?;
        Ok(Box::new(match owned.is_part() {
            true => absorber.with_exchange(&owned, &nodes),
            false => absorber,
        }))
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

/// Share of its diagonal by which `G` grows if it is singular.
const RAISED: f64 = 1e-12;

/// Factor of `G`; `None` unless the resolved space is coarser than the model.
fn factor<T: Real>(n: &CsMat<T>, mass: &[[T; 2]]) -> Option<Box<dyn SpdFactor<T>>> {
    let mut g = gram(n, |i| mass[i][0]);
    if let Ok(factor) = T::cholesky(&g.to_csc(), None) {
        return Some(factor);
    }
    if n.cols() >= n.rows() {
        return None;
    }
    // Few nodes in a corner of the space do not tell its functions there apart. All solutions are the same
    // motion of the nodes, and this chooses one of them.
    let raised = T::one() + T::of(RAISED).max(T::epsilon() * T::of(64.0));
    for (i, mut row) in g.outer_iterator_mut().enumerate() {
        if let Some(diagonal) = row.get_mut(i) {
            *diagonal *= raised;
        }
    }
    T::cholesky(&g.to_csc(), None).ok()
}

/// `Nᵀ diag(w) N`.
fn gram<T: Real>(n: &CsMat<T>, w: impl Fn(usize) -> T) -> CsMat<T> {
    let mut sum = TriMat::new((n.cols(), n.cols()));
    for (i, r) in n.outer_iterator().enumerate() {
        for (a, x) in r.iter() {
            r.iter().for_each(|(b, y)| sum.add_triplet(a, b, *x * *y * w(i)));
        }
    }
    sum.to_csr()
}

fn rows<T: Real>(matrix: &CsMat<T>) -> Rows<T> {
    Rows::from_entries(matrix.rows(), matrix.iter().map(|(v, (i, j))| (i, j, *v)))
}

impl<T: Real> AttachedAbsorber<T> {
    /// Power of the last forces on each node of this rank.
    fn nodal_powers<'a>(&'a self, v: &'a [T]) -> impl Iterator<Item = T> + 'a {
        let d = self.components;
        let row = move |x: &'a [T], k: u32| &x[k as usize * d..][..d];
        self.local_nodes
            .iter()
            .map(move |[place, node]| dot(row(&self.force, *place), row(v, *node)))
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
            1 => self.add_to::<1, 2>(instant.v_half, f),
            2 => self.add_to::<2, 4>(instant.v_half, f),
            _ => self.add_to::<3, 6>(instant.v_half, f),
        }
        Ok(())
    }

    /// Power on the nodes of this rank.
    fn power(&self, v: &[T]) -> T {
        self.nodal_powers(v).sum()
    }

    fn add_power(&self, _: &DofLayout, v: &[T], sum: &mut Exact) -> bool {
        self.nodal_powers(v).for_each(|p| sum.add(p.as_f64()));
        true
    }

    fn step_demand(&self) -> StepDemand<T> {
        StepDemand::damping(self.top_rate)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;

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
        let (nodes, mass) = ([0, 1, 2, 3], vec![[1.0, 2.0], [1.5, 3.0], [0.7, 1.0], [1.2, 4.0]]);
        let mut absorber =
            AttachedAbsorber::new(1, &n.to_csr(), &nodes, mass.clone(), 4.0).expect("a factor");
        let mut forces = |v: [f64; 4]| {
            let mut f = [0.0; 4];
            absorber.add_to::<1, 2>(&v, &mut f);
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
        assert!(AttachedAbsorber::new(1, &square, &nodes[..3], mass[..3].to_vec(), 4.0).is_none());
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
        let mass: Vec<[f64; 2]> = (0..count).map(|i| [1.5 + wave(i), 0.1 * i as f64]).collect();
        let of = |k: usize| DMatrix::from_fn(count, count, |i, j| if i == j { mass[i][k] } else { 0.0 });
        let gram = (dense.transpose() * of(0) * &dense)
            .try_inverse()
            .expect("regular");
        let left = DMatrix::identity(count, count) - &dense * gram * dense.transpose() * of(0);
        let product = -left.transpose() * of(1) * left;
        for components in [1, 2, 3] {
            let made = AttachedAbsorber::new(components, &n.to_csr(), &nodes, mass.clone(), 4.0);
            let mut absorber = made.expect("positive definite");
            let size = (2 * count + 1) * components;
            let forces = |absorber: &mut AttachedAbsorber<f64>, v: &[f64]| {
                let mut f = vec![0.0; size];
                match components {
                    1 => absorber.add_to::<1, 2>(v, &mut f),
                    2 => absorber.add_to::<2, 4>(v, &mut f),
                    _ => absorber.add_to::<3, 6>(v, &mut f),
                }
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
}
