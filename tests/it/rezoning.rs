//! Zones that move on the line: the table of docs/design/moving-zones.md.

use arlequin::core::effect::{BodyForce, EffectSpec, MassDamping};
use arlequin::core::nalgebra::Vector3;
use arlequin::core::{
    Coupled, Error, Guard, OwnStep, PrescribedMotion, Profile, Rezoning, Silent, Subdomain, TimeFunction,
    TimeStep, Weights,
};
use arlequin_studies::moving::{Account, BAR, CHAIN, H, Moving, NOWHERE};

/// Prints what a test measures, for the table in the docs.
#[allow(clippy::print_stdout, reason = "shown with --nocapture")]
fn report(what: &str, account: &Account, run: &Coupled<f64>) {
    println!(
        "{what}: {} changes, Σ|W| {:.2e}, gains {:.2e}, top {:.6}, end {:.6}, restored {:.1e}, drift {:.1e}",
        account.count,
        account.moduli,
        account.gains,
        account.top,
        account.end,
        account.restored,
        run.drift(),
    );
}

fn peak(run: &Coupled<f64>) -> f64 {
    let chain = &run.subdomains()[CHAIN];
    let awake = |k: &usize| !chain.is_asleep(*k);
    let nodes = (0..chain.state().q.len()).filter(awake);
    nodes.map(|k| chain.state().q[k]).fold(0.0, f64::max)
}

/// Relative change of the momentum since the start.
fn lost_momentum(run: &Coupled<f64>) -> f64 {
    run.bodies()[0].drift[0]
}

#[test]
fn a_pulse_is_carried_along_eighty_cells() {
    for (half_width, zone, own, limit) in [
        (3.0, [240.0, 360.0], 1, 1e-6),
        (3.0, [240.0, 360.0], 4, 1e-6),
        (6.0, [190.0, 410.0], 1, 1e-8),
        (6.0, [190.0, 410.0], 4, 1e-8),
        (15.0, [190.0, 410.0], 1, 5e-3),
        (15.0, [190.0, 410.0], 4, 5e-3),
    ] {
        let line = Moving {
            zone,
            own,
            ..Moving::default()
        };
        let mut run = line.build(&line.pulse(2.0 * half_width * H)).unwrap();
        let account = line.carry(&mut run, (80, H, 1.0), &mut |_, _| ()).unwrap();
        report(
            &format!(
                "pulse of {half_width} h in {zone:?}, m = {own}, peak {:.4}",
                peak(&run)
            ),
            &account,
            &run,
        );
        assert!(account.moduli < limit && account.gains < 1e-8, "{account:?}");
        assert!((peak(&run) - 1.0).abs() < 0.015, "{}", peak(&run));
        assert!(
            run.drift() < 1e-12 && lost_momentum(&run) < 1e-12,
            "{:e}",
            run.drift()
        );
    }
}

#[test]
fn scattered_springs_lose_what_the_bar_cannot_carry() {
    for (seed, own) in [(1, 1), (2, 1), (3, 1), (4, 1), (1, 4)] {
        let line = Moving {
            zone: [200.0, 600.0],
            cells: 120,
            scatter: 0.6,
            seed,
            own,
            ..Moving::default()
        };
        let mut run = line.build(&line.pulse(6.0 * H)).unwrap();
        let account = line.carry(&mut run, (14, H, 1.0), &mut |_, _| ()).unwrap();
        report(&format!("springs ±60 %, seed {seed}, m = {own}"), &account, &run);
        assert!(account.moduli < 0.02 && account.gains < 1e-5, "{account:?}");
        assert!(
            account.restored > 1e-8 && lost_momentum(&run) < 1e-13,
            "{:e}",
            lost_momentum(&run)
        );
        assert!(run.drift() < 1e-12, "{:e}", run.drift());
    }
}

#[test]
fn random_states_never_gain_energy() {
    for (own, seeds) in [(1, 4), (4, 1)] {
        for speed in [1.0, 0.3, 0.1, 0.03] {
            for seed in 1..=seeds {
                let line = Moving {
                    cells: 80,
                    zone: [140.0, 260.0],
                    seed,
                    own,
                    ..Moving::default()
                };
                let mut run = line.build(&line.random()).unwrap();
                let account = line.carry(&mut run, (36, H, speed), &mut |_, _| ()).unwrap();
                report(&format!("random {seed} at {speed}, m = {own}"), &account, &run);
                assert!(account.top < 1.0 && account.gains < 1e-3, "{account:?}");
                assert!(
                    run.drift() < 1e-11 && lost_momentum(&run) < 1e-12,
                    "{:e}",
                    run.drift()
                );
            }
        }
    }
}

#[test]
fn with_an_absorber_nothing_is_gained() {
    for seed in 1..=4 {
        let line = Moving {
            cells: 80,
            zone: [140.0, 260.0],
            seed,
            absorber: 0.2,
            ..Moving::default()
        };
        let mut run = line.build(&line.random()).unwrap();
        let account = line.carry(&mut run, (36, H, 1.0), &mut |_, _| ()).unwrap();
        report(&format!("random {seed} with absorbers"), &account, &run);
        assert!(account.gains < 1e-12 && account.top < 1.0, "{account:?}");
        // The absorbers keep their works from change to change.
        let lost: f64 = run.effects().iter().filter_map(|e| e.work).sum();
        assert!(lost < -0.01 * account.start, "{lost:e}");
        assert!(run.drift() < 1e-12, "{:e}", run.drift());
    }
}

#[test]
fn rigid_flight_and_uniform_strain_do_no_work() {
    let line = Moving::default();
    for own in [1, 4] {
        let line = Moving { own, ..line.clone() };
        let mut run = line.build(&line.state(|_| (0.25, 0.7))).unwrap();
        let momentum = run.momentum()[0].x;
        let mut most = 0.0f64;
        let account = line.carry(&mut run, (100, H, 5.0), &mut |_, c| {
            let parts = [c.work, c.potential, c.kinetic, c.rigid, c.start];
            most = parts.into_iter().fold(most, |m, x| m.max(x.abs()));
        });
        let account = account.unwrap();
        report(&format!("rigid flight, m = {own}"), &account, &run);
        assert!(most < 1e-11 * account.start, "{most:e}");
        assert!((run.momentum()[0].x / momentum - 1.0).abs() < 1e-12);
    }
    // Held at both ends in uniform strain: nothing moves, whatever the zone does.
    let strain = 1e-3;
    let mut run = line.build(&line.state(|x| (strain * x, 0.0))).unwrap();
    let mut most = 0.0f64;
    for n in 1..=100 {
        let at = 240.0 + 10.0 * f64::from(n);
        let change = line.rezone(&mut run, [at, at + 120.0]).unwrap();
        most = most.max(change.work.abs());
    }
    assert!(most < 1e-12 * run.energy(), "{most:e} of {:e}", run.energy());
    let stretched = run.subdomains().iter().all(|s| {
        let nodes = s.model().nodes().iter().zip(&s.state().q).enumerate();
        nodes
            .filter(|(k, _)| !s.is_asleep(*k))
            .all(|(_, (x, q))| (q - strain * x.x).abs() < 1e-12)
    });
    assert!(stretched);
}

#[test]
fn there_and_back_and_toggled_zones_stay_bounded() {
    let line = Moving {
        cells: 80,
        zone: [240.0, 360.0],
        ..Moving::default()
    };
    for (what, state) in [("pulse", line.pulse(6.0 * H)), ("random", line.random())] {
        let mut run = line.build(&state).unwrap();
        let out = line.carry(&mut run, (14, H, 1.0), &mut |_, _| ()).unwrap();
        let mut account = Account::default();
        for n in (0..14).rev() {
            run.run(20, &mut Silent).unwrap();
            let zone = line.zone.map(|x| x + H * f64::from(n));
            let change = line.rezone(&mut run, zone).unwrap();
            account.add(&run, &change);
        }
        report(&format!("{what} there"), &out, &run);
        report(&format!("{what} and back"), &account, &run);
        assert!(account.top < 1.0 + 1e-5 && account.gains < 1e-4, "{account:?}");
        // Toggled every ten steps.
        let mut run = line.build(&state).unwrap();
        let mut account = Account::default();
        for n in 0..100 {
            run.run(10, &mut Silent).unwrap();
            let zone = line.zone.map(|x| x + if n % 2 == 0 { H } else { 0.0 });
            let change = line.rezone(&mut run, zone).unwrap();
            account.add(&run, &change);
        }
        report(&format!("{what} toggled"), &account, &run);
        assert!(account.top < 1.0 + 1e-5 && account.gains < 5e-3, "{account:?}");
        assert!(run.drift() < 1e-11, "{:e}", run.drift());
    }
}

#[test]
fn a_snapshot_after_a_change_is_restored_only_beside_its_weights() {
    let line = Moving {
        cells: 80,
        zone: [240.0, 360.0],
        absorber: 0.1,
        ..Moving::default()
    };
    let moved = line.zone.map(|x| x + 30.0);
    let mut first = line.build(&line.random()).unwrap();
    first.run(7, &mut Silent).unwrap();
    line.rezone(&mut first, moved).unwrap();
    first.run(5, &mut Silent).unwrap();
    let saved = first.snapshot().unwrap();
    // Any state will do: it is replaced.
    let mut second = Moving {
        zone: moved,
        ..line.clone()
    }
    .build(&line.pulse(60.0))
    .unwrap();
    second.restore(&saved).unwrap();
    let bits = |run: &Coupled<f64>| -> Vec<u64> {
        let states = run
            .subdomains()
            .iter()
            .flat_map(|s| s.state().q.iter().chain(&s.state().v));
        let works = run.works().into_iter().map(|w| w.work).collect::<Vec<_>>();
        states
            .copied()
            .chain(works)
            .chain(run.last_energy().map(|e| e.drift))
            .map(f64::to_bits)
            .collect()
    };
    for run in [&mut first, &mut second] {
        run.run(5, &mut Silent).unwrap();
        line.rezone(run, line.zone).unwrap();
        run.run(5, &mut Silent).unwrap();
    }
    assert_eq!(first.conversions(), 2);
    assert!(bits(&first) == bits(&second), "other bits after a restart");
    let mut elsewhere = line.build(&line.random()).unwrap();
    let refused = elsewhere.restore(&saved);
    assert!(
        matches!(&refused, Err(Error::InvalidParameter { name, .. }) if name.contains("changes of weights")),
        "{refused:?}"
    );
}

/// Begins without a zone, which comes when the pulse is in the bar and leaves again.
#[test]
fn a_zone_that_begins_empty_comes_and_goes() {
    for (own, absorber) in [(1, 0.0), (4, 0.0), (1, 0.2)] {
        let line = Moving {
            zone: NOWHERE,
            own,
            absorber,
            ..Moving::default()
        };
        // Long waves, so that bar and chain carry the same.
        let pulse = Moving {
            zone: [440.0, 560.0],
            ..line.clone()
        }
        .pulse(40.0 * H);
        let mut run = line.build(&pulse).unwrap();
        let mut alone = line.build(&pulse).unwrap();
        let awake = |run: &Coupled<f64>| {
            let chain = &run.subdomains()[CHAIN];
            (0..chain.state().q.len()).any(|k| !chain.is_asleep(k))
        };
        run.run(40 / own, &mut Silent).unwrap();
        assert!(!awake(&run) && run.interfaces()[0].report().multipliers == 0);
        let mut account = Account::default();
        for (zone, steps) in [([500.0, 660.0], 80), (NOWHERE, 80), ([400.0, 840.0], 80)] {
            let change = line.rezone(&mut run, zone).unwrap();
            account.add(&run, &change);
            assert_eq!(awake(&run), zone != NOWHERE);
            run.run(steps / own, &mut Silent).unwrap();
        }
        report(
            &format!("begins empty, m = {own}, absorber {absorber}"),
            &account,
            &run,
        );
        // Interpolation between elements and means over them take (k h)²/6 of a wave's kinetic energy.
        assert!(account.moduli < 0.02 && account.gains < 1e-4, "{account:?}");
        assert!(
            run.drift() < 1e-11 && lost_momentum(&run) < 1e-12,
            "{:e}",
            run.drift()
        );
        alone.run(280 / own, &mut Silent).unwrap();
        let bar = |run: &Coupled<f64>| run.subdomains()[BAR].state().q.clone();
        let most = |q: &[f64]| q.iter().fold(0.0, |m: f64, q| m.max(q.abs()));
        let apart: Vec<f64> = (bar(&run).iter().zip(bar(&alone)).enumerate())
            .filter(|(k, _)| !run.subdomains()[BAR].is_asleep(*k))
            .map(|(_, (a, b))| a - b)
            .collect();
        assert!(most(&apart) < 0.05 * most(&bar(&alone)), "{:e}", most(&apart));
    }
    // Two models that are both awake must be tied.
    let zone = [240.0, 360.0];
    let line = Moving {
        zone,
        ..Moving::default()
    };
    let mut run = line.build(&line.pulse(60.0)).unwrap();
    let [coarse, fine] = Moving::weights(zone).unwrap();
    let untied = Rezoning::new(Moving::interfaces(NOWHERE).unwrap())
        .with_weights(BAR, coarse)
        .with_weights(CHAIN, fine);
    let text = run.rezone(untied).unwrap_err().to_string();
    assert!(text.contains("overlap"), "{text}");
}

#[test]
fn changes_that_do_not_fit_the_run_are_refused_by_name() {
    let line = Moving {
        cells: 80,
        ..Moving::default()
    };
    let zone = line.zone;
    let mut run = line.build(&line.pulse(60.0)).unwrap();
    let one = vec![Moving::interfaces(zone).unwrap().remove(0)];
    let text = run.rezone(Rezoning::new(one)).unwrap_err().to_string();
    assert!(
        text.contains("interfaces of new weights") && text.contains("right"),
        "{text}"
    );
    let [coarse, fine] = Moving::weights(zone).unwrap();
    let twice = Rezoning::new(Moving::interfaces(zone).unwrap())
        .with_weights(BAR, coarse)
        .with_weights(BAR, fine);
    let text = run.rezone(twice).unwrap_err().to_string();
    assert!(text.contains("subdomain of new weights"), "{text}");
    // Weights that do not sum to one.
    let [_, fine] = Moving::weights(zone.map(|x| x + 50.0)).unwrap();
    let gap = Rezoning::new(Moving::interfaces(zone).unwrap()).with_weights(CHAIN, fine);
    let refused = run.rezone(gap);
    assert!(refused.is_err(), "{refused:?}");
    // Effects that are not made for the new weights.
    let damped = Moving {
        absorber: 0.1,
        cells: 80,
        ..Moving::default()
    };
    let mut run = damped.build(&damped.pulse(60.0)).unwrap();
    let text = line.rezone(&mut run, zone).unwrap_err().to_string();
    assert!(
        text.contains("new effects of 'chain'") && text.contains("absorber"),
        "{text}"
    );
}

/// New weights that need a shorter step: more own steps are made, also after a restart, and a number that was
/// asked for is refused.
#[test]
fn new_weights_that_need_a_shorter_step_get_more_own_steps() {
    let line = Moving {
        cells: 80,
        ..Moving::default()
    };
    let ties = || Moving::interfaces(line.zone).unwrap();
    let build = |own: OwnStep<f64>| {
        let [coarse, fine] = Moving::weights(line.zone).unwrap();
        let (bar, chain) = line.models().unwrap();
        let mut chain = Subdomain::fine(chain, fine).with_sleep().with_step(own);
        let count = chain.state().v.len();
        let velocities = (0..count).map(|k| 1e-3 * (k as f64).sin()).collect();
        chain = chain.with_initial(vec![0.0; count], velocities).unwrap();
        let bodies = vec![Subdomain::coarse(bar, coarse).with_sleep(), chain];
        Coupled::new(bodies, ties(), TimeStep::Seconds(0.9), None).unwrap()
    };
    let same = || {
        let [coarse, fine] = Moving::weights(line.zone).unwrap();
        Rezoning::new(ties())
            .with_weights(BAR, coarse)
            .with_weights(CHAIN, fine)
    };
    // Masses that vanish faster than the stiffness.
    let light = || {
        let heavy = Moving::profiled(line.zone, &Profile::Quintic).unwrap();
        let stiff = Moving::profiled(line.zone, &Profile::Linear).unwrap();
        let [coarse, fine] = [0, 1].map(|k| Weights {
            internal: stiff[k].internal.clone(),
            ..heavy[k].clone()
        });
        Rezoning::new(ties())
            .with_weights(BAR, coarse)
            .with_weights(CHAIN, fine)
    };
    let mut asked = build(OwnStep::Ratio(1));
    asked.rezone(same()).unwrap();
    let refused = asked.rezone(light());
    assert!(
        matches!(&refused, Err(Error::UnstableStep { model, .. }) if model == "chain"),
        "{refused:?}"
    );
    let mut run = build(OwnStep::Same);
    run.rezone(same()).unwrap();
    assert_eq!(run.subdomains()[CHAIN].own_steps(), 1);
    run.run(5, &mut Silent).unwrap();
    run.rezone(light()).unwrap();
    let steps = run.subdomains()[CHAIN].own_steps();
    assert!(steps > 1, "{steps}");
    let saved = run.snapshot().unwrap();
    let before = run.energy();
    run.run(2000, &mut Silent).unwrap();
    let after = run.energy();
    // Masses other than those of the stiffness: this energy swings, and an unstable step would make it 1e100.
    assert!((0.5..2.0).contains(&(after / before)), "{before} {after}");
    // Another run takes the number of own steps from the snapshot.
    let mut again = build(OwnStep::Same);
    again.rezone(light()).unwrap();
    again.restore(&saved).unwrap();
    assert_eq!(again.subdomains()[CHAIN].own_steps(), steps);
    again.run(2000, &mut Silent).unwrap();
    assert_eq!(again.energy().to_bits(), after.to_bits());
}

/// The balance closes over changes of weights under a moving support, loads and damping, and with an implicit
/// bar.
#[test]
fn the_ledger_closes_under_loads_and_supports_and_with_an_implicit_bar() {
    let line = Moving {
        cells: 60,
        ..Moving::default()
    };
    let steps = [
        ("explicit", OwnStep::Ratio(1), OwnStep::Ratio(1), 0.5),
        ("own steps", OwnStep::Ratio(2), OwnStep::Ratio(6), 3.0),
        ("implicit", OwnStep::Implicit, OwnStep::Ratio(30), 15.0),
    ];
    for (what, coarse_step, fine_step, dt) in steps {
        let damped = coarse_step != OwnStep::Implicit;
        let effects = || {
            let mut out: Vec<Box<dyn EffectSpec<f64>>> =
                vec![Box::new(BodyForce::new(Vector3::new(1e-3, 0.0, 0.0)).unwrap())];
            // The implicit scheme takes dead loads only.
            if damped {
                out.push(Box::new(MassDamping::new(1e-3).unwrap()));
            }
            out
        };
        let with_effects =
            |s: Subdomain<f64>| effects().into_iter().fold(s.with_sleep(), Subdomain::with_effect);
        let (bar, chain) = line.models().unwrap();
        let [coarse, fine] = Moving::weights(line.zone).unwrap();
        let support = PrescribedMotion {
            dofs: vec![0],
            amplitude: 0.5,
            time: TimeFunction::SmoothPulse { duration: 200.0 },
        };
        let [[bar_q, bar_v], [chain_q, chain_v]] = line.pulse(12.0 * H);
        let bar = with_effects(Subdomain::coarse(bar, coarse)).with_support(support);
        let chain = with_effects(Subdomain::fine(chain, fine));
        let bodies = vec![
            bar.with_step(coarse_step).with_initial(bar_q, bar_v).unwrap(),
            chain.with_step(fine_step).with_initial(chain_q, chain_v).unwrap(),
        ];
        let guard = Guard {
            interval: 1,
            growth: 0.05,
        };
        let ties = Moving::interfaces(line.zone).unwrap();
        let mut run = Coupled::new(bodies, ties, TimeStep::Seconds(dt), Some(guard)).unwrap();
        let (mut moduli, mut scale) = (0.0, 0.0f64);
        for n in 1..=12 {
            run.run((15.0 / dt).ceil() as usize, &mut Silent).unwrap();
            scale = scale.max(run.last_energy().unwrap().invariant);
            let zone = line.zone.map(|x| x + H * f64::from(n));
            let [coarse, fine] = Moving::weights(zone).unwrap();
            let change = Rezoning::new(Moving::interfaces(zone).unwrap())
                .with_weights(BAR, coarse)
                .with_weights(CHAIN, fine);
            let change = effects().into_iter().fold(change, |c, e| c.with_effect(BAR, e));
            let change = effects().into_iter().fold(change, |c, e| c.with_effect(CHAIN, e));
            moduli += run.rezone(change).unwrap().work.abs();
        }
        run.run(5, &mut Silent).unwrap();
        println!("{what}: Σ|W| {:.1e} E, drift {:.1e}", moduli / scale, run.drift());
        assert!(moduli > 1e-8 * scale && moduli < scale, "{what}: {moduli:e}");
        assert!(run.drift() < 1e-11, "{what}: {:e}", run.drift());
    }
}
