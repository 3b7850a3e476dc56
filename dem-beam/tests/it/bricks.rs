//! Lattices built in bricks equal plain lattices except for their numbering.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use arlequin_core::ranks::{Communicator, Division, Message, RankError, Reduction, UNIT};
use dem_beam::packing::{Bricks, Lattice, lattice};
use dem_beam::{BeamMaterial, DemModel, Piece};
use nalgebra::Vector3;
use std::collections::BTreeSet;
use std::sync::Arc;

/// Communicator of a single rank.
#[derive(Debug)]
struct Alone;

impl Communicator for Alone {
    fn rank(&self) -> usize {
        0
    }
    fn ranks(&self) -> usize {
        1
    }
    fn exchange(&self, _: &mut [Message]) -> Result<(), RankError> {
        Ok(())
    }
    fn reduce(&self, _: &mut [i64], _: Reduction) -> Result<(), RankError> {
        Ok(())
    }
    fn abandon(&self, _: &str) {}
}

const CASES: [(Lattice, [usize; 3]); 5] = [
    (Lattice::Cubic, [9, 10, 5]),
    (Lattice::BodyCentred, [11, 6, 9]),
    (Lattice::FaceCentred, [5, 9, 6]),
    (Lattice::BodyCentred, [16, 8, 8]),
    (Lattice::FaceCentred, [2, 2, 2]),
];

fn all_of(bricks: &Bricks) -> (Division, Piece) {
    let division = Division::bisect(bricks.particles(), &bricks.units(), 1).unwrap();
    let piece = bricks.piece(&division, 0, BeamMaterial::SILICA, 2200.0).unwrap();
    (division, piece)
}

/// Returns the ends of a bond in hundredths of a radius, the lower first.
fn ends(x: [[f64; 3]; 2], radius: f64) -> [[i64; 3]; 2] {
    let mut scaled = x.map(|x| x.map(|c| (100.0 * c / radius).round() as i64));
    scaled.sort_unstable();
    scaled
}

#[test]
fn bricks_have_the_particles_and_the_bonds_of_the_lattice() {
    let radius = 2e-3;
    for (kind, cells) in CASES {
        let plain = lattice(kind, cells, radius).unwrap();
        let bricks = Bricks::new(kind, cells, radius).unwrap();
        let (_, piece) = all_of(&bricks);
        let count = plain.positions.len();
        assert_eq!(
            (bricks.particles(), piece.pairs.len()),
            (count, plain.pairs.len()),
            "{kind:?}"
        );
        assert!(piece.numbers.iter().copied().eq(0..count as u32));
        let bonds = |x: &dyn Fn(u32) -> [f64; 3], pairs: &[[u32; 2]]| -> BTreeSet<_> {
            pairs.iter().map(|p| ends(p.map(x), radius)).collect()
        };
        let piece_bonds = bonds(&|i| piece.positions[i as usize].into(), &piece.pairs);
        let plain_bonds = bonds(&|i| plain.positions[i as usize].into(), &plain.pairs);
        assert!(piece_bonds == plain_bonds, "{kind:?} {cells:?}");
        let volume: f64 = piece.volumes.iter().sum();
        assert!((volume / plain.volume - 1.0).abs() < 1e-12);
    }
}

#[test]
fn units_of_bricks_are_those_of_the_model_and_lie_close_together() {
    for (kind, cells) in CASES {
        let bricks = Bricks::new(kind, cells, 1e-4).unwrap();
        let (division, piece) = all_of(&bricks);
        let model = DemModel::of_piece("lattice", piece, &division, Arc::new(Alone)).unwrap();
        let (lattice_units, model_units) = (bricks.units(), model.units());
        assert_eq!(lattice_units.len(), model_units.len());
        for (a, b) in lattice_units.iter().zip(&model_units) {
            assert!(
                (a.centre - b.centre).norm() < 1e-9 && (a.work - b.work).abs() < 1e-9,
                "{a:?} {b:?}"
            );
        }
    }
    // With full bricks a unit is a box of cells and touches at most six others through a face.
    let bricks = Bricks::new(Lattice::BodyCentred, [32, 32, 32], 1e-4).unwrap();
    let (_, piece) = all_of(&bricks);
    let cell = 2e-4 / 0.75_f64.sqrt();
    for unit in piece.positions.chunks(UNIT) {
        let low = unit.iter().fold(unit[0], |m, x| m.inf(x));
        let high = unit.iter().fold(unit[0], |m, x| m.sup(x));
        let extent = (high - low) / cell;
        assert!((extent - Vector3::new(7.5, 3.5, 3.5)).amax() < 1e-9, "{extent}");
    }
    let parts = Division::bisect(bricks.particles(), &bricks.units(), 8).unwrap();
    let part = bricks.piece(&parts, 0, BeamMaterial::SILICA, 2200.0).unwrap();
    // The first cube of 16 cells has three faces to others with 256 particles each, their edges and corner.
    assert_eq!(part.numbers.len() - bricks.particles() / 8, 3 * 256 + 3 * 16 + 1);
}

#[test]
fn lattices_that_make_no_sense_are_refused() {
    let refused = |cells, radius| {
        Bricks::new(Lattice::Cubic, cells, radius)
            .unwrap_err()
            .to_string()
    };
    assert!(refused([0, 3, 3], 1e-3).contains("particles of a lattice = 0 is outside"));
    assert!(refused([3, 3, 3], -1.0).contains("sphere radius = -1 is outside"));
    assert!(refused([1 << 20, 1 << 20, 1 << 20], 1e-3).contains("is outside 1 to 4294967294"));
    let bricks = Bricks::new(Lattice::Cubic, [8, 8, 8], 1e-3).unwrap();
    let longer = Bricks::new(Lattice::Cubic, [8, 8, 12], 1e-3).unwrap();
    let division = Division::bisect(longer.particles(), &longer.units(), 2).unwrap();
    let refused = bricks
        .piece(&division, 0, BeamMaterial::SILICA, 2200.0)
        .unwrap_err()
        .to_string();
    assert!(
        refused.contains("particles of the division has 768 entries where 512"),
        "{refused}"
    );
}
