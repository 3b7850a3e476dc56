//! The scene of a run with its files, as a checkpoint stores it and as ranks compare it.

use crate::error::{Error, Result};
use crate::output::fingerprint;
use crate::ranks::Ranks;
use crate::scene::{Scene, Source};
use arlequin::core::ranks::Communicator;
use arlequin::dem_beam::packing::pieces_of_pvtu;
use serde::{Deserialize, Serialize};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The scene a checkpoint belongs to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Origin {
    /// Scene file as given on the command line.
    pub path: PathBuf,
    /// Absolute folder of the scene file.
    pub folder: PathBuf,
    /// Text of the scene file.
    pub text: String,
    /// Assignments `PATH=VALUE` of the command line.
    pub set: Vec<String>,
    /// Files that the scene reads: name, length \[bytes\], CRC-32.
    pub(super) files: Vec<(PathBuf, u64, u32)>,
}

impl Origin {
    /// Describes a scene that is about to run and takes the fingerprints of its files.
    ///
    /// # Errors
    /// A folder or file that cannot be read.
    pub(crate) fn from_scene(scene: &Scene) -> Result<Self> {
        let folder = scene.folder();
        let folder = if folder.as_os_str().is_empty() {
            Path::new(".")
        } else {
            folder
        };
        let absolute = folder.canonicalize().map_err(|e| Error::Read {
            path: folder.to_owned(),
            source: e,
        })?;
        let mut files = scene.files();
        let pieces = files.iter().flat_map(|name| pieces(&absolute, name));
        // Pieces of a `.pvtu` file are read as well, so a change of one must be noticed.
        files.extend(pieces.collect::<Vec<_>>());
        let files = files
            .into_iter()
            .map(|name| {
                let (length, sum) = fingerprint(&absolute.join(&name))?;
                Ok((name, length, sum))
            })
            .collect::<Result<_>>()?;
        Ok(Self {
            path: scene.source().path.clone(),
            folder: absolute,
            text: scene.source().text.clone(),
            set: scene.changes().to_vec(),
            files,
        })
    }

    /// Reads the scene from the stored text.
    ///
    /// # Errors
    /// A file that has changed since the checkpoint was written.
    pub(crate) fn scene(&self) -> Result<Scene> {
        for (name, length, sum) in &self.files {
            let path = self.folder.join(name);
            if fingerprint(&path)? != (*length, *sum) {
                let reason =
                    "has changed since the checkpoint was written; restore it, or start the run anew";
                return Err(Error::Checkpoint {
                    path,
                    reason: reason.into(),
                });
            }
        }
        let source = Source {
            path: self.path.clone(),
            folder: self.folder.clone(),
            text: self.text.clone(),
        };
        Scene::from_source(source)?.assign(&self.set)
    }

    /// Hashes all that defines the scene, except the folder it is in.
    fn digest(&self, hasher: &mut DefaultHasher) {
        self.text.hash(hasher);
        self.set.hash(hasher);
        self.files.iter().for_each(|f| (f.1, f.2).hash(hasher));
        env!("CARGO_PKG_VERSION").hash(hasher);
    }
}

impl Scene {
    /// Runs the scene as one rank of several, all of which read the same scene: see [`crate::RankLine`]. Only
    /// rank 0 writes files and receives warnings. [`Observer::step`](crate::Observer::step) is called on
    /// every rank; one rank can end the steps of all. Collective.
    ///
    /// # Errors
    /// Scenes, or files that they name, that differ between ranks: on every rank.
    pub fn on_ranks(self, communicator: Arc<dyn Communicator>) -> Result<Self> {
        let ranks = Ranks::from_communicator(Some(communicator));
        if ranks.communicator().is_some() {
            // A rank that cannot read a file reports this; all ranks then stop.
            let origin = ranks.together(Origin::from_scene(&self))?;
            let mut hasher = DefaultHasher::new();
            origin.digest(&mut hasher);
            ranks.agree("the scene and the files that it names", hasher.finish())?;
        }
        Ok(self.with_ranks(ranks))
    }
}

/// Pieces that a `.pvtu` file of the scene names; empty for other files and for files that cannot be parsed
/// (the set-up reports these).
fn pieces(folder: &Path, name: &Path) -> Vec<PathBuf> {
    let read = || std::fs::read(folder.join(name)).ok();
    let parallel = name.extension().is_some_and(|e| e == "pvtu");
    let content = parallel.then(read).flatten();
    let named = content.and_then(|c| pieces_of_pvtu(&c).ok()).unwrap_or_default();
    named.into_iter().map(|p| name.with_file_name(p)).collect()
}
