//! A free body that tumbles: orientations do not add as vectors do.

use super::{HardCase, Outcome, step_of_blow_up};
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::core::{
    Coupled, DofLayout, FineModel, Model, Result, Silent, Subdomain, TimeStep, Views, Weight, Weights,
};
use arlequin::dem_beam::packing::{Lattice, lattice};
use arlequin::dem_beam::{BeamMaterial, DemModel};
use std::f64::consts::PI;

pub(super) const CASES: &[HardCase] = &[HardCase {
    name: "a free body tumbles",
    why: "rotations do not add: the sum of the spins of a body whose axis wanders is no orientation",
    naive: "orientation from the spin added up over time as a rotation vector: leaves all bounds within half a turn",
    promise: "linear and angular momentum to round-off, the balance to second order, however far it turns",
    fast: true,
    run: tumbling,
}];

/// Angular velocity of the box \[rad/s\], about none of its principal axes.
const SPIN: Vector3<f64> = Vector3::new(900.0, 2_000.0, 1_500.0);

/// Beams that do not update their orientations after a step: the default of [`Model::advance`].
struct Forgetful(DemModel);

impl Model<f64> for Forgetful {
    fn name(&self) -> &str {
        self.0.name()
    }
    fn kind(&self) -> &str {
        self.0.kind()
    }
    fn layout(&self) -> DofLayout {
        self.0.layout()
    }
    fn nodes(&self) -> &[Point3<f64>] {
        self.0.nodes()
    }
    fn lumped_inertia(&self, w: &dyn Weight<f64>, out: &mut [f64]) -> Result<()> {
        self.0.lumped_inertia(w, out)
    }
    fn set_internal_weight(&mut self, w: &dyn Weight<f64>) -> Result<()> {
        self.0.set_internal_weight(w)
    }
    fn add_internal_forces(&mut self, q: &[f64], f: &mut [f64]) -> Result<()> {
        self.0.add_internal_forces(q, f)
    }
    fn internal_energy(&self, q: &[f64]) -> f64 {
        self.0.internal_energy(q)
    }
    fn critical_step(&mut self, inverse_inertia: &[f64]) -> Result<f64> {
        self.0.critical_step(inverse_inertia)
    }
    fn views(&self) -> Views<'_, f64> {
        let mut views = Views::default();
        views.arms = self.0.views().arms;
        views
    }
}

/// Builds a box of 120 spheres whose initial state is a rigid rotation.
fn spinning(wrap: fn(DemModel) -> Box<dyn Model<f64>>) -> Result<Coupled<f64>> {
    let packing = lattice(Lattice::Cubic, [4, 5, 6], 1e-3)?;
    let model = DemModel::new("box", &packing, BeamMaterial::SILICA, 2200.0)?.with_finite_rotations();
    let centre = model.nodes().iter().map(|x| x.coords).sum::<Vector3<f64>>() / model.nodes().len() as f64;
    let mut v: Vec<f64> = Vec::new();
    for x in model.nodes() {
        v.extend(SPIN.cross(&(x.coords - centre)).iter());
    }
    // Translations come first, then rotations.
    (0..model.nodes().len()).for_each(|_| v.extend(SPIN.iter()));
    let field = model.fine_field();
    let side = Subdomain::new(wrap(model), field, Weights::uncoupled());
    let side = side.with_initial(vec![0.0; v.len()], v)?;
    Coupled::new(vec![side], Vec::new(), TimeStep::Fraction(0.9), None)
}

fn tumbling() -> Result<Outcome> {
    let mut out = Outcome::default();
    let mut ours = spinning(|m| Box::new(m))?;
    // Steps of one revolution.
    let turn = (2.0 * PI / SPIN.norm() / ours.dt()).ceil() as usize;
    ours.run(3 * turn, &mut Silent)?;
    let body = &ours.bodies()[0];
    out.add("change of the linear momentum", body.drift[0], 0.0..=1e-10);
    out.add("change of the angular momentum", body.drift[1], 0.0..=1e-10);
    out.add("drift", ours.drift(), 0.0..=1e-6);
    out.add(
        "warnings, such as of momenta that changed",
        ours.warnings().len() as f64,
        0.0..=0.0,
    );
    let mut naive = spinning(|m| Box::new(Forgetful(m)))?;
    let end = step_of_blow_up(&mut naive, turn)? * naive.dt() * SPIN.norm();
    out.add_naive("angle at which it leaves all bounds (rad)", end, 0.0..=PI);
    Ok(out)
}
