//! Tests of scenes, linked as one program instead of 20.

mod before_packing;
mod cracks;
mod end_zones;
mod energy_release;
mod far_field;
mod fracture_energy;
mod fragments;
mod intrusions;
mod loads;
mod locking;
mod over_time;
mod overlap_breaks;
mod pieces;
mod plate_with_hole;
mod ranks;
mod reactions;
mod refusals;
mod rooms;
mod shipped;
mod statics;
mod stresses;
mod surface_contact;
mod surface_loads;
mod volumes;
mod zone;
