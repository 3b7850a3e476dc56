//! Progress of long work: a bar on a terminal. Elsewhere, such as in the log of a batch system, a line at
//! growing intervals, the first after some seconds.

use super::loudness;
use indicatif::{ProgressBar, ProgressStyle};
use std::io::IsTerminal;
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Time before the first line of a log \[s\]. Each further line takes twice as long as the one before, up
/// to `MOST`.
const FIRST: u64 = 5;
const MOST: u64 = 60;

/// State of the work in progress.
#[derive(Debug, Default)]
struct Doing {
    what: String,
    label: String,
    done: usize,
    total: usize,
    since: Option<Instant>,
    over: bool,
}

impl Doing {
    /// Returns a line such as `steps 1200 of 5000, 38 s to go`; `None` if no work is in progress.
    fn words(&self, now: Instant) -> Option<String> {
        let since = self.since?;
        if self.total == 0 {
            return Some(self.what.clone());
        }
        let elapsed = now.duration_since(since).as_secs_f64();
        let seconds_left = elapsed * (self.total.saturating_sub(self.done)) as f64 / self.done.max(1) as f64;
        let to_go = if self.done > 0 {
            format!(", {seconds_left:.0} s to go")
        } else {
            String::new()
        };
        Some(format!(
            "{} {} of {}{}{to_go}",
            self.what, self.done, self.total, self.label
        ))
    }
}

/// Destination of the progress report.
#[derive(Debug)]
enum Place {
    Nowhere,
    Terminal(Mutex<Option<(String, ProgressBar)>>),
    Log(Arc<(Mutex<Doing>, Condvar)>, Option<JoinHandle<()>>),
}

/// Reports the progress of one task after another.
#[derive(Debug)]
pub(crate) struct Progress(Place);

impl Default for Progress {
    fn default() -> Self {
        Self(match loudness().quiet {
            true => Place::Nowhere,
            false if std::io::stderr().is_terminal() => Place::Terminal(Mutex::default()),
            false => {
                let shared = Arc::<(Mutex<Doing>, Condvar)>::default();
                let log_state = shared.clone();
                let log = std::thread::Builder::new().spawn(move || log(&log_state));
                Place::Log(shared, log.ok())
            }
        })
    }
}

/// Writes lines at growing intervals until the work is over.
fn log((doing, wake): &(Mutex<Doing>, Condvar)) {
    let start = Instant::now();
    let mut pause = FIRST;
    let mut now = doing.lock().unwrap_or_else(PoisonError::into_inner);
    loop {
        // Wakes early when the work is over, so that a short program does not wait for its log.
        let until = |d: &mut Doing| !d.over;
        let waited = wake.wait_timeout_while(now, Duration::from_secs(pause), until);
        now = waited.unwrap_or_else(PoisonError::into_inner).0;
        if now.over {
            return;
        }
        if let Some(words) = now.words(Instant::now()) {
            super::error(&format!("{:>7.0} s  {words}\n", start.elapsed().as_secs_f64()));
        }
        pause = (2 * pause).min(MOST);
    }
}

impl Progress {
    /// Returns the function by which libraries report their progress.
    pub(crate) fn reporter(&self) -> impl Fn(&str, usize, usize) + Sync {
        |what, done, total| self.show(what, done, total)
    }

    /// Reports the start of a set-up phase (`total` is 0), or that `done` of `total` units of it are done.
    pub(crate) fn phase(&self, phase: &str, done: usize, total: usize) {
        if loudness().verbose && total == 0 {
            super::error(&format!("set-up     {phase} ...\n"));
        }
        self.show(&format!("set-up: {phase}"), done, total);
    }

    /// Reports that `done` of `total` units are done.
    pub(crate) fn show(&self, what: &str, done: usize, total: usize) {
        match &self.0 {
            Place::Nowhere => {}
            Place::Terminal(shown) => {
                let Ok(mut shown) = shown.lock() else { return };
                let is_shown = |(name, bar): &(String, ProgressBar)| {
                    name == what && bar.length().unwrap_or(0) == total as u64
                };
                if !shown.as_ref().is_some_and(is_shown) {
                    if let Some((_, bar)) = shown.take() {
                        bar.finish_and_clear();
                    }
                    *shown = Some((what.to_owned(), bar(what, total)));
                }
                if let Some((_, bar)) = &*shown {
                    bar.set_position(done as u64);
                }
            }
            Place::Log(shared, _) => {
                let Ok(mut doing) = shared.0.lock() else { return };
                if doing.what != what {
                    what.clone_into(&mut doing.what);
                    doing.label.clear();
                    doing.since = Some(Instant::now());
                }
                (doing.done, doing.total) = (done, total);
            }
        }
    }

    /// Sets the label of the unit in progress.
    pub(crate) fn set_label(&self, label: &str) {
        match &self.0 {
            Place::Nowhere => {}
            Place::Terminal(shown) => {
                if let Ok(Some((_, bar))) = shown.lock().as_deref() {
                    bar.set_message(format!(": {label}"));
                }
            }
            Place::Log(shared, _) => {
                if let Ok(mut doing) = shared.0.lock() {
                    doing.label = format!(" ({label})");
                }
            }
        }
    }

    /// Removes the bar.
    pub(crate) fn clear(&self) {
        match &self.0 {
            Place::Nowhere => {}
            Place::Terminal(shown) => {
                if let Some((_, bar)) = shown.lock().ok().and_then(|mut s| s.take()) {
                    bar.finish_and_clear();
                }
            }
            Place::Log(shared, _) => {
                if let Ok(mut doing) = shared.0.lock() {
                    doing.since = None;
                    doing.what.clear();
                }
            }
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.clear();
        if let Place::Log(shared, thread) = &mut self.0 {
            if let Ok(mut doing) = shared.0.lock() {
                doing.over = true;
            }
            shared.1.notify_all();
            if let Some(t) = thread.take() {
                let _ = t.join();
            }
        }
    }
}

fn bar(what: &str, total: usize) -> ProgressBar {
    let (bar, template) = match total {
        0 => (
            ProgressBar::new_spinner(),
            format!("{{spinner}} {what}, {{elapsed}}"),
        ),
        total => {
            let text = format!("{{bar:40}} {{pos}}/{{len}} {what}{{msg}}, {{elapsed}} gone, {{eta}} to go");
            (ProgressBar::new(total as u64), text)
        }
    };
    if let Ok(style) = ProgressStyle::with_template(&template) {
        bar.set_style(style);
    }
    // Twice a second, so that drawing the bar takes no time from the run.
    bar.enable_steady_tick(Duration::from_millis(500));
    bar
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_log_says_how_much_is_done_and_how_long_the_rest_takes() {
        let start = Instant::now();
        let mut doing = Doing {
            what: "steps".into(),
            total: 400,
            done: 100,
            since: Some(start),
            ..Doing::default()
        };
        let later = start + Duration::from_secs(10);
        assert_eq!(
            doing.words(later).as_deref(),
            Some("steps 100 of 400, 30 s to go")
        );
        doing.done = 0;
        assert_eq!(doing.words(later).as_deref(), Some("steps 0 of 400"));
        doing = Doing {
            what: "set-up: model 'ball'".into(),
            since: Some(start),
            ..Doing::default()
        };
        assert_eq!(doing.words(later).as_deref(), Some("set-up: model 'ball'"));
        assert_eq!(Doing::default().words(later), None);
    }
}
