//! Refusals of a scene state the key, the value and the remedy, never a parser's words.

use arlequin_scene::{Error, Results, Scene, Silent};

/// Two boxes of elements with an overlap from x = 4 m to 6 m.
const SOLIDS: &str = r#"
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

[[support]]
model = "left"
where = "x-min"

[[load]]
model = "right"
where = "x-max"
force = [1e-3, 0.0, 0.0]
time.pulse = { duration = 2.0 }

[[initial]]
velocity.uniform = [0.0, 0.0, 0.0]

[time]
end = 10.0

[probe.tip]
model = "right"
where = "x-max"
component = "x"
"#;

/// A chain and a bar of elements.
const LINES: &str = r#"
[model.chain]
kind = "chain"
role = "fine"
shape.bar = { from = 0.0, to = 6.0, section = 1.0 }
spacing = 0.1
material = { young = 1.0, density = 1.0 }

[model.bar]
kind = "fem"
role = "coarse"
shape.bar = { from = 4.0, to = 10.0, section = 1.0 }
spacing = 0.5
material = { young = 1.0, density = 1.0 }

[interface.joint]
coarse = "bar"
fine = "chain"
overlap.slab = { fine = [4.0, 0.0, 0.0], coarse = [6.0, 0.0, 0.0] }

[time]
steps = 1
"#;

fn solids() -> Scene {
    Scene::from_text(SOLIDS).expect("a scene")
}

/// Returns the error of reading, setting or preparing a scene.
#[track_caller]
fn refused(scene: Result<Scene, Error>) -> Error {
    match scene.and_then(|s| s.prepare()) {
        Ok(_) => panic!("the scene is taken"),
        Err(e) => e,
    }
}

#[track_caller]
fn assert_says(error: &Error, key: &str, words: &[&str]) {
    let text = error.to_string();
    assert_eq!(error.place().0, Some(key), "{text}");
    for w in words.iter().chain([&key]) {
        assert!(text.contains(w), "'{w}' is missing in: {text}");
    }
    for parser in ["f64", "usize", "wanted", "i128", "struct variant", "map"] {
        assert!(!text.contains(parser), "'{parser}' is a parser's word: {text}");
    }
}

#[test]
fn numbers_that_rust_writes_otherwise_than_toml_are_understood() {
    for end in [1e20, f64::MAX, 9_223_372_036_854_775_808.0] {
        let set = solids().set("time.end", end).expect("sets");
        assert_eq!(set.spec().time.end, Some(end));
    }
    let set = solids().set("time.end", u64::MAX).expect("sets");
    assert_eq!(set.spec().time.end, Some(18_446_744_073_709_551_615.0));
    // Words that could be a name stay text.
    let set = solids().set("title", "infinity").expect("sets");
    assert_eq!(set.spec().title.as_deref(), Some("infinity"));
}

/// Supports on two faces with a common edge are refused only if they move the same component of its nodes.
#[test]
fn supports_that_move_the_same_nodes_are_told_apart_by_place_and_component() {
    let two_supports = |first: &str, second: &str| {
        let held = format!("where = \"x-min\"\n{first}");
        let second_support = format!("[[support]]\nmodel = \"left\"\nwhere = \"y-min\"\n{second}\n");
        Scene::from_text(SOLIDS.replacen("where = \"x-min\"", &held, 1) + &second_support)
    };
    let moved = "motion = { amplitude = 1e-6 }";
    let in_y = format!("components = [\"y\"]\n{moved}");
    let in_all = format!("components = [\"x\", \"y\", \"z\"]\n{moved}");
    let motion = in_all.as_str();
    for (first, second) in [
        ("", in_y.as_str()),
        (motion, "components = [\"y\"]"),
        (motion, &in_y),
    ] {
        assert_says(
            &refused(two_supports(first, second)),
            "support[1].where",
            &[
                "holds y of the node of 'left' at (0.0000e0, 0.0000e0",
                "as support[0] does",
                "1 more",
                "leave \"y\" out",
            ],
        );
    }
    let disjoint = two_supports("components = [\"x\"]", "components = [\"y\", \"z\"]");
    assert!(disjoint.and_then(|s| s.prepare()).is_ok());
}

/// Supports at rest that hold the same components are united: the run equals that of disjoint supports, and
/// the first support has the force.
#[test]
fn supports_that_hold_the_same_components_at_rest_are_united() {
    let support = |place: &str, components: &str| {
        format!("[[support]]\nmodel = \"left\"\nwhere = {place}\ncomponents = {components}\n")
    };
    let (head, tail) = SOLIDS
        .split_once("[[support]]\nmodel = \"left\"\nwhere = \"x-min\"\n")
        .expect("a support");
    let probes: String = (1..=3)
        .flat_map(|k| ["x", "y", "z"].map(|c| (k, c)))
        .map(|(k, c)| {
            format!("[probe.{c}{k}]\nof = \"support-{k}\"\nquantity = \"force\"\ncomponent = \"{c}\"\n")
        })
        .collect();
    let run = |supports: &str| {
        let text = format!("{head}{supports}{tail}{probes}");
        let scene = Scene::from_text(text).and_then(|s| s.prepare()).expect("built");
        scene.run(&mut Silent).expect("runs")
    };
    let xyz = "[\"x\", \"y\", \"z\"]";
    let united = run(&[
        support("\"x-min\"", xyz),
        support("\"y-min\"", "[\"y\"]"),
        support("\"z-min\"", "[\"z\", \"y\"]"),
    ]
    .concat());
    // The same supports without the nodes that an earlier one holds.
    let beside = |axis: &str, low: &str| format!("{{ box = {{ low = {low}, high = [6.0, {axis}] }} }}");
    let disjoint = run(&[
        support("\"x-min\"", xyz),
        support(&beside("0.0, 1.0", "[0.5, 0.0, 0.0]"), "[\"y\"]"),
        support(&beside("1.0, 0.0", "[0.5, 0.5, 0.0]"), "[\"z\", \"y\"]"),
        support(
            "{ box = { low = [0.5, 0.0, 0.0], high = [6.0, 0.0, 0.0] } }",
            "[\"z\"]",
        ),
    ]
    .concat());
    let tip = |r: &Results| r.probe("tip").expect("a probe").1.to_vec();
    assert!(tip(&united).iter().any(|u| u.abs() > 1e-6));
    assert_eq!(tip(&united), tip(&disjoint));
    let force = |r: &Results, name: &str| r.probe(name).expect("a probe").1.to_vec();
    for name in ["x1", "y1", "z1", "y2", "y3"] {
        assert_eq!(force(&united, name), force(&disjoint, name), "{name}");
    }
    assert!(force(&united, "y1").iter().any(|f| f.abs() > 1e-9));
}

/// Names of loads and rigid bodies become column heads, so names that would break a table (such as those with
/// a comma) are refused.
#[test]
fn names_that_would_break_tables_are_refused() {
    for name in ["tip, end", "a\"b", "two\nlines", "\" \"", "a;b"] {
        let refusal = refused(solids().set("load.0.name", name));
        assert_says(&refusal, "load[0].name", &["head of tables", "take letters"]);
    }
    let grains = SOLIDS.replacen(
        "kind = \"fem\"\nrole = \"fine\"",
        "kind = \"dem\"\nrole = \"fine\"",
        1,
    ) + "[[effect]]\nmodels = [\"right\"]\nobstacle = { name = \"ball, big\", shape.plane = { point = [0.0, 0.0, -1.0], \
           normal = [0.0, 0.0, 1.0] } }\n";
    let refusal = refused(Scene::from_text(grains));
    assert_says(
        &refusal,
        "effect[0].obstacle.name",
        &["ball, big", "head of tables"],
    );
    assert!(
        solids()
            .set("load.0.name", "tip of the bar")
            .expect("sets")
            .prepare()
            .is_ok()
    );
}

#[test]
fn numbers_that_a_key_cannot_take_are_refused_with_key_value_and_remedy() {
    for (value, shown) in [
        (f64::NAN, "NaN"),
        (-f64::NAN, "NaN"),
        (f64::INFINITY, "inf"),
        (f64::NEG_INFINITY, "-inf"),
    ] {
        assert_says(
            &refused(solids().set("time.end", value)),
            "time.end",
            &[shown, "must be a finite number", "give one"],
        );
    }
    let set = |path: &str, value: &str| refused(solids().set(path, value));
    assert_says(
        &set("output.every", "99999999999999999999"),
        "output.every",
        &["99999999999999999999", "a whole number from 0 on"],
    );
    assert_says(
        &set("output.every", "-1"),
        "output.every",
        &["-1", "a whole number from 0 on"],
    );
    assert_says(
        &set("time.end", "soon"),
        "time.end",
        &["soon", "a number, such as 1.5e-3"],
    );
    assert_says(&set("output.plots", "1"), "output.plots", &["true or false"]);
    for date in ["1979-05-27", "1979-05-27T07:32:00Z", "07:32:00"] {
        assert_says(
            &set("time.end", date),
            "time.end",
            &[date, "is a date", "give a number"],
        );
        let text = SOLIDS.replace("end = 10.0", &format!("end = {date}"));
        assert_says(
            &refused(Scene::from_text(text)),
            "time.end",
            &[date, "give a number"],
        );
    }
    let text = SOLIDS.replace("end = 10.0", "end = 99999999999999999999");
    let message = refused(Scene::from_text(text)).to_string();
    assert!(
        message.contains("write it with a point or an exponent, such as 1e20"),
        "{message}"
    );
}

#[test]
fn choices_say_what_there_is_to_choose() {
    let set = |path: &str, value: &str| refused(solids().set(path, value));
    let vector = set("initial.0.velocity", "[1.0, 0.0, 0.0]");
    assert_says(
        &vector,
        "initial.0.velocity",
        &["{ uniform = [x, y, z] }", "polynomial"],
    );
    let second = set("model.left.shape.file", "x.msh");
    assert_says(
        &second,
        "model.left.shape.file",
        &["one key too many", "set the whole table"],
    );
    assert_says(
        &set("load.0.time", "ramp"),
        "load.0.time",
        &["\"step\", { ramp = { duration = seconds } }"],
    );
    assert_says(
        &set("time.step", "1e-6"),
        "time.step",
        &["{ fraction = ", "{ seconds = step }"],
    );
    // A second key beside the choice is refused, not ignored.
    let two_shapes = "{ box = { low = [0.0, 0.0, 0.0], high = [1.0, 1.0, 1.0] }, cone = 1 }";
    assert_says(
        &set("support.0.where", two_shapes),
        "support.0.where",
        &["'cone' is one key too many"],
    );
    let set = solids().set("load.0.time", "step").expect("a word of its own");
    assert!(set.prepare().is_ok());
}

#[test]
fn paths_are_read_as_messages_and_toml_write_them() {
    let set = solids()
        .set("support[0].where", "y-min")
        .expect("brackets")
        .set("\"time\".end", 3.0)
        .expect("quotes");
    assert_eq!(set.spec().support[0].at.to_string(), "'y-min'");
    assert_eq!(set.spec().time.end, Some(3.0));
    let text = SOLIDS.replace("[probe.tip]", "[probe.\"t.i.p\"]");
    let dotted = Scene::from_text(text)
        .expect("reads")
        .set("probe.\"t.i.p\".component", "y")
        .expect("sets");
    let refusal = refused(Ok(dotted));
    assert_says(&refusal, "probe.t.i.p", &["rename it"]);
    assert_says(
        &refused(solids().set("time..end", 1)),
        "time..end",
        &["quote a name"],
    );
    assert_says(
        &refused(solids().set("probe.top.component", "y")),
        "probe.top.component",
        &["it has: tip"],
    );
    assert_says(
        &refused(solids().assign(&["time.end".into()])),
        "time.end",
        &["PATH=VALUE"],
    );
    assert_says(
        &refused(solids().assign(&["time.ende=".into()])),
        "time.ende",
        &["cannot remove time.ende: it is not in the scene"],
    );
    let changes = [
        "model.left.spacing=",
        "model.left.divisions=[6, 1, 1]",
        "initial[0].spin={ rate = [0.0, 0.0, 0.0] }",
        "initial[0].velocity=",
        "title=a bar",
        "title=",
    ];
    let without = solids().assign(&changes.map(String::from)).expect("removes");
    let spec = without.spec();
    assert!(
        spec.model["left"].spacing.is_none() && spec.initial[0].velocity.is_none() && spec.title.is_none()
    );
    assert!(without.prepare().is_ok());
}

/// Errors of the core, and of changes in memory, name their key of the scene.
#[test]
fn errors_say_their_key() {
    assert_says(
        &refused(solids().set(
            "interface.joint.junction",
            "{ kind = \"h1-strain\", length = -1.0 }",
        )),
        "interface.joint.junction.length",
        &["-1"],
    );
    assert_says(
        &refused(solids().set("time.step.seconds", 1e9)),
        "time.step.seconds",
        &[],
    );
    assert_says(
        &refused(solids().set("time.step", "{ seconds = 1e9 }")),
        "time.step.seconds",
        &["critical step"],
    );
}

#[test]
fn a_spacing_larger_than_the_body_is_refused() {
    let too_large = |text: &str, model: &str| {
        let path = format!("model.{model}.spacing");
        assert_says(
            &refused(Scene::from_text(text).and_then(|s| s.set(&path, 1000))),
            &path,
            &["1000", "longest side of 6 m", "choose"],
        );
    };
    too_large(SOLIDS, "left");
    too_large(LINES, "bar");
    too_large(LINES, "chain");
    for kind in ["cnem", "dem"] {
        let scene = Scene::from_text(SOLIDS).and_then(|s| s.set("model.right.kind", kind));
        assert_says(
            &refused(scene.and_then(|s| s.set("model.right.spacing", 1000))),
            "model.right.spacing",
            &["longest side of 6 m"],
        );
    }
    // The spacing is shorter than the longest side, yet no sphere of that size fits.
    let too_coarse = Scene::from_text(SOLIDS)
        .and_then(|s| s.set("model.right.kind", "dem"))
        .and_then(|s| s.set("model.right.spacing", 5.0));
    assert_says(
        &refused(too_coarse),
        "model.right.spacing",
        &["5", "spheres", "choose"],
    );
}

#[test]
fn an_overlap_outside_the_models_is_called_so() {
    let slab = |coarse: [f64; 3], fine: [f64; 3]| {
        refused(solids().set(
            "interface.joint.overlap.slab",
            format!("{{ coarse = {coarse:?}, fine = {fine:?} }}"),
        ))
    };
    let boxes = [
        "'left' from [0.0, 0.0, 0.0] to [6.0, 1.0, 1.0] m",
        "'right' from [4.0, 0.0, 0.0] to [10.0, 1.0, 1.0] m",
    ];
    for (coarse, fine) in [
        ([14.0, 0.0, 0.0], [16.0, 0.0, 0.0]),
        ([-4.0, 0.0, 0.0], [-6.0, 0.0, 0.0]),
        ([0.0, 2.0, 0.0], [0.0, 3.0, 0.0]),
    ] {
        let refusal = slab(coarse, fine);
        assert_says(
            &refusal,
            "interface.joint.overlap",
            &["does not lie in the models", "'left' and 'right'"],
        );
        assert_says(&refusal, "interface.joint.overlap", &boxes);
        assert_says(
            &refusal,
            "interface.joint.overlap",
            &[&format!("{coarse:?}"), &format!("{fine:?}")],
        );
    }
    // The overlap lies in one of the models only.
    let refusal = slab([1.0, 0.0, 0.0], [3.0, 0.0, 0.0]);
    assert_says(
        &refusal,
        "interface.joint.overlap",
        &["does not lie in model 'right'", boxes[1]],
    );
    let shell = |centre: f64, core: f64, domain: f64| {
        let ball = |r: f64| format!("{{ ball = {{ centre = [{centre:?}, 0.5, 0.5], radius = {r:?} }} }}");
        let overlap = format!(
            "{{ shell = {{ core = {}, domain = {} }} }}",
            ball(core),
            ball(domain)
        );
        let mediator = "{ box = { low = [4.0, 0.0, 0.0], high = [6.0, 1.0, 1.0] } }";
        let set = solids().set("interface.joint.mediator.shape", mediator);
        refused(set.and_then(|s| s.set("interface.joint.overlap", overlap)))
    };
    assert_says(
        &shell(20.0, 1.0, 2.0),
        "interface.joint.overlap",
        &["does not lie in the models", boxes[0], "[18.0, -1.5, -1.5]"],
    );
    // Both models lie within the region where the shell leaves the fine one alone.
    assert_says(
        &shell(5.0, 50.0, 60.0),
        "interface.joint.overlap",
        &["does not lie in the models", boxes[1]],
    );
    let line =
        Scene::from_text(LINES).and_then(|s| s.set("interface.joint.overlap.slab.coarse", "[7.0, 0.0, 0.0]"));
    let line = line.and_then(|s| s.set("interface.joint.overlap.slab.fine", "[6.5, 0.0, 0.0]"));
    assert_says(
        &refused(line),
        "interface.joint.overlap",
        &["does not lie in model 'chain'"],
    );
}

#[test]
fn an_effect_that_a_line_cannot_have_is_blamed_itself() {
    let refused_effect =
        |effect: &str| refused(Scene::from_text(LINES).and_then(|s| s.set("effect", effect)));
    let refusal = refused_effect("[{ bulk_viscosity = {} }]");
    assert_says(&refusal, "effect[0]", &["bulk_viscosity", "remove it"]);
    let refusal =
        refused_effect("[{ mass_damping = { rate = 1.0 } }, { models = [\"bar\"], bulk_viscosity = {} }]");
    assert_says(
        &refusal,
        "effect[1].models[0]",
        &["bulk_viscosity needs a solid", "'bar'", "stiffness_damping"],
    );
}

/// A probe in a notch seven spacings wide is refused. In a notch of one spacing it reads both sides.
#[test]
fn a_probe_in_the_void_of_a_notch_is_refused() {
    let scene = |half: f64| {
        let cut = [2e-3 - half, 2e-3 + half];
        format!(
            "[model.plate]\nkind = \"dem\"\nspacing = 0.5e-3\n\
             shape.box = {{ low = [0.0, 0.0, 0.0], high = [6e-3, 4e-3, 2e-3] }}\n\
             material = {{ young = 72.5e9, poisson = 0.17, density = 2200.0 }}\n\
             dem.notch = [{{ low = [-1e-3, {:e}, -1e-3], high = [3e-3, {:e}, 3e-3] }}]\n\
             [probe.p]\nmodel = \"plate\"\nat = [1.5e-3, 2e-3, 1e-3]\ncomponent = \"y\"\n\
             [[initial]]\nvelocity.uniform = [0.0, 0.0, 0.0]\n[time]\nend = 1e-7\n",
            cut[0], cut[1]
        )
    };
    let built = |half: f64| Scene::from_text(scene(half)).and_then(|s| s.prepare());
    let Err(e) = built(1.75e-3) else {
        panic!("a probe in a void is taken");
    };
    assert_eq!(e.place().0, Some("probe.p.at"), "{e}");
    let words = [
        "lies in no part of model 'plate'",
        "nearest node is",
        "move the probe into the model",
    ];
    for word in words {
        assert!(e.to_string().contains(word), "{e}");
    }
    assert!(built(0.25e-3).is_ok());
}
