//! The folder of a run. It gets its name when the run has ended. Only results are ever replaced, and only
//! when the new ones are complete.
//!
//! ```text
//! NAME.unfinished            a run that goes on or was killed, until it is resumed or started again
//! NAME                       the results
//! NAME.failed                results of a failed run, if NAME has earlier results
//! NAME.replaced              earlier results, while the new ones are renamed
//! NAME.unfinished.replaced   a run that could be resumed, while a run with --force replaces it
//! ```

use super::mark::{self, FileList, Mark};
use crate::error::{Error, Result, value, write};
use std::path::{Path, PathBuf};

/// Ending of a folder until its run has ended.
const UNFINISHED: &str = "unfinished";

/// Target folder of a run, with the paths that must never be replaced.
#[derive(Debug, Clone)]
pub struct Place {
    target: PathBuf,
    force: bool,
    /// Paths that the target must not be or contain, even if it has the mark of results.
    protected: Vec<PathBuf>,
}

impl Place {
    /// Target of a run that reads the files `inputs`.
    pub fn new(target: &Path, force: bool, inputs: &[PathBuf]) -> Self {
        let home = std::env::home_dir();
        let working_folder = std::env::current_dir().ok();
        let protected = inputs.iter().cloned().chain(home).chain(working_folder);
        Self {
            target: target.to_owned(),
            force,
            protected: protected.filter_map(|p| p.canonicalize().ok()).collect(),
        }
    }

    /// Refuses a target that must not be replaced, or a run that could be resumed. First completes the
    /// renaming that a killed run left half done.
    pub fn check(&self) -> Result<()> {
        let target = &self.target;
        if target.file_name().is_none() {
            return Err(value("--out", target.display(), "must name a folder to create"));
        }
        let (partial, earlier) = (with_ending(target, UNFINISHED), with_ending(target, "replaced"));
        if mark::is_busy(&partial) {
            return Err(Error::Busy { folder: partial });
        }
        // A run was killed between two renames: moves the earlier results back, or the new ones to their
        // target.
        if !is_there(target) && earlier.exists() {
            std::fs::rename(&earlier, target).map_err(write(target))?;
        }
        let resumable = partial.join(mark::CHECKPOINT).exists();
        if !is_there(target) && !resumable && mark::is_sealed(&partial) {
            std::fs::rename(&partial, target).map_err(write(target))?;
        }
        self.refuse_existing(target)?;
        if !resumable {
            return Ok(());
        }
        if self.force {
            return refuse_foreign(&partial);
        }
        Err(Error::Unfinished {
            unfinished: partial,
            target: target.clone(),
        })
    }

    fn refuse_existing(&self, target: &Path) -> Result<()> {
        let Ok(kind) = std::fs::symlink_metadata(target) else {
            return Ok(());
        };
        let refuse = |rule: &str| Err(value("--out", target.display(), rule));
        if kind.is_symlink() {
            return refuse("is a symbolic link, which no flag replaces; name a folder of its own");
        }
        if !self.force {
            return Err(Error::Exists {
                path: target.to_owned(),
            });
        }
        if !kind.is_dir() {
            return refuse("is a file, which --force does not replace; choose another folder");
        }
        let whole = target.canonicalize().map_err(write(target))?;
        if let Some(inside) = self.protected.iter().find(|p| p.starts_with(&whole)) {
            let rule = format!(
                "is or holds '{}', which this run reads or stands in, so no flag replaces it; choose another --out",
                inside.display()
            );
            return refuse(&rule);
        }
        refuse_foreign(target)
    }
}

/// Refuses a folder that holds anything but results.
fn refuse_foreign(folder: &Path) -> Result<()> {
    match mark::objection(folder)? {
        None => Ok(()),
        Some(rule) => Err(value("--out", folder.display(), &rule)),
    }
}

/// A folder that is being written beside its target. Dropping it removes it unless it is finished or can be
/// resumed.
#[derive(Debug)]
pub struct Folder {
    place: Place,
    partial: PathBuf,
    mark: Mark,
    /// An earlier run that could be resumed, moved out of the way.
    aside: Option<PathBuf>,
    is_kept: bool,
}

impl Folder {
    /// Creates the folder that will become the target of `place`.
    pub fn begin(place: Place) -> Result<Self> {
        place.check()?;
        let partial = with_ending(&place.target, UNFINISHED);
        let earlier = with_ending(&place.target, "replaced");
        if earlier.exists() {
            refuse_foreign(&earlier)?;
            mark::remove(&earlier)?;
        }
        let mut aside = None;
        if partial.exists() {
            refuse_foreign(&partial)?;
            let old = with_ending(&partial, "replaced");
            if old.exists() {
                refuse_foreign(&old)?;
                mark::remove(&old)?;
            }
            if partial.join(mark::CHECKPOINT).exists() {
                std::fs::rename(&partial, &old).map_err(write(&old))?;
                aside = Some(old);
            } else {
                mark::remove(&partial)?;
            }
        }
        std::fs::create_dir_all(&partial).map_err(write(&partial))?;
        Ok(Self {
            mark: set_mark(&partial)?,
            place,
            partial,
            aside,
            is_kept: false,
        })
    }

    /// Path at which files are written until the run has ended.
    pub fn unfinished(target: &Path) -> PathBuf {
        with_ending(target, UNFINISHED)
    }

    /// Path of the results of a run that a user names by `folder`: the target, or the folder with a
    /// checkpoint that the run left behind.
    pub fn target(folder: &Path) -> PathBuf {
        let goes_on = folder.extension().is_some_and(|e| e == UNFINISHED);
        match goes_on && folder.join(mark::CHECKPOINT).exists() {
            true => folder.with_extension(""),
            false => folder.to_owned(),
        }
    }

    /// Path that has the checkpoint of a killed or interrupted run.
    pub fn left_behind(target: &Path) -> PathBuf {
        Some(with_ending(target, UNFINISHED))
            .filter(|p| p.exists())
            .unwrap_or_else(|| target.to_owned())
    }

    /// Reopens the folder of a run that was killed, interrupted or failed.
    pub fn reopen(target: &Path) -> Result<Self> {
        let partial = with_ending(target, UNFINISHED);
        if !partial.exists() {
            if std::fs::symlink_metadata(target).is_ok_and(|m| m.is_symlink()) {
                let rule = "is a symbolic link; name the folder itself";
                return Err(value("resume", target.display(), rule));
            }
            std::fs::rename(target, &partial).map_err(write(target))?;
        }
        Ok(Self {
            place: Place::new(target, false, &[]),
            mark: set_mark(&partial)?,
            partial,
            aside: None,
            is_kept: false,
        })
    }

    /// Path at which files are written until the folder is finished.
    pub fn path(&self) -> &Path {
        &self.partial
    }

    /// Creates a subfolder.
    pub fn subfolder(&self, name: &str) -> Result<PathBuf> {
        let path = self.partial.join(name);
        std::fs::create_dir_all(&path).map_err(write(&path))?;
        Ok(path)
    }

    /// Renames the folder to its target. Results of a run that `failed` do not replace earlier ones; their
    /// folder gets the ending `failed`. Files of `written` need not be read again.
    pub(crate) fn finish(mut self, failed: bool, written: &FileList) -> Result<PathBuf> {
        let partial = self.partial.clone();
        self.settle(failed, written)
            .map_err(|e| e.kept("the results are", &partial))
    }

    /// Keeps the folder under its unfinished name, after an error that leaves nothing better to do.
    pub fn keep(mut self, error: Error) -> Error {
        self.is_kept = true;
        error.kept("what there is so far is", &self.partial)
    }

    fn settle(&mut self, failed: bool, written: &FileList) -> Result<PathBuf> {
        // Finished results are kept even if renaming fails.
        self.is_kept = true;
        let sealed = self.mark.seal(&self.partial, written);
        if !failed {
            sealed?;
        }
        let mut target = self.place.target.clone();
        if failed && is_there(&target) {
            target = with_ending(&target, "failed");
            // A failed run may replace the folder of an earlier failed one.
            self.place.force = true;
        }
        self.replace(&target)?;
        Ok(target)
    }

    fn replace(&mut self, target: &Path) -> Result<()> {
        // Another process may have created the target in the meantime.
        self.place.refuse_existing(target)?;
        let earlier = is_there(target).then(|| with_ending(target, "replaced"));
        if let Some(earlier) = &earlier {
            std::fs::rename(target, earlier).map_err(write(target))?;
        }
        if let Err(e) = std::fs::rename(&self.partial, target) {
            if let Some(earlier) = &earlier {
                std::fs::rename(earlier, target).map_err(write(target))?;
            }
            return Err(write(target)(e));
        }
        earlier
            .into_iter()
            .chain(self.aside.take())
            .try_for_each(|old| mark::remove(&old))
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        if self.is_kept || self.partial.join(mark::CHECKPOINT).exists() {
            return;
        }
        // Drop cannot report an error: on failure the folder stays under its unfinished name.
        let _ = mark::remove(&self.partial);
        if let Some(old) = &self.aside {
            let _ = std::fs::rename(old, &self.partial);
        }
    }
}

/// Marks a folder.
///
/// # Errors
/// [`Error::Busy`] if another run writes there.
fn set_mark(partial: &Path) -> Result<Mark> {
    Mark::set(partial)?.ok_or_else(|| Error::Busy {
        folder: partial.to_owned(),
    })
}

/// Appends an ending to a path.
fn with_ending(path: &Path, ending: &str) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!("{name}.{ending}"))
}

/// Returns whether the path exists; a dangling link counts.
fn is_there(path: &Path) -> bool {
    std::fs::symlink_metadata(path).is_ok()
}
