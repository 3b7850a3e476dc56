//! Natural elements on the worst point sets: exact grids, where eight nodes share each circumsphere, and
//! grids perturbed by 1e-9, which make flat tetrahedra.

use super::{HardCase, Outcome, critical, shaken};
use crate::solid::{self, block, material};
use arlequin::cnem::constraint::Surface;
use arlequin::cnem::domain::Domain;
use arlequin::cnem::{CnemModel, Options, generate};
use arlequin::core::nalgebra::Point3;
use arlequin::core::{Coupled, L2, Model, Profile, Result, Silent, Subdomain, TimeStep, Weights};
use arlequin::fem_ref::{ElementKind, FemModel, Mesh};

pub(super) const CASES: &[HardCase] = &[HardCase {
    name: "cospherical grids and slivers",
    why: "the Delaunay complex is not unique, or holds flat tetrahedra",
    naive: "linear tetrahedra on that complex: refused, or a critical step that collapses",
    promise: "critical step of the grid spacing, invariant and momenta kept",
    fast: true,
    run: slivers,
}];

fn points(noise: f64) -> Result<Vec<Point3<f64>>> {
    let grid = generate::block(
        Point3::new(2.0, 0.0, 0.0),
        Point3::new(4.0, 1.0, 1.0),
        [8, 4, 4],
        0.0,
        1,
    )?;
    let mut next = crate::noise(3);
    // Nodes on the surface stay, so that the body keeps its shape.
    let inner =
        |p: &Point3<f64>| (2.01..3.99).contains(&p.x) && [p.y, p.z].iter().all(|c| (0.01..0.99).contains(c));
    Ok(grid
        .into_iter()
        .map(|p| {
            if inner(&p) {
                p.map(|c| c + noise * next())
            } else {
                p
            }
        })
        .collect())
}

/// Returns the critical step of linear tetrahedra on the same complex \[s\]; zero if the mesh is refused.
fn tetrahedra(domain: &Domain) -> Result<f64> {
    let connectivity = domain.elements().flatten().map(|n| n as u32).collect();
    let Ok(mesh) = Mesh::new(ElementKind::Tet4, domain.nodes().to_vec(), connectivity) else {
        return Ok(0.0);
    };
    let mut model = FemModel::new("tetrahedra", mesh, material()?)?;
    let mut inertia = vec![0.0; model.layout().dofs()];
    model.lumped_inertia(&arlequin::core::Uniform(1.0), &mut inertia)?;
    let inverse: Vec<f64> = inertia.iter().map(|m| 1.0 / m).collect();
    model.critical_step(&inverse)
}

fn slivers() -> Result<Outcome> {
    let mut out = Outcome::default();
    for noise in [0.0, 1e-9, 1e-5] {
        let domain = Domain::new(&points(noise)?, &Surface::convex_hull())?;
        let flat = tetrahedra(&domain)?;
        let weights = solid::weights(Profile::Cubic, 0.05)?;
        let fine_weights = Weights::complement_of(std::slice::from_ref(&weights));
        let left = FemModel::new(
            "left",
            block(ElementKind::Hex8, [0.0, 3.0], [6, 2, 2])?,
            material()?,
        )?;
        let right = CnemModel::new("right", domain, material()?, Options::default())?;
        let bodies = shaken(
            [
                Subdomain::coarse(left, weights),
                Subdomain::fine(right, fine_weights),
            ],
            2,
        )?;
        let mediator = solid::mediator(ElementKind::Hex8, solid::OVERLAP, [2, 2, 2])?;
        let interface = solid::spec(mediator, Box::new(L2));
        let mut c = Coupled::new(bodies, vec![interface], TimeStep::Fraction(0.9), None)?;
        let critical_step = critical(&c);
        let (before, scale) = (c.momentum(), solid::momentum_scale(&c));
        c.run(300, &mut Silent)?;
        let after = c.momentum();
        out.add(
            format!("critical step, nodes moved by {noise:e}"),
            critical_step,
            0.05..=1.0,
        );
        out.add(format!("drift, nodes moved by {noise:e}"), c.drift(), 0.0..=1e-11);
        for (k, what) in ["linear", "angular"].into_iter().enumerate() {
            out.add(
                format!("change of the {what} momentum, nodes moved by {noise:e}"),
                (after[k] - before[k]).norm() / scale[k],
                0.0..=1e-11,
            );
        }
        if noise > 0.0 {
            out.add_naive(
                format!("critical step of tetrahedra over ours (0: refused), nodes moved by {noise:e}"),
                flat / critical_step,
                0.0..=0.05,
            );
        }
    }
    Ok(out)
}
