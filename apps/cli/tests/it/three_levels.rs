//! Three levels in a row: the middle model is fine beside one neighbour and coarse beside the other.

use crate::common::{number, scene, scratch, succeed, summary, text, unwrapped};

#[test]
fn three_levels_with_overlaps_that_touch_are_one_system() {
    let out = scratch("three-levels").join("out");
    let path = scene("three-levels.toml");
    let printed = unwrapped(&succeed(&[
        "run",
        "--verbose",
        text(&path),
        "--out",
        text(&out),
        "--set",
        "model.near.dem.protocol=quench",
    ]));
    assert!(
        printed.contains("together with 'east'") && printed.contains("together with 'west'"),
        "{printed}"
    );
    let s = summary(&out);
    assert!(number(&s, "/energy/h_drift_max") < 1e-12, "{}", s["energy"]);
    for k in 0..2 {
        let jump = number(&s, &format!("/interface/{k}/max_constraint_residual"));
        assert!(jump < 1e-11, "interface {k}: {jump:e}");
    }
}
