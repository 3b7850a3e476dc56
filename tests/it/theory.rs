//! The checks of the method against theory and literature, one test per case of the table in
//! `arlequin_studies::checks`, which `arlequin verify` prints. Cases on the line that take longer, beams and
//! parameter studies run only there.

#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]

use arlequin::core::Silent;
use arlequin_studies::checks::{Check, cantilever_cell, checks};
use arlequin_studies::line::Line;

fn assert_all_hold(checks: &[Check]) {
    let line = |c: &Check| {
        let beside = c.reference.map_or(String::new(), |r| format!(" beside {r}"));
        format!(
            "{}: {:e}{beside}, accepted {}\n",
            c.quantity,
            c.ours,
            c.accept.text()
        )
    };
    let failed: String = checks.iter().filter(|c| !c.pass).map(line).collect();
    assert!(failed.is_empty() && !checks.is_empty(), "{failed}");
}

macro_rules! cases {
    ($($test:ident: $name:literal,)*) => {
        $(#[test] fn $test() { assert_all_hold(&checks($name).unwrap()); })*
    };
}

cases! {
    table_of_end_displacements: "bauman",
    checks_1_and_2_constant_weights_are_transparent_in_the_overlap_and_an_impedance_jump_everywhere: "transmission",
    check_3_random_state_keeps_the_invariant_and_both_constraints: "invariants",
    check_4_weights_leave_the_critical_step_alone: "critical-step",
    check_5_the_scheme_filters_nothing_and_the_absorber_does: "absorber",
    check_6_patch_test_is_exact_where_it_can_be: "patch",
    check_7_reflection_below_the_cutoff: "reflection",
    check_8_a_mediator_finer_than_the_particles_is_reported_and_harmless: "rank",
    check_9_momenta_are_conserved_on_non_coincident_meshes: "momenta",
}

#[test]
fn a_coarse_cell_keeps_its_energy_where_schwarz_coupling_loses_it() {
    // Mesh ratio 1:0.6, overlap 50.8 mm: published drift of the overlapping Schwarz coupling -61.1 % at 1 ms.
    assert_all_hold(&cantilever_cell(0.6, 50.8e-3, -61.1).unwrap());
}

#[test]
fn inconsistent_start_is_projected_once() {
    let line = Line {
        coarse_elements: 20,
        fine_bonds: 100,
        ..Line::default()
    };
    let mut c = line.build(&|_| (0.0, 1.0), &|_| (0.0, -1.0)).unwrap();
    assert!(c.start_loss() > 0.0);
    assert!(c.jumps(0)[0] < 1e-12);
    c.advance(&mut Silent).unwrap();
    // Without the projection of accelerations the multipliers would alternate in sign from here on.
    let first = c.interfaces()[0].multipliers().to_vec();
    c.advance(&mut Silent).unwrap();
    let second = c.interfaces()[0].multipliers();
    let change: f64 = first
        .iter()
        .zip(second)
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f64::max);
    let size = first.iter().map(|a| a.abs()).fold(0.0, f64::max);
    assert!(change < 0.8 * size, "{change:e} of {size:e}");
}
