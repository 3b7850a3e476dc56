//! All fifteen cells of the cantilever table (`cargo bench --bench cantilever`, some minutes), each with 1,
//! 2 and 4 own steps of the finer side: our drift of energy, and the drift published for overlapping
//! Schwarz coupling.

use arlequin_studies::cantilever::{self, PUBLISHED, WIDTHS};

#[allow(clippy::print_stdout, reason = "the table is what this program is for")]
fn main() -> arlequin::core::Result<()> {
    println!(
        "ratio  L_O [mm]  own steps  E(0) [J]  drift of H 1 ms    10 ms     total energy 1 ms   10 ms [%]   Schwarz 1 ms [%]"
    );
    let mut worst: f64 = 0.0;
    for (ratio, published) in PUBLISHED {
        for (width, schwarz) in WIDTHS.into_iter().zip(published) {
            for own_steps in [1, 2, 4] {
                let d = cantilever::drift(ratio, width, own_steps)?;
                worst = d.invariant.iter().fold(worst, |a, b| a.max(b.abs()));
                println!(
                    "1:{ratio:<4} {:>8.1} {own_steps:>10} {:>9.1} {:>14.1e} {:>9.1e} {:>17.3} {:>9.3} {:>16.1}",
                    width * 1e3,
                    d.start,
                    d.invariant[0],
                    d.invariant[1],
                    100.0 * d.total[0],
                    100.0 * d.total[1],
                    schwarz
                );
            }
        }
    }
    println!("largest drift of the invariant: {worst:.1e} (accepted 1e-12)");
    assert!(worst <= 1e-12, "the drift exceeds what is promised");
    Ok(())
}
