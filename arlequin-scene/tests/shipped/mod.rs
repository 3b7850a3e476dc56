//! Shipped scenes that go in parts, for ranks as threads and as processes.

/// Shipped scenes with bodies in parts, coarser and shorter.
pub(crate) const SHIPPED: [(&str, &[&str]); 6] = [
    (
        "beam-a-alone",
        &[
            "model.whole.spacing=0.3e-3",
            "time.end=3e-7",
            "output.probe_every=1",
        ],
    ),
    (
        "beam-a",
        &[
            "model.right.spacing=0.3e-3",
            "time.end=1e-6",
            "output.probe_every=1",
        ],
    ),
    (
        "beam-b-alone",
        &[
            "model.whole.spacing=2e-3",
            "time.end=2e-6",
            "output.probe_every=1",
        ],
    ),
    (
        "beam-b",
        &[
            "model.left.spacing=5e-3",
            "model.right.spacing=1.8e-3",
            "time.end=6e-6",
            "output.probe_every=1",
        ],
    ),
    (
        "dem-fem-beam",
        &[
            "model.left.spacing=0.5e-3",
            "model.right.spacing=0.28e-3",
            "time.end=6e-7",
        ],
    ),
    ("three-levels", &["model.near.spacing=0.5e-3", "time.end=2e-6"]),
];
