//! Error of a coupling before it is run: dispersion of the coarse lattice over the way a wave makes in it, and reflection
//! and transmission of the overlap by harmonic analysis.

use super::scenario::{Scenario, Spectrum};
use crate::build;
use crate::error::{Error, Result, core};
use crate::scene::{JunctionKind, ProfileKind, Scene};
use arlequin::core::harmonic::{HarmonicOverlap, Port};
use rayon::prelude::*;
use std::path::Path;

/// The chain of the analysis is at most this much finer than the bar: beyond, the reflection hardly changes, the
/// matrices grow.
const FINEST: f64 = 10.0;
/// Points per table of reflection over frequency.
const POINTS: usize = 20;

/// One choice of the settings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Candidate {
    /// Coarse spacing \[m\].
    pub(crate) h: f64,
    /// Mediator spacing \[m\].
    pub(crate) h_b: f64,
    /// Width of the overlap \[m\].
    pub(crate) overlap: f64,
    /// Weight.
    pub(crate) profile: ProfileKind,
    /// Junction length over mediator spacing; none for L2.
    pub(crate) length_ratio: Option<f64>,
    /// Which table of [`Tables`] holds its reflection.
    pub(crate) table: usize,
}

/// Shape of an overlap in units of the coarse spacing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Form {
    /// Coarse over fine spacing.
    pub(crate) ratio: f64,
    /// Mediator spacing.
    pub(crate) h_b: f64,
    /// Width.
    pub(crate) overlap: f64,
    /// Weight.
    pub(crate) profile: ProfileKind,
    /// Junction.
    pub(crate) junction: JunctionKind,
    /// Junction length over mediator spacing.
    pub(crate) length_ratio: Option<f64>,
}

/// Loss of an overlap over frequency: `|r|² + (1 − |t|)²`, frequencies in units of the coarse cutoff.
#[derive(Debug, Clone)]
pub(crate) struct Table {
    frequencies: Vec<f64>,
    losses: Vec<f64>,
    /// Largest reflected amplitude for wavelengths above 4.2 coarse spacings.
    pub(crate) top_reflection: f64,
}

/// Tables of several forms, in parallel.
pub(crate) fn tables(forms: &[Form]) -> Result<Vec<Table>> {
    forms.par_iter().map(table).collect()
}

fn profile_name(p: ProfileKind) -> &'static str {
    match p {
        ProfileKind::Constant => "constant",
        ProfileKind::Linear => "linear",
        ProfileKind::Cubic => "cubic",
        ProfileKind::Quintic => "quintic",
        ProfileKind::MediatorCompatible => "mediator-compatible",
    }
}

/// Name of a weight in a scene.
pub(crate) fn weight_name(p: ProfileKind) -> &'static str {
    profile_name(p)
}

/// Name of a junction in a scene.
pub(crate) fn junction_name(j: JunctionKind) -> &'static str {
    match j {
        JunctionKind::L2 => "l2",
        JunctionKind::H1Strain => "h1-strain",
        JunctionKind::H1Gradient => "h1-gradient",
        JunctionKind::H1Seminorm => "h1-seminorm",
    }
}

/// A chain and a bar of unit modulus, density and element length, with the overlap of the form.
fn miniature(f: &Form) -> String {
    let r = 1.0 / f.ratio.min(FINEST);
    let value = if f.profile == ProfileKind::Constant {
        ", value = 0.5"
    } else {
        ""
    };
    let length = match f.length_ratio {
        Some(l) if f.junction != JunctionKind::L2 => format!(", length = {}", l * f.h_b),
        _ => String::new(),
    };
    let (bonds, elements) = (((f.overlap / r).round() + 4.0), f.overlap.ceil() + 4.0);
    format!(
        "[model.bar]\nkind = \"fem\"\nrole = \"coarse\"\nshape.bar = {{ from = 0, to = {elements}, section = 1 }}\n\
         spacing = 1\nmaterial = {{ young = 1, density = 1 }}\n\
         [model.chain]\nkind = \"chain\"\nrole = \"fine\"\nshape.bar = {{ from = {from}, to = {to}, section = 1 }}\n\
         divisions = [{bonds}]\nmaterial = {{ young = 1, density = 1 }}\n\
         [interface.joint]\ncoarse = \"bar\"\nfine = \"chain\"\n\
         overlap.slab = {{ fine = [0, 0, 0], coarse = [{to}, 0, 0] }}\n\
         weight = {{ profile = \"{profile}\"{value} }}\nmediator = {{ spacing = {h_b} }}\n\
         junction = {{ kind = \"{junction}\"{length} }}\n[time]\nsteps = 1\n",
        from = f.overlap - bonds * (f.overlap + 4.0 * r) / bonds,
        to = f.overlap,
        profile = profile_name(f.profile),
        h_b = f.h_b,
        junction = junction_name(f.junction),
    )
}

fn table(f: &Form) -> Result<Table> {
    let text = miniature(f);
    let scene: Scene = toml::from_str(&text).map_err(|e| Error::System {
        what: "writing the miniature of an overlap",
        message: e.message().to_owned(),
    })?;
    let run = build::build(&scene, Path::new("."))?.run;
    let nodes = |k: usize| run.subdomains()[k].model().nodes();
    let spacing = |k: usize| (nodes(k)[1].x - nodes(k)[0].x).abs();
    let port = |subdomain: usize, dof: usize| {
        let h = spacing(subdomain);
        Port {
            subdomain,
            dof,
            stiffness: 1.0 / h,
            mass: h,
            spacing: h,
        }
    };
    let last = nodes(0).len() - 1;
    let harmonic = HarmonicOverlap::new(&run, port(1, 0), port(0, last)).map_err(core("interface"))?;
    let mut out = Table {
        frequencies: Vec::new(),
        losses: Vec::new(),
        top_reflection: 0.0,
    };
    for k in 0..POINTS {
        let share = 0.04 + 0.94 * k as f64 / (POINTS - 1) as f64;
        // The bar's cutoff is 2 c/h.
        let s = harmonic.response(2.0 * share).map_err(core("interface"))?;
        let missing = 1.0 - s.transmission;
        out.frequencies.push(share);
        out.losses.push(s.reflection * s.reflection + missing * missing);
        // sin(π/4.2): a wave of 4.2 elements.
        if share < 0.68 {
            out.top_reflection = out.top_reflection.max(s.reflection);
        }
    }
    Ok(out)
}

impl Table {
    fn loss(&self, share: f64) -> f64 {
        let f = &self.frequencies;
        let k = f.partition_point(|x| *x <= share).clamp(1, f.len() - 1);
        // Below the first point the loss falls with the square of the frequency.
        if share < f[0] {
            return self.losses[0] * (share / f[0]).powi(2);
        }
        let s = ((share - f[k - 1]) / (f[k] - f[k - 1])).clamp(0.0, 1.0);
        self.losses[k - 1] + s * (self.losses[k] - self.losses[k - 1])
    }
}

/// Predicted relative errors against a fine model everywhere.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub(crate) struct Errors {
    /// Of displacements \[–\].
    pub(crate) displacement: f64,
    /// Of velocities \[–\].
    pub(crate) velocity: f64,
    /// Share of the velocity signal's energy that the coarse lattice cannot carry \[–\].
    pub(crate) above_cutoff: f64,
}

impl Errors {
    /// The larger one.
    pub(crate) fn worst(&self) -> f64 {
        self.displacement.max(self.velocity)
    }
}

/// Wavenumber of a lattice of spacing `h` under steps `dt`: `sin(ω Δt/2) = (c Δt/h) sin(κ h/2)`; none above its cutoff.
fn wavenumber(omega: f64, speed: f64, h: f64, dt: f64) -> Option<f64> {
    let s = h / (speed * dt) * (0.5 * omega * dt).sin();
    (s < 1.0).then(|| 2.0 / h * s.asin())
}

/// Error of a candidate over a run that ends at `end` with steps `dt`.
pub(crate) fn errors(
    c: &Candidate,
    tables: &[Table],
    s: &Scenario,
    spectrum: &Spectrum,
    end: f64,
    dt: f64,
) -> Errors {
    let body = s.lengths[0] + s.lengths[1];
    let way = s.speed * end;
    // Of its way, a wave makes the coarse model's share in it; half the overlap counts.
    let coarse_way = way * (s.lengths[0] - 0.5 * c.overlap) / body;
    let passages = (way / body).max(1.0);
    let cutoff = 2.0 * s.speed / c.h;
    let (mut sums, mut lost) = ([[0.0; 2]; 2], 0.0);
    for (omega, a) in spectrum.omega.iter().zip(&spectrum.velocity) {
        let square = a * a;
        let loss = match (
            wavenumber(*omega, s.speed, c.h, dt),
            wavenumber(*omega, s.speed, s.spacings[1], dt),
        ) {
            (Some(coarse), Some(fine)) if *omega < 0.98 * cutoff => {
                let phase = (coarse - fine) * coarse_way;
                // Mean of |1 − e^{iφ}|² while the phase grows to its last value.
                let shift = if phase.abs() < 1e-4 {
                    phase * phase / 3.0
                } else {
                    2.0 * (1.0 - phase.sin() / phase)
                };
                shift + (passages * tables[c.table].loss(omega / cutoff)).min(2.0)
            }
            _ => {
                lost += square;
                2.0
            }
        };
        for (k, weight) in [square / (omega * omega), square].into_iter().enumerate() {
            sums[k][0] += weight * loss;
            sums[k][1] += weight;
        }
    }
    let root = |s: [f64; 2]| (s[0] / s[1].max(f64::MIN_POSITIVE)).sqrt();
    Errors {
        displacement: root(sums[0]),
        velocity: root(sums[1]),
        above_cutoff: lost / sums[1][1].max(f64::MIN_POSITIVE),
    }
}
