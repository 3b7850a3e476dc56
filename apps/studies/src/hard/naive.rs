//! The coupled step as a first attempt would write it, on the line: dense matrices, no checks, no treatment
//! of rank, no consistent start.
//!
//! Masses and stiffness are taken from a run of the library, so that only the coupling differs.

use crate::line::{COARSE, FINE};
use arlequin::core::nalgebra::{DMatrix, DVector, Point3};
use arlequin::core::sprs::CsMat;
use arlequin::core::{Coupled, Error, Interpolation, Result, ShapeRow};

/// Sampling points of the junction integrals.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rule {
    /// Two Gauss points on every interval between nodes of mediator, bar and chain, which is exact.
    Refined,
    /// Two Gauss points per mediator element, regardless of the other nodes.
    Mediator,
}

/// A coupled run of bar and chain without safeguards.
#[derive(Debug, Clone)]
pub struct Naive {
    mass: DVector<f64>,
    stiffness: CsMat<f64>,
    b: DMatrix<f64>,
    inverse: DMatrix<f64>,
    fixed: Vec<usize>,
    split: usize,
    /// Displacements of bar and chain \[m\].
    pub q: DVector<f64>,
    /// Velocities \[m/s\].
    pub v: DVector<f64>,
    a: DVector<f64>,
    lambda: DVector<f64>,
}

/// Results of a naive run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trace {
    /// Largest kinetic plus internal energy over its initial value; infinite if it is not a number.
    pub growth: f64,
    /// Share of the steps in which the largest multiplier changes its sign.
    pub flips: f64,
}

fn row(field: &dyn Interpolation<f64>, x: f64, gradient: bool) -> Result<ShapeRow<f64>> {
    let mut row = ShapeRow::default();
    field.shape_at(&Point3::new(x, 0.0, 0.0), gradient, &mut row)?;
    Ok(row)
}

/// Returns positions and lengths of the sampling points on a mediator.
fn samples(mediator: &dyn Interpolation<f64>, model_nodes: &[&[Point3<f64>]], rule: Rule) -> Vec<(f64, f64)> {
    let mut cuts: Vec<f64> = mediator.nodes().iter().map(|p| p.x).collect();
    let [low, high] = [
        cuts.iter().copied().fold(f64::INFINITY, f64::min),
        cuts.iter().copied().fold(f64::NEG_INFINITY, f64::max),
    ];
    if rule == Rule::Refined {
        let more = model_nodes.iter().flat_map(|n| n.iter()).map(|p| p.x);
        cuts.extend(more.filter(|x| *x > low && *x < high));
    }
    cuts.sort_by(f64::total_cmp);
    // Distance of the Gauss points from the middle, for an interval of length one.
    let g = 0.5 / 3.0f64.sqrt();
    // Coincident nodes leave empty intervals.
    let pieces = cuts.windows(2).filter(|w| w[1] - w[0] > 1e-12);
    pieces
        .flat_map(|w| {
            let (m, h) = (0.5 * (w[0] + w[1]), w[1] - w[0]);
            [(m - g * h, 0.5 * h), (m + g * h, 0.5 * h)]
        })
        .collect()
}

/// Returns the rows `B_C | −B_D` of a mediator for the junction `∫ λ v + l² λ' v'`.
fn coupling(
    run: &Coupled<f64>,
    mediator: &dyn Interpolation<f64>,
    length: f64,
    rule: Rule,
) -> Result<DMatrix<f64>> {
    let sides = [&run.subdomains()[COARSE], &run.subdomains()[FINE]];
    let nodes = sides.map(|s| s.model().nodes());
    let n = nodes[0].len() + nodes[1].len();
    let mut b = DMatrix::zeros(mediator.nodes().len(), n);
    for (x, measure) in samples(mediator, &nodes, rule) {
        let l = row(mediator, x, true)?;
        for (m, side) in sides.iter().enumerate() {
            let (shift, sign) = [(0, 1.0), (nodes[0].len(), -1.0)][m];
            let r = row(&**side.field(), x, true)?;
            for i in 0..l.nodes.len() {
                for j in 0..r.nodes.len() {
                    let value =
                        l.values[i] * r.values[j] + length * length * l.gradients[i].x * r.gradients[j].x;
                    b[(l.nodes[i], shift + r.nodes[j])] += sign * measure * value;
                }
            }
        }
    }
    Ok(b)
}

impl Naive {
    /// Takes bar and chain of a run and couples them by the given mediator and junction length. The state
    /// is not projected.
    ///
    /// # Errors
    /// A model that is not linear; a mediator that reaches beyond a model.
    pub fn new(
        run: &Coupled<f64>,
        mediator: &dyn Interpolation<f64>,
        length: f64,
        rule: Rule,
    ) -> Result<Self> {
        let b = coupling(run, mediator, length, rule)?;
        let [c, d] = [&run.subdomains()[COARSE], &run.subdomains()[FINE]];
        let mut mass = c.inertia().to_vec();
        mass.extend_from_slice(d.inertia());
        let joined = |f: &dyn Fn(&arlequin::core::Subdomain<f64>) -> Vec<f64>| {
            let mut x = f(c);
            x.extend(f(d));
            DVector::from_vec(x)
        };
        let split = c.inertia().len();
        let n = mass.len();
        let mut t = arlequin::core::sprs::TriMat::new((n, n));
        for (shift, s) in [(0, c), (split, d)] {
            let linear = s.model().views().linear.ok_or_else(|| Error::Unsupported {
                model: s.model().name().to_owned(),
                what: "be run naively, as it is not linear".into(),
            })?;
            for (v, (i, j)) in linear.stiffness().iter() {
                t.add_triplet(i + shift, j + shift, *v);
            }
        }
        let inverse = joined(&|s| s.inverse_inertia().to_vec());
        // Supported unknowns have no inverse inertia.
        let fixed = (0..n).filter(|i| inverse[*i] <= 0.0).collect();
        let s = &b * DMatrix::from_diagonal(&inverse) * b.transpose();
        // No check of the rank; an exactly singular matrix has no inverse.
        let inverse = s
            .clone()
            .try_inverse()
            .unwrap_or_else(|| DMatrix::from_element(s.nrows(), s.ncols(), f64::NAN));
        Ok(Self {
            mass: DVector::from_vec(mass),
            stiffness: t.to_csr(),
            inverse,
            b,
            fixed,
            split,
            q: joined(&|s| s.state().q.clone()),
            v: joined(&|s| s.state().v.clone()),
            a: DVector::zeros(n),
            lambda: DVector::zeros(s.nrows()),
        })
    }

    /// Sets the state of bar and chain before they were coupled.
    #[must_use]
    pub fn started_from(mut self, subdomains: &[arlequin::core::Subdomain<f64>; 2]) -> Self {
        let joined = |f: fn(&arlequin::core::Subdomain<f64>) -> &Vec<f64>| {
            DVector::from_iterator(self.q.len(), subdomains.iter().flat_map(|s| f(s).iter().copied()))
        };
        let (q, v) = (joined(|s| &s.state().q), joined(|s| &s.state().v));
        (self.q, self.v) = (q, v);
        self
    }

    /// Replaces the masses by those of another run. The stiffness stays, so both may be weighted
    /// differently: one by means over elements, the other at nodes.
    #[must_use]
    pub fn with_masses_of(mut self, run: &Coupled<f64>) -> Self {
        let [c, d] = [&run.subdomains()[COARSE], &run.subdomains()[FINE]];
        let masses = c.inertia().iter().chain(d.inertia()).copied();
        self.mass = DVector::from_iterator(self.mass.len(), masses);
        let inverse = DMatrix::from_diagonal(&self.mass.map(|m| 1.0 / m));
        let s = &self.b * inverse * self.b.transpose();
        self.inverse = s
            .clone()
            .try_inverse()
            .unwrap_or_else(|| DMatrix::from_element(s.nrows(), s.ncols(), f64::NAN));
        self
    }

    /// Returns the critical step of the two models without multipliers \[s\].
    #[must_use]
    pub fn critical_step(&self) -> f64 {
        let n = self.mass.len();
        // Scaled by the masses, the matrix is symmetric with the squares of the frequencies as eigenvalues.
        let mut k = DMatrix::<f64>::zeros(n, n);
        for (v, (i, j)) in self.stiffness.iter() {
            k[(i, j)] += *v / (self.mass[i] * self.mass[j]).sqrt();
        }
        // The limit of velocity Verlet.
        2.0 / k.symmetric_eigenvalues().max().sqrt()
    }

    /// Returns the condition number of the unscaled multiplier operator; infinite if the operator is not
    /// positive definite to round-off.
    #[must_use]
    pub fn condition(&self) -> f64 {
        let inverse = self.mass.map(|m| 1.0 / m);
        let s = &self.b * DMatrix::from_diagonal(&inverse) * self.b.transpose();
        let e = s.symmetric_eigenvalues();
        if e.min() > 0.0 {
            e.max() / e.min()
        } else {
            f64::INFINITY
        }
    }

    /// Returns the share of the chain's nodes between two positions that no multiplier acts on.
    #[must_use]
    pub fn untouched(&self, run: &Coupled<f64>, range: [f64; 2]) -> f64 {
        let nodes = run.subdomains()[FINE].model().nodes();
        let inside = (0..nodes.len()).filter(|k| (range[0]..=range[1]).contains(&nodes[*k].x));
        let numbers: Vec<usize> = inside.collect();
        let free = numbers
            .iter()
            .filter(|k| self.b.column(self.split + **k).amax() <= 0.0);
        free.count() as f64 / numbers.len() as f64
    }

    /// Returns the largest velocity jump, relative to the sum of the multiplier's coefficients.
    #[must_use]
    pub fn residual(&self) -> f64 {
        let r = &self.b * &self.v;
        let size = |i: usize| self.b.row(i).iter().map(|b| b.abs()).sum::<f64>();
        (0..r.len()).map(|i| r[i].abs() / size(i)).fold(0.0, f64::max)
    }

    /// Removes the velocity jump of this mediator only, as a single interface does.
    pub fn project(&mut self) {
        let l = &self.inverse * (&self.b * &self.v);
        let f = self.b.transpose() * l;
        (0..f.len()).for_each(|i| self.v[i] -= f[i] / self.mass[i]);
    }

    /// Copies the velocities of another run.
    pub fn take_velocity(&mut self, other: &Self) {
        self.v.copy_from(&other.v);
    }

    fn acceleration(&self) -> DVector<f64> {
        let mut f = DVector::zeros(self.q.len());
        for (k, (i, j)) in self.stiffness.iter() {
            f[i] -= *k * self.q[j];
        }
        let mut a = f.component_div(&self.mass);
        self.fixed.iter().for_each(|i| a[*i] = 0.0);
        a
    }

    fn energy(&self) -> f64 {
        let kinetic = 0.5 * self.v.component_mul(&self.mass).dot(&self.v);
        let k: f64 = self
            .stiffness
            .iter()
            .map(|(k, (i, j))| *k * self.q[i] * self.q[j])
            .sum();
        kinetic + 0.5 * k
    }

    /// Makes velocity Verlet steps without checks and without a consistent start.
    pub fn run(&mut self, dt: f64, steps: usize) -> Trace {
        let start = self.energy();
        let (mut growth, mut flips) = (1.0f64, 0.0);
        // Not consistent on purpose: the multipliers are missing.
        self.a = self.acceleration();
        for _ in 0..steps {
            self.q += &self.v * dt + &self.a * (0.5 * dt * dt);
            let a = self.acceleration();
            self.v += (&self.a + &a) * (0.5 * dt);
            // Multipliers that remove the velocity jump of this step.
            let lambda = &self.inverse * (&self.b * &self.v) * (2.0 / dt);
            let push = self.b.transpose() * &lambda;
            let push = DVector::from_fn(push.len(), |i, _| push[i] / self.mass[i]);
            // The multipliers act on the second half of the step; their force stays in the acceleration.
            self.v -= &push * (0.5 * dt);
            self.a = a - push;
            for i in &self.fixed {
                self.v[*i] = 0.0;
                self.a[*i] = 0.0;
            }
            let top = lambda.iamax();
            flips += f64::from(u8::from(lambda[top] * self.lambda[top] < 0.0));
            self.lambda = lambda;
            let now = self.energy() / start;
            if !now.is_finite() {
                return Trace {
                    growth: f64::INFINITY,
                    flips: flips / steps as f64,
                };
            }
            growth = growth.max(now);
        }
        Trace {
            growth,
            flips: flips / steps as f64,
        }
    }

    /// Returns the displacement with the largest modulus in the chain beyond a position.
    #[must_use]
    pub fn peak_of_chain(&self, run: &Coupled<f64>, beyond: f64) -> f64 {
        let nodes = run.subdomains()[FINE].model().nodes();
        let q = self.q.rows_range(self.split..);
        let far = nodes.iter().zip(q.iter()).filter(|(p, _)| p.x > beyond);
        far.fold(0.0, |a: f64, (_, q)| if q.abs() > a.abs() { *q } else { a })
    }
}
