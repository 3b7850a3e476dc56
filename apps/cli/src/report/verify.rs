//! Reports of comparisons with the literature: table as text, page of the book, pictures.

use super::plot::{self, Curve, Plot};
use super::split;
use crate::error::{Result, write as cannot_write};
use arlequin_studies::checks::{Case, Check, Figure, Report, short};
use std::path::Path;

/// Head of the page; a file that begins with it may be overwritten.
pub(crate) const HEAD: &str = "# Validation

Written by `arlequin verify --docs docs`; do not edit. Each case compares a number of the literature with ours and says
what is accepted. Where our formulation contradicts a printed number, the accepted value is what we expect, and the
remark says why; nothing is tuned to a reference.

Sources: Jebahi et al. 2013 and 2014 (dynamic coupling of discrete and natural elements), Bauman et al. 2008 (statics,
Comput. Mech. 42:511, re-computed), Norma.jl (Sandia, overlapping Schwarz), beam theory with E = 72.5 GPa, nu = 0.17,
rho = 2200 kg/m3, and a converged three-dimensional solid for the beams. The loads of the beams are not printed; 1 kN,
1 kN and 10 N m are inferred from the printed deflections. Means and frequencies come from time runs under a Hann window
(10 periods, 4 in bending), the frequency as the interpolated peak of the windowed transform. Spheres: 13 across the
bar in beams A and B, nothing fitted; H1 junction, coarse mediator, floor 0.05 of the weights, as in the papers.

Run it: `arlequin verify` (everything), `arlequin verify --quick` (under a minute), `arlequin verify --list`.
";

/// Draws all pictures into a folder.
pub(crate) fn pictures(folder: &Path, reports: &[Report]) -> Result<()> {
    std::fs::create_dir_all(folder).map_err(cannot_write(folder))?;
    let figures = reports.iter().flat_map(|r| &r.figures);
    figures.into_iter().try_for_each(|f| draw(folder, f))
}

fn draw(folder: &Path, figure: &Figure) -> Result<()> {
    let curves = figure.curves.iter().map(|(name, x, y)| Curve {
        name: name.clone(),
        times: x,
        values: y.clone(),
    });
    let plot = Plot {
        title: figure.title.to_owned(),
        across: figure.axes[0],
        log: figure.log,
        quantity: figure.axes[1][0],
        unit: figure.axes[1][1],
        curves: curves.collect(),
    };
    plot::draw(&folder.join(format!("{}.svg", figure.file)), &plot)
}

/// Writes `validation.md` and `images/validation/*.svg`.
pub(crate) fn page(folder: &Path, cases: &[&Case], reports: &[Report]) -> Result<()> {
    let images = folder.join("images/validation");
    std::fs::create_dir_all(&images).map_err(cannot_write(&images))?;
    let mut text = String::from(HEAD);
    let listed = |r: &Report| {
        r.checks
            .iter()
            .filter(|c| c.listed || !c.pass)
            .cloned()
            .collect::<Vec<_>>()
    };
    let rows = reports.iter().flat_map(listed);
    let (count, failed) = rows.fold((0, 0), |(n, f), r| (n + 1, f + usize::from(!r.pass)));
    text += &format!("\n{count} rows, {failed} failed.\n");
    for (case, report) in cases.iter().zip(reports) {
        text += &format!("\n## {}\n\n{}.\n", case.name, capital(case.about));
        for figure in &report.figures {
            draw(&images, figure)?;
            let place = format!("images/validation/{}.svg", figure.file);
            text += &format!("\n![{}]({place})\n\n{}\n", figure.title, figure.says);
        }
        text += &format!("\n{}", markdown(&listed(report)));
    }
    let path = folder.join("validation.md");
    std::fs::write(&path, text).map_err(cannot_write(&path))
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters
        .next()
        .map(|c| c.to_uppercase().chain(letters).collect())
        .unwrap_or_default()
}

fn cells(r: &Check) -> [String; 8] {
    let difference = r.relative_difference;
    [
        r.case.clone(),
        r.quantity.clone(),
        r.reference.map_or_else(|| "-".into(), short),
        r.source.clone(),
        short(r.ours),
        difference.map_or_else(|| "-".into(), |d| format!("{:+.2} %", 100.0 * d)),
        r.accept.text(),
        if r.pass { "pass" } else { "FAIL" }.into(),
    ]
}

const COLUMNS: [&str; 8] = [
    "case",
    "quantity",
    "reference",
    "source",
    "ours",
    "difference",
    "accepted",
    "",
];

/// Largest width of each column of [`table`], without that of the case: rows have at most 120 columns.
const WIDEST: [usize; 7] = [34, 9, 22, 10, 10, 17, 4];

/// Returns the table as plain text: the rows of a case below its name, each remark below its row.
pub(crate) fn table(rows: &[Check]) -> String {
    let cell_rows: Vec<[String; 8]> = rows.iter().map(cells).collect();
    let width: [usize; 7] = std::array::from_fn(|k| {
        let longest = cell_rows.iter().map(|c| c[k + 1].chars().count()).max();
        longest.unwrap_or(0).max(COLUMNS[k + 1].len()).min(WIDEST[k])
    });
    let mut out = line(&COLUMNS.map(str::to_owned), &width);
    let mut case = "";
    for (row, c) in rows.iter().zip(&cell_rows) {
        if row.case != case {
            out += &format!("{}\n", row.case);
            case = &row.case;
        }
        out += &line(c, &width);
        if !row.note.is_empty() {
            for text in split(&format!("({})", row.note), 110) {
                out += &format!("    {text}\n");
            }
        }
    }
    let failed = rows.iter().filter(|r| !r.pass).count();
    out + &format!("{} rows, {failed} failed\n", rows.len())
}

/// Returns a row of the table in as many lines as its longest cell needs.
fn line(cells: &[String; 8], width: &[usize; 7]) -> String {
    let texts: Vec<Vec<String>> = cells[1..].iter().zip(width).map(|(c, w)| split(c, *w)).collect();
    let mut out = String::new();
    for k in 0..texts.iter().map(Vec::len).max().unwrap_or(0) {
        let padded = texts.iter().zip(width).map(|(t, w)| {
            let text = t.get(k).map_or("", String::as_str);
            format!("{text:<w$}")
        });
        out += &format!("  {}", padded.collect::<Vec<_>>().join("  "));
        out.truncate(out.trim_end().len());
        out.push('\n');
    }
    out
}

/// Returns the table of one case as Markdown.
fn markdown(rows: &[Check]) -> String {
    let mut out = String::from(
        "| quantity | reference | source | ours | difference | accepted | |\n|---|---|---|---|---|---|---|\n",
    );
    for row in rows {
        let c = cells(row);
        let note = if row.note.is_empty() {
            String::new()
        } else {
            format!(" ({})", row.note)
        };
        // A bar would end the table cell.
        let cell = format!("{}{note}", c[1]).replace('|', "\\|");
        out += &format!(
            "| {cell} | {} | {} | {} | {} | {} | {} |\n",
            c[2], c[3], c[4], c[5], c[6], c[7]
        );
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use arlequin_studies::checks::Accept;

    #[test]
    fn tables_count_failures() {
        let rows = [
            Check::new("good", 1.0, Accept::AtMost(1.0)),
            Check::new("bad", 2.0, Accept::AtMost(1.0)).note("because"),
        ];
        let text = table(&rows);
        assert!(text.ends_with("2 rows, 1 failed\n") && text.contains("FAIL") && text.contains("(because)"));
        let long = Check::new(
            "a quantity of many words that needs more than one line",
            1.0,
            Accept::AtMost(1.0),
        );
        let text = table(&[long.note("a remark as long as a remark can be ".repeat(8))]);
        assert!(text.lines().all(|l| l.chars().count() <= 120), "{text}");
        assert_eq!(
            (short(0.00012345), short(1606.04)),
            ("1.234e-4".into(), "1606".into())
        );
    }
}
