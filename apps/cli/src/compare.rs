//! `arlequin compare`: options, and the files that the command writes.

use crate::error::{Error, Result, key, write};
use crate::report;
use arlequin_scene::Scene;
use arlequin_scene::compare::{Board, Options, compare as measure, method};
use arlequin_scene::output::mark;
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
    /// Write compare.csv, compare.md and compare.json into this folder.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Replace the table of this scene in a page, between `<!-- table NAME -->` and `<!-- end -->`.
    #[arg(long, value_name = "PAGE.md")]
    page: Option<PathBuf>,
}

/// Compares methods on the models of a scene.
pub(crate) fn compare(scene: &Scene, choice: &Choice, json: bool) -> Result<()> {
    let methods = choice.methods.iter().map(|m| method(m));
    let options = Options {
        methods: methods.collect::<Result<_>>()?,
        penalty: choice.penalty,
    };
    let stem = scene.source().path.file_stem().unwrap_or_default();
    let name = stem.to_string_lossy();
    // Found before minutes of work, as are wrong words.
    let page = choice.page.as_deref().map(|p| Page::read(p, &name)).transpose()?;
    if let Some(out) = &choice.out {
        std::fs::create_dir_all(out).map_err(write(out))?;
        mark::claim("--out", out)?;
    }
    let mut progress = report::phase_reporter();
    let board = measure(scene, &options, &mut progress)?;
    drop(progress);
    if let Some(out) = &choice.out {
        write_all(out, &board)?;
    }
    if let Some(page) = page {
        page.with(&report::compare::markdown(&board))?;
    }
    report::result(&board, json, report::compare::board)
}

fn write_all(out: &Path, board: &Board) -> Result<()> {
    let files = [
        ("compare.csv", report::compare::csv(board)),
        ("compare.md", report::compare::markdown(board)),
        ("compare.json", report::pretty(board)? + "\n"),
    ];
    for (name, text) in files {
        let path = out.join(name);
        std::fs::write(&path, text).map_err(write(&path))?;
    }
    Ok(())
}

/// A page around the table of a scene.
struct Page<'a> {
    path: &'a Path,
    /// Text before and behind the table.
    parts: [String; 2],
}

impl<'a> Page<'a> {
    fn read(path: &'a Path, name: &str) -> Result<Self> {
        let text = std::fs::read_to_string(path).map_err(|source| Error::Read {
            path: path.to_owned(),
            source,
        })?;
        let (begin, end) = (format!("<!-- table {name} -->\n"), "<!-- end -->");
        let parts = text.split_once(&begin).and_then(|(before, after)| {
            let (_, behind) = after.split_once(end)?;
            Some([format!("{before}{begin}"), format!("{end}{behind}")])
        });
        let rule = || {
            format!(
                "has no place for a table between '{}' and '{end}'; add one",
                begin.trim_end()
            )
        };
        let parts = parts.ok_or_else(|| key(format!("--page {}", path.display()), rule()))?;
        Ok(Self { path, parts })
    }

    fn with(self, table: &str) -> Result<()> {
        let [before, behind] = &self.parts;
        std::fs::write(self.path, format!("{before}{table}{behind}")).map_err(write(self.path))
    }
}
