//! Obstacles that touch a zone that follows, its body, or both.

use super::{COARSE, Stop, bits, breaks, run};
use arlequin::core::Coupled;
use arlequin::core::nalgebra::Vector3;
use arlequin_scene::{Observer, Results, Scene, Silent};
use std::ops::ControlFlow;
use std::path::Path;

/// Returns the shipped plate of coarse spheres without its supports, with `tables` in place of the rest. Where
/// spheres are `everywhere`, they are those of the reservoir.
fn plate(everywhere: bool, tables: &str) -> Scene {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/scenes/following.toml");
    let text = std::fs::read_to_string(path).expect("a shipped scene");
    let (zone, end) = (text.find("[zone.crack]"), text.find("[[support]]"));
    let (zone, end) = (zone.expect("a zone"), end.expect("a support"));
    let models = match everywhere {
        false => text[..end].to_owned(),
        true => {
            let notch = text[zone..end].lines().find(|l| l.starts_with("dem.notch"));
            let body = text[..zone].replace("[body]", "[model.body]");
            let body = body
                .replace("\"fem\"", "\"dem\"")
                .replace("spacing = 1e-3", COARSE[0].0);
            format!("{body}{}\n\n", notch.expect("a notch"))
        }
    };
    let text = format!("{models}{tables}").replace(COARSE[0].0, COARSE[0].1);
    Scene::from_text(&text).unwrap_or_else(|e| panic!("{e}\n{text}"))
}

/// A cylinder across the plate, with its axis at `x` and half of the height, as an obstacle called `wedge`.
fn cylinder([x, radius]: [f64; 2], motion: &str) -> String {
    format!(
        "[[effect]]\nmodels = [\"body\"]\n[effect.obstacle]\nname = \"wedge\"\nshape.cylinder = {{ point = [{x:e}, 10e-3, 0.0], \
         axis = [0.0, 0.0, 1.0], radius = {radius:e} }}\n{motion}\ncontact = {{ friction = 0.1 }}\n\n"
    )
}

const MOUTH: [f64; 2] = [-1.2e-3, 1.2e-3];

/// A wedge that is driven into the mouth of the notch pushes on the zone and splits the plate as it does with
/// spheres everywhere.
#[test]
fn a_wedge_splits_a_plate_as_with_spheres_everywhere() {
    let drive = "displacement = { amplitude = [2e-3, 0.0, 0.0], time.ramp = { duration = 60e-6 } }";
    let tables = format!(
        "[[support]]\nmodel = \"body\"\nwhere = \"x-max\"\ncomponents = [\"x\"]\n\n[[effect]]\nfracture = {{ gc = 1.0 }}\n\n\
         [[effect]]\nmass_damping = {{ rate = 1e5 }}\n\n{}[time]\nend = 60e-6\n",
        cylinder(MOUTH, drive)
    );
    let (follows, alone) = (run(&plate(false, &tables)), run(&plate(true, &tables)));
    let changes = follows.summary().conversions.len();
    let counts = [&follows, &alone].map(|r| breaks(r).len());
    let ledgers = [&follows, &alone].map(|r| r.summary().energy.ledger.clone());
    let works = [ledgers[0]["crack/wedge"], ledgers[1]["body/wedge"]];
    println!("{changes} changes, {counts:?} breaks, works of the wedge {works:?} J");
    assert!(changes > 2, "{changes}");
    assert!(
        counts[0].abs_diff(counts[1]) * 10 < counts[1] && counts[1] > 100,
        "{counts:?}"
    );
    assert!((works[0] / works[1] - 1.0).abs() < 0.02, "{works:?}");
    // The wedge never comes to what elements are left.
    assert!(ledgers[0].get("body/wedge").is_none_or(|w| *w == 0.0));
    let drift = follows.summary().energy.h_drift_max;
    assert!(drift < 1e-9, "{drift:e}");
}

/// Momentum of all models and of a free wedge along x, at every macro step.
struct Momentum {
    mass: f64,
    all: Vec<f64>,
}

impl Observer for Momentum {
    fn step(&mut self, run: &Coupled<f64>, _: usize) -> ControlFlow<()> {
        let effects = run.subdomains().iter().flat_map(|s| s.effects());
        let wedge = effects.filter(|e| e.rigid().is_some()).last().expect("a wedge");
        let facts = wedge.facts();
        let fact = |name: &str| facts.iter().find(|f| f.0 == name).expect("a figure").1;
        // Its velocity is that of half a step before.
        let kick = fact("force on it x [N]") * 0.5 * run.subdomains()[0].own_dt();
        let of_wedge = self.mass * fact("velocity x [m/s]") + kick;
        self.all.push(run.momentum()[0].x + of_wedge);
        ControlFlow::Continue(())
    }
}

/// A free wedge flies into the notch of a free plate: together they keep their momentum through all changes,
/// and a run that is resumed after one has the bits of the whole run.
#[test]
fn a_free_wedge_and_a_free_plate_keep_their_momentum_through_all_changes() {
    let mass = 2e-3;
    let tables = format!(
        "[[effect]]\nfracture = {{ gc = 1.0 }}\n\n{}[time]\nend = 12e-6\n",
        cylinder(MOUTH, &format!("mass = {mass:e}\nvelocity = [20.0, 0.0, 0.0]"))
    );
    let scene = plate(false, &tables);
    let mut watch = Momentum {
        mass,
        all: Vec::new(),
    };
    let whole = scene.prepare().expect("built").run(&mut watch).expect("runs");
    let first = mass * 20.0;
    let worst = watch
        .all
        .iter()
        .fold(0.0, |m: f64, p| m.max((p / first - 1.0).abs()));
    let changes = &whole.summary().conversions;
    println!("{} changes, momentum to {worst:e}", changes.len());
    assert!(changes.len() > 1);
    assert!(worst < 1e-12, "{worst:e}");
    let part = scene
        .prepare()
        .expect("built")
        .run(&mut Stop(changes[0].step + 5))
        .expect("runs");
    let done = part.resume().expect("resumes").run(&mut Silent).expect("runs");
    assert!(bits(&done) == bits(&whole));
}

/// A cylinder strikes the elements ahead of the crack: its force is that of a body of elements until the crack
/// comes, and the zone stays off the contact and says so.
#[test]
fn a_zone_that_follows_stays_off_elements_that_an_obstacle_touches() {
    let clamps = "[[support]]\nmodel = \"body\"\nwhere = \"y-min\"\ncomponents = [\"y\"]\n\n[[support]]\nmodel = \"body\"\n\
                  where = \"y-max\"\ncomponents = [\"y\"]\nmotion = { amplitude = 6e-6, time.ramp = { duration = 40e-6 } }\n\n";
    let tables = format!(
        "[[effect]]\nmass_damping = {{ rate = 1e6 }}\n\n{}[time]\nend = 24e-6\n\n[output]\nprobe_every = 20\n\n[probe.strike]\n\
         of = \"wedge\"\nquantity = \"force\"\ncomponent = \"x\"\n",
        cylinder([42.02e-3, 2e-3], "velocity = [-2.0, 0.0, 0.0]")
    );
    let follows = run(&plate(
        false,
        &format!("{clamps}[[effect]]\nfracture = {{ gc = 8.0 }}\n\n{tables}"),
    ));
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/scenes/following.toml");
    let text = std::fs::read_to_string(path).expect("a shipped scene");
    let body = &text[..text.find("[zone.crack]").expect("a zone")];
    let elements = run(&Scene::from_text(&format!("{body}{clamps}{tables}")).expect("a scene"));
    let force_at = |results: &Results, time: f64| {
        let (times, forces) = results.probe("strike").expect("a probe");
        let k = times.partition_point(|t| *t < time).max(1);
        let share = (time - times[k - 1]) / (times[k] - times[k - 1]);
        forces[k - 1] + share * (forces[k] - forces[k - 1])
    };
    let [with, without] = [&follows, &elements].map(|r| force_at(r, 17e-6));
    println!("{with} and {without} N");
    assert!(
        without < -600.0 && (with / without - 1.0).abs() < 0.02,
        "{with} and {without} N"
    );
    let summary = follows.summary();
    let touched = |w: &String| w.contains("elements that an obstacle touches");
    assert!(summary.warnings.iter().any(touched), "{:?}", summary.warnings);
    assert!(summary.conversions.len() > 5);
    // A layer of elements and the overlap of 3 mm remain between the contact and the zone.
    let off = |b: &arlequin::dem_beam::fracture::Break| {
        (b.place - Vector3::new(40e-3, 10e-3, 1e-3)).xy().norm() > 3e-3
    };
    assert!(breaks(&follows).iter().all(off));
    let drift = summary.energy.h_drift_max;
    assert!(drift < 1e-9, "{drift:e}");
}
