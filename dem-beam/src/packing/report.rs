//! Report of a packing.

use super::bonding::Bonding;
use super::cells::{Sphere, centre, image, mean_radius};
use super::container::Container;
use super::narrow;
use nalgebra::{Matrix3, Vector3};

/// Bonds, spheres and volume that cuts have removed.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Cut {
    /// Number of removed bonds.
    pub bonds: usize,
    /// Number of removed spheres: the cuts left them in no connected part. Their mass is removed with them.
    pub spheres: usize,
    /// Volume that the removed spheres stood for \[m³\].
    pub volume: f64,
}

/// Bins of the radius histogram.
pub const HISTOGRAM_BINS: usize = 10;

/// Facts about a packing, for information only: the mechanics does not use them.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PackingReport {
    /// Twice the number of bonds over the number of all spheres made, including spheres that were left out.
    pub coordination_all: f64,
    /// Twice the number of bonds over the number of retained spheres.
    pub coordination_retained: f64,
    /// Mean number of bonds of the spheres farther than two mean diameters from any wall; 0 if there are
    /// none.
    pub coordination_interior: f64,
    /// Volume of all spheres over the volume of the container.
    pub volume_fraction: f64,
    /// Mean radius of the retained spheres \[m\].
    pub mean_radius: f64,
    /// Smallest and largest radius of the retained spheres \[m\].
    pub radius_range: [f64; 2],
    /// Number of retained spheres in each of equal bins of the radius range.
    pub radius_histogram: [usize; HISTOGRAM_BINS],
    /// Mean overlap of touching pairs over the mean diameter.
    pub mean_overlap: f64,
    /// Largest relative gap `d/(r_i+r_j) - 1` among the bonds.
    pub bond_tolerance: f64,
    /// Fabric tensor `mean(n n^T)`, trace 1.
    pub fabric: Matrix3<f64>,
    /// Largest deviation of a fabric eigenvalue from 1/3, times 3: 0 when isotropic.
    pub fabric_anisotropy: f64,
    /// Number of spheres wanted.
    pub asked: usize,
    /// Number of spheres placed, or read from a file.
    pub placed: usize,
    /// Number of placed spheres left out because they are in no connected part.
    pub dropped: usize,
    /// Volume of the spheres left out over that of all placed. The other spheres of their body are too heavy
    /// by this share.
    pub dropped_share: f64,
    /// Number of placed spheres cut off beyond the border of a part of a body ([`crate::packing::Around`]).
    pub beyond: usize,
    /// Number of bodies within the container: more than one for a surface of several outer shells.
    pub bodies: usize,
    /// Narrowest width of a body over the mean diameter of its spheres; `None` without walls. For surfaces
    /// the width is twice the largest distance of an inner point from the wall.
    pub across: Option<f64>,
    /// Bonds, spheres and volume removed by cuts since.
    pub cut: Cut,
    /// Number of relaxation steps.
    pub steps: usize,
}

/// Facts about the making of the spheres.
pub(crate) struct Making {
    /// Number of spheres wanted.
    pub(crate) asked: usize,
    /// Number of relaxation steps.
    pub(crate) steps: usize,
    /// Mean overlap over the mean diameter.
    pub(crate) overlap: f64,
}

impl PackingReport {
    pub(crate) fn new(
        container: &Container,
        bodies: &[Container],
        spheres: &[Sphere],
        body: &[u32],
        bonding: &Bonding,
        making: Making,
    ) -> Self {
        let retained: Vec<Sphere> = bonding.retained.iter().map(|&i| spheres[i as usize]).collect();
        let count = retained.len() as f64;
        let mean_radius = mean_radius(&retained);
        let low = retained.iter().fold(f64::INFINITY, |m, s| m.min(s[3]));
        let high = retained.iter().fold(0.0_f64, |m, s| m.max(s[3]));
        let mut radius_histogram = [0; HISTOGRAM_BINS];
        for s in &retained {
            let t = (s[3] - low) / (high - low).max(f64::MIN_POSITIVE);
            radius_histogram[((t * HISTOGRAM_BINS as f64) as usize).min(HISTOGRAM_BINS - 1)] += 1;
        }
        let fabric = fabric(&retained, &bonding.pairs, container.period());
        let spread = fabric
            .symmetric_eigenvalues()
            // An isotropic fabric has three eigenvalues of one third.
            .map(|e| (3.0 * e - 1.0).abs())
            .max();
        let cube = |s: &Sphere| s[3] * s[3] * s[3];
        let cubes: f64 = spheres.iter().map(cube).sum();
        let dropped = spheres.len() - retained.len();
        Self {
            coordination_all: bonding.coordination_all,
            coordination_retained: 2.0 * bonding.pairs.len() as f64 / count,
            coordination_interior: interior_coordination(
                container,
                &retained,
                &bonding.pairs,
                4.0 * mean_radius,
            ),
            volume_fraction: 4.0 / 3.0 * std::f64::consts::PI * cubes / container.volume(),
            mean_radius,
            radius_range: [low, high],
            radius_histogram,
            mean_overlap: making.overlap,
            bond_tolerance: bonding.tolerance,
            fabric,
            fabric_anisotropy: spread,
            asked: making.asked,
            placed: spheres.len(),
            dropped,
            dropped_share: match dropped {
                0 => 0.0,
                _ => 1.0 - retained.iter().map(cube).sum::<f64>() / cubes,
            },
            beyond: 0,
            bodies: bodies.len(),
            across: narrow::across(bodies, spheres, body),
            cut: Cut::default(),
            steps: making.steps,
        }
    }
}

/// Returns the fabric tensor `mean(n n^T)` of bonds.
fn fabric(spheres: &[Sphere], pairs: &[[u32; 2]], period: Option<[f64; 3]>) -> Matrix3<f64> {
    let mut out = Matrix3::zeros();
    for pair in pairs {
        let [a, b] = pair.map(|i| centre(&spheres[i as usize]));
        let d: [f64; 3] = (b - a).into();
        let n = Vector3::from(period.map_or(d, |p| image(d, &p))).normalize();
        out += n * n.transpose() / pairs.len() as f64;
    }
    out
}

/// Returns the mean number of bonds of the spheres farther than `reach` \[m\] from any wall; 0 if there are
/// none.
fn interior_coordination(container: &Container, spheres: &[Sphere], pairs: &[[u32; 2]], reach: f64) -> f64 {
    let mut degree = vec![0_u32; spheres.len()];
    pairs.iter().flatten().for_each(|i| degree[*i as usize] += 1);
    let mut container = container.clone();
    container.prepare(reach);
    let is_interior = |(s, _): &(&Sphere, &u32)| container.gap(&centre(s), reach) >= reach;
    let interior: Vec<f64> = spheres
        .iter()
        .zip(&degree)
        .filter(is_interior)
        .map(|(_, d)| f64::from(*d))
        .collect();
    interior.iter().sum::<f64>() / interior.len().max(1) as f64
}
