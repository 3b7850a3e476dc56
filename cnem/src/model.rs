//! The natural element model: weighted stiffness by nodal integration and lumped mass. It can be the coarse
//! or the fine model of a coupling.
//!
//! `M_β q̈ = F_ext,γ − K_α q` with `K_α = Σ_I α_I V_I B̃_Iᵀ A B̃_I` (see [`crate::scni`]) and
//! `M_β,I = β_I ρ V_I`. Here `V_I` is the volume of the constrained Voronoi cell of node `I`, and `α_I`,
//! `β_I` are the means of the weights over this cell. The mass of a cell can go to the nodes around its
//! centroid instead ([`Inertia`]). Nodal weighting ([`arlequin_core::NodallyWeighted`]), kept for comparison
//! with the literature, multiplies the unweighted force and mass of node `I` by `α(x_I)` and `β(x_I)`. It
//! leaves no symmetric stiffness, so a model weighted in this way is not offered as a linear one.
//!
//! By default a node carries the mass of its own cell alone, but its stiffness comes from the surrounding
//! cells as well: a weight that falls to zero within one spacing leaves light nodes on stiff neighbours. The
//! critical step therefore depends on the smallest weight, unlike the step of models whose mass is
//! distributed over elements. Measured with a weight that falls to `ε` over four spacings: 0.99 / 0.87 / 0.35
//! of the unweighted step for `ε` = 0.05 / 0.005 / 0.0005, and 1.00 / 1.00 / 0.76 with
//! [`Inertia::Centroids`].

mod faces;
mod patch_test;

use crate::domain::{Domain, Neighbours};
use crate::error::{Error, Result, parameter};
use crate::field::NaturalField;
use crate::inertia::{Inertia, Spread};
use crate::natural::Interpolant;
use crate::portion::Part;
use crate::scni::{BoundaryFacet, MatrixFree, Smoothing, Stabilisation, SubCells, stiffness};
use crate::stress;
use crate::voronoi::{CellBodies, Voronoi};
use arlequin_core::effect::SurfaceFacet;
use arlequin_core::ranks::Communicator;
use arlequin_core::sprs::CsMat;
use arlequin_core::{
    Boundary, CoarseModel, DofLayout, Elastic, FineModel, Interpolation, LinearModel, Model, Owned, Patches,
    Views, Weight, advice, check_size, spectrum,
};
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use std::sync::{Arc, OnceLock};

/// Volumetric locking, one row per measurement: Poisson's ratio \[–\], relative excess stiffness of a
/// thick-walled ring under inner pressure, relative error of its hoop stress at the inner face. Measured in
/// `apps/scene/tests/it/locking.rs`.
const LOCKING: [[f64; 3]; 6] = [
    [0.3, -0.007, 0.048],
    [0.4, -0.004, 0.079],
    [0.45, 0.002, 0.143],
    [0.49, 0.033, 0.674],
    [0.499, 0.272, 5.360],
    [0.4999, 2.329, 17.924],
];

/// Options of the discretisation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Shape functions.
    pub kind: Interpolant,
    /// Stabilisation against spurious modes.
    pub stabilisation: Stabilisation,
    /// Nodes that carry the mass of a cell.
    pub inertia: Inertia,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            kind: Interpolant::Laplace,
            stabilisation: Stabilisation::default(),
            inertia: Inertia::default(),
        }
    }
}

/// A linear elastic body discretised by natural elements.
#[derive(Debug, Clone)]
pub struct CnemModel {
    name: String,
    field: Arc<NaturalField>,
    cells: Voronoi,
    material: Elastic<f64>,
    options: Options,
    smoothing: Smoothing,
    sub: SubCells,
    pub(crate) forces: MatrixFree,
    /// How cell masses go to the nodes around the cell centroids; `None` for [`Inertia::Cells`].
    spread: Option<Spread>,
    neighbours: Neighbours,
    /// Patches for the recovery of stresses, built when they are first needed.
    patches: OnceLock<Patches<f64>>,
    /// This rank's part of a partitioned body; `None` for a body that is not partitioned.
    pub(crate) part: Option<Part>,
}

impl CnemModel {
    /// Creates a model with all weights equal to one: a body that is not coupled. Its nodes are those of the
    /// domain, in the same order.
    ///
    /// ```
    /// use arlequin_core::Model;
    /// use cnem::{CnemModel, Elastic, Options, constraint::Surface, domain::Domain};
    /// use nalgebra::Point3;
    /// let grid: Vec<_> =
    ///     (0..27).map(|i| Point3::new(f64::from(i % 3), f64::from(i / 3 % 3), f64::from(i / 9))).collect();
    /// let domain = Domain::new(&grid, &Surface::convex_hull())?;
    /// let cube = CnemModel::new("cube", domain, Elastic::new(1.0, 0.0, 1.0)?, Options::default())?;
    /// let stretched: Vec<f64> = cube.nodes().iter().flat_map(|p| [0.01 * p.x, 0.0, 0.0]).collect();
    /// assert!((cube.internal_energy(&stretched) - 0.5e-4 * 8.0).abs() < 1e-15);
    /// # Ok::<(), cnem::Error>(())
    /// ```
    ///
    /// # Errors
    /// The errors of [`Domain::voronoi`]; [`Error::Parameter`] for an amount of stabilisation that is
    /// negative or above 1; [`Error::WrongForces`] if a rigid motion or a constant strain leaves more than
    /// 1e-8 of the forces around a node that is in equilibrium, or a force that is NaN.
    pub fn new(name: &str, domain: Domain, material: Elastic<f64>, options: Options) -> Result<Self> {
        let amount = match options.stabilisation {
            Stabilisation::None => 0.0,
            Stabilisation::SubCells(a) => a,
        };
        if !(0.0..=1.0).contains(&amount) {
            return Err(parameter("stabilisation", amount, "must be between 0 and 1"));
        }
        let cells = domain.voronoi()?;
        let mut smoothing = Smoothing::new(&domain, &cells, options.kind)?;
        let sub = SubCells::new(&domain, &mut smoothing, amount);
        // Weights of one: an uncoupled body, as which the model is checked below.
        let ones = vec![1.0; cells.len()];
        // Counted before the field takes the domain.
        let neighbours = domain.neighbours();
        let spread = match options.inertia {
            Inertia::Cells => None,
            Inertia::Centroids => Some(Spread::centroids(&domain, &cells, options.kind)),
        };
        let mut model = Self {
            name: name.to_owned(),
            forces: MatrixFree::new(&smoothing, &sub, &material, ones),
            field: Arc::new(NaturalField::new(domain, options.kind)),
            cells,
            material,
            options,
            smoothing,
            sub,
            spread,
            neighbours,
            patches: OnceLock::new(),
            part: None,
        };
        // Round-off of coordinates can spoil the gradients: refused here by name rather than found in
        // results.
        model.check_linear_fields()?;
        Ok(model)
    }

    /// Returns warnings about a model that works but may be inaccurate: too many natural neighbours,
    /// volumetric locking.
    pub fn warnings(&self) -> Vec<String> {
        let locking = advice::locking("natural elements", self.material.poisson(), &LOCKING);
        let neighbours = self.neighbours.warning();
        neighbours
            .into_iter()
            .chain(locking.map(|a| a.to_string()))
            .collect()
    }

    /// The domain.
    pub fn domain(&self) -> &Domain {
        self.field.domain()
    }

    /// The integration cells.
    pub fn cells(&self) -> &Voronoi {
        &self.cells
    }

    /// The material.
    pub fn material(&self) -> &Elastic<f64> {
        &self.material
    }

    /// The choices made.
    pub fn options(&self) -> Options {
        self.options
    }

    pub(crate) fn patches(&self) -> &Patches<f64> {
        self.patches.get_or_init(|| stress::patches(self))
    }

    /// Nodes with a shape function on one cell, and its smoothed gradients \[1/m\].
    pub(crate) fn smoothed_row(&self, cell: usize) -> (&[u32], &[Vector3<f64>]) {
        self.smoothing.row(cell)
    }

    /// Returns the interpolation that the coupling uses: this rank's part of a partitioned body, else the
    /// whole body.
    fn coupling_field(&self) -> Arc<dyn Interpolation<f64>> {
        match &self.part {
            Some(part) => part.field.clone(),
            None => self.field.clone(),
        }
    }

    /// Returns the displacement field of the whole body, also for a partitioned one.
    pub fn field(&self) -> Arc<NaturalField> {
        self.field.clone()
    }

    /// Number of cell facets whose centroid lies outside the domain, next to a re-entrant edge. On these
    /// facets the linear functions of a tetrahedron replace the natural-neighbour functions.
    pub fn extrapolated_facets(&self) -> usize {
        self.smoothing.extrapolated
    }

    /// Boundary of the cells on the body's surface and on crack faces, one facet per cell and triangle.
    pub fn boundary(&self) -> &[BoundaryFacet] {
        &self.smoothing.boundary
    }

    /// Returns the facets of [`CnemModel::boundary`] that satisfy a condition, for loads. The share of a node
    /// \[m²\] is the facet's area times the node's shape function at the centroid.
    ///
    /// # Errors
    /// [`Error::EmptySelection`].
    pub fn surface(&self, select: impl Fn(&BoundaryFacet) -> bool) -> Result<Vec<SurfaceFacet<f64>>> {
        let to_core = |f: &BoundaryFacet| {
            let area = f.area.norm();
            SurfaceFacet {
                nodes: f.nodes.clone(),
                // The rule of the nodal integration: a constant stress is in equilibrium with its tractions
                // to round-off.
                shares: f.values.iter().map(|v| v * area).collect(),
                centre: f.centroid,
                normal: f.area / area,
            }
        };
        let facets: Vec<_> = self
            .boundary()
            .iter()
            .filter(|f| select(f))
            .map(to_core)
            .collect();
        if facets.is_empty() {
            return Err(self.empty_selection("boundary facet", self.boundary().len()));
        }
        Ok(facets)
    }

    /// Returns the nodes that satisfy a condition, for supports and probes.
    ///
    /// # Errors
    /// [`Error::EmptySelection`].
    pub fn select_nodes(&self, select: impl Fn(&Point3<f64>) -> bool) -> Result<Vec<usize>> {
        let nodes = self.domain().nodes();
        let selected: Vec<_> = (0..nodes.len()).filter(|&i| select(&nodes[i])).collect();
        if selected.is_empty() {
            return Err(self.empty_selection("node", nodes.len()));
        }
        Ok(selected)
    }

    /// Returns the masses of the nodes \[kg\] from the cell masses, weighted by the cell `means`.
    fn masses(&self, means: &[f64]) -> Vec<f64> {
        let cells = self.cells.volumes().iter().zip(means);
        let masses: Vec<f64> = cells.map(|(v, w)| self.material.density() * v * w).collect();
        match &self.spread {
            Some(spread) => spread.gathered(&masses),
            None => masses,
        }
    }

    fn empty_selection(&self, what: &'static str, candidates: usize) -> Error {
        Error::EmptySelection {
            model: self.name.clone(),
            what,
            candidates,
        }
    }

    /// Returns the mean of a weight over every cell \[–\].
    fn cell_means(&self, weight: &dyn Weight<f64>) -> Vec<f64> {
        let mean = |work: &mut CellBodies, i: usize| {
            let bodies = self.domain().cell_bodies(&self.cells, i, work);
            // The common case: a convex cell, whose mean the weight computes exactly where it can.
            if let [body] = bodies.as_slice() {
                return weight.mean(body);
            }
            // Pieces are convex, the cell is not: means are weighted by volume.
            let (mut sum, mut total) = (0.0, 0.0);
            for (body, size) in bodies.iter().map(|b| (b, b.measure())).filter(|b| b.1 > 0.0) {
                sum += weight.mean(body) * size;
                total += size;
            }
            sum / total
        };
        (0..self.cells.len())
            .into_par_iter()
            .map_init(CellBodies::default, mean)
            .collect()
    }
}

impl Model<f64> for CnemModel {
    fn name(&self) -> &str {
        &self.name
    }

    fn kind(&self) -> &str {
        "cnem"
    }

    fn layout(&self) -> DofLayout {
        DofLayout {
            nodes: self.nodes().len(),
            components: 3,
            rotations: 0,
        }
    }

    fn nodes(&self) -> &[Point3<f64>] {
        let part = self.part.as_ref();
        part.map_or_else(|| self.domain().nodes(), |p| &p.nodes)
    }

    fn lumped_inertia(&self, weight: &dyn Weight<f64>, out: &mut [f64]) -> arlequin_core::Result<()> {
        check_size(self, "inertia", out.len())?;
        let mut masses = self.masses(&self.cell_means(weight));
        if let Some(part) = &self.part {
            masses = part.owned.iter().map(|k| masses[*k as usize]).collect();
        }
        out.chunks_exact_mut(3)
            .zip(masses)
            .for_each(|(out, m)| out.fill(m));
        arlequin_core::check_finite("weighted inertia", out)
    }

    fn set_internal_weight(&mut self, alpha: &dyn Weight<f64>) -> arlequin_core::Result<()> {
        let means = self.cell_means(alpha);
        // Checked before it is stored: a weight that is not finite would reach every later force.
        arlequin_core::check_finite("cell weights", &means)?;
        let Some(part) = &mut self.part else {
            self.forces.set_weights(&self.sub, means);
            return Ok(());
        };
        let lists = [&part.owned[..], &part.cells, &part.needed];
        self.forces.set_part_weights(&self.sub, &means, lists);
        part.alpha = means;
        Ok(())
    }

    fn add_internal_forces(&mut self, q: &[f64], f: &mut [f64]) -> arlequin_core::Result<()> {
        check_size(self, "displacements", q.len())?;
        check_size(self, "forces", f.len())?;
        match &mut self.part {
            Some(part) => return part.subtract_product(&mut self.forces, q, f),
            None => self.forces.subtract_product(q, f),
        }
        Ok(())
    }

    fn advance_with_energy(&mut self, q: &[f64], f: &mut [f64]) -> arlequin_core::Result<f64> {
        self.add_internal_forces(q, f)?;
        Ok(match &self.part {
            // The part still holds the ghost displacements received for the forces.
            Some(part) => self.forces.energy(part.owned(), q, part.received()),
            None => self.forces.energy(&self.owned(), q, q),
        })
    }

    /// Returns `½ qᵀ K_α q` \[J\]. `q` must have the length of the layout.
    fn internal_energy(&self, q: &[f64]) -> f64 {
        let Some(part) = &self.part else {
            return self.forces.energy(&self.owned(), q, q);
        };
        // After a failure of the exchange, sums over ranks are NaN.
        let x = part.receive(q).unwrap_or_else(|_| part.received().to_vec());
        self.forces.energy(part.owned(), q, &x)
    }

    fn critical_step(&mut self, inverse_inertia: &[f64]) -> arlequin_core::Result<f64> {
        check_size(self, "inverse inertia", inverse_inertia.len())?;
        let (layout, owned) = (self.layout(), self.owned());
        let forces = &mut |q: &[f64], f: &mut [f64]| self.add_internal_forces(q, f);
        spectrum::critical_step_of_nodes(inverse_inertia, layout, &owned, forces)
    }

    fn partition_among(
        &mut self,
        communicator: &Arc<dyn Communicator>,
    ) -> arlequin_core::Result<Arc<dyn Interpolation<f64>>> {
        self.keep_part(communicator)?;
        Ok(self.coupling_field())
    }

    fn owned(&self) -> Owned {
        let nodes = self.nodes().len();
        self.part
            .as_ref()
            .map_or(Owned::whole(nodes), |p| p.owned().clone())
    }

    fn views(&self) -> Views<'_, f64> {
        let is_whole = self.part.is_none();
        let mut views = Views::default();
        views.recovery = Some(self);
        views.linear = is_whole.then_some(self as _);
        views.gradients = is_whole.then_some(self as _);
        views.surface = is_whole.then_some(self as _);
        views
    }
}

impl Boundary for CnemModel {
    /// Faces of the surface; those of cracks are left out.
    fn faces(&self) -> Vec<[u32; 4]> {
        faces::faces(self.domain().nodes(), self.domain().boundary())
    }
}

impl LinearModel<f64> for CnemModel {
    /// Assembles `K_α` of the whole body, also on a rank that owns only a part.
    fn stiffness(&self) -> CsMat<f64> {
        let part = self.part.as_ref();
        let weights = part.map_or_else(|| self.forces.weights(), |p| &p.alpha);
        stiffness(&self.smoothing, &self.sub, &self.material, weights).to_csr()
    }
}

impl CoarseModel<f64> for CnemModel {
    fn coarse_field(&self) -> Arc<dyn Interpolation<f64>> {
        self.coupling_field()
    }
}

impl FineModel<f64> for CnemModel {
    fn fine_field(&self) -> Arc<dyn Interpolation<f64>> {
        self.coupling_field()
    }
}
