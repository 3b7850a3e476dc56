//! Scenes on several ranks: which models go in parts, and what ranks must agree on.
//!
//! Every rank reads and builds the same scene. A body of particles or of elements is then shared out, if
//! the scene asks nothing of it that needs the whole body on one rank; every other model stays whole and
//! makes the same steps on every rank. Rank 0 alone writes and speaks.

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

/// How one model is held on several ranks.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct RankLine {
    /// Name of the model.
    pub model: String,
    /// Whether each rank holds a part of it.
    pub parts: bool,
    /// What a rank has to do, or why the model is whole on every rank.
    pub words: String,
}

impl RankLine {
    /// Adds how even the work is, once it is shared out.
    pub(crate) fn told(&mut self, of: &Subdomain<f64>) {
        if let Some(portion) = of.portion() {
            let most = 100.0 * portion.division().imbalance();
            self.words += &format!(", {most:.1} % more work than the mean at most");
        }
    }
}

/// How the models of a scene are held on so many ranks.
fn holdings(scene: &SceneSpec, bodies: &[Body], ranks: usize) -> Vec<RankLine> {
    let of = |(m, body): (usize, &Body)| {
        let nodes = body.model.layout().nodes;
        let units = nodes.div_ceil(UNIT);
        let small = || {
            let rule = format!("its {nodes} nodes are {units} units of {UNIT}, fewer than ranks");
            (units < ranks).then_some(rule)
        };
        let why = whole(scene, m, body).or_else(small);
        let what = match body.model.particles() {
            Some(_) => "particles",
            None => "nodes",
        };
        RankLine {
            model: body.model.name().to_owned(),
            parts: why.is_none(),
            words: why.unwrap_or_else(|| format!("{units} units of {UNIT} {what}")),
        }
    };
    bodies.iter().enumerate().map(of).collect()
}

/// Why a model must be whole on every rank.
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
    body.model.portion().map(|_| "it is in parts already".to_owned())
}

/// What ranks of a run agree on before and between its parts; alone, everything is agreed on.
#[derive(Debug, Clone, Default)]
pub(crate) struct Ranks {
    communicator: Option<Arc<dyn Communicator>>,
    /// How many there will be, for a plan.
    planned: Option<usize>,
}

impl Ranks {
    /// Those of a communicator.
    pub(crate) fn of(communicator: Option<Arc<dyn Communicator>>) -> Self {
        Self {
            // One rank is none.
            communicator: communicator.filter(|c| c.ranks() > 1),
            planned: None,
        }
    }

    /// Those of a plan.
    pub(crate) fn planned(ranks: usize) -> Self {
        Self {
            communicator: None,
            planned: Some(ranks),
        }
    }

    /// Refuses scenes that differ, on every rank.
    pub(crate) fn read(&self, scene: &Scene) -> Result<()> {
        if self.communicator.is_none() {
            return Ok(());
        }
        // A rank that cannot read what the scene names says so; the others hear of it.
        let origin = self.together(Origin::of(scene))?;
        let mut hasher = DefaultHasher::new();
        origin.digest(&mut hasher);
        self.agree("the scene and the files that it names", hasher.finish())
    }

    /// The transport, if there is more than one rank.
    pub(crate) fn communicator(&self) -> Option<&Arc<dyn Communicator>> {
        self.communicator.as_ref()
    }

    /// How many there are, or are planned.
    pub(crate) fn count(&self) -> usize {
        let ranks = self.communicator.as_ref().map(|c| c.ranks());
        ranks.or(self.planned).unwrap_or(1)
    }

    /// How the models of a scene are held; nothing to say of one rank.
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

    /// Whether this rank writes and speaks.
    pub(crate) fn leads(&self) -> bool {
        self.rank() == 0
    }

    /// Whether all ranks have the same number.
    ///
    /// # Errors
    /// [`RankError::Differ`].
    pub(crate) fn agree(&self, what: &str, digest: u64) -> Result<()> {
        let Some(c) = &self.communicator else {
            return Ok(());
        };
        ranks::agree(&**c, what, digest).map_err(elsewhere)
    }

    /// Whether any rank says so; all of them must ask.
    ///
    /// # Errors
    /// What the transport says.
    pub(crate) fn any(&self, own: bool) -> Result<bool> {
        let [any] = self.largest([i64::from(own)])?;
        Ok(any > 0)
    }

    fn largest<const N: usize>(&self, mut own: [i64; N]) -> Result<[i64; N]> {
        if let Some(c) = &self.communicator {
            c.reduce(&mut own, Reduction::Largest).map_err(elsewhere)?;
        }
        Ok(own)
    }

    /// What all ranks got to together: where some failed, the first of these has its error, as
    /// [`Error::Agreed`], and all others [`Error::Elsewhere`].
    ///
    /// # Errors
    /// Those, and what the transport says.
    pub(crate) fn together<R>(&self, own: Result<R>) -> Result<R> {
        let Some(c) = &self.communicator else {
            return own;
        };
        // What all ranks have or know cannot be talked over again, and what is wrong between them not at all.
        if own.as_ref().is_err_and(|e| e.is_everywhere() || e.is_of_ranks()) {
            return own;
        }
        let (rank, ranks) = (c.rank() as i64, c.ranks() as i64);
        let said = match &own {
            Ok(_) => [0, 0],
            Err(e) => [ranks - rank, 1 + i64::from(e.is_input())],
        };
        let [first, what] = self.largest(said)?;
        match own {
            Ok(done) if first == 0 => Ok(done),
            Err(e) if ranks - first == rank => Err(Error::Agreed(Box::new(e))),
            _ => Err(Error::Elsewhere {
                rank: (ranks - first) as usize,
                input: what > 1,
            }),
        }
    }
}

/// What all ranks of a communicator got to together, none where there is one alone: see [`Error::Agreed`].
///
/// # Errors
/// The error of the first rank that has one there, [`Error::Elsewhere`] on all others.
pub fn together<R>(communicator: Option<&Arc<dyn Communicator>>, own: Result<R>) -> Result<R> {
    Ranks::of(communicator.cloned()).together(own)
}

/// Whether the ranks of a model in parts still hear of each other.
pub(crate) fn heard(s: &Subdomain<f64>) -> Result<()> {
    let failure = s.portion().and_then(|p| p.failure());
    failure.map_or(Ok(()), |e| Err(elsewhere(e.clone())))
}

/// An error between ranks.
pub(crate) fn elsewhere(e: RankError) -> Error {
    Error::Core {
        key: "ranks".into(),
        source: arlequin::core::Error::Rank(e),
    }
}

impl Origin {
    /// Everything that makes it this scene, but where it lies.
    fn digest(&self, hasher: &mut DefaultHasher) {
        self.text.hash(hasher);
        self.set.hash(hasher);
        self.fingerprints().for_each(|f| f.hash(hasher));
        env!("CARGO_PKG_VERSION").hash(hasher);
    }
}
