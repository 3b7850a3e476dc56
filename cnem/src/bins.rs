//! Uniform bins over axis-aligned boxes: finds the boxes that overlap a given one.

use nalgebra::Point3;

/// An axis-aligned box: lower and upper corner.
pub(crate) type Aabb = [Point3<f64>; 2];

/// Returns the smallest box around some points, grown by `margin`.
pub(crate) fn around<'a>(points: impl IntoIterator<Item = &'a Point3<f64>>, margin: f64) -> Aabb {
    let mut low = Point3::from([f64::INFINITY; 3]);
    let mut high = Point3::from([f64::NEG_INFINITY; 3]);
    for p in points {
        for k in 0..3 {
            low[k] = low[k].min(p[k] - margin);
            high[k] = high[k].max(p[k] + margin);
        }
    }
    [low, high]
}

fn overlap(a: &Aabb, b: &Aabb) -> bool {
    (0..3).all(|k| a[0][k] <= b[1][k] && b[0][k] <= a[1][k])
}

/// Bins of box indices in compressed storage: the indices of bin `i` are `items[start[i]..start[i + 1]]`.
#[derive(Debug, Clone)]
pub(crate) struct Bins {
    boxes: Vec<Aabb>,
    low: Point3<f64>,
    inverse: [f64; 3],
    counts: [usize; 3],
    start: Vec<u32>,
    items: Vec<u32>,
}

impl Bins {
    /// Sorts boxes into bins, about as many bins as boxes.
    pub(crate) fn new(boxes: Vec<Aabb>) -> Self {
        let corners = boxes.iter().flat_map(|b| b.iter());
        let bounds = if boxes.is_empty() {
            [Point3::origin(); 2]
        } else {
            around(corners, 0.0)
        };
        let extent = bounds[1] - bounds[0];
        let longest = extent.max().max(f64::MIN_POSITIVE);
        // Flat sets have no volume: at least a thousandth of the longest extent keeps the bin size positive.
        let filled: f64 = extent.iter().map(|e| (e / longest).max(1e-3)).product();
        // One box per bin on average: a query then looks at a number of boxes that does not grow with the
        // set.
        let size = longest * (filled / boxes.len().max(1) as f64).cbrt();
        // At most 2^24 bins in all, whatever the boxes.
        let counts = [0, 1, 2].map(|k| ((extent[k] / size).ceil() as usize).clamp(1, 256));
        let inverse = [0, 1, 2].map(|k| {
            // An axis without extent has a single bin; dividing by its extent would not be finite.
            if extent[k] > 0.0 {
                counts[k] as f64 / extent[k]
            } else {
                0.0
            }
        });
        let bins = counts.iter().product::<usize>();
        let mut out = Self {
            boxes: Vec::new(),
            low: bounds[0],
            inverse,
            counts,
            start: vec![0; bins + 1],
            items: vec![],
        };
        let mut pairs: Vec<(u32, u32)> = Vec::new();
        for (i, b) in boxes.iter().enumerate() {
            out.visit(b, |bin| pairs.push((bin as u32, i as u32)));
        }
        // Sorted pairs keep the boxes of a bin in ascending order, and a box that spans bins is entered in
        // each.
        pairs.sort_unstable();
        pairs.iter().for_each(|p| out.start[p.0 as usize + 1] += 1);
        (0..bins).for_each(|i| out.start[i + 1] += out.start[i]);
        out.items = pairs.into_iter().map(|p| p.1).collect();
        out.boxes = boxes;
        out
    }

    fn visit(&self, b: &Aabb, mut f: impl FnMut(usize)) {
        let index = |p: &Point3<f64>, k: usize| {
            // Boxes outside of the bounds count for the border bins: a query may reach beyond the set.
            (((p[k] - self.low[k]) * self.inverse[k]).max(0.0) as usize).min(self.counts[k] - 1)
        };
        for i in index(&b[0], 0)..=index(&b[1], 0) {
            for j in index(&b[0], 1)..=index(&b[1], 1) {
                for k in index(&b[0], 2)..=index(&b[1], 2) {
                    f((i * self.counts[1] + j) * self.counts[2] + k);
                }
            }
        }
    }

    /// Writes the indices of the boxes that overlap `query` to `out`, sorted.
    pub(crate) fn overlapping(&self, query: &Aabb, out: &mut Vec<u32>) {
        out.clear();
        self.visit(query, |bin| {
            for &i in &self.items[self.start[bin] as usize..self.start[bin + 1] as usize] {
                if overlap(&self.boxes[i as usize], query) {
                    out.push(i);
                }
            }
        });
        // A box that spans several bins was found once in each of them.
        out.sort_unstable();
        out.dedup();
    }

    /// Returns whether any box overlaps `query`.
    pub(crate) fn overlaps_any(&self, query: &Aabb) -> bool {
        let mut hit = false;
        self.visit(query, |bin| {
            let range = self.start[bin] as usize..self.start[bin + 1] as usize;
            hit = hit
                || self.items[range]
                    .iter()
                    .any(|&i| overlap(&self.boxes[i as usize], query));
        });
        hit
    }
}
