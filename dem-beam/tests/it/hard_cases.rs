//! Hard cases with named outcomes: the messages of the model.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use arlequin_core::{Coupled, Guard, Model, PrescribedMotion, Silent, Subdomain, TimeStep, Weight, Weights};
use dem_beam::packing::{Lattice, lattice};
use dem_beam::{BeamMaterial, Container, DemModel, Error, Matter, Packing, PackingSpec};
use nalgebra::{Point3, Vector3};
use std::sync::Arc;

const MATTER: Matter = Matter {
    beam: BeamMaterial::SILICA,
    density: 2200.0,
    volume: 1e-9,
};

/// Returns a chain of three spheres with one defect.
fn chain(x: [f64; 3], r: [f64; 3], pairs: &[[u32; 2]]) -> Result<DemModel, Error> {
    let positions = x.map(|x| Vector3::new(x, 0.0, 0.0));
    DemModel::from_spheres("chain", &positions, &r, pairs, &MATTER)
}

fn text(result: Result<DemModel, Error>) -> String {
    result.unwrap_err().to_string()
}

const GOOD: [f64; 3] = [1.0; 3];
const LINE: [[u32; 2]; 2] = [[0, 1], [1, 2]];

#[test]
fn coincident_particles() {
    assert_eq!(
        text(chain([0.0, 2.0, 2.0], GOOD, &LINE)),
        "particles 1 and 2 are 0e0 m apart, below 2e-9 m: merge them or move one"
    );
    // Without a bond between them the field refuses coincident spheres, by the model's numbers.
    let unbonded = chain([0.0, 2.0, 0.0], GOOD, &LINE).unwrap_err();
    assert!(matches!(unbonded, Error::Core(_)));
    assert!(
        unbonded.to_string().contains("coincides with particle"),
        "{unbonded}"
    );
}

#[test]
fn zero_radius() {
    assert_eq!(
        text(chain([0.0, 2e-3, 4e-3], [1e-3, 0.0, 1e-3], &LINE)),
        "particle 1 has radius 0e0 m: give every particle a finite radius > 0"
    );
}

#[test]
fn isolated_particle() {
    assert_eq!(
        text(chain([0.0, 2.0, 4.0], GOOD, &LINE[..1])),
        "particle 2 has no bond (1 such particles): raise the coordination number, or keep the largest \
         connected component only"
    );
}

#[test]
fn bond_of_zero_length() {
    assert_eq!(
        text(chain([0.0, 2.0, 4.0], GOOD, &[[0, 1], [2, 2]])),
        "bond 1 between particles 2 and 2 has length 0e0 m, below 2e-9 m: remove the bond"
    );
}

#[test]
fn radius_ratio() {
    // 1:20 is accepted and gives a finite step; anything wider is refused.
    let r = [1e-3, 0.05e-3, 1e-3];
    let mut wide = chain([0.0, 1.05e-3, 2.1e-3], r, &LINE).unwrap();
    let step = wide.critical_step(&[1e9; 18]).unwrap();
    assert!(step > 0.0 && step < 1.0);
    assert_eq!(
        text(chain([0.0, 1.05e-3, 2.1e-3], [1e-3, 0.04e-3, 1e-3], &LINE)),
        "largest radius 1e-3 m is 25.0 times the smallest 4e-5 m, above 20: narrow the radius distribution"
    );
    let spec = PackingSpec {
        spread: 0.95,
        ..PackingSpec::quench(Container::cylinder(4e-3, 1e-3).unwrap(), 500, 1)
    };
    let message = spec.build().unwrap_err().to_string();
    assert!(message.contains("39.0 times the smallest"), "{message}");
}

#[test]
fn packing_larger_than_its_container() {
    let bar = Container::cylinder(4e-3, 1e-3).unwrap();
    let x = [Vector3::new(1e-3, 0.0, 0.0), Vector3::new(3.9e-3, 0.0, 0.0)];
    let message = Packing::from_spheres(&bar, &x, &[1e-3, 1e-3], 1.0)
        .unwrap_err()
        .to_string();
    assert!(
        message.starts_with("particle 1 sticks out of the container by 8.999"),
        "{message}"
    );
    assert!(
        message.ends_with("the packing is larger than its container"),
        "{message}"
    );
    let message = PackingSpec::quench(bar, 1, 1).build().unwrap_err().to_string();
    assert!(
        message.contains("ask for more particles or a wider container"),
        "{message}"
    );
}

/// Weight that is zero beyond x = 0.3 mm.
#[derive(Debug)]
struct Cut;

impl Weight<f64> for Cut {
    fn value(&self, x: &Point3<f64>) -> f64 {
        f64::from(u8::from(x.x < 0.3e-3))
    }
}

/// A particle of the overlap all of whose bonds have zero weight.
#[test]
fn particle_without_weighted_mass() {
    let bar = lattice(Lattice::Cubic, [6, 2, 2], 1e-4).unwrap();
    let model = DemModel::new("bar", &bar, BeamMaterial::SILICA, 2200.0).unwrap();
    let side = Subdomain::fine(model, Weights::from_weight(Arc::new(Cut)));
    let message = Coupled::new(vec![side], Vec::new(), TimeStep::Fraction(0.9), None)
        .unwrap_err()
        .to_string();
    assert!(
        message.contains("model 'bar': node") && message.contains("has weighted mass 0e0 kg"),
        "{message}"
    );
    assert!(
        message.contains("trim the model to its subdomain, choose epsilon > 0"),
        "{message}"
    );
}

/// Over a million steps of a clamped body the energy neither grows nor drifts. (A free body would drift away:
/// under the small-rotation law a spinning body grows without bound, and round-off with it.)
#[test]
fn million_steps() {
    let cube = lattice(Lattice::Cubic, [2, 2, 2], 1e-4).unwrap();
    let model = DemModel::new("cube", &cube, BeamMaterial::SILICA, 2200.0).unwrap();
    let n = model.layout().dofs();
    let v: Vec<f64> = (0..n)
        .map(|i| (i as f64 * 1.7).sin() * if i < n / 2 { 1.0 } else { 1e3 })
        .collect();
    let fixed = model.clamped(&model.clamp_layer(&Point3::origin(), &Vector3::x()));
    let side = Subdomain::fine(model, Weights::uncoupled())
        .with_support(PrescribedMotion::fixed(fixed))
        .with_initial(vec![0.0; n], v)
        .unwrap();
    let guard = Guard {
        interval: 1_000,
        growth: 0.05,
    };
    let mut run = Coupled::new(vec![side], Vec::new(), TimeStep::Fraction(0.9), Some(guard)).unwrap();
    assert_eq!(run.run(1_000_000, &mut Silent).unwrap(), 1_000_000);
    assert!(run.drift() < 1e-8, "{:e}", run.drift());
}
