//! Particles of several materials in one packing.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use arlequin_core::{Model, Uniform, conformance};
use dem_beam::fracture::{Criterion, Fracture};
use dem_beam::packing::{Lattice, lattice};
use dem_beam::{BeamMaterial, Container, DemModel, PackingSpec};
use nalgebra::Point3;

fn energy_and_mass(model: &DemModel, q: &[f64]) -> [f64; 2] {
    let mut m = vec![0.0; q.len()];
    model.lumped_inertia(&Uniform(1.0), &mut m).unwrap();
    let translations = 3 * model.nodes().len();
    [
        model.internal_energy(q),
        m[..translations].iter().step_by(3).sum(),
    ]
}

/// Returns a packing with the grade 1, and with stiffnesses 2.5 and densities 0.5 times as large.
fn plain_and_graded() -> [DemModel; 2] {
    let packing = PackingSpec::quench(Container::cylinder(4e-3, 1e-3).unwrap(), 400, 3)
        .build()
        .unwrap();
    let model = || DemModel::new("bar", &packing, BeamMaterial::SILICA, 2200.0).unwrap();
    [model(), model().with_grades(|_| [2.5, 0.5]).unwrap()]
}

#[test]
fn one_grade_everywhere_scales_energy_and_mass() {
    let [plain, graded] = plain_and_graded();
    let q: Vec<f64> = (0..plain.layout().dofs())
        .map(|k| 1e-6 * (0.7 * k as f64).sin())
        .collect();
    let ([u, m], [v, n]) = (energy_and_mass(&plain, &q), energy_and_mass(&graded, &q));
    // The kernel stores stiffnesses with 24 bits.
    assert!(
        (v / u - 2.5).abs() < 1e-6 && (n / m - 0.5).abs() < 1e-12,
        "{v} {u} {n} {m}"
    );
}

/// Stresses must count the stiffness of each bond, not that of the material of the packing.
#[test]
fn stresses_scale_with_the_grade() {
    let [plain, graded] = plain_and_graded();
    let q: Vec<f64> = (0..plain.layout().dofs())
        .map(|i| 1e-7 * (i as f64).sin())
        .collect();
    let survey = |m: &DemModel| m.views().links.unwrap().survey(&q).unwrap();
    let (plain, graded) = (survey(&plain), survey(&graded));
    for (a, b) in plain.stresses.iter().zip(&graded.stresses) {
        // Stored stiffnesses have 24 bits.
        assert!((a.von_mises() * 2.5 / b.von_mises() - 1.0).abs() < 1e-6);
    }
}

/// A row of spheres of two grades stretches like springs `k` in a row: three soft bonds, one of a soft and a
/// stiff half, three stiff ones.
#[test]
fn a_row_of_two_grades_stretches_as_springs_in_a_row() {
    let row = lattice(Lattice::Cubic, [8, 1, 1], 0.5e-3).unwrap();
    let plain = DemModel::new("row", &row, BeamMaterial::SILICA, 1.0).unwrap();
    let mut xs: Vec<f64> = plain.nodes().iter().map(|x| x.x).collect();
    xs.sort_by(f64::total_cmp);
    let middle = 0.5 * (xs[0] + xs[7]);
    let (soft, stiff) = (1.0, 4.0);
    let grade = |x: &Point3<f64>| [if x.x < middle { soft } else { stiff }, 1.0];
    let graded = DemModel::new("row", &row, BeamMaterial::SILICA, 1.0)
        .unwrap()
        .with_grades(grade)
        .unwrap();
    // Each bond alone is stretched: all spheres beyond it move away.
    for (k, w) in xs.windows(2).enumerate() {
        let cut = 0.5 * (w[0] + w[1]);
        let mut q = vec![0.0; graded.layout().dofs()];
        for (i, _) in graded.nodes().iter().enumerate().filter(|(_, x)| x.x > cut) {
            q[3 * i] = 1e-6;
        }
        let ratio = graded.internal_energy(&q) / plain.internal_energy(&q);
        let in_row = 2.0 * soft * stiff / (soft + stiff);
        let wanted = [soft, soft, soft, in_row, stiff, stiff, stiff][k];
        assert!((ratio / wanted - 1.0).abs() < 1e-6, "bond {k}: {ratio}");
    }
}

#[test]
fn forces_of_graded_particles_derive_from_their_energy_under_any_weight() {
    let packing = PackingSpec::quench(Container::cylinder(4e-3, 1e-3).unwrap(), 300, 5)
        .build()
        .unwrap();
    let plain = DemModel::new("bar", &packing, BeamMaterial::SILICA, 2200.0).unwrap();
    let mut model = plain
        .with_grades(|x| [1.0 + 500.0 * x.x, 2.0 - 100.0 * x.x])
        .unwrap();
    model.set_internal_weight(&Uniform(0.3)).unwrap();
    let defect = conformance::forces_derive_from_energy(&mut model, 1e-6).unwrap();
    assert!(defect < 1e-5, "{defect:e}");
}

#[test]
fn grades_that_make_no_sense_and_strengths_of_several_materials_are_refused() {
    let packing = PackingSpec::quench(Container::cylinder(4e-3, 1e-3).unwrap(), 200, 1)
        .build()
        .unwrap();
    let model = || DemModel::new("bar", &packing, BeamMaterial::SILICA, 2200.0).unwrap();
    let e = model().with_grades(|_| [0.0, 1.0]).unwrap_err().to_string();
    assert!(e.contains("stiffnesses of particles"), "{e}");
    let strong = || Fracture::new(Criterion::Axial, 1e8);
    let e = model()
        .with_grades(|_| [1.0, 1.0])
        .unwrap()
        .with_fracture(strong())
        .unwrap_err()
        .to_string();
    assert!(e.contains("give the model one material"), "{e}");
    assert!(
        model()
            .with_fracture(strong())
            .unwrap()
            .with_grades(|_| [1.0, 1.0])
            .is_err()
    );
    assert!(
        model()
            .with_finite_rotations()
            .with_grades(|_| [1.0, 1.0])
            .is_err()
    );
}
