//! `arlequin suggest`.

/// What is wished for.
#[derive(Debug, clap::Args)]
pub(crate) struct Wish {
    /// Largest error.
    #[arg(long)]
    error: Option<String>,
}

/// Proposes.
pub(crate) fn suggest(_i: &crate::Input<'_>, _w: &Wish) -> crate::error::Result<()> {
    Ok(())
}
