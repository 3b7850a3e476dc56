//! The quick variants of the benchmarks of fracture at rest, which `arlequin verify --fracture` runs in full.
//! Rows that do not hold in full (`docs/`) are not asserted here.

#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]

use arlequin_studies::checks::{Check, checks};

/// Asserts that a case has these rows, and that they hold.
fn hold(checks: &[Check], rows: &[&str]) {
    for row in rows {
        let found = checks.iter().find(|c| c.quantity == *row);
        let check = found.unwrap_or_else(|| panic!("no row '{row}'"));
        assert!(
            check.pass,
            "{row}: {:e} beside {:?}, accepted {}",
            check.ours,
            check.reference,
            check.accept.text()
        );
    }
    for check in checks {
        // A row of a table must fit on a line.
        assert!(check.ours.is_finite() || !check.pass, "{}", check.quantity);
        assert!(check.quantity.chars().count() <= 60, "{}", check.quantity);
    }
}

#[test]
#[ignore = "minutes"]
fn the_strength_of_edge_cracked_bars_falls_with_the_root_of_their_crack() {
    hold(
        &checks("edge").unwrap(),
        &["power of the strength over J E/sigma^2"],
    );
}

/// Both closed forms lie above the energy lost, because bonds behind the front still hold
/// (`docs/edge-cracks.md`); but not by more than a quarter, and they agree with each other.
#[test]
#[ignore = "minutes"]
fn the_bonds_of_a_double_cantilever_release_the_fracture_energy() {
    let checks = checks("dcb").unwrap();
    hold(
        &checks,
        &[
            "J of finite elements over the closed form of the load",
            "released energy per area over gc",
        ],
    );
    let ratio = |row: &str| checks.iter().find(|c| c.quantity == row).unwrap().ours;
    let [load, opening] = ["load", "opening"].map(|by| ratio(&format!("energy by {by} over energy lost")));
    assert!((0.95..1.25).contains(&load), "{load}");
    assert!((load / opening - 1.0).abs() < 0.08, "{load} and {opening}");
}

#[test]
#[ignore = "a minute"]
fn a_blunt_ball_makes_a_ring_where_particles_break() {
    hold(&checks("cone").unwrap(), &["particles: runs with a ring"]);
}

#[test]
#[ignore = "minutes"]
fn strengths_and_the_pure_shear_test_are_measured() {
    hold(
        &checks("circles").unwrap(),
        &[
            "strength in uniaxial tension [MPa]",
            "pure shear: released energy per area over gc",
        ],
    );
}
