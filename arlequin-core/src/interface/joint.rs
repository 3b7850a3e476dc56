//! Interfaces that act on the same nodes and are solved for as one system.
//!
//! Each model has one `B_m` with the rows of all interfaces, positive where the model is coarse and negative
//! where it is fine. Then `S = Σ_m B_m M_m⁻¹ B_mᵀ` has off-diagonal blocks wherever two interfaces act on one
//! node. One solution meets all constraints, and the reflection keeps the kinetic energy of all models
//! together.

use super::operator::Wanted;
use super::sides::Sides;
use super::system::System;
use super::transfer::Transfer;
use super::{Coupling, Draft, Interface, InterfaceOptions, InterfaceSpec, coupled_nodes};
use crate::Owned;
use crate::{Real, Result};
use sprs::TriMat;

/// Group of interfaces that are solved for as one system.
#[derive(Debug)]
pub(crate) struct Joint<T: Real> {
    /// Indices of the interfaces, ascending.
    pub(crate) members: Vec<usize>,
    /// First multiplier of each interface, then the number of all.
    starts: Vec<usize>,
    /// Indices of the models that the interfaces act on, ascending.
    pub(crate) models: Vec<usize>,
    /// One side per model. Signs of all but the first are reversed, since [`Sides`] subtracts them.
    sides: Sides<T>,
    system: System<T>,
    /// `μ` of half a reflection.
    impulse: Vec<T>,
    /// `λ = rate μ`.
    rate: T,
}

/// Returns groups of interfaces that share nodes, directly or through others. Each group is ascending.
pub(crate) fn groups<T: Real>(drafts: &[Draft<T>], nodes: &[usize]) -> Vec<Vec<usize>> {
    let mut owner: Vec<Vec<Option<usize>>> = nodes.iter().map(|n| vec![None; *n]).collect();
    let mut group: Vec<usize> = (0..drafts.len()).collect();
    for (k, Draft { interface: i, .. }) in drafts.iter().enumerate() {
        for m in 0..2 {
            for node in coupled_nodes(&i.coupling[m], i.components) {
                let Some(other) = owner[i.sides[m]][node].replace(k) else {
                    continue;
                };
                // Two groups become one under the lower number: a group has the number of its first member.
                let (low, high) = (group[k].min(group[other]), group[k].max(group[other]));
                group.iter_mut().filter(|g| **g == high).for_each(|g| *g = low);
            }
        }
    }
    let firsts = (0..group.len()).filter(|k| group[*k] == *k);
    let members = |first: usize| (0..group.len()).filter(|k| group[*k] == first).collect();
    firsts.map(members).collect()
}

impl<T: Real> Joint<T> {
    /// Joins the interfaces with the indices `members` in one system. `inverse`: inverse inertia of every
    /// model.
    ///
    /// # Errors
    /// Errors of the operator; [`crate::Error::InvalidOption`] for a lumped one.
    pub(crate) fn new(
        members: Vec<usize>,
        specs: &[InterfaceSpec<T>],
        drafts: &mut [Draft<T>],
        inverse: &[&[T]],
    ) -> Result<Self> {
        let options = agreed(&members, specs)?;
        let names: Vec<&str> = members.iter().map(|k| &*specs[*k].name).collect();
        let name = names.join("' and '");
        let mut starts = vec![0];
        for k in &members {
            starts.push(starts[starts.len() - 1] + drafts[*k].interface.lambda.len());
        }
        let mut models: Vec<usize> = members.iter().flat_map(|k| drafts[*k].interface.sides).collect();
        models.sort_unstable();
        models.dedup();
        let inverse: Vec<&[T]> = models.iter().map(|s| inverse[*s]).collect();
        let stacked = stacked(&members, &models, drafts, &inverse);
        let components = drafts[members[0]].interface.components;
        let wanted = Wanted {
            name: &name,
            options: &options,
        };
        let system = System::new(wanted, &stacked, &inverse, components)?;
        let sides = stacked
            .iter()
            .zip(&inverse)
            .enumerate()
            .map(|(k, (side, inverse))| {
                let sign = if k == 0 { -T::one() } else { T::one() };
                Transfer::new(side, components, sign, inverse)
            });
        let out = Self {
            sides: Sides::new(sides.collect()),
            impulse: vec![T::zero(); starts[members.len()]],
            rate: T::zero(),
            members,
            starts,
            models,
            system,
        };
        for (place, k) in out.members.iter().enumerate() {
            let multipliers = out.starts[place]..out.starts[place + 1];
            let other_names = names.iter().enumerate().filter(|n| n.0 != place);
            let together = other_names.map(|n| (*n.1).to_owned()).collect();
            let interface = &mut drafts[*k].interface;
            interface.report_operator(&out.system.operator, multipliers, together);
        }
        Ok(out)
    }

    /// Solves for the multipliers that remove the jump of `x`, given for every model by its index, and keeps
    /// them and the changes of the models, `scale` times.
    pub(crate) fn find<'a>(&mut self, x: impl Fn(usize) -> &'a [T], scale: T) {
        let sides = self.sides.iter_mut().zip(&self.models);
        sides.for_each(|(s, m)| s.load(x(*m)));
        self.system
            .find(&mut self.sides, &|_| (), scale, &mut self.impulse);
    }

    /// Returns whether the last solve was an iteration that ended above its tolerance.
    pub(crate) fn is_unsolved(&self) -> bool {
        self.system.operator.is_unsolved()
    }

    /// Restricts the coupling matrices to this rank's parts; `owned` has an entry per model of the run.
    pub(crate) fn restrict(&mut self, owned: &[Owned]) {
        let of_sides: Vec<_> = self.models.iter().map(|m| &owned[*m]).collect();
        self.sides.restrict(&of_sides);
        if let Some(parts) = self.sides.parts() {
            self.system.partition_among(parts);
        }
    }

    /// Returns each model with the change that the multipliers make to it.
    pub(crate) fn kicks(&self) -> impl Iterator<Item = (usize, &Transfer<T>)> {
        self.models.iter().copied().zip(self.sides.iter())
    }

    /// Hands each interface its multipliers.
    pub(crate) fn hand_out(&self, interfaces: &mut [Interface<T>]) {
        for (place, k) in self.members.iter().enumerate() {
            let impulse = &self.impulse[self.starts[place]..self.starts[place + 1]];
            interfaces[*k].take(impulse, self.system.operator.iterations());
        }
    }

    /// Restores the impulses that the interfaces hold, and the changes that follow from them.
    pub(crate) fn restore(&mut self, interfaces: &[Interface<T>]) {
        for (place, k) in self.members.iter().enumerate() {
            let impulse = &mut self.impulse[self.starts[place]..self.starts[place + 1]];
            impulse.copy_from_slice(interfaces[*k].impulse());
        }
        self.sides.spread(&self.impulse);
    }

    /// Sets the duration of the macro steps \[s\].
    pub(crate) fn pace(&mut self, step: T) {
        self.rate = T::of(2.0) / step;
    }

    /// Returns the power `λᵀB v` \[W\] with the velocities after the last reflection.
    pub(crate) fn power(&self) -> T {
        self.rate * self.system.residual_work()
    }
}

/// Returns options for all members: the tightest tolerances and the common solver.
fn agreed<T: Real>(members: &[usize], specs: &[InterfaceSpec<T>]) -> Result<InterfaceOptions<T>> {
    let mut out = specs[members[0]].options;
    for spec in members.iter().map(|k| &specs[*k]) {
        if spec.options.lumped {
            let other_names = members
                .iter()
                .map(|k| &*specs[*k].name)
                .filter(|n| *n != spec.name);
            let rule = format!(
                "it shares nodes with '{}' and is solved together with it: row sums would leave out what one does to the \
                 other; take it out, or move the interfaces apart",
                other_names.collect::<Vec<_>>().join("', '")
            );
            return Err(crate::error::invalid_option(&spec.name, "lumped", "true", &rule));
        }
        out.rank_tolerance = out.rank_tolerance.min(spec.options.rank_tolerance);
        out.solver = out.solver.with(spec.options.solver);
    }
    Ok(out)
}

/// Stacks the rows of all interfaces over the unknowns of each model.
fn stacked<T: Real>(
    members: &[usize],
    models: &[usize],
    drafts: &mut [Draft<T>],
    inverse: &[&[T]],
) -> Vec<Coupling<T>> {
    let components = drafts[members[0]].interface.components;
    let mut parts: Vec<_> = members
        .iter()
        .map(|k| {
            (
                drafts[*k].interface.sides,
                std::mem::take(&mut drafts[*k].coupling),
            )
        })
        .collect();
    // All components share one matrix if they do so in every interface, and if supports fix a node in all
    // components or in none.
    let place = |model: usize| models.iter().position(|m| *m == model);
    let alike = |(sides, coupling): &([usize; 2], Vec<Coupling<T>>)| {
        sides.iter().zip(coupling).all(|(side, c)| {
            let inverse = place(*side).map_or(&[][..], |k| inverse[k]);
            let node_inverse = |j: usize| {
                inverse
                    .get(j * components..(j + 1) * components)
                    .unwrap_or_default()
            };
            let is_isotropic = |j: usize| node_inverse(j).iter().all(|w| *w == node_inverse(j)[0]);
            c.shared == components && c.matrix.iter().all(|(_, (_, j))| is_isotropic(j))
        })
    };
    let shared = if parts.iter().all(alike) { components } else { 1 };
    for c in parts
        .iter_mut()
        .flat_map(|p| &mut p.1)
        .filter(|c| c.shared != shared)
    {
        *c = Coupling {
            matrix: c.expanded(),
            shared,
        };
    }
    let rows = parts
        .iter()
        .map(|p| p.1.first().map_or(0, |c| c.matrix.rows()))
        .sum();
    let side = |(place, model): (usize, &usize)| {
        let of_model = |sides: &[usize; 2]| sides.iter().position(|s| s == model);
        let columns = parts
            .iter()
            .find_map(|(sides, c)| Some(c.get(of_model(sides)?)?.matrix.cols()));
        let mut triplets = TriMat::new((rows, columns.unwrap_or(0)));
        let mut first = 0;
        for (sides, coupling) in &parts {
            let own_coupling = of_model(sides).and_then(|m| Some((m, coupling.get(m)?)));
            if let Some((m, c)) = own_coupling {
                // Plus for a coarse side; reversed for all models but the first, as in [`Joint::sides`].
                let sign = if (m == 0) == (place == 0) {
                    T::one()
                } else {
                    -T::one()
                };
                c.matrix
                    .iter()
                    .for_each(|(v, (i, j))| triplets.add_triplet(first + i, j, sign * *v));
            }
            first += coupling.first().map_or(0, |c| c.matrix.rows());
        }
        Coupling {
            matrix: triplets.to_csr(),
            shared,
        }
    };
    models.iter().enumerate().map(side).collect()
}
