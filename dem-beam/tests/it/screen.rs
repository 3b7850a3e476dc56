//! The screening of strengths in the force kernel finds the same breaks as comparing every bond, to the bit.
#![allow(clippy::unwrap_used, reason = "a test may")]

use arlequin_core::{Coupled, Model, Partition, Silent, Subdomain, TimeStep, Weight, Weights};
use dem_beam::fracture::locked;
use dem_beam::{BeamMaterial, Container, Criterion, DemModel, Fracture, Packing, PackingSpec, Scatter};
use nalgebra::Point3;
use std::sync::Arc;

fn packing() -> Packing {
    PackingSpec::quench(Container::cylinder(4e-3, 1e-3).unwrap(), 700, 3)
        .build()
        .unwrap()
}

/// Weight that rises from 0.01 on the left to one: lightly weighted bonds break as well.
#[derive(Debug)]
struct Part;

impl Weight<f64> for Part {
    fn value(&self, x: &Point3<f64>) -> f64 {
        (4e3 * (x.x - 0.2e-3)).clamp(0.01, 1.0)
    }
}

/// Returns the number of breaks, and the bits of all breaks and of the final displacements.
fn history(model: DemModel, steps: usize) -> (usize, Vec<u64>) {
    let log = model.break_log();
    let n = model.layout().dofs();
    let mut v = vec![0.0; n];
    for (i, x) in model.nodes().iter().enumerate() {
        // The body is pulled, bent and twisted.
        v[3 * i] = 2.5e4 * (x.x - 2e-3) * (1.0 + 2e2 * x.y);
        v[3 * i + 1] = -1.2e4 * x.z * x.x / 4e-3;
        v[3 * i + 2] = 1.2e4 * x.y * x.x / 4e-3;
        v[n / 2 + 3 * i] = 1.2e4 * x.x / 4e-3;
    }
    // One side of an overlap, deliberately alone.
    let side = Subdomain::fine(model, Weights::from_weight(Arc::new(Part)))
        .with_partition(Partition::Unchecked)
        .with_initial(vec![0.0; n], v)
        .unwrap();
    let mut run = Coupled::new(vec![side], Vec::new(), TimeStep::Fraction(0.5), None).unwrap();
    run.run(steps, &mut Silent).unwrap();
    let log = locked(&log);
    let mut bits = Vec::new();
    for e in log.events() {
        bits.extend([e.time, e.released, e.distance].map(f64::to_bits));
        bits.extend([e.bond, e.pair[0], e.pair[1]].map(u64::from));
    }
    bits.extend(run.subdomains()[0].state().q.iter().map(|x| x.to_bits()));
    (log.events().len(), bits)
}

#[test]
fn marked_blocks_hold_every_bond_that_breaks() {
    let packing = packing();
    let strengths = [
        (Criterion::Axial, 400e6),
        (Criterion::Rankine, 900e6),
        (Criterion::Mises, 900e6),
        (Criterion::Energy, 80.0),
        (Criterion::TensileEnergy, 40.0),
        (Criterion::Hydrostatic, 100e6),
    ];
    for (k, (criterion, strength)) in strengths.into_iter().enumerate() {
        for finite in [false, true] {
            let scatter = if k % 2 == usize::from(finite) {
                Scatter::Weibull { modulus: 6.0 }
            } else {
                Scatter::None
            };
            let spec = Fracture {
                scatter,
                every: 1 + k % 3,
                ..Fracture::new(criterion, strength)
            };
            let model = || {
                let m = DemModel::new("bar", &packing, BeamMaterial::SILICA, 2200.0).unwrap();
                let m = if finite { m.with_finite_rotations() } else { m };
                m.with_fracture(spec).unwrap()
            };
            let (broken, screened) = history(model(), 400);
            let (_, plain) = history(model().with_plain_checks(), 400);
            assert!(
                broken > 100 && broken < packing.pairs.len(),
                "{criterion:?}, finite {finite}: {broken} of {}",
                packing.pairs.len()
            );
            assert!(screened == plain, "{criterion:?}, finite {finite}");
        }
    }
}

/// Where round-off could hide a break, bonds are compared one by one: strengths next to round-off, and
/// rotations far beyond the range of the linear law's squares.
#[test]
fn where_round_off_could_hide_a_break_bonds_are_compared_one_by_one() {
    let packing = packing();
    for (strength, turn) in [(1e-3, 0.0), (900e6, 3e4)] {
        let model = || {
            DemModel::new("bar", &packing, BeamMaterial::SILICA, 2200.0)
                .unwrap()
                .with_fracture(Fracture::new(Criterion::Rankine, strength))
                .unwrap()
        };
        let history = |model: DemModel| {
            let log = model.break_log();
            let n = model.layout().dofs();
            let mut q = vec![0.0; n];
            for (i, x) in model.nodes().iter().enumerate() {
                // A rigid rotation, which the linear law permits, and a little strain.
                q[3 * i + 1] = -turn * x.z + 1e-3 * x.y * (x.x / 4e-3);
                q[3 * i + 2] = turn * x.y;
                q[n / 2 + 3 * i] = turn;
            }
            let side = Subdomain::fine(model, Weights::uncoupled())
                .with_initial(q, vec![0.0; n])
                .unwrap();
            let mut run = Coupled::new(vec![side], Vec::new(), TimeStep::Fraction(0.5), None).unwrap();
            run.run(3, &mut Silent).unwrap();
            let log = locked(&log);
            let bits = log
                .events()
                .iter()
                .flat_map(|e| [u64::from(e.bond), e.released.to_bits()]);
            bits.collect::<Vec<_>>()
        };
        let screened = history(model());
        assert!(
            screened == history(model().with_plain_checks()),
            "{strength} {turn}"
        );
        assert!(strength > 1.0 || screened.len() > 100);
    }
}
