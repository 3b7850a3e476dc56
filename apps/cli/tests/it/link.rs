//! Scenes with a solver in another process: the shipped chain in C against our own chain.
#![cfg(unix)]

use crate::common::{
    arlequin, command, number, schemas::verdict, scratch, succeed, summary, text, unwrapped, wait_for,
};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

/// A bar pulled at its left end, and a fine side of 61 masses from −20 on.
const SCENE: &str = r#"
[model.bar]
kind = "fem"
role = "coarse"
shape.bar = { from = -100.0, to = 0.0, section = 1.0 }
divisions = [10]
material = { young = 1.0, density = 1.0 }

[model.fine]
FINE
role = "fine"
step = { ratio = 4 }

[interface.overlap]
coarse = "bar"
fine = "fine"
overlap.slab = { coarse = [-20.0, 0.0, 0.0], fine = [0.0, 0.0, 0.0] }
mediator.divisions = [2]
weight = { profile = "cubic" }

[[load]]
model = "bar"
where = "x-min"
force = [1e-2, 0.0, 0.0]
time.pulse = { duration = 60.0 }

[time]
end = 200.0
step.seconds = 3.2

[output]
plots = false

[probe.tip]
model = "fine"
where = "x-max"
component = "x"

[probe.inside]
model = "fine"
at = [3.25, 0.0, 0.0]
component = "x"
quantity = "velocity"
"#;

const LINK: &str = "kind = \"link\"\ncommand = [\"./chain\"]\ntimeout = 60.0";
const CHAIN: &str = "kind = \"chain\"\nshape.bar = { from = -20.0, to = 40.0, section = 1.0 }\nspacing = 1.0\nmaterial = { young = \
                     1.0, density = 1.0 }";

/// Writes a scene file with the given fine model.
fn write(folder: &Path, name: &str, fine: &str) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, SCENE.replace("FINE", fine)).expect("scene");
    path
}

/// Builds the shipped chain in C in a folder.
fn build_chain(folder: &Path) {
    let clients = Path::new(env!("CARGO_MANIFEST_DIR")).join("../link/clients/c");
    let built = Command::new("cc")
        .args(["-std=c99", "-O2", "-o"])
        .arg(folder.join("chain"))
        .args(["chain.c", "arlequin_link.c"].map(|f| clients.join(f)))
        .arg("-lm")
        .output()
        .expect("cc, which links Rust as well");
    assert!(
        built.status.success(),
        "{}",
        String::from_utf8_lossy(&built.stderr)
    );
}

fn table(folder: &Path, name: &str) -> Vec<Vec<f64>> {
    let text = std::fs::read_to_string(folder.join(name)).expect("table");
    let row = |l: &str| l.split(',').map(|x| x.parse().expect("number")).collect();
    text.lines().skip(1).map(row).collect()
}

#[test]
fn a_chain_behind_a_link_gives_the_probes_and_the_energies_of_ours() {
    let folder = scratch("link-same");
    build_chain(&folder);
    let outs = [("link", LINK), ("chain", CHAIN)].map(|(name, fine)| {
        let scene = write(&folder, &format!("{name}.toml"), fine);
        let out = folder.join(format!("results-{name}"));
        succeed(&["run", text(&scene), "--out", text(&out)]);
        out
    });
    let [remote, local] = outs.each_ref().map(|o| table(o, "probes.csv"));
    assert!(local.len() == remote.len() && local.len() > 60, "{}", local.len());
    for column in 1..local[0].len() {
        let top = local.iter().fold(0.0_f64, |m, r| m.max(r[column].abs()));
        let gap = local
            .iter()
            .zip(&remote)
            .fold(0.0_f64, |m, (a, b)| m.max((a[column] - b[column]).abs()));
        assert!(
            top > 1e-3 && gap < 1e-12 * top,
            "column {column}: {gap:e} of {top:e}"
        );
    }
    let [a, b] = outs.each_ref().map(|o| summary(o));
    assert!(number(&a, "/energy/h_drift_max").abs() < 1e-11);
    assert_eq!(a["steps"], b["steps"]);
}

#[test]
fn check_starts_nothing_unless_it_is_told_to_and_then_tells_what_answered() {
    let folder = scratch("link-check");
    build_chain(&folder);
    let careful = write(
        &folder,
        "careful.toml",
        "kind = \"link\"\ncommand = [\"touch\", \"a file\"]",
    );
    let printed = unwrapped(&succeed(&["check", text(&careful)]));
    assert!(
        printed.contains("starts touch 'a file'") && printed.contains("--start"),
        "{printed}"
    );
    assert!(!folder.join("a file").exists());
    let json: serde_json::Value =
        serde_json::from_str(&succeed(&["check", "--json", text(&careful)])).expect("JSON");
    assert_eq!(json[0]["does"], "starts touch 'a file'");
    let scene = write(&folder, "scene.toml", LINK);
    let printed = unwrapped(&succeed(&["check", "--start", text(&scene)]));
    for word in [
        "starts ./chain",
        "mass 6.000000e1 kg",
        "c-chain",
        "61 nodes",
        "critical step 1.0000e0 s",
    ] {
        assert!(printed.contains(word), "'{word}' is not in: {printed}");
    }
}

#[test]
fn a_scene_waits_at_an_address_for_who_comes() {
    let folder = scratch("link-address");
    build_chain(&folder);
    let socket = format!("unix:{}", text(&folder.join("socket")));
    let scene = write(
        &folder,
        "scene.toml",
        &format!("kind = \"link\"\naddress = \"{socket}\"\ntimeout = 60.0"),
    );
    let run = command(&["run", text(&scene), "--out", text(&folder.join("out"))])
        .stderr(std::process::Stdio::piped())
        .spawn()
        .expect("starts");
    // The chain tries to connect for five seconds.
    wait_for(&folder.join("socket"));
    let peer = Command::new(folder.join("chain"))
        .arg(&socket)
        .status()
        .expect("the chain");
    let run = run.wait_with_output().expect("ends");
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    assert!(peer.success());
    assert!(!folder.join("socket").exists(), "the socket is left");
}

#[test]
fn a_solver_that_is_killed_ends_the_run_with_its_results_and_the_run_goes_on_in_another() {
    let folder = scratch("link-killed");
    build_chain(&folder);
    // The first chain is killed as soon as there is a checkpoint.
    let script = "if [ -e tame ]; then exec ./chain; fi; touch tame; ./chain & until find . -name checkpoint.bin | grep -q .; do sleep \
                  0.01; done; kill -9 $!; exit 1";
    let fine = format!("kind = \"link\"\ntimeout = 60.0\ncommand = [\"sh\", \"-c\", \"{script}\"]");
    let scene = write(&folder, "scene.toml", &fine);
    let settings = [
        "--set",
        "time.end=100000.0",
        "--set",
        "output.checkpoint_every=200",
        "--set",
        "output.every=40000",
    ];
    let run = |out: &Path| {
        let out = [&["run", text(&scene), "--out", text(out)], &settings[..]].concat();
        arlequin(&out)
    };
    let out = folder.join("out");
    let failed = run(&out);
    let error = String::from_utf8_lossy(&failed.stderr).into_owned();
    assert!(
        !failed.status.success() && error.contains("model 'fine'"),
        "{error}"
    );
    assert!(
        error.contains("ended with exit status: 1") || error.contains("closed the link"),
        "{error}"
    );
    let resumed = arlequin(&["resume", text(&out)]);
    assert!(
        resumed.status.success(),
        "{}",
        String::from_utf8_lossy(&resumed.stderr)
    );
    let whole = folder.join("whole");
    assert!(run(&whole).status.success());
    for file in ["probes.csv", "energy.csv"] {
        let read = |f: &Path| std::fs::read(f.join(file)).expect("table");
        assert!(read(&out) == read(&whole), "{file} differs");
    }
}

/// Sends a signal to a run of this scene once `ready` holds; returns its error, after at most some seconds.
fn signalled(signal: &str, scene: &Path, out: &Path, extra: &[&str], ready: &dyn Fn() -> bool) -> String {
    let arguments = [&["run", text(scene), "--out", text(out)], extra].concat();
    let run = command(&arguments).stderr(std::process::Stdio::piped()).spawn();
    let run = run.expect("starts");
    while !ready() {
        std::thread::sleep(Duration::from_millis(5));
    }
    std::thread::sleep(Duration::from_millis(300));
    let begin = Instant::now();
    let kill = Command::new("kill")
        .args([signal, &run.id().to_string()])
        .status();
    assert!(kill.expect("kill").success());
    let ended = run.wait_with_output().expect("ends");
    let error = String::from_utf8_lossy(&ended.stderr).into_owned();
    assert_eq!(ended.status.code(), Some(130), "{error}");
    assert!(
        begin.elapsed() < Duration::from_secs(8),
        "{signal}: {:?}",
        begin.elapsed()
    );
    assert!(error.contains("interrupted while 'fine'"), "{error}");
    error
}

#[test]
fn signals_end_a_run_that_waits_for_a_solver_to_start_and_what_it_started() {
    let folder = scratch("link-signal-start");
    for signal in ["-INT", "-TERM"] {
        let number = folder.join("number");
        let _ = std::fs::remove_file(&number);
        let script = "echo $$ > new; mv new number; exec sleep 100";
        let fine = format!("kind = \"link\"\ncommand = [\"sh\", \"-c\", \"{script}\"]");
        let scene = write(&folder, "scene.toml", &fine);
        let out = folder.join("out");
        let error = signalled(signal, &scene, &out, &[], &|| number.exists());
        assert!(error.contains("a connection to unix:"), "{error}");
        let started = std::fs::read_to_string(&number).expect("number");
        let kill_check = Command::new("kill")
            .args(["-0", started.trim()])
            .output()
            .expect("kill");
        assert!(!kill_check.status.success(), "what the run started is left");
        assert!(!out.exists());
    }
}

#[test]
fn signals_end_a_run_whose_solver_does_not_answer_and_it_goes_on_later() {
    let folder = scratch("link-signal-step");
    build_chain(&folder);
    let script = "if [ -e tame ]; then exec ./chain; fi; touch tame; ./chain & until find . -name checkpoint.bin | grep -q .; do sleep \
                  0.01; done; kill -STOP $!; wait";
    let fine = format!("kind = \"link\"\ntimeout = 600.0\ncommand = [\"sh\", \"-c\", \"{script}\"]");
    let scene = write(&folder, "scene.toml", &fine);
    let settings = [
        "time.end=100000.0",
        "output.checkpoint_every=200",
        "output.every=40000",
    ];
    let settings: Vec<&str> = settings.iter().flat_map(|m| ["--set", m]).collect();
    let out = folder.join("out");
    let saved = || {
        let find = Command::new("find")
            .arg(&folder)
            .args(["-name", "checkpoint.bin"])
            .output();
        !find.expect("find").stdout.is_empty()
    };
    let error = signalled("-INT", &scene, &out, &settings, &saved);
    assert!(error.contains("was due"), "{error}");
    let resumed = arlequin(&["resume", text(&out)]);
    let error = String::from_utf8_lossy(&resumed.stderr);
    assert!(resumed.status.success(), "{error}");
    assert_eq!(summary(&out)["status"], "complete");
}

/// Fine models, changes to them, and words of the resulting error.
const BAD: &[(&str, &str, &str)] = &[
    ("kind = \"link\"", "", "a link needs exactly one of command"),
    (
        "kind = \"link\"\ncommand = [\"a\"]\naddress = \"unix:b\"",
        "",
        "a link needs exactly one of command",
    ),
    ("kind = \"link\"\ncommand = []", "", "names no program"),
    (
        "kind = \"link\"\ncommand = \"./chain\"",
        "",
        "expected a sequence",
    ),
    (
        "kind = \"link\"\naddress = \"tcp:10.0.0.1:70\"",
        "",
        "write tcp-open",
    ),
    ("kind = \"link\"\naddress = \"nowhere\"", "", "must be unix:PATH"),
    (LINK, "--set=model.fine.timeout=0", "must be positive [s]"),
    (LINK, "--set=model.fine.start_timeout=-1", "the default is 30"),
    (
        LINK,
        "--set=model.fine.spacing=1.0",
        "is the business of the program behind the link",
    ),
    (
        LINK,
        "--set=model.fine.material={ young = 1.0, density = 1.0 }",
        "is the business of the program",
    ),
    (
        LINK,
        "--set=model.fine.shape={ bar = { from = 0.0, to = 1.0, section = 1.0 } }",
        "is the business of the program",
    ),
    (
        LINK,
        "--set=model.fine.step={ scheme = 'implicit' }",
        "is for linear solids",
    ),
    (
        LINK,
        "--set=model.bar.command=['./chain']",
        "is for kind = \"link\"",
    ),
    (
        LINK,
        "--set=interface.overlap.absorber={ rate_factor = 0.1 }",
        "which is a link and does not tell it",
    ),
    (
        LINK,
        "--set=initial=[{ models = ['fine'], velocity = { uniform = [1.0, 0.0, 0.0] } }]",
        "have an initial state of the core",
    ),
    (LINK, "--set=load.0.model=fine", "have an effect of the core"),
    (
        LINK,
        "--set=support=[{ model = 'fine', where = 'x-max' }]",
        "have a support of the core",
    ),
    (
        LINK,
        "--set=effect=[{ models = ['fine'], fracture = { criterion = 'energy', strength = 1.0 } }]",
        "fracture needs kind = \"dem\"",
    ),
    (
        "kind = \"fem\"\ndivisions = [60]\nmaterial = { young = 1.0, density = 1.0 }",
        "",
        "missing field `shape`",
    ),
    (
        "kind = \"fem\"\ndivisions = [60]\nshape.bar = { from = -20.0, to = 40.0, section = 1.0 }",
        "",
        "missing field `material`",
    ),
    (
        "kind = \"link\"\ncommand = [\"./no-such-program\"]",
        "",
        "cannot be started",
    ),
    (
        "kind = \"link\"\ncommand = [\"true\"]",
        "",
        "ended with exit status: 0 before it connected",
    ),
];

#[test]
fn what_a_link_cannot_have_is_refused_by_key() {
    let folder = scratch("link-bad");
    build_chain(&folder);
    for &(fine, set, word) in BAD {
        let scene = write(&folder, "scene.toml", fine);
        let mut arguments = vec!["check", "--start", text(&scene)];
        arguments.extend(Some(set).filter(|s| !s.is_empty()));
        let out = arlequin(&arguments);
        let error = String::from_utf8_lossy(&out.stderr);
        assert!(
            !out.status.success() && error.contains(word),
            "{fine}, {set}: {error}"
        );
        assert!(
            ["fine", "bar", "scene.toml:"].iter().any(|w| error.contains(w)),
            "{fine}, {set}: {error}"
        );
    }
    let scene = write(&folder, "scene.toml", LINK);
    let still = SCENE
        .replace("FINE", LINK)
        .replace("[time]\nend = 200.0\nstep.seconds = 3.2", "[static]\nsteps = 1");
    std::fs::write(&scene, still).expect("scene");
    let error = String::from_utf8_lossy(&arlequin(&["check", text(&scene)]).stderr).into_owned();
    assert!(error.contains("which steps by itself"), "{error}");
}

#[test]
fn the_schema_knows_links() {
    for (fine, verdict_due) in [
        (LINK, Some(true)),
        (CHAIN, Some(true)),
        ("kind = \"link\"", Some(false)),
        ("kind = \"fem\"", Some(false)),
        ("kind = \"link\"\ncommand = [1]", Some(false)),
    ] {
        assert_eq!(
            verdict("scene", &SCENE.replace("FINE", fine)),
            verdict_due,
            "{fine}"
        );
    }
}
