//! Tables that a look reads, filled once: the elements of spheres and bonds, and the loads of bonds in unit
//! strains.

use crate::error::{Error, Result, key};
use crate::run::quiet::Strain;
use crate::setup::Moving;
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::core::{Breakable, Response};
use arlequin::fem_ref::FemField;
use rayon::prelude::*;

/// Place in the body at which its field is read for a sphere: the sphere's own, or if that lies outside of
/// all elements, the first tenth of the way to the centre of the nearest one that does not.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    pub(super) element: u32,
    tenths: u8,
}

impl Place {
    pub(super) fn new(field: &FemField<f64>, x: &Point3<f64>, centre: &Point3<f64>) -> Result<Self> {
        let place = |tenths: u8| {
            let way = Self { element: 0, tenths }.way(x, centre);
            let element = field.element_at(&(x - way))? as u32;
            Some(Self { element, tenths })
        };
        let first = (0..=10).find_map(place);
        first.ok_or_else(|| key("body", "has no element at the centre of one"))
    }

    /// Way to a sphere at `x` \[m\].
    pub(super) fn way(self, x: &Point3<f64>, centre: &Point3<f64>) -> Vector3<f64> {
        (x - centre) * (0.1 * f64::from(self.tenths))
    }
}

/// Middle of a bond between two spheres \[m\].
pub(super) fn middle(nodes: &[Point3<f64>], [i, j]: &[u32; 2]) -> Vector3<f64> {
    (nodes[*i as usize].coords + nodes[*j as usize].coords) * 0.5
}

/// Largest utilisations of the bonds of each element in unit strains of either sign \[–\].
pub(super) fn in_unit_strains(
    (bonds, of_bonds): (&dyn Breakable<f64>, &[u32]),
    nodes: &[Point3<f64>],
    moving: &Moving,
    elements: usize,
) -> Vec<Strain> {
    // So small that laws with finite rotations stay linear.
    const SMALL: f64 = 1e-6;
    let mut out = vec![[0.0_f64; 6]; elements];
    let all_bonds: Vec<u32> = (0..of_bonds.len() as u32).collect();
    for (k, strain) in Response::gradients(SMALL).into_iter().enumerate() {
        for sign in [1.0, -1.0] {
            let h = strain * sign;
            let mut q = vec![0.0; 6 * nodes.len()];
            let (linear, angular) = q.split_at_mut(3 * nodes.len());
            let chunks = linear
                .par_chunks_exact_mut(3)
                .zip(angular.par_chunks_exact_mut(3));
            let places = nodes.par_iter().zip(&*moving.responses);
            chunks.zip(places).for_each(|((u, th), (x, response))| {
                let relaxation = response.in_gradient(&h);
                u.copy_from_slice((h * x.coords + relaxation[0]).as_slice());
                th.copy_from_slice(relaxation[1].as_slice());
            });
            let loads = bonds.utilisations(&q, &all_bonds);
            for (u, e) in loads.iter().zip(of_bonds) {
                let most = &mut out[*e as usize][k];
                *most = most.max(u / SMALL);
            }
        }
    }
    out
}

/// Element of the body at each of some places.
pub(super) fn homes(moving: &Moving, places: impl Iterator<Item = Vector3<f64>>) -> Result<Vec<u32>> {
    places
        .map(|x| Ok(moving.element_at(&x.into())? as u32))
        .collect::<Result<_, Error>>()
}

/// Elements that share a node with each element.
pub(super) fn neighbours(moving: &Moving) -> Result<Vec<Vec<u32>>> {
    let mesh = moving.mesh()?;
    let mut around = vec![Vec::new(); mesh.nodes().len()];
    for e in 0..mesh.element_count() {
        mesh.element(e)
            .iter()
            .for_each(|k| around[*k as usize].push(e as u32));
    }
    let of_element = |e: usize| {
        let nodes = mesh.element(e).iter();
        let mut out: Vec<u32> = nodes.flat_map(|k| around[*k as usize].iter().copied()).collect();
        out.sort_unstable();
        out.dedup();
        out
    };
    Ok((0..mesh.element_count()).map(of_element).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use arlequin::fem_ref::{ElementKind, generate};

    #[test]
    fn a_sphere_outside_reads_the_field_at_the_nearest_tenth_of_its_way_that_is_inside() {
        let mesh = generate::block(
            ElementKind::Hex8,
            Point3::origin(),
            Point3::new(2.0, 1.0, 1.0),
            [2, 1, 1],
        );
        let field = FemField::new(mesh.expect("a block"));
        let centre = Point3::new(1.5, 0.5, 0.5);
        for (x, tenths) in [(1.9, 0), (2.04, 1), (2.3, 4)] {
            let x = Point3::new(x, 0.5, 0.5);
            let place = Place::new(&field, &x, &centre).expect("a place");
            assert_eq!((place.element, place.tenths), (1, tenths), "{x}");
            let way = place.way(&x, &centre).x;
            assert!(
                (way - 0.1 * f64::from(tenths) * (x.x - 1.5)).abs() < 1e-12,
                "{way}"
            );
        }
    }
}
