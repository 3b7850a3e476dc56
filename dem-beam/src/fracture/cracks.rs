//! Broken bonds that are near each other: cracks, and how many of their bonds lie in an overlap.
//!
//! Two broken bonds belong to the same crack if their middles are no farther apart than [`NEAR`] times the
//! longer of them is long: in a lattice that is the next bond of a plane crack, in a packing about twenty
//! bonds are so near.

use nalgebra::Vector3;
use std::collections::HashMap;

/// Broken bonds of one crack in overlaps from which on the crack has run into the overlap. A crack breaks two
/// bonds per square of a particle's diameter, so these are three such squares of it. Strengths scatter, so
/// that single bonds break far from every crack: of 20 stray bonds at random among 5 000, two are near each
/// other in half of the draws, four in 2 of 1 000 and six in none of 6 000; of 50, six in 3 of 1 000.
pub const CRACK: usize = 6;

/// Distance of the middles over the length of a bond up to which broken bonds belong to one crack.
const NEAR: f64 = 1.1;

/// A broken bond.
#[derive(Debug)]
struct Broken {
    place: Vector3<f64>,
    length: f64,
    /// Another bond of the crack, itself for the one that stands for it.
    parent: usize,
    /// Bonds of the crack that lie in overlaps, for the one that stands for it.
    in_overlap: usize,
}

/// Broken bonds by their places.
#[derive(Debug, Default)]
pub(super) struct Cracks {
    bonds: Vec<Broken>,
    /// Bonds in cubes of the edge `edge` \[m\].
    cubes: HashMap<[i64; 3], Vec<usize>>,
    edge: f64,
    longest: f64,
}

impl Cracks {
    /// Adds a broken bond of a length \[m\] with its middle at a place \[m\], in an overlap or not; the bonds
    /// in overlaps of the crack that it belongs to.
    pub(super) fn add(&mut self, place: Vector3<f64>, length: f64, overlap: bool) -> usize {
        if self.bonds.is_empty() {
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
        for other in self.near(new) {
            self.join(other, new);
        }
        self.cubes.entry(self.cube(&place)).or_default().push(new);
        let crack = self.representative(new);
        self.bonds[crack].in_overlap
    }

    fn cube(&self, place: &Vector3<f64>) -> [i64; 3] {
        [0, 1, 2].map(|c: usize| (place[c] / self.edge).floor() as i64)
    }

    /// Bonds near one that is in no cube yet.
    fn near(&self, new: usize) -> Vec<usize> {
        let bond = &self.bonds[new];
        let reach = (NEAR * self.longest / self.edge).ceil() as i64;
        let [x, y, z] = self.cube(&bond.place);
        let around = |c: i64| c - reach..=c + reach;
        let cubes = around(x).flat_map(|a| around(y).flat_map(move |b| around(z).map(move |c| [a, b, c])));
        let all = cubes.filter_map(|cube| self.cubes.get(&cube)).flatten().copied();
        let is_near = |other: &usize| {
            let other = &self.bonds[*other];
            (other.place - bond.place).norm() <= NEAR * other.length.max(bond.length)
        };
        all.filter(is_near).collect()
    }

    fn join(&mut self, first: usize, second: usize) {
        let [first, second] = [first, second].map(|bond| self.representative(bond));
        if first != second {
            self.bonds[first].in_overlap += self.bonds[second].in_overlap;
            self.bonds[second].parent = first;
        }
    }

    /// The bond that stands for the crack of another.
    fn representative(&mut self, bond: usize) -> usize {
        let mut last = bond;
        while self.bonds[last].parent != last {
            // The next search is shorter.
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
            // It joins the crack and the last stray bond.
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
