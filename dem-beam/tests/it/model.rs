//! The model behind the coupling traits: conformance, weights, threads, a run of the core alone.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use approx::{assert_abs_diff_eq, assert_relative_eq};
use arlequin_core::{
    CoarseModel, Coupled, FineModel, Guard, Model, NodallyWeighted, Partition, Silent, Subdomain, TimeStep,
    Uniform, Weight, Weights, conformance, spectrum,
};
use dem_beam::packing::{Lattice, lattice};
use dem_beam::{BeamMaterial, Container, DemModel, LoadShare, Packing, PackingSpec, Twist, critical};
use nalgebra::{Point3, Rotation3, Vector3};
use std::sync::OnceLock;

fn packing() -> &'static Packing {
    static P: OnceLock<Packing> = OnceLock::new();
    P.get_or_init(|| {
        PackingSpec::quench(Container::cylinder(6e-3, 1e-3).unwrap(), 1200, 3)
            .build()
            .unwrap()
    })
}

fn model() -> DemModel {
    DemModel::new("bar", packing(), BeamMaterial::SILICA, 2200.0).unwrap()
}

/// Weight that falls from 1 to `low` between x = 2.8 and 3.2 mm, over two to three particles.
#[derive(Debug)]
struct Steep {
    low: f64,
}

impl Weight<f64> for Steep {
    fn value(&self, x: &Point3<f64>) -> f64 {
        let s = ((x.x - 2.8e-3) / 0.4e-3).clamp(0.0, 1.0);
        1.0 - (1.0 - self.low) * s
    }
}

/// Returns deterministic noise in [-1, 1].
fn noise(i: usize) -> f64 {
    let mut z = (i as u64)
        .wrapping_add(0x9e37_79b9)
        .wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) as f64 / u64::MAX as f64) * 2.0 - 1.0
}

/// Returns random displacements \[m\] and rotations \[rad\].
fn random(model: &DemModel, linear: f64, angular: f64) -> Vec<f64> {
    let half = model.layout().translations();
    (0..2 * half)
        .map(|i| noise(i) * if i < half { linear } else { angular })
        .collect()
}

fn forces(model: &mut dyn Model<f64>, q: &[f64]) -> Vec<f64> {
    let mut f = vec![0.0; q.len()];
    model.add_internal_forces(q, &mut f).unwrap();
    f
}

#[test]
fn conformance_of_the_linear_law() {
    let mut m = model();
    assert!(conformance::rigid_forces(&mut m, 1e-6).unwrap() < 1e-12);
    let a = conformance::forces_derive_from_energy(&mut m, 1e-7).unwrap();
    assert!(a < 1e-8, "{a}");
    let volume = packing().volume;
    assert!(conformance::mass(&m, 2200.0 * volume).unwrap() < 1e-12);
    assert!(conformance::symmetric_forces(&mut m, 1e-6).unwrap() < 1e-12);
    m.set_internal_weight(&Steep { low: 0.01 }).unwrap();
    assert!(conformance::rigid_forces(&mut m, 1e-6).unwrap() < 1e-12);
    assert!(conformance::forces_derive_from_energy(&mut m, 1e-7).unwrap() < 1e-8);
    assert!(conformance::symmetric_forces(&mut m, 1e-6).unwrap() < 1e-12);
}

#[test]
fn finite_rotations_derive_from_energy_at_any_size() {
    let mut m = model().with_finite_rotations();
    assert!(m.views().linear.is_none() && m.has_finite_rotations());
    m.set_internal_weight(&Steep { low: 0.1 }).unwrap();
    for (u, turn) in [(1e-6, 0.05), (2e-5, 0.7), (5e-5, 2.0)] {
        let mut q = random(&m, u, turn);
        let mut f = vec![0.0; q.len()];
        m.advance(&q, &mut f).unwrap();
        let half = m.layout().translations();
        for (range, step) in [(0..half, 1e-10), (half..2 * half, 1e-6)] {
            let scale = f[range.clone()].iter().fold(0.0_f64, |a, f| a.max(f.abs()));
            for i in range.step_by(97) {
                let keep = q[i];
                q[i] = keep + step;
                let energy_above = m.internal_energy(&q);
                q[i] = keep - step;
                let energy_below = m.internal_energy(&q);
                q[i] = keep;
                let defect = ((energy_above - energy_below) / (2.0 * step) + f[i]).abs() / scale;
                assert!(defect < 1e-4, "{u} {turn} {i}: {defect}");
            }
        }
    }
}

#[test]
fn finite_law_ignores_rigid_motions_and_is_linear_for_small_ones() {
    let mut m = model().with_finite_rotations();
    let turn = Vector3::new(0.9, -0.4, 1.7);
    let rotation = Rotation3::from_scaled_axis(turn);
    let mut q: Vec<f64> = Vec::new();
    for x in m.nodes() {
        let u = rotation * x.coords - x.coords + Vector3::new(1e-3, 2e-3, -3e-3);
        q.extend(u.iter());
    }
    (0..m.nodes().len()).for_each(|_| q.extend(turn.iter()));
    let rigid = forces(&mut m, &q).iter().fold(0.0_f64, |a, f| a.max(f.abs()));
    let small = random(&m, 1e-12, 1e-8);
    let finite = forces(&mut m, &small);
    let linear = forces(&mut model(), &small);
    let half = finite.len() / 2;
    for r in [0..half, half..2 * half] {
        let scale = linear[r.clone()].iter().fold(0.0_f64, |a, f| a.max(f.abs()));
        let worst = r.map(|i| (finite[i] - linear[i]).abs()).fold(0.0, f64::max);
        assert!(worst < 1e-6 * scale, "{worst} of {scale}");
    }
    // Relative to the force of a rotation of 1e-3 rad per particle.
    let small_rotations = random(&m, 0.0, 1e-3);
    let scale = forces(&mut m, &small_rotations)
        .iter()
        .fold(0.0_f64, |a, f| a.max(f.abs()));
    assert!(rigid < 1e-10 * scale, "{rigid} of {scale}");
    // The same orientation after three more turns.
    let further = turn * (1.0 + 6.0 * std::f64::consts::PI / turn.norm());
    let first = 3 * m.nodes().len();
    (first..2 * first).for_each(|i| q[i] = further[i % 3]);
    let turned = forces(&mut m, &q).iter().fold(0.0_f64, |a, f| a.max(f.abs()));
    assert!(turned < 1e-10 * scale, "{turned} of {scale}");
}

#[test]
fn forces_equal_bare_bonds_in_the_packing_numbers() {
    for is_nodal in [false, true] {
        let m = model();
        let steep = Steep { low: 0.05 };
        let q = random(&m, 1e-7, 1e-3);
        let mut weighted: Box<dyn Model<f64>> = match is_nodal {
            true => Box::new(NodallyWeighted::new(Box::new(model()))),
            false => Box::new(model()),
        };
        weighted.set_internal_weight(&steep).unwrap();
        let f = forces(&mut *weighted, &q);
        let n = m.nodes().len();
        let mut body = packing().bonded(BeamMaterial::SILICA, 2200.0).unwrap();
        if !is_nodal {
            let mean = |&[i, j]: &[u32; 2]| {
                let [a, b] = [i, j].map(|i| Point3::from(body.positions()[i as usize]));
                steep.mean(&arlequin_core::geometry::Cell::Segment {
                    ends: [a, b],
                    section: 1.0,
                })
            };
            let means: Vec<f64> = body.pairs().iter().map(mean).collect();
            body.set_weights(&means).unwrap();
        }
        let vector = |x: &[f64], i: usize| Vector3::new(x[3 * i], x[3 * i + 1], x[3 * i + 2]);
        let state: Vec<Twist> = m
            .places()
            .iter()
            .map(|&p| Twist {
                linear: vector(&q, p as usize),
                angular: vector(&q, n + p as usize),
            })
            .collect();
        let mut plain = vec![Twist::zero(); n];
        body.add_forces(&state, &mut plain).unwrap();
        let size = |g: &dyn Fn(&Twist) -> f64| plain.iter().map(g).fold(0.0, f64::max);
        let (a, b) = (size(&|t| t.linear.norm()), size(&|t| t.angular.norm()));
        for (i, t) in plain.iter().enumerate() {
            let p = m.places()[i] as usize;
            assert!(m.order()[p] as usize == i);
            let w = if is_nodal { steep.value(&m.nodes()[p]) } else { 1.0 };
            assert!((vector(&f, p) - t.linear * w).norm() < 1e-12 * a);
            assert!((vector(&f, n + p) - t.angular * w).norm() < 1e-12 * b);
        }
    }
}

#[test]
fn stiffness_matrix_is_minus_the_forces() {
    let mut m = model();
    m.set_internal_weight(&Steep { low: 0.2 }).unwrap();
    let q = random(&m, 1e-7, 1e-3);
    let f = forces(&mut m, &q);
    let k = m.views().linear.unwrap().stiffness();
    let kq = product(&k, &q);
    let scale = f.iter().fold(0.0_f64, |a, f| a.max(f.abs()));
    for (f, k) in f.iter().zip(&kq) {
        assert!((f + k).abs() < 1e-12 * scale);
    }
    let energy = 0.5 * q.iter().zip(&kq).map(|(a, b)| a * b).sum::<f64>();
    assert_relative_eq!(energy, m.internal_energy(&q), epsilon = 0.0, max_relative = 1e-12);
    let mut nodal = NodallyWeighted::new(Box::new(m));
    nodal.set_internal_weight(&Steep { low: 0.2 }).unwrap();
    assert!(nodal.views().linear.is_none());
}

/// Weights down to 0.1 across two particles leave the critical step of the body unchanged. Below that a
/// particle with one heavy bond among light ones loses the averaging over its bonds, and up to 11 % of the
/// step. The core measures the step of the weighted model in any case.
#[test]
fn steep_weights_leave_the_critical_step() {
    let mut m = model();
    let step = |m: &mut dyn Model<f64>, w: &dyn Weight<f64>| {
        m.set_internal_weight(w).unwrap();
        let mut inertia = vec![0.0; m.layout().dofs()];
        m.lumped_inertia(w, &mut inertia).unwrap();
        let inverse: Vec<f64> = inertia.iter().map(|m| 1.0 / m).collect();
        m.critical_step(&inverse).unwrap()
    };
    let alone = step(&mut m, &Uniform(1.0));
    let body = packing().bonded(BeamMaterial::SILICA, 2200.0).unwrap();
    let lanczos = critical::lanczos(&body).unwrap();
    assert_relative_eq!(alone, lanczos, epsilon = 0.0, max_relative = 1e-4);
    for (low, least) in [
        (0.5, 0.9999),
        (0.1, 0.999),
        (0.05, 0.98),
        (0.01, 0.9),
        (1e-4, 0.87),
    ] {
        let steep = step(&mut m, &Steep { low });
        assert!(steep > least * alone, "low {low}: {}", steep / alone);
    }
    let nodal = step(&mut NodallyWeighted::new(Box::new(m)), &Steep { low: 0.01 });
    // Measured with the weighted masses, as constraints do, no longer with those of the body alone.
    assert!(nodal > 0.01 * alone && nodal < alone, "{}", nodal / alone);
}

/// Where most particles are held, the iteration leaves units of the kernel out and has short vectors. It
/// finds what the iteration over all forces finds.
#[test]
fn the_critical_step_of_a_few_free_particles_is_that_of_all_forces() {
    let cube = lattice(Lattice::BodyCentred, [14, 14, 14], 1e-4).unwrap();
    for finite in [false, true] {
        let mut m = DemModel::new("cube", &cube, BeamMaterial::SILICA, 2200.0).unwrap();
        // The iteration is on the linear law, whose forces hold for vectors of any size.
        let mut linear = DemModel::new("cube", &cube, BeamMaterial::SILICA, 2200.0).unwrap();
        if finite {
            m = m.with_finite_rotations();
        }
        let mut inertia = vec![0.0; m.layout().dofs()];
        m.lumped_inertia(&Uniform(1.0), &mut inertia).unwrap();
        let nodes = m.nodes().to_vec();
        let layout = m.layout();
        let inverse_inertia = |free: &dyn Fn(&Point3<f64>) -> bool| -> Vec<f64> {
            let value = |(i, m): (usize, &f64)| {
                if free(&nodes[layout.node_of(i)]) {
                    1.0 / m
                } else {
                    0.0
                }
            };
            inertia.iter().enumerate().map(value).collect()
        };
        for share in [0.1, 0.4] {
            let some = inverse_inertia(&|x| x.x < share * 14e-4);
            let all_forces =
                spectrum::critical_step(&some, &mut |q, f| linear.add_internal_forces(q, f)).unwrap();
            let step = m.critical_step(&some).unwrap();
            // Lanczos errs on the safe side by 5e-5.
            assert!(
                (step / all_forces - 1.0).abs() < 1e-4,
                "{share} {}",
                step / all_forces
            );
        }
        // Held along one axis, all particles still move along the others and turn.
        let mut guided = inverse_inertia(&|_| true);
        guided[..layout.translations()]
            .iter_mut()
            .step_by(3)
            .for_each(|w| *w = 0.0);
        let all_forces =
            spectrum::critical_step(&guided, &mut |q, f| linear.add_internal_forces(q, f)).unwrap();
        let step = m.critical_step(&guided).unwrap();
        assert!(
            (step / all_forces - 1.0).abs() < 1e-4,
            "guided {}",
            step / all_forces
        );
        // Nothing is left out afterwards.
        let (mut f, q) = (vec![0.0; layout.dofs()], vec![1e-6; layout.dofs()]);
        m.add_internal_forces(&q, &mut f).unwrap();
        let first = layout.translations();
        assert!(f[first..].iter().all(|t| *t != 0.0));
    }
}

#[test]
fn same_bits_for_any_thread_count() {
    // The cube is larger than the size from which a second thread is used.
    let cube = lattice(Lattice::BodyCentred, [14, 14, 14], 1e-4).unwrap();
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| {
            let small = DemModel::new("cube", &cube, BeamMaterial::SILICA, 2200.0).unwrap();
            let finite = DemModel::new("cube", &cube, BeamMaterial::SILICA, 2200.0).unwrap();
            let mut bits = Vec::new();
            for mut m in [small, finite.with_finite_rotations()] {
                let q = random(&m, 1e-6, 0.1);
                bits.extend(forces(&mut m, &q).iter().map(|f| f.to_bits()));
                bits.push(m.internal_energy(&q).to_bits());
            }
            bits
        })
    };
    let serial = run(1);
    assert!(serial == run(2) && serial == run(8));
}

/// The core's invariant of one subdomain without an interface does not drift over 1e5 steps at 0.9 of the
/// critical step.
#[test]
fn invariant_does_not_drift_over_1e5_steps() {
    let cube = lattice(Lattice::BodyCentred, [4, 4, 4], 1e-4).unwrap();
    let m = DemModel::new("cube", &cube, BeamMaterial::SILICA, 2200.0).unwrap();
    let v = random(&m, 1.0, 1e3);
    let zero = vec![0.0; v.len()];
    let s = Subdomain::fine(m, Weights::uncoupled())
        .with_initial(zero, v)
        .unwrap();
    let guard = Guard {
        interval: 100,
        growth: 0.05,
    };
    let mut run = Coupled::new(vec![s], Vec::new(), TimeStep::Fraction(0.9), Some(guard)).unwrap();
    run.run(100_000, &mut Silent).unwrap();
    assert!(run.drift() <= 1e-9, "{:e}", run.drift());
}

#[test]
fn finite_rotations_conserve_energy_in_the_core() {
    let cube = lattice(Lattice::BodyCentred, [4, 4, 4], 1e-4).unwrap();
    let m = DemModel::new("cube", &cube, BeamMaterial::SILICA, 2200.0)
        .unwrap()
        .with_finite_rotations();
    let mut v = random(&m, 1.0, 0.0);
    let n = m.nodes().len();
    for (i, x) in m.nodes().iter().enumerate() {
        let spin = Vector3::new(0.0, 0.0, 2e4);
        let u = spin.cross(&x.coords);
        (0..3).for_each(|c| v[3 * i + c] += u[c]);
        (0..3).for_each(|c| v[3 * (n + i) + c] += spin[c]);
    }
    let zero = vec![0.0; v.len()];
    let s = Subdomain::coarse(m, Weights::uncoupled())
        .with_initial(zero, v)
        .unwrap();
    let mut run = Coupled::new(vec![s], Vec::new(), TimeStep::Fraction(0.3), None).unwrap();
    let begin = run.momentum();
    let steps = (4.0 / 2e4 / run.dt()) as usize;
    run.run(steps, &mut Silent).unwrap();
    assert!(run.drift() < 1e-3, "{:e}", run.drift());
    let end = run.momentum();
    assert!((end[0] - begin[0]).norm() < 1e-10 * begin[0].norm());
}

/// The coupling uses displacements only: rotations follow them in the vector and have no shape functions.
#[test]
fn rotations_are_not_coupled() {
    let m = model();
    let l = m.layout();
    assert_eq!((l.components, l.rotations, l.translations()), (3, 3, 3 * l.nodes));
    for field in [m.fine_field(), m.coarse_field()] {
        assert_eq!((field.nodes().len(), field.kind()), (l.nodes, "particle"));
        let samples = field.samples().unwrap();
        let total: f64 = samples.iter().map(|s| s.measure).sum();
        assert_relative_eq!(total, packing().volume, epsilon = 0.0, max_relative = 1e-12);
    }
    // A rotation of one particle pushes its neighbours.
    let mut m = m;
    let mut q = vec![0.0; l.dofs()];
    q[l.translations() + 3] = 1e-3;
    assert!(
        forces(&mut m, &q)[..l.translations()]
            .iter()
            .any(|f| f.abs() > 0.0)
    );
}

#[test]
fn selections_and_loads() {
    let m = model();
    let wall = m.clamp_layer(&Point3::origin(), &Vector3::x());
    assert!(
        wall.len() > 20 && wall.iter().all(|&i| m.nodes()[i].x < 0.25e-3),
        "{}",
        wall.len()
    );
    assert_eq!(m.clamped(&wall).len(), 6 * wall.len());
    assert_eq!(
        m.rotations(&[2], [true, false, true]),
        [m.layout().translations() + 6, m.layout().translations() + 8]
    );
    let end = m.select(|x| x.x > 5.7e-3);
    for share in [LoadShare::Mass, LoadShare::Area] {
        let load = m.force(&end, Vector3::new(1000.0, 0.0, 0.0), share).unwrap();
        assert_abs_diff_eq!(load.iter().map(|(_, f)| f).sum::<f64>(), 1000.0, epsilon = 1e-9);
        let load = m.torque(&end, Vector3::new(2.0, -1.0, 0.5), share).unwrap();
        let (mut force, mut moment) = (Vector3::zeros(), Vector3::zeros());
        for c in load.chunks(3) {
            let f = Vector3::new(c[0].1, c[1].1, c[2].1);
            force += f;
            moment += m.nodes()[c[0].0 / 3].coords.cross(&f);
        }
        assert!(force.norm() < 1e-9 && (moment - Vector3::new(2.0, -1.0, 0.5)).norm() < 1e-12);
    }
    let empty_load = m
        .force(&[], Vector3::x(), LoadShare::Mass)
        .unwrap_err()
        .to_string();
    assert!(empty_load.contains("load on 0 particles"), "{empty_load}");
    let message = m
        .torque(&[4], Vector3::x(), LoadShare::Mass)
        .unwrap_err()
        .to_string();
    assert!(message.contains("lie on a line"), "{message}");
    let text = m.report().to_string();
    assert!(
        text.contains("bar: ") && text.contains("packing: coordination 6.2"),
        "{text}"
    );
}

fn product(k: &sprs::CsMat<f64>, q: &[f64]) -> Vec<f64> {
    k.outer_iterator()
        .map(|row| row.iter().map(|(c, v)| v * q[c]).sum())
        .collect()
}

/// A body at rest with finite rotations is not stopped: lengths are differences of places, whose round-off
/// leaves small forces, and their sum is no growth of energy.
#[test]
fn a_body_at_rest_with_finite_rotations_is_not_stopped_for_its_last_digits() {
    for size in [1.0, 1e-9, 1e6] {
        let mut packing = packing().clone();
        packing
            .positions
            .iter_mut()
            .for_each(|x| *x = (*x + Vector3::repeat(3e-3)) * size);
        packing.radii.iter_mut().for_each(|r| *r *= size);
        let model = DemModel::new("bar", &packing, BeamMaterial::SILICA, 2200.0)
            .unwrap()
            .with_finite_rotations();
        let side = Subdomain::fine(model, Weights::uncoupled());
        let guard = Guard {
            interval: 1,
            ..Guard::for_weighting(arlequin_core::Weighting::Energy)
        };
        let mut run = Coupled::new(vec![side], Vec::new(), TimeStep::Fraction(0.9), Some(guard)).unwrap();
        run.run(300, &mut Silent).unwrap();
        let sample = run.last_energy();
        eprintln!("{size}: {sample:?}");
    }
}

/// Returns the bits of the forces at the displacements `q`.
fn state_after_forces(model: &mut DemModel, q: &[f64]) -> Vec<u64> {
    let mut f = vec![0.0; q.len()];
    model.advance(q, &mut f).unwrap();
    f.iter().map(|f| f.to_bits()).collect()
}

/// A model that has evaluated forces and then gets weights, a law or a record gives the same bits as a new
/// model with them.
#[test]
fn a_model_that_has_found_forces_is_like_a_new_one_after_other_weights_laws_and_records() {
    let light = Steep { low: 0.2 };
    for finite in [false, true] {
        let make = || match finite {
            true => model().with_finite_rotations(),
            false => model(),
        };
        let (q, second_state) = (random(&make(), 1e-6, 0.3), random(&make(), -2e-6, 0.2));
        let plain = state_after_forces(&mut make(), &q);
        let mut new = make();
        new.set_internal_weight(&light).unwrap();
        let weighted = state_after_forces(&mut new, &q);
        assert_ne!(plain, weighted);
        let mut late = make();
        state_after_forces(&mut late, &second_state);
        late.set_internal_weight(&light).unwrap();
        assert_eq!(state_after_forces(&mut late, &q), weighted, "finite {finite}");

        let mut late = model();
        state_after_forces(&mut late, &second_state);
        if finite {
            late = late.with_finite_rotations();
        }
        assert_eq!(state_after_forces(&mut late, &q), plain, "finite {finite}");

        let mut late = make();
        state_after_forces(&mut late, &second_state);
        late.restore(&make().save()).unwrap();
        assert_eq!(state_after_forces(&mut late, &q), plain, "finite {finite}");

        let mut still = make();
        state_after_forces(&mut still, &vec![0.0; q.len()]);
        let energies = [make(), still].map(|m| m.internal_energy(&q).to_bits());
        assert_eq!(energies[0], energies[1], "finite {finite}");
    }
}

/// A step given in seconds below the bound of the blocks is accepted as it is; every other step has the
/// critical step of Lanczos.
#[test]
fn a_step_below_the_bound_is_accepted_without_the_spectrum() {
    let run = |step: TimeStep<f64>| {
        let weights = Weights::from_weight(std::sync::Arc::new(Steep { low: 0.05 }));
        let side = Subdomain::fine(model(), weights).with_partition(Partition::Unchecked);
        Coupled::new(vec![side], Vec::new(), step, None)
    };
    let automatic = run(TimeStep::Fraction(0.9)).unwrap();
    let critical = automatic.critical_steps()[0];
    assert_eq!(automatic.plan().bounded, [false]);
    let short = run(TimeStep::Seconds(0.5 * critical)).unwrap();
    let bound = short.critical_steps()[0];
    assert_eq!(short.plan().bounded, [true]);
    assert!(
        bound > 0.6 * critical && bound < 0.9 * critical,
        "{}",
        bound / critical
    );
    for (share, is_bound) in [(0.999_999, true), (1.000_001, false)] {
        let plan = run(TimeStep::Seconds(share * bound)).unwrap().plan();
        assert_eq!(plan.bounded, [is_bound], "{share}");
    }
    let long = run(TimeStep::Seconds(0.95 * critical)).unwrap();
    assert_eq!(long.critical_steps(), [critical]);
    assert!(run(TimeStep::Seconds(1.01 * critical)).is_err());
}
