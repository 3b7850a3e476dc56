//! Energy released per area as a crack grows: Rice's J as an integral over a domain around the front.
//!
//! A field `s = q d` moves material points along the direction `d` in which the crack would grow. `q` is one
//! up to an inner radius around the front and falls to zero at an outer radius. The energy released as the
//! front moves by `∫ q dl` is (Li, Shih and Needleman 1985; de Lorenzi 1982 as a virtual extension of the
//! crack)
//!
//! ```text
//! J ∫ q dl = ∫ (σ_ij u_i,k − W δ_jk) s_k,j dV − Σ_a (f_a − m_a ü_a)·(∇u s)_a
//! ```
//!
//! with the forces `f_a` on the nodes. `q` has nodal values; stress and energy density `W` are those of the
//! model's integration points. Without forces the integral is therefore exactly minus the derivative of the
//! model's own potential energy as its nodes move by `s`. By the balance of the nodes `f − m ü` is minus the
//! internal force, so that loads, body forces and inertia in the domain need no terms of their own. A
//! displacement prescribed by a support is taken to be uniform along `d`.
//!
//! Small strains, linear elasticity. In the ring between the radii, the faces of the crack and all other
//! surfaces and borders of materials have to be parallel to `d`; others are refused.

mod front;

pub use front::CrackFront;

use crate::adjacency::lowest_connected;
use crate::error::invalid;
use crate::field::Interpolation;
use crate::material::Elastic;
use crate::model::Model;
use crate::recovery::SymmetricTensor;
use crate::weight::Weight;
use crate::{Error, Real, Result};
use front::{Cylinder, nodes_along, place, swept, tapers};
use nalgebra::{Matrix3, Point3, SymmetricEigen, Vector3};
use std::cmp::Ordering;
use std::collections::{BTreeMap, BTreeSet};

/// Integration point of a model.
#[derive(Debug)]
pub struct GradientPoint<'a, T: Real> {
    /// Nodes on whose displacements the strain depends.
    pub nodes: &'a [u32],
    /// Gradients of their shape functions there \[1/m\].
    pub gradients: &'a [Vector3<T>],
    /// Volume \[m³\].
    pub volume: T,
    /// Material at the point.
    pub material: &'a Elastic<T>,
}

/// Continuum whose unweighted energy `Σ V W(ε)` is a sum over integration points.
pub trait Gradients<T: Real> {
    /// Returns the number of cells: finite elements, or cells of nodes.
    fn count(&self) -> usize;

    /// Calls `visit` with each integration point of a cell.
    fn for_each_point(&self, cell: usize, visit: &mut dyn FnMut(&GradientPoint<'_, T>));
}

/// Largest share of a node's surface that may face the direction of the crack: a few degrees off count as
/// parallel.
const FACING: f64 = 0.02;
/// Smallest share of a node's area that has to be out of balance for the node to lie on a surface.
const ON_SURFACE: f64 = 0.05;
/// Distance from the front over the inner radius below which a node lies on the front.
const AT_FRONT: f64 = 1e-3;
/// Share of the inner radius by which faces of a slit may reach ahead of the front: the tip then lies well
/// within the radius.
const BEHIND: f64 = 0.25;
/// Distance over the outer radius below which two nodes coincide.
const COINCIDENT: f64 = 1e-6;
/// Integration point in the domain, with places in the lists of [`EnergyRelease`].
#[derive(Debug, Clone)]
struct Place<T: Real> {
    /// Range of its nodes and gradients in `rows`.
    rows: [usize; 2],
    volume: T,
    material: Elastic<T>,
}

/// Domain integral around a crack front, for any displacements of its model.
#[derive(Debug, Clone)]
pub struct EnergyRelease<T: Real> {
    /// Nodes of the domain, ascending.
    nodes: Vec<usize>,
    /// `s` at each node of the domain.
    shifts: Vec<Vector3<T>>,
    places: Vec<Place<T>>,
    /// Nodes of the points (places in `nodes`) with their shape function gradients \[1/m\].
    rows: Vec<(u32, Vector3<T>)>,
    /// `∂u/∂s` at each moved node, as nodes and factors.
    slopes: Vec<(usize, Vec<(u32, T)>)>,
    /// `∫ q dl` \[m\].
    swept: T,
    unknowns: usize,
}

/// Refuses a slit ahead of the front, where two nodes coincide: the front is then behind the slit's tip, or
/// the direction points backwards.
fn check_slits<T: Real>(
    model: &dyn Model<T>,
    q: &[T],
    cylinder: &Cylinder<T>,
    direction: &Vector3<T>,
) -> Result<()> {
    let [inner, outer] = cylinder.radii;
    // Relative to the domain: the two faces of a slit may differ by the digits of a mesh file.
    let close = outer * T::of(COINCIDENT);
    // Sorted along a line that is skew to mesh planes, nodes that are close are neighbours in the list.
    let skew = Vector3::new(T::of(0.727), T::of(0.549), T::of(0.412));
    let moved = model.nodes().iter().zip(q).filter(|(_, q)| **q > T::zero());
    let arms = moved.map(|(x, _)| x - cylinder.from);
    let ahead = arms.filter(|arm| arm.dot(direction) > inner * T::of(BEHIND));
    let mut ahead: Vec<(T, Vector3<T>)> = ahead.map(|arm| (skew.dot(&arm), arm)).collect();
    ahead.sort_by(|a, b| a.0.partial_cmp(&b.0).unwrap_or(Ordering::Equal));
    for (k, (key, arm)) in ahead.iter().enumerate() {
        let near = ahead[k + 1..].iter().take_while(|b| b.0 - *key <= close);
        if near.into_iter().any(|(_, b)| (b - arm).norm() <= close) {
            let rule = "faces of a slit lie there, ahead of the front: put the front where the crack ends, and let the direction \
                        lead away from its faces; or take smaller radii, if it is another crack";
            return Err(invalid("node", place(&(cylinder.from + arm)), rule));
        }
    }
    Ok(())
}

/// Zeroes `q` at nodes that are not connected, through moved nodes, to the nodes `along` the front: another
/// front on the same line is another crack.
fn leave_others_out<T: Real>(gradients: &dyn Gradients<T>, along: &[u32], q: &mut [T]) {
    let mut pairs: Vec<[u32; 2]> = Vec::new();
    for cell in 0..gradients.count() {
        gradients.for_each_point(cell, &mut |p| {
            let mut moved = p.nodes.iter().filter(|n| q[**n as usize] > T::zero());
            if let Some(first) = moved.next() {
                pairs.extend(moved.map(|n| [*first, *n]));
            }
        });
    }
    // Pieces joined by moved nodes alone: the domain ends where `q` is zero.
    let piece = lowest_connected(q.len(), pairs.iter().copied());
    let moved = along.iter().filter(|n| q[**n as usize] > T::zero());
    let connected: BTreeSet<u32> = moved.map(|n| piece[*n as usize]).collect();
    for (q, piece) in q.iter_mut().zip(&piece) {
        if !connected.contains(piece) {
            *q = T::zero();
        }
    }
}

/// Surface at a node: its area vector, and the sum of the areas that balance inside the body \[m²\].
type Facing<T> = (Vector3<T>, T);

impl<T: Real> EnergyRelease<T> {
    /// Finds the domain around a crack front in a model with this field. `alpha`: weight of the model's
    /// energy.
    ///
    /// # Errors
    /// [`Error::Unsupported`] for a model without [`crate::Views::gradients`];
    /// [`Error::InvalidParameter`] for radii, a front or a direction that make no sense, a front without
    /// material ahead or without a surface around it, surfaces or borders of materials across the ring, and
    /// a domain in which the weight is not one.
    pub fn new(
        model: &dyn Model<T>,
        field: &dyn Interpolation<T>,
        alpha: &dyn Weight<T>,
        crack: &CrackFront<T>,
    ) -> Result<Self> {
        let Some(gradients) = model.views().gradients else {
            return Err(Error::Unsupported {
                model: model.name().to_owned(),
                what: format!(
                    "tell the energy that a crack releases: models of kind '{}' have no stresses over a volume; look at a \
                     solid of finite or natural elements",
                    model.kind()
                ),
            });
        };
        let (axis, length, direction) = crack.axes()?;
        let cylinder = Cylinder {
            from: crack.ends[0],
            axis,
            length,
            radii: crack.radii,
            tapers: tapers(model.name(), field, crack, length, &direction)?,
        };
        // Across times along: `q` is one near the front and falls to zero in both directions.
        let share = |x: &Point3<T>| cylinder.shares(x).into_iter().fold(T::one(), |q, f| q * f);
        let mut q: Vec<T> = model.nodes().iter().map(share).collect();
        check_slits(model, &q, &cylinder, &direction)?;
        leave_others_out(gradients, &nodes_along(field, crack, &direction)?, &mut q);
        let mut out = Self::collect_points(model, gradients, &q, &direction);
        if out.places.is_empty() {
            let radii = format_args!("[{}, {}]", crack.radii[0], crack.radii[1]);
            let rule = format!("no node of model '{}' lies within; enlarge them", model.name());
            return Err(invalid("radii of the crack front", radii, &rule));
        }
        out.check_weight(model, alpha)?;
        let facing = out.check_surfaces(model, &cylinder, &direction)?;
        out.find_slopes(model, &cylinder, &facing);
        out.swept = swept(field, crack, &cylinder, &direction)?;
        Ok(out)
    }

    /// Collects the integration points that depend on a moved node.
    fn collect_points(
        model: &dyn Model<T>,
        gradients: &dyn Gradients<T>,
        q: &[T],
        direction: &Vector3<T>,
    ) -> Self {
        let (mut places, mut rows) = (Vec::new(), Vec::new());
        for cell in 0..gradients.count() {
            gradients.for_each_point(cell, &mut |p| {
                // A point whose nodes all stand still adds nothing, as `s` is zero around it.
                if p.nodes.iter().any(|n| q[*n as usize] > T::zero()) {
                    let first = rows.len();
                    rows.extend(p.nodes.iter().copied().zip(p.gradients.iter().copied()));
                    places.push(Place {
                        rows: [first, rows.len()],
                        volume: p.volume,
                        material: *p.material,
                    });
                }
            });
        }
        let mut nodes: Vec<usize> = rows.iter().map(|r| r.0 as usize).collect();
        nodes.sort_unstable();
        nodes.dedup();
        let number: BTreeMap<usize, u32> = nodes.iter().copied().zip(0..).collect();
        rows.iter_mut().for_each(|r| r.0 = number[&(r.0 as usize)]);
        Self {
            shifts: nodes.iter().map(|n| direction * q[*n]).collect(),
            nodes,
            places,
            rows,
            slopes: Vec::new(),
            swept: T::zero(),
            unknowns: model.layout().dofs(),
        }
    }

    /// Refuses a domain that shares its energy with another model.
    fn check_weight(&self, model: &dyn Model<T>, alpha: &dyn Weight<T>) -> Result<()> {
        // A weight of one is computed from positions and misses it by round-off.
        let slack = T::epsilon() * T::of(1e3);
        for n in &self.nodes {
            let (x, w) = (model.nodes()[*n], alpha.value(&model.nodes()[*n]));
            if (w - T::one()).abs() > slack {
                let rule = format!(
                    "the domain around the crack front reaches into an overlap, where another model has a part of the energy \
                     (weight {w} of '{}'); take smaller radii, or move the overlap away from the crack",
                    model.name()
                );
                return Err(invalid("node", place(&x), &rule));
            }
        }
        Ok(())
    }

    fn row(&self, p: &Place<T>) -> &[(u32, Vector3<T>)] {
        &self.rows[p.rows[0]..p.rows[1]]
    }

    /// Refuses a ring across which surfaces of the body or borders of its materials face the direction of the
    /// crack, and a front without a surface around it. Returns the surface at each node. `Σ V ∇N` over the
    /// points of one material around a node is the surface of that material there.
    fn check_surfaces(
        &self,
        model: &dyn Model<T>,
        cylinder: &Cylinder<T>,
        direction: &Vector3<T>,
    ) -> Result<Vec<Facing<T>>> {
        let mut materials: Vec<Elastic<T>> = Vec::new();
        let none = (Vector3::zeros(), T::zero());
        let mut areas: Vec<Vec<Vector3<T>>> = Vec::new();
        let mut facing = vec![none; self.nodes.len()];
        for p in &self.places {
            let number = materials.iter().position(|m| *m == p.material);
            let m = number.unwrap_or_else(|| {
                materials.push(p.material);
                areas.push(vec![Vector3::zeros(); self.nodes.len()]);
                materials.len() - 1
            });
            for (n, g) in self.row(p) {
                let area = g * p.volume;
                // By material: a border between two materials is a surface of each, though not of the body.
                areas[m][*n as usize] += area;
                facing[*n as usize].0 += area;
                // Moduli as well: at an inner node the areas cancel, and this sum tells how well.
                facing[*n as usize].1 += area.norm();
            }
        }
        let mut cracked = false;
        for (k, n) in self
            .nodes
            .iter()
            .enumerate()
            .filter(|k| self.shifts[k.0] != Vector3::zeros())
        {
            let x = model.nodes()[*n];
            let (area, size) = facing[k];
            // Surfaces within the inner radius may lie anyhow: one of them has to be the crack's.
            if cylinder.shares(&x)[0] >= T::one() {
                // End faces of the body, which the front meets, are no faces of the crack.
                let across = area - cylinder.axis * area.dot(&cylinder.axis);
                cracked |= across.norm() > size * T::of(ON_SURFACE);
                continue;
            }
            let faces = |area: &Vector3<T>| area.dot(direction).abs() > size * T::of(FACING);
            let rule = if faces(&area) {
                "the ring between the radii of the crack front meets a surface there that is not parallel to the direction of the \
                 crack: an end of the body, or faces of the crack that are not along the direction; change radii or direction"
            } else if areas.iter().any(|a| faces(&a[k])) {
                "the ring between the radii of the crack front meets a border of materials there that is not parallel to the \
                 direction of the crack; take smaller radii"
            } else {
                continue;
            };
            return Err(invalid("node", place(&x), rule));
        }
        if cracked {
            return Ok(facing);
        }
        let rule = "there is no surface of a crack within this distance of the front; put the front where the crack ends, with an \
                    inner radius of two elements or more";
        Err(invalid(
            "inner radius of the crack front",
            cylinder.radii[0],
            rule,
        ))
    }

    /// Finds factors of `∂u/∂s` at the moved nodes, by least squares over the nodes of their cells; at a
    /// surface only over those in the surface. In the stead of a node of the front, its neighbours on the
    /// faces get in addition half of the derivative between them and the front.
    fn find_slopes(&mut self, model: &dyn Model<T>, cylinder: &Cylinder<T>, facing: &[Facing<T>]) {
        let mut around: Vec<Vec<u32>> = vec![Vec::new(); self.nodes.len()];
        for p in &self.places {
            for (n, _) in self.row(p) {
                if self.shifts[*n as usize] != Vector3::zeros() {
                    around[*n as usize].extend(self.row(p).iter().map(|r| r.0));
                }
            }
        }
        let x = |n: usize| model.nodes()[self.nodes[n]];
        let slope_row = |(n, near): (usize, &mut Vec<u32>)| {
            near.sort_unstable();
            near.dedup();
            // At a surface only nodes in it count, so that the sum over the faces of a crack is a sum by
            // parts. A node of the front belongs to both faces, whose forces on it cancel.
            let (area, size) = facing[n];
            let normal = (area.norm() > size * T::of(ON_SURFACE)).then(|| area.normalize());
            let arm = |m: &u32| {
                let d = x(*m as usize) - x(n);
                let out = normal.map_or(T::zero(), |normal| normal.dot(&d));
                let flat = d.norm() > T::zero() && out.abs() <= d.norm() * T::of(ON_SURFACE);
                let d = normal.map_or(d, |normal| d - normal * out);
                flat.then_some((*m, d))
            };
            let arms: Vec<(u32, Vector3<T>)> = near.iter().filter_map(arm).collect();
            let mut row = slope(n as u32, &arms, &self.shifts[n]);
            if normal.is_some() {
                let at_front =
                    |m: u32| cylinder.distance(&x(m as usize)) < cylinder.radii[0] * T::of(AT_FRONT);
                let ends: Vec<_> = arms.iter().filter(|a| at_front(a.0)).copied().collect();
                let half = slope(n as u32, &ends, &self.shifts[n]).into_iter();
                row.extend(half.map(|(m, c)| (m, c * T::of(0.5))));
            }
            (n, row)
        };
        let moving = around.iter_mut().enumerate().filter(|(_, near)| !near.is_empty());
        self.slopes = moving.map(slope_row).collect();
    }

    /// Returns the nodes of the domain, ascending.
    pub fn nodes(&self) -> &[usize] {
        &self.nodes
    }

    /// Returns the energy released per area of crack \[J/m²\], the mean over the part of the front. `q`:
    /// displacements, `f`: internal forces of the model. `free`: whether no support prescribes an unknown.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] for displacements or forces of another model.
    pub fn at(&self, q: &[T], f: &[T], free: impl Fn(usize) -> bool) -> Result<T> {
        for (what, x) in [("displacements", q), ("internal forces", f)] {
            if x.len() != self.unknowns {
                return Err(Error::SizeMismatch {
                    what: format!("{what} around a crack front"),
                    expected: self.unknowns,
                    found: x.len(),
                });
            }
        }
        let u = |n: u32| Vector3::from_column_slice(&q[3 * self.nodes[n as usize]..][..3]);
        let mut released = T::zero();
        for p in &self.places {
            let h = self
                .row(p)
                .iter()
                .fold(Matrix3::zeros(), |h, (n, g)| h + u(*n) * g.transpose());
            let strain = SymmetricTensor::from_matrix(&h);
            let stress = p.material.stress(&strain).matrix();
            let density = stress.component_mul(&strain.matrix()).sum() * T::of(0.5);
            // Minus the energy-momentum tensor of Eshelby.
            let flux = h.transpose() * stress - Matrix3::from_diagonal_element(density);
            for (n, g) in self.row(p) {
                released += self.shifts[*n as usize].dot(&(flux * g)) * p.volume;
            }
        }
        for (n, row) in &self.slopes {
            let slope = row.iter().fold(Vector3::zeros(), |s, (m, c)| s + u(*m) * *c);
            let first = 3 * self.nodes[*n];
            // Where a support prescribes an unknown, its displacement is taken to be uniform along the
            // direction.
            for c in (0..3).filter(|c| free(first + c)) {
                released += f[first + c] * slope[c];
            }
        }
        Ok(released / self.swept)
    }
}

/// Returns the factors of the derivative along `s` at a node, `Σ_m (s·M⁺ d_m/|d_m|) (u_m − u_n)` with
/// `M = Σ d dᵀ/|d|` over the arms `d` to other nodes. Along a line this is the difference over both
/// intervals.
fn slope<T: Real>(n: u32, arms: &[(u32, Vector3<T>)], s: &Vector3<T>) -> Vec<(u32, T)> {
    let spread = arms
        .iter()
        .fold(Matrix3::zeros(), |m, (_, d)| m + d * d.transpose() / d.norm());
    let eigen = SymmetricEigen::new(spread);
    // Directions without arms are left out of the pseudo-inverse M⁺.
    let flat = spread.trace() * T::epsilon().sqrt();
    let mut along = Vector3::zeros();
    for k in (0..3).filter(|k| eigen.eigenvalues[*k] > flat) {
        let axis = eigen.eigenvectors.column(k);
        along += axis * (axis.dot(s) / eigen.eigenvalues[k]);
    }
    let mut row: Vec<(u32, T)> = arms.iter().map(|(m, d)| (*m, along.dot(d) / d.norm())).collect();
    let factor = row.iter().fold(T::zero(), |sum, r| sum - r.1);
    // The node itself with minus the sum: a uniform displacement has no derivative.
    row.push((n, factor));
    row
}
