//! Bauman's table, momenta of a free body, the Norma cantilever.

use super::check::{Accept, Check};
use super::{Report, Runs, core_error};
use crate::{bauman as deck, cantilever as bar, solid};
use arlequin::core::{Profile, conformance};
use arlequin::fem_ref::ElementKind;
use arlequin_scene::Result;

/// Checks all fifteen cells of the table.
pub(super) fn bauman(_: &Runs) -> Result<Report> {
    let mut checks = Vec::new();
    for case in deck::table() {
        let junctions = deck::junctions().map_err(core_error("bauman"))?;
        for (junction, expected) in junctions.into_iter().zip(case.published) {
            let name = format!("u(3), {}, {}", case.name, junction.name());
            let u = deck::end_displacement(&case, junction).map_err(core_error(&*name))?;
            let source = "Bauman et al. 2008, re-computed";
            checks.push(Check::against(name, u, expected, source, Accept::Absolute(1e-6)));
        }
    }
    Ok(checks.into())
}

/// Check 9 of the method: linear and angular momentum, and a mediator that overhangs.
pub(super) fn momenta(_: &Runs) -> Result<Report> {
    let mut checks = Vec::new();
    for kind in [ElementKind::Hex8, ElementKind::Tet4] {
        for junction in solid::junctions::<f64>().map_err(core_error("momenta"))? {
            let name = format!("{kind:?} mediator, {}", junction.name());
            let result = solid::mediator(kind, solid::OVERLAP, [2, 2, 2]).and_then(|space| {
                let bodies = solid::shaken(solid::bodies(Profile::Cubic, 0.05)?, 7)?;
                let mut c = solid::couple(bodies, space, junction)?;
                let adjoint = [
                    c.interfaces()[0].report().momentum_defect,
                    conformance::adjointness(&c),
                ];
                let worst = adjoint.into_iter().chain(conformance::interface_momentum(&c));
                Ok((worst.fold(0.0, f64::max), solid::kept(&mut c)?))
            });
            let (adjoint, kept) = result.map_err(core_error(&*name))?;
            let what = format!("action is reaction, force and moment, {name}");
            checks.push(Check::new(what, adjoint, Accept::AtMost(1e-13)).unlisted());
            let worst = kept.momentum[0].max(kept.momentum[1]);
            checks.push(Check::new(
                format!("momenta, {name}"),
                worst,
                Accept::AtMost(1e-12),
            ));
            checks.push(Check::new(
                format!("drift of H, {name}"),
                kept.drift,
                Accept::AtMost(1e-11),
            ));
            checks.push(Check::new(
                format!("constraint, {name}"),
                kept.residual,
                Accept::AtMost(1e-11),
            ));
            checks.push(Check::new(
                format!("cond(A), {name}"),
                kept.condition,
                Accept::AtMost(1e6),
            ));
        }
    }
    let overhang = solid::mediator::<f64>(ElementKind::Hex8, [2.0, 3.25], [2, 2, 2]).and_then(|space| {
        let bodies = solid::bodies(Profile::Cubic, 0.05)?.into();
        let l2 = Box::new(arlequin::core::L2);
        Ok(solid::couple(bodies, space, l2).is_err())
    });
    let refused = f64::from(u8::from(overhang.map_err(core_error("momenta"))?));
    let name = "overhanging mediator refused (1 = yes)";
    checks.push(Check::new(name, refused, Accept::AtLeast(1.0)));
    Ok(checks.into())
}

/// Compares the total energy of the cantilever at 1 ms and 10 ms with the published drift of Schwarz
/// coupling.
pub(super) fn cantilever(done: &Runs) -> Result<Report> {
    let mut checks = Vec::new();
    for (ratio, published) in bar::PUBLISHED {
        for (width, schwarz) in bar::WIDTHS.into_iter().zip(published) {
            let shown = (ratio - 0.6f64).abs() < 0.01 || (ratio - 0.2f64).abs() < 0.01;
            if done.quick && !(shown && width > 50e-3) {
                continue;
            }
            checks.extend(cantilever_cell(ratio, width, schwarz)?);
        }
    }
    Ok(checks.into())
}

/// Returns the checks of one cell: mesh ratio `1:ratio`, width of the overlap \[m\], published drift at 1
/// ms \[%\].
///
/// # Errors
/// Failed runs.
pub fn cantilever_cell(ratio: f64, width: f64, schwarz: f64) -> Result<Vec<Check>> {
    let name = format!("1:{ratio}, L_O = {} mm", super::check::short(1e3 * width));
    let d = bar::drift(ratio, width, 1).map_err(core_error(&*name))?;
    let source = "Norma.jl, overlapping Schwarz";
    let energy = |ms: u32| format!("change of energy at {ms} ms [%], {name}");
    let [early, late] = d.total.map(|x| 100.0 * x);
    let what = format!("drift of H at 1 ms, {name}");
    let start = format!("energy at the start [J], {name}");
    Ok(vec![
        Check::against(energy(1), early, schwarz, source, Accept::AtMost(0.5))
            .note("accepted is what one multiplier field must keep, not the published drift"),
        Check::new(energy(10), late, Accept::AtMost(0.5)),
        Check::new(
            format!("drift of H at 10 ms, {name}"),
            d.invariant[1],
            Accept::AtMost(1e-9),
        ),
        Check::new(what, d.invariant[0], Accept::AtMost(1e-9)).unlisted(),
        Check::against(start, d.start, 1506.5, source, Accept::Relative(0.03)).unlisted(),
    ])
}
