//! E, nu, bending and torsion of bars that are few spheres wide, over the values of the solid section:
//! `narrow [square]`.
#![allow(clippy::print_stdout, reason = "an example shows its results")]

use dem_beam::calibrate::{Bar, Spread, tension_test};
use dem_beam::packing::size::sphere_count;
use dem_beam::statics::{Equilibrium, StaticProblem};
use dem_beam::{BeamMaterial, BondedParticles, Container, Error, Held, PackingSpec};
use nalgebra::Vector3;

/// Half width of the bars \[m\].
const HALF: f64 = 1e-3;

fn main() -> Result<(), Error> {
    let square = std::env::args().any(|a| a == "square");
    println!("across   spheres  E [GPa]        nu              bending         torsion");
    for across in [3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 13.0] {
        let diameter: f64 = 2.0 * HALF / across;
        let length = 20e-3;
        let (container, area) = section(square, length)?;
        let count = sphere_count(area * length, diameter).round() as usize;
        let bar = Bar {
            start: 0.0,
            length,
            area,
        };
        let mut columns: [Vec<f64>; 5] = Default::default();
        for seed in 1..=if across > 7.0 { 2 } else { 4 } {
            let packing = PackingSpec::new(container.clone(), count, seed).build()?;
            let body = packing.bonded(BeamMaterial::SILICA, 2200.0)?;
            let test = tension_test(&body, &bar)?;
            let [bending, torsion] = stiffness(&body, length, [Vector3::z(), Vector3::x()])?;
            let (second, polar) = moments(square);
            let shear = test.young_gauge / (2.0 * 1.174);
            let row = [
                packing.report.across.unwrap_or_default(),
                test.young / 1e9,
                test.poisson,
                bending / (test.young_gauge * second),
                torsion / (shear * polar),
            ];
            columns.iter_mut().zip(row).for_each(|(c, x)| c.push(x));
        }
        let [x, young, poisson, bending, torsion] = columns.map(|c| Spread::from_samples(&c));
        let text = |s: Spread| format!("{:.3} ± {:.3}", s.mean, s.deviation);
        println!(
            "{:6.2} {count:>9}  {}  {}  {}  {}",
            x.mean,
            text(young),
            text(poisson),
            text(bending),
            text(torsion)
        );
    }
    Ok(())
}

fn section(square: bool, length: f64) -> Result<(Container, f64), Error> {
    Ok(if square {
        let low = Vector3::new(0.0, -HALF, -HALF);
        let high = Vector3::new(length, HALF, HALF);
        (Container::cuboid(low, high)?, 4.0 * HALF * HALF)
    } else {
        let area = std::f64::consts::PI * HALF * HALF;
        (Container::cylinder(length, HALF)?, area)
    })
}

/// Returns second moment of area and torsion constant \[m^4\].
fn moments(square: bool) -> (f64, f64) {
    if square {
        let a = (2.0 * HALF).powi(4);
        (a / 12.0, 0.140_577 * a)
    } else {
        let i = std::f64::consts::PI * HALF.powi(4) / 4.0;
        (i, 2.0 * i)
    }
}

/// Returns the moments at the free end of a clamped bar over the rotation per length in its middle half \[N
/// m^2\].
fn stiffness(body: &BondedParticles, length: f64, axes: [Vector3<f64>; 2]) -> Result<[f64; 2], Error> {
    let mut out = [0.0; 2];
    let mean = body.radii().iter().sum::<f64>() / body.len() as f64;
    for (axis, out) in axes.into_iter().zip(&mut out) {
        let mut problem = StaticProblem::free(body.len());
        let mut end = Vec::new();
        for (i, (x, r)) in body.positions().iter().zip(body.radii()).enumerate() {
            let near = r + 0.05 * mean;
            if x.x < near {
                problem.held[i] = Held::ALL;
            } else if length - x.x < near {
                end.push(i);
            }
        }
        let arm = arms(body, &end);
        let spread: f64 = arm.iter().map(|d| axis.cross(d).norm_squared()).sum();
        for (&i, d) in end.iter().zip(&arm) {
            problem.loads[i].linear += axis.cross(d) / spread;
        }
        let done = problem.solve(body, 1e-7, 100_000)?;
        *out = 1.0 / turn_per_length(body, &done, length, &axis);
    }
    Ok(out)
}

/// Returns places in the section relative to the centre of the chosen spheres.
fn arms(body: &BondedParticles, chosen: &[usize]) -> Vec<Vector3<f64>> {
    let position = |i: usize| body.positions()[i];
    let centre = chosen.iter().map(|&i| position(i)).sum::<Vector3<f64>>() / chosen.len() as f64;
    let across = |i: &usize| (position(*i) - centre).component_mul(&Vector3::new(0.0, 1.0, 1.0));
    chosen.iter().map(across).collect()
}

/// Returns the rotation per length: the slope of the mean rotation over six slabs of the middle half.
fn turn_per_length(body: &BondedParticles, u: &Equilibrium, length: f64, axis: &Vector3<f64>) -> f64 {
    let slab = length / 12.0;
    let points = (3..9).map(|k| {
        let inside = |i: &usize| (body.positions()[*i].x / slab).floor() as usize == k;
        let chosen: Vec<usize> = (0..body.len()).filter(inside).collect();
        let (mut work, mut spread) = (0.0, 0.0);
        for (&i, d) in chosen.iter().zip(arms(body, &chosen)) {
            let w = axis.cross(&d);
            work += w.dot(&u.displacements[i].linear);
            spread += w.norm_squared();
        }
        [(k as f64 + 0.5) * slab, work / spread]
    });
    let points: Vec<[f64; 2]> = points.collect();
    let mean = |c: usize| points.iter().map(|p| p[c]).sum::<f64>() / points.len() as f64;
    let (x, y) = (mean(0), mean(1));
    let along: f64 = points.iter().map(|p| (p[0] - x).powi(2)).sum();
    points.iter().map(|p| (p[0] - x) * (p[1] - y)).sum::<f64>() / along
}
