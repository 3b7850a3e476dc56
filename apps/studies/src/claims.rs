//! Runs that test two claims of the literature: a wave from the continuum is reflected more than one from
//! the particles, and a wide overlap with a fine mediator damps the global wave.

use crate::line::{COARSE, FINE, Line, pulse, rest, run};
use crate::waves;
use arlequin::core::{Coupled, Result, Silent};

/// Compares both directions through an overlap by harmonic analysis. Returns the largest differences of the
/// reflected amplitudes and of the shares of power that pass, over the wavelengths (in coarse elements).
///
/// # Errors
/// Errors of the set-up and the analysis.
pub fn one_way_beside_the_other(line: &Line, wavelengths: &[f64]) -> Result<[f64; 2]> {
    let out = waves::scattering_from(line, FINE, wavelengths)?;
    let back = waves::scattering_from(line, COARSE, wavelengths)?;
    let pairs = || out.iter().zip(&back);
    let most = |d: &mut dyn Iterator<Item = f64>| d.fold(0.0, f64::max);
    Ok([
        most(&mut pairs().map(|(a, b)| (a.reflection - b.reflection).abs())),
        most(&mut pairs().map(|(a, b)| (a.transmitted_power - b.transmitted_power).abs())),
    ])
}

/// Returns the displacement of node `to` (subdomain, number) over time after a unit impulse on node `from`.
/// Both nodes are outside of the overlap.
///
/// # Errors
/// Errors of the set-up and the steps.
pub fn impulse(line: &Line, from: [usize; 2], to: [usize; 2], steps: usize) -> Result<Vec<f64>> {
    // The velocity of a unit impulse follows from the weighted mass of the run.
    let mass = line.build(&rest, &rest)?.subdomains()[from[0]].inertia()[from[1]];
    let mut parts = Vec::new();
    for (k, s) in line.subdomains(&rest, &rest)?.into_iter().enumerate() {
        let n = s.model().layout().nodes;
        let mut v = vec![0.0; n];
        if k == from[0] {
            v[from[1]] = 1.0 / mass;
        }
        parts.push(s.with_initial(vec![0.0; n], v)?);
    }
    let mut c = line.build_with(parts)?;
    let mut out = Vec::with_capacity(steps);
    for _ in 0..steps {
        c.advance(&mut Silent)?;
        out.push(c.subdomains()[to[0]].state().q[to[1]]);
    }
    Ok(out)
}

/// Compares the motion of a bar node far from the overlap after an impulse on a particle with the motion of
/// that particle after the same impulse on the bar node. Returns the largest difference over the largest
/// displacement of the particle.
///
/// # Errors
/// Errors of the set-up and the steps.
pub fn reciprocity(line: &Line, steps: usize) -> Result<f64> {
    let bar = [COARSE, 2];
    let particle = [FINE, line.fine_bonds - 7];
    let [at_particle, at_bar] = [
        impulse(line, bar, particle, steps)?,
        impulse(line, particle, bar, steps)?,
    ];
    let top = at_particle.iter().fold(0.0, |m: f64, u| m.max(u.abs()));
    let pairs = at_particle.iter().zip(&at_bar);
    // A motionless particle would make the ratio 0/0.
    Ok(pairs.fold(0.0, |m: f64, (a, b)| m.max((a - b).abs())) / top.max(f64::MIN_POSITIVE))
}

/// Returns the share of a packet's energy that comes back from the overlap when the packet starts in
/// subdomain `side`. Wavelength and half width of the envelope are those in the chain; a packet from the
/// bar gets the same frequency.
///
/// # Errors
/// Errors of the set-up and the steps.
pub fn comes_back(line: &Line, side: usize, wavelength: f64, width: f64) -> Result<f64> {
    // The dispersion of the chain, `ω = 2 sin(k/2)`: the packet from the bar gets the same frequency.
    let omega = 2.0 * (std::f64::consts::PI / wavelength).sin();
    // Wavenumber, phase velocity and group velocity of a lattice of spacing a.
    let lattice = |a: f64| {
        let k = 2.0 / a * (0.5 * omega * a).asin();
        (k, omega / k, (0.5 * k * a).cos())
    };
    let (k, phase, fast) = lattice(1.0);
    let mut c = if side == FINE {
        line.build(&rest, &pulse(width + 30.0, width, k, -phase))?
    } else {
        let (k, phase, slow) = lattice(line.h);
        // Shorter by the ratio of group velocities, so that the packet lasts as long as in the chain.
        let wide = width * slow / fast;
        // The packet starts wholly outside of the overlap.
        let start = -(line.overlap + wide + 30.0);
        line.build(&pulse(start, wide, k, phase), &rest)?
    };
    let side_energy = |c: &Coupled<f64>| {
        let s = &c.subdomains()[side];
        s.kinetic_energy() + s.internal_energy()
    };
    let before = side_energy(&c);
    // Long enough for the slower lattice to bring the reflected packet back out of the overlap.
    // At the slower of the two group velocities.
    let way = (2.0 * width + 100.0 + 2.0 * line.overlap) / lattice(line.h).2.min(fast);
    let steps = (way / c.dt()) as usize;
    run(&mut c, steps)?;
    Ok(side_energy(&c) / before)
}

/// Energy that remains of a pulse which runs to and fro between the free ends of bar and chain.
#[derive(Debug, Clone, Copy)]
pub struct ToAndFro {
    /// Kinetic and internal energy at the end over that at the start.
    pub kept: f64,
    /// Largest drift of the invariant.
    pub drift: f64,
}

/// Lets a pulse of half width `width` pass the overlap `2 rounds` times.
///
/// # Errors
/// Errors of the set-up and the steps.
pub fn to_and_fro(line: &Line, width: f64, rounds: usize) -> Result<ToAndFro> {
    let mut c = line.build(&rest, &pulse(width + 20.0, width, 0.0, -1.0))?;
    // One round passes both models twice, less the overlap that they share.
    let before = c.energy();
    let length = line.h * line.coarse_elements as f64 + line.fine_bonds as f64 - line.overlap;
    let steps = (2.0 * length * rounds as f64 / c.dt()) as usize;
    run(&mut c, steps)?;
    Ok(ToAndFro {
        kept: c.energy() / before,
        drift: c.drift(),
    })
}
