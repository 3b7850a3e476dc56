//! The step of a run and the own steps of its participants.
//!
//! Reflections keep the sum of invariants for any own steps, so that only two things bound them: the
//! critical step of each participant, and the jump of displacements that grows with the number of own steps
//! between two reflections (decision 0029).

use super::TimeStep;
use super::own_steps::Lockstep;
use crate::error::invalid;
use crate::subdomain::{OwnStep, Subdomain};
use crate::{Error, Real, Result};

/// Largest share of its critical step that a chosen step takes of a participant that is not the finest:
/// waves in it are then as exact as its mesh.
const COARSE: f64 = 0.5;
/// Most own steps that are chosen: of five, models of three shipped scenes part by 7 to 15 % of the
/// deformation of their overlap, of four by 2 to 8 % (decision 0029).
const MOST: usize = 4;
/// Most own steps that may be asked for: a step of the run ends, and can be broken off, after all of them.
const LIMIT: usize = 100_000;

/// The step of the run \[s\] and the own steps of each participant in it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Pace<T> {
    pub(super) dt: T,
    pub(super) steps: Vec<usize>,
}

/// A participant's wish and limit.
#[derive(Debug, Clone, Copy)]
struct Wish<T> {
    own: OwnStep<T>,
    critical: T,
}

impl<T: Real> Wish<T> {
    fn is_implicit(&self) -> bool {
        matches!(self.own, OwnStep::Implicit)
    }

    /// Least own steps in a step of the run that are no longer than a share of the critical one.
    fn least(&self, run: T, share: T) -> usize {
        if self.is_implicit() {
            return 1;
        }
        // A step that is a whole multiple up to round-off needs no further one.
        let steps = (run / (share * self.critical)).as_f64() * (1.0 - 1e-9);
        (steps.ceil() as usize).max(1)
    }
}

impl<T: Real> TimeStep<T> {
    /// The step of a run \[s\] and the own steps in it that [`TimeStep::Chosen`] takes for models with
    /// these critical steps \[s\], if no model names its own.
    ///
    /// # Errors
    /// [`Error::InvalidParameter`] for a share that is not between 0 and 1, and without a finite critical
    /// step.
    pub fn chosen(share_of_finest: T, critical: &[T]) -> Result<(T, Vec<usize>)> {
        let wish = |c: &T| Wish {
            own: OwnStep::Same,
            critical: *c,
        };
        let wishes: Vec<_> = critical.iter().map(wish).collect();
        chosen(&wishes, share(share_of_finest)?, &[])
    }
}

/// Finds the step of the run and all own steps.
pub(super) fn choose<T: Real>(
    step: TimeStep<T>,
    critical: &[T],
    subdomains: &[Subdomain<T>],
    lockstep: &[Lockstep],
) -> Result<Pace<T>> {
    for (c, s) in critical.iter().zip(subdomains) {
        if c.as_f64().is_nan() || *c <= T::zero() {
            let what = format!("critical step of model '{}'", s.model().name());
            let rule = "must be a number above zero: its stiffness over its mass has too few digits; look at its material \
                        (a Poisson's ratio next to 0.5 or -1) and at its smallest elements";
            return Err(invalid(&what, c, rule));
        }
    }
    let wishes = critical.iter().zip(subdomains).map(|(c, s)| Wish {
        own: s.step_choice(),
        critical: *c,
    });
    let mut wishes: Vec<_> = wishes.collect();
    for (w, s) in wishes.iter().zip(subdomains) {
        check(w.own, s)?;
    }
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
    together(&mut steps, lockstep);
    refuse_endless(&steps, subdomains)?;
    if !matches!(step, TimeStep::Unchecked(_)) {
        refuse_unstable(dt, &steps, &wishes, subdomains)?;
    }
    Ok(Pace { dt, steps })
}

fn share<T: Real>(f: T) -> Result<T> {
    if f > T::zero() && f < T::one() {
        return Ok(f);
    }
    let rule = "must be above 0 and below 1";
    Err(invalid("fraction of the critical step", f, rule))
}

fn check<T: Real>(own: OwnStep<T>, s: &Subdomain<T>) -> Result<()> {
    let name = s.model().name();
    match own {
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

/// Those that step together take the number of own steps that any of them names; it must be one.
fn agree<T: Real>(wishes: &mut [Wish<T>], subdomains: &[Subdomain<T>], lockstep: &[Lockstep]) -> Result<()> {
    for group in lockstep.iter().filter(|g| g.members.len() > 1) {
        let named = group.members.iter().filter_map(|k| match wishes[*k].own {
            OwnStep::Ratio(m) => Some((*k, m)),
            _ => None,
        });
        let named: Vec<_> = named.collect();
        let Some((first, steps)) = named.first().copied() else {
            continue;
        };
        let name = |k: usize| subdomains[k].model().name();
        if let Some((other, m)) = named.iter().find(|(_, m)| *m != steps) {
            let what = format!("own steps of models '{}' and '{}'", name(first), name(*other));
            let found = format_args!("{steps} and {m}");
            let rule = "must be as many, since an effect acts between the two; name one number, or that of one of them";
            return Err(invalid(&what, found, rule));
        }
        for &k in &group.members {
            if matches!(wishes[k].own, OwnStep::Same) {
                wishes[k].own = OwnStep::Ratio(steps);
            }
        }
    }
    Ok(())
}

/// Longest step of the run of which no own step exceeds its share of the critical one.
fn longest<T: Real>(wishes: &[Wish<T>], share: T) -> Result<T> {
    let of = |w: &Wish<T>| match w.own {
        OwnStep::Same => Some(share * w.critical),
        OwnStep::Ratio(m) => Some(T::of(m as f64) * share * w.critical),
        OwnStep::Fraction(_) | OwnStep::Implicit => None,
    };
    let smallest = |a: Option<T>, b: T| Some(a.map_or(b, |a| a.min(b)));
    if let Some(dt) = wishes.iter().filter_map(of).fold(None, smallest) {
        return Ok(dt);
    }
    // All of them find their own number: the step of the run is the largest of their steps.
    let own = wishes.iter().filter_map(|w| match w.own {
        OwnStep::Fraction(f) => Some(f * w.critical),
        _ => None,
    });
    let largest = |a: Option<T>, b: T| Some(a.map_or(b, |a| a.max(b)));
    own.fold(None, largest)
        .filter(|dt| dt.is_finite())
        .ok_or_else(|| {
            let rule = "no model has a critical step that would bound it; give the step in seconds";
            invalid("fraction of the critical step", share, rule)
        })
}

/// Own steps in a step of the run; `free` finds those of participants that name none.
fn own_steps<T: Real>(wishes: &[Wish<T>], run: T, free: impl Fn(&Wish<T>) -> usize) -> Vec<usize> {
    let of = |w: &Wish<T>| match w.own {
        OwnStep::Same => free(w),
        OwnStep::Ratio(m) => m,
        OwnStep::Fraction(f) => w.least(run, f),
        OwnStep::Implicit => 1,
    };
    wishes.iter().map(of).collect()
}

/// The finest participant at `finest` of its critical step, and as many such steps in one of the run as
/// those with the largest critical step allow.
fn chosen<T: Real>(wishes: &[Wish<T>], finest: T, lockstep: &[Lockstep]) -> Result<(T, Vec<usize>)> {
    let free = || wishes.iter().filter(|w| matches!(w.own, OwnStep::Same));
    let named = wishes.iter().any(|w| matches!(w.own, OwnStep::Ratio(_)));
    let smallest = free()
        .map(|w| w.critical)
        .fold(None, |a: Option<T>, c| Some(a.map_or(c, |a| a.min(c))));
    let Some(smallest) = smallest.filter(|c| !named && c.is_finite()) else {
        let bound: Vec<_> = wishes
            .iter()
            .copied()
            .filter(|w| !named || !matches!(w.own, OwnStep::Same))
            .collect();
        let dt = longest(&bound, finest)?;
        return Ok((dt, own_steps(wishes, dt, |w| w.least(dt, finest))));
    };
    let own = smallest * finest;
    // Who asks for less than that asks it of all.
    let coarse = T::of(COARSE).min(finest);
    let room_for = wishes
        .iter()
        .filter(|w| matches!(w.own, OwnStep::Same | OwnStep::Fraction(_)));
    let top = room_for.fold(T::zero(), |a, w| a.max(w.critical));
    let room = if wishes.iter().any(Wish::is_implicit) {
        MOST as f64
    } else {
        (coarse * top / own).as_f64() * (1.0 + 1e-9)
    };
    for most in (1..=MOST).rev().filter(|m| *m as f64 <= room || *m == 1) {
        let dt = own * T::of(most as f64);
        let mut steps = own_steps(wishes, dt, |w| w.least(dt, coarse).min(most));
        together(&mut steps, lockstep);
        if most == 1 || steps.iter().any(|m| *m < most) {
            return Ok((dt, steps));
        }
    }
    Ok((own, own_steps(wishes, own, |_| 1)))
}

/// Those that step together make as many steps as the one that needs most.
fn together(steps: &mut [usize], lockstep: &[Lockstep]) {
    for group in lockstep {
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
    let all = || {
        wishes
            .iter()
            .zip(steps)
            .zip(subdomains)
            .filter(|((w, _), _)| !w.is_implicit())
    };
    let excess = |w: &Wish<T>, m: usize| (run / T::of(m as f64)) / w.critical;
    let worst = all().reduce(|a, b| {
        let [x, y] = [a, b].map(|((w, m), _)| excess(w, *m));
        if y > x { b } else { a }
    });
    let Some(((w, m), s)) = worst else {
        return Ok(());
    };
    let dt = run / T::of(*m as f64);
    // Own steps are quotients: their last digit is no excess.
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

    /// Critical steps that are whole parts of the step of the run but for round-off.
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
