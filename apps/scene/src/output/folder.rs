//! The folder of a run: it appears when the run has ended, and replaces results only, after the new ones
//! are there.
//!
//! ```text
//! NAME.unfinished            while the run goes on; what a killed run leaves, until it is resumed or begun again
//! NAME                       the results
//! NAME.failed                those of a run that failed, where NAME holds earlier results already
//! NAME.replaced              the earlier results, for the moment in which the new ones take their place
//! NAME.unfinished.replaced   what could have been resumed before a run with --force, until that has ended
//! ```

use super::mark::{self, Mark};
use crate::checkpoint;
use crate::error::{Error, Result, value, write};
use std::path::{Path, PathBuf};

/// Where a run writes to, and what must never be replaced.
#[derive(Debug, Clone)]
pub struct Place {
    target: PathBuf,
    force: bool,
    /// Files and folders that neither are in the target nor are it, whatever it bears.
    kept: Vec<PathBuf>,
}

impl Place {
    /// A target of a run that reads the given files.
    pub fn new(target: &Path, force: bool, inputs: &[PathBuf]) -> Self {
        let home = std::env::home_dir();
        let here = std::env::current_dir().ok();
        let kept = inputs.iter().cloned().chain(home).chain(here);
        Self {
            target: target.to_owned(),
            force,
            kept: kept.filter_map(|p| p.canonicalize().ok()).collect(),
        }
    }

    /// Refuses a target that must not be replaced, or a run that could be resumed. What a killed run left
    /// half done is put right first.
    pub fn check(&self) -> Result<()> {
        let target = &self.target;
        if target.file_name().is_none() {
            return Err(value("--out", target.display(), "must name a folder to create"));
        }
        let (left, earlier) = (beside(target, "unfinished"), beside(target, "replaced"));
        if mark::is_busy(&left) {
            return Err(Error::Busy { folder: left });
        }
        // Killed between two renames: the earlier results go back, or the new ones to their place.
        if !is_there(target) && earlier.exists() {
            std::fs::rename(&earlier, target).map_err(write(target))?;
        }
        let resumable = left.join(checkpoint::NAME).exists();
        if !is_there(target) && !resumable && mark::is_sealed(&left) {
            std::fs::rename(&left, target).map_err(write(target))?;
        }
        self.refuse_existing(target)?;
        if !resumable {
            return Ok(());
        }
        if self.force {
            return object(&left);
        }
        Err(Error::Unfinished {
            unfinished: left,
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
        if let Some(inside) = self.kept.iter().find(|p| p.starts_with(&whole)) {
            let rule = format!(
                "is or holds '{}', which this run reads or stands in, so no flag replaces it; choose another --out",
                inside.display()
            );
            return refuse(&rule);
        }
        object(target)
    }
}

/// Refuses a folder that holds anything but results.
fn object(folder: &Path) -> Result<()> {
    match mark::objection(folder)? {
        None => Ok(()),
        Some(rule) => Err(value("--out", folder.display(), &rule)),
    }
}

/// A folder under construction beside its target; removed unless it is finished or can be resumed.
#[derive(Debug)]
pub struct Folder {
    place: Place,
    partial: PathBuf,
    mark: Mark,
    /// What could have been resumed, put out of the way.
    aside: Option<PathBuf>,
    kept: bool,
}

impl Folder {
    /// Begins a folder that will become the target of `place`.
    pub fn begin(place: Place) -> Result<Self> {
        place.check()?;
        let partial = beside(&place.target, "unfinished");
        let earlier = beside(&place.target, "replaced");
        if earlier.exists() {
            object(&earlier)?;
            mark::remove(&earlier)?;
        }
        let mut aside = None;
        if partial.exists() {
            object(&partial)?;
            let old = beside(&partial, "replaced");
            if old.exists() {
                object(&old)?;
                mark::remove(&old)?;
            }
            if partial.join(checkpoint::NAME).exists() {
                std::fs::rename(&partial, &old).map_err(write(&old))?;
                aside = Some(old);
            } else {
                mark::remove(&partial)?;
            }
        }
        std::fs::create_dir_all(&partial).map_err(write(&partial))?;
        Ok(Self {
            mark: marked(&partial)?,
            place,
            partial,
            aside,
            kept: false,
        })
    }

    /// Where the files of a run go until it has ended.
    pub fn unfinished(target: &Path) -> PathBuf {
        beside(target, "unfinished")
    }

    /// Where the checkpoint of a run is that was killed or interrupted.
    pub fn left_behind(target: &Path) -> PathBuf {
        Some(beside(target, "unfinished"))
            .filter(|p| p.exists())
            .unwrap_or_else(|| target.to_owned())
    }

    /// Goes on with a folder whose run was killed, interrupted or failed.
    pub fn reopen(target: &Path) -> Result<Self> {
        let partial = beside(target, "unfinished");
        if !partial.exists() {
            if std::fs::symlink_metadata(target).is_ok_and(|m| m.is_symlink()) {
                let rule = "is a symbolic link; name the folder itself";
                return Err(value("resume", target.display(), rule));
            }
            std::fs::rename(target, &partial).map_err(write(target))?;
        }
        Ok(Self {
            place: Place::new(target, false, &[]),
            mark: marked(&partial)?,
            partial,
            aside: None,
            kept: false,
        })
    }

    /// Where files go until the folder is finished.
    pub fn path(&self) -> &Path {
        &self.partial
    }

    /// Creates a folder inside.
    pub fn subfolder(&self, name: &str) -> Result<PathBuf> {
        let path = self.partial.join(name);
        std::fs::create_dir_all(&path).map_err(write(&path))?;
        Ok(path)
    }

    /// Moves everything but the checkpoint into a folder inside. The checkpoint stays until another one
    /// replaces it: killed in between, the run goes on from there after [`Folder::take_back`].
    pub fn put_aside(&self, name: &str) -> Result<()> {
        let into = self.partial.join(name);
        let all = self.results(&self.partial)?;
        std::fs::create_dir(&into).map_err(write(&into))?;
        for from in all {
            let to = into.join(from.file_name().unwrap_or_default());
            std::fs::rename(&from, &to).map_err(write(&to))?;
        }
        Ok(())
    }

    /// Undoes [`Folder::put_aside`], whatever it left undone and whatever came after it.
    pub fn take_back(&self, name: &str) -> Result<()> {
        let from = self.partial.join(name);
        if !from.exists() {
            return Ok(());
        }
        for entry in self.results(&from)? {
            let to = self.partial.join(entry.file_name().unwrap_or_default());
            // What came after the waking is made anew.
            if to.is_dir() {
                for file in self.results(&to)? {
                    std::fs::remove_file(&file).map_err(write(&file))?;
                }
                std::fs::remove_dir(&to).map_err(write(&to))?;
            } else if to.exists() {
                std::fs::remove_file(&to).map_err(write(&to))?;
            }
            std::fs::rename(&entry, &to).map_err(write(&to))?;
        }
        std::fs::remove_dir(&from).map_err(write(&from))
    }

    /// What the run wrote into a folder inside, its checkpoint and mark apart.
    fn results(&self, folder: &Path) -> Result<Vec<PathBuf>> {
        let mut out = Vec::new();
        for entry in std::fs::read_dir(folder).map_err(write(folder))? {
            let path = entry.map_err(write(folder))?.path();
            let name = path.strip_prefix(&self.partial).unwrap_or(&path);
            let stays = [checkpoint::NAME, mark::NAME]
                .iter()
                .any(|n| name == Path::new(n));
            if mark::is_ours(name) && !stays {
                out.push(path);
            }
        }
        Ok(out)
    }

    /// Moves the folder to its target; results of a run that `failed` do not replace earlier ones but go
    /// beside them.
    pub fn finish(mut self, failed: bool) -> Result<PathBuf> {
        let partial = self.partial.clone();
        self.settle(failed)
            .map_err(|e| e.kept("the results are", &partial))
    }

    /// Keeps the folder under its name of a run that goes on, after an error that leaves nothing better.
    pub fn keep(mut self, error: Error) -> Error {
        self.kept = true;
        error.kept("what there is so far is", &self.partial)
    }

    fn settle(&mut self, failed: bool) -> Result<PathBuf> {
        // What is finished stays, wherever it ends up.
        self.kept = true;
        let sealed = self.mark.seal(&self.partial);
        if !failed {
            sealed?;
        }
        let mut target = self.place.target.clone();
        if failed && is_there(&target) {
            target = beside(&target, "failed");
            self.place.force = true;
        }
        self.replace(&target)?;
        Ok(target)
    }

    fn replace(&mut self, target: &Path) -> Result<()> {
        // Someone may have made it in the meantime.
        self.place.refuse_existing(target)?;
        let earlier = is_there(target).then(|| beside(target, "replaced"));
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
        if self.kept || self.partial.join(checkpoint::NAME).exists() {
            return;
        }
        // Nothing better can be done about a failure here than to leave the folder behind under its name.
        if self.partial.join(mark::PART).exists() {
            let _ = self.settle(true);
            return;
        }
        let _ = mark::remove(&self.partial);
        if let Some(old) = &self.aside {
            let _ = std::fs::rename(old, &self.partial);
        }
    }
}

/// Marks a folder, or says that another run writes there.
fn marked(partial: &Path) -> Result<Mark> {
    Mark::set(partial)?.ok_or_else(|| Error::Busy {
        folder: partial.to_owned(),
    })
}

/// The path with a further ending.
fn beside(path: &Path, ending: &str) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!("{name}.{ending}"))
}

/// Whether there is anything, a dangling link included.
fn is_there(path: &Path) -> bool {
    std::fs::symlink_metadata(path).is_ok()
}
