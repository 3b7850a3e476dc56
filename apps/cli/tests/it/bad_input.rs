//! Bad input: each case is refused before the first step with its own error text.

use crate::common::{SMALL, arlequin, schemas, scratch, text};
use std::path::PathBuf;

/// A mesh file of one tetrahedron: node lines `x y z` and the corners of its element.
fn mesh(nodes: &[&str], corners: &str) -> String {
    let count = nodes.len();
    let tags: String = (1..=count).map(|k| format!("{k}\n")).collect();
    let lines = nodes.join("\n");
    format!(
        "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 {count} 1 {count}\n3 1 0 {count}\n{tags}{lines}\n$EndNodes\n\
         $Elements\n1 1 1 1\n3 1 4 1\n1 {corners}\n$EndElements\n"
    )
}

const CORNERS: [&str; 4] = ["0 0 0", "1 0 0", "0 1 0", "0 0 1"];
const MEDIATOR: &str = "mediator = { shape.box = { low = [4.0, 0.0, 0.0], high = [6.0, 1.0, 1.0] } }";

struct Bench {
    folder: PathBuf,
}

impl Bench {
    fn new(name: &str) -> Self {
        Self {
            folder: scratch(&format!("bad-{name}")),
        }
    }

    /// Returns the error text of a scene. Asserts that the schema also refuses what the reader refuses.
    fn error(&self, scene: &str) -> String {
        let read = arlequin_scene::Scene::from_text(scene);
        if matches!(read, Err(arlequin_scene::Error::Syntax { .. })) {
            assert_ne!(
                schemas::verdict("scene", scene),
                Some(true),
                "the schema accepts {scene}"
            );
        }
        let path = self.folder.join("scene.toml");
        std::fs::write(&path, scene).expect("scene");
        let error = self.refused(&["check", text(&path)]);
        let out = self.folder.join("never");
        assert_eq!(error, self.refused(&["run", text(&path), "--out", text(&out)]));
        assert!(!out.exists(), "{error}");
        error
    }

    fn refused(&self, arguments: &[&str]) -> String {
        let out = arlequin(arguments);
        let error = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(2), "{arguments:?}: {error}");
        assert!(!error.contains("panicked"), "{error}");
        error
    }

    /// Returns the error text of the small scene with the given replacements.
    fn edited(&self, edits: &[(&str, &str)]) -> String {
        let mut scene = SMALL.to_owned();
        for (from, to) in edits {
            assert!(scene.contains(from), "the scene has no {from}");
            scene = scene.replacen(from, to, 1);
        }
        self.error(&scene)
    }
}

/// Cases that differ from the small scene in one place: old text, new text, part of the error.
fn assert_cases(name: &str, list: &[(&str, &str, &[&str])]) {
    let bench = Bench::new(name);
    for (from, to, expected) in list {
        let error = bench.edited(&[(*from, *to)]);
        for part in *expected {
            assert!(
                error.contains(part),
                "'{to}' should say '{part}', but says:\n{error}"
            );
        }
    }
}

#[test]
fn files_and_syntax() {
    let bench = Bench::new("files");
    let error = bench.refused(&["run", "no-such-scene.toml"]);
    assert!(error.contains("cannot read 'no-such-scene.toml'") && error.contains("check the path"));
    assert_cases(
        "syntax",
        &[
            ("spacing = 1.0", "spacing = = 1.0", &["scene.toml:6:11"]),
            (
                "spacing = 1.0",
                "spacng = 1.0",
                &["unknown field `spacng`", "expected one of", ":6:1"],
            ),
            (
                "spacing = 1.0",
                "spacing = \"wide\"",
                &["invalid type: string \"wide\", expected a number", ":6:11"],
            ),
            (
                "[time]\nsteps = 50",
                "",
                &["needs exactly one of end [s], steps; a scene at rest has [static]"],
            ),
            ("kind = \"fem\"", "kind = \"fdm\"", &["unknown variant `fdm`"]),
            (
                "steps = 50",
                "steps = 1979-05-27",
                &["is a date; a scene knows none"],
            ),
            ("where = \"x-max\"", "where = 3", &["the name of a group or"]),
            (
                "[model.left]",
                "[model.\"le ft\"]",
                &["model.le ft: has a name with other signs"],
            ),
        ],
    );
}

#[test]
fn what_was_probably_meant_is_asked() {
    assert_cases(
        "meant",
        &[
            ("spacing = 1.0", "spacng = 1.0", &["did you mean 'spacing'?"]),
            ("kind = \"fem\"", "kind = \"fme\"", &["did you mean 'fem'?"]),
            (
                "profile = \"cubic\"",
                "profile = \"kubic\"",
                &["did you mean 'cubic'?"],
            ),
            (
                "where = \"x-max\"",
                "where = \"xmax\"",
                &["did you mean 'x-max'?"],
            ),
            (
                "coarse = \"left\"",
                "coarse = \"lfet\"",
                &["did you mean 'left'?"],
            ),
            ("shape.box", "shape.boks", &["did you mean 'box'?"]),
        ],
    );
    let bench = Bench::new("meant-set");
    let path = bench.folder.join("scene.toml");
    std::fs::write(&path, SMALL).expect("scene");
    let error = bench.refused(&["check", text(&path), "--set", "model.rihgt.spacing=1.0"]);
    assert!(error.contains("did you mean 'right'?"), "{error}");
    // No similar key exists, so the error suggests none.
    let error = bench.refused(&["check", text(&path), "--set", "time.colour=1.0"]);
    assert!(
        error.contains("unknown field `colour`") && !error.contains("did you mean"),
        "{error}"
    );
    let error = bench.refused(&["chekc", text(&path)]);
    assert!(error.contains("check"), "{error}");
}

#[test]
fn materials_and_meshes() {
    assert_cases(
        "materials",
        &[
            (
                "density = 1.0",
                "density = -1.0",
                &["model.left.material.density = -1: must be positive", ":7:"],
            ),
            (
                "poisson = 0.25",
                "poisson = 0.5",
                &["poisson = 0.5: must lie above -1 and below 0.5"],
            ),
            (
                "young = 1.0",
                "young = 0.0",
                &["model.left.material.young = 0: must be positive [Pa]"],
            ),
            ("poisson = 0.25, ", "", &["a solid needs poisson"]),
            (
                "low = [0.0,",
                "low = [nan,",
                &[
                    "model.left.shape.box.low[0] = NaN: must be a finite number",
                    ":5:",
                ],
            ),
            (
                "high = [6.0,",
                "high = [inf,",
                &["high[0] = inf: must be a finite number"],
            ),
            (
                "high = [6.0,",
                "high = [-6.0,",
                &["high[0] = -6: must be above low[0] = 0 m"],
            ),
            (
                "spacing = 1.0",
                "spacing = 0.0",
                &["model.left.spacing = 0: must be positive [m]"],
            ),
            ("spacing = 1.0", "spacing = 1e-9", &["elements of that length"]),
            ("spacing = 1.0", "", &["model.left: spacing is missing"]),
            (
                "spacing = 1.0",
                "spacing = 1.0\ndivisions = [6, 1, 1]",
                &["spacing and divisions exclude each other"],
            ),
            (
                "spacing = 1.0",
                "divisions = [6, 0, 1]",
                &["divisions[1] = 0: must be at least 1"],
            ),
            (
                "kind = \"fem\"\nrole = \"fine\"",
                "kind = \"chain\"\nrole = \"fine\"",
                &["a chain is a line; use the shape bar"],
            ),
        ],
    );
}

#[test]
fn holes() {
    let bench = Bench::new("holes");
    let holed = |from: &str, to: &str| {
        let hole = format!("high = [6.0, 1.0, 1.0], hole = {{ low = {from}, high = {to} }} }}");
        let mediator = ("weight = { profile = \"cubic\" }", MEDIATOR);
        bench.edited(&[("high = [6.0, 1.0, 1.0] }", &hole), mediator])
    };
    for (from, to, expected) in [
        (
            "[0.5, 0.0, 0.0]",
            "[2.0, 1.0, 1.0]",
            "hole corner x = 0.5: must lie on a face between elements",
        ),
        (
            "[2.0, 0.0, 0.0]",
            "[2.0, 1.0, 1.0]",
            "model.left.shape.box.hole.high[0] = 2: must be above low[0] = 2 m",
        ),
        ("[8.0, 0.0, 0.0]", "[9.0, 1.0, 1.0]", "hole and box do not meet"),
    ] {
        let error = holed(from, to);
        assert!(error.contains(expected), "{error}");
    }
    let hole = "high = [6.0, 1.0, 1.0], hole = { low = [1.0, 0.0, 0.0], high = [2.0, 1.0, 1.0] } }";
    let error = bench.edited(&[("high = [6.0, 1.0, 1.0] }", hole)]);
    assert!(error.contains("the mediator cannot be derived"), "{error}");
}

#[test]
fn mesh_files() {
    let bench = Bench::new("mesh-files");
    let mesh_error = |nodes: &[&str], corners: &str| {
        std::fs::write(bench.folder.join("body.msh"), mesh(nodes, corners)).expect("mesh");
        bench.edited(&[
            (
                "shape.box = { low = [0.0, 0.0, 0.0], high = [6.0, 1.0, 1.0] }",
                "shape.file = \"body.msh\"",
            ),
            ("spacing = 1.0\n", "\n"),
            ("weight = { profile = \"cubic\" }", MEDIATOR),
        ])
    };
    assert!(mesh_error(&CORNERS, "1 3 2 4").contains("inverted"));
    let mut extended = CORNERS.to_vec();
    extended.push("5 5 5");
    let error = mesh_error(&extended, "1 2 3 4");
    assert!(
        error.contains("belongs to no element and would have no mass"),
        "{error}"
    );
    let error = mesh_error(&["0 0 0", "nan 0 0", "0 1 0", "0 0 1"], "1 2 3 4");
    assert!(error.contains("model.left.shape.file"), "{error}");
    let missing = bench.edited(&[
        (
            "shape.box = { low = [0.0, 0.0, 0.0], high = [6.0, 1.0, 1.0] }",
            "shape.file = \"none.msh\"",
        ),
        ("spacing = 1.0\n", "\n"),
    ]);
    assert!(missing.contains("none.msh' cannot be read"), "{missing}");
    let message = bench.edited(&[(
        "shape.box = { low = [0.0, 0.0, 0.0], high = [6.0, 1.0, 1.0] }",
        "shape.file = \"body.msh\"",
    )]);
    assert!(
        message.contains("a mesh file brings its own spacing"),
        "{message}"
    );
}

#[test]
fn interfaces() {
    let weight = "weight = { profile = \"cubic\" }";
    let with_keys = |extra: &str| format!("{weight}\n{extra}");
    let distant = with_keys("mediator = { shape.box = { low = [20.0, 0.0, 0.0], high = [22.0, 1.0, 1.0] } }");
    let overhanging =
        with_keys("mediator = { shape.box = { low = [4.0, 0.0, 0.0], high = [6.0, 2.0, 1.0] } }");
    let nodes_out = with_keys(
        "sampling = \"projection\"\nmediator = { shape.box = { low = [4.0, 0.0, 0.0], high = [6.0, 2.0, 1.0] } }",
    );
    let lumped = with_keys("lumped = true\njunction = { kind = \"h1-strain\" }");
    let unknown = with_keys("solver = \"multigrid\"");
    let particles = with_keys("sampling = \"particles\"");
    let length = with_keys("junction = { kind = \"l2\", length = 1.0 }");
    let negative = with_keys("junction = { kind = \"h1-strain\", length = -1.0 }");
    let rate = with_keys("absorber = { rate = 1.0, rate_factor = 0.2 }");
    assert_cases(
        "interfaces",
        &[
            (
                weight,
                &distant,
                &[
                    "interface 'joint'",
                    "is empty; place the mediator where both models are",
                ],
            ),
            (
                weight,
                &overhanging,
                &["lies outside model 'left'", "shrink the mediator"],
            ),
            (
                weight,
                &nodes_out,
                &["projection sampling) field; trim the mediator"],
            ),
            (weight, &lumped, &["only a junction of values (L2) may be lumped"]),
            (
                weight,
                &unknown,
                &["multigrid", "`factor`", "`conjugate-gradients`"],
            ),
            (weight, &particles, &["has integration points of its own"]),
            (
                weight,
                &length,
                &["interface.joint.junction.length = 1: the l2 junction has no length"],
            ),
            (
                weight,
                &negative,
                &["junction length = -1: must be finite and not negative"],
            ),
            (
                weight,
                &rate,
                &["needs exactly one of rate [1/s], rate_factor [-]"],
            ),
        ],
    );
}

#[test]
fn weights_and_sides() {
    let weight = "weight = { profile = \"cubic\" }";
    assert_cases(
        "weights",
        &[
            (
                weight,
                "weight = { profile = \"cubic\", epsilon = 0.5 }",
                &["epsilon = 0.5: must be at least 0 and below 0.5"],
            ),
            (
                weight,
                "weight = { profile = \"constant\" }",
                &["the constant profile needs value"],
            ),
            (
                weight,
                "weight = { profile = \"constant\", value = 1.5 }",
                &["constant weight = 1.5: must be between 0 and 1"],
            ),
            (
                weight,
                "weight = { profile = \"constant\", value = 1.0 }",
                &["weighted mass", "choose epsilon > 0"],
            ),
            (
                weight,
                "weight = { profile = \"linear\", value = 0.5 }",
                &["belongs to the constant profile"],
            ),
            (
                "fine = [6.0, 0.0, 0.0] }",
                "fine = [4.0, 0.0, 0.0] }",
                &["overlap width = 0: must be positive"],
            ),
            (
                "fine = \"right\"",
                "fine = \"rigth\"",
                &["there is no model of this name; known: left, right"],
            ),
            (
                "fine = \"right\"",
                "fine = \"left\"",
                &["is coarse and fine side at once ('left')"],
            ),
            (
                "role = \"fine\"",
                "",
                &["interface 'joint' needs role = \"fine\" here"],
            ),
            (
                "fine = [6.0, 0.0, 0.0] }",
                "fine = [6.0, 1.0, 0.0] }",
                &["cannot be derived"],
            ),
        ],
    );
}

#[test]
fn time_and_drives() {
    assert_cases(
        "drives",
        &[
            (
                "steps = 50",
                "steps = 50\nstep.seconds = 10.0",
                &["time step 1e1 s exceeds the critical step", "reduce it"],
            ),
            (
                "steps = 50",
                "steps = 50\nstep.fraction = 1.0",
                &["time.step.fraction = 1: must lie above 0 and below 1"],
            ),
            ("steps = 50", "end = 0.0", &["time.end = 0: must be positive [s]"]),
            ("steps = 50", "steps = 0", &["time.steps = 0: must be at least 1"]),
            (
                "steps = 50",
                "steps = 50\nend = 1.0",
                &["needs exactly one of end [s], steps"],
            ),
            (
                "duration = 2.0",
                "duration = 0.0",
                &["duration of the time function = 0: must be positive"],
            ),
            (
                "time.pulse = { duration = 2.0 }",
                "time.table = [[0.0, 1.0], [0.0, 2.0]]",
                &["table of the time function = 2 rows", "strictly rising times"],
            ),
            (
                "where = \"x-min\"",
                "where = \"left-end\"",
                &["there is no group of the model", "x-max, x-min"],
            ),
            (
                "where = \"x-min\"",
                "where.box = { low = [20.0, 0.0, 0.0], high = [21.0, 1.0, 1.0] }",
                &["support[0].where", "holds no node of model 'left'"],
            ),
            (
                "where = \"x-max\"\nforce",
                "where.box = { low = [5.1, 0.1, 0.1], high = [9.9, 0.9, 0.9] }\nforce",
                &["load[0].where", "holds no surface facet of model 'right'"],
            ),
            (
                "force = [1e-3, 0.0, 0.0]",
                "pressure = 1.0\nforce = [1e-3, 0.0, 0.0]",
                &["exactly one of traction, force"],
            ),
            (
                "force = [1e-3, 0.0, 0.0]",
                "torque = [0.0, 0.0, 0.0]",
                &["needs a moment other than zero"],
            ),
            (
                "[time]",
                "[[effect]]\n[time]",
                &["effect[0]: needs exactly one of body_force, mass_damping"],
            ),
            (
                "[time]",
                "[[effect]]\nmass_damping.rate = -1.0\n[time]",
                &["damping rate = -1: must be finite and not negative"],
            ),
            (
                "[time]",
                "[[initial]]\nwave = { component = \"x\", along = \"x\", centre = 0.0, width = 0.0, amplitude = 1.0 }\n[time]",
                &["initial[0].wave.width = 0: must be positive"],
            ),
            (
                "[time]",
                "[[initial]]\n[time]",
                &["initial[0]: needs displacement, velocity, spin or wave"],
            ),
        ],
    );
}

#[test]
fn probes_and_output() {
    let tip = "model = \"right\"\nwhere = \"x-max\"\ncomponent = \"x\"";
    assert_cases(
        "probes",
        &[
            (
                tip,
                "model = \"right\"\nat = [1.0, 0.5, 0.5]\ncomponent = \"x\"",
                &["probe.tip.at = [1.0, 0.5, 0.5] m: lies outside model 'right'"],
            ),
            (
                tip,
                "model = \"right\"\ncomponent = \"x\"",
                &["probe.tip: needs exactly one of at, where"],
            ),
            (
                tip,
                "model = \"wrong\"\nwhere = \"x-max\"\ncomponent = \"x\"",
                &["probe.tip.model = 'wrong'"],
            ),
            (
                "[time]",
                "[output]\nevery = 0\n[time]",
                &["output.every = 0: must be at least 1 step"],
            ),
            (
                "[time]",
                "[output]\nevery = 2\ninterval = 1.0\n[time]",
                &["every and interval exclude each other"],
            ),
            (
                "[time]",
                "[output]\nfields = [\"heat\"]\n[time]",
                &["unknown variant `heat`"],
            ),
        ],
    );
}

#[test]
fn arguments() {
    let bench = Bench::new("arguments");
    let scene = bench.folder.join("scene.toml");
    std::fs::write(&scene, SMALL).expect("scene");
    let path = text(&scene);
    let set = |assignment: &str, expected: &str| {
        let error = bench.refused(&["check", path, "--set", assignment]);
        assert!(
            error.contains(expected),
            "--set {assignment} should say '{expected}':\n{error}"
        );
    };
    set("time.stps=5", "cannot set time.stps = 5: unknown field `stps`");
    set(
        "model.lft.spacing=1.0",
        "the scene has no model 'lft'; it has: left, right",
    );
    set("time.steps", "expected PATH=VALUE");
    set("support.7.model=left", "there is no entry 7: the list has 1");
    set("title.x=1", "cannot set title.x = 1");
    set("model.left.spacing=wide", "invalid type: string \"wide\"");
    set("model.left.spacing.x=1", "'x' is below a plain value");
    let out = bench.folder.join("taken");
    std::fs::create_dir_all(&out).expect("folder");
    let error = bench.refused(&["run", path, "--out", text(&out)]);
    assert!(error.contains("exists; choose another with --out, or replace it with --force"));
    let error = bench.refused(&["run", path, "--out", path, "--force"]);
    assert!(error.contains("is a file, which --force does not replace"));
    let error = bench.refused(&["check", path, "--threads", "0"]);
    assert!(error.contains("--threads = 0: must be at least 1"));
}
