//! Bodies that are whole on no rank: the bits of the whole, and errors that name what is wrong.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use crate::support::{Along, Results, WAIT, bar, bits, same_bits, same_on, together, unknowns};
use arlequin_core::effect::StiffnessDamping;
use arlequin_core::nalgebra::{Point3, Rotation3, Vector3};
use arlequin_core::ranks::{Communicator, Division};
use arlequin_core::{
    Coupled, Elastic, Error, Guard, InterfaceSpec, L2, Model, Partition, PrescribedMotion, Sampling, Silent,
    Subdomain, TimeStep, Uniform, Weights,
};
use arlequin_mpi::threads;
use dem_beam::fracture::{Criterion, Fracture, Scatter};
use dem_beam::packing::{Bricks, Lattice};
use dem_beam::{BeamMaterial, DemModel, Matter, Piece};
use fem_ref::{ElementKind, FemField, FemModel, generate};
use std::sync::Arc;

/// Returns the bar of the other tests; `moved`: turned and far from the origin.
fn body(moved: bool) -> DemModel {
    let home = bar(false);
    if !moved {
        return home;
    }
    let turn = Rotation3::from_euler_angles(0.4, -1.1, 2.0);
    let place = |x: &Vector3<f64>| turn * x + Vector3::new(0.7, -3.0, 0.2);
    let positions: Vec<_> = home.body().positions().iter().map(place).collect();
    let matter = Matter {
        beam: BeamMaterial::SILICA,
        density: 2200.0,
        volume: 1.9e-8,
    };
    DemModel::from_spheres(
        "bar",
        &positions,
        home.body().radii(),
        home.body().pairs(),
        &matter,
    )
    .unwrap()
}

/// Returns what a rank would know of a body that was never whole. The orders of bonds, of their ends and of
/// ghosts are reversed: nothing may depend on them.
fn piece(whole: &DemModel, division: &Division, rank: usize) -> Piece {
    let is_owned = |i: u32| division.owner(i as usize) == rank;
    let reversed = whole.body().pairs().iter().rev();
    let pairs: Vec<[u32; 2]> = reversed
        .filter(|p| p.iter().any(|i| is_owned(*i)))
        .map(|[i, j]| [*j, *i])
        .collect();
    let mut ghosts: Vec<u32> = pairs
        .iter()
        .flatten()
        .copied()
        .filter(|i| !is_owned(*i))
        .collect();
    ghosts.sort_unstable();
    ghosts.dedup();
    ghosts.reverse();
    let mut numbers: Vec<u32> = (0..whole.nodes().len() as u32).filter(|i| is_owned(*i)).collect();
    numbers.extend(ghosts);
    let volumes = whole.views().particles.unwrap();
    let indices = || numbers.iter().map(|i| *i as usize);
    Piece {
        positions: indices().map(|i| whole.body().positions()[i]).collect(),
        radii: indices().map(|i| whole.body().radii()[i]).collect(),
        volumes: indices().map(|i| volumes[i].measure).collect(),
        pairs,
        mean_radius: whole.body().mean_radius(),
        beam: BeamMaterial::SILICA,
        density: 2200.0,
        numbers,
    }
}

fn halves(whole: &DemModel, ranks: usize) -> Division {
    Division::bisect(whole.nodes().len(), &whole.units(), ranks).unwrap()
}

fn part(whole: &DemModel, c: Arc<dyn Communicator>) -> DemModel {
    let division = halves(whole, c.ranks());
    DemModel::of_piece("bar", piece(whole, &division, c.rank()), &division, c).unwrap()
}

/// Returns state, ledger, critical step and breaks after some steps, with everything in motion and damped.
fn stepped(model: DemModel, finite: bool, fracture: Option<Fracture>) -> Results {
    let model = if finite {
        model.with_finite_rotations()
    } else {
        model
    };
    let model = match fracture {
        Some(spec) => model.with_fracture(spec).unwrap(),
        None => model
            .with_watched_strength(Fracture::new(Criterion::Rankine, 1e8))
            .unwrap(),
    };
    let log = model.break_log();
    let face: Vec<usize> = (0..model.nodes().len())
        .filter(|i| crate::support::global(&model, *i) < 40)
        .collect();
    let held = PrescribedMotion::fixed(model.clamped(&face));
    let mut v = unknowns(&model, [12.0, 4e4]);
    held.dofs.iter().for_each(|d| v[*d] = 0.0);
    let n = v.len();
    let side = Subdomain::fine(model, Weights::from_weight(Arc::new(Along)))
        .with_partition(Partition::Unchecked)
        .with_support(held)
        .with_effect(Box::new(StiffnessDamping::new(1e-10).unwrap()))
        .with_initial(vec![0.0; n], v)
        .unwrap();
    let guard = Guard {
        interval: 4,
        growth: 0.5,
    };
    let mut run = Coupled::new(vec![side], Vec::new(), TimeStep::Fraction(0.4), Some(guard)).unwrap();
    run.run(30, &mut Silent).unwrap();
    let e = run.last_energy().unwrap().clone();
    let mut sums = vec![
        run.dt(),
        e.invariant,
        e.internal,
        e.kinetic,
        e.work,
        e.drift,
        run.energy(),
    ];
    let [p, l] = run.momentum();
    sums.extend(p.iter().chain(&l));
    for e in log.read().unwrap().events() {
        sums.extend([e.bond, e.pair[0], e.pair[1], e.mode as u32].map(f64::from));
        sums.extend([e.time, e.released, e.distance, e.place.x, e.place.y, e.place.z]);
    }
    sums.extend(
        run.watch()
            .iter()
            .map(|(_, f)| f.message.bytes().map(f64::from).sum::<f64>()),
    );
    let s = &run.subdomains()[0];
    (
        bits(
            s.model(),
            &[s.inertia(), &s.state().q, &s.state().v, &s.state().a],
        ),
        sums,
    )
}

#[test]
fn parts_from_the_beginning_have_the_bits_of_the_whole() {
    let breaking = |criterion| Fracture {
        scatter: Scatter::Weibull { modulus: 5.0 },
        ..Fracture::new(criterion, 1.2e9)
    };
    let cases = [
        (false, false, None),
        (true, true, None),
        (false, true, Some(breaking(Criterion::Rankine))),
        (
            true,
            false,
            Some(Fracture {
                every: 3,
                ..breaking(Criterion::Mises)
            }),
        ),
    ];
    for (finite, moved, fracture) in cases {
        let whole = stepped(body(moved), finite, fracture);
        assert_eq!(
            fracture.is_some(),
            whole.1.len() > 14 + 10 * 10,
            "{}",
            whole.1.len()
        );
        // The body has six units: of eight ranks two are idle.
        for ranks in [1, 2, 3, 4, 8] {
            let joined = together(threads::run(ranks, 1, WAIT, |c| {
                stepped(part(&body(moved), c), finite, fracture)
            }));
            assert!(
                same_bits(&joined.1, &whole.1),
                "{ranks} ranks: {:?} {:?}",
                joined.1,
                whole.1
            );
            assert!(
                joined.0 == whole.0,
                "{ranks} ranks, finite {finite}, moved {moved}"
            );
        }
    }
}

/// A rank holds the particles and the halo that [`DemModel::partition_among`] leaves.
#[test]
fn a_part_holds_what_sharing_out_leaves() {
    let whole = body(true);
    let outcomes = threads::run(3, 1, WAIT, |c| {
        let own_part = part(&whole, c.clone());
        let shared = body(true).partition_among(&halves(&whole, 3), c).unwrap();
        for m in [&own_part, &shared] {
            assert!(m.places().is_empty());
        }
        assert_eq!(own_part.halo().unwrap().ghosts(), shared.halo().unwrap().ghosts());
        assert_eq!(own_part.body().pairs(), shared.body().pairs());
        assert_eq!(own_part.body().positions(), shared.body().positions());
        assert_eq!(own_part.masses(), shared.masses());
        assert_eq!(own_part.inertias(), shared.inertias());
        assert!(own_part.body().bonds().eq(shared.body().bonds()));
        let volume: f64 = whole.views().particles.unwrap().iter().map(|s| s.measure).sum();
        assert!((own_part.report().volume / volume - 1.0).abs() < 1e-13);
    });
    outcomes.into_iter().for_each(|t| t.unwrap());
}

fn run_of(bricks: &Bricks, c: Arc<dyn Communicator>) -> Results {
    let division = Division::bisect(bricks.particles(), &bricks.units(), c.ranks()).unwrap();
    let piece = bricks
        .piece(&division, c.rank(), BeamMaterial::SILICA, 2200.0)
        .unwrap();
    stepped(
        DemModel::of_piece("cube", piece, &division, c).unwrap(),
        true,
        None,
    )
}

#[test]
fn lattices_in_bricks_have_the_same_bits_on_any_number_of_ranks() {
    // Bricks that are not full, with units that cross them.
    let bricks = Bricks::new(Lattice::BodyCentred, [11, 9, 7], 3e-4).unwrap();
    let reference = together(threads::run(1, 1, WAIT, |c| run_of(&bricks, c)));
    assert_eq!(reference.0.len(), 2 * 11 * 9 * 7);
    for ranks in [2, 3, 4, 8] {
        let joined = together(threads::run(ranks, 1, WAIT, |c| run_of(&bricks, c)));
        assert!(
            same_bits(&joined.1, &reference.1) && joined.0 == reference.0,
            "{ranks} ranks"
        );
    }
}

/// Returns the errors of two ranks for a body that `change` has changed.
fn refused(change: impl Fn(usize, &mut Piece) + Sync) -> [String; 2] {
    let whole = body(false);
    let errors = threads::run(2, 1, WAIT, |c| {
        let division = halves(&whole, 2);
        let mut piece_of_rank = piece(&whole, &division, c.rank());
        change(c.rank(), &mut piece_of_rank);
        DemModel::of_piece("bar", piece_of_rank, &division, c)
            .map(|_| ())
            .unwrap_err()
            .to_string()
    });
    let texts: Vec<String> = errors.into_iter().map(|t| t.unwrap()).collect();
    texts.try_into().unwrap()
}

#[test]
fn ranks_that_differ_in_what_they_say_of_a_body_are_told_so() {
    let foreign = |p: &Piece| p.numbers.len() - 1;
    let assert_both =
        |errors: [String; 2], what: &str| errors.iter().for_each(|e| assert!(e.contains(what), "{e}"));
    let bonds = "ranks differ in the bonds between particles of different ranks";
    assert_both(
        refused(|rank, p| {
            // The particle remains a ghost through another bond.
            let far = p.numbers[foreign(p)];
            let bond = p.pairs.iter().position(|pair| pair.contains(&far)).unwrap();
            if rank == 1 {
                p.pairs.remove(bond);
            }
        }),
        bonds,
    );
    assert_both(
        refused(|rank, p| {
            let k = foreign(p);
            if rank == 0 {
                p.positions[k].y += 1e-9;
            }
        }),
        "ranks differ in the centre, the radius or the volume of particle ",
    );
    let bodies: [fn(&mut Piece); 5] = [
        |p| p.mean_radius *= 1.0 + 1e-12,
        |p| p.density *= 1.0 + 1e-12,
        |p| p.beam.young *= 1.0 + 1e-12,
        |p| p.beam.poisson += 1e-12,
        |p| p.beam.radius_ratio *= 1.0 + 1e-12,
    ];
    for change in bodies {
        assert_both(
            refused(|rank, p| {
                if rank == 1 {
                    change(p);
                }
            }),
            "ranks differ in the body of particles that they make parts of",
        );
    }
    for change in [
        |p: &mut Piece, k| p.radii[k] *= 1.001,
        |p: &mut Piece, k| p.volumes[k] *= 1.001,
    ] {
        assert_both(
            refused(|rank, p| {
                let k = foreign(p);
                if rank == 0 {
                    change(p, k);
                }
            }),
            "ranks differ in the centre, the radius or the volume of particle ",
        );
    }
}

#[test]
fn ranks_with_other_divisions_of_a_body_are_told_so() {
    let whole = body(false);
    let errors = threads::run(2, 1, WAIT, |c| {
        let mut units = whole.units();
        if c.rank() == 1 {
            units.iter_mut().for_each(|u| u.centre.x *= -1.0);
        }
        let division = Division::bisect(whole.nodes().len(), &units, 2).unwrap();
        let piece_of_rank = piece(&whole, &division, c.rank());
        DemModel::of_piece("bar", piece_of_rank, &division, c)
            .map(|_| ())
            .unwrap_err()
            .to_string()
    });
    for error in errors {
        let error = error.unwrap();
        assert!(
            error.contains("ranks differ in the body of particles that they make parts of"),
            "{error}"
        );
    }
}

type Change<'a> = &'a (dyn Fn(&mut Piece) + Sync);

#[test]
fn a_part_that_makes_no_sense_is_refused_with_the_numbers_of_the_whole() {
    let first = |change: Change<'_>| {
        let [error, second_error] = refused(|rank, p| {
            if rank == 0 {
                change(p);
            }
        });
        assert!(
            second_error.contains("rank 0 is gone") || second_error.contains("rank 0"),
            "{second_error}"
        );
        error
    };
    let whole = body(false);
    let first_piece = piece(&whole, &halves(&whole, 2), 0);
    let (owned, far) = (first_piece.numbers[5], *first_piece.numbers.last().unwrap());
    let cases: [(Change<'_>, String); 9] = [
        (
            &|p| p.numbers.swap(3, 4),
            "own particles of a part, in the order of its units has 3 entries".into(),
        ),
        (
            &|p| p.pairs.retain(|pair| !pair.contains(&owned)),
            format!("particle {owned} has no bond (1 such"),
        ),
        (&|p| p.pairs.push([owned, 9999]), "names particle 9999".into()),
        (&|p| p.radii[5] = -1.0, format!("particle {owned} has radius -1")),
        (
            &|p| p.positions[5].x = f64::NAN,
            format!("coordinate of particle {owned} is NaN"),
        ),
        (
            &|p| *p.numbers.last_mut().unwrap() = owned,
            format!("number of a particle of a part = {owned} is outside once"),
        ),
        (
            &|p| p.mean_radius = 0.0,
            "mean radius of a body = 0 is outside".into(),
        ),
        (
            &|p| p.volumes.truncate(7),
            "volumes of a part has 7 entries".into(),
        ),
        (
            &|p| p.pairs.push([far, far]),
            "is outside bonds with a particle of this rank".into(),
        ),
    ];
    for (change, expected) in cases {
        let error = first(change);
        assert!(error.contains(&expected), "{error}: {expected}");
    }
}

/// Interfaces look at the whole of a body before it is partitioned.
#[test]
fn a_part_that_is_tied_by_an_interface_is_refused_by_name() {
    let whole = body(false);
    let outcomes = threads::run(2, 1, WAIT, |c| {
        let model = part(&whole, c);
        let block = || {
            let far = Point3::new(1e-3, 1e-3, 1e-3);
            generate::block(ElementKind::Hex8, -far, far, [1, 1, 1])
        };
        let elements = FemModel::new("block", block()?, Elastic::new(72e9, 0.17, 2200.0)?)?;
        let uniform = || Weights::from_weight(Arc::new(Uniform(1.0)));
        let bodies = vec![
            Subdomain::coarse(elements, uniform()),
            Subdomain::fine(model, uniform()),
        ];
        let mut spec = InterfaceSpec::new("tie", 0, 1, Arc::new(FemField::new(block()?)), L2);
        spec.options.sampling = Sampling::Particles;
        Coupled::new(bodies, vec![spec], TimeStep::Fraction(0.5), None).map(|_| ())
    });
    for error in outcomes {
        let error: Error = error.unwrap().unwrap_err();
        let text = error.to_string();
        assert!(
            text.contains("be tied by interface 'tie' where it is in parts already"),
            "{text}"
        );
    }
}

/// The error of the second rank is examined: its local numbers differ from those of the whole body.
#[test]
fn bonds_without_length_are_told_with_the_numbers_of_the_whole() {
    let whole = body(false);
    let (division, pairs) = (halves(&whole, 2), whole.body().pairs());
    let foreign = |i: u32| division.owner(i as usize) == 0;
    let inner = |i: &u32| {
        let mut around = pairs.iter().filter(|p| p.contains(i)).flatten();
        around.all(|k| !foreign(*k))
    };
    let [i, j] = *pairs.iter().find(|p| p.iter().all(inner)).unwrap();
    let error_of = |change: &(dyn Fn(&mut Piece) + Sync)| {
        let [_, error] = refused(|rank, p| {
            if rank == 1 {
                change(p);
            }
        });
        error
    };
    let error = error_of(&|p| {
        let index = |number: u32| p.numbers.iter().position(|n| *n == number).unwrap();
        p.positions[index(j)] = p.positions[index(i)];
    });
    assert!(
        error.contains(&format!("particles {i} and {j} are 0e0 m apart")),
        "{error}"
    );
    let error = error_of(&|p| p.pairs.push([j, j]));
    let bond = pairs.partition_point(|p| *p < [j, j]);
    assert!(
        error.contains(&format!("bond {bond} between particles {j} and {j} has length")),
        "{error}"
    );
}

/// The grid of centres follows from the longest bond of all ranks; some ranks have no bond of that length.
#[test]
fn a_bond_that_is_much_longer_than_those_of_other_ranks_leaves_the_bits_of_the_whole() {
    let home = body(false);
    let x = home.body().positions();
    let far = (0..x.len()).min_by(|i, j| x[*i].x.total_cmp(&x[*j].x)).unwrap();
    let off = |i: &usize| ((x[*i] - x[far]).norm() - 1.5e-3).abs();
    let partner = (0..x.len()).min_by(|i, j| off(i).total_cmp(&off(j))).unwrap();
    let mut pairs = home.body().pairs().to_vec();
    pairs.push([far as u32, partner as u32]);
    let matter = Matter {
        beam: BeamMaterial::SILICA,
        density: 2200.0,
        volume: 1.9e-8,
    };
    let long = || DemModel::from_spheres("bar", x, home.body().radii(), &pairs, &matter).unwrap();
    // Positions as they were before the whole body rounded them to its grid.
    let part = |c: Arc<dyn Communicator>| {
        let whole = long();
        let division = halves(&whole, c.ranks());
        let mut piece_of_rank = piece(&whole, &division, c.rank());
        for (position, number) in x.iter().zip(whole.places()) {
            if let Some(k) = piece_of_rank.numbers.iter().position(|n| n == number) {
                piece_of_rank.positions[k] = *position;
            }
        }
        DemModel::of_piece("bar", piece_of_rank, &division, c).unwrap()
    };
    let whole = stepped(long(), true, None);
    same_on(&[3], &"", &whole, |c| stepped(part(c), true, None));
}

#[test]
fn bonds_that_are_named_twice_count_once() {
    let whole = body(false);
    let counts = threads::run(2, 1, WAIT, |c| {
        let division = halves(&whole, 2);
        let mut twice = piece(&whole, &division, c.rank());
        twice
            .pairs
            .extend(twice.pairs.clone().iter().map(|[i, j]| [*j, *i]));
        let twice = DemModel::of_piece("bar", twice, &division, c.clone()).unwrap();
        assert_eq!(twice.body().pairs(), part(&whole, c).body().pairs());
        twice.body().pairs().len()
    });
    counts.into_iter().for_each(|t| assert!(t.unwrap() > 100));
}
