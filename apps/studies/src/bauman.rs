//! Static coupling of a bar and springs by Bauman et al. 2008, Comput. Mech. 42:511, section 5.
//!
//! - Models: bar on (0, 2) with 4 elements; 8 springs of length 0.25 on (1, 3); overlap (1, 2).
//! - Boundary conditions: u(0) = 0; end load E/3 at x = 3, for which the bar alone would give u(3) = 1.
//! - Cases: uniform (k = 1) and alternating (k = 100, 1) springs; mediator on the particles or on the bar's
//!   nodes; alpha = 1/2 or linear; junctions L2, H1 seminorm (pinned), H1 with l = 1.
//! - Result: u(3).

use arlequin::core::effect::Load;
use arlequin::core::nalgebra::Point3;
use arlequin::core::{
    Coupled, H1Gradient, H1Seminorm, InterfaceOptions, InterfaceSpec, Junction, L2, PrescribedMotion,
    Profile, Ramp, Result, Slab, Subdomain, TimeFunction, TimeStep, Weights,
};
use arlequin::fem_ref::{Elastic, FemField, FemModel, generate};
use spring_chain::Chain;
use std::sync::Arc;

/// One row of the published table.
#[derive(Debug)]
pub struct Case {
    /// Name of the row.
    pub name: &'static str,
    /// Young's modulus of the bar.
    pub young: f64,
    /// Stiffness of each spring by its number.
    pub springs: fn(usize) -> f64,
    /// Number of mediator elements.
    pub mediator_elements: usize,
    /// Weight across the overlap.
    pub profile: Profile<f64>,
    /// Published u(3) for the junctions of [`junctions`].
    pub published: [f64; 3],
}

/// Returns the junctions of the table's columns: L2, H1 seminorm, H1.
///
/// # Errors
/// Never fails with these lengths.
pub fn junctions() -> Result<[Box<dyn Junction<f64>>; 3]> {
    Ok([
        Box::new(L2),
        Box::new(H1Seminorm::new(1.0)?),
        Box::new(H1Gradient::new(1.0)?),
    ])
}

/// Returns the five rows of the table.
#[must_use]
pub fn table() -> Vec<Case> {
    let uniform = |_| 1.0;
    let alternating = |b: usize| if b.is_multiple_of(2) { 100.0 } else { 1.0 };
    let half = || Profile::Constant(0.5);
    let case = |name, young, springs, mediator_elements, profile, published| Case {
        name,
        young,
        springs,
        mediator_elements,
        profile,
        published,
    };
    let soft = 50.0 / 101.0;
    vec![
        case(
            "uniform, particle mediator",
            0.25,
            uniform,
            4,
            half(),
            [1.0, 1.0, 1.0],
        ),
        case(
            "uniform, bar mediator",
            0.25,
            uniform,
            2,
            half(),
            [1.010417, 1.0, 1.010417],
        ),
        case(
            "alternating, particle mediator",
            soft,
            alternating,
            4,
            half(),
            [0.691822; 3],
        ),
        case(
            "alternating, bar mediator",
            soft,
            alternating,
            2,
            half(),
            [1.087272, 1.0, 1.087097],
        ),
        case(
            "alternating, bar mediator, linear weight",
            soft,
            alternating,
            2,
            Profile::Linear,
            [1.040842, 0.964384, 1.040842],
        ),
    ]
}

/// Computes u(3) of one row with one junction.
///
/// # Errors
/// Errors of the core.
pub fn end_displacement(case: &Case, junction: Box<dyn Junction<f64>>) -> Result<f64> {
    let point = |x: f64| Point3::new(x, 0.0, 0.0);
    let ramp = Ramp::new(
        Arc::new(Slab::between(point(2.0), point(1.0))?),
        case.profile.clone(),
        0.0,
    )?;
    let weights = Weights::from_weight(Arc::new(ramp));
    let bar = FemModel::new(
        "bar",
        generate::bar(0.0, 2.0, 4, 1.0)?,
        Elastic::new(case.young, 0.0, 1.0)?,
    )?;
    let chain = Chain::new("springs", 1.0, 0.25, 8, 1.0, 1.0)?.with_stiffness(case.springs);
    let fine = Weights::complement_of(std::slice::from_ref(&weights));
    // Eight springs join nodes 0 to 8.
    let load = Load::on_dofs("end", vec![(8, case.young / 3.0)], TimeFunction::Step)?;
    let subdomains = vec![
        Subdomain::coarse(bar, weights).with_support(PrescribedMotion::fixed(vec![0])),
        Subdomain::fine(chain, fine).with_effect(Box::new(load)),
    ];
    let interface = InterfaceSpec {
        name: "overlap".into(),
        coarse: 0,
        fine: 1,
        mediator: Arc::new(FemField::new(generate::bar(
            1.0,
            2.0,
            case.mediator_elements,
            1.0,
        )?)),
        junction,
        options: InterfaceOptions::default(),
    };
    // The step has no part in a static solution.
    let mut run = Coupled::new(subdomains, vec![interface], TimeStep::Fraction(0.5), None)?;
    Ok(run.equilibrium(0.0)?.displacements[1][8])
}
