//! A body in parts on several ranks, its geometry whole on all of them.
//!
//! A rank has whole units of nodes in their order. It finds the stresses of all cells that its nodes gather
//! from, those of nodes of other ranks as well: they cost less than a second round of messages.
//! Displacements of the nodes that these cells name come from their ranks, once per evaluation. What is
//! gathered is in the order of the whole body, so that forces have its bits.

use crate::field::NaturalField;
use crate::model::CnemModel;
use crate::scni::MatrixFree;
use arlequin_core::ranks::{Communicator, Halo, Message, Portion, Reach, Unit};
use arlequin_core::{Error, Interpolation, Model, Result, ShapeRow, Shared, outside};
use nalgebra::{Point3, Vector3};
use std::hash::{DefaultHasher, Hasher};
use std::sync::{Arc, OnceLock};

/// Entries of rows that take as long as moving a node.
const MOVING: usize = 10;

/// Cells per thread between two looks at messages that are on their way: fractions of a millisecond.
const PIECE: usize = 1_024;

/// What a rank holds of a body.
#[derive(Debug, Clone)]
pub(crate) struct Part {
    /// Own nodes \[m\].
    pub(crate) nodes: Vec<Point3<f64>>,
    pub(crate) field: Arc<PartField>,
    /// Cells that own nodes gather from, and own ones, ascending.
    pub(crate) cells: Vec<u32>,
    /// Numbers in the whole body of the nodes whose displacements the forces name, ascending.
    pub(crate) named: Vec<u32>,
    /// Those of own nodes.
    pub(crate) own: Vec<u32>,
    /// Weights \[–\] of all cells of the body.
    pub(crate) alpha: Vec<f64>,
    /// Among the named ones.
    reach: Reach,
    /// Of recovered stresses among all nodes, once they are asked for.
    around: OnceLock<Reach>,
    messages: Vec<Message>,
    /// Displacements of the named nodes.
    x: Vec<f64>,
}

/// The field of a body where all nodes that it names are here.
#[derive(Debug)]
pub(crate) struct PartField {
    whole: Arc<NaturalField>,
    portion: Arc<Portion>,
    nodes: Vec<Point3<f64>>,
}

impl Interpolation<f64> for PartField {
    fn nodes(&self) -> &[Point3<f64>] {
        &self.nodes
    }

    fn shape_at(&self, x: &Point3<f64>, gradient: bool, row: &mut ShapeRow<f64>) -> Result<()> {
        self.whole.shape_at(x, gradient, row)?;
        for node in &mut row.nodes {
            *node = self
                .portion
                .local(*node)
                .ok_or_else(|| outside(x, self.whole.kind()))?;
        }
        Ok(())
    }

    fn kind(&self) -> &'static str {
        self.whole.kind()
    }
}

impl Part {
    pub(crate) fn portion(&self) -> &Arc<Portion> {
        self.reach.halo().portion()
    }

    /// Subtracts internal forces at displacements `q` of own nodes: stresses of cells that name no others
    /// are found while displacements of these are on their way.
    pub(crate) fn subtract_product(
        &mut self,
        forces: &mut MatrixFree,
        q: &[f64],
        f: &mut [f64],
    ) -> Result<()> {
        let (mut done, size) = (0, PIECE * rayon::current_num_threads());
        let meanwhile = &mut |x: &[f64]| {
            done += size;
            forces.stress_inner(done - size..done, x)
        };
        self.reach
            .spread_meanwhile::<f64, 3>(&mut self.messages, q, &mut self.x, meanwhile)?;
        forces.subtract_rest(&self.x, f);
        Ok(())
    }

    /// What was heard last.
    pub(crate) fn heard(&self) -> &[f64] {
        &self.x
    }

    /// As [`Self::hear`], kept apart.
    pub(crate) fn heard_at(&self, q: &[f64]) -> Result<Vec<f64>> {
        let mut x = vec![0.0; self.x.len()];
        self.reach
            .spread::<f64, 3>(&mut self.reach.halo().messages(3), q, &mut x)?;
        Ok(x)
    }

    /// Displacements of the whole body's nodes, those that own patches name, and the numbers there of some
    /// own `nodes`.
    pub(crate) fn heard_around(
        &self,
        model: &CnemModel,
        q: &[f64],
        nodes: &[usize],
    ) -> Result<(Vec<f64>, Vec<usize>)> {
        let around = || Reach::new(patched(model, self.portion()), |k| k);
        let reach = self.around.get_or_init(around);
        let mut x = vec![0.0; 3 * self.portion().division().nodes()];
        reach.spread::<f64, 3>(&mut reach.halo().messages(3), q, &mut x)?;
        Ok((x, reach.places(model.name(), nodes)?))
    }
}

/// Links between nodes and those that the cells of their patches name.
fn patched(model: &CnemModel, portion: &Arc<Portion>) -> Halo {
    let patches = model.patches();
    let mut links = Vec::new();
    for i in 0..portion.division().nodes() {
        let here = portion.local(i).is_some();
        for (cell, _) in patches.row(i) {
            let named = model.smoothed_row(cell).0;
            let other = named
                .iter()
                .filter(|k| here != portion.local(**k as usize).is_some());
            links.extend(other.map(|k| [i as u32, *k]));
        }
    }
    Halo::of_links(portion.clone(), links.into_iter())
}

/// Nodes whose displacements a rank needs, ascending, and its own linked with those of others.
struct Named {
    nodes: Vec<u32>,
    links: Vec<[u32; 2]>,
}

impl Named {
    fn new(forces: &MatrixFree, own: &[u32], cells: &[u32], portion: &Portion) -> Self {
        let (mut nodes, mut links) = (Vec::new(), Vec::new());
        let mine = |k: &u32| portion.local(*k as usize).is_some();
        for c in cells {
            let (here, there): (Vec<u32>, Vec<u32>) = forces.named_by(*c).partition(mine);
            links.extend(here.iter().flat_map(|i| there.iter().map(|j| [*i, *j])));
            nodes.extend(here.into_iter().chain(there));
        }
        for i in own {
            let around = forces.tetrahedra_of(*i);
            links.extend(around.iter().filter(|k| !mine(k)).map(|k| [*i, *k]));
            nodes.extend(around);
        }
        nodes.sort_unstable();
        nodes.dedup();
        Self { nodes, links }
    }
}

impl CnemModel {
    /// The units of the body: middle \[m\], and entries of the rows that the forces are gathered from, the
    /// motion of nodes included.
    #[must_use]
    pub fn units(&self) -> Vec<Unit> {
        let entries = |i: usize| self.forces.entries(i) + MOVING;
        Unit::all(self.nodes(), |range| range.map(entries).sum::<usize>() as f64)
    }

    /// What a rank exchanges: nodes of others that it hears of, own ones that it tells of, and ranks on the
    /// other side. None for a whole body.
    #[must_use]
    pub fn halo(&self) -> Option<&Halo> {
        self.part.as_ref().map(|p| p.reach.halo())
    }

    /// Becomes the part of the rank of `communicator`, of a division by the work of units.
    pub(crate) fn keep_part(&mut self, communicator: &Arc<dyn Communicator>) -> Result<Shared<f64>> {
        let name = self.name().to_owned();
        if self.part.is_some() {
            return Err(Error::Unsupported {
                model: name,
                what: "be shared out: it is a part of a body already".into(),
            });
        }
        let what = format!("the cells of '{name}', its material or its weights");
        let digest = (&*what, self.digest());
        let portion = Portion::bisected(communicator, digest, self.nodes().len(), &self.units())?;
        let own: Vec<u32> = (0..portion.nodes()).map(|i| portion.global(i) as u32).collect();
        let cells = self.forces.cells_of(&own);
        let Named { nodes: named, links } = Named::new(&self.forces, &own, &cells, &portion);
        let halo = Halo::of_links(portion.clone(), links.into_iter());
        let nodes: Vec<Point3<f64>> = own.iter().map(|k| self.nodes()[*k as usize]).collect();
        let field = Arc::new(PartField {
            whole: self.field(),
            portion: portion.clone(),
            nodes: nodes.clone(),
        });
        let alpha = self.forces.weights().to_vec();
        self.forces = self.forces.part(&own, &cells, &named);
        let reach = Reach::new(halo, |k| named.partition_point(|n| *n < k) as u32);
        self.part = Some(Part {
            nodes,
            field: field.clone(),
            x: vec![0.0; 3 * named.len()],
            cells,
            named,
            own,
            alpha,
            messages: reach.halo().messages(3),
            reach,
            around: OnceLock::new(),
        });
        Ok(Shared { portion, field })
    }

    /// A number that tells bodies apart.
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
