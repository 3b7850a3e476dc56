//! Saved states of objects whose layout only the object itself knows.

use crate::{Error, Result};

/// Saved state of an object whose layout only the object knows: an effect with a history, a model that
/// evolved.
#[derive(Debug, Clone, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Record<T> {
    /// Numbers.
    pub numbers: Vec<T>,
    /// Counts, indices, bit patterns.
    pub integers: Vec<u64>,
}

impl<T> Record<T> {
    /// Checks the lengths of a record against what its object expects.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`], naming `what`.
    pub fn expect(&self, what: &str, numbers: usize, integers: usize) -> Result<()> {
        check_length(
            &format!("numbers in the record of {what}"),
            numbers,
            self.numbers.len(),
        )?;
        check_length(
            &format!("integers in the record of {what}"),
            integers,
            self.integers.len(),
        )
    }
}

/// Returns an error unless `found` equals `expected`.
pub(crate) fn check_length(what: &str, expected: usize, found: usize) -> Result<()> {
    if expected == found {
        return Ok(());
    }
    Err(Error::SizeMismatch {
        what: what.to_owned(),
        expected,
        found,
    })
}
