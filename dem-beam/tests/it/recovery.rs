//! Stress of particles and forces of bonds.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use arlequin_core::{LinkSurvey, Model, Recovered, SymmetricTensor, Weight};
use dem_beam::fracture::{Criterion, Fracture};
use dem_beam::packing::{Lattice, lattice};
use dem_beam::{BeamMaterial, Container, DemModel, PackingSpec};
use nalgebra::{Matrix3, Point3, Vector3};

fn model() -> DemModel {
    let packing = PackingSpec::quench(Container::cylinder(4e-3, 1e-3).unwrap(), 500, 3)
        .build()
        .unwrap();
    DemModel::new("bar", &packing, BeamMaterial::SILICA, 2200.0).unwrap()
}

/// Returns deterministic noise in [-1, 1].
fn noise(i: usize) -> f64 {
    ((i as f64 * 12.9898).sin() * 43_758.545_3).fract()
}

fn stresses(model: &DemModel, q: &[f64]) -> Vec<Recovered<f64>> {
    let nodes: Vec<usize> = (0..model.nodes().len()).collect();
    let mut out = Vec::new();
    model
        .views()
        .recovery
        .unwrap()
        .recover(q, &nodes, &mut out)
        .unwrap();
    out
}

#[derive(Debug)]
struct Falling;
impl Weight<f64> for Falling {
    fn value(&self, x: &Point3<f64>) -> f64 {
        1.0 - 0.95 * (x.x / 4e-3).clamp(0.0, 1.0)
    }
}

/// The stresses of the particles times their volumes sum to `Σ_i x_i ⊗ F_i`, with the forces `F_i` that hold
/// each particle against its bonds (in equilibrium the boundary forces): in any state, with small and finite
/// rotations, with and without weights in the model.
#[test]
fn mean_stress_is_that_of_the_forces_that_hold_the_body() {
    for finite in [false, true] {
        let mut model = model();
        if finite {
            model = model.with_finite_rotations();
        }
        let n = model.nodes().len();
        let q: Vec<f64> = (0..6 * n)
            .map(|i| noise(i) * if i < 3 * n { 1e-7 } else { 1e-3 })
            .collect();
        let mut f = vec![0.0; 6 * n];
        model.advance(&q, &mut f).unwrap();
        let mut held = Matrix3::zeros();
        for (i, x) in model.nodes().iter().enumerate() {
            let vector = |v: &[f64]| Vector3::new(v[3 * i], v[3 * i + 1], v[3 * i + 2]);
            let place = x.coords + if finite { vector(&q) } else { Vector3::zeros() };
            held -= place * vector(&f).transpose();
        }
        let held = SymmetricTensor::from_matrix(&held);
        let volumes = model.views().particles.unwrap().to_vec();
        let check = |values: &[Recovered<f64>]| {
            let mut sum = [0.0; 6];
            for (r, v) in values.iter().zip(&volumes) {
                assert!(r.strain.is_none());
                sum.iter_mut()
                    .zip(r.stress.0)
                    .for_each(|(s, t)| *s += t * v.measure);
            }
            let size = held.von_mises();
            for (s, h) in sum.iter().zip(held.0) {
                // The kernel rounds the stiffness of bonds to 24 bits.
                assert!((s - h).abs() < 3e-7 * size, "{finite}: {s:e}, {h:e}");
            }
        };
        let recovered = stresses(&model, &q);
        check(&recovered);
        // Frames and probes show the same bits.
        assert!(recovered.iter().map(|r| r.stress).eq(survey(&model, &q).stresses));
        if !finite {
            // The law has weights now, the stresses do not.
            model.set_internal_weight(&Falling).unwrap();
            check(&stresses(&model, &q));
        }
    }
}

#[test]
fn a_stretched_lattice_carries_tension_along_its_bonds_and_none_once_they_are_broken() {
    let cube = lattice(Lattice::Cubic, [4, 4, 4], 0.5e-3).unwrap();
    let strength = 265e9 * 2e-4;
    let fracture = Fracture::new(Criterion::Axial, strength);
    let model = DemModel::new("cube", &cube, BeamMaterial::SILICA, 2200.0).unwrap();
    let mut model = model.with_fracture(fracture).unwrap();
    let n = model.nodes().len();
    let stretch = |e: f64| {
        let mut q = vec![0.0; 6 * n];
        for (i, x) in model.nodes().iter().enumerate() {
            q[3 * i] = e * x.x;
        }
        q
    };
    let (half, twice) = (stretch(1e-4), stretch(4e-4));
    let survey = survey(&model, &half);
    let used = survey.utilisation.unwrap();
    let section = std::f64::consts::PI * (0.71 * 0.5e-3_f64).powi(2);
    let pull = 265e9 * section * 1e-4;
    for (b, [i, j]) in model.views().links.unwrap().pairs().iter().enumerate() {
        let d = model.nodes()[*j as usize] - model.nodes()[*i as usize];
        let along = f64::from(u8::from(d.x.abs() > 0.5e-3));
        let measured = (survey.axial[b] / pull, survey.shear[b] / pull);
        assert!(
            (measured.0 - along).abs() < 1e-6 && measured.1 < 1e-6,
            "{measured:?}, along x: {along}"
        );
        assert!((used[b] - 0.5 * along).abs() < 1e-7);
    }
    // One bond per section of a cell, on either side of an inner particle.
    let inner = (0..n)
        .find(|i| model.nodes()[*i].coords.iter().all(|c| (1e-3..3e-3).contains(c)))
        .unwrap();
    let volume = model.views().particles.unwrap()[inner].measure;
    let measured = stresses(&model, &half)[inner].stress;
    assert!(
        (measured.0[0] / (pull * 1e-3 / volume) - 1.0).abs() < 1e-7,
        "{measured:?}"
    );
    assert!(measured.0[1..].iter().all(|s| s.abs() < 1e-7 * measured.0[0]));
    let (mut f, mut before) = (vec![0.0; 6 * n], vec![0.0; 6 * n]);
    model.advance(&twice, &mut f).unwrap();
    let step = arlequin_core::Evolution {
        time: 0.0,
        q_before: &half,
        q: &twice,
        f_before: &mut before,
        f: &mut f,
    };
    model.evolving().unwrap().evolve(step).unwrap();
    let axial = self::survey(&model, &twice).axial;
    assert!(
        axial.iter().all(|axial| axial.abs() < 1e-7 * pull),
        "those along x are gone"
    );
    assert!(stresses(&model, &twice)[inner].stress.von_mises() < 1e-7 * measured.0[0]);
}

/// The moment of a bond is divided at the contact point of its spheres: the larger of two has the larger
/// share.
#[test]
fn of_a_bond_between_unequal_spheres_the_larger_has_the_larger_share() {
    let mut cube = lattice(Lattice::Cubic, [6, 6, 6], 0.5e-3).unwrap();
    let mut xs: Vec<f64> = cube.positions.iter().map(|x| x.x).collect();
    xs.sort_by(f64::total_cmp);
    xs.dedup_by(|a, b| (*a - *b).abs() < 1e-9);
    let lies_at = |x: &Vector3<f64>, k: usize| x.iter().all(|c| (c - xs[k]).abs() < 1e-9);
    let changed = cube.positions.iter().position(|x| lies_at(x, 2)).unwrap();
    let (small, larger) = (cube.radii[changed], 1.4 * cube.radii[changed]);
    cube.radii[changed] = larger;
    let model = DemModel::new("cube", &cube, BeamMaterial::SILICA, 2200.0).unwrap();
    // Two inner spheres that are no neighbours, by the model's numbers.
    let [large, far] = [2, 4].map(|k| model.nodes().iter().position(|x| lies_at(&x.coords, k)).unwrap());
    let mut q = vec![0.0; 6 * model.nodes().len()];
    for (i, x) in model.nodes().iter().enumerate() {
        q[3 * i] = 1e-4 * x.x;
    }
    let (values, volumes) = (stresses(&model, &q), model.views().particles.unwrap());
    let moment = |i: usize| values[i].stress.0[0] * volumes[i].measure;
    let ratio = moment(large) / moment(far);
    let wanted = 2.0 * larger / (larger + small);
    assert!((ratio / wanted - 1.0).abs() < 1e-6, "{ratio} for {wanted}");
}

/// The energy of a bond is shared where the spheres touch: the larger of two has the larger part.
#[test]
fn of_the_energy_of_a_bond_the_larger_sphere_has_the_larger_share() {
    let mut cube = lattice(Lattice::Cubic, [6, 6, 6], 0.5e-3).unwrap();
    let mut xs: Vec<f64> = cube.positions.iter().map(|x| x.x).collect();
    xs.sort_by(f64::total_cmp);
    xs.dedup_by(|a, b| (*a - *b).abs() < 1e-9);
    let here = |x: &Vector3<f64>, k: usize| x.iter().all(|c| (c - xs[k]).abs() < 1e-9);
    let changed = cube.positions.iter().position(|x| here(x, 2)).unwrap();
    let (small, large) = (cube.radii[changed], 1.4 * cube.radii[changed]);
    cube.radii[changed] = large;
    let model = DemModel::new("cube", &cube, BeamMaterial::SILICA, 2200.0).unwrap();
    let node = |k: usize| model.nodes().iter().position(|x| here(&x.coords, k)).unwrap();
    let i = node(2);
    // Only the large sphere moves: all the energy is in its six bonds.
    let mut q = vec![0.0; 6 * model.nodes().len()];
    q[3 * i] = 1e-8;
    let held = densities(&model, &q)[i] * model.views().particles.unwrap()[i].measure;
    let share = held / model.internal_energy(&q);
    let wanted = large / (large + small);
    assert!((share / wanted - 1.0).abs() < 1e-6, "{share} for {wanted}");
}

fn survey(model: &DemModel, q: &[f64]) -> LinkSurvey<f64> {
    model.views().links.unwrap().survey(q).unwrap()
}

fn densities(model: &DemModel, q: &[f64]) -> Vec<f64> {
    survey(model, q).densities
}

/// Returns the sum of the densities over the volumes of the particles, each times a factor of its place
/// \[J\].
fn total(model: &DemModel, densities: &[f64], factor: impl Fn(&Point3<f64>) -> f64) -> f64 {
    let volumes = model.views().particles.unwrap().iter();
    let pairs = densities.iter().zip(volumes);
    pairs.map(|(w, v)| w * v.measure * factor(&v.point)).sum()
}

/// The energy density of particles sums to the strain energy in random states under both laws. Weights change
/// the energy in the ledger, but not the density of the material.
#[test]
fn energy_density_of_particles_sums_to_the_strain_energy_and_knows_no_weights() {
    for finite in [false, true] {
        let mut model = model();
        if finite {
            model = model.with_finite_rotations();
        }
        let n = model.nodes().len();
        let q: Vec<f64> = (0..6 * n)
            .map(|i| noise(i) * if i < 3 * n { 1e-7 } else { 1e-3 })
            .collect();
        model.advance(&q, &mut vec![0.0; 6 * n]).unwrap();
        let plain = densities(&model, &q);
        let defect = total(&model, &plain, |_| 1.0) / model.internal_energy(&q) - 1.0;
        assert!(defect.abs() < 1e-12, "{finite}: {defect:e}");
        assert!(plain.iter().all(|w| *w > 0.0));
        if !finite {
            model.set_internal_weight(&Falling).unwrap();
            let weighted = densities(&model, &q);
            // Stiffness times weight is rounded to 24 bits.
            assert!(
                plain
                    .iter()
                    .zip(&weighted)
                    .all(|(a, b)| (a / b - 1.0).abs() < 2e-7)
            );
            // The ledger weighs each bond with its mean weight; a frame has only the weights of the
            // particles.
            let energy = model.internal_energy(&q);
            let near = total(&model, &weighted, |x| Falling.value(x)) / energy - 1.0;
            let without = total(&model, &weighted, |_| 1.0) / energy - 1.0;
            assert!(near.abs() < 0.02 && without > 0.5, "{near:e} {without:e}");
        }
    }
}

/// The energy density of a stretched cubic lattice is that of `E A ε² l/2` in each bond along x, one bond per
/// cell; broken bonds have none.
#[test]
fn energy_density_of_a_stretched_lattice_is_that_of_its_bonds_and_broken_ones_hold_none() {
    let cube = lattice(Lattice::Cubic, [4, 4, 4], 0.5e-3).unwrap();
    let model = DemModel::new("cube", &cube, BeamMaterial::SILICA, 2200.0).unwrap();
    let mut model = model
        .with_fracture(Fracture::new(Criterion::Axial, 265e9 * 2e-4))
        .unwrap();
    let n = model.nodes().len();
    let stretch = |e: f64| -> Vec<f64> {
        let along = |i: usize| e * model.nodes()[i / 3].x * f64::from(u8::from(i.is_multiple_of(3)));
        (0..6 * n)
            .map(|i| if i < 3 * n { along(i) } else { 0.0 })
            .collect()
    };
    let (half, twice) = (stretch(1e-4), stretch(4e-4));
    let section = std::f64::consts::PI * (0.71 * 0.5e-3_f64).powi(2);
    let bond = 0.5 * 265e9 * section * 1e-4 * 1e-4 * 1e-3;
    let inner = (0..n)
        .find(|i| model.nodes()[*i].coords.iter().all(|c| (1e-3..3e-3).contains(c)))
        .unwrap();
    let volume = model.views().particles.unwrap()[inner].measure;
    let density = densities(&model, &half)[inner];
    assert!((density / (bond / volume) - 1.0).abs() < 1e-9, "{density:e}");
    let (mut f, mut before) = (vec![0.0; 6 * n], vec![0.0; 6 * n]);
    model.advance(&twice, &mut f).unwrap();
    let step = arlequin_core::Evolution {
        time: 0.0,
        q_before: &half,
        q: &twice,
        f_before: &mut before,
        f: &mut f,
    };
    model.evolving().unwrap().evolve(step).unwrap();
    assert!(densities(&model, &twice)[inner].abs() < 1e-12 * density);
}
