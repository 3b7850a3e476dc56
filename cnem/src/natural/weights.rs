//! Weights of the natural neighbours, from the dual of a star-shaped cavity.
//!
//! Every face of the cavity and of the star of the point has a dual segment between two circumcentres. The
//! segments around an edge bound a Voronoi polygon, so that areas and volumes are sums over segments in any
//! order. The volume taken from node `i` is the sum of the pyramids from `n_i` over its polygons inside the
//! cell of the point, minus the pyramid over the facet between node and point. Both ends of an edge have the
//! same pyramid.

use super::cavity::{Border, Cavity, Inner, Ridge};
use super::{Interpolant, polish};
use arlequin_core::ShapeRow;
use nalgebra::Vector3;

/// Weights between this value and zero count as round-off and are set to zero.
const NEGATIVE: f64 = -1e-9;

/// Sums for each neighbour, by local number.
#[derive(Debug, Clone, Default)]
pub(super) struct Weights {
    /// Facet area over distance \[m\].
    alpha: Vec<f64>,
    /// Volume taken from the neighbour \[m³\] (Sibson).
    volume: Vec<f64>,
    /// Gradient of alpha (Laplace), or first moment of the facet (Sibson).
    vector: Vec<Vector3<f64>>,
}

impl Weights {
    /// Fills the row. Returns the linear residual that was removed, or `None` if the weights are not usable.
    pub(super) fn fill(
        &mut self,
        kind: Interpolant,
        cavity: &Cavity,
        row: &mut ShapeRow<f64>,
        slopes: bool,
    ) -> Option<f64> {
        self.gather(kind, cavity, slopes);
        let weight = if kind == Interpolant::Laplace {
            &self.alpha
        } else {
            &self.volume
        };
        let total: f64 = weight.iter().sum();
        for (&node, &w) in cavity.nodes.iter().zip(weight) {
            let value = w / total;
            if value.is_nan() || value < NEGATIVE {
                return None;
            }
            row.push(node as usize, value.max(0.0));
        }
        let size = cavity
            .rel
            // The farthest neighbour sets the scale to which residuals are relative.
            .iter()
            .map(Vector3::norm_squared)
            .fold(0.0, f64::max)
            .sqrt();
        let residual = polish::values(&mut row.values, &cavity.rel, size)?;
        if slopes {
            self.slopes(kind, cavity, row, total);
            if !polish::gradients(&row.values, &mut row.gradients, &cavity.rel, size) {
                return None;
            }
        }
        Some(residual)
    }

    fn gather(&mut self, kind: Interpolant, cavity: &Cavity, slopes: bool) {
        let count = cavity.nodes.len();
        let reset = |v: &mut Vec<f64>| {
            v.clear();
            v.resize(count, 0.0);
        };
        reset(&mut self.alpha);
        reset(&mut self.volume);
        self.vector.clear();
        self.vector.resize(count, Vector3::zeros());
        for ridge in &cavity.ridges {
            match (kind, slopes) {
                (Interpolant::Laplace, false) => self.facet(cavity, ridge),
                (Interpolant::Laplace, true) => self.facet_gradient(cavity, ridge),
                (Interpolant::Sibson, _) => self.facet_moment(cavity, ridge, slopes),
            }
        }
        // So far twice the area times the distance: halved, and divided by the distance twice.
        for (a, r) in self.alpha.iter_mut().zip(&cavity.rel) {
            *a *= 0.5 / r.norm_squared();
        }
        if kind == Interpolant::Sibson {
            // After the scaling: the pyramids over the facets need the final alpha.
            self.volumes(cavity);
        }
    }

    /// Adds a dual segment to the facets of its two neighbours: twice the area times the distance.
    #[inline]
    fn facet(&mut self, cavity: &Cavity, ridge: &Ridge) {
        let [p, q] = ridge.faces.map(|f| cavity.border[f as usize].centre);
        let cross = q.cross(&p);
        let [a, b] = ridge.ends.map(|v| v as usize);
        // The segment runs the other way round for the second node, hence the sign.
        self.alpha[a] += cross.dot(&cavity.rel[a]);
        self.alpha[b] -= cross.dot(&cavity.rel[b]);
    }

    /// Like `facet`, with the gradient of alpha.
    fn facet_gradient(&mut self, cavity: &Cavity, ridge: &Ridge) {
        self.facet(cavity, ridge);
        let [f, g] = ridge.faces.map(|f| &cavity.border[f as usize]);
        let [mf, mg] = [f, g].map(|b| normal(cavity, b));
        let [a, b] = ridge.ends.map(|v| v as usize);
        // If the point moves by `dx`, the circumcentre of a face moves along the face's dual line by `(g .
        // dx) / det`.
        for (v, sign) in [(a, 0.5), (b, -0.5)] {
            let r = &cavity.rel[v];
            let scale = sign / r.norm_squared();
            self.vector[v] += g.centre * (f.centre.cross(r).dot(&mg) / g.det * scale);
            self.vector[v] -= f.centre * (g.centre.cross(r).dot(&mf) / f.det * scale);
        }
    }

    /// Like `facet`, with triangles from the midpoint between point and neighbour, and the moments of their
    /// centroids.
    #[inline]
    fn facet_moment(&mut self, cavity: &Cavity, ridge: &Ridge, slopes: bool) {
        let [p, q] = ridge.faces.map(|f| cavity.border[f as usize].centre);
        let [a, b] = ridge.ends.map(|v| v as usize);
        for (v, start, end) in [(a, &q, &p), (b, &p, &q)] {
            let r = &cavity.rel[v];
            // The midpoint lies in the plane of the facet, so the triangles do too, and their centroids add
            // up.
            let m = r * 0.5;
            let area = (start - m).cross(&(end - m)).dot(r);
            self.alpha[v] += area;
            if slopes {
                self.vector[v] += (m + start + end) * area;
            }
        }
        let pyramid = (cavity.rel[b] - cavity.rel[a]).dot(&(p - cavity.rel[a]).cross(&(q - p))) / 12.0;
        self.volume[a] += pyramid;
        self.volume[b] += pyramid;
    }

    fn volumes(&mut self, cavity: &Cavity) {
        for Inner { local, members } in &cavity.inner {
            let [p, q] = members.map(|m| &cavity.members[m as usize].centre);
            self.segment(cavity, local, p, q);
        }
        for Border {
            local,
            member,
            centre,
            ..
        } in &cavity.border
        {
            self.segment(cavity, local, &cavity.members[*member as usize].centre, centre);
        }
        for ((v, a), r) in self.volume.iter_mut().zip(&self.alpha).zip(&cavity.rel) {
            *v -= a * r.norm_squared() / 6.0;
        }
    }

    /// Adds the dual segment of a face to the pyramids over the polygons of the face's three edges.
    #[inline]
    fn segment(&mut self, cavity: &Cavity, local: &[u32; 3], p: &Vector3<f64>, q: &Vector3<f64>) {
        let [a, b, c] = local.map(|l| l as usize);
        let w = q - p;
        let [ra, rb, rc] = [a, b, c].map(|v| &cavity.rel[v]);
        for (i, j, ri, rj) in [(a, b, ra, rb), (b, c, rb, rc), (c, a, rc, ra)] {
            // Twelve: a sixth for the pyramid, and half of the vector between the nodes as its height.
            let pyramid = (rj - ri).dot(&(p - ri).cross(&w)) / 12.0;
            self.volume[i] += pyramid;
            self.volume[j] += pyramid;
        }
    }

    fn slopes(&mut self, kind: Interpolant, cavity: &Cavity, row: &mut ShapeRow<f64>, total: f64) {
        for (i, r) in cavity.rel.iter().enumerate() {
            let vector = &mut self.vector[i];
            *vector = match kind {
                Interpolant::Laplace => *vector + r * (self.alpha[i] / r.norm_squared()),
                // alpha * centroid = moment / (2 * distance^2) / 3.
                Interpolant::Sibson => *vector * (0.5 / (3.0 * r.norm_squared())),
            };
        }
        let sum: Vector3<f64> = self.vector.iter().sum();
        for (v, value) in self.vector.iter().zip(&row.values) {
            // The quotient rule for `w / Σw`.
            row.gradients.push((v - sum * *value) / total);
        }
    }
}

/// Returns the outward normal of a border face, with twice the face's area as its length.
fn normal(cavity: &Cavity, face: &Border) -> Vector3<f64> {
    let [a, b, c] = face.local.map(|l| &cavity.rel[l as usize]);
    (b - a).cross(&(c - a))
}
