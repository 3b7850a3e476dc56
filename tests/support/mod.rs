//! Settings shared by the test binaries.

pub(crate) mod solid;
