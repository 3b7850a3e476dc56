//! `arlequin sweep` and `arlequin suggest` on scenes that take milliseconds.
#![allow(clippy::unwrap_used, reason = "a test may stop at what it did not expect")]

use crate::common::sweeps::{SWEEP, folder};
use crate::common::{arlequin, number, succeed, text, wait_while_running};
use serde_json::Value;
use std::path::Path;

fn read(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// Asserts that every tag is closed in turn, which a browser needs to show the page as meant.
fn assert_well_formed(html: &str) {
    let mut open: Vec<String> = Vec::new();
    let mut tail = html.strip_prefix("<!DOCTYPE html>").unwrap();
    while let Some(start) = tail.find('<') {
        let end = start + tail[start..].find('>').unwrap();
        let tag = &tail[start + 1..end];
        let name: String = tag
            .trim_start_matches('/')
            .chars()
            .take_while(char::is_ascii_alphanumeric)
            .collect();
        assert!(!name.is_empty(), "no tag in <{tag}>");
        if tag.starts_with('/') {
            assert_eq!(open.pop().as_deref(), Some(name.as_str()));
        } else if !tag.ends_with('/') {
            open.push(name);
        }
        tail = &tail[end + 1..];
    }
    assert!(open.is_empty(), "{open:?} stay open");
}

#[test]
fn a_sweep_runs_reports_and_resumes() {
    let path = folder("sweep-small", SWEEP);
    let out = path.join("out");
    let arguments = ["sweep", text(&path.join("sweep.toml")), "--out", text(&out)].map(str::to_owned);
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let printed = succeed(&arguments);
    assert!(printed.contains("6 made, 0 taken from before"), "{printed}");
    let s = read(&out.join("sweep.json"));
    assert_eq!(s["status"], "complete");
    let runs = s["runs"].as_array().unwrap();
    let labels: Vec<&str> = runs.iter().map(|r| r["label"].as_str().unwrap()).collect();
    assert_eq!(
        labels,
        [
            "all-fine",
            "all-coarse=0.1",
            "all-coarse=0.2",
            "h=0.05",
            "h=0.1",
            "h=0.2"
        ]
    );
    for r in runs {
        for key in ["unknowns", "steps", "dt", "h_drift", "cost", "error_judged"] {
            assert!(r[key].is_number(), "{key} of {r}");
        }
        assert!(number(r, "/seconds/setup") > 0.0 && number(r, "/seconds/stepping") > 0.0);
        assert!(number(r, "/seconds/per_step/interface") >= 0.0);
        assert!(number(r, "/h_drift") < 1e-11);
        assert!(r["pareto"].is_boolean() && r["parameters"].is_object());
        assert!(r["peak_bytes"].as_u64().is_none_or(|b| b > 1_000_000));
        assert!(number(r, "/reflected_energy/joint") < 1e-2);
    }
    // The error is of second order in the element length; the reference has none.
    let error = |k: usize| number(&runs[k], "/errors/displacement");
    assert_eq!(error(0).to_bits(), 0);
    for (fine, coarse) in [(1, 2), (3, 4), (4, 5)] {
        let order = (error(coarse) / error(fine)).log2();
        assert!((1.5..2.5).contains(&order), "order {order}");
    }
    assert!(runs[3]["condition"].is_number() && runs[0]["condition"].is_null());
    assert!(number(&runs[3], "/seconds/per_step/forces fine") > 0.0);
    assert!(number(&s, "/floor_seconds") > 0.0);
    let csv = std::fs::read_to_string(out.join("sweep.csv")).unwrap();
    assert_eq!(csv.lines().count(), 7);
    let page = std::fs::read_to_string(out.join("report.html")).unwrap();
    assert_well_formed(&page);
    assert!(!page.contains("http") && !page.contains("<script") && !page.contains("NaN"));
    assert!(
        page.contains("Chain &lt;and&gt; bar") && page.matches("<svg").count() == 6,
        "three pictures, each for broad and for narrow screens"
    );
    // A second sweep makes no run and changes nothing.
    let printed = succeed(&arguments);
    assert!(printed.contains("0 made, 6 taken from before"), "{printed}");
    let repeated = read(&out.join("sweep.json"));
    assert_eq!(repeated["runs"][4]["seconds"], runs[4]["seconds"]);
    // A changed scene repeats its own runs and no others.
    let scene = path.join("coupled.toml");
    let changed = std::fs::read_to_string(&scene)
        .unwrap()
        .replace("\"cubic\"", "\"quintic\"");
    std::fs::write(&scene, changed).unwrap();
    let printed = succeed(&arguments);
    assert!(printed.contains("3 made, 3 taken from before"), "{printed}");
}

#[test]
fn one_failure_does_not_end_a_sweep() {
    let sweep = SWEEP.replace("[[0.05, 1.2], ", "[[-1.0, 1.2], ");
    let path = folder("sweep-failing", &sweep);
    let out = path.join("out");
    let outcome = arlequin(&["sweep", text(&path.join("sweep.toml")), "--out", text(&out)]);
    assert_eq!(outcome.status.code(), Some(1));
    let s = read(&out.join("sweep.json"));
    assert_eq!(s["status"], "failed");
    assert_eq!(s["runs"][3]["status"], "failed");
    let error = s["runs"][3]["error"].as_str().unwrap();
    assert!(error.contains("spacing") && error.contains("-1"), "{error}");
    assert_eq!(s["runs"][5]["status"], "complete");
    assert!(
        s["conclusion"][0]
            .as_str()
            .unwrap()
            .starts_with("1 of 6 runs failed")
    );
    assert_well_formed(&std::fs::read_to_string(out.join("report.html")).unwrap());
}

#[test]
fn one_at_a_time_varies_about_the_base() {
    let sweep = r#"
        scene = "coupled.toml"
        design = "one-at-a-time"
        set = ["time.end=0.5"]
        [axis.h]
        values = [0.05, 0.1, 0.2]
        base = 0.1
        set = ["model.bar.spacing={}"]
        [axis.weight]
        levels = [{ name = "cubic" }, { name = "linear", set = ["interface.joint.weight.profile=linear"] }]
        [reference.curves.far.wave]
        at = 4.0
        centre = 0.0
        width = 1.6
        amplitude = 1e-3
        speed = 1.0
    "#;
    let path = folder("sweep-one", sweep);
    let out = path.join("out");
    let json = succeed(&[
        "sweep",
        text(&path.join("sweep.toml")),
        "--out",
        text(&out),
        "--json",
    ]);
    let s: Value = serde_json::from_str(&json).unwrap();
    let labels: Vec<&str> = s["runs"]
        .as_array()
        .unwrap()
        .iter()
        .map(|r| r["label"].as_str().unwrap())
        .collect();
    assert_eq!(labels, ["base", "h=0.05", "h=0.2", "weight=linear"]);
    assert_eq!(s["runs"][3]["parameters"]["h"], "0.1");
}

#[test]
fn mistakes_in_a_sweep_are_named_before_anything_runs() {
    let cases = [
        (
            "reference = { run = \"all-fine\" }",
            "reference = { run = \"nobody\" }",
            "nobody",
        ),
        ("hook = { axis = \"h\" }", "hook = { axis = \"g\" }", "hook.axis"),
        ("model.bar.spacing={0}", "model.bra.spacing={0}", "bra"),
        ("model.bar.spacing={0}", "model.bar.spacing={3}", "2 entries"),
        ("[[0.05, 1.2], ", "[[0.1, 1.2], ", "two runs are called"),
        ("targets = [0.2, 0.05]", "targets = [-0.2]", "targets[0]"),
        ("targets = [0.2, 0.05]", "repeat = 0", "repeat"),
        ("targets = [0.2, 0.05]", "colour = 3", "colour"),
        ("after = 4.9", "after = -4.9", "reflected.joint.after"),
        (
            "targets = [0.2, 0.05]",
            "measure.far.unit = \"m\"",
            "measure.far: needs exactly one",
        ),
        (
            "targets = [0.2, 0.05]",
            "measure.far = { fact = \"contacts\", factor = 0.0 }",
            "measure.far.factor",
        ),
        (
            "scene = \"coupled.toml\"",
            "scene = \"nothing.toml\"",
            "nothing.toml",
        ),
    ];
    for (k, (from, to, word)) in cases.into_iter().enumerate() {
        let sweep = SWEEP.replacen(from, to, 1);
        assert_ne!(sweep, SWEEP);
        let path = folder(&format!("sweep-bad-{k}"), &sweep);
        let out = path.join("out");
        let outcome = arlequin(&["sweep", text(&path.join("sweep.toml")), "--out", text(&out)]);
        let error = String::from_utf8_lossy(&outcome.stderr);
        assert_eq!(outcome.status.code(), Some(2), "{to}: {error}");
        assert!(error.contains(word), "{to}: {error}");
        assert!(!out.exists(), "{to}: nothing may be written");
    }
}

#[test]
fn suggest_predicts_what_a_run_shows_and_writes_a_scene() {
    let path = folder("suggest", SWEEP);
    let out = path.join("out");
    succeed(&["sweep", text(&path.join("sweep.toml")), "--out", text(&out)]);
    let measured = read(&out.join("sweep.json"));
    let scene = path.join("coupled.toml");
    let better = path.join("better.toml");
    let json = succeed(&[
        "suggest",
        text(&scene),
        "--error",
        "10%",
        "--apply",
        text(&better),
        "--json",
    ]);
    let s: Value = serde_json::from_str(&json).unwrap();
    // The given scene is the run h = 0.1 of the sweep.
    let ratio = number(&s, "/given/errors/velocity") / number(&measured, "/runs/4/errors/velocity");
    assert!((0.8..1.25).contains(&ratio), "predicted over measured {ratio}");
    assert!(number(&s, "/proposed/errors/velocity") <= 0.1);
    let written = std::fs::read_to_string(&better).unwrap();
    assert!(written.contains("# A chain and a bar.") && written.contains("# to be varied"));
    assert_ne!(written, std::fs::read_to_string(&scene).unwrap());
    succeed(&["check", text(&better)]);
    // Against the fine model everywhere, the written scene keeps the promised error.
    let sweep = "scene = \"better.toml\"\nreference = { run = \"f\" }\n[run.f]\nscene = \"alone.toml\"\n";
    std::fs::write(path.join("check.toml"), sweep).unwrap();
    let json = succeed(&[
        "sweep",
        text(&path.join("check.toml")),
        "--out",
        text(&path.join("c")),
        "--json",
    ]);
    let c: Value = serde_json::from_str(&json).unwrap();
    let error_found = number(&c, "/runs/1/errors/velocity");
    assert!(error_found < 0.12, "promised 0.1, measured {error_found}");
}

#[test]
fn wishes_that_make_no_sense_are_named() {
    let path = folder("suggest-bad", SWEEP);
    let scene = path.join("coupled.toml");
    let alone = path.join("alone.toml");
    let cases: [(&[&str], &str); 6] = [
        (&["suggest", text(&scene)], "--error or --time"),
        (&["suggest", text(&scene), "--error=-2%"], "--error"),
        (&["suggest", text(&scene), "--time", "soon"], "--time"),
        (&["suggest", text(&scene), "--error", "1e-9"], "out of reach"),
        (
            &["suggest", text(&scene), "--error", "5%", "--frequency=-1"],
            "--frequency",
        ),
        (&["suggest", text(&alone), "--error", "5%"], "interface"),
    ];
    for (arguments, word) in cases {
        let outcome = arlequin(arguments);
        let error = String::from_utf8_lossy(&outcome.stderr);
        assert_eq!(outcome.status.code(), Some(2), "{arguments:?}: {error}");
        assert!(error.contains(word), "{arguments:?}: {error}");
    }
}

#[test]
fn scalars_and_predictions_stand_beside_errors() {
    let measures = r#"
        [measure.peak]
        pointer = "/probes/far/max"
        factor = 1e3
        unit = "mm"

        [measure.bonds]
        fact = "broken bonds"
    "#;
    let sweep = SWEEP.replace("hook =", "suggest = true\nhook =") + measures;
    let path = folder("sweep-scalars", &sweep);
    let out = path.join("out");
    let arguments = ["sweep", text(&path.join("sweep.toml")), "--out", text(&out)].map(str::to_owned);
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    succeed(&arguments);
    let s = read(&out.join("sweep.json"));
    assert_eq!(s["units"]["peak"], "mm");
    let runs = s["runs"].as_array().unwrap();
    for (k, r) in runs.iter().enumerate() {
        // The pulse of 1 mm runs in one direction.
        let [value, deviation] = ["value", "deviation"].map(|n| number(r, &format!("/measures/peak/{n}")));
        assert!((0.5..1.1).contains(&value), "{r}");
        let expected = value / number(&runs[0], "/measures/peak/value") - 1.0;
        assert!((deviation - expected).abs() < 1e-12);
        assert!(r["measures"]["bonds"]["value"].is_null(), "nothing breaks here");
        assert_eq!(
            r["predicted"].is_object(),
            k >= 3,
            "only varied runs are foretold"
        );
    }
    for r in &runs[3..5] {
        for kind in ["displacement", "velocity"] {
            let [p, e] = ["predicted", "errors"].map(|n| number(r, &format!("/{n}/{kind}")));
            assert!(
                (0.8..1.25).contains(&(p / e)),
                "{kind}: {p} foretold, {e} measured"
            );
        }
        assert!(number(r, "/predicted/seconds") > 0.0);
    }
    let words = s["conclusion"].to_string();
    assert!(
        words.contains("peak, against the reference: coupled runs"),
        "{words}"
    );
    let page = std::fs::read_to_string(out.join("report.html")).unwrap();
    assert_well_formed(&page);
    assert!(page.contains(">peak [mm]</th>"));
    let csv = std::fs::read_to_string(out.join("sweep.csv")).unwrap();
    let columns: Vec<usize> = csv.lines().map(|l| l.split(',').count()).collect();
    assert!(columns.iter().all(|c| *c == columns[0]), "{columns:?}");
    // The page of several sweeps holds both tables.
    let docs = path.join("docs.md");
    succeed(&[
        "sweep-docs",
        "--out",
        text(&docs),
        "--measured",
        "1 May 2027, one core",
        text(&path.join("sweep.toml")),
        text(&out),
    ]);
    let docs = std::fs::read_to_string(docs).unwrap();
    assert!(
        docs.contains("\nMeasured: 1 May 2027, one core, with version "),
        "{docs}"
    );
    assert!(docs.contains("| time | bonds | peak [mm] |"), "{docs}");
    assert!(
        docs.contains("Predicted over measured: displacement error"),
        "{docs}"
    );
}

/// Ctrl-C ends the sweep and its current run; finished runs stay, and the same command goes on from there.
#[cfg(unix)]
#[test]
fn an_interrupted_sweep_keeps_finished_runs_and_goes_on() {
    use std::os::unix::process::CommandExt;
    let slow = SWEEP.replace("targets =", "set = [\"time.step.fraction=0.002\"]\ntargets =");
    let path = folder("sweep-interrupted", &slow);
    let out = path.join("out");
    let arguments = ["sweep", text(&path.join("sweep.toml")), "--out", text(&out)].map(str::to_owned);
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let mut sweep = crate::common::command(&arguments)
        .stdout(std::process::Stdio::null())
        .process_group(0)
        .spawn()
        .unwrap();
    // The three runs of one model take no time; each coupled run takes a second.
    let begun = |label: &str| {
        let folders = std::fs::read_dir(out.join("runs"))
            .into_iter()
            .flatten()
            .flatten();
        folders
            .map(|f| f.file_name().to_string_lossy().into_owned())
            .any(|f| f.starts_with(label))
    };
    let finished = |label: &str| out.join("runs").join(label).join("member.json");
    let is_due = || finished("all-coarse=0.2").exists() && begun("h=0.05.log");
    assert!(wait_while_running(&mut sweep, is_due), "ended by itself");
    std::thread::sleep(std::time::Duration::from_millis(100));
    let group = format!("-{}", sweep.id());
    let sent = std::process::Command::new("kill")
        .args(["-INT", "--", &group])
        .status();
    assert!(sent.unwrap().success());
    assert_eq!(sweep.wait().unwrap().code(), Some(130));
    let s = read(&out.join("sweep.json"));
    assert_eq!(s["status"], "interrupted");
    let states: Vec<&str> = s["runs"]
        .as_array()
        .unwrap()
        .iter()
        .map(|r| r["status"].as_str().unwrap())
        .collect();
    assert_eq!(states, [["complete"; 3], ["missing"; 3]].concat());
    assert!(
        s["conclusion"]
            .to_string()
            .contains("3 of 6 runs are still to be made")
    );
    let finished_before =
        ["all-fine", "all-coarse=0.1", "all-coarse=0.2"].map(|l| std::fs::read(finished(l)).unwrap());
    let printed = succeed(&arguments);
    assert!(printed.contains("3 made, 3 taken from before"), "{printed}");
    assert_eq!(read(&out.join("sweep.json"))["status"], "complete");
    let finished_after =
        ["all-fine", "all-coarse=0.1", "all-coarse=0.2"].map(|l| std::fs::read(finished(l)).unwrap());
    assert!(finished_before == finished_after, "finished runs are not touched");
}

/// At twice the frequency the predicted error is four to eight times as large and asks for a finer mesh:
/// reflections from an overlap grow with the square of the frequency, the lag of a lattice with its cube.
///
/// The error that is asked for lies between those of the scene as given (spacing 0.1 m): the slow signal
/// keeps that spacing or a coarser one whatever the trial steps take on a busy machine, and the fast one
/// cannot.
#[test]
fn the_frequency_that_is_asked_for_decides_the_error() {
    let path = folder("suggest-frequency", SWEEP);
    let scene = path.join("coupled.toml");
    let asked = |frequency: &str| {
        let asked = [
            "suggest",
            text(&scene),
            "--error",
            "0.8%",
            "--json",
            "--frequency",
            frequency,
        ];
        let s: Value = serde_json::from_str(&succeed(&asked)).unwrap();
        let signal = s["signal"].as_str().unwrap();
        assert!(signal.contains("--frequency"), "{signal}");
        let h = s["proposed"]["settings"][0][1].as_str().unwrap();
        (number(&s, "/given/errors/velocity"), h.parse::<f64>().unwrap())
    };
    let (slow, fast) = (asked("0.4"), asked("0.8"));
    let ratio = fast.0 / slow.0;
    assert!((3.5..9.0).contains(&ratio), "{slow:?} {fast:?}: {ratio}");
    assert!(fast.1 < 0.075 && slow.1 >= 0.1, "{slow:?} {fast:?}");
}
