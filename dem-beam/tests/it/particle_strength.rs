//! The criterion of particles: all bonds of a particle break at once.
#![allow(clippy::unwrap_used, reason = "a test may")]

use arlequin_core::{
    Coupled, Evolution, Model, Recovered, Silent, State, Subdomain, TimeStep, Watching, Weights,
};
use dem_beam::fracture::locked;
use dem_beam::packing::{Lattice, lattice};
use dem_beam::{BeamMaterial, Container, Criterion, DemModel, Fracture, PackingSpec, Scatter};
use nalgebra::Point3;

const R: f64 = 0.5e-3;

fn cube(n: usize) -> DemModel {
    let packing = lattice(Lattice::Cubic, [n; 3], R).unwrap();
    DemModel::new("cube", &packing, BeamMaterial::SILICA, 2200.0).unwrap()
}

fn hydrostatic(strength: f64) -> Fracture {
    Fracture::new(Criterion::Hydrostatic, strength)
}

/// Unknowns with the displacements that `u` gives, and no rotations.
fn displaced(model: &DemModel, u: impl Fn(&Point3<f64>) -> [f64; 3]) -> Vec<f64> {
    let mut q: Vec<f64> = model.nodes().iter().flat_map(u).collect();
    q.resize(model.layout().dofs(), 0.0);
    q
}

/// Moves the model from rest to `q` and lets it break. Returns the particles and modes of the breaks.
fn breaks(model: &mut DemModel, q: &[f64]) -> Vec<([u32; 2], &'static str)> {
    let log = model.break_log();
    let rest = vec![0.0; q.len()];
    let (mut f, mut f_before) = (rest.clone(), rest.clone());
    model.advance(q, &mut f).unwrap();
    let step = Evolution {
        time: 0.0,
        q_before: &rest,
        q,
        f_before: &mut f_before,
        f: &mut f,
    };
    model.evolving().unwrap().evolve(step).unwrap();
    let log = locked(&log);
    log.events().iter().map(|e| (e.pair, e.mode.name())).collect()
}

/// Under the strain `e` in all directions, six bonds of `2 R` pull the innermost particle of a cube of
/// 3 × 3 × 3 with `N = E S e`: its hydrostatic stress is `6 · ½ · 2 R N/(3 V) = 2 R N/V`, which is larger
/// than that of particles at the surface.
#[test]
fn the_innermost_particle_loses_all_bonds_at_the_stress_of_its_closed_form() {
    let e = 1e-4;
    let section = std::f64::consts::PI * (0.71 * R).powi(2);
    let stress = 2.0 * R * BeamMaterial::SILICA.young * section * e / (2.0 * R).powi(3);
    for finite in [false, true] {
        let made = |strength: f64| {
            let m = cube(3);
            let m = if finite { m.with_finite_rotations() } else { m };
            m.with_fracture(hydrostatic(strength)).unwrap()
        };
        // Under finite rotations the arms are those of the stretched body.
        let stress = if finite { stress * (1.0 + e) } else { stress };
        let mut model = made(0.9999 * stress);
        let innermost = (0..27).find(|i| {
            let bonds = model.body().pairs().iter();
            bonds.filter(|p| p.contains(&(*i as u32))).count() == 6
        });
        let innermost = innermost.unwrap() as u32;
        let q = displaced(&model, |x| [e * x.x, e * x.y, e * x.z]);
        let broken = breaks(&mut model, &q);
        assert_eq!(broken.len(), 6, "{finite}");
        assert!(
            broken
                .iter()
                .all(|(p, mode)| p.contains(&innermost) && *mode == "tension")
        );
        let mut model = made(1.0001 * stress);
        assert!(breaks(&mut model, &q).is_empty(), "{finite}");
        // Compression and shear of any size break nothing.
        for q in [
            displaced(&model, |x| [-20.0 * e * x.x, -20.0 * e * x.y, -20.0 * e * x.z]),
            displaced(&model, |x| [20.0 * e * x.y, 20.0 * e * x.x, 0.0]),
        ] {
            assert!(breaks(&mut made(0.1 * stress), &q).is_empty(), "{finite}");
        }
    }
}

/// The load is the trace of the stress that the model reports for its particles, and a bond is loaded by the
/// particle of the larger load.
#[test]
fn the_load_is_the_trace_of_the_stress_of_the_particles() {
    let packing = PackingSpec::quench(Container::cylinder(4e-3, 1e-3).unwrap(), 500, 3);
    let packing = packing.build().unwrap();
    for finite in [false, true] {
        let model = DemModel::new("bar", &packing, BeamMaterial::SILICA, 2200.0).unwrap();
        let model = if finite {
            model.with_finite_rotations()
        } else {
            model
        };
        let strength = 20e6;
        let model = model.with_watched_strength(hydrostatic(strength)).unwrap();
        let n = model.nodes().len();
        let noise = |i: usize| ((i as f64 * 12.9898).sin() * 43_758.545_3).fract();
        let mut q = displaced(&model, |x| [2e-4 * x.x, 1e-4 * x.y, 0.0]);
        (0..6 * n).for_each(|i| q[i] += noise(i) * if i < 3 * n { 3e-8 } else { 1e-3 });
        let (views, nodes) = (model.views(), (0..n).collect::<Vec<usize>>());
        let mut stresses: Vec<Recovered<f64>> = Vec::new();
        views
            .recovery
            .unwrap()
            .recover(&q, &nodes, &mut stresses)
            .unwrap();
        let used = views.links.unwrap().survey(&q).unwrap().utilisation.unwrap();
        let load = |i: u32| {
            let [xx, yy, zz, ..] = stresses[i as usize].stress.0;
            (xx + yy + zz) / (3.0 * strength)
        };
        for (used, pair) in used.iter().zip(views.links.unwrap().pairs()) {
            let [i, j] = pair.map(load);
            let apart = used - i.max(j);
            // Stiffnesses are rounded to 24 bits in the stresses.
            assert!(apart.abs() < 1e-5, "{finite}: {apart:e}");
        }
        let state = State {
            q,
            ..State::zero(6 * n)
        };
        let above = (0..n as u32).filter(|i| load(*i) >= 1.0).count();
        let message = &model
            .watch(&state)
            .into_iter()
            .find(|f| f.effect == "fracture")
            .unwrap()
            .message;
        assert!(
            above > 10 && message.starts_with(&format!("{above} particles are loaded")),
            "{message}"
        );
    }
}

/// Returns a run of a body that flies apart, with its log.
fn bursting(n: usize, spec: Fracture) -> (Coupled<f64>, dem_beam::fracture::SharedLog) {
    let model = cube(n).with_fracture(spec).unwrap();
    let log = model.break_log();
    let v = displaced(&model, |x| [20.0 * (x.x / R).sin(), 9e3 * x.y, 9e3 * x.z]);
    let side = Subdomain::fine(model, Weights::uncoupled());
    let side = side.with_initial(vec![0.0; v.len()], v).unwrap();
    let run = Coupled::new(vec![side], Vec::new(), TimeStep::Fraction(0.5), None).unwrap();
    (run, log)
}

#[test]
fn the_ledger_closes_to_round_off_and_whole_particles_come_off() {
    for scatter in [Scatter::None, Scatter::Weibull { modulus: 5.0 }] {
        let spec = Fracture {
            scatter,
            ..hydrostatic(60e6)
        };
        let (mut run, log) = bursting(6, spec);
        run.run(200, &mut Silent).unwrap();
        let log = locked(&log);
        let bonds = 3 * 5 * 36;
        assert!(
            (20..bonds).contains(&log.events().len()),
            "{} broke",
            log.events().len()
        );
        assert!(run.drift() < 1e-12, "drift {:e}", run.drift());
        let line = &run.effects()[0];
        assert!((line.dissipated().unwrap() - log.released()).abs() < 1e-12 * log.released());
        // In the step of the first break, the breaking particles lose all bonds that they have.
        let first = log
            .events()
            .iter()
            .filter(|e| e.time.total_cmp(&log.events()[0].time).is_eq());
        let first: Vec<[u32; 2]> = first.map(|e| e.pair).collect();
        let body = cube(6);
        let lost_all = |i: &u32| {
            body.body()
                .pairs()
                .iter()
                .filter(|p| p.contains(i))
                .all(|p| first.contains(p))
        };
        assert!(first.iter().all(|p| p.iter().any(lost_all)), "{first:?}");
    }
}

#[test]
fn breaks_have_the_same_bits_on_any_number_of_threads() {
    let spec = Fracture {
        scatter: Scatter::Normal { deviation: 0.2 },
        ..hydrostatic(60e6)
    };
    let bits = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| {
            // More particles than the size from which a second thread is used.
            let (mut run, log) = bursting(17, spec);
            run.run(60, &mut Silent).unwrap();
            let log = locked(&log);
            assert!(log.events().len() > 100, "{}", log.events().len());
            let breaks = log
                .events()
                .iter()
                .flat_map(|e| [u64::from(e.bond), e.released.to_bits()]);
            let q = run.subdomains()[0].state().q.iter().map(|q| q.to_bits());
            breaks.chain(q).collect::<Vec<u64>>()
        })
    };
    let one = bits(1);
    assert!(one == bits(2) && one == bits(5));
}
