//! The key of a scene that causes an error of the core: one that the scene has or could have.

use crate::error::Error;
use crate::spec::{SceneSpec, StepChoice};
use arlequin::core::Error as Core;

/// Adds the key that causes it to an error of the core.
pub(super) fn located(scene: &SceneSpec, source: Core) -> Error {
    Error::Core {
        key: key_of(scene, &source),
        source,
    }
}

fn key_of(scene: &SceneSpec, source: &Core) -> String {
    let of_interface = |name: &str, key: &str| format!("interface.{name}.{key}");
    match source {
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
        Core::InvalidParameter { .. } => models(scene),
        _ => interfaces(scene),
    }
}

/// Key of an unstable step: the one that the scene gives, otherwise the model.
fn step(scene: &SceneSpec, model: &str, steps: usize) -> String {
    let has_own = scene.model.get(model).is_some_and(|t| t.step.is_some());
    let in_seconds = matches!(scene.time.step, StepChoice::Seconds(_));
    match (has_own, in_seconds) {
        (true, false) => format!("model.{model}.step"),
        (true, true) if steps > 1 => format!("model.{model}.step"),
        (_, true) => "time.step.seconds".to_owned(),
        (false, false) => format!("model.{model}"),
    }
}

/// Key of the interface if there is only one, else of all interfaces; of the models if there is no interface.
fn interfaces(scene: &SceneSpec) -> String {
    let mut names = scene.interface.keys();
    match (names.next(), names.next()) {
        (None, _) => models(scene),
        (Some(name), None) => format!("interface.{name}"),
        // Interfaces of zones have no key of their own; their keys are those of the zones.
        _ if scene.body.is_some() => "zone".to_owned(),
        _ => "interface".to_owned(),
    }
}

/// Key of the model if there is only one, else of all models; of the body if it has zones.
fn models(scene: &SceneSpec) -> String {
    let mut names = scene.model.keys();
    match (names.next(), names.next()) {
        (Some(name), None) => format!("model.{name}"),
        _ if scene.body.is_some() => "model.body".to_owned(),
        _ => "model".to_owned(),
    }
}
