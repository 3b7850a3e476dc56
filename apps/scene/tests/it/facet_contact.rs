//! Contact between two models of which one has a surface: the shipped scene of blocks on an anvil.

use arlequin_scene::{Scene, Silent};
use std::path::Path;

/// Both blocks bounce off the anvil and off each other: nothing enters anything, no energy is
/// created, and the anvil is struck.
#[test]
fn blocks_of_particles_and_of_elements_bounce_on_an_anvil() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/scenes/block-on-block.toml");
    let text = std::fs::read_to_string(path).expect("scene");
    let scene = Scene::from_text(&text).unwrap_or_else(|e| panic!("{e}"));
    let prepared = scene.prepare().unwrap_or_else(|e| panic!("{e}"));
    let results = prepared.run(&mut Silent).unwrap_or_else(|e| panic!("{e}"));
    let summary = results.summary();
    let inside = summary.warnings.iter().find(|w| w.contains("is inside the"));
    assert!(inside.is_none(), "{inside:?}");
    let (_, forces) = results.probe("anvil").expect("probe");
    let peak = forces.iter().fold(0.0_f64, |m, f| m.max(-f));
    assert!(peak > 10.0, "{peak} N");
    let created = summary.energy.created_max;
    assert!(created < 1e-12, "{created:e}");
}
