//! `arlequin suggest` for zones and shells.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use crate::common::{arlequin, number, scratch, succeed, text};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// A block with a zone, struck by a pulse.
const ZONE: &str = r#"
# A block.
[body]
kind = "fem"
shape.box = { low = [-6e-3, -6e-3, -6e-3], high = [6e-3, 6e-3, 0.0] }
spacing = 1.5e-3 # to be changed
material = { young = 72.5e9, poisson = 0.17, density = 2200.0 }
[zone.struck]
kind = "fem"
spacing = 0.75e-3
shape.ball = { centre = [0.0, 0.0, 0.0], radius = 0.8e-3 }
overlap.width = 3e-3 # two elements
[[load]]
name = "blow"
model = "body"
where = "z-max"
force = [0.0, 0.0, -100.0]
time.pulse = { duration = 6e-6 }
[time]
end = 10e-6
"#;

/// A plate whose middle is finer.
const SHELL: &str = r#"
[model.plate]
kind = "fem"
role = "coarse"
shape.box = { low = [-16e-3, -16e-3, 0.0], high = [16e-3, 16e-3, 2e-3], hole = { low = [-2e-3, -2e-3, -1.0], high = [2e-3, 2e-3, 1.0] } }
spacing = 1e-3 # to be changed
material = { young = 72.5e9, poisson = 0.17, density = 2200.0 }
[model.middle]
kind = "fem"
role = "fine"
shape.box = { low = [-5e-3, -5e-3, 0.0], high = [5e-3, 5e-3, 2e-3] }
spacing = 0.5e-3
material = { young = 72.5e9, poisson = 0.17, density = 2200.0 }
[interface.rim]
coarse = "plate"
fine = "middle"
overlap.shell.core.box = { low = [-2e-3, -2e-3, -1.0], high = [2e-3, 2e-3, 1.0] }
overlap.shell.domain.box = { low = [-5e-3, -5e-3, -1.0], high = [5e-3, 5e-3, 1.0] } # three elements
[time]
end = 10e-6
"#;

fn written(name: &str, content: &str) -> PathBuf {
    let path = scratch(name).join("scene.toml");
    std::fs::write(&path, content).unwrap();
    path
}

/// Returns a proposal, after the scene with it was written and checked; and the written text.
fn proposed(scene: &Path, more: &[&str]) -> (Value, String) {
    let better = scene.with_file_name("better.toml");
    let flags = ["--apply", text(&better), "--json"];
    let json = succeed(&[&["suggest", text(scene)], more, &flags].concat());
    let better_text = std::fs::read_to_string(&better).unwrap();
    succeed(&["check", text(&better)]);
    (serde_json::from_str(&json).unwrap(), better_text)
}

fn keys(proposal: &Value) -> Vec<&str> {
    let set = proposal["set"].as_array().unwrap().iter();
    set.map(|s| s.as_str().unwrap().split('=').next().unwrap())
        .collect()
}

/// The keys of a proposal for a zone are those of the file, and comments stay. The mediator has the body's
/// elements, so that no spacing of its own is written; nor is one that is no longer faster than the scene.
#[test]
fn a_zone_gets_other_spacings_and_another_width() {
    let scene = written("suggest-zone", ZONE);
    let (proposal, better) = proposed(&scene, &["--error", "3%"]);
    let keys = keys(&proposal);
    for key in ["body.spacing", "zone.struck.overlap.width"] {
        assert!(keys.contains(&key), "{proposal}");
    }
    assert!(number(&proposal, "/proposed/errors/velocity") <= 0.03);
    let setting = |k: usize| {
        let text = proposal["proposed"]["settings"][k][1].as_str().unwrap();
        text.parse::<f64>().unwrap()
    };
    let finer = setting(1) < 0.99 * setting(0);
    assert_eq!(
        keys.contains(&"zone.struck.mediator.spacing"),
        finer,
        "{proposal}"
    );
    assert!(
        better.contains("# to be changed") && better.contains("# two elements"),
        "{better}"
    );
    let note = proposal["notes"].to_string();
    assert!(note.contains("along the normal of the overlap"), "{note}");
}

/// A scene that meets the goal stays as it is unless something is faster.
#[test]
fn a_scene_that_is_as_good_stays() {
    let scene = written("suggest-zone-kept", ZONE);
    let (proposal, _) = proposed(&scene, &["--error", "150%"]);
    let seconds = |name: &str| number(&proposal, &format!("/{name}/seconds"));
    assert!(seconds("proposed") <= seconds("given"), "{proposal}");
    let stays = proposal["notes"].to_string().contains("the scene as given stays");
    assert_eq!(stays, keys(&proposal).is_empty(), "{proposal}");
}

/// Domain and fine body of a shell move together, but not where both are open.
#[test]
fn a_shell_moves_its_domain_and_the_fine_body() {
    let scene = written("suggest-shell", SHELL);
    let (proposal, better) = proposed(&scene, &["--error", "1%", "--frequency", "3e5"]);
    let moved = [
        "interface.rim.overlap.shell.domain.box.low",
        "interface.rim.overlap.shell.domain.box.high",
        "model.middle.shape.box.low",
        "model.middle.shape.box.high",
    ];
    let keys = keys(&proposal);
    assert!(moved.iter().all(|m| keys.contains(m)), "{proposal}");
    let set = proposal["set"]
        .as_array()
        .unwrap()
        .iter()
        .map(|s| s.as_str().unwrap());
    let corners: Vec<&str> = set.filter(|s| s.contains(".low=")).collect();
    // Below, the domain is open and the plate ends: -1 m and 0 stay.
    let last = |s: &str| s.rsplit(", ").next().unwrap().to_owned();
    assert_eq!(
        [last(corners[0]), last(corners[1])],
        ["-1e0]", "0e0]"],
        "{corners:?}"
    );
    let first = |s: &str| s.split(['[', ',']).nth(1).unwrap().to_owned();
    assert_eq!(first(corners[0]), first(corners[1]), "{corners:?}");
    assert!(
        better.contains("# three elements") && better.contains("# to be changed"),
        "{better}"
    );
}

#[test]
fn scenes_that_cannot_be_read_are_named() {
    let zone = written("suggest-zone-refused", ZONE);
    let shell = written("suggest-shell-refused", SHELL);
    let shape = "body.shape={ file = \"block.msh\" }";
    let mixed = "interface.rim.overlap.shell.core={ ball = { centre = [0.0, 0.0, 0.0], radius = 1e-3 } }";
    let cases: [(&[&str], &str); 4] = [
        (
            &[text(&zone), "--set", shape],
            "body.shape = file: suggest changes the spacing of the coarse body",
        ),
        (
            &[text(&zone), "--set", "load=[]"],
            "give the highest one of interest, such as --frequency",
        ),
        (&[text(&shell), "--set", mixed], "write both alike"),
        (
            &[
                text(&shell),
                "--set",
                "interface.rim.mediator.divisions=[2, 2, 2]",
            ],
            "mediator.divisions",
        ),
    ];
    for (arguments, wanted) in cases {
        let outcome = arlequin(&[&["suggest"], arguments, &["--error", "5%"]].concat());
        let error = String::from_utf8_lossy(&outcome.stderr);
        assert!(
            outcome.status.code() == Some(2) && error.contains(wanted),
            "{arguments:?}: {error}"
        );
    }
}
