//! Compressed rows: a list of entries for each of many items, in one flat array.

/// Row `i` lists the entries of item `i`: elements of a node, bonds of a particle, neighbours.
///
/// ```
/// use arlequin_core::adjacency::Adjacency;
/// let bonds = Adjacency::of_pairs(3, &[[0, 2], [1, 0]]);
/// assert_eq!(bonds.row(0), [[2, 0], [1, 1]]);
/// let elements = Adjacency::of_slots(4, &[0, 1, 2, 2, 1, 3]);
/// assert_eq!(elements.row(1), [1, 4]);
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Adjacency<E = u32> {
    starts: Vec<usize>,
    entries: Vec<E>,
}

impl<E: Copy + Default> Adjacency<E> {
    /// Sorts pairs `(row, entry)` into `count` rows; entries of one row keep their order. Rows must lie below
    /// `count`.
    pub fn new(count: usize, entries: impl Iterator<Item = (u32, E)> + Clone) -> Self {
        // Counting sort: linear, and stable, so entries of a row keep their order.
        let mut starts = vec![0; count + 1];
        entries.clone().for_each(|(row, _)| starts[row as usize + 1] += 1);
        for i in 0..count {
            starts[i + 1] += starts[i];
        }
        let mut next = starts.clone();
        let mut sorted = vec![E::default(); starts[count]];
        for (row, entry) in entries {
            sorted[next[row as usize]] = entry;
            next[row as usize] += 1;
        }
        Self {
            starts,
            entries: sorted,
        }
    }
}

impl<E> Adjacency<E> {
    /// Joins rows, one after the other.
    pub fn from_rows<R: IntoIterator<Item = E>>(rows: impl IntoIterator<Item = R>) -> Self {
        let (mut starts, mut entries) = (vec![0], Vec::new());
        for row in rows {
            entries.extend(row);
            starts.push(entries.len());
        }
        Self { starts, entries }
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// Returns whether there is no row.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Index of the first entry of row `i` in [`Self::entries`]; `i` may be the number of rows.
    pub fn start(&self, i: usize) -> usize {
        self.starts[i]
    }

    /// The entries of row `i`.
    pub fn row(&self, i: usize) -> &[E] {
        &self.entries[self.starts[i]..self.starts[i + 1]]
    }

    /// All rows, one after the other.
    pub fn entries(&self) -> &[E] {
        &self.entries
    }

    /// Sorts the entries of every row.
    #[must_use]
    pub fn sorted(mut self) -> Self
    where
        E: Ord,
    {
        for range in self.starts.windows(2) {
            self.entries[range[0]..range[1]].sort_unstable();
        }
        self
    }
}

impl Adjacency<[u32; 2]> {
    /// Row of each of `count` items: for each of its pairs the other end and the number of the pair, in the
    /// order of the pairs.
    pub fn of_pairs(count: usize, pairs: &[[u32; 2]]) -> Self {
        let ends = |(p, &[i, j]): (usize, &[u32; 2])| [(i, [j, p as u32]), (j, [i, p as u32])];
        Self::new(count, pairs.iter().enumerate().flat_map(ends))
    }
}

impl Adjacency {
    /// Row of each of `count` items: its positions in `slots`, ascending.
    pub fn of_slots(count: usize, slots: &[u32]) -> Self {
        Self::new(
            count,
            slots
                .iter()
                .enumerate()
                .map(|(position, &k)| (k, position as u32)),
        )
    }
}

/// Smallest number of any item that each of `count` items is connected with, directly or through others.
/// `pairs` are the connections; their numbers must lie below `count`.
pub fn lowest_connected(count: usize, pairs: impl Iterator<Item = [u32; 2]>) -> Vec<u32> {
    fn root(parent: &mut [u32], mut i: u32) -> u32 {
        while parent[i as usize] != i {
            // Path halving, which keeps trees flat.
            parent[i as usize] = parent[parent[i as usize] as usize];
            i = parent[i as usize];
        }
        i
    }
    let mut parent: Vec<u32> = (0..count as u32).collect();
    for [i, j] in pairs {
        // Roots are the smallest numbers of their trees.
        let (i, j) = (root(&mut parent, i), root(&mut parent, j));
        parent[i.max(j) as usize] = i.min(j);
    }
    (0..count as u32).map(|i| root(&mut parent, i)).collect()
}

#[cfg(test)]
mod tests {
    use super::lowest_connected;

    #[test]
    fn pieces_are_what_bonds_connect_whatever_their_order() {
        let bonds = [[4, 2], [5, 6], [2, 0], [6, 4]];
        assert_eq!(lowest_connected(8, bonds.into_iter()), [0, 1, 0, 3, 0, 0, 0, 7]);
        assert_eq!(
            lowest_connected(8, bonds.into_iter().rev()),
            [0, 1, 0, 3, 0, 0, 0, 7]
        );
        assert_eq!(lowest_connected(3, std::iter::empty()), [0, 1, 2]);
    }
}
