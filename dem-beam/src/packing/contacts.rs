//! Contact forces of soft spheres.

use super::cells::{ListChunk, Sphere};
use std::ops::Range;

/// Number of pairs whose forces are computed at once: they stay in the fastest cache.
const BLOCK: usize = 256;

/// Overlaps of touching pairs: their sum \[m\] and their number.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Overlaps {
    pub(crate) sum: f64,
    pub(crate) count: u64,
}

/// Job that computes the contact forces on consecutive spheres. `image` turns a difference of centres into
/// that to the nearest periodic image.
///
/// The pairs of a block are treated in three passes: differences, factors (in vectors of several pairs, also
/// for pairs that do not touch, whose factor is zero), sums in the order of the list. Nothing branches on
/// contact, which the processor would often predict wrongly.
pub(crate) struct Contacts<'a, F> {
    pub(crate) spheres: &'a [Sphere],
    pub(crate) first: usize,
    pub(crate) list: &'a ListChunk,
    pub(crate) image: F,
    /// Force on each sphere of the chunk \[m\]; the last entry is zero.
    pub(crate) force: &'a mut [[f64; 4]],
    pub(crate) overlaps: &'a mut Overlaps,
}

impl<F: Fn([f64; 4]) -> [f64; 4]> pulp::NullaryFnOnce for Contacts<'_, F> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let (list, spheres, force) = (self.list, self.spheres, self.force);
        // Difference of the centres; minus the sum of the radii.
        let mut between = [[0.0; 4]; BLOCK];
        let (mut factor, mut overlap) = ([0.0; BLOCK], [0.0; BLOCK]);
        let (mut sum, mut count) = (0.0, 0);
        force.fill([0.0; 4]);
        let mut row = 0;
        for from in (0..list.neighbours.len()).step_by(BLOCK) {
            let pairs = from..list.neighbours.len().min(from + BLOCK);
            let first_row = row;
            row = for_each_row(&list.start, first_row, &pairs, |i, part| {
                let s = spheres[self.first + i];
                let neighbours = &list.neighbours[part.clone()];
                let out = &mut between[part.start - from..part.end - from];
                for (d, &j) in out.iter_mut().zip(neighbours) {
                    let t = spheres[j as usize];
                    *d = (self.image)([s[0] - t[0], s[1] - t[1], s[2] - t[2], -s[3] - t[3]]);
                }
            });
            count += factors(&between[..pairs.len()], &mut factor, &mut overlap);
            for_each_row(&list.start, first_row, &pairs, |i, part| {
                let part = part.start - from..part.end - from;
                let terms = between[part.clone()].iter().zip(&factor[part.clone()]);
                let mut f = force[i];
                for ((d, c), overlap) in terms.zip(&overlap[part]) {
                    (0..4).for_each(|a| f[a] += c * d[a]);
                    sum += overlap;
                }
                force[i] = f;
            });
        }
        force.iter_mut().for_each(|f| f[3] = 0.0);
        *self.overlaps = Overlaps { sum, count };
    }
}

/// Computes for each pair the factor of the difference of the centres in the force, and the overlap \[m\];
/// both are zero for pairs apart. Returns the number of touching pairs.
#[inline(always)]
fn factors(between: &[[f64; 4]], factor: &mut [f64; BLOCK], overlap: &mut [f64; BLOCK]) -> u64 {
    let mut count = 0;
    for ((d, factor), overlap) in between.iter().zip(factor).zip(overlap) {
        let dd = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
        let touch = -d[3];
        let distance = dd.sqrt();
        // The bound avoids a division by zero for coincident centres.
        let least = 1e-9 * touch;
        let depth = touch - distance;
        let c = depth / if distance > least { distance } else { least };
        let touches = dd < touch * touch;
        *factor = if touches { c } else { 0.0 };
        *overlap = if touches { depth } else { 0.0 };
        count += u64::from(touches);
    }
    count
}

/// Calls `visit` for the part of each row, from `row` on, that lies in the range `pairs`; returns the row in
/// which the next range begins.
#[inline(always)]
fn for_each_row(
    start: &[u32],
    mut row: usize,
    pairs: &Range<usize>,
    mut visit: impl FnMut(usize, Range<usize>),
) -> usize {
    let mut next = pairs.start;
    while next < pairs.end {
        let end = start[row + 1] as usize;
        visit(row, next..end.min(pairs.end));
        next = end.min(pairs.end);
        row += usize::from(next == end);
    }
    row
}
