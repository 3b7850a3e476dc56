//! Runs on several ranks: the transports behind [`Communicator`](arlequin_core::ranks::Communicator).
//!
//! | module | ranks are |
//! |---|---|
//! | [`threads`] | threads of this process, each with a pool of its own: for tests |
//! | `processes` (feature `mpi`) | processes that speak MPI |
//!
//! What is shared out, and how results keep their bits, stands in [`arlequin_core::ranks`].

mod launcher;
#[cfg(feature = "mpi")]
pub mod processes;
pub mod threads;

pub use launcher::Launched;
