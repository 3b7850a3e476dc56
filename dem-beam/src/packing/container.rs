//! The volume that a packing fills: a box, a cylinder, a closed triangle surface, a part of a body, or a
//! periodic box.

use super::around::Around;
use super::surface::Surface;
use crate::error::{Result, positive};
use nalgebra::Vector3;

/// Volume to fill; lengths in m.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum Container {
    /// Box between two corners.
    Box {
        /// Corner with the smallest coordinates.
        min: Vector3<f64>,
        /// Corner with the largest coordinates.
        max: Vector3<f64>,
    },
    /// Round bar along +x from the origin: `0 <= x <= length`, `y^2 + z^2 <= radius^2`.
    Cylinder {
        /// Length \[m\].
        length: f64,
        /// Radius of the section \[m\].
        radius: f64,
    },
    /// The inside of a closed surface.
    Surface(Surface),
    /// A part of a body. The body around it is filled too, but the packing keeps only the part.
    Around(Box<Around>),
    /// A box at the origin that repeats along all axes, as a sample of the bulk without walls.
    Periodic {
        /// Edges \[m\].
        size: Vector3<f64>,
    },
}

impl Container {
    /// Makes a cylinder of length `length` \[m\] and radius `radius` \[m\] along x.
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] unless both are positive.
    pub fn cylinder(length: f64, radius: f64) -> Result<Self> {
        positive("cylinder length", length)?;
        positive("cylinder radius", radius)?;
        Ok(Self::Cylinder { length, radius })
    }

    /// Makes a box from `min` to `max` \[m\].
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] unless every edge is positive.
    pub fn cuboid(min: Vector3<f64>, max: Vector3<f64>) -> Result<Self> {
        for e in (max - min).iter() {
            positive("box edge", *e)?;
        }
        Ok(Self::Box { min, max })
    }

    /// Makes a periodic cube of edge `edge` \[m\].
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] unless the edge is positive.
    pub fn periodic(edge: f64) -> Result<Self> {
        positive("edge of the periodic cube", edge)?;
        Ok(Self::Periodic {
            size: Vector3::repeat(edge),
        })
    }

    /// Edges of the periodic box \[m\]; `None` for other containers.
    #[must_use]
    pub fn period(&self) -> Option<[f64; 3]> {
        match self {
            Self::Periodic { size } => Some([size.x, size.y, size.z]),
            _ => None,
        }
    }

    /// Returns the bodies within: the bodies of a surface ([`Surface::bodies`]), else the container itself.
    #[must_use]
    pub fn bodies(&self) -> Vec<Self> {
        match self {
            Self::Surface(s) => s.bodies().into_iter().map(Self::Surface).collect(),
            Self::Around(a) => a
                .bodies()
                .into_iter()
                .map(|a| Self::Around(Box::new(a)))
                .collect(),
            other => vec![other.clone()],
        }
    }

    /// Returns the volume that is filled \[m³\].
    #[must_use]
    pub fn volume(&self) -> f64 {
        match self {
            Self::Box { min, max } => (max - min).product(),
            Self::Cylinder { length, radius } => std::f64::consts::PI * radius * radius * length,
            Self::Surface(s) => s.volume(),
            Self::Around(a) => a.volume(),
            Self::Periodic { size } => size.product(),
        }
    }

    /// Returns the smallest and the largest corner of the axis-parallel bounding box \[m\].
    #[must_use]
    pub fn bounds(&self) -> (Vector3<f64>, Vector3<f64>) {
        match self {
            Self::Box { min, max } => (*min, *max),
            Self::Cylinder { length, radius } => (
                Vector3::new(0.0, -radius, -radius),
                Vector3::new(*length, *radius, *radius),
            ),
            Self::Surface(s) => s.bounds(),
            Self::Around(a) => a.bounds(),
            Self::Periodic { size } => (Vector3::zeros(), *size),
        }
    }

    /// Calls `wall(gap, inward normal)` for each wall nearer than `reach` to `x`; a negative gap means
    /// outside. A surface reports its nearest point and, in edges, the other faces near `x`.
    #[inline]
    pub fn walls(&self, x: &Vector3<f64>, reach: f64, mut wall: impl FnMut(f64, Vector3<f64>)) {
        match self {
            Self::Box { min, max } => {
                for a in 0..3 {
                    let mut n = Vector3::zeros();
                    if x[a] - min[a] < reach {
                        n[a] = 1.0;
                        wall(x[a] - min[a], n);
                    }
                    if max[a] - x[a] < reach {
                        n[a] = -1.0;
                        wall(max[a] - x[a], n);
                    }
                }
            }
            Self::Cylinder { length, radius } => {
                if x.x < reach {
                    wall(x.x, Vector3::x());
                }
                if length - x.x < reach {
                    wall(length - x.x, -Vector3::x());
                }
                let rr = x.y * x.y + x.z * x.z;
                // Squares first: the root is taken for the few spheres near the mantle.
                let safe = (radius - reach).max(0.0);
                if rr > safe * safe {
                    let r = rr.sqrt();
                    wall(radius - r, Vector3::new(0.0, -x.y / r, -x.z / r));
                }
            }
            Self::Surface(s) => s.walls(x, reach, wall),
            Self::Around(a) => a.walls(x, reach, wall),
            Self::Periodic { .. } => {}
        }
    }

    /// Returns the distance \[m\] to the nearest wall within `reach`, else `reach`; negative outside.
    #[must_use]
    pub fn gap(&self, x: &Vector3<f64>, reach: f64) -> f64 {
        let mut g = reach;
        self.walls(x, reach, |d, _| g = g.min(d));
        g
    }

    /// Returns whether `x` is inside.
    #[must_use]
    pub fn contains(&self, x: &Vector3<f64>) -> bool {
        match self {
            Self::Surface(s) => s.contains(x),
            Self::Around(a) => a.contains(x),
            // With no reach, only walls that `x` has passed report a gap.
            _ => self.gap(x, 0.0) >= 0.0,
        }
    }

    /// Prepares queries of walls up to `reach` \[m\]; only surfaces need it.
    pub(crate) fn prepare(&mut self, reach: f64) {
        match self {
            Self::Surface(s) => s.prepare(reach),
            Self::Around(a) => a.prepare(reach),
            Self::Box { .. } | Self::Cylinder { .. } | Self::Periodic { .. } => {}
        }
    }

    /// Appends numbers that identify the container in the cache.
    pub(crate) fn identity(&self, out: &mut Vec<f64>) {
        match self {
            Self::Box { min, max } => {
                out.push(1.0);
                out.extend(min.iter().chain(max.iter()));
            }
            Self::Cylinder { length, radius } => out.extend([2.0, *length, *radius]),
            Self::Surface(s) => {
                out.push(3.0);
                s.identity(out);
            }
            Self::Around(a) => {
                out.push(5.0);
                a.identity(out);
            }
            Self::Periodic { size } => {
                out.push(4.0);
                out.extend(size.iter());
            }
        }
    }
}
