//! What an object must remember whose layout only the object knows.

use crate::{Error, Result};

/// Numbers and counts of an object whose layout only the object knows: an effect with a history, a model
/// that evolved.
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
        same(
            &format!("numbers in the record of {what}"),
            numbers,
            self.numbers.len(),
        )?;
        same(
            &format!("integers in the record of {what}"),
            integers,
            self.integers.len(),
        )
    }
}

/// Refuses another number of things than expected.
pub(crate) fn same(what: &str, expected: usize, found: usize) -> Result<()> {
    if expected == found {
        return Ok(());
    }
    Err(Error::SizeMismatch {
        what: what.to_owned(),
        expected,
        found,
    })
}
