//! The mark of result folders. Nothing that the program did not write is removed or replaced: a folder is
//! removed file by file, following the list in its mark.
//!
//! ```text
//! Results of arlequin, ...            head
//! 1234 8f3a02c1 probes.csv            length [bytes], CRC-32 and path of every file, once the run has ended
//! end
//! ```
//!
//! During a run there is no list. Then the names that a run uses decide, and a lock shows that the run goes
//! on.

use super::writer::WRITERS;
use super::{Fingerprint, fingerprint};
use crate::error::{Error, Result, write};
use std::collections::BTreeMap;
use std::fs::{File, TryLockError};
use std::io::{Seek as _, Write as _};
use std::path::{Path, PathBuf};

/// Name of the mark's file.
pub const NAME: &str = ".arlequin-results";
/// Name of the checkpoint file in a folder.
pub(crate) const CHECKPOINT: &str = "checkpoint.bin";
const HEAD: &str = "Results of arlequin. A run with --force replaces this folder as long as it holds nothing but the \
                    files listed here, unchanged.\n";
/// Last line of a complete list.
const END: &str = "end\n";
/// Type of a directory entry.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    File,
    Folder,
    /// A link, a pipe or a device; no run creates these.
    Other,
}

/// Files that the mark lists.
pub(crate) type FileList = BTreeMap<PathBuf, Fingerprint>;

/// Returns whether a file still has the bytes that the run wrote. False for a file that cannot be read.
fn is_unchanged(list: &FileList, folder: &Path, name: &Path) -> bool {
    let path = folder.join(name);
    let long = std::fs::metadata(&path).map(|m| m.len()).ok();
    // A different length decides without reading the file.
    let listed = list.get(name).filter(|l| Some(l.0) == long);
    listed.is_some_and(|l| fingerprint(&path).is_ok_and(|f| f == *l))
}

/// Files of the tables of probes, energy and effects.
pub(crate) const TABLES: [&str; 3] = ["probes.csv", "energy.csv", "effects.csv"];
/// File of the table of broken bonds.
pub(crate) const BREAKS: &str = "breaks.csv";
/// File of the table of fragments.
pub(crate) const FRAGMENTS: &str = "fragments.csv";
/// File of the table of load steps at rest.
pub(crate) const LOAD_STEPS: &str = "static.csv";
/// File of the table of changes of a zone that follows.
pub(crate) const ZONES: &str = "zones.csv";
/// File of the summary of a run.
pub(crate) const SUMMARY: &str = "summary.json";

/// Files of a run at the top level.
const FILES: [&str; 11] = [
    NAME,
    TABLES[0],
    TABLES[1],
    TABLES[2],
    BREAKS,
    FRAGMENTS,
    LOAD_STEPS,
    ZONES,
    SUMMARY,
    CHECKPOINT,
    "checkpoint.bin.tmp",
];
/// Files that a sweep or `arlequin view` adds to results later.
const ADDED: [&str; 4] = ["member.json", ".member.json", "predicted.json", "view.html"];
/// Subfolder and ending of plots.
const PLOTS: (&str, &str) = ("plots", "svg");
/// Prefixes of tables that are named after a model or a curve.
const NAMED: [&str; 2] = ["fracture-", "curve-"];

/// A marked and locked folder in which this process writes.
#[derive(Debug)]
pub struct Mark(File);

impl Mark {
    /// Marks a folder and locks it; `None` if another process writes there.
    pub fn set(folder: &Path) -> Result<Option<Self>> {
        let path = folder.join(NAME);
        // Opening must not truncate: the file may be the mark of a run that goes on.
        let open = File::options()
            .write(true)
            .create(true)
            .truncate(false)
            .open(&path);
        let mut file = open.map_err(write(&path))?;
        match file.try_lock() {
            Err(TryLockError::WouldBlock) => return Ok(None),
            // Some file systems have no locks; runs there are not protected from each other.
            Err(TryLockError::Error(_)) | Ok(()) => {}
        }
        file.set_len(0)
            .and_then(|()| file.write_all(HEAD.as_bytes()))
            .map_err(write(&path))?;
        Ok(Some(Self(file)))
    }

    /// Lists the files that the run wrote, of which it has `known` some. From then on exactly these files,
    /// unchanged, may be replaced.
    pub(crate) fn seal(&mut self, folder: &Path, known: &FileList) -> Result<()> {
        let mut text = HEAD.to_owned();
        for (name, kind) in entries(folder)? {
            if kind == Kind::File && is_ours(&name) && name != Path::new(NAME) {
                let (length, sum) = match known.get(&name) {
                    Some(fingerprint) => *fingerprint,
                    None => fingerprint(&folder.join(&name))?,
                };
                text += &format!("{length} {sum:08x} {}\n", name.display());
            }
        }
        text += END;
        let path = folder.join(NAME);
        let put = |file: &mut File| {
            file.set_len(0)?;
            file.rewind()?;
            file.write_all(text.as_bytes())
        };
        put(&mut self.0).map_err(write(&path))
    }
}

/// Returns whether another process writes into a marked folder.
pub fn is_busy(folder: &Path) -> bool {
    let file = File::options().write(true).open(folder.join(NAME));
    file.is_ok_and(|f| matches!(f.try_lock(), Err(TryLockError::WouldBlock)))
}

/// Returns whether the run that made a marked folder wrote all of its files.
pub fn is_sealed(folder: &Path) -> bool {
    read_list(folder).is_some_and(|l| !l.is_empty())
}

/// Returns the reason why a folder must not be removed; `None` if it holds only what a run wrote.
pub fn objection(folder: &Path) -> Result<Option<String>> {
    let contents = entries(folder)?;
    if contents.is_empty() {
        return Ok(None);
    }
    let Some(list) = read_list(folder) else {
        return Ok(Some(format!(
            "does not bear the mark of results ('{NAME}'), so no flag replaces it; choose another --out, or remove it \
             yourself"
        )));
    };
    let foreign = contents.iter().find(|(name, kind)| {
        let added = ADDED.iter().any(|a| name.as_path() == Path::new(a));
        let known = match kind {
            Kind::Other => false,
            Kind::Folder => true,
            Kind::File if list.is_empty() || added || name.as_path() == Path::new(NAME) => true,
            Kind::File => is_unchanged(&list, folder, name),
        };
        !known || !is_ours(name)
    });
    Ok(foreign.map(|(name, _)| {
        format!(
            "holds '{}', which no run wrote or which was changed since, so no flag replaces it; move that away, or \
             choose another --out",
            name.display()
        )
    }))
}

/// Removes the files that a run wrote, the mark last, and the folder if it is empty then.
pub fn remove(folder: &Path) -> Result<()> {
    let list = read_list(folder).unwrap_or_default();
    let contents = entries(folder)?;
    // Paths are sorted, so that reverse order removes the contents of a folder before the folder.
    for (name, kind) in contents.iter().rev().filter(|(name, _)| is_ours(name)) {
        let path = folder.join(name);
        let removable = match kind {
            _ if name.as_path() == Path::new(NAME) => continue,
            Kind::Other => false,
            Kind::File => {
                list.is_empty()
                    || ADDED.iter().any(|a| name.ends_with(a))
                    || is_unchanged(&list, folder, name)
            }
            // Fails for a folder that is not empty, which then stays.
            Kind::Folder => {
                let _ = std::fs::remove_dir(&path);
                continue;
            }
        };
        if removable {
            std::fs::remove_file(&path).map_err(write(&path))?;
        }
    }
    let mark = folder.join(NAME);
    if entries(folder)?.keys().all(|name| name == Path::new(NAME)) {
        if mark.exists() {
            std::fs::remove_file(&mark).map_err(write(&mark))?;
        }
        std::fs::remove_dir(folder).map_err(write(folder))?;
    }
    Ok(())
}

/// Claims a folder for many runs or plots, into which files are written again and again. Refuses one that is
/// neither new nor empty nor marked.
pub fn claim(flag: &str, folder: &Path) -> Result<()> {
    if folder.exists() && !folder.is_dir() {
        let rule = "is a file; choose another folder";
        return Err(crate::error::value(flag, folder.display(), rule));
    }
    std::fs::create_dir_all(folder).map_err(write(folder))?;
    let path = folder.join(NAME);
    if path.exists() {
        return Ok(());
    }
    let mut inside = std::fs::read_dir(folder).map_err(write(folder))?;
    if let Some(Ok(entry)) = inside.next() {
        let rule = format!(
            "holds '{}' and does not bear the mark of results ('{NAME}'); choose a folder that is new or empty",
            entry.file_name().display()
        );
        return Err(crate::error::value(flag, folder.display(), &rule));
    }
    std::fs::write(&path, HEAD).map_err(write(&path))
}

/// Refuses to overwrite a page whose first line differs from that of `head`.
pub fn generated(flag: &str, page: &Path, head: &str) -> Result<()> {
    let Ok(text) = std::fs::read(page) else {
        return Ok(());
    };
    let first = head.lines().next().unwrap_or_default();
    if text.is_empty() || text.starts_with(first.as_bytes()) {
        return Ok(());
    }
    let rule =
        format!("exists and does not begin with '{first}' as what would replace it; choose another place");
    Err(crate::error::value(flag, page.display(), &rule))
}

/// Returns whether a run may have given this name to something in its folder.
pub fn is_ours(name: &Path) -> bool {
    let parts: Option<Vec<&str>> = name.iter().map(|p| p.to_str()).collect();
    match parts.as_deref() {
        None => false,
        Some([]) => true,
        Some([file]) => {
            FILES.contains(file)
                || ADDED.contains(file)
                || *file == PLOTS.0
                || WRITERS
                    .iter()
                    .any(|w| w.name() == *file || w.indices().contains(file))
                || NAMED
                    .iter()
                    .any(|n| file.starts_with(n) && file.ends_with(".csv"))
        }
        Some([folder, file]) => {
            let ending = file.rsplit_once('.').map_or("", |(_, ending)| ending);
            let writer = WRITERS.iter().find(|w| w.name() == *folder);
            (*folder, ending) == PLOTS || writer.is_some_and(|w| w.endings().contains(&ending))
        }
        Some(_) => false,
    }
}

/// All entries below a folder. Links are not followed.
fn entries(folder: &Path) -> Result<BTreeMap<PathBuf, Kind>> {
    let read = |path: &Path| {
        let path = path.to_owned();
        move |source| Error::Read { path, source }
    };
    let mut out = BTreeMap::new();
    let mut open = vec![PathBuf::new()];
    while let Some(below) = open.pop() {
        let path = folder.join(&below);
        for entry in std::fs::read_dir(&path).map_err(read(&path))? {
            let entry = entry.map_err(read(&path))?;
            let file_type = entry.file_type().map_err(read(&entry.path()))?;
            let name = below.join(entry.file_name());
            let kind = match (file_type.is_dir(), file_type.is_file()) {
                (true, _) => Kind::Folder,
                (_, true) => Kind::File,
                _ => Kind::Other,
            };
            // A run writes no deeper folders, so the name of this one already marks its contents as foreign.
            if kind == Kind::Folder && is_ours(&name) {
                open.push(name.clone());
            }
            out.insert(name, kind);
        }
    }
    Ok(out)
}

/// Returns the list in the mark, empty during a run; `None` without a mark.
fn read_list(folder: &Path) -> Option<FileList> {
    let path = folder.join(NAME);
    if !std::fs::symlink_metadata(&path).is_ok_and(|m| m.is_file()) {
        return None;
    }
    let text = std::fs::read_to_string(&path).ok()?;
    if HEAD.starts_with(&text) {
        return Some(BTreeMap::new());
    }
    // The program was killed while it wrote the list: treated as no list yet.
    let Some(list) = text.strip_prefix(HEAD)?.strip_suffix(END) else {
        return Some(BTreeMap::new());
    };
    let line = |l: &str| {
        let mut parts = l.splitn(3, ' ');
        let length = parts.next()?.parse().ok()?;
        let sum = u32::from_str_radix(parts.next()?, 16).ok()?;
        Some((PathBuf::from(parts.next()?), (length, sum)))
    };
    list.lines().map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A frame that something else changed while the run went on is not what the run wrote.
    #[test]
    fn fingerprints_that_a_run_took_while_it_wrote_are_not_read_again() {
        let folder = std::env::temp_dir().join(format!("arlequin-mark-{}", std::process::id()));
        let name = Path::new("vtu").join("body_00000000.vtu");
        std::fs::create_dir_all(folder.join("vtu")).expect("a folder");
        let path = folder.join(&name);
        let wrote = crate::output::put_with(&path, |file| file.write_all(b"frame")).expect("written");
        assert_eq!(wrote, fingerprint(&path).expect("read"));
        let mut mark = Mark::set(&folder).expect("a mark").expect("no other process");
        let known = FileList::from([(name.clone(), wrote)]);
        mark.seal(&folder, &known).expect("sealed");
        assert_eq!(objection(&folder).expect("read"), None);
        std::fs::write(&path, b"other").expect("changed");
        mark.seal(&folder, &known).expect("sealed");
        let objection = objection(&folder).expect("read").expect("a reason");
        assert!(objection.contains("body_00000000.vtu"), "{objection}");
        drop(mark);
        std::fs::remove_dir_all(&folder).expect("removed");
    }
}
