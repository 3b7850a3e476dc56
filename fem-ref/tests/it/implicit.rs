//! The implicit scheme of the core on a bar.

#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]

use arlequin_core::effect::BodyForce;
use arlequin_core::nalgebra::Vector3;
use arlequin_core::{Coupled, OwnStep, Silent, Subdomain, TimeFunction, TimeStep, Weights};
use fem_ref::{Elastic, FemModel, generate};

/// Under a growing uniform load the implicit scheme integrates the velocity of a free bar to round-off, and
/// its displacement by the trapezoidal rule.
#[test]
fn the_implicit_scheme_takes_its_loads_in_the_middle_of_a_step() {
    let (rate, end) = (3e-3_f64, 200.0_f64);
    for step in [2.0, 8.0, 40.0] {
        let bar = generate::bar(-100.0, 0.0, 10, 1.0).unwrap();
        let bar = FemModel::new("bar", bar, Elastic::new(1.0, 0.0, 1.0).unwrap()).unwrap();
        let pull = BodyForce::new(Vector3::new(rate * end, 0.0, 0.0)).unwrap();
        let pull = pull.over_time(TimeFunction::Ramp { duration: end }).unwrap();
        let bar = Subdomain::coarse(bar, Weights::uncoupled())
            .with_step(OwnStep::Implicit)
            .with_effect(Box::new(pull));
        let mut c = Coupled::new(vec![bar], Vec::new(), TimeStep::Seconds(step), None).unwrap();
        c.run((end / step) as usize, &mut Silent).unwrap();
        let v = rate * end * end / 2.0;
        let q = rate * (end.powi(3) / 6.0 + step * step * end / 12.0);
        let state = c.subdomains()[0].state();
        for (name, values, exact) in [("v", &state.v, v), ("q", &state.q, q)] {
            let worst = values.iter().fold(0.0_f64, |m, x| m.max((x / exact - 1.0).abs()));
            assert!(worst < 1e-12, "{name}, steps of {step}: {worst:e}");
        }
        assert!(c.drift() < 1e-12, "steps of {step}: {:e}", c.drift());
    }
}
