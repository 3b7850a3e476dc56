//! `arlequin verify --hard`: names, figures and exit codes.

use crate::common::{arlequin, number, succeed};

#[test]
fn one_hard_case_is_run_by_its_name() {
    let name = "a shock of one step";
    let text = succeed(&["verify", "--hard", "--json", name]);
    let rows: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!(
        (rows[0]["name"].as_str(), rows[0]["pass"].as_bool()),
        (Some(name), Some(true))
    );
    assert!(number(&rows, "/0/our_figures/1/value") < 1e-11, "{rows}");
    assert!(number(&rows, "/0/naive_figures/1/value") > 0.01, "{rows}");
    let text = succeed(&["verify", "--hard", name]);
    assert!(text.contains("promise: the ledger closes to round-off"), "{text}");
    assert!(text.contains("1 of 1 promises kept"), "{text}");
}

#[test]
fn an_unknown_hard_case_is_named() {
    let out = arlequin(&["verify", "--hard", "a shock of two steps"]);
    let error = String::from_utf8_lossy(&out.stderr).into_owned();
    assert_eq!(out.status.code(), Some(2), "{error}");
    assert!(error.contains("a shock of one step"), "{error}");
}
