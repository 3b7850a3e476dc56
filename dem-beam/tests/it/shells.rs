//! Several shells in one surface, as files contain them: bodies that touch, cavities that touch the wall,
//! crossings.

use dem_beam::{Error, Surface};
use nalgebra::Vector3;

/// Returns a surface of boxes, given by their lowest corner and edges \[mm\]; each has triangles of arbitrary
/// orientation.
fn boxes(blocks: &[([f64; 3], [f64; 3])]) -> Result<Surface, Error> {
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for (low, edges) in blocks {
        let first = vertices.len() as u32;
        vertices.extend((0..8).map(|i| {
            Vector3::from_fn(|k, _| 1e-3 * (low[k] + if i >> k & 1 == 1 { edges[k] } else { 0.0 }))
        }));
        for f in [
            [0, 1, 3, 2],
            [4, 6, 7, 5],
            [0, 4, 5, 1],
            [2, 3, 7, 6],
            [0, 2, 6, 4],
            [1, 5, 7, 3],
        ] {
            let [a, b, c, d] = f.map(|i: u32| first + i);
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    Surface::oriented(vertices, triangles)
}

fn volumes(surface: &Surface) -> Vec<f64> {
    surface.bodies().iter().map(|b| b.volume() * 1e9).collect()
}

#[test]
fn a_body_that_stands_on_a_face_of_another_is_a_body_on_each_of_six_faces() {
    let cube = ([0.0; 3], [10.0; 3]);
    for axis in 0..3 {
        for position in [-2.0, 10.0] {
            for [u, v] in [[4.0, 4.0], [0.0, 0.0], [4.0, 8.0], [3.3, 1.7]] {
                let mut low = [0.0; 3];
                (low[axis], low[(axis + 1) % 3], low[(axis + 2) % 3]) = (position, u, v);
                for order in [[cube, (low, [2.0; 3])], [(low, [2.0; 3]), cube]] {
                    let measured = volumes(&boxes(&order).unwrap());
                    let wanted = order.map(|b| b.1[0].powi(3));
                    assert_eq!(measured.len(), 2, "{low:?}");
                    for (f, w) in measured.iter().zip(wanted) {
                        assert!((f / w - 1.0).abs() < 1e-12, "{low:?}: {measured:?}");
                    }
                }
            }
        }
    }
}

#[test]
fn cavities_that_touch_the_wall_from_within_are_cavities() {
    for low in [[0.0, 4.0, 4.0], [8.0, 4.0, 4.0], [4.0, 0.0, 8.0], [8.0, 8.0, 8.0]] {
        let measured = volumes(&boxes(&[([0.0; 3], [10.0; 3]), (low, [2.0; 3])]).unwrap());
        assert!(
            measured.len() == 1 && (measured[0] / 992.0 - 1.0).abs() < 1e-12,
            "{measured:?}"
        );
    }
}

#[test]
fn shells_that_cross_are_refused_with_a_point() {
    for low in [[9.0, 4.0, 4.0], [-1.0, -1.0, -1.0], [4.0, 4.0, 9.5]] {
        let result = boxes(&[([0.0; 3], [10.0; 3]), (low, [2.0; 3])]);
        assert!(
            matches!(
                result,
                Err(Error::CrossingBodies {
                    first: 1,
                    second: 2,
                    ..
                })
            ),
            "{low:?}: {result:?}"
        );
    }
}
