//! The page on accuracy and cost, assembled from finished sweeps.

use crate::error::Result;
use std::path::PathBuf;
use std::process::ExitCode;

/// What the command line says.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Page to write; pictures go to images/ beside it.
    #[arg(long, value_name = "FILE")]
    pub(crate) out: PathBuf,
    /// Sweep files and their output folders, in turn.
    #[arg(value_name = "SWEEP.toml DIR")]
    pub(crate) pairs: Vec<PathBuf>,
}

/// Writes the page.
pub(crate) fn document(_a: &Arguments) -> Result<ExitCode> {
    Ok(ExitCode::SUCCESS)
}
