//! The output folder appears at once or not at all.

use crate::error::{Error, Result, write};
use std::path::{Path, PathBuf};

/// A folder under construction beside its target; removed unless it is finished.
#[derive(Debug)]
pub(crate) struct Folder {
    target: PathBuf,
    partial: PathBuf,
    force: bool,
    finished: bool,
}

impl Folder {
    /// Begins a folder that will become `target`; an existing one is replaced only with `force`.
    pub(crate) fn begin(target: &Path, force: bool) -> Result<Self> {
        check_free(target, force)?;
        let name = target.file_name().map(|n| n.to_string_lossy().into_owned());
        let Some(name) = name else {
            return Err(crate::error::value(
                "--out",
                target.display(),
                "must name a folder to create",
            ));
        };
        let partial = target.with_file_name(format!(".{name}.partial-{}", std::process::id()));
        std::fs::create_dir_all(&partial).map_err(write(&partial))?;
        Ok(Self {
            target: target.to_owned(),
            partial,
            force,
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

    /// Moves the folder to its target.
    pub(crate) fn finish(mut self) -> Result<PathBuf> {
        // Someone may have made it in the meantime.
        check_free(&self.target, self.force)?;
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
        if !self.finished {
            // Nothing better can be done about a failure here than to leave the hidden folder behind.
            let _ = std::fs::remove_dir_all(&self.partial);
        }
    }
}

/// Refuses an existing target unless it may be replaced.
pub(crate) fn check_free(target: &Path, force: bool) -> Result<()> {
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
