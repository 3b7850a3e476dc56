//! Waves on the line: what passes an overlap, what comes back, what is kept.

use crate::line::{COARSE, FINE, Line, peak, pulse, rest, run};
use arlequin::core::effect::Absorber;
use arlequin::core::harmonic::{HarmonicOverlap, Port, Scattering};
use arlequin::core::nalgebra::Point3;
use arlequin::core::{Coupled, InterfaceReport, PrescribedMotion, Result, TimeFunction};
use arlequin::fem_ref::{FemField, generate};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// What became of a long pulse.
#[derive(Debug, Clone)]
pub struct Passage {
    /// Transmitted amplitude over the incident one.
    pub t: f64,
    /// Reflected amplitude.
    pub r: f64,
    /// Relative change of the plain total energy.
    pub energy: f64,
    /// Largest drift of the invariant.
    pub drift: f64,
    /// Largest relative velocity jump.
    pub residual: f64,
    /// What the set-up of the interface found.
    pub report: InterfaceReport,
}

/// Sends a pulse of half width 300 out of the chain into the bar.
///
/// # Errors
/// Those of the set-up and the steps.
pub fn long_pulse(line: &Line) -> Result<Passage> {
    let mut c = line.build(&rest, &pulse(600.0, 300.0, 0.0, -1.0))?;
    let before = c.energy();
    run(&mut c, 2600)?;
    Ok(Passage {
        t: peak(&c, COARSE, |x| x < -100.0),
        r: peak(&c, FINE, |x| x > 100.0),
        energy: (c.energy() - before) / before,
        drift: c.drift(),
        residual: c.constraint_residual(),
        report: c.interfaces()[0].report().clone(),
    })
}

/// Bar and chain with random velocities.
///
/// # Errors
/// Those of the set-up.
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

/// Damping of what the coarse side cannot carry.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Damping {
    /// Largest rate, in units of `c/r`.
    pub rate: f64,
    /// Element of the space that stays undamped; the mediator if none.
    pub resolved: Option<f64>,
    /// Power with which the rate grows from the fine border.
    pub power: i32,
}

impl Damping {
    /// A rate of 0.2 that grows linearly; the mediator stays undamped.
    pub const STANDARD: Self = Self {
        rate: 0.2,
        resolved: None,
        power: 1,
    };

    /// The absorber of the chain of a line.
    ///
    /// # Errors
    /// Those of meshes.
    pub fn effect(&self, line: &Line) -> Result<Absorber<f64>> {
        let (width, top, power) = (line.overlap, self.rate, self.power);
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

/// What became of a packet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Echo {
    /// Energy left in the chain, relative to the start.
    pub back: f64,
    /// Energy left altogether.
    pub kept: f64,
    /// Largest drift of the invariant.
    pub drift: f64,
}

/// Sends a packet of the given wavelength and half width out of the chain against the overlap.
///
/// # Errors
/// Those of the set-up and the steps.
pub fn packet(line: &Line, wavelength: f64, width: f64, damping: Option<Damping>) -> Result<Echo> {
    let k = TAU / wavelength;
    // Group and phase speed on the lattice, so that the packet is one-way.
    let speed = if k > 0.0 { 2.0 * (k / 2.0).sin() / k } else { 1.0 };
    let [bar, chain] = line.subdomains(&rest, &pulse(width + 30.0, width, k, -speed))?;
    let chain = match damping {
        Some(d) => chain.with_effect(Box::new(d.effect(line)?)),
        None => chain,
    };
    let mut c = line.build_with(vec![bar, chain])?;
    let before = c.energy();
    let way = 2.0 * width + 150.0;
    // Short packets travel at the group speed of the lattice, cos(k/2), which goes to zero at two spacings.
    let steps = (way / (k / 2.0).cos() / c.dt()) as usize;
    run(&mut c, steps)?;
    let fine = &c.subdomains()[FINE];
    Ok(Echo {
        back: (fine.kinetic_energy() + fine.internal_energy()) / before,
        kept: c.energy() / before,
        drift: c.drift(),
    })
}

/// The line the packets of the absorber's check meet: overlap of four coarse elements.
#[must_use]
pub fn packet_line() -> Line {
    Line {
        overlap: 40.0,
        fine_bonds: 1000,
        coarse_elements: 100,
        ..Line::default()
    }
}

/// Largest deviations from a uniform strain, relative to the largest displacement and to the strain.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Patch {
    /// Of the displacement of a node.
    pub displacement: f64,
    /// Of the strain of an element or a spring.
    pub strain: f64,
}

/// Largest deviation from a uniform strain, relative to the largest displacement.
///
/// # Errors
/// Those of the set-up and the static solve.
pub fn patch(line: &Line) -> Result<f64> {
    Ok(patch_defects(line)?.displacement)
}

/// Deviations from a uniform strain of one, in displacement and in strain.
///
/// # Errors
/// Those of the set-up and the static solve.
pub fn patch_defects(line: &Line) -> Result<Patch> {
    let [bar, chain] = line.subdomains(&rest, &rest)?;
    let left = bar.model().nodes()[0].x;
    let last = chain.model().layout().nodes - 1;
    let right = chain.model().nodes()[last].x;
    let bar = bar.with_support(PrescribedMotion::fixed(vec![0]));
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

/// The line of the patch test: nothing coincides, no floor on the weight.
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

/// Reflection and transmission at wavelengths given in coarse elements, from the harmonic analysis; the
/// wave comes out of the chain.
///
/// # Errors
/// Those of the set-up and the analysis.
pub fn scattering(line: &Line, wavelengths: &[f64]) -> Result<Vec<Scattering<f64>>> {
    scattering_from(line, FINE, wavelengths)
}

/// The same at the same frequencies for a wave that comes out of subdomain `side`.
///
/// # Errors
/// Those of the set-up and the analysis.
pub fn scattering_from(line: &Line, side: usize, wavelengths: &[f64]) -> Result<Vec<Scattering<f64>>> {
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
        .map(|w| harmonic.response(2.0 * (PI / (w * line.h)).sin()))
        .collect()
}

/// Largest reflected amplitude at wavelengths given in coarse elements.
///
/// # Errors
/// Those of [`scattering`].
pub fn top_reflection(line: &Line, wavelengths: &[f64]) -> Result<f64> {
    let all = scattering(line, wavelengths)?;
    Ok(all.iter().fold(0.0, |m, s| m.max(s.reflection)))
}

/// `count + 1` wavelengths from `first` to `last`, equally spaced in their logarithm.
#[must_use]
pub fn wavelengths(first: f64, last: f64, count: u32) -> Vec<f64> {
    (0..=count)
        .map(|n| first * (last / first).powf(f64::from(n) / f64::from(count)))
        .collect()
}

/// Overlap velocities of the two models at one instant and over a passage.
#[derive(Debug, Clone)]
pub struct Tie {
    /// Root mean square over the passage of the difference of the two velocity fields at the particles of
    /// the overlap, relative to that of the particles.
    pub difference: f64,
    /// The same for the mean over the overlap.
    pub mean_difference: f64,
    /// Velocity of bar and chain in the middle of the overlap over time: `(t, bar, chain)`.
    pub middle: Vec<(f64, f64, f64)>,
}

/// Lets a steep pulse of the given half width run into the overlap and compares the two velocity fields.
///
/// # Errors
/// Those of the set-up and the steps.
pub fn tie(line: &Line, width: f64) -> Result<Tie> {
    let mut c = line.build(&rest, &pulse(width + 20.0, width, 0.0, -1.0))?;
    let inside: Vec<(usize, Point3<f64>)> = {
        let nodes = c.subdomains()[FINE].model().nodes();
        let all = nodes.iter().copied().enumerate();
        all.filter(|(_, x)| x.x >= -line.overlap && x.x <= 0.0).collect()
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
            // The trapezoidal rule: exact for both fields, as every node of the bar is at a particle.
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
