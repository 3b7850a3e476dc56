//! Particles of very different size, and anisotropic and loose packings, each coupled to finite elements.

use super::{HardCase, Outcome, critical, shaken, step_of_blow_up};
use crate::solid::{self, block};
use arlequin::core::adjacency::lowest_connected;
use arlequin::core::nalgebra::Vector3;
use arlequin::core::{
    Coupled, Error, InterfaceOptions, InterfaceSpec, L2, Profile, Result, Sampling, Silent, Subdomain,
    TimeStep, Weights,
};
use arlequin::dem_beam::packing::Loose;
use arlequin::dem_beam::{BeamMaterial, Container, DemModel, Matter, Packing, PackingSpec};
use arlequin::fem_ref::{Elastic, ElementKind, FemModel};

pub(super) const CASES: &[HardCase] = &[
    HardCase {
        name: "particles with radius ratio 1:20",
        why: "masses differ by 8000; the smallest particle alone decides the step",
        naive: "a step of min sqrt(m/k): unstable",
        promise: "a safe step is found, the invariant is kept; wider ratios are refused",
        fast: true,
        run: radii,
    },
    HardCase {
        name: "anisotropic packing",
        why: "a third of the bonds across are missing: soft across, stiff along",
        naive: "a step of min sqrt(m/k): unstable",
        promise: "the invariant and the momenta are kept",
        fast: true,
        run: anisotropic,
    },
    HardCase {
        name: "loose packing",
        why: "4 bonds per particle: particles on a single beam swing",
        naive: "a step of min sqrt(m/k): unstable",
        promise: "the invariant and the momenta are kept",
        fast: true,
        run: loose,
    },
];

/// Beams that make a packing about as stiff as the elements with modulus 1.
const BEAM: BeamMaterial = BeamMaterial {
    young: 3.56,
    poisson: 0.3,
    radius_ratio: 0.71,
};

pub(super) fn spec(count: usize) -> Result<PackingSpec> {
    let body = Container::cuboid(Vector3::new(2.0, 0.0, 0.0), Vector3::new(4.0, 1.0, 1.0))?;
    Ok(PackingSpec::quench(body, count, 1))
}

fn model(packing: &Packing) -> Result<DemModel> {
    let matter = Matter {
        beam: BEAM,
        density: 1.0,
        volume: packing.volume,
    };
    Ok(DemModel::from_spheres(
        "right",
        &packing.positions,
        &packing.radii,
        &packing.pairs,
        &matter,
    )?)
}

/// Returns the naive estimate `min √(m/k_n)` over all ends of bonds \[s\], from a spring and its mass.
fn spring_rule(packing: &Packing, masses: &[f64]) -> Result<f64> {
    let mean = packing.radii.iter().sum::<f64>() / packing.radii.len() as f64;
    let rigidity = BEAM.rigidity(mean)?;
    let mut least = f64::INFINITY;
    for pair in &packing.pairs {
        let [i, j] = pair.map(|k| k as usize);
        let stiffness = rigidity.axial / (packing.positions[i] - packing.positions[j]).norm();
        least = least.min((masses[i].min(masses[j]) / stiffness).sqrt());
    }
    Ok(least)
}

fn coupled(packing: &Packing, step: TimeStep<f64>) -> Result<Coupled<f64>> {
    coupled_with(packing, step, &mut Ok)
}

/// Couples hexahedra on the left to the packing on the right; all nodes have random velocities. `change` may
/// change the model of the packing before it is coupled.
pub(super) fn coupled_with(
    packing: &Packing,
    step: TimeStep<f64>,
    change: &mut dyn FnMut(DemModel) -> Result<DemModel>,
) -> Result<Coupled<f64>> {
    let weights = solid::weights(Profile::Cubic, 0.05)?;
    let fine_weights = Weights::complement_of(std::slice::from_ref(&weights));
    let left = FemModel::new(
        "left",
        block(ElementKind::Hex8, [0.0, 3.0], [6, 2, 2])?,
        Elastic::new(1.0, 0.17, 1.0)?,
    )?;
    let right = change(model(packing)?)?;
    let bodies = [
        Subdomain::coarse(left, weights),
        Subdomain::fine(right, fine_weights),
    ];
    let mediator = solid::mediator(ElementKind::Hex8, solid::OVERLAP, [2, 2, 2])?;
    let interface = InterfaceSpec {
        options: InterfaceOptions {
            sampling: Sampling::Particles,
            ..InterfaceOptions::default()
        },
        ..solid::spec(mediator, Box::new(L2))
    };
    Coupled::new(shaken(bodies, 12)?, vec![interface], step, None)
}

/// Adds the checks of every packing: our run at 0.9 of the critical step, and the naive step.
fn measure(out: &mut Outcome, packing: &Packing) -> Result<()> {
    let mut c = coupled(packing, TimeStep::Fraction(0.9))?;
    let before = c.momentum()[0];
    let scale = solid::momentum_scale(&c)[0];
    c.run(500, &mut Silent)?;
    out.add("drift", c.drift(), 0.0..=1e-10);
    out.add("velocity jump", c.constraint_residual(), 0.0..=1e-10);
    out.add(
        "change of the linear momentum",
        (c.momentum()[0] - before).norm() / scale,
        0.0..=1e-11,
    );
    let single = model(packing)?;
    let mut masses = vec![0.0; packing.radii.len()];
    // The model reorders particles; the rule needs masses in the order of the packing.
    for (k, m) in single.order().iter().zip(single.masses()) {
        masses[*k as usize] = *m;
    }
    let naive = spring_rule(packing, &masses)?;
    out.add_naive(
        "step of min sqrt(m/k) over the critical one",
        naive / critical(&c),
        1.01..=100.0,
    );
    out.add_refusal(
        "a step of min sqrt(m/k)",
        coupled(packing, TimeStep::Seconds(naive)),
        |e| matches!(e, Error::UnstableStep { .. }),
    );
    let mut wild = coupled(packing, TimeStep::Unchecked(naive))?;
    out.add_naive(
        "step at which the run leaves all bounds",
        step_of_blow_up(&mut wild, 5000)?,
        1.0..=5000.0,
    );
    Ok(())
}

fn radii() -> Result<Outcome> {
    let mut out = Outcome::default();
    let mut wanted = spec(500)?;
    wanted.spread = 0.9;
    let mut packing = wanted.build()?;
    // The spread allows at most 1:19, so the smallest sphere is reduced to the smallest permitted radius.
    let top = packing.radii.iter().fold(0.0f64, |a, r| a.max(*r));
    let least = packing.radii.iter().fold(top, |a, r| a.min(*r));
    for r in packing.radii.iter_mut().filter(|r| **r <= least) {
        *r = top / 20.0;
    }
    let (low, high) = packing
        .radii
        .iter()
        .fold((f64::INFINITY, 0.0f64), |(a, b), r| (a.min(*r), b.max(*r)));
    out.add("radius ratio", high / low, 20.0..=20.0 + 1e-9);
    measure(&mut out, &packing)?;
    wanted.spread = 0.95;
    out.add_refusal(
        "a radius ratio of 1:39",
        wanted
            .build()
            .map_err(Into::into)
            .and_then(|p| coupled(&p, TimeStep::Fraction(0.9))),
        |e| e.to_string().contains("39.0 times the smallest"),
    );
    Ok(out)
}

/// Returns the number of particles that bonds connect to the first one.
fn connected(count: usize, pairs: &[[u32; 2]]) -> usize {
    let lowest = lowest_connected(count, pairs.iter().copied());
    lowest.into_iter().filter(|k| *k == 0).count()
}

fn anisotropic() -> Result<Outcome> {
    let mut out = Outcome::default();
    let mut packing = spec(600)?.build()?;
    let across = |p: &[u32; 2]| {
        let d = packing.positions[p[0] as usize] - packing.positions[p[1] as usize];
        d.x.abs() < 0.5 * d.norm()
    };
    let before = packing.pairs.len();
    let mut bonds = Vec::new();
    // Removes every third transverse bond, unless this cuts the body in two.
    let mut candidates = 0;
    for k in 0..before {
        let drop = across(&packing.pairs[k]) && {
            candidates += 1;
            candidates % 3 == 0
        };
        let remaining = || {
            bonds
                .iter()
                .chain(&packing.pairs[k + 1..])
                .copied()
                .collect::<Vec<_>>()
        };
        if !drop || connected(packing.radii.len(), &remaining()) < packing.radii.len() {
            bonds.push(packing.pairs[k]);
        }
    }
    out.add(
        "share of the bonds left",
        bonds.len() as f64 / before as f64,
        0.7..=0.9,
    );
    packing.pairs = bonds;
    measure(&mut out, &packing)?;
    Ok(out)
}

fn loose() -> Result<Outcome> {
    let mut out = Outcome::default();
    let mut wanted = spec(600)?;
    wanted.coordination = 4.0;
    // At this coordination some per cent have no bond; they are left out.
    wanted.loose = Loose::Drop { limit: 0.1 };
    let packing = wanted.build()?;
    let mut bonds = vec![0usize; packing.radii.len()];
    packing
        .pairs
        .iter()
        .flatten()
        .for_each(|k| bonds[*k as usize] += 1);
    out.add(
        "particles on a single beam",
        bonds.iter().filter(|n| **n == 1).count() as f64,
        1.0..=200.0,
    );
    measure(&mut out, &packing)?;
    Ok(out)
}
