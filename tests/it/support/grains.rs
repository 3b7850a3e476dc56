//! Particles in a cylinder of 3 mm by 0.5 mm.

use arlequin::dem_beam::{BeamMaterial, Container, DemModel, PackingSpec};

/// Returns a packing that begins at `from` \[m\].
pub(crate) fn packed(name: &str, from: f64, count: usize) -> DemModel {
    squeezed(name, from, count, 0.0)
}

/// Returns a packing whose spheres are moved along the axis by up to `most`, so that they crowd in one half
/// of the overlap and thin out in the other.
pub(crate) fn squeezed(name: &str, from: f64, count: usize, amplitude: f64) -> DemModel {
    let container = Container::cylinder(3e-3, 0.5e-3).unwrap();
    let mut packing = PackingSpec::quench(container, count, 1).build().unwrap();
    for x in &mut packing.positions {
        let wave = (std::f64::consts::PI * x.x.clamp(0.0, 1e-3) / 1e-3).sin();
        x.x += from - amplitude * wave;
    }
    DemModel::new(name, &packing, BeamMaterial::SILICA, 2200.0).unwrap()
}
