//! Warnings of settings that are possible but hardly meant; no warning where nothing is odd.

use crate::common::{SMALL, scene, scratch, succeed, summary, text};
use std::path::Path;

/// Two overlapping blocks of glass in SI units, with three coarse elements in the overlap.
const GLASS: &str = r#"
[model.left]
kind = "fem"
role = "coarse"
shape.box = { low = [0.0, 0.0, 0.0], high = [70e-3, 10e-3, 10e-3] }
spacing = 10e-3
material = { young = 72.5e9, poisson = 0.17, density = 2200.0 }

[model.right]
kind = "fem"
role = "fine"
shape.box = { low = [40e-3, 0.0, 0.0], high = [100e-3, 10e-3, 10e-3] }
spacing = 5e-3
material = { young = 72.5e9, poisson = 0.17, density = 2200.0 }

[interface.joint]
coarse = "left"
fine = "right"
overlap.slab = { coarse = [40e-3, 0.0, 0.0], fine = [70e-3, 0.0, 0.0] }

[[support]]
model = "left"
where = "x-min"

[[load]]
model = "right"
where = "x-max"
force = [1000.0, 0.0, 0.0]
time = "step"

[time]
end = 30e-6
"#;

pub(crate) fn warnings(folder: &Path, scene: &str, sets: &[&str]) -> Vec<String> {
    let path = folder.join("scene.toml");
    std::fs::write(&path, scene).expect("scene");
    file_warnings(&path, sets)
}

fn file_warnings(path: &Path, sets: &[&str]) -> Vec<String> {
    let sets: Vec<&str> = sets.iter().flat_map(|s| ["--set", s]).collect();
    let plan = succeed(&[&["check", "--json", text(path)], &sets[..]].concat());
    let plan: serde_json::Value = serde_json::from_str(&plan).expect("JSON");
    let entries = plan["warnings"].as_array().expect("warnings");
    entries
        .iter()
        .map(|w| w.as_str().expect("text").to_owned())
        .collect()
}

/// Issue 26, D.5: a material constant that the model kind does not read is warned of.
#[test]
fn a_ratio_of_poisson_that_nothing_reads_is_warned_of() {
    let folder = scratch("unread");
    let grains = |material: &str, dem: &str| {
        format!(
            "[model.grains]\nkind = \"dem\"\nshape.box = {{ low = [0.0, 0.0, 0.0], high = [2e-3, 2e-3, 2e-3] }}\n\
             dem = {{ count = 300, protocol = \"quench\"{dem} }}\nmaterial = {{ {material}, density = 2200.0 }}\n[time]\nend = 1e-8\n"
        )
    };
    let unlike = |material: &str, dem: &str| {
        let texts = warnings(&folder, &grains(material, dem), &[]);
        texts.into_iter().find(|w| w.contains("its beams make a packing"))
    };
    let warning = unlike("young = 75e9, poisson = 0.4", "").expect("a warning");
    assert!(
        warning.contains("nu = 0.357, and material.poisson = 0.4 is that of estimates only")
            && warning.contains("packings of spheres reach nu = 0.03 to 0.36"),
        "{warning}"
    );
    let warning = unlike("young = 75e9, poisson = 0.3", ", young = 267e9").expect("a warning");
    assert!(
        warning.contains("nu = 0.174, and material.poisson = 0.3 is that of estimates only")
            && warning.contains("leave dem.young and dem.poisson out"),
        "{warning}"
    );
    // The material chooses the beams, as in zones.
    assert_eq!(unlike("young = 75e9, poisson = 0.3", ""), None);
    let warning = unlike("young = 75e9, poisson = 0.17", ", young = 75e9").expect("a warning");
    assert!(
        warning.contains("E = 2.062e10 Pa") && warning.contains("material.young = 7.5e10 Pa"),
        "{warning}"
    );
    assert_eq!(unlike("young = 75e9, poisson = 0.17", ""), None);
    assert_eq!(unlike("young = 75e9", ""), None);
    let wide = grains("young = 75e9", ", young = 75e9, radius_ratio = 1.4");
    let texts = warnings(&folder, &wide, &[]);
    assert!(
        texts
            .iter()
            .any(|w| w.contains("dem.radius_ratio = 1.4 lies outside of 0.2 to 1.2")),
        "{texts:?}"
    );
    let line = "[model.bar]\nkind = \"fem\"\nshape.bar = { from = 0.0, to = 1.0, section = 1e-4 }\ndivisions = [10]\n\
                material = { young = 75e9, poisson = 0.3, density = 2200.0 }\n[time]\nsteps = 1\n";
    let texts = warnings(&folder, line, &[]);
    assert!(
        texts
            .iter()
            .any(|w| w.contains("material.poisson = 0.3 does not enter")),
        "{texts:?}"
    );
}

/// Settings that make the scene odd, and a part of each resulting warning.
type Case = (&'static [&'static str], &'static [&'static str]);

/// A motion names its components.
const AXES: &str = "support.0.components=[\"x\", \"y\", \"z\"]";

const ODD: [Case; 23] = [
    (
        &[
            "model.left.material.young=72.5",
            "model.right.material.young=72.5",
            "load.0.force=[1e-7, 0.0, 0.0]",
            "time.end=1.0",
        ],
        &[
            "model 'left': material.young = 7.25e1 Pa is far below",
            "model 'right': material.young",
        ],
    ),
    (
        &["model.right.material.density=2.2"],
        &["material.density = 2.2e0 kg/m³ is far below"],
    ),
    (
        &["model.right.material.density=2.2e6"],
        &["material.density = 2.2e6 kg/m³ is far above"],
    ),
    (
        &["load.0.force=[1e30, 0.0, 0.0]"],
        &["load[0]: a force of 1.000e30 N: gives model 'right' a stress of about 1.0e34 Pa"],
    ),
    (
        &["load.0={model='right', where='x-max', pressure=1e12, time='step'}"],
        &["a pressure of 1.000e12 Pa"],
    ),
    (
        &["load.0={model='right', where='x-max', torque=[1e9, 0.0, 0.0], time='step'}"],
        &["a torque of 1.000e9 N m"],
    ),
    (
        &["effect=[{body_force={acceleration=[0.0, 0.0, 1e12]}}]"],
        &[
            "effect[0]: an acceleration of 1.000e12 m/s²: gives model 'left'",
            "gives model 'right'",
        ],
    ),
    (
        &["initial=[{velocity={uniform=[9e3, 0.0, 0.0]}}]"],
        &["model 'left': moves at 9.000e3 m/s", "model 'right': moves at"],
    ),
    (
        &["initial=[{displacement={polynomial={component='x', along='x', coefficients=[0.0, 2.0]}}}]"],
        &[
            "model 'left': its displacements differ by 1.400e-1 m",
            "model 'right': its",
        ],
    ),
    (
        &[
            AXES,
            "support.0.motion={amplitude=0.5, time={ramp={duration=1.0}}}",
        ],
        &["support[0]: a motion of 5.000e-1 m is beyond model 'left'"],
    ),
    (
        &[
            AXES,
            "support.0.motion={amplitude=1e-3, time={ramp={duration=1e-8}}}",
        ],
        &["support[0]: a motion at 1.000e5 m/s is faster"],
    ),
    (
        &[
            AXES,
            "support.0.motion={amplitude=1e-3, time={table=[[0.0, 0.0], [1e-8, 1.0]]}}",
        ],
        &["support[0]: a motion at 1.000e5 m/s is faster"],
    ),
    (
        &[
            AXES,
            "support.0.motion={speed=1.0, time={expression=\"1e5*cos(t)\"}}",
        ],
        &[
            "support[0]: a motion at 1.000e5 m/s is faster",
            "model 'left': moves at 1.000e5 m/s",
        ],
    ),
    (
        &["load.0={model='right', where='x-max', force=[1e20, 0.0, 0.0], time={expression=\"1e10*cos(t)\"}}"],
        &["load[0]: a force of 1.000e30 N: gives model 'right' a stress of about 1.0e34 Pa"],
    ),
    (
        &[
            "model.right.material.young=2e7",
            "model.left.material.young=72.5e9",
            "load.0.force=[1.0, 0.0, 0.0]",
        ],
        &["interface 'joint': Young's moduli of 'left' and 'right' are 3.6e3 times apart"],
    ),
    (&["time.end=1e4"], &["steps of"]),
    (
        &["model.left.step.scheme=implicit", "model.right.step.ratio=9"],
        &["model 'left': its implicit step of"],
    ),
    (
        &[
            "support.0={model='left', where='y-min', components=['y']}",
            "model.left.step.scheme=implicit",
            "model.right.step.ratio=2",
        ],
        &[
            "interface 'joint': 'left' has a support on 8 of its nodes in the overlap (along y), 'right' has none there",
        ],
    ),
    (
        &[
            "support=[{model='left', where='x-min'}, {model='right', where.box={low=[50e-3, 0.0, 0.0], high=[60e-3, 10e-3, 1e-3]}, \
             components=['x', 'z']}]",
        ],
        &["(along x, z), 'left' has none there"],
    ),
    (
        &["model.right.step={ratio=100}"],
        &["time.end = 3.000e-5 s: the run goes on to"],
    ),
    (
        &[
            "interface.joint.overlap.slab.fine=[60e-3, 0.0, 0.0]",
            "model.left.shape.box.high=[60e-3, 10e-3, 10e-3]",
        ],
        &["its overlap of 2.000e-2 m is 2.0 elements of 'left' (1.000e-2 m) across"],
    ),
    (
        &[
            "model.left.shape.box.high=[70.0, 10.0, 10.0]",
            "model.left.spacing=10.0",
            "model.right.shape.box={low=[40.0, 0.0, 0.0], high=[100.0, 10.0, 10.0]}",
            "model.right.spacing=5.0",
            "interface.joint.overlap.slab={coarse=[40.0, 0.0, 0.0], fine=[70.0, 0.0, 0.0]}",
        ],
        &[
            "model 'left': is 7.000e1 m long, and a wave crosses 6.3e-2 of it",
            "time.end = 3.000e-5 s: the run goes on to 7.460e-4 s",
        ],
    ),
    (
        &[
            "effect=[]",
            "load.0={model='right', where='x-max', force=[1e8, 0.0, 0.0], time={table=[[0.0, 0.0], [1.0, 1e-3]]}}",
        ],
        &[],
    ),
];

/// Each odd number gives one warning that contains the number.
#[test]
fn each_odd_number_is_named() {
    let folder = scratch("odd");
    assert_eq!(warnings(&folder, GLASS, &[]), [""; 0]);
    for (sets, wanted) in ODD {
        let texts = warnings(&folder, GLASS, sets);
        assert_eq!(texts.len(), wanted.len(), "{sets:?}: {texts:#?}");
        for (f, w) in texts.iter().zip(wanted) {
            assert!(f.contains(w), "{sets:?}: '{w}' is missing in {texts:#?}");
        }
    }
}

#[test]
fn a_support_of_both_models_in_their_overlap_is_as_it_should_be() {
    let support = "support=[{model='left', where='y-min', components=['y']}, {model='right', where='y-min', components=['y']}]";
    assert_eq!(warnings(&scratch("both-held"), GLASS, &[support]), [""; 0]);
}

#[test]
fn models_that_overlap_without_an_interface_are_named() {
    let folder = scratch("untied");
    let alone = GLASS.replace(
        "[interface.joint]\ncoarse = \"left\"\nfine = \"right\"\noverlap.slab = { coarse = [40e-3, 0.0, 0.0], fine = [70e-3, 0.0, 0.0] }\n",
        "",
    );
    let alone = alone
        .replace("role = \"coarse\"\n", "")
        .replace("role = \"fine\"\n", "");
    let texts = warnings(&folder, &alone, &[]);
    assert_eq!(texts.len(), 1, "{texts:#?}");
    // 30 of 60 mm of the fine model lie in the coarse one.
    assert!(
        texts[0].contains("models 'left' and 'right' overlap (50.0 % of one lies in the other)"),
        "{texts:#?}"
    );
    // Bodies that only touch do not overlap.
    let touching = ["model.right.shape.box={low=[70e-3, 0.0, 0.0], high=[100e-3, 10e-3, 10e-3]}"];
    assert_eq!(warnings(&folder, &alone, &touching), [""; 0]);
}

/// A mesh of two tetrahedra with a common face in two volumes, with or without physical groups.
fn two_volumes(physical: [&str; 2]) -> String {
    let volume = |tag: u32, group: &str| format!("{tag} 0 0 0 1 1 1 {group} 0\n");
    format!(
        "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$PhysicalNames\n2\n3 1 \"core\"\n3 2 \"shell\"\n$EndPhysicalNames\n\
         $Entities\n0 0 0 2\n{}{}$EndEntities\n\
         $Nodes\n1 5 1 5\n3 1 0 5\n1\n2\n3\n4\n5\n0 0 0\n1e-2 0 0\n0 1e-2 0\n0 0 1e-2\n1e-2 1e-2 1e-2\n$EndNodes\n\
         $Elements\n2 2 1 2\n3 1 4 1\n1 1 2 3 4\n3 2 4 1\n2 2 3 4 5\n$EndElements\n",
        volume(1, physical[0]),
        volume(2, physical[1])
    )
}

#[test]
fn two_volumes_with_one_material_are_named() {
    let folder = scratch("volumes");
    let scene = r#"
[model.body]
kind = "fem"
shape.file = "body.msh"
material = { young = 72.5e9, poisson = 0.17, density = 2200.0 }
[time]
steps = 2
"#;
    for (physical, words) in [
        (["1 1", "1 2"], Some("has 2 volumes (core, shell)")),
        (["0", "0"], Some("has 2 volumes (entity 1, entity 2)")),
        (["1 1", "1 1"], None),
    ] {
        std::fs::write(folder.join("body.msh"), two_volumes(physical)).expect("mesh");
        for kind in ["fem", "cnem"] {
            let texts = warnings(&folder, scene, &[&format!("model.body.kind={kind}")]);
            match words {
                None => assert_eq!(texts, [""; 0]),
                Some(w) => assert!(
                    texts.len() == 1 && texts[0].contains(w),
                    "{physical:?} {kind}: {texts:#?}"
                ),
            }
        }
    }
}

/// A run warns at once of an implausible motion, and its summary holds the same warnings, each once.
#[test]
fn a_run_says_the_same_and_what_its_motion_shows() {
    let folder = scratch("odd-run");
    let path = folder.join("scene.toml");
    std::fs::write(&path, GLASS).expect("scene");
    let out = folder.join("out");
    let pull = "load.0={model='right', where='x-max', force=[1e11, 0.0, 0.0], time={table=[[0.0, 0.0], [5e-6, 0.0], [6e-6, 1.0]]}}";
    let run = crate::common::arlequin(&["run", text(&path), "--out", text(&out), "--set", pull]);
    let stderr = crate::common::unwrapped(&String::from_utf8_lossy(&run.stderr));
    assert!(run.status.success(), "{stderr}");
    let texts = summary(&out)["warnings"].clone();
    let texts: Vec<&str> = texts
        .as_array()
        .expect("list")
        .iter()
        .filter_map(|w| w.as_str())
        .collect();
    assert!(texts[0].contains("load[0]: a force of 1.000e11 N"), "{texts:#?}");
    let moving: Vec<_> = texts
        .iter()
        .filter(|w| w.contains("moves at") || w.contains("displacements differ"))
        .collect();
    assert!(!moving.is_empty() && moving.len() <= 4, "{texts:#?}");
    assert!(texts.iter().all(|w| stderr.matches(w).count() == 1), "{stderr}");
}

/// The elements of an overlap are counted along its normal, whatever their other edges.
#[test]
fn elements_are_counted_across_the_overlap() {
    let folder = scratch("across");
    let divided = |divisions: &str| {
        let scene = GLASS.replacen("spacing = 10e-3", &format!("divisions = {divisions}"), 1);
        let texts = warnings(&folder, &scene, &[]);
        texts.into_iter().find(|w| w.contains("elements of 'left'"))
    };
    assert_eq!(divided("[28, 1, 1]"), None);
    let few = divided("[5, 10, 10]").expect("a warning");
    assert!(
        few.contains("is 2.1 elements of 'left' (1.400e-2 m) across"),
        "{few}"
    );
}

/// A single step may not go on far beyond the end either.
#[test]
fn a_run_far_beyond_its_end_is_warned_of() {
    let folder = scratch("beyond");
    let scene = GLASS.replace("end = 30e-6", "end = 1e-9");
    let far = |w: &String| w.starts_with("time.end = 1.000e-9 s: the run goes on to");
    assert!(warnings(&folder, &scene, &[]).iter().any(far));
}

/// A scene with dimensionless units is judged by its ratios alone.
#[test]
fn dimensionless_scenes_are_not_held_against_solids() {
    let folder = scratch("unit");
    let texts = warnings(&folder, SMALL, &[]);
    // The overlap is two coarse elements wide, which is odd in any units.
    assert!(
        texts.len() == 1 && texts[0].contains("is 2.0 elements of 'left'"),
        "{texts:#?}"
    );
    let texts = warnings(&folder, SMALL, &["load.0.force=[1e30, 0.0, 0.0]"]);
    assert!(
        texts.iter().any(|w| w.contains("a force of 1.000e30 N")),
        "{texts:#?}"
    );
}

/// No shipped scene is warned of. Packings are coarser here than shipped; overlaps, materials, loads and
/// times are those of the scenes.
#[test]
fn no_shipped_scene_is_called_odd() {
    let shipped: [(&str, &[&str]); 17] = [
        (
            "ball-impact.toml",
            &["model.grains.spacing=0.45e-3", "model.grains.dem.protocol=quench"],
        ),
        ("bar-1d.toml", &[]),
        (
            "beam-a-alone.toml",
            &["model.whole.spacing=0.4e-3", "model.whole.dem.protocol=quench"],
        ),
        (
            "beam-a.toml",
            &["model.right.spacing=0.4e-3", "model.right.dem.protocol=quench"],
        ),
        (
            "beam-b-alone.toml",
            &["model.whole.spacing=3e-3", "model.whole.dem.protocol=quench"],
        ),
        (
            "beam-b.toml",
            &["model.right.spacing=3e-3", "model.right.dem.protocol=quench"],
        ),
        ("beam-cnem.toml", &["model.right.spacing=0.5e-3"]),
        ("beam-fem.toml", &["model.right.spacing=0.5e-3"]),
        (
            "brazilian-disc.toml",
            &["model.disc.spacing=0.6e-3", "model.disc.dem.protocol=quench"],
        ),
        ("cantilever.toml", &[]),
        (
            "dem-fem-beam.toml",
            &["model.right.spacing=0.4e-3", "model.right.dem.protocol=quench"],
        ),
        (
            "direct-tension.toml",
            &["model.bar.spacing=0.6e-3", "model.bar.dem.protocol=quench"],
        ),
        (
            "notched-bar.toml",
            &["model.bar.spacing=0.7e-3", "model.bar.dem.protocol=quench"],
        ),
        ("quickstart.toml", &["model.right.spacing=2.5e-3"]),
        (
            "strip.toml",
            &["model.strip.spacing=1e-3", "model.strip.dem.protocol=quench"],
        ),
        (
            "two-bodies.toml",
            &["model.grains.spacing=0.45e-3", "model.grains.dem.protocol=quench"],
        ),
        ("../sweeps/scenes/chain-bar.toml", &[]),
    ];
    let odd = [
        "that of any solid",
        "gives model",
        "moves at",
        "displacements differ",
        "is beyond model",
        "is faster than",
        "times apart",
        "elements of",
        "no [interface] ties",
        "steps of",
        "crosses",
        "volumes",
    ];
    for (name, sets) in shipped {
        let texts = file_warnings(&scene(name), sets);
        let odd: Vec<_> = texts
            .iter()
            .filter(|w| odd.iter().any(|o| w.contains(o)))
            .collect();
        assert!(odd.is_empty(), "{name}: {odd:#?}");
    }
}
