//! Multiplier operator `S = Σ_m B_m M_m⁻¹ B_mᵀ` and its solver.

use super::cost::Work;
use super::coupling::{operator, same_on_coupled};
use super::iterated::{Apply, Iterated, Precondition};
use super::parts::Parts;
use super::rank::{self, NullMode};
use super::selected::Selected;
use super::sides::Sides;
use super::transfer::Rows;
use super::{Coupling, InterfaceOptions, Solver};
use crate::linalg::SpdFactor;
use crate::scalar::dot;
use crate::{Error, Real, Result};
use sprs::CsMat;

/// Iterations of conjugate gradients over the root of the condition number: to 1e-12 they took 5 to 8
/// (decision 0030).
const ITERATIONS: f64 = 7.0;
/// Largest number of dependent multipliers per component that are solved for by eigenvectors.
const FEW: usize = 400;
/// Entries of the largest allowed factor: a gigabyte.
pub(super) const LARGEST_FACTOR: usize = 1 << 27;

/// Exact or approximate inverse of one symmetric block of the operator.
#[derive(Debug)]
enum Block<T: Real> {
    /// Cholesky factor of the block scaled to a unit diagonal.
    Factor {
        scale: Vec<T>,
        factor: Box<dyn SpdFactor<T>>,
    },
    /// Cholesky factor of independent multipliers; the others are zero.
    Selected(Selected<T>),
    /// Eigenvectors outside of the null space, each divided by the root of its eigenvalue, in the same
    /// scaling.
    Modes {
        scale: Vec<T>,
        modes: Vec<T>,
        work: Vec<T>,
    },
    Diagonal {
        inverse: Vec<T>,
    },
}

/// Blocks, each with the components that it serves: components of equal inverse masses share one.
#[derive(Debug)]
struct Blocks<T: Real> {
    all: Vec<(Block<T>, Vec<usize>)>,
    /// Right-hand sides of one block, one after another (working buffer).
    columns: Vec<T>,
    shared: usize,
}

#[derive(Debug)]
pub(super) struct Operator<T: Real> {
    blocks: Blocks<T>,
    /// `Some` if the blocks are a preconditioner and no exact inverse.
    iterated: Option<Iterated<T>>,
    /// Name of the solver in use.
    pub(super) solver: &'static str,
    pub(super) condition: T,
    /// True if `condition` is a lower bound, as the smallest eigenvalue is only known from above.
    pub(super) at_least: bool,
    pub(super) null_modes: Vec<NullMode>,
    /// True if the number of dependent multipliers is known.
    pub(super) ranked: bool,
    /// Size of a solve, for predictions of its duration.
    pub(super) work: Work,
}

/// Name and options of the interface that an operator is made for.
#[derive(Debug, Clone, Copy)]
pub(super) struct Wanted<'a, T: Real> {
    pub(super) name: &'a str,
    pub(super) options: &'a InterfaceOptions<T>,
}

struct Outcome<T: Real> {
    block: Block<T>,
    exact: bool,
    condition: T,
    at_least: bool,
    /// Estimates of the smallest non-zero and the largest eigenvalue of the scaled operator.
    range: [f64; 2],
    /// Number of stored entries of the factor; `None` if a factor is impossible.
    entries: Option<usize>,
    /// Null modes of the block; `None` if they are unknown.
    null_modes: Option<Vec<NullMode>>,
}

impl<T: Real> Operator<T> {
    /// Assembles the operator from the coupling matrix and the inverse inertia of every side, and chooses a
    /// solver.
    pub(super) fn new(
        wanted: Wanted<'_, T>,
        coupling: &[Coupling<T>],
        inverse: &[&[T]],
        components: usize,
    ) -> Result<Self> {
        let (shared, rows) = (coupling[0].shared, coupling[0].matrix.rows());
        if rows == 0 {
            return Ok(Self::empty(shared));
        }
        // Both directions of `B`, for each side.
        let passes = 2 * coupling.iter().map(|c| c.matrix.nnz()).sum::<usize>();
        let Analysis {
            blocks,
            only,
            exact,
            ranked,
            condition,
            at_least,
            range,
            null_modes,
            mut work,
        } = find_blocks(wanted, coupling, inverse, components)?;
        // Nothing but null modes: the mediator acts on no free unknown.
        if null_modes.len() == rows * shared {
            return Err(Error::SingularInterface {
                interface: wanted.name.to_owned(),
                size: rows * shared,
            });
        }
        work.unknowns = rows * shared;
        work.shared = shared;
        // Known from the spectrum, so a duration can be foretold before anything is solved.
        work.gradients = ITERATIONS * (range[1] / range[0]).sqrt();
        let iterated = (!exact).then(|| {
            let apply = match only.filter(|s| s.nnz() < passes) {
                // Whichever reads fewer entries in an iteration: `S` by rows, or `B` in both directions on
                // every side.
                Some(s) => Apply::Rows(Rows::from_entries(rows, s.iter().map(|(v, (i, j))| (j, i, *v)))),
                None => Apply::Sides,
            };
            Iterated::new(apply, [rows, shared], wanted.options.solver.limits())
        });
        // Both are only in use where multipliers are dependent.
        let dependent = blocks.iter().any(|b| matches!(b.0, Block::Modes { .. }));
        let selected = blocks.iter().any(|b| matches!(b.0, Block::Selected(_)));
        Ok(Self {
            solver: match (exact, dependent) {
                (false, _) => "conjugate gradients",
                (true, _) if wanted.options.lumped => "lumped",
                (true, _) if selected => "pivoted factor",
                (true, true) => "eigenvectors",
                (true, false) => "factor",
            },
            iterated,
            blocks: Blocks {
                all: blocks,
                columns: vec![T::zero(); rows * shared],
                shared,
            },
            condition,
            at_least,
            null_modes,
            ranked,
            work,
        })
    }

    /// Operator without multipliers.
    fn empty(shared: usize) -> Self {
        Self {
            blocks: Blocks {
                all: Vec::new(),
                columns: Vec::new(),
                shared,
            },
            iterated: None,
            solver: "none",
            condition: T::one(),
            at_least: false,
            null_modes: Vec::new(),
            ranked: true,
            work: Work::default(),
        }
    }

    /// Restricts the solver to the multipliers that this rank owns and returns true. Returns false, and
    /// changes nothing, if every rank has to solve for all.
    pub(super) fn partition_among(&mut self, parts: &Parts<T>) -> bool {
        let diagonal = self
            .blocks
            .all
            .iter()
            .all(|b| matches!(b.0, Block::Diagonal { .. }));
        // Only a diagonal preconditioner acts on each multiplier by itself.
        let iterated = self.iterated.as_mut().filter(|_| diagonal);
        if !iterated.is_some_and(|i| i.partition_among(parts)) {
            return false;
        }
        for (block, _) in &mut self.blocks.all {
            if let Block::Diagonal { inverse } = block {
                *inverse = parts.owned().iter().map(|i| inverse[*i as usize]).collect();
            }
        }
        self.blocks
            .columns
            .truncate(parts.owned().len() * self.blocks.shared);
        true
    }

    pub(super) fn nonzeros(&self) -> usize {
        let count = |b: &Block<T>| match b {
            Block::Factor { factor, .. } => factor.nonzeros(),
            Block::Selected(selected) => selected.nonzeros(),
            Block::Modes { modes, .. } => modes.len(),
            Block::Diagonal { inverse } => inverse.len(),
        };
        let blocks: usize = self.blocks.all.iter().map(|(b, _)| count(b)).sum();
        blocks + self.iterated.as_ref().map_or(0, Iterated::nonzeros)
    }

    /// Returns the number of iterations of the last solve; zero for a direct solver.
    pub(super) fn iterations(&self) -> usize {
        self.iterated.as_ref().map_or(0, |i| i.iterations)
    }

    /// Returns whether the last solve was an iteration that ended above its tolerance.
    pub(super) fn is_unsolved(&self) -> bool {
        self.iterated.as_ref().is_some_and(|i| i.unsolved)
    }

    /// Overwrites `b` with `S⁻¹ b`, components interleaved. Overwrites what the sides hold.
    pub(super) fn solve(&mut self, b: &mut [T], sides: &mut Sides<T>) {
        match &mut self.iterated {
            None => self.blocks.apply(b),
            Some(i) => i.solve(b, sides, &mut self.blocks),
        }
    }
}

impl<T: Real> Precondition<T> for Blocks<T> {
    fn apply(&mut self, b: &mut [T]) {
        let d = self.shared;
        let n = b.len() / d;
        if n == 0 {
            return;
        }
        for (block, components) in &mut self.all {
            let columns = &mut self.columns[..n * components.len()];
            for (column, c) in columns.chunks_exact_mut(n).zip(&*components) {
                // Components are interleaved in `b`; a factor solves them faster one after the other in one
                // call.
                let values = b[*c..].iter().step_by(d);
                column.iter_mut().zip(values).for_each(|(x, b)| *x = *b);
            }
            block.solve(columns, n);
            for (column, c) in columns.chunks_exact(n).zip(&*components) {
                let values = b[*c..].iter_mut().step_by(d);
                values.zip(column).for_each(|(b, x)| *b = *x);
            }
        }
    }
}

impl<T: Real> Block<T> {
    /// Solves for right-hand sides of length `n`, stored one after another.
    fn solve(&mut self, b: &mut [T], n: usize) {
        let scaled = |b: &mut [T], s: &[T]| {
            for b in b.chunks_exact_mut(n) {
                b.iter_mut().zip(s).for_each(|(b, s)| *b *= *s);
            }
        };
        match self {
            Self::Diagonal { inverse } => scaled(b, inverse),
            Self::Factor { scale, factor } => {
                // The factor is that of the scaled operator, so both sides of it are scaled.
                scaled(b, scale);
                factor.solve(b);
                scaled(b, scale);
            }
            Self::Selected(selected) => selected.solve(b, n),
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

/// Blocks of all components and their properties.
struct Analysis<T: Real> {
    blocks: Vec<(Block<T>, Vec<usize>)>,
    /// The operator, if all components share it.
    only: Option<CsMat<T>>,
    exact: bool,
    ranked: bool,
    condition: T,
    at_least: bool,
    range: [f64; 2],
    null_modes: Vec<NullMode>,
    work: Work,
}

fn find_blocks<T: Real>(
    wanted: Wanted<'_, T>,
    coupling: &[Coupling<T>],
    inverse: &[&[T]],
    components: usize,
) -> Result<Analysis<T>> {
    let shared = coupling[0].shared;
    let passes = 2 * coupling.iter().map(|c| c.matrix.nnz()).sum::<usize>();
    let mut analysis = Analysis {
        blocks: Vec::new(),
        only: None,
        exact: true,
        ranked: true,
        condition: T::one(),
        at_least: false,
        range: [f64::INFINITY, 0.0],
        null_modes: Vec::new(),
        work: Work {
            factor: Some(0),
            ..Work::default()
        },
    };
    let mut modes_of: Vec<Vec<NullMode>> = Vec::new();
    let mut known_weights: Vec<Vec<Vec<T>>> = Vec::new();
    for c in 0..shared {
        let component_inverse = |(side, inverse): (&Coupling<T>, &&[T])| -> Vec<T> {
            let columns = 0..side.matrix.cols();
            columns.map(|j| inverse[j * shared + c]).collect()
        };
        let weights: Vec<_> = coupling.iter().zip(inverse).map(component_inverse).collect();
        // Components whose inverse masses agree on all coupled nodes share one block.
        let known_block = known_weights
            .iter()
            .position(|w| same_on_coupled(coupling, w, &weights));
        if let Some(k) = known_block {
            analysis.blocks[k].1.push(c);
            analysis.null_modes.extend(modes_of[k].iter().cloned());
            continue;
        }
        // Assembled only where no known block serves: products of the coupling matrices are dear.
        let s = operator(coupling, &weights);
        let outcome = if wanted.options.lumped {
            lumped(wanted.name, &s)?
        } else {
            block(wanted.options, &s, components / shared, passes)?
        };
        analysis.condition = analysis.condition.max(outcome.condition);
        analysis.at_least |= outcome.at_least;
        let ([low, high], [l, h]) = (analysis.range, outcome.range);
        analysis.range = [low.min(l), high.max(h)];
        let factors = analysis.work.factor.zip(outcome.entries);
        analysis.work.factor = factors.map(|(sum, entries)| sum + entries);
        analysis.work.operator += s.nnz();
        analysis.exact &= outcome.exact;
        analysis.ranked &= outcome.null_modes.is_some();
        analysis.blocks.push((outcome.block, vec![c]));
        // With several blocks no single matrix serves all components.
        analysis.only = Some(s).filter(|_| analysis.blocks.len() == 1);
        modes_of.push(outcome.null_modes.unwrap_or_default());
        analysis
            .null_modes
            .extend(modes_of[modes_of.len() - 1].iter().cloned());
        known_weights.push(weights);
    }
    Ok(analysis)
}

/// Chooses the solver of one block and finds its properties. `passes` is the number of matrix entries that
/// are read if the block is applied side by side instead of as one matrix.
fn block<T: Real>(
    options: &InterfaceOptions<T>,
    s: &CsMat<T>,
    per_node: usize,
    passes: usize,
) -> Result<Outcome<T>> {
    let tolerance = options.rank_tolerance;
    // Equilibrated: multipliers at light and heavy nodes then count alike in the rank decision.
    let (scaled, scale) = rank::equilibrated(s);
    // Counted before it is made: a factor that is too large is never begun.
    let entries = T::cholesky_entries(&scaled);
    let chosen = options.solver.iterates();
    // Preconditioner of the iterations: scale² is the inverse diagonal.
    let diagonal = Block::Diagonal {
        inverse: scale.iter().map(|x| *x * *x).collect(),
    };
    // A row that acts on nothing has the scale zero and no pivot.
    if entries <= LARGEST_FACTOR
        && scale.iter().all(|x| *x > T::zero())
        && let Ok(mut factor) = T::cholesky(&scaled, None)
    {
        let [low, high] = rank::extremes(&scaled, &mut |b| factor.solve(b));
        if low > high * tolerance {
            let iterations = ITERATIONS * (high / low).sqrt().as_f64();
            let by_factor = match options.solver {
                // A factor is read twice per solve; an iteration reads S or both directions of B.
                Solver::Auto => 2.0 * entries as f64 <= iterations * passes.min(s.nnz()) as f64,
                Solver::Factor | Solver::ConjugateGradients { .. } => !chosen,
            };
            let range = [low, high].map(T::as_f64);
            let mut block = Block::Factor { scale, factor };
            // Rank and solver follow from the scaled operator; the condition reported here is that of S
            // itself.
            let [low, high] = rank::extremes(s, &mut |b| block.solve(b, s.rows()));
            return Ok(Outcome {
                block: if by_factor { block } else { diagonal },
                exact: by_factor,
                condition: high / low,
                at_least: false,
                range,
                entries: Some(entries),
                null_modes: Some(Vec::new()),
            });
        }
    }
    // Eigenvectors of many multipliers take longer to read than a factor.
    if !chosen
        && scaled.rows() > FEW
        && let Some((selected, range, dropped)) = Selected::new(s, &scaled, &scale, tolerance)
    {
        return Ok(selected_outcome(s, selected, range, dropped, per_node));
    }
    // Too many for dense eigenvalues: iterations leave null modes alone.
    if scaled.rows() > rank::DENSE_LIMIT {
        let [low, high] = rank::range(&scaled, tolerance)?;
        return Ok(Outcome {
            block: diagonal,
            exact: false,
            condition: high / low,
            at_least: true,
            range: [low, high].map(T::as_f64),
            entries: None,
            null_modes: (entries <= LARGEST_FACTOR)
                .then(|| rank::count_null_modes(&scaled, tolerance, per_node))
                .flatten(),
        });
    }
    let modes = modes_outcome(&scaled, scale, tolerance, per_node)?;
    Ok(match chosen {
        true => Outcome {
            block: diagonal,
            exact: false,
            ..modes
        },
        false => modes,
    })
}

/// Solves a block of dependent and few multipliers by its eigenmodes. They treat all multipliers alike; a
/// pivoted factor would keep a subset.
fn modes_outcome<T: Real>(
    scaled: &CsMat<T>,
    scale: Vec<T>,
    tolerance: T,
    per_node: usize,
) -> Result<Outcome<T>> {
    let analysis = rank::resolve_modes(scaled, tolerance, per_node)?;
    let [low, high] = analysis.range;
    Ok(Outcome {
        block: Block::Modes {
            scale,
            modes: analysis.modes,
            work: vec![T::zero(); scaled.rows()],
        },
        exact: true,
        condition: if low > T::zero() { high / low } else { T::one() },
        at_least: false,
        range: [low, high].map(T::as_f64),
        entries: None,
        null_modes: Some(analysis.null_modes),
    })
}

fn selected_outcome<T: Real>(
    s: &CsMat<T>,
    mut selected: Selected<T>,
    range: [T; 2],
    dropped: Vec<(usize, T)>,
    per_node: usize,
) -> Outcome<T> {
    // Solutions are zero in dropped rows, so the smallest eigenvalue is that of the kept ones.
    let [low, high] = rank::extremes(s, &mut |b| selected.solve(b, s.rows()));
    let null_mode = |(row, pivot): (usize, T)| NullMode {
        node: row / per_node,
        eigenvalue: pivot.max(T::zero()).as_f64(),
    };
    Outcome {
        exact: true,
        condition: high / low,
        at_least: false,
        range: range.map(T::as_f64),
        entries: Some(selected.nonzeros()),
        block: Block::Selected(selected),
        null_modes: Some(dropped.into_iter().map(null_mode).collect()),
    }
}

/// Replaces the operator by its row sums, which are positive for the L2 junction.
fn lumped<T: Real>(interface: &str, s: &CsMat<T>) -> Result<Outcome<T>> {
    let n = s.rows();
    let mut sums = vec![T::zero(); n];
    // Row sums act on uniform multipliers exactly as the operator does.
    s.iter().for_each(|(v, (_, i))| sums[i] += *v);
    let (low, high) = sums
        .iter()
        .fold((sums[0], sums[0]), |(l, h), v| (l.min(*v), h.max(*v)));
    if low <= T::zero() || !high.is_finite() {
        return Err(Error::SingularInterface {
            interface: interface.to_owned(),
            size: n,
        });
    }
    let inverse = sums.iter().map(|v| T::one() / *v).collect();
    Ok(Outcome {
        block: Block::Diagonal { inverse },
        exact: true,
        condition: high / low,
        at_least: false,
        range: [1.0; 2],
        entries: None,
        null_modes: Some(Vec::new()),
    })
}
