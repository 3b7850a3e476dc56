//! Order of insertion: biased random rounds, each along a Hilbert curve.
//!
//! Random rounds, each eight times as large as the one before, keep the expected work of incremental
//! insertion near-linear for any input. The curve inside a round keeps consecutive points close, so that
//! walks are short and memory accesses local.

use nalgebra::Point3;

/// Bits of a Hilbert key per axis.
const BITS: u32 = 16;
/// Number of points below which no further random round is split off.
const FIRST_ROUND: usize = 256;

/// Returns the order of insertion of `points`: a permutation of their indices, always the same for the same
/// input.
pub(crate) fn insertion_order(points: &[Point3<f64>]) -> Vec<u32> {
    let (low, scale) = frame(points);
    let rounds = round_count(points.len());
    let mut keyed: Vec<(u64, u32)> = points
        .iter()
        .enumerate()
        .map(|(i, p)| {
            let axis = |k: usize| ((p[k] - low[k]) * scale) as u32;
            let round = u64::from(round_of(i as u64, rounds));
            // The round in the high bits: rounds come first, the curve orders points within a round.
            ((round << 56) | key([axis(0), axis(1), axis(2)]), i as u32)
        })
        .collect();
    // The index at the end of the pair breaks ties of the key: the order is the same in every run.
    keyed.sort_unstable();
    keyed.into_iter().map(|(_, i)| i).collect()
}

/// Returns the order of points along the Hilbert curve: a permutation of their indices.
///
/// Nodes that are close in space should be close in memory: with nodes in a random order the internal forces
/// of a model wait for memory. Number nodes in this order before creating the domain, and translate surfaces
/// with [`crate::constraint::Surface::renumbered`]. The node sets of [`crate::generate`] are already in a
/// good order.
///
/// ```
/// use nalgebra::Point3;
/// let points = [[0.0, 0.0, 0.0], [9.0, 0.0, 0.0], [1.0, 0.0, 0.0]].map(Point3::from);
/// assert_eq!(cnem::spatial_order(&points), [0, 2, 1]);
/// ```
pub fn spatial_order(points: &[Point3<f64>]) -> Vec<usize> {
    let (low, scale) = frame(points);
    let mut keyed: Vec<(u64, usize)> = points
        .iter()
        .enumerate()
        .map(|(i, p)| (key([0, 1, 2].map(|k| ((p[k] - low[k]) * scale) as u32)), i))
        .collect();
    keyed.sort_unstable();
    keyed.into_iter().map(|(_, i)| i).collect()
}

/// Returns the lower corner of the bounding box, and the factor from coordinates to key units.
fn frame(points: &[Point3<f64>]) -> ([f64; 3], f64) {
    let mut low = [f64::INFINITY; 3];
    let mut high = [f64::NEG_INFINITY; 3];
    for p in points {
        for k in 0..3 {
            low[k] = low[k].min(p[k]);
            high[k] = high[k].max(p[k]);
        }
    }
    let extent = (0..3).map(|k| high[k] - low[k]).fold(0.0, f64::max);
    let top = f64::from((1_u32 << BITS) - 1);
    // One factor for all axes: a curve stretched along an axis would no longer keep neighbours together.
    (low, if extent > 0.0 { top / extent } else { 0.0 })
}

fn round_count(points: usize) -> u32 {
    let mut rounds = 1;
    let mut n = points;
    while n > FIRST_ROUND {
        // Seven eighths of the points fall into the last round, so each further round is for an eighth of
        // them.
        n /= 8;
        rounds += 1;
    }
    rounds
}

/// Returns the round of point `i`: the last with probability 7/8, the one before with 7/64, and so on.
fn round_of(i: u64, rounds: u32) -> u32 {
    // A hash of the index (splitmix64) in place of random numbers: the same order in every run.
    let mut h = i.wrapping_add(0x9e37_79b9_7f4a_7c15);
    h = (h ^ (h >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    h = (h ^ (h >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    h ^= h >> 31;
    // Three trailing zero bits have the probability 1/8.
    let earlier = h.trailing_zeros() / 3;
    (rounds - 1).saturating_sub(earlier)
}

/// Returns the position on the 3D Hilbert curve (Skilling's transform).
fn key(mut x: [u32; 3]) -> u64 {
    // First the turns of the octants are undone, from the largest octant down; then the Gray code is built.
    let mut q = 1_u32 << (BITS - 1);
    while q > 1 {
        let p = q - 1;
        for i in 0..3 {
            if x[i] & q != 0 {
                x[0] ^= p;
            } else {
                let t = (x[0] ^ x[i]) & p;
                x[0] ^= t;
                x[i] ^= t;
            }
        }
        q >>= 1;
    }
    x[1] ^= x[0];
    x[2] ^= x[1];
    let mut t = 0;
    let mut q = 1_u32 << (BITS - 1);
    while q > 1 {
        if x[2] & q != 0 {
            t ^= q - 1;
        }
        q >>= 1;
    }
    let mut out = 0_u64;
    // Bits of the three axes alternate: the key is one integer whose order is that of the curve.
    for bit in (0..BITS).rev() {
        for v in x {
            out = (out << 1) | u64::from(((v ^ t) >> bit) & 1);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_on_the_curve_are_neighbours_in_space() {
        let mut cells: Vec<(u64, [u32; 3])> = Vec::new();
        for i in 0..8 {
            for j in 0..8 {
                for k in 0..8 {
                    let x = [i, j, k].map(|v| v << (BITS - 3));
                    cells.push((key(x) >> (3 * (BITS - 3)), [i, j, k]));
                }
            }
        }
        cells.sort_unstable();
        for (n, pair) in cells.windows(2).enumerate() {
            assert_eq!(pair[0].0, n as u64);
            let step: u32 = (0..3).map(|k| pair[0].1[k].abs_diff(pair[1].1[k])).sum();
            assert_eq!(step, 1);
        }
    }

    #[test]
    fn order_is_a_permutation() {
        let points: Vec<_> = (0..3000)
            .map(|i| Point3::new(f64::from(i % 7), f64::from(i % 11), 0.0))
            .collect();
        let mut order = insertion_order(&points);
        order.sort_unstable();
        assert!(order.iter().enumerate().all(|(i, &v)| i == v as usize));
    }
}
