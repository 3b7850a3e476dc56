//! Fields: how nodal values of a model or a mediator become a value at any point of its domain.

use crate::adjacency::Adjacency;
use crate::geometry::{Cell, Sample};
use crate::{Error, Real, Result};
use nalgebra::{Matrix3, Point3, Vector3};
use rayon::prelude::*;

/// One evaluation of shape functions: `u(x) = Σ_k values[k] u[nodes[k]]`. Owned and reused by the caller.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ShapeRow<T: Real> {
    /// Nodes with a non-zero shape function.
    pub nodes: Vec<usize>,
    /// Values \[–\], one per node.
    pub values: Vec<T>,
    /// Gradients \[1/m\], one per node if they were asked for.
    pub gradients: Vec<Vector3<T>>,
}

impl<T: Real> ShapeRow<T> {
    /// Empties the row and keeps its memory.
    pub fn clear(&mut self) {
        self.nodes.clear();
        self.values.clear();
        self.gradients.clear();
    }
    /// Adds a node without gradient.
    pub fn push(&mut self, node: usize, value: T) {
        self.nodes.push(node);
        self.values.push(value);
    }
    /// Adds a node with its gradient.
    pub fn push_with_gradient(&mut self, node: usize, value: T, gradient: Vector3<T>) {
        self.push(node, value);
        self.gradients.push(gradient);
    }
}

/// A continuous field on nodes or particles: finite elements, natural neighbours, moving least squares ...
///
/// The coupling conserves momenta only with shape functions that sum to one and reproduce linear fields at
/// every point (checked by [`crate::conformance`]).
pub trait Interpolation<T: Real>: Send + Sync {
    /// Reference positions of the nodes \[m\].
    fn nodes(&self) -> &[Point3<T>];

    /// Writes the shape functions at `x` to `row`, with gradients if `gradient` is set.
    ///
    /// # Errors
    /// [`Error::OutsideDomain`] outside the closed domain; [`Error::NoGradient`] if the field has none.
    fn shape_at(&self, x: &Point3<T>, gradient: bool, row: &mut ShapeRow<T>) -> Result<()>;

    /// Writes the shape functions at a point of cell `cell` (its number in [`Interpolation::cells`]) to
    /// `row`. A field can use the cell to skip point location.
    ///
    /// # Errors
    /// Errors of [`Interpolation::shape_at`].
    fn shape_in(&self, cell: usize, x: &Point3<T>, gradient: bool, row: &mut ShapeRow<T>) -> Result<()> {
        let _ = cell;
        self.shape_at(x, gradient, row)
    }

    /// Cells that fill the domain and on which the shape functions are smooth; empty for a field without
    /// cells.
    fn cells(&self) -> Vec<Cell<T>> {
        Vec::new()
    }

    /// Cells whose bounding boxes meet the box from corner `low` to corner `high`, with their numbers in
    /// [`Interpolation::cells`]. `None` if the field has no cells at all. A field of many cells can override
    /// this to avoid making all of them.
    fn cells_within(&self, [low, high]: &[Point3<T>; 2]) -> Option<Vec<(usize, Cell<T>)>> {
        // A default for small fields: each call builds all cells anew.
        let cells = self.cells();
        let meets = |c: &Cell<T>| {
            let [from, to] = c.bounds();
            (0..3).all(|k| from[k] <= high[k] && low[k] <= to[k])
        };
        (!cells.is_empty()).then(|| cells.into_iter().enumerate().filter(|c| meets(&c.1)).collect())
    }

    /// Polynomial degree of the shape functions on a cell; chooses the quadrature.
    fn degree(&self) -> usize {
        1
    }

    /// Largest distance of element faces from planes, relative to the elements' lengths. Where it is not
    /// zero, cells with planar faces fill the elements only nearly, and shape functions are no polynomials on
    /// the cells.
    fn warp(&self) -> T {
        T::zero()
    }

    /// The field's own integration points, for fields that exist only there (particle quadrature).
    fn samples(&self) -> Option<&[Sample<T>]> {
        None
    }

    /// Kind of the field, for messages: "finite-element", "particle" ...
    fn kind(&self) -> &'static str {
        "interpolated"
    }
}

/// Most rings of neighbours from which the gradient at a particle is computed.
const RINGS: usize = 4;

/// Particle quadrature `∫ λ·ḋ ≈ Σ_i V_i λ(x_i)·ḋ_i`: the field exists at the particle centres only.
///
/// Both sides of an interface are then sampled at the particles, which keeps linear and angular momentum
/// exact. With [`Self::with_gradients`] the particles have gradients as well, so that H1 junctions can be
/// sampled there.
#[derive(Debug, Clone)]
pub struct ParticleField<T: Real> {
    centres: Vec<Point3<T>>,
    samples: Vec<Sample<T>>,
    /// Particle numbers sorted by the bits of the positions: four bytes each, where a hash map takes sixty.
    order: Vec<u32>,
    /// Neighbours for gradients. Gradients are computed on request, once per particle of an overlap: storing
    /// them for all particles would take 250 bytes each.
    neighbours: Option<Adjacency>,
}

impl<T: Real> ParticleField<T> {
    /// Field on particle centres \[m\], with the volume that each particle stands for \[m³\].
    ///
    /// # Errors
    /// [`Error::SizeMismatch`], [`Error::NotFinite`], or [`Error::InvalidParameter`] for coincident
    /// particles and volumes that are not positive.
    pub fn new(centres: Vec<Point3<T>>, volumes: &[T]) -> Result<Self> {
        if centres.len() != volumes.len() {
            return Err(Error::SizeMismatch {
                what: "particle volumes".into(),
                expected: centres.len(),
                found: volumes.len(),
            });
        }
        let mut samples = Vec::with_capacity(centres.len());
        for (k, (p, v)) in centres.iter().zip(volumes).enumerate() {
            crate::scalar::check_finite("particle centres", p.coords.as_slice())?;
            if !v.is_finite() || *v <= T::zero() {
                return Err(crate::error::invalid(
                    &format!("volume of particle {k}"),
                    v,
                    "must be positive",
                ));
            }
            samples.push(Sample {
                point: *p,
                measure: *v,
            });
        }
        let mut order: Vec<u32> = (0..centres.len() as u32).collect();
        // With the number as second key the order is unique, whatever the threads.
        order.par_sort_unstable_by_key(|k| (Self::key(&centres[*k as usize]), *k));
        let coincide =
            |pair: &&[u32]| Self::key(&centres[pair[0] as usize]) == Self::key(&centres[pair[1] as usize]);
        // Report the lowest number that coincides, whatever the order of the positions.
        if let Some(&[twin, k]) = order.windows(2).filter(coincide).min_by_key(|pair| pair[1]) {
            return Err(crate::error::invalid(
                &format!("position of particle {k}"),
                centres[k as usize],
                &format!("coincides with particle {twin}; remove one"),
            ));
        }
        Ok(Self {
            centres,
            samples,
            order,
            neighbours: None,
        })
    }

    /// Adds gradients at the particles, computed from the neighbours that `pairs` lists:
    ///
    /// `∇d(x_i) = (Σ_j w_j x_ij x_ijᵀ)⁻¹ Σ_j w_j x_ij (d_j − d_i)ᵀ`, `x_ij = x_j − x_i`, `w_j = 1/|x_ij|²`.
    ///
    /// If the neighbours of a particle nearly lie in a plane, their neighbours are added, up to four rings.
    /// Where these do not span space either, asking for the gradient is an error.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] for a pair that names a particle which does not exist.
    pub fn with_gradients(mut self, pairs: &[[u32; 2]]) -> Result<Self> {
        let count = self.centres.len();
        if let Some(beyond) = pairs.iter().flatten().find(|e| **e as usize >= count) {
            return Err(Error::SizeMismatch {
                what: "neighbours of particles".into(),
                expected: count,
                found: *beyond as usize + 1,
            });
        }
        // The least-squares gradient of a linear field is exact and that of a uniform one zero, so that
        // momenta stay exact.
        let ends = pairs.iter().flat_map(|&[i, j]| [(i, j), (j, i)]);
        self.neighbours = Some(Adjacency::new(count, ends));
        Ok(self)
    }

    /// Coefficients of the gradient at particle `i`; `None` without neighbours that span space.
    fn gradient(&self, i: usize) -> Option<Vec<(usize, Vector3<T>)>> {
        let around = self.neighbours.as_ref()?;
        let mut wide: Vec<usize> = around.row(i).iter().map(|j| *j as usize).collect();
        // Chains of loosely bonded particles on a surface need more than the second ring.
        for _ in 0..RINGS {
            if let Some(row) = self.least_squares(i, &wide) {
                return Some(row);
            }
            let next: Vec<u32> = wide.iter().flat_map(|&j| around.row(j)).copied().collect();
            wide.extend(next.iter().map(|j| *j as usize));
            wide.sort_unstable();
            wide.dedup();
            // The particle itself is among the neighbours of its neighbours.
            wide.retain(|&j| j != i);
        }
        None
    }

    /// Coefficients of the least-squares gradient, one for every neighbour and one for particle `i` itself;
    /// `None` unless the neighbours span space.
    fn least_squares(&self, i: usize, neighbours: &[usize]) -> Option<Vec<(usize, Vector3<T>)>> {
        let arm = |j: usize| self.centres[j] - self.centres[i];
        // Weighted by distance: a near neighbour says more about the gradient than a far one.
        let weight = |x: &Vector3<T>| T::one() / x.norm_squared();
        let moments = neighbours.iter().fold(Matrix3::zeros(), |m, &j| {
            let x = arm(j);
            m + x * x.transpose() * weight(&x)
        });
        // The eigenvalues of the moments are mean squares along the principal directions of the neighbours.
        let spread = moments.symmetric_eigenvalues();
        // Neighbours within about 13 degrees of a plane say too little about the third direction.
        if spread.min() <= spread.max() * T::of(0.05) {
            return None;
        }
        let inverse = moments.try_inverse()?;
        let mut row: Vec<_> = neighbours
            .iter()
            .map(|&j| (j, inverse * arm(j) * weight(&arm(j))))
            .collect();
        // Minus the sum of the others: a uniform field has no gradient.
        let central = row.iter().fold(Vector3::zeros(), |s, (_, g)| s - g);
        row.push((i, central));
        Some(row)
    }

    fn key(p: &Point3<T>) -> [u64; 3] {
        // Adding zero makes −0 a +0: equal positions have equal bits.
        [p.x, p.y, p.z].map(|c| (c + T::zero()).as_f64().to_bits())
    }
}

impl<T: Real> Interpolation<T> for ParticleField<T> {
    fn nodes(&self) -> &[Point3<T>] {
        &self.centres
    }

    fn shape_at(&self, x: &Point3<T>, gradient: bool, row: &mut ShapeRow<T>) -> Result<()> {
        row.clear();
        let position =
            // An exact search: the field exists at the centres alone, and samples carry their bits.
            (self.order).binary_search_by_key(&Self::key(x), |k| Self::key(&self.centres[*k as usize]));
        let Ok(k) = position.map(|slot| self.order[slot] as usize) else {
            return Err(outside(x, self.kind()));
        };
        if !gradient {
            row.push(k, T::one());
            return Ok(());
        }
        let Some(coefficients) = self.gradient(k) else {
            return Err(Error::NoGradient {
                role: self.kind().into(),
                junction: "H1".into(),
            });
        };
        // The value is that of the particle alone; neighbours enter the gradient only.
        for (j, g) in coefficients {
            let value = if j == k { T::one() } else { T::zero() };
            row.push_with_gradient(j, value, g);
        }
        Ok(())
    }

    fn samples(&self) -> Option<&[Sample<T>]> {
        Some(&self.samples)
    }

    fn kind(&self) -> &'static str {
        "particle"
    }
}

/// Shorthand for [`Error::OutsideDomain`].
pub fn outside<T: Real>(x: &Point3<T>, role: &str) -> Error {
    Error::OutsideDomain {
        point: [x.x.as_f64(), x.y.as_f64(), x.z.as_f64()],
        role: role.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn particle_gradients_are_exact_for_linear_fields_and_refused_in_a_plane() {
        let mut next = 1u64;
        let mut noise = || {
            next = next.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (next >> 40) as f64 / (1u64 << 24) as f64 - 0.5
        };
        let mut shaken = |x: f64| x + 0.6 * noise();
        let mut centres = vec![Point3::origin()];
        let corners = (0..8).map(|k| [k & 1, (k >> 1) & 1, k >> 2].map(|b| f64::from(2 * b - 1)));
        centres.extend(corners.map(|[x, y, z]| Point3::new(shaken(x), shaken(y), shaken(z))));
        // Three particles in a plane of their own.
        centres.extend([0.0, 1.0, 2.0].map(|y: f64| Point3::new(10.0, y, y * y)));
        let mut pairs: Vec<[u32; 2]> = (1..9).map(|j| [0, j]).collect();
        pairs.extend([[9, 10], [9, 11]]);
        let field = ParticleField::new(centres.clone(), &[1.0; 12]).unwrap();
        let mut row = ShapeRow::default();
        assert!(matches!(
            field.shape_at(&centres[0], true, &mut row),
            Err(Error::NoGradient { .. })
        ));
        let field = field.with_gradients(&pairs).unwrap();
        let slope = Vector3::new(2.0, -3.0, 0.5);
        field.shape_at(&centres[0], true, &mut row).unwrap();
        let value = |k: usize| 7.0 + slope.dot(&centres[k].coords);
        let found: Vector3<f64> = row
            .nodes
            .iter()
            .zip(&row.gradients)
            .map(|(&k, g)| g * value(k))
            .sum();
        assert!((found - slope).norm() < 1e-11, "{found}");
        assert!((row.values.iter().sum::<f64>() - 1.0).abs() < 1e-15);
        assert!(matches!(
            field.shape_at(&centres[9], true, &mut row),
            Err(Error::NoGradient { .. })
        ));
        let far = ParticleField::new(centres, &[1.0; 12]).unwrap();
        assert!(far.with_gradients(&[[0, 12]]).is_err());
    }
}
