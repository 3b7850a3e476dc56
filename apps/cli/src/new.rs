//! `arlequin new`: writes a commented scene that runs as it is.

use crate::error::{Result, key, write};
use crate::report;
use clap::ValueEnum;
use std::path::{Path, PathBuf};

/// Arguments of `arlequin new`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Folder to create, or a scene file (.toml) to write into an existing folder; nothing is ever
    /// replaced.
    place: PathBuf,
    /// Scene to begin with.
    #[arg(long, value_enum, default_value_t)]
    template: Template,
}

/// Scenes that `arlequin new` can write.
#[derive(Debug, Clone, Copy, Default, ValueEnum)]
enum Template {
    /// A pulse runs through a fine and a coarse mesh of a beam.
    #[default]
    Beam,
    /// A notched beam in bending: particles where it cracks, finite elements beside them.
    Bend,
    /// A ball strikes a block: particles under the impact, finite elements below.
    Impact,
    /// A plate with a hole, read from a Gmsh file: stress at the hole.
    Plate,
}

/// Name and text of a file. The scene is the first file of a template.
type File = (&'static str, &'static str);

impl Template {
    fn files(self) -> &'static [File] {
        match self {
            Self::Beam => &[("scene.toml", include_str!("../templates/beam.toml"))],
            Self::Bend => &[("scene.toml", include_str!("../templates/bend.toml"))],
            Self::Impact => &[("scene.toml", include_str!("../templates/impact.toml"))],
            Self::Plate => &[
                ("scene.toml", include_str!("../templates/plate.toml")),
                ("zone.toml", include_str!("../templates/plate-zone.toml")),
                ("plate.msh", include_str!("../templates/plate.msh")),
                ("plate.geo", include_str!("../templates/plate.geo")),
            ],
        }
    }
}

/// Writes the files of a template.
pub(crate) fn new(a: &Arguments) -> Result<()> {
    let is_file = a.place.extension().is_some_and(|e| e == "toml");
    let folder = match a.place.parent() {
        Some(parent) if is_file => parent.to_owned(),
        _ => a.place.clone(),
    };
    let mut files: Vec<(PathBuf, &str)> = Vec::new();
    for (name, text) in a.template.files() {
        let path = if is_file && *name == "scene.toml" {
            a.place.clone()
        } else {
            folder.join(name)
        };
        files.push((path, text));
    }
    // Unlike `exists`, this also finds links whose target is missing.
    if let Some((path, _)) = files.iter().find(|f| std::fs::symlink_metadata(&f.0).is_ok()) {
        let rule = "is there already, and is not replaced; name another folder or file";
        return Err(key(path.display().to_string(), rule));
    }
    if !folder.as_os_str().is_empty() {
        std::fs::create_dir_all(&folder).map_err(write(&folder))?;
    }
    for (path, text) in &files {
        std::fs::write(path, text).map_err(write(path))?;
        report::line(&format!("written    {}", path.display()));
    }
    let scene = files.first().map_or(Path::new(""), |f| &f.0).display();
    let results = folder.join("results");
    let results = results.display();
    report::line(&format!("next       arlequin run {scene} --out {results}"));
    report::line(&format!("           arlequin view {results}"));
    Ok(())
}
