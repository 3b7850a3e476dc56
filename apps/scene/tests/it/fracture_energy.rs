//! Fracture energy as input: thresholds of the bonds, and the energy that a crack takes per area.

use arlequin::dem_beam::Criterion;
use arlequin_scene::{RunFolder, Scene, Silent};
use std::path::{Path, PathBuf};

/// Fracture energy of the strip \[J/m²\].
const GC: f64 = 8.0;
/// Length of the strip, tip of its notch, and thickness \[m\].
const STRIP: [f64; 3] = [30e-3, 12e-3, 4e-3];
/// Distance from the notch and from the far end that is not measured \[m\].
const MARGIN: f64 = 2e-3;

/// The shipped strip with coarse spheres and another effect `fracture`.
fn strip(fracture: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/scenes/strip.toml");
    let text = std::fs::read_to_string(path).expect("the shipped scene");
    let lines = text.lines().map(|line| match line {
        l if l.starts_with("spacing =") => "spacing = 0.7e-3".to_owned(),
        l if l.starts_with("fracture =") => format!("fracture = {fracture}"),
        l if l.starts_with("interval =") => "interval = 70e-6".to_owned(),
        l => l.to_owned(),
    });
    lines.collect::<Vec<_>>().join("\n")
}

/// Runs a scene and returns its breaks: time, place along the strip, energy released.
fn breaks(name: &str, scene: &str) -> Vec<[f64; 3]> {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = std::fs::remove_dir_all(&folder);
    let scene = Scene::from_text(scene).expect("a scene");
    let run_folder = RunFolder::new(&scene, Some(&folder), true).expect("a folder");
    let prepared = scene.prepare().expect("built");
    prepared.run_into(run_folder, &mut Silent).expect("runs");
    let text = std::fs::read_to_string(folder.join("breaks.csv")).expect("a table");
    let number = |cell: &str| cell.parse::<f64>().expect("a number");
    let row = |line: &str| {
        let cells: Vec<&str> = line.split(',').collect();
        [0, 2, 6].map(|c| number(cells[c]))
    };
    text.lines().skip(1).map(row).collect()
}

/// Energy released per area of the ligament \[J/m²\].
fn released_per_area(breaks: &[[f64; 3]]) -> f64 {
    let [end, tip, thickness] = STRIP;
    let [low, high] = [tip + MARGIN, end - MARGIN];
    let inside = breaks.iter().filter(|b| b[1] >= low && b[1] < high);
    inside.map(|b| b[2]).sum::<f64>() / ((high - low) * thickness)
}

/// `gc` is the same as the strength that it implies, to the bit. A crack takes `gc` per area within the
/// scatter of single strips that docs/calibration.md states.
#[test]
fn a_crack_takes_the_fracture_energy_per_area() {
    let by_energy = breaks("strip-gc", &strip(&format!("{{ gc = {GC:?} }}")));
    let share = Criterion::TensileEnergy.released_share(0.71).expect("a share");
    let strength = format!(
        "{{ criterion = \"tensile-energy\", strength = {:?} }}",
        GC / share
    );
    assert_eq!(by_energy, breaks("strip-strength", &strip(&strength)));

    let per_area = released_per_area(&by_energy);
    assert!(
        (per_area / GC - 1.0).abs() < 0.12,
        "{per_area} J/m2 of {GC} J/m2, {} bonds",
        by_energy.len()
    );
}

/// Wider beams than the default hold more energy per area of the crack at the same strength per section.
#[test]
fn a_crack_through_wide_beams_takes_the_fracture_energy_too() {
    let scene = strip(&format!("{{ gc = {GC:?} }}")).replace("poisson = 0.17", "poisson = 0.117");
    let per_area = released_per_area(&breaks("strip-wide", &scene));
    assert!((per_area / GC - 1.0).abs() < 0.12, "{per_area} J/m2 of {GC} J/m2");
}

/// A block between walls, pressed along x.
const BLOCK: &str = r#"
[model.block]
kind = "dem"
shape.box = { low = [0.0, 0.0, 0.0], high = [4e-3, 4e-3, 4e-3] }
spacing = 0.6e-3
dem.protocol = "quench"
material = { young = 72.5e9, poisson = 0.17, density = 2200.0 }
[[support]]
model = "block"
where = "x-max"
components = ["x"]
motion = { amplitude = -2.5e-6, time.ramp = { duration = 10e-6 } }
[time]
end = 10e-6
"#;

/// A pressed block between walls is crushed by the plain energy; by the criterion of a fracture energy it
/// holds.
#[test]
fn a_pressed_block_holds() {
    let broken = |criterion: &str| {
        let mut scene = BLOCK.to_owned();
        for (wall, component) in [
            ("x-min", "x"),
            ("y-min", "y"),
            ("y-max", "y"),
            ("z-min", "z"),
            ("z-max", "z"),
        ] {
            scene.push_str(&format!(
                "[[support]]\nmodel = \"block\"\nwhere = \"{wall}\"\ncomponents = [\"{component}\"]\n"
            ));
        }
        scene.push_str(&format!(
            "[[effect]]\nfracture = {{ criterion = \"{criterion}\", gc = 10.0 }}\n"
        ));
        breaks(&format!("block-{criterion}"), &scene).len()
    };
    assert!(broken("energy") > 20);
    assert_eq!(broken("tensile-energy"), 0);
}
