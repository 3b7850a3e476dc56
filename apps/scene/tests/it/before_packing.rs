//! Mistakes are refused before anything is packed, and probes that lie in a zone read it.

use arlequin_scene::{Error, Scene, Source};
use std::cell::Cell;

/// Spheres that hang on a bar of elements.
const ROCK: &str = r#"
[model.rock]
kind = "dem"
role = "fine"
shape.box = { low = [0.0, 0.0, 0.0], high = [10e-3, 4e-3, 4e-3] }
spacing = 0.7e-3
material = { young = 70e9, poisson = 0.17, density = 2200.0 }

[model.bar]
kind = "fem"
role = "coarse"
shape.box = { low = [6e-3, 0.0, 0.0], high = [20e-3, 4e-3, 4e-3] }
spacing = 1e-3
material = { young = 70e9, poisson = 0.17, density = 2200.0 }

[interface.j]
coarse = "bar"
fine = "rock"
overlap.slab = { fine = [6e-3, 0.0, 0.0], coarse = [10e-3, 0.0, 0.0] }

[[support]]
model = "bar"
where = "x-max"

[time]
steps = 2
"#;

/// A bar with a zone of spheres at its end; `KIND` is replaced.
const ZONE: &str = r#"
[body]
kind = "fem"
shape.box = { low = [0.0, 0.0, 0.0], high = [20e-3, 4e-3, 4e-3] }
spacing = 1e-3
material = { young = 70e9, poisson = 0.17, density = 2200.0 }

[zone.z]
kind = "KIND"
spacing = 0.8e-3
shape.box = { low = [-1.0, -1.0, -1.0], high = [4e-3, 1.0, 1.0] }
overlap.width = 4e-3

[[support]]
model = "body"
where = "x-max"

[time]
steps = 2
"#;

fn zone(kind: &str) -> String {
    ZONE.replace("KIND", kind)
}

/// Refuses a scene before a packing has begun, under this key and with these words.
#[track_caller]
fn refused(text: &str, key: &str, words: &[&str]) {
    let packed = Cell::new(false);
    let prepared = Scene::from_text(text).and_then(|s| {
        s.prepare_with(&mut |phase, _, _| packed.set(packed.get() || phase.starts_with("packing of")))
    });
    let Err(e) = prepared else {
        panic!("the scene is taken: {text}");
    };
    let said = e.to_string();
    assert_eq!(e.place().0, Some(key), "{said}");
    assert!(!packed.get(), "only after packing: {said}");
    for word in words {
        assert!(said.contains(word), "'{word}' is missing in: {said}");
    }
    assert!(said.chars().count() <= 300, "longer than three lines: {said}");
}

#[test]
fn places_without_nodes_are_refused_before_packing() {
    let far = "where.box = { low = [1.0, 1.0, 1.0], high = [2.0, 2.0, 2.0] }";
    let force = "force = [1.0, 0.0, 0.0]\ntime.ramp.duration = 1e-6";
    let beside = ["lies outside model 'rock'", "0.01", "check the units"];
    refused(
        &format!("{ROCK}[[support]]\nmodel = \"rock\"\n{far}\n"),
        "support[1].where",
        &beside,
    );
    refused(
        &format!("{ROCK}[[load]]\nmodel = \"rock\"\n{force}\n{far}\n"),
        "load[0].where",
        &beside,
    );
    let probe = |model: &str| format!("[probe.p]\nmodel = \"{model}\"\ncomponent = \"x\"\n");
    refused(
        &format!("{ROCK}{}{far}\n", probe("rock")),
        "probe.p.where",
        &beside,
    );
    refused(
        &format!("{ROCK}{}{far}\n", probe("bar")),
        "probe.p.where",
        &["no node of model 'bar'"],
    );
    let zone = zone("dem");
    for model in ["body", "z"] {
        let words = [&*format!("lies outside model '{model}'")];
        refused(
            &format!("{zone}[[support]]\nmodel = \"{model}\"\n{far}\n"),
            "support[1].where",
            &words,
        );
        let group = format!("{zone}[[support]]\nmodel = \"{model}\"\nwhere = \"nope\"\n");
        refused(&group, "support[1].where", &["'nope'", "x-min, y-max"]);
    }
    refused(
        &format!("{zone}{}where = \"nope\"\n", probe("z")),
        "probe.p.where",
        &["'nope'", "x-min"],
    );
}

#[test]
fn what_a_model_cannot_tell_is_refused_before_packing() {
    let place = "at = [2e-3, 2e-3, 2e-3]\n";
    let strain = "[probe.p]\nmodel = \"rock\"\nquantity = \"strain\"\ncomponent = \"xx\"\n";
    refused(
        &format!("{ROCK}{strain}{place}"),
        "probe.p.quantity",
        &["take \"stress\""],
    );
    let crack = "[probe.p]\nmodel = \"rock\"\nquantity = \"energy-release\"\ncrack = { front = [[2e-3, 0.0, 2e-3], \
                 [2e-3, 4e-3, 2e-3]], direction = [1.0, 0.0, 0.0], radii = [5e-4, 1e-3] }\n";
    refused(
        &format!("{ROCK}{crack}"),
        "probe.p.crack",
        &["finite or natural elements"],
    );
    let point = "where.box = { low = [20e-3, 0.0, 0.0], high = [20e-3, 0.0, 0.0] }\n";
    let turn =
        format!("{ROCK}[probe.p]\nmodel = \"bar\"\nquantity = \"rotation\"\ncomponent = \"x\"\n{point}");
    refused(&turn, "probe.p", &["several nodes"]);
    let clash = "[[support]]\nmodel = \"bar\"\nwhere = \"y-max\"\n\
                 components = [\"x\", \"y\", \"z\"]\nmotion = { amplitude = 1e-6 }\n";
    refused(&format!("{ROCK}{clash}"), "support[1].where", &["support[0]"]);
}

#[test]
fn rigid_motions_at_rest_are_refused_before_packing() {
    let rest = |text: &str| text.replace("[time]\nsteps = 2", "[static]\nsteps = 1\nend = 1.0");
    let held = "[[support]]\nmodel = \"bar\"\nwhere = \"x-max\"\n";
    let all = "' can move along x and y and z and turn about x and y and z:";
    let free = rest(&ROCK.replace(held, ""));
    refused(&free, "static", &[all, "'bar'", "'rock'", "add supports"]);
    let along_x = rest(&ROCK.replace(held, &format!("{held}components = [\"x\"]\n")));
    refused(&along_x, "static", &["can move along y and z and turn about x:"]);
    let zone = zone("dem").replace("where = \"x-max\"\n", "where = \"x-max\"\ncomponents = [\"x\"]\n");
    refused(
        &rest(&zone),
        "static",
        &["can move along y and z and turn about x:"],
    );
}

#[test]
fn notches_slabs_and_absorbers_are_refused_before_packing() {
    let notch = |low: f64, high: f64| {
        let table = format!(
            "[[model.rock.dem.notch]]\nlow = [{low:?}, {low:?}, {low:?}]\nhigh = [{high:?}, {high:?}, {high:?}]\n"
        );
        ROCK.replacen("[model.bar]", &format!("{table}\n[model.bar]"), 1)
    };
    refused(
        &notch(-1.0, 1.0),
        "model.rock.dem.notch[0]",
        &["takes every bond", "0.01"],
    );
    refused(
        &notch(1.0, 2.0),
        "model.rock.dem.notch[0]",
        &["lies beside the shape", "0.01"],
    );
    let narrow = ROCK.replace("coarse = [10e-3", "coarse = [6.2e-3");
    refused(
        &narrow,
        "interface.j.overlap.slab.coarse",
        &["3.800e-3 m beyond", "end the model there"],
    );
    let mediator = ROCK.replace("[[support]]", "mediator.spacing = 1e-9\n[[support]]");
    refused(
        &mediator,
        "interface.j.mediator.spacing",
        &["= 1e-9:", "6.4e19 elements", "1.7e7 at most"],
    );
    for key in ["rate", "rate_factor"] {
        let rate = ROCK.replace("[[support]]", &format!("absorber.{key} = -5.0\n[[support]]"));
        refused(
            &rate,
            &format!("interface.j.absorber.{key}"),
            &["= -5:", "must not be negative"],
        );
        let rate = zone("dem").replacen("[[support]]", &format!("absorber.{key} = -5.0\n[[support]]"), 1);
        let e = Scene::from_text(rate)
            .and_then(|s| s.check_tables())
            .expect_err("refused");
        assert_eq!(e.place().0, Some(&*format!("zone.z.absorber.{key}")), "{e}");
    }
}

#[test]
fn pressures_that_follow_are_refused_where_they_cannot_act() {
    let pressure =
        "\n[[load]]\nwhere = \"x-max\"\npressure = 1e6\nfollow = true\ntime.ramp.duration = 1e-6\n";
    for (text, model, rule) in [
        (ROCK, "rock", "not particles"),
        (&zone("dem"), "body", "not on a body with zones"),
    ] {
        let text = format!("{text}{pressure}model = \"{model}\"\n");
        refused(&text, "load[0].follow", &[rule]);
    }
}

/// Warnings of a scene that have these words.
fn warnings(text: &str, words: &str) -> Vec<String> {
    let scene = Scene::from_text(text).unwrap_or_else(|e| panic!("{e}"));
    let prepared = scene.prepare().unwrap_or_else(|e| panic!("{e}"));
    let all = prepared.built().warnings.iter();
    all.filter(|w| w.contains(words)).cloned().collect()
}

/// Spins that nothing follows (issue 28), and those that only one of two tied models follows.
#[test]
fn spins_beyond_the_law_of_a_model_are_named_with_their_remedy() {
    // The disc of a first user span by 3 rad, without any stress and without a word before the end.
    let disc = |dem: &str, rate: f64| {
        format!(
            "[model.disc]\nkind = \"dem\"\nshape.cylinder = {{ from = [0.0, 0.0, 0.0], length = 2e-3, radius = 2e-3 }}\n\
             spacing = 0.5e-3\ndem.protocol = \"quench\"\n{dem}\nmaterial = {{ young = 70e9, density = 2500.0 }}\n\
             [[initial]]\nspin = {{ rate = [{rate:?}, 0.0, 0.0] }}\n[time]\nend = 1e-6\n"
        )
    };
    let said = warnings(&disc("", 2e5), "spin turns it by");
    assert!(
        said.len() == 1 && said[0].contains("0.203 rad") && said[0].contains("dem.finite_rotations = true"),
        "{said:?}"
    );
    assert_eq!(warnings(&disc("", 5e4), "spin").len(), 0);
    assert_eq!(
        warnings(&disc("dem.finite_rotations = true", 2e5), "spin").len(),
        0
    );
    let elements = disc("", 2e5)
        .replace("\"dem\"", "\"fem\"")
        .replace("dem.protocol = \"quench\"\n", "");
    let elements = elements.replace("70e9, ", "70e9, poisson = 0.2, ");
    assert_eq!(warnings(&elements, "take kind = \"dem\"").len(), 1);
    // Elements grow as they turn, which spheres that turn freely feel long before.
    let zone = |dem: &str, rate: f64| {
        format!(
            "[body]\nkind = \"fem\"\nshape.box = {{ low = [0.0, 0.0, 0.0], high = [12e-3, 4e-3, 4e-3] }}\nspacing = 1e-3\n\
             material = {{ young = 70e9, poisson = 0.2, density = 2500.0 }}\n[zone.crack]\nkind = \"dem\"\n\
             shape.box = {{ low = [-1.0, -1.0, -1.0], high = [3e-3, 1.0, 1.0] }}\noverlap.width = 3e-3\nspacing = 0.8e-3\n{dem}\n\
             [[initial]]\nmodels = [\"body\"]\nspin = {{ rate = [{rate:?}, 0.0, 0.0] }}\n[time]\nend = 1e-6\n"
        )
    };
    let free = "dem.finite_rotations = true";
    let said = warnings(&zone(free, 2.8e4), "leave dem.finite_rotations out");
    assert!(
        said.len() == 1
            && said[0].contains("'body'")
            && said[0].contains("'crack'")
            && said[0].contains("0.04 %"),
        "{said:?}"
    );
    assert_eq!(warnings(&zone(free, 1e4), "spin turns").len(), 0);
    assert_eq!(warnings(&zone("", 3e4), "spin turns").len(), 0);
    // Two spins add up, and may cancel.
    let second = |rate: f64| {
        zone(free, 1e4).replace(
            "[time]",
            &format!("[[initial]]\nmodels = [\"body\"]\nspin = {{ rate = [{rate:?}, 0.0, 0.0] }}\n[time]"),
        )
    };
    assert_eq!(
        warnings(&second(1e4), "initial[0].spin and initial[1].spin turn it by").len(),
        1
    );
    assert_eq!(warnings(&second(-1e4), "initial[1].spin").len(), 0);
}

/// Issue 28, tried as a user: motions without a direction, overlaps of zones.
#[test]
fn what_a_first_scene_gets_wrong_is_named_with_its_remedy() {
    let motion = "motion = { amplitude = 1e-6 }";
    for model in ["rock", "bar"] {
        let pulled = format!("{ROCK}[[support]]\nmodel = \"{model}\"\nwhere = \"y-min\"\n{motion}\n");
        refused(&pulled, "support[1].components", &["is missing", "[\"x\"]"]);
    }
    // A ball in bricks has a border of steps, which cut the overlap short. The value that is told cures it.
    let ball = |width: f64| {
        format!(
            "[body]\nkind = \"fem\"\nshape.box = {{ low = [-4e-3, -4e-3, -4e-3], high = [4e-3, 4e-3, 0.0] }}\n\
             spacing = 0.8e-3\nmaterial = {{ young = 70e9, poisson = 0.2, density = 2500.0 }}\n[zone.z]\nkind = \"fem\"\n\
             spacing = 0.8e-3\nshape.ball = {{ centre = [0.0, 0.0, 0.0], radius = 1e-3 }}\noverlap.width = {width:?}\n\
             [time]\nsteps = 2\n"
        )
    };
    let said = warnings(&ball(2.4e-3), "reflects waves");
    let told = said
        .first()
        .and_then(|w| w.rsplit("give ").next()?.parse::<f64>().ok());
    let told = told.unwrap_or_else(|| panic!("no width is told: {said:?}"));
    assert!((2.5e-3..3.2e-3).contains(&told), "{said:?}");
    assert_eq!(warnings(&ball(told), "reflects waves"), Vec::<String>::new());
}

/// A probe of the body that lies in a zone reads what a probe of the zone reads.
#[test]
fn probes_of_the_body_find_the_zone_that_they_lie_in() {
    for kind in ["fem", "dem"] {
        let probe = |name: &str, model: &str, place: &str| {
            format!("[probe.{name}]\nmodel = \"{model}\"\ncomponent = \"x\"\n{place}\n")
        };
        let places = [
            ("point", "at = [1.3e-3, 2e-3, 2e-3]"),
            ("face", "where = \"x-min\""),
            (
                "block",
                "where.box = { low = [0.0, 0.0, 0.0], high = [2e-3, 4e-3, 4e-3] }",
            ),
        ];
        let mut text = zone(kind) + "[output]\nplots = false\n";
        for (name, place) in places {
            text += &probe(&format!("{name}-body"), "body", place);
            text += &probe(&format!("{name}-zone"), "z", place);
        }
        text += &probe("side", "body", "where = \"y-min\"");
        let scene = Scene::from_text(&text).unwrap_or_else(|e| panic!("{e}"));
        let prepared = scene.prepare().unwrap_or_else(|e| panic!("{kind}: {e}"));
        let warned = prepared
            .built()
            .warnings
            .iter()
            .filter(|w| w.starts_with("probe 'side'"))
            .count();
        assert_eq!(warned, 1, "{:?}", prepared.built().warnings);
        let read = |name: &str| {
            let p = prepared
                .built()
                .probes
                .iter()
                .find(|p| p.name == name)
                .expect("a probe");
            format!("{p:?}").replace(name, "")
        };
        for (name, _) in places {
            assert_eq!(
                read(&format!("{name}-body")),
                read(&format!("{name}-zone")),
                "{kind}"
            );
        }
    }
    let outside = format!(
        "{}[probe.p]\nmodel = \"body\"\ncomponent = \"x\"\nat = [1.0, 0.0, 0.0]\n",
        zone("dem")
    );
    refused(&outside, "probe.p.at", &["lies outside model 'body'"]);
}

#[test]
fn numbers_are_short_and_files_that_are_no_text_are_named_by_line_and_byte() {
    let e = Scene::from_text(ROCK.replace("spacing = 1e-3", "spacing = 1e-9"));
    let e = e.and_then(|s| s.check_tables()).expect_err("refused");
    assert_eq!(e.place().0, Some("model.bar.spacing"), "{e}");
    assert!(e.to_string().contains("= 1e-9: 2.2e20 elements"), "{e}");

    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("no-text");
    std::fs::create_dir_all(&folder).expect("a folder");
    let path = folder.join("latin.toml");
    std::fs::write(&path, b"# a comment\n# caf\xe9\n").expect("writes");
    let e = Source::read(&path).expect_err("refused");
    assert!(
        matches!(
            e,
            Error::NotText {
                line: 2,
                byte: 0xE9,
                ..
            }
        ),
        "{e}"
    );
    assert!(
        e.to_string()
            .contains("latin.toml' line 2: byte 0xE9 is no UTF-8 text"),
        "{e}"
    );
    let table = folder.join("table.csv");
    std::fs::write(&table, b"0,0\n1,\xff\n").expect("writes");
    let load =
        "[[load]]\nmodel = \"bar\"\nwhere = \"x-max\"\nforce = [1.0, 0.0, 0.0]\ntime.file = \"table.csv\"\n";
    let scene = Scene::from_source(Source::new(folder.join("s.toml"), format!("{ROCK}{load}")));
    let e = scene.and_then(|s| s.check_tables()).expect_err("refused");
    assert!(
        matches!(
            e,
            Error::NotText {
                line: 2,
                byte: 0xFF,
                ..
            }
        ),
        "{e}"
    );
    let e = arlequin_scene::resume(&folder).expect_err("refused");
    assert!(
        e.to_string()
            .contains("has no checkpoint.bin to go on from; name the folder"),
        "{e}"
    );
}

/// The checks before packing refuse no shipped scene.
#[test]
fn the_tables_of_shipped_scenes_are_taken() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/scenes");
    let files = std::fs::read_dir(folder)
        .expect("a folder")
        .flatten()
        .map(|f| f.path());
    let scenes: Vec<_> = files
        .filter(|p| p.extension().is_some_and(|e| e == "toml"))
        .collect();
    assert!(scenes.len() > 15, "{scenes:?}");
    for path in scenes {
        let checked = Scene::read(&path).and_then(|s| s.check_tables());
        assert!(checked.is_ok(), "{}: {checked:?}", path.display());
    }
}

/// At rest, a bond that is not checked would bear any load.
#[test]
fn bonds_at_rest_are_checked_in_every_step() {
    let text = |every: &str| {
        format!(
            "[model.rock]\nkind = \"dem\"\nspacing = 0.5e-3\nshape.box = {{ low = [0.0, 0.0, 0.0], high = [6e-3, 5e-3, 5e-3] }}\n\
             material = {{ young = 75e9, poisson = 0.17, density = 2200.0 }}\n\
             [[support]]\nmodel = \"rock\"\nwhere = \"x-min\"\n[[effect]]\nfracture = {{ gc = 8.0{every} }}\n[static]\nsteps = 2\n"
        )
    };
    refused(
        &text(", every = 2"),
        "effect[0].fracture.every",
        &["2", "in every step of a relaxation"],
    );
    for good in ["", ", every = 1"] {
        Scene::from_text(text(good))
            .and_then(|s| s.prepare())
            .expect("a scene");
    }
}
