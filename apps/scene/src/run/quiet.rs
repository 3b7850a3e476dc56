//! Elements of the body in which no bond can be near its strength, so that a look may leave them out.
//!
//! Utilisations `u` are subadditive in the displacements. Since the last look at an element, in which its
//! bonds had at most `u₀`, its strain has changed by `Δε`, so that now
//!
//! ```text
//! u ≤ u₀ + 3 Σ_k κ_k |Δε_k|
//! ```
//!
//! with the largest utilisation `κ_k` of its bonds in the unit strain `k`. The strain is that at the centre,
//! and the factor covers what strains vary in the element.

use crate::error::{Result, core};
use arlequin::core::nalgebra::{Matrix3, Point3, Vector3};
use arlequin::core::{Interpolation, ShapeRow};
use rayon::prelude::*;

/// Places of the unit strains in a gradient, in the order of [`arlequin::core::Response`].
pub(super) const PLACES: [[usize; 2]; 6] = [[0, 0], [1, 1], [2, 2], [1, 2], [2, 0], [0, 1]];
/// Largest change of a strain in an element over that at its centre.
const VARIES: f64 = 3.0;

/// Strain of an element `xx yy zz yz zx xy` \[–\], shears as `γ = 2ε`.
pub(super) type Strain = [f64; 6];

/// Elements with their strains and utilisations at the last looks.
#[derive(Debug)]
pub(super) struct Quiet {
    /// Gradients of the body's shape functions at the centre of each element.
    rows: Vec<ShapeRow<f64>>,
    /// For each element: the largest utilisations of its bonds in unit strains.
    per_strain: Vec<Strain>,
    /// Strain and largest utilisation at the last look.
    last: Vec<(Strain, f64)>,
}

impl Quiet {
    /// Creates the record of elements with these centres and utilisations in unit strains. No look was made
    /// yet.
    pub(super) fn new(
        field: &dyn Interpolation<f64>,
        centres: &[Point3<f64>],
        per_strain: Vec<Strain>,
    ) -> Result<Self> {
        let row = |x: &Point3<f64>| {
            let mut row = ShapeRow::default();
            field.shape_at(x, true, &mut row).map_err(core("body"))?;
            Ok(row)
        };
        Ok(Self {
            rows: centres.par_iter().map(row).collect::<Result<_>>()?,
            per_strain,
            last: vec![([0.0; 6], f64::INFINITY); centres.len()],
        })
    }

    /// Strains at the centres of the elements for displacements `q` of the body.
    pub(super) fn strains(&self, q: &[f64]) -> Vec<Strain> {
        let strain = |row: &ShapeRow<f64>| {
            let mut h = Matrix3::zeros();
            for (&k, gradient) in row.nodes.iter().zip(&row.gradients) {
                h += Vector3::from_column_slice(&q[3 * k..3 * k + 3]) * gradient.transpose();
            }
            PLACES.map(|[i, j]| if i == j { h[(i, i)] } else { h[(i, j)] + h[(j, i)] })
        };
        self.rows.par_iter().map(strain).collect()
    }

    /// Returns for each element whether a bond in it may have reached the utilisation `limit`.
    pub(super) fn may_reach(&self, limit: f64, strains: &[Strain]) -> Vec<bool> {
        let elements = strains.iter().zip(&self.last).zip(&self.per_strain);
        let may = |((now, (then, u)), each): ((&Strain, &(Strain, f64)), &Strain)| {
            let rise: f64 = (0..6).map(|k| each[k] * (now[k] - then[k]).abs()).sum();
            u + VARIES * rise >= limit
        };
        elements.map(may).collect()
    }

    /// Keeps the largest utilisation that a look found in an element.
    pub(super) fn note(&mut self, e: usize, strain: Strain, u: f64) {
        self.last[e] = (strain, u);
    }
}
