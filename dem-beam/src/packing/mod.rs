//! Packings: random and jammed, regular, or read from a file.

pub mod around;
mod assemble;
pub(crate) mod bonding;
pub(crate) mod cache;
pub(crate) mod cells;
mod contacts;
pub mod container;
pub(crate) mod csv;
pub(crate) mod lattice;
pub mod narrow;
mod near;
mod nesting;
mod orient;
pub mod parts;
mod profile;
pub mod protocol;
pub(crate) mod relax;
pub mod report;
pub mod size;
#[cfg(feature = "stl")]
mod stl;
pub mod surface;
#[cfg(feature = "vtu")]
pub(crate) mod vtu;

#[cfg(feature = "vtu")]
pub use crate::vtu::pieces_of_pvtu;
pub use around::Around;
pub use assemble::Packing;
pub use bonding::{LOOSE_LIMIT, Loose};
pub use container::Container;
pub use csv::{read_csv, write_csv};
pub use lattice::{Lattice, lattice};
pub use parts::Part;
pub use protocol::{Compaction, PackingSpec};
pub use report::Cut;
pub use report::PackingReport;
#[cfg(feature = "stl")]
pub use stl::read_facets;
pub use surface::Surface;
#[cfg(feature = "vtu")]
pub use vtu::{read_pieces, read_vtu};
