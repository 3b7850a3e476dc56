//! Choice of the macro step and of the own steps of the participants.
//!
//! Reflections keep the sum of the invariants for any own steps. Only two things limit the steps: the
//! critical step of each participant, and the displacement jump, which grows with the number of own steps
//! between two reflections (decision 0029).

use super::TimeStep;
use super::own_steps::Lockstep;
use crate::error::invalid;
use crate::subdomain::{OwnStep, Subdomain};
use crate::{Error, Real, Result};

/// Largest share of its critical step that [`TimeStep::Chosen`] gives to a participant other than the finest:
/// waves in it are then as exact as its mesh.
const COARSE: f64 = 0.5;
/// Largest number of own steps that is chosen. Decision 0029: with five, the models of three shipped scenes
/// part by 7 to 15 % of the deformation of their overlap, and with four by 2 to 8 %.
const MOST: usize = 4;
/// Largest number of own steps that may be asked for. A macro step ends, and a run can be interrupted, only
/// after all own steps.
const LIMIT: usize = 100_000;

/// Macro step \[s\] and the number of own steps of each participant in it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Pace<T> {
    pub(super) dt: T,
    pub(super) steps: Vec<usize>,
}

/// Requested own step and critical step \[s\] of a participant.
#[derive(Debug, Clone, Copy)]
struct Wish<T> {
    request: OwnStep<T>,
    critical: T,
}

impl<T: Real> Wish<T> {
    fn is_implicit(&self) -> bool {
        matches!(self.request, OwnStep::Implicit)
    }

    /// Returns the least number of own steps in a macro step `run` \[s\] for which none exceeds `share` of
    /// the critical step.
    fn least(&self, run: T, share: T) -> usize {
        if self.is_implicit() {
            return 1;
        }
        // Round-off of a whole multiple must not add a step.
        let steps = (run / (share * self.critical)).as_f64() * (1.0 - 1e-9);
        (steps.ceil() as usize).max(1)
    }
}

impl<T: Real> TimeStep<T> {
    /// Returns the macro step \[s\] and the own steps in it that [`TimeStep::Chosen`] gives to models with
    /// these critical steps \[s\], if no model asks for a number of its own.
    ///
    /// # Errors
    /// [`Error::InvalidParameter`] for a share that is not between 0 and 1, or if no critical step is finite.
    pub fn chosen(share_of_finest: T, critical: &[T]) -> Result<(T, Vec<usize>)> {
        let wish = |c: &T| Wish {
            request: OwnStep::Same,
            critical: *c,
        };
        let wishes: Vec<_> = critical.iter().map(wish).collect();
        chosen(&wishes, share(share_of_finest)?, &[])
    }
}

/// Chooses the macro step and all own steps, and refuses unstable ones unless `step` says otherwise.
pub(super) fn choose<T: Real>(
    step: TimeStep<T>,
    critical: &[T],
    subdomains: &[Subdomain<T>],
    lockstep: &[Lockstep],
) -> Result<Pace<T>> {
    for (c, s) in critical.iter().zip(subdomains) {
        // Not `< 0` alone: a NaN would pass every comparison below.
        if c.as_f64().is_nan() || *c <= T::zero() {
            let what = format!("critical step of model '{}'", s.model().name());
            let rule = "must be a number above zero: its stiffness over its mass has too few digits; look at its material \
                        (a Poisson's ratio next to 0.5 or -1) and at its smallest elements";
            return Err(invalid(&what, c, rule));
        }
    }
    let wishes = critical.iter().zip(subdomains).map(|(c, s)| Wish {
        request: s.step_choice(),
        critical: *c,
    });
    let mut wishes: Vec<_> = wishes.collect();
    for (w, s) in wishes.iter().zip(subdomains) {
        check(w.request, s)?;
    }
    // Lockstep groups first: the choices below must see the same number for all members.
    agree(&mut wishes, subdomains, lockstep)?;
    let (dt, mut steps) = match step {
        TimeStep::Seconds(dt) | TimeStep::Unchecked(dt) => {
            if !dt.is_finite() || dt <= T::zero() {
                return Err(invalid("time step", dt, "must be positive and finite"));
            }
            (dt, own_steps(&wishes, dt, |_| 1))
        }
        TimeStep::Fraction(f) => {
            let dt = longest(&wishes, share(f)?)?;
            (dt, own_steps(&wishes, dt, |_| 1))
        }
        TimeStep::Chosen(f) => chosen(&wishes, share(f)?, lockstep)?,
    };
    equalise_steps(&mut steps, lockstep);
    refuse_endless(&steps, subdomains)?;
    if !matches!(step, TimeStep::Unchecked(_)) {
        refuse_unstable(dt, &steps, &wishes, subdomains)?;
    }
    Ok(Pace { dt, steps })
}

/// Longest own step \[s\] of a participant that follows from the user's choices alone, if they name one.
pub(super) fn asked<T: Real>(step: TimeStep<T>, own: OwnStep<T>) -> Option<T> {
    match (step, own) {
        (TimeStep::Seconds(dt), OwnStep::Same) => Some(dt),
        (TimeStep::Seconds(dt), OwnStep::Ratio(m)) => Some(dt / T::of(m.max(1) as f64)),
        // A share of the critical step needs that step itself.
        _ => None,
    }
}

fn share<T: Real>(f: T) -> Result<T> {
    if f > T::zero() && f < T::one() {
        return Ok(f);
    }
    let rule = "must be above 0 and below 1";
    Err(invalid("fraction of the critical step", f, rule))
}

fn check<T: Real>(step: OwnStep<T>, s: &Subdomain<T>) -> Result<()> {
    let name = s.model().name();
    match step {
        OwnStep::Ratio(0) => {
            let what = format!("own steps of model '{name}'");
            Err(invalid(&what, 0, "must be at least 1 in a step of the run"))
        }
        OwnStep::Fraction(f) if !(f > T::zero() && f <= T::one()) => {
            let what = format!("own step of model '{name}'");
            let rule = "must be above 0 and at most 1, in units of its critical step";
            Err(invalid(&what, f, rule))
        }
        _ => Ok(()),
    }
}

/// Gives all members of a lockstep group the number of own steps that any of them names; refuses different
/// numbers.
fn agree<T: Real>(wishes: &mut [Wish<T>], subdomains: &[Subdomain<T>], lockstep: &[Lockstep]) -> Result<()> {
    for group in lockstep.iter().filter(|g| g.members.len() > 1) {
        let named = group.members.iter().filter_map(|k| match wishes[*k].request {
            OwnStep::Ratio(m) => Some((*k, m)),
            _ => None,
        });
        let named: Vec<_> = named.collect();
        let Some((first, steps)) = named.first().copied() else {
            continue;
        };
        let name = |k: usize| subdomains[k].model().name();
        if let Some((second, m)) = named.iter().find(|(_, m)| *m != steps) {
            let what = format!("own steps of models '{}' and '{}'", name(first), name(*second));
            let numbers = format_args!("{steps} and {m}");
            let rule = "must be as many, since effects act between the two or between each and a third; name one number, or that of one of them";
            return Err(invalid(&what, numbers, rule));
        }
        // Only members that named nothing: fractions stay, and the group takes the largest number in the end.
        for &k in &group.members {
            if matches!(wishes[k].request, OwnStep::Same) {
                wishes[k].request = OwnStep::Ratio(steps);
            }
        }
    }
    Ok(())
}

/// Returns the longest macro step \[s\] for which no own step exceeds `share` of its critical step.
fn longest<T: Real>(wishes: &[Wish<T>], share: T) -> Result<T> {
    let longest_run = |w: &Wish<T>| match w.request {
        OwnStep::Same => Some(share * w.critical),
        OwnStep::Ratio(m) => Some(T::of(m as f64) * share * w.critical),
        OwnStep::Fraction(_) | OwnStep::Implicit => None,
    };
    // The macro step must suit the most demanding participant.
    let smallest = |a: Option<T>, b: T| Some(a.map_or(b, |a| a.min(b)));
    if let Some(dt) = wishes.iter().filter_map(longest_run).fold(None, smallest) {
        return Ok(dt);
    }
    // All participants adapt their number of steps, so the longest own step is the macro step.
    let lengths = wishes.iter().filter_map(|w| match w.request {
        OwnStep::Fraction(f) => Some(f * w.critical),
        _ => None,
    });
    let largest = |a: Option<T>, b: T| Some(a.map_or(b, |a| a.max(b)));
    lengths
        .fold(None, largest)
        .filter(|dt| dt.is_finite())
        .ok_or_else(|| {
            let rule = "no model has a critical step that would bound it; give the step in seconds";
            invalid("fraction of the critical step", share, rule)
        })
}

/// Returns the own steps in a macro step `run` \[s\]; `free` gives the number for participants with
/// [`OwnStep::Same`].
fn own_steps<T: Real>(wishes: &[Wish<T>], run: T, free: impl Fn(&Wish<T>) -> usize) -> Vec<usize> {
    let steps = |w: &Wish<T>| match w.request {
        OwnStep::Same => free(w),
        OwnStep::Ratio(m) => m,
        OwnStep::Fraction(f) => w.least(run, f),
        OwnStep::Implicit => 1,
    };
    wishes.iter().map(steps).collect()
}

/// Puts the finest participant at `finest` of its critical step and takes as many of these steps in a macro
/// step as the largest critical step has room for.
fn chosen<T: Real>(wishes: &[Wish<T>], finest: T, lockstep: &[Lockstep]) -> Result<(T, Vec<usize>)> {
    let free = || wishes.iter().filter(|w| matches!(w.request, OwnStep::Same));
    let named = wishes.iter().any(|w| matches!(w.request, OwnStep::Ratio(_)));
    let smallest = free()
        .map(|w| w.critical)
        .fold(None, |a: Option<T>, c| Some(a.map_or(c, |a| a.min(c))));
    let Some(smallest) = smallest.filter(|c| !named && c.is_finite()) else {
        // Models that name a number of own steps bound the macro step; the others adapt to it.
        let bound: Vec<_> = wishes
            .iter()
            .copied()
            .filter(|w| !named || !matches!(w.request, OwnStep::Same))
            .collect();
        let dt = longest(&bound, finest)?;
        return Ok((dt, own_steps(wishes, dt, |w| w.least(dt, finest))));
    };
    let finest_step = smallest * finest;
    // A share below `COARSE` applies to the coarse participants too.
    let coarse = T::of(COARSE).min(finest);
    let room_for = wishes
        .iter()
        .filter(|w| matches!(w.request, OwnStep::Same | OwnStep::Fraction(_)));
    let top = room_for.fold(T::zero(), |a, w| a.max(w.critical));
    // An implicit participant takes any macro step.
    let room = if wishes.iter().any(Wish::is_implicit) {
        MOST as f64
    } else {
        // Round-off of an exact multiple must not cost a step.
        (coarse * top / finest_step).as_f64() * (1.0 + 1e-9)
    };
    // If everybody makes `most` own steps, the longer macro step saves nothing: try a shorter one.
    for most in (1..=MOST).rev().filter(|m| *m as f64 <= room || *m == 1) {
        let dt = finest_step * T::of(most as f64);
        let mut steps = own_steps(wishes, dt, |w| w.least(dt, coarse).min(most));
        equalise_steps(&mut steps, lockstep);
        if most == 1 || steps.iter().any(|m| *m < most) {
            return Ok((dt, steps));
        }
    }
    Ok((finest_step, own_steps(wishes, finest_step, |_| 1)))
}

/// Gives all members of a lockstep group the largest number of own steps among them.
fn equalise_steps(steps: &mut [usize], lockstep: &[Lockstep]) {
    for group in lockstep {
        // The largest number: every member is then stable.
        let most = group.members.iter().map(|k| steps[*k]).max().unwrap_or(1);
        group.members.iter().for_each(|k| steps[*k] = most);
    }
}

fn refuse_endless<T: Real>(steps: &[usize], subdomains: &[Subdomain<T>]) -> Result<()> {
    let Some((m, s)) = steps.iter().zip(subdomains).find(|(m, _)| **m > LIMIT) else {
        return Ok(());
    };
    let what = format!("own steps of model '{}'", s.model().name());
    let rule =
        "must be at most 100000 in a step of the run; take shorter steps of the run, or longer own ones";
    Err(invalid(&what, m, rule))
}

fn refuse_unstable<T: Real>(
    run: T,
    steps: &[usize],
    wishes: &[Wish<T>],
    subdomains: &[Subdomain<T>],
) -> Result<()> {
    let explicit = || {
        wishes
            .iter()
            .zip(steps)
            .zip(subdomains)
            .filter(|((w, _), _)| !w.is_implicit())
    };
    let excess = |w: &Wish<T>, m: usize| (run / T::of(m as f64)) / w.critical;
    // The worst model is named: its step is what the user must change.
    let worst = explicit().reduce(|a, b| {
        let [x, y] = [a, b].map(|((w, m), _)| excess(w, *m));
        if y > x { b } else { a }
    });
    let Some(((w, m), s)) = worst else {
        return Ok(());
    };
    let dt = run / T::of(*m as f64);
    // Own steps are quotients: an excess in their last digits is round-off.
    if dt <= w.critical * (T::one() + T::epsilon() * T::of(8.0)) {
        return Ok(());
    }
    Err(Error::UnstableStep {
        dt: dt.as_f64(),
        critical: w.critical.as_f64(),
        model: s.model().name().to_owned(),
        steps: *m,
        longest: (w.critical * T::of(*m as f64)).as_f64(),
        needed: w.least(run, T::one()),
    })
}

#[cfg(test)]
mod tests {
    use super::TimeStep;

    /// Critical steps that divide the macro step up to round-off need no further own step.
    #[test]
    fn round_off_asks_for_no_further_own_step() {
        for k in 1..=60 {
            for share in [0.1, 0.2, 0.3, 0.4, 0.5] {
                let c = 0.07 * f64::from(k);
                let chosen = |critical: &[f64]| TimeStep::chosen(share, critical).unwrap().1;
                assert_eq!(chosen(&[c, 1.5 * c, 3.0 * c]), [3, 2, 1], "{c}, {share}");
                let [third, half, whole] = [4.0 * c / 3.0, 2.0 * c, 4.0 * c];
                assert_eq!(chosen(&[c, third, half, whole]), [4, 3, 2, 1], "{c}, {share}");
            }
        }
    }
}
