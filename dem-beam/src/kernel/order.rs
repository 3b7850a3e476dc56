//! Numbering of particles for memory locality.

use nalgebra::Vector3;

/// Morton key of a point in a box, with 21 bits per axis.
pub(crate) fn morton_key(x: &Vector3<f64>, low: &Vector3<f64>, high: &Vector3<f64>) -> u64 {
    // All axes have the same scale, so that the cells of the curve are cubes.
    let extent = (high - low).max().max(f64::MIN_POSITIVE);
    // Puts two zero bits between neighbouring bits of the integer, so that three axes fit into one key.
    let spread = |v: f64| {
        let t = (v / extent * 2_097_151.0).clamp(0.0, 2_097_151.0);
        let mut k = t as u64;
        k = (k | (k << 32)) & 0x001f_0000_0000_ffff;
        k = (k | (k << 16)) & 0x001f_0000_ff00_00ff;
        k = (k | (k << 8)) & 0x100f_00f0_0f00_f00f;
        k = (k | (k << 4)) & 0x10c3_0c30_c30c_30c3;
        (k | (k << 2)) & 0x1249_2492_4924_9249
    };
    let d = x - low;
    spread(d.x) | (spread(d.y) << 1) | (spread(d.z) << 2)
}

/// Particles per window inside which the number of bonds decides the order: small enough to stay in cache.
const WINDOW: usize = 256;

/// Returns the order of particles for the block kernel: entry k is the particle at place k.
///
/// The order follows a Morton curve, and inside short windows the number of bonds.
#[must_use]
pub fn block_order(positions: &[Vector3<f64>], pairs: &[[u32; 2]]) -> Vec<u32> {
    let low = positions
        .iter()
        .fold(Vector3::repeat(f64::INFINITY), |m, p| m.inf(p));
    let high = positions
        .iter()
        .fold(Vector3::repeat(f64::NEG_INFINITY), |m, p| m.sup(p));
    let mut degree = vec![0_u32; positions.len()];
    for e in pairs.iter().flatten() {
        degree[*e as usize] += 1;
    }
    let mut order: Vec<u32> = (0..positions.len() as u32).collect();
    order.sort_by_cached_key(|&i| morton_key(&positions[i as usize], &low, &high));
    for window in order.chunks_mut(WINDOW) {
        // The eight particles of a block then have about equally many bonds, and few lanes stay empty. The
        // sort is stable: particles with equally many bonds keep the order of the curve.
        window.sort_by_key(|&i| degree[i as usize]);
    }
    order
}
