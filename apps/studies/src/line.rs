//! One-dimensional setting of the method's acceptance checks: E = ρ = S = c = 1, particle spacing 1,
//! overlap `[−L_O, 0]`. Bar nodes lie at `−h j` to the left, particles at `−L_O + j` to the right. The
//! mediator has equal linear elements.

use arlequin::core::nalgebra::Point3;
use arlequin::core::{
    Coupled, H1Gradient, InterfaceOptions, InterfaceSpec, Junction, L2, OwnStep, Partition, Profile, Ramp,
    Result, Slab, Subdomain, TimeStep, Weight, Weighting, Weights,
};
use arlequin::fem_ref::{Elastic, FemField, FemModel, generate};
use spring_chain::Chain;
use std::sync::Arc;

/// Index of the left subdomain, the coarse bar.
pub const COARSE: usize = 0;
/// Index of the right subdomain, the fine chain.
pub const FINE: usize = 1;

/// Scalar product of the constraint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Product {
    /// `∫ λ v`.
    L2,
    /// `∫ λ v + l² λ' v'` with the given `l`.
    H1(f64),
}

impl Product {
    fn build(self) -> Result<Box<dyn Junction<f64>>> {
        Ok(match self {
            Self::L2 => Box::new(L2),
            Self::H1(l) => Box::new(H1Gradient::new(l)?),
        })
    }
}

/// Parameters of one case; [`Line::default`] is the setting that most checks share.
#[derive(Debug, Clone)]
pub struct Line {
    /// Length of a coarse element.
    pub h: f64,
    /// Width of the overlap.
    pub overlap: f64,
    /// Length `h_B` of a mediator element.
    pub mediator: f64,
    /// Weight across the overlap.
    pub profile: Profile<f64>,
    /// Smallest weight.
    pub epsilon: f64,
    /// Number of bar elements.
    pub coarse_elements: usize,
    /// Number of springs in the chain.
    pub fine_bonds: usize,
    /// How weights enter the models.
    pub weighting: Weighting,
    /// Time step.
    pub step: TimeStep<f64>,
    /// Own steps of the bar and of the chain.
    pub own: [OwnStep<f64>; 2],
    /// Replaces the weights in the overlap by a constant over the whole subdomains.
    pub everywhere: Option<f64>,
    /// Scalar product of the constraint.
    pub junction: Product,
    /// Options of the interface.
    pub options: InterfaceOptions<f64>,
}

impl Default for Line {
    fn default() -> Self {
        Self {
            h: 10.0,
            overlap: 20.0,
            mediator: 10.0,
            profile: Profile::Linear,
            epsilon: 0.05,
            coarse_elements: 150,
            fine_bonds: 1500,
            weighting: Weighting::Energy,
            step: TimeStep::Seconds(0.5),
            own: [OwnStep::Same; 2],
            everywhere: None,
            junction: Product::L2,
            options: InterfaceOptions::default(),
        }
    }
}

/// Returns displacement and velocity at a position x of one subdomain.
pub type Wave<'a> = &'a dyn Fn(f64) -> (f64, f64);

impl Line {
    fn coarse_weights(&self) -> Result<Weights<f64>> {
        let weight: Arc<dyn Weight<f64>> = match self.everywhere {
            Some(w) => Arc::new(arlequin::core::Uniform(w)),
            // A constant over the whole models is no ramp: there is no place at which it could change.
            None => {
                let slab = Slab::between(Point3::origin(), Point3::new(-self.overlap, 0.0, 0.0))?;
                Arc::new(Ramp::new(Arc::new(slab), self.profile.clone(), self.epsilon)?)
            }
        };
        Ok(Weights::from_weight(weight).with_weighting(self.weighting))
    }

    /// Returns the multiplier space.
    ///
    /// # Errors
    /// Errors of the core and the models.
    pub fn mediator_space(&self) -> Result<Arc<FemField<f64>>> {
        let n = (self.overlap / self.mediator).round() as usize;
        Ok(Arc::new(FemField::new(generate::bar(
            -self.overlap,
            0.0,
            n,
            1.0,
        )?)))
    }

    fn interface(&self) -> Result<InterfaceSpec<f64>> {
        Ok(InterfaceSpec {
            name: "overlap".into(),
            coarse: COARSE,
            fine: FINE,
            mediator: self.mediator_space()?,
            junction: self.junction.build()?,
            options: self.options,
        })
    }

    /// Builds bar and chain with their weights, in the given initial state.
    ///
    /// # Errors
    /// Errors of the core and the models.
    pub fn subdomains(&self, coarse: Wave, fine: Wave) -> Result<[Subdomain<f64>; 2]> {
        let weights = self.coarse_weights()?;
        // From left to right, as bars need ascending nodes.
        let x: Vec<f64> = (0..=self.coarse_elements)
            .rev()
            .map(|j| -self.h * j as f64)
            .collect();
        let bar = FemModel::new("bar", generate::bar_at(&x, 1.0)?, Elastic::new(1.0, 0.0, 1.0)?)?;
        let chain = Chain::new("chain", -self.overlap, 1.0, self.fine_bonds, 1.0, 1.0)?;
        let fill = |s: Subdomain<f64>, wave: Wave| {
            let (q, v) = s.model().nodes().iter().map(|p| wave(p.x)).unzip();
            s.with_initial(q, v)
        };
        let right = Weights::complement_of(std::slice::from_ref(&weights));
        // Constants over whole models make an impedance jump, which is intended here.
        let partition = match self.everywhere {
            Some(_) => Partition::Unchecked,
            None => Partition::Checked,
        };
        let bar = Subdomain::coarse(bar, weights).with_partition(partition);
        let [left_step, right_step] = self.own;
        let chain = Subdomain::fine(chain, right).with_step(right_step);
        Ok([fill(bar.with_step(left_step), coarse)?, fill(chain, fine)?])
    }

    /// Builds a run from given subdomains.
    ///
    /// # Errors
    /// Errors of the core and the models.
    pub fn build_with(&self, subdomains: Vec<Subdomain<f64>>) -> Result<Coupled<f64>> {
        Coupled::new(subdomains, vec![self.interface()?], self.step, None)
    }

    /// Builds a run from the given initial state.
    ///
    /// # Errors
    /// Errors of the core and the models.
    pub fn build(&self, coarse: Wave, fine: Wave) -> Result<Coupled<f64>> {
        self.build_with(self.subdomains(coarse, fine)?.into())
    }
}

/// Wave at rest: displacement and velocity are zero.
pub fn rest(_: f64) -> (f64, f64) {
    (0.0, 0.0)
}

/// Returns the wave `cos⁴(πy/2) cos(k(x − x0))` with `y = (x − x0)/W`, which travels with velocity `speed`.
pub fn pulse(x0: f64, width: f64, k: f64, speed: f64) -> impl Fn(f64) -> (f64, f64) {
    move |x| {
        let y = (x - x0) / width;
        // Exactly zero outside, so that nothing runs ahead of the pulse.
        if y.abs() >= 1.0 {
            return (0.0, 0.0);
        }
        let half = std::f64::consts::FRAC_PI_2;
        let (c, s) = ((half * y).cos(), (half * y).sin());
        let (wave, slope) = ((k * (x - x0)).cos(), -k * (k * (x - x0)).sin());
        // The velocity of a wave in one direction: minus the speed times the slope.
        let gradient = -4.0 * c.powi(3) * s * half / width * wave + c.powi(4) * slope;
        (c.powi(4) * wave, -speed * gradient)
    }
}

/// Advances a run without an observer.
///
/// # Errors
/// Errors of the steps.
pub fn run(coupled: &mut Coupled<f64>, steps: usize) -> Result<()> {
    coupled.run(steps, &mut arlequin::core::Silent).map(|_| ())
}

/// Returns the displacement of one subdomain with the largest modulus, among nodes whose x satisfies
/// `keep`.
pub fn peak(coupled: &Coupled<f64>, side: usize, keep: impl Fn(f64) -> bool) -> f64 {
    let s = &coupled.subdomains()[side];
    let inside = s
        .model()
        .nodes()
        .iter()
        .zip(&s.state().q)
        .filter(|(p, _)| keep(p.x));
    inside
        .map(|(_, q)| *q)
        .fold(0.0, |a: f64, b| if b.abs() > a.abs() { b } else { a })
}
