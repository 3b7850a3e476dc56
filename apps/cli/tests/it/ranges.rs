//! Ranges and rules of the schemas: program and schema refuse the same values.

use crate::common::sweeps::{self, SWEEP};
use crate::common::{SMALL, arlequin, schemas::verdict, scratch, text};
use arlequin_scene::Source;
use arlequin_scene::spec::schema;
use arlequin_scene::sweep::PlannedSweep;
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::Path;

/// Spheres with effects of particles.
const GRAINS: &str = r#"
[model.grains]
kind = "dem"
shape.box = { low = [0.0, 0.0, 0.0], high = [2e-3, 2e-3, 2e-3] }
material = { young = 75e9, poisson = 0.17, density = 2200.0 }
dem = { count = 200, protocol = "quench", young = 265e9 }
[[effect]]
fracture = { criterion = "axial", strength = 1e9 }
[[effect]]
contact = {}
[[effect]]
obstacle = { shape.sphere = { centre = [0.0, 0.0, 5e-3], radius = 1e-3 }, mass = 1.0 }
[[effect]]
local_damping = { share = 0.1 }
[time]
steps = 3
"#;

/// A body with a zone, at rest.
const ZONE: &str = r#"
[body]
kind = "cnem"
shape.box = { low = [0.0, 0.0, 0.0], high = [12.0, 2.0, 2.0] }
divisions = [12, 2, 2]
material = { young = 1.0, poisson = 0.2, density = 1.0 }
[zone.tip]
kind = "fem"
spacing = 0.5
shape.box = { low = [9.0, -1.0, -1.0], high = [13.0, 3.0, 3.0] }
overlap.width = 3.0
[[support]]
model = "body"
where = "x-min"
[static]
steps = 1
"#;

/// A solver in another process.
const LINK: &str = r#"
[model.beyond]
kind = "link"
command = ["no-such-program"]
[time]
steps = 1
"#;

/// Mistakes in each scene, as assignments. Without a value, the key is removed. The program refuses all of
/// them, the schema those above the line.
const MISTAKES: [(&str, &str); 4] = [
    (
        SMALL,
        r#"
model.left.spacng = 1.0
model.left.spacing = "wide"
model.left.spacing = 0.0
model.left.spacing = nan
model.left.divisions = [6, 1, 1]
model.left.role = "coarsest"
model.left.kind = "fdm"
model.left.material.young = 0.0
model.left.material.density = 0.0
model.left.material.poisson = 0.4999999
model.left.material.poisson = -0.9999999
model.left.shape = { ball = { centre = [0.0, 0.0, 0.0], radius = 0.0 } }
model.left.shape = { cylinder = { from = [0.0, 0.0, 0.0], length = 0.0, radius = 1.0 } }
model.left.shape = { cylinder = { from = [0.0, 0.0, 0.0], length = 1.0, radius = 0.0 } }
model.left.shape = { bar = { from = 0.0, to = 6.0, section = 0.0 } }
model.left.shape.box.low = [0.0, 0.0]
model.left.step = {}
model.left.step.ratio = 0
model.left.step.fraction = 1.5
model.left.step.fraction = 0.0
model.left.step = { scheme = "implicit", ratio = 2 }
model.left.timeout = 1.0
model.left.material =
model =
model."le ft" = { kind = "fem", spacing = 1, shape = { bar = { from = 0, to = 1, section = 1 } }, material = { young = 1, density = 1 } }
interface."j;1" = { coarse = "left", fine = "right", overlap = { slab = { coarse = [4, 0, 0], fine = [6, 0, 0] } } }
probe."t/p" = { model = "right", where = "x-max", component = "x" }
curve."x y" = { x = "tip", y = "tip" }
interface.joint.weight.profile = "kubic"
interface.joint.weight.profile = "constant"
interface.joint.weight.value = 0.5
interface.joint.weight = { profile = "constant", value = 1.1 }
interface.joint.weight = { profile = "constant", value = -0.1 }
interface.joint.weight.weighting = "even"
interface.joint.weight.epsilon = 0.5
interface.joint.weight.epsilon = -0.1
interface.joint.weight.fine_epsilon = 0.5
interface.joint.weight.fine_epsilon = -0.1
interface.joint.weight.alpha = { profile = "linear", value = 0.5 }
interface.joint.weight.alpha = { profile = "kubic" }
interface.joint.weight.alpha = { profile = "constant", value = 1.1 }
interface.joint.weight.alpha = { profile = "constant", value = -0.1 }
interface.joint.weight.beta = { profile = "linear", epsilon = 0.5 }
interface.joint.weight.gamma = { profile = "linear", epsilon = -0.1 }
interface.joint.mediator.spacing = 0.0
interface.joint.mediator.scale = 0.0
interface.joint.mediator.divisions = [2, 0, 1]
interface.joint.mediator.divisions = []
interface.joint.mediator.divisions = [2, 1, 1, 1]
interface.joint.sampling = "everywhere"
interface.joint.method = "glue"
interface.joint.partition = "loose"
interface.joint.junction.kind = "l3"
interface.joint.junction = { kind = "l2", length = 1.0 }
interface.joint.junction = { kind = "h1-strain", length = -1.0 }
interface.joint.solver = "multigrid"
interface.joint.absorber = { rate = 1.0, rate_factor = 0.2 }
interface.joint.absorber = { rate = 1.0, spacing = 0.0 }
interface.joint.absorber = { rate = -1.0 }
interface.joint.absorber = { rate_factor = -0.1 }
interface.joint.overlap = { shell = { core = { ball = { centre = [5, 0, 0], radius = 0 } }, domain = { ball = { centre = [5, 0, 0], radius = 2 } } } }
interface.joint.overlap = { shell = { core = { ball = { centre = [5, 0, 0], radius = 1 } }, domain = { cylinder = { point = [5, 0, 0], axis = [0, 1, 0], radius = 0 } } } }
interface.joint.overlap = { shell = { core = { ball = { centre = [5, 0, 0], radius = 1 } }, domain = { cylinder = { point = [5, 0, 0], axis = [0, 0, 0], radius = 2 } } } }
support.0.where = 3
support.0.components = []
support.0.motion = { amplitude = 1.0, speed = 1.0 }
load.0.name = "tip, end"
load.0.name = " "
load.0.pressure = 1.0
load.0.force =
load.0.time = { pulse = { duration = 0.0 } }
load.0.time = { ramp = { duration = 0.0 } }
load.0.time = { pulse = { duration = 2.0 }, ramp = { duration = 1.0 } }
load.0.time = { pulse = { duration = 2.0, delay = 1.0 } }
load.0.time = { table = [] }
load.0.time = { expression = "" }
load.0 = { model = "right", where = "x-max", torque = [0.0, 0.0, 0.0], time = "step" }
time =
time.steps = 0
time.steps = -1
time.end = 1.0
time = { end = 0.0 }
time.step.fraction = 1.0
time.step.fraction = 0.0
time.step.seconds = 0.0
initial = [{}]
initial = [{ wave = { component = "x", along = "x", centre = 0.0, width = 0.0, amplitude = 1.0 } }]
effect = [{}]
effect = [{ prestress = {}, local_damping = { share = 0.1 } }]
effect = [{ mass_damping = { rate = -1.0 } }]
effect = [{ stiffness_damping = { time = -1.0 } }]
effect = [{ bulk_viscosity = { coefficient = -1.0 } }]
effect = [{ local_damping = { share = 1.0 } }]
effect = [{ local_damping = { share = -0.1 } }]
output.every = 0
output = { every = 2, interval = 1.0 }
output.interval = 0.0
output.energy_every = 0
output.probe_every = 0
output.checkpoint_every = 0
output.fields = ["heat"]
probe.tip.at = [7.0, 0.5, 0.5]
probe.tip.where =
probe.tip.model =
probe.tip.component =
probe.tip.quantity = "von-mises"
probe.tip.about = [0.0, 0.0, 0.0]
probe.tip = { model = "left", quantity = "energy-release", crack = { front = [[0, 0, 0], [0, 1, 0]], direction = [0, 0, 0], radii = [0.1, 0.2] } }
probe.tip = { model = "left", quantity = "energy-release", crack = { front = [[0, 0, 0], [0, 1, 0]], direction = [1, 0, 0], radii = [0, 0.2] } }
----
model = {}
model.left.shape.box.high = [-6.0, 1.0, 1.0]
model.left.spacing = 1000.0
model.left.spacing = 1e-9
model.left.material.poisson =
interface.joint.fine = "rigth"
interface.joint.overlap.slab.fine = [4.0, 0.0, 0.0]
support.0.where = "left-end"
support.0.where = { box = { low = [20.0, 0.0, 0.0], high = [21.0, 1.0, 1.0] } }
load.0.time = { table = [[0.0, 1.0], [0.0, 2.0]] }
load.0.time = { expression = "sin(" }
time.step.seconds = 10.0
effect = [{ contact = {} }]
"#,
    ),
    (
        GRAINS,
        r#"
model.grains.dem.count = 0
model.grains.dem.count = 134217728
model.grains.dem.young = 0.0
model.grains.dem.poisson = 0.6
model.grains.dem.poisson = -1.0
model.grains.dem.radius_ratio = 1.6
model.grains.dem.radius_ratio = 0.19
model.grains.dem.coordination = 0.0
model.grains.dem.radii = "r"
model.grains.dem = { file = "spheres.csv", seed = 2 }
model.grains.dem = { count = 200, radius_ratio = 0.7 }
effect.0.fracture.strength = 0.0
effect.0.fracture.strength =
effect.0.fracture.criterion =
effect.0.fracture.gc = 8.0
effect.0.fracture = { gc = 0.0 }
effect.0.fracture = { gc = 8.0, criterion = "axial" }
effect.0.fracture.weibull = 0.0
effect.0.fracture.deviation = 0.334
effect.0.fracture.deviation = -0.1
effect.0.fracture = { criterion = "axial", strength = 1e9, weibull = 5.0, deviation = 0.1 }
effect.0.fracture.every = 0
effect.0.contact = {}
effect.0.models = []
effect.0.between = ["grains", "grains"]
effect.1.between = ["grains"]
effect.1 = { contact = {}, models = ["grains"], between = ["grains", "grains"] }
effect.1.contact.modulus = 0.0
effect.1.contact.restitution = 0.14
effect.1.contact.restitution = 1.1
effect.1.contact.friction = -0.1
effect.1.contact.shear_ratio = 0.0
effect.1.contact.rolling = -0.1
effect.1.contact.skin = 0.0
effect.2.obstacle = {}
effect.2.obstacle.name = "ball; big"
effect.2.obstacle.shape.sphere.radius = 0.0
effect.2.obstacle.shape = { plane = { point = [0.0, 0.0, -1.0], normal = [0, 0.0, 0.0] } }
effect.2.obstacle.shape = { cylinder = { point = [0.0, 0.0, -1.0], axis = [0.0, 0.0, 0.0], radius = 0.5 } }
effect.2.obstacle.shape = { cylinder = { point = [0.0, 0.0, -1.0], axis = [0.0, 1.0, 0.0], radius = 0.0 } }
effect.2.obstacle.mass = 0.0
effect.2.obstacle.inertia = 0.0
effect.2.obstacle.contact.skin = 1.0
effect.2.obstacle.displacement = { amplitude = [0.0, 0.0, 1.0], time = "step" }
effect.2.obstacle = { shape = { sphere = { centre = [0, 0, 5e-3], radius = 1e-3 } }, spin = [0, 1, 0] }
----
model.grains.divisions = [4, 2, 2]
model.grains.scale = 1e-3
model.grains.spacing = 0.2e-3
effect.3 = { bulk_viscosity = {} }
effect.0 = { contact = {} }
"#,
    ),
    (
        ZONE,
        r#"
body.role = "coarse"
body.cnem.stabilisation = 1.1
body.cnem.stabilisation = -0.1
body.divisions = [12, 0, 2]
body.divisions = []
body.divisions = [12, 2, 2, 2]
body.scale = 0.0
zone."t p" = { kind = "fem", spacing = 0.5, shape = { ball = { centre = [0, 0, 0], radius = 1 } }, overlap = { width = 3 } }
zone.tip.kind = "chain"
zone.tip.overlap.width = 0.0
zone.tip.spacing = 0.0
zone.tip.scale = 0.0
zone.tip.sampling = "everywhere"
zone.tip.partition = "loose"
zone.tip.mediator.spacing = 0.0
zone.tip.absorber = { rate = 1.0, spacing = 1.0 }
zone.tip.shape = { near = { distance = 1.0 } }
zone.tip.shape = { near = { group = "x-max", distance = 0.0 } }
zone.tip.shape = { ball = { centre = [0.0, 0.0, 0.0], radius = 0.0 } }
zone.tip.shape = { cylinder = { point = [0.0, 0.0, 0.0], axis = [0.0, 1.0, 0.0], radius = 0.0 } }
zone.tip.shape = { cylinder = { point = [0.0, 0.0, 0.0], axis = [0.0, 0.0, 0.0], radius = 1.0 } }
body =
static.steps = 0
static.steps = 1000001
static.times = [1.0]
static = { times = [] }
static.end = 0.0
static.tolerance = 1.0
static.tolerance = 0.0
static.iterations = 0
----
static = { times = [1.0, 0.5] }
static.ramp = 1000000
"#,
    ),
    (
        LINK,
        r#"
model.beyond.command = []
model.beyond.address = "unix:socket"
model.beyond.timeout = 0.0
model.beyond.timeout = 3.2e7
model.beyond.start_timeout = 0.0
model.beyond.start_timeout = 3.2e7
model.beyond.spacing = 1.0
model.beyond = { kind = "link", address = "127.0.0.1:80" }
----
model.beyond = { kind = "link", address = "tcp:8.8.8.8:80" }
"#,
    ),
];

/// Values at the ends of their ranges, which program and schema take.
const TAKEN: [(&str, &str); 4] = [
    (
        SMALL,
        r#"
title = "unchanged"
model.left.spacing = 1
model.left.material.poisson = 0.4999
model.left.step = { fraction = 1.0 }
model.left.step = { ratio = 1, scheme = "explicit" }
model.left.step = { scheme = "implicit" }
model.left.dem = { young = 1.0 }
interface.joint.weight.epsilon = 0.0
interface.joint.weight = { profile = "constant", value = 0.5, fine_epsilon = 0.0 }
interface.joint.junction = { kind = "h1-strain", length = 0.0 }
interface.joint.absorber = { rate = 0.0 }
load.0.name = "tip of the bar"
load.0.time = { table = [[0.0, 1.0]] }
effect = [{ local_damping = { share = 0.0 } }]
effect = [{ mass_damping = { rate = 0.0 } }, { bulk_viscosity = { coefficient = 0.0 } }]
output = { every = 1, probe_every = 1, energy_every = 1, checkpoint_every = 1 }
probe.tip = { model = "right", where = "x-max", quantity = "von-mises" }
probe.tip = { of = "pull", quantity = "moment", component = "x", about = [0.0, 0.0, 0.0] }
"#,
    ),
    (
        GRAINS,
        r#"
model.grains.dem.radius_ratio = 0.2
model.grains.dem.radius_ratio = 1.5
model.grains.dem.poisson = 0.5
model.grains.dem.seed = 0
effect.0.fracture.deviation = 0.0
effect.0.fracture = { gc = 1e-3 }
effect.0.fracture = { gc = 8.0, criterion = "energy" }
effect.1.contact = { restitution = 0.15, friction = 0.0, rolling = 0.0 }
effect.1.contact.restitution = 1.0
effect.2.obstacle.inertia = 1.0
"#,
    ),
    (
        ZONE,
        r#"
body.cnem.stabilisation = 0.0
body.cnem.stabilisation = 1.0
zone.tip.shape = { near = { group = "x-max", distance = 3.0 } }
static.iterations = 501
"#,
    ),
    (LINK, "model.beyond.timeout = 1.0"),
];

/// Returns a scene with an assignment `path = value`; without a value, the key is removed.
fn assigned(scene: &str, assignment: &str) -> String {
    let (path, value) = assignment.split_once(" =").expect("an assignment");
    let mut table: toml::Value = toml::from_str(scene).expect("TOML");
    let mut node = &mut table;
    let (parent, last) = path.rsplit_once('.').unwrap_or(("", path));
    for part in parent.split('.').filter(|p| !p.is_empty()) {
        node = match node {
            toml::Value::Array(list) => &mut list[part.parse::<usize>().expect("a number")],
            toml::Value::Table(t) => t.entry(part).or_insert(toml::Table::new().into()),
            _ => panic!("{part} is below a plain value"),
        };
    }
    let value = (!value.is_empty()).then(|| {
        let mut read: toml::Table = toml::from_str(&format!("value ={value}")).expect("a value");
        read.remove("value").expect("a value")
    });
    match (node, value) {
        (toml::Value::Array(list), Some(value)) => list[last.parse::<usize>().expect("a number")] = value,
        (toml::Value::Table(t), Some(value)) => drop(t.insert(last.trim_matches('"').into(), value)),
        (toml::Value::Table(t), None) => drop(t.remove(last).expect("a key")),
        _ => panic!("{path} is no key"),
    }
    toml::to_string(&table).expect("TOML")
}

/// Returns whether `arlequin check` takes a scene.
fn is_taken(folder: &Path, scene: &str) -> bool {
    let path = folder.join("scene.toml");
    std::fs::write(&path, scene).expect("scene");
    let code = arlequin(&["check", text(&path)]).status.code();
    assert!(matches!(code, Some(0 | 2)), "{code:?}: {scene}");
    code == Some(0)
}

/// Issue 28: an editor marks the mistakes that the program refuses.
#[test]
fn the_schema_refuses_the_mistakes_that_concern_one_table() {
    let folder = scratch("schema-mistakes");
    let mut counts = [0; 2];
    for (scene, mistakes) in MISTAKES {
        assert_eq!(verdict("scene", scene), Some(true), "{scene}");
        let (one_table, several) = mistakes.split_once("----\n").expect("a line");
        for (k, list) in [one_table, several].into_iter().enumerate() {
            for mistake in list.trim().lines() {
                let scene = assigned(scene, mistake);
                assert_eq!(verdict("scene", &scene), Some(k == 1), "{mistake}");
                assert!(!is_taken(&folder, &scene), "{mistake}");
                counts[k] += 1;
            }
        }
    }
    assert!(counts[0] >= 190 && counts[1] >= 20, "{counts:?}");
}

#[test]
fn the_schema_accepts_the_ends_of_all_ranges() {
    let folder = scratch("schema-ends");
    for (scene, values) in TAKEN {
        for value in values.trim().lines() {
            let scene = assigned(scene, value);
            assert_eq!(verdict("scene", &scene), Some(true), "{value}");
            assert!(is_taken(&folder, &scene), "{value}");
        }
    }
}

#[test]
fn the_schema_refuses_mistakes_in_sweeps() {
    let folder = sweeps::folder("schema-sweeps", SWEEP);
    let path = folder.join("sweep.toml");
    let is_planned = |text: &str| PlannedSweep::new(&Source::new(&path, text)).is_ok();
    assert!(is_planned(SWEEP));
    assert_eq!(verdict("sweep", SWEEP), Some(true));
    for mistake in r#"
target = [0.2]
targets = [0.2, 0.0]
repeat = 0
threads = 0
axis.h.levels = [{ name = "one" }]
axis.h.values =
axis.h.set =
reflected.joint.after = 0.0
reflected.joint.until = 0.0
measure.top = { pointer = "/probes/far/max", factor = 0.0 }
measure.top = { pointer = "probes/far/max" }
measure.top = { fact = "broken bonds", pointer = "/probes/far/max" }
reference = { curves = { far = { wave = { at = 4.0, centre = 0, width = 0, amplitude = 1, speed = 1 } } } }
reference = { curves = { far = { bar-step = { at = 4.0, length = 0, speed = 1, particle_speed = 1 } } } }
reference = { curves = { far = { bar-step = { at = 4.0, length = 1, speed = 0, particle_speed = 1 } } } }"#
        .trim()
        .lines()
    {
        let sweep = assigned(SWEEP, mistake);
        assert_eq!(verdict("sweep", &sweep), Some(false), "{mistake}");
        assert!(!is_planned(&sweep), "{mistake}");
    }
}

/// Keys with numbers of any value, such as coordinates and forces.
const FREE: &str = "about acceleration amplitude at axis centre coarse coefficients direction expected fine force from \
                    front high low normal particle_speed pin point pressure ramp rate seed shift size speed spin table times \
                    tip to torque traction turn uniform velocity x_factor y_factor";

/// Collects the keys with numbers that have no range.
fn collect_free<'a>(node: &'a Value, key: &'a str, out: &mut BTreeSet<&'a str>) {
    if let Value::Array(list) = node {
        list.iter().for_each(|v| collect_free(v, key, out));
    }
    let Value::Object(schema) = node else { return };
    let is_number = ["number", "integer"].iter().any(|t| node["type"] == **t);
    let ends = [
        "minimum",
        "exclusiveMinimum",
        "maximum",
        "exclusiveMaximum",
        "not",
    ];
    let mut ends = ends.iter().filter(|e| schema.contains_key(**e));
    // The type of an integer makes its minimum zero.
    let is_any = match ends.next() {
        None => true,
        Some(first) => node["type"] == "integer" && node[*first] == 0 && ends.next().is_none(),
    };
    if is_number && is_any {
        out.insert(key);
    }
    for (name, value) in schema {
        match value {
            Value::Object(keys) if name == "properties" => {
                keys.iter().for_each(|(k, v)| collect_free(v, k, out));
            }
            _ => collect_free(value, key, out),
        }
    }
}

#[test]
fn every_number_has_a_range_unless_any_value_makes_sense() {
    let schemas = [schema::scene(), schema::sweep()];
    let mut out = BTreeSet::new();
    schemas.iter().for_each(|s| collect_free(s, "", &mut out));
    assert_eq!(out, FREE.split(' ').collect::<BTreeSet<_>>());
}
