//! Other models that touch a zone that follows and its body.

use super::obstacles::{plate, plate_text};
use super::{bits, breaks, resumed, run};
use arlequin::core::Coupled;
use arlequin_scene::{Observer, Results, Scene};
use std::ops::ControlFlow;

/// A striker of `kind` in front of the notched edge, over both faces of the notch and beyond the zone, with
/// contact between it and `models`.
fn striker(kind: &str, speed: f64, models: &[&str]) -> String {
    let contacts: String = models
        .iter()
        .map(|m| format!("[[effect]]\nbetween = [\"{m}\", \"striker\"]\ncontact = {{ friction = 0.2 }}\n\n"))
        .collect();
    format!(
        "[model.striker]\nkind = \"{kind}\"\nshape.box = {{ low = [-4.4e-3, 3.3e-3, 0.0], high = [-0.4e-3, 16.7e-3, 2e-3] }}\n\
         spacing = 1e-3\nmaterial = {{ young = 72.5e9, poisson = 0.17, density = 2200.0 }}\n\n[[initial]]\nmodels = [\"striker\"]\n\
         velocity.uniform = [{speed:e}, 0.0, 0.0]\n\n[[effect]]\nfracture = {{ gc = 1.0 }}\n\n{contacts}"
    )
}

/// Largest change of the momentum along x, at every macro step.
struct Momentum {
    first: f64,
    worst: f64,
}

impl Observer for Momentum {
    fn step(&mut self, run: &Coupled<f64>, _: usize) -> ControlFlow<()> {
        self.worst = self.worst.max((run.momentum()[0].x / self.first - 1.0).abs());
        ControlFlow::Continue(())
    }
}

/// Work of the contacts of the striker with some models.
fn works(results: &Results, models: &[&str]) -> Vec<f64> {
    let ledger = &results.summary().energy.ledger;
    let work = |m: &&str| ledger[&format!("contact {m}-striker")];
    models.iter().map(work).collect()
}

/// A block of elements, or of spheres, strikes the notched edge of a free plate: momentum is kept through all
/// changes, no contact creates energy, the zone grows as the plate splits, and a run that is resumed right
/// after a change has the bits of the whole run.
#[test]
fn a_block_strikes_a_free_plate_and_momentum_is_kept_through_all_changes() {
    for kind in ["fem", "dem"] {
        let touched = ["body", "crack"];
        let tables = format!("{}[time]\nend = 14e-6\n", striker(kind, 40.0, &touched));
        let scene = plate(false, &tables);
        let first = 2200.0 * 4e-3 * 13.4e-3 * 2e-3 * 40.0;
        let mut watch = Momentum { first, worst: 0.0 };
        let whole = scene.prepare().expect("built").run(&mut watch).expect("runs");
        let (changes, energy) = (&whole.summary().conversions, &whole.summary().energy);
        let works = works(&whole, &touched);
        println!(
            "{kind}: {} changes, {} breaks, momentum to {:e}, works {works:?} J, drift {:e}, created {:e}",
            changes.len(),
            breaks(&whole).len(),
            watch.worst,
            energy.h_drift_max,
            energy.created_max
        );
        assert!(changes.len() > 2);
        assert!(watch.worst < 1e-11, "{:e}", watch.worst);
        assert!(works.iter().all(|w| w.abs() > 1e-5), "{works:?}");
        assert!(energy.h_drift_max < 1e-9, "{:e}", energy.h_drift_max);
        assert!(energy.created_max < 1e-6, "{:e}", energy.created_max);
        for step in [changes[0].step, changes[1].step + 5] {
            assert!(bits(&resumed(&scene, step)) == bits(&whole), "resumed at {step}");
        }
    }
}

/// The striker splits the plate as it does with spheres everywhere.
#[test]
#[ignore = "ten seconds"]
fn a_block_splits_a_plate_as_with_spheres_everywhere() {
    let tables = |models: &[&str]| format!("{}[time]\nend = 24e-6\n", striker("fem", 40.0, models));
    let follows = run(&plate(false, &tables(&["body", "crack"])));
    let alone = run(&plate(true, &tables(&["body"])));
    let counts = [&follows, &alone].map(|r| breaks(r).len());
    let speed = |r: &Results| {
        let s = r.run.subdomains().iter().find(|s| s.model().name() == "striker");
        let (s, n) = s.map(|s| (s, s.model().layout().nodes)).expect("a striker");
        let mass: f64 = s.inertia().iter().step_by(3).take(n).sum();
        (0..n)
            .map(|k| s.inertia()[3 * k] * s.state().v[3 * k])
            .sum::<f64>()
            / mass
    };
    let speeds = [&follows, &alone].map(speed);
    println!("{counts:?} breaks, striker at {speeds:?} m/s");
    assert!(counts[0].abs_diff(counts[1]) * 6 < counts[1], "{counts:?}");
    assert!((speeds[0] - speeds[1]).abs() < 0.03 * 40.0, "{speeds:?}");
}

/// A fast block breaks the plate all over: the zone takes more of it in each change, by a tenth at least, and
/// in the end the whole plate, whose elements sleep. Momentum is kept, as many bonds break as with spheres
/// everywhere, and a run that is resumed at the whole plate has the same bits.
#[test]
fn a_plate_that_breaks_all_over_becomes_spheres() {
    // A probe of the body's elements goes on where these sleep.
    let probe = "[probe.far]\nmodel = \"body\"\nat = [38e-3, 4e-3, 1e-3]\nquantity = \"velocity\"\ncomponent = \"x\"\n";
    let tables = |models: &[&str]| format!("{}[time]\nend = 24e-6\n\n{probe}", striker("fem", 80.0, models));
    let scene = plate(false, &tables(&["body", "crack"]));
    let first = 2200.0 * 4e-3 * 13.4e-3 * 2e-3 * 80.0;
    let mut watch = Momentum { first, worst: 0.0 };
    let follows = scene.prepare().expect("built").run(&mut watch).expect("runs");
    let counts = [&follows, &run(&plate(true, &tables(&["body"])))].map(|r| breaks(r).len());
    let (changes, energy) = (&follows.summary().conversions, &follows.summary().energy);
    println!(
        "{} changes, {counts:?} breaks, momentum to {:e}, drift {:e}",
        changes.len(),
        watch.worst,
        energy.h_drift_max
    );
    let (last, others) = changes.split_last().expect("changes");
    assert_eq!(last.cells[1], 40 * 20 * 2);
    for c in others {
        assert!(10 * (c.cells[1] - c.cells[0]) >= c.cells[0], "{c:?}");
    }
    let said = |w: &&String| w.contains("took the whole body");
    assert_eq!(follows.summary().warnings.iter().filter(said).count(), 1);
    assert!(counts[0].abs_diff(counts[1]) * 10 < counts[1], "{counts:?}");
    assert!(watch.worst < 1e-11, "{:e}", watch.worst);
    assert!(energy.h_drift_max < 1e-9, "{:e}", energy.h_drift_max);
    assert!(bits(&resumed(&scene, last.step + 5)) == bits(&follows));
}

/// Elements near a support stay with the body, although no other element of the body lies beyond them, and a
/// resumed run keeps them as well.
#[test]
fn elements_that_a_support_keeps_are_kept_in_a_run_that_is_resumed() {
    let support = |low: &str, high: &str| {
        format!(
            "[[support]]\nmodel = \"body\"\nwhere.box = {{ low = {low}, high = {high} }}\ncomponents = [\"z\"]\n\n"
        )
    };
    // The second support leaves elements beyond the overlap, the first one none.
    let supports = support("[20e-3, 20e-3, -1e-3]", "[21e-3, 20e-3, 2e-3]")
        + &support("[36e-3, -1e-3, -1e-3]", "[41e-3, 21e-3, 2e-3]");
    let striker = striker("fem", 80.0, &["body", "crack"]);
    let tables = format!("{supports}{striker}[time]\nend = 24e-6\n");
    // Elements of 1 × 1 × 1.4 mm: the mean edge counts three layers for 3.3 mm.
    let text = plate_text(false, &tables)
        .replace("20e-3, 2e-3]", "20e-3, 1.4e-3]")
        .replace("overlap.width = 3e-3", "overlap.width = 3.3e-3");
    let scene = Scene::from_text(&text).unwrap_or_else(|e| panic!("{e}\n{text}"));
    let whole = run(&scene);
    let last = whole.summary().conversions.last().expect("changes");
    assert!((300..720).contains(&last.cells[1]), "{last:?}");
    assert!(bits(&resumed(&scene, last.step + 5)) == bits(&whole));
}

/// Spheres that sleep stay behind in flight: they neither overlap those that are awake nor anything else.
#[test]
fn a_plate_in_flight_does_not_warn_of_spheres_that_sleep() {
    let tables = "[[initial]]\nmodels = [\"body\"]\nvelocity.uniform = [200.0, 0.0, 0.0]\n\n[[effect]]\nfracture = { gc = 8.0 }\n\n\
                  [time]\nend = 5e-6\n";
    let results = run(&plate(false, tables));
    let overlaps = |w: &&String| w.contains("unbonded particles overlap");
    assert_eq!(results.summary().warnings.iter().find(overlaps), None);
}

/// A coupled pair beside the plate, which has nothing to do with it.
fn pair() -> String {
    let model = |name: &str, role: &str, x: [f64; 2]| {
        format!(
            "[model.{name}]\nkind = \"fem\"\nrole = \"{role}\"\nshape.box = {{ low = [{:e}, 0.0, 0.0], high = [{:e}, 2e-3, 2e-3] }}\n\
             spacing = 1e-3\nmaterial = {{ young = 72.5e9, poisson = 0.17, density = 2200.0 }}\n\n",
            x[0], x[1]
        )
    };
    format!(
        "{}{}[interface.bridge]\ncoarse = \"long\"\nfine = \"short\"\noverlap.slab = {{ fine = [52e-3, 0.0, 0.0], coarse = [54e-3, \
         0.0, 0.0] }}\n\n[[initial]]\nmodels = [\"short\", \"long\"]\nvelocity.polynomial = {{ component = \"x\", along = \"x\", \
         coefficients = [0.0, 100.0] }}\n\n",
        model("long", "coarse", [52e-3, 60e-3]),
        model("short", "fine", [50e-3, 54e-3])
    )
}

/// Displacements of some models at the end.
fn displacements(results: &Results, names: [&str; 2]) -> Vec<f64> {
    let subdomains = results.run.subdomains().iter();
    let named = subdomains.filter(|s| names.contains(&s.model().name()));
    named.flat_map(|s| s.state().q.clone()).collect()
}

/// Another interface goes through all changes as if there were none.
#[test]
fn other_interfaces_are_left_alone() {
    let end = "[time]\nend = 12e-6\nstep.seconds = 9e-9\n";
    let scene = plate(
        false,
        &format!("{}{}{end}", pair(), striker("fem", 40.0, &["body", "crack"])),
    );
    let follows = run(&scene);
    let alone = run(&Scene::from_text(format!("{}{end}", pair())).expect("a scene"));
    let changes = &follows.summary().conversions;
    assert!(!changes.is_empty());
    let [moved, still] = [&follows, &alone].map(|r| displacements(r, ["long", "short"]));
    let top = still.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
    let apart = moved
        .iter()
        .zip(&still)
        .fold(0.0, |m: f64, (a, b)| m.max((a - b).abs()));
    println!("{} changes, apart by {apart:e} of {top:e} m", changes.len());
    assert!(
        moved.len() == still.len() && apart < 1e-10 * top,
        "{apart:e} of {top:e}"
    );
    assert!(follows.summary().energy.h_drift_max < 1e-9);
    let step = changes[0].step;
    assert!(
        bits(&resumed(&scene, step)) == bits(&follows),
        "resumed at {step}"
    );
}

/// A third model at the body would need weights that move along.
#[test]
fn interfaces_of_the_body_with_a_third_model_are_refused_by_name() {
    let tables = format!("{}[time]\nend = 1e-6\n", pair()).replace("coarse = \"long\"", "coarse = \"body\"");
    let tables = format!("[[effect]]\nfracture = {{ gc = 8.0 }}\n\n{tables}");
    let read = Scene::from_text(plate_text(false, &tables));
    let message = read.map(|_| ()).expect_err("refused").to_string();
    let words = ["zone.crack.follow", "interface 'bridge'"];
    assert!(words.iter().all(|w| message.contains(w)), "{message}");
}

/// A contact with the body alone would end where its spheres come.
#[test]
fn contacts_that_would_end_where_the_zone_comes_are_refused_by_name() {
    let refusal = |models: &[&str], more: &str| {
        let tables = format!("{}{more}[time]\nend = 1e-6\n", striker("fem", 40.0, models));
        let read = Scene::from_text(plate_text(false, &tables));
        read.map(|_| ()).expect_err("refused").to_string()
    };
    let message = refusal(&["body"], "");
    let words = ["effect[1].between", "between = [\"crack\", \"striker\"]"];
    assert!(words.iter().all(|w| message.contains(w)), "{message}");
    let with_zone = "[[effect]]\nbetween = [\"crack\", \"body\"]\ncontact = {}\n\n";
    let message = refusal(&["body", "crack"], with_zone);
    assert!(
        message.contains("effect[3].between") && message.contains("takes the place"),
        "{message}"
    );
    // The zone alone is what a striker may be for.
    let tables = format!("{}[time]\nend = 1e-7\n", striker("fem", 40.0, &["crack"]));
    assert!(plate(false, &tables).prepare().is_ok());
}
