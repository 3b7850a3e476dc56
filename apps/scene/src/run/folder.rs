//! Results in a folder: written when the steps have ended, or as far as possible when a run fails.

use super::checkpoint::{self, Checkpoint};
use super::origin::Origin;
use super::recorder::Recorder;
use super::results::{End, Observer, Recorded, Results};
use super::session::Session;
use super::summary::{self, Status};
use crate::error::{Error, Result, core};
use crate::output::summary::Summary;
use crate::output::{Folder, Place, curves, fragments, json, mark, put, tables};
use crate::scene::Scene;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// A folder for results, checked, with a note of the files that the scene reads.
#[derive(Debug)]
pub struct RunFolder {
    /// `None` except on rank 0, which has the folder.
    place: Option<Place>,
    /// Path of the files until the run has ended.
    unfinished: PathBuf,
    origin: Origin,
}

impl RunFolder {
    /// Prepares the folder `target`, by default `results/` and the name of the scene. `force` replaces
    /// earlier results.
    ///
    /// # Errors
    /// A folder that must not be replaced, one with a run that could be resumed, files of the scene that
    /// cannot be read.
    pub fn new(scene: &Scene, target: Option<&Path>, force: bool) -> Result<Self> {
        let stem = || scene.source().path.file_stem().unwrap_or_default().to_owned();
        let target = target.map_or_else(|| Path::new("results").join(stem()), Path::to_owned);
        let read = scene.files().into_iter().map(|f| scene.folder().join(f));
        let inputs: Vec<PathBuf> = std::iter::once(scene.source().path.clone()).chain(read).collect();
        let place = Place::new(&target, force, &inputs);
        let unfinished = Folder::unfinished(&target);
        let origin = Origin::from_scene(scene)?;
        let ranks = scene.ranks();
        let place = ranks.leads().then_some(place);
        // Only one rank sees the folder, and all of them must stop if it is refused.
        ranks.together(place.as_ref().map_or(Ok(()), Place::check))?;
        Ok(Self {
            place,
            unfinished,
            origin,
        })
    }
}

/// Folder of a run, and the origin of its scene.
#[derive(Debug)]
pub(crate) struct Keep {
    /// `None` except on rank 0.
    pub(super) folder: Option<Folder>,
    /// Path of the files until the run has ended.
    unfinished: PathBuf,
    origin: Origin,
}

impl Keep {
    pub(super) fn begin(folder: RunFolder) -> Result<Self> {
        Ok(Self {
            folder: folder.place.map(Folder::begin).transpose()?,
            unfinished: folder.unfinished,
            origin: folder.origin,
        })
    }

    pub(super) fn reopen(target: &Path, origin: Origin, leads: bool) -> Result<Self> {
        Ok(Self {
            folder: leads.then(|| Folder::reopen(target)).transpose()?,
            unfinished: Folder::unfinished(target),
            origin,
        })
    }

    /// Path of the frames in the subfolder `name`; it exists once rank 0 has created it.
    pub(super) fn frames(&self, name: &str) -> PathBuf {
        self.unfinished.join(name)
    }
}

impl Session<'_> {
    /// Makes the remaining steps and ends the run.
    pub(crate) fn complete(mut self, observer: &mut dyn Observer) -> Result<Results> {
        let end = match self.load_steps.take() {
            Some(steps) => self.settle(&steps, observer),
            None => self.advance(observer),
        };
        self.conclude(end, observer)
    }

    /// Writes a checkpoint if the run has a folder.
    pub(crate) fn save(&self) -> Result<()> {
        let Some(keep) = &self.keep else { return Ok(()) };
        let saved = self.checkpoint(keep.origin.clone())?;
        keep.folder.as_ref().map_or(Ok(()), |f| saved.write(f.path()))
    }

    fn checkpoint(&self, origin: Origin) -> Result<Checkpoint> {
        Ok(Checkpoint {
            version: env!("CARGO_PKG_VERSION").into(),
            origin,
            snapshot: self.run.snapshot().map_err(core("model"))?,
            records: self.recorder.records(),
            follow: self.follow.as_ref().map(|f| f.state.clone()),
        })
    }

    /// Restores the state of a checkpoint.
    pub(super) fn restore(&mut self, saved: Checkpoint) -> Result<()> {
        if let (Some(follow), Some(saved)) = (&mut self.follow, saved.follow) {
            follow.restore(saved, &mut self.run)?;
            self.recorder.show_mediator(follow.mediator.take());
        }
        let restored = self.run.restore(&saved.snapshot);
        restored.map_err(|e| Error::Checkpoint {
            path: self.folder().unwrap_or(Path::new("")).join(mark::CHECKPOINT),
            reason: format!("does not fit the run that its scene gives: {e}"),
        })?;
        self.recorder.resume(saved.records)?;
        self.resumed_at = Some(saved.snapshot.step);
        Ok(())
    }

    /// Returns whether a model of the run is partitioned.
    fn is_partitioned(&self) -> bool {
        self.run.subdomains().iter().any(|s| s.owned().is_part())
    }

    /// Returns the folder if this rank writes one.
    pub(super) fn writes(&self) -> Option<&Folder> {
        self.keep.as_ref()?.folder.as_ref()
    }

    fn folder(&self) -> Option<&Path> {
        Some(self.keep.as_ref()?.folder.as_ref()?.path())
    }

    /// Writes the results of the steps made, for any end of the run, and finishes the folder.
    pub(crate) fn conclude(mut self, end: Result<End>, observer: &mut dyn Observer) -> Result<Results> {
        let written = end.and_then(|end| {
            let mut remaining = None;
            // Before the results: a failure to write them then leaves a run that can be resumed.
            if end.can_resume() {
                self.save()?;
                if self.keep.is_none() {
                    remaining = Some(Box::new(self.checkpoint(Origin::from_scene(self.scene)?)?));
                }
            }
            Ok((end, remaining, self.finish(end, observer)?))
        });
        let (end, remaining, summary) = match written {
            Ok(done) => done,
            Err(e) => return Err(self.salvage(e, observer)),
        };
        let mut folder = None;
        if let Some(partial) = self.keep.and_then(|k| k.folder) {
            let place = partial.finish(false, &self.recorder.files())?;
            if end == End::Complete {
                // Only after the results are in place: a run killed in between would have neither.
                checkpoint::remove(&place)?;
            }
            folder = Some(place);
        }
        Ok(Results {
            recorded: recorded(self.recorder, self.scene, summary),
            run: self.run,
            breaks: self.breaks,
            end,
            planned: self.steps,
            folder,
            remaining,
        })
    }

    /// Writes every file that still can be written after a run failed, and returns the error with a note of
    /// it. A run without steps writes nothing.
    fn salvage(mut self, error: Error, observer: &mut dyn Observer) -> Error {
        let Some(keep) = self.keep.take().filter(|_| self.run.steps() > 0) else {
            return error;
        };
        // An error of one rank alone: the results of partitioned models need the other ranks, which still
        // make steps.
        if self.is_partitioned() && !error.is_everywhere() {
            return match keep.folder {
                Some(folder) => folder.keep(error),
                None => error,
            };
        }
        self.clock.enter(None);
        let summary = self.summary(Status::Failed(error.to_string()), 0.0);
        let Some(folder) = keep.folder else {
            return error;
        };
        let mut tries = self.files(&folder, observer);
        tries.push(write_summary(&folder, &summary));
        let lost: Vec<String> = tries
            .into_iter()
            .filter_map(|t| Some(t.err()?.to_string()))
            .collect();
        let mut what = format!("the {} steps before are kept", self.run.steps());
        if !lost.is_empty() {
            what += &format!(", but for what failed too ({})", lost.join("; "));
        }
        let path = folder.path().to_owned();
        match folder.finish(true, &self.recorder.files()) {
            Ok(place) => error.kept(what, &place),
            Err(e) => error.kept(format!("{what}; {e};"), &path),
        }
    }

    /// Gathers the results of the steps made, and writes them if the run has a folder.
    fn finish(&mut self, end: End, observer: &mut dyn Observer) -> Result<Summary> {
        let after = Instant::now();
        self.recorder.finish(&self.run)?;
        if let Some(folder) = self.writes() {
            self.files(folder, observer).into_iter().collect::<Result<()>>()?;
        }
        for w in summary::findings(&self.run, &self.without_contact) {
            self.recorder.warn(w);
        }
        let summary = self.summary(Status::Ended(end), after.elapsed().as_secs_f64());
        if let Some(folder) = self.writes() {
            write_summary(folder, &summary)?;
        }
        Ok(summary)
    }

    /// Writes everything but the summary. Tries every file, even if earlier ones fail.
    fn files(&self, folder: &Folder, observer: &mut dyn Observer) -> Vec<Result<()>> {
        let (path, r) = (folder.path(), &self.recorder);
        let mut tries = vec![
            tables::write_all(path, r.tables()),
            tables::load_steps(path, &r.load_steps),
            tables::conversions(
                path,
                self.follow.as_ref().map_or(&[][..], |f| &f.state.conversions),
            ),
            fragments::write(path, &r.fragments),
            tables::breaks(path, &self.run, &self.breaks),
            tables::all_breaks(path, &self.run, &self.breaks),
        ];
        tries.extend(r.frames.as_ref().map(|f| f.finish(path)));
        let spec = self.scene.spec();
        let curves = r.curves(spec);
        tries.push(curves::write(path, &curves));
        if spec.output.plots {
            let plots = folder.subfolder("plots");
            let title = spec.title.as_deref().unwrap_or_default();
            let drawn = plots.and_then(|p| {
                observer.plot(&p, title, r.tables())?;
                curves.iter().try_for_each(|c| observer.plot_curve(&p, title, c))
            });
            tries.push(drawn);
        }
        tries
    }
}

/// Returns the records after a run has ended.
fn recorded(recorder: Recorder, scene: &Scene, summary: Summary) -> Recorded {
    Recorded {
        curves: recorder.curves(scene.spec()),
        summary,
        probes: recorder.probes,
        energy: recorder.energy,
        effects: recorder.effects,
        fragments: recorder.fragments.rows,
    }
}

fn write_summary(folder: &Folder, summary: &Summary) -> Result<()> {
    put(
        &folder.path().join(mark::SUMMARY),
        &[json("writing summary.json", summary)?.as_bytes()],
    )
}
