//! Harmonic analysis of an overlap: reflection and transmission per frequency, with exact radiation on both
//! sides.
//!
//! The coupled system is cut at two ends, and each end is continued by a uniform lattice of springs `k`,
//! masses `m` and spacing `h` that carries waves `e^{i(ωt ∓ κx)}`, `sin²(κh/2) = ω²m/(4k)`. One small complex
//! system per frequency remains, `[K − ω²M + Z, ±Bᵀ; ±B, 0]`, solved in milliseconds. Use it to choose
//! weight, mediator and overlap width.

use crate::coupled::Coupled;
use crate::error::invalid;
use crate::{Error, Real, Result};
use nalgebra::{Complex, ComplexField, DMatrix, DVector};

/// End of a subdomain that a uniform lattice continues to infinity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Port<T> {
    /// Number of the subdomain.
    pub subdomain: usize,
    /// End unknown, which carries half a cell.
    pub dof: usize,
    /// Stiffness between two masses \[N/m\].
    pub stiffness: T,
    /// Mass of a whole cell \[kg\].
    pub mass: T,
    /// Spacing \[m\].
    pub spacing: T,
}

/// Response to a unit wave.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scattering<T> {
    /// Modulus of the reflected amplitude.
    pub reflection: T,
    /// Modulus of the transmitted amplitude.
    pub transmission: T,
    /// Share of the incident power that comes back.
    pub reflected_power: T,
    /// Share of the incident power that passes.
    pub transmitted_power: T,
    /// Wavelength on the incident side \[m\].
    pub wavelength: T,
    /// Smallest and largest modulus of the strain between neighbouring nodes of either model (overlap
    /// included), over the strain of the incident wave. Both are one if the overlap does not disturb the
    /// wave.
    pub strain: [T; 2],
}

/// Matrices of a coupled one-dimensional system between two ports.
#[derive(Debug, Clone)]
pub struct HarmonicOverlap<T: Real> {
    stiffness: DMatrix<T>,
    mass: DVector<T>,
    incident: Port<T>,
    outgoing: Port<T>,
    rows: [usize; 2],
    /// Neighbouring unknowns and their distance \[m\].
    neighbours: Vec<(usize, usize, T)>,
}

impl<T: Real> HarmonicOverlap<T> {
    /// Takes the matrices of a run of bars and chains; the wave comes in at `incident` and leaves at
    /// `outgoing`.
    ///
    /// # Errors
    /// [`Error::Unsupported`] for models that are not linear or not one-dimensional.
    pub fn new(run: &Coupled<T>, incident: Port<T>, outgoing: Port<T>) -> Result<Self> {
        let mut starts = vec![0];
        // Radiation is exact for uniform lattices on a line only.
        for s in &run.subdomains {
            let layout = s.model().layout();
            if layout.components != 1 {
                let what = "be analysed harmonically: it is not one-dimensional".into();
                return Err(Error::Unsupported {
                    model: s.model().name().into(),
                    what,
                });
            }
            starts.push(starts[starts.len() - 1] + layout.dofs());
        }
        for i in &run.interfaces {
            starts.push(starts[starts.len() - 1] + i.multipliers().len());
        }
        let size = starts[starts.len() - 1];
        let mut neighbours = Vec::new();
        let mut stiffness = DMatrix::zeros(size, size);
        let mut mass = DVector::zeros(size);
        for (k, s) in run.subdomains.iter().enumerate() {
            let Some(linear) = s.model().views().linear else {
                let what = "be analysed harmonically: it is not linear, or weighted at its nodes".into();
                return Err(Error::Unsupported {
                    model: s.model().name().into(),
                    what,
                });
            };
            linear
                .stiffness()
                .iter()
                .for_each(|(v, (i, j))| stiffness[(starts[k] + i, starts[k] + j)] += *v);
            s.inertia()
                .iter()
                .enumerate()
                .for_each(|(i, m)| mass[starts[k] + i] = *m);
            let x = s.model().nodes();
            let mut order: Vec<usize> = (0..x.len()).collect();
            // Neighbours along the line, in whatever order the model numbers its nodes.
            order.sort_by(|a, b| x[*a].x.as_f64().total_cmp(&x[*b].x.as_f64()));
            let pairs = order.windows(2);
            neighbours.extend(pairs.map(|p| (starts[k] + p[0], starts[k] + p[1], x[p[1]].x - x[p[0]].x)));
        }
        // Multiplier rows are scaled to the stiffness, so that the elimination compares like with like.
        let top: T = stiffness.amax();
        for (k, interface) in run.interfaces.iter().enumerate() {
            let start = starts[run.subdomains.len() + k];
            let size = interface.coupling[0]
                .entries()
                .fold(T::zero(), |s, (.., v)| s.max(v.abs()));
            for (m, c) in interface.coupling.iter().enumerate() {
                let sign = if m == 0 { top / size } else { -top / size };
                for (r, j, v) in c.entries() {
                    let (r, j) = (start + r, starts[interface.sides[m]] + j);
                    stiffness[(r, j)] += sign * v;
                    stiffness[(j, r)] += sign * v;
                }
            }
        }
        let row = |p: &Port<T>| {
            let n = run
                .subdomains
                .get(p.subdomain)
                .map_or(0, |s| s.model().layout().dofs());
            if p.dof < n {
                Ok(starts[p.subdomain] + p.dof)
            } else {
                Err(invalid("port", p.dof, "is not an unknown of its subdomain"))
            }
        };
        Ok(Self {
            rows: [row(&incident)?, row(&outgoing)?],
            stiffness,
            mass,
            incident,
            outgoing,
            neighbours,
        })
    }

    /// Response at the angular frequency `omega` \[rad/s\], which must be below the incident lattice's
    /// cutoff.
    ///
    /// # Errors
    /// [`Error::InvalidParameter`] above the cutoff; [`Error::SingularSystem`].
    pub fn response(&self, omega: T) -> Result<Scattering<T>> {
        // Above the cutoff the incident lattice carries no wave that could come in.
        let cutoff = T::of(2.0) * (self.incident.stiffness / self.incident.mass).sqrt();
        if !(omega > T::zero() && omega < cutoff) {
            return Err(invalid(
                "angular frequency",
                omega,
                &format!("must be above 0 and below the cutoff {cutoff} rad/s"),
            ));
        }
        let z_in = propagator(&self.incident, omega);
        let z_out = propagator(&self.outgoing, omega);
        let square = omega * omega;
        let one = Complex::new(T::one(), T::zero());
        let mut a = self.stiffness.map(|v| Complex::new(v, T::zero()));
        for (i, m) in self.mass.iter().enumerate() {
            a[(i, i)] -= Complex::new(square * *m, T::zero());
        }
        for (row, port, z) in [
            (self.rows[0], &self.incident, z_in),
            (self.rows[1], &self.outgoing, z_out),
        ] {
            // The missing half cell and the spring to the next mass, whose displacement is z times this one.
            let half = Complex::new(square * port.mass * T::of(0.5), T::zero());
            a[(row, row)] += (one - z) * port.stiffness - half;
        }
        let mut b = DVector::from_element(a.nrows(), Complex::new(T::zero(), T::zero()));
        // The incident wave, with unit amplitude at its port.
        b[self.rows[0]] = (one / z_in - z_in) * self.incident.stiffness;
        let size = a.nrows();
        // LU: the system is neither Hermitian nor definite.
        let x = a.lu().solve(&b).ok_or(Error::SingularSystem {
            size,
            residual: f64::NAN,
            free: String::new(),
        })?;
        // The port carries the incident wave and the reflected one.
        let reflection = (x[self.rows[0]] - one).modulus();
        let transmission = x[self.rows[1]].modulus();
        // Power carried by a wave of unit amplitude: ω k sin(κh) / 2, zero above the cutoff.
        let ratio = self.outgoing.stiffness * z_out.im / (self.incident.stiffness * z_in.im);
        let incident = (one - z_in).modulus() / self.incident.spacing;
        let mut strain = [T::of(f64::from(f32::MAX)), T::zero()];
        for &(a, b, distance) in &self.neighbours {
            let modulus = (x[b] - x[a]).modulus() / (distance * incident);
            strain = [strain[0].min(modulus), strain[1].max(modulus)];
        }
        Ok(Scattering {
            strain,
            reflection,
            transmission,
            reflected_power: reflection * reflection,
            transmitted_power: transmission * transmission * ratio,
            wavelength: T::two_pi() * self.incident.spacing / -z_in.argument(),
        })
    }
}

/// `e^{−iκh}`, decaying above the cutoff.
fn propagator<T: Real>(port: &Port<T>, omega: T) -> Complex<T> {
    let c = T::one() - omega * omega * port.mass / (port.stiffness + port.stiffness);
    // Below the cutoff `e^{−iκh}` lies on the unit circle, and its real part is `c`.
    if c > -T::one() {
        Complex::new(c, -(T::one() - c * c).max(T::zero()).sqrt())
    } else {
        // Above it the wave decays from one mass to the next: of the two real roots, the one within the
        // circle.
        Complex::new(c + (c * c - T::one()).sqrt(), T::zero())
    }
}
