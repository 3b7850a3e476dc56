//! Integrals of formulas from time zero on. Their bits do not depend on what was asked before, so that no
//! step of a run depends on how earlier ones were found.
//!
//! Time is cut at `2^k (1 + j/16)`, and the integrals up to the cuts are kept.

use super::Formula;
use std::sync::PoisonError;

/// Places in −1 … 1, for both signs, with the weights of Clenshaw and Curtis on 17 points and on every second
/// of them. The ends are among the points: a kink just within an end would be seen by no other point.
const POINTS: [[f64; 3]; 9] = [
    [1.0, 0.003_921_568_627_450_98, 0.015_873_015_873_015_872],
    [0.980_785_280_403_230_4, 0.037_368_702_837_205_61, 0.0],
    [
        0.923_879_532_511_286_7,
        0.075_482_331_543_151_84,
        0.146_218_649_216_018_15,
    ],
    [0.831_469_612_302_545_2, 0.108_905_552_581_890_93, 0.0],
    [
        std::f64::consts::FRAC_1_SQRT_2,
        0.138_956_468_368_233_08,
        0.279_365_079_365_079_4,
    ],
    [0.555_570_233_019_602_3, 0.163_172_664_281_703_3, 0.0],
    [
        0.382_683_432_365_089_84,
        0.181_473_784_236_493_35,
        0.361_717_858_720_489_8,
    ],
    [0.195_090_322_016_128_33, 0.192_513_864_612_925_63, 0.0],
    [0.0, 0.196_410_125_821_890_55, 0.393_650_793_650_793_6],
];
/// Differences at which the two rules agree: relative to the mean of the modulus, and absolute.
const AGREE: [f64; 2] = [1e-14, 1e-15];
/// Most halvings of an interval: nested in each other, and in all.
const DEEPEST: u32 = 50;
const MOST: u32 = 2_000;
/// Bits of a number below its exponent and the four bits that count sixteenths.
const BEHIND: u32 = 48;
/// The first cut \[s\].
const FIRST: f64 = 1.0 / (1_u64 << 63) as f64;

/// `∫_a^b f`.
pub(super) fn integral_between(f: &dyn Fn(f64) -> f64, a: f64, b: f64) -> f64 {
    let mut halvings_left = MOST;
    integral_by_halving(f, [a, b], DEEPEST, &mut halvings_left)
}

fn integral_by_halving(
    f: &dyn Fn(f64) -> f64,
    [a, b]: [f64; 2],
    depth_left: u32,
    halvings_left: &mut u32,
) -> f64 {
    let (middle, half) = (0.5 * (a + b), 0.5 * (b - a));
    let mut values = [0.0; 17];
    let (mut sum, mut gap, mut size) = (0.0, 0.0, 0.0);
    for (k, [x, fine, coarse]) in POINTS.into_iter().enumerate() {
        // The middle has no mirror image.
        let ends: &[(usize, f64)] = if k < 8 { &[(k, -x), (16 - k, x)] } else { &[(k, x)] };
        for (place, x) in ends {
            let value = f(middle + x * half);
            values[*place] = value;
            sum += fine * value;
            gap += (fine - coarse) * value;
            size += fine * value.abs();
        }
    }
    // Times are rounded, and values of the formula change with them.
    let change: f64 = values.windows(2).map(|w| (w[1] - w[0]).abs()).sum();
    let round = 2.0 * f64::EPSILON * change * a.abs().max(b.abs()) / half.abs().max(f64::MIN_POSITIVE);
    let apart = gap.abs() > (AGREE[0] * size).max(AGREE[1]).max(round);
    // Within round-off of the two rules, or after the allowed halvings, the finer rule counts.
    if !apart || depth_left == 0 || *halvings_left == 0 {
        return sum * half;
    }
    *halvings_left -= 1;
    integral_by_halving(f, [a, middle], depth_left - 1, halvings_left)
        + integral_by_halving(f, [middle, b], depth_left - 1, halvings_left)
}

impl Formula {
    /// `∫_0^t f dt` \[s\].
    pub(super) fn integral(&self, t: f64) -> f64 {
        let f = |t: f64| self.value(t);
        // Cuts are numbered by the bits of positive numbers, which ascend with them.
        if t.is_nan() || t < FIRST {
            return integral_between(&f, 0.0, t);
        }
        // Exponent and sixteenths of a time: the number of the cut at or before it.
        let number = |t: f64| (t.to_bits() >> BEHIND) as usize;
        let cut = |k: usize| f64::from_bits((k as u64) << BEHIND);
        let (first, last) = (number(FIRST), number(t));
        // The sums are complete after every push: a poisoned lock does no harm.
        let mut sums = self.sums.lock().unwrap_or_else(PoisonError::into_inner);
        if sums.is_empty() {
            sums.push(integral_between(&f, 0.0, FIRST));
        }
        // A step of a formula or a short pulse is resolved once, in the interval between two cuts that
        // contains it, and counts in all later integrals.
        for k in first + sums.len() - 1..last {
            let next = sums[k - first] + integral_between(&f, cut(k), cut(k + 1));
            sums.push(next);
        }
        sums[last - first] + integral_between(&f, cut(last), t)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A formula and its integral in closed form.
    type Exact = (Formula, fn(f64) -> f64);

    /// Steps, kinks and thousands of periods: values and, as runs take them, differences over a step.
    #[test]
    fn integrals_of_rough_and_fast_formulas_are_smooth_in_time() {
        let (dt, rate) = (1e-8, 2.0 * std::f64::consts::PI * 1e6);
        let formulas: [Exact; 3] = [
            (Formula::new("step", |t| f64::from(u8::from(t >= 1e-4))), |t| {
                (t - 1e-4).max(0.0)
            }),
            (Formula::new("ramp", |t| (t / 1e-4).min(1.0)), |t| {
                let inside = t.min(1e-4);
                0.5 * inside * inside / 1e-4 + (t - 1e-4).max(0.0)
            }),
            (Formula::new("sine", move |t| (rate * t).sin()), |t| {
                let rate = 2.0 * std::f64::consts::PI * 1e6;
                (1.0 - (rate * t).cos()) / rate
            }),
        ];
        for (formula, wanted) in formulas {
            for k in 1..400 {
                let t = 1.3e-3 + 7.1 * dt * f64::from(k);
                let [before, now] = [t - dt, t].map(|t| formula.integral(t));
                assert!((now - wanted(t)).abs() < 1e-16, "{formula:?} at {t:e}: {now:e}");
                let speed = ((now - before) - (wanted(t) - wanted(t - dt))) / dt;
                assert!(speed.abs() < 1e-9, "{formula:?} at {t:e}: speed off by {speed:e}");
            }
        }
    }

    #[test]
    #[allow(clippy::float_cmp, reason = "the same bits")]
    fn integrals_do_not_depend_on_what_was_asked_before() {
        let formula = || Formula::new("wave", |t: f64| (3e4 * t).sin() + 1e3 * t);
        let asked = formula();
        for k in 0..200 {
            let t = 1e-5 * f64::from(k);
            assert_eq!(asked.integral(t), formula().integral(t));
        }
        assert_eq!(asked.integral(2e-4), formula().integral(2e-4));
        // Before time zero, and what is no number.
        assert!((asked.integral(-1e-4) - ((1.0 - 3.0_f64.cos()) / 3e4 + 5e-6)).abs() < 1e-18);
        assert!(
            Formula::new("gap", |t: f64| (1.0 - t).sqrt())
                .integral(2.0)
                .is_nan()
        );
    }
}
