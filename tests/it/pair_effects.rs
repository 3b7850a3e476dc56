//! Effects between two subdomains, written by a third party: a spring between two bars of finite elements.

#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]

use arlequin::core::effect::{
    AnyEffect, HostPair, Instant, PairEffect, PairEffectSpec, PairSpec, StepDemand,
};
use arlequin::core::{
    Coupled, Model, OwnStep, Parts, Phase, Silent, Subdomain, TimeStep, Weights, conformance,
};
use arlequin::fem_ref::{Elastic, FemModel, generate};

/// Force `f = k (x_b − x_a) + c (v_b − v_a)` between the last node of the first side and the first node of
/// the second. With `c < 0` it creates energy.
struct Link {
    stiffness: f64,
    damping: f64,
    /// True if the effect declares that it has no external supply of energy.
    honest: bool,
    top: f64,
    last: usize,
    force: f64,
    stored: f64,
}

impl Link {
    fn new(stiffness: f64, damping: f64, honest: bool) -> Self {
        Self {
            stiffness,
            damping,
            honest,
            top: 0.0,
            last: 0,
            force: 0.0,
            stored: 0.0,
        }
    }
}

impl PairEffectSpec<f64> for Link {
    fn name(&self) -> &str {
        "link left-right"
    }
    fn attach(
        mut self: Box<Self>,
        host: &HostPair<'_, f64>,
    ) -> arlequin::core::Result<Box<dyn PairEffect<f64>>> {
        assert!(host.tied.iter().all(Vec::is_empty), "no interface");
        let [a, b] = &host.sides;
        self.last = a.model.layout().nodes - 1;
        self.top = self.stiffness * a.inverse_inertia[self.last].max(b.inverse_inertia[0]);
        Ok(self)
    }
}

impl AnyEffect<f64> for Link {
    fn name(&self) -> &str {
        "link left-right"
    }
    fn stored(&self) -> f64 {
        self.stored
    }
    fn supplied(&self) -> Option<f64> {
        self.honest.then_some(0.0)
    }
    fn facts(&self) -> Vec<(String, f64)> {
        vec![("force [N]".into(), self.force)]
    }
}

impl PairEffect<f64> for Link {
    fn add_forces(
        &mut self,
        instants: [&Instant<'_, f64>; 2],
        f: [&mut [f64]; 2],
    ) -> arlequin::core::Result<()> {
        let stretch = instants[1].q[0] - instants[0].q[self.last];
        let rate = instants[1].v_half[0] - instants[0].v_half[self.last];
        self.force = self.stiffness * stretch + self.damping * rate;
        let before = stretch - instants[0].dt * rate;
        self.stored = 0.5 * self.stiffness * stretch * before;
        f[0][self.last] += self.force;
        f[1][0] -= self.force;
        Ok(())
    }
    fn power(&self, v: [&[f64]; 2]) -> f64 {
        self.force * (v[0][self.last] - v[1][0])
    }
    fn step_demand(&self) -> [StepDemand<f64>; 2] {
        let demand = StepDemand {
            stiffness: 2.0 * self.top,
            ..StepDemand::none()
        };
        [demand, demand]
    }
}

fn bar(name: &str, from: f64, speed: f64) -> Subdomain<f64> {
    let mesh = generate::bar(from, from + 1.0, 20, 1e-4).unwrap();
    let model = FemModel::new(name, mesh, Elastic::new(70e9, 0.0, 2700.0).unwrap()).unwrap();
    let n = model.layout().dofs();
    Subdomain::coarse(model, Weights::uncoupled())
        .with_initial(vec![0.0; n], vec![speed; n])
        .unwrap()
}

fn linked(link: Option<Link>) -> Coupled<f64> {
    stepped(link, [OwnStep::Same; 2]).unwrap()
}

fn stepped(link: Option<Link>, own_steps: [OwnStep<f64>; 2]) -> arlequin::core::Result<Coupled<f64>> {
    let pairs = link.into_iter().map(|l| PairSpec {
        sides: [0, 1],
        effect: Box::new(l) as Box<dyn PairEffectSpec<f64>>,
    });
    let parts = Parts {
        start: 0.0,
        end: None,
        subdomains: vec![
            bar("left", 0.0, 0.0).with_step(own_steps[0]),
            bar("right", 1.1, 1.0).with_step(own_steps[1]),
        ],
        interfaces: Vec::new(),
        pairs: pairs.collect(),
    };
    Coupled::from_parts(parts, TimeStep::Fraction(0.5), None)
}

#[test]
fn models_with_an_effect_between_them_make_the_same_own_steps() {
    let spring = || Some(Link::new(1e8, 500.0, false));
    let mut run = stepped(spring(), [OwnStep::Same, OwnStep::Ratio(4)]).unwrap();
    assert!(run.subdomains().iter().all(|s| s.own_steps() == 4));
    let [p, _] = run.momentum();
    run.run(500, &mut Silent).unwrap();
    assert!(run.drift() < 1e-11, "{}", run.drift());
    let defect = (run.momentum()[0] - p).norm() / p.norm();
    assert!(
        defect < 1e-11 && run.subdomains()[0].momentum()[0].x > 0.1 * p.x,
        "{defect:e}"
    );
    let refused = |own_steps| stepped(spring(), own_steps).map(|_| ()).unwrap_err().to_string();
    let text = refused([OwnStep::Ratio(2), OwnStep::Ratio(3)]);
    assert!(
        text.contains("'left' and 'right'") && text.contains("2 and 3"),
        "{text}"
    );
    let text = refused([OwnStep::Implicit, OwnStep::Same]);
    assert!(
        text.contains("'left' cannot step implicitly: an effect between"),
        "{text}"
    );
}

#[test]
fn a_spring_between_two_bars_keeps_momentum_and_the_ledger() {
    for damping in [0.0, 500.0] {
        let mut run = linked(Some(Link::new(1e8, damping, false)));
        let before = run.energy();
        let [p, _] = run.momentum();
        run.run(2_000, &mut Silent).unwrap();
        let [q, _] = run.momentum();
        let defect = (q - p).norm() / p.norm();
        assert!(defect < 1e-11, "{defect:e}");
        assert!(run.drift() < 1e-11, "{}", run.drift());
        let line = run.effects().remove(0);
        assert_eq!(
            (line.name.as_str(), line.phase),
            ("link left-right", Some(Phase::Pair(0)))
        );
        let work = line.work.unwrap();
        assert!(work < 0.0 && work > -before, "{work} of {before}");
        assert_eq!(run.works()[0].name, "link left-right");
        assert_eq!(run.plan().effects, ["link left-right"]);
        // The left bar has received momentum.
        assert!(run.subdomains()[0].momentum()[0].x > 0.1 * p.x);
    }
}

#[test]
fn its_demand_shortens_the_step_of_both() {
    let free = linked(None).critical_steps().to_vec();
    let run = linked(Some(Link::new(1e9, 0.0, false)));
    for (linked_step, free_step) in run.critical_steps().iter().zip(&free) {
        assert!(linked_step < &(0.9 * free_step), "{linked_step} {free_step}");
    }
}

#[test]
fn one_that_makes_energy_ends_the_run_by_name() {
    // A motor that pulls along the motion. Without the declaration its energy counts as external work.
    let mut free = linked(Some(Link::new(1e7, -200.0, false)));
    free.run(200, &mut Silent).unwrap();
    assert!(free.energy() > 0.0 && free.drift() < 1e-12);
    let error = linked(Some(Link::new(1e7, -200.0, true)))
        .run(2_000, &mut Silent)
        .unwrap_err()
        .to_string();
    assert!(error.contains("0.1 %"), "{error}");
}

#[test]
fn reactions_are_measured() {
    struct OneSided;
    impl AnyEffect<f64> for OneSided {
        fn name(&self) -> &str {
            "one-sided"
        }
    }
    impl PairEffect<f64> for OneSided {
        fn add_forces(
            &mut self,
            _: [&Instant<'_, f64>; 2],
            f: [&mut [f64]; 2],
        ) -> arlequin::core::Result<()> {
            f[0][3] += 2.0;
            f[1][0] -= 1.0;
            Ok(())
        }
        fn power(&self, _: [&[f64]; 2]) -> f64 {
            0.0
        }
    }
    let run = linked(None);
    let layouts = [0, 1].map(|k: usize| run.subdomains()[k].model().layout());
    let q = vec![1e-6; layouts[0].dofs()];
    let instant = Instant {
        time: 0.0,
        q: &q,
        v_half: &q,
        dt: 1e-6,
        number: 1,
        internal: &q,
        internal_before: &q,
    };
    let defect = conformance::reaction(&mut OneSided, [&instant, &instant], layouts).unwrap();
    assert!((defect - 1.0 / 3.0).abs() < 1e-15, "{defect}");
    let mut link = Link::new(1.0, 1.0, true);
    assert!(conformance::reaction(&mut link, [&instant, &instant], layouts).unwrap() < 1e-15);
}
