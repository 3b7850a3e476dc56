//! Prescribed motions that contradict each other where two models are tied.

use crate::field::ShapeRow;
use crate::interface::{Interface, coupled_nodes};
use crate::subdomain::PrescribedMotion;
use crate::subdomain::Subdomain;
use crate::time::TimeFunction;
use crate::{Error, Real, Result};

/// Least sum of the shape functions of prescribed nodes for which a field counts as prescribed at a point. It
/// is below one because a particle's centre lies one radius inside the face that is held.
const PRESCRIBED: f64 = 0.75;
/// Largest difference of two motions, relative to the larger one, for which they count as equal.
const SAME: f64 = 1e-6;
/// Number of equal parts of a run at whose ends motions are compared.
const PARTS: u32 = 64;

/// Times over which motions are compared \[s\].
#[derive(Debug, Clone, Copy)]
pub(super) struct Span {
    pub(super) start: f64,
    /// End of the run, if known.
    pub(super) end: Option<f64>,
}

/// Refuses an interface whose two models have different prescribed motions at one place within a span of
/// time: the velocity jump could not vanish there.
///
/// # Errors
/// [`Error::OpposedMotions`].
pub(super) fn check<T: Real>(
    interface: &Interface<T>,
    subdomains: &[Subdomain<T>],
    span: Span,
) -> Result<()> {
    for m in 0..2 {
        let [subdomain, partner] = [m, 1 - m].map(|k| &subdomains[interface.sides[k]]);
        if subdomain.supports().is_empty() || partner.supports().is_empty() {
            continue;
        }
        let (motions, partner_motions) = (by_unknown(subdomain), by_unknown(partner));
        let count = interface.components();
        let mut row = ShapeRow::default();
        for node in coupled_nodes(&interface.coupling[m], count) {
            let point = subdomain.model().nodes()[node];
            for c in 0..count {
                let Some(motion) = motions[node * count + c] else {
                    continue;
                };
                // A node outside of the other model contradicts nothing.
                if partner.field().shape_at(&point, false, &mut row).is_err() {
                    break;
                }
                let held = row.nodes.iter().zip(&row.values);
                let held: Vec<_> = held
                    .filter_map(|(n, v)| Some((partner_motions[n * count + c]?, v.as_f64())))
                    .collect();
                if let Some((time, gap)) = opposed(motion, &held, span) {
                    return Err(Error::OpposedMotions {
                        interface: interface.report().name.clone(),
                        models: format!("'{}' and '{}'", subdomain.model().name(), partner.model().name()),
                        point: Box::new([0, 1, 2].map(|k| point[k].as_f64())),
                        component: ['x', 'y', 'z'][c],
                        gap,
                        time,
                    });
                }
            }
        }
    }
    Ok(())
}

/// Returns a warning if one model of an interface is supported in the overlap and the other is not, so that
/// the multipliers alone hold the other.
pub(super) fn one_sided<T: Real>(interface: &Interface<T>, subdomains: &[Subdomain<T>]) -> Option<String> {
    let sides = interface.sides.map(|k| &subdomains[k]);
    // The supports of an external solver are not known.
    if sides.iter().any(|s| s.is_external()) {
        return None;
    }
    let d = interface.components();
    let held = [0, 1].map(|m| {
        let motions = by_unknown(sides[m]);
        let nodes = coupled_nodes(&interface.coupling[m], d);
        let supported = |c: usize| nodes.iter().filter(|k| motions[*k * d + c].is_some()).count();
        (0..d).map(supported).collect::<Vec<_>>()
    });
    for (with, without) in [(0, 1), (1, 0)] {
        let only = (0..d).filter(|c| held[with][*c] > 0 && held[without][*c] == 0);
        let only: Vec<_> = only.collect();
        let Some(nodes) = only.iter().map(|c| held[with][*c]).max() else {
            continue;
        };
        let components: Vec<_> = only.iter().map(|c| ["x", "y", "z"][*c]).collect();
        let [name, other] = [with, without].map(|m| sides[m].model().name());
        return Some(format!(
            "'{name}' has a support on {nodes} of its nodes in the overlap (along {}), '{other}' has none there: the multipliers alone \
             hold '{other}', in the mean of their elements; give '{other}' the same support, or end it before the overlap",
            components.join(", ")
        ));
    }
    None
}

/// Returns the prescribed motion of every unknown, if it has one.
fn by_unknown<T: Real>(s: &Subdomain<T>) -> Vec<Option<&PrescribedMotion<T>>> {
    let mut out = vec![None; s.model().layout().dofs()];
    for motion in s.supports() {
        motion.dofs.iter().for_each(|&d| out[d] = Some(motion));
    }
    out
}

/// Returns the time \[s\] and the size \[m\] of the largest relative difference between a motion and the
/// prescribed part of a field; `None` if the two agree.
///
/// The difference is relative to the larger of the two motions: to its maximum within the run if the end of
/// the run is known, otherwise to the larger of its value at that time and its amplitude.
fn opposed<T: Real>(
    motion: &PrescribedMotion<T>,
    held: &[(&PrescribedMotion<T>, f64)],
    span: Span,
) -> Option<(f64, f64)> {
    let share: f64 = held.iter().map(|h| h.1).sum();
    if share < PRESCRIBED {
        return None;
    }
    let motions = || held.iter().map(|h| h.0).chain([motion]);
    // In double precision whatever `T` is: equal motions may be large.
    let value = |m: &PrescribedMotion<T>, t: f64| m.amplitude.as_f64() * m.time.at_wide(t);
    // The prescribed part counts as the whole, so it is divided by its share.
    let gap =
        |t: f64| (value(motion, t) - held.iter().map(|(m, v)| v * value(m, t)).sum::<f64>() / share).abs();
    let size = |t: f64| motions().fold(0.0, |s: f64, m| s.max(value(m, t).abs()));
    let times: Vec<f64> = motions().flat_map(|m| instants(&m.time, span)).collect();
    let most = match span.end {
        Some(_) => times.iter().fold(0.0, |s: f64, t| s.max(size(*t))),
        None => motions().fold(0.0, |s: f64, m| s.max(m.amplitude.as_f64().abs())),
    };
    let differences = times.iter().map(|&t| (t, gap(t), gap(t) / most.max(size(t))));
    let worst = differences.fold((0.0, 0.0, 0.0), |a, b| if b.2 > a.2 { b } else { a });
    (worst.2 > SAME).then_some((worst.0, worst.1))
}

/// Returns the instants of a span at which two functions of time are compared.
fn instants<T: Real>(f: &TimeFunction<T>, span: Span) -> Vec<f64> {
    let mut out = kinks(f);
    match span.end {
        // Without an end, formulas are compared at 49 instants from 1 µs to 1e6 s.
        None if is_formula(f) => out.extend((-24..=24).map(|k| 10.0_f64.powf(f64::from(k) / 4.0))),
        None => {}
        Some(end) => {
            let whole = end - span.start;
            out.extend((0..=PARTS).map(|k| span.start + whole * f64::from(k) / f64::from(PARTS)));
            out.retain(|t| (span.start..=end).contains(t));
        }
    }
    out
}

fn is_formula<T: Real>(f: &TimeFunction<T>) -> bool {
    match f {
        TimeFunction::Integral(inner) => is_formula(inner),
        f => matches!(f, TimeFunction::Formula(_)),
    }
}

/// Returns instants at which values identify a function of its kind, such as the rows of a table; empty for a
/// formula.
fn kinks<T: Real>(f: &TimeFunction<T>) -> Vec<f64> {
    match f {
        TimeFunction::Step => vec![0.0],
        TimeFunction::Ramp { duration } | TimeFunction::SmoothPulse { duration } => {
            // Quarters tell a ramp from a smooth pulse.
            [0.25, 0.5, 0.75, 1.0].map(|s| s * duration.as_f64()).into()
        }
        TimeFunction::Integral(inner) => kinks(inner),
        TimeFunction::Formula(_) => Vec::new(),
        TimeFunction::Table(rows) => rows.iter().map(|r| r.0.as_f64()).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::Formula;

    fn motion(amplitude: f64, time: TimeFunction<f64>) -> PrescribedMotion<f64> {
        PrescribedMotion {
            dofs: vec![0],
            amplitude,
            time,
        }
    }

    fn formula(text: &str, value: fn(f64) -> f64) -> TimeFunction<f64> {
        TimeFunction::Formula(Formula::new(text, value))
    }

    /// Equal motions that grow with time must not be opposed by the round-off at 1e6 s (issue 26, D.4).
    #[test]
    fn equal_motions_are_not_opposed_however_fast_they_grow() {
        let square = || formula("(t/30e-6)^2", |t| (t / 30e-6).powi(2));
        let speed = || TimeFunction::Integral(Box::new(square()));
        let table = || TimeFunction::Table(vec![(0.0, 0.0), (1e-4, 1.0)]);
        let known = Span {
            start: 0.0,
            end: Some(1e-4),
        };
        let unknown = Span { end: None, ..known };
        // A row of shape functions whose sum is one up to round-off.
        let shares = [0.1, 0.2, 0.3, 0.4];
        let worst_gap = |a: TimeFunction<f64>, b: TimeFunction<f64>, size: f64, span: Span| {
            let partner = motion(size * 1e-3, b);
            let held: Vec<_> = shares.iter().map(|s| (&partner, *s)).collect();
            opposed(&motion(1e-3, a), &held, span)
        };
        for span in [known, unknown] {
            assert_eq!(worst_gap(square(), square(), 1.0, span), None);
            assert_eq!(worst_gap(speed(), speed(), 1.0, span), None);
            let (time, gap) = worst_gap(square(), square(), -1.0, span).expect("opposed");
            assert!(time > 0.0 && gap > 0.0, "{time} {gap}");
            assert!(worst_gap(square(), square(), 1.0 + 1e-5, span).is_some());
            assert!(worst_gap(square(), table(), 1.0, span).is_some());
        }
        // A line and a table that ends with the run differ after it only.
        let line = || formula("t/1e-4", |t| t / 1e-4);
        assert_eq!(worst_gap(line(), table(), 1.0, known), None);
        assert!(worst_gap(line(), table(), 1.0, unknown).is_some());
        // Two pulses of a tenth of a microsecond, which are over before the first of the fixed instants.
        let pulse = |sign: f64| {
            let value = move |t: f64| sign * (1.0 - t / 1e-7).max(0.0) * (t / 1e-7);
            TimeFunction::Formula(Formula::new("pulse", value))
        };
        let short = Span {
            start: 0.0,
            end: Some(2e-7),
        };
        assert!(worst_gap(pulse(1.0), pulse(-1.0), 1.0, short).is_some());
    }
}
