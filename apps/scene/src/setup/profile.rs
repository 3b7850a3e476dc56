//! Profiles of tractions and pressures: factors by the place, and by time if they are sampled.
//!
//! A profile `p(x, t)` becomes a sum of profiles that stand still, `p(x, t) ≈ Σ h_k(t) p(x, t_k)` with the
//! hat functions `h_k` of the samples, so that the load has its exact force and moment at every sample.

use super::formula;
use super::spread::Traction;
use super::time::time_function;
use crate::error::{Result, key, value};
use crate::setup::LoweredScene;
use crate::spec::{Load, ProfileSamples};
use arlequin::core::effect::SurfaceFacet;
use arlequin::core::nalgebra::Point3;
use arlequin::core::{Formula, TimeFunction};

/// Largest share of a load that may be lost or gained between its samples, in space or time.
const COARSE: f64 = 0.1;
/// Share of a run that may lie behind the last sample without a warning: runs end a step or two late.
const EARLY: f64 = 0.01;
/// Largest number of samples in time.
const MOST: usize = 1000;

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

/// Splits a load into loads whose profiles stand still, each with the function of time on it. Behind the last
/// sample the profile does not change.
///
/// # Errors
/// Those of the time function.
pub(super) fn samples(path: &str, l: &Load) -> Result<Vec<(Load, TimeFunction<f64>)>> {
    let time = time_function(&format!("{path}.time"), &l.time)?;
    let (Some(text), Some(ProfileSamples { end, count })) = (&l.profile, l.profile_samples) else {
        return Ok(vec![(l.clone(), time)]);
    };
    let last = (count - 1) as f64;
    let samples = instants(l).into_iter().enumerate().map(|(k, instant)| {
        let text = formula::with_time(text, instant);
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

/// Distance of the points at which a profile is read from the centre of a facet, over that of its corners:
/// for triangles and for quadrilaterals. Values there times the shares of the nodes are `∫ N_i p dA` for
/// linear `p`.
pub(super) const AT_NODES: [f64; 2] = [1.0 / 4.0, 1.0 / 3.0];
/// Distances of points whose values times equal shares have the force and moment of a linear profile.
pub(super) const GAUSS: [f64; 2] = [0.5, 0.577_350_269_189_625_8];
/// Distances for facets that have the value of their centre.
pub(super) const AT_CENTRES: [f64; 2] = [0.0; 2];

/// Splits facets into the shares of their nodes, so that a load may change within a facet.
pub(super) fn split(
    facets: &[SurfaceFacet<f64>],
    nodes: &[Point3<f64>],
    reach: [f64; 2],
) -> Vec<SurfaceFacet<f64>> {
    let parts = facets.iter().flat_map(|f| {
        let reach = reach[usize::from(f.nodes.len() > 3)];
        f.nodes.iter().zip(&f.shares).map(move |(n, share)| SurfaceFacet {
            nodes: vec![*n],
            shares: vec![*share],
            centre: f.centre + (nodes[*n] - f.centre) * reach,
            normal: f.normal,
        })
    });
    parts.collect()
}

/// A facet of a loaded surface: centre, corners \[m\] and area \[m²\].
pub(super) struct Patch {
    pub(super) centre: Point3<f64>,
    pub(super) corners: Vec<Point3<f64>>,
    pub(super) area: f64,
}

impl Patch {
    /// Patches of facets whose corners are nodes.
    pub(super) fn from_facets(facets: &[SurfaceFacet<f64>], nodes: &[Point3<f64>]) -> Vec<Self> {
        let patch = |f: &SurfaceFacet<f64>| Self {
            centre: f.centre,
            corners: f.nodes.iter().map(|n| nodes[*n]).collect(),
            area: f.area(),
        };
        facets.iter().map(patch).collect()
    }

    /// Integral of a function by the points at which the load reads it.
    fn coarse(&self, reach: [f64; 2], f: &impl Fn(&Point3<f64>) -> f64) -> f64 {
        let reach = reach[usize::from(self.corners.len() > 3)];
        let sum = self
            .corners
            .iter()
            .map(|x| f(&(self.centre + (x - self.centre) * reach)));
        sum.sum::<f64>() / self.corners.len() as f64 * self.area
    }

    /// Integral of a function by three times as many points, at distances that no regular wave has.
    fn fine(&self, f: &impl Fn(&Point3<f64>) -> f64) -> f64 {
        let (c, count) = (self.centre, self.corners.len());
        let sums = (0..count).map(|i| {
            let [a, b] = [i, (i + 1) % count].map(|k| self.corners[k] - c);
            f(&(c + a * 0.72)) + f(&(c + a * 0.30)) + f(&(c + (a + b) * 0.41))
        });
        sums.sum::<f64>() / (3 * count) as f64 * self.area
    }
}

/// Refuses a profile that is zero on the whole surface, or that is lost between the points and instants at
/// which the load reads it. Errors count by the load of all samples together: a spot may enter and leave the
/// surface.
pub(super) fn check_samples(path: &str, l: &Load, surface: &[Patch], reach: [f64; 2]) -> Result<()> {
    let Some(text) = &l.profile else { return Ok(()) };
    let key_path = format!("{path}.profile");
    let [mut size, mut net, mut random] = [0.0_f64; 3];
    let times = instants(l);
    // A few dozen instants tell whether the profile is too narrow.
    for time in times.iter().step_by(1 + times.len() / 40) {
        let profile = formula::profile(&key_path, &formula::with_time(text, *time))?;
        let [mut sum, mut squares] = [0.0_f64; 2];
        for patch in surface {
            let [coarse, fine] = [patch.coarse(reach, &profile), patch.fine(&profile)];
            size += coarse.abs().max(fine.abs());
            sum += coarse - fine;
            squares += (coarse - fine).powi(2);
        }
        net += sum.abs();
        random += squares.sqrt();
    }
    if size <= 0.0 {
        let rule = "is zero on the whole surface, so that the load does nothing; shift or widen it";
        return Err(value(key_path, format_args!("\"{text}\""), rule));
    }
    if net.max(random) > COARSE * size {
        let rule = format!(
            "changes too much within the facets of the surface (half a diameter on particles, elements on a body): {:.0} % of the load \
             would be lost or moved; widen it, or take smaller ones",
            100.0 * net.max(random) / size
        );
        return Err(value(key_path, format_args!("\"{text}\""), &rule));
    }
    check_steps(path, text, surface, &times)
}

/// Instants at which a profile is sampled \[s\].
fn instants(l: &Load) -> Vec<f64> {
    match l.profile_samples {
        Some(ProfileSamples { end, count }) => {
            (0..count).map(|k| end * k as f64 / (count - 1) as f64).collect()
        }
        None => vec![0.0],
    }
}

/// Refuses instants between which straight lines miss too much of a profile.
fn check_steps(path: &str, text: &str, surface: &[Patch], times: &[f64]) -> Result<()> {
    // Every facet of a large surface would take long for many samples.
    let some = surface.iter().step_by(1 + surface.len() / 500);
    let values = |time: f64| -> Result<Vec<f64>> {
        let profile = formula::profile(&format!("{path}.profile"), &formula::with_time(text, time))?;
        Ok(some.clone().map(|s| s.coarse(AT_CENTRES, &profile)).collect())
    };
    let [mut missed, mut size] = [0.0_f64; 2];
    let mut before = values(times[0])?;
    for pair in times.windows(2) {
        let after = values(pair[1])?;
        // Not halfway alone: a wave with whole periods between samples may vanish there.
        for part in [0.29, 0.5, 0.62] {
            let between = values(pair[0] + part * (pair[1] - pair[0]))?;
            let lines = before.iter().zip(&after).map(|(a, b)| a + part * (b - a));
            missed += lines.zip(&between).map(|(line, x)| (line - x).abs()).sum::<f64>();
            size += between.iter().map(|x| x.abs()).sum::<f64>();
        }
        before = after;
    }
    // What is not finite is refused with its place.
    if missed.is_nan() || missed <= COARSE * size {
        return Ok(());
    }
    let rule = format!(
        "is too small: straight lines between the samples miss {:.0} % of the load; take more of them, or put what jumps or swings as a \
         whole into time",
        100.0 * missed / size
    );
    Err(value(format!("{path}.profile_samples.count"), times.len(), &rule))
}

/// Warns about profiles that are sampled up to an instant before the end of the run \[s\].
pub(super) fn warnings(scene: &LoweredScene, end: f64) -> Vec<String> {
    let warning = |(k, l): (usize, &Load)| {
        let sampled = l.profile_samples?.end;
        (sampled < end * (1.0 - EARLY)).then(|| {
            format!(
                "load[{k}].profile_samples.end = {sampled:.3e} s: the profile stays as it is then up to the end, {end:.3e} s; sample it up \
                 to the end if this is not meant"
            )
        })
    };
    scene.load.iter().enumerate().filter_map(warning).collect()
}

/// Multiplies a traction by the profile of its load, read at the centres of facets.
///
/// # Errors
/// A profile that is not finite there.
pub(super) fn multiply(
    path: &str,
    l: &Load,
    field: Traction,
    facets: &[SurfaceFacet<f64>],
) -> Result<Traction> {
    let Some(text) = &l.profile else {
        return Ok(field);
    };
    let path = format!("{path}.profile");
    let profile = formula::profile(&path, text)?;
    if let Some(f) = facets.iter().find(|f| !profile(&f.centre).is_finite()) {
        let rule = format!(
            "is {} at {:?} m; give one that is finite on the surface",
            profile(&f.centre),
            f.centre.coords.as_slice()
        );
        return Err(value(path, format_args!("\"{text}\""), &rule));
    }
    Ok(Box::new(move |f| field(f) * profile(&f.centre)))
}
