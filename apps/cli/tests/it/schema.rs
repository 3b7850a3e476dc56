//! The program's descriptions of itself: schemas, completions, man pages.

use crate::common::sweeps::{self, SWEEP};
use crate::common::{SMALL, WAKING, arlequin, schemas::verdict, scratch, succeed, text};
use arlequin_scene::Source;
use arlequin_scene::sweep::PlannedSweep;
use std::path::{Path, PathBuf};

fn shipped(folder: &str) -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(folder);
    let paths = std::fs::read_dir(&folder).expect("folder").flatten();
    let mut paths: Vec<PathBuf> = paths.map(|e| e.path()).collect();
    paths.retain(|p| p.extension().is_some_and(|e| e == "toml"));
    assert!(!paths.is_empty());
    paths
}

#[test]
fn the_schema_accepts_every_shipped_scene_and_sweep() {
    for (what, folder) in [
        ("scene", "examples/scenes"),
        ("scene", "examples/sweeps/scenes"),
        ("sweep", "examples/sweeps"),
    ] {
        for path in shipped(folder) {
            let scene = std::fs::read_to_string(&path).expect("readable");
            assert_eq!(verdict(what, &scene), Some(true), "{}", path.display());
        }
    }
}

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
spacing = 1.0
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
const MISTAKES: [(&str, &str); 5] = [
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
model.left.material.density = -1.0
model.left.material.poisson = 0.5
model.left.material.poisson = -1.0
model.left.shape = { ball = { centre = [0.0, 0.0, 0.0], radius = 0.0 } }
model.left.shape = { cylinder = { from = [0.0, 0.0, 0.0], length = -1.0, radius = 1.0 } }
model.left.shape = { bar = { from = 0.0, to = 6.0, section = 0.0 } }
model.left.shape.box.low = [0.0, 0.0]
model.left.step = {}
model.left.step.ratio = 0
model.left.step.fraction = 1.5
model.left.step = { scheme = "implicit", ratio = 2 }
model.left.timeout = 1.0
model.left.material =
model = {}
model."le ft" = { kind = "fem" }
interface.joint.coarse =
interface.joint.weight.profile = "kubic"
interface.joint.weight.profile = "constant"
interface.joint.weight.value = 0.5
interface.joint.weight = { profile = "constant", value = 1.5 }
interface.joint.weight.epsilon = 0.5
interface.joint.weight.fine_epsilon = -0.1
interface.joint.weight.alpha = { profile = "linear", value = 0.5 }
interface.joint.mediator.spacing = -0.75
interface.joint.mediator.divisions = [2, 0, 1]
interface.joint.junction = { kind = "l2", length = 1.0 }
interface.joint.junction = { kind = "h1-strain", length = -1.0 }
interface.joint.solver = "multigrid"
interface.joint.absorber = { rate = 1.0, rate_factor = 0.2 }
interface.joint.absorber = { rate = 1.0, spacing = 0.0 }
interface.joint.overlap = { shell = { core = { ball = { centre = [0.0, 0.0, 0.0], radius = 0.0 } } } }
support.0.where = 3
load.0.name = "tip, end"
load.0.name = " "
load.0.force = [1e-3, 0.0]
load.0.pressure = 1.0
load.0.force =
load.0.time = "stepp"
load.0.time = { pulse = { duration = 0.0 } }
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
time.step.seconds = 0.0
initial = [{}]
initial = [{ wave = { component = "x", along = "x", centre = 0.0, width = 0.0, amplitude = 1.0 } }]
effect = [{}]
effect = [{ enabled = true }]
effect = [{ prestress = {}, local_damping = { share = 0.1 } }]
effect = [{ mass_damping = { rate = -1.0 } }]
effect = [{ stiffness_damping = { time = -1.0 } }]
effect = [{ bulk_viscosity = { coefficient = -1.0 } }]
effect = [{ local_damping = { share = 1.0 } }]
output.every = 0
output = { every = 2, interval = 1.0 }
output.interval = -1.0
output.energy_every = 0
output.fields = ["heat"]
probe.tip.at = [7.0, 0.5, 0.5]
probe.tip.where =
probe.tip.model =
probe.tip.component =
probe.tip.quantity = "von-mises"
probe.tip.about = [0.0, 0.0, 0.0]
wake = { model = "right", by = "left", criterion = { strain = 0.0 } }
----
model.left.divisions = [6]
model.left.shape.box.high = [-6.0, 1.0, 1.0]
model.left.spacing = 1000.0
model.left.spacing = 1e-9
model.left.material.poisson =
model.left.cnem = { stabilisation = 0.5, functions = "sibson" }
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
model.grains.dem.young = -1.0
model.grains.dem.poisson = 0.6
model.grains.dem.radius_ratio = 5.0
model.grains.dem.radius_ratio = 0.1
model.grains.dem.coordination = 0.0
model.grains.dem.radii = "r"
model.grains.dem = { file = "spheres.csv", seed = 2 }
model.grains.dem = { count = 200, radius_ratio = 0.7 }
effect.0.fracture.criterion = "tresca"
effect.0.fracture.criterion =
effect.0.fracture.strength = -1.0
effect.0.fracture.weibull = 0.0
effect.0.fracture.deviation = 0.4
effect.0.fracture = { criterion = "axial", strength = 1e9, weibull = 5.0, deviation = 0.1 }
effect.0.fracture.every = 0
effect.0.contact = {}
effect.0.between = ["grains", "grains"]
effect.1.between = ["grains"]
effect.1.contact.modulus = 0.0
effect.1.contact.restitution = 0.01
effect.1.contact.friction = -0.1
effect.1.contact.shear_ratio = 0.0
effect.1.contact.rolling = -0.1
effect.1.contact.skin = 0.0
effect.2.obstacle = {}
effect.2.obstacle.name = "ball; big"
effect.2.obstacle.shape.sphere.radius = 0.0
effect.2.obstacle.shape = { plane = { point = [0.0, 0.0, -1.0], normal = [0, 0.0, 0.0] } }
effect.2.obstacle.mass = 0.0
effect.2.obstacle.inertia = -1.0
effect.2.obstacle.contact.skin = 1.0
effect.2.obstacle.displacement = { amplitude = [0.0, 0.0, 1.0], time = "step" }
effect.2.obstacle = { shape = { sphere = { centre = [0.0, 0.0, 5e-3], radius = 1e-3 } }, spin = [0.0, 1.0, 0.0] }
----
model.grains.divisions = [4, 2, 2]
model.grains.scale = 1e-3
model.grains.spacing = 0.2e-3
effect.2.bulk_viscosity = {}
effect.0 = { contact = {} }
"#,
    ),
    (
        ZONE,
        r#"
body.role = "coarse"
body.cnem.stabilisation = 1.5
zone.tip.kind = "chain"
zone.tip.overlap.width = 0.0
zone.tip.spacing = 0.0
zone.tip.scale = -1.0
zone.tip.mediator.spacing = 0.0
zone.tip.absorber = { rate = 1.0, spacing = 1.0 }
zone.tip.shape = { near = { distance = 1.0 } }
zone.tip.shape = { near = { group = "x-max", distance = 0.0 } }
zone.tip.shape = { cylinder = { point = [0.0, 0.0, 0.0], axis = [0.0, 0.0, 0.0], radius = 1.0 } }
body =
static.steps = 0
static.steps = 2000000
static.times = [1.0]
static = { times = [] }
static.end = 0.0
static.tolerance = 1.0
static.iterations = 0
wake = { model = "tip", by = "body", criterion = { strain = 0.1 } }
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
model.beyond.spacing = 1.0
model.beyond = { kind = "link", address = "127.0.0.1:80" }
----
model.beyond = { kind = "link", address = "tcp:8.8.8.8:80" }
"#,
    ),
    (
        WAKING,
        r#"
wake.every = 0
wake.criterion.strain = 0.0
wake.criterion.stress = 1.0
time = { steps = 10 }
----
wake.by = "right"
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
    arlequin(&["check", text(&path)]).status.success()
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
    assert!(counts[0] >= 140 && counts[1] >= 20, "{counts:?}");
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
reflected.joint.until = -1.0
measure.top = { pointer = "/probes/far/max", factor = 0.0 }
measure.top = { pointer = "probes/far/max" }
measure.top = { fact = "broken bonds", pointer = "/probes/far/max" }
reference = { curves = { far = { wave = { at = 4.0, centre = 0.0, width = 0.0, amplitude = 1.0, speed = 1.0 } } } }
reference = { curves = { far = { bar-step = { at = 4.0, length = 1.0, speed = 0.0, particle_speed = 1.0 } } } }"#
        .trim()
        .lines()
    {
        let sweep = assigned(SWEEP, mistake);
        assert_eq!(verdict("sweep", &sweep), Some(false), "{mistake}");
        assert!(!is_planned(&sweep), "{mistake}");
    }
}

/// Every key of the schema has a description, which editors show. Keys in rules need none.
#[test]
fn every_key_of_the_schema_has_a_description() {
    fn bare(node: &serde_json::Value, path: &str, out: &mut Vec<String>) {
        let Some(object) = node.as_object() else { return };
        for (key, value) in object
            .get("properties")
            .and_then(|p| p.as_object())
            .into_iter()
            .flatten()
        {
            let choice = object.contains_key("description") && object.contains_key("required");
            if value.get("description").is_none() && !choice {
                out.push(format!("{path}.{key}"));
            }
        }
        let rules = ["if", "then", "else", "not", "dependencies"];
        for (key, value) in object.iter().filter(|(k, _)| !rules.contains(&k.as_str())) {
            match value {
                serde_json::Value::Array(a) => a.iter().for_each(|v| bare(v, &format!("{path}.{key}"), out)),
                _ => bare(value, &format!("{path}.{key}"), out),
            }
        }
    }
    for schema in ["schema", "schema --sweep"] {
        let printed = succeed(&schema.split(' ').collect::<Vec<_>>());
        assert!(!printed.contains("\\["), "escapes of Rust's documentation");
        let mut out = Vec::new();
        bare(&serde_json::from_str(&printed).expect("JSON"), "", &mut out);
        assert_eq!(out, Vec::<String>::new());
    }
}

#[test]
fn completions_and_man_pages_know_every_command() {
    let commands = ["run", "check", "sweep", "schema", "resume"];
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let printed = succeed(&["completions", shell]);
        assert!(commands.iter().all(|c| printed.contains(c)), "{shell}");
    }
    let page = succeed(&["man"]);
    assert!(page.contains(".TH arlequin 1") && commands.iter().all(|c| page.contains(c)));
    let folder = scratch("man");
    succeed(&["man", text(&folder)]);
    assert!(folder.join("arlequin-run.1").is_file());
}
