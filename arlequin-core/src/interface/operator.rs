//! The multiplier operator `S = Σ_m B_m M_m⁻¹ B_mᵀ`: factor, rank, condition.

use super::{Coupling, InterfaceSpec};
use crate::linalg::SpdFactor;
use crate::scalar::dot;
use crate::{Error, Real, Result};
use sprs::{CsMat, TriMat};

/// Largest dependent system that is resolved by dense eigenvalues (some seconds, 0.2 GB).
const DENSE_LIMIT: usize = 4000;

/// A combination of multipliers that acts on nothing.
#[derive(Debug, Clone, PartialEq)]
pub struct NullMode {
    /// Mediator node at which the mode is largest.
    pub node: usize,
    /// Eigenvalue of the scaled operator relative to its largest.
    pub eigenvalue: f64,
}

/// One symmetric block of the operator, in the scaling that makes its diagonal one.
#[derive(Debug)]
enum Block<T: Real> {
    Factor {
        scale: Vec<T>,
        factor: Box<dyn SpdFactor<T>>,
    },
    Modes {
        scale: Vec<T>,
        modes: Vec<T>,
        work: Vec<T>,
    },
    Diagonal {
        inverse: Vec<T>,
    },
}

#[derive(Debug)]
pub(super) struct Operator<T: Real> {
    /// Blocks, each with the components that it serves.
    blocks: Vec<(Block<T>, Vec<usize>)>,
    /// Right-hand sides of one block, one after another.
    columns: Vec<T>,
    shared: usize,
    pub(super) condition: T,
    pub(super) null_modes: Vec<NullMode>,
    /// `Σ_j |B_C,ij|` per multiplier unknown: turns a constraint residual into a velocity.
    pub(super) row_measure: Vec<T>,
}

struct Outcome<T: Real> {
    block: Block<T>,
    condition: T,
    null_modes: Vec<NullMode>,
}

impl<T: Real> Operator<T> {
    pub(super) fn new(
        spec: &InterfaceSpec<T>,
        coupling: &[Coupling<T>; 2],
        inverse: [&[T]; 2],
        components: usize,
    ) -> Result<Self> {
        let shared = coupling[0].shared;
        let rows = coupling[0].matrix.rows();
        let (mut blocks, mut null_modes) = (Vec::<(Block<T>, Vec<usize>)>::new(), Vec::new());
        let mut modes_of: Vec<Vec<NullMode>> = Vec::new();
        let mut condition = T::one();
        let mut seen: Vec<[Vec<T>; 2]> = Vec::new();
        for c in 0..shared {
            let pick = |m: usize| -> Vec<T> {
                (0..coupling[m].matrix.cols())
                    .map(|j| inverse[m][j * shared + c])
                    .collect()
            };
            let weights = [pick(0), pick(1)];
            let known = seen.iter().position(|w| same_on_coupled(coupling, w, &weights));
            if let Some(k) = known {
                blocks[k].1.push(c);
                let repeated: Vec<NullMode> = modes_of[k].clone();
                null_modes.extend(repeated);
                continue;
            }
            let s = operator(coupling, &weights);
            let outcome = if spec.options.lumped {
                lumped(spec, &s)?
            } else {
                factor(spec, &s, components / shared)?
            };
            condition = condition.max(outcome.condition);
            null_modes.extend(outcome.null_modes.iter().cloned());
            modes_of.push(outcome.null_modes);
            blocks.push((outcome.block, vec![c]));
            seen.push(weights);
        }
        if null_modes.len() == rows * shared {
            return Err(Error::SingularInterface {
                interface: spec.name.clone(),
                size: rows * shared,
            });
        }
        let measure = |i: usize| {
            coupling[0]
                .matrix
                .outer_view(i)
                .map_or_else(T::zero, |r| r.iter().map(|e| e.1.abs()).sum())
        };
        let row_measure = (0..rows * shared).map(|k| measure(k / shared)).collect();
        Ok(Self {
            blocks,
            columns: vec![T::zero(); rows * shared],
            shared,
            condition,
            null_modes,
            row_measure,
        })
    }

    pub(super) fn dropped(&self) -> usize {
        self.null_modes.len()
    }

    pub(super) fn nonzeros(&self) -> usize {
        let count = |b: &Block<T>| match b {
            Block::Factor { factor, .. } => factor.nonzeros(),
            Block::Modes { modes, .. } => modes.len(),
            Block::Diagonal { inverse } => inverse.len(),
        };
        self.blocks.iter().map(|(b, _)| count(b)).sum()
    }

    /// `b ← S⁻¹ b`, components interleaved.
    pub(super) fn solve(&mut self, b: &mut [T]) {
        let d = self.shared;
        let n = b.len() / d;
        for (block, components) in &mut self.blocks {
            let columns = &mut self.columns[..n * components.len()];
            for (column, c) in columns.chunks_exact_mut(n).zip(&*components) {
                column
                    .iter_mut()
                    .zip(b[*c..].iter().step_by(d))
                    .for_each(|(x, b)| *x = *b);
            }
            block.solve(columns, n);
            for (column, c) in columns.chunks_exact(n).zip(&*components) {
                b[*c..]
                    .iter_mut()
                    .step_by(d)
                    .zip(column)
                    .for_each(|(b, x)| *b = *x);
            }
        }
    }
}

impl<T: Real> Block<T> {
    /// Solves for right-hand sides of length `n`, one after another.
    fn solve(&mut self, b: &mut [T], n: usize) {
        let scaled = |b: &mut [T], s: &[T]| {
            for b in b.chunks_exact_mut(n) {
                b.iter_mut().zip(s).for_each(|(b, s)| *b *= *s);
            }
        };
        match self {
            Self::Diagonal { inverse } => scaled(b, inverse),
            Self::Factor { scale, factor } => {
                scaled(b, scale);
                factor.solve(b);
                scaled(b, scale);
            }
            Self::Modes { scale, modes, work } => {
                scaled(b, scale);
                for b in b.chunks_exact_mut(n) {
                    work.fill(T::zero());
                    for mode in modes.chunks_exact(n) {
                        let a = dot(mode, b);
                        work.iter_mut().zip(mode).for_each(|(w, m)| *w += a * *m);
                    }
                    b.copy_from_slice(work);
                }
                scaled(b, scale);
            }
        }
    }
}

fn same_on_coupled<T: Real>(coupling: &[Coupling<T>; 2], a: &[Vec<T>; 2], b: &[Vec<T>; 2]) -> bool {
    (0..2).all(|m| coupling[m].matrix.iter().all(|(_, (_, j))| a[m][j] == b[m][j]))
}

pub(super) fn operator<T: Real>(coupling: &[Coupling<T>; 2], weights: &[Vec<T>; 2]) -> CsMat<T> {
    let n = coupling[0].matrix.rows();
    let mut sum = TriMat::new((n, n));
    for (m, weights) in weights.iter().enumerate() {
        let b = &coupling[m].matrix;
        let mut scaled = b.clone();
        let columns: Vec<usize> = scaled.indices().to_vec();
        scaled
            .data_mut()
            .iter_mut()
            .zip(columns)
            .for_each(|(v, j)| *v *= weights[j]);
        let product: CsMat<T> = &scaled * &b.transpose_view().to_csr();
        // Half to each triangle: symmetric whatever the order of summation was.
        for (v, (i, j)) in product.iter() {
            sum.add_triplet(i, j, *v * T::of(0.5));
            sum.add_triplet(j, i, *v * T::of(0.5));
        }
    }
    sum.to_csc()
}

/// Scaled copy with unit diagonal, and the scaling; rows that act on nothing keep a zero scale.
fn equilibrated<T: Real>(s: &CsMat<T>) -> (CsMat<T>, Vec<T>) {
    let n = s.rows();
    let diagonal: Vec<T> = (0..n)
        .map(|i| s.get(i, i).copied().unwrap_or_else(T::zero))
        .collect();
    let top = diagonal.iter().fold(T::zero(), |a, b| a.max(*b));
    let floor = top * T::epsilon() * T::of(16.0);
    let scale: Vec<T> = diagonal
        .iter()
        .map(|d| {
            if *d > floor {
                T::one() / d.sqrt()
            } else {
                T::zero()
            }
        })
        .collect();
    let mut t = TriMat::with_capacity((n, n), s.nnz());
    s.iter()
        .for_each(|(v, (j, i))| t.add_triplet(i, j, *v * scale[i] * scale[j]));
    (t.to_csc(), scale)
}

fn multiply<T: Real>(a: &CsMat<T>, x: &[T], out: &mut [T]) {
    out.fill(T::zero());
    for (j, col) in a.outer_iterator().enumerate() {
        col.iter().for_each(|(i, v)| out[i] += *v * x[j]);
    }
}

fn factor<T: Real>(spec: &InterfaceSpec<T>, s: &CsMat<T>, per_node: usize) -> Result<Outcome<T>> {
    let (scaled, scale) = equilibrated(s);
    if scale.iter().all(|x| *x > T::zero())
        && let Ok(mut factor) = T::cholesky(&scaled)
    {
        let range = extremes(&scaled, &mut |b| factor.solve(b));
        if range[0] > range[1] * spec.options.rank_tolerance {
            let mut block = Block::Factor { scale, factor };
            let [low, high] = extremes(s, &mut |b| block.solve(b, s.rows()));
            return Ok(Outcome {
                block,
                condition: high / low,
                null_modes: Vec::new(),
            });
        }
    }
    modes(spec, &scaled, scale, per_node)
}

/// Smallest and largest eigenvalue by (inverse) power iteration.
fn extremes<T: Real>(a: &CsMat<T>, solve: &mut dyn FnMut(&mut [T])) -> [T; 2] {
    let n = a.rows();
    let mut work = vec![T::zero(); n];
    let iterate = |apply: &mut dyn FnMut(&mut Vec<T>)| {
        let mut x: Vec<T> = (0..n)
            .map(|i| T::of(1.0 + ((i as f64) * 0.754_877_666).fract()) * sign(i))
            .collect();
        let mut value = T::zero();
        for step in 0..300 {
            let norm = dot(&x, &x).sqrt();
            if norm <= T::zero() || !norm.is_finite() {
                return T::zero();
            }
            x.iter_mut().for_each(|v| *v /= norm);
            let before = x.clone();
            apply(&mut x);
            let next = dot(&before, &x);
            let settled = step > 10 && (next - value).abs() <= next.abs() * T::of(1e-4);
            value = next;
            if settled {
                break;
            }
        }
        value
    };
    let high = iterate(&mut |x| {
        multiply(a, x, &mut work);
        x.copy_from_slice(&work);
    });
    let inverse_low = iterate(&mut |x| solve(x));
    let low = if inverse_low > T::zero() {
        T::one() / inverse_low
    } else {
        T::zero()
    };
    [low, high]
}

fn sign<T: Real>(i: usize) -> T {
    if (i * 2_654_435_761) & 4096 == 0 {
        T::one()
    } else {
        -T::one()
    }
}

/// Rank-revealing fallback: eigenvalues of the scaled operator; those below the tolerance are dropped and reported.
fn modes<T: Real>(
    spec: &InterfaceSpec<T>,
    scaled: &CsMat<T>,
    scale: Vec<T>,
    per_node: usize,
) -> Result<Outcome<T>> {
    let n = scaled.rows();
    if n > DENSE_LIMIT {
        return Err(Error::RankTooLarge {
            interface: spec.name.clone(),
            size: n,
            limit: DENSE_LIMIT,
        });
    }
    let mut dense = vec![T::zero(); n * n];
    scaled.iter().for_each(|(v, (j, i))| dense[j * n + i] = *v);
    let eigen = T::symmetric_eigen(n, &dense)?;
    let top = eigen.values.last().copied().unwrap_or_else(T::zero);
    let (mut modes, mut null_modes) = (Vec::new(), Vec::new());
    let mut low = top;
    for (k, value) in eigen.values.iter().enumerate() {
        let mode = &eigen.vectors[k * n..(k + 1) * n];
        if *value > top * spec.options.rank_tolerance {
            low = low.min(*value);
            let root = value.sqrt();
            modes.extend(mode.iter().map(|m| *m / root));
        } else {
            let peak = (0..n)
                .max_by(|a, b| mode[*a].abs().as_f64().total_cmp(&mode[*b].abs().as_f64()))
                .unwrap_or(0);
            let relative = if top > T::zero() { *value / top } else { T::zero() };
            null_modes.push(NullMode {
                node: peak / per_node,
                eigenvalue: relative.as_f64(),
            });
        }
    }
    let condition = if low > T::zero() { top / low } else { T::one() };
    Ok(Outcome {
        block: Block::Modes {
            scale,
            modes,
            work: vec![T::zero(); n],
        },
        condition,
        null_modes,
    })
}

/// Row sums in place of the operator. Exists for the L2 junction, where they are positive.
fn lumped<T: Real>(spec: &InterfaceSpec<T>, s: &CsMat<T>) -> Result<Outcome<T>> {
    let n = s.rows();
    let mut sums = vec![T::zero(); n];
    s.iter().for_each(|(v, (_, i))| sums[i] += *v);
    let (low, high) = sums
        .iter()
        .fold((sums[0], sums[0]), |(l, h), v| (l.min(*v), h.max(*v)));
    if low <= T::zero() || !high.is_finite() {
        return Err(Error::SingularInterface {
            interface: spec.name.clone(),
            size: n,
        });
    }
    let inverse = sums.iter().map(|v| T::one() / *v).collect();
    Ok(Outcome {
        block: Block::Diagonal { inverse },
        condition: high / low,
        null_modes: Vec::new(),
    })
}
