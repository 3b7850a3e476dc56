//! Frequencies of a probe: Hann window, fast Fourier transform, parabolic interpolation of the peaks.

use realfft::RealFftPlanner;
use std::f64::consts::PI;

/// Smallest number of samples from which frequencies are computed.
const FEWEST: usize = 32;
/// Share of the largest amplitude below which a peak counts as side lobe or noise (the side lobes of a Hann
/// window reach 0.027).
const FLOOR: f64 = 0.05;
/// Largest number of peaks that are returned.
const MOST: usize = 12;

/// Frequencies of the peaks \[Hz\], ascending, of samples at intervals `step` \[s\].
pub fn frequencies(samples: &[f64], step: f64) -> Vec<f64> {
    let n = samples.len();
    if n < FEWEST || step <= 0.0 {
        return Vec::new();
    }
    let mean = samples.iter().sum::<f64>() / n as f64;
    // The Hann window: without it, a period that does not fit the record leaks into all frequencies.
    let window = |k: usize| 0.5 - 0.5 * (2.0 * PI * k as f64 / n as f64).cos();
    // Zero padding to twice the length: the parabola then errs by less than a hundredth of a bin.
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
    // A constant signal has no frequency.
    if top <= f64::MIN_POSITIVE {
        return Vec::new();
    }
    // With fewer than two periods in the window, a slope looks like a frequency.
    let first = (2 * size).div_ceil(n).max(1);
    let mut peaks: Vec<(f64, f64)> = Vec::new();
    for k in first..power.len() - 1 {
        let (a, b, c) = (power[k - 1], power[k], power[k + 1]);
        if b > a && b >= c && b > top * FLOOR * FLOOR {
            // The peak of a Hann window is nearly a parabola in the logarithm; `tiny` avoids the logarithm of
            // zero.
            let tiny = top * 1e-30;
            let (a, b, c) = ((a + tiny).ln(), (b + tiny).ln(), (c + tiny).ln());
            let bend = a - 2.0 * b + c;
            let shift = if bend < 0.0 { 0.5 * (a - c) / bend } else { 0.0 };
            peaks.push((power[k], (k as f64 + shift) / (size as f64 * step)));
        }
    }
    peaks.sort_by(|a, b| b.0.total_cmp(&a.0));
    peaks.truncate(MOST);
    let mut frequencies: Vec<f64> = peaks.into_iter().map(|p| p.1).collect();
    frequencies.sort_by(f64::total_cmp);
    frequencies
}

/// Amplitude of the Hann-windowed Fourier transform at one frequency \[Hz\], of the samples without their
/// mean.
fn amplitude(samples: &[f64], step: f64, frequency: f64) -> f64 {
    let n = samples.len() as f64;
    let mean = windowed_mean(samples);
    let (mut re, mut im) = (0.0, 0.0);
    for (k, s) in samples.iter().enumerate() {
        let t = k as f64;
        let window = 0.5 - 0.5 * (2.0 * PI * t / n).cos();
        let (sin, cos) = (2.0 * PI * frequency * t * step).sin_cos();
        re += (s - mean) * window * cos;
        im += (s - mean) * window * sin;
    }
    re.hypot(im)
}

/// Frequency \[Hz\] of the highest peak within 12 % of a guess; a scan, then golden-section search. The
/// relative error is below 1e-4 with ten or more periods in the window.
pub fn peak_near(samples: &[f64], step: f64, guess: f64) -> f64 {
    let amplitude_at = |f: f64| amplitude(samples, step, f);
    // A quarter of the bin width: the scan then cannot step over a peak.
    let width = 0.25 / (samples.len() as f64 * step);
    let scan = (0..).map(|k| 0.88 * guess + width * f64::from(k));
    let best = scan
        .take_while(|f| *f < 1.12 * guess)
        .map(|f| (f, amplitude_at(f)))
        .fold((guess, 0.0), |b, x| if x.1 > b.1 { x } else { b })
        .0;
    let (mut low, mut high) = (best - width, best + width);
    // Each section keeps this share of the interval.
    let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
    // Thirty golden sections shrink the interval by a factor of 2e6.
    for _ in 0..30 {
        let (a, b) = (high - golden * (high - low), low + golden * (high - low));
        if amplitude_at(a) > amplitude_at(b) {
            high = b;
        } else {
            low = a;
        }
    }
    0.5 * (low + high)
}

/// Mean under a Hann window, which suppresses oscillations.
pub fn windowed_mean(samples: &[f64]) -> f64 {
    let n = samples.len() as f64;
    let window = |k: usize| 1.0 - (2.0 * PI * k as f64 / n).cos();
    let sum: f64 = samples.iter().enumerate().map(|(k, s)| window(k) * s).sum();
    sum / n
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
        let peaks = frequencies(&samples, dt);
        assert_eq!(peaks.len(), 2, "{peaks:?}");
        assert!((peaks[0] / 123.4 - 1.0).abs() < 1e-3 && (peaks[1] / 456.7 - 1.0).abs() < 1e-3);
    }

    #[test]
    fn near_a_guess_to_a_ten_thousandth() {
        let samples: Vec<f64> = (0..2000)
            .map(|k| 2.0 - 1.6 * (2.0 * PI * 0.0061 * f64::from(k)).cos() - 0.3 * (0.11 * f64::from(k)).cos())
            .collect();
        assert!((peak_near(&samples, 1.0, 0.0058) / 0.0061 - 1.0).abs() < 1e-4);
        assert!((windowed_mean(&samples) - 2.0).abs() < 1e-3);
    }

    #[test]
    fn rest_and_short_series_have_none() {
        assert!(frequencies(&[0.0; 100], 1.0).is_empty());
        assert!(frequencies(&[1.0; 100], 1.0).is_empty());
        assert!(frequencies(&[0.0, 1.0, 0.0], 1.0).is_empty());
    }
}
