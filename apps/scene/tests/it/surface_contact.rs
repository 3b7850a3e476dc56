//! An obstacle on a whole body: a ball that misses the zone, or strikes its border, rebounds.

use arlequin_scene::{Results, Scene, Silent};
use std::path::Path;

/// Runs the shipped scene with the ball above `x` \[m\] and with other replacements.
fn struck(x: f64, changes: &[(&str, &str)]) -> Results {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/scenes/ball-beside-zone.toml");
    let mut text = std::fs::read_to_string(path).expect("scene");
    let centre = format!("centre = [{x:e}, 0.3e-3, 2.01e-3]");
    for (from, to) in [&[("centre = [3e-3, 0.3e-3, 2.01e-3]", &*centre)], changes].concat() {
        assert!(text.contains(from), "{from}");
        text = text.replace(from, to);
    }
    let scene = Scene::from_text(&text).unwrap_or_else(|e| panic!("{e}"));
    let prepared = scene.prepare().unwrap_or_else(|e| panic!("{e}"));
    prepared.run(&mut Silent).unwrap_or_else(|e| panic!("{e}"))
}

/// Largest force \[N\] and impulse \[N s\] on the body.
fn blow(results: &Results) -> [f64; 2] {
    let (times, forces) = results.probe("ball").expect("probe");
    let peak = forces.iter().fold(0.0_f64, |m, f| m.max(-f));
    let steps = times.windows(2).zip(forces.windows(2));
    [
        peak,
        steps.map(|(t, f)| -0.5 * (t[1] - t[0]) * (f[0] + f[1])).sum(),
    ]
}

/// The ball bounces off elements, particles and the border between them: the elastic blow takes between one
/// and two times its momentum, and the rebound is alike.
#[test]
fn a_ball_rebounds_beside_a_zone_on_it_and_on_its_border() {
    let momentum = 8e-5 * 10.0;
    let blows = [3e-3, -3e-3, -1e-3].map(|x| {
        let results = struck(x, &[]);
        let inside = results
            .summary()
            .warnings
            .iter()
            .find(|w| w.contains("is inside the"));
        assert!(inside.is_none(), "{inside:?}");
        let blow = blow(&results);
        assert!(
            blow[1] > 1.3 * momentum && blow[1] < 2.0 * momentum,
            "{x}: {blow:?}"
        );
        blow
    });
    for blow in &blows[1..] {
        assert!((blow[1] / blows[0][1] - 1.0).abs() < 0.1, "{blows:?}");
    }
}

/// By default an obstacle acts on particles alone, and the run says that the ball enters the elements.
#[test]
fn an_obstacle_that_names_no_elements_does_not_touch_them() {
    let results = struck(
        3e-3,
        &[("models = [\"body\"]\n", ""), ("end = 40e-6", "end = 10e-6")],
    );
    assert!(blow(&results)[0] <= 0.0);
    let warnings = &results.summary().warnings;
    let inside = warnings
        .iter()
        .find(|w| w.contains("is inside the elements of model 'body'"));
    assert!(
        inside
            .expect("a warning")
            .contains("name 'body' in the models of effect[0]")
    );
}
