//! `arlequin verify`: list, quick table, JSON, wrong names.

use crate::common::{arlequin, scratch, succeed, text};

const KEYS: [&str; 8] = [
    "case",
    "quantity",
    "reference",
    "source",
    "ours",
    "relative_difference",
    "acceptance",
    "pass",
];

#[test]
fn list_and_wrong_name() {
    let list = succeed(&["verify", "--list"]);
    for case in ["bauman", "reflection", "cantilever", "beam-a", "beam-b"] {
        assert!(list.lines().any(|l| l.starts_with(case)), "{list}");
    }
    let out = arlequin(&["verify", "baumann"]);
    let error = String::from_utf8_lossy(&out.stderr);
    assert_eq!(out.status.code(), Some(2));
    assert!(
        error.contains("'baumann'") && error.contains("known: bauman, transmission"),
        "{error}"
    );
    let out = arlequin(&["verify", "bauman", "--threads", "0"]);
    assert_eq!(out.status.code(), Some(2));
}

#[test]
fn rows_as_json_and_pictures() {
    let folder = scratch("verify").join("out");
    let printed = succeed(&[
        "verify",
        "bauman",
        "reflection",
        "patch",
        "--json",
        "--out",
        text(&folder),
    ]);
    let rows: serde_json::Value = serde_json::from_str(&printed).expect("an array of rows");
    let rows = rows.as_array().expect("an array");
    assert_eq!(rows.len(), 15 + 9 + 6);
    for row in rows {
        for key in KEYS {
            assert!(row.get(key).is_some(), "{key} in {row}");
        }
        assert!(
            row["pass"].as_bool() == Some(true) && row["ours"].is_number(),
            "{row}"
        );
    }
    let worst = &rows[9];
    assert_eq!(worst["case"], "bauman");
    assert!((worst["reference"].as_f64().expect("a number") - 1.087272).abs() < 1e-12);
    assert!((worst["ours"].as_f64().expect("a number") - 1.087272).abs() < 1e-6);
    let svg = std::fs::read_to_string(folder.join("reflection.svg")).expect("a picture");
    assert!(svg.starts_with("<svg") && svg.contains("coarse cutoff"));
    assert!(folder.join("verify.json").exists());
}

#[test]
fn quick_subset_is_green_and_makes_a_page() {
    let folder = scratch("verify-docs");
    // The checks that take longest have their own tests.
    let cases = [
        "verify",
        "--quick",
        "transmission",
        "rank",
        "weighting",
        "conditioning",
        "mediator",
        "locking",
        "momenta",
        "beam-a",
        "--docs",
        text(&folder),
    ];
    let table = succeed(&cases);
    assert!(table.contains(", 0 failed"), "{table}");
    let page = std::fs::read_to_string(folder.join("validation.md")).expect("the page");
    for part in [
        "## weighting",
        "![Condition",
        "images/validation/locking.svg",
        "| pass |",
    ] {
        assert!(page.contains(part), "{part} in the page");
    }
    assert!(folder.join("images/validation/conditioning.svg").exists());
}
