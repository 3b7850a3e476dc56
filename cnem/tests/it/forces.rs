//! Matrix-free internal forces equal those of the assembled stiffness, with the same bits for any number of
//! threads.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::common::{block, largest, noise, silica};
use arlequin_core::geometry::Cell;
use arlequin_core::{LinearModel, Model, Weight};
use cnem::generate::Cylinder;
use cnem::natural::Interpolant;
use cnem::{CnemModel, Options, Stabilisation};
use nalgebra::{Point3, center};

/// Weight with an arbitrary value per cell.
struct Wave;
impl Weight<f64> for Wave {
    fn value(&self, x: &Point3<f64>) -> f64 {
        0.5 + 0.4 * (3.0 * x.x + 2.0 * x.y).sin()
    }
    fn mean(&self, cell: &Cell<f64>) -> f64 {
        let [low, high] = cell.bounds();
        self.value(&center(&low, &high))
    }
}

fn displacements(model: &CnemModel) -> Vec<f64> {
    let mut next = noise(3);
    (0..model.layout().dofs()).map(|_| 1e-3 * next()).collect()
}

/// Returns the forces, added to existing numbers, and the energy.
fn evaluate(model: &mut CnemModel) -> (Vec<f64>, f64) {
    let q = displacements(model);
    let mut f = vec![1.0; q.len()];
    model.add_internal_forces(&q, &mut f).unwrap();
    (f, model.internal_energy(&q))
}

/// Returns forces and energy from the assembled stiffness `K`: `1 − K q` and `½ qᵀ K q`.
fn assembled(model: &CnemModel) -> (Vec<f64>, f64) {
    let q = displacements(model);
    let mut product = vec![0.0; q.len()];
    model
        .stiffness()
        .iter()
        .for_each(|(k, (i, j))| product[i] += k * q[j]);
    let energy = q.iter().zip(&product).map(|(q, y)| 0.5 * q * y).sum();
    (product.iter().map(|y| 1.0 - y).collect(), energy)
}

#[test]
fn forces_and_energy_are_those_of_the_assembled_stiffness() {
    // An L-shape with nodes off the grid.
    let domain = block([4, 4, 3], 0.25, 0.2, 9, |i, j, _| i < 2 || j < 2);
    for kind in [Interpolant::Sibson, Interpolant::Laplace] {
        for stabilisation in [Stabilisation::None, Stabilisation::default()] {
            let options = Options {
                kind,
                stabilisation,
                ..Options::default()
            };
            let mut model = CnemModel::new("L", domain.clone(), silica(), options).unwrap();
            for weighted in [false, true] {
                if weighted {
                    model.set_internal_weight(&Wave).unwrap();
                }
                let ((fa, ea), (fb, eb)) = (assembled(&model), evaluate(&mut model));
                let difference: Vec<f64> = fa.iter().zip(&fb).map(|(a, b)| a - b).collect();
                let error = largest(&difference) / largest(&fa);
                assert!(error < 1e-12, "{kind:?} {stabilisation:?} {weighted}: {error:e}");
                let error = (ea / eb - 1.0).abs();
                assert!(error < 1e-12, "{kind:?} {stabilisation:?} {weighted}: {error:e}");
                // A second call is not affected by the first.
                assert_eq!(evaluate(&mut model), (fb, eb));
            }
        }
    }
}

#[test]
fn same_bits_for_any_number_of_threads() {
    let shape = Cylinder {
        jitter: 0.2,
        ..Cylinder::with_spacing([0.0, 8e-3], 1e-3, 0.3e-3).unwrap()
    };
    let domain = shape.domain().unwrap();
    assert!(domain.nodes().len() > 600, "large enough for threads");
    let mut model = CnemModel::new("beam", domain, silica(), Options::default()).unwrap();
    model.set_internal_weight(&Wave).unwrap();
    let results = [1, 2, 3].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let (f, e) = pool.unwrap().install(|| evaluate(&mut model));
        (f.iter().map(|x| x.to_bits()).collect::<Vec<_>>(), e.to_bits())
    });
    assert_eq!(results[0], results[1]);
    assert_eq!(results[0], results[2]);
}
