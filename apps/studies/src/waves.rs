//! Waves on the line: transmission, reflection and conservation of energy at an overlap.

use crate::line::{COARSE, FINE, Line, peak, pulse, rest, run};
use arlequin::core::effect::Absorber;
use arlequin::core::harmonic::{HarmonicOverlap, Port, Scattering};
use arlequin::core::nalgebra::Point3;
use arlequin::core::{Coupled, InterfaceReport, PrescribedMotion, Result, TimeFunction};
use arlequin::fem_ref::{FemField, generate};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// Results of a long pulse after it has met the overlap.
#[derive(Debug, Clone)]
pub struct Passage {
    /// Transmitted amplitude over the incident one.
    pub t: f64,
    /// Reflected amplitude over the incident one.
    pub r: f64,
    /// Relative change of the total energy.
    pub energy: f64,
    /// Largest drift of the invariant.
    pub drift: f64,
    /// Largest relative velocity jump.
    pub residual: f64,
    /// Set-up report of the interface.
    pub report: InterfaceReport,
}

/// Sends a pulse of half width 300 from the chain into the bar.
///
/// # Errors
/// Errors of the set-up and the steps.
pub fn long_pulse(line: &Line) -> Result<Passage> {
    let mut c = line.build(&rest, &pulse(600.0, 300.0, 0.0, -1.0))?;
    let before = c.energy();
    run(&mut c, 2600)?;
    Ok(Passage {
        // Away from the overlap, where only what passed or came back is left.
        t: peak(&c, COARSE, |x| x < -100.0),
        r: peak(&c, FINE, |x| x > 100.0),
        energy: (c.energy() - before) / before,
        drift: c.drift(),
        residual: c.constraint_residual(),
        report: c.interfaces()[0].report().clone(),
    })
}

/// Builds bar and chain with random velocities.
///
/// # Errors
/// Errors of the set-up.
pub fn random_state(line: &Line, seeds: [u64; 2]) -> Result<Coupled<f64>> {
    let mut subdomains = Vec::new();
    for (s, seed) in line.subdomains(&rest, &rest)?.into_iter().zip(seeds) {
        let mut next = crate::noise(seed);
        let n = s.model().layout().nodes;
        let v = (0..n).map(|_| next()).collect();
        subdomains.push(s.with_initial(vec![0.0; n], v)?);
    }
    line.build_with(subdomains)
}

/// Damping of waves that the coarse side cannot carry.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Damping {
    /// Largest rate, in units of `c/r`.
    pub rate: f64,
    /// Element length of the space that stays undamped; `None` for the mediator's.
    pub resolved: Option<f64>,
    /// Power with which the rate grows from the fine border.
    pub power: i32,
}

impl Damping {
    /// A rate of 0.2 that grows linearly; the mediator space stays undamped.
    pub const STANDARD: Self = Self {
        rate: 0.2,
        resolved: None,
        power: 1,
    };

    /// Returns the absorber for the chain of a line.
    ///
    /// # Errors
    /// Errors of meshes.
    pub fn effect(&self, line: &Line) -> Result<Absorber<f64>> {
        let (width, top, power) = (line.overlap, self.rate, self.power);
        // Zero at the fine border, where the chain must not notice the absorber.
        let rate = Arc::new(move |x: &Point3<f64>| top * (-x.x / width).clamp(0.0, 1.0).powi(power));
        Ok(match self.resolved {
            None => Absorber::new(line.mediator_space()?, rate),
            Some(h) => {
                let n = ((width / h).round() as usize).max(1);
                let mesh = generate::bar(-width, 0.0, n, 1.0)?;
                Absorber::new(Arc::new(FemField::new(mesh)), rate)
            }
        })
    }
}

/// Results of a packet after it has met the overlap.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Echo {
    /// Energy of the chain at the end, relative to the total at the start.
    pub back: f64,
    /// Total energy at the end, relative to the start.
    pub kept: f64,
    /// Largest drift of the invariant.
    pub drift: f64,
}

/// Sends a packet of the given wavelength and half width from the chain to the overlap.
///
/// # Errors
/// Errors of the set-up and the steps.
pub fn packet(line: &Line, wavelength: f64, width: f64, damping: Option<Damping>) -> Result<Echo> {
    let k = TAU / wavelength;
    // Phase velocity on the lattice, so that the packet travels in one direction.
    // A uniform wave travels at the speed of sound.
    let speed = if k > 0.0 { 2.0 * (k / 2.0).sin() / k } else { 1.0 };
    let [bar, chain] = line.subdomains(&rest, &pulse(width + 30.0, width, k, -speed))?;
    let chain = match damping {
        Some(d) => chain.with_effect(Box::new(d.effect(line)?)),
        None => chain,
    };
    let mut c = line.build_with(vec![bar, chain])?;
    let before = c.energy();
    let way = 2.0 * width + 150.0;
    // Short packets travel at the group velocity of the lattice, cos(k/2), which vanishes at a wavelength
    // of two spacings.
    let steps = (way / (k / 2.0).cos() / c.dt()) as usize;
    run(&mut c, steps)?;
    let fine = &c.subdomains()[FINE];
    Ok(Echo {
        back: (fine.kinetic_energy() + fine.internal_energy()) / before,
        kept: c.energy() / before,
        drift: c.drift(),
    })
}

/// Returns the line of the absorber check, with an overlap of four coarse elements.
#[must_use]
pub fn packet_line() -> Line {
    Line {
        overlap: 40.0,
        fine_bonds: 1000,
        coarse_elements: 100,
        ..Line::default()
    }
}

/// Largest deviations from a uniform strain of one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Patch {
    /// Deviation of a node's displacement, relative to the largest displacement.
    pub displacement: f64,
    /// Deviation of the strain of an element or a spring.
    pub strain: f64,
}

/// Computes the largest deviation of a displacement from uniform strain, relative to the largest
/// displacement.
///
/// # Errors
/// Errors of the set-up and the static solve.
pub fn patch(line: &Line) -> Result<f64> {
    Ok(patch_defects(line)?.displacement)
}

/// Computes the largest deviations from a uniform strain of one, in displacement and in strain.
///
/// # Errors
/// Errors of the set-up and the static solve.
pub fn patch_defects(line: &Line) -> Result<Patch> {
    let [bar, chain] = line.subdomains(&rest, &rest)?;
    let left = bar.model().nodes()[0].x;
    let last = chain.model().layout().nodes - 1;
    let right = chain.model().nodes()[last].x;
    let bar = bar.with_support(PrescribedMotion::fixed(vec![0]));
    // A strain of one over both models, whatever is between.
    let pull = PrescribedMotion {
        dofs: vec![last],
        amplitude: right - left,
        time: TimeFunction::Step,
    };
    let mut c = line.build_with(vec![bar, chain.with_support(pull)])?;
    let e = c.equilibrium(0.0)?;
    let mut worst = Patch {
        displacement: 0.0,
        strain: 0.0,
    };
    for (s, q) in c.subdomains().iter().zip(&e.displacements) {
        let x = s.model().nodes();
        for (x, q) in x.iter().zip(q) {
            let off = (q - (x.x - left)).abs() / (right - left);
            worst.displacement = worst.displacement.max(off);
        }
        for (x, q) in x.windows(2).zip(q.windows(2)) {
            let strain = (q[1] - q[0]) / (x[1].x - x[0].x);
            worst.strain = worst.strain.max((strain - 1.0).abs());
        }
    }
    Ok(worst)
}

/// Returns the line of the patch test: no coincident nodes, no floor of the weight.
#[must_use]
pub fn patch_line() -> Line {
    Line {
        h: 9.3,
        mediator: 5.0,
        epsilon: 0.0,
        coarse_elements: 12,
        fine_bonds: 80,
        ..Line::default()
    }
}

/// Computes reflection and transmission by harmonic analysis for a wave from the chain. Wavelengths are in
/// coarse elements.
///
/// # Errors
/// Errors of the set-up and the analysis.
pub fn scattering(line: &Line, wavelengths: &[f64]) -> Result<Vec<Scattering<f64>>> {
    scattering_from(line, FINE, wavelengths)
}

/// Computes reflection and transmission as [`scattering`] does, at the same frequencies, for a wave from
/// subdomain `side`.
///
/// # Errors
/// Errors of the set-up and the analysis.
pub fn scattering_from(line: &Line, side: usize, wavelengths: &[f64]) -> Result<Vec<Scattering<f64>>> {
    // Harmonic ports replace the distant ends, so short models are enough.
    let line = Line {
        coarse_elements: (line.overlap / line.h) as usize + 10,
        fine_bonds: line.overlap as usize + 40,
        ..line.clone()
    };
    let c = line.build(&rest, &rest)?;
    let last = c.subdomains()[FINE].model().layout().nodes - 1;
    let fine = Port {
        subdomain: FINE,
        dof: last,
        stiffness: 1.0,
        mass: 1.0,
        spacing: 1.0,
    };
    let coarse = Port {
        subdomain: COARSE,
        dof: 0,
        stiffness: 1.0 / line.h,
        mass: line.h,
        spacing: line.h,
    };
    let [incident, outgoing] = if side == FINE {
        [fine, coarse]
    } else {
        [coarse, fine]
    };
    let harmonic = HarmonicOverlap::new(&c, incident, outgoing)?;
    wavelengths
        .iter()
        // The frequency at which a wave in the chain has this wavelength.
        .map(|w| harmonic.response(2.0 * (PI / (w * line.h)).sin()))
        .collect()
}

/// Returns the largest reflected amplitude at wavelengths given in coarse elements.
///
/// # Errors
/// Errors of [`scattering`].
pub fn top_reflection(line: &Line, wavelengths: &[f64]) -> Result<f64> {
    let responses = scattering(line, wavelengths)?;
    Ok(responses.iter().fold(0.0, |m, s| m.max(s.reflection)))
}

/// Returns `count + 1` wavelengths from `first` to `last`, equally spaced in their logarithm.
#[must_use]
pub fn wavelengths(first: f64, last: f64, count: u32) -> Vec<f64> {
    (0..=count)
        .map(|n| first * (last / first).powf(f64::from(n) / f64::from(count)))
        .collect()
}

/// Velocities of the two models in the overlap while a pulse passes.
#[derive(Debug, Clone)]
pub struct Tie {
    /// Root mean square over the passage of the difference between the two velocity fields at the particles
    /// of the overlap, relative to the particles' velocity.
    pub difference: f64,
    /// Root mean square of the difference between the two mean velocities over the overlap, relative to the
    /// particles' mean.
    pub mean_difference: f64,
    /// Velocities of bar and chain in the middle of the overlap over time: `(t, bar, chain)`.
    pub middle: Vec<(f64, f64, f64)>,
}

/// Sends a steep pulse of the given half width into the overlap and compares the two velocity fields.
///
/// # Errors
/// Errors of the set-up and the steps.
pub fn tie(line: &Line, width: f64) -> Result<Tie> {
    let mut c = line.build(&rest, &pulse(width + 20.0, width, 0.0, -1.0))?;
    let inside: Vec<(usize, Point3<f64>)> = {
        let nodes = c.subdomains()[FINE].model().nodes();
        let numbered = nodes.iter().copied().enumerate();
        numbered
            .filter(|(_, x)| x.x >= -line.overlap && x.x <= 0.0)
            .collect()
    };
    let middle = Point3::new(-0.5 * line.overlap, 0.0, 0.0);
    let (mut jump, mut size, mut mean_jump, mut mean_size) = (0.0, 0.0, 0.0, 0.0);
    let mut history = Vec::new();
    for _ in 0..(2.0 * (2.0 * width + 20.0 + 2.0 * line.overlap)) as usize {
        run(&mut c, 1)?;
        let [bar, chain] = [&c.subdomains()[COARSE], &c.subdomains()[FINE]];
        let mut means = [0.0; 2];
        for (n, (k, x)) in inside.iter().enumerate() {
            let (v, w) = (bar.sample(x)?[1].x, chain.state().v[*k]);
            jump += (v - w).powi(2);
            size += w * w;
            // The trapezoidal rule is exact for both fields because every node of the bar coincides with a
            // particle.
            let share = if n == 0 || n + 1 == inside.len() { 0.5 } else { 1.0 };
            means[0] += share * v;
            means[1] += share * w;
        }
        mean_jump += (means[0] - means[1]).powi(2);
        mean_size += means[1] * means[1];
        history.push((c.time(), bar.sample(&middle)?[1].x, chain.sample(&middle)?[1].x));
    }
    Ok(Tie {
        difference: (jump / size).sqrt(),
        mean_difference: (mean_jump / mean_size).sqrt(),
        middle: history,
    })
}
