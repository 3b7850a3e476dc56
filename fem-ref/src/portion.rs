//! A finite element body partitioned among ranks.
//!
//! A rank owns whole units of nodes in their order, with the rows of the stiffness as they stand in the whole
//! body: products with them have the same bits. The displacements of the ghosts in these rows are received
//! once per evaluation. The rank also keeps the elements around the nodes of its elements, in the order of
//! the whole body. Masses, stiffnesses for other weights and recovered stresses are therefore sums of the
//! same terms; a patch needs the elements around the neighbours of owned nodes.

use crate::field::FemField;
use crate::mesh::Mesh;
use crate::model::FemModel;
use arlequin_core::adjacency::Adjacency;
use arlequin_core::blocks::BlockMatrix;
use arlequin_core::ranks::{Communicator, Halo, Message, RankError, Reach, Unit};
use arlequin_core::{Error, Model, Owned, Real, Result};
use nalgebra::Point3;
use std::hash::{DefaultHasher, Hasher};
use std::sync::{Arc, OnceLock};

/// Stiffness blocks that take as long as moving one node.
const MOVING: usize = 3;

/// Row of a mesh node that this rank does not own.
const NONE: u32 = u32::MAX;

/// A rank's part of a body.
#[derive(Debug, Clone)]
pub(crate) struct Part<T: Real> {
    /// Owned nodes \[m\].
    pub(crate) nodes: Vec<Point3<T>>,
    /// The field on the elements whose nodes are all owned.
    pub(crate) field: Arc<FemField<T>>,
    /// Numbers in the whole body of the mesh nodes, ascending.
    numbers: Vec<u32>,
    /// For each mesh node its number among the owned nodes, or [`NONE`].
    rows: Vec<u32>,
    components: usize,
    /// Owned nodes and ghosts of the stiffness.
    reach: Reach,
    /// Owned nodes and ghosts of stress recovery, built at the first request.
    around: OnceLock<Reach>,
    messages: Vec<Message>,
    /// Displacements of the mesh nodes that the stiffness needs, from the last evaluation.
    x: Vec<T>,
}

impl<T: Real> Part<T> {
    pub(crate) fn owned(&self) -> &Owned {
        self.reach.halo().owned()
    }

    /// Number of a mesh node among the owned nodes; `None` for a node of another rank.
    pub(crate) fn row(&self, node: u32) -> Option<usize> {
        let row = self.rows[node as usize];
        (row != NONE).then_some(row as usize)
    }

    /// Numbers in the mesh of owned nodes.
    pub(crate) fn places(&self, model: &str, nodes: &[usize]) -> Result<Vec<usize>> {
        self.reach.places(model, nodes)
    }

    /// Receives the displacements of ghosts and subtracts the product of the stiffness with displacements `q`
    /// of owned nodes from the forces `f`. Collective.
    pub(crate) fn subtract_product(
        &mut self,
        stiffness: &BlockMatrix<T>,
        q: &[T],
        f: &mut [T],
    ) -> Result<()> {
        spread(self.components, &self.reach, &mut self.messages, q, &mut self.x)?;
        stiffness.subtract_product(&self.x, f);
        Ok(())
    }

    /// Displacements of the mesh nodes, from the last evaluation of forces.
    pub(crate) fn displacements(&self) -> &[T] {
        &self.x
    }

    /// Displacements of the mesh nodes for `q` of owned nodes, in a new vector. Collective.
    pub(crate) fn receive(&self, q: &[T]) -> Result<Vec<T>> {
        self.receive_within(&self.reach, q)
    }

    /// Displacements for `q` of all mesh nodes that the patches of owned nodes need, in a new vector.
    /// Collective.
    pub(crate) fn receive_for_patches(&self, mesh: &Mesh<T>, q: &[T]) -> Result<Vec<T>> {
        self.receive_within(self.around.get_or_init(|| self.patch_reach(mesh)), q)
    }

    fn receive_within(&self, reach: &Reach, q: &[T]) -> Result<Vec<T>> {
        let c = self.components;
        let mut x = vec![T::zero(); self.x.len()];
        spread(c, reach, &mut reach.halo().messages(c), q, &mut x)?;
        Ok(x)
    }

    /// Reach of stress recovery: nodes of the elements around the neighbours of owned nodes.
    fn patch_reach(&self, mesh: &Mesh<T>) -> Reach {
        let corners = mesh.kind().corners();
        let incidence = Adjacency::of_slots(self.rows.len(), mesh.connectivity());
        let near = |k: u32| {
            let elements = incidence
                .row(k as usize)
                .iter()
                .map(|slot| *slot as usize / corners);
            elements.flat_map(|e| mesh.element(e)).copied()
        };
        let is_foreign = |k: u32| self.rows[k as usize] == NONE;
        let touches: Vec<bool> = (0..self.rows.len() as u32)
            .map(|k| near(k).any(is_foreign))
            .collect();
        let mut links = Vec::new();
        // One buffer for all nodes: their patches are small and many.
        let mut wide: Vec<u32> = Vec::new();
        for i in self.reach.own().iter().copied() {
            wide.clear();
            wide.extend(near(i));
            wide.sort_unstable();
            wide.dedup();
            // Most nodes lie inside the part; this test by table skips the search around them.
            wide.retain(|k| touches[*k as usize]);
            let mut named: Vec<u32> = wide
                .iter()
                .flat_map(|k| near(*k))
                .filter(|j| is_foreign(*j))
                .collect();
            named.sort_unstable();
            named.dedup();
            links.extend(named.iter().map(|j| [i, *j].map(|k| self.numbers[k as usize])));
        }
        let halo = Halo::of_links(self.owned(), links.into_iter());
        Reach::new(halo, |k| among(&self.numbers, k))
    }
}

/// Place of a node in an ascending list.
fn among(numbers: &[u32], node: u32) -> u32 {
    numbers.partition_point(|n| *n < node) as u32
}

fn spread<T: Real>(
    components: usize,
    reach: &Reach,
    messages: &mut [Message],
    q: &[T],
    x: &mut [T],
) -> Result<(), RankError> {
    match components {
        1 => reach.spread::<T, 1>(messages, q, x),
        _ => reach.spread::<T, 3>(messages, q, x),
    }
}

/// Nodes and elements that a rank keeps, ascending.
struct Needed {
    nodes: Vec<u32>,
    elements: Vec<u32>,
    /// Node pairs of the elements that have both owned nodes and nodes of other ranks.
    links: Vec<[u32; 2]>,
}

impl Needed {
    fn new<T: Real>(mesh: &Mesh<T>, nodes: &Owned) -> Self {
        let mut owned: Vec<bool> = vec![false; mesh.nodes().len()];
        (0..nodes.nodes()).for_each(|i| owned[nodes.global(i)] = true);
        let touching = |nodes: &[bool]| -> Vec<u32> {
            let touches = |e: &u32| mesh.element(*e as usize).iter().any(|k| nodes[*k as usize]);
            (0..mesh.element_count() as u32).filter(touches).collect()
        };
        let all_of = |elements: &[u32]| {
            let mut nodes = vec![false; mesh.nodes().len()];
            let corners = elements.iter().flat_map(|e| mesh.element(*e as usize));
            corners.for_each(|k| nodes[*k as usize] = true);
            nodes
        };
        // Two layers: the patch of a neighbour of an owned node needs the elements around that neighbour.
        let first = touching(&owned);
        let mut links = Vec::new();
        for e in &first {
            let corners = mesh.element(*e as usize);
            if corners.iter().all(|k| owned[*k as usize]) {
                continue;
            }
            for (position, i) in corners.iter().enumerate() {
                links.extend(corners[..position].iter().map(|j| [*i, *j]));
            }
        }
        let elements = touching(&all_of(&first));
        let nodes = (0..).zip(all_of(&elements));
        Self {
            nodes: nodes.filter(|n| n.1).map(|n| n.0).collect(),
            elements,
            links,
        }
    }
}

impl<T: Real> FemModel<T> {
    /// Units of the body: centre \[m\] and work, as the number of stiffness blocks with the motion of nodes
    /// included.
    #[must_use]
    pub fn units(&self) -> Vec<Unit> {
        let blocks = |i: usize| self.stiffness.columns(i).len() + MOVING;
        Unit::from_nodes(self.nodes(), |range| range.map(blocks).sum::<usize>() as f64)
    }

    /// The halo of this rank: ghosts that it receives, owned nodes that it sends, and the ranks it exchanges
    /// with. `None` for a body that is not partitioned.
    #[must_use]
    pub fn halo(&self) -> Option<&Halo> {
        self.part.as_ref().map(|p| p.reach.halo())
    }

    /// Partitions the body by the work of its units and restricts it to the part of this rank. Collective.
    pub(crate) fn keep_part(&mut self, communicator: &Arc<dyn Communicator>) -> Result<()> {
        if self.part.is_some() {
            return Err(Error::Unsupported {
                model: self.name.clone(),
                what: "be shared out: it is a part of a body already".into(),
            });
        }
        let what = format!("the mesh of '{}', its materials or its weights", self.name);
        let digest = (&*what, self.digest());
        let owned = Owned::bisected(communicator, digest, self.nodes().len(), &self.units())?;
        let needed = Needed::new(self.mesh(), &owned);
        self.part = Some(self.restrict(&owned, &needed));
        Ok(())
    }

    /// Restricts the matrices, masses and mesh of the model to what the part needs, and returns the part.
    fn restrict(&mut self, ownership: &Owned, needed: &Needed) -> Part<T> {
        let whole = self.mesh();
        let (kind, section) = (whole.kind(), whole.section());
        // Places ascend with the numbers in the whole body, so that sums over rows keep their order.
        let place = |k: u32| among(&needed.nodes, k);
        let reach = Reach::new(Halo::of_links(ownership, needed.links.iter().copied()), place);
        let owned = reach.own();
        let mut rows = vec![NONE; needed.nodes.len()];
        (0..).zip(owned).for_each(|(i, k)| rows[*k as usize] = i);
        let nodes: Vec<Point3<T>> = needed.nodes.iter().map(|k| whole.nodes()[*k as usize]).collect();
        let corners = needed.elements.iter().flat_map(|e| whole.element(*e as usize));
        let connectivity: Vec<u32> = corners.map(|k| place(*k)).collect();
        let owned_nodes: Vec<Point3<T>> = owned.iter().map(|k| nodes[*k as usize]).collect();
        let numbered = connectivity.iter().map(|k| rows[*k as usize]);
        let numbered: Vec<u32> = numbered.collect();
        let inner = numbered.chunks(kind.corners()).filter(|e| !e.contains(&NONE));
        let inner = Mesh::unchecked(
            kind,
            section,
            owned_nodes.clone(),
            inner.flatten().copied().collect(),
        );
        let globals = (0..ownership.nodes()).map(|i| ownership.global(i));
        self.stiffness = self.stiffness.some_rows(globals, nodes.len(), place);
        let elements = || needed.elements.iter().map(|e| *e as usize);
        let n = kind.corners();
        self.masses = elements()
            .flat_map(|e| self.masses[e * n..(e + 1) * n].to_vec())
            .collect();
        self.means = elements().map(|e| self.means[e]).collect();
        self.materials = self.materials.of_some(elements());
        self.field = Arc::new(FemField::new(Mesh::unchecked(kind, section, nodes, connectivity)));
        self.patches = OnceLock::new();
        Part {
            nodes: owned_nodes,
            field: Arc::new(FemField::new(inner)),
            numbers: needed.nodes.clone(),
            x: vec![T::zero(); kind.components() * rows.len()],
            rows,
            components: kind.components(),
            messages: reach.halo().messages(kind.components()),
            reach,
            around: OnceLock::new(),
        }
    }

    /// Checksum of positions, masses, stiffness and connectivity: ranks compare it to detect different
    /// bodies.
    fn digest(&self) -> u64 {
        let mut hasher = DefaultHasher::new();
        let places = self.nodes().iter().flat_map(|x| x.coords.iter());
        let rows = 0..self.nodes().len();
        let stiffness = rows.flat_map(|i| self.stiffness.row_values(i));
        let numbers = places.chain(&self.masses).chain(stiffness);
        // By bits: parts of bodies that differ in a last digit would not fit together to the bit.
        numbers.for_each(|x| hasher.write_u64(x.as_f64().to_bits()));
        self.mesh()
            .connectivity()
            .iter()
            .for_each(|k| hasher.write_u32(*k));
        hasher.finish()
    }
}
