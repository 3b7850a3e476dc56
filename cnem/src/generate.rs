//! Node sets of simple bodies, in an order that keeps neighbours close in memory.

use crate::constraint::Surface;
use crate::domain::Domain;
use crate::error::{Result, parameter};
use nalgebra::{Point3, Vector3};
use std::f64::consts::PI;

/// A solid cylinder along x: layers of rings, with `6 k` nodes on ring `k`.
///
/// The outermost ring is a polygon with the area of the circle; its corners lie a little outside the radius.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cylinder {
    /// Ends of the axis \[m\].
    pub x: [f64; 2],
    /// Radius \[m\].
    pub radius: f64,
    /// Rings around the axis.
    pub rings: usize,
    /// Layers of nodes along the axis, including those at the ends.
    pub layers: usize,
    /// Random displacement of the nodes \[spacings\]: free inside, along the surface for nodes on it, none on
    /// edges.
    pub jitter: f64,
    /// Seed of the random sequence.
    pub seed: u64,
}

impl Cylinder {
    /// Creates a cylinder with rings and layers of about the given spacing \[m\], without jitter.
    ///
    /// ```
    /// use cnem::generate::Cylinder;
    /// let beam = Cylinder::with_spacing([0.0, 20e-3], 1e-3, 0.5e-3)?.domain()?;
    /// assert!((beam.volume() / (std::f64::consts::PI * 20e-9) - 1.0).abs() < 1e-12);
    /// # Ok::<(), cnem::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`crate::Error::Parameter`] unless the axis has a length and radius and spacing are positive.
    pub fn with_spacing(x: [f64; 2], radius: f64, spacing: f64) -> Result<Self> {
        let length = x[1] - x[0];
        for (name, value) in [("length", length), ("radius", radius), ("spacing", spacing)] {
            if !(value.is_finite() && value > 0.0) {
                return Err(parameter(name, value, "must be positive and finite [m]"));
            }
        }
        Ok(Self {
            x,
            radius,
            rings: ((radius / spacing).round() as usize).max(1),
            layers: ((length / spacing).round() as usize).max(1) + 1,
            jitter: 0.0,
            seed: 1,
        })
    }

    /// Number of nodes.
    pub fn node_count(&self) -> usize {
        self.layers * (1 + 3 * self.rings * (self.rings + 1))
    }

    /// Returns the nodes, layer by layer from the first end, ring by ring from the axis.
    ///
    /// # Errors
    /// [`crate::Error::Parameter`] for an axis without a length, a radius that is not positive, fewer than
    /// one ring or two layers, or a jitter outside `[0, 0.45]`.
    pub fn nodes(&self) -> Result<Vec<Point3<f64>>> {
        self.check()?;
        let mut next = noise(self.seed);
        let outer = 6.0 * self.rings as f64;
        // A regular polygon with `n` corners at `R` has the area `n/2 R² sin(2π/n)`; this `R` makes it
        // `π r²`.
        let radius = self.radius * (2.0 * PI / outer / (2.0 * PI / outer).sin()).sqrt();
        // One layer is refused by the check; this guards the division alone.
        let (dr, steps) = (radius / self.rings as f64, self.layers.saturating_sub(1).max(1));
        let dx = (self.x[1] - self.x[0]) / steps as f64;
        let mut out = Vec::with_capacity(self.node_count());
        for layer in 0..self.layers {
            let end = layer == 0 || layer + 1 == self.layers;
            let x = self.x[0] + dx * layer as f64;
            // `6 k` nodes on ring `k` keep the spacing along the ring at about the spacing between rings.
            for ring in 0..=self.rings {
                let count = (6 * ring).max(1);
                for k in 0..count {
                    let angle = 2.0 * PI * k as f64 / count as f64;
                    let r = dr * ring as f64;
                    let mut p = Vector3::new(x, r * angle.cos(), r * angle.sin());
                    // Three numbers are drawn for every node, used or not: the sequence stays in step with
                    // the nodes.
                    let mut shift = Vector3::new(next() * dx, next() * dr, next() * dr) * self.jitter;
                    // Nodes on the ends move within the end: it stays plane, and the cylinder keeps its
                    // length.
                    if end {
                        shift.x = 0.0;
                    }
                    if ring == self.rings {
                        // The edges of the prism stay straight, so that its faces stay flat.
                        (shift.y, shift.z) = (0.0, 0.0);
                    }
                    p += shift;
                    out.push(Point3::from(p));
                }
            }
        }
        Ok(out)
    }

    /// Creates the domain: the convex hull of the nodes.
    ///
    /// # Errors
    /// The errors of [`Cylinder::nodes`] and of [`Domain::new`].
    pub fn domain(&self) -> Result<Domain> {
        Domain::new(&self.nodes()?, &Surface::convex_hull())
    }

    fn check(&self) -> Result<()> {
        for (name, value) in [("length", self.x[1] - self.x[0]), ("radius", self.radius)] {
            if !(value.is_finite() && value > 0.0) {
                return Err(parameter(name, value, "must be positive and finite [m]"));
            }
        }
        if self.rings == 0 {
            return Err(parameter("rings", self.rings, "at least one is needed"));
        }
        if self.layers < 2 {
            return Err(parameter("layers", self.layers, "at least two are needed"));
        }
        if !(0.0..=0.45).contains(&self.jitter) {
            return Err(parameter(
                "jitter",
                self.jitter,
                "must be between 0 and 0.45 spacings",
            ));
        }
        Ok(())
    }
}

/// Returns the nodes of a box on a grid with the given numbers of steps, x fastest. Nodes inside are moved by
/// up to `jitter` steps.
///
/// # Errors
/// [`crate::Error::Parameter`] for an empty box, no steps, or a jitter outside `[0, 0.45]`.
pub fn block(
    low: Point3<f64>,
    high: Point3<f64>,
    steps: [usize; 3],
    jitter: f64,
    seed: u64,
) -> Result<Vec<Point3<f64>>> {
    let extent = high - low;
    if !extent.iter().all(|e| e.is_finite() && *e > 0.0) {
        return Err(parameter(
            "extent of the block",
            extent,
            "must be positive and finite [m]",
        ));
    }
    if steps.contains(&0) {
        return Err(parameter("steps", format_args!("{steps:?}"), "must be positive"));
    }
    if !(0.0..=0.45).contains(&jitter) {
        return Err(parameter("jitter", jitter, "must be between 0 and 0.45 spacings"));
    }
    let mut next = noise(seed);
    let mut out = Vec::new();
    for k in 0..=steps[2] {
        for j in 0..=steps[1] {
            for i in 0..=steps[0] {
                let index = [i, j, k];
                out.push(Point3::from([0, 1, 2].map(|a| {
                    let border = index[a] == 0 || index[a] == steps[a];
                    // Drawn on the border too: the sequence stays in step with the nodes.
                    let shift = next() * if border { 0.0 } else { jitter };
                    // The far side takes the exact coordinate, so that hull faces are flat.
                    if index[a] == steps[a] {
                        high[a]
                    } else {
                        low[a] + extent[a] * (index[a] as f64 + shift) / steps[a] as f64
                    }
                })));
            }
        }
    }
    Ok(out)
}

/// Returns a repeatable sequence of numbers in (−1, 1).
fn noise(seed: u64) -> impl FnMut() -> f64 {
    // The state must not be zero: xorshift would stay there. The multiplier spreads small seeds over all
    // bits.
    let mut s = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    move || {
        s ^= s << 13;
        s ^= s >> 7;
        s ^= s << 17;
        // 53 bits fill the mantissa; divided by 2^52 they lie in [0, 2).
        (s >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }
}
