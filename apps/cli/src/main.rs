//! Command line of the Arlequin workspace: reads scene files, runs them and writes results.

mod calibrate;
mod compare;
mod describe;
mod error;
mod figures;
mod new;
mod ranks;
mod report;
mod run;
mod suggest;
mod sweep;
mod threads;
mod verify;
mod view;

use arlequin_scene::effects;
use arlequin_scene::{LinkLine, Scene, Source};
use clap::{Args, Parser, Subcommand};
use error::{Located, Result};
use std::path::PathBuf;
use std::process::ExitCode;

/// Couples dissimilar mechanics models by the Arlequin method.
#[derive(Debug, Parser)]
#[command(name = "arlequin", version)]
struct Cli {
    #[command(flatten)]
    loudness: report::Loudness,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Write a commented scene to begin with.
    New(new::Arguments),
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
        #[command(flatten)]
        waiting: ranks::Waiting,
    },
    /// Continue a run that was killed or interrupted, from its last checkpoint.
    Resume {
        /// Output folder of the run.
        folder: PathBuf,
        /// Worker threads [default: one per core]
        #[arg(long, value_name = "N")]
        threads: Option<usize>,
        /// Print the summary as JSON.
        #[arg(long)]
        json: bool,
        #[command(flatten)]
        waiting: ranks::Waiting,
    },
    /// Run a scene as given and with each effect off; print what each one changes and costs.
    Effects {
        #[command(flatten)]
        common: Common,
        /// Runs of each variant; the least time counts.
        #[arg(long, value_name = "N", default_value_t = 3)]
        repeat: usize,
    },
    /// Couple the models of a scene by this method and by those of the literature; print how each of them
    /// reflects, errs, drifts and costs.
    ///
    /// Supports, loads and effects of the scene take no part. The scene has one interface between two models.
    Compare {
        #[command(flatten)]
        common: Common,
        #[command(flatten)]
        choice: compare::Choice,
    },
    /// Read and build a scene, print the plan, run nothing.
    ///
    /// A scene with links to other programs is only read; the programs it would start or wait for are
    /// printed.
    Check {
        #[command(flatten)]
        common: Common,
        /// Connect links as well: start their commands, wait at their addresses.
        #[arg(long)]
        start: bool,
        /// Print also which models would be partitioned on this number of ranks.
        #[arg(long, value_name = "N")]
        ranks: Option<usize>,
    },
    /// Measure Young's modulus and Poisson's ratio of packings over several seeds, or find the beams that
    /// give required values.
    Calibrate(Box<calibrate::Calibrate>),
    /// Run the cases of the literature and compare with their numbers.
    Verify(verify::Args),
    /// Run a scene with many settings and compare error with time.
    Sweep(sweep::Arguments),
    /// Write the page on accuracy and cost from finished sweeps.
    #[command(hide = true)]
    SweepDocs(sweep::DocumentArguments),
    /// Write a web page that shows the results of a run: 3D views, cuts, colours, frames over time and
    /// curves.
    View(view::Arguments),
    /// Print the JSON Schema of scenes, with which editors complete and check TOML files.
    Schema(describe::SchemaArguments),
    /// Print the completions for a shell.
    Completions {
        /// The shell.
        shell: clap_complete::Shell,
    },
    /// Print the man page.
    Man {
        /// Write the pages of all commands into this folder instead.
        folder: Option<PathBuf>,
    },
    /// Propose settings for an error or a time.
    Suggest {
        #[command(flatten)]
        common: Common,
        #[command(flatten)]
        wish: suggest::Wish,
    },
}

impl Command {
    /// Returns the command's name for the error that refuses it on several ranks.
    fn name(&self) -> &'static str {
        match self {
            Self::Check { .. } => "check",
            Self::Sweep(_) => "sweep",
            Self::Effects { .. } => "effects",
            Self::Compare { .. } => "compare",
            _ => "this command",
        }
    }
}

#[derive(Debug, Args)]
struct Common {
    /// Scene file.
    scene: PathBuf,
    /// Change a value of the scene, such as time.end=1e-3; without a value, remove the key; may be repeated.
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
    let cli = Cli::try_parse().unwrap_or_else(|e| {
        if e.use_stderr() {
            // Every rank has this error; a launcher could end rank 0 before it has printed the message.
            ranks::let_first_speak();
        } else if !ranks::leads() {
            std::process::exit(0);
        }
        e.exit()
    });
    report::set_loudness(cli.loudness.of_rank(ranks::leads()));
    run_command(cli.command).unwrap_or_else(|e| e.report())
}

fn run_command(command: Command) -> Result<ExitCode, Located> {
    match command {
        Command::Run {
            common,
            out,
            force,
            waiting,
        } => ranks::run(waiting, |communicator| {
            with_scene(&common, &communicator, |scene| {
                run::run(scene, out.as_deref(), force, common.json)
            })
        }),
        Command::Resume {
            folder,
            threads,
            json,
            waiting,
        } => ranks::run(waiting, |communicator| {
            let started = threads::start(threads).map(|_| ());
            arlequin_scene::together(communicator.as_ref(), started)?;
            Ok(run::resume(&folder, communicator, json)?)
        }),
        other => {
            ranks::refuse_several(other.name()).inspect_err(|_| ranks::let_first_speak())?;
            run_alone(other)
        }
    }
}

/// Runs a command that works in a single process.
fn run_alone(command: Command) -> Result<ExitCode, Located> {
    match command {
        // Handled in `run_command` already.
        Command::Run { .. } | Command::Resume { .. } => Ok(ExitCode::SUCCESS),
        Command::Check { common, start, ranks } => with_scene(&common, &None, |scene| {
            let planned = ranks.map(|n| scene.clone().for_ranks(n));
            let scene = planned.as_ref().unwrap_or(scene);
            let links = LinkLine::list(scene);
            // Building such a scene would start programs of the user, which a check must not do unasked.
            if !start && !links.is_empty() {
                scene.check_tables()?;
                report::result(&links, common.json, |l| report::not_started(l))?;
                return Ok(ExitCode::SUCCESS);
            }
            run::watch_links(scene)?;
            report::result(
                &scene.prepare_with(&mut report::phase_reporter())?.preview(),
                common.json,
                report::plan,
            )?;
            Ok(ExitCode::SUCCESS)
        }),
        Command::Effects { common, repeat } => with_scene(&common, &None, |scene| {
            report::result(&effects::compare(scene, repeat)?, common.json, report::comparison)?;
            Ok(ExitCode::SUCCESS)
        }),
        Command::Compare { common, choice } => with_scene(&common, &None, |scene| {
            compare::compare(scene, &choice, common.json)?;
            Ok(ExitCode::SUCCESS)
        }),
        Command::Calibrate(arguments) => calibrate::calibrate(&arguments),
        Command::Verify(args) => Ok(verify::verify(&args)?),
        Command::Sweep(a) => sweep::sweep(&a),
        Command::SweepDocs(a) => sweep::document(&a),
        Command::Suggest { common, wish } => with_scene(&common, &None, |scene| {
            suggest::suggest(scene, &wish, common.json)?;
            Ok(ExitCode::SUCCESS)
        }),
        Command::New(arguments) => Ok(new::new(&arguments).map(|()| ExitCode::SUCCESS)?),
        Command::View(arguments) => Ok(view::view(&arguments).map(|()| ExitCode::SUCCESS)?),
        Command::Schema(arguments) => Ok(describe::schema(&arguments).map(|()| ExitCode::SUCCESS)?),
        Command::Completions { shell } => {
            describe::completions(shell);
            Ok(ExitCode::SUCCESS)
        }
        Command::Man { folder } => Ok(describe::man(folder.as_deref()).map(|()| ExitCode::SUCCESS)?),
    }
}

/// Runs a command on a scene. Errors point to the line of the scene file that caused them.
fn with_scene(
    common: &Common,
    communicator: &ranks::OtherRanks,
    command: impl FnOnce(&Scene) -> Result<ExitCode>,
) -> Result<ExitCode, Located> {
    // If one rank cannot read the scene, all ranks fail together.
    let source = arlequin_scene::together(communicator.as_ref(), Source::read(&common.scene))?;
    let run = || {
        let read = || {
            threads::start(common.threads)?;
            Scene::from_source(source.clone())?.assign(&common.set)
        };
        let scene = arlequin_scene::together(communicator.as_ref(), read())?;
        match communicator {
            Some(c) => command(&scene.on_ranks(c.clone())?),
            None => command(&scene),
        }
    };
    run().map_err(Located::within(&source))
}
