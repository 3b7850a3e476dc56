//! Descriptions of the program itself: schema of its files, shell completions, man pages.

use crate::Cli;
use crate::error::{Result, write};
use crate::report;
use arlequin_scene::spec::schema;
use clap::CommandFactory;
use clap_complete::Shell;
use std::path::{Path, PathBuf};

/// Arguments of `arlequin schema`.
#[derive(Debug, clap::Args)]
pub(crate) struct SchemaArguments {
    /// Print the schema of sweep files instead.
    #[arg(long)]
    sweep: bool,
    /// Print the Markdown reference of the book instead.
    #[arg(long, hide = true)]
    reference: bool,
}

/// Prints the JSON Schema of scenes or sweeps.
pub(crate) fn schema(arguments: &SchemaArguments) -> Result<()> {
    let schema = if arguments.sweep {
        schema::sweep()
    } else {
        schema::scene()
    };
    if arguments.reference {
        report::text(&report::reference::markdown(&schema));
    } else {
        report::line(&report::pretty(&schema)?);
    }
    Ok(())
}

/// Prints the completion script of a shell.
pub(crate) fn completions(shell: Shell) {
    let mut out = Vec::new();
    clap_complete::generate(shell, &mut Cli::command(), "arlequin", &mut out);
    report::text(&String::from_utf8_lossy(&out));
}

/// Prints the man page, or writes the man pages of all commands into a folder.
pub(crate) fn man(folder: Option<&Path>) -> Result<()> {
    let command = Cli::command();
    let Some(folder) = folder else {
        let mut out = Vec::new();
        let page = clap_mangen::Man::new(command);
        page.render(&mut out)
            .map_err(write(&PathBuf::from("the man page")))?;
        report::text(&String::from_utf8_lossy(&out));
        return Ok(());
    };
    std::fs::create_dir_all(folder).map_err(write(folder))?;
    clap_mangen::generate_to(command, folder).map_err(write(folder))?;
    report::line(&format!("written    {}", folder.display()));
    Ok(())
}
