//! Prescribed motions that contradict each other where two models are tied.

use crate::field::ShapeRow;
use crate::interface::{Interface, coupled_nodes};
use crate::subdomain::PrescribedMotion;
use crate::subdomain::Subdomain;
use crate::time::TimeFunction;
use crate::{Error, Real, Result};

/// Share of a field at a point that must be prescribed for it to count as prescribed there: a particle's centre lies a
/// radius inside the face that is held.
const PRESCRIBED: f64 = 0.75;
/// Difference of two motions over the larger amplitude above which they are opposed.
const SAME: f64 = 1e-6;

/// Refuses an interface whose two models are moved by prescribed motions that differ at one place: no velocity jump can
/// vanish there.
///
/// # Errors
/// [`Error::OpposedMotions`].
pub(super) fn check<T: Real>(interface: &Interface<T>, subdomains: &[Subdomain<T>]) -> Result<()> {
    for m in 0..2 {
        let [here, there] = [m, 1 - m].map(|k| &subdomains[interface.sides[k]]);
        if here.supports().is_empty() || there.supports().is_empty() {
            continue;
        }
        let (mine, other) = (by_unknown(here), by_unknown(there));
        let count = interface.components();
        let mut row = ShapeRow::default();
        for node in coupled_nodes(&interface.coupling[m], count) {
            let point = here.model().nodes()[node];
            for c in 0..count {
                let Some(own) = mine[node * count + c] else {
                    continue;
                };
                if there.field().shape_at(&point, false, &mut row).is_err() {
                    break;
                }
                let held = row.nodes.iter().zip(&row.values);
                let held: Vec<_> = held
                    .filter_map(|(n, v)| Some((other[n * count + c]?, v.as_f64())))
                    .collect();
                if let Some((time, gap)) = opposed(own, &held) {
                    return Err(Error::OpposedMotions {
                        interface: interface.report().name.clone(),
                        models: format!("'{}' and '{}'", here.model().name(), there.model().name()),
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

/// Says where one model of an interface is supported in the overlap and the other is not, so that the multipliers alone hold that
/// one.
pub(super) fn one_sided<T: Real>(interface: &Interface<T>, subdomains: &[Subdomain<T>]) -> Option<String> {
    let sides = interface.sides.map(|k| &subdomains[k]);
    // What a solver of its own holds is not known.
    if sides.iter().any(|s| s.is_guest()) {
        return None;
    }
    let d = interface.components();
    let held = [0, 1].map(|m| {
        let motions = by_unknown(sides[m]);
        let nodes = coupled_nodes(&interface.coupling[m], d);
        let of = |c: usize| nodes.iter().filter(|k| motions[*k * d + c].is_some()).count();
        (0..d).map(of).collect::<Vec<_>>()
    });
    for (here, there) in [(0, 1), (1, 0)] {
        let only = (0..d).filter(|c| held[here][*c] > 0 && held[there][*c] == 0);
        let only: Vec<_> = only.collect();
        let Some(nodes) = only.iter().map(|c| held[here][*c]).max() else {
            continue;
        };
        let components: Vec<_> = only.iter().map(|c| ["x", "y", "z"][*c]).collect();
        let [name, other] = [here, there].map(|m| sides[m].model().name());
        return Some(format!(
            "'{name}' has a support on {nodes} of its nodes in the overlap (along {}), '{other}' has none there: the multipliers alone \
             hold '{other}', in the mean of their elements; give '{other}' the same support, or end it before the overlap",
            components.join(", ")
        ));
    }
    None
}

/// The motion of every unknown that has one.
fn by_unknown<T: Real>(s: &Subdomain<T>) -> Vec<Option<&PrescribedMotion<T>>> {
    let mut out = vec![None; s.model().layout().dofs()];
    for motion in s.supports() {
        motion.dofs.iter().for_each(|&d| out[d] = Some(motion));
    }
    out
}

/// When \[s\] and by how much \[m\] a motion differs most from the prescribed share of a field.
fn opposed<T: Real>(own: &PrescribedMotion<T>, held: &[(&PrescribedMotion<T>, f64)]) -> Option<(f64, f64)> {
    let share: f64 = held.iter().map(|h| h.1).sum();
    if share < PRESCRIBED {
        return None;
    }
    let motions = || held.iter().map(|h| h.0).chain([own]);
    let scale = motions().fold(0.0, |s: f64, m| s.max(m.amplitude.as_f64().abs()));
    let at = |m: &PrescribedMotion<T>, t: f64| m.amplitude.as_f64() * m.time.at_wide(t);
    let gap = |t: f64| (at(own, t) - held.iter().map(|(m, v)| v * at(m, t)).sum::<f64>() / share).abs();
    let times = motions().flat_map(|m| instants(&m.time));
    let worst = times
        .map(|t| (t, gap(t)))
        .fold((0.0, 0.0), |a, b| if b.1 > a.1 { b } else { a });
    (worst.1 > SAME * scale).then_some(worst)
}

/// Instants at which two different functions of time can be told apart.
fn instants<T: Real>(f: &TimeFunction<T>) -> Vec<f64> {
    match f {
        TimeFunction::Step => vec![0.0],
        TimeFunction::Ramp { duration } | TimeFunction::SmoothPulse { duration } => {
            [0.25, 0.5, 0.75, 1.0].map(|s| s * duration.as_f64()).into()
        }
        TimeFunction::Integral(of) => instants(of),
        // Any time will tell two formulas apart, unless they are the same there.
        TimeFunction::Formula(_) => (-24..=24).map(|k| 10.0_f64.powf(f64::from(k) / 4.0)).collect(),
        TimeFunction::Table(rows) => rows.iter().map(|r| r.0.as_f64()).collect(),
    }
}
