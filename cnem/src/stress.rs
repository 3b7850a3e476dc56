//! Stress and strain at the nodes: patch recovery from the smoothed gradients of the Voronoi cells.

use crate::model::CnemModel;
use arlequin_core::adjacency::Adjacency;
use arlequin_core::{
    GradientPoint, Gradients, Model, Patches, Recovered, Recovery, Result, SymmetricTensor, check_size,
};
use nalgebra::{Matrix3, Point3, Vector3};

/// Returns the centroid of a cell \[m\]: the mean over the cones from its node `x_I` to its facets `q`,
/// weighted by volume, `Σ V_q (¾ x_q + ¼ x_I)/V`.
fn centroid(model: &CnemModel, cell: usize) -> Point3<f64> {
    let x = model.domain().nodes()[cell].coords;
    let (mut sum, mut volume) = (Vector3::zeros(), 0.0);
    for f in model.cells().facets(cell) {
        let v = f.area.dot(&(f.centroid.coords - x)) / 3.0;
        sum += (f.centroid.coords * 0.75 + x * 0.25) * v;
        volume += v;
    }
    // A cell without volume has no centroid; its node stands for it.
    if volume > 0.0 {
        Point3::from(sum / volume)
    } else {
        Point3::from(x)
    }
}

/// Builds the recovery patch of each node: its own cell and the cells of all nodes that an edge joins to it.
pub(crate) fn patches(model: &CnemModel) -> Patches<f64> {
    let nodes = model.domain().nodes();
    let samples: Vec<Point3<f64>> = (0..nodes.len()).map(|i| centroid(model, i)).collect();
    let mut edges: Vec<[u32; 2]> = model
        .domain()
        .elements()
        .flat_map(|t| {
            [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]].map(|[a, b]: [usize; 2]| {
                let (i, j) = (t[a] as u32, t[b] as u32);
                [i.min(j), i.max(j)]
            })
        })
        .collect();
    edges.sort_unstable();
    edges.dedup();
    let around = Adjacency::of_pairs(nodes.len(), &edges);
    Patches::new(nodes, &samples, |node, out| {
        let mut patch: Vec<u32> = around.row(node).iter().map(|e| e[0]).collect();
        patch.push(node as u32);
        patch.sort_unstable();
        out.push(patch);
    })
}

impl CnemModel {
    /// Returns strain \[–\] and stress \[Pa\] of one cell at displacements `q`.
    fn cell_values(&self, cell: usize, q: &[f64]) -> [SymmetricTensor<f64>; 2] {
        let (nodes, gradients) = self.smoothed_row(cell);
        let mut h = Matrix3::zeros();
        for (node, g) in nodes.iter().zip(gradients) {
            let u = Vector3::from_column_slice(&q[3 * *node as usize..3 * *node as usize + 3]);
            h += u * g.transpose();
        }
        let strain = SymmetricTensor::from_matrix(&h);
        [strain, self.material().stress(&strain)]
    }
}

impl Recovery<f64> for CnemModel {
    fn method(&self) -> &'static str {
        "patch recovery: a linear polynomial fitted to the smoothed values of the cells around the node"
    }

    fn has_strain(&self) -> bool {
        true
    }

    /// Collective for a partitioned body: every rank must call it.
    fn recover(&self, q: &[f64], nodes: &[usize], out: &mut Vec<Recovered<f64>>) -> Result<()> {
        check_size(self, "displacements", q.len())?;
        let cells = self.cells().len();
        let Some(part) = &self.part else {
            let values = |k: usize| self.cell_values(k, q);
            return self.patches().recover(self.name(), nodes, cells, values, out);
        };
        let (x, numbers) = part.receive_around(self, q, nodes)?;
        let values = |k: usize| self.cell_values(k, &x);
        self.patches().recover(self.name(), &numbers, cells, values, out)
    }
}

impl Gradients<f64> for CnemModel {
    fn count(&self) -> usize {
        self.cells().len()
    }

    fn for_each_point(&self, cell: usize, visit: &mut dyn FnMut(&GradientPoint<'_, f64>)) {
        let (nodes, gradients) = self.smoothed_row(cell);
        visit(&GradientPoint {
            nodes,
            gradients,
            volume: self.cells().volumes()[cell],
            material: self.material(),
        });
    }
}
