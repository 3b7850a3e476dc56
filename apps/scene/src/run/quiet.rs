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
use arlequin::core::{Interpolation, Response, ShapeRow};
use rayon::prelude::*;

/// Largest change of a strain in an element over that at its centre.
const VARIES: f64 = 3.0;

/// Strain of an element `xx yy zz yz zx xy` \[–\], shears as `γ = 2ε`.
pub(super) type Strain = [f64; 6];

/// Strain of an element and the largest utilisation of its bonds at the last look at it; the utilisation is
/// infinite before. Checkpoints have them: the bound is not strict, so that a run that begins with other
/// looks could find other elements.
pub(super) type Seen = (Strain, f64);

/// Elements with what bounds the utilisations of their bonds.
#[derive(Debug)]
pub(super) struct Quiet {
    /// Gradients of the body's shape functions at the centre of each element.
    rows: Vec<ShapeRow<f64>>,
    /// For each element: the largest utilisations of its bonds in unit strains.
    per_strain: Vec<Strain>,
    /// Largest utilisations in unit strains in the mean of the elements that have bonds.
    typical: Strain,
}

impl Quiet {
    /// Creates the record of elements with these centres and utilisations in unit strains.
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
        let with_bonds = || per_strain.iter().filter(|s| s[0] > 0.0);
        let count = with_bonds().count().max(1) as f64;
        let typical = std::array::from_fn(|k| with_bonds().map(|s| s[k]).sum::<f64>() / count);
        Ok(Self {
            rows: centres.par_iter().map(row).collect::<Result<_>>()?,
            per_strain,
            typical,
        })
    }

    /// Returns the record of an unseen element for each element: its utilisation is infinite.
    pub(super) fn unseen(&self) -> Vec<Seen> {
        vec![([0.0; 6], f64::INFINITY); self.rows.len()]
    }

    /// Returns the largest utilisation that bonds of a typical element would have in a strain: that of its
    /// largest component, a lower bound up to the scatter of packings.
    pub(super) fn typical(&self, strain: &Strain) -> f64 {
        let each = strain.iter().zip(&self.typical);
        each.map(|(e, k)| e.abs() * k).fold(0.0, f64::max)
    }

    /// Strains at the centres of the elements for displacements `q` of the body.
    pub(super) fn strains(&self, q: &[f64]) -> Vec<Strain> {
        let strain = |row: &ShapeRow<f64>| {
            let mut h = Matrix3::zeros();
            for (&k, gradient) in row.nodes.iter().zip(&row.gradients) {
                h += Vector3::from_column_slice(&q[3 * k..3 * k + 3]) * gradient.transpose();
            }
            Response::strains(&h)
        };
        self.rows.par_iter().map(strain).collect()
    }

    /// Returns for each element whether a bond in it may have reached the utilisation `limit` since it was
    /// seen `last`.
    pub(super) fn may_reach(&self, limit: f64, strains: &[Strain], last: &[Seen]) -> Vec<bool> {
        let elements = strains.iter().zip(last).zip(&self.per_strain);
        let may = |((now, (then, u)), each): ((&Strain, &Seen), &Strain)| {
            let rise: f64 = (0..6).map(|k| each[k] * (now[k] - then[k]).abs()).sum();
            u + VARIES * rise >= limit
        };
        elements.map(may).collect()
    }
}
