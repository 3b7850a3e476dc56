//! Bodies that break where two models overlap, one difficulty in each case. A lattice of spheres on (2, 4)
//! is coupled to finite elements on (0, 3); nothing is supported.

use super::{HardCase, Outcome};
use crate::solid::{self, block};
use arlequin::core::effect::EffectSpec;
use arlequin::core::nalgebra::Vector3;
use arlequin::core::{
    Coupled, InterfaceOptions, InterfaceSpec, L2, Model, Profile, Result, Sampling, Silent, Subdomain,
    TimeStep, Weights,
};
use arlequin::dem_beam::fracture::{SharedLog, locked};
use arlequin::dem_beam::{BeamMaterial, Contact, ContactLaw, Criterion, DemModel, Fracture, Matter};
use arlequin::fem_ref::{Elastic, ElementKind, FemModel};

pub(super) const CASES: &[HardCase] = &[
    HardCase {
        name: "a particle loses all bonds in the overlap",
        why: "its mass is the mean of its bonds' weights, and it has no bond left; multipliers still hold it",
        naive: "masses from the bonds that are left: 0/0",
        promise: "it keeps its mass, the balance closes, and a warning names it with the remedy",
        fast: true,
        run: one_particle,
    },
    HardCase {
        name: "a fragment leaves the overlap",
        why: "weights and multipliers belong to the place the fragment came from",
        naive: "weights of the place where it is now: energy appears out of nothing",
        promise: "the balance and the momenta are kept, a warning says what holds the fragment",
        fast: true,
        run: fragment,
    },
    HardCase {
        name: "a bond breaks on the border of the overlap",
        why: "one end has no partner, the other next to no weight (epsilon 1e-6)",
        naive: "the bond's own energy is booked, not its share: up to a million times too much",
        promise: "its share is booked exactly at both borders, across them and in them",
        fast: true,
        run: border,
    },
    HardCase {
        name: "everything breaks at once",
        why: "no bond is left, in the overlap either; all energy of the particles leaves in one step",
        naive: "the energy at the new positions is booked: the balance misses the half step",
        promise: "the balance closes to round-off, contact creates nothing, nothing is other than finite",
        fast: true,
        run: everything,
    },
];

const BEAM: BeamMaterial = BeamMaterial {
    young: 3.56,
    poisson: 0.3,
    radius_ratio: 0.71,
};

/// Spheres, their bonds and the volume they represent.
pub(super) struct Cloud {
    pub(super) positions: Vec<Vector3<f64>>,
    pub(super) radii: Vec<f64>,
    pub(super) pairs: Vec<[u32; 2]>,
    volume: f64,
}

impl Cloud {
    /// Builds a cubic lattice of spacing `h` in the unit section up to `x = 4`, with its first layer at
    /// `first`.
    pub(super) fn lattice(h: f64, first: f64) -> Self {
        let across = (1.0 / h).round() as usize;
        let along = ((4.0 - first) / h).round() as usize;
        let coordinate = |k: usize, from: f64| from + h * k as f64;
        let mut positions = Vec::new();
        for i in 0..along {
            for j in 0..across {
                positions.extend((0..across).map(|k| {
                    Vector3::new(
                        coordinate(i, first),
                        coordinate(j, 0.5 * h),
                        coordinate(k, 0.5 * h),
                    )
                }));
            }
        }
        let mut pairs = Vec::new();
        for i in 0..positions.len() {
            // Neighbours along z, y and x; the distance excludes the wrap to the next row or layer.
            for step in [1, across, across * across] {
                let near = positions
                    .get(i + step)
                    .map(|x: &Vector3<f64>| (x - positions[i]).norm());
                if near.is_some_and(|d| d < 1.01 * h) {
                    pairs.push([i as u32, (i + step) as u32]);
                }
            }
        }
        Self {
            radii: vec![0.5 * h; positions.len()],
            volume: positions.len() as f64 * h * h * h,
            positions,
            pairs,
        }
    }

    /// Returns the number of the sphere nearest to `x`.
    pub(super) fn near(&self, x: [f64; 3]) -> usize {
        let x = Vector3::from(x);
        let distance = |i: &usize| (self.positions[*i] - x).norm();
        let numbers = 0..self.positions.len();
        numbers
            .min_by(|a, b| distance(a).total_cmp(&distance(b)))
            .unwrap_or_default()
    }

    pub(super) fn model(&self) -> Result<DemModel> {
        let matter = Matter {
            beam: BEAM,
            density: 1.0,
            volume: self.volume,
        };
        let model = DemModel::from_spheres("right", &self.positions, &self.radii, &self.pairs, &matter)?;
        Ok(model)
    }
}

/// Displacement or velocity of a sphere by its number in the cloud and its position.
pub(super) type Field<'a> = &'a dyn Fn(usize, &Vector3<f64>) -> Vector3<f64>;

/// Initial state and settings of a run.
pub(super) struct Start<'a> {
    pub(super) epsilon: f64,
    pub(super) step: TimeStep<f64>,
    pub(super) displacement: Field<'a>,
    pub(super) velocity: Field<'a>,
    /// Uniform strain of the elements at the start.
    pub(super) strain: f64,
}

impl Default for Start<'_> {
    fn default() -> Self {
        Self {
            epsilon: 0.05,
            step: TimeStep::Fraction(0.1),
            displacement: &|_, _| Vector3::zeros(),
            velocity: &|_, _| Vector3::zeros(),
            strain: 0.0,
        }
    }
}

/// A coupled run with fracture, and the log of its broken bonds.
pub(super) struct Torn {
    pub(super) run: Coupled<f64>,
    pub(super) log: SharedLog,
    /// Weights of the bonds, by the model's bond numbers.
    weights: Vec<f64>,
    /// Number of each sphere in the model.
    pub(super) places: Vec<u32>,
}

/// Builds the further effects of a model.
pub(super) type Extra<'a> = &'a dyn Fn(&DemModel) -> Result<Vec<Box<dyn EffectSpec<f64>>>>;

pub(super) fn coupled(cloud: &Cloud, spec: Fracture, start: &Start<'_>, extra: Extra<'_>) -> Result<Torn> {
    let coarse = solid::weights(Profile::Cubic, start.epsilon)?;
    let fine = Weights::complement_of(std::slice::from_ref(&coarse));
    let elements = block(ElementKind::Hex8, [0.0, 3.0], [6, 2, 2])?;
    let left = FemModel::new("left", elements, Elastic::new(1.0, 0.17, 1.0)?)?;
    let stretched: Vec<f64> = left
        .nodes()
        .iter()
        .flat_map(|x| [x.x, x.y, x.z])
        .map(|x| start.strain * x)
        .collect();
    let still = vec![0.0; stretched.len()];
    let mut model = cloud.model()?.with_fracture(spec)?;
    // Weights of the bonds are read here, before the run takes the model.
    model.set_internal_weight(&*fine.internal)?;
    let body = model.body();
    let weights: Vec<f64> = (0..body.pairs().len()).map(|b| body.weight(b)).collect();
    let log = model.break_log();
    let places = model.places().to_vec();
    let n = model.layout().dofs();
    let (mut q, mut v) = (vec![0.0; n], vec![0.0; n]);
    for (i, place) in places.iter().enumerate() {
        let o = 3 * *place as usize;
        q[o..o + 3].copy_from_slice((start.displacement)(i, &cloud.positions[i]).as_slice());
        v[o..o + 3].copy_from_slice((start.velocity)(i, &cloud.positions[i]).as_slice());
    }
    let effects = extra(&model)?;
    let mut right = Subdomain::fine(model, fine).with_initial(q, v)?;
    for e in effects {
        right = right.with_effect(e);
    }
    let left = Subdomain::coarse(left, coarse).with_initial(stretched, still)?;
    let mediator = solid::mediator(ElementKind::Hex8, solid::OVERLAP, [2, 2, 2])?;
    let interface = InterfaceSpec {
        options: InterfaceOptions {
            sampling: Sampling::Particles,
            // The initial states of both models disagree on purpose.
            start_jump: 1.0,
            ..InterfaceOptions::default()
        },
        ..solid::spec(mediator, Box::new(L2))
    };
    Ok(Torn {
        run: Coupled::new(vec![left, right], vec![interface], start.step, None)?,
        log,
        weights,
        places,
    })
}

/// Returns no further effects.
fn none(_: &DemModel) -> Result<Vec<Box<dyn EffectSpec<f64>>>> {
    Ok(Vec::new())
}

impl Torn {
    /// Runs, and adds the checks of every case: ledger, momenta, constraint, finite numbers, and booked
    /// energy equal to released energy.
    fn keeps(&mut self, out: &mut Outcome, name: &str, steps: usize) -> Result<()> {
        let (before, energy) = (self.run.momentum(), self.run.energy());
        let mass: f64 = self.run.subdomains().iter().flat_map(|s| &s.inertia()[..3]).sum();
        self.run.run(steps, &mut Silent)?;
        // With this energy, the bodies cannot have a larger momentum.
        let scale = (2.0 * mass * energy).sqrt();
        let after = self.run.momentum();
        // Contact turns spheres about their current positions, but angular momentum is about their initial
        // positions, so it is not compared.
        let conserved = if self.run.effects().len() > 1 { 1 } else { 2 };
        for (k, what) in ["linear", "angular"].into_iter().enumerate().take(conserved) {
            let change = (after[k] - before[k]).norm() / scale;
            out.add(
                format!("change of the {what} momentum{name}"),
                change,
                0.0..=1e-11,
            );
        }
        let line = self.run.effects().swap_remove(0);
        let released = locked(&self.log).released();
        let booked = line.dissipated().unwrap_or(f64::NAN);
        out.add(
            format!("relative error of the energy booked{name}"),
            (booked - released).abs() / released.max(f64::MIN_POSITIVE),
            0.0..=1e-12,
        );
        out.add(format!("drift{name}"), self.run.drift(), 0.0..=1e-12);
        let jump = self.run.constraint_residual();
        out.add(format!("velocity jump{name}"), jump, 0.0..=1e-11);
        let numbers = |s: &Subdomain<f64>| {
            s.state()
                .q
                .iter()
                .chain(&s.state().v)
                .filter(|x| !x.is_finite())
                .count()
        };
        let bad: usize = self.run.subdomains().iter().map(numbers).sum();
        out.add(
            format!("numbers that are not finite{name}"),
            bad as f64,
            0.0..=0.0,
        );
        Ok(())
    }

    fn broken(&self) -> f64 {
        locked(&self.log).events().len() as f64
    }

    /// Counts the warnings that contain a text.
    fn warnings(&self, text: &str) -> f64 {
        self.run
            .watch()
            .iter()
            .filter(|(_, f)| f.message.contains(text))
            .count() as f64
    }

    /// Returns the displacement of sphere `i` of the cloud.
    fn moved(&self, i: usize) -> Vector3<f64> {
        let q = &self.run.subdomains()[1].state().q;
        let o = 3 * self.places[i] as usize;
        Vector3::new(q[o], q[o + 1], q[o + 2])
    }
}

fn one_particle() -> Result<Outcome> {
    let mut out = Outcome::default();
    let cloud = Cloud::lattice(0.25, 2.125);
    let loner = cloud.near([2.375, 0.375, 0.375]);
    let shift = Vector3::repeat(0.01);
    let start = Start {
        displacement: &|i, _| if i == loner { shift } else { Vector3::zeros() },
        ..Start::default()
    };
    let mut torn = coupled(&cloud, Fracture::new(Criterion::Mises, 0.2), &start, &none)?;
    torn.keeps(&mut out, "", 4000)?;
    out.add("bonds broken", torn.broken(), 6.0..=6.0);
    let name = format!("1 particles have none left ({})", torn.places[loner]);
    out.add("warnings that name the particle", torn.warnings(&name), 1.0..=1.0);
    let remedy = torn.warnings("enlarge the region of particles");
    out.add("warnings that name the remedy", remedy, 1.0..=1.0);
    // The multipliers still hold it, so that it stays near.
    let far = (torn.moved(loner) - shift).norm() / cloud.radii[loner];
    out.add("way of the particle in its radii", far, 0.0..=1.0);
    // The naive masses: means over the remaining bonds, by the rule that made the initial masses.
    let (mut sum, mut left) = (vec![0.0; cloud.radii.len()], vec![0.0; cloud.radii.len()]);
    let model = cloud.model()?;
    let log = locked(&torn.log);
    for (b, pair) in model
        .body()
        .pairs()
        .iter()
        .enumerate()
        .filter(|(b, _)| !log.is_broken(*b))
    {
        for i in pair {
            sum[*i as usize] += torn.weights[b];
            left[*i as usize] += 1.0;
        }
    }
    let nan = sum
        .iter()
        .zip(&left)
        .filter(|(s, n): &(&f64, &f64)| (*s / *n).is_nan())
        .count();
    out.add_naive("masses that are not a number", nan as f64, 1.0..=1.0);
    Ok(out)
}

fn fragment() -> Result<Outcome> {
    let mut out = Outcome::default();
    let cloud = Cloud::lattice(0.125, 2.0625);
    let chip = |x: &Vector3<f64>| (x - Vector3::new(2.5, 1.0, 0.5)).norm() < 0.3;
    let away = Vector3::new(0.6, 0.8, 0.0);
    let start = Start {
        step: TimeStep::Fraction(0.2),
        displacement: &|_, x| if chip(x) { away * 0.02 } else { Vector3::zeros() },
        velocity: &|_, x| if chip(x) { away * 0.3 } else { Vector3::zeros() },
        ..Start::default()
    };
    let spec = Fracture::new(Criterion::Mises, 0.35);
    let mut torn = coupled(&cloud, spec, &start, &none)?;
    let chips: Vec<usize> = (0..cloud.radii.len())
        .filter(|i| chip(&cloud.positions[*i]))
        .collect();
    torn.keeps(&mut out, "", 300)?;
    out.add("bonds broken", torn.broken(), 1.0..=1000.0);
    // The multipliers of the place it came from hold it back.
    let mean = chips.iter().map(|i| torn.moved(*i).dot(&away)).sum::<f64>() / chips.len() as f64;
    let flown = 0.02 + 0.3 * torn.run.time();
    out.add(
        "way of the fragment over that of free flight",
        mean / flown,
        0.05..=0.25,
    );
    out.add(
        "way of the fragment in particle radii",
        mean / cloud.radii[0],
        1.0..=5.0,
    );
    out.add(
        "warnings of what holds it",
        torn.warnings("pieces moved apart"),
        1.0..=1.0,
    );
    // The naive weights: those at each particle's current position.
    let weight = solid::weights(Profile::Cubic, 0.05)?.kinetic;
    let share = |x: Vector3<f64>| 1.0 - weight.value(&x.into());
    let sums = chips.iter().fold([0.0, 0.0], |s, i| {
        let x = cloud.positions[*i];
        [s[0] + share(x), s[1] + share(x + torn.moved(*i))]
    });
    out.add_naive(
        "mass of the fragment over what it was",
        sums[1] / sums[0],
        1.0..=20.0,
    );
    spared(&mut out, &cloud, spec, &start)?;
    Ok(out)
}

/// Checks the same run with the bonds of the overlap spared.
fn spared(out: &mut Outcome, cloud: &Cloud, spec: Fracture, start: &Start<'_>) -> Result<()> {
    let spared = Fracture {
        spare_overlap: true,
        ..spec
    };
    let mut whole = coupled(cloud, spared, start, &none)?;
    whole.run.run(300, &mut Silent)?;
    let inside = locked(&whole.log)
        .events()
        .iter()
        .filter(|e| whole.weights[e.bond as usize] < 1.0 - 1e-9)
        .count();
    out.add(
        "bonds broken in the overlap with spare_overlap",
        inside as f64,
        0.0..=0.0,
    );
    out.add("drift with spare_overlap", whole.run.drift(), 0.0..=1e-12);
    out.add(
        "warnings with spare_overlap",
        whole.warnings("inside an overlap"),
        0.0..=0.0,
    );
    Ok(())
}

fn border() -> Result<Outcome> {
    let mut out = Outcome::default();
    // Each case: position of the first layer, ends of the bond that breaks, accepted range of its weight.
    let h = 0.25;
    let along = |x: f64| [[x - 0.5 * h, 0.375, 0.375], [x + 0.5 * h, 0.375, 0.375]];
    let across = |x: f64| [[x, 0.375, 0.375], [x, 0.625, 0.375]];
    let cases = [
        ("across x = 2", 2.0 - 0.5 * h, along(2.0), 7e-3..=8e-3),
        ("across x = 3", 2.0 + 0.5 * h, along(3.0), 0.99..=0.995),
        ("in x = 2", 2.0, across(2.0), 0.0..=0.0),
        ("just inside x = 2", 2.0001, across(2.0001), 1e-6..=2e-6),
        ("in x = 3", 2.0, across(3.0), 1.0..=1.0),
    ];
    for (name, first, ends, weight) in cases {
        let cloud = Cloud::lattice(h, first);
        let [i, j] = ends.map(|x| cloud.near(x));
        let axis = (cloud.positions[j] - cloud.positions[i]).normalize();
        let start = Start {
            epsilon: 1e-6,
            // Both ends move apart, so their bond is stretched twice as much as any other.
            displacement: &|k, _| match k {
                k if k == i => axis * -0.005,
                k if k == j => axis * 0.005,
                _ => Vector3::zeros(),
            },
            ..Start::default()
        };
        let mut torn = coupled(&cloud, Fracture::new(Criterion::Axial, 0.1), &start, &none)?;
        torn.keeps(&mut out, &format!(", {name}"), 2000)?;
        let event = locked(&torn.log).events().first().copied();
        let share = event.map_or(f64::NAN, |e| torn.weights[e.bond as usize]);
        out.add(format!("weight of the bond, {name}"), share, weight);
        // A layer on the border is held by almost no weight: its ends swing far and may break another such
        // bond.
        let top = if share > 1e-3 { 1.0 } else { 4.0 };
        out.add(format!("bonds broken, {name}"), torn.broken(), 1.0..=top);
        if name == "just inside x = 2" {
            out.add_naive("energy of the bond over its share", 1.0 / share, 5e5..=1e6);
        }
    }
    Ok(out)
}

fn everything() -> Result<Outcome> {
    let mut out = Outcome::default();
    let cloud = Cloud::lattice(0.25, 2.125);
    let strain = 0.01;
    let start = Start {
        displacement: &|_, x| x * strain,
        strain,
        ..Start::default()
    };
    let law = ContactLaw::elastic(1.4);
    let touching =
        |m: &DemModel| -> Result<Vec<Box<dyn EffectSpec<f64>>>> { Ok(vec![Box::new(Contact::new(m, law)?)]) };
    let spec = Fracture::new(Criterion::Energy, 1e-9);
    let mut torn = coupled(&cloud, spec, &start, &touching)?;
    let stored = torn.run.subdomains()[1].internal_energy();
    let total = torn.run.energy();
    torn.run.advance(&mut Silent)?;
    let released = locked(&torn.log).released();
    out.add(
        "bonds broken in the first step",
        torn.broken(),
        cloud.pairs.len() as f64..=cloud.pairs.len() as f64,
    );
    out.add(
        "energy booked over what the particles held",
        released / stored,
        0.95..=1.0,
    );
    let remaining = torn.run.subdomains()[1].internal_energy();
    out.add("energy of the particles after it", remaining, 0.0..=0.0);
    torn.keeps(&mut out, "", 4000)?;
    let created = torn
        .run
        .effects()
        .iter()
        .filter_map(|e| e.dissipated())
        .fold(0.0_f64, |m, d| m.max(-d));
    out.add(
        "energy created by an effect over all",
        created / total,
        0.0..=1e-3,
    );
    let after = torn.run.energy() + locked(&torn.log).released();
    out.add(
        "energy with what was released over that of the start",
        after / total,
        0.9..=1.0 + 1e-3,
    );
    // At the new positions, the energy differs by the half step before the bonds broke.
    let mut unbroken = coupled(&cloud, Fracture::new(Criterion::Energy, 1e9), &start, &touching)?;
    unbroken.run.advance(&mut Silent)?;
    let new = unbroken.run.subdomains()[1].internal_energy();
    out.add_naive(
        "share of it that is missing if the energy at the new positions is booked",
        (released - new).abs() / released,
        1e-4..=1.0,
    );
    Ok(out)
}
