//! Command line of the Arlequin workspace: a scene file in, results out.

mod calibrate;
mod check;
mod effects;
mod error;
mod report;
mod run;
mod suggest;
mod sweep;
mod threads;
mod verify;

use arlequin_scene::{Scene, Source};
use clap::{Args, Parser, Subcommand};
use error::{Error, Result};
use std::path::PathBuf;
use std::process::ExitCode;

/// Couples dissimilar mechanics models by the Arlequin method.
#[derive(Debug, Parser)]
#[command(name = "arlequin", version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Run a scene and write its results.
    Run {
        #[command(flatten)]
        common: Common,
        /// Output folder [default: results/ and the name of the scene]
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
        /// Replace earlier results; nothing but results is ever replaced.
        #[arg(long)]
        force: bool,
    },
    /// Go on with a run that was killed or interrupted, from its last checkpoint.
    Resume {
        /// Output folder of the run.
        folder: PathBuf,
        /// Worker threads [default: one per core]
        #[arg(long, value_name = "N")]
        threads: Option<usize>,
        /// Print the summary as JSON.
        #[arg(long)]
        json: bool,
    },
    /// Run a scene as given and with each effect off; print what each one changes and costs.
    Effects {
        #[command(flatten)]
        common: Common,
        /// Runs of each variant; the least time counts.
        #[arg(long, value_name = "N", default_value_t = 3)]
        repeat: usize,
    },
    /// Read and build a scene, print the plan, run nothing.
    Check {
        #[command(flatten)]
        common: Common,
    },
    /// Measure Young's modulus and Poisson's ratio of packings with the spread over seeds, or find beams for given ones.
    Calibrate(calibrate::Calibrate),
    /// Run the decks of the literature and compare with their numbers.
    Verify(verify::Args),
    /// Run a scene with many settings: what accuracy costs in time.
    Sweep(sweep::Arguments),
    /// Write the page on accuracy and cost from finished sweeps.
    #[command(hide = true)]
    SweepDocs(sweep::DocumentArguments),
    /// Propose settings for an error or a time.
    Suggest {
        #[command(flatten)]
        common: Common,
        #[command(flatten)]
        wish: suggest::Wish,
    },
}

#[derive(Debug, Args)]
struct Common {
    /// Scene file.
    scene: PathBuf,
    /// Change a value of the scene, such as time.end=1e-3; may be repeated.
    #[arg(long = "set", value_name = "PATH=VALUE")]
    set: Vec<String>,
    /// Worker threads [default: one per core]
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    /// Print the summary or plan as JSON.
    #[arg(long)]
    json: bool,
}

fn main() -> ExitCode {
    let done = match Cli::parse().command {
        Command::Run { common, out, force } => {
            return with_scene(&common, |scene| {
                run::run(scene, out.as_deref(), force, common.json)
            });
        }
        Command::Check { common } => {
            return with_scene(&common, |scene| {
                check::check(scene, common.json).map(|()| ExitCode::SUCCESS)
            });
        }
        Command::Effects { common, repeat } => {
            return with_scene(&common, |scene| {
                effects::effects(scene, repeat, common.json).map(|()| ExitCode::SUCCESS)
            });
        }
        Command::Calibrate(wanted) => return measured(&wanted),
        Command::Verify(args) => verify::verify(&args),
        Command::Sweep(a) => threads::start(None).and_then(|_| sweep::sweep(&a)),
        Command::SweepDocs(a) => sweep::document(&a),
        Command::Suggest { common, wish } => {
            return with_scene(&common, |scene| {
                suggest::suggest(scene, &wish, common.json).map(|()| ExitCode::SUCCESS)
            });
        }
        Command::Resume {
            folder,
            threads,
            json,
        } => threads::start(threads).and_then(|_| run::resume(&folder, json)),
    };
    done.unwrap_or_else(|e| fail(&e, None))
}

/// Runs a command on a scene; errors point into its text.
fn with_scene(common: &Common, command: impl FnOnce(&Scene) -> Result<ExitCode>) -> ExitCode {
    let source = match Source::read(&common.scene) {
        Ok(s) => s,
        Err(e) => return fail(&e, None),
    };
    let scene = threads::start(common.threads).and_then(|_| Scene::of(source.clone())?.assign(&common.set));
    let done = scene.and_then(|scene| command(&scene));
    done.unwrap_or_else(|e| fail(&e, Some(&source)))
}

/// `arlequin calibrate`, with or without a scene.
fn measured(wanted: &calibrate::Calibrate) -> ExitCode {
    let source = match wanted.scene.as_deref().map(Source::read).transpose() {
        Ok(s) => s,
        Err(e) => return fail(&e, None),
    };
    let done = threads::start(wanted.threads).and_then(|_| calibrate::calibrate(wanted, source.as_ref()));
    done.unwrap_or_else(|e| fail(&e, source.as_ref()))
}

fn fail(error: &Error, source: Option<&Source>) -> ExitCode {
    report::error(&error::render(error, source));
    ExitCode::from(if error.is_input() { 2 } else { 1 })
}
