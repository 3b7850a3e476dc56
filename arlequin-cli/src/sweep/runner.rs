//! Runs the members one after another, each in a process of its own: no two share the cores, each has its own peak of
//! memory, and what one does wrong ends with it.

use super::plan::Member;
use crate::error::{Error, Result, write};
use arlequin_scene::output::mark;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// How long an interrupted run may take to end by itself.
const PATIENCE: Duration = Duration::from_secs(5);

/// How far apart one Ctrl-C may reach two processes.
const SAME_SIGNAL: Duration = Duration::from_secs(1);

/// Whether a run ended as Ctrl-C or SIGTERM ends it: with code 130, or at once if it was still being set up.
fn ended_by_signal(status: std::process::ExitStatus) -> bool {
    #[cfg(unix)]
    let signal = std::os::unix::process::ExitStatusExt::signal(&status);
    #[cfg(not(unix))]
    let signal: Option<i32> = None;
    status.code() == Some(130) || matches!(signal, Some(2 | 15))
}

/// What came of a member.
#[derive(Debug, Clone)]
pub(crate) enum Outcome {
    /// Its summary, with the least times of all repetitions.
    Complete(Value),
    /// Its words.
    Failed(String),
    /// Ctrl-C.
    Interrupted,
}

/// What decides whether a finished run may be taken again.
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

/// Runs members into one folder.
#[derive(Debug)]
pub(crate) struct Runner<'a> {
    program: PathBuf,
    folder: PathBuf,
    repeat: usize,
    threads: Option<usize>,
    stop: &'a AtomicBool,
}

impl<'a> Runner<'a> {
    /// Prepares `folder`, in which each run gets a folder of its own.
    pub(crate) fn new(
        folder: PathBuf,
        repeat: usize,
        threads: Option<usize>,
        stop: &'a AtomicBool,
    ) -> Result<Self> {
        std::fs::create_dir_all(&folder).map_err(write(&folder))?;
        let program = std::env::current_exe().map_err(|e| Error::System {
            what: "finding the program itself",
            message: e.to_string(),
        })?;
        Ok(Self {
            program,
            folder,
            repeat,
            threads,
            stop,
        })
    }

    /// The finished run of an earlier call, if nothing it depends on has changed.
    pub(crate) fn finished(&self, m: &Member) -> Option<Value> {
        let folder = self.folder.join(&m.label);
        let record: Record = read(&folder.join("member.json"))?;
        let mut summary: Value = read(&folder.join("summary.json"))?;
        let good = record.identity == self.identity(m)
            && record.repeat >= self.repeat
            && summary.get("status")? == "complete";
        *summary.get_mut("wall_seconds")? = record.wall_seconds;
        good.then_some(summary)
    }

    /// Runs a member as often as asked for.
    pub(crate) fn run(&self, m: &Member) -> Result<Outcome> {
        let target = self.folder.join(&m.label);
        let mut best: Option<Value> = None;
        for _ in 0..self.repeat {
            match self.once(m, &target)? {
                Outcome::Complete(summary) => {
                    let wall = summary["wall_seconds"].clone();
                    let sum = |w: &Value| {
                        w["setup"].as_f64().unwrap_or_default() + w["stepping"].as_f64().unwrap_or_default()
                    };
                    if best.as_ref().is_none_or(|b| sum(&wall) < sum(b)) {
                        best = Some(wall);
                    }
                }
                other => return Ok(other),
            }
        }
        let record = Record {
            identity: self.identity(m),
            repeat: self.repeat,
            wall_seconds: best.unwrap_or_default(),
        };
        let path = target.join("member.json");
        let text = serde_json::to_string_pretty(&record).map_err(|e| Error::System {
            what: "writing member.json",
            message: e.to_string(),
        })?;
        // Whole or not at all: its presence says that the run is finished.
        let aside = target.join(".member.json");
        std::fs::write(&aside, text).map_err(write(&aside))?;
        std::fs::rename(&aside, &path).map_err(write(&path))?;
        Ok(self.finished(m).map_or_else(
            || Outcome::Failed("its summary.json cannot be read".into()),
            Outcome::Complete,
        ))
    }

    fn once(&self, m: &Member, target: &Path) -> Result<Outcome> {
        let words = self.folder.join(format!("{}.log", m.label));
        let log = std::fs::File::create(&words).map_err(write(&words))?;
        let mut command = Command::new(&self.program);
        command
            .args(["run", "--json", "--force", "--out"])
            .arg(target)
            .arg(&m.scene);
        for s in &m.set {
            command.args(["--set", s]);
        }
        if let Some(n) = self.threads {
            command.args(["--threads", &n.to_string()]);
        }
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(log);
        let mut child = command.spawn().map_err(|e| Error::System {
            what: "starting a run",
            message: e.to_string(),
        })?;
        let status = self.wait(&mut child, &m.label)?;
        if status.is_some_and(ended_by_signal) {
            // Ctrl-C reached the run first; the flag of this process follows in a moment.
            let since = Instant::now();
            while !self.stop.load(Ordering::Relaxed) && since.elapsed() < SAME_SIGNAL {
                std::thread::sleep(Duration::from_millis(5));
            }
        }
        if self.stop.load(Ordering::Relaxed) {
            return Ok(Outcome::Interrupted);
        }
        if status.is_some_and(|s| s.success()) {
            // Nothing was said: an empty log would only stand in the way.
            if std::fs::metadata(&words).is_ok_and(|d| d.len() == 0) {
                let _ = std::fs::remove_file(&words);
            }
            let summary = read(&target.join("summary.json"));
            return Ok(summary.map_or_else(
                || Outcome::Failed("it wrote no summary.json".into()),
                Outcome::Complete,
            ));
        }
        let text = std::fs::read_to_string(&words).unwrap_or_default();
        let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
        Ok(Outcome::Failed(if text.is_empty() {
            status.map_or_else(|| "ended without a word".into(), |s| format!("ended with {s}"))
        } else {
            text
        }))
    }

    /// Waits for a run; Ctrl-C reaches it too, and it then has some seconds to end by itself.
    fn wait(&self, child: &mut Child, label: &str) -> Result<Option<std::process::ExitStatus>> {
        let system = |e: std::io::Error| Error::System {
            what: "waiting for a run",
            message: e.to_string(),
        };
        let mut asked: Option<Instant> = None;
        loop {
            if let Some(status) = child.try_wait().map_err(system)? {
                return Ok(Some(status));
            }
            if self.stop.load(Ordering::Relaxed) {
                let since = *asked.get_or_insert_with(Instant::now);
                if since.elapsed() > PATIENCE {
                    child.kill().map_err(system)?;
                    child.wait().map_err(system)?;
                    // What cannot be removed keeps its name, and the next run of this member begins there.
                    let _ = mark::remove(&self.folder.join(format!("{label}.unfinished")));
                    return Ok(None);
                }
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    fn identity(&self, m: &Member) -> Identity {
        Identity {
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

fn read<T: serde::de::DeserializeOwned>(path: &Path) -> Option<T> {
    serde_json::from_str(&std::fs::read_to_string(path).ok()?).ok()
}

/// FNV-1a of a text, 16 hexadecimal digits: finds changes, guards against nobody.
fn hash(text: &str) -> String {
    let step = |h: u64, b: u8| (h ^ u64::from(b)).wrapping_mul(0x0000_0100_0000_01b3);
    format!("{:016x}", text.bytes().fold(0xcbf2_9ce4_8422_2325, step))
}
