//! Preview of a run: sizes, steps, output, memory and time.

use crate::output::summary::{InterfaceLine, ModelLine};
use crate::output::{Frames, Pictures};
use crate::ranks::RankLine;
use crate::run::{self, PhaseClock, Prepared};
use crate::scene::Scene;
use crate::setup::zone::ZoneLine;
use crate::setup::{Built, PhaseTime};
use arlequin::core::{Coupled, Uniform};
use serde::Serialize;
use std::time::Instant;

/// Wall time that trial steps may take to estimate the time of a run \[s\].
const TRIAL: f64 = 0.3;

/// Preview of a run.
#[derive(Debug, Clone, Serialize)]
pub struct Preview {
    /// Path of the scene as given.
    pub scene: String,
    /// Title of the scene.
    pub title: Option<String>,
    /// Models.
    pub models: Vec<ModelLine>,
    /// Interfaces.
    pub interface: Vec<InterfaceLine>,
    /// Widths of the overlaps around zones.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub zones: Vec<ZoneLine>,
    /// For each model, how the planned ranks hold it.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub ranks: Vec<RankLine>,
    /// Models that are external solvers in other processes.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub links: Vec<LinkLine>,
    /// Names of the enabled effects.
    pub effects: Vec<String>,
    /// Time step \[s\].
    pub dt: f64,
    /// Critical step \[s\].
    pub critical_dt: f64,
    /// Solution of the load steps of a `[static]` scene: directly, or by relaxation and why.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub resting: Option<String>,
    /// Number of steps.
    pub steps: usize,
    /// End time \[s\].
    pub end: f64,
    /// Number of frames.
    pub frames: usize,
    /// Size of all frames \[bytes\].
    pub output_bytes: usize,
    /// Memory in use after the set-up \[bytes\]; an estimate where the system does not report it.
    pub memory_bytes: usize,
    /// Wall time of the set-up \[s\].
    pub setup_seconds: f64,
    /// Wall times of the phases of the set-up, in order.
    pub setup_phases: Vec<PhaseTime>,
    /// Expected wall time of all steps \[s\], from trial steps that are discarded. `None` if a trial step
    /// fails or for a `[static]` scene.
    pub stepping_seconds: Option<f64>,
    /// Warnings for the user.
    pub warnings: Vec<String>,
}

/// A model that is an external solver in another process.
#[derive(Debug, Clone, Serialize)]
pub struct LinkLine {
    /// Name of the model.
    pub model: String,
    /// Action of the run to connect: the command it starts, or the address at which it waits.
    pub does: String,
    /// Mass without weights that the external solver reports \[kg\]; `None` before it has connected.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mass: Option<f64>,
}

impl LinkLine {
    /// Lists the external solvers of a scene before anything is started.
    pub fn list(scene: &Scene) -> Vec<Self> {
        let line = |(model, does)| Self {
            model,
            does,
            mass: None,
        };
        scene.links().into_iter().map(line).collect()
    }

    /// Lists the external solvers of a run, with their masses.
    fn connected(scene: &Scene, run: &Coupled<f64>) -> Vec<Self> {
        let mut out = Self::list(scene);
        for line in &mut out {
            let mut subdomains = run.subdomains().iter();
            let Some(s) = subdomains.find(|s| s.model().name() == line.model) else {
                continue;
            };
            let layout = s.model().layout();
            let mut inertia = vec![0.0; layout.dofs()];
            if s.model().lumped_inertia(&Uniform(1.0), &mut inertia).is_ok() {
                // The inertia of a node counts its mass once per component.
                let total: f64 = inertia[..layout.translations()].iter().sum();
                line.mass = Some(total / layout.components as f64);
            }
        }
        out
    }
}

impl Prepared {
    /// Returns a preview of the run; makes a few steps and discards them to measure their time.
    pub fn preview(self) -> Preview {
        Preview::from_built(&self.scene, self.built, self.setup)
    }
}

impl Preview {
    fn from_built(scene: &Scene, built: Built, setup_seconds: f64) -> Self {
        let Built {
            mut run,
            models,
            mediators,
            rigid,
            load_steps,
            steps,
            frame_every,
            warnings,
            phases,
            zones,
            holdings,
            ..
        } = built;
        let packings: Vec<_> = models.iter().map(|d| d.packing.clone()).collect();
        // No file is written, so the frames need no folder.
        let fields = &scene.spec().output.fields;
        let pictures = Pictures {
            models,
            mediators,
            rigid,
        };
        let frames = Frames::new(None, fields, &run, pictures);
        let last = load_steps.and_then(|s| s.times.last().copied());
        let resting = last.map(|_| match run.solves_directly() {
            Ok(()) => "directly".to_owned(),
            Err(_) if run.solves_until_change() => {
                "directly until the first break, then by relaxation".to_owned()
            }
            Err(why) => format!("by relaxation, as {why}"),
        });
        let mut interface = run::interfaces(&run, &[]);
        let ranks = scene.ranks().count();
        if ranks > 1 {
            for (line, i) in interface.iter_mut().zip(run.interfaces()) {
                let times = i.solution_times(ranks).into_iter();
                line.solution_times = times.map(|t| (t.solver, t.seconds)).collect();
            }
        }
        let plan = run.plan();
        // The state before the first load step of a `[static]` scene is no equilibrium and has no frame.
        let count = usize::from(last.is_none()) + steps.div_ceil(frame_every);
        Self {
            scene: scene.source().path.display().to_string(),
            title: scene.spec().title.clone(),
            models: run::models(&run, &packings),
            interface,
            zones,
            ranks: holdings,
            links: LinkLine::connected(scene, &run),
            effects: plan.effects.clone(),
            dt: plan.dt,
            critical_dt: plan.critical_dt,
            resting,
            steps,
            end: last.unwrap_or(steps as f64 * plan.dt),
            frames: count,
            output_bytes: count * frames.bytes_per_frame(),
            memory_bytes: run::process_bytes("VmRSS:").unwrap_or_else(|| estimated_bytes(&plan)),
            setup_seconds,
            setup_phases: phases,
            warnings,
            // The time of a load step cannot be known before it is solved.
            stepping_seconds: if last.is_some() {
                None
            } else {
                trial(&mut run, steps)
            },
        }
    }
}

/// Expected wall time of all steps \[s\], extrapolated from a few; `None` if a step fails.
fn trial(run: &mut Coupled<f64>, steps: usize) -> Option<f64> {
    let mut clock = PhaseClock::new();
    // The first step warms the caches.
    run.advance(&mut clock).ok()?;
    let begin = Instant::now();
    let mut count = 0usize;
    while count < 100 && begin.elapsed().as_secs_f64() < TRIAL {
        run.advance(&mut clock).ok()?;
        count += 1;
    }
    Some(begin.elapsed().as_secs_f64() / count as f64 * steps as f64)
}

/// Estimated memory \[bytes\]: per unknown twelve vectors and a stiffness row of 81 entries, and the
/// interface matrices.
fn estimated_bytes(plan: &arlequin::core::Plan) -> usize {
    let unknowns: usize = plan.models.iter().map(|m| m.3).sum();
    let interface: usize = plan.interfaces.iter().map(|i| i.nonzeros).sum();
    unknowns * (12 * 8 + 81 * 12) + interface * 16
}
