//! Ranks of a run, and what they must agree on. Only rank 0 writes files and messages.

use crate::error::{Error, Result};
use arlequin::core::Subdomain;
use arlequin::core::ranks::{self, Communicator, RankError, Reduction};
use serde::Serialize;
use std::sync::Arc;

/// Distribution of one model over several ranks.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct RankLine {
    /// Name of the model.
    pub model: String,
    /// True if the model is partitioned.
    pub parts: bool,
    /// Work of a rank, or why the model is whole on every rank.
    pub words: String,
}

impl RankLine {
    /// Adds the load imbalance \[%\] of a partitioned model to the words.
    pub(crate) fn add_imbalance(&mut self, subdomain: &Subdomain<f64>) {
        if let Some(portion) = subdomain.owned().portion() {
            let most = 100.0 * portion.division().imbalance();
            self.words += &format!(", {most:.1} % more work than the mean at most");
        }
    }
}

/// Ranks of a run, and what they agree on before and between its stages. A run on one rank agrees with
/// itself.
#[derive(Debug, Clone, Default)]
pub(crate) struct Ranks {
    communicator: Option<Arc<dyn Communicator>>,
    /// Number of ranks that are planned for, without a communicator.
    planned: Option<usize>,
}

impl Ranks {
    /// Ranks of a communicator.
    pub(crate) fn from_communicator(communicator: Option<Arc<dyn Communicator>>) -> Self {
        Self {
            // With a single rank there is nothing to agree on.
            communicator: communicator.filter(|c| c.ranks() > 1),
            planned: None,
        }
    }

    /// Ranks that are only planned.
    pub(crate) fn planned(ranks: usize) -> Self {
        Self {
            communicator: None,
            planned: Some(ranks),
        }
    }

    /// The communicator, if there is more than one rank.
    pub(crate) fn communicator(&self) -> Option<&Arc<dyn Communicator>> {
        self.communicator.as_ref()
    }

    /// Number of ranks, existing or planned.
    pub(crate) fn count(&self) -> usize {
        let ranks = self.communicator.as_ref().map(|c| c.ranks());
        ranks.or(self.planned).unwrap_or(1)
    }

    /// Number of this rank.
    pub(crate) fn rank(&self) -> usize {
        self.communicator.as_ref().map_or(0, |c| c.rank())
    }

    /// Returns whether this rank writes files and messages.
    pub(crate) fn leads(&self) -> bool {
        self.rank() == 0
    }

    /// Compares `digest` between ranks. Collective.
    ///
    /// # Errors
    /// [`RankError::Differ`] if the digests differ; failures of the communicator.
    pub(crate) fn agree(&self, what: &str, digest: u64) -> Result<()> {
        let Some(c) = &self.communicator else {
            return Ok(());
        };
        ranks::agree(&**c, what, digest).map_err(elsewhere)
    }

    /// Returns whether `flag` is true on any rank. Collective.
    ///
    /// # Errors
    /// Failures of the communicator.
    pub(crate) fn any(&self, flag: bool) -> Result<bool> {
        let [any] = self.largest([i64::from(flag)])?;
        Ok(any > 0)
    }

    fn largest<const N: usize>(&self, mut values: [i64; N]) -> Result<[i64; N]> {
        if let Some(c) = &self.communicator {
            c.reduce(&mut values, Reduction::Largest).map_err(elsewhere)?;
        }
        Ok(values)
    }

    /// Returns `result` if it is `Ok` on every rank. Collective.
    ///
    /// # Errors
    /// The lowest rank that failed returns its error as [`Error::Agreed`], all others [`Error::Elsewhere`];
    /// failures of the communicator.
    pub(crate) fn together<R>(&self, result: Result<R>) -> Result<R> {
        let Some(c) = &self.communicator else {
            return result;
        };
        // Every rank already has these errors, or the ranks can no longer communicate: another exchange would
        // hang.
        if result
            .as_ref()
            .is_err_and(|e| e.is_everywhere() || e.is_of_ranks())
        {
            return result;
        }
        let (rank, ranks) = (c.rank() as i64, c.ranks() as i64);
        // One number holds rank and kind of the error, so that the largest is that of the lowest rank that
        // failed, and the kind is that rank's own.
        let code = match &result {
            Ok(_) => 0,
            Err(e) => 2 * (ranks - rank) + i64::from(e.is_input()),
        };
        let [largest] = self.largest([code])?;
        let failed = ranks - largest / 2;
        match result {
            Ok(output) if largest == 0 => Ok(output),
            Err(e) if failed == rank => Err(Error::Agreed(Box::new(e))),
            _ => Err(Error::Elsewhere {
                rank: failed as usize,
                input: largest % 2 == 1,
            }),
        }
    }
}

/// Returns `result` if it is `Ok` on every rank. Collective. Without a communicator, returns `result`.
///
/// # Errors
/// The lowest rank that failed returns its error as [`Error::Agreed`], all others [`Error::Elsewhere`].
pub fn together<R>(communicator: Option<&Arc<dyn Communicator>>, result: Result<R>) -> Result<R> {
    Ranks::from_communicator(communicator.cloned()).together(result)
}

/// Wraps an error between ranks.
pub(crate) fn elsewhere(e: RankError) -> Error {
    Error::Core {
        key: "ranks".into(),
        source: arlequin::core::Error::Rank(e),
    }
}

#[cfg(test)]
mod tests {
    use super::together;
    use crate::Error;
    use arlequin_mpi::threads;
    use std::time::Duration;

    /// A run error of rank 1 beside an input error of rank 2: all ranks report rank 1 and its kind.
    #[test]
    fn the_lowest_rank_that_failed_and_its_own_kind_of_error_are_reported() {
        let outcomes = threads::run(3, 1, Duration::from_secs(20), |c| {
            let result = match c.rank() {
                1 => Err(Error::System {
                    what: "threads",
                    message: "no memory".into(),
                }),
                2 => Err(crate::error::value("time.end", -1.0, "must be positive")),
                _ => Ok(()),
            };
            together(Some(&c), result).map_err(|e| match e {
                Error::Agreed(e) => format!("own: {e}"),
                Error::Elsewhere { rank, input } => format!("rank {rank}, input {input}"),
                other => format!("{other:?}"),
            })
        });
        let outcomes: Vec<_> = outcomes.into_iter().map(|o| o.expect("a rank")).collect();
        assert_eq!(outcomes[0], Err("rank 1, input false".to_owned()));
        assert!(
            matches!(&outcomes[1], Err(e) if e.contains("no memory")),
            "{outcomes:?}"
        );
        assert_eq!(outcomes[2], Err("rank 1, input false".to_owned()));
    }
}
