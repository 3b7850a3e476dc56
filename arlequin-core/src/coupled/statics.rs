//! Static equilibrium: the weighted energy is stationary under `⟨μ, u − d⟩ = 0` for all multipliers `μ`.
//!
//! The system `[K_C 0 B_Cᵀ; 0 K_D −B_Dᵀ; B_C −B_D 0] [u; d; λ] = [F; f; 0]` has the weights, mediator and
//! junction of the dynamic run.

use super::Coupled;
use crate::effect::Instant;
use crate::linalg::{SpdFactor, SquareFactor};
use crate::model::unknown_places;
use crate::{Error, Real, Result, Subdomain};
use nalgebra::Point3;
use sprs::{CsMat, CsVecView, TriMat};

/// Static equilibrium.
#[derive(Debug, Clone, PartialEq)]
pub struct Equilibrium<T> {
    /// Displacements of every subdomain \[m, rad\].
    pub displacements: Vec<Vec<T>>,
    /// Multipliers of every interface.
    pub multipliers: Vec<Vec<T>>,
    /// Weighted internal energy \[J\].
    pub energy: T,
    /// Relative residual of the linear system.
    pub residual: T,
    /// True if the system was solved by `L U` with partial pivoting, as in single precision, or because the
    /// much cheaper `L D Lᵀ` without pivoting had a small pivot and was given up: a nearly free motion.
    pub pivoted: bool,
}

/// Largest accepted relative residual of a solution.
const RESIDUAL_LIMIT: f64 = 1e-6;
/// Largest accepted relative change of the displacements by the step of iterative refinement. A free rigid
/// motion is round-off over round-off: refinement changes it by its own size, however small the residual.
const CHANGE_LIMIT: f64 = 1e-3;
/// Number added to the scaled diagonal, positive for displacements and negative for multipliers. With it the
/// system has a factor in any order of elimination; iterative refinement takes it out again.
const REGULAR: f64 = 1e-9;
/// Smallest accepted pivot of a displacement in the regularised system. A free rigid motion has one of about
/// [`REGULAR`].
const LEAST_PIVOT: f64 = 30.0 * REGULAR;
/// Largest number of refinements of a solution by the regularised factor.
const REFINEMENTS: usize = 20;

/// Saddle-point system before prescribed unknowns are eliminated.
struct System<T: Real> {
    matrix: TriMat<T>,
    rhs: Vec<T>,
    fixed: Vec<bool>,
    /// Prescribed displacements, in the entries where `fixed` is true.
    values: Vec<T>,
    /// Largest modulus of a stiffness entry.
    scale: T,
    /// Place of every unknown \[m\]; a multiplier lies among the nodes that it ties.
    places: Vec<Point3<T>>,
}

impl<T: Real> System<T> {
    fn new(size: usize) -> Self {
        Self {
            matrix: TriMat::new((size, size)),
            rhs: vec![T::zero(); size],
            fixed: vec![false; size],
            values: vec![T::zero(); size],
            scale: T::zero(),
            places: Vec::with_capacity(size),
        }
    }

    /// Adds stiffness, loads and supports of a subdomain whose unknowns begin at `start`, at time `t` \[s\].
    fn add(&mut self, s: &mut Subdomain<T>, start: usize, t: T) -> Result<()> {
        let Some(linear) = s.model().views().linear else {
            let what = "be solved statically: it is not linear, or weighted at its nodes".into();
            return Err(Error::Unsupported {
                model: s.model().name().into(),
                what,
            });
        };
        for (v, (i, j)) in linear.stiffness().iter() {
            self.matrix.add_triplet(start + i, start + j, *v);
            // The scale for multipliers: their rows have no stiffness of their own.
            self.scale = self.scale.max(v.abs());
        }
        self.places.extend(unknown_places(s.model()));
        let n = s.model().layout().dofs();
        // Effects are evaluated at rest: here none depends on positions, and damping has no force.
        let zeros = vec![T::zero(); n];
        let instant = Instant {
            time: t,
            q: &zeros,
            v_half: &zeros,
            dt: T::zero(),
            number: 0,
            internal: &zeros,
            internal_before: &zeros,
        };
        s.add_effects(&instant, &mut self.rhs[start..start + n])?;
        for motion in s.supports() {
            for &d in &motion.dofs {
                self.fixed[start + d] = true;
                self.values[start + d] = motion.amplitude * motion.time.value(t);
            }
        }
        Ok(())
    }
}

impl<T: Real> Coupled<T> {
    /// Returns the equilibrium under the loads and prescribed displacements of time `t` \[s\], with zero
    /// velocities.
    ///
    /// # Errors
    /// [`Error::Unsupported`] for a model that is not linear; [`Error::SingularSystem`] if a rigid motion is
    /// free.
    pub fn equilibrium(&mut self, t: T) -> Result<Equilibrium<T>> {
        let (starts, size) = self.places();
        let mut system = System::new(size);
        for (s, &start) in self.subdomains.iter_mut().zip(&starts) {
            system.add(s, start, t)?;
        }
        // After all stiffnesses: the compliance is relative to their largest entry.
        self.add_constraints(&starts, system.scale, &mut system.matrix);
        self.place_multipliers(&starts, &mut system.places);
        let moving = starts.get(self.subdomains.len()).copied().unwrap_or(size);
        // Taken out while `system` is solved, and put back after an error too.
        let mut factored = self.factored.take();
        let solved = solve_with_supports(&system, moving, &mut factored);
        self.factored = factored;
        // The solver knows no geometry, so free motions are named here.
        let (q, residual, pivoted) = solved.map_err(|e| match e {
            Error::SingularSystem { size, residual, .. } => {
                let free = self.free_motions();
                let colon = if free.is_empty() { "" } else { ": " };
                Error::SingularSystem {
                    size,
                    residual,
                    free: format!("{colon}{free}"),
                }
            }
            e => e,
        })?;
        let cut = |k: usize, n: usize| q[starts[k]..starts[k] + n].to_vec();
        let bodies = self.subdomains.iter().enumerate();
        let displacements: Vec<Vec<T>> = bodies.map(|(k, s)| cut(k, s.model().layout().dofs())).collect();
        let moved = self.subdomains.iter().zip(&displacements);
        let energy = moved.map(|(s, q)| s.model().internal_energy(q)).sum();
        let count = self.subdomains.len();
        let joints = self.interfaces.iter().enumerate();
        let multipliers = joints
            .map(|(k, i)| cut(count + k, i.multipliers().len()))
            .collect();
        Ok(Equilibrium {
            displacements,
            multipliers,
            energy,
            residual,
            pivoted,
        })
    }

    /// Returns the first unknown of every subdomain and then of every interface, and the number of all
    /// unknowns.
    fn places(&self) -> (Vec<usize>, usize) {
        let mut size = 0;
        let bodies = self.subdomains.iter().map(|s| s.model().layout().dofs());
        let counts = bodies.chain(self.interfaces.iter().map(|i| i.multipliers().len()));
        let starts = counts
            .map(|n| {
                size += n;
                size - n
            })
            .collect();
        (starts, size)
    }

    /// Adds the constraint blocks.
    fn add_constraints(&self, starts: &[usize], scale: T, matrix: &mut TriMat<T>) {
        for (k, i) in self.interfaces.iter().enumerate() {
            let row_start = starts[self.subdomains.len() + k];
            for (m, coupling) in i.coupling.iter().enumerate() {
                // The jump is coarse minus fine.
                let sign = if m == 0 { T::one() } else { -T::one() };
                let (d, col_start) = (coupling.shared(), starts[i.sides[m]]);
                for (r, c, v) in coupling.entries() {
                    for a in 0..d {
                        let (row, col) = (row_start + r * d + a, col_start + c * d + a);
                        matrix.add_triplet(row, col, sign * v);
                        matrix.add_triplet(col, row, sign * v);
                    }
                }
            }
            // Dependent multipliers get a compliance of 1e-12, relative to constraint and stiffness entries,
            // on their diagonal. It makes the system regular and changes the solution by as little.
            let regularise = !i.report().null_modes.is_empty();
            let size = i.coupling[0]
                .entries()
                .fold(T::zero(), |s, (.., v)| s.max(v.abs()));
            let compliance = if regularise && scale > T::zero() {
                size * size / scale * T::of(1e-12)
            } else {
                T::zero()
            };
            for r in 0..i.multipliers().len() {
                matrix.add_triplet(row_start + r, row_start + r, -compliance);
            }
        }
    }
}

impl<T: Real> Coupled<T> {
    /// Adds the place of every multiplier: the mean of the nodes that it ties, by its entries.
    fn place_multipliers(&self, starts: &[usize], places: &mut Vec<Point3<T>>) {
        for (k, i) in self.interfaces.iter().enumerate() {
            let first = starts[self.subdomains.len() + k];
            let count = i.multipliers().len();
            let mut sums = vec![(nalgebra::Vector3::zeros(), T::zero()); count];
            for (m, coupling) in i.coupling.iter().enumerate() {
                let (d, col_start) = (coupling.shared(), starts[i.sides[m]]);
                for (r, c, v) in coupling.entries() {
                    for a in 0..d {
                        let (sum, weight) = &mut sums[r * d + a];
                        *sum += places[col_start + c * d + a].coords * v.abs();
                        *weight += v.abs();
                    }
                }
            }
            debug_assert_eq!(places.len(), first);
            let tiny = T::default_epsilon() * T::default_epsilon();
            places.extend(
                sums.iter()
                    .map(|(sum, weight)| Point3::from(sum / weight.max(tiny))),
            );
        }
    }
}

/// Factor of the saddle-point system.
#[derive(Debug)]
enum Factor<T> {
    /// `L D Lᵀ` of the regularised system, by nested dissection.
    Regular(Box<dyn SpdFactor<T>>),
    /// `L U` with partial pivoting, where the regularised system has a small pivot: slower, but it can tell a
    /// nearly singular system from a singular one.
    Pivoted(Box<dyn SquareFactor<T>>),
}

impl<T: Real> Factor<T> {
    /// Factors a scaled system whose first `moving` unknowns are displacements.
    fn new(matrix: &CsMat<T>, places: &[Point3<T>], moving: usize) -> Result<Self> {
        // Single precision leaves no room for a regularisation.
        let double = T::epsilon().as_f64() < 1e-12;
        let regular = || {
            let n = matrix.rows();
            let mut shifted = TriMat::with_capacity((n, n), matrix.nnz() + n);
            matrix
                .iter()
                .for_each(|(v, (i, j))| shifted.add_triplet(i, j, *v));
            let shift = T::of(REGULAR);
            (0..n).for_each(|i| shifted.add_triplet(i, i, if i < moving { shift } else { -shift }));
            T::quasi_definite(&shifted.to_csc(), places, moving, T::of(LEAST_PIVOT))
        };
        match double.then(regular).flatten() {
            Some(factor) => Ok(Self::Regular(factor)),
            None => Ok(Self::Pivoted(T::lu(matrix)?)),
        }
    }

    fn solve(&mut self, b: &mut [T]) {
        match self {
            Self::Regular(factor) => factor.solve(b),
            Self::Pivoted(factor) => factor.solve(b),
        }
    }

    /// Number of refinements that a solution needs at most.
    fn refinements(&self) -> usize {
        match self {
            Self::Regular(_) => REFINEMENTS,
            Self::Pivoted(_) => 1,
        }
    }
}

/// Matrix without prescribed unknowns, and its factor. Kept because the next load step of a linear model has
/// the same matrix.
#[derive(Debug)]
pub(super) struct Factored<T> {
    matrix: CsMat<T>,
    factor: Factor<T>,
}

impl<T: Real> System<T> {
    /// Returns the factors of a symmetric scaling of rows and columns.
    fn scaling(&self, full: &CsMat<T>) -> Vec<T> {
        let factor = |(i, row): (usize, CsVecView<'_, T>)| {
            let diagonal = row.get(i).copied().unwrap_or_else(T::zero);
            // Rows of multipliers have no positive diagonal. Their largest entry is scaled to the stiffness
            // instead, so that pivoting compares like with like.
            let top = row.iter().fold(T::zero(), |s, (_, v)| s.max(v.abs()));
            if diagonal > T::zero() {
                T::one() / diagonal.sqrt()
            } else if top > T::zero() {
                self.scale.sqrt() / top
            } else {
                T::one()
            }
        };
        full.outer_iterator().enumerate().map(factor).collect()
    }

    /// Returns the scaled matrix and right-hand side, with prescribed unknowns eliminated.
    fn reduced(&self, full: &CsMat<T>, weight: &[T]) -> (CsMat<T>, Vec<T>) {
        let (n, fixed, values) = (self.rhs.len(), &self.fixed, &self.values);
        let scaled = |i: usize| {
            if fixed[i] {
                values[i] / weight[i]
            } else {
                self.rhs[i] * weight[i]
            }
        };
        let mut b: Vec<T> = (0..n).map(scaled).collect();
        let mut starts = vec![0];
        let (mut columns, mut entries) = (Vec::with_capacity(full.nnz()), Vec::with_capacity(full.nnz()));
        for (i, row) in full.outer_iterator().enumerate() {
            // Columns of prescribed unknowns go to the right-hand side, their rows become those of the
            // identity.
            if fixed[i] {
                columns.push(i);
                entries.push(T::one());
            } else {
                for (j, v) in row.iter() {
                    if fixed[j] {
                        b[i] -= *v * weight[i] * values[j];
                    } else {
                        columns.push(j);
                        entries.push(*v * weight[i] * weight[j]);
                    }
                }
            }
            starts.push(columns.len());
        }
        // The matrix is symmetric: its rows are its columns, and need no sorting again.
        (CsMat::new_csc((n, n), starts, columns, entries), b)
    }
}

/// Eliminates prescribed unknowns, scales symmetrically and solves with iterative refinement; returns the
/// solution, its relative residual and whether the factor has pivoting. The first `moving` unknowns are
/// displacements, the others multipliers. The matrix is factored only if it differs from that of `cache`.
fn solve_with_supports<T: Real>(
    system: &System<T>,
    moving: usize,
    cache: &mut Option<Factored<T>>,
) -> Result<(Vec<T>, T, bool)> {
    let full = system.matrix.to_csr::<usize>();
    let weight = system.scaling(&full);
    let (fresh, b) = system.reduced(&full, &weight);
    let Factored { matrix: a, factor } = match cache.take() {
        // Equal to the last bit: load steps of a linear model repeat the same matrix.
        Some(known) if known.matrix == fresh => cache.insert(known),
        _ => cache.insert(Factored {
            factor: Factor::new(&fresh, &system.places, moving)?,
            matrix: fresh,
        }),
    };
    let mut solution = refined(a, factor, &b, moving);
    // Refused only by the factor that can tell a nearly singular system from a singular one.
    if !solution.sound && matches!(factor, Factor::Regular(_)) {
        *factor = Factor::Pivoted(T::lu(a)?);
        solution = refined(a, factor, &b, moving);
    }
    if !solution.sound {
        return Err(Error::SingularSystem {
            size: b.len(),
            residual: solution.residual.as_f64(),
            free: String::new(),
        });
    }
    let mut x = solution.x;
    x.iter_mut().zip(&weight).for_each(|(x, w)| *x *= *w);
    Ok((x, solution.residual, matches!(factor, Factor::Pivoted(_))))
}

/// Solution of a scaled system.
struct Solution<T> {
    x: Vec<T>,
    /// `‖b − A x‖/(‖b‖ + max|A| ‖x‖)`, with the largest magnitudes of the vectors' entries as norms \[–\].
    residual: T,
    /// True unless something shows that the matrix is singular.
    sound: bool,
}

/// Solves with iterative refinement, until it no longer changes the displacements.
fn refined<T: Real>(a: &CsMat<T>, factor: &mut Factor<T>, b: &[T], moving: usize) -> Solution<T> {
    let norm = |v: &[T]| v.iter().fold(T::zero(), |s, x| s.max(x.abs()));
    let mut x = b.to_vec();
    factor.solve(&mut x);
    let mut changed = true;
    let mut last = T::of(f64::INFINITY);
    for _ in 0..factor.refinements() {
        let mut r = residual(a, &x, b);
        factor.solve(&mut r);
        x.iter_mut().zip(&r).for_each(|(x, r)| *x += *r);
        let (change, size) = (norm(&r[..moving]), norm(&x[..moving]));
        changed = change > size * T::of(CHANGE_LIMIT).max(T::epsilon().sqrt());
        // A few units in the last place, or a change that is small and does not fall any more: further
        // refinement only shuffles round-off.
        let stalls = change <= size * T::epsilon().sqrt() && change > last * T::of(0.5);
        if stalls || change <= size * T::epsilon() * T::of(8.0) {
            break;
        }
        last = change;
    }
    let r = residual(a, &x, b);
    let top = a.iter().fold(T::zero(), |s, (v, _)| s.max(v.abs()));
    // The last bound keeps 0/0 out where there are no loads.
    let relative = norm(&r) / (norm(b) + top * norm(&x)).max(T::epsilon() * T::epsilon());
    // A singular matrix may show in the residual, in a refinement that changes the displacements too much, or
    // in a solution that is larger than the right-hand side over round-off.
    // The largest entry of a vector passes over NaN, which a factor of a singular matrix can leave.
    let sound = x.iter().all(|x| x.is_finite())
        && relative.is_finite()
        && relative <= T::of(RESIDUAL_LIMIT).max(T::epsilon().sqrt())
        && !changed
        && norm(&x) <= norm(b) / T::epsilon();
    Solution {
        x,
        residual: relative,
        sound,
    }
}

fn residual<T: Real>(a: &CsMat<T>, x: &[T], b: &[T]) -> Vec<T> {
    let mut r = b.to_vec();
    for (j, col) in a.outer_iterator().enumerate() {
        col.iter().for_each(|(i, v)| r[i] -= *v * x[j]);
    }
    r
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Chain of springs of stiffness one, whose first node is tied to the ground by a spring, and whose last
    /// node is tied to the middle of a free pair by a multiplier.
    fn chain(ground: f64) -> System<f64> {
        let n = 40;
        let mut system = System::new(n + 1);
        let mut spring = |i: usize, j: usize, k: f64| {
            for (a, b, v) in [(i, i, k), (j, j, k), (i, j, -k), (j, i, -k)] {
                system.matrix.add_triplet(a, b, v);
            }
        };
        (0..n / 2 - 1).for_each(|i| spring(i, i + 1, 1.0));
        (n / 2..n - 1).for_each(|i| spring(i, i + 1, 2.0));
        system.matrix.add_triplet(0, 0, ground);
        for (i, sign) in [(n / 2 - 1, 1.0), (n / 2, -1.0)] {
            system.matrix.add_triplet(i, n, sign);
            system.matrix.add_triplet(n, i, sign);
        }
        system.rhs[n - 1] = 1.0;
        system.scale = 2.0;
        system.places = (0..=n).map(|i| Point3::new(i as f64, 0.0, 0.0)).collect();
        system
    }

    fn solve(ground: f64) -> Result<(Vec<f64>, f64, bool)> {
        solve_with_supports(&chain(ground), 40, &mut None)
    }

    #[test]
    fn a_tied_chain_is_solved_without_pivoting_and_a_nearly_free_one_with_it() {
        for (ground, wanted) in [(1.0, false), (1e-9, true)] {
            let (x, residual, pivoted) = solve(ground).unwrap();
            assert_eq!(pivoted, wanted, "{ground:e}");
            assert!(residual < 1e-12, "{residual:e}");
            // A unit force stretches the ground's spring, 19 springs of one and 19 of two.
            for (i, exact) in [
                (0, 1.0 / ground),
                (19, 1.0 / ground + 19.0),
                (39, 1.0 / ground + 28.5),
            ] {
                assert!((x[i] / exact - 1.0).abs() < 1e-5, "{x:?}");
            }
            assert!((x[40].abs() - 1.0).abs() < 1e-6, "multiplier {}", x[40]);
        }
    }

    #[test]
    fn a_free_chain_is_refused_as_singular() {
        let error = solve(0.0).unwrap_err();
        assert!(matches!(error, Error::SingularSystem { size: 41, .. }), "{error}");
    }

    #[test]
    fn a_factor_is_kept_for_the_next_load_step() {
        let (mut system, mut cache) = (chain(1.0), None);
        let (first, ..) = solve_with_supports(&system, 40, &mut cache).unwrap();
        system.rhs[39] = 2.0;
        let (second, ..) = solve_with_supports(&system, 40, &mut cache).unwrap();
        let apart = first
            .iter()
            .zip(&second)
            .fold(0.0_f64, |m, (a, b)| m.max((2.0 * a - b).abs()));
        assert!(apart < 1e-11, "{apart:e}");
    }
}
