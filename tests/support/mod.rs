//! Settings shared by the test binaries.

pub(crate) mod solid;

pub(crate) use arlequin_studies::noise;
