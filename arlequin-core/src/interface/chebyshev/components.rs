//! Tests of several components with one operator or with several.

use super::super::iterated::{Apply, Iterated, Method, Precondition};
use super::super::operator::{Operator, Wanted};
use super::super::sides::Sides;
use super::super::transfer::{Rows, Transfer};
use super::super::{Coupling, InterfaceOptions, Solver, advice};
use super::Chebyshev;
use crate::{Error, Real};
use sprs::TriMat;

/// Returns the operator for three multipliers of two components on four nodes, tied in pairs. `inverse`:
/// inverse masses, components interleaved.
fn of_components(inverse: &[f64], solver: Solver<f64>) -> (Coupling<f64>, Operator<f64>) {
    let mut coupled = TriMat::new((3, 4));
    (0..3).for_each(|i| (i..i + 2).for_each(|j| coupled.add_triplet(i, j, 1.0)));
    let coupling = Coupling {
        matrix: coupled.to_csr(),
        shared: 2,
    };
    let options = InterfaceOptions {
        solver,
        ..InterfaceOptions::default()
    };
    let wanted = Wanted {
        name: "tie",
        options: &options,
    };
    let operator = Operator::new(wanted, std::slice::from_ref(&coupling), &[inverse], 2).unwrap();
    (coupling, operator)
}

/// Components with light end nodes and with light middle nodes, in either order.
#[test]
fn bounds_are_those_of_all_components() {
    let [ends, middle] = [[1.0, 1e-3, 1e-3, 1.0], [1e-3, 1.0, 1.0, 1e-3]];
    for [first, second] in [[ends, middle], [middle, ends]] {
        let inverse: Vec<f64> = first.iter().zip(&second).flat_map(|(a, b)| [*a, *b]).collect();
        let (coupling, mut operator) = of_components(&inverse, Solver::chebyshev());
        let bounds = operator.chebyshev().unwrap().bounds;
        for w in [first, second] {
            let entry = |i: usize, j: usize| match i.abs_diff(j) {
                0 => w[i] + w[i + 1],
                1 => w[i.max(j)],
                _ => 0.0,
            };
            let scaled = |k: usize| entry(k / 3, k % 3) / (entry(k / 3, k / 3) * entry(k % 3, k % 3)).sqrt();
            let dense: Vec<f64> = (0..9).map(scaled).collect();
            let values = f64::symmetric_eigen(3, &dense).unwrap().values;
            assert!(
                bounds[0] <= values[0] && values[2] <= bounds[1],
                "{bounds:?} {values:?}"
            );
        }
        let mut sides = Sides::new(vec![Transfer::new(&coupling, 2, -1.0, &inverse)]);
        let b = [1.0, -0.3, 0.2, 0.7, -0.5, 0.1];
        let (mut x, mut image) = (b, [0.0; 6]);
        operator.solve(&mut x, &mut sides);
        sides.operator(&x, &mut image);
        assert!(
            b.iter().zip(&image).all(|(b, i)| (b - i).abs() < 1e-11),
            "{image:?}"
        );
        assert!(
            operator.iterations() == operator.chebyshev().unwrap().iterations
                && operator.check("tie").is_ok()
        );
    }
}

/// The moved masses are lighter than those for which the bounds were computed.
#[test]
fn an_iteration_that_grows_is_told_with_the_name_of_its_interface() {
    let inverse = [1.0, 2.0, 3.0, 1.0, 2.0, 1.5, 1.0, 3.0];
    let (coupling, mut operator) = of_components(&inverse, Solver::chebyshev());
    let lighter = inverse.map(|w| 4.0 * w);
    let mut sides = Sides::new(vec![Transfer::new(&coupling, 2, -1.0, &lighter)]);
    operator.solve(&mut [1.0, -0.3, 0.2, 0.7, -0.5, 0.1], &mut sides);
    let high = operator.chebyshev().unwrap().bounds[1];
    match operator.check("tie") {
        Err(Error::EigenvaluesBeyond {
            interface,
            iterations,
            growth,
            high: told,
        }) => {
            assert_eq!((&*interface, iterations), ("tie", operator.iterations()));
            assert!(
                growth > 2.0 && told.to_bits() == high.to_bits(),
                "{growth} {told}"
            );
        }
        other => panic!("{other:?}"),
    }
    // The next solve succeeds.
    let mut sides = Sides::new(vec![Transfer::new(&coupling, 2, -1.0, &inverse)]);
    operator.solve(&mut [1.0, -0.3, 0.2, 0.7, -0.5, 0.1], &mut sides);
    assert!(operator.check("tie").is_ok());
}

/// Divides by the diagonal.
struct Diagonal(f64);

impl Precondition<f64> for Diagonal {
    fn apply(&mut self, z: &mut [f64]) {
        z.iter_mut().for_each(|z| *z /= self.0);
    }
}

/// One component has a wave below the lower bound, one has short waves only, and one is zero.
#[test]
fn components_have_residuals_and_scalings_of_their_own() {
    const N: usize = 40;
    // Eigenvalues `1 − 0.99 cos(π k / (N + 1))`.
    let rows = || {
        (0..N).flat_map(|i| {
            (i.max(1) - 1..N.min(i + 2)).map(move |j| (i, j, if i == j { 1.0 } else { -0.495 }))
        })
    };
    let wave = |k: usize, i: usize| (std::f64::consts::PI * (k * (i + 1)) as f64 / (N + 1) as f64).sin();
    let long = |i: usize| wave(1, i) + 0.4 * wave(17, i) - 0.3 * wave(36, i);
    let short = |i: usize| wave(29, i) - 0.2 * wave(20, i);
    let none = |_: usize| 0.0;
    let parts: [&dyn Fn(usize) -> f64; 3] = [&long, &short, &none];
    let tolerance = 1e-9;
    let enough = Chebyshev::new([0.03, 2.0], tolerance, 1000);
    let few = Chebyshev {
        iterations: 3,
        ..enough
    };
    for (turn, (plan, limit)) in (0..3).flat_map(|t| [(t, (enough, 1000)), (t, (few, 3))]) {
        let b: Vec<f64> = (0..3 * N).map(|k| parts[(k + turn) % 3](k / 3)).collect();
        let mut x = b.clone();
        let apply = Apply::Rows(Rows::from_entries(N, rows()));
        let mut iterated = Iterated::new(apply, Method::Chebyshev(plan), [N, 3], (tolerance, limit));
        iterated.solve(&mut x, &mut Sides::new(Vec::new()), &mut Diagonal(1.0));
        assert!(iterated.broken.is_none());
        let mut r = b.clone();
        rows().for_each(|(i, j, v)| (0..3).for_each(|c| r[3 * i + c] -= v * x[3 * j + c]));
        let dot = |a: &[f64], b: &[f64], c: usize| (0..N).map(|i| a[3 * i + c] * b[3 * i + c]).sum::<f64>();
        for c in 0..3 {
            let work = dot(&x, &b, c);
            assert!(dot(&x, &r, c).abs() <= 1e-13 * work, "{turn} {c}, {limit}");
            assert_eq!(work > 0.0, (c + turn) % 3 < 2);
            let residual = dot(&r, &r, c).sqrt();
            assert!(
                limit < 1000 || residual <= 2.01 * tolerance * dot(&b, &b, c).sqrt(),
                "{turn} {c}: {residual:e}"
            );
        }
    }
}

#[test]
fn fewer_iterations_than_the_tolerance_takes_are_all_that_are_made_and_are_warned_of() {
    let inverse = [1.0, 2.0, 3.0, 1.0, 2.0, 1.5, 1.0, 3.0];
    let solved_with = |max_iterations| {
        let solver = Solver::Chebyshev {
            tolerance: 1e-9,
            max_iterations,
        };
        let (coupling, mut operator) = of_components(&inverse, solver);
        let mut sides = Sides::new(vec![Transfer::new(&coupling, 2, -1.0, &inverse)]);
        operator.solve(&mut [1.0, -0.3, 0.2, 0.7, -0.5, 0.1], &mut sides);
        let plan = operator.chebyshev().unwrap();
        assert_eq!(operator.iterations(), plan.iterations);
        plan
    };
    let (enough, few) = (solved_with(1000), solved_with(5));
    assert!(few.iterations == 5 && enough.iterations > 5 && few.bounds[0] > enough.bounds[0]);
    assert_eq!(advice::iteration_warning(&enough), None);
    let warning = advice::iteration_warning(&few).unwrap();
    let expected = format!(
        "5 iterations are allowed and the tolerance of a Chebyshev iteration takes {}:",
        enough.iterations
    );
    assert!(warning.starts_with(&expected), "{warning}");
}
