//! Arlequin: couples dissimilar mechanics models by overlapping them.
//!
//! # The method on one page
//!
//! Two models of one body, a **coarse** and a **fine** one, overlap in `Ω_O`. There they
//!
//! 1. **share the energy**: weights `α`, `β`, `γ` for internal, kinetic and external energy, `f` for the
//!    coarse model and `1 − f` for the fine one ([`core::Ramp`]). Weights belong to elements and bonds and
//!    masses follow them, so that the weighted energy is conserved and the critical step stays what it was;
//! 2. are **tied by multipliers** `λ` on a mediator space of their own ([`core::Mediator`]) through a
//!    junction `⟨λ, u̇ − ḋ⟩ = ∫ λ·v + l² ε(λ):ε(v)` ([`core::Junction`]).
//!
//! With `B_C`, `B_D` the coupling matrices, the equations are
//!
//! ```text
//! M_β ü = F_γ − F_int,α − B_Cᵀ λ        m_β̄ d̈ = f_γ̄ − f_int,ᾱ + B_Dᵀ λ        B_C u̇ − B_D ḋ = 0
//! ```
//!
//! Each model makes its own steps of velocity Verlet with its own forces. At the end of a step of the run the
//! velocities `v⁻` of both models are reflected: with `B = [B_C, −B_D]`, one small symmetric system `S μ = B
//! v⁻`, `S = B M⁻¹ Bᵀ`, gives the multipliers, and the models go on with `v⁺ = v⁻ − 2 M⁻¹ Bᵀ μ`. A reflection
//! keeps the kinetic energy of both models together and moves nothing ([`core::Coupled`]).
//!
//! A model never sees the other one: any implementer of [`core::Model`] with a [`core::Interpolation`] can be
//! coupled with any other, and an external solver takes part as a [`core::Participant`]. The static twin
//! solves the same objects as a saddle-point problem ([`core::Coupled::equilibrium`]).
//!
//! # Crates
//!
//! [`core`] holds the traits and the method; [`fem_ref`] linear finite elements; [`dem_beam`] the
//! cohesive-beam discrete element model; [`cnem`] the constrained natural element method. This crate
//! re-exports them and holds no logic; [`prelude`] has the names that most programs need.

pub use arlequin_core as core;
pub use {cnem, dem_beam, fem_ref};

/// Names that most programs need: `use arlequin::prelude::*;`.
///
/// The parts of a coupled run, effects included; the traits of models; and the models with their builders.
/// Names that occur in more than one crate (`cnem::Surface`, `dem_beam::Surface`) are not among them.
pub mod prelude {
    pub use arlequin_core::effect::{
        Absorber, AnyEffect, BodyForce, BulkViscosity, Effect, EffectSpec, ForceLaw, Host, Instant, Load,
        LocalDamping, MassDamping, PairSpec, Prestress, StepDemand, StiffnessDamping,
    };
    pub use arlequin_core::nalgebra::{Matrix3, Point3, Vector3};
    pub use arlequin_core::{
        CoarseModel, Complement, Components, Coupled, DofLayout, Elastic, Equilibrium, Error, FineModel,
        Guard, H1Gradient, H1Seminorm, H1Strain, InterfaceOptions, InterfaceSpec, Interpolation, Junction,
        L2, LinearModel, Mediator, Model, Needs, Observer, Overlap, OwnStep, Participant, ParticleField,
        Partition, Parts, PrescribedMotion, Primitive, Profile, Ramp, Result, Sampling, ShapeFunction, Shell,
        Silent, Slab, State, StepReport, Subdomain, TimeFunction, TimeStep, Uniform, Views, Weight,
        Weighting, Weights,
    };
    pub use cnem::{CnemModel, NaturalField};
    pub use dem_beam::{
        BeamMaterial, Contact, ContactBetween, ContactLaw, Criterion, DemModel, Fracture, Obstacle,
    };
    pub use fem_ref::{ElementKind, FemField, FemModel, Mesh, generate};
    pub use std::sync::Arc;
}
