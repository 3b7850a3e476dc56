//! Zones that move along a bar in space: elements or particles under elements of another size.

use crate::support::solid::{block, material, mediator};
use arlequin::core::conformance;
use arlequin::core::effect::PairSpec;
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::core::{
    Coupled, Error, Guard, InterfaceOptions, InterfaceSpec, L2, Model, OwnStep, Parts, Profile, Ramp, Result,
    Rezoned, Rezoning, Sampling, Silent, Slab, Subdomain, TimeStep, Weights,
};
use arlequin::dem_beam::fracture::{SharedLog, locked};
use arlequin::dem_beam::{BeamMaterial, Criterion, DemModel, Fracture, Matter};
use arlequin::fem_ref::{Elastic, ElementKind, FemModel};
use arlequin_studies::noise;
use std::sync::Arc;

/// Length of the bar, of a ramp, and of the zone between the ramps.
const LENGTH: f64 = 10.0;
const RAMP: f64 = 1.5;
const ZONE: f64 = 2.0;

/// The fine model of a bar with a unit section.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Fine {
    Hexahedra,
    Tetrahedra,
    Spheres,
}

const ALL: [Fine; 3] = [Fine::Hexahedra, Fine::Tetrahedra, Fine::Spheres];

fn ends(from: f64) -> [[f64; 2]; 2] {
    [[from, from - RAMP], [from + ZONE, from + ZONE + RAMP]]
}

pub(crate) fn weights(from: f64) -> [Weights<f64>; 2] {
    weights_of(from, &Profile::Cubic)
}

pub(crate) fn weights_of(from: f64, profile: &Profile<f64>) -> [Weights<f64>; 2] {
    let point = |x: f64| Point3::new(x, 0.0, 0.0);
    let ramps = ends(from).map(|[fine, coarse]| {
        let slab = Slab::between(point(fine), point(coarse)).unwrap();
        Weights::from_weight(Arc::new(Ramp::new(Arc::new(slab), profile.clone(), 0.0).unwrap()))
    });
    let fine = Weights::complement_of(&ramps);
    [Weights::complement_of(std::slice::from_ref(&fine)), fine]
}

/// A cubic lattice of spheres, four across, with beams between neighbours. The zone moves by two layers, so
/// that the masses of the two models change by equal amounts.
pub(crate) fn lattice() -> DemModel {
    lattice_with(&|_| true)
}

/// The lattice with some of its bonds, which are named by the centres of their spheres.
fn lattice_with(keep: &dyn Fn([&Vector3<f64>; 2]) -> bool) -> DemModel {
    let (n, h) = (4, 0.25);
    let long = (LENGTH / h).round() as usize;
    let mut positions = Vec::new();
    for i in 0..long {
        for j in 0..n {
            let at = |k: usize| Vector3::new(i as f64, j as f64, k as f64).add_scalar(0.5) * h;
            positions.extend((0..n).map(at));
        }
    }
    let mut pairs = Vec::new();
    for i in 0..positions.len() {
        for step in [1, n, n * n] {
            let near = positions
                .get(i + step)
                .map(|x: &Vector3<f64>| (x - positions[i]).norm());
            if near.is_some_and(|d| d < 1.01 * h) && keep([&positions[i], &positions[i + step]]) {
                pairs.push([i as u32, (i + step) as u32]);
            }
        }
    }
    // One beam for each square of the section: E_b π r_b² = E h² gives the lattice the stiffness of the bar,
    // E = 1. One that is 1.4 times as stiff holds other energies for the same pulse, and gains up to 0.17.
    let radius_ratio = 0.71_f64;
    let matter = Matter {
        beam: BeamMaterial {
            young: 1.0 / (std::f64::consts::PI * (0.5 * radius_ratio).powi(2)),
            poisson: 0.3,
            radius_ratio,
        },
        density: 1.0,
        volume: LENGTH,
    };
    let radii = vec![0.5 * h; positions.len()];
    DemModel::from_spheres("fine", &positions, &radii, &pairs, &matter).unwrap()
}

/// Displacement, velocity and (for particles) rotation and spin of a motion at a place.
pub(crate) type Motion<'a> = &'a mut dyn FnMut(&Point3<f64>) -> [Vector3<f64>; 4];

fn with_state(s: Subdomain<f64>, motion: Motion<'_>) -> Subdomain<f64> {
    let layout = s.model().layout();
    let (mut q, mut v) = (vec![0.0; layout.dofs()], vec![0.0; layout.dofs()]);
    let first = layout.translations();
    for (k, x) in s.model().nodes().iter().enumerate() {
        let [u, w, turn, spin] = motion(x);
        q[3 * k..3 * k + 3].copy_from_slice(u.as_slice());
        v[3 * k..3 * k + 3].copy_from_slice(w.as_slice());
        if layout.turns() {
            let o = first + 3 * k;
            q[o..o + 3].copy_from_slice(turn.as_slice());
            v[o..o + 3].copy_from_slice(spin.as_slice());
        }
    }
    s.with_initial(q, v).unwrap()
}

pub(crate) struct Bar {
    pub(crate) fine: Fine,
    pub(crate) own: usize,
    /// Elements of the fine model along and across the bar.
    pub(crate) counts: [usize; 3],
    pub(crate) step: TimeStep<f64>,
}

/// Meshes of which no nodes coincide but on the surfaces.
const APART: [usize; 3] = [33, 3, 3];
/// Half as long as the elements of the bar, whose nodes are nodes of this mesh too.
pub(crate) const NESTED: [usize; 3] = [40, 4, 4];

impl Bar {
    pub(crate) fn new(fine: Fine, own: usize) -> Self {
        Self {
            fine,
            own,
            counts: APART,
            step: TimeStep::Fraction(0.5),
        }
    }

    pub(crate) fn interfaces(&self, from: f64) -> Vec<InterfaceSpec<f64>> {
        let sampling = match self.fine {
            Fine::Spheres => Sampling::Particles,
            _ => Sampling::Intersection,
        };
        let tie = |(name, [a, b]): (&str, [f64; 2])| {
            let space = mediator(ElementKind::Hex8, [a.min(b), a.max(b)], [3, 2, 2]);
            let mut spec = InterfaceSpec::new(name, 0, 1, space, L2);
            spec.options = InterfaceOptions {
                sampling,
                ..InterfaceOptions::default()
            };
            spec
        };
        ["left", "right"].into_iter().zip(ends(from)).map(tie).collect()
    }

    pub(crate) fn build(&self, from: f64, motion: Motion<'_>) -> Coupled<f64> {
        self.build_of(self.bodies(from, motion).into(), from, Vec::new())
    }

    /// The bar and the fine model with a motion.
    pub(crate) fn bodies(&self, from: f64, motion: Motion<'_>) -> [Subdomain<f64>; 2] {
        self.weighted_bodies(weights(from), motion)
    }

    pub(crate) fn weighted_bodies(
        &self,
        [coarse, fine]: [Weights<f64>; 2],
        motion: Motion<'_>,
    ) -> [Subdomain<f64>; 2] {
        let mesh = block(ElementKind::Hex8, [0.0, LENGTH], [20, 2, 2]);
        let law = match self.fine {
            Fine::Spheres => Elastic::new(1.0, 0.0, 1.0).unwrap(),
            _ => material(),
        };
        let bar = Subdomain::coarse(FemModel::new("bar", mesh, law).unwrap(), coarse).with_sleep();
        let elements = |kind| {
            let mesh = block(kind, [0.0, LENGTH], self.counts);
            Subdomain::fine(FemModel::new("fine", mesh, law).unwrap(), fine.clone())
        };
        let fine = match self.fine {
            Fine::Hexahedra => elements(ElementKind::Hex8),
            Fine::Tetrahedra => elements(ElementKind::Tet4),
            Fine::Spheres => Subdomain::fine(lattice(), fine),
        };
        let fine = fine.with_sleep().with_step(OwnStep::Ratio(self.own));
        [with_state(bar, motion), with_state(fine, motion)]
    }

    /// Builds a run of the bar, the fine model and more, with effects between them.
    pub(crate) fn build_of(
        &self,
        subdomains: Vec<Subdomain<f64>>,
        from: f64,
        pairs: Vec<PairSpec<f64>>,
    ) -> Coupled<f64> {
        let guard = Guard {
            interval: 1,
            growth: 0.05,
        };
        let parts = Parts {
            start: 0.0,
            end: None,
            subdomains,
            interfaces: self.interfaces(from),
            pairs,
        };
        Coupled::from_parts(parts, self.step, Some(guard)).unwrap()
    }

    fn rezone(&self, run: &mut Coupled<f64>, from: f64) -> Result<Rezoned<f64>> {
        let [coarse, fine] = weights(from);
        run.rezone(
            Rezoning::new(self.interfaces(from))
                .with_weights(0, coarse)
                .with_weights(1, fine),
        )
    }

    /// Moves the zone to and fro by half an element each time, with some steps between; returns the sum of
    /// moduli, the gains and the largest energy, relative to that of the start.
    fn carry(&self, run: &mut Coupled<f64>, changes: usize, steps: usize) -> [f64; 3] {
        let (mut start, mut out) = (None, [0.0; 3]);
        for n in 1..=changes {
            run.run(steps, &mut Silent).unwrap();
            let invariant = run.last_energy().unwrap().invariant;
            let start = *start.get_or_insert(invariant);
            let change = self.rezone(run, place(n)).unwrap();
            out[0] += change.work.abs() / start;
            out[1] += change.work.max(0.0) / start;
            out[2] = f64::max(out[2], (invariant + change.work) / start);
        }
        out
    }
}

/// Beginning of the zone after `n` changes: between 2 and 5.5, by half a length each.
pub(crate) fn place(n: usize) -> f64 {
    let turn = n % 14;
    2.0 + 0.5 * turn.min(14 - turn) as f64
}

fn random(seed: u64) -> impl FnMut(&Point3<f64>) -> [Vector3<f64>; 4] {
    let mut next = noise(seed);
    move |_| {
        let zero = Vector3::zeros();
        let mut vector = || Vector3::new(next(), next(), next());
        [zero, vector(), zero, vector()]
    }
}

/// Momentum and energy of a rigid motion know the first and second moments of the masses. Lumped masses of
/// nested meshes have the same moments wherever the zone is; others have not, and turn the body a little.
#[test]
fn rigid_flight_with_spin_does_no_work_in_space() {
    let (flight, spin) = (Vector3::new(0.3, -0.2, 0.5), Vector3::new(0.4, 0.7, -0.3));
    for fine in ALL {
        // A way to and fro has 14 changes; those of tetrahedra take longest.
        let many = if fine == Fine::Tetrahedra { 28 } else { 100 };
        for (own, counts, spin, changes, limit) in [
            (1, NESTED, spin, many, 1e-11),
            (4, NESTED, spin, 14, 1e-11),
            (1, APART, Vector3::zeros(), 14, 1e-7),
            (1, APART, spin, 14, 1e-3),
        ] {
            let bar = Bar {
                counts,
                ..Bar::new(fine, own)
            };
            let mut rigid = |x: &Point3<f64>| {
                let zero = Vector3::zeros();
                [zero, flight + spin.cross(&x.coords), zero, spin]
            };
            let mut run = bar.build(place(0), &mut rigid);
            let start = run.energy();
            let mut most = [0.0f64; 5];
            for n in 1..=changes {
                run.run(3, &mut Silent).unwrap();
                let c = bar.rezone(&mut run, place(n)).unwrap();
                let parts = [c.work, c.potential, c.kinetic, c.rigid, c.start];
                (0..5).for_each(|k| most[k] = most[k].max(parts[k].abs() / start));
            }
            let drift = run.bodies()[0].drift;
            println!("{fine:?}, m = {own}, {counts:?}: W and parts {most:?} E, momenta {drift:?}");
            assert!(most[0] < limit, "{fine:?}: {most:?}");
            assert!(drift[0] < 1e-12 && drift[1] < 1e-12, "{fine:?}: {drift:?}");
            assert!(run.drift() < 1e-11, "{fine:?}: {:e}", run.drift());
        }
    }
}

#[test]
fn uniform_strain_stays_what_it_is_in_space() {
    let strain = Vector3::new(1e-3, -0.25e-3, -0.25e-3);
    for fine in [Fine::Hexahedra, Fine::Tetrahedra] {
        let bar = Bar::new(fine, 1);
        let mut stretched = |x: &Point3<f64>| {
            let zero = Vector3::zeros();
            [x.coords.component_mul(&strain), zero, zero, zero]
        };
        let mut run = bar.build(place(0), &mut stretched);
        let start = run.energy();
        let mut most = 0.0f64;
        for n in 1..=100 {
            let c = bar.rezone(&mut run, place(n)).unwrap();
            most = most.max(c.potential.abs());
            let others = [c.kinetic, c.rigid].map(f64::abs);
            assert!(others[0].max(others[1]) < 1e-20, "{others:?}");
        }
        assert!(most < 1e-11 * start, "{fine:?}: {:e}", most / start);
        for s in run.subdomains() {
            for (k, x) in s
                .model()
                .nodes()
                .iter()
                .enumerate()
                .filter(|(k, _)| !s.is_asleep(*k))
            {
                let u = Vector3::from_column_slice(&s.state().q[3 * k..3 * k + 3]);
                let apart = (u - x.coords.component_mul(&strain)).norm();
                assert!(apart < 1e-12, "'{}' at {x}: {apart:e}", s.model().name());
            }
        }
    }
}

#[test]
fn random_states_and_pulses_gain_next_to_nothing_in_space() {
    for fine in ALL {
        for own in [1, 4] {
            // With own steps, the share of the start in `W` grows as the square of the coarse step.
            let bar = Bar {
                step: TimeStep::Fraction(if own == 1 { 0.5 } else { 0.3 }),
                ..Bar::new(fine, own)
            };
            let mut run = bar.build(place(0), &mut random(3));
            let [moduli, gains, top] = bar.carry(&mut run, 28, 6);
            println!(
                "{fine:?}, m = {own}: random Σ|W| {moduli:.2e} gains {gains:.2e} top {top:.4} drift {:.1e}",
                run.drift()
            );
            assert!(
                gains < 2.5e-3 && top < 1.0,
                "{fine:?}: gains {gains:e}, top {top}"
            );
            assert!(run.drift() < 1e-10, "{:e}", run.drift());
            // A pulse as short as a ramp, and one of twice its length.
            for (width, centre, limit) in [(1.5, 3.0, 1e-3), (3.0, 3.5, 4e-3)] {
                let mut pulse = |x: &Point3<f64>| {
                    let zero = Vector3::zeros();
                    let y = (x.x - centre) / width;
                    let c = if y.abs() < 1.0 {
                        (0.5 * std::f64::consts::PI * y).cos().powi(4)
                    } else {
                        0.0
                    };
                    [zero, Vector3::new(c, 0.0, 0.0), zero, zero]
                };
                let mut run = bar.build(place(0), &mut pulse);
                let [moduli, gains, top] = bar.carry(&mut run, 28, 6);
                println!(
                    "{fine:?}, m = {own}: pulse of {width} Σ|W| {moduli:.2e} gains {gains:.2e} top {top:.4} drift {:.1e}",
                    run.drift()
                );
                assert!(gains < limit && top < 1.0, "{fine:?}: gains {gains:e}, top {top}");
                let drift = run.bodies()[0].drift;
                assert!(drift[0] < 1e-12 && drift[1] < 1e-12, "{drift:?}");
            }
        }
    }
}

#[test]
fn moving_zones_have_the_same_bits_on_any_number_of_threads() {
    for fine in ALL {
        let bits_on = |threads: usize| -> Vec<u64> {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            pool.install(|| {
                let bar = Bar::new(fine, 2);
                let mut run = bar.build(place(0), &mut random(5));
                bar.carry(&mut run, 6, 4);
                let states = run
                    .subdomains()
                    .iter()
                    .flat_map(|s| s.state().q.iter().chain(&s.state().v));
                let works = run.rezoning_works();
                states.chain(&works).map(|x| x.to_bits()).collect()
            })
        };
        let serial = bits_on(1);
        assert!(serial == bits_on(2) && serial == bits_on(3), "{fine:?}");
    }
}

/// A bar of elements and spheres whose bonds break, at random velocities.
fn brittle(fracture: Fracture) -> (Coupled<f64>, SharedLog) {
    let bar = Bar::new(Fine::Spheres, 1);
    let [coarse, fine] = weights(place(0));
    let mesh = block(ElementKind::Hex8, [0.0, LENGTH], [20, 2, 2]);
    let law = Elastic::new(1.0, 0.0, 1.0).unwrap();
    let motion = &mut random(3);
    let elements = Subdomain::coarse(FemModel::new("bar", mesh, law).unwrap(), coarse).with_sleep();
    let spheres = lattice().with_fracture(fracture).unwrap();
    let log = spheres.break_log();
    let spheres = Subdomain::fine(spheres, fine).with_sleep();
    let models = vec![with_state(elements, motion), with_state(spheres, motion)];
    let step = TimeStep::Fraction(0.5);
    let guard = Guard {
        interval: 1,
        growth: 0.05,
    };
    let run = Coupled::new(models, bar.interfaces(place(0)), step, Some(guard));
    (run.unwrap(), log)
}

#[test]
fn bonds_break_awake_alone_stay_broken_and_the_balance_closes() {
    let bar = Bar::new(Fine::Spheres, 1);
    let (mut run, log) = brittle(Fracture::new(Criterion::TensileEnergy, 2e-3));
    let mut before = Vec::new();
    let mut broke_in_zone = [0; 2];
    for k in 0..12 {
        let fine = weights(place(k))[1].clone();
        for _ in 0..6 {
            let seen = locked(&log).events().len();
            run.advance(&mut Silent).unwrap();
            for e in &locked(&log).events()[seen..] {
                let ends = e.pair.map(|i| run.subdomains()[1].model().nodes()[i as usize]);
                assert!(
                    ends.iter().any(|x| fine.internal.value(x) > 0.0),
                    "a bond slept and broke at {:?}",
                    e.place
                );
                broke_in_zone[usize::from(k > 5)] += 1;
            }
        }
        bar.rezone(&mut run, place(k + 1)).unwrap();
        let now: Vec<u32> = locked(&log).events().iter().map(|e| e.bond).collect();
        assert!(now.starts_with(&before), "a change of weights lost a broken bond");
        before = now;
    }
    run.advance(&mut Silent).unwrap();
    assert!(
        broke_in_zone.iter().all(|n| *n > 20),
        "{broke_in_zone:?} bonds broke"
    );
    assert!(run.drift() < 1e-11, "the balance misses {:e}", run.drift());
    let broken = before.len();
    let unique: std::collections::BTreeSet<u32> = before.into_iter().collect();
    assert_eq!(unique.len(), broken, "a bond broke twice");
}

/// Beams that soften keep their damage where the zone leaves them and comes back: neither a change of weights
/// nor sleep heals or harms them, and the balance closes.
#[test]
fn damage_of_beams_that_soften_outlives_sleep_and_the_balance_closes() {
    let bar = Bar::new(Fine::Spheres, 1);
    let (mut run, log) = brittle(Fracture {
        dissipated: Some(1e-2),
        ..Fracture::new(Criterion::TensileEnergy, 1e-3)
    });
    let bonds = run.subdomains()[1].model().views().links.unwrap().pairs().len();
    let damage = |log: &SharedLog| -> Vec<f64> {
        let log = locked(log);
        (0..bonds).map(|b| log.damage(b)).collect()
    };
    let partial = |d: &[f64]| d.iter().filter(|d| **d > 0.0 && **d < 1.0).count();
    let (mut before, mut slept) = (damage(&log), 0);
    for k in (0..8).chain((0..8).rev()) {
        for _ in 0..6 {
            run.advance(&mut Silent).unwrap();
            let now = damage(&log);
            let fine = &run.subdomains()[1];
            for (b, ends) in fine.model().views().links.unwrap().pairs().iter().enumerate() {
                assert!(now[b] >= before[b], "bond {b} healed");
                if ends.iter().all(|n| fine.is_asleep(*n as usize)) {
                    assert!(now[b] <= before[b], "bond {b} slept and softened");
                    slept += usize::from(now[b] > 0.0 && now[b] < 1.0);
                }
            }
            before = now;
        }
        bar.rezone(&mut run, place(k)).unwrap();
        assert_eq!(damage(&log), before, "a change of weights changed the damage");
    }
    assert!(partial(&before) > 20, "{} bonds have softened", partial(&before));
    assert!(slept > 20, "{slept} of them slept");
    assert!(run.drift() < 1e-11, "the balance misses {:e}", run.drift());
}

#[test]
fn strengths_of_particles_are_refused_by_name() {
    let bar = Bar::new(Fine::Spheres, 1);
    let (mut run, _) = brittle(Fracture::new(Criterion::Hydrostatic, 1e3));
    let refused = bar.rezone(&mut run, place(1));
    assert!(
        matches!(&refused, Err(Error::Unsupported { model, what }) if model == "fine" && what.contains("sleep")),
        "{refused:?}"
    );
}

#[test]
fn a_node_without_weight_is_refused_unless_it_may_sleep() {
    let [coarse, fine] = weights(2.0);
    let bodies = || {
        [("bar", [20, 2, 2], &coarse), ("fine", [33, 3, 3], &fine)].map(|(name, counts, w)| {
            let mesh = block(ElementKind::Hex8, [0.0, LENGTH], counts);
            Subdomain::fine(FemModel::new(name, mesh, material()).unwrap(), w.clone())
        })
    };
    let bar = Bar::new(Fine::Hexahedra, 1);
    let step = TimeStep::Fraction(0.5);
    let refused = Coupled::new(bodies().into(), bar.interfaces(2.0), step, None);
    assert!(
        matches!(&refused, Err(Error::ZeroMass { model, .. }) if model == "bar"),
        "{refused:?}"
    );
    let run = Coupled::new(
        bodies().map(Subdomain::with_sleep).into(),
        bar.interfaces(2.0),
        step,
        None,
    );
    let run = run.unwrap();
    let awake = |k: usize| {
        let s = &run.subdomains()[k];
        (0..s.model().nodes().len()).filter(|n| !s.is_asleep(*n)).count()
    };
    // The bar sleeps at the three inner cross-sections of the zone; the fine model beyond its ramps.
    assert_eq!(awake(0), (21 - 3) * 9);
    assert!(awake(1) < 20 * 16, "{}", awake(1));
}

/// A sphere just inside the outer border of the overlap, all bonds of which lead out, has a mass below
/// round-off: it sleeps, and multipliers leave it alone.
#[test]
fn a_sphere_at_the_border_whose_bonds_lead_out_sleeps_and_is_not_tied() {
    let hung = Point3::new(7.625, 0.375, 0.625);
    let border = hung.x + 1e-7;
    let from = border - ZONE - RAMP;
    let leads_out = |ends: [&Vector3<f64>; 2]| {
        let is_of = ends.iter().any(|x| (*x - hung.coords).norm() < 1e-9);
        !is_of || ends.iter().any(|x| x.x > border)
    };
    let bar = Bar::new(Fine::Spheres, 1);
    // `reach` moves the mediator at `hung` away from the weights.
    let run = |reach: f64| {
        let mut interfaces = bar.interfaces(from);
        interfaces[1] = bar.interfaces(from + reach).swap_remove(1);
        let [coarse, fine] = weights(from);
        let mesh = block(ElementKind::Hex8, [0.0, LENGTH], [20, 2, 2]);
        let law = Elastic::new(1.0, 0.0, 1.0).unwrap();
        let motion = &mut random(7);
        let elements = Subdomain::coarse(FemModel::new("bar", mesh, law).unwrap(), coarse).with_sleep();
        let spheres = Subdomain::fine(lattice_with(&leads_out), fine).with_sleep();
        let models = vec![with_state(elements, motion), with_state(spheres, motion)];
        Coupled::new(models, interfaces, TimeStep::Fraction(0.5), None)
    };
    let mut coupled = run(0.0).unwrap();
    let node_at = |x: &Point3<f64>, run: &Coupled<f64>| {
        let nodes = run.subdomains()[1].model().nodes().iter();
        let near = |y: &Point3<f64>| (y - x).norm() < 1e-9;
        nodes.clone().position(near).unwrap()
    };
    let node = node_at(&hung, &coupled);
    let beside = node_at(&(hung + Vector3::y() * 0.25), &coupled);
    let spheres = &coupled.subdomains()[1];
    assert!(spheres.is_asleep(node) && !spheres.is_asleep(beside));
    let momentum = |run: &Coupled<f64>| run.momentum()[0];
    let before = momentum(&coupled);
    coupled.run(50, &mut Silent).unwrap();
    assert!((momentum(&coupled) - before).norm() < 1e-13);
    assert!(coupled.drift() < 1e-12, "{:e}", coupled.drift());
    assert_eq!(
        &coupled.subdomains()[1].state().v[3 * node..3 * node + 3],
        &[0.0; 3]
    );
    // A mediator that goes on beyond the weights by a layer of spheres is refused.
    let refused = run(0.3).map(|_| ());
    assert!(
        matches!(&refused, Err(Error::ZeroMass { model, .. }) if model == "fine"),
        "{refused:?}"
    );
}

#[test]
fn weights_of_the_models_of_this_crate_may_change() {
    let [_, fine] = weights(4.0);
    let hexahedra = FemModel::new("hex", block(ElementKind::Hex8, [0.0, LENGTH], NESTED), material());
    let spheres = lattice();
    let turning = lattice().with_finite_rotations();
    let models: [&mut dyn Model<f64>; 3] = [&mut hexahedra.unwrap(), &mut { spheres }, &mut { turning }];
    for model in models {
        let defect = conformance::reweighing(model, &fine.internal, 1e-3).unwrap();
        assert!(defect < 1e-15, "'{}': {defect:e}", model.name());
    }
}
