//! Two claims of the papers that our formulation contradicts, with numbers.

use super::check::{Accept, Check, short};
use super::{Report, Runs, core_error};
use crate::claims as runs;
use crate::line::{COARSE, FINE, Line};
use crate::waves;
use arlequin::core::Profile;
use arlequin_scene::Result;

const J13: &str = "Jebahi et al. 2013";
const DIRECTION: &str =
    "the papers: a wave out of the continuum is reflected more than one out of the particles";
const DAMPING: &str = "the papers: a wide overlap with a fine mediator damps the global wave";

/// Checks both claims.
pub(super) fn claims(_: &Runs) -> Result<Report> {
    let mut checks = direction()?;
    checks.extend(damping()?);
    Ok(checks.into())
}

/// A conserving, symmetric coupling is reciprocal: at one frequency it reflects the same share in both
/// directions.
fn direction() -> Result<Vec<Check>> {
    let mut checks = Vec::new();
    for (name, mediator) in [("h_B = h_C", 10.0), ("h_B = h_D", 1.0)] {
        let line = Line {
            profile: Profile::Cubic,
            mediator,
            ..Line::default()
        };
        let waves = waves::wavelengths(3.5, 40.0, 100);
        let [r, t] = runs::one_way_beside_the_other(&line, &waves).map_err(core_error("claims"))?;
        let what = |q: &str| format!("{q}, bar to chain beside chain to bar, {name}, harmonic");
        checks.push(
            Check::new(what("largest difference of |r|"), r, Accept::AtMost(1e-9))
                .note(format!("{DIRECTION} ({J13})")),
        );
        checks.push(Check::new(
            what("largest difference of the power that passes"),
            t,
            Accept::AtMost(1e-9),
        ));
        let short_line = Line {
            coarse_elements: 20,
            fine_bonds: 200,
            ..line.clone()
        };
        let apart = runs::reciprocity(&short_line, 1500).map_err(core_error("claims"))?;
        let what = format!("impulse on a particle felt at a bar node beside the reverse, {name}, time runs");
        checks.push(Check::new(what, apart, Accept::AtMost(1e-10)));
        let back = |side| runs::comes_back(&line, side, 42.0, 600.0).map_err(core_error("claims"));
        let [bar, chain] = [back(COARSE)?, back(FINE)?];
        checks.push(
            Check::against(
                format!("energy that comes back into the bar, packet of 42 r, {name}, time runs"),
                bar,
                chain,
                "the same packet out of the chain",
                Accept::Relative(0.05),
            )
            .note(format!("{DIRECTION}; a packet of one frequency does not")),
        );
    }
    Ok(checks)
}

/// Energy is conserved with every mediator; in a wide overlap a fine mediator reflects waves instead of
/// damping them.
fn damping() -> Result<Vec<Check>> {
    let mut checks = Vec::new();
    let wide = |mediator| Line {
        profile: Profile::Cubic,
        overlap: 80.0,
        mediator,
        ..Line::default()
    };
    let top = |mediator| {
        waves::top_reflection(&wide(mediator), &waves::wavelengths(4.2, 40.0, 100))
            .map_err(core_error("claims"))
    };
    for (name, mediator) in [("h_B = h_D", 1.0), ("h_B = h_C", 10.0)] {
        let line = Line {
            coarse_elements: 60,
            fine_bonds: 600,
            ..wide(mediator)
        };
        let after = runs::to_and_fro(&line, 150.0, 4).map_err(core_error("claims"))?;
        let row = Check::against(
            format!("energy of a long pulse after eight passages, L_O = 8 h_C, {name}"),
            after.kept,
            1.0,
            "conservation",
            Accept::Absolute(1e-3),
        );
        checks.push(row.note(format!("{DAMPING} ({J13})")));
        checks.push(Check::new(
            format!("drift of H, the same, {name}"),
            after.drift,
            Accept::AtMost(1e-10),
        ));
        let p = waves::long_pulse(&wide(mediator)).map_err(core_error("claims"))?;
        let name = format!("t of a pulse of 600 r, L_O = 8 h_C, {name}");
        checks.push(Check::against(
            name,
            p.t,
            1.0,
            "a homogeneous line",
            Accept::Absolute(0.005),
        ));
    }
    let (fine, coarse) = (top(1.0)?, top(10.0)?);
    checks.push(
        Check::new(
            "largest |r|, h_B = h_D over h_B = h_C, L_O = 8 h_C",
            fine / coarse,
            Accept::AtLeast(2.0),
        )
        .note(format!(
            "what a fine mediator does is to reflect: {} of the amplitude against {}",
            short(fine),
            short(coarse)
        )),
    );
    Ok(checks)
}
