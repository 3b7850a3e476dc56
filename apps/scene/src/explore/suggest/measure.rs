//! Trial steps, which measure the cost of a scene on this machine.

use super::apply::Change;
use super::around;
use super::choose::Measured;
use super::scenario::{self, Scenario};
use crate::error::{Result, core};
use crate::run::PhaseClock;
use crate::scene::Scene;
use crate::setup::{self, lower};
use arlequin::core::Coupled;
use std::time::Instant;

/// Duration of the trial steps per scene \[s\].
const TRIAL: f64 = 0.3;
/// Number of steps timed together. The shortest time counts, because other programs share the machine.
const STRETCH: usize = 10;

/// Builds the scene with changes and makes trial steps. Returns the measurement, the end of the run \[s\],
/// the lengths of the scene with these changes, and the warnings of its set-up.
pub(super) fn measure(scene: &Scene, changes: &[Change]) -> Result<(Measured, f64, Scenario, Vec<String>)> {
    let begin = Instant::now();
    let assignments: Vec<String> = changes.iter().map(Change::assignment).collect();
    let scene = scene.clone().assign(&assignments)?;
    let s = scenario::scenario(scene.spec())?;
    let built = setup::build(scene.spec(), scene.folder());
    let built = built.map_err(|e| lower::written(scene.spec(), e))?;
    let setup = begin.elapsed().as_secs_f64();
    let s = around::with_models(s, scene.spec(), &built)?;
    let mut run = built.run;
    let end = s.end.unwrap_or(built.steps as f64 * run.dt());
    let mut seconds = [0.0; 4];
    let mut least = f64::INFINITY;
    let begin = Instant::now();
    let mut first = true;
    while first || least.is_infinite() || begin.elapsed().as_secs_f64() < TRIAL {
        let mut clock = PhaseClock::new();
        for _ in 0..STRETCH {
            run.advance(&mut clock).map_err(core("time"))?;
        }
        clock.enter(None);
        let [total, _] = clock.split();
        // The first stretch warms the caches.
        if !first && total < least {
            least = total;
            seconds = share(&clock, &run, &s).map(|x| x / STRETCH as f64);
        }
        first = false;
    }
    let index = |name: &String| run.subdomains().iter().position(|d| d.model().name() == name);
    let sides = [index(&s.names[1]).unwrap_or(0), index(&s.names[2]).unwrap_or(0)];
    let r = run.interfaces()[0].report();
    let most = run.subdomains().iter().map(|d| d.own_steps()).max().unwrap_or(1);
    let measured = Measured {
        nodes: sides.map(|k| run.subdomains()[k].model().layout().nodes as f64),
        coupled: [r.coupled_nodes[0], r.coupled_nodes[1], r.multipliers].map(|n| n as f64),
        seconds,
        setup,
        dt: run.dt() / most as f64,
        own_steps: sides.map(|k| run.subdomains()[k].own_steps() as f64),
        most: most as f64,
        critical: sides.map(|k| run.critical_steps()[k]),
    };
    Ok((measured, end, s, built.warnings))
}

/// Divides the measured seconds into coarse model, fine model, interface and rest.
fn share(clock: &PhaseClock, run: &Coupled<f64>, s: &Scenario) -> [f64; 4] {
    let mut out = [0.0; 4];
    for (name, seconds) in clock.phases(run) {
        // Phases are named predict/MODEL and effect/MODEL/NAME.
        let column = match name.split('/').nth(1) {
            Some(m) if m == s.names[1] => 0,
            Some(m) if m == s.names[2] => 1,
            _ if name == "interface" => 2,
            _ => 3,
        };
        out[column] += seconds;
    }
    out
}
