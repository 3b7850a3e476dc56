//! Tests of the facade with its models, linked as one program instead of 23.

#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

mod chains;
mod claims;
mod closed_forms;
mod coupling_properties;
mod cracks;
mod determinism;
mod displacement_jump;
mod energy_release;
mod facet_contact;
mod following_pressure;
mod fracture_benchmarks;
mod fragment_contact;
mod hard_cases;
mod hertz_contact;
mod multipliers;
mod natural_patch;
mod nodal_weighting;
mod nonlinear;
mod overlap_breakage;
mod own_steps;
mod pair_effects;
mod partition;
mod partition_guards;
mod partition_packings;
mod properties;
mod restart;
mod rezoning;
mod rezoning_contacts;
mod rezoning_space;
mod solid;
mod support;
mod surface_contact;
mod theory;
