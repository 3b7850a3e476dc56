//! A run that is ready to step, with the data around it.

use super::between::ParticlesWithoutContact;
use super::body::Body;
use super::bounds::Bounds;
use super::clock::PhaseTime;
use super::mesh::Grid;
use super::probe::ProbeReader;
use super::rigid::RigidPicture;
use super::statics::LoadSteps;
use super::zone::{Moving, ZoneLine};
use crate::ranks::RankLine;
use crate::setup::packing::PackingLine;
use arlequin::core::{Coupled, Elastic, Interpolation, Materials};
use arlequin::dem_beam::fracture::SharedLog;
use std::sync::Arc;

/// Data of a model that output needs besides the state.
#[derive(Clone)]
pub struct ModelInfo {
    /// Mesh for output.
    pub grid: Arc<Grid>,
    /// Displacement field.
    pub field: Arc<dyn Interpolation<f64>>,
    /// Main material, if it is known; volumes of a mesh file can have others.
    pub material: Option<Elastic<f64>>,
    /// Materials of the elements.
    pub materials: Option<Materials<f64>>,
    /// Log of broken bonds, if bonds can break.
    pub breaks: Option<SharedLog>,
    /// Mean distance between nodes or particles \[m\].
    pub spacing: f64,
    /// Properties of the packing, for particles.
    pub packing: Option<PackingLine>,
}

impl std::fmt::Debug for ModelInfo {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let field = self.field.kind();
        write!(
            f,
            "ModelInfo of {} nodes with a {field} field",
            self.grid.points.len()
        )
    }
}

impl ModelInfo {
    pub(super) fn from_body(body: &Body) -> Self {
        Self {
            grid: body.grid.clone(),
            field: body.field.clone(),
            material: body.material,
            materials: body.materials.clone(),
            breaks: body.grains.as_ref().and_then(|g| g.breaks.clone()),
            spacing: body.spacing,
            packing: body.grains.as_ref().map(|g| g.packing.clone()),
        }
    }
}

/// A run that is ready to step, with the data around it.
#[derive(Debug)]
pub struct Built {
    /// Coupled models.
    pub run: Coupled<f64>,
    /// Output data of the models.
    pub models: Vec<ModelInfo>,
    /// Meshes of the mediators, for output.
    pub mediators: Vec<Grid>,
    /// Outlines of rigid bodies, for output.
    pub rigid: Vec<RigidPicture>,
    /// Readers of the probes.
    pub probes: Vec<ProbeReader>,
    /// Number of steps.
    pub steps: usize,
    /// Load steps of a `[static]` scene.
    pub load_steps: Option<LoadSteps>,
    /// Number of steps between two frames.
    pub frame_every: usize,
    /// Pairs of particle models without contact.
    pub without_contact: ParticlesWithoutContact,
    /// Warnings for the user before the first step: about bodies, interfaces and the scene as a whole.
    pub warnings: Vec<String>,
    /// Bounds of a plausible motion of each model.
    pub bounds: Bounds,
    /// Widths of the overlaps around zones.
    pub zones: Vec<ZoneLine>,
    /// The zone that goes where it is needed.
    pub moving: Option<Moving>,
    /// Distribution of the models over ranks; empty for a single rank.
    pub holdings: Vec<RankLine>,
    /// Wall times of the phases of the set-up, in order.
    pub phases: Vec<PhaseTime>,
}
