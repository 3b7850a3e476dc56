//! Couples mechanics models by the Arlequin (bridging-domain) method: the traits of models, fields, weights,
//! mediators and junctions, and the algorithms between them. The core knows no particle, no element and no
//! Voronoi cell; it has no input or output, no clock and no random numbers.
//!
//! # Modules in reading order
//!
//! | read | for |
//! |---|---|
//! | `model`, `field` | traits of a model: [`Model`], [`CoarseModel`], [`FineModel`], [`Interpolation`] |
//! | `overlap`, `profile`, `weight` | shares of energy: [`Slab`], [`Profile`], [`Ramp`], [`Weights`] |
//! | `mediator`, `junction`, `interface` | how they are tied: [`Mediator`], [`Junction`], [`InterfaceSpec`] |
//! | [`effect`], `time` | loads, dampings, contact; time functions, of supports too |
//! | `subdomain`, `coupled` | the step and the set-up: [`Subdomain`], [`Coupled`]; equilibrium in `statics` |
//! | `ledger`, `momentum`, `observer`, [`snapshot`] | energies, momenta and warnings of a run; checkpoints |
//! | [`contact`] | contact law, energy budgets, rigid bodies, surfaces that touch them |
//! | [`conformance`] | checks for those who write models, junctions or effects |
//! | [`ranks`] | partitioned models on several ranks, with the bits of one rank |
//! | [`harmonic`], [`advice`] | reflection of an overlap, and choices that are known to do badly |
//! | [`geometry`], [`adjacency`], [`blocks`], [`linalg`] | tools that model crates use as well |
//! | [`spectrum`], [`parallel`], [`interrupt`] | critical steps, parallel loops, Ctrl-C |
//!
//! # A stiff bar and a fine one, tied over one unit of length
//!
//! ```
//! use arlequin_core::nalgebra::Point3;
//! use arlequin_core::*;
//! use fem_ref::{Elastic, FemField, FemModel, generate};
//! use std::sync::Arc;
//!
//! # fn main() -> Result<()> {
//! let at = |x: f64| Point3::new(x, 0.0, 0.0);
//! let bar = |name, from, to, elements| {
//!     let mesh = generate::bar(from, to, elements, 1.0)?;
//!     FemModel::new(name, mesh, Elastic::new(1.0, 0.0, 1.0)?)
//! };
//! let (left, right) = (bar("left", -9.0, 1.0, 20)?, bar("right", 0.0, 10.0, 80)?);
//!
//! // The left model's share falls from 1 to 0 between x = 0 and x = 1, the right one has the rest.
//! let ramp = Ramp::new(Arc::new(Slab::between(at(1.0), at(0.0))?), Profile::Cubic, 1e-3)?;
//! let coarse = Weights::from_weight(Arc::new(ramp));
//! let fine = Weights::complement_of(std::slice::from_ref(&coarse));
//!
//! let mediator = Arc::new(FemField::new(generate::bar(0.0, 1.0, 2, 1.0)?));
//! let tie = InterfaceSpec::new("overlap", 0, 1, mediator, L2);
//! let moving = vec![1.0; right.layout().dofs()];
//! let bodies = vec![
//!     Subdomain::coarse(left, coarse),
//!     Subdomain::fine(right, fine).with_initial(vec![0.0; moving.len()], moving)?,
//! ];
//! let mut run = Coupled::new(bodies, vec![tie], TimeStep::Fraction(0.9), None)?;
//! run.run(1000, &mut Silent)?;
//! assert!(run.drift() < 1e-11 && run.constraint_residual() < 1e-11);
//! # Ok(())
//! # }
//! ```

pub mod adjacency;
pub mod advice;
pub mod blocks;
pub mod conformance;
pub mod contact;
mod coupled;
mod dissection;
pub mod effect;
mod energy_release;
mod error;
mod exact;
mod extent;
mod field;
pub mod geometry;
pub mod harmonic;
mod interface;
pub mod interrupt;
mod junction;
pub mod linalg;
mod material;
mod mediator;
mod model;
mod named;
mod nodal;
mod overlap;
mod owned;
pub mod parallel;
mod participant;
mod phase;
mod profile;
pub mod ranks;
mod reach;
mod record;
mod recovery;
mod scalar;
mod share;
pub mod spectrum;
mod subdomain;
mod time;
mod tree;
mod weight;

pub use coupled::snapshot;
pub use coupled::statics::Equilibrium;
pub use coupled::{
    Coupled, Guard, Partition, PartitionReport, Parts, Plan, Relaxation, Response, Rezoned, Rezoning,
    Settled, TimeStep,
};
use coupled::{ledger, momentum, observer, warning};
pub use energy_release::{CrackFront, EnergyRelease, GradientPoint, Gradients};
pub use error::{Error, ModelError, Result, Share, invalid, not_negative};
pub use exact::Exact;
pub use field::{Interpolation, ParticleField, ShapeRow, outside};
pub use interface::{
    Interface, InterfaceOptions, InterfaceReport, InterfaceSpec, NullMode, Sampling, Side, SolutionTime,
    Solver,
};
pub use junction::{
    Components, H1Gradient, H1Seminorm, H1Strain, Junction, JunctionKind, L2, Needs, ShapeFunction,
};
pub use ledger::{DisplacementJump, EnergySample, WorkLine};
pub use material::{Elastic, Materials};
pub use mediator::{Mediator, NoMediator};
pub use model::{
    Boundary, Breakable, CoarseModel, DofLayout, Drawn, Evolution, Evolving, Facts, FineModel, KeptMeans,
    LinearModel, Model, State, StepBound, Stepping, Stride, Views, Watching, check_size,
};
pub use momentum::{Arms, BodyMomentum, Claim};
pub use nodal::NodallyWeighted;
pub use observer::{Observer, Phase, SetupPhase, Silent, StepReport};
pub use overlap::{CellPlace, Overlap, Place, Primitive, Region, Shell, Slab};
pub(crate) use owned::add_products_in;
pub use owned::{Owned, add_products};
pub use participant::{Outline, Participant};
pub use profile::{CompatibleProfile, CustomProfile, Profile, ProfileKind};
pub use recovery::{LinkSurvey, Links, Patches, Recovered, Recovery, SymmetricTensor};
pub use scalar::{Real, check_finite};
pub use subdomain::{OwnStep, PrescribedMotion, Resultant, Subdomain};
pub use time::{Formula, TimeFunction};
pub use warning::{Suspect, Warning};
pub use weight::{Changed, Complement, Product, Ramp, Uniform, Weight, Weighting, Weights};
pub use {nalgebra, sprs};
