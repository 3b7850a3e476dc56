//! Mistyped numbers that ask for more than any machine has give a named error, without an abort or an endless
//! run.

use crate::common::{arlequin, scene, text};

#[test]
fn sizes_beyond_any_memory_are_refused_by_name() {
    for (file, set, named) in [
        (
            "bar-1d.toml",
            "model.chain.spacing=1e-9",
            "6.0e8 elements of that length fill",
        ),
        (
            "bar-1d.toml",
            "model.chain.spacing=1e-320",
            "more than 2e308 elements of that length fill",
        ),
        (
            "bar-1d.toml",
            "model.bar.spacing=1e-300",
            "elements of that length fill",
        ),
        (
            "bar-1d.toml",
            "interface.joint.mediator.spacing=1e-9",
            "4.0e7 elements of that length fill",
        ),
        (
            "quickstart.toml",
            "model.left.spacing=1e-300",
            "elements of that length fill",
        ),
        (
            "dem-fem-beam.toml",
            "model.right.spacing=1e-9",
            "4.2e19 spheres of that diameter",
        ),
        ("bar-1d.toml", "time.end=1e300", "time.end = 1e300:"),
        (
            "bar-1d.toml",
            "time.step.fraction=1e-300",
            "choose an earlier end",
        ),
    ] {
        let path = scene(file);
        let out = arlequin(&["check", text(&path), "--set", set]);
        let error = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(2), "{set}: {error}");
        assert!(
            !error.contains("panicked") && error.contains(named),
            "{set}: {error}"
        );
    }
}
