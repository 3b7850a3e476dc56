//! Tables of `arlequin compare`: on the terminal, as Markdown and as comma-separated values.

use arlequin_scene::compare::{Board, Row};

/// Heads of the columns of figures; those without a unit are ratios.
const HEADS: [&str; 11] = [
    "not passed",
    "comes back",
    "above cutoff",
    "pulse error",
    "patch",
    "momentum",
    "drift, pulse",
    "drift, noise",
    "critical step",
    "cost",
    "set-up [s]",
];

fn figures(r: &Row) -> [Option<f64>; 11] {
    let [down, up, momentum] = [r.down, r.up, r.momentum].map(Some);
    let [pulse_drift, drift] = [r.pulse_drift, r.drift].map(Some);
    let [critical, cost, setup] = [r.critical, r.cost, r.setup].map(Some);
    let [above, error, patch] = [r.above, r.pulse_error, r.patch];
    [
        down,
        up,
        above,
        error,
        patch,
        momentum,
        pulse_drift,
        drift,
        critical,
        cost,
        setup,
    ]
}

/// Two digits; ratios as they are, all else with an exponent.
fn word(x: Option<f64>) -> String {
    match x {
        None => "-".to_owned(),
        Some(x) if !x.is_finite() || x.abs() > 1e6 => "diverges".to_owned(),
        Some(x) if x != 0.0 && (x.abs() < 1e-3 || x.abs() >= 1e3) => format!("{x:.1e}"),
        Some(x) if x.abs() < 1.0 => format!("{x:.4}"),
        Some(x) => format!("{x:.2}"),
    }
}

/// Words and figures of every method.
fn rows(b: &Board, figure: fn(Option<f64>) -> String) -> impl Iterator<Item = (&str, Vec<String>)> {
    let row = move |r| figures(r).into_iter().map(figure).collect();
    b.rows.iter().map(move |r| (&*r.method, row(r)))
}

/// Prints the table and the methods that were refused.
pub(crate) fn board(b: &Board) {
    print_line!("{}: {}", b.scene, about(b));
    let heads = ("method", HEADS.map(str::to_owned).to_vec());
    for (method, cells) in std::iter::once(heads).chain(rows(b, word)) {
        let cells: String = cells.iter().map(|c| format!("{c:>14}")).collect();
        print_line!("{method:<24}{cells}");
    }
    for (method, reason) in &b.refused {
        super::entry("refused", &format!("{method}: {reason}"));
    }
}

fn about(b: &Board) -> String {
    let packet = b
        .packet
        .map(|l| format!(", packet of {l:.1} h"))
        .unwrap_or_default();
    format!(
        "pulse of half width {:.1} h{packet}, h the coarse spacing",
        b.pulse
    )
}

/// Returns the table as Markdown.
pub(crate) fn markdown(b: &Board) -> String {
    let mut out = format!("{}\n\n", about(b).replacen('p', "P", 1));
    out += &format!(
        "| method | {} |\n|---|{}\n",
        HEADS.join(" | "),
        "---|".repeat(HEADS.len())
    );
    for (method, cells) in rows(b, word) {
        out += &format!("| `{method}` | {} |\n", cells.join(" | "));
    }
    for (method, reason) in &b.refused {
        out += &format!("\nRefused: `{method}`. {reason}\n");
    }
    out
}

/// Returns the table as comma-separated values with all digits.
pub(crate) fn csv(b: &Board) -> String {
    let mut out = format!("method,{}\n", HEADS.map(|h| h.replace(',', "")).join(","));
    for (method, cells) in rows(b, |x| x.map(|x| format!("{x:e}")).unwrap_or_default()) {
        out += &format!("{method},{}\n", cells.join(","));
    }
    out
}
