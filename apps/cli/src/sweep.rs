//! `arlequin sweep`: makes the runs of a sweep one after another, each in its own process. So runs do not
//! compete for cores, each has its own peak of memory, and a crash ends only one run.

use crate::error::{Error, Located, Result, key, write};
use crate::report::{self, Progress};
use crate::{run, threads};
use arlequin_scene::Source;
use arlequin_scene::output::mark;
use arlequin_scene::sweep::{Member, Outcome, PlannedSweep, Runner};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitCode, ExitStatus, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Arguments of `arlequin sweep`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Sweep file.
    sweep: PathBuf,
    /// Output folder; its finished runs are used again [default: results/ and the name of the sweep]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Repeat all runs.
    #[arg(long)]
    fresh: bool,
    /// Print sweep.json.
    #[arg(long)]
    json: bool,
}

/// Arguments of `arlequin sweep-docs`.
#[derive(Debug, clap::Args)]
pub(crate) struct DocumentArguments {
    /// Page to write; pictures go to images/ beside it
    #[arg(long, value_name = "FILE.md")]
    out: PathBuf,
    /// Date and machine of the measurements, for the page ("1 May 2027, two cores of ...")
    #[arg(long, value_name = "TEXT")]
    measured: Option<String>,
    /// Sweep files, each followed by its output folder
    #[arg(value_name = "SWEEP.toml DIR", required = true)]
    pairs: Vec<PathBuf>,
}

/// Time that an interrupted run has to end by itself before it is killed.
const PATIENCE: Duration = Duration::from_secs(5);

/// Longest delay between the arrivals of one Ctrl-C in two processes.
const SAME_SIGNAL: Duration = Duration::from_secs(1);

/// Returns whether a run ended because of Ctrl-C or SIGTERM: with exit code 130, or by the signal itself if
/// the run was still being set up.
fn ended_by_signal(status: ExitStatus) -> bool {
    #[cfg(unix)]
    let signal = std::os::unix::process::ExitStatusExt::signal(&status);
    #[cfg(not(unix))]
    let signal: Option<i32> = None;
    status.code() == Some(130) || matches!(signal, Some(2 | 15))
}

/// Runs `arlequin sweep`.
pub(crate) fn sweep(arguments: &Arguments) -> Result<ExitCode, Located> {
    threads::start(None)?;
    let source = Source::read(&arguments.sweep)?;
    let stem = arguments.sweep.file_stem().unwrap_or_default();
    let out = arguments.out.clone();
    let out = out.unwrap_or_else(|| Path::new("results").join(stem));
    let progress = Progress::default();
    let make = || {
        let prepared = PlannedSweep::new(&source)?;
        mark::claim("--out", &out)?;
        let file = prepared.file().clone();
        let processes = Processes::new(file.threads, run::watch_interrupt()?)?;
        let report_progress = |label: &str, k: usize, count: usize| {
            progress.show("runs", k, count);
            progress.set_label(label);
        };
        let result = prepared.make(&out, arguments.fresh, &processes, &report_progress)?;
        Ok((file, result))
    };
    let (file, result) = make().map_err(Located::within(&source))?;
    drop(progress);
    let json = report::sweep::write_all(&out, &file, &result)?;
    if arguments.json {
        report::line(&json);
    } else {
        report::sweep::finished(&result, &out);
    }
    Ok(match result.status {
        "interrupted" => ExitCode::from(run::INTERRUPTED),
        "failed" => ExitCode::FAILURE,
        _ => ExitCode::SUCCESS,
    })
}

/// Runs `arlequin sweep-docs`: writes the page about finished sweeps.
pub(crate) fn document(a: &DocumentArguments) -> Result<ExitCode, Located> {
    if !a.pairs.len().is_multiple_of(2) {
        let rule = "every sweep file must be followed by its output folder";
        return Err(key("sweep-docs", rule).into());
    }
    mark::generated("--out", &a.out, report::sweep_docs::HEAD)?;
    let images = a.out.parent().unwrap_or_else(|| Path::new(".")).join("images");
    std::fs::create_dir_all(&images).map_err(write(&images))?;
    let mut text = report::sweep_docs::HEAD.to_owned();
    if let Some(when) = &a.measured {
        text += &format!(
            "\nMeasured: {when}, with version {}.\n",
            env!("CARGO_PKG_VERSION")
        );
    }
    for pair in a.pairs.chunks_exact(2) {
        let source = Source::read(&pair[0])?;
        let reopen = || {
            let prepared = PlannedSweep::new(&source)?;
            if let Some(label) = prepared.unfinished(&pair[1]) {
                let [path, out] = [&pair[0], &pair[1]].map(|p| p.display());
                let rule =
                    format!("run '{label}' is not finished; run 'arlequin sweep {path} --out {out}' first");
                return Err(key(out.to_string(), rule));
            }
            let file = prepared.file().clone();
            // All runs are finished, so no process is started here.
            let nothing = Processes::new(file.threads, Arc::default())?;
            Ok((file, prepared.make(&pair[1], false, &nothing, &|_, _, _| ())?))
        };
        let (file, sweep) = reopen().map_err(Located::within(&source))?;
        let stem = pair[0].file_stem().unwrap_or_default().to_string_lossy();
        report::sweep_docs::part(&mut text, &source.text, &stem, (&file, &sweep), &images)?;
    }
    std::fs::write(&a.out, text).map_err(write(&a.out))?;
    report::line(&format!("written    {}", a.out.display()));
    Ok(ExitCode::SUCCESS)
}

/// Makes each run of a sweep in a new process of this program.
#[derive(Debug)]
struct Processes {
    program: PathBuf,
    threads: Option<usize>,
    stop: Arc<AtomicBool>,
}

impl Processes {
    fn new(threads: Option<usize>, stop: Arc<AtomicBool>) -> Result<Self> {
        let program = std::env::current_exe().map_err(|e| Error::System {
            what: "finding the program itself",
            message: e.to_string(),
        })?;
        Ok(Self {
            program,
            threads,
            stop,
        })
    }

    /// Waits for a run to end. Ctrl-C reaches the run too; it then has [`PATIENCE`] to end by itself,
    /// otherwise it is killed and `None` is returned.
    fn wait(&self, child: &mut Child, folder: &Path) -> Result<Option<ExitStatus>> {
        let system = |e: std::io::Error| Error::System {
            what: "waiting for a run",
            message: e.to_string(),
        };
        let mut interrupted_at: Option<Instant> = None;
        loop {
            // The standard library has no wait with a time limit, so the state is polled.
            if let Some(status) = child.try_wait().map_err(system)? {
                return Ok(Some(status));
            }
            if self.stop.load(Ordering::Relaxed) {
                let since = *interrupted_at.get_or_insert_with(Instant::now);
                if since.elapsed() > PATIENCE {
                    child.kill().map_err(system)?;
                    child.wait().map_err(system)?;
                    // If removal fails, the folder keeps its name and the next run of this member starts
                    // again in it.
                    let _ = mark::remove(&beside(folder, "unfinished"));
                    return Ok(None);
                }
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

impl Runner for Processes {
    fn run(&self, m: &Member, target: &Path) -> Result<Outcome> {
        let words = beside(target, "log");
        let log = std::fs::File::create(&words).map_err(write(&words))?;
        let mut command = Command::new(&self.program);
        command
            .args(["run", "--json", "--quiet", "--force", "--out"])
            .arg(target)
            .arg(&m.scene);
        for s in &m.set {
            command.args(["--set", s]);
        }
        if let Some(n) = self.threads {
            command.args(["--threads", &n.to_string()]);
        }
        // Results go to files, messages to the log.
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(log);
        let mut child = command.spawn().map_err(|e| Error::System {
            what: "starting a run",
            message: e.to_string(),
        })?;
        let status = self.wait(&mut child, target)?;
        if status.is_some_and(ended_by_signal) {
            // The run received Ctrl-C first; the flag of this process follows within [`SAME_SIGNAL`].
            let since = Instant::now();
            while !self.stop.load(Ordering::Relaxed) && since.elapsed() < SAME_SIGNAL {
                std::thread::sleep(Duration::from_millis(5));
            }
        }
        if self.stop.load(Ordering::Relaxed) {
            return Ok(Outcome::Interrupted);
        }
        if status.is_some_and(|s| s.success()) {
            // The run wrote no messages, so its empty log is removed.
            if std::fs::metadata(&words).is_ok_and(|d| d.len() == 0) {
                let _ = std::fs::remove_file(&words);
            }
            return Ok(Outcome::Complete);
        }
        let text = std::fs::read_to_string(&words).unwrap_or_default();
        let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
        Ok(Outcome::Failed(if text.is_empty() {
            status.map_or_else(|| "ended without a word".into(), |s| format!("ended with {s}"))
        } else {
            text
        }))
    }

    fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

/// Returns the path with `.` and a further ending.
fn beside(folder: &Path, ending: &str) -> PathBuf {
    let mut name = folder.as_os_str().to_owned();
    name.push(".");
    name.push(ending);
    name.into()
}
