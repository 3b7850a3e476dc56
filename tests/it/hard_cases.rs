//! Hard cases that are fast: each keeps its promise, and its naive variant fails as stated.
//!
//! The long cases run in `arlequin verify --hard`; `docs/hard-cases.md` describes each case.

#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]

use arlequin_studies::checks::Check;
use arlequin_studies::hard::cases;

fn lines(checks: &[Check]) -> String {
    let line = |c: &Check| {
        let mark = if c.pass { " " } else { "!" };
        format!(
            "  {mark} {}: {:.4e}, accepted {}\n",
            c.quantity,
            c.ours,
            c.accept.text()
        )
    };
    checks.iter().map(line).collect()
}

/// Runs the case of the given name and fails with all its figures if one is out of range.
fn assert_promise(name: &str) {
    let known = cases();
    let case = known
        .iter()
        .find(|c| c.name == name)
        .unwrap_or_else(|| panic!("no case '{name}'"));
    let outcome = (case.run)().unwrap_or_else(|e| panic!("{name}: {e}"));
    let report = format!(
        "{name}\n{}\nnaive:\n{}ours:\n{}",
        case.promise,
        lines(&outcome.naive),
        lines(&outcome.ours)
    );
    assert!(outcome.pass(), "{report}");
    #[allow(
        clippy::print_stdout,
        reason = "shown with --nocapture, for docs/hard-cases.md"
    )]
    {
        println!("{report}");
    }
}

macro_rules! hard {
    ($($test:ident: $name:literal,)*) => {
        $(#[test] fn $test() { assert_promise($name); })*

        #[test]
        fn every_fast_case_is_tested() {
            let tested = [$($name),*];
            let missing: Vec<_> = cases().into_iter().filter(|c| c.fast && !tested.contains(&c.name)).map(|c| c.name).collect();
            assert!(missing.is_empty(), "{missing:?}");
        }
    };
}

hard! {
    small_epsilon: "epsilon 0, 1e-6, 1e-12, weights of elements",
    small_epsilon_at_nodes: "epsilon 0, 1e-6, 1e-12, weights at nodes",
    alpha_and_beta: "alpha and beta of different shape",
    fine_mediator: "L2, mediator as fine as the particles and finer",
    junction_length: "H1 junction, l from 0 to 100 h_B",
    widths: "overlap of half an element, of one, and of the whole domain",
    two_interfaces: "two interfaces close together",
    ratios: "meshes that are not nested, ratios 1:1 to 1:50",
    supports: "overlap that touches supports",
    loads: "overlap that touches loads",
    corner: "overlap around a corner and at a free surface",
    hole: "overlap around a hole",
    contrasts: "stiffness ratio 1e-4 and 1e4, density ratio 1e-3 and 1e3",
    incompressible: "Poisson's ratio 0.4999",
    slivers: "cospherical grids and slivers",
    radii: "particles with radius ratio 1:20",
    anisotropic: "anisotropic packing",
    loose: "loose packing",
    edge_of_stability: "step at 0.999 and 1.001 of the critical one",
    shock: "a shock of one step",
    inconsistent_start: "initial state that violates the constraint",
    restart: "coupled restart in the middle of a wave",
    breaking_bonds: "bonds breaking in the overlap",
    one_particle: "a particle loses all bonds in the overlap",
    fragment: "a fragment leaves the overlap",
    border: "a bond breaks on the border of the overlap",
    everything: "everything breaks at once",
    contact_of_sizes: "contact of radius ratio 1:20",
    supersonic: "an indenter at supersonic speed",
    tumbling: "a free body tumbles",
    moving_zone: "a zone that moves with a pulse",
}

#[test]
#[ignore = "seven seconds; `arlequin verify --hard` runs these"]
fn long_cases() {
    for case in cases().into_iter().filter(|c| !c.fast) {
        assert_promise(case.name);
    }
}
