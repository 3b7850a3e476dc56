//! Frequencies of a probe: Hann window, fast Fourier transform, parabolic interpolation of the peaks.

use realfft::RealFftPlanner;
use std::f64::consts::PI;

/// Fewest samples from which frequencies are read.
const FEWEST: usize = 32;
/// Peaks below this share of the largest amplitude are side lobes or noise (a Hann window's own are at 0.027).
const FLOOR: f64 = 0.05;
/// Most peaks that are listed.
const MOST: usize = 12;

/// Frequencies of the peaks \[Hz\], ascending, from samples `step` \[s\] apart.
pub(crate) fn frequencies(samples: &[f64], step: f64) -> Vec<f64> {
    let n = samples.len();
    if n < FEWEST || step <= 0.0 {
        return Vec::new();
    }
    let mean = samples.iter().sum::<f64>() / n as f64;
    let window = |k: usize| 0.5 - 0.5 * (2.0 * PI * k as f64 / n as f64).cos();
    // Padded to twice the length: the parabola then errs by less than a hundredth of a bin.
    let size = 2 * n.next_power_of_two();
    let mut input = vec![0.0; size];
    for (k, (x, s)) in input.iter_mut().zip(samples).enumerate() {
        *x = (s - mean) * window(k);
    }
    let transform = RealFftPlanner::<f64>::new().plan_fft_forward(size);
    let mut output = transform.make_output_vec();
    if transform.process(&mut input, &mut output).is_err() {
        return Vec::new();
    }
    let power: Vec<f64> = output.iter().map(|c| c.norm_sqr()).collect();
    let top = power.iter().copied().fold(0.0, f64::max);
    if top <= f64::MIN_POSITIVE {
        return Vec::new();
    }
    // Below two periods in the window, a slope looks like a frequency.
    let first = (2 * size).div_ceil(n).max(1);
    let mut peaks: Vec<(f64, f64)> = Vec::new();
    for k in first..power.len() - 1 {
        let (a, b, c) = (power[k - 1], power[k], power[k + 1]);
        if b > a && b >= c && b > top * FLOOR * FLOOR {
            let tiny = top * 1e-30;
            let (a, b, c) = ((a + tiny).ln(), (b + tiny).ln(), (c + tiny).ln());
            let bend = a - 2.0 * b + c;
            let shift = if bend < 0.0 { 0.5 * (a - c) / bend } else { 0.0 };
            peaks.push((power[k], (k as f64 + shift) / (size as f64 * step)));
        }
    }
    peaks.sort_by(|a, b| b.0.total_cmp(&a.0));
    peaks.truncate(MOST);
    let mut found: Vec<f64> = peaks.into_iter().map(|p| p.1).collect();
    found.sort_by(f64::total_cmp);
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_tones_to_a_thousandth() {
        let dt = 1e-4;
        let wave = |f: f64, t: f64| (2.0 * PI * f * t).sin();
        let samples: Vec<f64> = (0..3000)
            .map(|k| 1.0 + wave(123.4, k as f64 * dt) + 0.3 * wave(456.7, k as f64 * dt))
            .collect();
        let found = frequencies(&samples, dt);
        assert_eq!(found.len(), 2, "{found:?}");
        assert!((found[0] / 123.4 - 1.0).abs() < 1e-3 && (found[1] / 456.7 - 1.0).abs() < 1e-3);
    }

    #[test]
    fn rest_and_short_series_have_none() {
        assert!(frequencies(&[0.0; 100], 1.0).is_empty());
        assert!(frequencies(&[1.0; 100], 1.0).is_empty());
        assert!(frequencies(&[0.0, 1.0, 0.0], 1.0).is_empty());
    }
}
