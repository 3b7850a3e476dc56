//! Warnings about particles: coordinations that were not measured, strengths, checks of bonds.

use super::built::Built;
use super::kinds::kind;
use super::plausible::far_outside;
use crate::setup::{BodyShape, LoweredModel, LoweredScene};
use crate::spec::{CriterionKind, Effect, EffectKind};

/// Plausible strains at which a bond breaks: strength over the modulus of the beams \[–\].
const BREAKING: [f64; 2] = [1e-7, 1.0];
/// Plausible energies per area at which a bond breaks \[J/m²\]: up to ten times that of the toughest metals,
/// and below any strength in Pa.
const ENERGY: [f64; 2] = [1e-3, 1e7];
/// Coordination of the packings on which beams and fracture energies were measured, and difference from it
/// that does not matter.
const MEASURED_COORDINATION: f64 = 6.2;
const NEAR_COORDINATION: f64 = 0.15;
/// Relative change of Young's modulus of a body per unit of coordination: 7.29e10, 8.10e10 and 8.94e10 Pa
/// were measured at 6.2, 6.7 and 7.2.
const PER_BOND: f64 = 0.22;

/// Warns about a coordination for which the beams that follow from the material were not measured. A zone's
/// beams are fitted to the body.
pub(super) fn coordination(name: &str, table: &LoweredModel, brittle: bool) -> Option<String> {
    let z = table.dem.coordination?;
    let difference = z - MEASURED_COORDINATION;
    let is_fitted = table.dem.young.is_some() || matches!(table.shape, BodyShape::Piece(_));
    let stiffness = format!(
        "the body is some {:.0} % {} than material.young says",
        100.0 * (PER_BOND * difference).abs(),
        if difference > 0.0 { "stiffer" } else { "softer" }
    );
    let what = match (is_fitted, brittle) {
        _ if difference.abs() <= NEAR_COORDINATION => return None,
        (true, false) => return None,
        (true, true) => "what a strength or gc makes of the body is not known".to_owned(),
        (false, false) => stiffness,
        (false, true) => format!("{stiffness}, and what a strength or gc makes of it is not known"),
    };
    let remedy = match brittle {
        true => "measure with arlequin calibrate, --strength or --toughness for fracture",
        false => "measure with arlequin calibrate and give dem.young, dem.poisson and dem.radius_ratio",
    };
    Some(format!(
        "model '{name}': dem.coordination = {z}: beams were measured at {MEASURED_COORDINATION} bonds per particle, so that {what}; \
         remove it, or {remedy}"
    ))
}

/// Warns about strengths and fracture energies far from those of any solid.
pub(super) fn strengths(scene: &LoweredScene, out: &mut Vec<String>) {
    let beams = scene.model.values().filter(|m| kind(m.kind).has_spheres());
    // Independent of the models the effect acts on, the softest beams give the largest strain.
    let young = beams
        .filter_map(|m| m.dem.young.or(Some(m.material?.young)))
        .fold(f64::INFINITY, f64::min);
    for (k, e) in scene.effect.iter().enumerate() {
        let EffectKind::Fracture(f) = &e.kind else {
            continue;
        };
        // A strength beside a fracture energy is the stress from which on beams soften.
        let stress = f.gc.is_some() || f.criterion.is_some_and(is_of_stresses);
        let strength = f.strength.map(|x| match stress {
            true => ("strength", x, (x / young, BREAKING, "of Young's modulus")),
            false => ("strength", x, (x, ENERGY, "J/m²")),
        });
        let gc = f.gc.map(|x| ("gc", x, (x, ENERGY, "J/m²")));
        for (key, given, (x, range, what)) in [gc, strength].into_iter().flatten() {
            let Some(far) = far_outside(x, range) else {
                continue;
            };
            out.push(format!(
                "effect[{k}].fracture: {key} = {given:e} is {x:.2e} {what}, {far} that of any solid ({:e} to {:e}); check the \
                 unit",
                range[0], range[1]
            ));
        }
    }
}

/// Warns about bonds that are checked less often than once in the run.
pub(super) fn rare_checks(scene: &LoweredScene, built: &Built) -> Vec<String> {
    // A `[static]` scene makes as many steps as its states need.
    if built.load_steps.is_some() {
        return Vec::new();
    }
    let own_steps = built.run.subdomains().iter().map(|s| s.own_steps()).max();
    let steps = built.steps * own_steps.unwrap_or(1);
    let warning = |(k, e): (usize, &Effect)| {
        let EffectKind::Fracture(f) = &e.kind else {
            return None;
        };
        let every = f.every.filter(|every| e.enabled && *every > steps)?;
        Some(format!(
            "effect[{k}].fracture.every = {every}: the run has {steps} own steps of the particles, so that no bond is checked; \
             lower it"
        ))
    };
    scene.effect.iter().enumerate().filter_map(warning).collect()
}

/// Returns whether the strength of a criterion is a stress.
fn is_of_stresses(criterion: CriterionKind) -> bool {
    use CriterionKind::{Axial, Energy, Hydrostatic, Mises, Rankine, TensileEnergy};
    match criterion {
        Axial | Rankine | Mises | Hydrostatic => true,
        Energy | TensileEnergy => false,
    }
}
