//! Packings: random and jammed, regular, or read from a file.

pub(crate) mod bonding;
pub(crate) mod cells;
pub mod container;
pub mod protocol;
pub(crate) mod relax;
pub mod report;
pub mod surface;

pub use container::Container;
pub use protocol::{Compaction, Packing, PackingSpec};
pub use report::PackingReport;
pub use surface::Surface;
