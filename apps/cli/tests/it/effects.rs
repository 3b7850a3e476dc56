//! Effects in scenes: breakage in an overlap, the ledger, the comparison, damping of solids.

use crate::common::{number, scene, scratch, succeed, summary, text};
use std::path::Path;

/// Finite elements below, particles above, coupled in a layer; a ball on top.
const LAYERED: &str = r#"
[model.block]
kind = "fem"
role = "coarse"
shape.box = { low = [0.0, 0.0, 0.0], high = [6e-3, 2e-3, 2e-3] }
spacing = 1e-3
material = { young = 75e9, poisson = 0.17, density = 2200.0 }

[model.grains]
kind = "dem"
role = "fine"
shape.box = { low = [4e-3, 0.0, 0.0], high = [9e-3, 2e-3, 2e-3] }
spacing = 0.4e-3
dem.protocol = "quench"
material = { young = 75e9, poisson = 0.17, density = 2200.0 }

[interface.joint]
coarse = "block"
fine = "grains"
overlap.slab = { coarse = [4e-3, 0.0, 0.0], fine = [6e-3, 0.0, 0.0] }
mediator = { spacing = 1e-3 }

[[support]]
model = "block"
where = "x-min"

[[effect]]
fracture = { criterion = "axial", strength = 1e6, weibull = 1.5 }

[[effect]]
contact = { friction = 0.3 }

[[initial]]
models = ["grains"]
velocity.polynomial = { component = "x", along = "x", coefficients = [-60.0, 10000.0] }

[time]
end = 4e-6

[output]
energy_every = 5

[probe.end]
model = "grains"
where = "x-max"
component = "x"
"#;

fn run(folder: &Path, scene: &str, extra: &[&str]) -> serde_json::Value {
    let path = folder.join("scene.toml");
    std::fs::write(&path, scene).expect("scene");
    let out = folder.join("out");
    let mut arguments = vec!["run", text(&path), "--out", text(&out), "--force"];
    arguments.extend(extra);
    succeed(&arguments);
    summary(&out)
}

fn rows(path: &Path) -> Vec<Vec<f64>> {
    let table = std::fs::read_to_string(path).expect("table");
    let line = |l: &str| l.split(',').map(|c| c.parse().expect("number")).collect();
    table.lines().skip(1).map(line).collect()
}

/// Breakage in an overlap keeps the energy balance. Three hard cases in one run: bonds break inside the
/// overlap until particles have none left, bonds break on its border, and fragments fly off. The constraint
/// holds, the balance closes and no effect creates energy. Particles without bonds in the overlap stay tied
/// by multipliers with their reference weight.
#[test]
fn breakage_in_and_on_the_border_of_an_overlap_keeps_the_balance() {
    let folder = scratch("effects-overlap");
    let s = run(&folder, LAYERED, &[]);
    assert!(number(&s, "/energy/h_drift_max") < 1e-9, "{}", s["energy"]);
    assert!(number(&s, "/interface/0/max_constraint_residual") < 1e-10);
    let breaks = rows(&folder.join("out/fracture-grains.csv"));
    assert!(breaks.len() > 100, "{} broke", breaks.len());
    assert!(breaks.iter().all(|b| b[0] > 0.0 && b[5] > 0.0));
    let ledger = s["effect_ledger"].as_array().expect("ledger");
    // Fracture, contact, and the absorber that an overlap with breakable bonds gets.
    assert_eq!(ledger.len(), 3);
    let start = number(&s, "/energy/initial");
    for e in ledger {
        assert!(number(e, "/dissipated") > -1e-3 * start, "{e}");
        assert!(number(e, "/share") > 0.0 && number(e, "/share") < 1.0);
    }
    assert_eq!(number(&ledger[0], "/facts/broken bonds") as usize, breaks.len());
    let released: f64 = breaks.iter().map(|b| b[4]).sum();
    assert!((released - number(&ledger[0], "/dissipated")).abs() < 1e-9 * released);
    let frames = std::fs::read(folder.join("out/vtu/grains_00000000.vtu")).expect("frame");
    let text = String::from_utf8_lossy(&frames[..4000]).into_owned();
    assert!(text.contains("damage [-]") && text.contains("broken [-]"));
    assert!(folder.join("out/effects.csv").exists());
}

#[test]
fn the_same_bits_for_any_number_of_threads() {
    let folder = scratch("effects-threads");
    let probes = |threads: &str| {
        run(&folder, LAYERED, &["--threads", threads]);
        let read = |name: &str| std::fs::read_to_string(folder.join("out").join(name)).expect("table");
        (read("probes.csv"), read("fracture-grains.csv"))
    };
    assert!(probes("1") == probes("2"));
}

#[test]
fn a_run_without_contact_or_finite_rotations_says_what_it_misses() {
    let folder = scratch("effects-watch");
    let settings = ["--set", "effect.1.enabled=false", "--set", "time.end=20e-6"];
    let scene = LAYERED
        .replace("[-60.0, 10000.0]", "[60.0, -10000.0]")
        .replace("1e6, weibull", "1e5, weibull");
    let s = run(&folder, &scene, &settings);
    let warnings = s["warnings"].to_string();
    assert!(
        warnings.contains("unbonded particles overlap") && warnings.contains("switch contact on"),
        "{warnings}"
    );
    assert_eq!(s["effect_ledger"].as_array().map(Vec::len), Some(2));
}

#[test]
fn the_comparison_names_change_cost_and_what_is_missing() {
    let folder = scratch("effects-compare");
    let path = folder.join("scene.toml");
    std::fs::write(&path, LAYERED).expect("scene");
    let json = succeed(&["effects", text(&path), "--json", "--repeat", "2"]);
    let c: serde_json::Value = serde_json::from_str(&json).expect("JSON");
    assert_eq!(c["repeat"], 2);
    let zero_repeats = crate::common::arlequin(&["effects", text(&path), "--repeat", "0"]);
    let stderr = String::from_utf8_lossy(&zero_repeats.stderr).into_owned();
    assert!(stderr.contains("--repeat"), "{stderr}");
    let effects = c["effects"].as_array().expect("effects");
    assert_eq!(effects.len(), 2);
    assert_eq!(effects[0]["effect"], "effect[0].fracture");
    assert!(number(&effects[0], "/probes/end") > 0.01, "{c}");
    let missing = effects[0]["missing"].to_string();
    assert!(missing.contains("loaded above their strength"), "{missing}");
}

#[test]
fn dampings_of_solids_take_energy_and_the_ledger_closes() {
    let folder = scratch("effects-solids");
    for effect in [
        "stiffness_damping = { time = 0.02 }",
        "bulk_viscosity = { coefficient = 0.3 }",
        "local_damping = { share = 0.2 }",
    ] {
        let scene = format!(
            "{}\n[[effect]]\nmodels = [\"right\"]\n{effect}\n",
            crate::common::SMALL
        );
        let s = run(&folder, &scene, &["--set", "time.steps=400"]);
        assert!(
            number(&s, "/energy/h_drift_max") < 1e-10,
            "{effect}: {}",
            s["energy"]
        );
        let ledger = s["effect_ledger"].as_array().expect("ledger");
        let last = &ledger[ledger.len() - 1];
        assert!(
            number(last, "/dissipated") > 1e-3 * number(&s, "/energy/final"),
            "{effect}: {last}"
        );
    }
}

#[test]
fn prestress_makes_the_initial_shape_an_equilibrium() {
    let folder = scratch("effects-prestress");
    let initial = "[[initial]]\ndisplacement.polynomial = { component = \"x\", along = \"x\", coefficients = [0.0, 1e-3] }\n";
    let cut = crate::common::SMALL.find("[[load]]").expect("load");
    let end = crate::common::SMALL.find("[time]").expect("time");
    let bare = format!(
        "{}{initial}{}",
        &crate::common::SMALL[..cut],
        &crate::common::SMALL[end..]
    );
    let moved = |scene: &str| {
        let s = run(&folder, scene, &["--set", "time.steps=200"]);
        assert!(number(&s, "/energy/h_drift_max") < 1e-10);
        number(&s, "/probes/tip/max") - number(&s, "/probes/tip/min")
    };
    let free = moved(&bare);
    let held = moved(&format!("{bare}\n[[effect]]\nprestress = {{}}\n"));
    assert!(free > 1e-3 && held < 1e-12, "{free} {held}");
}

/// A crack that reaches the overlap is warned of at once with time and place, stands in the summary, and ends
/// the run if the scene asks for it.
#[test]
fn a_crack_into_the_overlap_is_said_at_once_and_can_end_the_run_there() {
    let folder = scratch("effects-into-overlap");
    let path = folder.join("scene.toml");
    std::fs::write(&path, LAYERED).expect("scene");
    let run = |name: &str, extra: &[&str]| {
        let out = folder.join(name);
        succeed(&[&["run", text(&path), "--out", text(&out)], extra].concat());
        summary(&out)
    };
    let whole = run("whole", &[]);
    assert_eq!(whole["status"], "complete");
    let time = number(&whole, "/into_overlap/0/time");
    let x = number(&whole, "/into_overlap/0/place/0");
    assert!((3.6e-3..6.4e-3).contains(&x), "{x}");
    let crack_warnings = |s: &serde_json::Value| {
        let warnings = s["warnings"].as_array().expect("warnings").clone();
        let is_crack_warning = |w: &&serde_json::Value| {
            w.as_str()
                .is_some_and(|w| w.contains("a crack ran into an overlap at t"))
        };
        warnings.iter().filter(is_crack_warning).count()
    };
    assert_eq!(crack_warnings(&whole), 1);
    let key = "effect.0.fracture.stop_at_overlap=true";
    let ended = run("ended", &["--set", key]);
    assert_eq!(ended["status"], "stopped-at-overlap");
    // Particles break in their own steps; the run ends with the macro step that contains the break.
    let later = (number(&ended, "/time") - time) / number(&ended, "/dt");
    assert!((-1e-9..1.0).contains(&later), "{later} steps later");
    assert!(folder.join("ended/fracture-grains.csv").exists() && crack_warnings(&ended) == 1);
    // A run that ended this way can be resumed.
    assert!(folder.join("ended/checkpoint.bin").exists());
}

/// Settings with which breakage in the overlap cannot be right are warned of by `check`; the default settings
/// are not.
#[test]
fn an_overlap_in_which_breakage_cannot_be_right_is_warned_of_before_the_run() {
    let folder = scratch("effects-warned");
    let path = folder.join("scene.toml");
    std::fs::write(&path, LAYERED).expect("scene");
    let warned = |extra: &[&str], word: &str| {
        let report = succeed(&[&["check", text(&path), "--json"], extra].concat());
        let plan: serde_json::Value = serde_json::from_str(&report).expect("JSON");
        let warnings = plan["warnings"].as_array().expect("warnings").clone();
        warnings
            .iter()
            .any(|w| w.as_str().is_some_and(|w| w.contains(word)))
    };
    for (set, word) in [
        (
            "interface.joint.mediator.spacing=2e-3",
            "mediator elements lie across",
        ),
        (
            "interface.joint.weight.epsilon=1e-6",
            "smallest weight of their model",
        ),
        ("interface.joint.absorber.rate=0.0", "has no absorber"),
        ("interface.joint.absorber.rate_factor=0.2", "coarse elements wide"),
    ] {
        assert!(!warned(&[], word), "{word}");
        assert!(warned(&["--set", set], word), "{set}");
    }
}

/// The three scenes of `docs/effects.md`, shortened, close their energy balance.
#[test]
fn shipped_scenes_with_breakage_close_their_balance() {
    for (name, end) in [
        ("notched-bar", "10e-6"),
        ("ball-impact", "1e-6"),
        ("brazilian-disc", "4e-6"),
    ] {
        let out = scratch(&format!("effects-{name}")).join("out");
        let path = scene(&format!("{name}.toml"));
        let end = format!("time.end={end}");
        let arguments = ["run", text(&path), "--out", text(&out), "--set", &end];
        let quick = match name {
            "ball-impact" => "model.grains.dem.protocol=quench",
            "brazilian-disc" => "model.disc.dem.protocol=quench",
            _ => "model.bar.dem.protocol=quench",
        };
        succeed(&[&arguments[..], &["--set", quick]].concat());
        let s = summary(&out);
        assert!(
            number(&s, "/energy/h_drift_max") < 1e-9,
            "{name}: {}",
            s["energy"]
        );
        let ledger = s["effect_ledger"].as_array().expect("ledger");
        let broke = |e: &&serde_json::Value| e["name"].as_str().is_some_and(|n| n.ends_with("/fracture"));
        let fracture = ledger.iter().find(broke).expect("fracture");
        assert!(number(fracture, "/facts/checks of all bonds") > 0.0);
    }
}
