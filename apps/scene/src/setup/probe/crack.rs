//! Probes of the energy release rate of a crack.

use super::rules;
use crate::error::{Result, core, key};
use crate::setup::LoweredScene;
use crate::setup::body::Body;
use crate::setup::names::effect_models;
use crate::spec::{Crack, EffectKind, Probe};
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::core::{CrackFront, EnergyRelease, Weights};

fn front(crack: &Crack) -> CrackFront<f64> {
    CrackFront {
        ends: crack.front.map(Point3::from),
        direction: Vector3::from(crack.direction),
        radii: crack.radii,
    }
}

/// Checks what can be checked before anything is built.
pub(in crate::setup) fn check(path: &str, probe: &Probe, crack: &Crack, scene: &LoweredScene) -> Result<()> {
    front(crack).check().map_err(core(format!("{path}.crack")))?;
    let number = |name: &String| scene.model.keys().position(|n| n == name);
    let model = probe.model.as_ref().and_then(number);
    for (k, e) in scene.effect.iter().enumerate() {
        let prestressed = e.enabled && matches!(e.kind, EffectKind::Prestress(_));
        if prestressed && effect_models(k, e, scene)?.iter().any(|m| Some(*m) == model) {
            let rule = format!(
                "needs all of the stress, and effect[{k}].prestress keeps some of it apart; remove one of them"
            );
            return Err(key(format!("{path}.crack"), rule));
        }
    }
    Ok(())
}

/// Builds the domain integral of a probe.
pub(super) fn release(
    path: &str,
    probe: &Probe,
    body: &Body,
    weights: &Weights<f64>,
) -> Result<EnergyRelease<f64>> {
    rules::check(path, probe)?;
    let Some(crack) = &probe.crack else {
        return Err(key(path, "needs crack"));
    };
    let integral = EnergyRelease::new(&*body.model, &*body.field, &*weights.internal, &front(crack));
    integral.map_err(core(format!("{path}.crack")))
}
