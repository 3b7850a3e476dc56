//! Couples a third-party model, the crate `spring-chain`, with a finite-element bar, and sends a pulse
//! through.
//!
//! `cargo run --release --example chain`

use arlequin::prelude::*;
use spring_chain::Chain;

#[allow(clippy::print_stdout, reason = "an example shows its results")]
fn main() -> Result<()> {
    let point = |x: f64| Point3::new(x, 0.0, 0.0);
    // The bar fills (-800, 0), the chain (-40, 600); they share (-40, 0), where the chain's share grows
    // from 0 to 1.
    let ramp = Ramp::new(
        Arc::new(Slab::between(point(0.0), point(-40.0))?),
        Profile::Cubic,
        1e-3,
    )?;
    let coarse = Weights::from_weight(Arc::new(ramp));
    let fine = Weights::complement_of(std::slice::from_ref(&coarse));
    let bar = FemModel::new(
        "bar",
        generate::bar(-800.0, 0.0, 80, 1.0)?,
        Elastic::new(1.0, 0.0, 1.0)?,
    )?;
    let chain = Chain::new("chain", -40.0, 1.0, 640, 1.0, 1.0)?;

    // A pulse of half width 100 that runs to the left at speed 1.
    let pulse = |x: f64| {
        let y = (x - 150.0) / 100.0;
        if y.abs() < 1.0 { (1.0 - y * y).powi(3) } else { 0.0 }
    };
    let q: Vec<f64> = (0..=640).map(|k| pulse(f64::from(k) - 40.0)).collect();
    let v = (0..=640)
        .map(|k| f64::from(k) - 40.0)
        .map(|x| (pulse(x + 0.5) - pulse(x - 0.5)).max(-1.0))
        .collect();

    let mediator = Arc::new(FemField::new(generate::bar(-40.0, 0.0, 4, 1.0)?));
    let interface = InterfaceSpec::new("overlap", 0, 1, mediator, L2);
    let subdomains = vec![
        Subdomain::coarse(bar, coarse),
        Subdomain::fine(chain, fine).with_initial(q, v)?,
    ];
    let mut run = Coupled::new(subdomains, vec![interface], TimeStep::Seconds(0.5), None)?;
    let before = run.energy();
    run.run(1000, &mut Silent)?;
    let passed = run.subdomains()[0].kinetic_energy() + run.subdomains()[0].internal_energy();
    println!(
        "energy passed to the bar: {:.4} % of {before:.4}",
        100.0 * passed / before
    );
    println!("drift of the invariant:   {:.1e}", run.drift());
    println!(
        "condition of the operator: {:.1}",
        run.interfaces()[0].report().condition
    );
    Ok(())
}
