//! Elasticity of the bulk: a periodic packing under the six unit strains.
//!
//! With a mean strain `E`, the relative displacement across a bond from `x_i` to the image `x_i + d` of `x_j`
//! is `u_j - u_i + E d`, where `u` is periodic. The affine part `E d` loads the particles, and `u` and the
//! rotations bring them to equilibrium. The mean stress is `1/V sum_bonds sym(d f_i)`, with `f_i` the force
//! of the bond on its first particle. There are no walls, surface layers or supports.
//!
//! Order of components: `xx yy zz yz zx xy`, shear strains as engineering strains `2 E_ij`.

use crate::bond::{BeamMaterial, Twist};
use crate::calibrate::Spread;
use crate::error::{Error, Result};
use crate::packing::Packing;
use crate::particles::BondedParticles;
use crate::statics::StaticProblem;
use nalgebra::{Matrix3, Matrix6, Vector6};

/// Relative residual of each solve; errors of the moduli go with its square.
const TOLERANCE: f64 = 1e-6;
/// Largest number of iterations of each solve.
const ITERATIONS: usize = 50_000;

/// Effective stiffness of a periodic sample, and moduli computed from it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bulk {
    /// Stiffness in Voigt's order \[Pa\].
    pub stiffness: Matrix6<f64>,
    /// Young's modulus of the isotropic part \[Pa\].
    pub young: f64,
    /// Poisson's ratio of the isotropic part.
    pub poisson: f64,
    /// Young's moduli along the axes \[Pa\]: their differences show a preferred direction.
    pub young_axes: [f64; 3],
    /// Norm of the stiffness without its isotropic part over the norm of that part, both as
    /// fourth-order tensors: 0 when isotropic.
    pub anisotropy: f64,
    /// Iterations of all solves.
    pub iterations: usize,
}

/// Returns the unit strain of component `c` as a tensor.
fn unit(c: usize) -> Matrix3<f64> {
    const PLACE: [[usize; 2]; 6] = [[0, 0], [1, 1], [2, 2], [1, 2], [2, 0], [0, 1]];
    let [i, j] = PLACE[c];
    // An engineering shear of one is half on both sides of the diagonal; on it, the halves add up.
    let mut e = Matrix3::zeros();
    e[(i, j)] += 0.5;
    e[(j, i)] += 0.5;
    e
}

fn voigt(s: &Matrix3<f64>) -> Vector6<f64> {
    Vector6::new(s.m11, s.m22, s.m33, s.m23, s.m31, s.m12)
}

/// Computes the effective stiffness of a packing in [`crate::Container::Periodic`].
///
/// ```
/// use dem_beam::homogenise::bulk;
/// use dem_beam::{BeamMaterial, Container, PackingSpec};
/// let packing = PackingSpec::quench(Container::periodic(1e-3)?, 500, 1).build()?;
/// let found = bulk(&packing, BeamMaterial::SILICA)?;
/// assert!(found.young > 60e9 && found.young < 85e9);
/// # Ok::<(), dem_beam::Error>(())
/// ```
///
/// # Errors
/// [`Error::NotPeriodic`], [`Error::SeveralParts`], errors of [`BondedParticles::new`],
/// [`Error::NoConvergence`].
pub fn bulk(packing: &Packing, beam: BeamMaterial) -> Result<Bulk> {
    if packing.period.is_none() {
        return Err(Error::NotPeriodic);
    }
    packing.connected("bulk elasticity")?;
    // Statics needs no mass, so any density does.
    let body = BondedParticles::from_packing(packing, beam, 1.0)?;
    let mut stiffness = Matrix6::zeros();
    let mut iterations = 0;
    for c in 0..6 {
        let (stress, its) = respond(&body, packing.volume, &unit(c))?;
        stiffness.set_column(c, &voigt(&stress));
        iterations += its;
    }
    // Symmetric up to the tolerance of the solves.
    let stiffness = (stiffness + stiffness.transpose()) * 0.5;
    let (young, poisson) = isotropic(&stiffness);
    // Young's modulus along an axis is the inverse of the compliance on the diagonal.
    let compliance = stiffness.try_inverse().unwrap_or_else(Matrix6::zeros);
    Ok(Bulk {
        stiffness,
        young,
        poisson,
        young_axes: [0, 1, 2].map(|a| 1.0 / compliance[(a, a)]),
        anisotropy: anisotropy(&stiffness),
        iterations,
    })
}

/// Returns the mean stress under a mean strain, and the iterations of the solve.
fn respond(body: &BondedParticles, volume: f64, strain: &Matrix3<f64>) -> Result<(Matrix3<f64>, usize)> {
    let k = body.rigidity();
    let zero = Twist::zero();
    let jump = |b: usize| {
        let bond = body.bond(b);
        let d = bond.span();
        let across = Twist {
            linear: strain * d,
            ..zero
        };
        (d, across)
    };
    let mut problem = StaticProblem::free(body.len());
    for (b, &[i, j]) in body.pairs().iter().enumerate() {
        // The affine displacement is applied as a load: the solver's unknowns are periodic.
        let (fi, fj) = body.bond(b).wrenches(k, &zero, &jump(b).1);
        for (p, f) in [(i, fi), (j, fj)] {
            let load = &mut problem.loads[p as usize];
            load.linear += f.linear;
            load.angular += f.angular;
        }
    }
    let solution = problem.solve(body, TOLERANCE, ITERATIONS)?;
    let mut stress = Matrix3::zeros();
    for (b, &[i, j]) in body.pairs().iter().enumerate() {
        let (d, across) = jump(b);
        let [i, mut j] = [i, j].map(|p| solution.displacements[p as usize]);
        j.linear += across.linear;
        let pull = body.bond(b).wrenches(k, &i, &j).0.linear;
        // Sum of branch vector times force; only the symmetric part is a stress, because torques balance the
        // rest.
        stress += (d * pull.transpose() + pull * d.transpose()) * (0.5 / volume);
    }
    Ok((stress, solution.iterations))
}

/// Returns bulk and shear modulus of the isotropic part (Voigt averages).
fn moduli(c: &Matrix6<f64>) -> (f64, f64) {
    let direct = c.m11 + c.m22 + c.m33;
    let cross = c.m12 + c.m13 + c.m23;
    let shear = c.m44 + c.m55 + c.m66;
    (
        (direct + 2.0 * cross) / 9.0,
        (direct - cross + 3.0 * shear) / 15.0,
    )
}

fn isotropic(c: &Matrix6<f64>) -> (f64, f64) {
    let (bulk, shear) = moduli(c);
    let young = 9.0 * bulk * shear / (3.0 * bulk + shear);
    (young, young / (2.0 * shear) - 1.0)
}

fn anisotropy(c: &Matrix6<f64>) -> f64 {
    let (bulk, shear) = moduli(c);
    let mut part = Matrix6::zeros();
    for i in 0..3 {
        for j in 0..3 {
            // The isotropic stiffness in Voigt's order, with engineering shear strains.
            part[(i, j)] = bulk - 2.0 / 3.0 * shear + if i == j { 2.0 * shear } else { 0.0 };
        }
        part[(i + 3, i + 3)] = shear;
    }
    // A shear component of Voigt's notation stands for two entries of the tensor.
    let times = |i: usize| if i < 3 { 1.0 } else { 2.0 };
    let norm = |m: &Matrix6<f64>| {
        let mut sum = 0.0;
        for i in 0..6 {
            for j in 0..6 {
                sum += times(i) * times(j) * m[(i, j)] * m[(i, j)];
            }
        }
        sum.sqrt()
    };
    norm(&(c - part)) / norm(&part)
}

/// Bulk elasticity over several packings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BulkStatistics {
    /// Young's modulus \[Pa\].
    pub young: Spread,
    /// Poisson's ratio.
    pub poisson: Spread,
    /// Anisotropy of each sample.
    pub anisotropy: Spread,
}

impl BulkStatistics {
    /// Computes means and deviations of several samples.
    #[must_use]
    pub fn from_samples(samples: &[Bulk]) -> Self {
        let spread = |f: fn(&Bulk) -> f64| Spread::from_samples(&samples.iter().map(f).collect::<Vec<_>>());
        Self {
            young: spread(|b| b.young),
            poisson: spread(|b| b.poisson),
            anisotropy: spread(|b| b.anisotropy),
        }
    }
}
