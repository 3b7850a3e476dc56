//! Surfaces of finite and natural elements against particles and against each other: blows, rest, slopes,
//! the patch test, random pairs of shapes, restarts.

#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]

use crate::support::blocks::{Block, E, H, bits, block, depth_in, places, random};
use arlequin::core::contact::{ContactLaw, Exterior, RigidShape, Solid, SurfaceContact};
use arlequin::core::effect::{BodyForce, MassDamping, PairSpec};
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::core::{Coupled, Error, Parts, PrescribedMotion, Silent, TimeFunction, TimeStep};
use std::sync::Arc;

fn touching(a: Block, b: Block, law: ContactLaw, fraction: f64) -> Coupled<f64> {
    joined(a, b, law, fraction).unwrap()
}

/// Two blocks in contact, unless they are refused.
fn joined(a: Block, b: Block, law: ContactLaw, fraction: f64) -> Result<Coupled<f64>, Error> {
    let contact = SurfaceContact::new(&a.exterior, &b.exterior, law).unwrap();
    let parts = Parts {
        start: 0.0,
        end: None,
        subdomains: vec![a.side, b.side],
        interfaces: Vec::new(),
        pairs: vec![PairSpec {
            sides: [0, 1],
            effect: Box::new(contact),
        }],
    };
    Coupled::from_parts(parts, TimeStep::Fraction(fraction), None)
}

fn fact(run: &Coupled<f64>, name: &str) -> f64 {
    let line = run
        .effects()
        .into_iter()
        .find(|l| l.name == "contact below-above")
        .unwrap();
    line.facts.iter().find(|f| f.0 == name).unwrap().1
}

/// A block thrown at another, free one, corner first.
fn thrown(below: &str, above: &str, law: ContactLaw, fraction: f64) -> Coupled<f64> {
    let a = block(
        below,
        "below",
        Vector3::new(0.0, 0.0, -3.0 * H),
        [4, 4, 3],
        H,
        Vector3::zeros(),
    );
    let turn = Vector3::new(0.4, 0.5, 0.3);
    let b = block(
        above,
        "above",
        Vector3::new(1.1 * H, 0.9 * H, 0.55 * H),
        [2, 2, 2],
        H,
        turn,
    );
    touching(a, b.moving(Vector3::new(1.0, 0.5, -20.0)), law, fraction)
}

/// Elements, natural elements and particles: blows keep the momentum and create no energy.
#[test]
fn a_block_thrown_at_a_block_keeps_momentum_and_creates_no_energy() {
    for (below, above) in [
        ("hex", "tet"),
        ("cnem", "hex"),
        ("hex", "dem"),
        ("dem", "tet"),
        ("cnem", "dem"),
    ] {
        for (restitution, friction, fraction) in [(1.0, 0.0, 0.9), (0.5, 0.4, 0.4)] {
            let law = ContactLaw {
                restitution,
                friction,
                ..ContactLaw::elastic(E)
            };
            let mut run = thrown(below, above, law, fraction);
            let ([start, _], before) = (run.momentum(), run.energy());
            let (mut touched, mut created, mut worst) = (false, 0.0_f64, 0.0_f64);
            while run.time() < 15e-6 {
                run.run(1, &mut Silent).unwrap();
                touched |= fact(&run, "contacts") > 0.0;
                created = created.max(run.created() / before);
                worst = worst.max((run.momentum()[0] - start).norm() / start.norm());
            }
            let name = format!("{above} on {below}, friction {friction}");
            assert!(touched, "{name}: no contact");
            assert!(created <= 1e-13, "{name}: created {created:e}");
            assert!(worst < 1e-12, "{name}: momentum {worst:e}");
            assert!(run.drift() < 1e-11, "{name}: drift {:e}", run.drift());
            // The lighter block comes back.
            let [above, _] = run.subdomains()[1].momentum();
            assert!(above.z > -0.5 * start.z.abs(), "{name}: {:e}", above.z / start.z);
        }
    }
}

/// A block on a held one, under gravity that rises, with damping. Returns the run at rest, or as it slides.
fn resting(below: &str, above: &str, gravity: Vector3<f64>, law: ContactLaw, end: f64) -> Coupled<f64> {
    let size = [4, 4, 2];
    let mut a = block(
        below,
        "below",
        Vector3::new(0.0, 0.0, -2.0 * H),
        size,
        H,
        Vector3::zeros(),
    );
    let low = Vector3::new(1.2 * H, 1.3 * H, 0.0);
    let b = block(above, "above", low, [2, 2, 1], 0.8 * H, Vector3::zeros());
    let held = a
        .side
        .model()
        .nodes()
        .iter()
        .enumerate()
        .filter(|(_, x)| x.z < -1.7 * H);
    let held: Vec<usize> = held.flat_map(|(n, _)| 3 * n..3 * n + 3).collect();
    a.side = a
        .side
        .with_support(PrescribedMotion::fixed(held))
        .with_effect(Box::new(MassDamping::new(2e5).unwrap()));
    let ramp = TimeFunction::Ramp { duration: 2e-5 };
    let force = BodyForce::new(gravity).unwrap().over_time(ramp).unwrap();
    let side = b
        .side
        .with_effect(Box::new(force))
        .with_effect(Box::new(MassDamping::new(2e5).unwrap()));
    let mut run = touching(a, Block { side, ..b }, law, 0.8);
    while run.time() < end {
        run.run(100, &mut Silent).unwrap();
    }
    run
}

/// All pairs of kinds of which one has facets.
const PAIRS: [(&str, &str); 10] = [
    ("hex", "dem"),
    ("tet", "hex"),
    ("hex", "cnem"),
    ("cnem", "dem"),
    ("dem", "tet"),
    ("hex", "hex"),
    ("tet", "tet"),
    ("cnem", "tet"),
    ("cnem", "cnem"),
    ("dem", "hex"),
];

#[test]
#[ignore = "quarter of a minute"]
fn the_force_on_a_block_at_rest_is_its_weight() {
    for (below, above) in &PAIRS[..4] {
        let law = ContactLaw {
            restitution: 0.3,
            ..ContactLaw::elastic(E)
        };
        let mut run = resting(below, above, Vector3::new(0.0, 0.0, -9.81e3), law, 2.5e-4);
        let s = &run.subdomains()[1];
        let mass: f64 = (0..s.model().nodes().len()).map(|n| s.inertia()[3 * n]).sum();
        let weight = mass * 9.81e3;
        let name = "contact below-above";
        let up = run.effect_resultant(1, name, &Point3::origin()).unwrap().force;
        let down = run.effect_resultant(0, name, &Point3::origin()).unwrap().force;
        assert!(
            (up + down).norm() < 1e-13 * weight,
            "{above} on {below}: {:e}",
            (up + down).norm()
        );
        assert!(
            (up.z / weight - 1.0).abs() < 1e-6,
            "{above} on {below}: {:e}",
            up.z / weight - 1.0
        );
        assert!(up.xy().norm() < 1e-6 * weight);
    }
}

#[test]
fn a_block_sticks_on_a_block_up_to_the_angle_of_friction() {
    assert_threshold(&PAIRS[..1]);
}

#[test]
#[ignore = "minutes: the other pairs of kinds"]
fn a_block_of_any_kind_sticks_on_any_other_up_to_the_angle_of_friction() {
    assert_threshold(&PAIRS[1..]);
}

fn assert_threshold(pairs: &[(&str, &str)]) {
    let mu = 0.3;
    for (below, above) in pairs {
        for slope in [0.29995, 0.30005_f64] {
            let law = ContactLaw {
                friction: mu,
                restitution: 0.3,
                ..ContactLaw::elastic(E)
            };
            let g = Vector3::new(slope, 0.0, -1.0) * 9.81e3;
            let mut run = resting(below, above, g, law, 4e-4);
            let force = run
                .effect_resultant(1, "contact below-above", &Point3::origin())
                .unwrap()
                .force;
            let ratio = -force.x / force.z;
            assert!(
                (ratio - slope.min(mu)).abs() < 1e-5,
                "{above} on {below} {slope}: {ratio}"
            );
        }
    }
}

/// Patch test of contact: two blocks of one width with `counts` elements along it, whose meshes do not match,
/// pressed between plates without friction. Returns the largest error of the vertical stress at the nodes,
/// over its mean.
fn patch(kind: &str, counts: [usize; 2]) -> f64 {
    let side = 6.0 * H;
    let make = |name: &str, n: usize, up: f64| {
        let h = side / n as f64;
        let layers = n / 2;
        let low = Vector3::new(0.0, 0.0, up * h * layers as f64);
        block(kind, name, low, [n, n, layers], h, Vector3::zeros())
    };
    // A face moves along z; two nodes on one of its edges keep the block from shifting and turning.
    let held = |b: Block, z: f64, amplitude: f64| {
        let nodes = b.side.model().nodes().to_vec();
        let near = |x: [f64; 3]| {
            nodes
                .iter()
                .position(|p| (p - Point3::from(x)).norm() < 1e-9)
                .unwrap()
        };
        let (first, second) = (near([0.0, 0.0, z]), near([side, 0.0, z]));
        let face = (0..nodes.len()).filter(|n| (nodes[*n].z - z).abs() < 1e-9);
        let motion = PrescribedMotion {
            dofs: face.map(|n| 3 * n + 2).collect(),
            amplitude,
            time: TimeFunction::Ramp { duration: 2e-5 },
        };
        let fixed = PrescribedMotion::fixed(vec![3 * first, 3 * first + 1, 3 * second + 1]);
        let damping = Box::new(MassDamping::new(4e5).unwrap());
        let side = b
            .side
            .with_support(motion)
            .with_support(fixed)
            .with_effect(damping);
        Block { side, ..b }
    };
    let height = |n: usize| side / n as f64 * (n / 2) as f64;
    let a = held(make("below", counts[0], -1.0), -height(counts[0]), 0.0);
    let b = held(make("above", counts[1], 0.0), height(counts[1]), -1e-6);
    let mut run = touching(a, b, ContactLaw::elastic(E), 0.8);
    while run.time() < 1.2e-4 {
        run.run(100, &mut Silent).unwrap();
    }
    let mut stresses = Vec::new();
    for s in run.subdomains() {
        let nodes: Vec<usize> = (0..s.model().nodes().len()).collect();
        let mut out = Vec::new();
        let recovery = s.model().views().recovery.unwrap();
        recovery.recover(&s.state().q, &nodes, &mut out).unwrap();
        stresses.extend(out.iter().map(|r| r.stress.0[2]));
    }
    let mean = stresses.iter().sum::<f64>() / stresses.len() as f64;
    assert!(mean < -1e6, "the blocks are pressed: {mean:e} Pa");
    stresses
        .iter()
        .fold(0.0, |worst, s| worst.max((s / mean - 1.0).abs()))
}

/// Matching meshes pass to round-off. Otherwise the error is that of the quadrature of one side's shape
/// functions at the points of the other side. The functions of natural elements are not linear on facets.
#[test]
fn the_patch_test_of_contact_holds_within_a_per_cent() {
    for (kind, counts, limit) in [
        ("tet", [2, 2], 1e-10),
        ("hex", [2, 2], 1e-10),
        ("hex", [3, 4], 0.01),
        ("cnem", [3, 4], 0.01),
    ] {
        let error = patch(kind, counts);
        assert!(error < limit, "{kind} {counts:?}: {error:e}");
    }
}

#[test]
#[ignore = "two minutes: finer meshes"]
fn the_patch_test_of_contact_holds_on_finer_meshes() {
    for (kind, counts, limit) in [
        ("tet", [3, 4], 0.01),
        ("tet", [4, 7], 0.01),
        ("hex", [4, 7], 0.01),
    ] {
        let error = patch(kind, counts);
        assert!(error < limit, "{kind} {counts:?}: {error:e}");
    }
}

/// Contact gives the same bits for one and three threads, and after a restart within it.
#[test]
fn threads_and_restarts_keep_the_bits() {
    let law = ContactLaw {
        friction: 0.4,
        ..ContactLaw::elastic(E)
    };
    for (below, above) in [("hex", "tet"), ("cnem", "dem")] {
        let mut first = thrown(below, above, law, 0.8);
        while fact(&first, "contacts") < 1.0 {
            first.run(1, &mut Silent).unwrap();
        }
        first.run(5, &mut Silent).unwrap();
        let done = first.steps();
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            pool.install(|| {
                let mut run = thrown(below, above, law, 0.8);
                run.run(done + 60, &mut Silent).unwrap();
                bits(&run)
            })
        };
        let serial = on(1);
        assert_eq!(serial, on(3), "three threads");
        let saved = first.snapshot().unwrap();
        let mut resumed = thrown(below, above, law, 0.8);
        resumed.restore(&saved).unwrap();
        resumed.run(60, &mut Silent).unwrap();
        assert_eq!(
            serial,
            bits(&resumed),
            "{above} on {below} after a restart at step {done}"
        );
    }
}

/// Deepest place of a node of one model inside the other \[m\]; for particles, of a centre.
fn depth(run: &Coupled<f64>) -> f64 {
    let mut deepest = f64::NEG_INFINITY;
    for m in 0..2 {
        let [own, other] = [&run.subdomains()[m], &run.subdomains()[1 - m]];
        let Some(surface) = other.model().views().surface else {
            continue;
        };
        let nodes: Vec<Point3<f64>> = places(other).collect();
        let corners = surface
            .triangles()
            .into_iter()
            .map(|t| t.map(|n| nodes[n as usize]));
        let solid = RigidShape::Solid(Arc::new(Solid::new(corners.collect()).unwrap()));
        deepest = deepest.max(depth_in([own].into_iter(), &solid, &Vector3::zeros()));
    }
    deepest
}

/// Random pairs of turned blocks are shot at each other: none passes through, whatever the step.
#[test]
fn eight_random_turned_pairs_do_not_pass_through() {
    shoot_random_pairs(8);
}

#[test]
#[ignore = "half a minute"]
fn forty_random_turned_pairs_do_not_pass_through() {
    shoot_random_pairs(40);
}

fn shoot_random_pairs(count: usize) {
    let mut random = random(11);
    let kinds = [
        ("hex", "tet"),
        ("cnem", "tet"),
        ("hex", "cnem"),
        ("hex", "dem"),
        ("dem", "tet"),
        ("cnem", "tet"),
        ("hex", "cnem"),
        ("cnem", "dem"),
    ];
    for k in 0..count {
        let (below, above) = kinds[k % kinds.len()];
        let mut turn = || Vector3::new(random(), random(), random()) * 3.0;
        let (first, second) = (turn(), turn());
        let a = block(below, "below", Vector3::repeat(-1.5 * H), [3, 3, 3], H, first);
        let aside = Vector3::new(random() - 0.5, random() - 0.5, 0.0) * H;
        let low = aside + Vector3::new(-0.75, -0.75, 4.0) * H;
        let b = block(above, "above", low, [2, 2, 2], 0.75 * H, second);
        let b = b.moving(Vector3::new(0.0, 0.0, -40.0));
        let law = ContactLaw {
            friction: 0.2,
            ..ContactLaw::elastic(E)
        };
        let fraction = 0.1 + 0.85 * random();
        let mut run = touching(a, b, law, fraction);
        let start = run.momentum()[0];
        let before = run.energy();
        let (mut touched, mut deepest) = (0.0_f64, 0.0_f64);
        while run.time() < 1e-4 {
            run.run(20, &mut Silent).unwrap();
            touched = touched.max(fact(&run, "contacts"));
            deepest = deepest.max(depth(&run));
        }
        let name = format!("{k}: {above} on {below} at {fraction:.2}");
        assert!(touched > 0.0, "{name}: no contact");
        assert!(deepest < 0.3 * H, "{name}: {deepest:e} m deep");
        assert!(
            run.created() <= 1e-13 * before,
            "{name}: {:e}",
            run.created() / before
        );
        assert!(
            (run.momentum()[0] - start).norm() < 1e-10 * start.norm(),
            "{name}"
        );
    }
}

#[test]
fn pairs_are_refused_by_name() {
    let law = ContactLaw::elastic(E);
    let z = Vector3::zeros();
    let (a, b) = (
        block("hex", "below", z, [2; 3], H, z),
        block("hex", "above", z, [2; 3], 0.8 * H, z),
    );
    let spheres = [
        block("dem", "s", z, [1; 3], H, z),
        block("dem", "t", z, [1; 3], H, z),
    ];
    let refuse = |a: &Exterior, b: &Exterior, law| SurfaceContact::new(a, b, law).unwrap_err().to_string();
    let error = refuse(&spheres[0].exterior, &spheres[1].exterior, law);
    assert!(
        error.contains("'contact s-t'") && error.contains("facets"),
        "{error}"
    );
    let rolls = ContactLaw { rolling: 0.1, ..law };
    let error = refuse(&a.exterior, &b.exterior, rolls);
    assert!(
        error.contains("'contact below-above'") && error.contains("rolling"),
        "{error}"
    );
    // One block begins within the other, so deep that no facet sees it, or partly.
    let (within, partly) = (Vector3::repeat(2.6) * H, Vector3::new(0.5, 0.5, 1.2) * H);
    for (kind, big, low, rule, shift) in [
        ("hex", 6, within, "must not lie in each other", 0.0),
        ("dem", 6, within, "must not lie in each other", 0.0),
        ("hex", 2, partly, "must overlap by", 0.0),
        ("dem", 2, partly, "must not lie in each other", 0.0),
        // Displaced into the other before the first step.
        ("hex", 6, within, "must not lie in each other", 20.0 * H),
        ("dem", 6, within, "must not lie in each other", 20.0 * H),
    ] {
        let a = block("hex", "below", z, [big; 3], H, z);
        let mut inside = block(kind, "above", low + Vector3::x() * shift, [2; 3], 0.4 * H, z);
        let (nodes, dofs) = (
            inside.side.model().nodes().len(),
            inside.side.model().layout().dofs(),
        );
        let mut q = vec![0.0; dofs];
        q[..3 * nodes].chunks_mut(3).for_each(|q| q[0] = -shift);
        inside.side = inside.side.with_initial(q, vec![0.0; dofs]).unwrap();
        let error = joined(a, inside, law, 0.5).unwrap_err().to_string();
        assert!(
            error.contains("points start inside") && error.contains("'contact below-above'"),
            "{error}"
        );
        assert!(error.contains(rule), "{kind}: {error}");
    }
}

/// A contact that is too soft for a blow ends the run before the bodies pass through each other.
#[test]
fn bodies_that_would_pass_through_end_the_run() {
    let soft = ContactLaw::elastic(1e-4 * E);
    for (below, above) in [("hex", "tet"), ("tet", "dem"), ("dem", "hex")] {
        let mut run = thrown(below, above, soft, 0.5);
        let error = run.run(100_000, &mut Silent).unwrap_err().to_string();
        assert!(error.contains("'contact below-above'"), "{error}");
        assert!(
            error.contains("points sink inside") && error.contains("modulus"),
            "{error}"
        );
        assert!(depth(&run) < H, "{below}, {above}");
    }
}

/// Thin plates that fly together fast are no danger to each other; one that flies at a held one is refused.
#[test]
fn speed_counts_between_bodies_only() {
    let plates = |speeds: [f64; 2]| {
        let z = Vector3::zeros();
        let low = Vector3::new(0.0, 0.0, 1.1 * H);
        let [a, b] =
            [("below", z), ("above", low)].map(|(name, low)| block("hex", name, low, [2, 2, 1], H, z));
        let [a, b] = [(a, speeds[0]), (b, speeds[1])].map(|(s, v)| s.moving(Vector3::z() * v));
        let mut run = touching(a, b, ContactLaw::elastic(E), 0.9);
        run.run(20, &mut Silent).map_err(|e| e.to_string())
    };
    assert!(plates([-9000.0, -9001.0]).is_ok());
    let error = plates([0.0, -9000.0]).unwrap_err();
    assert!(
        error.contains("way of the models of 'contact below-above'") && error.contains("must stay below"),
        "{error}"
    );
}
