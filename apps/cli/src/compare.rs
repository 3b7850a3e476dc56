//! `arlequin compare`: options, and the files that the command writes.

use crate::error::{Result, key, write};
use crate::report;
use arlequin_scene::Scene;
use arlequin_scene::compare::{compare as measure, method};
use std::path::{Path, PathBuf};

/// Methods to compare, and where the tables go.
#[derive(Debug, clap::Args)]
pub(crate) struct Choice {
    /// Methods [default: the method of the interface, or all if that is arlequin]
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    methods: Vec<String>,
    /// Stiffness of the springs of `penalty` over that of the particle they hold.
    #[arg(long, value_name = "RATIO", default_value_t = 1.0)]
    penalty: f64,
    /// Replace the table of this scene in a page, between `<!-- table NAME -->` and `<!-- end -->`.
    #[arg(long, value_name = "PAGE.md")]
    page: Option<PathBuf>,
}

/// Compares methods on the models of a scene.
pub(crate) fn compare(scene: &Scene, choice: &Choice, json: bool) -> Result<()> {
    let words = choice.methods.iter();
    let methods: Vec<_> = words.map(|m| method(m)).collect::<Result<_>>()?;
    let stem = scene.source().path.file_stem().unwrap_or_default();
    // Found before minutes of work, as are wrong words.
    let around = |page| text_around(page, &stem.to_string_lossy());
    let around = choice.page.as_deref().map(around).transpose()?;
    let mut progress = report::phase_reporter();
    let board = measure(scene, &methods, choice.penalty, &mut progress)?;
    drop(progress);
    if let (Some(page), Some([before, end, behind])) = (&choice.page, around) {
        let table = report::compare::table(&board).replace('\n', &end);
        std::fs::write(page, before + &table + &behind).map_err(write(page))?;
    }
    report::result(&board, json, |board| {
        report::text(&format!("{}\n\n{}", board.scene, report::compare::table(board)));
    })
}

/// Returns the text of a page before the table of a scene, its line end, and the text behind the table.
fn text_around(path: &Path, name: &str) -> Result<[String; 3]> {
    let refused = |rule| key(format!("--page {}", path.display()), rule);
    // A page that cannot be written is refused before the work, too.
    let page = std::fs::OpenOptions::new().read(true).append(true).open(path);
    let text = page.and_then(std::io::read_to_string);
    let text = text.map_err(|e| {
        refused(format!(
            "cannot be read and written ({e}); check path and permissions"
        ))
    })?;
    let end = if text.contains("\r\n") { "\r\n" } else { "\n" };
    let (begin, stop) = (format!("<!-- table {name} -->"), "<!-- end -->");
    let parts = text.split_once(&begin).and_then(|(before, after)| {
        let (_, behind) = after.split_once(stop)?;
        Some([
            before.to_owned() + &begin + end,
            end.to_owned(),
            stop.to_owned() + behind,
        ])
    });
    let rule = format!("has no place for a table between '{begin}' and '{stop}'; add one");
    parts.ok_or_else(|| refused(rule))
}
