//! Which models of a scene are partitioned among ranks.
//!
//! Every rank reads and builds the same scene. Bodies of particles or of elements are then partitioned,
//! unless the scene asks for something that needs the whole body on one rank. Every other model stays whole
//! and makes the same steps on every rank.

use super::{Body, Feature, effect_models, kind};
use crate::ranks::RankLine;
use crate::setup::{LoweredInterface, LoweredScene};
use crate::spec::{EffectKind, Scheme};
use arlequin::core::ranks::UNIT;

/// Distribution of each model of a scene over the ranks; empty for a single rank.
pub(super) fn holdings(scene: &LoweredScene, bodies: &[Body], ranks: usize) -> Vec<RankLine> {
    if ranks == 1 {
        return Vec::new();
    }
    let line = |(m, body): (usize, &Body)| {
        let nodes = body.model.layout().nodes;
        let units = nodes.div_ceil(UNIT);
        // A rank needs at least one unit: units are the smallest parts of a partition.
        let small = || {
            let rule = format!("its {nodes} nodes are {units} units of {UNIT}, fewer than ranks");
            (units < ranks).then_some(rule)
        };
        let why = whole(scene, m, body).or_else(small);
        let what = match body.model.views().particles {
            Some(_) => "particles",
            None => "nodes",
        };
        RankLine {
            model: body.model.name().to_owned(),
            parts: why.is_none(),
            words: why.unwrap_or_else(|| format!("{units} units of {UNIT} {what}")),
        }
    };
    bodies.iter().enumerate().map(line).collect()
}

/// Returns why model `m` must be whole on every rank; `None` if it can be partitioned.
fn whole(scene: &LoweredScene, m: usize, body: &Body) -> Option<String> {
    let (name, table) = scene.model.iter().nth(m)?;
    let no = |words: &str| Some(words.to_owned());
    if let Some(words) = kind(table.kind).refusal(Feature::Partition) {
        return no(words);
    }
    if table.step.is_some_and(|s| s.scheme == Some(Scheme::Implicit)) {
        return Some(format!("model.{name}.step.scheme does not go in parts"));
    }
    if scene.statics.is_some() {
        return no("models of a scene with [static] do not go in parts");
    }
    let nodal = |i: &&LoweredInterface| i.weight.weighting == arlequin::core::Weighting::Nodal;
    if scene
        .interface
        .values()
        .any(|i| nodal(&i) && [&i.coarse, &i.fine].contains(&name))
    {
        return no("weights at nodes do not go in parts");
    }
    for (k, e) in scene.effect.iter().enumerate() {
        let between = e.between.as_ref().is_some_and(|b| b.contains(name));
        let acts = between || effect_models(k, e, scene).unwrap_or_default().contains(&m);
        // Contact between two models needs both whole.
        let on_elements = matches!(e.kind, EffectKind::Obstacle(_)) && body.grains.is_none();
        let works = !e.enabled || e.kind.works_in_parts() && !between && !on_elements;
        if acts && !works {
            return Some(format!("effect[{k}].{} does not go in parts", e.kind.key()));
        }
    }
    for (p, probe) in &scene.probe {
        if probe.model.as_ref() == Some(name) && probe.crack.is_some() {
            return Some(format!("probe.{p} asks for what one rank cannot tell"));
        }
    }
    let is_part = body.model.owned().is_part();
    is_part.then(|| "it is in parts already".to_owned())
}
