//! Watched lists against lists of which every pair is measured in every step.

use super::super::Spring;
use super::super::body::{ContactBody, RestSpheres};
use super::super::grains::Grains;
use super::super::neighbours::{Candidate, CrossList, Listed, rest_distance_of};
use crate::packing::cells::{Sphere, centre};
use arlequin_core::ParticleField;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::sync::Arc;

const SKIN: f64 = 0.4;

/// Spheres of radius one or less on a disturbed grid, far from the origin.
fn body(edge: usize, at: [f64; 3], random: &mut Pcg64) -> Grains {
    let places = (0..edge.pow(3)).map(|i| [i / edge.pow(2), i / edge % edge, i % edge]);
    let sphere = |k: [usize; 3]| -> Sphere {
        let [x, y, z] = [0, 1, 2].map(|c| at[c] + 2.1 * k[c] as f64 + random.random_range(-0.1..0.1));
        [x, y, z, random.random_range(0.9..1.0)]
    };
    let spheres: Vec<Sphere> = places.map(sphere).collect();
    let ones = vec![1.0; spheres.len()];
    let centres = spheres.iter().map(|s| centre(s).into()).collect();
    let field = ParticleField::new(centres, &ones).expect("a field");
    let radii = spheres.iter().map(|s| s[3]).collect();
    Grains::new(ContactBody {
        name: "body".into(),
        mass: ones.into(),
        spheres: RestSpheres::new(Arc::new(field), Arc::new(radii)),
    })
}

/// Displacements of a body whose particles drift and shake; the body as a whole drifts faster.
fn displacements(count: usize, step: usize, speed: f64, side: f64) -> Vec<f64> {
    let t = step as f64 * speed;
    let of = |i: usize| {
        let phase = 1.7 * (i / 3) as f64 + i as f64;
        // Waves of a wavelength of some particles, and a shake of every particle by itself.
        side * 3.0 * t + 0.3 * (0.01 * phase + 2.0 * t).sin() + 0.15 * (phase.sin() * 9.0 * t).sin()
    };
    (0..3 * count).map(of).collect()
}

/// Closes and opens the springs as a contact law does; returns the pairs that push and the bits of their
/// overlaps.
fn close(listed: &mut Listed) -> Vec<([u32; 2], u64)> {
    let touching = listed.touching().to_vec();
    for (k, overlap) in &touching {
        *listed.springs.get_mut(*k) = Spring {
            closed: *overlap > 0.0,
            ..Spring::default()
        };
    }
    let pushing = touching.iter().filter(|(_, overlap)| *overlap > 0.0);
    pushing
        .map(|(k, overlap)| (listed.pairs[*k].ends, overlap.to_bits()))
        .collect()
}

/// Steps a watched list and its twin. Returns the number of steps in which all pairs were measured, of
/// searches, and of pushing pairs in all steps.
fn compare(bodies: &mut [Grains], speed: f64, steps: usize) -> [usize; 3] {
    let last = bodies.len() - 1;
    let mut lists = [0, 1].map(|_| CrossList::new(SKIN));
    let refresh = |list: &mut CrossList, bodies: &[Grains]| match bodies {
        [a] => {
            let rest_distance =
                |i: usize, k: usize| Some(rest_distance_of(&a.rest_spheres[i], &a.rest_spheres[k]));
            list.listed.refresh(&a.now, None, rest_distance);
        }
        [a, b, ..] => list.refresh([&a.now, &b.now], [&a.rest_spheres, &b.rest_spheres]),
        [] => {}
    };
    for list in &mut lists {
        list.tied = [0, last].map(|m| vec![false; bodies[m].len()]);
    }
    let [mut whole, mut pushing] = [0; 2];
    for step in 0..steps {
        let q: Vec<Vec<f64>> = bodies
            .iter()
            .zip([1.0, -1.0])
            .map(|(g, side)| displacements(g.len(), step, speed, side))
            .collect();
        let q: Vec<&[f64]> = q.iter().map(Vec::as_slice).collect();
        if step % 37 == 5 {
            // A bond between these two broke.
            for list in &mut lists {
                let [i, j] = [step % bodies[0].len(), (7 * step) % bodies[last].len()];
                list.listed.pairs.push(Candidate {
                    ends: [i as u32, j as u32],
                    rest_distance: 1.9,
                });
                list.listed.springs.resize(list.listed.pairs.len());
            }
        }
        let [watched, naive] = &mut lists;
        let holds = watched.listed.follow(bodies, &q);
        if !holds {
            whole += 1;
            bodies.iter_mut().zip(&q).for_each(|(g, q)| g.place(q));
            refresh(watched, bodies);
            watched.listed.measure(bodies, &q);
        }
        bodies.iter_mut().zip(&q).for_each(|(g, q)| g.place(q));
        refresh(naive, bodies);
        naive.listed.measure(bodies, &q);
        assert_eq!(watched.listed.counts(), naive.listed.counts(), "step {step}");
        assert_eq!(watched.listed.pairs, naive.listed.pairs, "step {step}");
        let [a, b] = [close(&mut watched.listed), close(&mut naive.listed)];
        assert_eq!(a, b, "step {step}");
        let closed = |list: &CrossList| list.listed.springs.iter().filter(|(_, s)| s.closed).count();
        assert_eq!([closed(watched), closed(naive)], [a.len(); 2], "step {step}");
        pushing += a.len();
    }
    [whole, lists[0].listed.counts()[0], pushing]
}

#[test]
fn the_same_pairs_push_with_the_same_bits_as_if_all_were_measured() {
    let random = &mut Pcg64::seed_from_u64(7);
    for speed in [1e-4, 3e-3, 0.1] {
        let one = &mut [body(9, [300.0, -20.0, 5.0], random)];
        let two = &mut [body(7, [0.0; 3], random), body(8, [13.0, 1.0, 0.0], random)];
        for bodies in [&mut one[..], &mut two[..]] {
            let [whole, searches, pushing] = compare(bodies, speed, 400);
            assert!(pushing > 0 && searches > 0, "{pushing} {searches}");
            // Slow motion: nearly all steps look at a few pairs only.
            assert!(speed > 1e-3 || whole < 40, "{whole} of 400 steps");
            // Fast motion: the list is searched again and again.
            assert!(speed < 0.01 || searches > 20, "{searches}");
        }
    }
}
