//! Values of a few of many places.

/// Values of the places that have one; the others take four bytes each.
#[derive(Debug, Clone, Default)]
pub(crate) struct Sparse<V> {
    /// For each place, one more than the number of its value, or zero if it has none.
    slots: Vec<u32>,
    /// Values, each with its place.
    values: Vec<(usize, V)>,
}

impl<V: Copy + Default> Sparse<V> {
    /// `len` places without values.
    pub(crate) fn new(len: usize) -> Self {
        Self {
            slots: vec![0; len],
            values: Vec::new(),
        }
    }

    /// Gives the number of places; new ones have no value.
    pub(crate) fn resize(&mut self, len: usize) {
        self.slots.resize(len, 0);
    }

    /// Returns the value of place `k`, or the default value.
    pub(crate) fn get(&self, k: usize) -> V {
        match self.slots[k] {
            0 => V::default(),
            slot => self.values[slot as usize - 1].1,
        }
    }

    /// Returns the value of place `k`, which becomes the default value if it has none.
    pub(crate) fn get_mut(&mut self, k: usize) -> &mut V {
        if self.slots[k] == 0 {
            self.values.push((k, V::default()));
            self.slots[k] = self.values.len() as u32;
        }
        &mut self.values[self.slots[k] as usize - 1].1
    }

    /// Removes the value of place `k` and returns it, or the default value.
    pub(crate) fn take(&mut self, k: usize) -> V {
        let slot = std::mem::take(&mut self.slots[k]);
        if slot == 0 {
            return V::default();
        }
        let (_, value) = self.values.swap_remove(slot as usize - 1);
        // The last value has moved into the gap.
        if let Some((moved, _)) = self.values.get(slot as usize - 1) {
            self.slots[*moved] = slot;
        }
        value
    }

    /// Returns the places that have a value, in no particular order, with the values.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (usize, V)> {
        self.values.iter().copied()
    }
}

impl<V: Copy + Default> FromIterator<V> for Sparse<V> {
    /// Every place gets a value.
    fn from_iter<I: IntoIterator<Item = V>>(values: I) -> Self {
        let values: Vec<(usize, V)> = values.into_iter().enumerate().collect();
        Self {
            slots: (1..=values.len() as u32).collect(),
            values,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Sparse;

    #[test]
    fn places_keep_their_values_while_others_come_and_go() {
        let (mut sparse, mut dense) = (Sparse::<f64>::new(50), vec![0.0_f64; 50]);
        for n in 0..2000_usize {
            let k = n * n * 7 % 53 % 50;
            if n % 3 == 0 {
                assert_eq!(sparse.take(k).to_bits(), std::mem::take(&mut dense[k]).to_bits());
            } else {
                *sparse.get_mut(k) += n as f64;
                dense[k] += n as f64;
            }
            let same = (0..50).all(|k| sparse.get(k).to_bits() == dense[k].to_bits());
            assert!(same, "after {n} changes");
        }
        let count = dense.iter().filter(|x| **x > 0.0).count();
        assert_eq!(sparse.iter().count(), count);
        assert!(sparse.iter().all(|(k, x)| x.to_bits() == dense[k].to_bits()));
    }
}
