//! Packings beside elements and beside packings: the volumes that both fill in an overlap, and its mass.

#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]

use crate::support::grains::{packed, squeezed};
use crate::support::solid;
use arlequin::cnem::NaturalField;
use arlequin::cnem::natural::Interpolant;
use arlequin::core::nalgebra::Point3;
use arlequin::core::{
    Coupled, Error, InterfaceOptions, InterfaceSpec, L2, Model, Profile, Ramp, Result, Sampling, Slab,
    Subdomain, TimeStep, Weights,
};
use arlequin::dem_beam::DemModel;
use arlequin::fem_ref::generate::{self, Cylinder, Rim};
use arlequin::fem_ref::{Elastic, ElementKind, FemField, FemModel};
use std::sync::Arc;

/// Returns the weights of a coarse model over the overlap (2, 3) mm.
fn ramp() -> Weights<f64> {
    let [fine, coarse] = [3e-3, 2e-3].map(|x| Point3::new(x, 0.0, 0.0));
    let slab = Slab::between(fine, coarse).unwrap();
    Weights::from_weight(Arc::new(Ramp::new(Arc::new(slab), Profile::Cubic, 0.05).unwrap()))
}

/// Couples a body of 3 mm with a packing of 3 mm and 0.5 mm over the overlap (2, 3) mm.
fn beside_grains(left: Subdomain<f64>, grains: DemModel) -> Result<Coupled<f64>> {
    let complement = Weights::complement_of(std::slice::from_ref(left.weights()));
    let right = Subdomain::fine(grains, complement);
    let shape = Cylinder {
        ends: [2e-3, 3e-3],
        radius: 0.5e-3,
        core: 1,
        rings: 1,
        layers: 2,
        rim: Rim::Inscribed,
    };
    let space = FemField::new(generate::cylinder(ElementKind::Hex8, &shape).unwrap());
    let interface = InterfaceSpec {
        options: InterfaceOptions {
            sampling: Sampling::Particles,
            ..InterfaceOptions::default()
        },
        ..solid::spec(Arc::new(space), Box::new(L2))
    };
    Coupled::new(vec![left, right], vec![interface], TimeStep::Fraction(0.8), None)
}

fn elements(radius: f64, density: f64) -> Subdomain<f64> {
    let shape = Cylinder::with_size([0.0, 3e-3], radius, 0.2e-3).unwrap();
    let mesh = generate::cylinder(ElementKind::Hex8, &shape).unwrap();
    let material = Elastic::new(72.5e9, 0.17, density).unwrap();
    let model = FemModel::new("elements", mesh, material).unwrap();
    Subdomain::coarse(model, ramp())
}

fn mass_warnings(run: &Coupled<f64>) -> usize {
    let warnings = &run.interfaces()[0].report().warnings;
    warnings.iter().filter(|w| w.contains("weighted masses")).count()
}

#[test]
fn particles_of_64_percent_of_the_elements_section_are_refused_and_equal_ones_are_not() {
    // For any density.
    for density in [2200.0, 220.0] {
        let run = beside_grains(elements(0.5e-3, density), packed("grains", 2e-3, 2500)).unwrap();
        let report = run.partition()[0].clone();
        println!("elements and particles: {report:?}");
        assert!(
            report.excess_mass.abs() < 0.02 && mass_warnings(&run) == 0,
            "{report:?}"
        );
        let error = beside_grains(elements(0.625e-3, density), packed("grains", 2e-3, 600)).unwrap_err();
        let Error::UnequalShapes { larger, amount, .. } = &error else {
            panic!("{error}")
        };
        assert!(larger == "elements" && (amount - 0.36).abs() < 0.08, "{error}");
        // Particles beside thinner elements are detected at their places.
        let error = beside_grains(elements(0.4e-3, density), packed("grains", 2e-3, 2500)).unwrap_err();
        assert!(
            matches!(
                error,
                Error::UnequalShapes { .. } | Error::PartitionOfUnity { .. }
            ),
            "{error}"
        );
    }
}

#[test]
fn mass_that_two_packings_have_too_much_in_their_overlap_is_warned_of_with_the_number() {
    let left = packed("left", 0.0, 1500);
    let field = NaturalField::from_points(left.nodes(), Interpolant::Laplace).unwrap();
    let left = Subdomain::new(Box::new(left), Arc::new(field), ramp());
    let run = beside_grains(left, packed("grains", 2e-3, 2500)).unwrap();
    let report = &run.partition()[0];
    // Relative to the containers: 5 mm of a cylinder of 0.5 mm.
    let translations = |s: &Subdomain<f64>| s.inertia()[..3 * s.model().nodes().len()].iter().sum::<f64>();
    let mass: f64 = run.subdomains().iter().map(translations).sum();
    let section = std::f64::consts::PI * 0.25e-6;
    let truth = (mass / (3.0 * 2200.0) - 5e-3 * section) / (1e-3 * section);
    println!("two packings: {report:?}, by the containers {truth}");
    assert!((report.excess_mass - truth).abs() < 0.03, "{report:?} {truth}");
    assert_eq!(
        mass_warnings(&run),
        usize::from(report.excess_mass.abs() > 0.02),
        "{report:?}"
    );
}

/// A.3: elements of 1.1 times the particles' section count as the same body, and a warning states the
/// difference of mass.
#[test]
fn mass_that_particles_lack_beside_thicker_elements_is_warned_of_with_the_number() {
    let grains = packed("grains", 2e-3, 2500);
    let run = beside_grains(elements(0.525e-3, 2200.0), grains).unwrap();
    let report = run.partition()[0].clone();
    println!("thicker elements: {report:?}");
    assert!(
        report.excess_mass < -0.02 && report.excess_mass > -0.1,
        "{report:?}"
    );
    assert_eq!(
        mass_warnings(&run),
        1,
        "{:?}",
        run.interfaces()[0].report().warnings
    );
}

/// A.2: particles that fill the right volume in total, but crowd in one half of the overlap, are refused with
/// the place.
#[test]
fn particles_that_crowd_in_one_half_of_the_overlap_are_refused_with_the_place() {
    for (shift, refused) in [(0.0, false), (0.02e-3, false), (0.22e-3, true)] {
        let grains = squeezed("grains", 2e-3, 2500, shift);
        match beside_grains(elements(0.5e-3, 2200.0), grains) {
            Ok(_) => assert!(!refused, "{shift}"),
            Err(Error::UnevenFilling {
                amount, point, limit, ..
            }) => {
                println!("moved by {shift}: {amount:.2} at {point:?}");
                assert!(
                    refused && amount > limit && (2e-3..3e-3).contains(&point[0]),
                    "{shift}"
                );
            }
            Err(other) => panic!("{shift}: {other}"),
        }
    }
}
