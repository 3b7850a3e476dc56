//! Partition of unity and consistency of the coupling on random meshes, packings, weights, profiles,
//! mediators, junctions and rotations, for every ordered pair of the three models: action is reaction, a
//! rigid motion passes without a jump, weights sum to one, and momenta are conserved.

#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]

use arlequin::cnem::constraint::Surface;
use arlequin::cnem::domain::Domain;
use arlequin::cnem::natural::Interpolant;
use arlequin::cnem::{self, CnemModel, NaturalField, Options};
use arlequin::core::nalgebra::{Point3, Rotation3, Vector3};
use arlequin::core::{
    Coupled, Error, H1Gradient, H1Strain, InterfaceOptions, InterfaceSpec, Interpolation, Junction, L2,
    Mediator, Model, Profile, Ramp, Sampling, Silent, Slab, Subdomain, TimeStep, Weight, Weights,
    conformance,
};
use arlequin::dem_beam::{BeamMaterial, DemModel, Matter};
use arlequin::fem_ref::{Elastic, ElementKind, FemField, FemModel, Mesh, generate};
use arlequin_studies::noise;
use proptest::prelude::*;
use std::sync::Arc;

#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    Fem,
    Cnem,
    Dem,
}

/// Random parameters of a case.
#[derive(Debug, Clone)]
struct Case {
    seed: u64,
    /// End of the coarse body; the fine one begins at 2.
    end: f64,
    profile: Profile<f64>,
    epsilon: f64,
    turn: Vector3<f64>,
    /// True if the mesh of the body has tetrahedra instead of hexahedra.
    tets: [bool; 2],
    counts: [usize; 3],
    /// Kind of the mediator: hexahedra, tetrahedra, natural neighbours.
    mediator: usize,
    /// Product: L2, H1 of strains, H1 of gradients.
    junction: usize,
    /// True if particles sample the integrals; otherwise the field of natural neighbours between them does.
    particles: bool,
    /// True if integrals use the cells of all three meshes, on bodies of a few cells; otherwise velocities
    /// are taken at the mediator's nodes.
    cells: bool,
}

fn case() -> impl Strategy<Value = Case> {
    let profile = prop_oneof![
        (0.1..=0.9).prop_map(Profile::Constant),
        Just(Profile::Linear),
        Just(Profile::Cubic),
        Just(Profile::Quintic),
    ];
    let turn = prop_oneof![
        Just(Vector3::zeros()),
        prop::array::uniform3(-3.0..3.0f64).prop_map(Vector3::from),
    ];
    let place = (0..10_000u64, 2.6..3.4f64, profile, 0.01..0.3f64, turn);
    let kinds = (
        prop::array::uniform2(any::<bool>()),
        prop::array::uniform3(1..3usize),
        0..3usize,
        0..3usize,
        any::<bool>(),
        prop::bool::weighted(0.25),
    );
    (place, kinds).prop_map(
        |((seed, end, profile, epsilon, turn), (tets, counts, mediator, junction, particles, cells))| Case {
            seed,
            end,
            profile,
            epsilon,
            turn,
            tets,
            counts,
            mediator,
            junction,
            particles,
            cells,
        },
    )
}

impl Case {
    /// Returns the number of cells of a body along each axis.
    fn steps(&self, kind: Kind, role: usize) -> [usize; 3] {
        match (kind, self.cells) {
            // Layers of particles that sample the overlap must fill it evenly.
            (Kind::Dem, cells) if self.particles || !cells => [12, 3, 3],
            (_, false) => [5 - role, 2, 2],
            (Kind::Fem, true) => [4 - role, 2, 1],
            (_, true) => [3, 1, 1],
        }
    }

    fn turned(&self, p: &Point3<f64>) -> Point3<f64> {
        Rotation3::new(self.turn) * p
    }

    fn mesh(&self, tets: bool, [low, high]: [Point3<f64>; 2], counts: [usize; 3], seed: u64) -> Mesh<f64> {
        let kind = if tets {
            ElementKind::Tet4
        } else {
            ElementKind::Hex8
        };
        let mesh = generate::block(kind, low, high, counts).unwrap();
        let next = std::cell::RefCell::new(noise(seed));
        let h = 0.1 * mesh.spacing();
        mesh.mapped(|p| {
            let inside = (0..3).all(|k| p[k] > low[k] + 1e-9 && p[k] < high[k] - 1e-9);
            let moved = p + Vector3::from_fn(|_, _| next.borrow_mut()()) * if inside { h } else { 0.0 };
            self.turned(&moved)
        })
        .unwrap()
    }

    fn points(&self, [low, high]: [Point3<f64>; 2], steps: [usize; 3], seed: u64) -> Vec<Point3<f64>> {
        let lattice = cnem::generate::block(low, high, steps, 0.2, seed).unwrap();
        lattice.iter().map(|p| self.turned(p)).collect()
    }

    /// Returns a body between `x[0]` and `x[1]` and the field with which interfaces see it.
    fn body(
        &self,
        kind: Kind,
        role: usize,
        x: [f64; 2],
        alone: bool,
    ) -> (Box<dyn Model<f64>>, Arc<dyn Interpolation<f64>>) {
        let (seed, name) = (2 * self.seed + role as u64, ["left", "right"][role]);
        let matter = Elastic::new(1.0, 0.25, 1.0).unwrap();
        match kind {
            Kind::Fem => {
                let mesh = self.mesh(self.tets[role], ends(x), self.steps(kind, role), seed);
                let model = FemModel::new(name, mesh, matter).unwrap();
                let field = model.field();
                (Box::new(model), field)
            }
            Kind::Cnem => {
                let points = self.points(ends(x), self.steps(kind, role), seed);
                let domain = Domain::new(&points, &Surface::convex_hull()).unwrap();
                let model = CnemModel::new(name, domain, matter, Options::default()).unwrap();
                let field = model.field();
                (Box::new(model), field)
            }
            Kind::Dem => {
                let steps = self.steps(kind, role);
                let points = self.points(ends(x), steps, seed);
                let spacing = ((x[1] - x[0]) / steps[0] as f64).max(1.0 / steps[1] as f64);
                let model = packing(name, &points, spacing, x[1] - x[0], seed);
                // Between particles there is only a field of natural neighbours; at the particles there is
                // also their own.
                let field: Arc<dyn Interpolation<f64>> = if self.particles && alone {
                    model.particle_field()
                } else {
                    let natural = NaturalField::from_points(model.nodes(), Interpolant::Laplace);
                    Arc::new(natural.unwrap())
                };
                (Box::new(model), field)
            }
        }
    }

    /// Returns the number of the mediator's cells along each axis.
    fn counts(&self) -> [usize; 3] {
        if self.cells {
            [self.counts[0], 1, 1]
        } else {
            self.counts
        }
    }

    fn mediator(&self, sampled: bool) -> Arc<dyn Mediator<f64>> {
        // The mediator lies a hair inside of both bodies, whose faces are flat only up to the round-off of a
        // rotation; where particles on these faces sample it, it lies a hair outside.
        let hair = if sampled { -1e-6 } else { 1e-6 };
        let (inside, seed) = (Vector3::repeat(hair), self.seed + 77);
        let [low, high] = ends([2.0, self.end]);
        let x = [low + inside, high - inside];
        match self.mediator {
            2 => {
                let points = self.points(x, self.counts(), seed);
                Arc::new(NaturalField::from_points(&points, Interpolant::Sibson).unwrap())
            }
            tets => Arc::new(FemField::new(self.mesh(tets == 1, x, self.counts(), seed))),
        }
    }

    fn junction(&self) -> Box<dyn Junction<f64>> {
        match self.junction {
            0 => Box::new(L2),
            1 => Box::new(H1Strain::new(0.12).unwrap()),
            _ => Box::new(H1Gradient::new(0.12).unwrap()),
        }
    }

    fn weights(&self) -> Weights<f64> {
        let point = |x: f64| self.turned(&Point3::new(x, 0.0, 0.0));
        let slab = Slab::between(point(self.end), point(2.0)).unwrap();
        let ramp = Ramp::new(Arc::new(slab), self.profile.clone(), self.epsilon).unwrap();
        Weights::from_weight(Arc::new(ramp))
    }

    /// Returns the coupled run with the velocities that `start` gives each body.
    fn run(
        &self,
        kinds: [Kind; 2],
        start: impl Fn(&dyn Model<f64>) -> Vec<f64>,
    ) -> Result<Coupled<f64>, TestCaseError> {
        let w = self.weights();
        let complement = Weights::complement_of(std::slice::from_ref(&w));
        // Only one field may exist at its particles alone: the one whose points sample the integrals.
        let dem = kinds.map(|k| k == Kind::Dem);
        let bodies = [
            self.body(kinds[0], 0, [0.0, self.end], !dem[1]),
            self.body(kinds[1], 1, [2.0, 4.4], true),
        ];
        let sampled = bodies.iter().any(|b| b.1.samples().is_some());
        let parts = bodies
            .into_iter()
            .zip([w, complement])
            .map(|((model, field), w)| {
                let v = start(&*model);
                let s = Subdomain::new(model, field, w);
                s.with_initial(vec![0.0; v.len()], v).unwrap()
            });
        let spec = InterfaceSpec {
            name: "overlap".into(),
            coarse: 0,
            fine: 1,
            mediator: self.mediator(sampled),
            junction: self.junction(),
            options: InterfaceOptions {
                sampling: match (sampled, self.cells) {
                    (true, _) => Sampling::Particles,
                    (false, true) => Sampling::Intersection,
                    (false, false) => Sampling::Projection,
                },
                ..InterfaceOptions::default()
            },
        };
        Coupled::new(parts.collect(), vec![spec], TimeStep::Fraction(0.8), None).map_err(|e| match e {
            // Too few layers of particles for a short overlap are refused by name; any other refusal is a
            // fault.
            Error::OverhangingMediator { .. } if sampled => TestCaseError::reject(e.to_string()),
            // So few layers of loose spheres need not fill an overlap as the other body does (one case of
            // some hundred).
            Error::PartitionMass { .. } | Error::UnequalShapes { .. } | Error::UnevenFilling { .. }
                if dem != [false; 2] =>
            {
                TestCaseError::reject(e.to_string())
            }
            // Their volumes need not add up to that of the mediator either.
            Error::CoveredTwice { .. } if sampled => TestCaseError::reject(e.to_string()),
            e => TestCaseError::fail(e.to_string()),
        })
    }
}

/// Returns the two corners of a bar of unit section.
fn ends([a, b]: [f64; 2]) -> [Point3<f64>; 2] {
    [Point3::new(a, 0.0, 0.0), Point3::new(b, 1.0, 1.0)]
}

/// Returns spheres at the points, each joined to all within one and a half spacings.
fn packing(name: &str, points: &[Point3<f64>], spacing: f64, volume: f64, seed: u64) -> DemModel {
    let centres: Vec<Vector3<f64>> = points.iter().map(|p| p.coords).collect();
    let mut next = noise(seed + 5);
    let radii: Vec<f64> = centres.iter().map(|_| spacing * (0.4 + 0.1 * next())).collect();
    let mut pairs = Vec::new();
    for i in 0..centres.len() {
        let near = (i + 1..centres.len()).filter(|j| (centres[i] - centres[*j]).norm() < 1.5 * spacing);
        pairs.extend(near.map(|j| [i as u32, j as u32]));
    }
    let matter = Matter {
        beam: BeamMaterial {
            young: 3.5,
            ..BeamMaterial::SILICA
        },
        density: 1.0,
        volume,
    };
    DemModel::from_spheres(name, &centres, &radii, &pairs, &matter).unwrap()
}

/// Checks everything that must hold in a case.
fn check_consistency(kinds: [Kind; 2], case: &Case) -> Result<(), TestCaseError> {
    // Intersections of the cells of three natural-neighbour fields take too long for a property test.
    let case = &Case {
        cells: case.cells && kinds.contains(&Kind::Fem),
        ..case.clone()
    };
    // A rigid motion: no velocity jump, no energy removed at the start, no strain afterwards.
    let (t, w) = (Vector3::new(0.3, -0.4, 0.5), Vector3::new(0.2, 0.7, -0.5));
    let mut run = case.run(kinds, |m| conformance::rigid_motion(m, t, w))?;
    let energy = run.energy();
    prop_assert!(
        run.start_loss().abs() < 1e-12 * energy,
        "loss {:e}",
        run.start_loss()
    );
    let jump = run.jumps(0)[0];
    prop_assert!(jump < 1e-12, "jump {jump:e} m/s");
    // Weights of both models, at every node and in between.
    let mut next = noise(case.seed);
    let mut points: Vec<_> = (0..50)
        .map(|_| {
            case.turned(&Point3::new(
                2.2 + 2.2 * next(),
                0.5 + 0.5 * next(),
                0.5 + 0.5 * next(),
            ))
        })
        .collect();
    points.extend(
        run.subdomains()
            .iter()
            .flat_map(|s| s.model().nodes().iter().copied()),
    );
    let parts = |f: fn(&Weights<f64>) -> &Arc<dyn Weight<f64>>| -> Vec<Arc<dyn Weight<f64>>> {
        run.subdomains().iter().map(|s| f(s.weights()).clone()).collect()
    };
    for kind in [
        parts(|w| &w.internal),
        parts(|w| &w.kinetic),
        parts(|w| &w.external),
    ] {
        prop_assert!(conformance::partition_of_unity(&kind, &points) <= 1e-15);
        prop_assert!(
            points
                .iter()
                .all(|x| kind.iter().all(|w| (0.0..=1.0).contains(&w.value(x))))
        );
    }
    // Multiplier forces: the two sides are each other's transpose, and their sum and moment vanish.
    let transposed = conformance::adjointness(&run);
    let [force, moment] = conformance::interface_momentum(&run);
    // Relative to one sum of random signs, which nearly vanishes in one case of some hundred.
    prop_assert!(transposed < 1e-8, "adjoint to {transposed:e}");
    prop_assert!(
        force < 1e-12 && moment < 1e-12,
        "force {force:e}, moment {moment:e}"
    );
    prop_assert!(run.interfaces()[0].report().momentum_defect < 1e-12);
    if case.seed.is_multiple_of(4) {
        shaken(kinds, case)?;
    }
    Ok(())
}

/// Checks a random motion over some steps.
fn shaken(kinds: [Kind; 2], case: &Case) -> Result<(), TestCaseError> {
    let mut run = case.run(kinds, |m| {
        let mut next = noise(case.seed + 11);
        (0..m.layout().dofs()).map(|_| next()).collect()
    })?;
    let (before, scale) = (run.momentum(), arlequin_studies::solid::momentum_scale(&run));
    run.run(12, &mut Silent).unwrap();
    let after = run.momentum();
    for k in 0..2 {
        let change = (after[k] - before[k]).norm() / scale[k];
        prop_assert!(change < 1e-12, "momentum {k} changes by {change:e}");
    }
    prop_assert!(run.drift() < 1e-10, "drift {:e}", run.drift());
    // A dropped multiplier leaves the jump of its mode; its eigenvalue of `B M⁻¹ Bᵀ` is the square of this
    // jump.
    let dropped = &run.interfaces()[0].report().null_modes;
    let dropped_size = dropped.iter().fold(0.0, |m: f64, n| m.max(n.eigenvalue)).sqrt();
    prop_assert!(
        run.constraint_residual() < 1e-8 + 10.0 * dropped_size,
        "residual {:e}, dropped modes {dropped_size:e}",
        run.constraint_residual()
    );
    Ok(())
}

macro_rules! pairs {
    ($($name:ident: $coarse:ident, $fine:ident;)*) => {
        proptest! {
            #![proptest_config(reader_fuzz::property_config(64))]
            $(
                #[test]
                fn $name(case in case()) {
                    check_consistency([Kind::$coarse, Kind::$fine], &case)?;
                }
            )*
        }
    };
}

pairs! {
    fem_beside_fem_is_consistent: Fem, Fem;
    fem_beside_cnem_is_consistent: Fem, Cnem;
    fem_beside_dem_is_consistent: Fem, Dem;
    cnem_beside_fem_is_consistent: Cnem, Fem;
    cnem_beside_cnem_is_consistent: Cnem, Cnem;
    cnem_beside_dem_is_consistent: Cnem, Dem;
    dem_beside_fem_is_consistent: Dem, Fem;
    dem_beside_cnem_is_consistent: Dem, Cnem;
    dem_beside_dem_is_consistent: Dem, Dem;
}
