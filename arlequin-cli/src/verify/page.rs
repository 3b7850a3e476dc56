//! The page of the documentation: tables, pictures and a sentence under each.

use super::{Figure, Report, row};
use crate::error::{Result, write as cannot_write};
use std::path::Path;

pub(super) const HEAD: &str = "# Validation

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
pub(super) fn pictures(folder: &Path, reports: &[Report]) -> Result<()> {
    std::fs::create_dir_all(folder).map_err(cannot_write(folder))?;
    let figures = reports.iter().flat_map(|r| &r.figures);
    figures.into_iter().try_for_each(|f| draw(folder, f))
}

fn draw(folder: &Path, figure: &Figure) -> Result<()> {
    figure.draw(&folder.join(format!("{}.svg", figure.file)))
}

/// Writes `validation.md` and `images/validation/*.svg`.
pub(super) fn write(folder: &Path, cases: &[((&str, &str), &Report)]) -> Result<()> {
    let images = folder.join("images/validation");
    std::fs::create_dir_all(&images).map_err(cannot_write(&images))?;
    let mut text = String::from(HEAD);
    let rows = cases.iter().flat_map(|c| &c.1.rows);
    let (count, failed) = rows.fold((0, 0), |(n, f), r| (n + 1, f + usize::from(!r.pass)));
    text += &format!("\n{count} rows, {failed} failed.\n");
    for ((name, about), report) in cases {
        text += &format!("\n## {name}\n\n{}.\n", capital(about));
        for figure in &report.figures {
            draw(&images, figure)?;
            let place = format!("images/validation/{}.svg", figure.file);
            text += &format!("\n![{}]({place})\n\n{}\n", figure.title, figure.says);
        }
        let rows: Vec<_> = report.rows.iter().collect();
        text += &format!("\n{}", row::markdown(&rows));
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
