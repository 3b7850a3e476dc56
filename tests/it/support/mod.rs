//! Settings shared by the test binaries.

pub(crate) mod blocks;
pub(crate) mod chain;
pub(crate) mod grains;
pub(crate) mod line;
pub(crate) mod solid;
