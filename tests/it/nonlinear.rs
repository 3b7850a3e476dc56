//! A sound nonlinear law: finite strain of tetrahedra.

#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]

use crate::support::solid;
use arlequin::core::nalgebra::{Matrix3, Matrix3x4, Matrix4, Point3, Vector3};
use arlequin::core::{
    Arms, CoarseModel, Coupled, DofLayout, Interpolation, L2, Model, Profile, Result, Silent, Subdomain,
    TimeStep, Views, Warning, Weight, Weights, conformance,
};
use arlequin::fem_ref::{ElementKind, FemField, FemModel, Mesh};
use std::sync::Arc;

/// Tetrahedra of Saint Venant and Kirchhoff, `ψ = λ/2 (tr E)² + μ E:E` with `E = ½(FᵀF − 1)`, λ = μ = 0.4.
struct Finite {
    linear: FemModel<f64>,
    /// Nodes, gradients of the shape functions, and weighted volume of each element.
    elements: Vec<([usize; 4], Matrix3x4<f64>, f64)>,
    /// Factor on the forces of the law; one for a sound law.
    share: f64,
}

impl Finite {
    fn new(name: &str, mesh: Mesh<f64>, share: f64) -> Self {
        Self {
            linear: FemModel::new(name, mesh, solid::material()).unwrap(),
            elements: Vec::new(),
            share,
        }
    }

    fn strain(&self, q: &[f64], (nodes, slopes, _): &([usize; 4], Matrix3x4<f64>, f64)) -> [Matrix3<f64>; 3] {
        let mut f = Matrix3::identity();
        for (k, node) in nodes.iter().enumerate() {
            f += Vector3::from_column_slice(&q[3 * node..3 * node + 3]) * slopes.column(k).transpose();
        }
        let e = (f.transpose() * f - Matrix3::identity()) * 0.5;
        let s = Matrix3::identity() * (0.4 * e.trace()) + e * 0.8;
        [f, e, s]
    }
}

impl Model<f64> for Finite {
    fn name(&self) -> &str {
        self.linear.name()
    }
    fn kind(&self) -> &str {
        "finite strain"
    }
    fn layout(&self) -> DofLayout {
        self.linear.layout()
    }
    fn nodes(&self) -> &[Point3<f64>] {
        self.linear.nodes()
    }
    fn lumped_inertia(&self, weight: &dyn Weight<f64>, out: &mut [f64]) -> Result<()> {
        self.linear.lumped_inertia(weight, out)
    }
    fn set_internal_weight(&mut self, alpha: &dyn Weight<f64>) -> Result<()> {
        self.linear.set_internal_weight(alpha)?;
        let mesh = self.linear.mesh();
        let element = |e: usize| {
            let nodes: [usize; 4] = std::array::from_fn(|k| mesh.element(e)[k] as usize);
            let x = nodes.map(|n| mesh.nodes()[n]);
            let full = Matrix4::from_fn(|i, k| if i == 0 { 1.0 } else { x[k][i - 1] });
            let inverse = full.try_inverse().unwrap();
            let slopes = Matrix3x4::from_fn(|i, k| inverse[(k, i + 1)]);
            let cell = arlequin::core::geometry::Cell::Polyhedron(
                arlequin::core::geometry::Polyhedron::tetrahedron(x),
            );
            (nodes, slopes, full.determinant().abs() / 6.0 * alpha.mean(&cell))
        };
        self.elements = (0..mesh.element_count()).map(element).collect();
        Ok(())
    }
    fn add_internal_forces(&mut self, q: &[f64], f: &mut [f64]) -> Result<()> {
        for element in &self.elements {
            let [gradient, _, stress] = self.strain(q, element);
            let first = gradient * stress * (element.2 * self.share);
            for (k, node) in element.0.iter().enumerate() {
                let pull = first * element.1.column(k);
                (0..3).for_each(|c| f[3 * node + c] -= pull[c]);
            }
        }
        Ok(())
    }
    fn internal_energy(&self, q: &[f64]) -> f64 {
        let density = |element: &([usize; 4], Matrix3x4<f64>, f64)| {
            let [_, e, s] = self.strain(q, element);
            0.5 * element.2 * e.component_mul(&s).sum()
        };
        self.elements.iter().map(density).sum()
    }
    fn critical_step(&mut self, inverse: &[f64]) -> Result<f64> {
        Ok(0.7 * self.linear.critical_step(inverse)?)
    }
    fn views(&self) -> Views<'_, f64> {
        let mut views = Views::default();
        views.arms = Arms::Current;
        views
    }
}

impl CoarseModel<f64> for Finite {
    fn coarse_field(&self) -> Arc<dyn Interpolation<f64>> {
        Arc::new(FemField::new(self.linear.mesh().clone()))
    }
}

fn block(x: [f64; 2], counts: [usize; 3]) -> Mesh<f64> {
    solid::block(ElementKind::Tet4, x, counts)
}

/// E.6: a sound law of finite strain passes all conformance checks at any amplitude; a law whose forces have
/// no energy fails.
#[test]
fn conformance_passes_a_sound_law_of_finite_strain_at_any_amplitude() {
    for amplitude in [1e-3, 1e-2, 0.03] {
        let mut sound = Finite::new("body", block([0.0, 2.0], [4, 2, 2]), 1.0);
        sound.set_internal_weight(&arlequin::core::Uniform(1.0)).unwrap();
        let defects = [
            conformance::rigid_forces(&mut sound, amplitude).unwrap(),
            conformance::forces_derive_from_energy(&mut sound, amplitude).unwrap(),
            conformance::symmetric_forces(&mut sound, amplitude).unwrap(),
        ];
        println!("{amplitude:e}: {defects:?}");
        assert!(defects.iter().all(|d| *d < 1e-6), "{amplitude:e}: {defects:?}");
        let mut wrong = Finite::new("body", block([0.0, 2.0], [4, 2, 2]), 1.01);
        wrong.set_internal_weight(&arlequin::core::Uniform(1.0)).unwrap();
        let defect = conformance::forces_derive_from_energy(&mut wrong, amplitude).unwrap();
        assert!((0.005..0.02).contains(&defect), "{defect}");
    }
}

/// Couples two blocks of finite strain in a wave of velocity `speed`, in units of the bar wave speed.
fn run(speed: f64, step: f64, share: f64, ratio: usize) -> Coupled<f64> {
    let w = solid::weights(Profile::Cubic, 0.05);
    let complement = Weights::complement_of(std::slice::from_ref(&w));
    let moving = |s: Subdomain<f64>| {
        let v: Vec<f64> = s
            .model()
            .nodes()
            .iter()
            .flat_map(|x| {
                [
                    speed * (2.0 * x.x).sin(),
                    speed * (x.x + x.z).cos(),
                    -speed * x.y * x.x,
                ]
            })
            .collect();
        s.with_initial(vec![0.0; v.len()], v).unwrap()
    };
    let left = Finite::new("left", block([0.0, 3.0], [6, 2, 2]), share);
    let right = Finite::new("right", block([2.0, 4.0], [6, 3, 3]), share);
    let bodies = vec![
        moving(Subdomain::coarse(left, w)),
        moving(Subdomain::coarse(right, complement)).with_step(arlequin::core::OwnStep::Ratio(ratio)),
    ];
    let space = solid::mediator(ElementKind::Hex8, solid::OVERLAP, [2, 1, 1]);
    Coupled::new(
        bodies,
        vec![solid::spec(space, Box::new(L2))],
        TimeStep::Seconds(step),
        None,
    )
    .unwrap()
}

/// E.1: the drift of a nonlinear law is of second order in the step, is explained as such and gives no
/// warning; a law that loses energy gives a warning and ends the run.
#[test]
fn the_drift_of_finite_strain_is_of_second_order_and_explained() {
    let drifts = [0.04, 0.02, 0.01].map(|step| {
        let mut run = run(0.05, step, 1.0, 1);
        run.run((20.0 / step) as usize, &mut Silent).unwrap();
        println!(
            "step {step}: drift {:e}, explained {:e}",
            run.drift(),
            run.explained_drift()
        );
        assert!(run.drift() < run.explained_drift(), "{:e}", run.drift());
        let energy = |w: &Warning| matches!(w, Warning::EnergyDrift { .. });
        assert!(!run.warnings().iter().any(energy), "{:?}", run.warnings());
        run.drift()
    });
    assert!(drifts[2] > 1e-9, "{drifts:?}");
    for pair in drifts.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!((1.5..2.6).contains(&order), "{drifts:?}");
    }
    // A tenth of the forces has no energy.
    let mut wrong = run(0.05, 0.02, 0.9, 1);
    let end = wrong.run(1000, &mut Silent);
    println!("{end:?} {:?}", wrong.warnings());
    assert!(end.is_err() || !wrong.warnings().is_empty());
}

/// B.1: with one explicit step per macro step angular momentum about the present positions is claimed and
/// conserved; with more own steps neither holds, and the report names the reason.
#[test]
fn angular_momentum_about_present_positions_is_claimed_only_with_one_step_each() {
    use arlequin::core::Claim;
    for ratio in [1, 2, 3, 7] {
        let mut run = run(0.05, 0.01 * ratio as f64, 1.0, ratio);
        run.run(2000 / ratio, &mut Silent).unwrap();
        let body = run.bodies().remove(0);
        println!("{ratio}: {:?} {:?}", body.drift, body.claim);
        assert!(
            body.arms == Arms::Current && body.drift[0] < 1e-12,
            "{ratio}: {:?}",
            body.drift
        );
        match (ratio, &body.claim) {
            (1, Claim::Both) => assert!(body.drift[1] < 1e-12, "{:?}", body.drift),
            (m, Claim::Linear(why)) if m > 1 => {
                assert!(
                    body.drift[1] > 1e-8,
                    "{ratio}: it is kept after all, {:?}",
                    body.drift
                );
                let wanted = format!("'right' makes {m} own steps between two reflections");
                assert!(why.starts_with(&wanted), "{why}");
            }
            (m, claim) => panic!("{m}: {claim:?}"),
        }
        assert!(run.last_energy().unwrap().momentum_drift[1] < 1e-12);
    }
}
