//! Finished runs in the folder of a sweep, and when one may be reused.

use super::plan::Member;
use super::{Outcome, Runner};
use crate::error::{Result, write};
use crate::output::mark;
use crate::spec::sweep::SweepFile;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Everything that must be unchanged for a finished run to be reused.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
struct Identity {
    scene: String,
    scene_hash: String,
    set: Vec<String>,
    threads: Option<usize>,
    version: String,
}

/// `member.json` in the folder of a run.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Record {
    identity: Identity,
    repeat: usize,
    wall_seconds: Value,
}

/// The runs of a sweep in a folder, one folder each.
#[derive(Debug)]
pub(super) struct Kept {
    /// Folder of the runs.
    pub(super) folder: PathBuf,
    repeat: usize,
    threads: Option<usize>,
}

impl Kept {
    /// Uses the folder `out` of a sweep's results.
    pub(super) fn new(out: &Path, file: &SweepFile) -> Self {
        Self {
            folder: out.join("runs"),
            repeat: file.repeat,
            threads: file.threads,
        }
    }

    /// Returns the summary of a run that an earlier call finished, with its shortest wall times, if nothing
    /// has changed that the run depends on.
    pub(super) fn finished(&self, m: &Member) -> Option<Value> {
        let folder = self.folder.join(&m.label);
        let record: Record = read(&folder.join("member.json"))?;
        let mut summary: Value = read(&folder.join(mark::SUMMARY))?;
        // Times of more repetitions than asked for are good enough.
        let good = record.identity == self.identity(m)
            && record.repeat >= self.repeat
            && record.wall_seconds.get("total").is_some()
            && summary.get("status")? == "complete";
        *summary.get_mut("wall_seconds")? = record.wall_seconds;
        good.then_some(summary)
    }

    /// Makes a run `repeat` times. Returns its summary with the shortest times, or how it ended instead.
    pub(super) fn run(&self, m: &Member, runner: &dyn Runner) -> Result<Result<Value, Outcome>> {
        let target = self.folder.join(&m.label);
        let mut best: Option<Value> = None;
        // Repetitions differ in their times only, so that they may overwrite each other.
        for _ in 0..self.repeat {
            match runner.run(m, &target)? {
                Outcome::Complete => {}
                other => return Ok(Err(other)),
            }
            let Some(summary) = read::<Value>(&target.join(mark::SUMMARY)) else {
                return Ok(Err(Outcome::Failed("it wrote no summary.json".into())));
            };
            let wall = summary["wall_seconds"].clone();
            let total = |w: &Value| w["total"].as_f64().unwrap_or_default();
            if best.as_ref().is_none_or(|b| total(&wall) < total(b)) {
                best = Some(wall);
            }
        }
        let record = Record {
            identity: self.identity(m),
            repeat: self.repeat,
            wall_seconds: best.unwrap_or_default(),
        };
        // Renaming creates the file at once, because its presence marks the run as finished.
        let (path, aside) = (target.join("member.json"), target.join(".member.json"));
        put(&aside, &record)?;
        std::fs::rename(&aside, &path).map_err(write(&path))?;
        let lost = || Outcome::Failed("its summary.json cannot be read".into());
        Ok(self.finished(m).ok_or_else(lost))
    }

    fn identity(&self, m: &Member) -> Identity {
        Identity {
            // Only the name, so that folders may be moved; the hash covers the content.
            scene: m
                .scene
                .file_name()
                .unwrap_or_default()
                .to_string_lossy()
                .into_owned(),
            scene_hash: hash(&m.text),
            set: m.set.clone(),
            threads: self.threads,
            version: env!("CARGO_PKG_VERSION").to_owned(),
        }
    }
}

/// Reads JSON; `None` on any failure.
pub(super) fn read<T: serde::de::DeserializeOwned>(path: &Path) -> Option<T> {
    serde_json::from_str(&std::fs::read_to_string(path).ok()?).ok()
}

/// Writes JSON.
pub(super) fn put(path: &Path, what: &impl Serialize) -> Result<()> {
    let text = crate::output::json("writing JSON", what)?;
    std::fs::write(path, text).map_err(write(path))
}

/// FNV-1a hash of a text in 16 hexadecimal digits. It detects changes; it is not cryptographic.
fn hash(text: &str) -> String {
    let step = |h: u64, b: u8| (h ^ u64::from(b)).wrapping_mul(0x0000_0100_0000_01b3);
    format!("{:016x}", text.bytes().fold(0xcbf2_9ce4_8422_2325, step))
}
