//! Probes of stress and strain, at a point or as the mean over nodes.

use crate::error::{Result, core, key};
use crate::setup::body::Body;
use crate::setup::select;
use crate::spec::{Component, Probe, Quantity};
use arlequin::core::nalgebra::Vector3;
use arlequin::core::{Recovered, Recovery, Subdomain, SymmetricTensor};

/// Radius around a sphere in which its neighbours are counted, in sphere diameters.
const AROUND: f64 = 2.5;
/// Smallest distance between a sphere and the centroid of its neighbours, over that radius, at which the
/// sphere counts as one at the rim. At a plane surface the outer layer has 0.27, the next layer 0.1.
const RIM: f64 = 0.18;
/// Largest number of spheres of a probe that are tested.
const LOOKS: usize = 64;

/// A component of a tensor that is recovered at nodes.
#[derive(Debug, Clone)]
pub(super) struct TensorRow {
    model: usize,
    /// Nodes that the value is computed from; `factors` holds their weights in the sum.
    nodes: Vec<usize>,
    factors: Vec<f64>,
    component: Option<Component>,
}

/// Returns whether most of a sphere's neighbours lie on one side of it.
fn is_on_rim(body: &Body, node: usize) -> bool {
    let points = body.model.nodes();
    let (x, reach) = (points[node], AROUND * body.spacing);
    let arms = points.iter().map(|p| p - x).filter(|arm| arm.norm() < reach);
    let (sum, count) = arms.fold((Vector3::zeros(), 0.0), |(s, n), arm| (s + arm, n + 1.0));
    sum.norm() > RIM * reach * count
}

fn recovered(
    recovery: &dyn Recovery<f64>,
    s: &Subdomain<f64>,
    nodes: &[usize],
) -> Result<Vec<Recovered<f64>>> {
    let mut tensors = Vec::with_capacity(nodes.len());
    let result = recovery.recover(&s.state().q, nodes, &mut tensors);
    result.map_err(core(format!("model.{}", s.model().name())))?;
    Ok(tensors)
}

impl TensorRow {
    /// Prepares a probe of the model with number `model`; `placed` are the nodes and shape functions of its
    /// point.
    pub(super) fn new(
        path: &str,
        probe: &Probe,
        (model, body): (usize, &Body),
        placed: Option<(Vec<usize>, Vec<f64>)>,
    ) -> Result<Self> {
        let name = body.model.name();
        let Some(recovery) = body.model.views().recovery else {
            let rule = format!("model '{name}' of kind '{}' knows no stresses", body.model.kind());
            return Err(key(format!("{path}.quantity"), rule));
        };
        if probe.quantity == Quantity::Strain && !recovery.has_strain() {
            let rule = format!("model '{name}' knows stresses only; take \"stress\"");
            return Err(key(format!("{path}.quantity"), rule));
        }
        let (nodes, factors) = match (placed, &probe.over) {
            (Some(placed), _) => placed,
            (None, Some(selection)) => {
                let nodes = select::nodes(&format!("{path}.where"), body, selection)?;
                // Particles are weighted by the volume of their spheres: in a plain mean the small ones,
                // which carry higher stresses, would count too much.
                let size = |n: &usize| body.grid.radii.get(*n).map_or(1.0, |r| r.powi(3));
                let sum: f64 = nodes.iter().map(size).sum();
                let factors = nodes.iter().map(|n| size(n) / sum).collect();
                (nodes, factors)
            }
            (None, None) => (Vec::new(), Vec::new()),
        };
        Ok(Self {
            model,
            nodes,
            factors,
            component: probe.component,
        })
    }

    /// Warns about particles at the rim: outside of them, no bonds carry stress.
    pub(super) fn warning(&self, name: &str, bodies: &[Body]) -> Option<String> {
        let body = &bodies[self.model];
        body.grains.as_ref()?;
        let every = self.nodes.len().div_ceil(LOOKS).max(1);
        let (mut rim, mut total) = (0.0, 0.0);
        for (node, factor) in self.nodes.iter().zip(&self.factors).step_by(every) {
            total += factor;
            rim += if is_on_rim(body, *node) { *factor } else { 0.0 };
        }
        (2.0 * rim > total).then(|| {
            format!(
                "probe '{name}': lies on the rim of the particles of '{}', whose stresses are means over volumes without bonds on \
                 one side and not those of the surface (a concentration of 3.2 at the edge of a hole comes out as 1.9); read them \
                 two diameters inside, or take finite elements there",
                body.model.name()
            )
        })
    }

    /// All-gathers the tensors at the nodes of the probe from the ranks that own them, in the order of the
    /// probe's nodes. Collective.
    fn gather_tensors(
        &self,
        recovery: &dyn Recovery<f64>,
        s: &Subdomain<f64>,
    ) -> Result<Vec<Recovered<f64>>> {
        let owned = s.owned();
        let local = |(place, node): (usize, &usize)| owned.local(*node).map(|n| (place, n));
        let (places, nodes): (Vec<_>, Vec<_>) = (0..).zip(&self.nodes).filter_map(local).unzip();
        let tensors = recovered(recovery, s, &nodes)?;
        let numbers = |r: &Recovered<f64>| {
            let strain = r.strain.unwrap_or_else(SymmetricTensor::zero);
            std::array::from_fn::<f64, 12, _>(|k| if k < 6 { r.stress.0[k] } else { strain.0[k - 6] })
        };
        let rows = places.into_iter().zip(tensors.iter().map(numbers)).collect();
        let rows = owned.all_gather_rows(rows).map_err(core("ranks"))?;
        let tensor = |numbers: &[f64; 12], first: usize| {
            let mut out = SymmetricTensor::zero();
            out.0.copy_from_slice(&numbers[first..first + 6]);
            out
        };
        let recovered = |(_, numbers): &(usize, [f64; 12])| Recovered {
            stress: tensor(numbers, 0),
            strain: recovery.has_strain().then(|| tensor(numbers, 6)),
        };
        Ok(rows.iter().map(recovered).collect())
    }

    /// Returns the value from the tensor interpolated to a point or averaged over nodes. Collective for
    /// partitioned models.
    pub(super) fn read(&self, quantity: Quantity, subdomains: &[Subdomain<f64>]) -> Result<f64> {
        let s = &subdomains[self.model];
        let Some(recovery) = s.model().views().recovery else {
            return Ok(f64::NAN);
        };
        let tensors = self.gather_tensors(recovery, s)?;
        let mut sum = SymmetricTensor::zero();
        for (r, factor) in tensors.iter().zip(&self.factors) {
            let tensor = match quantity {
                Quantity::Strain => r.strain.unwrap_or_else(SymmetricTensor::zero),
                _ => r.stress,
            };
            sum.0.iter_mut().zip(tensor.0).for_each(|(s, t)| *s += factor * t);
        }
        let part = self.component.and_then(|c| c.tensor().or_else(|| c.rank()));
        Ok(match (quantity, part) {
            (Quantity::VonMises, _) => sum.von_mises(),
            (Quantity::PrincipalStress, Some(k)) => sum.principal()[k],
            (_, Some(k)) => sum.0[k],
            (_, None) => f64::NAN,
        })
    }
}
