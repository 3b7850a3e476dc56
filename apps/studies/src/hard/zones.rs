//! A zone that moves with a pulse.

use super::{HardCase, Outcome};
use crate::moving::{H, Moving};
use arlequin::core::{Result, Silent};

pub(super) const CASES: &[HardCase] = &[HardCase {
    name: "a zone that moves with a pulse",
    why: "weights change under a wave; amplitudes in the skin of a ramp go as one over the root of the weight",
    naive: "what lives keeps its state, what is born takes that of the other model: the energy grows exponentially",
    promise: "what changes hands carries the state of the giver: no energy is gained, momentum is kept",
    fast: true,
    run: moving,
}];

/// Changes of weights, one element each.
const CHANGES: usize = 16;

fn moving() -> Result<Outcome> {
    let mut out = Outcome::default();
    let line = Moving::default();
    let state = line.pulse(15.0 * H);
    let mut naive = line.build(&state)?;
    let start = naive.energy();
    let steps = (H / naive.dt()).round() as usize;
    for n in 1..=CHANGES {
        naive.run(steps, &mut Silent)?;
        naive = line.naively_moved(&naive, line.zone.map(|x| x + n as f64 * H))?;
    }
    out.add_naive(
        "energy over that of the start",
        naive.energy() / start,
        1e3..=f64::INFINITY,
    );
    let mut run = line.build(&state)?;
    let account = line.carry(&mut run, (CHANGES, H, 1.0), &mut |_, _| ())?;
    out.add("energy over that of the start", run.energy() / start, 0.995..=1.0);
    out.add("energy gained in sum", account.gains, 0.0..=1e-8);
    out.add("drift", run.drift(), 0.0..=1e-12);
    out.add("change of the momentum", run.bodies()[0].drift[0], 0.0..=1e-12);
    Ok(out)
}
