//! The output folder appears at once or not at all.

use crate::checkpoint;
use crate::error::{Error, Result, write};
use std::path::{Path, PathBuf};

/// A folder under construction beside its target; removed unless it is finished or can be resumed.
#[derive(Debug)]
pub(crate) struct Folder {
    target: PathBuf,
    partial: PathBuf,
    force: bool,
    finished: bool,
}

impl Folder {
    /// Begins a folder that will become `target`; an existing one is replaced only with `force`. A `lasting` one has a
    /// name that [`Folder::reopen`] finds after the program was killed.
    pub(crate) fn begin(target: &Path, force: bool, lasting: bool) -> Result<Self> {
        check_free(target, force)?;
        let Some(unfinished) = unfinished(target) else {
            return Err(crate::error::value(
                "--out",
                target.display(),
                "must name a folder to create",
            ));
        };
        if unfinished.exists() {
            std::fs::remove_dir_all(&unfinished).map_err(write(&unfinished))?;
        }
        let partial = if lasting {
            unfinished
        } else {
            let name = target.file_name().unwrap_or_default().to_string_lossy();
            target.with_file_name(format!(".{name}.partial-{}", std::process::id()))
        };
        std::fs::create_dir_all(&partial).map_err(write(&partial))?;
        Ok(Self {
            target: target.to_owned(),
            partial,
            force,
            finished: false,
        })
    }

    /// Where the checkpoint of a run is that was killed or interrupted.
    pub(crate) fn left_behind(target: &Path) -> PathBuf {
        unfinished(target)
            .filter(|p| p.exists())
            .unwrap_or_else(|| target.to_owned())
    }

    /// Goes on with a folder whose run was killed or interrupted.
    pub(crate) fn reopen(target: &Path) -> Result<Self> {
        let partial = unfinished(target).unwrap_or_else(|| target.to_owned());
        if !partial.exists() {
            std::fs::rename(target, &partial).map_err(write(target))?;
        }
        Ok(Self {
            target: target.to_owned(),
            partial,
            force: false,
            finished: false,
        })
    }

    /// Where files go until the folder is finished.
    pub(crate) fn path(&self) -> &Path {
        &self.partial
    }

    /// Creates a folder inside.
    pub(crate) fn subfolder(&self, name: &str) -> Result<PathBuf> {
        let path = self.partial.join(name);
        std::fs::create_dir_all(&path).map_err(write(&path))?;
        Ok(path)
    }

    /// Moves everything but the checkpoint into a folder inside. The checkpoint stays until another one replaces it:
    /// killed in between, the run goes on from there after [`Folder::take_back`].
    pub(crate) fn put_aside(&self, name: &str) -> Result<()> {
        let into = self.partial.join(name);
        let all: Vec<_> = std::fs::read_dir(&self.partial)
            .and_then(Iterator::collect::<std::io::Result<_>>)
            .map_err(write(&self.partial))?;
        std::fs::create_dir(&into).map_err(write(&into))?;
        for entry in all.iter().filter(|e| e.file_name() != checkpoint::NAME) {
            let to = into.join(entry.file_name());
            std::fs::rename(entry.path(), &to).map_err(write(&to))?;
        }
        Ok(())
    }

    /// Undoes [`Folder::put_aside`], whatever it left undone and whatever came after it.
    pub(crate) fn take_back(&self, name: &str) -> Result<()> {
        let from = self.partial.join(name);
        if !from.exists() {
            return Ok(());
        }
        let entries = |folder: &Path| -> Result<Vec<std::fs::DirEntry>> {
            std::fs::read_dir(folder)
                .and_then(Iterator::collect)
                .map_err(write(folder))
        };
        for entry in entries(&from)? {
            let to = self.partial.join(entry.file_name());
            // What came after the waking is made anew.
            let removed = match (to.is_dir(), to.exists()) {
                (true, _) => std::fs::remove_dir_all(&to),
                (_, true) => std::fs::remove_file(&to),
                _ => Ok(()),
            };
            removed.map_err(write(&to))?;
            std::fs::rename(entry.path(), &to).map_err(write(&to))?;
        }
        std::fs::remove_dir(&from).map_err(write(&from))
    }

    /// Moves the folder to its target.
    pub(crate) fn finish(mut self) -> Result<PathBuf> {
        // Someone may have made it in the meantime.
        refuse_existing(&self.target, self.force)?;
        let old = self.partial.with_extension("old");
        let replace = self.target.exists();
        if replace {
            std::fs::rename(&self.target, &old).map_err(write(&self.target))?;
        }
        std::fs::rename(&self.partial, &self.target).map_err(write(&self.target))?;
        self.finished = true;
        if replace {
            std::fs::remove_dir_all(&old).map_err(write(&old))?;
        }
        Ok(self.target.clone())
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        if !self.finished && !self.partial.join(checkpoint::NAME).exists() {
            // Nothing better can be done about a failure here than to leave the folder behind.
            let _ = std::fs::remove_dir_all(&self.partial);
        }
    }
}

/// The folder of a run that writes checkpoints, until it ends.
fn unfinished(target: &Path) -> Option<PathBuf> {
    let name = target.file_name()?.to_string_lossy();
    Some(target.with_file_name(format!("{name}.unfinished")))
}

/// Refuses an existing target, or a run that could be resumed, unless it may be replaced.
pub(crate) fn check_free(target: &Path, force: bool) -> Result<()> {
    refuse_existing(target, force)?;
    match unfinished(target) {
        Some(left) if !force && left.join(checkpoint::NAME).exists() => Err(Error::Unfinished {
            unfinished: left,
            target: target.to_owned(),
        }),
        _ => Ok(()),
    }
}

fn refuse_existing(target: &Path, force: bool) -> Result<()> {
    if !target.exists() || (force && target.is_dir()) {
        return Ok(());
    }
    if force {
        let rule = "is a file, which --force does not replace; choose another folder";
        return Err(crate::error::value("--out", target.display(), rule));
    }
    Err(Error::Exists {
        path: target.to_owned(),
    })
}
