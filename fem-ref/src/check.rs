//! Validation of a mesh.

use crate::element::{self, ElementKind, HEX_CORNERS};
use crate::error::{Error, Result};
use arlequin_core::Real;
use arlequin_core::geometry::bounds_of;
use nalgebra::{Point3, Vector3};
use std::collections::HashMap;

/// Smallest accepted Jacobian, relative to the cube of the longest edge; larger in single precision.
fn flat_limit<T: Real>() -> T {
    T::of(1e-10).max(T::epsilon() * T::of(8.0))
}

fn plain<T: Real>(p: &Point3<T>) -> [f64; 3] {
    [p.x.as_f64(), p.y.as_f64(), p.z.as_f64()]
}

/// Performs the checks of [`crate::Mesh::new`], cheapest first. Returns pairs of coincident nodes, which are
/// allowed on the lips of slits.
pub(crate) fn mesh<T: Real>(
    kind: ElementKind,
    nodes: &[Point3<T>],
    connectivity: &[u32],
) -> Result<Vec<[u32; 2]>> {
    let n = kind.corners();
    if nodes.is_empty() || connectivity.is_empty() {
        return Err(Error::EmptyMesh {
            nodes: nodes.len(),
            elements: connectivity.len() / n,
        });
    }
    if !connectivity.len().is_multiple_of(n) {
        return Err(Error::Connectivity {
            kind: kind.name(),
            corners: n,
            found: connectivity.len(),
        });
    }
    for (node, p) in nodes.iter().enumerate() {
        if let Some(k) = (0..3).find(|&k| !p[k].is_finite()) {
            return Err(Error::NodeNotFinite {
                node,
                axis: ['x', 'y', 'z'][k],
                value: p[k].as_f64(),
            });
        }
    }
    // In this order: later checks rely on indices that earlier ones have accepted.
    references(kind, nodes, connectivity)?;
    repeated(kind, nodes, connectivity)?;
    let pairs = coincident(nodes)?;
    shapes(kind, nodes, connectivity).map(|()| pairs)
}

fn references<T: Real>(kind: ElementKind, nodes: &[Point3<T>], connectivity: &[u32]) -> Result<()> {
    let mut used = vec![false; nodes.len()];
    for (k, &index) in connectivity.iter().enumerate() {
        match used.get_mut(index as usize) {
            Some(u) => *u = true,
            None => {
                return Err(Error::NodeIndex {
                    kind: kind.name(),
                    element: k / kind.corners(),
                    index: index as usize,
                    last: nodes.len() - 1,
                });
            }
        }
    }
    match used.iter().position(|u| !u) {
        None => Ok(()),
        Some(node) => Err(Error::UnreferencedNode {
            node,
            point: plain(&nodes[node]),
        }),
    }
}

/// Returns an error for two elements with the same set of nodes in any order: their mass and stiffness would
/// count twice, and all their faces would be inner faces.
fn repeated<T: Real>(kind: ElementKind, nodes: &[Point3<T>], connectivity: &[u32]) -> Result<()> {
    let elements = connectivity.chunks_exact(kind.corners());
    let mut keyed: Vec<(NodeSet, u32)> = elements.map(node_set).zip(0..).collect();
    // Sorted, so that twins are neighbours; the lowest pair is reported.
    keyed.sort_unstable();
    let twins = keyed.windows(2).filter(|pair| pair[0].0 == pair[1].0);
    match twins.map(|pair| [pair[0].1 as usize, pair[1].1 as usize]).min() {
        None => Ok(()),
        Some([first, second]) => Err(Error::RepeatedElement {
            kind: kind.name(),
            first,
            second,
            centre: centre(nodes, &connectivity[first * kind.corners()..][..kind.corners()]),
        }),
    }
}

/// Nodes of an element in ascending order; unused entries hold the largest number.
pub(crate) type NodeSet = [u32; 8];

/// Returns the set of an element's nodes.
pub(crate) fn node_set(corners: &[u32]) -> NodeSet {
    let mut out = [u32::MAX; 8];
    out[..corners.len()].copy_from_slice(corners);
    out.sort_unstable();
    out
}

/// Mean of the corners of an element \[m\].
fn centre<T: Real>(nodes: &[Point3<T>], corners: &[u32]) -> [f64; 3] {
    let sum = corners
        .iter()
        .fold(Vector3::zeros(), |s, &k| s + nodes[k as usize].coords);
    plain(&Point3::from(sum / T::of(corners.len() as f64)))
}

/// Distance below which nodes coincide: 1e-9 of the mesh diagonal (more in single precision) \[m\].
fn nearness<T: Real>(nodes: &[Point3<T>]) -> f64 {
    let [low, high] = bounds_of(nodes.iter());
    let relative = T::of(1e-9).max(T::epsilon() * T::of(4.0));
    ((high - low).norm() * relative).as_f64()
}

/// Pairs of coincident nodes: each node with an earlier one.
pub(crate) fn coincident<T: Real>(nodes: &[Point3<T>]) -> Result<Vec<[u32; 2]>> {
    let [low, _] = bounds_of(nodes.iter());
    // A mesh without extent has all nodes at one place.
    let limit = nearness(nodes);
    if limit <= 0.0 {
        return match nodes {
            [_] => Ok(Vec::new()),
            _ => Err(coincident_error(nodes, 0, 1)),
        };
    }
    // A node is entered in every grid cell that its surroundings touch: nearly always one cell, as cells are
    // 64 limits wide.
    let mut pairs = Vec::new();
    let mut bins: HashMap<[i64; 3], Vec<u32>> = HashMap::with_capacity(nodes.len());
    for (k, p) in nodes.iter().enumerate() {
        let offset = (p - low).map(|c| c.as_f64() / (64.0 * limit));
        let margin = Vector3::repeat(1.0 / 64.0);
        let (a, b) = (
            (offset - margin).map(f64::floor),
            (offset + margin).map(f64::floor),
        );
        let mut keys: Vec<[i64; 3]> = Vec::with_capacity(1);
        for corner in 0..8u8 {
            let key = [0, 1, 2].map(|d| (if corner >> d & 1 == 0 { a[d] } else { b[d] }) as i64);
            if !keys.contains(&key) {
                keys.push(key);
            }
        }
        let mut twin = None;
        for key in keys {
            let bin = bins.entry(key).or_default();
            let near = |j: &&u32| (nodes[**j as usize] - p).norm().as_f64() < limit;
            twin = twin.or_else(|| bin.iter().find(near).copied());
            bin.push(k as u32);
        }
        pairs.extend(twin.map(|j| [j, k as u32]));
    }
    Ok(pairs)
}

/// Error for two coincident nodes.
pub(crate) fn coincident_error<T: Real>(nodes: &[Point3<T>], first: usize, second: usize) -> Error {
    Error::CoincidentNodes {
        first,
        second,
        point: plain(&nodes[first]),
        distance: (nodes[second] - nodes[first]).norm().as_f64(),
        limit: nearness(nodes),
    }
}

fn shapes<T: Real>(kind: ElementKind, nodes: &[Point3<T>], connectivity: &[u32]) -> Result<()> {
    if kind == ElementKind::Bar2 {
        return bar_lengths(nodes, connectivity);
    }
    let limit = flat_limit::<T>();
    for (e, corners) in connectivity.chunks_exact(kind.corners()).enumerate() {
        let mut p = [Point3::origin(); 8];
        for (p, &k) in p.iter_mut().zip(corners) {
            *p = nodes[k as usize];
        }
        let longest = kind
            .edges()
            .iter()
            .map(|[a, b]| (p[*b] - p[*a]).norm())
            .fold(T::zero(), |a, b| a.max(b));
        let (corner, jacobian) = worst_corner(kind, &p);
        // Relative to the longest edge, so that the limit does not depend on the unit of length.
        let relative = jacobian / (longest * longest * longest);
        if relative > limit {
            continue;
        }
        let (kind, element, centre) = (kind.name(), e, centre(nodes, corners));
        // Beyond the limit in the negative sense the element is inside out, not flat.
        let (jacobian, inverted, limit) = (relative.as_f64(), relative < -limit, limit.as_f64());
        return Err(if inverted {
            Error::InvertedElement {
                kind,
                element,
                corner,
                centre,
                jacobian,
                limit,
            }
        } else {
            Error::FlatElement {
                kind,
                element,
                corner,
                centre,
                jacobian,
                limit,
            }
        });
    }
    Ok(())
}

/// Returns the corner with the smallest Jacobian `∂x/∂(edges)`, and the Jacobian \[m³\].
// Linear elements have one Jacobian.
fn worst_corner<T: Real>(kind: ElementKind, p: &[Point3<T>; 8]) -> (usize, T) {
    if kind == ElementKind::Tet4 {
        return (0, element::tet_gradients(p).1);
    }
    let mut worst = (0, T::of(f64::from(f32::MAX)));
    for (k, c) in HEX_CORNERS.iter().enumerate() {
        let local = element::hex_gradients(&Vector3::from(c.map(T::of)));
        // The reference edge has length 2, so the Jacobian of the edges is 8 times that of the map.
        let jacobian = element::hex_jacobian(p, &local).determinant() * T::of(8.0);
        if jacobian < worst.1 {
            worst = (k, jacobian);
        }
    }
    worst
}

fn bar_lengths<T: Real>(nodes: &[Point3<T>], connectivity: &[u32]) -> Result<()> {
    let [low, high] = bounds_of(nodes.iter());
    let size = (high - low).norm();
    // In single precision 1e-9 is below round-off.
    let limit = T::of(1e-9).max(T::epsilon() * T::of(4.0));
    for (element, ends) in connectivity.chunks_exact(2).enumerate() {
        let [a, b] = [nodes[ends[0] as usize], nodes[ends[1] as usize]];
        let length = (b - a).norm();
        if length <= limit * size {
            return Err(Error::FlatElement {
                kind: ElementKind::Bar2.name(),
                element,
                corner: 0,
                centre: plain(&nalgebra::center(&a, &b)),
                jacobian: (length / size.max(T::of(f64::from(f32::MIN_POSITIVE)))).as_f64(),
                limit: limit.as_f64(),
            });
        }
    }
    Ok(())
}
