//! scratch
use arlequin::core::weight::Profile;
use arlequin_studies::strain::{Bar, Pair};

fn say(name: &str, pairs: &[Pair]) {
    let edges = [0.0, 0.2, 0.4, 0.6, 0.7, 0.8, 0.9, 0.95, 1.0];
    let top = pairs.iter().map(|p| p.alone).fold(0.0, f64::max);
    print!("{name:28}");
    for w in edges.windows(2) {
        let here: Vec<&Pair> = pairs.iter().filter(|p| p.s >= w[0] && p.s < w[1]).collect();
        let rms = |f: &dyn Fn(&Pair) -> f64| {
            (here.iter().map(|p| f(p).powi(2)).sum::<f64>() / here.len() as f64).sqrt()
        };
        let max = here.iter().map(|p| p.coupled).fold(0.0, f64::max) / top;
        print!(" {:5.2}/{:4.2}", rms(&|p| p.coupled) / rms(&|p| p.alone), max);
    }
    let max = pairs.iter().map(|p| p.coupled).fold(0.0, f64::max) / top;
    let over = pairs.iter().filter(|p| p.coupled > 1.0 * top).count();
    let over15 = pairs.iter().filter(|p| p.coupled > 1.5 * top).count();
    println!("  max {max:.2}, {over}/{over15} of {}", pairs.len());
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().collect();
    let dynamic = args[1] == "d";
    for (l, hb) in [(20.0, 5.0), (10.0, 5.0), (15.0, 5.0)] {
        for (name, p) in [
            ("linear", Some(Profile::Linear)),
            ("cubic", Some(Profile::Cubic)),
            ("quintic", Some(Profile::Quintic)),
        ] {
            for eps in [0.01, 0.02, 0.05, 0.1, 0.2] {
                for absorber in [0.0, 0.2, 0.5, 1.0] {
                    if !dynamic && absorber > 0.0 {
                        continue;
                    }
                    if dynamic && name == "quintic" {
                        continue;
                    }
                    let mut all = Vec::new();
                    for seed in 1..=3 {
                        let bar = Bar {
                            overlap: l,
                            mediator: hb,
                            profile: p.clone(),
                            fine_epsilon: eps,
                            absorber,
                            seed,
                            ..Bar::default()
                        };
                        all.extend(if dynamic {
                            bar.under_a_shock(3.0)?
                        } else {
                            bar.at_rest()?
                        });
                    }
                    say(&format!("{l} {hb} {name} {eps} a{absorber}"), &all);
                }
            }
        }
    }
    Ok(())
}
