//! Steps that the model makes itself while contact, an obstacle, loads, moving supports and breaks act: the
//! bits of the core's steps.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use arlequin_core::effect::Load;
use arlequin_core::{
    Coupled, DofLayout, Drawn, Drift, Evolving, Guard, Kick, Model, ParticleField, Partition,
    PrescribedMotion, Silent, Stepping, Stride, Subdomain, TimeFunction, TimeStep, Weight, Weights,
};
use dem_beam::fracture::{SharedLog, locked};
use dem_beam::{
    BeamMaterial, Contact, ContactLaw, Container, Criterion, DemModel, Fracture, Motion, Obstacle, Packing,
    PackingSpec, RigidShape, Scatter,
};
use nalgebra::{Point3, Vector3};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Wraps the model with or without its own stepping, and counts the steps that it makes.
struct Watched {
    model: DemModel,
    own: bool,
    kicks: Arc<AtomicUsize>,
}

impl Model<f64> for Watched {
    fn name(&self) -> &str {
        self.model.name()
    }
    fn kind(&self) -> &str {
        self.model.kind()
    }
    fn layout(&self) -> DofLayout {
        self.model.layout()
    }
    fn nodes(&self) -> &[Point3<f64>] {
        self.model.nodes()
    }
    fn lumped_inertia(&self, weight: &dyn Weight<f64>, out: &mut [f64]) -> arlequin_core::Result<()> {
        self.model.lumped_inertia(weight, out)
    }
    fn set_internal_weight(&mut self, alpha: &dyn Weight<f64>) -> arlequin_core::Result<()> {
        self.model.set_internal_weight(alpha)
    }
    fn add_internal_forces(&mut self, q: &[f64], f: &mut [f64]) -> arlequin_core::Result<()> {
        self.model.add_internal_forces(q, f)
    }
    fn advance(&mut self, q: &[f64], f: &mut [f64]) -> arlequin_core::Result<()> {
        self.model.advance(q, f)
    }
    fn advance_with_energy(&mut self, q: &[f64], f: &mut [f64]) -> arlequin_core::Result<f64> {
        self.model.advance_with_energy(q, f)
    }
    fn internal_energy(&self, q: &[f64]) -> f64 {
        self.model.internal_energy(q)
    }
    fn critical_step(&mut self, inverse_inertia: &[f64]) -> arlequin_core::Result<f64> {
        self.model.critical_step(inverse_inertia)
    }
    fn evolving(&mut self) -> Option<&mut dyn Evolving<f64>> {
        self.model.evolving()
    }
    fn save(&self) -> arlequin_core::snapshot::Record<f64> {
        self.model.save()
    }
    fn restore(&mut self, from: &arlequin_core::snapshot::Record<f64>) -> arlequin_core::Result<()> {
        self.model.restore(from)
    }
    fn stepping(&mut self) -> Option<&mut dyn Stepping<f64>> {
        let can = self.own && self.model.stepping().is_some();
        can.then_some(self as _)
    }
}

impl Watched {
    fn inner(&mut self) -> &mut dyn Stepping<f64> {
        self.model.stepping().unwrap()
    }
}

impl Stepping<f64> for Watched {
    fn stride(&mut self, step: Stride<'_, f64>) -> arlequin_core::Result<Option<Drawn<f64>>> {
        self.inner().stride(step)
    }
    fn drift(&mut self, drift: Drift<'_, f64>) -> arlequin_core::Result<()> {
        self.inner().drift(drift)
    }
    fn kick(&mut self, kick: Kick<'_, f64>) -> arlequin_core::Result<()> {
        self.kicks.fetch_add(1, Ordering::Relaxed);
        self.inner().kick(kick)
    }
}

/// Weight that rises from 0.1 on the left to one.
#[derive(Debug)]
struct Part;

impl Weight<f64> for Part {
    fn value(&self, x: &Point3<f64>) -> f64 {
        (4e3 * (x.x - 0.2e-3)).clamp(0.1, 1.0)
    }
}

/// What acts on the body.
#[derive(Debug, Clone, Copy)]
struct Case {
    finite: bool,
    fracture: Option<(Criterion, f64)>,
    /// Contact and an obstacle.
    touching: bool,
    /// A load on some unknowns.
    load: bool,
    /// One face is driven.
    driven: bool,
}

const STEPS: usize = 150;

/// Result of a run: steps of the model, breaks, contacts, and the bits of state, works and energies.
#[derive(Debug, PartialEq)]
struct Outcome {
    kicks: usize,
    breaks: usize,
    contacts: f64,
    bits: Vec<u64>,
}

fn packing() -> Packing {
    PackingSpec::quench(Container::cylinder(4e-3, 1e-3).unwrap(), 700, 3)
        .build()
        .unwrap()
}

/// Builds the run of a case; ledgers are drawn every seven steps.
fn run_of(case: Case, packing: &Packing, own: bool, kicks: &Arc<AtomicUsize>) -> (Coupled<f64>, SharedLog) {
    let mut model = DemModel::new("rod", packing, BeamMaterial::SILICA, 2200.0).unwrap();
    if case.finite {
        model = model.with_finite_rotations();
    }
    if let Some((criterion, strength)) = case.fracture {
        let spec = Fracture {
            scatter: Scatter::Weibull { modulus: 6.0 },
            ..Fracture::new(criterion, strength)
        };
        model = model.with_fracture(spec).unwrap();
    }
    let log = model.break_log();
    let n = model.layout().dofs();
    let (mut v, mut loaded) = (vec![0.0; n], Vec::new());
    let mut face = Vec::new();
    for (i, x) in model.nodes().iter().enumerate() {
        // The body is pressed from both ends, bent and twisted.
        v[3 * i] = -2.5e4 * (x.x - 2e-3) * (1.0 + 2e2 * x.y);
        v[3 * i + 1] = -1.2e4 * x.z * x.x / 4e-3;
        v[3 * i + 2] = 1.2e4 * x.y * x.x / 4e-3;
        v[n / 2 + 3 * i] = 1.2e4 * x.x / 4e-3;
        if case.driven && x.x < 0.4e-3 {
            face.push(3 * i);
        }
        if x.x > 3.5e-3 {
            loaded.push((3 * i + 1, 0.2));
            loaded.push((n / 2 + 3 * i, 1e-6));
        }
    }
    face.iter().for_each(|d| v[*d] = 0.0);
    let contact = Contact::new(&model, ContactLaw::elastic(72.5e9)).unwrap();
    let motion = Motion::Free {
        mass: 1e-6,
        velocity: Vector3::new(-30.0, 0.0, 0.0),
        inertia: None,
    };
    let shape = RigidShape::Sphere {
        centre: Point3::new(5.02e-3, 0.0, 0.0),
        radius: 1e-3,
    };
    let ball = Obstacle::new("ball", &model, shape, motion, ContactLaw::elastic(72.5e9)).unwrap();
    let field = Arc::new(ParticleField::new(model.nodes().to_vec(), &vec![1e-12; n / 6]).unwrap());
    let watched = Watched {
        model,
        own,
        kicks: kicks.clone(),
    };
    let mut side = Subdomain::new(Box::new(watched), field, Weights::from_weight(Arc::new(Part)))
        .with_partition(Partition::Unchecked)
        .with_initial(vec![0.0; n], v)
        .unwrap();
    if case.driven {
        side = side.with_support(PrescribedMotion {
            dofs: face,
            amplitude: 2e-6,
            time: TimeFunction::Ramp { duration: 1e-6 },
        });
    }
    if case.load {
        let load = Load::on_dofs("pull", loaded, TimeFunction::Ramp { duration: 3e-7 }).unwrap();
        side = side.with_effect(Box::new(load));
    }
    if case.touching {
        side = side.with_effect(Box::new(contact)).with_effect(Box::new(ball));
    }
    let guard = Guard {
        interval: 7,
        growth: 0.2,
    };
    let run = Coupled::new(vec![side], Vec::new(), TimeStep::Fraction(0.5), Some(guard)).unwrap();
    (run, log)
}

fn outcome(run: &Coupled<f64>, log: &SharedLog, kicks: &Arc<AtomicUsize>) -> Outcome {
    let s = run.subdomains()[0].state();
    let effects = run.effects();
    let works = run.works();
    let numbers = (s.q.iter().chain(&s.v).chain(&s.a).copied()).chain(works.iter().map(|w| w.work));
    let facts = effects.iter().flat_map(|e| &e.facts);
    let log = locked(log);
    let times = log.events().iter().flat_map(|e| [e.time, e.released, e.distance]);
    Outcome {
        kicks: kicks.load(Ordering::Relaxed),
        breaks: log.events().len(),
        contacts: facts
            .filter(|(name, _)| name == "most contacts")
            .map(|f| f.1)
            .sum(),
        bits: numbers.chain(times).map(f64::to_bits).collect(),
    }
}

fn history(case: Case, packing: &Packing, own: bool, threads: usize) -> Outcome {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .unwrap();
    pool.install(|| {
        let kicks = Arc::new(AtomicUsize::new(0));
        let (mut run, log) = run_of(case, packing, own, &kicks);
        run.run(STEPS, &mut Silent).unwrap();
        outcome(&run, &log, &kicks)
    })
}

const ALONE: Case = Case {
    finite: false,
    fracture: None,
    touching: false,
    load: false,
    driven: false,
};

const EVERYTHING: Case = Case {
    finite: false,
    fracture: Some((Criterion::Rankine, 900e6)),
    touching: true,
    load: true,
    driven: true,
};

#[test]
fn steps_of_the_model_with_loads_have_the_bits_of_the_core() {
    let packing = packing();
    let mut cases = vec![
        Case {
            touching: true,
            ..ALONE
        },
        Case { load: true, ..ALONE },
        Case {
            driven: true,
            ..ALONE
        },
        Case {
            finite: true,
            ..EVERYTHING
        },
        Case {
            finite: true,
            fracture: Some((Criterion::Mises, 900e6)),
            ..ALONE
        },
    ];
    let strengths = [
        (Criterion::Axial, 400e6),
        (Criterion::Rankine, 900e6),
        (Criterion::Mises, 900e6),
        (Criterion::Energy, 20.0),
        (Criterion::TensileEnergy, 20.0),
    ];
    cases.extend(strengths.map(|s| Case {
        fracture: Some(s),
        ..EVERYTHING
    }));
    for case in cases {
        let [plain, own] = [false, true].map(|own| history(case, &packing, own, 1));
        assert_eq!(plain.kicks, 0);
        // All steps but those of the ledger.
        assert!(own.kicks >= STEPS - STEPS / 7 - 2, "{case:?}: {}", own.kicks);
        assert!(
            own.breaks > 50 || case.fracture.is_none(),
            "{case:?}: {}",
            own.breaks
        );
        let least = if case.fracture.is_some() { 20.0 } else { 3.0 };
        assert!(
            own.contacts > least || !case.touching,
            "{case:?}: {}",
            own.contacts
        );
        assert!(own.bits == plain.bits && own.breaks == plain.breaks, "{case:?}");
        let threads = history(case, &packing, true, 3);
        assert!(threads == own, "{case:?}");
    }
}

#[test]
fn a_resumed_run_continues_with_the_same_bits() {
    let packing = packing();
    let case = Case {
        finite: true,
        ..EVERYTHING
    };
    let kicks = Arc::new(AtomicUsize::new(0));
    let (mut whole, log) = run_of(case, &packing, true, &kicks);
    whole.run(60, &mut Silent).unwrap();
    let snapshot = whole.snapshot().unwrap();
    whole.run(60, &mut Silent).unwrap();
    let (mut resumed, resumed_log) = run_of(case, &packing, true, &kicks);
    resumed.restore(&snapshot).unwrap();
    resumed.run(60, &mut Silent).unwrap();
    let [a, b] = [(&whole, &log), (&resumed, &resumed_log)].map(|(run, log)| outcome(run, log, &kicks));
    assert!(a.breaks > 50 && a.bits == b.bits, "{} {}", a.breaks, b.breaks);
}
