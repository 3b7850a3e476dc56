//! Quasicontinuum: particles everywhere, of which those of the coarse region follow the coarse mesh.

use super::blend::lift;
use crate::error::Result;
use crate::explore::compare::case::Case;
use crate::explore::compare::reflections::{Pace, Reflections};
use crate::explore::compare::sparse::block_diagonal;
use crate::explore::compare::system::{Places, System};
use crate::spec::Method;
use arlequin::core::geometry::Cell;
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::core::sprs::CsMat;
use arlequin::core::{Uniform, Weight};
use std::sync::Arc;

/// Half of the width of a cluster around a layer of nodes, in spacings of the particles. Middles of bonds lie
/// half a spacing and one and a half from a node, so that round-off does not decide which of them count.
pub(super) const CLUSTER: f64 = 2.0;

/// Least number of bonds for which one of a cluster stands.
const LEAST_FACTOR: f64 = 1.2;

/// The fine model in the place of both.
pub(super) fn fine(case: &mut Case) -> Result<Reflections> {
    let system = case.fine_system(&Uniform(1.0))?;
    let pace = Pace::common(&system)?;
    Ok(Reflections::new(system, None, pace))
}

/// Lets the particles up to the middle of the overlap follow the coarse mesh. All bonds are summed, or
/// those of clusters of a given half width around the layers of nodes.
pub(super) fn quasicontinuum(case: &mut Case, cluster: Option<f64>) -> Result<Reflections> {
    let middle = 0.5 * case.width;
    let particles = match cluster {
        None => case.fine_system(&Uniform(1.0))?,
        Some(half) => {
            let weight = clusters(case, half * case.spacing[1]);
            if weight.factor < LEAST_FACTOR {
                let rule = "has clusters that meet, so that all bonds are summed; take a coarser mesh or quasicontinuum";
                return Err(case.refusal(Method::QuasicontinuumClusters, rule));
            }
            case.fine_system(&weight)?
        }
    };
    let followers = case.followers(true, [f64::NEG_INFINITY, middle]);
    let (d, split) = (case.components(), case.places.split);
    let mesh = case.places.selected(&(0..split).collect::<Vec<_>>());
    let whole = massless(&mesh, particles);
    Reflections::of_free(lift(whole, &followers, d, split, |node, c| node * d + c))
}

/// Puts a mesh without a law of its own, which lends its shape functions, before the particles.
pub(super) fn massless(mesh: &Places, particles: System) -> System {
    let split = mesh.x.len();
    let join = |a: &[f64], b: &[f64]| [a, b].concat();
    let places = &particles.places;
    let places = Places {
        x: join(&mesh.x, &places.x),
        axial: join(&mesh.axial, &places.axial),
        across: join(&mesh.across, &places.across),
        moves: [&*mesh.moves, &places.moves].concat(),
        split,
    };
    let mass = join(&vec![0.0; split], &particles.mass);
    let full = join(&vec![1.0; split], &particles.mass);
    let stiffness = block_diagonal(&CsMat::zero((split, split)), &particles.stiffness);
    System::new(Arc::new(places), mass, &full, stiffness)
}

/// Weight of the bonds near the layers of coarse nodes, as many times as large as they are rare.
struct Clusters {
    axis: Vector3<f64>,
    origin: Point3<f64>,
    layers: Vec<f64>,
    half: f64,
    factor: f64,
    /// Distance beyond which all bonds count.
    end: f64,
}

impl Weight<f64> for Clusters {
    fn value(&self, x: &Point3<f64>) -> f64 {
        let s = (x - self.origin).dot(&self.axis);
        if s >= self.end {
            return 1.0;
        }
        let near = self.layers.iter().any(|l| (s - l).abs() <= self.half);
        if near { self.factor } else { 0.0 }
    }

    /// A bond belongs to a cluster by its middle.
    fn mean(&self, cell: &Cell<f64>) -> f64 {
        let [low, high] = cell.bounds();
        self.value(&arlequin::core::nalgebra::center(&low, &high))
    }
}

fn clusters(case: &Case, half: f64) -> Clusters {
    let (origin, axis) = case.frame();
    let mut layers: Vec<f64> = case.coarse_nodes().iter().map(|x| case.distance(x)).collect();
    layers.sort_by(f64::total_cmp);
    layers.dedup_by(|next, last| *next - *last < half);
    let end = 0.5 * case.width;
    let mut out = Clusters {
        axis,
        origin,
        factor: 1.0,
        half,
        end,
        layers,
    };
    // As many bonds as the clusters leave out are added to those that they hold.
    let first = out.layers.first().copied().unwrap_or(0.0);
    let count = 20_000_u32;
    let step = (end - first) / f64::from(count);
    let places = (0..count).map(|k| first + (f64::from(k) + 0.5) * step);
    let inside = places
        .filter(|s| out.layers.iter().any(|l| (s - l).abs() <= half))
        .count();
    out.factor = f64::from(count) / inside.max(1) as f64;
    out
}
