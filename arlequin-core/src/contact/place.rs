//! A place on a facet: its motion is that of the linear facet, and a force at it goes to the facet's nodes
//! with the same weights.
//!
//! A quadrilateral is four triangles around its centre, which moves with the mean of the corners. A uniform
//! pressure then loads each corner with a quarter, as the element does; on two halves, two corners would get
//! a third and two a sixth.

use nalgebra::Vector3;

/// A triangle of a surface: a face with three nodes, or a quarter of one with four.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Triangle {
    /// Nodes, counter-clockwise from outside, beginning with those of the triangle; a face with three nodes
    /// repeats the last.
    pub(crate) nodes: [u32; 4],
    /// Numbers of the corners; the third of a quarter is its centre, with a number beyond those of all nodes.
    pub(crate) corners: [u32; 3],
}

impl Triangle {
    /// Cuts faces into triangles. The last two nodes of a face with three are equal; the surface has nodes up
    /// to `count`.
    pub(crate) fn cut(faces: &[[u32; 4]], count: usize) -> Vec<Self> {
        let mut out = Vec::new();
        for (face, nodes) in faces.iter().enumerate() {
            let [a, b, c, d] = *nodes;
            if c == d {
                let corners = [a, b, c];
                out.push(Self {
                    nodes: *nodes,
                    corners,
                });
                continue;
            }
            let centre = (count + face) as u32;
            out.extend((0..4).map(|k| {
                let nodes = [0, 1, 2, 3].map(|n| nodes[(k + n) % 4]);
                let corners = [nodes[0], nodes[1], centre];
                Self { nodes, corners }
            }));
        }
        out
    }

    /// Returns whether the triangle is a quarter of a face.
    pub(crate) fn is_quarter(&self) -> bool {
        self.nodes[2] != self.nodes[3]
    }

    /// Corners, from the places of the nodes.
    pub(crate) fn places(&self, place: impl Fn(u32) -> Vector3<f64>) -> [Vector3<f64>; 3] {
        let [a, b, c] = [0, 1, 2].map(|k: usize| place(self.nodes[k]));
        if self.is_quarter() {
            [a, b, (a + b + c + place(self.nodes[3])) * 0.25]
        } else {
            [a, b, c]
        }
    }

    /// Cosine of the angle between the normals for the places `then` and `now` of the nodes.
    pub(crate) fn turn(&self, then: impl Fn(u32) -> Vector3<f64>, now: impl Fn(u32) -> Vector3<f64>) -> f64 {
        let doubled = |[a, b, c]: [Vector3<f64>; 3]| (b - a).cross(&(c - a));
        let [then, now] = [doubled(self.places(then)), doubled(self.places(now))];
        let size = then.norm() * now.norm();
        if size > 0.0 { then.dot(&now) / size } else { 1.0 }
    }

    /// Size \[m\]: the side of the square that has the area of the face, or of two such triangles.
    pub(crate) fn size(&self, area: f64) -> f64 {
        let count = if self.is_quarter() { 4.0 } else { 2.0 };
        (count * area).sqrt()
    }

    /// The place with these weights of the corners.
    pub(crate) fn place(&self, [a, b, c]: [f64; 3]) -> Place {
        let weights = if self.is_quarter() {
            let c = 0.25 * c;
            [a + c, b + c, c, c]
        } else {
            [a, b, c, 0.0]
        };
        Place {
            nodes: self.nodes,
            weights,
        }
    }
}

/// Nodes of a facet and their weights.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Place {
    pub(crate) nodes: [u32; 4],
    pub(crate) weights: [f64; 4],
}

impl Place {
    /// The place of a node.
    pub(crate) fn node(node: u32) -> Self {
        Self {
            nodes: [node; 4],
            weights: [1.0, 0.0, 0.0, 0.0],
        }
    }

    /// Iterates over the nodes with their weights.
    pub(crate) fn nodes(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        let pairs = self.nodes.iter().zip(self.weights);
        pairs.filter(|(_, w)| *w > 0.0).map(|(n, w)| (*n as usize, w))
    }

    /// Interpolates a nodal field of three components.
    pub(crate) fn value(&self, x: &[f64]) -> Vector3<f64> {
        self.nodes().fold(Vector3::zeros(), |sum, (n, w)| {
            sum + Vector3::new(x[3 * n], x[3 * n + 1], x[3 * n + 2]) * w
        })
    }

    /// Sum of a nodal quantity times the squared weights: the inverse mass of the place from those of nodes.
    pub(crate) fn squared(&self, quantity: impl Fn(usize) -> f64) -> f64 {
        self.nodes().map(|(n, w)| w * w * quantity(n)).sum()
    }

    /// Mean of a nodal quantity.
    pub(crate) fn mean(&self, quantity: impl Fn(usize) -> f64) -> f64 {
        self.nodes().map(|(n, w)| w * quantity(n)).sum()
    }

    /// Adds a force at the place to nodal forces.
    pub(crate) fn add(&self, force: &Vector3<f64>, f: &mut [f64]) {
        for (n, w) in self.nodes() {
            for c in 0..3 {
                f[3 * n + c] += w * force[c];
            }
        }
    }
}
