//! Arlequin: couples dissimilar mechanics models by overlapping them.
//!
//! # The method on one page
//!
//! Two models of one body, a **coarse** and a **fine** one, overlap in `Ω_O`. There they
//!
//! 1. **share the energy**: weights `α`, `β`, `γ` for internal, kinetic and external energy, `f` for the coarse model and
//!    `1 − f` for the fine one ([`core::weight`]). Weights belong to elements and bonds and masses follow them, so that the
//!    weighted energy is conserved and the critical step stays what it was;
//! 2. are **tied by multipliers** `λ` on a mediator space of their own ([`core::mediator`]) through a junction
//!    `⟨λ, u̇ − ḋ⟩ = ∫ λ·v + l² ε(λ):ε(v)` ([`core::junction`]).
//!
//! With `B_C`, `B_D` the coupling matrices, the discrete equations
//!
//! ```text
//! M_β ü = F_γ − F_int,α − B_Cᵀ λ        m_β̄ d̈ = f_γ̄ − f_int,ᾱ + B_Dᵀ λ        B_C u̇ − B_D ḋ = 0
//! ```
//!
//! are advanced by velocity Verlet: each model predicts, one small symmetric system `A λ = B_C u̇* − B_D ḋ*` with
//! `A = Δt/2 (B_C M⁻¹ B_Cᵀ + B_D m⁻¹ B_Dᵀ)` gives the multipliers, both models are corrected ([`core::coupled`]). A model
//! never sees the other one: any implementer of [`core::Model`] with a [`core::field::Interpolation`] can be coupled with
//! any other. The static twin solves the same objects as a saddle-point problem ([`core::coupled::statics`]).
//!
//! # Crates
//!
//! [`core`] holds the traits and the method; [`fem_ref`] linear finite elements; [`dem_beam`] the cohesive-beam discrete
//! element model; [`cnem`] the constrained natural element method. This crate re-exports them and holds no logic.

pub use arlequin_core as core;
pub use {cnem, dem_beam, fem_ref};
