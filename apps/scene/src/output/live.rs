//! Tables that are written during a run, so that they can be read before it ends.

use crate::error::{Result, write};
use crate::recorder::{Recorder, Table};
use std::fmt::Write as _;
use std::fs::File;
use std::io::Write as _;
use std::path::Path;
use std::time::{Duration, Instant};

/// Longest time between rows being recorded and written.
const WAIT: Duration = Duration::from_secs(1);

/// Counts the rows written so far.
#[derive(Debug)]
pub(crate) struct Live {
    last: Instant,
    rows: [usize; 3],
}

impl Live {
    /// Starts with no row written. The rows of an earlier part of a resumed run are written again.
    pub(crate) fn new() -> Self {
        Self {
            last: Instant::now(),
            rows: [0; 3],
        }
    }

    /// Appends the new rows if the last write is [`WAIT`] ago or a frame was written.
    pub(crate) fn flush(&mut self, folder: &Path, r: &Recorder, framed: bool) -> Result<()> {
        if !framed && self.last.elapsed() < WAIT {
            return Ok(());
        }
        let tables = [
            ("probes.csv", &r.probes),
            ("energy.csv", &r.energy),
            ("effects.csv", &r.effects),
        ];
        for ((name, table), rows) in tables.into_iter().zip(&mut self.rows) {
            if !table.names.is_empty() {
                append(&folder.join(name), table, rows)?;
            }
        }
        self.last = Instant::now();
        Ok(())
    }
}

/// Appends the rows of a table after the first `written`; writes the headings with the first row.
fn append(path: &Path, table: &Table, written: &mut usize) -> Result<()> {
    let mut text = String::new();
    if *written == 0 {
        text += "time [s]";
        table.names.iter().for_each(|n| {
            text.push(',');
            text += n;
        });
        text.push('\n');
    }
    for k in *written..table.times.len() {
        let _ = write!(text, "{:e}", table.times[k]);
        for c in &table.columns {
            let _ = write!(text, ",{:e}", c[k]);
        }
        text.push('\n');
    }
    let mut options = File::options();
    if *written == 0 {
        options.create(true).write(true).truncate(true);
    } else {
        options.append(true);
    }
    let mut file = options.open(path).map_err(write(path))?;
    file.write_all(text.as_bytes()).map_err(write(path))?;
    *written = table.times.len();
    Ok(())
}
