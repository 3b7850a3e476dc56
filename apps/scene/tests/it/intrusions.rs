//! Obstacles and bodies that enter what they do not act on are warned of when it happens, once per pair, on
//! any number of ranks.

use arlequin::dem_beam::fracture::locked;
use arlequin_scene::{Observer, Results, Scene};
use std::path::Path;
use std::time::Duration;

const SOLID: &str = "material = { young = 70e9, poisson = 0.2, density = 2200.0 }";

/// Returns a model of elements of 1 mm.
fn elements(name: &str, low: [f64; 3], high: [f64; 3]) -> String {
    format!(
        "[model.{name}]\nkind = \"fem\"\nshape.box = {{ low = {low:?}, high = {high:?} }}\nspacing = 1e-3\n{SOLID}\n"
    )
}

/// Returns a model of spheres of 0.5 mm.
fn spheres(name: &str, low: [f64; 3], high: [f64; 3]) -> String {
    format!(
        "[model.{name}]\nkind = \"dem\"\nshape.box = {{ low = {low:?}, high = {high:?} }}\nspacing = 0.5e-3\n\
         dem.protocol = \"quench\"\n{SOLID}\n"
    )
}

fn block() -> String {
    elements("block", [0.0, 0.0, -4e-3], [4e-3, 4e-3, 0.0])
}

/// Returns a driven obstacle that acts on the particles of one model.
fn obstacle(model: &str, shape: &str, velocity: f64) -> String {
    format!(
        "[[effect]]\nmodels = [\"{model}\"]\n[effect.obstacle]\nname = \"tool\"\nshape.{shape}\n\
         velocity = [0.0, 0.0, {velocity:?}]\n"
    )
}

fn moving(model: &str, velocity: f64) -> String {
    format!("[[initial]]\nmodels = [\"{model}\"]\nvelocity.uniform = [0.0, 0.0, {velocity:?}]\n")
}

fn end(seconds: f64) -> String {
    format!("[time]\nend = {seconds:e}\n[output]\nplots = false\nenergy_every = 10\n")
}

/// Observer that records warnings with their times.
#[derive(Default)]
struct LineRecorder {
    now: f64,
    lines: Vec<(f64, String)>,
}

impl Observer for LineRecorder {
    fn warning(&mut self, text: &str) {
        if text.contains("is inside the") {
            self.lines.push((self.now, text.to_owned()));
        }
    }

    fn step(&mut self, run: &arlequin::core::Coupled<f64>, _: usize) -> std::ops::ControlFlow<()> {
        self.now = run.time();
        std::ops::ControlFlow::Continue(())
    }
}

fn run(text: &str) -> (LineRecorder, Results) {
    let mut recorder = LineRecorder::default();
    let scene = Scene::from_text(text).unwrap_or_else(|e| panic!("{e}\n{text}"));
    let results = scene.prepare().unwrap_or_else(|e| panic!("{e}\n{text}"));
    let results = results
        .run(&mut recorder)
        .unwrap_or_else(|e| panic!("{e}\n{text}"));
    let recorded = results
        .summary()
        .warnings
        .iter()
        .filter(|w| w.contains("is inside the"));
    assert!(
        recorded.eq(recorder.lines.iter().map(|l| &l.1)),
        "the summary has what was said"
    );
    (recorder, results)
}

/// Returns the number in front of some words.
fn number_before(text: &str, words: &str) -> f64 {
    let head = &text[..text.find(words).expect(words)];
    head.rsplit(' ')
        .next()
        .and_then(|n| n.parse().ok())
        .expect("a number")
}

/// Asserts that the run warns exactly once, at the time `due` or shortly after, and that the warning states a
/// small depth.
fn assert_one_line(text: &str, opening: &str, due: f64, speed: f64) {
    let (recorder, _) = run(text);
    let [(time, line)] = &recorder.lines[..] else {
        panic!("{:?}\n{text}", recorder.lines);
    };
    assert!(line.starts_with(opening), "{line}");
    // The limit is 5 % of a spacing deeper than touching, and it is detected within a quarter of a spacing.
    let tolerance = 0.05e-3;
    let late = (time - due) * speed;
    assert!(
        late > 0.2 * tolerance && late < 0.35e-3,
        "{late:e} m after {due:e} s: {line}"
    );
    let depth = number_before(line, " m deep");
    assert!(depth > 0.2 * tolerance && depth < 0.6e-3, "{line}");
}

#[test]
fn a_ball_beside_the_particles_that_enters_the_elements_is_told_at_once() {
    let ball = "sphere = { centre = [2.2e-3, 1.7e-3, 1.5e-3], radius = 0.4e-3 }";
    let grains = spheres("grains", [6e-3, 0.0, 0.0], [8e-3, 2e-3, 2e-3]);
    // The ball is smaller than an element: no node ever lies in it.
    let text = block() + &grains + &obstacle("grains", ball, -100.0) + &end(14e-6);
    assert_one_line(
        &text,
        "obstacle 'tool' is inside the elements of model 'block'",
        11e-6,
        100.0,
    );
}

/// A ball that starts wholly within the elements cuts no triangle of their surface.
#[test]
fn a_ball_that_starts_wholly_within_elements_is_told_with_its_depth() {
    let ball = "sphere = { centre = [2.1e-3, 1.9e-3, -2.1e-3], radius = 0.4e-3 }";
    let grains = spheres("grains", [6e-3, 0.0, 0.0], [8e-3, 2e-3, 2e-3]);
    let (recorder, _) = run(&(block() + &grains + &obstacle("grains", ball, 0.0) + &end(1e-6)));
    let [(_, line)] = &recorder.lines[..] else {
        panic!("{:?}", recorder.lines);
    };
    assert!(
        line.starts_with("obstacle 'tool' is inside the elements of model 'block'"),
        "{line}"
    );
    // Its centre is 1.9 mm behind the nearest face.
    let depth = number_before(line, " m deep");
    assert!((depth - 2.3e-3).abs() < 1e-5, "{line}");
}

#[test]
fn rollers_and_planes_that_enter_elements_are_told_at_once() {
    // The plane comes from above and would meet the particles later.
    let grains = spheres("grains", [6e-3, 0.0, -3e-3], [8e-3, 2e-3, -1e-3]);
    for shape in [
        "cylinder = { point = [0.0, 2.3e-3, 1.5e-3], axis = [1.0, 0.0, 0.0], radius = 0.5e-3 }",
        "plane = { point = [0.0, 0.0, 1.0e-3], normal = [0.0, 0.0, -1.0] }",
    ] {
        let text = block() + &grains + &obstacle("grains", shape, -100.0) + &end(13e-6);
        assert_one_line(
            &text,
            "obstacle 'tool' is inside the elements of model 'block'",
            10e-6,
            100.0,
        );
    }
}

#[test]
fn bodies_that_fly_into_elements_are_told_at_once() {
    let above = ([1e-3, 1e-3, 1e-3], [3e-3, 3e-3, 3e-3]);
    let fly = moving("flyer", -100.0);
    let text = block() + &spheres("flyer", above.0, above.1) + &fly + &end(14e-6);
    assert_one_line(
        &text,
        "model 'flyer' is inside the elements of model 'block'",
        10e-6,
        100.0,
    );
    let text = block() + &elements("flyer", above.0, above.1) + &fly + &end(14e-6);
    assert_one_line(
        &text,
        "model 'block' is inside the elements of model 'flyer'",
        10e-6,
        100.0,
    );
    // The flyer consists of natural elements.
    let natural = elements("flyer", above.0, above.1).replace("fem", "cnem");
    assert_one_line(
        &(block() + &natural + &fly + &end(14e-6)),
        "model 'block' is inside the elements of model 'flyer'",
        10e-6,
        100.0,
    );
}

/// A body that passes through a plate of one element and leaves it again is reported, and the run completes.
#[test]
fn a_body_that_passes_through_a_thin_plate_at_high_speed_is_not_missed() {
    let plate = elements("plate", [0.0, 0.0, -1e-3], [4e-3, 4e-3, 0.0]);
    let flyer = spheres("flyer", [1e-3, 1e-3, 1e-3], [3e-3, 3e-3, 3e-3]);
    let text = plate + &flyer + &moving("flyer", -500.0) + &end(12e-6);
    assert_one_line(
        &text,
        "model 'flyer' is inside the elements of model 'plate'",
        2e-6,
        500.0,
    );
}

#[test]
fn particles_without_contact_are_told_the_moment_they_enter_each_other_and_contact_silences() {
    let below = spheres("below", [0.0, 0.0, -2e-3], [2e-3, 2e-3, 0.0]);
    let above = spheres("above", [0.0, 0.0, 0.5e-3], [2e-3, 2e-3, 2.5e-3]);
    let text = below + &above + &moving("above", -100.0) + &end(8e-6);
    let (recorder, _) = run(&text);
    let [(time, line)] = &recorder.lines[..] else {
        panic!("{:?}", recorder.lines);
    };
    assert!(
        line.starts_with("model 'above' is inside the particles of model 'below'"),
        "{line}"
    );
    assert!(line.contains("between = [\""), "{line}");
    // The recorded time is that of the step before; packings overlap their walls a little.
    assert!((4.6e-6..8e-6).contains(time), "{time:e}");
    let contact = "[[effect]]\nbetween = [\"below\", \"above\"]\ncontact = {}\n";
    assert!(
        run(&text.replace("[time]", &(contact.to_owned() + "[time]")))
            .0
            .lines
            .is_empty()
    );
}

#[test]
fn an_obstacle_is_told_of_particles_that_it_does_not_act_on() {
    let target = spheres("target", [0.0, 0.0, -2e-3], [2e-3, 2e-3, 0.0]);
    let second = spheres("other", [6e-3, 0.0, -2e-3], [8e-3, 2e-3, 0.0]);
    let ball = "sphere = { centre = [1e-3, 1e-3, 1.5e-3], radius = 1e-3 }";
    let text = target + &second + &obstacle("other", ball, -100.0) + &end(9e-6);
    assert_one_line(
        &text,
        "obstacle 'tool' is inside the particles of model 'target'",
        5e-6,
        100.0,
    );
    // Where the obstacle acts, contact prevents the intrusion.
    assert!(
        run(&text.replace("models = [\"other\"]", "models = [\"other\", \"target\"]"))
            .0
            .lines
            .is_empty()
    );
}

/// Faces that touch and vibrate, and an obstacle that stays on its particles, give no warning.
#[test]
fn bodies_that_touch_and_stay_are_not_told() {
    let beside = elements("beside", [4e-3, 0.0, -4e-3], [8e-3, 4e-3, 0.0]);
    let on_top = spheres("grains", [1e-3, 1e-3, 0.0], [3e-3, 3e-3, 2e-3]);
    let shake = "[[initial]]\nmodels = [\"block\", \"grains\"]\nvelocity.polynomial = { component = \"z\", along = \"z\", \
                 coefficients = [0.0, 100.0] }\n";
    let plane = "plane = { point = [0.0, 0.0, 2e-3], normal = [0.0, 0.0, -1.0] }";
    let text = block() + &beside + &on_top + shake + &obstacle("grains", plane, 0.0) + &end(10e-6);
    let (recorder, results) = run(&text);
    assert!(recorder.lines.is_empty(), "{:?}", recorder.lines);
    assert!(results.summary().steps > 20);
}

/// Overlapping models of one body give no warning.
#[test]
fn an_overlap_of_coupled_models_is_not_told() {
    let fine = spheres("grains", [0.0, 0.0, -2e-3], [4e-3, 4e-3, 2e-3])
        .replace("[model.grains]\n", "[model.grains]\nrole = \"fine\"\n");
    let coarse = block().replace("[model.block]\n", "[model.block]\nrole = \"coarse\"\n");
    let tie = "[interface.layer]\ncoarse = \"block\"\nfine = \"grains\"\n\
               overlap.slab = { fine = [0.0, 0.0, 0.0], coarse = [0.0, 0.0, -2e-3] }\nmediator.spacing = 1e-3\n";
    let shake = "[[initial]]\nvelocity.uniform = [0.0, 0.0, 3.0]\n";
    assert!(
        run(&(coarse + &fine + tie + shake + &end(5e-6)))
            .0
            .lines
            .is_empty()
    );
}

#[test]
fn a_body_that_starts_inside_an_obstacle_is_refused_at_its_key() {
    let grains = spheres("grains", [0.0, 0.0, 0.0], [2e-3, 2e-3, 2e-3]);
    let refused = |shape: &str| {
        let scene = Scene::from_text(grains.clone() + &obstacle("grains", shape, 0.0) + &end(1e-6));
        scene
            .and_then(|s| s.prepare())
            .map(|_| ())
            .map_err(|e| e.to_string())
    };
    for shape in [
        "plane = { point = [0.0, 0.0, 0.6e-3], normal = [0.0, 0.0, 1.0] }",
        "plane = { point = [0.0, 0.0, -0.1e-3], normal = [0.0, 0.0, -1.0] }",
        "sphere = { centre = [1e-3, 1e-3, 1e-3], radius = 0.5e-3 }",
        "cylinder = { point = [1e-3, 1e-3, 1e-3], axis = [0.0, 1.0, 0.0], radius = 0.5e-3 }",
    ] {
        let text = refused(shape).expect_err(shape);
        assert!(
            text.starts_with("effect[0].obstacle") && text.contains("start inside obstacle 'tool'"),
            "{text}"
        );
    }
    assert_eq!(
        refused("plane = { point = [0.0, 0.0, 0.0], normal = [0.0, 0.0, 1.0] }"),
        Ok(())
    );
    assert_eq!(
        refused("sphere = { centre = [1e-3, 1e-3, 3e-3], radius = 1e-3 }"),
        Ok(())
    );
}

/// Two ranks, with the particles partitioned, print the same warnings as one rank.
#[test]
fn ranks_tell_what_one_rank_tells() {
    let flyer = spheres("flyer", [1e-3, 1e-3, 1e-3], [3e-3, 3e-3, 3e-3]).replace("0.5e-3", "0.15e-3");
    let text = block() + &flyer + &moving("flyer", -100.0) + &end(12e-6);
    let (alone, _) = run(&text);
    assert_eq!(alone.lines.len(), 1, "{:?}", alone.lines);
    let per_rank = arlequin_mpi::threads::run(2, 1, Duration::from_secs(120), |c| {
        let mut recorder = LineRecorder::default();
        let scene = Scene::from_text(&text)?.on_ranks(c)?;
        let results = scene.prepare()?.run(&mut recorder)?;
        let parts = results.run.subdomains().iter().filter(|s| s.owned().is_part());
        assert!(parts.count() > 0, "something is in parts");
        Ok::<_, arlequin_scene::Error>(recorder.lines)
    });
    let lines: Vec<_> = per_rank
        .into_iter()
        .map(|r| r.expect("no rank is lost").expect("runs"))
        .collect();
    assert_eq!(lines[0], alone.lines);
    assert!(lines[1].is_empty(), "the first rank speaks");
}

/// Shipped scenes give no warning of intrusions. Obstacles stay where they act; cracks that run into overlaps
/// are printed.
#[test]
#[ignore = "shipped scenes in full: half a minute"]
#[allow(clippy::print_stdout, reason = "it prints what cracks did")]
fn shipped_scenes_enter_nothing_that_they_cannot_touch() {
    for name in [
        "ball-impact",
        "ball-on-block",
        "brazilian-disc",
        "struck-block",
        "two-bodies",
        "notched-bend",
    ] {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/scenes");
        let path = folder.join(format!("{name}.toml"));
        let scene = Scene::read(&path).expect("a shipped scene");
        let mut recorder = LineRecorder::default();
        let results = scene.prepare().expect("built").run(&mut recorder).expect("runs");
        for crack in &results.summary().into_overlap {
            println!("{name}: {} bonds; {crack}", crack.bonds);
        }
        for log in results.breaks.iter().flatten() {
            let log = locked(log);
            let first = log.events().iter().find(|e| e.overlap);
            let count = log.events().iter().filter(|e| e.overlap).count();
            println!(
                "{name}: {} broke, {count} in overlaps, the first {:?}",
                log.events().len(),
                first.map(|e| e.time)
            );
        }
        assert!(recorder.lines.is_empty(), "{name}: {:?}", recorder.lines);
    }
}
