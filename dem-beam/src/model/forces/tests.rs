//! The block kernel against the plain loop over bonds.

use super::{BondForces, Finite, Gather, Isa, Linear, Screened};
use crate::bond::{BeamMaterial, Twist};
use crate::packing::{Container, PackingSpec};
use crate::particles::BondedParticles;
use nalgebra::Vector3;

fn worst<W: Screened + std::fmt::Debug + 'static>(
    body: &BondedParticles,
    x: &[Twist],
    portable: bool,
) -> f64 {
    let mut gather = Gather::<W>::new(body);
    if portable {
        gather.isa = Isa::Portable;
    }
    let flat = |x: &[Twist]| -> Vec<f64> {
        let linear = x.iter().flat_map(|t| t.linear.iter());
        linear
            .chain(x.iter().flat_map(|t| t.angular.iter()))
            .copied()
            .collect()
    };
    let mut plain = vec![Twist::zero(); x.len()];
    assert!(body.add_forces(x, &mut plain).is_ok());
    let mut fast = vec![0.0; 6 * x.len()];
    assert!(gather.add(&flat(x), &mut fast, None).is_ok());
    let (plain, half) = (flat(&plain), fast.len() / 2);
    let part = |range: std::ops::Range<usize>| {
        let size = plain[range.clone()].iter().fold(0.0_f64, |a, f| a.max(f.abs()));
        let worst = range.map(|i| (fast[i] - plain[i]).abs()).fold(0.0, f64::max);
        worst / size
    };
    part(0..half).max(part(half..2 * half))
}

/// Compares both laws with the linear reference, with the detected instruction set and with portable code.
/// The motions are small, so that the finite law equals the linear one to first order.
#[test]
fn kernel_equals_the_plain_loop() -> crate::error::Result<()> {
    let packing = PackingSpec::quench(Container::cylinder(6e-3, 1e-3)?, 1200, 3).build()?;
    let mut body = packing.bonded(BeamMaterial::SILICA, 2200.0)?;
    let noise = |i: usize, c: usize| (7.0 * i as f64 + 1.3 * c as f64).sin();
    let weights: Vec<f64> = (0..body.pairs().len()).map(|b| 0.5 + 0.5 * noise(b, 7)).collect();
    body.set_weights(&weights)?;
    let x = |linear: f64, angular: f64| -> Vec<Twist> {
        let twist = |i| Twist {
            linear: Vector3::new(noise(i, 0), noise(i, 1), noise(i, 2)) * linear,
            angular: Vector3::new(noise(i, 3), noise(i, 4), noise(i, 5)) * angular,
        };
        (0..body.len()).map(twist).collect()
    };
    for portable in [false, true] {
        let linear = worst::<Linear>(&body, &x(1e-7, 1e-3), portable);
        assert!(linear < 1e-13, "{linear}");
        let finite = worst::<Finite>(&body, &x(1e-11, 1e-7), portable);
        assert!(finite < 1e-5, "{finite}");
    }
    Ok(())
}
