//! Momentum of bodies, and the conservation that the ledger checks.
//!
//! A body is a group of subdomains that interfaces and pair effects hold together. If nothing acts on it from
//! outside, the scheme keeps
//!
//! ```text
//! p = Σ m v        L = Σ y × m v + Σ I ω
//! ```
//!
//! to round-off, provided that the moments of all forces vanish about the same positions `y`. A linear law
//! balances about the positions at rest ([`Arms::Reference`]), finite rotations and contact about the present
//! positions ([`Arms::Current`]). Multipliers balance about the positions at rest. They balance about the
//! present positions too if there is no displacement jump and they act by components (`L2`, full gradients):
//! `Σ u × Bᵀλ = Σ (B_C u − B_D d) × λ = 0`. With more than one own step between two reflections, or an
//! implicit one, there is a displacement jump, and no claim is made. Where laws of both kinds meet, each adds
//! a moment of the order of its forces times the displacements to the `L` of the other. The ledger then
//! evaluates `L` about present positions and makes no claim.

use super::Coupled;
use super::warning::Warning;
use crate::subdomain::OwnStep;
use crate::weight::Weighting;
use crate::{Real, Subdomain};
use nalgebra::{Vector2, Vector3};
use std::ops::Range;

pub use crate::model::Arms;

/// Momenta of a body that should be kept.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Claim {
    /// Linear and angular momentum.
    Both,
    /// Linear momentum only; the text says why not the angular one.
    Linear(String),
    /// No momentum; the text says what acts from outside.
    Neither(String),
}

/// Momentum of a body and how well it was kept.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyMomentum<T: Real> {
    /// Names of the models of the body.
    pub models: Vec<String>,
    /// Linear momentum \[kg m/s\].
    pub linear: Vector3<T>,
    /// Angular momentum \[kg m²/s\] about [`BodyMomentum::centre`].
    pub angular: Vector3<T>,
    /// Centre of mass at the start \[m\]: a point fixed in space.
    pub centre: Vector3<T>,
    /// Positions about which the angular momentum is evaluated.
    pub arms: Arms,
    /// Momenta that should be kept.
    pub claim: Claim,
    /// Largest changes of linear and angular momentum since the start, at evaluations of the ledger, relative
    /// to the largest `Σ |m v|` and `Σ |y × m v| + |I ω|` so far.
    pub drift: [T; 2],
}

/// Relative change of a kept momentum above which there is a warning; in single precision the root of the
/// resolution of numbers.
const CHANGED: f64 = 1e-6;

/// Relative change of an angular momentum without a claim above which there is a warning: displacements are
/// then no longer small.
const TURNED: f64 = 1e-2;

/// Linear and angular momentum summed over the nodes of a body, and the sums of moduli to which changes are
/// relative.
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
    fn from(sums: Sums<T>) -> Self {
        let ([p, l], [linear, angular]) = (sums.momenta, sums.sizes);
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

fn sums<T: Real>(subdomains: &[Subdomain<T>], members: &[usize], arms: Arms, centre: &Vector3<T>) -> Sums<T> {
    let sum = |k: &usize| momentum_of(&subdomains[*k], arms, centre);
    members.iter().map(sum).fold(Sums::zero(), |a, b| a + b)
}

/// Linear and angular momentum of some subdomains about `centre`.
pub(super) fn momenta<T: Real>(
    subdomains: &[Subdomain<T>],
    members: &[usize],
    arms: Arms,
    centre: &Vector3<T>,
) -> [Vector3<T>; 2] {
    sums(subdomains, members, arms, centre).momenta
}

/// Groups of `members` (ascending) that `links` join, each ascending.
pub(super) fn joined(members: &[usize], links: impl Iterator<Item = [usize; 2]>) -> Vec<Vec<usize>> {
    let mut group: Vec<usize> = (0..=members.last().copied().unwrap_or_default()).collect();
    for [a, b] in links.filter(|l| l.iter().all(|k| members.contains(k))) {
        // The lowest number stands for the group, so that groups are ascending.
        let (low, high) = (group[a].min(group[b]), group[a].max(group[b]));
        group.iter_mut().filter(|g| **g == high).for_each(|g| *g = low);
    }
    let of_group = |g: usize| members.iter().copied().filter(|k| group[*k] == g).collect();
    members
        .iter()
        .filter(|k| group[**k] == **k)
        .map(|k| of_group(*k))
        .collect()
}

/// Body with its momenta, as the ledger keeps it.
#[derive(Debug, Clone)]
pub(crate) struct Body<T: Real> {
    members: Vec<usize>,
    arms: Arms,
    claim: Claim,
    centre: Vector3<T>,
    start: [Vector3<T>; 2],
    /// Largest sums of moduli so far.
    scale: [T; 2],
    /// Largest changes so far, relative to `scale`.
    top: [T; 2],
    /// True if the momentum changed by more than its limit and by more than the round-off of displacements
    /// explains.
    exceeded: [bool; 2],
}

/// Number of values per body in a record of the ledger.
pub(crate) const RECORDED: usize = 15;

impl<T: Real> Body<T> {
    fn sums(&self, subdomains: &[Subdomain<T>]) -> Sums<T> {
        sums(subdomains, &self.members, self.arms, &self.centre)
    }

    /// Returns the members, the positions of the arms and the centre.
    pub(super) fn frame(&self) -> (Vec<usize>, Arms, Vector3<T>) {
        (self.members.clone(), self.arms, self.centre)
    }

    /// Returns `Σ m |u|` and `Σ |y| m |u|`, from which the round-off of the momenta is estimated.
    fn moved(&self, subdomains: &[Subdomain<T>]) -> [T; 2] {
        let members = self.members.iter();
        let displaced = |k: &usize| moved_of(&subdomains[*k], self.arms, &self.centre);
        let moved = members.map(displaced).fold(Vector2::zeros(), |a, b| a + b);
        [moved.x, moved.y]
    }

    /// Returns the relative change of either momentum above which there is a warning; `None` if a momentum
    /// need not be kept.
    fn limits(&self) -> [Option<T>; 2] {
        let strict = T::of(CHANGED).max(T::epsilon().sqrt());
        match self.claim {
            Claim::Both => [Some(strict); 2],
            Claim::Linear(_) => [Some(strict), Some(T::of(TURNED))],
            Claim::Neither(_) => [None; 2],
        }
    }

    /// Evaluates the momenta and returns their relative changes, zero for momenta that need not be kept.
    /// `rate` is the number of own steps so far over the length of one \[1/s\]: forces know displacements to
    /// their last digit only, and the momenta of these errors add up.
    pub(crate) fn balance(&mut self, subdomains: &[Subdomain<T>], rate: T) -> [T; 2] {
        let limits = self.limits();
        // Without anything to keep, a pass over all nodes is saved.
        if limits[0].is_none() {
            return [T::zero(); 2];
        }
        let now = self.sums(subdomains);
        let mut out = [T::zero(); 2];
        for (k, out) in out.iter_mut().enumerate() {
            // The largest sums so far: a body may come to rest.
            self.scale[k] = self.scale[k].max(now.sizes[k]);
            let change = (now.momenta[k] - self.start[k]).norm();
            if self.scale[k] > T::zero() {
                *out = change / self.scale[k];
                self.top[k] = self.top[k].max(*out);
            }
            // Another pass over all nodes, so only where the limit is exceeded.
            if limits[k].is_some_and(|limit| *out > limit) {
                self.exceeded[k] |= change > T::epsilon() * rate * self.moved(subdomains)[k];
            }
        }
        let angular = matches!(self.claim, Claim::Both);
        [out[0], if angular { out[1] } else { T::zero() }]
    }

    pub(crate) fn record(&self) -> impl Iterator<Item = T> {
        let vectors = [self.centre, self.start[0], self.start[1]];
        let exceeded = self.exceeded.map(|t| if t { T::one() } else { T::zero() });
        let numbers = [self.scale, self.top, exceeded];
        let vectors = vectors.into_iter().flat_map(<[T; 3]>::from);
        vectors.chain(numbers.into_iter().flatten())
    }

    /// Restores the numbers of [`Self::record`].
    pub(crate) fn restore(&mut self, from: &[T; RECORDED]) {
        let three = |k: usize| Vector3::new(from[k], from[k + 1], from[k + 2]);
        self.centre = three(0);
        self.start = [three(3), three(6)];
        (self.scale, self.top) = ([from[9], from[10]], [from[11], from[12]]);
        self.exceeded = [from[13], from[14]].map(|t| t > T::zero());
    }
}

/// Returns the momenta of one subdomain about a point, over all ranks.
fn momentum_of<T: Real>(s: &Subdomain<T>, arms: Arms, centre: &Vector3<T>) -> Sums<T> {
    let layout = s.model().layout();
    let (d, turns) = (layout.components, layout.turns());
    let (nodes, m, state) = (s.model().nodes(), s.inertia(), s.state());
    let first = layout.translations();
    // Eight sums in one pass: the ledger asks for them at every evaluation.
    let part = |range: Range<usize>| -> [T; 8] {
        let total = range.fold(Sums::zero(), |mut sum, k| {
            let (mut p, mut y) = (Vector3::zeros(), nodes[k].coords - centre);
            for c in 0..d {
                p[c] = m[k * d + c] * state.v[k * d + c];
                if arms == Arms::Current {
                    y[c] += state.q[k * d + c];
                }
            }
            let mut spin = Vector3::zeros();
            if turns {
                (0..3).for_each(|c| spin[c] = m[first + 3 * k + c] * state.v[first + 3 * k + c]);
            }
            let orbit = y.cross(&p);
            sum.momenta = [sum.momenta[0] + p, sum.momenta[1] + orbit + spin];
            sum.sizes = [sum.sizes[0] + p.norm(), sum.sizes[1] + orbit.norm() + spin.norm()];
            sum
        });
        total.into()
    };
    s.owned().sum(&part).into()
}

/// Returns the terms of [`Body::moved`] of one subdomain, over all ranks.
fn moved_of<T: Real>(s: &Subdomain<T>, arms: Arms, centre: &Vector3<T>) -> Vector2<T> {
    let layout = s.model().layout();
    let d = layout.components;
    let (nodes, m, q) = (s.model().nodes(), s.inertia(), &s.state().q);
    let part = |range: Range<usize>| -> [T; 2] {
        let total = range.fold(Vector2::zeros(), |sum, k| {
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
        total.into()
    };
    s.owned().sum(&part).into()
}

impl<T: Real> Subdomain<T> {
    /// Linear momentum \[kg m/s\] and angular momentum about the origin \[kg m²/s\], with the arms of the
    /// model, over all ranks. Collective.
    pub fn momentum(&self) -> [Vector3<T>; 2] {
        momentum_of(self, self.model().views().arms, &Vector3::zeros()).momenta
    }
}

impl<T: Real> Coupled<T> {
    /// Momentum of every body and how well it was kept.
    pub fn bodies(&self) -> Vec<BodyMomentum<T>> {
        let report = |b: &Body<T>| {
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
        self.ledger.bodies.iter().map(report).collect()
    }

    fn names(&self, b: &Body<T>) -> Vec<String> {
        let name = |k: &usize| self.subdomains[*k].model().name().to_owned();
        b.members.iter().map(name).collect()
    }

    /// Warns of kept momenta that changed by more than round-off, and of angular momenta without a claim that
    /// changed by more than small displacements explain.
    pub(super) fn warn_of_momentum(&mut self) {
        for k in 0..self.ledger.bodies.len() {
            for angular in [false, true] {
                let b = &self.ledger.bodies[k];
                let which = usize::from(angular);
                let Some(limit) = b.limits()[which].filter(|_| b.exceeded[which]) else {
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

    /// Finds the bodies and evaluates their momenta at the start.
    pub(crate) fn find_bodies(&mut self) {
        let interfaces = self.interfaces.iter().map(|i| i.sides);
        let members: Vec<usize> = (0..self.subdomains.len()).collect();
        let groups = joined(&members, interfaces.chain(self.pairs.iter().map(|p| p.sides)));
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
                    exceeded: [false; 2],
                };
                let sums = body.sums(&self.subdomains);
                (body.start, body.scale) = (sums.momenta, sums.sizes);
                body
            })
            .collect();
    }

    fn centre(&self, members: &[usize], arms: Arms) -> Vector3<T> {
        let (mut sum, mut mass) = (Vector3::zeros(), T::zero());
        for s in members.iter().map(|k| &self.subdomains[*k]) {
            let (d, nodes) = (s.model().layout().components, s.model().nodes());
            let (m, q) = (s.inertia(), &s.state().q);
            let part = |range: Range<usize>| {
                range.fold([T::zero(); 4], |[a, b, c, total], k| {
                    let mut y = nodes[k].coords;
                    if arms == Arms::Current {
                        (0..d).for_each(|c| y[c] += q[k * d + c]);
                    }
                    let m = m[k * d];
                    [a + m * y.x, b + m * y.y, c + m * y.z, total + m]
                })
            };
            let [x, y, z, total] = s.owned().sum(&part);
            sum += Vector3::new(x, y, z);
            mass += total;
        }
        if mass > T::zero() { sum / mass } else { sum }
    }

    /// Returns the momenta that a group of subdomains should keep, and the positions of the arms.
    fn claim(&self, members: &[usize]) -> (Arms, Claim) {
        let mut laws: Vec<(String, Arms)> = Vec::new();
        // The first cause is enough for the report.
        let mut outside = None;
        for s in members.iter().map(|k| &self.subdomains[*k]) {
            let name = s.model().name();
            laws.push((format!("the law of '{name}'"), s.model().views().arms));
            // A support may lie on another rank: all ranks must come to the same claim.
            let held = s.supports().iter().map(|m| m.dofs.len()).sum::<usize>();
            if s.owned().largest(T::of(held as f64)) > T::zero() {
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
        let (reference, current) = (find(Arms::Reference), find(Arms::Current));
        if let (Some(a), Some(b)) = (reference, current) {
            doubt = Some(format!(
                "{a} balances about the positions at rest, {b} about the present ones"
            ));
        }
        let arms = if current.is_some() {
            Arms::Current
        } else {
            Arms::Reference
        };
        // A junction that mixes components balances about the positions at rest only.
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
            && let Some(why) = self.parting_reason(members)
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

    /// Returns the reason why multipliers between these subdomains do not balance about present positions:
    /// own steps that leave a displacement jump.
    fn parting_reason(&self, members: &[usize]) -> Option<String> {
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
