//! Runs that speak of two claims of the literature: that a wave out of the continuum is reflected more than
//! one out of the particles, and that a wide overlap with a fine mediator damps the global wave.

use crate::line::{COARSE, FINE, Line, pulse, rest, run};
use crate::waves;
use arlequin::core::{Coupled, Result, Silent};

/// Largest difference over the wavelengths (in coarse elements) between the two ways through an overlap: of
/// the reflected amplitudes, and of the shares of power that pass. Harmonic analysis.
///
/// # Errors
/// Those of the set-up and the analysis.
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

/// Displacement of node `to` (subdomain, number) over time after a unit impulse on node `from`, both
/// outside of the overlap.
///
/// # Errors
/// Those of the set-up and the steps.
pub fn impulse(line: &Line, from: [usize; 2], to: [usize; 2], steps: usize) -> Result<Vec<f64>> {
    // The mass that the run gives a node decides the velocity of an impulse.
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

/// Largest difference between what a bar node far from the overlap feels of an impulse on a particle and
/// what the particle feels of the same impulse on the bar node, over the largest of either.
///
/// # Errors
/// Those of the set-up and the steps.
pub fn reciprocity(line: &Line, steps: usize) -> Result<f64> {
    let bar = [COARSE, 2];
    let particle = [FINE, line.fine_bonds - 7];
    let [there, here] = [
        impulse(line, bar, particle, steps)?,
        impulse(line, particle, bar, steps)?,
    ];
    let top = there.iter().fold(0.0, |m: f64, u| m.max(u.abs()));
    let pairs = there.iter().zip(&here);
    Ok(pairs.fold(0.0, |m: f64, (a, b)| m.max((a - b).abs())) / top.max(f64::MIN_POSITIVE))
}

/// Share of the energy of a packet that comes back from the overlap, when it is sent out of the given
/// subdomain. The wavelength is that in the chain, the half width that of the envelope there; the frequency
/// is the same both ways.
///
/// # Errors
/// Those of the set-up and the steps.
pub fn comes_back(line: &Line, side: usize, wavelength: f64, width: f64) -> Result<f64> {
    let omega = 2.0 * (std::f64::consts::PI / wavelength).sin();
    // Wavenumber, phase and group speed of a lattice of spacing a.
    let lattice = |a: f64| {
        let k = 2.0 / a * (0.5 * omega * a).asin();
        (k, omega / k, (0.5 * k * a).cos())
    };
    let (k, phase, fast) = lattice(1.0);
    let mut c = if side == FINE {
        line.build(&rest, &pulse(width + 30.0, width, k, -phase))?
    } else {
        let (k, phase, slow) = lattice(line.h);
        let wide = width * slow / fast;
        let start = -(line.overlap + wide + 30.0);
        line.build(&pulse(start, wide, k, phase), &rest)?
    };
    let all = |c: &Coupled<f64>| {
        let s = &c.subdomains()[side];
        s.kinetic_energy() + s.internal_energy()
    };
    let before = all(&c);
    let way = (2.0 * width + 100.0 + 2.0 * line.overlap) / lattice(line.h).2.min(fast);
    let steps = (way / c.dt()) as usize;
    run(&mut c, steps)?;
    Ok(all(&c) / before)
}

/// What is left of a pulse that runs to and fro between the free ends of bar and chain.
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
/// Those of the set-up and the steps.
pub fn to_and_fro(line: &Line, width: f64, rounds: usize) -> Result<ToAndFro> {
    let mut c = line.build(&rest, &pulse(width + 20.0, width, 0.0, -1.0))?;
    let before = c.energy();
    let length = line.h * line.coarse_elements as f64 + line.fine_bonds as f64 - line.overlap;
    let steps = (2.0 * length * rounds as f64 / c.dt()) as usize;
    run(&mut c, steps)?;
    Ok(ToAndFro {
        kept: c.energy() / before,
        drift: c.drift(),
    })
}
