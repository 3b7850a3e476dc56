//! Own steps of models in scenes: choice, report and refusals.

use crate::common::{SMALL, arlequin, scratch, succeed, summary, text};

#[test]
fn tables_of_own_steps_that_make_no_sense_are_refused_by_their_key() {
    let folder = scratch("own-steps-bad");
    let path = folder.join("scene.toml");
    let key = "model.right.step";
    let of_right: [(&str, &[&str]); 8] = [
        ("ratio = 0", &[".ratio = 0: must be at least 1"]),
        ("ratio = 2.5", &["floating point `2.5`"]),
        ("ratio = -1", &["integer `-1`"]),
        (
            "fraction = 1.5",
            &[".fraction = 1.5: must lie above 0 and not above 1"],
        ),
        ("fraction = 0.0", &[".fraction = 0: must lie above 0"]),
        (
            "ratio = 2\nfraction = 0.5",
            &[key, "exactly one of ratio, fraction, scheme"],
        ),
        ("ratio = 2\nscheme = \"implicit\"", &[key, "exactly one of"]),
        (
            "scheme = \"leapfrog\"",
            &["`leapfrog`", "`explicit` or `implicit`"],
        ),
    ];
    let refused = |scene: &str, words: &[&str]| {
        std::fs::write(&path, scene).expect("scene");
        let out = arlequin(&["check", text(&path)]);
        let error = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(2), "{error}");
        assert!(words.iter().all(|w| error.contains(w)), "{words:?}: {error}");
    };
    for (table, words) in of_right {
        refused(&format!("{SMALL}\n[model.right.step]\n{table}\n"), words);
    }
    let beads = SMALL.replace(
        "kind = \"fem\"\nrole = \"fine\"",
        "kind = \"dem\"\nrole = \"fine\"",
    );
    let implicit = "[model.right.step]\nscheme = \"implicit\"\n";
    let words = [
        ".scheme = implicit: is for linear solids",
        "give particles a ratio",
    ];
    refused(&format!("{beads}\n{implicit}"), &words);
    let damped = "[[effect]]\nmass_damping.rate = 0.1\n";
    let words = [
        "model.right",
        "cannot step implicitly: effect 'mass-damping' needs velocities",
    ];
    refused(&format!("{SMALL}\n{damped}{implicit}"), &words);
    // Both bars make two own steps of 0.5 s, which is too much for the fine one alone.
    let long = SMALL.replace("steps = 50", "steps = 50\nstep.seconds = 1.0");
    let two_ratios = "[model.left.step]\nratio = 2\n[model.right.step]\nratio = 2\n";
    let words = [
        key,
        "exceeds the critical step",
        "'right', which makes 2 own steps",
        "at least",
    ];
    refused(&format!("{long}\n{two_ratios}"), &words);
}

/// Half of the coarse bar's critical step has room for two own steps of the fine bar, whose elements are a
/// fifth as long. With four own steps the displacement jump grows, and the report warns of it.
#[test]
fn own_steps_are_chosen_and_reported_and_change_little() {
    let folder = scratch("own-steps");
    let path = folder.join("scene.toml");
    let scene = SMALL
        .replace("spacing = 0.5", "spacing = 0.2")
        .replace("steps = 50", "end = 20.0");
    std::fs::write(&path, scene).expect("scene");
    let run = |name: &str, sets: &[&str]| {
        let out = folder.join(name);
        let sets: Vec<&str> = sets.iter().flat_map(|s| ["--set", s]).collect();
        succeed(&[&["run", text(&path), "--out", text(&out)], &sets[..]].concat());
        summary(&out)
    };
    let single = run("one", &["model.left.step.ratio=1", "model.right.step.ratio=1"]);
    let chosen = run("chosen", &[]);
    // `time.step.fraction` limits the own steps of every model.
    let short = run("short", &["time.step.fraction=0.05"]);
    for k in [0, 1] {
        let share = |key| short["models"][k][key].as_f64().expect("a number");
        assert!(
            share("own_dt") <= 0.05 * share("critical_dt") * (1.0 + 1e-9),
            "{short}"
        );
    }
    let implicit = run(
        "implicit",
        &["model.left.step.scheme=implicit", "model.right.step.ratio=4"],
    );
    let steps =
        |s: &serde_json::Value| [0, 1].map(|k| s["models"][k]["own_steps"].as_u64().expect("a count"));
    assert_eq!(
        (steps(&single), steps(&chosen), steps(&implicit)),
        ([1, 1], [1, 2], [1, 4])
    );
    let warned = |s: &serde_json::Value| {
        s["warnings"]
            .to_string()
            .contains("own steps in a step of the run")
    };
    assert!(warned(&implicit) && !warned(&single));
    let warnings = implicit["warnings"].to_string();
    assert!(
        warnings.contains("give 'right' fewer, or take shorter steps"),
        "{warnings}"
    );
    let number =
        |s: &serde_json::Value, key: &str| s.pointer(key).and_then(|x| x.as_f64()).expect("a number");
    let top = number(&single, "/probes/tip/max");
    for (name, s, limit) in [("chosen", &chosen, 0.1), ("implicit", &implicit, 0.25)] {
        assert!(number(s, "/energy/h_drift_max") < 1e-12, "{name}");
        let jump = number(s, "/interface/0/displacement_jump_share");
        assert!(jump > 1e-12 && jump < limit, "{name}: {jump:e}");
        assert_eq!(warned(s), jump > 0.05, "{name}: {jump:e}");
        let change = number(s, "/probes/tip/max") / top - 1.0;
        assert!(change.abs() < 0.02, "{name}: {change}");
        let finest = number(s, "/models/1/own_dt") / number(s, "/models/1/critical_dt");
        assert!((finest - 0.9).abs() < 1e-9, "{name}: {finest}");
    }
    assert!(number(&single, "/interface/0/displacement_jump_share") < 1e-12);
    assert!(number(&chosen, "/models/0/own_dt") <= 0.5 * number(&chosen, "/models/0/critical_dt"));
}
