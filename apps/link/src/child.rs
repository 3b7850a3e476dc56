//! A solver that a run starts, and ends on every path.

use crate::address::{Address, VARIABLE};
use crate::error::{Error, Result};
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// How long a solver may take to leave by itself, and after it was asked to.
const GRACE: Duration = Duration::from_secs(1);
/// Pause between two looks at it.
const GLANCE: Duration = Duration::from_millis(2);

/// A process with all that it started itself.
#[derive(Debug)]
pub(crate) struct Started {
    child: Child,
    command: String,
    /// Whether it was told to leave, and may take a moment for it.
    pub(crate) told: bool,
    /// How it ended. Its number may be another process's from then on.
    over: Option<ExitStatus>,
}

/// A command as a user would type it.
pub fn shown(command: &[String]) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./=+:,@%".contains(c);
    let word = |w: &String| {
        if !w.is_empty() && w.chars().all(plain) {
            w.clone()
        } else {
            format!("'{}'", w.replace('\'', "'\\''"))
        }
    };
    command.iter().map(word).collect::<Vec<_>>().join(" ")
}

impl Started {
    /// Starts a command in a folder; it finds the address in its environment. What it prints goes to where
    /// this process prints its errors.
    pub(crate) fn new(command: &[String], folder: &Path, address: &Address) -> Result<Self> {
        let text = shown(command);
        let Some((program, arguments)) = command.split_first() else {
            return Err(Error::Command {
                command: text,
                what: "is empty: it names no program".into(),
            });
        };
        let mut start = Command::new(program);
        start
            .args(arguments)
            .env(VARIABLE, address.to_string())
            .stdin(Stdio::null())
            .stdout(std::io::stderr());
        // Of an empty one the present folder is meant.
        if !folder.as_os_str().is_empty() {
            start.current_dir(folder);
        }
        #[cfg(unix)]
        {
            use std::os::unix::process::CommandExt;
            // A group of its own: all that it starts can be ended, and Ctrl-C reaches the run alone, which
            // ends it in order.
            start.process_group(0);
        }
        let child = start.spawn().map_err(|e| Error::Command {
            command: text.clone(),
            what: format!("cannot be started: {e}"),
        })?;
        Ok(Self {
            child,
            command: text,
            told: false,
            over: None,
        })
    }

    /// How it ended, if it did so within a time.
    pub(crate) fn ended(&mut self, within: Duration) -> Option<String> {
        self.wait(within).map(|status| format!("ended with {status}"))
    }

    /// The error that it ended too early.
    pub(crate) fn early(&self, ended: &str, due: &str) -> Error {
        Error::Command {
            command: self.command.clone(),
            what: format!("{ended} before {due}"),
        }
    }

    fn wait(&mut self, within: Duration) -> Option<ExitStatus> {
        if self.over.is_none() {
            self.over = self.look(within);
        }
        self.over
    }

    #[cfg(unix)]
    fn look(&mut self, within: Duration) -> Option<ExitStatus> {
        use rustix::process::{Pid, Signal, WaitId, WaitIdOptions, kill_process_group, waitid};
        let until = Instant::now() + within;
        let pid = Pid::from_child(&self.child);
        // It is looked at without being reaped: as long as its number is taken, so is that of its group.
        let look = WaitIdOptions::EXITED | WaitIdOptions::NOHANG | WaitIdOptions::NOWAIT;
        while let Ok(None) = waitid(WaitId::Pid(pid), look) {
            if Instant::now() >= until {
                return None;
            }
            std::thread::sleep(GLANCE);
        }
        let _ = kill_process_group(pid, Signal::KILL);
        self.child.wait().ok()
    }

    #[cfg(not(unix))]
    fn look(&mut self, within: Duration) -> Option<ExitStatus> {
        let until = Instant::now() + within;
        loop {
            if let Ok(Some(status)) = self.child.try_wait() {
                return Some(status);
            }
            if Instant::now() >= until {
                return None;
            }
            std::thread::sleep(GLANCE);
        }
    }

    fn ask_to_leave(&mut self) {
        #[cfg(unix)]
        {
            use rustix::process::{Pid, Signal, kill_process_group};
            let _ = kill_process_group(Pid::from_child(&self.child), Signal::TERM);
        }
    }

    fn kill(&mut self) {
        #[cfg(unix)]
        {
            use rustix::process::{Pid, Signal, kill_process_group};
            let _ = kill_process_group(Pid::from_child(&self.child), Signal::KILL);
        }
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Drop for Started {
    fn drop(&mut self) {
        if self
            .wait(if self.told { GRACE } else { Duration::ZERO })
            .is_some()
        {
            return;
        }
        self.ask_to_leave();
        if self.wait(GRACE).is_none() {
            self.kill();
        }
    }
}
