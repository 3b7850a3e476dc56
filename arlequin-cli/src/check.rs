//! `arlequin check`: builds everything, prints the plan, runs nothing.

use crate::error::{Error, Result};
use crate::report;
use arlequin::core::Coupled;
use arlequin_scene::Input;
use arlequin_scene::output::Frames;
use arlequin_scene::output::summary::{self, InterfaceLine, ModelLine};
use arlequin_scene::recorder::PhaseClock;
use arlequin_scene::scene::Scene;
use arlequin_scene::setup::{self, Built};
use arlequin_scene::wake;
use serde::Serialize;
use std::path::PathBuf;
use std::time::Instant;

/// Seconds that trial steps may take to estimate the time of a run.
const TRIAL: f64 = 0.3;

/// What a run will be.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct Plan {
    /// Path of the scene as given.
    pub(crate) scene: String,
    /// Its title.
    pub(crate) title: Option<String>,
    /// Models.
    pub(crate) models: Vec<ModelLine>,
    /// Interfaces.
    pub(crate) interface: Vec<InterfaceLine>,
    /// Effects that are on.
    pub(crate) effects: Vec<String>,
    /// Step \[s\].
    pub(crate) dt: f64,
    /// Largest stable step \[s\].
    pub(crate) critical_dt: f64,
    /// Steps to make.
    pub(crate) steps: usize,
    /// End \[s\].
    pub(crate) end: f64,
    /// Frames to write.
    pub(crate) frames: usize,
    /// Bytes of all frames.
    pub(crate) output_bytes: usize,
    /// Bytes of memory: those in use now that everything is built, or where the system does not tell, an estimate.
    pub(crate) memory_bytes: usize,
    /// Seconds the set-up took.
    pub(crate) setup_seconds: f64,
    /// Seconds the steps will take, from trial steps that are thrown away; none if these fail.
    pub(crate) stepping_seconds: Option<f64>,
    /// What a user should know.
    pub(crate) warnings: Vec<String>,
    /// The plan for the time in which a model sleeps.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) asleep: Option<Box<Self>>,
}

/// Checks a scene.
pub(crate) fn check(input: &Input<'_>, json: bool) -> Result<()> {
    let begin = Instant::now();
    let (asleep, built) = match &input.scene.wake {
        None => (None, setup::build(&input.scene, input.source.folder())?),
        Some(w) => {
            let (scene, asleep, built) = wake::both(input, w)?;
            (Some((scene, asleep)), built)
        }
    };
    let setup = begin.elapsed().as_secs_f64();
    let mut out = plan(input, &input.scene, built, setup);
    out.asleep = asleep.map(|(scene, built)| Box::new(plan(input, &scene, built, setup)));
    if json {
        let text = serde_json::to_string_pretty(&out).map_err(|e| Error::System {
            what: "writing the plan",
            message: e.to_string(),
        })?;
        report::json(&text);
    } else {
        report::plan(&out);
    }
    Ok(())
}

/// The plan of what is built, with trial steps.
fn plan(input: &Input<'_>, scene: &Scene, built: Built, setup_seconds: f64) -> Plan {
    let Built {
        mut run,
        drawn,
        mediators,
        steps,
        frame_every,
        warnings,
        ..
    } = built;
    let packings: Vec<_> = drawn.iter().map(|d| d.packing.clone()).collect();
    // Nothing is written: the folder is only a name.
    let frames = Frames::new(PathBuf::new(), &scene.output.fields, &run, drawn, mediators);
    let plan = run.plan();
    let count = 1 + steps.div_ceil(frame_every);
    Plan {
        scene: input.source.path.display().to_string(),
        title: scene.title.clone(),
        models: summary::models(&run, &packings),
        interface: summary::interfaces(&run, &[]),
        effects: plan.effects.clone(),
        dt: plan.dt,
        critical_dt: plan.critical_dt,
        steps,
        end: steps as f64 * plan.dt,
        frames: count,
        output_bytes: count * frames.bytes_per_frame(),
        memory_bytes: summary::process_bytes("VmRSS:").unwrap_or_else(|| estimated_bytes(&plan)),
        setup_seconds,
        warnings,
        asleep: None,
        stepping_seconds: trial(&mut run, steps),
    }
}

/// Seconds for all steps, extrapolated from a few.
fn trial(run: &mut Coupled<f64>, steps: usize) -> Option<f64> {
    let mut clock = PhaseClock::new();
    // The first step warms the caches.
    run.advance(&mut clock).ok()?;
    let begin = Instant::now();
    let mut made = 0usize;
    while made < 100 && begin.elapsed().as_secs_f64() < TRIAL {
        run.advance(&mut clock).ok()?;
        made += 1;
    }
    Some(begin.elapsed().as_secs_f64() / made as f64 * steps as f64)
}

/// Twelve vectors and a stiffness row of 81 entries per unknown, and the interface matrices.
fn estimated_bytes(plan: &arlequin::core::coupled::Plan) -> usize {
    let unknowns: usize = plan.models.iter().map(|m| m.3).sum();
    let interface: usize = plan.interfaces.iter().map(|i| i.nonzeros).sum();
    unknowns * (12 * 8 + 81 * 12) + interface * 16
}
