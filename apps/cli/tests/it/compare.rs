//! `arlequin compare`: the files that it writes, and pages with either line end.

use crate::common::{arlequin, scratch, succeed, text};

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/compare/bar-1d.toml");

#[test]
fn a_page_keeps_its_line_ends_and_a_word_counts_once() {
    let folder = scratch("compare-page");
    let page = folder.join("page.md");
    let before = "# Title\r\n<!-- table bar-1d -->\r\nold\r\n<!-- end -->\r\nlast\r\n";
    std::fs::write(&page, before).expect("page");
    let arguments = ["compare", SCENE, "--methods", "blend,arlequin,blend", "--json"];
    let json = succeed(&[&arguments[..], &["--page", text(&page)]].concat());
    let board: serde_json::Value = serde_json::from_str(&json).expect("JSON");
    let rows = board["rows"].as_array().expect("rows");
    let words: Vec<_> = rows.iter().filter_map(|r| r["method"].as_str()).collect();
    assert_eq!(words, ["arlequin", "blend", "fine everywhere"]);
    let after = std::fs::read_to_string(&page).expect("page");
    assert_eq!(after.matches('\n').count(), after.matches("\r\n").count());
    let [first, table @ .., last] = &*after.lines().collect::<Vec<_>>() else {
        panic!("{after}");
    };
    assert_eq!([*first, *last], ["# Title", "last"]);
    // Head, rule and three rows of twelve columns, of one width.
    let lines: Vec<_> = table.iter().filter(|l| l.starts_with('|')).collect();
    let columns: Vec<_> = lines.iter().map(|l| l.split('|').count() - 2).collect();
    assert_eq!(columns, [12; 5], "{after}");
    assert!(
        lines
            .iter()
            .all(|l| l.chars().count() == lines[0].chars().count()),
        "{after}"
    );
    // A figure of the page is that of the JSON.
    let error = rows[1]["pulse_error"].as_f64().expect("an error");
    assert!(lines[3].contains(&format!(" {error:.4} ")), "{after}");
}

#[test]
fn a_page_without_a_place_and_an_unknown_word_are_refused_before_the_work() {
    let folder = scratch("compare-refused");
    let page = folder.join("page.md");
    std::fs::write(&page, "no place\n").expect("page");
    for (arguments, words) in [
        (["--page", text(&page)], "<!-- table bar-1d -->"),
        (["--methods", "blend,gluing"], "gluing"),
    ] {
        let run = arlequin(&[&["compare", SCENE][..], &arguments].concat());
        let stderr = String::from_utf8_lossy(&run.stderr).into_owned();
        assert!(!run.status.success() && stderr.contains(words), "{stderr}");
    }
}
