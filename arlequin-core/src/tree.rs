//! A box tree: finds which of many boxes meet a given one, in logarithmic time.

use crate::Real;
use crate::geometry::bounds_of;
use nalgebra::Point3;

/// A tree over boxes, to find those that meet a given box in logarithmic time.
#[derive(Debug, Clone)]
pub struct BoxTree<T: Real> {
    boxes: Vec<[Point3<T>; 2]>,
    nodes: Vec<TreeNode<T>>,
    order: Vec<u32>,
}

#[derive(Debug, Clone)]
struct TreeNode<T: Real> {
    bounds: [Point3<T>; 2],
    first: u32,
    count: u32,
    right: u32,
}

impl<T: Real> BoxTree<T> {
    const LEAF: usize = 8;

    /// Builds the tree over boxes given by their low and high corners.
    pub fn new(boxes: Vec<[Point3<T>; 2]>) -> Self {
        let mut tree = Self {
            order: (0..boxes.len() as u32).collect(),
            nodes: Vec::new(),
            boxes,
        };
        if !tree.boxes.is_empty() {
            tree.split(0, tree.boxes.len());
        }
        tree
    }

    fn split(&mut self, first: usize, count: usize) {
        let range = first..first + count;
        let bounds = bounds_of(
            self.order[range.clone()]
                .iter()
                .flat_map(|&k| self.boxes[k as usize].iter()),
        );
        let node = self.nodes.len();
        self.nodes.push(TreeNode {
            bounds,
            first: first as u32,
            count: count as u32,
            right: 0,
        });
        if count <= Self::LEAF {
            return;
        }
        // Across the longest side, at the median: leaves stay compact and the tree is balanced for any boxes.
        let axis = (bounds[1] - bounds[0]).imax();
        let half = count / 2;
        let boxes = &self.boxes;
        // Twice the centre; the factor does not change the order.
        let key = |k: &u32| (boxes[*k as usize][0][axis] + boxes[*k as usize][1][axis]).as_f64();
        // Ties by number, so that there is one tree for given boxes.
        self.order[range].select_nth_unstable_by(half, |a, b| key(a).total_cmp(&key(b)).then(a.cmp(b)));
        self.split(first, half);
        self.nodes[node].right = self.nodes.len() as u32;
        self.split(first + half, count - half);
    }

    /// Calls `visit` with the index of every box that meets `query`, until it returns `true`.
    pub fn any(&self, query: &[Point3<T>; 2], visit: &mut dyn FnMut(usize) -> bool) -> bool {
        let meets = |b: &[Point3<T>; 2]| (0..3).all(|k| b[0][k] <= query[1][k] && query[0][k] <= b[1][k]);
        // Halves of at most 2³² boxes are nested 32 deep, and one entry waits at each level.
        let mut stack = [0u32; 64];
        let mut depth = usize::from(!self.nodes.is_empty());
        while depth > 0 {
            depth -= 1;
            let id = stack[depth];
            let node = &self.nodes[id as usize];
            #[cfg(test)]
            tests::LOOKED.with(|n| n.set(n.get() + 1));
            if !meets(&node.bounds) {
                continue;
            }
            // The root is nobody's right child: zero marks a leaf.
            if node.right == 0 {
                for &k in &self.order[node.first as usize..(node.first + node.count) as usize] {
                    if meets(&self.boxes[k as usize]) && visit(k as usize) {
                        return true;
                    }
                }
            } else {
                // The right half waits on the stack while the left one is visited.
                stack[depth] = node.right;
                // The left child follows its parent.
                stack[depth + 1] = id + 1;
                depth += 2;
            }
        }
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;
    use proptest::prelude::*;
    use std::cell::Cell;

    thread_local! {
        /// Nodes of trees that were looked at.
        pub(super) static LOOKED: Cell<usize> = const { Cell::new(0) };
    }

    /// Set-up stays near-linear because of this: eight times as many cells on both sides cost little more a
    /// cell.
    #[test]
    fn cells_that_meet_a_cell_are_found_at_a_cost_that_hardly_grows_with_their_number() {
        let boxes = |n: usize, shift: f64| -> Vec<_> {
            let h = 1.0 / n as f64;
            let at = |k: usize| (k as f64 + shift) * h;
            let low = (0..n * n * n).map(|k| Point3::new(at(k % n), at(k / n % n), at(k / n / n)));
            low.map(|p| [p, p + Vector3::repeat(h)]).collect()
        };
        let [few, many] = [12, 24].map(|n| {
            let tree = BoxTree::new(boxes(n, 0.0));
            let (mut pairs, before) = (0, LOOKED.get());
            for cell in boxes(n, 0.37) {
                tree.any(&cell, &mut |_| {
                    pairs += 1;
                    false
                });
            }
            let cells = (n * n * n) as f64;
            [f64::from(pairs) / cells, (LOOKED.get() - before) as f64 / cells]
        });
        assert!(few[0] < 8.1 && many[0] < 8.1, "{few:?} {many:?}");
        assert!(many[1] < 1.5 * few[1] && many[1] < 60.0, "{few:?} {many:?}");
    }

    proptest! {
        #![proptest_config(reader_fuzz::property_config(256))]
        #[test]
        fn the_tree_finds_what_a_scan_finds(seed in prop::collection::vec(prop::array::uniform3(0.0..1.0f64), 1..200)) {
            let boxes: Vec<_> = seed.iter().map(|s| {
                let p = Point3::from(*s);
                [p, p + Vector3::repeat(0.1)]
            }).collect();
            let tree = BoxTree::new(boxes.clone());
            let query = [Point3::new(0.3, 0.3, 0.3), Point3::new(0.5, 0.5, 0.5)];
            let mut found = Vec::new();
            tree.any(&query, &mut |k| { found.push(k); false });
            found.sort_unstable();
            let scan: Vec<usize> = (0..boxes.len())
                .filter(|&k| (0..3).all(|a| boxes[k][0][a] <= query[1][a] && query[0][a] <= boxes[k][1][a]))
                .collect();
            prop_assert_eq!(found, scan);
        }
    }
}
