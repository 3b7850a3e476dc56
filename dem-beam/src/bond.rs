//! The linear law of one cohesive beam: Euler-Bernoulli, circular section, small rotations.
//!
//! With `n` the unit vector from particle i to j, `l` the distance of the centres,
//! `Du = u_j - u_i`, `Dth = th_j - th_i`, `x_p = x - (n.x) n`:
//!
//! ```text
//! k_n = E S/l   k_t = 12 E I/l^3   k_s = 6 E I/l^2   k_phi = G I_O/l   k_b = 2 E I/l
//! f_i =  k_n (n.Du) n + k_t Du_p + k_s n x (th_i + th_j)              f_j = -f_i
//! c_i =  k_phi (n.Dth) n + k_s n x Du - k_b (2 th_i + th_j)_p
//! c_j = -k_phi (n.Dth) n + k_s n x Du - k_b (2 th_j + th_i)_p
//! ```
//!
//! Four numbers describe a bond, its weight `w` included: `axis = n/l` and `scale = w l`. Every coefficient
//! is then a polynomial in `q = axis.axis = 1/l^2`, without a division:
//!
//! ```text
//! f_i = scale [12 EI q^2 Du + 6 EI q axis x (th_i+th_j) + (ES - 12 EI q)(axis.Du) axis]
//! ```
//!
//! Forces are those *on* the particle. Units: N, m, rad.

use crate::error::{Error, Result, positive};
use nalgebra::{Matrix3, Matrix6, SMatrix, SVector, Vector3};

pub use arlequin_core::contact::Twist;

/// Elastic constants of the beams and the ratio of beam to mean particle radius.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BeamMaterial {
    /// Young's modulus `E_mu` of a beam \[Pa\].
    pub young: f64,
    /// Poisson's ratio `nu_mu` of a beam; it enters through `G = E/(2 (1+nu))`.
    pub poisson: f64,
    /// Beam radius over mean particle radius.
    pub radius_ratio: f64,
}

/// Measured rows for [`BeamMaterial::from_bulk`]: beam radius over mean particle radius, Poisson's ratio of
/// the packing, Young's modulus of the packing over that of the beams. Source: `arlequin calibrate
/// --periodic --count 4000 --seeds 2 --young 1e9 --radius-ratio …`. Between two samples moduli differ by up
/// to 0.4 %, Poisson's ratios by 5e-4.
const BULK: [[f64; 3]; 8] = [
    [0.2, 0.35678, 8.2988e-3],
    [0.3, 0.31421, 25.313e-3],
    [0.4, 0.27627, 56.040e-3],
    [0.5, 0.24137, 103.93e-3],
    [0.6, 0.20853, 172.29e-3],
    [0.71, 0.17405, 274.99e-3],
    [0.9, 0.11719, 532.13e-3],
    [1.2, 0.03207, 1188.0e-3],
];

impl BeamMaterial {
    /// Silica as in Jebahi et al. 2013: 265e9 Pa, 0.3, 0.71.
    pub const SILICA: Self = Self {
        young: 265e9,
        poisson: 0.3,
        radius_ratio: 0.71,
    };

    /// Returns the beams that give a packing the Young's modulus `young` \[Pa\] and Poisson's ratio
    /// `poisson`. It interpolates measurements on periodic samples with 6.2 bonds per particle (onset of
    /// jamming, 4000 spheres of radii within 25 %, beams of Poisson's ratio 0.3). A body with walls or with
    /// few spheres across is softer; [`crate::calibrate`] measures a given one.
    ///
    /// ```
    /// use dem_beam::BeamMaterial;
    /// let beam = BeamMaterial::from_bulk(72.9e9, 0.174)?;
    /// assert!((beam.radius_ratio - 0.71).abs() < 1e-3 && (beam.young / 265e9 - 1.0).abs() < 2e-3);
    /// # Ok::<(), dem_beam::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a modulus that is not positive; [`Error::PoissonOutOfReach`] outside of
    /// [`Self::BULK_POISSON`].
    pub fn from_bulk(young: f64, poisson: f64) -> Result<Self> {
        positive("wanted Young's modulus", young)?;
        let [low, high] = Self::BULK_POISSON;
        if !(low..=high).contains(&poisson) {
            return Err(Error::PoissonOutOfReach {
                wanted: poisson,
                thick: low,
                thin: high,
                ratios: [BULK[0][0], BULK[BULK.len() - 1][0]],
            });
        }
        // The table falls in Poisson's ratio. Ends are left out, so that there is always an interval.
        let end = BULK[1..BULK.len() - 1].partition_point(|row| row[1] > poisson) + 1;
        let [a, b] = [BULK[end - 1], BULK[end]];
        let radius_ratio = a[0] + (b[0] - a[0]) * (poisson - a[1]) / (b[1] - a[1]);
        let unit = Self {
            young: 1.0,
            radius_ratio,
            ..Self::SILICA
        };
        Ok(Self {
            // The modulus is proportional to that of the beams.
            young: young / unit.bulk()[0],
            ..unit
        })
    }

    /// Range of Poisson's ratios that [`Self::from_bulk`] accepts.
    pub const BULK_POISSON: [f64; 2] = [BULK[BULK.len() - 1][1], BULK[0][1]];

    /// Range of radius ratios that were measured.
    pub const BULK_RATIOS: [f64; 2] = [BULK[0][0], BULK[BULK.len() - 1][0]];

    /// Returns Young's modulus \[Pa\] and Poisson's ratio of packings with these beams: the inverse of
    /// [`Self::from_bulk`]. Radius ratios outside of the measured range are extrapolated.
    #[must_use]
    pub fn bulk(&self) -> [f64; 2] {
        // Only inner rows are compared, so that ratios beyond the table use its first or last interval.
        let end = BULK[1..BULK.len() - 1].partition_point(|row| row[0] < self.radius_ratio) + 1;
        let [a, b] = [BULK[end - 1], BULK[end]];
        let share = (self.radius_ratio - a[0]) / (b[0] - a[0]);
        // The modulus is nearly a power of the radius ratio, so interpolation is linear in logarithms.
        let power = (b[2] / a[2]).ln() / (b[0] / a[0]).ln();
        let young = a[2] * (self.radius_ratio / a[0]).powf(power);
        [young * self.young, a[1] + share * (b[1] - a[1])]
    }

    /// Returns the section rigidities of all beams of a packing with mean particle radius `mean_radius`
    /// \[m\].
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a modulus, ratio or radius that is not positive, or a
    /// Poisson ratio outside (-1, 0.5].
    ///
    /// ```
    /// let r = dem_beam::BeamMaterial::SILICA.rigidity(0.05e-3)?;
    /// assert!((r.axial - 1.0492e3).abs() < 0.1); // E pi (0.71 * 0.05 mm)^2, N
    /// # Ok::<(), dem_beam::Error>(())
    /// ```
    pub fn rigidity(&self, mean_radius: f64) -> Result<BeamRigidity> {
        positive("beam Young's modulus", self.young)?;
        positive("beam radius ratio", self.radius_ratio)?;
        positive("mean particle radius", mean_radius)?;
        // Not `<= -1`: a NaN must be refused, too.
        if !(self.poisson > -1.0 && self.poisson <= 0.5) {
            return Err(Error::out_of_range(
                "beam Poisson's ratio",
                self.poisson,
                "(-1, 0.5]",
            ));
        }
        let radius = self.radius_ratio * mean_radius;
        let area = std::f64::consts::PI * radius * radius;
        let inertia = 0.25 * area * radius * radius;
        Ok(BeamRigidity {
            axial: self.young * area,
            bending: self.young * inertia,
            // `G I_O = E/(2 (1 + ν)) 2 I`.
            torsion: self.young / (1.0 + self.poisson) * inertia,
        })
    }
}

/// Rigidities of a beam section, the same for all bonds of a packing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BeamRigidity {
    /// `E S` \[N\].
    pub axial: f64,
    /// `E I` \[N m²\].
    pub bending: f64,
    /// `G I_O`, `I_O = 2 I` \[N m²\].
    pub torsion: f64,
}

/// One bond, ready for use: `axis = n/l` \[1/m\] and `scale = w l` \[m\], `w` the weight.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LinearBond {
    /// `n/l`, from the first particle to the second.
    pub axis: Vector3<f64>,
    /// `w l`.
    pub scale: f64,
}

impl LinearBond {
    /// Returns the bond between two centres \[m\] with weight `weight` (1 for an unweighted bond).
    ///
    /// # Errors
    /// [`Error::ZeroLengthBond`] (as bond 0) if the centres coincide or are not finite.
    pub fn new(first: Vector3<f64>, second: Vector3<f64>, weight: f64) -> Result<Self> {
        let d = second - first;
        let length = d.norm();
        // The axis is divided by the square of the length, which must not underflow.
        if !(length > f64::MIN_POSITIVE.sqrt() && length.is_finite()) {
            return Err(Error::ZeroLengthBond {
                bond: 0,
                first: 0,
                second: 1,
                length,
                limit: f64::MIN_POSITIVE.sqrt(),
            });
        }
        Ok(Self {
            axis: d / (length * length),
            scale: weight * length,
        })
    }

    /// Vector from the first centre to the second \[m\].
    #[must_use]
    pub fn span(&self) -> Vector3<f64> {
        self.axis / self.axis.norm_squared()
    }

    /// Returns the forces and torques of the beam on its first and on its second particle.
    #[must_use]
    pub fn wrenches(&self, k: &BeamRigidity, i: &Twist, j: &Twist) -> (Twist, Twist) {
        let (p, s) = (self.axis, self.scale);
        let q = p.dot(&p);
        let du = j.linear - i.linear;
        let sum = i.angular + j.angular;
        let diff = j.angular - i.angular;
        // `b = w k_b`; the transverse coefficients follow as `w k_s = 3 b/l` and `w k_t = 6 b/l^2`.
        let b = 2.0 * k.bending * s * q;
        // What the first term adds along the axis is taken back here, so that no projection is needed.
        let force = (du * (6.0 * q) + p.cross(&sum) * 3.0) * b
            + p * ((k.axial - 12.0 * k.bending * q) * s * p.dot(&du));
        let shear = p.cross(&du) * (3.0 * b);
        let twist = p * (k.torsion * s * p.dot(&diff));
        // Bending acts across the axis: the part along it is taken off.
        let bend = |x: Vector3<f64>| x * b - p * (2.0 * k.bending * s * p.dot(&x));
        (
            Twist {
                linear: force,
                angular: twist + shear - bend(i.angular + sum),
            },
            Twist {
                linear: -force,
                angular: -twist + shear - bend(j.angular + sum),
            },
        )
    }

    /// Returns the elastic energy \[J\], never negative for a weight >= 0.
    #[must_use]
    pub fn energy(&self, k: &BeamRigidity, i: &Twist, j: &Twist) -> f64 {
        let (p, s) = (self.axis, self.scale);
        let q = p.dot(&p);
        let du = j.linear - i.linear;
        let stretch = p.dot(&du);
        let twist = p.dot(&(j.angular - i.angular));
        // End rotations relative to the chord, perpendicular part: phi = th_p - n x Du / l. As a sum of
        // squares the energy cannot become negative by cancellation.
        let chord = p.cross(&du);
        let across = |t: Vector3<f64>| t - p * (p.dot(&t) / q) - chord;
        let (a, b) = (across(i.angular), across(j.angular));
        0.5 * k.axial * s * stretch * stretch
            + 0.5 * k.torsion * s * twist * twist
            + 2.0 * k.bending * s * q * (a.dot(&a) + a.dot(&b) + b.dot(&b))
    }

    /// Returns the 12 x 12 stiffness in the order `(u_i, th_i, u_j, th_j)`: `f = -K x`.
    #[must_use]
    pub fn stiffness(&self, k: &BeamRigidity) -> SMatrix<f64, 12, 12> {
        let mut out = SMatrix::<f64, 12, 12>::zeros();
        // Column c is the force against a unit displacement of component c.
        for c in 0..12 {
            let mut x = SVector::<f64, 12>::zeros();
            x[c] = 1.0;
            let twist = |o: usize| Twist {
                linear: Vector3::new(x[o], x[o + 1], x[o + 2]),
                angular: Vector3::new(x[o + 3], x[o + 4], x[o + 5]),
            };
            let (fi, fj) = self.wrenches(k, &twist(0), &twist(6));
            for (o, v) in [fi.linear, fi.angular, fj.linear, fj.angular].iter().enumerate() {
                out.fixed_view_mut::<3, 1>(3 * o, c).copy_from(&-v);
            }
        }
        out
    }

    /// Returns the 6 x 6 block `K_ii` of the first particle. The block of the second particle is that of
    /// [`Self::reversed`].
    #[must_use]
    pub fn own_block(&self, k: &BeamRigidity) -> Matrix6<f64> {
        let (p, s) = (self.axis, self.scale);
        let q = p.dot(&p);
        let ppt = p * p.transpose();
        let identity = Matrix3::identity();
        let shear = p.cross_matrix() * (6.0 * k.bending * s * q);
        let mut out = Matrix6::zeros();
        out.fixed_view_mut::<3, 3>(0, 0).copy_from(
            &(identity * (12.0 * k.bending * s * q * q) + ppt * ((k.axial - 12.0 * k.bending * q) * s)),
        );
        out.fixed_view_mut::<3, 3>(0, 3).copy_from(&-shear);
        out.fixed_view_mut::<3, 3>(3, 0).copy_from(&shear);
        out.fixed_view_mut::<3, 3>(3, 3)
            .copy_from(&(identity * (4.0 * k.bending * s * q) + ppt * ((k.torsion - 4.0 * k.bending) * s)));
        out
    }

    /// Returns the bond as seen from its second particle.
    #[must_use]
    pub fn reversed(&self) -> Self {
        Self {
            axis: -self.axis,
            scale: self.scale,
        }
    }
}
