//! Beams that soften: the energy that they take, the ledger, threads and refusals.
#![allow(clippy::unwrap_used, reason = "a test may")]

use arlequin_core::{
    Coupled, Evolution, Model, PrescribedMotion, Silent, Subdomain, TimeFunction, TimeStep, Weights,
};
use dem_beam::fracture::{SharedLog, locked};
use dem_beam::packing::{Lattice, lattice};
use dem_beam::{BeamMaterial, Container, Criterion, DemModel, Error, Fracture, Matter, PackingSpec, Scatter};
use nalgebra::Vector3;

const R: f64 = 0.5e-3;
/// Energy per section until a beam fails, and at its peak \[J/m²\].
const ENERGIES: [f64; 2] = [12.0, 4.0];

fn softening() -> Fracture {
    let [whole, peak] = ENERGIES;
    Fracture {
        dissipated: Some(whole),
        ..Fracture::new(Criterion::TensileEnergy, peak)
    }
}

/// Two spheres of 1 mm and their bond along x.
fn bond() -> DemModel {
    let matter = Matter {
        beam: BeamMaterial::SILICA,
        density: 2200.0,
        volume: 2e-9,
    };
    let places = [0.0, 2.0 * R].map(|x| Vector3::new(x, 0.0, 0.0));
    let model = DemModel::from_spheres("bond", &places, &[R; 2], &[[0, 1]], &matter).unwrap();
    model.with_fracture(softening()).unwrap()
}

/// Moves a model to `q` from `before`; returns the internal force on the second particle along x.
fn moved(model: &mut DemModel, before: &[f64], q: &[f64]) -> f64 {
    let (mut f, mut f_before) = (vec![0.0; q.len()], vec![0.0; q.len()]);
    model.advance(q, &mut f).unwrap();
    let step = Evolution {
        time: 0.0,
        q_before: before,
        q,
        f_before: &mut f_before,
        f: &mut f,
    };
    model.evolving().unwrap().evolve(step).unwrap();
    f[3]
}

fn section() -> f64 {
    std::f64::consts::PI * (0.71 * R).powi(2)
}

/// Under a growing elongation `u`, the force rises with `E S/l` up to `u_1`, where the beam holds the
/// energy of its peak, then falls along a line to zero at `u_1 G/w_1`; the area below is `G S`. Unloading
/// returns along the secant and takes no energy.
#[test]
fn a_beam_follows_its_two_lines_and_takes_the_energy_per_section() {
    let (mut model, [whole, peak]) = (bond(), ENERGIES);
    let log = model.break_log();
    let stiffness = BeamMaterial::SILICA.young * section() / (2.0 * R);
    let first = (2.0 * peak * section() / stiffness).sqrt();
    let last = first * whole / peak;
    let steps = 4000;
    let at = |u: f64| {
        let mut q = vec![0.0; 12];
        q[3] = u;
        q
    };
    let (mut work, mut before, mut pull_before) = (0.0, 0.0, 0.0);
    for k in 1..=steps {
        let u = 1.05 * last * f64::from(k) / f64::from(steps);
        let pull = -moved(&mut model, &at(before), &at(u));
        let line = if u < first {
            stiffness * u
        } else {
            stiffness * first * (last - u).max(0.0) / (last - first)
        };
        // Stiffnesses have 24 bits.
        assert!(
            (pull - line).abs() < 1e-6 * stiffness * first,
            "{u:e}: {pull:e} {line:e}"
        );
        work += 0.5 * (pull + pull_before) * (u - before);
        (before, pull_before) = (u, pull);
        if k == steps / 2 {
            // To rest and back, and to rest again: no energy leaves, and the force is the same.
            let released = locked(&log).released();
            assert!(released > 0.2 * whole * section() && locked(&log).events().is_empty());
            let half = -moved(&mut model, &at(u), &at(0.5 * u));
            assert!((half / pull - 0.5).abs() < 1e-12, "{half:e} {pull:e}");
            let again = -moved(&mut model, &at(0.5 * u), &at(u));
            assert!((again / pull - 1.0).abs() < 1e-12);
            assert_eq!(released.to_bits(), locked(&log).released().to_bits());
        }
    }
    let log = locked(&log);
    assert!(log.softened() == 1 && log.damage(0) >= 1.0);
    assert!(log.events().len() == 1 && (log.events()[0].released / log.released() - 1.0).abs() < 1e-12);
    let energy = whole * section();
    assert!((work / energy - 1.0).abs() < 1e-6, "{work:e} {energy:e}");
    assert!(
        (log.released() / energy - 1.0).abs() < 1e-3,
        "{:e} {energy:e}",
        log.released()
    );
}

/// The energy is the same in every mode; its error falls with the steps.
#[test]
fn stretched_bent_and_twisted_beams_take_the_same_energy() {
    let taken = |direction: [f64; 4], steps: u32| {
        let mut model = bond();
        let [stretch, shear, twist, bend] = direction;
        let mut unit = [0.0; 12];
        (unit[3], unit[4]) = (stretch, shear);
        (unit[9], unit[11]) = (twist, bend);
        let log = model.break_log();
        let mut before = vec![0.0; 12];
        for k in 1..=steps {
            let share = 3.0 * f64::from(k) / f64::from(steps);
            let q: Vec<f64> = unit.iter().map(|x| share * x).collect();
            moved(&mut model, &before, &q);
            before = q;
        }
        let log = locked(&log);
        assert_eq!(log.events().len(), 1, "{direction:?}");
        log.released() / (ENERGIES[0] * section()) - 1.0
    };
    for direction in [
        [1e-6, 0.0, 0.0, 0.0],
        [1e-7, 2e-6, 0.0, 1e-3],
        [2e-7, 0.0, 5e-3, 0.0],
        [1e-7, 1e-6, 3e-3, 2e-3],
    ] {
        let [coarse, fine] = [1000, 8000].map(|steps| taken(direction, steps));
        assert!(
            fine.abs() < 1e-3 && fine.abs() < 0.5 * coarse.abs() + 1e-6,
            "{direction:?}: {coarse:e} {fine:e}"
        );
    }
}

/// Returns a run of a bar of `n` layers whose right end is pulled at a constant speed, and its log.
fn pulled(n: usize, finite: bool, spec: Fracture) -> (Coupled<f64>, SharedLog) {
    let packing = lattice(Lattice::Cubic, [n, 3, 3], R).unwrap();
    let model = DemModel::new("bar", &packing, BeamMaterial::SILICA, 2200.0).unwrap();
    let model = if finite {
        model.with_finite_rotations()
    } else {
        model
    };
    let model = model.with_fracture(spec).unwrap();
    let far = model.nodes().iter().fold(0.0_f64, |m, x| m.max(x.x));
    let [left, right] = [
        model.select(|x| x.x < 1.5 * R),
        model.select(|x| x.x > far - 0.5 * R),
    ];
    let (held, moving) = (
        model.clamped(&left),
        model.translations(&right, [true, false, false]),
    );
    let log = model.break_log();
    let side = Subdomain::fine(model, Weights::uncoupled())
        .with_support(PrescribedMotion::fixed(held))
        .with_support(PrescribedMotion {
            dofs: moving,
            // The law of finite rotations keeps the energy in smooth motions; a blow would end the run.
            amplitude: if finite { 1.0 } else { 4.0 },
            time: TimeFunction::Table(vec![(0.0, 0.0), (1.0, 1.0)]),
        });
    let run = Coupled::new(vec![side], Vec::new(), TimeStep::Fraction(0.8), None).unwrap();
    (run, log)
}

#[test]
fn the_ledger_closes_while_beams_soften() {
    // Of stresses: energies then scatter with half of this modulus.
    let scatter = Scatter::Weibull { modulus: 16.0 };
    for (finite, scatter, tolerance) in [
        // The halves fly apart, and round-off grows with their displacements.
        (false, Scatter::None, 1e-11),
        (false, scatter, 1e-11),
        (true, scatter, 1e-6),
    ] {
        let (mut run, log) = pulled(
            12,
            finite,
            Fracture {
                scatter,
                ..softening()
            },
        );
        run.run(6000, &mut Silent).unwrap();
        let log = locked(&log);
        let count = log.events().len();
        assert!(count >= 4 && log.softened() >= count, "{count} broke");
        assert!(
            run.drift() < tolerance,
            "{finite} {scatter:?}: drift {:e}",
            run.drift()
        );
        let line = &run.effects()[0];
        assert!((line.dissipated().unwrap() - log.released()).abs() < 1e-12 * log.released());
        // The halves snap apart within few steps, which follow the two lines coarsely.
        for e in log.events() {
            let share = e.released / (ENERGIES[0] * section());
            assert!((0.5..1.5).contains(&share), "{share}");
        }
    }
}

/// A packing without supports that swings: beams soften, unload and are loaded beyond their damage again, and
/// the energy is that of the start to round-off.
#[test]
fn the_ledger_closes_while_damaged_beams_unload_and_reload() {
    let packing = PackingSpec::new(Container::cylinder(4e-3, 1e-3).unwrap(), 1500, 1)
        .build()
        .unwrap();
    let model = DemModel::new("bar", &packing, BeamMaterial::SILICA, 2200.0).unwrap();
    let model = model.with_fracture(softening()).unwrap();
    let log = model.break_log();
    let (n, bonds) = (model.nodes().len(), model.body().pairs().len());
    let mut v = vec![0.0; 6 * n];
    for (i, x) in model.nodes().iter().enumerate() {
        // The first mode of a free bar in length, and a twist.
        v[3 * i] = 22.0 * (std::f64::consts::PI * x.x / 4e-3).cos();
        (v[3 * i + 1], v[3 * i + 2]) = (-4e3 * x.z, 4e3 * x.y);
    }
    let side = Subdomain::fine(model, Weights::uncoupled());
    let side = side.with_initial(vec![0.0; 6 * n], v).unwrap();
    let mut run = Coupled::new(vec![side], Vec::new(), TimeStep::Fraction(0.8), None).unwrap();
    let start = run.energy();
    let (mut unloaded, mut again) = (vec![false; bonds], vec![false; bonds]);
    let mut damage = vec![0.0; bonds];
    for _ in 0..400 {
        run.run(5, &mut Silent).unwrap();
        let s = &run.subdomains()[0];
        let survey = s.model().views().links.unwrap().survey(&s.state().q).unwrap();
        let loads = survey.utilisation.unwrap();
        let log = locked(&log);
        for (b, load) in loads.iter().enumerate() {
            let now = log.damage(b);
            assert!(
                now >= damage[b],
                "damage of bond {b} fell from {} to {now}",
                damage[b]
            );
            again[b] |= unloaded[b] && now > damage[b];
            unloaded[b] |= now > 0.0 && now < 1.0 && *load < 0.25;
            damage[b] = now;
        }
    }
    let log = locked(&log);
    let [unloaded, again] = [unloaded, again].map(|all| all.iter().filter(|x| **x).count());
    println!(
        "{} of {bonds} softened, {} broke, {unloaded} unloaded, {again} of them were damaged again; released {:.3} of the energy, \
         drift {:e}",
        log.softened(),
        log.events().len(),
        log.released() / start,
        run.drift()
    );
    assert!(log.softened() > 300 && log.events().len() > 20 && unloaded > 100 && again > 20);
    assert!(log.released() > 0.05 * start);
    assert!(run.drift() < 1e-12, "{:e}", run.drift());
}

/// Forces of damaged bonds are those that act, and what is left of them goes with the stiffness.
#[test]
fn reported_forces_know_the_damage() {
    let mut model = bond();
    let at = |u: f64| vec![0.0, 0.0, 0.0, u, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let stiffness = BeamMaterial::SILICA.young * section() / (2.0 * R);
    let u = 2.0 * (2.0 * ENERGIES[1] * section() / stiffness).sqrt();
    let pull = -moved(&mut model, &at(0.0), &at(u));
    assert!(pull < 0.3 * stiffness * u);
    let axial = model.views().links.unwrap().survey(&at(u)).unwrap().axial[0];
    assert!((axial / pull - 1.0).abs() < 1e-6, "{axial:e} {pull:e}");
}

#[test]
fn breaks_have_the_same_bits_on_any_number_of_threads() {
    let bits = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| {
            let (mut run, log) = pulled(500, false, softening());
            run.run(400, &mut Silent).unwrap();
            assert!(locked(&log).released() > 0.0);
            let q = run.subdomains()[0].state().q.iter().map(|q| q.to_bits());
            q.chain([locked(&log).released().to_bits()]).collect::<Vec<u64>>()
        })
    };
    let one = bits(1);
    assert!(one == bits(2) && one == bits(5));
}

#[test]
fn beams_that_would_snap_back_are_refused_with_the_largest_diameter() {
    let beam = BeamMaterial::SILICA;
    let Err(Error::SnapBack { largest, .. }) = Fracture::softening(8.0, 200e6, &beam, 0.5e-3) else {
        panic!("not refused");
    };
    // At this diameter, a beam holds gc over the factor of the packing at its peak.
    assert!(
        (largest / (2.0 * 265e9 * (8.0 / 0.78) / 4e16) - 1.0).abs() < 1e-12,
        "{largest:e}"
    );
    let spec = Fracture::softening(8.0, 200e6, &beam, 0.999 * largest).unwrap();
    assert!(spec.strength < spec.dissipated.unwrap());
    for (gc, strength, name) in [
        (0.0, 2e8, "gc = 0"),
        (-8.0, 2e8, "gc = -8"),
        (8.0, -1.0, "strength = -1"),
    ] {
        let message = Fracture::softening(gc, strength, &beam, 1e-5)
            .unwrap_err()
            .to_string();
        assert!(message.contains(name), "{message}");
    }
    let stress = Fracture {
        dissipated: Some(8.0),
        ..Fracture::new(Criterion::Axial, 1e8)
    };
    assert!(
        stress
            .check()
            .unwrap_err()
            .to_string()
            .contains("'axial' compares stresses")
    );
}

/// The scatter is that of the stress at the peak: a bond snaps if its factor `f` has `f² w_1 >= G`, which a
/// share `exp(−(G/w_1)^{m/2})` of Weibull factors does.
#[test]
fn scattered_bonds_that_cannot_soften_are_counted() {
    let packing = lattice(Lattice::Cubic, [12; 3], R).unwrap();
    let model = |spec: Fracture| {
        let model = DemModel::new("cube", &packing, BeamMaterial::SILICA, 2200.0).unwrap();
        model.with_fracture(spec).unwrap()
    };
    let spec = Fracture {
        dissipated: Some(1.5 * ENERGIES[1]),
        scatter: Scatter::Weibull { modulus: 4.0 },
        ..softening()
    };
    let bonds = packing.pairs.len() as f64;
    let wanted = (-1.5_f64.powi(2)).exp();
    let share = model(spec).snapping_bonds() as f64 / bonds;
    // Three deviations of a count.
    assert!(
        (share - wanted).abs() < 3.0 * (wanted / bonds).sqrt(),
        "{share} {wanted}"
    );
    assert_eq!(model(softening()).snapping_bonds(), 0);
}
