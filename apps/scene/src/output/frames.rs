//! Frames: files with the state of all models and mediators at one instant.

use super::Fingerprint;
use super::fields;
use super::mark::FileList;
use super::painter::{Painter, Seen, vectors};
use super::pieces::Piece;
use super::writer::{Array, Entry, Picture, WRITERS, Writer};
use crate::error::{Error, Result, core, write};
use crate::ranks::Ranks;
use crate::setup::{Grid, ModelInfo, RigidPicture};
use crate::spec::OutputField;
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::core::{Coupled, Subdomain};
use std::collections::HashSet;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// Writes frames, and their index at the end.
#[derive(Debug)]
pub struct Frames {
    format: &'static dyn Writer,
    /// `None` on a rank that writes nothing.
    folder: Option<PathBuf>,
    /// All ranks, if each writes its part of partitioned models.
    ranks: Option<Ranks>,
    fields: Vec<OutputField>,
    models: Vec<Painter>,
    mediators: Vec<Grid>,
    rigid: Vec<RigidPicture>,
    entries: Vec<Entry>,
    /// Files that this process has written, by their paths in the folder of the results.
    written: FileList,
}

/// Everything that frames show.
#[derive(Debug)]
pub struct Pictures {
    /// Models.
    pub models: Vec<ModelInfo>,
    /// Mediators.
    pub mediators: Vec<Grid>,
    /// Rigid bodies.
    pub rigid: Vec<RigidPicture>,
}

/// Stem of the files of a partitioned model, and its arrays of points and of cells without values.
type PieceArrays = (String, [Vec<Array<'static>>; 2]);

/// Files that a rank has written of one instant.
#[derive(Debug)]
struct Written {
    /// Entries of models.
    models: Vec<(Entry, Option<PieceArrays>)>,
    /// Paths of the files of this rank.
    files: Vec<PathBuf>,
    sums: FileList,
    /// First error.
    failed: Result<()>,
}

impl Frames {
    /// Prepares frames in a folder.
    pub fn new(
        folder: Option<PathBuf>,
        fields: &[OutputField],
        run: &Coupled<f64>,
        pictures: Pictures,
    ) -> Self {
        Self::with_pieces(folder, fields, run, pictures, Vec::new())
    }

    /// Prepares frames of which every rank writes its part of partitioned models, into a folder that all
    /// ranks see. Collective.
    ///
    /// # Errors
    /// Failures of communication.
    pub(crate) fn in_pieces(
        folder: PathBuf,
        fields: &[OutputField],
        run: &Coupled<f64>,
        mut pictures: Pictures,
        ranks: &Ranks,
    ) -> Result<Self> {
        let density = fields.contains(&OutputField::EnergyDensity);
        let models = pictures.models.iter_mut().zip(run.subdomains());
        let pieces = models.map(|(info, s)| {
            let gradients = density && !fields::energy_from_bonds(fields, s);
            Piece::cut(info, s, gradients)
        });
        let pieces = pieces.collect::<Result<Vec<_>>>()?;
        let mut out = Self::with_pieces(Some(folder), fields, run, pictures, pieces);
        out.ranks = Some(ranks.clone());
        Ok(out)
    }

    fn with_pieces(
        folder: Option<PathBuf>,
        fields: &[OutputField],
        run: &Coupled<f64>,
        pictures: Pictures,
        pieces: Vec<Option<Piece>>,
    ) -> Self {
        let pieces = pieces.into_iter().chain(std::iter::repeat_with(|| None));
        let models = pictures.models.into_iter().zip(run.subdomains()).zip(pieces);
        Self {
            format: WRITERS[0],
            folder,
            ranks: None,
            fields: fields.to_vec(),
            models: models
                .map(|((info, s), piece)| Painter::new(fields, info, s, piece))
                .collect(),
            mediators: pictures.mediators,
            rigid: pictures.rigid,
            entries: Vec::new(),
            written: FileList::new(),
        }
    }

    /// Chooses a file format instead of VTU.
    pub(crate) fn with_format(self, format: &'static dyn Writer) -> Self {
        Self { format, ..self }
    }

    /// Shows another mediator of interface `k` from now on.
    pub(crate) fn set_mediator(&mut self, k: usize, grid: Grid) {
        self.mediators[k] = grid;
    }

    /// Returns whether this rank writes the index and the models that are not partitioned.
    fn leads(&self) -> bool {
        self.folder.is_some() && self.ranks.as_ref().is_none_or(Ranks::leads)
    }

    /// Files that this process has written, by their paths in the folder of the results.
    pub(crate) fn written(&self) -> &FileList {
        &self.written
    }

    /// Entries of the files written so far.
    pub fn entries(&self) -> &[Entry] {
        &self.entries
    }

    /// Continues after the files of `entries`; removes frames that are not among them.
    pub fn resume(&mut self, entries: Vec<Entry>) -> Result<()> {
        // One rank cleans the folder, so that no two remove the same file.
        let Some(folder) = self.folder.as_ref().filter(|_| self.leads()) else {
            return Ok(());
        };
        let listed: HashSet<_> = entries
            .iter()
            .filter_map(|e| Path::new(&e.file).file_name()?.to_str())
            .collect();
        for file in std::fs::read_dir(folder).map_err(write(folder))?.flatten() {
            let frame = self.listed_name(&file.file_name());
            if frame.is_some_and(|f| !listed.contains(f.as_str())) {
                std::fs::remove_file(file.path()).map_err(write(&file.path()))?;
            }
        }
        self.entries = entries;
        Ok(())
    }

    /// Returns the name under which the index lists a frame, given the name of its file or of a rank's part.
    /// Frames are named `MODEL_STEP.vtu`, parts `MODEL_STEP_RANK.vtu` (listed as `MODEL_STEP.pvtu`).
    fn listed_name(&self, name: &OsStr) -> Option<String> {
        let (stem, ending) = name.to_str()?.rsplit_once('.')?;
        let [whole, pieces] = self.format.endings();
        let is_number = |s: &str| !s.is_empty() && s.bytes().all(|b| b.is_ascii_digit());
        let is_frame = |stem: &str| {
            let step = stem.rsplit_once('_').map(|(_, step)| step);
            // Steps have eight digits or more, ranks fewer as a rule: this tells `MODEL_STEP` from
            // `MODEL_STEP_RANK`.
            step.is_some_and(|s| s.len() >= 8 && is_number(s))
        };
        if ending != whole && ending != pieces {
            return None;
        }
        if is_frame(stem) {
            return Some(format!("{stem}.{ending}"));
        }
        let (stem, rank) = stem.rsplit_once('_')?;
        (ending == whole && is_number(rank) && is_frame(stem)).then(|| format!("{stem}.{pieces}"))
    }

    /// Number of instants written.
    pub fn count(&self) -> usize {
        self.entries.iter().filter(|e| e.part == 0).count()
    }

    /// Bytes of one frame, without headers.
    pub fn bytes_per_frame(&self) -> usize {
        // Per point position and multiplier, per cell a 4-byte offset and a 1-byte type.
        let mediator = |v: &Grid| 36 * v.points.len() + 4 * v.connectivity.len() + 5 * v.cells();
        let models = self.models.iter().map(|m| m.bytes(&self.fields));
        models.sum::<usize>() + self.mediators.iter().map(mediator).sum::<usize>()
    }

    /// Returns a model in its current state, as [`Self::write`] writes it; `None` beyond the last model. Of a
    /// partitioned model rank 0 gets the whole and other ranks `None`, unless each rank shows its own part.
    /// Collective.
    ///
    /// # Errors
    /// Values that are not finite; stresses that a model cannot recover.
    pub fn picture<'a>(&'a self, run: &'a Coupled<f64>, part: usize) -> Result<Option<Picture<'a>>> {
        let (Some(painter), Some(s)) = (self.models.get(part), run.subdomains().get(part)) else {
            return Ok(None);
        };
        check_state(run, s)?;
        let piece = painter.piece.as_ref();
        let Some(seen) = Seen::gather(s, piece)? else {
            // These gather collectively: other ranks must call them in the same order as rank 0 below.
            fields::contacts(&self.fields, run, part, None)?;
            let mut survey = fields::survey(&self.fields, s)?;
            fields::recovered(&self.fields, s, survey.as_mut(), None)?;
            fields::energy_densities(&self.fields, s, survey.as_mut(), None)?;
            fields::bonds(&self.fields, s, survey, 0, None)?;
            return Ok(None);
        };
        // First, since it needs twice its memory for a moment.
        let contacts = fields::contacts(&self.fields, run, part, piece)?;
        let (mut points, cells) = painter.arrays(&self.fields, s, seen)?;
        points.extend(contacts);
        Ok(Some(Picture {
            name: s.model().name().to_owned(),
            grid: &painter.grid,
            points,
            cells,
        }))
    }

    /// Writes the current state.
    pub fn write(&mut self, run: &Coupled<f64>) -> Result<()> {
        let mut written = Written {
            models: Vec::new(),
            files: Vec::new(),
            sums: FileList::new(),
            failed: Ok(()),
        };
        let shown = self.write_models(run, &mut written);
        // Rank 0 lists the parts only after all ranks have written them. If one fails, no file of this
        // instant stays.
        let failed = written.failed;
        let done = shown.and_then(|()| match &self.ranks {
            Some(ranks) => ranks.together(failed),
            None => failed,
        });
        if done.is_err() {
            written.files.iter().for_each(|p| {
                let _ = std::fs::remove_file(p);
            });
        }
        done?;
        self.written.append(&mut written.sums);
        let Some(folder) = self.folder.clone().filter(|_| self.leads()) else {
            return Ok(());
        };
        for (entry, arrays) in written.models {
            if let (Some((name, arrays)), Some(ranks)) = (arrays, &self.ranks) {
                let pieces: Vec<String> = (0..ranks.count()).map(|r| self.piece_file(&name, r)).collect();
                pieces
                    .iter()
                    .enumerate()
                    .try_for_each(|(r, p)| check_visible(&folder.join(p), r))?;
                let path = folder.join(format!("{name}.{}", self.format.endings()[1]));
                self.format.write_pieces(&path, &arrays, &pieces)?;
            }
            self.entries.push(entry);
        }
        self.write_rigid(run, &folder)?;
        self.write_multipliers(run, &folder)
    }

    fn write_models(&self, run: &Coupled<f64>, to: &mut Written) -> Result<()> {
        for (part, s) in run.subdomains().iter().enumerate() {
            if !self.leads() && !s.owned().is_part() {
                check_state(run, s)?;
            } else if let Some(picture) = self.picture(run, part)? {
                self.write_model(run, part, picture, to);
            }
        }
        Ok(())
    }

    /// Writes a model as this rank shows it, unless an earlier write of this instant failed.
    fn write_model(&self, run: &Coupled<f64>, part: usize, p: Picture<'_>, to: &mut Written) {
        let (Some(folder), Ok(())) = (&self.folder, &to.failed) else {
            return;
        };
        let name = format!("{}_{:08}", p.name, run.steps());
        let piece = self.models[part].piece.as_ref();
        let [whole, pieces] = self.format.endings();
        let file = match (piece, &self.ranks) {
            (Some(_), Some(ranks)) => self.piece_file(&name, ranks.rank()),
            _ => format!("{name}.{whole}"),
        };
        let path = folder.join(&file);
        // Kept and not returned: the other ranks wait in the collective calls that follow.
        to.failed = self.format.write_grid(&path, &p, piece).map(|fingerprint| {
            to.sums
                .insert(Path::new(self.format.name()).join(&file), fingerprint);
        });
        // A file that failed is listed as well, so that its beginning is removed.
        to.files.push(path);
        let ending = if piece.is_some() { pieces } else { whole };
        let entry = self.entry(run, part, &p.name, format!("{name}.{ending}"));
        let empty = |list: Vec<Array<'_>>| list.into_iter().map(Array::empty).collect();
        let arrays = piece.map(|_| (name, [empty(p.points), empty(p.cells)]));
        to.models.push((entry, arrays));
    }

    fn write_multipliers(&mut self, run: &Coupled<f64>, folder: &Path) -> Result<()> {
        if !self.fields.contains(&OutputField::Multipliers) {
            return Ok(());
        }
        for (k, (grid, i)) in self.mediators.iter().zip(run.interfaces()).enumerate() {
            let name = &i.report().name;
            check_finite(run, name, i.multipliers())?;
            let lambda = Array {
                name: "multiplier".into(),
                components: 3,
                derived: true,
                values: vectors(i.multipliers().into(), i.components(), grid.points.len()),
            };
            let picture = Picture {
                name: format!("mediator-{name}"),
                grid,
                points: vec![lambda],
                cells: Vec::new(),
            };
            let place = (self.models.len() + k, picture.name.as_str());
            let (entry, fingerprint) = self.write_whole(run, folder, place, &picture)?;
            self.written.insert(PathBuf::from(&entry.file), fingerprint);
            self.entries.push(entry);
        }
        Ok(())
    }

    /// Writes rigid bodies at rest, with the displacement and velocity of every point.
    fn write_rigid(&mut self, run: &Coupled<f64>, folder: &Path) -> Result<()> {
        for (k, p) in self.rigid.iter().enumerate() {
            let mut effects = run.subdomains()[p.model].effects();
            let Some(now) = effects.find(|e| e.name() == p.name).and_then(|e| e.rigid()) else {
                continue;
            };
            let array = |name: &str, value: &dyn Fn(&Point3<f64>) -> Vector3<f64>| Array {
                name: name.into(),
                components: 3,
                derived: false,
                values: p.grid.points.iter().flat_map(|x| value(x).data.0[0]).collect(),
            };
            let arrays = vec![
                array("displacement [m]", &|_| now.displacement),
                array("velocity [m/s]", &|x| {
                    now.velocity + now.spin.cross(&(x - p.centre))
                }),
            ];
            let model = run.subdomains()[p.model].model().name();
            let name = format!("rigid-{}-{model}", p.name);
            // Rigid bodies may have any name, files may not.
            let plain = |c: char| {
                if c.is_ascii_alphanumeric() || "-_".contains(c) {
                    c
                } else {
                    '-'
                }
            };
            let stem = format!("{}-{k}", name.chars().map(plain).collect::<String>());
            let part = self.models.len() + self.mediators.len() + k;
            let picture = Picture {
                name,
                grid: &p.grid,
                points: arrays,
                cells: Vec::new(),
            };
            let (entry, fingerprint) = self.write_whole(run, folder, (part, &stem), &picture)?;
            self.written.insert(PathBuf::from(&entry.file), fingerprint);
            self.entries.push(entry);
        }
        Ok(())
    }

    /// Writes a grid that is not partitioned, with number `part` in the index and `stem` in the name of the
    /// file.
    fn write_whole(
        &self,
        run: &Coupled<f64>,
        folder: &Path,
        (part, stem): (usize, &str),
        picture: &Picture<'_>,
    ) -> Result<(Entry, Fingerprint)> {
        let file = format!("{stem}_{:08}.{}", run.steps(), self.format.endings()[0]);
        let fingerprint = self.format.write_grid(&folder.join(&file), picture, None)?;
        Ok((self.entry(run, part, &picture.name, file), fingerprint))
    }

    fn entry(&self, run: &Coupled<f64>, part: usize, name: &str, file: String) -> Entry {
        Entry {
            time: run.time(),
            part,
            name: name.to_owned(),
            file: format!("{}/{file}", self.format.name()),
        }
    }

    /// File name of a rank's part.
    fn piece_file(&self, name: &str, rank: usize) -> String {
        format!("{name}_{rank}.{}", self.format.endings()[0])
    }

    /// Writes the index into the folder of the results.
    pub fn finish(&self, folder: &Path) -> Result<()> {
        let path = folder.join(self.format.indices()[0]);
        self.format.write_index(&path, &self.entries)
    }
}

/// Refuses a part that its rank has written where rank 0 does not see it.
fn check_visible(path: &Path, rank: usize) -> Result<()> {
    if path.exists() {
        return Ok(());
    }
    Err(Error::System {
        what: "output.pieces",
        message: format!(
            "rank {rank} has written '{}', and rank 0 does not see it: give all ranks an --out on a file system that they share, or set \
             output.pieces = false",
            path.display()
        ),
    })
}

/// Refuses displacements and velocities that are not finite. Collective: all ranks fail if one does.
fn check_state(run: &Coupled<f64>, s: &Subdomain<f64>) -> Result<()> {
    let state = s.state();
    let finite = state.q.iter().chain(&state.v).all(|x| x.is_finite());
    // As a number, so that one maximum over the ranks decides for all of them.
    let fault = f64::from(u8::from(!finite));
    let owned = s.owned();
    let worst = owned.largest(fault);
    owned.check_communication().map_err(core("ranks"))?;
    // A non-finite value on any rank makes `worst` 1, and so the checked number infinite.
    check_finite(run, s.model().name(), &[1.0 / (1.0 - worst)])
}

fn check_finite(run: &Coupled<f64>, name: &str, values: &[f64]) -> Result<()> {
    if values.iter().all(|v| v.is_finite()) {
        return Ok(());
    }
    Err(Error::NotFinite {
        what: format!("a value of '{name}'"),
        time: run.time(),
    })
}
