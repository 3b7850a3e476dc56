//! The finite element model: weighted stiffness and lumped mass; can be the coarse or the fine side of a
//! coupling.
//!
//! `M_β q̈ = F_ext,γ − K_α q` with `K_α = Σ_e α_e K_e` and `M_β,i = Σ_e β_e ρ ∫_e N_i dV`, where `α_e` and
//! `β_e` are the means of the weights over the element.

use crate::element::{self, ElementKind};
use crate::error::{Error, Result, parameter};
use crate::field::FemField;
use crate::kernel;
use crate::mesh::{Facet, Mesh};
use crate::portion::Part;
use crate::recovery;
use arlequin_core::blocks::BlockMatrix;
use arlequin_core::geometry::inner_bounds;
use arlequin_core::ranks::Communicator;
use arlequin_core::{
    Boundary, Changed, CoarseModel, DofLayout, Elastic, FineModel, Interpolation, KeptMeans, LinearModel,
    Materials, Model, Owned, Patches, Real, StepBound, Views, Weight, advice, check_size, spectrum,
};
use nalgebra::Point3;
use rayon::prelude::*;
use sprs::CsMat;
use std::sync::{Arc, OnceLock};

/// Locking of hexahedra and tetrahedra. Each row holds Poisson's ratio, the relative excess stiffness of a
/// thick-walled ring under inner pressure, and the relative error of its hoop stress at the inner face.
/// Measured in `apps/scene/tests/it/locking.rs`.
const LOCKING: [(ElementKind, &str, [[f64; 3]; 6]); 2] = [
    (
        ElementKind::Hex8,
        "hexahedra",
        [
            [0.3, 0.014, -0.042],
            [0.4, 0.023, -0.054],
            [0.45, 0.041, -0.076],
            [0.49, 0.184, -0.232],
            [0.499, 1.788, -0.885],
            [0.4999, 17.823, -1.296],
        ],
    ),
    (
        ElementKind::Tet4,
        "tetrahedra",
        [
            [0.3, 0.055, 0.062],
            [0.4, 0.080, 0.111],
            [0.45, 0.119, 0.197],
            [0.49, 0.271, 0.467],
            [0.499, 0.474, 0.104],
            [0.4999, 0.519, -0.190],
        ],
    ),
];

/// A linear elastic body meshed with finite elements. Bars have axial displacements only.
#[derive(Debug, Clone)]
pub struct FemModel<T: Real> {
    pub(crate) name: String,
    pub(crate) field: Arc<FemField<T>>,
    pub(crate) materials: Materials<T>,
    /// Unweighted lumped mass contributions `ρ ∫ N_i dV` \[kg\], per element and corner.
    pub(crate) masses: Vec<T>,
    pub(crate) stiffness: BlockMatrix<T>,
    /// True if the elements have few shapes, in the whole body.
    repeated: bool,
    /// Means of the weight of the internal energy over the elements \[–\].
    pub(crate) means: Vec<T>,
    /// Patches that recover stresses at the nodes, built at the first request.
    pub(crate) patches: OnceLock<Patches<T>>,
    /// This rank's part, if the body is partitioned.
    pub(crate) part: Option<Part<T>>,
}

impl<T: Real> FemModel<T> {
    /// Makes a model with all weights one, that is, an uncoupled body.
    ///
    /// ```
    /// use arlequin_core::Model;
    /// use fem_ref::{Elastic, FemModel, generate};
    /// let bar = FemModel::new("bar", generate::bar(0.0, 1.0, 10, 1.0)?, Elastic::new(1.0, 0.0, 1.0)?)?;
    /// let stretched: Vec<f64> = bar.nodes().iter().map(|p| 0.01 * p.x).collect();
    /// assert!((bar.internal_energy(&stretched) - 0.5e-4).abs() < 1e-16);
    /// # Ok::<(), fem_ref::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::BarDirection`] for bars that are not parallel to x; [`Error::Parameter`] if the materials are
    /// for another number of elements.
    pub fn new(name: &str, mesh: Mesh<T>, material: impl Into<Materials<T>>) -> Result<Self> {
        let materials = material.into();
        if let Some(n) = materials.elements().filter(|n| *n != mesh.element_count()) {
            let rule = "must be that of the elements of the mesh";
            return Err(parameter("number of elements with a material", n, rule));
        }
        if mesh.kind() == ElementKind::Bar2 {
            bars_along_x(&mesh)?;
        }
        let corners = mesh.kind().corners();
        let mut masses = Vec::with_capacity(mesh.connectivity().len());
        for e in 0..mesh.element_count() {
            let volumes = element::nodal_volumes(mesh.kind(), &mesh.corners(e), mesh.section());
            masses.extend(volumes[..corners].iter().map(|v| *v * materials.at(e).density()));
        }
        let ones = vec![T::one(); mesh.element_count()];
        let repeated = kernel::repeat(&mesh);
        Ok(Self {
            name: name.to_owned(),
            stiffness: kernel::stiffness(&mesh, &materials, &ones, repeated),
            repeated,
            means: ones,
            field: Arc::new(FemField::new(mesh)),
            materials,
            masses,
            patches: OnceLock::new(),
            part: None,
        })
    }

    /// The mesh. In a part of a body it holds two layers: the elements around owned nodes, and the elements
    /// around the nodes of the first layer.
    pub fn mesh(&self) -> &Mesh<T> {
        self.field.mesh()
    }

    /// The material; if there are several, the first one. See [`FemModel::materials`].
    pub fn material(&self) -> &Elastic<T> {
        &self.materials.all()[0]
    }

    /// Materials of all elements.
    pub fn materials(&self) -> &Materials<T> {
        &self.materials
    }

    /// Warnings about the accuracy of results: locking of elements.
    pub fn warnings(&self) -> Vec<String> {
        let kind = self.mesh().kind();
        let largest = self
            .materials
            .all()
            .iter()
            .map(|m| m.poisson().as_f64())
            .fold(-1.0, f64::max);
        let rows = LOCKING.iter().filter(|(element_kind, ..)| *element_kind == kind);
        let advice = rows.filter_map(|(_, elements, rows)| advice::locking(elements, largest, rows));
        advice.map(|a| a.to_string()).collect()
    }

    pub(crate) fn patches(&self) -> &Patches<T> {
        let is_awake = |e: usize| self.means[e] > T::zero();
        self.patches
            .get_or_init(|| recovery::patches(self.mesh(), &is_awake))
    }

    /// The displacement field; in a part of a body it covers the elements whose nodes are all owned.
    pub fn field(&self) -> Arc<FemField<T>> {
        self.part.as_ref().map_or(&self.field, |p| &p.field).clone()
    }

    /// Number of a mesh node among the model's own nodes; `None` for a node of another rank.
    fn row(&self, node: u32) -> Option<usize> {
        self.part.as_ref().map_or(Some(node as usize), |p| p.row(node))
    }

    /// Mean of a weight over every element \[–\].
    fn element_means(&self, weight: &dyn Weight<T>) -> Vec<T> {
        let elements = (0..self.mesh().element_count()).into_par_iter();
        elements.map(|e| self.element_mean(e, weight)).collect()
    }

    fn element_mean(&self, e: usize, weight: &dyn Weight<T>) -> T {
        let mut cells = Vec::new();
        self.field.cells_of(e, &mut cells);
        // A single cell is the element: weighting it by its own measure would only add round-off.
        if let [cell] = cells.as_slice() {
            return weight.mean(cell);
        }
        let (mut sum, mut total) = (T::zero(), T::zero());
        for cell in &cells {
            sum += weight.mean(cell) * cell.measure();
            total += cell.measure();
        }
        sum / total
    }

    /// Assembles the stiffness for means of the weight over the elements, and keeps them.
    fn assemble(&mut self, means: Vec<T>) -> arlequin_core::Result<()> {
        arlequin_core::check_finite("element weights", &means)?;
        let part = &self.part;
        let row = |node: u32| part.as_ref().map_or(Some(node as usize), |p| p.row(node));
        let mesh = self.field.mesh();
        let weights = (&means[..], self.repeated);
        kernel::assemble(&mut self.stiffness, mesh, &self.materials, weights, &row);
        let mut pairs = self.means.iter().zip(&means);
        if pairs.any(|(old, new)| (*old > T::zero()) != (*new > T::zero())) {
            // Patches leave out elements that sleep.
            self.patches = OnceLock::new();
        }
        self.means = means;
        Ok(())
    }

    /// Writes the lumped inertia for means of the weight over the elements.
    fn lump(&self, means: &[T], out: &mut [T]) -> arlequin_core::Result<()> {
        check_size(self, "inertia", out.len())?;
        let (mesh, c) = (self.mesh(), self.layout().components);
        let corners = mesh.kind().corners();
        out.fill(T::zero());
        for (slot, (&node, mass)) in mesh.connectivity().iter().zip(&self.masses).enumerate() {
            // The owner of the node adds up the same terms in the same order.
            let Some(k) = self.row(node) else { continue };
            let m = *mass * means[slot / corners];
            out[k * c..(k + 1) * c].iter_mut().for_each(|o| *o += m);
        }
        arlequin_core::check_finite("weighted inertia", out)
    }
}

fn bars_along_x<T: Real>(mesh: &Mesh<T>) -> Result<()> {
    for element in 0..mesh.element_count() {
        let p = mesh.corners(element);
        let d = p[1] - p[0];
        let angle = d.yz().norm() / d.norm();
        // Below this angle, an axial length differs from the true one by round-off only.
        if angle > T::epsilon().sqrt() {
            return Err(Error::BarDirection {
                element,
                angle: angle.asin().as_f64(),
            });
        }
    }
    Ok(())
}

impl<T: Real> Model<T> for FemModel<T> {
    fn name(&self) -> &str {
        &self.name
    }

    fn kind(&self) -> &str {
        "fem"
    }

    fn layout(&self) -> DofLayout {
        DofLayout {
            nodes: self.nodes().len(),
            components: self.mesh().kind().components(),
            rotations: 0,
        }
    }

    fn nodes(&self) -> &[Point3<T>] {
        self.part.as_ref().map_or(self.mesh().nodes(), |p| &p.nodes)
    }

    fn lumped_inertia(&self, weight: &dyn Weight<T>, out: &mut [T]) -> arlequin_core::Result<()> {
        self.lump(&self.element_means(weight), out)
    }

    fn set_internal_weight(&mut self, alpha: &dyn Weight<T>) -> arlequin_core::Result<()> {
        self.assemble(self.element_means(alpha))
    }

    fn change_internal_weight(
        &mut self,
        alpha: &dyn Weight<T>,
        changed: &Changed<T>,
    ) -> arlequin_core::Result<()> {
        let mean = |(e, old): (usize, &T)| {
            let mut cells = Vec::new();
            self.field.cells_of(e, &mut cells);
            if cells.iter().any(|c| changed(&inner_bounds(c))) {
                self.element_mean(e, alpha)
            } else {
                *old
            }
        };
        self.assemble(self.means.par_iter().enumerate().map(mean).collect())
    }

    fn add_internal_forces(&mut self, q: &[T], f: &mut [T]) -> arlequin_core::Result<()> {
        check_size(self, "displacements", q.len())?;
        check_size(self, "forces", f.len())?;
        match &mut self.part {
            Some(part) => return part.subtract_product(&self.stiffness, q, f),
            None => self.stiffness.subtract_product(q, f),
        }
        Ok(())
    }

    fn advance_with_energy(&mut self, q: &[T], f: &mut [T]) -> arlequin_core::Result<T> {
        self.add_internal_forces(q, f)?;
        Ok(match &self.part {
            // The forces have just received the displacements of ghosts.
            Some(part) => self
                .stiffness
                .energy_over_ranks(part.owned(), q, part.displacements()),
            None => self.stiffness.energy(q),
        })
    }

    /// `½ qᵀ K_α q` \[J\]. `q` must have the length of the layout.
    fn internal_energy(&self, q: &[T]) -> T {
        let Some(part) = &self.part else {
            return self.stiffness.energy(q);
        };
        // After a failure of the exchange, sums over ranks are NaN.
        let x = part.receive(q).unwrap_or_else(|_| part.displacements().to_vec());
        self.stiffness.energy_over_ranks(part.owned(), q, &x)
    }

    fn critical_step(&mut self, inverse_inertia: &[T]) -> arlequin_core::Result<T> {
        check_size(self, "inverse inertia", inverse_inertia.len())?;
        let (layout, owned) = (self.layout(), self.owned());
        let forces = &mut |q: &[T], f: &mut [T]| self.add_internal_forces(q, f);
        spectrum::critical_step_of_nodes(inverse_inertia, layout, &owned, forces)
    }

    fn partition_among(
        &mut self,
        communicator: &Arc<dyn Communicator>,
    ) -> arlequin_core::Result<Arc<dyn Interpolation<T>>> {
        self.keep_part(communicator)?;
        Ok(self.field())
    }

    fn owned(&self) -> Owned {
        let nodes = self.nodes().len();
        self.part
            .as_ref()
            .map_or(Owned::whole(nodes), |p| p.owned().clone())
    }

    fn views(&self) -> Views<'_, T> {
        let is_whole = self.part.is_none();
        let mut views = Views::default();
        views.recovery = Some(self);
        views.linear = is_whole.then_some(self as _);
        views.step_bound = is_whole.then_some(self as _);
        views.means = Some(self);
        let is_solid = self.mesh().kind() != ElementKind::Bar2;
        views.gradients = (is_whole && is_solid).then_some(self as _);
        views.surface = (is_whole && is_solid).then_some(self as _);
        views
    }
}

impl<T: Real> KeptMeans<T> for FemModel<T> {
    fn inertia_by_internal_weight(&self, _: &dyn Weight<T>, out: &mut [T]) -> arlequin_core::Result<()> {
        self.lump(&self.means, out)
    }
}

impl<T: Real> StepBound<T> for FemModel<T> {
    /// Bound by Gershgorin's circles, `ω² ≤ max_i Σ_j |K_ij| / M_i`: about half of the critical step.
    fn step_bound(&self, inverse_inertia: &[T]) -> T {
        let c = self.layout().components;
        let mut top = T::zero();
        for (i, inverse) in inverse_inertia.chunks_exact(c).enumerate() {
            // Each block is `c` columns of `c` values.
            let columns = self.stiffness.row_values(i).chunks_exact(c);
            for (a, inverse) in inverse.iter().enumerate() {
                let row: T = columns.clone().map(|column| column[a].abs()).sum();
                top = top.max(row * *inverse);
            }
        }
        T::of(2.0) / top.sqrt()
    }
}

impl<T: Real> Boundary for FemModel<T> {
    fn faces(&self) -> Vec<[u32; 4]> {
        let mesh = self.mesh();
        let nodes = |facet: &Facet| {
            let nodes = mesh.facet_nodes(*facet);
            [0, 1, 2, 3].map(|k: usize| nodes[k.min(nodes.len() - 1)])
        };
        mesh.boundary().iter().map(nodes).collect()
    }
}

impl<T: Real> LinearModel<T> for FemModel<T> {
    /// `K_α`; in a part of a body, the rows of owned nodes with columns for all nodes of [`FemModel::mesh`].
    fn stiffness(&self) -> CsMat<T> {
        self.stiffness.to_csr()
    }
}

impl<T: Real> CoarseModel<T> for FemModel<T> {
    fn coarse_field(&self) -> Arc<dyn Interpolation<T>> {
        self.field()
    }
}

impl<T: Real> FineModel<T> for FemModel<T> {
    fn fine_field(&self) -> Arc<dyn Interpolation<T>> {
        self.field()
    }
}
