//! Cost that coupling adds to a step: finite elements and particles coupled, compared with each of them
//! alone.
//!
//! `cargo bench --bench coupled_step [particles [threads]]`; default 12 000 particles on one thread. All
//! cases are measured in turns, so that each sees the same load of the machine. Printed are the shortest
//! times per step of the run, the ratio `coupled / (particles + elements / ratio of the steps)`, and the
//! interface's time per stored entry of `B`. A mediator of `fine, L2` is as fine as the particles, one of
//! `0.8 h` finer: their multipliers are dependent. The last line compares the factor of a cube of hexahedra
//! by nested dissection with that by minimum degree.
#![allow(clippy::print_stdout, reason = "a bench talks to a person")]

use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::core::sprs::TriMat;
use arlequin::core::{
    Coupled, Guard, H1Gradient, InterfaceOptions, InterfaceSpec, Junction, L2, LinearModel, Model, Observer,
    OwnStep, Partition, Phase, Profile, Real, Result, Sampling, StepReport, Subdomain, TimeStep, Weights,
};
use arlequin::dem_beam::{BeamMaterial, Container, DemModel, Matter, Packing, PackingSpec};
use arlequin::fem_ref::{Elastic, ElementKind, FemModel};
use arlequin_studies::solid::{self, block};
use std::ops::ControlFlow;
use std::time::{Duration, Instant};

const BEAM: BeamMaterial = BeamMaterial {
    young: 3.56,
    poisson: 0.3,
    radius_ratio: 0.71,
};

/// Number of rounds over all cases, and of steps in each round.
const ROUNDS: usize = 12;
const STEPS: usize = 40;

/// Measures the time spent in interfaces.
#[derive(Debug)]
struct Clock {
    phase: Option<Phase>,
    since: Instant,
    interface: Duration,
}

impl Clock {
    fn new() -> Self {
        Self {
            phase: None,
            since: Instant::now(),
            interface: Duration::ZERO,
        }
    }
}

impl Observer<f64> for Clock {
    fn phase(&mut self, phase: Phase) {
        let now = Instant::now();
        if self.phase == Some(Phase::Interface) {
            self.interface += now - self.since;
        }
        (self.phase, self.since) = (Some(phase), now);
    }

    fn observe(&mut self, _: &Coupled<f64>, _: &StepReport<f64>) -> Result<ControlFlow<()>> {
        Ok(ControlFlow::Continue(()))
    }
}

/// Bodies of the benchmark, with unit section: elements on (0, 3), particles on (2, 4).
struct Deck {
    packing: Packing,
    spacing: f64,
}

impl Deck {
    fn new(particles: usize) -> Result<Self> {
        let body = Container::cuboid(Vector3::new(2.0, 0.0, 0.0), Vector3::new(4.0, 1.0, 1.0))?;
        Ok(Self {
            packing: PackingSpec::quench(body, particles, 1).build()?,
            spacing: (2.0 / particles as f64).cbrt(),
        })
    }

    /// Builds elements with an edge of four particle spacings.
    fn coarse(&self) -> Result<FemModel<f64>> {
        let across = (0.25 / self.spacing).round().max(2.0) as usize;
        let mesh = block(ElementKind::Hex8, [0.0, 3.0], [3 * across, across, across])?;
        Ok(FemModel::new("left", mesh, Elastic::new(1.0, 0.17, 1.0)?)?)
    }

    fn fine(&self) -> Result<DemModel> {
        let p = &self.packing;
        let matter = Matter {
            beam: BEAM,
            density: 1.0,
            volume: p.volume,
        };
        Ok(DemModel::from_spheres(
            "right",
            &p.positions,
            &p.radii,
            &p.pairs,
            &matter,
        )?)
    }

    fn sides(&self) -> Result<[Subdomain<f64>; 2]> {
        let weights = solid::weights(Profile::Cubic, 0.05)?;
        let fine_weights = Weights::complement_of(std::slice::from_ref(&weights));
        Ok([
            Subdomain::coarse(self.coarse()?, weights).with_step(OwnStep::Same),
            Subdomain::fine(self.fine()?, fine_weights),
        ])
    }

    /// Couples both models with `across` mediator elements across the section and `ratio` own steps of the
    /// particles.
    fn coupled(&self, across: usize, ratio: usize, junction: Box<dyn Junction<f64>>) -> Result<Coupled<f64>> {
        let mediator = solid::mediator(ElementKind::Hex8, solid::OVERLAP, [across; 3])?;
        let interface = InterfaceSpec {
            options: InterfaceOptions {
                sampling: Sampling::Particles,
                ..InterfaceOptions::default()
            },
            ..solid::spec(mediator, junction)
        };
        let [coarse, fine] = self.sides()?;
        let bodies = [coarse, fine.with_step(OwnStep::Ratio(ratio))];
        let step = self.step()? * ratio as f64;
        Coupled::new(
            solid::shaken(bodies, 12)?,
            vec![interface],
            TimeStep::Seconds(step),
            Some(rare()),
        )
    }

    /// Builds a run of one side alone.
    fn alone(&self, side: usize) -> Result<Coupled<f64>> {
        let bodies = self.sides()?.into_iter().nth(side).into_iter();
        let bodies = bodies.map(|s| s.with_partition(Partition::Unchecked)).collect();
        Coupled::new(bodies, Vec::new(), TimeStep::Seconds(self.step()?), Some(rare()))
    }

    /// Returns the own step of all cases \[s\]: 0.4 of the particles' critical step.
    fn step(&self) -> Result<f64> {
        let [_, fine] = self.sides()?;
        let bodies = vec![fine.with_partition(Partition::Unchecked)];
        Ok(Coupled::new(bodies, Vec::new(), TimeStep::Fraction(0.4), None)?.dt())
    }
}

/// Returns a guard that computes the ledger so rarely that it does not affect the times.
fn rare() -> Guard<f64> {
    Guard {
        interval: 1_000_000,
        growth: 0.05,
    }
}

/// Returns the shortest time per step of each run, and of its interfaces \[s\].
fn best(runs: &mut [Coupled<f64>]) -> Result<Vec<[f64; 2]>> {
    let mut out = vec![[f64::INFINITY; 2]; runs.len()];
    for _ in 0..ROUNDS {
        for (run, best) in runs.iter_mut().zip(&mut out) {
            let mut clock = Clock::new();
            let start = Instant::now();
            run.run(STEPS, &mut clock)?;
            let times = [start.elapsed(), clock.interface].map(|t| t.as_secs_f64() / STEPS as f64);
            (0..2).for_each(|k| best[k] = best[k].min(times[k]));
        }
    }
    Ok(out)
}

fn measure(particles: usize) -> Result<()> {
    let deck = Deck::new(particles)?;
    let fine = (1.0 / deck.spacing).round() as usize;
    let coarse = (fine / 4).max(1);
    let h = 1.0 / fine as f64;
    let mut cases: Vec<(&str, usize, Coupled<f64>)> = Vec::new();
    for ratio in [1, 4] {
        cases.push(("coarse, L2", ratio, deck.coupled(coarse, ratio, Box::new(L2))?));
        let h1 = Box::new(H1Gradient::new(h)?);
        cases.push(("coarse, H1", ratio, deck.coupled(coarse, ratio, h1)?));
        cases.push(("half, L2", ratio, deck.coupled(fine / 2, ratio, Box::new(L2))?));
        cases.push(("fine, L2", ratio, deck.coupled(fine, ratio, Box::new(L2))?));
        cases.push((
            "fine, L2, 0.8 h",
            ratio,
            deck.coupled(fine * 5 / 4, ratio, Box::new(L2))?,
        ));
    }
    let names: Vec<(&str, usize)> = cases.iter().map(|c| (c.0, c.1)).collect();
    let alone = [deck.alone(0)?, deck.alone(1)?];
    let mut runs: Vec<Coupled<f64>> = alone.into_iter().chain(cases.into_iter().map(|c| c.2)).collect();
    let times = best(&mut runs)?;
    let us = |t: f64| t * 1e6;
    let [elements, particle] = [times[0][0], times[1][0]];
    println!(
        "{} particles alone {:.0} us, {} element nodes alone {:.0} us",
        deck.packing.radii.len(),
        us(particle),
        runs[0].subdomains()[0].model().nodes().len(),
        us(elements)
    );
    println!(
        "mediator         steps  multipliers    rank  solver                          its  condition  us per step  interface  ns per entry  coupled/alone"
    );
    for ((run, t), (name, ratio)) in runs.iter().zip(&times).skip(2).zip(names) {
        let i = &run.interfaces()[0];
        let r = i.report();
        let entries: usize = (0..2)
            .filter_map(|m| i.coupling_matrix(m))
            // Each entry of the junction stands for three equal components.
            .map(|b| b.nnz() / 3)
            .sum();
        println!(
            "{name:<16} 1:{ratio:<4} {:>10} {:>7}  {:<30} {:>4} {:>10.1e} {:>12.0} {:>10.0} {:>13.2} {:>14.3}",
            r.multipliers,
            r.rank,
            r.solver,
            i.iterations(),
            r.condition,
            us(t[0]),
            us(t[1]),
            t[1] * 1e9 / entries as f64,
            t[0] / (ratio as f64 * particle + elements)
        );
    }
    Ok(())
}

/// Prints how long the factor of a cube takes in either order of elimination.
fn measure_factors() -> Result<()> {
    let mesh = block(ElementKind::Hex8, [0.0, 1.0], [21; 3])?;
    let model = FemModel::new("cube", mesh, Elastic::new(1.0, 0.17, 1.0)?)?;
    let places: Vec<Point3<f64>> = model.nodes().iter().flat_map(|x| [*x; 3]).collect();
    let size = places.len();
    let mut support = TriMat::new((size, size));
    (0..size).for_each(|i| support.add_triplet(i, i, 1e-3));
    let matrix = &model.stiffness() + &support.to_csr();
    let factor = |places: Option<&[Point3<f64>]>| -> Result<(f64, usize)> {
        let start = Instant::now();
        let factor = f64::cholesky(&matrix, places)?;
        Ok((start.elapsed().as_secs_f64(), factor.nonzeros()))
    };
    let ((degree, most), (dissected, entries)) = (factor(None)?, factor(Some(&places))?);
    println!(
        "factor of {size} unknowns: minimum degree {degree:.2} s, dissection {dissected:.2} s, ratio {:.2} (entries {:.2})",
        dissected / degree,
        entries as f64 / most as f64
    );
    Ok(())
}

fn main() -> Result<()> {
    // `cargo bench` adds flags, which are skipped.
    let mut numbers = std::env::args().filter_map(|a| a.parse().ok());
    let (particles, threads) = (numbers.next().unwrap_or(12_000), numbers.next().unwrap_or(1));
    match rayon::ThreadPoolBuilder::new().num_threads(threads).build() {
        Ok(pool) => pool.install(|| measure(particles))?,
        Err(_) => measure(particles)?,
    }
    measure_factors()
}
