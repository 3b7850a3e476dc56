//! 100 000 steps of a jammed bar: drift of the invariant (linear law, 0.9 of the critical step)
//! and of energy and angular momentum (finite rotations): `long_run [particles] [steps]`.
#![allow(clippy::print_stdout, reason = "an example talks to a person")]

use dem_beam::{BeamDynamics, BeamMaterial, Container, DemError, PackingSpec, Twist, critical};
use nalgebra::Vector3;

fn main() -> Result<(), DemError> {
    let mut args = std::env::args().skip(1).filter_map(|a| a.parse().ok());
    let (count, steps) = (args.next().unwrap_or(1200), args.next().unwrap_or(100_000));
    let packing = PackingSpec::quench(Container::cylinder(6e-3, 1e-3)?, count, 3).build()?;
    let body = packing.bonded(BeamMaterial::SILICA, 2200.0)?;
    let exact = critical::lanczos(&body, 60)?;
    println!(
        "critical step {exact:e} s, block bound {:.3} of it",
        critical::block_bound(&body)? / exact
    );
    let spin = Vector3::new(2e4, 5e3, -1e4);
    let wave = |i: usize| Vector3::new((i as f64).sin(), (1.7 * i as f64).sin(), (2.3 * i as f64).sin());
    let noise: Vec<Twist> = (0..body.len())
        .map(|i| Twist {
            linear: wave(i),
            angular: wave(i + 7) * 1e4,
        })
        .collect();
    let mut linear = BeamDynamics::<f64>::linear(&body, 0.9 * exact)?;
    linear.set_velocities(&noise)?;
    let h = linear.invariant();
    let mut finite = BeamDynamics::<f64>::finite(&body, 0.5 * exact)?;
    let tumbling: Vec<Twist> = noise
        .iter()
        .zip(body.positions())
        .map(|(n, x)| Twist {
            linear: n.linear + spin.cross(x),
            angular: n.angular * 0.1 + spin,
        })
        .collect();
    finite.set_velocities(&tumbling)?;
    let e = finite.kinetic_energy();
    let l = angular(&finite);
    for k in 1..=10 {
        linear.run(steps / 10);
        finite.run(steps / 10);
        println!(
            "{:>8} steps: linear H {:+.2e}, finite E {:+.2e}, L {:.2e}",
            k * (steps / 10),
            linear.invariant() / h - 1.0,
            (finite.kinetic_energy() + finite.elastic_energy()) / e - 1.0,
            (angular(&finite) - l).norm() / l.norm()
        );
    }
    Ok(())
}

/// Angular momentum about the origin, where the particles are.
fn angular(run: &BeamDynamics<f64>) -> Vector3<f64> {
    let body = run.body();
    let moved = run.velocities().into_iter().zip(run.displacements());
    let weighed = body.mass().iter().zip(body.inertia());
    moved
        .zip(body.positions().iter().zip(weighed))
        .map(|((v, u), (x, (m, i)))| (x + u.linear).cross(&v.linear) * *m + v.angular * *i)
        .sum()
}
