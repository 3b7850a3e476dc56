//! Own steps between reflections conserve energy and momentum for any ratio; with one own step per macro step
//! in all models the scheme is the one-step scheme.

#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]

use crate::support::line::short;
use arlequin::core::effect::{BodyForce, Load, MassDamping};
use arlequin::core::nalgebra::{self, DMatrix, DVector, Vector3};
use arlequin::core::{
    Coupled, Error, InterfaceOptions, OwnStep, PrescribedMotion, Silent, Solver, Subdomain, TimeFunction,
    TimeStep, Weighting, Weights,
};
use arlequin::dem_beam::packing::{Lattice, lattice};
use arlequin::dem_beam::{BeamMaterial, DemModel};
use arlequin_studies::line::{COARSE, FINE, Line, rest};
use arlequin_studies::{cantilever, waves};

fn dense(c: &Coupled<f64>, side: usize) -> DMatrix<f64> {
    let k = c.subdomains()[side].model().views().linear.unwrap().stiffness();
    let mut out = DMatrix::zeros(k.rows(), k.cols());
    k.iter().for_each(|(v, (i, j))| out[(i, j)] += *v);
    out
}

/// RATTLE in its textbook form: all models in one vector, `B` over both, one step for all.
struct Reference {
    stiffness: DMatrix<f64>,
    inverse: DVector<f64>,
    jump: DMatrix<f64>,
    operator: nalgebra::Cholesky<f64, nalgebra::Dyn>,
    q: DVector<f64>,
    v: DVector<f64>,
    a: DVector<f64>,
    dt: f64,
}

impl Reference {
    fn new(c: &Coupled<f64>) -> Self {
        let sides = c.subdomains();
        let counts = [COARSE, FINE].map(|k| sides[k].state().q.len());
        let n = counts[0] + counts[1];
        let mut stiffness = DMatrix::zeros(n, n);
        let multipliers = c.interfaces()[0].multipliers().len();
        let mut jump: DMatrix<f64> = DMatrix::zeros(multipliers, n);
        for (k, first, sign) in [(COARSE, 0, 1.0), (FINE, counts[0], -1.0)] {
            stiffness
                .view_mut((first, first), (counts[k], counts[k]))
                .copy_from(&dense(c, k));
            let b = c.interfaces()[0].coupling_matrix(k).unwrap();
            b.iter().for_each(|(v, (i, j))| jump[(i, first + j)] += sign * *v);
        }
        let both_sides =
            |values: &dyn Fn(usize) -> Vec<f64>| DVector::from_vec([values(COARSE), values(FINE)].concat());
        let inverse = both_sides(&|k| sides[k].inverse_inertia().to_vec());
        let operator = (&jump * DMatrix::from_diagonal(&inverse) * jump.transpose())
            .cholesky()
            .unwrap();
        let (q, v) = (
            both_sides(&|k| sides[k].state().q.clone()),
            both_sides(&|k| sides[k].state().v.clone()),
        );
        let mut out = Self {
            a: q.clone(),
            dt: c.dt(),
            stiffness,
            inverse,
            jump,
            operator,
            q,
            v,
        };
        out.a = out.free();
        out.a = &out.a - out.projected(&out.a);
        out
    }

    fn free(&self) -> DVector<f64> {
        -(&self.stiffness * &self.q).component_mul(&self.inverse)
    }

    fn projected(&self, x: &DVector<f64>) -> DVector<f64> {
        let lambda = self.operator.solve(&(&self.jump * x));
        (self.jump.transpose() * lambda).component_mul(&self.inverse)
    }

    fn step(&mut self) {
        self.q += &self.v * self.dt + &self.a * (0.5 * self.dt * self.dt);
        let free = self.free();
        let predicted = &self.v + (&self.a + &free) * (0.5 * self.dt);
        let change = self.projected(&predicted);
        self.v = predicted - &change;
        self.a = free - change * (2.0 / self.dt);
    }
}

/// Advances a run and the reference side by side and asserts the same motion.
fn assert_same_motion(mut c: Coupled<f64>, steps: usize) {
    let mut reference = Reference::new(&c);
    for _ in 0..steps {
        c.run(1, &mut Silent).unwrap();
        reference.step();
    }
    let sides = c.subdomains();
    let ours =
        |values: &dyn Fn(usize) -> Vec<f64>| DVector::from_vec([values(COARSE), values(FINE)].concat());
    let (q, v) = (
        ours(&|k| sides[k].state().q.clone()),
        ours(&|k| sides[k].state().v.clone()),
    );
    let worst = |a: &DVector<f64>, b: &DVector<f64>| (a - b).amax() / b.amax();
    assert!(worst(&q, &reference.q) < 1e-12, "{:e}", worst(&q, &reference.q));
    assert!(worst(&v, &reference.v) < 1e-12, "{:e}", worst(&v, &reference.v));
}

#[test]
fn one_own_step_each_is_the_one_step_scheme_to_round_off() {
    let line = Line {
        step: TimeStep::Seconds(0.9),
        ..short()
    };
    assert_same_motion(waves::random_state(&line, [2, 1]).unwrap(), 1000);
}

/// Models that are strained at rest at the start: their accelerations differ, so that half a reflection is
/// due before the first step; the start is that of the one-step scheme to round-off.
#[test]
fn a_start_with_accelerations_is_that_of_the_one_step_scheme_to_round_off() {
    let line = Line {
        step: TimeStep::Seconds(0.9),
        ..short()
    };
    let bump = |x: f64| ((-((x + 15.0) / 30.0).powi(2)).exp(), 0.0);
    let start = || line.build(&bump, &bump).unwrap();
    let reference = Reference::new(&start());
    let due = reference.projected(&reference.free()).amax() / reference.free().amax();
    assert!(due > 0.1, "{due}");
    for steps in [1, 2, 500] {
        assert_same_motion(start(), steps);
    }
}

/// Runs 20 000 units of time from a random state of high frequency in both models. Velocities are differences
/// of noise, because a drift would cost digits of the displacements and thus of the forces.
fn long_run(step: f64, own_steps: [OwnStep<f64>; 2]) -> Coupled<f64> {
    long_run_of(&short(), step, own_steps)
}

fn long_run_of(line: &Line, step: f64, own: [OwnStep<f64>; 2]) -> Coupled<f64> {
    let line = Line {
        step: TimeStep::Seconds(step),
        own,
        ..line.clone()
    };
    let shaken = line.subdomains(&rest, &rest).unwrap().into_iter().zip([2, 1]);
    let shaken = shaken.map(|(s, seed)| {
        let mut next = arlequin_studies::noise(seed);
        let noise: Vec<f64> = s.model().nodes().iter().map(|_| next()).collect();
        let n = noise.len();
        let v = (0..n).map(|k| noise[k] - noise[(k + 1) % n]).collect();
        s.with_initial(vec![0.0; n], v).unwrap()
    });
    let mut c = line.build_with(shaken.collect()).unwrap();
    c.run((20_000.0 / step) as usize, &mut Silent).unwrap();
    c
}

#[test]
fn a_random_state_loses_and_gains_nothing_for_any_number_of_own_steps() {
    for m in 1..=10 {
        let c = long_run(0.9 * f64::from(m), [OwnStep::Same, OwnStep::Ratio(m as usize)]);
        assert!(c.drift() < 1e-11, "H, {m} own steps: {:e}", c.drift());
        let change = c.bodies()[0].drift[0];
        assert!(change < 1e-12, "momentum, {m} own steps: {change:e}");
        assert!(
            c.constraint_residual() < 1e-12,
            "{m}: {:e}",
            c.constraint_residual()
        );
        let start = c.last_energy().unwrap();
        assert!(start.kinetic > 10.0, "something moves: {}", start.kinetic);
    }
}

#[test]
fn an_implicit_bar_far_above_its_explicit_limit_loses_and_gains_nothing() {
    let c = long_run(50.0, [OwnStep::Implicit, OwnStep::Fraction(0.9)]);
    assert_eq!(c.subdomains()[FINE].own_steps(), 56);
    let limit = c.critical_steps()[COARSE];
    assert!((c.dt() / limit - 5.0).abs() < 0.01, "{} of {limit}", c.dt());
    assert!(c.drift() < 1e-11, "H: {:e}", c.drift());
    assert!(
        c.bodies()[0].drift[0] < 1e-12,
        "momentum: {:e}",
        c.bodies()[0].drift[0]
    );
}

#[test]
fn multipliers_by_a_few_iterations_cost_no_energy_and_no_momentum() {
    for max_iterations in [2, 3, 5] {
        let solver = Solver::ConjugateGradients {
            tolerance: 0.0,
            max_iterations,
        };
        let options = InterfaceOptions {
            solver,
            ..InterfaceOptions::default()
        };
        let line = Line {
            options,
            mediator: 2.0,
            ..short()
        };
        let c = long_run_of(&line, 4.5, [OwnStep::Same, OwnStep::Ratio(5)]);
        let [drift, change] = [c.drift(), c.bodies()[0].drift[0]];
        assert!(drift < 1e-12, "H, {max_iterations} iterations: {drift:e}");
        assert!(
            change < 1e-12,
            "momentum, {max_iterations} iterations: {change:e}"
        );
        let residual = c.constraint_residual();
        assert!(
            residual > 1e-9,
            "{max_iterations} iterations are not enough for the constraint: {residual:e}"
        );
    }
}

/// A bar whose end is moved, with both models moved alike within the overlap, and a loaded and damped chain.
fn driven(own: [OwnStep<f64>; 2], step: f64) -> Coupled<f64> {
    let line = Line {
        own,
        step: TimeStep::Seconds(step),
        ..short()
    };
    let [bar, chain] = line.subdomains(&rest, &rest).unwrap();
    let motion = |dof: usize| PrescribedMotion {
        dofs: vec![dof],
        amplitude: 0.3,
        time: TimeFunction::SmoothPulse { duration: 200.0 },
    };
    let load = Load::on_dofs("pull", vec![(100, 0.05)], TimeFunction::Ramp { duration: 50.0 }).unwrap();
    let heavy = BodyForce::new(Vector3::new(1e-4, 0.0, 0.0)).unwrap();
    // Bar nodes at −10 j, particles at −40 + j.
    let bar = bar
        .with_support(motion(0))
        .with_support(motion(18))
        .with_effect(Box::new(heavy));
    let chain = chain
        .with_support(motion(20))
        .with_effect(Box::new(load))
        .with_effect(Box::new(MassDamping::new(1e-3).unwrap()));
    line.build_with(vec![bar, chain]).unwrap()
}

#[test]
fn works_of_supports_loads_and_dampings_close_the_ledger_for_any_own_steps() {
    let macro_step = OwnStep::Same;
    for (own_steps, step) in [
        ([macro_step, macro_step], 0.8),
        ([macro_step, OwnStep::Ratio(5)], 4.0),
        ([OwnStep::Ratio(3), OwnStep::Ratio(7)], 6.0),
        ([OwnStep::Implicit, OwnStep::Ratio(5)], 4.0),
        ([OwnStep::Implicit, OwnStep::Ratio(20)], 16.0),
    ] {
        let mut c = driven(own_steps, step);
        c.run((600.0 / step) as usize, &mut Silent).unwrap();
        assert!(c.drift() < 1e-11, "{own_steps:?}: {:e}", c.drift());
        let work = |name: &str| c.works().iter().find(|w| w.name == name).unwrap().work;
        let works = ["supports", "chain/pull", "bar/body-force", "chain/mass-damping"].map(work);
        assert!(works.iter().all(|w| w.abs() > 1e-4), "{own_steps:?}: {works:?}");
        assert!(
            work("constraint").abs() < 1e-12,
            "{own_steps:?}: {:e}",
            work("constraint")
        );
    }
}

#[test]
fn own_steps_and_the_implicit_scheme_converge_to_the_same_motion_with_the_second_order() {
    let at_end = |own_steps, step: f64| {
        let mut c = driven(own_steps, step);
        c.run((480.0 / step).round() as usize, &mut Silent).unwrap();
        c.subdomains()[FINE].state().q.clone()
    };
    let exact = at_end([OwnStep::Same, OwnStep::Same], 0.1);
    let top = exact.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    for coarse in [OwnStep::Same, OwnStep::Implicit] {
        let error = |step| {
            let motion = at_end([coarse, OwnStep::Ratio(5)], step);
            let gaps = exact.iter().zip(&motion).map(|(a, b)| (a - b).powi(2));
            (gaps.sum::<f64>() / exact.iter().map(|x| x * x).sum::<f64>()).sqrt()
        };
        let [wide, narrow] = [4.0, 2.0].map(error);
        assert!(wide < 0.05 && top > 1.0, "{coarse:?}: {wide}");
        assert!(wide / narrow > 3.0, "{coarse:?}: {wide} with 4, {narrow} with 2");
    }
}

/// The cheapest case of `benches/cantilever.rs`, which runs all of them to 10 ms, conserves energy for any
/// number of own steps of the finer side.
#[test]
fn a_cantilever_keeps_its_energy_for_any_own_steps_of_the_finer_side() {
    for ratio in [1, 2, 4] {
        let mut run = cantilever::build(0.2, 12.7e-3, ratio).unwrap();
        run.run(1000, &mut Silent).unwrap();
        assert!(run.drift() < 1e-12, "{ratio} own steps: {:e}", run.drift());
    }
}

#[test]
fn what_cannot_step_implicitly_is_refused_by_name() {
    let line = Line {
        step: TimeStep::Seconds(0.8),
        own: [OwnStep::Implicit; 2],
        ..short()
    };
    let [bar, chain] = line.subdomains(&rest, &rest).unwrap();
    let damped = chain.with_effect(Box::new(MassDamping::new(1e-3).unwrap()));
    let text = line
        .build_with(vec![bar, damped])
        .map(|_| ())
        .unwrap_err()
        .to_string();
    for word in [
        "'chain' cannot step implicitly",
        "'mass-damping'",
        "only dead loads",
        "let it step explicitly",
    ] {
        assert!(text.contains(word), "{text}");
    }
    let long = Line {
        step: TimeStep::Seconds(1e160),
        ..line.clone()
    };
    let text = long.build(&rest, &rest).map(|_| ()).unwrap_err().to_string();
    for word in ["'bar' cannot step implicitly by 1e160 s", "take a shorter step"] {
        assert!(text.contains(word), "{text}");
    }
    let nodal = Line {
        weighting: Weighting::Nodal,
        epsilon: 0.05,
        ..line
    };
    let text = nodal.build(&rest, &rest).map(|_| ()).unwrap_err().to_string();
    assert!(
        text.contains("nodal weights leave it no symmetric stiffness"),
        "{text}"
    );
    let packing = lattice(Lattice::Cubic, [3, 2, 2], 1e-3).unwrap();
    let beads = DemModel::new("beads", &packing, BeamMaterial::SILICA, 2200.0).unwrap();
    let beads = Subdomain::fine(beads, Weights::uncoupled()).with_step(OwnStep::Implicit);
    let text = Coupled::new(vec![beads], Vec::new(), TimeStep::Seconds(1e-9), None)
        .map(|_| ())
        .unwrap_err()
        .to_string();
    assert!(
        text.contains("'beads' cannot step implicitly: its particles turn"),
        "{text}"
    );
}

#[test]
fn own_steps_that_cannot_be_are_refused_by_name() {
    let fails = |own: [OwnStep<f64>; 2], step: TimeStep<f64>, words: &[&str]| {
        let error = Line { own, step, ..short() }
            .build(&rest, &rest)
            .map(|_| ())
            .unwrap_err();
        let text = error.to_string();
        assert!(words.iter().all(|w| text.contains(w)), "{text}");
        error
    };
    let (macro_step, chosen) = (OwnStep::Same, TimeStep::Chosen(0.9));
    fails(
        [macro_step, OwnStep::Ratio(0)],
        chosen,
        &["own steps of model 'chain'", "at least 1"],
    );
    for bad in [0.0, -0.5, 1.1, f64::NAN] {
        fails(
            [OwnStep::Fraction(bad), macro_step],
            chosen,
            &["own step of model 'bar'", "above 0 and at most 1"],
        );
    }
    let e = fails(
        [macro_step, OwnStep::Ratio(3)],
        TimeStep::Seconds(4.0),
        &[
            "1.333",
            "exceeds the critical step 1",
            "'chain'",
            "3 own steps",
            "at most 3",
            "at least 4 own steps",
        ],
    );
    assert!(
        matches!(
            e,
            Error::UnstableStep {
                steps: 3,
                needed: 4,
                ..
            }
        ),
        "{e}"
    );
    // A macro step with so many own steps would never end.
    for (own, step) in [
        ([macro_step, OwnStep::Ratio(1 << 40)], chosen),
        ([OwnStep::Fraction(1e-300), macro_step], chosen),
        (
            [OwnStep::Implicit, OwnStep::Fraction(1e-6)],
            TimeStep::Seconds(4.0),
        ),
    ] {
        let words = ["own steps of model", "at most 100000", "shorter steps of the run"];
        fails(own, step, &words);
    }
    let all_implicit = [OwnStep::Implicit, OwnStep::Implicit];
    fails(
        all_implicit,
        TimeStep::Fraction(0.9),
        &["no model has a critical step", "seconds"],
    );
}

#[test]
fn an_explicit_step_is_refused_as_soon_as_it_exceeds_the_critical_one() {
    for m in [1, 3] {
        let build = |dt| {
            let (own, step) = ([OwnStep::Same, OwnStep::Ratio(m)], TimeStep::Seconds(dt));
            Line { own, step, ..short() }.build(&rest, &rest)
        };
        let limit = build(0.5).unwrap().critical_steps()[FINE] * m as f64;
        for below in [1.0 - 1e-12, 1.0] {
            build(below * limit).unwrap();
        }
        for above in [1.0 + 1e-12, 1.0 + 1e-6, 1.04] {
            let e = build(above * limit).map(|_| ()).unwrap_err();
            let Error::UnstableStep { model, steps, .. } = &e else {
                panic!("{e}");
            };
            assert_eq!((model.as_str(), *steps), ("chain", m), "{above}");
        }
    }
}

#[test]
fn steps_are_chosen_from_the_critical_ones() {
    let chosen = |own: [OwnStep<f64>; 2], step| {
        let c = Line { own, step, ..short() }.build(&rest, &rest).unwrap();
        let steps: Vec<usize> = c.subdomains().iter().map(|s| s.own_steps()).collect();
        ((c.dt() * 1e3).round() / 1e3, steps)
    };
    let as_macro = OwnStep::Same;
    // The critical steps are 10 and 1.
    assert_eq!(
        chosen([as_macro, as_macro], TimeStep::Chosen(0.9)),
        (3.6, vec![1, 4])
    );
    // A tenth means a tenth of the finer model's critical step for its own step.
    assert_eq!(
        chosen([as_macro, as_macro], TimeStep::Chosen(0.1)),
        (0.4, vec![1, 4])
    );
    assert_eq!(
        chosen([as_macro, as_macro], TimeStep::Fraction(0.9)),
        (0.9, vec![1, 1])
    );
    // A given fraction is kept, and the macro step is still chosen for the reflections.
    assert_eq!(
        chosen([OwnStep::Fraction(0.25), as_macro], TimeStep::Chosen(0.9)),
        (3.6, vec![2, 4])
    );
    assert_eq!(
        chosen([OwnStep::Ratio(1), as_macro], TimeStep::Chosen(0.9)),
        (9.0, vec![1, 10])
    );
    assert_eq!(
        chosen([OwnStep::Ratio(1), OwnStep::Ratio(1)], TimeStep::Chosen(0.9)),
        (0.9, vec![1, 1])
    );
    assert_eq!(
        chosen([as_macro, OwnStep::Ratio(3)], TimeStep::Chosen(0.9)),
        (2.7, vec![1, 3])
    );
    assert_eq!(
        chosen([as_macro, OwnStep::Fraction(0.5)], TimeStep::Seconds(4.0)),
        (4.0, vec![1, 8])
    );
    assert_eq!(
        chosen([OwnStep::Implicit, as_macro], TimeStep::Chosen(0.9)),
        (3.6, vec![1, 4])
    );
    assert_eq!(
        chosen(
            [OwnStep::Fraction(0.5), OwnStep::Fraction(1.0)],
            TimeStep::Fraction(0.9)
        ),
        (5.0, vec![1, 5])
    );
}
