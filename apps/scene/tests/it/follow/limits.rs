//! Limits of zones that follow: what they warn of, and what is refused.

use super::{COARSE, breaks, run, scene};
use arlequin_scene::{Results, RunFolder, Scene, Silent};
use std::path::Path;

/// Clamps that hold the plate beyond the region load it there, where there are no spheres to break.
#[test]
fn loads_beyond_the_region_of_spheres_are_told() {
    let far = |strict: &str| {
        let within = format!(
            "follow = {{ strict = {strict}, within.box = {{ low = [-1e-3, 3e-3, -1e-3], high = [20e-3, 17e-3, 3e-3] }} }}"
        );
        scene(&[
            COARSE[0],
            ("end = 70e-6", "end = 24e-6"),
            ("amplitude = 4e-6", "amplitude = 30e-6"),
            ("follow = true", &within),
            (
                "where = \"y-min\"",
                "where.box = { low = [30e-3, 0.0, 0.0], high = [40e-3, 0.0, 2e-3] }",
            ),
            (
                "where = \"y-max\"",
                "where.box = { low = [30e-3, 20e-3, 0.0], high = [40e-3, 20e-3, 2e-3] }",
            ),
        ])
    };
    let warnings = run(&far("false")).summary().warnings.clone();
    let beyond = warnings
        .iter()
        .filter(|w| w.contains("outside of zone.crack.follow.within"));
    assert_eq!(beyond.count(), 1, "{warnings:?}");
    let error = far("true").prepare().expect("built").run(&mut Silent);
    let message = error.map(|_| ()).expect_err("a load beyond").to_string();
    assert!(
        message.contains("follow.strict") && message.contains("take a larger region"),
        "{message}"
    );
}

#[test]
fn a_zone_that_looks_too_seldom_says_that_it_woke_too_late() {
    let seldom = |strict: &str| {
        let follow = format!("follow = {{ wake = 1.0, every = 250, strict = {strict} }}");
        let later = ("end = 28e-6", "end = 40e-6");
        scene(&[COARSE[0], COARSE[1], COARSE[2], later, ("follow = true", &follow)])
    };
    let results = run(&seldom("false"));
    let warnings = &results.summary().warnings;
    let late = warnings.iter().filter(|w| w.contains("woke too late"));
    assert_eq!(late.count(), 1, "{warnings:?}");
    let strict = seldom("true");
    let place = Path::new(env!("CARGO_TARGET_TMPDIR")).join("woke-too-late");
    let folder = RunFolder::new(&strict, Some(&place), true).expect("a folder");
    let error = strict.prepare().expect("built").run_into(folder, &mut Silent);
    let message = error.map(|_| ()).expect_err("too late").to_string();
    // The summary has the energy of the last sample.
    let text = |name: &str| std::fs::read_to_string(place.join(name)).expect("a result");
    let summary: serde_json::Value = serde_json::from_str(&text("summary.json")).expect("a summary");
    let rows = text("energy.csv");
    let column = rows
        .lines()
        .next()
        .and_then(|head| head.split(',').position(|c| c == "total [J]"));
    let last = rows
        .lines()
        .last()
        .and_then(|row| row.split(',').nth(column?)?.parse::<f64>().ok());
    assert_eq!(summary["energy"]["final"].as_f64(), last);
    assert!(
        message.contains("woke too late") && message.contains("zone.crack.follow.strict"),
        "{message}"
    );
}

/// In a ball of warped hexahedra, mediator and body can find a sphere at the border in different elements:
/// the sphere is not tied to elements that sleep.
#[test]
fn a_zone_in_a_ball_of_hexahedra_is_not_tied_to_elements_that_sleep() {
    let text = "[body]\nkind = \"fem\"\nshape.ball = { centre = [0.0, 0.0, 0.0], radius = 6e-3 }\nspacing = 1.5e-3\n\
                material = { young = 72.5e9, poisson = 0.17, density = 2200.0 }\n\n[zone.crack]\nkind = \"dem\"\n\
                shape.box = { low = [-7e-3, -3e-3, -3e-3], high = [-3.5e-3, 3e-3, 3e-3] }\noverlap.width = 4.5e-3\n\
                spacing = 0.8e-3\nfollow = true\n\n[[effect]]\nfracture = { gc = 8.0 }\n\n[time]\nend = 1e-7\n";
    let results = run(&Scene::from_text(text).expect("a scene"));
    assert!(results.run.interfaces()[0].report().multipliers > 0);
}

/// A plate of these elements whose zone grows, and leaves all of the plate again. `spin`: table of a spin.
fn plate_that_is_left(element: &str, spin: &str) -> Results {
    let text = format!(
        "[body]\nkind = \"fem\"\nshape.box = {{ low = [0.0, 0.0, 0.0], high = [20e-3, 10e-3, 2e-3] }}\nspacing = 1e-3\n\
         fem.element = \"{element}\"\nmaterial = {{ young = 72.5e9, poisson = 0.17, density = 2200.0 }}\n\n[zone.crack]\n\
         kind = \"dem\"\noverlap.width = 2e-3\nspacing = 0.7e-3\nfollow = {{ wake = 0.3, release = 0.1 }}\n\n[[effect]]\n\
         fracture = {{ gc = 8.0 }}\n\n[[effect]]\nmass_damping = {{ rate = 1e6 }}\n\n[[initial]]\nmodels = [\"body\"]\n\
         velocity.polynomial = {{ component = \"x\", along = \"x\", coefficients = [-1.5, 150.0] }}\n\n{spin}\
         [time]\nend = 18e-6\n"
    );
    run(&Scene::from_text(text).expect("a scene"))
}

/// Where elements come back, single spheres give their states to corners of the body; at some corners of
/// tetrahedra none lies in the elements. A plate that spins is as strained as one that does not.
#[test]
fn elements_that_come_back_into_a_plate_that_spins_are_not_strained() {
    let spin = "[[initial]]\nmodels = [\"body\"]\nspin = { rate = [0.0, 0.0, 5000.0], centre = [10e-3, 5e-3, 1e-3] }\n\n";
    for (element, growths) in [("hex8", 6), ("tet4", 4)] {
        let [at_rest, spinning] = ["", spin].map(|spin| plate_that_is_left(element, spin));
        let cells = |r: &Results| -> Vec<_> { r.summary().conversions.iter().map(|c| c.cells).collect() };
        let [still, turned] = [&at_rest, &spinning].map(cells);
        assert_eq!(still.last().map(|c| c[1]), Some(0), "{still:?}");
        assert_eq!(still[..growths], turned[..growths]);
        assert_eq!(
            (turned.len(), turned.last().map(|c| c[1])),
            (still.len(), Some(0)),
            "{turned:?}"
        );
        assert!(breaks(&spinning).is_empty());
    }
}

/// A probe of the body reads the spheres where the zone begins; elsewhere the run names each probe whose
/// model sleeps.
#[test]
fn probes_whose_model_sleeps_are_named() {
    let probe = |name: &str, model: &str, x: f64| {
        format!(
            "[probe.{name}]\nmodel = \"{model}\"\nat = [{x}, 12e-3, 1e-3]\nquantity = \"displacement\"\ncomponent = \"y\"\n\n"
        )
    };
    let probes = [
        probe("mouth", "body", 5e-3),
        probe("ahead", "body", 16e-3),
        probe("late", "crack", 30e-3),
        "[probe.load]".to_owned(),
    ];
    let results = run(&scene(&[
        COARSE[0],
        ("end = 70e-6", "end = 18e-6"),
        COARSE[2],
        ("[probe.load]", &probes.concat()),
    ]));
    let warnings = &results.summary().warnings;
    let named = |name: &str| {
        let name = format!("probe '{name}'");
        warnings.iter().filter(|w| w.contains(&name)).count()
    };
    assert_eq!(["mouth", "ahead", "late"].map(named), [0, 1, 1], "{warnings:?}");
    let [mouth, late] = ["mouth", "late"].map(|name| results.probe(name).expect("a probe"));
    // The clamp has gone 2.7 µm.
    let opened = mouth.1.last().expect("values");
    assert!(*opened > 0.5e-6, "{opened} m");
    let first = results.summary().conversions[0].time;
    let mut asleep = late.0.iter().zip(late.1).filter(|(t, _)| **t < first);
    assert!(asleep.all(|(_, u)| u.abs() < f64::MIN_POSITIVE), "{late:?}");
}

/// A run so short that its zone does not move names them too.
#[test]
fn probes_that_sleep_from_the_start_are_named() {
    let probe = "[probe.late]\nmodel = \"crack\"\nat = [30e-3, 12e-3, 1e-3]\nquantity = \"displacement\"\n\
                 component = \"y\"\n\n[probe.load]";
    let results = run(&scene(&[
        COARSE[0],
        ("end = 70e-6", "end = 1e-8"),
        ("[probe.load]", probe),
    ]));
    let warnings = &results.summary().warnings;
    let named = warnings.iter().filter(|w| w.contains("probe 'late'"));
    assert_eq!(named.count(), 1, "{warnings:?}");
}

/// Elements have no notch: where a notch leaves the zone, they close it.
#[test]
fn a_notch_that_reaches_beyond_its_zone_is_named() {
    let warnings = |changes: &[(&str, &str)]| {
        let ends = ("end = 70e-6", "end = 1e-8");
        let changes = [&[COARSE[0], ends], changes].concat();
        let built = scene(&changes).prepare().expect("built");
        let warnings = built.run(&mut Silent).expect("runs").summary().warnings.clone();
        let closed = warnings.into_iter().filter(|w| w.contains("close it there"));
        closed.collect::<Vec<_>>()
    };
    let notch = "{ low = [-1e-3, 10e-3, -1e-3], high = [12e-3, 10e-3, 3e-3] }";
    assert_eq!(warnings(&[]), [""; 0]);
    // 6 mm beyond the zone's elements, two of 1 mm in the thickness, along faces of elements or through them.
    for (y, count) in [("10e-3", 12), ("10.4e-3", 12)] {
        let long = format!("{{ low = [-1e-3, {y}, -1e-3], high = [20e-3, {y}, 3e-3] }}");
        let closed = warnings(&[(notch, &long)]);
        let words = format!("zone.crack.dem.notch[0] also crosses {count} elements");
        assert!(closed.len() == 1 && closed[0].contains(&words), "{closed:?}");
    }
    let plane = "{ plane = { point = [0.0, 10e-3, 0.0], normal = [0.1, 1.0, 0.0], \
                 within = { low = [-1e-3, 0.0, -1.0], high = [20e-3, 20e-3, 1.0] } } }";
    assert_eq!(warnings(&[(notch, plane)]).len(), 1);
}

#[test]
fn a_zone_that_follows_stays_off_supports_and_loads() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/scenes/following.toml");
    let text = std::fs::read_to_string(path).expect("a shipped scene");
    for (from, to, words) in [
        // The overlap of 3 mm and one element of 1 mm stay between the zone and the clamps.
        (
            "low = [-1e-3, 6e-3, -1e-3]",
            "low = [-1e-3, 3.5e-3, -1e-3]",
            "support[0]",
        ),
        (
            "high = [14e-3, 14e-3, 3e-3]",
            "high = [14e-3, 16.5e-3, 3e-3]",
            "support 'clamp'",
        ),
        (
            "model = \"body\"\nwhere = \"y-min\"",
            "model = \"crack\"\nwhere = \"y-min\"",
            "model = \"body\"",
        ),
        // The zone begins at x = 0 and reaches 14 mm.
        (
            "[[effect]]\nmass",
            "[[load]]\nname = \"push\"\nmodel = \"body\"\nwhere = \"x-min\"\npressure = 1.0\ntime = \"step\"\n[[effect]]\nmass",
            "load 'push'",
        ),
        (
            "[[effect]]\nmass",
            "[[load]]\nmodel = \"crack\"\nwhere = \"x-max\"\npressure = 1.0\ntime = \"step\"\n[[effect]]\nmass",
            "load[0]",
        ),
    ] {
        let changed = text.replace(from, to);
        assert_ne!(changed, text, "{from}");
        let checked = Scene::from_text(&changed).and_then(|s| s.prepare().map(|_| ()));
        let message = checked.expect_err(words).to_string();
        assert!(message.contains(words) && message.contains("crack"), "{message}");
    }
    // The strip has to hold the zone from 6 to 14 mm and its overlap of 3 mm.
    for (low, words) in [
        ("[-1e-3, 4e-3, -1e-3]", "must lie inside"),
        ("[41e-3, 4e-3, -1e-3]", "no element"),
    ] {
        let within = format!("follow.within.box = {{ low = {low}, high = [42e-3, 17e-3, 3e-3] }}");
        let changed = text.replace("follow = true", &within);
        let checked = Scene::from_text(&changed).and_then(|s| s.prepare().map(|_| ()));
        let message = checked.expect_err(words).to_string();
        assert!(
            message.contains("zone.crack.follow.within") && message.contains(words),
            "{message}"
        );
    }
    // Where a support and the border are both near, the border is named: beyond it nothing can break.
    let near_both = text
        .replace(
            "follow = true",
            "follow.within.box = { low = [-1e-3, 4e-3, -1e-3], high = [42e-3, 17e-3, 3e-3] }",
        )
        .replace("low = [-1e-3, 6e-3, -1e-3]", "low = [-1e-3, 1e-3, -1e-3]");
    let checked = Scene::from_text(&near_both).and_then(|s| s.prepare().map(|_| ()));
    let message = checked.expect_err("outside").to_string();
    assert!(
        message.contains("zone.crack.follow.within") && message.contains("must lie inside"),
        "{message}"
    );
    // As far as it may go.
    let widest = text
        .replace("low = [-1e-3, 6e-3, -1e-3]", "low = [-1e-3, 4e-3, -1e-3]")
        .replace("high = [14e-3, 14e-3, 3e-3]", "high = [14e-3, 16e-3, 3e-3]");
    assert_ne!(widest, text);
    Scene::from_text(&widest).expect("a scene");
}

#[test]
fn what_a_zone_that_follows_cannot_have_is_refused_by_name() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/scenes/following.toml");
    let text = std::fs::read_to_string(path).expect("a shipped scene");
    let empty = text.replace("follow = true", "follow.within = {}");
    let message = Scene::from_text(&empty)
        .map(|_| ())
        .expect_err("empty")
        .to_string();
    assert!(message.contains("is empty, expected exactly one of"), "{message}");
    for (from, to, words) in [
        ("follow = true", "follow.wake = 1.5", "follow.wake"),
        ("follow = true", "follow.margin = 0", "follow.margin"),
        (
            "follow = true",
            "follow.within.ball = { centre = [0.0, 0.0, 0.0], radius = -1.0 }",
            "follow.within.ball.radius",
        ),
        ("follow = true", "follow.release = 0.4", "follow.release"),
        ("follow = true", "follow.release = -0.1", "follow.release"),
        (
            "follow = true",
            "follow.release = 0.2\n\n[[effect]]\nmodels = [\"crack\"]\nobstacle = { shape.sphere = { centre = [0.0, 0.0, 1.0], radius = 1e-3 } }",
            "remove release, or the effect obstacle",
        ),
        (
            "follow = true",
            "follow = true\nmaterial = { young = 30e9, poisson = 0.2, density = 2440.0 }",
            "zone.crack.material",
        ),
        (
            "follow = true",
            "follow = true\nweight.weighting = \"nodal\"",
            "zone.crack.weight.weighting",
        ),
        ("kind = \"dem\"", "kind = \"fem\"", "only spheres break"),
        ("kind = \"fem\"", "kind = \"cnem\"", "natural elements"),
        (
            "[time]",
            "[[effect]]\nmodels = [\"body\"]\nbulk_viscosity = {}\n\n[time]",
            "has bulk_viscosity",
        ),
        ("[[effect]]\nfracture = { gc = 8.0 }\n", "", "nothing breaks"),
        (
            "fracture = { gc = 8.0 }",
            "fracture = { criterion = \"hydrostatic\", strength = 1e6 }",
            "hydrostatic",
        ),
    ] {
        let changed = text.replace(from, to);
        assert_ne!(changed, text, "{from}");
        let refused = Scene::from_text(&changed).map(|_| ());
        let message = refused.expect_err(words).to_string();
        assert!(
            message.contains(words) && message.contains("zone.crack"),
            "{message}"
        );
    }
    let refused = scene(&[]).for_ranks(2).prepare().map(|_| ());
    let message = refused.expect_err("two ranks").to_string();
    assert!(
        message.contains("zone.crack.follow") && message.contains("run the scene on one"),
        "{message}"
    );
}

/// A zone that begins empty has no interface that the set-up could try: what would fail at its first change
/// is refused by rules of its own.
#[test]
fn what_a_zone_that_begins_empty_cannot_have_is_refused_at_once() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/scenes/spalling.toml");
    let text = std::fs::read_to_string(path).expect("a shipped scene");
    let text = text.replace("spacing = 0.35e-3", "spacing = 0.7e-3");
    let zone = "overlap.width = 3e-3";
    for (from, to, words) in [
        (
            zone,
            "overlap.width = 3e-3\njunction.kind = \"h1-strain\"",
            "zone.grains.junction",
        ),
        (
            zone,
            "overlap.width = 3e-3\nsampling = \"intersection\"",
            "zone.grains.sampling",
        ),
        (
            zone,
            "overlap.width = 3e-3\nmediator.spacing = 0.5e-3",
            "zone.grains.mediator.spacing",
        ),
        (
            zone,
            "overlap.width = 3e-3\nweight = { profile = \"constant\", value = 1.0 }",
            "zone.grains.weight",
        ),
        (zone, "overlap.width = 50e-3", "zone.grains"),
        (
            "wake = 0.6",
            "wake = 0.6, every = 1000000",
            "zone.grains.follow.every",
        ),
        (
            "[time]",
            "[[initial]]\nmodels = [\"grains\"]\nvelocity.uniform = [1.0, 0.0, 0.0]\n[time]",
            "initial[0].models",
        ),
    ] {
        let changed = text.replace(from, to);
        assert_ne!(changed, text, "{from}");
        let refused = Scene::from_text(&changed).and_then(|s| s.prepare()?.run(&mut Silent).map(|_| ()));
        let message = refused.expect_err(words).to_string();
        assert!(message.contains(words), "{words}: {message}");
    }
    let narrow = text.replace(zone, "overlap.width = 1e-3");
    let narrow = narrow.replace("end = 16e-6", "end = 1e-6");
    let results = run(&Scene::from_text(&narrow).expect("a scene"));
    let warnings = &results.summary().warnings;
    assert!(
        warnings.iter().any(|w| w.contains("elements of 'body' across")),
        "{warnings:?}"
    );
    // While all spheres sleep there is no fragment of spheres.
    assert!(
        results.recorded.fragments.is_empty(),
        "{:?}",
        results.recorded.fragments
    );
}

/// Fragments of a body that flies across move at its speed, though some of their spheres sleep at rest.
#[test]
fn fragments_have_the_motion_of_what_is_awake() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/scenes/spalling.toml");
    let text = std::fs::read_to_string(path).expect("a shipped scene");
    let text = text
        .replace("spacing = 0.35e-3", "spacing = 0.7e-3")
        .replace("end = 16e-6", "end = 8e-6");
    let flying = "[[initial]]\nmodels = [\"body\"]\nvelocity.uniform = [0.0, 10.0, 0.0]\n[time]";
    let results = run(&Scene::from_text(text.replace("[time]", flying)).expect("a scene"));
    let changes = &results.summary().conversions;
    let awake = changes.last().expect("changes").spheres[1];
    let all = results.model("grains").expect("a model").model().nodes().len();
    assert!(awake < all, "{awake} of {all}");
    let pieces = &results.recorded.fragments;
    assert!(!pieces.is_empty());
    for p in pieces.iter().filter(|p| p.number > 0) {
        assert!((p.velocity[1] / 10.0 - 1.0).abs() < 0.02, "{p:?}");
    }
}
