//! A solver that a run starts, and that is ended on every path.

use crate::address::{Address, VARIABLE};
use crate::error::{Error, Result};
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// Time a solver has to leave by itself, and again after SIGTERM.
const GRACE: Duration = Duration::from_secs(1);
/// Pause between two checks of the process.
const GLANCE: Duration = Duration::from_millis(2);

/// A started process, together with all processes that it has started.
#[derive(Debug)]
pub(crate) struct Started {
    child: Child,
    command: String,
    /// True if the solver has confirmed the end, and so may take a moment to leave.
    pub(crate) confirmed: bool,
    /// Exit status. Once it is known, the process number may belong to another process.
    status: Option<ExitStatus>,
}

/// Returns a command as a user would type it in a shell.
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
    /// Starts a command in a folder. The command finds the address in its environment; its output goes to the
    /// error output of this process.
    pub(crate) fn new(command: &[String], folder: &Path, address: &Address) -> Result<Self> {
        let text = shown(command);
        let Some((program, arguments)) = command.split_first() else {
            return Err(Error::Command {
                command: text,
                what: "is empty: it names no program".into(),
            });
        };
        let mut start = Command::new(program);
        // No input: a program that asks a question would wait for ever.
        start
            .args(arguments)
            .env(VARIABLE, address.to_string())
            .stdin(Stdio::null())
            .stdout(std::io::stderr());
        // An empty path means the present folder.
        if !folder.as_os_str().is_empty() {
            start.current_dir(folder);
        }
        #[cfg(unix)]
        {
            use std::os::unix::process::CommandExt;
            // With its own process group everything that the command starts can be ended, and Ctrl-C reaches
            // the run alone, which then ends the command in order.
            start.process_group(0);
        }
        let child = start.spawn().map_err(|e| Error::Command {
            command: text.clone(),
            what: format!("cannot be started: {e}"),
        })?;
        Ok(Self {
            child,
            command: text,
            confirmed: false,
            status: None,
        })
    }

    /// Returns how the process ended, in words, if it ends within a time.
    pub(crate) fn ended(&mut self, limit: Duration) -> Option<String> {
        self.wait(limit).map(|status| format!("ended with {status}"))
    }

    /// Creates the error of a process that ended too early.
    pub(crate) fn ended_early(&self, ended: &str, due: &str) -> Error {
        Error::Command {
            command: self.command.clone(),
            what: format!("{ended} before {due}"),
        }
    }

    fn wait(&mut self, limit: Duration) -> Option<ExitStatus> {
        if self.status.is_none() {
            self.status = self.look(limit);
        }
        self.status
    }

    #[cfg(unix)]
    fn look(&mut self, limit: Duration) -> Option<ExitStatus> {
        use rustix::process::{Pid, Signal, WaitId, WaitIdOptions, kill_process_group, waitid};
        let until = Instant::now() + limit;
        let pid = Pid::from_child(&self.child);
        // The process is watched without being reaped: as long as its number is taken, the number of its
        // group cannot be used again.
        let look = WaitIdOptions::EXITED | WaitIdOptions::NOHANG | WaitIdOptions::NOWAIT;
        while let Ok(None) = waitid(WaitId::Pid(pid), look) {
            if Instant::now() >= until {
                return None;
            }
            std::thread::sleep(GLANCE);
        }
        // The leader has ended; what it has started and left behind ends here.
        let _ = kill_process_group(pid, Signal::KILL);
        self.child.wait().ok()
    }

    #[cfg(not(unix))]
    fn look(&mut self, limit: Duration) -> Option<ExitStatus> {
        let until = Instant::now() + limit;
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
        // Without process groups only the process itself can be ended.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Drop for Started {
    fn drop(&mut self) {
        if self
            .wait(if self.confirmed { GRACE } else { Duration::ZERO })
            .is_some()
        {
            return;
        }
        // SIGTERM before SIGKILL: killed at once, an MPI job would leave its ranks to their daemon.
        self.ask_to_leave();
        if self.wait(GRACE).is_none() {
            self.kill();
        }
    }
}
