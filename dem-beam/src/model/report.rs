//! Report of a model in readable form.

use super::DemModel;
use crate::kernel::engine::Isa;
use crate::kernel::layout::Layout;
use crate::packing::PackingReport;
use std::fmt;

/// Facts about a model; [`fmt::Display`] prints them on a few lines.
#[derive(Debug, Clone, PartialEq)]
pub struct DemReport {
    /// Name of the model.
    pub name: String,
    /// Number of particles.
    pub particles: usize,
    /// Number of bonds.
    pub bonds: usize,
    /// Twice the number of bonds over the number of particles.
    pub coordination: f64,
    /// Unweighted mass \[kg\].
    pub mass: f64,
    /// Volume of the body \[m³\].
    pub volume: f64,
    /// Mean particle radius \[m\].
    pub mean_radius: f64,
    /// True if rotations may be large.
    pub finite_rotations: bool,
    /// Instruction set of the kernel.
    pub instruction_set: &'static str,
    /// Bytes of bond data per bond.
    pub bytes_per_bond: f64,
    /// Report of the packing, if the model was made of one.
    pub packing: Option<PackingReport>,
}

impl DemModel {
    /// Returns facts about the model; in a rank's part of a partitioned body, about that part and all bonds
    /// of its particles.
    #[must_use]
    pub fn report(&self) -> DemReport {
        let (n, bonds) = (self.centres().len(), self.body.pairs().len());
        let mut bonds_of_particles = self.bond_counts();
        // Only owned particles have blocks in the kernel.
        bonds_of_particles.truncate(n);
        let bytes = Layout::bytes(&bonds_of_particles, self.has_finite_rotations());
        DemReport {
            name: self.name.clone(),
            particles: n,
            bonds,
            coordination: 2.0 * bonds as f64 / n as f64,
            mass: self.mass.iter().sum(),
            volume: self.volume,
            mean_radius: self.body.mean_radius(),
            finite_rotations: self.has_finite_rotations(),
            instruction_set: Isa::detect().name(),
            bytes_per_bond: bytes as f64 / bonds.max(1) as f64,
            packing: self.packing.clone(),
        }
    }
}

impl fmt::Display for DemReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let law = if self.finite_rotations { "finite" } else { "small" };
        writeln!(
            f,
            "{}: {} particles of mean radius {:.4e} m, {} bonds ({:.3} per particle), {law} rotations",
            self.name, self.particles, self.mean_radius, self.bonds, self.coordination
        )?;
        write!(
            f,
            "mass {:.6e} kg, volume {:.6e} m3, {} kernel, {:.0} B per bond",
            self.mass, self.volume, self.instruction_set, self.bytes_per_bond
        )?;
        if let Some(p) = &self.packing {
            write!(
                f,
                "\npacking: coordination {:.3} all, {:.3} retained, {:.3} interior; volume fraction {:.4}, \
                 mean overlap {:.2e}, bond tolerance {:.2e}, fabric anisotropy {:.3}, {} dropped",
                p.coordination_all,
                p.coordination_retained,
                p.coordination_interior,
                p.volume_fraction,
                p.mean_overlap,
                p.bond_tolerance,
                p.fabric_anisotropy,
                p.dropped
            )?;
        }
        Ok(())
    }
}
