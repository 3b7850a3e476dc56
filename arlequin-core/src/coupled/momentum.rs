//! Momentum of bodies, and what the ledger holds the free ones to.
//!
//! A body is what interfaces and effects between two subdomains hold together. Where nothing acts on it
//! from outside, the scheme keeps
//!
//! ```text
//! p = Σ m v        L = Σ y × m v + Σ I ω
//! ```
//!
//! to round-off, if the moments of all forces vanish about the same positions `y`. A linear law balances
//! about the positions at rest ([`Arms::Reference`]); finite rotations and contact about those where
//! particles are ([`Arms::Current`]). Multipliers balance about the positions at rest, and about the
//! present ones too where they have no displacement jump and act by components (`L2`, full gradients): `Σ u
//! × Bᵀλ = Σ (B_C u − B_D d) × λ = 0`. With more than one own step between two reflections, or an implicit
//! one, there is such a jump, and no claim is made. Where laws of both kinds meet, each leaves the `L` of
//! the other a moment of the order of its forces times the displacements: then that about present positions
//! is drawn up, and no claim is made.

use super::Coupled;
use super::warning::Warning;
use crate::subdomain::OwnStep;
use crate::weight::Weighting;
use crate::{Real, Subdomain, ranks};
use nalgebra::{Vector2, Vector3};
use std::ops::Range;

pub use crate::model::Arms;

/// What of the momentum of a body stays as it is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Claim {
    /// The linear and the angular one.
    Both,
    /// The linear one; why not the angular one.
    Linear(String),
    /// Neither: what acts from outside.
    Neither(String),
}

/// Momentum of a body and how well it was kept.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyMomentum<T: Real> {
    /// Names of its models.
    pub models: Vec<String>,
    /// Linear momentum \[kg m/s\].
    pub linear: Vector3<T>,
    /// Angular momentum \[kg m²/s\] about [`BodyMomentum::centre`].
    pub angular: Vector3<T>,
    /// Centre of mass at the start \[m\]: a point fixed in space.
    pub centre: Vector3<T>,
    /// Positions that the angular momentum is drawn up with.
    pub arms: Arms,
    /// What stays.
    pub claim: Claim,
    /// Largest change of either since the start at the drawings of the ledger, relative to `Σ |m v|` and
    /// `Σ |y × m v| + |I ω|` (the largest so far).
    pub drift: [T; 2],
}

/// Change relative to what is in play above which a momentum that should stay is worth a word; in 32-bit
/// numbers the root of their resolution.
const CHANGED: f64 = 1e-6;

/// The same where no claim is made: displacements are then no longer small.
const TURNED: f64 = 1e-2;

/// Sums over the nodes of a body: linear and angular momentum, and what they are relative to.
#[derive(Debug, Clone, Copy)]
struct Sums<T: Real> {
    momenta: [Vector3<T>; 2],
    sizes: [T; 2],
}

impl<T: Real> Sums<T> {
    fn zero() -> Self {
        Self {
            momenta: [Vector3::zeros(); 2],
            sizes: [T::zero(); 2],
        }
    }
}

impl<T: Real> From<[T; 8]> for Sums<T> {
    fn from([a, b, c, d, e, f, linear, angular]: [T; 8]) -> Self {
        Self {
            momenta: [Vector3::new(a, b, c), Vector3::new(d, e, f)],
            sizes: [linear, angular],
        }
    }
}

impl<T: Real> From<Sums<T>> for [T; 8] {
    fn from(of: Sums<T>) -> Self {
        let ([p, l], [linear, angular]) = (of.momenta, of.sizes);
        [p.x, p.y, p.z, l.x, l.y, l.z, linear, angular]
    }
}

impl<T: Real> std::ops::Add for Sums<T> {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self {
            momenta: [0, 1].map(|k: usize| self.momenta[k] + other.momenta[k]),
            sizes: [0, 1].map(|k: usize| self.sizes[k] + other.sizes[k]),
        }
    }
}

/// A body in the ledger.
#[derive(Debug, Clone)]
pub(crate) struct Body<T: Real> {
    members: Vec<usize>,
    arms: Arms,
    claim: Claim,
    centre: Vector3<T>,
    start: [Vector3<T>; 2],
    /// Largest sums of moduli so far, and largest changes relative to them.
    scale: [T; 2],
    top: [T; 2],
    /// Whether changes were beyond their limit and beyond what the digits of displacements explain.
    told: [bool; 2],
}

/// Numbers of a body in the record of the ledger.
pub(crate) const RECORDED: usize = 15;

impl<T: Real> Body<T> {
    fn sums(&self, all: &[Subdomain<T>]) -> Sums<T> {
        let members = self.members.iter();
        let of = |k: &usize| momentum_of(&all[*k], self.arms, &self.centre);
        members.map(of).fold(Sums::zero(), |a, b| a + b)
    }

    /// `Σ m |u|` and `Σ |y| m |u|`: what the digits of displacements are taken from.
    fn moved(&self, all: &[Subdomain<T>]) -> [T; 2] {
        let members = self.members.iter();
        let of = |k: &usize| moved_of(&all[*k], self.arms, &self.centre);
        let moved = members.map(of).fold(Vector2::zeros(), |a, b| a + b);
        [moved.x, moved.y]
    }

    /// Changes above which either momentum is worth a word; `None` where that does not stay.
    fn limits(&self) -> [Option<T>; 2] {
        let strict = T::of(CHANGED).max(T::epsilon().sqrt());
        match self.claim {
            Claim::Both => [Some(strict); 2],
            Claim::Linear(_) => [Some(strict), Some(T::of(TURNED))],
            Claim::Neither(_) => [None; 2],
        }
    }

    /// Draws up the momenta; their changes relative to what is in play, zero for those that need not stay.
    /// `rate` is the number of steps so far over the length of one: forces know displacements to their last
    /// digit only, and what they make of it adds up.
    pub(crate) fn balance(&mut self, all: &[Subdomain<T>], rate: T) -> [T; 2] {
        let limits = self.limits();
        if limits[0].is_none() {
            return [T::zero(); 2];
        }
        let now = self.sums(all);
        let mut out = [T::zero(); 2];
        for (k, out) in out.iter_mut().enumerate() {
            self.scale[k] = self.scale[k].max(now.sizes[k]);
            let change = (now.momenta[k] - self.start[k]).norm();
            if self.scale[k] > T::zero() {
                *out = change / self.scale[k];
                self.top[k] = self.top[k].max(*out);
            }
            // Rarely: only then it is worth another pass.
            if limits[k].is_some_and(|limit| *out > limit) {
                self.told[k] |= change > T::epsilon() * rate * self.moved(all)[k];
            }
        }
        let angular = matches!(self.claim, Claim::Both);
        [out[0], if angular { out[1] } else { T::zero() }]
    }

    pub(crate) fn record(&self) -> impl Iterator<Item = T> {
        let vectors = [self.centre, self.start[0], self.start[1]];
        let told = self.told.map(|t| if t { T::one() } else { T::zero() });
        let numbers = [self.scale, self.top, told];
        let vectors = vectors.into_iter().flat_map(<[T; 3]>::from);
        vectors.chain(numbers.into_iter().flatten())
    }

    /// Undoes [`Self::record`].
    pub(crate) fn restore(&mut self, from: &[T; RECORDED]) {
        let three = |k: usize| Vector3::new(from[k], from[k + 1], from[k + 2]);
        self.centre = three(0);
        self.start = [three(3), three(6)];
        (self.scale, self.top) = ([from[9], from[10]], [from[11], from[12]]);
        self.told = [from[13], from[14]].map(|t| t > T::zero());
    }
}

/// Momenta of one subdomain about a point.
fn momentum_of<T: Real>(s: &Subdomain<T>, arms: Arms, centre: &Vector3<T>) -> Sums<T> {
    let layout = s.model().layout();
    let (d, turns) = (layout.components, layout.turns());
    let (nodes, m, state) = (s.model().nodes(), s.inertia(), s.state());
    let first = layout.translations();
    let part = |range: Range<usize>| -> [T; 8] {
        let all = range.fold(Sums::zero(), |mut sum, k| {
            let (mut p, mut y) = (Vector3::zeros(), nodes[k].coords - centre);
            for c in 0..d {
                p[c] = m[k * d + c] * state.v[k * d + c];
                if arms == Arms::Current {
                    y[c] += state.q[k * d + c];
                }
            }
            let mut own = Vector3::zeros();
            if turns {
                (0..3).for_each(|c| own[c] = m[first + 3 * k + c] * state.v[first + 3 * k + c]);
            }
            let orbit = y.cross(&p);
            sum.momenta = [sum.momenta[0] + p, sum.momenta[1] + orbit + own];
            sum.sizes = [sum.sizes[0] + p.norm(), sum.sizes[1] + orbit.norm() + own.norm()];
            sum
        });
        all.into()
    };
    ranks::sum(layout.nodes, s.portion(), &part).into()
}

/// What the digits of the displacements of one subdomain are taken from, about a point.
fn moved_of<T: Real>(s: &Subdomain<T>, arms: Arms, centre: &Vector3<T>) -> Vector2<T> {
    let layout = s.model().layout();
    let d = layout.components;
    let (nodes, m, q) = (s.model().nodes(), s.inertia(), &s.state().q);
    let part = |range: Range<usize>| -> [T; 2] {
        let all = range.fold(Vector2::zeros(), |sum, k| {
            let (mut u, mut y) = (Vector3::zeros(), nodes[k].coords - centre);
            for c in 0..d {
                u[c] = m[k * d + c] * q[k * d + c];
                if arms == Arms::Current {
                    y[c] += q[k * d + c];
                }
            }
            let moved = u.norm();
            sum + Vector2::new(moved, moved * y.norm())
        });
        all.into()
    };
    ranks::sum(layout.nodes, s.portion(), &part).into()
}

impl<T: Real> Subdomain<T> {
    /// Linear momentum \[kg m/s\] and angular momentum about the origin \[kg m²/s\], with the arms of its
    /// model; on all ranks, all of which must ask.
    pub fn momentum(&self) -> [Vector3<T>; 2] {
        momentum_of(self, self.model().arms(), &Vector3::zeros()).momenta
    }
}

impl<T: Real> Coupled<T> {
    /// Momentum of every body, and how well it was kept.
    pub fn bodies(&self) -> Vec<BodyMomentum<T>> {
        let of = |b: &Body<T>| {
            let [linear, angular] = b.sums(&self.subdomains).momenta;
            BodyMomentum {
                models: self.names(b),
                linear,
                angular,
                centre: b.centre,
                arms: b.arms,
                claim: b.claim.clone(),
                drift: b.top,
            }
        };
        self.ledger.bodies.iter().map(of).collect()
    }

    fn names(&self, b: &Body<T>) -> Vec<String> {
        let name = |k: &usize| self.subdomains[*k].model().name().to_owned();
        b.members.iter().map(name).collect()
    }

    /// Warns of momenta that changed by more than round-off though they should stay, and of angular ones of
    /// bodies about which no claim is made that changed by more than small displacements explain.
    pub(super) fn warn_of_momentum(&mut self) {
        for k in 0..self.ledger.bodies.len() {
            for angular in [false, true] {
                let b = &self.ledger.bodies[k];
                let which = usize::from(angular);
                let Some(limit) = b.limits()[which].filter(|_| b.told[which]) else {
                    continue;
                };
                let because = match &b.claim {
                    Claim::Linear(why) if angular => Some(why.clone()),
                    _ => None,
                };
                let warning = Warning::MomentumChanged {
                    models: self.names(b),
                    angular,
                    share: b.top[which].as_f64(),
                    limit: limit.as_f64(),
                    because,
                };
                self.warn(warning);
            }
        }
    }

    /// Finds the bodies and weighs them at the start.
    pub(crate) fn find_bodies(&mut self) {
        let groups = self.groups();
        self.ledger.bodies = groups
            .into_iter()
            .map(|members| {
                let (arms, claim) = self.claim(&members);
                let mut body = Body {
                    centre: self.centre(&members, arms),
                    members,
                    arms,
                    claim,
                    start: [Vector3::zeros(); 2],
                    scale: [T::zero(); 2],
                    top: [T::zero(); 2],
                    told: [false; 2],
                };
                let sums = body.sums(&self.subdomains);
                (body.start, body.scale) = (sums.momenta, sums.sizes);
                body
            })
            .collect();
    }

    /// Subdomains that are held together, each group ascending.
    fn groups(&self) -> Vec<Vec<usize>> {
        let mut group: Vec<usize> = (0..self.subdomains.len()).collect();
        let interfaces = self.interfaces.iter().map(|i| i.sides);
        for [a, b] in interfaces.chain(self.pairs.iter().map(|p| p.sides)) {
            let (low, high) = (group[a].min(group[b]), group[a].max(group[b]));
            group.iter_mut().filter(|g| **g == high).for_each(|g| *g = low);
        }
        let own = |g: usize| (0..group.len()).filter(|k| group[*k] == g).collect();
        let firsts = (0..group.len()).filter(|k| group[*k] == *k);
        firsts.map(own).collect()
    }

    fn centre(&self, members: &[usize], arms: Arms) -> Vector3<T> {
        let (mut sum, mut mass) = (Vector3::zeros(), T::zero());
        for s in members.iter().map(|k| &self.subdomains[*k]) {
            let (d, nodes) = (s.model().layout().components, s.model().nodes());
            let (m, q) = (s.inertia(), &s.state().q);
            let part = |range: Range<usize>| {
                range.fold([T::zero(); 4], |[a, b, c, all], k| {
                    let mut y = nodes[k].coords;
                    if arms == Arms::Current {
                        (0..d).for_each(|c| y[c] += q[k * d + c]);
                    }
                    let m = m[k * d];
                    [a + m * y.x, b + m * y.y, c + m * y.z, all + m]
                })
            };
            let [x, y, z, all] = ranks::sum(nodes.len(), s.portion(), &part);
            sum += Vector3::new(x, y, z);
            mass += all;
        }
        if mass > T::zero() { sum / mass } else { sum }
    }

    /// What stays of the momentum of subdomains that are held together, and about which positions.
    fn claim(&self, members: &[usize]) -> (Arms, Claim) {
        let mut laws: Vec<(String, Arms)> = Vec::new();
        let mut outside = None;
        for s in members.iter().map(|k| &self.subdomains[*k]) {
            let name = s.model().name();
            laws.push((format!("the law of '{name}'"), s.model().arms()));
            // On any rank: all must come to the same claim.
            let held = s.supports().iter().map(|m| m.dofs.len()).sum::<usize>();
            if ranks::largest(s.portion(), T::of(held as f64)) > T::zero() {
                outside.get_or_insert(format!("supports of '{name}'"));
            }
            if s.weights().weighting == Weighting::Nodal {
                outside.get_or_insert(format!(
                    "nodal weights of '{name}', whose forces have no reaction"
                ));
            }
            for e in s.effects() {
                match e.arms() {
                    Some(arms) => laws.push((format!("'{}' of '{name}'", e.name()), arms)),
                    None => drop(outside.get_or_insert(format!("'{}' of '{name}'", e.name()))),
                }
            }
        }
        let mut doubt = None;
        for p in self.pairs.iter().filter(|p| members.contains(&p.sides[0])) {
            match p.line.effect.arms() {
                Some(arms) => laws.push((format!("'{}'", p.line.effect.name()), arms)),
                None => {
                    doubt = Some(format!(
                        "'{}' does not say what its moments are",
                        p.line.effect.name()
                    ));
                }
            }
        }
        let find = |wanted: Arms| laws.iter().find(|l| l.1 == wanted).map(|l| &l.0);
        let (rest, now) = (find(Arms::Reference), find(Arms::Current));
        if let (Some(a), Some(b)) = (rest, now) {
            doubt = Some(format!(
                "{a} balances about the positions at rest, {b} about the present ones"
            ));
        }
        let arms = if now.is_some() {
            Arms::Current
        } else {
            Arms::Reference
        };
        let mixes = |i: &&crate::interface::Interface<T>| members.contains(&i.sides[0]) && !i.splits();
        if arms == Arms::Current
            && let Some(i) = self.interfaces.iter().find(mixes)
        {
            doubt.get_or_insert(format!(
                "the junction of interface '{}' balances about the positions at rest",
                i.report().name
            ));
        }
        if arms == Arms::Current
            && let Some(why) = self.parting(members)
        {
            doubt.get_or_insert(why);
        }
        let claim = match (outside, doubt) {
            (Some(outside), _) => Claim::Neither(outside),
            (None, Some(doubt)) => Claim::Linear(doubt),
            (None, None) => Claim::Both,
        };
        (arms, claim)
    }

    /// Why multipliers between these subdomains do not balance about present positions: what own steps
    /// leave of the displacement constraint.
    fn parting(&self, members: &[usize]) -> Option<String> {
        let parts = |s: &&Subdomain<T>| s.own_steps() > 1 || matches!(s.step_choice(), OwnStep::Implicit);
        let mut tied = self.interfaces.iter().filter(|i| members.contains(&i.sides[0]));
        tied.find_map(|i| {
            let sides = i.sides.map(|s| &self.subdomains[s]);
            let s = sides.into_iter().find(parts)?;
            let how = match s.own_steps() {
                1 => "steps implicitly".to_owned(),
                m => format!("makes {m} own steps between two reflections"),
            };
            Some(format!(
                "'{}' {how}, so that displacements part across interface '{}', whose multipliers then have a moment about the \
                 present positions; one explicit step each keeps it",
                s.model().name(),
                i.report().name
            ))
        })
    }
}
