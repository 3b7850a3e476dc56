//! The static coupling of bar and springs of Bauman et al. 2008, section 5: every cell of the table of u(3).

#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]

use arlequin_studies::bauman;

#[test]
fn table_of_end_displacements() {
    for case in bauman::table() {
        for (junction, expected) in bauman::junctions().unwrap().into_iter().zip(case.published) {
            let name = junction.name();
            let u = bauman::end_displacement(&case, junction).unwrap();
            assert!(
                (u - expected).abs() <= 1e-6,
                "{}, {name}: u(3) = {u:.7}, published {expected}",
                case.name
            );
        }
    }
}
