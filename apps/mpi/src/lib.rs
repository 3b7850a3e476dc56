//! Runs on several ranks: the transports behind [`Communicator`](arlequin_core::ranks::Communicator).
//!
//! | module | ranks are |
//! |---|---|
//! | [`threads`] | threads of this process, each with a thread pool of its own: for tests |
//! | `processes` (feature `mpi`) | processes that speak MPI |
//!
//! [`arlequin_core::ranks`] describes how models are partitioned and how results keep their bits.

mod launcher;
#[cfg(feature = "mpi")]
pub mod processes;
pub mod threads;

pub use launcher::Launched;
