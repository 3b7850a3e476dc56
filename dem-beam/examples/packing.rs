//! Times the packing protocol and prints its report: `packing <count> [quench]`.
#![allow(clippy::print_stdout, reason = "an example talks to a person")]

use dem_beam::{Container, Error, PackingSpec};
use std::time::Instant;

fn main() -> Result<(), Error> {
    let mut args = std::env::args().skip(1);
    let count = args.next().and_then(|a| a.parse().ok()).unwrap_or(5000);
    let quench = args.next().is_some_and(|a| a == "quench");
    let bar = Container::cylinder(20e-3, 1e-3)?;
    let spec = if quench {
        PackingSpec::quench(bar, count, 1)
    } else {
        PackingSpec::new(bar, count, 1)
    };
    let start = Instant::now();
    let packing = spec.build()?;
    println!("{:.3} s", start.elapsed().as_secs_f64());
    println!("{:#?}", packing.report);
    Ok(())
}
