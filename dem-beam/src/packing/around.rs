//! A part of a larger body, packed with a margin of the body around it and cut off at its border.
//!
//! A border within a body is no wall. If the part were packed alone, spheres at the border would have few
//! neighbours. The spheres inside would then get more bonds than in the bulk, because bonds are counted over
//! all spheres, and more mass. The body around the part is therefore filled as well, up to a margin, and the
//! spheres in the part are kept.

use super::surface::{Listed, Listing, Mover, Surface};
use crate::error::{Result, positive};
use nalgebra::Vector3;
use rayon::prelude::*;

/// Grid points along every axis for the volume of the margin.
const COUNTED: usize = 48;

/// A part of a body, and the margin of the body around it that is filled as well.
#[derive(Debug, Clone)]
pub struct Around {
    part: Surface,
    body: Surface,
    /// Faces of the part that lie within the body.
    border: Surface,
    margin: f64,
    volume: f64,
}

impl Around {
    /// Makes the container for the inside of `part`, which lies in `body`. The surface `body` need only be
    /// complete up to the margin \[m\] around the part. `border` are the faces of the part that lie within
    /// the body, counter-clockwise from outside of the part.
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] for a margin that is not positive.
    pub fn new(part: Surface, body: Surface, border: &[[Vector3<f64>; 3]], margin: f64) -> Result<Self> {
        positive("margin around a part of a body", margin)?;
        let mut out = Self {
            part,
            body,
            border: Surface::open(border, 1.2 * margin),
            margin,
            volume: 0.0,
        };
        out.volume = out.part.volume() + out.margin_volume();
        Ok(out)
    }

    /// Surface of the part.
    #[must_use]
    pub fn part(&self) -> &Surface {
        &self.part
    }

    /// Volume of the part and the margin \[m³\].
    #[must_use]
    pub fn volume(&self) -> f64 {
        self.volume
    }

    /// Returns the volume of the margin \[m³\], by counting points of a grid.
    fn margin_volume(&self) -> f64 {
        let (low, high) = self.bounds();
        let step = (high - low) / COUNTED as f64;
        let centre = |k: usize| {
            // Middles of equal cells, so that each point stands for the same volume.
            let place = [k / (COUNTED * COUNTED), k / COUNTED % COUNTED, k % COUNTED];
            low + Vector3::from(place.map(|i| i as f64 + 0.5)).component_mul(&step)
        };
        let is_in_margin = |x: &Vector3<f64>| {
            let distance = self.distance_from_part(x);
            distance > 0.0 && distance <= self.margin && self.body.contains(x)
        };
        let centres = (0..COUNTED.pow(3)).into_par_iter().map(centre);
        let count = centres.filter(is_in_margin).count();
        step.product() * count as f64
    }

    /// Returns the distance from the part \[m\]: zero inside, infinite where the border is farther than the
    /// margin.
    fn distance_from_part(&self, x: &Vector3<f64>) -> f64 {
        match self.border.nearest(x, self.margin) {
            Some((gap, _)) => (-gap).max(0.0),
            // Farther from the border than the margin: only the inside of the part tells both cases apart.
            None if self.part.contains(x) => 0.0,
            None => f64::INFINITY,
        }
    }

    pub(crate) fn bounds(&self) -> (Vector3<f64>, Vector3<f64>) {
        let (low, high) = self.part.bounds();
        let (least, most) = self.body.bounds();
        (
            low.add_scalar(-self.margin).sup(&least),
            high.add_scalar(self.margin).inf(&most),
        )
    }

    pub(crate) fn contains(&self, x: &Vector3<f64>) -> bool {
        self.distance_from_part(x) <= self.margin && self.body.contains(x)
    }

    /// Calls `wall` for the body's surface and for the end of the margin. The latter has the same distance
    /// from the part everywhere, so it has no corners.
    #[inline]
    pub(crate) fn walls(&self, x: &Vector3<f64>, reach: f64, mut wall: impl FnMut(f64, Vector3<f64>)) {
        self.body.walls(x, reach, &mut wall);
        self.end_of_margin(self.border.nearest(x, self.margin + reach), reach, wall);
    }

    /// Calls `wall` for the end of the margin, if it is nearer than `reach`; `border` is the signed distance
    /// from the border and its normal.
    #[inline]
    fn end_of_margin(
        &self,
        border: Option<(f64, Vector3<f64>)>,
        reach: f64,
        mut wall: impl FnMut(f64, Vector3<f64>),
    ) {
        if let Some((gap, n)) = border
            // Inside the part, where the gap is not negative, the end is farther than the margin.
            && gap < 0.0
            && self.margin + gap < reach
        {
            wall(self.margin + gap, n);
        }
    }

    /// Lists the triangles of the body and of the border for [`Self::walls`] of a moving sphere.
    pub(crate) fn list_walls(&self, mover: &Mover, list: &mut Vec<(f64, u32)>) -> [Listing; 2] {
        [
            self.body.list_walls(mover, list),
            self.border.list_margin(mover, self.margin, list),
        ]
    }

    /// Does what [`Self::walls`] does, with listed triangles of the body and of the border; `None` if neither
    /// matters.
    #[inline]
    pub(crate) fn walls_listed(
        &self,
        x: &Vector3<f64>,
        reach: f64,
        ([body, border], list): (&[Option<Listed>; 2], &[(f64, u32)]),
        mut wall: impl FnMut(f64, Vector3<f64>),
    ) {
        if let Some(body) = body {
            self.body.walls_listed(x, reach, (body, list), &mut wall);
        }
        if let Some(border) = border {
            let nearest = self.border.nearest_listed(x, self.margin + reach, (border, list));
            self.end_of_margin(nearest, reach, wall);
        }
    }

    /// Returns one container per body within, except bodies that the margin does not reach.
    pub(crate) fn bodies(&self) -> Vec<Self> {
        let bodies = self.body.bodies();
        if bodies.len() == 1 {
            return vec![self.clone()];
        }
        let parts = self.part.bodies();
        let restricted = |body: Surface| {
            let mut out = Self { body, ..self.clone() };
            // A part lies in one body or in another, so one of its corners decides.
            let is_in_body = |p: &&Surface| p.vertices().iter().any(|x| out.body.contains(x));
            out.volume =
                out.margin_volume() + parts.iter().filter(is_in_body).map(Surface::volume).sum::<f64>();
            out
        };
        bodies
            .into_iter()
            .map(restricted)
            .filter(|b| b.volume > 0.0)
            .collect()
    }

    pub(crate) fn prepare(&mut self, reach: f64) {
        self.body.prepare(reach);
        self.border.prepare(self.margin + reach);
    }

    pub(crate) fn identity(&self, out: &mut Vec<f64>) {
        self.part.identity(out);
        self.body.identity(out);
        out.push(self.margin);
    }
}
