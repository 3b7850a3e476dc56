//! Curves over time: reading probes and references, errors, and the energy reflected past a probe.

use crate::error::{Error, Result, key, unknown};
use crate::spec::Quantity;
use crate::spec::sweep::{CurveTable, Reflected, Window};
use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::path::Path;

/// Largest number of points at which two curves are compared.
const MOST_POINTS: usize = 200_000;

/// Values of a probe over time.
#[derive(Debug, Clone)]
pub struct Series {
    /// Quantity of the probe.
    pub quantity: Quantity,
    /// Times \[s\], increasing.
    pub times: Vec<f64>,
    /// Values.
    pub values: Vec<f64>,
}

/// Probes of a run by name.
pub(super) type Probes = BTreeMap<String, Series>;

/// Reads `probes.csv`.
pub(super) fn probes(path: &Path) -> Result<Probes> {
    let (names, columns) = table(path)?;
    let times = columns.first().cloned().unwrap_or_default();
    let series = names.iter().zip(columns).skip(1).filter_map(|(name, values)| {
        // Errors are defined for motion only; probes of other quantities are left out.
        let (name, quantity) = if let Some(n) = name.strip_suffix(" displacement [m]") {
            (n, Quantity::Displacement)
        } else {
            (name.strip_suffix(" velocity [m/s]")?, Quantity::Velocity)
        };
        let times = times.clone();
        Some((
            name.to_owned(),
            Series {
                quantity,
                times,
                values,
            },
        ))
    });
    Ok(series.collect())
}

/// Headers and columns of a file with comma-separated values.
fn table(path: &Path) -> Result<(Vec<String>, Vec<Vec<f64>>)> {
    let bad = |line: Option<u64>, what: String| {
        let place = format!("'{}' row {}", path.display(), line.unwrap_or(1));
        key(place, format!("{what}; a table of finite numbers is needed"))
    };
    let fault = |e: csv::Error| {
        let line = e.position().map(csv::Position::line);
        match e.into_kind() {
            csv::ErrorKind::Io(source) => Error::Read {
                path: path.to_owned(),
                source,
            },
            other => bad(line, format!("{other:?}")),
        }
    };
    let mut reader = csv::ReaderBuilder::new();
    // Rows of a wrong length are refused below, with file and row.
    reader.trim(csv::Trim::All).flexible(true);
    let mut reader = reader.from_path(path).map_err(fault)?;
    let names: Vec<String> = reader
        .headers()
        .map_err(fault)?
        .iter()
        .map(str::to_owned)
        .collect();
    let mut columns = vec![Vec::new(); names.len()];
    for row in reader.records() {
        let row = row.map_err(fault)?;
        let line = row.position().map(csv::Position::line);
        if row.len() != names.len() {
            return Err(bad(
                line,
                format!("{} cells under {} headers", row.len(), names.len()),
            ));
        }
        for (c, cell) in columns.iter_mut().zip(&row) {
            match cell.parse::<f64>() {
                Ok(x) if x.is_finite() => c.push(x),
                _ => return Err(bad(line, format!("'{cell}' is no finite number"))),
            }
        }
    }
    Ok((names, columns))
}

/// Reference of one probe.
#[derive(Debug, Clone)]
pub enum Curve {
    /// Samples.
    Samples(Series),
    /// A formula.
    Formula(CurveTable),
}

impl Curve {
    /// Reads or checks a reference curve of the sweep file; `place` is its key in errors.
    pub fn new(place: &str, from: &CurveTable, folder: &Path) -> Result<Self> {
        let positive = |name: &str, x: f64| {
            if x.is_finite() && x > 0.0 {
                return Ok(());
            }
            let field = format!("{place}.{name}");
            Err(crate::error::value(field, x, "must be positive"))
        };
        match from {
            CurveTable::Csv { file, time, value } => {
                let path = folder.join(file);
                let (names, columns) = table(&path)?;
                let take = |key: &str, name: &str| {
                    let k = names.iter().position(|n| n == name);
                    k.map(|k| columns[k].clone())
                        .ok_or_else(|| unknown(format!("{place}.csv.{key}"), name, "column", names.iter()))
                };
                let (times, values) = (take("time", time)?, take("value", value)?);
                if times.len() < 2 || times.windows(2).any(|w| w[1] <= w[0]) {
                    let rule = "needs at least two rows with rising times";
                    return Err(key(format!("{place}.csv.time"), rule));
                }
                // Not used: the probe of the run decides what is compared.
                let quantity = Quantity::Displacement;
                Ok(Self::Samples(Series {
                    quantity,
                    times,
                    values,
                }))
            }
            CurveTable::Wave { width, .. } => {
                positive("wave.width", *width)?;
                Ok(Self::Formula(from.clone()))
            }
            CurveTable::BarStep { length, speed, .. } => {
                positive("bar-step.length", *length)?;
                positive("bar-step.speed", *speed)?;
                Ok(Self::Formula(from.clone()))
            }
        }
    }

    /// First and last time of the curve \[s\]; infinite for a formula.
    fn span(&self) -> (f64, f64) {
        match self {
            Self::Samples(s) => s.span(),
            Self::Formula(_) => (f64::NEG_INFINITY, f64::INFINITY),
        }
    }

    fn points(&self) -> usize {
        match self {
            Self::Samples(s) => s.times.len(),
            Self::Formula(_) => 0,
        }
    }

    fn value_at(&self, t: f64, quantity: Quantity, hint: &mut usize) -> f64 {
        match self {
            Self::Samples(s) => s.value_at(t, hint),
            Self::Formula(f) => formula(f, t, quantity),
        }
    }
}

impl Series {
    fn span(&self) -> (f64, f64) {
        (
            self.times.first().copied().unwrap_or_default(),
            self.times.last().copied().unwrap_or_default(),
        )
    }

    /// Interpolates between the samples by a cubic Hermite polynomial with slopes from the neighbours. `hint`
    /// is the interval of the last call.
    fn value_at(&self, t: f64, hint: &mut usize) -> f64 {
        let (x, y) = (&self.times, &self.values);
        let last = x.len() - 1;
        if last == 0 {
            return y[0];
        }
        // Times rise from call to call, so that the search is rarely needed.
        if *hint >= last || x[*hint] > t {
            *hint = x.partition_point(|p| *p <= t).saturating_sub(1).min(last - 1);
        }
        while *hint + 1 < last && x[*hint + 1] <= t {
            *hint += 1;
        }
        let k = *hint;
        let h = x[k + 1] - x[k];
        // Central differences, one-sided at both ends.
        let slope = |i: usize| {
            let (a, b) = (i.saturating_sub(1), (i + 1).min(last));
            (y[b] - y[a]) / (x[b] - x[a])
        };
        let s = ((t - x[k]) / h).clamp(0.0, 1.0);
        // Cubic Hermite: values and slopes of both ends are met.
        let (p, q) = (s * s * (3.0 - 2.0 * s), s * (1.0 - s));
        y[k] + p * (y[k + 1] - y[k]) + h * q * ((1.0 - s) * slope(k) - s * slope(k + 1))
    }
}

fn formula(f: &CurveTable, t: f64, quantity: Quantity) -> f64 {
    match *f {
        CurveTable::Wave {
            at,
            centre,
            width,
            amplitude,
            speed,
        } => {
            let s = (at - centre - speed * t) / width;
            if s.abs() >= 0.5 {
                return 0.0;
            }
            match quantity {
                Quantity::Velocity => amplitude * speed * PI / width * (2.0 * PI * s).sin(),
                _ => amplitude * (PI * s).cos().powi(2),
            }
        }
        CurveTable::BarStep {
            at,
            length,
            speed,
            particle_speed,
        } => {
            // Each front travels along the bar; reflection changes its sign at the clamp and keeps it at the
            // free end.
            let mut sum = 0.0;
            let mut sign = 1.0;
            let mut n = 1.0;
            while (n * length - at) / speed < t {
                for (s, x) in [(sign, n * length - at), (-sign, n * length + at)] {
                    let since = t - x / speed;
                    if since > 0.0 {
                        sum += s * if quantity == Quantity::Velocity {
                            1.0
                        } else {
                            since
                        };
                    }
                }
                sign = -sign;
                n += 2.0;
            }
            particle_speed * sum
        }
        // Not reached: `Curve::new` turns files into samples.
        CurveTable::Csv { .. } => f64::NAN,
    }
}

/// Relative errors of a run.
#[derive(Debug, Clone, Default, serde::Serialize)]
pub struct Errors {
    /// Error of all displacement probes together \[–\]; `None` without such a probe, or if the reference is
    /// zero.
    pub displacement: Option<f64>,
    /// Error of all velocity probes together \[–\]; `None` as for displacements.
    pub velocity: Option<f64>,
    /// Error of each probe \[–\].
    pub probes: BTreeMap<String, f64>,
}

/// Integrals of the squared difference and of the squared reference over the common times; `None` if there
/// are no common times.
fn squares(a: &Series, b: &Curve, window: [Option<f64>; 2]) -> Option<[f64; 2]> {
    let ((a0, a1), (b0, b1)) = (a.span(), b.span());
    let low = a0.max(b0).max(window[0].unwrap_or(f64::NEG_INFINITY));
    let high = a1.min(b1).min(window[1].unwrap_or(f64::INFINITY));
    if a.times.len() < 2 || high <= low {
        return None;
    }
    // Midpoint sums with at least 64 points, and as many as the finer curve has.
    let n = a.times.len().max(b.points()).clamp(64, MOST_POINTS);
    let step = (high - low) / n as f64;
    let (mut i, mut j) = (0, 0);
    let mut sums = [0.0; 2];
    for k in 0..n {
        let t = low + (k as f64 + 0.5) * step;
        let (x, y) = (a.value_at(t, &mut i), b.value_at(t, a.quantity, &mut j));
        sums[0] += (x - y) * (x - y) * step;
        sums[1] += y * y * step;
    }
    Some(sums)
}

/// Relative L2 errors over time, `√(∫(u − u_ref)² dt / ∫u_ref² dt)`, per probe and over all probes of one
/// quantity.
pub(super) fn errors(run: &Probes, reference: &BTreeMap<String, Curve>, window: &Window) -> Errors {
    let mut out = Errors::default();
    let mut sums = [[0.0; 2]; 2];
    for (name, series) in run {
        if window.probes.as_ref().is_some_and(|p| !p.contains(name)) {
            continue;
        }
        let curve = reference.get(name);
        let Some(s) = curve.and_then(|r| squares(series, r, [window.from, window.to])) else {
            continue;
        };
        if s[1] > 0.0 {
            out.probes.insert(name.clone(), (s[0] / s[1]).sqrt());
        }
        // Sums of squares, not means of errors: a probe that hardly moves counts little.
        let kind_sums = &mut sums[usize::from(series.quantity == Quantity::Velocity)];
        kind_sums[0] += s[0];
        kind_sums[1] += s[1];
    }
    let total = |s: [f64; 2]| (s[1] > 0.0).then(|| (s[0] / s[1]).sqrt());
    out.displacement = total(sums[0]);
    out.velocity = total(sums[1]);
    out
}

/// Ratio of `∫v² dt` after the time `after` to `∫v² dt` before it: reflected over incident energy, since a
/// travelling wave carries `ρ c S v²`. Displacement probes are differentiated. `None` if the probe is missing
/// or the run ends before `after`.
pub(super) fn reflected(run: &Probes, reference: &BTreeMap<String, Curve>, table: &Reflected) -> Option<f64> {
    let series = run.get(&table.probe)?;
    let curve = reference.get(&table.probe);
    let until = table.until.unwrap_or(f64::INFINITY);
    let (mut i, mut sums) = (0, [0.0; 2]);
    let taken = |t: f64, i: &mut usize| match curve {
        Some(c) if table.minus_reference => c.value_at(t, series.quantity, i),
        _ => 0.0,
    };
    for (t, v) in series.times.windows(2).zip(series.values.windows(2)) {
        let (dt, middle) = (t[1] - t[0], 0.5 * (t[0] + t[1]));
        // The middle of an interval decides on which side of `after` it counts.
        let back = middle > table.after;
        if middle > until {
            break;
        }
        let off = |t: f64, i: &mut usize| if back { taken(t, i) } else { 0.0 };
        let (a, b) = (v[0] - off(t[0], &mut i), v[1] - off(t[1], &mut i));
        let speed = match series.quantity {
            Quantity::Velocity => 0.5 * (a + b),
            _ => (b - a) / dt,
        };
        sums[usize::from(back)] += speed * speed * dt;
    }
    let reached = series.times.last().is_some_and(|t| *t > table.after);
    (reached && sums[0] > 0.0).then(|| sums[1] / sums[0])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn series(quantity: Quantity, n: usize, f: impl Fn(f64) -> f64) -> Series {
        let times: Vec<f64> = (0..=n).map(|k| k as f64 / n as f64).collect();
        let values = times.iter().map(|t| f(*t)).collect();
        Series {
            quantity,
            times,
            values,
        }
    }

    #[test]
    fn a_shifted_sine_has_the_error_of_its_phase() {
        let wave = |phase: f64| move |t: f64| (2.0 * PI * (4.0 * t) + phase).sin();
        let run: Probes = [("p".to_owned(), series(Quantity::Velocity, 700, wave(0.02)))].into();
        // The two curves have no sample times in common.
        let reference = [(
            "p".to_owned(),
            Curve::Samples(series(Quantity::Velocity, 911, wave(0.0))),
        )]
        .into();
        let e = errors(&run, &reference, &Window::default());
        let expected = 2.0 * (0.01f64).sin();
        assert!(e.displacement.is_none());
        assert!(
            (e.velocity.unwrap_or_default() / expected - 1.0).abs() < 1e-3,
            "{e:?}"
        );
    }

    #[test]
    fn formulas_solve_the_wave_equation() {
        let bar = CurveTable::BarStep {
            at: 1.0,
            length: 1.0,
            speed: 1.0,
            particle_speed: 1.0,
        };
        // Free end: rises to twice the static value 1 after one passage there and back, and comes to rest
        // after two.
        let u = |t: f64| formula(&bar, t, Quantity::Displacement);
        for (t, expected) in [(0.5, 0.5), (2.0, 2.0), (3.0, 1.0), (4.0, 0.0), (6.0, 2.0)] {
            assert!((u(t) - expected).abs() < 1e-12, "u({t}) = {}", u(t));
        }
        let wave = CurveTable::Wave {
            at: 2.0,
            centre: 0.0,
            width: 1.0,
            amplitude: 3.0,
            speed: 2.0,
        };
        let (d, e) = (1e-6, 1.07);
        let slope = (formula(&wave, e + d, Quantity::Displacement)
            - formula(&wave, e - d, Quantity::Displacement))
            / (2.0 * d);
        assert!((slope - formula(&wave, e, Quantity::Velocity)).abs() < 1e-6 * slope.abs());
        assert!((formula(&wave, 1.0, Quantity::Displacement) - 3.0).abs() < 1e-12);
    }

    #[test]
    fn a_tenth_of_the_amplitude_is_a_hundredth_of_the_energy() {
        let pulse = |t: f64, at: f64| {
            if (t - at).abs() < 0.1 {
                (PI * (t - at) / 0.2).cos()
            } else {
                0.0
            }
        };
        let run: Probes = [(
            "p".to_owned(),
            series(Quantity::Velocity, 4000, |t| pulse(t, 0.2) - 0.1 * pulse(t, 0.7)),
        )]
        .into();
        let mut table = Reflected {
            probe: "p".into(),
            after: 0.45,
            until: None,
            minus_reference: false,
        };
        let r = reflected(&run, &BTreeMap::new(), &table).unwrap_or_default();
        assert!((r - 0.01).abs() < 1e-5, "{r}");
        table.until = Some(0.5);
        assert_eq!(reflected(&run, &BTreeMap::new(), &table), Some(0.0));
        table.after = 2.0;
        assert!(reflected(&run, &BTreeMap::new(), &table).is_none());
    }

    /// Twice the reference has an error of one, and half the reference one half: errors are relative to the
    /// reference.
    #[test]
    fn an_error_is_relative_to_the_reference() {
        let wave = |t: f64| (2.0 * PI * t).sin();
        let reference = [(
            "p".to_owned(),
            Curve::Samples(series(Quantity::Displacement, 500, wave)),
        )]
        .into();
        for (factor, expected) in [(2.0, 1.0), (0.5, 0.5), (-1.0, 2.0), (1.0, 0.0)] {
            let run: Probes = [(
                "p".to_owned(),
                series(Quantity::Displacement, 500, |t| factor * wave(t)),
            )]
            .into();
            let e = errors(&run, &reference, &Window::default());
            for found in [e.displacement, e.probes.get("p").copied()] {
                let found = found.expect("an error");
                assert!(
                    (found - expected).abs() < 1e-12,
                    "{factor}: {found}, not {expected}"
                );
            }
        }
    }

    /// A run that is right until 0.4 s, off by one until 0.7 s, and right again. Times outside of the window
    /// and probes that it does not name do not count.
    #[test]
    fn only_the_window_and_its_probes_count() {
        let off = |t: f64| if (0.4..0.7).contains(&t) { 2.0 } else { 1.0 };
        let run: Probes = ["p", "q"]
            .map(|n| (n.to_owned(), series(Quantity::Velocity, 1000, off)))
            .into();
        let reference = [
            (
                "p".to_owned(),
                Curve::Samples(series(Quantity::Velocity, 1000, |_| 1.0)),
            ),
            (
                "q".to_owned(),
                Curve::Samples(series(Quantity::Velocity, 1000, |_| 5.0)),
            ),
        ]
        .into();
        for (from, to, expected) in [
            (None, Some(0.39), 0.0),
            (Some(0.71), None, 0.0),
            (Some(0.41), Some(0.69), 1.0),
            (Some(0.1), Some(0.9), (0.3f64 / 0.8).sqrt()),
        ] {
            let window = Window {
                from,
                to,
                probes: Some(vec!["p".into()]),
            };
            let e = errors(&run, &reference, &window);
            assert_eq!(e.probes.len(), 1);
            let found = e.velocity.expect("an error");
            assert!(
                (found - expected).abs() < 2e-3,
                "{from:?} to {to:?}: {found}, not {expected}"
            );
        }
    }
}
