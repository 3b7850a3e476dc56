//! Tables of `arlequin compare`: on the terminal, as Markdown and as comma-separated values.

use arlequin_scene::compare::{Board, Row};

/// Heads of the columns of figures, with their units in the file.
const HEADS: [(&str, &str); 11] = [
    (
        "not passed",
        "energy of a pulse from the fine model that does not pass [-]",
    ),
    (
        "comes back",
        "energy of a pulse from the coarse model that comes back [-]",
    ),
    (
        "above cutoff",
        "energy of a packet above the coarse cutoff that is not passed [-]",
    ),
    ("pulse error", "error of the pulse beyond the overlap [-]"),
    (
        "patch",
        "deviation from uniform strain over strain times overlap [-]",
    ),
    ("momentum", "change of momentum [-]"),
    (
        "drift, pulse",
        "change of energy of the pulse over ten passages [-]",
    ),
    ("drift, noise", "change of energy of a random state [-]"),
    ("critical step", "critical step over that of the default [-]"),
    ("cost", "multiplications per time over those of the default [-]"),
    ("set-up [s]", "set-up [s]"),
];

fn figures(r: &Row) -> [Option<f64>; 11] {
    [
        Some(r.down),
        Some(r.up),
        r.above,
        r.pulse_error,
        r.patch,
        Some(r.momentum),
        Some(r.pulse_drift),
        Some(r.drift),
        Some(r.critical),
        Some(r.cost),
        Some(r.setup),
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

/// Prints the table and the methods that were refused.
pub(crate) fn board(b: &Board) {
    print_line!("{}: {}", b.scene, about(b));
    let heads: Vec<String> = HEADS.iter().map(|h| format!("{:>14}", h.0)).collect();
    print_line!("{:<24}{}", "method", heads.concat());
    for r in &b.rows {
        let cells: Vec<String> = figures(r).iter().map(|x| format!("{:>14}", word(*x))).collect();
        print_line!("{:<24}{}", r.method, cells.concat());
    }
    for (method, reason) in &b.refused {
        super::entry("refused", &format!("{method}: {reason}"));
    }
}

fn about(b: &Board) -> String {
    let packet = b
        .packet
        .map_or_else(String::new, |l| format!(", packet of {l:.1} h"));
    format!(
        "pulse of half width {:.1} h{packet}, h the coarse spacing",
        b.pulse
    )
}

/// Returns the table as Markdown.
pub(crate) fn markdown(b: &Board) -> String {
    let heads: Vec<&str> = HEADS.iter().map(|h| h.0).collect();
    let mut out = format!("{}\n\n", about(b).replacen('p', "P", 1));
    out += &format!(
        "| method | {} |\n|---|{}\n",
        heads.join(" | "),
        "---|".repeat(heads.len())
    );
    for r in &b.rows {
        let cells: Vec<String> = figures(r).iter().map(|x| word(*x)).collect();
        out += &format!("| `{}` | {} |\n", r.method, cells.join(" | "));
    }
    for (method, reason) in &b.refused {
        out += &format!("\nRefused: `{method}`. {reason}\n");
    }
    out
}

/// Returns the table as comma-separated values with all digits.
pub(crate) fn csv(b: &Board) -> String {
    let heads: Vec<&str> = HEADS.iter().map(|h| h.1).collect();
    let mut out = format!("method,{}\n", heads.join(","));
    for r in &b.rows {
        let cells = figures(r).map(|x| x.map(|x| format!("{x:e}")).unwrap_or_default());
        out += &format!("{},{}\n", r.method, cells.join(","));
    }
    out
}
