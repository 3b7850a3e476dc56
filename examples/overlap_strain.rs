//! The table of decision 22: loads of the bonds in an overlap, compared with the loads of the same bonds in
//! a body of particles alone. `cargo run --release --example overlap_strain -- rest` or `-- shock`, each
//! under two minutes.

#![allow(clippy::print_stdout, reason = "an example prints what it measured")]

use arlequin::core::Profile;
use arlequin_studies::strain::{Bar, Pair};

/// Ends of the strips of the overlap, as its coordinate from the fine border.
const STRIPS: [f64; 8] = [0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 0.95, 1.0];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let shock = match std::env::args().nth(1).as_deref() {
        Some("rest") => false,
        Some("shock") => true,
        _ => return Err("say rest or shock".into()),
    };
    println!(
        "rms load of the bonds over that alone, strips of s from {STRIPS:?}; hardest bond over hardest alone"
    );
    for (overlap, mediator) in [(20.0, 5.0), (10.0, 5.0), (5.0, 5.0), (5.0, 2.5)] {
        for (name, profile) in [
            ("linear", Some(Profile::Linear)),
            ("cubic", Some(Profile::Cubic)),
            ("mediator-compatible", None),
        ] {
            // The compatible profile needs a mediator node inside the overlap.
            if profile.is_none() && overlap <= mediator {
                continue;
            }
            for (fine_epsilon, absorber) in [(1e-6, 0.0), (1e-6, 0.2), (0.1, 0.0), (0.1, 0.2)] {
                // At rest an absorber has no effect.
                if !shock && absorber > 0.0 {
                    continue;
                }
                let bar = Bar {
                    overlap,
                    mediator,
                    profile: profile.clone(),
                    fine_epsilon,
                    absorber,
                    ..Bar::default()
                };
                let pairs = if shock {
                    bar.under_a_shock(3.0)?
                } else {
                    bar.at_rest()?
                };
                let name = format!("L_O {overlap} h_B {mediator} {name} {fine_epsilon} {absorber}");
                println!("{name:48} {}", line(&pairs));
            }
        }
    }
    Ok(())
}

fn line(pairs: &[Pair]) -> String {
    let mut out = String::new();
    for w in STRIPS.windows(2) {
        let in_strip = || pairs.iter().filter(|p| p.s >= w[0] && p.s < w[1]);
        let square = |f: &dyn Fn(&Pair) -> f64| in_strip().map(|p| f(p).powi(2)).sum::<f64>();
        out += &format!(" {:5.2}", (square(&|p| p.coupled) / square(&|p| p.alone)).sqrt());
    }
    let top = |f: &dyn Fn(&Pair) -> f64| pairs.iter().map(f).fold(0.0, f64::max);
    format!("{out}   {:5.2}", top(&|p| p.coupled) / top(&|p| p.alone))
}
