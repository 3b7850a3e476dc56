//! A sweep over a chain and a bar whose runs take milliseconds.

use super::scratch;
use std::path::PathBuf;

const COUPLED: &str = r#"# A chain and a bar.
[model.chain]
kind = "chain"
role = "fine"
shape.bar = { from = -1.0, to = 1.4, section = 1.0 }
spacing = 0.02
material = { young = 1.0, density = 1.0 }

[model.bar] # the coarse one
kind = "fem"
role = "coarse"
shape.bar = { from = 1.0, to = 9.0, section = 1.0 }
spacing = 0.1 # to be varied
material = { young = 1.0, density = 1.0 }

[interface.joint]
coarse = "bar"
fine = "chain"
overlap.slab = { fine = [1.0, 0.0, 0.0], coarse = [1.4, 0.0, 0.0] }
weight = { profile = "cubic" }
mediator = { spacing = 0.1 }
"#;

const REST: &str = r#"
[[initial]]
wave = { component = "x", along = "x", centre = 0.0, width = 1.6, amplitude = 1e-3 }

[time]
end = 5.0

[probe.far]
model = "MODEL"
at = [4.0, 0.0, 0.0]
component = "x"

[probe.far-velocity]
model = "MODEL"
at = [4.0, 0.0, 0.0]
quantity = "velocity"
component = "x"
"#;

const ALONE: &str = r#"
[model.MODEL]
kind = "chain"
shape.bar = { from = -1.0, to = 9.0, section = 1.0 }
spacing = 0.02
material = { young = 1.0, density = 1.0 }
"#;

/// Six runs: the fine model alone, two coarse models alone, three couplings.
pub(crate) const SWEEP: &str = r#"
title = "Chain <and> bar"
scene = "coupled.toml"
targets = [0.2, 0.05]
reference = { run = "all-fine" }
hook = { axis = "h" }

[axis.h]
values = [[0.05, 1.2], [0.1, 1.4], [0.2, 1.8]]
set = [
    "model.bar.spacing={0}",
    "interface.joint.mediator.spacing={0}",
    "model.chain.shape.bar.to={1}",
    "interface.joint.overlap.slab.coarse=[{1}, 0.0, 0.0]",
]

[run.all-fine]
scene = "alone.toml"
mark = "all-fine"

[run.all-coarse]
scene = "alone.toml"
set = ["model.all.kind=fem", "model.all.spacing={}"]
values = [0.1, 0.2]
mark = "all-coarse"

[reflected.joint]
probe = "far"
after = 4.9
"#;

/// Creates a folder with the scenes and a sweep file.
pub(crate) fn folder(name: &str, sweep: &str) -> PathBuf {
    let path = scratch(name);
    let coupled = COUPLED.to_owned() + &REST.replace("MODEL", "bar");
    let alone = (ALONE.to_owned() + REST).replace("MODEL", "all");
    for (file, text) in [
        ("coupled.toml", &coupled),
        ("alone.toml", &alone),
        ("sweep.toml", &sweep.to_owned()),
    ] {
        std::fs::write(path.join(file), text).expect("writes");
    }
    path
}
