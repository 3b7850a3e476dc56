//! Nodes of a model that one rank owns: all nodes of a whole model, or a part of those of a partitioned one.
//! Sums, largest values and gathered arrays have the same bits in both cases.

mod cuts;
mod sums;

pub(crate) use cuts::Cuts;
pub use sums::add_products;
pub(crate) use sums::add_products_in;

use crate::exact::{Exact, WORDS};
use crate::ranks::{Communicator, Division, Portion, Reduction, Unit, agree};
use crate::{DofLayout, Real, Result, parallel};
use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

/// Number of nodes in a unit: the smallest part a rank can own, and the range of the inner sums.
pub const UNIT: usize = 256;

/// Nodes of a model that this rank owns. They keep the order of the model and have local numbers from zero.
///
/// ```
/// use arlequin_core::Owned;
/// let owned = Owned::whole(1000);
/// let [sum] = owned.sum(&|range| [range.map(|node| node as f64).sum()]);
/// assert_eq!((sum, owned.local(7)), (499_500.0, Some(7)));
/// ```
#[derive(Debug, Clone)]
pub struct Owned {
    nodes: usize,
    /// `None` for a whole model.
    portion: Option<Arc<Portion>>,
}

impl From<&Arc<Portion>> for Owned {
    fn from(portion: &Arc<Portion>) -> Self {
        Self {
            nodes: portion.nodes(),
            portion: Some(portion.clone()),
        }
    }
}

impl Owned {
    /// Returns all nodes of a whole model.
    #[must_use]
    pub fn whole(nodes: usize) -> Self {
        Self { nodes, portion: None }
    }

    /// Returns the nodes of a partitioned model that the rank of `communicator` owns.
    ///
    /// # Errors
    /// [`crate::ranks::RankError::Length`] for a division among another number of ranks.
    pub fn divided(division: Division, communicator: Arc<dyn Communicator>) -> Result<Self> {
        Ok((&Arc::new(Portion::new(division, communicator)?)).into())
    }

    /// Partitions a model by the work of its `units` and returns the nodes that this rank owns. `digest`:
    /// digest of `what` all ranks must have alike. Collective.
    ///
    /// # Errors
    /// [`crate::ranks::RankError::Differ`] if digests differ; errors of [`Division::bisect`].
    pub fn bisected(
        communicator: &Arc<dyn Communicator>,
        (what, digest): (&str, u64),
        nodes: usize,
        units: &[Unit],
    ) -> Result<Self> {
        agree(&**communicator, what, digest)?;
        Self::divided(
            Division::bisect(nodes, units, communicator.ranks())?,
            communicator.clone(),
        )
    }

    /// Returns whether the model is partitioned.
    #[must_use]
    pub fn is_part(&self) -> bool {
        self.portion.is_some()
    }

    /// Returns this rank's part of a partitioned model, for exchanges with other ranks.
    #[must_use]
    pub fn portion(&self) -> Option<&Arc<Portion>> {
        self.portion.as_ref()
    }

    /// Returns the number of ranks among which the nodes are divided; 1 for a whole model.
    #[must_use]
    pub fn ranks(&self) -> usize {
        self.portion.as_ref().map_or(1, |p| p.division().ranks())
    }

    /// Returns the number of nodes that this rank owns.
    #[must_use]
    pub fn nodes(&self) -> usize {
        self.nodes
    }

    /// Returns the number of nodes of the whole model.
    #[must_use]
    pub fn nodes_of_whole(&self) -> usize {
        self.portion.as_ref().map_or(self.nodes, |p| p.division().nodes())
    }

    /// Returns the number in the whole model of a node of this rank.
    ///
    /// # Panics
    /// If this rank has no such node of a partitioned model.
    #[must_use]
    pub fn global(&self, node: usize) -> usize {
        self.portion.as_ref().map_or(node, |p| p.global(node))
    }

    /// Returns the local number of a node of the whole model; `None` if another rank owns it.
    #[must_use]
    pub fn local(&self, node: usize) -> Option<usize> {
        self.portion.as_ref().map_or(Some(node), |p| p.local(node))
    }

    /// Returns the layout of the whole model; `layout` is that of the owned nodes.
    #[must_use]
    pub fn whole_layout(&self, layout: &DofLayout) -> DofLayout {
        DofLayout {
            nodes: self.nodes_of_whole(),
            ..*layout
        }
    }

    /// Returns the number in the whole model of an unknown of this rank; `layout` is that of the owned nodes.
    #[must_use]
    pub fn global_unknown(&self, layout: &DofLayout, unknown: usize) -> usize {
        let (d, r) = (layout.components, layout.rotations);
        match (unknown.checked_sub(layout.translations()), &self.portion) {
            (_, None) => unknown,
            (None, Some(p)) => p.global(unknown / d) * d + unknown % d,
            (Some(rotation), Some(p)) => p.division().nodes() * d + p.global(rotation / r) * r + rotation % r,
        }
    }

    /// Returns the local number of an unknown of the whole model; `None` if another rank owns it. `layout` is
    /// that of the owned nodes.
    #[must_use]
    pub fn local_unknown(&self, layout: &DofLayout, unknown: usize) -> Option<usize> {
        let Some(portion) = &self.portion else {
            return Some(unknown);
        };
        let translations = self.whole_layout(layout).translations();
        let (first, count, start) = match unknown.checked_sub(translations) {
            None => (unknown, layout.components, 0),
            Some(rotation) => (rotation, layout.rotations, layout.translations()),
        };
        Some(start + portion.local(first / count)? * count + first % count)
    }

    /// Restricts values of all unknowns of the whole model to the unknowns of this rank; `layout` is that of
    /// the owned nodes.
    pub(crate) fn restrict<T: Real>(&self, layout: &DofLayout, x: &[T]) -> Vec<T> {
        let Some(portion) = &self.portion else {
            return x.to_vec();
        };
        let (first, rotations) = x.split_at(self.whole_layout(layout).translations());
        let blocks = [(first, layout.components), (rotations, layout.rotations)];
        let restricted = |(x, count): (&[T], usize)| -> Vec<T> {
            let nodes = 0..self.nodes;
            nodes
                .flat_map(|k| x[portion.global(k) * count..][..count].to_vec())
                .collect()
        };
        blocks.map(restricted).concat()
    }

    /// Gathers the numbers of all nodes, `numbers` each, on rank 0 in the order of the whole model (`None`
    /// elsewhere). `x`: numbers of the owned nodes. A whole model returns `x` on every rank. Collective.
    ///
    /// # Errors
    /// Errors of the transport.
    pub fn gather<'a, T: Real>(&self, numbers: usize, x: &'a [T]) -> Result<Option<Cow<'a, [T]>>> {
        match &self.portion {
            None => Ok(Some(Cow::from(x))),
            Some(p) => Ok(p.collect(numbers, x)?.map(Cow::from)),
        }
    }

    /// Gathers `x`, one value per unknown of this rank, like [`Self::gather`]. `layout` is that of the owned
    /// nodes.
    ///
    /// # Errors
    /// Errors of the transport.
    pub fn gather_unknowns<'a, T: Real>(
        &self,
        layout: &DofLayout,
        x: &'a [T],
    ) -> Result<Option<Cow<'a, [T]>>> {
        let Some(portion) = &self.portion else {
            return Ok(Some(Cow::from(x)));
        };
        let (first, rotations) = x.split_at(layout.translations().min(x.len()));
        // Translations and rotations are gathered apart, since each block is in the order of nodes.
        let mut out = portion.collect(layout.components, first)?;
        if layout.rotations > 0 {
            let turns = portion.collect(layout.rotations, rotations)?;
            out = out.zip(turns).map(|(a, b)| [a, b].concat());
        }
        Ok(out.map(Cow::from))
    }

    /// Returns the lists of all ranks, one after another in the order of ranks (all-gather). Collective.
    ///
    /// # Errors
    /// Errors of the transport.
    pub fn all_gather(&self, list: Vec<i64>) -> Result<Vec<i64>> {
        let Some(portion) = &self.portion else {
            return Ok(list);
        };
        let communicator = portion.communicator();
        let (rank, ranks) = (communicator.rank(), communicator.ranks());
        let mut counts = vec![0; ranks];
        counts[rank] = list.len() as i64;
        portion.keep(communicator.reduce(&mut counts, Reduction::Sum))?;
        // An all-gather by all-reduce: each rank adds its words where all others add zeros.
        let before: i64 = counts[..rank].iter().sum();
        let total: i64 = counts.iter().sum();
        if total == 0 {
            return Ok(Vec::new());
        }
        let mut words = vec![0; total as usize];
        words[before as usize..][..list.len()].copy_from_slice(&list);
        portion.keep(communicator.reduce(&mut words, Reduction::Sum))?;
        Ok(words)
    }

    /// Returns the lists of all ranks like [`Self::all_gather`], on rank 0 only (`None` elsewhere).
    /// Collective.
    ///
    /// # Errors
    /// Errors of the transport.
    pub fn gather_lists(&self, list: Vec<f64>) -> Result<Option<Vec<f64>>> {
        match &self.portion {
            Some(p) => Ok(p.gather_lists(&list)?),
            None => Ok(Some(list)),
        }
    }

    /// Returns the rows of all ranks, sorted by their numbers (all-gather). `rows` have numbers of which each
    /// is on one rank, ascending, and `N` values. Collective.
    ///
    /// # Errors
    /// Errors of the transport.
    pub fn all_gather_rows<const N: usize>(
        &self,
        rows: Vec<(usize, [f64; N])>,
    ) -> Result<Vec<(usize, [f64; N])>> {
        if !self.is_part() {
            return Ok(rows);
        }
        // The all-gather carries integers: values travel as their bits.
        let words = rows.into_iter().flat_map(|(number, values)| {
            let values = values.map(|x| x.to_bits().cast_signed());
            std::iter::once(number as i64).chain(values)
        });
        let words = self.all_gather(words.collect())?;
        let row = |words: &[i64]| {
            let values = std::array::from_fn(|k| f64::from_bits(words[k + 1].cast_unsigned()));
            (words[0] as usize, values)
        };
        let mut rows: Vec<_> = words.chunks_exact(N + 1).map(row).collect();
        rows.sort_unstable_by_key(|r| r.0);
        Ok(rows)
    }

    /// Sums over all nodes of the model; `part` sums over a range of the owned nodes. The result has the same
    /// bits for any number of threads and ranks. NaN after a failure of the transport. Collective.
    pub fn sum<T: Real, const N: usize>(&self, part: &(dyn Fn(Range<usize>) -> [T; N] + Sync)) -> [T; N] {
        self.total(sums::unit_sums(self.nodes, part, parallel::pays(self.nodes * N)))
            .map(T::of)
    }

    /// Returns the sums over all ranks (all-reduce). NaN after a failure of the transport. Collective.
    pub fn total<const N: usize>(&self, sums: [Exact; N]) -> [f64; N] {
        let Some(portion) = &self.portion else {
            return sums.map(Exact::value);
        };
        let mut words = [[0; WORDS]; N];
        words.iter_mut().zip(sums).for_each(|(w, e)| *w = e.words());
        if !portion.reduce(words.as_flattened_mut(), Reduction::Sum) {
            return [f64::NAN; N];
        }
        words.map(|w| Exact::from_words(w).value())
    }

    /// Replaces each entry by its sum over all ranks, in one all-reduce. NaN as in [`Self::total`].
    /// Collective.
    pub fn all_reduce(&self, sums: &mut [Exact]) {
        let Some(portion) = &self.portion else { return };
        let mut words: Vec<_> = sums.iter().map(|e| e.words()).collect();
        let works = portion.reduce(words.as_flattened_mut(), Reduction::Sum);
        for (sum, words) in sums.iter_mut().zip(words) {
            *sum = Exact::from_words(words);
            if !works {
                sum.add(f64::NAN);
            }
        }
    }

    /// Returns the largest of the ranks' numbers, which must not be negative. NaN if one of them is NaN or
    /// after a failure of the transport. Collective.
    pub fn largest<T: Real>(&self, value: T) -> T {
        // Beside numbers that are not negative, NaN counts as the highest.
        let highest = || T::of(self.highest(value.as_f64().abs()));
        if self.is_part() { highest() } else { value }
    }

    /// Returns the largest of the ranks' numbers, of either sign. NaN after a failure of the transport.
    /// Collective.
    pub fn highest(&self, value: f64) -> f64 {
        let Some(portion) = &self.portion else {
            return value;
        };
        // Maps bits to integers in the order of the numbers; applied twice it gives the bits back.
        let ordered = |bits: i64| bits ^ ((bits >> 63).cast_unsigned() >> 1).cast_signed();
        let mut words = [ordered(value.to_bits().cast_signed())];
        if portion.reduce(&mut words, Reduction::Largest) {
            f64::from_bits(ordered(words[0]).cast_unsigned())
        } else {
            f64::NAN
        }
    }

    /// Returns whether `flag` is true on any rank. Collective.
    ///
    /// # Errors
    /// Errors of the transport.
    pub fn any(&self, flag: bool) -> Result<bool> {
        let Some(portion) = &self.portion else {
            return Ok(flag);
        };
        let mut words = [i64::from(flag)];
        portion.keep(portion.communicator().reduce(&mut words, Reduction::Largest))?;
        Ok(words[0] > 0)
    }

    /// Checks that all ranks have the same digest of `what`. Collective.
    ///
    /// # Errors
    /// [`crate::ranks::RankError::Differ`] if digests differ; errors of the transport.
    pub(crate) fn agree(&self, what: &str, digest: u64) -> Result<()> {
        match &self.portion {
            Some(p) => Ok(agree(p.communicator(), what, digest)?),
            None => Ok(()),
        }
    }

    /// Checks that communication between ranks works.
    ///
    /// # Errors
    /// The first failure of the transport. All later collective operations fail.
    pub fn check_communication(&self) -> Result<()> {
        let failure = self.portion.as_ref().and_then(|p| p.failure());
        failure.map_or(Ok(()), |e| Err(e.clone().into()))
    }
}
