//! Removal of round-off from partition of unity and linear precision.

use nalgebra::{Matrix3, Matrix4, Vector2, Vector3, Vector4};

/// Largest linear residual, relative to the neighbourhood's size, that counts as round-off of the
/// construction; rows with a larger one are refused.
pub(super) const LARGEST: f64 = 1e-4;
/// Largest gradient times the size of the neighbourhood that is accepted. Beside nodes that lie on a line to
/// ten digits, gradients across the line are determined by the last digits alone.
const STEEP: f64 = 1e6;
/// Residual that is left uncorrected.
const SMALLEST: f64 = 5e-14;

fn basis(r: &Vector3<f64>, size: f64) -> Vector4<f64> {
    Vector4::new(1.0, r.x / size, r.y / size, r.z / size)
}

/// Cholesky factor of `sum phi_i p_i p_i^T`, scaled to a unit diagonal.
struct Moments {
    scale: Vector4<f64>,
    factor: nalgebra::Cholesky<f64, nalgebra::U4>,
}

impl Moments {
    fn new(values: impl Iterator<Item = f64>, rel: &[Vector3<f64>], size: f64) -> Option<Self> {
        let mut m = Matrix4::zeros();
        for (w, r) in values.zip(rel) {
            let p = basis(r, size);
            m += p * p.transpose() * w;
        }
        // Close to a plane the moments across it are tiny; a unit diagonal keeps the factorisation stable.
        let scale = m.diagonal().map(|d| if d > 0.0 { 1.0 / d.sqrt() } else { 0.0 });
        let scaled = Matrix4::from_fn(|i, j| m[(i, j)] * scale[i] * scale[j]);
        Some(Self {
            scale,
            factor: scaled.cholesky()?,
        })
    }

    fn solve(&self, b: &Vector4<f64>) -> Vector4<f64> {
        self.factor
            .solve(&b.component_mul(&self.scale))
            .component_mul(&self.scale)
    }
}

/// Returns the residuals of `sum phi = 1` and `sum phi (n_i - x) / size = 0`, and the largest of them.
pub(super) fn residual(values: &[f64], rel: &[Vector3<f64>], size: f64) -> (f64, Vector4<f64>) {
    let mut r = Vector4::new(1.0, 0.0, 0.0, 0.0);
    for (w, p) in values.iter().zip(rel) {
        r -= basis(p, size) * *w;
    }
    (r.amax(), r)
}

/// Removes the residual by the smallest change relative to the weights. Returns the residual before the
/// correction, or `None` if the row is not usable.
pub(super) fn values(values: &mut [f64], rel: &[Vector3<f64>], size: f64) -> Option<f64> {
    let (initial, mut r) = residual(values, rel, size);
    // A large residual is no round-off: the cavity was wrong, and a correction would hide it.
    if r.iter().any(|x| x.is_nan()) || initial > LARGEST {
        return None;
    }
    if initial <= SMALLEST {
        return Some(initial);
    }
    for _ in 0..3 {
        let Some(moments) = Moments::new(values.iter().copied(), rel, size) else {
            // Nodes in one plane to all digits have no moments across it; a row that is good enough needs
            // none.
            return (initial <= 1e-12).then_some(initial);
        };
        let c = moments.solve(&r);
        for (w, p) in values.iter_mut().zip(rel) {
            // A change in proportion to the weight: what is zero stays zero, and the signs stay.
            *w *= 1.0 + basis(p, size).dot(&c);
        }
        let remaining = residual(values, rel, size);
        if remaining.0 <= SMALLEST {
            break;
        }
        r = remaining.1;
    }
    // Linear precision to 1e-12 of the neighbourhood's size is what every row promises.
    let usable = values.iter().all(|w| *w >= 0.0) && residual(values, rel, size).0 <= 1e-12;
    usable.then_some(initial)
}

/// Removes the residual of the gradients: `sum grad = 0`, `sum (n_i - x) (x) grad = I`. Returns false if the
/// gradients are not usable.
pub(super) fn gradients(
    values: &[f64],
    slopes: &mut [Vector3<f64>],
    rel: &[Vector3<f64>],
    size: f64,
) -> bool {
    // The change involves all neighbours: next to a plane, the nodes on it have all of the weight but no part
    // in the slope across the plane.
    let even = 1.0 / values.len() as f64;
    let Some(moments) = Moments::new(values.iter().map(|w| w + even), rel, size) else {
        return false;
    };
    let mut remaining = f64::INFINITY;
    for pass in 0..4 {
        let mut worst = 0.0_f64;
        for d in 0..3 {
            let mut target = Vector4::zeros();
            target[d + 1] = 1.0 / size;
            for (g, p) in slopes.iter().zip(rel) {
                target -= basis(p, size) * g[d];
            }
            let defect = target.amax() * size;
            // A NaN becomes the worst residual, too.
            worst = if defect <= worst { worst } else { defect };
            if defect > SMALLEST {
                let c = moments.solve(&target);
                for ((g, p), w) in slopes.iter_mut().zip(rel).zip(values) {
                    g[d] += (w + even) * basis(p, size).dot(&c);
                }
            }
        }
        // After the first pass a residual this large is no round-off. Later passes only remove what is left.
        if worst.is_nan() || (pass == 0 && worst > LARGEST) {
            return false;
        }
        remaining = worst;
        if worst <= SMALLEST {
            break;
        }
    }
    remaining <= 1e-12 && slopes.iter().all(|g| g.norm() * size <= STEEP)
}

/// Like [`values`], for weights on a plane. Returns whether the weights are usable.
pub(super) fn planar(weights: &mut [f64], rel: &[Vector2<f64>], size: f64) -> bool {
    let basis = |r: &Vector2<f64>| Vector3::new(1.0, r.x / size, r.y / size);
    let remaining = |weights: &[f64]| {
        weights
            .iter()
            .zip(rel)
            .fold(Vector3::new(1.0, 0.0, 0.0), |r, (w, p)| r - basis(p) * *w)
    };
    for _ in 0..3 {
        let r = remaining(weights);
        if r.iter().any(|x| x.is_nan()) || r.amax() > LARGEST {
            return false;
        }
        if r.amax() <= SMALLEST {
            break;
        }
        let m = weights.iter().zip(rel).fold(Matrix3::zeros(), |m, (w, p)| {
            m + basis(p) * basis(p).transpose() * *w
        });
        let scale = m
            .diagonal()
            .map(|d: f64| if d > 0.0 { 1.0 / d.sqrt() } else { 0.0 });
        let scaled = Matrix3::from_fn(|i, j| m[(i, j)] * scale[i] * scale[j]);
        // A line of nodes has no moments across it: what is left is judged at the end.
        let Some(factor) = scaled.cholesky() else { break };
        let c = factor.solve(&r.component_mul(&scale)).component_mul(&scale);
        for (w, p) in weights.iter_mut().zip(rel) {
            *w *= 1.0 + basis(p).dot(&c);
        }
    }
    weights.iter().all(|w| *w >= 0.0) && remaining(weights).amax() <= 1e-12
}
