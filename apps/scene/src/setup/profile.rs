//! Profiles of tractions and pressures: factors by the place, and by time if they are sampled.
//!
//! A profile `p(x, t)` becomes a sum of profiles that stand still, `p(x, t) ≈ Σ h_k(t) p(x, t_k)` with the hat
//! functions `h_k` of the samples, so that the load has its exact force and moment at every sample.

use super::formula;
use super::spread::Traction;
use super::time::time_function;
use crate::error::{Error, Result, key, value};
use crate::spec::{Load, ProfileSamples};
use arlequin::core::effect::SurfaceFacet;
use arlequin::core::nalgebra::{Point3, center};
use arlequin::core::{Formula, TimeFunction};

/// Largest share of a load that may be lost or gained between its samples, in space or time.
const COARSE: f64 = 0.1;
/// Largest number of samples in time.
const MOST: usize = 10_000;

/// Refuses a profile that cannot be read, belongs to no traction or is not sampled.
pub(super) fn check(path: &str, l: &Load) -> Result<()> {
    let mut changes = false;
    if let Some(text) = &l.profile {
        let path = format!("{path}.profile");
        if l.traction.is_none() && l.pressure.is_none() {
            return Err(key(
                path,
                "is that of a traction or a pressure [Pa]; give one of these",
            ));
        }
        // Read to be checked before anything is packed.
        formula::check_profile(&path, text)?;
        changes = formula::with_time(text, 0.0) != *text;
    }
    let path = format!("{path}.profile_samples");
    let Some(ProfileSamples { end, count }) = l.profile_samples else {
        let rule = "is missing: a profile with t is sampled in time; give { end, count }, the last instant [s] and the number of samples";
        return if changes { Err(key(path, rule)) } else { Ok(()) };
    };
    if !changes {
        return Err(key(path, "is for a profile with t, the time [s]; remove it"));
    }
    if !(end > 0.0 && end.is_finite()) {
        let rule = "must be positive and finite [s]";
        return Err(value(format!("{path}.end"), end, rule));
    }
    if !(2..=MOST).contains(&count) {
        let rule = format!("must lie between 2 and {MOST}");
        return Err(value(format!("{path}.count"), count, &rule));
    }
    Ok(())
}

/// Splits a load into loads whose profiles stand still, each with the function of time on it. Before the first
/// sample and behind the last one the profile does not change.
///
/// # Errors
/// Those of the time function.
pub(super) fn samples(path: &str, l: &Load) -> Result<Vec<(Load, TimeFunction<f64>)>> {
    let time = time_function(&format!("{path}.time"), &l.time)?;
    let (Some(text), Some(ProfileSamples { end, count })) = (&l.profile, l.profile_samples) else {
        return Ok(vec![(l.clone(), time)]);
    };
    let last = (count - 1) as f64;
    let samples = (0..count).map(|k| {
        let text = formula::with_time(text, end * k as f64 / last);
        let time = time.clone();
        let factor = move |t: f64| {
            let hat = 1.0 - ((t / end * last).clamp(0.0, last) - k as f64).abs();
            // Nearly all samples are off, and a formula of time takes a while.
            if hat > 0.0 { hat * time.value(t) } else { 0.0 }
        };
        let factor = TimeFunction::Formula(Formula::new(&text, factor));
        let mut sample = l.clone();
        sample.profile = Some(text);
        (sample, factor)
    });
    Ok(samples.collect())
}

/// Refuses samples that do not follow a profile: halfway between two instants, straight lines lose or gain too
/// much on the loaded surface, given by points and their areas \[m²\].
pub(super) fn check_steps(path: &str, l: &Load, surface: &[(Point3<f64>, f64)]) -> Result<()> {
    let (Some(text), Some(ProfileSamples { end, count })) = (&l.profile, l.profile_samples) else {
        return Ok(());
    };
    // Every point of a large surface would take long for many samples.
    let some = surface.iter().step_by(1 + surface.len() / 1000);
    let values = |half_steps: usize| -> Result<Vec<f64>> {
        let text = formula::with_time(text, 0.5 * end * half_steps as f64 / (count - 1) as f64);
        let profile = formula::profile(&format!("{path}.profile"), &text)?;
        Ok(some.clone().map(|(x, area)| profile(x) * area).collect())
    };
    let size = |values: &[f64]| values.iter().map(|x| x.abs()).sum::<f64>();
    let mut before = values(0)?;
    let (mut missed, mut largest) = (0.0_f64, size(&before));
    for k in 1..count {
        let [between, after] = [values(2 * k - 1)?, values(2 * k)?];
        let lines = before.iter().zip(&after).map(|(a, b)| 0.5 * (a + b));
        missed = missed.max(lines.zip(&between).map(|(line, x)| (line - x).abs()).sum());
        largest = largest.max(size(&between)).max(size(&after));
        before = after;
    }
    if largest <= 0.0 {
        return Err(zero(path, text));
    }
    if missed <= COARSE * largest {
        return Ok(());
    }
    let rule = format!(
        "is too small: straight lines between the samples miss {:.0} % of the largest load; try {:.0}",
        100.0 * missed / largest,
        // The error of straight lines falls with the square of their length.
        (count as f64 * (missed / (COARSE * largest)).sqrt()).ceil()
    );
    Err(value(format!("{path}.profile_samples.count"), count, &rule))
}

fn zero(path: &str, text: &str) -> Error {
    let rule = "is zero on the whole surface, so that the load does nothing; shift or widen it";
    value(format!("{path}.profile"), format_args!("\"{text}\""), rule)
}

/// Multiplies a traction by the profile of its load, sampled at the centres of facets. `corners` returns those
/// of facet `k`.
///
/// # Errors
/// A profile that is not finite at a facet, is zero on all, or is too narrow for their size.
pub(super) fn multiply(
    path: &str,
    l: &Load,
    field: Traction,
    facets: &[SurfaceFacet<f64>],
    corners: &dyn Fn(usize) -> Vec<Point3<f64>>,
) -> Result<Traction> {
    let Some(text) = &l.profile else {
        return Ok(field);
    };
    let key_path = format!("{path}.profile");
    let profile = formula::profile(&key_path, text)?;
    if let Some(f) = facets.iter().find(|f| !profile(&f.centre).is_finite()) {
        let rule = format!(
            "is {} at {:?} m; give one that is finite on the surface",
            profile(&f.centre),
            f.centre.coords.as_slice()
        );
        return Err(value(key_path, format_args!("\"{text}\""), &rule));
    }
    // Sums over the centres, and over points halfway to the corners; their sizes without signs.
    let [mut coarse, mut fine, mut size] = [0.0_f64; 3];
    for (k, f) in facets.iter().enumerate() {
        let corners = corners(k);
        let halfway = corners.iter().map(|x| profile(&center(x, &f.centre)));
        let [middle, halfway] = [
            profile(&f.centre),
            halfway.sum::<f64>() / corners.len().max(1) as f64,
        ];
        coarse += middle * f.area();
        fine += halfway * f.area();
        size += middle.abs().max(halfway.abs()) * f.area();
    }
    // A sample in time may be zero, a load that stands still may not.
    if size <= 0.0 && l.profile_samples.is_none() {
        return Err(zero(path, text));
    }
    if (coarse - fine).abs() > COARSE * size {
        let rule = format!(
            "changes too much within a facet of the surface (half a diameter on particles): its integral is {coarse:.3e} m2 by the \
             centres of the facets and {fine:.3e} m2 by points between; widen it, or take smaller elements or spheres"
        );
        return Err(value(key_path, format_args!("\"{text}\""), &rule));
    }
    Ok(Box::new(move |f| field(f) * profile(&f.centre)))
}
