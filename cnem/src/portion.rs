//! A body partitioned among ranks. Its geometry is complete on every rank.
//!
//! A rank owns whole units of nodes, in their order. It computes the stresses of all cells that its nodes
//! gather from, also of cells that belong to nodes of other ranks: this costs less than a second round of
//! messages. The displacements of ghosts (nodes that these cells name and other ranks own) are received once
//! per evaluation. Sums run in the order of the whole body, so that forces have the same bits on any number
//! of ranks.

use crate::field::NaturalField;
use crate::model::CnemModel;
use crate::scni::MatrixFree;
use arlequin_core::ranks::{Communicator, Halo, Message, Reach, Unit};
use arlequin_core::{Error, Interpolation, Model, Owned, Result, ShapeRow, outside};
use nalgebra::{Point3, Vector3};
use std::hash::{DefaultHasher, Hasher};
use std::sync::{Arc, OnceLock};

/// Cost of moving one node, as a number of row entries that take the same time.
const MOVING: usize = 10;

/// This rank's part of a partitioned body.
#[derive(Debug, Clone)]
pub(crate) struct Part {
    /// Reference positions of the owned nodes \[m\].
    pub(crate) nodes: Vec<Point3<f64>>,
    pub(crate) field: Arc<PartField>,
    /// Cells that the owned nodes gather from, and the owned nodes' cells, ascending.
    pub(crate) cells: Vec<u32>,
    /// Global numbers of the nodes whose displacements the force evaluation reads, ascending.
    pub(crate) needed: Vec<u32>,
    /// Global numbers of the owned nodes, ascending.
    pub(crate) owned: Vec<u32>,
    /// Weights \[–\] of all cells of the whole body.
    pub(crate) alpha: Vec<f64>,
    /// Where owned nodes and ghosts stand in `needed`.
    reach: Reach,
    /// Where owned nodes and ghosts stand among all nodes of the body, for the recovery of stresses; built
    /// when first needed.
    around: OnceLock<Reach>,
    messages: Vec<Message>,
    /// Displacements \[m\] of the nodes `needed`, as last received.
    x: Vec<f64>,
}

/// The field of a partitioned body, with local node numbers. Points whose shape functions name a node that
/// this rank does not own count as outside.
#[derive(Debug)]
pub(crate) struct PartField {
    body: Arc<NaturalField>,
    owned: Owned,
    nodes: Vec<Point3<f64>>,
}

impl Interpolation<f64> for PartField {
    fn nodes(&self) -> &[Point3<f64>] {
        &self.nodes
    }

    fn shape_at(&self, x: &Point3<f64>, gradient: bool, row: &mut ShapeRow<f64>) -> Result<()> {
        self.body.shape_at(x, gradient, row)?;
        for node in &mut row.nodes {
            *node = self
                .owned
                .local(*node)
                .ok_or_else(|| outside(x, self.body.kind()))?;
        }
        Ok(())
    }

    fn kind(&self) -> &'static str {
        self.body.kind()
    }
}

impl Part {
    pub(crate) fn owned(&self) -> &Owned {
        self.reach.halo().owned()
    }

    /// Receives the displacements of ghosts and subtracts the internal forces at displacements `q` of the
    /// owned nodes from `f`. Collective.
    pub(crate) fn subtract_product(
        &mut self,
        forces: &mut MatrixFree,
        q: &[f64],
        f: &mut [f64],
    ) -> Result<()> {
        self.reach.spread::<f64, 3>(&mut self.messages, q, &mut self.x)?;
        forces.subtract_product(&self.x, f);
        Ok(())
    }

    /// Displacements of the nodes `needed` from the last force evaluation.
    pub(crate) fn received(&self) -> &[f64] {
        &self.x
    }

    /// Returns the displacements of the nodes `needed` for `q`, in a new vector. Collective.
    pub(crate) fn receive(&self, q: &[f64]) -> Result<Vec<f64>> {
        let mut x = vec![0.0; self.x.len()];
        self.reach
            .spread::<f64, 3>(&mut self.reach.halo().messages(3), q, &mut x)?;
        Ok(x)
    }

    /// Returns a displacement vector of the whole body, filled at the nodes that the owned nodes' recovery
    /// patches name, and the global numbers of the local `nodes`. Collective.
    pub(crate) fn receive_around(
        &self,
        model: &CnemModel,
        q: &[f64],
        nodes: &[usize],
    ) -> Result<(Vec<f64>, Vec<usize>)> {
        let around = || Reach::new(patched(model, self.owned()), |k| k);
        let reach = self.around.get_or_init(around);
        // As long as the whole body, since the patches keep its numbers.
        let mut x = vec![0.0; 3 * self.owned().nodes_of_whole()];
        reach.spread::<f64, 3>(&mut reach.halo().messages(3), q, &mut x)?;
        Ok((x, reach.places(model.name(), nodes)?))
    }
}

/// Builds the halo of the stress recovery: links each node to the nodes that the cells of its patch name.
fn patched(model: &CnemModel, owned: &Owned) -> Halo {
    let patches = model.patches();
    let mut links = Vec::new();
    for i in 0..owned.nodes_of_whole() {
        // A link counts if its ends lie on different sides, whichever of both is owned.
        let is_local = owned.local(i).is_some();
        for (cell, _) in patches.row(i) {
            let needed = model.smoothed_row(cell).0;
            let remote = needed
                .iter()
                .filter(|k| is_local != owned.local(**k as usize).is_some());
            links.extend(remote.map(|k| [i as u32, *k]));
        }
    }
    Halo::of_links(owned, links.into_iter())
}

/// Nodes whose displacements a rank reads, ascending, and the links from its owned nodes to ghosts.
struct Needed {
    nodes: Vec<u32>,
    links: Vec<[u32; 2]>,
}

impl Needed {
    fn new(forces: &MatrixFree, owned: &[u32], cells: &[u32], ownership: &Owned) -> Self {
        let (mut nodes, mut links) = (Vec::new(), Vec::new());
        let is_local = |k: &u32| ownership.local(*k as usize).is_some();
        for c in cells {
            let (local, remote): (Vec<u32>, Vec<u32>) = forces.nodes_of_cell(*c).partition(is_local);
            links.extend(local.iter().flat_map(|i| remote.iter().map(|j| [*i, *j])));
            nodes.extend(local.into_iter().chain(remote));
        }
        for i in owned {
            let around = forces.tetrahedra_of(*i);
            links.extend(around.iter().filter(|k| !is_local(k)).map(|k| [*i, *k]));
            nodes.extend(around);
        }
        // Cells share nodes, which are received once.
        nodes.sort_unstable();
        nodes.dedup();
        Self { nodes, links }
    }
}

impl CnemModel {
    /// Returns the units into which the body can be partitioned: middle \[m\], and work counted in row
    /// entries of the force evaluation, plus the motion of the nodes.
    #[must_use]
    pub fn units(&self) -> Vec<Unit> {
        let entries = |i: usize| self.forces.entries(i) + MOVING;
        Unit::from_nodes(self.nodes(), |range| range.map(entries).sum::<usize>() as f64)
    }

    /// Returns the halo of this rank: ghosts to receive, owned nodes to send, and the ranks to exchange with.
    /// `None` for a body that is not partitioned.
    #[must_use]
    pub fn halo(&self) -> Option<&Halo> {
        self.part.as_ref().map(|p| p.reach.halo())
    }

    /// Reduces this model to the part of the rank of `communicator`. The body is bisected by the work of its
    /// units.
    pub(crate) fn keep_part(&mut self, communicator: &Arc<dyn Communicator>) -> Result<()> {
        let name = self.name().to_owned();
        if self.part.is_some() {
            return Err(Error::Unsupported {
                model: name,
                what: "be shared out: it is a part of a body already".into(),
            });
        }
        let what = format!("the cells of '{name}', its material or its weights");
        let digest = (&*what, self.digest());
        let ownership = Owned::bisected(communicator, digest, self.nodes().len(), &self.units())?;
        let owned: Vec<u32> = (0..ownership.nodes())
            .map(|i| ownership.global(i) as u32)
            .collect();
        let cells = self.forces.cells_of(&owned);
        let Needed { nodes: needed, links } = Needed::new(&self.forces, &owned, &cells, &ownership);
        let halo = Halo::of_links(&ownership, links.into_iter());
        let nodes: Vec<Point3<f64>> = owned.iter().map(|k| self.nodes()[*k as usize]).collect();
        let field = Arc::new(PartField {
            body: self.field(),
            owned: ownership,
            nodes: nodes.clone(),
        });
        // Kept for the assembled stiffness, which stays that of the whole body.
        let alpha = self.forces.weights().to_vec();
        self.forces = self.forces.part(&owned, &cells, &needed);
        let reach = Reach::new(halo, |k| needed.partition_point(|n| *n < k) as u32);
        self.part = Some(Part {
            nodes,
            field,
            x: vec![0.0; 3 * needed.len()],
            cells,
            needed,
            owned,
            alpha,
            messages: reach.halo().messages(3),
            reach,
            around: OnceLock::new(),
        });
        Ok(())
    }

    /// Hash of cells, material and weights: equal on ranks that hold the same body.
    fn digest(&self) -> u64 {
        let mut hasher = DefaultHasher::new();
        let places = self.nodes().iter().flat_map(|x| x.coords.iter());
        let numbers = places.chain(self.cells().volumes()).chain(self.forces.weights());
        let [lambda, mu] = self.material().lame();
        let numbers = numbers.chain([&lambda, &mu]);
        numbers.for_each(|x| hasher.write_u64(x.to_bits()));
        for cell in 0..self.cells().len() {
            let gradients = self.smoothed_row(cell).1.iter().flat_map(Vector3::iter);
            gradients.for_each(|x| hasher.write_u64(x.to_bits()));
        }
        hasher.finish()
    }
}
