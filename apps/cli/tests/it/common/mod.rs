//! Runs the binary and reads its output.
#![allow(dead_code, reason = "each test file uses a part of these")]

pub(crate) mod browsers;
pub(crate) mod schemas;
pub(crate) mod sweeps;

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output};

/// Returns the path of the shipped scene of the given name.
pub(crate) fn scene(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../examples/scenes")
        .join(name)
}

/// Creates an empty folder for one test.
pub(crate) fn scratch(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = std::fs::remove_dir_all(&path);
    std::fs::create_dir_all(&path).expect("scratch folder");
    path
}

/// Returns the command of the binary with arguments.
pub(crate) fn command(arguments: &[&str]) -> Command {
    let mut c = Command::new(env!("CARGO_BIN_EXE_arlequin"));
    c.args(arguments);
    // Packings are cached with the build, not in the home folder of the person who runs the tests.
    c.env(
        "ARLEQUIN_CACHE",
        Path::new(env!("CARGO_TARGET_TMPDIR")).join("packings"),
    );
    c
}

/// Waits for a file that a started program writes; fails after a minute.
pub(crate) fn wait_for(path: &Path) {
    let start = std::time::Instant::now();
    while !path.exists() {
        assert!(
            start.elapsed().as_secs() < 60,
            "no {} after a minute",
            path.display()
        );
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
}

/// Waits until a condition holds or the program has ended; returns whether the condition holds.
pub(crate) fn wait_while_running(child: &mut Child, condition: impl Fn() -> bool) -> bool {
    let start = std::time::Instant::now();
    while !condition() && child.try_wait().expect("a program").is_none() {
        assert!(start.elapsed().as_secs() < 60, "still waiting after a minute");
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    condition()
}

/// Runs the binary and returns its output.
pub(crate) fn arlequin(arguments: &[&str]) -> Output {
    command(arguments).output().expect("the binary runs")
}

/// Runs the binary, asserts success and returns its standard output.
pub(crate) fn succeed(arguments: &[&str]) -> String {
    let out = arlequin(arguments);
    let error = String::from_utf8_lossy(&out.stderr);
    assert!(out.status.success(), "{arguments:?}: {error}");
    String::from_utf8_lossy(&out.stdout).into_owned()
}

/// Returns a text that was wrapped as one line, so that phrases can be searched in it.
pub(crate) fn unwrapped(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Reads the summary in an output folder.
pub(crate) fn summary(folder: &Path) -> serde_json::Value {
    let text = std::fs::read_to_string(folder.join("summary.json")).expect("summary.json");
    serde_json::from_str(&text).expect("valid JSON")
}

/// Returns the number at a pointer in a JSON value.
pub(crate) fn number(value: &serde_json::Value, pointer: &str) -> f64 {
    let entry = value.pointer(pointer).and_then(serde_json::Value::as_f64);
    entry.unwrap_or_else(|| panic!("no number at {pointer}"))
}

/// Returns a path as text.
pub(crate) fn text(path: &Path) -> &str {
    path.to_str().expect("UTF-8 path")
}

/// A small scene: two boxes of hexahedra that overlap, pulled at one end; builds in milliseconds.
pub(crate) const SMALL: &str = r#"
[model.left]
kind = "fem"
role = "coarse"
shape.box = { low = [0.0, 0.0, 0.0], high = [6.0, 1.0, 1.0] }
spacing = 1.0
material = { young = 1.0, poisson = 0.25, density = 1.0 }

[model.right]
kind = "fem"
role = "fine"
shape.box = { low = [4.0, 0.0, 0.0], high = [10.0, 1.0, 1.0] }
spacing = 0.5
material = { young = 1.0, poisson = 0.25, density = 1.0 }

[interface.joint]
coarse = "left"
fine = "right"
overlap.slab = { coarse = [4.0, 0.0, 0.0], fine = [6.0, 0.0, 0.0] }
weight = { profile = "cubic" }

[[support]]
model = "left"
where = "x-min"

[[load]]
name = "pull"
model = "right"
where = "x-max"
force = [1e-3, 0.0, 0.0]
time.pulse = { duration = 2.0 }

[time]
steps = 50

[probe.tip]
model = "right"
where = "x-max"
component = "x"
"#;

/// Returns a scene with some of its words replaced; each must occur exactly once.
pub(crate) fn changed(scene: &str, changes: &[(&str, &str)]) -> String {
    changes.iter().fold(scene.to_owned(), |text, (from, to)| {
        assert_eq!(text.matches(from).count(), 1, "'{from}' in the scene");
        text.replace(from, to)
    })
}

/// Writes a scene into a fresh folder of the given name and returns its path.
pub(crate) fn written(name: &str, scene: &str) -> PathBuf {
    let path = scratch(name).join("scene.toml");
    std::fs::write(&path, scene).expect("scene");
    path
}
