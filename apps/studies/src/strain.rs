//! Compares the loads of bonds in an overlap with the loads of the same bonds in a body of particles alone.
//! The body is a bar of spheres; in its coupled twin the particles end with the overlap, and finite
//! elements continue. Lengths are in mean diameters of the spheres, the density is 1, and beams are 3.56
//! times stiffer than the packing, so that the wave speed is about one.

use arlequin::core::effect::{Absorber, Load};
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::core::{
    Coupled, InterfaceOptions, InterfaceSpec, L2, Overlap, Place, PrescribedMotion, Profile, Ramp, Result,
    Sampling, Silent, Slab, Subdomain, TimeFunction, TimeStep, Weights,
};
use arlequin::dem_beam::{
    BeamMaterial, BondedParticles, Container, Criterion, DemModel, LoadShare, Matter, Packing, PackingSpec,
};
use arlequin::fem_ref::{Elastic, ElementKind, FemField, FemModel, generate};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Young's modulus of the elements, which is the unit of modulus, and Poisson's ratio. Both match the
/// packing.
const MATERIAL: (f64, f64) = (1.0, 0.175);

/// Parameters of one case.
#[derive(Debug, Clone)]
pub struct Bar {
    /// Edge of the square section.
    pub section: f64,
    /// Length of the part in front of the overlap, with particles alone.
    pub zone: f64,
    /// Width of the overlap.
    pub overlap: f64,
    /// Length of the part behind the overlap, with elements alone.
    pub rest: f64,
    /// Length of an element.
    pub h: f64,
    /// Length of a mediator element.
    pub mediator: f64,
    /// Profile of the weight; `None` for the mediator-compatible profile.
    pub profile: Option<Profile<f64>>,
    /// Floor of the elements' weight.
    pub epsilon: f64,
    /// Floor of the particles' weight.
    pub fine_epsilon: f64,
    /// Largest rate of the absorber in units of wave speed over diameter; zero for no absorber.
    pub absorber: f64,
    /// Seed of the packing.
    pub seed: u64,
}

impl Default for Bar {
    fn default() -> Self {
        Self {
            section: 6.0,
            zone: 8.0,
            overlap: 20.0,
            rest: 10.0,
            h: 5.0,
            mediator: 5.0,
            profile: Some(Profile::Cubic),
            epsilon: 1e-6,
            fine_epsilon: 1e-6,
            absorber: 0.0,
            seed: 1,
        }
    }
}

/// Loads of bonds by the packing's numbers of their two spheres.
type Loads = BTreeMap<[u32; 2], f64>;

/// A run whose last subdomain consists of particles, the bonds of these particles, and the particles'
/// numbers in the packing.
struct Body {
    run: Coupled<f64>,
    bonds: BondedParticles,
    numbers: Vec<u32>,
}

/// A bond of the overlap with its loads in both bodies.
#[derive(Debug, Clone, Copy)]
pub struct Pair {
    /// Position of the bond's middle: 0 at the fine border, 1 at the coarse border.
    pub s: f64,
    /// Weight of the particles at the bond's middle.
    pub alpha: f64,
    /// Load in the coupled body.
    pub coupled: f64,
    /// Load in the body of particles alone.
    pub alone: f64,
}

impl Bar {
    fn length(&self) -> f64 {
        self.zone + self.overlap + self.rest
    }

    fn packing(&self) -> Result<Packing> {
        let high = Vector3::new(self.length(), self.section, self.section);
        // One packing for both bodies: differences of loads are then those of the coupling alone.
        let container = Container::cuboid(Vector3::zeros(), high)?;
        // Number of spheres at a packing density of 0.6; 1.0625 is their mean cubed diameter.
        let count = container.volume() / (std::f64::consts::PI / 6.0 * 1.0625) * 0.6;
        Ok(PackingSpec::quench(container, count as usize, self.seed).build()?)
    }

    fn beam() -> BeamMaterial {
        BeamMaterial {
            young: 3.56,
            poisson: 0.3,
            radius_ratio: 0.71,
        }
    }

    /// Builds a model of the spheres with centres before `end`. Returns it with the spheres' numbers in the
    /// packing.
    fn particles(packing: &Packing, end: f64) -> Result<(DemModel, Vec<u32>)> {
        let mut bonded = vec![false; packing.positions.len()];
        let inside = |i: u32| packing.positions[i as usize].x < end;
        let pairs = packing.pairs.iter().filter(|p| p.iter().all(|i| inside(*i)));
        pairs.clone().flatten().for_each(|i| bonded[*i as usize] = true);
        // Spheres without a bond are left out.
        let numbers: Vec<u32> = (0..bonded.len() as u32).filter(|i| bonded[*i as usize]).collect();
        let place = |i: &u32| numbers.partition_point(|n| n < i) as u32;
        let pairs: Vec<[u32; 2]> = pairs.map(|[i, j]| [place(i), place(j)]).collect();
        let positions: Vec<_> = numbers.iter().map(|i| packing.positions[*i as usize]).collect();
        let radii: Vec<f64> = numbers.iter().map(|i| packing.radii[*i as usize]).collect();
        // The spheres represent their share of the packing's volume.
        let cubes = |r: &[f64]| r.iter().map(|r| r * r * r).sum::<f64>();
        let matter = Matter {
            beam: Self::beam(),
            density: 1.0,
            volume: packing.volume * cubes(&radii) / cubes(&packing.radii),
        };
        let model = DemModel::from_spheres("particles", &positions, &radii, &pairs, &matter)?;
        // The model numbers its spheres anew: bonds of both bodies are compared by the packing's numbers.
        let numbers = model.order().iter().map(|i| numbers[*i as usize]).collect();
        Ok((model, numbers))
    }

    fn pulled(
        &self,
        model: DemModel,
        weights: Weights<f64>,
        time: TimeFunction<f64>,
    ) -> Result<Subdomain<f64>> {
        // The layer of spheres at the free end.
        let face = model.select(|x| x.x < 1.0);
        let force = Vector3::new(-self.section * self.section, 0.0, 0.0);
        let load = Load::on_dofs("pull", model.force(&face, force, LoadShare::Mass)?, time)?;
        Ok(Subdomain::fine(model, weights).with_effect(Box::new(load)))
    }

    /// Builds the body of particles alone.
    fn alone(&self, packing: &Packing, time: TimeFunction<f64>) -> Result<Body> {
        let (model, numbers) = Self::particles(packing, f64::INFINITY)?;
        let bonds = model.body().clone();
        // The layer at the other end is clamped, as the elements are in the coupled body.
        let fixed_unknowns = model.clamped(&model.select(|x| x.x > self.length() - 1.0));
        let body = self.pulled(model, Weights::uncoupled(), time)?;
        let body = body.with_support(PrescribedMotion::fixed(fixed_unknowns));
        let run = Coupled::new(vec![body], Vec::new(), TimeStep::Fraction(0.9), None)?;
        Ok(Body { run, bonds, numbers })
    }

    fn block(&self, start: f64, end: f64, h: f64) -> Result<arlequin::fem_ref::Mesh<f64>> {
        let across = (self.section / h).round().max(1.0) as usize;
        let along = ((end - start) / h).round().max(1.0) as usize;
        let low = Point3::new(start, 0.0, 0.0);
        let high = Point3::new(end, self.section, self.section);
        Ok(generate::block(
            ElementKind::Hex8,
            low,
            high,
            [along, across, across],
        )?)
    }

    fn slab(&self) -> Result<Arc<dyn Overlap<f64>>> {
        let point = |x: f64| Point3::new(x, 0.0, 0.0);
        Ok(Arc::new(Slab::between(
            point(self.zone),
            point(self.zone + self.overlap),
        )?))
    }

    fn weight(&self) -> Result<Arc<Ramp<f64>>> {
        let layers = (self.overlap / self.mediator).round().max(1.0);
        // One station per layer of mediator nodes across the overlap.
        let stations: Vec<f64> = (0..=layers as usize).map(|k| k as f64 / layers).collect();
        let profile = match &self.profile {
            Some(p) => p.clone(),
            None => Profile::mediator_compatible(&stations)?,
        };
        Ok(Arc::new(
            Ramp::new(self.slab()?, profile, self.epsilon)?.with_fine_floor(self.fine_epsilon)?,
        ))
    }

    /// Builds the coupled body.
    fn coupled(&self, packing: &Packing, time: TimeFunction<f64>) -> Result<Body> {
        let weights = Weights::from_weight(self.weight()?);
        let mesh = self.block(self.zone, self.length(), self.h)?;
        let nodes = mesh.nodes().iter().enumerate();
        let fixed_unknowns = nodes
            // Nodes of the end face have its coordinate up to round-off.
            .filter(|(_, x)| x.x > self.length() - 1e-9)
            .flat_map(|(k, _)| [3 * k, 3 * k + 1, 3 * k + 2])
            .collect();
        let elements = FemModel::new("elements", mesh, Elastic::new(MATERIAL.0, MATERIAL.1, 1.0)?)?;
        let (model, numbers) = Self::particles(packing, self.zone + self.overlap)?;
        let bonds = model.body().clone();
        let mut fine = self.pulled(
            model,
            Weights::complement_of(std::slice::from_ref(&weights)),
            time,
        )?;
        let mediator = Arc::new(FemField::new(self.block(
            self.zone,
            self.zone + self.overlap,
            self.mediator,
        )?));
        if self.absorber > 0.0 {
            let (slab, top) = (self.slab()?, self.absorber);
            // The rate grows with the square of the depth in the overlap.
            let rate = move |x: &Point3<f64>| match slab.place(x) {
                Place::Fine => 0.0,
                Place::Coarse => top,
                Place::Overlap(s) => top * s * s,
            };
            fine = fine.with_effect(Box::new(Absorber::new(mediator.clone(), Arc::new(rate))));
        }
        let spec = InterfaceSpec {
            name: "overlap".into(),
            coarse: 0,
            fine: 1,
            mediator,
            junction: Box::new(L2),
            options: InterfaceOptions {
                sampling: Sampling::Particles,
                ..InterfaceOptions::default()
            },
        };
        let coarse =
            Subdomain::coarse(elements, weights).with_support(PrescribedMotion::fixed(fixed_unknowns));
        let run = Coupled::new(vec![coarse, fine], vec![spec], TimeStep::Fraction(0.9), None)?;
        Ok(Body { run, bonds, numbers })
    }

    /// Returns the largest principal tension of every bond under a constant pull, from static solutions of
    /// both bodies.
    ///
    /// # Errors
    /// Errors of the set-up and the static solve.
    pub fn at_rest(&self) -> Result<Vec<Pair>> {
        let packing = self.packing()?;
        let solve = |mut body: Body| {
            let e = body.run.equilibrium(0.0)?;
            let mut loads = Loads::new();
            let q = e.displacements.last().map_or(&[][..], Vec::as_slice);
            gather(&body, q, &mut loads)?;
            Ok::<_, arlequin::core::Error>(loads)
        };
        let alone = solve(self.alone(&packing, TimeFunction::Step)?)?;
        let coupled = solve(self.coupled(&packing, TimeFunction::Step)?)?;
        self.paired(&packing, &coupled, &alone)
    }

    /// Returns the largest load of every bond over time under a pull that starts abruptly. The run ends
    /// when a wave has travelled `ways` lengths of the bar.
    ///
    /// # Errors
    /// Errors of the set-up and the steps.
    pub fn under_a_shock(&self, ways: f64) -> Result<Vec<Pair>> {
        let packing = self.packing()?;
        let end = ways * self.length();
        let solve = |mut body: Body| {
            let mut loads = Loads::new();
            let last = body.run.subdomains().len() - 1;
            while body.run.time() < end {
                body.run.run(3, &mut Silent)?;
                gather(&body, &body.run.subdomains()[last].state().q, &mut loads)?;
            }
            Ok::<_, arlequin::core::Error>(loads)
        };
        let alone = solve(self.alone(&packing, TimeFunction::Step)?)?;
        let coupled = solve(self.coupled(&packing, TimeFunction::Step)?)?;
        self.paired(&packing, &coupled, &alone)
    }

    fn paired(&self, packing: &Packing, coupled: &Loads, alone: &Loads) -> Result<Vec<Pair>> {
        use arlequin::core::Weight;
        let (slab, weight) = (self.slab()?, self.weight()?);
        let pair = |(key, load): (&[u32; 2], &f64)| {
            let [a, b] = key.map(|i| packing.positions[i as usize]);
            let middle = Point3::from((a + b) * 0.5);
            // Bonds outside of the overlap have no twin to compare with.
            let Place::Overlap(s) = slab.place(&middle) else {
                return None;
            };
            Some(Pair {
                s,
                alpha: 1.0 - weight.value(&middle),
                coupled: *load,
                alone: *alone.get(key)?,
            })
        };
        Ok(coupled.iter().filter_map(pair).collect())
    }
}

/// Raises each entry of `loads` to the bond's load in the state `q`, if that is larger.
fn gather(body: &Body, q: &[f64], loads: &mut Loads) -> Result<()> {
    let now = Criterion::Rankine.loads(&body.bonds, q)?;
    for (pair, load) in body.bonds.pairs().iter().zip(now) {
        let [a, b] = pair.map(|i| body.numbers[i as usize]);
        // In ascending order: the two bodies may list the ends of a bond differently.
        let top = loads.entry([a.min(b), a.max(b)]).or_insert(0.0);
        *top = top.max(load);
    }
    Ok(())
}
