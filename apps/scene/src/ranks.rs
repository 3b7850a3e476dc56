//! Scenes on several ranks: which models are partitioned, and what ranks must agree on.
//!
//! Every rank reads and builds the same scene. Bodies of particles or of elements are then partitioned,
//! unless the scene asks for something that needs the whole body on one rank. Every other model stays whole
//! and makes the same steps on every rank. Only rank 0 writes files and messages.

use crate::checkpoint::Origin;
use crate::error::{Error, Result};
use crate::scene::Scene;
use crate::setup::{Body, effect_models};
use crate::spec::{EffectKind, Interface, ModelKind, SceneSpec, Scheme};
use arlequin::core::Subdomain;
use arlequin::core::ranks::{self, Communicator, RankError, Reduction, UNIT};
use serde::Serialize;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::Arc;

/// Distribution of one model over several ranks.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct RankLine {
    /// Name of the model.
    pub model: String,
    /// True if the model is partitioned.
    pub parts: bool,
    /// Work of a rank, or why the model is whole on every rank.
    pub words: String,
}

impl RankLine {
    /// Adds the load imbalance \[%\] of a partitioned model to the words.
    pub(crate) fn add_imbalance(&mut self, subdomain: &Subdomain<f64>) {
        if let Some(portion) = subdomain.owned().portion() {
            let most = 100.0 * portion.division().imbalance();
            self.words += &format!(", {most:.1} % more work than the mean at most");
        }
    }
}

/// Distribution of each model of a scene over `ranks` ranks.
fn holdings(scene: &SceneSpec, bodies: &[Body], ranks: usize) -> Vec<RankLine> {
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
fn whole(scene: &SceneSpec, m: usize, body: &Body) -> Option<String> {
    let (name, table) = scene.model.iter().nth(m)?;
    let no = |words: &str| Some(words.to_owned());
    if !matches!(table.kind, ModelKind::Dem | ModelKind::Fem | ModelKind::Cnem) {
        return no("only bodies of particles, of finite and of natural elements go in parts");
    }
    if table.step.is_some_and(|s| s.scheme == Some(Scheme::Implicit)) {
        return Some(format!("model.{name}.step.scheme does not go in parts"));
    }
    if scene.wake.is_some() {
        return no("models of a scene with [wake] do not go in parts");
    }
    if scene.statics.is_some() {
        return no("models of a scene with [static] do not go in parts");
    }
    let nodal = |i: &&Interface| i.weight.weighting == arlequin::core::Weighting::Nodal;
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
        let works = match e.kind {
            EffectKind::BodyForce(_)
            | EffectKind::MassDamping(_)
            | EffectKind::StiffnessDamping(_)
            | EffectKind::LocalDamping(_)
            | EffectKind::Prestress(_)
            | EffectKind::Fracture(_)
            | EffectKind::Obstacle(_) => true,
            EffectKind::Contact(_) if !between => true,
            _ => !e.enabled,
        };
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

/// Ranks of a run, and what they agree on before and between its stages. A run on one rank agrees with
/// itself.
#[derive(Debug, Clone, Default)]
pub(crate) struct Ranks {
    communicator: Option<Arc<dyn Communicator>>,
    /// Number of ranks that are planned for, without a communicator.
    planned: Option<usize>,
}

impl Ranks {
    /// Ranks of a communicator.
    pub(crate) fn from_communicator(communicator: Option<Arc<dyn Communicator>>) -> Self {
        Self {
            // With a single rank there is nothing to agree on.
            communicator: communicator.filter(|c| c.ranks() > 1),
            planned: None,
        }
    }

    /// Ranks that are only planned.
    pub(crate) fn planned(ranks: usize) -> Self {
        Self {
            communicator: None,
            planned: Some(ranks),
        }
    }

    /// Compares the scene and its files between ranks. Collective.
    ///
    /// # Errors
    /// A difference, on every rank; a file that cannot be read.
    pub(crate) fn read(&self, scene: &Scene) -> Result<()> {
        if self.communicator.is_none() {
            return Ok(());
        }
        // A rank that cannot read a file reports this; all ranks then stop.
        let origin = self.together(Origin::from_scene(scene))?;
        let mut hasher = DefaultHasher::new();
        origin.digest(&mut hasher);
        self.agree("the scene and the files that it names", hasher.finish())
    }

    /// The communicator, if there is more than one rank.
    pub(crate) fn communicator(&self) -> Option<&Arc<dyn Communicator>> {
        self.communicator.as_ref()
    }

    /// Number of ranks, existing or planned.
    pub(crate) fn count(&self) -> usize {
        let ranks = self.communicator.as_ref().map(|c| c.ranks());
        ranks.or(self.planned).unwrap_or(1)
    }

    /// Distribution of each model over the ranks; empty for a single rank.
    pub(crate) fn holdings(&self, scene: &SceneSpec, bodies: &[Body]) -> Vec<RankLine> {
        match self.count() {
            1 => Vec::new(),
            ranks => holdings(scene, bodies, ranks),
        }
    }

    /// Number of this rank.
    pub(crate) fn rank(&self) -> usize {
        self.communicator.as_ref().map_or(0, |c| c.rank())
    }

    /// Returns whether this rank writes files and messages.
    pub(crate) fn leads(&self) -> bool {
        self.rank() == 0
    }

    /// Compares `digest` between ranks. Collective.
    ///
    /// # Errors
    /// [`RankError::Differ`] if the digests differ; failures of the communicator.
    pub(crate) fn agree(&self, what: &str, digest: u64) -> Result<()> {
        let Some(c) = &self.communicator else {
            return Ok(());
        };
        ranks::agree(&**c, what, digest).map_err(elsewhere)
    }

    /// Returns whether `flag` is true on any rank. Collective.
    ///
    /// # Errors
    /// Failures of the communicator.
    pub(crate) fn any(&self, flag: bool) -> Result<bool> {
        let [any] = self.largest([i64::from(flag)])?;
        Ok(any > 0)
    }

    fn largest<const N: usize>(&self, mut values: [i64; N]) -> Result<[i64; N]> {
        if let Some(c) = &self.communicator {
            c.reduce(&mut values, Reduction::Largest).map_err(elsewhere)?;
        }
        Ok(values)
    }

    /// Returns `result` if it is `Ok` on every rank. Collective.
    ///
    /// # Errors
    /// The lowest rank that failed returns its error as [`Error::Agreed`], all others [`Error::Elsewhere`];
    /// failures of the communicator.
    pub(crate) fn together<R>(&self, result: Result<R>) -> Result<R> {
        let Some(c) = &self.communicator else {
            return result;
        };
        // Every rank already has these errors, or the ranks can no longer communicate: another exchange would
        // hang.
        if result
            .as_ref()
            .is_err_and(|e| e.is_everywhere() || e.is_of_ranks())
        {
            return result;
        }
        let (rank, ranks) = (c.rank() as i64, c.ranks() as i64);
        // One number holds rank and kind of the error, so that the largest is that of the lowest rank that
        // failed, and the kind is that rank's own.
        let code = match &result {
            Ok(_) => 0,
            Err(e) => 2 * (ranks - rank) + i64::from(e.is_input()),
        };
        let [largest] = self.largest([code])?;
        let failed = ranks - largest / 2;
        match result {
            Ok(output) if largest == 0 => Ok(output),
            Err(e) if failed == rank => Err(Error::Agreed(Box::new(e))),
            _ => Err(Error::Elsewhere {
                rank: failed as usize,
                input: largest % 2 == 1,
            }),
        }
    }
}

/// Returns `result` if it is `Ok` on every rank. Collective. Without a communicator, returns `result`.
///
/// # Errors
/// The lowest rank that failed returns its error as [`Error::Agreed`], all others [`Error::Elsewhere`].
pub fn together<R>(communicator: Option<&Arc<dyn Communicator>>, result: Result<R>) -> Result<R> {
    Ranks::from_communicator(communicator.cloned()).together(result)
}

/// Wraps an error between ranks.
pub(crate) fn elsewhere(e: RankError) -> Error {
    Error::Core {
        key: "ranks".into(),
        source: arlequin::core::Error::Rank(e),
    }
}

impl Origin {
    /// Hashes all that defines the scene, except the folder it is in.
    fn digest(&self, hasher: &mut DefaultHasher) {
        self.text.hash(hasher);
        self.set.hash(hasher);
        self.fingerprints().for_each(|f| f.hash(hasher));
        env!("CARGO_PKG_VERSION").hash(hasher);
    }
}

#[cfg(test)]
mod tests {
    use super::together;
    use crate::Error;
    use arlequin_mpi::threads;
    use std::time::Duration;

    /// A run error of rank 1 beside an input error of rank 2: all ranks report rank 1 and its kind.
    #[test]
    fn the_lowest_rank_that_failed_and_its_own_kind_of_error_are_reported() {
        let outcomes = threads::run(3, 1, Duration::from_secs(20), |c| {
            let result = match c.rank() {
                1 => Err(Error::System {
                    what: "threads",
                    message: "no memory".into(),
                }),
                2 => Err(crate::error::value("time.end", -1.0, "must be positive")),
                _ => Ok(()),
            };
            together(Some(&c), result).map_err(|e| match e {
                Error::Agreed(e) => format!("own: {e}"),
                Error::Elsewhere { rank, input } => format!("rank {rank}, input {input}"),
                other => format!("{other:?}"),
            })
        });
        let outcomes: Vec<_> = outcomes.into_iter().map(|o| o.expect("a rank")).collect();
        assert_eq!(outcomes[0], Err("rank 1, input false".to_owned()));
        assert!(
            matches!(&outcomes[1], Err(e) if e.contains("no memory")),
            "{outcomes:?}"
        );
        assert_eq!(outcomes[2], Err("rank 1, input false".to_owned()));
    }
}
