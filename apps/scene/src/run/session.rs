//! A run in progress: its steps, their records, and the reasons to end.

use super::checkpoint::Checkpoint;
use super::crossing::Crossing;
use super::folder::Keep;
use super::follow::Follow;
use super::intrusion;
use super::recorder::{self, PhaseClock, Recorder};
use super::results::{End, Observer};
use crate::error::Result;
use crate::output::fragments::Fragments;
use crate::output::tables::{self, Live};
use crate::output::writer::writer;
use crate::output::{Frames, Pictures};
use crate::ranks::RankLine;
use crate::scene::Scene;
use crate::setup::packing::PackingLine;
use crate::setup::{Bounds, Built, Grid, LoadSteps, ModelInfo, ParticlesWithoutContact, PhaseTime};
use arlequin::core::{Coupled, Phase, Subdomain};
use arlequin::dem_beam::fracture::SharedLog;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::Instant;

/// A run with its recorders.
#[derive(Debug)]
pub(crate) struct Session<'a> {
    pub(super) scene: &'a Scene,
    pub(super) run: Coupled<f64>,
    pub(super) steps: usize,
    /// Load steps of a scene at rest.
    pub(super) load_steps: Option<LoadSteps>,
    pub(super) recorder: Recorder,
    live: Live,
    pub(super) clock: PhaseClock,
    pub(super) keep: Option<Keep>,
    pub(super) setup: f64,
    /// End of the set-up.
    pub(super) begin: Instant,
    pub(super) resumed_at: Option<usize>,
    pub(super) breaks: Vec<Option<SharedLog>>,
    /// The zone that goes where it is needed.
    pub(super) follow: Option<Follow>,
    pub(super) without_contact: ParticlesWithoutContact,
    /// Watch for particles inside bodies that they do not touch.
    pub(super) intrusions: intrusion::Watch,
    pub(super) packings: Vec<Option<PackingLine>>,
    bounds: Bounds,
    pub(super) phases: Vec<PhaseTime>,
    pub(super) holdings: Vec<RankLine>,
    /// Number of the coupled run's warnings that the observer has received.
    passed_warnings: usize,
}

/// Prepares the frames of a run; with `pieces`, each rank writes its part of the partitioned models.
fn frames_of(
    scene: &Scene,
    keep: &Keep,
    run: &Coupled<f64>,
    (models, pictures): (Vec<ModelInfo>, Pictures),
    pieces: bool,
) -> Result<Frames> {
    let settings = &scene.spec().output;
    let format = writer(settings)?;
    let folder = keep.folder.as_ref().map(|f| f.subfolder(format.name()));
    let folder = folder.transpose()?;
    let frames = if pieces {
        // The parts have grids of their own; this frees the whole ones.
        drop(models);
        let folder = folder.unwrap_or_else(|| keep.frames(format.name()));
        Frames::in_pieces(folder, &settings.fields, run, pictures, scene.ranks())?
    } else {
        let pictures = Pictures { models, ..pictures };
        Frames::new(folder, &settings.fields, run, pictures)
    };
    Ok(frames.with_format(format))
}

impl<'a> Session<'a> {
    /// Starts a run whose set-up took `setup` seconds: from its first state, which is recorded, or from a
    /// checkpoint.
    pub(crate) fn new(
        scene: &'a Scene,
        mut built: Built,
        keep: Option<Keep>,
        setup: f64,
        saved: Option<Checkpoint>,
    ) -> Result<Self> {
        let begin = Instant::now();
        let settings = &scene.spec().output;
        let ranks = scene.ranks();
        let in_parts = |s: &Subdomain<f64>| s.owned().is_part();
        let follow = Follow::new(&mut built)?;
        let pieces = settings.pieces && built.run.subdomains().iter().any(in_parts);
        let pictures = Pictures {
            models: match pieces && keep.is_some() {
                true => built.models.clone(),
                false => Vec::new(),
            },
            mediators: built.mediators,
            rigid: built.rigid,
        };
        let intrusions = intrusion::Watch::new(scene.spec(), &built.models, &built.run, ranks)?;
        // Only rank 0 shows the whole grid of a partitioned model; other ranks free the memory.
        if !ranks.leads() {
            let models = built.models.iter_mut().zip(built.run.subdomains());
            models.filter(|(_, s)| in_parts(s)).for_each(|(info, _)| {
                let corners = info.grid.corners;
                info.grid = Arc::new(Grid {
                    corners,
                    ..Grid::default()
                });
            });
        }
        let breaks: Vec<_> = built.models.iter().map(|d| d.breaks.clone()).collect();
        let fragments = Fragments::new(&built.run, &built.models)?;
        let packings = built.models.iter().map(|d| d.packing.clone()).collect();
        let models = built.models;
        let frames = keep
            .as_ref()
            .map(|keep| frames_of(scene, keep, &built.run, (models, pictures), pieces));
        let frames = frames.transpose()?;
        // A checkpoint has the first state. Its files need not agree with those that this number of ranks
        // would write.
        let recorded = saved.is_some() || built.load_steps.is_some();
        let mut out = Self {
            recorder: Recorder::new(
                &mut built.run,
                built.probes,
                frames,
                fragments,
                [settings.probe_every, built.frame_every],
                built.warnings,
                recorded,
            )?,
            live: Live::new(),
            scene,
            run: built.run,
            steps: built.steps,
            load_steps: built.load_steps,
            clock: PhaseClock::new(),
            keep,
            setup,
            begin,
            resumed_at: None,
            follow,
            breaks,
            without_contact: built.without_contact,
            intrusions,
            packings,
            bounds: built.bounds,
            phases: built.phases,
            holdings: built.holdings,
            passed_warnings: 0,
        };
        if let Some(saved) = saved {
            out.restore(saved)?;
            out.passed_warnings = out.run.warnings().len();
        }
        Ok(out)
    }

    /// Passes on a warning the first time that it occurs and keeps it for the summary.
    fn warn(&mut self, text: String, observer: &mut dyn Observer) {
        if self.recorder.warn(text.clone()) && self.scene.ranks().leads() {
            observer.warning(&text);
        }
    }

    /// Passes on the new warnings of the coupled run. `summary::findings` puts them into the summary with
    /// their largest figures.
    fn say_warnings(&mut self, observer: &mut dyn Observer) {
        let new = &self.run.warnings()[self.passed_warnings..];
        if self.scene.ranks().leads() {
            new.iter().for_each(|w| observer.warning(&w.to_string()));
        }
        self.passed_warnings += new.len();
    }

    /// Warns of bodies that have moved inside others without contact. `at_once` looks now, however recent the
    /// last look.
    pub(super) fn warn_of_intrusions(&mut self, at_once: bool, observer: &mut dyn Observer) -> Result<()> {
        let ranks = self.scene.ranks();
        let lines = match at_once {
            true => self.intrusions.look_now(&self.run, ranks)?,
            false => self.intrusions.look(&self.run, ranks)?,
        };
        lines.into_iter().for_each(|w| self.warn(w, observer));
        Ok(())
    }

    /// Moves the zone that follows, if it must move now.
    fn move_zone(&mut self, observer: &mut dyn Observer) -> Result<()> {
        let Some(follow) = &mut self.follow else {
            return Ok(());
        };
        self.clock.enter(Some(Phase::Rezone));
        let warnings = follow.look(&mut self.run)?;
        self.clock.enter(None);
        self.recorder.show_mediator(follow.mediator.take());
        warnings.into_iter().for_each(|w| self.warn(w, observer));
        Ok(())
    }

    /// Appends the new records to the files, so that they can be read during the run.
    pub(super) fn flush(&mut self) -> Result<()> {
        let Some(folder) = self.keep.as_ref().and_then(|k| k.folder.as_ref()) else {
            return Ok(());
        };
        let framed = self.recorder.framed(&self.run);
        let path = folder.path();
        self.live.flush(path, self.recorder.tables(), framed)?;
        // The index grows with every frame, so that a run in progress can be looked at.
        if framed {
            tables::all_breaks(path, &self.run, &self.breaks)?;
            if let Some(frames) = &self.recorder.frames {
                frames.finish(path)?;
            }
        }
        Ok(())
    }

    /// Makes steps until the last one, or until the observer or a break in an overlap ends them.
    pub(crate) fn advance(&mut self, observer: &mut dyn Observer) -> Result<End> {
        if self.scene.ranks().leads() {
            self.recorder.warnings.iter().for_each(|w| observer.warning(w));
        }
        self.say_warnings(observer);
        let every = self.scene.spec().output.checkpoint_every;
        let mut end = End::Complete;
        // One warning is enough: states that follow an odd one are odd too.
        let mut strange = !self.bounds.watch(&self.run).is_empty();
        let ranks = self.scene.ranks();
        let mut crossing = Crossing::since(&self.breaks);
        // A resumed run has the warnings of its first part.
        self.intrusions.skip(&self.recorder.warnings);
        self.warn_of_intrusions(true, observer)?;
        // Initial states may load bonds at once.
        if self.run.steps() == 0 {
            self.move_zone(observer)?;
        }
        for made in self.run.steps() + 1..=self.steps {
            let energy = recorder::step(&mut self.run, &mut self.clock)?;
            let sampled = energy.is_some();
            self.say_warnings(observer);
            self.recorder.observe(&mut self.run, energy)?;
            self.flush()?;
            if sampled && !strange {
                let odd = self.bounds.watch(&self.run);
                strange = !odd.is_empty();
                odd.into_iter().for_each(|w| self.warn(w, observer));
            }
            let mut flow = observer.step(&self.run, self.steps);
            // Ranks agree only at steps with a ledger, which synchronise them anyway. Any rank can end the
            // steps of all.
            if ranks.count() > 1 {
                let any = sampled && ranks.any(flow.is_break())?;
                flow = if any {
                    ControlFlow::Break(())
                } else {
                    ControlFlow::Continue(())
                };
            }
            self.warn_of_intrusions(false, observer)?;
            let (warnings, ends) = crossing.watch(self.scene.spec(), &self.run, &self.breaks);
            warnings.into_iter().for_each(|w| self.warn(w, observer));
            // A run with all steps is complete, even if something else would end it now.
            if made == self.steps {
                self.run.warn_of_jumps();
                self.say_warnings(observer);
                break;
            }
            if ends {
                end = End::IntoOverlap;
                break;
            }
            self.move_zone(observer)?;
            // After the reasons to end, for which `conclude` writes the checkpoint.
            if every.is_some_and(|n| made.is_multiple_of(n)) {
                self.save()?;
            }
            if flow.is_break() {
                end = End::Interrupted;
                break;
            }
        }
        observer.stepped();
        self.clock.enter(None);
        Ok(end)
    }
}
