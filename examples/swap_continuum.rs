//! Exchanges the coarse continuum of a coupled beam, finite elements for natural elements, by one line.
//!
//! A silica beam of 20 mm by 2 mm by 2 mm is clamped at the left and pulled with 1 kN at the right. The
//! coarse model lies left of 14 mm, the fine model right of 10 mm. Printed are tip displacement, first
//! axial frequency and drift for both coarse models, and the values of beam theory.
//!
//! `cargo run --release --example swap_continuum`

use arlequin::{cnem, prelude::*};

const LENGTH: f64 = 20e-3;
const SIDE: f64 = 2e-3;
const OVERLAP: [f64; 2] = [10e-3, 14e-3];

fn block(x: [f64; 2], h: f64) -> Result<Mesh<f64>> {
    let across = (SIDE / h).round() as usize;
    let counts = [((x[1] - x[0]) / h).round() as usize, across, across];
    let (low, high) = (Point3::new(x[0], 0.0, 0.0), Point3::new(x[1], SIDE, SIDE));
    Ok(generate::block(ElementKind::Hex8, low, high, counts)?)
}

fn fem(name: &str, mesh: Mesh<f64>) -> Result<FemModel<f64>> {
    Ok(FemModel::new(name, mesh, Elastic::new(72.5e9, 0.17, 2200.0)?)?)
}

fn cnem(name: &str, mesh: Mesh<f64>) -> Result<CnemModel> {
    let domain = cnem::Domain::new(mesh.nodes(), &cnem::Surface::convex_hull())?;
    let silica = Elastic::new(72.5e9, 0.17, 2200.0)?;
    Ok(CnemModel::new(name, domain, silica, cnem::Options::default())?)
}

/// Couples any coarse continuum with the fine finite elements.
fn beam(coarse: impl CoarseModel<f64> + 'static) -> Result<Coupled<f64>> {
    let point = |x: f64| Point3::new(x, 0.0, 0.0);
    let ramp = Ramp::new(
        Arc::new(Slab::between(point(OVERLAP[1]), point(OVERLAP[0]))?),
        Profile::Cubic,
        1e-6,
    )?;
    let weights = Weights::from_weight(Arc::new(ramp));
    let fine_weights = Weights::complement_of(std::slice::from_ref(&weights));
    let fine = fem("fine", block([OVERLAP[0], LENGTH], 0.25e-3)?)?;
    let pull = |_: &_| Vector3::new(1000.0 / (SIDE * SIDE), 0.0, 0.0);
    let load = Load::traction("pull", fine.mesh().surface("x-max")?, &pull, TimeFunction::Step)?;
    let clamped = (0..coarse.nodes().len())
        .filter(|&n| coarse.nodes()[n].x < 1e-9)
        .flat_map(|n| 3 * n..3 * n + 3);
    let support = PrescribedMotion::fixed(clamped.collect());
    let interface = InterfaceSpec::new(
        "overlap",
        0,
        1,
        Arc::new(FemField::new(block(OVERLAP, 0.5e-3)?)),
        L2,
    );
    let bodies = vec![
        Subdomain::coarse(coarse, weights).with_support(support),
        Subdomain::fine(fine, fine_weights).with_effect(Box::new(load)),
    ];
    Coupled::new(bodies, vec![interface], TimeStep::Fraction(0.9), None)
}

fn tip(run: &Coupled<f64>, q: &[f64]) -> f64 {
    let nodes = run.subdomains()[1].model().nodes();
    let end: Vec<usize> = (0..nodes.len()).filter(|&n| nodes[n].x > LENGTH - 1e-9).collect();
    end.iter().map(|n| q[3 * n]).sum::<f64>() / end.len() as f64
}

/// Returns the static tip displacement \[m\], the first axial frequency \[Hz\] of the suddenly loaded beam
/// from its crossings of the static level, and the drift.
fn results(mut run: Coupled<f64>) -> Result<[f64; 3]> {
    let Equilibrium { displacements, .. } = run.equilibrium(0.0)?;
    let level = tip(&run, &displacements[1]);
    let mut crossings = Vec::new();
    let mut before = -1.0;
    while crossings.len() < 11 {
        run.advance(&mut Silent)?;
        let now = tip(&run, &run.subdomains()[1].state().q) - level;
        // Time of the crossing by linear interpolation.
        if before * now < 0.0 {
            crossings.push(run.time() - run.dt() * now / (now - before));
        }
        before = now;
    }
    let half_period = (crossings[10] - crossings[0]) / 10.0;
    Ok([level, 0.5 / half_period, run.drift()])
}

#[allow(clippy::print_stdout, reason = "an example shows its results")]
fn main() -> Result<()> {
    let mesh = || block([0.0, OVERLAP[1]], 0.5e-3);
    // This line chooses the coarse continuum.
    let with_fem = results(beam(fem("coarse", mesh()?)?)?)?;
    let with_cnem = results(beam(cnem("coarse", mesh()?)?)?)?;
    // Beam theory: U = F L / (E S), f = c / (4 L).
    let theory = [
        1000.0 * LENGTH / (72.5e9 * SIDE * SIDE),
        (72.5e9f64 / 2200.0).sqrt() / (4.0 * LENGTH),
    ];
    println!("                      FEM | FEM    CNEM | FEM   beam theory");
    println!(
        "tip displacement [um] {:>9.4} {:>13.4} {:>13.4}",
        with_fem[0] * 1e6,
        with_cnem[0] * 1e6,
        theory[0] * 1e6
    );
    println!(
        "first axial f [Hz]    {:>9.0} {:>13.0} {:>13.0}",
        with_fem[1], with_cnem[1], theory[1]
    );
    println!(
        "drift of H            {:>9.0e} {:>13.0e}",
        with_fem[2], with_cnem[2]
    );
    Ok(())
}
