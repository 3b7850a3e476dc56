//! Keys of errors of the core: the key of the object that the error names, otherwise that of the object on
//! which the set-up worked.

use super::between::touching;
use crate::error::Error;
use crate::setup::LoweredScene;
use crate::spec::StepChoice;
use arlequin::core::{Error as Core, SetupPhase};

/// Adds the key that causes it to an error of the core in this phase of the set-up.
pub(super) fn in_phase(scene: &LoweredScene, phase: SetupPhase, source: Core) -> Error {
    let key = match phase {
        SetupPhase::Pair(k) => between(scene, k),
        _ => named(scene, &source),
    };
    let key = key.unwrap_or_else(|| of_phase(scene, phase));
    Error::Core { key, source }
}

/// Key of the model or the interface that an error names.
fn named(scene: &LoweredScene, source: &Core) -> Option<String> {
    let of_interface = |name: &str, key: &str| format!("interface.{name}.{key}");
    Some(match source {
        Core::UnstableStep { model, steps, .. } => step(scene, model, *steps),
        Core::EmptyOverlap { interface: i, .. }
        | Core::OverhangingMediator { interface: i, .. }
        | Core::UncoveredOverlap { interface: i, .. }
        | Core::CoveredTwice { interface: i, .. }
        | Core::SingularInterface { interface: i, .. } => of_interface(i, "mediator"),
        Core::OpposedMotions { interface: i, .. }
        | Core::UnequalShapes { interface: i, .. }
        | Core::UnevenFilling { interface: i, .. } => of_interface(i, "overlap"),
        Core::MomentumLeak { interface: i, .. } => of_interface(i, "sampling"),
        Core::InvalidOption {
            interface: i, name, ..
        } => of_interface(i, name),
        Core::InitialJump { interface: i, .. } if scene.initial.is_empty() => format!("interface.{i}"),
        Core::InitialJump { .. } => "initial".to_owned(),
        Core::ZeroMass { model, .. }
        | Core::Unsupported { model, .. }
        | Core::UnweightedEnergy { model, .. }
        | Core::Model { model, .. } => format!("model.{model}"),
        _ => return None,
    })
}

/// Key of the `k`-th effect between two models.
fn between(scene: &LoweredScene, k: usize) -> Option<String> {
    let pairs = touching(scene).ok()?;
    pairs
        .get(k)
        .map(|(effect, _)| format!("effect[{effect}].between"))
}

/// Key of the object on which a phase of the set-up works: one model or interface, or all of them.
fn of_phase(scene: &LoweredScene, phase: SetupPhase) -> String {
    let name = |names: &mut dyn Iterator<Item = &String>, k: usize| names.nth(k).cloned();
    let place = match phase {
        SetupPhase::Weights(m) => name(&mut scene.model.keys(), m).map(|n| format!("model.{n}")),
        SetupPhase::Junction(k) | SetupPhase::Operator(k) => {
            name(&mut scene.interface.keys(), k).map(|n| format!("interface.{n}"))
        }
        // Own steps and critical steps are those of all models.
        SetupPhase::Step => Some(models(scene)),
        _ => None,
    };
    place.unwrap_or_else(|| interfaces(scene))
}

/// Key of an unstable step: the one that the scene gives, otherwise the model.
fn step(scene: &LoweredScene, model: &str, steps: usize) -> String {
    let has_own = scene.model.get(model).is_some_and(|t| t.step.is_some());
    let in_seconds = matches!(scene.time.step, StepChoice::Seconds(_));
    match (has_own, in_seconds) {
        (true, false) => format!("model.{model}.step"),
        (true, true) if steps > 1 => format!("model.{model}.step"),
        (_, true) => "time.step.seconds".to_owned(),
        (false, false) => format!("model.{model}"),
    }
}

/// Key of all interfaces, which the partition check and the initial state treat together; that of the models
/// if there is no interface.
fn interfaces(scene: &LoweredScene) -> String {
    let mut names = scene.interface.keys();
    match (names.next(), names.next()) {
        (None, _) => models(scene),
        (Some(name), None) => format!("interface.{name}"),
        // Interfaces of zones have no key of their own; their keys are those of the zones.
        _ if scene.body.is_some() => "zone".to_owned(),
        _ => "interface".to_owned(),
    }
}

/// Key of all models, or of the only one.
fn models(scene: &LoweredScene) -> String {
    let mut names = scene.model.keys();
    match (names.next(), names.next()) {
        (Some(name), None) => format!("model.{name}"),
        _ if scene.body.is_some() => "model.body".to_owned(),
        _ => "model".to_owned(),
    }
}
