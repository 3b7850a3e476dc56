//! Predicts the error of a coupling before it is run. Dispersion follows from the coarse lattice and the
//! distance that a wave travels in it, reflection and transmission of the overlap from harmonic analysis.

use super::path::{self, Arrival};
use super::scenario::{Scenario, Spectrum};
use crate::error::{Result, core};
use crate::setup;
use crate::spec::{JunctionKind, ProfileKind};
use arlequin::core::harmonic::{HarmonicOverlap, Port};
use arlequin::core::nalgebra::Point3;
use arlequin::core::{
    Coupled, Elastic, InterfaceSpec, Interpolation, L2, Mediator, Ramp, Slab, Subdomain, TimeStep, Weights,
};
use arlequin::fem_ref::{FemField, FemModel, generate};
use rayon::prelude::*;
use spring_chain::Chain;
use std::sync::Arc;

/// Largest ratio of coarse to fine spacing in the analysis: above it the reflection hardly changes, but the
/// matrices grow.
const FINEST: f64 = 10.0;
/// Number of frequencies in a table of losses.
const POINTS: usize = 20;

/// One choice of settings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Candidate {
    /// Length of the coarse elements \[m\].
    pub h: f64,
    /// Coarse spacing as it is written \[m\].
    pub spacing: f64,
    /// Fine spacing \[m\].
    pub r: f64,
    /// Mediator spacing \[m\].
    pub h_b: f64,
    /// Width of the overlap \[m\].
    pub overlap: f64,
    /// Profile of the weights.
    pub profile: ProfileKind,
    /// Junction length over mediator spacing; `None` for L2.
    pub length_ratio: Option<f64>,
    /// Index of the table with the losses of its overlap.
    pub table: usize,
}

impl Candidate {
    /// Returns whether both candidates have the same meshes and the same overlap.
    pub(super) fn is_made_like(&self, other: &Self) -> bool {
        let sizes = |c: &Self| [c.spacing, c.h_b, c.overlap].map(f64::to_bits);
        sizes(self) == sizes(other)
    }
}

/// Shape of an overlap in units of the coarse spacing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Form {
    /// Coarse over fine spacing.
    pub ratio: f64,
    /// Mediator spacing.
    pub h_b: f64,
    /// Width.
    pub overlap: f64,
    /// Weight.
    pub profile: ProfileKind,
    /// Junction.
    pub junction: JunctionKind,
    /// Junction length over mediator spacing.
    pub length_ratio: Option<f64>,
}

/// Loss `|r|² + (1 − |t|)²` of an overlap over frequency; frequencies in units of the coarse cutoff.
#[derive(Debug, Clone)]
pub(super) struct Table {
    frequencies: Vec<f64>,
    losses: Vec<f64>,
    /// Largest reflected amplitude for wavelengths above 4.2 coarse spacings.
    pub top_reflection: f64,
}

/// Computes the tables of several forms in parallel.
pub(super) fn tables(forms: &[Form]) -> Result<Vec<Table>> {
    forms.par_iter().map(table).collect()
}

/// Couples a chain and a bar of unit modulus, density and element length by the overlap of the form.
fn miniature(f: &Form) -> arlequin::core::Result<Coupled<f64>> {
    let r = 1.0 / f.ratio.min(FINEST);
    // Both models go at least four spacings beyond the overlap, where the ports attach.
    let (bonds, elements) = (((f.overlap / r).round() + 4.0), f.overlap.ceil() + 4.0);
    let start = f.overlap - bonds * (f.overlap + 4.0 * r) / bonds;
    let h = (f.overlap - start) / bonds;
    let chain = Chain::new("chain", start, h, bonds as usize, h, 1.0 / h)?;
    let line = |to: f64, n: f64| generate::bar(0.0, to, n as usize, 1.0);
    let bar = FemModel::new("bar", line(elements, elements)?, Elastic::new(1.0, 0.0, 1.0)?)?;
    let mediator = FemField::new(line(f.overlap, (f.overlap / f.h_b).round().max(1.0))?);
    let point = |x: f64| Point3::new(x, 0.0, 0.0);
    let slab = Arc::new(Slab::between(point(0.0), point(f.overlap))?);
    let half = (f.profile == ProfileKind::Constant).then_some(0.5);
    let stations = setup::stations(&*slab, mediator.nodes());
    // The floor that scenes have by default.
    let ramp = Ramp::new(slab, f.profile.profile(half, &stations)?, 1e-6)?;
    let coarse = Weights::from_weight(Arc::new(ramp));
    let fine = Weights::complement_of(std::slice::from_ref(&coarse));
    let length = f.length_ratio.map_or(0.25 * mediator.spacing(), |l| l * f.h_b);
    let tie = InterfaceSpec {
        junction: f.junction.junction(length)?,
        ..InterfaceSpec::new("joint", 0, 1, Arc::new(mediator), L2)
    };
    let parts = vec![Subdomain::coarse(bar, coarse), Subdomain::fine(chain, fine)];
    Coupled::new(parts, vec![tie], TimeStep::Fraction(0.9), None)
}

fn table(f: &Form) -> Result<Table> {
    let run = miniature(f).map_err(core("interface"))?;
    let nodes = |k: usize| run.subdomains()[k].model().nodes();
    let spacing = |k: usize| (nodes(k)[1].x - nodes(k)[0].x).abs();
    let port = |subdomain: usize, dof: usize| {
        let h = spacing(subdomain);
        // With unit modulus and density, a bond has the stiffness 1/h and a node the mass h.
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
        // The share of the cutoff of a wave of 4.2 elements is sin(π/4.2).
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

/// Predicted relative errors against the fine model everywhere.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Errors {
    /// Error of displacements \[–\].
    pub displacement: f64,
    /// Error of velocities \[–\].
    pub velocity: f64,
    /// Share of the velocity signal's energy that the coarse lattice cannot carry \[–\].
    pub above_cutoff: f64,
}

impl Errors {
    /// Returns the larger of both errors.
    pub fn worst(&self) -> f64 {
        self.displacement.max(self.velocity)
    }
}

/// A lattice: spacing \[m\], and share of element-wise strains in its forces.
type Lattice = [f64; 2];

/// Returns the wavenumber of a lattice of spacing `h` with time steps `Δt`; `None` above its cutoff. With
/// strains by elements `sin(ω Δt/2) = (c Δt/h) sin(κ h/2)`. Strains that are smoothed over the cells of nodes
/// reach over two spacings and replace `sin(κ h/2)` by `sin(κ h)/2`. With a share `a` of element-wise
/// strains, the squares of both terms are mixed.
fn wavenumber(omega: f64, speed: f64, [h, a]: Lattice, dt: f64) -> Option<f64> {
    let q = (h / (speed * dt) * (0.5 * omega * dt).sin()).powi(2);
    // y - (1 - a) y^2 = q for y = sin^2 of half the phase between neighbours.
    let square = if a < 1.0 {
        let root = 1.0 - 4.0 * (1.0 - a) * q;
        if root <= 0.0 {
            return None;
        }
        // The smaller root, written so that small `q` keep their digits.
        2.0 * q / (1.0 + root.sqrt())
    } else {
        q
    };
    (square < 1.0).then(|| 2.0 / h * square.sqrt().asin())
}

/// Effect of the coupling on one frequency.
#[derive(Debug, Clone, Copy)]
enum Fate {
    /// Difference of the wavenumbers \[1/m\], and loss per passage of the overlap.
    Carried(f64, f64),
    /// The coarse lattice does not carry the frequency.
    Lost,
}

/// Returns `|1 − e^{iφ}|²`, or its mean while the phase grows to `φ`.
fn shift(phase: f64, growing: bool) -> f64 {
    if !growing {
        return 2.0 * (1.0 - phase.cos());
    }
    // Below this phase `1 − sin φ/φ` would lose its digits.
    if phase.abs() < 1e-4 {
        phase * phase / 3.0
    } else {
        2.0 * (1.0 - phase.sin() / phase)
    }
}

/// Returns the errors of a candidate in a run until `end` \[s\] with own steps `dt` \[s\].
pub(super) fn errors(
    c: &Candidate,
    tables: &[Table],
    s: &Scenario,
    spectrum: &Spectrum,
    end: f64,
    dt: f64,
) -> Errors {
    let cutoff = 2.0 * s.speed / c.h;
    let lattices = [[c.h, s.elementwise[0]], [c.r, s.elementwise[1]]];
    let fate = |omega: &f64| {
        let [coarse, fine] = lattices.map(|l| wavenumber(*omega, s.speed, l, dt));
        match (coarse, fine) {
            // The tables of losses end at 0.98 of the cutoff.
            (Some(coarse), Some(fine)) if *omega < 0.98 * cutoff => {
                Fate::Carried(coarse - fine, tables[c.table].loss(omega / cutoff))
            }
            _ => Fate::Lost,
        }
    };
    let fates: Vec<Fate> = spectrum.omega.iter().map(fate).collect();
    let squares = || spectrum.velocity.iter().map(|a| a * a);
    let total: f64 = squares().sum();
    let lost = squares().zip(&fates).filter(|(_, f)| matches!(f, Fate::Lost));
    let above_cutoff = lost.map(|(a, _)| a).sum::<f64>() / total.max(f64::MIN_POSITIVE);
    let way = s.speed * end;
    let arrivals = spectrum
        .origin
        .and_then(|o| path::arrivals(s, &o, c.overlap, way));
    let [displacement, velocity] = match arrivals {
        Some(arrivals) => at_probes(&arrivals, &fates, s, spectrum, end),
        None => everywhere(c, &fates, s, spectrum, way),
    };
    Errors {
        displacement,
        velocity,
        above_cutoff,
    }
}

/// Returns the errors at the probes as sums over arrivals. This assumes a signal that is short compared with
/// the time between two arrivals.
fn at_probes(
    arrivals: &[Vec<Arrival>; 2],
    fates: &[Fate],
    s: &Scenario,
    spectrum: &Spectrum,
    end: f64,
) -> [f64; 2] {
    let total: f64 = spectrum.velocity.iter().map(|a| a * a).sum();
    [0, 1].map(|kind| {
        let mut sums = [0.0; 2];
        for p in &arrivals[kind] {
            let seen = spectrum.energies(end - p.way / s.speed);
            let mut error = 0.0;
            for ((omega, a), fate) in spectrum.omega.iter().zip(&spectrum.velocity).zip(fates) {
                // Two signals that have nothing in common differ by the sum of their energies: a loss is 2 at
                // most.
                let loss = match fate {
                    Fate::Carried(k, once) => shift(k * p.coarse, false) + (p.passages * once).min(2.0),
                    Fate::Lost if p.passages > 0.0 => 2.0,
                    Fate::Lost => 0.0,
                };
                // The amplitude of a displacement is that of the velocity over ω.
                error += a * a * loss / if kind == 0 { omega * omega } else { 1.0 };
            }
            // If the run ends within a signal, the error counts in the same proportion as the signal.
            sums[0] += error / total * seen[1];
            sums[1] += seen[kind];
        }
        (sums[0] / sums[1].max(f64::MIN_POSITIVE)).sqrt()
    })
}

/// Returns the errors for a signal of unknown origin, as if probes were everywhere on its path.
fn everywhere(c: &Candidate, fates: &[Fate], s: &Scenario, spectrum: &Spectrum, way: f64) -> [f64; 2] {
    let body = s.lengths[0] + s.lengths[1];
    // The distance in the coarse model is its share of the body, with half of the overlap counted as coarse.
    let coarse_way = way * (s.lengths[0] - 0.5 * c.overlap) / body;
    let passages = (way / body).max(1.0);
    let mut sums = [[0.0; 2]; 2];
    for ((omega, a), fate) in spectrum.omega.iter().zip(&spectrum.velocity).zip(fates) {
        let loss = match fate {
            Fate::Carried(k, once) => shift(k * coarse_way, true) + (passages * once).min(2.0),
            Fate::Lost => 2.0,
        };
        for (sum, weight) in sums.iter_mut().zip([a * a / (omega * omega), a * a]) {
            sum[0] += weight * loss;
            sum[1] += weight;
        }
    }
    sums.map(|s| (s[0] / s[1].max(f64::MIN_POSITIVE)).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Scene;

    #[test]
    fn lattices_lag_as_their_strains_are_taken() {
        // Long waves under small steps: (κh)²/24 by elements, (κh)²/6 smoothed over two spacings, in
        // between mixed.
        let (h, omega) = (0.1, 1.0);
        for (share, expected) in [(1.0, 1.0 / 24.0), (0.0, 1.0 / 6.0), (0.5, 0.625 / 6.0)] {
            let k = wavenumber(omega, 1.0, [h, share], 1e-6).unwrap_or_default();
            let lag = (k - omega) / (omega * h * h);
            assert!(
                (lag / expected - 1.0).abs() < 0.02,
                "{share}: {lag} for {expected}"
            );
        }
        assert!(wavenumber(21.0, 1.0, [h, 1.0], 1e-6).is_none());
        assert!(wavenumber(10.5, 1.0, [h, 0.0], 1e-6).is_none());
    }

    /// Between equal lattices `|r|² + |t|² = 1`, so that the largest loss belongs to the largest reflection.
    #[test]
    fn the_loss_of_an_overlap_counts_what_it_reflects() {
        for (overlap, profile) in [(2.0, ProfileKind::Linear), (4.0, ProfileKind::Cubic)] {
            let form = Form {
                ratio: 1.0,
                h_b: 2.0,
                overlap,
                profile,
                junction: JunctionKind::L2,
                length_ratio: None,
            };
            let found = table(&form).expect("a table");
            let long = found.frequencies.iter().zip(&found.losses);
            let worst = long
                .filter(|(f, _)| **f < 0.68)
                .fold(0.0f64, |m, (_, l)| m.max(*l));
            let r = found.top_reflection;
            let expected = r * r + (1.0 - (1.0 - r * r).sqrt()).powi(2);
            assert!(
                r > 1e-3 && (worst / expected - 1.0).abs() < 1e-6,
                "{overlap}: {worst}, not {expected}"
            );
        }
    }

    /// A chain and a bar with the same spacing.
    const ALIKE: &str = r#"
[model.bar]
kind = "fem"
role = "coarse"
shape.bar = { from = 0, to = 8, section = 1 }
spacing = 1
material = { young = 1, density = 1 }
[model.chain]
kind = "chain"
role = "fine"
shape.bar = { from = -4, to = 4, section = 1 }
divisions = [8]
material = { young = 1, density = 1 }
[interface.joint]
coarse = "bar"
fine = "chain"
overlap.slab = { fine = [0, 0, 0], coarse = [4, 0, 0] }
weight = { profile = "cubic" }
mediator = { spacing = 1 }
junction = { kind = "l2" }
[time]
steps = 1
"#;

    /// Errors for a body of equal lattices, in which nothing disperses and only the overlap loses energy.
    /// Without a probe the signal is slow and of unknown origin; with a probe at `x` it is a short wave that
    /// starts 2 m before the overlap.
    fn alike(end: f64, loss: f64, probe: Option<f64>) -> Errors {
        let more = probe.map_or_else(String::new, |x| {
            format!(
                "[[initial]]\nwave = {{ component = \"x\", along = \"x\", centre = -2, width = 0.5, amplitude = 1 }}\n\
                 [probe.p]\nmodel = \"bar\"\nat = [{x}, 0, 0]\nquantity = \"velocity\"\ncomponent = \"x\"\n"
            )
        });
        let scene = Scene::from_text(ALIKE.to_owned() + &more).expect("a scene");
        let scene = scene.spec();
        let mut s = super::super::scenario::scenario(scene).expect("a scenario");
        let (h, dt, frequency) = match probe {
            None => (1.0, 0.5, Some(0.01)),
            Some(_) => (1e-3, 5e-4, None),
        };
        s.spacings = [h; 3];
        let spectrum = super::super::scenario::spectrum(scene, &s, end, frequency).expect("a spectrum");
        let table = Table {
            frequencies: vec![0.0, 1.0],
            losses: vec![loss; 2],
            top_reflection: 0.0,
        };
        let c = Candidate {
            h,
            spacing: h,
            r: h,
            h_b: h,
            overlap: 4.0,
            profile: ProfileKind::Cubic,
            length_ratio: None,
            table: 0,
        };
        errors(&c, &[table], &s, &spectrum, end, dt)
    }

    /// A probe behind the overlap sees the loss of one passage. A probe before it sees the loss of two, after
    /// the reflection at the far end.
    #[test]
    fn a_probe_sees_the_loss_of_the_passages_before_it() {
        for (probe, end, passages) in [(6.0, 10.0, 1.0), (-3.0, 22.0, 2.0)] {
            for reflection in [0.1, 0.05, 0.0] {
                let found = alike(end, reflection * reflection, Some(probe)).velocity;
                let expected = f64::sqrt(passages) * reflection;
                assert!(
                    (found - expected).abs() < 1e-6,
                    "at {probe} m: {found}, not {expected}"
                );
            }
        }
    }

    /// With a loss `|r|² + (1 − |t|)²` per passage, `n` passages give the error `√n |r|`, and at most that of
    /// two signals.
    #[test]
    fn an_error_is_the_loss_of_the_overlap_where_the_lattices_are_alike() {
        let body = 4.0 + 4.0 + 4.0; // the coarse bar of 8 m and the chain's own 4 m
        for (passages, reflection, expected) in [
            (1.0, 0.1, 0.1),
            (4.0, 0.1, 0.2),
            (1.0, 0.0, 0.0),
            (1e6, 0.5, 2f64.sqrt()),
        ] {
            let e = alike(passages * body, reflection * reflection, None);
            for found in [e.displacement, e.velocity] {
                assert!(
                    (found - expected).abs() < 1e-3,
                    "{passages} passages: {found}, not {expected}"
                );
            }
        }
    }
}
