//! Bauman's table, momenta of a free body, the Norma cantilever.

use super::row::{Accept, Row};
use super::{Done, Report, at};
use crate::{bauman as deck, cantilever as bar, solid};
use arlequin::core::weight::Profile;
use arlequin::fem_ref::ElementKind;
use arlequin_scene::Result;

/// All fifteen cells.
pub(super) fn bauman(_: &Done) -> Result<Report> {
    let mut rows = Vec::new();
    for case in deck::table() {
        let junctions = deck::junctions().map_err(at("bauman"))?;
        for (junction, expected) in junctions.into_iter().zip(case.published) {
            let name = format!("u(3), {}, {}", case.name, junction.name());
            let u = deck::end_displacement(&case, junction).map_err(at(&*name))?;
            let source = "Bauman et al. 2008, re-computed";
            rows.push(Row::against(name, u, expected, source, Accept::Absolute(1e-6)));
        }
    }
    Ok(Report {
        rows,
        figures: Vec::new(),
    })
}

/// Check 9: linear and angular momentum, and a mediator that overhangs.
pub(super) fn momenta(_: &Done) -> Result<Report> {
    let mut rows = Vec::new();
    for kind in [ElementKind::Hex8, ElementKind::Tet4] {
        for junction in solid::junctions::<f64>().map_err(at("momenta"))? {
            let name = format!("{kind:?} mediator, {}", junction.name());
            let made = solid::mediator(kind, solid::OVERLAP, [2, 2, 2]).and_then(|space| {
                let bodies = solid::shaken(solid::bodies(Profile::Cubic, 0.05)?, 7)?;
                solid::kept(&mut solid::couple(bodies, space, junction)?)
            });
            let kept = made.map_err(at(&*name))?;
            let worst = kept.momentum[0].max(kept.momentum[1]);
            rows.push(Row::new(format!("momenta, {name}"), worst, Accept::AtMost(1e-12)));
            rows.push(Row::new(
                format!("drift of H, {name}"),
                kept.drift,
                Accept::AtMost(1e-11),
            ));
            rows.push(Row::new(
                format!("constraint, {name}"),
                kept.residual,
                Accept::AtMost(1e-11),
            ));
            rows.push(Row::new(
                format!("cond(A), {name}"),
                kept.condition,
                Accept::AtMost(1e6),
            ));
        }
    }
    let overhang = solid::mediator::<f64>(ElementKind::Hex8, [2.0, 3.25], [2, 2, 2]).and_then(|space| {
        let bodies = solid::bodies(Profile::Cubic, 0.05)?.into();
        let l2 = Box::new(arlequin::core::junction::L2);
        Ok(solid::couple(bodies, space, l2).is_err())
    });
    let refused = f64::from(u8::from(overhang.map_err(at("momenta"))?));
    let name = "overhanging mediator refused (1 = yes)";
    rows.push(Row::new(name, refused, Accept::AtLeast(1.0)));
    Ok(Report {
        rows,
        figures: Vec::new(),
    })
}

/// The cantilever's table: total energy at 1 ms and 10 ms beside the published drift of Schwarz coupling.
pub(super) fn cantilever(done: &Done) -> Result<Report> {
    let mut rows = Vec::new();
    for (ratio, published) in bar::PUBLISHED {
        for (width, schwarz) in bar::WIDTHS.into_iter().zip(published) {
            let shown = (ratio - 0.6f64).abs() < 0.01 || (ratio - 0.2f64).abs() < 0.01;
            if done.quick && !(shown && width > 50e-3) {
                continue;
            }
            let name = format!("1:{ratio}, L_O = {} mm", super::row::short(1e3 * width));
            let d = bar::drift(ratio, width).map_err(at(&*name))?;
            let source = "Norma.jl, overlapping Schwarz";
            rows.push(
                Row::against(
                    format!("change of energy at 1 ms [%], {name}"),
                    100.0 * d.total[0],
                    schwarz,
                    source,
                    Accept::AtMost(0.5),
                )
                .note("accepted is what one multiplier field must keep, not the published drift"),
            );
            rows.push(Row::new(
                format!("change of energy at 10 ms [%], {name}"),
                100.0 * d.total[1],
                Accept::AtMost(0.5),
            ));
            rows.push(Row::new(
                format!("drift of H at 10 ms, {name}"),
                d.invariant[1],
                Accept::AtMost(1e-9),
            ));
        }
    }
    Ok(Report {
        rows,
        figures: Vec::new(),
    })
}
