//! Cracks: sets of broken bonds near each other, with the number of their bonds in overlaps.
//!
//! Two broken bonds belong to the same crack if their middles are at most [`NEAR`] times the longer bond's
//! length apart. In a lattice this reaches the next bond of a plane crack; in a packing about twenty bonds
//! are that near.

use nalgebra::Vector3;
use std::collections::HashMap;

/// Number of a crack's bonds in overlaps from which on it has run into the overlap.
///
/// A crack breaks two bonds per square of a particle's diameter, so this is an area of three such squares.
/// Strengths scatter, so that single bonds break far from every crack. Of 20 stray bonds at random among 5
/// 000, two are near each other in half of the draws, four in 2 of 1 000 and six in none of 6 000; of 50, six
/// in 3 of 1 000.
pub const CRACK: usize = 6;

/// Largest distance of two broken bonds of one crack, from middle to middle, over the longer bond's length.
const NEAR: f64 = 1.1;

/// A broken bond.
#[derive(Debug)]
struct Broken {
    place: Vector3<f64>,
    length: f64,
    /// Another bond of the same crack; the bond itself if it represents the crack.
    parent: usize,
    /// Number of the crack's bonds in overlaps; valid for the bond that represents the crack.
    in_overlap: usize,
}

/// All broken bonds, sorted by position.
#[derive(Debug, Default)]
pub(super) struct Cracks {
    bonds: Vec<Broken>,
    /// Bonds in each cube with edges of `edge` \[m\].
    cubes: HashMap<[i64; 3], Vec<usize>>,
    edge: f64,
    longest: f64,
}

impl Cracks {
    /// Adds a broken bond with its length \[m\] and middle \[m\]. Returns the number of bonds in overlaps of
    /// the crack that it belongs to.
    pub(super) fn add(&mut self, place: Vector3<f64>, length: f64, overlap: bool) -> usize {
        if self.bonds.is_empty() {
            // The first length only sizes the cubes: `near` looks as far as the longest bond reaches.
            self.edge = NEAR * length;
        }
        self.longest = self.longest.max(length);
        let new = self.bonds.len();
        self.bonds.push(Broken {
            place,
            length,
            parent: new,
            in_overlap: usize::from(overlap),
        });
        // The order of joins decides which bond represents a crack, but no count.
        for neighbour in self.near(new) {
            self.join(neighbour, new);
        }
        // After the search, which would find the bond itself otherwise.
        self.cubes.entry(self.cube(&place)).or_default().push(new);
        let crack = self.representative(new);
        self.bonds[crack].in_overlap
    }

    fn cube(&self, place: &Vector3<f64>) -> [i64; 3] {
        [0, 1, 2].map(|c: usize| (place[c] / self.edge).floor() as i64)
    }

    /// Broken bonds near a new one that is not yet in a cube.
    fn near(&self, new: usize) -> Vec<usize> {
        let bond = &self.bonds[new];
        let reach = (NEAR * self.longest / self.edge).ceil() as i64;
        let [x, y, z] = self.cube(&bond.place);
        let around = |c: i64| c - reach..=c + reach;
        let cubes = around(x).flat_map(|a| around(y).flat_map(move |b| around(z).map(move |c| [a, b, c])));
        let candidates = cubes.filter_map(|cube| self.cubes.get(&cube)).flatten().copied();
        let is_near = |candidate: &usize| {
            let candidate = &self.bonds[*candidate];
            (candidate.place - bond.place).norm() <= NEAR * candidate.length.max(bond.length)
        };
        candidates.filter(is_near).collect()
    }

    fn join(&mut self, first: usize, second: usize) {
        let [first, second] = [first, second].map(|bond| self.representative(bond));
        if first != second {
            self.bonds[first].in_overlap += self.bonds[second].in_overlap;
            self.bonds[second].parent = first;
        }
    }

    /// Returns the bond that represents the crack of `bond`.
    fn representative(&mut self, bond: usize) -> usize {
        let mut last = bond;
        while self.bonds[last].parent != last {
            // Halves the path, so that the next search is shorter.
            let next = self.bonds[last].parent;
            self.bonds[last].parent = self.bonds[next].parent;
            last = next;
        }
        last
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x: f64, y: f64) -> Vector3<f64> {
        Vector3::new(x, y, 0.0)
    }

    #[test]
    fn bonds_in_overlaps_are_counted_by_crack_whatever_their_order() {
        // A plane crack of a lattice with one bond outside of the overlap, and two stray bonds.
        let bonds: Vec<(Vector3<f64>, bool)> = (0..5)
            .map(|k| (at(0.0, f64::from(k)), k != 2))
            .chain([(at(3.0, 0.0), true), (at(0.0, 7.0), true)])
            .collect();
        for turn in 0..bonds.len() {
            let mut cracks = Cracks::default();
            let mut counts: Vec<usize> = Vec::new();
            for k in 0..bonds.len() {
                let (place, overlap) = bonds[(3 * k + turn) % bonds.len()];
                counts.push(cracks.add(place, 1.0, overlap));
            }
            assert_eq!(counts.iter().max(), Some(&4), "{turn}: {counts:?}");
            // Joins the crack and the last stray bond.
            assert_eq!(cracks.add(at(0.0, 5.0), 1.0, true), 5, "{turn}");
            assert_eq!(cracks.add(at(0.0, 6.0), 1.0, true), 7, "{turn}");
        }
    }

    #[test]
    fn the_longer_of_two_bonds_says_what_is_near() {
        let mut cracks = Cracks::default();
        assert_eq!(cracks.add(at(0.0, 0.0), 1.0, true), 1);
        assert_eq!(cracks.add(at(3.0, 0.0), 1.0, true), 1);
        assert_eq!(cracks.add(at(-3.0, 0.0), 3.0, true), 2);
        assert_eq!(cracks.add(at(6.0, 0.0), 3.0, true), 2);
    }
}
