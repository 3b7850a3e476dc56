//! Parts of larger bodies: packed with their surroundings, cut off at their borders.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use dem_beam::packing::Around;
use dem_beam::{BeamMaterial, Container, Packing, PackingSpec, Surface};
use nalgebra::{Rotation3, Vector3};

/// Edge of the section, in units of the scale.
const SIDE: f64 = 6.0;
const LENGTH: f64 = 8.0;

/// Orientation, place and size of a body.
#[derive(Clone, Copy)]
struct Place {
    scale: f64,
    turn: Rotation3<f64>,
    shift: Vector3<f64>,
}

const AT_ORIGIN: fn() -> Place = || Place {
    scale: 1.0,
    turn: Rotation3::identity(),
    shift: Vector3::zeros(),
};

impl Place {
    fn point(&self, x: f64, y: f64, z: f64) -> Vector3<f64> {
        self.turn * Vector3::new(x, y, z) * self.scale + self.shift
    }

    fn unplaced(&self, x: &Vector3<f64>) -> Vector3<f64> {
        self.turn.inverse() * (x - self.shift) / self.scale
    }

    /// Returns a bar from `x = 0` to `length`: its points and triangles, the two at the far end last.
    fn bar(&self, length: f64) -> (Vec<Vector3<f64>>, Vec<[u32; 3]>) {
        let corners = (0..8).map(|k| {
            let coordinate = |bit: usize, far: f64| if k >> bit & 1 == 1 { far } else { 0.0 };
            self.point(coordinate(0, length), coordinate(1, SIDE), coordinate(2, SIDE))
        });
        let faces = [
            [0, 2, 6, 4],
            [0, 4, 5, 1],
            [2, 3, 7, 6],
            [0, 1, 3, 2],
            [4, 6, 7, 5],
            [1, 3, 7, 5],
        ];
        let halves = |[a, b, c, d]: [u32; 4]| [[a, b, c], [a, c, d]];
        (corners.collect(), faces.into_iter().flat_map(halves).collect())
    }

    /// Returns the container for spheres of mean diameter one in the first half of a bar.
    fn around(&self) -> Around {
        let (points, triangles) = self.bar(LENGTH);
        let border: Vec<_> = triangles[10..]
            .iter()
            .map(|t| t.map(|k| points[k as usize]))
            .collect();
        let part = Surface::oriented(points, triangles).unwrap();
        let (points, triangles) = self.bar(2.0 * LENGTH);
        let body = Surface::oriented(points, triangles).unwrap();
        Around::new(part, body, &border, 2.5 * self.scale).unwrap()
    }
}

/// Returns bonds per sphere, and mass per volume over the body's density, of the spheres between two
/// sections.
fn bonds_and_mass(packing: &Packing, place: &Place, low: f64, high: f64) -> [f64; 2] {
    let mut bonds = vec![0_u32; packing.radii.len()];
    packing
        .pairs
        .iter()
        .flatten()
        .for_each(|i| bonds[*i as usize] += 1);
    let body = packing.bonded(BeamMaterial::SILICA, 1.0).unwrap();
    let (mut count, mut degree, mut mass) = (0.0, 0.0, 0.0);
    for ((x, b), m) in packing.positions.iter().zip(&bonds).zip(body.mass()) {
        let x = place.unplaced(x);
        if (low..high).contains(&x.x) {
            count += 1.0;
            degree += f64::from(*b);
            mass += m;
        }
    }
    [
        degree / count,
        mass / ((high - low) * (SIDE * SIDE) * place.scale.powi(3)),
    ]
}

/// The report accounts for all spheres, and the cut packing represents the volume of the part.
#[test]
fn a_part_is_filled_with_its_margin_and_stands_for_its_own_volume() {
    let place = AT_ORIGIN();
    let around = place.around();
    let volume = SIDE * SIDE * (LENGTH + 2.5);
    assert!(
        (around.volume() / volume - 1.0).abs() < 0.01,
        "{}",
        around.volume() / volume
    );
    let count = (0.58 * volume / 0.556) as usize;
    let cut = PackingSpec::quench(Container::Around(Box::new(around)), count, 4)
        .build()
        .unwrap();
    assert_eq!(cut.report.beyond + cut.radii.len() + cut.report.dropped, count);
    assert!((cut.volumes().iter().sum::<f64>() / (SIDE * SIDE * LENGTH) - 1.0).abs() < 1e-12);
}

/// The packing of a part hardly depends on the body's orientation, place and unit of length.
#[test]
fn a_part_is_packed_alike_when_it_is_turned_far_away_and_in_other_units() {
    let places = [
        AT_ORIGIN(),
        Place {
            scale: 1e-6,
            turn: Rotation3::from_euler_angles(0.4, -0.7, 1.1),
            shift: Vector3::zeros(),
        },
        Place {
            scale: 1e-3,
            turn: Rotation3::from_euler_angles(1.2, 0.3, -0.5),
            shift: Vector3::new(1.0, -2.0, 3.0),
        },
        Place {
            scale: 1e3,
            turn: Rotation3::identity(),
            shift: Vector3::new(-1e6, 0.0, 1e6),
        },
    ];
    for place in places {
        let around = place.around();
        let share = around.volume() / (SIDE * SIDE * (LENGTH + 2.5) * place.scale.powi(3));
        assert!((share - 1.0).abs() < 0.04, "volume {share}");
        let packing = PackingSpec::quench(Container::Around(Box::new(around)), 394, 2)
            .build()
            .unwrap();
        let [bonds, mass] = bonds_and_mass(&packing, &place, 2.0, 6.0);
        assert!((5.9..6.9).contains(&bonds), "bonds inside {bonds}");
        assert!((mass - 1.0).abs() < 0.06, "mass inside {mass}");
        let beyond = |x: &Vector3<f64>| place.unplaced(x).x > LENGTH * (1.0 + 1e-9);
        assert!(!packing.positions.iter().any(beyond));
    }
}

#[test]
fn a_part_without_a_margin_is_refused() {
    let (points, triangles) = AT_ORIGIN().bar(1.0);
    let part = Surface::oriented(points, triangles).unwrap();
    let message = Around::new(part.clone(), part, &[], 0.0).unwrap_err().to_string();
    assert!(message.contains("margin"), "{message}");
}
