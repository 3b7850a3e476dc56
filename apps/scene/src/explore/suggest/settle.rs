//! Picks a candidate, builds and measures it, and picks again with the measured cost until prediction and
//! measurement agree.

use super::FRACTION;
use super::apply::{self, Change};
use super::choose::{CostModel, Goal, Prospect, Search};
use super::measure::measure;
use super::predict::Candidate;
use crate::error::{Error, Result, key, value};
use crate::scene::Scene;

/// Largest number of proposals that are built and measured.
const ROUNDS: usize = 4;
/// Largest number of proposals that cannot be built or cause warnings and are replaced.
const REPLACED: usize = 4;
/// Largest relative difference of predicted and measured time.
const AGREED: f64 = 0.15;

/// A measured proposal.
#[derive(Debug)]
pub(super) struct Settled {
    /// Settings with their error and measured time.
    pub prospect: Prospect,
    /// Changes of the scene.
    pub changes: Vec<Change>,
    /// Warnings of its set-up that the scene as given does not cause.
    pub warnings: Vec<String>,
}

impl Settled {
    /// Returns whether the proposal improves the scene as given: it meets the goal without new warnings, and
    /// is faster or more accurate than a scene that meets the goal itself.
    pub(super) fn improves(&self, given: &Prospect, goal: Goal) -> bool {
        let new = &self.prospect;
        !goal.is_met(given)
            || (goal.is_met(new)
                && self.warnings.is_empty()
                && !self.changes.is_empty()
                && match goal {
                    Goal::Error(_) => new.seconds < given.seconds,
                    Goal::Time(_) => new.errors.worst() < given.errors.worst(),
                })
    }
}

/// Returns the warnings that are not among those of the scene as given, whatever their numbers.
fn new_warnings(given: &[String], warnings: Vec<String>) -> Vec<String> {
    let words = |w: &str| -> Vec<String> {
        let words = w.split_whitespace().map(str::to_owned);
        words
            .filter(|w| !w.contains(|c: char| c.is_ascii_digit()))
            .collect()
    };
    let known: Vec<_> = given.iter().map(|w| words(w)).collect();
    warnings
        .into_iter()
        .filter(|w| !known.contains(&words(w)))
        .collect()
}

/// A candidate that was built and measured.
struct Trial {
    costs: CostModel,
    settled: Settled,
}

/// Builds and measures a proposal.
fn trial(scene: &Scene, search: &Search<'_>, proposal: &Prospect, given: &[String]) -> Result<Trial> {
    let s = search.scenario;
    let changes = apply::changes(scene.spec(), s, proposal, FRACTION);
    let (m, _, _, warnings) = measure(scene, &changes)?;
    // The measured candidate becomes the base, where scaling costs no accuracy.
    let costs = CostModel::new(proposal.candidate, m, s, FRACTION);
    let seconds = costs.seconds(&proposal.candidate, s, search.end);
    Ok(Trial {
        costs,
        settled: Settled {
            prospect: Prospect { seconds, ..*proposal },
            changes,
            warnings: new_warnings(given, warnings),
        },
    })
}

/// Finds a proposal. `costs` are those of the scene as given, and `given` are the warnings of its set-up.
///
/// # Errors
/// Goals out of reach; the first failed set-up, if no candidate can be built.
pub(super) fn settle(
    scene: &Scene,
    search: &Search<'_>,
    goal: Goal,
    mut costs: CostModel,
    given: &[String],
) -> Result<Settled> {
    let (mut dropped, mut rounds) = (Vec::new(), 0);
    // The proposal with the fewest new warnings, and the first failure.
    let (mut spare, mut failure): (Option<Settled>, Option<Error>) = (None, None);
    let mut proposal = pick(search, goal, &costs, &dropped)?;
    while dropped.len() < REPLACED {
        match trial(scene, search, &proposal, given) {
            Ok(t) if t.settled.warnings.is_empty() => {
                rounds += 1;
                costs = t.costs;
                let measured = t.settled.prospect;
                let agreed = (proposal.seconds / measured.seconds - 1.0).abs() < AGREED;
                let in_time = !matches!(goal, Goal::Time(t) if measured.seconds > t);
                let next = pick(search, goal, &costs, &dropped)?;
                // A candidate that is picked again would only be measured again.
                if rounds == ROUNDS || (agreed && in_time) || next.candidate == proposal.candidate {
                    return Ok(t.settled);
                }
                proposal = next;
                continue;
            }
            Ok(t)
                if spare
                    .as_ref()
                    .is_none_or(|s| t.settled.warnings.len() < s.warnings.len()) =>
            {
                spare = Some(t.settled);
            }
            Ok(_) => {}
            Err(e) => {
                failure.get_or_insert(e);
            }
        }
        dropped.push(proposal.candidate);
        let Ok(next) = pick(search, goal, &costs, &dropped) else {
            break;
        };
        proposal = next;
    }
    // A proposal with warnings is better than none.
    spare.ok_or_else(|| {
        let why = failure.map_or_else(String::new, |e| e.to_string());
        key(
            "suggest",
            format!("no settings that it tried can be built: {why}"),
        )
    })
}

fn pick(search: &Search<'_>, goal: Goal, costs: &CostModel, dropped: &[Candidate]) -> Result<Prospect> {
    search.best(goal, costs, dropped).map_err(|nearest| {
        let closest = |p: Prospect| {
            format!(
                "the closest is an error of {:.2e} in {:.2e} s with a coarse spacing of {:.2e} m",
                p.errors.worst(),
                p.seconds,
                p.candidate.h
            )
        };
        let none = || "no coarse spacing fits between the fine spacing and the body".to_owned();
        let nearest = nearest.map_or_else(none, closest);
        match goal {
            Goal::Error(e) => value(
                "--error",
                e,
                &format!("is out of reach: {nearest}; ask for a larger error"),
            ),
            Goal::Time(t) => value(
                "--time",
                t,
                &format!("is out of reach: {nearest}; ask for a longer time [s]"),
            ),
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_warning_is_known_whatever_its_numbers() {
        let given = ["interface 'a': 156 of 375 unknowns are dependent".to_owned()];
        let same = "interface 'a': 12 of 75 unknowns are dependent".to_owned();
        let other = "interface 'a': its overlap of 2e-3 m is 2.0 elements across".to_owned();
        assert_eq!(new_warnings(&given, vec![same, other.clone()]), [other]);
    }
}
