//! Watches for bodies and obstacles that enter bodies without contact, and warns as soon as it happens, once
//! per pair.
//!
//! Obstacles and contact act on the models that they name; other bodies pass through each other. The watch
//! checks pairs without an effect between them: an obstacle and a body, or two bodies that no interface
//! joins.
//!
//! A look costs a pass over the displacements and velocities of the bodies. A scene without such pairs costs
//! nothing.

mod surface;

use crate::error::{Result, core};
use crate::ranks::Ranks;
use crate::setup::{self, Grid, LoweredScene, ModelInfo};
use crate::spec::{Effect, EffectKind};
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::core::{Coupled, Subdomain};
use arlequin::dem_beam::RigidShape;
use std::collections::BTreeSet;
use std::sync::Arc;
use surface::{Depth, Shell};

/// Depth over the spacing of nodes or particles above which one body is inside the other.
const TOLERANCE: f64 = 0.05;
/// Longest way of one body towards another between two looks, over the smaller of their spacings or radii.
const STRIDE: f64 = 0.25;
/// Largest number of steps between two looks.
const LONGEST: f64 = 32.0;

/// A model that other bodies can enter.
#[derive(Debug)]
struct Member {
    name: String,
    particles: bool,
    /// Distance between neighbouring nodes or particles \[m\].
    spacing: f64,
    /// Largest radius of the particles \[m\].
    radius: f64,
    /// Mesh from which the surface is built when something comes near; on rank 0 only, `None` once it is
    /// built.
    grid: Option<Arc<Grid>>,
    /// Surface, once it is built; on rank 0 only.
    shell: Option<Shell>,
    /// Bounding box at the last look \[m\].
    bounds: [Point3<f64>; 2],
    /// Largest speed at the last look \[m/s\].
    speed: f64,
}

/// An obstacle.
#[derive(Debug)]
struct Rigid {
    name: String,
    /// Index of the effect.
    effect: usize,
    /// Indices of the models on which it acts.
    models: Vec<usize>,
    shape: RigidShape,
    moved: Vector3<f64>,
    speed: f64,
}

/// First of a pair.
#[derive(Debug, Clone, Copy)]
enum Intruder {
    Obstacle(usize),
    Model(usize),
}

/// Two bodies between which no effect acts.
#[derive(Debug)]
struct Pair {
    first: Intruder,
    second: usize,
    /// Depth of one in the other at rest \[m\], once computed.
    at_rest: Option<f64>,
    warned: bool,
}

/// Watch over all pairs of a scene.
#[derive(Debug)]
pub(crate) struct Watch {
    members: Vec<Option<Member>>,
    obstacles: Vec<Rigid>,
    pairs: Vec<Pair>,
    /// Step of the next look.
    next: usize,
}

impl Watch {
    /// Collects the pairs of models and obstacles of a scene between which no effect acts.
    pub(crate) fn new(
        scene: &LoweredScene,
        models: &[ModelInfo],
        run: &Coupled<f64>,
        ranks: &Ranks,
    ) -> Result<Self> {
        let members = models.iter().zip(run.subdomains());
        let members: Vec<_> = members
            .map(|(info, s)| Member::from_model(info, s, ranks.leads()))
            .collect();
        let obstacles = obstacles(scene)?;
        let mut pairs = Vec::new();
        let mut add = |first, second| {
            pairs.push(Pair {
                first,
                second,
                at_rest: None,
                warned: false,
            });
        };
        let bodies = bodies(run);
        let touching = contact_pairs(scene);
        for (b, second) in members.iter().enumerate() {
            let Some(second) = second else { continue };
            for (k, o) in obstacles.iter().enumerate() {
                if !o.models.contains(&b) {
                    add(Intruder::Obstacle(k), b);
                }
            }
            for (a, first) in members[..b].iter().enumerate() {
                let Some(first) = first else { continue };
                let pair = [first.name.clone(), second.name.clone()];
                // Models that an interface joins overlap on purpose.
                if bodies[a] == bodies[b] || touching.contains(&pair) {
                    continue;
                }
                // Particles are the intruder of elements, not the reverse.
                match second.particles && !first.particles {
                    true => add(Intruder::Model(b), a),
                    false => add(Intruder::Model(a), b),
                }
            }
        }
        Ok(Self {
            members,
            obstacles,
            pairs,
            next: 0,
        })
    }

    /// Skips the pairs of which a resumed run has already warned.
    pub(crate) fn skip(&mut self, warnings: &[String]) {
        for k in 0..self.pairs.len() {
            let opening = self.opening(&self.pairs[k]);
            self.pairs[k].warned |= warnings.iter().any(|w| w.starts_with(&opening));
        }
    }

    /// Compares the positions of all pairs if this is the step of the next look. Returns a warning for each
    /// pair of which one is now inside the other. Collective.
    ///
    /// # Errors
    /// Failures of communication.
    pub(crate) fn look(&mut self, run: &Coupled<f64>, ranks: &Ranks) -> Result<Vec<String>> {
        if run.steps() < self.next || self.pairs.iter().all(|p| p.warned) {
            return Ok(Vec::new());
        }
        self.measure(run);
        let (mut lines, mut steps) = (Vec::new(), LONGEST);
        for k in 0..self.pairs.len() {
            if self.pairs[k].warned {
                continue;
            }
            let gap = self.gap(&self.pairs[k]);
            let within = self.size(&self.pairs[k]) * STRIDE;
            // Until the next look, the pair covers at most the gap between its boxes and a part of its
            // spacing, so that nothing passes unseen. As a body may be struck in between, and for a pair at
            // rest, [`LONGEST`] holds.
            let until_look = (gap.max(0.0) + within) / (self.speed(&self.pairs[k]) * run.dt());
            steps = until_look.min(steps);
            // Surfaces are compared only if the boxes meet.
            if gap > 0.0 {
                continue;
            }
            // After the cheap comparison of boxes, which most looks end with.
            let line = self.examine(k, run)?;
            // Only rank 0 has the line, but all ranks must agree on the pairs that are left.
            self.pairs[k].warned = ranks.any(line.is_some())?;
            lines.extend(line);
        }
        // At least one step on, also for bodies so fast that they pass their spacing within it.
        self.next = run.steps() + (steps as usize).max(1);
        Ok(lines)
    }

    /// Looks now, for instance between the load steps of a scene at rest.
    ///
    /// # Errors
    /// Errors of [`Self::look`].
    pub(crate) fn look_now(&mut self, run: &Coupled<f64>, ranks: &Ranks) -> Result<Vec<String>> {
        self.next = 0;
        self.look(run, ranks)
    }

    /// Updates bounding boxes, displacements and speeds.
    fn measure(&mut self, run: &Coupled<f64>) {
        for (member, s) in self.members.iter_mut().zip(run.subdomains()) {
            if let Some(member) = member {
                member.measure(s);
            }
        }
        for o in &mut self.obstacles {
            // The first model that the obstacle acts on has it as an effect, which knows the motion.
            let host = o.models.first().and_then(|m| run.subdomains().get(*m));
            let mut effects = host.into_iter().flat_map(Subdomain::effects);
            let motion = effects.find(|e| e.name() == o.name).and_then(|e| e.rigid());
            if let Some(motion) = motion {
                (o.moved, o.speed) = (motion.displacement, motion.velocity.norm());
            }
        }
    }

    fn member(&self, model: usize) -> Option<&Member> {
        self.members[model].as_ref()
    }

    /// Lower bound of the distance between the two \[m\]; not positive if they may meet.
    fn gap(&self, pair: &Pair) -> f64 {
        let Some(second) = self.member(pair.second) else {
            return f64::INFINITY;
        };
        let [low, high] = &second.bounds;
        match pair.first {
            Intruder::Obstacle(k) => {
                let o = &self.obstacles[k];
                // The sphere around the bounding box stands in for the body.
                let half = (high - low) * 0.5;
                o.shape.distance(&(low + half), &o.moved).0 - half.norm()
            }
            Intruder::Model(a) => self.member(a).map_or(f64::INFINITY, |first| {
                let [from, to] = &first.bounds;
                // Per axis one of both differences is positive if the boxes are apart; where they overlap the
                // gap is zero.
                (from - high).sup(&(low - to)).sup(&Vector3::zeros()).norm()
            }),
        }
    }

    /// Smaller spacing or radius of the two \[m\].
    fn size(&self, pair: &Pair) -> f64 {
        let spacing = |m: usize| self.member(m).map_or(f64::INFINITY, |m| m.spacing);
        let first = match pair.first {
            // A plane has no size of its own: the spacing of the body decides.
            Intruder::Obstacle(k) => self.obstacles[k].shape.depth(),
            Intruder::Model(m) => spacing(m),
        };
        first.min(spacing(pair.second))
    }

    /// Largest speed at which the two may approach each other \[m/s\].
    fn speed(&self, pair: &Pair) -> f64 {
        let model_speed = |m: usize| self.member(m).map_or(0.0, |m| m.speed);
        let first = match pair.first {
            Intruder::Obstacle(k) => self.obstacles[k].speed,
            Intruder::Model(m) => model_speed(m),
        };
        // The sum, as if both moved straight towards each other.
        first + model_speed(pair.second)
    }

    /// Compares the surfaces of a pair; returns the warning, on rank 0. Collective.
    fn examine(&mut self, k: usize, run: &Coupled<f64>) -> Result<Option<String>> {
        let (first, second) = (self.pairs[k].first, self.pairs[k].second);
        let mut models = vec![second];
        models.extend(match first {
            Intruder::Obstacle(_) => None,
            Intruder::Model(m) => Some(m),
        });
        // Gathers before the surfaces are built: all ranks take part, but only rank 0 has grids and goes on.
        let mut displaced = Vec::new();
        for m in &models {
            let s = &run.subdomains()[*m];
            displaced.push(s.gather(&s.state().q).map_err(core("time"))?);
        }
        for m in &models {
            if !self.members[*m].as_mut().is_some_and(Member::begin) {
                return Ok(None);
            }
        }
        // Only a pair that comes near needs the depth at rest.
        if self.pairs[k].at_rest.is_none() {
            for m in &models {
                let shell = self.members[*m].as_mut().and_then(|m| m.shell.as_mut());
                // Both at rest, whatever their displacements at the first meeting.
                shell.into_iter().for_each(Shell::put_back);
            }
            let depth = self.depth(first, second, &Vector3::zeros());
            self.pairs[k].at_rest = Some(depth.map_or(0.0, |d| d.depth));
        }
        for (m, q) in models.iter().zip(displaced) {
            let shell = self.members[*m].as_mut().and_then(|m| m.shell.as_mut());
            let s = &run.subdomains()[*m];
            if let Some((shell, q)) = shell.zip(q) {
                shell.displace(&q);
                if s.has_sleep() {
                    shell.leave_out(|node| s.is_asleep(node));
                }
            }
        }
        let moved = match first {
            Intruder::Obstacle(k) => self.obstacles[k].moved,
            Intruder::Model(_) => Vector3::zeros(),
        };
        let pair = &self.pairs[k];
        let spacing = models.iter().filter_map(|m| Some(self.member(*m)?.spacing));
        // More than at rest (of particles) and than a share of the spacing, because bodies may touch at the
        // start and a flush face vibrates.
        let limit = self.touching_depth(pair) + TOLERANCE * spacing.fold(f64::INFINITY, f64::min);
        let deepest = self.depth(first, second, &moved).filter(|d| d.depth > limit);
        Ok(deepest.map(|d| self.line(pair, &d, run.time())))
    }

    /// Depth at rest that counts as touching \[m\]: zero for elements, which have an exact surface. Particles
    /// of two bodies may overlap a little.
    fn touching_depth(&self, pair: &Pair) -> f64 {
        let at_rest = pair.at_rest.unwrap_or_default();
        let particles = |m: usize| self.member(m).is_some_and(|m| m.particles);
        let first = match pair.first {
            Intruder::Obstacle(_) => false,
            Intruder::Model(m) => particles(m),
        };
        if first || particles(pair.second) {
            at_rest
        } else {
            0.0
        }
    }

    fn depth(&self, first: Intruder, second: usize, moved: &Vector3<f64>) -> Option<Depth> {
        let shell = |m: usize| self.member(m)?.shell.as_ref();
        let entered = shell(second)?;
        match first {
            Intruder::Obstacle(k) => entered.depth_in_obstacle(&self.obstacles[k].shape, moved),
            Intruder::Model(m) => shell(m)?.depth_in(entered),
        }
    }

    /// Returns the first words of the warning, which no other pair has.
    fn opening(&self, pair: &Pair) -> String {
        let first = match pair.first {
            Intruder::Obstacle(k) => format!("obstacle '{}'", self.obstacles[k].name),
            Intruder::Model(m) => format!("model '{}'", self.member(m).map_or("", |m| m.name.as_str())),
        };
        let second = self.member(pair.second);
        let what = match second.is_some_and(|m| m.particles) {
            true => "particles",
            false => "elements",
        };
        format!(
            "{first} is inside the {what} of model '{}'",
            second.map_or("", |m| m.name.as_str())
        )
    }

    fn line(&self, pair: &Pair, d: &Depth, time: f64) -> String {
        let [x, y, z] = d.place.coords.into();
        let remedy = self.remedy(pair).unwrap_or_default();
        format!(
            "{} at t = {time:.4e} s, {:.3e} m deep at ({x:.3e}, {y:.3e}, {z:.3e}) m, and no force acts between the two: {remedy}",
            self.opening(pair),
            d.depth
        )
    }

    fn remedy(&self, pair: &Pair) -> Option<String> {
        let second = self.member(pair.second)?;
        Some(match pair.first {
            Intruder::Obstacle(k) => format!(
                "name '{}' in the models of effect[{}], or keep them apart",
                second.name, self.obstacles[k].effect
            ),
            Intruder::Model(m) => {
                let first = self.member(m)?;
                let names = format!("[\"{}\", \"{}\"]", first.name, second.name);
                format!("add an effect contact with between = {names}, or keep them apart")
            }
        })
    }
}

impl Member {
    /// Describes a model of particles or of elements in space; `None` for a line, which has no inside.
    fn from_model(info: &ModelInfo, s: &Subdomain<f64>, leads: bool) -> Option<Self> {
        let grid = &info.grid;
        let particles = !grid.radii.is_empty();
        if s.model().layout().components != 3 || !(particles || Shell::is_solid(grid)) {
            return None;
        }
        Some(Self {
            name: s.model().name().to_owned(),
            particles,
            spacing: info.spacing,
            radius: grid.radii.iter().fold(0.0, |m: f64, r| m.max(*r)),
            // Rank 0 alone compares surfaces.
            grid: leads.then(|| grid.clone()),
            shell: None,
            bounds: [Point3::origin(); 2],
            speed: 0.0,
        })
    }

    /// Builds the surface if this rank has the grid. Returns whether there is a surface.
    fn begin(&mut self) -> bool {
        if self.shell.is_none() {
            self.shell = self.grid.take().and_then(|grid| Shell::from_grid(&grid));
        }
        self.shell.is_some()
    }

    /// Updates bounding box and largest speed.
    fn measure(&mut self, s: &Subdomain<f64>) {
        let (q, v) = (s.state().q.as_chunks::<3>().0, s.state().v.as_chunks::<3>().0);
        let mut low = Vector3::repeat(f64::INFINITY);
        let (mut high, mut square) = (-low, 0.0_f64);
        for ((x, q), v) in s.model().nodes().iter().zip(q).zip(v) {
            let x = x.coords + Vector3::from(*q);
            (low, high) = (low.inf(&x), high.sup(&x));
            square = square.max(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
        }
        self.speed = square.sqrt();
        let owned = s.owned();
        (0..3).for_each(|c| (low[c], high[c]) = (-owned.highest(-low[c]), owned.highest(high[c])));
        self.speed = owned.largest(self.speed);
        // The largest radius for all particles: the box only has to contain them.
        let reach = Vector3::repeat(self.radius);
        self.bounds = [(low - reach).into(), (high + reach).into()];
    }
}

/// Returns the enabled obstacles of a scene.
fn obstacles(scene: &LoweredScene) -> Result<Vec<Rigid>> {
    let mut out = Vec::new();
    for (k, e) in scene.effect.iter().enumerate().filter(|(_, e)| e.enabled) {
        let EffectKind::Obstacle(o) = &e.kind else {
            continue;
        };
        out.push(Rigid {
            name: o.ledger_name(k),
            effect: k,
            models: setup::effect_models(k, e, scene)?,
            shape: setup::obstacle_parts(k, o)?.0,
            moved: Vector3::zeros(),
            speed: 0.0,
        });
    }
    Ok(out)
}

/// Returns the number of the body to which each model belongs. Interfaces join models to one body.
fn bodies(run: &Coupled<f64>) -> Vec<usize> {
    let mut out: Vec<usize> = (0..run.subdomains().len()).collect();
    for i in run.interfaces() {
        let [a, b] = i.sides().map(|s| out[s]);
        out.iter_mut().filter(|k| **k == a).for_each(|k| *k = b);
    }
    out
}

/// Returns the names of models with contact between them, in both orders.
fn contact_pairs(scene: &LoweredScene) -> BTreeSet<[String; 2]> {
    let between = |e: &Effect| {
        let names = e.between.as_deref().filter(|_| e.enabled)?;
        <[String; 2]>::try_from(names.to_vec()).ok()
    };
    let pairs = scene.effect.iter().filter_map(between);
    pairs
        .flat_map(|[a, b]| [[a.clone(), b.clone()], [b, a]])
        .collect()
}
