//! The cohesive-beam packing as a model that can be coupled.
//!
//! The unknowns are three displacements per particle (`x0 y0 z0 x1 ...`), then three rotations per particle
//! in the same order. The coupling never touches the rotations. Particles are renumbered for locality at
//! construction, so that no call permutes anything; [`DemModel::places`] maps the packing's numbers to the
//! model's.
//!
//! Weights are energy-consistent: the stiffness of bond `b` is multiplied by `w_b`, the mean of the weight
//! over the segment between its two centres. Mass and inertia of a particle are multiplied by the mean of
//! `w_b` over its bonds. Forces therefore derive from a potential, and the stiffness is symmetric.
//! [`arlequin_core::NodallyWeighted`] offers nodal weights instead, for comparison with the literature.
//!
//! Finite rotations ([`DemModel::with_finite_rotations`]): the velocities of the rotations are spins `w`
//! about fixed axes, and their accelerations are torques over inertias, which is exact for spheres. The model
//! keeps a unit quaternion per particle, which turns by `exp(dt w)` in every step ([`Model::advance`]). The
//! rotation unknowns are the time integral of the spin, beginning at the rotation vector of the initial
//! state. Torques and forces balance about the present centres. The scheme therefore keeps angular momentum
//! to round-off, and energy as well as for translations, however far a particle turns.

mod breaking;
pub(crate) mod forces;
mod lazy;
mod octets;
mod portion;
pub(crate) mod poses;
mod recovery;
mod report;
mod select;
mod stiffness;
mod torn;
mod wanting;
mod weights;

pub use report::DemReport;
pub use select::LoadShare;
pub use select::TOUCH;

use crate::bond::BeamMaterial;
use crate::contact::RestSpheres;
use crate::critical;
use crate::error::{Error, Result};
use crate::fracture::SharedLog;
use crate::fracture::state::FractureState;
use crate::kernel::law::Linear;
use crate::kernel::order::block_order;
use crate::numbered::Numbered;
use crate::packing::{Packing, PackingReport};
use crate::particles::{BondedParticles, Contents, Matter};
use arlequin_core::effect::Finding;
use arlequin_core::ranks::{Communicator, Halo};
use arlequin_core::snapshot::Record;
use arlequin_core::sprs::CsMat;
use arlequin_core::{
    Arms, Breakable, Changed, CoarseModel, DofLayout, Drawn, Evolution, Evolving, Facts, FineModel,
    Interpolation, KeptMeans, LinearModel, Model, Owned, ParticleField, State, StepBound, Stepping, Stride,
    Views, Watching, Weight, check_size, spectrum,
};
use forces::Gather;
use lazy::Kernel;
use nalgebra::{Point3, Vector3};
use poses::Reader;
use std::ops::Range;
use std::sync::Arc;

/// Spheres joined by cohesive beams, a model that can be coupled.
#[derive(Debug)]
pub struct DemModel {
    name: String,
    body: BondedParticles,
    /// Unweighted mass \[kg\] and rotational inertia \[kg m²\].
    mass: Arc<Vec<f64>>,
    inertia: Vec<f64>,
    /// Spheres at rest for all contacts of the model, made when the first one asks for them.
    spheres: RestSpheres,
    /// Packing number of each of the model's particles, and the inverse map.
    order: Vec<u32>,
    places: Vec<u32>,
    volume: f64,
    field: Arc<ParticleField<f64>>,
    kernel: Kernel,
    packing: Option<PackingReport>,
    fracture: Option<FractureState>,
    /// Strengths that [`Watching::watch`] compares in a run without fracture; nothing breaks.
    watched: Option<FractureState>,
    log: SharedLog,
    /// Range of the bonds of each unit; a bond belongs to the unit of its first particle.
    unit_bonds: Vec<Range<usize>>,
    /// In a rank's part of a partitioned body: the ghosts, and the numbers of the bonds in the whole body.
    halo: Option<Halo>,
    numbered: Option<Numbered>,
}

impl DemModel {
    /// Makes a model of a packing with beams `beam` and density `density` \[kg/m³\]. The mass of a sphere is
    /// the density times the volume that the sphere stands for.
    ///
    /// ```
    /// use arlequin_core::Model;
    /// use dem_beam::{BeamMaterial, Container, DemModel, PackingSpec};
    /// let packing = PackingSpec::quench(Container::cylinder(4e-3, 1e-3)?, 500, 1).build()?;
    /// let model = DemModel::new("bar", &packing, BeamMaterial::SILICA, 2200.0)?;
    /// assert_eq!(model.layout().dofs(), 6 * model.nodes().len());
    /// # Ok::<(), dem_beam::Error>(())
    /// ```
    ///
    /// # Errors
    /// Errors of [`BondedParticles::new`], with the packing's particle numbers; [`Error::Periodic`].
    pub fn new(name: &str, packing: &Packing, beam: BeamMaterial, density: f64) -> Result<Self> {
        if packing.period.is_some() {
            return Err(Error::Periodic { what: "a model" });
        }
        // In the packing's numbers first, so that errors name what the caller knows.
        let body = BondedParticles::from_packing(packing, beam, density)?;
        let volumes = packing.volumes();
        let contents = Contents {
            volumes: &volumes,
            loose: packing.loose,
            period: None,
            rounded: true,
        };
        let matter = Matter {
            beam,
            density,
            volume: packing.volume,
        };
        let mut model = Self::from_body(name, body, &contents, &matter)?;
        model.packing = Some(packing.report.clone());
        Ok(model)
    }

    /// Makes a model of any spheres \[m\] with given bonds.
    ///
    /// # Errors
    /// Errors of [`BondedParticles::new`], with the caller's particle numbers.
    pub fn from_spheres(
        name: &str,
        positions: &[Vector3<f64>],
        radii: &[f64],
        pairs: &[[u32; 2]],
        matter: &Matter,
    ) -> Result<Self> {
        // In the caller's numbers first, so that errors name what the caller knows.
        let body = BondedParticles::new(positions.to_vec(), radii.to_vec(), pairs.to_vec(), matter)?;
        let volumes: Vec<f64> = body.mass().iter().map(|m| m / matter.density).collect();
        let contents = Contents {
            volumes: &volumes,
            loose: false,
            period: None,
            rounded: true,
        };
        Self::from_body(name, body, &contents, matter)
    }

    /// Makes a model of a body in the caller's numbers: renumbers its particles and sorts its bonds.
    fn from_body(
        name: &str,
        body: BondedParticles,
        contents: &Contents<'_>,
        matter: &Matter,
    ) -> Result<Self> {
        // Frees the body's other arrays before the renumbered body is built: lowers the peak of memory.
        let (positions, radii, mut pairs) = body.into_spheres();
        let order = block_order(&positions, &pairs);
        let mut places = vec![0_u32; order.len()];
        for (k, &i) in order.iter().enumerate() {
            places[i as usize] = k as u32;
        }
        for pair in &mut pairs {
            let [i, j] = pair.map(|i| places[i as usize]);
            *pair = [i.min(j), i.max(j)];
        }
        // Sorted by first particle, so that the bonds of a unit are a contiguous range.
        pairs.sort_unstable();
        let centres: Vec<Vector3<f64>> = order.iter().map(|&i| positions[i as usize]).collect();
        drop(positions);
        let radii = order.iter().map(|&i| radii[i as usize]).collect();
        let volumes: Vec<f64> = order.iter().map(|&i| contents.volumes[i as usize]).collect();
        let contents = Contents {
            volumes: &volumes,
            ..*contents
        };
        let body =
            BondedParticles::with_volumes(centres, radii, pairs, matter.density, matter.beam, &contents)?;
        // Nodes are the centres on the kernel's grid, about which the moments of bond forces balance.
        let nodes = body.positions().iter().map(|x| Point3::from(*x)).collect();
        let field = Arc::new(ParticleField::new(nodes, &volumes)?.with_gradients(body.pairs())?);
        Ok(Self {
            name: name.to_owned(),
            mass: body.unweighted_mass(),
            spheres: RestSpheres::new(field.clone(), body.shared_radii()),
            inertia: body.inertia().to_vec(),
            order,
            places,
            volume: matter.volume,
            kernel: Kernel::new(false),
            packing: None,
            fracture: None,
            watched: None,
            log: SharedLog::default(),
            unit_bonds: portion::bonds_of_units(body.pairs(), body.len()),
            halo: None,
            numbered: None,
            field,
            body,
        })
    }

    /// Centres of the owned particles: the nodes, which the field holds.
    fn centres(&self) -> &[Point3<f64>] {
        self.field.nodes()
    }

    /// Gives the body several materials. For each place, `grades` returns the Young's modulus of the beams
    /// and the density, both over those of the packing. A bond between two moduli is half of each in series.
    /// Call this before [`Self::with_finite_rotations`]. Fracture is refused, because bonds of several
    /// materials have no common strength.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] unless all are positive; [`Error::Graded`] after finite rotations or fracture;
    /// [`Error::InParts`].
    pub fn with_grades(mut self, grades: impl Fn(&Point3<f64>) -> [f64; 2]) -> Result<Self> {
        self.require_whole("the choice of materials")?;
        if self.has_finite_rotations() || self.fracture.is_some() || self.watched.is_some() {
            return Err(Error::Graded {
                what: "materials after finite rotations or fracture",
            });
        }
        let (stiffness, density): (Vec<f64>, Vec<f64>) =
            self.centres().iter().map(|x| grades(x).into()).unzip();
        self.body.grade(&stiffness, &density)?;
        self.mass = self.body.unweighted_mass();
        self.inertia = self.body.inertia().to_vec();
        self.kernel.renew();
        Ok(self)
    }

    /// Switches to the finite-rotation law; see the module text.
    #[must_use]
    pub fn with_finite_rotations(mut self) -> Self {
        self.kernel = Kernel::new(true);
        self
    }

    /// Returns whether rotations may be large.
    #[must_use]
    pub fn has_finite_rotations(&self) -> bool {
        self.kernel.is_finite()
    }

    /// Particles and bonds in the model's numbers, with the bond weights last set. In a rank's part of a
    /// partitioned body, the ghosts bonded with owned particles follow the owned particles.
    #[must_use]
    pub fn body(&self) -> &BondedParticles {
        &self.body
    }

    /// Packing number of each of the model's particles (new to old numbers).
    #[must_use]
    pub fn order(&self) -> &[u32] {
        &self.order
    }

    /// Model number of each of the packing's particles (old to new numbers); empty in a rank's part of a
    /// partitioned body.
    #[must_use]
    pub fn places(&self) -> &[u32] {
        &self.places
    }

    /// Unweighted masses \[kg\].
    #[must_use]
    pub fn masses(&self) -> &[f64] {
        &self.mass
    }

    pub(crate) fn shared_masses(&self) -> Arc<Vec<f64>> {
        self.mass.clone()
    }

    pub(crate) fn shared_spheres(&self) -> RestSpheres {
        self.spheres.clone()
    }

    /// Unweighted rotational inertias \[kg m²\].
    #[must_use]
    pub fn inertias(&self) -> &[f64] {
        &self.inertia
    }

    /// Returns the particle field: volumes `V_i = V r_i^3 / sum r^3` at the centres, gradients from the
    /// bonded neighbours.
    #[must_use]
    pub fn particle_field(&self) -> Arc<ParticleField<f64>> {
        self.field.clone()
    }

    /// Adds the forces at `q` and makes `q` the reached state; returns the energy there if `energy` is set,
    /// else zero.
    fn advance_to(&mut self, q: &[f64], f: &mut [f64], energy: bool) -> arlequin_core::Result<f64> {
        check_size(self, "displacements", q.len())?;
        check_size(self, "forces", f.len())?;
        let marks = self.fracture.as_mut().and_then(FractureState::marks);
        let kernel = self.kernel.get_or_build(&self.body, self.halo.as_ref());
        Ok(kernel.advance(q, f, marks, energy)?)
    }

    fn named_error(&self, error: &Error) -> arlequin_core::Error {
        match error {
            Error::Core(e) => e.clone(),
            e => arlequin_core::Error::of_model(&self.name, e.clone()),
        }
    }

    fn reader<'a>(&'a self, q: &'a [f64]) -> Reader<'a> {
        Reader {
            q,
            orientations: self.kernel.orientations(),
            rigidity: *self.body.rigidity(),
            ghosts: &[],
        }
    }
}

impl From<Error> for arlequin_core::Error {
    fn from(error: Error) -> Self {
        match error {
            Error::Core(e) => e,
            e => Self::of_model("dem", e),
        }
    }
}

impl Model<f64> for DemModel {
    fn name(&self) -> &str {
        &self.name
    }

    fn kind(&self) -> &str {
        "dem"
    }

    fn layout(&self) -> DofLayout {
        DofLayout {
            nodes: self.centres().len(),
            components: 3,
            rotations: 3,
        }
    }

    fn nodes(&self) -> &[Point3<f64>] {
        self.centres()
    }

    fn lumped_inertia(&self, weight: &dyn Weight<f64>, out: &mut [f64]) -> arlequin_core::Result<()> {
        let means = self.bond_means(weight, None)?;
        self.lump((weight, |b| means[b]), out)
    }

    /// Also resets the orientations to those at rest.
    fn set_internal_weight(&mut self, alpha: &dyn Weight<f64>) -> arlequin_core::Result<()> {
        self.weigh(&self.bond_means(alpha, None)?)
    }

    fn change_internal_weight(
        &mut self,
        alpha: &dyn Weight<f64>,
        changed: &Changed<f64>,
    ) -> arlequin_core::Result<()> {
        self.weigh(&self.bond_means(alpha, Some(changed))?)
    }

    fn add_internal_forces(&mut self, q: &[f64], f: &mut [f64]) -> arlequin_core::Result<()> {
        check_size(self, "displacements", q.len())?;
        check_size(self, "forces", f.len())?;
        let marks = self.fracture.as_mut().and_then(FractureState::marks);
        let kernel = self.kernel.get_or_build(&self.body, self.halo.as_ref());
        Ok(kernel.add(q, f, marks)?)
    }

    fn advance(&mut self, q: &[f64], f: &mut [f64]) -> arlequin_core::Result<()> {
        self.advance_to(q, f, false).map(|_| ())
    }

    fn advance_with_energy(&mut self, q: &[f64], f: &mut [f64]) -> arlequin_core::Result<f64> {
        self.advance_to(q, f, true)
    }

    fn stepping(&mut self) -> Option<&mut dyn Stepping<f64>> {
        self.fracture.is_none().then_some(self as _)
    }

    /// Returns the sum of the weighted bond energies \[J\]. `q` must have the length of the layout.
    fn internal_energy(&self, q: &[f64]) -> f64 {
        self.energy(q)
    }

    fn energy_from_forces(&mut self, q: &[f64]) -> f64 {
        let kernel = self.kernel.get_or_build(&self.body, self.halo.as_ref());
        // The run reports an error between ranks ([`arlequin_core::Owned::check_communication`]).
        kernel.energy(q).unwrap_or(f64::NAN)
    }

    /// Returns `2/omega_max` \[s\] by Lanczos about the reference configuration, from the largest Ritz value
    /// plus its residual, in memory of a few vectors. It exceeds the critical step by at most 5e-5 of it.
    /// Under the finite-rotation law this is the step of the undeformed body.
    fn critical_step(&mut self, inverse_inertia: &[f64]) -> arlequin_core::Result<f64> {
        check_size(self, "inverse inertia", inverse_inertia.len())?;
        let root: Vec<f64> = inverse_inertia.iter().map(|m| m.sqrt()).collect();
        let (layout, halo, owned) = (self.layout(), self.halo.clone(), self.owned());
        let space = (&root[..], layout, &owned);
        // A separate kernel of the linear law leaves the reached orientations alone.
        let top = if self.has_finite_rotations() {
            critical::largest(space, &mut Gather::<Linear>::with_halo(&self.body, halo.clone()))
        } else {
            critical::largest(space, self.kernel.get_or_build(&self.body, halo.as_ref()))
        };
        Ok(spectrum::step_of(top?))
    }

    fn evolving(&mut self) -> Option<&mut dyn Evolving<f64>> {
        self.fracture.is_some().then_some(self as _)
    }

    /// Keeps the weights and resets the orientations to those at rest.
    fn partition_among(
        &mut self,
        communicator: &Arc<dyn Communicator>,
    ) -> arlequin_core::Result<Arc<dyn Interpolation<f64>>> {
        self.bisect(communicator).map_err(|e| self.named_error(&e))
    }

    fn owned(&self) -> Owned {
        let whole = || Owned::whole(self.centres().len());
        self.halo.as_ref().map_or_else(whole, |h| h.owned().clone())
    }

    fn save(&self) -> Record<f64> {
        self.remember()
    }

    fn restore(&mut self, from: &Record<f64>) -> arlequin_core::Result<()> {
        self.recall(from.clone())
    }

    fn views(&self) -> Views<'_, f64> {
        let turns = self.has_finite_rotations();
        // The active effects are a range of this list, because either end may be left out.
        let names = &["fracture", "finite-rotations"];
        let mut views = Views::default();
        views.arms = if turns { Arms::Current } else { Arms::Reference };
        views.effects = &names[usize::from(self.fracture.is_none())..1 + usize::from(turns)];
        views.linear = (!turns && self.halo.is_none()).then_some(self as _);
        views.particles = self.field.samples();
        views.recovery = Some(self);
        views.links = Some(self);
        views.watching = Some(self);
        views.step_bound = Some(self);
        views.facts = Some(self);
        views.means = Some(self);
        let strengths_of_bonds = self.fracture.as_ref().is_some_and(|f| f.particles.is_none());
        views.breakable = strengths_of_bonds.then_some(self as _);
        views
    }
}

impl Facts for DemModel {
    fn facts(&self) -> Vec<(String, f64)> {
        self.fracture_facts()
    }
}

impl KeptMeans<f64> for DemModel {
    fn inertia_by_internal_weight(
        &self,
        alpha: &dyn Weight<f64>,
        out: &mut [f64],
    ) -> arlequin_core::Result<()> {
        self.lump((alpha, |b| self.body.weight(b)), out)
    }
}

impl StepBound<f64> for DemModel {
    fn step_bound(&self, inverse_inertia: &[f64]) -> f64 {
        let top = critical::bound(&self.body, self.centres().len(), inverse_inertia);
        spectrum::step_of(self.owned().largest(top))
    }
}

impl Stepping<f64> for DemModel {
    fn stride(&mut self, step: Stride<'_, f64>) -> arlequin_core::Result<Option<Drawn<f64>>> {
        let kernel = self.kernel.get_or_build(&self.body, self.halo.as_ref());
        Ok(kernel.stride(step)?)
    }
}

impl Evolving<f64> for DemModel {
    fn effect(&self) -> &'static str {
        "fracture"
    }

    fn evolve(&mut self, step: Evolution<'_, f64>) -> arlequin_core::Result<f64> {
        self.break_bonds(step)
    }

    fn stays(&self, q: &[f64]) -> bool {
        self.load(q) < 1.0
    }

    fn sleep(&mut self) -> bool {
        self.let_bonds_sleep()
    }
}

impl Breakable<f64> for DemModel {
    fn parts(&self) -> &[[u32; 2]] {
        self.body.pairs()
    }

    fn utilisations(&self, q: &[f64], parts: &[u32]) -> Vec<f64> {
        self.utilisations_of(q, parts)
    }
}

impl Watching<f64> for DemModel {
    /// Collective for a partitioned body.
    fn watch(&self, state: &State<f64>) -> Vec<Finding> {
        self.findings(&state.q)
    }
}

impl LinearModel<f64> for DemModel {
    /// Returns the weighted stiffness of the small-rotation law, displacements and rotations.
    fn stiffness(&self) -> CsMat<f64> {
        stiffness::assemble(&self.body)
    }
}

impl FineModel<f64> for DemModel {
    fn fine_field(&self) -> Arc<dyn Interpolation<f64>> {
        self.field.clone()
    }
}

impl CoarseModel<f64> for DemModel {
    fn coarse_field(&self) -> Arc<dyn Interpolation<f64>> {
        self.field.clone()
    }
}
