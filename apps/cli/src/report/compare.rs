//! Table of `arlequin compare`, for the terminal and for a page.

use arlequin_scene::compare::{Board, Row};

/// Heads and figures of a row; those without a unit are ratios.
fn figures(r: &Row) -> [(&'static str, Option<f64>); 11] {
    [
        ("not passed", Some(r.down)),
        ("comes back", Some(r.up)),
        ("above cutoff", r.above),
        ("pulse error", r.pulse_error),
        ("patch", r.patch),
        ("momentum", Some(r.momentum)),
        ("drift, pulse", Some(r.pulse_drift)),
        ("drift, noise", Some(r.drift)),
        ("critical step", Some(r.critical)),
        ("cost", Some(r.cost)),
        ("set-up [s]", Some(r.setup)),
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

/// Returns the table as Markdown in columns of one width.
pub(crate) fn table(b: &Board) -> String {
    let packet = b
        .packet
        .map_or_else(String::new, |l| format!(", packet of {l:.1} h"));
    let mut out = format!(
        "Pulse of half width {:.1} h{packet}, h the coarse spacing\n\n",
        b.pulse
    );
    let mut line = |first: &str, cells: &[String]| {
        let cells: String = cells.iter().map(|c| format!(" {c:>13} |")).collect();
        out += &format!("| {first:<25} |{cells}\n");
    };
    if let Some(heads) = b.rows.first().map(figures) {
        line("method", &heads.map(|(head, _)| head.to_owned()));
        line(&"-".repeat(25), &heads.map(|_| "-".repeat(12) + ":"));
    }
    for r in &b.rows {
        line(&format!("`{}`", r.method), &figures(r).map(|(_, x)| word(x)));
    }
    for (method, reason) in &b.refused {
        out += &format!("\nRefused: `{method}`. {reason}\n");
    }
    out
}
