//! Stress and strain at the nodes of a model, recovered from where its law knows them.
//!
//! A model offers its values through [`Recovery`]; models of elements and of cells compute them with
//! [`Patches`]. Stresses are those of the material, without the weight of the energy: in an overlap both
//! models report the same stress.

use crate::error::invalid;
use crate::{Real, Result};
use nalgebra::{Matrix3, Point3, SymmetricEigen, Vector3};
use rayon::prelude::*;

/// A symmetric tensor by its components `xx, yy, zz, xy, yz, xz`; those of a strain are tensor components,
/// not twice them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SymmetricTensor<T>(pub [T; 6]);

impl<T: Real> SymmetricTensor<T> {
    /// Zero tensor.
    pub fn zero() -> Self {
        Self([T::zero(); 6])
    }

    /// Symmetric part of a matrix.
    pub fn from_matrix(m: &Matrix3<T>) -> Self {
        let half = |a: usize, b: usize| (m[(a, b)] + m[(b, a)]) * T::of(0.5);
        Self([
            m[(0, 0)],
            m[(1, 1)],
            m[(2, 2)],
            half(0, 1),
            half(1, 2),
            half(0, 2),
        ])
    }

    /// Converts the tensor to a matrix.
    pub fn matrix(&self) -> Matrix3<T> {
        let [xx, yy, zz, xy, yz, xz] = self.0;
        Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
    }

    /// Equivalent stress of von Mises, `√(3/2 s:s)` with the deviator `s`.
    pub fn von_mises(&self) -> T {
        let [xx, yy, zz, xy, yz, xz] = self.0;
        let normal = (xx - yy) * (xx - yy) + (yy - zz) * (yy - zz) + (zz - xx) * (zz - xx);
        let shear = xy * xy + yz * yz + xz * xz;
        (T::of(0.5) * normal + T::of(3.0) * shear).sqrt()
    }

    /// Principal values, largest first.
    ///
    /// With the mean `m`, the deviator `s`, and `c` the deviator of `s²`:
    ///
    /// ```text
    /// σ_k = m + 2 p cos(φ − 2π k/3),  p² = s:s/6,  3φ = atan2(√((s:s)(c:c) − (s:c)²)/6, ½ det s)
    /// ```
    ///
    /// A frame has one tensor for each particle, and an iteration takes several times as long.
    pub fn principal(&self) -> [T; 3] {
        let [xx, yy, zz, xy, yz, xz] = self.0;
        let mean = (xx + yy + zz) / T::of(3.0);
        let size = self.0.iter().fold(T::zero(), |m, x| m.max(x.abs()));
        // Products of six components must neither overflow nor vanish. A NaN stays visible in the mean.
        if size <= T::zero() || !mean.is_finite() {
            return [mean; 3];
        }
        let [a, b, c, f, g, h] = [xx - mean, yy - mean, zz - mean, xy, yz, xz].map(|x| x / size);
        let square = [
            a * a + f * f + h * h,
            f * f + b * b + g * g,
            h * h + g * g + c * c,
            a * f + f * b + h * g,
            f * h + b * g + g * c,
            a * h + f * g + h * c,
        ];
        let norm = square[0] + square[1] + square[2];
        let third = norm / T::of(3.0);
        // Components off the diagonal count twice in a product of tensors.
        let root = T::of(2.0).sqrt();
        let s = [a, b, c, root * f, root * g, root * h];
        let [d, e, i, u, v, w] = square;
        let t = [d - third, e - third, i - third, root * u, root * v, root * w];
        // Lagrange's identity: a difference of products would leave nothing of two values that nearly agree.
        let mut area = T::zero();
        for k in 0..6 {
            for l in 0..k {
                let minor = s[k] * t[l] - s[l] * t[k];
                area += minor * minor;
            }
        }
        let det = a * (b * c - g * g) - f * (f * c - g * h) + h * (f * g - b * h);
        let (sine, cosine) = ((area.sqrt() / T::of(6.0)).atan2(det * T::of(0.5)) / T::of(3.0)).sin_cos();
        let p = (norm / T::of(6.0)).sqrt() * size;
        let across = sine * T::of(3.0).sqrt();
        [
            mean + p * (cosine + cosine),
            mean - p * (cosine - across),
            mean - p * (cosine + across),
        ]
    }
}

/// Values recovered at a node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Recovered<T> {
    /// Strain \[–\]; `None` for a model that knows forces only.
    pub strain: Option<SymmetricTensor<T>>,
    /// Stress \[Pa\], tension positive, without weights.
    pub stress: SymmetricTensor<T>,
}

/// A model that knows stresses at its nodes.
pub trait Recovery<T: Real> {
    /// Name of the recovery method, for reports.
    fn method(&self) -> &'static str;

    /// Returns whether strains are recovered as well.
    fn has_strain(&self) -> bool;

    /// Appends stress and strain at the given nodes for displacements `q` to `out`.
    ///
    /// # Errors
    /// Displacements of another length, and nodes that do not exist.
    fn recover(&self, q: &[T], nodes: &[usize], out: &mut Vec<Recovered<T>>) -> Result<()>;
}

/// Everything that the bonds of a model carry in one state, without weights; broken bonds carry nothing.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LinkSurvey<T> {
    /// Stress at every node, as [`Recovery::recover`] returns it.
    pub stresses: Vec<SymmetricTensor<T>>,
    /// Strain energy density of every node \[J/m³\]: the energy of its bonds, each shared between its two
    /// nodes, over the volume that the node stands for. Where no weight is below one, the sum over all nodes
    /// times their volumes is the strain energy of the model.
    pub densities: Vec<T>,
    /// Force along every bond, tension positive \[N\].
    pub axial: Vec<T>,
    /// Force across every bond \[N\], never negative.
    pub shear: Vec<T>,
    /// Load over strength of every bond \[–\], at one of which it breaks; `None` if the strength is not
    /// known.
    pub utilisation: Option<Vec<T>>,
}

/// A model whose nodes are joined by bonds.
pub trait Links<T: Real> {
    /// Nodes of every bond.
    fn pairs(&self) -> &[[u32; 2]];

    /// Reads all bonds at displacements `q`, in the order of [`Links::pairs`]: one pass for everything that a
    /// frame shows.
    ///
    /// # Errors
    /// Displacements of another length.
    fn survey(&self, q: &[T]) -> Result<LinkSurvey<T>>;
}

/// Farthest position of a node outside of its samples along one of their principal directions, over the root
/// of the sum of squared distances there. Farther out, values are constant along that direction. A corner of
/// a cube of hexahedra has 0.7.
const REACH: f64 = 2.0;

/// Values at nodes from values at samples by least squares: a linear polynomial is fitted to the samples of a
/// patch and evaluated at the node (patch recovery, Zienkiewicz and Zhu 1992). Linear fields are exact
/// wherever a patch spans the body. Along directions in which a patch has no extent the value is constant.
#[derive(Debug, Clone)]
pub struct Patches<T> {
    starts: Vec<usize>,
    samples: Vec<u32>,
    factors: Vec<T>,
}

impl<T: Real> Patches<T> {
    /// Prepares the fits at every node. `patches(k, out)` writes the patches of node `k` as lists of samples;
    /// the fits of its patches are averaged.
    pub fn new(
        nodes: &[Point3<T>],
        samples: &[Point3<T>],
        patches: impl Fn(usize, &mut Vec<Vec<u32>>) + Sync,
    ) -> Self {
        let row = |k: usize| {
            let mut node_patches = Vec::new();
            patches(k, &mut node_patches);
            let share = T::one() / T::of(node_patches.len().max(1) as f64);
            let mut row: Vec<(u32, T)> = Vec::new();
            for patch in &node_patches {
                fit(&nodes[k], samples, patch, share, &mut row);
            }
            row.sort_by_key(|e| e.0);
            // A sample in several patches gets the sum of its factors.
            row.dedup_by(|b, a| {
                a.0 == b.0 && {
                    a.1 += b.1;
                    true
                }
            });
            row
        };
        let rows: Vec<Vec<(u32, T)>> = (0..nodes.len()).into_par_iter().map(row).collect();
        let mut out = Self {
            starts: vec![0],
            samples: Vec::new(),
            factors: Vec::new(),
        };
        for row in rows {
            out.samples.extend(row.iter().map(|e| e.0));
            out.factors.extend(row.iter().map(|e| e.1));
            out.starts.push(out.samples.len());
        }
        out
    }

    /// Samples of a node and their factors, which sum to one.
    pub fn row(&self, node: usize) -> impl Iterator<Item = (usize, T)> + '_ {
        let range = self.starts[node]..self.starts[node + 1];
        let samples = self.samples[range.clone()].iter().map(|s| *s as usize);
        samples.zip(self.factors[range].iter().copied())
    }

    /// Appends strain and stress at `nodes` of `model` to `out`, from those at `count` samples:
    /// `sample_values(s)` returns strain and stress at sample `s`.
    ///
    /// # Errors
    /// [`crate::Error::InvalidParameter`] for a node that does not exist.
    pub fn recover(
        &self,
        model: &str,
        nodes: &[usize],
        count: usize,
        sample_values: impl Fn(usize) -> [SymmetricTensor<T>; 2] + Sync,
        out: &mut Vec<Recovered<T>>,
    ) -> Result<()> {
        if let Some(k) = nodes.iter().find(|k| **k >= self.len()) {
            let rule = format!("'{model}' has {} nodes", self.len());
            return Err(invalid("number of a node", k, &rule));
        }
        // Patches share samples: if most nodes are asked for, evaluate every sample once.
        let known: Vec<_> = if nodes.len() * 4 > self.len() {
            (0..count).into_par_iter().map(&sample_values).collect()
        } else {
            Vec::new()
        };
        let values_at = |node: &usize| {
            let mut sums = [SymmetricTensor::zero(); 2];
            for (s, factor) in self.row(*node) {
                let values = known.get(s).copied().unwrap_or_else(|| sample_values(s));
                for (sum, value) in sums.iter_mut().zip(values) {
                    sum.0.iter_mut().zip(value.0).for_each(|(s, v)| *s += factor * v);
                }
            }
            let [strain, stress] = sums;
            let strain = Some(strain);
            Recovered { strain, stress }
        };
        out.par_extend(nodes.par_iter().map(values_at));
        Ok(())
    }

    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// Returns whether there is no node.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Adds the factors of the samples of one patch to `row`: `share` times `1/n + (x − x̄)ᵀ M⁺ (x_s − x̄)`,
/// where `M = Σ (x_s − x̄)(x_s − x̄)ᵀ`.
fn fit<T: Real>(x: &Point3<T>, samples: &[Point3<T>], patch: &[u32], share: T, row: &mut Vec<(u32, T)>) {
    let equal_share = share / T::of(patch.len() as f64);
    let position = |s: &u32| samples[*s as usize].coords;
    let mean = patch.iter().fold(Vector3::zeros(), |m, s| m + position(s)) / T::of(patch.len() as f64);
    let spread = patch.iter().fold(Matrix3::zeros(), |m, s| {
        let d = position(s) - mean;
        m + d * d.transpose()
    });
    let arm = x.coords - mean;
    // Directions in which the samples differ by round-off only have no slope.
    let flat = spread.trace() * T::epsilon() * T::of(64.0);
    let mut slope = Vector3::zeros();
    // A patch of one sample, or of samples at one place, gives its mean.
    if spread.trace() > T::zero() {
        let eigen = SymmetricEigen::new(spread);
        for k in 0..3 {
            let (axis, size) = (eigen.eigenvectors.column(k), eigen.eigenvalues[k]);
            let out = axis.dot(&arm);
            // No slope along directions in which the node lies far outside of the samples.
            if size > flat && out * out <= size * T::of(REACH * REACH) {
                slope += axis * (out / size);
            }
        }
    }
    row.extend(
        patch
            .iter()
            .map(|s| (*s, equal_share + share * slope.dot(&(position(s) - mean)))),
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn invariants_of_stresses_are_those_of_the_textbook() {
        let pull = SymmetricTensor([3.0_f64, 0.0, 0.0, 0.0, 0.0, 0.0]);
        assert!((pull.von_mises() - 3.0_f64).abs() < 1e-15);
        let shear = SymmetricTensor([0.0_f64, 0.0, 0.0, 2.0, 0.0, 0.0]);
        assert!((shear.von_mises() - 2.0 * 3.0_f64.sqrt()).abs() < 1e-15);
        let [a, b, c] = shear.principal();
        assert!((a - 2.0_f64).abs() < 1e-15 && b.abs() < 1e-15 && (c + 2.0).abs() < 1e-15);
        let pressure = SymmetricTensor([-5.0_f64, -5.0, -5.0, 0.0, 0.0, 0.0]);
        assert!(pressure.von_mises().abs() < 1e-15_f64);
    }

    /// Distinct, double and triple values of turned tensors of any size, to round-off of the largest.
    #[test]
    fn principal_values_are_those_that_a_turned_tensor_was_made_from() {
        let values = [
            [3.0_f64, 1.0, -2.0],
            [1.0, 0.0, 0.0],
            [0.0, 0.0, -1.0],
            [5.0, 5.0, -1.0],
            [2.0, 2.0, 2.0],
            [1.0, 1.0 - 1e-9, -1.0],
            [1e-3, 1.0, 1e6],
            [0.0, 0.0, 0.0],
        ];
        for (k, values) in values.into_iter().enumerate() {
            for n in 0..50 {
                let angle = f64::from(n) * 0.37 + k as f64;
                let turn =
                    nalgebra::Rotation3::from_euler_angles(angle, 2.1 * angle, -0.7 * angle).into_inner();
                for size in [1.0, 1e9, 1e-120, 1e120] {
                    let tensor =
                        turn * Matrix3::from_diagonal(&(Vector3::from(values) * size)) * turn.transpose();
                    let found = SymmetricTensor::from_matrix(&tensor).principal();
                    let mut wanted = values.map(|v| v * size);
                    wanted.sort_by(|a, b| b.total_cmp(a));
                    let top = wanted.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
                    let worst = (0..3).map(|c| (found[c] - wanted[c]).abs()).fold(0.0, f64::max);
                    assert!(worst <= 4e-15 * top, "{found:?} for {wanted:?}");
                }
            }
        }
        let broken = SymmetricTensor([1.0_f64, 2.0, 3.0, f64::NAN, 0.0, 0.0]).principal();
        assert!(broken.iter().all(|x| x.is_nan()), "{broken:?}");
    }

    /// Nodes of a cube, of a plate one sample thick, and of a line: linear fields come out exactly, however
    /// the body lies.
    #[test]
    fn linear_fields_are_exact_where_patches_span_the_body() {
        let turn = nalgebra::Rotation3::from_euler_angles(0.3, -0.8, 1.9);
        for counts in [[3, 3, 3], [4, 4, 1], [5, 1, 1]] {
            let all = (0..counts[0] * counts[1] * counts[2]).map(|k| {
                let [i, j, l] = [
                    k % counts[0],
                    k / counts[0] % counts[1],
                    k / (counts[0] * counts[1]),
                ];
                turn * Point3::new(i as f64, 1.3 * j as f64, 0.7 * l as f64)
            });
            let samples: Vec<Point3<f64>> = all.collect();
            let n = samples.len() as u32;
            let first = samples[0].coords;
            let along: Vec<Vector3<f64>> = (0..3)
                .filter(|c| counts[*c] > 1)
                .map(|c| turn * Vector3::ith(c, 1.0))
                .collect();
            let nodes: Vec<Point3<f64>> = (0..7)
                .map(|k| {
                    let out = along
                        .iter()
                        .fold(first, |x, a| x + a * (0.5 * f64::from(k) - 0.5));
                    Point3::from(out)
                })
                .collect();
            let patches = Patches::new(&nodes, &samples, |_, out| out.push((0..n).collect()));
            let field = |x: &Point3<f64>| 2.0 + along.iter().map(|a| a.dot(&x.coords)).sum::<f64>();
            for (k, x) in nodes.iter().enumerate() {
                let found: f64 = patches.row(k).map(|(s, c)| c * field(&samples[s])).sum();
                assert!((found - field(x)).abs() < 1e-12, "{counts:?}, {k}: {found}");
                let unity: f64 = patches.row(k).map(|(_, c)| c).sum();
                assert!((unity - 1.0).abs() < 1e-13);
            }
        }
    }
}
