//! Selection of particles for supports and loads, and the distribution of a load among them.

use super::DemModel;
use crate::error::{Error, Result, finite};
use arlequin_core::geometry::closest_on_triangle;
use nalgebra::{Matrix3, Point3, Vector3};

/// Rule by which a load is shared among particles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum LoadShare {
    /// In proportion to the unweighted mass, like a body force.
    #[default]
    Mass,
    /// In proportion to `r_i^2`, like a pressure on the particles' sections.
    Area,
}

/// Largest gap that counts as touching, as a fraction of the mean radius. Bonds bridge such gaps as well.
pub const TOUCH: f64 = 0.05;

impl DemModel {
    /// Returns the particles whose centres fulfil a condition, ascending.
    #[must_use]
    pub fn select(&self, condition: impl Fn(&Point3<f64>) -> bool) -> Vec<usize> {
        (0..self.centres().len())
            .filter(|&i| condition(&self.centres()[i]))
            .collect()
    }

    /// Returns the particles that touch the plane through `wall` \[m\] with the given normal (of any length
    /// and sign): the layer to clamp. A thicker layer would shorten the body.
    #[must_use]
    pub fn clamp_layer(&self, wall: &Point3<f64>, normal: &Vector3<f64>) -> Vec<usize> {
        let n = normal.normalize();
        let (radii, gap) = (self.body.radii(), TOUCH * self.body.mean_radius());
        let touches = |i: &usize| n.dot(&(self.centres()[*i] - wall)).abs() < radii[*i] + gap;
        (0..self.centres().len()).filter(touches).collect()
    }

    /// Returns the particles that touch any of the triangles (corners in m): the layer at a face of any
    /// shape.
    #[must_use]
    pub fn touching(&self, triangles: &[[Vector3<f64>; 3]]) -> Vec<usize> {
        let (radii, gap) = (self.body.radii(), TOUCH * self.body.mean_radius());
        let boxes: Vec<_> = triangles
            .iter()
            .map(|[a, b, c]| (a.inf(b).inf(c), a.sup(b).sup(c)))
            .collect();
        let touches = |i: &usize| {
            let (x, reach) = (self.centres()[*i].coords, radii[*i] + gap);
            triangles.iter().zip(&boxes).any(|(t, (low, high))| {
                let is_in_box = (0..3).all(|a| x[a] > low[a] - reach && x[a] < high[a] + reach);
                is_in_box && (closest_on_triangle(&x, t) - x).norm() < reach
            })
        };
        (0..self.centres().len()).filter(touches).collect()
    }

    /// Returns the displacement unknowns of particles along the marked axes.
    #[must_use]
    pub fn translations(&self, particles: &[usize], axes: [bool; 3]) -> Vec<usize> {
        self.unknowns(0, particles, axes)
    }

    /// Returns the rotation unknowns of particles about the marked axes.
    #[must_use]
    pub fn rotations(&self, particles: &[usize], axes: [bool; 3]) -> Vec<usize> {
        self.unknowns(3 * self.centres().len(), particles, axes)
    }

    /// Returns all six unknowns of particles, for a clamp.
    #[must_use]
    pub fn clamped(&self, particles: &[usize]) -> Vec<usize> {
        let mut unknowns = self.translations(particles, [true; 3]);
        unknowns.extend(self.rotations(particles, [true; 3]));
        unknowns
    }

    fn unknowns(&self, first: usize, particles: &[usize], axes: [bool; 3]) -> Vec<usize> {
        let unknowns = |i: &usize| {
            let start = first + 3 * i;
            (0..3).filter(move |&c| axes[c]).map(move |c| start + c)
        };
        particles.iter().flat_map(unknowns).collect()
    }

    /// Shares a force \[N\] among particles; returns `(unknown, force)` pairs.
    ///
    /// ```
    /// use dem_beam::packing::{Lattice, lattice};
    /// use dem_beam::{BeamMaterial, DemModel, LoadShare};
    /// use nalgebra::Vector3;
    /// let cube = lattice(Lattice::Cubic, [3, 3, 3], 1e-3)?;
    /// let model = DemModel::new("cube", &cube, BeamMaterial::SILICA, 2200.0)?;
    /// let face = model.select(|x| x.x > 3e-3);
    /// let load = model.force(&face, Vector3::new(9.0, 0.0, 0.0), LoadShare::Mass)?;
    /// assert!(load.len() == 9 && load.iter().all(|(_, f)| (f - 1.0).abs() < 1e-12));
    /// # Ok::<(), dem_beam::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::BadSelection`] for no particles or unknown ones, [`Error::NotFinite`], [`Error::InParts`].
    pub fn force(
        &self,
        particles: &[usize],
        force: Vector3<f64>,
        share: LoadShare,
    ) -> Result<Vec<(usize, f64)>> {
        self.require_whole("a force that is shared out among particles")?;
        for (axis, f) in force.iter().enumerate() {
            finite("load", "component", axis, *f)?;
        }
        let shares = self.shares(particles, share)?;
        let mut out = Vec::new();
        for (&i, s) in particles.iter().zip(shares) {
            for c in (0..3).filter(|&c| force[c] != 0.0) {
                out.push((3 * i + c, s * force[c]));
            }
        }
        Ok(out)
    }

    /// Applies a torque \[N m\] by forces without resultant, `f_i = s_i w x (x_i - x_s)` about the centroid
    /// `x_s` of the shares `s_i`. The vector `w` is such that the moments of all forces sum to `torque`.
    ///
    /// # Errors
    /// [`Error::BadSelection`] for no particles, unknown ones, or particles on a line; [`Error::NotFinite`];
    /// [`Error::InParts`].
    pub fn torque(
        &self,
        particles: &[usize],
        torque: Vector3<f64>,
        share: LoadShare,
    ) -> Result<Vec<(usize, f64)>> {
        self.require_whole("a torque that is shared out among particles")?;
        for (axis, m) in torque.iter().enumerate() {
            finite("torque", "component", axis, *m)?;
        }
        let shares = self.shares(particles, share)?;
        let position = |i: usize| self.centres()[i].coords;
        let centre: Vector3<f64> = particles
            .iter()
            .zip(&shares)
            .map(|(&i, s)| position(i) * *s)
            .sum();
        // Inertia tensor of the shares: the moment of the forces is `spread w`.
        let mut spread = Matrix3::zeros();
        for (&i, s) in particles.iter().zip(&shares) {
            let d = position(i) - centre;
            spread += (Matrix3::identity() * d.norm_squared() - d * d.transpose()) * *s;
        }
        // The smallest eigenvalue vanishes for particles on a line, which carry no moment about it.
        let flat = spread.symmetric_eigenvalues();
        let inverse = spread.try_inverse().filter(|_| flat.min() > 1e-9 * flat.max());
        let Some(inverse) = inverse else {
            return Err(Error::BadSelection {
                count: particles.len(),
                reason: "they lie on a line and cannot carry a torque by forces; select a face",
            });
        };
        let w = inverse * torque;
        let mut out = Vec::with_capacity(3 * particles.len());
        for (&i, s) in particles.iter().zip(&shares) {
            let f = w.cross(&(position(i) - centre)) * *s;
            out.extend((0..3).map(|c| (3 * i + c, f[c])));
        }
        Ok(out)
    }

    /// Returns the share of each particle in a load; shares sum to one.
    fn shares(&self, particles: &[usize], share: LoadShare) -> Result<Vec<f64>> {
        let refuse = |reason| {
            Err(Error::BadSelection {
                count: particles.len(),
                reason,
            })
        };
        if particles.is_empty() {
            return refuse("select at least one; check the condition against the extent of the body");
        }
        if particles.iter().any(|&i| i >= self.centres().len()) {
            return refuse("one of them does not exist in this model");
        }
        let part = |&i: &usize| match share {
            LoadShare::Mass => self.mass[i],
            LoadShare::Area => self.body.radii()[i].powi(2),
        };
        let total: f64 = particles.iter().map(part).sum();
        Ok(particles.iter().map(|i| part(i) / total).collect())
    }
}
